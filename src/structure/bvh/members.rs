//! Trees over **members**: over boxes with numbers instead of triangles. A scene has one over its placed trees. It has
//! the nodes of the bvh, so rays walk it by the same code ([`Members::tree`]); a walk that reaches a member says so
//! ([`crate::structure::Outcome::Member`]). Its blocks are always in memory.
//!
//! If members are described ([`Members::build_described`]), a walk with a cone may end at a cell, which stands in for
//! all members below it: it is the walk's best hit, as in a tree of triangles. The voxel's part is then the number of
//! the member with the greatest visible area. Members never stand in themselves: the roots of their own trees do.

use super::appearance::{Appearance, MemberLook};
use super::build::members as build;
use super::layout::{self, Block, MAX_NODES};
use super::trace::TreeView;
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::math::{Bounds, bits};
use crate::residency::{Slot, Snapshot};
use crate::simd::Isa;
use crate::structure::tree::{Blocks, NEVER, Tree};
use std::collections::BTreeSet;
use std::sync::Arc;

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
    /// Blocks that differ from those of the build.
    changed: BTreeSet<u32>,
    appearance: Option<Arc<Appearance>>,
}

impl Members {
    /// Upper bound of the bytes of memory for each member, while the tree is built.
    pub const BYTES_EACH: usize = build::BYTES_EACH;

    /// The same if members are described.
    pub const BYTES_EACH_DESCRIBED: usize = build::BYTES_EACH_DESCRIBED;

    /// Builds a tree over the members of `boxes`, at least two: their numbers, below 2^31, and their boxes, which are
    /// not empty. No coordinate is greater than `max_coord` in magnitude; later moves may go that far too. The same
    /// input gives the same tree. Fails with `NoMemory`, and with `BadArgument` for more than some 1.8 billion. No cell
    /// of the tree stands in.
    pub fn build(boxes: impl ExactSizeIterator<Item = (u32, Bounds)>, max_coord: f32) -> Result<Self> {
        Self::of(build::build(boxes, None)?, max_coord)
    }

    /// Builds a tree as [`Members::build`] does, in which nodes stand in for the members below them. `look_of` returns
    /// what a member looks like; a node above one without a look never stands in, nor does one above a member with a
    /// number from 2^30 on. Each box holds its member's content, as placed by the look's map. Boxes of nodes may reach
    /// beyond those of the members by up to a fiftieth of the whole extent, and `max_coord` bounds these too.
    pub fn build_described<'a>(
        boxes: impl ExactSizeIterator<Item = (u32, Bounds)>,
        max_coord: f32,
        mut look_of: impl FnMut(u32) -> Option<MemberLook<'a>>,
    ) -> Result<Self> {
        Self::of(build::build(boxes, Some(&mut look_of))?, max_coord)
    }

    fn of((built, appearance): (Vec<Vec<u32>>, Option<Appearance>), max_coord: f32) -> Result<Self> {
        let count = built.len() as u32;
        let slots = (0..).zip(built).map(|(id, words)| (BlockId(id), Slot::new(&words)));
        let blocks = Snapshot::empty(count).with(slots);
        let appearance = appearance.map(Arc::new);
        Ok(Self { blocks, root: count - 1, max_coord, changed: BTreeSet::new(), appearance })
    }

    /// The tree, for walks.
    #[inline]
    pub fn tree(&self, isa: Isa) -> Tree<'_> {
        Tree::new(Blocks::Bvh(TreeView::over_members(&self.blocks, self.root, self.max_coord, isa)), None)
    }

    /// What the members look like together, for a tree over several such groups. `None` if not all are described, or
    /// some have moved.
    pub fn appearance(&self) -> Option<&Arc<Appearance>> {
        self.appearance.as_ref()
    }

    /// The number of the root.
    pub fn root(&self) -> u32 {
        number_of(self.root, 0)
    }

    /// Calls `visit` with the children of a node, at most eight, and their boxes.
    #[inline]
    pub fn children(&self, node: u32, mut visit: impl FnMut(Child, Bounds)) {
        let (id, index) = (node / MAX_NODES as u32, node as usize % MAX_NODES);
        let block = Block::new(self.block(id));
        let node = block.node(index);
        for slot in bits(node.valid.into()) {
            if let Some(child) = child_of(block, id, node.child[slot]) {
                visit(child, node.child_box(slot));
            }
        }
    }

    /// The words of a block.
    pub(super) fn block(&self, id: u32) -> &[u32] {
        self.blocks.block(BlockId(id)).unwrap_or_default()
    }

    /// The tree with some blocks replaced.
    pub(super) fn with_blocks(&self, blocks: Vec<(BlockId, Slot)>) -> Self {
        let mut changed = self.changed.clone();
        changed.extend(blocks.iter().map(|it| it.0.0));
        Self { blocks: self.blocks.with(blocks), changed, appearance: None, ..*self }
    }

    /// Bytes of memory of blocks that differ from those of the build.
    pub fn changed_bytes(&self) -> u64 {
        self.changed.iter().map(|id| 4 * self.block(*id).len() as u64).sum()
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
fn number_of(block: u32, index: usize) -> u32 {
    block * MAX_NODES as u32 + index as u32
}

/// The child that a reference in a block stands for; `None` for references that a tree over members has not.
#[inline]
pub(super) fn child_of(block: Block, id: u32, reference: u16) -> Option<Child> {
    match layout::Child::from_bits(reference.into()) {
        layout::Child::Node(index) => Some(Child::Node(number_of(id, index))),
        layout::Child::External(at) => {
            let (to, child) = block.external(at);
            let layout::Child::Node(index) = layout::Child::from_bits(child) else { return None };
            Some(Child::Node(number_of(to, index)))
        }
        layout::Child::Member(at) => Some(Child::Member(block.member(at))),
        layout::Child::Leaf(_) => None,
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
            has_members: true,
            proxies: None,
            stop: &NEVER,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{PACKET, bits};
    use crate::structure::{LocalRay, Move, Outcome, PacketWalk, Walk};
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

    /// All members, ascending; each is in all boxes above it.
    fn all_below(tree: &Members, box_of: impl Fn(u32) -> Bounds) -> Vec<u32> {
        let mut met = Vec::new();
        let everywhere = Bounds { min: Vec3::splat(f32::MIN), max: Vec3::splat(f32::MAX) };
        let mut todo = vec![(Child::Node(tree.root()), vec![everywhere])];
        while let Some((child, above)) = todo.pop() {
            match child {
                Child::Member(number) => {
                    assert!(above.iter().all(|b| b.contains(&box_of(number))));
                    met.push(number);
                }
                Child::Node(node) => {
                    tree.children(node, |child, b| todo.push((child, [&above[..], &[b]].concat())));
                }
            }
        }
        met.sort_unstable();
        met
    }

    #[test]
    fn every_member_is_in_the_tree_once_and_in_all_boxes_above() {
        for count in [2, 3, 8, 9, 700, 40_000] {
            let (boxes, _) = scene(count);
            let tree = Members::build(boxes.iter().copied(), 22.0).unwrap();
            assert!(tree.bytes() <= boxes.len() as u64 * Members::BYTES_EACH as u64 + 1024);
            let met = all_below(&tree, |number| boxes[number as usize / 3].1);
            assert_eq!(met, boxes.iter().map(|it| it.0).collect::<Vec<_>>());
        }
    }

    /// The walk of a ray comes to every member that the ray meets, nearer than the distance that it was shortened to.
    #[test]
    fn walks_come_to_all_members_that_rays_meet() {
        let (boxes, packets) = scene(4000);
        let members = Members::build(boxes.iter().copied(), 22.0).unwrap();
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

    /// After any moves every member is in the tree once, and in all boxes above it; a move of a member that is
    /// elsewhere is refused.
    #[test]
    fn members_that_move_stay_in_all_boxes_above() {
        let (mut boxes, _) = scene(5000);
        let mut tree = Members::build(boxes.iter().copied(), 30.0).unwrap();
        let mut next = numbers();
        for round in 0..40 {
            let moves: Vec<Move> = (0..50)
                .map(|_| {
                    let at = next(0.0, 5000.0) as usize % 5000;
                    let (member, from) = boxes[at];
                    // Some go a little way, some far, some twice.
                    let by = Vec3::from([0; 3].map(|_| if round % 3 == 0 { next(-0.1, 0.1) } else { next(-5.0, 5.0) }));
                    let low = (from.min + by).clamp(Vec3::splat(-28.0), Vec3::splat(27.0));
                    boxes[at].1 = Bounds { min: low, max: low + (from.max - from.min) };
                    Move { member, from, to: boxes[at].1 }
                })
                .collect();
            let moved = tree.moved(&moves).expect("moves of members that are there");
            assert!(moved.changed_bytes() <= moved.bytes());
            tree = moved;
        }
        assert_eq!(
            all_below(&tree, |number| boxes[number as usize / 3].1),
            boxes.iter().map(|it| it.0).collect::<Vec<_>>()
        );
        let nowhere = Bounds { min: Vec3::splat(29.0), max: Vec3::splat(29.5) };
        assert!(tree.moved(&[Move { member: 1, from: nowhere, to: nowhere }]).is_none());
    }
}
