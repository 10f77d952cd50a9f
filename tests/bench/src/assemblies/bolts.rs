//! `bolts`: `count` placements of one bolt of at most `triangles` triangles, on a cubic grid, each turned and moved at
//! random.

use super::shapes;
use crate::common::rng::Rng;
use crate::data::SceneRow;
use crate::failure::Outcome;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::import::{Attributes, PartDesc, Sink};

/// Distance of places, metres. A bolt is 3 long: neighbours come near each other, and boxes overlap.
const SPACING: f64 = 3.6;

/// A place is moved each way by at most this, metres.
const JITTER: f64 = 0.8;

pub fn fill(row: &SceneRow, sink: &mut dyn Sink) -> Outcome {
    let bolt = shapes::bolt(row.triangles as usize);
    let first = places(row.count, row.seed).map(|place| {
        let part = sink.part(PartDesc { name: "bolt".into(), ..PartDesc::default() })?;
        Ok((place, part))
    });
    let placed = first.collect::<Result<Vec<_>, outcrop::Error>>()?;
    let mesh = sink.shared_mesh(1)?;
    sink.triangles(mesh, 0, &bolt.corners(), Attributes::NONE)?;
    for (place, part) in placed {
        sink.instance(mesh, place, part)?;
    }
    Ok(())
}

fn places(count: usize, seed: u64) -> impl Iterator<Item = DAffine3> {
    let edge = (1..).find(|edge: &usize| edge.pow(3) >= count).unwrap_or(1);
    (0..count).map(move |i| {
        let mut rng = Rng::new(seed ^ (i as u64) << 8);
        let cell = DVec3::new((i % edge) as f64, (i / edge % edge) as f64, (i / edge / edge) as f64);
        let moved = rng.inside(DVec3::splat(-JITTER), DVec3::splat(JITTER));
        let turn = DQuat::from_rotation_arc(DVec3::Z, rng.direction())
            * DQuat::from_rotation_z(rng.between(0.0, std::f64::consts::TAU));
        DAffine3::from_rotation_translation(turn, SPACING * cell + moved)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_apart_and_turned() {
        let all: Vec<DAffine3> = places(30, 1).collect();
        assert_eq!(all.len(), 30);
        for (i, a) in all.iter().enumerate() {
            assert!((a.matrix3.determinant() - 1.0).abs() < 1e-12);
            for b in &all[..i] {
                assert!(a.translation.distance(b.translation) >= SPACING - 2.0 * JITTER);
                assert!(!a.matrix3.abs_diff_eq(b.matrix3, 1e-6));
            }
        }
    }
}
