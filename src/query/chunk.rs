//! The rays that a worker answers at a time, and those of them that must wait for blocks.

use super::batch::{Hits, Policy, Rays};
use super::finish::{Last, finish};
use super::hit::{Hit, HitKind, Want};
use crate::math::Ray;
use crate::scene::walk::{Found, Need, ScenePacket, SceneStream, SceneView, SceneWalk, Step};
use crate::structure::bvh::trace::{PACKET, PacketWalk, STREAM, first_rays};
use std::ops::Range;

/// Rays of a chunk: some tens to hundreds of microseconds of work.
pub(super) const CHUNK: usize = STREAM;

/// What a batch asks of each of its rays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Task {
    pub coherent: bool,
    pub policy: Policy,
    pub want: Want,
    /// Any hit will do.
    pub any: bool,
}

/// What it takes to answer a chunk. Reusable.
pub(super) struct Chunk {
    /// Rays that go side by side, group by group, and at their end the group that is being looked at.
    rays: [Ray; CHUNK],
    found: [Found; CHUNK],
    /// Where the groups begin in the batch.
    firsts: [usize; CHUNK / PACKET],
    stream: SceneStream,
    packet: ScenePacket,
    in_one: PacketWalk,
    /// All misses, or filled with `want`.
    hits: [Hit; PACKET],
    want: Want,
    /// Rays without an answer yet.
    unfinished: Vec<u32>,
    /// Groups that must wait, and for which blocks.
    pub parked: Vec<Group>,
    pub needs: Vec<Need>,
}

impl Default for Chunk {
    fn default() -> Self {
        Self {
            rays: [Ray::NONE; CHUNK],
            found: [Found::nothing(0.0); CHUNK],
            firsts: [0; CHUNK / PACKET],
            stream: SceneStream::default(),
            packet: ScenePacket::default(),
            in_one: PacketWalk::new(),
            hits: [Hit::MISS; PACKET],
            want: Want::NOTHING,
            unfinished: Vec::new(),
            parked: Vec::new(),
            needs: Vec::new(),
        }
    }
}

impl Chunk {
    /// Answers `count` rays of a batch from `first` on, but for those that are `parked`.
    pub fn run(&mut self, view: &SceneView, task: Task, first: usize, count: usize, rays: &impl Rays, hits: &impl Hits) {
        if self.want != task.want {
            (self.want, self.hits) = (task.want, [Hit::MISS; PACKET]);
        }
        // Groups that go the same way are answered at once, the others gathered. Only the last may be a part of one.
        let mut gathered = 0;
        for from in (0..count).step_by(PACKET) {
            let group = gathered..gathered + PACKET.min(count - from);
            self.firsts[gathered / PACKET] = first + from;
            rays.read(first + from, &mut self.rays[group.clone()]);
            self.unfinished.clear();
            if may_be_alike(&self.rays[group.clone()]) && self.trace_packet(view, task, group.clone()) {
                self.answer(view, task, group, hits);
            } else {
                gathered = group.end;
            }
        }
        self.unfinished.clear();
        self.trace_each(view, task, gathered);
        for from in (0..gathered).step_by(PACKET) {
            self.answer(view, task, from..gathered.min(from + PACKET), hits);
        }
    }

    fn trace_each(&mut self, view: &SceneView, task: Task, count: usize) {
        let (rays, found) = (&self.rays[..count], &mut self.found[..count]);
        if task.any {
            view.trace_each::<true>(rays, &mut self.stream, found);
        } else {
            view.trace_each::<false>(rays, &mut self.stream, found);
        }
        self.unfinished.extend_from_slice(self.stream.unfinished());
    }

    /// A packet's rays together; false if they must go side by side.
    fn trace_packet(&mut self, view: &SceneView, task: Task, group: Range<usize>) -> bool {
        let (rays, found) = (&self.rays[group.clone()], &mut self.found[group.clone()]);
        let step = if view.only_one().is_none() {
            // Here nobody looks at the rays: only the caller's word tells that they are near each other.
            if !task.coherent {
                return false;
            }
            let Some(rays) = self.rays[group.start..].first_chunk::<PACKET>() else { return false };
            self.packet.begin(view, rays, first_rays(group.len()));
            let step = trace_whole(view, task, rays, &mut self.packet);
            found.iter_mut().enumerate().for_each(|(i, found)| *found = *self.packet.best(i));
            Some(step)
        } else if task.any {
            view.trace_together::<true>(rays, task.coherent, &mut self.in_one, found)
        } else {
            view.trace_together::<false>(rays, task.coherent, &mut self.in_one, found)
        };
        match step {
            None => return false,
            Some(Step::Done) => {}
            // Which of its rays had what they needed is not known.
            Some(Step::Pending(_)) => self.unfinished.extend(group.start as u32..group.end as u32),
        }
        true
    }

    /// Writes the answers of a group, or parks it.
    fn answer(&mut self, view: &SceneView, task: Task, group: Range<usize>, hits: &impl Hits) {
        let mut alone = Vec::new();
        let mut lacking = 0;
        for &i in self.unfinished.iter().filter(|&&i| group.contains(&(i as usize))) {
            let i = i as usize;
            let mut walk = SceneWalk::default();
            walk.begin(view, &self.rays[i]);
            match trace(view, task, &self.rays[i], &mut walk) {
                Step::Pending(need) if task.policy == Policy::Exact => {
                    self.needs.push(need);
                    alone.push((i - group.start, walk));
                }
                step => {
                    self.found[i] = walk.best();
                    lacking |= u32::from(step != Step::Done) << (i - group.start);
                }
            }
        }
        let (first, count) = (self.firsts[group.start / PACKET], group.len());
        let (rays, found) = (&self.rays[group.clone()], &self.found[group]);
        if alone.is_empty() && finish_group(view, task, rays, found, lacking, &mut self.hits, &mut self.needs) {
            return hits.write(first, &self.hits[..count]);
        }
        let mut group = Group::new(first, rays, found);
        group.alone = alone;
        self.parked.push(group);
    }
}

/// Whether rays go into the same octant: what a packet needs at the least. Rays in all directions are told by the first
/// few.
#[inline]
fn may_be_alike(rays: &[Ray]) -> bool {
    let signs = rays[0].dir.is_negative_bitmask();
    rays.iter().all(|it| it.dir.is_negative_bitmask() == signs)
}

fn trace(view: &SceneView, task: Task, ray: &Ray, walk: &mut SceneWalk) -> Step {
    if task.any { view.trace::<true>(ray, walk) } else { view.trace::<false>(ray, walk) }
}

fn trace_whole(view: &SceneView, task: Task, rays: &[Ray; PACKET], packet: &mut ScenePacket) -> Step {
    if task.any { view.trace_packet::<true>(rays, packet) } else { view.trace_packet::<false>(rays, packet) }
}

/// Works out the hits of a group of rays; false if a block is missing. Rays of `lacking` were answered without a
/// block that they needed.
fn finish_group(
    view: &SceneView,
    task: Task,
    rays: &[Ray],
    found: &[Found],
    lacking: u32,
    hits: &mut [Hit; PACKET],
    needs: &mut Vec<Need>,
) -> bool {
    let before = needs.len();
    let mut last = Last::new();
    for (i, ((it, found), hit)) in rays.iter().zip(found).zip(hits).enumerate() {
        match (finish(view, &mut last, it, found, task.want, hit), task.policy) {
            (Ok(()), _) if lacking >> i & 1 == 0 => {}
            (Err(need), Policy::Exact) => needs.push(need),
            _ => hit.kind = HitKind::Missing,
        }
    }
    needs.len() == before
}

/// Up to a packet's rays that wait for blocks, with what it takes to take them up again.
pub(super) struct Group {
    first: usize,
    count: usize,
    rays: [Ray; PACKET],
    found: [Found; PACKET],
    /// Rays that were put down alone, each with its walk. All others have ended.
    alone: Vec<(usize, SceneWalk)>,
}

impl Group {
    fn new(first: usize, rays: &[Ray], found: &[Found]) -> Self {
        let mut group = Self {
            first,
            count: rays.len(),
            rays: [Ray::NONE; PACKET],
            found: [Found::nothing(0.0); PACKET],
            alone: Vec::new(),
        };
        group.rays[..rays.len()].copy_from_slice(rays);
        group.found[..found.len()].copy_from_slice(found);
        group
    }

    /// Its first ray in the batch.
    pub fn first(&self) -> usize {
        self.first
    }

    /// Its rays.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Goes on; the answers, or `None` if blocks are missing still.
    pub fn resume<'a>(
        &mut self,
        view: &SceneView,
        task: Task,
        hits: &'a mut [Hit; PACKET],
        needs: &mut Vec<Need>,
    ) -> Option<&'a [Hit]> {
        let Self { alone, rays, found, count, .. } = self;
        alone.retain_mut(|(i, walk)| match trace(view, task, &rays[*i], walk) {
            Step::Pending(need) => {
                needs.push(need);
                true
            }
            Step::Done => {
                found[*i] = walk.best();
                false
            }
        });
        let (rays, found) = (&rays[..*count], &found[..*count]);
        let done = alone.is_empty() && finish_group(view, task, rays, found, 0, hits, needs);
        done.then(|| &hits[..*count])
    }
}
