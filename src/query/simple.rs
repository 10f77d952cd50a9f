//! Hits of groups of rays that are simple to work out: in a scene of one tree that is not turned, where neither what takes double
//! precision nor what may have to be read is asked for. What is written is what [`super::finish`] writes.

use super::chunk::Answers;
use super::finish::is_within;
use super::hit::{Hit, HitKind, NONE, Want};
use super::stand_in::within;
use super::surfaces::{Surfaces, TreeHits};
use crate::math::{PACKET, Ray};
use crate::math::bits;
use crate::scene::walk::SceneView;

/// What is not simple.
const NOT_SIMPLE: Want = Want(Want::POSITION.0 | Want::ERROR.0 | Want::PRIM.0);

/// What it takes. Reusable.
#[derive(Debug, Default)]
pub(super) struct Simple {
    surfaces: Surfaces,
}

impl Simple {
    /// Works out the hits of rays, those of `met` with something in `found`, all in the placed tree `only`, which they reach at `distance`; false if that is not simple
    /// for all: then `answers` are not to be used.
    #[allow(clippy::too_many_arguments)] // rays, what they found, and where it goes
    pub fn answer(
        &mut self,
        view: &SceneView,
        only: u32,
        want: Want,
        rays: &[Ray],
        found: &(impl TreeHits + ?Sized),
        distance: impl Fn(usize) -> f64,
        met: u32,
        answers: &mut Answers,
    ) -> bool {
        if want.any_of(NOT_SIMPLE) {
            return false;
        }
        // However the tree is placed.
        if met == 0 {
            answers.begin(0, 0);
            return true;
        }
        let placed = &view.scene.placement.placed[only as usize];
        if placed.only_shifted().is_none() {
            return false;
        }
        let may_be_outside = |i: usize| {
            let (ray, t) = (&rays[i], distance(i));
            placed.is_near_end(ray, t) && (found.hit(i).stand_in().is_none() || !is_within(ray, t))
        };
        if view.looks_beyond && bits(met).any(may_be_outside) {
            return false;
        }
        let sees_surfaces = want.any_of(Want::SURFACE);
        let ray = |i: usize| (rays[i].origin, rays[i].dir);
        if sees_surfaces && !self.surfaces.look::<false>(view, only, ray, found, met) {
            return false;
        }
        let hits = answers.begin(met, 0);
        let instance = view.scene.instances[placed.instance as usize].id;
        for i in bits(met) {
            let (hit, at, t) = (&mut hits[i], found.hit(i), distance(i));
            let (kind, t, uv) = match at.stand_in() {
                None => (HitKind::Exact, t, [at.u, at.v]),
                Some(cell) if cell.is_missing => return false,
                Some(_) => (HitKind::Lod, within(t, &rays[i]), [0.0; 2]),
            };
            (hit.kind, hit.t) = (kind, t);
            if want.has(Want::UV) {
                hit.uv = uv;
            }
            if want.has(Want::INSTANCE) {
                hit.instance = instance;
            }
        }
        if sees_surfaces {
            self.add_surfaces(view, only, want, rays, hits);
        }
        true
    }

    /// Parts and normals of what was looked at.
    fn add_surfaces(&self, view: &SceneView, only: u32, want: Want, rays: &[Ray], hits: &mut [Hit; PACKET]) {
        let parts = view.model_of(only).parts();
        let id_of = |part: u32| parts.get(part as usize).map_or(NONE, |part| part.id);
        for triangle in self.surfaces.triangles() {
            let id = if want.has(Want::PART) { id_of(triangle.part) } else { NONE };
            for i in bits(triangle.rays) {
                hits[i].part = id;
                if want.has(Want::NORMAL) {
                    hits[i].normal = triangle.normal.facing(rays[i].dir);
                }
            }
        }
        for i in bits(self.surfaces.cells()) {
            let (normal, part) = self.surfaces.cell(i);
            if want.has(Want::PART) {
                hits[i].part = id_of(part);
            }
            if want.has(Want::NORMAL) {
                hits[i].normal = normal;
            }
        }
    }
}
