//! The surfaces that a packet's rays hit: normals, materials and places, one column each, tree by tree.

use super::camera::{Met, Near};
use super::direct::{Direct, LEAVE, Scratch, is_at_origin, may_be_at_origin};
use super::first::First;
use super::material::SELECTED;
use super::rays::CameraPacket;
use super::shading::{Row, Shading, Vectors, column};
use crate::lod::Facing;
use crate::math::{DBounds, PACKET, Ray, bits};
use crate::query::NONE;
use crate::query::answers::{InTree, Seen, TreeHits, weights};
use crate::render::wants::Wants;
use crate::scene::placed::Placed;
use crate::scene::walk::{HitTree, Need};
use crate::structure::TriHit;
use glam::{DVec3, Vec3, Vec4};

/// Height at which a stand-in's rays begin above the surface that it replaces, as a fraction of the ray's width. The
/// tops of adjacent stand-ins are not at exactly the same height. (With 0, lit planes have up to 1.5 % of false shadow;
/// from 0.1 on, none. Up to 0.4, no light enters a closed box.)
const BESIDE: f64 = 0.125;
/// Way into a cell with loose content, as a fraction of the ray's way through its box, after which its shadow rays
/// begin.
const INSIDE: f64 = 1.0 / 64.0;
/// Longest way back along a ray to gain height, as a multiple of that height.
const FARTHEST_BACK: f64 = 4.0;
/// Diagonal of a cube that may stand in for a ray of width 1.
const DIAGONAL: f32 = 1.732_050_8;

/// The surfaces that rays hit. Reusable: columns of rays without a surface hold arbitrary values.
#[repr(C, align(64))]
pub(super) struct Surfaces {
    /// Rays with a surface, and those of them that hit stand-ins.
    pub met: u32,
    pub cells: u32,
    /// Rays whose hits go through their origins: they go on behind, at `next`.
    pub at_origin: u32,
    pub opacity: Row<f32>,
    /// Distances at which rays go on behind surfaces that are not opaque.
    pub next: Row<f64>,
    /// Places for rays towards lights.
    pub leaving: Box<Leaving>,
    /// Distances of the hits.
    t: Row<f64>,
    /// Unit geometric normals that face the rays.
    geometric: Vectors,
    /// Parts of the model.
    part: Row<u32>,
    error: Row<f32>,
}

/// The beginnings of rays towards lights. Set only if lights may cast shadows.
pub(super) struct Leaving {
    /// Points of the surfaces.
    pub position: [DVec3; PACKET],
    /// Origins of the rays that leave them.
    pub from: [DVec3; PACKET],
    /// Widths of the camera's rays at the hits, pixels of error included, with which the rays begin.
    pub width: Row<f32>,
    /// Distances from `from` up to which the rays test only triangles, no stand-ins.
    pub near: Row<f64>,
    /// Visible normals of stand-ins.
    pub facing: [Facing; PACKET],
}

impl Default for Surfaces {
    fn default() -> Self {
        let leaving = Leaving {
            position: [DVec3::ZERO; PACKET],
            from: [DVec3::ZERO; PACKET],
            width: [0.0; PACKET],
            near: [0.0; PACKET],
            facing: [Facing::flat(Vec3::ZERO); PACKET],
        };
        Self {
            met: 0,
            cells: 0,
            at_origin: 0,
            opacity: [1.0; PACKET],
            next: [0.0; PACKET],
            leaving: Box::new(leaving),
            t: [0.0; PACKET],
            geometric: [[0.0; PACKET]; 3],
            part: [0; PACKET],
            error: [0.0; PACKET],
        }
    }
}

/// Returns the point on the ray at height `above` over the surface with this normal that it sees at `t`. Nothing lies
/// between this point and the surface, so an origin there is behind no wall. [`FARTHEST_BACK`] and `t_min` limit the
/// way.
fn back(ray: &Ray, t: f64, normal: Vec3, above: f64) -> DVec3 {
    let dir = ray.dir.as_dvec3();
    let length = dir.length();
    let facing = f64::from(-normal.dot(ray.dir)) / length;
    let by = above / (facing.max(1.0 / FARTHEST_BACK) * length);
    ray.origin + dir * (t - by).max(ray.t_min)
}

/// The hits of a packet's rays in one placed tree.
struct InOne<'a, H: TreeHits<PACKET> + ?Sized> {
    at: InTree<'a>,
    /// Rays with hits, and all rays of the packet that hit something.
    met: u32,
    all: u32,
    hits: &'a H,
    rays: &'a CameraPacket,
    /// Distances from the eye to the origins of `rays`, unless they are zero.
    ahead: Option<&'a [f64; PACKET]>,
    /// Rays whose first surface is to be stored.
    note: u32,
}

impl<H: TreeHits<PACKET> + ?Sized> InOne<'_, H> {
    fn ahead(&self, i: usize) -> f64 {
        self.ahead.map_or(0.0, |ahead| ahead[i])
    }
}

/// Memory for surfaces.
struct Out<'a> {
    seen: &'a mut Seen<PACKET>,
    surfaces: &'a mut Surfaces,
    shading: &'a mut Shading,
    first: &'a mut First,
    wants: &'a mut Wants,
}

impl Direct<'_> {
    /// Computes the surfaces that the rays of `active` hit, where `met` says. Stores the first surfaces of the pixels
    /// in `note`. Rays whose hit goes through their origin have no surface (see [`is_at_origin`]).
    pub(super) fn surfaces(&self, met: Met, active: u32, note: u32, scratch: &mut Scratch) -> Result<(), Need> {
        (scratch.surfaces.met, scratch.surfaces.cells, scratch.surfaces.at_origin) = (0, 0, 0);
        let near = self.near(active, scratch);
        let Scratch { group, found, rays, seen, surfaces, shading, first, wants, .. } = &mut *scratch;
        let (rays, ahead) = match near.as_deref() {
            Some(Near { rays, ahead }) => (rays, Some(ahead)),
            None => (&**rays, None),
        };
        let mut out = Out { seen, surfaces, shading, first, wants };
        if let Some(number) = met.only {
            let placed = self.view.scene.placed(number);
            let at = InTree { view: &self.view, id: HitTree::Placed(number), placed: &placed };
            return self.see(&InOne { at, met: active, all: active, hits: &**group, rays, ahead, note }, &mut out);
        }
        let mut left = active;
        while left != 0 {
            let id = found[left.trailing_zeros() as usize].tree;
            let like = bits(left).filter(|&i| found[i].tree == id).fold(0, |all, i| all | 1 << i);
            let placed = self.view.frame_of(id);
            let at = InTree { view: &self.view, id, placed: &placed };
            self.see(&InOne { at, met: like, all: active, hits: &found[..], rays, ahead, note }, &mut out)?;
            left &= !like;
        }
        Ok(())
    }

    fn see(&self, one: &InOne<impl TreeHits<PACKET> + ?Sized>, out: &mut Out) -> Result<(), Need> {
        let InOne { ref at, met, all, hits, rays, note, .. } = *one;
        let (tree, placed) = (at.tree(), at.placed);
        let Out { seen, surfaces, shading, .. } = &mut *out;
        // Stand-ins are loaded as a whole for their errors, and for their boxes and slabs.
        let is_whole = note != 0 || self.casts || self.view.scene.see_through || self.view.accept_missing;
        let gone = seen.look(at, met, |i| rays.dir(i), hits, [true, is_whole]);
        if let Some(i) = bits(gone).next() {
            return Err(at.need_of(&hits.hit(i)));
        }
        hits.distances(met, &mut surfaces.t);
        let begun = (0..PACKET).fold(0, |all, i| all | u32::from(rays.begins()[i] != 0.0) << i);
        for i in bits(seen.cells() & (seen.stand_ins().inside() | begun)) {
            surfaces.t[i] = seen.stand_ins().t(i, placed, &rays.ray(i), surfaces.t[i]);
        }
        let mut normals = [[0.0; PACKET]; 3];
        seen.each(at, rays.dirs(), &mut normals, &mut surfaces.part);
        let at_origin = self.at_origin(one, seen, surfaces, &normals);
        let met = met & !at_origin;
        merge(met, &normals, &mut surfaces.geometric);
        let mut lacking = 0;
        if tree.has_normals() {
            lacking = seen.smooth(at, rays.dirs(), hits, &mut normals);
        }
        merge(met, &normals, &mut shading.normal);
        (surfaces.met, surfaces.at_origin) = (surfaces.met | met, surfaces.at_origin | at_origin);
        surfaces.cells |= seen.cells();
        bits(seen.cells()).for_each(|i| shading.facing[i] = seen.stand_ins().along()[i]);
        for i in bits(lacking & met) {
            if let Err(block) = tree.normals(&hits.hit(i)) {
                self.later(at.need(block), out.wants)?;
            }
        }
        lacking |= self.materials(one, met, all & !at_origin == met, out)?;
        self.note(one, note & met, lacking & met, out)?;
        if self.casts {
            bits(met).for_each(|i| self.leave(one, i, out.seen, out.surfaces));
        }
        if self.view.scene.see_through || at_origin != 0 {
            self.go_behind(one, met, at_origin, out);
        }
        Ok(())
    }

    /// The rays with triangles through their origins.
    fn at_origin(
        &self,
        one: &InOne<impl TreeHits<PACKET> + ?Sized>,
        seen: &Seen<PACKET>,
        surfaces: &Surfaces,
        normals: &Vectors,
    ) -> u32 {
        let (placed, rays) = (one.at.placed, one.rays);
        let triangles = one.met & !seen.cells();
        let most = may_be_at_origin(placed);
        let may_be = |eye: DVec3| placed.bounds.overlaps(&DBounds { min: eye - most, max: eye + most });
        let doubtful = if triangles == 0 || !rays.eye().is_none_or(may_be) {
            0
        } else {
            Shading::low(self.isa(), triangles, [rays.dirs(), normals], &surfaces.t, most as f32)
        };
        let mut at_origin = 0;
        if doubtful != 0 {
            seen.each_triangle(doubtful, |i, corners| {
                let is_at = one.ahead(i) == 0.0 && is_at_origin(placed, &corners, rays.origin(i));
                at_origin |= u32::from(is_at) << i;
            });
        }
        at_origin
    }

    /// Sets the materials of the surfaces that rays of `met` hit; `are_all`: no other ray has a surface. Returns the
    /// rays whose triangles' colours are not in memory.
    fn materials(
        &self,
        one: &InOne<impl TreeHits<PACKET> + ?Sized>,
        met: u32,
        are_all: bool,
        out: &mut Out,
    ) -> Result<u32, Need> {
        let Out { seen, surfaces, shading, wants, .. } = out;
        let (tree, id) = (one.at.tree(), one.at.id);
        let has_colours = tree.has_colours();
        let (mut left, mut lacking) = (met, 0);
        while left != 0 {
            let part = surfaces.part[left.trailing_zeros() as usize];
            let like = left & same(&surfaces.part, part);
            left &= !like;
            let (material, is_selected) = self.material(id, part);
            shading.set_material(like, are_all && like == met, &material);
            bits(like).for_each(|i| surfaces.opacity[i] = material.opacity);
            if (seen.coloured() & like == 0 && !has_colours) || self.recoloured(id, part) {
                continue;
            }
            let tint = self.view.tint(id).map_or(Vec3::ONE, Vec4::truncate);
            bits(seen.coloured() & like).for_each(|i| shading.set_colour(i, seen.stand_ins().colour(i) * tint));
            if !has_colours {
                continue;
            }
            for i in bits(like & !seen.cells()) {
                let hit = one.hits.hit(i);
                match tree.colours(&hit) {
                    Ok(colours) => {
                        if let Some(own) = colours.and_then(|colours| self.mixed(colours, [hit.u, hit.v])) {
                            let own = own * tint;
                            shading.set_colour(i, if is_selected { own.lerp(SELECTED, 0.65) } else { own });
                        }
                    }
                    Err(block) => {
                        lacking |= 1 << i;
                        self.later(one.at.need(block), wants)?;
                    }
                }
            }
        }
        Ok(lacking)
    }

    /// Returns the linear colour at a point of a triangle, from the sRGB colours of its corners.
    fn mixed(&self, colours: [[u8; 4]; 3], uv: [f32; 2]) -> Option<Vec3> {
        let [a, b, c] = colours;
        if a[3] == 0 {
            return None;
        }
        let linear = |colour: [u8; 4]| Vec3::from(self.srgb.linear(colour));
        if a == b && a == c {
            return Some(linear(a));
        }
        let [x, y, z] = weights(uv);
        Some((linear(a) * x + linear(b) * y + linear(c) * z).max(Vec3::ZERO))
    }

    /// Stores the first surfaces of the pixels in `note`, and asks for the missing blocks that stand-ins replace.
    /// `lacking`: rays whose normals or colours are missing.
    fn note(
        &self,
        one: &InOne<impl TreeHits<PACKET> + ?Sized>,
        note: u32,
        lacking: u32,
        out: &mut Out,
    ) -> Result<(), Need> {
        let Out { seen, surfaces, shading, first, wants } = out;
        let (tree, placed, rays) = (one.at.tree(), one.at.placed, one.rays);
        let missing = seen.missing();
        let cells = seen.cells() & (note | missing);
        if cells != 0 {
            let from = rays.eye().map(|eye| (cells, eye, &surfaces.t));
            match from {
                Some(from) => seen.stand_ins().errors(&tree, placed, from, one.hits, &mut surfaces.error),
                None => bits(cells).for_each(|i| {
                    let along = rays.dir(i).as_dvec3() * surfaces.t[i];
                    let hit = one.hits.hit(i);
                    surfaces.error[i] = seen.stand_ins().error(i, &tree, placed, &hit, rays.origin(i), along);
                }),
            }
        }
        for i in bits(missing) {
            if let Some(need) = self.view.wanted(one.at.id, &one.hits.hit(i)) {
                let error = self.in_pixels(surfaces.error[i], surfaces.t[i] + one.ahead(i));
                wants.add(need, error.min(1e6));
            }
        }
        if note == 0 {
            return Ok(());
        }
        first.met |= note;
        first.lod |= note & cells & !missing;
        // The places of triangles are exact, but their light is not yet.
        first.missing |= note & (missing | lacking);
        first.inexact |= note & cells;
        for i in bits(note & cells) {
            first.error[i] = surfaces.error[i];
            first.error_px[i] = self.in_pixels(surfaces.error[i], surfaces.t[i] + one.ahead(i));
        }
        if self.asks.normals {
            for i in bits(note) {
                first.normal[i] = column(&surfaces.geometric, i).into();
                first.shading_normal[i] = column(&shading.normal, i).into();
            }
        }
        if self.asks.ids {
            bits(note).for_each(|i| {
                [first.part[i], first.instance[i], first.occurrence[i]] = self.ids(one.at.id, surfaces.part[i]);
            });
        }
        if self.asks.precise {
            for i in bits(note & cells) {
                first.depth[i] = self.depth(rays.dir(i), surfaces.t[i] + one.ahead(i));
            }
        }
        if self.asks.precise || self.asks.uvs {
            let met = seen.meet(&one.at, note, |i| (rays.origin(i), rays.dir(i)), |i| surfaces.t[i]);
            for i in bits(if self.asks.uvs { met } else { 0 }) {
                first.uv[i] = seen.meetings().weights(i).map(|w| w as f32);
            }
            for i in bits(if self.asks.precise { met } else { 0 }) {
                let t = seen.meetings().t(i) + one.ahead(i);
                first.depth[i] = self.depth(rays.dir(i), t);
                first.error[i] = seen.meetings().error(i);
                first.error_px[i] = (f64::from(first.error[i]) / self.rays.pixel_width(t)) as f32;
                first.inexact |= u32::from(first.error_px[i] != 0.0) << i;
            }
        }
        if self.asks.uvs && tree.has_parameters() {
            for i in bits(note) {
                let [u, v] = first.uv[i];
                let found = tree.parameters(&TriHit { u, v, ..one.hits.hit(i) });
                first.uv[i] = found.map_or([0.0; 2], |it| it.uv);
            }
        }
        if self.asks.prims {
            for i in bits(note & !seen.cells()) {
                first.prim[i] = match tree.prim(&one.hits.hit(i)) {
                    Ok(prim) => prim.map_or(NONE, u64::from),
                    Err(block) => {
                        self.later(one.at.need(block), wants)?;
                        NONE
                    }
                };
            }
        }
        Ok(())
    }

    /// Sets the beginnings of the rays that leave the surface of ray `i` towards lights.
    ///
    /// Those of a stand-in are on the camera's ray, above its cell and above adjacent cells if the surface continues
    /// evenly. (Áfra 2012, section 6.2, begins them a cell's diagonal towards the light, which may be behind a nearer
    /// wall.) Those of a stand-in for leaves begin just inside its cell instead: no surface continues evenly, and it
    /// is shaded by the rest of the content, as the cells below show it, and by its neighbours. (A forest in the sun
    /// was up to half too bright. If all stand-ins that transmit rays began so, blocks would be a fifth too dark.)
    ///
    /// Adjacent stand-ins of the same surface protrude from a triangle. (Áfra 2012, section 6.2, begins rays behind
    /// them, in the open. Here the near range is tested against triangles, so that rays skip no wall. Under pressure it
    /// is not, because that would need more blocks when fewer fit.)
    fn leave(
        &self,
        one: &InOne<impl TreeHits<PACKET> + ?Sized>,
        i: usize,
        seen: &Seen<PACKET>,
        surfaces: &mut Surfaces,
    ) {
        let (placed, ray, t) = (one.at.placed, one.rays.ray(i), surfaces.t[i]);
        let normal = column(&surfaces.geometric, i);
        let leave = normal.as_dvec3() * (placed.extent() * LEAVE);
        let (position, width) = (ray.origin + ray.dir.as_dvec3() * t, one.rays.width(i, t));
        let to = &mut surfaces.leaving;
        (to.position[i], to.width[i]) = (position, width);
        if seen.cells() >> i & 1 == 1 {
            if seen.stand_ins().loose() >> i & 1 == 1 {
                let far = seen.stand_ins().leave(i, placed, &ray, t);
                to.from[i] = ray.origin + ray.dir.as_dvec3() * (t + (far - t) * INSIDE);
                (to.near[i], to.facing[i]) = (0.0, seen.stand_ins().facing(i));
                return;
            }
            let above = seen.stand_ins().above(i, &one.at.tree(), placed, &one.hits.hit(i), &ray, t);
            to.from[i] = back(&ray, t, normal, above + BESIDE * f64::from(width)) + leave;
            (to.near[i], to.facing[i]) = (0.0, seen.stand_ins().facing(i));
            return;
        }
        to.near[i] = if self.is_pressed { 0.0 } else { f64::from(width * DIAGONAL) };
        let from = if self.is_pressed { back(&ray, t, normal, BESIDE * f64::from(width)) } else { position };
        to.from[i] = from + leave;
        if let Some(normals) = seen.corner_normals(i) {
            let uv = {
                let hit = one.hits.hit(i);
                [hit.u, hit.v]
            };
            seen.each_triangle(1 << i, |_, corners| {
                to.from[i] = raised(from, placed, &corners, &normals, uv, normal) + leave;
            });
        }
    }

    /// Sets the distances at which rays go on behind surfaces that are not opaque, or that go through their origins.
    fn go_behind(&self, one: &InOne<impl TreeHits<PACKET> + ?Sized>, met: u32, at_origin: u32, out: &mut Out) {
        let Out { seen, surfaces, .. } = out;
        let placed = one.at.placed;
        let leave = placed.extent() * LEAVE;
        let is_clear = |i: &usize| at_origin >> i & 1 == 1 || surfaces.opacity[*i] < 1.0;
        for i in bits(met | at_origin).filter(is_clear) {
            let t = surfaces.t[i];
            let is_cell = seen.cells() >> i & 1 == 1;
            let behind = if is_cell { seen.stand_ins().leave(i, placed, &one.rays.ray(i), t) } else { t };
            surfaces.next[i] = behind + leave + one.ahead(i);
        }
    }
}

/// Returns the point above `position` from which shadow rays begin: on the surface that the planes across the corners'
/// normals span, where that is above the triangle. From the triangle itself, the shadows of coarse facets would end in
/// steps. (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, chapter 4.)
fn raised(
    position: DVec3,
    placed: &Placed,
    corners: &[Vec3; 3],
    normals: &[Vec3; 3],
    uv: [f32; 2],
    facing: Vec3,
) -> DVec3 {
    let mut raise = DVec3::ZERO;
    for ((corner, normal), weight) in corners.iter().zip(normals).zip(weights(uv)) {
        let Some(normal) = normal.try_normalize() else { continue };
        let normal = if normal.dot(facing) < 0.0 { -normal } else { normal };
        let above = (position - placed.world_point(corner.as_dvec3())).dot(normal.as_dvec3());
        raise -= normal.as_dvec3() * (above.min(0.0) * f64::from(weight));
    }
    position + raise
}

/// Copies the columns of `among`.
fn merge(among: u32, from: &Vectors, to: &mut Vectors) {
    for (from, to) in from.iter().zip(to) {
        for (i, (from, to)) in from.iter().zip(to).enumerate() {
            *to = if among >> i & 1 == 1 { *from } else { *to };
        }
    }
}

/// Returns the mask of the columns equal to `value`.
#[inline]
fn same(row: &Row<u32>, value: u32) -> u32 {
    let mut same = 0;
    for (i, v) in row.iter().enumerate() {
        same |= u32::from(*v == value) << i;
    }
    same
}
