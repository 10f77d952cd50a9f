//! Nodes and leaves in rows.

use super::super::layout::{Block, Child, WIDTH};
use super::TreeView;
use crate::base::ids::BlockId;
use crate::math::bits;
use crate::structure::hit::TriHit;
use crate::structure::place::Place;
use crate::structure::rows::{COLUMNS, PartsBelow, Rows, VERTICES};

const _: () = assert!(WIDTH == COLUMNS);
const _: () = assert!(super::super::layout::MAX_TRIANGLES == COLUMNS && super::super::layout::MAX_VERTICES == VERTICES);

impl TreeView<'_> {
    /// See [`crate::structure::Tree::rows`].
    #[inline(always)]
    pub fn rows(&self, place: Place, parts: bool, rows: &mut Rows) -> Result<(), BlockId> {
        let Place { block: id, item } = place;
        let block = Block::new(self.visit(id).ok_or(BlockId(id))?);
        (rows.mask, rows.is_leaf, rows.leaves) = (0, false, 0);
        match Child::from_bits(item) {
            Child::Node(index) => {
                let node = block.node(index);
                for row in 0..6 {
                    let (step, origin) = (node.step(row % 3), node.origin[row % 3]);
                    // As walks use them: see `Node::stored_box`.
                    for i in 0..COLUMNS {
                        rows.bounds[row][i] = f32::from(node.planes[row][i]) * step + origin;
                    }
                }
                rows.mask = node.valid.into();
                for (number, slot) in bits(rows.mask).enumerate() {
                    let slot = slot % WIDTH;
                    let child = u32::from(node.child[slot]);
                    let (block_of, item) = match Child::from_bits(child) {
                        Child::External(at) => block.external(at),
                        _ => (self.home_of(id, child), child),
                    };
                    rows.places[slot] = Place { block: block_of, item };
                    rows.leaves |= u32::from(Child::is_leaf(child)) << slot;
                    if parts {
                        let voxel = block.voxel_of(index, number);
                        let (part, is_mixed) = voxel.part();
                        let part = if is_mixed { PartsBelow::SEVERAL } else { part };
                        rows.below[slot] = PartsBelow { part, bits: voxel.summary() };
                    }
                }
            }
            Child::Leaf(at) => {
                let leaf = block.leaf(at);
                let count = leaf.triangles.min(COLUMNS);
                (rows.mask, rows.is_leaf) = ((1 << count) - 1, true);
                for axis in 0..3 {
                    rows.vertices[axis] = leaf.coordinates(axis).to_array();
                    rows.corners[axis] = *leaf.corners8(axis);
                }
                for i in 0..count {
                    rows.parts[i] = block.part(leaf.part_of(i));
                }
                rows.first = TriHit { block: id, tri: (at as u32) << 3, ..TriHit::none(0.0) };
            }
            // A place never holds an external reference.
            Child::External(_) | Child::Member(_) => {}
        }
        Ok(())
    }
}
