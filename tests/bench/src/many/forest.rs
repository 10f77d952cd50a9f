//! A forest: instances of one plant on a square grid about the origin, moved, turned and scaled at random, and three
//! views of it.

use crate::common::rng::Rng;
use crate::placed::{Place as PeersPlace, Placed};
use crate::scenes::Mesh;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::scene::{Camera, Place};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Distance of places along the grid, metres: crowns are in each other.
const SPACING: f64 = 6.0;

/// A place is moved along the ground by at most this along each side, metres.
const JITTER: f64 = 2.0;

/// Least and greatest scale.
const SCALES: [f64; 2] = [0.7, 1.3];

/// Where an edit moves an instance, metres.
const MOVED: DVec3 = DVec3::new(1.5, -1.0, 0.0);

/// One instance in so many is moved where many are.
const EVERY: usize = 100;

/// The direction to the sun.
pub fn sun() -> Vec3 {
    Vec3::new(0.4, -0.3, 0.87).normalize()
}

/// What is done to a forest that is committed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edit {
    /// The instance in the middle is moved.
    MoveOne,
    /// One in a hundred is moved, each by a call of its own: they are all over the forest.
    MoveMany,
    /// The instance in the middle is highlighted, or no longer so.
    Highlight,
}

impl Edit {
    pub const ALL: [Self; 3] = [Self::MoveOne, Self::MoveMany, Self::Highlight];

    pub fn name(self) -> &'static str {
        match self {
            Edit::MoveOne => "1 moved",
            Edit::MoveMany => "1 % moved",
            Edit::Highlight => "1 highlighted",
        }
    }
}

/// The places of all instances.
pub struct Forest {
    pub places: Arc<[Place]>,
    /// Half of a side of the grid, metres.
    half: f64,
}

impl Forest {
    pub fn new(count: usize) -> Self {
        let edge = (count as f64).sqrt().ceil() as usize;
        let place = |i: usize| {
            let mut rng = Rng::new(i as u64);
            let cell = |at: usize| SPACING * (at as f64 - (edge / 2) as f64);
            let moved = rng.inside(DVec3::new(-JITTER, -JITTER, 0.0), DVec3::new(JITTER, JITTER, 0.0));
            let turn = DQuat::from_rotation_z(rng.between(0.0, TAU)).as_quat();
            Place {
                position: DVec3::new(cell(i % edge), cell(i / edge), 0.0) + moved,
                rotation: turn.to_array(),
                scale: rng.between(SCALES[0], SCALES[1]) as f32,
            }
        };
        Self { places: (0..count).map(place).collect(), half: 0.5 * SPACING * edge as f64 }
    }

    /// The number of the instance in the middle.
    pub fn middle(&self) -> usize {
        self.places.len() / 2
    }

    /// The instances that an edit moves, with their new places, or with their old ones where it is undone.
    pub fn moved(&self, edit: Edit, is_undone: bool) -> Vec<(usize, Place)> {
        let moved = |i: usize| {
            let place = self.places[i];
            let by = if is_undone { DVec3::ZERO } else { MOVED };
            (i, Place { position: place.position + by, ..place })
        };
        match edit {
            Edit::MoveOne => vec![moved(self.middle())],
            Edit::MoveMany => (0..self.places.len()).step_by(EVERY).map(moved).collect(),
            Edit::Highlight => Vec::new(),
        }
    }

    /// The forest after an edit.
    pub fn after(&self, edit: Edit) -> Self {
        let mut places = self.places.to_vec();
        self.moved(edit, false).into_iter().for_each(|(i, place)| places[i] = place);
        Self { places: places.into(), half: self.half }
    }

    /// As peers take it.
    pub fn placed(&self, mesh: &Arc<Mesh>) -> Placed {
        let place = |place: &Place| PeersPlace { mesh: 0, world_from_mesh: affine(place) };
        Placed { meshes: vec![Arc::clone(mesh)], places: self.places.iter().map(place).collect() }
    }

    /// All of it from above, along the ground from outside, and along the ground between its trees.
    pub fn views(&self) -> [(&'static str, Camera); 3] {
        let (half, up) = (self.half, DVec3::Z);
        let view = |eye, at, fov_y_degrees| Camera::Perspective { eye, at, up, fov_y_degrees };
        let outside = DVec3::new(-half - 15.0, 0.1 * half, 10.0);
        let between = DVec3::new(0.5 * SPACING, 0.5 * SPACING, 1.8);
        [
            ("whole", view(half * DVec3::new(-1.6, -2.0, 1.6), DVec3::ZERO, 40.0)),
            ("edge", view(outside, DVec3::new(0.0, 0.0, 4.0), 50.0)),
            ("inside", view(between, between + DVec3::new(10.0, 3.7, 1.0), 60.0)),
        ]
    }
}

/// The map of a place.
pub fn affine(place: &Place) -> DAffine3 {
    let turn = DQuat::from_array(place.rotation.map(f64::from)).normalize();
    DAffine3::from_scale_rotation_translation(DVec3::splat(place.scale.into()), turn, place.position)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_about_the_origin_and_edits_move_some_of_them() {
        let forest = Forest::new(10_001);
        let sum: DVec3 = forest.places.iter().map(|place| place.position).sum();
        assert!((sum / 10_001.0).length() < SPACING, "{sum}");
        for (i, a) in forest.places.iter().enumerate().take(300) {
            for b in &forest.places[..i] {
                assert!(a.position.distance(b.position) >= SPACING - 2.0 * JITTER);
            }
        }
        assert_eq!(Edit::ALL.map(|edit| forest.moved(edit, false).len()), [1, 101, 0]);
        let after = forest.after(Edit::MoveMany);
        let is_moved = |i: &usize| after.places[*i] != forest.places[*i];
        assert!((0..10_001).filter(is_moved).eq((0..10_001).step_by(EVERY)));
        assert!(forest.moved(Edit::MoveMany, true).iter().all(|(i, place)| forest.places[*i] == *place));
    }

    #[test]
    fn no_eye_is_in_a_tree() {
        let forest = Forest::new(1000);
        for (name, camera) in forest.views() {
            let nearest = forest.places.iter().map(|place| place.position.truncate().distance(camera.eye().truncate()));
            assert!(nearest.fold(f64::INFINITY, f64::min) > 1.0, "{name}");
        }
    }
}
