//! The cursor: one way to walk down a tree of any structure that is not the way of a ray. Overlap, prefetch and what is
//! asked of a tree's surroundings go by it.

use super::hit::{TriHit, Triangle};
use super::place::{Place, Rooted};
use super::tree::Tree;
use crate::base::ids::BlockId;
use crate::math::Bounds;

/// Takes what is below a place.
pub struct Below<'a> {
    /// Takes each child: its place, a box around the tree's origin that holds all that is below, rounded outward, and
    /// whether nothing but triangles is below it.
    pub child: &'a mut dyn FnMut(Place, &Bounds, bool),
    /// Takes each triangle of a leaf.
    pub triangle: &'a mut dyn FnMut(&TriHit, &Triangle),
}

/// What is left of a visit to the leaves of a tree. It can be put down at missing blocks and taken up again.
#[derive(Debug, Clone, Default)]
pub struct Descent {
    left: Vec<Place>,
}

impl Descent {
    /// Of the whole tree.
    pub fn new(tree: &Tree) -> Self {
        Self { left: tree.root().into_iter().collect() }
    }

    /// The blocks that it waits for; some may be named several times. None: it has ended.
    pub fn missing(&self) -> impl Iterator<Item = BlockId> {
        self.left.iter().map(|place| BlockId(place.block))
    }

    /// Visits the triangles of the leaves that are in memory of those that are left, below boxes that `descend`
    /// accepts. Call it again with the same tests once some of what is [missing](Self::missing) is there.
    ///
    /// `descend` gets boxes around the tree's origin, rounded outward. A triangle that spatial splits put into several
    /// leaves is visited several times.
    pub fn go_on(
        &mut self,
        tree: &Tree,
        descend: &mut dyn FnMut(&Bounds) -> bool,
        visit: &mut dyn FnMut(&TriHit, &Triangle),
    ) {
        let mut stack = std::mem::take(&mut self.left);
        while let Some(place) = stack.pop() {
            let bottom = stack.len();
            let mut child = |place, bounds: &Bounds, _| {
                if descend(bounds) {
                    stack.push(place);
                }
            };
            match tree.expand(place, &mut Below { child: &mut child, triangle: visit }) {
                // The first child is visited first.
                Ok(()) => stack[bottom..].reverse(),
                Err(_) => self.left.push(place),
            }
        }
    }
}

/// Visits all triangles of a tree; fails with the first block that is missing.
pub fn for_each_triangle(tree: &Tree, visit: &mut dyn FnMut(&TriHit, &Triangle)) -> Result<(), BlockId> {
    let mut descent = Descent::new(tree);
    descent.go_on(tree, &mut |_| true, visit);
    descent.missing().next().map_or(Ok(()), Err)
}
