//! Builds: meshes from files or from the caller's memory become a model file.

use super::context::{ContextObject, OC_ALL_THREADS, check_threads, oc_context};
use super::guard::{self, Checked, Sized32, bad, boundary, out, read_or_default, reserved};
use super::handles::{self, Shell, handle};
use super::job::oc_job;
use super::report;
use super::status::oc_status;
use crate::base::error::Error;
use crate::base::progress::{Cancel, Progress};
use crate::build::{BuildOptions, Builder, Splits, Structure};
use crate::import::{MeshKey, PartKey, UpAxis};
use crate::scene::LogLevel;
use std::collections::HashMap;
use std::ffi::c_char;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A model in the making: meshes are added, then oc_build_start makes the file.
///
/// Parts are the caller's own 64-bit ids. A triangle's primitive id is its index in the input: those pushed come
/// first, in the order pushed, then those of the files, in the order added.
pub struct oc_build {
    _private: [u8; 0],
}

handle!(oc_build, BuildObject, 7);

pub(crate) struct BuildObject {
    context: Arc<Shell<ContextObject>>,
    progress: Arc<Progress>,
    cancel: Cancel,
    /// `None` once started.
    input: Mutex<Option<Input>>,
}

/// What was added so far.
pub(super) struct Input {
    pub(super) builder: Builder,
    pub(super) files: Vec<PathBuf>,
    /// The caller's part ids, and where the builder has them.
    pub(super) parts: HashMap<u64, PartKey>,
    pub(super) part_count: u32,
    pub(super) materials: Vec<u32>,
    /// Shared meshes: the builder's key and the number of local parts.
    pub(super) meshes: Vec<(MeshKey, u32)>,
}

impl BuildObject {
    fn lock(&self) -> MutexGuard<'_, Option<Input>> {
        self.input.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn started() -> Error {
    Error::BadState("the build was started".into())
}

/// Runs `f` on what was added so far; refused once the build was started.
///
/// # Safety
/// As for [`handles::with`].
pub(super) unsafe fn with_input(build: *mut oc_build, f: impl FnOnce(&mut Input) -> Checked<()>) -> Checked<()> {
    // SAFETY: the caller's contract.
    unsafe { handles::with(build, |build: &Shell<BuildObject>| f(build.lock().as_mut().ok_or_else(started)?)) }
}

/// The acceleration structure of a model.
pub type oc_structure = u32;
/// The library's choice, at present OC_STRUCTURE_BVH.
pub const OC_STRUCTURE_DEFAULT: oc_structure = 0;
/// A wide, quantised bounding volume hierarchy.
pub const OC_STRUCTURE_BVH: oc_structure = 1;

/// Whether triangles may be split between leaves, which pays for long thin ones.
pub type oc_splits = u32;
/// Where it pays.
pub const OC_SPLITS_AUTO: oc_splits = 0;
/// Never.
pub const OC_SPLITS_OFF: oc_splits = 1;
/// Always.
pub const OC_SPLITS_ON: oc_splits = 2;

/// What a build is made with. All zeros: what most models want.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_build_desc {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// An OC_STRUCTURE_ number.
    pub structure: oc_structure,
    /// Bytes of memory that the build may use, 32 MiB at least: what does not fit goes through temporary files. 0: no
    /// limit.
    pub memory_budget: u64,
    /// The folder of temporary files; NULL: the system's (`TMPDIR`, where that is set). Not looked at before the first
    /// is written.
    pub temp_dir: *const c_char,
    /// Length unit, in place of what the input says. 0: as the input says.
    pub metres_per_unit: f64,
    /// An OC_UP_ number, in place of what the input says. OC_UP_UNKNOWN: as the input says.
    pub up: u32,
    /// An OC_SPLITS_ number.
    pub splits: oc_splits,
    /// Threads, up to 4096; the build starts its own. 0: as many as the context has; OC_ALL_THREADS: one for each core.
    /// In a context without threads of its own a build has the one thread that does it. The file does not depend on it.
    pub threads: u32,
    /// Must be 0.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, numbers and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_build_desc {
    const NAME: &'static str = "oc_build_desc";
}

/// How many threads a build uses: in a context without threads of its own only the one that does it.
fn threads(asked: u32, context: &ContextObject) -> usize {
    match (context.context.threads(), asked) {
        (0, _) => 1,
        (all, 0) => all,
        (_, OC_ALL_THREADS) => 0,
        (_, n) => n as usize,
    }
}

/// # Safety
/// The pointers in `desc` are as its members say.
unsafe fn options(desc: &oc_build_desc, context: &ContextObject) -> Checked<BuildOptions> {
    reserved(desc.reserved, "oc_build_desc.reserved")?;
    check_threads(desc.threads, "oc_build_desc.threads")?;
    let structure = match desc.structure {
        OC_STRUCTURE_DEFAULT | OC_STRUCTURE_BVH => Structure::Bvh,
        other => return bad(format!("oc_build_desc.structure {other} is unknown")),
    };
    let splits = match desc.splits {
        OC_SPLITS_AUTO => Splits::Auto,
        OC_SPLITS_OFF => Splits::Off,
        OC_SPLITS_ON => Splits::On,
        other => return bad(format!("oc_build_desc.splits {other} is unknown")),
    };
    let up = match desc.up {
        0 => None,
        1 => Some(UpAxis::X),
        2 => Some(UpAxis::Y),
        3 => Some(UpAxis::Z),
        other => return bad(format!("oc_build_desc.up {other} is unknown")),
    };
    let temp_dir = if desc.temp_dir.is_null() {
        None
    } else {
        // SAFETY: the caller's contract.
        Some(unsafe { guard::path(desc.temp_dir, "oc_build_desc.temp_dir")? })
    };
    let metres_per_unit = (desc.metres_per_unit != 0.0).then_some(desc.metres_per_unit);
    let (memory_budget, threads) = (desc.memory_budget, threads(desc.threads, context));
    Ok(BuildOptions { structure, memory_budget, threads, temp_dir, splits, metres_per_unit, up })
}

/// Makes an empty build. `desc` may be NULL: all defaults.
///
/// Ownership: the caller owns a count. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `desc` initialised or NULL; `out_build` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_create(
    context: *const oc_context,
    desc: *const oc_build_desc,
    out_build: *mut *mut oc_build,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_build, "out_build")?;
        let desc = read_or_default(desc)?;
        handles::with(context, |_| {
            let context = handles::share(context)?;
            let (progress, cancel) = (Arc::new(Progress::default()), Cancel::new());
            let builder = Builder::new(options(&desc, &context)?, progress.clone(), cancel.clone())?;
            let input = Input {
                builder,
                files: Vec::new(),
                parts: HashMap::new(),
                part_count: 0,
                materials: Vec::new(),
                meshes: Vec::new(),
            };
            let input = Mutex::new(Some(input));
            out.write(handles::give::<oc_build>(BuildObject { context, progress, cancel, input }));
            Ok(())
        })
    })
}

/// Adds a mesh file: PLY, OBJ, STL, glTF, GLB or raw triangles. It is read when the build runs, so that errors
/// in it are the job's.
///
/// Thread safety: any thread, but the order of additions is that of the model. Cheap.
/// # Safety
/// Live handle; `path` ends with 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_file(build: *mut oc_build, path: *const c_char) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let path = guard::path(path, "path")?;
        with_input(build, |input| {
            input.files.push(path);
            Ok(())
        })
    })
}

/// Begins to make the file at `path`, in the background: in a thread that is started for it, one task of the executor,
/// or, where the context has neither threads nor an executor, inside oc_job_wait or oc_context_step. Nothing can be
/// added any more, also if OC_STATUS_IO says that the thread could not be started.
///
/// The file appears under its name when the job is done; until then what was there stays. If the job fails or is
/// cancelled no temporary is left.
/// Ownership: the caller owns a count of the job; the build may be released. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `path` ends with 0; `out_job` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_start(
    build: *mut oc_build,
    path: *const c_char,
    out_job: *mut *mut oc_job,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_job, "out_job")?;
        let path = guard::path(path, "path")?;
        handles::with(build, |build: &Shell<BuildObject>| {
            let input = build.lock().take().ok_or_else(started)?;
            let (progress, cancel) = (build.progress.clone(), build.cancel.clone());
            let context = build.context.context.clone();
            let todo = move |_: &_| {
                let built = report::run(input, path)?;
                built.report.notes.iter().for_each(|note| context.log(LogLevel::Warning, note));
                Ok(Box::new(built) as _)
            };
            out.write(build.context.begin(progress, cancel, todo)?);
            Ok(())
        })
    })
}

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_retain(build: *mut oc_build) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(build) }
}

/// Takes a count back; a job that was started goes on. NULL does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_release(build: *mut oc_build) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(build) }
}
