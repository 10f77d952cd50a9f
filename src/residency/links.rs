//! References between blocks: no block can check them alone, and seldom are all in memory at once.
//!
//! What each block has, and what others have ever referred to in it, is noted when it comes into memory. So each two
//! blocks that were ever in memory have been checked against each other, whichever came first and whether or not they
//! met, at a cost of the references of one block.

use crate::base::ids::BlockId;
use std::sync::{Mutex, PoisonError};

/// What a block says of another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// That it has this number.
    To(BlockId, u32),
    /// What all that say this of the same block must say alike.
    Agreed(BlockId, u64),
}

/// What is known of the blocks that may be referred to.
pub(super) struct Links {
    known: Mutex<Box<[Known]>>,
}

/// Of one block: numbers below `needed` are referred to, and it has numbers below `has`; `UNKNOWN` until it was read.
#[derive(Clone, Copy)]
struct Known {
    needed: u32,
    has: u32,
    /// The number that the first caller gave; later ones must give the same.
    agreed: Option<u64>,
}

const UNKNOWN: u32 = u32::MAX;

impl Links {
    /// Of a model's first `blocks` blocks; others are not referred to.
    pub fn new(blocks: u32) -> Self {
        Self { known: Mutex::new(vec![Known { needed: 0, has: UNKNOWN, agreed: None }; blocks as usize].into()) }
    }

    /// Bytes of the table.
    pub fn bytes_for(blocks: u32) -> u64 {
        u64::from(blocks) * size_of::<Known>() as u64
    }

    /// Notes that `number` of block `to` is referred to.
    pub fn expect(&self, to: BlockId, number: u32) -> Result<(), String> {
        refer(&mut self.known.lock().unwrap_or_else(PoisonError::into_inner), to, number)
    }

    /// Notes a block that has `has` numbers and refers to `references`.
    pub fn check(&self, id: BlockId, has: u32, references: &[Reference]) -> Result<(), String> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = known.get_mut(id.0 as usize) {
            if own.needed > has {
                return Err("another block refers to a node that it does not have".into());
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
    let absent = || format!("it refers to a node that block {} does not have", to.0);
    let target = known.get_mut(to.0 as usize).ok_or_else(absent)?;
    if number >= target.has {
        return Err(absent());
    }
    target.needed = target.needed.max(number + 1);
    Ok(())
}

fn agree(known: &mut [Known], of: BlockId, number: u64) -> Result<(), String> {
    let of = known.get_mut(of.0 as usize).ok_or("it goes with a block that is not there")?;
    if *of.agreed.get_or_insert(number) == number {
        Ok(())
    } else {
        Err("it and the block that goes with it differ".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whichever_comes_first_both_are_checked() {
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
