//! Questions to closed parts: which parts hold a point, and how thick a part is.

use super::crossings::Rows;
use super::guard::{Strided, boundary};
use super::handles::{self, Shell};
use super::query::{oc_hit, same_places};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::query::{Hit, HitKind, PartAt};
use glam::{DVec3, Vec3};

/// The relation of a part to a point.
pub type oc_holds = u32;
/// The part is closed (OC_PART_CLOSED), and the point is inside.
pub const OC_HOLDS_INSIDE: oc_holds = 1;
/// The part is not closed, and the point is within its bounds: nothing says whether it is inside.
pub const OC_HOLDS_UNDECIDED: oc_holds = 2;

/// A part at a point. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_part_at {
    /// Id of the instance, as passed to oc_scene_add_instance.
    pub instance: u64,
    /// Id of the part, as passed when the model was built.
    pub part: u64,
    /// How many times the surface surrounds the point: 1 in a solid whose triangles face outward, -1 if they face
    /// inward. Without OC_PART_ORIENTED: 1. OC_HOLDS_UNDECIDED: 0.
    pub winding: i32,
    /// One of the OC_HOLDS_ constants.
    pub holds: oc_holds,
}
same_places!(oc_part_at, PartAt: instance is instance, part is part, winding is winding, holds is holds);

/// Number of points or hits that are answered at a time.
const SOME: usize = 4096;

/// Finds the visible parts that hold points.
///
/// A ray from the point decides. A part with OC_PART_ORIENTED holds the point if the ray leaves the part more often or
/// less often than it enters it. A part with OC_PART_CLOSED alone holds the point if the ray crosses it an odd number
/// of times. A part without these flags is reported as OC_HOLDS_UNDECIDED if the point is within its bounds. A point
/// nearer to a surface than rounding may be counted on either side. No part holds a point that is not finite.
///
/// - `points`: 3 doubles each, world space.
/// - `count`: number of points.
/// - `stride`: bytes from one point to the next. 0: tightly packed.
/// - `out_parts`: receives the parts of the first point, then those of the second, and so on. The parts of a point are
///   ordered by instance (in the order added), then by part (in the model's order).
/// - `capacity`: number of elements that `out_parts` has room for. 0: only `out_ends` and `out_count` are written,
///   `out_parts` is ignored.
/// - `out_ends`: receives, for each point, the number of parts of all points up to and including this one.
/// - `out_count`: receives the number of parts of all points.
///
/// Errors:
/// - OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of parts. `out_ends` and `out_count` are
///   written all the same; do not use `out_parts`.
/// - Otherwise as for oc_scene_crossings.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_parts_at(
    scene: *const oc_scene,
    points: *const f64,
    count: u64,
    stride: u64,
    out_parts: *mut oc_part_at,
    capacity: u64,
    out_ends: *mut u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let points = Strided::new(points.cast::<[f64; 3]>(), count, stride, "points")?;
        let mut rows = Rows::new((out_parts, "out_parts"), capacity, out_ends, count, out_count)?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let state = scene.scene.state();
            let mut some = vec![DVec3::ZERO; SOME.min(points.count)];
            for first in (0..points.count).step_by(SOME) {
                let some = &mut some[..SOME.min(points.count - first)];
                some.iter_mut().enumerate().for_each(|(i, point)| *point = points.get(first + i).into());
                state.parts_at(some, &mut |point, parts| rows.add(first + point, parts))?;
            }
            rows.finish()
        })
    })
}

/// Measures how thick parts are at hits: the distance from each hit straight into the part, against the normal, to the
/// opposite side of the same part and instance.
///
/// The opposite side is the first triangle behind the hit that faces the other way than the one that was hit. For a
/// part that is not closed it may lie beyond a hole.
///
/// - `hits`: hits of oc_scene_closest or of a pick. Their `kind`, `position`, `normal`, `part` and `instance` must be
///   set; `prim` and `error` help at edges.
/// - `count`: number of hits.
/// - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
/// - `out_thickness`: receives the distances, in world units: infinity if there is no opposite side, or if the hit is a
///   miss. Do not use it if the call fails.
/// - `stride`: bytes from one distance to the next. 0: tightly packed.
///
/// Errors: as for oc_scene_crossings.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_thickness(
    scene: *const oc_scene,
    hits: *const oc_hit,
    count: u64,
    hit_stride: u64,
    out_thickness: *mut f64,
    stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let hits = Strided::new(hits, count, hit_stride, "hits")?;
        let out = Strided::new(out_thickness, count, stride, "out_thickness")?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let state = scene.scene.state();
            for first in (0..hits.count).step_by(SOME) {
                let last = hits.count.min(first + SOME);
                let some: Vec<Hit> = (first..last).map(|i| measured(&hits.get(i))).collect();
                for (i, thickness) in state.thickness(&some)?.into_iter().enumerate() {
                    out.set(first + i, thickness);
                }
            }
            Ok(())
        })
    })
}

/// The members of a hit that decide the thickness. (The kind of the caller's hit may be any number.)
fn measured(hit: &oc_hit) -> Hit {
    let kind = if hit.kind == super::query::OC_HIT_MISS { HitKind::Miss } else { HitKind::Exact };
    Hit {
        position: DVec3::from(hit.position),
        normal: Vec3::from(hit.normal),
        part: hit.part,
        instance: hit.instance,
        prim: hit.prim,
        error: hit.error,
        kind,
        ..Hit::MISS
    }
}
