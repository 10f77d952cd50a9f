//! The same pictures by Embree: camera rays in packets of 16, shadow rays in packets of 16, the shading of outcrop
//! (`src/render/integrators/material.rs`) written as plain loops over a packet, and the crate's own coding to bytes.
//!
//! What it lacks: normals interpolated between corners, distances in double precision, and errors of stand-ins; so its
//! shading costs a little less than outcrop's.
#![allow(clippy::needless_range_loop)] // loops over rows of several arrays at once

use crate::data::TILE;
use crate::peers::embree_calls::{Context, NONE, RtcHits, RtcRayHits, RtcRays, Scene, Valid};
use glam::{DAffine3, Mat3, Vec3};
use outcrop::math::srgb::{Srgb, dither};
use outcrop::scene::Camera;
use outcrop::simd::DenormalsOff;
use outcrop::{Buffer, Outputs};

/// Rays of a packet: a square of pixels.
const N: usize = (TILE * TILE) as usize;
type Row = [f32; N];
type Vectors = [Row; 3];

/// Most transparent surfaces on a ray, and the transmittance below which a ray ends: as outcrop has them.
const MOST_LAYERS: usize = 32;
const LEAST: f32 = 1.0 / 512.0;

/// How far beyond a surface the next ray begins, as a share of the size of what is in sight: single precision may
/// misplace a hit by so much.
const LEAVE: f32 = 1e-5;

/// A part's surface; see outcrop's `Gloss`.
#[derive(Debug, Clone, Copy)]
pub struct Material {
    pub colour: Vec3,
    pub opacity: f32,
    metalness: f32,
    diffuse: f32,
    smooth: f32,
    gain: f32,
    exponent: u32,
    /// Whether the colours of triangles take the place of its own.
    takes_colours: bool,
}

impl Material {
    pub fn new(colour: [f32; 4], metalness: f32, roughness: f32, takes_colours: bool) -> Self {
        let square = roughness.max(0.05) * roughness.max(0.05);
        let exponent = (2.0 / (square * square) + 0.5) as u32;
        Self {
            colour: Vec3::new(colour[0], colour[1], colour[2]),
            opacity: colour[3],
            metalness,
            diffuse: 1.0 - 0.6 * metalness,
            smooth: (1.0 - roughness) * (1.0 - roughness),
            gain: (exponent as f32 + 8.0) / 8.0,
            exponent,
            takes_colours,
        }
    }
}

/// White lights.
#[derive(Debug, Clone, Copy)]
pub enum Lamp {
    Head,
    /// Unit direction to it, and irradiance.
    Sun(Vec3, f32),
    /// Where it is, and its irradiance at distance 1.
    Point(Vec3, f32),
}

/// All that a picture is made of beside the scene.
pub struct Look {
    pub parts: Vec<u32>,
    /// Of triangles; empty for none.
    pub colours: Vec<[f32; 3]>,
    /// By part.
    pub materials: Vec<Material>,
    /// By instance: turns normals into the world. Empty for a scene of one mesh.
    pub turns: Vec<Mat3>,
    pub ids: Vec<u64>,
    pub lamps: Vec<Lamp>,
    pub ambient: f32,
    pub background: [f32; 4],
    /// Of what is in sight.
    pub size: f32,
}

impl Look {
    pub fn turns_of(places: &[DAffine3]) -> Vec<Mat3> {
        places.iter().map(|place| place.matrix3.inverse().transpose().as_mat3()).collect()
    }

    fn is_see_through(&self) -> bool {
        self.materials.iter().any(|material| material.opacity < 1.0)
    }
}

/// A camera's rays in single precision.
pub struct Rays {
    eye: Vec3,
    forward: Vec3,
    /// Of one pixel.
    right: Vec3,
    down: Vec3,
    is_parallel: bool,
    size: (u32, u32),
}

impl Rays {
    pub fn of(camera: &Camera, size: (u32, u32)) -> Self {
        let (Camera::Perspective { eye, at, up, .. } | Camera::Orthographic { eye, at, up, .. }) = *camera;
        let (pixel, is_parallel) = match *camera {
            Camera::Perspective { fov_y_degrees, .. } => (2.0 * (0.5 * fov_y_degrees.to_radians()).tan(), false),
            Camera::Orthographic { height, .. } => (height, true),
        };
        let pixel = pixel / f64::from(size.1);
        let forward = (at - eye).normalize();
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        let [eye, forward, right, down] = [eye, forward, right * pixel, down * pixel].map(|v| v.as_vec3());
        Self { eye, forward, right, down, is_parallel, size }
    }

    fn packet(&self, (x, y): (u32, u32)) -> RtcRays<N> {
        let (half_x, half_y) = (0.5 * self.size.0 as f32, 0.5 * self.size.1 as f32);
        let (mut org, mut dir) = ([[0.0; N]; 3], [[0.0; N]; 3]);
        for i in 0..N {
            let u = (x + i as u32 % TILE) as f32 + 0.5 - half_x;
            let v = (y + i as u32 / TILE) as f32 + 0.5 - half_y;
            let off = self.right * u + self.down * v;
            let (from, to) =
                if self.is_parallel { (self.eye + off, self.forward) } else { (self.eye, self.forward + off) };
            let to = to * (1.0 / to.length());
            set(&mut org, i, from);
            set(&mut dir, i, to);
        }
        rays(org, dir, [0.0; N], [f32::INFINITY; N])
    }
}

fn rays(org: Vectors, dir: Vectors, tnear: Row, tfar: Row) -> RtcRays<N> {
    RtcRays { org, tnear, dir, time: [0.0; N], tfar, mask: [u32::MAX; N], id: [0; N], flags: [0; N] }
}

fn get(rows: &Vectors, i: usize) -> Vec3 {
    Vec3::new(rows[0][i], rows[1][i], rows[2][i])
}

fn set(rows: &mut Vectors, i: usize, v: Vec3) {
    (rows[0][i], rows[1][i], rows[2][i]) = (v.x, v.y, v.z);
}

/// The buffers of a picture; those that are not asked for are empty.
#[derive(Default)]
pub struct Picture {
    is_colour_alone: bool,
    pub colours: Vec<[u8; 4]>,
    pub depths: Vec<f32>,
    pub normals: Vec<[f32; 3]>,
    pub parts: Vec<u64>,
    pub instances: Vec<u64>,
    pub prims: Vec<u64>,
    pub errors: Vec<f32>,
    pub kinds: Vec<u8>,
}

impl Picture {
    pub fn new((width, height): (u32, u32), outputs: Outputs) -> Self {
        let pixels = (width * height) as usize;
        let of = |buffer| if outputs.has(buffer) { pixels } else { 0 };
        Self {
            is_colour_alone: outputs == Outputs::COLOUR,
            colours: vec![[0; 4]; pixels],
            depths: vec![0.0; of(Buffer::Depth)],
            normals: vec![[0.0; 3]; of(Buffer::Normal)],
            parts: vec![0; of(Buffer::Part)],
            instances: vec![0; of(Buffer::Instance)],
            prims: vec![0; of(Buffer::Primitive)],
            errors: vec![0.0; of(Buffer::Error)],
            kinds: vec![0; of(Buffer::Kind)],
        }
    }
}

/// Surfaces of a packet.
struct Surfaces {
    normal: Vectors,
    /// Cosine between normal and eye.
    facing: Row,
    colour: Vectors,
    opacity: Row,
    metalness: Row,
    diffuse: Row,
    smooth: Row,
    gain: Row,
    exponent: [u32; N],
}

/// Embree with what it renders.
pub struct Renderer<'a> {
    pub scene: &'a Scene,
    pub look: &'a Look,
    pub srgb: Srgb,
}

impl Renderer<'_> {
    /// Renders in the calling thread.
    pub fn render(&self, camera: &Rays, picture: &mut Picture) {
        let _denormals = DenormalsOff::set();
        let is_see_through = self.look.is_see_through();
        for y in (0..camera.size.1).step_by(TILE as usize) {
            for x in (0..camera.size.0).step_by(TILE as usize) {
                self.packet(camera, (x, y), is_see_through, picture);
            }
        }
    }

    fn packet(&self, camera: &Rays, at: (u32, u32), is_see_through: bool, picture: &mut Picture) {
        let mut context = Context::new(true);
        let mut all = RtcRayHits { rays: camera.packet(at), hits: NO_HITS };
        let (mut sum, mut through) = ([[0.0; N]; 3], [1.0; N]);
        let mut valid = Valid([-1; N]);
        for layer in 0..MOST_LAYERS {
            self.scene.intersect_packet(&mut context, &valid, &mut all);
            let met: [bool; N] = std::array::from_fn(|i| valid.0[i] != 0 && all.hits.geometry[i] != NONE);
            let is_missed = !met.contains(&true);
            if is_missed && layer > 0 {
                break;
            }
            let surfaces = self.surfaces(&all, &met);
            if layer == 0 && !picture.is_colour_alone {
                self.write(camera, at, &all, &met, &surfaces, picture);
            }
            if is_missed {
                break;
            }
            let light = self.light(&all, &met, &surfaces, is_see_through);
            for i in 0..N {
                let share = if met[i] { through[i] * surfaces.opacity[i] } else { 0.0 };
                for axis in 0..3 {
                    sum[axis][i] += share * light[axis][i];
                }
                through[i] -= share;
            }
            if !is_see_through {
                break;
            }
            for i in 0..N {
                let is_over = through[i] < LEAST;
                through[i] = if is_over { 0.0 } else { through[i] };
                valid.0[i] = if met[i] && !is_over { -1 } else { 0 };
                all.rays.tnear[i] = all.rays.tfar[i] + self.look.size * LEAVE;
                all.rays.tfar[i] = f32::INFINITY;
            }
            all.hits = NO_HITS;
            if valid.0.iter().all(|v| *v == 0) {
                break;
            }
        }
        self.code(camera, at, &sum, &through, picture);
    }

    /// What was met, with normals to the eye.
    fn surfaces(&self, all: &RtcRayHits<N>, met: &[bool; N]) -> Surfaces {
        let mut s = Surfaces {
            normal: all.hits.normal,
            facing: [0.0; N],
            colour: [[0.0; N]; 3],
            opacity: [1.0; N],
            metalness: [0.0; N],
            diffuse: [1.0; N],
            smooth: [0.0; N],
            gain: [1.0; N],
            exponent: [1; N],
        };
        for i in (0..N).filter(|&i| met[i]) {
            let prim = all.hits.prim[i] as usize;
            let material = &self.look.materials[self.look.parts[prim] as usize];
            let own = if material.takes_colours { self.look.colours.get(prim) } else { None };
            set(&mut s.colour, i, own.map_or(material.colour, |colour| (*colour).into()));
            s.opacity[i] = material.opacity;
            (s.metalness[i], s.diffuse[i]) = (material.metalness, material.diffuse);
            (s.smooth[i], s.gain[i], s.exponent[i]) = (material.smooth, material.gain, material.exponent);
            if let Some(turn) = self.look.turns.get(all.hits.instance[i] as usize) {
                let turned = *turn * get(&s.normal, i);
                set(&mut s.normal, i, turned);
            }
        }
        for i in 0..N {
            let normal = get(&s.normal, i);
            let inverse = 1.0 / normal.length().max(f32::MIN_POSITIVE);
            let cosine = -normal.dot(get(&all.rays.dir, i)) * inverse;
            let side = if cosine < 0.0 { -inverse } else { inverse };
            set(&mut s.normal, i, normal * side);
            s.facing[i] = cosine.abs();
        }
        s
    }

    fn light(&self, all: &RtcRayHits<N>, met: &[bool; N], s: &Surfaces, is_see_through: bool) -> Vectors {
        let mut sum = s.colour.map(|row| row.map(|c| c * self.look.ambient));
        let mut irradiance = [0.0; N];
        for lamp in &self.look.lamps {
            let mut to_light = [[0.0; N]; 3];
            let mut far = [f32::INFINITY; N];
            let (mut cosine, mut aslant, mut lobe) = (s.facing, [1.0; N], s.facing);
            for i in 0..N {
                let (dir, t) = (get(&all.rays.dir, i), all.rays.tfar[i]);
                let way = match *lamp {
                    Lamp::Head => {
                        irradiance[i] = 1.0;
                        continue;
                    }
                    Lamp::Sun(to, strength) => {
                        irradiance[i] = strength;
                        to
                    }
                    Lamp::Point(place, strength) => {
                        let way = place - (get(&all.rays.org, i) + dir * if met[i] { t } else { 0.0 });
                        let length = way.length().max(f32::MIN_POSITIVE);
                        irradiance[i] = strength / (length * length);
                        far[i] = length * (1.0 - LEAVE);
                        way / length
                    }
                };
                let normal = get(&s.normal, i);
                let half = way - dir;
                let half = half * (1.0 / half.length().max(f32::MIN_POSITIVE));
                cosine[i] = normal.dot(way);
                aslant[i] = half.dot(way);
                lobe[i] = normal.dot(half).max(0.0);
                set(&mut to_light, i, way);
            }
            let lobe = powers(&lobe, &s.exponent);
            let mut add = [[0.0; N]; 3];
            for i in 0..N {
                let colour = get(&s.colour, i);
                let facing = Vec3::splat(0.04).lerp(colour, s.metalness[i]);
                let one = (1.0 - aslant[i]).clamp(0.0, 1.0);
                let grazing = one * one * one * one * one;
                let reflectance = facing + (Vec3::ONE - facing) * grazing;
                let highlight = reflectance * (s.gain[i] * lobe[i] * s.smooth[i]).min(8.0);
                let lit = (colour * s.diffuse[i] + highlight) * (cosine[i].max(0.0) * irradiance[i]);
                set(&mut add, i, lit);
            }
            let arrives = match lamp {
                Lamp::Head => [1.0; N],
                _ => {
                    let asked = std::array::from_fn(|i| met[i] && cosine[i] > 0.0);
                    self.unshadowed(all, s, to_light, far, &asked, is_see_through)
                }
            };
            for axis in 0..3 {
                for i in 0..N {
                    sum[axis][i] += add[axis][i] * arrives[i];
                }
            }
        }
        sum
    }

    /// The share of light that arrives along each ray that is asked.
    fn unshadowed(
        &self,
        all: &RtcRayHits<N>,
        s: &Surfaces,
        to_light: Vectors,
        far: Row,
        asked: &[bool; N],
        is_see_through: bool,
    ) -> Row {
        let mut through = [1.0; N];
        if !asked.contains(&true) {
            return through;
        }
        let leave = self.look.size * LEAVE;
        let mut org = [[0.0; N]; 3];
        for i in 0..N {
            let t = if asked[i] { all.rays.tfar[i] } else { 0.0 };
            set(&mut org, i, get(&all.rays.org, i) + get(&all.rays.dir, i) * t + get(&s.normal, i) * leave);
        }
        let mut valid = Valid(asked.map(|is| -i32::from(is)));
        let mut shadow = rays(org, to_light, [0.0; N], far);
        // Of coherent rays into two levels `rtcOccluded16` of Embree 3.13.5 does not return (`peers/embree.rs`).
        let mut context = Context::new(self.look.turns.is_empty());
        self.scene.occluded_packet(&mut context, &valid, &mut shadow);
        let dark: [bool; N] = std::array::from_fn(|i| asked[i] && shadow.tfar[i] < 0.0);
        if !is_see_through {
            return dark.map(|is_dark| if is_dark { 0.0 } else { 1.0 });
        }
        let mut all = RtcRayHits { rays: rays(org, to_light, [0.0; N], far), hits: NO_HITS };
        valid = Valid(dark.map(|is| -i32::from(is)));
        for _ in 0..MOST_LAYERS {
            if valid.0.iter().all(|v| *v == 0) {
                break;
            }
            self.scene.intersect_packet(&mut context, &valid, &mut all);
            let asked = valid.0;
            for i in (0..N).filter(|&i| asked[i] != 0) {
                if all.hits.geometry[i] == NONE {
                    valid.0[i] = 0;
                    continue;
                }
                let part = self.look.parts[all.hits.prim[i] as usize];
                through[i] *= 1.0 - self.look.materials[part as usize].opacity;
                if through[i] < LEAST {
                    (through[i], valid.0[i]) = (0.0, 0);
                }
                all.rays.tnear[i] = all.rays.tfar[i] + leave;
                all.rays.tfar[i] = far[i];
            }
            all.hits = NO_HITS;
        }
        through
    }

    /// The buffers of the first surface.
    fn write(
        &self,
        camera: &Rays,
        at: (u32, u32),
        all: &RtcRayHits<N>,
        met: &[bool; N],
        s: &Surfaces,
        picture: &mut Picture,
    ) {
        let none = outcrop::query::NONE;
        for i in 0..N {
            let pixel = pixel(camera, at, i);
            let t = if met[i] { all.rays.tfar[i] } else { f32::INFINITY };
            if let Some(depth) = picture.depths.get_mut(pixel) {
                *depth = if met[i] { t * get(&all.rays.dir, i).dot(camera.forward) } else { t };
            }
            if let Some(normal) = picture.normals.get_mut(pixel) {
                *normal = if met[i] { get(&s.normal, i).to_array() } else { [0.0; 3] };
            }
            if let Some(part) = picture.parts.get_mut(pixel) {
                let of = |prim: u32| self.look.ids[self.look.parts[prim as usize] as usize];
                *part = if met[i] { of(all.hits.prim[i]) } else { none };
            }
            if let Some(instance) = picture.instances.get_mut(pixel) {
                let of = |instance: u32| if self.look.turns.is_empty() { 1 } else { u64::from(instance) + 1 };
                *instance = if met[i] { of(all.hits.instance[i]) } else { none };
            }
            if let Some(prim) = picture.prims.get_mut(pixel) {
                *prim = if met[i] { u64::from(all.hits.prim[i]) } else { none };
            }
            if let Some(error) = picture.errors.get_mut(pixel) {
                *error = f32::INFINITY;
            }
            if let Some(kind) = picture.kinds.get_mut(pixel) {
                *kind = u8::from(met[i]);
            }
        }
    }

    /// Light and background as bytes: highlights roll off as in outcrop's pictures, levels are dithered.
    fn code(&self, camera: &Rays, at: (u32, u32), sum: &Vectors, through: &Row, picture: &mut Picture) {
        let (mut rows, mut offsets, mut coded) = ([[0.0; N]; 4], [0.0; N], [[0; 4]; N]);
        for i in 0..N {
            let cover = 1.0 - through[i];
            for axis in 0..3 {
                let linear = sum[axis][i] + through[i] * self.look.background[axis];
                let above = (linear - 0.8).max(0.0);
                let rolled = if above > 0.0 { 0.8 + above / (1.0 + above * 5.0) } else { linear };
                rows[axis][i] = linear + cover * (rolled - linear);
            }
            rows[3][i] = cover + through[i] * self.look.background[3];
            offsets[i] = dither(at.0 + i as u32 % TILE, at.1 + i as u32 / TILE);
        }
        self.srgb.pixels(&rows, &offsets, &mut coded);
        for (row, pixels) in coded.chunks_exact(TILE as usize).enumerate() {
            let first = pixel(camera, at, row * TILE as usize);
            picture.colours[first..first + TILE as usize].copy_from_slice(pixels);
        }
    }
}

const NO_HITS: RtcHits<N> =
    RtcHits { normal: [[0.0; N]; 3], uv: [[0.0; N]; 2], prim: [NONE; N], geometry: [NONE; N], instance: [NONE; N] };

fn pixel(camera: &Rays, at: (u32, u32), i: usize) -> usize {
    ((at.1 + i as u32 / TILE) * camera.size.0 + at.0 + i as u32 % TILE) as usize
}

/// Each raised to its own power, by squaring.
fn powers(x: &Row, exponent: &[u32; N]) -> Row {
    let (mut all, mut square) = ([1.0; N], *x);
    let most = exponent.iter().fold(0, |all, e| all | e);
    for bit in 0..u32::BITS - most.leading_zeros() {
        for i in 0..N {
            all[i] *= if exponent[i] >> bit & 1 == 1 { square[i] } else { 1.0 };
            square[i] *= square[i];
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_those_of_the_library() {
        let x: Row = std::array::from_fn(|i| 0.9 + 0.005 * i as f32);
        let exponent = std::array::from_fn(|i| 1 + 37 * i as u32);
        for (i, power) in powers(&x, &exponent).into_iter().enumerate() {
            assert!((power / x[i].powi(exponent[i] as i32) - 1.0).abs() < 1e-4);
        }
    }
}
