//! Nodes and leaves in rows.

use super::super::layout::{Block, Child, WIDTH};
use super::TreeView;
use crate::base::ids::BlockId;
use crate::structure::hit::TriHit;
use crate::structure::place::Place;
use crate::structure::rows::{COLUMNS, PartsBelow, Rows, VERTICES};

const _: () = assert!(WIDTH == COLUMNS);
const _: () = assert!(super::super::layout::MAX_TRIANGLES == COLUMNS && super::super::layout::MAX_VERTICES == VERTICES);

impl TreeView<'_> {
    /// See [`crate::structure::Tree::rows`].
    #[inline]
    pub fn rows(&self, place: Place, parts: bool, rows: &mut Rows) -> Result<(), BlockId> {
        let Place { block: id, item: child } = place;
        let block = Block::new(self.visit(id).ok_or(BlockId(id))?);
        (rows.count, rows.is_leaf, rows.leaves) = (0, false, 0);
        match Child::from_bits(child) {
            Some(Child::Node(index)) => {
                let node = block.node(index);
                let mut planes = [[0; WIDTH]; 6];
                for slot in (0..WIDTH).filter(|slot| node.valid >> slot & 1 == 1) {
                    let (child, at) = (u32::from(node.child[slot]), rows.count);
                    let (to, item) = match Child::from_bits(child) {
                        Some(Child::External(at)) => block.external(at),
                        _ => (self.home_of(id, child), child),
                    };
                    rows.places[at] = Place { block: to, item };
                    rows.leaves |= u32::from(Child::is_leaf(child)) << at;
                    planes.iter_mut().zip(&node.planes).for_each(|(out, row)| out[at] = row[slot]);
                    if parts {
                        let voxel = block.voxel_of(index, at);
                        let (part, is_mixed) = voxel.part();
                        let part = if is_mixed { PartsBelow::SEVERAL } else { part };
                        rows.below[at] = PartsBelow { part, bits: voxel.summary() };
                    }
                    rows.count += 1;
                }
                for (row, (out, planes)) in rows.bounds.iter_mut().zip(&planes).enumerate() {
                    let (step, origin) = (node.step(row % 3), node.origin[row % 3]);
                    // As walks use them: see `Node::stored_box`.
                    for (out, plane) in out.iter_mut().zip(planes) {
                        *out = f32::from(*plane) * step + origin;
                    }
                }
            }
            Some(Child::Leaf(at)) => {
                let leaf = block.leaf(at);
                (rows.count, rows.is_leaf) = (leaf.triangles.min(COLUMNS), true);
                for axis in 0..3 {
                    rows.vertices[axis] = leaf.coordinates(axis).to_array();
                    rows.corners[axis] = *leaf.corners8(axis);
                }
                for i in 0..rows.count {
                    rows.parts[i] = block.part(leaf.part_of(i));
                }
                rows.first = TriHit { block: id, tri: (at as u32) << 3, ..TriHit::none(0.0) };
            }
            // A place never holds an external reference.
            Some(Child::External(_)) | None => {}
        }
        Ok(())
    }
}
