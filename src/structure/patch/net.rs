//! Grids that are computed: the vertices are points of a bicubic Bézier patch, whose control points ("net") many grids
//! share. They have the same bits with all instruction sets and on all machines: sums and products are rounded one by
//! one, in one order.
//!
//! | words of a net | |
//! |---|---|
//! | 0 to 95 | x of the control points relative to the tree's origin times their weights, then y, then z (f64, low word |
//! | | first), rows along u |
//! | 96 to 127 | their weights, if the patch is rational |

#![allow(clippy::needless_range_loop)] // rows, columns and axes index several arrays at once

use super::layout::{MOST_PLACE, of_morton};
use crate::simd::{Doubles, Simd};
use glam::{DVec3, Vec3};

/// Words of a net that is not rational.
pub const NET_WORDS: usize = 96;
/// Words of a rational net.
pub const RATIONAL_WORDS: usize = 128;
/// Words of a correction: number of the vertex and its coordinates.
pub const CORRECTION_WORDS: usize = 4;
/// Greatest magnitude of a coordinate of a control point, and of a weight and its reciprocal.
const GREATEST: f64 = 1e30;

/// The control points of a patch.
#[derive(Debug, Clone, Copy)]
pub struct Net<'a>(&'a [u32]);

/// The grid of a part of a patch.
#[derive(Debug, Clone, Copy)]
pub struct Computed<'a> {
    /// The patch.
    pub net: Net<'a>,
    /// First word of the net in the leaf block.
    pub net_at: u32,
    /// The intervals of the grid's square along u and v of the patch: level, and index there.
    pub place: [[u32; 2]; 2],
    /// By how many levels the edges at v = 0, v = 1, u = 0 and u = 1 are coarser than the grid, four bits each.
    pub steps: u32,
    /// Vertices that differ from those of the patch, by ascending numbers: [`CORRECTION_WORDS`] each.
    pub corrections: &'a [[u32; CORRECTION_WORDS]],
}

/// Weights of the four Bézier points of a cubic at `t`.
#[inline(always)]
fn weights(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    let (tt, ss) = (t * t, s * s);
    [ss * s, 3.0 * (ss * t), 3.0 * (tt * s), tt * t]
}

/// Derivatives of [`weights`].
fn slopes(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [-3.0 * s * s, 3.0 * s * (s - 2.0 * t), 3.0 * t * (2.0 * s - t), 3.0 * t * t]
}

/// Second derivatives of [`weights`].
fn bends(t: f64) -> [f64; 4] {
    [6.0 - 6.0 * t, 18.0 * t - 12.0, 6.0 - 18.0 * t, 6.0 * t]
}

impl<'a> Net<'a> {
    /// The net at the start of some words.
    #[inline(always)]
    pub fn at(words: &'a [u32], is_rational: bool) -> Option<Self> {
        words.get(..if is_rational { RATIONAL_WORDS } else { NET_WORDS }).map(Self)
    }

    /// True if it has weights.
    #[inline(always)]
    pub fn is_rational(self) -> bool {
        self.0.len() == RATIONAL_WORDS
    }

    /// Row `row` of the numbers of an axis: 0 to 2 coordinates, 3 weights.
    #[inline(always)]
    fn row(self, axis: usize, row: usize) -> [f64; 4] {
        let mut out = [0.0; 4];
        if let Some(words) = self.0.get(32 * axis + 8 * row..).and_then(|words| words.first_chunk::<8>()) {
            for column in 0..4 {
                let (low, high) = (words[2 * column], words[2 * column + 1]);
                out[column] = f64::from_bits(u64::from(low) | u64::from(high) << 32);
            }
        }
        out
    }

    /// The weighted sum of the numbers of an axis.
    #[inline(always)]
    fn sum(self, axis: usize, along_u: &[f64; 4], along_v: &[f64; 4]) -> f64 {
        let (a, b, c, d) = (self.row(axis, 0), self.row(axis, 1), self.row(axis, 2), self.row(axis, 3));
        let mut line = [0.0; 4];
        for i in 0..4 {
            line[i] = a[i] * along_v[0] + b[i] * along_v[1] + c[i] * along_v[2] + d[i] * along_v[3];
        }
        line[0] * along_u[0] + line[1] * along_u[1] + line[2] * along_u[2] + line[3] * along_u[3]
    }

    /// The point at (u, v).
    #[inline(always)]
    pub fn point(self, u: f64, v: f64) -> Vec3 {
        let (along_u, along_v) = (weights(u), weights(v));
        let mut at = [0.0; 3];
        for (axis, at) in at.iter_mut().enumerate() {
            *at = self.sum(axis, &along_u, &along_v);
        }
        if self.is_rational() {
            let over = 1.0 / self.sum(3, &along_u, &along_v);
            at = [at[0] * over, at[1] * over, at[2] * over];
        }
        Vec3::new(at[0] as f32, at[1] as f32, at[2] as f32)
    }

    /// The point at (u, v), and derivatives: first by u and v, second by u, by both and by v.
    pub fn derivatives(self, u: f64, v: f64) -> [DVec3; 6] {
        let (bu, bv) = ([weights(u), slopes(u), bends(u)], [weights(v), slopes(v), bends(v)]);
        let of = |i: usize, j: usize| {
            let axis = |axis: usize| self.sum(axis, &bu[i], &bv[j]);
            let weight = if self.is_rational() { axis(3) } else { f64::from(u8::from(i + j == 0)) };
            (DVec3::new(axis(0), axis(1), axis(2)), weight)
        };
        let [(a, w), (au, wu), (av, wv), (auu, wuu), (auv, wuv), (avv, wvv)] =
            [of(0, 0), of(1, 0), of(0, 1), of(2, 0), of(1, 1), of(0, 2)];
        // The quotient rule (The NURBS Book, equation 4.20).
        let p = a / w;
        let (pu, pv) = ((au - p * wu) / w, (av - p * wv) / w);
        let puu = (auu - pu * (2.0 * wu) - p * wuu) / w;
        let puv = (auv - pu * wv - pv * wu - p * wuv) / w;
        [p, pu, pv, puu, puv, (avv - pv * (2.0 * wv) - p * wvv) / w]
    }

    /// Points and unit normals, zero where there are none, at parameters along u for one of v; to the bit those of
    /// [`Self::point`].
    pub fn row_of(self, u: impl Iterator<Item = f64>, v: f64, mut emit: impl FnMut(Vec3, Vec3)) {
        let (values, slopes_v) = (weights(v), slopes(v));
        // The curve along u, and the derivatives by v along it.
        let mut curves = [[[0.0; 4]; 4]; 2];
        for axis in 0..4 {
            let rows = [self.row(axis, 0), self.row(axis, 1), self.row(axis, 2), self.row(axis, 3)];
            for (curve, by) in curves.iter_mut().zip([&values, &slopes_v]) {
                for i in 0..4 {
                    curve[axis][i] = rows[0][i] * by[0] + rows[1][i] * by[1] + rows[2][i] * by[2] + rows[3][i] * by[3];
                }
            }
        }
        let sum =
            |line: &[f64; 4], by: &[f64; 4]| line[0] * by[0] + line[1] * by[1] + line[2] * by[2] + line[3] * by[3];
        for u in u {
            let (bu, su) = (weights(u), slopes(u));
            let all = |curve: &[[f64; 4]; 4], by: &[f64; 4]| {
                DVec3::new(sum(&curve[0], by), sum(&curve[1], by), sum(&curve[2], by))
            };
            let (mut at, mut du, mut dv) = (all(&curves[0], &bu), all(&curves[0], &su), all(&curves[1], &bu));
            if self.is_rational() {
                let over = 1.0 / sum(&curves[0][3], &bu);
                at *= over;
                // The lengths of derivatives do not matter.
                du -= at * sum(&curves[0][3], &su);
                dv -= at * sum(&curves[1][3], &bu);
            }
            emit(at.as_vec3(), du.cross(dv).normalize_or_zero().as_vec3());
        }
    }

    /// The points at all pairs of three parameters along u and three along v; `u` and `v` end with any fourth one. By
    /// axis, then rows along u; to the bit those of [`Self::point`].
    #[inline(always)]
    fn nine<S: Simd>(self, s: S, u: [f64; 4], v: [f64; 4]) -> [[f32; 16]; 3] {
        // No closures here: they are compiled without the instruction set.
        let (along_u, along_v) = (four_weights(s, u), four_weights(s, v));
        let along_v = [along_v[0].to_array(), along_v[1].to_array(), along_v[2].to_array(), along_v[3].to_array()];
        let one = s.splat_d4(1.0);
        let mut over = [one; 3];
        if self.is_rational() {
            let sums = self.three(s, 3, &along_u, &along_v);
            for row in 0..3 {
                let sum = sums[row].to_array();
                over[row] = s.load_d4(&[1.0 / sum[0], 1.0 / sum[1], 1.0 / sum[2], 1.0]);
            }
        }
        let mut out = [[0.0f32; 16]; 3];
        for axis in 0..3 {
            let sums = self.three(s, axis, &along_u, &along_v);
            for row in 0..3 {
                // A product with 1 changes nothing.
                let sum = (sums[row] * over[row]).to_array();
                for column in 0..3 {
                    out[axis][3 * row + column] = sum[column] as f32;
                }
            }
        }
        out
    }

    /// The weighted sums of the numbers of an axis: three rows of three.
    #[inline(always)]
    fn three<S: Simd>(self, s: S, axis: usize, along_u: &[S::D4; 4], along_v: &[[f64; 4]; 4]) -> [S::D4; 3] {
        let rows = [
            s.load_d4(&self.row(axis, 0)),
            s.load_d4(&self.row(axis, 1)),
            s.load_d4(&self.row(axis, 2)),
            s.load_d4(&self.row(axis, 3)),
        ];
        let mut out = [along_u[0]; 3];
        for row in 0..3 {
            let line = rows[0] * s.splat_d4(along_v[0][row])
                + rows[1] * s.splat_d4(along_v[1][row])
                + rows[2] * s.splat_d4(along_v[2][row])
                + rows[3] * s.splat_d4(along_v[3][row]);
            let line = line.to_array();
            out[row] = s.splat_d4(line[0]) * along_u[0]
                + s.splat_d4(line[1]) * along_u[1]
                + s.splat_d4(line[2]) * along_u[2]
                + s.splat_d4(line[3]) * along_u[3];
        }
        out
    }

    /// Checks the numbers. Fails with the fault.
    pub fn check(self) -> Result<(), String> {
        let is_sound = (0..16).all(|at| {
            let number = |axis: usize| self.row(axis, at / 4)[at % 4];
            let weight = if self.is_rational() { number(3) } else { 1.0 };
            let is_weight = (1.0 / GREATEST..GREATEST).contains(&weight);
            is_weight && (0..3).all(|axis| (number(axis) / weight).abs() < GREATEST)
        });
        if is_sound { Ok(()) } else { Err("a control point or a weight is out of range".into()) }
    }
}

/// [`weights`] at four parameters.
#[inline(always)]
fn four_weights<S: Simd>(s: S, t: [f64; 4]) -> [S::D4; 4] {
    let (t, one, three) = (s.load_d4(&t), s.splat_d4(1.0), s.splat_d4(3.0));
    let r = one - t;
    let (tt, rr) = (t * t, r * r);
    [rr * r, three * (rr * t), three * (tt * r), tt * t]
}

impl Computed<'_> {
    /// The column and the row on the patch of a vertex of a grid with 2^level cells along a side: at sides whose edges
    /// are coarser, those of the nearest point of the edge.
    #[inline(always)]
    pub fn index(&self, level: u32, i: usize, j: usize) -> [usize; 2] {
        let (mut at, last) = ([i, j], 1usize << level);
        if self.steps != 0 {
            for (side, is_on) in [j == 0, j == last, i == 0, i == last].into_iter().enumerate() {
                let step = 1usize << (self.steps >> (4 * side) & 15);
                let along = side / 2;
                if is_on && step > 1 {
                    at[along] = ((at[along] + step / 2) / step * step).min(last);
                }
            }
        }
        at
    }

    /// The parameter in the patch of an index along an axis of the grid: 0 column, 1 row.
    #[inline(always)]
    fn parameter(&self, level: u32, axis: usize, index: usize) -> f64 {
        let [above, at] = self.place[axis];
        let first = (at as usize) << level;
        (first + index) as f64 * scale_of(above + level)
    }

    /// The parameters in the patch of a vertex.
    #[inline(always)]
    pub fn parameters(&self, level: u32, i: usize, j: usize) -> [f64; 2] {
        let [i, j] = self.index(level, i, j);
        [self.parameter(level, 0, i), self.parameter(level, 1, j)]
    }

    /// Vertices and unit normals within a row of a grid of a level, without those at both ends.
    pub fn inner_row(&self, level: u32, j: usize, emit: impl FnMut(Vec3, Vec3)) {
        let u = (1..1 << level).map(|i| self.parameter(level, 0, i));
        self.net.row_of(u, self.parameter(level, 1, j), emit);
    }

    /// A vertex of a grid of a level.
    #[inline(always)]
    pub fn vertex(&self, level: u32, i: usize, j: usize) -> Vec3 {
        if !self.corrections.is_empty() {
            let number = (j * ((1 << level) + 1) + i) as u32;
            if let Ok(at) = self.corrections.binary_search_by_key(&number, |it| it[0]) {
                let [_, x, y, z] = self.corrections[at].map(f32::from_bits);
                return Vec3::new(x, y, z);
            }
        }
        let [u, v] = self.parameters(level, i, j);
        self.net.point(u, v)
    }

    /// The unit normal at a vertex along du × dv; zero where there is none.
    pub fn normal(&self, level: u32, i: usize, j: usize) -> Vec3 {
        let [u, v] = self.parameters(level, i, j);
        let mut found = Vec3::ZERO;
        self.net.row_of(std::iter::once(u), v, |_, normal| found = normal);
        found
    }

    /// The nine vertices of a leaf of the quadtree of a grid, by axis, then rows along u.
    #[inline(always)]
    pub fn nine<S: Simd>(&self, s: S, level: u32, leaf: usize) -> [[f32; 16]; 3] {
        let (i, j) = of_morton(leaf);
        let (i, j) = (2 * i, 2 * j);
        let (mut u, mut v) = ([0.0; 4], [0.0; 4]);
        for at in 0..3 {
            (u[at], v[at]) = (self.parameter(level, 0, i + at), self.parameter(level, 1, j + at));
        }
        let mut nine = self.net.nine(s, u, v);
        if self.steps != 0 || !self.corrections.is_empty() {
            self.correct(level, i, j, &mut nine);
        }
        nine
    }

    /// Replaces the vertices of a leaf that are not on the patch, or not at their own parameters.
    #[cold]
    fn correct(&self, level: u32, i: usize, j: usize, nine: &mut [[f32; 16]; 3]) {
        for at in 0..9 {
            let vertex = self.vertex(level, i + at % 3, j + at / 3);
            for axis in 0..3 {
                nine[axis][at] = vertex[axis];
            }
        }
    }
}

/// 2 to the power of a negative exponent.
#[inline(always)]
fn scale_of(exponent: u32) -> f64 {
    f64::from_bits(u64::from(1023 - (exponent & 63)) << 52)
}

/// Checks a computed grid of a level. Fails with the fault.
pub fn check(grid: &Computed, level: u32) -> Result<(), String> {
    if grid.place.iter().any(|[above, index]| *above > MOST_PLACE || index >> above != 0) {
        return Err("the place of a grid is not in the square of its patch".into());
    }
    if (0..4).any(|side| grid.steps >> (4 * side) & 15 > level) {
        return Err("an edge of a grid is coarser than the whole grid".into());
    }
    let vertices = ((1u32 << level) + 1).pow(2);
    let numbers = grid.corrections.iter().map(|it| it[0]);
    if !numbers.clone().is_sorted_by(|a, b| a < b) || numbers.clone().any(|number| number >= vertices) {
        return Err("the corrections of a grid are not in order".into());
    }
    let is_finite = grid.corrections.as_flattened().chunks_exact(4);
    match is_finite.flat_map(|it| &it[1..]).all(|word| f32::from_bits(*word).is_finite()) {
        true => Ok(()),
        false => Err("a vertex is not finite".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::surface::dice::BicubicPatch;
    use crate::simd::{Isa, Op, dispatch};
    use crate::structure::patch::build::words_of;
    use proptest::prelude::*;

    /// A patch of any control points, with its place.
    fn patch(numbers: &[f64], is_rational: bool, place: [[u32; 2]; 2]) -> BicubicPatch {
        let weight = |i: usize| if is_rational { 0.5 + numbers[48 + i].abs() } else { 1.0 };
        let point = |i: usize| DVec3::from_slice(&numbers[3 * i..]) * weight(i);
        BicubicPatch { points: std::array::from_fn(|i| point(i).extend(weight(i))), is_rational, place }
    }

    struct Nine<'a>(Computed<'a>, u32, usize);

    impl Op for Nine<'_> {
        type Out = [[f32; 16]; 3];
        fn run<S: Simd>(self, s: S) -> Self::Out {
            self.0.nine(s, self.1, self.2)
        }
    }

    proptest! {
        #[test]
        fn leaves_have_the_vertices_to_the_bit(
            numbers in prop::collection::vec(-2.0f64..2.0, 64),
            is_rational: bool,
            (level, leaf, steps) in (1u32..=5, 0usize..256, prop::array::uniform4(0u32..3)),
            fix in prop::option::of(0u32..1089),
        ) {
            let patch = patch(&numbers, is_rational, [[3, 5], [2, 1]]);
            let words = words_of(&patch);
            let leaf = leaf % (1 << (2 * (level - 1)));
            let steps = (0..4).map(|side| steps[side].min(level) << (4 * side)).sum();
            let vertices = ((1 << level) + 1) * ((1 << level) + 1);
            let fixes: Vec<_> = fix.into_iter().map(|at| [at % vertices, 1f32.to_bits(), 0, 0]).collect();
            let net = Net::at(&words, is_rational).unwrap();
            net.check().unwrap();
            let computed = Computed { net, net_at: 0, place: patch.place, steps, corrections: &fixes };
            let (i, j) = of_morton(leaf);
            for isa in Isa::ALL {
                let nine = dispatch(isa, Nine(computed, level, leaf));
                for at in 0..9 {
                    let vertex = computed.vertex(level, 2 * i + at % 3, 2 * j + at / 3);
                    let found = [0, 1, 2].map(|axis| nine[axis][at].to_bits());
                    prop_assert_eq!(found, vertex.to_array().map(f32::to_bits));
                }
            }
        }

        #[test]
        fn points_and_derivatives(
            numbers in prop::collection::vec(-2.0f64..2.0, 64),
            is_rational: bool,
            (u, v) in (0.01f64..0.99, 0.01f64..0.99),
        ) {
            let patch = patch(&numbers, is_rational, [[0; 2]; 2]);
            let words = words_of(&patch);
            let net = Net::at(&words, is_rational).unwrap();
            let at = |u: f64, v: f64| patch.point(u, v);
            let [p, du, dv, duu, duv, dvv] = net.derivatives(u, v);
            prop_assert!(p.distance(at(u, v)) < 1e-13);
            prop_assert!(net.point(u, v).as_dvec3().distance(p) < 1e-6);
            let h = 1e-4;
            let first = [(at(u + h, v) - at(u - h, v)) / (2.0 * h), (at(u, v + h) - at(u, v - h)) / (2.0 * h)];
            let second = [
                (at(u + h, v) - 2.0 * p + at(u - h, v)) / (h * h),
                (at(u + h, v + h) - at(u + h, v - h) - at(u - h, v + h) + at(u - h, v - h)) / (4.0 * h * h),
                (at(u, v + h) - 2.0 * p + at(u, v - h)) / (h * h),
            ];
            for (found, expected) in [du, dv, duu, duv, dvv].into_iter().zip(first.into_iter().chain(second)) {
                prop_assert!(found.distance(expected) < 1e-4 * (1.0 + expected.length()), "{found} {expected}");
            }
        }
    }
}
