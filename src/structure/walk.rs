//! A walk: what a ray still has to visit, and the best hit so far. It can be put down at a missing
//! block and taken up again.

use super::hit::{Counters, TriHit};
use super::place::{Place, Rooted};
use super::ray::LocalRay;

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
    pub(super) transmitted: f32,
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
        Self { stack: Vec::new(), ray, best, counters: Counters::default(), transmitted: f32::INFINITY }
    }

    /// Puts `ray` at the root of `tree`. An invalid ray (see [`LocalRay::is_valid`]) misses all.
    pub fn begin(&mut self, tree: &impl Rooted, ray: &LocalRay) {
        self.ray = *ray;
        self.put_at_root(tree, ray);
    }

    /// The best hit so far; [`TriHit::is_hit`] tells whether there is one.
    #[inline]
    pub fn best(&self) -> TriHit {
        self.best
    }

    /// Where the ray passed a stand-in first; infinity if it passed none. (Up to the hit, if there is one, that is the
    /// same whatever the order; behind it, it may be found or not.) From there on there may be surface.
    #[inline]
    pub fn transmitted(&self) -> f32 {
        self.transmitted
    }

    #[inline(always)]
    pub(super) fn put_at_root(&mut self, tree: &impl Rooted, ray: &LocalRay) {
        self.stack.clear();
        self.transmitted = f32::INFINITY;
        self.best = TriHit::none(ray.t_max);
        if let Some(Place { block, item }) = tree.root().filter(|_| ray.is_valid()) {
            self.stack.push(Entry { t: ray.t_min, block, child: item });
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
