//! Frames: one view being rendered, with its buffers.

use super::context::{ContextObject, oc_context};
use super::guard::{Checked, Fill, Sized32, Strided, bad, boundary, out, read, read_or_default, reserved};
use super::handles::{self, Shell, handle};
use super::job::*;
use super::query::oc_hit;
use super::scene::{SceneObject, oc_scene};
use super::status::{OC_STATUS_INTERNAL, oc_status};
use super::view::oc_camera;
use crate::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Mapped, Outputs, Target};
use std::ffi::c_void;
use std::sync::Arc;
use std::time::Duration;

/// One view being rendered in the background, with its buffers.
pub struct oc_frame {
    _private: [u8; 0],
}

handle!(oc_frame, FrameObject, 5);

pub(crate) struct FrameObject {
    frame: Frame,
}

/// A buffer of a picture. Rows from the top, pixels from the left.
pub type oc_buffer = u32;
/// 4 bytes: sRGB red, green, blue, and linear alpha.
pub const OC_BUFFER_COLOUR_SRGB8: oc_buffer = 0;
/// 4 floats: linear RGB, not clamped, and alpha.
pub const OC_BUFFER_COLOUR_LINEAR: oc_buffer = 1;
/// 1 float: distance from the eye along the view direction, world units; infinity for a miss.
pub const OC_BUFFER_DEPTH: oc_buffer = 2;
/// 3 floats: unit geometric normal in world space, facing the eye; 0 for a miss.
pub const OC_BUFFER_NORMAL: oc_buffer = 3;
/// 1 uint64_t: the part's id; OC_NO_ID for a miss.
pub const OC_BUFFER_PART: oc_buffer = 4;
/// 1 uint64_t: the triangle's index in the input of the build; OC_NO_ID for a miss.
pub const OC_BUFFER_PRIM: oc_buffer = 5;
/// 1 uint64_t: the instance's id; OC_NO_ID for a miss.
pub const OC_BUFFER_INSTANCE: oc_buffer = 6;
/// 1 byte: an OC_HIT_ number.
pub const OC_BUFFER_KIND: oc_buffer = 7;
/// 1 float: some original surface lies within this distance of what is shown; world units.
pub const OC_BUFFER_ERROR: oc_buffer = 8;

/// The element of a buffer.
pub type oc_format = u32;
/// 4 bytes.
pub const OC_FORMAT_U8X4: oc_format = 1;
/// 4 floats.
pub const OC_FORMAT_F32X4: oc_format = 2;
/// 1 float.
pub const OC_FORMAT_F32: oc_format = 3;
/// 3 floats.
pub const OC_FORMAT_F32X3: oc_format = 4;
/// 1 uint64_t.
pub const OC_FORMAT_U64: oc_format = 5;
/// 1 byte.
pub const OC_FORMAT_U8: oc_format = 6;

fn buffer(number: oc_buffer) -> Checked<Buffer> {
    match Buffer::ALL.get(number as usize) {
        Some(buffer) => Ok(*buffer),
        None => bad(format!("buffer {number} is unknown")),
    }
}

fn format(buffer: Buffer) -> oc_format {
    match buffer {
        Buffer::ColourSrgb8 => OC_FORMAT_U8X4,
        Buffer::ColourLinear => OC_FORMAT_F32X4,
        Buffer::Depth | Buffer::Error => OC_FORMAT_F32,
        Buffer::Normal => OC_FORMAT_F32X3,
        Buffer::Part | Buffer::Primitive | Buffer::Instance => OC_FORMAT_U64,
        Buffer::Kind => OC_FORMAT_U8,
    }
}

/// The caller's memory for a buffer; an element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_target {
    /// The first pixel of the first row. Written from any thread while a frame renders; whole once the
    /// frame is done. Must stay until the frame is released or resized.
    pub memory: *mut c_void,
    /// Bytes there.
    pub size: u64,
    /// Bytes from a row to the next; 0: tightly packed.
    pub row_pitch: u64,
    /// An OC_BUFFER_ number.
    pub buffer: oc_buffer,
    /// Must be 0.
    pub reserved: u32,
}

/// What a frame is made with. All zeros: 1024 by 768 pixels of OC_BUFFER_COLOUR_SRGB8.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_frame_desc {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// Pixels in a row, up to 65536. 0: 1024.
    pub width: u32,
    /// Rows, up to 65536. 0: 768.
    pub height: u32,
    /// The buffers to keep: 1 << OC_BUFFER_ numbers, joined with `|`. 0: OC_BUFFER_COLOUR_SRGB8, or none
    /// if there are targets.
    pub buffers: u32,
    /// The caller's memory for some buffers (these or others), or NULL.
    pub targets: *const oc_target,
    /// How many, tightly packed.
    pub target_count: u64,
}

// SAFETY: `repr(C)`, words and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_frame_desc {
    const NAME: &'static str = "oc_frame_desc";
}

/// The caller's memory behind the crate's trait.
struct HostTarget {
    memory: *mut u8,
    row_pitch: usize,
    pixel: usize,
}

// SAFETY: the header says that the memory is written from any thread.
unsafe impl Send for HostTarget {}
// SAFETY: as above; two writes never meet the same pixels.
unsafe impl Sync for HostTarget {}

impl HostTarget {
    fn new(target: &oc_target, buffer: Buffer, width: u32, height: u32) -> Checked<Self> {
        reserved(target.reserved, "oc_target.reserved")?;
        let pixel = buffer.pixel_bytes();
        let row = u64::from(width) * pixel as u64;
        let row_pitch = if target.row_pitch == 0 { row } else { target.row_pitch };
        if target.memory.is_null() {
            return bad("oc_target.memory is NULL");
        }
        if row_pitch < row {
            return bad(format!("oc_target.row_pitch of {row_pitch} bytes is below a row's {row}"));
        }
        let need = u64::from(height - 1).checked_mul(row_pitch).and_then(|b| b.checked_add(row));
        match need {
            Some(need) if need <= target.size && target.size <= isize::MAX as u64 => {
                Ok(Self { memory: target.memory.cast(), row_pitch: row_pitch as usize, pixel })
            }
            _ => bad(format!("oc_target.size of {} bytes is too small for {width} x {height}", target.size)),
        }
    }
}

impl Target for HostTarget {
    fn write(&self, x: u32, y: u32, pixels: &[u8]) {
        // SAFETY: `new` found that all rows fit; the frame writes pixels inside the picture only.
        unsafe {
            let at = self.memory.add(y as usize * self.row_pitch + x as usize * self.pixel);
            at.copy_from_nonoverlapping(pixels.as_ptr(), pixels.len());
        }
    }
}

/// Reads the description of a frame.
///
/// # Safety
/// NULL or initialised, and so are its targets.
unsafe fn options(desc: *const oc_frame_desc) -> Checked<FrameOptions> {
    // SAFETY: the caller's contract.
    let desc = unsafe { read_or_default(desc)? };
    let default = FrameOptions::default();
    let width = if desc.width == 0 { default.width } else { desc.width };
    let height = if desc.height == 0 { default.height } else { desc.height };
    if desc.buffers & !Outputs::ALL.0 != 0 {
        return bad(format!("oc_frame_desc.buffers {:#x}: some are unknown", desc.buffers));
    }
    if desc.target_count > Buffer::ALL.len() as u64 {
        return bad(format!("{} targets; at most one for each buffer", desc.target_count));
    }
    let outputs = if desc.buffers == 0 && desc.target_count == 0 { default.outputs } else { Outputs(desc.buffers) };
    let given = Strided::new(desc.targets, desc.target_count, 0, "oc_frame_desc.targets")?;
    let mut targets: Vec<(Buffer, Arc<dyn Target>)> = Vec::new();
    for i in 0..given.count {
        // SAFETY: within the array.
        let target = unsafe { given.get(i) };
        let buffer = buffer(target.buffer)?;
        if targets.iter().any(|(b, _)| *b == buffer) {
            return bad(format!("two targets for buffer {}", target.buffer));
        }
        targets.push((buffer, Arc::new(HostTarget::new(&target, buffer, width, height)?)));
    }
    Ok(FrameOptions { width, height, outputs, targets })
}

/// Makes a frame. `desc` may be NULL: all defaults.
///
/// Ownership: the caller owns a count. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `desc` initialised or NULL; `out_frame` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_create(
    context: *const oc_context,
    desc: *const oc_frame_desc,
    out_frame: *mut *mut oc_frame,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_frame, "out_frame")?;
        let options = options(desc)?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let frame = Frame::new(&context.context, options)?;
            out.write(handles::give::<oc_frame>(FrameObject { frame }));
            Ok(())
        })
    })
}

/// What a request asks. All zeros: exact, one ray a pixel.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_frame_settings {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// Rays for a pixel's colour, up to 1024; the other buffers take the pixel's middle. 0: 1.
    pub samples: u32,
    /// Pixels of error: the area, in pixels, that a stand-in may cover. 0: exact.
    pub poe: f32,
    /// Light from everywhere, so that nothing is black. 0: 0.15; below 0: none.
    pub ambient: f32,
}

// SAFETY: `repr(C)`, words and floats without padding, `struct_size` first.
unsafe impl Sized32 for oc_frame_settings {
    const NAME: &'static str = "oc_frame_settings";
}

impl oc_frame_settings {
    fn to_rust(self) -> FrameSettings {
        let default = FrameSettings::default();
        FrameSettings {
            poe: self.poe,
            samples: if self.samples == 0 { default.samples } else { self.samples },
            ambient: match self.ambient {
                0.0 => default.ambient,
                a if a < 0.0 => 0.0,
                a => a,
            },
        }
    }
}

/// Begins a picture of the committed scene, and returns at once. What the frame was rendering is
/// cancelled and replaced. `settings` may be NULL: all defaults.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handles; `camera` initialised; `settings` initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_request(
    frame: *mut oc_frame,
    scene: *const oc_scene,
    camera: *const oc_camera,
    settings: *const oc_frame_settings,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let camera = read(camera)?.to_rust()?;
        let settings = read_or_default(settings)?.to_rust();
        let scene: &Shell<SceneObject> = handles::borrow(scene)?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            Ok(frame.frame.request(&scene.scene.state(), &camera, &settings)?)
        })
    })
}

fn snapshot(status: &FrameStatus) -> Snapshot {
    let base = match (status.state, &status.error) {
        (FrameState::Idle, _) => Snapshot { state: OC_STATE_IDLE, ..Snapshot::running() },
        (FrameState::Running, _) => Snapshot::running(),
        (FrameState::Converged, _) => Snapshot::done(),
        (FrameState::Failed, Some(error)) => Snapshot::ended_with(error),
        (FrameState::Cancelled | FrameState::Failed, _) => Snapshot::cancelled(),
    };
    Snapshot {
        fraction: status.fraction,
        done: status.pixels_exact + status.pixels_lod + status.pixels_missing,
        total: status.pixels_total,
        bytes: status.bytes_resident,
        ..base
    }
}

/// Reports the status; a frame whose worker panicked is poisoned from then on.
fn report(frame: &Shell<FrameObject>, status: &FrameStatus, fill: Option<Fill<oc_progress>>) {
    let snapshot = snapshot(status);
    if snapshot.status == OC_STATUS_INTERNAL {
        frame.poison();
    }
    if let Some(fill) = fill {
        snapshot.report(fill);
    }
}

/// How far the last request is. After OC_STATE_FAILED oc_last_error of this thread tells why.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_progress` initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_poll(frame: *const oc_frame, out_progress: *mut oc_progress) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_progress)?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            report(frame, &frame.frame.poll(), Some(fill));
            Ok(())
        })
    })
}

/// Waits until the last request has ended, `timeout_ms` at most (OC_FOREVER: no limit), and says how far it
/// is. A timeout is no failure: the state is then OC_STATE_RUNNING. `out_progress` may be NULL.
///
/// Thread safety: any thread. Blocks; does the work itself where the context has no threads.
/// # Safety
/// Live handle; `out_progress` initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_wait(
    frame: *const oc_frame,
    timeout_ms: u32,
    out_progress: *mut oc_progress,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = if out_progress.is_null() { None } else { Some(Fill::new(out_progress)?) };
        handles::with(frame, |frame: &Shell<FrameObject>| {
            let status = frame.frame.wait(timeout(timeout_ms).unwrap_or(Duration::MAX));
            report(frame, &status, fill);
            Ok(())
        })
    })
}

/// Asks the frame to stop rendering; it does so within a tile. The last complete picture stays whole.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_cancel(frame: *mut oc_frame) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(frame, |frame: &Shell<FrameObject>| {
            frame.frame.cancel();
            Ok(())
        })
    })
}

/// Changes the size from the next request on; cancels what is rendering and lets go of the targets. The last
/// complete picture keeps its size until the next is complete.
///
/// Thread safety: any thread. Blocks until nobody writes to the targets any more.
/// # Safety
/// Live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_resize(frame: *mut oc_frame, width: u32, height: u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(frame, |frame: &Shell<FrameObject>| Ok(frame.frame.resize(width, height)?))
    })
}

/// Has `wake` called whenever a request ends; NULL: nobody is called.
///
/// `user` must stay usable until `wake` was replaced or the frame released.
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `wake` is NULL or may be called from any thread with `user`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_set_wake(frame: *mut oc_frame, wake: oc_wake_fn, user: *mut c_void) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(frame, |frame: &Shell<FrameObject>| {
            let wake = Wake::new(wake, user);
            frame.frame.set_wake(wake.map(|wake| {
                Arc::new(move || {
                    #[cfg(debug_assertions)]
                    super::testing::trip(super::testing::IN_WORK);
                    wake.call()
                }) as Arc<dyn Fn() + Send + Sync>
            }));
            Ok(())
        })
    })
}

/// How true the picture is that the last request is making or has made.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_frame_accuracy {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// The pixels of error in force.
    pub effective_poe: f32,
    /// Counts the requests of this frame, from 1; 0: none yet.
    pub request: u64,
    /// Pixels whose answer is exact.
    pub pixels_exact: u64,
    /// Pixels that show a stand-in as fine as asked.
    pub pixels_lod: u64,
    /// Pixels that show a stand-in for missing data.
    pub pixels_missing: u64,
    /// Pixels of the picture.
    pub pixels_total: u64,
    /// Bytes in memory of what the scene shows.
    pub bytes_resident: u64,
    /// Bytes wanted that are not in memory.
    pub bytes_wanted: u64,
    /// Seconds since the request, until it ended.
    pub seconds: f64,
    /// Estimated seconds to go; infinity if unknown.
    pub seconds_to_go: f64,
    /// Largest error in pixels.
    pub worst_error: f32,
    /// Mean error in pixels.
    pub mean_error: f32,
}

// SAFETY: `repr(C)`, numbers without padding, `struct_size` first.
unsafe impl Sized32 for oc_frame_accuracy {
    const NAME: &'static str = "oc_frame_accuracy";
}

/// How true the picture of the last request is.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_accuracy` initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_get_accuracy(
    frame: *const oc_frame,
    out_accuracy: *mut oc_frame_accuracy,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_accuracy)?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            let status = frame.frame.poll();
            fill.with(oc_frame_accuracy {
                struct_size: 0,
                effective_poe: status.effective_poe,
                request: status.request,
                pixels_exact: status.pixels_exact,
                pixels_lod: status.pixels_lod,
                pixels_missing: status.pixels_missing,
                pixels_total: status.pixels_total,
                bytes_resident: status.bytes_resident,
                bytes_wanted: status.bytes_wanted,
                seconds: status.seconds,
                seconds_to_go: status.seconds_to_go,
                worst_error: status.worst_error_px,
                mean_error: status.mean_error_px,
            });
            Ok(())
        })
    })
}

/// What is seen at pixel (`x`, `y`), counted from the top left, of the last complete picture (before there is
/// one, of the last request): exact, all members filled.
///
/// OC_STATUS_INVALID_STATE before the first request. Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// Live handle; `out_hit` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_pick(frame: *const oc_frame, x: u32, y: u32, out_hit: *mut oc_hit) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_hit, "out_hit")?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            out.write_unaligned((&frame.frame.pick(x, y)?).into());
            Ok(())
        })
    })
}

/// Keeps a buffer of a complete picture readable.
pub struct oc_mapping {
    _private: [u8; 0],
}

handle!(oc_mapping, MappingObject, 6);

pub(crate) struct MappingObject {
    _mapped: Mapped,
}

/// A buffer of a complete picture.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_pixels {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// An OC_FORMAT_ number.
    pub format: oc_format,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The first pixel of the first row, aligned for its elements; nobody writes there.
    pub data: *const c_void,
    /// Bytes from a row to the next.
    pub row_pitch: u64,
    /// Bytes in all.
    pub size: u64,
    /// Keeps `data` alive: release it when done.
    pub mapping: *mut oc_mapping,
}

// SAFETY: `repr(C)`, words and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_pixels {
    const NAME: &'static str = "oc_pixels";
}

/// Maps a buffer of the last complete picture, without a copy. It stays whole and readable until the mapping
/// is released, whatever the frame does meanwhile, even if the frame is released.
///
/// OC_STATUS_INVALID_STATE before a picture is complete, or if the frame does not keep this buffer.
/// Ownership: the caller owns a count of `out_pixels->mapping`. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_pixels` initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_map(
    frame: *const oc_frame,
    buffer: oc_buffer,
    out_pixels: *mut oc_pixels,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_pixels)?;
        let buffer = self::buffer(buffer)?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            let mapped = frame.frame.map(buffer)?;
            let mut pixels = oc_pixels {
                struct_size: 0,
                format: format(buffer),
                width: mapped.width(),
                height: mapped.height(),
                data: mapped.bytes().as_ptr().cast(),
                row_pitch: mapped.row_pitch() as u64,
                size: mapped.bytes().len() as u64,
                mapping: std::ptr::null_mut(),
            };
            pixels.mapping = handles::give::<oc_mapping>(MappingObject { _mapped: mapped });
            fill.with(pixels);
            Ok(())
        })
    })
}

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_mapping_retain(mapping: *mut oc_mapping) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(mapping) }
}

/// Takes a count back; with the last one the pixels may go. NULL does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_mapping_release(mapping: *mut oc_mapping) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(mapping) }
}

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_retain(frame: *mut oc_frame) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(frame) }
}

/// Takes a count back; with the last one the frame is cancelled. NULL does nothing.
///
/// Thread safety: any thread. Blocks until the tiles in flight are done.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_release(frame: *mut oc_frame) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(frame) }
}
