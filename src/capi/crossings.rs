//! All crossings of rays with surfaces.

use super::guard::{Checked, Failure, Strided, boundary, out, read};
use super::handles::{self, Shell};
use super::query::{CRays, oc_hit_kind, oc_query, same_places};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::query::Crossing;

/// The side of a triangle.
pub type oc_side = u32;
/// The side from which the corners appear counter-clockwise. There a ray enters a solid whose triangles face outward.
pub const OC_SIDE_FRONT: oc_side = 1;
/// The other side, where a ray leaves such a solid.
pub const OC_SIDE_BACK: oc_side = 2;

/// A point where a ray goes through an original triangle. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_crossing {
    /// Distance from the origin, in units of the direction's length, in double precision.
    pub t: f64,
    /// Id of the part, as passed when the model was built.
    pub part: u64,
    /// Id of the instance, as passed to oc_scene_add_instance.
    pub instance: u64,
    /// As oc_hit.prim. OC_NO_ID if `kind` is OC_HIT_MISSING.
    pub prim: u64,
    /// Unit geometric normal in world space, on the side of the ray's origin.
    pub normal: [f32; 3],
    /// Barycentric weights of the triangle's second and third corner.
    pub uv: [f32; 2],
    /// An original surface lies within this distance of the point at `t`, in world units.
    pub error: f32,
    /// The side on which the ray arrives: one of the OC_SIDE_ constants.
    pub side: oc_side,
    /// OC_HIT_EXACT. With OC_QUERY_NOW also OC_HIT_MISSING: the primitive id is not in memory.
    pub kind: oc_hit_kind,
}
same_places!(oc_crossing, Crossing: t is t, part is part, instance is instance, prim is prim, normal is normal,
    uv is uv, error is error, side is side, kind is kind);

/// Rows of answers in the caller's memory: all answers, one behind the other, and where those of each question end.
pub(super) struct Rows<T> {
    all: Strided<T>,
    ends: Strided<u64>,
    out_count: *mut u64,
    count: u64,
}

impl<T: Copy> Rows<T> {
    /// Checks the arrays for the answers to so many questions.
    ///
    /// # Safety
    /// The arrays are writable until the last call of the other functions: `capacity` elements, `questions` ends, and
    /// one count.
    pub unsafe fn new(
        (all, name): (*mut T, &str),
        capacity: u64,
        out_ends: *mut u64,
        questions: u64,
        out_count: *mut u64,
    ) -> Checked<Self> {
        let (all, out_count) = (Strided::new(all, capacity, 0, name)?, out(out_count, "out_count")?);
        Ok(Self { all, ends: Strided::new(out_ends, questions, 0, "out_ends")?, out_count, count: 0 })
    }

    /// Writes the answers to a question, as far as there is room for all of them.
    ///
    /// # Safety
    /// The bytes of any `U` are a valid `T`. `question` is below the number of questions.
    pub unsafe fn add<U: Copy>(&mut self, question: usize, answers: &[U]) {
        let end = self.count + answers.len() as u64;
        if end <= self.all.count as u64 && !answers.is_empty() {
            // SAFETY: within the array, by the test above, which nothing else uses; the rest is the caller's contract.
            unsafe { self.all.copy_from(self.count as usize, answers) };
        }
        self.count = end;
        // SAFETY: the caller's contract.
        unsafe { self.ends.set(question, end) };
    }

    /// Writes the number of all answers. Fails if they did not fit, unless only the count was asked for.
    ///
    /// # Safety
    /// The count is writable.
    pub unsafe fn finish(self) -> Checked<()> {
        // SAFETY: the caller's contract.
        unsafe { self.out_count.write(self.count) };
        let have = self.all.count as u64;
        if have > 0 && self.count > have { Err(Failure::TooSmall { need: self.count, have }) } else { Ok(()) }
    }
}

/// Finds all surfaces that rays cross, in order: nearest first, and at equal `t` by part, instance and `prim`.
///
/// Coincident surfaces are all found. An edge or a corner that triangles of a closed surface share counts once, decided
/// without any tolerance: the ray goes as often into the surface as out of it if it begins and ends outside. At a
/// silhouette that the ray touches, it crosses the surface twice or not at all. Triangles parallel to the ray are not
/// crossed.
///
/// - `query`: the rays and options. Initialise it with OC_INIT. `want` has no effect, but must be valid. Hidden parts,
///   masks and bad rays are treated as by oc_scene_closest. Footprints are ignored: crossings are those of original
///   triangles.
/// - `out_crossings`: receives the crossings of the first ray, then those of the second, and so on.
/// - `capacity`: number of elements that `out_crossings` has room for. 0: only `out_ends`, `out_complete` and
///   `out_count` are written, `out_crossings` is ignored.
/// - `out_ends`: receives, for each ray, the number of crossings of all rays up to and including this one. The
///   crossings of ray i are those from `out_ends[i - 1]` (0 for the first ray) to `out_ends[i]`, without the last.
/// - `out_complete`: receives one byte for each ray: 1 if its crossings are all, 0 if data was missing, which happens
///   only with OC_QUERY_NOW. May be NULL.
/// - `out_count`: receives the number of all crossings.
///
/// Errors:
/// - OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of crossings. `out_ends`, `out_complete` and
///   `out_count` are written all the same; do not use `out_crossings`.
/// - OC_STATUS_OVER_BUDGET: the crossings of a single ray take more than a quarter of the context's budget.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
///
/// Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; `query` is initialised; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_crossings(
    scene: *const oc_scene,
    query: *const oc_query,
    out_crossings: *mut oc_crossing,
    capacity: u64,
    out_ends: *mut u64,
    out_complete: *mut u8,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let query = read(query)?;
        let policy = query.options()?.policy;
        let mut rows = Rows::new((out_crossings, "out_crossings"), capacity, out_ends, query.count, out_count)?;
        let complete = if out_complete.is_null() { 0 } else { query.count };
        let complete = Strided::new(out_complete, complete, 0, "out_complete")?;
        let rays = CRays::new(&query, &rows.all)?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            scene.scene.shown().crossings(&rays, policy, &mut |ray, crossings, is_complete| {
                rows.add(ray, crossings);
                if complete.count > 0 {
                    complete.set(ray, u8::from(is_complete));
                }
            })?;
            rows.finish()
        })
    })
}
