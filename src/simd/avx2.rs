//! AVX2: eight lanes in a register, sixteen in two.

use super::Op;
use super::doubles::x86::D4;
use super::lanes::{Lanes, Mask, Simd};
use super::order;
use std::arch::x86_64::*;
use std::ops::{Add, Mul, Sub};

/// Token of AVX2: exists only on a CPU that has it.
#[derive(Debug, Clone, Copy)]
pub struct Avx2(());

/// Runs `op` compiled for AVX2.
///
/// # Safety
/// The CPU must have every feature that `Isa::Avx2.is_available()` tests.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn run<O: Op>(op: O) -> O::Out {
    op.run(Avx2(()))
}

/// Eight floats.
#[derive(Debug, Clone, Copy)]
pub struct V8(__m256);

/// A set of lanes. A lane is in the set if its sign bit is set.
#[derive(Debug, Clone, Copy)]
pub struct M8(__m256);

impl Mask for M8 {
    #[inline(always)]
    fn bits(self) -> u32 {
        // SAFETY: a mask exists only on a CPU that has the set (see the head of `simd`).
        unsafe { _mm256_movemask_ps(self.0) as u32 }
    }
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        // SAFETY: as in `bits`.
        Self(unsafe { _mm256_and_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        // SAFETY: as in `bits`.
        Self(unsafe { _mm256_or_ps(self.0, o.0) })
    }
}

impl Add for V8 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        // SAFETY: a vector exists only on a CPU that has the set (see the head of `simd`).
        Self(unsafe { _mm256_add_ps(self.0, o.0) })
    }
}
impl Sub for V8 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_sub_ps(self.0, o.0) })
    }
}
impl Mul for V8 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_mul_ps(self.0, o.0) })
    }
}
impl Lanes<8> for V8 {
    type Mask = M8;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_div_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_fmadd_ps(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_min_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_max_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn least(self) -> f32 {
        // SAFETY: as in `add`.
        unsafe { least8(self.0) }
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        // SAFETY: as in `add`.
        unsafe { greatest8(self.0) }
    }
    #[inline(always)]
    fn le(self, o: Self) -> M8 {
        // SAFETY: as in `add`.
        M8(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, o.0) })
    }
    #[inline(always)]
    fn eq(self, o: Self) -> M8 {
        // SAFETY: as in `add`.
        M8(unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, o.0) })
    }
    #[inline(always)]
    fn select(self, mask: M8, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_blendv_ps(o.0, self.0, mask.0) })
    }
    #[inline(always)]
    fn from_array_like(_like: Self, v: [f32; 8]) -> Self {
        // SAFETY: as in `add`, by way of `_like`; `v` holds 8 floats.
        Self(unsafe { _mm256_loadu_ps(v.as_ptr()) })
    }
    #[inline(always)]
    fn to_array(self) -> [f32; 8] {
        let mut out = [0.0; 8];
        // SAFETY: as in `add`; `out` holds 8 floats, and the store needs no alignment.
        unsafe { _mm256_storeu_ps(out.as_mut_ptr(), self.0) };
        out
    }
}

/// Two vectors or masks: sixteen lanes.
#[derive(Debug, Clone, Copy)]
pub struct Pair<T>(T, T);

impl Mask for Pair<M8> {
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.bits() | self.1.bits() << 8
    }
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        Self(self.0.and(o.0), self.1.and(o.1))
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        Self(self.0.or(o.0), self.1.or(o.1))
    }
}
impl Add for Pair<V8> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1)
    }
}
impl Sub for Pair<V8> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self(self.0 - o.0, self.1 - o.1)
    }
}
impl Mul for Pair<V8> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self(self.0 * o.0, self.1 * o.1)
    }
}
impl Lanes<16> for Pair<V8> {
    type Mask = Pair<M8>;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        Self(self.0.div(o.0), self.1.div(o.1))
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self(self.0.mul_add(a.0, b.0), self.1.mul_add(a.1, b.1))
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        Self(self.0.min(o.0), self.1.min(o.1))
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Self(self.0.max(o.0), self.1.max(o.1))
    }
    #[inline(always)]
    fn least(self) -> f32 {
        self.0.min(self.1).least()
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        self.0.max(self.1).greatest()
    }
    #[inline(always)]
    fn le(self, o: Self) -> Pair<M8> {
        Pair(self.0.le(o.0), self.1.le(o.1))
    }
    #[inline(always)]
    fn eq(self, o: Self) -> Pair<M8> {
        Pair(self.0.eq(o.0), self.1.eq(o.1))
    }
    #[inline(always)]
    fn select(self, mask: Pair<M8>, o: Self) -> Self {
        Self(self.0.select(mask.0, o.0), self.1.select(mask.1, o.1))
    }
    #[inline(always)]
    fn from_array_like(like: Self, v: [f32; 16]) -> Self {
        let [low, high]: [[f32; 8]; 2] = bytemuck::must_cast(v);
        Self(V8::from_array_like(like.0, low), V8::from_array_like(like.1, high))
    }
    #[inline(always)]
    fn to_array(self) -> [f32; 16] {
        let mut out = [0.0; 16];
        out[..8].copy_from_slice(&self.0.to_array());
        out[8..].copy_from_slice(&self.1.to_array());
        out
    }
}

impl Simd for Avx2 {
    type D4 = D4;
    type F8 = V8;
    type F16 = Pair<V8>;
    type Index8 = __m256i;

    #[inline(always)]
    fn splat_d4(self, v: f64) -> D4 {
        // SAFETY: the token proves that the CPU has the set.
        D4(unsafe { _mm256_set1_pd(v) })
    }
    #[inline(always)]
    fn load_d4(self, v: &[f64; 4]) -> D4 {
        // SAFETY: as above; `v` holds 4 doubles, and the load needs no alignment.
        D4(unsafe { _mm256_loadu_pd(v.as_ptr()) })
    }
    #[inline(always)]
    fn splat8(self, v: f32) -> V8 {
        // SAFETY: the token `self` proves that the CPU has the set.
        V8(unsafe { _mm256_set1_ps(v) })
    }
    #[inline(always)]
    fn load8(self, v: &[f32; 8]) -> V8 {
        // SAFETY: as in `splat8`; `v` holds eight floats, and the load needs no alignment.
        V8(unsafe { _mm256_loadu_ps(v.as_ptr()) })
    }
    #[inline(always)]
    fn powers8(self, word: u32) -> [V8; 3] {
        // SAFETY: as in `splat8`.
        unsafe {
            let word = _mm256_set1_epi32(word as i32);
            let low = _mm256_set1_epi32(0xff);
            let x = _mm256_slli_epi32::<23>(_mm256_and_si256(word, low));
            let y = _mm256_slli_epi32::<23>(_mm256_and_si256(_mm256_srli_epi32::<8>(word), low));
            let z = _mm256_slli_epi32::<23>(_mm256_and_si256(_mm256_srli_epi32::<16>(word), low));
            [V8(_mm256_castsi256_ps(x)), V8(_mm256_castsi256_ps(y)), V8(_mm256_castsi256_ps(z))]
        }
    }
    #[inline(always)]
    fn bytes8(self, v: &[u8; 8]) -> V8 {
        // SAFETY: as in `splat8`.
        V8(unsafe { _mm256_cvtepi32_ps(self.index8(v)) })
    }
    #[inline(always)]
    fn fields8(self, words: &[u32; 8], from: u32, count: u32) -> V8 {
        // SAFETY: as in `splat8`; `words` are eight, and the load needs no alignment.
        V8(unsafe {
            let words = _mm256_srl_epi32(_mm256_loadu_si256(words.as_ptr().cast()), _mm_cvtsi32_si128(from as i32));
            _mm256_cvtepi32_ps(_mm256_and_si256(words, _mm256_set1_epi32((1 << count) - 1)))
        })
    }
    #[inline(always)]
    fn index8(self, v: &[u8; 8]) -> __m256i {
        // SAFETY: as in `splat8`.
        unsafe { _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(*v))) }
    }
    #[inline(always)]
    fn table16(self, v: &[f32; 16]) -> [V8; 2] {
        // SAFETY: as in `splat8`; both loads lie inside `v`.
        unsafe { [V8(_mm256_loadu_ps(v.as_ptr())), V8(_mm256_loadu_ps(v.as_ptr().add(8)))] }
    }
    #[inline(always)]
    fn steps16(self, first: f32, steps: &[u8; 52]) -> [V8; 2] {
        // SAFETY: as in `splat8`.
        let [low, high] = unsafe { steps16(first, steps) };
        [V8(low), V8(high)]
    }
    #[inline(always)]
    fn near16(self, v: &[u32; 16]) -> u32 {
        // SAFETY: as in `splat8`; the loads are of half the numbers each, and need no alignment.
        unsafe {
            let (less, zero) = (_mm256_set1_epi32(v[0].wrapping_sub(1 << 23) as i32), _mm256_setzero_si256());
            let (low, high) = (_mm256_loadu_si256(v.as_ptr().cast()), _mm256_loadu_si256(v.as_ptr().add(8).cast()));
            let low = _mm256_srli_epi32::<24>(_mm256_sub_epi32(low, less));
            let high = _mm256_srli_epi32::<24>(_mm256_sub_epi32(high, less));
            let low = _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(low, zero)));
            let high = _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(high, zero)));
            low as u32 | (high as u32) << 8
        }
    }
    #[inline(always)]
    fn put_steps16(self, v: &[u32; 16], out: &mut [u8; 52]) {
        // SAFETY: as in `splat8`.
        unsafe { put_steps16(v, out) }
    }
    #[inline(always)]
    fn lookup16(self, [V8(low), V8(high)]: [V8; 2], index: __m256i) -> V8 {
        // SAFETY: as in `splat8`.
        V8(unsafe {
            let (low, high) = (_mm256_permutevar8x32_ps(low, index), _mm256_permutevar8x32_ps(high, index));
            // Bit 3 of the index, shifted to the sign, selects the half of the table.
            _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index)))
        })
    }
    #[inline(always)]
    fn slabs(self, head: &[u32; 4], inv: &[f32; 4], off: &[f32; 8]) -> [[V8; 3]; 3] {
        // SAFETY: as in `splat8`.
        let [near, far, slope] = unsafe { slabs(head, inv, off) };
        [
            [V8(near[0]), V8(near[1]), V8(near[2])],
            [V8(far[0]), V8(far[1]), V8(far[2])],
            [V8(slope[0]), V8(slope[1]), V8(slope[2])],
        ]
    }
    #[inline(always)]
    fn transpose16(self, rows: &[[f32; 16]; 16], out: &mut [[f32; 16]; 16]) {
        for (down, across) in [(0, 0), (0, 8), (8, 0), (8, 8)] {
            // SAFETY: as in `splat8`; the 8 x 8 squares lie inside the arrays.
            unsafe { transpose8(rows, out, down, across) }
        }
    }
    #[inline(always)]
    fn columns4(self, rows: &[[f32; 16]; 16], first: usize) -> [Pair<V8>; 4] {
        // SAFETY: as in `splat8`.
        let [low, high] = unsafe { [columns4(rows, 0, first), columns4(rows, 8, first)] };
        [Pair(low[0], high[0]), Pair(low[1], high[1]), Pair(low[2], high[2]), Pair(low[3], high[3])]
    }
    #[inline(always)]
    fn far_first(self, enter: V8, hits: u32, child: &[u16; 8], enter_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        // SAFETY: as in `splat8`.
        unsafe {
            let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let mask = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(hits as i32), bits), bits);
            far_first(enter.0, mask, child, enter_out, child_out);
        }
    }
    #[inline(always)]
    fn order8(self, enter: V8, hits: u32, child: &[u32; 8], enter_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        // SAFETY: as in `splat8`.
        unsafe { order::order8_avx2(enter.0, hits, child, enter_out, child_out) }
    }
    #[inline(always)]
    fn pack8(self, t: V8, keep: u32, child: &[u32; 8], t_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        // SAFETY: as in `splat8`.
        unsafe { order::pack8_avx2(t.0, keep, child, t_out, child_out) }
    }
    #[inline(always)]
    fn splat16(self, v: f32) -> Pair<V8> {
        Pair(self.splat8(v), self.splat8(v))
    }
    #[inline(always)]
    fn mask16(self, bits: u32) -> Pair<M8> {
        // SAFETY: as in `splat8`.
        unsafe {
            let (bits, eight) = (_mm256_set1_epi32(bits as i32), _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128));
            let low = _mm256_cmpeq_epi32(_mm256_and_si256(bits, eight), eight);
            let eight = _mm256_slli_epi32::<8>(eight);
            let high = _mm256_cmpeq_epi32(_mm256_and_si256(bits, eight), eight);
            Pair(M8(_mm256_castsi256_ps(low)), M8(_mm256_castsi256_ps(high)))
        }
    }
    #[inline(always)]
    fn load16(self, v: &[f32; 16]) -> Pair<V8> {
        let (low, high) = v.split_at(8);
        match (low.try_into(), high.try_into()) {
            (Ok(low), Ok(high)) => Pair(self.load8(low), self.load8(high)),
            _ => unreachable!(),
        }
    }
    #[inline(always)]
    fn same16(self, v: &[f32; 16], mask: u32, bits: u32) -> u32 {
        let Pair(low, high) = self.load16(v);
        // SAFETY: as in `splat8`.
        unsafe {
            let (mask, bits) = (_mm256_set1_epi32(mask as i32), _mm256_set1_epi32(bits as i32));
            let low = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_castps_si256(low.0), mask), bits);
            let high = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_castps_si256(high.0), mask), bits);
            Pair(M8(_mm256_castsi256_ps(low)), M8(_mm256_castsi256_ps(high))).bits()
        }
    }
}

/// Sorts the children of a node: see `Simd::far_first`. A bitonic network sorts keys that hold the distance and, in
/// their last three bits, the lane. Distances are not negative, so their bits have the order of integers.
///
/// # Safety
/// The CPU has AVX2; `mask` has all bits set in the lanes to sort first, and none in the others.
#[inline(always)]
pub(super) unsafe fn far_first(
    enter: __m256,
    mask: __m256i,
    child: &[u16; 8],
    enter_out: &mut [f32; 8],
    child_out: &mut [u32; 8],
) {
    // SAFETY: the caller guarantees the set; loads and stores are of whole arrays, and need no alignment.
    unsafe {
        let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        let last = _mm256_set1_epi32(7);
        let key = _mm256_or_si256(_mm256_andnot_si256(last, _mm256_castps_si256(enter)), lanes);
        // The key of a lane that is not in the set is less than all keys of the set.
        let k = _mm256_blendv_epi8(_mm256_set1_epi32(-1), key, mask);
        let k = order::sort8(k);
        let t = _mm256_andnot_si256(last, k);
        _mm256_storeu_ps(enter_out.as_mut_ptr(), _mm256_castsi256_ps(t));
        let child = _mm256_cvtepu16_epi32(_mm_loadu_si128(child.as_ptr().cast()));
        // Only the last three bits of each index count, which are the lane.
        let child = _mm256_permutevar8x32_epi32(child, k);
        _mm256_storeu_si256(child_out.as_mut_ptr().cast(), child);
    }
}

/// The planes of a node's grid relative to a ray: see `Simd::slabs`.
///
/// # Safety
/// The CPU has AVX2 and FMA.
#[inline(always)]
pub(super) unsafe fn slabs(head: &[u32; 4], inv: &[f32; 4], off: &[f32; 8]) -> [[__m256; 3]; 3] {
    // SAFETY: the caller guarantees the set; loads are of whole arrays, and need no alignment.
    unsafe {
        let head = _mm_loadu_si128(head.as_ptr().cast());
        let inv = _mm_loadu_ps(inv.as_ptr());
        let origin = _mm256_set_m128(_mm_castsi128_ps(head), _mm_castsi128_ps(head));
        let off = _mm256_fmadd_ps(origin, _mm256_set_m128(inv, inv), _mm256_loadu_ps(off.as_ptr()));
        let exponents = _mm_cvtepu8_epi32(_mm_shuffle_epi32::<3>(head));
        let slope = _mm_mul_ps(_mm_castsi128_ps(_mm_slli_epi32::<23>(exponents)), inv);
        let slope = _mm256_castps128_ps256(slope);
        [
            [lane::<0>(off), lane::<1>(off), lane::<2>(off)],
            [lane::<4>(off), lane::<5>(off), lane::<6>(off)],
            [lane::<0>(slope), lane::<1>(slope), lane::<2>(slope)],
        ]
    }
}

/// A table of floats by their steps: see `Simd::steps16`.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
pub(super) unsafe fn steps16(first: f32, steps: &[u8; 52]) -> [__m256; 2] {
    // SAFETY: the caller guarantees AVX2. The loads of 16 bytes begin at bytes 0, 12, 24 and 36, and need no alignment.
    unsafe {
        // For each four entries: bytes `3 i` to `3 i + 3`, of which the last three are the step.
        let spread = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 2, 3, 3, 4, 5, 6, 6, 7, 8, 9, 9, 10, 11, 12));
        let first = _mm256_set1_epi32(first.to_bits() as i32);
        let at = steps.as_ptr();
        let low = _mm256_set_m128i(_mm_loadu_si128(at.add(12).cast()), _mm_loadu_si128(at.cast()));
        let high = _mm256_set_m128i(_mm_loadu_si128(at.add(36).cast()), _mm_loadu_si128(at.add(24).cast()));
        let low = _mm256_srai_epi32::<8>(_mm256_shuffle_epi8(low, spread));
        let high = _mm256_srai_epi32::<8>(_mm256_shuffle_epi8(high, spread));
        let low = _mm256_blend_epi32::<1>(low, _mm256_setzero_si256());
        [_mm256_castsi256_ps(_mm256_add_epi32(first, low)), _mm256_castsi256_ps(_mm256_add_epi32(first, high))]
    }
}

/// Writes the steps from the first of the numbers to the others: see `Simd::put_steps16`.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
pub(super) unsafe fn put_steps16(v: &[u32; 16], out: &mut [u8; 52]) {
    // SAFETY: the caller guarantees AVX2. Numbers 1 to 4, 5 to 8, 9 to 12 and 12 to 15 are read, and sixteen bytes are
    // written at 0, 12, 24 and 33. None of it needs alignment.
    unsafe {
        // The low three bytes of each step, then four zeros, which the next write replaces. Those of the last write are
        // in the undefined part of `out`.
        let three = _mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1);
        let first = _mm_set1_epi32(v[0] as i32);
        for (from, to) in [(1, 0), (5, 12), (9, 24), (12, 33)] {
            let steps = _mm_sub_epi32(_mm_loadu_si128(v.as_ptr().add(from).cast()), first);
            _mm_storeu_si128(out.as_mut_ptr().add(to).cast(), _mm_shuffle_epi8(steps, three));
        }
    }
}

/// Broadcasts lane `I` of `v` to all lanes.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
unsafe fn lane<const I: i32>(v: __m256) -> __m256 {
    // SAFETY: the caller guarantees AVX2.
    unsafe { _mm256_permutevar8x32_ps(v, _mm256_set1_epi32(I)) }
}

/// Returns four columns, from `first` on, of the eight rows from `down` on.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
unsafe fn columns4(rows: &[[f32; 16]; 16], down: usize, first: usize) -> [V8; 4] {
    let (down, first) = (down.min(8), first.min(12));
    // SAFETY: the caller guarantees AVX2; four floats from `first` on are within a row, and loads need no alignment.
    unsafe {
        let four = |j: usize| _mm_loadu_ps(rows[down + j].as_ptr().add(first));
        let mut quads = [_mm256_setzero_ps(); 4];
        for (j, quad) in quads.iter_mut().enumerate() {
            // Rows `j` and `4 + j`, one in each half.
            *quad = _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(four(j)), four(4 + j));
        }
        let [a, b, c, d] = quads;
        let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
        let (ab2, cd2) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
        [
            V8(_mm256_shuffle_ps::<0x44>(ab, cd)),
            V8(_mm256_shuffle_ps::<0xEE>(ab, cd)),
            V8(_mm256_shuffle_ps::<0x44>(ab2, cd2)),
            V8(_mm256_shuffle_ps::<0xEE>(ab2, cd2)),
        ]
    }
}

/// Transposes the 8 x 8 square of `rows` that begins at row `down` and column `across`.
///
/// # Safety
/// The CPU has AVX2; `down` and `across` are 8 at most.
#[inline(always)]
unsafe fn transpose8(rows: &[[f32; 16]; 16], out: &mut [[f32; 16]; 16], down: usize, across: usize) {
    // SAFETY: the caller guarantees AVX2; loads and stores of eight from 8 at most are inside a row of 16.
    unsafe {
        let mut quads = [_mm256_setzero_ps(); 8];
        for i in 0..2 {
            let row = |j: usize| rows[down + 4 * i + j].as_ptr().add(across);
            let (a, b) = (_mm256_loadu_ps(row(0)), _mm256_loadu_ps(row(1)));
            let (c, d) = (_mm256_loadu_ps(row(2)), _mm256_loadu_ps(row(3)));
            let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
            let (ab2, cd2) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
            // Each half holds four numbers of a column of the input.
            quads[i] = _mm256_shuffle_ps::<0x44>(ab, cd);
            quads[2 + i] = _mm256_shuffle_ps::<0xEE>(ab, cd);
            quads[4 + i] = _mm256_shuffle_ps::<0x44>(ab2, cd2);
            quads[6 + i] = _mm256_shuffle_ps::<0xEE>(ab2, cd2);
        }
        for i in 0..4 {
            let (a, b) = (quads[2 * i], quads[2 * i + 1]);
            let low = out[across + i].as_mut_ptr().add(down);
            _mm256_storeu_ps(low, _mm256_permute2f128_ps::<0x20>(a, b));
            let high = out[across + 4 + i].as_mut_ptr().add(down);
            _mm256_storeu_ps(high, _mm256_permute2f128_ps::<0x31>(a, b));
        }
    }
}

/// Returns the least of eight lanes.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
pub(super) unsafe fn least8(v: __m256) -> f32 {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let v = _mm_min_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps::<1>(v));
        let v = _mm_min_ps(v, _mm_movehl_ps(v, v));
        _mm_cvtss_f32(_mm_min_ps(v, _mm_movehdup_ps(v)))
    }
}

/// Returns the greatest of eight lanes.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
pub(super) unsafe fn greatest8(v: __m256) -> f32 {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let v = _mm_max_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps::<1>(v));
        let v = _mm_max_ps(v, _mm_movehl_ps(v, v));
        _mm_cvtss_f32(_mm_max_ps(v, _mm_movehdup_ps(v)))
    }
}
