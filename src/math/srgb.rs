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

/// The curve above its linear part, times 255, as a polynomial in the fourth root of the linear value: least powers
/// first. It differs from the curve by less than 0.005 levels.
const CURVE: [f32; 6] = [-15.669_773, 41.527_756, 319.592_44, -146.749_27, 73.756_72, -17.461_876];

/// Conversions between linear colours and sRGB bytes.
pub struct Srgb {
    to_linear: [f32; 256],
}

impl Srgb {
    /// Computes the table of the linear values of bytes.
    pub fn new() -> Self {
        Self { to_linear: std::array::from_fn(|i| decode(i as f32 / 255.0)) }
    }

    /// Converts colours to sRGB bytes. `rows`: red, green, blue and alpha; alpha stays linear. `offsets`: see
    /// [`dither`]; 0 for the nearest level. NaN gives 0. (Always inlined: the compiler vectorises all of it.)
    #[inline(always)]
    pub fn pixels<const N: usize>(&self, rows: &[[f32; N]; 4], offsets: &[f32; N], out: &mut [[u8; 4]; N]) {
        let mut levels = [[0; N]; 4];
        for c in 0..3 {
            for i in 0..N {
                levels[c][i] = rounded(clamped(coded(clamped(rows[c][i], 1.0)) + offsets[i], 255.0));
            }
        }
        for i in 0..N {
            levels[3][i] = rounded(clamped(rows[3][i] * 255.0, 255.0));
        }
        let [red, green, blue, alpha] = levels;
        for i in 0..N {
            out[i] = (red[i] | green[i] << 8 | blue[i] << 16 | alpha[i] << 24).to_le_bytes();
        }
    }

    /// Returns the linear colour of three sRGB bytes; the fourth is ignored.
    #[inline]
    pub fn linear(&self, c: [u8; 4]) -> [f32; 3] {
        [c[0], c[1], c[2]].map(|x| self.to_linear[x as usize])
    }
}

/// Returns the level, 0 to 255 with a fraction, of a linear value in [0, 1].
#[inline(always)]
fn coded(linear: f32) -> f32 {
    let root = linear.sqrt().sqrt();
    let curve = CURVE.iter().rev().fold(0.0, |sum, &factor| sum * root + factor);
    if linear <= 0.003_130_8 { linear * (12.92 * 255.0) } else { curve }
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

/// Width of the offsets of [`dither`], in levels. Colours that are exact levels keep them: their errors are below
/// 0.025.
const DITHER: f32 = 0.9;

/// Returns the offset, in levels, to the colour of a pixel before it is rounded to a level. Gradients then have no
/// bands. The offsets are an additive lattice (Roberts 2018: multiples of the powers of the plastic number's inverse),
/// whose values in each row, column and square are spread evenly, most so in columns: backgrounds are vertical
/// gradients.
#[inline(always)]
pub fn dither(x: u32, y: u32) -> f32 {
    // 2^32 / 1.3247179 and 2^32 / 1.3247179^2: the product is the fraction in 32 bits.
    let fraction = x.wrapping_mul(3_242_174_889).wrapping_add(y.wrapping_mul(2_447_445_414));
    ((fraction >> 8) as f32 * (1.0 / 16_777_216.0) - 0.5) * DITHER
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
        for x in (0..=10_000).map(|i| (i as f32 / 10_000.0).powi(3)) {
            assert!(bytes(&srgb, [x; 4])[0].abs_diff(level(x)) <= 1);
            assert!((coded(x) - 255.0 * encode(x)).abs() < 0.005, "{x}");
        }
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
    fn offsets_are_spread_evenly() {
        let spread = |all: &mut dyn Iterator<Item = (u32, u32)>, apart: f32| {
            let mut all: Vec<f32> = all.map(|(x, y)| dither(x, y) / DITHER).collect();
            all.sort_by(f32::total_cmp);
            assert!(all[0] >= -0.5 && all[all.len() - 1] <= 0.5);
            assert!(all.windows(2).all(|two| two[1] - two[0] < apart), "{all:?}");
        };
        for start in [0, 77, 65_000] {
            spread(&mut (0..16).map(|i| (start + i, start)), 0.25);
            spread(&mut (0..16).map(|i| (start, start + i)), 0.15);
            spread(&mut (0..64).map(|i| (start + i % 8, i / 8)), 0.05);
        }
    }
}
