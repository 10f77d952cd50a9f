//! Sets of parts, and the search for clashes.

use super::background::{Product, Task};
use super::context::ContextObject;
use super::guard::{Checked, Fill, Sized32, Strided, bad, boundary, out, read_or_default, reserved};
use super::handles::{self, Shell, handle};
use super::job::{LongWork, Snapshot, Wake, give_job, oc_job, product};
use super::query::OC_NO_ID;
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::base::progress::{Cancel, Progress};
use crate::query::PartSet;
use crate::query::clash::{Clash, ClashDetail, ClashOptions, ClashRules, ClashSummary};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// A set of parts of a scene, by ids. It may be used with any scene.
pub struct oc_part_set {
    _private: [u8; 0],
}

handle!(oc_part_set, PartSetObject, 9);

pub(crate) struct PartSetObject {
    set: Mutex<PartSet>,
}

impl PartSetObject {
    fn with<T>(&self, f: impl FnOnce(&mut PartSet) -> T) -> T {
        f(&mut self.set.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Creates an empty set of parts.
///
/// - `out_set`: receives the set.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `out_set` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_set_create(out_set: *mut *mut oc_part_set) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_set, "out_set")?;
        out.write(handles::give::<oc_part_set>(PartSetObject { set: Mutex::default() }));
        Ok(())
    })
}

/// Adds all parts of an instance.
///
/// - `instance`: id of the instance. OC_NO_ID: all instances.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `set` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_set_add_instance(set: *mut oc_part_set, instance: u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(set, |set: &Shell<PartSetObject>| {
            set.with(|set| if instance == OC_NO_ID { *set = PartSet::all() } else { set.add_instance(instance) });
            Ok(())
        })
    })
}

/// Adds a part and all parts below it.
///
/// - `instance`: id of the instance. OC_NO_ID: all instances of models that have the part.
/// - `part`: id of the part.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `set` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_set_add_part(set: *mut oc_part_set, instance: u64, part: u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(set, |set: &Shell<PartSetObject>| {
            set.with(|set| set.add_part((instance != OC_NO_ID).then_some(instance), part));
            Ok(())
        })
    })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `set` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_set_retain(set: *mut oc_part_set) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(set) }
}

/// Releases one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `set` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_set_release(set: *mut oc_part_set) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(set) }
}

/// Results of a search for clashes.
pub type oc_clash_detail = u32;
/// One clash for each pair of parts. The default.
pub const OC_CLASH_DETAIL_PARTS: oc_clash_detail = 0;
/// One clash for each pair of triangles that meet, and one for each pair of parts without such.
pub const OC_CLASH_DETAIL_TRIANGLES: oc_clash_detail = 1;

/// Flags: pairs of parts that are not compared.
pub type oc_clash_skip_flags = u32;
/// Pairs in instances of one model.
pub const OC_CLASH_SKIP_SAME_MODEL: oc_clash_skip_flags = 1;
/// Pairs in one instance.
pub const OC_CLASH_SKIP_SAME_INSTANCE: oc_clash_skip_flags = 2;
/// Pairs in one instance whose parts have the same parent part, or both have none.
pub const OC_CLASH_SKIP_SAME_PARENT: oc_clash_skip_flags = 4;
/// Pairs of one model whose parts have equal materials.
pub const OC_CLASH_SKIP_SAME_MATERIAL: oc_clash_skip_flags = 8;

/// The way in which two parts clash.
pub type oc_clash_kind = u32;
/// Their surfaces cross. How deep is not known: the tolerance is 0, a part is not closed, or the triangles of both
/// parts do not fit the budget.
pub const OC_CLASH_CROSSING: oc_clash_kind = 1;
/// Their surfaces overlap in a plane, and do not cross. The parts may lie against each other or in one another: that is
/// not known, for the same reasons.
pub const OC_CLASH_COPLANAR: oc_clash_kind = 2;
/// Their surfaces have common points, and do not cross or overlap. With a tolerance: neither closed part reaches deeper
/// into the other than that.
pub const OC_CLASH_TOUCHING: oc_clash_kind = 3;
/// They are apart, and their distance is at most the clearance, within `oc_clash.error`.
pub const OC_CLASH_CLEARANCE: oc_clash_kind = 4;
/// Both are closed, and one reaches deeper into the other than the tolerance.
pub const OC_CLASH_HARD: oc_clash_kind = 5;
/// As OC_CLASH_HARD, and one goes through the other, like a rod through a plate: its surface outside of the other is in
/// several pieces. Decided by edges of triangles and their ends.
pub const OC_CLASH_PIERCING: oc_clash_kind = 6;
/// One part is inside of the other, which is closed. With tolerance 0, their surfaces have no point in common. With a
/// tolerance, it is deeper inside than that, and its surface is nowhere farther outside than about that.
pub const OC_CLASH_CONTAINED: oc_clash_kind = 7;
/// With a tolerance: both are closed, and each surface is nowhere farther from the other than about that.
pub const OC_CLASH_DUPLICATE: oc_clash_kind = 8;

/// Flags: parts of a clash that are not closed.
pub type oc_clash_open_flags = u32;
/// The first part is not closed: nothing is known of its inside.
pub const OC_CLASH_OPEN_FIRST: oc_clash_open_flags = 1;
/// The second part is not closed.
pub const OC_CLASH_OPEN_SECOND: oc_clash_open_flags = 2;

/// A search for clashes. All zeros: all parts against each other, without a clearance.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_clash_desc {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// One of the OC_CLASH_DETAIL_ constants.
    pub detail: oc_clash_detail,
    /// Parts of which a clash has one. NULL: all parts.
    pub first: *const oc_part_set,
    /// Parts of which a clash has the other. NULL: those of `first`.
    pub second: *const oc_part_set,
    /// Distance in world units up to which parts that are apart clash; 0 or more.
    pub clearance: f64,
    /// Depth in world units up to which closed parts that reach into each other touch, and greatest error of the depths
    /// of others; 0 or more. 0: depths are not sought.
    pub tolerance: f64,
    /// Greatest number of pairs of triangles with OC_CLASH_DETAIL_TRIANGLES. 0: 1048576.
    pub limit: u64,
    /// Pairs of part ids that are not compared, in any instances and either order: 2 * `skip_count` ids. May be NULL if
    /// `skip_count` is 0.
    pub skip_pairs: *const u64,
    /// Number of pairs in `skip_pairs`.
    pub skip_count: u64,
    /// OC_CLASH_SKIP_ flags, combined with `|`.
    pub skip: oc_clash_skip_flags,
    /// Must be 0.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, numbers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_clash_desc {
    const NAME: &'static str = "oc_clash_desc";
}

/// A clash of two parts, or of a triangle of each. Element of an array. The first part is in the first set of the
/// search and the second in the second set. If each part is in both, the part of the instance that was added first
/// comes first, or the one that is first in the model.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_clash {
    /// Depends on the ids of instances, parts and triangles alone, not on which part is the first: the same clash of
    /// two searches has the same id.
    pub id: u64,
    /// Ids of the instances.
    pub instance: [u64; 2],
    /// Ids of the parts.
    pub part: [u64; 2],
    /// Indices of the triangles in the inputs of the builds, from 0. OC_NO_ID: a clash of parts.
    pub prim: [u64; 2],
    /// World space. If there is a depth: the deepest point of the first part in the second, or if that reaches deeper
    /// into the first, the point of the first part's surface nearest to its deepest point. Clearance: the point of the
    /// first part that is nearest to the second. Otherwise an end of the common segment of two triangles, or a corner
    /// of the part inside.
    pub first_point: [f64; 3],
    /// World space. As `first_point`, of the second part; otherwise the other end of the segment, or the same corner.
    pub second_point: [f64; 3],
    /// The direction in which the second part moves away from the first, of length 1: along both points if there is a
    /// depth or a distance, otherwise along the normal of a triangle there. Zero: none is known.
    pub normal: [f64; 3],
    /// Least corner of the box around all common points of the parts (around both points if there are none).
    pub low: [f64; 3],
    /// Greatest corner of that box.
    pub high: [f64; 3],
    /// The greatest distance, in world units, from a point of a part's surface that is inside of the other part to the
    /// other's surface; of both parts if this is a clash of two triangles. 0: it is not known, or they only touch.
    pub depth: f64,
    /// Distance of the parts in world units. 0: they have common points, or one is inside of the other.
    pub distance: f64,
    /// Bound of the error of `depth` or `distance`. That of a depth is at most the tolerance and rounding, unless the
    /// search ended early after many tries.
    pub error: f64,
    /// Number of pairs of triangles that meet. Some are counted several times in a clash of parts of a model that was
    /// built with spatial splits.
    pub count: u64,
    /// One of the OC_CLASH_ constants.
    pub kind: oc_clash_kind,
    /// OC_CLASH_OPEN_ flags, combined with `|`.
    pub open: oc_clash_open_flags,
}

/// The end of a search for clashes.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_clash_summary {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// 1: pairs of triangles were left out, because there are more than the limit. Otherwise 0.
    pub is_cut: u32,
    /// Number of clashes, taken or not.
    pub clashes: u64,
    /// Number of pairs of parts that clash.
    pub pairs: u64,
}

// SAFETY: `repr(C)`, integers without padding, `struct_size` first.
unsafe impl Sized32 for oc_clash_summary {
    const NAME: &'static str = "oc_clash_summary";
}

impl From<&Clash> for oc_clash {
    fn from(clash: &Clash) -> Self {
        let [first, second] = clash.is_open;
        let flag = |is_set: bool, flag| if is_set { flag } else { 0 };
        Self {
            id: clash.id(),
            instance: clash.instances,
            part: clash.parts,
            prim: clash.prims,
            first_point: clash.points[0].to_array(),
            second_point: clash.points[1].to_array(),
            low: clash.bounds.min.to_array(),
            high: clash.bounds.max.to_array(),
            normal: clash.normal.to_array(),
            depth: clash.depth,
            distance: clash.distance,
            error: clash.error,
            count: clash.count,
            kind: clash.kind as u32,
            open: flag(first, OC_CLASH_OPEN_FIRST) | flag(second, OC_CLASH_OPEN_SECOND),
        }
    }
}

/// Clashes that were found and not taken.
#[derive(Default)]
pub(crate) struct ClashQueue(Mutex<VecDeque<Clash>>);

impl ClashQueue {
    fn with<T>(&self, f: impl FnOnce(&mut VecDeque<Clash>) -> T) -> T {
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A search behind an `oc_job`.
struct ClashWork {
    task: Arc<Task>,
    found: Arc<ClashQueue>,
}

impl LongWork for ClashWork {
    fn poll(&self) -> Snapshot {
        self.task.poll()
    }
    fn wait(&self, timeout: Option<Duration>) -> Snapshot {
        self.task.wait(timeout)
    }
    fn cancel(&self) {
        LongWork::cancel(&*self.task);
    }
    fn set_wake(&self, wake: Option<Wake>) {
        self.task.set_wake(wake);
    }
    fn product(&self) -> Option<Arc<Product>> {
        self.task.product()
    }
    fn clashes(&self) -> Option<&ClashQueue> {
        Some(&self.found)
    }
}

/// Copies a set.
///
/// # Safety
/// `set` is NULL or a live handle.
pub(super) unsafe fn set_of(set: *const oc_part_set) -> Checked<Option<PartSet>> {
    if set.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's contract.
    let set = unsafe { handles::borrow(set)? };
    Ok(Some(set.with(|set| set.clone())))
}

impl oc_clash_desc {
    /// # Safety
    /// The pointers are as documented.
    unsafe fn to_rust(self) -> Checked<ClashOptions> {
        reserved(self.reserved, "oc_clash_desc.reserved")?;
        let detail = match self.detail {
            OC_CLASH_DETAIL_PARTS => ClashDetail::Parts,
            OC_CLASH_DETAIL_TRIANGLES => ClashDetail::Triangles,
            other => return bad(format!("oc_clash_desc.detail {other} is unknown")),
        };
        let known = OC_CLASH_SKIP_SAME_MODEL
            | OC_CLASH_SKIP_SAME_INSTANCE
            | OC_CLASH_SKIP_SAME_PARENT
            | OC_CLASH_SKIP_SAME_MATERIAL;
        if self.skip & !known != 0 {
            return bad(format!("oc_clash_desc.skip {:#x}: unknown flags", self.skip));
        }
        let pairs = Strided::new(self.skip_pairs.cast::<[u64; 2]>(), self.skip_count, 0, "oc_clash_desc.skip_pairs")?;
        let has = |flag| self.skip & flag != 0;
        // SAFETY: the indices are below `skip_count`; the sets are live handles.
        let (pairs, first, second) =
            unsafe { ((0..pairs.count).map(|i| pairs.get(i)).collect(), set_of(self.first)?, set_of(self.second)?) };
        Ok(ClashOptions {
            a: first.unwrap_or_else(PartSet::all),
            b: second,
            rules: ClashRules {
                same_model: has(OC_CLASH_SKIP_SAME_MODEL),
                same_instance: has(OC_CLASH_SKIP_SAME_INSTANCE),
                same_parent: has(OC_CLASH_SKIP_SAME_PARENT),
                same_material: has(OC_CLASH_SKIP_SAME_MATERIAL),
                pairs,
            },
            clearance: self.clearance,
            tolerance: self.tolerance,
            detail,
            limit: if self.limit == 0 { ClashOptions::default().limit } else { self.limit },
        })
    }
}

/// Begins to search, in the background, for pairs of visible parts of the committed scene that cross, touch, hold one
/// another, or are nearer to each other than a clearance.
///
/// Parts of one instance are compared too, and each instance of a shared mesh counts. Triangles decide, in exact
/// arithmetic on their corners: these are placed once, in double precision, in a frame near the pair. The result does
/// not depend on the number of threads, on the order of the sets or on the blocks in memory. Parts that have a corner,
/// an edge or an area in common touch or cross: the clearance does not remove them. With a tolerance, the search also
/// finds how deep closed parts reach into each other: it reads all triangles of such parts, into memory that counts
/// against the budget.
///
/// - `desc`: the search. It is copied, the sets too. Initialise it with OC_INIT. NULL: all zeros.
/// - `out_job`: receives the job. oc_job_take_clashes returns what it finds, oc_job_clash_summary the numbers.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: the clearance or the tolerance is negative or not finite, a set is empty, or `detail`
///   or a flag is unknown.
/// - The job fails with OC_STATUS_INVALID_ARGUMENT if a set names an instance or part that the scene lacks, and with
///   the error of a disk read.
///
/// Ownership: the caller receives one reference to the job.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; `desc` is NULL or initialised; `out_job` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_clash_start(
    scene: *const oc_scene,
    desc: *const oc_clash_desc,
    out_job: *mut *mut oc_job,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_job, "out_job")?;
        let options = read_or_default(desc)?.to_rust()?;
        options.check()?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let (state, found) = (scene.scene.state(), Arc::<ClashQueue>::default());
            let queue = Arc::clone(&found);
            let search = move |task: &Task| -> crate::Result<Product> {
                let take = &mut |clash: &Clash| queue.with(|queue| queue.push_back(*clash));
                Ok(Box::new(state.clash(&options, &task.progress, &task.cancel, take)?))
            };
            let context: &ContextObject = &scene.context;
            let task = context.begin_task(Arc::<Progress>::default(), Cancel::new(), search)?;
            out.write(give_job(Arc::new(ClashWork { task, found })));
            Ok(())
        })
    })
}

/// Takes clashes that a job has found, in order. Each is returned once.
///
/// Their order is that of the whole result: instances in the order added, then parts in the order of the model, then
/// triangles. So none is there before all pairs were compared, and a job that is cancelled before that has none.
///
/// - `out_clashes`: receives at most `capacity` clashes. May be NULL if `capacity` is 0.
/// - `out_count`: receives the number of clashes written; if `capacity` is 0, the number of those that wait.
///
/// A job that runs may find more. After the end of the job, a count below `capacity` says that there are no more.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle; `out_clashes` has room for `capacity` elements; `out_count` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_take_clashes(
    job: *const oc_job,
    out_clashes: *mut oc_clash,
    capacity: u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out_count = out(out_count, "out_count")?;
        let all = Strided::new(out_clashes, capacity, 0, "out_clashes")?;
        handles::with(job, |job| {
            let Some(queue) = job.work.clashes() else { return bad("this kind of job does not find clashes") };
            let count = queue.with(|queue| {
                if capacity == 0 {
                    return queue.len();
                }
                let count = queue.len().min(all.count);
                for (i, clash) in queue.drain(..count).enumerate() {
                    // SAFETY: the index is below `capacity`.
                    all.set(i, oc_clash::from(&clash));
                }
                count
            });
            out_count.write(count as u64);
            Ok(())
        })
    })
}

/// Returns the numbers of a search for clashes that is done.
///
/// - `out_summary`: receives the numbers. Initialise it with OC_INIT.
///
/// Errors: OC_STATUS_INVALID_STATE: the job is not done, or failed. OC_STATUS_INVALID_STATE or
/// OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle; `out_summary` is initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_clash_summary(job: *const oc_job, out_summary: *mut oc_clash_summary) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_summary)?;
        handles::with(job, |job| {
            let ClashSummary { clashes, pairs, is_cut, .. } = product(job, "summary of clashes")?;
            fill.with(oc_clash_summary { struct_size: 0, is_cut: u32::from(is_cut), clashes, pairs });
            Ok(())
        })
    })
}
