//! Rays in a scene that is one placed tree, the most frequent kind: there is no top-level tree to walk.

use super::placed::{Placed, not_below};
use super::walk::{Found, Need, SceneStream, SceneView, bits};
use crate::math::Ray;
use crate::structure::bvh::trace::{LocalRay, Outcome, PACKET, PacketWalk, first_rays};

/// Shift and scale of rays that were not moved.
const UNMOVED: (f64, f64) = (0.0, 1.0);

impl SceneView<'_> {
    /// Up to a packet's rays together in a scene that is one placed tree, if they go the same way (see
    /// [`PacketWalk::is_coherent`]); else `None`. Returns the rays that hit something, whose `found` is then written, or
    /// the block that some ray needs: then they are to be begun anew, each alone.
    pub fn trace_together<const ANY: bool>(
        &self,
        rays: &[Ray],
        says: bool,
        walk: &mut PacketWalk,
        found: &mut [Found],
    ) -> Option<Result<u32, Need>> {
        let placed = self.only_one()?;
        let p = &self.scene.placement.placed[placed as usize];
        let (tree, filter) = (self.tree(placed), self.filter(placed));
        let mut moved = [UNMOVED; PACKET];
        let seen_by = self.seen_by(placed);
        let active = match set_unmoved(p, rays, seen_by, walk) {
            true if walk.is_within(&tree, rays.len(), p.near()) => first_rays(rays.len()),
            _ => set_moved(p, rays, seen_by, walk, &mut moved),
        };
        walk.start(&tree, active);
        if !walk.is_coherent(&tree, says) {
            return None;
        }
        let outcome = if ANY {
            tree.any_together(filter.as_ref(), walk)
        } else {
            tree.closest_together(filter.as_ref(), walk)
        };
        if let Outcome::Pending(block) = outcome {
            return Some(Err(self.need(placed, block)));
        }
        let mut hits = 0;
        for i in bits(walk.found()) {
            found[i] = Found::nothing(rays[i].t_max);
            found[i].offer::<ANY>(placed, walk.best(i), moved[i].0, moved[i].1);
            hits |= u32::from(found[i].is_hit()) << i;
        }
        Some(Ok(hits))
    }

    /// [`SceneView::trace_each`] in a scene that is one placed tree: side by side.
    pub(super) fn each_in_one<const ANY: bool>(&self, placed: u32, rays: &[Ray], walk: &mut SceneStream, found: &mut [Found]) {
        let p = &self.scene.placement.placed[placed as usize];
        let seen_by = self.seen_by(placed);
        let SceneStream { tree: stream, moved, hits, unfinished, .. } = walk;
        let hits = &mut hits[..rays.len()];
        let mut local = LocalRay::NONE;
        for (i, it) in rays.iter().enumerate() {
            match if it.mask & seen_by != 0 { p.local(it, it.t_max, &mut local) } else { None } {
                Some(way) => {
                    stream.set(i, &local);
                    moved[i] = way;
                }
                None => stream.set(i, &LocalRay::NONE),
            }
        }
        let (tree, filter) = (self.tree(placed), self.filter(placed));
        if ANY {
            tree.any_each(filter.as_ref(), stream, hits);
        } else {
            tree.closest_each(filter.as_ref(), stream, hits);
        }
        unfinished.extend_from_slice(stream.unfinished());
        for (i, (hit, found)) in hits.iter().zip(found).enumerate() {
            *found = Found::nothing(rays[i].t_max);
            found.offer::<ANY>(placed, *hit, moved[i].0, moved[i].1);
        }
    }
}

/// Takes rays into the tree's frame by nothing but a subtraction, which does not do for all: false if that is clear
/// here, else [`PacketWalk::is_within`] tells.
#[inline(always)]
fn set_unmoved(p: &Placed, rays: &[Ray], seen_by: u32, walk: &mut PacketWalk) -> bool {
    let Some(offset) = p.only_shifted() else { return false };
    let mut is_fine = true;
    let mut local = LocalRay::NONE;
    if let Some(it) = rays.first().filter(|first| rays.iter().all(|it| begin_alike(it, first))) {
        is_fine = it.has_interval();
        local.org = (it.origin - offset).as_vec3();
        local.t_min = it.t_min as f32;
        local.t_max = not_below(it.t_max);
        walk.set_all_but_dirs(&local);
        for (i, it) in rays.iter().enumerate().take(PACKET) {
            is_fine &= it.mask & seen_by != 0;
            walk.set_dir(i, it.dir, LocalRay::cone_of(it.cone, it.dir));
        }
        return is_fine;
    }
    for (i, it) in rays.iter().enumerate().take(PACKET) {
        is_fine &= it.mask & seen_by != 0 && it.has_interval();
        local.org = (it.origin - offset).as_vec3();
        local.dir = it.dir;
        local.cone = LocalRay::cone_of(it.cone, it.dir);
        local.t_min = it.t_min as f32;
        local.t_max = not_below(it.t_max);
        walk.set(i, &local);
    }
    is_fine
}

/// Whether two rays have the same origin and interval, to the bit: as those of a perspective camera do.
#[inline(always)]
fn begin_alike(a: &Ray, b: &Ray) -> bool {
    let bits = |ray: &Ray| [ray.origin.x, ray.origin.y, ray.origin.z, ray.t_min, ray.t_max].map(f64::to_bits);
    let (a, b) = (bits(a), bits(b));
    (a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2]) | (a[3] ^ b[3]) | (a[4] ^ b[4]) == 0
}

/// Takes rays into the tree's frame, whatever it takes; returns those that can hit something there.
#[inline(never)]
fn set_moved(p: &Placed, rays: &[Ray], seen_by: u32, walk: &mut PacketWalk, moved: &mut [(f64, f64); PACKET]) -> u32 {
    let mut active = 0;
    let mut local = LocalRay::NONE;
    for (i, it) in rays.iter().enumerate().take(PACKET) {
        if it.mask & seen_by != 0
            && let Some(way) = p.local(it, it.t_max, &mut local)
        {
            moved[i] = way;
            active |= 1 << i;
            walk.set(i, &local);
        }
    }
    active
}
