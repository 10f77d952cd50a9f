//! Linear colour to the sRGB of screens and files, and back (IEC 61966-2-1).

/// The sRGB-coded value of a linear one in [0, 1].
pub fn encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The linear value of an sRGB-coded one in [0, 1].
pub fn decode(coded: f32) -> f32 {
    if coded <= 0.040_45 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}

/// The nearest of 256 sRGB-coded levels; what is outside of [0, 1] is clamped, NaN is 0.
pub fn level(linear: f32) -> u8 {
    // A cast saturates, and makes 0 of NaN.
    (encode(linear.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8
}

/// Steps of the table from 0 to 1: less than one level of 8 bits each, even in the dark where the curve is
/// steepest (12.92 · 255 / 8191 = 0.4).
const STEPS: usize = 8192;

/// Tables both ways: within a level of [`level`], and faster.
pub struct Srgb {
    from_linear: Box<[u8; STEPS]>,
    to_linear: [f32; 256],
}

impl Srgb {
    /// The tables.
    pub fn new() -> Self {
        let mut from_linear = Box::new([0; STEPS]);
        for (i, out) in from_linear.iter_mut().enumerate() {
            *out = level(i as f32 / (STEPS - 1) as f32);
        }
        Self { from_linear, to_linear: std::array::from_fn(|i| decode(i as f32 / 255.0)) }
    }

    /// A level of 8 bits; NaN gives 0.
    #[inline]
    pub fn level(&self, linear: f32) -> u8 {
        // A cast saturates, and makes 0 of NaN. (To a signed word: others take three times as long.)
        let step = (linear * (STEPS - 1) as f32 + 0.5) as i32;
        self.from_linear[step.clamp(0, STEPS as i32 - 1) as usize]
    }

    /// Colour and alpha as sRGB bytes; alpha stays linear.
    #[inline]
    pub fn pixel(&self, c: [f32; 4]) -> [u8; 4] {
        let alpha = ((c[3] * 255.0 + 0.5) as i32).clamp(0, 255) as u8;
        [self.level(c[0]), self.level(c[1]), self.level(c[2]), alpha]
    }

    /// Linear colour of three sRGB bytes.
    #[inline]
    pub fn linear(&self, c: [u8; 4]) -> [f32; 3] {
        [c[0], c[1], c[2]].map(|x| self.to_linear[x as usize])
    }
}

impl Default for Srgb {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_those_of_the_standard() {
        assert_eq!((level(0.0), level(1.0), level(0.5)), (0, 255, 188));
        assert!((decode(0.5) - 0.214_041).abs() < 1e-6 && (encode(0.214_041) - 0.5).abs() < 1e-6);
        assert_eq!((level(f32::NAN), level(-1.0), level(2.0)), (0, 0, 255));
        let srgb = Srgb::new();
        assert!((0..=1000).map(|i| i as f32 / 1000.0).all(|x| srgb.level(x).abs_diff(level(x)) <= 1));
    }

    #[test]
    fn every_level_survives_the_way_there_and_back() {
        let srgb = Srgb::new();
        for level in 0..=255u8 {
            let linear = srgb.linear([level; 4])[0];
            assert_eq!(srgb.level(linear), level);
        }
        assert_eq!(srgb.pixel([f32::NAN, -1.0, 9.0, 0.5]), [0, 0, 255, 128]);
    }
}
