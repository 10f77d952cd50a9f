//! Bounds the content of a cell by two **oriented slabs**: one across the voxel's normal, and one across a second axis.
//!
//! The cell of a piece of a slanted wall is much thicker than the piece, and that of a slanted wire is much wider than
//! the wire. A ray hits a stand-in where it has entered the cell and both slabs. A ray that misses a slab certainly
//! misses the content. The first slab is for surfaces, the second for wires and strips (benefits:
//! `tests/bench/NOTES.md`).
//!
//! Both slabs are stored in one word, see "Oriented slabs" in `src/store/FORMAT.md`. One function over any number of
//! lanes decodes the word, so all kinds of walks and builds use identical planes.

use super::coded::octahedral_axis;
use super::fill::Fill;
use super::turns::{Narrowest, narrowest};
use crate::math::Bounds;
use crate::simd::Lanes;
use glam::Vec3;

/// Fields of the word, each with first bit and number of bits: low and high plane across the normal; turn; low and high
/// plane across the second axis.
pub const FIELDS: [(u32, u32); 5] = [(0, 7), (7, 7), (14, 6), (20, 5), (25, 5)];
/// First bit and number of bits of the level (`fill.rs`).
pub const LEVEL: (u32, u32) = (30, 2);
/// Steps of the planes across the normal, and across the second axis.
const STEPS: [u32; 2] = [127, 31];
/// Number of possible turns of the second axis.
pub(super) const TURNS: u32 = 64;
/// Greatest width in steps for which the second slab is worthwhile.
const WIDEST: u32 = 20;
/// A content with more triangles than this keeps the slabs of its pieces instead of its triangles.
const TRIANGLES: usize = 256;

/// The points `p` between two planes: `low <= axis . p <= high`. `L` holds the slab of one cell, or of one cell in each
/// lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedSlab<L> {
    /// Axis of a length from a fifth to 1. The magnitudes of its components add up to at most 1.
    pub axis: [L; 3],
    /// The lower plane.
    pub low: L,
    /// The upper plane.
    pub high: L,
}

/// The slab across the normal, and the slab across the second axis.
pub type OrientedSlabs<L> = [OrientedSlab<L>; 2];

/// A cell as its centre and half its extent. The planes of slabs are counted in steps between the cell's ends along an
/// axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Middle<L> {
    /// The centre.
    pub at: [L; 3],
    /// Half the extent.
    pub half: [L; 3],
}

impl Middle<f32> {
    /// A box in this form.
    pub fn of(bounds: &Bounds) -> Self {
        Self { at: bounds.center().to_array(), half: (bounds.extent() * 0.5).to_array() }
    }
}

/// Decodes the slabs of voxels in `cell`. `fields` holds the fields of their words, `normal` the two signed bytes of
/// their normals. The result is finite for any input. (Always inlined, because it is part of the walks.)
#[inline(always)]
pub fn oriented_slabs<const N: usize, L: Lanes<N>>(
    fields: [L; 5],
    normal: [L; 2],
    cell: &Middle<L>,
) -> OrientedSlabs<L> {
    let [low, high, turn, second_low, second_high] = fields;
    let across = octahedral_axis(normal);
    let second = turned(across, turn);
    let (one, other) = (Range::of(across, cell, 0), Range::of(second, cell, 1));
    [
        OrientedSlab { axis: across, low: one.plane(low), high: one.plane(high) },
        OrientedSlab { axis: second, low: other.plane(second_low), high: other.plane(second_high) },
    ]
}

/// Unpacks the fields of one word.
#[inline(always)]
pub fn fields(word: u32) -> [f32; 5] {
    let field = |(from, count): (u32, u32)| (word >> from & ((1 << count) - 1)) as f32;
    [field(FIELDS[0]), field(FIELDS[1]), field(FIELDS[2]), field(FIELDS[3]), field(FIELDS[4])]
}

/// The two signed bytes of the normal in the low half of a sample's first word.
#[inline(always)]
pub fn normal_bytes(word: u32) -> [f32; 2] {
    [f32::from(word as u8 as i8), f32::from((word >> 8) as u8 as i8)]
}

/// The extent of a cell along an axis.
#[derive(Clone, Copy)]
struct Range<L> {
    from: L,
    step: L,
}

impl<L> Range<L> {
    /// `which`: 0 for the axis of the normal, 1 for the second axis.
    #[inline(always)]
    fn of<const N: usize>(axis: [L; 3], cell: &Middle<L>, which: usize) -> Self
    where
        L: Lanes<N>,
    {
        const SHARE: [f32; 2] = [2.0 / STEPS[0] as f32, 2.0 / STEPS[1] as f32];
        let Middle { at, half } = *cell;
        let middle = at[0] * axis[0] + at[1] * axis[1] + at[2] * axis[2];
        let reach = half[0] * abs(axis[0]) + half[1] * abs(axis[1]) + half[2] * abs(axis[2]);
        Self { from: middle - reach, step: reach * splat(reach, SHARE[which]) }
    }

    #[inline(always)]
    fn plane<const N: usize>(&self, steps: L) -> L
    where
        L: Lanes<N>,
    {
        self.from + steps * self.step
    }
}

/// Returns a direction at right angles to `axis`. `turn` counts [`TURNS`] steps that cover half a turn around it. The
/// steps divide the half circle of directions with magnitudes of the two components that add up to 1, which needs no
/// sine.
///
/// The direction has a length from a fifth to 1. The magnitudes of the components of `axis` add up to 1, so its length
/// is `3^-0.5` to 1. The direction of turn 0 has a length of 0.44 to 1, and the direction at right angles to both 0.26
/// to 1. Directions between these two have a length of at least 0.22.
#[inline(always)]
pub(super) fn turned<const N: usize, L: Lanes<N>>([x, y, z]: [L; 3], turn: L) -> [L; 3] {
    let zero = splat(x, 0.0);
    let one = splat(x, 1.0);
    let cos = one - turn * splat(x, 2.0 / TURNS as f32);
    let sin = one - abs(cos);
    let is_along_z = abs(x).le(abs(z));
    let first = [zero.select(is_along_z, zero - y), (zero - z).select(is_along_z, x), y.select(is_along_z, zero)];
    let other = [y * first[2] - z * first[1], z * first[0] - x * first[2], x * first[1] - y * first[0]];
    [first[0] * cos + other[0] * sin, first[1] * cos + other[1] * sin, first[2] * cos + other[2] * sin]
}

/// Magnitudes.
#[inline(always)]
pub(super) fn abs<const N: usize, L: Lanes<N>>(v: L) -> L {
    v.max(splat(v, 0.0) - v)
}

/// Returns `v` in all lanes; `like` is any vector.
#[inline(always)]
pub(super) fn splat<const N: usize, L: Lanes<N>>(like: L, v: f32) -> L {
    L::from_array_like(like, [v; N])
}

/// Content of a cell, as far as slabs need it: its triangles, or for a large content the cells of its pieces, with
/// their slabs and occupied subcells.
#[derive(Debug, Clone, Default)]
pub struct Content {
    /// Corners of the triangles. Triangles of the same leaf share corners.
    points: Vec<Vec3>,
    /// Indices of each triangle's corners in `points`.
    triangles: Vec<[u16; 3]>,
    cells: Vec<(Bounds, OrientedSlabs<f32>, Fill)>,
}

impl Content {
    /// A content of triangles. Each triangle has the indices of its corners in `points`, and each point belongs to a
    /// triangle.
    pub fn of_triangles(points: Vec<Vec3>, triangles: Vec<[u16; 3]>) -> Self {
        Self { points, triangles, cells: Vec::new() }
    }

    /// A content of triangles with these corners, three for each triangle.
    #[cfg(test)]
    pub fn of_points(points: Vec<Vec3>) -> Self {
        let triangles = (0..points.len() as u16 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Self::of_triangles(points, triangles)
    }

    /// A content of pieces in these cells.
    pub fn of_cells(cells: Vec<(Bounds, OrientedSlabs<f32>, Fill)>) -> Self {
        Self { cells, ..Self::default() }
    }

    /// Combines the contents of pieces. The result keeps their triangles if all are known and not too many.
    pub fn over(pieces: Vec<(Self, Bounds, OrientedSlabs<f32>, Fill)>) -> Self {
        let triangles = pieces.iter().map(|(c, ..)| c.triangles.len()).sum();
        if triangles > TRIANGLES || pieces.iter().any(|(c, ..)| !c.cells.is_empty()) {
            return Self::of_cells(pieces.into_iter().map(|(_, cell, slabs, fill)| (cell, slabs, fill)).collect());
        }
        let points = pieces.iter().map(|(c, ..)| c.points.len()).sum();
        let mut all = Self::of_triangles(Vec::with_capacity(points), Vec::with_capacity(triangles));
        for (content, ..) in &pieces {
            let first = all.points.len() as u16;
            all.points.extend_from_slice(&content.points);
            all.triangles.extend(content.triangles.iter().map(|corners| corners.map(|at| first + at)));
        }
        all
    }

    /// The corners of all triangles; empty if the triangles are not known.
    pub(super) fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The triangles and their corners; empty if they are not known.
    pub fn triangles(&self) -> (&[[u16; 3]], &[Vec3]) {
        (&self.triangles, &self.points)
    }

    /// The pieces; empty if the triangles are known.
    pub fn cells(&self) -> &[(Bounds, OrientedSlabs<f32>, Fill)] {
        &self.cells
    }

    /// Returns the word of the slabs in `cell`, with the first slab across the normal in `normal`. Planes are rounded
    /// outward, so that the slabs contain the content.
    pub fn oriented_slabs(&self, normal: u32, cell: &Middle<f32>) -> u32 {
        let across = octahedral_axis(normal_bytes(normal));
        let Narrowest { turn, second, along_second, along_normal } = narrowest(self, across);
        let [low, high] = between(1, second, along_second, cell);
        let [first, last] = between(0, across, along_normal, cell);
        let second = if high - low > WIDEST { [0, 0, STEPS[1]] } else { [turn, low, high] };
        let all = [first, last, second[0], second[1], second[2]];
        all.iter().zip(FIELDS).fold(0, |word, (steps, (from, _))| word | steps << from)
    }
}

/// Steps of the planes across `axis` for a content that extends from `low` to `high` along it.
fn between(which: usize, axis: [f32; 3], [low, high]: [f64; 2], cell: &Middle<f32>) -> [u32; 2] {
    let range = Range::of(axis, cell, which);
    let plane = |steps: u32| f64::from(range.plane(steps as f32));
    let guess = |at: f64| ((at - f64::from(range.from)) / f64::from(range.step)).clamp(0.0, f64::from(STEPS[which]));
    // The planes are computed as walks compute them, which corrects for rounding.
    let (mut first, mut last) = (guess(low) as u32, guess(high).ceil() as u32);
    while first > 0 && plane(first) > low {
        first -= 1;
    }
    while last < STEPS[which] && plane(last) < high {
        last += 1;
    }
    [first, last]
}

#[cfg(test)]
mod tests {
    use super::super::coded::octahedral;
    use super::*;
    use proptest::prelude::*;
    use std::f32::consts::PI;

    const CELL: Bounds = Bounds { min: Vec3::new(1.0, 2.0, 3.0), max: Vec3::new(2.0, 4.0, 3.5) };

    fn middle(cell: &Bounds) -> Middle<f32> {
        Middle { at: cell.center().to_array(), half: (cell.extent() * 0.5).to_array() }
    }

    /// The slabs of `content` in `cell`, as stored.
    fn stored(content: &Content, normal: u32, cell: &Bounds) -> OrientedSlabs<f32> {
        let cell = middle(cell);
        oriented_slabs(fields(content.oriented_slabs(normal, &cell)), normal_bytes(normal), &cell)
    }

    fn point() -> impl Strategy<Value = Vec3> {
        (0.0f32..=1.0, 0.0f32..=1.0, 0.0f32..=1.0)
            .prop_map(|(x, y, z)| CELL.min + (CELL.max - CELL.min) * Vec3::new(x, y, z))
    }

    fn holds(slabs: &OrientedSlabs<f32>, p: Vec3) -> bool {
        slabs.iter().all(|s| {
            let at = Vec3::from(s.axis).as_dvec3().dot(p.as_dvec3());
            // The cell's ends are computed in single precision, to within 17 h of the greatest coordinate.
            at >= f64::from(s.low) - 4e-6 && at <= f64::from(s.high) + 4e-6
        })
    }

    proptest! {
        #[test]
        fn slabs_hold_their_points(points in prop::collection::vec(point(), 1..20), normal: u16) {
            let slabs = stored(&Content::of_points(points.clone()), normal.into(), &CELL);
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
                cells.push((cell, stored(&content, normal.into(), &cell), Fill::of(&content, &cell)));
                all.extend(points);
            }
            let slabs = stored(&Content::of_cells(cells), normal.into(), &CELL);
            for p in all {
                prop_assert!(holds(&slabs, p), "{p} {slabs:?}");
            }
        }

        #[test]
        fn any_bits_are_finite(word: u32, normal: u32) {
            for slab in oriented_slabs(fields(word), normal_bytes(normal), &middle(&CELL)) {
                let axis = Vec3::from(slab.axis);
                prop_assert!(axis.is_finite() && slab.low.is_finite() && slab.high.is_finite());
                prop_assert!((0.2..1.1).contains(&axis.length()), "{}", axis.length());
            }
        }
    }

    /// All possible normals and turns. Bytes of -128, which only a damaged file has, lie slightly outside of the
    /// square.
    #[test]
    fn magnitudes_of_axes_add_up_to_one_at_most() {
        for normal in 0..=u32::from(u16::MAX) {
            let bytes = normal_bytes(normal);
            let most = if bytes.contains(&-128.0) { 1.04 } else { 1.0 };
            let across = octahedral_axis(bytes);
            let second = (0..TURNS).map(|turn| turned(across, turn as f32));
            for axis in std::iter::once(across).chain(second).map(Vec3::from) {
                assert!(axis.abs().element_sum() < most + 1e-6, "{normal:x}: {axis}");
            }
        }
    }

    #[test]
    fn turns_are_at_right_angles_and_cover_half_a_turn() {
        for normal in [0x0000, 0x7f00, 0x2040, 0x90c0, 0x2b2b] {
            let axis = octahedral_axis(normal_bytes(normal));
            let across = Vec3::from(axis);
            let at = |turn: u32| Vec3::from(turned(axis, turn as f32)).normalize();
            for turn in 0..TURNS {
                assert!(at(turn).dot(across).abs() < 1e-6);
                let next = at((turn + 1) % TURNS) * if turn == TURNS - 1 { -1.0 } else { 1.0 };
                let step = at(turn).angle_between(next).to_degrees();
                // The axis turns in one direction, in steps of unequal size.
                assert!(
                    (0.7..8.0).contains(&step) && at(turn).cross(next).dot(across) > 0.0,
                    "{normal:x} {turn}: {step}"
                );
            }
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
        let slabs = stored(&Content::of_points(points), octahedral(one), &cell);
        for slab in &slabs {
            let wide = (slab.high - slab.low) / Vec3::from(slab.axis).length();
            // The slabs are as thick as the wire, up to the errors of steps and turns.
            assert!(wide > 0.17 && wide < 1.0, "{wide} {slabs:?}");
        }
    }
}
