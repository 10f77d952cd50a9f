//! The top-level tree: a binary BVH over the bounds of placed trees, in double precision.

use crate::base::error::Result;
use crate::base::memory::room;
use crate::math::DBounds;

/// A child of a node: an inner node or, if the top bit is set, a placed tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeRef(u32);

const LEAF: u32 = 1 << 31;

/// The target of a [`NodeRef`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Index of an inner node.
    Inner(u32),
    /// Index of a placed tree.
    Placed(u32),
}

impl NodeRef {
    /// The node or tree that this refers to.
    #[inline]
    pub fn target(self) -> Target {
        if self.0 & LEAF == 0 { Target::Inner(self.0) } else { Target::Placed(self.0 & !LEAF) }
    }
}

/// An inner node: two children with their boxes.
#[derive(Debug, Clone, Copy)]
pub struct Node {
    /// The box of each child.
    pub bounds: [DBounds; 2],
    /// The children.
    pub child: [NodeRef; 2],
}

/// The tree. Invariants: a child's index is above its parent's, so walks end; every placed tree with non-empty bounds
/// is a leaf exactly once; each box holds all that is below it.
#[derive(Debug, Clone)]
pub struct TopTree {
    nodes: Vec<Node>,
    root: Option<NodeRef>,
    around: DBounds,
    /// Depth of the deepest leaf; a depth-first walk needs a stack of at most one entry more.
    depth: usize,
}

impl Default for TopTree {
    fn default() -> Self {
        Self { nodes: Vec::new(), root: None, around: DBounds::EMPTY, depth: 0 }
    }
}

impl TopTree {
    /// Bytes of memory for each placed tree, while the tree is built.
    pub const BYTES_EACH: usize = size_of::<Node>() + Self::WORKING;
    /// Those that are given back afterwards.
    pub const WORKING: usize = 2 * size_of::<u32>();

    /// Builds the tree over `bounds`, index by index, and leaves out empty ones. The same input gives the same tree.
    /// Fails with `NoMemory`.
    pub fn build(bounds: &[DBounds]) -> Result<Self> {
        let what = "the tree over the placed trees of a scene";
        let mut order: Vec<u32> = room(bounds.len(), what)?;
        order.extend((0..bounds.len() as u32).filter(|&i| !bounds[i as usize].is_empty()));
        let around = order.iter().fold(DBounds::EMPTY, |all, &i| all.union(bounds[i as usize]));
        let mut tree = Self { around, nodes: room(order.len().saturating_sub(1), what)?, ..Self::default() };
        if order.is_empty() {
            return Ok(tree);
        }
        let mut others: Vec<u32> = room(order.len(), what)?;
        others.resize(order.len(), 0);
        // The loop replaces a recursion as deep as the tree.
        let mut todo = vec![(0, order.len(), None::<(usize, usize)>, 1)];
        while let Some((begin, end, parent, depth)) = todo.pop() {
            tree.depth = tree.depth.max(depth);
            let reference = if end - begin == 1 {
                NodeRef(order[begin] | LEAF)
            } else {
                let range = &mut order[begin..end];
                let middle = begin + split(bounds, range, &mut others);
                let node = tree.nodes.len();
                let around = |part: &[u32]| part.iter().fold(DBounds::EMPTY, |b, &i| b.union(bounds[i as usize]));
                tree.nodes.push(Node {
                    bounds: [around(&order[begin..middle]), around(&order[middle..end])],
                    child: [NodeRef(0); 2],
                });
                todo.push((middle, end, Some((node, 1)), depth + 1));
                todo.push((begin, middle, Some((node, 0)), depth + 1));
                NodeRef(node as u32)
            };
            match parent {
                Some((node, side)) => tree.nodes[node].child[side] = reference,
                None => tree.root = Some(reference),
            }
        }
        Ok(tree)
    }

    /// Bounds of all that the tree was built over.
    #[inline]
    pub fn around(&self) -> &DBounds {
        &self.around
    }

    /// The root of all walks; `None` if the tree is empty.
    #[inline]
    pub fn root(&self) -> Option<NodeRef> {
        self.root
    }

    /// An inner node.
    #[inline]
    pub fn node(&self, index: u32) -> &Node {
        &self.nodes[index as usize]
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> u64 {
        (self.nodes.capacity() * size_of::<Node>()) as u64
    }
}

const BINS: usize = 16;

/// Orders `range` by binned SAH over the centres, so that its first n go to one side and the rest to the other. Returns
/// n, at least 1 and less than all. The indices are ascending, and stay so on each side. `others`: see [`divide`].
fn split(bounds: &[DBounds], range: &mut [u32], others: &mut [u32]) -> usize {
    let centre = |i: u32| bounds[i as usize].center();
    let centres = range.iter().fold(DBounds::EMPTY, |b, &i| b.with(centre(i)));
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..3 {
        let width = centres.extent()[axis];
        if width > 0.0 && width.is_finite() {
            let bin = |i: u32| bin_of(centre(i)[axis], centres.min[axis], width);
            if let Some((cost, cut)) = cheapest_cut(bounds, range, bin)
                && best.is_none_or(|(c, ..)| cost < c)
            {
                best = Some((cost, axis, cut));
            }
        }
    }
    if let Some((_, axis, cut)) = best {
        let (low, width) = (centres.min[axis], centres.extent()[axis]);
        let n = divide(range, others, |i| bin_of(centre(i)[axis], low, width) < cut);
        if n > 0 && n < range.len() {
            return n;
        }
    }
    range.len() / 2
}

/// Moves those for which `is_first` is true to the front, and keeps both kinds in order. Returns their number. `others`
/// is working memory, at least as long.
fn divide(range: &mut [u32], others: &mut [u32], is_first: impl Fn(u32) -> bool) -> usize {
    let (mut first, mut other) = (0, 0);
    for at in 0..range.len() {
        let i = range[at];
        if is_first(i) {
            range[first] = i;
            first += 1;
        } else {
            others[other] = i;
            other += 1;
        }
    }
    range[first..].copy_from_slice(&others[..other]);
    first
}

fn bin_of(x: f64, low: f64, width: f64) -> usize {
    (((x - low) / width * BINS as f64) as usize).min(BINS - 1)
}

/// The cheapest of the cuts between bins: its cost, and the first bin on its right.
fn cheapest_cut(bounds: &[DBounds], range: &[u32], bin: impl Fn(u32) -> usize) -> Option<(f64, usize)> {
    let mut bins = [(DBounds::EMPTY, 0usize); BINS];
    for &i in range {
        let b = &mut bins[bin(i)];
        *b = (b.0.union(bounds[i as usize]), b.1 + 1);
    }
    let add = |a: (DBounds, usize), b: &(DBounds, usize)| (a.0.union(b.0), a.1 + b.1);
    let mut right = [(DBounds::EMPTY, 0usize); BINS + 1];
    for b in (0..BINS).rev() {
        right[b] = add(right[b + 1], &bins[b]);
    }
    let mut left = (DBounds::EMPTY, 0);
    let mut best: Option<(f64, usize)> = None;
    for cut in 1..BINS {
        left = add(left, &bins[cut - 1]);
        if left.1 > 0 && right[cut].1 > 0 {
            let cost = left.0.half_area() * left.1 as f64 + right[cut].0.half_area() * right[cut].1 as f64;
            if best.is_none_or(|(c, _)| cost < c) {
                best = Some((cost, cut));
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::super::box_ray::BoxRay;
    use super::*;
    use crate::math::Ray;
    use glam::{DVec3, Vec3};

    fn grid(n: i32) -> Vec<DBounds> {
        let corner = |i: i32| DVec3::new((i % 7) as f64, (i / 7 % 5) as f64, (i / 35) as f64) * 3.0;
        (0..n).map(|i| DBounds { min: corner(i), max: corner(i) + DVec3::splat(1.0 + (i % 3) as f64) }).collect()
    }

    fn walk(tree: &TopTree, box_rays: &BoxRay, t_max: f64) -> Vec<u32> {
        let mut found = Vec::new();
        let mut stack: Vec<_> = tree.root().into_iter().collect();
        while let Some(r) = stack.pop() {
            match r.target() {
                Target::Placed(i) => found.push(i),
                Target::Inner(i) => {
                    let node = tree.node(i);
                    for side in 0..2 {
                        if box_rays.enter(&node.bounds[side], 0.0, t_max).is_some() {
                            stack.push(node.child[side]);
                        }
                    }
                }
            }
        }
        found.sort_unstable();
        found
    }

    #[test]
    fn every_box_that_a_ray_meets_is_a_leaf_it_reaches() {
        let boxes = grid(200);
        let tree = TopTree::build(&boxes).unwrap();
        assert!(tree.depth < 24);
        // Directions are axis-parallel, in planes of boxes, and diagonal; origins lie on the grid of the boxes.
        for (i, dir) in
            [Vec3::X, -Vec3::Y, Vec3::Z, Vec3::ONE, Vec3::new(1.0, -1.0, 0.0)].iter().cycle().take(500).enumerate()
        {
            let i = i as i32;
            let org = DVec3::new((i % 11 - 2) as f64, (i / 11 % 9) as f64, (i % 5) as f64 * 3.0);
            let box_rays = BoxRay::new(&Ray::new(org, *dir));
            let reached = walk(&tree, &box_rays, f64::INFINITY);
            let expected: Vec<u32> =
                (0..200).filter(|&i| box_rays.enter(&boxes[i as usize], 0.0, f64::INFINITY).is_some()).collect();
            for e in &expected {
                assert!(reached.contains(e), "ray {i} misses box {e}");
            }
        }
    }

    #[test]
    fn boundary_rays_are_inside_and_outside_rays_are_out() {
        let unit = DBounds { min: DVec3::ZERO, max: DVec3::ONE };
        let enter = |o: [f64; 3], d: Vec3| BoxRay::new(&Ray::new(DVec3::from(o), d)).enter(&unit, 0.0, f64::INFINITY);
        assert!(enter([-1.0, 0.0, 0.0], Vec3::X).is_some(), "along an edge");
        assert!(enter([-1.0, 1.0, 1.0], Vec3::X).is_some(), "along the opposite edge");
        assert!(enter([-1.0, 1.0 + 1e-9, 0.5], Vec3::X).is_none());
        assert!(enter([2.0, 0.5, 0.5], Vec3::X).is_none(), "behind");
        assert!(enter([0.5, 0.5, 0.5], Vec3::new(0.0, -0.0, 1.0)).is_some(), "from inside, with zeros");
    }

    #[test]
    fn coincident_boxes_still_make_a_tree() {
        let boxes = vec![DBounds { min: DVec3::ZERO, max: DVec3::ONE }; 1000];
        let tree = TopTree::build(&boxes).unwrap();
        assert!(tree.depth <= 12, "halved where nothing tells them apart: depth {}", tree.depth);
        assert!(TopTree::build(&[DBounds::EMPTY]).unwrap().root().is_none());
    }
}
