//! Common bits of rows of sixteen words, and the range of the last eight words as floats.

/// The union and the intersection of the rows' bits, and the range of their floats.
#[derive(Debug, Clone, Copy)]
pub struct Common {
    /// Bits that are set in any row.
    pub any: [u32; 16],
    /// Bits that are set in all rows.
    pub all: [u32; 16],
    /// The least of each of the last eight words, as floats; NaN is ignored.
    pub least: [f32; 8],
    /// The greatest of each of these.
    pub greatest: [f32; 8],
}

/// The value for no rows.
const NONE: Common =
    Common { any: [0; 16], all: [u32::MAX; 16], least: [f32::INFINITY; 8], greatest: [f32::NEG_INFINITY; 8] };

impl Common {
    /// The value for `rows`. (Intrinsics, because compilers do not vectorise the loops below: compiled for AVX-512 they
    /// took 3 ns a row, and 9 ns with the greatest of each word.)
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub fn of(rows: &[[u32; 16]]) -> Self {
        use std::arch::x86_64::*;
        let mut out = NONE;
        // SAFETY: SSE2 is part of x86-64. Each quarter of a row is readable, and the stores fill the arrays of `out`
        // exactly.
        unsafe {
            let (mut any, mut all) = ([_mm_setzero_si128(); 4], [_mm_set1_epi32(-1); 4]);
            let (mut least, mut greatest) = ([_mm_set1_ps(f32::INFINITY); 2], [_mm_set1_ps(f32::NEG_INFINITY); 2]);
            for row in rows {
                for quarter in 0..4 {
                    let words = _mm_loadu_si128(row.as_ptr().add(4 * quarter).cast());
                    any[quarter] = _mm_or_si128(any[quarter], words);
                    all[quarter] = _mm_and_si128(all[quarter], words);
                    if quarter >= 2 {
                        // If either operand is NaN, these instructions return the second one.
                        least[quarter - 2] = _mm_min_ps(_mm_castsi128_ps(words), least[quarter - 2]);
                        greatest[quarter - 2] = _mm_max_ps(_mm_castsi128_ps(words), greatest[quarter - 2]);
                    }
                }
            }
            for half in 0..2 {
                _mm_storeu_ps(out.least.as_mut_ptr().add(4 * half), least[half]);
                _mm_storeu_ps(out.greatest.as_mut_ptr().add(4 * half), greatest[half]);
            }
            for quarter in 0..4 {
                _mm_storeu_si128(out.any.as_mut_ptr().add(4 * quarter).cast(), any[quarter]);
                _mm_storeu_si128(out.all.as_mut_ptr().add(4 * quarter).cast(), all[quarter]);
            }
        }
        out
    }

    /// The value for `rows`.
    #[cfg(not(target_arch = "x86_64"))]
    pub fn of(rows: &[[u32; 16]]) -> Self {
        let mut out = NONE;
        for row in rows {
            for (i, word) in row.iter().enumerate() {
                out.any[i] |= word;
                out.all[i] &= word;
            }
            for (i, word) in row[8..].iter().enumerate() {
                let number = f32::from_bits(*word);
                // Not `f32::min`, whose result for a signalling NaN varies.
                (out.least[i], out.greatest[i]) = (
                    if number < out.least[i] { number } else { out.least[i] },
                    if number > out.greatest[i] { number } else { out.greatest[i] },
                );
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bit_of_each_word_is_seen() {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state ^ state >> 13
        };
        for count in 0..6 {
            let mut rows: Vec<[u32; 16]> = (0..count).map(|_| std::array::from_fn(|_| next())).collect();
            if let Some(row) = rows.last_mut() {
                row[9] = f32::NAN.to_bits();
            }
            let common = Common::of(&rows);
            for i in 0..16 {
                assert_eq!(common.any[i], rows.iter().fold(0, |all, row| all | row[i]));
                assert_eq!(common.all[i], rows.iter().fold(u32::MAX, |all, row| all & row[i]));
            }
            for i in 0..8 {
                let numbers = || rows.iter().map(|row| f32::from_bits(row[8 + i])).filter(|number| !number.is_nan());
                assert_eq!(common.least[i], numbers().fold(f32::INFINITY, f32::min));
                assert_eq!(common.greatest[i], numbers().fold(f32::NEG_INFINITY, f32::max));
            }
        }
    }
}
