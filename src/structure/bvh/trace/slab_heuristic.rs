//! Decides if the test of oriented slabs pays off where no cell can stand in.
//!
//! Boxes of long thin triangles are mostly empty, and their oriented slabs (`lod`) are not. Of the leaves with boxes
//! that rays hit, the slabs reject nine of ten in CAD soups, and one of three in scans. Computing the slabs takes about
//! half as long as a visit that they save. For packets it takes about as long as one visit, because their leaf test
//! rejects triangles for all rays at once. So walks count the visits that slabs save, and where these are too few, they
//! test the slabs of only one node in [`EVERY`].
//!
//! Hits do not depend on the heuristic, except for slivers hit edge-on (`trace`): the triangle test accepts rays
//! slightly beyond their ends, and the slabs reject these. (Where cells may stand in, the slabs of other cells are not
//! tested: `stream_step.rs`.) The counts restart with each batch of queries, so that answers do not depend on the
//! threads that traced other rays. Frames use no heuristic ([`SlabHeuristic::OFF`]): their pictures are the same with
//! any number of threads and any instruction set.

/// Cost of testing the slabs of a node for a single ray, the same for a packet (`TOGETHER`), and gain of a child that
/// needs no visit (`CHILD`), all in one unit. (With 3 for packets too, shadow rays of a scan of 10 million triangles
/// took a tenth more time.)
const ALONE: i32 = 3;
const TOGETHER: i32 = 9;
const CHILD: i32 = 8;
/// Bound of the balance in either direction, so that a walk that reaches a different surface changes its decision soon.
const MOST: i32 = 256;
/// Where slabs do not pay off, one node in `EVERY` is tested all the same.
const EVERY: u32 = 32;
/// Weight of such a node.
const WEIGHT: i32 = 8;

/// The balance of gains and costs of recent slab tests.
#[derive(Debug, Clone, Copy)]
pub(in crate::structure) struct SlabHeuristic {
    is_on: bool,
    test: i32,
    saved: i32,
    skipped: u32,
}

impl SlabHeuristic {
    /// Tests no slabs.
    pub const OFF: Self = Self { is_on: false, test: 0, saved: 0, skipped: 0 };
    /// For single rays.
    pub const ALONE: Self = Self { is_on: true, test: ALONE, ..Self::OFF };
    /// For packets.
    pub const TOGETHER: Self = Self { test: TOGETHER, ..Self::ALONE };

    /// True if the slabs of the next node are to be tested.
    #[inline(always)]
    pub fn asks(&mut self) -> bool {
        self.skipped = self.skipped.wrapping_add(1);
        self.is_on && (self.saved >= 0 || self.skipped.is_multiple_of(EVERY))
    }

    /// Records that `children` of the children of a node need no visit. Its slabs were tested.
    #[inline(always)]
    pub fn saw(&mut self, children: u32) {
        self.saw_by(children, 1);
    }

    /// Records the test of a node's slabs for several rays, which saves `children` visits over all of them.
    #[inline(always)]
    pub fn saw_by(&mut self, children: u32, rays: u32) {
        let saved = children as i32 * CHILD / rays.max(1) as i32 - self.test;
        let saved = if self.saved < 0 { saved * WEIGHT } else { saved };
        self.saved = (self.saved + saved).clamp(-MOST, MOST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the share of `nodes` that are tested if each saves `children` visits.
    fn share(slab_heuristic: &mut SlabHeuristic, nodes: u32, children: impl Fn(u32) -> u32) -> f32 {
        let mut asked = 0;
        for node in 0..nodes {
            if slab_heuristic.asks() {
                slab_heuristic.saw(children(node));
                asked += 1;
            }
        }
        asked as f32 / nodes as f32
    }

    #[test]
    fn slabs_are_tested_where_they_save_enough_and_sampled_elsewhere() {
        let mut slab_heuristic = SlabHeuristic::ALONE;
        assert!(share(&mut slab_heuristic, 10_000, |_| 1) > 0.999);
        let rarely = share(&mut slab_heuristic, 10_000, |node| u32::from(node % 8 == 0));
        assert!((0.03..0.12).contains(&rarely), "{rarely}");
        // The heuristic recovers.
        assert!(share(&mut slab_heuristic, 10_000, |_| 1) > 0.9);
        assert!(share(&mut slab_heuristic, 10_000, |_| 0) < 0.05);
        // A test for a packet costs more.
        slab_heuristic = SlabHeuristic::TOGETHER;
        assert!(share(&mut slab_heuristic, 10_000, |_| 1) < 0.05);
        slab_heuristic = SlabHeuristic::TOGETHER;
        assert!(share(&mut slab_heuristic, 10_000, |_| 2) > 0.999);
        slab_heuristic = SlabHeuristic::OFF;
        assert_eq!(share(&mut slab_heuristic, 10_000, |_| 2), 0.0);
    }
}
