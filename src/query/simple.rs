//! Hits of packets that are simple to work out: in a scene of one tree that is not turned, where neither what takes double
//! precision nor what may have to be read is asked for. What is written is what [`super::finish`] writes.

use super::chunk::forget;
use super::hit::{Hit, HitKind, NONE, Want};
use super::finish::faces_away;
use super::surfaces::Surfaces;
use crate::math::Ray;
use crate::scene::InOne;
use crate::scene::walk::{SceneView, bits};
use crate::structure::bvh::trace::{PACKET, first_rays};

/// What is not simple.
const NOT_SIMPLE: Want = Want(Want::POSITION.0 | Want::ERROR.0 | Want::PRIM.0);

/// What it takes. Reusable.
#[derive(Debug, Default)]
pub(super) struct Simple {
    surfaces: Surfaces,
}

impl Simple {
    /// Works out the hits of the rays that were traced in `traced`, those of `met` with something; false if that is not simple
    /// for all: then `hits` are not to be used.
    pub fn answer(
        &mut self,
        view: &SceneView,
        want: Want,
        rays: &[Ray],
        traced: &InOne,
        met: u32,
        hits: &mut [Hit; PACKET],
    ) -> bool {
        let Some(only) = view.only_one().filter(|_| !want.any_of(NOT_SIMPLE)) else { return false };
        let placed = &view.scene.placement.placed[only as usize];
        if placed.only_shifted().is_none() {
            return false;
        }
        if !want.any_of(Want::SURFACE) {
            return without_surfaces(want, rays, traced, met, hits);
        }
        let Self { surfaces } = self;
        if !surfaces.look::<false>(view, only, |i| (rays[i].origin, rays[i].dir), &traced.walk, met) {
            return false;
        }
        forget(!met & first_rays(rays.len()), hits);
        let parts = view.model_of(only).parts();
        let id_of = |part: u32| parts.get(part as usize).map_or(NONE, |part| part.id);
        for facet in surfaces.triangles() {
            let id = if want.has(Want::PART) { id_of(facet.part) } else { NONE };
            for i in bits(facet.rays) {
                let hit = &mut hits[i];
                (hit.kind, hit.t, hit.part) = (HitKind::Exact, traced.distance(i), id);
                if want.has(Want::UV) {
                    hit.uv = traced.walk.weights(i);
                }
                if want.has(Want::NORMAL) {
                    let turn = faces_away(facet.across, rays[i].dir.as_dvec3());
                    hit.normal = if turn { -facet.unit } else { facet.unit };
                }
            }
        }
        for i in bits(surfaces.cells()) {
            let (hit, (normal, part)) = (&mut hits[i], surfaces.cell(i));
            (hit.kind, hit.t) = (HitKind::Lod, traced.distance(i).min(rays[i].t_max).max(rays[i].t_min));
            if want.has(Want::UV) {
                hit.uv = [0.0; 2];
            }
            if want.has(Want::PART) {
                hit.part = id_of(part);
            }
            if want.has(Want::NORMAL) {
                hit.normal = normal;
            }
        }
        if want.has(Want::INSTANCE) {
            let instance = view.scene.instances[placed.instance as usize].id;
            bits(met).for_each(|i| hits[i].instance = instance);
        }
        true
    }
}

/// [`Simple::answer`] where nothing is asked of what was hit, as whether anything is.
fn without_surfaces(want: Want, rays: &[Ray], traced: &InOne, met: u32, hits: &mut [Hit; PACKET]) -> bool {
    if want.has(Want::INSTANCE) {
        return false;
    }
    forget(!met & first_rays(rays.len()), hits);
    for i in bits(met) {
        let (hit, at) = (&mut hits[i], traced.walk.best(i));
        (hit.kind, hit.t) = (HitKind::Exact, traced.distance(i));
        if want.has(Want::UV) {
            hit.uv = [at.u, at.v];
        }
        match at.stand_in() {
            None => {}
            Some(cell) if cell.is_missing => return false,
            Some(_) => {
                (hit.kind, hit.t) = (HitKind::Lod, hit.t.min(rays[i].t_max).max(rays[i].t_min));
                if want.has(Want::UV) {
                    hit.uv = [0.0; 2];
                }
            }
        }
    }
    true
}
