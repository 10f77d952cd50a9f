//! Boxes hold the points of their parts.

use super::super::CagePatches;
use super::shapes::{Rng, Shape, fan, tangle};
use crate::math::DBounds;
use glam::DVec3;

fn encloses(shape: &Shape, rng: &mut Rng) {
    let cage = shape.cage();
    let patches = CagePatches::new(&cage, &shape.points).unwrap();
    for _ in 0..60 {
        let face = rng.below(cage.face_count() as u32);
        let corner = rng.below(cage.quads_of(face));
        let level = rng.below(14);
        let near = |rng: &mut Rng| if rng.below(2) == 0 { 0 } else { rng.below(1 << level) };
        let (i, j) = (near(rng), near(rng));
        let bounds = patches.bounds(face, corner, level, i, j);
        for _ in 0..10 {
            let side = 0.5f64.powi(level as i32);
            let mut within = |at: u32| (f64::from(at) + [0.0, 1.0, rng.unit()][rng.below(3) as usize]) * side;
            let p = patches.evaluate(face, corner, within(i), within(j)).position;
            assert!(bounds.contains(&DBounds { min: p, max: p }), "{p} in {bounds:?}, face {face}, {level} {i} {j}");
        }
    }
}

#[test]
fn boxes_enclose_the_surface() {
    let rng = &mut Rng(1);
    for shift in [0.0, 1e7] {
        let moved = |mut shape: Shape| {
            shape.points.iter_mut().for_each(|p| *p += DVec3::new(shift, -shift, 0.5 * shift));
            shape
        };
        for n in [3, 4, 5, 12, 30] {
            encloses(&moved(fan(n, 2, rng)), rng);
        }
        for _ in 0..40 {
            encloses(&moved(tangle(rng)), rng);
        }
    }
}

#[test]
fn boxes_shrink_with_their_parts() {
    let rng = &mut Rng(2);
    for n in [3, 4, 7] {
        let shape = fan(n, 2, rng);
        let patches = CagePatches::new(&shape.cage(), &shape.points).unwrap();
        let size = |level| patches.bounds(0, 0, level, 0, 0).extent().max_element();
        for level in 1..12 {
            assert!(size(level + 1) < 0.75 * size(level), "valence {n}, level {level}");
        }
    }
}

#[test]
fn boxes_enclose_creases() {
    let rng = &mut Rng(3);
    for sharpness in [0.4, 1.0, 3.6] {
        let mut shape = super::shapes::grid(4, rng);
        shape.creases = (0..4).map(|i| (10 + i, 11 + i, sharpness)).collect();
        encloses(&shape, rng);
    }
}
