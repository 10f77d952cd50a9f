//! Builds: convert meshes from files or from the caller's memory to a model file.

use super::context::{ContextObject, OC_ALL_THREADS, check_threads, oc_context};
use super::guard::{self, Checked, Sized32, bad, boundary, out, read_or_default, reserved};
use super::handles::{self, Shell, handle};
use super::job::oc_job;
use super::report;
use super::resolve::{HostResolver, oc_resolve_fn};
use super::status::oc_status;
use crate::base::error::Error;
use crate::base::output;
use crate::base::progress::{Cancel, Progress};
use crate::build::{BuildOptions, Builder, Splits, StandIns, Structure, SurfaceLeaves};
use crate::import::{Access, Dicing, HeightMap, MeshKey, PartKey, UpAxis};
use crate::scene::LogLevel;
use std::collections::HashMap;
use std::ffi::{c_char, c_void};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A model under construction. Add meshes, then call oc_build_start to write the model file.
///
/// A part is identified by the caller's own 64-bit id. The primitive id of a triangle is its index in the input: first
/// the pushed triangles in the order pushed, then those of the files in the order added. With OC_STRUCTURE_PATCH that
/// of a surface is its face.
pub struct oc_build {
    _private: [u8; 0],
}

handle!(oc_build, BuildObject, 7);

pub(crate) struct BuildObject {
    context: Arc<Shell<ContextObject>>,
    progress: Arc<Progress>,
    cancel: Cancel,
    /// `None` after the start.
    input: Mutex<Option<Input>>,
}

/// The content added so far.
pub(super) struct Input {
    pub(super) builder: Builder,
    pub(super) files: Vec<PathBuf>,
    /// The builder's key of each of the caller's part ids.
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
    Error::BadState("the build was already started".into())
}

/// Runs `f` on the content added so far. Fails after the start of the build.
///
/// # Safety
/// As for [`handles::with`].
pub(super) unsafe fn with_input(build: *mut oc_build, f: impl FnOnce(&mut Input) -> Checked<()>) -> Checked<()> {
    // SAFETY: the caller's contract.
    unsafe { handles::with(build, |build: &Shell<BuildObject>| f(build.lock().as_mut().ok_or_else(started)?)) }
}

/// Acceleration structure of a model.
pub type oc_structure = u32;
/// The library chooses. At present OC_STRUCTURE_BVH.
pub const OC_STRUCTURE_DEFAULT: oc_structure = 0;
/// A wide, quantised bounding volume hierarchy. Surfaces are diced into triangles.
pub const OC_STRUCTURE_BVH: oc_structure = 1;
/// Surfaces as grids under quadtrees of quantised boxes, about a byte of memory for each triangle that they are diced
/// into, if each face has some ten thousand; some ten if a face has hundreds (see `surface_leaves`). Triangles as with
/// OC_STRUCTURE_BVH.
///
/// oc_hit.prim of a hit on a surface is the face, in the order in which the faces of all surfaces were added. The error
/// of exact hits includes `surface_tolerance`. Surfaces keep their own normals if `crease_angle` is below 0 too. Rays
/// are traced one by one, also those of pictures.
pub const OC_STRUCTURE_PATCH: oc_structure = 4;

/// Spatial splits: a triangle may be referenced by several leaves. This speeds up models with long thin triangles.
pub type oc_splits = u32;
/// Split if it speeds up the model.
pub const OC_SPLITS_AUTO: oc_splits = 0;
/// Never split.
pub const OC_SPLITS_OFF: oc_splits = 1;
/// Always split.
pub const OC_SPLITS_ON: oc_splits = 2;

/// The look of stand-ins: what a picture shows for geometry that is small or not in memory.
pub type oc_stand_ins = u32;
/// The library chooses. At present OC_STAND_INS_VOXELS.
pub const OC_STAND_INS_AUTO: oc_stand_ins = 0;
/// Each cell has a look of its own, from the sides of its box.
pub const OC_STAND_INS_VOXELS: oc_stand_ins = 1;
/// Subtrees of some hundred triangles have a look from eighteen directions, which all cells in them show. These looks
/// are always in memory and count in the budget: about 0.3 bytes for each triangle.
pub const OC_STAND_INS_PROXIES: oc_stand_ins = 2;

/// The leaves of surfaces with OC_STRUCTURE_PATCH: how rays that stand-ins do not serve find their triangles.
pub type oc_surface_leaves = u32;
/// The library chooses. At present OC_SURFACE_LEAVES_BOXES.
pub const OC_SURFACE_LEAVES_AUTO: oc_surface_leaves = 0;
/// Boxes alone are stored: the triangles are computed from the control points where a ray comes to them, at about a
/// byte of memory for each triangle. Displaced surfaces, surfaces of degrees above 3, and small squares at vertices
/// where the surface is no polynomial have facets.
pub const OC_SURFACE_LEAVES_BOXES: oc_surface_leaves = 1;
/// The vertices of all triangles are stored, about seven bytes for each triangle: rays find them sooner.
pub const OC_SURFACE_LEAVES_FACETS: oc_surface_leaves = 2;

/// Options of a build. All zeros: suitable for most models.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_build_desc {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// One of the OC_STRUCTURE_ constants.
    pub structure: oc_structure,
    /// Limit in bytes of the memory that the build takes, at least 32 MiB. Data that does not fit goes to temporary
    /// files. Names, parts, instances and one texture may take 64 MiB more. If names, parts and instances do not fit,
    /// the job fails with OC_STATUS_OVER_BUDGET and names a budget that suffices for them; a texture that does not fit
    /// is left out with a note. Not included: vertices of OBJ files, colours of PLY vertices, buffers of glTF files,
    /// cages and maps of heights. 0: no limit.
    pub memory_budget: u64,
    /// Folder for temporary files. NULL: the system's (`TMPDIR`, if it is set). The folder is not accessed before the
    /// first temporary file is written.
    pub temp_dir: *const c_char,
    /// Length of a unit in metres, finite and above 0. Overrides the unit of the input. 0: the unit of the input.
    pub metres_per_unit: f64,
    /// One of the OC_UP_ constants. Overrides the up axis of the input. OC_UP_UNKNOWN: the up axis of the input.
    pub up: u32,
    /// One of the OC_SPLITS_ constants.
    pub splits: oc_splits,
    /// Number of threads, at most four for each core, or 64 if that is more. The build starts its own. 0: as many as
    /// the context has. OC_ALL_THREADS: one for each core. In a context without threads of its own, a build uses only
    /// the thread that runs it. The model file does not depend on this number.
    pub threads: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Resolves the names of files that mesh files refer to, or NULL.
    pub resolve: oc_resolve_fn,
    /// Passed to `resolve`. Must stay valid until the build is released and its job has ended.
    pub resolve_user: *mut c_void,
    /// A folder of files that mesh files may refer to, with all folders below it. NULL: none.
    ///
    /// By default a mesh file may refer only to files in its own folder and below it: names with `..`, absolute names
    /// and symbolic links that lead out of it are refused. If the geometry needs the file (a buffer of glTF), the job
    /// fails with OC_STATUS_PARSE; otherwise (material libraries, textures) the file is left out with a note.
    pub trusted_folder: *const c_char,
    /// Greatest number of triangles in the input; those of a shared mesh count once. More: OC_STATUS_OVER_LIMIT. 0: no
    /// limit.
    pub max_triangles: u64,
    /// Greatest number of bytes that the model file and all temporary files take on the disk at any time. More:
    /// OC_STATUS_OVER_LIMIT. 0: no limit.
    pub max_bytes: u64,
    /// 1: mesh files may refer to any file that the process may read. Only for mesh files from a trusted source. 0: the
    /// rule of `trusted_folder`.
    pub trust_paths: u32,
    /// Must be 0.
    pub reserved_2: u32,
    /// Angle in degrees, at most 180, up to which an edge between two triangles appears smooth, if the input has no
    /// normals there. 0: 40 degrees, with which chamfers of 45 degrees stay edges. Below 0: no normals are made, and
    /// surfaces without normals show their facets.
    pub crease_angle: f32,
    /// One of the OC_STAND_INS_ constants.
    pub stand_ins: oc_stand_ins,
    /// Number of rays that sample each look of OC_STAND_INS_PROXIES, at most 1,048,576. 0: 512.
    pub proxy_rays: u32,
    /// Least number of triangles that such a look stands for. 0: so many that all looks take about 0.3 bytes of memory
    /// for each triangle.
    pub proxy_triangles: u32,
    /// Greatest distance between a smooth surface and the triangles into which it is diced, as sampled, in units of the
    /// surface; finite. 0: 1/2048 of the surface's greatest extent. Not used with `surface_level`.
    pub surface_tolerance: f64,
    /// Number of times that each side of a face of a smooth surface is halved, from 1 to 12: of each Bézier patch of a
    /// NURBS surface, or of each half if one closed patch is the whole surface. 0: `surface_tolerance` decides.
    pub surface_level: u32,
    /// 1: faces of OBJ files are the cages of subdivision surfaces, with the tags of OpenSubdiv's tools. 0: they are
    /// polygons.
    pub subdivide: u32,
    /// A picture of heights by which these surfaces are moved along their normals, through the texture coordinates: PNG
    /// with 8 or 16 bits, or EXR. Its last row is at t = 0. NULL: none.
    pub displacement_map: *const c_char,
    /// Height of a value of 1 (white) of `displacement_map`, in units of the surface, finite.
    pub displacement_scale: f64,
    /// One of the OC_SURFACE_LEAVES_ constants.
    pub surface_leaves: oc_surface_leaves,
    /// With OC_STRUCTURE_PATCH, squares of surfaces with more than 128 triangles are divided while the normals of one
    /// are not within a cone of this opening, in degrees up to 180. Smaller angles give tighter boxes, which take more
    /// memory. 0: 30 degrees.
    pub surface_flat: f32,
}

// SAFETY: `repr(C)`, numbers, pointers and a nullable function without padding, `struct_size` first.
unsafe impl Sized32 for oc_build_desc {
    const NAME: &'static str = "oc_build_desc";
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_build_desc, resolve);
}

/// Returns the number of threads of a build. In a context without threads of its own, that is the one that runs the
/// build.
fn threads(asked: u32, context: &ContextObject) -> usize {
    match (context.context.threads(), asked) {
        (0, _) => 1,
        (all, 0) => all,
        (_, OC_ALL_THREADS) => 0,
        (_, n) => n as usize,
    }
}

/// Converts the options.
///
/// # Safety
/// The pointers in `desc` are as its members say.
unsafe fn options(desc: &oc_build_desc, context: &ContextObject) -> Checked<BuildOptions> {
    reserved(desc.reserved, "oc_build_desc.reserved")?;
    reserved(desc.reserved_2, "oc_build_desc.reserved_2")?;
    check_threads(desc.threads, "oc_build_desc.threads")?;
    let structure = match desc.structure {
        OC_STRUCTURE_DEFAULT | OC_STRUCTURE_BVH => Structure::Bvh,
        OC_STRUCTURE_PATCH => Structure::Patch,
        other => return bad(format!("oc_build_desc.structure {other} is unknown")),
    };
    let splits = match desc.splits {
        OC_SPLITS_AUTO => Splits::Auto,
        OC_SPLITS_OFF => Splits::Off,
        OC_SPLITS_ON => Splits::On,
        other => return bad(format!("oc_build_desc.splits {other} is unknown")),
    };
    let stand_ins = match desc.stand_ins {
        OC_STAND_INS_AUTO => StandIns::Auto,
        OC_STAND_INS_VOXELS => StandIns::Voxels,
        OC_STAND_INS_PROXIES => StandIns::Proxies,
        other => return bad(format!("oc_build_desc.stand_ins {other} is unknown")),
    };
    let surface_leaves = match desc.surface_leaves {
        OC_SURFACE_LEAVES_AUTO | OC_SURFACE_LEAVES_BOXES => SurfaceLeaves::Boxes,
        OC_SURFACE_LEAVES_FACETS => SurfaceLeaves::Facets,
        other => return bad(format!("oc_build_desc.surface_leaves {other} is unknown")),
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
    let displacement = if desc.displacement_map.is_null() {
        None
    } else {
        // SAFETY: the caller's contract.
        let path = unsafe { guard::path(desc.displacement_map, "oc_build_desc.displacement_map")? };
        Some(HeightMap { path, scale: desc.displacement_scale })
    };
    let any = match desc.trust_paths {
        0 => false,
        1 => true,
        other => return bad(format!("oc_build_desc.trust_paths is {other}; it must be 0 or 1")),
    };
    let folders = if desc.trusted_folder.is_null() {
        Vec::new()
    } else {
        // SAFETY: the caller's contract.
        vec![unsafe { guard::path(desc.trusted_folder, "oc_build_desc.trusted_folder")? }]
    };
    let resolver = desc.resolve.map(|resolve| HostResolver::new(resolve, desc.resolve_user));
    let access = Access { folders, any, resolver: resolver.map(|resolver| Arc::new(resolver) as _) };
    let (max_triangles, max_bytes) = (desc.max_triangles, desc.max_bytes);
    let dicing = match (desc.surface_level, desc.surface_tolerance) {
        (0, 0.0) => None,
        (0, tolerance) => Some(Dicing::Tolerance(tolerance)),
        (level, _) => Some(Dicing::Level(level)),
    };
    let subdivide = match desc.subdivide {
        0 => false,
        1 => true,
        other => return bad(format!("oc_build_desc.subdivide is {other}; it must be 0 or 1")),
    };
    let metres_per_unit = (desc.metres_per_unit != 0.0).then_some(desc.metres_per_unit);
    let (memory_budget, threads) = (desc.memory_budget, threads(desc.threads, context));
    Ok(BuildOptions {
        structure,
        memory_budget,
        threads,
        temp_dir,
        splits,
        metres_per_unit,
        up,
        crease_angle: desc.crease_angle,
        access,
        max_triangles,
        max_bytes,
        stand_ins,
        proxy_rays: desc.proxy_rays,
        proxy_triangles: desc.proxy_triangles,
        dicing,
        surface_leaves,
        surface_flat: desc.surface_flat,
        subdivide,
        displacement,
    })
}

/// Creates an empty build.
///
/// - `desc`: options. NULL: all defaults.
/// - `out_build`: receives the build.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: an option is out of range.
/// - OC_STATUS_OVER_BUDGET: the memory budget of the build is below 32 MiB.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `context` is a live handle; `desc` is initialised or NULL; `out_build` is writable.
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

/// Adds a mesh file: PLY, OBJ, STL, glTF, GLB or raw triangles, or one of surfaces: BPT or NURBS faces
/// (`.trimmed_nurbs.json`). The build job reads it and reports its errors, not this call.
///
/// - `path`: path of the file. The string is copied.
///
/// Errors: OC_STATUS_INVALID_STATE after oc_build_start.
///
/// Thread safety: any thread. The order of the calls is the order in the model. Cheap.
/// # Safety
/// `build` is a live handle; `path` ends with 0.
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

/// Begins to build the model and to write it to `path`, in the background.
///
/// - `path`: path of the model file: a regular file that may be written, or no file yet. The file appears under this
///   name when the job is done; until then an existing file stays. A job that fails or is cancelled leaves no temporary
///   file. The new file has the permissions, the group and the owner of the existing one, as far as the process may set
///   them. If `path` is a symbolic link, the file that it names is replaced, and the link stays.
/// - `out_job`: receives the job. oc_job_build_report returns its statistics.
///
/// After this call nothing can be added to the build, even if the thread cannot be started.
///
/// The job runs on a thread that is started for it. With an executor it runs as one task of the executor. In a context
/// with neither threads nor an executor it runs inside oc_job_wait or oc_context_step.
///
/// Errors:
/// - OC_STATUS_INVALID_STATE: the build was started before.
/// - OC_STATUS_INVALID_ARGUMENT: `path` is one of the input files of the build, by any name or link. Nothing changed.
///   If it is a file that an input refers to (a material library, a buffer, a texture), the job fails so, and the file
///   stays as it is.
/// - OC_STATUS_IO: `path` is a folder, a device, a pipe, a socket, a read-only file, or a link that leads to no file
///   (nothing changed); or the thread cannot be started.
///
/// Ownership: the caller receives one reference to the job. The build may be released.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `build` is a live handle; `path` ends with 0; `out_job` is writable.
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
            let mut content = build.lock();
            output::check(&path, &content.as_ref().ok_or_else(started)?.files)?;
            let input = content.take().ok_or_else(started)?;
            drop(content);
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

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `build` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_retain(build: *mut oc_build) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(build) }
}

/// Releases one reference. A job that was started continues. NULL: does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `build` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_release(build: *mut oc_build) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(build) }
}
