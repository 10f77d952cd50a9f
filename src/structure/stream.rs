//! Streams: many single rays that are traced in one call, and the state of that call.

use super::bvh::trace::StreamLanes;
use super::hit::Counters;
use super::ray::{LocalRay, LocalRays};
use super::walk::Walk;
use crate::math::{PACKET, STREAM};

/// Number of rays in a group.
pub(super) const GROUP: usize = 16;

/// Sixteen rays as the caller gave them, not yet prepared.
pub(super) type Rays16 = LocalRays<GROUP>;

impl Rays16 {
    /// True if no ray has a footprint.
    pub fn is_exact(&self) -> bool {
        self.cone.as_flattened().iter().all(|w| *w == 0.0)
    }
}

/// State of a stream. Reusable; no ray of an earlier stream is traced again.
#[derive(Debug)]
pub struct Stream {
    pub(super) rays: Box<[Rays16; STREAM / GROUP]>,
    pub(super) unfinished: Vec<u32>,
    /// Distance at which each ray first entered a stand-in, see [`Walk::first_cell`].
    pub(super) first_cell: Box<[f32; STREAM]>,
    /// Walk for rays that are traced one after the other.
    pub(super) alone: Walk,
    pub(super) bvh: StreamLanes,
    /// Work done by the walks.
    pub counters: Counters,
}

impl Default for Stream {
    fn default() -> Self {
        Self::new()
    }
}

/// Boxes `N` copies without first placing them on the stack.
pub(super) fn boxed<T: Clone, const N: usize>(one: T) -> Box<[T; N]> {
    match vec![one; N].try_into() {
        Ok(all) => all,
        Err(_) => unreachable!(),
    }
}

impl Stream {
    /// A stream for any number of rays.
    pub fn new() -> Self {
        Self::with(StreamLanes::new())
    }

    /// A stream for rays of queries. A structure may save visits by statistics that it keeps from one ray to the next.
    pub fn of_queries() -> Self {
        Self::with(StreamLanes::of_queries())
    }

    fn with(bvh: StreamLanes) -> Self {
        let (rays, first_cell) = (boxed(Rays16::NONE), boxed(f32::INFINITY));
        Self { rays, unfinished: Vec::new(), first_cell, alone: Walk::new(), bvh, counters: Counters::default() }
    }

    /// Stores ray `i`, which is below [`STREAM`].
    #[inline(always)]
    pub fn set(&mut self, i: usize, ray: &LocalRay) {
        // Adding 0 turns -0 into +0, because distances are sorted by their bits.
        let ray = LocalRay { t_min: ray.t_min + 0.0, ..*ray };
        self.rays[(i / GROUP) & (STREAM / GROUP - 1)].set(i & (GROUP - 1), &ray);
    }

    /// Stores the rays `first..first + PACKET`; `first` is a multiple of [`PACKET`], and below [`STREAM`].
    #[inline]
    pub fn set_rows(&mut self, first: usize, rays: &LocalRays<PACKET>) {
        for (half, to) in self.rays[first / GROUP..][..PACKET / GROUP].iter_mut().enumerate() {
            let of = |row: &[f32; PACKET]| std::array::from_fn(|i| row[half * GROUP + i]);
            (to.org, to.dir) = (rays.org.each_ref().map(of), rays.dir.each_ref().map(of));
            // As in `set`.
            (to.t_min, to.t_max) = (of(&rays.t_min).map(|t: f32| t + 0.0), of(&rays.t_max));
            to.cone = rays.cone.each_ref().map(of);
        }
    }

    /// Called after the first `count` rays were stored. Invalidates leftover rays of earlier calls in the last group,
    /// so that they do not influence how the others are traced.
    pub(super) fn end(&mut self, count: usize) {
        (count..count.next_multiple_of(GROUP)).for_each(|i| self.set(i, &LocalRay::NONE));
    }

    /// The groups of the first `count` rays.
    pub(super) fn groups(&self, count: usize) -> &[Rays16] {
        &self.rays[..count.div_ceil(GROUP).min(STREAM / GROUP)]
    }

    /// Returns ray `i` as it was stored.
    pub(super) fn ray(&self, i: usize) -> LocalRay {
        self.rays[(i / GROUP) & (STREAM / GROUP - 1)].one(i & (GROUP - 1))
    }

    /// Distance at which each ray of the last call first entered a stand-in, see [`Walk::first_cell`].
    #[inline]
    pub fn first_cell(&self) -> &[f32; STREAM] {
        &self.first_cell
    }

    /// Rays of the last call that reached a missing block or needed a deeper stack. They have to be traced again as
    /// single rays.
    pub fn unfinished(&self) -> &[u32] {
        &self.unfinished
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Cone;

    #[test]
    fn rays_of_earlier_calls_have_no_influence() {
        let mut stream = Stream::new();
        let wide = LocalRay { cone: Cone { a: 1.0, b: 0.0 }, ..LocalRay::NONE };
        (0..STREAM).for_each(|i| stream.set(i, &wide));
        for count in [STREAM, 2 * GROUP + 1, GROUP, 7, 0] {
            stream.end(count);
            (0..count).for_each(|i| stream.set(i, &LocalRay::NONE));
            assert!(stream.rays[..count.div_ceil(GROUP)].iter().all(Rays16::is_exact), "{count}");
            (0..STREAM).for_each(|i| stream.set(i, &wide));
        }
    }
}
