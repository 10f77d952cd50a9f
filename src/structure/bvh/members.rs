//! Trees over **members**: over boxes with numbers instead of triangles. A scene has one over its placed trees. It has
//! the nodes of the bvh, so rays walk it by the same code ([`Members::tree`]); a walk that reaches a member says so
//! ([`crate::structure::Outcome::Member`]). Its blocks are always in memory.

use super::build::members as build;
use super::layout::{self, Block, MAX_NODES};
use super::trace::TreeView;
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::math::{Bounds, bits};
use crate::residency::{Slot, Snapshot};
use crate::simd::Isa;
use crate::structure::tree::{Blocks, NEVER, Tree};

/// A child of a node of a tree over members.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Child {
    /// A node, by its number.
    Node(u32),
    /// A member, by its number.
    Member(u32),
}

/// A tree over members.
#[derive(Debug)]
pub struct Members {
    blocks: Snapshot,
    root: u32,
    max_coord: f32,
}

impl Members {
    /// Upper bound of the bytes of memory for each member, while the tree is built.
    pub const BYTES_EACH: usize = build::BYTES_EACH;
    /// Greatest number of members.
    pub const MOST: usize = build::MOST;

    /// Builds a tree over the members of `boxes`, at least two: their numbers, below 2^31, and their boxes, which are
    /// not empty. The same input gives the same tree. Fails with `NoMemory`.
    pub fn build(boxes: impl ExactSizeIterator<Item = (u32, Bounds)>) -> Result<Self> {
        let mut max_coord = f32::MIN_POSITIVE;
        let measured = |(number, b): (u32, Bounds)| {
            max_coord = max_coord.max(b.min.abs().max(b.max.abs()).max_element());
            (number, b)
        };
        let built = build::build(boxes.map(measured))?;
        let count = built.len() as u32;
        let slots = (0..).zip(built).map(|(id, words)| (BlockId(id), Slot::new(&words)));
        Ok(Self { blocks: Snapshot::empty(count).with(slots), root: count - 1, max_coord })
    }

    /// The tree, for walks.
    #[inline]
    pub fn tree(&self, isa: Isa) -> Tree<'_> {
        Tree::new(Blocks::Bvh(TreeView::over_members(&self.blocks, self.root, self.max_coord, isa)), None)
    }

    /// The number of the root.
    pub fn root(&self) -> u32 {
        number_of(self.root, 0)
    }

    /// Greatest magnitude of a coordinate.
    pub fn max_coord(&self) -> f32 {
        self.max_coord
    }

    /// Calls `visit` with the children of a node, at most eight, and their boxes.
    #[inline]
    pub fn children(&self, node: u32, visit: impl FnMut(Child, Bounds)) {
        children(&self.blocks, node, visit);
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        (0..self.blocks.blocks())
            .filter_map(|id| self.blocks.block(BlockId(id)))
            .map(|words| 4 * words.len() as u64)
            .sum()
    }
}

/// The number of a node: its block times [`MAX_NODES`], plus its index there.
fn number_of(block: u32, index: u32) -> u32 {
    block * MAX_NODES as u32 + index
}

#[inline]
fn children(blocks: &Snapshot, node: u32, mut visit: impl FnMut(Child, Bounds)) {
    let (id, index) = (node / MAX_NODES as u32, node % MAX_NODES as u32);
    let Some(words) = blocks.block(BlockId(id)) else { return };
    let block = Block::new(words);
    let node = block.node(index as usize);
    for slot in bits(node.valid.into()) {
        let child = match layout::Child::from_bits(node.child[slot].into()) {
            layout::Child::Node(index) => Child::Node(number_of(id, index as u32)),
            layout::Child::External(at) => {
                let (to, child) = block.external(at);
                let layout::Child::Node(index) = layout::Child::from_bits(child) else { continue };
                Child::Node(number_of(to, index as u32))
            }
            layout::Child::Member(at) => Child::Member(block.member(at)),
            layout::Child::Leaf(_) => continue,
        };
        visit(child, node.child_box(slot));
    }
}

impl<'a> TreeView<'a> {
    /// A tree over members, with all blocks in memory. Its root is the first node of a block.
    #[inline]
    fn over_members(snapshot: &'a Snapshot, root_block: u32, max_coord: f32, isa: Isa) -> Self {
        Self {
            snapshot,
            root_block,
            root: layout::Child::Node(0).to_bits().into(),
            max_coord,
            leaves_at: 0,
            prims_at: 0,
            colours_at: None,
            normals_at: None,
            isa,
            accept_missing: false,
            ties_by_place: false,
            stamp: 0,
            shown: None,
            proxies: None,
            stop: &NEVER,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{PACKET, bits};
    use crate::structure::{LocalRay, Outcome, PacketWalk, Walk};
    use glam::Vec3;

    /// Numbers in `low..high`, the same each time.
    fn numbers() -> impl FnMut(f32, f32) -> f32 {
        let mut state = 7u32;
        move |low, high| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / (1 << 24) as f32
        }
    }

    /// Boxes of many sizes, some of them in the same place, and rays through them. The origins of each packet are near
    /// each other.
    fn scene(count: u32) -> (Vec<(u32, Bounds)>, Vec<[LocalRay; PACKET]>) {
        let mut next = numbers();
        let boxes = (0..count).map(|i| {
            let at = if i % 50 == 7 { Vec3::ONE } else { Vec3::from([0; 3].map(|_| next(-20.0, 20.0))) };
            let size = Vec3::from([0; 3].map(|_| if i % 9 == 0 { 0.0 } else { next(0.0, 2.0) }));
            // Numbers need not be consecutive.
            (3 * i + 1, Bounds { min: at, max: at + size })
        });
        let boxes = boxes.collect();
        let packets = (0..60).map(|_| {
            let at = Vec3::from([0; 3].map(|_| next(-30.0, 30.0)));
            let dir = Vec3::from([0; 3].map(|_| next(-10.0, 10.0))) - at;
            std::array::from_fn(|_| {
                let dir = dir + Vec3::from([0; 3].map(|_| next(-2.0, 2.0)));
                LocalRay { org: at, dir, t_min: 0.0, t_max: next(0.5, 3.0), ..LocalRay::NONE }
            })
        });
        let packets = packets.collect();
        (boxes, packets)
    }

    /// True if a ray in double precision meets a box up to `t_max`.
    fn meets(ray: &LocalRay, b: &Bounds, t_max: f64) -> bool {
        let (mut enter, mut leave) = (0.0, t_max);
        for axis in 0..3 {
            let at = |plane: f32| (f64::from(plane) - f64::from(ray.org[axis])) / f64::from(ray.dir[axis]);
            let (a, b) = (at(b.min[axis]), at(b.max[axis]));
            (enter, leave) = (f64::max(enter, a.min(b)), f64::min(leave, a.max(b)));
        }
        enter <= leave
    }

    #[test]
    fn every_member_is_in_the_tree_once_and_in_all_boxes_above() {
        for count in [2, 3, 8, 9, 700, 40_000] {
            let (boxes, _) = scene(count);
            let tree = Members::build(boxes.iter().copied()).unwrap();
            assert!(tree.bytes() <= boxes.len() as u64 * Members::BYTES_EACH as u64 + 1024);
            let mut met = Vec::new();
            let everywhere = Bounds { min: Vec3::splat(f32::MIN), max: Vec3::splat(f32::MAX) };
            let mut todo = vec![(Child::Node(tree.root()), everywhere)];
            while let Some((child, around)) = todo.pop() {
                match child {
                    Child::Member(number) => {
                        assert!(around.contains(&boxes[number as usize / 3].1));
                        met.push(number);
                    }
                    Child::Node(node) => tree.children(node, |child, b| todo.push((child, b))),
                }
            }
            met.sort_unstable();
            assert_eq!(met, boxes.iter().map(|it| it.0).collect::<Vec<_>>());
        }
    }

    /// The walk of a ray comes to every member that the ray meets, nearer than the distance that it was shortened to.
    #[test]
    fn walks_come_to_all_members_that_rays_meet() {
        let (boxes, packets) = scene(4000);
        let members = Members::build(boxes.iter().copied()).unwrap();
        let (mut walk, mut packet, mut count) = (Walk::new(), PacketWalk::new(), 0);
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let tree = members.tree(isa);
            for rays in &packets {
                let expected = rays.map(|ray| {
                    let t_max = f64::from(ray.t_max);
                    boxes.iter().filter(|it| meets(&ray, &it.1, t_max)).map(|it| it.0).collect::<Vec<_>>()
                });
                let mut together = vec![Vec::new(); PACKET];
                packet.begin(&tree, rays, u32::MAX);
                while let Outcome::Member(number) = tree.closest_together(None, &mut packet) {
                    bits(packet.at_member()).for_each(|i| together[i].push(number));
                }
                for (i, ray) in rays.iter().enumerate() {
                    let mut met = Vec::new();
                    walk.begin(&tree, ray);
                    while let Outcome::Member(number) = tree.closest(None, &mut walk) {
                        met.push(number);
                    }
                    for number in &expected[i] {
                        assert!(met.contains(number) && together[i].contains(number), "{isa:?}: {number}");
                    }
                    count += expected[i].len();
                    assert!(met.len() <= 4 * expected[i].len() + 40, "{} of {}", met.len(), expected[i].len());
                    // A walk that is shortened to where it begins comes to no member that begins behind.
                    walk.begin(&tree, ray);
                    let mut first = Vec::new();
                    while let Outcome::Member(number) = tree.closest(None, &mut walk) {
                        walk.shorten(0.0);
                        first.push(number);
                    }
                    let behind = |number: &&u32| !meets(ray, &boxes[**number as usize / 3].1, 1e-3);
                    assert!(first.iter().skip(1).filter(behind).count() == 0);
                }
            }
        }
        assert!(count > 5000, "{count}");
    }
}
