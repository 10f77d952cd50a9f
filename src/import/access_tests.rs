use super::*;
use crate::import::collect::Collector;
use crate::import::read_file;
use crate::import::testing::temporary;
use std::fs;
use std::sync::Mutex;
use tempfile::TempDir;

/// A glTF document with one triangle, whose buffer has this URI.
fn gltf(uri: &str) -> String {
    let document = serde_json::json!({
        "asset": { "version": "2.0" }, "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }], "buffers": [{ "byteLength": 36, "uri": uri }],
    });
    document.to_string()
}

fn corners() -> Vec<u8> {
    [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect()
}

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 0.5\nusemtl m\nf 1/1 2/1 3/1\n";
const RED: [f32; 3] = [1.0, 0.0, 0.0];

fn red_png() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0]));
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("a picture");
    bytes.into_inner()
}

/// A folder with a folder `models`, and files outside of the latter.
fn folders() -> TempDir {
    let all = temporary();
    fs::create_dir_all(all.path().join("models/sub")).expect("folders");
    for place in ["secret", "models/inside", "models/sub/below"] {
        fs::write(all.path().join(format!("{place}.bin")), corners()).expect("a buffer");
        fs::write(all.path().join(format!("{place}.mtl")), "newmtl m\nKd 1 0 0\n").expect("a library");
        fs::write(all.path().join(format!("{place}.png")), red_png()).expect("a picture");
    }
    all
}

fn read(all: &TempDir, name: &str, text: &str, access: Access) -> Result<Collector> {
    let (path, mut sink) = (all.path().join("models").join(name), Collector::new());
    fs::write(&path, text).expect("a file");
    read_file(&path, &ReadOptions { access, ..Default::default() }, &mut sink)?;
    Ok(sink)
}

/// Names of the file `secret` with an ending, which lead out of the folder of the models.
fn ways_out(all: &TempDir, ending: &str) -> Vec<String> {
    let mut ways =
        vec![format!("../secret.{ending}"), format!("sub/../../secret.{ending}"), format!("..\\secret.{ending}")];
    ways.push(all.path().join(format!("secret.{ending}")).display().to_string());
    #[cfg(unix)]
    {
        use std::os::unix::fs::symlink;
        let models = all.path().join("models");
        symlink(all.path().join(format!("secret.{ending}")), models.join(format!("link.{ending}"))).expect("a link");
        let _ = symlink("..", models.join("up"));
        ways.extend([format!("link.{ending}"), format!("up/secret.{ending}")]);
    }
    ways
}

#[test]
fn buffers_outside_of_the_folder_are_refused_by_name() {
    let all = folders();
    let mut ways = ways_out(&all, "bin");
    ways.extend(["%2e%2e/secret.bin", "..%2fsecret.bin", "%2E%2E%5Csecret.bin", "../missing.bin"].map(String::from));
    for uri in ways {
        let error = read(&all, "a.gltf", &gltf(&uri), Access::default()).expect_err(&uri).to_string();
        let is_absolute = uri.starts_with('/');
        let why = if is_absolute { "not a path relative to the document" } else { "is outside of the folder" };
        let shown = format!("{uri:?}");
        assert!(error.contains("a.gltf") && error.contains(&shown) && error.contains(why), "{uri}: {error}");
        if uri.contains("missing") {
            continue;
        }
        let any = Access { any: true, ..Default::default() };
        let folder = Access { folders: vec![all.path().into()], ..Default::default() };
        for access in [any, folder] {
            assert_eq!(read(&all, "a.gltf", &gltf(&uri), access).expect(&uri).received, 1);
        }
        let other =
            Access { folders: vec![all.path().join("models/sub"), "/none/at/all".into()], ..Default::default() };
        assert!(read(&all, "a.gltf", &gltf(&uri), other).is_err(), "{uri}");
    }
    for uri in ["inside.bin", "sub/below.bin", "sub/../inside.bin", "./inside.bin", "sub\\below.bin", "%69nside.bin"] {
        assert_eq!(read(&all, "a.gltf", &gltf(uri), Access::default()).expect(uri).received, 1);
    }
}

#[test]
fn libraries_and_textures_outside_of_the_folder_are_skipped_and_noted() {
    let all = folders();
    for name in ways_out(&all, "mtl") {
        let obj = format!("mtllib {name}\n{OBJ}");
        let sink = read(&all, "a.obj", &obj, Access::default()).expect(&name);
        assert!(sink.received == 1 && sink.materials.is_empty(), "{name}");
        assert!(sink.notes[0].contains("is outside of the folder of the file"), "{name}: {:?}", sink.notes);
        let sink = read(&all, "a.obj", &obj, Access { any: true, ..Default::default() }).expect(&name);
        assert_eq!((sink.materials[0].colour, sink.notes.len()), (RED, 0), "{name}: {:?}", sink.notes);
    }
    for name in ways_out(&all, "png") {
        fs::write(all.path().join("models/a.mtl"), format!("newmtl m\nmap_Kd {name}\n")).expect("a library");
        let obj = format!("mtllib a.mtl\n{OBJ}");
        let sink = read(&all, "a.obj", &obj, Access::default()).expect(&name);
        assert!(sink.received == 1 && sink.direct()[0].colour().is_none(), "{name}");
        assert!(sink.notes[0].contains("1 textures were left out"), "{name}: {:?}", sink.notes);
        let sink = read(&all, "a.obj", &obj, Access { folders: vec![all.path().into()], ..Default::default() });
        assert_eq!(sink.expect(&name).direct()[0].colour(), Some(RED), "{name}");
    }
    // A name that leads out is still found by its last part in the folder, as names of other systems are.
    fs::write(all.path().join("models/secret.png"), red_png()).expect("a picture");
    fs::write(all.path().join("models/a.mtl"), "newmtl m\nmap_Kd ..\\..\\Textures\\SECRET.png\n").expect("a library");
    let sink = read(&all, "a.obj", &format!("mtllib a.mtl\n{OBJ}"), Access::default()).expect("a mesh");
    assert_eq!(sink.direct()[0].colour(), Some(RED), "{:?}", sink.notes);
}

/// Names of nothing that may be read, some of which would never end or block: a pipe, devices, folders, links in a
/// circle, roots and schemes of other systems, names that are decoded once only.
#[cfg(target_os = "linux")]
fn no_files(all: &TempDir) -> Vec<String> {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use std::os::unix::fs::symlink;
    let models = all.path().join("models");
    mknodat(CWD, models.join("pipe"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
    fs::create_dir(models.join("folder")).expect("a folder");
    for (link, to) in [("zeros", "/dev/zero"), ("circle", "circle"), ("to-pipe", "pipe"), ("to-folder", ".")] {
        symlink(to, models.join(link)).expect("a link");
    }
    let inside = models.join("inside.bin").display().to_string();
    let mut names: Vec<String> =
        ["pipe", "to-pipe", "zeros", "circle", "folder", "to-folder", ".", "..", "/", "/dev/zero"]
            .into_iter()
            .chain(["sub/", "inside.bin/", "inside.bin/.", "missing/../inside.bin", "inside.bin/../inside.bin"])
            .chain(["C:\\inside.bin", "C:/inside.bin", "c:inside.bin", "\\\\host\\inside.bin", "\\\\?\\C:\\inside.bin"])
            .chain([
                "file:inside.bin",
                "file://inside.bin",
                "https://host/inside.bin",
                "~/inside.bin",
                "$HOME/inside.bin",
            ])
            .chain([
                "%252e%252e/secret.bin",
                "sub%252f..%252f..%252fsecret.bin",
                "..%c0%afsecret.bin",
                "%c0%ae%c0%ae/secret.bin",
            ])
            .map(String::from)
            .collect();
    names.extend([format!("file://{inside}"), "n".repeat(5000), "sub/".repeat(3000) + "x", format!("{inside}/x")]);
    names
}

#[cfg(target_os = "linux")]
#[test]
fn names_of_what_is_no_file_are_refused_at_once() {
    let all = folders();
    let names = no_files(&all);
    let any = Access { any: true, ..Default::default() };
    let coded = ["%00", "inside.bin%00", "inside%00.bin", "%00/../inside.bin", "..%00/secret.bin", "%2fdev%2fzero", ""];
    for name in names.iter().map(String::as_str).chain(coded) {
        for access in [Access::default(), any.clone()] {
            let error = read(&all, "a.gltf", &gltf(name), access).expect_err(name);
            assert!(matches!(error, Error::Parse { .. } | Error::Io { .. }), "{name}: {error}");
        }
    }
    for name in &names {
        // A name that leads elsewhere may be that of a file in the folder: it is found by its last part.
        let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
        if last == "inside.bin" || last == "secret.bin" {
            continue;
        }
        for access in [Access::default(), any.clone()] {
            let sink = read(&all, "a.obj", &format!("mtllib {name}\n{OBJ}"), access.clone()).expect(name);
            assert!(sink.received == 1 && sink.materials.is_empty() && !sink.notes.is_empty(), "{name}");
            fs::write(all.path().join("models/a.mtl"), format!("newmtl m\nmap_Kd {name}\n")).expect("a library");
            let sink = read(&all, "a.obj", &format!("mtllib a.mtl\n{OBJ}"), access).expect(name);
            assert!(sink.received == 1 && sink.direct()[0].colour().is_none(), "{name}");
            assert!(sink.notes[0].contains("1 textures were left out"), "{name}: {:?}", sink.notes);
        }
    }
    // As the document itself, and as the answer of a host.
    for name in ["pipe", "zeros", "folder", "circle"] {
        let path = all.path().join("models").join(name);
        read_file(&path, &ReadOptions::default(), &mut Collector::new()).expect_err(name);
        let (access, _) = host(move |_| Ok(Resolved::Path(path.clone())));
        read(&all, "a.gltf", &gltf("x"), access).expect_err(name);
    }
}

/// A way out and in again ends in the folder.
#[test]
fn a_name_is_judged_by_where_it_ends() {
    let all = folders();
    for uri in ["../models/inside.bin", "sub/../../models/./sub/below.bin", "..\\models\\inside.bin"] {
        assert_eq!(read(&all, "a.gltf", &gltf(uri), Access::default()).expect(uri).received, 1);
    }
}

#[cfg(unix)]
#[test]
fn links_inside_of_the_folder_and_links_to_the_document_are_followed() {
    use std::os::unix::fs::symlink;
    let all = folders();
    symlink("sub/below.bin", all.path().join("models/link.bin")).expect("a link");
    assert_eq!(read(&all, "a.gltf", &gltf("link.bin"), Access::default()).expect("a link").received, 1);
    // The document is opened by a link in another folder. Its buffer is next to the document.
    fs::write(all.path().join("models/a.gltf"), gltf("inside.bin")).expect("a file");
    fs::create_dir(all.path().join("other")).expect("a folder");
    symlink("../models/a.gltf", all.path().join("other/b.gltf")).expect("a link");
    let mut sink = Collector::new();
    read_file(&all.path().join("other/b.gltf"), &ReadOptions::default(), &mut sink).expect("by a link");
    assert_eq!(sink.received, 1);
}

/// Another program puts a link where a checked file was.
#[cfg(target_os = "linux")]
#[test]
fn a_link_that_comes_after_the_check_is_not_followed() {
    use std::os::unix::fs::symlink;
    let all = folders();
    let models = all.path().join("models").canonicalize().expect("a folder");
    let root = Root::open(&models).expect("a folder");
    assert!(root.open_below(&models.join("sub/below.bin")).is_ok());
    symlink("..", models.join("up")).expect("a link");
    symlink("../secret.bin", models.join("link.bin")).expect("a link");
    for way in ["up/secret.bin", "link.bin", "../secret.bin", "sub/../../secret.bin"] {
        assert!(root.open_below(&models.join(way)).is_err(), "{way}");
    }
    // A folder that is replaced by another is still the one that was checked.
    fs::rename(&models, all.path().join("moved")).expect("renamed");
    symlink("/", &models).expect("a link");
    assert!(root.open_below(&models.join("inside.bin")).is_ok());
    assert!(root.open_below(&models.join("etc/passwd")).is_err());
}

#[test]
fn every_file_that_was_read_is_reported() {
    let all = folders();
    fs::write(all.path().join("models/a.mtl"), "newmtl m\nmap_Kd inside.png\n").expect("a library");
    for (name, text, others) in [
        ("a.gltf", gltf("sub/below.bin"), vec!["sub/below.bin"]),
        ("a.obj", format!("mtllib a.mtl\n{OBJ}"), vec!["a.mtl", "inside.png"]),
    ] {
        let path = all.path().join("models").join(name);
        fs::write(&path, text).expect("a file");
        let options = ReadOptions::default();
        read_file(&path, &options, &mut Collector::new()).expect("a mesh");
        for other in others.into_iter().chain([name]) {
            let file = all.path().join("models").join(other);
            let error = options.inputs.check(&file, &file).expect_err(other).to_string();
            assert!(error.contains(other), "{error}");
        }
        let unread = all.path().join("secret.bin");
        options.inputs.check(&unread, &unread).expect("was not read");
    }
}

type Answers = dyn Fn(&str) -> Result<Resolved> + Send + Sync;

/// A host that answers as the function says, and keeps the questions.
struct Host(Box<Answers>, Mutex<Vec<(String, PathBuf)>>);

impl Resolver for Host {
    fn resolve(&self, name: &[u8], file: &Path) -> Result<Resolved> {
        let name = String::from_utf8_lossy(name).into_owned();
        self.1.lock().expect("questions").push((name.clone(), file.to_path_buf()));
        self.0(&name)
    }
}

fn host(answers: impl Fn(&str) -> Result<Resolved> + Send + Sync + 'static) -> (Access, Arc<Host>) {
    let host = Arc::new(Host(Box::new(answers), Mutex::default()));
    (Access { resolver: Some(host.clone()), ..Default::default() }, host)
}

#[test]
fn a_host_resolves_names_to_bytes_paths_and_refusals() {
    let all = folders();
    let secret = all.path().join("secret.bin");
    let (access, asked) = host(move |name| match name {
        "https://host/a%20b.bin" => Ok(Resolved::Bytes(Box::new(corners()))),
        "elsewhere" => Ok(Resolved::Path(secret.clone())),
        "inside.bin" => Ok(Resolved::Refused),
        "short" => Ok(Resolved::Bytes(Box::new([0u8; 8]))),
        "none" => Ok(Resolved::Path("/none/at/all".into())),
        "broken" => Err(Error::io("broken", "resolving", io::ErrorKind::TimedOut.into())),
        "cancel" => Err(Error::Cancelled),
        _ => Ok(Resolved::Default),
    });
    let gltf = |uri: &str| read(&all, "a.gltf", &gltf(uri), access.clone());
    for uri in ["https://host/a%20b.bin", "elsewhere", "sub/below.bin"] {
        assert_eq!(gltf(uri).expect(uri).received, 1);
    }
    for (uri, words) in [
        ("inside.bin", "was refused by the host"),
        ("short", "has only 8 of the 36 bytes"),
        ("none", "/none/at/all"),
        ("broken", "broken: resolving failed"),
        ("../secret.bin", "is outside"),
        ("cancel", "cancelled"),
    ] {
        let error = gltf(uri).expect_err(uri).to_string();
        assert!(error.contains(words), "{uri}: {error}");
    }
    let questions = asked.1.lock().expect("questions");
    assert_eq!(questions[0], ("https://host/a%20b.bin".into(), all.path().join("models/a.gltf")));
}

#[test]
fn a_host_resolves_libraries_and_textures() {
    let all = folders();
    let (access, asked) = host(move |name| match name {
        "wall of red.mtl" => Ok(Resolved::Bytes(Box::new("newmtl m\nmap_Kd \"my wall.png\" # a wall\n"))),
        "my wall.png" => Ok(Resolved::Bytes(Box::new(red_png()))),
        _ => Ok(Resolved::Refused),
    });
    let sink = read(&all, "a.obj", &format!("mtllib wall of red.mtl\n{OBJ}"), access.clone()).expect("a mesh");
    assert_eq!((sink.direct()[0].colour(), sink.notes.len()), (Some(RED), 0), "{:?}", sink.notes);
    let names: Vec<String> = asked.1.lock().expect("questions").iter().map(|q| q.0.clone()).collect();
    assert_eq!(names, ["wall of red.mtl", "my wall.png"]);
    assert_eq!(asked.1.lock().expect("questions")[1].1, Path::new("wall of red.mtl"));
    // Refused: noted, one library after the other.
    let sink = read(&all, "a.obj", &format!("mtllib inside.mtl sub/below.mtl\n{OBJ}"), access).expect("a mesh");
    assert!(sink.materials.is_empty() && sink.received == 1);
    assert!(sink.notes[1].contains("\"sub/below.mtl\" was refused by the host"), "{:?}", sink.notes);
}
