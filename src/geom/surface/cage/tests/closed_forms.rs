//! Regular cages are bicubic B-splines; derivatives are those of differences; faces meet at their edges.

use super::super::CagePatches;
use super::shapes::{Rng, Shape, fan, grid, tangle};
use glam::DVec3;

/// The uniform cubic B-spline of de Boor's recursion at `t` in segment `at` of points along a line.
fn spline(points: &[DVec3], at: usize, t: f64) -> DVec3 {
    let mut d: Vec<DVec3> = points[at - 1..at + 3].to_vec();
    for step in 1..=3 {
        for i in (step..=3).rev() {
            let share = (t + 3.0 - i as f64) / (4 - step) as f64;
            d[i] = d[i - 1] * (1.0 - share) + d[i] * share;
        }
    }
    d[3]
}

#[test]
fn the_inside_of_a_grid_is_a_bicubic_spline() {
    let rng = &mut Rng(1);
    let shape = grid(5, rng);
    let patches = CagePatches::new(&shape.cage(), &shape.points).unwrap();
    for _ in 0..200 {
        let (i, j, u, v) = (1 + rng.below(3), 1 + rng.below(3), rng.unit(), rng.unit());
        let rows: Vec<DVec3> = shape.points.chunks(6).map(|row| spline(row, i as usize, u)).collect();
        let found = patches.evaluate(5 * j + i, 0, u, v).position;
        assert!(found.distance(spline(&rows, j as usize, v)) < 1e-14);
    }
}

/// Greatest relative differences of first and second derivatives from central differences.
fn differences(patches: &CagePatches, face: u32, corner: u32, u: f64, v: f64) -> [f64; 2] {
    let step = 1e-5;
    let at = |u: f64, v: f64| patches.evaluate(face, corner, u, v);
    let p = at(u, v);
    let by = |a: DVec3, b: DVec3| (a - b) / (2.0 * step);
    let (left, right, low, high) = (at(u - step, v), at(u + step, v), at(u, v - step), at(u, v + step));
    let first = (by(right.position, left.position) - p.du).length() + (by(high.position, low.position) - p.dv).length();
    let second = (by(right.du, left.du) - p.duu).length()
        + (by(high.dv, low.dv) - p.dvv).length()
        + (by(right.dv, left.dv) - p.duv).length();
    [first / (p.du.length() + p.dv.length()), second / (1.0 + p.duu.length() + p.dvv.length() + p.duv.length())]
}

#[test]
fn derivatives_are_those_of_differences() {
    let rng = &mut Rng(2);
    let mut creased = fan(5, 2, rng);
    creased.creases = vec![(0, 1, 1.7), (0, 5, 10.0), (1, 11, 2.2)];
    creased.corners = vec![(3, 1.4)];
    for shape in [fan(3, 2, rng), fan(7, 2, rng), creased] {
        let patches = CagePatches::new(&shape.cage(), &shape.points).unwrap();
        for _ in 0..300 {
            // Off the lines between patches of the first six levels, at which second derivatives jump.
            let mut inner = || (f64::from(rng.below(64)) + 0.1 + 0.8 * rng.unit()) / 64.0;
            let (u, v) = (inner(), inner());
            let face = rng.below(shape.sizes.len() as u32);
            let [first, second] = differences(&patches, face, 0, u, v);
            assert!(first < 1e-6 && second < 1e-5, "face {face} at {u} {v}: {first} {second}");
        }
    }
}

/// Parameters of a point of a face's edge that begins at `corner`: the quad's corner, u and v.
fn on_edge(size: u32, corner: u32, t: f64) -> (u32, f64, f64) {
    if size == 4 {
        let (u, v) = [(t, 0.0), (1.0, t), (1.0 - t, 1.0), (0.0, 1.0 - t)][corner as usize];
        (0, u, v)
    } else if t <= 0.5 {
        (corner, 2.0 * t, 0.0)
    } else {
        ((corner + 1) % size, 0.0, 2.0 - 2.0 * t)
    }
}

fn meets_at_edges(shape: &Shape, within: f64) {
    let cage = shape.cage();
    let patches = CagePatches::new(&cage, &shape.points).unwrap();
    let topology = &cage.topology;
    for edge in 0..cage.edge_count() as u32 {
        let corners = topology.corners_of_edge(edge);
        for t in [0.0, 1e-9, 0.01, 0.25, 0.3, 0.5, 0.77, 1.0 - 1e-7, 1.0] {
            let found = corners.iter().map(|&h| {
                let face = topology.corner_face[h as usize];
                let forwards = topology.corners[h as usize] == topology.edges[edge as usize][0];
                let corner = h - topology.face_start[face as usize];
                let t = if forwards { t } else { 1.0 - t };
                let (corner, u, v) = on_edge(topology.face_size(face), corner, t);
                patches.evaluate(face, corner, u, v).position
            });
            let found: Vec<DVec3> = found.collect();
            found.iter().for_each(|p| assert!(p.distance(found[0]) < within, "edge {edge} at {t}: {found:?}"));
        }
    }
}

#[test]
fn faces_meet_at_their_edges() {
    let rng = &mut Rng(3);
    for _ in 0..150 {
        meets_at_edges(&tangle(rng), 2e-8);
    }
    for valence in [3, 5, 9] {
        meets_at_edges(&fan(valence, 2, rng), 2e-8);
    }
}
