//! What a built file stores, read through the public API: every tree's triangles around its origin, by primitive, and
//! those of a scene's instances in world space.

use super::brute::{Ray64, Tri};
use super::errors::Answer;
use super::rays::Ray32;
use glam::{DAffine3, DVec3, Vec3};
use outcrop::base::ids::BlockId;
use outcrop::base::progress::Cancel;
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind};
use outcrop::residency::{ModelBlocks, Residency};
use outcrop::simd::Isa;
use outcrop::store::{FileSource, ModelFile};
use outcrop::structure::{Visit, for_each_triangle, open};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// A tree's triangles.
pub struct StoredTree {
    /// What corners are relative to, in mesh coordinates.
    pub origin: DVec3,
    /// Greatest distance between an input's corner and the stored one.
    pub position_error: f64,
    /// Primitive, local part and corners around the origin, by primitive.
    pub tris: Vec<(u32, u32, Tri)>,
}

impl StoredTree {
    /// The corners alone: what an oracle takes.
    pub fn corners(&self) -> Vec<Tri> {
        self.tris.iter().map(|t| t.2).collect()
    }

    /// Index of a primitive in `tris`.
    pub fn index_of(&self, prim: u64) -> Option<u32> {
        self.tris.binary_search_by_key(&prim, |t| u64::from(t.0)).ok().map(|i| i as u32)
    }

    /// A ray of this frame in the mesh's coordinates, and the same ray, exactly, as this frame has it: the sum far
    /// from zero rounds, the difference back does not.
    pub fn place(&self, ray: &Ray32) -> (Ray, Ray64) {
        let world = Ray {
            origin: self.origin + ray.org.as_dvec3(),
            dir: ray.dir,
            t_min: f64::from(ray.t_min),
            t_max: f64::from(ray.t_max),
            cone: Cone::ZERO,
            mask: u32::MAX,
        };
        (world, Ray64 { org: world.origin - self.origin, ..ray.wide() })
    }

    /// What the oracle's judge takes of a hit of the file's directly placed triangles. `part` gives the id of a local
    /// part.
    pub fn answer(&self, hit: &Hit, part: impl Fn(u32) -> u64) -> Option<Answer> {
        if hit.kind == HitKind::Miss {
            return None;
        }
        let index = self.index_of(hit.prim).unwrap_or(u32::MAX);
        let part_right = self.tris.get(index as usize).is_some_and(|t| part(t.1) == hit.part);
        Some(Answer {
            t: hit.t,
            prim: index,
            // Of the stored triangles, not of the input's.
            stated: Some(f64::from(hit.error) - self.position_error),
            normal: Some(hit.normal.as_dvec3()),
            part_right,
            refined: true,
        })
    }
}

/// Reads all trees of the file at `path`.
pub fn trees(path: &Path) -> Vec<StoredTree> {
    let file = Arc::new(ModelFile::open(Arc::new(FileSource::open(path).expect("a file"))).expect("a model"));
    let opened = open::open(&file).expect("trees");
    let residency = Residency::with_budget(u64::MAX);
    let blocks = ModelBlocks::new(Arc::clone(&file), opened.decoder, &residency).expect("any budget");
    let all: Vec<BlockId> = (0..file.block_count()).map(BlockId).collect();
    blocks.fetch(&all, &Cancel::new()).expect("all blocks");
    let snapshot = blocks.snapshot();
    let read = |(row, tree): (&outcrop::store::TreeRow, &open::StoredTree)| {
        let view = tree.view(&snapshot, Isa::Baseline, Visit { stamp: 1, ..Visit::default() });
        let mut tris = BTreeMap::new();
        let visited = for_each_triangle(&view, &mut |hit, triangle| {
            let prim = view.prim(hit).expect("all blocks are here").expect("an id");
            let here = (triangle.part, triangle.vertices.map(Vec3::as_dvec3));
            let before = tris.insert(prim, here);
            assert!(before.is_none_or(|b| b == here), "{prim} is stored in two ways");
        });
        visited.expect("all blocks are here");
        // Triangles around details of their own tree are in two trees, and counted once.
        assert!(tris.len() as u64 >= row.triangles, "{} triangles stored, {} counted", tris.len(), row.triangles);
        let tris = tris.into_iter().map(|(prim, (part, corners))| (prim, part, corners)).collect();
        StoredTree { origin: DVec3::from(row.origin), position_error: row.position_error, tris }
    };
    let trees: Vec<StoredTree> = file.trees().iter().zip(&opened.trees).map(read).collect();
    let prims: BTreeSet<u32> = trees.iter().flat_map(|tree| &tree.tris).map(|tri| tri.0).collect();
    let counted: u64 = file.trees().iter().map(|row| row.triangles).sum();
    assert_eq!(prims.len() as u64, counted, "triangles stored in any tree, and counted in one");
    trees
}

/// A model in a scene: its file, the caller's id of the instance, where it is.
pub struct Instance<'a> {
    pub path: &'a Path,
    pub id: u64,
    pub world_from_model: DAffine3,
}

/// A scene's triangles in world space, as an oracle takes them.
#[derive(Default)]
pub struct World {
    pub tris: Vec<Tri>,
    /// Whose each is.
    pub names: Vec<Name>,
}

/// What a hit says of a triangle, and its part's material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Name {
    pub instance: u64,
    pub part: u64,
    pub prim: u64,
    /// Linear red, green, blue.
    pub colour: [f32; 3],
}

/// The triangles of all instances, in the order in which these are added: of each the directly placed ones, then those
/// of its model's own instances of shared meshes.
pub fn world(instances: &[Instance]) -> World {
    let mut out = World::default();
    for instance in instances {
        let file = ModelFile::open_path(instance.path).expect("a model");
        let trees = trees(instance.path);
        let mut place = |tree: u32, first_part: u32, world_from_mesh: DAffine3| {
            let tree = &trees[tree as usize];
            for (prim, part, corners) in &tree.tris {
                let part = file.parts().get((first_part + part) as usize).expect("a part");
                let colour = file.materials()[part.material as usize].colour;
                out.tris.push(corners.map(|corner| world_from_mesh.transform_point3(tree.origin + corner)));
                out.names.push(Name { instance: instance.id, part: part.id, prim: u64::from(*prim), colour });
            }
        };
        if !trees.is_empty() {
            place(0, 0, instance.world_from_model);
        }
        for row in file.instances() {
            let model_from_mesh = DAffine3::from_cols_array(&row.world_from_mesh);
            place(row.tree, row.first_part, instance.world_from_model * model_from_mesh);
        }
    }
    out
}
