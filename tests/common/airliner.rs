//! The generated airliner, whole or a slice across it, with its materials, and views in its own frame.

use super::changed::{self, Change};
use glam::{DAffine3, DMat3, DVec3};
use outcrop::base::error::Result;
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::GenerateOptions;
use outcrop::import::{Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, Sink};
use outcrop::scene::Camera;
use std::ops::Range;
use std::path::Path;

/// Builds the airliner of a number of triangles; of a slice, what lies in a range of x of its own frame, which runs
/// from nose to tail in metres.
pub fn build(path: &Path, triangles: u64, slice: Option<Range<f64>>) {
    let (size, options) = (
        GenerateOptions { triangles, seed: 0, ..Default::default() },
        BuildOptions { threads: 2, ..Default::default() },
    );
    let by = Slice { range: slice, own_from_world: attitude().inverse(), materials: Vec::new() };
    changed::build(path, "airliner", &size, options, by);
}

/// From the airliner's frame to the world, as its generator has it: banked, climbing, turned, its middle at zero.
fn attitude() -> DAffine3 {
    let turn = DMat3::from_rotation_z(37f64.to_radians())
        * DMat3::from_rotation_y(8f64.to_radians())
        * DMat3::from_rotation_x(11f64.to_radians());
    DAffine3::from_mat3_translation(turn, turn * DVec3::new(-0.5 * 63.7, 0.0, 0.0))
}

/// A view of a point from a direction, both in the airliner's frame: y to its right, z up.
pub fn view(at: [f64; 3], from: [f64; 3], distance: f64, fov_y_degrees: f64) -> Camera {
    let at = DVec3::from(at);
    let eye = at + DVec3::from(from).normalize() * distance;
    let [eye, at] = [eye, at].map(|point| attitude().transform_point3(point));
    Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees }
}

struct Slice {
    range: Option<Range<f64>>,
    own_from_world: DAffine3,
    /// Of the builder, whose first material is not the model's: the generator takes it that keys count from 0.
    materials: Vec<MaterialKey>,
}

impl Change for Slice {
    fn material(&mut self, to: &mut Builder, material: MaterialDesc) -> Result<MaterialKey> {
        self.materials.push(to.material(material)?);
        Ok(self.materials.len() as MaterialKey - 1)
    }

    fn part(&mut self, to: &mut Builder, part: PartDesc) -> Result<PartKey> {
        let material = part.material.map(|key| self.materials[key as usize]);
        to.part(PartDesc { material, ..part })
    }

    fn triangles(
        &mut self,
        to: &mut Builder,
        (mesh, part): (MeshKey, u32),
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        let Some(range) = &self.range else { return to.triangles(mesh, part, positions, attributes) };
        let is_inside = |tri: &[DVec3; 3]| {
            let middle = tri.iter().sum::<DVec3>() / 3.0;
            range.contains(&self.own_from_world.transform_point3(middle).x)
        };
        let inside: Vec<[DVec3; 3]> = positions.iter().copied().filter(is_inside).collect();
        to.triangles(mesh, part, &inside, Attributes::NONE)
    }
}
