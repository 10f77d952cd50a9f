//! Lights and backgrounds. Colours are linear RGB.

use crate::base::error::{Error, Result};
use glam::DVec3;

/// The source of a light's rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// At the eye (perspective) or along the view (orthographic), without falloff; it never casts visible shadows.
    Headlight,
    /// A point in world space. Its irradiance at distance d is `intensity / d²`.
    Point(DVec3),
    /// Light from infinitely far away that travels along this direction (need not be unit).
    Directional(DVec3),
}

/// A light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Kind and place of the light.
    pub kind: LightKind,
    /// Linear RGB, 0 or more.
    pub colour: [f32; 3],
    /// Factor to `colour`, 0 or more. A white matt surface facing a headlight or directional light of intensity 1 has
    /// the value 1.
    pub intensity: f32,
    /// True if shadow rays are traced (ignored for a headlight). A transparent part transmits 1 minus its opacity.
    pub shadows: bool,
}

impl Light {
    /// A white headlight of intensity 1.
    pub const HEADLIGHT: Self = Self { kind: LightKind::Headlight, colour: [1.0; 3], intensity: 1.0, shadows: false };

    /// Fails with [`Error::BadArgument`] if a number is negative or not finite, or a direction is zero.
    pub fn check(&self) -> Result<()> {
        let number = |x: f32| x.is_finite() && x >= 0.0;
        if !(self.colour.iter().all(|&c| number(c)) && number(self.intensity)) {
            return Err(Error::bad_argument("light: colour and intensity must be finite and 0 or more"));
        }
        match self.kind {
            LightKind::Point(p) if !p.is_finite() => Err(Error::bad_argument("light: the position must be finite")),
            LightKind::Directional(d) if d.try_normalize().is_none() => {
                Err(Error::bad_argument("light: the direction must be finite and not zero"))
            }
            _ => Ok(()),
        }
    }
}

/// The colour of rays that miss everything. Linear RGBA.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    /// One colour.
    Colour([f32; 4]),
    /// A gradient from the bottom to the top row of the picture.
    Gradient {
        /// Colour at the bottom.
        bottom: [f32; 4],
        /// Colour at the top.
        top: [f32; 4],
    },
}

impl Default for Background {
    fn default() -> Self {
        Background::Gradient { bottom: [0.55, 0.58, 0.62, 1.0], top: [0.12, 0.16, 0.23, 1.0] }
    }
}

impl Background {
    /// Fails with [`Error::BadArgument`] if a number is negative or not finite.
    pub fn check(&self) -> Result<()> {
        let good = |c: &[f32; 4]| c.iter().all(|x| x.is_finite() && *x >= 0.0);
        let fine = match self {
            Background::Colour(c) => good(c),
            Background::Gradient { bottom, top } => good(bottom) && good(top),
        };
        if fine { Ok(()) } else { Err(Error::bad_argument("background: colours must be finite and 0 or more")) }
    }

    /// The colour at `height` of the picture, 0 at the bottom, 1 at the top.
    #[inline]
    pub fn at(&self, height: f32) -> [f32; 4] {
        match *self {
            Background::Colour(c) => c,
            Background::Gradient { bottom, top } => std::array::from_fn(|i| bottom[i] + (top[i] - bottom[i]) * height),
        }
    }
}
