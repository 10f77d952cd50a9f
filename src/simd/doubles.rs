//! Four doubles, for the sets of [`super::Isa`].

use super::lanes::Mask;
use std::array::from_fn;
use std::ops::{Add, Mul, Sub};

/// Four doubles with elementwise operations, in IEEE double precision, rounded to nearest.
///
/// `min` and `max` return the lane of `o` if either operand is NaN, as the x86 instructions do.
pub trait Doubles: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// A set of lanes of this vector.
    type Mask: Mask;
    /// Elementwise `self * a + b`, rounded once or twice, depending on the set. It is only for results that may differ
    /// between sets.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Elementwise `b - self * a`, rounded as in `mul_add`.
    fn negated_mul_add(self, a: Self, b: Self) -> Self;
    /// Elementwise minimum.
    fn min(self, o: Self) -> Self;
    /// Elementwise maximum.
    fn max(self, o: Self) -> Self;
    /// Elementwise absolute value.
    fn abs(self) -> Self;
    /// Lanes where `self <= o`; false for NaN.
    fn le(self, o: Self) -> Self::Mask;
    /// Lanes where `self < o`; false for NaN.
    fn lt(self, o: Self) -> Self::Mask;
    /// `self` in the lanes of `mask`, `o` elsewhere.
    fn select(self, mask: Self::Mask, o: Self) -> Self;
    /// All lanes in order.
    fn to_array(self) -> [f64; 4];
}

/// Four doubles in an array.
#[derive(Debug, Clone, Copy)]
pub struct Array4(pub(super) [f64; 4]);

/// A set of lanes, all bits of each; the compiler makes vectors of them.
#[derive(Debug, Clone, Copy)]
pub struct Words4([u64; 4]);

impl Mask for Words4 {
    #[inline(always)]
    fn bits(self) -> u32 {
        let [a, b, c, d] = self.0;
        (a & 1 | b & 2 | c & 4 | d & 8) as u32
    }
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        Self(from_fn(|i| self.0[i] & o.0[i]))
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        Self(from_fn(|i| self.0[i] | o.0[i]))
    }
}

impl Add for Array4 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self(from_fn(|i| self.0[i] + o.0[i]))
    }
}
impl Sub for Array4 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self(from_fn(|i| self.0[i] - o.0[i]))
    }
}
impl Mul for Array4 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self(from_fn(|i| self.0[i] * o.0[i]))
    }
}
impl Doubles for Array4 {
    type Mask = Words4;
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn negated_mul_add(self, a: Self, b: Self) -> Self {
        b - self * a
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
    fn abs(self) -> Self {
        Self(from_fn(|i| self.0[i].abs()))
    }
    #[inline(always)]
    fn le(self, o: Self) -> Words4 {
        Words4(from_fn(|i| if self.0[i] <= o.0[i] { u64::MAX } else { 0 }))
    }
    #[inline(always)]
    fn lt(self, o: Self) -> Words4 {
        Words4(from_fn(|i| if self.0[i] < o.0[i] { u64::MAX } else { 0 }))
    }
    #[inline(always)]
    fn select(self, mask: Words4, o: Self) -> Self {
        let pick = |i: usize| self.0[i].to_bits() & mask.0[i] | o.0[i].to_bits() & !mask.0[i];
        Self(from_fn(|i| f64::from_bits(pick(i))))
    }
    #[inline(always)]
    fn to_array(self) -> [f64; 4] {
        self.0
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    //! AVX2; AVX-512 contains it.

    use super::super::lanes::Mask;
    use super::Doubles;
    use std::arch::x86_64::*;
    use std::ops::{Add, Mul, Sub};

    /// Four doubles of AVX2.
    #[derive(Debug, Clone, Copy)]
    pub struct D4(pub(in super::super) __m256d);

    /// A set of lanes. A lane is in the set if its sign bit is set.
    #[derive(Debug, Clone, Copy)]
    pub struct M4(__m256d);

    impl Mask for M4 {
        #[inline(always)]
        fn bits(self) -> u32 {
            // SAFETY: a mask exists only on a CPU that has the set (see the head of `simd`).
            unsafe { _mm256_movemask_pd(self.0) as u32 }
        }
        #[inline(always)]
        fn and(self, o: Self) -> Self {
            // SAFETY: as in `bits`.
            Self(unsafe { _mm256_and_pd(self.0, o.0) })
        }
        #[inline(always)]
        fn or(self, o: Self) -> Self {
            // SAFETY: as in `bits`.
            Self(unsafe { _mm256_or_pd(self.0, o.0) })
        }
    }

    impl Add for D4 {
        type Output = Self;
        #[inline(always)]
        fn add(self, o: Self) -> Self {
            // SAFETY: a vector exists only on a CPU that has the set (see the head of `simd`).
            Self(unsafe { _mm256_add_pd(self.0, o.0) })
        }
    }
    impl Sub for D4 {
        type Output = Self;
        #[inline(always)]
        fn sub(self, o: Self) -> Self {
            // SAFETY: a vector exists only on a CPU that has the set (see the head of `simd`).
            Self(unsafe { _mm256_sub_pd(self.0, o.0) })
        }
    }
    impl Mul for D4 {
        type Output = Self;
        #[inline(always)]
        fn mul(self, o: Self) -> Self {
            // SAFETY: a vector exists only on a CPU that has the set (see the head of `simd`).
            Self(unsafe { _mm256_mul_pd(self.0, o.0) })
        }
    }
    impl Doubles for D4 {
        type Mask = M4;
        #[inline(always)]
        fn mul_add(self, a: Self, b: Self) -> Self {
            // SAFETY: as in `add`.
            Self(unsafe { _mm256_fmadd_pd(self.0, a.0, b.0) })
        }
        #[inline(always)]
        fn negated_mul_add(self, a: Self, b: Self) -> Self {
            // SAFETY: as in `add`.
            Self(unsafe { _mm256_fnmadd_pd(self.0, a.0, b.0) })
        }
        #[inline(always)]
        fn min(self, o: Self) -> Self {
            // SAFETY: as in `add`.
            Self(unsafe { _mm256_min_pd(self.0, o.0) })
        }
        #[inline(always)]
        fn max(self, o: Self) -> Self {
            // SAFETY: as in `add`.
            Self(unsafe { _mm256_max_pd(self.0, o.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: as in `add`.
            Self(unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), self.0) })
        }
        #[inline(always)]
        fn le(self, o: Self) -> M4 {
            // SAFETY: as in `add`.
            M4(unsafe { _mm256_cmp_pd::<_CMP_LE_OQ>(self.0, o.0) })
        }
        #[inline(always)]
        fn lt(self, o: Self) -> M4 {
            // SAFETY: as in `add`.
            M4(unsafe { _mm256_cmp_pd::<_CMP_LT_OQ>(self.0, o.0) })
        }
        #[inline(always)]
        fn select(self, mask: M4, o: Self) -> Self {
            // SAFETY: as in `add`.
            Self(unsafe { _mm256_blendv_pd(o.0, self.0, mask.0) })
        }
        #[inline(always)]
        fn to_array(self) -> [f64; 4] {
            let mut out = [0.0; 4];
            // SAFETY: as in `add`; `out` holds 4 doubles, and the store needs no alignment.
            unsafe { _mm256_storeu_pd(out.as_mut_ptr(), self.0) };
            out
        }
    }
}
