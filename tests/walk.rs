//! Walks can be put down at any missing block and taken up again: the answer and the work are those of a walk that
//! was never interrupted, and the answer is that of brute force.
//!
//! Blocks are made missing by snapshots with random holes. Between rounds the holes move: only the last
//! [`LEASE`] blocks that a walk asked for are sure to stay, as an exact job's lease would have it.

use crate::common::brute::Oracle;
use crate::common::bvh64::Bvh64;
use crate::common::errors::{Answer, Judge, Verdict};
use crate::common::rays::{Ray32, RayMaker};
use crate::common::rng::Rng;
use crate::common::rounding::Rounding;
use crate::common::scenes;
use crate::common::trees::{self, TestTree};
use outcrop::base::ids::BlockId;
use outcrop::residency::Snapshot;
use outcrop::simd::Isa;
use outcrop::structure::bvh::trace::TreeView;
use outcrop::structure::{Outcome, PacketWalk, TriHit, Walk};
use proptest::prelude::*;
use std::sync::OnceLock;

/// The most blocks that one step of a walk reads at once: a leaf's and the best hit's, and the blocks with the
/// primitive ids of both, which decide a tie.
const LEASE: usize = 4;

/// A tree, and the oracle over what it stores.
struct Case {
    tree: TestTree,
    oracle: &'static Bvh64,
    judge: Judge<'static>,
}

/// Faces that touch, most of them tied; and a surface without ties. Both of several blocks.
fn cases() -> &'static [Case; 2] {
    static CASES: OnceLock<[Case; 2]> = OnceLock::new();
    CASES.get_or_init(|| {
        [(scenes::blocks(60, 1), 0.0), (scenes::bumpy_sphere(150, 200, 1), 0.3)].map(|(tris, splits)| {
            let tree = TestTree::around_middle(&tris, splits);
            assert!(tree.blocks() >= 10, "{} blocks are too few to interrupt at", tree.blocks());
            let oracle: &'static Bvh64 = Box::leak(Box::new(Bvh64::new(tree.stored.clone())));
            Case { tree, oracle, judge: Judge::new(oracle, Rounding::NONE) }
        })
    })
}

/// Which blocks are there: a share of all, by chance, and the leased ones.
struct Holes<'a> {
    tree: &'a TestTree,
    rng: Rng,
    /// Of 100 blocks, how many are there.
    share: usize,
    lease: Vec<BlockId>,
    rounds: usize,
}

impl<'a> Holes<'a> {
    fn new(tree: &'a TestTree, seed: u64, share: usize) -> Self {
        Self { tree, rng: Rng::new(seed), share, lease: Vec::new(), rounds: 0 }
    }

    fn snapshot(&mut self) -> Snapshot {
        let there: Vec<bool> = (0..self.tree.blocks()).map(|_| self.rng.below(100) < self.share).collect();
        self.tree.snapshot.filtered(|id| there[id.0 as usize] || self.lease.contains(&id))
    }

    /// Runs `step` over changing snapshots until it is done.
    fn run(&mut self, isa: Isa, mut step: impl FnMut(&TreeView) -> Outcome) {
        loop {
            let snapshot = self.snapshot();
            match step(&self.tree.view(&snapshot, isa)) {
                Outcome::Done => return,
                Outcome::Member(_) => unreachable!("a tree of triangles has no members"),
                Outcome::Pending(id) => {
                    assert!(snapshot.block(id).is_none(), "waits for {id:?}, which is there");
                    assert!(id.0 < self.tree.blocks());
                    self.lease.push(id);
                    if self.lease.len() > LEASE {
                        self.lease.remove(0);
                    }
                    self.rounds += 1;
                    assert!(self.rounds < 100_000, "no end");
                }
            }
        }
    }
}

fn hit(walk: &Walk) -> Option<TriHit> {
    Some(walk.best()).filter(TriHit::is_hit)
}

fn check_single(case: &Case, ray: &Ray32, holes: &mut Holes) -> Result<usize, TestCaseError> {
    let whole = case.tree.view(&case.tree.snapshot, Isa::best());
    let mut straight = Walk::new();
    let truth = trees::closest(&whole, ray, &mut straight);
    let (mut walk, rounds) = (Walk::new(), holes.rounds);
    walk.begin(&whole, &trees::local(ray));
    holes.run(Isa::best(), |view| view.closest(None, &mut walk));
    prop_assert_eq!(trees::bits(&whole, &hit(&walk)), trees::bits(&whole, &truth), "{:?}", ray);
    prop_assert_eq!(walk.counters.nodes, straight.counters.nodes, "work was repeated or skipped: {:?}", ray);
    let rounds = holes.rounds - rounds;

    let mut any = Walk::new();
    any.begin(&whole, &trees::local(ray));
    holes.run(Isa::best(), |view| view.any(None, &mut any));
    prop_assert_eq!(any.best().is_hit(), truth.is_some(), "any hit: {:?}", ray);

    let answer = truth.map(|h| Answer::new(f64::from(h.t), whole.prim(&h).expect("all blocks are here")));
    let exact = case.oracle.closest(&ray.wide());
    let ruling = case.judge.closest(&ray.wide(), exact, answer);
    prop_assert!(!matches!(ruling.verdict, Verdict::Wrong(_)), "{:?}: {:?}, {:?}", ray, ruling, answer);
    Ok(rounds)
}

fn check_packet(case: &Case, rays: &[Ray32], holes: &mut Holes) -> Result<(), TestCaseError> {
    let whole = case.tree.view(&case.tree.snapshot, Isa::best());
    let (mut closest, mut any) = (PacketWalk::of_queries(), PacketWalk::of_queries());
    trees::begin_together(&whole, rays, &mut closest);
    holes.run(Isa::best(), |view| view.closest_together(None, &mut closest));
    trees::begin_together(&whole, rays, &mut any);
    holes.run(Isa::best(), |view| view.any_together(None, &mut any));
    let mut walk = Walk::new();
    for (i, ray) in rays.iter().enumerate() {
        let truth = trees::closest(&whole, ray, &mut walk);
        let got = Some(closest.best(i)).filter(TriHit::is_hit);
        prop_assert_eq!(trees::bits(&whole, &got), trees::bits(&whole, &truth), "lane {}: {:?}", i, ray);
        prop_assert_eq!(any.best(i).is_hit(), truth.is_some(), "any hit, lane {}: {:?}", i, ray);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]
    #[test]
    fn interrupted_equals_uninterrupted_equals_brute_force(
        which in 0..2usize, rays in any::<u64>(), holes in any::<u64>(), share in 0..100usize,
    ) {
        let case = &cases()[which];
        let rays = RayMaker::new(case.oracle.tris(), rays).batch(20);
        let mut holes = Holes::new(&case.tree, holes, share);
        for ray in &rays {
            check_single(case, ray, &mut holes)?;
        }
        check_packet(case, &rays[..1 + (holes.rounds % 16)], &mut holes)?;
        check_packet(case, &rays[4..], &mut holes)?;
    }
}

#[test]
fn walks_are_interrupted_many_times_and_by_ties() {
    // What the property means nothing without.
    let (mut rounds, mut ties) = ([0, 0], 0);
    for (case, rounds) in cases().iter().zip(&mut rounds) {
        let view = case.tree.view(&case.tree.snapshot, Isa::best());
        let mut walk = Walk::new();
        for ray in RayMaker::new(case.oracle.tris(), 3).batch(200) {
            *rounds += check_single(case, &ray, &mut Holes::new(&case.tree, 5, 0)).expect("agrees");
            trees::closest(&view, &ray, &mut walk);
        }
        ties += walk.counters.ties;
    }
    assert!(rounds.iter().all(|&r| r > 400), "{rounds:?} interruptions of 200 walks each");
    assert!(ties > 20, "{ties} ties");
}

#[test]
fn a_block_that_never_comes_is_asked_for_again() {
    let case = &cases()[0];
    let ray = RayMaker::new(case.oracle.tris(), 3).make(crate::common::rays::RayKind::Sphere);
    let nothing = case.tree.snapshot.filtered(|_| false);
    let view = case.tree.view(&nothing, Isa::best());
    let mut walk = Walk::new();
    walk.begin(&view, &trees::local(&ray));
    for _ in 0..3 {
        assert_eq!(view.closest(None, &mut walk), Outcome::Pending(BlockId(0)));
    }
}
