//! A leaf of a block in trace form.
//!
//! A leaf holds 1 to [`MAX_TRIANGLES`] triangles over at most [`MAX_VERTICES`] vertices, which the triangles share. The
//! limits fit vector registers of 8 and 16 lanes.
//!
//! | words | content |
//! |---|---|
//! | 0 | triangles (u8), vertices (u8), index of the first triangle in the block (u16) |
//! | 1 | part (u16, index into the block's parts), with [`MIXED`] that of the first triangle; flags (u16) |
//! | .. | with [`MIXED`]: a u16 part for each triangle, padded to a word |
//! | .. | without [`APART`]: vertex numbers of the triangles: three runs of u8, padded together to a word |
//! | .. | without [`NEAR`]: x of all vertices, then y, then z: f32 |
//! | .. | with [`NEAR`]: x, y, z of the first vertex: f32 |
//! | .. | with [`NEAR`]: steps of the other vertices: i24, all x, then y, then z, padded together to a word |
//!
//! The runs of vertex numbers hold the first corners of all triangles, the second corners, and the third corners. A
//! step is the difference between the bits of a coordinate and those of the first vertex's coordinate.
//!
//! The content of a leaf determines its form. A leaf is apart if no vertex is shared and corner `c` of triangle `i` is
//! vertex `3 i + c`. A leaf is near if it is apart, has at least [`LEAST_NEAR`] vertices, and all steps fit 24 bits.
//! Floats of one sign are ordered like their bits, so steps fit where a coordinate changes by less than about a half of
//! itself. (In soups of long thin triangles nine tenths of the leaves are near, which saves 15 of 84 bytes a triangle.
//! On scans, which share vertices, steps would save as many bytes, but branches on the form of a leaf would be
//! mispredicted.)

use super::layout::{LINE_WORDS, MAX_TRIANGLES, MAX_VERTICES, PAD_WORDS};
use crate::simd::{Portable, Simd};
use bytemuck::{cast_slice, cast_slice_mut, must_cast_ref};
use glam::Vec3;

/// Flag: the triangles belong to several parts.
pub const MIXED: u16 = 1;
/// Flag: each corner has a vertex of its own, in order.
pub const APART: u16 = 2;
/// Flag: coordinates are stored as steps from the first vertex.
pub const NEAR: u16 = 4;

/// Least number of vertices for which coordinates are stored as steps.
pub const LEAST_NEAR: usize = 6;

/// Bytes that hold the steps of sixteen vertices on one axis, see [`Coordinates::Near`]: 49 bytes, and 3 more that
/// vector code reads in four loads of 16 bytes from offsets 0, 12, 24 and 36. Writes begin at offset 4, and reach up to
/// four bytes beyond the last step.
pub const STEP_BYTES: usize = 52;

/// Sixteen numbers are read and written even if a leaf has fewer. Other leaves, or zeros, follow the last axis.
const _: () =
    assert!(2 * 3 + MAX_VERTICES <= 3 * 3 + PAD_WORDS && 4 * 3 + 6 * 2 + STEP_BYTES <= 4 * 3 + 9 * 2 + 4 * PAD_WORDS);

/// Vertex numbers, by corner, of leaves with triangles that share no vertices.
pub const ORDER: [[u8; MAX_TRIANGLES]; 3] = {
    let mut order = [[0; MAX_TRIANGLES]; 3];
    let mut at = 0;
    while at < 3 * MAX_TRIANGLES {
        // Entries past the greatest possible number of triangles have no meaning.
        order[at % 3][at / 3] = at as u8 % MAX_VERTICES as u8;
        at += 1;
    }
    order
};

/// The storage form of a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LeafForm {
    /// Number of triangles, 1 to [`MAX_TRIANGLES`].
    pub triangles: usize,
    /// Number of vertices, 3 to [`MAX_VERTICES`].
    pub vertices: usize,
    /// [`MIXED`], [`APART`], [`NEAR`].
    pub flags: u16,
}

impl LeafForm {
    /// Returns the form of a leaf. `are_in_order` is true if its corners are as in [`ORDER`]; `axes` holds the bits of
    /// its coordinates, axis by axis.
    #[inline(always)]
    pub fn of<S: Simd>(
        s: S,
        (triangles, vertices): (usize, usize),
        is_mixed: bool,
        are_in_order: bool,
        axes: [&[u32; MAX_VERTICES]; 3],
    ) -> Self {
        let mut flags = if is_mixed { MIXED } else { 0 };
        if are_in_order && vertices == 3 * triangles {
            flags |= APART;
            // Written out axis by axis: the closure of an array's `map` is not compiled for the instruction set.
            let near = s.near16(axes[0]) & s.near16(axes[1]) & s.near16(axes[2]);
            let all = (1 << vertices) - 1;
            if vertices >= LEAST_NEAR && near & all == all {
                flags |= NEAR;
            }
        }
        Self { triangles, vertices, flags }
    }

    /// Words before the coordinates.
    #[inline(always)]
    pub const fn head_words(&self) -> usize {
        let parts = if self.flags & MIXED != 0 { self.triangles.div_ceil(2) } else { 0 };
        2 + parts + if self.flags & APART != 0 { 0 } else { index_words(self.triangles) }
    }

    /// Words of the leaf.
    #[inline(always)]
    pub const fn words(&self) -> usize {
        self.head_words()
            + if self.flags & NEAR != 0 { 3 + (9 * (self.vertices - 1)).div_ceil(4) } else { 3 * self.vertices }
    }
}

/// Words of the vertex numbers of `triangles` triangles.
#[inline(always)]
pub const fn index_words(triangles: usize) -> usize {
    (3 * triangles).div_ceil(4)
}

/// Writes the coordinates of a leaf, given as bits, axis by axis. Returns the number of words. On each axis the
/// function writes sixteen numbers, or [`STEP_BYTES`], and so overwrites words beyond the end.
#[inline(always)]
pub fn put_coordinates<S: Simd>(s: S, words: &mut [u32], form: LeafForm, axes: [&[u32; MAX_VERTICES]; 3]) -> usize {
    let count = form.vertices;
    if form.flags & NEAR == 0 {
        for (axis, bits) in axes.iter().enumerate() {
            words[axis * count..axis * count + MAX_VERTICES].copy_from_slice(*bits);
        }
        return 3 * count;
    }
    let (firsts, steps) = words.split_at_mut(3);
    let bytes: &mut [u8] = cast_slice_mut(steps);
    for (axis, bits) in axes.iter().enumerate() {
        firsts[axis] = bits[0];
        match bytes[3 * axis * (count - 1)..].first_chunk_mut::<STEP_BYTES>() {
            Some(own) => s.put_steps16(bits, own),
            None => unreachable!(),
        }
    }
    // Clears the bytes that the last axis wrote beyond its end, up to the end of the word.
    let end = 9 * (count - 1);
    bytes[end..end + 4].fill(0);
    3 + end.div_ceil(4)
}

/// One leaf of a block.
#[derive(Debug, Clone, Copy)]
pub struct Leaf<'a> {
    /// Number of triangles, 1 to [`MAX_TRIANGLES`].
    pub triangles: usize,
    /// Number of vertices, 3 to [`MAX_VERTICES`].
    pub vertices: usize,
    /// Index of its first triangle in the block.
    pub first: usize,
    part: usize,
    flags: u16,
    words: &'a [u32],
}

/// Sixteen coordinates of a leaf on one axis. Those past the last vertex are arbitrary.
#[derive(Debug, Clone, Copy)]
pub enum Coordinates<'a> {
    /// Coordinates as floats.
    Whole(&'a [f32; MAX_VERTICES]),
    /// Coordinate of the first vertex, and bytes of which `3 i + 1` to `3 i + 3` are the step of vertex `i`, for `i`
    /// from 1 on.
    Near(f32, &'a [u8; STEP_BYTES]),
}

impl Coordinates<'_> {
    /// Coordinate of vertex `index`, which is below [`MAX_VERTICES`].
    #[inline(always)]
    pub fn get(self, index: usize) -> f32 {
        let index = index & (MAX_VERTICES - 1);
        match self {
            Coordinates::Whole(all) => all[index],
            Coordinates::Near(first, steps) => {
                let [a, b, c, d] = [0, 1, 2, 3].map(|byte| steps[3 * index + byte]);
                let step = i32::from_le_bytes([a, b, c, d]) >> 8;
                f32::from_bits(first.to_bits().wrapping_add_signed(if index == 0 { 0 } else { step }))
            }
        }
    }

    /// Coordinates of all vertices.
    #[inline(always)]
    pub fn to_array(self) -> [f32; MAX_VERTICES] {
        match self {
            Coordinates::Whole(all) => *all,
            Coordinates::Near(..) => std::array::from_fn(|i| self.get(i)),
        }
    }
}

impl<'a> Leaf<'a> {
    /// Returns the leaf that begins with the first of these words.
    #[inline(always)]
    pub fn at(words: &'a [u32]) -> Self {
        let (counts, parts) = (words[0], words[1]);
        Self {
            triangles: (counts & 0xff) as usize,
            vertices: (counts >> 8 & 0xff) as usize,
            first: (counts >> 16) as usize,
            part: (parts & 0xffff) as usize,
            flags: (parts >> 16) as u16,
            words,
        }
    }

    /// The storage form of the leaf.
    #[inline(always)]
    pub fn form(&self) -> LeafForm {
        LeafForm { triangles: self.triangles, vertices: self.vertices, flags: self.flags }
    }

    /// Words of the leaf.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.form().words()
    }

    /// Number of cache lines that the leaf occupies if it begins at word `at` of its block.
    #[inline(always)]
    pub fn lines(&self, at: usize) -> usize {
        (at + self.len() - 1) / LINE_WORDS - at / LINE_WORDS + 1
    }

    /// Always false: a leaf has at least one triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles == 0
    }

    /// Vertex numbers of one corner of eight triangles. Those past the last triangle are arbitrary.
    #[inline(always)]
    pub fn corners8(&self, corner: usize) -> &'a [u8; 8] {
        if self.flags & APART != 0 {
            return &ORDER[corner];
        }
        let parts = if self.is_mixed() { self.triangles.div_ceil(2) } else { 0 };
        let bytes: &[u8] = cast_slice(&self.words[2 + parts..]);
        match bytes[corner * self.triangles..].first_chunk::<8>() {
            Some(chunk) => chunk,
            None => unreachable!(),
        }
    }

    /// Returns the form that the leaf must have, given the bits of its coordinates.
    pub fn form_for(&self, axes: [&[u32; MAX_VERTICES]; 3]) -> LeafForm {
        let is_in_order = |corner: usize| self.corners8(corner)[..self.triangles] == ORDER[corner][..self.triangles];
        LeafForm::of(Portable::new(), (self.triangles, self.vertices), self.is_mixed(), (0..3).all(is_in_order), axes)
    }

    /// True if coordinates are stored as steps, on all axes.
    #[inline(always)]
    pub fn is_near(&self) -> bool {
        self.flags & NEAR != 0
    }

    /// Coordinates on `axis`.
    #[inline(always)]
    pub fn coordinates(&self, axis: usize) -> Coordinates<'a> {
        let at = self.form().head_words();
        if !self.is_near() {
            return match self.words[at + axis * self.vertices..].first_chunk::<MAX_VERTICES>() {
                Some(chunk) => Coordinates::Whole(must_cast_ref(chunk)),
                None => unreachable!(),
            };
        }
        let bytes: &[u8] = cast_slice(&self.words[at + 2..]);
        match bytes[3 * axis * (self.vertices - 1)..].first_chunk::<STEP_BYTES>() {
            Some(steps) => Coordinates::Near(f32::from_bits(self.words[at + axis]), steps),
            None => unreachable!(),
        }
    }

    /// The corners of triangle `index`, which is below [`MAX_TRIANGLES`].
    #[inline(always)]
    pub fn triangle(&self, index: usize) -> [Vec3; 3] {
        let [x, y, z] = [self.coordinates(0), self.coordinates(1), self.coordinates(2)];
        let mut corners = [Vec3::ZERO; 3];
        for (c, corner) in corners.iter_mut().enumerate() {
            let v = usize::from(self.corners8(c)[index & (MAX_TRIANGLES - 1)]);
            *corner = Vec3::new(x.get(v), y.get(v), z.get(v));
        }
        corners
    }

    /// Index into the block's parts for a triangle.
    #[inline(always)]
    pub fn part_of(&self, index: usize) -> usize {
        if self.is_mixed() { (self.words[2 + index / 2] >> (16 * (index % 2)) & 0xffff) as usize } else { self.part }
    }

    /// True if the triangles belong to several parts.
    #[inline(always)]
    pub fn is_mixed(&self) -> bool {
        self.flags & MIXED != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Isa, Op, dispatch};
    use proptest::prelude::*;

    /// Stores a leaf of apart triangles.
    struct Store<'a> {
        axes: &'a [[u32; MAX_VERTICES]; 3],
        triangles: usize,
    }

    impl Op for Store<'_> {
        type Out = (LeafForm, Vec<u32>);

        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> Self::Out {
            let Self { axes, triangles } = self;
            let form = LeafForm::of(s, (triangles, 3 * triangles), false, true, axes.each_ref());
            let mut words = vec![triangles as u32 | (form.vertices as u32) << 8, u32::from(form.flags) << 16];
            words.resize(2 + 4 * MAX_VERTICES, 0);
            put_coordinates(s, &mut words[form.head_words()..], form, axes.each_ref());
            (form, words)
        }
    }

    proptest! {
        /// Coordinates are stored as steps exactly if there are enough vertices and all steps fit 24 bits. All
        /// coordinates are restored to the bit.
        #[test]
        fn coordinates_round_trip(
            first: [u32; 3], bits in 1u32..31, seed: [[u32; MAX_VERTICES]; 3], triangles in 1usize..=5,
        ) {
            let mut axes = seed;
            for (axis, first) in axes.iter_mut().zip(first) {
                axis.iter_mut().for_each(|x| *x = first.wrapping_add_signed((*x as i32) >> bits));
            }
            let (form, words) = dispatch(Isa::Baseline, Store { axes: &axes, triangles });
            for isa in Isa::ALL {
                let (own_form, own_words) = dispatch(isa, Store { axes: &axes, triangles });
                // Words beyond the end are arbitrary.
                let own = (own_form, &own_words[..form.words()]);
                prop_assert_eq!(own, (form, &words[..form.words()]), "{}", isa.name());
            }
            let count = 3 * triangles;
            let step = |axis: &[u32; MAX_VERTICES], i: usize| i64::from(axis[i].wrapping_sub(axis[0]) as i32);
            let fit = axes.iter().all(|axis| (0..count).all(|i| (-(1 << 23)..1 << 23).contains(&step(axis, i))));
            prop_assert_eq!(form.flags, APART | if fit && count >= LEAST_NEAR { NEAR } else { 0 });
            let leaf = Leaf::at(&words);
            for (axis, bits) in axes.iter().enumerate() {
                let all = leaf.coordinates(axis).to_array().map(f32::to_bits);
                prop_assert_eq!(&all[..count], &bits[..count]);
            }
            // The last word is filled up with zeros.
            let bytes: &[u8] = cast_slice(&words[..form.words()]);
            let end = 4 * (form.head_words() + 3) + 9 * (count - 1);
            prop_assert!(!leaf.is_near() || bytes[end..].iter().all(|byte| *byte == 0));
        }
    }

    #[test]
    fn sizes() {
        let words = |triangles, vertices, flags| LeafForm { triangles, vertices, flags }.words();
        assert_eq!(words(8, 16, MIXED), 2 + 4 + 6 + 48);
        assert_eq!(words(1, 3, 0), 2 + 1 + 9);
        assert_eq!(words(1, 3, APART), 2 + 9);
        assert_eq!(words(5, 15, APART | NEAR), 2 + 3 + 32);
    }
}
