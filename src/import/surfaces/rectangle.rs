//! Loops of a face that are no trim: the border of a rectangle of parameters.

/// Distances under this share of the domain are rounding.
const ROUNDING: f64 = 1e-9;

/// Returns the rectangle whose border is the loop, if it is one within the domain: each curve lies on a side, by all of
/// its control points (in loop order), and the loop encloses the area of the rectangle. Sides within rounding of a
/// knot are moved to it.
pub(super) fn of_loop(curves: &[Vec<[f64; 2]>], knots: [&[f64]; 2], domain: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let rounding = domain.map(|[begin, end]| ROUNDING * (end - begin));
    let range = [0, 1].map(|axis| {
        let values = curves.iter().flatten().map(|p| p[axis]);
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], x| [least.min(x), most.max(x)])
    });
    let is_within = |axis: usize| {
        let ([begin, end], [least, most]) = (domain[axis], range[axis]);
        // False for an empty loop.
        least >= begin - rounding[axis] && most <= end + rounding[axis] && most - least > 2.0 * rounding[axis]
    };
    let is_on_side = |curve: &[[f64; 2]]| {
        (0..4).any(|side| curve.iter().all(|p| (p[side / 2] - range[side / 2][side % 2]).abs() <= rounding[side / 2]))
    };
    let sides = range.map(|[least, most]| most - least);
    let is_rectangle = is_within(0)
        && is_within(1)
        && curves.iter().all(|curve| is_on_side(curve))
        && (area(curves, range).abs() / (sides[0] * sides[1]) - 1.0).abs() < 1e-6;
    is_rectangle.then(|| [0, 1].map(|axis| range[axis].map(|t| snapped(t, knots[axis], domain[axis], rounding[axis]))))
}

/// The area of the polygon of all control points, which is that of the loop if all curves are straight.
fn area(curves: &[Vec<[f64; 2]>], [[u, _], [v, _]]: [[f64; 2]; 2]) -> f64 {
    let corners = || curves.iter().flatten().map(|p| [p[0] - u, p[1] - v]);
    let crosses = corners().zip(corners().cycle().skip(1)).map(|(a, b)| a[0] * b[1] - a[1] * b[0]);
    0.5 * crosses.sum::<f64>()
}

/// The nearest knot within rounding, else `t` itself, within the domain.
fn snapped(t: f64, knots: &[f64], [begin, end]: [f64; 2], rounding: f64) -> f64 {
    let nearest = knots.iter().copied().min_by(|a, b| (a - t).abs().total_cmp(&(b - t).abs()));
    nearest.filter(|knot| (knot - t).abs() <= rounding).unwrap_or(t).clamp(begin, end)
}
