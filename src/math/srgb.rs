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

/// Linear values below 2^-9 are in the linear part of the curve.
const LEAST: f32 = 1.0 / 512.0;
/// Bits of a float below those that select a segment: there are 16 segments between one power of two and the next.
const BELOW_SEGMENT: u32 = 19;
/// Number of segments: 9 powers of two up to 1, rounded up for masks.
const SEGMENTS: usize = 256;

/// Tables for both directions. The curve to sRGB is a chain of segments that differs from the exact one by less than
/// 0.025 of a level.
pub struct Srgb {
    /// The levels 0 to 255 as `line[0] + line[1] * linear`, for each segment.
    lines: Box<[[f32; 2]; SEGMENTS]>,
    to_linear: [f32; 256],
}

impl Srgb {
    /// Computes the tables.
    pub fn new() -> Self {
        let mut lines = Box::new([[0.0; 2]; SEGMENTS]);
        let begin = |segment: u32| f64::from(f32::from_bits(LEAST.to_bits() + (segment << BELOW_SEGMENT)));
        let level = |linear: f64| 255.0 * f64::from(encode(linear as f32));
        for (line, i) in lines.iter_mut().zip(0..) {
            let (from, to) = (begin(i), begin(i + 1));
            let slope = (level(to) - level(from)) / (to - from);
            *line = [(level(from) - slope * from) as f32, slope as f32];
        }
        Self { lines, to_linear: std::array::from_fn(|i| decode(i as f32 / 255.0)) }
    }

    /// Converts colours to sRGB bytes. `rows`: red, green, blue and alpha; alpha stays linear. `offsets`: see
    /// [`dither`]; 0 for the nearest level. NaN gives 0. (Always inlined: the compiler vectorises most of it.)
    #[inline(always)]
    pub fn pixels<const N: usize>(&self, rows: &[[f32; N]; 4], offsets: &[f32; N], out: &mut [[u8; 4]; N]) {
        let (mut levels, mut alphas) = ([[0; N]; 3], [0; N]);
        for c in 0..3 {
            let (mut linear, mut segments) = ([0.0; N], [0; N]);
            for i in 0..N {
                linear[i] = clamped(rows[c][i], 1.0);
                segments[i] = (linear[i].max(LEAST).to_bits() - LEAST.to_bits()) >> BELOW_SEGMENT;
            }
            let (mut begins, mut slopes) = ([0.0; N], [0.0; N]);
            for i in 0..N {
                [begins[i], slopes[i]] = self.lines[segments[i] as usize & (SEGMENTS - 1)];
            }
            for i in 0..N {
                levels[c][i] = rounded(clamped(begins[i] + slopes[i] * linear[i] + offsets[i], 255.0));
            }
        }
        for i in 0..N {
            alphas[i] = rounded(clamped(rows[3][i] * 255.0, 255.0));
        }
        for i in 0..N {
            for c in 0..3 {
                out[i][c] = levels[c][i] as u8;
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

/// Clamps a value to [0, most]; 0 for NaN.
#[inline(always)]
fn clamped(value: f32, most: f32) -> f32 {
    let value = if value > 0.0 { value } else { 0.0 };
    if value < most { value } else { most }
}

/// Rounds a value from 0 to 2^22 to the nearest integer. The sum with 2^23 has no fraction, and the integer in its low
/// bits: a cast, which saturates, would not be vectorised.
#[inline(always)]
fn rounded(value: f32) -> u32 {
    (value + 8_388_608.0).to_bits() & 0x7f_ffff
}

/// Width of the offsets of [`dither`], in levels. Colours that are exact levels keep them: their errors are below 0.025.
const DITHER: f32 = 0.9;

/// Returns the offset, in levels, to the colour of a pixel before it is rounded to a level: an ordered pattern (Bayer
/// 1973) of 8 x 8 pixels, each with another offset. Gradients then have no bands.
#[inline(always)]
pub fn dither(x: u32, y: u32) -> f32 {
    let (across, down) = (x ^ y, y);
    let rank = |bit: u32| ((across >> bit & 1) << (5 - 2 * bit)) | ((down >> bit & 1) << (4 - 2 * bit));
    let rank = rank(0) | rank(1) | rank(2);
    ((rank as f32 + 0.5) * (1.0 / 64.0) - 0.5) * DITHER
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
        srgb.pixels(&c.map(|c| [c]), &[0.0], &mut out);
        out[0]
    }

    /// The bytes in each pixel of the dithered pattern.
    fn dithered(srgb: &Srgb, c: [f32; 4]) -> [[u8; 4]; 64] {
        let mut out = [[0; 4]; 64];
        srgb.pixels(&c.map(|c| [c; 64]), &std::array::from_fn(|i| dither(i as u32 % 8, i as u32 / 8)), &mut out);
        out
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
            assert!(dithered(&srgb, [linear; 4]).iter().all(|c| c[..3] == [level; 3]), "{level}: flat stays flat");
        }
        assert_eq!(bytes(&srgb, [f32::NAN, -1.0, 9.0, 0.5]), [0, 0, 255, 128]);
        assert_eq!(bytes(&srgb, [f32::NAN, -1.0, f32::INFINITY, 0.4]), [0, 0, 255, 102]);
        assert_eq!(bytes(&srgb, [0.0, f32::NEG_INFINITY, 9.0, 2.0]), [0, 0, 255, 255]);
    }

    #[test]
    fn dithered_levels_have_the_mean_of_the_colour() {
        let srgb = Srgb::new();
        for x in (0..=2000).map(|i| i as f32 / 2000.0) {
            let all = dithered(&srgb, [x, x, x, 0.4]);
            let mean = all.iter().map(|c| f32::from(c[0])).sum::<f32>() / 64.0;
            let level = encode(x) * 255.0;
            assert!((mean - level).abs() < 0.1, "{x}: {mean} {level}");
            assert!(all.iter().all(|c| c[0] == c[1] && c[1] == c[2] && c[3] == 102), "grey stays grey, alpha stays");
        }
    }

    #[test]
    fn each_pixel_of_the_pattern_has_another_offset() {
        let mut all: Vec<f32> = (0..64).map(|i| dither(i % 8, i / 8)).collect();
        all.sort_by(f32::total_cmp);
        assert!(all.windows(2).all(|two| two[0] < two[1]));
        assert!(all[0] > -0.475 && all[63] < 0.475 && all.iter().sum::<f32>().abs() < 1e-3);
        assert_eq!(dither(3, 5), dither(3 + 8, 5 + 800));
    }
}
