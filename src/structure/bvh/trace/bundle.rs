//! Neighbouring packets from one point as one: a node's boxes are tested once for all of them, and each that is met
//! once more against all packets at once, by the packets' intervals. Leaves are tested for all of them too
//! (`bundle_leaf.rs`); what few packets meet, what cells may stand in for and what is missing each packet visits by
//! itself, at once, so that what it hits hides what comes after.
//!
//! Source: Reshetov, Soupikov, Hurley, "Multi-Level Ray Tracing Algorithm", SIGGRAPH 2005, section 4 (a beam goes down
//! for its rays). Deviations: the beam does not end where its rays part, but says at each box which packets may meet
//! it; and it tests leaves. Answers are those from the root (see `mod.rs` for the order of visits).
#![allow(clippy::needless_range_loop)] // axes index several arrays at once

use super::ahead;
use super::bundle_leaf;
use super::hit::Counters;
use super::kernel::Here;
use super::packet::{PacketEntry, PacketWalk, Row, VECTORS, at_mut};
use super::packet_prepare::Common;
use super::packet_visit::{self, Boxes, farthest, intervals};
use super::walk::{Entered, push_sorted};
use super::{PartFilter, TreeView};
use crate::math::BUNDLE;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, Child};

/// Nodes that no more packets than these meet are left to them: where leaves are wide, and where they are not.
/// (Instructions for a pixel at 10 million triangles, exact, near and whole: 429 and 672 with 2 everywhere, 504 and 584
/// with 16.)
const FEW: [u32; 2] = [2, 16];
/// A leaf that so many packets meet is wide: testing it for all of them pays.
const WIDE: u32 = 3;
/// Leaves count as not wide once so many more nodes were left to packets than wide leaves were met.
const MORE: u32 = 2;
/// Fewer packets than these gain nothing by going together.
const LEAST: u32 = 4;

/// Something that some packets still have to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct BundleEntry {
    /// No ray enters it before.
    pub t: f32,
    /// The packets that may.
    pub packets: u32,
    /// The block that it is in.
    pub block: u32,
    /// The child reference.
    pub child: u32,
    /// Its near and far planes, axis by axis, less the origin.
    pub planes: [[f32; 2]; 3],
}

impl Entered for BundleEntry {
    #[inline(always)]
    fn t(&self) -> f32 {
        self.t
    }
}

/// What the packets that go together are.
#[derive(Debug)]
#[repr(C, align(64))]
pub(super) struct Class {
    /// What they share. Of what differs between them, `inv_min`, `inv_max`, `dir_min` and `cone_max` are the extremes
    /// of all; the rest is that of one of them, and of no use.
    pub common: Common,
    /// Lane by lane, extremes of the reciprocal directions, axis by axis.
    inv_min: [Row; 3],
    inv_max: [Row; 3],
    /// Lane by lane, how far any ray may go; nowhere in the lanes of other packets.
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
    #[allow(clippy::vec_box)] // they are exchanged for others
    pub(super) packets: Vec<Box<PacketWalk>>,
    stack: Vec<BundleEntry>,
    pub(super) class: Class,
    /// What the bundle did for all its packets, nodes and leaves: those count once. All else, triangles too, the
    /// packets count.
    pub counters: Counters,
}

impl Default for Bundle {
    fn default() -> Self {
        let packets = (0..BUNDLE).map(|_| Box::default()).collect();
        Self { packets, stack: Vec::new(), class: Class::none(), counters: Counters::default() }
    }
}

impl Bundle {
    /// Packet `i`, below [`BUNDLE`]; it may be exchanged for another.
    pub fn packet(&mut self, i: usize) -> &mut Box<PacketWalk> {
        &mut self.packets[i]
    }

    /// Finds the closest hits of the packets of `among` (bit `i`: packet `i`), which were just started in `view`, of
    /// such as can go together. What is left, all of it where they cannot, is found by [`TreeView::closest_together`]
    /// of each: call it in any case.
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

    /// The packets of `among` that can go together with the first of them; and whether no cell stands in for anything.
    fn alike(&self, view: &TreeView, among: u32) -> (u32, bool) {
        let first = &self.packets[among.trailing_zeros() as usize];
        let (first, is_exact) = (&first.common, packet_visit::is_exact(view, first));
        let mut alike = 0;
        for (i, packet) in self.packets.iter().enumerate() {
            let it = &packet.common;
            let mut is_alike = it.near == first.near && it.k == first.k && it.org_near == first.org_near;
            // Where no cell stands in, none is looked at.
            is_alike &= packet_visit::is_exact(view, packet) == is_exact;
            alike |= (among >> i & u32::from(is_alike)) << i;
        }
        (alike, is_exact)
    }
}

/// `LOD`: cells may stand in.
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
        // Wide leaves, and nodes left to packets that could not be over such.
        let (mut wide, mut left) = (0, 0);
        while let Some(mut entry) = bundle.stack.pop() {
            entry.packets &= meet(s, &entry.planes, &bundle.class);
            if entry.packets == 0 {
                continue;
            }
            if let Some(words) = view.visit(entry.block) {
                let block = Block::new(words);
                match Child::from_bits(entry.child) {
                    Some(Child::Leaf(at)) => {
                        wide += u32::from(entry.packets.count_ones() >= WIDE);
                        bundle_leaf::leaf(s, view, filter, bundle, &entry, block, at);
                        continue;
                    }
                    Some(Child::Node(index)) => {
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
                    // The root, if it refers to another block.
                    _ => {}
                }
            }
            each::<S, LOD>(s, view, filter, bundle, &entry, &mut boxes);
        }
    }
}

/// Lets each packet that may enter something visit it by itself.
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
        // What is missing stays on its stack.
        let _ = packet_visit::visit::<S, false, LOD>(s, view, filter, packet, boxes);
        *at_mut(&mut bundle.class.far, i) = farthest(s, &packet.hits.t);
    }
}

/// Takes over what the packets share, and puts them at the root.
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

/// Pushes the children that any packet meets, the nearest last; false if the packets are to see to the node themselves.
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
        if !is_there || matches!(Child::from_bits(child), Some(Child::External(_))) {
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

/// The packets any of whose rays may meet a box between planes.
#[inline(always)]
fn meet<S: Simd>(s: S, planes: &[[f32; 2]; 3], class: &Class) -> u32 {
    let mut all = 0;
    for h in 0..VECTORS {
        let (mut enter, mut leave) = (s.splat16(0.0), s.load16(&class.far[h]));
        for axis in 0..3 {
            let (low, high) = (s.load16(&class.inv_min[axis][h]), s.load16(&class.inv_max[axis][h]));
            let (from, to) = (s.splat16(planes[axis][0]), s.splat16(planes[axis][1]));
            // Rounded products keep order: no ray between the extremes has less, or more.
            enter = (from * low).min(from * high).max(enter);
            leave = (to * low).max(to * high).min(leave);
        }
        all |= enter.le(leave).bits() << (16 * h);
    }
    all
}
