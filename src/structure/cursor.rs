//! The cursor: a descent through a tree of any structure that follows no ray. Overlap queries, prefetch and queries
//! about the surroundings of a tree use it.

use super::hit::{TriHit, Triangle};
use super::place::{Place, Rooted};
use super::tree::Tree;
use crate::base::ids::BlockId;
use crate::math::Bounds;

/// Receives the children and triangles below a place.
pub struct Below<'a> {
    /// Receives each child: its place, a box relative to the tree's origin that holds everything below and is rounded
    /// outward, and true if only triangles are below it.
    pub child: &'a mut dyn FnMut(Place, &Bounds, bool),
    /// Receives each triangle of a leaf.
    pub triangle: &'a mut dyn FnMut(&TriHit, &Triangle),
}

/// Remaining places of a visit to the leaves of a tree. The visit can stop at missing blocks and continue later.
#[derive(Debug, Clone, Default)]
pub struct Descent {
    left: Vec<Place>,
}

impl Descent {
    /// A visit of the whole tree.
    pub fn new(tree: &Tree) -> Self {
        Self { left: tree.root().into_iter().collect() }
    }

    /// Bytes of memory in addition to the visit itself.
    pub fn bytes(&self) -> u64 {
        (self.left.capacity() * size_of::<Place>()) as u64
    }

    /// Returns the blocks that the visit waits for; a block may occur several times. If there are none, the visit has
    /// ended.
    pub fn missing(&self) -> impl Iterator<Item = BlockId> {
        self.left.iter().map(|place| BlockId(place.block))
    }

    /// Visits the triangles of those remaining leaves that are in memory and lie below boxes that `descend` accepts.
    /// The caller calls again with the same tests once some of the [missing blocks](Self::missing) are in memory.
    ///
    /// `descend` receives boxes relative to the tree's origin, rounded outward. A triangle that spatial splits put into
    /// several leaves is visited several times.
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
                // The stack pops the last entry first; reversed, the first child is visited first.
                Ok(()) => stack[bottom..].reverse(),
                Err(_) => self.left.push(place),
            }
        }
    }
}

/// Visits all triangles of a tree. Fails with the first block that is missing.
pub fn for_each_triangle(tree: &Tree, visit: &mut dyn FnMut(&TriHit, &Triangle)) -> Result<(), BlockId> {
    let mut descent = Descent::new(tree);
    descent.go_on(tree, &mut |_| true, visit);
    descent.missing().next().map_or(Ok(()), Err)
}
