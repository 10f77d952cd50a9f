//! The test of two triangles that peers get: in double precision, without exact signs. Guigue, Devillers, "Fast and
//! Robust Triangle-Triangle Overlap Test Using Orientation Predicates", Journal of Graphics Tools 8(1), 2003.

use glam::DVec3;

/// True if two triangles have a common point, up to rounding.
pub fn overlap(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let of_a = sides(b, a);
    if is_aside(of_a) {
        return false;
    }
    let of_b = sides(a, b);
    if is_aside(of_b) {
        return false;
    }
    if of_a == [0.0; 3] || of_b == [0.0; 3] {
        return overlap_in_plane(a, b);
    }
    // The corner alone on its side comes first, and sees the other's first corner above it.
    let (alone_a, alone_b) = (alone(of_a), alone(of_b));
    let ([p, q, r], [k, l, m]) = (turned(a, alone_a, alone_b.1), turned(b, alone_b, alone_a.1));
    volume([p, q, k, l]) <= 0.0 && volume([p, r, m, k]) <= 0.0
}

/// Six times the volume of a tetrahedron; positive if the first three appear counter-clockwise from the last.
fn volume([a, b, c, d]: [DVec3; 4]) -> f64 {
    (b - a).cross(c - a).dot(d - a)
}

fn sides(plane: &[DVec3; 3], points: &[DVec3; 3]) -> [f64; 3] {
    let normal = (plane[1] - plane[0]).cross(plane[2] - plane[0]);
    points.map(|p| normal.dot(p - plane[0]))
}

fn is_aside(s: [f64; 3]) -> bool {
    s.iter().all(|x| *x > 0.0) || s.iter().all(|x| *x < 0.0)
}

/// The corner alone on its side of a plane, and whether it is above.
fn alone(s: [f64; 3]) -> (usize, bool) {
    for i in 0..3 {
        let (one, next, last) = (s[i], s[(i + 1) % 3], s[(i + 2) % 3]);
        if one * next <= 0.0 && one * last <= 0.0 && (one != 0.0 || next * last > 0.0) {
            return (i, one > 0.0 || one == 0.0 && next < 0.0);
        }
    }
    (0, true)
}

fn turned(t: &[DVec3; 3], (first, _): (usize, bool), is_kept: bool) -> [DVec3; 3] {
    let (next, last) = ((first + 1) % 3, (first + 2) % 3);
    if is_kept { [t[first], t[next], t[last]] } else { [t[first], t[last], t[next]] }
}

/// Of triangles in one plane: no edge separates them.
fn overlap_in_plane(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let normal = (a[1] - a[0]).cross(a[2] - a[0]) + (b[1] - b[0]).cross(b[2] - b[0]);
    let normal = if normal == DVec3::ZERO { (a[1] - a[0]).cross(a[2] - a[0]) } else { normal };
    let is_separated = |t: &[DVec3; 3], other: &[DVec3; 3]| {
        (0..3).any(|i| {
            let axis = (t[(i + 1) % 3] - t[i]).cross(normal);
            let reach = |t: &[DVec3; 3]| {
                let [x, y, z] = t.map(|p| p.dot(axis));
                (x.min(y).min(z), x.max(y).max(z))
            };
            let (own, theirs) = (reach(t), reach(other));
            own.1 < theirs.0 || theirs.1 < own.0
        })
    };
    !is_separated(a, b) && !is_separated(b, a)
}
