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

/// A ray; an element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_ray {
    /// Where it starts, world space.
    pub origin: [f64; 3],
    /// Hits before this distance are ignored; in units of the direction's length. Below 0 it counts as 0. Infinite or
    /// NaN: the ray misses.
    pub t_min: f64,
    /// Hits beyond this distance are ignored. 0: none are. Before `t_min`, or NaN: the ray misses.
    pub t_max: f64,
    /// Where it goes; need not be unit. Zero, or not finite: the ray misses.
    pub direction: [f32; 3],
    /// Its footprint: its width at t is cone_a + cone_b * t, in world units (with t as in oc_hit, in units of the
    /// direction's length). A stand-in is accepted where the area of its box's projection along the ray is at most the
    /// square of the width there. So for p pixels of error: the width of a pixel, times the square root of p. Of a
    /// camera with a field of view a pixel is 2 tan(fov_y / 2) / height wide at distance 1: that is cone_b, cone_a is
    /// 0; of an orthographic one it is cone_a, and cone_b is 0. 0 and 0: exact. Below 0, or not a number: counts as 0;
    /// infinite: as coarse as there is.
    pub cone_a: f32,
    /// See `cone_a`.
    pub cone_b: f32,
    /// It sees instances with a common bit in their mask. 0: all.
    pub mask: u32,
}

/// What was hit.
pub type oc_hit_kind = u32;
/// Nothing between t_min and t_max, or the ray was let through what stands in there: see `t_free`.
pub const OC_HIT_MISS: oc_hit_kind = 0;
/// An original triangle.
pub const OC_HIT_EXACT: oc_hit_kind = 1;
/// A stand-in, as fine as the ray's cone asks for: a cell that holds original surface, near enough to what the ray
/// would meet. `t` is where the ray enters the cell, `normal` is that of what is mostly seen there, `part` the one of
/// which most is seen; `uv` and `prim` are those of a miss. Of cells that hold wires, leaves and the like, as many rays
/// are let through as pass what they hold: see `t_free`.
pub const OC_HIT_LOD: oc_hit_kind = 2;
/// A stand-in, coarser than asked for: what is below it is not in memory (frames and OC_QUERY_NOW only). Otherwise as
/// OC_HIT_LOD. If the ray begins inside of the cell, `t` is where it leaves it, and `t_free` is t_min: nothing of it is
/// known to be free.
pub const OC_HIT_MISSING: oc_hit_kind = 3;

/// The id where there is none: of a miss, or not asked for.
pub const OC_NO_ID: u64 = 0xFFFFFFFFFFFFFFFF;

/// Nothing may be called as nothing is.
pub(super) fn check_id(id: u64) -> Checked<()> {
    if id == OC_NO_ID { bad("OC_NO_ID is nothing's id") } else { Ok(()) }
}

/// The closest hit of a ray; an element of an array. What was not asked for is as for a miss.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_hit {
    /// Distance in units of the direction's length; infinity for a miss. From `t_min` to `t_max`, both included: what
    /// lies behind a hit is found from the next number after its `t` on. (Not what is nearer to it than `t` less
    /// `t_free`: such surfaces may come in the wrong order. Within single precision of the ray's origin what is behind
    /// it may be given at 0, and what is before it may be missed; so may what a ray meets within some 4 degrees of
    /// edge-on that near to an end.) In double precision with `OC_WANT_POSITION` or `OC_WANT_ERROR`; without, in single
    /// precision, and on long thin triangles near the ray's origin it may be off by more than its last digits.
    pub t: f64,
    /// Where, in world space; infinity for a miss.
    pub position: [f64; 3],
    /// No original surface lies on the ray before this distance. Left out are surfaces that the ray meets within 0.9
    /// degrees of edge-on, the one that it starts on, and edges that it grazes. Of an exact hit it is a little less
    /// than `t`, by what rounding may have done. Of a miss it is infinity, unless the ray was let through a stand-in:
    /// then it is where that, or what else would have been hit, is met; so it is of hits behind one.
    pub t_free: f64,
    /// The id of the part, as given when the model was built; OC_NO_ID for a miss.
    pub part: u64,
    /// The id of the instance, as given to oc_scene_add_instance; OC_NO_ID for a miss.
    pub instance: u64,
    /// The triangle's index in the input of the build, from 0; OC_NO_ID for a miss.
    pub prim: u64,
    /// Unit geometric normal in world space, facing the ray's origin; 0 for a miss.
    pub normal: [f32; 3],
    /// Weights of the triangle's second and third corner.
    pub uv: [f32; 2],
    /// Some original surface lies within this distance of `position`, in world units.
    pub error: f32,
    /// An OC_HIT_ number.
    pub kind: oc_hit_kind,
    /// 0.
    pub reserved: u32,
}

/// Which members of oc_hit to fill, joined with `|`. What is not asked for is not worked for.
pub type oc_want = u32;
/// Only `t` and `kind`, which are always filled.
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
/// `prim`; may have to be read from the disk.
pub const OC_WANT_PRIM: oc_want = 64;
/// `error` and `t_free`, and `t` in double precision.
pub const OC_WANT_ERROR: oc_want = 128;
/// Everything.
pub const OC_WANT_ALL: oc_want = 255;

/// Flags of oc_query.
pub type oc_query_flags = u32;
/// Each 32 rays in a row are near each other and go the same way: they are traced together, faster. The answers are
/// the same. Rays of neighbouring pixels that enter few placed trees are recognised without it.
pub const OC_QUERY_COHERENT: oc_query_flags = 1;
/// Answer at once, from what is in memory: stand-ins are hit in place of what is not, as OC_HIT_MISSING. Nothing is
/// read, nor asked for (oc_scene_prefetch_box does that). Without it, what is needed is read, and answers do not depend
/// on what was in memory.
pub const OC_QUERY_NOW: oc_query_flags = 2;

/// A batch of rays.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_query {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// OC_WANT_ flags; 0: OC_WANT_ALL.
    pub want: oc_want,
    /// OC_QUERY_ flags.
    pub flags: oc_query_flags,
    /// Must be 0.
    pub reserved: u32,
    /// The rays. Nobody may write them until the call has returned, or the job has ended.
    pub rays: *const oc_ray,
    /// How many.
    pub count: u64,
    /// Bytes from a ray to the next; 0: tightly packed. (Of these, 32 in a row at an address that oc_ray may have are
    /// read where they are if each says its t_max, INFINITY for none, and its mask, 0xFFFFFFFF for all; others are
    /// copied first.)
    pub stride: u64,
}

// SAFETY: `repr(C)`, words and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_query {
    const NAME: &'static str = "oc_query";
}

impl oc_query {
    fn options(&self) -> Checked<QueryOptions> {
        reserved(self.reserved, "oc_query.reserved")?;
        if self.want & !OC_WANT_ALL != 0 {
            return bad(format!("oc_query.want {:#x}: some flags are unknown", self.want));
        }
        if self.flags & !(OC_QUERY_COHERENT | OC_QUERY_NOW) != 0 {
            return bad(format!("oc_query.flags {:#x}: some are unknown", self.flags));
        }
        // Our first bit, the distance, is always on; the others are the crate's, one place higher.
        let want = if self.want == 0 { Want::ALL } else { Want(self.want >> 1) };
        let policy = if self.flags & OC_QUERY_NOW != 0 { Policy::Now } else { Policy::Exact };
        Ok(QueryOptions { coherent: self.flags & OC_QUERY_COHERENT != 0, want, policy })
    }
}

/// The caller's rays.
struct CRays {
    rays: Strided<oc_ray>,
    /// Nothing is written between them meanwhile.
    may_lend: bool,
}

impl CRays {
    /// Those of a batch, and where its answers go.
    fn new<T: Copy>(query: &oc_query, answers: &Strided<T>) -> Checked<Self> {
        let rays = Strided::new(query.rays, query.count, query.stride, "oc_query.rays")?;
        Ok(Self { rays, may_lend: !rays.meets(answers) })
    }
}

impl Rays for CRays {
    fn count(&self) -> usize {
        self.rays.count
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        // SAFETY: within the array, which the caller keeps readable until the batch has ended; both structs have the
        // same members at the same places (see below), numbers all, of which any bits are some.
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
        // SAFETY: as of `read`; the caller promises not to write them meanwhile, and we do not either.
        let rays: &[Ray; PACKET] = if self.may_lend { unsafe { self.rays.array(first) }? } else { return None };
        // Zeros stand for what `read` puts in their places. Without branches: there are two for each ray otherwise.
        let have_zeros = rays.iter().fold(false, |any, ray| any | (ray.t_max == 0.0) | (ray.mask == 0));
        (!have_zeros).then_some(rays)
    }
}

/// Asserts that members of two structs lie at the same places.
macro_rules! same_places {
    ($c:ty, $rust:ty: $($theirs:tt is $ours:tt),+) => {
        const _: () = assert!(size_of::<$c>() == size_of::<$rust>());
        $(const _: () = assert!(std::mem::offset_of!($c, $theirs) == std::mem::offset_of!($rust, $ours));)+
    };
}
same_places!(oc_ray, Ray: origin is origin, t_min is t_min, t_max is t_max, direction is dir, cone_a is cone, mask is mask);
same_places!(oc_hit, Hit: t is t, position is position, t_free is t_free, part is part, instance is instance,
    prim is prim, normal is normal, uv is uv, error is error, kind is kind, reserved is reserved);

/// The caller's hits.
struct CHits(Strided<oc_hit>);

impl Hits for CHits {
    fn write(&self, first: usize, hits: &[Hit]) {
        // SAFETY: within the array, which the caller leaves to us until the batch has ended; each index is written by
        // one worker. Both structs have the same members at the same places, and no bytes between them.
        unsafe { self.0.copy_from(first, hits) };
    }
}

/// Writes one hit to the caller's memory.
///
/// # Safety
/// `out` is writable; it need not be aligned.
pub(super) unsafe fn write_hit(out: *mut oc_hit, hit: &Hit) {
    // SAFETY: the caller's promise; both structs have the same members at the same places.
    unsafe { out.cast::<Hit>().write_unaligned(*hit) };
}

/// The caller's bytes: 1 for a ray that hits anything.
struct CAny(Strided<u8>);

impl Hits for CAny {
    fn write(&self, first: usize, hits: &[Hit]) {
        for (i, hit) in hits.iter().enumerate() {
            // SAFETY: as for `CHits`.
            unsafe { self.0.set(first + i, u8::from(hit.kind as u32 != OC_HIT_MISS)) };
        }
    }
}

/// Finds the closest hit of each ray in the committed scene.
///
/// `out_hits`: as many as rays, `hit_stride` bytes apart (0: tightly packed). On failure they are not to be
/// used. Thread safety: any thread; frames and other batches may be in flight. Blocks; may read the disk.
/// # Safety
/// Live handle; `query` initialised; arrays as said.
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

/// Finds whether each ray hits anything: 1 or 0. Faster than the closest hit. `want` changes nothing (but is checked).
/// With OC_QUERY_NOW, 1 also stands for rays of which that is not known. With a footprint, 0 may also be a ray that
/// stand-ins let through.
///
/// `out_any`: as many bytes as rays, `any_stride` bytes apart (0: tightly packed). On failure they are not
/// to be used. Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// Live handle; `query` initialised; arrays as said.
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

/// Begins oc_scene_closest and returns at once. The arrays must stay as they are until the job has
/// ended; `query` itself need not.
///
/// Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
/// # Safety
/// As for oc_scene_closest; `out_job` writable.
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

/// Begins oc_scene_any and returns at once. The arrays must stay as they are until the job has
/// ended; `query` itself need not.
///
/// Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
/// # Safety
/// As for oc_scene_any; `out_job` writable.
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
