//! The parts in and below each geometry block, collected while the blocks are written.

use super::output::Output;
use crate::base::bytes::Malformed;
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::store::PartSets;
use std::collections::HashMap;

/// Parts of a block, see [`crate::structure::bake::BakedBlock`].
pub struct BlockParts {
    pub own: Vec<u32>,
    pub below: Vec<u32>,
}

/// Parts of the blocks of a tree, in the order of the blocks.
#[derive(Default)]
pub struct TreeParts {
    own: PartSets,
    /// Blocks that refer to other blocks, ascending, with these.
    above: Vec<(usize, Vec<u32>)>,
}

fn refuse(why: Malformed) -> Error {
    Error::bad_argument(format!("model: {why}"))
}

impl TreeParts {
    /// Adds a block.
    pub fn push(&mut self, parts: BlockParts) -> Result<()> {
        let BlockParts { own, below } = parts;
        if !below.is_empty() {
            self.above.push((self.own.len(), below));
        }
        self.own.push(own).map_err(refuse)
    }

    /// Adds all blocks of `other`.
    pub fn append(&mut self, other: Self) -> Result<()> {
        let first = self.own.len();
        self.above.extend(other.above.into_iter().map(|(block, below)| (first + block, below)));
        self.own.append(&other.own).map_err(refuse)
    }

    /// Adds the set of each block to `sets`: its own parts and those of all blocks below it. If one of these is
    /// unknown, so is the set. A block refers only to later blocks.
    fn close(self, sets: &mut PartSets, cancel: &Cancel) -> Result<()> {
        let mut closed: HashMap<usize, Vec<u32>> = HashMap::with_capacity(self.above.len());
        for (block, below) in self.above.into_iter().rev() {
            let (mut all, mut is_known): (Vec<u32>, bool) = (self.own.of(block).collect(), true);
            for to in below {
                cancel.check()?;
                let before = all.len();
                match closed.get(&(to as usize)) {
                    Some(set) => all.extend(set),
                    None => all.extend(self.own.of(to as usize)),
                }
                is_known &= all.len() > before;
            }
            all.sort_unstable();
            all.dedup();
            closed.insert(block, if is_known { all } else { Vec::new() });
        }
        for block in 0..self.own.len() {
            cancel.check()?;
            match closed.remove(&block) {
                Some(set) => sets.push(set),
                None => sets.push(self.own.of(block)),
            }
            .map_err(refuse)?;
        }
        Ok(())
    }
}

impl Output<'_> {
    /// Adds the sets of the tree whose blocks were written last.
    pub fn end_tree_parts(&mut self) -> Result<()> {
        std::mem::take(&mut self.tree_parts).close(&mut self.part_sets, self.cancel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_holds_the_parts_of_all_blocks_below() {
        let mut tree = TreeParts::default();
        let block = |own: &[u32], below: &[u32]| BlockParts { own: own.to_vec(), below: below.to_vec() };
        tree.push(block(&[], &[1, 2])).expect("small");
        tree.push(block(&[], &[3, 4])).expect("small");
        let mut rest = TreeParts::default();
        rest.push(block(&[], &[4, 5])).expect("small");
        for own in [&[2, 9][..], &[1, 2], &[]] {
            rest.push(block(own, &[])).expect("small");
        }
        tree.append(rest).expect("small");
        // Block 5 says nothing about its parts, so neither do the blocks above it. Block 2 was added as block 0 of
        // `rest`.
        let mut sets = PartSets::default();
        tree.close(&mut sets, &Cancel::new()).expect("small");
        let found: Vec<Vec<u32>> = (0..6).map(|i| sets.of(i).collect()).collect();
        assert_eq!(found, [vec![], vec![1, 2, 9], vec![], vec![2, 9], vec![1, 2], vec![]]);
    }

    #[test]
    fn a_cancel_ends_the_closing() {
        let (mut tree, cancel) = (TreeParts::default(), Cancel::new());
        tree.push(BlockParts { own: vec![0], below: Vec::new() }).expect("small");
        cancel.cancel();
        assert!(matches!(tree.close(&mut PartSets::default(), &cancel), Err(Error::Cancelled)));
    }
}
