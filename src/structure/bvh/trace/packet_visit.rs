//! The kernel of packets. A node's boxes are tested against all rays at once, by intervals of their origins
//! and reciprocal directions; boxes of leaves that pass are tested ray by ray too, sixteen in a vector.
//! Where few rays are left, each goes on alone (`single.rs`).
//!
//! Source of the interval test: Boulos, Wald, Shirley, "Geometric and Arithmetic Culling Methods for
//! Entire Ray Packets", University of Utah UUCS-06-010, 2006, section 3.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::packet::{PacketEntry, PacketRays, PacketWalk, Row, VECTORS, at, at_mut};
use super::packet_leaf::leaf;
use super::single::{self, RayLanes};
use super::ray::{MAX_DIR, MIN_DIR, USUAL_DIRS};
use super::walk::{Entry, Outcome, TriHit};
use super::{PartFilter, PreparedRay, TreeView};
use crate::base::ids::BlockId;
use crate::geom::Shear;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, Child, Node};
use glam::Vec3;

/// Rays below which each goes on alone.
const FEW: u32 = 3;

/// What coherent rays share: signs of the direction, axis order of the triangle test, and intervals.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shared {
    near: [usize; 3],
    pub k: [usize; 3],
    /// The origins' extreme on each axis that makes the distance to the near plane least.
    pub org_near: [f32; 3],
    /// The same for the greatest distance to the far plane.
    org_far: [f32; 3],
    inv_min: [f32; 3],
    inv_max: [f32; 3],
    slack: [f32; 3],
    /// All rays start at the same point.
    pub one_origin: bool,
    /// The extremes of the shear along x and along y.
    pub shear_min: [f32; 2],
    pub shear_max: [f32; 2],
}

impl Shared {
    /// The greatest distance of origins along an axis.
    #[inline(always)]
    pub fn spread(&self) -> f32 {
        let along = |axis: usize| (self.org_near[axis] - self.org_far[axis]).abs();
        along(0).max(along(1)).max(along(2))
    }
}

/// Prepares all rays (as [`super::PreparedRay::new`] does one, which see), and what they share; false where they cannot
/// go together, because the signs or the greatest components of their directions differ. (Written in place: returned, the
/// struct would be stored in small pieces and read at once in large ones.)
#[inline(always)]
pub(super) fn prepare<S: Simd>(s: S, rays: &mut PacketRays, reach: f32, shared: &mut Shared) -> bool {
    let Some(kz) = greatest_axis(s, rays) else { return false };
    let k = [(kz + 1) % 3, (kz + 2) % 3, kz];
    let (zero, one) = (s.splat16(0.0), s.splat16(1.0));
    let mut one_origin = true;
    for axis in 0..3 {
        let first = s.load16(&rays.org[axis][0]);
        let origin = s.splat16(rays.org[axis][0][0]);
        let mut equal = origin.eq(first);
        let (mut org_low, mut org_high) = (first, first);
        let (mut inv_low, mut inv_high) = (s.splat16(f32::INFINITY), s.splat16(f32::NEG_INFINITY));
        let mut slacks = zero;
        let mut signs = [0; VECTORS];
        for h in 0..VECTORS {
            let dir = s.load16(&rays.dir[axis][h]);
            let least = abs(zero, s.load16(&rays.dir[kz][h])) * s.splat16(1e-18);
            let magnitude = one.div(abs(zero, dir).max(least));
            let positive = zero.le(dir);
            signs[h] = positive.bits();
            let inv = magnitude.select(positive, zero - magnitude);
            let org = s.load16(&rays.org[axis][h]);
            let slack = magnitude * abs(zero, org).max(s.splat16(reach)) * s.splat16(1.0 / 524288.0);
            let off = org * inv;
            rays.inv[axis][h] = inv.to_array();
            rays.minus_off_near[axis][h] = (zero - off - slack).to_array();
            rays.minus_off_far[axis][h] = (slack - off).to_array();
            equal = equal.and(origin.eq(org));
            (org_low, org_high) = (org.min(org_low), org.max(org_high));
            (inv_low, inv_high) = (inv.min(inv_low), inv.max(inv_high));
            slacks = slack.max(slacks);
        }
        let negative = match signs {
            signs if signs == [0xffff; VECTORS] => false,
            signs if signs == [0; VECTORS] => true,
            _ => return false,
        };
        shared.near[axis] = if negative { axis + 3 } else { axis };
        (shared.inv_min[axis], shared.inv_max[axis]) = (inv_low.least(), inv_high.greatest());
        if equal.bits() == 0xffff {
            // The most frequent case. The greatest slack is that of the greatest reciprocal, as products keep order.
            let origin = rays.org[axis][0][0];
            (shared.org_near[axis], shared.org_far[axis]) = (origin, origin);
            let steepest = shared.inv_max[axis].abs().max(shared.inv_min[axis].abs());
            shared.slack[axis] = 2.0 * (steepest * origin.abs().max(reach) * (1.0 / 524288.0));
        } else {
            one_origin = false;
            let (low, high) = (org_low.least(), org_high.greatest());
            (shared.org_near[axis], shared.org_far[axis]) = if negative { (low, high) } else { (high, low) };
            shared.slack[axis] = 2.0 * slacks.greatest();
        }
    }
    for axis in 0..2 {
        let (mut least, mut greatest) = (s.splat16(f32::INFINITY), s.splat16(f32::NEG_INFINITY));
        for h in 0..VECTORS {
            let shear = s.load16(&rays.dir[k[axis]][h]).div(s.load16(&rays.dir[kz][h]));
            rays.shear[axis][h] = shear.to_array();
            (least, greatest) = (shear.min(least), shear.max(greatest));
        }
        (shared.shear_min[axis], shared.shear_max[axis]) = (least.least(), greatest.greatest());
    }
    // The greatest component is no less than the least that counts: this is its reciprocal.
    rays.shear[2] = rays.inv[kz];
    (shared.k, shared.one_origin) = (k, one_origin);
    true
}

/// The rays that [`super::LocalRay::is_valid`] accepts.
#[inline(always)]
pub(super) fn valid<S: Simd>(s: S, rays: &PacketRays, t_max: &Row) -> u32 {
    let (zero, largest) = (s.splat16(0.0), s.splat16(MAX_DIR));
    let mut all = 0;
    for h in 0..VECTORS {
        let t_min = s.load16(&rays.t_min[h]);
        let mut ok = zero.le(t_min).and(t_min.le(s.load16(&t_max[h])));
        let mut size = zero;
        for axis in 0..3 {
            let (org, dir) = (abs(zero, s.load16(&rays.org[axis][h])), abs(zero, s.load16(&rays.dir[axis][h])));
            // NaN is not less than anything.
            ok = ok.and(org.le(s.splat16(f32::MAX))).and(dir.le(largest));
            size = dir.max(size);
        }
        all |= ok.and(s.splat16(MIN_DIR).le(size)).bits() << (16 * h);
    }
    all
}

/// See [`super::PacketWalk::is_within`].
#[inline(always)]
pub(super) fn within<S: Simd>(s: S, rays: &mut PacketRays, near: f32) -> u32 {
    let (zero, near) = (s.splat16(0.0), s.splat16(near));
    let (least, greatest) = (s.splat16(*USUAL_DIRS.start()), s.splat16(*USUAL_DIRS.end()));
    let mut all = 0;
    for h in 0..VECTORS {
        let t_min = s.load16(&rays.t_min[h]);
        // NaN is not less than anything.
        let mut ok = abs(zero, t_min).le(s.splat16(f32::MAX));
        let mut size = zero;
        for axis in 0..3 {
            let dir = abs(zero, s.load16(&rays.dir[axis][h]));
            ok = ok.and(abs(zero, s.load16(&rays.org[axis][h])).le(near)).and(dir.le(greatest));
            size = dir.max(size);
        }
        rays.t_min[h] = t_min.max(zero).to_array();
        all |= ok.and(least.le(size)).bits() << (16 * h);
    }
    all
}

#[inline(always)]
fn abs<L: Lanes<16>>(zero: L, v: L) -> L {
    v.max(zero - v)
}

/// The axis on which all rays are greatest, ties as in [`crate::geom::Shear`]; `None` where they differ.
#[inline(always)]
fn greatest_axis<S: Simd>(s: S, rays: &PacketRays) -> Option<usize> {
    let zero = s.splat16(0.0);
    let (mut is_x, mut is_y) = ([0; VECTORS], [0; VECTORS]);
    for h in 0..VECTORS {
        let x = abs(zero, s.load16(&rays.dir[0][h]));
        let y = abs(zero, s.load16(&rays.dir[1][h]));
        let z = abs(zero, s.load16(&rays.dir[2][h]));
        is_x[h] = y.le(x).and(z.le(x)).bits();
        is_y[h] = z.le(y).bits() & !is_x[h];
    }
    let (all, none) = ([0xffff; VECTORS], [0; VECTORS]);
    match (is_x == all, is_y == all) {
        (true, _) => Some(0),
        (_, true) => Some(1),
        _ if is_x == none && is_y == none => Some(2),
        _ => None,
    }
}

/// The greatest distance that any ray may go.
#[inline(always)]
fn farthest<S: Simd>(s: S, t: &Row) -> f32 {
    let mut far = s.load16(&t[0]);
    for h in 1..VECTORS {
        far = s.load16(&t[h]).max(far);
    }
    far.greatest()
}

/// The rays that may go as far as `t`, or farther.
#[inline(always)]
fn reaching<S: Simd>(s: S, t: f32, far: &Row) -> u32 {
    let mut rays = 0;
    for h in 0..VECTORS {
        rays |= s.splat16(t).le(s.load16(&far[h])).bits() << (16 * h);
    }
    rays
}

/// Goes on with `walk` until it ends or a block is missing.
pub(super) fn run<const ANY: bool>(view: &TreeView, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
    dispatch(view.isa, Packet::<ANY> { view, filter, walk })
}

struct Packet<'a, 'v, const ANY: bool> {
    view: &'a TreeView<'v>,
    filter: Option<&'a PartFilter<'a>>,
    walk: &'a mut PacketWalk,
}

impl<const ANY: bool> Op for Packet<'_, '_, ANY> {
    type Out = Outcome;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Outcome {
        let Self { view, filter, walk } = self;
        let outcome = visit::<S, ANY>(s, view, filter, walk);
        if outcome == Outcome::Done {
            walk.waiting = 0;
        }
        outcome
    }
}

#[inline(always)]
fn visit<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
) -> Outcome {
    let shared = walk.shared;
    let mut far = farthest(s, &walk.hits.t);
    while let Some(mut entry) = walk.stack.pop() {
        if entry.t > far {
            continue;
        }
        entry.rays &= walk.waiting & reaching(s, entry.t, &walk.hits.t);
        let Some(words) = view.snapshot.block(BlockId(entry.block)) else {
            walk.stack.push(entry);
            return Outcome::Pending(BlockId(entry.block));
        };
        let mut block = Block::new(words);
        while entry.rays != 0 {
            if !walk.together || entry.rays.count_ones() < FEW {
                let outcome = each_alone::<S, ANY>(s, view, filter, walk, entry);
                if outcome != Outcome::Done {
                    return outcome;
                }
                far = farthest(s, &walk.hits.t);
                break;
            }
            match Child::from_bits(entry.child) {
                Some(Child::Node(index)) => {
                    walk.counters.nodes += 1;
                    match nearest_child(s, block.node(index), &shared, far, entry, walk) {
                        Some(nearest) => entry = nearest,
                        None => break,
                    }
                }
                Some(Child::Leaf(at)) => {
                    walk.counters.leaves += 1;
                    let outcome = leaf::<S, ANY>(s, view, filter, walk, entry, &shared, block, at);
                    if outcome != Outcome::Done {
                        return outcome;
                    }
                    far = farthest(s, &walk.hits.t);
                    break;
                }
                Some(Child::External(index)) => {
                    walk.counters.blocks += 1;
                    let (next, below) = block.external(index);
                    (entry.block, entry.child) = (next, below);
                    let Some(words) = view.snapshot.block(BlockId(next)) else {
                        walk.stack.push(entry);
                        return Outcome::Pending(BlockId(next));
                    };
                    block = Block::new(words);
                }
                None => break,
            }
        }
    }
    Outcome::Done
}

/// Lets each ray of `entry` visit it alone.
#[inline(always)]
fn each_alone<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    entry: PacketEntry,
) -> Outcome {
    let mut rays = entry.rays;
    while rays != 0 {
        let i = rays.trailing_zeros() as usize;
        let ray = if walk.together {
            prepared(&walk.rays, i, &walk.shared)
        } else {
            PreparedRay::new(&walk.rays.one(i), view.reach)
        };
        let lanes = RayLanes::new(s, &ray);
        let mut best = walk.best(i);
        let stack = &mut walk.alone.stack;
        stack.clear();
        stack.push(Entry { t: entry.t, block: entry.block, child: entry.child });
        let counters = &mut walk.alone.counters;
        let outcome = single::visit::<S, ANY>(s, view, filter, &ray, &lanes, stack, &mut best, counters);
        keep(walk, i, &best);
        if outcome != Outcome::Done {
            // The others first look at this entry later; this one goes on with what it has left.
            walk.stack.push(PacketEntry { rays: rays & (rays - 1), ..entry });
            let left = walk.alone.stack.iter();
            let left = left.map(|e| PacketEntry { t: e.t, rays: 1 << i, block: e.block, child: e.child });
            walk.stack.extend(left);
            return outcome;
        }
        if ANY && best.is_hit() {
            walk.waiting &= !(1 << i);
        }
        rays &= rays - 1;
    }
    Outcome::Done
}

/// Ray `i` by itself, from what the packet has of it.
#[inline(always)]
fn prepared(rays: &PacketRays, i: usize, shared: &Shared) -> PreparedRay {
    PreparedRay {
        org: Vec3::from_array(three(&rays.org, i)),
        inv: three(&rays.inv, i),
        off_near: minus(three(&rays.minus_off_near, i)),
        off_far: minus(three(&rays.minus_off_far, i)),
        near: shared.near,
        shear: Shear { k: shared.k, s: three(&rays.shear, i) },
        t_min: at(&rays.t_min, i),
    }
}

#[inline(always)]
fn three(rows: &[Row; 3], i: usize) -> [f32; 3] {
    [at(&rows[0], i), at(&rows[1], i), at(&rows[2], i)]
}

#[inline(always)]
fn minus([x, y, z]: [f32; 3]) -> [f32; 3] {
    [-x, -y, -z]
}

#[inline(always)]
pub(super) fn keep(walk: &mut PacketWalk, i: usize, best: &TriHit) {
    let h = &mut walk.hits;
    (*at_mut(&mut h.t, i), *at_mut(&mut h.u, i), *at_mut(&mut h.v, i)) = (best.t, best.u, best.v);
    *at_mut(&mut h.block, i) = f32::from_bits(best.block);
    *at_mut(&mut h.tri, i) = f32::from_bits(best.tri);
    h.some |= u32::from(best.is_hit()) << i;
}

/// Pushes all but the nearest of the children that any ray meets; returns the nearest.
#[inline(always)]
fn nearest_child<S: Simd>(
    s: S,
    node: &Node,
    shared: &Shared,
    far: f32,
    entry: PacketEntry,
    walk: &mut PacketWalk,
) -> Option<PacketEntry> {
    let (mut mask, t, planes) = intervals(s, node, shared, far);
    let bottom = walk.stack.len();
    let mut nearest: Option<PacketEntry> = None;
    while mask != 0 {
        let slot = mask.trailing_zeros() as usize & 7;
        mask &= mask - 1;
        let child = u32::from(node.child[slot]);
        // Rays from one point are tested one by one only before leaves: for nodes it costs more than it saves
        // (0.44 to 0.48 of Embree's packets on the bunny without). Intervals of many origins are too wide.
        let mut rays = entry.rays;
        if !shared.one_origin || matches!(Child::from_bits(child), Some(Child::Leaf(_))) {
            rays &= meet(s, &planes, slot, walk);
            if rays == 0 {
                continue;
            }
        }
        let mut next = PacketEntry { t: t[slot], rays, block: entry.block, child };
        let Some(first) = nearest else {
            nearest = Some(next);
            continue;
        };
        if next.t < first.t {
            nearest = Some(next);
            next = first;
        }
        let mut at = walk.stack.len();
        walk.stack.push(next);
        while at > bottom && walk.stack[at - 1].t < next.t {
            walk.stack[at] = walk.stack[at - 1];
            at -= 1;
        }
        walk.stack[at] = next;
    }
    nearest
}

/// Near and far planes of eight boxes, axis by axis.
type Planes = [[[f32; 8]; 2]; 3];

/// The children that rays between the extremes can meet, no ray's entry before, and the boxes.
#[inline(always)]
fn intervals<S: Simd>(s: S, node: &Node, shared: &Shared, far: f32) -> (u32, [f32; 8], Planes) {
    let step = s.powers8(node.exponents());
    let mut enter = s.splat8(0.0);
    let mut leave = s.splat8(far);
    let mut out = [[[0.0; 8]; 2]; 3];
    for axis in 0..3 {
        let (near, far) = single::planes(node, shared.near[axis]);
        let origin = s.splat8(node.origin[axis]);
        let near = s.bytes8(near).mul_add(step[axis], origin);
        let far = s.bytes8(far).mul_add(step[axis], origin);
        out[axis] = [near.to_array(), far.to_array()];
        let (low, high) = (s.splat8(shared.inv_min[axis]), s.splat8(shared.inv_max[axis]));
        let near = near - s.splat8(shared.org_near[axis]);
        let far = far - s.splat8(shared.org_far[axis]);
        let slack = s.splat8(shared.slack[axis]);
        let near = (near * low).min(near * high) - slack;
        let far = (far * low).max(far * high) + slack;
        enter = near.max(enter);
        leave = far.min(leave);
    }
    (enter.le(leave).bits() & u32::from(node.valid), enter.to_array(), out)
}

/// The rays that meet the box of a child.
#[inline(always)]
fn meet<S: Simd>(s: S, planes: &Planes, slot: usize, walk: &PacketWalk) -> u32 {
    let rays = &walk.rays;
    let mut all = 0;
    for h in 0..VECTORS {
        let mut enter = s.load16(&rays.t_min[h]);
        let mut leave = s.load16(&walk.hits.t[h]);
        for axis in 0..3 {
            let inv = s.load16(&rays.inv[axis][h]);
            let near = s.splat16(planes[axis][0][slot]).mul_add(inv, s.load16(&rays.minus_off_near[axis][h]));
            let far = s.splat16(planes[axis][1][slot]).mul_add(inv, s.load16(&rays.minus_off_far[axis][h]));
            enter = near.max(enter);
            leave = far.min(leave);
        }
        all |= enter.le(leave).bits() << (16 * h);
    }
    all
}
