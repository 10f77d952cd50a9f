//! Cameras and transforms in the format of the header.

use super::guard::{Checked, Sized32, bad, boundary, out, read};
use super::overlap::oc_plane;
use super::query::oc_ray;
use super::status::oc_status;
use crate::query::Plane;
use crate::scene::Camera;
use crate::scene::camera::PixelRays;
use glam::{DAffine3, DVec2, DVec3};

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

/// Reads a camera for pictures of a size.
///
/// # Safety
/// `camera` is NULL or initialised.
unsafe fn rays_of(camera: *const oc_camera, width: u32, height: u32) -> Checked<PixelRays> {
    // SAFETY: the caller's contract.
    Ok(unsafe { read(camera)? }.to_rust()?.prepare(width, height)?)
}

fn picture_point(x: f64, y: f64) -> Checked<DVec2> {
    if x.is_finite() && y.is_finite() { Ok(DVec2::new(x, y)) } else { bad("a picture point must be finite") }
}

/// Returns the ray through a point of a picture, as frames trace it.
///
/// - `camera`: initialised with OC_INIT.
/// - `width`, `height`: size of the picture in pixels, above 0.
/// - `x`, `y`: the point in pixels from the top left corner; fractions are allowed, and points outside of the picture.
///   Must be finite. The centre of pixel (i, j) is (i + 0.5, j + 0.5).
/// - `out_ray`: receives the ray: no limits, all instances, a direction of length 1, and the footprint for 1 pixel of
///   error. For p pixels multiply `cone_a` and `cone_b` by sqrt(p); for exact answers set them to 0.
///
/// Single precision limits the direction: if a pixel is narrower than 1/16000 of its distance, as through long lenses,
/// frames use more digits than the ray has.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `camera` is initialised; `out_ray` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_camera_ray(
    camera: *const oc_camera,
    width: u32,
    height: u32,
    x: f64,
    y: f64,
    out_ray: *mut oc_ray,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_ray, "out_ray")?;
        let point = picture_point(x, y)?;
        let ray = rays_of(camera, width, height)?.ray(point.x, point.y);
        out.write_unaligned(oc_ray {
            origin: ray.origin.to_array(),
            t_min: 0.0,
            t_max: 0.0,
            direction: ray.dir.to_array(),
            cone_a: ray.cone.a,
            cone_b: ray.cone.b,
            mask: 0,
        });
        Ok(())
    })
}

/// Returns the half spaces that contain all that a camera sees within a rectangle of the picture, for
/// oc_scene_overlap_frustum: to select the parts in a rectangle that a user draws, also those behind others.
///
/// - `camera`: initialised with OC_INIT.
/// - `width`, `height`: size of the picture in pixels, above 0.
/// - `x0`, `y0`, `x1`, `y1`: two opposite corners in pixels from the top left corner of the picture, as for
///   oc_camera_ray. Must be finite.
/// - `out_planes`: receives 5 half spaces: four sides, and the plane through the eye. There is no far plane.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `camera` is initialised; `out_planes` has room for 5 elements.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_camera_frustum(
    camera: *const oc_camera,
    width: u32,
    height: u32,
    x0: f64,
    y0: f64,
    x1: f64,
    y1: f64,
    out_planes: *mut oc_plane,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_planes.cast::<[oc_plane; 5]>(), "out_planes")?;
        let corners = [picture_point(x0, y0)?, picture_point(x1, y1)?];
        let planes = Plane::frustum(&rays_of(camera, width, height)?, corners);
        out.write_unaligned(planes.map(|p| oc_plane { normal: p.normal.to_array(), d: p.d }));
        Ok(())
    })
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
