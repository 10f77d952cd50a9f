//! Bundles: neighbouring packets with the same origin, traversed as one. A node's boxes are tested once for all
//! packets. Each box that is hit is then tested against the intervals of all packets at once. Leaves are tested for all
//! packets too (`bundle_leaf.rs`). Each packet visits the following by itself: nodes that few packets hit, cells that
//! may stand in, and missing blocks. It does so immediately, so that its hits cull later entries.
//!
//! Source: Reshetov, Soupikov, Hurley, "Multi-Level Ray Tracing Algorithm", SIGGRAPH 2005, section 4 (a beam descends
//! for its rays). Deviations: the beam does not end where its rays diverge, but determines at each box the packets that
//! may hit it; and it tests leaves. Hits are those of walks from the root (see `mod.rs` for the order of visits).
#![allow(clippy::needless_range_loop)] // axes index several arrays at once

use super::ahead;
use super::bundle_leaf;
use super::hit::Counters;
use super::kernel::Here;
use super::packet::{PacketEntry, PacketWalk, Row, VECTORS, at_mut};
use super::packet_prepare::Common;
use super::packet_visit::{self, Boxes, intervals};
use super::walk::{Entered, push_sorted};
use super::{PartFilter, TreeView};
use crate::math::BUNDLE;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, Child};
use crate::structure::packet_boxes::farthest;

/// Greatest number of packets that a node is left to: the first value where leaves are wide, the second where they are
/// not. (Instructions for a pixel at 10 million triangles, exact, of a near view and of a view of the whole model: 429
/// and 672 with 2 everywhere, 504 and 584 with 16.)
const FEW: [u32; 2] = [2, 16];
/// Number of packets from which on a leaf is wide: testing it for all packets at once pays off.
const WIDE: u32 = 3;
/// Leaves count as not wide once the nodes left to packets exceed the wide leaves by more than this.
const MORE: u32 = 2;
/// Least number of packets that are worth traversing as one.
const LEAST: u32 = 4;

/// A stack entry that some packets still have to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct BundleEntry {
    /// Lower bound of the distance at which a ray enters it.
    pub t: f32,
    /// Packets that may enter it.
    pub packets: u32,
    /// Id of the block that it is in.
    pub block: u32,
    /// The child reference.
    pub child: u32,
    /// Near and far plane of its box for each axis, relative to the origin.
    pub planes: [[f32; 2]; 3],
}

impl Entered for BundleEntry {
    #[inline(always)]
    fn t(&self) -> f32 {
        self.t
    }
}

/// The packets that are traversed as one.
#[derive(Debug)]
#[repr(C, align(64))]
pub(super) struct Class {
    /// Shared values of the packets. `inv_min`, `inv_max`, `dir_min` and `cone_max` are extremes over all packets.
    /// Other values that differ between packets are those of one packet, and unused.
    pub common: Common,
    /// For each axis, the extremes of the reciprocal directions of each packet, one packet per lane.
    inv_min: [Row; 3],
    inv_max: [Row; 3],
    /// Greatest distance of a ray of each packet; negative infinity in the lanes of other packets.
    pub far: Row,
}

impl Class {
    fn none() -> Self {
        let none = [[0.0; 16]; VECTORS];
        Self { common: Common::default(), inv_min: [none; 3], inv_max: [none; 3], far: none }
    }
}

/// Up to [`BUNDLE`] packets in one tree. Reusable.
#[derive(Debug)]
pub struct Bundle {
    #[allow(clippy::vec_box)] // callers swap the boxes
    pub(super) packets: Vec<Box<PacketWalk>>,
    stack: Vec<BundleEntry>,
    pub(super) class: Class,
    /// Nodes and leaves that the bundle visited for all its packets; each counts once. The packets count all other
    /// work, including triangles.
    pub counters: Counters,
}

impl Default for Bundle {
    fn default() -> Self {
        let packets = (0..BUNDLE).map(|_| Box::default()).collect();
        Self { packets, stack: Vec::new(), class: Class::none(), counters: Counters::default() }
    }
}

impl Bundle {
    /// Returns packet `i`, below [`BUNDLE`]. The caller may swap it for another one.
    pub fn packet(&mut self, i: usize) -> &mut Box<PacketWalk> {
        &mut self.packets[i]
    }

    /// Finds the closest hits of those packets in `among` (bit `i`: packet `i`) that can be traversed as one. The
    /// packets must have just been started in `view`. Call [`TreeView::closest_together`] for each packet afterwards in
    /// any case: it finds the remaining hits, which are all hits if the packets cannot be traversed as one.
    pub fn closest(&mut self, view: &TreeView, filter: Option<&PartFilter>, among: u32) {
        if PartFilter::is_by_ray(filter) {
            return;
        }
        let mut left = 0;
        for (i, packet) in self.packets.iter().enumerate() {
            let fits = packet.together && packet.common.one_origin && packet.waiting != 0;
            left |= (among >> i & u32::from(fits)) << i;
        }
        while left != 0 {
            let (packets, is_exact) = self.alike(view, left);
            left &= !packets;
            if packets.count_ones() < LEAST {
                continue;
            }
            if is_exact {
                dispatch(view.isa, Together::<false> { bundle: self, view, filter, packets });
            } else {
                dispatch(view.isa, Together::<true> { bundle: self, view, filter, packets });
            }
        }
    }

    /// Returns the packets of `among` that can be traversed as one with the first of them, and true if no cell can
    /// stand in.
    fn alike(&self, view: &TreeView, among: u32) -> (u32, bool) {
        let first = &self.packets[among.trailing_zeros() as usize];
        let (first, is_exact) = (&first.common, packet_visit::is_exact(view, first));
        let mut alike = 0;
        for (i, packet) in self.packets.iter().enumerate() {
            let it = &packet.common;
            let mut is_alike = it.near == first.near && it.k == first.k && it.org_near == first.org_near;
            // The kernel for exact packets tests no stand-ins.
            is_alike &= packet_visit::is_exact(view, packet) == is_exact;
            alike |= (among >> i & u32::from(is_alike)) << i;
        }
        (alike, is_exact)
    }
}

/// Kernel of bundles. `LOD`: cells may stand in.
struct Together<'a, 'v, const LOD: bool> {
    bundle: &'a mut Bundle,
    view: &'a TreeView<'v>,
    filter: Option<&'a PartFilter<'a>>,
    packets: u32,
}

impl<const LOD: bool> Op for Together<'_, '_, LOD> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { bundle, view, filter, packets } = self;
        begin(s, bundle, view, packets);
        let is_large = ahead::is_large(view.snapshot);
        let mut boxes = Boxes::NONE;
        // Counts of wide leaves, and of nodes left to packets. Nodes that only the second value of [`FEW`] leaves to
        // packets do not count: wide leaves may be below them.
        let (mut wide, mut left) = (0, 0);
        while let Some(mut entry) = bundle.stack.pop() {
            entry.packets &= meet(s, &entry.planes, &bundle.class);
            if entry.packets == 0 {
                continue;
            }
            if let Some(words) = view.visit(entry.block) {
                let block = Block::new(words);
                match Child::from_bits(entry.child) {
                    Child::Leaf(at) => {
                        wide += u32::from(entry.packets.count_ones() >= WIDE);
                        bundle_leaf::leaf(s, view, filter, bundle, &entry, block, at);
                        continue;
                    }
                    Child::Node(index) => {
                        let packets = entry.packets.count_ones();
                        let is_few = packets <= FEW[usize::from(left > wide + MORE)];
                        if !is_few
                            && node(
                                s,
                                is_large,
                                view,
                                bundle,
                                &entry,
                                Here { block, id: entry.block, index },
                                &mut boxes,
                            )
                        {
                            continue;
                        }
                        left += u32::from(!is_few || packets <= FEW[0]);
                    }
                    // The root may be a reference to another block.
                    _ => {}
                }
            }
            each::<S, LOD>(s, view, filter, bundle, &entry, &mut boxes);
        }
    }
}

/// Lets each packet that may enter an entry visit it by itself.
#[inline(always)]
fn each<S: Simd, const LOD: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    bundle: &mut Bundle,
    &BundleEntry { t, packets, block, child, .. }: &BundleEntry,
    boxes: &mut Boxes,
) {
    let mut left = packets;
    while left != 0 {
        let i = left.trailing_zeros() as usize & (BUNDLE - 1);
        left &= left - 1;
        let packet = &mut bundle.packets[i];
        packet.stack.push(PacketEntry { t, rays: packet.waiting, block, child });
        // An entry that needs a missing block stays on the packet's stack.
        let _ = packet_visit::visit::<S, false, LOD>(s, view, filter, packet, boxes);
        *at_mut(&mut bundle.class.far, i) = farthest(s, &packet.hits.t);
    }
}

/// Combines the shared values of the packets, and pushes the root.
#[inline(always)]
fn begin<S: Simd>(s: S, bundle: &mut Bundle, view: &TreeView, packets: u32) {
    let Bundle { packets: all, stack, class, .. } = bundle;
    class.common = all[packets.trailing_zeros() as usize & (BUNDLE - 1)].common;
    class.far = [[f32::NEG_INFINITY; 16]; VECTORS];
    let mut left = packets;
    while left != 0 {
        let i = left.trailing_zeros() as usize & (BUNDLE - 1);
        left &= left - 1;
        let packet = &mut all[i];
        packet.stack.clear();
        let (class_shared, common) = (&mut class.common, &packet.common);
        for axis in 0..3 {
            let (low, high) = (common.inv_min[axis], common.inv_max[axis]);
            (*at_mut(&mut class.inv_min[axis], i), *at_mut(&mut class.inv_max[axis], i)) = (low, high);
            class_shared.inv_min[axis] = class_shared.inv_min[axis].min(low);
            class_shared.inv_max[axis] = class_shared.inv_max[axis].max(high);
            class_shared.dir_min[axis] = class_shared.dir_min[axis].min(common.dir_min[axis]);
        }
        for part in 0..2 {
            class_shared.cone_max[part] = class_shared.cone_max[part].max(common.cone_max[part]);
        }
        *at_mut(&mut class.far, i) = farthest(s, &packet.hits.t);
    }
    let [x, y, z] = class.common.sign;
    let planes = [[0.0, x * f32::INFINITY], [0.0, y * f32::INFINITY], [0.0, z * f32::INFINITY]];
    stack.clear();
    stack.push(BundleEntry { t: 0.0, packets, block: view.root_block, child: view.root, planes });
}

/// Pushes the children that any packet hits, nearest last. Returns false if the packets must visit the node by
/// themselves.
#[inline(always)]
fn node<S: Simd>(
    s: S,
    is_large: bool,
    view: &TreeView,
    bundle: &mut Bundle,
    entry: &BundleEntry,
    here: Here,
    boxes: &mut Boxes,
) -> bool {
    let (node, block) = (here.node(), here.block);
    let class = &bundle.class;
    intervals::<S, true>(s, node, &class.common, farthest(s, &class.far), boxes);
    if boxes.small != 0 {
        return false;
    }
    let bottom = bundle.stack.len();
    let mut mask = boxes.met;
    while mask != 0 {
        let slot = mask.trailing_zeros() as usize & 7;
        mask &= mask - 1;
        let planes = boxes.planes_of(slot);
        let child = u32::from(node.child[slot]);
        let (id, child, is_there) = ahead::follow(is_large, view, block, entry.block, child);
        if !is_there || matches!(Child::from_bits(child), Child::External(_)) {
            bundle.stack.truncate(bottom);
            return false;
        }
        push_sorted(
            &mut bundle.stack,
            bottom,
            BundleEntry { t: boxes.enter[slot], packets: entry.packets, block: id, child, planes },
        );
    }
    bundle.counters.nodes += 1;
    true
}

/// Returns the packets of which a ray may hit a box between planes.
#[inline(always)]
fn meet<S: Simd>(s: S, planes: &[[f32; 2]; 3], class: &Class) -> u32 {
    let mut all = 0;
    for h in 0..VECTORS {
        let (mut enter, mut leave) = (s.splat16(0.0), s.load16(&class.far[h]));
        for axis in 0..3 {
            let (low, high) = (s.load16(&class.inv_min[axis][h]), s.load16(&class.inv_max[axis][h]));
            let (from, to) = (s.splat16(planes[axis][0]), s.splat16(planes[axis][1]));
            // Rounded products are monotonic: no ray between the extremes has a smaller entry or a greater exit.
            enter = (from * low).min(from * high).max(enter);
            leave = (to * low).max(to * high).min(leave);
        }
        all |= enter.le(leave).bits() << (16 * h);
    }
    all
}
