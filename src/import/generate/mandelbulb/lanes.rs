//! Eight numbers side by side, as arrays that the compiler vectorises.

use std::ops::{Add, Mul, Sub};

/// Number of lanes.
pub const LANES: usize = 8;

/// One number per lane.
#[derive(Debug, Clone, Copy)]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// Returns the same number in all lanes.
    #[inline(always)]
    pub fn all(v: f32) -> Self {
        Self([v; LANES])
    }

    #[inline(always)]
    fn zip(self, o: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|l| f(self.0[l], o.0[l])))
    }

    /// Returns the square roots.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.zip(self, |a, _| a.sqrt())
    }

    /// Returns the quotients.
    #[inline(always)]
    pub fn over(self, o: Self) -> Self {
        self.zip(o, |a, b| a / b)
    }

    /// Returns 1 where `self > o`, else 0; 0 for NaN.
    #[inline(always)]
    pub fn above(self, o: Self) -> Self {
        self.zip(o, |a, b| if a > b { 1.0 } else { 0.0 })
    }

    /// Returns `yes` where `self` is not 0, else `no`.
    #[inline(always)]
    pub fn pick(self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|l| if self.0[l] != 0.0 { yes.0[l] } else { no.0[l] }))
    }

    /// Returns the sum of all lanes.
    #[inline(always)]
    pub fn sum(self) -> f32 {
        self.0.iter().sum()
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.zip(o, |a, b| a + b)
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.zip(o, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.zip(o, |a, b| a * b)
    }
}
