//! What a vector type can do. Few operations on purpose.

use std::ops::{Add, Mul, Sub};

/// A set of lanes, one bit each.
pub trait Mask: Copy {
    /// Bit `i` is lane `i`.
    fn bits(self) -> u32;
    /// Lanes in both.
    fn and(self, o: Self) -> Self;
    /// Lanes in either.
    fn or(self, o: Self) -> Self;
}

/// `N` floats, elementwise. IEEE single precision, round to nearest.
///
/// `min` and `max` return `o` where either operand is NaN, as x86 does.
pub trait Lanes<const N: usize>: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// A set of its lanes.
    type Mask: Mask;
    /// Elementwise quotient.
    fn div(self, o: Self) -> Self;
    /// Elementwise `self * a + b`, rounded once or twice as the set has it: only for what need not be the
    /// same to the bit on every set.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Elementwise least.
    fn min(self, o: Self) -> Self;
    /// Elementwise greatest.
    fn max(self, o: Self) -> Self;
    /// The least lane; none is NaN.
    fn least(self) -> f32;
    /// The greatest lane; none is NaN.
    fn greatest(self) -> f32;
    /// Lanes where `self <= o`; false for NaN.
    fn le(self, o: Self) -> Self::Mask;
    /// Lanes where `self == o`; false for NaN.
    fn eq(self, o: Self) -> Self::Mask;
    /// `self` in the lanes of `mask`, `o` elsewhere.
    fn select(self, mask: Self::Mask, o: Self) -> Self;
    /// `v` as lanes; `like` is any vector, which vouches for the instruction set.
    fn from_array_like(like: Self, v: [f32; N]) -> Self;
    /// All lanes in order.
    fn to_array(self) -> [f32; N];
}

/// The token of an instruction set: makes vectors of it.
pub trait Simd: Copy {
    /// Eight floats.
    type F8: Lanes<8>;
    /// Sixteen floats.
    type F16: Lanes<16>;
    /// Eight indices below 16.
    type Index8: Copy;

    /// All eight lanes `v`.
    fn splat8(self, v: f32) -> Self::F8;
    /// Eight floats.
    fn load8(self, v: &[f32; 8]) -> Self::F8;
    /// `2^(e - 127)` in all lanes, for each of the three low bytes `e` of `word`; `e` 0 gives 0.
    fn powers8(self, word: u32) -> [Self::F8; 3];
    /// Eight bytes as floats 0 to 255.
    fn bytes8(self, v: &[u8; 8]) -> Self::F8;
    /// Of eight words `count` bits, below 24, from bit `from` on, as floats.
    fn fields8(self, words: &[u32; 8], from: u32, count: u32) -> Self::F8;
    /// Eight indices from bytes; only their low four bits count.
    fn index8(self, v: &[u8; 8]) -> Self::Index8;
    /// A table of sixteen floats: the first eight, and the others.
    fn table16(self, v: &[f32; 16]) -> [Self::F8; 2];
    /// A table of `first`, and of the floats whose bits are its bits plus a step: of entry `i`, from 1 on, the signed
    /// number of 24 bits in bytes `3 i + 1` to `3 i + 3` of `steps`.
    fn steps16(self, first: f32, steps: &[u8; 52]) -> [Self::F8; 2];
    /// The numbers (bit `i`: number `i`) that are the first plus a signed number of 24 bits.
    fn near16(self, v: &[u32; 16]) -> u32;
    /// What [`Simd::steps16`] reads, from its fifth byte on, of numbers that are near: the steps from the first one to
    /// the others, three bytes each. What is written behind these 45 is of no use.
    fn put_steps16(self, v: &[u32; 16], out: &mut [u8; 52]);
    /// `table[i]` for each index `i`.
    fn lookup16(self, table: [Self::F8; 2], index: Self::Index8) -> Self::F8;
    /// `origin[axis] * inv[axis] + off[axis]`, the same with `off[axis + 4]`, and `2^(e - 127) * inv[axis]`, each in
    /// all lanes, for the three axes. `head`: three floats `origin`, and a word whose three low bytes are `e`.
    fn slabs(self, head: &[u32; 4], inv: &[f32; 4], off: &[f32; 8]) -> [[Self::F8; 3]; 3];
    /// `out[i][j] = rows[j][i]`.
    fn transpose16(self, rows: &[[f32; 16]; 16], out: &mut [[f32; 16]; 16]);
    /// `out[i]` holds `rows[j][first + i]` in lane `j`; `first` is 12 at most.
    fn columns4(self, rows: &[[f32; 16]; 16], first: usize) -> [Self::F16; 4];
    /// Sorts the children of a node: those in `hits` (bit `i`: lane `i`) come first, by descending `enter` (not
    /// negative), then whatever. Writes their `enter`, its last three bits cleared, and their `child`.
    fn far_first(
        self,
        enter: Self::F8,
        hits: u32,
        child: &[u16; 8],
        enter_out: &mut [f32; 8],
        child_out: &mut [u32; 8],
    );
    /// All sixteen lanes `v`.
    fn splat16(self, v: f32) -> Self::F16;
    /// The lanes of `bits` (bit `i`: lane `i`).
    fn mask16(self, bits: u32) -> <Self::F16 as Lanes<16>>::Mask;
    /// Sixteen floats.
    fn load16(self, v: &[f32; 16]) -> Self::F16;
    /// The lanes (bit `i`: lane `i`) whose bits in `mask` are those of `bits`.
    fn same16(self, v: &[f32; 16], mask: u32, bits: u32) -> u32;
}
