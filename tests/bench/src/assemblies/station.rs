//! `station`: a pump station of `count` by `count` units as a GLB file, read as users' files are. Each unit is a node
//! that is turned, with nodes below it for a flange, its eight bolts, an elbow and a wheel: four meshes, shared by all
//! units. A plate is placed once.

use super::gltf::{Node, write};
use super::shapes::{self, Shape};
use crate::common::rng::Rng;
use crate::data::SceneRow;
use crate::failure::Outcome;
use crate::scenes;
use glam::{DAffine3, DVec3};
use outcrop::import::{ReadOptions, Sink, read_file};
use std::f64::consts::TAU;

/// Distance of units, metres.
const SPACING: f64 = 12.0;

/// Meshes by their index in the file.
const FLANGE: usize = 0;
const BOLT: usize = 1;
const ELBOW: usize = 2;
const WHEEL: usize = 3;
const PLATE: usize = 4;

pub fn fill(row: &SceneRow, sink: &mut dyn Sink) -> Outcome {
    let folder = scenes::folder().join("gltf");
    std::fs::create_dir_all(&folder)?;
    let path = folder.join(format!("{}.glb", row.name));
    let meshes = meshes(row);
    let bytes = write(&meshes, &[nodes(row)])?;
    if std::fs::read(&path).ok().as_ref() != Some(&bytes) {
        std::fs::write(&path, bytes)?;
    }
    Ok(read_file(&path, &ReadOptions::default(), sink)?)
}

fn meshes(row: &SceneRow) -> Vec<(&'static str, Shape)> {
    let rim = [
        (2.0, 0.0),
        (3.4, 0.0),
        (3.5, 0.1),
        (3.5, 0.5),
        (3.4, 0.6),
        (2.2, 0.6),
        (2.0, 0.8),
        (1.9, 2.4),
        (1.8, 2.5),
        (1.4, 2.5),
    ];
    let flange = shapes::turned(&rim, 48);
    let plate = shapes::plate(SPACING * (row.count + 1) as f64, 48);
    let elbow = shapes::elbow(4.0, 1.3, 32, 32);
    let wheel = shapes::ring(1.8, 0.25, 64, 16);
    vec![("flange", flange), ("bolt", shapes::bolt(528)), ("elbow", elbow), ("wheel", wheel), ("plate", plate)]
}

/// The root: glTF has y up, shapes have z up.
fn nodes(row: &SceneRow) -> Node {
    let mut rng = Rng::new(row.seed);
    let middle = 0.5 * (row.count as f64 - 1.0);
    let unit = |x: usize, y: usize, turn: f64| {
        let at = SPACING * DVec3::new(x as f64 - middle, y as f64 - middle, 0.0);
        let place = DAffine3::from_translation(at) * DAffine3::from_rotation_z(turn);
        let mut below = vec![Node::mesh("flange", DAffine3::IDENTITY, FLANGE)];
        below.extend((0..8).map(|i| {
            let (s, c) = (TAU * f64::from(i) / 8.0).sin_cos();
            let place =
                DAffine3::from_translation(DVec3::new(2.8 * c, 2.8 * s, 0.6)) * DAffine3::from_scale(DVec3::splat(0.6));
            Node::mesh("bolt", place, BOLT)
        }));
        below.push(Node::mesh("elbow", DAffine3::from_translation(2.4 * DVec3::Z), ELBOW));
        let side = DAffine3::from_translation(DVec3::new(-2.6, 0.0, 3.6)) * DAffine3::from_rotation_y(0.25 * TAU);
        below.push(Node::mesh("wheel", side, WHEEL));
        Node { name: format!("unit {x} {y}"), place, mesh: None, below }
    };
    let mut below = vec![Node::mesh("plate", DAffine3::IDENTITY, PLATE)];
    for (x, y) in (0..row.count).flat_map(|y| (0..row.count).map(move |x| (x, y))) {
        below.push(unit(x, y, rng.between(0.0, TAU)));
    }
    Node { name: "station".into(), place: DAffine3::from_rotation_x(-0.25 * TAU), mesh: None, below }
}

#[cfg(test)]
mod tests {
    use super::*;
    use outcrop::import::collect::Collector;

    #[test]
    fn a_station_is_read_as_it_was_made() {
        let row: SceneRow =
            toml::from_str("name = 'station of the test'\ntitle = ''\nassembly = 'station'\ncount = 2").expect("a row");
        let mut read = Collector::new();
        fill(&row, &mut read).expect("it is read");
        let sizes: Vec<usize> = read.meshes.iter().map(|mesh| mesh.triangles.len()).collect();
        assert_eq!(sizes, [2 * 48 * 48, 48 * 20, 528, 2048, 2048]);
        assert_eq!((read.instances.len(), read.notes.len()), (4 * 11, 0));
        // The plate lies flat, with y up; bolts stand out of it.
        assert!(read.direct().iter().flat_map(|t| t.positions).all(|p| p.y.abs() < 1e-6));
        let bounds = read.bounds();
        assert!((6.0..9.0).contains(&bounds.max.y) && bounds.min.y > -3.0, "{bounds:?}");
    }
}
