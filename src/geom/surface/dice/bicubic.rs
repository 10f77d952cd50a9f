//! The bicubic patches that squares of quads are parts of.

use glam::DVec4;

/// A Bézier patch of degree 3 along u and v, rational or not, and a square of its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct BicubicPatch {
    /// Control points (w P, w) in homogeneous coordinates, rows along u; all weights are positive.
    pub points: [DVec4; 16],
    /// False if all weights are 1.
    pub is_rational: bool,
    /// The square: level, column and row among the 4^level squares of the patch.
    pub place: [u32; 3],
}

impl BicubicPatch {
    /// The patch of control points of degrees of at most 3, rows along u; `None` if a degree is higher or 0.
    pub fn elevated(points: &[DVec4], degree: [usize; 2], is_rational: bool, place: [u32; 3]) -> Option<Self> {
        let [p, q] = degree;
        if !(1..=3).contains(&p) || !(1..=3).contains(&q) || points.len() != (p + 1) * (q + 1) {
            return None;
        }
        let rows: Vec<[DVec4; 4]> = points.chunks_exact(p + 1).map(to_cubic).collect();
        let mut out = [DVec4::ZERO; 16];
        for column in 0..4 {
            let along: Vec<DVec4> = rows.iter().map(|row| row[column]).collect();
            for (row, point) in to_cubic(&along).into_iter().enumerate() {
                out[4 * row + column] = point;
            }
        }
        Some(Self { points: out, is_rational, place })
    }

    /// The same patch with u and v exchanged.
    pub fn transposed(&self) -> Self {
        let [level, column, row] = self.place;
        let points = std::array::from_fn(|i| self.points[i % 4 * 4 + i / 4]);
        Self { points, is_rational: self.is_rational, place: [level, row, column] }
    }
}

/// The four Bézier points of a curve with up to four.
fn to_cubic(points: &[DVec4]) -> [DVec4; 4] {
    let mut out = [DVec4::ZERO; 4];
    out[..points.len()].copy_from_slice(points);
    for degree in points.len() - 1..3 {
        let count = (degree + 1) as f64;
        for i in (1..=degree + 1).rev() {
            let share = i as f64 / count;
            out[i] = out[i - 1] * share + out[i] * (1.0 - share);
        }
    }
    out
}

/// The quarter of a square of a place, as the child of its first level, and the place in that child. `None` for the
/// whole square. Children are those at the corners of the square, anticlockwise from that at u = v = 0.
pub fn descend([level, column, row]: [u32; 3]) -> Option<(usize, [u32; 3])> {
    let below = level.checked_sub(1)?;
    let (right, upper) = (column >> below & 1, row >> below & 1);
    let child = [0, 1, 3, 2][(right + 2 * upper) as usize];
    let own = (1 << below) - 1;
    Some((child, [below, column & own, row & own]))
}
