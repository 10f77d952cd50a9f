//! Small subtrees: a range is split in two down to leaves, and further as long as that may pay off. Then the cheapest
//! of all wide trees over these splits is chosen.

use super::collapse::{self, Weighed};
use super::leaf::LeafShape;
use super::refs::Ref;
use super::sah;
use super::sah::Extents;
use super::tree::{Builder, DEEP, InnerNode, Piece, Place, Range, Sub, TREELET, leaf_voxel, pays, wrap_leaves};
use crate::math::Bounds;
use crate::structure::bake::Counts;
use crate::structure::bvh::layout::{MAX_TRIANGLES, MAX_VERTICES, WIDTH};

/// Greatest number of references of a small subtree: nodes above do not split such ranges any further. (With 48, exact
/// primary rays of scans are 3 to 7 % slower, others up to 4 %, and models are a thirtieth larger.)
pub const SMALL: usize = 4096;

/// Greatest number of references of a range that stays one leaf if it fits one. (Splitting twos and threes too makes
/// builds some percent longer and gains nothing.)
const FEW: usize = 3;

/// A node over more references than this counts as one that gives its leaves nodes of their own ([`wrap_leaves`]),
/// because it is mostly larger than a fine unit. The first number applies where most ranges of six to eight triangles
/// fit a leaf because they share vertices, the second where most do not. (If no leaf counts as such, airliners take 4
/// bytes a triangle more.)
const BARE: [usize; 2] = [128, 64];

/// A binary tree over a small range; its first node is the root.
struct Binary {
    nodes: Vec<Node>,
    weighed: Vec<Weighed>,
    /// Halves of each node; the node itself if it is not split.
    halves: Vec<[u32; 2]>,
    /// Leaves of nodes over more references than this get nodes of their own.
    bare: usize,
}

/// A range of the references.
struct Node {
    first: usize,
    len: usize,
    bounds: Bounds,
    /// The node as a leaf, if it fits one only because its triangles share vertices: that had to be computed.
    shape: Option<Box<LeafShape>>,
    /// The treelet that it is in, by the number of the treelet's first node.
    treelet: Option<u32>,
}

impl Node {
    /// True if the node fits a leaf even if its triangles share no vertices.
    fn surely_fits(&self) -> bool {
        surely_fits(self.len)
    }
}

fn surely_fits(len: usize) -> bool {
    3 * len <= MAX_VERTICES
}

/// Returns the children of a node over a small range, and the counts of that node.
pub fn children(builder: &Builder, range: Range) -> (Vec<Piece>, Counts) {
    let Range { room, len, first, extents } = range;
    // Enough for most ranges: two nodes for each leaf.
    let mut tree = Binary {
        nodes: Vec::with_capacity(len),
        weighed: Vec::with_capacity(len),
        halves: Vec::with_capacity(len),
        bare: 0,
    };
    tree.grow(builder, room, [0, len], &extents, 0, None);
    tree.weigh();
    tree.wide(builder, room, first, 0)
}

impl Binary {
    /// Adds the tree over the first `len` references of `room`, which begins at `first`; returns the number of its
    /// root. If `treelet` is given, the whole tree is in it.
    fn grow(
        &mut self,
        builder: &Builder,
        room: &mut [Ref],
        [first, len]: [usize; 2],
        extents: &Extents,
        depth: u32,
        treelet: Option<u32>,
    ) -> u32 {
        let (id, bounds) = (self.nodes.len(), extents.bounds());
        let treelet = treelet.or((len <= TREELET).then_some(id as u32));
        let surely = surely_fits(len);
        let shape = if surely { None } else { LeafShape::that_fits(&room[..len], builder.input).map(Box::new) };
        let fits = surely || shape.is_some();
        self.nodes.push(Node { first, len, bounds, shape, treelet });
        self.halves.push([id as u32; 2]);
        // A node that is split is weighed once all nodes are known.
        self.weighed.push(Weighed::leaf(bounds.half_area(), len));
        if fits && len <= FEW {
            return id as u32;
        }
        let split = if depth < DEEP { sah::find(&room[..len], extents, builder.par) } else { None };
        if fits && !split.as_ref().is_some_and(|split| pays(extents, len, split)) {
            return id as u32;
        }
        // The halves of a node that may be one leaf must be adjacent, because a leaf is one range: there is no room
        // between them, so no copies are made.
        let own = if fits { &mut room[..len] } else { room };
        let [left, right] = builder.halve(own, len, first, extents, split);
        let mut half =
            |half: Range| self.grow(builder, half.room, [half.first, half.len], &half.extents, depth + 1, treelet);
        self.halves[id] = [half(left), half(right)];
        id as u32
    }

    /// Weighs nodes that are split, halves first.
    fn weigh(&mut self) {
        let could_share = self.nodes.iter().filter(|node| !node.surely_fits() && node.len <= MAX_TRIANGLES);
        let (share, all) =
            could_share.fold((0, 0), |(share, all), node| (share + u32::from(node.shape.is_some()), all + 1));
        self.bare = BARE[usize::from(2 * share < all)];
        for id in (0..self.nodes.len()).rev() {
            let ([left, right], node) = (self.halves[id].map(|half| half as usize), &self.nodes[id]);
            if left != id {
                let leaf = (node.surely_fits() || node.shape.is_some()).then_some(node.len);
                self.weighed[id] = Weighed::inner(
                    node.bounds.half_area(),
                    &self.weighed[left],
                    &self.weighed[right],
                    leaf,
                    node.len > self.bare,
                );
            }
        }
    }

    /// Returns the children of a wide node over node `at`, and the counts of that node. The first reference of `room`
    /// has the number `start` among all.
    fn wide(&self, builder: &Builder, room: &[Ref], start: usize, at: u32) -> (Vec<Piece>, Counts) {
        let mut pieces = Vec::with_capacity(WIDTH);
        let mut counts = Counts { nodes: 1, ..Counts::default() };
        let (mut before, wraps) = (None, self.nodes[at as usize].len > self.bare);
        for child in collapse::children(at, &self.weighed, &self.halves, wraps) {
            let node = &self.nodes[child as usize];
            let place = match node.treelet {
                None => Place::Above,
                treelet if treelet == before => Place::GoesOn,
                _ => Place::Begins,
            };
            before = node.treelet;
            let (piece, below) = if self.weighed[child as usize].is_leaf(wraps) {
                leaf(builder, room, start, node, place)
            } else {
                let (pieces, counts) = self.wide(builder, room, start, child);
                (InnerNode::over(pieces, place), counts)
            };
            pieces.push(piece);
            counts.add_below(below);
        }
        let wrapped = wrap_leaves(&mut pieces);
        counts.nodes += wrapped;
        counts.depth = counts.depth.max(1 + u32::from(wrapped > 0)) + 1;
        (pieces, counts)
    }
}

/// Creates a leaf; returns it with its counts.
fn leaf(
    builder: &Builder,
    room: &[Ref],
    start: usize,
    &Node { first, len, bounds, ref shape, .. }: &Node,
    place: Place,
) -> (Piece, Counts) {
    let refs = &room[first..first + len];
    let found = if shape.is_none() { Some(LeafShape::of(refs, builder.input)) } else { None };
    let Some(shape) = shape.as_deref().or(found.as_ref()) else { unreachable!() };
    let sub = Sub::Leaf { first: (start + first) as u32, count: len as u32, words: shape.words() as u32 };
    let voxel = leaf_voxel(&bounds, refs, builder.input);
    let counts = Counts { depth: 1, nodes: 0, leaves: 1, references: shape.count as u64 };
    (Piece { cell: bounds, voxel, content: shape.content(refs), sub, place }, counts)
}
