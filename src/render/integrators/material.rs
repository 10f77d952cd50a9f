//! Reflection of light: Lambert's diffuse term and a Blinn highlight. Two-sided, never NaN.

use glam::Vec3;

/// Reflective properties of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Material {
    /// Linear RGB.
    pub colour: Vec3,
    /// 1 is opaque.
    pub opacity: f32,
    /// In [0, 1].
    pub metalness: f32,
    /// In [0, 1]; at 1 there is no highlight.
    pub roughness: f32,
    /// Light that the surface emits.
    pub glow: Vec3,
}

/// Colour that is blended into selected surfaces.
pub(super) const SELECTED: Vec3 = Vec3::new(1.0, 0.42, 0.04);

impl Material {
    /// Returns the material of a selected surface.
    pub fn selected(self) -> Self {
        Self { colour: self.colour.lerp(SELECTED, 0.65), glow: self.glow + SELECTED * 0.18, ..self }
    }
}

/// Properties of a material that do not depend on its colour.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gloss {
    pub metalness: f32,
    /// Fraction of the light that is reflected diffusely.
    pub diffuse: f32,
    /// Strength of the highlight; 0: none.
    pub smooth: f32,
    /// Factor that normalises the distribution of the highlight.
    pub gain: f32,
    /// Exponent of the highlight. (Powers with integer exponents take a fifth of the time of others.)
    pub exponent: u32,
}

impl Gloss {
    #[inline(always)]
    pub fn of(material: &Material) -> Self {
        let square = material.roughness.max(0.05) * material.roughness.max(0.05);
        let exponent = (2.0 / (square * square) + 0.5) as u32;
        Self {
            metalness: material.metalness,
            // Metals keep some diffuse light: there is no environment that they could mirror.
            diffuse: 1.0 - 0.6 * material.metalness,
            smooth: (1.0 - material.roughness) * (1.0 - material.roughness),
            gain: (exponent as f32 + 8.0) / 8.0,
            exponent,
        }
    }

    /// Returns the light reflected from a light of `irradiance`: that on a surface facing the light. A white matt
    /// surface that faces the light reflects the irradiance: factors of pi are left out on both sides. `cosine`:
    /// between normal and light; `aslant`: between light and half vector; `lobe`: the cosine between normal and half
    /// vector, raised to the exponent. The highlight is Blinn's normalised distribution with Schlick's reflectance, and
    /// fades out towards full roughness.
    #[inline(always)]
    pub fn lit(&self, colour: Vec3, cosine: f32, aslant: f32, lobe: f32, irradiance: Vec3) -> Vec3 {
        let facing = Vec3::splat(0.04).lerp(colour, self.metalness);
        let grazing = power(1.0 - aslant.clamp(0.0, 1.0), 5);
        let reflectance = facing + (Vec3::ONE - facing) * grazing;
        let lobe = self.gain * lobe;
        // The bound keeps mirrors from overexposure.
        let highlight = if self.smooth > 0.0 { reflectance * (lobe * self.smooth).min(8.0) } else { Vec3::ZERO };
        let lit = (colour * self.diffuse + highlight) * cosine * irradiance;
        if cosine > 0.0 { lit } else { Vec3::ZERO }
    }
}

/// Returns `x` to the power of `n`.
#[inline(always)]
fn power(x: f32, n: u32) -> f32 {
    let mut out = [0.0];
    powers(&[x], n, &mut out);
    out[0]
}

/// Raises each element of `x` to the power of `n`. (An array returned by value is split into scalars: seven times the
/// instructions.)
#[inline(always)]
pub(super) fn powers<const N: usize>(x: &[f32; N], n: u32, out: &mut [f32; N]) {
    let (mut all, mut square, mut left) = ([1.0; N], *x, n);
    while left != 0 {
        for i in 0..N {
            all[i] *= if left & 1 == 1 { square[i] } else { 1.0 };
            square[i] *= square[i];
        }
        left >>= 1;
    }
    *out = all;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn white(roughness: f32) -> Material {
        Material { colour: Vec3::ONE, opacity: 1.0, metalness: 0.0, roughness, glow: Vec3::ZERO }
    }

    /// The light reflected from a surface with a normal towards Z.
    fn lit(material: &Material, to_eye: Vec3, to_light: Vec3, irradiance: Vec3) -> Vec3 {
        let (half, gloss) = ((to_eye + to_light).normalize_or_zero(), Gloss::of(material));
        let lobe = power(Vec3::Z.dot(half).max(0.0), gloss.exponent);
        gloss.lit(material.colour, Vec3::Z.dot(to_light), half.dot(to_light), lobe, irradiance)
    }

    #[test]
    fn white_matt_reflects_the_cosine() {
        for cosine in [1.0f32, 0.5, 0.25, 0.0] {
            let light = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
            let lit = lit(&white(1.0), Vec3::Z, light, Vec3::ONE);
            assert!((lit - Vec3::splat(cosine)).abs().max_element() < 1e-6, "{lit}");
        }
        assert_eq!(lit(&white(0.2), Vec3::Z, -Vec3::Z, Vec3::ONE), Vec3::ZERO);
    }

    #[test]
    fn nothing_makes_nan() {
        for roughness in [0.0, 0.05, 0.5, 1.0] {
            for light in [Vec3::Z, -Vec3::Z, Vec3::X, Vec3::ZERO] {
                for metalness in [0.0, 1.0] {
                    let m = Material { metalness, ..white(roughness) };
                    assert!(lit(&m, -light, light, Vec3::splat(1e6)).is_finite());
                }
            }
        }
    }
}
