//! The baseline: plain arrays, which the compiler vectorises with the target's own set (SSE2, NEON).

use super::doubles::Array4;
use super::lanes::{Lanes, Mask, Simd};
use std::array::from_fn;
use std::ops::{Add, Mul, Sub};

/// Token of the baseline.
#[derive(Debug, Clone, Copy)]
pub struct Portable(());

impl Portable {
    /// Safe to call: every CPU has the baseline.
    #[inline(always)]
    pub fn new() -> Self {
        Self(())
    }
}

impl Default for Portable {
    fn default() -> Self {
        Self::new()
    }
}

/// `N` floats in an array.
#[derive(Debug, Clone, Copy)]
pub struct Array<const N: usize>([f32; N]);

/// A set of lanes, one bit each.
#[derive(Debug, Clone, Copy)]
pub struct Bits(u32);

impl Mask for Bits {
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0
    }
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        Self(self.0 & o.0)
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        Self(self.0 | o.0)
    }
}

macro_rules! elementwise {
    ($trait:ident, $method:ident, $op:tt) => {
        impl<const N: usize> $trait for Array<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, o: Self) -> Self {
                Self(from_fn(|i| self.0[i] $op o.0[i]))
            }
        }
    };
}
elementwise!(Add, add, +);
elementwise!(Sub, sub, -);
elementwise!(Mul, mul, *);

#[inline(always)]
fn bits<const N: usize>(test: impl Fn(usize) -> bool) -> Bits {
    let mut m = 0;
    for i in 0..N {
        m |= u32::from(test(i)) << i;
    }
    Bits(m)
}

impl<const N: usize> Lanes<N> for Array<N> {
    type Mask = Bits;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        Self(from_fn(|i| self.0[i] / o.0[i]))
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        Self(from_fn(|i| if self.0[i] < o.0[i] { self.0[i] } else { o.0[i] }))
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Self(from_fn(|i| if self.0[i] > o.0[i] { self.0[i] } else { o.0[i] }))
    }
    #[inline(always)]
    fn least(self) -> f32 {
        self.0.into_iter().fold(f32::INFINITY, f32::min)
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        self.0.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
    #[inline(always)]
    fn le(self, o: Self) -> Bits {
        bits::<N>(|i| self.0[i] <= o.0[i])
    }
    #[inline(always)]
    fn eq(self, o: Self) -> Bits {
        bits::<N>(|i| self.0[i] == o.0[i])
    }
    #[inline(always)]
    fn select(self, mask: Bits, o: Self) -> Self {
        Self(from_fn(|i| if mask.0 >> i & 1 == 1 { self.0[i] } else { o.0[i] }))
    }
    #[inline(always)]
    fn from_array_like(_like: Self, v: [f32; N]) -> Self {
        Self(v)
    }
    #[inline(always)]
    fn to_array(self) -> [f32; N] {
        self.0
    }
}

impl Simd for Portable {
    type D4 = Array4;
    type F8 = Array<8>;
    type F16 = Array<16>;
    type Index8 = [u8; 8];

    #[inline(always)]
    fn splat_d4(self, v: f64) -> Array4 {
        Array4([v; 4])
    }
    #[inline(always)]
    fn load_d4(self, v: &[f64; 4]) -> Array4 {
        Array4(*v)
    }
    #[inline(always)]
    fn splat8(self, v: f32) -> Array<8> {
        Array([v; 8])
    }
    #[inline(always)]
    fn load8(self, v: &[f32; 8]) -> Array<8> {
        Array(*v)
    }
    #[inline(always)]
    fn powers8(self, word: u32) -> [Array<8>; 3] {
        let [a, b, c, _] = word.to_le_bytes();
        let power = |e: u8| Array([f32::from_bits(u32::from(e) << 23); 8]);
        [power(a), power(b), power(c)]
    }
    #[inline(always)]
    fn bytes8(self, v: &[u8; 8]) -> Array<8> {
        Array(from_fn(|i| f32::from(v[i])))
    }
    #[inline(always)]
    fn fields8(self, words: &[u32; 8], from: u32, count: u32) -> Array<8> {
        Array(from_fn(|i| (words[i] >> from & ((1 << count) - 1)) as f32))
    }
    #[inline(always)]
    fn index8(self, v: &[u8; 8]) -> [u8; 8] {
        *v
    }
    #[inline(always)]
    fn table16(self, v: &[f32; 16]) -> [Array<8>; 2] {
        [Array(from_fn(|i| v[i])), Array(from_fn(|i| v[8 + i]))]
    }
    #[inline(always)]
    fn steps16(self, first: f32, steps: &[u8; 52]) -> [Array<8>; 2] {
        self.table16(&from_fn(|i| {
            let step = i32::from_le_bytes(from_fn(|byte| steps[3 * i + byte])) >> 8;
            f32::from_bits(first.to_bits().wrapping_add_signed(if i == 0 { 0 } else { step }))
        }))
    }
    #[inline(always)]
    fn near16(self, v: &[u32; 16]) -> u32 {
        let mut near = 0;
        for (i, number) in v.iter().enumerate() {
            let beyond = number.wrapping_sub(v[0]).wrapping_add(1 << 23) >> 24;
            near |= u32::from(beyond == 0) << i;
        }
        near
    }
    #[inline(always)]
    fn put_steps16(self, v: &[u32; 16], out: &mut [u8; 52]) {
        let step = |i: usize| u64::from(v[i].wrapping_sub(v[0]) & 0xff_ffff);
        for i in (1..16).step_by(2) {
            // A write has two steps, and two bytes more, which the next write replaces. The last step is written
            // without a second one.
            let both = step(i) | if i < 15 { step(i + 1) << 24 } else { 0 };
            out[3 * (i - 1)..3 * i + 5].copy_from_slice(&both.to_le_bytes());
        }
    }
    #[inline(always)]
    fn lookup16(self, table: [Array<8>; 2], index: [u8; 8]) -> Array<8> {
        Array(from_fn(|i| table[usize::from(index[i] >> 3 & 1)].0[usize::from(index[i] & 7)]))
    }
    #[inline(always)]
    fn slabs(self, head: &[u32; 4], inv: &[f32; 4], off: &[f32; 8]) -> [[Array<8>; 3]; 3] {
        let e = head[3].to_le_bytes();
        let origin = |axis: usize| f32::from_bits(head[axis]) * inv[axis];
        [
            from_fn(|axis| Array([origin(axis) + off[axis]; 8])),
            from_fn(|axis| Array([origin(axis) + off[axis + 4]; 8])),
            from_fn(|axis| Array([f32::from_bits(u32::from(e[axis]) << 23) * inv[axis]; 8])),
        ]
    }
    #[inline(always)]
    fn transpose16(self, rows: &[[f32; 16]; 16], out: &mut [[f32; 16]; 16]) {
        for (i, out) in out.iter_mut().enumerate() {
            for (j, row) in rows.iter().enumerate() {
                out[j] = row[i];
            }
        }
    }
    #[inline(always)]
    fn columns4(self, rows: &[[f32; 16]; 16], first: usize) -> [Array<16>; 4] {
        let mut out = [Array([0.0; 16]); 4];
        for (i, out) in out.iter_mut().enumerate() {
            for (j, row) in rows.iter().enumerate() {
                out.0[j] = row[first.min(12) + i];
            }
        }
        out
    }
    #[inline(always)]
    fn far_first(
        self,
        enter: Array<8>,
        hits: u32,
        child: &[u16; 8],
        enter_out: &mut [f32; 8],
        child_out: &mut [u32; 8],
    ) {
        insert_far_first(enter, hits, child, enter_out, child_out);
    }
    #[inline(always)]
    fn order8(self, enter: Array<8>, hits: u32, child: &[u32; 8], enter_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        insert_far_first(enter, hits, child, enter_out, child_out);
    }
    #[inline(always)]
    fn pack8(self, t: Array<8>, keep: u32, child: &[u32; 8], t_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        for (to, from) in (0..8).filter(|i| keep >> i & 1 == 1).enumerate() {
            (t_out[to], child_out[to]) = (t.0[from], child[from]);
        }
    }
    #[inline(always)]
    fn splat16(self, v: f32) -> Array<16> {
        Array([v; 16])
    }
    #[inline(always)]
    fn mask16(self, bits: u32) -> Bits {
        Bits(bits & 0xffff)
    }
    #[inline(always)]
    fn load16(self, v: &[f32; 16]) -> Array<16> {
        Array(*v)
    }
    #[inline(always)]
    fn same16(self, v: &[f32; 16], mask: u32, bits: u32) -> u32 {
        let mut same = 0;
        for (i, v) in v.iter().enumerate() {
            same |= u32::from(v.to_bits() & mask == bits) << i;
        }
        same
    }
}

/// Sorts the children of a node by insertion: see `Simd::far_first`.
#[inline(always)]
fn insert_far_first<T: Copy + Into<u32>>(
    enter: Array<8>,
    hits: u32,
    child: &[T; 8],
    enter_out: &mut [f32; 8],
    child_out: &mut [u32; 8],
) {
    let met = child.iter().enumerate().filter(|(i, _)| hits >> i & 1 == 1);
    for (count, (i, &to)) in met.enumerate() {
        // Lanes of equal distance are in descending order, as in the other sets.
        let t = f32::from_bits(enter.0[i].to_bits() & !7);
        let mut at = count;
        while at > 0 && enter_out[at - 1] <= t {
            enter_out[at] = enter_out[at - 1];
            child_out[at] = child_out[at - 1];
            at -= 1;
        }
        (enter_out[at], child_out[at]) = (t, to.into());
    }
}
