//! A walk: the stack of a ray and its best hit so far. A walk can stop at a missing block and continue later.

use super::hit::{Counters, TriHit};
use super::place::{Place, Rooted};
use super::ray::LocalRay;

/// A stack entry: a child to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// Distance at which the ray enters the child.
    pub t: f32,
    /// The block of the child. For a reference to another block this is the block that holds the reference.
    pub block: u32,
    /// The child reference.
    pub child: u32,
}

/// Number of links that walks through the resident form can put aside.
pub(super) const LINKS: usize = 128;

/// Links that a walk has still to visit, with the distances at which the ray enters them. Eight more than [`LINKS`] are
/// written.
#[derive(Debug)]
pub(super) struct Links {
    pub t: [f32; LINKS + 8],
    pub link: [u32; LINKS + 8],
}

impl Default for Links {
    fn default() -> Self {
        Self { t: [0.0; LINKS + 8], link: [0; LINKS + 8] }
    }
}

/// The state of one ray in one tree. Reusable: a new ray replaces the previous one and keeps the allocation.
#[derive(Debug)]
pub struct Walk {
    pub(super) stack: Vec<Entry>,
    pub(super) ray: LocalRay,
    pub(super) best: TriHit,
    /// True if the ray has not left the root.
    pub(super) is_new: bool,
    /// For the resident form, once it was walked: to clear it for each ray takes longer than many walks.
    pub(super) links: Option<Box<Links>>,
    /// Work done with this walk.
    pub counters: Counters,
    /// See [`Walk::first_cell`].
    pub(super) first_cell: f32,
}

impl Default for Walk {
    fn default() -> Self {
        Self::new()
    }
}

impl Walk {
    /// A walk for any number of rays.
    pub fn new() -> Self {
        let (ray, best) = (LocalRay::NONE, TriHit::none(0.0));
        Self {
            stack: Vec::new(),
            ray,
            best,
            is_new: false,
            links: None,
            counters: Counters::default(),
            first_cell: f32::INFINITY,
        }
    }

    /// Places `ray` at the root of `tree`. An invalid ray (see [`LocalRay::is_valid`]) misses everything.
    pub fn begin(&mut self, tree: &impl Rooted, ray: &LocalRay) {
        self.ray = *ray;
        self.put_at_root(tree, ray);
    }

    /// Ignores all that is beyond `t` from now on.
    #[inline]
    pub fn shorten(&mut self, t: f32) {
        if t < self.best.t {
            self.best = TriHit::none(t);
        }
    }

    /// Gives back memory that the walk does not need now.
    pub fn fit(&mut self) {
        self.stack.shrink_to_fit();
        self.links = None;
    }

    /// Bytes of memory in addition to the walk itself.
    pub fn bytes(&self) -> u64 {
        let links = if self.links.is_some() { size_of::<Links>() } else { 0 };
        (self.stack.capacity() * size_of::<Entry>() + links) as u64
    }

    /// The best hit so far; [`TriHit::is_hit`] is true if there is one.
    #[inline]
    pub fn best(&self) -> TriHit {
        self.best
    }

    /// Distance at which the ray first entered the region of a stand-in, hit or not; infinity if it entered none. From
    /// there on the ray may have missed surface, because a stand-in may transmit the ray. Up to the hit, if there is
    /// one, the value does not depend on the order of visits; a distance beyond the hit may or may not be reported.
    #[inline]
    pub fn first_cell(&self) -> f32 {
        self.first_cell
    }

    #[inline(always)]
    pub(super) fn put_at_root(&mut self, tree: &impl Rooted, ray: &LocalRay) {
        self.stack.clear();
        self.is_new = true;
        self.first_cell = f32::INFINITY;
        self.best = TriHit::none(ray.t_max);
        if let Some(Place { block, item }) = tree.root().filter(|_| ray.is_valid()) {
            self.stack.push(Entry { t: ray.t_min, block, child: item });
        }
    }
}

/// A stack entry with a lower bound on the distance at which rays enter it.
pub(super) trait Entered: Copy {
    /// The lower bound.
    fn t(&self) -> f32;
}

impl Entered for Entry {
    #[inline(always)]
    fn t(&self) -> f32 {
        self.t
    }
}

/// Pushes an entry and keeps those above `bottom` sorted, the nearest on top.
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
