//! Which parts meet a volume.

use super::guard::{Checked, Failure, Strided, bad, boundary, out};
use super::handles::{self, Shell};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use super::view::three;
use crate::math::DBounds;
use crate::query::{PartOverlap, Plane};
use glam::DVec3;

/// How a part meets a volume.
pub type oc_overlap_kind = u32;
/// Some of it is inside or touches.
pub const OC_OVERLAP_INTERSECTS: oc_overlap_kind = 1;
/// All of it is inside.
pub const OC_OVERLAP_INSIDE: oc_overlap_kind = 2;

/// A part that meets a volume; an element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_overlap {
    /// The id of the instance.
    pub instance: u64,
    /// The id of the part.
    pub part: u64,
    /// An OC_OVERLAP_ number.
    pub kind: oc_overlap_kind,
    /// 0.
    pub reserved: u32,
}

/// A half space, the points p with dot(normal, p) + d >= 0; an element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_plane {
    /// Points inward; need not be unit.
    pub normal: [f64; 3],
    /// In units of the normal's length.
    pub d: f64,
}

/// More planes than any volume has: a larger count is a mistake.
const MAX_PLANES: u64 = 4096;

/// Hands out a list: the count always, the elements if they fit.
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
        // SAFETY: below `capacity`.
        unsafe { out_parts.set(i, oc_overlap { instance, part, kind, reserved: 0 }) };
    }
    Ok(())
}

/// Finds the visible parts that meet a box, exactly: by triangle. `box_min` and `box_max`: 3 doubles each,
/// world space; the box is closed. An empty one meets nothing; NaN is refused.
///
/// `out_count` gets how many there are. With `capacity` 0 that is all (`out_parts` is ignored); else they
/// are written if they fit, and OC_STATUS_BUFFER_TOO_SMALL says that they do not. By instance in the order
/// added, then by part in the model's order. Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// Live handle; arrays as said; `out_count` writable.
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

/// Finds the visible parts that meet the intersection of half spaces (a frustum has 6; 1 to 4096), exactly: by
/// triangle.
///
/// The list comes out as that of oc_scene_overlap_box. Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// Live handle; arrays as said; `out_count` writable.
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
            return bad(format!("{plane_count} planes; at most {MAX_PLANES}"));
        }
        if plane_count == 0 {
            return bad("plane_count is 0: without planes there is no volume");
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
