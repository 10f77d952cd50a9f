//! Which nodes of a binary tree become wide ones, and which leaves: the cheapest choice, by dynamic programming.
//!
//! Source: Ylitie, Karras, Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017,
//! section 3.1.

use crate::structure::bvh::layout::WIDTH;

/// Cost of a node, by the area of its box; costs of leaves are counted in it. (A Mandelbulb of 10 million in ranges of
/// 4,096, nodes for 0.5 to 2.5 leaves and triangles for 0.06 to 0.17 of one: dear triangles make shadow rays 8 % slower
/// and the model a sixth larger.)
pub const NODE_COST: f32 = 1.0;
/// Cost of a leaf beside its triangles.
pub const LEAF_COST: f32 = 1.0;
/// Cost of a triangle of a leaf.
pub const TRIANGLE_COST: f32 = 0.06;

/// A node of the binary tree: what it may become below a node whose leaves stay as they are, and below one of which
/// each leaf gets a node of its own ([`super::tree::wrap_leaves`]).
pub struct Weighed {
    below: [Choice; 2],
}

/// What it may become below one of these.
#[derive(Clone, Copy)]
struct Choice {
    /// The least cost as one to eight children of a node.
    costs: [f32; WIDTH],
    /// How many of these are of the left half; 0: as with one fewer.
    of_left: [u8; WIDTH],
    /// As one child, it is a leaf.
    is_leaf: bool,
}

/// Of a leaf: by itself, and with a node of its own.
fn costs_of_leaf(half_area: f32, triangles: usize) -> [f32; 2] {
    let cost = half_area * (LEAF_COST + TRIANGLE_COST * triangles as f32);
    [cost, cost + half_area * NODE_COST]
}

impl Weighed {
    /// What is one leaf, of so many triangles.
    pub fn leaf(half_area: f32, triangles: usize) -> Self {
        Self {
            below: costs_of_leaf(half_area, triangles).map(|cost| Choice {
                costs: [cost; WIDTH],
                of_left: [0; WIDTH],
                is_leaf: true,
            }),
        }
    }

    /// What is in two halves, or in a leaf of so many triangles, if it fits one. `wraps`: leaves of a node made of it
    /// get nodes of their own, and so they do of all nodes above it.
    pub fn inner(half_area: f32, left: &Self, right: &Self, triangles: Option<usize>, wraps: bool) -> Self {
        let of = |which: usize| several(&left.below[which].costs, &right.below[which].costs);
        let wrapped = of(1);
        // Nothing asks `below[0]` of such a node: all above it wrap too.
        let bare = if wraps { wrapped } else { of(0) };
        let least = |costs: &[f32; WIDTH]| costs[1..].iter().fold(f32::INFINITY, |least, cost| least.min(*cost));
        let node = least(&bare.0) + half_area * NODE_COST;
        let leaves = triangles.map_or([f32::INFINITY; 2], |count| costs_of_leaf(half_area, count));
        let choice = |(mut costs, mut of_left): ([f32; WIDTH], [u8; WIDTH]), leaf: f32| {
            let is_leaf = triangles.is_some() && leaf <= node;
            costs[0] = if is_leaf { leaf } else { node };
            for i in 1..WIDTH {
                // Not where they are equal: a node is never its own only child.
                if costs[i - 1] < costs[i] {
                    (costs[i], of_left[i]) = (costs[i - 1], 0);
                }
            }
            Choice { costs, of_left, is_leaf }
        };
        Self { below: [choice(bare, leaves[0]), choice(wrapped, leaves[1])] }
    }

    /// As one child of a node whose leaves get nodes of their own, if `wraps`, it is a leaf.
    pub fn is_leaf(&self, wraps: bool) -> bool {
        self.below[usize::from(wraps)].is_leaf
    }
}

/// Costs of two children and more, of both halves, and how many of these are of the left one.
fn several(left: &[f32; WIDTH], right: &[f32; WIDTH]) -> ([f32; WIDTH], [u8; WIDTH]) {
    // Costs of the right half behind those of no children: with `k` of the left, `i + 1` in all have `padded[WIDTH +
    // i - k]` of it.
    let mut padded = [f32::INFINITY; 2 * WIDTH];
    padded[WIDTH..].copy_from_slice(right);
    let (mut costs, mut of_left) = ([f32::INFINITY; WIDTH], [0u32; WIDTH]);
    // Two, even where areas are too large for numbers.
    of_left[1] = 1;
    for k in 1..WIDTH {
        // Without branches, so that it becomes vectors.
        for i in 0..WIDTH {
            let cost = left[k - 1] + padded[WIDTH + i - k];
            let is_less = cost < costs[i];
            costs[i] = if is_less { cost } else { costs[i] };
            of_left[i] = if is_less { k as u32 } else { of_left[i] };
        }
    }
    (costs, of_left.map(|k| k as u8))
}

/// The children of a wide node over node `at` of a binary tree, given the halves of each of its nodes, from left to
/// right. `at` itself if that is a leaf at any cost. `wraps`: its leaves get nodes of their own.
pub fn children(at: u32, weighed: &[Weighed], halves: &[[u32; 2]], wraps: bool) -> Vec<u32> {
    let mut found = Vec::with_capacity(WIDTH);
    // What is looked at next is the last: the left half.
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

    /// A binary tree: areas, and halves of those nodes that have any; children behind their parents.
    struct Tree {
        areas: Vec<f32>,
        halves: Vec<[u32; 2]>,
        triangles: Vec<Option<usize>>,
        weighed: Vec<Weighed>,
        /// Nodes over more leaves than so many have none without a node of its own.
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

        /// Over `count` leaves of one triangle, split where `choices` say. Parents are as large as both halves or
        /// nearly.
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

        /// The least cost of all that is below a node and may be, as `count` children at the most, by trying all.
        fn least(&self, at: usize, count: usize, wraps: bool, known: &mut HashMap<(usize, usize, bool), f32>) -> f32 {
            if let Some(cost) = known.get(&(at, count, wraps)) {
                return *cost;
            }
            let [l, r] = self.halves[at].map(|half| half as usize);
            let mut least =
                self.triangles[at].map_or(f32::INFINITY, |n| costs_of_leaf(self.areas[at], n)[usize::from(wraps)]);
            if l != at {
                // As a node over its halves' children, or as these.
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

        /// The cost of the wide tree that is made, without the root.
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
        /// What is made costs what the cheapest of all trees does, without the root.
        #[test]
        fn no_other_tree_is_cheaper(count in 1usize..40, most in 0usize..40, choices in prop::collection::vec((0usize..100, 0.5f32..1.5), 80)) {
            let mut tree = Tree::new(most);
            tree.grow(count, &mut choices.into_iter());
            let (made, least) = (tree.made(0), tree.least(0, WIDTH, count > most, &mut HashMap::new()));
            prop_assert!((made - least).abs() <= 1e-4 * least, "{made} {least}");
        }
    }

    /// Nine leaves do not fit a node: two of them go one down, the two of the smallest box.
    #[test]
    fn what_is_too_much_for_a_node_goes_where_it_is_cheapest() {
        let leaf = || Weighed::leaf(1.0, 1);
        // A chain of pairs: leaf 0 and (leaf 1 and (.. (leaf 7 and leaf 8))); node 8 + i is over leaf i and node 9 + i,
        // the last over leaves 7 and 8.
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

    /// Two leaves of a node of which each leaf gets one: both go into one node.
    #[test]
    fn leaves_go_together_where_each_would_get_a_node() {
        // A root over a pair of leaves, and a third.
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
