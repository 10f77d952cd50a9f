//! Conversions of colours. Colours in files are sRGB-coded by convention; averages are taken in linear light.

use crate::math::srgb;
use std::sync::LazyLock;

/// Returns the linear value of an sRGB-coded value (IEC 61966-2-1), which is clamped to [0, 1]; NaN becomes 0.
pub(crate) fn linear(coded: f32) -> f32 {
    srgb::decode(unit(coded, 0.0))
}

static BYTES: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| linear(i as f32 / 255.0)));

/// Returns the linear values of three sRGB-coded bytes.
#[inline]
pub(crate) fn linear_bytes(coded: [u8; 3]) -> [f32; 3] {
    let table = &*BYTES;
    coded.map(|c| table[usize::from(c)])
}

/// Clamps `x` to [0, 1]; NaN becomes `or`.
pub(crate) fn unit(x: f32, or: f32) -> f32 {
    if x.is_nan() { or } else { x.clamp(0.0, 1.0) }
}
