//! Uniform bicubic B-spline patches of 4 × 4 control points, rows along u, for u and v from 0 to 1.

use super::super::point::SurfacePoint;
use glam::DVec3;

/// Values of the four cubic B-splines at `t`, their first and second derivatives.
fn basis(t: f64) -> [[f64; 4]; 3] {
    let (s, t2) = (1.0 - t, t * t);
    let value = [s * s * s / 6.0, 2.0 / 3.0 - t2 + t2 * t / 2.0, 2.0 / 3.0 - s * s + s * s * s / 2.0, t2 * t / 6.0];
    let first = [-s * s / 2.0, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), t2 / 2.0];
    [value, first, [s, 3.0 * t - 2.0, 3.0 * s - 2.0, t]]
}

fn sum(weights: &[f64; 4], points: &[DVec3; 4]) -> DVec3 {
    points[0] * weights[0] + points[1] * weights[1] + points[2] * weights[2] + points[3] * weights[3]
}

/// The point at u, v with its derivatives.
pub(super) fn evaluate(points: &[DVec3; 16], u: f64, v: f64) -> SurfacePoint {
    let (bu, bv) = (basis(u), basis(v));
    let (mut value, mut first, mut second) = ([DVec3::ZERO; 4], [DVec3::ZERO; 4], [DVec3::ZERO; 4]);
    for row in 0..4 {
        let points = &[points[4 * row], points[4 * row + 1], points[4 * row + 2], points[4 * row + 3]];
        (value[row], first[row], second[row]) = (sum(&bu[0], points), sum(&bu[1], points), sum(&bu[2], points));
    }
    SurfacePoint {
        position: sum(&bv[0], &value),
        du: sum(&bv[0], &first),
        dv: sum(&bv[1], &value),
        duu: sum(&bv[0], &second),
        duv: sum(&bv[1], &first),
        dvv: sum(&bv[2], &value),
    }
}

/// Weights of a B-spline segment's four points for the Bézier points of its part from `a` to `b`: values of the polar
/// form at (a, a, a), (a, a, b), (a, b, b), (b, b, b). Ramshaw, "Blossoms are polar forms", Computer Aided Geometric
/// Design 6(4), 1989. None is below zero for 0 ≤ a ≤ b ≤ 1.
fn bezier_weights(a: f64, b: f64) -> [[f64; 4]; 4] {
    [[a, a, a], [a, a, b], [a, b, b], [b, b, b]].map(blossom)
}

fn blossom([p, q, r]: [f64; 3]) -> [f64; 4] {
    // De Boor's algorithm with knots −2, −1, 0, 1, 2, 3, each step with its own argument.
    let mut weights = [0.0; 4];
    for (i, weight) in weights.iter_mut().enumerate() {
        let mut d = [0.0; 4];
        d[i] = 1.0;
        for (step, t) in [p, q, r].into_iter().enumerate() {
            let span = (3 - step) as f64;
            for j in 0..3 - step {
                let share = (t + (2 - step - j) as f64) / span;
                d[j] = d[j] * (1.0 - share) + d[j + 1] * share;
            }
        }
        *weight = d[0];
    }
    weights
}

/// Bézier points of the part from (u₀, v₀) to (u₁, v₁): the part lies in their convex hull.
pub(super) fn bezier(points: &[DVec3; 16], u: [f64; 2], v: [f64; 2]) -> [DVec3; 16] {
    let (wu, wv) = (bezier_weights(u[0], u[1]), bezier_weights(v[0], v[1]));
    let mut out = [DVec3::ZERO; 16];
    for column in 0..4 {
        let along: [DVec3; 4] = std::array::from_fn(|row| {
            let points = &[points[4 * row], points[4 * row + 1], points[4 * row + 2], points[4 * row + 3]];
            sum(&wu[column], points)
        });
        for row in 0..4 {
            out[4 * row + column] = sum(&wv[row], &along);
        }
    }
    out
}
