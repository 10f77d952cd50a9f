//! The bytes of a voxel: one sample if its sides agree, six if they do not (Áfra 2012, section 4.2).
//!
//! A voxel begins with a sample of two words, which "Sample, word 0" and "Sample, word 1" in `src/store/FORMAT.md`
//! describe. Normals are octahedral (Meyer and others, EGSR 2010). In a voxel of six sides the first sample has the
//! mean normal, and in memory its second word is the voxel's number among the block's voxels of six sides. The oriented
//! slabs (`oriented_slabs.rs`) are stored in the node instead, because walks test them.
//!
//! A single sample with likeness 0 is **along axes**: its surfaces face along the axes. Only leaves have such samples,
//! and most leaves of machines and buildings do. A ray sees it as three samples, see [`Coded::along_axes`].
//!
//! The paper packs a sample into 32 bits: 15 of normal, 15 of colour, no likeness and no cover.

use super::curtain::{Curtain, FirstHit};
use super::oriented_slabs::{Content, Middle, abs, normal_bytes, splat};
use super::voxel::{Sample, Sum, Voxel};
use crate::simd::Lanes;
use glam::{Vec2, Vec3};

/// Bytes of a sample.
pub const SAMPLE_BYTES: usize = 8;
/// Words of a voxel in its block: a sample, the part, the summary.
pub const VOXEL_WORDS: usize = 4;
/// Words of six samples.
pub const SIDES_WORDS: usize = 12;

/// First bit of the stop code in word 0.
const STOPS: u32 = 26;
/// Greatest level of a stand-in that may transmit rays.
pub const TRANSMITTING_LEVEL: u32 = 1;

/// Encodes a stop code for a voxel's first word. The voxel stops a share of rays that is the square of `code / 63`, so
/// that a few leaves in a large cell are not overemphasised. Code 0 stops all rays.
pub const fn stop_bits(code: u8) -> u32 {
    (code as u32 & 63) << STOPS
}

/// Returns the stop code, from 1 to 62, of a voxel that stops a share of rays; 0, for all, in place of the greatest
/// code, and for shares that are not finite. A voxel stops some rays at least.
pub fn stop_code(share: f32) -> u8 {
    if share.is_finite() { (share.max(0.0).sqrt() * 63.0).round().max(1.0) as u8 % 63 } else { 0 }
}

/// Number of rays that a voxel stops, of 4096, from its first word; 0: it stops all rays.
#[inline]
pub fn stopped(word: u32) -> u32 {
    let code = word >> STOPS;
    // The square of 63 is 3969. The added part makes the greatest value 4093, which is never written.
    let square = code * code;
    square + (square >> 5)
}

/// Bit of the likeness that is set in all voxels that are not along axes: the likeness of all sides is 2/3 or more. It
/// is clear in the first word of a voxel with loose content.
const FIRM: u32 = 1 << 23;
/// The likeness in a first word.
const LIKENESS: u32 = 0xff << 16;

/// Marks the content of a voxel as loose, as leaves are, in its first word. (Not of a voxel along axes.)
pub const fn loosened(first: u32) -> u32 {
    first & !FIRM
}

/// True if a voxel's first word states that its content is loose.
#[inline]
pub fn is_loose(first: u32) -> bool {
    first & FIRM == 0 && first & LIKENESS != 0
}

/// The first word of a voxel as that of a sample, also if its content is loose.
#[inline]
pub fn of_sample(first: u32) -> u32 {
    if is_loose(first) { first | FIRM } else { first }
}

/// Flag: the voxel has a sample for each side.
const SIX: u32 = 1 << 24;
/// Flag: the voxel has colours of its own; otherwise the current colour of its part applies.
const COLOURED: u32 = 1 << 25;
/// Flag in the part's word: the voxel has several parts.
const MIXED: u32 = 1 << 31;
/// Flag in the part's word: the voxel has curtains.
const CURTAINED: u32 = 1 << 30;

/// Sides agree if no component of a side's normal, of either sign, differs by more than this from the mean.
const NORMALS: f32 = 0.3;
/// The same limit for linear colours.
const COLOURS: f32 = 0.1;
/// A single sample is along axes if at least this share of the visible surface faces along the axis of the side that
/// sees it. (Axis-aligned blocks reach 1, spheres two thirds.)
const ALONG: f32 = 0.9;
/// Sides with less visible area than this share of the greatest one are ignored.
const SEEN: f32 = 0.05;

/// The bytes of normals along x, y and z.
const AXES: [u32; 3] = [127, 127 << 8, 0];

/// A voxel as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Coded {
    /// The sample, the part, and the summary of parts. If there are six samples, this sample is their mean, and its
    /// second word is replaced when the block is encoded.
    pub words: [u32; VOXEL_WORDS],
    /// A sample for each side: low x, y, z, high x, y, z.
    pub sides: Option<Box<[u32; SIDES_WORDS]>>,
    /// The oriented slabs.
    pub slabs: u32,
    /// The bits of all parts that the curtains show, and the curtains. Empty if there are none.
    pub curtains: Box<[u32]>,
}

#[inline(always)]
fn byte(word: u32, at: u32) -> f32 {
    (word >> at & 0xff) as f32 * (1.0 / 255.0)
}

/// Covered share, from a sample's second word.
#[inline(always)]
pub fn stored_cover(word: u32) -> f32 {
    byte(word, 24)
}

/// Likeness, from a sample's first word: the length of the mean normal.
#[inline(always)]
pub fn stored_likeness(word: u32) -> f32 {
    byte(word, 16)
}

/// Linear colour, from a sample's second word.
#[inline]
pub fn stored_colour(word: u32) -> Vec3 {
    let root = Vec3::new(byte(word, 0), byte(word, 8), byte(word, 16));
    root * root
}

impl Coded {
    /// Encodes a voxel and the content of its cell. With `may_have_sides` it keeps a sample for each side if one sample
    /// does not suffice.
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
            return Self { words: [a, b, part, voxel.summary], sides: None, slabs, curtains: Box::default() };
        }
        let mut sides = Box::new([0; SIDES_WORDS]);
        for (words, side) in sides.chunks_exact_mut(2).zip(&voxel.sides) {
            let [first, second] = sample(side);
            words.copy_from_slice(&[first, second & colours]);
        }
        Self { words: [a | SIX, b, part, voxel.summary], sides: Some(sides), slabs, curtains: Box::default() }
    }

    /// Leaves only the mean sample: a proxy gives the look.
    pub fn without_sides(&mut self) {
        self.words[0] &= !SIX;
        self.sides = None;
    }

    /// Words of the voxel, without its curtains.
    pub fn len(&self) -> usize {
        VOXEL_WORDS + if self.sides.is_some() { SIDES_WORDS } else { 0 }
    }

    /// Words of its curtains, with two summaries.
    pub fn curtain_words(&self) -> usize {
        if self.curtains.is_empty() { 0 } else { 1 + self.curtains.len() }
    }

    /// Always false.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// True if a voxel's first word states that it has six samples.
    #[inline]
    pub fn has_sides(first: u32) -> bool {
        first & SIX != 0
    }

    /// True if a voxel's first word states that its single sample is along axes.
    #[inline]
    pub fn is_along_axes(first: u32) -> bool {
        first & (SIX | 0xff << 16) == 0
    }

    /// Expands a single sample that is along axes: returns the words of three samples, of the sides across x, y and z.
    #[inline]
    pub fn along_axes(first: u32, second: u32) -> ([u32; 3], [u32; 3]) {
        let cover = stored_normal(first).abs();
        let most = 255.0 / cover.max_element();
        let seconds = cover.to_array().map(|c| second & 0xff_ffff | ((c * most + 0.5) as u32) << 24);
        (AXES.map(|axis| axis | 255 << 16), seconds)
    }

    /// True if a voxel's first word states that it has colours of its own, which replace the colour of its part.
    #[inline]
    pub fn has_colours(first: u32) -> bool {
        first & COLOURED != 0
    }

    /// The part in a part's word, and true if the voxel has other parts.
    #[inline]
    pub fn part(word: u32) -> (u32, bool) {
        (word & !(MIXED | CURTAINED), word & MIXED != 0)
    }

    /// True if a part's word states that the voxel has curtains.
    #[inline]
    pub fn has_curtains(word: u32) -> bool {
        word & CURTAINED != 0
    }

    /// Replaces the colours by the means of those that lines meet first, where lines meet any.
    pub(super) fn colour<'a>(&mut self, hits: impl Iterator<Item = &'a FirstHit>) {
        let (mut all, mut of_sides) = (Sum::default(), [Sum::default(); 6]);
        for hit in hits {
            all.add(Vec3::ZERO, hit.colour, hit.weight);
            for axis in 0..3 {
                let side = if hit.from[axis] < 0.0 { axis } else { axis + 3 };
                of_sides[side].add(Vec3::ZERO, hit.colour, hit.weight * hit.from[axis].abs());
            }
        }
        let put = |word: &mut u32, sum: &Sum| {
            if let Sample { colour, cover: 1.0, .. } = sum.mean(1.0) {
                *word = *word & !0xff_ffff | sample(&Sample { normal: Vec3::Z, colour, cover: 0.0 })[1];
            }
        };
        put(&mut self.words[1], &all);
        if let Some(sides) = &mut self.sides {
            sides.chunks_exact_mut(2).zip(&of_sides).for_each(|(words, sum)| put(&mut words[1], sum));
        }
    }

    /// Gives the voxel curtains, at least one.
    pub(super) fn hang(&mut self, curtains: &[Curtain]) {
        let shown = curtains.iter().fold(0, |all, curtain| all | curtain.summary);
        let words = curtains.iter().enumerate().flat_map(|(i, curtain)| curtain.words(i + 1 == curtains.len()));
        self.curtains = std::iter::once(shown).chain(words).collect();
        self.words[2] |= CURTAINED;
    }
}

/// Returns the mean of all sides, and true if it can represent each of them.
fn mean(sides: &[Sample; 6], weights: &[f32; 6]) -> (Sample, bool) {
    let most = weights.iter().copied().fold(0.0, f32::max);
    let first = weights.iter().position(|w| *w == most).unwrap_or(0);
    let lead = sides[first].normal;
    // A surface is visible from both of its sides, so normals that face away from the first are inverted.
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
    // Leaves keep one sample even if sides do not agree. The length of its normal describes its response to light.
    all.normal = all.normal.normalize_or(Vec3::Z);
    all.normal *= likeness(sides, weights, all.normal);
    (all, agree)
}

/// Returns the length of a mean normal that best describes how alike all normals are: 1 if all equal `unit` or its
/// opposite, 2/3 if they favour no direction, as on spheres and on blocks.
///
/// The normals that a side sees, weighted by their visible areas, add up to a column of the sum of n n' over the area.
/// The share of that sum along the normal determines the length (`seen.rs`).
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

/// True if most of the surface that sides see faces along the axes of these sides.
fn faces_along_axes(sides: &[Sample; 6], weights: &[f32; 6]) -> bool {
    let along: f32 = sides.iter().zip(weights).enumerate().map(|(side, (s, &w))| s.normal[side % 3].abs() * w).sum();
    along >= ALONG * weights.iter().sum::<f32>()
}

/// First word of a single sample that is along axes. `mean` provides the signs.
fn covers(sides: &[Sample; 6], mean: Vec3) -> u32 {
    let cover = Vec3::from(std::array::from_fn::<_, 3, _>(|axis| sides[axis].cover.max(sides[axis + 3].cover)));
    octahedral(if cover.max_element() > 0.0 { cover } else { Vec3::ONE }.copysign(mean))
}

pub(super) fn sample(s: &Sample) -> [u32; 2] {
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u32;
    let root = |x: f32| byte(x.max(0.0).sqrt());
    let colour = root(s.colour.x) | root(s.colour.y) << 8 | root(s.colour.z) << 16;
    let length = s.normal.length();
    // A sample without a mean normal gets one that points up. Its likeness shows that this means little.
    let unit = if length > 1e-6 { s.normal / length } else { Vec3::Z };
    [octahedral(unit) | byte(length) << 16, colour | byte(s.cover) << 24]
}

/// Encodes a unit vector as a point of an octahedron unfolded to a square, one signed byte for each coordinate.
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

/// Direction of a normal from its two signed bytes: a point on the octahedron, not a unit vector.
#[inline(always)]
pub(super) fn octahedral_axis<const N: usize, L: Lanes<N>>([x, y]: [L; 2]) -> [L; 3] {
    let zero = splat(x, 0.0);
    let (x, y) = (x * splat(x, 1.0 / 127.0), y * splat(x, 1.0 / 127.0));
    let z = splat(x, 1.0) - abs(x) - abs(y);
    // Corners of the square are folded down.
    let fold = (zero - z).max(zero);
    [(x - fold).select(zero.le(x), x + fold), (y - fold).select(zero.le(y), y + fold), z]
}

/// Unit normal, from the low half of a sample's first word. (Always inlined, so that loops over many words are
/// vectorised.)
#[inline(always)]
pub fn stored_normal(word: u32) -> Vec3 {
    // Bytes of -128, which only a damaged file has, lie slightly outside of the square. The result is finite all the
    // same.
    Vec3::from(octahedral_axis(normal_bytes(word))).normalize_or(Vec3::Z)
}

/// The low half of a sample's first word for a unit normal: see [`stored_normal`].
pub fn coded_normal(unit: Vec3) -> u32 {
    octahedral(unit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::Facet;
    use crate::math::Bounds;
    use proptest::prelude::*;

    /// A decoded sample.
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Side {
        /// Unit normal, of either sign.
        normal: Vec3,
        /// Likeness of the normals, 0 to 1.
        likeness: f32,
        /// Linear colour.
        colour: Vec3,
        /// Covered share, 0 to 1.
        cover: f32,
    }

    impl Side {
        /// Decodes a sample's words.
        fn of(words: [u32; 2]) -> Self {
            let (likeness, cover) = (byte(words[0], 16), byte(words[1], 24));
            Self { normal: stored_normal(words[0]), likeness, colour: stored_colour(words[1]), cover }
        }
    }

    proptest! {
        #[test]
        fn stored_normals_are_within_a_degree(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
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

    /// Of all likenesses that voxels have: 2/3 and more, or 0 along axes.
    #[test]
    fn loose_content_keeps_its_sample() {
        for likeness in (170..=255u32).chain([0]) {
            let first = likeness << 16 | SIX | 0x1234;
            assert!(!is_loose(first) && of_sample(first) == first, "{likeness}");
            let loose = loosened(first);
            assert_eq!((is_loose(loose), of_sample(loose)), (likeness > 0, first), "{likeness}");
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

    /// A single sample of facets with the given normals, times twice the area, in `cell`.
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
    fn one_sample_along_axes_holds_the_cover_of_each_side() {
        // A tall cell. The walls across x are covered completely, those across y by a half, the top by a quarter.
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
    fn one_sample_of_a_sphere_has_the_least_likeness() {
        // Normals from all directions: the corners of an icosahedron.
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
    fn one_sample_without_normals_is_not_along_axes() {
        let [a, ..] = one_sample(CELL, &[Vec3::ZERO]).words;
        assert!(!Coded::is_along_axes(a) && stored_likeness(a) >= 0.6);
    }

    #[test]
    fn an_edge_or_another_colour_behind_needs_six_samples() {
        for facets in
            [[([1.0, 0.0, 0.0], GREY), ([0.0, 1.0, 0.0], GREY)], [([0.0, 0.0, 1.0], GREY), ([1.0, 0.0, 0.0], [0.9; 3])]]
        {
            let coded = coded(&facets);
            let sides = coded.sides.expect("six");
            assert!(Coded::has_sides(coded.words[0]));
            // The sample of low x shows the facet that faces it.
            let x = Side::of([sides[0], sides[1]]);
            assert!(x.normal.x < -0.99, "{x:?}");
        }
    }
}
