//! AVX-512 (F, VL, DQ, BW): sixteen lanes in a register, and mask registers for both widths.

use super::Op;
use super::avx2::{far_first, greatest8, least8, put_steps16, slabs, steps16};
use super::doubles::x86::D4;
use super::lanes::{Lanes, Mask, Simd};
use super::order;
use std::arch::x86_64::*;
use std::ops::{Add, Mul, Sub};

/// Token of AVX-512: exists only on a CPU that has it.
#[derive(Debug, Clone, Copy)]
pub struct Avx512(());

/// Runs `op` compiled for AVX-512.
///
/// # Safety
/// The CPU must have every feature that `Isa::Avx512.is_available()` tests.
#[target_feature(enable = "avx2,fma,avx512f,avx512vl,avx512dq,avx512bw,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn run<O: Op>(op: O) -> O::Out {
    op.run(Avx512(()))
}

/// Eight floats.
#[derive(Debug, Clone, Copy)]
pub struct V8(__m256);

/// Sixteen floats.
#[derive(Debug, Clone, Copy)]
pub struct V16(__m512);

/// A set of 8 lanes in a mask register.
#[derive(Debug, Clone, Copy)]
pub struct M8(__mmask8);

impl Mask for M8 {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self.0)
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

/// A set of 16 lanes in a mask register.
#[derive(Debug, Clone, Copy)]
pub struct M16(__mmask16);

impl Mask for M16 {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self.0)
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
        M8(unsafe { _mm256_cmp_ps_mask::<_CMP_LE_OQ>(self.0, o.0) })
    }
    #[inline(always)]
    fn eq(self, o: Self) -> M8 {
        // SAFETY: as in `add`.
        M8(unsafe { _mm256_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, o.0) })
    }
    #[inline(always)]
    fn select(self, mask: M8, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm256_mask_blend_ps(mask.0, o.0, self.0) })
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

impl Add for V16 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        // SAFETY: a vector exists only on a CPU that has the set (see the head of `simd`).
        Self(unsafe { _mm512_add_ps(self.0, o.0) })
    }
}
impl Sub for V16 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm512_sub_ps(self.0, o.0) })
    }
}
impl Mul for V16 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm512_mul_ps(self.0, o.0) })
    }
}
impl Lanes<16> for V16 {
    type Mask = M16;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm512_div_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm512_fmadd_ps(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm512_min_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm512_max_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn least(self) -> f32 {
        // SAFETY: as in `add`.
        unsafe { _mm512_reduce_min_ps(self.0) }
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        // SAFETY: as in `add`.
        unsafe { _mm512_reduce_max_ps(self.0) }
    }
    #[inline(always)]
    fn le(self, o: Self) -> M16 {
        // SAFETY: as in `add`.
        M16(unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, o.0) })
    }
    #[inline(always)]
    fn eq(self, o: Self) -> M16 {
        // SAFETY: as in `add`.
        M16(unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, o.0) })
    }
    #[inline(always)]
    fn select(self, mask: M16, o: Self) -> Self {
        // SAFETY: as in `add`.
        Self(unsafe { _mm512_mask_blend_ps(mask.0, o.0, self.0) })
    }
    #[inline(always)]
    fn from_array_like(_like: Self, v: [f32; 16]) -> Self {
        // SAFETY: as in `add`, by way of `_like`; `v` holds 16 floats.
        Self(unsafe { _mm512_loadu_ps(v.as_ptr()) })
    }
    #[inline(always)]
    fn to_array(self) -> [f32; 16] {
        let mut out = [0.0; 16];
        // SAFETY: as in `add`; `out` holds 16 floats, and the store needs no alignment.
        unsafe { _mm512_storeu_ps(out.as_mut_ptr(), self.0) };
        out
    }
}

impl Simd for Avx512 {
    type D4 = D4;
    type F8 = V8;
    type F16 = V16;
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
        // SAFETY: as in `splat8`; the load is of all numbers, and needs no alignment.
        unsafe {
            let less = _mm512_set1_epi32(v[0].wrapping_sub(1 << 23) as i32);
            let above = _mm512_sub_epi32(_mm512_loadu_si512(v.as_ptr().cast()), less);
            _mm512_cmplt_epu32_mask(above, _mm512_set1_epi32(1 << 24)).into()
        }
    }
    #[inline(always)]
    fn put_steps16(self, v: &[u32; 16], out: &mut [u8; 52]) {
        // SAFETY: as in `splat8`.
        unsafe { put_steps16(v, out) }
    }
    #[inline(always)]
    fn lookup16(self, [V8(low), V8(high)]: [V8; 2], index: __m256i) -> V8 {
        // SAFETY: as in `splat8`; only the low four bits of each index are read.
        V8(unsafe { _mm256_permutex2var_ps(low, index, high) })
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
        // SAFETY: as in `splat8`; loads and stores are of whole rows, and need no alignment.
        unsafe {
            let mut quads = [_mm512_setzero_ps(); 16];
            for i in 0..4 {
                let row = |j: usize| rows[4 * i + j].as_ptr();
                let (a, b) = (_mm512_loadu_ps(row(0)), _mm512_loadu_ps(row(1)));
                let (c, d) = (_mm512_loadu_ps(row(2)), _mm512_loadu_ps(row(3)));
                let (ab, cd) = (_mm512_unpacklo_ps(a, b), _mm512_unpacklo_ps(c, d));
                let (ab2, cd2) = (_mm512_unpackhi_ps(a, b), _mm512_unpackhi_ps(c, d));
                // Each quarter holds four numbers of a column of the input.
                quads[i] = _mm512_shuffle_ps::<0x44>(ab, cd);
                quads[4 + i] = _mm512_shuffle_ps::<0xEE>(ab, cd);
                quads[8 + i] = _mm512_shuffle_ps::<0x44>(ab2, cd2);
                quads[12 + i] = _mm512_shuffle_ps::<0xEE>(ab2, cd2);
            }
            for i in 0..4 {
                let [a, b, c, d] = [quads[4 * i], quads[4 * i + 1], quads[4 * i + 2], quads[4 * i + 3]];
                let (ab, cd) = (_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0x88>(c, d));
                let (ab2, cd2) = (_mm512_shuffle_f32x4::<0xDD>(a, b), _mm512_shuffle_f32x4::<0xDD>(c, d));
                _mm512_storeu_ps(out[i].as_mut_ptr(), _mm512_shuffle_f32x4::<0x88>(ab, cd));
                _mm512_storeu_ps(out[4 + i].as_mut_ptr(), _mm512_shuffle_f32x4::<0x88>(ab2, cd2));
                _mm512_storeu_ps(out[8 + i].as_mut_ptr(), _mm512_shuffle_f32x4::<0xDD>(ab, cd));
                _mm512_storeu_ps(out[12 + i].as_mut_ptr(), _mm512_shuffle_f32x4::<0xDD>(ab2, cd2));
            }
        }
    }
    #[inline(always)]
    fn columns4(self, rows: &[[f32; 16]; 16], first: usize) -> [V16; 4] {
        let first = first.min(12);
        // SAFETY: as in `splat8`; four floats from `first` on are within a row, and loads need no alignment.
        unsafe {
            let four = |j: usize| _mm_loadu_ps(rows[j].as_ptr().add(first));
            let mut quads = [_mm512_setzero_ps(); 4];
            for (j, quad) in quads.iter_mut().enumerate() {
                // Rows `j`, `4 + j`, `8 + j` and `12 + j`, one in each quarter.
                let low = _mm512_insertf32x4::<1>(_mm512_castps128_ps512(four(j)), four(4 + j));
                *quad = _mm512_insertf32x4::<3>(_mm512_insertf32x4::<2>(low, four(8 + j)), four(12 + j));
            }
            let [a, b, c, d] = quads;
            let (ab, cd) = (_mm512_unpacklo_ps(a, b), _mm512_unpacklo_ps(c, d));
            let (ab2, cd2) = (_mm512_unpackhi_ps(a, b), _mm512_unpackhi_ps(c, d));
            [
                V16(_mm512_shuffle_ps::<0x44>(ab, cd)),
                V16(_mm512_shuffle_ps::<0xEE>(ab, cd)),
                V16(_mm512_shuffle_ps::<0x44>(ab2, cd2)),
                V16(_mm512_shuffle_ps::<0xEE>(ab2, cd2)),
            ]
        }
    }
    #[inline(always)]
    fn far_first(self, enter: V8, hits: u32, child: &[u16; 8], enter_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        // SAFETY: as in `splat8`.
        unsafe {
            let mask = _mm256_movm_epi32(hits as __mmask8);
            far_first(enter.0, mask, child, enter_out, child_out);
        }
    }
    #[inline(always)]
    fn order8(self, enter: V8, hits: u32, child: &[u32; 8], enter_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        // SAFETY: as in `splat8`.
        unsafe { order::order8_avx512(enter.0, hits, child, enter_out, child_out) }
    }
    #[inline(always)]
    fn pack8(self, t: V8, keep: u32, child: &[u32; 8], t_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
        // SAFETY: as in `splat8`.
        unsafe { order::pack8_avx512(t.0, keep, child, t_out, child_out) }
    }
    #[inline(always)]
    fn splat16(self, v: f32) -> V16 {
        // SAFETY: as in `splat8`.
        V16(unsafe { _mm512_set1_ps(v) })
    }
    #[inline(always)]
    fn mask16(self, bits: u32) -> M16 {
        M16(bits as __mmask16)
    }
    #[inline(always)]
    fn load16(self, v: &[f32; 16]) -> V16 {
        // SAFETY: as in `splat8`; `v` holds sixteen floats, and the load needs no alignment.
        V16(unsafe { _mm512_loadu_ps(v.as_ptr()) })
    }
    #[inline(always)]
    fn same16(self, v: &[f32; 16], mask: u32, bits: u32) -> u32 {
        // SAFETY: as in `splat8`.
        unsafe {
            let words = _mm512_and_si512(_mm512_castps_si512(self.load16(v).0), _mm512_set1_epi32(mask as i32));
            u32::from(_mm512_cmpeq_epi32_mask(words, _mm512_set1_epi32(bits as i32)))
        }
    }
}
