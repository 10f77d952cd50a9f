//! The bytes of a voxel: one sample where its sides agree, six where they do not (Áfra 2012, section 4.2).
//!
//! A voxel begins with a sample, of two words. Of a voxel of six sides that has the mean normal, and in its second word
//! which of the block's voxels of six sides this is. The slabs across the normal (`oriented_slabs.rs`) are not with it
//! but in the node: walks ask for them.
//!
//! A sample:
//!
//! | bits of word 0 | |
//! |---|---|
//! | 0 to 15 | normal: octahedral, two signed bytes (Meyer and others, EGSR 2010) |
//! | 16 to 23 | how alike the normals are, 255 for 1: of a side the length of its mean normal, of one sample what `likeness` says, or 0: see below |
//! | 24, 25 | flags, of the first sample only |
//! | 26 to 31 | of the first sample only: how many rays it stops, see [`stop_bits`] |
//!
//! | bits of word 1 | |
//! |---|---|
//! | 0 to 23 | linear red, green, blue: 255 times the square root of each |
//! | 24 to 31 | the share that is covered, 255 for 1 |
//!
//! One sample of what faces along the axes (likeness 0; leaves only, most of machines and buildings) has in place of a
//! normal the shares that are covered of the sides across x, y and z, in proportion; what a ray sees of it is three
//! samples, see [`Coded::along_axes`]. Signs are those of the mean normal, for the slabs.
//!
//! The paper packs a sample into 32 bits: 15 of normal, 15 of colour, no spread and no coverage.

use super::oriented_slabs::{Content, Middle, abs, normal_bytes, splat};
use super::voxel::{Sample, Voxel};
use crate::simd::Lanes;
use glam::{Vec2, Vec3};

/// Bytes of a sample.
pub const SAMPLE_BYTES: usize = 8;
/// Words of a voxel in its block: a sample, the part, the summary.
pub const VOXEL_WORDS: usize = 4;
/// Words of six samples.
pub const SIDES_WORDS: usize = 12;

/// Where in word 0 it is said how many rays it stops.
const STOPS: u32 = 26;
/// Of levels up to this one the region may be passed.
pub const TRANSMITTING_LEVEL: u32 = 1;

/// What a stop code adds to a voxel's first word: the share of rays that it stops is the square of the code's 63rd
/// part, so that of a few leaves in a large cell not too much is seen; code 0 stops all.
pub const fn stop_bits(code: u8) -> u32 {
    (code as u32 & 63) << STOPS
}

/// How many of 4096 rays a voxel stops by its first word; 0: it stops all.
#[inline]
pub fn stopped(word: u32) -> u32 {
    let code = word >> STOPS;
    // The square of 63 is 3969: 4093 of the greatest, which is never written.
    let square = code * code;
    square + (square >> 5)
}

/// Flag: there is a sample for each side.
const SIX: u32 = 1 << 24;
/// Flag: its colours count; else those of its part do, as that is shown now.
const COLOURED: u32 = 1 << 25;
/// In the part's word: there are several.
const MIXED: u32 = 1 << 31;

/// Sides agree where no component of a normal differs by more from the mean, in front or behind.
const NORMALS: f32 = 0.3;
/// The same for linear colours.
const COLOURS: f32 = 0.1;
/// One sample faces along the axes where this part of what sides see does. (All of blocks; two thirds of spheres.)
const ALONG: f32 = 0.9;
/// Sides of which less is seen than this part of the most have no say.
const SEEN: f32 = 0.05;

/// The bytes of normals along x, y and z.
const AXES: [u32; 3] = [127, 127 << 8, 0];

/// A voxel as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Coded {
    /// The sample (the mean of the six, where there are six, of which the second word has nothing yet), the part, the
    /// summary of parts.
    pub words: [u32; VOXEL_WORDS],
    /// One for each side: low x, y, z, high x, y, z.
    pub sides: Option<Box<[u32; SIDES_WORDS]>>,
    /// The slabs.
    pub slabs: u32,
}

#[inline(always)]
fn byte(word: u32, at: u32) -> f32 {
    (word >> at & 0xff) as f32 * (1.0 / 255.0)
}

/// The share that is covered, in a sample's second word.
#[inline(always)]
pub(super) fn stored_cover(word: u32) -> f32 {
    byte(word, 24)
}

/// The length of the mean normal, in a sample's first word.
#[inline(always)]
pub fn stored_likeness(word: u32) -> f32 {
    byte(word, 16)
}

/// The linear colour in a sample's second word.
#[inline]
pub fn stored_colour(word: u32) -> Vec3 {
    let root = Vec3::new(byte(word, 0), byte(word, 8), byte(word, 16));
    root * root
}

impl Coded {
    /// Of a voxel and what its cell holds. `may_have_sides`: a sample for each side is kept where one does not do.
    pub fn of(voxel: &Voxel, cell: &Middle<f32>, content: &Content, may_have_sides: bool) -> Self {
        let [x, y, z] = cell.half;
        let faces = [y * z, z * x, x * y];
        let weights: [f32; 6] = std::array::from_fn(|side| voxel.sides[side].cover * faces[side % 3]);
        let (mean, agree) = mean(&voxel.sides, &weights);
        let (coloured, colours) =
            if voxel.is_mixed || voxel.has_own_colours { (COLOURED, u32::MAX) } else { (0, !0xff_ffff) };
        let [mut a, b] = sample(&mean);
        if !agree && !may_have_sides && faces_along_axes(&voxel.sides, &weights) {
            a = covers(&voxel.sides, mean.normal);
        }
        let (a, b) = (a | coloured, b & colours);
        let part = voxel.part | if voxel.is_mixed { MIXED } else { 0 };
        let slabs = content.oriented_slabs(a, cell);
        if agree || !may_have_sides {
            return Self { words: [a, b, part, voxel.summary], sides: None, slabs };
        }
        let mut sides = Box::new([0; SIDES_WORDS]);
        for (words, side) in sides.chunks_exact_mut(2).zip(&voxel.sides) {
            let [first, second] = sample(side);
            words.copy_from_slice(&[first, second & colours]);
        }
        Self { words: [a | SIX, 0, part, voxel.summary], sides: Some(sides), slabs }
    }

    /// Words that it takes.
    pub fn len(&self) -> usize {
        VOXEL_WORDS + if self.sides.is_some() { SIDES_WORDS } else { 0 }
    }

    /// Never.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Whether the first of a voxel's words says that there are six samples.
    #[inline]
    pub fn has_sides(first: u32) -> bool {
        first & SIX != 0
    }

    /// Whether the first of a voxel's words says that its one sample is of what faces along the axes.
    #[inline]
    pub fn is_along_axes(first: u32) -> bool {
        first & (SIX | 0xff << 16) == 0
    }

    /// The words of three samples, of the sides across x, y and z, for the one of what faces along the axes.
    #[inline]
    pub fn along_axes(first: u32, second: u32) -> ([u32; 3], [u32; 3]) {
        let cover = stored_normal(first).abs();
        let most = 255.0 / cover.max_element();
        let seconds = cover.to_array().map(|c| second & 0xff_ffff | ((c * most + 0.5) as u32) << 24);
        (AXES.map(|axis| axis | 255 << 16), seconds)
    }

    /// Whether the first of a voxel's words says that its colours count, and not those of its part.
    #[inline]
    pub fn has_colours(first: u32) -> bool {
        first & COLOURED != 0
    }

    /// The part of a part's word, and whether there are others.
    #[inline]
    pub fn part(word: u32) -> (u32, bool) {
        (word & !MIXED, word & MIXED != 0)
    }
}

/// The mean of all sides, and whether it can stand for each.
fn mean(sides: &[Sample; 6], weights: &[f32; 6]) -> (Sample, bool) {
    let most = weights.iter().copied().fold(0.0, f32::max);
    let first = weights.iter().position(|w| *w == most).unwrap_or(0);
    let lead = sides[first].normal;
    // A surface is seen from both of its sides: what faces away from the first is turned.
    let turned = |s: &Sample| if s.normal.dot(lead) < 0.0 { -s.normal } else { s.normal };
    let (mut normal, mut colour, mut cover, mut sum) = (Vec3::ZERO, Vec3::ZERO, 0.0, 0.0);
    for (s, &w) in sides.iter().zip(weights) {
        let w = if most > 0.0 { w / most } else { 1.0 };
        (normal, colour, cover, sum) = (normal + turned(s) * w, colour + s.colour * w, cover + s.cover * w, sum + w);
    }
    let mut all = Sample { normal: normal / sum, colour: colour / sum, cover: cover / sum };
    if !(all.normal.is_finite() && all.colour.is_finite() && all.cover.is_finite()) {
        all = sides[first];
    }
    let is_near = |s: &Sample| {
        let apart = (turned(s) - all.normal).abs().max_element();
        apart <= NORMALS && (s.colour - all.colour).abs().max_element() <= COLOURS
    };
    let agree = sides.iter().zip(weights).all(|(s, &w)| w <= SEEN * most || is_near(s));
    // Sides that do not agree are still one sample in leaves: how they answer light is told by its length.
    all.normal = all.normal.normalize_or(Vec3::Z);
    all.normal *= likeness(sides, weights, all.normal);
    (all, agree)
}

/// How long a mean normal says best how alike all normals are: 1 if all are that of `unit` or its opposite, 2/3 if no
/// more than in other directions, as on spheres, and on blocks too.
///
/// What a side sees, its normals times how much of each is seen, is a column of the sum of n n' over area; of that the
/// part along the normal counts (`seen.rs`).
fn likeness(sides: &[Sample; 6], weights: &[f32; 6], unit: Vec3) -> f32 {
    let (mut along, mut all) = (0.0, 0.0);
    for (side, (s, &w)) in sides.iter().zip(weights).enumerate() {
        let (axis, seen) = (side % 3, s.normal * if side < 3 { -w } else { w });
        along += unit[axis] * seen.dot(unit);
        all += seen[axis];
    }
    let share = along / all;
    if share.is_finite() { (0.5 + 0.5 * share).clamp(2.0 / 3.0, 1.0) } else { 1.0 }
}

/// Whether most that sides see faces along the axis that they look along.
fn faces_along_axes(sides: &[Sample; 6], weights: &[f32; 6]) -> bool {
    let along: f32 = sides.iter().zip(weights).enumerate().map(|(side, (s, &w))| s.normal[side % 3].abs() * w).sum();
    along >= ALONG * weights.iter().sum::<f32>()
}

/// The first word of one sample for what faces along the axes; `mean` has its signs.
fn covers(sides: &[Sample; 6], mean: Vec3) -> u32 {
    let cover = Vec3::from(std::array::from_fn::<_, 3, _>(|axis| sides[axis].cover.max(sides[axis + 3].cover)));
    octahedral(if cover.max_element() > 0.0 { cover } else { Vec3::ONE }.copysign(mean))
}

pub(super) fn sample(s: &Sample) -> [u32; 2] {
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u32;
    let root = |x: f32| byte(x.max(0.0).sqrt());
    let colour = root(s.colour.x) | root(s.colour.y) << 8 | root(s.colour.z) << 16;
    let length = s.normal.length();
    // Never nothing: what has no mean faces up, and its likeness says how little that means.
    let unit = if length > 1e-6 { s.normal / length } else { Vec3::Z };
    [octahedral(unit) | byte(length) << 16, colour | byte(s.cover) << 24]
}

/// A unit vector as a point of an octahedron unfolded to a square, a signed byte each way.
pub(super) fn octahedral(n: Vec3) -> u32 {
    let n = n / (n.x.abs() + n.y.abs() + n.z.abs());
    let folded = if n.z >= 0.0 {
        Vec2::new(n.x, n.y)
    } else {
        Vec2::new((1.0 - n.y.abs()).copysign(n.x), (1.0 - n.x.abs()).copysign(n.y))
    };
    let byte = |x: f32| u32::from((x * 127.0).round() as i8 as u8);
    byte(folded.x) | byte(folded.y) << 8
}

/// The direction of a normal from its two signed bytes: on the octahedron, not unit.
#[inline(always)]
pub(super) fn octahedral_axis<const N: usize, L: Lanes<N>>([x, y]: [L; 2]) -> [L; 3] {
    let zero = splat(x, 0.0);
    let (x, y) = (x * splat(x, 1.0 / 127.0), y * splat(x, 1.0 / 127.0));
    let z = splat(x, 1.0) - abs(x) - abs(y);
    // Corners of the square are folded down.
    let fold = (zero - z).max(zero);
    [(x - fold).select(zero.le(x), x + fold), (y - fold).select(zero.le(y), y + fold), z]
}

/// The unit normal in the low half of a sample's first word. (Inlined always: many at once are vectors then.)
#[inline(always)]
pub fn stored_normal(word: u32) -> Vec3 {
    // Bytes of -128, which only a damaged file has, are a little beyond the square: finite all the same.
    Vec3::from(octahedral_axis(normal_bytes(word))).normalize_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::Facet;
    use crate::math::Bounds;
    use proptest::prelude::*;

    /// A sample, taken apart.
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Side {
        /// Unit, of either sign.
        normal: Vec3,
        /// How alike the normals are, 0 to 1.
        likeness: f32,
        /// Linear.
        colour: Vec3,
        /// The share that is covered, 0 to 1.
        cover: f32,
    }

    impl Side {
        /// From a sample's words.
        fn of(words: [u32; 2]) -> Self {
            let (likeness, cover) = (byte(words[0], 16), byte(words[1], 24));
            Self { normal: stored_normal(words[0]), likeness, colour: stored_colour(words[1]), cover }
        }
    }

    proptest! {
        #[test]
        fn normals_keep_to_within_a_degree(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
            let n = Vec3::new(x, y, z);
            prop_assume!(n.length() > 1e-3);
            let n = n.normalize();
            let back = stored_normal(octahedral(n));
            prop_assert!(n.dot(back).min(1.0).acos().to_degrees() < 1.0, "{n} {back}");
        }

        #[test]
        fn any_words_give_a_unit_normal(a: u32, b: u32) {
            let side = Side::of([a, b]);
            prop_assert!((side.normal.length() - 1.0).abs() < 1e-5);
            prop_assert!(side.colour.max_element() <= 1.0 && side.cover <= 1.0);
        }
    }

    #[test]
    fn stop_codes_stop_by_their_squares() {
        for code in 0..64u8 {
            let share = f64::from(stopped(stop_bits(code) | 0x3ff_ffff)) / 4096.0;
            assert!((share - (f64::from(code) / 63.0).powi(2)).abs() < 1e-3, "{code}: {share}");
        }
    }

    const CELL: Bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };

    fn coded(facets: &[([f32; 3], [f32; 3])]) -> Coded {
        let facets: Vec<_> = facets
            .iter()
            .map(|(n, c)| Facet { normal: (*n).into(), colour: (*c).into(), part: 9, is_own_colour: true })
            .collect();
        let cell = Middle { at: CELL.center().to_array(), half: (CELL.extent() * 0.5).to_array() };
        Coded::of(&Voxel::of_leaf(&CELL, &facets), &cell, &Content::of_points(vec![CELL.min, CELL.max]), true)
    }

    const GREY: [f32; 3] = [0.25; 3];

    #[test]
    fn a_flat_piece_needs_one_sample() {
        let coded = coded(&[([0.6, 0.0, 0.8], GREY), ([0.55, 0.1, 0.82], GREY)]);
        assert_eq!((coded.sides.is_none(), Coded::part(coded.words[2])), (true, (9, false)));
        let side = Side::of([coded.words[0], coded.words[1]]);
        assert!(side.normal.dot(Vec3::new(0.6, 0.0, 0.8)).abs() > 0.99 && side.likeness > 0.98);
        assert!(side.colour.distance(GREY.into()) < 0.01);
    }

    /// One sample of facets with these doubled areas times normals, that fill `cell`.
    fn one_sample(cell: Bounds, normals: &[Vec3]) -> Coded {
        let facet = |n: &Vec3| Facet { normal: *n, colour: GREY.into(), part: 9, is_own_colour: true };
        let facets: Vec<_> = normals.iter().map(facet).collect();
        let middle = Middle { at: cell.center().to_array(), half: (cell.extent() * 0.5).to_array() };
        let coded =
            Coded::of(&Voxel::of_leaf(&cell, &facets), &middle, &Content::of_points(vec![cell.min, cell.max]), false);
        assert!(coded.sides.is_none());
        coded
    }

    #[test]
    fn one_sample_of_faces_along_axes_tells_how_much_of_each() {
        // A tall cell of which the walls across x are whole, those across y half, the top a quarter.
        let cell = Bounds { min: Vec3::ZERO, max: Vec3::new(1.0, 1.0, 4.0) };
        let Coded { words: [a, b, ..], .. } = one_sample(cell, &[Vec3::X * 8.0, Vec3::NEG_Y * 4.0, Vec3::Z * 0.5]);
        assert!(Coded::is_along_axes(a));
        let (firsts, seconds) = Coded::along_axes(a, b);
        for axis in 0..3 {
            let side = Side::of([firsts[axis], seconds[axis]]);
            assert_eq!((side.normal, side.likeness), (Vec3::AXES[axis], 1.0));
            assert!((side.cover - [1.0, 0.5, 0.25][axis]).abs() < 0.02, "{axis}: {}", side.cover);
            assert!(side.colour.distance(GREY.into()) < 0.01);
        }
    }

    #[test]
    fn one_sample_of_a_sphere_is_as_alike_as_normals_can_be_at_least() {
        // From all directions alike: of the corners and faces of an icosahedron.
        let golden = 0.5 + 1.25f32.sqrt();
        let corners = [Vec3::new(0.0, 1.0, golden), Vec3::new(1.0, golden, 0.0), Vec3::new(golden, 0.0, 1.0)];
        let all = corners
            .into_iter()
            .flat_map(|c| [c, Vec3::new(-c.x, c.y, c.z), Vec3::new(c.x, -c.y, c.z), Vec3::new(c.x, c.y, -c.z)]);
        let normals: Vec<_> = all.map(|n| n.normalize() * 0.2).collect();
        let [a, ..] = one_sample(CELL, &normals).words;
        assert!(!Coded::is_along_axes(a));
        assert!((stored_likeness(a) - 2.0 / 3.0).abs() < 0.02, "{}", stored_likeness(a));
    }

    #[test]
    fn one_sample_without_any_normal_is_none_of_axes() {
        let [a, ..] = one_sample(CELL, &[Vec3::ZERO]).words;
        assert!(!Coded::is_along_axes(a) && stored_likeness(a) >= 0.6);
    }

    #[test]
    fn an_edge_or_another_colour_behind_needs_six() {
        for facets in
            [[([1.0, 0.0, 0.0], GREY), ([0.0, 1.0, 0.0], GREY)], [([0.0, 0.0, 1.0], GREY), ([1.0, 0.0, 0.0], [0.9; 3])]]
        {
            let coded = coded(&facets);
            let sides = coded.sides.expect("six");
            assert!(Coded::has_sides(coded.words[0]));
            // From low x the facet that faces it.
            let x = Side::of([sides[0], sides[1]]);
            assert!(x.normal.x < -0.99, "{x:?}");
        }
    }
}
