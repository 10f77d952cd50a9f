//! AVX2: eight lanes in a register, sixteen in two.

use super::Op;
use super::lanes::{Lanes, Mask, Simd};
use std::arch::x86_64::*;
use std::ops::{Add, Mul, Sub};

/// Token of AVX2: exists only on a CPU that has it.
#[derive(Debug, Clone, Copy)]
pub struct Avx2(());

/// Runs `op` compiled for AVX2.
///
/// # Safety
/// The CPU must have every feature that `Isa::Avx2.is_available()` asks for.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn run<O: Op>(op: O) -> O::Out {
    op.run(Avx2(()))
}

/// Eight floats.
#[derive(Debug, Clone, Copy)]
pub struct V8(__m256);

/// A lane is in the set where its sign bit is set.
#[derive(Debug, Clone, Copy)]
pub struct M8(__m256);

impl Mask for M8 {
    #[inline(always)]
    fn bits(self) -> u32 {
        // SAFETY: a mask exists only where its token does.
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
        // SAFETY: a vector exists only where its token does (see the room's head).
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
        // SAFETY: as in `add`, through `_like`; `v` holds 8 floats.
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

/// Two of a kind: sixteen lanes.
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
        let half = |from: usize| V8::from_array_like(like.0, std::array::from_fn(|i| v[from + i]));
        Self(half(0), half(8))
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
    type F8 = V8;
    type F16 = Pair<V8>;
    type Index8 = __m256i;

    #[inline(always)]
    fn splat8(self, v: f32) -> V8 {
        // SAFETY: the token `self` vouches for the CPU.
        V8(unsafe { _mm256_set1_ps(v) })
    }
    #[inline(always)]
    fn load8(self, v: &[f32; 8]) -> V8 {
        // SAFETY: the token vouches; `v` holds eight floats, and the load needs no alignment.
        V8(unsafe { _mm256_loadu_ps(v.as_ptr()) })
    }
    #[inline(always)]
    fn powers8(self, word: u32) -> [V8; 3] {
        // SAFETY: the token vouches.
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
        // SAFETY: the token vouches.
        V8(unsafe { _mm256_cvtepi32_ps(self.index8(v)) })
    }
    #[inline(always)]
    fn index8(self, v: &[u8; 8]) -> __m256i {
        // SAFETY: the token vouches.
        unsafe { _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(*v))) }
    }
    #[inline(always)]
    fn lookup16(self, table: &[f32; 16], index: __m256i) -> V8 {
        // SAFETY: the token vouches; both loads lie inside `table`.
        V8(unsafe {
            let low = _mm256_permutevar8x32_ps(_mm256_loadu_ps(table.as_ptr()), index);
            let high = _mm256_permutevar8x32_ps(_mm256_loadu_ps(table.as_ptr().add(8)), index);
            // Bit 3 of the index, moved to the sign, says which half.
            _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index)))
        })
    }
    #[inline(always)]
    fn splat16(self, v: f32) -> Pair<V8> {
        Pair(self.splat8(v), self.splat8(v))
    }
    #[inline(always)]
    fn load16(self, v: &[f32; 16]) -> Pair<V8> {
        let (low, high) = v.split_at(8);
        match (low.try_into(), high.try_into()) {
            (Ok(low), Ok(high)) => Pair(self.load8(low), self.load8(high)),
            _ => unreachable!(),
        }
    }
}
