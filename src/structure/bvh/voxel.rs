//! A voxel in the trace form of its block: the look of a child.

use super::layout::Block;
use crate::lod::{CURTAIN_WORDS, Coded, Curtain, Look, SIDES_WORDS, curtain_from, of_sample, stopped, summary_bit};
use glam::Vec3;

/// The voxel of a child, in its block.
#[derive(Debug, Clone, Copy)]
pub struct StoredVoxel<'a> {
    block: Block<'a>,
    /// Its first word.
    first: u32,
}

impl<'a> StoredVoxel<'a> {
    /// Voxel `index` of a block.
    #[inline]
    pub(super) fn new(block: Block<'a>, index: usize) -> Self {
        Self { block, first: (block.voxels_at() + index * block.voxel_words()) as u32 }
    }

    /// The words of the voxel, without those of its sides.
    #[inline]
    pub fn words(&self) -> &'a [u32] {
        let first = self.first as usize;
        &self.block.words()[first..first + self.block.voxel_words()]
    }

    #[inline]
    fn word(&self, at: usize) -> u32 {
        self.block.words()[self.first as usize + at]
    }

    /// True if the voxel has a sample for each side.
    #[inline]
    pub fn has_sides(&self) -> bool {
        Coded::has_sides(self.word(0))
    }

    /// True if the voxel's one sample describes surfaces that face along the axes.
    #[inline]
    pub fn is_along_axes(&self) -> bool {
        Coded::is_along_axes(self.word(0))
    }

    /// The words of the samples of its sides. Valid only if [`StoredVoxel::has_sides`].
    #[inline]
    pub fn sides(&self) -> &[u32] {
        let at = self.block.sides_at() + self.word(1) as usize * SIDES_WORDS;
        &self.block.words()[at..at + SIDES_WORDS]
    }

    /// The look of the voxel, without curtains.
    #[inline]
    pub fn look(&self) -> Look<'_> {
        let sample = [of_sample(self.word(0)), self.word(1)];
        if self.has_sides() {
            Look::Sides(self.sides())
        } else if self.is_along_axes() {
            Look::AlongAxes(sample)
        } else {
            Look::One(sample)
        }
    }

    /// True if the voxel has colours of its own, which replace the colour of its part.
    #[inline]
    pub fn has_colours(&self) -> bool {
        Coded::has_colours(self.word(0))
    }

    /// The tree's local part that covers most of the voxel, and true if there are other parts.
    #[inline]
    pub fn part(&self) -> (u32, bool) {
        self.words().get(2).map_or((self.block.words()[7], false), |word| Coded::part(*word))
    }

    /// Number of rays that the voxel stops, of 4096; 0: it stops all rays.
    #[inline]
    pub fn stopped(&self) -> u32 {
        stopped(self.word(0))
    }

    /// Share of the rays into its region that the voxel stops.
    pub fn share_stopped(&self) -> f32 {
        let stopped = self.stopped();
        if stopped == 0 { 1.0 } else { stopped as f32 / 4096.0 }
    }

    /// The bits of all parts in the voxel, see [`summary_bit`].
    pub fn summary(&self) -> u32 {
        match self.curtains_at() {
            Some(at) => self.block.words()[at],
            None => self.words().get(3).copied().unwrap_or_else(|| summary_bit(self.block.words()[7])),
        }
    }

    /// First word of the voxel's summary and curtains, if it has curtains.
    #[inline]
    fn curtains_at(&self) -> Option<usize> {
        let has_some = self.words().get(2).is_some_and(|word| Coded::has_curtains(*word));
        has_some.then(|| self.block.curtains_at() + self.word(3) as usize)
    }

    /// The bits of all parts that the voxel's curtains show, if it has curtains.
    pub fn shown(&self) -> Option<u32> {
        self.curtains_at().map(|at| self.block.words()[at + 1])
    }

    /// The words of the voxel's curtains.
    pub fn curtains(&self) -> impl Iterator<Item = [u32; CURTAIN_WORDS]> + use<'a> {
        let (words, mut at) = (self.block.words(), self.curtains_at().map(|at| at + 2));
        std::iter::from_fn(move || {
            let [a, b, c] = *words[at?..].first_chunk()?;
            at = if Curtain::is_last(a) { None } else { at.map(|at| at + CURTAIN_WORDS) };
            Some([a, b, c])
        })
    }

    /// The words of the sample that the voxel shows to an eye in direction `to_eye`, a unit vector, and its part, if a
    /// curtain hides the cell from there.
    #[inline]
    pub fn curtain(&self, to_eye: Vec3) -> Option<([u32; 2], u32)> {
        self.curtains().find(|words| curtain_from(words[0], to_eye)).map(Curtain::shown)
    }
}
