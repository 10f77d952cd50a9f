//! How far a frame is.

use super::tile::Tally;
use crate::base::error::Error;
use std::sync::Arc;

/// State of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum FrameState {
    /// Nothing was requested yet.
    #[default]
    Idle = 0,
    /// Rendering, or waiting for data to render more exactly.
    Running = 1,
    /// The last request is complete, as exact as asked.
    Converged = 2,
    /// The last request was cancelled; the picture before it is still whole.
    Cancelled = 3,
    /// The last request failed; `error` says why. The picture before it is still whole.
    Failed = 4,
    /// The last request is complete, coarser than asked: all that fits the memory budget, or can be read, is shown.
    CompleteWithinBudget = 5,
}

/// How far a request is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Progress {
    pub fraction: f64,
    pub tally: Tally,
    /// Bytes of blocks that are wanted and not in memory.
    pub wanted: u64,
    pub effective_poe: f32,
    /// Whole pictures so far.
    pub pictures: u32,
    pub seconds_to_go: f64,
}

/// Status of the last request of a frame.
#[derive(Debug, Clone, Default)]
pub struct FrameStatus {
    /// Its state.
    pub state: FrameState,
    /// Counts the requests of this frame, from 1; 0: none yet. Says to which request a status belongs.
    pub request: u64,
    /// Fraction done: 0 at the request, 1 when complete, never going back in between.
    pub fraction: f64,
    /// Whole pictures that the request has made so far: the first from what was in memory, each with more of what the
    /// last lacked. The very first of a frame waits for that, 80 ms at most. From 1 on there is one to be mapped.
    pub pictures: u32,
    /// Pixels whose answer is exact (hits on original triangles and misses, of rays that passed no stand-in before).
    pub pixels_exact: u64,
    /// Pixels that show a stand-in as fine as asked, or what is behind one.
    pub pixels_lod: u64,
    /// Pixels that show a stand-in for missing data.
    pub pixels_missing: u64,
    /// Pixels of the picture.
    pub pixels_total: u64,
    /// Largest error in pixels. That of triangles, what rounding does, counts only where depth or error are asked for.
    pub worst_error_px: f32,
    /// Mean error in pixels, over pixels that hit something; of triangles as above.
    pub mean_error_px: f32,
    /// Pixels of error in force: more than asked where what is seen does not fit the memory budget.
    pub effective_poe: f32,
    /// Bytes of blocks in memory, of the scene's models.
    pub bytes_resident: u64,
    /// Bytes of blocks wanted and not yet in memory.
    pub bytes_wanted: u64,
    /// Estimated seconds to go, as fast as it has been so far: of the first picture, then until what is wanted now has
    /// come. What better pictures will want besides is not known. 0 when not running, infinity when unknown.
    pub seconds_to_go: f64,
    /// Seconds since the request, until it ended.
    pub seconds: f64,
    /// Why it failed; or, of a complete picture, what could not be read and is shown as a stand-in.
    pub error: Option<Arc<Error>>,
}
