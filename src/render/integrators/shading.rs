//! Light on the surfaces that a packet's rays hit, one column per ray. Ambient light and headlights are computed for
//! all rays at once with SIMD. Lights that may cast shadows are computed ray by ray, because shadow rays take most of
//! their time.
#![allow(clippy::needless_range_loop)] // each loop indexes several arrays

use super::Colours;
use super::direct::{Direct, Scratch};
use super::material::{Gloss, Material, powers};
use super::surface::{Surface, aim};
use crate::math::{PACKET, Ray, bits};
use crate::scene::Light;
use crate::scene::light::LightKind;
use crate::scene::walk::Need;
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::Vec3;

/// One number per ray of a packet.
pub(super) type Row<T> = [T; PACKET];
/// One vector per ray, stored axis by axis.
pub(super) type Vectors = [Row<f32>; 3];

/// Surfaces and the light from them. Reusable: columns of rays without a hit hold arbitrary values.
#[repr(C, align(64))]
pub(super) struct Shading {
    /// Unit normals that face the rays.
    pub normal: Vectors,
    /// Mean cosines between the directions to the eye and the visible normals. A stand-in's mean includes all its
    /// sides.
    pub facing: Row<f32>,
    /// Properties of the materials.
    colour: Vectors,
    glow: Vectors,
    metalness: Row<f32>,
    diffuse: Row<f32>,
    smooth: Row<f32>,
    gain: Row<f32>,
    exponent: Row<u32>,
    /// Squared lengths of the rays' directions. `lobe`: cosines between normals and the directions to the eye, raised
    /// to the exponents.
    aslant: Row<f32>,
    lobe: Row<f32>,
    /// Sum of the light.
    sum: Vectors,
}

impl Default for Shading {
    fn default() -> Self {
        const NONE: Row<f32> = [0.0; PACKET];
        Self {
            normal: [NONE; 3],
            facing: NONE,
            colour: [NONE; 3],
            glow: [NONE; 3],
            metalness: NONE,
            diffuse: NONE,
            smooth: NONE,
            gain: NONE,
            exponent: [0; PACKET],
            aslant: NONE,
            lobe: NONE,
            sum: [NONE; 3],
        }
    }
}

impl Shading {
    /// Sets the material of the surfaces that `rays` hit. `are_all`: no other ray has a hit.
    pub fn set_material(&mut self, rays: u32, are_all: bool, material: &Material) {
        let gloss = Gloss::of(material);
        let (colour, glow) = (material.colour, material.glow);
        if are_all {
            for axis in 0..3 {
                (self.colour[axis], self.glow[axis]) = ([colour[axis]; PACKET], [glow[axis]; PACKET]);
            }
            (self.metalness, self.diffuse) = ([gloss.metalness; PACKET], [gloss.diffuse; PACKET]);
            (self.smooth, self.gain) = ([gloss.smooth; PACKET], [gloss.gain; PACKET]);
            self.exponent = [gloss.exponent; PACKET];
            return;
        }
        for i in bits(rays) {
            self.set_colour(i, colour);
            set_column(&mut self.glow, i, glow);
            (self.metalness[i], self.diffuse[i], self.smooth[i]) = (gloss.metalness, gloss.diffuse, gloss.smooth);
            (self.gain[i], self.exponent[i]) = (gloss.gain, gloss.exponent);
        }
    }

    /// Replaces the material's colour of the surface that ray `i` hits. `colour` is linear.
    pub fn set_colour(&mut self, i: usize, colour: Vec3) {
        set_column(&mut self.colour, i, colour);
    }

    /// Begins the sums with glow and ambient light. `met`: rays with a surface, in the directions `dir`; `faced`: rays
    /// for which [`Shading::facing`] is set.
    pub fn begin(&mut self, isa: Isa, dir: &Vectors, [met, faced]: [u32; 2], ambient: f32) {
        dispatch(isa, Begin { all: self, dir, met, faced, ambient });
    }

    /// Adds lights at the eye. Their shadows are never visible from there.
    pub fn add_headlights(&mut self, isa: Isa, lights: &[Light]) {
        dispatch(isa, Headlights { all: self, lights });
    }

    /// Returns the least distance of the eye from the planes of the triangles that `rays` hit at distance `t`.
    /// `across`: the rays' unit directions, and the triangles' unit normals.
    pub fn least_height(&self, isa: Isa, rays: u32, across: [&Vectors; 2], t: &Row<f32>) -> f32 {
        dispatch(isa, LeastHeight { across, rays, t })
    }

    /// Returns the light from the hit of ray `i`.
    pub fn light(&self, i: usize) -> Vec3 {
        column(&self.sum, i)
    }

    /// Writes the light of the rays in `met`, all from opaque surfaces, over the background in `out`.
    pub fn put(&self, isa: Isa, met: u32, out: &mut Colours) {
        dispatch(isa, Put { all: self, met, out });
    }
}

#[inline(always)]
fn column(rows: &Vectors, i: usize) -> Vec3 {
    Vec3::new(rows[0][i], rows[1][i], rows[2][i])
}

#[inline(always)]
fn set_column(rows: &mut Vectors, i: usize, v: Vec3) {
    (rows[0][i], rows[1][i], rows[2][i]) = (v.x, v.y, v.z);
}

struct Begin<'a> {
    all: &'a mut Shading,
    dir: &'a Vectors,
    met: u32,
    faced: u32,
    ambient: f32,
}

impl Op for Begin<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self {
            all: Shading { normal, facing, colour, glow, exponent, aslant, lobe, sum, .. },
            dir,
            met,
            faced,
            ambient,
        } = self;
        let mut ahead = [0.0; PACKET];
        for i in 0..PACKET {
            let to_eye = -column(dir, i);
            let cosine = column(normal, i).dot(to_eye);
            aslant[i] = to_eye.dot(to_eye);
            ahead[i] = cosine.max(0.0);
            facing[i] = if faced >> i & 1 == 1 { facing[i] } else { cosine };
        }
        let mut left = met;
        while left != 0 {
            let one = exponent[left.trailing_zeros() as usize & (PACKET - 1)];
            let mut powers_of_one = [0.0; PACKET];
            powers(&ahead, one, &mut powers_of_one);
            let mut is_like = [0; PACKET];
            for i in 0..PACKET {
                lobe[i] = if exponent[i] == one { powers_of_one[i] } else { lobe[i] };
                is_like[i] = u32::from(exponent[i] == one) << i;
            }
            left &= !is_like.iter().fold(0, |all, it| all | it);
        }
        for i in 0..PACKET {
            let own = column(colour, i) * ambient + column(glow, i);
            (sum[0][i], sum[1][i], sum[2][i]) = (own.x, own.y, own.z);
        }
    }
}

struct Headlights<'a> {
    all: &'a mut Shading,
    lights: &'a [Light],
}

impl Op for Headlights<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Shading { facing, colour, metalness, diffuse, smooth, gain, exponent, aslant, lobe, sum, .. } = self.all;
        for light in self.lights {
            let strength = Vec3::from(light.colour) * light.intensity;
            for i in 0..PACKET {
                let gloss = Gloss {
                    metalness: metalness[i],
                    diffuse: diffuse[i],
                    smooth: smooth[i],
                    gain: gain[i],
                    exponent: exponent[i],
                };
                let add = gloss.lit(column(colour, i), facing[i], aslant[i], lobe[i], strength);
                (sum[0][i], sum[1][i], sum[2][i]) = (sum[0][i] + add.x, sum[1][i] + add.y, sum[2][i] + add.z);
            }
        }
    }
}

struct LeastHeight<'a> {
    across: [&'a Vectors; 2],
    rays: u32,
    t: &'a Row<f32>,
}

impl Op for LeastHeight<'_> {
    type Out = f32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> f32 {
        let Self { across: [dir, normal], .. } = self;
        let mut height = [0.0; PACKET];
        for i in 0..PACKET {
            let of_hit = (self.t[i] * column(dir, i).dot(column(normal, i))).abs();
            height[i] = if self.rays >> i & 1 == 1 { of_hit } else { f32::INFINITY };
        }
        height.into_iter().fold(f32::INFINITY, f32::min)
    }
}

struct Put<'a> {
    all: &'a Shading,
    met: u32,
    out: &'a mut Colours,
}

impl Op for Put<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { all: Shading { sum, .. }, met, out } = self;
        let mut mask = [0; PACKET];
        for i in 0..PACKET {
            mask[i] = 0u32.wrapping_sub(met >> i & 1);
        }
        for axis in 0..3 {
            for i in 0..PACKET {
                out[axis][i] = f32::from_bits(sum[axis][i].to_bits() & mask[i] | out[axis][i].to_bits() & !mask[i]);
            }
        }
        for whole in 3..5 {
            for i in 0..PACKET {
                out[whole][i] = f32::from_bits(1.0f32.to_bits() & mask[i] | out[whole][i].to_bits() & !mask[i]);
            }
        }
    }
}

impl Direct<'_> {
    /// Sums the lights on the surfaces that `rays` hit, in the scratch's [`Shading`].
    pub(super) fn light(
        &self,
        rays: &[Ray; PACKET],
        surfaces: &[Option<Surface>; PACKET],
        active: u32,
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        let shading = &mut scratch.shading;
        let mut dir = [[0.0; PACKET]; 3];
        for i in bits(active) {
            let Some(s) = &surfaces[i] else { continue };
            shading.set_material(1 << i, false, &s.material);
            set_column(&mut dir, i, rays[i].dir);
            set_column(&mut shading.normal, i, s.normal);
            shading.facing[i] = s.facing.mean().dot(-rays[i].dir);
        }
        shading.begin(self.isa(), &dir, [active, active], self.ambient);
        let is_headlight = |light: &Light| light.kind == LightKind::Headlight;
        // The order is that of the scene, because the rounding of sums depends on it.
        for lights in self.view.scene.lights.chunk_by(|a, b| is_headlight(a) == is_headlight(b)) {
            if lights.first().is_some_and(is_headlight) {
                scratch.shading.add_headlights(self.isa(), lights);
                continue;
            }
            for light in lights {
                self.cast(light, rays, surfaces, active, scratch)?;
            }
        }
        Ok(())
    }

    /// Adds a light that may cast shadows.
    fn cast(
        &self,
        light: &Light,
        rays: &[Ray; PACKET],
        surfaces: &[Option<Surface>; PACKET],
        active: u32,
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        let mut answer = [Vec3::ZERO; PACKET];
        let mut shadow = [Ray::NONE; PACKET];
        let mut asked = 0;
        for i in bits(active) {
            let Some(s) = &surfaces[i] else { continue };
            let Some(aim) = aim(light, s) else { continue };
            answer[i] = s.material.lit(s.normal, &s.facing, -rays[i].dir, aim.to_light, aim.irradiance);
            if answer[i] != Vec3::ZERO && light.shadows {
                shadow[i] = aim.shadow;
                asked |= 1 << i;
            }
        }
        let through = self.unshadowed(&mut shadow, asked, scratch)?;
        for i in bits(active) {
            let sum = scratch.shading.light(i) + answer[i] * through[i];
            set_column(&mut scratch.shading.sum, i, sum);
        }
        Ok(())
    }
}
