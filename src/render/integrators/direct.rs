//! Direct light: headlights, point lights and directional lights. Rays continue behind transparent surfaces.
#![allow(clippy::needless_range_loop)] // each loop indexes several arrays

use super::Colours;
use super::camera::Begun;
use super::first::First;
use super::material::Material;
use super::rays::CameraPacket;
use super::sampling::{Widths, offset};
use super::shading::{Row, Shading, Vectors};
use super::surfaces::Surfaces;
use crate::math::srgb::Srgb;
use crate::math::{DBounds, PACKET, bits};
use crate::query::answers::Seen;
use crate::query::{NONE, stand_in};
use crate::render::tone::Tone;
use crate::render::wants::Wants;
use crate::scene::Group;
use crate::scene::camera::PixelRays;
use crate::scene::packet::ScenePacket;
use crate::scene::placed::Placed;
use crate::scene::walk::{Found, HitTree, Need, SceneView};
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::{DVec2, DVec3, Vec3};

/// Number of pixels in a row of a packet.
pub(crate) const ACROSS: u32 = 8;
/// Number of rows of a packet.
pub(crate) const DOWN: u32 = PACKET as u32 / ACROSS;
/// Greatest number of transparent surfaces on a ray. Everything behind counts as background.
pub(super) const MAX_LAYERS: usize = 32;
/// Replacement for colours that overflow.
const BRIGHTEST: f32 = 65504.0;
/// Transmittance below which further surfaces are ignored.
pub(super) const LEAST_TRANSMITTANCE: f32 = 1.0 / 512.0;
/// Offset of rays that leave a surface, as a fraction of the tree's extent: 32 times the greatest distance that single
/// precision may put between a computed point of the surface and the surface (2⁻²⁴ of twice the extent).
pub const LEAVE: f64 = 1.0 / 262_144.0;

/// Distance of a triangle's plane from the eye below which the triangle is not visible, as a fraction of the greatest
/// coordinate of either in the tree's frame. Single precision cannot tell for each pixel alike if such a triangle, for
/// example of the floor that the eye is on, is before the eye. The distance is 16 roundings.
pub(super) const AT_EYE: f64 = 1.0 / 1_048_576.0;

/// The requested buffers of the first surface. Others are not computed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asks {
    /// Part and instance ids, and occurrences.
    pub ids: bool,
    /// Primitive ids.
    pub prims: bool,
    /// Depth and error of triangles in double precision. If false, triangles count as exact.
    pub precise: bool,
    pub normals: bool,
    /// Weights of triangles' corners in double precision, or the parameters of surfaces.
    pub uvs: bool,
}

/// A worker's memory, and the first surfaces in the pixels of its packet.
pub(crate) struct Scratch {
    // Each in memory of its own, so that a new one takes little of the stack.
    pub(super) rays: Box<CameraPacket>,
    /// Parts of the rays' directions that single precision has lost, if they matter.
    pub(super) rest: Option<Box<[Vec3; PACKET]>>,
    pub(super) begun: Begun,
    pub(super) packet: Box<ScenePacket>,
    pub(super) group: Box<Group>,
    pub(super) found: Box<[Found; PACKET]>,
    pub(super) seen: Box<Seen<PACKET>>,
    pub(super) surfaces: Box<Surfaces>,
    pub(super) shading: Box<Shading>,
    pub(super) shadow: Box<Group>,
    light: Box<Light>,
    pub wants: Wants,
    pub first: First,
}

/// Light of a packet's pixels.
#[repr(C, align(64))]
struct Light {
    colour: Vectors,
    /// Transmittance up to the next surface.
    through: Row<f32>,
    all: Colours,
}

/// Returns a default value in memory of its own. It is not inlined: the values, of many kilobytes each, are made on the
/// stack first, and there one takes the place of the other.
#[inline(never)]
fn boxed<T: Default>() -> Box<T> {
    Box::default()
}

impl Scratch {
    #[inline(never)] // as `boxed`
    pub fn new() -> Self {
        Self {
            rays: Box::new(CameraPacket::NONE),
            rest: None,
            begun: Begun::default(),
            packet: boxed(),
            group: boxed(),
            found: Box::new([Found::nothing(0.0); PACKET]),
            seen: boxed(),
            surfaces: boxed(),
            shading: boxed(),
            shadow: boxed(),
            light: Box::new(Light { colour: [[0.0; PACKET]; 3], through: [1.0; PACKET], all: [[0.0; PACKET]; 5] }),
            wants: Wants::default(),
            first: First::NOTHING,
        }
    }
}

/// Renderer of packets of [`ACROSS`] by [`DOWN`] pixels of one picture.
pub(crate) struct Direct<'a> {
    pub view: SceneView<'a>,
    pub rays: &'a PixelRays,
    pub size: (u32, u32),
    pub samples: u32,
    pub ambient: f32,
    /// Threshold in pixels of error; 0: exact.
    pub poe: f32,
    /// True if `poe` is above the requested threshold because the visible data does not fit the budget.
    pub is_pressed: bool,
    pub srgb: &'a Srgb,
    pub tone: Tone,
    pub asks: Asks,
    /// True if a light may cast shadows.
    pub casts: bool,
    /// True if directions in single precision are too coarse for trees that are far away.
    pub is_fine: bool,
    /// Corners of a rectangle in the picture that contains all hits, if known.
    pub within: Option<[DVec2; 2]>,
}

/// The pixels of a packet, for one sample.
#[derive(Clone, Copy)]
pub(crate) struct Pixels {
    /// First pixel.
    at: (u32, u32),
    /// Distances between pixels.
    apart: (u32, u32),
    /// Position of each ray within its pixel.
    offset: (f64, f64),
    pub sample: u32,
    widths: Widths,
}

impl Pixels {
    /// Returns the pixel of ray `i`.
    #[inline(always)]
    fn pixel(&self, i: usize) -> (u32, u32) {
        (self.at.0 + i as u32 % ACROSS * self.apart.0, self.at.1 + i as u32 / ACROSS * self.apart.1)
    }

    /// Returns the point of the picture that ray `i` goes through.
    #[inline(always)]
    pub fn point(&self, i: usize) -> (f64, f64) {
        let (x, y) = self.pixel(i);
        (f64::from(x) + self.offset.0, f64::from(y) + self.offset.1)
    }

    /// Returns the step of ray `i`'s width within the octave: see [`Widths::step`].
    #[inline(always)]
    pub fn step(&self, i: usize) -> u32 {
        let (x, y) = self.pixel(i);
        Widths::step(x, y, self.sample)
    }

    /// Returns the factor for the width of a ray at a step.
    #[inline(always)]
    pub fn width(&self, step: u32) -> f32 {
        self.widths.factor(step)
    }
}

impl Direct<'_> {
    /// Instruction set for packets.
    pub fn isa(&self) -> Isa {
        self.view.scene.context().isa()
    }

    /// Renders a sample of the pixels in `active`: adds their light to `sums` and, for sample 0, stores their first
    /// surfaces in `scratch`. `number`: index of the packet in its tile, if that was [begun](Self::begin).
    pub fn packet(
        &self,
        pixels: &Pixels,
        active: u32,
        number: Option<usize>,
        sums: &mut Colours,
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        let mut backs = [[0.0; 4]; DOWN as usize];
        for (row, back) in backs.iter_mut().enumerate() {
            let height = 1.0 - pixels.point(row * ACROSS as usize).1 as f32 / self.size.1 as f32;
            *back = self.view.scene.background.at(height);
        }
        if pixels.sample == 0 {
            scratch.first.clear(self.asks);
        }
        (scratch.light.colour, scratch.light.through) = ([[0.0; PACKET]; 3], [1.0; PACKET]);
        if !self.is_empty(pixels) {
            self.layers(pixels, active, number, scratch)?;
        }
        let Light { colour, through, all } = &mut *scratch.light;
        dispatch(self.isa(), Over { colour, through, backs: &backs, all });
        dispatch(self.isa(), Add { sums, colours: all });
        Ok(())
    }

    /// Returns the pixels of a packet at `at`, with distances `apart`, for a sample. Sample 0 goes through the pixel's
    /// centre and determines the first surface. All samples have the same weight in the colour.
    pub fn pixels(&self, at: (u32, u32), apart: (u32, u32), sample: u32) -> Pixels {
        Pixels { at, apart, offset: offset(sample), sample, widths: Widths::of(self.poe) }
    }

    /// True if the rectangle of all hits does not overlap the pixels of a packet.
    pub(super) fn is_empty(&self, &Pixels { at, apart, .. }: &Pixels) -> bool {
        let Some([least, greatest]) = self.within else { return false };
        let first = DVec2::new(at.0.into(), at.1.into());
        let last = first + DVec2::new(f64::from(apart.0 * (ACROSS - 1) + 1), f64::from(apart.1 * (DOWN - 1) + 1));
        // Comparisons with NaN are false, so such a packet does not count as empty.
        last.x < least.x || last.y < least.y || first.x > greatest.x || first.y > greatest.y
    }

    /// Sums the light of surfaces, front to back, until no light is transmitted.
    fn layers(
        &self,
        pixels: &Pixels,
        mut active: u32,
        number: Option<usize>,
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        scratch.rest = None;
        let mut met = self.trace_first(pixels, active, number, scratch)?;
        // Pixels without a surface so far that store their first.
        let mut fresh = if pixels.sample == 0 { active } else { 0 };
        scratch.first.behind_cells |= met.behind_cells & fresh;
        for layer in 0..MAX_LAYERS {
            if layer > 0 {
                met = self.trace(active, scratch)?;
            }
            active &= met.rays;
            if active == 0 {
                break;
            }
            if met.only.is_none() {
                stand_in::ask_for(&self.view, &scratch.found[..], active);
            }
            self.surfaces(met, active, fresh & active, scratch)?;
            fresh &= !scratch.surfaces.met;
            self.light(scratch)?;
            let Scratch { surfaces, shading, light, rays, .. } = &mut *scratch;
            let Light { colour, through, .. } = &mut **light;
            shading.put(self.isa(), surfaces.met, &surfaces.opacity, through, colour);
            let mut left = surfaces.at_origin;
            for i in bits(surfaces.met) {
                let is_through = through[i] >= LEAST_TRANSMITTANCE;
                through[i] = if is_through { through[i] } else { 0.0 };
                left |= u32::from(is_through) << i;
            }
            active &= left;
            bits(active).for_each(|i| rays.go_on(i, surfaces.next[i]));
        }
        Ok(())
    }

    /// Depth of the point at distance `t` from the eye.
    pub(super) fn depth(&self, dir: Vec3, t: f64) -> f32 {
        (dir.as_dvec3() * t).dot(self.rays.forward()) as f32
    }

    /// Returns the caller's ids of a part and its instance, and the number of the placed tree.
    pub(super) fn ids(&self, tree: HitTree, part: u32) -> [u64; 3] {
        let (scene, (placed, part)) = (self.view.scene, self.view.shown_by(tree, part));
        let instance = scene.ids_of(placed).instance;
        let id = self.view.model_of(placed).parts().id(part as usize).unwrap_or(NONE);
        [id, scene.instance_id(instance), placed]
    }

    /// Converts a stand-in's error at distance `t` from world units to pixels.
    #[inline]
    pub(super) fn in_pixels(&self, error: f32, t: f64) -> f32 {
        error / (self.rays.pixel_width(t).max(f64::MIN_POSITIVE) as f32)
    }

    /// Handles a missing block with a triangle's id, colours or normals. If missing data is accepted, wants the block,
    /// and the pixel is rendered without; otherwise fails with the block.
    pub(super) fn later(&self, need: Need, wants: &mut Wants) -> Result<(), Need> {
        if !self.view.accept_missing {
            return Err(need);
        }
        wants.add(need, 1.0);
        Ok(())
    }

    /// True if a part or its instance overrides the part's colour.
    pub(super) fn recoloured(&self, tree: HitTree, part: u32) -> bool {
        let (placed, part) = self.view.shown_by(tree, part);
        let p = self.view.scene.ids_of(placed);
        let instance = self.view.scene.state_of(p.instance);
        instance.look.colour.is_some() || instance.parts.looks.coloured.get(&part).is_some_and(|s| s.colour.is_some())
    }

    /// Returns the part's material, under the states of part and instance, and true if it is selected.
    pub(super) fn material(&self, tree: HitTree, part: u32) -> (Material, bool) {
        let (placed, part) = self.view.shown_by(tree, part);
        let p = self.view.scene.ids_of(placed);
        let instance = self.view.scene.state_of(p.instance);
        let info = self.view.model_of(placed).parts().get(part as usize);
        let state = instance.parts.looks.coloured.get(&part);
        let [r, g, b, a] = info.map_or([0.6, 0.6, 0.6, 1.0], |i| i.colour);
        let mut material = Material {
            colour: Vec3::new(r, g, b),
            opacity: a,
            metalness: info.map_or(0.0, |i| i.metalness),
            roughness: info.map_or(0.6, |i| i.roughness),
            glow: Vec3::ZERO,
        };
        if let Some([r, g, b, a]) = state.and_then(|s| s.colour).or(instance.look.colour) {
            (material.colour, material.opacity) = (Vec3::new(r, g, b), a);
        } else if let Some(tint) = self.view.tint(tree) {
            material.colour *= tint.truncate();
            material.opacity *= tint.w;
        }
        let is_selected = instance.look.selected || state.is_some_and(|s| s.selected);
        (if is_selected { material.selected() } else { material }, is_selected)
    }
}

/// Greatest distance of the origin of a ray from the plane of a triangle in a placed tree, and from the tree's bounds,
/// at which [`is_at_origin`] may be true.
pub(super) fn may_be_at_origin(placed: &Placed) -> f64 {
    // Coordinates are within the tree's extent, or a few of it; and cosines have roundings of their own.
    4.0 * AT_EYE * placed.extent()
}

/// True if the plane of a triangle goes through the origin of a ray that hits it, up to [`AT_EYE`]. The answer is the
/// same for all rays from there. From outside of the tree's bounds every plane is before the origin or behind it.
pub fn is_at_origin(placed: &Placed, corners: &[Vec3; 3], origin: DVec3) -> bool {
    let around = may_be_at_origin(placed);
    if !placed.bounds.overlaps(&DBounds { min: origin - around, max: origin + around }) {
        return false;
    }
    let org = placed.local_point(origin);
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let size = a.abs().max(b.abs()).max(c.abs()).max(org.abs()).max_element();
    let normal = (b - a).cross(c - a);
    normal.dot(a - org).abs() <= AT_EYE * size * normal.length()
}

/// Puts the light of surfaces over the background of each row of pixels.
struct Over<'a> {
    colour: &'a Vectors,
    through: &'a Row<f32>,
    backs: &'a [[f32; 4]; DOWN as usize],
    all: &'a mut Colours,
}

impl Op for Over<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { colour, through, backs, all } = self;
        for (row, back) in backs.iter().enumerate() {
            for i in row * ACROSS as usize..(row + 1) * ACROSS as usize {
                let behind = |back: f32| if through[i] == 0.0 { 0.0 } else { through[i] * back };
                for axis in 0..3 {
                    all[axis][i] = colour[axis][i] + behind(back[axis]);
                }
                all[3][i] = 1.0 - through[i] + behind(back[3]);
                all[4][i] = 1.0 - through[i];
            }
        }
    }
}

/// Adds the colours of a sample.
struct Add<'a> {
    sums: &'a mut Colours,
    colours: &'a Colours,
}

impl Op for Add<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { sums, colours } = self;
        for c in 0..5 {
            for i in 0..PACKET {
                let colour = colours[c][i];
                // Infinite colours, for example from squares of huge lights, are replaced here.
                sums[c][i] += if colour.is_finite() { colour } else { BRIGHTEST };
            }
        }
    }
}
