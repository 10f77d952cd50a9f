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
const DEEPEST: u32 = 64;

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
enum Stopped {
    /// The tree has more children, triangles or levels than a form can hold.
    Impossible,
    Missing(BlockId),
}

/// Returns the size of a tree's resident form; `None` if the tree is empty or the form cannot hold it. Fails with the
/// first block that is missing.
pub fn measure(tree: &Tree) -> std::result::Result<Option<Size>, BlockId> {
    let Some(root) = tree.root() else { return Ok(None) };
    let mut make = Make { tree, size: Size::default(), form: None, triangles: Vec::new() };
    match make.node(root, 0) {
        Ok(_) => Ok(Some(make.size).filter(|size| size.words <= MOST_WORDS && size.nodes <= MOST_NODES)),
        Err(Stopped::Impossible) => Ok(None),
        Err(Stopped::Missing(block)) => Err(block),
    }
}

/// Returns the resident form of a tree that has this size; `None` if it is another tree. Fails with `NoMemory`.
pub fn build(tree: &Tree, size: Size) -> Result<Option<Resident>> {
    let Some(root) = tree.root() else { return Ok(None) };
    let form = Resident {
        nodes: room(size.nodes as usize, WHAT)?,
        leaves: room(size.words as usize + HEAD + ROWS, WHAT)?,
        parts: room(size.parts as usize, WHAT)?,
        max_coord: tree.max_coord(),
    };
    let mut make = Make { tree, size: Size::default(), form: Some(form), triangles: Vec::new() };
    let is_made = make.node(root, 0).is_ok() && make.size == size;
    let Some(mut form) = make.form.filter(|_| is_made) else { return Ok(None) };
    form.leaves.resize(form.leaves.len() + HEAD + ROWS, 0.0);
    Ok(Some(form))
}

struct Make<'a> {
    tree: &'a Tree<'a>,
    size: Size,
    /// Without a form only sizes are added.
    form: Option<Resident>,
    /// Scratch space for the triangles of one leaf.
    triangles: Vec<(TriHit, Triangle)>,
}

impl Make<'_> {
    /// Adds the node at a place, and all below. Returns its link and the box around all of it.
    fn node(&mut self, place: Place, depth: u32) -> std::result::Result<(u32, Bounds), Stopped> {
        let (mut children, mut count, mut triangles) = ([None; WIDTH], 0, 0);
        let mut child = |place: Place, bounds: &Bounds, is_leaf: bool| {
            if let Some(child) = children.get_mut(count) {
                *child = Some((place, *bounds, is_leaf));
            }
            count += 1;
        };
        let mut below = Below { child: &mut child, triangle: &mut |_, _| triangles += 1 };
        self.tree.expand(place, &mut below).map_err(Stopped::Missing)?;
        if depth > DEEPEST || count > WIDTH || triangles > 0 {
            return Err(Stopped::Impossible);
        }
        let index = self.size.nodes as usize;
        self.size.nodes += 1;
        if let Some(form) = &mut self.form {
            form.nodes.push(Node::NONE);
        }
        let mut all = Bounds::EMPTY;
        for (slot, (place, bounds, is_leaf)) in children.into_iter().flatten().enumerate() {
            let (link, content) = if is_leaf { self.leaf(place)? } else { self.node(place, depth + 1)? };
            // A spatial split cuts what a leaf holds: the box of the blocks is then the smaller one.
            let tight = content.intersection(bounds);
            let Some(form) = self.form.as_mut().filter(|_| link != NOTHING && !tight.is_empty()) else { continue };
            all = all.union(tight);
            let node = &mut form.nodes[index];
            node.child[slot] = link;
            node.valid |= 1 << slot;
            for axis in 0..3 {
                (node.planes[axis][slot], node.planes[axis + 3][slot]) = (tight.min[axis], tight.max[axis]);
            }
        }
        Ok((index as u32, all))
    }

    /// Adds the leaf at a place. Returns its link and the bounds of its triangles.
    fn leaf(&mut self, place: Place) -> std::result::Result<(u32, Bounds), Stopped> {
        let Self { tree, size, form, triangles } = self;
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
        let is_mixed = triangles.iter().any(|(_, triangle)| triangle.part != part);
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
