//! Scenes of many placed trees as peers take them (meshes and placements), and flattened: the same triangles as one
//! mesh.

use crate::failure::Outcome;
use crate::scenes::Mesh;
use glam::{DAffine3, DVec3};
use outcrop::import::collect::{CollectedTriangle, Collector};
use outcrop::import::{Attributes, MeshKey, Sink};
use std::sync::Arc;

/// Triangles handed to a sink at once.
const BATCH: usize = 1 << 12;

/// Meshes, and where they are placed.
#[derive(Debug, Default)]
pub struct Placed {
    /// Each in its own coordinates.
    pub meshes: Vec<Arc<Mesh>>,
    pub places: Vec<Place>,
}

/// A placement of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Index in [`Placed::meshes`].
    pub mesh: usize,
    pub world_from_mesh: DAffine3,
}

impl Placed {
    /// The meshes of an input that is placed at each of `models`.
    pub fn of(input: &Collector, models: &[DAffine3]) -> Self {
        let triangles = |t: &CollectedTriangle| (t.part, t.positions);
        let meshes = input.meshes.iter().map(|mesh| Arc::new(Mesh::of(mesh.triangles.iter().map(triangles)))).collect();
        let placed = models.iter().flat_map(|&model| placements(input, model));
        let places = placed.map(|(mesh, world_from_mesh, _)| Place { mesh, world_from_mesh }).collect();
        Self { meshes, places }
    }

    /// Bytes of vertices and indices, of each mesh once.
    pub fn bytes(&self) -> u64 {
        self.meshes.iter().map(|mesh| mesh.bytes()).sum()
    }

    /// Triangles of all placements.
    pub fn triangles(&self) -> usize {
        self.places.iter().map(|place| self.meshes[place.mesh].triangles.len()).sum()
    }
}

/// The placed meshes of a model: index, transform and first part. The triangles that are placed directly come first, as
/// mesh 0.
fn placements(input: &Collector, model: DAffine3) -> impl Iterator<Item = (usize, DAffine3, u32)> {
    let direct = (!input.direct().is_empty()).then_some((0, model, 0));
    let shared = input.instances.iter().map(move |i| (i.mesh.0 as usize, model * i.world_from_mesh, i.first_part));
    direct.into_iter().chain(shared)
}

/// Sends all triangles, each where it is seen, as triangles that are placed directly. Materials and parts stay; colours
/// of triangles, which no ray asks for here, are left out.
pub fn flatten(input: &Collector, models: &[DAffine3], sink: &mut dyn Sink) -> Outcome {
    sink.units(input.metres_per_unit, input.up);
    for material in &input.materials {
        sink.material(*material)?;
    }
    for part in &input.parts {
        sink.part(part.clone())?;
    }
    let mut batch: Vec<[DVec3; 3]> = Vec::with_capacity(BATCH);
    for &model in models {
        for (mesh, world_from_mesh, first_part) in placements(input, model) {
            for run in input.meshes[mesh].triangles.chunk_by(|a, b| a.part == b.part) {
                for some in run.chunks(BATCH) {
                    batch.clear();
                    batch.extend(
                        some.iter()
                            .map(|t: &CollectedTriangle| t.positions.map(|p| world_from_mesh.transform_point3(p))),
                    );
                    sink.triangles(MeshKey::DIRECT, first_part + run[0].part, &batch, Attributes::NONE)?;
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use outcrop::import::PartDesc;

    #[test]
    fn a_flattened_input_has_the_same_triangles_with_the_same_parts() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let mut input = Collector::new();
        for _ in 0..4 {
            input.part(PartDesc::default()).expect("a part");
        }
        let mesh = input.shared_mesh(2).expect("a mesh");
        input.triangles(mesh, 0, &[triangle], Attributes::NONE).expect("triangles");
        input.triangles(mesh, 1, &[triangle, triangle], Attributes::NONE).expect("triangles");
        input.triangles(MeshKey::DIRECT, 0, &[triangle], Attributes::NONE).expect("triangles");
        let up = DAffine3::from_translation(DVec3::Z);
        input.instance(mesh, up, 2).expect("an instance");
        let models = [DAffine3::IDENTITY, DAffine3::from_translation(10.0 * DVec3::Z)];
        let mut flat = Collector::new();
        flatten(&input, &models, &mut flat).expect("flattened");
        let got: Vec<(u32, f64)> = flat.direct().iter().map(|t| (t.part, t.positions[0].z)).collect();
        assert_eq!(got, [(0, 0.0), (2, 1.0), (3, 1.0), (3, 1.0), (0, 10.0), (2, 11.0), (3, 11.0), (3, 11.0)]);
        let placed = Placed::of(&input, &models);
        assert_eq!((placed.triangles(), placed.meshes.len(), placed.places.len()), (8, 2, 4));
        assert_eq!(placed.places[3], Place { mesh: 1, world_from_mesh: models[1] * up });
    }
}
