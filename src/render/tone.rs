//! Conversion of linear colours to the bytes of a picture: exposure, a curve for highlights, and dithering.
#![allow(clippy::needless_range_loop)] // loops over rows of several arrays at once

use super::integrators::Colours;
use super::integrators::direct::ACROSS;
use crate::math::PACKET;
use crate::math::srgb::{Srgb, dither};
use crate::simd::{Op, Simd};

/// Linear values of surfaces up to this one stay as they are.
const KNEE: f32 = 0.8;
/// Bound of exposed values, far above all that is not white.
const MOST: f32 = 1e9;

/// The conversion of a picture's colours to bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tone {
    /// Factor to the light of surfaces.
    pub exposure: f32,
    /// If true, there is neither a curve nor dithering.
    pub exact: bool,
}

impl Tone {
    /// Returns the value shown for a linear value of which the share `cover` comes from surfaces.
    #[inline(always)]
    fn shown(self, linear: f32, cover: f32) -> f32 {
        let lit = (linear * self.exposure).min(MOST);
        let shown = if self.exact { lit } else { rolled_off(lit) };
        linear + cover * (shown - linear)
    }
}

/// The curve for highlights: the identity up to [`KNEE`], then a hyperbola with the same slope there that approaches 1.
#[inline(always)]
fn rolled_off(linear: f32) -> f32 {
    let above = (linear - KNEE).max(0.0);
    if above > 0.0 { KNEE + above / (1.0 + above * (1.0 / (1.0 - KNEE))) } else { linear }
}

/// Converts the linear colours of a packet to sRGB bytes. Alpha stays linear.
pub(super) struct Code<'a> {
    pub tone: Tone,
    pub srgb: &'a Srgb,
    /// Upper left pixel of the packet in the picture: dithering depends only on a pixel's place.
    pub at: (u32, u32),
    pub colours: &'a Colours,
    pub coded: &'a mut [[u8; 4]; PACKET],
}

impl Op for Code<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { tone, srgb, at, colours, coded } = self;
        let [red, green, blue, alpha, cover] = colours;
        let mut shown = [*red, *green, *blue, *alpha];
        for c in 0..3 {
            for i in 0..PACKET {
                shown[c][i] = tone.shown(shown[c][i], cover[i]);
            }
        }
        let mut offsets = [0.0; PACKET];
        if !tone.exact {
            for i in 0..PACKET {
                offsets[i] = dither(at.0 + i as u32 % ACROSS, at.1 + i as u32 / ACROSS);
            }
        }
        srgb.pixels(&shown, &offsets, coded);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn highlights_roll_off_and_all_else_stays() {
        let usual = Tone { exposure: 1.0, exact: false };
        for x in (0..=800).map(|i| i as f32 / 1000.0) {
            assert_eq!(usual.shown(x, 1.0), x, "the identity below the knee");
        }
        // Brighter stays brighter, and below white.
        let bright: Vec<f32> = (800..4000).map(|i| usual.shown(i as f32 / 1000.0, 1.0)).collect();
        assert!(bright.windows(2).all(|two| two[0] < two[1]) && bright.iter().all(|x| *x < 0.99));
        assert!((usual.shown(0.801, 1.0) - 0.801).abs() < 1e-5, "no kink at the knee");
        for background in [0.3, 0.9, 1.0, 2.0] {
            assert_eq!(Tone { exposure: 3.0, ..usual }.shown(background, 0.0), background);
        }
        assert_eq!(Tone { exposure: 2.0, exact: true }.shown(0.75, 1.0), 1.5);
        assert_eq!(Tone { exposure: 2.0, ..usual }.shown(0.25, 1.0), 0.5);
        for x in [f32::MAX, 65504.0] {
            assert!((0.99..=1.0).contains(&rolled_off(x.min(MOST))));
        }
    }
}
