//! Cameras that show a scene, or chosen parts of it, as large as the picture allows.

use super::guard::{Checked, Fill, Sized32, Strided, bad, boundary, read, reserved};
use super::handles::{self, Shell};
use super::looks::{oc_parts_flags, scope};
use super::model::{oc_up_axis, up_axis};
use super::query::OC_NO_ID;
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use super::view::{OC_CAMERA_ORTHOGRAPHIC, OC_CAMERA_PERSPECTIVE, oc_camera, oc_camera_kind};
use crate::scene::{Chosen, Fit, Lens, MARGIN, NamedView};
use glam::DVec3;

/// Direction of a view, relative to an up axis. Front is the side towards -Y if Z is up, +Z if Y is up, +Y if X is up.
/// Left and right are as seen from the front.
pub type oc_view = u32;
/// From the front, the right and above, all three at the same angle.
pub const OC_VIEW_ISO_FRONT_RIGHT: oc_view = 0;
/// From the front, the left and above.
pub const OC_VIEW_ISO_FRONT_LEFT: oc_view = 1;
/// From the back, the right and above.
pub const OC_VIEW_ISO_BACK_RIGHT: oc_view = 2;
/// From the back, the left and above.
pub const OC_VIEW_ISO_BACK_LEFT: oc_view = 3;
/// From the front.
pub const OC_VIEW_FRONT: oc_view = 4;
/// From the back.
pub const OC_VIEW_BACK: oc_view = 5;
/// From the left.
pub const OC_VIEW_LEFT: oc_view = 6;
/// From the right.
pub const OC_VIEW_RIGHT: oc_view = 7;
/// From above. The back is up in the picture.
pub const OC_VIEW_TOP: oc_view = 8;
/// From below. The front is up in the picture.
pub const OC_VIEW_BOTTOM: oc_view = 9;
/// Along `direction` of oc_fit.
pub const OC_VIEW_ALONG: oc_view = 10;

/// The picture for which oc_scene_fit finds a camera. `width` and `height` must be set.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_fit {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Kind of the camera: one of the OC_CAMERA_ constants.
    pub kind: oc_camera_kind,
    /// Width of the picture in pixels, 1 to 65536.
    pub width: u32,
    /// Height of the picture in pixels, 1 to 65536.
    pub height: u32,
    /// One of the OC_VIEW_ constants.
    pub view: oc_view,
    /// Up axis that `view` refers to: one of the OC_UP_ constants. OC_UP_UNKNOWN: +Z.
    pub up_axis: oc_up_axis,
    /// OC_VIEW_ALONG: direction of the view, from the eye; finite and not zero, need not be unit. Otherwise ignored.
    pub direction: [f64; 3],
    /// OC_VIEW_ALONG: direction that is up in the picture, not parallel to `direction`. All 0: that of `up_axis`, or of
    /// OC_VIEW_TOP or OC_VIEW_BOTTOM if that is parallel to `direction`. Otherwise ignored.
    pub up: [f64; 3],
    /// OC_CAMERA_PERSPECTIVE: vertical field of view in degrees, above 0 and below 180. 0: 45. Otherwise ignored.
    pub fov_y: f64,
    /// Share of the width and of the height that stays free on each side, below 0.5. 0: 0.05. Below 0: none.
    pub margin: f64,
    /// OC_PARTS_ flags for the chosen parts, combined with `|`, or 0.
    pub flags: oc_parts_flags,
    /// Must be 0.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, integers and doubles without padding, `struct_size` first.
unsafe impl Sized32 for oc_fit {
    const NAME: &'static str = "oc_fit";
}

/// A part of an instance. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_part_ref {
    /// Id of the instance, as passed to oc_scene_add_instance.
    pub instance: u64,
    /// Id of the part, as passed when the model was built. If several parts of the model have it, the first is meant.
    /// OC_NO_ID: all parts of the instance.
    pub part: u64,
}

impl oc_fit {
    fn to_rust(self) -> Checked<Fit> {
        reserved(self.reserved, "oc_fit.reserved")?;
        let axis = up_axis(self.up_axis, "oc_fit.up_axis")?;
        let (direction, up) = match NamedView::ALL.get(self.view as usize) {
            Some(view) => view.directions(axis),
            None if self.view == OC_VIEW_ALONG => {
                let direction = DVec3::from_array(self.direction);
                let up = (self.up != [0.0; 3]).then(|| DVec3::from_array(self.up));
                (direction, up.unwrap_or_else(|| NamedView::up_along(direction, axis)))
            }
            None => return bad(format!("oc_fit.view {} is unknown", self.view)),
        };
        let lens = match self.kind {
            OC_CAMERA_PERSPECTIVE => Lens::Perspective(if self.fov_y == 0.0 { 45.0 } else { self.fov_y }),
            OC_CAMERA_ORTHOGRAPHIC => Lens::Orthographic,
            other => return bad(format!("oc_fit.kind {other} is unknown")),
        };
        let margin = match self.margin {
            0.0 => MARGIN,
            below if below < 0.0 => 0.0,
            other => other,
        };
        Ok(Fit { direction, up, lens, size: (self.width, self.height), margin })
    }
}

/// Returns the camera that shows the visible parts of the scene, or chosen ones, as large as the picture allows: their
/// boxes touch the margin on two opposite sides, and lie within it on the others.
///
/// - `scene`: the committed state. Hidden parts and instances do not count.
/// - `fit`: the picture and the view. Initialise it with OC_INIT.
/// - `parts`: array of parts that are to be shown. Ignored if `count` is 0: all are.
/// - `count`: number of parts.
/// - `stride`: bytes from one part to the next. 0: tightly packed. With the size of an oc_overlap, the array may be the
///   result of oc_scene_overlap_box or oc_scene_overlap_frustum.
/// - `out_camera`: receives the camera. Initialise it with OC_INIT.
///
/// The box of a part is that of its own triangles in the model, placed with the instance. A part with no triangles of
/// its own, such as an assembly, has none: OC_PARTS_BELOW adds the parts below it. Parts without a size, such as a
/// point, are shown from a distance of 1.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a member of `fit` is out of range, or there is no such instance or part.
/// - OC_STATUS_INVALID_STATE: none of the parts is visible and has triangles.
///
/// Thread safety: any thread. Cheap. Takes time in proportion to the number of parts and instances.
/// # Safety
/// `scene` is a live handle; `fit` and `out_camera` are initialised; the array is as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_fit(
    scene: *const oc_scene,
    fit: *const oc_fit,
    parts: *const oc_part_ref,
    count: u64,
    stride: u64,
    out_camera: *mut oc_camera,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_camera)?;
        let given = read(fit)?;
        let (fit, scope) = (given.to_rust()?, scope(given.flags)?);
        let parts = Strided::new(parts, count, stride, "parts")?;
        let mut chosen = crate::base::memory::room(parts.count, "the chosen parts")?;
        for i in 0..parts.count {
            let oc_part_ref { instance, part } = parts.get(i);
            chosen.push(Chosen { instance, part: (part != OC_NO_ID).then_some(part) });
        }
        handles::with(scene, |scene: &Shell<SceneObject>| {
            fill.with(oc_camera::from_rust(&scene.scene.state().fit(&fit, &chosen, scope)?));
            Ok(())
        })
    })
}
