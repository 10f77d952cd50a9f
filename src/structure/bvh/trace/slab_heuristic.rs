//! Whether slabs of cells pay where nothing stands in.
//!
//! Boxes of long thin triangles are mostly empty, and their slabs (`lod`) are not: of the leaves that rays meet in CAD
//! soups nine of ten are passed by beside them, of those of scans one of three. To work slabs out takes about as long
//! as half a visit to what they save, of packets, which tell triangles beside all of their rays at once, as long as
//! one. So walks count what slabs save them, and leave slabs out where that is too little, but for one node in so many.
//!
//! Hits do not depend on it, but for slivers met edge-on (`trace`), of which the triangle test takes rays for hits that
//! pass beyond their ends: these slabs leave out. (Where cells may stand in, slabs of what does not are not asked:
//! `stream_pass`.) So that answers do not depend on which thread worked on other rays, counts begin anew with each
//! batch of queries. Frames, whose pictures are the same with any threads and vectors, ask for none: they use walks as
//! these are made.

/// What a test of a node's slabs takes a ray that goes alone, and a packet; and what a child gains that is not visited
/// for them, in the same unit. (With 3 for packets too shadow rays of a scan of 10 million took a tenth more time.)
const ALONE: i32 = 3;
const TOGETHER: i32 = 9;
const CHILD: i32 = 8;
/// How much may be saved up, either way: a walk that comes to other surface changes its mind soon.
const MOST: i32 = 256;
/// Where slabs do not pay, one node in so many is asked all the same, and counts for
const EVERY: u32 = 32;
/// so many.
const WEIGHT: i32 = 8;

/// What slabs have saved lately.
#[derive(Debug, Clone, Copy)]
pub(in crate::structure) struct SlabHeuristic {
    is_on: bool,
    test: i32,
    saved: i32,
    skipped: u32,
}

impl SlabHeuristic {
    /// No slabs are tested.
    pub const OFF: Self = Self { is_on: false, test: 0, saved: 0, skipped: 0 };
    /// For rays that go alone.
    pub const ALONE: Self = Self { is_on: true, test: ALONE, ..Self::OFF };
    /// For packets.
    pub const TOGETHER: Self = Self { test: TOGETHER, ..Self::ALONE };

    /// Whether the slabs of the next node are to be tested.
    #[inline(always)]
    pub fn asks(&mut self) -> bool {
        self.skipped = self.skipped.wrapping_add(1);
        self.is_on && (self.saved >= 0 || self.skipped.is_multiple_of(EVERY))
    }

    /// So many children need no visit, of a node whose slabs were tested.
    #[inline(always)]
    pub fn saw(&mut self, children: u32) {
        self.saw_by(children, 1);
    }

    /// The same of a node whose slabs were tested for several rays, which need not visit so many children in all.
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

    /// The share of `nodes` that are asked where each saves so many children.
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
    fn slabs_are_tested_where_they_save_enough_and_looked_at_elsewhere() {
        let mut slab_heuristic = SlabHeuristic::ALONE;
        assert!(share(&mut slab_heuristic, 10_000, |_| 1) > 0.999);
        let rarely = share(&mut slab_heuristic, 10_000, |node| u32::from(node % 8 == 0));
        assert!((0.03..0.12).contains(&rarely), "{rarely}");
        // Back again.
        assert!(share(&mut slab_heuristic, 10_000, |_| 1) > 0.9);
        assert!(share(&mut slab_heuristic, 10_000, |_| 0) < 0.05);
        // A packet takes more.
        slab_heuristic = SlabHeuristic::TOGETHER;
        assert!(share(&mut slab_heuristic, 10_000, |_| 1) < 0.05);
        slab_heuristic = SlabHeuristic::TOGETHER;
        assert!(share(&mut slab_heuristic, 10_000, |_| 2) > 0.999);
        slab_heuristic = SlabHeuristic::OFF;
        assert_eq!(share(&mut slab_heuristic, 10_000, |_| 2), 0.0);
    }
}
