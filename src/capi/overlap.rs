//! Overlap queries: the parts that intersect a volume.

use super::guard::{Checked, Failure, Strided, bad, boundary, out};
use super::handles::{self, Shell};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use super::view::three;
use crate::math::DBounds;
use crate::query::{PartOverlap, Plane};
use glam::DVec3;

/// How a part intersects a volume.
pub type oc_overlap_kind = u32;
/// Some of the part is inside the volume or touches it.
pub const OC_OVERLAP_INTERSECTS: oc_overlap_kind = 1;
/// All of the part is inside the volume.
pub const OC_OVERLAP_INSIDE: oc_overlap_kind = 2;

/// A part that intersects a volume. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_overlap {
    /// Id of the instance, as passed to oc_scene_add_instance.
    pub instance: u64,
    /// Id of the part, as passed when the model was built.
    pub part: u64,
    /// One of the OC_OVERLAP_ constants.
    pub kind: oc_overlap_kind,
    /// Always 0.
    pub reserved: u32,
}

/// A half space: the points p with dot(normal, p) + d >= 0, in world space. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_plane {
    /// Normal of the plane. Points inward. Must be finite and not zero; need not be unit.
    pub normal: [f64; 3],
    /// Offset of the plane, in units of the normal's length. Must be finite.
    pub d: f64,
}

/// No volume needs more planes: a larger count is a mistake of the caller.
const MAX_PLANES: u64 = 4096;

/// Writes the result: always the count, and the elements if they fit.
///
/// # Safety
/// `out_parts` has room for `capacity` elements; `out_count` is writable.
unsafe fn hand_out(found: &[PartOverlap], out_parts: &Strided<oc_overlap>, out_count: *mut u64) -> Checked<()> {
    let need = found.len() as u64;
    // SAFETY: the caller's contract.
    unsafe { out_count.write(need) };
    if out_parts.count == 0 {
        return Ok(());
    }
    if found.len() > out_parts.count {
        return Err(Failure::TooSmall { need, have: out_parts.count as u64 });
    }
    for (i, part) in found.iter().enumerate() {
        let (instance, part, kind) = (part.instance, part.part, part.how as u32);
        // SAFETY: the index is below `capacity`.
        unsafe { out_parts.set(i, oc_overlap { instance, part, kind, reserved: 0 }) };
    }
    Ok(())
}

/// Finds the visible parts that intersect a box. The test is exact: it tests triangles, not bounds.
///
/// - `scene`: the committed state is searched.
/// - `box_min`, `box_max`: 3 doubles each, world space. The box is closed (its surface belongs to it). An empty box
///   intersects nothing.
/// - `out_parts`: receives the parts, ordered by instance (in the order added), then by part (in the model's order).
/// - `capacity`: number of elements that `out_parts` has room for. 0: only the count is written, `out_parts` is
///   ignored.
/// - `out_count`: receives the number of parts found, also with OC_STATUS_BUFFER_TOO_SMALL.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a coordinate is NaN.
/// - OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of parts.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; the arrays are as documented; `out_count` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_overlap_box(
    scene: *const oc_scene,
    box_min: *const f64,
    box_max: *const f64,
    out_parts: *mut oc_overlap,
    capacity: u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out_count = out(out_count, "out_count")?;
        let bounds = DBounds { min: three(box_min, "box_min")?, max: three(box_max, "box_max")? };
        let parts = Strided::new(out_parts, capacity, 0, "out_parts")?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            hand_out(&scene.scene.state().overlap_box(&bounds)?, &parts, out_count)
        })
    })
}

/// Finds the visible parts that intersect the common part of half spaces, e.g. a frustum. The test is exact: it tests
/// triangles, not bounds.
///
/// - `planes`: `plane_count` half spaces, tightly packed, world space.
/// - `plane_count`: 1 to 4096. A frustum has 6.
/// - `scene`, `out_parts`, `capacity`, `out_count`: as for oc_scene_overlap_box.
///
/// Errors: as for oc_scene_overlap_box. OC_STATUS_INVALID_ARGUMENT also if a plane is not finite or its normal is zero.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; the arrays are as documented; `out_count` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_overlap_frustum(
    scene: *const oc_scene,
    planes: *const oc_plane,
    plane_count: u64,
    out_parts: *mut oc_overlap,
    capacity: u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out_count = out(out_count, "out_count")?;
        if plane_count > MAX_PLANES {
            return bad(format!("plane_count is {plane_count}; it must be at most {MAX_PLANES}"));
        }
        if plane_count == 0 {
            return bad("plane_count is 0; a volume needs at least one plane");
        }
        let planes = Strided::new(planes, plane_count, 0, "planes")?;
        let parts = Strided::new(out_parts, capacity, 0, "out_parts")?;
        let plane = |p: oc_plane| Plane { normal: DVec3::from_array(p.normal), d: p.d };
        let planes: Vec<Plane> = (0..planes.count).map(|i| plane(planes.get(i))).collect();
        handles::with(scene, |scene: &Shell<SceneObject>| {
            hand_out(&scene.scene.state().overlap_frustum(&planes)?, &parts, out_count)
        })
    })
}
