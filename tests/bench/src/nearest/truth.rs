//! The least distance of two sets of triangles in double precision: every pair of triangles, but those of parts whose
//! boxes are farther from each other than a pair already seen.

use crate::common::brute::Tri;
use crate::common::rounding::point_distance;
use glam::DVec3;

/// Pairs of triangles that are looked at one by one.
const FEW: usize = 64;

/// The least and the greatest corner of the box of triangles.
pub fn bounds(tris: &[Tri]) -> [DVec3; 2] {
    let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    tris.as_flattened().iter().fold(none, |[min, max], &v| [min.min(v), max.max(v)])
}

/// Lowers `least` to the distance of two sets, if that is less. Changes the order of the triangles.
pub fn lower(a: &mut [Tri], b: &mut [Tri], least: &mut f64) {
    let boxes = [bounds(a), bounds(b)];
    let gap = (boxes[0][0] - boxes[1][1]).max(boxes[1][0] - boxes[0][1]).max(DVec3::ZERO);
    if a.is_empty() || b.is_empty() || gap.length() >= *least {
        return;
    }
    if a.len() * b.len() <= FEW {
        for (a, b) in a.iter().flat_map(|a| b.iter().map(move |b| (a, b))) {
            *least = least.min(triangles(a, b));
        }
        return;
    }
    let (many, others, of) = if a.len() >= b.len() { (a, b, boxes[0]) } else { (b, a, boxes[1]) };
    let extent = of[1] - of[0];
    let axis = (0..3).max_by(|&x, &y| extent[x].total_cmp(&extent[y])).unwrap_or(0);
    let key = |tri: &Tri| tri[0][axis] + tri[1][axis] + tri[2][axis];
    let middle = many.len() / 2;
    many.select_nth_unstable_by(middle, |x, y| key(x).total_cmp(&key(y)));
    let (low, high) = many.split_at_mut(middle);
    lower(low, others, least);
    lower(high, others, least);
}

/// The distance of two triangles that have no common point: from a corner to the other triangle, or of two edges.
fn triangles(a: &Tri, b: &Tri) -> f64 {
    let of_corners = a.iter().map(|&p| point_distance(p, b)).chain(b.iter().map(|&p| point_distance(p, a)));
    let edges = |t: &Tri| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let of_edges = edges(a).into_iter().flat_map(|x| edges(b).map(|y| segments(x, y)));
    of_corners.chain(of_edges).fold(f64::INFINITY, f64::min)
}

/// The distance of two points inside segments where their lines are nearest to each other; where that is outside, the
/// distance of two other points of the segments, which is no less than theirs. Ends are for the caller.
fn segments([a, b]: [DVec3; 2], [c, d]: [DVec3; 2]) -> f64 {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, vv, uv) = (u.dot(u), v.dot(v), u.dot(v));
    let part = |x: f64| if x.is_finite() { x.clamp(0.0, 1.0) } else { 0.0 };
    let mut s = part((uv * v.dot(w) - vv * u.dot(w)) / (uu * vv - uv * uv));
    let mut t = 0.0;
    // Roundings of the quotient, which are great for segments that are almost parallel, shrink.
    for _ in 0..3 {
        t = part((w + u * s).dot(v) / vv);
        s = part((v * t - w).dot(u) / uu);
    }
    (w + u * s - v * t).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::rng::Rng;
    use crate::common::scenes::bumpy_sphere;

    #[test]
    fn the_distance_of_two_sets_is_that_of_every_pair() {
        for (seed, gap) in [(1, 0.02), (2, 0.3), (3, 4.0)] {
            let (mut a, away) = (bumpy_sphere(8, 12, seed), DVec3::new(2.6 + gap, 0.3, -0.2));
            let mut b: Vec<Tri> = bumpy_sphere(9, 11, seed + 9).iter().map(|t| t.map(|v| v + away)).collect();
            let of = |(a, b): (&Tri, &Tri)| outcrop::geom::distances::triangle_triangle(a, b).squared.sqrt();
            let every = a.iter().flat_map(|a| b.iter().map(move |b| of((a, b)))).fold(f64::INFINITY, f64::min);
            assert!(every > 0.0);
            let mut least = f64::INFINITY;
            lower(&mut a, &mut b, &mut least);
            assert!((least - every).abs() < 1e-13, "{least} {every}");
            let mut none = every * 0.999;
            lower(&mut a, &mut b, &mut none);
            assert_eq!(none, every * 0.999);
        }
    }

    #[test]
    fn segments_cross_at_a_distance_or_are_parallel() {
        let mut rng = Rng::new(5);
        for _ in 0..500 {
            let [u, w] = [(); 2].map(|()| rng.direction());
            let (n, at) = (u.cross(w).normalize(), rng.direction());
            let (height, s, t) = (rng.between(0.1, 2.0), rng.between(0.1, 0.9), rng.between(0.1, 0.9));
            let one = [at - u * s, at + u * (1.0 - s)];
            let other = [at + n * height - w * t, at + n * height + w * (1.0 - t)];
            assert!((segments(one, other) - height).abs() < 1e-13);
        }
        let along = [DVec3::ZERO, DVec3::X];
        assert_eq!(segments(along, [DVec3::Y, DVec3::X + DVec3::Y]), 1.0);
    }
}
