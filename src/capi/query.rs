//! Batches of rays over a committed scene.

use super::guard::{Checked, Sized32, Strided, bad, boundary, out, read, reserved};
use super::handles::{self, Shell};
use super::job::{LongWork, Snapshot, Wake, give_job, oc_job};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::math::Ray;
use crate::query::{AHEAD, Hit, Hits, PACKET, Policy, Query, QueryOptions, QueryState, Rays, Want};
use std::sync::Arc;
use std::time::Duration;

/// A ray. Element of an array. Distances `t` along a ray are in units of the length of `direction`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_ray {
    /// Start point, world space. Not finite: the ray misses.
    pub origin: [f64; 3],
    /// Start of the interval: hits with a smaller `t` are ignored. Below 0: counts as 0. Infinite or NaN: the ray
    /// misses.
    pub t_min: f64,
    /// End of the interval: hits with a greater `t` are ignored. 0: no end. Below `t_min` or NaN: the ray misses.
    pub t_max: f64,
    /// Direction; need not be unit. Zero or not finite: the ray misses. Components below 1.2e-38 count as zero.
    pub direction: [f32; 3],
    /// Footprint of the ray: its width at `t` is `cone_a + cone_b * t`, in world units. A stand-in may replace
    /// triangles if the area of its box, projected along the ray, is at most the square of the width there.
    ///
    /// - Exact answers: `cone_a` = 0, `cone_b` = 0.
    /// - p pixels of error, perspective camera, direction of length 1 along the view axis: `cone_a` = 0,
    ///   `cone_b` = sqrt(p) * 2 tan(fov_y / 2) / (height of the picture in pixels). For a unit direction at the angle a
    ///   to that axis, times cos(a).
    /// - p pixels of error, orthographic camera: `cone_b` = 0,
    ///   `cone_a` = sqrt(p) * (height of the picture in world units) / (height of the picture in pixels).
    ///
    /// Below 0 or NaN: counts as 0. Infinite: the coarsest stand-ins.
    pub cone_a: f32,
    /// See `cone_a`.
    pub cone_b: f32,
    /// The ray can hit an instance only if the masks of both have a common bit. 0: all instances.
    pub mask: u32,
}

/// Kind of a hit.
pub type oc_hit_kind = u32;
/// No hit between t_min and t_max, or stand-ins in the interval transmitted the ray (see `t_free`).
pub const OC_HIT_MISS: oc_hit_kind = 0;
/// Hit on an original triangle, of any opacity (also 0), unless its part or instance is hidden.
pub const OC_HIT_EXACT: oc_hit_kind = 1;
/// Hit on a stand-in as fine as the ray's cone requires: a cell that contains original surface.
/// - `t`: where the ray enters the cell.
/// - `normal`: mean normal of the surface visible there.
/// - `part`: the part with the largest visible area, over all directions.
/// - `uv`, `prim`: as for a miss.
///
/// A cell may hold several instances: `part`, `instance` and `occurrence` are then those of the one with the largest
/// visible area. A cell with wires, leaves or the like is a partly open stand-in: it transmits the same share of rays
/// as its content does (see `t_free`).
pub const OC_HIT_LOD: oc_hit_kind = 2;
/// Hit on a stand-in that is coarser than required, because the data below it is not in memory. Only frames and
/// OC_QUERY_NOW return it. Members as for OC_HIT_LOD.
///
/// An exact hit whose primitive id was requested (OC_WANT_PRIM, part of the default) but is not in memory has this kind
/// too. Its other members are those of the exact hit; `prim` is OC_NO_ID.
///
/// Exception: if the ray starts inside of the cell, `t` is where it leaves the cell and `t_free` is t_min: the cell may
/// contain surface anywhere.
pub const OC_HIT_MISSING: oc_hit_kind = 3;

/// The value of ids that are not set: of a miss, or not requested.
pub const OC_NO_ID: u64 = 0xFFFFFFFFFFFFFFFF;

/// Refuses OC_NO_ID as an id.
pub(super) fn check_id(id: u64) -> Checked<()> {
    if id == OC_NO_ID { bad("OC_NO_ID must not be used as an id") } else { Ok(()) }
}

/// Closest hit of a ray. Element of an array. Members that were not requested have the values of a miss.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_hit {
    /// Distance from the origin, in units of the direction's length. Miss: infinity.
    ///
    /// The interval includes both ends. oc_scene_crossings finds all surfaces along a ray. (Tracing the ray again from
    /// behind each hit does not: of coincident surfaces it finds one, and at `t` = 0 it may return the same surface for
    /// ever.) Exceptions:
    /// - Two surfaces closer to each other than `t - t_free` may be returned in either order.
    /// - Within the single-precision rounding error of the origin, a surface behind the origin may be returned at 0,
    ///   and one in front of it may be missed.
    /// - Within the same error of an end of the interval, a surface that the ray meets within about 4 degrees of
    ///   edge-on may be missed.
    ///
    /// Precision: double with `OC_WANT_POSITION` or `OC_WANT_ERROR`, otherwise single. In single precision, the error
    /// on long thin triangles near the origin can exceed the last digits.
    pub t: f64,
    /// Position in world space. Miss: infinity.
    pub position: [f64; 3],
    /// No original surface lies on the ray before this distance. Exceptions: surfaces that the ray meets within 0.9
    /// degrees of edge-on, the surface that the ray starts on, and edges that it grazes.
    ///
    /// - Exact hit: `t` less the possible rounding error.
    /// - Miss: infinity.
    /// - Stand-in, and a hit or a miss of a ray that entered stand-ins before: the distance at which the ray first
    ///   entered one, less the possible rounding error. (A stand-in may transmit the ray.)
    pub t_free: f64,
    /// Id of the part, as passed when the model was built. Miss: OC_NO_ID.
    pub part: u64,
    /// Id of the instance, as passed to oc_scene_add_instance. Miss: OC_NO_ID.
    pub instance: u64,
    /// Index of the triangle in the input of the build, from 0. On a surface with OC_STRUCTURE_PATCH that of the face,
    /// among the faces of all surfaces in the order in which they were added: the faces of a cage, or the rectangles
    /// between the knots of a NURBS surface. Miss: OC_NO_ID.
    pub prim: u64,
    /// Unit geometric normal in world space, on the side of the ray's origin. Miss: 0.
    pub normal: [f32; 3],
    /// Barycentric weights of the triangle's second and third corner. On a surface with OC_STRUCTURE_PATCH the
    /// parameters u and v in the face, from 0 to 1, also of a stand-in of one face: those of its middle. u runs along
    /// the first edge of a face of four corners; other faces consist of a quad at each corner, in which the parameters
    /// are (`oc_surface_point.corner` says in which). A stand-in of several faces: 0. Miss: 0.
    pub uv: [f32; 2],
    /// An original surface lies within this distance of `position`, in world units. Miss: 0.
    pub error: f32,
    /// One of the OC_HIT_ constants.
    pub kind: oc_hit_kind,
    /// Unit normal in world space with which the surface is shaded, on the side of `normal`: interpolated between the
    /// corners of the triangle, so that coarse facets appear smooth. Where a model has no such normals, and for
    /// stand-ins, it is `normal`. Miss: 0.
    pub shading_normal: [f32; 3],
    /// Number of the place at which the mesh was hit, with OC_WANT_INSTANCE: it tells the places of one mesh in an
    /// instance apart, and the instances of scenes in scenes (oc_scene_get_path). It holds for the commit. Miss:
    /// OC_NO_ID.
    pub occurrence: u64,
}

/// Flags: members of oc_hit to compute, combined with `|`. Fewer members take less time.
pub type oc_want = u32;
/// Only `t` and `kind`, which are always set.
pub const OC_WANT_T: oc_want = 1;
/// `position`.
pub const OC_WANT_POSITION: oc_want = 2;
/// `normal`.
pub const OC_WANT_NORMAL: oc_want = 4;
/// `uv`.
pub const OC_WANT_UV: oc_want = 8;
/// `part`.
pub const OC_WANT_PART: oc_want = 16;
/// `instance`.
pub const OC_WANT_INSTANCE: oc_want = 32;
/// `prim`. May have to read the disk.
pub const OC_WANT_PRIM: oc_want = 64;
/// `error` and `t_free`; `t` in double precision.
pub const OC_WANT_ERROR: oc_want = 128;
/// All members but `shading_normal`.
pub const OC_WANT_ALL: oc_want = 255;
/// `shading_normal`. May have to read the disk.
pub const OC_WANT_SHADING_NORMAL: oc_want = 256;

/// Flags of oc_query.
pub type oc_query_flags = u32;
/// Hint: each 32 successive rays start near each other and have similar directions. They are traced as one packet,
/// which is faster. The answers do not change. Without the flag, the library recognises rays of neighbouring pixels if
/// they enter few placed meshes.
pub const OC_QUERY_COHERENT: oc_query_flags = 1;
/// Answer at once from the data in memory. Stand-ins replace missing data; their hits are OC_HIT_MISSING. The call
/// neither reads nor requests data (oc_scene_prefetch_box does). Without the flag, the call reads all data that it
/// needs, and the answers do not depend on the data in memory.
pub const OC_QUERY_NOW: oc_query_flags = 2;

/// A batch of rays.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_query {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// OC_WANT_ flags, combined with `|`. 0: OC_WANT_ALL.
    pub want: oc_want,
    /// OC_QUERY_ flags, combined with `|`.
    pub flags: oc_query_flags,
    /// Must be 0.
    pub reserved: u32,
    /// The rays. Nothing may write to them until the call has returned or the job has ended.
    pub rays: *const oc_ray,
    /// Number of rays.
    pub count: u64,
    /// Bytes from one ray to the next. 0: tightly packed.
    ///
    /// Performance: the library reads 32 successive rays without a copy if they are tightly packed and aligned as
    /// oc_ray, and none has a `t_max` or `mask` of 0. Use INFINITY and 0xFFFFFFFF instead.
    pub stride: u64,
}

// SAFETY: `repr(C)`, integers and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_query {
    const NAME: &'static str = "oc_query";
}

impl oc_query {
    pub(super) fn options(&self) -> Checked<QueryOptions> {
        reserved(self.reserved, "oc_query.reserved")?;
        if self.want & !(OC_WANT_ALL | OC_WANT_SHADING_NORMAL) != 0 {
            return bad(format!("oc_query.want {:#x}: unknown flags", self.want));
        }
        if self.flags & !(OC_QUERY_COHERENT | OC_QUERY_NOW) != 0 {
            return bad(format!("oc_query.flags {:#x}: unknown flags", self.flags));
        }
        // The first bit of the header, the distance, is always on. The crate has the other bits, one place lower.
        let want = if self.want == 0 { Want::ALL } else { Want(self.want >> 1) };
        let policy = if self.flags & OC_QUERY_NOW != 0 { Policy::Now } else { Policy::Exact };
        Ok(QueryOptions { coherent: self.flags & OC_QUERY_COHERENT != 0, want, policy })
    }
}

/// The caller's rays.
pub(super) struct CRays {
    rays: Strided<oc_ray>,
    /// The hits are not written between the rays, so that references to rays are allowed.
    may_lend: bool,
}

impl CRays {
    /// The rays of a batch whose answers go to `answers`.
    pub(super) fn new<T: Copy>(query: &oc_query, answers: &Strided<T>) -> Checked<Self> {
        let rays = Strided::new(query.rays, query.count, query.stride, "oc_query.rays")?;
        Ok(Self { rays, may_lend: !rays.meets(answers) })
    }
}

impl Rays for CRays {
    fn count(&self) -> usize {
        self.rays.count
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        // SAFETY: within the array, which the caller keeps readable until the batch has ended. Both structs have the
        // same members at the same places (asserted below). All are numbers, for which any bits are valid.
        unsafe { self.rays.copy_to(first, out) };
        for ray in out {
            if ray.t_max == 0.0 {
                ray.t_max = f64::INFINITY;
            }
            if ray.mask == 0 {
                ray.mask = u32::MAX;
            }
        }
    }
    fn packet(&self, first: usize) -> Option<&[Ray; PACKET]> {
        self.rays.ask_for(first + AHEAD..first + AHEAD + PACKET);
        // SAFETY: as for `read`. The caller promises not to write the rays meanwhile, and `may_lend` says that the hits
        // are elsewhere.
        let rays: &[Ray; PACKET] = if self.may_lend { unsafe { self.rays.array(first) }? } else { return None };
        // `read` replaces zeros in these members. (Without branches: otherwise there are two for each ray.)
        let have_zeros = rays.iter().fold(false, |any, ray| any | (ray.t_max == 0.0) | (ray.mask == 0));
        (!have_zeros).then_some(rays)
    }
}

/// Asserts that the members of two structs lie at the same offsets.
macro_rules! same_places {
    ($c:ty, $rust:ty: $($theirs:tt is $ours:tt),+) => {
        const _: () = assert!(size_of::<$c>() == size_of::<$rust>());
        $(const _: () = assert!(std::mem::offset_of!($c, $theirs) == std::mem::offset_of!($rust, $ours));)+
    };
}
pub(super) use same_places;
same_places!(oc_ray, Ray: origin is origin, t_min is t_min, t_max is t_max, direction is dir, cone_a is cone, mask is mask);
same_places!(oc_hit, Hit: t is t, position is position, t_free is t_free, part is part, instance is instance,
    prim is prim, normal is normal, uv is uv, error is error, kind is kind, shading_normal is shading_normal,
    occurrence is occurrence);

/// The caller's array of hits.
struct CHits(Strided<oc_hit>);

impl Hits for CHits {
    fn write(&self, first: usize, hits: &[Hit]) {
        // SAFETY: within the array, which only the library uses until the batch has ended. One worker writes each
        // index. Both structs have the same members at the same offsets, and no bytes between them.
        unsafe { self.0.copy_from(first, hits) };
    }
}

/// Writes one hit to the caller's memory.
///
/// # Safety
/// `out` is writable; it need not be aligned.
pub(super) unsafe fn write_hit(out: *mut oc_hit, hit: &Hit) {
    // SAFETY: the caller's contract. Both structs have the same members at the same offsets.
    unsafe { out.cast::<Hit>().write_unaligned(*hit) };
}

/// The caller's array of bytes: 1 for a ray that hits anything.
pub(super) struct CAny(pub(super) Strided<u8>);

impl Hits for CAny {
    fn write(&self, first: usize, hits: &[Hit]) {
        for (i, hit) in hits.iter().enumerate() {
            // SAFETY: as for `CHits`.
            unsafe { self.0.set(first + i, u8::from(hit.kind as u32 != OC_HIT_MISS)) };
        }
    }
    fn write_any(&self, first: usize, count: usize, met: u32) {
        for i in 0..count {
            // SAFETY: as for `CHits`.
            unsafe { self.0.set(first + i, (met >> i & 1) as u8) };
        }
    }
}

/// Finds the closest hit of each ray in the committed scene.
///
/// - `query`: the rays and options. Initialise it with OC_INIT.
/// - `out_hits`: receives one hit for each ray. Do not use it if the call fails.
/// - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
///
/// Errors: OC_STATUS_IO, OC_STATUS_CORRUPT if a block of the model cannot be read.
///
/// Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; `query` is initialised; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_closest(
    scene: *const oc_scene,
    query: *const oc_query,
    out_hits: *mut oc_hit,
    hit_stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let query = read(query)?;
        let options = query.options()?;
        let hits = CHits(Strided::new(out_hits, query.count, hit_stride, "out_hits")?);
        let rays = CRays::new(&query, &hits.0)?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.shown().closest_batch(&rays, &hits, options)?)
        })
    })
}

/// Tests whether each ray hits anything in the committed scene. Faster than oc_scene_closest.
///
/// - `query`: the rays and options. `want` has no effect, but must be valid.
/// - `out_any`: receives one byte for each ray: 1 for a hit, 0 for none. Do not use it if the call fails.
/// - `any_stride`: bytes from one answer to the next. 0: tightly packed.
///
/// With OC_QUERY_NOW, 1 also means that the missing data may contain a hit. With a footprint, 0 also means that
/// stand-ins transmitted the ray.
///
/// On a long thin triangle that the ray meets edge-on, the distance may have an error that is greater than its last
/// digits in single precision. Such a hit may count here, while oc_scene_closest, which computes positions and errors
/// in double precision, finds it outside of the interval.
///
/// Errors: as for oc_scene_closest.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; `query` is initialised; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_any(
    scene: *const oc_scene,
    query: *const oc_query,
    out_any: *mut u8,
    any_stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let query = read(query)?;
        let options = query.options()?;
        let hits = CAny(Strided::new(out_any, query.count, any_stride, "out_any")?);
        let rays = CRays::new(&query, &hits.0)?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.shown().any_batch(&rays, &hits, options)?))
    })
}

/// A batch in flight behind an `oc_job`.
struct QueryWork(Query);

impl QueryWork {
    fn snapshot(status: crate::query::QueryStatus) -> Snapshot {
        let base = match (status.state, &status.error) {
            (QueryState::Running, _) => Snapshot::running(),
            (QueryState::Done, _) => Snapshot::done(),
            (QueryState::Failed, Some(error)) => Snapshot::ended_with(error),
            (QueryState::Cancelled | QueryState::Failed, _) => Snapshot::cancelled(),
        };
        Snapshot { fraction: status.fraction, done: status.done, total: status.total, ..base }
    }
}

impl LongWork for QueryWork {
    fn poll(&self) -> Snapshot {
        Self::snapshot(self.0.poll())
    }
    fn wait(&self, timeout: Option<Duration>) -> Snapshot {
        Self::snapshot(self.0.wait(timeout.unwrap_or(Duration::MAX)))
    }
    fn cancel(&self) {
        self.0.cancel();
    }
    fn set_wake(&self, wake: Option<Wake>) {
        self.0.set_wake(wake.map(Wake::into_fn));
    }
}

/// Begins oc_scene_closest in the background.
///
/// - `query`, `out_hits`, `hit_stride`: as for oc_scene_closest. The arrays of rays and hits must stay valid and
///   unchanged until the job has ended. The struct `query` is copied.
/// - `out_job`: receives the job. Use the hits only after OC_STATE_DONE.
///
/// Ownership: the caller receives one reference to the job.
/// Thread safety: any thread. Cheap.
/// # Safety
/// As for oc_scene_closest; `out_job` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_closest_start(
    scene: *const oc_scene,
    query: *const oc_query,
    out_hits: *mut oc_hit,
    hit_stride: u64,
    out_job: *mut *mut oc_job,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_job, "out_job")?;
        let query = read(query)?;
        let options = query.options()?;
        let hits = CHits(Strided::new(out_hits, query.count, hit_stride, "out_hits")?);
        let rays = CRays::new(&query, &hits.0)?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let query = Query::closest(&scene.scene.state(), Arc::new(rays), Arc::new(hits), options)?;
            out.write(give_job(Arc::new(QueryWork(query))));
            Ok(())
        })
    })
}

/// Begins oc_scene_any in the background.
///
/// - `query`, `out_any`, `any_stride`: as for oc_scene_any. The arrays of rays and answers must stay valid and
///   unchanged until the job has ended. The struct `query` is copied.
/// - `out_job`: receives the job. Use the answers only after OC_STATE_DONE.
///
/// Ownership: the caller receives one reference to the job.
/// Thread safety: any thread. Cheap.
/// # Safety
/// As for oc_scene_any; `out_job` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_any_start(
    scene: *const oc_scene,
    query: *const oc_query,
    out_any: *mut u8,
    any_stride: u64,
    out_job: *mut *mut oc_job,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_job, "out_job")?;
        let query = read(query)?;
        let options = query.options()?;
        let hits = CAny(Strided::new(out_any, query.count, any_stride, "out_any")?);
        let rays = CRays::new(&query, &hits.0)?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let query = Query::any(&scene.scene.state(), Arc::new(rays), Arc::new(hits), options)?;
            out.write(give_job(Arc::new(QueryWork(query))));
            Ok(())
        })
    })
}
