//! Plain packets of pictures, worked out in vectors from the pixel to its colour: one placed tree that is not turned, seen in
//! perspective, lit by headlights, opaque where the rays hit it, and nothing asked for that takes double precision or what is
//! beside the triangles. All others, and those that meet what is missing, go through `direct.rs`, which this agrees with to the
//! bit.
#![allow(clippy::needless_range_loop)] // rows of several arrays at once

use super::direct::{Asks, DOWN, Direct, Pixels, Scratch, rows_of};
use super::material::{Gloss, Material, powers};
use crate::query::answers::Seen;
use crate::query::NONE;
use crate::scene::in_one::{CameraRays, CameraTree};
use crate::scene::camera::PixelRays;
use crate::scene::light::LightKind;
use crate::scene::walk::{SceneView, bits};
use crate::simd::{Op, Simd, dispatch};
use crate::structure::bvh::trace::{BUNDLE, Bundle, PACKET};
use glam::{DVec3, Vec3};

/// A number for each pixel of a packet.
type Row<T> = [T; PACKET];
/// A vector for each, axis by axis.
type Vectors = [Row<f32>; 3];

/// Memory of a worker.
#[derive(Default)]
pub(super) struct Plain {
    seen: Seen<PACKET>,
    rows: Rows,
    /// The packets of a tile, and those of them that were begun there.
    bundle: Bundle,
    begun: u32,
}

#[repr(C, align(64))]
struct Rows {
    /// Directions of the rays, and their widths at distance 1, pixels of error included.
    dir: Vectors,
    width: Row<f32>,
    /// Normals, parts and colours of what is seen.
    normal: Vectors,
    part: Row<u32>,
    colour: Vectors,
    /// The light that comes from there, or from behind; and alpha.
    lit: [Row<f32>; 4],
    /// Errors of stand-ins.
    error: Row<f32>,
}

impl Default for Rows {
    fn default() -> Self {
        let none = [0.0; PACKET];
        let (dir, part) = ([none; 3], [0; PACKET]);
        Self { dir, width: none, normal: dir, part, colour: dir, lit: [none; 4], error: none }
    }
}

impl Plain {
    /// Linear RGB and alpha of each pixel.
    pub fn light(&self) -> &[Row<f32>; 4] {
        &self.rows.lit
    }
}

/// What became of a packet.
pub(super) enum Outcome {
    /// It is done.
    Done,
    /// It is not plain; these of its rays hit something, as the scratch's `in_one` has it.
    Met(u32),
    /// It is not plain.
    NotPlain,
}

/// The placed tree of plain packets, if a picture can have such.
pub(crate) fn tree_of(view: &SceneView, rays: &PixelRays, asks: Asks) -> Option<u32> {
    let placed = view.only_one()?;
    let is_lit_plainly = view.scene.lights.iter().all(|light| light.kind == LightKind::Headlight);
    let p = &view.scene.placement.placed[placed as usize];
    // From farther away rays are moved nearer.
    let is_near = |offset: DVec3| (rays.eye() - offset).abs().max_element() < f64::from(p.near());
    let is_unturned = p.only_shifted().is_some_and(is_near);
    let asks_little = !asks.prims && !asks.precise && view.tree(placed).colours_at.is_none();
    (is_lit_plainly && is_unturned && rays.is_perspective() && asks_little).then_some(placed)
}

impl Direct<'_> {
    /// Begins the plain ones of a tile's packets, and traces them for as far as they go together. `packets`: of each its pixels, and those of them that count.
    pub(crate) fn begin(&self, packets: &[(Pixels, u32); BUNDLE], scratch: &mut Scratch) {
        let Plain { rows, bundle, begun, .. } = &mut scratch.plain;
        *begun = 0;
        let Some(camera) = self.plain.and_then(|_| CameraTree::of(&self.view)) else { return };
        for (i, (pixels, active)) in packets.iter().enumerate() {
            if *active != 0 && !self.is_empty(pixels) {
                let rays = self.camera_rays(pixels, rows);
                *begun |= u32::from(camera.start(&rays, *active, bundle.packet(i))) << i;
            }
        }
        bundle.closest(&camera.tree, camera.filter.as_ref(), *begun);
    }

    /// Makes the rays of a packet's pixels.
    fn camera_rays<'a>(&self, pixels: &Pixels, rows: &'a mut Rows) -> CameraRays<'a> {
        dispatch(self.isa(), MakeRays { rays: self.rays, pixels, rows });
        CameraRays { eye: self.rays.eye(), dir: &rows.dir, width: &rows.width }
    }

    /// Traces a packet: as it was [begun](Self::begin) under its number, if it was, or else its pixels. `None` if it is not plain.
    fn trace_plain(&self, pixels: &Pixels, active: u32, number: Option<usize>, scratch: &mut Scratch) -> Option<u32> {
        let Scratch { in_one, plain: Plain { rows, bundle, begun, .. }, .. } = scratch;
        let Some(i) = number.filter(|i| *begun >> i & 1 == 1) else {
            let rays = self.camera_rays(pixels, rows);
            return in_one.trace_camera(&self.view, &rays, active)?.ok();
        };
        let met = CameraTree::of(&self.view)?.go_on(&self.view, bundle.packet(i)).ok()?;
        rows.dir = *bundle.packet(i).dirs();
        in_one.take(bundle.packet(i));
        Some(met)
    }

    /// Renders one sample of the pixels of `active`: the [light](Plain::light) of each, and, of the first sample, what is seen
    /// there. `backs`: what is behind all, row by row; `number`: the packet's in its tile, if that was [begun](Self::begin).
    pub(super) fn plain(
        &self,
        pixels: &Pixels,
        active: u32,
        backs: &[[f32; 4]; DOWN as usize],
        number: Option<usize>,
        scratch: &mut Scratch,
    ) -> Outcome {
        let Some(placed) = self.plain else { return Outcome::NotPlain };
        let Some(met) = self.trace_plain(pixels, active, number, scratch) else { return Outcome::NotPlain };
        let Scratch { in_one, plain: Plain { seen, rows, .. }, .. } = scratch;
        let dir = |i: usize| Vec3::new(rows.dir[0][i], rows.dir[1][i], rows.dir[2][i]);
        let gone = seen.look(&self.view, placed, met, dir, &*in_one, [true; 2]);
        if gone | seen.missing() != 0 {
            return Outcome::Met(met);
        }
        seen.each(&self.view, placed, &rows.dir, &mut rows.normal, &mut rows.part);
        rows.lit = rows_of(backs);
        let mut left = met;
        while left != 0 {
            let part = rows.part[left.trailing_zeros() as usize];
            let like = left & same(&rows.part, part);
            // Colours of triangles' own there are none.
            let Ok(material) = self.material(placed, part, || Ok(None)) else { return Outcome::Met(met) };
            if material.opacity != 1.0 {
                return Outcome::Met(met);
            }
            self.shade(placed, part, &material, like, seen, rows);
            left &= !like;
        }
        if pixels.sample == 0 {
            self.note_first(placed, met, scratch);
        }
        Outcome::Done
    }

    /// Lights the pixels of `like`, which see a part of `material`.
    fn shade(&self, placed: u32, part: u32, material: &Material, like: u32, seen: &Seen<PACKET>, rows: &mut Rows) {
        for (axis, colour) in rows.colour.iter_mut().enumerate() {
            *colour = [material.colour[axis]; PACKET];
        }
        let coloured = seen.coloured() & like;
        if coloured != 0 && !self.recoloured(placed, part) {
            for i in bits(coloured) {
                let colour = seen.stand_ins().colour(i);
                for axis in 0..3 {
                    rows.colour[axis][i] = colour[axis];
                }
            }
        }
        dispatch(self.isa(), Shade { direct: self, material, like, seen, rows });
    }

    /// What is seen first in each pixel.
    fn note_first(&self, placed: u32, met: u32, scratch: &mut Scratch) {
        let Scratch { in_one, plain: Plain { seen, rows, .. }, first, .. } = scratch;
        let (cells, t) = (seen.cells(), in_one.walk.distances());
        (first.met, first.lod, first.missing, first.inexact) = (met, cells, 0, cells);
        first.passed = in_one.have_passed();
        if cells != 0 {
            let p = &self.view.scene.placement.placed[placed as usize];
            let rays = (cells, self.rays.eye(), t);
            seen.stand_ins().errors(&self.view.tree(placed), p, rays, &*in_one, &mut rows.error);
            for i in 0..PACKET {
                first.error_px[i] = self.in_pixels(rows.error[i], f64::from(t[i]));
            }
        }
        if self.asks.normals {
            first.normal = [[0.0; 3]; PACKET];
            bits(met).for_each(|i| first.normal[i] = [rows.normal[0][i], rows.normal[1][i], rows.normal[2][i]]);
        }
        if self.asks.ids {
            (first.part, first.instance) = ([NONE; PACKET], [NONE; PACKET]);
            bits(met).for_each(|i| (first.part[i], first.instance[i]) = self.ids(placed, rows.part[i]));
        }
    }
}

/// The lanes that are `value`.
#[inline]
fn same(row: &Row<u32>, value: u32) -> u32 {
    let mut same = 0;
    for (i, v) in row.iter().enumerate() {
        same |= u32::from(*v == value) << i;
    }
    same
}

/// Makes the rays of a packet's pixels.
struct MakeRays<'a> {
    rays: &'a PixelRays,
    pixels: &'a Pixels,
    rows: &'a mut Rows,
}

impl Op for MakeRays<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { rays, pixels, rows: Rows { dir, width, .. } } = self;
        // Copies: they stay as they are while the rows are written.
        let (rays, pixels) = (*rays, *pixels);
        for i in 0..PACKET {
            let (x, y) = pixels.point(i);
            let (to, one) = rays.toward(x, y);
            (dir[0][i], dir[1][i], dir[2][i], width[i]) = (to.x, to.y, to.z, one);
        }
        let mut steps = [0; PACKET];
        for i in 0..PACKET {
            steps[i] = pixels.step(i);
        }
        // Apart, for it looks up a table.
        for i in 0..PACKET {
            width[i] *= pixels.width(steps[i]);
        }
    }
}

/// Adds up ambient light and headlights, as `Direct::light` does.
struct Shade<'a, 'd> {
    direct: &'a Direct<'d>,
    material: &'a Material,
    like: u32,
    seen: &'a Seen<PACKET>,
    rows: &'a mut Rows,
}

impl Op for Shade<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { direct, material, like, seen, rows: Rows { dir, normal, colour, lit, .. } } = self;
        let (gloss, glow, ambient) = (Gloss::of(material), material.glow, direct.ambient);
        let (mut cosine, mut aslant, mut lobe) = ([0.0; PACKET], [0.0; PACKET], [0.0; PACKET]);
        let mut facing = [0.0; PACKET];
        for i in 0..PACKET {
            let to_eye = -Vec3::new(dir[0][i], dir[1][i], dir[2][i]);
            cosine[i] = Vec3::new(normal[0][i], normal[1][i], normal[2][i]).dot(to_eye);
            aslant[i] = to_eye.dot(to_eye);
            facing[i] = cosine[i].max(0.0);
        }
        powers(&facing, gloss.exponent, &mut lobe);
        if seen.cells() != 0 {
            let (cells, along) = (seen.cells(), seen.stand_ins().along());
            for i in 0..PACKET {
                cosine[i] = if cells >> i & 1 == 1 { along[i] } else { cosine[i] };
            }
        }
        let mut sum = [[0.0; PACKET]; 3];
        for i in 0..PACKET {
            let own = Vec3::new(colour[0][i], colour[1][i], colour[2][i]) * ambient + glow;
            (sum[0][i], sum[1][i], sum[2][i]) = (own.x, own.y, own.z);
        }
        for light in &direct.view.scene.lights {
            let strength = Vec3::from(light.colour) * light.intensity;
            for i in 0..PACKET {
                let colour = Vec3::new(colour[0][i], colour[1][i], colour[2][i]);
                let add = gloss.lit(colour, cosine[i], aslant[i], lobe[i], strength);
                (sum[0][i], sum[1][i], sum[2][i]) = (sum[0][i] + add.x, sum[1][i] + add.y, sum[2][i] + add.z);
            }
        }
        let mut mask = [0; PACKET];
        for i in 0..PACKET {
            mask[i] = 0u32.wrapping_sub(like >> i & 1);
        }
        for axis in 0..3 {
            for i in 0..PACKET {
                lit[axis][i] = f32::from_bits(sum[axis][i].to_bits() & mask[i] | lit[axis][i].to_bits() & !mask[i]);
            }
        }
        for i in 0..PACKET {
            lit[3][i] = f32::from_bits(1.0f32.to_bits() & mask[i] | lit[3][i].to_bits() & !mask[i]);
        }
    }
}
