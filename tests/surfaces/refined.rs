//! Uniform subdivision against OpenSubdiv's reference meshes, which its older code wrote.

use crate::common::shapes::{Shape, model};
use glam::DVec3;
use outcrop::geom::surface::cage::Cage;

/// A cage and its points after some steps.
pub fn refined(shape: &Shape, steps: usize) -> (Cage, Vec<DVec3>) {
    let mut level = (shape.cage(), shape.points.clone());
    for _ in 0..steps {
        let points = level.0.refine_points(&level.1).unwrap();
        level = (level.0.refine().unwrap(), points);
    }
    level
}

/// The greatest distance from a point of `a` to the nearest of `b`, found by a grid of cells.
fn farthest(a: &[DVec3], b: &[DVec3], cell: f64) -> f64 {
    let key = |p: DVec3| (p / cell).floor().as_i64vec3();
    let mut cells = std::collections::HashMap::<_, Vec<DVec3>>::new();
    for &p in b {
        cells.entry(key(p)).or_default().push(p);
    }
    let nearest = |p: DVec3| {
        let around = (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| (x, y, z))));
        let keys = around.map(|(x, y, z)| key(p) + glam::I64Vec3::new(x, y, z));
        keys.filter_map(|k| cells.get(&k)).flatten().map(|&q| p.distance(q)).fold(cell, f64::min)
    };
    a.iter().map(|&p| nearest(p)).fold(0.0, f64::max)
}

fn meets_baseline(name: &str, level: usize) {
    let baseline = format!("baseline/{name}_level{level}");
    let (Some(shape), Some(expected)) = (model(name), model(&baseline)) else { return };
    let (cage, points) = refined(&shape, level + 1);
    assert_eq!(cage.face_count(), expected.sizes.len(), "{name}: faces");
    let used: std::collections::BTreeSet<u32> =
        (0..cage.face_count() as u32).flat_map(|f| cage.face(f).to_vec()).collect();
    let points: Vec<DVec3> = used.iter().map(|&v| points[v as usize]).collect();
    assert_eq!(points.len(), expected.points.len(), "{name}: vertices");
    let there = farthest(&points, &expected.points, 1e-3);
    let back = farthest(&expected.points, &points, 1e-3);
    println!("{name}: {} points, {there:.2e} and back {back:.2e}", points.len());
    assert!(there.max(back) <= 1e-6, "{name}: {there} {back}");
}

#[test]
fn refined_cages_meet_the_baselines() {
    meets_baseline("catmark_cube_creases1", 4);
    meets_baseline("catmark_tent_creases1", 3);
    meets_baseline("catmark_edgeonly", 3);
}
