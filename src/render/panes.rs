//! Panes: parts of a picture that are completed one after the other. The blocks that all of a picture needs may not fit
//! the budget; those of a pane do, if the pane is small enough. A pane that does not fit is halved, down to one pixel.

use super::tile::PIXELS;
use crate::math::PACKET;
use std::ops::Range;

/// The panes of a picture that are not complete. Pixels are counted tile by tile, and packet by packet in each.
pub(super) struct Panes {
    /// Ranges of pixels; the last one is next.
    left: Vec<Range<usize>>,
    /// Size of the pane that fitted last.
    fitting: usize,
    /// Number of pixels of all panes, and of those that remain.
    all: usize,
    remaining: usize,
    /// True if a pixel did not fit, or some of its blocks cannot be read.
    pub gave_up: bool,
}

impl Panes {
    /// Makes panes of these tiles, given by their ascending numbers.
    pub fn of(tiles: &[usize]) -> Self {
        let mut left: Vec<Range<usize>> = Vec::new();
        for &tile in tiles {
            let own = tile * PIXELS..(tile + 1) * PIXELS;
            match left.last_mut() {
                Some(last) if last.end == own.start => last.end = own.end,
                _ => left.push(own),
            }
        }
        left.reverse();
        let all = left.iter().map(Range::len).sum();
        Self { left, fitting: usize::MAX, all, remaining: all, gave_up: false }
    }

    /// The next pane; `None` if all are complete.
    pub fn next(&mut self) -> Option<Range<usize>> {
        // After a pane has been halved, others of its size will not fit either.
        let most = self.fitting.saturating_mul(2);
        while let Some(first) = self.left.last().filter(|pane| pane.len() > most).cloned() {
            self.halve(first);
        }
        self.left.last().cloned()
    }

    /// The next pane is complete.
    pub fn is_complete(&mut self) {
        if let Some(pane) = self.left.pop() {
            self.remaining -= pane.len();
            self.fitting = pane.len();
        }
    }

    /// Halves the next pane, which does not fit. Returns false if it is a single pixel.
    pub fn halve_next(&mut self) -> bool {
        let next = self.left.last().cloned().filter(|pane| pane.len() > 1);
        if let Some(pane) = next.clone() {
            self.halve(pane);
            self.fitting = usize::MAX;
        }
        next.is_some()
    }

    /// The next pane is left as it is.
    pub fn give_up(&mut self) {
        self.gave_up = true;
        let fitting = self.fitting;
        self.is_complete();
        self.fitting = fitting;
    }

    /// Halves the next pane: between two tiles if it has several, or else between two packets.
    fn halve(&mut self, pane: Range<usize>) {
        let half = pane.start + pane.len() / 2;
        let between =
            |size: usize| Some(half.next_multiple_of(size)).filter(|at| pane.len() >= 2 * size && *at < pane.end);
        let middle = between(PIXELS).or_else(|| between(PACKET)).unwrap_or(half);
        self.left.pop();
        self.left.extend([middle..pane.end, pane.start..middle]);
    }

    /// Fraction of the pixels that are done.
    pub fn fraction(&self) -> f64 {
        1.0 - self.remaining as f64 / self.all.max(1) as f64
    }
}

/// The tiles that a pane touches.
pub(super) fn tiles_of(pane: &Range<usize>) -> Range<usize> {
    pane.start / PIXELS..pane.end.div_ceil(PIXELS)
}

/// The pixels of tile `tile` that a pane has.
pub(super) fn pixels_of(pane: &Range<usize>, tile: usize) -> Range<usize> {
    let first = tile * PIXELS;
    pane.start.max(first) - first..pane.end.min(first + PIXELS).max(first) - first
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Completes all panes of at most `most` pixels.
    fn run(tiles: &[usize], most: usize) -> (Vec<Range<usize>>, usize, bool) {
        let mut panes = Panes::of(tiles);
        let (mut done, mut tries, mut fraction) = (Vec::new(), 0, 0.0);
        while let Some(pane) = panes.next() {
            tries += 1;
            assert!(panes.fraction() >= fraction && panes.fraction() < 1.0);
            fraction = panes.fraction();
            if pane.len() <= most {
                done.push(pane);
                panes.is_complete();
            } else if !panes.halve_next() {
                panes.give_up();
            }
        }
        assert_eq!(panes.fraction(), 1.0);
        (done, tries, panes.gave_up)
    }

    #[test]
    fn panes_cover_their_tiles_once() {
        let tiles: Vec<usize> = (0..40).filter(|tile| tile % 7 != 3).collect();
        for most in [1, 3, PACKET, 5 * PACKET, PIXELS, 5 * PIXELS, 1000 * PIXELS] {
            let (done, tries, gave_up) = run(&tiles, most);
            let mut all: Vec<usize> = done.iter().flat_map(Clone::clone).collect();
            assert!(all.is_sorted(), "panes follow one another");
            all.dedup();
            assert_eq!(all, tiles.iter().flat_map(|tile| tile * PIXELS..(tile + 1) * PIXELS).collect::<Vec<_>>());
            assert!(!gave_up && tries <= 3 * done.len() + 20, "{tries} tries for {} panes", done.len());
        }
        assert!(run(&tiles, 0).2);
    }

    #[test]
    fn panes_have_tiles_and_pixels() {
        let pane = PIXELS - 2..2 * PIXELS + 3;
        assert_eq!(tiles_of(&pane), 0..3);
        let pixels = [0, 1, 2].map(|tile| pixels_of(&pane, tile));
        assert_eq!(pixels, [PIXELS - 2..PIXELS, 0..PIXELS, 0..3]);
    }

    #[test]
    fn halves_end_with_packets() {
        let mut panes = Panes::of(&[0]);
        while panes.next().is_some_and(|pane| pane.len() > PACKET) {
            assert!(panes.halve_next());
            assert_eq!(panes.next().map_or(1, |pane| pane.end % PACKET), 0);
        }
        (0..PACKET.ilog2()).for_each(|_| assert!(panes.halve_next()));
        assert_eq!((panes.next(), panes.halve_next()), (Some(0..1), false));
    }
}
