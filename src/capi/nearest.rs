//! Nearest points, and the distance of two sets of parts.

use super::clash::{oc_part_set, set_of};
use super::guard::{Checked, Fill, Sized32, Strided, bad, boundary, read, read_or_default, reserved};
use super::handles::{self, Shell};
use super::inside::oc_holds;
use super::query::{oc_hit_kind, same_places};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::query::PartSet;
use crate::query::{DistanceOptions, NearestOptions, NearestPoint, Policy, SetDistance};
use glam::DVec3;

/// Flags of oc_nearest_desc.
pub type oc_nearest_flags = u32;
/// Fill `oc_nearest_point.holds`: whether a part of the set holds the point. Not together with OC_NEAREST_NOW.
pub const OC_NEAREST_INSIDE: oc_nearest_flags = 1;
/// Answer at once from the data in memory. The exact distance is within `oc_nearest_point.error` of each answer. The
/// call neither reads nor requests data (oc_scene_prefetch_box does). Without the flag, the call reads all data that it
/// needs, and the answers do not depend on the data in memory.
pub const OC_NEAREST_NOW: oc_nearest_flags = 2;

/// A batch of points whose nearest points are searched. All zeros: no points, of all parts, without a limit.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_nearest_desc {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// OC_NEAREST_ flags, combined with `|`.
    pub flags: oc_nearest_flags,
    /// The points, 3 doubles each, world space. Must be finite. May be NULL if `count` is 0.
    pub points: *const f64,
    /// Number of points.
    pub count: u64,
    /// Bytes from one point to the next. 0: tightly packed.
    pub stride: u64,
    /// The parts that are searched. NULL: all parts.
    pub parts: *const oc_part_set,
    /// Distance in world units beyond which nothing is found. 0: no limit.
    pub max_distance: f64,
}

// SAFETY: `repr(C)`, numbers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_nearest_desc {
    const NAME: &'static str = "oc_nearest_desc";
}

/// The nearest point of the surfaces of parts. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_nearest_point {
    /// Distance from the point that was asked for to the nearest triangle, in world units, also from inside of a part.
    /// Miss: infinity.
    pub distance: f64,
    /// The exact distance differs from `distance` by no more than this, in world units: rounding and stored positions,
    /// and with OC_HIT_MISSING what is not in memory. Infinity: the exact distance is `distance` or more, and may be
    /// beyond the limit. Miss: 0.
    pub error: f64,
    /// The nearest point, world space. OC_HIT_MISSING without a part: the middle of a box that holds surface, or
    /// infinity. Miss: infinity.
    pub position: [f64; 3],
    /// Id of the instance, as passed to oc_scene_add_instance. OC_NO_ID: unknown, or a miss.
    pub instance: u64,
    /// Id of the part, as passed when the model was built. OC_NO_ID: unknown, or a miss.
    pub part: u64,
    /// As oc_hit.prim. OC_NO_ID: unknown, or a miss.
    pub prim: u64,
    /// OC_HIT_EXACT. OC_HIT_MISS: no triangle is within the limit. OC_HIT_MISSING, only with OC_NEAREST_NOW: data is
    /// not in memory, so that the distance or the id of the triangle is not exact.
    pub kind: oc_hit_kind,
    /// With OC_NEAREST_INSIDE one of the OC_HOLDS_ constants if a part of the set holds the point that was asked for.
    /// Otherwise 0.
    pub holds: oc_holds,
}
same_places!(oc_nearest_point, NearestPoint: distance is distance, error is error, position is position,
    instance is instance, part is part, prim is prim, kind is kind, holds is holds);

/// A search for the distance of two sets of parts. All zeros: of all parts, the nearest two.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_distance_desc {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Must be 0.
    pub reserved: u32,
    /// The first set. NULL: all parts.
    pub first: *const oc_part_set,
    /// The second set. NULL: the other parts of `first`.
    pub second: *const oc_part_set,
    /// Distance in world units beyond which nothing is found: the search then ends early. 0: no limit.
    pub max_distance: f64,
}

// SAFETY: `repr(C)`, numbers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_distance_desc {
    const NAME: &'static str = "oc_distance_desc";
}

/// The distance of two sets of parts, and two points that have it. The first of two is of the first set; of one set,
/// that of the instance that was added first, or of the part that is first in the model.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_distance {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// 1: found. 0: the distance is greater than the limit, or there are no two parts. Other members are then not set,
    /// and `distance` is infinity.
    pub found: u32,
    /// Distance in world units. 0: triangles have a common point.
    pub distance: f64,
    /// Bound of the error of `distance`, in world units: of rounding and of stored positions. 0 if `distance` is 0.
    pub error: f64,
    /// The point of the first set, world space.
    pub first_point: [f64; 3],
    /// The point of the second set, world space.
    pub second_point: [f64; 3],
    /// Ids of the instances.
    pub instance: [u64; 2],
    /// Ids of the parts.
    pub part: [u64; 2],
    /// Indices of the triangles in the inputs of the builds, from 0.
    pub prim: [u64; 2],
}

// SAFETY: `repr(C)`, numbers without padding, `struct_size` first.
unsafe impl Sized32 for oc_distance {
    const NAME: &'static str = "oc_distance";
}

/// Number of points that are answered at a time.
const SOME: usize = 1 << 16;

/// The limit that 0 stands for.
fn no_limit(max_distance: f64) -> f64 {
    if max_distance == 0.0 { f64::INFINITY } else { max_distance }
}

impl oc_nearest_desc {
    /// # Safety
    /// `parts` is NULL or a live handle.
    unsafe fn options(&self) -> Checked<NearestOptions> {
        if self.flags & !(OC_NEAREST_INSIDE | OC_NEAREST_NOW) != 0 {
            return bad(format!("oc_nearest_desc.flags {:#x}: unknown flags", self.flags));
        }
        // SAFETY: the caller's contract.
        let set = unsafe { set_of(self.parts)? };
        let options = NearestOptions {
            set: set.unwrap_or_else(PartSet::all),
            max_distance: no_limit(self.max_distance),
            policy: if self.flags & OC_NEAREST_NOW != 0 { Policy::Now } else { Policy::Exact },
            inside: self.flags & OC_NEAREST_INSIDE != 0,
        };
        options.check()?;
        Ok(options)
    }
}

/// Finds, for each point, the nearest point of the visible parts of the committed scene.
///
/// Distances are exact within `oc_nearest_point.error`. Of triangles at the same distance, that of the instance added
/// first counts, of one instance that of the part that comes first in the model, and then that with the least index.
///
/// - `desc`: the points and options. Initialise it with OC_INIT.
/// - `out_points`: receives one answer for each point. Do not use it if the call fails.
/// - `out_stride`: bytes from one answer to the next. 0: tightly packed.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a point is not finite, the limit is negative or NaN, the set is empty or names an
///   instance or part that the scene lacks, a flag is unknown, or both flags are set.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
///
/// Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; `desc` is initialised; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_nearest(
    scene: *const oc_scene,
    desc: *const oc_nearest_desc,
    out_points: *mut oc_nearest_point,
    out_stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let desc = read(desc)?;
        let points = Strided::new(desc.points.cast::<[f64; 3]>(), desc.count, desc.stride, "oc_nearest_desc.points")?;
        let out = Strided::new(out_points, desc.count, out_stride, "out_points")?;
        let options = desc.options()?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let state = scene.scene.state();
            let most = SOME.min(points.count);
            let (mut some, mut answers) = (vec![DVec3::ZERO; most], vec![NearestPoint::MISS; most]);
            // Sets without points are checked too.
            for first in (0..points.count.max(1)).step_by(SOME) {
                let count = SOME.min(points.count - first);
                for (i, point) in some[..count].iter_mut().enumerate() {
                    *point = points.get(first + i).into();
                    if !point.is_finite() {
                        return bad(format!("point {} is not finite: {point}", first + i));
                    }
                }
                state.nearest(&some[..count], &options, &mut answers[..count])?;
                // Both structs have the same members at the same places.
                out.copy_from(first, &answers[..count]);
            }
            Ok(())
        })
    })
}

impl From<Option<SetDistance>> for oc_distance {
    fn from(found: Option<SetDistance>) -> Self {
        let nothing = SetDistance {
            distance: f64::INFINITY,
            error: 0.0,
            points: [DVec3::INFINITY; 2],
            instances: [crate::query::NONE; 2],
            parts: [crate::query::NONE; 2],
            prims: [crate::query::NONE; 2],
        };
        let of = found.unwrap_or(nothing);
        Self {
            struct_size: 0,
            found: u32::from(found.is_some()),
            distance: of.distance,
            error: of.error,
            first_point: of.points[0].to_array(),
            second_point: of.points[1].to_array(),
            instance: of.instances,
            part: of.parts,
            prim: of.prims,
        }
    }
}

/// Finds the distance between the visible parts of two sets in the committed scene, and the two nearest points.
///
/// The distance is that of surfaces: a part inside of another one has a distance from it. Whether it is 0 is decided
/// in exact arithmetic on corners that are placed once in double precision. A part is not compared with itself, even
/// if it is in both sets; parts of one instance are compared with each other. Of several pairs of points at the same
/// distance one is returned, the same in each call: it does not depend on the number of threads, on the order of the
/// sets or on the blocks in memory.
///
/// - `desc`: the sets and the limit. Initialise it with OC_INIT. NULL: all zeros.
/// - `out_distance`: receives the distance. Initialise it with OC_INIT.
///
/// Errors: as for oc_scene_nearest.
///
/// Thread safety: any thread. Frames and batches may be in flight. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; `desc` is NULL or initialised; `out_distance` is initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_distance(
    scene: *const oc_scene,
    desc: *const oc_distance_desc,
    out_distance: *mut oc_distance,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_distance)?;
        let desc = read_or_default(desc)?;
        reserved(desc.reserved, "oc_distance_desc.reserved")?;
        let options = DistanceOptions {
            a: set_of(desc.first)?.unwrap_or_else(PartSet::all),
            b: set_of(desc.second)?,
            max_distance: no_limit(desc.max_distance),
        };
        handles::with(scene, |scene: &Shell<SceneObject>| {
            fill.with(oc_distance::from(scene.scene.state().distance(&options)?));
            Ok(())
        })
    })
}
