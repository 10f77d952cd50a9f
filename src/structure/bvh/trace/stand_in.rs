//! Where a cell stands in for what it holds, and what a ray meets of it.
//!
//! The test is written once, over any number of lanes, with operations that round alike everywhere: single rays,
//! packets and streams, on any instruction set, see the same stand-ins to the bit. What walks visit does not depend on
//! it otherwise: their own box tests give way by as much at least (see [`super::PreparedRay::new`]), and cells nest as
//! stored, so whoever meets a cell here has met all cells above it there.
//!
//! Metric: Áfra 2012, section 6.2, compares the radius of the enclosing sphere; here it is the area of the cell's own
//! projection along the ray, the sum of |dir| times the areas of its faces, with the square of the ray's width.
//!
//! What is shown of a cell is met where the ray enters it and both of its voxel's slabs (`lod`); who misses them misses what the
//! cell holds, for certain, and passes. Only rays that begin in a cell do not ask for slabs.
//!
//! A plane `p` is met at `((p - slack) - org) * inv` at the earliest. The two differences and the product are rounded once
//! each and `inv` once, on magnitudes of at most `2 m` with `m = max(|org|, reach)`: `7 h m |inv|` in all, `h = 2^-24`.
//!
//! A slab's plane is at `low = axis . p`, with `|axis| <= 1` and the sum of its components' magnitudes at most `3^0.5`, and met at
//! `((low - slack) - org . axis) / (dir . axis)`. Products and sums of `org . axis` are off by `5 h 3^0.5 m` at most, those of the
//! cell's ends along the axis (which where planes are at the ends are all that says where) by as much, those of `dir . axis` by
//! `5 h |dir|` times `t`, where `t |dir|` is at most `2 3^0.5 m`, differences and the quotient by `8 h 3^0.5 m`: 50 h m in all.

use super::{PartFilter, TreeView};
use super::ray::abs;
use super::walk::TriHit;
use crate::lod::{Slab, Slabs};
use crate::simd::{Lanes, Mask};
use crate::structure::bvh::layout::{Block, Child, Node, WIDTH};

/// How much larger a cell is taken, as a part of the greatest magnitude of a coordinate: 7 h for rounding (see the module), the
/// rest as in [`super::ray::BOX_SLACK`], for packets test the boxes of triangles so too.
pub(super) const SLACK: f32 = 32.0 / 16_777_216.0;

/// The same for slabs: 50 h (see the module), and what is left of 64.
const SLAB_SLACK: f32 = 64.0 / 16_777_216.0;

/// In [`TriHit::tri`]: a stand-in, as fine as asked for or finer.
const LOD: u32 = 1 << 31;
/// A stand-in for a block that is not in memory.
const MISSING: u32 = 1 << 30;
/// Of those, one that the ray begins in: `t` is where it begins, for nothing is known of what is nearest from there on.
const INSIDE: u32 = 1 << 29;
/// The bits of which a triangle has none.
pub(super) const FLAGS: u32 = LOD | MISSING | INSIDE;

/// A stand-in that was hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StandIn {
    /// The node that the cell hangs in.
    pub node: usize,
    /// Its slot there.
    pub slot: usize,
    /// For want of the block below.
    pub is_missing: bool,
    /// The ray begins in it: `t` is where it begins, to be shown where it leaves it.
    pub is_inside: bool,
}

impl TriHit {
    /// The stand-in that was hit, if it was one.
    #[inline(always)]
    pub fn stand_in(&self) -> Option<StandIn> {
        if self.tri & FLAGS == 0 || !self.is_hit() {
            return None;
        }
        let place = (self.tri & !FLAGS) as usize;
        let (is_missing, is_inside) = (self.tri & MISSING != 0, self.tri & INSIDE != 0);
        Some(StandIn { node: place >> 3, slot: place & 7, is_missing, is_inside })
    }
}

/// [`TriHit::tri`] of the cell in `slot` of a node.
#[inline(always)]
pub(super) fn lod_code(node: usize, slot: usize) -> u32 {
    LOD | (node << 3 | slot) as u32
}

/// The same, where the block below is missing; `is_inside`: the ray begins in the cell.
#[inline(always)]
pub(super) fn missing_code(node: usize, slot: usize, is_inside: bool) -> u32 {
    MISSING | if is_inside { INSIDE } else { 0 } | (node << 3 | slot) as u32
}

/// Whether either is a stand-in: then `hit` is better than `best`, at the same distance, by its place.
#[inline(always)]
pub(super) fn untie(hit: &TriHit, best: &TriHit) -> Option<bool> {
    let key = |h: &TriHit| (h.tri & FLAGS, h.block, h.tri);
    ((hit.tri | best.tri) & FLAGS != 0).then(|| key(hit) < key(best))
}

/// Rays as the test needs them: many of them, or one in all lanes.
#[derive(Clone, Copy)]
pub(super) struct ConeRay<L> {
    /// Magnitudes of the direction; or, with faces of the same sign, the direction.
    pub dir: [L; 3],
    pub t_min: L,
    /// Width, see [`super::LocalRay::cone`].
    pub a: L,
    pub b: L,
}

/// What rays meet of cells.
pub(super) struct Met<L> {
    /// Lanes that meet the cell.
    pub meets: u32,
    /// Of those, lanes that begin outside.
    pub outside: u32,
    /// Of those, lanes for which it may stand in.
    pub small: u32,
    /// Where the ray enters the cell, where it begins if that is later.
    pub enter: L,
}

/// How far planes give way for a ray with origin `org` along an axis on which it goes as `inv` is signed: what is taken from
/// those that are met first, and added to those that are met last.
#[inline(always)]
pub(super) fn slack(org: f32, inv: f32, reach: f32) -> f32 {
    (org.abs().max(reach) * SLACK).copysign(inv)
}

/// The areas of cells' faces between planes as stored.
#[inline(always)]
pub(super) fn faces<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], zero: L) -> [L; 3] {
    let x = abs(zero, far[0] - near[0]);
    let y = abs(zero, far[1] - near[1]);
    let z = abs(zero, far[2] - near[2]);
    [y * z, z * x, x * y]
}

/// The sum of the areas of a cell's faces, each times |dir| across it.
#[inline(always)]
pub(super) fn area<const N: usize, L: Lanes<N>>(faces: [L; 3], dir: [L; 3]) -> L {
    dir[0] * faces[0] + dir[1] * faces[1] + dir[2] * faces[2]
}

/// Where rays enter cells and where they leave them; of cells that are larger by what single precision may do to where planes
/// are met. So where one is entered is no farther than where the ray enters the cell itself, and at most that much outside of it.
#[inline(always)]
pub(super) fn cross<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], inv: [L; 3]) -> [L; 2] {
    let enter = (near[0] * inv[0]).max(near[1] * inv[1]).max(near[2] * inv[2]);
    let leave = (far[0] * inv[0]).min(far[1] * inv[1]).min(far[2] * inv[2]);
    [enter, leave]
}

/// What is decided of cells by where rays cross them.
#[inline(always)]
pub(super) fn meet<const N: usize, L: Lanes<N>>([enter, leave]: [L; 2], faces: [L; 3], ray: &ConeRay<L>) -> Met<L> {
    let t = enter.max(ray.t_min);
    let width = ray.a + ray.b * t;
    let meets = t.le(leave).bits();
    let outside = meets & !enter.le(ray.t_min).bits();
    let small = outside & area(faces, ray.dir).le(width * width).bits();
    Met { meets, outside, small, enter: t }
}

/// Where rays begin, as slabs need it: many of them, or one, for which `L` is `f32`.
#[derive(Clone, Copy)]
pub(super) struct Origin<L> {
    org: [L; 3],
    slack: L,
}

/// A slab's planes, each less the slack and where rays begin along its axis.
#[derive(Clone, Copy)]
struct Planes<L> {
    low: L,
    high: L,
}

impl Planes<f32> {
    /// In all lanes of vectors such as `like`.
    #[inline(always)]
    fn in_all<const N: usize, L: Lanes<N>>(self, like: L) -> Planes<L> {
        Planes { low: splat(like, self.low), high: splat(like, self.high) }
    }
}

impl<L> Origin<L> {
    /// Of rays of a tree whose coordinates are at most `reach` in magnitude.
    #[inline(always)]
    pub fn new<const N: usize>(org: [L; 3], reach: f32) -> Self
    where
        L: Lanes<N>,
    {
        let zero = splat(org[0], 0.0);
        let size = abs(zero, org[0]).max(abs(zero, org[1])).max(abs(zero, org[2])).max(splat(zero, reach));
        Self { org, slack: size * splat(zero, SLAB_SLACK) }
    }

    #[inline(always)]
    fn planes<const N: usize>(&self, slab: &Slab) -> Planes<L>
    where
        L: Lanes<N>,
    {
        let Self { org, slack } = *self;
        let from = org[0] * splat(slack, slab.axis.x) + org[1] * splat(slack, slab.axis.y) + org[2] * splat(slack, slab.axis.z);
        Planes { low: splat(slack, slab.low) - slack - from, high: splat(slack, slab.high) + slack - from }
    }

    /// What is left inside of slabs of the ways of rays that go along `dir`, `[enter, leave]`: none where one is entered after it is
    /// left.
    #[inline(always)]
    pub fn within<const N: usize>(&self, dir: [L; 3], slabs: &Slabs, mut way: [L; 2]) -> [L; 2]
    where
        L: Lanes<N>,
    {
        for slab in slabs.iter() {
            way = between(dir, slab, self.planes(slab), way);
        }
        way
    }
}

/// Slabs as rays from one point see them.
#[derive(Clone, Copy)]
pub(super) struct SeenSlabs {
    slabs: Slabs,
    planes: [Planes<f32>; 2],
}

impl SeenSlabs {
    /// Of no cell.
    pub const NONE: Self = Self { slabs: Slabs::NONE, planes: [Planes { low: 0.0, high: 0.0 }; 2] };

    /// Those of a cell, from a point.
    #[inline(always)]
    pub fn new(slabs: Slabs, from: &Origin<f32>) -> Self {
        let mut planes = [from.planes(slabs.first()); 2];
        if let Some(second) = slabs.second() {
            planes[1] = from.planes(second);
        }
        Self { slabs, planes }
    }

    /// As [`Origin::within`].
    #[inline(always)]
    pub fn within<const N: usize, L: Lanes<N>>(&self, dir: [L; 3], mut way: [L; 2]) -> [L; 2] {
        way = between(dir, self.slabs.first(), self.planes[0].in_all(dir[0]), way);
        match self.slabs.second() {
            Some(second) => between(dir, second, self.planes[1].in_all(dir[0]), way),
            None => way,
        }
    }
}

/// What is left of rays' ways between a slab's planes.
#[inline(always)]
fn between<const N: usize, L: Lanes<N>>(dir: [L; 3], slab: &Slab, planes: Planes<L>, [enter, leave]: [L; 2]) -> [L; 2] {
    let axis = [splat(enter, slab.axis.x), splat(enter, slab.axis.y), splat(enter, slab.axis.z)];
    let inv = splat(enter, 1.0).div(dir[0] * axis[0] + dir[1] * axis[1] + dir[2] * axis[2]);
    let (low, high) = (planes.low * inv, planes.high * inv);
    // Along a slab they are infinite, of either sign; in this order a NaN leaves the interval as it was, or wider.
    [low.min(high).max(enter), high.max(low).min(leave)]
}

/// `v` in all lanes; `like` is any vector.
#[inline(always)]
fn splat<const N: usize, L: Lanes<N>>(like: L, v: f32) -> L {
    L::from_array_like(like, [v; N])
}

/// The children of a node that are leaves.
#[inline(always)]
pub(super) fn leaves(node: &Node) -> u32 {
    let mut leaves = 0;
    for slot in 0..WIDTH {
        leaves |= u32::from(Child::is_leaf(u32::from(node.child[slot]))) << slot;
    }
    leaves & u32::from(node.valid)
}

/// What parts have to say about a cell that could stand in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It may.
    Stand,
    /// It holds a part that is hidden, or looks otherwise, among others.
    Descend,
    /// All that it holds is hidden.
    Skip,
}

/// Whether parts allow the cell in `slot` of a node to stand in.
#[inline(always)]
pub(super) fn judge(block: Block, node: usize, slot: usize, filter: Option<&PartFilter>) -> Verdict {
    match filter {
        None => Verdict::Stand,
        Some(filter) => judge_parts(block, node, slot, filter),
    }
}

#[inline(never)]
fn judge_parts(block: Block, node: usize, slot: usize, filter: &PartFilter) -> Verdict {
    let voxel = block.voxel(node, slot);
    match voxel.part() {
        (part, false) if filter.hides(part) => Verdict::Skip,
        (_, false) => Verdict::Stand,
        (_, true) if voxel.summary() & filter.touched == 0 => Verdict::Stand,
        (_, true) => Verdict::Descend,
    }
}

impl<'a> TreeView<'a> {
    /// The block that a stand-in of `hit` stands in for, if that is missing.
    pub fn wanted(&self, hit: &TriHit) -> Option<u32> {
        let stand_in = hit.stand_in().filter(|s| s.is_missing)?;
        let block = Block::new(self.snapshot.block(crate::base::ids::BlockId(hit.block))?);
        let child = u32::from(block.node(stand_in.node).child[stand_in.slot]);
        match Child::from_bits(child) {
            Some(Child::External(i)) => Some(block.external(i).0),
            Some(Child::Leaf(_)) => Some(hit.block + self.leaves_at),
            _ => None,
        }
    }
}
