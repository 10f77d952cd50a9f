//! The bicubic patches that squares of quads are parts of.

use glam::DVec4;

/// An interval of parameters from 0 to 1: its level, and its index among the 2^level intervals of the level.
pub type Interval = [u32; 2];

/// A Bézier patch of degree 3 along u and v, rational or not, and a rectangle of its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct BicubicPatch {
    /// Control points (w P, w) in homogeneous coordinates, rows along u; all weights are positive.
    pub points: [DVec4; 16],
    /// False if all weights are 1.
    pub is_rational: bool,
    /// The rectangle: its intervals along u and along v.
    pub place: [Interval; 2],
}

impl BicubicPatch {
    /// The patch of control points of degrees of at most 3, rows along u; `None` if a degree is higher or 0.
    pub fn elevated(points: &[DVec4], degree: [usize; 2], is_rational: bool, place: [Interval; 2]) -> Option<Self> {
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
        if !is_rational {
            // Interpolation rounds weights too.
            out.iter_mut().for_each(|p| p.w = 1.0);
        }
        Some(Self { points: out, is_rational, place })
    }

    /// The same patch with u and v exchanged.
    pub fn transposed(&self) -> Self {
        let [u, v] = self.place;
        let points = std::array::from_fn(|i| self.points[i % 4 * 4 + i / 4]);
        Self { points, is_rational: self.is_rational, place: [v, u] }
    }

    /// The same patch with a quarter of the rectangle: of the lower half along u for `i` = 0, along v for `j` = 0.
    pub fn quarter(&self, i: u32, j: u32) -> Self {
        let [u, v] = self.place;
        let half = |[level, index]: Interval, which: u32| [level + 1, 2 * index + which];
        Self { place: [half(u, i), half(v, j)], ..*self }
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

/// The intervals of a square: level, column and row.
pub fn intervals([level, column, row]: [u32; 3]) -> [Interval; 2] {
    [[level, column], [level, row]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::surface::cage::CageQuads;
    use crate::geom::surface::cage::tests::shapes::{Rng, fan, grid, tangle};
    use crate::geom::surface::dice::Quads;
    use crate::geom::surface::nurbs::NurbsQuads;
    use crate::geom::surface::nurbs::tests::{Owned, rng, sphere};
    use glam::DVec3;

    impl BicubicPatch {
        /// The point at (u, v) by de Casteljau's algorithm.
        pub(crate) fn point(&self, u: f64, v: f64) -> DVec3 {
            let line = |mut p: [DVec4; 4], t: f64| {
                for last in (0..3).rev() {
                    (0..=last).for_each(|i| p[i] = p[i].lerp(p[i + 1], t));
                }
                p[0]
            };
            let row = |row: usize| line(std::array::from_fn(|i| self.points[4 * row + i]), u);
            let p = line(std::array::from_fn(row), v);
            assert!(self.is_rational || p.w == 1.0);
            p.truncate() / p.w
        }
    }

    /// Compares patches with samples in squares of all levels up to 8. Returns the share of squares of each level that
    /// are parts of a patch.
    fn check<Q: Quads>(quads: &Q, rng: &mut Rng, size: f64) -> Vec<f64> {
        assert!(quads.has_bicubics());
        let mut shares = Vec::new();
        for level in 0..=8u32 {
            let (mut met, mut all) = (0, 0);
            for quad in 0..quads.count() {
                let place = [level, rng.below(1 << level), rng.below(1 << level)];
                all += 1;
                let Some(patch) = quads.bicubic(quad, place) else { continue };
                met += 1;
                for _ in 0..4 {
                    let (u, v) = (rng.unit(), rng.unit());
                    let at = |[x, y]: [Interval; 2]| {
                        let of = |[level, index]: Interval, t: f64| (f64::from(index) + t) / f64::from(1u32 << level);
                        (of(x, u), of(y, v))
                    };
                    let ((a, b), (c, d)) = (at(intervals(place)), at(patch.place));
                    assert!(patch.place.iter().all(|[level, index]| index >> level == 0), "{:?}", patch.place);
                    let (expected, found) = (quads.sample(quad, a, b).position, patch.point(c, d));
                    assert!(expected.distance(found) <= 1e-13 * size, "quad {quad}, {place:?}: {expected}, {found}");
                    let (found, turned) = (patch.point(c, d), patch.transposed());
                    assert!(turned.point(d, c).distance(found) <= 1e-14 * size);
                }
            }
            shares.push(f64::from(met) / f64::from(all.max(1)));
        }
        shares
    }

    #[test]
    fn patches_of_cages_have_their_points() {
        let mut rng = Rng(5);
        let mut shapes = vec![grid(6, &mut rng)];
        shapes.extend([3, 5, 8].map(|n| fan(n, 2, &mut rng)));
        shapes.extend((0..12).map(|_| tangle(&mut rng)));
        for shape in &shapes {
            let cage = shape.cage();
            let quads = CageQuads::new(&cage, &shape.points, None).expect("quads");
            let size = shape.points.iter().map(|p| p.length()).fold(0.0, f64::max);
            let shares = check(&quads, &mut rng, size);
            // Squares that are small are beside few vertices.
            assert!(shares[8] > 0.5, "{shares:?}");
        }
    }

    #[test]
    fn patches_of_nurbs_have_their_points() {
        let mut random = Rng(7);
        for number in 0..40 {
            let owned = if number == 0 { sphere() } else { Owned::random(&mut rng::Rng::new(number), 3, false) };
            let surface = owned.surface();
            let size = owned.points.iter().map(|p| p.length()).fold(1.0, f64::max);
            let domain = surface.domain();
            let part = domain.map(|[from, to]| [from + 0.3 * (to - from), from + 0.9 * (to - from)]);
            for domain in [None, Some(part)] {
                let shares = check(&NurbsQuads::new(&surface, domain), &mut random, 100.0 * size);
                assert!(shares.iter().all(|share| *share == 1.0));
            }
        }
    }
}
