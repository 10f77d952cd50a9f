//! Curtains: what a cell shows from directions in which other surface hides its own.
//!
//! A stand-in that shows its own triangles alone shows the ribs of a hull through its skin: its region, a box inside of
//! slabs, reaches through the skin. Áfra 2012, section 4.2, and Wald and others 2004, section 5.3, therefore sample
//! stand-ins with rays from outside, which meet first whatever lies in the way. The samples of both papers belong to
//! fixed directions: six sides, or eighteen directions. Here a **curtain** is a part that is met first from a set of
//! directions, of 26, with one mean colour and normal of all that is met first from there: a skin is one curtain,
//! however its directions lie, and takes three words instead of the twelve of six sides. Most cells need none.

use super::coded::{Coded, octahedral};
use super::voxel::{Sum, summary_bit};
use glam::{Mat3, Vec3};

/// Words of a curtain.
pub const CURTAIN_WORDS: usize = 3;
/// Greatest number of curtains of a cell.
const MOST: usize = 4;
/// Flag in the first word: no further curtain follows.
const LAST: u32 = 1 << 31;
/// First bit of the likeness in the first word.
const LIKENESS: u32 = 27;
/// Parts from this number on have no curtains: their number does not fit.
const PARTS: u32 = 1 << 24;
/// Directions: the components are -1, 0 or 1. The one in the middle is unused.
const DIRECTIONS: usize = 27;
/// Components of a direction, divided by the largest, count as zero up to this value: the tangent of an eighth of a
/// right angle's half.
const ZERO: f32 = 0.414_213_56;
/// Share of a line that counts for each direction beside its own, so that few lines suffice.
const BESIDE: f32 = 0.3;
/// A curtain hides the cell for at least this share of all lines, or it is left out.
const GAIN: f32 = 0.1;
/// Steps that find the axis of normals.
const STEPS: usize = 12;
/// Parts that are told apart; the cell's own one comes first.
const TOLD: usize = 8;
/// Least likeness that is stored: that of a sphere.
const LEAST_LIKENESS: f32 = 2.0 / 3.0;

/// The surface that a line from outside meets first.
#[derive(Debug, Clone, Copy)]
pub struct FirstHit {
    /// Unit vector to where the line comes from.
    pub from: Vec3,
    /// Weight of the line.
    pub weight: f32,
    /// Unit normal, of either sign.
    pub normal: Vec3,
    /// Linear colour.
    pub colour: Vec3,
    /// Its part.
    pub part: u32,
}

/// What a cell shows from a set of directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curtain {
    /// The directions to the eye: bit `i` for direction `i`.
    from: u32,
    /// The axis of the normals. The more they differ, the shorter it is.
    normal: Vec3,
    /// Linear colour.
    colour: Vec3,
    /// The part.
    part: u32,
    /// The bits of all parts that colour and normal are made of (`summary_bit`).
    pub summary: u32,
}

/// Number of the direction that a vector is nearest to.
#[inline]
fn direction(v: Vec3) -> usize {
    let least = v.abs().max_element() * ZERO;
    let step = |x: f32| usize::from(x > -least) + usize::from(x >= least);
    step(v.x) + 3 * step(v.y) + 9 * step(v.z)
}

/// True if a cell shows a curtain, given by its first word, to an eye in direction `to_eye`.
#[inline]
pub fn curtain_from(first: u32, to_eye: Vec3) -> bool {
    first >> direction(to_eye) & 1 == 1
}

impl Curtain {
    /// The words. First: directions, 27 bits; likeness, 3 bits; the flag [`LAST`]. Second: square roots of the linear
    /// colour, 8 bits each; the lower byte of the normal. Third: part, 24 bits; the upper byte of the normal.
    pub(super) fn words(&self, is_last: bool) -> [u32; CURTAIN_WORDS] {
        let root = |x: f32| (x.clamp(0.0, 1.0).sqrt() * 255.0 + 0.5) as u32;
        let colour = root(self.colour.x) | root(self.colour.y) << 8 | root(self.colour.z) << 16;
        let length = self.normal.length();
        let normal = octahedral(if length > 1e-6 { self.normal / length } else { Vec3::Z });
        let likeness = ((length - LEAST_LIKENESS) / (1.0 - LEAST_LIKENESS)).clamp(0.0, 1.0);
        let last = if is_last { LAST } else { 0 };
        [
            self.from | ((likeness * 7.0 + 0.5) as u32) << LIKENESS | last,
            colour | (normal & 0xff) << 24,
            self.part | (normal >> 8) << 24,
        ]
    }

    /// The words of the sample (`Coded`) that a curtain shows, and its part, from its words.
    #[inline]
    pub fn shown([first, second, third]: [u32; CURTAIN_WORDS]) -> ([u32; 2], u32) {
        let likeness = LEAST_LIKENESS + (first >> LIKENESS & 7) as f32 * ((1.0 - LEAST_LIKENESS) / 7.0);
        let likeness = (likeness * 255.0 + 0.5) as u32;
        let normal = second >> 24 | third >> 24 << 8;
        ([normal | likeness << 16, second & 0xff_ffff | 0xff << 24], third & (PARTS - 1))
    }

    /// True if the bits of a first word that mean nothing are zero.
    #[inline]
    pub fn is_sound(first: u32) -> bool {
        first & (1 << 30 | 1 << (DIRECTIONS / 2)) == 0
    }

    /// True if a first word states that no further curtain follows.
    #[inline]
    pub fn is_last(first: u32) -> bool {
        first & LAST != 0
    }
}

/// Gives a voxel curtains, given what lines through its region meet first. The colours of a cell of several parts
/// become those of what is met first from the directions that no curtain hides. Returns true if the voxel has changed,
/// and the share of the lines that meet another part first than the one that the voxel now shows to them.
pub fn hang_curtains(hits: &[FirstHit], voxel: &mut Coded) -> (bool, f32) {
    let (own, is_mixed) = Coded::part(voxel.words[2]);
    let (curtains, shown) = curtains(own, hits);
    if !curtains.is_empty() {
        voxel.hang(&curtains);
    }
    if is_mixed {
        let summary = voxel.words[3];
        let of_own = |hit: &&FirstHit| shown[direction(hit.from)] == 0 && summary & summary_bit(hit.part) != 0;
        voxel.colour(hits.iter().filter(of_own));
    }
    let part = |hit: &FirstHit| {
        let curtain = curtains.iter().find(|curtain| curtain_from(curtain.from, hit.from));
        curtain.map_or(own, |curtain| curtain.part)
    };
    let (mut wrong, mut all) = (0.0, f32::MIN_POSITIVE);
    for hit in hits {
        all += hit.weight;
        wrong += if part(hit) == hit.part { 0.0 } else { hit.weight };
    }
    (is_mixed || !curtains.is_empty(), wrong / all)
}

/// Returns the curtains of a cell that mostly holds part `own`, and for each direction 0 if none hides the cell.
fn curtains(own: u32, hits: &[FirstHit]) -> (Vec<Curtain>, [usize; DIRECTIONS]) {
    let mut parts = parts_of(own, hits);
    // With each round the parts that no direction shows are left out: their directions show others.
    loop {
        let shown = votes(&parts, hits);
        let gains = gains(&parts, hits, &shown);
        let least = GAIN * hits.iter().map(|hit| hit.weight).sum::<f32>();
        let worst = (1..parts.len()).min_by(|a, b| gains[*a].total_cmp(&gains[*b]));
        match worst {
            Some(worst) if gains[worst] < least || parts.len() > 1 + MOST => drop(parts.remove(worst)),
            _ => return ((1..parts.len()).filter_map(|i| hang(&parts, i, hits, &shown)).collect(), shown),
        }
    }
}

/// Returns `own` and the parts that most lines meet first, most first.
fn parts_of(own: u32, hits: &[FirstHit]) -> Vec<u32> {
    let mut parts: Vec<(u32, f32)> = Vec::with_capacity(2 * TOLD);
    for hit in hits.iter().filter(|hit| hit.part != own && hit.part < PARTS) {
        match parts.iter_mut().find(|(part, _)| *part == hit.part) {
            Some((_, weight)) => *weight += hit.weight,
            None => parts.push((hit.part, hit.weight)),
        }
    }
    // The lowest of equal parts, so that the order of lines does not matter.
    parts.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    std::iter::once(own).chain(parts.iter().map(|(part, _)| *part)).take(TOLD).collect()
}

/// Returns the part of `parts` that is mostly met first from each direction.
fn votes(parts: &[u32], hits: &[FirstHit]) -> [usize; DIRECTIONS] {
    let mut votes = [[0.0f32; TOLD]; DIRECTIONS];
    for hit in hits {
        let Some(part) = parts.iter().position(|part| *part == hit.part) else { continue };
        let at = direction(hit.from);
        votes[at][part] += hit.weight;
        for step in [1, 3, 9] {
            let here = at / step % 3;
            if here > 0 {
                votes[at - step][part] += hit.weight * BESIDE;
            }
            if here < 2 {
                votes[at + step][part] += hit.weight * BESIDE;
            }
        }
    }
    let mut shown =
        votes.map(|votes| (1..parts.len()).fold(0, |best, i| if votes[i] > votes[best] { i } else { best }));
    shown[DIRECTIONS / 2] = 0;
    shown
}

/// Returns for each part the weight of the lines that meet it first, less that of those that meet the cell's own, from
/// the directions that show it.
fn gains(parts: &[u32], hits: &[FirstHit], shown: &[usize; DIRECTIONS]) -> [f32; TOLD] {
    let mut gains = [0.0; TOLD];
    for hit in hits {
        let at = shown[direction(hit.from)];
        gains[at] += match hit.part {
            part if part == parts[0] => -hit.weight,
            part if part == parts[at] => hit.weight,
            _ => 0.0,
        };
    }
    gains
}

/// Returns the curtain of part `i`; `None` if no line comes from its directions.
fn hang(parts: &[u32], i: usize, hits: &[FirstHit], shown: &[usize; DIRECTIONS]) -> Option<Curtain> {
    let from = (0..DIRECTIONS).filter(|at| shown[*at] == i).fold(0, |all, at| all | 1 << at);
    let (mut sum, mut summary, mut normals) = (Sum::default(), summary_bit(parts[i]), Mat3::ZERO);
    for hit in hits.iter().filter(|hit| curtain_from(from, hit.from)) {
        sum.add(Vec3::ZERO, hit.colour, hit.weight);
        normals += Mat3::from_cols(hit.normal * hit.normal.x, hit.normal * hit.normal.y, hit.normal * hit.normal.z)
            * hit.weight;
        summary |= summary_bit(hit.part);
    }
    let mean = sum.mean(1.0);
    (mean.cover > 0.0).then_some(Curtain {
        from,
        normal: axis_of(&normals),
        colour: mean.colour,
        part: parts[i],
        summary,
    })
}

/// Returns the axis that best describes normals of which `normals` is the weighted sum of n n'. Its length is their
/// likeness: 1 if all are parallel, 2/3 if they favour no direction (as `likeness` in `coded.rs`). Normals have no sign
/// here: a plate is seen from both sides.
fn axis_of(normals: &Mat3) -> Vec3 {
    let all = normals.x_axis.x + normals.y_axis.y + normals.z_axis.z;
    let columns = [normals.x_axis, normals.y_axis, normals.z_axis];
    let first =
        columns.into_iter().fold(Vec3::ZERO, |a, b| if b.length_squared() > a.length_squared() { b } else { a });
    // Squaring the matrix instead would underflow: a few steps of power iteration are enough for a byte.
    let mut axis = first.normalize_or(Vec3::Z);
    for _ in 0..STEPS {
        axis = (*normals * axis).normalize_or(axis);
    }
    let share = axis.dot(*normals * axis) / all;
    axis * if share.is_finite() { 0.5 + 0.5 * share } else { LEAST_LIKENESS }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::coded::{stored_colour, stored_likeness, stored_normal};
    use proptest::prelude::*;

    const RED: Vec3 = Vec3::X;
    const WHITE: Vec3 = Vec3::splat(0.8);

    /// Unit vectors, spread evenly over the sphere (a Fibonacci lattice).
    fn all_around(count: u32) -> impl Iterator<Item = Vec3> {
        let turn = std::f32::consts::PI * (3.0 - 5f32.sqrt());
        (0..count).map(move |i| {
            let z = 1.0 - (2 * i + 1) as f32 / count as f32;
            let (sin, cos) = (turn * i as f32).sin_cos();
            Vec3::new(cos, sin, 0.0) * (1.0 - z * z).max(0.0).sqrt() + Vec3::Z * z
        })
    }

    /// A red rib of part 7 below a white skin of part 9 whose outer side faces `out`.
    fn rib(out: Vec3, count: u32) -> Vec<FirstHit> {
        let hit = |from: Vec3| match from.dot(out) > 0.0 {
            true => FirstHit { from, weight: 1.0, normal: -out, colour: WHITE, part: 9 },
            false => FirstHit { from, weight: 1.0, normal: from, colour: RED, part: 7 },
        };
        all_around(count).map(hit).collect()
    }

    fn coded(part: u32) -> Coded {
        Coded { words: [0x0080_0000, 0, part, summary_bit(part)], sides: None, slabs: 0, curtains: Box::default() }
    }

    /// The words of the curtains, as a block has them.
    fn words(voxel: &Coded) -> Vec<[u32; CURTAIN_WORDS]> {
        voxel.curtains[1..].chunks_exact(CURTAIN_WORDS).map(|c| [c[0], c[1], c[2]]).collect()
    }

    proptest! {
        #[test]
        fn skin_is_shown_outside_and_the_rib_inside(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
            let out = Vec3::new(x, y, z);
            prop_assume!(out.length() > 0.1);
            let (out, mut voxel) = (out.normalize(), coded(7));
            let (is_new, wrong) = hang_curtains(&rib(out, 256), &mut voxel);
            // The directions in between cover a fifth of the sphere on the wrong side at most.
            prop_assert!(is_new && wrong < 0.2, "{}", wrong);
            prop_assert_eq!(voxel.curtains[0], summary_bit(9) | summary_bit(7) & voxel.curtains[0]);
            let curtains = words(&voxel);
            prop_assert_eq!(curtains.len(), 1);
            prop_assert!(Curtain::is_last(curtains[0][0]) && Curtain::is_sound(curtains[0][0]));
            let (sample, part) = Curtain::shown(curtains[0]);
            prop_assert_eq!(part, 9);
            prop_assert!(stored_colour(sample[1]).distance(WHITE) < 0.3);
            prop_assert!(stored_normal(sample[0]).dot(out).abs() > 0.95 && stored_likeness(sample[0]) > 0.85);
            // Between directions that one bit covers the answer may be either.
            for to_eye in all_around(500).filter(|to| to.dot(out).abs() > 0.6) {
                prop_assert_eq!(curtain_from(curtains[0][0], to_eye), to_eye.dot(out) > 0.0, "{}", to_eye);
            }
        }

        #[test]
        fn any_vector_has_a_direction(x: f32, y: f32, z: f32) {
            prop_assert!(direction(Vec3::new(x, y, z)) < DIRECTIONS);
        }
    }

    /// Of parallel normals the axis is theirs and the likeness 1, whatever their signs; of all directions 2/3.
    #[test]
    fn axes_of_normals() {
        let sum = |normals: &[Vec3]| {
            normals.iter().fold(Mat3::ZERO, |all, n| all + Mat3::from_cols(*n * n.x, *n * n.y, *n * n.z))
        };
        let n = Vec3::new(2.0, -1.0, 2.0) / 3.0;
        let plate = axis_of(&sum(&[n, -n, n]));
        assert!((plate.dot(n).abs() - 1.0).abs() < 1e-5 && (plate.length() - 1.0).abs() < 1e-5);
        let sphere = axis_of(&sum(&all_around(2000).collect::<Vec<_>>()));
        assert!((sphere.length() - LEAST_LIKENESS).abs() < 0.01, "{sphere}");
        let edge = axis_of(&sum(&[Vec3::X, Vec3::X, Vec3::Y]));
        assert!((edge.x.abs() - (0.5 + 0.5 * 2.0 / 3.0)).abs() < 1e-3, "{edge}");
        assert!((axis_of(&Mat3::ZERO).length() - LEAST_LIKENESS).abs() < 1e-6);
    }

    #[test]
    fn what_only_few_lines_meet_is_left_out() {
        let mut hits = rib(Vec3::Z, 256);
        let mut voxel = coded(7);
        hits.iter_mut().skip(8).for_each(|hit| (hit.part, hit.colour) = (7, RED));
        let (is_new, wrong) = hang_curtains(&hits, &mut voxel);
        assert!(!is_new && voxel == coded(7) && wrong < 0.04);
    }

    #[test]
    fn nothing_met_changes_nothing() {
        let mut voxel = coded(7);
        assert_eq!(hang_curtains(&[], &mut voxel), (false, 0.0));
        assert_eq!(voxel, coded(7));
    }

    #[test]
    fn parts_with_large_numbers_have_no_curtains() {
        let mut hits = rib(Vec3::Z, 64);
        hits.iter_mut().filter(|hit| hit.part == 9).for_each(|hit| hit.part = PARTS);
        assert!(!hang_curtains(&hits, &mut coded(7)).0);
    }

    /// The colours of a cell of several parts become those of what is met first where no curtain hides it.
    #[test]
    fn mixed_cells_take_the_colours_that_are_seen() {
        let mut voxel = coded(7);
        voxel.words[2] |= 1 << 31;
        hang_curtains(&rib(Vec3::Z, 256), &mut voxel);
        assert!(stored_colour(voxel.words[1]).distance(RED) < 0.01);
    }
}
