//! Light on the surfaces that a packet's rays hit, one column per ray.
#![allow(clippy::needless_range_loop)] // each loop indexes several arrays

use super::direct::{Direct, Scratch};
use super::material::{Gloss, Material, powers};
use super::surfaces::{Leaving, Surfaces};
use crate::lod::{Facing, mean_cosine};
use crate::math::{Cone, PACKET, Ray, bits};
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

    /// The gloss of the surface that ray `i` hits.
    #[inline(always)]
    fn gloss(&self, i: usize) -> Gloss {
        Gloss {
            metalness: self.metalness[i],
            diffuse: self.diffuse[i],
            smooth: self.smooth[i],
            gain: self.gain[i],
            exponent: self.exponent[i],
        }
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

    /// Returns those of `rays` whose origins are at most `most` from the planes of the triangles that they hit at
    /// distance `t`. `across`: the rays' unit directions, and the triangles' unit normals.
    pub fn low(isa: Isa, rays: u32, across: [&Vectors; 2], t: &Row<f64>, most: f32) -> u32 {
        dispatch(isa, Low { across, rays, t, most })
    }

    /// Adds the light of the surfaces that `rays` hit to `colour`, as far as light is transmitted to the eye.
    pub fn put(&self, isa: Isa, rays: u32, opacity: &Row<f32>, through: &mut Row<f32>, colour: &mut Vectors) {
        dispatch(isa, Put { all: self, rays, opacity, through, colour });
    }
}

/// Column `i` of three rows.
#[inline(always)]
pub(super) fn column(rows: &Vectors, i: usize) -> Vec3 {
    Vec3::new(rows[0][i], rows[1][i], rows[2][i])
}

/// Sets column `i` of three rows.
#[inline(always)]
pub(super) fn set_column(rows: &mut Vectors, i: usize, v: Vec3) {
    (rows[0][i], rows[1][i], rows[2][i]) = (v.x, v.y, v.z);
}

/// Raises each element of `x` to the power in `exponents`, for the rays of `among`.
#[inline(always)]
fn all_powers(x: &Row<f32>, exponents: &Row<u32>, among: u32, out: &mut Row<f32>) {
    let mut left = among;
    while left != 0 {
        let one = exponents[left.trailing_zeros() as usize & (PACKET - 1)];
        let mut powers_of_one = [0.0; PACKET];
        powers(x, one, &mut powers_of_one);
        let mut is_like = [0; PACKET];
        for i in 0..PACKET {
            out[i] = if exponents[i] == one { powers_of_one[i] } else { out[i] };
            is_like[i] = u32::from(exponents[i] == one) << i;
        }
        left &= !is_like.iter().fold(0, |all, it| all | it);
    }
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
        all_powers(&ahead, exponent, met, lobe);
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
        let Self { all, lights } = self;
        for light in lights {
            let strength = Vec3::from(light.colour) * light.intensity;
            for i in 0..PACKET {
                let add = all.gloss(i).lit(column(&all.colour, i), all.facing[i], all.aslant[i], all.lobe[i], strength);
                let sum = column(&all.sum, i) + add;
                set_column(&mut all.sum, i, sum);
            }
        }
    }
}

struct Low<'a> {
    across: [&'a Vectors; 2],
    rays: u32,
    t: &'a Row<f64>,
    most: f32,
}

impl Op for Low<'_> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let Self { across: [dir, normal], t, most, .. } = self;
        let mut is_low = [0; PACKET];
        for i in 0..PACKET {
            let height = (t[i] as f32 * column(dir, i).dot(column(normal, i))).abs();
            is_low[i] = u32::from(height <= most) << i;
        }
        self.rays & is_low.iter().fold(0, |all, it| all | it)
    }
}

struct Put<'a> {
    all: &'a Shading,
    rays: u32,
    opacity: &'a Row<f32>,
    through: &'a mut Row<f32>,
    colour: &'a mut Vectors,
}

impl Op for Put<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { all: Shading { sum, .. }, rays, opacity, through, colour } = self;
        for axis in 0..3 {
            for i in 0..PACKET {
                let more = colour[axis][i] + sum[axis][i] * (through[i] * opacity[i]);
                colour[axis][i] = if rays >> i & 1 == 1 { more } else { colour[axis][i] };
            }
        }
        for i in 0..PACKET {
            let left = through[i] * (1.0 - opacity[i]);
            through[i] = if rays >> i & 1 == 1 { left } else { through[i] };
        }
    }
}

/// A light as seen from the points of surfaces, one column each.
struct Aim {
    /// Unit directions to the light.
    to_light: Vectors,
    /// Irradiance on surfaces that face the light.
    irradiance: Vectors,
    /// Rays with a light in reach.
    lit: u32,
}

/// Reflects the light of a source on surfaces: see [`Gloss::lit`].
struct Reflect<'a> {
    all: &'a Shading,
    dir: &'a Vectors,
    aim: &'a Aim,
    /// Visible normals of the stand-ins that the rays in `cells` hit.
    facing: &'a [Facing; PACKET],
    cells: u32,
    out: &'a mut Vectors,
}

impl Op for Reflect<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { all, dir, aim: Aim { to_light, irradiance, lit }, facing, cells, out } = self;
        let Shading { normal, colour, exponent, .. } = all;
        let (mut cosines, mut halves, mut aslant) = ([0.0; PACKET], [0.0; PACKET], [0.0; PACKET]);
        for i in 0..PACKET {
            let (to_eye, to_light, normal) = (-column(dir, i), column(to_light, i), column(normal, i));
            // The half vector of a light at the eye points there.
            let half = if to_eye == to_light { to_eye } else { (to_eye + to_light).normalize_or_zero() };
            cosines[i] = if to_eye == to_light { normal.dot(to_light) } else { mean_cosine(normal, to_light) };
            halves[i] = normal.dot(half).max(0.0);
            aslant[i] = half.dot(to_light);
        }
        for i in bits(*lit & cells) {
            // All visible normals face the eye, so their mean gives the cosine of a light there.
            let (to_eye, to_light) = (-column(dir, i), column(to_light, i));
            cosines[i] = if to_eye == to_light { facing[i].mean().dot(to_light) } else { facing[i].cosine(to_light) };
        }
        let mut lobe = [0.0; PACKET];
        all_powers(&halves, exponent, *lit, &mut lobe);
        for i in 0..PACKET {
            let one = all.gloss(i).lit(column(colour, i), cosines[i], aslant[i], lobe[i], column(irradiance, i));
            (out[0][i], out[1][i], out[2][i]) = (one.x, one.y, one.z);
        }
    }
}

/// Adds light to the sums of the rays in `among`, times the fraction that arrives.
struct AddLight<'a> {
    sum: &'a mut Vectors,
    light: &'a Vectors,
    through: &'a Row<f32>,
    among: u32,
}

impl Op for AddLight<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { sum, light, through, among } = self;
        for axis in 0..3 {
            for i in 0..PACKET {
                let all = sum[axis][i] + light[axis][i] * through[i];
                sum[axis][i] = if among >> i & 1 == 1 { all } else { sum[axis][i] };
            }
        }
    }
}

impl Direct<'_> {
    /// Sums the light on the surfaces of the scratch's packet.
    pub(super) fn light(&self, scratch: &mut Scratch) -> Result<(), Need> {
        let Scratch { rays, surfaces, shading, .. } = scratch;
        shading.begin(self.isa(), rays.dirs(), [surfaces.met, surfaces.cells], self.ambient);
        let is_headlight = |light: &Light| light.kind == LightKind::Headlight;
        // The order is that of the scene, because the rounding of sums depends on it.
        for lights in self.view.scene.lights.chunk_by(|a, b| is_headlight(a) == is_headlight(b)) {
            if lights.first().is_some_and(is_headlight) {
                scratch.shading.add_headlights(self.isa(), lights);
                continue;
            }
            for light in lights {
                self.cast(light, scratch)?;
            }
        }
        Ok(())
    }

    /// Adds a light that may cast shadows.
    fn cast(&self, light: &Light, scratch: &mut Scratch) -> Result<(), Need> {
        let Scratch { rays, surfaces, shading, .. } = &mut *scratch;
        let Some(aim) = aim(light, surfaces) else { return Ok(()) };
        let (leaving, mut lit) = (&surfaces.leaving, [[0.0; PACKET]; 3]);
        let cells = surfaces.cells;
        dispatch(
            self.isa(),
            Reflect { all: shading, dir: rays.dirs(), aim: &aim, facing: &leaving.facing, cells, out: &mut lit },
        );
        let mut asked = 0;
        if light.shadows {
            for i in 0..PACKET {
                let is_lit = lit[0][i] != 0.0 || lit[1][i] != 0.0 || lit[2][i] != 0.0;
                asked |= (u32::from(is_lit) & aim.lit >> i) << i;
            }
        }
        let mut through = [1.0; PACKET];
        if asked != 0 {
            let mut shadow = [Ray::NONE; PACKET];
            bits(asked).for_each(|i| shadow[i] = toward(light, leaving, i, column(&aim.to_light, i)));
            self.unshadowed(&mut shadow, asked, &mut through, scratch)?;
        }
        let sum = &mut scratch.shading.sum;
        dispatch(self.isa(), AddLight { sum, light: &lit, through: &through, among: aim.lit });
        Ok(())
    }
}

/// Returns the directions and the irradiance of a light that is not at the eye; `None` if it reaches no surface.
fn aim(light: &Light, surfaces: &Surfaces) -> Option<Aim> {
    let strength = Vec3::from(light.colour) * light.intensity;
    let of = |v: Vec3| v.to_array().map(|x| [x; PACKET]);
    match light.kind {
        LightKind::Headlight => None,
        LightKind::Directional(dir) => {
            let to_light = of(-dir.try_normalize()?.as_vec3());
            Some(Aim { to_light, irradiance: of(strength), lit: surfaces.met })
        }
        LightKind::Point(point) => {
            let mut aim = Aim { to_light: of(Vec3::ZERO), irradiance: of(Vec3::ZERO), lit: 0 };
            for i in bits(surfaces.met) {
                let way = point - surfaces.leaving.position[i];
                let Some(to_light) = way.try_normalize() else { continue };
                set_column(&mut aim.to_light, i, to_light.as_vec3());
                let irradiance = strength * (1.0 / way.length_squared()).min(1e30) as f32;
                set_column(&mut aim.irradiance, i, irradiance);
                aim.lit |= 1 << i;
            }
            Some(aim)
        }
    }
}

/// Returns the shadow ray of ray `i`'s surface. Its `t_min` is [`Leaving::near`].
fn toward(light: &Light, leaving: &Leaving, i: usize, to_light: Vec3) -> Ray {
    let (from, near) = (leaving.from[i], leaving.near[i]);
    let cone = Cone { a: leaving.width[i], b: 0.0 };
    let LightKind::Point(point) = light.kind else {
        return Ray { cone, t_min: near, ..Ray::new(from, to_light) };
    };
    // The origin of the shadow ray is up to a cell nearer to the light than the surface, or even behind the light.
    let way = point - from;
    let t_max = way.length() * (1.0 - 1e-6);
    Ray { t_min: near.min(t_max), t_max, cone, ..Ray::new(from, way.normalize_or_zero().as_vec3()) }
}
