//! Blocks: the frames of a plan are a fine block and its leaf block; coarse blocks are over these.

use super::cell::Cell;
use super::nodes::{Nodes, most_nodes};
use super::pack::{Item, pack};
use super::plans::{Plan, SPARE};
use crate::math::Bounds;
use crate::structure::bake::{BakedBlock, Counts};
use crate::structure::patch::layout::{
    Child, GRIDS, HEAD_WORDS, IS_COMPUTED, LONG_VOXEL, MAX_WORDS, NODE_WORDS, NODES,
};

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
        // From the lowest level up.
        let mut level: Vec<(Cell, To)> = fine.into_iter().enumerate().map(|(i, cell)| (cell, To::Fine(i))).collect();
        let mut levels: Vec<Vec<(Nodes, Vec<To>)>> = Vec::new();
        let mut depth = 0;
        loop {
            let blocks = over_groups(&level);
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

/// Coarse blocks over groups of neighbours.
fn over_groups(level: &[(Cell, To)]) -> Vec<(Nodes, Vec<To>)> {
    let item =
        |(index, (cell, _)): (usize, &(Cell, To))| Item { bounds: cell.bounds, load: [1, 0], index: index as u32 };
    let mut items: Vec<Item> = level.iter().enumerate().map(item).collect();
    let groups = pack(&mut items, [BELOW as u32, 1], SPARE);
    let of_group = |group: std::ops::Range<usize>| {
        let below = items[group].iter().map(|item| &level[item.index as usize]);
        let (cells, to): (Vec<Cell>, Vec<To>) = below.map(|(cell, to)| (cell.clone(), *to)).unzip();
        (Nodes::over(&cells), to)
    };
    groups.into_iter().map(of_group).collect()
}
