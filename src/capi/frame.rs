//! Frames: one view being rendered, with its buffers.

use super::context::{ContextObject, oc_context};
use super::guard::{Checked, Fill, Sized32, Strided, bad, boundary, out, read, read_or_default};
use super::handles::{self, Shell, handle};
use super::job::*;
use super::pixels::{HostTarget, buffer, oc_target};
use super::query::oc_hit;
use super::scene::{SceneObject, oc_scene};
use super::status::{OC_STATUS_INTERNAL, oc_status};
use super::view::oc_camera;
use crate::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Outputs, Target};
use std::ffi::c_void;
use std::sync::Arc;
use std::time::Duration;

/// One view being rendered in the background, with its buffers.
pub struct oc_frame {
    _private: [u8; 0],
}

handle!(oc_frame, FrameObject, 5);

pub(crate) struct FrameObject {
    pub(crate) frame: Frame,
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

/// Makes a frame. `desc` may be NULL: all defaults. OC_STATUS_OUT_OF_MEMORY if the system gives none for its buffers.
/// (Most systems promise more memory than they have, and find out when it is written: a picture larger than the
/// machine's memory may end the process later.)
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
    /// Pixels of error: the area, in pixels, that a stand-in may cover; finite, not below 0. 0: exact.
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
            ambient: if self.ambient == 0.0 { default.ambient } else { self.ambient },
        }
    }
}

/// Begins a picture of the committed scene, and returns at once. What the frame was rendering is
/// cancelled and replaced. `settings` may be NULL: all defaults.
///
/// The first picture is whole, and made from what is in memory: where data is missing it shows stand-ins. It can be
/// mapped as soon as it is there, long before the request ends. Each later picture is more exact, unless what is asked
/// for does not fit the memory budget: then pictures get coarser step by step, everywhere alike, until all that they
/// need does. The request ends as OC_STATE_DONE when the picture is as exact as asked, as
/// OC_STATE_COMPLETE_WITHIN_BUDGET when that does not fit, or some of it cannot be had (then oc_progress.error is
/// OC_STATUS_IO for what cannot be read, OC_STATUS_CORRUPT for what is damaged; the next request asks for it again).
///
/// OC_STATUS_INVALID_ARGUMENT for a `poe` or `ambient` that is not a number or infinite, a `poe` below 0, more than
/// 1024 samples, or a camera out of its ranges; OC_STATUS_OUT_OF_MEMORY if the system gives none for a picture beside
/// the one that can be mapped; then what the frame was rendering goes on. Thread safety: any thread. Cheap.
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
        // What could not be read.
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

/// Waits until the last request has ended and the wake function, if another thread is calling it, has returned;
/// `timeout_ms` at most (OC_FOREVER: no limit). Says how far the request is. A timeout is no failure: the state is then
/// OC_STATE_RUNNING. `out_progress` may be NULL.
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
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| {
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
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| {
            frame.frame.cancel();
            Ok(())
        })
    })
}

/// Changes the size from the next request on; cancels what is rendering and lets go of the targets. The last complete
/// picture keeps its size until the next is complete. OC_STATUS_OUT_OF_MEMORY as for oc_frame_create; then nothing
/// changes.
///
/// Thread safety: any thread. Blocks until nobody writes to the targets any more.
/// # Safety
/// Live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_resize(frame: *mut oc_frame, width: u32, height: u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(frame, |frame: &Shell<FrameObject>| Ok(frame.frame.resize(width, height)?))
    })
}

/// Has `wake` called whenever a better picture can be mapped, and when a request ends; NULL: no call.
///
/// `user` must stay usable until `wake` was replaced or the frame released.
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `wake` is NULL or may be called from any thread with `user`.
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

/// How true the picture is that the last request is making or has made.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_frame_accuracy {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// The pixels of error in force: those asked for, or more where what is seen does not fit the memory budget. (By
    /// steps; which one it ends at may depend on what was seen before.) Where that is more than was asked for, no
    /// stand-in lets rays through.
    pub effective_poe: f32,
    /// Counts the requests of this frame, from 1; 0: none yet.
    pub request: u64,
    /// Pixels whose answer is exact: triangles and background that no stand-in is before.
    pub pixels_exact: u64,
    /// Pixels that show a stand-in as fine as `effective_poe` asks for, or through one what is behind it.
    pub pixels_lod: u64,
    /// Pixels that show a stand-in for missing data.
    pub pixels_missing: u64,
    /// Pixels of the picture.
    pub pixels_total: u64,
    /// Bytes in memory of the models that the scene shows.
    pub bytes_resident: u64,
    /// Bytes that this picture lacks: wanted, and not in memory. Of a request that is complete within the budget: what
    /// could not be read, or still did not fit; 0 where all that is needed at `effective_poe` is there.
    pub bytes_wanted: u64,
    /// Seconds since the request, until it ended.
    pub seconds: f64,
    /// Estimated seconds to go, as fast as it has been so far: of the first picture, then until what is wanted now has
    /// come; what better pictures will want besides is not known. 0 when nothing runs, infinity if unknown.
    pub seconds_to_go: f64,
    /// Largest error in pixels. That of triangles, what rounding does, counts only where OC_BUFFER_DEPTH or
    /// OC_BUFFER_ERROR is asked for.
    pub worst_error: f32,
    /// Mean error in pixels, over pixels that show something; of triangles as above.
    pub mean_error: f32,
    /// Whole pictures that the request has made so far: the first from what was in memory, each with more of what the
    /// last lacked. The very first of a frame waits for that, 80 ms at most. From 1 on there is one to map.
    pub pictures: u32,
    /// An OC_STATE_ number, as oc_frame_poll tells it.
    pub state: oc_state,
}

// SAFETY: `repr(C)`, numbers without padding, `struct_size` first.
unsafe impl Sized32 for oc_frame_accuracy {
    const NAME: &'static str = "oc_frame_accuracy";
    // `pictures` and `state` came later.
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_frame_accuracy, pictures);
}

/// How true the last whole picture of the last request is (before there is one: as far as it has come). Of each pixel a
/// stand-in's error is how far from what is shown the surface may lie, in pixels.
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
                pictures: status.pictures,
                state: state_of(&status),
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
            super::query::write_hit(out, &frame.frame.pick(x, y)?);
            Ok(())
        })
    })
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
