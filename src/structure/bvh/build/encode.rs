//! Encodes a plan: the trace form of its block or its two blocks, with the primitive ids, colours and normals
//! that belong to them.

use super::cluster::Plan;
use super::leaf::LeafShape;
use super::proxies;
use super::refs::Ref;
use super::tree::{InnerNode, Sub};
use crate::lod::{Coded, SIDES_WORDS};
use crate::simd::Portable;
use crate::structure::bake::TreeInput;
use crate::structure::bvh::layout::{
    Child, EXTERNAL_WORDS, HEADER_WORDS, LONG_VOXEL, MAX_TRIANGLES, MAX_VERTICES, NODE_WORDS, Node, PAD_WORDS,
    SHORT_VOXEL, leaf_block_head, put_transmitting,
};
use crate::structure::bvh::leaf::{APART, STEP_BYTES, index_words, put_coordinates};
use crate::structure::bvh::normals::{self, LeafNormals};
use bytemuck::must_cast;
use glam::Vec3;

/// One encoded block.
#[derive(Default)]
pub struct TreeBlock {
    /// The trace form.
    pub words: Vec<u32>,
    /// Primitive id of each triangle of the block.
    pub prims: Vec<u32>,
    /// Colours of the corners of each triangle of the block; empty if the input has none.
    pub colours: Vec<[[u8; 4]; 3]>,
    /// Trace form of the normals; empty if each is that of its triangle.
    pub normals: Vec<u32>,
    /// Local parts of the triangles in and below the block, see [`crate::structure::bake::BakedBlock`].
    pub parts: Vec<u32>,
    /// Blocks of other plans that the block refers to.
    pub below: Vec<u32>,
    /// Runs of nodes that show the same proxy, see [`crate::structure::bake::BakedBlock`].
    pub proxies: Vec<(u16, u32)>,
}

struct Encoder<'a> {
    input: TreeInput<'a>,
    refs: &'a [Ref],
    parts: &'a [u32],
    nodes: Vec<Node>,
    /// Number of each node's first voxel, the voxels, and the sides of voxels that have six.
    firsts: Vec<u32>,
    /// Proxy of each node.
    proxies: Vec<u32>,
    voxels: Vec<[u32; LONG_VOXEL]>,
    sides: Vec<[u32; SIDES_WORDS]>,
    /// Summaries and curtains of the voxels that have curtains.
    curtains: Vec<u32>,
    leaves: Vec<u32>,
    leaves_at: usize,
    externals_at: usize,
    /// Node and slot of each external reference.
    externals: Vec<u32>,
    prims: Vec<u32>,
    colours: Vec<[[u8; 4]; 3]>,
    normals: normals::Encoder,
}

/// Encodes a block; `first_block` is the id of the tree's block 0. Returns the block, and its leaf block if it has one.
pub fn encode(plan: &Plan, first_block: u32, input: TreeInput, refs: &[Ref]) -> (TreeBlock, Option<TreeBlock>) {
    let mut encoder = Encoder {
        input,
        refs,
        parts: &plan.parts,
        nodes: Vec::new(),
        firsts: Vec::new(),
        proxies: Vec::new(),
        voxels: Vec::new(),
        sides: Vec::new(),
        curtains: Vec::new(),
        leaves: Vec::new(),
        leaves_at: 0,
        externals_at: 0,
        externals: Vec::new(),
        prims: Vec::new(),
        colours: Vec::new(),
        normals: normals::Encoder::default(),
    };
    for root in &plan.roots {
        encoder.voxels_of(root);
    }
    let one_part = encoder.one_part();
    let voxel_words = if one_part.is_some() { SHORT_VOXEL } else { LONG_VOXEL };
    let externals_at = HEADER_WORDS + encoder.firsts.len() * NODE_WORDS;
    let parts_at = externals_at + EXTERNAL_WORDS * plan.externals.len();
    let own_parts: &[u32] = if plan.has_leaf_block { &[] } else { &plan.parts };
    let firsts_at = parts_at + own_parts.len();
    let sides_at = firsts_at + encoder.firsts.len() + encoder.voxels.len() * voxel_words;
    let leaves_at = sides_at + encoder.sides.len() * SIDES_WORDS + encoder.curtains.len();
    encoder.externals_at = externals_at;
    encoder.leaves_at = if plan.has_leaf_block { HEADER_WORDS + plan.parts.len() } else { leaves_at };
    for root in &plan.roots {
        encoder.inner(root);
    }
    debug_assert_eq!(encoder.externals.len(), plan.externals.len());
    let mut words = vec![
        encoder.nodes.len() as u32 | (plan.externals.len() as u32) << 16,
        if plan.has_leaf_block { 0 } else { encoder.prims.len() as u32 | (plan.parts.len() as u32) << 16 },
        externals_at as u32,
        parts_at as u32,
        firsts_at as u32,
        encoder.voxels.len() as u32 | (encoder.sides.len() as u32) << 16,
        voxel_words as u32 | (encoder.curtains.len() as u32) << 16,
        one_part.unwrap_or(0),
    ];
    words.resize(HEADER_WORDS, 0);
    for node in &encoder.nodes {
        words.extend(must_cast::<Node, [u32; NODE_WORDS]>(*node));
    }
    let externals = plan.externals.iter().zip(&encoder.externals);
    words.extend(externals.flat_map(|(&(block, child), &place)| [first_block + block, child, place]));
    words.extend(own_parts);
    words.extend(&encoder.firsts);
    words.extend(encoder.voxels.iter().flat_map(|v| &v[..voxel_words]));
    words.extend(encoder.sides.as_flattened());
    words.extend(&encoder.curtains);
    put_transmitting(&mut words);
    let Encoder { leaves, prims, colours, normals, proxies, .. } = encoder;
    let proxies = proxies::runs(&proxies);
    let normals = normals.words();
    let mut below: Vec<u32> = plan.externals.iter().map(|&(block, _)| block).collect();
    below.sort_unstable();
    below.dedup();
    let parts = plan.parts.clone();
    if !plan.has_leaf_block {
        words.extend(&leaves);
        words.extend([0; PAD_WORDS]);
        return (TreeBlock { words, prims, colours, normals, parts, below, proxies }, None);
    }
    words.extend([0; PAD_WORDS]);
    let leaves = leaf_block(&plan.parts, &leaves, prims.len());
    let leaves = TreeBlock { words: leaves, prims, colours, normals, ..TreeBlock::default() };
    (TreeBlock { words, parts, proxies, ..TreeBlock::default() }, Some(leaves))
}

fn leaf_block(parts: &[u32], leaves: &[u32], triangles: usize) -> Vec<u32> {
    let mut words = leaf_block_head(triangles, parts.len()).to_vec();
    words.resize(HEADER_WORDS, 0);
    words.extend(parts);
    words.extend(leaves);
    words.extend([0; PAD_WORDS]);
    words
}

impl Encoder<'_> {
    /// Adds the voxels of a node's children, and of all nodes below it in its block, in the nodes' order.
    fn voxels_of(&mut self, inner: &InnerNode) {
        self.firsts.push(self.voxels.len() as u32);
        for (voxel, _) in &inner.children {
            let Coded { mut words, sides, curtains, .. } = voxel.clone();
            if let Some(sides) = sides {
                words[1] = self.sides.len() as u32;
                self.sides.push(*sides);
            }
            if !curtains.is_empty() {
                let summary = std::mem::replace(&mut words[3], self.curtains.len() as u32);
                self.curtains.push(summary);
                self.curtains.extend(curtains);
            }
            self.voxels.push(words);
        }
        for (_, sub) in &inner.children {
            if let Sub::InnerNode(below) = sub {
                self.voxels_of(below);
            }
        }
    }

    /// Returns the part of all voxels, if each has only this one.
    fn one_part(&self) -> Option<u32> {
        let first = self.voxels.first()?[2];
        let is_plain = !Coded::part(first).1 && !Coded::has_curtains(first);
        (is_plain && self.voxels.iter().all(|v| v[2] == first)).then_some(first)
    }

    /// Adds a node and all nodes below it in its block; returns its index.
    fn inner(&mut self, inner: &InnerNode) -> usize {
        let index = self.nodes.len();
        self.nodes.push(inner.node);
        self.proxies.push(inner.proxy);
        for (slot, (_, sub)) in inner.children.iter().enumerate() {
            let child = match sub {
                Sub::InnerNode(below) => Child::Node(self.inner(below)),
                Sub::Leaf { first, count, .. } => Child::Leaf(self.leaf(*first, *count)),
                Sub::Placed(_) => {
                    let at = self.externals_at + self.externals.len() * EXTERNAL_WORDS;
                    self.externals.push(index as u32 | (slot as u32) << 16);
                    Child::External(at)
                }
            };
            self.nodes[index].child[slot] = child.to_bits();
        }
        index
    }

    /// Adds a leaf; returns the index of its first word.
    fn leaf(&mut self, first: u32, count: u32) -> usize {
        let refs = &self.refs[first as usize..(first + count) as usize];
        let shape = LeafShape::of(refs, self.input);
        let at = self.leaves_at + self.leaves.len();
        let parts: Vec<u32> = shape.triangles[..shape.count].iter().map(|&t| self.part(t)).collect();
        let counts = shape.count as u32 | (shape.vertex_count as u32) << 8 | (self.prims.len() as u32) << 16;
        let (form, bits) = shape.stored();
        self.leaves.extend([counts, parts[0] | u32::from(form.flags) << 16]);
        if shape.mixed {
            let pair = |p: &[u32]| p[0] | p.get(1).copied().unwrap_or(0) << 16;
            self.leaves.extend(parts.chunks(2).map(pair));
        }
        if form.flags & APART == 0 {
            let mut bytes = vec![0u8; 4 * index_words(shape.count)];
            for (t, corners) in shape.corners[..shape.count].iter().enumerate() {
                for (corner, &v) in corners.iter().enumerate() {
                    bytes[corner * shape.count + t] = v;
                }
            }
            self.leaves.extend(bytes.chunks_exact(4).map(|b| u32::from_ne_bytes([b[0], b[1], b[2], b[3]])));
        }
        let own = self.leaves.len();
        self.leaves.resize(own + 3 * MAX_VERTICES + STEP_BYTES / 4, 0);
        let words = put_coordinates(Portable::new(), &mut self.leaves[own..], form, bits.each_ref());
        self.leaves.truncate(own + words);
        if !self.input.normals.is_empty() {
            self.add_normals(&shape);
        }
        for &t in &shape.triangles[..shape.count] {
            self.prims.push(self.input.prims[t as usize]);
            if !self.input.colours.is_empty() {
                self.colours.push(self.input.colours[t as usize]);
            }
        }
        at
    }

    fn add_normals(&mut self, shape: &LeafShape) {
        let triangles = &shape.triangles[..shape.count];
        let (mut corners, mut codes) = ([[Vec3::ZERO; 3]; MAX_TRIANGLES], [[0; 3]; MAX_TRIANGLES]);
        for (i, &t) in triangles.iter().enumerate() {
            (corners[i], codes[i]) = (self.input.triangles[t as usize], self.input.normals[t as usize]);
        }
        self.normals.push(&LeafNormals {
            triangles: &corners[..shape.count],
            codes: &codes[..shape.count],
            corners: &shape.corners[..shape.count],
            vertices: shape.vertex_count,
        });
    }

    /// Returns the index of a triangle's part among the parts of the block.
    fn part(&self, triangle: u32) -> u32 {
        let part = self.input.parts[triangle as usize];
        self.parts.partition_point(|&p| p < part) as u32
    }
}
