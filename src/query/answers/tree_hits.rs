//! The hits of a row's rays in one tree, from whichever walk found them.

use super::InTree;
use crate::math::{PACKET, bits};
use crate::scene::Group;
use crate::scene::stream::StreamHits;
use crate::scene::walk::{FirstCell, Found};
use crate::simd::Isa;
use crate::structure::TriHit;
use crate::structure::surface::Groups;

/// The hits of up to `N` rays in a tree.
pub(crate) trait TreeHits<const N: usize> {
    /// The hit of ray `i`, which must have one.
    fn hit(&self, i: usize) -> TriHit;
    /// The distance of ray `i` to its hit, in the world.
    fn t(&self, i: usize) -> f64;
    /// Where ray `i` first entered a stand-in. `at` is the tree that it hits.
    fn first_cell(&self, i: usize, at: &InTree) -> FirstCell;
    /// The distances of `rays` to their hits. Values of other rays are arbitrary.
    fn distances(&self, rays: u32, out: &mut [f64; N]);
    /// Groups `rays` by the primitives that they hit.
    fn group(&self, isa: Isa, rays: u32, out: &mut Groups<N>);
}

/// Hits of a group that went through [one tree](Group::only).
impl TreeHits<PACKET> for Group {
    #[inline]
    fn hit(&self, i: usize) -> TriHit {
        debug_assert!(self.only().is_some());
        self.walk().best(i)
    }
    #[inline]
    fn t(&self, i: usize) -> f64 {
        self.distance(i)
    }
    #[inline]
    fn first_cell(&self, i: usize, at: &InTree) -> FirstCell {
        Group::first_cell(self, i, at.id.number())
    }
    #[inline]
    fn distances(&self, _: u32, out: &mut [f64; PACKET]) {
        self.distances_in_tree(out);
    }
    #[inline]
    fn group(&self, isa: Isa, rays: u32, out: &mut Groups<PACKET>) {
        self.walk().hits(isa, rays, out);
    }
}

impl<const N: usize> TreeHits<N> for StreamHits<'_> {
    #[inline(always)]
    fn hit(&self, i: usize) -> TriHit {
        StreamHits::hit(self, i)
    }
    #[inline(always)]
    fn t(&self, i: usize) -> f64 {
        StreamHits::t(self, i)
    }
    #[inline(always)]
    fn first_cell(&self, i: usize, at: &InTree) -> FirstCell {
        StreamHits::first_cell(self, i, at.id.number())
    }
    #[inline(always)]
    fn distances(&self, rays: u32, out: &mut [f64; N]) {
        bits(rays).for_each(|i| out[i] = StreamHits::t(self, i));
    }
    #[inline(always)]
    fn group(&self, _: Isa, rays: u32, out: &mut Groups<N>) {
        group_singly(rays, |i| StreamHits::hit(self, i), out);
    }
}

/// Makes a group of each ray that hits a triangle.
#[inline(always)]
fn group_singly<const N: usize>(rays: u32, hit: impl Fn(usize) -> TriHit, out: &mut Groups<N>) {
    (out.cells, out.count) = (0, 0);
    for i in bits(rays) {
        let is_cell = hit(i).stand_in().is_some();
        out.cells |= u32::from(is_cell) << i;
        out.rays[out.count & (N - 1)] = 1 << i;
        out.count += usize::from(!is_cell);
    }
}

impl<const N: usize> TreeHits<N> for [Found] {
    #[inline(always)]
    fn hit(&self, i: usize) -> TriHit {
        self[i].tri
    }
    #[inline(always)]
    fn t(&self, i: usize) -> f64 {
        self[i].t
    }
    #[inline(always)]
    fn first_cell(&self, i: usize, _: &InTree) -> FirstCell {
        self[i].first_cell
    }
    #[inline(always)]
    fn distances(&self, rays: u32, out: &mut [f64; N]) {
        bits(rays).for_each(|i| out[i] = self[i].t);
    }
    #[inline(always)]
    fn group(&self, _: Isa, rays: u32, out: &mut Groups<N>) {
        group_singly(rays, |i| self[i].tri, out);
    }
}
