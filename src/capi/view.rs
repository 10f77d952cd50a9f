//! Cameras and transforms in the format of the header.

use super::guard::{Checked, Sized32, bad};
use crate::scene::Camera;
use glam::{DAffine3, DVec3};

/// Kind of a camera.
pub type oc_camera_kind = u32;
/// All rays start at the eye.
pub const OC_CAMERA_PERSPECTIVE: oc_camera_kind = 0;
/// Parallel rays start on a plane through the eye. Nothing behind the plane is visible.
pub const OC_CAMERA_ORTHOGRAPHIC: oc_camera_kind = 1;

/// A camera in world space. All numbers must be finite.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_camera {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// One of the OC_CAMERA_ constants.
    pub kind: oc_camera_kind,
    /// Position of the eye. Orthographic: the centre of the picture's plane.
    pub eye: [f64; 3],
    /// Target point. Only the direction from the eye to it matters. Must differ from the eye.
    pub at: [f64; 3],
    /// Direction that is up in the picture. Need not be unit. Must not be parallel to the view. All 0: +Z.
    pub up: [f64; 3],
    /// Perspective: vertical field of view in degrees, above 0 and below 180. 0: 45. Orthographic: ignored.
    pub fov_y: f64,
    /// Orthographic: height of the picture in world units, above 0. Perspective: ignored.
    pub height: f64,
}

// SAFETY: `repr(C)`, integers and doubles without padding, `struct_size` first.
unsafe impl Sized32 for oc_camera {
    const NAME: &'static str = "oc_camera";
}

impl oc_camera {
    pub(crate) fn to_rust(self) -> Checked<Camera> {
        let (eye, at) = (DVec3::from_array(self.eye), DVec3::from_array(self.at));
        let up = if self.up == [0.0; 3] { DVec3::Z } else { DVec3::from_array(self.up) };
        match self.kind {
            OC_CAMERA_PERSPECTIVE => {
                let fov_y_degrees = if self.fov_y == 0.0 { 45.0 } else { self.fov_y };
                Ok(Camera::Perspective { eye, at, up, fov_y_degrees })
            }
            OC_CAMERA_ORTHOGRAPHIC => Ok(Camera::Orthographic { eye, at, up, height: self.height }),
            other => bad(format!("oc_camera.kind {other} is unknown")),
        }
    }

    pub(crate) fn from_rust(camera: &Camera) -> Self {
        let (kind, eye, at, up, fov_y, height) = match *camera {
            Camera::Perspective { eye, at, up, fov_y_degrees } => {
                (OC_CAMERA_PERSPECTIVE, eye, at, up, fov_y_degrees, 0.0)
            }
            Camera::Orthographic { eye, at, up, height } => (OC_CAMERA_ORTHOGRAPHIC, eye, at, up, 0.0, height),
        };
        let (eye, at, up) = (eye.to_array(), at.to_array(), up.to_array());
        Self { struct_size: 0, kind, eye, at, up, fov_y, height }
    }
}

/// Reads a transform: 12 doubles by column.
///
/// # Safety
/// `matrix` is NULL (the identity) or points to 12 readable doubles.
pub(crate) unsafe fn transform(matrix: *const f64) -> DAffine3 {
    if matrix.is_null() {
        return DAffine3::IDENTITY;
    }
    // SAFETY: the caller's contract. `read_unaligned` needs no alignment.
    let columns = unsafe { matrix.cast::<[f64; 12]>().read_unaligned() };
    DAffine3::from_cols_array(&columns)
}

/// Reads three doubles.
///
/// # Safety
/// `pointer` is NULL or points to three readable doubles.
pub(crate) unsafe fn three(pointer: *const f64, name: &str) -> Checked<DVec3> {
    if pointer.is_null() {
        return bad(format!("{name} is NULL"));
    }
    // SAFETY: the pointer is not null and points to three doubles by the contract.
    Ok(DVec3::from_array(unsafe { pointer.cast::<[f64; 3]>().read_unaligned() }))
}
