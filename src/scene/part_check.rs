//! The check of the parts of blocks (FORMAT.md, section 5): a list that lacks a part of its block would hide it, or
//! show it though it is hidden, once parts are hidden.

use super::model::Model;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::residency::Snapshot;
use crate::store::PartSets;
use crate::structure::open::{self, ListedParts};

/// Compares the lists of a model with its blocks.
pub(super) struct PartCheck<'a> {
    model: &'a Model,
    sets: &'a PartSets,
}

impl<'a> PartCheck<'a> {
    /// A check of `model`, whose lists are `sets`.
    pub fn new(model: &'a Model, sets: &'a PartSets) -> Self {
        Self { model, sets }
    }

    /// Checks the lists of blocks in a snapshot. Fails with `Corrupt`, which names the block and a part that is not in
    /// the list of the block.
    ///
    /// It suffices to compare each list with the block's own parts and with the lists of the blocks directly below.
    pub fn run(&self, blocks: &[BlockId], there: &Snapshot, cancel: &Cancel) -> Result<()> {
        let file = self.model.blocks().file();
        for &id in blocks.iter().filter(|_| !self.sets.is_empty()) {
            cancel.check()?;
            let tree = file.trees().partition_point(|tree| tree.first_block + tree.block_count <= id.0);
            let (Some(tree), Some(words)) = (file.trees().get(tree), there.block(id)) else { continue };
            // A tree of one part needs no lists.
            if tree.local_parts <= 1 {
                continue;
            }
            let ListedParts { parts, listed_by, below } = open::block_parts(file, tree, id, words)?;
            self.compare(listed_by, &parts, || place(listed_by, id))?;
            for below in below {
                cancel.check()?;
                let listed: Vec<u32> = self.sets.of(below.0 as usize).collect();
                if listed.is_empty() && self.sets.of(id.0 as usize).next().is_some() {
                    let why = format!("it has a list of its parts, but block {} below it has none", below.0);
                    return Err(Error::corrupt(file.name(), Some(id.0), why));
                }
                self.compare(id, &listed, || format!("is in the list of block {} below it", below.0))?;
            }
        }
        Ok(())
    }

    /// Fails if the list of a block lacks one of `parts`, which ascend. `place` says where they are. An empty list
    /// lacks nothing.
    fn compare(&self, id: BlockId, parts: &[u32], place: impl Fn() -> String) -> Result<()> {
        let mut listed = self.sets.of(id.0 as usize).peekable();
        if listed.peek().is_none() {
            return Ok(());
        }
        let lacks = |part: &&u32| {
            while listed.next_if(|listed| listed < *part).is_some() {}
            listed.peek() != Some(*part)
        };
        match parts.iter().find(lacks) {
            None => Ok(()),
            Some(part) => {
                let why = format!("its list of parts lacks local part {part}, which {}", place());
                Err(Error::corrupt(self.model.blocks().file().name(), Some(id.0), why))
            }
        }
    }
}

/// The place of the parts of block `id`, which another block may list.
fn place(listed_by: BlockId, id: BlockId) -> String {
    if listed_by == id { "is in the block".into() } else { format!("is in its block {}", id.0) }
}
