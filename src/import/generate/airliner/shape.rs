//! Formulas of the outer surfaces. Units are metres; x runs from nose to tail, y to the right, z up. The axis of the
//! fuselage is z = 0.

use glam::DVec3;

/// Radius of the cabin.
pub const RADIUS: f64 = 3.1;
/// Total length.
pub const LENGTH: f64 = 63.7;
/// Distance between frames.
pub const BAY: f64 = 0.53;
/// Position x of the first frame.
pub const FIRST_FRAME: f64 = 1.6;
/// Number of bays between frames.
pub const BAYS: u64 = 112;
const NOSE: f64 = 9.0;
const TAIL: f64 = 43.0;

/// Returns the radius of the fuselage at `x`.
pub fn radius(x: f64) -> f64 {
    if x < NOSE {
        let s = (1.0 - x.max(0.0) / NOSE).powf(2.1);
        RADIUS * (1.0 - s).max(0.0).powf(0.58)
    } else if x > TAIL {
        let s = ((x - TAIL) / (LENGTH - TAIL)).min(1.0);
        RADIUS * (1.0 - s.powf(1.75)) + 0.22 * s
    } else {
        RADIUS
    }
}

/// Returns the height of the fuselage's centre at `x`.
pub fn rise(x: f64) -> f64 {
    if x < NOSE {
        -0.75 * (1.0 - x.max(0.0) / NOSE).powi(2)
    } else if x > TAIL {
        2.0 * ((x - TAIL) / (LENGTH - TAIL)).min(1.0).powf(1.75)
    } else {
        0.0
    }
}

/// Returns the point at `x` and `angle` (radians from the top, positive to the right), `inset` inside the skin.
pub fn fuselage(x: f64, angle: f64, inset: f64) -> DVec3 {
    let (s, c) = angle.sin_cos();
    // At the thin ends the inset is limited, so that the radius stays positive.
    let r = (radius(x) - inset).max(0.1 * radius(x));
    DVec3::new(x, r * s, rise(x) + r * c)
}

/// A wing or fin with a straight leading edge, piecewise linear chord and symmetric section.
#[derive(Debug, Clone)]
pub struct Foil {
    /// Leading edge at the root.
    pub root: DVec3,
    /// Leading edge at the tip.
    pub tip: DVec3,
    /// Chords as (span fraction, chord) in order, from 0 to 1.
    pub chords: &'static [(f64, f64)],
    /// Unit vector across the section.
    pub across: DVec3,
    /// Thickness as a fraction of the chord, at root and tip.
    pub thickness: (f64, f64),
}

impl Foil {
    /// Returns the wing on one side (−1 left, 1 right).
    pub fn wing(side: f64) -> Self {
        Self {
            root: DVec3::new(20.6, 2.2 * side, -1.75),
            tip: DVec3::new(40.4, 30.4 * side, 1.75),
            chords: &[(0.0, 14.2), (0.25, 9.1), (1.0, 2.3)],
            across: DVec3::new(0.0, -0.12 * side, 0.993).normalize(),
            thickness: (0.135, 0.09),
        }
    }

    /// Returns the tailplane on one side (−1 left, 1 right).
    pub fn tailplane(side: f64) -> Self {
        Self {
            root: DVec3::new(52.6, 1.1 * side, 1.2),
            tip: DVec3::new(59.6, 10.8 * side, 2.4),
            chords: &[(0.0, 7.4), (1.0, 2.5)],
            across: DVec3::new(0.0, -0.12 * side, 0.993).normalize(),
            thickness: (0.1, 0.08),
        }
    }

    /// Returns the fin.
    pub fn fin() -> Self {
        Self {
            root: DVec3::new(49.6, 0.0, 2.2),
            tip: DVec3::new(58.6, 0.0, 12.6),
            chords: &[(0.0, 9.6), (1.0, 3.4)],
            across: DVec3::Y,
            thickness: (0.1, 0.08),
        }
    }

    /// Returns the length of the leading edge.
    pub fn span(&self) -> f64 {
        self.root.distance(self.tip)
    }

    /// Returns the chord at span fraction `s`.
    pub fn chord(&self, s: f64) -> f64 {
        let pair = self.chords.windows(2).find(|p| s <= p[1].0).unwrap_or(&self.chords[self.chords.len() - 2..]);
        let ((s0, c0), (s1, c1)) = (pair[0], pair[1]);
        c0 + (c1 - c0) * (s - s0) / (s1 - s0)
    }

    /// Returns half of the thickness at span fraction `s` and chord fraction `c` (NACA's four-digit formula).
    pub fn half_thickness(&self, s: f64, c: f64) -> f64 {
        let t = self.thickness.0 + (self.thickness.1 - self.thickness.0) * s;
        let c = c.clamp(0.0, 1.0);
        let y = 0.2969 * c.sqrt() - 0.126 * c - 0.3516 * c * c + 0.2843 * c.powi(3) - 0.1036 * c.powi(4);
        5.0 * t * y * self.chord(s)
    }

    /// Returns the point at span fraction `s` and chord fraction `c`; `h` is −1 on the lower skin, 1 on the upper skin.
    pub fn point(&self, s: f64, c: f64, h: f64) -> DVec3 {
        self.root.lerp(self.tip, s) + DVec3::X * (c * self.chord(s)) + self.across * (h * self.half_thickness(s, c))
    }
}

/// Returns the centre of the fan of the engine on one side (−1 left, 1 right).
pub fn engine(side: f64) -> DVec3 {
    DVec3::new(20.9, 9.75 * side, -3.05)
}

/// Returns the radius of the nacelle at `t` along it, from the lip (0) to the nozzle (1).
pub fn nacelle(t: f64) -> f64 {
    1.48 + 0.34 * (1.0 - (1.0 - (t / 0.25).min(1.0)).powi(2)) - 0.55 * ((t - 0.35).max(0.0) / 0.65).powf(1.8)
}

/// Length of the nacelle.
pub const NACELLE: f64 = 5.6;

/// Returns the radius of the engine's core at `t` along it.
pub fn core(t: f64) -> f64 {
    0.62 + 0.16 * (t * 9.0).sin() - 0.12 * t
}
