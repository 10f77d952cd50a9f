//! Packets: the state of coherent rays that are traced as one, and how rays enter and leave the kernel.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::bvh::trace::SlabHeuristic;
use super::hit::{Counters, TriHit};
use super::packet_prepare::{self, Common};
use super::place::{Place, Rooted};
use super::ray::{LocalRay, LocalRays, UNIT, abs};
use super::surface::Groups;
use super::walk::{Entered, Walk};
use crate::math::{Cone, PACKET, Ray, bits, first_rays};
use crate::simd::{Isa, Lanes, Mask, Op, Simd, dispatch};
use bytemuck::{must_cast, must_cast_ref};
use glam::Vec3;
use std::mem::offset_of;

/// Number of vectors that hold a packet's rays.
pub(super) const VECTORS: usize = PACKET / 16;
/// All rays, one bit each.
const ALL: u32 = first_rays(PACKET);

/// One number for each ray.
pub(super) type Row = [[f32; 16]; VECTORS];

/// The number of ray `i`.
#[inline(always)]
pub(super) fn at(row: &Row, i: usize) -> f32 {
    row.as_flattened()[i & (PACKET - 1)]
}

/// The number of ray `i`, mutable.
#[inline(always)]
pub(super) fn at_mut(row: &mut Row, i: usize) -> &mut f32 {
    &mut row.as_flattened_mut()[i & (PACKET - 1)]
}

/// A stack entry of a packet: a child that some rays still have to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct PacketEntry {
    /// Lower bound on the distance at which any ray enters the child.
    pub t: f32,
    /// Rays that may enter the child.
    pub rays: u32,
    /// The block of the child. For a reference to another block this is the block that holds the reference.
    pub block: u32,
    /// The child reference.
    pub child: u32,
}

impl Entered for PacketEntry {
    #[inline(always)]
    fn t(&self) -> f32 {
        self.t
    }
}

/// The rays of a packet, one lane each. Lanes without a ray repeat the first ray.
#[derive(Debug)]
#[repr(C, align(64))]
pub(super) struct PacketRays {
    /// Origins and directions by axis.
    pub org: [Row; 3],
    pub dir: [Row; 3],
    pub t_min: Row,
    /// Inverse directions, and the constants of the triangle test, see [`crate::geom::Shear`].
    pub inv: [Row; 3],
    pub shear: [Row; 3],
    /// Footprints, see [`LocalRay::cone`]: `a`, then `b`.
    pub cone: [Row; 2],
}

impl PacketRays {
    /// Footprint of ray `i`.
    #[inline(always)]
    pub fn cone(&self, i: usize) -> Cone {
        Cone { a: at(&self.cone[0], i), b: at(&self.cone[1], i) }
    }

    /// Returns ray `i` as a single ray, with an infinite `t_max`.
    #[inline(always)]
    pub fn one(&self, i: usize) -> LocalRay {
        let (org, dir) = (&self.org, &self.dir);
        let org = Vec3::new(at(&org[0], i), at(&org[1], i), at(&org[2], i));
        let dir = Vec3::new(at(&dir[0], i), at(&dir[1], i), at(&dir[2], i));
        LocalRay { org, dir, t_min: at(&self.t_min, i), t_max: f32::INFINITY, cone: self.cone(i) }
    }
}

/// The best hits, one lane each.
#[derive(Debug)]
#[repr(C, align(64))]
pub(super) struct PacketHits {
    /// Rays that have a hit. For the others only `t` is valid: it is their greatest distance.
    pub some: u32,
    pub t: Row,
    pub u: Row,
    pub v: Row,
    /// Integers stored as floats, because the vectors hold floats.
    pub block: Row,
    pub tri: Row,
}

/// The state of a packet's rays in one tree. Reusable.
#[derive(Debug)]
pub struct PacketWalk {
    pub(super) stack: Vec<PacketEntry>,
    pub(super) rays: PacketRays,
    pub(super) hits: PacketHits,
    /// True if the rays can be traced as one packet. `common` is valid only then.
    pub(super) together: bool,
    pub(super) common: Common,
    /// Rays that have not ended.
    pub(super) waiting: u32,
    /// Rays that are at the member of the last [`super::Outcome::Member`].
    pub(super) at_member: u32,
    /// True if no ray has left the root.
    pub(super) is_new: bool,
    /// Distance at which each ray first entered a stand-in, see [`Walk::first_cell`].
    pub(super) first_cell: Row,
    /// Walk for rays that leave the packet.
    pub(super) alone: Walk,
    /// If all rays are traced as single rays, the ray that `alone` currently holds ([`PacketWalk::next_alone`]).
    put_down: Option<usize>,
    pub(super) slab_heuristic: SlabHeuristic,
    /// Work done by the walks.
    pub(super) counters: Counters,
}

impl Default for PacketWalk {
    fn default() -> Self {
        Self::new()
    }
}

impl PacketWalk {
    /// Origins count as near each other if they differ along no axis by more than this part of the tree's greatest
    /// coordinate.
    pub const NEAR: f32 = 1.0 / 64.0;

    /// A walk for any number of packets.
    pub fn new() -> Self {
        let none = [[0.0; 16]; VECTORS];
        let zero = [none; 3];
        let rays = PacketRays { org: zero, dir: zero, inv: zero, shear: zero, t_min: none, cone: [none; 2] };
        let hits = PacketHits { some: 0, t: none, u: none, v: none, block: none, tri: none };
        Self {
            stack: Vec::new(),
            rays,
            hits,
            together: false,
            common: Common::default(),
            waiting: 0,
            at_member: 0,
            is_new: false,
            first_cell: [[f32::INFINITY; 16]; VECTORS],
            alone: Walk::new(),
            put_down: None,
            slab_heuristic: SlabHeuristic::OFF,
            counters: Counters::default(),
        }
    }

    /// A walk for rays of queries, see [`PacketWalk::begin_batch`].
    pub fn of_queries() -> Self {
        Self { slab_heuristic: SlabHeuristic::TOGETHER, ..Self::new() }
    }

    /// For rays of queries: enables the test of oriented slabs. The statistics that decide whether the test pays start
    /// anew, so that earlier rays have no influence.
    pub fn begin_batch(&mut self) {
        self.slab_heuristic = SlabHeuristic::TOGETHER;
    }

    /// Places the rays of `active` (bit `i`: ray `i`) at the root of `tree`; the others miss.
    pub fn begin(&mut self, tree: &impl Rooted, rays: &[LocalRay; PACKET], active: u32) {
        for (i, ray) in rays.iter().enumerate() {
            self.set(i, ray);
        }
        self.start(tree, active);
    }

    /// Stores ray `i`, which is below [`PACKET`]. A call of [`PacketWalk::start`] must follow. This function is
    /// separate from it because a loop that is compiled for a wider instruction set gathers the fields, which takes
    /// longer than all other work here.
    #[inline(always)]
    pub fn set(&mut self, i: usize, ray: &LocalRay) {
        let r = &mut self.rays;
        for axis in 0..3 {
            (*at_mut(&mut r.org[axis], i), *at_mut(&mut r.dir[axis], i)) = (ray.org[axis], ray.dir[axis]);
        }
        (*at_mut(&mut r.cone[0], i), *at_mut(&mut r.cone[1], i)) = (ray.cone.a, ray.cone.b);
        *at_mut(&mut r.t_min, i) = ray.t_min;
        *at_mut(&mut self.hits.t, i) = ray.t_max;
    }

    /// Stores the directions and footprints ([`LocalRay::cone_of`]) of world rays for a tree with a frame that is only
    /// translated. With `is_exact` no ray has a footprint. The other fields come from [`PacketWalk::set_all_but_dirs`].
    /// Rays that [`PacketWalk::start`] leaves out may be arbitrary.
    #[inline]
    pub fn set_dirs_of(&mut self, tree: &impl Rooted, rays: &[Ray; PACKET], is_exact: bool) {
        dispatch(tree.isa(), SetDirs { walk: self, rays: must_cast_ref(rays), is_exact });
    }

    /// The rays at the member of the last [`super::Outcome::Member`].
    #[inline]
    pub fn at_member(&self) -> u32 {
        self.at_member
    }

    /// Ignores all that is beyond `t` on ray `i` from now on.
    #[inline]
    pub fn shorten(&mut self, i: usize, t: f32) {
        let least = at_mut(&mut self.hits.t, i);
        if t < *least {
            *least = t;
            self.hits.some &= !(1 << i);
        }
    }

    /// Ends ray `i`.
    #[inline]
    pub fn stop(&mut self, i: usize) {
        self.waiting &= !(1 << i);
    }

    /// Sets the state as if all rays had been traced and missed. The distances of the rays are unspecified.
    #[inline]
    pub fn miss(&mut self) {
        self.stack.clear();
        (self.waiting, self.hits.some, self.put_down) = (0, 0, None);
        self.first_cell = [[f32::INFINITY; 16]; VECTORS];
    }

    /// Stores the origin and the interval of `ray` for all rays.
    #[inline]
    pub fn set_all_but_dirs(&mut self, ray: &LocalRay) {
        for (axis, v) in ray.org.to_array().into_iter().enumerate() {
            self.rays.org[axis] = [[v; 16]; VECTORS];
        }
        self.rays.t_min = [[ray.t_min; 16]; VECTORS];
        self.hits.t = [[ray.t_max; 16]; VECTORS];
    }

    /// Stores the directions, axis by axis, and the widths at distance 1 of all rays. Returns false if a direction is
    /// not unit: then the width differs from [`LocalRay::cone_of`].
    #[inline]
    pub fn set_dirs(&mut self, dir: &[[f32; PACKET]; 3], width: &[f32; PACKET]) -> bool {
        let mut is_unit = true;
        for i in 0..PACKET {
            is_unit &= LocalRay::is_unit(Vec3::new(dir[0][i], dir[1][i], dir[2][i]));
        }
        self.rays.dir = must_cast(*dir);
        self.rays.cone = [[[0.0; 16]; VECTORS], must_cast(*width)];
        is_unit
    }

    /// Stores all rays. A call of [`PacketWalk::start`] must follow.
    #[inline]
    pub fn set_rows(&mut self, rays: &LocalRays<PACKET>) {
        let LocalRays { org, dir, t_min, t_max, cone } = rays;
        let r = &mut self.rays;
        (r.org, r.dir, r.cone) = (must_cast(*org), must_cast(*dir), must_cast(*cone));
        (r.t_min, self.hits.t) = (must_cast(*t_min), must_cast(*t_max));
    }

    /// True if each of the first `count` stored rays starts within `near` of the tree's origin on each axis, has a
    /// direction of usual magnitude ([`USUAL_DIRS`]) and has a finite `t_min`. A negative `t_min` is set to zero.
    pub fn is_within(&mut self, tree: &impl Rooted, count: usize, near: f32) -> bool {
        dispatch(tree.isa(), Within { walk: self, near }) | !first_rays(count) == u32::MAX
    }

    /// Places the stored rays in `active` at the root of `tree`; the others miss.
    pub fn start(&mut self, tree: &impl Rooted, active: u32) {
        dispatch(tree.isa(), Start { walk: self, root: tree.root(), max_coord: tree.max_coord(), active });
    }

    /// Returns the rays of `among` that can be traced in one packet with the first of them, judged by the stored
    /// directions.
    pub fn alike(&self, among: u32) -> u32 {
        let class = |i: usize| {
            let dir = self.rays.one(i).dir;
            let size = dir.abs();
            // Ties are resolved as in `packet_prepare::greatest_axis`.
            let is_x = size.y <= size.x && size.z <= size.x;
            (dir.cmpge(Vec3::ZERO).bitmask(), is_x, !is_x && size.z <= size.y)
        };
        let first = class(among.trailing_zeros() as usize & (PACKET - 1));
        (0..PACKET).filter(|&i| among >> i & 1 == 1 && class(i) == first).fold(0, |all, i| all | 1 << i)
    }

    /// Keeps the hits of the rays of `lanes`, and takes those of all other rays from `others`.
    pub fn join(&mut self, lanes: u32, others: &PacketWalk) {
        let (hits, others, first_cell) = (&mut self.hits, &others.hits, &others.first_cell);
        hits.some = hits.some & lanes | others.some & !lanes;
        let rows = [&mut hits.t, &mut hits.u, &mut hits.v, &mut hits.block, &mut hits.tri, &mut self.first_cell];
        let of_others = [&others.t, &others.u, &others.v, &others.block, &others.tri, first_cell];
        for (row, other) in rows.into_iter().zip(of_others) {
            for i in (0..PACKET).filter(|i| lanes >> i & 1 == 0) {
                *at_mut(row, i) = at(other, i);
            }
        }
    }

    /// True if the rays gain from being traced as one packet. All directions must have the same signs and be greatest
    /// on the same axis. All origins must be near each other, as those of neighbouring pixels are; the caller skips
    /// this test with `says`.
    #[inline]
    pub fn is_coherent(&self, tree: &impl Rooted, says: bool) -> bool {
        self.together && (says || self.common.spread() <= tree.max_coord() * Self::NEAR)
    }

    /// The best hit of ray `i` so far.
    #[inline]
    pub fn best(&self, i: usize) -> TriHit {
        let h = &self.hits;
        if h.some >> i & 1 == 0 {
            return TriHit::none(at(&h.t, i));
        }
        let (block, tri) = (at(&h.block, i).to_bits(), at(&h.tri, i).to_bits());
        TriHit { t: at(&h.t, i), u: at(&h.u, i), v: at(&h.v, i), block, tri }
    }

    /// Distance at which each ray first entered a stand-in, see [`Walk::first_cell`].
    #[inline]
    pub fn first_cell(&self) -> &[f32; PACKET] {
        must_cast_ref(&self.first_cell)
    }

    /// Rays that have a hit.
    #[inline]
    pub fn found(&self) -> u32 {
        self.hits.some
    }

    /// Distance of the best hit of each ray, or its `t_max` if it has none.
    #[inline]
    pub fn distances(&self) -> &[f32; PACKET] {
        must_cast_ref(&self.hits.t)
    }

    /// The directions, axis by axis.
    #[inline]
    pub fn dirs(&self) -> &[[f32; PACKET]; 3] {
        must_cast_ref(&self.rays.dir)
    }

    /// The footprints: widths at the origins, and their growth for each unit of distance.
    #[inline]
    pub fn cones(&self) -> &[[f32; PACKET]; 2] {
        must_cast_ref(&self.rays.cone)
    }

    /// Groups the rays of `lanes`, which all have hits, by the triangle that they hit.
    pub fn hits(&self, isa: Isa, lanes: u32, out: &mut Groups<PACKET>) {
        dispatch(isa, Hits { walk: self, lanes, out });
    }

    /// True if no ray has a footprint.
    pub(super) fn is_exact(&self) -> bool {
        self.rays.cone.as_flattened().as_flattened().iter().all(|w| *w == 0.0)
    }

    /// Places rays at the root again. They keep their best hits.
    pub(super) fn begin_again(&mut self, tree: &impl Rooted, rays: u32) {
        self.waiting = rays;
        if let Some(Place { block, item }) = tree.root() {
            self.stack.push(PacketEntry { t: 0.0, rays, block, child: item });
        }
    }

    /// For rays that are all traced as single rays: returns the next ray that has not ended. [`PacketWalk::alone`]
    /// holds it at the root of `tree`, or where it stopped.
    pub(super) fn next_alone(&mut self, tree: &impl Rooted) -> Option<usize> {
        if self.put_down.is_none() {
            self.put_down = bits(self.waiting).next();
            if let Some(i) = self.put_down {
                let ray = LocalRay { t_max: at(&self.hits.t, i), ..self.rays.one(i) };
                self.alone.begin(tree, &ray);
            }
        }
        self.put_down
    }

    /// Stores the result of ray `i` from [`PacketWalk::alone`]. The ray has then ended.
    pub(super) fn take_alone(&mut self, i: usize) {
        self.put_down = None;
        self.waiting &= !(1 << i);
        *at_mut(&mut self.first_cell, i) = self.alone.first_cell();
        let (hit, to) = (self.alone.best(), &mut self.hits);
        if hit.is_hit() {
            to.some |= 1 << i;
            (*at_mut(&mut to.t, i), *at_mut(&mut to.u, i), *at_mut(&mut to.v, i)) = (hit.t, hit.u, hit.v);
            (*at_mut(&mut to.block, i), *at_mut(&mut to.tri, i)) = (f32::from_bits(hit.block), f32::from_bits(hit.tri));
        }
    }

    /// Work done by packets and single rays. A node that a packet visits counts once.
    pub fn counters(&self) -> Counters {
        let mut all = self.counters;
        all += self.alone.counters;
        all
    }
}

struct Hits<'a> {
    walk: &'a PacketWalk,
    lanes: u32,
    out: &'a mut Groups<PACKET>,
}

impl Op for Hits<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { walk, lanes, out } = self;
        let PacketHits { block, tri, .. } = &walk.hits;
        let mut left = lanes & same(s, tri, TriHit::FLAGS, 0);
        (out.cells, out.count) = (lanes & !left, 0);
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            let like = same(s, tri, u32::MAX, at(tri, i).to_bits()) & same(s, block, u32::MAX, at(block, i).to_bits());
            out.rays[out.count & (PACKET - 1)] = left & like;
            out.count += 1;
            left &= !like;
        }
    }
}

/// Returns the rays for which the bits of the word in `mask` equal `bits`.
#[inline(always)]
fn same<S: Simd>(s: S, row: &Row, mask: u32, bits: u32) -> u32 {
    let mut all = 0;
    for h in 0..VECTORS {
        all |= s.same16(&row[h], mask, bits) << (16 * h);
    }
    all
}

struct SetDirs<'a> {
    walk: &'a mut PacketWalk,
    /// The words of each [`Ray`].
    rays: &'a [[[f32; 16]; 16]; VECTORS],
    is_exact: bool,
}

/// First word of a ray's direction. Three words of direction, two widths and a mask end the ray.
const DIR: usize = offset_of!(Ray, dir) / 4;
const _: () = assert!(offset_of!(Ray, cone) == offset_of!(Ray, dir) + 12 && DIR + 6 == 16);

impl Op for SetDirs<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let r = &mut self.walk.rays;
        for (h, rays) in self.rays.iter().enumerate() {
            let [x, y, z, a] = s.columns4(rays, DIR);
            (r.dir[0][h], r.dir[1][h], r.dir[2][h]) = (x.to_array(), y.to_array(), z.to_array());
            if self.is_exact {
                (r.cone[0][h], r.cone[1][h]) = ([0.0; 16], [0.0; 16]);
                continue;
            }
            let [_, _, b, _] = s.columns4(rays, DIR + 2);
            (r.cone[0][h], r.cone[1][h]) = (a.to_array(), b.to_array());
            // The same test as in `LocalRay::is_unit`.
            let (zero, one) = (s.splat16(0.0), s.splat16(1.0));
            if abs(zero, x * x + y * y + z * z - one).le(s.splat16(UNIT)).bits() != 0xffff {
                cones_of(r, h);
            }
        }
    }
}

/// Computes the footprints of rays with directions that are not unit, see [`LocalRay::cone_of`].
#[inline(never)]
fn cones_of(rays: &mut PacketRays, h: usize) {
    for i in 16 * h..16 * h + 16 {
        let ray = rays.one(i);
        let Cone { a, b } = LocalRay::cone_of(ray.cone, ray.dir);
        (*at_mut(&mut rays.cone[0], i), *at_mut(&mut rays.cone[1], i)) = (a, b);
    }
}

struct Start<'a> {
    walk: &'a mut PacketWalk,
    root: Option<Place>,
    max_coord: f32,
    active: u32,
}

impl Op for Start<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { walk, root, max_coord, active } = self;
        walk.stack.clear();
        (walk.hits.some, walk.together, walk.put_down, walk.is_new) = (0, false, None, true);
        walk.first_cell = [[f32::INFINITY; 16]; VECTORS];
        walk.waiting = packet_prepare::valid(s, &walk.rays, &walk.hits.t) & active & ALL;
        let Some(Place { block, item }) = root.filter(|_| walk.waiting != 0) else {
            walk.waiting = 0;
            return;
        };
        if walk.waiting != ALL {
            repeat_first(walk);
        }
        walk.together = packet_prepare::prepare(s, &mut walk.rays, max_coord, &mut walk.common);
        walk.stack.push(PacketEntry { t: 0.0, rays: walk.waiting, block, child: item });
    }
}

struct Within<'a> {
    walk: &'a mut PacketWalk,
    near: f32,
}

impl Op for Within<'_> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> u32 {
        packet_prepare::within(s, &mut self.walk.rays, self.near)
    }
}

/// Fills the lanes without a ray with the first ray, and ends their interval before it begins, so that they hit no box.
#[cold]
fn repeat_first(walk: &mut PacketWalk) {
    let first = walk.waiting.trailing_zeros() as usize;
    let r = &mut walk.rays;
    for i in (0..PACKET).filter(|i| walk.waiting >> i & 1 == 0) {
        *at_mut(&mut walk.hits.t, i) = f32::NEG_INFINITY;
        *at_mut(&mut r.t_min, i) = at(&r.t_min, first);
        (*at_mut(&mut r.cone[0], i), *at_mut(&mut r.cone[1], i)) = (at(&r.cone[0], first), at(&r.cone[1], first));
        for axis in 0..3 {
            *at_mut(&mut r.org[axis], i) = at(&r.org[axis], first);
            *at_mut(&mut r.dir[axis], i) = at(&r.dir[axis], first);
        }
    }
}
