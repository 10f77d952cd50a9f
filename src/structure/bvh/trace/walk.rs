//! A walk: what a ray still has to visit, and the best hit so far. It can be put down at a missing
//! block and taken up again.

use super::ray::LocalRay;
use crate::base::ids::BlockId;

/// Whether a walk has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The answer is in the walk.
    Done,
    /// This block is needed. Call again with the same walk once it is in memory.
    Pending(BlockId),
}

/// Where a ray meets a triangle of a tree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriHit {
    /// Distance in units of the ray's direction.
    pub t: f32,
    /// Weight of the second vertex.
    pub u: f32,
    /// Weight of the third vertex.
    pub v: f32,
    /// The block that holds the triangle.
    pub block: u32,
    /// The triangle in the block; opaque.
    pub tri: u32,
}

impl TriHit {
    /// No hit up to `t_max`.
    pub const fn none(t_max: f32) -> Self {
        Self { t: t_max, u: 0.0, v: 0.0, block: u32::MAX, tri: 0 }
    }

    /// Whether there is a hit.
    #[inline(always)]
    pub fn is_hit(&self) -> bool {
        self.block != u32::MAX
    }
}

/// What walks did; added up over rays, never reset by them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Nodes whose children's boxes were tested.
    pub nodes: u64,
    /// Leaves visited.
    pub leaves: u64,
    /// Cache lines that these are in.
    pub leaf_lines: u64,
    /// Triangles tested.
    pub triangles: u64,
    /// Times that the walk went from one block to another.
    pub blocks: u64,
    /// Ties that primitive ids had to decide.
    pub ties: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, o: Self) {
        self.nodes += o.nodes;
        self.leaves += o.leaves;
        self.leaf_lines += o.leaf_lines;
        self.triangles += o.triangles;
        self.blocks += o.blocks;
        self.ties += o.ties;
    }
}

/// Something still to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// Where the ray enters it.
    pub t: f32,
    /// The block that it is in; of a reference to another block, the one that holds that.
    pub block: u32,
    /// The child reference.
    pub child: u32,
}

/// The state of one ray in one tree. Reusable: a new ray forgets the last one but not the memory.
#[derive(Debug)]
pub struct Walk {
    pub(super) stack: Vec<Entry>,
    pub(super) ray: LocalRay,
    pub(super) best: TriHit,
    /// What walks with it did.
    pub counters: Counters,
    /// Where the ray passed a stand-in first; infinity if it passed none.
    pub(super) passed: f32,
}

impl Default for Walk {
    fn default() -> Self {
        Self::new()
    }
}

impl Walk {
    /// For any number of rays.
    pub fn new() -> Self {
        let (ray, best) = (LocalRay::NONE, TriHit::none(0.0));
        Self { stack: Vec::new(), ray, best, counters: Counters::default(), passed: f32::INFINITY }
    }

    /// Puts `ray` at the root of `view`. An invalid ray (see [`LocalRay::is_valid`]) misses all.
    pub fn begin(&mut self, view: &super::TreeView, ray: &LocalRay) {
        self.ray = *ray;
        self.put_at_root(view, ray);
    }

    /// The best hit so far; [`TriHit::is_hit`] tells whether there is one.
    #[inline]
    pub fn best(&self) -> TriHit {
        self.best
    }

    /// Where the ray passed a stand-in first; infinity if it passed none. (Up to the hit, if there is one, that is the same whatever the
    /// order; behind it, it may be found or not.) From there on there may be surface.
    #[inline]
    pub fn passed(&self) -> f32 {
        self.passed
    }

    #[inline(always)]
    pub(super) fn put_at_root(&mut self, view: &super::TreeView, ray: &LocalRay) {
        self.stack.clear();
        self.passed = f32::INFINITY;
        self.best = TriHit::none(ray.t_max);
        if ray.is_valid() && !view.is_empty() {
            self.stack.push(Entry { t: ray.t_min, block: view.root_block, child: view.root });
        }
    }
}

/// Something on a stack that no ray enters before a distance.
pub(super) trait Entered: Copy {
    /// The distance.
    fn t(&self) -> f32;
}

impl Entered for Entry {
    #[inline(always)]
    fn t(&self) -> f32 {
        self.t
    }
}

/// Pushes an entry below those above `bottom` that are nearer.
#[inline(always)]
pub(super) fn push_sorted<E: Entered>(stack: &mut Vec<E>, bottom: usize, next: E) {
    let mut at = stack.len();
    stack.push(next);
    while at > bottom && stack[at - 1].t() < next.t() {
        stack[at] = stack[at - 1];
        at -= 1;
    }
    stack[at] = next;
}
