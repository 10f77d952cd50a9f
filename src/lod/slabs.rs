//! Where in a cell its content is: between two planes across the voxel's normal, and two along another axis.
//!
//! The cell of a piece of a wall is much thicker than the piece, that of a slanted wire much wider than the wire. What is shown
//! where the cell stands in is met where the ray enters the cell and both **slabs**; a ray that misses them misses the content, for
//! certain. The first slab is for surfaces, the second for wires and strips (`tests/bench/NOTES.md` has what each is worth).
//!
//! One word:
//!
//! | bits | |
//! |---|---|
//! | 0 to 6, 7 to 13 | the planes across the normal: steps of 1/127 of the cell's extent along it |
//! | 14 to 19 | by how many 64ths of a half turn the second axis is turned around the normal |
//! | 20 to 25, 26 to 31 | the planes across that: steps of 1/63; from 0 to 63: there is no second slab |

use super::coded::octahedral_axis;
use crate::math::Bounds;
use glam::{DVec3, Vec3};

/// Steps of the planes across the normal, and across the second axis.
const STEPS: [u32; 2] = [127, 63];
/// Where their bits begin: low, high.
const BITS: [[u32; 2]; 2] = [[0, 7], [20, 26]];
/// Ways in which the second axis may be turned, and where their bits begin.
const TURNS: u32 = 64;
const TURN_BITS: u32 = 14;
/// The bits from the second slab's planes on, where there is none.
const NONE: u32 = 63 << 6;
/// A second slab of more steps than this is not worth its time.
const WIDEST: u32 = 42;
/// A content of more points than these is kept as the slabs of its pieces.
const POINTS: usize = 768;

/// What lies between two planes: points `p` with `low <= axis . p <= high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slab {
    /// Not unit: a quarter to 1 long.
    pub axis: Vec3,
    /// The lower plane.
    pub low: f32,
    /// The upper plane.
    pub high: f32,
}

/// One slab, or two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slabs {
    all: [Slab; 2],
    count: usize,
}

impl Slabs {
    /// Of a voxel in `cell`: `word` is theirs, `normal` the word with its normal. Whatever the bits, all are finite.
    /// (Inlined always: it is part of the walks.)
    #[inline(always)]
    pub fn stored(word: u32, normal: u32, cell: Middle) -> Self {
        let across = octahedral_axis(normal);
        let first = slab(word, 0, across, cell);
        if word >> BITS[1][0] == NONE {
            return Self { all: [first; 2], count: 1 };
        }
        let turned = second_axis(across, word >> TURN_BITS & (TURNS - 1));
        Self { all: [first, slab(word, 1, turned, cell)], count: 2 }
    }
}

impl Slabs {
    /// Of no cell.
    pub const NONE: Self = Self { all: [Slab { axis: Vec3::Z, low: 0.0, high: 0.0 }; 2], count: 1 };

    /// The one across the normal.
    #[inline(always)]
    pub fn first(&self) -> &Slab {
        &self.all[0]
    }

    /// The other one, if there is one.
    #[inline(always)]
    pub fn second(&self) -> Option<&Slab> {
        (self.count == 2).then_some(&self.all[1])
    }
}

impl std::ops::Deref for Slabs {
    type Target = [Slab];

    #[inline(always)]
    fn deref(&self) -> &[Slab] {
        &self.all[..self.count]
    }
}

/// A cell by its middle and half its extent, for its slabs: between its ends they are counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Middle {
    /// The middle.
    pub at: Vec3,
    /// Half the extent.
    pub half: Vec3,
}

#[inline(always)]
fn slab(word: u32, which: usize, axis: Vec3, cell: Middle) -> Slab {
    let place = Range::of(axis, cell);
    let steps = |bit: u32| word >> bit & STEPS[which];
    let [low, high] = BITS[which];
    Slab { axis, low: place.plane(steps(low), which), high: place.plane(steps(high), which) }
}

/// A cell along an axis.
#[derive(Clone, Copy)]
struct Range {
    from: f32,
    length: f32,
}

impl Range {
    #[inline(always)]
    fn of(axis: Vec3, Middle { at, half }: Middle) -> Self {
        // Term by term, in an order that is the same everywhere: walks and builds see the same planes.
        let middle = at.x * axis.x + at.y * axis.y + at.z * axis.z;
        let reach = half.x * axis.x.abs() + half.y * axis.y.abs() + half.z * axis.z.abs();
        Self { from: middle - reach, length: reach + reach }
    }

    #[inline(always)]
    fn plane(&self, steps: u32, which: usize) -> f32 {
        const SHARE: [f32; 2] = [1.0 / STEPS[0] as f32, 1.0 / STEPS[1] as f32];
        self.from + steps as f32 * (self.length * SHARE[which])
    }
}

/// A direction across `axis`, turned around it by `turn` steps.
#[inline(always)]
fn second_axis(axis: Vec3, turn: u32) -> Vec3 {
    let (cos, sin) = TURN[(turn & (TURNS - 1)) as usize];
    let size = axis.abs();
    let one = if size.x <= size.y && size.x <= size.z {
        Vec3::new(0.0, -axis.z, axis.y)
    } else if size.y <= size.z {
        Vec3::new(axis.z, 0.0, -axis.x)
    } else {
        Vec3::new(-axis.y, axis.x, 0.0)
    };
    one * cos + axis.cross(one) * sin
}

/// Cosines and sines of the turns.
static TURN: [(f32, f32); TURNS as usize] = turns();

/// As there is no sine of constants: by the rotation of one step, in double precision.
const fn turns() -> [(f32, f32); TURNS as usize] {
    // Of pi / 64.
    const COS: f64 = 0.998_795_456_205_172_4;
    const SIN: f64 = 0.049_067_674_327_418_015;
    let mut out = [(0.0, 0.0); TURNS as usize];
    let (mut cos, mut sin, mut i) = (1.0f64, 0.0f64, 0);
    while i < TURNS as usize {
        out[i] = (cos as f32, sin as f32);
        (cos, sin) = (cos * COS - sin * SIN, sin * COS + cos * SIN);
        i += 1;
    }
    out
}

/// What a cell holds, as far as slabs are concerned: corners of triangles; or, of what is large, its pieces' cells with their slabs.
#[derive(Debug, Clone, Default)]
pub struct Content {
    points: Vec<Vec3>,
    cells: Vec<(Bounds, Slabs)>,
}

impl Content {
    /// Of triangles with these corners.
    pub fn of_points(points: Vec<Vec3>) -> Self {
        Self { points, cells: Vec::new() }
    }

    /// Of pieces in their cells, with their slabs.
    pub fn over(pieces: Vec<(Self, Bounds, Slabs)>) -> Self {
        let points = pieces.iter().map(|(c, ..)| c.points.len()).sum();
        if points <= POINTS && pieces.iter().all(|(c, ..)| c.cells.is_empty()) {
            let mut all = Vec::with_capacity(points);
            pieces.iter().for_each(|(c, ..)| all.extend_from_slice(&c.points));
            return Self::of_points(all);
        }
        Self { points: Vec::new(), cells: pieces.into_iter().map(|(_, cell, slabs)| (cell, slabs)).collect() }
    }

    /// The word of its slabs in `cell`, across the normal in `normal`: outward, so that they hold it.
    pub fn slabs(&self, normal: u32, cell: Middle) -> u32 {
        let across = octahedral_axis(normal);
        let turn = self.best_turn(across);
        let [low, high] = self.between(1, second_axis(across, turn), cell);
        let [first, last] = self.between(0, across, cell);
        let second = if high - low > WIDEST { NONE << BITS[1][0] } else { turn << TURN_BITS | low << BITS[1][0] | high << BITS[1][1] };
        first << BITS[0][0] | last << BITS[0][1] | second
    }

    /// The turn of the second axis along which the content is least wide: of eight, then of those between.
    fn best_turn(&self, across: Vec3) -> u32 {
        let width = |turn: u32| {
            let axis = second_axis(across, turn);
            let [low, high] = self.reach(axis);
            (high - low) / f64::from(axis.length())
        };
        let mut best = (f64::INFINITY, 0);
        let mut look = |turn: u32| {
            let wide = width(turn);
            if wide < best.0 {
                best = (wide, turn);
            }
            best.1
        };
        let mut at = (0..TURNS).step_by(8).fold(0, |_, turn| look(turn));
        for step in [4, 2, 1] {
            look((at + TURNS - step) % TURNS);
            at = look((at + step) % TURNS);
        }
        at
    }

    /// The steps of the planes across `axis`.
    fn between(&self, which: usize, axis: Vec3, cell: Middle) -> [u32; 2] {
        let [low, high] = self.reach(axis);
        let range = Range::of(axis, cell);
        let step = f64::from(range.length) / f64::from(STEPS[which]);
        let guess = |at: f64| ((at - f64::from(range.from)) / step).clamp(0.0, f64::from(STEPS[which]));
        // What rounding has moved is seen by looking at the planes as walks do.
        let (mut first, mut last) = (guess(low) as u32, guess(high).ceil() as u32);
        while first > 0 && f64::from(range.plane(first, which)) > low {
            first -= 1;
        }
        while last < STEPS[which] && f64::from(range.plane(last, which)) < high {
            last += 1;
        }
        [first, last]
    }

    /// How far it reaches along `axis`, or farther.
    fn reach(&self, axis: Vec3) -> [f64; 2] {
        let axis = axis.as_dvec3();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in &self.points {
            let at = p.as_dvec3().dot(axis);
            (low, high) = (low.min(at), high.max(at));
        }
        for (cell, slabs) in &self.cells {
            low = low.min(-farthest(cell, slabs, -axis));
            high = high.max(farthest(cell, slabs, axis));
        }
        [low, high]
    }
}

/// How far what is in a cell and in its slabs reaches along `axis`, or farther.
///
/// For any factors `f`, `axis . p = (axis - f0 a0 - f1 a1) . p + f0 (a0 . p) + f1 (a1 . p)`: no more than the cell allows for the
/// first term, and the slabs for the others. The factor that is best for one slab is zero or takes a component of what is left away.
pub fn farthest(cell: &Bounds, slabs: &[Slab], axis: DVec3) -> f64 {
    let (centre, half) = ((cell.min.as_dvec3() + cell.max.as_dvec3()) * 0.5, (cell.max.as_dvec3() - cell.min.as_dvec3()) * 0.5);
    let in_cell = |axis: DVec3| centre.dot(axis) + half.dot(axis.abs());
    let (mut rest, mut sum) = (axis, 0.0);
    for slab in slabs {
        let across = slab.axis.as_dvec3();
        let mut best = (in_cell(rest), 0.0, 0.0);
        for k in 0..3 {
            let factor = rest[k] / across[k];
            let plane = if factor > 0.0 { slab.high } else { slab.low };
            let all = in_cell(rest - across * factor) + factor * f64::from(plane);
            // Not so for NaN and infinity, of axes without that component.
            if all < best.0 {
                best = (all, factor, factor * f64::from(plane));
            }
        }
        (rest, sum) = (rest - across * best.1, sum + best.2);
    }
    in_cell(rest) + sum
}

#[cfg(test)]
mod tests {
    use super::super::coded::octahedral;
    use super::*;
    use proptest::prelude::*;
    use std::f32::consts::PI;

    const CELL: Bounds = Bounds { min: Vec3::new(1.0, 2.0, 3.0), max: Vec3::new(2.0, 4.0, 3.5) };

    fn middle(cell: &Bounds) -> Middle {
        Middle { at: cell.center(), half: cell.extent() * 0.5 }
    }

    fn point() -> impl Strategy<Value = Vec3> {
        (0.0f32..=1.0, 0.0f32..=1.0, 0.0f32..=1.0).prop_map(|(x, y, z)| CELL.min + (CELL.max - CELL.min) * Vec3::new(x, y, z))
    }

    fn holds(slabs: &[Slab], p: Vec3) -> bool {
        slabs.iter().all(|s| {
            let at = s.axis.as_dvec3().dot(p.as_dvec3());
            // The cell's own ends are as single precision has them.
            at >= f64::from(s.low) - 1e-6 && at <= f64::from(s.high) + 1e-6
        })
    }

    proptest! {
        #[test]
        fn slabs_hold_their_points(points in prop::collection::vec(point(), 1..20), normal: u16) {
            let content = Content::of_points(points.clone());
            let word = content.slabs(normal.into(), middle(&CELL));
            let slabs = Slabs::stored(word, normal.into(), middle(&CELL));
            for p in points {
                prop_assert!(holds(&slabs, p), "{p} {slabs:?}");
            }
        }

        #[test]
        fn slabs_of_pieces_hold_the_pieces_points(
            pieces in prop::collection::vec((prop::collection::vec(point(), 1..6), any::<u16>()), 1..8),
            normal: u16,
        ) {
            let mut all = Vec::new();
            let mut cells = Vec::new();
            for (points, normal) in pieces {
                let cell = Bounds::of(&points);
                let content = Content::of_points(points.clone());
                cells.push((cell, Slabs::stored(content.slabs(normal.into(), middle(&cell)), normal.into(), middle(&cell))));
                all.extend(points);
            }
            let word = Content { points: Vec::new(), cells }.slabs(normal.into(), middle(&CELL));
            let slabs = Slabs::stored(word, normal.into(), middle(&CELL));
            for p in all {
                prop_assert!(holds(&slabs, p), "{p} {slabs:?}");
            }
        }

        #[test]
        fn any_bits_are_finite(word: u32, normal: u32) {
            for slab in Slabs::stored(word, normal, middle(&CELL)).iter() {
                prop_assert!(slab.axis.is_finite() && slab.low.is_finite() && slab.high.is_finite());
                prop_assert!((0.25..1.1).contains(&slab.axis.length()), "{}", slab.axis.length());
            }
        }
    }

    #[test]
    fn turns_are_those_of_a_half_circle() {
        for (i, (cos, sin)) in TURN.iter().enumerate() {
            let angle = PI * i as f32 / TURNS as f32;
            assert!((cos - angle.cos()).abs() < 1e-6 && (sin - angle.sin()).abs() < 1e-6, "{i}");
        }
    }

    #[test]
    fn a_slanted_wire_is_thin_both_ways() {
        let along = Vec3::new(1.0, 2.0, 3.0).normalize();
        let (one, other) = (along.any_orthonormal_vector(), along.cross(along.any_orthonormal_vector()));
        let mut points = Vec::new();
        for end in [Vec3::ZERO, along * 10.0] {
            points.extend((0..6).map(|k| {
                let (sin, cos) = (PI * k as f32 / 3.0).sin_cos();
                end + (one * cos + other * sin) * 0.1
            }));
        }
        let cell = Bounds::of(&points);
        let content = Content::of_points(points);
        let normal = octahedral(one);
        let slabs = Slabs::stored(content.slabs(normal, middle(&cell)), normal, middle(&cell));
        assert_eq!(slabs.len(), 2);
        for slab in slabs.iter() {
            let wide = (slab.high - slab.low) / slab.axis.length();
            // As thick as the wire, up to what steps and turns are off by.
            assert!(wide > 0.17 && wide < 0.7, "{wide} {slabs:?}");
        }
    }
}
