//! The relations of one triangle to many: a filter that decides eight at a time in double precision, and exact signs
//! for the rest.
//!
//! The filter decides as [`super::pairs`] does, wherever each sign is beyond a bound of its rounding error.
//! Coordinates are relative to the middle of the lot, and one bound holds for all signs of a kind in a lot. The set of
//! instructions may change which pairs it decides, but no relation.

use super::pairs::{Relation, relate};
use super::signs::{FILTER, Plane, TINY};
use crate::simd::{Doubles, Isa, Mask, Op, Simd, dispatch};
use glam::DVec3;

/// Triangles in a [`Lot`].
pub const LANES: usize = 8;

/// Vectors for a number of each triangle.
const HALVES: usize = LANES / 4;

type Lanes = [[f64; 4]; HALVES];

/// Up to eight triangles, by lanes.
#[derive(Debug, Clone, Copy)]
pub struct Lot {
    /// Coordinates relative to `middle`, by corner and axis.
    corners: [[Lanes; 3]; 3],
    /// Normals, by axis, and their dot products with the first corners, with the opposite sign.
    normals: [Lanes; 3],
    offsets: Lanes,
    /// Boxes, by axis; not relative.
    low: [Lanes; 3],
    high: [Lanes; 3],
    middle: [f64; 4],
    /// Greatest distances of corners from `middle`, and greatest weights of normals, by axis.
    reach: [f64; 4],
    weight: [f64; 4],
    triangles: [[DVec3; 3]; LANES],
    count: usize,
}

/// Corners of eight triangles, by corner and axis.
pub type Eight = [[[f64; LANES]; 3]; 3];

impl Lot {
    const EMPTY: Self = {
        const NONE: Lanes = [[0.0; 4]; HALVES];
        Self {
            corners: [[NONE; 3]; 3],
            normals: [NONE; 3],
            offsets: NONE,
            low: [NONE; 3],
            high: [NONE; 3],
            middle: [0.0; 4],
            reach: [0.0; 4],
            weight: [0.0; 4],
            triangles: [[DVec3::ZERO; 3]; LANES],
            count: 0,
        }
    };

    /// The same as [`Lot::new`], of up to eight triangles whose corners and boxes are given by lanes. Lanes behind the
    /// last triangle may hold anything.
    #[inline(always)]
    pub fn of_lanes(triangles: &[[DVec3; 3]], at: &Eight, [low, high]: &[[[f64; LANES]; 3]; 2]) -> Self {
        let count = triangles.len().min(LANES);
        let mut lot = Self { count, ..Self::EMPTY };
        lot.triangles[..count].copy_from_slice(&triangles[..count]);
        // Of lanes behind the last: nothing.
        let of = |i: usize, x: f64| if i < count { x } else { 0.0 };
        for axis in 0..3 {
            let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
            for i in 0..count {
                (least, greatest) = (least.min(low[axis][i]), greatest.max(high[axis][i]));
            }
            let middle = if count > 0 { least * 0.5 + greatest * 0.5 } else { 0.0 };
            let (lows, highs) = (lot.low[axis].as_flattened_mut(), lot.high[axis].as_flattened_mut());
            for i in 0..LANES {
                (lows[i], highs[i]) = (of(i, low[axis][i]), of(i, high[axis][i]));
            }
            let mut reach = 0.0f64;
            for (out, at) in lot.corners.iter_mut().zip(at) {
                let out = out[axis].as_flattened_mut();
                for i in 0..LANES {
                    out[i] = of(i, at[axis][i] - middle);
                    reach = if out[i].abs() > reach { out[i].abs() } else { reach };
                }
            }
            (lot.middle[axis], lot.reach[axis]) = (middle, reach);
        }
        for axis in 0..3 {
            let (y, z) = ((axis + 1) % 3, (axis + 2) % 3);
            let out = lot.normals[axis].as_flattened_mut();
            let mut weight = 0.0f64;
            for i in 0..LANES {
                let u = [at[1][y][i] - at[0][y][i], at[1][z][i] - at[0][z][i]];
                let v = [at[2][y][i] - at[0][y][i], at[2][z][i] - at[0][z][i]];
                let (first, second) = (u[0] * v[1], u[1] * v[0]);
                out[i] = of(i, first - second);
                let own = of(i, first.abs() + second.abs());
                weight = if own > weight { own } else { weight };
            }
            lot.weight[axis] = weight;
        }
        let [x, y, z] = &lot.corners[0];
        let [nx, ny, nz] = &lot.normals;
        for half in 0..HALVES {
            for i in 0..4 {
                lot.offsets[half][i] =
                    -(nx[half][i] * x[half][i] + ny[half][i] * y[half][i] + nz[half][i] * z[half][i]);
            }
        }
        lot
    }

    /// The first eight of `triangles`, or all if they are fewer.
    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let count = triangles.len().min(LANES);
        let mut lot = Self { count, ..Self::EMPTY };
        lot.triangles[..count].copy_from_slice(&triangles[..count]);
        let (mut least, mut greatest) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (lane, [a, b, c]) in triangles.iter().take(LANES).enumerate() {
            let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
            (least, greatest) = (least.min(low), greatest.max(high));
            put(&mut lot.low, lane, low);
            put(&mut lot.high, lane, high);
        }
        let middle = if count > 0 { least * 0.5 + greatest * 0.5 } else { DVec3::ZERO };
        let (mut reach, mut weight) = (DVec3::ZERO, DVec3::ZERO);
        for (lane, t) in triangles.iter().take(LANES).enumerate() {
            let plane = Plane::new(t);
            weight = weight.max(plane.weight);
            put(&mut lot.normals, lane, plane.normal);
            for (out, p) in lot.corners.iter_mut().zip(t) {
                let relative = *p - middle;
                reach = reach.max(relative.abs());
                put(out, lane, relative);
            }
            lot.offsets[lane / 4][lane % 4] = -plane.normal.dot(t[0] - middle);
        }
        (lot.middle, lot.reach, lot.weight) = (four(middle), four(reach), four(weight));
        lot
    }

    /// The triangles.
    #[inline]
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.triangles[..self.count]
    }
}

#[inline(always)]
fn put(out: &mut [Lanes; 3], lane: usize, v: DVec3) {
    let (half, lane) = (lane / 4, lane % 4);
    (out[0][half][lane], out[1][half][lane], out[2][half][lane]) = (v.x, v.y, v.z);
}

#[inline(always)]
fn four(v: DVec3) -> [f64; 4] {
    [v.x, v.y, v.z, 0.0]
}

/// A triangle, prepared for the filter. The last of four numbers is zero.
#[derive(Debug, Clone, Copy)]
pub struct One {
    corners: [[f64; 4]; 3],
    normal: [f64; 4],
    /// As in [`Plane`].
    weight: [f64; 4],
    low: [f64; 4],
    high: [f64; 4],
}

impl One {
    /// Prepares a triangle.
    pub fn new(corners: &[DVec3; 3]) -> Self {
        let ([a, b, c], plane) = (*corners, Plane::new(corners));
        Self {
            corners: [four(a), four(b), four(c)],
            normal: four(plane.normal),
            weight: four(plane.weight),
            low: four(a.min(b).min(c)),
            high: four(a.max(b).max(c)),
        }
    }
}

/// The lanes that the filter has decided (bit `i`: lane `i`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sifted {
    /// [`Relation::Apart`].
    pub apart: u32,
    /// [`Relation::Crossing`].
    pub crossing: u32,
}

/// Decides what rounded arithmetic can of the lanes in `among`.
#[inline(always)]
pub fn sift<S: Simd>(s: S, one: &One, lot: &Lot, among: u32) -> Sifted {
    let all = among & ((1 << lot.count) - 1);
    let mut apart = beside(s, one, lot);
    if apart & all == all {
        return Sifted { apart: all, crossing: 0 };
    }
    // The others need no work.
    apart |= !all;
    // Axes by lanes.
    let middle = s.load_d4(&lot.middle);
    let [a, b, c] = [s.load_d4(&one.corners[0]), s.load_d4(&one.corners[1]), s.load_d4(&one.corners[2])];
    let (a, b, c) = (a - middle, b - middle, c - middle);
    let reach = a.abs().max(b.abs()).max(c.abs()).max(s.load_d4(&lot.reach)).to_array();
    let own = [a.to_array(), b.to_array(), c.to_array()];
    // A volume is a difference of two sums of weights times coordinates, each product of which passes through at most 9
    // roundings, as in `signs::FILTER`.
    let bound_of_lot = dot_of(one.weight, reach) * (2.0 * FILTER) + TINY;
    let bound_of_one = dot_of(lot.weight, reach) * (2.0 * FILTER) + TINY;
    let (n, offset) = (splat(s, one.normal), s.splat_d4(-dot_of(one.normal, own[0])));
    let mut of_lot = [[s.splat_d4(0.0); 3]; HALVES];
    for (half, of_lot) in of_lot.iter_mut().enumerate() {
        *of_lot = volumes(n, offset, corners(s, lot, half));
        apart |= aside(*of_lot, s.splat_d4(bound_of_lot), s.splat_d4(-bound_of_lot)) << (4 * half);
    }
    if apart & all == all {
        return Sifted { apart: all, crossing: 0 };
    }
    let own = [splat(s, own[0]), splat(s, own[1]), splat(s, own[2])];
    let mut of_one = [[s.splat_d4(0.0); 3]; HALVES];
    for (half, of_one) in of_one.iter_mut().enumerate() {
        *of_one = volumes(load(s, &lot.normals, half), s.load_d4(&lot.offsets[half]), own);
        apart |= aside(*of_one, s.splat_d4(bound_of_one), s.splat_d4(-bound_of_one)) << (4 * half);
    }
    // Six products of three differences, each at most twice the reach and with an error of twice a rounding of that;
    // 5 more roundings. 6 · 8 · 11 is less than 60 times the 10 of `FILTER`.
    let bound = reach[0] * reach[1] * reach[2] * (60.0 * FILTER) + TINY;
    let mut crossing = 0;
    for half in 0..HALVES {
        if apart >> (4 * half) & 15 == 15 {
            continue;
        }
        let certain = beyond(of_lot[half], s.splat_d4(bound_of_lot)) & beyond(of_one[half], s.splat_d4(bound_of_one));
        let chords = chords(s, own, corners(s, lot, half), of_one[half], of_lot[half], bound);
        apart |= (chords.apart & certain) << (4 * half);
        crossing |= (chords.crossing & certain) << (4 * half);
    }
    Sifted { apart: apart & all, crossing: crossing & !apart & all }
}

#[inline(always)]
fn dot_of(a: [f64; 4], b: [f64; 4]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn splat<S: Simd>(s: S, v: [f64; 4]) -> [S::D4; 3] {
    [s.splat_d4(v[0]), s.splat_d4(v[1]), s.splat_d4(v[2])]
}

#[inline(always)]
fn load<S: Simd>(s: S, v: &[Lanes; 3], half: usize) -> [S::D4; 3] {
    [s.load_d4(&v[0][half]), s.load_d4(&v[1][half]), s.load_d4(&v[2][half])]
}

#[inline(always)]
fn corners<S: Simd>(s: S, lot: &Lot, half: usize) -> [[S::D4; 3]; 3] {
    [load(s, &lot.corners[0], half), load(s, &lot.corners[1], half), load(s, &lot.corners[2], half)]
}

/// The lanes whose boxes are apart from that of the triangle.
#[inline(always)]
fn beside<S: Simd>(s: S, one: &One, lot: &Lot) -> u32 {
    let (low, high) = (splat(s, one.low), splat(s, one.high));
    let mut apart = 0;
    for half in 0..HALVES {
        let (least, greatest) = (load(s, &lot.low, half), load(s, &lot.high, half));
        let x = high[0].lt(least[0]).or(greatest[0].lt(low[0]));
        let y = high[1].lt(least[1]).or(greatest[1].lt(low[1]));
        let z = high[2].lt(least[2]).or(greatest[2].lt(low[2]));
        apart |= x.or(y).or(z).bits() << (4 * half);
    }
    apart
}

/// The volumes of three corners over planes.
#[inline(always)]
fn volumes<V: Doubles>(n: [V; 3], offset: V, [a, b, c]: [[V; 3]; 3]) -> [V; 3] {
    [dot_plus(n, a, offset), dot_plus(n, b, offset), dot_plus(n, c, offset)]
}

#[inline(always)]
fn dot_plus<V: Doubles>(a: [V; 3], b: [V; 3], plus: V) -> V {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2].mul_add(b[2], plus)))
}

/// The lanes in which all volumes are beyond the bound on one side. `below`: the bound with the opposite sign.
#[inline(always)]
fn aside<V: Doubles>([a, b, c]: [V; 3], bound: V, below: V) -> u32 {
    bound.lt(a.min(b).min(c)).or(a.max(b).max(c).lt(below)).bits()
}

/// The lanes in which all volumes are beyond the bound.
#[inline(always)]
fn beyond<V: Doubles>([a, b, c]: [V; 3], bound: V) -> u32 {
    bound.lt(a.abs().min(b.abs()).min(c.abs())).bits()
}

/// `yes` or `no`, by axis.
#[inline(always)]
fn pick<V: Doubles>(mask: V::Mask, yes: [V; 3], no: [V; 3]) -> [V; 3] {
    [yes[0].select(mask, no[0]), yes[1].select(mask, no[1]), yes[2].select(mask, no[2])]
}

/// The corners turned so that the one alone on its side is first, and its volume. The volumes are beyond the bound, so
/// that their products do not vanish, and not all on one side.
#[inline(always)]
fn alone_first<V: Doubles>([a, b, c]: [[V; 3]; 3], [i, j, k]: [V; 3], zero: V) -> ([[V; 3]; 3], V) {
    let (is_first, is_second) = (zero.lt(j * k), zero.lt(i * k));
    let p = pick(is_first, a, pick(is_second, b, c));
    let q = pick(is_first, b, pick(is_second, c, a));
    let r = pick(is_first, c, pick(is_second, a, b));
    ([p, q, r], i.select(is_first, j.select(is_second, k)))
}

#[inline(always)]
fn minus<V: Doubles>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The volume that three edges span.
#[inline(always)]
fn volume<V: Doubles>(u: [V; 3], v: [V; 3], w: [V; 3]) -> V {
    let x = u[2].negated_mul_add(v[1], u[1] * v[2]);
    let y = u[0].negated_mul_add(v[2], u[2] * v[0]);
    let z = u[1].negated_mul_add(v[0], u[0] * v[1]);
    x.mul_add(w[0], y.mul_add(w[1], z * w[2]))
}

/// The order of the ends of the segments that both planes have in common, of four pairs of triangles; only for pairs
/// where the sides of corners are certain.
#[inline(always)]
fn chords<S: Simd>(
    s: S,
    own: [[S::D4; 3]; 3],
    others: [[S::D4; 3]; 3],
    of_one: [S::D4; 3],
    of_lot: [S::D4; 3],
    bound: f64,
) -> Sifted {
    let (zero, above, below) = (s.splat_d4(0.0), s.splat_d4(bound), s.splat_d4(-bound));
    let ([p, q, r], height_of_one) = alone_first(own, of_one, zero);
    let ([k, l, m], height_of_lot) = alone_first(others, of_lot, zero);
    // As in `pairs`, corners are swapped where the other's corner alone is below. Swapping two in both changes but the
    // signs: one swap is enough.
    let are_alike = zero.lt(height_of_one * height_of_lot);
    let (l, m) = (pick(are_alike, l, m), pick(are_alike, m, l));
    let to_k = minus(k, p);
    let (first, last) = (volume(minus(q, p), to_k, minus(l, p)), volume(minus(r, p), to_k, minus(m, p)));
    let is_above = zero.lt(height_of_lot);
    let (first, last) = (first.select(is_above, zero - first), last.select(is_above, zero - last));
    let apart = above.lt(first).or(last.lt(below));
    let crossing = first.lt(below).and(above.lt(last));
    Sifted { apart: apart.bits(), crossing: crossing.bits() }
}

/// [`sift`] of one triangle and several lots.
struct Sift<'a> {
    one: &'a One,
    lots: &'a [Lot],
    out: &'a mut [Sifted],
}

impl Op for Sift<'_> {
    type Out = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        for (lot, out) in self.lots.iter().zip(self.out) {
            *out = sift(s, self.one, lot, u32::MAX);
        }
    }
}

/// Calls `found` with the lot, the lane and the relation of each triangle that is not apart from `triangle`, in order.
pub fn relate_many(isa: Isa, triangle: &[DVec3; 3], lots: &[Lot], mut found: impl FnMut(usize, usize, Relation)) {
    let one = One::new(triangle);
    // The choice of a set costs more than a lot.
    let mut sifted = [Sifted::default(); 16];
    for (chunk, lots) in lots.chunks(sifted.len()).enumerate() {
        dispatch(isa, Sift { one: &one, lots, out: &mut sifted });
        for (i, (lot, sifted)) in lots.iter().zip(&sifted).enumerate() {
            let mut left = !sifted.apart & ((1 << lot.count) - 1);
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let is_crossing = sifted.crossing >> lane & 1 == 1;
                let relation = if is_crossing { Relation::Crossing } else { relate(triangle, &lot.triangles[lane]) };
                if relation != Relation::Apart {
                    found(chunk * 16 + i, lane, relation);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::pairs_tests::Random;
    use super::*;
    use crate::simd::Portable;

    /// Random triangles: on a small grid, in general position, almost in one plane.
    fn triangles(random: &mut Random, kind: usize, count: usize) -> Vec<[DVec3; 3]> {
        let mut corner = || match kind {
            0 => DVec3::from([0; 3].map(|_| random.below(4) as f64)),
            1 => DVec3::from([0; 3].map(|_| random.unit())),
            // Sizes from 10^-6 to 1, far from zero.
            3 => {
                let size = 1e-6f64.powf(random.unit());
                DVec3::splat(1e7) + DVec3::from([0; 3].map(|_| random.unit() * size))
            }
            4 => DVec3::from([0; 3].map(|_| [0.0, 1e150, -1e150, 1e100, 1.0][random.below(5) as usize])),
            _ => DVec3::new(random.unit(), random.unit(), random.below(3) as f64 * 1e-15 - 0.3),
        };
        (0..count).map(|_| [corner(), corner(), corner()]).collect()
    }

    /// Triangles with an edge through points of the edges of another, up to rounding.
    fn at_edges(random: &mut Random, one: &[DVec3; 3], count: usize) -> Vec<[DVec3; 3]> {
        let mut vector = || DVec3::from([0; 3].map(|_| random.unit() - 0.5));
        let at = |i: usize, place: f64| one[i % 3] + (one[(i + 1) % 3] - one[i % 3]) * place;
        let through = |p: DVec3, d: DVec3, e: DVec3| [p + d, p - d, p + e];
        (0..count).map(|i| through(at(i, vector().x + 0.5), vector(), vector())).collect()
    }

    /// Of lanes, some of which hold no triangle.
    #[test]
    fn lots_of_lanes_are_lots_of_triangles() {
        let mut random = Random(2);
        for round in 0..2000 {
            let count = random.below(LANES as u64 + 1) as usize;
            let all = triangles(&mut random, [0, 1, 3][round % 3], count);
            let lane = |i: usize| if i < count { all[i] } else { [DVec3::splat(f64::NAN); 3] };
            let at: Eight = [0, 1, 2].map(|c| [0, 1, 2].map(|axis| std::array::from_fn(|i| lane(i)[c][axis])));
            let ends = [f64::min as fn(f64, f64) -> f64, f64::max].map(|end| {
                [0, 1, 2].map(|axis| std::array::from_fn(|i| end(end(at[0][axis][i], at[1][axis][i]), at[2][axis][i])))
            });
            let (own, expected) = (Lot::of_lanes(&all, &at, &ends), Lot::new(&all));
            assert_eq!(format!("{own:?}").replace("-0.0", "0.0"), format!("{expected:?}").replace("-0.0", "0.0"));
        }
    }

    #[test]
    fn many_are_as_one_by_one() {
        let mut random = Random(1);
        let mut decided = 0;
        for round in 0..5000 {
            let count = random.below(40) as usize;
            let one = triangles(&mut random, if round % 10 == 7 { 1 } else { round % 5 }, 1)[0];
            let mut others = triangles(&mut random, round % 5, count);
            if round % 10 == 7 {
                others = at_edges(&mut random, &one, count);
            }
            let lots: Vec<Lot> = others.chunks(LANES).map(Lot::new).collect();
            let expected: Vec<_> =
                others.iter().map(|t| relate(&one, t)).enumerate().filter(|r| r.1 != Relation::Apart).collect();
            for isa in Isa::ALL {
                let mut found = Vec::new();
                relate_many(isa, &one, &lots, |lot, lane, relation| found.push((lot * LANES + lane, relation)));
                assert_eq!(found, expected, "{isa:?} {one:?}");
            }
            // The filter is never wrong, and decides general cases.
            for (i, lot) in lots.iter().enumerate() {
                let sifted = sift(Portable::new(), &One::new(&one), lot, u32::MAX);
                for lane in 0..lot.count {
                    let relation = relate(&one, &others[i * LANES + lane]);
                    assert!(sifted.apart >> lane & 1 == 0 || relation == Relation::Apart);
                    assert!(sifted.crossing >> lane & 1 == 0 || relation == Relation::Crossing);
                }
                let all = (1 << lot.count) - 1;
                assert!(round % 5 != 1 || sifted.apart | sifted.crossing == all);
                decided += (sifted.apart | sifted.crossing).count_ones();
            }
        }
        assert!(decided > 20_000, "{decided}");
    }
}
