//! Builds wide nodes: the binary splits of the heuristic, up to eight at a time.

use super::cluster::{FINE_WORDS, UnitId};
use super::collapse::{LEAF_COST, TRIANGLE_COST};
use super::partition::{self, Sides};
use super::quantise::quantise;
use super::refs::Ref;
use super::sah::{self, Extents, Split};
use super::small::{self, SMALL};
use super::spatial::{self, SpatialSplit};
use crate::base::error::Result;
use crate::base::progress::Stretch;
use crate::lod::{Coded, Content, Facet, Fill, SIDES_WORDS, VOXEL_WORDS, Voxel};
use crate::math::Bounds;
use crate::structure::bake::{Counts, TreeInput};
use crate::structure::bvh::layout::{EXTERNAL_WORDS, MAX_TRIANGLES, NODE_WORDS, Node, WIDTH};
use crate::structure::par::Par;
use glam::Vec3;

/// A node that is not yet in a block.
pub enum Sub {
    /// A leaf: a range of the references.
    Leaf {
        /// First reference.
        first: u32,
        /// Number of references.
        count: u32,
        /// Number of words in the trace form.
        words: u32,
    },
    /// An inner node.
    InnerNode(Box<InnerNode>),
    /// A unit that already is in a block further down.
    Placed(UnitId),
}

/// An inner node with its children.
pub struct InnerNode {
    /// The children's boxes on its grid; child references are not set yet.
    pub node: Node,
    /// Each child with its voxel, in the order of the node's slots.
    pub children: Vec<(Coded, Sub)>,
    /// Number of words of everything below in its block, itself included, without curtains: these come late, and do not
    /// change how a tree is divided.
    pub words: u32,
    /// Place of each child among treelets, in the order of the slots.
    pub places: [Place; WIDTH],
    /// Number of the proxy that the node shows (`proxies`), or [`NO_PROXY`].
    pub proxy: u32,
}

/// The proxy of nodes that have none.
pub const NO_PROXY: u32 = u32::MAX;

/// Greatest number of references of a **treelet**: a range of the binary splits that is half of a larger range, or the
/// whole tree. Treelets are classified as a whole (`coverage`). In the wide tree, a treelet is one child or several
/// neighbours of one node, and all nodes below them.
pub const TREELET: usize = 256;

/// Place of a child among treelets. It is not used in nodes inside a treelet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Outside treelets: its range is larger.
    Above,
    /// A treelet begins with it.
    Begins,
    /// It is in the same treelet as the child before.
    GoesOn,
}

/// A subtree that has no parent yet.
pub struct Piece {
    /// Box around its children's boxes as stored: a box that contains it contains theirs. (So a ray that enters a cell
    /// enters all cells above it, regardless of rounding: the stand-ins that a ray hits do not depend on its way
    /// through the tree.)
    pub cell: Bounds,
    /// Appearance of its content.
    pub voxel: Voxel,
    /// Extent of its content in the cell.
    pub content: Content,
    /// The subtree itself.
    pub sub: Sub,
    /// Its place as a child.
    pub place: Place,
}

impl Sub {
    /// Number of words that it takes in its block, with everything below.
    pub fn words(&self) -> u32 {
        match self {
            Sub::Leaf { words, .. } => *words,
            Sub::InnerNode(inner) => inner.words,
            Sub::Placed(_) => EXTERNAL_WORDS as u32,
        }
    }
}

impl InnerNode {
    /// Number of inner nodes in its block: itself, and those below.
    pub fn nodes(&self) -> u32 {
        let below = self.children.iter().map(|(_, c)| match c {
            Sub::InnerNode(inner) => inner.nodes(),
            _ => 0,
        });
        1 + below.sum::<u32>()
    }

    /// Number of words of the curtains in its block.
    pub fn curtain_words(&self) -> u32 {
        let below = self.children.iter().map(|(voxel, c)| {
            voxel.curtain_words() as u32 + if let Sub::InnerNode(inner) = c { inner.curtain_words() } else { 0 }
        });
        below.sum()
    }

    /// Number of words of the leaves in its block.
    pub fn leaf_words(&self) -> u32 {
        let below = self.children.iter().map(|(_, c)| match c {
            Sub::InnerNode(inner) => inner.leaf_words(),
            Sub::Leaf { words, .. } => *words,
            Sub::Placed(_) => 0,
        });
        below.sum()
    }

    /// Updates `words` after a change below.
    pub fn measure(&mut self) {
        let below = self.children.iter().map(|(voxel, c)| voxel.len() as u32 + c.words());
        // One word is the number of the node's first voxel.
        self.words = NODE_WORDS as u32 + 1 + below.sum::<u32>();
    }

    /// Creates a node over one to eight pieces; its own place is `place`.
    pub fn over(pieces: Vec<Piece>, place: Place) -> Piece {
        let mut node = quantise(pieces.iter().map(|p| p.cell));
        let stored: Vec<Bounds> = (0..pieces.len()).map(|slot| node.stored_box(slot)).collect();
        let cell = stored.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
        let voxel = Voxel::over(stored.iter().zip(pieces.iter().map(|p| &p.voxel)));
        // A leaf needs no samples of its sides: wherever these could be told apart, its triangles are shown.
        let mut contents = Vec::with_capacity(pieces.len());
        let coded = |(slot, (p, stored)): (usize, (Piece, &Bounds))| {
            let is_leaf = |sub: &Sub| matches!(sub, Sub::Leaf { .. });
            let may_have_sides = match &p.sub {
                Sub::InnerNode(wrapped) if wrapped.children.len() == 1 => !is_leaf(&wrapped.children[0].1),
                sub => !is_leaf(sub),
            };
            let coded = Coded::of(&p.voxel, &node.stored_middle(slot), &p.content, may_have_sides);
            node.set_oriented_slabs(slot, coded.slabs, coded.words[0] as u16);
            let (slabs, fill) = (node.stored_oriented_slabs(slot), Fill::of(&p.content, stored));
            node.set_level(slot, fill.level(stored, &slabs));
            contents.push((p.content, *stored, slabs, fill));
            (coded, p.sub)
        };
        let mut places = [Place::GoesOn; WIDTH];
        places.iter_mut().zip(&pieces).for_each(|(place, piece)| *place = piece.place);
        // No `collect`: the result would keep the memory of the pieces, which is several times as large.
        let mut children = Vec::with_capacity(pieces.len());
        children.extend(pieces.into_iter().zip(&stored).enumerate().map(coded));
        let mut inner = Box::new(InnerNode { node, children, words: 0, places, proxy: NO_PROXY });
        inner.measure();
        Piece { cell, voxel, content: Content::over(contents), sub: Sub::InnerNode(inner), place }
    }
}

/// Result of [`build`].
pub struct Built {
    /// The root's children: one to eight.
    pub children: Vec<Piece>,
    /// Bounds of all triangles.
    pub bounds: Bounds,
    /// Counts, with the root.
    pub counts: Counts,
}

/// Depth below which ranges are halved instead of split by the heuristic, which bounds the depth. In small subtrees it
/// is counted from their roots.
pub const DEEP: u32 = 32;

/// Input and settings of a build.
pub struct Builder<'a> {
    /// The triangles.
    pub input: TreeInput<'a>,
    /// Threads.
    pub par: &'a Par,
    stretch: &'a Stretch<'a>,
    mesh_half_area: f32,
}

/// A range of references that becomes a node.
pub struct Range<'r> {
    /// The references, followed by free room for the copies that spatial splits make.
    pub room: &'r mut [Ref],
    /// Number of references.
    pub len: usize,
    /// Index of the first among all references.
    pub first: usize,
    /// Extents of the references.
    pub extents: Extents,
}

/// Builds the tree over the references of `room`: one for each triangle, followed by free room for copies (without it
/// there are no spatial splits). The references are reordered: leaves are ranges of them. `stretch` has a unit for each
/// reference.
pub fn build(input: TreeInput, room: &mut [Ref], mesh_half_area: f32, par: &Par, stretch: &Stretch) -> Result<Built> {
    let len = input.triangles.len();
    let extents = Extents::of(&room[..len], par);
    let bounds = extents.bounds();
    let builder = Builder { input, par, stretch, mesh_half_area: bounds.half_area().max(mesh_half_area) };
    let (children, counts) = builder.children(Range { room, len, first: 0, extents }, 1)?;
    Ok(Built { children, bounds, counts })
}

/// Puts a node of its own over each leaf of a node that stays above the fine units: coarse blocks hold no triangles.
/// Returns the number of these nodes.
pub fn wrap_leaves(pieces: &mut Vec<Piece>) -> u64 {
    // An upper bound: the numbers of samples are not known yet.
    let words = pieces.iter().map(|p| p.sub.words() + (VOXEL_WORDS + SIDES_WORDS) as u32);
    if NODE_WORDS as u32 + 1 + words.sum::<u32>() <= FINE_WORDS {
        return 0;
    }
    let is_leaf = |p: &Piece| matches!(p.sub, Sub::Leaf { .. });
    let wrapped = pieces.iter().filter(|p| is_leaf(p)).count() as u64;
    let wrap = |p: Piece| match is_leaf(&p) {
        true => {
            let place = p.place;
            InnerNode::over(vec![p], place)
        }
        false => p,
    };
    *pieces = std::mem::take(pieces).into_iter().map(wrap).collect();
    wrapped
}

/// Returns the voxel of a leaf's triangles. A triangle of which only a part lies in the leaf counts as a whole.
pub fn leaf_voxel(cell: &Bounds, refs: &[Ref], input: TreeInput) -> Voxel {
    let mut facets = [Facet { normal: Vec3::ZERO, colour: Vec3::ZERO, part: 0, is_own_colour: false }; MAX_TRIANGLES];
    for (facet, r) in facets.iter_mut().zip(refs) {
        let i = r.triangle();
        let [a, b, c] = input.triangles[i];
        let (colour, is_own_colour) = input.colour(i);
        *facet = Facet { normal: (b - a).cross(c - a), colour, part: input.parts[i], is_own_colour };
    }
    Voxel::of_leaf(cell, &facets[..refs.len().clamp(1, MAX_TRIANGLES)])
}

impl Builder<'_> {
    fn inner(&self, range: Range, depth: u32) -> Result<(Piece, Counts)> {
        let place = if range.len <= TREELET { Place::Begins } else { Place::Above };
        let (pieces, counts) = self.children(range, depth)?;
        Ok((InnerNode::over(pieces, place), counts))
    }

    /// Returns the children of a node over `range`, and the counts of that node.
    fn children(&self, range: Range, depth: u32) -> Result<(Vec<Piece>, Counts)> {
        self.stretch.check()?;
        if range.len <= SMALL {
            let len = range.len as u64;
            let done = small::children(self, range);
            self.stretch.did(len);
            return Ok(done);
        }
        let ranges = self.split_up(range, depth)?;
        let done = self.par.map_items(ranges, |r| self.inner(r, depth + 1));
        let mut pieces = Vec::with_capacity(done.len());
        let mut counts = Counts { nodes: 1, ..Counts::default() };
        for child in done {
            let (piece, below) = child?;
            pieces.push(piece);
            counts.add_below(below);
        }
        counts.depth += 1;
        Ok((pieces, counts))
    }

    /// Splits a range into up to eight, the one with the largest box first. Small ranges are not split. Fails once
    /// cancelled.
    fn split_up<'r>(&self, range: Range<'r>, depth: u32) -> Result<Vec<Range<'r>>> {
        let mut ranges = Vec::with_capacity(WIDTH);
        ranges.push(range);
        while ranges.len() < WIDTH {
            self.stretch.check()?;
            let area = |r: &Range| r.extents.bounds().half_area();
            let open = (0..ranges.len()).filter(|&i| ranges[i].len > SMALL);
            // The first of the largest: `max_by` would take the last.
            let Some(at) = open.reduce(|a, b| if area(&ranges[b]) > area(&ranges[a]) { b } else { a }) else {
                break;
            };
            let Range { room, len, first, extents } = ranges.swap_remove(at);
            let split = if depth < DEEP { sah::find(&room[..len], &extents, self.par) } else { None };
            ranges.extend(self.halve(room, len, first, &extents, split));
        }
        ranges.sort_by_key(|r| r.first);
        Ok(ranges)
    }

    /// Splits the first `len` references of `room`, which begins at `first`, in two: by `split`, or by a spatial split
    /// if there is free room and that is better; without either, in equal parts.
    #[inline(never)] // `small` is recursive: its stack frames should be small
    pub fn halve<'r>(
        &self,
        room: &'r mut [Ref],
        len: usize,
        first: usize,
        extents: &Extents,
        split: Option<Split>,
    ) -> [Range<'r>; 2] {
        let spatial = split.as_ref().and_then(|split| self.spatial(&room[..len], room.len(), extents, split));
        let divided = spatial.and_then(|s| spatial::partition(room, len, &s, self.input.triangles, self.par));
        let (len, sides) = divided.unwrap_or_else(|| {
            let refs = &mut room[..len];
            let sides = match &split {
                Some(split) => partition::by_split(refs, split, self.par),
                None => partition::by_median(refs, extents, self.par),
            };
            (len, sides)
        });
        share_room(room, len, sides, first)
    }

    /// Returns the best spatial split, if it is better than the object split.
    fn spatial(&self, refs: &[Ref], room: usize, extents: &Extents, split: &Split) -> Option<SpatialSplit> {
        if room == refs.len() || !spatial::is_worth_a_look(split, self.mesh_half_area) {
            return None;
        }
        let found = spatial::find(refs, self.input.triangles, &extents.bounds(), self.par)?;
        (found.cost < split.cost).then_some(found)
    }
}

/// Divides the free room after `len` between the sides, in proportion to their sizes.
fn share_room(room: &mut [Ref], len: usize, sides: Sides, first: usize) -> [Range<'_>; 2] {
    let Sides { middle, left, right } = sides;
    let free = room.len() - len;
    let of_left = (free as u64 * middle as u64 / len as u64) as usize;
    if of_left > 0 {
        room.copy_within(middle..len, middle + of_left);
    }
    let (a, b) = room.split_at_mut(middle + of_left);
    [
        Range { room: a, len: middle, first, extents: left },
        Range { room: b, len: len - middle, first: first + middle + of_left, extents: right },
    ]
}

/// True if a split is expected to cost less than a leaf.
pub fn pays(extents: &Extents, len: usize, split: &Split) -> bool {
    let stay = extents.bounds().half_area() * (LEAF_COST + TRIANGLE_COST * len as f32);
    split.side_areas * LEAF_COST + TRIANGLE_COST * split.cost < stay
}
