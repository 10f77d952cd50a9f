//! References between blocks. No block can check them on its own, and all blocks are seldom in memory at once.
//!
//! When a block is read, a table records the nodes of the block that other blocks may enter (those that no node of the
//! block itself refers to), and the nodes that it enters in other blocks. Each node is entered by one reference only:
//! a second one is refused, whichever block was read first, and even if the two were never in memory at the same time.
//! So the blocks in memory form a tree, and a traversal visits each node once at most. The cost is that of one block's
//! references.
//!
//! A block that is read again must make the statements of its first time. A block whose statements were refused stays
//! refused.

use crate::base::error::Result as Fallible;
use crate::base::ids::BlockId;
use crate::base::memory::{room, zeroed};
use std::hash::{BuildHasher, RandomState};
use std::sync::{Mutex, PoisonError};

/// Statement of a block about another block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reference {
    /// The block refers to the node with this number of another block.
    To(BlockId, u32),
    /// A number on which all statements about the same block must agree.
    Agreed(BlockId, u64),
}

/// Greatest number of nodes of a block that other blocks may refer to.
pub const MOST_NODES: usize = 512;

/// Nodes of a block that other blocks may enter, one bit each.
pub type Entries = [u64; MOST_NODES / 64];

/// Facts about the blocks that may be referred to.
pub(super) struct Links {
    known: Mutex<Known>,
    /// Key of the hash of a block's statements. It is random, so that no file can have two blocks with one hash.
    key: RandomState,
}

struct Known {
    blocks: Vec<Facts>,
    /// For each block with [`Facts::entries_at`]: until the block is read, its nodes that other blocks refer to; then
    /// its nodes that no block refers to yet.
    entries: Vec<Entries>,
}

/// Facts about one block.
#[derive(Clone, Copy)]
struct Facts {
    /// The hash of the block's statements; [`UNREAD`] or [`REFUSED`].
    stated: u64,
    /// The first number that was stated about the block, or 0; later ones must give the same.
    agreed: u64,
    /// Index of the block's nodes in [`Known::entries`], or [`NO_ENTRIES`] for a block that no other may refer to.
    entries_at: u32,
    /// A walk begins at the node below this one; the block has nodes below `has`, `u32::MAX` until it was read.
    needed: u32,
    has: u32,
}

const UNREAD: u64 = 0;
const REFUSED: u64 = 1;
const NO_ENTRIES: u32 = u32::MAX;

/// Statements of a block about itself and about others.
#[derive(Debug, Clone, Default)]
pub struct Statements {
    /// Number of its nodes.
    pub nodes: u32,
    /// Its nodes that other blocks may enter.
    pub entries: Entries,
    /// Its statements about others.
    pub references: Vec<Reference>,
}

impl Links {
    /// Creates the table for the first `blocks` blocks of a model. Other blocks may refer to those for which
    /// `is_entered` holds. Fails with `NoMemory`.
    pub fn new(blocks: u32, is_entered: impl Fn(BlockId) -> bool) -> Fallible<Self> {
        let mut all = room(blocks as usize, "the table of references between blocks")?;
        let mut entered = 0;
        for id in (0..blocks).map(BlockId) {
            let entries_at = if is_entered(id) { entered } else { NO_ENTRIES };
            entered += u32::from(is_entered(id));
            all.push(Facts { stated: UNREAD, agreed: 0, entries_at, needed: 0, has: u32::MAX });
        }
        let entries = zeroed(entered as usize, "the table of references between blocks")?;
        Ok(Self { known: Mutex::new(Known { blocks: all, entries }), key: RandomState::new() })
    }

    /// Bytes of the table for `blocks` blocks, `entered` of which others may refer to.
    pub fn bytes_for(blocks: u32, entered: u32) -> u64 {
        u64::from(blocks) * size_of::<Facts>() as u64 + u64::from(entered) * size_of::<Entries>() as u64
    }

    /// Requires that block `of` has node `number`.
    pub fn expect(&self, of: BlockId, number: u32) -> Result<(), String> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let facts = known.blocks.get_mut(of.0 as usize).filter(|facts| number < facts.has);
        let facts = facts.ok_or_else(|| absent(of))?;
        facts.needed = facts.needed.max(number + 1);
        Ok(())
    }

    /// Records the statements of a block that was read, or compares them with those of the first time.
    pub fn check(&self, id: BlockId, statements: &Statements) -> Result<(), String> {
        let Statements { nodes, entries, references } = statements;
        let hash = self.key.hash_one((nodes, entries, references)) | 2;
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let stated = known.blocks.get(id.0 as usize).map_or(UNREAD, |facts| facts.stated);
        if stated == hash {
            return Ok(());
        }
        let checked = match stated {
            UNREAD => known.record(id, statements),
            REFUSED => Err(INVALID.into()),
            _ => Err("the block has changed since it was first read".into()),
        };
        if let Some(facts) = known.blocks.get_mut(id.0 as usize).filter(|_| stated == UNREAD) {
            facts.stated = if checked.is_ok() { hash } else { REFUSED };
        }
        checked
    }
}

impl Known {
    fn record(&mut self, id: BlockId, statements: &Statements) -> Result<(), String> {
        let Statements { nodes, entries, references } = statements;
        if let Some(facts) = self.blocks.get_mut(id.0 as usize) {
            if facts.needed > *nodes {
                return Err(NO_NODE.into());
            }
            facts.has = *nodes;
            if let Some(entered) = self.entries.get_mut(facts.entries_at as usize) {
                if entered.iter().zip(entries).any(|(entered, may_be)| entered & !may_be != 0) {
                    return Err(NO_NODE.into());
                }
                entered.iter_mut().zip(entries).for_each(|(entered, may_be)| *entered = may_be & !*entered);
            }
        }
        references.iter().try_for_each(|&reference| match reference {
            Reference::To(to, number) => self.enter(to, number),
            Reference::Agreed(of, number) => self.agree(of, number),
        })
    }

    fn enter(&mut self, to: BlockId, number: u32) -> Result<(), String> {
        let facts = self.blocks.get(to.0 as usize).ok_or_else(|| absent(to))?;
        let entries = self.entries.get_mut(facts.entries_at as usize);
        let word = entries.and_then(|entries| entries.get_mut(number as usize / 64)).ok_or_else(|| absent(to))?;
        let (bit, is_read) = (1 << (number % 64), facts.stated > REFUSED);
        if facts.stated == REFUSED {
            return Ok(());
        }
        if is_read != (*word & bit != 0) {
            return Err(if is_read && number >= facts.has { absent(to) } else { twice(to) });
        }
        *word ^= bit;
        Ok(())
    }

    fn agree(&mut self, of: BlockId, number: u64) -> Result<(), String> {
        let facts = self.blocks.get_mut(of.0 as usize).ok_or("the corresponding block does not exist")?;
        // 0 is for blocks about which nothing was stated.
        let number = number | 1;
        if facts.agreed == 0 {
            facts.agreed = number;
        }
        if facts.agreed == number {
            Ok(())
        } else {
            Err("the block and its corresponding block are inconsistent".into())
        }
    }
}

const NO_NODE: &str = "another block refers to a node of this block that does not exist or that has a parent in it";

const INVALID: &str = "a reference between this block and others leads to a node that does not exist, or to one that \
                       another node refers to, or the block and its corresponding block are inconsistent";

fn absent(to: BlockId) -> String {
    format!("the block refers to a node that does not exist in block {}", to.0)
}

fn twice(to: BlockId) -> String {
    format!("the block refers to a node of block {} that another node refers to", to.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(nodes: u32, entries: &[u32], references: &[(u32, u32)]) -> Statements {
        let mut bits = Entries::default();
        entries.iter().for_each(|&node| bits[node as usize / 64] |= 1 << (node % 64));
        let references = references.iter().map(|&(to, node)| Reference::To(BlockId(to), node)).collect();
        Statements { nodes, entries: bits, references }
    }

    fn links() -> Links {
        Links::new(6, |id| id.0 > 0).expect("memory")
    }

    #[test]
    fn blocks_are_checked_in_either_order() {
        for node in [0, 1, 70, 3, 511] {
            let (from, to) = (block(1, &[], &[(2, node)]), block(71, &[0, 3, 70], &[]));
            let is_entry = [0, 3, 70].contains(&node);
            for from_first in [true, false] {
                let links = links();
                let order: [(u32, &Statements); 2] =
                    if from_first { [(0, &from), (2, &to)] } else { [(2, &to), (0, &from)] };
                let found = order.map(|(id, statements)| links.check(BlockId(id), statements).is_ok());
                assert_eq!(found, [true, is_entry], "{node}, {from_first}");
                // Again, as after an eviction.
                assert_eq!(order.map(|(id, statements)| links.check(BlockId(id), statements).is_ok()), found);
            }
        }
        let links = links();
        links.check(BlockId(1), &block(1, &[0], &[(9, 0)])).expect_err("refers to no block");
        links.check(BlockId(3), &block(1, &[0], &[(0, 0)])).expect_err("refers to a block that has no entries");
        links.check(BlockId(4), &block(1, &[0], &[(5, 512)])).expect_err("refers to a node that no block has");
    }

    #[test]
    fn a_node_is_entered_once() {
        let to = block(2, &[0, 1], &[]);
        for read in 0..4 {
            let links = links();
            let checks = |at: u32| {
                if at == read {
                    links.check(BlockId(3), &to).expect("has both nodes");
                }
            };
            checks(0);
            links.check(BlockId(0), &block(1, &[], &[(3, 0)])).expect("the first");
            checks(1);
            links.check(BlockId(1), &block(1, &[0], &[(3, 1)])).expect("another node");
            checks(2);
            links.check(BlockId(2), &block(1, &[0], &[(3, 1)])).expect_err("the same node");
            checks(3);
            links.check(BlockId(2), &block(1, &[0], &[(3, 1)])).expect_err("still the same node");
            links.check(BlockId(1), &block(1, &[0], &[(3, 1)])).expect("the same block again");
            links.check(BlockId(1), &block(1, &[0], &[(3, 0)])).expect_err("the block has changed");
        }
        links().check(BlockId(0), &block(1, &[], &[(3, 1), (3, 1)])).expect_err("twice from one block");
    }

    #[test]
    fn walks_begin_at_nodes_that_exist() {
        let links = links();
        links.expect(BlockId(0), 4).expect("not read yet");
        links.check(BlockId(0), &block(4, &[], &[])).expect_err("has too few");
        links.check(BlockId(1), &block(5, &[], &[])).expect("any block");
        links.expect(BlockId(1), 4).expect("is there");
        links.expect(BlockId(1), 5).expect_err("is not");
        links.expect(BlockId(3), u32::MAX).expect_err("no such number");
        links.expect(BlockId(6), 0).expect_err("no such block");
        links.check(BlockId(9), &block(0, &[], &[])).expect("a block that none refers to");
    }

    #[test]
    fn statements_about_a_block_agree() {
        let links = links();
        let of = |of: u32, number| Statements {
            references: vec![Reference::Agreed(BlockId(of), number)],
            ..Statements::default()
        };
        links.check(BlockId(0), &of(1, 6)).expect("the first");
        links.check(BlockId(2), &of(1, 8)).expect_err("another number");
        links.check(BlockId(1), &of(1, 6)).expect("the same");
        links.check(BlockId(3), &of(6, 6)).expect_err("no such block");
    }
}
