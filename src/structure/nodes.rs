//! Nodes of trees for programs that walk them by themselves. A node is found by its place alone, in the words of its
//! block. A place from outside may be any number, so it is checked at each step.
//!
//! The boxes are in double precision, in the coordinates of the tree's mesh, and rounded outward. The box of a child
//! holds the triangles below it; of triangles that the build divided, the pieces below.

#[cfg(any(test, feature = "brute"))]
use super::brute;
use super::bvh;
use super::hit::Triangle;
use super::place::Place;
use crate::base::error::Result;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// Greatest number of children of a node.
pub const CHILDREN: usize = 8;
/// Id of no node.
pub const NO_NODE: u64 = u64::MAX;
/// Index of no part.
pub const NO_PART: u32 = u32::MAX;

/// Least x, y, z and greatest x, y, z.
pub type NodeBox = [f64; 6];

/// The box of nothing.
pub const EMPTY_BOX: NodeBox =
    [f64::INFINITY, f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];

/// A node of a tree: a leaf, or the node's children.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Node {
    /// 0. It fills the struct.
    pub reserved: u32,
    /// Index of the tree.
    pub tree: u32,
    /// Number of children; 0 for a leaf.
    pub children: u32,
    /// Number of triangles of a leaf; 0 for other nodes.
    pub triangles: u32,
    /// Bit `i`: child `i` is a leaf.
    pub leaves: u32,
    /// The tree's local part of all triangles below; [`NO_PART`] if there are several, or if the file does not say.
    pub part: u32,
    /// Box around the children's boxes, or around all corners of a leaf.
    pub bounds: NodeBox,
    /// Ids of the children; [`NO_NODE`] behind the last.
    pub child: [u64; CHILDREN],
    /// Boxes of the children; zeros behind the last.
    pub child_bounds: [NodeBox; CHILDREN],
}

impl Place {
    /// The id of a node: a number that holds for the file.
    #[inline(always)]
    pub fn id(self) -> u64 {
        u64::from(self.block) << 32 | u64::from(self.item)
    }

    /// The place with this id, which may be any number.
    #[inline(always)]
    pub fn of_id(id: u64) -> Self {
        Self { block: (id >> 32) as u32, item: id as u32 }
    }
}

impl Node {
    /// Begins a node without children.
    #[inline(always)]
    pub(super) fn begin(&mut self, triangles: u32) {
        (self.children, self.triangles, self.leaves, self.part) = (0, triangles, 0, NO_PART);
        self.bounds = EMPTY_BOX;
    }

    /// Adds a child and its box.
    #[inline(always)]
    pub(super) fn push(&mut self, place: Place, is_leaf: bool, bounds: &NodeBox) {
        let i = self.children as usize & (CHILDREN - 1);
        self.child[i] = place.id();
        self.leaves |= u32::from(is_leaf) << i;
        self.child_bounds[i] = *bounds;
        self.grow(bounds);
        self.children += 1;
    }

    /// Ends a node: clears the places of children that it does not have.
    #[inline(always)]
    pub(super) fn end(&mut self) {
        for i in self.children as usize..CHILDREN {
            (self.child[i], self.child_bounds[i]) = (NO_NODE, [0.0; 6]);
        }
    }

    /// Makes a leaf of triangles.
    pub(super) fn of_triangles(&mut self, triangles: impl Iterator<Item = Triangle>, origin: &[f64; 3]) {
        self.begin(0);
        let mut all = crate::math::Bounds::EMPTY;
        for triangle in triangles {
            self.part = if self.triangles == 0 || self.part == triangle.part { triangle.part } else { NO_PART };
            self.triangles += 1;
            all = triangle.vertices.into_iter().fold(all, |all, corner| all.with(corner));
        }
        self.bounds = outward(origin, all.min, all.max);
        self.end();
    }

    #[inline(always)]
    fn grow(&mut self, bounds: &NodeBox) {
        for axis in 0..3 {
            self.bounds[axis] = self.bounds[axis].min(bounds[axis]);
            self.bounds[axis + 3] = self.bounds[axis + 3].max(bounds[axis + 3]);
        }
    }
}

/// The sum, and true if it is exact: the error term of Knuth's two-sum is then zero. (It may be exact without that.)
#[inline(always)]
pub(super) fn sum(a: f64, b: f64) -> (f64, bool) {
    let sum = a + b;
    (sum, (sum - a == b) & (sum - b == a))
}

/// The sum, rounded down.
#[inline]
pub(super) fn sum_below(a: f64, b: f64) -> f64 {
    let (sum, is_exact) = sum(a, b);
    if is_exact { sum } else { sum.next_down() }
}

/// The sum, rounded up.
#[inline]
pub(super) fn sum_above(a: f64, b: f64) -> f64 {
    let (sum, is_exact) = sum(a, b);
    if is_exact { sum } else { sum.next_up() }
}

/// A box in the coordinates of the mesh.
#[inline]
pub(super) fn outward(origin: &[f64; 3], min: Vec3, max: Vec3) -> NodeBox {
    std::array::from_fn(|i| match i {
        0..3 => sum_below(origin[i], min[i].into()),
        _ => sum_above(origin[i - 3], max[i - 3].into()),
    })
}

/// A triangle of a leaf.
#[derive(Debug, Clone, Copy)]
pub struct LeafTriangle {
    /// Its corners, in the coordinates of the mesh.
    pub corners: [DVec3; 3],
    /// The tree's local part.
    pub part: u32,
    /// Its index among the primitive ids of the block.
    pub number: u32,
}

/// What was found of blocks and is needed again to check places in them.
pub struct Known(bvh::nodes::LeafStarts);

impl Known {
    /// Bytes of memory.
    pub const BYTES: u64 = bvh::nodes::LeafStarts::BYTES;

    /// Fails with `NoMemory`.
    pub fn new() -> Result<Self> {
        bvh::nodes::LeafStarts::new().map(Self)
    }
}

/// Finds nodes in the blocks of a tree, of any structure.
#[derive(Debug, Clone, Copy)]
pub struct Nodes {
    pub(super) kind: NodesOf,
    pub(super) tree: u32,
    pub(super) origin: [f64; 3],
}

/// How nodes lie in blocks, for each structure.
#[derive(Debug, Clone, Copy)]
pub(super) enum NodesOf {
    /// Offset from the id of a fine block to that of its leaf block.
    Bvh(u32),
    #[cfg(any(test, feature = "brute"))]
    Brute,
}

impl Nodes {
    /// Index of the tree.
    pub fn tree(&self) -> u32 {
        self.tree
    }

    /// Finds the node at a place in the words of the place's block, which is one of the tree. Returns false if there is
    /// none; `node` has no meaning then.
    #[inline]
    pub fn node(&self, words: &[u32], place: Place, known: &mut Known, node: &mut Node) -> bool {
        node.tree = self.tree;
        match self.kind {
            NodesOf::Bvh(leaves_at) => bvh::nodes::node(words, place, (leaves_at, &self.origin), &mut known.0, node),
            #[cfg(any(test, feature = "brute"))]
            NodesOf::Brute => brute::nodes::node(words, place, &self.origin, node),
        }
    }

    /// Visits the triangles of the leaf at a place. Returns false if there is no leaf.
    pub fn triangles(
        &self,
        words: &[u32],
        place: Place,
        known: &mut Known,
        visit: &mut dyn FnMut(LeafTriangle),
    ) -> bool {
        let origin = DVec3::from_array(self.origin);
        let visit = |number: u32, triangle: Triangle| {
            let corners = triangle.vertices.map(|v| v.as_dvec3() + origin);
            visit(LeafTriangle { corners, part: triangle.part, number });
        };
        match self.kind {
            NodesOf::Bvh(_) => bvh::nodes::triangles(words, place, &mut known.0, visit),
            #[cfg(any(test, feature = "brute"))]
            NodesOf::Brute => brute::nodes::triangles(words, place, visit),
        }
    }

    /// Returns the places of all nodes of a block, in the block's order.
    pub fn all(&self, words: &[u32], block: u32) -> Vec<Place> {
        let items = match self.kind {
            NodesOf::Bvh(_) => bvh::nodes::items(words),
            #[cfg(any(test, feature = "brute"))]
            NodesOf::Brute => brute::nodes::items(words),
        };
        items.into_iter().map(|item| Place { block, item }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The sums are bounds of the exact sum, which a wider format holds.
        #[test]
        fn sums_are_rounded_outward(a: f32, scale in -60i32..60, b: f32) {
            prop_assume!(a.is_finite() && b.is_finite());
            let (a, b) = (f64::from(a) * 2f64.powi(scale), f64::from(b));
            let (low, high) = (sum_below(a, b), sum_above(a, b));
            // Two-sum: the rounding error of a + b, exactly.
            let s = a + b;
            let other = s - a;
            let error = (a - (s - other)) + (b - other);
            prop_assert!(if error < 0.0 { low < s } else { low <= s });
            prop_assert!(if error > 0.0 { high > s } else { high >= s });
            prop_assert!(low >= s.next_down() && high <= s.next_up());
            if low == high {
                prop_assert_eq!(error, 0.0);
            }
        }
    }
}
