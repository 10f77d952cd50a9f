//! Plain packets of pictures, processed in rows from pixel to colour. The rays of a plain packet enter a single placed
//! tree that is only translated, are seen in perspective, are lit by headlights and hit opaque surfaces. The requested
//! buffers need neither double precision nor data outside of the triangles. All other packets, and those that hit
//! stand-ins for missing data, go through the layers of `direct.rs`. Both compute surfaces and light with the same code
//! (`query::answers`, `shading.rs`).
#![allow(clippy::needless_range_loop)] // each loop indexes several arrays

use super::Colours;
use super::direct::{AT_EYE, Asks, DOWN, Direct, Pixels, Scratch, rows_of};
use super::first::First;
use super::shading::{Row, Shading, Vectors};
use crate::math::DBounds;
use crate::math::bits;
use crate::math::{BUNDLE, PACKET};
use crate::query::NONE;
use crate::query::answers::{InTree, Seen};
use crate::scene::beam::Beam;
use crate::scene::camera::PixelRays;
use crate::scene::group::{CameraRays, CameraTree, Entered};
use crate::scene::light::LightKind;
use crate::scene::walk::SceneView;
use crate::simd::{Op, Simd, dispatch};
use crate::structure::Bundle;
use glam::{DVec3, Vec3};

/// A worker's memory.
#[derive(Default)]
pub(super) struct Plain {
    // In memory of its own, so that a new one takes little of the stack.
    seen: Box<Seen<PACKET>>,
    rows: Rows,
    /// Packets of a tile. `begun`: mask of those that were begun there.
    bundle: Box<Bundle>,
    begun: u32,
    /// Placed tree of each begun packet.
    placed: [u32; BUNDLE],
    entered: Vec<Entered>,
}

#[repr(C, align(64))]
struct Rows {
    /// Directions of the rays. `width`: their widths at distance 1, pixels of error included.
    dir: Vectors,
    width: Row<f32>,
    /// Parts of the hit surfaces.
    part: Row<u32>,
    /// Their unit geometric normals, if these are requested.
    normal: Vectors,
    /// Light from the hits or from the background.
    lit: Colours,
    /// Errors of stand-ins, in world units.
    error: Row<f32>,
}

impl Default for Rows {
    fn default() -> Self {
        let none = [0.0; PACKET];
        Self { dir: [none; 3], width: none, part: [0; PACKET], normal: [none; 3], lit: [none; 5], error: none }
    }
}

impl Plain {
    /// Light of each pixel.
    pub fn light(&self) -> &Colours {
        &self.rows.lit
    }
}

/// Outcome of a packet.
pub(super) enum Outcome {
    /// The packet is rendered.
    Done,
    /// The packet is not plain. These of its rays have hits, which are in the scratch's `group`.
    Met(u32),
    /// The packet is not plain, and its rays were not traced.
    NotPlain,
}

/// True if a picture can have plain packets.
pub(crate) fn is_plain(view: &SceneView, rays: &PixelRays, asks: Asks) -> bool {
    let is_lit_plainly = view.scene.lights.iter().all(|light| light.kind == LightKind::Headlight);
    is_lit_plainly && rays.is_perspective() && !asks.prims && !asks.precise
}

/// The placed trees that the rays of a packet may enter.
enum Enters<'a> {
    None,
    /// A single tree that plain packets can traverse.
    Plain(CameraTree<'a>),
    Others,
}

impl<'v> Direct<'v> {
    /// Computes the rays of a packet's pixels, and determines the placed trees that they may enter.
    fn enter(&self, pixels: &Pixels, rows: &mut Rows, entered: &mut Vec<Entered>) -> Enters<'v> {
        self.make_rays(pixels, rows);
        let ends = rows
            .dir
            .each_ref()
            .map(|row| row.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)]));
        let eye = self.rays.eye();
        let is_few = self.view.entered(&Beam::from_point(eye, ends, 0.0, u32::MAX), f64::INFINITY, entered);
        match entered[..] {
            [] if is_few => Enters::None,
            [Entered { placed, .. }] if is_few => self.plain_tree(placed).map_or(Enters::Others, Enters::Plain),
            _ => Enters::Others,
        }
    }

    /// Returns a placed tree if plain packets can traverse it.
    fn plain_tree(&self, placed: u32) -> Option<CameraTree<'v>> {
        let p = &self.view.scene.placement.placed[placed as usize];
        // Rays with an origin farther away must be moved nearer, which plain packets do not support.
        let is_near = |offset: DVec3| (self.rays.eye() - offset).abs().max_element() < f64::from(p.near());
        p.only_shifted().filter(|&offset| is_near(offset))?;
        CameraTree::of(&self.view, placed).filter(|camera| !camera.tree.has_colours())
    }

    /// Begins the plain packets of a tile, and traces them as far as they stay in one bundle. `packets`: for each
    /// packet its pixels and the mask of the active ones.
    pub(crate) fn begin(&self, packets: &[(Pixels, u32); BUNDLE], scratch: &mut Scratch) {
        let Plain { rows, bundle, begun, placed, entered, .. } = &mut scratch.plain;
        *begun = 0;
        if !self.plain {
            return;
        }
        for (i, (pixels, active)) in packets.iter().enumerate() {
            if *active == 0 || self.is_empty(pixels) {
                continue;
            }
            let Enters::Plain(camera) = self.enter(pixels, rows, entered) else { continue };
            placed[i] = camera.placed;
            let rays = CameraRays { eye: self.rays.eye(), dir: &rows.dir, width: &rows.width };
            *begun |= u32::from(camera.start(&rays, *active, bundle.packet(i))) << i;
        }
        // The packets of a bundle are in the same tree.
        let mut left = *begun;
        while left != 0 {
            let of_one = same(placed, placed[left.trailing_zeros() as usize]) & left;
            if let Some(camera) = CameraTree::of(&self.view, placed[left.trailing_zeros() as usize]) {
                camera.tree.closest_in_bundle(camera.filter.as_ref(), bundle, of_one);
            }
            left &= !of_one;
        }
    }

    /// Computes the rays of a packet's pixels.
    fn make_rays(&self, pixels: &Pixels, rows: &mut Rows) {
        dispatch(self.isa(), MakeRays { rays: self.rays, pixels, rows });
    }

    /// Traces a packet. Continues the walk that was [begun](Self::begin) under its number, if any; else starts with its
    /// pixels. Returns the placed tree that the rays enter, if any, and the mask of rays with a hit; `None` if the
    /// packet is not plain.
    fn trace_plain(
        &self,
        pixels: &Pixels,
        active: u32,
        number: Option<usize>,
        scratch: &mut Scratch,
    ) -> Option<(Option<u32>, u32)> {
        let Scratch { group, plain: Plain { rows, bundle, begun, placed, entered, .. }, .. } = scratch;
        let Some(i) = number.filter(|i| *begun >> i & 1 == 1) else {
            let camera = match self.enter(pixels, rows, entered) {
                Enters::None => return Some((None, 0)),
                Enters::Plain(camera) => camera,
                Enters::Others => return None,
            };
            let rays = CameraRays { eye: self.rays.eye(), dir: &rows.dir, width: &rows.width };
            let met = group.trace_camera(&self.view, &camera, &rays, active)?.ok()?;
            return Some((Some(camera.placed), met));
        };
        let met = CameraTree::of(&self.view, placed[i])?.go_on(&self.view, bundle.packet(i)).ok()?;
        rows.dir = *bundle.packet(i).dirs();
        group.take(placed[i], bundle.packet(i));
        Some((Some(placed[i]), met))
    }

    /// Renders one sample of the pixels in `active`: the [light](Plain::light) of each and, for sample 0, its first
    /// surface. `backs`: background of each row; `number`: index of the packet in its tile, if that was
    /// [begun](Self::begin).
    pub(super) fn plain(
        &self,
        pixels: &Pixels,
        active: u32,
        backs: &[[f32; 4]; DOWN as usize],
        number: Option<usize>,
        scratch: &mut Scratch,
    ) -> Outcome {
        if !self.plain {
            return Outcome::NotPlain;
        }
        let Some((placed, met)) = self.trace_plain(pixels, active, number, scratch) else { return Outcome::NotPlain };
        let Scratch { group, plain: Plain { seen, rows, .. }, shading, .. } = scratch;
        let Some(placed) = placed else {
            rows.lit = rows_of(backs);
            if pixels.sample == 0 {
                scratch.first = First::NOTHING;
            }
            return Outcome::Done;
        };
        let dir = |i: usize| Vec3::new(rows.dir[0][i], rows.dir[1][i], rows.dir[2][i]);
        let at = InTree::new(&self.view, placed);
        let gone = seen.look(&at, met, dir, &*group, [true, pixels.sample == 0]);
        if gone | seen.missing() != 0 {
            return Outcome::Met(met);
        }
        seen.each(&at, &rows.dir, &mut shading.normal, &mut rows.part);
        if self.may_meet_eye(placed, met & !seen.cells(), group.walk().distances(), &rows.dir, shading) {
            return Outcome::Met(met);
        }
        if self.asks.normals {
            rows.normal = shading.normal;
        }
        if at.tree().has_normals() && !seen.smooth(&at, &rows.dir, &*group, &mut shading.normal) {
            return Outcome::Met(met);
        }
        let mut left = met;
        while left != 0 {
            let part = rows.part[left.trailing_zeros() as usize];
            let like = left & same(&rows.part, part);
            // Triangles have no colours of their own here.
            let Ok(material) = self.material(placed, part, || Ok(None)) else { return Outcome::Met(met) };
            if material.opacity != 1.0 {
                return Outcome::Met(met);
            }
            shading.set_material(like, like == met, &material);
            let coloured = seen.coloured() & like;
            if coloured != 0 && !self.recoloured(placed, part) {
                bits(coloured).for_each(|i| shading.set_colour(i, seen.stand_ins().colour(i)));
            }
            left &= !like;
        }
        if seen.cells() != 0 {
            shading.facing = *seen.stand_ins().along();
        }
        shading.begin(self.isa(), &rows.dir, [met, seen.cells()], self.ambient);
        shading.add_headlights(self.isa(), &self.view.scene.lights);
        rows.lit = rows_of(backs);
        shading.put(self.isa(), met, &mut rows.lit);
        if pixels.sample == 0 {
            self.note_first(placed, met, scratch);
        }
        Outcome::Done
    }

    /// True if the plane of a triangle that one of `rays` hits, at distance `t`, may go through the eye.
    fn may_meet_eye(&self, placed: u32, rays: u32, t: &Row<f32>, dir: &[Row<f32>; 3], shading: &Shading) -> bool {
        let p = &self.view.scene.placement.placed[placed as usize];
        // Coordinates are within the tree's extent, or a few of it; and the cosines have roundings of their own.
        let most = 4.0 * AT_EYE * p.extent();
        let eye = DBounds { min: self.rays.eye() - most, max: self.rays.eye() + most };
        p.bounds.overlaps(&eye) && shading.least_height(self.isa(), rays, [dir, &shading.normal], t) <= most as f32
    }

    /// Stores the first surface of each pixel.
    fn note_first(&self, placed: u32, met: u32, scratch: &mut Scratch) {
        let Scratch { group, plain: Plain { seen, rows, .. }, shading, first, .. } = scratch;
        let (cells, t) = (seen.cells(), group.walk().distances());
        (first.met, first.lod, first.missing, first.inexact) = (met, cells, 0, cells);
        first.transmitted = group.have_transmitted();
        if cells != 0 {
            let p = &self.view.scene.placement.placed[placed as usize];
            let rays = (cells, self.rays.eye(), t);
            seen.stand_ins().errors(&self.view.tree(placed), p, rays, &*group, &mut rows.error);
            for i in 0..PACKET {
                first.error_px[i] = self.in_pixels(rows.error[i], f64::from(t[i]));
            }
        }
        if self.asks.normals {
            (first.normal, first.shading_normal) = ([[0.0; 3]; PACKET], [[0.0; 3]; PACKET]);
            for i in bits(met) {
                first.normal[i] = rows.normal.each_ref().map(|row| row[i]);
                first.shading_normal[i] = shading.normal.each_ref().map(|row| row[i]);
            }
        }
        if self.asks.ids {
            (first.part, first.instance) = ([NONE; PACKET], [NONE; PACKET]);
            bits(met).for_each(|i| (first.part[i], first.instance[i]) = self.ids(placed, rows.part[i]));
        }
    }
}

/// Returns the mask of the lanes equal to `value`.
#[inline]
fn same(row: &Row<u32>, value: u32) -> u32 {
    let mut same = 0;
    for (i, v) in row.iter().enumerate() {
        same |= u32::from(*v == value) << i;
    }
    same
}

/// Computes the rays of a packet's pixels.
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
        // The copies are constant while the rows are written.
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
        // A separate loop, because it reads a table.
        for i in 0..PACKET {
            width[i] *= pixels.width(steps[i]);
        }
    }
}
