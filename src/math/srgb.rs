//! Linear colour to the sRGB of screens and back (IEC 61966-2-1), by table.

/// Steps of the table from 0 to 1: less than one level of 8 bits each, even in the dark where the curve is
/// steepest (12.92 · 255 / 8191 = 0.4).
const STEPS: usize = 8192;

/// Tables both ways.
pub(super) struct Srgb {
    from_linear: Box<[u8; STEPS]>,
    to_linear: [f32; 256],
}

impl Srgb {
    pub fn new() -> Self {
        let mut from_linear = Box::new([0; STEPS]);
        for (i, out) in from_linear.iter_mut().enumerate() {
            *out = (encode(i as f64 / (STEPS - 1) as f64) * 255.0 + 0.5) as u8;
        }
        Self { from_linear, to_linear: std::array::from_fn(|i| decode(i as f64 / 255.0) as f32) }
    }

    /// A level of 8 bits; NaN gives 0.
    #[inline]
    pub fn level(&self, linear: f32) -> u8 {
        // A cast saturates, and makes 0 of NaN.
        let step = (linear * (STEPS - 1) as f32 + 0.5) as usize;
        self.from_linear[step.min(STEPS - 1)]
    }

    /// Colour and alpha as sRGB bytes; alpha stays linear.
    #[inline]
    pub fn pixel(&self, c: [f32; 4]) -> [u8; 4] {
        let alpha = (c[3].clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        [self.level(c[0]), self.level(c[1]), self.level(c[2]), alpha]
    }

    /// Linear colour of three sRGB bytes.
    #[inline]
    pub fn linear(&self, c: [u8; 4]) -> [f32; 3] {
        [c[0], c[1], c[2]].map(|x| self.to_linear[x as usize])
    }
}

fn encode(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

fn decode(x: f64) -> f64 {
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

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
