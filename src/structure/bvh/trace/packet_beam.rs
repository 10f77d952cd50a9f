//! Where the packets of a beam begin. Neighbouring packets visit the same nodes below the root; a beam around all of
//! them visits these once, and each packet begins at what the beam meets further down, up to eight boxes, with one test.
//!
//! Source: Reshetov, Soupikov, Hurley, "Multi-Level Ray Tracing Algorithm", SIGGRAPH 2005, section 4 (entry points). Deviation:
//! up to eight of them, in place of one. Answers are those from the root (see `mod.rs` for the order of visits).
#![allow(clippy::needless_range_loop)] // axes index several arrays at once

use super::packet::{PacketEntry, PacketWalk};
use super::packet_prepare::Shared;
use super::packet_visit::{Boxes, Planes, cross, intervals};
use super::stand_in::slack;
use super::walk::push_sorted;
use super::TreeView;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, Child};
use glam::Vec3;

/// Boxes that packets begin at, at most: one test's.
const MOST: usize = 8;
/// Directions give way by this part of the longest, for what rays and corners are rounded by.
const ROUNDED: f32 = 1e-6;
/// Below all levels.
const CLOSED: u32 = u32::MAX;

/// All rays from a point through a rectangle.
#[derive(Debug, Clone, Copy)]
pub struct Beam {
    shared: Shared,
}

impl Beam {
    /// The rays from `org`, in the tree's frame, through a rectangle with these `corners` seen from there; each of at most `width` at
    /// distance 1. `None` if they go to either side of a plane along two axes.
    pub fn new(view: &TreeView, org: Vec3, corners: &[Vec3; 4], width: f32) -> Option<Self> {
        // Up to the rectangle: there the extremes of the directions are those of the corners.
        let (mut least, mut greatest, mut length) = (Vec3::INFINITY, Vec3::NEG_INFINITY, 0.0f32);
        for corner in corners {
            (least, greatest, length) = (least.min(*corner), greatest.max(*corner), length.max(corner.length()));
        }
        let give = Vec3::splat(length * ROUNDED);
        (least, greatest, length) = (least - give, greatest + give, length * (1.0 + ROUNDED));
        let mut shared = Shared { one_origin: true, cone_max: [0.0, width * length], ..Shared::default() };
        for axis in 0..3 {
            let (low, high, org) = (least[axis], greatest[axis], org[axis]);
            // Not so of what is not a number.
            if !(low > 0.0 || high < 0.0) {
                return None;
            }
            let (a, b) = (1.0 / low, 1.0 / high);
            shared.near[axis] = if low > 0.0 { axis } else { axis + 3 };
            // A step further, for the quotients are rounded.
            (shared.inv_min[axis], shared.inv_max[axis]) = (a.min(b).next_down(), a.max(b).next_up());
            (shared.org_near[axis], shared.org_far[axis]) = (org, org);
            shared.slack[axis] = slack(org, a, view.reach);
            shared.dir_min[axis] = low.abs().min(high.abs()) / length;
        }
        Some(Self { shared })
    }
}

/// What of a tree a beam's packets begin at. Good for the view that it was made of.
#[derive(Debug, Clone)]
pub struct Entries {
    count: usize,
    /// See [`Boxes::planes`].
    planes: Planes,
    block: [u32; MOST],
    child: [u32; MOST],
    /// How far below the root; those that cannot be opened are at [`CLOSED`].
    level: [u32; MOST],
    /// What packets share with the beam.
    org: [f32; 3],
    near: [usize; 3],
}

impl Entries {
    /// Those of a beam; `None` if its packets may as well begin at the root.
    pub fn of(view: &TreeView, beam: &Beam) -> Option<Self> {
        if view.is_empty() {
            return None;
        }
        let Shared { org_near: org, near, .. } = beam.shared;
        let (mut block, mut child) = ([0; MOST], [0; MOST]);
        (block[0], child[0]) = (view.root_block, view.root);
        let root = Self { count: 1, planes: [[[0.0; 8]; 2]; 3], block, child, level: [0; MOST], org, near };
        dispatch(view.isa, Grow { view, beam, entries: root })
    }

    /// Puts what a box of `boxes` holds at the end.
    #[inline(always)]
    fn push(&mut self, boxes: &Boxes, slot: usize, block: u32, child: u32, level: u32) {
        let at = self.count & (MOST - 1);
        for axis in 0..3 {
            for side in 0..2 {
                self.planes[axis][side][at] = boxes.planes[axis][side][slot];
            }
        }
        (self.block[at], self.child[at], self.level[at]) = (block, child, level);
        self.count += 1;
    }

    /// Puts the last in place of the one at `at`.
    #[inline(always)]
    fn remove(&mut self, at: usize) {
        self.count -= 1;
        let last = self.count;
        for axis in 0..3 {
            for side in 0..2 {
                self.planes[axis][side][at] = self.planes[axis][side][last];
            }
        }
        (self.block[at], self.child[at], self.level[at]) = (self.block[last], self.child[last], self.level[last]);
    }

    /// The one that is least far below the root; `None` if all are closed.
    #[inline(always)]
    fn highest(&self) -> Option<usize> {
        let mut best = None;
        let mut level = CLOSED;
        for i in 0..self.count {
            if self.level[i] < level {
                (best, level) = (Some(i), self.level[i]);
            }
        }
        best
    }
}

/// Opens nodes for as long as there is room.
struct Grow<'a, 'v> {
    view: &'a TreeView<'v>,
    beam: &'a Beam,
    entries: Entries,
}

impl Op for Grow<'_, '_> {
    type Out = Option<Entries>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<Entries> {
        let Self { view, beam: Beam { shared }, mut entries } = self;
        let mut boxes = Boxes::NONE;
        let mut opened = false;
        while let Some(at) = entries.highest() {
            let level = std::mem::replace(&mut entries.level[at], CLOSED);
            let (mut id, mut child) = (entries.block[at], entries.child[at]);
            let mut words = view.visit(id)?;
            if let Some(Child::External(index)) = Child::from_bits(child) {
                (id, child) = Block::new(words).external(index);
                // Cells may stand in for what is missing: packets see to that.
                let Some(below) = view.visit(id) else { continue };
                words = below;
            }
            let Some(Child::Node(index)) = Child::from_bits(child) else { continue };
            let node = Block::new(words).node(index);
            intervals::<S, true>(s, node, shared, f32::INFINITY, &mut boxes);
            let mut met = boxes.met;
            let mut is_open = boxes.small == 0 && entries.count - 1 + met.count_ones() as usize <= MOST;
            for slot in 0..8 {
                // Leaves are visited with their node, which knows whether they are there.
                is_open &= met >> slot & 1 == 0 || !Child::is_leaf(node.child[slot].into());
            }
            if !is_open {
                continue;
            }
            opened = true;
            entries.remove(at);
            while met != 0 {
                let slot = met.trailing_zeros() as usize & 7;
                met &= met - 1;
                entries.push(&boxes, slot, id, node.child[slot].into(), level + 1);
            }
        }
        opened.then_some(entries)
    }
}

/// Lets a packet that was started begin at entries.
pub(super) struct Enter<'a> {
    pub walk: &'a mut PacketWalk,
    pub entries: &'a Entries,
}

impl Op for Enter<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { walk, entries } = self;
        let shared = &walk.shared;
        let fits = walk.together && shared.one_origin && shared.org_near == entries.org && shared.near == entries.near;
        if !fits || walk.waiting == 0 {
            return;
        }
        let zero = s.splat8(0.0);
        let (mut first, mut last) = ([zero; 3], [zero; 3]);
        for axis in 0..3 {
            (first[axis], last[axis]) = (s.load8(&entries.planes[axis][0]), s.load8(&entries.planes[axis][1]));
        }
        let [enter, leave] = cross(s, first, last, shared, f32::INFINITY);
        let mut met = enter.le(leave).bits() & ((1 << entries.count) - 1);
        let enter = enter.to_array();
        walk.stack.clear();
        while met != 0 {
            let i = met.trailing_zeros() as usize & (MOST - 1);
            met &= met - 1;
            let (block, child) = (entries.block[i], entries.child[i]);
            push_sorted(&mut walk.stack, 0, PacketEntry { t: enter[i], rays: walk.waiting, block, child });
        }
    }
}
