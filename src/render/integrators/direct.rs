//! Direct light: headlights, point lights and directional lights. Rays continue behind transparent surfaces.
#![allow(clippy::needless_range_loop)] // each loop indexes several arrays

use super::Colours;
use super::first::{First, Layer};
use super::material::Material;
use super::plain::{self, Plain};
use super::sampling::{Widths, offset};
use super::shading::Shading;
use super::surface::Surface;
use crate::math::PACKET;
use crate::math::bits;
use crate::math::srgb::Srgb;
use crate::math::{Cone, Ray};
use crate::query::NONE;
use crate::query::stand_in;
use crate::render::tone::Tone;
use crate::render::wants::Wants;
use crate::scene::camera::PixelRays;
use crate::scene::light::LightKind;
use crate::scene::packet::ScenePacket;
use crate::scene::placed::Placed;
use crate::scene::walk::{Found, Need, SceneView, Step};
use crate::scene::{Alike, Group};
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::Triangle;
use glam::{DVec2, Vec3};

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
    /// Part and instance ids.
    pub ids: bool,
    /// Primitive ids.
    pub prims: bool,
    /// Depth and error of triangles in double precision. If false, triangles count as exact.
    pub precise: bool,
    pub normals: bool,
}

/// A worker's memory, and the first surfaces in the pixels of its packet.
pub(crate) struct Scratch {
    // Each in memory of its own, so that a new one takes little of the stack.
    camera: Box<ScenePacket>,
    pub(super) group: Group,
    pub(super) plain: Plain,
    pub(super) shading: Box<Shading>,
    found: [Found; PACKET],
    /// Surfaces of the present layer, while no packet uses them.
    surfaces: Option<Box<[Option<Surface>; PACKET]>>,
    pub(super) shadow: Box<ScenePacket>,
    pub wants: Wants,
    pub first: First,
}

impl Scratch {
    pub fn new() -> Self {
        Self {
            camera: Box::default(),
            group: Group::default(),
            plain: Plain::default(),
            shading: Box::default(),
            found: [Found::nothing(0.0); PACKET],
            surfaces: None,
            shadow: Box::default(),
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
    /// True if packets may be plain: see [`super::plain::is_plain`].
    pub plain: bool,
    /// True if directions in single precision are too coarse for trees that are far away. Packets are then not plain.
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

/// Rays of a packet, with the colour of each so far.
struct Lanes {
    rays: [Ray; PACKET],
    colour: [Vec3; PACKET],
    /// Transmittance up to the next surface.
    through: [f32; PACKET],
    /// Parts of the rays' directions that single precision has lost, if they matter.
    rest: Option<Box<[Vec3; PACKET]>>,
}

/// Rays of a packet that begin shortly before their hits.
struct Near {
    rays: [Ray; PACKET],
    /// Distance from the origin of each ray to that of its camera ray.
    ahead: [f64; PACKET],
}

impl Lanes {
    /// Moves the origins of the rays in `active` close to their hits, with all digits of their directions. The
    /// distances in `found` then count from there. `None` if directions are exact.
    fn near(&self, view: &SceneView, found: &mut [Found; PACKET], active: u32) -> Option<Box<Near>> {
        let rest = self.rest.as_ref()?;
        let mut near = Box::new(Near { rays: self.rays, ahead: [0.0; PACKET] });
        for i in bits(active) {
            let placed = &view.scene.placement.placed[found[i].placed as usize];
            let ray = &mut near.rays[i];
            let ahead = (found[i].t - placed.extent()).max(0.0);
            ray.origin += (ray.dir.as_dvec3() + rest[i].as_dvec3()) * ahead;
            ray.cone.a += ray.cone.b * ahead as f32;
            ray.t_min -= ahead;
            found[i].t -= ahead;
            near.ahead[i] = ahead;
        }
        Some(near)
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
        if self.is_empty(pixels) {
            if pixels.sample == 0 {
                scratch.first = First::NOTHING;
            }
            self.add(sums, &rows_of(&backs));
            return Ok(());
        }
        let met = match self.plain(pixels, active, &backs, number, scratch) {
            plain::Outcome::Done => {
                self.add(sums, scratch.plain.light());
                return Ok(());
            }
            plain::Outcome::Met(met) => Some(met),
            plain::Outcome::NotPlain => None,
        };
        let mut lanes = Lanes {
            rays: [Ray::NONE; PACKET],
            colour: [Vec3::ZERO; PACKET],
            through: [1.0; PACKET],
            rest: self.is_fine.then(|| Box::new([Vec3::ZERO; PACKET])),
        };
        for i in bits(active) {
            let ((x, y), wide) = (pixels.point(i), pixels.width(pixels.step(i)));
            let mut ray = self.rays.ray(x, y);
            ray.cone = Cone { a: ray.cone.a * wide, b: ray.cone.b * wide };
            lanes.rays[i] = ray;
            if let Some(rest) = &mut lanes.rest {
                rest[i] = self.rays.rest(x, y);
            }
        }
        self.layers(&mut lanes, active, met, pixels.sample == 0, scratch)?;
        let mut all = [[0.0; PACKET]; 5];
        for i in bits(active) {
            let back = backs[i / ACROSS as usize];
            let (through, c) = (lanes.through[i], lanes.colour[i]);
            for axis in 0..3 {
                all[axis][i] = c[axis] + through * back[axis];
            }
            all[3][i] = 1.0 - through + through * back[3];
            all[4][i] = 1.0 - through;
        }
        self.add(sums, &all);
        Ok(())
    }

    /// Returns the pixels of a packet at `at`, with distances `apart`, for a sample. Sample 0 goes through the pixel's
    /// centre and determines the first surface. All samples have the same weight in the colour.
    pub fn pixels(&self, at: (u32, u32), apart: (u32, u32), sample: u32) -> Pixels {
        Pixels { at, apart, offset: offset(sample), sample, widths: Widths::of(self.poe) }
    }

    /// Adds colours to sums: see [`Add`].
    fn add(&self, sums: &mut Colours, colours: &Colours) {
        dispatch(self.isa(), Add { sums, colours });
    }

    /// True if the rectangle of all hits does not overlap the pixels of a packet.
    pub(super) fn is_empty(&self, &Pixels { at, apart, .. }: &Pixels) -> bool {
        let Some([least, greatest]) = self.within else { return false };
        let first = DVec2::new(at.0.into(), at.1.into());
        let last = first + DVec2::new(f64::from(apart.0 * (ACROSS - 1) + 1), f64::from(apart.1 * (DOWN - 1) + 1));
        // Comparisons with NaN are false, so such a packet does not count as empty.
        last.x < least.x || last.y < least.y || first.x > greatest.x || first.y > greatest.y
    }

    /// Adds the light of surfaces, front to back, until no light is transmitted.
    ///
    /// `met`: mask of the rays with a hit, if they were traced already. The hits are in the scratch's `group`.
    fn layers(
        &self,
        lanes: &mut Lanes,
        mut active: u32,
        met: Option<u32>,
        first: bool,
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        if first {
            scratch.first = First::NOTHING;
        }
        // Rays without a surface so far.
        let mut fresh = active;
        for layer in 0..MAX_LAYERS {
            if active == 0 {
                break;
            }
            let (hits, transmitted) = match met.filter(|_| layer == 0) {
                Some(met) => self.found_together(met, scratch),
                None => self.trace(lanes, active, layer == 0, scratch)?,
            };
            if first && layer == 0 {
                scratch.first.transmitted = transmitted & active;
            }
            active &= hits;
            if active == 0 {
                break;
            }
            let mut surfaces = scratch.surfaces.take().unwrap_or_else(|| Box::new([const { None }; PACKET]));
            surfaces.fill_with(|| None);
            let Scratch { found, wants, first: seen, .. } = &mut *scratch;
            stand_in::ask_for(&self.view, found, active);
            let near = lanes.near(&self.view, found, active);
            let rays = near.as_ref().map_or(&lanes.rays, |near| &near.rays);
            let ahead = |i: usize| near.as_ref().map_or(0.0, |near| near.ahead[i]);
            for i in bits(active) {
                let is_first = first && fresh >> i & 1 == 1;
                let mut noted = Layer::MISS;
                let note = is_first.then_some(&mut noted);
                surfaces[i] = self.surface(&rays[i], ahead(i), &found[i], note, wants)?;
                if is_first && surfaces[i].is_some() {
                    seen.set(i, &noted);
                    fresh &= !(1 << i);
                }
            }
            self.light(&lanes.rays, &surfaces, active, scratch)?;
            let surfaces = &*scratch.surfaces.insert(surfaces);
            for i in bits(active) {
                let Some(surface) = &surfaces[i] else {
                    let found = &scratch.found[i];
                    let extent = self.view.scene.placement.placed[found.placed as usize].extent();
                    lanes.rays[i].t_min = found.t + extent * LEAVE;
                    continue;
                };
                let opacity = surface.material.opacity;
                lanes.colour[i] += scratch.shading.light(i) * (lanes.through[i] * opacity);
                lanes.through[i] *= 1.0 - opacity;
                lanes.rays[i].t_min = surface.next + ahead(i);
                if lanes.through[i] < LEAST_TRANSMITTANCE {
                    lanes.through[i] = 0.0;
                    active &= !(1 << i);
                }
            }
        }
        Ok(())
    }

    /// Traces rays. Returns the mask of those with a hit and the mask of those that stand-ins transmitted before, for
    /// `active` rays and perhaps others. `all`: most rays are active.
    fn trace(&self, lanes: &Lanes, active: u32, all: bool, scratch: &mut Scratch) -> Result<(u32, u32), Need> {
        let (Scratch { camera, group, found, .. }, Lanes { rays, rest, .. }) = (&mut *scratch, lanes);
        let together = if all && rest.is_none() {
            group.trace::<false>(&self.view, rays, PACKET, &Alike::of(rays), true)
        } else {
            None
        };
        if let Some(hits) = together {
            let hits = hits?;
            return Ok(self.found_together(hits, scratch));
        }
        camera.begin_fine(&self.view, rays, rest.as_deref(), active);
        if let Step::Pending(need) = self.view.trace_packet::<false>(rays, camera) {
            return Err(need);
        }
        let (mut hits, mut transmitted) = (0, 0);
        for i in bits(active) {
            found[i] = *camera.best(i);
            hits |= u32::from(found[i].is_hit()) << i;
            transmitted |= u32::from(found[i].has_transmitted()) << i;
        }
        Ok((hits, transmitted))
    }

    /// Copies the hits of a packet from `group` to `found`. Returns the masks as [`Self::trace`] does.
    fn found_together(&self, hits: u32, scratch: &mut Scratch) -> (u32, u32) {
        for i in bits(hits) {
            scratch.found[i] = scratch.group.found(i, true);
        }
        (hits, scratch.group.have_transmitted())
    }

    /// Depth of the point at distance `t` from the eye.
    pub(super) fn depth(&self, ray: &Ray, t: f64) -> f32 {
        (ray.dir.as_dvec3() * t).dot(self.rays.forward()) as f32
    }

    /// Returns the caller's ids of a part and its instance.
    pub(super) fn ids(&self, placed: u32, part: u32) -> (u64, u64) {
        let scene = self.view.scene;
        let instance = scene.placement.placed[placed as usize].instance;
        let id = self.view.model_of(placed).parts().id(part as usize).unwrap_or(NONE);
        (id, scene.instances[instance as usize].id)
    }

    /// Converts a stand-in's error at distance `t` from world units to pixels.
    #[inline]
    pub(super) fn in_pixels(&self, error: f32, t: f64) -> f32 {
        error / (self.rays.pixel_width(t).max(f64::MIN_POSITIVE) as f32)
    }

    /// True if a light may cast shadows.
    pub(super) fn casts(&self) -> bool {
        self.view.scene.lights.iter().any(|light| light.kind != LightKind::Headlight)
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
    pub(super) fn recoloured(&self, placed: u32, part: u32) -> bool {
        let p = &self.view.scene.placement.placed[placed as usize];
        let instance = &self.view.scene.instances[p.instance as usize];
        instance.look.colour.is_some() || instance.parts.looks.coloured.get(&part).is_some_and(|s| s.colour.is_some())
    }

    /// Returns the part's material, under the states of part and instance. `own` returns the hit's own colour.
    pub(super) fn material(
        &self,
        placed: u32,
        part: u32,
        own: impl FnOnce() -> Result<Option<Vec3>, Need>,
    ) -> Result<Material, Need> {
        let p = &self.view.scene.placement.placed[placed as usize];
        let instance = &self.view.scene.instances[p.instance as usize];
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
        match state.and_then(|s| s.colour).or(instance.look.colour) {
            Some([r, g, b, a]) => (material.colour, material.opacity) = (Vec3::new(r, g, b), a),
            None => {
                if let Some(colour) = own()? {
                    material.colour = colour;
                }
            }
        }
        let selected = instance.look.selected || state.is_some_and(|s| s.selected);
        Ok(if selected { material.selected() } else { material })
    }
}

/// True if the plane of a triangle goes through the origin of a ray that hits it, up to [`AT_EYE`]. The answer
/// is the same for all rays from there.
pub fn is_at_origin(placed: &Placed, triangle: &Triangle, ray: &Ray) -> bool {
    let org = placed.local_point(ray.origin);
    let [a, b, c] = triangle.vertices.map(|v| v.as_dvec3());
    let size = a.abs().max(b.abs()).max(c.abs()).max(org.abs()).max_element();
    let normal = (b - a).cross(c - a);
    normal.dot(a - org).abs() <= AT_EYE * size * normal.length()
}

/// Expands the background of each row to all pixels of a packet.
pub(super) fn rows_of(backs: &[[f32; 4]; DOWN as usize]) -> Colours {
    let mut rows = [[0.0; PACKET]; 5];
    for (row, back) in backs.iter().enumerate() {
        for (all, back) in rows.iter_mut().zip(back) {
            all[row * ACROSS as usize..][..ACROSS as usize].fill(*back);
        }
    }
    rows
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
