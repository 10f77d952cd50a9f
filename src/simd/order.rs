//! Sorting and packing of eight lanes with their links, on x86.

use std::arch::x86_64::*;

/// `Simd::order8` with AVX2: a bitonic network over all lanes.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
pub(super) unsafe fn order8_avx2(
    enter: __m256,
    hits: u32,
    child: &[u32; 8],
    enter_out: &mut [f32; 8],
    child_out: &mut [u32; 8],
) {
    // SAFETY: the caller guarantees the set; loads and stores are of whole arrays, and need no alignment.
    unsafe {
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let mask = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(hits as i32), bits), bits);
        // The key of a lane that is not in the set is less than all keys of the set.
        let keys = sort8(_mm256_blendv_epi8(_mm256_set1_epi32(-1), keys(enter), mask));
        put(keys, child, enter_out, child_out);
    }
}

/// `Simd::order8` with AVX-512: the lanes of the set are packed before, so that mostly four remain to be sorted.
///
/// # Safety
/// The CPU has AVX-512 F and VL, and AVX2.
#[inline(always)]
pub(super) unsafe fn order8_avx512(
    enter: __m256,
    hits: u32,
    child: &[u32; 8],
    enter_out: &mut [f32; 8],
    child_out: &mut [u32; 8],
) {
    // SAFETY: as in `order8_avx2`.
    unsafe {
        let least = _mm256_set1_epi32(i32::MIN);
        let packed = _mm256_mask_compress_epi32(least, hits as __mmask8, keys(enter));
        let mut sorted = sort4(packed);
        if hits.count_ones() > 4 {
            sorted = sort8(packed);
        }
        put(sorted, child, enter_out, child_out);
    }
}

/// `Simd::pack8` with AVX2 and BMI2.
///
/// # Safety
/// The CPU has both.
#[inline(always)]
pub(super) unsafe fn pack8_avx2(
    t: __m256,
    keep: u32,
    child: &[u32; 8],
    t_out: &mut [f32; 8],
    child_out: &mut [u32; 8],
) {
    // SAFETY: as in `order8_avx2`.
    unsafe {
        let bytes = _pdep_u64(u64::from(keep), 0x0101_0101_0101_0101) * 0xff;
        let lanes = _pext_u64(0x0706_0504_0302_0100, bytes);
        let lanes = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(lanes as i64));
        _mm256_storeu_ps(t_out.as_mut_ptr(), _mm256_permutevar8x32_ps(t, lanes));
        let child = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(child.as_ptr().cast()), lanes);
        _mm256_storeu_si256(child_out.as_mut_ptr().cast(), child);
    }
}

/// `Simd::pack8` with AVX-512.
///
/// # Safety
/// The CPU has AVX-512 F and VL.
#[inline(always)]
pub(super) unsafe fn pack8_avx512(
    t: __m256,
    keep: u32,
    child: &[u32; 8],
    t_out: &mut [f32; 8],
    child_out: &mut [u32; 8],
) {
    // SAFETY: as in `order8_avx2`.
    unsafe {
        _mm256_storeu_ps(t_out.as_mut_ptr(), _mm256_maskz_compress_ps(keep as __mmask8, t));
        let child = _mm256_maskz_compress_epi32(keep as __mmask8, _mm256_loadu_si256(child.as_ptr().cast()));
        _mm256_storeu_si256(child_out.as_mut_ptr().cast(), child);
    }
}

/// Keys that hold the distance and, in their last three bits, the lane. Distances are not negative, so their bits have
/// the order of integers.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
unsafe fn keys(enter: __m256) -> __m256i {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        _mm256_or_si256(_mm256_andnot_si256(_mm256_set1_epi32(7), _mm256_castps_si256(enter)), lanes)
    }
}

/// # Safety
/// The CPU has AVX2.
#[inline(always)]
unsafe fn put(keys: __m256i, child: &[u32; 8], enter_out: &mut [f32; 8], child_out: &mut [u32; 8]) {
    // SAFETY: the caller guarantees AVX2; loads and stores are of whole arrays, and need no alignment.
    unsafe {
        let t = _mm256_andnot_si256(_mm256_set1_epi32(7), keys);
        _mm256_storeu_ps(enter_out.as_mut_ptr(), _mm256_castsi256_ps(t));
        // Only the last three bits of each index count, which are the lane.
        let child = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(child.as_ptr().cast()), keys);
        _mm256_storeu_si256(child_out.as_mut_ptr().cast(), child);
    }
}

/// Sorts eight keys, the greatest first.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
pub(super) unsafe fn sort8(k: __m256i) -> __m256i {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let k = greater_first::<0xAA>(k, _mm256_shuffle_epi32::<0xB1>(k));
        let k = greater_first::<0xCC>(k, _mm256_shuffle_epi32::<0x1B>(k));
        let k = greater_first::<0xAA>(k, _mm256_shuffle_epi32::<0xB1>(k));
        let reversed = _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0);
        let k = greater_first::<0xF0>(k, _mm256_permutevar8x32_epi32(k, reversed));
        let k = greater_first::<0xCC>(k, _mm256_shuffle_epi32::<0x4E>(k));
        greater_first::<0xAA>(k, _mm256_shuffle_epi32::<0xB1>(k))
    }
}

/// Sorts the first four keys, the greatest first.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
unsafe fn sort4(k: __m256i) -> __m256i {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let k = greater_first::<0xAA>(k, _mm256_shuffle_epi32::<0xB1>(k));
        let k = greater_first::<0xCC>(k, _mm256_shuffle_epi32::<0x1B>(k));
        greater_first::<0xAA>(k, _mm256_shuffle_epi32::<0xB1>(k))
    }
}

/// One layer of the network: lanes of `LESS` keep the lesser of themselves and their partner, the others the greater.
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
unsafe fn greater_first<const LESS: i32>(k: __m256i, partner: __m256i) -> __m256i {
    // SAFETY: the caller guarantees AVX2.
    unsafe { _mm256_blend_epi32::<LESS>(_mm256_max_epi32(k, partner), _mm256_min_epi32(k, partner)) }
}
