//! Frames: one view that is rendered in the background, with its buffers.

use super::context::{ContextObject, oc_context};
use super::guard::{Checked, Fill, Sized32, Strided, bad, boundary, out, read, read_or_default};
use super::handles::{self, Shell, handle};
use super::job::*;
use super::pixels::{HostTarget, buffer, oc_target};
use super::query::oc_hit;
use super::scene::{SceneObject, oc_scene};
use super::status::{OC_STATUS_INTERNAL, oc_status};
use super::view::oc_camera;
use crate::base::inside_read::refuse_inside_read;
use crate::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Outputs, Target};
use std::ffi::c_void;
use std::sync::Arc;
use std::time::Duration;

/// One view that is rendered in the background, with its buffers.
pub struct oc_frame {
    _private: [u8; 0],
}

handle!(oc_frame, FrameObject, 5);

pub(crate) struct FrameObject {
    pub(crate) frame: Frame,
}

/// Options of a frame. `width` and `height` must be set.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_frame_desc {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Width in pixels, 1 to 65536.
    pub width: u32,
    /// Height in pixels, 1 to 65536. A frame has at most 2^30 pixels.
    pub height: u32,
    /// Buffers to keep for oc_frame_map: bits `1 << OC_BUFFER_...`, combined with `|`. 0: OC_BUFFER_COLOUR_SRGB8, or
    /// none if there are targets.
    pub buffers: u32,
    /// The caller's memory for some buffers, at most one target for each buffer. Independent of `buffers`. Tightly
    /// packed. NULL if `target_count` is 0.
    pub targets: *const oc_target,
    /// Number of targets.
    pub target_count: u64,
}

// SAFETY: `repr(C)`, integers and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_frame_desc {
    const NAME: &'static str = "oc_frame_desc";
}

/// Reads the options of a frame.
///
/// # Safety
/// `desc` is NULL or initialised, and so are its targets.
unsafe fn options(desc: *const oc_frame_desc) -> Checked<FrameOptions> {
    let default = FrameOptions::default();
    if desc.is_null() {
        return Ok(default);
    }
    // SAFETY: the caller's contract.
    let desc = unsafe { read(desc)? };
    let (width, height) = (desc.width, desc.height);
    if width == 0 || height == 0 {
        return bad(format!(
            "oc_frame_desc has a size of {width} x {height}; width and height must be from 1 to 65536"
        ));
    }
    if desc.buffers & !Outputs::ALL.0 != 0 {
        return bad(format!("oc_frame_desc.buffers {:#x}: unknown buffers", desc.buffers));
    }
    if desc.target_count > Buffer::ALL.len() as u64 {
        return bad(format!(
            "oc_frame_desc.target_count is {}; at most one target for each buffer is allowed",
            desc.target_count
        ));
    }
    let outputs = if desc.buffers == 0 && desc.target_count == 0 { default.outputs } else { Outputs(desc.buffers) };
    let given = Strided::new(desc.targets, desc.target_count, 0, "oc_frame_desc.targets")?;
    let mut targets: Vec<(Buffer, Arc<dyn Target>)> = Vec::new();
    for i in 0..given.count {
        // SAFETY: the index is within the array.
        let target = unsafe { given.get(i) };
        let buffer = buffer(target.buffer)?;
        if targets.iter().any(|(b, _)| *b == buffer) {
            return bad(format!("two targets for buffer {}", target.buffer));
        }
        targets.push((buffer, Arc::new(HostTarget::new(&target, buffer, width, height)?)));
    }
    Ok(FrameOptions { width, height, outputs, targets })
}

/// Creates a frame.
///
/// - `desc`: options. NULL: 1024 by 768 pixels of OC_BUFFER_COLOUR_SRGB8.
/// - `out_frame`: receives the frame.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a size, a buffer or a target is out of range.
/// - OC_STATUS_OUT_OF_MEMORY: the system refuses memory for the buffers. Most systems grant more memory than they have:
///   a picture larger than the machine's memory may end the process later, when it is written.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `context` is a live handle; `desc` is initialised or NULL; `out_frame` is writable.
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

/// Options of a request. All zeros: exact, one ray for each pixel.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_frame_settings {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Rays for the colour of a pixel, at most 1024. 0: 1. The other buffers take the ray through the pixel's centre.
    pub samples: u32,
    /// Pixels of error, finite and 0 or more. A stand-in may replace triangles if its projection covers at most `poe`
    /// square pixels. 0 means exact.
    pub poe: f32,
    /// Intensity of the ambient light, which reaches all surfaces; finite. 0: 0.15. Below 0: none.
    pub ambient: f32,
    /// OC_FRAME_ flags, combined with `|`.
    pub flags: oc_frame_flags,
    /// Factor to the light of surfaces in OC_BUFFER_COLOUR_SRGB8, finite and 0 or more. 0: 1. Backgrounds keep their
    /// colours, and so does OC_BUFFER_COLOUR_LINEAR.
    pub exposure: f32,
}

/// Flags of oc_frame_settings.
pub type oc_frame_flags = u32;
/// If the data of the picture does not fit the memory budget at once, the request ends with the picture that does, as
/// OC_STATE_COMPLETE_WITHIN_BUDGET. That picture has one threshold, `effective_poe`, and may be coarser in places than
/// those before. The threshold may depend on earlier views. Without this flag the request goes on until the picture is
/// as requested, whatever was seen before.
pub const OC_FRAME_AT_ONCE: oc_frame_flags = 1;
/// Each value in OC_BUFFER_COLOUR_SRGB8 is the level nearest to that in OC_BUFFER_COLOUR_LINEAR times `exposure`.
/// Without this flag:
/// - Linear values of surfaces above 0.8 are compressed so that they stay below white, and bright parts keep their
///   shading. Values up to 0.8 and backgrounds stay as they are.
/// - Gradients are dithered, so that they have no bands: a value between two levels becomes one or the other, by an
///   ordered pattern that depends only on the place of the pixel. A colour that is a level stays that level everywhere.
pub const OC_FRAME_EXACT_COLOURS: oc_frame_flags = 2;

// SAFETY: `repr(C)`, integers and floats without padding, `struct_size` first.
unsafe impl Sized32 for oc_frame_settings {
    const NAME: &'static str = "oc_frame_settings";
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_frame_settings, flags);
}

impl oc_frame_settings {
    fn to_rust(self) -> Checked<FrameSettings> {
        let default = FrameSettings::default();
        if self.flags & !(OC_FRAME_AT_ONCE | OC_FRAME_EXACT_COLOURS) != 0 {
            return bad(format!("oc_frame_settings.flags {:#x}: unknown flags", self.flags));
        }
        Ok(FrameSettings {
            poe: self.poe,
            samples: if self.samples == 0 { default.samples } else { self.samples },
            ambient: if self.ambient == 0.0 { default.ambient } else { self.ambient },
            at_once: self.flags & OC_FRAME_AT_ONCE != 0,
            exposure: if self.exposure == 0.0 { default.exposure } else { self.exposure },
            exact_colours: self.flags & OC_FRAME_EXACT_COLOURS != 0,
        })
    }
}

/// Begins to render a picture of the committed scene in the background. The previous request of this frame is cancelled
/// and replaced.
///
/// - `scene`: a scene of the same context. Its committed state is rendered.
/// - `camera`: initialised with OC_INIT.
/// - `settings`: options. NULL: all defaults.
///
/// Course of a request:
/// - The first picture is complete, and is made from the data in memory: stand-ins replace missing data. It can be
///   mapped as soon as it is ready, long before the request ends.
/// - Each later picture is more exact: a pixel gives way only to one of smaller error.
/// - If the required data does not fit the memory budget, the threshold first rises step by step until all data of the
///   picture fits. Then the picture is completed pane by pane, with the requested threshold: the data of one pane at a
///   time is in memory. This takes longer, because data is read several times; oc_frame_cancel ends it, and leaves the
///   best picture. If several frames of a context need panes, they take turns. With OC_FRAME_AT_ONCE the request ends
///   before the panes.
/// - The request ends as OC_STATE_DONE when the picture is as exact as requested.
/// - The request ends as OC_STATE_COMPLETE_WITHIN_BUDGET before the panes with OC_FRAME_AT_ONCE, or when the budget
///   does not even hold the data of one pixel, or some data cannot be read. In the last case `error` of oc_progress is
///   OC_STATUS_IO (unreadable) or OC_STATUS_CORRUPT (damaged); the next request tries to read it again.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a setting or the camera is out of range.
/// - OC_STATUS_OUT_OF_MEMORY: the system refuses memory for a picture in addition to the one that can be mapped.
///   The previous request then continues.
///
/// Thread safety: any thread. Cheap. Exception: a frame with targets waits until earlier requests no longer write to
/// them, i.e. for their tiles in flight.
/// # Safety
/// `frame` and `scene` are live handles; `camera` is initialised; `settings` is initialised or NULL.
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
        let settings = read_or_default(settings)?.to_rust()?;
        let scene: &Shell<SceneObject> = handles::borrow(scene)?;
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| {
            Ok(frame.frame.request(&scene.scene.state(), &camera, &settings)?)
        })
    })
}

fn state_of(status: &FrameStatus) -> oc_state {
    snapshot(status).state
}

fn snapshot(status: &FrameStatus) -> Snapshot {
    let base = match (status.state, &status.error) {
        (FrameState::Idle, _) => Snapshot { state: OC_STATE_IDLE, ..Snapshot::running() },
        (FrameState::Running, _) => Snapshot::running(),
        (FrameState::Converged, _) => Snapshot::done(),
        (FrameState::CompleteWithinBudget, None) => Snapshot::within_budget(),
        // The error is the reason why some data could not be read.
        (FrameState::CompleteWithinBudget, Some(error)) => {
            Snapshot { state: OC_STATE_COMPLETE_WITHIN_BUDGET, ..Snapshot::ended_with(error) }
        }
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

/// Reports the status. A frame whose worker has panicked is poisoned.
fn report(frame: &Shell<FrameObject>, status: &FrameStatus, fill: Option<Fill<oc_progress>>) {
    let snapshot = snapshot(status);
    if snapshot.status == OC_STATUS_INTERNAL {
        frame.poison();
    }
    if let Some(fill) = fill {
        snapshot.report(fill);
    }
}

/// Returns the progress of the last request.
///
/// - `out_progress`: receives the progress. Initialise it with OC_INIT.
///
/// If the request has failed or was cancelled, oc_last_error of this thread returns the reason.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `frame` is a live handle; `out_progress` is initialised.
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

/// Waits until the last request has ended, and until the wake function has returned if another thread is calling it.
///
/// - `timeout_ms`: longest time to wait, in milliseconds. OC_FOREVER: no limit. A timeout is not a failure: the state
///   is then OC_STATE_RUNNING.
/// - `out_progress`: receives the progress as oc_frame_poll does. May be NULL.
///
/// Thread safety: any thread. Blocks. In a context without threads this call does the work.
/// # Safety
/// `frame` is a live handle; `out_progress` is initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_wait(
    frame: *const oc_frame,
    timeout_ms: u32,
    out_progress: *mut oc_progress,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = if out_progress.is_null() { None } else { Some(Fill::new(out_progress)?) };
        refuse_inside_read()?;
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| {
            let status = frame.frame.wait(timeout(timeout_ms).unwrap_or(Duration::MAX));
            report(frame, &status, fill);
            Ok(())
        })
    })
}

/// Cancels the last request. Rendering stops within a tile. The last complete picture stays unchanged.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `frame` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_cancel(frame: *mut oc_frame) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| {
            frame.frame.cancel();
            Ok(())
        })
    })
}

/// Changes the size of the pictures of later requests. The running request is cancelled, and the targets are removed
/// from the frame. The last complete picture keeps its size until the next one is complete.
///
/// - `width`, `height`: size in pixels, 1 to 65536.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: the size is out of range. Nothing changes.
/// - OC_STATUS_OUT_OF_MEMORY: as for oc_frame_create. Nothing changes.
///
/// Thread safety: any thread. Blocks until no thread writes to the targets any more.
/// # Safety
/// `frame` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_resize(frame: *mut oc_frame, width: u32, height: u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| Ok(frame.frame.resize(width, height)?))
    })
}

/// Registers a function that is called each time a better picture can be mapped, and each time a request ends.
///
/// - `wake`: the function. It replaces an earlier one. NULL: none.
/// - `user`: passed to `wake`. It must stay valid until the frame is released, or until `wake` is replaced and a call
///   in progress has returned (oc_frame_wait waits for it).
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `frame` is a live handle; `wake` is NULL or may be called from any thread with `user`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_set_wake(frame: *mut oc_frame, wake: oc_wake_fn, user: *mut c_void) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| {
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

/// Accuracy of the picture of the last request.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_frame_accuracy {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// The greatest threshold of a pixel, in pixels of error: `poe` of the request, or more as long as the picture has
    /// pixels with a raised threshold, because its data does not fit the memory budget at once. In pictures with a
    /// raised threshold stand-ins transmit no rays.
    pub effective_poe: f32,
    /// Number of the request in this frame, from 1. 0: nothing was requested yet.
    pub request: u64,
    /// Pixels with an exact answer: triangles or background, without a stand-in in front.
    pub pixels_exact: u64,
    /// Pixels that show a stand-in as fine as `effective_poe` requires, or a surface through such a stand-in.
    pub pixels_lod: u64,
    /// Pixels that show a stand-in for missing data.
    pub pixels_missing: u64,
    /// Pixels of the picture in total.
    pub pixels_total: u64,
    /// Bytes in memory of the models in the scene.
    pub bytes_resident: u64,
    /// Bytes that the picture, or the present pane of it, needs and that are not in memory; 0 at the end of a picture
    /// that was completed pane by pane. After OC_STATE_COMPLETE_WITHIN_BUDGET without panes: the data that could not be
    /// read or did not fit; 0 if all data for `effective_poe` is in memory.
    pub bytes_wanted: u64,
    /// Seconds from the request until now, or until its end.
    pub seconds: f64,
    /// Estimated remaining seconds at the present speed. Before the first picture: until that is ready. Later: until
    /// the missing data known now has arrived; data that better pictures will need is unknown. 0: nothing runs.
    /// Infinity: unknown.
    pub seconds_to_go: f64,
    /// Largest error in pixels. The rounding error of triangles counts only if the frame has OC_BUFFER_DEPTH or
    /// OC_BUFFER_ERROR.
    pub worst_error: f32,
    /// Mean error in pixels, over the pixels that show a surface. Rounding errors as for `worst_error`.
    pub mean_error: f32,
    /// Number of complete pictures that the request has made so far. At 1 or more, one can be mapped. The first is made
    /// from the data in memory, each later one from more data. The very first picture of a frame waits up to 80 ms for
    /// missing data.
    pub pictures: u32,
    /// State of the request: one of the OC_STATE_ constants.
    pub state: oc_state,
}

// SAFETY: `repr(C)`, numbers without padding, `struct_size` first.
unsafe impl Sized32 for oc_frame_accuracy {
    const NAME: &'static str = "oc_frame_accuracy";
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_frame_accuracy, pictures);
}

/// Returns the accuracy of the last complete picture of the last request. Before that is ready: of the pixels rendered
/// so far. The error of a pixel that shows a stand-in is the distance, in pixels, within which the original surface
/// lies.
///
/// - `out_accuracy`: receives the accuracy. Initialise it with OC_INIT.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `frame` is a live handle; `out_accuracy` is initialised.
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
                pictures: status.pictures,
                state: state_of(&status),
            });
            Ok(())
        })
    })
}

/// Returns the exact hit at a pixel of the last complete picture; before there is one, of the last request. All members
/// are set. Surfaces of any opacity are hit, also of opacity 0; OC_LOOK_HIDDEN takes parts out of all hits. As in the
/// picture, a surface that the eye is on is not hit.
///
/// - `x`, `y`: the pixel, counted from the top left corner.
/// - `out_hit`: receives the hit.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: the pixel is outside of the picture.
/// - OC_STATUS_INVALID_STATE: nothing was requested yet.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `frame` is a live handle; `out_hit` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_pick(frame: *const oc_frame, x: u32, y: u32, out_hit: *mut oc_hit) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_hit, "out_hit")?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            super::query::write_hit(out, &frame.frame.pick(x, y)?);
            Ok(())
        })
    })
}

/// Returns a hit near a pixel, with a preference for thin parts, such as wires of less than a pixel.
///
/// Rays go through the centre and six other points of each pixel within `radius` pixels of the pixel's centre. A part
/// is thin if it covers less than a fifth of the picture within `radius` pixels of its nearest point. The result is:
/// - the nearest hit of a thin part, and at equal distances that of the smaller depth; or else
/// - the hit at the pixel itself, as of oc_frame_pick; or, if that is a miss,
/// - the nearest hit, or a miss if there is none.
///
/// - `x`, `y`: the pixel, counted from the top left corner.
/// - `radius`: distance in pixels, 0 to 32. 0: the call is oc_frame_pick. Usual: 3 to 5.
/// - `out_hit`: receives the hit. It is exact, with all members, as of oc_frame_pick.
///
/// Errors: as oc_frame_pick. OC_STATUS_INVALID_ARGUMENT also if the radius is out of range.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `frame` is a live handle; `out_hit` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_pick_near(
    frame: *const oc_frame,
    x: u32,
    y: u32,
    radius: f64,
    out_hit: *mut oc_hit,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_hit, "out_hit")?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            super::query::write_hit(out, &frame.frame.pick_near(x, y, radius)?);
            Ok(())
        })
    })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `frame` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_retain(frame: *mut oc_frame) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(frame) }
}

/// Releases one reference. The last release cancels the frame. NULL: does nothing.
///
/// Thread safety: any thread. The last release blocks until the tiles in flight are done, and until the wake function
/// has returned if another thread is calling it.
/// # Safety
/// `frame` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_release(frame: *mut oc_frame) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(frame) }
}
