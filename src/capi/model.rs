//! Models: built files, opened read-only.

use super::background::{Product, Task};
use super::context::{ContextObject, oc_context};
use super::guard::{self, Checked, Fill, Sized32, bad, boundary, out};
use super::handles::{self, Shell, handle};
use super::job::oc_job;
use super::status::oc_status;
use super::view::oc_camera;
use crate::base::error::Result;
use crate::base::progress::{Cancel, Progress};
use crate::scene::Model;
use crate::store::{FileSource, Source};
use std::ffi::{CString, c_char, c_void};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// A built model, opened read-only; shared by scenes.
pub struct oc_model {
    _private: [u8; 0],
}

handle!(oc_model, ModelObject, 3);

pub(crate) struct ModelObject {
    pub(crate) model: Model,
    /// The parts' names with a 0 at the end, made when first asked for.
    names: OnceLock<Vec<CString>>,
}

impl ModelObject {
    pub(crate) fn new(model: Model) -> Self {
        Self { model, names: OnceLock::new() }
    }

    fn name(&self, part: usize) -> *const c_char {
        let names = self.names.get_or_init(|| {
            let plain = |name: &str| name.bytes().filter(|&b| b != 0).collect::<Vec<u8>>();
            self.model.parts().iter().map(|p| CString::new(plain(&p.name)).unwrap_or_default()).collect()
        });
        names.get(part).map_or(c"".as_ptr(), |n| n.as_ptr())
    }
}

/// Reads `bytes` bytes at `offset` into `buffer`, all of them, and returns 0; anything else is a failure.
/// Called from any thread, several at once, never under a lock of the library's; must not unwind.
// SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
pub type oc_read_fn =
    Option<unsafe extern "C" fn(user: *mut c_void, offset: u64, buffer: *mut c_void, bytes: u64) -> u32>;

/// Called once, when nothing will be read any more; from any thread, and perhaps a moment after the last handle was
/// released, when a thread that was still tracing or reading lets go of the model: `user` must stay valid until then.
// SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
pub type oc_close_fn = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// Where a model is read from, if not from a file: a table of the caller's. Read-only.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_io {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Bytes of the model.
    pub size: u64,
    /// Reads.
    pub read_at: oc_read_fn,
    /// Closes; may be NULL. Called exactly once if opening or loading was tried with a valid table,
    /// whether it succeeded or not.
    pub close: oc_close_fn,
    /// Given to both.
    pub user: *mut c_void,
    /// What messages call it; may be NULL.
    pub name: *const c_char,
}

// SAFETY: `repr(C)`, words, pointers and nullable functions without padding; `struct_size` first.
unsafe impl Sized32 for oc_io {
    const NAME: &'static str = "oc_io";
}

/// The caller's table behind the crate's trait.
struct HostSource {
    size: u64,
    // SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
    read_at: unsafe extern "C" fn(*mut c_void, u64, *mut c_void, u64) -> u32,
    close: oc_close_fn,
    user: *mut c_void,
    name: PathBuf,
}

// SAFETY: the header says that both functions are called from any thread.
unsafe impl Send for HostSource {}
// SAFETY: as above.
unsafe impl Sync for HostSource {}

impl HostSource {
    /// # Safety
    /// NULL or initialised.
    unsafe fn new(table: *const oc_io) -> Checked<Self> {
        // SAFETY: the caller's contract.
        let table = unsafe { guard::read(table)? };
        guard::reserved(table.reserved, "oc_io.reserved")?;
        let Some(read_at) = table.read_at else { return bad("oc_io.read_at is NULL") };
        // SAFETY: as above.
        let name = unsafe { guard::optional_text(table.name, "oc_io.name")? };
        let name = name.unwrap_or("(the caller's model)").into();
        Ok(Self { size: table.size, read_at, close: table.close, user: table.user, name })
    }
}

impl Source for HostSource {
    fn len(&self) -> u64 {
        self.size
    }
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        // SAFETY: the caller gave the function for this; the buffer is as long as we say.
        let code = unsafe { (self.read_at)(self.user, offset, buf.as_mut_ptr().cast(), buf.len() as u64) };
        match code {
            0 => Ok(()),
            code => Err(io::Error::other(format!("the caller's read function returned {code}"))),
        }
    }
    fn name(&self) -> &Path {
        &self.name
    }
}

impl Drop for HostSource {
    fn drop(&mut self) {
        if let Some(close) = self.close {
            // SAFETY: the caller gave it for this; dropped once.
            unsafe { close(self.user) }
        }
    }
}

/// Opens the model at `path`: its tables and coarse blocks are read, and all of a small model; the rest when it is
/// used, or in the background where it fits. It may be larger than the context's memory budget: OC_STATUS_OVER_BUDGET
/// means that not even what must stay in memory fits, and oc_last_error_need gives the least budget that would do. No
/// more than 48 MB, or a quarter of the budget, is read here. One of those blocks that is damaged, or cannot be read,
/// fails it; of others that are, stand-ins are shown.
///
/// Ownership: the caller owns a count. Thread safety: any thread. Blocks: reads the disk; oc_model_load
/// does not.
/// # Safety
/// Live handle; `path` ends with 0; `out_model` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_open(
    context: *const oc_context,
    path: *const c_char,
    out_model: *mut *mut oc_model,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_model, "out_model")?;
        let path = guard::path(path, "path")?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let model = Model::open(&context.context, path)?;
            out.write(handles::give::<oc_model>(ModelObject::new(model)));
            Ok(())
        })
    })
}

/// Opens a model that the caller's own functions read.
///
/// Ownership: the caller owns a count; the table is copied. Thread safety: any thread. Blocks: calls
/// `read_at`.
/// # Safety
/// Live handle; `io` initialised; `out_model` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_open_io(
    context: *const oc_context,
    io: *const oc_io,
    out_model: *mut *mut oc_model,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_model, "out_model")?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let source = Arc::new(HostSource::new(io)?);
            let model = Model::open_source(&context.context, source)?;
            out.write(handles::give::<oc_model>(ModelObject::new(model)));
            Ok(())
        })
    })
}

/// Begins to open the model at `path` (or, if `io` is not NULL, the one that its functions read; `path`
/// is then ignored). When the job is done, oc_job_model gives the model. The job's progress counts the bytes of
/// blocks read.
///
/// Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `path` ends with 0 or `io` is initialised; `out_job` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_load(
    context: *const oc_context,
    path: *const c_char,
    io: *const oc_io,
    out_job: *mut *mut oc_job,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_job, "out_job")?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let of = context.context.clone();
            let source: Box<dyn FnOnce() -> Result<Arc<dyn Source>> + Send> = if io.is_null() {
                let path = guard::path(path, "path")?;
                Box::new(move || Ok(Arc::new(FileSource::open(path)?)))
            } else {
                let source = Arc::new(HostSource::new(io)?);
                Box::new(move || Ok(source))
            };
            let (progress, cancel) = (Arc::new(Progress::default()), Cancel::new());
            let open = move |task: &Task| -> Result<Product> {
                Ok(Box::new(Model::open_watched(&of, source()?, &task.progress, &task.cancel)?))
            };
            out.write(context.begin(progress, cancel, open)?);
            Ok(())
        })
    })
}

/// Which axis points up.
pub type oc_up_axis = u32;
/// Nobody said; views then take +Z.
pub const OC_UP_UNKNOWN: oc_up_axis = 0;
/// +X.
pub const OC_UP_X: oc_up_axis = 1;
/// +Y (glTF).
pub const OC_UP_Y: oc_up_axis = 2;
/// +Z (most CAD).
pub const OC_UP_Z: oc_up_axis = 3;

/// What a model is.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_model_info {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// An OC_UP_ number.
    pub up: oc_up_axis,
    /// Around everything, in model space; `max` is below `min` if there are no triangles.
    pub bounds_min: [f64; 3],
    /// The other corner.
    pub bounds_max: [f64; 3],
    /// Length unit; 0 if unknown.
    pub metres_per_unit: f64,
    /// Triangles in the input of the build.
    pub triangles_in: u64,
    /// Triangles stored, those of shared meshes once.
    pub triangles_stored: u64,
    /// Triangles to be seen, those of shared meshes once for each instance.
    pub triangles_placed: u64,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Bytes of geometry in memory when all of it is there: nodes and triangles.
    pub geometry_bytes: u64,
    /// Bytes in memory now.
    pub resident_bytes: u64,
    /// Number of parts.
    pub parts: u32,
    /// Instances of shared meshes.
    pub instances: u32,
    /// Blocks of geometry.
    pub blocks: u32,
    /// Whether single triangles carry colours.
    pub has_colours: u32,
}

// SAFETY: `repr(C)`, words and doubles without padding, `struct_size` first.
unsafe impl Sized32 for oc_model_info {
    const NAME: &'static str = "oc_model_info";
}

/// What the model is.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_info` initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_get_info(model: *const oc_model, out_info: *mut oc_model_info) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_info)?;
        handles::with(model, |model: &Shell<ModelObject>| {
            let (info, memory) = (model.model.info(), model.model.memory());
            fill.with(oc_model_info {
                struct_size: 0,
                up: info.up as u32,
                bounds_min: info.bounds.min.to_array(),
                bounds_max: info.bounds.max.to_array(),
                metres_per_unit: info.metres_per_unit.unwrap_or(0.0),
                triangles_in: info.triangles_in,
                triangles_stored: info.triangles_stored,
                triangles_placed: info.triangles_placed,
                file_bytes: info.file_bytes,
                geometry_bytes: memory.geometry,
                resident_bytes: memory.resident + memory.tables,
                parts: info.parts,
                instances: info.instances,
                blocks: info.geometry_blocks,
                has_colours: u32::from(info.has_colours),
            });
            Ok(())
        })
    })
}

/// The parent of a part that has none.
pub const OC_NO_INDEX: u32 = 0xFFFFFFFF;

/// A part of a model.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_part_info {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// Index of the part above it; OC_NO_INDEX if there is none.
    pub parent: u32,
    /// The id that whoever built the model gave it.
    pub id: u64,
    /// Its name, UTF-8; may be empty. The model's: valid as long as the model.
    pub name: *const c_char,
    /// Triangles of its own, not of the parts below it.
    pub triangles: u64,
    /// Around them, in model space; `max` is below `min` if there are none.
    pub bounds_min: [f64; 3],
    /// The other corner.
    pub bounds_max: [f64; 3],
    /// Its material: linear RGBA, alpha is the opacity.
    pub colour: [f32; 4],
    /// From 0 to 1.
    pub metalness: f32,
    /// From 0 to 1.
    pub roughness: f32,
}

// SAFETY: `repr(C)`, numbers and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_part_info {
    const NAME: &'static str = "oc_part_info";
}

/// The part with this index, below `oc_model_info.parts`.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_part` initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_get_part(
    model: *const oc_model,
    index: u32,
    out_part: *mut oc_part_info,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_part)?;
        handles::with(model, |model: &Shell<ModelObject>| {
            let Some(part) = model.model.parts().get(index as usize) else {
                return bad(format!("part {index} of {}", model.model.parts().len()));
            };
            fill.with(oc_part_info {
                struct_size: 0,
                parent: part.parent.unwrap_or(OC_NO_INDEX),
                id: part.id,
                name: model.name(index as usize),
                triangles: part.triangles,
                bounds_min: part.bounds.min.to_array(),
                bounds_max: part.bounds.max.to_array(),
                colour: part.colour,
                metalness: part.metalness,
                roughness: part.roughness,
            });
            Ok(())
        })
    })
}

/// The index of the first part with this id. OC_STATUS_INVALID_ARGUMENT if there is none.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_index` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_find_part(model: *const oc_model, id: u64, out_index: *mut u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_index, "out_index")?;
        handles::with(model, |model: &Shell<ModelObject>| match model.model.part_index(id) {
            Some(index) => {
                out.write(index);
                Ok(())
            }
            None => bad(format!("the model has no part {id}")),
        })
    })
}

/// A view that fits the model: 0 and 1 show the whole, 2 and 3 the same from a quarter of the distance.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_camera` initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_get_view(model: *const oc_model, view: u32, out_camera: *mut oc_camera) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_camera)?;
        handles::with(model, |model: &Shell<ModelObject>| match model.model.views().get(view as usize) {
            Some(camera) => {
                fill.with(oc_camera::from_rust(camera));
                Ok(())
            }
            None => bad(format!("view {view}: there are 0 to 3")),
        })
    })
}

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_retain(model: *mut oc_model) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(model) }
}

/// Takes a count back; the handle is gone with the last; scenes that show the model keep its data. NULL does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_release(model: *mut oc_model) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(model) }
}
