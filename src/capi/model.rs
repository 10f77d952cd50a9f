//! Models: built files, opened read-only.

use super::background::{Product, Task};
use super::context::{ContextObject, oc_context};
use super::guard::{self, Checked, Fill, Sized32, bad, boundary, out};
use super::handles::{self, Shell, handle};
use super::job::oc_job;
use super::status::oc_status;
use super::view::oc_camera;
use crate::base::error::Result;
use crate::base::inside_read::reading;
use crate::base::progress::{Cancel, Progress};
use crate::base::units::UpAxis;
use crate::scene::{Camera, Model, PartInfo};
use crate::store::{FileSource, Source};
use std::ffi::{CStr, c_char, c_void};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A built model, opened read-only. Scenes share it.
pub struct oc_model {
    _private: [u8; 0],
}

handle!(oc_model, ModelObject, 3);

pub(crate) struct ModelObject {
    pub(crate) model: Model,
}

impl ModelObject {
    pub(crate) fn new(model: Model) -> Self {
        Self { model }
    }

    /// The views of [`oc_model_get_view`].
    fn views(&self) -> [Camera; 4] {
        self.model.fitted_views(self.model.info().up, (1, 1))
    }

    /// The name of a part, which lives as long as the model.
    fn name(&self, part: usize) -> *const c_char {
        let name = CStr::from_bytes_until_nul(self.model.parts().name_and_nul(part).as_bytes());
        name.unwrap_or_default().as_ptr()
    }
}

/// Callback: reads `bytes` bytes at `offset` of the model into `buffer`.
///
/// Returns 0 if it has read all bytes, any other number on failure.
/// Any thread may call it, several at once, but never while the library holds a lock. It must not unwind.
/// It must not call functions that read models or wait: queries, oc_model_open, oc_job_wait, oc_frame_wait. These
/// return OC_STATUS_INVALID_STATE there. It must not wait for another thread that calls them either.
// SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment above.
pub type oc_read_fn =
    Option<unsafe extern "C" fn(user: *mut c_void, offset: u64, buffer: *mut c_void, bytes: u64) -> u32>;

/// Callback: the library will not read from `user` any more. It is called once.
///
/// Any thread may call it. It may come a moment after the release of the last handle, when another thread stops tracing
/// or reading the model: `user` must stay valid until then.
// SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment above.
pub type oc_close_fn = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// The caller's own functions that read a model, in place of a file.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_io {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Size of the model in bytes.
    pub size: u64,
    /// Reads a range of bytes. Must not be NULL.
    pub read_at: oc_read_fn,
    /// Called exactly once after opening or loading was tried with a valid table, even if it failed. May be NULL.
    pub close: oc_close_fn,
    /// Passed to both functions.
    pub user: *mut c_void,
    /// Name of the model in messages, UTF-8. May be NULL.
    pub name: *const c_char,
}

// SAFETY: `repr(C)`, integers, pointers and nullable functions without padding; `struct_size` first.
unsafe impl Sized32 for oc_io {
    const NAME: &'static str = "oc_io";
}

/// The host's table, as a [`Source`] of the crate.
struct HostSource {
    size: u64,
    // SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment on
    // `oc_read_fn`.
    read_at: unsafe extern "C" fn(*mut c_void, u64, *mut c_void, u64) -> u32,
    close: oc_close_fn,
    user: *mut c_void,
    name: PathBuf,
}

// SAFETY: the header says that any thread may call both functions.
unsafe impl Send for HostSource {}
// SAFETY: as above.
unsafe impl Sync for HostSource {}

impl HostSource {
    /// Checks and copies the host's table.
    ///
    /// # Safety
    /// `table` is NULL or initialised.
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
        // SAFETY: the host gave the function for this call. The buffer has the length that is passed.
        let code = reading(|| unsafe { (self.read_at)(self.user, offset, buf.as_mut_ptr().cast(), buf.len() as u64) });
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
            // SAFETY: the host gave the function for this call. The source is dropped once.
            unsafe { close(self.user) }
        }
    }
}

/// Opens a model file.
///
/// This call reads the tables, the root blocks and the coarse blocks, and all blocks of a small model: 48 MiB or a
/// quarter of the memory budget at most, whichever is less. Root blocks are read in any case. Other blocks are read
/// when they are used, or in the background if they fit. The model may be larger than the memory budget of the context.
///
/// - `path`: path of the model file.
/// - `out_model`: receives the model.
///
/// Errors:
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: the file, or a block that this call reads, is unreadable or damaged. For other
///   blocks that are, frames show stand-ins.
/// - OC_STATUS_NEWER_FORMAT: a newer version of the library wrote the model.
/// - OC_STATUS_OVER_BUDGET: the data that must stay in memory does not fit the budget. oc_last_error_need returns the
///   least budget that suffices.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Blocks: reads the disk. oc_model_load does the same in the background.
/// # Safety
/// `context` is a live handle; `path` ends with 0; `out_model` is writable.
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

/// Opens a model that the caller's own functions read. Otherwise as oc_model_open.
///
/// - `io`: the functions. The table is copied.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Blocks: calls `read_at`.
/// # Safety
/// `context` is a live handle; `io` is initialised; `out_model` is writable.
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

/// Begins to open a model in the background. When the job is done, oc_job_model returns the model.
///
/// - `path`: path of the model file. Ignored if `io` is not NULL.
/// - `io`: the caller's own functions that read the model, or NULL. The table is copied.
/// - `out_job`: receives the job. Its progress counts the bytes of blocks read. Its errors are those of oc_model_open.
///
/// Errors: OC_STATUS_IO if a thread cannot be started.
///
/// Ownership: the caller receives one reference to the job.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `context` is a live handle; `path` ends with 0 or `io` is initialised; `out_job` is writable.
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

/// Axis that points up.
pub type oc_up_axis = u32;
/// Unknown. The views of oc_model_get_view and oc_scene_fit then take +Z.
pub const OC_UP_UNKNOWN: oc_up_axis = 0;
/// +X.
pub const OC_UP_X: oc_up_axis = 1;
/// +Y (glTF).
pub const OC_UP_Y: oc_up_axis = 2;
/// +Z (most CAD).
pub const OC_UP_Z: oc_up_axis = 3;

/// Reads an up axis.
pub(super) fn up_axis(axis: oc_up_axis, name: &str) -> Checked<UpAxis> {
    match axis {
        OC_UP_UNKNOWN => Ok(UpAxis::Unknown),
        OC_UP_X => Ok(UpAxis::X),
        OC_UP_Y => Ok(UpAxis::Y),
        OC_UP_Z => Ok(UpAxis::Z),
        other => bad(format!("{name} {other} is unknown")),
    }
}

/// Properties of a model.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_model_info {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// One of the OC_UP_ constants.
    pub up: oc_up_axis,
    /// Least corner of the bounds of all triangles, in model space. Greater than `bounds_max` if there are none.
    pub bounds_min: [f64; 3],
    /// Greatest corner of the bounds.
    pub bounds_max: [f64; 3],
    /// Length of a unit in metres. 0: unknown.
    pub metres_per_unit: f64,
    /// Number of triangles in the input of the build.
    pub triangles_in: u64,
    /// Number of triangles stored. Triangles of shared meshes count once.
    pub triangles_stored: u64,
    /// Number of triangles visible in the model. Triangles of shared meshes count once for each instance.
    pub triangles_placed: u64,
    /// Size of the file in bytes.
    pub file_bytes: u64,
    /// Bytes that all nodes and triangles take in memory.
    pub geometry_bytes: u64,
    /// Bytes in memory now, including tables.
    pub resident_bytes: u64,
    /// Number of parts.
    pub parts: u32,
    /// Number of instances of shared meshes.
    pub instances: u32,
    /// Number of blocks of geometry.
    pub blocks: u32,
    /// 1: triangles may have colours of their own. 0: they have the colours of their parts.
    pub has_colours: u32,
    /// 1: triangles may have normals at their corners that make them appear smooth. 0: each has only its own.
    pub has_normals: u32,
    /// Always 0.
    pub reserved: u32,
    /// Bytes of the form for exact rays, in addition to `resident_bytes`. 0: there is none now. See OC_CONTEXT_COMPACT.
    pub fast_form_bytes: u64,
    /// Number of looks from eighteen directions, see OC_STAND_INS_PROXIES.
    pub proxies: u64,
    /// Bytes of memory that these take, which `resident_bytes` includes.
    pub proxy_bytes: u64,
}

// SAFETY: `repr(C)`, integers and doubles without padding, `struct_size` first.
unsafe impl Sized32 for oc_model_info {
    const NAME: &'static str = "oc_model_info";
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_model_info, has_normals);
}

/// Returns the properties of a model.
///
/// - `out_info`: receives the properties. Initialise it with OC_INIT.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `model` is a live handle; `out_info` is initialised.
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
                has_normals: u32::from(info.has_normals),
                reserved: 0,
                fast_form_bytes: memory.resident_form,
                proxies: info.proxies,
                proxy_bytes: info.proxy_bytes,
            });
            Ok(())
        })
    })
}

/// Index of the parent of a part that has none.
pub const OC_NO_INDEX: u32 = 0xFFFFFFFF;

/// Flags of a part.
pub type oc_part_flags = u32;
/// The part's own triangles form a closed surface: each edge belongs to an even number of them. Rays cross the part an
/// even number of times. The stored positions decide, and triangles without area count.
pub const OC_PART_CLOSED: oc_part_flags = 1;
/// The surface is closed, and its triangles face one way: each edge is passed as often in one direction as in the
/// other. Rays leave the part as often as they enter it. A part that is closed without this flag has triangles that
/// face the wrong way, or has no inside.
pub const OC_PART_ORIENTED: oc_part_flags = 2;

fn part_flags(part: &PartInfo) -> oc_part_flags {
    let closed = if part.is_closed { OC_PART_CLOSED } else { 0 };
    if part.is_oriented { closed | OC_PART_ORIENTED } else { closed }
}

/// Properties of a part of a model.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_part_info {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Index of the parent part. OC_NO_INDEX: it has none.
    pub parent: u32,
    /// Id of the part, as passed when the model was built.
    pub id: u64,
    /// Name in UTF-8; may be empty. The model owns the string: it is valid as long as the model.
    pub name: *const c_char,
    /// Number of the part's own triangles, without those of its child parts.
    pub triangles: u64,
    /// Least corner of the bounds of these triangles, in model space. Greater than `bounds_max` if there are none.
    pub bounds_min: [f64; 3],
    /// Greatest corner of the bounds.
    pub bounds_max: [f64; 3],
    /// Material: linear RGBA. Alpha is the opacity.
    pub colour: [f32; 4],
    /// Material: metalness, 0 to 1.
    pub metalness: f32,
    /// Material: roughness, 0 to 1.
    pub roughness: f32,
    /// OC_PART_ flags, combined with `|`.
    pub flags: oc_part_flags,
    /// Always 0.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, numbers and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_part_info {
    const NAME: &'static str = "oc_part_info";
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_part_info, flags);
}

/// Returns the properties of a part.
///
/// - `index`: index of the part, below `parts` of oc_model_info.
/// - `out_part`: receives the properties. Initialise it with OC_INIT.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if `index` is out of range.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `model` is a live handle; `out_part` is initialised.
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
                return bad(format!(
                    "part index {index} is out of range: the model has {} parts",
                    model.model.parts().len()
                ));
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
                flags: part_flags(&part),
                reserved: 0,
            });
            Ok(())
        })
    })
}

/// Finds a part by its id. If several parts have the id, returns the first.
///
/// - `id`: id of the part, as passed when the model was built.
/// - `out_index`: receives the index of the part.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if no part has the id.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `model` is a live handle; `out_index` is writable.
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

/// Returns a perspective camera that fits the model. oc_scene_fit has more choices.
///
/// - `view`: 0 and 1 show the whole model from two sides, as large as a square picture allows; wider pictures show it
///   too. 2 and 3 are closer views from the same sides.
/// - `out_camera`: receives the camera. Initialise it with OC_INIT.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if `view` is above 3.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `model` is a live handle; `out_camera` is initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_get_view(model: *const oc_model, view: u32, out_camera: *mut oc_camera) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_camera)?;
        handles::with(model, |model: &Shell<ModelObject>| match model.views().get(view as usize) {
            Some(camera) => {
                fill.with(oc_camera::from_rust(camera));
                Ok(())
            }
            None => bad(format!("view is {view}; it must be from 0 to 3")),
        })
    })
}

/// Flags of oc_model_get_placement.
pub type oc_placement_flags = u32;
/// The model does not say which axis is up: it was not turned.
pub const OC_PLACEMENT_UP_UNKNOWN: oc_placement_flags = 1;
/// The model does not say how long its unit is: it was not scaled.
pub const OC_PLACEMENT_UNIT_UNKNOWN: oc_placement_flags = 2;

/// Returns the transform that gives the model an up axis and a unit of length, for oc_scene_add_instance. With the same
/// arguments for each model of a scene, all stand upright and have the same scale.
///
/// - `up`: the up axis of the world: one of the OC_UP_ constants. OC_UP_UNKNOWN: the model is not turned.
/// - `metres_per_unit`: length of a unit of the world in metres, e.g. 0.001 for millimetres; finite and above 0. 0: the
///   model is not scaled.
/// - `out_world_from_model`: receives 12 doubles. It turns about the model's origin, such that front and right agree
///   too (see oc_view), and scales.
/// - `out_flags`: receives OC_PLACEMENT_ flags, combined with `|`: what was asked, but the model does not say. May be
///   NULL.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `model` is a live handle; `out_world_from_model` has room for 12 doubles; `out_flags` is writable or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_get_placement(
    model: *const oc_model,
    up: oc_up_axis,
    metres_per_unit: f64,
    out_world_from_model: *mut f64,
    out_flags: *mut oc_placement_flags,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_world_from_model.cast::<[f64; 12]>(), "out_world_from_model")?;
        let up = Some(up_axis(up, "up")?).filter(|up| *up != UpAxis::Unknown);
        let unit = (metres_per_unit != 0.0).then_some(metres_per_unit);
        handles::with(model, |model: &Shell<ModelObject>| {
            let (placement, info) = (model.model.placement(up, unit)?, model.model.info());
            out.write_unaligned(placement.to_cols_array());
            let flag = |is_unknown: bool, flag: oc_placement_flags| if is_unknown { flag } else { 0 };
            if !out_flags.is_null() {
                out_flags.write(
                    flag(up.is_some() && info.up == UpAxis::Unknown, OC_PLACEMENT_UP_UNKNOWN)
                        | flag(unit.is_some() && info.metres_per_unit.is_none(), OC_PLACEMENT_UNIT_UNKNOWN),
                );
            }
            Ok(())
        })
    })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `model` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_retain(model: *mut oc_model) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(model) }
}

/// Releases one reference. The last release invalidates the handle; scenes that show the model keep its data. NULL:
/// does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `model` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_release(model: *mut oc_model) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(model) }
}
