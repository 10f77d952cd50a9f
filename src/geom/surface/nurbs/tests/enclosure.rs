//! Boxes and cones of normals enclose random samples, and are not much wider than those.

use super::{Owned, Rng};
use crate::geom::surface::nurbs::{BezierPatch, NormalCone};
use crate::math::DBounds;
use glam::DVec3;

/// A bent sheet rather than a random cloud: the normals of the latter are everywhere.
fn sheet(rng: &mut Rng, bend: f64) -> BezierPatch {
    let mut owned = Owned::random(rng, 4, false);
    let columns = owned.counts[1];
    for (i, point) in owned.points.iter_mut().enumerate() {
        let (row, column) = (i as u32 / columns, i as u32 % columns);
        *point = DVec3::new(f64::from(row), f64::from(column), 0.0) + *point * bend;
    }
    let surface = owned.surface();
    let at = surface.piece_counts().map(|n| rng.below(n));
    surface.piece(at)
}

fn within(rng: &mut Rng, [begin, end]: [f64; 2]) -> f64 {
    match rng.below(8) {
        0 => begin,
        1 => end,
        _ => rng.between(begin, end),
    }
}

#[test]
fn boxes_enclose_and_are_tight() {
    let (mut rng, mut looseness) = (Rng::new(11), Vec::new());
    for _ in 0..200 {
        let patch = sheet(&mut rng, 0.3);
        let part = [0, 1].map(|axis| {
            let [a, b] = [0, 1].map(|_| rng.between(patch.domain()[axis][0], patch.domain()[axis][1]));
            [a.min(b), a.max(b)]
        });
        for (bounds, domain) in [(patch.bounds(), patch.domain()), (patch.bounds_of_part(part), part)] {
            let mut seen = DBounds::EMPTY;
            for _ in 0..500 {
                let (u, v) = (within(&mut rng, domain[0]), within(&mut rng, domain[1]));
                let p = patch.evaluate(u, v).position;
                assert!(bounds.contains(&DBounds::of(&[p])), "{p} outside of {bounds:?}");
                seen = seen.with(p);
            }
            looseness.push(bounds.half_area() / seen.half_area());
        }
    }
    let mean = looseness.iter().sum::<f64>() / looseness.len() as f64;
    println!("boxes: {mean:.3} of the area of the samples' box");
    assert!(mean < 1.15, "{mean}");
}

#[test]
fn the_margin_is_needed_and_small() {
    let patch = sheet(&mut Rng::new(12), 0.3);
    assert!(patch.rounding() > 0.0 && patch.rounding() < 1e-12, "{:e}", patch.rounding());
    let mut part = patch.clone();
    for level in 0..60 {
        let [low, high] = part.halves(level % 2);
        part = if level % 3 == 0 { low } else { high };
        let [[u0, u1], [v0, v1]] = part.domain();
        for (u, v) in [(u0, v0), (u1, v0), (u0, v1), (u1, v1)] {
            let p = patch.evaluate(u, v).position;
            assert!(part.bounds().contains(&DBounds::of(&[p])), "level {level}");
        }
    }
    assert!(part.rounding() < 1e-11, "{:e}", part.rounding());
}

#[test]
fn cones_enclose_and_are_tight() {
    let (mut rng, mut looseness) = (Rng::new(13), Vec::new());
    for round in 0..200 {
        let mut patch = sheet(&mut rng, 0.15);
        for axis in 0..round % 4 {
            patch = patch.halves(axis % 2)[rng.below(2)].clone();
        }
        let cone = patch.normal_cone().expect("a cone");
        let normals: Vec<_> = (0..500)
            .map(|_| {
                let (u, v) = (within(&mut rng, patch.domain()[0]), within(&mut rng, patch.domain()[1]));
                patch.evaluate(u, v).normal()
            })
            .collect();
        normals.iter().for_each(|n| assert!(cone.contains(*n), "{cone:?} {n}"));
        let seen = NormalCone::around(&normals).expect("a cone").angle;
        if cone.angle < 1.5 {
            looseness.push(cone.angle / seen);
        }
    }
    let mean = looseness.iter().sum::<f64>() / looseness.len() as f64;
    println!("cones: {} of 200 under π/2, {mean:.3} times the angle of the samples' cone", looseness.len());
    assert!(looseness.len() > 150 && mean < 1.6, "{} {mean}", looseness.len());
}

#[test]
fn the_narrowest_cone_of_three_directions() {
    let around = |angles: &[f64]| {
        let vectors: Vec<_> = angles.iter().map(|a| DVec3::new(a.sin(), 0.0, a.cos()) * (1.0 + a * a)).collect();
        NormalCone::around(&vectors).expect("a cone")
    };
    let cone = around(&[-0.4, 0.1, 0.8]);
    assert!((0.6..0.63).contains(&cone.angle), "{cone:?}");
    assert_eq!(around(&[-1.6, 0.0, 1.6]).angle, std::f64::consts::PI);
    assert_eq!(NormalCone::around(&[DVec3::ZERO; 3]), None);
    assert_eq!(NormalCone::around(&[DVec3::X, DVec3::NEG_X]).map(|c| c.angle), Some(std::f64::consts::PI));
}
