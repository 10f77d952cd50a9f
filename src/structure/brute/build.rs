//! Builds blocks from triangles.
//!
//! The set of triangles is halved at the median of its centres along their longest axis, until each part fits a list.
//! The rows of index blocks have the order of the halves, so that neighbouring lists share an index block.

use super::layout::{CLASSES, INDEX, LIST, ROW_WORDS, ROWS, TRIANGLES, stored_oriented_slabs};
use crate::base::error::{Error, Result};
use crate::base::progress::Stretch;
use crate::lod::{Coded, Content, Facet, Fill, Middle, OrientedSlabs, SIDES_WORDS, Voxel};
use crate::math::Bounds;
use crate::structure::bake::{BakedBlock, Baker, BuiltChunk, Counts, TreeInput, TreeOptions};
use crate::structure::par::Par;
use glam::Vec3;

/// Makes the blocks of a `brute`.
pub struct BruteBaker;

/// Some of a mesh's triangles, divided into lists.
pub struct Chunk<'a> {
    input: TreeInput<'a>,
    lists: Vec<Vec<u32>>,
}

/// The content of a row: the box, the voxel and the slabs of a block below.
#[derive(Clone)]
pub struct Cell {
    bounds: Bounds,
    voxel: Voxel,
    coded: Coded,
    slabs: OrientedSlabs<f32>,
    fill: Fill,
}

/// The cells of lists, and the number of their triangles.
pub struct Top {
    lists: Vec<Cell>,
    triangles: u64,
}

/// The rows of all index blocks.
pub struct UpperTree {
    lists: Vec<Cell>,
    /// Cells of the index blocks below the first; empty if the first holds all lists.
    groups: Vec<Cell>,
    counts: Counts,
}

/// Greatest number of lists of a tree.
const MOST: usize = ROWS * ROWS;

impl Cell {
    fn new(bounds: Bounds, voxel: Voxel, content: &Content) -> Self {
        let coded = Coded::of(&voxel, &Middle::of(&bounds), content, true);
        let slabs = stored_oriented_slabs(coded.slabs, coded.words[0], &bounds);
        Self { bounds, voxel, coded, slabs, fill: Fill::of(content, &bounds) }
    }

    fn of_list(input: TreeInput, list: &[u32]) -> Self {
        let corners = || list.iter().map(|&i| input.triangles[i as usize]);
        let points: Vec<Vec3> = corners().flatten().collect();
        let bounds = Bounds::of(&points);
        let facet = |&i: &u32| {
            let [a, b, c] = input.triangles[i as usize];
            let (colour, is_own_colour) = input.colour(i as usize);
            Facet { normal: (b - a).cross(c - a), colour, part: input.parts[i as usize], is_own_colour }
        };
        let voxel = Voxel::of_leaf(&bounds, &list.iter().map(facet).collect::<Vec<_>>());
        let places = (0..list.len() as u16).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Self::new(bounds, voxel, &Content::of_triangles(points, places))
    }

    /// Combines the cells of an index block.
    fn over(cells: &[Self]) -> Self {
        let mut voxels: Vec<(Bounds, Voxel)> = cells.iter().map(|cell| (cell.bounds, cell.voxel)).collect();
        // A voxel combines at most eight others.
        while voxels.len() > 1 {
            let over = |some: &[(Bounds, Voxel)]| {
                let bounds = some.iter().fold(Bounds::EMPTY, |all, one| all.union(one.0));
                (bounds, Voxel::over(some.iter().map(|(b, v)| (b, v))))
            };
            voxels = voxels.chunks(8).map(over).collect();
        }
        let (bounds, voxel) = voxels[0];
        let pieces = cells.iter().map(|cell| (cell.bounds, cell.slabs, cell.fill)).collect();
        Self::new(bounds, voxel, &Content::of_cells(pieces))
    }

    fn row(&self, block: u32, kind: u32) -> [u32; ROW_WORDS] {
        let Bounds { min, max } = self.bounds;
        let bounds = [min.x, min.y, min.z, max.x, max.y, max.z].map(f32::to_bits);
        let sides = self.coded.sides.as_deref().unwrap_or(&[0; SIDES_WORDS]);
        let words = [block, kind].into_iter().chain(bounds).chain([self.coded.slabs]).chain(self.coded.words);
        let mut row = [0; ROW_WORDS];
        row.iter_mut().zip(words.chain(*sides)).for_each(|(to, word)| *to = word);
        row
    }
}

/// Halves a set until each part fits a list.
fn halve(input: TreeInput, mut set: Vec<u32>, lists: &mut Vec<Vec<u32>>) {
    if set.len() <= TRIANGLES {
        // The input is in the order of the primitive ids.
        set.sort_unstable();
        return lists.push(set);
    }
    let center = |i: u32| Bounds::of(&input.triangles[i as usize]).center();
    let all = set.iter().fold(Bounds::EMPTY, |all, &i| all.with(center(i)));
    let axis = all.extent().max_position();
    let half = set.len() / 2;
    set.select_nth_unstable_by(half, |&a, &b| center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(&b)));
    let rest = set.split_off(half);
    halve(input, set, lists);
    halve(input, rest, lists);
}

fn too_many() -> Error {
    Error::BadArgument(format!(
        "too many triangles: the structure brute holds at most {MOST} lists of {TRIANGLES} triangles"
    ))
}

fn block(kind: u32, count: usize, words: impl IntoIterator<Item = u32>) -> BakedBlock {
    let words = [kind, count as u32].into_iter().chain(words);
    let payload: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
    BakedBlock { trace_bytes: payload.len() as u32, payload, ..BakedBlock::default() }
}

impl Baker for BruteBaker {
    const CLASSES: usize = CLASSES;
    const LEAF_TRIANGLES: u32 = TRIANGLES as u32;
    type Chunk<'a> = Chunk<'a>;
    type Plan = usize;
    type Top = Top;
    type UpperTree = UpperTree;

    fn splits_pay(_: &[[Vec3; 3]]) -> bool {
        false
    }

    fn build<'a>(
        input: TreeInput<'a>,
        _: &TreeOptions,
        _: bool,
        par: &Par,
        stretch: &Stretch,
    ) -> Result<BuiltChunk<Chunk<'a>, Top>> {
        let triangles = input.triangles.len() as u64;
        if triangles > (MOST * TRIANGLES) as u64 {
            return Err(too_many());
        }
        let mut lists = Vec::new();
        halve(input, (0..triangles as u32).collect(), &mut lists);
        stretch.check()?;
        let cells = par.map(lists.len(), |i| Cell::of_list(input, &lists[i]));
        let bounds = cells.iter().fold(Bounds::EMPTY, |all, cell| all.union(cell.bounds));
        let counts = Counts { depth: 2, nodes: 1, leaves: lists.len() as u64, references: triangles };
        Ok(BuiltChunk {
            chunk: Chunk { input, lists },
            top: Some(Top { lists: cells, triangles }),
            bounds,
            counts,
            proxies: Vec::new(),
        })
    }

    fn take_plans(chunk: &mut Chunk<'_>) -> Vec<usize> {
        (0..chunk.lists.len()).collect()
    }

    fn encode(chunk: &Chunk<'_>, plan: usize) -> Vec<BakedBlock> {
        let (list, input) = (&chunk.lists[plan], chunk.input);
        let words = |&i: &u32| {
            let corners = input.triangles[i as usize].into_iter().flat_map(|v| v.to_array().map(f32::to_bits));
            corners.chain([input.parts[i as usize]])
        };
        let prims = list.iter().map(|&i| input.prims[i as usize]).collect();
        let colours = list.iter().filter_map(|&i| input.colours.get(i as usize).copied()).collect();
        let normals = list.iter().filter_map(|&i| input.normals.get(i as usize)).flatten().copied().collect();
        vec![BakedBlock { prims, colours, normals, ..block(LIST, list.len(), list.iter().flat_map(words)) }]
    }

    fn join(tops: Vec<Top>) -> Result<UpperTree> {
        let triangles = tops.iter().map(|top| top.triangles).sum();
        let lists: Vec<Cell> = tops.into_iter().flat_map(|top| top.lists).collect();
        if lists.len() > MOST {
            return Err(too_many());
        }
        let groups: Vec<Cell> =
            if lists.len() > ROWS { lists.chunks(ROWS).map(Cell::over).collect() } else { Vec::new() };
        let depth = if groups.is_empty() { 2 } else { 3 };
        let counts =
            Counts { depth, nodes: 1 + groups.len() as u64, leaves: lists.len() as u64, references: triangles };
        Ok(UpperTree { lists, groups, counts })
    }

    fn coarse_blocks(upper_tree: &UpperTree) -> usize {
        1 + upper_tree.groups.len()
    }

    fn encode_coarse(upper_tree: &UpperTree, index: usize, first_block: u32) -> BakedBlock {
        let lists_at = first_block + Self::coarse_blocks(upper_tree) as u32;
        // Index of the first row among all lists or all groups.
        let (cells, from, at, kind) = match index.checked_sub(1) {
            None if !upper_tree.groups.is_empty() => (&upper_tree.groups[..], 0, first_block + 1, INDEX),
            group => {
                let from = ROWS * group.unwrap_or(0);
                (&upper_tree.lists[from..upper_tree.lists.len().min(from + ROWS)], from, lists_at, LIST)
            }
        };
        let rows = cells.iter().zip(at + from as u32..).map(|(cell, below)| cell.row(below, kind));
        block(INDEX, cells.len(), rows.flatten())
    }

    fn counts(upper_tree: &UpperTree) -> Counts {
        upper_tree.counts
    }

    fn max_stack(depth: u32) -> u32 {
        // The last level consists of lists.
        ROWS as u32 * (depth - 1)
    }

    fn root() -> u32 {
        INDEX
    }
}
