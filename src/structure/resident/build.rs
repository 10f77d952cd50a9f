//! Makes the resident form of a tree of any structure, by its cursor.

use super::WHAT;
use super::layout::{HEAD, LEAF, MAX_TRIANGLES, MIXED, NOTHING, Node, ROWS, Resident, UNIT, WIDTH};
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::memory::room;
use crate::math::Bounds;
use crate::structure::cursor::Below;
use crate::structure::hit::{TriHit, Triangle};
use crate::structure::place::{Place, Rooted};
use crate::structure::tree::Tree;

/// Most words of leaves, and most nodes: what links can refer to.
const MOST_WORDS: u64 = (UNIT as u64) << 28;
const MOST_NODES: u64 = LEAF as u64;
/// Most levels of nodes.
const DEEPEST: usize = 64;

/// The size of a resident form.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Size {
    nodes: u64,
    /// Words of leaves, without those behind the last.
    words: u64,
    parts: u64,
}

impl Size {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        self.nodes * size_of::<Node>() as u64 + 4 * (self.words + (HEAD + ROWS) as u64 + self.parts)
    }
}

/// The reason why a form is not made.
pub enum Stopped {
    /// The tree has more children, triangles or levels than a form can hold.
    Impossible,
    /// A block is not in memory.
    Missing(BlockId),
}

/// A child of a node: its place, its box, and true if it is a leaf.
type Child = (Place, Bounds, bool);

/// A node whose children are being added.
struct Open {
    index: usize,
    children: [Option<Child>; WIDTH],
    /// The next child to add.
    slot: usize,
    /// The box around those that were added.
    all: Bounds,
}

/// A form in the making, or only its size. It goes on node by node, so that a caller can do some at a time, each time
/// in another snapshot.
pub struct Make {
    size: Size,
    form: Option<Resident>,
    /// The nodes from the root to the present one.
    open: Vec<Open>,
    /// Scratch space for the triangles of one leaf.
    triangles: Vec<(TriHit, Triangle)>,
}

impl Make {
    /// Measures the form of a tree.
    pub fn measuring(tree: &Tree) -> std::result::Result<Self, Stopped> {
        Self::begun(tree, None)
    }

    /// Makes the form of a tree of this size. Fails with `NoMemory`.
    pub fn making(tree: &Tree, size: Size) -> Result<std::result::Result<Self, Stopped>> {
        let form = Resident {
            nodes: room(size.nodes as usize, WHAT)?,
            leaves: room(size.words as usize + HEAD + ROWS, WHAT)?,
            parts: room(size.parts as usize, WHAT)?,
            max_coord: tree.max_coord(),
        };
        Ok(Self::begun(tree, Some(form)))
    }

    fn begun(tree: &Tree, form: Option<Resident>) -> std::result::Result<Self, Stopped> {
        let mut make = Self { size: Size::default(), form, open: Vec::new(), triangles: Vec::new() };
        let root = tree.root().ok_or(Stopped::Impossible)?;
        make.enter(tree, root)?;
        Ok(make)
    }

    /// The size so far.
    pub fn size(&self) -> Size {
        self.size
    }

    /// The form, once it is complete; `None` if it does not have this size, or was only measured.
    pub fn finish(self, size: Size) -> Option<Resident> {
        let mut form = self.form.filter(|_| self.size == size && self.open.is_empty())?;
        form.leaves.resize(form.leaves.len() + HEAD + ROWS, 0.0);
        Some(form)
    }

    /// Adds up to `steps` nodes and leaves. Returns true once all are added.
    pub fn go_on(&mut self, tree: &Tree, steps: usize) -> std::result::Result<bool, Stopped> {
        for _ in 0..steps {
            let Some(top) = self.open.last_mut() else { return Ok(true) };
            let Some(&Some((place, bounds, is_leaf))) = top.children.get(top.slot) else {
                let closed = self.open.pop();
                if let (Some(closed), Some(_)) = (closed, self.open.last()) {
                    self.close(closed.index as u32, closed.all);
                }
                continue;
            };
            if is_leaf {
                let (link, content) = self.leaf(tree, place)?;
                // A spatial split cuts what a leaf holds: the box of the blocks is then the smaller one.
                self.close(link, content.intersection(bounds));
            } else {
                self.enter(tree, place)?;
            }
        }
        Ok(self.open.is_empty())
    }

    /// Links the present child of the uppermost open node to what was made of it, in this box.
    fn close(&mut self, link: u32, content: Bounds) {
        let Some(top) = self.open.last_mut() else { return };
        let slot = top.slot;
        top.slot += 1;
        let bounds = top.children[slot].map_or(Bounds::EMPTY, |(_, bounds, _)| bounds);
        let tight = content.intersection(bounds);
        let Some(form) = self.form.as_mut().filter(|_| link != NOTHING && !tight.is_empty()) else { return };
        top.all = top.all.union(tight);
        let node = &mut form.nodes[top.index];
        node.child[slot] = link;
        node.valid |= 1 << slot;
        for axis in 0..3 {
            (node.planes[axis][slot], node.planes[axis + 3][slot]) = (tight.min[axis], tight.max[axis]);
        }
    }

    /// Adds the node at a place, whose children follow.
    fn enter(&mut self, tree: &Tree, place: Place) -> std::result::Result<(), Stopped> {
        let (mut children, mut count, mut triangles) = ([None; WIDTH], 0, 0);
        let mut child = |place: Place, bounds: &Bounds, is_leaf: bool| {
            if let Some(child) = children.get_mut(count) {
                *child = Some((place, *bounds, is_leaf));
            }
            count += 1;
        };
        let mut below = Below { child: &mut child, triangle: &mut |_, _| triangles += 1 };
        tree.expand(place, &mut below).map_err(Stopped::Missing)?;
        let is_too_large = self.size.words > MOST_WORDS || self.size.nodes > MOST_NODES;
        if self.open.len() >= DEEPEST || count > WIDTH || triangles > 0 || is_too_large {
            return Err(Stopped::Impossible);
        }
        let index = self.size.nodes as usize;
        self.size.nodes += 1;
        if let Some(form) = &mut self.form {
            form.nodes.push(Node::NONE);
        }
        self.open.push(Open { index, children, slot: 0, all: Bounds::EMPTY });
        Ok(())
    }

    /// Adds the leaf at a place. Returns its link and the bounds of its triangles.
    fn leaf(&mut self, tree: &Tree, place: Place) -> std::result::Result<(u32, Bounds), Stopped> {
        let Self { size, form, triangles, .. } = self;
        triangles.clear();
        let mut children = 0;
        let mut triangle = |hit: &TriHit, triangle: &Triangle| triangles.push((*hit, *triangle));
        let mut below = Below { child: &mut |_, _, _| children += 1, triangle: &mut triangle };
        tree.expand(place, &mut below).map_err(Stopped::Missing)?;
        let Some(&(first, Triangle { part, .. })) = triangles.first() else { return Ok((NOTHING, Bounds::EMPTY)) };
        let n = triangles.len();
        let is_row =
            triangles.iter().zip(first.tri..).all(|((hit, _), tri)| (hit.block, hit.tri) == (first.block, tri));
        if children > 0 || n > MAX_TRIANGLES || !is_row {
            return Err(Stopped::Impossible);
        }
        // A file may state any part.
        let is_mixed = part & MIXED != 0 || triangles.iter().any(|(_, triangle)| triangle.part != part);
        let (at, parts_at) = (size.words, size.parts);
        size.words += (HEAD + 9 * n).next_multiple_of(UNIT) as u64;
        size.parts += if is_mixed { n as u64 } else { 0 };
        let Some(form) = form else { return Ok((NOTHING, Bounds::EMPTY)) };
        if is_mixed {
            form.parts.extend(triangles.iter().map(|(_, triangle)| triangle.part));
        }
        let parts = if is_mixed { parts_at as u32 | MIXED } else { part };
        form.leaves.extend([first.block, first.tri, parts].map(f32::from_bits));
        for row in 0..9 {
            form.leaves.extend(triangles.iter().map(|(_, triangle)| triangle.vertices[row / 3][row % 3]));
        }
        form.leaves.resize(size.words as usize, 0.0);
        let corners = |bounds: Bounds, (_, triangle): &(TriHit, Triangle)| bounds.union(Bounds::of(&triangle.vertices));
        let bounds = triangles.iter().fold(Bounds::EMPTY, corners);
        Ok((LEAF | ((at / UNIT as u64) as u32) << 3 | (n as u32 - 1), bounds))
    }
}
