//! Operations of vector types. They are few on purpose.

use super::doubles::Doubles;
use std::ops::{Add, Mul, Sub};

/// A set of lanes, one bit each.
pub trait Mask: Copy {
    /// Returns a mask whose bit `i` is lane `i`.
    fn bits(self) -> u32;
    /// Returns the lanes that are in both sets.
    fn and(self, o: Self) -> Self;
    /// Returns the lanes that are in either set.
    fn or(self, o: Self) -> Self;
}

/// `N` floats with elementwise operations, in IEEE single precision, rounded to nearest.
///
/// `min` and `max` return the lane of `o` if either operand is NaN, as the x86 instructions do.
pub trait Lanes<const N: usize>: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// A set of lanes of this vector.
    type Mask: Mask;
    /// Elementwise quotient.
    fn div(self, o: Self) -> Self;
    /// Elementwise `self * a + b`, rounded once or twice, depending on the set. It is only for results that may differ
    /// between sets.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Elementwise minimum.
    fn min(self, o: Self) -> Self;
    /// Elementwise maximum.
    fn max(self, o: Self) -> Self;
    /// The least lane; no lane is NaN.
    fn least(self) -> f32;
    /// The greatest lane; no lane is NaN.
    fn greatest(self) -> f32;
    /// Lanes where `self <= o`; false for NaN.
    fn le(self, o: Self) -> Self::Mask;
    /// Lanes where `self == o`; false for NaN.
    fn eq(self, o: Self) -> Self::Mask;
    /// `self` in the lanes of `mask`, `o` elsewhere.
    fn select(self, mask: Self::Mask, o: Self) -> Self;
    /// `v` as lanes. `like` is any vector of this type, which proves that the CPU has the instruction set.
    fn from_array_like(like: Self, v: [f32; N]) -> Self;
    /// All lanes in order.
    fn to_array(self) -> [f32; N];
}

/// The token of an instruction set, through which vectors of the set are made.
pub trait Simd: Copy {
    /// Eight floats.
    type F8: Lanes<8>;
    /// Sixteen floats.
    type F16: Lanes<16>;
    /// Four doubles.
    type D4: Doubles;
    /// Eight indices below 16.
    type Index8: Copy;

    /// `v` in all eight lanes.
    fn splat8(self, v: f32) -> Self::F8;
    /// Loads eight floats.
    fn load8(self, v: &[f32; 8]) -> Self::F8;
    /// `2^(e - 127)` in all lanes, for each of the three low bytes `e` of `word`; `e` = 0 gives 0.
    fn powers8(self, word: u32) -> [Self::F8; 3];
    /// Eight bytes as floats 0 to 255.
    fn bytes8(self, v: &[u8; 8]) -> Self::F8;
    /// Bits `from` to `from + count - 1` of each of eight words, as floats; `count` < 24.
    fn fields8(self, words: &[u32; 8], from: u32, count: u32) -> Self::F8;
    /// Eight indices from bytes; only the low four bits of each count.
    fn index8(self, v: &[u8; 8]) -> Self::Index8;
    /// A table of sixteen floats, in two vectors.
    fn table16(self, v: &[f32; 16]) -> [Self::F8; 2];
    /// A table of sixteen floats that are coded as steps: entry 0 is `first`; the bits of entry `i` are the bits of
    /// `first` plus the signed 24-bit number in bytes `3 i + 1` to `3 i + 3` of `steps`.
    fn steps16(self, first: f32, steps: &[u8; 52]) -> [Self::F8; 2];
    /// Returns a mask of the numbers whose difference to the first one, modulo 2^32, is a signed 24-bit number (bit
    /// `i`: number `i`).
    fn near16(self, v: &[u32; 16]) -> u32;
    /// Writes the steps from the first number to the others, three bytes each: the bytes that [`Simd::steps16`] reads
    /// from byte 4 of its `steps` on. They are the first 45 bytes of `out`; the content of the others is undefined. All
    /// numbers are in [`Simd::near16`].
    fn put_steps16(self, v: &[u32; 16], out: &mut [u8; 52]);
    /// `table[i]` for each index `i`.
    fn lookup16(self, table: [Self::F8; 2], index: Self::Index8) -> Self::F8;
    /// Returns `origin[axis] * inv[axis] + off[axis]`, the same with `off[axis + 4]`, and `2^(e - 127) * inv[axis]`,
    /// each in all lanes, for the three axes. `head`: three floats `origin`, and a word whose three low bytes are the
    /// exponents `e`.
    fn slabs(self, head: &[u32; 4], inv: &[f32; 4], off: &[f32; 8]) -> [[Self::F8; 3]; 3];
    /// `out[i][j] = rows[j][i]`.
    fn transpose16(self, rows: &[[f32; 16]; 16], out: &mut [[f32; 16]; 16]);
    /// Lane `j` of `out[i]` is `rows[j][first + i]`; `first` is at most 12.
    fn columns4(self, rows: &[[f32; 16]; 16], first: usize) -> [Self::F16; 4];
    /// Sorts the children of a node. Those in `hits` (bit `i`: lane `i`) come first, by descending `enter`, which is
    /// not negative; the content of the other lanes is undefined. Writes the `enter` of each, with its last three bits
    /// cleared, and its `child`.
    fn far_first(
        self,
        enter: Self::F8,
        hits: u32,
        child: &[u16; 8],
        enter_out: &mut [f32; 8],
        child_out: &mut [u32; 8],
    );
    /// [`Simd::far_first`] for links of 32 bits.
    fn order8(self, enter: Self::F8, hits: u32, child: &[u32; 8], enter_out: &mut [f32; 8], child_out: &mut [u32; 8]);
    /// Moves the lanes of `keep` (bit `i`: lane `i`) to the front, in order, with their links; the content of the other
    /// lanes is undefined.
    fn pack8(self, t: Self::F8, keep: u32, child: &[u32; 8], t_out: &mut [f32; 8], child_out: &mut [u32; 8]);
    /// `v` in all sixteen lanes.
    fn splat16(self, v: f32) -> Self::F16;
    /// The lanes of `bits` (bit `i`: lane `i`).
    fn mask16(self, bits: u32) -> <Self::F16 as Lanes<16>>::Mask;
    /// Loads sixteen floats.
    fn load16(self, v: &[f32; 16]) -> Self::F16;
    /// Returns a mask of the lanes whose bits in `mask` equal `bits` (bit `i`: lane `i`).
    fn same16(self, v: &[f32; 16], mask: u32, bits: u32) -> u32;
    /// `v` in all four lanes.
    fn splat_d4(self, v: f64) -> Self::D4;
    /// Loads four doubles.
    fn load_d4(self, v: &[f64; 4]) -> Self::D4;
}
