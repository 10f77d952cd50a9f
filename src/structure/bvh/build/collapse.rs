//! Chooses the nodes of a binary tree that become wide nodes, and those that become leaves: the cheapest choice, by
//! dynamic programming.
//!
//! Source: Ylitie, Karras, Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017,
//! section 3.1.

use crate::structure::bvh::layout::WIDTH;

/// Cost of a node per area of its box; it is the unit of the costs of leaves. (Measured with a Mandelbulb of 10 million
/// in ranges of 4,096, a node at the cost of 0.5 to 2.5 leaves, a triangle at 0.06 to 0.17 of one: expensive triangles
/// make shadow rays 8 % slower and the model a sixth larger.)
pub const NODE_COST: f32 = 1.0;
/// Cost of a leaf without its triangles.
pub const LEAF_COST: f32 = 1.0;
/// Cost of a triangle of a leaf.
pub const TRIANGLE_COST: f32 = 0.06;

/// Costs of a node of the binary tree: below a wide node that keeps leaves as they are, and below one that gives each
/// leaf a node of its own ([`super::tree::wrap_leaves`]).
pub struct Weighed {
    below: [Choice; 2],
}

/// The cheapest choices below one kind of wide node.
#[derive(Clone, Copy)]
struct Choice {
    /// Least cost as at most one to eight children of a wide node.
    costs: [f32; WIDTH],
    /// Number of these children in the left half; 0: the choice with one child less is cheaper.
    of_left: [u8; WIDTH],
    /// True if it is a leaf as one child.
    is_leaf: bool,
}

/// Returns the cost of a leaf, without and with a node of its own.
fn costs_of_leaf(half_area: f32, triangles: usize) -> [f32; 2] {
    let cost = half_area * (LEAF_COST + TRIANGLE_COST * triangles as f32);
    [cost, cost + half_area * NODE_COST]
}

impl Weighed {
    /// Weighs a leaf of `triangles` triangles.
    pub fn leaf(half_area: f32, triangles: usize) -> Self {
        Self {
            below: costs_of_leaf(half_area, triangles).map(|cost| Choice {
                costs: [cost; WIDTH],
                of_left: [0; WIDTH],
                is_leaf: true,
            }),
        }
    }

    /// Weighs a node of two halves. `triangles` is its number of triangles if it fits a leaf. `wraps`: leaves of a wide
    /// node made of it get nodes of their own, and so do those of all nodes above it.
    pub fn inner(half_area: f32, left: &Self, right: &Self, triangles: Option<usize>, wraps: bool) -> Self {
        let of = |which: usize| several(&left.below[which].costs, &right.below[which].costs);
        let wrapped = of(1);
        // `below[0]` of such a node is never read: all nodes above it wrap too.
        let bare = if wraps { wrapped } else { of(0) };
        let least = |costs: &[f32; WIDTH]| costs[1..].iter().fold(f32::INFINITY, |least, cost| least.min(*cost));
        let node = least(&bare.0) + half_area * NODE_COST;
        let leaves = triangles.map_or([f32::INFINITY; 2], |count| costs_of_leaf(half_area, count));
        let choice = |(mut costs, mut of_left): ([f32; WIDTH], [u8; WIDTH]), leaf: f32| {
            let is_leaf = triangles.is_some() && leaf <= node;
            costs[0] = if is_leaf { leaf } else { node };
            for i in 1..WIDTH {
                // Not for equal costs: a node is never its own only child.
                if costs[i - 1] < costs[i] {
                    (costs[i], of_left[i]) = (costs[i - 1], 0);
                }
            }
            Choice { costs, of_left, is_leaf }
        };
        Self { below: [choice(bare, leaves[0]), choice(wrapped, leaves[1])] }
    }

    /// True if it is a leaf as one child of a wide node. `wraps`: leaves of that node get nodes of their own.
    pub fn is_leaf(&self, wraps: bool) -> bool {
        self.below[usize::from(wraps)].is_leaf
    }
}

/// Returns the costs of two and more children from both halves, and how many of them are in the left half.
fn several(left: &[f32; WIDTH], right: &[f32; WIDTH]) -> ([f32; WIDTH], [u8; WIDTH]) {
    // Costs of the right half, after infinite costs for no children: with `k` children in the left half and `i + 1` in
    // all, the right half costs `padded[WIDTH + i - k]`.
    let mut padded = [f32::INFINITY; 2 * WIDTH];
    padded[WIDTH..].copy_from_slice(right);
    let (mut costs, mut of_left) = ([f32::INFINITY; WIDTH], [0u32; WIDTH]);
    // Two children are possible even if areas overflow.
    of_left[1] = 1;
    for k in 1..WIDTH {
        // No branches, so that the loop is vectorised.
        for i in 0..WIDTH {
            let cost = left[k - 1] + padded[WIDTH + i - k];
            let is_less = cost < costs[i];
            costs[i] = if is_less { cost } else { costs[i] };
            of_left[i] = if is_less { k as u32 } else { of_left[i] };
        }
    }
    (costs, of_left.map(|k| k as u8))
}

/// Returns the children of a wide node over node `at` of a binary tree, from left to right, given the halves of each
/// binary node. Returns `at` itself if that cannot be split. `wraps`: leaves of the wide node get nodes of their own.
pub fn children(at: u32, weighed: &[Weighed], halves: &[[u32; 2]], wraps: bool) -> Vec<u32> {
    let mut found = Vec::with_capacity(WIDTH);
    // The last element is processed next: the left half.
    let mut open = Vec::with_capacity(WIDTH);
    open.push((at, WIDTH));
    while let Some((at, mut count)) = open.pop() {
        let of_left = &weighed[at as usize].below[usize::from(wraps)].of_left;
        while count > 1 && of_left[count - 1] == 0 {
            count -= 1;
        }
        if count == 1 {
            found.push(at);
            continue;
        }
        let (left, [l, r]) = (usize::from(of_left[count - 1]), halves[at as usize]);
        open.extend([(r, count - left), (l, left)]);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    /// A binary tree: areas, and the halves of nodes that have any. Children come after their parents.
    struct Tree {
        areas: Vec<f32>,
        halves: Vec<[u32; 2]>,
        triangles: Vec<Option<usize>>,
        weighed: Vec<Weighed>,
        /// A node over more leaves than this gives each of its leaves a node of its own.
        most: usize,
        counts: Vec<usize>,
    }

    impl Tree {
        fn new(most: usize) -> Self {
            Self {
                areas: Vec::new(),
                halves: Vec::new(),
                triangles: Vec::new(),
                weighed: Vec::new(),
                most,
                counts: Vec::new(),
            }
        }

        /// Adds a tree over `count` leaves of one triangle, split as `choices` say. The area of a parent is that of
        /// both halves times a factor out of `choices`.
        fn grow(&mut self, count: usize, choices: &mut impl Iterator<Item = (usize, f32)>) -> u32 {
            let id = self.areas.len();
            let (at, factor) = choices.next().expect("as many as nodes");
            self.areas.push(factor);
            self.counts.push(count);
            self.halves.push([id as u32; 2]);
            self.triangles.push(Some(count).filter(|count| *count <= 4));
            self.weighed.push(Weighed::leaf(factor, 1));
            if count > 1 {
                let left = 1 + at % (count - 1);
                let halves = [self.grow(left, choices), self.grow(count - left, choices)];
                let [l, r] = halves.map(|half| half as usize);
                self.areas[id] = factor * (self.areas[l] + self.areas[r]);
                let (left, right) = (&self.weighed[l], &self.weighed[r]);
                self.weighed[id] = Weighed::inner(self.areas[id], left, right, self.triangles[id], count > self.most);
                self.halves[id] = halves;
            }
            id as u32
        }

        /// Returns the least cost of everything below a node, as at most `count` children, by trying all possibilities.
        fn least(&self, at: usize, count: usize, wraps: bool, known: &mut HashMap<(usize, usize, bool), f32>) -> f32 {
            if let Some(cost) = known.get(&(at, count, wraps)) {
                return *cost;
            }
            let [l, r] = self.halves[at].map(|half| half as usize);
            let mut least =
                self.triangles[at].map_or(f32::INFINITY, |n| costs_of_leaf(self.areas[at], n)[usize::from(wraps)]);
            if l != at {
                // As a node over its halves' children, or as these children.
                for (node, of, wraps) in
                    [(self.areas[at] * NODE_COST, WIDTH, self.counts[at] > self.most), (0.0, count, wraps)]
                {
                    for k in 1..of {
                        least = least.min(node + self.least(l, k, wraps, known) + self.least(r, of - k, wraps, known));
                    }
                }
            }
            known.insert((at, count, wraps), least);
            least
        }

        /// Returns the cost of the wide tree that [`children`] makes, without the root.
        fn made(&self, at: u32) -> f32 {
            let wraps = self.counts[at as usize] > self.most;
            let cost = |child: u32| {
                let i = child as usize;
                if self.weighed[i].is_leaf(wraps) {
                    return costs_of_leaf(self.areas[i], self.triangles[i].expect("a leaf"))[usize::from(wraps)];
                }
                self.areas[i] * NODE_COST + self.made(child)
            };
            let children = children(at, &self.weighed, &self.halves, wraps);
            assert!(
                (1..=WIDTH).contains(&children.len()) && (children != [at] || self.weighed[at as usize].is_leaf(wraps))
            );
            children.into_iter().map(cost).sum()
        }
    }

    proptest! {
        /// The tree that is made costs as much as the cheapest of all trees, without the root.
        #[test]
        fn no_other_tree_is_cheaper(count in 1usize..40, most in 0usize..40, choices in prop::collection::vec((0usize..100, 0.5f32..1.5), 80)) {
            let mut tree = Tree::new(most);
            tree.grow(count, &mut choices.into_iter());
            let (made, least) = (tree.made(0), tree.least(0, WIDTH, count > most, &mut HashMap::new()));
            prop_assert!((made - least).abs() <= 1e-4 * least, "{made} {least}");
        }
    }

    /// Nine leaves do not fit a node: two of them go one level down, those with the smallest common box.
    #[test]
    fn surplus_leaves_of_a_node_go_where_they_are_cheapest() {
        let leaf = || Weighed::leaf(1.0, 1);
        // A chain of pairs: node 9 + i is over leaf i and node 10 + i, and the last node, 16, is over leaves 7 and 8.
        let mut halves: Vec<[u32; 2]> = (0..9).map(|i| [i, i]).collect();
        halves.extend((0..8u32).map(|i| [i, if i < 7 { 10 + i } else { 8 }]));
        let mut weighed: Vec<Option<Weighed>> = (0..17).map(|i| (i < 9).then(leaf)).collect();
        for at in (9..17).rev() {
            let [l, r] = halves[at].map(|half| weighed[half as usize].as_ref().expect("children come first"));
            weighed[at] = Some(Weighed::inner((17 - at) as f32, l, r, None, false));
        }
        let weighed: Vec<Weighed> = weighed.into_iter().flatten().collect();
        assert_eq!(children(9, &weighed, &halves, false), [0, 1, 2, 3, 4, 5, 6, 16]);
        assert_eq!(children(16, &weighed, &halves, false), [7, 8]);
    }

    /// Two leaves below a node that gives each leaf a node of its own: both go into one node.
    #[test]
    fn leaves_go_together_where_each_would_get_a_node() {
        // A root over a pair of leaves, and a third leaf.
        let halves = [[1, 2], [3, 4], [2, 2], [3, 3], [4, 4]];
        for (wraps, expected) in [(false, vec![3, 4, 2]), (true, vec![1, 2])] {
            let leaf = || Weighed::leaf(1.0, 4);
            let (pair, third) = (Weighed::inner(1.2, &leaf(), &leaf(), None, false), leaf());
            let root = Weighed::inner(2.0, &pair, &third, None, wraps);
            let all = [root, pair, third, leaf(), leaf()];
            assert_eq!(children(0, &all, &halves, wraps), expected);
        }
    }

    #[test]
    fn boxes_without_area_or_beyond_numbers_end() {
        for (area, wraps) in [(0.0, false), (0.0, true), (f32::INFINITY, false), (f32::INFINITY, true)] {
            let mut tree = Tree::new(40);
            tree.grow(30, &mut (0..60).map(|at| (at * 7, 1.0)));
            for at in (0..tree.weighed.len()).rev() {
                let [l, r] = tree.halves[at].map(|half| half as usize);
                tree.weighed[at] = match l == at {
                    true => Weighed::leaf(area, 1),
                    false => Weighed::inner(area, &tree.weighed[l], &tree.weighed[r], None, wraps),
                };
            }
            let (mut open, mut leaves) = (vec![0], 0);
            while let Some(at) = open.pop() {
                let below = children(at, &tree.weighed, &tree.halves, wraps);
                assert!((2..=WIDTH).contains(&below.len()));
                let (leaf, node): (Vec<u32>, Vec<u32>) =
                    below.into_iter().partition(|child| tree.weighed[*child as usize].is_leaf(wraps));
                leaves += leaf.len();
                open.extend(node);
            }
            assert_eq!(leaves, 30);
        }
    }
}
