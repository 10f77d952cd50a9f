//! The looks of instances and of their parts, and the blocks that walks need under them.

use super::model::Model;
use crate::base::error::Result;
use crate::lod::summary_bit;
use crate::residency::Kept;
use crate::store::{PartSets, TreeRow};
use crate::structure::{ShownBlock, ShownBlocks};
use std::collections::HashMap;
use std::sync::Arc;

/// The memory of looks, for messages.
pub(super) const WHAT: &str = "the looks of parts";

/// The look of an instance or of a part of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// True if rays can hit it.
    pub visible: bool,
    /// Linear RGBA that replaces its own colour; alpha is the opacity.
    pub colour: Option<[f32; 4]>,
    /// True if it is highlighted.
    pub selected: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self { visible: true, colour: None, selected: false }
    }
}

impl Look {
    /// True if its colour is transparent.
    pub(crate) fn see_through(&self) -> bool {
        self.colour.is_some_and(|c| c[3] < 1.0)
    }
}

/// The looks of an instance's parts that differ from the default.
#[derive(Debug, Clone, Default)]
pub(crate) struct PartLooks {
    /// Bit `i % 64` of word `i / 64`: part `i` is hidden. The last word is not 0.
    pub hidden: Vec<u64>,
    /// Looks with a colour or a highlight, by index of the part.
    pub coloured: HashMap<u32, Look>,
}

impl PartLooks {
    /// True if all parts look as in the file.
    pub fn is_empty(&self) -> bool {
        self.hidden.is_empty() && self.coloured.is_empty()
    }

    /// True if the part is hidden.
    pub fn hides(&self, part: u32) -> bool {
        self.hidden.get(part as usize / 64).is_some_and(|word| word >> (part % 64) & 1 == 1)
    }

    /// Sets one part's look.
    pub fn set(&mut self, part: u32, look: Look) {
        self.set_visible(part, look.visible);
        if look.colour.is_none() && !look.selected {
            self.coloured.remove(&part);
        } else {
            self.coloured.insert(part, look);
        }
    }

    /// Hides a part, or shows it.
    pub fn set_visible(&mut self, part: u32, is_visible: bool) {
        let (word, bit) = (part as usize / 64, part % 64);
        if !is_visible && self.hidden.len() <= word {
            self.hidden.resize(word + 1, 0);
        }
        if let Some(w) = self.hidden.get_mut(word) {
            *w = *w & !(1 << bit) | u64::from(!is_visible) << bit;
        }
        while self.hidden.last() == Some(&0) {
            self.hidden.pop();
        }
    }

    /// Hides all parts but `parts`, of `count` in all.
    pub fn isolate(&mut self, count: u32, parts: &mut dyn Iterator<Item = u32>) {
        self.hidden = vec![u64::MAX; count as usize / 64];
        self.hidden.extend((!count.is_multiple_of(64)).then_some((1 << (count % 64)) - 1));
        parts.for_each(|part| self.set_visible(part, true));
    }

    /// Returns the looks of the parts with the same ids in another model.
    pub fn carried(&self, from: &Model, to: &Model) -> Self {
        let mut looks = Self::default();
        for (i, part) in from.parts().iter().enumerate() {
            let (i, is_first) = (i as u32, from.part_index(part.id) == Some(i as u32));
            let Some(there) = to.part_index(part.id).filter(|_| is_first) else { continue };
            if self.hides(i) {
                looks.set_visible(there, false);
            }
            if let Some(look) = self.coloured.get(&i) {
                looks.coloured.insert(there, *look);
            }
        }
        looks
    }

    /// True if a part has a look with a transparent colour.
    pub fn see_through(&self) -> bool {
        self.coloured.values().any(Look::see_through)
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        (8 * self.hidden.capacity() + Self::ENTRY * self.coloured.len()) as u64
    }

    /// Bytes of an entry of `coloured`, whose table may be half empty.
    const ENTRY: usize = 2 * (size_of::<(u32, Look)>() + 1);

    /// Greatest number of bytes that an edit of `parts`, of `count` in all, adds. `colours`: they get looks with a
    /// colour or a highlight.
    pub fn growth(&self, parts: &[u32], count: usize, colours: bool) -> u64 {
        let new = if colours { parts.iter().filter(|part| !self.coloured.contains_key(part)).count() } else { 0 };
        (8 * count.div_ceil(64).saturating_sub(self.hidden.capacity()) + Self::ENTRY * new) as u64
    }
}

/// The looks of an instance's parts at a commit, and what walks need to know of them.
#[derive(Default)]
pub(crate) struct PartsShown {
    pub looks: Arc<PartLooks>,
    /// The bits (`lod::summary_bit`) of the model's parts that are hidden or look different from the file, of those
    /// that are hidden, of those that are hidden or see-through, and of those that are visible.
    touched: u32,
    hidden_bits: u32,
    unseen_bits: u32,
    visible_bits: u32,
    /// For each placed tree of the instance; empty if no part is hidden.
    pub trees: Box<[ShownBlocks]>,
    /// Bytes of its memory.
    pub took: u64,
    _memory: Kept,
}

impl PartsShown {
    /// Finds the blocks that are needed under `looks`. The model's sets of parts must have been read if parts are
    /// hidden. `counts`: the memory counts even if it is little. Fails with `OverBudget`.
    pub fn of(model: &Model, looks: &Arc<PartLooks>, counts: bool) -> Result<Self> {
        let looks = Arc::clone(looks);
        let sets = if looks.hidden.is_empty() { None } else { Some(model.part_sets()?) };
        let took = Self::bytes(model, &looks);
        let memory = if counts { model.context().residency().keep_all(WHAT, took)? } else { Kept::default() };
        let of_trees = |sets| placed(model).map(|(row, first)| shown_blocks(&looks, row, first, sets)).collect();
        let trees: Box<[ShownBlocks]> = sets.as_ref().map(|sets| of_trees(sets)).unwrap_or_default();
        let (mut hidden_bits, mut visible_bits) = (0, 0);
        for part in 0..model.parts().len() as u32 {
            *(if looks.hides(part) { &mut hidden_bits } else { &mut visible_bits }) |= summary_bit(part);
        }
        let touched = looks.coloured.keys().fold(hidden_bits, |all, &p| all | summary_bit(p));
        let clear = looks.coloured.iter().filter(|(_, look)| look.see_through());
        let unseen_bits = clear.fold(hidden_bits, |all, (&p, _)| all | summary_bit(p));
        Ok(Self { looks, touched, hidden_bits, unseen_bits, visible_bits, trees, took, _memory: memory })
    }

    /// Bytes of memory that [`PartsShown::of`] takes, those of the looks included.
    pub fn bytes(model: &Model, looks: &PartLooks) -> u64 {
        let of_tree =
            |row: &TreeRow| (row.block_count as usize * size_of::<ShownBlock>() + size_of::<ShownBlocks>()) as u64;
        let trees = if looks.hidden.is_empty() { 0 } else { placed(model).map(|(row, _)| of_tree(row)).sum() };
        size_of::<Self>() as u64 + looks.bytes() + trees
    }

    /// The bits of the parts that are hidden or look different from the file, for a mesh with the local part 0 at
    /// `first_part`.
    pub fn touched(&self, first_part: u32) -> u32 {
        self.touched.rotate_right(first_part % 32)
    }

    /// The bits of the hidden parts, likewise.
    pub fn hidden_bits(&self, first_part: u32) -> u32 {
        self.hidden_bits.rotate_right(first_part % 32)
    }

    /// The bits of the parts that are hidden or see-through, likewise.
    pub fn unseen_bits(&self, first_part: u32) -> u32 {
        self.unseen_bits.rotate_right(first_part % 32)
    }

    /// The bits of the visible parts, likewise.
    pub fn visible_bits(&self, first_part: u32) -> u32 {
        self.visible_bits.rotate_right(first_part % 32)
    }
}

/// Returns the rows of the trees of a model's placements, with the parts that are their local parts 0.
fn placed(model: &Model) -> impl Iterator<Item = (&TreeRow, u32)> {
    let rows = model.blocks().file().trees();
    model.placements().map(|(tree, first_part, _)| (&rows[tree as usize], first_part))
}

/// Returns the visible parts in and below each block of a tree whose local part 0 is `first_part`.
fn shown_blocks(looks: &PartLooks, row: &TreeRow, first_part: u32, sets: &PartSets) -> ShownBlocks {
    blocks_of(&|part| !looks.hides(first_part.saturating_add(part)), row, sets)
}

/// Returns which of some parts are in and below each block of a tree; `has` is true for these, as parts of the tree.
/// Fails like [`Model::part_sets`].
pub(crate) fn blocks_with(model: &Model, tree: u32, has: &dyn Fn(u32) -> bool) -> Result<ShownBlocks> {
    let sets = model.part_sets()?;
    Ok(blocks_of(has, &model.blocks().file().trees()[tree as usize], &sets))
}

fn blocks_of(has: &dyn Fn(u32) -> bool, row: &TreeRow, sets: &PartSets) -> ShownBlocks {
    let of_parts = |parts: &mut dyn Iterator<Item = u32>| {
        let visible = parts.filter(|&part| has(part));
        visible.fold(ShownBlock::NOTHING, |all, part| ShownBlock {
            bits: all.bits | summary_bit(part),
            part: all.part.min(part),
        })
    };
    // A tree of one part needs no sets.
    let only = (row.local_parts == 1).then(|| of_parts(&mut std::iter::once(0)));
    let of_block = |block: u32| {
        let mut parts = sets.of(block as usize).peekable();
        only.unwrap_or_else(|| if parts.peek().is_none() { ShownBlock::UNKNOWN } else { of_parts(&mut parts) })
    };
    let blocks = row.first_block..row.first_block + row.block_count;
    ShownBlocks { first_block: row.first_block, blocks: blocks.map(of_block).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_hidden_parts_alone_are_passed_by() {
        let mut sets = PartSets::default();
        // A block of another tree, then those of this one: all parts, two parts, one part, unknown.
        for set in [&[0][..], &[0, 1, 2, 3], &[1, 2], &[3], &[]] {
            sets.push(set.iter().copied()).expect("small");
        }
        let mut looks = PartLooks::default();
        [11, 12].iter().for_each(|&part| looks.set_visible(part, false));
        let row = TreeRow { first_block: 1, block_count: 4, local_parts: 4, ..TreeRow::EMPTY };
        let shown = shown_blocks(&looks, &row, 10, &sets);
        assert_eq!(
            [0, 1, 2, 3, 4, 9].map(|block| shown.bits(block)),
            [u32::MAX, 0b1001, 0, 0b1000, u32::MAX, u32::MAX]
        );
        assert_eq!([0, 1, 2, 3, 4, 9].map(|block| shown.lacks(block)), [false, false, true, false, false, false]);
        assert_eq!([1, 2, 3, 4].map(|block| shown.part_in(block)), [Some(0), None, Some(3), None]);
        let one = TreeRow { local_parts: 1, ..row };
        assert_eq!(*shown_blocks(&looks, &one, 11, &PartSets::default()).blocks, [ShownBlock::NOTHING; 4]);
        assert_eq!(*shown_blocks(&looks, &one, 10, &PartSets::default()).blocks, [ShownBlock { bits: 1, part: 0 }; 4]);
    }

    #[test]
    fn looks_can_be_set_back() {
        let mut looks = PartLooks::default();
        let red = Look { colour: Some([1.0, 0.0, 0.0, 0.5]), ..Look::default() };
        looks.set(70, Look { visible: false, ..red });
        looks.set(3, red);
        assert!(looks.hides(70) && !looks.hides(3) && !looks.hides(1000) && looks.see_through());
        looks.set(70, Look::default());
        looks.set(3, Look::default());
        assert!(looks.is_empty());
    }
}
