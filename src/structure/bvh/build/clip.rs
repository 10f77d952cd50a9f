//! Bounds of the part of a triangle inside a box, by clipping. Tests compare spatial splits with it.

use crate::math::Bounds;
use glam::Vec3;

/// Returns the bounds of `triangle` inside `cell`, or `None` if they share no point.
///
/// The function clips at the six planes in double precision (Sutherland-Hodgman). The result is rounded outward to
/// single precision and cut to `cell`, so it contains every point of the triangle in the cell.
pub fn clipped_bounds(triangle: &[Vec3; 3], cell: &Bounds) -> Option<Bounds> {
    let whole = Bounds::of(triangle);
    if cell.contains(&whole) {
        return Some(whole);
    }
    if !cell.overlaps(&whole) {
        return None;
    }
    // Each of six planes adds at most one vertex.
    let mut polygon = [[0.0f64; 3]; 9];
    let mut len = 3;
    for (p, v) in polygon.iter_mut().zip(triangle) {
        *p = v.as_dvec3().to_array();
    }
    for axis in 0..3 {
        for (plane, sign) in [(cell.min[axis], 1.0), (cell.max[axis], -1.0)] {
            len = clip(&mut polygon, len, axis, f64::from(plane), sign);
        }
    }
    let mut bounds = Bounds::EMPTY;
    for p in &polygon[..len] {
        bounds.min = bounds.min.min(Vec3::from_array(p.map(|x| (x as f32).next_down())));
        bounds.max = bounds.max.max(Vec3::from_array(p.map(|x| (x as f32).next_up())));
    }
    let bounds = bounds.intersection(*cell).intersection(whole);
    (len > 0 && !bounds.is_empty()).then_some(bounds)
}

/// Keeps the side of `polygon[..len]` where `sign * (p[axis] - plane) >= 0`; returns its length.
fn clip(polygon: &mut [[f64; 3]; 9], len: usize, axis: usize, plane: f64, sign: f64) -> usize {
    let input = *polygon;
    let mut out = 0;
    for i in 0..len {
        let (p, q) = (input[i], input[(i + 1) % len]);
        let (dp, dq) = (sign * (p[axis] - plane), sign * (q[axis] - plane));
        if dp >= 0.0 && out < 9 {
            polygon[out] = p;
            out += 1;
        }
        if (dp > 0.0 && dq < 0.0 || dp < 0.0 && dq > 0.0) && out < 9 {
            let w = dp / (dp - dq);
            let mut r = std::array::from_fn(|k| p[k] + (q[k] - p[k]) * w);
            r[axis] = plane;
            polygon[out] = r;
            out += 1;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid() -> impl Strategy<Value = Vec3> {
        [-4i32..5, -4i32..5, -4i32..5].prop_map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32))
    }

    proptest! {
        /// Every point of the triangle that lies in the cell lies in the clipped bounds.
        #[test]
        fn holds_every_point_inside(a in grid(), b in grid(), c in grid(), p in grid(), q in grid(),
                                    samples in prop::collection::vec((0.0f32..1.0, 0.0f32..1.0), 64)) {
            let cell = Bounds::of(&[p, q]);
            let found = clipped_bounds(&[a, b, c], &cell);
            for (u, v) in samples {
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let point = a + (b - a) * u + (c - a) * v;
                // Points within rounding of the cell's border may count either way.
                let inner = Bounds { min: cell.min + 1e-5, max: cell.max - 1e-5 };
                if inner.min.cmplt(point).all() && point.cmplt(inner.max).all() {
                    let bounds = found.expect("not empty");
                    prop_assert!(bounds.min.cmple(point + 1e-5).all() && (point - 1e-5).cmple(bounds.max).all());
                }
            }
            if let Some(bounds) = found {
                prop_assert!(cell.contains(&bounds) && Bounds::of(&[a, b, c]).contains(&bounds));
            }
        }
    }

    #[test]
    fn a_thin_diagonal_is_cut_tight() {
        let diagonal = [Vec3::ZERO, Vec3::splat(8.0), Vec3::new(8.0, 8.0, 7.9)];
        let cell = Bounds { min: Vec3::ZERO, max: Vec3::new(2.0, 8.0, 8.0) };
        let cut = clipped_bounds(&diagonal, &cell).expect("overlaps");
        assert!(cut.max.y < 2.001 && cut.max.z < 2.001, "{cut:?}");
    }
}
