//! Plan of a request's passes: the blocks that each tile lacked, and the next step after each pass.

use super::merged::{Effort, Merged};
use super::panes::{Panes, pixels_of, tiles_of};
use super::status::Progress;
use super::tile::{PIXELS, Tally};
use super::wants::Wants;
use crate::residency::ViewState;
use std::ops::Range;
use std::sync::Arc;

/// Conditions at the end of a pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// State of the view's wants.
    pub wants: ViewState,
    /// True if no other view needs room before this one.
    pub is_alone: bool,
    /// Factor for the requested threshold.
    pub pressure: f32,
    /// True if the pressure has changed since the pass began, even if it has changed back. Wants of such a pass no
    /// longer raise the pressure.
    pub is_stale: bool,
}

/// Progress of the current pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Now {
    /// Fraction of the pass that is done.
    pub share: f64,
    /// Bytes of missing blocks.
    pub wanted: u64,
    /// Bytes of blocks that were read since the request.
    pub come: u64,
    /// Seconds since the request.
    pub seconds: f64,
}

/// Next step of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    /// A pass over the planned tiles. `afresh`: over all tiles, with the current pressure.
    Pass { afresh: bool },
    /// A pass over the next pane, with the requested threshold. First the view needs its turn.
    Pane,
    /// No work until blocks arrive.
    Wait,
    /// The request has ended.
    End { is_converged: bool },
}

/// First raised threshold, in pixels of error, if exact answers are requested and do not fit the budget.
const LEAST_POE: f32 = 0.5;

/// Returns the effective threshold in pixels of error.
pub(super) fn effective_poe(asked: f32, pressure: f32) -> f32 {
    if pressure > 1.0 { asked.max(LEAST_POE) * pressure } else { asked }
}

/// A tile, and the blocks that its last rendering lacked.
#[derive(Clone, Default)]
struct Tile {
    merged: Merged,
    wants: Wants,
    /// The greatest effort of a rendering that lacked no block.
    complete: Option<Effort>,
}

/// The passes of a request.
pub(super) struct Passes {
    tiles: Vec<Tile>,
    /// Indices of the tiles in the current pass.
    todo: Arc<Vec<usize>>,
    /// True if the current pass is a probe: it traces a few pixels to learn which blocks are missing.
    pub is_probe: bool,
    /// Samples per pixel in the current pass.
    pub samples: u32,
    asked_samples: u32,
    /// See [`super::FrameSettings::at_once`].
    at_once: bool,
    pub pressure: f32,
    /// Pressure before the panes.
    raised: f32,
    /// Set once the picture is completed pane by pane, and the current pane.
    panes: Option<Panes>,
    pane: Option<Range<usize>>,
    /// True if the residency has reported news since the last decision.
    pub has_news: bool,
    /// Number of pictures that were shown.
    ended: u32,
    /// Greatest number of bytes wanted at one time so far.
    most_wanted: u64,
    /// Tally of the last picture that was shown.
    shown: Tally,
    fraction: f64,
}

/// Ratio between the samples of one pass and those of the pass before.
const MORE_SAMPLES: u32 = 4;

impl Passes {
    /// Creates the passes over `tiles` tiles, up to `samples` samples per pixel.
    pub fn new(tiles: usize, samples: u32, at_once: bool) -> Self {
        Self {
            tiles: vec![Tile::default(); tiles],
            todo: Arc::default(),
            is_probe: false,
            samples: 1,
            asked_samples: samples,
            at_once,
            pressure: 1.0,
            raised: 1.0,
            panes: None,
            pane: None,
            has_news: false,
            ended: 0,
            most_wanted: 0,
            shown: Tally::default(),
            fraction: 0.0,
        }
    }

    /// Plans a probe of all tiles.
    pub fn begin_probe(&mut self) {
        self.begin_all();
        self.is_probe = true;
    }

    /// Plans a pass over all tiles.
    pub fn begin_all(&mut self) {
        self.is_probe = false;
        self.todo = Arc::new((0..self.tiles.len()).collect());
        self.has_news = false;
    }

    fn begin_lacking(&mut self) {
        self.todo = Arc::new((0..self.tiles.len()).filter(|&i| !self.tiles[i].wants.is_empty()).collect());
        self.has_news = false;
    }

    /// True if the picture is completed pane by pane.
    pub fn has_panes(&self) -> bool {
        self.panes.is_some()
    }

    /// Begins with the panes: those of all tiles that lack blocks or were not rendered as requested.
    fn begin_panes(&mut self, asked_poe: f32) -> Next {
        if self.at_once {
            return Next::End { is_converged: false };
        }
        self.raised = std::mem::replace(&mut self.pressure, 1.0);
        self.samples = self.asked_samples;
        let asked = self.effort(asked_poe);
        let todo: Vec<usize> = (0..self.tiles.len())
            .filter(|&i| !self.tiles[i].complete.is_some_and(|effort| effort.is_as_great_as(asked)))
            .collect();
        // They are wanted again in their panes.
        self.tiles.iter_mut().for_each(|tile| tile.wants.clear());
        if todo.is_empty() {
            return Next::End { is_converged: true };
        }
        self.panes = Some(Panes::of(&todo));
        Next::Pane
    }

    /// Plans a pass over the next pane.
    pub fn begin_pane(&mut self) {
        self.pane = self.panes.as_mut().and_then(Panes::next);
        self.todo = Arc::new(self.pane.as_ref().map_or(0..0, tiles_of).collect());
        self.has_news = false;
    }

    /// The pixels of a tile that the current pass renders, packet by packet.
    pub fn pixels(&self, tile: usize) -> Range<usize> {
        self.pane.as_ref().map_or(0..PIXELS, |pane| pixels_of(pane, tile))
    }

    /// The effort of the current pass.
    pub fn effort(&self, asked_poe: f32) -> Effort {
        Effort { poe: effective_poe(asked_poe, self.pressure), samples: self.samples }
    }

    /// Number of tiles in the planned pass.
    pub fn items(&self) -> usize {
        self.todo.len()
    }

    /// Index of the tile that is item `item` of the pass.
    pub fn tile(&self, item: usize) -> usize {
        self.todo[item]
    }

    /// Takes a tile to add pixels to it; [`Passes::done`] puts it back.
    pub fn take(&mut self, tile: usize) -> Merged {
        std::mem::take(&mut self.tiles[tile].merged)
    }

    /// Stores a rendered tile.
    pub fn done(&mut self, tile: usize, merged: Merged, effort: Effort, wants: &Wants) {
        let is_whole = !self.is_probe && self.pixels(tile).len() == PIXELS;
        let before = self.tiles[tile].complete;
        let is_better = is_whole && wants.is_empty() && before.is_none_or(|before| effort.is_as_great_as(before));
        let complete = if is_better { Some(effort) } else { before };
        self.tiles[tile] = Tile { merged, wants: wants.clone(), complete };
    }

    /// Notes that all tiles of a pass were rendered and the picture can be mapped.
    pub fn is_shown(&mut self) {
        self.ended += 1;
        self.shown = self.tally();
    }

    fn tally(&self) -> Tally {
        let mut sum = Tally::default();
        self.tiles.iter().for_each(|tile| sum.add(&tile.merged.tally));
        sum
    }

    /// Returns the missing blocks of all tiles.
    pub fn wants(&self) -> Wants {
        let mut all = Wants::default();
        self.tiles.iter().for_each(|tile| all.append(&tile.wants));
        all.add_up();
        all
    }

    /// True if the pass that has ended was certainly the last one: no tile lacks a block, pixels have all samples, and
    /// there are no panes. Under pressure another pass may follow.
    pub fn is_last(&self) -> bool {
        let is_complete = self.samples == self.asked_samples && self.tiles.iter().all(|tile| tile.wants.is_empty());
        is_complete && self.pressure == 1.0 && self.panes.is_none()
    }

    /// Returns the step after a pass or after news, and plans the pass if the step is one.
    pub fn next(&mut self, seen: Seen, asked_poe: f32) -> Next {
        if self.panes.is_some() {
            return self.next_of_pane(seen);
        }
        if seen.is_stale || seen.pressure != self.pressure {
            // All tiles become coarser or finer together.
            self.samples = 1;
            self.begin_all();
            return Next::Pass { afresh: true };
        }
        if self.tiles.iter().any(|tile| !tile.wants.is_empty()) {
            return match seen.wants {
                ViewState::Busy if !self.has_news => Next::Wait,
                ViewState::Satisfied | ViewState::Busy => {
                    self.begin_lacking();
                    Next::Pass { afresh: false }
                }
                ViewState::Full => self.begin_panes(asked_poe),
                ViewState::Failed if self.pressure > 1.0 => self.begin_panes(asked_poe),
                ViewState::Failed => Next::End { is_converged: false },
            };
        }
        if self.samples < self.asked_samples {
            self.samples = (self.samples * MORE_SAMPLES).min(self.asked_samples);
            self.begin_all();
            return Next::Pass { afresh: false };
        }
        if effective_poe(asked_poe, self.pressure) != asked_poe {
            return self.begin_panes(asked_poe);
        }
        Next::End { is_converged: true }
    }

    /// [`Passes::next`] while the picture is completed pane by pane.
    fn next_of_pane(&mut self, seen: Seen) -> Next {
        let Some(panes) = &mut self.panes else { return Next::Pane };
        // The view waits for its turn.
        if self.pane.is_none() {
            return Next::Pane;
        }
        if self.tiles.iter().any(|tile| !tile.wants.is_empty()) {
            match seen.wants {
                ViewState::Busy if !self.has_news => return Next::Wait,
                ViewState::Satisfied | ViewState::Busy => {
                    self.begin_lacking();
                    return Next::Pass { afresh: false };
                }
                // A single pixel waits until no other view needs room.
                ViewState::Full if !panes.halve_next() => {
                    if seen.is_alone {
                        panes.give_up();
                    } else if self.has_news {
                        self.begin_lacking();
                        return Next::Pass { afresh: false };
                    } else {
                        return Next::Wait;
                    }
                }
                ViewState::Full => {}
                ViewState::Failed => panes.give_up(),
            }
        } else {
            panes.is_complete();
        }
        self.pane = None;
        self.tiles.iter_mut().for_each(|tile| tile.wants.clear());
        if panes.next().is_none() {
            return Next::End { is_converged: !panes.gave_up };
        }
        Next::Pane
    }

    /// The greatest effective threshold of a tile.
    fn coarsest(&self, asked_poe: f32) -> f32 {
        let at_least = effective_poe(asked_poe, self.pressure.max(self.raised));
        let is_complete = self.panes.as_ref().is_some_and(|panes| panes.fraction() == 1.0 && !panes.gave_up);
        let of_tile = |tile: &Tile| tile.complete.map_or(at_least, |effort| effort.poe);
        if is_complete { asked_poe } else { self.tiles.iter().fold(asked_poe, |most, tile| most.max(of_tile(tile))) }
    }

    /// Returns the progress. `asked_poe`: the requested threshold in pixels of error.
    pub fn progress(&mut self, now: Now, asked_poe: f32) -> Progress {
        let Now { share, wanted, come: bytes_come, seconds } = now;
        self.most_wanted = self.most_wanted.max(wanted);
        let come = (self.most_wanted - wanted) as f64 / self.most_wanted.max(1) as f64;
        // The first picture has the greatest weight, then blocks, then samples.
        let first = if self.asked_samples > 1 { 0.5 } else { 0.9 };
        let now = match (self.ended, self.samples) {
            _ if self.panes.is_some() => 0.6 + 0.39 * self.panes.as_ref().map_or(0.0, Panes::fraction),
            (0, _) => first * share,
            (_, 1) => first + 0.09 * come,
            _ => 0.6 + 0.39 * f64::from(self.samples) / f64::from(self.asked_samples) * share,
        };
        self.fraction = self.fraction.max(now.clamp(0.0, 0.999));
        let tally = if self.ended == 0 { self.tally() } else { self.shown };
        let as_fast = |left: f64, done: f64| if done > 0.0 { seconds * left / done } else { f64::INFINITY };
        let seconds_to_go = match self.ended {
            0 => as_fast(1.0 - share, share),
            _ if wanted > 0 && self.panes.is_none() => as_fast(wanted as f64, bytes_come as f64),
            _ => as_fast(1.0 - self.fraction, self.fraction),
        };
        let effective_poe =
            if self.ended == 0 { effective_poe(asked_poe, self.pressure) } else { self.coarsest(asked_poe) };
        Progress { fraction: self.fraction, tally, wanted, effective_poe, pictures: self.ended, seconds_to_go }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;
    use crate::math::PACKET;
    use crate::scene::walk::Need;

    const CALM: Seen = Seen { wants: ViewState::Satisfied, is_alone: true, pressure: 1.0, is_stale: false };
    const EFFORT: Effort = Effort { poe: 0.0, samples: 1 };
    const BUSY: Seen = Seen { wants: ViewState::Busy, ..CALM };

    fn lacking() -> Wants {
        let mut wants = Wants::default();
        wants.add(Need { model: 0, block: BlockId(5) }, 1.0);
        wants
    }

    fn render(passes: &mut Passes, wants: impl Fn(usize) -> Wants) {
        for item in 0..passes.items() {
            let tile = passes.tile(item);
            passes.done(tile, Merged::of(Tally::default()), EFFORT, &wants(tile));
        }
        passes.is_shown();
    }

    #[test]
    fn tiles_with_missing_blocks_are_rendered_again_after_news() {
        let mut passes = Passes::new(4, 1, false);
        passes.begin_all();
        render(&mut passes, |tile| if tile == 2 { lacking() } else { Wants::default() });
        assert_eq!(passes.next(BUSY, 0.0), Next::Wait);
        passes.has_news = true;
        assert_eq!(passes.next(BUSY, 0.0), Next::Pass { afresh: false });
        assert_eq!((passes.items(), passes.tile(0)), (1, 2));
        render(&mut passes, |_| Wants::default());
        assert_eq!(passes.next(CALM, 0.0), Next::End { is_converged: true });
    }

    #[test]
    fn more_samples_come_last_and_new_pressure_restarts() {
        let mut passes = Passes::new(2, 8, false);
        passes.begin_all();
        render(&mut passes, |_| Wants::default());
        for samples in [4, 8] {
            assert_eq!(passes.next(CALM, 1.0), Next::Pass { afresh: false });
            assert_eq!((passes.samples, passes.items()), (samples, 2));
        }
        let pressed = Seen { pressure: 1.25, ..CALM };
        assert_eq!(passes.next(pressed, 1.0), Next::Pass { afresh: true });
        passes.pressure = 1.25;
        assert_eq!(passes.samples, 1);
        let stale = Seen { is_stale: true, ..pressed };
        assert_eq!(passes.next(stale, 1.0), Next::Pass { afresh: true });
        while passes.next(pressed, 1.0) != Next::Pane {}
        assert_eq!((effective_poe(1.0, 1.25), effective_poe(0.0, 1.0), effective_poe(0.0, 2.0)), (1.25, 0.0, 1.0));
    }

    #[test]
    fn blocks_that_cannot_be_read_end_the_request() {
        let mut passes = Passes::new(1, 1, false);
        passes.begin_all();
        render(&mut passes, |_| lacking());
        let failed = Seen { wants: ViewState::Failed, ..CALM };
        assert_eq!(passes.next(failed, 0.0), Next::End { is_converged: false });
    }

    /// What does not fit at once is completed pane by pane; a pane that does not fit is halved.
    #[test]
    fn what_does_not_fit_is_completed_pane_by_pane() {
        let full = Seen { wants: ViewState::Full, ..CALM };
        for most in [0, 1, PACKET, 4 * PIXELS] {
            let mut passes = Passes::new(5, 4, false);
            passes.begin_all();
            render(&mut passes, |tile| if tile > 1 { lacking() } else { Wants::default() });
            assert_eq!(passes.next(full, 0.0), Next::Pane);
            assert_eq!(passes.effort(0.0), Effort { poe: 0.0, samples: 4 });
            let (mut pixels, mut end) = (0, Next::Pane);
            while end == Next::Pane {
                passes.begin_pane();
                let of_pane: usize = (0..passes.items()).map(|item| passes.pixels(passes.tile(item)).len()).sum();
                let fits = of_pane <= most;
                render(&mut passes, |_| if fits { Wants::default() } else { lacking() });
                pixels += if fits { of_pane } else { 0 };
                end = passes.next(full, 0.0);
            }
            let mut passes = Passes::new(5, 4, true);
            passes.begin_all();
            render(&mut passes, |_| lacking());
            assert_eq!(passes.next(full, 0.0), Next::End { is_converged: false });
            assert_eq!((end, pixels), (Next::End { is_converged: most > 0 }, if most > 0 { 5 * PIXELS } else { 0 }));
        }
    }

    /// A pixel that does not fit while other views need room is tried again later.
    #[test]
    fn a_pixel_waits_for_room() {
        let full = Seen { wants: ViewState::Full, ..CALM };
        let mut passes = Passes::new(1, 1, false);
        passes.begin_all();
        render(&mut passes, |_| lacking());
        while passes.pane != Some(0..1) {
            assert_eq!(passes.next(full, 0.0), Next::Pane);
            passes.begin_pane();
            render(&mut passes, |_| lacking());
        }
        let beside = Seen { is_alone: false, ..full };
        assert_eq!(passes.next(beside, 0.0), Next::Wait);
        passes.has_news = true;
        assert_eq!(passes.next(beside, 0.0), Next::Pass { afresh: false });
        render(&mut passes, |_| Wants::default());
        assert_eq!(
            (passes.next(full, 0.0), passes.panes.as_ref().map(|panes| panes.gave_up)),
            (Next::Pane, Some(false))
        );
    }

    #[test]
    fn counts_are_those_of_the_picture_that_is_shown() {
        let mut passes = Passes::new(2, 4, false);
        passes.begin_all();
        let of = |exact| Tally { exact, ..Tally::default() };
        let counted = |passes: &mut Passes| {
            passes.progress(Now { share: 0.5, wanted: 0, come: 0, seconds: 1.0 }, 0.0).tally.exact
        };
        passes.done(0, Merged::of(of(3)), EFFORT, &Wants::default());
        assert_eq!(counted(&mut passes), 3);
        passes.done(1, Merged::of(of(4)), EFFORT, &Wants::default());
        passes.is_shown();
        assert_eq!(passes.next(CALM, 0.0), Next::Pass { afresh: false });
        passes.done(0, Merged::of(of(1)), EFFORT, &Wants::default());
        assert_eq!(counted(&mut passes), 7);
        passes.done(1, Merged::of(of(1)), EFFORT, &Wants::default());
        passes.is_shown();
        assert_eq!(counted(&mut passes), 2);
    }

    #[test]
    fn the_fraction_never_decreases() {
        let mut passes = Passes::new(1, 1, false);
        passes.begin_all();
        let mut last = 0.0;
        for (share, wanted) in [(0.1, 0), (0.9, 0), (1.0, 1000)] {
            let now = passes.progress(Now { share, wanted, come: 0, seconds: 1.0 }, 0.0).fraction;
            assert!(now >= last);
            last = now;
        }
        render(&mut passes, |_| lacking());
        assert_eq!(passes.next(BUSY, 0.0), Next::Wait);
        for wanted in [1000, 2000, 500, 900, 0] {
            let now = passes.progress(Now { share: 0.3, wanted, come: 500, seconds: 1.0 }, 0.0);
            assert!(now.fraction >= last && now.fraction < 1.0 && now.pictures == 1);
            // Blocks arrive at 500 bytes per second.
            assert!(wanted == 0 || now.seconds_to_go == wanted as f64 / 500.0);
            last = now.fraction;
        }
    }
}
