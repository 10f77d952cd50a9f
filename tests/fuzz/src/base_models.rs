//! Model files that targets damage, or serve badly: built once a thread, always the same.

use super::builds::options;
use super::files;
use super::rng::Rng;
use glam::{DAffine3, DVec3, Vec3};
use outcrop::base::ids::BlockId;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::Builder;
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink};
use outcrop::store::{Header, InstanceRow, MaterialRow, MemorySource, ModelFile, PartRow, TreeRow};
use std::sync::{Arc, OnceLock};

/// The name of all models, in messages.
pub const NAME: &str = "model.oc";

/// Number of base models: one block a tree with colours, normals and shared meshes; several blocks with normals; one
/// triangle.
pub const COUNT: usize = 3;

/// The bytes of a base model.
pub fn bytes(index: usize) -> &'static [u8] {
    static MODELS: [OnceLock<Vec<u8>>; COUNT] = [const { OnceLock::new() }; COUNT];
    MODELS[index].get_or_init(|| match index {
        0 => built(60, true),
        1 => built(4000, false),
        _ => built(1, false),
    })
}

/// `count` triangles in coloured parts, and a shared mesh of nine placed twice; or only the triangles.
fn built(count: usize, with_more: bool) -> Vec<u8> {
    let mut rng = Rng::new(count as u64);
    let size = 2.0 / (count as f64).sqrt();
    let mut triangles = |count: usize, size: f64| -> Vec<[DVec3; 3]> {
        let mut triangle = || {
            let p = rng.inside(DVec3::NEG_ONE, DVec3::ONE);
            [p, p + rng.direction() * size, p + rng.direction() * size]
        };
        (0..count).map(|_| triangle()).collect()
    };
    let mut builder = Builder::new(options(), Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    let material = builder.material(MaterialDesc { opacity: 0.5, ..MaterialDesc::default() }).expect("a material");
    let part = |builder: &mut Builder, id: u64, material| {
        let desc = PartDesc { id: Some(id), name: format!("part {id}"), parent: None, material };
        builder.part(desc).expect("a part")
    };
    let parts = if with_more { 3 } else { 1 };
    for id in 0..parts {
        let key = part(&mut builder, 100 + id, (id == 1).then_some(material));
        let some = triangles(count / parts as usize, size);
        let colours = vec![[[id as f32 / 2.0, 0.5, 0.25], [0.5; 3], [0.5; 3]]; some.len()];
        let normals: Vec<[Vec3; 3]> = some.iter().map(|t| t.map(|corner| corner.as_vec3())).collect();
        let colours = with_more.then_some(&colours[..]);
        let values = Attributes { colours, normals: (count > 1).then_some(&normals[..]) };
        builder.triangles(MeshKey::DIRECT, key, &some, values).expect("triangles");
    }
    if with_more {
        let mesh = builder.shared_mesh(2).expect("a mesh");
        builder.triangles(mesh, 0, &triangles(4, 1.0), Attributes::NONE).expect("triangles");
        builder.triangles(mesh, 1, &triangles(5, 1.0), Attributes::NONE).expect("triangles");
        for i in 0..2 {
            let first = part(&mut builder, 200 + 10 * i, None);
            part(&mut builder, 201 + 10 * i, None);
            let at = DAffine3::from_translation(DVec3::X * (2.0 + 2.0 * i as f64));
            builder.instance(mesh, at, first).expect("an instance");
        }
    }
    let path = files::path("base.oc");
    builder.finish(&path).expect("a base model");
    std::fs::read(&path).expect("a base model")
}

/// All of a model file, to be written again with something changed.
#[derive(Clone)]
pub struct Content {
    pub header: Header,
    /// Payload and bytes of the trace form.
    pub blocks: Vec<(Vec<u8>, u32)>,
    pub parts: Vec<PartRow>,
    pub materials: Vec<MaterialRow>,
    pub instances: Vec<InstanceRow>,
    pub trees: Vec<TreeRow>,
    /// The parts of each geometry block.
    pub part_sets: Vec<Vec<u32>>,
}

impl Content {
    /// The content of a base model.
    pub fn of(index: usize) -> Self {
        let file = ModelFile::open(Arc::new(MemorySource::named(NAME, bytes(index)))).expect("a model");
        let (mut scratch, mut payload) = (Vec::new(), Vec::new());
        let mut block = |id| {
            file.read_block(id, &mut scratch, &mut payload).expect("a block");
            (payload.clone(), file.decoded_len(id))
        };
        let sets = file.part_sets().expect("sets of parts");
        Self {
            part_sets: (0..sets.len()).map(|block| sets.of(block).collect()).collect(),
            header: *file.header(),
            blocks: (0..file.block_count()).map(|id| block(BlockId(id))).collect(),
            parts: file.parts().iter().map(|part| part.to_row()).collect(),
            materials: file.materials().to_vec(),
            instances: file.instances().to_vec(),
            trees: file.trees().to_vec(),
        }
    }
}
