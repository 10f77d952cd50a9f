//! A frame: one view being rendered, with its buffers.

use super::film::{Buffer, Mapped, Outputs, Target, no_picture};
use super::status::FrameStatus;
use crate::base::error::{Error, Result};
use crate::query::Hit;
use crate::scene::{Camera, Context, SceneState};
use std::sync::Arc;
use std::time::Duration;

/// What a frame is made with.
#[derive(Clone)]
pub struct FrameOptions {
    /// Pixels in a row, 1 to 65536.
    pub width: u32,
    /// Rows, 1 to 65536.
    pub height: u32,
    /// Buffers to keep; they can be mapped when a picture is complete.
    pub outputs: Outputs,
    /// The caller's memory for some buffers (they need not be in `outputs`). A resize drops the targets.
    pub targets: Vec<(Buffer, Arc<dyn Target>)>,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { width: 1024, height: 768, outputs: Outputs::COLOUR, targets: Vec::new() }
    }
}

/// What a request asks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameSettings {
    /// Pixels of error: the area in pixels that a stand-in may cover; 0: exact.
    pub poe: f32,
    /// Rays for a pixel's colour, 1 to 1024; the other buffers take the ray of the pixel's middle.
    pub samples: u32,
    /// Light from everywhere, so that nothing is black; 0 or more.
    pub ambient: f32,
}

impl Default for FrameSettings {
    fn default() -> Self {
        Self { poe: 0.0, samples: 1, ambient: 0.15 }
    }
}

/// One view being rendered. Thread-safe; all calls are cheap but [`Frame::wait`] and [`Frame::pick`].
///
/// Dropping it cancels what runs and waits for the tiles in flight.
pub struct Frame {
    context: Context,
}

impl Frame {
    /// A frame with buffers. `BadArgument` if the size is out of range.
    pub fn new(context: &Context, options: FrameOptions) -> Result<Self> {
        let _ = options;
        Ok(Self { context: context.clone() })
    }

    /// The context.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Begins a picture of `scene` from `camera`; returns at once. What ran before is cancelled.
    ///
    /// Fails with `BadArgument` for a bad camera or settings, or a scene of another context;
    /// then what ran goes on.
    pub fn request(&self, scene: &Arc<SceneState>, camera: &Camera, settings: &FrameSettings) -> Result<()> {
        let _ = (scene, camera, settings);
        Err(Error::BadState("Frame::request: being built".into()))
    }

    /// How far the last request is. Never blocks.
    pub fn poll(&self) -> FrameStatus {
        FrameStatus::default()
    }

    /// Waits until the last request has ended, `timeout` at most. Works itself where the context has no threads.
    pub fn wait(&self, timeout: Duration) -> FrameStatus {
        let _ = timeout;
        self.poll()
    }

    /// Cancels what runs; takes effect within a tile. The last complete picture stays mapped and whole.
    pub fn cancel(&self) {}

    /// Changes the size for requests from now on; cancels what runs. The last complete picture keeps its
    /// size until the next is complete. Targets are dropped. `BadArgument` if out of range.
    pub fn resize(&self, width: u32, height: u32) -> Result<()> {
        let _ = (width, height);
        Err(Error::BadState("Frame::resize: being built".into()))
    }

    /// What is seen at pixel (`x`, `y`) of the last complete picture (or, before there is one, of the last
    /// request): exact, every field filled. Blocks; may read the disk. `BadArgument` outside the picture,
    /// `BadState` before the first request.
    pub fn pick(&self, x: u32, y: u32) -> Result<Hit> {
        let _ = (x, y);
        Err(Error::BadState("Frame::pick: being built".into()))
    }

    /// A buffer of the last complete picture; cheap, no copy. `BadState` before there is one or if
    /// the frame does not keep this buffer.
    pub fn map(&self, buffer: Buffer) -> Result<Mapped> {
        let _ = buffer;
        Err(no_picture())
    }

    /// Calls `wake` when a request ends (converged, cancelled or failed), from any thread, never under a
    /// lock of ours. It must not block; it may call the frame's cheap methods. `None`: nobody is called.
    pub fn set_wake(&self, wake: Option<Arc<dyn Fn() + Send + Sync>>) {
        let _ = wake;
    }
}
