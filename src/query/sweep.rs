//! Visits to placed trees in parallel, in rounds: what is in memory is visited, what is not is brought, as much as there is
//! room for, or under a lease where views leave none.

use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::base::tasks::Work;
use crate::residency::Lease;
use crate::scene::SceneState;
use crate::scene::walk::{Hold, Need, SceneView, Snapshots};
use crate::structure::bvh::trace::LeafSweep;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Takes the visit of a placed tree as far as it comes, and adds what it finds.
pub(super) type Search<'a, T> = &'a (dyn Fn(&SceneView, u32, &mut LeafSweep, &mut T) + Sync);

/// Of the budget, how much a round brings at most: one part in so many. Others hold blocks too.
const ROUND_SHARE: u64 = 4;

/// What `search` finds in each of the placed trees. The order of visits depends on what is in memory: what is found must
/// not depend on it.
pub(super) fn sweep<T: Send + Default>(scene: &SceneState, trees: &[u32], search: Search<T>) -> Result<Vec<T>> {
    let snapshots = Arc::new(Snapshots::take(scene));
    let view = SceneView::new(scene, &snapshots, scene.context().residency().stamp());
    let begun = |&tree: &u32| Mutex::new((LeafSweep::new(&view.tree(tree)), T::default()));
    let visits = trees.iter().map(begun).collect();
    let state = State { snapshots: Arc::clone(&snapshots), open: (0..trees.len()).collect() };
    drop(snapshots);
    let sweep = Sweep { scene, trees, search, visits, state: Mutex::new(state) };
    scene.context().pool().run_scoped(trees.len(), &sweep).into_result()?;
    let found = |visit: Mutex<(LeafSweep, T)>| visit.into_inner().unwrap_or_else(PoisonError::into_inner).1;
    Ok(sweep.visits.into_iter().map(found).collect())
}

struct Sweep<'a, T> {
    scene: &'a SceneState,
    trees: &'a [u32],
    search: Search<'a, T>,
    /// Of each tree, what is left to be visited, and what was found.
    visits: Vec<Mutex<(LeafSweep, T)>>,
    state: Mutex<State>,
}

struct State {
    snapshots: Arc<Snapshots>,
    /// Indices of trees that the present round goes on with.
    open: Vec<usize>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<T: Send> Sweep<'_, T> {
    fn visit(&self, index: usize, snapshots: &Snapshots) {
        let view = SceneView::new(self.scene, snapshots, self.scene.context().residency().stamp());
        let (left, found) = &mut *lock(&self.visits[index]);
        (self.search)(&view, self.trees[index], left, found);
    }

    /// The trees that lack blocks, and these.
    fn lacking(&self, open: &[usize]) -> (Vec<usize>, BTreeSet<Need>) {
        let mut needs = BTreeSet::new();
        let lacks = |&index: &usize| {
            let model = self.scene.placement.placed[self.trees[index] as usize].model;
            let visit = lock(&self.visits[index]);
            needs.extend(visit.0.missing().map(|block| Need { model, block }));
            visit.0.missing().next().is_some()
        };
        let open = open.iter().copied().filter(lacks).collect();
        (open, needs)
    }

    /// The last of the needs, by model, up to `room` bytes, and one at least: leaf blocks come behind what they hang below, so that
    /// what is begun is ended before more is. `counts`: what a block of so many bytes counts of the room.
    fn last_of(&self, needs: &BTreeSet<Need>, room: u64, counts: fn(u64) -> u64) -> Vec<(u32, Vec<BlockId>)> {
        let mut sum = 0;
        let bytes = |need: &Need| self.scene.models[need.model as usize].blocks().slot_bytes(need.block);
        let fits = |need: &&Need| {
            let first = sum == 0;
            sum += counts(bytes(need));
            first || sum <= room
        };
        let mut chosen: Vec<Need> = needs.iter().rev().take_while(fits).copied().collect();
        chosen.reverse();
        let of_model = |few: &[Need]| (few[0].model, few.iter().map(|need| need.block).collect());
        chosen.chunk_by(|a, b| a.model == b.model).map(of_model).collect()
    }

    /// Brings some of the needs beside what views use; `None` if there is no room for any.
    fn bring(&self, needs: &BTreeSet<Need>) -> Result<Option<Snapshots>> {
        let mut hold = Hold::default();
        for (model, blocks) in self.last_of(needs, self.scene.context().memory_budget() / ROUND_SHARE, std::convert::identity) {
            hold.add(model, self.scene.models[model as usize].blocks().bring(&blocks, &Cancel::new())?);
        }
        let snapshots = Snapshots::holding(self.scene, &hold);
        Ok(snapshots.filter(|snapshots| needs.iter().any(|need| snapshots.has(*need))))
    }

    /// Goes on with blocks of the reserve, here: whoever holds it waits for nobody.
    fn visit_leased(&self, open: &[usize], needs: &BTreeSet<Need>) -> Result<()> {
        let mut lease = self.scene.context().residency().lease();
        for (model, blocks) in self.last_of(needs, lease.room(), Lease::counts) {
            lease.fetch(self.scene.models[model as usize].blocks(), &blocks, &Cancel::new())?;
        }
        let snapshots = Snapshots::leased(self.scene, &lease)?;
        open.iter().for_each(|&index| self.visit(index, &snapshots));
        Ok(())
    }
}

impl<T: Send> Work for Sweep<'_, T> {
    fn run(&self, item: usize) -> Result<()> {
        let (index, snapshots) = {
            let state = lock(&self.state);
            (state.open[item], Arc::clone(&state.snapshots))
        };
        self.visit(index, &snapshots);
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        let mut open = {
            let mut state = lock(&self.state);
            // What this round held may go.
            state.snapshots = Arc::new(Snapshots::none());
            std::mem::take(&mut state.open)
        };
        loop {
            let (lacking, needs) = self.lacking(&open);
            if lacking.is_empty() {
                return Ok(0);
            }
            if let Some(snapshots) = self.bring(&needs)? {
                let mut state = lock(&self.state);
                (state.snapshots, state.open) = (Arc::new(snapshots), lacking);
                return Ok(state.open.len());
            }
            self.visit_leased(&lacking, &needs)?;
            open = lacking;
        }
    }
}
