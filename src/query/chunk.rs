//! The rays that a worker answers at a time, and the groups of them that must wait for blocks.

use super::answers::{InTree, Rest, Seen, answer_one, lacking, missed, promise_nothing};
use super::asks::Asks;
use super::batch::{Hits, Policy, Rays};
use super::beyond::{begin_past, is_early, past};
use super::hit::{Hit, HitKind, Want};
use super::parked::Waits;
use crate::math::{PACKET, Ray, STREAM, bits, first_rays};
use crate::scene::stream::SceneStream;
use crate::scene::walk::{Found, HitTree, Need, SceneView, SceneWalk, Snapshots, Step};
use crate::scene::{Alike, Group as SceneGroup, SceneState};
use std::ops::Range;

/// Rays per chunk: some tens to hundreds of microseconds of work.
pub(super) const CHUNK: usize = STREAM;

/// The options of a batch that apply to each of its rays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Task {
    pub coherent: bool,
    pub policy: Policy,
    pub want: Want,
    /// True if any hit will do.
    pub any: bool,
}

impl Task {
    /// The view in which the rays are traced. A ray's interval applies to the answered distances: if these have double
    /// precision, so has the test of the interval. (Any hits have the interval of closest hits with double-precision
    /// distances.)
    pub fn view<'a>(self, scene: &'a SceneState, snapshots: &'a Snapshots, stamp: u32) -> SceneView<'a> {
        let widen_interval = self.any || self.want.any_of(Want::MEETING);
        SceneView {
            accept_missing: self.policy == Policy::Now,
            ties_by_place: self.policy == Policy::Now,
            widen_interval,
            ..SceneView::new(scene, snapshots, stamp)
        }
    }
}

/// Working memory to answer a chunk. Reusable.
pub(super) struct Chunk {
    /// Rays that are traced as a stream, group by group, and room for one more group to be copied. The box is taken out
    /// while a chunk runs, because the other members are borrowed mutably at the same time. (A chunk that panics is not
    /// reused.)
    rays: Box<[Ray]>,
    found: Box<[Found]>,
    /// Index in the batch of the first ray of each group.
    firsts: [usize; CHUNK / PACKET],
    // Each in memory of its own, so that a new chunk takes little of the caller's stack.
    stream: Box<SceneStream>,
    group: SceneGroup,
    seen: Box<Seen<PACKET>>,
    answers: Box<Answers>,
    /// The fields that `answers` was filled with.
    want: Want,
    /// Rays without an answer yet.
    unfinished: Vec<u32>,
    /// Groups that must wait.
    pub parked: Vec<Box<Group>>,
}

impl Default for Chunk {
    fn default() -> Self {
        Self {
            rays: vec![Ray::NONE; CHUNK].into(),
            found: vec![Found::nothing(0.0); CHUNK].into(),
            firsts: [0; CHUNK / PACKET],
            stream: Box::new(SceneStream::of_queries()),
            group: SceneGroup::default(),
            seen: Box::default(),
            answers: Box::new(Answers::NONE),
            want: Want::NOTHING,
            unfinished: Vec::new(),
            parked: Vec::new(),
        }
    }
}

impl Chunk {
    /// Answers `count` rays of a batch from `first` on; rays that lack blocks go to `parked`.
    pub fn run(
        &mut self,
        view: &SceneView,
        task: Task,
        first: usize,
        count: usize,
        rays: &impl Rays,
        hits: &impl Hits,
    ) {
        if self.want != task.want {
            (self.want, *self.answers) = (task.want, Answers::NONE);
        }
        self.group.begin_batch();
        // Groups of similar rays are answered at once; the other groups are gathered. Only the last group may be
        // smaller.
        let (mut gathered, mut end) = (std::mem::take(&mut self.rays), 0);
        for from in (0..count).step_by(PACKET) {
            let group = end..end + PACKET.min(count - from);
            let Some(room) = gathered[end..].first_chunk_mut::<PACKET>() else { unreachable!() };
            self.firsts[end / PACKET] = first + from;
            let mut lent = if group.len() == PACKET { rays.packet(first + from) } else { None };
            if lent.is_none() {
                rays.read(first + from, &mut room[..group.len()]);
            }
            let alike = Alike::of(&lent.unwrap_or(room)[..group.len()]);
            if !alike.has_sound_cones() {
                *room = *lent.take().unwrap_or(room);
                room.iter_mut().for_each(|ray| ray.cone = ray.cone.or_zero());
            }
            let group_rays = lent.unwrap_or(room);
            self.unfinished.clear();
            // A packet needs rays in one octant at least.
            if !(alike.is_one_octant() && self.run_together(view, task, group.clone(), group_rays, &alike, hits)) {
                if let Some(lent) = lent {
                    *room = *lent;
                }
                end = group.end;
            }
        }
        self.unfinished.clear();
        let only = self.trace_in_only(view, task, &gathered[..end]);
        if end > 0 && only.is_none() {
            self.trace_each(view, task, &gathered[..end]);
        }
        for from in (0..end).step_by(PACKET) {
            let group = from..end.min(from + PACKET);
            let rays = &gathered[group.clone()];
            match only {
                Some(placed) => self.answer_in_only(view, task, placed, (group, rays), hits),
                None => {
                    let met = hits_of(&self.found[group.clone()]);
                    self.answer(view, task, group, rays, met, hits);
                }
            }
        }
        self.rays = gathered;
    }

    /// See [`SceneView::trace_in_only`].
    fn trace_in_only(&mut self, view: &SceneView, task: Task, rays: &[Ray]) -> Option<u64> {
        let placed = if task.any {
            view.trace_in_only::<true>(rays, &mut self.stream)
        } else {
            view.trace_in_only::<false>(rays, &mut self.stream)
        };
        if placed.is_some() {
            self.unfinished.extend_from_slice(self.stream.unfinished());
        }
        placed
    }

    /// Writes the answers of a group that went through the only placed tree of a scene.
    fn answer_in_only(
        &mut self,
        view: &SceneView,
        task: Task,
        placed: u64,
        (group, rays): (Range<usize>, &[Ray]),
        hits: &impl Hits,
    ) {
        let found = self.stream.hits_from(group.start);
        let [met, entered] = if task.any {
            found.met::<true>(rays, view.widen_interval)
        } else {
            found.met::<false>(rays, view.widen_interval)
        };
        let is_whole = !self.unfinished.iter().any(|&i| group.contains(&(i as usize)));
        let is_early = |i: usize| view.widen_interval && found.first_cell(i, placed).t < rays[i].t_min;
        let first = self.firsts[group.start / PACKET];
        if is_whole && !bits(entered).any(is_early) {
            let misses = if task.want.has(Want::ERROR) { entered & !met } else { 0 };
            let out = self.answers.begin(met, misses);
            for i in bits(misses) {
                out[i] = missed(view, &rays[i], &found.found(i, placed, &rays[i], false), task.want);
            }
            let id = HitTree::Placed(placed);
            let rest = if met == 0 {
                Rest::default()
            } else {
                self.seen.answer(&InTree { view, id, placed: &view.frame_of(id) }, task.want, rays, &found, met, out)
            };
            if rest.is_none() {
                return self.write(task, first, rays.len(), met, hits);
            }
        }
        for (i, ray) in rays.iter().enumerate() {
            self.found[group.start + i] = found.found(i, placed, ray, met >> i & 1 == 1);
        }
        self.answer(view, task, group, rays, met, hits);
    }

    fn trace_each(&mut self, view: &SceneView, task: Task, rays: &[Ray]) {
        let found = &mut self.found[..rays.len()];
        if task.any {
            view.trace_each::<true>(rays, &mut self.stream, found);
        } else {
            view.trace_each::<false>(rays, &mut self.stream, found);
        }
        self.unfinished.extend_from_slice(self.stream.unfinished());
    }

    /// Answers a group as one packet; returns false if its rays must be traced as a stream.
    fn run_together(
        &mut self,
        view: &SceneView,
        task: Task,
        group: Range<usize>,
        rays: &[Ray; PACKET],
        alike: &Alike,
        hits: &impl Hits,
    ) -> bool {
        let met = if task.any {
            self.group.trace::<true>(view, rays, group.len(), alike, task.coherent)
        } else {
            self.group.trace::<false>(view, rays, group.len(), alike, task.coherent)
        };
        let rays = &rays[..group.len()];
        let Some(met) = met else { return false };
        if let Ok(met) = met {
            let is_early = view.widen_interval && !alike.is_exact() && self.group.passes_early(rays);
            if !is_early
                && let Some(only) = self.group.only()
                && self.answer_in_one(view, task.want, only, rays, met).is_none()
            {
                self.write(task, self.firsts[group.start / PACKET], group.len(), met, hits);
                return true;
            }
            for i in 0..group.len() {
                self.found[group.start + i] = self.group.found(i, met >> i & 1 == 1);
            }
        }
        self.answer_traced(view, task, group, rays, met.ok(), hits);
        true
    }

    /// Writes the answers of a group whose rays of `met` hit something.
    fn write(&self, task: Task, first: usize, count: usize, met: u32, hits: &impl Hits) {
        if task.any {
            hits.write_any(first, count, met);
        } else {
            hits.write(first, &self.answers.hits[..count]);
        }
    }

    /// Computes the answers of a group that went through one placed tree. Rays of `met` hit something.
    fn answer_in_one(&mut self, view: &SceneView, want: Want, placed: u64, rays: &[Ray], met: u32) -> Rest {
        let (Self { seen, group, answers, .. }, id) = (self, HitTree::Placed(placed));
        let misses = if want.has(Want::ERROR) { group.behind_cells() & !met & first_rays(rays.len()) } else { 0 };
        let out = answers.begin(met, misses);
        bits(misses).for_each(|i| out[i] = missed(view, &rays[i], &group.found(i, false), want));
        if met == 0 {
            Rest::default()
        } else {
            seen.answer(&InTree { view, id, placed: &view.frame_of(id) }, want, rays, &*group, met, out)
        }
    }

    /// [`Chunk::answer`] of a group that was traced as one packet. `met`: the rays that hit something; `None` if some
    /// ray lacked a block.
    fn answer_traced(
        &mut self,
        view: &SceneView,
        task: Task,
        group: Range<usize>,
        rays: &[Ray],
        met: Option<u32>,
        hits: &impl Hits,
    ) {
        if met.is_none() {
            // A packet does not tell which of its rays had all blocks.
            self.unfinished.extend(group.start as u32..group.end as u32);
        }
        self.answer(view, task, group, rays, met.unwrap_or(0), hits);
    }

    /// Writes the answers of a group, or parks it. `met`: rays that hit something; unfinished rays may add to these.
    fn answer(
        &mut self,
        view: &SceneView,
        task: Task,
        group: Range<usize>,
        rays: &[Ray],
        mut met: u32,
        hits: &impl Hits,
    ) {
        let mut waiting = Vec::new();
        let mut lacking = 0;
        for &i in self.unfinished.iter().filter(|&&i| group.contains(&(i as usize))) {
            let i = i as usize;
            let bit = 1 << (i - group.start);
            met &= !bit;
            let mut walk = SceneWalk::default();
            walk.begin(view, &rays[i - group.start]);
            match trace(view, task, &rays[i - group.start], &mut walk) {
                Step::Pending(need) if task.policy == Policy::Exact => {
                    walk.fit();
                    waiting.push(Waiting { ray: i - group.start, left: Left::Walk(walk), asks: Asks::of(need) });
                }
                step => {
                    self.found[i] = walk.best();
                    met |= if self.found[i].is_hit() { bit } else { 0 };
                    lacking |= if step == Step::Done { 0 } else { bit };
                }
            }
        }
        let (first, count) = (self.firsts[group.start / PACKET], group.len());
        let found = &self.found[group];
        finish_group(view, task, rays, found, [met, lacking], (&mut self.seen, &mut self.answers), &mut waiting);
        if waiting.is_empty() {
            return hits.write(first, &self.answers.hits[..count]);
        }
        self.parked.push(Box::new(Group::new(first, rays, found, &self.answers.hits, waiting)));
    }
}

pub(super) fn trace(view: &SceneView, task: Task, ray: &Ray, walk: &mut SceneWalk) -> Step {
    if task.any { view.trace::<true>(ray, walk) } else { view.trace::<false>(ray, walk) }
}

/// The rays that hit something.
fn hits_of(found: &[Found]) -> u32 {
    found.iter().enumerate().fold(0, |all, (i, found)| all | u32::from(found.is_hit()) << i)
}

/// The rays that hit nothing, but entered stand-ins.
fn missed_behind_cells(found: &[Found]) -> u32 {
    let is_one = |found: &Found| !found.is_hit() && found.is_behind_cell();
    found.iter().enumerate().fold(0, |all, (i, found)| all | u32::from(is_one(found)) << i)
}

/// The rays that entered stand-ins before their intervals.
fn early(view: &SceneView, rays: &[Ray], found: &[Found]) -> u32 {
    rays.iter()
        .zip(found)
        .enumerate()
        .fold(0, |all, (i, (ray, found))| all | u32::from(is_early(view, ray, found)) << i)
}

/// Answers to a packet's rays, in the same memory for each packet: fields that are not requested keep their values of
/// [`Hit::MISS`].
pub(super) struct Answers {
    hits: [Hit; PACKET],
    /// The entries that may differ from a miss.
    written: u32,
}

impl Answers {
    const NONE: Self = Self { hits: [Hit::MISS; PACKET], written: 0 };

    /// Prepares the entries for other rays: all are misses except those of `met`, which the caller must fill. The
    /// caller may also write the entries in `more`.
    #[inline]
    pub fn begin(&mut self, met: u32, more: u32) -> &mut [Hit; PACKET] {
        for i in bits(self.written & !met) {
            self.hits[i] = Hit::MISS;
        }
        self.written = met | more;
        &mut self.hits
    }
}

/// Computes the hits of a group of rays; rays that lack a block for that go to `waiting`. Rays of `met` have the hits
/// in `found`; rays of `short` were answered without a block that they needed.
fn finish_group(
    view: &SceneView,
    task: Task,
    rays: &[Ray],
    found: &[Found],
    [met, short]: [u32; 2],
    (seen, answers): (&mut Seen<PACKET>, &mut Answers),
    waiting: &mut Vec<Waiting>,
) {
    let met = met & first_rays(rays.len());
    let waits = waiting.iter().fold(0, |all, it| all | 1 << it.ray);
    let more = early(view, rays, found) & !short & !waits;
    let misses = if task.want.has(Want::ERROR) { missed_behind_cells(found) & !waits } else { 0 };
    let hits = answers.begin(met, more | short | misses);
    bits(misses).for_each(|i| hits[i] = missed(view, &rays[i], &found[i], task.want));
    let rest = answer_by_trees(view, task.want, rays, found, met & !more, seen, hits);
    for i in bits(rest.lacking) {
        match task.policy {
            Policy::Exact => {
                let asks = Asks::of(lacking(view, &found[i], task.want));
                waiting.push(Waiting { ray: i, left: Left::Hit, asks });
            }
            Policy::Now => hits[i].kind = HitKind::Missing,
        }
    }
    for i in bits(more | rest.outside) {
        let (mut left, mut found) = (Left::Hit, found[i]);
        match (go_on(view, task, &rays[i], &mut left, &mut found, &mut hits[i]), task.policy, &left) {
            (Ok(()), ..) => {}
            (Err(need), Policy::Exact, _) => waiting.push(Waiting { ray: i, left, asks: Asks::of(need) }),
            _ => set_missing(&mut hits[i], &rays[i], task.want),
        }
    }
    for i in bits(short) {
        set_missing(&mut hits[i], &rays[i], task.want);
    }
}

/// Marks the hit of a ray that was answered without a block that it needed: surfaces in that block may be nearer.
fn set_missing(hit: &mut Hit, ray: &Ray, want: Want) {
    hit.kind = HitKind::Missing;
    promise_nothing(hit, ray, want);
}

/// Greatest number of hits in the same placed tree that are computed one by one: a row of a whole packet takes longer.
const FEW: u32 = 2;

/// Computes the hits of `met`: hits in the same placed tree as one row.
fn answer_by_trees(
    view: &SceneView,
    want: Want,
    rays: &[Ray],
    found: &[Found],
    met: u32,
    seen: &mut Seen<PACKET>,
    hits: &mut [Hit; PACKET],
) -> Rest {
    let (mut rest, mut left) = (Rest::default(), met);
    while left != 0 {
        let id = found[left.trailing_zeros() as usize].tree;
        let like = bits(left).filter(|&i| found[i].tree == id).fold(0, |all, i| all | 1 << i);
        left &= !like;
        if like.count_ones() > FEW {
            let more = seen.answer(&InTree { view, id, placed: &view.frame_of(id) }, want, rays, found, like, hits);
            (rest.outside, rest.lacking) = (rest.outside | more.outside, rest.lacking | more.lacking);
            continue;
        }
        for i in bits(like) {
            match answer_one(view, &rays[i], &found[i], want, &mut hits[i]) {
                Ok(is_within) => rest.outside |= u32::from(!is_within) << i,
                Err(_) => rest.lacking |= 1 << i,
            }
        }
    }
    rest
}

/// A ray that waits for blocks.
struct Waiting {
    /// Its index in the group.
    ray: usize,
    left: Left,
    asks: Asks,
}

/// The remaining work for a ray, with the walk at the point where it stopped.
enum Left {
    Walk(SceneWalk),
    /// The hit must be computed.
    Hit,
    /// The hit within the ray's interval must be found, see [`past`].
    Past(SceneWalk),
    Nothing,
}

/// Up to a packet's rays of which some wait for blocks, with the data to resume them.
pub(super) struct Group {
    first: usize,
    count: usize,
    rays: [Ray; PACKET],
    found: [Found; PACKET],
    /// The hits; those of rays that do not wait are final.
    hits: [Hit; PACKET],
    waiting: Vec<Waiting>,
}

impl Group {
    fn new(first: usize, rays: &[Ray], found: &[Found], hits: &[Hit; PACKET], waiting: Vec<Waiting>) -> Self {
        let mut group = Self {
            first,
            count: rays.len(),
            rays: [Ray::NONE; PACKET],
            found: [Found::nothing(0.0); PACKET],
            hits: *hits,
            waiting,
        };
        group.rays[..rays.len()].copy_from_slice(rays);
        group.found[..found.len()].copy_from_slice(found);
        group
    }

    /// Index in the batch of the group's first ray.
    pub fn first(&self) -> usize {
        self.first
    }

    /// Number of rays.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Resumes the rays with all blocks in memory. Returns the answers, or `None` if blocks are still missing.
    pub fn resume(&mut self, view: &SceneView, task: Task) -> Option<&[Hit]> {
        let Self { waiting, rays, found, hits, .. } = self;
        waiting.retain_mut(|it| {
            if !it.asks.are_in(view.snapshots) {
                return true;
            }
            let i = it.ray;
            let ends = go_on(view, task, &rays[i], &mut it.left, &mut found[i], &mut hits[i]);
            ends.err().is_some_and(|need| {
                it.asks.push(need);
                true
            })
        });
        self.waiting.is_empty().then_some(&self.hits[..self.count])
    }
}

impl Waits for Box<Group> {
    fn asks(&self) -> impl Iterator<Item = &Asks> {
        self.waiting.iter().map(|waiting| &waiting.asks)
    }

    fn bytes(&self) -> u64 {
        let of_walk = |waiting: &Waiting| match &waiting.left {
            Left::Walk(walk) | Left::Past(walk) => walk.bytes(),
            Left::Hit | Left::Nothing => 0,
        };
        let walks: u64 = self.waiting.iter().map(of_walk).sum();
        (size_of::<Group>() + self.waiting.capacity() * size_of::<Waiting>()) as u64 + walks
    }
}

/// Continues the remaining work for a ray, up to a block that is missing.
fn go_on(
    view: &SceneView,
    task: Task,
    ray: &Ray,
    left: &mut Left,
    found: &mut Found,
    hit: &mut Hit,
) -> Result<(), Need> {
    if let Left::Walk(walk) = left {
        if let Step::Pending(need) = trace(view, task, ray, walk) {
            return Err(need);
        }
        (*found, *left) = (walk.best(), Left::Hit);
    }
    if let Left::Hit = left {
        *hit = missed(view, ray, found, task.want);
        let is_within =
            !is_early(view, ray, found) && (!found.is_hit() || answer_one(view, ray, found, task.want, hit)?);
        *left = if is_within { Left::Nothing } else { Left::Past(begin_past(view, ray)) };
    }
    if let Left::Past(walk) = left {
        past(view, task.any, ray, walk, task.want, found, hit)?;
        *left = Left::Nothing;
    }
    Ok(())
}
