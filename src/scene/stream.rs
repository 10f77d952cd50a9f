//! Incoherent rays in a scene, traced as streams. Each ray walks the top tree by itself, up to the next placed tree
//! that it enters. The rays that enter the same tree, at any of its placements, then go through it as one stream. This
//! repeats until no ray enters a tree.

use super::alike::Alike;
use super::beam::Beam;
use super::box_ray::PacketBoxRays;
use super::entered::Entered;
use super::frame::{Scenes, Target};
use super::placed::At;
use super::ray_rows::RayRows;
use super::state::Stand;
use super::top_walk::TopWalk;
use super::walk::{FirstCell, Found, HitTree, SceneView, SceneWalk, Step};
use super::widths::Width;
use crate::math::{PACKET, Ray, STREAM, bits, first_rays};
use crate::structure::{LocalRay, LocalRays, Outcome, Stream, TriHit, Walk};

/// Greatest number of rays that are walked one after the other: starting a stream takes longer than their walks.
const FEW: usize = 4;

/// The state of a stream of rays in a scene. Reusable.
pub(crate) struct SceneStream {
    tree: Stream,
    /// The walk for runs of few rays.
    single: Walk,
    hits: Box<[TriHit; STREAM]>,
    /// The placement of each ray of a run in its tree.
    at: Box<[At; STREAM]>,
    rows: Box<RayRows>,
    local: Box<LocalRays<PACKET>>,
    alone: SceneWalk,
    /// For each ray in a scene of several placed trees, those still to be visited if they are few, with the distances
    /// at which it enters them. The nearest is the last.
    todo: Vec<Vec<(u64, f64)>>,
    /// For each other ray, its walk through the top trees.
    tops: Vec<TopWalk>,
    /// True for rays that are not done: `todo` or `tops` has more for them.
    goes_on: Box<[bool; STREAM]>,
    /// The placed trees that some packet's rays may enter.
    entered: Entered,
    packet: Box<PacketBoxRays>,
    /// Rays that enter a placed tree in this round.
    entering: Vec<Entering>,
    unfinished: Vec<u32>,
    /// True if some ray of a stream through the only tree has other distances there than in the world.
    is_moved: bool,
}

/// Equal for placed trees that rays may go through in one stream: placements of the same tree with all parts as in the
/// file, or the same placed tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum TreeKey {
    /// The model, and the tree there.
    Stored(u32, u32),
    Placed(u64),
}

impl TreeKey {
    fn of(stand: &Stand) -> Self {
        let is_as_in_file = stand.state.parts.looks.is_empty();
        if is_as_in_file { Self::Stored(stand.ids.model, stand.ids.tree) } else { Self::Placed(stand.number) }
    }
}

/// A ray that enters a placed tree.
#[derive(Debug, Clone, Copy)]
struct Entering {
    /// Equal for rays that may go through a tree in one stream.
    tree: TreeKey,
    ray: u32,
    placed: u64,
}

impl Default for SceneStream {
    fn default() -> Self {
        Self {
            tree: Stream::new(),
            single: Walk::new(),
            hits: Box::new([TriHit::none(0.0); STREAM]),
            at: Box::new([At::NONE; STREAM]),
            rows: Box::new(RayRows::NONE),
            local: Box::new(LocalRays::NONE),
            alone: SceneWalk::default(),
            todo: Vec::new(),
            tops: Vec::new(),
            goes_on: Box::new([false; STREAM]),
            entered: Entered::default(),
            packet: Box::new(PacketBoxRays::NONE),
            entering: Vec::new(),
            unfinished: Vec::new(),
            is_moved: false,
        }
    }
}

impl SceneStream {
    /// See [`Stream::of_queries`].
    pub fn of_queries() -> Self {
        Self { tree: Stream::of_queries(), ..Self::default() }
    }

    /// Rays of the last call without an answer.
    pub fn unfinished(&self) -> &[u32] {
        &self.unfinished
    }

    /// Hits of rays that went through the [only](SceneView::trace_in_only) tree, from ray `first` on.
    pub fn hits_from(&self, first: usize) -> StreamHits<'_> {
        let at = if self.is_moved { Some(&self.at[first..]) } else { None };
        StreamHits { hits: &self.hits[first..], at, first_cell: &self.tree.first_cell()[first..] }
    }

    /// Makes room for the rays in a scene of several placed trees.
    fn reserve(&mut self, rays: &[Ray]) {
        if self.todo.len() < rays.len() {
            self.todo.resize_with(rays.len(), Vec::new);
            self.tops.resize_with(rays.len(), TopWalk::default);
        }
    }
}

/// Hits of rays in one placed tree.
pub(crate) struct StreamHits<'a> {
    hits: &'a [TriHit],
    at: Option<&'a [At]>,
    first_cell: &'a [f32],
}

impl StreamHits<'_> {
    /// The hit of ray `i` in the tree.
    #[inline(always)]
    pub fn hit(&self, i: usize) -> TriHit {
        self.hits[i]
    }

    /// The distance of ray `i` in the world.
    #[inline(always)]
    pub fn t(&self, i: usize) -> f64 {
        self.in_world(i, self.hits[i].t)
    }

    #[inline(always)]
    fn in_world(&self, i: usize, t: f32) -> f64 {
        match self.at {
            Some(at) => at[i].in_world(t),
            None => f64::from(t),
        }
    }

    /// The rays that hit something within their intervals, and those that entered stand-ins.
    pub fn met<const ANY: bool>(&self, rays: &[Ray], widen_interval: bool) -> [u32; 2] {
        let (mut met, mut first_cell) = (0, 0);
        for (i, ray) in rays.iter().enumerate() {
            // As in `Found::offer`.
            let is_hit = self.hits[i].is_hit() && (ANY || widen_interval || self.t(i) <= ray.t_max);
            met |= u32::from(is_hit) << i;
            first_cell |= u32::from(self.first_cell[i] < f32::INFINITY) << i;
        }
        [met, first_cell]
    }

    /// Where ray `i` first entered a stand-in of the tree, which is `placed`.
    #[inline(always)]
    pub fn first_cell(&self, i: usize, placed: u64) -> FirstCell {
        FirstCell { t: self.in_world(i, self.first_cell[i]), tree: HitTree::Placed(placed) }
    }

    /// The hit of ray `i`, which is in `met` or not.
    pub fn found(&self, i: usize, placed: u64, ray: &Ray, is_met: bool) -> Found {
        let first_cell = self.first_cell(i, placed);
        if !is_met {
            return Found { first_cell, ..Found::nothing(ray.t_max) };
        }
        Found { t: self.t(i), tree: HitTree::Placed(placed), tri: self.hits[i], first_cell }
    }
}

impl SceneView<'_> {
    /// Traces rays as one stream, if the scene has one placed tree that all rays see. Returns the tree; the hits are
    /// those of [`SceneStream::hits_from`], and [`SceneStream::unfinished`] has the rays without an answer.
    pub fn trace_in_only<const ANY: bool>(&self, rays: &[Ray], walk: &mut SceneStream) -> Option<u64> {
        debug_assert!(self.within.is_none(), "a double-precision interval belongs to a single ray");
        let Some(Target::Placed(placed)) = self.scene.root(Scenes::All) else { return None };
        let seen_by = self.seen_by(placed);
        if rays.len() <= FEW || rays.iter().any(|ray| ray.mask & seen_by == 0) {
            return None;
        }
        let SceneStream { tree: stream, hits, at, rows, local, is_moved, unfinished, .. } = walk;
        let (p, isa) = (self.scene.placed(placed), self.scene.context().isa());
        *is_moved = false;
        for (i, rays) in rays.chunks(PACKET).enumerate() {
            let (mut best, first) = ([0.0; PACKET], i * PACKET);
            for (i, ray) in rays.iter().enumerate() {
                rows.set(i, ray);
                best[i] = ray.t_max;
            }
            let among = first_rays(rays.len());
            let reach = (&best, self.widen_interval);
            rows.take_all_into_tree(isa, &p, among, reach, local, |i, (shift, scale)| {
                if !*is_moved {
                    *is_moved = true;
                    at.fill(At { placed, shift: 0.0, scale: 1.0 });
                }
                at[first + i] = At { placed, shift, scale };
            });
            stream.set_rows(first, local);
        }
        let (tree, filter, hits) = (self.tree(placed), self.filter(placed), &mut hits[..rays.len()]);
        if ANY {
            tree.any_each(filter.as_ref(), stream, hits);
        } else {
            tree.closest_each(filter.as_ref(), stream, hits);
        }
        unfinished.clear();
        unfinished.extend_from_slice(stream.unfinished());
        Some(placed)
    }

    /// Traces rays as streams, or singly if there are at most [`FEW`]. Finds the hits that [`SceneView::trace`] finds
    /// for each ray, at less cost. `rays` has at most [`STREAM`] entries, `found` equally many. Rays in
    /// [`SceneStream::unfinished`] have no answer, as they need a block or a single walk: they must be begun again.
    pub fn trace_each<const ANY: bool>(&self, rays: &[Ray], walk: &mut SceneStream, found: &mut [Found]) {
        debug_assert!(self.within.is_none(), "a double-precision interval belongs to a single ray");
        walk.unfinished.clear();
        if rays.len() <= FEW {
            return self.one_by_one::<ANY>(rays, walk, found);
        }
        found.iter_mut().zip(rays).for_each(|(found, ray)| *found = Found::nothing(ray.t_max));
        let mut entering = std::mem::take(&mut walk.entering);
        entering.clear();
        match self.scene.root(Scenes::All) {
            None => {}
            Some(Target::Placed(placed)) => {
                walk.goes_on[..rays.len()].fill(false);
                entering.extend((0..).zip(rays).filter_map(|(i, ray)| self.entering(ray, i, placed)));
            }
            Some(Target::Inner(_)) => {
                walk.reserve(rays);
                for first in (0..rays.len()).step_by(PACKET) {
                    self.begin::<ANY>(rays, first, walk, found, &mut entering);
                }
            }
        }
        while !entering.is_empty() {
            // Most rounds have one tree only, and need no sort.
            if entering.iter().any(|it| it.tree != entering[0].tree) {
                entering.sort_unstable_by_key(|it| (it.tree, it.ray));
            }
            for run in entering.chunk_by(|a, b| a.tree == b.tree) {
                for run in run.chunks(STREAM) {
                    self.run::<ANY>(rays, run, walk, found);
                }
            }
            let goes_on = |it: &mut Entering| {
                let ray = it.ray as usize;
                let is_done = !walk.goes_on[ray] || ANY && found[ray].is_hit();
                let next = if is_done { None } else { self.next_tree::<ANY>(&rays[ray], ray, &mut found[ray], walk) };
                *it = next.unwrap_or(*it);
                next.is_some()
            };
            entering.retain_mut(goes_on);
        }
        walk.entering = entering;
    }

    /// Takes up to [`PACKET`] rays from `first` on to the first placed trees that they enter.
    fn begin<const ANY: bool>(
        &self,
        rays: &[Ray],
        first: usize,
        walk: &mut SceneStream,
        found: &mut [Found],
        entering: &mut Vec<Entering>,
    ) {
        let group = &rays[first..rays.len().min(first + PACKET)];
        let alike = Alike::of(group);
        let is_few = self.entered(&Beam::of(group, &alike), Width::of(group, &alike), f64::INFINITY, &mut walk.entered);
        if let ([only], true) = (&walk.entered.trees[..], is_few) {
            walk.goes_on[first..][..group.len()].fill(false);
            return entering.extend((first..).zip(group).filter_map(|(i, ray)| self.entering(ray, i, only.placed)));
        }
        let SceneStream { entered, packet, todo, tops, goes_on, .. } = &mut *walk;
        for (i, ray) in group.iter().enumerate() {
            goes_on[first + i] = ray.can_hit();
            todo[first + i].clear();
            tops[first + i].end();
        }
        if is_few {
            packet.set(group, None);
            let mut t_max = [f64::NEG_INFINITY; PACKET];
            t_max
                .iter_mut()
                .zip(group)
                .for_each(|(t_max, ray)| *t_max = if ray.can_hit() { ray.t_max } else { f64::NEG_INFINITY });
            for tree in &entered.trees {
                let mut enter = [0.0; PACKET];
                for i in bits(packet.enter(self.scene.context().isa(), &tree.bounds, &t_max, &mut enter)) {
                    let todo = &mut todo[first + i];
                    // The nearest tree is the last; of equally near trees the first is visited first.
                    let at = todo.partition_point(|it| it.1 > enter[i]);
                    todo.insert(at, (tree.placed, enter[i]));
                }
            }
        } else {
            for (i, ray) in group.iter().enumerate().filter(|(_, ray)| ray.can_hit()) {
                tops[first + i].begin(self, ray);
            }
        }
        let next = |(i, ray): (usize, &Ray)| self.next_tree::<ANY>(ray, i, &mut found[i], walk);
        entering.extend((first..).zip(group).filter_map(next));
    }

    /// The entry of a ray into a placed tree; `None` if the tree is not visible to the ray.
    #[inline]
    fn entering(&self, ray: &Ray, i: usize, placed: u64) -> Option<Entering> {
        let stand = self.scene.stand(placed);
        let is_seen = self.scene.seen_at(&stand) & ray.mask != 0;
        is_seen.then(|| Entering { tree: TreeKey::of(&stand), ray: i as u32, placed })
    }

    fn one_by_one<const ANY: bool>(&self, rays: &[Ray], walk: &mut SceneStream, found: &mut [Found]) {
        for (i, it) in rays.iter().enumerate() {
            walk.alone.begin(self, it);
            match self.trace::<ANY>(it, &mut walk.alone) {
                Step::Done => found[i] = walk.alone.best(),
                Step::Pending(_) => walk.unfinished.push(i as u32),
            }
        }
    }

    /// The next placed tree in which a ray may meet something better than `best`; see [`TopWalk::next`].
    #[inline]
    fn next_tree<const ANY: bool>(
        &self,
        ray: &Ray,
        i: usize,
        best: &mut Found,
        walk: &mut SceneStream,
    ) -> Option<Entering> {
        let (todo, top) = (&mut walk.todo[i], &mut walk.tops[i]);
        loop {
            let placed = match todo.pop() {
                Some((_, enter)) if enter > best.reach(ray) => continue,
                Some((placed, _)) => placed,
                None => top.next::<ANY>(self, ray, best)?,
            };
            let entering = self.entering(ray, i, placed);
            if entering.is_some() {
                return entering;
            }
        }
    }

    /// Takes a ray by itself through the tree that it enters, and through all further trees that it enters.
    fn alone<const ANY: bool>(
        &self,
        rays: &[Ray],
        mut entering: Entering,
        walk: &mut SceneStream,
        found: &mut [Found],
    ) {
        let i = entering.ray as usize;
        let (ray, best) = (&rays[i], &mut found[i]);
        let mut local = LocalRay::NONE;
        loop {
            let placed = entering.placed;
            if let Some((shift, scale)) =
                self.scene.placed(placed).local(ray, best.reach(ray), self.widen_interval, &mut local)
            {
                let stand = self.scene.stand(placed);
                let (tree, filter, single) = (self.tree_at(&stand), self.filter_at(&stand), &mut walk.single);
                single.begin(&tree, &local);
                let outcome =
                    if ANY { tree.any(filter.as_ref(), single) } else { tree.closest(filter.as_ref(), single) };
                if outcome != Outcome::Done {
                    walk.unfinished.push(i as u32);
                    break;
                }
                best.offer::<ANY>(
                    self.widen_interval,
                    &At { placed, shift, scale },
                    single.best(),
                    single.first_cell(),
                );
            }
            if !walk.goes_on[i] || ANY && best.is_hit() {
                break;
            }
            let Some(next) = self.next_tree::<ANY>(ray, i, best, walk) else { break };
            entering = next;
        }
        walk.goes_on[i] = false;
    }

    /// Puts up to [`PACKET`] rays into a stream, from its ray `first` on.
    fn put(
        &self,
        rays: &[Ray],
        run: &[Entering],
        (first, found): (usize, &[Found]),
        (rows, local): (&mut RayRows, &mut LocalRays<PACKET>),
        (stream, at): (&mut Stream, &mut [At; STREAM]),
    ) {
        let mut best = [0.0; PACKET];
        for (i, it) in run.iter().enumerate() {
            rows.set(i, &rays[it.ray as usize]);
            best[i] = found[it.ray as usize].reach(&rays[it.ray as usize]);
        }
        let mut left = first_rays(run.len());
        let at = &mut at[first..];
        // The same tree may be in several places.
        let mut all = None;
        while left != 0 {
            let placed = run[left.trailing_zeros() as usize].placed;
            let like = bits(left).filter(|&i| run[i].placed == placed).fold(0, |like, i| like | 1 << i);
            left &= !like;
            bits(like).for_each(|i| at[i] = At { placed, shift: 0.0, scale: 1.0 });
            let p = self.scene.placed(placed);
            let isa = self.scene.context().isa();
            rows.take_all_into_tree(isa, &p, like, (&best, self.widen_interval), local, |i, (shift, scale)| {
                at[i] = At { placed, shift, scale };
            });
            match (left, &mut all) {
                (0, None) => break,
                (_, all) => {
                    let all = all.get_or_insert_with(|| Box::new(LocalRays::NONE));
                    bits(like).for_each(|i| all.set(i, &local.one(i)));
                }
            }
        }
        stream.set_rows(first, all.as_deref().unwrap_or(local));
    }

    /// Takes rays through the tree that they enter.
    fn run<const ANY: bool>(&self, rays: &[Ray], run: &[Entering], walk: &mut SceneStream, found: &mut [Found]) {
        if run.len() <= FEW {
            return run.iter().for_each(|&it| self.alone::<ANY>(rays, it, walk, found));
        }
        let SceneStream { tree: stream, hits, at, unfinished, goes_on, rows, local, .. } = walk;
        let stand = self.scene.stand(run[0].placed);
        let (tree, filter) = (self.tree_at(&stand), self.filter_at(&stand));
        for (i, part) in run.chunks(PACKET).enumerate() {
            self.put(rays, part, (i * PACKET, found), (rows, local), (stream, at));
        }
        let hits = &mut hits[..run.len()];
        if ANY {
            tree.any_each(filter.as_ref(), stream, hits);
        } else {
            tree.closest_each(filter.as_ref(), stream, hits);
        }
        for &i in stream.unfinished() {
            let ray = run[i as usize].ray;
            goes_on[ray as usize] = false;
            unfinished.push(ray);
        }
        for (i, (hit, it)) in hits.iter().zip(run).enumerate() {
            found[it.ray as usize].offer::<ANY>(self.widen_interval, &at[i], *hit, stream.first_cell()[i]);
        }
    }
}
