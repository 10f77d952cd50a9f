//! From a plan to the trace form of its block, with the primitive ids and colours beside it.

use super::TreeInput;
use super::cluster::Plan;
use super::leaf::LeafShape;
use super::refs::Ref;
use super::tree::{Inner, Sub};
use crate::math::Bounds;
use crate::structure::bvh::layout::{
    Child, HEADER_WORDS, LEAF_MIXED, NODE_WORDS, Node, PAD_WORDS, WIDTH, index_words,
};
use bytemuck::must_cast;

/// One encoded block.
pub struct TreeBlock {
    /// The trace form.
    pub words: Vec<u32>,
    /// Primitive id of each triangle of the block.
    pub prims: Vec<u32>,
    /// Colour of each triangle of the block; empty if the input has none.
    pub colours: Vec<[u8; 4]>,
}

struct Encoder<'a> {
    input: TreeInput<'a>,
    refs: &'a [Ref],
    parts: &'a [u32],
    nodes: Vec<Node>,
    leaves: Vec<u32>,
    leaves_at: usize,
    externals: usize,
    prims: Vec<u32>,
    colours: Vec<[u8; 4]>,
}

/// Encodes block `index` of `plans`, whose block 0 has the id `first_block`.
pub fn encode(plans: &[Plan], index: usize, first_block: u32, input: TreeInput, refs: &[Ref]) -> TreeBlock {
    let plan = &plans[index];
    let nodes = plan.roots.iter().map(|r| r.nodes() as usize).sum();
    let externals_at = HEADER_WORDS + nodes * NODE_WORDS;
    let parts_at = externals_at + 2 * plan.externals.len();
    let mut encoder = Encoder {
        input,
        refs,
        parts: &plan.parts,
        nodes: Vec::with_capacity(nodes),
        leaves: Vec::new(),
        leaves_at: parts_at + plan.parts.len(),
        externals: 0,
        prims: Vec::new(),
        colours: Vec::new(),
    };
    for root in &plan.roots {
        encoder.inner(root);
    }
    debug_assert_eq!(encoder.externals, plan.externals.len());
    let mut words = vec![
        nodes as u32 | (plan.externals.len() as u32) << 16,
        encoder.prims.len() as u32 | (plan.parts.len() as u32) << 16,
        externals_at as u32,
        parts_at as u32,
    ];
    for node in &encoder.nodes {
        words.extend(must_cast::<Node, [u32; NODE_WORDS]>(*node));
    }
    words.extend(plan.externals.iter().flat_map(|&(block, child)| [first_block + block, child]));
    words.extend(&plan.parts);
    words.extend(&encoder.leaves);
    words.extend([0; PAD_WORDS]);
    TreeBlock { words, prims: encoder.prims, colours: encoder.colours }
}

impl Encoder<'_> {
    /// Adds a node and all below it in its block; returns its index.
    fn inner(&mut self, inner: &Inner) -> usize {
        let index = self.nodes.len();
        self.nodes.push(quantise(inner));
        for (slot, (_, sub)) in inner.children.iter().enumerate() {
            let child = match sub {
                Sub::Inner(below) => Child::Node(self.inner(below)),
                Sub::Leaf { first, count, .. } => Child::Leaf(self.leaf(*first, *count)),
                Sub::Placed(_) => {
                    self.externals += 1;
                    Child::External(self.externals - 1)
                }
            };
            self.nodes[index].child[slot] = child.to_bits();
        }
        index
    }

    /// Adds a leaf; returns its first word.
    fn leaf(&mut self, first: u32, count: u32) -> usize {
        let refs = &self.refs[first as usize..(first + count) as usize];
        let shape = LeafShape::of(refs, self.input);
        let at = self.leaves_at + self.leaves.len();
        let parts: Vec<u32> = shape.triangles[..shape.count].iter().map(|&t| self.part(t)).collect();
        let counts = shape.count as u32 | (shape.vertex_count as u32) << 8 | (self.prims.len() as u32) << 16;
        let flags = if shape.mixed { LEAF_MIXED } else { 0 };
        self.leaves.extend([counts, parts[0] | u32::from(flags) << 16]);
        if shape.mixed {
            let pair = |p: &[u32]| p[0] | p.get(1).copied().unwrap_or(0) << 16;
            self.leaves.extend(parts.chunks(2).map(pair));
        }
        let mut bytes = vec![0u8; 4 * index_words(shape.count)];
        for (t, corners) in shape.corners[..shape.count].iter().enumerate() {
            for (corner, &v) in corners.iter().enumerate() {
                bytes[corner * shape.count + t] = v;
            }
        }
        let word = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        self.leaves.extend(bytes.chunks_exact(4).map(word));
        for axis in &shape.vertices {
            self.leaves.extend(axis[..shape.vertex_count].iter().map(|x| x.to_bits()));
        }
        for &t in &shape.triangles[..shape.count] {
            self.prims.push(self.input.prims[t as usize]);
            if !self.input.colours.is_empty() {
                self.colours.push(self.input.colours[t as usize]);
            }
        }
        at
    }

    /// Index among the block's parts of a triangle's part.
    fn part(&self, triangle: u32) -> u32 {
        let part = self.input.parts[triangle as usize];
        self.parts.partition_point(|&p| p < part) as u32
    }
}

/// A node with its children's boxes on its grid, rounded outward.
fn quantise(inner: &Inner) -> Node {
    let all = inner.children.iter().fold(Bounds::EMPTY, |b, (c, _)| b.union(*c));
    let mut node = Node {
        origin: all.min.to_array(),
        exponent: [1; 3],
        valid: ((1u32 << inner.children.len()) - 1) as u8,
        planes: [[0; WIDTH]; 6],
        child: [0; WIDTH],
    };
    for axis in 0..3 {
        node.exponent[axis] = exponent(f64::from(all.max[axis]) - f64::from(all.min[axis]));
        let step = f64::from(node.step(axis));
        let origin = f64::from(all.min[axis]);
        for (slot, (bounds, _)) in inner.children.iter().enumerate() {
            // Differences of coordinates that are 2^53 apart are rounded: one step outward mends that.
            let mut low = ((f64::from(bounds.min[axis]) - origin) / step).floor();
            let mut high = ((f64::from(bounds.max[axis]) - origin) / step).ceil();
            if origin + low * step > f64::from(bounds.min[axis]) {
                low -= 1.0;
            }
            if origin + high * step < f64::from(bounds.max[axis]) {
                high += 1.0;
            }
            node.planes[axis][slot] = low.clamp(0.0, 255.0) as u8;
            node.planes[axis + 3][slot] = high.clamp(0.0, 255.0) as u8;
        }
    }
    // Empty slots are masked by `valid`; an inverted box keeps them out of most tests besides.
    for slot in inner.children.len()..WIDTH {
        for axis in 0..3 {
            node.planes[axis][slot] = 255;
        }
    }
    node
}

/// Biased exponent of the least power of two with 255 steps of which `extent` can be covered.
fn exponent(extent: f64) -> u8 {
    // A hair more, for the step outward that `quantise` may take.
    let extent = extent * (1.0 + 1e-12);
    let least = (extent / 255.0).max(f64::from(f32::MIN_POSITIVE));
    let mut e = least.log2().ceil() as i32;
    while 255.0 * f64::from(e).exp2() < extent {
        e += 1;
    }
    (e + 127).clamp(1, 254) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3> {
        let c = prop_oneof![-1e6f32..1e6, -1.0f32..1.0, Just(0.0f32), -1e-30f32..1e-30, -1e30f32..1e30];
        [c.clone(), c.clone(), c].prop_map(Vec3::from_array)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn stored_boxes_are_rounded_outward(corners in prop::collection::vec((point(), point()), 1..=8)) {
            let leaf = || Sub::Leaf { first: 0, count: 1, words: 1 };
            let children: Vec<_> = corners.iter().map(|(a, b)| (Bounds::of(&[*a, *b]), leaf())).collect();
            let node = quantise(&Inner { children, words: 0 });
            for (slot, (a, b)) in corners.iter().enumerate() {
                let bounds = Bounds::of(&[*a, *b]);
                for axis in 0..3 {
                    let at = |q: u8| f64::from(node.origin[axis]) + f64::from(q) * f64::from(node.step(axis));
                    prop_assert!(at(node.planes[axis][slot]) <= f64::from(bounds.min[axis]));
                    prop_assert!(f64::from(bounds.max[axis]) <= at(node.planes[axis + 3][slot]));
                }
                prop_assert!(node.child_box(slot).contains(&bounds));
            }
        }
    }
}
