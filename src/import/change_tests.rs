//! Files that another program changes while they are read: an error that names the file, whatever was read of it.

use super::collect::Collector;
use super::testing::temporary;
use super::{Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, ReadOptions, Sink, UpAxis, read_file};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use glam::{DAffine3, DVec3};
use std::fs::{self, File};
use std::path::Path;
use std::time::{Duration, SystemTime};

/// A sink during whose first call for a part another program acts.
struct Meddled<'a> {
    inner: Collector,
    /// True if it acts during the first call for triangles instead.
    at_triangles: bool,
    act: Option<Box<dyn FnOnce() + 'a>>,
}

impl Meddled<'_> {
    fn act(&mut self) {
        if let Some(act) = self.act.take() {
            act();
        }
    }
}

impl Sink for Meddled<'_> {
    fn units(&mut self, _: Option<f64>, _: UpAxis) {}
    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        self.inner.material(material)
    }
    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        if !self.at_triangles {
            self.act();
        }
        self.inner.part(part)
    }
    fn shared_mesh(&mut self, parts: u32) -> Result<MeshKey> {
        self.inner.shared_mesh(parts)
    }
    fn triangles(&mut self, m: MeshKey, part: u32, p: &[[DVec3; 3]], attributes: Attributes<'_>) -> Result<()> {
        self.act();
        self.inner.triangles(m, part, p, attributes)
    }
    fn instance(&mut self, mesh: MeshKey, at: DAffine3, first: PartKey) -> Result<()> {
        self.inner.instance(mesh, at, first)
    }
    fn at(&mut self, _: u64, _: u64) {}
    fn note(&mut self, text: String) {
        self.inner.note(text);
    }
    fn cancel(&self) -> &Cancel {
        self.inner.cancel()
    }
}

/// Reads `path` while `act` happens.
fn read(path: &Path, act: impl FnOnce()) -> Result<()> {
    let mut sink = Meddled { inner: Collector::new(), at_triangles: false, act: Some(Box::new(act)) };
    let outcome = read_file(path, &ReadOptions::default(), &mut sink);
    assert!(sink.act.is_none(), "nothing happened: {outcome:?}");
    outcome
}

const OBJ: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
const STL: &str =
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
const GLTF: &str = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
    "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"a.bin"}]}"#;

/// Files of each format, with those that they refer to.
fn files(folder: &Path) -> Vec<std::path::PathBuf> {
    let stl = [&[b' '; 80][..], &1u32.to_le_bytes(), &[0; 50]].concat();
    let soup = [&b"OCSOUP\r\n\x01\0\0\0\0\0\0\0"[..], &1u64.to_le_bytes(), &[0; 8 + 36]].concat();
    let all: [(&str, &[u8]); 8] = [
        ("a.obj", OBJ.as_bytes()),
        ("a.mtl", b"newmtl m\nKd 1 0 0\n"),
        ("a.ply", PLY.as_bytes()),
        ("text.stl", STL.as_bytes()),
        ("binary.stl", &stl),
        ("a.soup", &soup),
        ("a.gltf", GLTF.as_bytes()),
        ("a.bin", &[0; 36]),
    ];
    all.map(|(name, bytes)| {
        fs::write(folder.join(name), bytes).expect("a file");
        folder.join(name)
    })
    .to_vec()
}

/// Writes the same number of bytes into the file.
fn overwrite(path: &Path) {
    let bytes = fs::read(path).expect("the file");
    fs::write(path, bytes).expect("written");
    // The clock of a file system may be too coarse for a test.
    let later = SystemTime::now() + Duration::from_secs(5);
    File::options().write(true).open(path).and_then(|f| f.set_modified(later)).expect("a time");
}

fn cut(path: &Path) {
    let len = fs::metadata(path).expect("the file").len();
    File::options().write(true).open(path).and_then(|f| f.set_len(len / 3)).expect("cut");
}

fn lengthen(path: &Path) {
    let bytes = fs::read(path).expect("the file");
    fs::write(path, [&bytes[..], b"\n"].concat()).expect("written");
}

/// Puts a copy of the file in its place, with its time.
#[cfg(unix)]
fn replace(path: &Path) {
    let copy = path.with_extension("copy");
    fs::copy(path, &copy).expect("a copy");
    let written = fs::metadata(path).and_then(|info| info.modified()).expect("a time");
    File::options().write(true).open(&copy).and_then(|f| f.set_modified(written)).expect("a time");
    fs::rename(&copy, path).expect("replaced");
}

#[cfg(unix)]
fn remove(path: &Path) {
    fs::remove_file(path).expect("removed");
}

fn assert_changed(outcome: Result<()>, path: &Path) {
    match outcome {
        Err(Error::Parse { file, why, .. }) if file == path && why.contains("changed") => {}
        other => panic!("{}: {other:?}", path.display()),
    }
}

#[test]
fn a_file_that_changes_while_it_is_read_is_refused() {
    let folder = temporary();
    #[cfg(unix)]
    let acts: [fn(&Path); 5] = [overwrite, cut, lengthen, replace, remove];
    #[cfg(not(unix))]
    let acts: [fn(&Path); 3] = [overwrite, cut, lengthen];
    for act in acts {
        for path in files(folder.path()).iter().filter(|p| !p.ends_with("a.mtl") && !p.ends_with("a.bin")) {
            assert_changed(read(path, || act(path)), path);
        }
        // A file that another one refers to.
        files(folder.path());
        let library = folder.path().join("a.mtl");
        assert_changed(read(&folder.path().join("a.obj"), || act(&library)), &library);
        change_buffer(folder.path(), act);
    }
}

/// Changes the buffer of a glTF file after its first mesh was read; the second mesh is in the same buffer.
fn change_buffer(folder: &Path, act: fn(&Path)) {
    let (document, buffer) = (folder.join("two.gltf"), folder.join("a.bin"));
    let two = GLTF.replace("\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0},{\"mesh\":0},{\"mesh\":1}]");
    let mesh = r#"{"primitives":[{"attributes":{"POSITION":0}}]}"#;
    fs::write(&document, two.replace(mesh, &format!("{mesh},{mesh}"))).expect("a file");
    let mut sink = Meddled { inner: Collector::new(), at_triangles: true, act: None };
    sink.act = Some(Box::new(|| act(&buffer)));
    assert_changed(read_file(&document, &ReadOptions::default(), &mut sink), &buffer);
}

#[test]
fn a_picture_that_changes_is_refused() {
    let folder = temporary();
    files(folder.path());
    let picture = folder.path().join("a.png");
    image::RgbImage::new(2, 2).save_with_format(&picture, image::ImageFormat::Png).expect("a picture");
    fs::write(folder.path().join("a.mtl"), "newmtl m\nKd 0 0 0\nmap_Kd a.png\n").expect("a library");
    assert_changed(read(&folder.path().join("a.obj"), || overwrite(&picture)), &picture);
}

#[test]
fn other_changes_do_not_matter() {
    let folder = temporary();
    for path in files(folder.path()).iter().filter(|p| !p.ends_with("a.mtl") && !p.ends_with("a.bin")) {
        let other = folder.path().join("other");
        read(path, || fs::write(other, fs::read(path).expect("the file")).expect("a copy")).expect("a mesh");
    }
}

#[test]
fn a_cancelled_reading_is_cancelled() {
    let folder = temporary();
    let path = &files(folder.path())[0];
    let cancel = Cancel::new();
    let mut sink = Meddled { inner: Collector::with_cancel(cancel.clone()), at_triangles: false, act: None };
    sink.act = Some(Box::new(|| {
        overwrite(path);
        cancel.cancel();
    }));
    assert!(matches!(read_file(path, &ReadOptions::default(), &mut sink), Err(Error::Cancelled)));
}
