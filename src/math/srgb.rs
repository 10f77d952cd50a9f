//! Conversion between linear colours and the sRGB of screens and files (IEC 61966-2-1).
#![allow(clippy::needless_range_loop)] // loops over rows of several arrays at once

/// Returns the sRGB-coded value of a linear value in [0, 1].
pub fn encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Returns the linear value of an sRGB-coded value in [0, 1].
pub fn decode(coded: f32) -> f32 {
    if coded <= 0.040_45 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}

/// Returns the nearest of the 256 sRGB-coded levels. Values outside of [0, 1] are clamped; NaN gives 0.
pub fn level(linear: f32) -> u8 {
    // The cast saturates, and converts NaN to 0.
    (encode(linear.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8
}

/// Number of entries of the table for linear values from 0 to 1. A step is less than one 8-bit level even near black,
/// where the curve is steepest (12.92 · 255 / 8191 = 0.4).
const STEPS: usize = 8192;

/// Tables for both directions. They are faster than [`level`], and differ from it by at most one level.
pub struct Srgb {
    from_linear: Box<[u8; STEPS]>,
    to_linear: [f32; 256],
}

impl Srgb {
    /// Computes the tables.
    pub fn new() -> Self {
        let mut from_linear = Box::new([0; STEPS]);
        for (i, out) in from_linear.iter_mut().enumerate() {
            *out = level(i as f32 / (STEPS - 1) as f32);
        }
        Self { from_linear, to_linear: std::array::from_fn(|i| decode(i as f32 / 255.0)) }
    }

    #[inline(always)]
    fn step(linear: f32) -> u32 {
        whole(linear, STEPS - 1)
    }

    #[inline(always)]
    fn alpha(linear: f32) -> u32 {
        whole(linear, 255)
    }

    /// Converts colours to sRGB bytes. `rows`: red, green, blue and alpha; alpha stays linear. NaN gives 0. (Always
    /// inlined: the compiler vectorises most of it.)
    #[inline(always)]
    pub fn pixels<const N: usize>(&self, rows: &[[f32; N]; 4], out: &mut [[u8; 4]; N]) {
        let (mut steps, mut alphas) = ([[0; N]; 3], [0; N]);
        for c in 0..3 {
            for i in 0..N {
                steps[c][i] = Self::step(rows[c][i]);
            }
        }
        for i in 0..N {
            alphas[i] = Self::alpha(rows[3][i]);
        }
        for i in 0..N {
            for c in 0..3 {
                out[i][c] = self.from_linear[steps[c][i] as usize & (STEPS - 1)];
            }
            out[i][3] = alphas[i] as u8;
        }
    }

    /// Returns the linear colour of three sRGB bytes; the fourth is ignored.
    #[inline]
    pub fn linear(&self, c: [u8; 4]) -> [f32; 3] {
        [c[0], c[1], c[2]].map(|x| self.to_linear[x as usize])
    }
}

/// Returns `steps` times `linear`, clamped to [0, 1], rounded to the nearest integer; 0 for NaN. The sum with 2^23 has
/// no fraction, and the integer in its low bits: a cast, which saturates, would not be vectorised.
#[inline(always)]
fn whole(linear: f32, steps: usize) -> u32 {
    let step = linear * steps as f32;
    let step = if step > 0.0 { step } else { 0.0 };
    let step = if step < steps as f32 { step } else { steps as f32 };
    (step + 8_388_608.0).to_bits() & 0x7f_ffff
}

impl Default for Srgb {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(srgb: &Srgb, c: [f32; 4]) -> [u8; 4] {
        let mut out = [[0; 4]; 1];
        srgb.pixels(&c.map(|c| [c]), &mut out);
        out[0]
    }

    #[test]
    fn levels_are_those_of_the_standard() {
        assert_eq!((level(0.0), level(1.0), level(0.5)), (0, 255, 188));
        assert!((decode(0.5) - 0.214_041).abs() < 1e-6 && (encode(0.214_041) - 0.5).abs() < 1e-6);
        assert_eq!((level(f32::NAN), level(-1.0), level(2.0)), (0, 0, 255));
        let srgb = Srgb::new();
        assert!((0..=1000).map(|i| i as f32 / 1000.0).all(|x| bytes(&srgb, [x; 4])[0].abs_diff(level(x)) <= 1));
    }

    #[test]
    fn every_level_survives_both_conversions() {
        let srgb = Srgb::new();
        for level in 0..=255u8 {
            let linear = srgb.linear([level; 4])[0];
            assert_eq!(bytes(&srgb, [linear; 4])[..3], [level; 3]);
        }
        assert_eq!(bytes(&srgb, [f32::NAN, -1.0, 9.0, 0.5]), [0, 0, 255, 128]);
        assert_eq!(bytes(&srgb, [f32::NAN, -1.0, f32::INFINITY, 0.4]), [0, 0, 255, 102]);
        assert_eq!(bytes(&srgb, [0.0, f32::NEG_INFINITY, 9.0, 2.0]), [0, 0, 255, 255]);
    }
}
