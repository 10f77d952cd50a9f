//! A float as a vector of one lane, for algorithms that are written for any number of lanes. It gives the same bits as
//! a lane of a longer vector.

use super::lanes::{Lanes, Mask};

impl Mask for bool {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }

    #[inline(always)]
    fn and(self, o: Self) -> Self {
        self & o
    }

    #[inline(always)]
    fn or(self, o: Self) -> Self {
        self | o
    }
}

impl Lanes<1> for f32 {
    type Mask = bool;

    #[inline(always)]
    fn div(self, o: Self) -> Self {
        self / o
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    // Not `f32::min` and `f32::max`, which ignore NaN on either side: [`Lanes`] requires `o` if either operand is NaN.
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        if self < o { self } else { o }
    }

    #[inline(always)]
    fn max(self, o: Self) -> Self {
        if self > o { self } else { o }
    }

    #[inline(always)]
    fn least(self) -> f32 {
        self
    }

    #[inline(always)]
    fn greatest(self) -> f32 {
        self
    }

    #[inline(always)]
    fn le(self, o: Self) -> bool {
        self <= o
    }

    #[inline(always)]
    fn eq(self, o: Self) -> bool {
        self == o
    }

    #[inline(always)]
    fn select(self, mask: bool, o: Self) -> Self {
        if mask { self } else { o }
    }

    #[inline(always)]
    fn from_array_like(_like: Self, [v]: [f32; 1]) -> Self {
        v
    }

    #[inline(always)]
    fn to_array(self) -> [f32; 1] {
        [self]
    }
}
