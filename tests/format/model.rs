//! The file that the page is compared with.

use crate::common::{nurbs, shapes};
use glam::{DAffine3, DQuat, DVec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder, StandIns, Structure};
use outcrop::import::surfaces::{CageMesh, Dicing, NurbsMesh};
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink, UpAxis};
use outcrop::store::contents::{KINDS, Kind};
use outcrop::store::header::ALIGN;
use outcrop::store::{MemorySource, ModelFile};
use std::sync::{Arc, OnceLock};

pub fn hash(bytes: &[u8]) -> Vec<u8> {
    le!(xxhash_rust::xxh3::xxh3_64(bytes))
}

/// A generator of repeatable numbers (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
    fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

/// Triangles that share no vertices.
fn soup(random: &mut Random, count: usize, size: f64) -> Vec<[DVec3; 3]> {
    let mut triangle = || {
        let p = random.point();
        [p, p + random.point() * size, p + random.point() * size]
    };
    (0..count).map(|_| triangle()).collect()
}

/// A surface of triangles that share vertices, through the middle of the soup.
fn surface(side: usize) -> Vec<[DVec3; 3]> {
    let at = |x: usize, y: usize| {
        let [u, v] = [x, y].map(|i| i as f64 / side as f64 * 2.0 - 1.0);
        DVec3::new(u, v, 0.2 * (5.0 * u).sin() * (4.0 * v).cos())
    };
    let square = |i: usize| {
        let (x, y) = (i % side, i / side);
        [[at(x, y), at(x + 1, y), at(x, y + 1)], [at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]]
    };
    (0..side * side).flat_map(square).collect()
}

/// A model with a tree of many blocks, with parts and colours, and two shared meshes of one block: one of several
/// parts, and one of one part.
fn build(stand_ins: StandIns) -> Vec<u8> {
    let dir = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder");
    let path = dir.path().join("model.oc");
    let options = BuildOptions { threads: 1, stand_ins, proxy_rays: 64, ..BuildOptions::default() };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    builder.units(Some(0.5), UpAxis::Z);
    let steel = MaterialDesc { colour: [0.25, 0.5, 0.75], opacity: 0.5, metalness: 1.0, roughness: 0.125 };
    let steel = builder.material(steel).expect("a material");
    let part = |builder: &mut Builder, id: u64, parent, material| {
        builder.part(PartDesc { id: Some(id), name: format!("Teil Ø{id}"), parent, material }).expect("a part")
    };
    let mut random = Random(1);
    for (id, material) in [(100, None), (101, Some(steel)), (102, None)] {
        let key = part(&mut builder, id, None, material);
        let some = soup(&mut random, 5_000, 0.02);
        let colours = vec![[[id as f32 - 100.0, 0.5, 0.25].map(|c| c / 2.0), [0.5; 3], [0.25; 3]]; some.len()];
        let colours = if material.is_none() { Attributes::colours(&colours) } else { Attributes::NONE };
        builder.triangles(MeshKey::DIRECT, key, &some, colours).expect("triangles");
    }
    builder.triangles(MeshKey::DIRECT, 0, &surface(70), Attributes::NONE).expect("triangles");
    let wrong = [[DVec3::NAN; 3], [DVec3::X; 3], [DVec3::X, DVec3::Y, DVec3::Z * 1e300]];
    builder.triangles(MeshKey::DIRECT, 1, &wrong, Attributes::NONE).expect("triangles");
    for local_parts in [2, 1] {
        let mesh = builder.shared_mesh(local_parts).expect("a mesh");
        for local in 0..local_parts {
            builder.triangles(mesh, local, &soup(&mut random, 9, 1.0), Attributes::NONE).expect("triangles");
        }
        let first = part(&mut builder, 200 + u64::from(local_parts), Some(0), None);
        for local in 1..local_parts {
            part(&mut builder, 300 + u64::from(local), Some(first), None);
        }
        let place = DAffine3::from_scale_rotation_translation(DVec3::ONE * 2.0, DQuat::IDENTITY, DVec3::X * 4.0);
        builder.instance(mesh, place, first).expect("an instance");
    }
    builder.finish(&path).expect("a build");
    std::fs::read(&path).expect("a file")
}

pub fn model() -> (&'static [u8], ModelFile) {
    static MODEL: OnceLock<Vec<u8>> = OnceLock::new();
    opened(MODEL.get_or_init(|| build(StandIns::Voxels)))
}

/// The same model with proxies: its stand-ins have no samples of sides.
pub fn with_proxies() -> (&'static [u8], ModelFile) {
    static MODEL: OnceLock<Vec<u8>> = OnceLock::new();
    opened(MODEL.get_or_init(|| build(StandIns::Proxies)))
}

/// A model of surfaces: trees of structure `patch`, one of them of several fine blocks.
pub fn patches() -> (&'static [u8], ModelFile) {
    static MODEL: OnceLock<Vec<u8>> = OnceLock::new();
    opened(MODEL.get_or_init(|| {
        let dir = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder");
        let path = dir.path().join("model.oc");
        let (structure, dicing) = (Structure::Patch, Some(Dicing::Level(5)));
        let options = BuildOptions { threads: 1, structure, dicing, ..BuildOptions::default() };
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
        for name in ["cube_creases", "spike"] {
            let shape = shapes::own().into_iter().find(|shape| shape.name == name).expect("a shape");
            let parts: Vec<u32> =
                shape.sizes.iter().map(|_| builder.part(PartDesc::default()).expect("a part")).collect();
            let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &parts, displacement: None };
            builder.cage(MeshKey::DIRECT, &mesh).expect("a surface");
        }
        let torus = nurbs::torus();
        let part = builder.part(PartDesc::default()).expect("a part");
        let mesh = NurbsMesh { desc: torus.desc(), is_reversed: true, domain: None, extent: 0.0, part };
        builder.nurbs(MeshKey::DIRECT, &mesh).expect("a surface");
        builder.finish(&path).expect("a build");
        std::fs::read(&path).expect("a file")
    }))
}

fn opened(bytes: &'static [u8]) -> (&'static [u8], ModelFile) {
    (bytes, ModelFile::open(Arc::new(MemorySource::new(bytes.to_vec()))).expect("a model"))
}

/// Where the list of parts of each geometry block ends, as the page describes the lists.
pub fn ends_of_sets(file: &ModelFile) -> Vec<usize> {
    let sets = file.part_sets().expect("sets");
    let mut end = 0;
    let ends = (0..sets.len()).map(|block| {
        let mut least = 0;
        for part in sets.of(block) {
            // A varint has 7 bits in each byte.
            let difference = part - least;
            end += (1..).find(|bytes| u64::from(difference) < 1 << (7 * bytes)).expect("a length");
            least = part + 1;
        }
        end
    });
    ends.collect()
}

/// Offsets of all sections.
pub fn sections(file: &ModelFile) -> [(Kind, usize, usize, u64); KINDS.len()] {
    let names: usize = file.parts().iter().map(|part| part.name.len()).sum();
    let counts = [
        file.directory().len(),
        file.parts().len(),
        file.materials().len(),
        file.instances().len(),
        file.trees().len(),
        ends_of_sets(file).len(),
        file.proxies().len(),
    ];
    let lists = ends_of_sets(file).last().copied().unwrap_or(0);
    let mut end = file.directory().last().expect("a block").end();
    std::array::from_fn(|i| {
        let kind = KINDS[i];
        let behind = match kind {
            Kind::Parts => names,
            Kind::PartSets => lists,
            Kind::Proxies => 10 * file.proxies().runs().count(),
            _ => 0,
        };
        let len = counts[i] * kind.row_len() + behind;
        let offset = end.next_multiple_of(ALIGN);
        end = offset + len as u64;
        (kind, offset as usize, len, counts[i] as u64)
    })
}
