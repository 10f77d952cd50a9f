//! `airliner`: the generator of that name with `triangles` triangles as CAD exports it: each part with triangles is a
//! shared mesh in a frame of its own, placed once.

use crate::data::SceneRow;
use crate::failure::Outcome;
use glam::{DAffine3, DMat3, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::import::collect::{CollectedTriangle, Collector};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::import::{Attributes, Sink};
use std::collections::BTreeMap;

pub fn fill(row: &SceneRow, sink: &mut dyn Sink) -> Outcome {
    let options = GenerateOptions { triangles: row.triangles, seed: row.seed, ..Default::default() };
    let mut whole = Collector::new();
    generate("airliner", &options, &Cancel::new(), &mut whole)?;
    sink.units(whole.metres_per_unit, whole.up);
    for material in &whole.materials {
        sink.material(*material)?;
    }
    for part in &whole.parts {
        sink.part(part.clone())?;
    }
    let mut parts: BTreeMap<u32, Vec<&CollectedTriangle>> = BTreeMap::new();
    for triangle in whole.direct() {
        parts.entry(triangle.part).or_default().push(triangle);
    }
    for (part, triangles) in parts {
        let world_from_part = frame(&triangles);
        let part_from_world = world_from_part.inverse();
        let own: Vec<[DVec3; 3]> =
            triangles.iter().map(|t| t.positions.map(|p| part_from_world.transform_point3(p))).collect();
        let mesh = sink.shared_mesh(1)?;
        sink.triangles(mesh, 0, &own, Attributes::NONE)?;
        sink.instance(mesh, world_from_part, part)?;
    }
    Ok(())
}

/// The frame of a part: turned as the airliner flies (the generator's text: heading 37 degrees, climbing by 8, banked
/// by 11), so that parts lie along its axes as they do in CAD; the origin is in the middle of the part's box.
fn frame(triangles: &[&CollectedTriangle]) -> DAffine3 {
    let turn = DMat3::from_rotation_z(37f64.to_radians())
        * DMat3::from_rotation_y(8f64.to_radians())
        * DMat3::from_rotation_x(11f64.to_radians());
    let corners = || triangles.iter().flat_map(|t| t.positions);
    let (low, high) =
        corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    DAffine3::from_mat3_translation(turn, 0.5 * (low + high))
}
