//! Batches of rays in single precision: less memory to read and write for each ray.

use super::guard::{Checked, Sized32, Strided, bad, boundary, read, reserved};
use super::handles::{self, Shell};
use super::query::{
    CAny, OC_QUERY_COHERENT, OC_QUERY_NOW, OC_WANT_INSTANCE, OC_WANT_NORMAL, OC_WANT_PART, OC_WANT_PRIM, OC_WANT_T,
    OC_WANT_UV, oc_hit_kind, oc_query_flags, oc_want,
};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::math::{Cone, Ray};
use crate::query::{Hit, Hits, Policy, QueryOptions, Rays, Want};
use glam::Vec3;

/// A ray in single precision, in world space.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_ray_f32 {
    /// Start point. Not finite: the ray misses. Far from zero single precision has few digits: use oc_ray there.
    pub origin: [f32; 3],
    /// Start of the interval, as in oc_ray.
    pub t_min: f32,
    /// Direction, as in oc_ray.
    pub direction: [f32; 3],
    /// End of the interval, as in oc_ray. 0: no end.
    pub t_max: f32,
}

/// Rays in single precision as a structure of arrays: one array for each number, without gaps.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_rays_soa {
    /// x, y and z of the start points.
    pub origin: [*const f32; 3],
    /// x, y and z of the directions.
    pub direction: [*const f32; 3],
    /// Starts of the intervals. NULL: 0 for all rays.
    pub t_min: *const f32,
    /// Ends of the intervals. NULL: no end for all rays.
    pub t_max: *const f32,
}

/// A hit in single precision. Members that are not in `oc_query_f32.want` are as for a miss.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_hit_f32 {
    /// Distance from the origin, in units of the direction's length. Miss: infinity.
    pub t: f32,
    /// Unit geometric normal in world space, on the side of the ray's origin. Miss: 0.
    pub normal: [f32; 3],
    /// Barycentric weights of the triangle's second and third corner. Miss: 0.
    pub uv: [f32; 2],
    /// The lowest 32 bits of the part's id. Miss: 0xFFFFFFFF.
    pub part: u32,
    /// The lowest 32 bits of the instance's id. Miss: 0xFFFFFFFF.
    pub instance: u32,
    /// As oc_hit.prim. Miss: 0xFFFFFFFF.
    pub prim: u32,
    /// One of the OC_HIT_ constants.
    pub kind: oc_hit_kind,
}

/// A batch of rays in single precision. The rays are exact: they have no footprint.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_query_f32 {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// OC_WANT_T, OC_WANT_NORMAL, OC_WANT_UV, OC_WANT_PART, OC_WANT_INSTANCE, OC_WANT_PRIM, combined with `|`. 0: all
    /// of these.
    pub want: oc_want,
    /// OC_QUERY_ flags, combined with `|`.
    pub flags: oc_query_flags,
    /// Must be 0.
    pub reserved: u32,
    /// The rays, or NULL. Nothing may write to them until the call has returned.
    pub rays: *const oc_ray_f32,
    /// The rays as a structure of arrays, or NULL. One of both must be given.
    pub columns: *const oc_rays_soa,
    /// Number of rays.
    pub count: u64,
    /// Bytes from one of `rays` to the next. 0: tightly packed.
    pub stride: u64,
}

// SAFETY: `repr(C)`, integers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_query_f32 {
    const NAME: &'static str = "oc_query_f32";
}

/// All that a hit in single precision can hold.
const ALL: oc_want = OC_WANT_T | OC_WANT_NORMAL | OC_WANT_UV | OC_WANT_PART | OC_WANT_INSTANCE | OC_WANT_PRIM;

impl oc_query_f32 {
    fn options(&self) -> Checked<QueryOptions> {
        reserved(self.reserved, "oc_query_f32.reserved")?;
        if self.want & !ALL != 0 {
            return bad(format!("oc_query_f32.want {:#x}: unknown flags, or flags of oc_query alone", self.want));
        }
        if self.flags & !(OC_QUERY_COHERENT | OC_QUERY_NOW) != 0 {
            return bad(format!("oc_query_f32.flags {:#x}: unknown flags", self.flags));
        }
        let want = Want(if self.want == 0 { ALL } else { self.want } >> 1);
        let policy = if self.flags & OC_QUERY_NOW != 0 { Policy::Now } else { Policy::Exact };
        Ok(QueryOptions { coherent: self.flags & OC_QUERY_COHERENT != 0, want, policy })
    }

    /// # Safety
    /// `columns` is NULL or readable.
    unsafe fn source(&self) -> Checked<RaysF32> {
        if self.rays.is_null() == self.columns.is_null() && self.count > 0 {
            return bad("oc_query_f32: one of rays and columns must be given");
        }
        if self.columns.is_null() {
            return Ok(RaysF32::Rows(Strided::new(self.rays, self.count, self.stride, "oc_query_f32.rays")?));
        }
        // SAFETY: the caller's contract.
        let columns = unsafe { self.columns.read_unaligned() };
        let column =
            |base: *const f32, name: &str| Strided::new(base, self.count, 0, &format!("oc_query_f32.columns: {name}"));
        let three = |bases: [*const f32; 3], name: &str| -> Checked<[Strided<f32>; 3]> {
            Ok([column(bases[0], name)?, column(bases[1], name)?, column(bases[2], name)?])
        };
        let some = |base: *const f32, name: &str| (!base.is_null()).then(|| column(base, name)).transpose();
        Ok(RaysF32::Columns {
            origin: three(columns.origin, "origin")?,
            direction: three(columns.direction, "direction")?,
            t_min: some(columns.t_min, "t_min")?,
            t_max: some(columns.t_max, "t_max")?,
            count: self.count as usize,
        })
    }
}

/// The caller's rays.
enum RaysF32 {
    Rows(Strided<oc_ray_f32>),
    Columns {
        origin: [Strided<f32>; 3],
        direction: [Strided<f32>; 3],
        t_min: Option<Strided<f32>>,
        t_max: Option<Strided<f32>>,
        count: usize,
    },
}

/// Converts a ray. All conversions are exact.
#[inline(always)]
fn ray_of(origin: [f32; 3], dir: [f32; 3], t_min: f32, t_max: f32) -> Ray {
    let t_max = if t_max == 0.0 { f64::INFINITY } else { f64::from(t_max) };
    Ray { t_min: f64::from(t_min), t_max, cone: Cone::ZERO, ..Ray::new(Vec3::from(origin).as_dvec3(), Vec3::from(dir)) }
}

impl Rays for RaysF32 {
    fn count(&self) -> usize {
        match self {
            Self::Rows(rays) => rays.count,
            Self::Columns { count, .. } => *count,
        }
    }

    fn read(&self, first: usize, out: &mut [Ray]) {
        match self {
            Self::Rows(rays) => {
                for (i, out) in out.iter_mut().enumerate() {
                    // SAFETY: within the array, which the caller keeps readable until the batch has ended.
                    let ray = unsafe { rays.get(first + i) };
                    *out = ray_of(ray.origin, ray.direction, ray.t_min, ray.t_max);
                }
            }
            Self::Columns { origin, direction, t_min, t_max, .. } => {
                for (i, out) in out.iter_mut().enumerate() {
                    // SAFETY: as above, of each array.
                    let at = |column: &Strided<f32>| unsafe { column.get(first + i) };
                    let three = |columns: &[Strided<f32>; 3]| [at(&columns[0]), at(&columns[1]), at(&columns[2])];
                    let t_max = t_max.as_ref().map_or(0.0, at);
                    *out = ray_of(three(origin), three(direction), t_min.as_ref().map_or(0.0, at), t_max);
                }
            }
        }
    }
}

/// The caller's array of hits.
struct HitsF32(Strided<oc_hit_f32>);

impl Hits for HitsF32 {
    fn write(&self, first: usize, hits: &[Hit]) {
        for (i, hit) in hits.iter().enumerate() {
            let hit = oc_hit_f32 {
                t: hit.t as f32,
                normal: hit.normal.to_array(),
                uv: hit.uv,
                // An id of none has all bits set.
                part: hit.part as u32,
                instance: hit.instance as u32,
                prim: hit.prim as u32,
                kind: hit.kind as oc_hit_kind,
            };
            // SAFETY: within the array, which only the library uses until the batch has ended. One worker writes each
            // index.
            unsafe { self.0.set(first + i, hit) };
        }
    }
}

/// Finds the closest hit of each ray in the committed scene, as oc_scene_closest does, for rays in single precision.
/// The hits are those of oc_scene_closest, rounded. A ray takes 32 bytes instead of 64, a hit 40 instead of 104.
///
/// - `query`: the rays and options. Initialise it with OC_INIT.
/// - `out_hits`: receives one hit for each ray. Must not overlap the rays. Do not use it if the call fails.
/// - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
///
/// Errors: as for oc_scene_closest.
///
/// Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; `query` is initialised; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_closest_f32(
    scene: *const oc_scene,
    query: *const oc_query_f32,
    out_hits: *mut oc_hit_f32,
    hit_stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let query = read(query)?;
        let (options, rays) = (query.options()?, query.source()?);
        let hits = HitsF32(Strided::new(out_hits, query.count, hit_stride, "out_hits")?);
        handles::with(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.shown().closest_batch(&rays, &hits, options)?)
        })
    })
}

/// Tests whether each ray hits anything in the committed scene, as oc_scene_any does, for rays in single precision.
///
/// - `query`: the rays and options. `want` has no effect, but must be valid.
/// - `out_any`, `any_stride`: as for oc_scene_any. Must not overlap the rays.
///
/// Errors: as for oc_scene_closest.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; `query` is initialised; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_any_f32(
    scene: *const oc_scene,
    query: *const oc_query_f32,
    out_any: *mut u8,
    any_stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let query = read(query)?;
        let (options, rays) = (query.options()?, query.source()?);
        let hits = CAny(Strided::new(out_any, query.count, any_stride, "out_any")?);
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.shown().any_batch(&rays, &hits, options)?))
    })
}

const _: () = assert!(size_of::<oc_ray_f32>() == 32 && size_of::<oc_hit_f32>() == 40);
