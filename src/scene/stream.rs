//! Rays from anywhere to anywhere, side by side in a scene. Each walks the top tree alone, up to the next placed tree that it enters; the rays
//! that enter the same tree, wherever it is placed, then go through it as one stream; and so on until no ray enters any more.

use super::alike::Alike;
use super::beam::Beam;
use super::group::{Entered, FEW as FEW_TREES};
use super::placed::At;
use super::top::{GIVE, NodeRef, Slabs, Target};
use super::walk::{Found, SceneView, SceneWalk, Step};
use crate::math::{PACKET, Ray, STREAM};
use crate::simd::{Op, Simd, dispatch};
use crate::structure::{LocalRay, Outcome, Stream, TriHit, Walk};

/// Rays that go one after the other, at most: so few take longer to begin side by side than to walk.
const FEW: usize = 4;

/// Rays side by side in a scene. Reusable.
pub(crate) struct SceneStream {
    tree: Stream,
    /// For runs of few rays.
    single: Walk,
    hits: Box<[TriHit; STREAM]>,
    /// Where each ray of a run is in its tree.
    at: Box<[At; STREAM]>,
    alone: SceneWalk,
    /// Of each ray in a scene of several placed trees, the nodes of the top tree that are still to be visited, the nearest last.
    todo: Vec<Vec<(NodeRef, f64)>>,
    slabs: Vec<Slabs>,
    /// Rays that have nodes there, or may.
    goes_on: Box<[bool; STREAM]>,
    /// The placed trees that some rays may enter, and where each of these enters each.
    entered: Vec<Entered>,
    enter: Box<[[f64; PACKET]; FEW_TREES]>,
    /// Rays that enter a placed tree in this round.
    entering: Vec<Entering>,
    unfinished: Vec<u32>,
}

/// A ray that enters a placed tree.
#[derive(Debug, Clone, Copy)]
struct Entering {
    /// The same for rays that may go through a tree together.
    tree: u64,
    ray: u32,
    placed: u32,
}

impl Default for SceneStream {
    fn default() -> Self {
        Self {
            tree: Stream::new(),
            single: Walk::new(),
            hits: Box::new([TriHit::none(0.0); STREAM]),
            at: Box::new([At::NONE; STREAM]),
            alone: SceneWalk::default(),
            todo: Vec::new(),
            slabs: Vec::new(),
            goes_on: Box::new([false; STREAM]),
            entered: Vec::new(),
            enter: Box::new([[0.0; PACKET]; FEW_TREES]),
            entering: Vec::new(),
            unfinished: Vec::new(),
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

    /// Makes room for so many rays in a scene of several placed trees.
    fn reserve(&mut self, rays: &[Ray]) {
        if self.todo.len() < rays.len() {
            self.todo.resize_with(rays.len(), Vec::new);
            self.slabs.resize(rays.len(), Slabs::new(&rays[0]));
        }
    }
}

impl SceneView<'_> {
    /// Rays side by side, but for [`FEW`] and less: the hits that [`SceneView::trace`] finds for each, at less cost. `rays`: [`STREAM`] at most;
    /// `found`: as many. Rays in [`SceneStream::unfinished`] have no answer: they need a block, or must go alone; they are to be begun anew.
    pub fn trace_each<const ANY: bool>(&self, rays: &[Ray], walk: &mut SceneStream, found: &mut [Found]) {
        walk.unfinished.clear();
        if rays.len() <= FEW {
            return self.one_by_one::<ANY>(rays, walk, found);
        }
        found.iter_mut().zip(rays).for_each(|(found, ray)| *found = Found::nothing(ray.t_max));
        let mut entering = std::mem::take(&mut walk.entering);
        entering.clear();
        match self.scene.placement.top.root().map(NodeRef::target) {
            None => {}
            Some(Target::Placed(placed)) => {
                walk.goes_on[..rays.len()].fill(false);
                entering.extend((0..).zip(rays).filter_map(|(i, ray)| self.entering(ray, i, placed)));
            }
            Some(Target::Inner(_)) => {
                walk.reserve(rays);
                (0..rays.len()).step_by(PACKET).for_each(|first| self.begin(rays, first, walk, &mut entering));
            }
        }
        while !entering.is_empty() {
            // Most rounds are of one tree.
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
                let next = if is_done { None } else { self.next_tree(&rays[ray], ray, found[ray].t, walk) };
                *it = next.unwrap_or(*it);
                next.is_some()
            };
            entering.retain_mut(goes_on);
        }
        walk.entering = entering;
    }

    /// Takes up to [`PACKET`] rays from `first` on to the first placed trees that they enter.
    fn begin(&self, rays: &[Ray], first: usize, walk: &mut SceneStream, entering: &mut Vec<Entering>) {
        let group = &rays[first..rays.len().min(first + PACKET)];
        let is_few = self.entered(&Beam::of(group, &Alike::of(group)), f64::INFINITY, &mut walk.entered);
        if let ([only], true) = (&walk.entered[..], is_few) {
            walk.goes_on[first..][..group.len()].fill(false);
            return entering.extend((first..).zip(group).filter_map(|(i, ray)| self.entering(ray, i, only.placed)));
        }
        if is_few {
            dispatch(self.scene.context().isa(), Enter { rays: group, entered: &walk.entered, enter: &mut walk.enter });
        }
        for (i, ray) in group.iter().enumerate() {
            let SceneStream { entered, enter, todo, slabs, goes_on, .. } = &mut *walk;
            let todo = &mut todo[first + i];
            todo.clear();
            goes_on[first + i] = ray.can_hit();
            match (is_few, self.scene.placement.top.root()) {
                _ if !ray.can_hit() => continue,
                (false, Some(root)) => {
                    slabs[first + i] = Slabs::new(ray);
                    todo.push((root, 0.0));
                }
                _ => {
                    for (tree, enter) in entered.iter().zip(enter.iter()) {
                        if enter[i] <= ray.t_max {
                            todo.push((tree.node, enter[i]));
                        }
                    }
                    // The nearest last; of equal ones the first.
                    todo.sort_by(|a, b| b.1.total_cmp(&a.1));
                }
            }
            entering.extend(self.next_tree(ray, first + i, ray.t_max, walk));
        }
    }

    /// A ray that enters a placed tree, if it sees that.
    #[inline]
    fn entering(&self, ray: &Ray, i: usize, placed: u32) -> Option<Entering> {
        (self.seen_by(placed) & ray.mask != 0).then(|| Entering { tree: self.tree_key(placed), ray: i as u32, placed })
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

    /// The next placed tree that a ray may enter before `best`.
    #[inline]
    fn next_tree(&self, ray: &Ray, i: usize, best: f64, walk: &mut SceneStream) -> Option<Entering> {
        let (todo, slabs) = (&mut walk.todo[i], &walk.slabs[i]);
        while let Some((node, enter)) = todo.pop() {
            if enter > best {
                continue;
            }
            match node.target() {
                Target::Placed(placed) => {
                    let entering = self.entering(ray, i, placed);
                    if entering.is_some() {
                        return entering;
                    }
                }
                Target::Inner(index) => self.for_each_child(slabs, ray, index, best, |node, enter| todo.push((node, enter))),
            }
        }
        None
    }

    /// Equal for placed trees that rays may go through together: the same tree, and no part of it is shown otherwise than in the file; or the
    /// same placed tree.
    fn tree_key(&self, placed: u32) -> u64 {
        let p = &self.scene.placement.placed[placed as usize];
        let is_as_in_file = self.scene.instances[p.instance as usize].parts.shown.is_empty();
        if is_as_in_file { u64::from(p.model) << 32 | u64::from(p.tree) } else { 1 << 63 | u64::from(placed) }
    }

    /// Takes rays through the tree that they enter.
    fn run<const ANY: bool>(&self, rays: &[Ray], run: &[Entering], walk: &mut SceneStream, found: &mut [Found]) {
        let SceneStream { tree: stream, single, hits, at, unfinished, goes_on, .. } = walk;
        let (tree, filter) = (self.tree(run[0].placed), self.filter(run[0].placed));
        let mut local = LocalRay::NONE;
        if run.len() <= FEW {
            for &Entering { ray, placed, .. } in run {
                let (p, ray) = (&self.scene.placement.placed[placed as usize], ray as usize);
                let Some((shift, scale)) = p.local(&rays[ray], found[ray].t, self.looks_beyond, &mut local) else { continue };
                single.begin(&tree, &local);
                let outcome = if ANY { tree.any(filter.as_ref(), single) } else { tree.closest(filter.as_ref(), single) };
                if outcome != Outcome::Done {
                    goes_on[ray] = false;
                    unfinished.push(ray as u32);
                }
                found[ray].offer::<ANY>(self.looks_beyond, &At { placed, shift, scale }, single.best(), single.passed());
            }
            return;
        }
        for (i, &Entering { ray, placed, .. }) in run.iter().enumerate() {
            let p = &self.scene.placement.placed[placed as usize];
            match p.local(&rays[ray as usize], found[ray as usize].t, self.looks_beyond, &mut local) {
                Some((shift, scale)) => {
                    stream.set(i, &local);
                    at[i] = At { placed, shift, scale };
                }
                None => stream.set(i, &LocalRay::NONE),
            }
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
            found[it.ray as usize].offer::<ANY>(self.looks_beyond, &at[i], *hit, stream.passed()[i]);
        }
    }
}

/// Works out where rays enter the bounds of placed trees, as [`Slabs::enter`] does, in loops that become vectors. Not a number for bounds that a
/// ray misses: that is before no end of a ray.
struct Enter<'a> {
    rays: &'a [Ray],
    entered: &'a [Entered],
    enter: &'a mut [[f64; PACKET]; FEW_TREES],
}

impl Op for Enter<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { rays, entered, enter } = self;
        let (mut org, mut inv, mut t_min) = ([[0.0; PACKET]; 3], [[0.0; PACKET]; 3], [0.0; PACKET]);
        for i in 0..rays.len().min(PACKET) {
            let ray = &rays[i];
            t_min[i] = ray.t_min;
            for axis in 0..3 {
                (org[axis][i], inv[axis][i]) = (ray.origin[axis], f64::from(ray.dir[axis]));
            }
        }
        for axis in 0..3 {
            for i in 0..PACKET {
                inv[axis][i] = 1.0 / inv[axis][i];
            }
        }
        for (tree, out) in entered.iter().zip(enter) {
            let (mut near, mut far) = (t_min, [f64::INFINITY; PACKET]);
            for axis in 0..3 {
                let (min, max) = (tree.bounds.min[axis], tree.bounds.max[axis]);
                for i in 0..PACKET {
                    let is_down = inv[axis][i] < 0.0;
                    let first = if is_down { max } else { min };
                    let last = if is_down { min } else { max };
                    let low = (first - org[axis][i]) * inv[axis][i];
                    let high = (last - org[axis][i]) * inv[axis][i];
                    let low = low * (1.0 - GIVE.copysign(low));
                    let high = high * (1.0 + GIVE.copysign(high));
                    // What is not a number leaves the interval as it is.
                    near[i] = if low > near[i] { low } else { near[i] };
                    far[i] = if high < far[i] { high } else { far[i] };
                }
            }
            for i in 0..PACKET {
                out[i] = if near[i] <= far[i] { near[i] } else { f64::NAN };
            }
        }
    }
}
