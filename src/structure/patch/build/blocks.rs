//! Blocks: frames in the order in which they come fill a fine block and its leaf block; coarse blocks are over these.

use super::cell::Cell;
use super::frame::BuiltFrame;
use super::nodes::Nodes;
use crate::math::Bounds;
use crate::structure::bake::{BakedBlock, Counts};
use crate::structure::patch::layout::{
    Child, GRIDS, HEAD_WORDS, IS_COMPUTED, LONG_VOXEL, MAX_WORDS, MOST_GRIDS, NODE_WORDS, NODES,
};
use std::collections::HashMap;

/// The frames of a fine block.
#[derive(Default)]
pub struct Plan {
    frames: Vec<BuiltFrame>,
    /// The nets of computed grids, by their words, and their words in order.
    nets: HashMap<Vec<u32>, usize>,
    net_words: Vec<u32>,
    /// Words of the leaf block, and of the frames.
    leaf: usize,
    fine: usize,
}

/// Most nodes over a number of items: each node has eight children, or two items or more and nothing else.
const fn most_nodes(items: usize) -> usize {
    items * 4 / 7 + 1
}

impl Plan {
    /// True if a frame fits.
    fn has_room(&self, frame: &BuiltFrame) -> bool {
        let count = self.frames.len() + 1;
        let leaf = 2 + self.leaf + self.net_words.len() + words_of_leaf(frame) + frame.net.as_ref().map_or(0, Vec::len);
        // Nodes have voxels, but frames have none.
        let nodes = most_nodes(count) * (NODE_WORDS + LONG_VOXEL);
        let fine = HEAD_WORDS + nodes + self.fine + frame.words.len();
        count <= MOST_GRIDS && leaf <= MAX_WORDS && fine <= MAX_WORDS
    }
}

/// Words of the leaf block that a frame takes, but for its net.
fn words_of_leaf(frame: &BuiltFrame) -> usize {
    1 + frame.grid.len()
}

impl Plan {
    /// Adds a frame. Its grid refers to its net by the number of words before.
    fn push(&mut self, mut frame: BuiltFrame) {
        self.leaf += words_of_leaf(&frame);
        self.fine += frame.words.len();
        if let Some(net) = frame.net.take() {
            let next = self.net_words.len();
            let at = *self.nets.entry(net).or_insert_with_key(|net| {
                self.net_words.extend(net);
                next
            });
            frame.grid[4] = at as u32;
        }
        self.frames.push(frame);
    }
}

/// Gathers frames into plans.
#[derive(Default)]
pub struct Plans {
    open: Plan,
}

impl Plans {
    /// Adds a frame. Returns a plan that is full, if one is.
    pub fn push(&mut self, frame: BuiltFrame) -> Option<Plan> {
        let full = if self.open.has_room(&frame) { None } else { Some(std::mem::take(&mut self.open)) };
        self.open.push(frame);
        full
    }

    /// The last plan, if it has frames.
    pub fn end(self) -> Option<Plan> {
        (!self.open.frames.is_empty()).then_some(self.open)
    }
}

fn baked(words: &[u32]) -> BakedBlock {
    let payload: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    BakedBlock { trace_bytes: payload.len() as u32, payload, ..BakedBlock::default() }
}

/// Encodes the fine block and the leaf block of a plan. Returns them with the content of the fine block for the coarse
/// blocks, and the counts of its nodes.
pub fn encode(plan: Plan) -> ([BakedBlock; 2], Cell, Counts) {
    let mut frames = plan.frames;
    let cells: Vec<Cell> = frames.iter().map(|frame| frame.cell.clone()).collect();
    let nodes = Nodes::over(&cells);
    let (mut grids, mut normals) = (vec![GRIDS, frames.len() as u32], Vec::new());
    let mut next = 2 + frames.len();
    for (number, frame) in frames.iter_mut().enumerate() {
        frame.words[14] |= (number as u32) << 16;
        frame.grid[3] = normals.len() as u32;
        grids.push(next as u32);
        next += frame.grid.len();
        normals.extend(&frame.normals);
    }
    // Nets follow the grids.
    for frame in frames.iter_mut().filter(|frame| frame.grid[2] & IS_COMPUTED != 0) {
        frame.grid[4] += next as u32;
    }
    frames.iter().for_each(|frame| grids.extend(&frame.grid));
    grids.extend(plan.net_words);
    let mut words = vec![0; HEAD_WORDS];
    // Frames come behind nodes and voxels.
    let mut at = HEAD_WORDS + nodes.words_of_inner();
    let mut firsts = Vec::with_capacity(frames.len());
    for frame in &frames {
        firsts.push(at);
        at += frame.words.len();
    }
    nodes.put(|item| (Child::Frame(firsts[item]), false), &mut words);
    head(&mut words, nodes.count(), frames.len());
    frames.iter().for_each(|frame| words.extend(&frame.words));
    let mut parts: Vec<u32> = frames.iter().map(|frame| frame.part).collect();
    parts.sort_unstable();
    parts.dedup();
    let counts = Counts {
        depth: nodes.depth,
        nodes: nodes.count() as u64,
        leaves: frames.len() as u64,
        references: frames.iter().map(|frame| frame.triangles).sum(),
    };
    let fine = BakedBlock { parts: parts.clone(), ..baked(&words) };
    ([fine, BakedBlock { parts, normals, ..baked(&grids) }], nodes.cell, counts)
}

/// Fills in the head of a block whose nodes and voxels are there.
fn head(words: &mut [u32], nodes: usize, frames: usize) {
    let frames_at = words.len() as u32;
    (words[0], words[1]) = (NODES, nodes as u32 | (frames as u32) << 16);
    (words[2], words[3]) = ((HEAD_WORDS + nodes * NODE_WORDS) as u32, frames_at);
}

/// Most blocks that a coarse block is over.
const BELOW: usize = 256;
const _: () = {
    let nodes = most_nodes(BELOW);
    assert!(HEAD_WORDS + nodes * NODE_WORDS + (nodes - 1 + BELOW) * LONG_VOXEL <= MAX_WORDS);
};

/// The coarse blocks of a tree.
pub struct Upper {
    /// Each with what it is over.
    blocks: Vec<(Nodes, Vec<To>)>,
    /// Bounds of all.
    pub bounds: Bounds,
    /// Nodes on the longest path through coarse blocks, and their number.
    pub depth: u32,
    /// See `depth`.
    pub nodes: u64,
}

/// A block below a coarse block: a coarse one or a fine one, by its number.
#[derive(Clone, Copy)]
enum To {
    Coarse(usize),
    Fine(usize),
}

impl Upper {
    /// The coarse blocks over fine blocks, at least one, whose contents are given in order.
    pub fn over(fine: Vec<Cell>) -> Self {
        // From the lowest level up, neighbours together.
        let mut level: Vec<(Cell, To)> = fine.into_iter().enumerate().map(|(i, cell)| (cell, To::Fine(i))).collect();
        let mut levels: Vec<Vec<(Nodes, Vec<To>)>> = Vec::new();
        let mut depth = 0;
        loop {
            let blocks: Vec<(Nodes, Vec<To>)> = level.chunks(BELOW).map(of_chunk).collect();
            depth += blocks.iter().map(|it| it.0.depth).max().unwrap_or(0);
            level = blocks.iter().enumerate().map(|(i, it)| (it.0.cell.clone(), To::Coarse(i))).collect();
            levels.push(blocks);
            if level.len() == 1 {
                break;
            }
        }
        // The root comes first, then level by level: a block refers to later ones only.
        let mut blocks: Vec<(Nodes, Vec<To>)> = Vec::new();
        for level in levels.into_iter().rev() {
            let first_below = blocks.len() + level.len();
            blocks.extend(level.into_iter().map(|(nodes, below)| {
                let below = below.into_iter().map(|to| match to {
                    To::Coarse(i) => To::Coarse(first_below + i),
                    fine => fine,
                });
                (nodes, below.collect())
            }));
        }
        let bounds = blocks[0].0.cell.bounds;
        let nodes = blocks.iter().map(|it| it.0.count() as u64).sum();
        Self { blocks, bounds, depth, nodes }
    }

    /// Number of coarse blocks.
    pub fn count(&self) -> usize {
        self.blocks.len()
    }

    /// Encodes a coarse block; `first_block` is the id of the tree's first block.
    pub fn encode(&self, index: usize, first_block: u32) -> BakedBlock {
        let (nodes, below) = &self.blocks[index];
        let local = |item: usize| match below[item] {
            To::Coarse(i) => i as u32,
            To::Fine(i) => (self.blocks.len() + i) as u32,
        };
        let mut words = vec![0; HEAD_WORDS];
        nodes.put(|item| (Child::Block(first_block + local(item)), true), &mut words);
        head(&mut words, nodes.count(), 0);
        BakedBlock { below: (0..below.len()).map(local).collect(), ..baked(&words) }
    }
}

fn of_chunk(chunk: &[(Cell, To)]) -> (Nodes, Vec<To>) {
    let cells: Vec<Cell> = chunk.iter().map(|it| it.0.clone()).collect();
    (Nodes::over(&cells), chunk.iter().map(|it| it.1).collect())
}
