//! Points of surfaces under hits: deferred shading.

use super::geometry::{hit_of_c, in_batch};
use super::guard::{Checked, Strided, bad, boundary};
use super::handles::{self, Shell};
use super::query::{
    OC_HIT_EXACT, OC_HIT_LOD, OC_HIT_MISS, OC_HIT_MISSING, OC_QUERY_NOW, oc_hit, oc_query_flags, same_places,
};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::base::progress::Cancel;
use crate::query::{Hit, HitKind, Policy, SurfaceAt};
use glam::Vec3;

/// Where the members of oc_surface_point come from.
pub type oc_evaluated = u32;
/// The hit is a miss: `position` is infinite, all other members are 0.
pub const OC_EVALUATED_NOTHING: oc_evaluated = 0;
/// The surface, evaluated at the parameters of the hit.
pub const OC_EVALUATED_SURFACE: oc_evaluated = 1;
/// A triangle, and the normals at its corners.
pub const OC_EVALUATED_TRIANGLE: oc_evaluated = 2;
/// The hit is OC_HIT_LOD: `position` and `normal` are those of the hit, all other members are 0.
pub const OC_EVALUATED_STAND_IN: oc_evaluated = 3;
/// The hit is OC_HIT_MISSING, or with OC_QUERY_NOW the data of its triangle is not in memory. Members as for
/// OC_EVALUATED_STAND_IN.
pub const OC_EVALUATED_MISSING: oc_evaluated = 4;

/// A point of a surface, in world space. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_surface_point {
    /// The point of the surface, off `oc_hit.position` by up to the tolerance of dicing; or of the triangle, off by its
    /// rounding error.
    pub position: [f64; 3],
    /// First derivative by the first of `oc_hit.uv`. These parameters are u and v in the face on a surface with
    /// OC_STRUCTURE_PATCH, otherwise the weights of the triangle's second and third corner: `du` is then the edge from
    /// the first to the second corner, `dv` that to the third.
    pub du: [f64; 3],
    /// First derivative by the second of `oc_hit.uv`.
    pub dv: [f64; 3],
    /// Unit normal with which the surface is shaded, interpolated on triangles. It does not depend on the ray: it is on
    /// the outer side of a mesh whose corners appear counter-clockwise from outside, also where an instance is
    /// mirrored. Turn it to the eye by its sign with `oc_hit.normal`. 0 for a triangle without an area.
    pub normal: [f64; 3],
    /// Principal curvatures in units of 1 / length, the larger one first: positive where the surface bends towards
    /// `normal`, so both are -1 / r on the outside of a sphere of radius r. On triangles they are those of a surface
    /// with the interpolated normals, which approach the true ones as triangles become finer, and 0 where the model
    /// has no normals.
    pub curvatures: [f64; 2],
    /// One of the OC_EVALUATED_ constants.
    pub kind: oc_evaluated,
    /// A face with other than four corners consists, with OC_STRUCTURE_PATCH, of a quad at each: the number of the
    /// corner, from 0, in whose quad the hit's parameters are. Otherwise 0.
    pub corner: u32,
}

same_places!(oc_surface_point, SurfaceAt: position is position, du is du, dv is dv, normal is normal,
    curvatures is curvatures, kind is kind, corner is corner);

/// Greatest number of hits that are evaluated at a time.
const BATCH: usize = 1 << 14;

/// Evaluates the surfaces at hits, in world space: for deferred shading, for texture footprints, or to show how a
/// surface bends under the cursor.
///
/// - `hits`: hits of oc_scene_closest or oc_frame_pick in this scene. Those of kind OC_HIT_EXACT need `position`,
///   `part`, `instance` and `prim`; with `occurrence` they are found sooner, and on the right one of coincident
///   meshes. Stand-ins and misses may be among them.
/// - `count`: number of hits.
/// - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
/// - `flags`: 0, or OC_QUERY_NOW: the call answers from the data in memory; it neither waits nor reads.
/// - `out_points`: receives one point for each hit. Do not use it if the call fails.
/// - `point_stride`: bytes from one point to the next. 0: tightly packed.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: an exact hit has not all of these members, or no triangle of the committed scene has
///   its ids at its position, for instance after a commit that moved it. A hit has an unknown kind; a flag is unknown.
///   The message names the hit's number.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: a block cannot be read.
///
/// Performance: what is in memory is evaluated by all threads of the context. Hits whose data must be read are
/// evaluated one by one.
///
/// Thread safety: any thread. Blocks; may read the disk without OC_QUERY_NOW.
/// # Safety
/// `scene` is a live handle; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_evaluate(
    scene: *const oc_scene,
    hits: *const oc_hit,
    count: u64,
    hit_stride: u64,
    flags: oc_query_flags,
    out_points: *mut oc_surface_point,
    point_stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        if flags & !OC_QUERY_NOW != 0 {
            return bad(format!("flags {flags:#x}: only OC_QUERY_NOW is allowed"));
        }
        let policy = if flags & OC_QUERY_NOW != 0 { Policy::Now } else { Policy::Exact };
        let hits: Strided<oc_hit> = Strided::new(hits, count, hit_stride, "hits")?;
        let points = Strided::new(out_points, count, point_stride, "out_points")?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let state = scene.scene.state();
            for first in (0..hits.count).step_by(BATCH) {
                let range = first..hits.count.min(first + BATCH);
                let batch = range.map(|i| hit(i, hits.get(i))).collect::<Checked<Vec<Hit>>>()?;
                let found = state.evaluate(&batch, policy, &Cancel::new()).map_err(|error| in_batch(error, first))?;
                points.copy_from(first, &found);
            }
            Checked::Ok(())
        })
    })
}

/// A hit with its kind and its normals.
fn hit(number: usize, hit: oc_hit) -> Checked<Hit> {
    let kind = match hit.kind {
        OC_HIT_MISS => HitKind::Miss,
        OC_HIT_EXACT => HitKind::Exact,
        OC_HIT_LOD => HitKind::Lod,
        OC_HIT_MISSING => HitKind::Missing,
        other => return bad(format!("hit {number}: kind {other} is unknown")),
    };
    let [normal, shading_normal] = [hit.normal, hit.shading_normal].map(Vec3::from);
    Ok(Hit { kind, normal, shading_normal, ..hit_of_c(hit) })
}
