//! Progress and status of a frame.

use super::tile::Tally;
use crate::base::error::Error;
use std::sync::Arc;

/// State of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum FrameState {
    /// No request was made yet.
    #[default]
    Idle = 0,
    /// The request is rendering, or waits for blocks that a better picture needs.
    Running = 1,
    /// The last request is complete and as exact as requested.
    Converged = 2,
    /// The last request was cancelled. The previous picture remains complete.
    Cancelled = 3,
    /// The last request failed; `error` gives the reason. The previous picture remains complete.
    Failed = 4,
    /// The last request is complete but coarser than requested: it shows all data that fits the memory budget and can
    /// be read.
    CompleteWithinBudget = 5,
}

/// Progress of a request.
#[derive(Debug, Clone, Copy)]
pub(super) struct Progress {
    pub fraction: f64,
    pub tally: Tally,
    /// Bytes of blocks that are wanted and not in memory.
    pub wanted: u64,
    pub effective_poe: f32,
    /// Number of complete pictures so far.
    pub pictures: u32,
    pub seconds_to_go: f64,
}

/// Status of the last request of a frame.
#[derive(Debug, Clone, Default)]
pub struct FrameStatus {
    /// State of the request.
    pub state: FrameState,
    /// Number of the request within its frame, from 1; 0: none yet. It identifies the request that the status belongs
    /// to.
    pub request: u64,
    /// Fraction done: 0 at the request, 1 when it is complete. It never decreases in between.
    pub fraction: f64,
    /// Number of complete pictures that the request has made so far. The first uses the blocks that are in memory; each
    /// later one adds blocks that the previous one lacked. The very first picture of a frame waits for missing blocks,
    /// 80 ms at most. From 1 on there is a picture to map.
    pub pictures: u32,
    /// Pixels with an exact answer: the ray hit an original triangle or nothing, and no stand-in transmitted it before.
    pub pixels_exact: u64,
    /// Pixels that show a stand-in within the threshold, or the surface or background behind a transmitting stand-in.
    pub pixels_lod: u64,
    /// Pixels that show a stand-in for missing data.
    pub pixels_missing: u64,
    /// Number of pixels in the picture.
    pub pixels_total: u64,
    /// Largest error in pixels. The rounding errors of triangles count only if depth or error buffers are requested.
    pub worst_error_px: f32,
    /// Mean error in pixels, over pixels with a hit. Rounding errors of triangles count as above.
    pub mean_error_px: f32,
    /// Effective threshold in pixels of error: above the requested one if the visible data does not fit the memory
    /// budget.
    pub effective_poe: f32,
    /// Bytes of the scene's blocks in memory.
    pub bytes_resident: u64,
    /// Bytes of blocks that are wanted and not yet in memory.
    pub bytes_wanted: u64,
    /// Estimated seconds to go at the speed so far: to the first picture, then until all blocks wanted now are read.
    /// The estimate excludes blocks that only better pictures will want. 0 when not running, infinity when unknown.
    pub seconds_to_go: f64,
    /// Seconds since the request, or from the request to its end.
    pub seconds: f64,
    /// Reason of a failure; or, for a complete picture, the error of a block that could not be read and is shown as a
    /// stand-in.
    pub error: Option<Arc<Error>>,
}
