//! Which pixels of a rendered tile replace those of the picture: a pixel gives way only to one of smaller error, or to
//! one that is as requested. Among stand-ins the requested one may have a greater error than another one by chance. It
//! replaces that nevertheless, so that the end of a request does not depend on its course.

use super::tile::{PIXELS, TILE, Tally, TilePixels};
use crate::math::bits;

/// A mask of pixels for each row of a tile.
pub(super) type Rows = [u32; TILE as usize];

/// The threshold and the number of samples with which a tile was rendered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Effort {
    /// Effective threshold in pixels of error.
    pub poe: f32,
    /// Samples per pixel.
    pub samples: u32,
}

impl Effort {
    /// True if pixels of equal error are better, or as good, with this effort.
    pub fn is_as_great_as(self, other: Self) -> bool {
        self.poe <= other.poe && self.samples >= other.samples
    }
}

/// Kinds and errors of a tile's pixels.
#[derive(Debug, Clone)]
pub(super) struct Quality {
    /// Pixels that were rendered, pixels with a hit, pixels that show a stand-in within the threshold or anything
    /// behind one, and pixels that show a stand-in for missing data.
    pub rendered: Rows,
    pub hits: Rows,
    pub lod: Rows,
    pub missing: Rows,
    /// Number of pixels of the tile that the picture has.
    count: u64,
    /// Error in pixels.
    pub error_px: Box<[f32; PIXELS]>,
}

impl Quality {
    /// No pixel is rendered.
    pub fn new() -> Self {
        let none = [0; TILE as usize];
        Self { rendered: none, hits: none, lod: none, missing: none, count: 0, error_px: Box::new([0.0; PIXELS]) }
    }

    /// Exact pixels, some with a hit, `count` in all.
    fn exact(hits: Rows, count: u64) -> Self {
        Self { hits, count, ..Self::new() }
    }

    /// Marks all pixels as not rendered.
    pub fn clear(&mut self) {
        [self.rendered, self.hits, self.lod, self.missing] = [[0; TILE as usize]; 4];
        self.error_px.fill(0.0);
    }

    /// True if no pixel shows a stand-in, or anything behind one.
    fn is_exact(&self) -> bool {
        (0..TILE as usize).all(|row| self.lod[row] | self.missing[row] == 0)
    }

    /// The rank of a pixel: the lower the better. Exact answers are equal, whatever rounding adds to their error.
    fn rank(&self, row: usize, column: usize) -> f32 {
        let is_exact = (self.lod[row] | self.missing[row]) >> column & 1 == 0;
        if is_exact { 0.0 } else { self.error_px[row * TILE as usize + column].max(f32::MIN_POSITIVE) }
    }

    fn tally(&self) -> Tally {
        let count = |rows: &Rows| rows.iter().map(|row| u64::from(row.count_ones())).sum::<u64>();
        let (lod, missing) = (count(&self.lod), count(&self.missing));
        Tally {
            exact: self.count - lod - missing,
            lod,
            missing,
            hits: count(&self.hits),
            error_sum: self.error_px.iter().map(|e| f64::from(*e)).sum(),
            error_max: self.error_px.iter().fold(0.0, |most, e| most.max(*e)),
        }
    }
}

/// A tile of the picture.
#[derive(Debug, Clone, Default)]
pub(super) struct Merged {
    pub tally: Tally,
    effort: Option<Effort>,
    hits: Rows,
    /// Pixels that are as requested: only others that are so replace them.
    settled: Rows,
    /// `None`: all pixels are exact.
    quality: Option<Box<Quality>>,
}

impl Merged {
    #[cfg(test)]
    pub fn of(tally: Tally) -> Self {
        Self { tally, effort: Some(Effort { poe: 0.0, samples: 1 }), ..Self::default() }
    }

    /// Adds a rendering of the tile, or of some of its pixels, with a tally of these pixels. `as_requested`: the pixels
    /// are as requested, and lack no data. Returns the pixels that replace those of the picture.
    pub fn add(&mut self, pixels: &TilePixels, tally: Tally, effort: Effort, as_requested: bool) -> Rows {
        let new = pixels.quality();
        let Some(before) = self.effort else {
            let settled = if as_requested { new.rendered } else { [0; TILE as usize] };
            *self = Self { tally, effort: Some(effort), hits: new.hits, settled, quality: None };
            let count = tally.exact + tally.lod + tally.missing;
            self.quality = (!new.is_exact()).then(|| Box::new(Quality { count, ..new.clone() }));
            return new.rendered;
        };
        let is_as_great = effort.is_as_great_as(before);
        if is_as_great {
            self.effort = Some(effort);
        }
        let settled = self.settled;
        if as_requested {
            self.settled = std::array::from_fn(|row| settled[row] | new.rendered[row]);
        }
        if self.quality.is_none() && new.is_exact() {
            // Pixels that are all exact change only in their samples.
            return if is_as_great { new.rendered } else { [0; TILE as usize] };
        }
        let old = self.quality.get_or_insert_with(|| Box::new(Quality::exact(self.hits, self.tally.exact)));
        let mut taken = [0; TILE as usize];
        for (row, taken) in taken.iter_mut().enumerate() {
            if as_requested {
                *taken = new.rendered[row];
            } else {
                for column in bits(new.rendered[row] & !settled[row]) {
                    let (rank, best) = (new.rank(row, column), old.rank(row, column));
                    *taken |= u32::from(rank < best || rank == best && is_as_great) << column;
                }
            }
            let (is_new, at) = (*taken, row * TILE as usize);
            let merge = |old: &mut u32, new: u32| *old = *old & !is_new | new & is_new;
            merge(&mut old.hits[row], new.hits[row]);
            merge(&mut old.lod[row], new.lod[row]);
            merge(&mut old.missing[row], new.missing[row]);
            bits(is_new).for_each(|column| old.error_px[at + column] = new.error_px[at + column]);
        }
        (self.tally, self.hits) = (old.tally(), old.hits);
        if old.is_exact() {
            self.quality = None;
        }
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FINE: Effort = Effort { poe: 0.0, samples: 1 };
    const COARSE: Effort = Effort { poe: 4.0, samples: 1 };

    /// A rendering of the first row: the error of each pixel; 0 is exact.
    fn row(errors: &[f32]) -> (TilePixels, Tally) {
        let mut pixels = TilePixels::new();
        let quality = pixels.quality_mut();
        quality.clear();
        for (i, &error) in errors.iter().enumerate() {
            quality.rendered[0] |= 1 << i;
            quality.hits[0] |= 1 << i;
            quality.lod[0] |= u32::from(error > 0.0) << i;
            quality.error_px[i] = error;
        }
        quality.count = errors.len() as u64;
        let tally = quality.tally();
        (pixels, tally)
    }

    fn add(merged: &mut Merged, errors: &[f32], effort: Effort) -> u32 {
        let (pixels, tally) = row(errors);
        merged.add(&pixels, tally, effort, false)[0]
    }

    #[test]
    fn a_pixel_gives_way_only_to_one_of_smaller_error() {
        let mut merged = Merged::default();
        assert_eq!(add(&mut merged, &[3.0, 1.0, 0.0], FINE), 0b111);
        // Coarser pixels, and equal ones with less effort, do not replace others.
        assert_eq!(add(&mut merged, &[2.0, 2.0, 0.0], COARSE), 0b001);
        assert_eq!((merged.tally.exact, merged.tally.lod, merged.tally.error_sum), (1, 2, 3.0));
        // More samples of equal pixels do.
        assert_eq!(add(&mut merged, &[2.0, 1.0, 0.0], Effort { samples: 4, ..FINE }), 0b111);
        assert_eq!(add(&mut merged, &[0.0, 0.0, 0.0], FINE), 0b011);
        assert_eq!((merged.tally.exact, merged.tally.error_sum, merged.tally.hits), (3, 0.0, 3));
        assert_eq!(add(&mut merged, &[1.0, 0.0, 0.0], FINE), 0);
        // What is requested replaces everything.
        let (pixels, tally) = row(&[1.0, 0.0, 0.0]);
        assert_eq!(merged.add(&pixels, tally, FINE, true)[0], 0b111);
        assert_eq!((merged.tally.exact, merged.tally.lod, merged.tally.error_sum, merged.tally.hits), (2, 1, 1.0, 3));
        // Nothing else replaces it.
        assert_eq!(add(&mut merged, &[0.5, 0.0, 0.0], FINE), 0);
    }

    #[test]
    fn mean_and_worst_error_never_rise() {
        let mut merged = Merged::default();
        let mut before = (f64::INFINITY, f32::INFINITY);
        for seed in 0..200u32 {
            let error = |i: u32| (seed.wrapping_mul(2_654_435_761) ^ i.wrapping_mul(40_503)) % 97;
            let errors: Vec<f32> = (0..32).map(|i| error(i) as f32).collect();
            add(&mut merged, &errors, if seed.is_multiple_of(3) { FINE } else { COARSE });
            let now = (merged.tally.error_sum, merged.tally.error_max);
            assert!(now.0 <= before.0 && now.1 <= before.1, "{now:?} after {before:?}");
            before = now;
        }
    }
}
