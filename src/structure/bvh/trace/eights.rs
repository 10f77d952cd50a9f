//! Children and leaves by lanes, straight from the words of a block: see [`crate::structure::eight`].

use super::TreeView;
use crate::base::ids::BlockId;
use crate::structure::bvh::layout::{Block, Child, MAX_VERTICES, Node, WIDTH};
use crate::structure::bvh::leaf::Leaf;
use crate::structure::eight::{EIGHT, Eight};
use crate::structure::place::Place;

const _: () = assert!(WIDTH == EIGHT);

impl TreeView<'_> {
    /// See [`crate::structure::Tree::eights`]. A node and a leaf have one each.
    #[inline(always)]
    pub fn eights(&self, place: Place, out: &mut Eight, each: &mut impl FnMut(&Eight)) -> Result<(), BlockId> {
        let Place { block: id, item } = place;
        let block = Block::new(self.visit(id).ok_or(BlockId(id))?);
        match Child::from_bits(item) {
            Some(Child::Node(index)) => {
                let node = block.node(index);
                planes(node, out);
                self.children(&block, id, node, out);
                each(out);
            }
            Some(Child::Leaf(at)) => {
                let leaf = block.leaf(at);
                corners(&leaf, out);
                for i in 0..leaf.triangles.min(EIGHT) {
                    out.parts[i] = block.part(leaf.part_of(i));
                    out.items[i] = (at as u32) << 3 | i as u32;
                }
                (out.mask, out.is_leaf, out.block) = ((1 << leaf.triangles.min(EIGHT)) - 1, true, id);
                each(out);
            }
            // A place never holds an external reference.
            Some(Child::External(_)) | None => {}
        }
        Ok(())
    }

    #[inline(always)]
    fn children(&self, block: &Block, id: u32, node: &Node, out: &mut Eight) {
        (out.mask, out.is_leaf, out.leaves) = (node.valid.into(), false, 0);
        let mut left = out.mask;
        while left != 0 {
            let slot = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            let child = u32::from(node.child[slot]);
            out.places[slot] = match Child::from_bits(child) {
                Some(Child::External(at)) => {
                    let (block, item) = block.external(at);
                    Place { block, item }
                }
                _ => Place { block: self.home_of(id, child), item: child },
            };
            out.leaves |= u32::from(Child::is_leaf(child)) << slot;
        }
    }
}

/// The planes of all children. Products with a power of two are exact, and double precision rounds the sums.
#[inline(always)]
fn planes(node: &Node, out: &mut Eight) {
    for row in 0..6 {
        let (step, from) = (f64::from(node.step(row % 3)), f64::from(node.origin[row % 3]));
        for lane in 0..EIGHT {
            out.bounds[row][lane] = f64::from(node.planes[row][lane]) * step + from;
        }
    }
}

/// The corners of all triangles of a leaf.
#[inline(always)]
fn corners(leaf: &Leaf, out: &mut Eight) {
    let axes = [0, 1, 2].map(|axis| leaf.coordinates(axis).to_array());
    for (c, corner) in out.corners.iter_mut().enumerate() {
        let numbers = leaf.corners8(c);
        for (axis, lanes) in corner.iter_mut().enumerate() {
            for lane in 0..EIGHT {
                lanes[lane] = f64::from(axes[axis][usize::from(numbers[lane]) % MAX_VERTICES]);
            }
        }
    }
}
