//! Readers of mesh files: any bytes are read or refused with a reason, in memory in proportion to the file, and the
//! sink receives only calls that the rules of [`Sink`] allow. A small model that was read can be built and opened.

use super::{builds, files, not_internal, within};
use glam::{DAffine3, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::import::{
    Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, ReadOptions, Sink, UpAxis, read_file,
};
use outcrop::{Error, Result};
use std::path::Path;

/// Bytes that a reader holds whatever the file is: window, batch, tables.
const FIXED: u64 = 4 << 20;
/// Bytes that it holds for each byte of the file. The largest share is that of JSON: `[],` becomes 32 bytes.
const PER_BYTE: u64 = 64;
/// Triangles after which the sink cancels: a few bytes may declare many, by using an accessor again.
const ENOUGH: u64 = 100_000;
/// Largest model, in triangles, that is also built.
const SMALL: u64 = 300;

/// PLY files.
pub fn ply(data: &[u8]) {
    read(&["model.ply"], data, 0);
}

/// OBJ files with their materials and a texture.
pub fn obj(data: &[u8]) {
    read(&["model.obj", "a.mtl", "b.mtl", "a.png"], data, super::images::PICTURE);
}

/// STL files, text and binary.
pub fn stl(data: &[u8]) {
    read(&["model.stl"], data, 0);
}

/// glTF and GLB files with a buffer and a texture.
pub fn gltf(data: &[u8]) {
    read(&["model.gltf", "a.bin", "a.png"], data, super::images::PICTURE);
}

/// Raw soups.
pub fn raw(data: &[u8]) {
    read(&["model.raw"], data, 0);
}

/// Reads the first of the files in `data`. `more`: bytes that may be held in addition.
pub fn read(names: &[&str], data: &[u8], more: u64) {
    let path = files::write(names, data);
    let mut checker = Checker::default();
    let bytes = FIXED + PER_BYTE * data.len() as u64 + more;
    match within(bytes, || read_file(&path, &ReadOptions::default(), &mut checker)) {
        Ok(()) => {}
        Err(Error::Cancelled) if checker.cancel.is_cancelled() => return,
        Err(error @ (Error::Parse { .. } | Error::Io { .. } | Error::NoMemory { .. })) => {
            return names_a_file(&error, names);
        }
        Err(other) => panic!("{other:?}"),
    }
    if checker.triangles <= SMALL && checker.parts <= SMALL as u32 && checker.placed() <= SMALL {
        builds::file(&path);
    }
}

/// Panics if the message names neither one of the files nor one that does not exist: a file may refer to that.
fn names_a_file(error: &Error, names: &[&str]) {
    not_internal(error);
    let (Error::Parse { file, .. } | Error::Io { path: file, .. }) = error else { return };
    let is_ours = |file: &Path| file.parent().is_some_and(|folder| files::path("").starts_with(folder));
    assert!(names.iter().any(|name| file.ends_with(name)) || !is_ours(file) || !file.exists(), "{error}");
}

/// Panics if a call breaks a rule of [`Sink`].
#[derive(Default)]
struct Checker {
    parts: u32,
    materials: u32,
    /// Local parts and triangles of each shared mesh.
    meshes: Vec<(u32, u64)>,
    triangles: u64,
    /// Triangles of all instances.
    instanced: u64,
    at: u64,
    cancel: Cancel,
}

impl Checker {
    fn placed(&self) -> u64 {
        self.triangles.saturating_add(self.instanced)
    }

    fn local_parts(&self, mesh: MeshKey) -> u32 {
        assert!(mesh != MeshKey::DIRECT, "not a shared mesh");
        self.meshes[mesh.0 as usize - 1].0
    }
}

impl Sink for Checker {
    fn units(&mut self, _: Option<f64>, _: UpAxis) {}

    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        let MaterialDesc { colour: [r, g, b], opacity, metalness, roughness } = material;
        let numbers = [r, g, b, opacity, metalness, roughness];
        assert!(numbers.iter().all(|x| !x.is_nan()), "{material:?}");
        self.materials += 1;
        Ok(self.materials - 1)
    }

    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        assert!(part.parent.is_none_or(|parent| parent < self.parts), "{part:?}");
        assert!(part.material.is_none_or(|material| material < self.materials), "{part:?}");
        self.parts += 1;
        Ok(self.parts - 1)
    }

    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey> {
        assert!(local_parts > 0 && local_parts < u32::MAX);
        self.meshes.push((local_parts, 0));
        Ok(MeshKey(self.meshes.len() as u32))
    }

    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        let parts = if mesh == MeshKey::DIRECT { self.parts } else { self.local_parts(mesh) };
        assert!(part < parts, "part {part} of {parts}");
        attributes.check(positions.len()).expect("as many values as triangles");
        let mut numbers = attributes.colours.into_iter().flatten().flatten().flatten();
        assert!(numbers.all(|x| !x.is_nan()), "a colour is NaN");
        self.triangles += positions.len() as u64;
        if mesh != MeshKey::DIRECT {
            self.meshes[mesh.0 as usize - 1].1 += positions.len() as u64;
        }
        if self.triangles > ENOUGH {
            self.cancel.cancel();
        }
        self.cancel.check()
    }

    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()> {
        let local = self.local_parts(mesh);
        assert!(u64::from(first_part) + u64::from(local) <= u64::from(self.parts), "parts that do not exist");
        assert!(world_from_mesh.is_finite() && world_from_mesh.matrix3.determinant() != 0.0, "{world_from_mesh:?}");
        self.instanced = self.instanced.saturating_add(self.meshes[mesh.0 as usize - 1].1.max(1));
        if self.instanced > ENOUGH {
            self.cancel.cancel();
        }
        self.cancel.check()
    }

    fn at(&mut self, bytes: u64, total: u64) {
        assert!(bytes <= total, "{bytes} of {total} bytes");
        assert!(bytes >= self.at, "{bytes} bytes after {}", self.at);
        self.at = bytes;
    }

    fn note(&mut self, text: String) {
        assert!(!text.is_empty() && text.len() < 100_000);
    }

    fn cancel(&self) -> &Cancel {
        &self.cancel
    }
}
