//! Walks of programs of their own: the nodes of a model's trees, one at a time, in any order.
//!
//! Kim, Moon, Kim, Yoon, "RACBVHs: Random-Accessible Compressed Bounding Volume Hierarchies", TVCG 2010, section 5.1,
//! has such an interface: roots, children, boxes and triangles of nodes, by numbers that hold for the file. Here one
//! call returns a node with the boxes of all its children, so that a descent needs a call for each node that it enters,
//! and not one for each child.

use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::inside_read::refuse_inside_read;
use crate::base::progress::Cancel;
use crate::residency::{Kept, OwnBlocks};
use crate::scene::Model;
use crate::structure::nodes::{NO_NODE, Node, Starts};
use crate::structure::{LeafTriangle, Nodes, Place};
use bytemuck::Zeroable;
use glam::{DAffine3, DVec3};
use std::ops::Range;

/// Bytes of blocks that a cursor may read and hold, by default.
pub const CURSOR_BYTES: u64 = 4 << 20;

/// Options of a cursor.
#[derive(Debug, Clone, Copy, Default)]
pub struct CursorOptions {
    /// The cursor never reads. What is not in memory is [`Found::Missing`].
    pub now: bool,
    /// Bytes of blocks that it reads and holds by itself, of the budget of the context; 0: [`CURSOR_BYTES`]. Not used
    /// with `now`.
    pub bytes: u64,
}

/// The answer to a question to a cursor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Found<T> {
    /// What was asked for.
    There(T),
    /// The block is not in memory, and the cursor may not read it.
    Missing(BlockId),
}

/// A place of a tree in its model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TreePlace {
    /// From the coordinates of boxes and corners to those of the model.
    pub model_from_tree: DAffine3,
    /// Id of the tree's root.
    pub root: u64,
    /// Index of the tree.
    pub tree: u32,
    /// Index in [`Model::parts`] of the tree's local part 0.
    pub first_part: u32,
}

/// A triangle of a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct NodeTriangle {
    /// Its corners, in the coordinates of the tree's mesh.
    pub corners: [DVec3; 3],
    /// Primitive id; `u64::MAX` if it was not asked for.
    pub prim: u64,
    /// The tree's local part.
    pub part: u32,
    /// Index of the tree.
    pub tree: u32,
}

/// Reads nodes of the trees of a model by their ids. An id is a number that holds for the file. Blocks in memory are
/// used where they are, without a lock, and are not kept there; the cursor reads the others into memory of its own.
pub struct Cursor {
    model: Model,
    own: Option<OwnBlocks>,
    known: Starts,
    node: Box<Node>,
    triangles: Vec<NodeTriangle>,
    /// Blocks of the tree that was used last.
    blocks: Range<u32>,
    nodes: Option<Nodes>,
    _memory: Kept,
}

impl Model {
    /// Makes a cursor, which keeps the model. Fails with `BadArgument` if it may hold too few bytes to read any block,
    /// with `OverBudget` if the context has less, and with `NoMemory`.
    pub fn cursor(&self, options: CursorOptions) -> Result<Cursor> {
        let residency = self.context().residency();
        let own = if options.now {
            None
        } else {
            refuse_inside_read()?;
            let least = OwnBlocks::least(self.blocks());
            let bytes = if options.bytes == 0 { CURSOR_BYTES.max(least) } else { options.bytes };
            if bytes < least {
                return Err(Error::bad_argument(format!(
                    "a cursor of {bytes} bytes cannot hold a block of this model; it needs at least {least}"
                )));
            }
            Some(OwnBlocks::new(residency, "the blocks of a cursor", bytes)?)
        };
        let memory = residency.keep_all("what a cursor knows of leaves", Starts::BYTES)?;
        Ok(Cursor {
            model: self.clone(),
            own,
            known: Starts::new()?,
            node: Box::new(Node::zeroed()),
            triangles: Vec::new(),
            blocks: 0..0,
            nodes: None,
            _memory: memory,
        })
    }
}

impl Cursor {
    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Returns the id of the root of a tree, below [`crate::scene::ModelInfo::trees`]; `None` for a tree without
    /// triangles. Tree 0 has the triangles that are placed directly. Fails with `BadArgument` if there is no such tree.
    pub fn root(&self, tree: u32) -> Result<Option<u64>> {
        let trees = self.model.trees();
        let Some(tree) = trees.get(tree as usize) else {
            return Err(Error::bad_argument(format!("tree {tree} does not exist: the model has {}", trees.len())));
        };
        Ok(tree.root().map(Place::id))
    }

    /// The places of all trees with triangles in the model. A tree of a shared mesh has several, or none.
    pub fn places(&self) -> impl Iterator<Item = TreePlace> {
        self.model.placements().map(|(tree, first_part, model_from_tree)| {
            let root = self.model.trees()[tree as usize].root().map_or(NO_NODE, Place::id);
            TreePlace { model_from_tree, root, tree, first_part }
        })
    }

    /// Returns a node, with the boxes of its children, or of the triangles of a leaf. Fails with `BadArgument` if no
    /// node has the id, and with `Io`, `Corrupt`, or, if a source's read function calls it and a block must be read,
    /// `BadState`.
    pub fn node(&mut self, id: u64) -> Result<Found<&Node>> {
        let place = Place::of_id(id);
        let nodes = self.nodes_of(place.block, id)?;
        let node = &mut *self.node;
        let words = Words { model: &self.model, own: &mut self.own, known: &mut self.known };
        match words.with(place.block, |words, known| nodes.node(words, place, known, node))? {
            Found::There(true) => Ok(Found::There(&self.node)),
            Found::There(false) => Err(foreign(id, "its block has no such node")),
            Found::Missing(block) => Ok(Found::Missing(block)),
        }
    }

    /// Returns the triangles of a leaf, with their primitive ids if `prims`: these are in a block of their own. Fails
    /// like [`Cursor::node`], also if the node is not a leaf.
    pub fn triangles(&mut self, id: u64, prims: bool) -> Result<Found<&[NodeTriangle]>> {
        let place = Place::of_id(id);
        let nodes = self.nodes_of(place.block, id)?;
        let all = &mut self.triangles;
        all.clear();
        let mut first = 0;
        let mut words = Words { model: &self.model, own: &mut self.own, known: &mut self.known };
        let found = words.again().with(place.block, |words, known| {
            nodes.triangles(words, place, known, &mut |LeafTriangle { corners, part, number }| {
                if all.is_empty() {
                    first = number;
                }
                all.push(NodeTriangle { corners, prim: NO_NODE, part, tree: nodes.tree() });
            })
        })?;
        match found {
            Found::There(true) if prims => {
                let block = self.model.blocks().file().prim_block(BlockId(place.block));
                // The triangles of a leaf follow one another, as do their ids. Only a corrupt file has fewer ids.
                let found = words.with(block.0, |words, _| {
                    for (triangle, prim) in all.iter_mut().zip(words.iter().skip(first as usize)) {
                        triangle.prim = if *prim == u32::MAX { NO_NODE } else { u64::from(*prim) };
                    }
                })?;
                if let Found::Missing(block) = found {
                    return Ok(Found::Missing(block));
                }
            }
            Found::There(true) => {}
            Found::There(false) => return Err(foreign(id, "its block has no such leaf")),
            Found::Missing(block) => return Ok(Found::Missing(block)),
        }
        Ok(Found::There(&self.triangles))
    }

    /// Returns the ids of all nodes of a block, below [`crate::scene::ModelInfo::geometry_blocks`]. Each node is in one
    /// block. Fails like [`Cursor::node`].
    pub fn block_nodes(&mut self, block: u32) -> Result<Found<Vec<u64>>> {
        let Some(nodes) = self.find(block) else {
            let count = self.model.info().geometry_blocks;
            return Err(Error::bad_argument(format!("block {block} does not exist: the model has {count}")));
        };
        let words = Words { model: &self.model, own: &mut self.own, known: &mut self.known };
        words.with(block, |words, _| nodes.all(words, block).into_iter().map(Place::id).collect())
    }

    /// Finds the tree of a block.
    #[inline]
    fn nodes_of(&mut self, block: u32, id: u64) -> Result<Nodes> {
        match &self.nodes {
            Some(nodes) if self.blocks.contains(&block) => Ok(*nodes),
            _ => self.find(block).ok_or_else(|| foreign(id, "the model has no such block")),
        }
    }

    #[cold]
    fn find(&mut self, block: u32) -> Option<Nodes> {
        let rows = self.model.blocks().file().trees();
        // Trees without blocks lie between others: the last one that begins at the block or before it has it.
        let index = rows.partition_point(|row| row.first_block <= block).checked_sub(1)?;
        let index = (0..=index).rev().find(|i| rows[*i].block_count > 0)?;
        let row = &rows[index];
        self.blocks = row.first_block..row.first_block + row.block_count;
        self.nodes = self.model.trees().get(index).map(|tree| tree.nodes());
        self.nodes.filter(|_| self.blocks.contains(&block))
    }
}

/// The words of blocks, in memory or of the cursor's own.
struct Words<'a> {
    model: &'a Model,
    own: &'a mut Option<OwnBlocks>,
    known: &'a mut Starts,
}

impl Words<'_> {
    fn again(&mut self) -> Words<'_> {
        Words { model: self.model, own: self.own, known: self.known }
    }

    #[inline]
    fn with<T>(self, block: u32, see: impl FnOnce(&[u32], &mut Starts) -> T) -> Result<Found<T>> {
        let (block, blocks) = (BlockId(block), self.model.blocks());
        // The table of blocks is held for this call only: what it holds cannot be evicted.
        let there = blocks.shown();
        if let Some(words) = there.block(block) {
            return Ok(Found::There(see(words, self.known)));
        }
        drop(there);
        let Some(own) = self.own else { return Ok(Found::Missing(block)) };
        if let Some(words) = own.block(block) {
            return Ok(Found::There(see(words, self.known)));
        }
        refuse_inside_read()?;
        let words = own.read(blocks, block, &Cancel::new())?;
        Ok(Found::There(see(words, self.known)))
    }
}

#[cold]
fn foreign(id: u64, why: &str) -> Error {
    Error::bad_argument(format!("{id:#x} is not the id of a node of this model: {why}"))
}
