//! References between blocks. No block can check them on its own, and all blocks are seldom in memory at once.
//!
//! When a block is read, a table records the number of its nodes and the nodes that it refers to in other blocks. So
//! each two blocks that were ever in memory have been checked against each other, in either order, even if they were
//! never in memory at the same time. The cost is that of one block's references.

use crate::base::ids::BlockId;
use std::sync::{Mutex, PoisonError};

/// Statement of a block about another block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// The block has the node with this number.
    To(BlockId, u32),
    /// A number on which all statements about the same block must agree.
    Agreed(BlockId, u64),
}

/// Facts about the blocks that may be referred to.
pub(super) struct Links {
    known: Mutex<Box<[Known]>>,
}

/// Facts about one block: others refer to its nodes below `needed`; it has nodes below `has`, `UNKNOWN` until it was
/// read.
#[derive(Clone, Copy)]
struct Known {
    needed: u32,
    has: u32,
    /// The first statement's number; later ones must give the same.
    agreed: Option<u64>,
}

const UNKNOWN: u32 = u32::MAX;

impl Links {
    /// Creates the table for a model's first `blocks` blocks. No other blocks may be referred to.
    pub fn new(blocks: u32) -> Self {
        Self { known: Mutex::new(vec![Known { needed: 0, has: UNKNOWN, agreed: None }; blocks as usize].into()) }
    }

    /// Bytes of the table.
    pub fn bytes_for(blocks: u32) -> u64 {
        u64::from(blocks) * size_of::<Known>() as u64
    }

    /// Records a reference to node `number` of block `to`.
    pub fn expect(&self, to: BlockId, number: u32) -> Result<(), String> {
        refer(&mut self.known.lock().unwrap_or_else(PoisonError::into_inner), to, number)
    }

    /// Records a block that has `has` nodes and makes the statements `references`.
    pub fn check(&self, id: BlockId, has: u32, references: &[Reference]) -> Result<(), String> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = known.get_mut(id.0 as usize) {
            if own.needed > has {
                return Err("another block refers to a node that does not exist in this block".into());
            }
            own.has = own.has.min(has);
        }
        references.iter().try_for_each(|&reference| match reference {
            Reference::To(to, number) => refer(&mut known, to, number),
            Reference::Agreed(of, number) => agree(&mut known, of, number),
        })
    }
}

fn refer(known: &mut [Known], to: BlockId, number: u32) -> Result<(), String> {
    let absent = || format!("the block refers to a node that does not exist in block {}", to.0);
    let target = known.get_mut(to.0 as usize).ok_or_else(absent)?;
    if number >= target.has {
        return Err(absent());
    }
    target.needed = target.needed.max(number + 1);
    Ok(())
}

fn agree(known: &mut [Known], of: BlockId, number: u64) -> Result<(), String> {
    let of = known.get_mut(of.0 as usize).ok_or("the corresponding block does not exist")?;
    if *of.agreed.get_or_insert(number) == number {
        Ok(())
    } else {
        Err("the block and its corresponding block are inconsistent".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_checked_in_either_order() {
        let links = Links::new(4);
        let to = |number| [Reference::To(BlockId(2), number)];
        links.check(BlockId(0), 1, &to(4)).expect("the target is not known yet");
        links.check(BlockId(2), 4, &[]).expect_err("has too few");
        links.check(BlockId(2), 5, &[]).expect("has enough");
        links.check(BlockId(1), 1, &to(5)).expect_err("refers to too much");
        links.check(BlockId(1), 1, &[Reference::To(BlockId(4), 0)]).expect_err("refers to no block");
        links.expect(BlockId(2), 4).expect("is there");
        links.expect(BlockId(2), 5).expect_err("is not");
        links.check(BlockId(9), 0, &to(0)).expect("a block that nobody refers to");
        let both = |number| [Reference::Agreed(BlockId(1), number)];
        links.check(BlockId(0), 1, &both(7)).expect("the first to say so");
        links.check(BlockId(1), 1, &both(8)).expect_err("says otherwise");
        links.check(BlockId(1), 1, &both(7)).expect("says the same");
        links.check(BlockId(1), 1, &[Reference::Agreed(BlockId(4), 7)]).expect_err("no such block");
        links.expect(BlockId(3), u32::MAX).expect_err("no such number");
    }
}
