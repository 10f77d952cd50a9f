//! Colours of files are sRGB-coded by habit; averages are taken over linear light.

use crate::math::srgb;
use std::sync::LazyLock;

/// The linear value of an sRGB-coded one in [0, 1] (IEC 61966-2-1); clamped, NaN is 0.
pub(crate) fn linear(coded: f32) -> f32 {
    srgb::decode(unit(coded, 0.0))
}

static BYTES: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| linear(i as f32 / 255.0)));

/// The linear values of three sRGB-coded bytes.
#[inline]
pub(crate) fn linear_bytes(coded: [u8; 3]) -> [f32; 3] {
    let table = &*BYTES;
    coded.map(|c| table[usize::from(c)])
}

/// The mean of a triangle's vertex colours (linear).
#[inline]
pub(crate) fn mean3(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0)
}

/// `x` within [0, 1]; NaN is `or`.
pub(crate) fn unit(x: f32, or: f32) -> f32 {
    if x.is_nan() { or } else { x.clamp(0.0, 1.0) }
}
