//! Direct light: headlights, points, directions; layers of transparent surfaces by continuing the ray.
#![allow(clippy::needless_range_loop)] // rows of several arrays at once

use super::first::{First, Layer};
use super::material::Material;
use super::plain::{self, Plain};
use super::sampling::{Widths, offset};
use super::shading::Shading;
use super::surface::{BESIDE, DIAGONAL, Surface, back, width_at};
use crate::lod::Facing;
use crate::math::PACKET;
use crate::math::bits;
use crate::math::srgb::Srgb;
use crate::math::{Cone, Ray};
use crate::query::answers::{WorldNormal, meet};
use crate::query::stand_in::{self, Look};
use crate::query::{HitKind, NONE};
use crate::render::wants::Wants;
use crate::scene::camera::PixelRays;
use crate::scene::light::LightKind;
use crate::scene::packet::ScenePacket;
use crate::scene::walk::{Found, Need, SceneView, Step};
use crate::scene::{Alike, Group};
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::Triangle;
use glam::{DVec2, Vec3};

/// Pixels of a packet, along its rows and its columns.
pub(crate) const ACROSS: u32 = 8;
/// See [`ACROSS`].
pub(crate) const DOWN: u32 = PACKET as u32 / ACROSS;
/// Transparent surfaces that a ray goes through at most; what is behind counts as background.
pub(super) const MAX_LAYERS: usize = 32;
/// In place of what overflows.
const BRIGHTEST: f32 = 65504.0;
/// What is let through less than this is not looked at.
pub(super) const LEAST_TRANSMITTANCE: f32 = 1.0 / 512.0;
/// Offset of rays that leave a surface, as a share of its tree's reach: 32 times what single precision may put
/// between a point of a surface and the surface (2⁻²⁴ of twice the reach).
pub(super) const LEAVE: f64 = 1.0 / 262_144.0;

/// The buffers of the first surface that are asked for. The others are not worked out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asks {
    /// Part and instance.
    pub ids: bool,
    /// Primitive ids.
    pub prims: bool,
    /// Depth and error of triangles in double precision; without, they count as exact.
    pub precise: bool,
    pub normals: bool,
}

/// Memory of a worker, and the pixels of its packet.
pub(crate) struct Scratch {
    camera: ScenePacket,
    pub(super) group: Group,
    pub(super) plain: Plain,
    pub(super) shading: Shading,
    found: [Found; PACKET],
    pub(super) shadow: ScenePacket,
    pub wants: Wants,
    pub first: First,
}

impl Scratch {
    pub fn new() -> Self {
        Self {
            camera: ScenePacket::default(),
            group: Group::default(),
            plain: Plain::default(),
            shading: Shading::default(),
            found: [Found::nothing(0.0); PACKET],
            shadow: ScenePacket::default(),
            wants: Wants::default(),
            first: First::NOTHING,
        }
    }
}

/// What renders packets of [`ACROSS`] by [`DOWN`] pixels of one picture.
pub(crate) struct Direct<'a> {
    pub view: SceneView<'a>,
    pub rays: &'a PixelRays,
    pub size: (u32, u32),
    pub samples: u32,
    pub ambient: f32,
    /// Pixels of error; 0 asks for exact answers.
    pub poe: f32,
    /// They are more than was asked for: what is seen does not fit the budget.
    pub is_pressed: bool,
    pub srgb: &'a Srgb,
    pub asks: Asks,
    /// See [`super::plain::is_plain`].
    pub plain: bool,
    /// Beyond these points of the picture nothing is seen; if that is known.
    pub within: Option<[DVec2; 2]>,
}

/// The pixels of a packet, in one sample.
#[derive(Clone, Copy)]
pub(crate) struct Pixels {
    /// The first.
    at: (u32, u32),
    /// How far apart they are.
    apart: (u32, u32),
    /// Where in its pixel each ray goes through.
    offset: (f64, f64),
    pub sample: u32,
    widths: Widths,
}

impl Pixels {
    /// That of ray `i`.
    #[inline(always)]
    fn pixel(&self, i: usize) -> (u32, u32) {
        (self.at.0 + i as u32 % ACROSS * self.apart.0, self.at.1 + i as u32 / ACROSS * self.apart.1)
    }

    /// The point of the picture that ray `i` goes through.
    #[inline(always)]
    pub fn point(&self, i: usize) -> (f64, f64) {
        let (x, y) = self.pixel(i);
        (f64::from(x) + self.offset.0, f64::from(y) + self.offset.1)
    }

    /// Which step of an octave the width of ray `i` is at.
    #[inline(always)]
    pub fn step(&self, i: usize) -> u32 {
        let (x, y) = self.pixel(i);
        Widths::step(x, y, self.sample)
    }

    /// What the width of a ray at a step is multiplied with.
    #[inline(always)]
    pub fn width(&self, step: u32) -> f32 {
        self.widths.factor(step)
    }
}

/// The colour of each ray so far.
struct Lanes {
    rays: [Ray; PACKET],
    colour: [Vec3; PACKET],
    /// What is let through to what comes next.
    through: [f32; PACKET],
}

impl Direct<'_> {
    /// What packets are worked out with.
    pub fn isa(&self) -> Isa {
        self.view.scene.context().isa()
    }

    /// Renders a sample of the pixels of `active`: adds their light to `sums`, and puts what is seen first there, of
    /// sample 0, into `scratch`. `number`: the packet's in its tile, if that was [begun](Self::begin).
    pub fn packet(
        &self,
        pixels: &Pixels,
        active: u32,
        number: Option<usize>,
        sums: &mut [[f32; PACKET]; 4],
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
        let mut lanes = Lanes { rays: [Ray::NONE; PACKET], colour: [Vec3::ZERO; PACKET], through: [1.0; PACKET] };
        for i in bits(active) {
            let ((x, y), wide) = (pixels.point(i), pixels.width(pixels.step(i)));
            let mut ray = self.rays.ray(x, y);
            ray.cone = Cone { a: ray.cone.a * wide, b: ray.cone.b * wide };
            lanes.rays[i] = ray;
        }
        self.layers(&mut lanes, active, met, pixels.sample == 0, scratch)?;
        let mut all = [[0.0; PACKET]; 4];
        for i in bits(active) {
            let back = backs[i / ACROSS as usize];
            let (through, c) = (lanes.through[i], lanes.colour[i]);
            for axis in 0..3 {
                all[axis][i] = c[axis] + through * back[axis];
            }
            all[3][i] = 1.0 - through + through * back[3];
        }
        self.add(sums, &all);
        Ok(())
    }

    /// The pixels of a packet at `at`, so far `apart`, in a sample. Sample 0 goes through the middle of the pixel and
    /// tells what is seen; all samples weigh the same in the colour.
    pub fn pixels(&self, at: (u32, u32), apart: (u32, u32), sample: u32) -> Pixels {
        Pixels { at, apart, offset: offset(sample), sample, widths: Widths::of(self.poe) }
    }

    /// See [`Add`].
    fn add(&self, sums: &mut [[f32; PACKET]; 4], colours: &[[f32; PACKET]; 4]) {
        dispatch(self.isa(), Add { sums, colours });
    }

    /// Whether nothing is seen in the block of a packet.
    pub(super) fn is_empty(&self, &Pixels { at, apart, .. }: &Pixels) -> bool {
        let Some([least, greatest]) = self.within else { return false };
        let first = DVec2::new(at.0.into(), at.1.into());
        let last = first + DVec2::new(f64::from(apart.0 * (ACROSS - 1) + 1), f64::from(apart.1 * (DOWN - 1) + 1));
        // Not so of what is not a number.
        last.x < least.x || last.y < least.y || first.x > greatest.x || first.y > greatest.y
    }

    /// Goes through surfaces, front to back, until nothing is let through.
    ///
    /// `met`: the rays that hit something, if they were traced already, in the scratch's `group`.
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
        for layer in 0..MAX_LAYERS {
            if active == 0 {
                break;
            }
            let (hits, transmitted) = match met.filter(|_| layer == 0) {
                Some(met) => self.found_together(met, scratch),
                None => self.trace(&lanes.rays, active, layer == 0, scratch)?,
            };
            if first && layer == 0 {
                scratch.first.transmitted = transmitted & active;
            }
            active &= hits;
            if active == 0 {
                break;
            }
            let mut surfaces: [Option<Surface>; PACKET] = std::array::from_fn(|_| None);
            let Scratch { found, wants, first: seen, .. } = &mut *scratch;
            stand_in::ask_for(&self.view, found, active);
            for i in bits(active) {
                let is_first = first && layer == 0;
                let mut noted = Layer::MISS;
                let note = is_first.then_some(&mut noted);
                surfaces[i] = Some(self.surface(&lanes.rays[i], &found[i], note, wants)?);
                if is_first {
                    seen.set(i, &noted);
                }
            }
            self.light(&lanes.rays, &surfaces, active, scratch)?;
            for i in bits(active) {
                let Some(surface) = &surfaces[i] else { continue };
                let opacity = surface.material.opacity;
                lanes.colour[i] += scratch.shading.light(i) * (lanes.through[i] * opacity);
                lanes.through[i] *= 1.0 - opacity;
                lanes.rays[i].t_min = surface.next;
                if lanes.through[i] < LEAST_TRANSMITTANCE {
                    lanes.through[i] = 0.0;
                    active &= !(1 << i);
                }
            }
        }
        Ok(())
    }

    /// Finds what rays hit; returns those that hit something and those that passed stand-ins before, of `active` and
    /// perhaps others. `all`: most of them are active.
    fn trace(&self, rays: &[Ray; PACKET], active: u32, all: bool, scratch: &mut Scratch) -> Result<(u32, u32), Need> {
        let Scratch { camera, group, found, .. } = scratch;
        let together = if all { group.trace::<false>(&self.view, rays, PACKET, &Alike::of(rays), true) } else { None };
        if let Some(hits) = together {
            let hits = hits?;
            return Ok(self.found_together(hits, scratch));
        }
        camera.begin(&self.view, rays, active);
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

    /// Takes over what the rays of `hits` were found to hit together; returns these, and those that passed stand-ins.
    fn found_together(&self, hits: u32, scratch: &mut Scratch) -> (u32, u32) {
        for i in bits(hits) {
            scratch.found[i] = scratch.group.found(i, true);
        }
        (hits, scratch.group.have_transmitted())
    }

    /// The surface that was found; and, if it is `seen` first, what is asked of that.
    fn surface(&self, ray: &Ray, found: &Found, seen: Option<&mut Layer>, wants: &mut Wants) -> Result<Surface, Need> {
        if let Some(look) = stand_in::look(&self.view, ray, found) {
            return self.stand_in(ray, found, &look, seen, wants);
        }
        let placed = &self.view.scene.placement.placed[found.placed as usize];
        let need = |block| Need { model: placed.model, block };
        let (triangle, part) = self.view.triangle(found)?;
        let tree = self.view.tree(found.placed);
        let normal = WorldNormal::new(placed, &triangle.vertices).facing(ray.dir);
        if let Some(seen) = seen {
            (seen.kind, seen.normal) = (HitKind::Exact, normal.into());
            if self.asks.precise {
                self.measure(ray, found, &triangle, seen);
            }
            if self.asks.ids {
                (seen.part, seen.instance) = self.ids(found.placed, part);
            }
            if self.asks.prims {
                seen.prim = match tree.prim(&found.tri) {
                    Ok(prim) => prim.map_or(NONE, u64::from),
                    Err(block) => self.later(need(block), wants).map(|()| NONE)?,
                };
            }
        }
        let own = || match tree.colour(&found.tri) {
            Ok(colour) => Ok(colour),
            Err(block) => self.later(need(block), wants).map(|()| None),
        };
        let material = self.material(found.placed, part, own)?;
        let leave = placed.extent() * LEAVE;
        let position = ray.origin + ray.dir.as_dvec3() * found.t;
        let width = width_at(ray, found.t);
        // Cells of the surface itself are beside it, and stand out. (Áfra 2012, section 6.2, begins behind them, in the
        // open; here what is near is looked for exactly, so that no wall is passed; not where that would ask for the
        // more, the less fits.)
        let near = if self.is_pressed { 0.0 } else { f64::from(width * DIAGONAL) };
        let seen_from = if self.is_pressed { back(ray, found.t, normal, BESIDE * f64::from(width)) } else { position };
        let from = seen_from + normal.as_dvec3() * leave;
        let facing = Facing::flat(normal);
        Ok(Surface { position, normal, facing, material, from, next: found.t + leave, width, near })
    }

    /// Depth and error of a triangle's hit, in double precision.
    #[inline(never)]
    fn measure(&self, ray: &Ray, found: &Found, triangle: &Triangle, seen: &mut Layer) {
        let placed = &self.view.scene.placement.placed[found.placed as usize];
        let meeting = meet(placed, &triangle.vertices, ray, found.t);
        seen.depth = meeting.along(ray).dot(self.rays.forward()) as f32;
        seen.error = meeting.error(placed, ray);
        seen.error_px = (f64::from(seen.error) / self.rays.pixel_width(meeting.t)) as f32;
    }

    /// The caller's ids of a part and its instance.
    pub(super) fn ids(&self, placed: u32, part: u32) -> (u64, u64) {
        let scene = self.view.scene;
        let instance = scene.placement.placed[placed as usize].instance;
        let id = self.view.model_of(placed).parts().get(part as usize).map_or(NONE, |p| p.id);
        (id, scene.instances[instance as usize].id)
    }

    /// An error of a stand-in, `t` from the eye, in pixels.
    #[inline]
    pub(super) fn in_pixels(&self, error: f32, t: f64) -> f32 {
        error / (self.rays.pixel_width(t).max(f64::MIN_POSITIVE) as f32)
    }

    /// A stand-in as a surface. What it casts begins above its cell, and above those beside it where the surface goes
    /// on as it is: on the ray that sees it. (Áfra 2012, section 6.2, begins a cell's diagonal along the light: behind
    /// a wall that is nearer.)
    fn stand_in(
        &self,
        ray: &Ray,
        found: &Found,
        look: &Look,
        seen: Option<&mut Layer>,
        wants: &mut Wants,
    ) -> Result<Surface, Need> {
        let scene = self.view.scene;
        let placed = &scene.placement.placed[found.placed as usize];
        let along = ray.dir.as_dvec3() * look.t;
        let wanted = self.view.wanted(found);
        if wanted.is_some() || seen.is_some() {
            let error = look.error();
            let error_px = self.in_pixels(error, look.t);
            if let Some(need) = wanted {
                wants.add(need, error_px.min(1e6));
            }
            if let Some(seen) = seen {
                seen.kind = if look.is_missing() { HitKind::Missing } else { HitKind::Lod };
                (seen.normal, seen.error, seen.error_px) = (look.normal().into(), error, error_px);
                seen.depth = along.dot(self.rays.forward()) as f32;
                if self.asks.ids {
                    (seen.part, seen.instance) = self.ids(found.placed, look.part());
                }
            }
        }
        let mut material = self.material(found.placed, look.part(), || Ok(None))?;
        if let Some(colour) = look.colour().filter(|_| !self.recoloured(found.placed, look.part())) {
            material.colour = colour;
        }
        let (position, width) = (ray.origin + along, width_at(ray, look.t));
        // Only for what lights cast, and only where the ray goes on.
        let casts = scene.lights.iter().any(|light| light.kind != LightKind::Headlight);
        let extent = placed.extent() * LEAVE;
        let above = if casts { look.above() } else { 0.0 };
        let from =
            back(ray, look.t, look.normal(), above + BESIDE * f64::from(width)) + look.normal().as_dvec3() * extent;
        let next = if material.opacity < 1.0 { look.leave() } else { look.t } + extent;
        Ok(Surface { position, normal: look.normal(), facing: look.facing(), material, from, next, width, near: 0.0 })
    }

    /// A triangle's id or colour, which are in other blocks, may come later; if they are not waited for the pixel does
    /// without.
    fn later(&self, need: Need, wants: &mut Wants) -> Result<(), Need> {
        if !self.view.accept_missing {
            return Err(need);
        }
        wants.add(need, 1.0);
        Ok(())
    }

    /// Whether a part, or its instance, has a colour in place of its own.
    pub(super) fn recoloured(&self, placed: u32, part: u32) -> bool {
        let p = &self.view.scene.placement.placed[placed as usize];
        let instance = &self.view.scene.instances[p.instance as usize];
        instance.look.colour.is_some() || instance.parts.shown.get(&part).is_some_and(|s| s.colour.is_some())
    }

    /// The part's material, under the states of part and instance; `own` is the triangle's own colour.
    pub(super) fn material(
        &self,
        placed: u32,
        part: u32,
        own: impl FnOnce() -> Result<Option<[u8; 4]>, Need>,
    ) -> Result<Material, Need> {
        let p = &self.view.scene.placement.placed[placed as usize];
        let instance = &self.view.scene.instances[p.instance as usize];
        let info = self.view.model_of(placed).parts().get(part as usize);
        let state = instance.parts.shown.get(&part);
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
                    material.colour = Vec3::from(self.srgb.linear(colour));
                }
            }
        }
        let selected = instance.look.selected || state.is_some_and(|s| s.selected);
        Ok(if selected { material.selected() } else { material })
    }
}

/// The colours behind the rows of a packet, for each of its pixels.
pub(super) fn rows_of(backs: &[[f32; 4]; DOWN as usize]) -> [[f32; PACKET]; 4] {
    let mut rows = [[0.0; PACKET]; 4];
    for (row, back) in backs.iter().enumerate() {
        for (all, back) in rows.iter_mut().zip(back) {
            all[row * ACROSS as usize..][..ACROSS as usize].fill(*back);
        }
    }
    rows
}

/// Adds a sample's colours.
struct Add<'a> {
    sums: &'a mut [[f32; PACKET]; 4],
    colours: &'a [[f32; PACKET]; 4],
}

impl Op for Add<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { sums, colours } = self;
        for c in 0..4 {
            for i in 0..PACKET {
                let colour = colours[c][i];
                // Squares of infinite lights and the like end here.
                sums[c][i] += if colour.is_finite() { colour } else { BRIGHTEST };
            }
        }
    }
}
