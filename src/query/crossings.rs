//! All crossings of rays with surfaces, in order.
//!
//! A ray is answered by visits to the placed trees that it may enter. Visits are made in [sweeps](super::sweep) of
//! limited size, in the order of the rays, so that memory does not grow with the batch. Only the crossings of the rays
//! of one sweep are held at a time.

use super::answers::{WorldNormal, distance, meet};
use super::batch::{Policy, Rays};
use super::hit::{HitKind, NONE};
use super::sweep::sweep;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::memory::make_room;
use crate::geom::Side;
use crate::math::Ray;
use crate::scene::SceneState;
use crate::scene::placed::Placed;
use crate::scene::through::Entrances;
use crate::scene::walk::SceneView;
use crate::structure::{Descent, Place, Triangle};
use glam::Vec3;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// A point where a ray goes through an original triangle. The members have the order of the C struct.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Crossing {
    /// Distance in units of the ray's `|dir|`, in double precision.
    pub t: f64,
    /// The caller's id of the part.
    pub part: u64,
    /// The caller's id of the instance.
    pub instance: u64,
    /// As [`Hit::prim`](super::hit::Hit::prim); [`NONE`] if it is not in memory.
    pub prim: u64,
    /// Unit geometric normal in world space, facing the ray's origin.
    pub normal: Vec3,
    /// Weights of the triangle's second and third vertex.
    pub uv: [f32; 2],
    /// Some original surface lies within this distance of the point at `t` (world units).
    pub error: f32,
    /// The side of the triangle that the ray meets.
    pub side: Side,
    /// [`HitKind::Exact`], or [`HitKind::Missing`] if the primitive id is not in memory.
    pub kind: HitKind,
}

/// Takes the answer to the ray with this index: its crossings in order, and true if they are all.
pub type Take<'a> = &'a mut dyn FnMut(usize, &[Crossing], bool);

impl SceneState {
    /// Finds all surfaces that each ray crosses within its interval, nearest first; at equal distances by part,
    /// instance and primitive. Coincident surfaces are all found. Calls `take` in the caller's thread for each ray, in
    /// order.
    ///
    /// An edge or a corner that triangles of a closed surface share counts once: the ray crosses such a surface as
    /// often from the front as from the back if it begins and ends outside. Triangles parallel to the ray are not
    /// crossed. Footprints are ignored: crossings are always those of original triangles. Other rules are those of
    /// [`SceneState::closest`]: for bad rays, hidden parts, and masks. With [`Policy::Now`] the answers to some rays
    /// may be incomplete.
    ///
    /// Blocks; may read the disk. Thread-safe. Fails with the error of a disk read, and with `OverBudget` if the
    /// crossings of a single ray take more than a quarter of the context's budget.
    pub fn crossings(&self, rays: &dyn Rays, policy: Policy, take: Take) -> Result<()> {
        let (mut crossings, mut refused) = (Vec::new(), Ok(()));
        self.crossings_of_parts(rays, policy, &mut |ray, met, is_complete| {
            crossings.clear();
            let room = make_room(&mut crossings, met.len(), CROSSINGS);
            if refused.is_ok() && room.is_ok() {
                crossings.extend(met.iter().map(|met| met.crossing));
                take(ray, &crossings, is_complete);
            } else {
                refused = std::mem::replace(&mut refused, Ok(())).and(room);
            }
        })?;
        refused
    }

    /// [`SceneState::crossings`], with the indices of parts and instances.
    pub(super) fn crossings_of_parts(&self, rays: &dyn Rays, policy: Policy, take: TakeMet) -> Result<()> {
        let mut some = vec![Ray::NONE; RAYS.min(rays.count())];
        let mut entrances = Entrances::default();
        for first in (0..rays.count()).step_by(RAYS) {
            let some = &mut some[..RAYS.min(rays.count() - first)];
            rays.read(first, some);
            let mut few = Few { scene: self, rays: some, first, policy, done: 0, open: Open::new() };
            let mut visits = Vec::new();
            for (i, ray) in some.iter().enumerate() {
                entrances.begin(self, ray);
                while let Some(placed) = entrances.next(self, ray) {
                    visits.push((i as u32, placed));
                    if visits.len() == VISITS {
                        few.visit(&visits, take)?;
                        visits.clear();
                    }
                }
            }
            few.visit(&visits, take)?;
            few.finish(some.len(), take);
        }
        Ok(())
    }
}

/// What the memory of results is for, in errors.
const CROSSINGS: &str = "the crossings of rays";

/// Number of rays that are read at a time, and greatest number of visits of a sweep.
const RAYS: usize = 4096;
const VISITS: usize = 1 << 14;

/// The crossings that are held at a time take at most the budget divided by this.
const SHARE: u64 = 4;

/// Bytes of a crossing: vectors have up to twice the room that they need, and the caller gets copies of a ray's.
const EACH: u64 = (2 * size_of::<Met>() + size_of::<Crossing>()) as u64;

/// Takes the answer to a ray, as [`Take`].
pub(super) type TakeMet<'a> = &'a mut dyn FnMut(usize, &[Met], bool);

/// A crossing, with the place of its triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Met {
    pub crossing: Crossing,
    /// Index of the placed tree.
    pub placed: u64,
    /// Index of the part in its model.
    pub part: u32,
    /// The place of the primitive id. With it the id needs one block, and not the triangle's block in addition.
    prim: Place,
    /// True if the primitive id is known.
    is_known: bool,
}

/// The result of a visit.
#[derive(Default)]
struct Found {
    met: Vec<Met>,
    /// True if blocks were missing.
    is_short: bool,
    /// True if the system has refused memory.
    is_refused: bool,
}

/// The crossings so far of the ray that is answered next.
struct Open {
    met: Vec<Met>,
    is_complete: bool,
}

impl Open {
    fn new() -> Self {
        Self { met: Vec::new(), is_complete: true }
    }
}

/// Rays that are answered together.
struct Few<'a> {
    scene: &'a SceneState,
    rays: &'a [Ray],
    /// Index in the batch of the first of them.
    first: usize,
    policy: Policy,
    /// Number of rays that are answered.
    done: usize,
    open: Open,
}

impl Few<'_> {
    /// Makes visits, which are in the order of their rays, and answers the rays before the last one.
    fn visit(&mut self, mut visits: &[(u32, u64)], take: TakeMet) -> Result<()> {
        let mut count = visits.len();
        while !visits.is_empty() {
            let (now, later) = visits.split_at(count.min(visits.len()));
            self.finish(now[0].0 as usize, take);
            let most = self.scene.context().memory_budget() / SHARE;
            let room = most.saturating_sub(self.open.met.len() as u64 * EACH);
            let Some(found) = self.sweep(now, room)? else {
                if count == 1 {
                    return Err(self.too_many(now[0].0)?);
                }
                count = count.div_ceil(2);
                continue;
            };
            for (&(ray, _), found) in now.iter().zip(found) {
                self.finish(ray as usize, take);
                self.open.is_complete &= !found.is_short;
                if self.open.met.is_empty() {
                    self.open.met = found.met;
                } else {
                    make_room(&mut self.open.met, found.met.len(), CROSSINGS)?;
                    self.open.met.extend(found.met);
                }
            }
            visits = later;
        }
        Ok(())
    }

    /// Makes visits at the same time; `None` if their results take more than `room` bytes.
    fn sweep(&self, visits: &[(u32, u64)], room: u64) -> Result<Option<Vec<Found>>> {
        let trees: Vec<u64> = visits.iter().map(|&(_, placed)| placed).collect();
        let room = Room { left: AtomicU64::new(room / EACH), is_exceeded: AtomicBool::new(false) };
        let found = sweep(self.scene, &trees, self.policy, &|view, visit, left, found: &mut Found| {
            let (ray, placed) = visits[visit];
            search(view, &self.rays[ray as usize], placed, left, found, &room)
        })?;
        if let Some(refused) = found.iter().find(|found| found.is_refused) {
            let bytes = (2 * refused.met.len() * size_of::<Met>()) as u64;
            return Err(Error::NoMemory { what: CROSSINGS.into(), bytes });
        }
        Ok((!room.is_exceeded.into_inner()).then_some(found))
    }

    /// The error that the crossings of a ray take too much memory; counts them all.
    fn too_many(&self, ray: u32) -> Result<Error> {
        let (mut entrances, mut count, mut left) = (Entrances::default(), 0, true);
        let ray = &self.rays[ray as usize];
        entrances.begin(self.scene, ray);
        while left {
            let trees: Vec<u64> = std::iter::from_fn(|| entrances.next(self.scene, ray)).take(VISITS).collect();
            left = !trees.is_empty();
            count += sweep(self.scene, &trees, self.policy, &|view, visit, left, count: &mut u64| {
                view.through(ray, trees[visit], left, &mut |_, _, _, _| *count += 1);
                Vec::new()
            })?
            .iter()
            .sum::<u64>();
        }
        // The margin is for rounding.
        let need = (count + 2) * EACH * SHARE;
        let have = self.scene.context().memory_budget();
        Ok(Error::OverBudget { what: format!("the {count} crossings of a single ray"), need: need.max(have + 1), have })
    }

    /// Answers the rays before `end`.
    fn finish(&mut self, end: usize, take: TakeMet) {
        while self.done < end {
            let Open { met, is_complete } = &mut self.open;
            sort(self.scene, met);
            take(self.first + self.done, met, *is_complete);
            met.clear();
            (*is_complete, self.done) = (true, self.done + 1);
        }
    }
}

/// Room for the crossings of a sweep, which its visits share. Each takes some before it finds them: otherwise every
/// thread could fill all of it.
struct Room {
    /// Number of crossings.
    left: AtomicU64,
    /// True if a visit has found more. Then all visits end.
    is_exceeded: AtomicBool,
}

/// Most crossings for which a visit takes room at a time.
const AT_A_TIME: usize = 64;

impl Room {
    /// Takes room for about `count` crossings; returns for how many, 0 if there is none.
    fn take(&self, count: usize) -> usize {
        let of = |count: usize| {
            let less = |left: u64| left.checked_sub(count as u64);
            self.left.fetch_update(Relaxed, Relaxed, less).map_or(0, |_| count)
        };
        let taken = if of(count) > 0 { count } else { of(1) };
        if taken == 0 {
            self.is_exceeded.store(true, Relaxed);
        }
        taken
    }

    fn give_back(&self, count: usize) {
        self.left.fetch_add(count as u64, Relaxed);
    }
}

/// Makes room for another crossing. Returns false if the system refuses memory.
fn grow(met: &mut Vec<Met>) -> bool {
    // Most visits find one crossing or two: the least room of a vector would be for four.
    met.len() < met.capacity() || met.try_reserve_exact(met.len().max(1)).is_ok()
}

/// Continues a visit of a ray to a placed tree. Returns the blocks of primitive ids that it lacks. Without room the
/// visit ends without a result.
fn search(
    view: &SceneView,
    ray: &Ray,
    placed: u64,
    left: &mut Descent,
    found: &mut Found,
    room: &Room,
) -> Vec<BlockId> {
    let p = view.scene.placed(placed);
    let instance = view.scene.instance_id(p.instance);
    let parts = view.model_of(placed).parts();
    let tree = view.tree(placed);
    let Found { met, is_refused, .. } = found;
    let (before, mut taken) = (met.len(), 0);
    view.through(ray, placed, left, &mut |hit, triangle, side, span| {
        let t = distance(&p, &triangle.vertices, ray, span);
        if (ray.begins()..=ray.t_max).contains(&t) && !room.is_exceeded.load(Relaxed) {
            if met.len() - before == taken {
                let more = room.take(taken.clamp(1, AT_A_TIME));
                if more == 0 {
                    return;
                }
                taken += more;
            }
            if !grow(met) {
                *is_refused = true;
                return;
            }
            let part = p.first_part.saturating_add(triangle.part);
            let id = parts.id(part as usize).unwrap_or(NONE);
            let crossing = Crossing { part: id, instance, side, ..crossing(&p, triangle, ray, t) };
            // The triangle's block is in memory here.
            met.extend(tree.prim_place(hit).map(|prim| Met { crossing, placed, part, prim, is_known: false }));
        }
    });
    room.give_back(taken - (met.len() - before));
    if room.is_exceeded.load(Relaxed) {
        *left = Descent::default();
        return Vec::new();
    }
    let mut lacking = Vec::new();
    for met in met.iter_mut().filter(|met| !met.is_known) {
        match tree.prim_at(met.prim) {
            Ok(prim) => {
                met.crossing.prim = prim.map_or(NONE, u64::from);
                (met.crossing.kind, met.is_known) = (HitKind::Exact, true);
            }
            Err(block) if lacking.last() != Some(&block) => lacking.push(block),
            Err(_) => {}
        }
    }
    found.is_short = !lacking.is_empty() || left.missing().next().is_some();
    lacking
}

/// The crossing of a ray and a triangle at `t`, without ids.
fn crossing(placed: &Placed, triangle: &Triangle, ray: &Ray, t: f64) -> Crossing {
    let meeting = meet(placed, &triangle.vertices, ray, t);
    Crossing {
        // The sum makes one zero of both.
        t: meeting.t + 0.0,
        part: NONE,
        instance: NONE,
        prim: NONE,
        normal: WorldNormal::new(placed, &triangle.vertices).facing(ray.dir),
        uv: meeting.weights.map(|w| w as f32),
        error: meeting.error(placed, ray.origin, ray.dir),
        side: Side::Front,
        kind: HitKind::Missing,
    }
}

/// Puts the crossings of a ray in order, each once.
fn sort(scene: &SceneState, met: &mut Vec<Met>) {
    keep_one_of_each(scene, met);
    let key = |met: &Met| (met.crossing.part, met.crossing.instance, met.crossing.prim, met.placed, met.prim);
    met.sort_unstable_by(|a, b| a.crossing.t.total_cmp(&b.crossing.t).then_with(|| key(a).cmp(&key(b))));
}

/// Removes the repetitions of triangles that are in several leaves of a tree, or in several trees of a divided mesh.
/// A face has one id for many triangles, which are not repeated.
fn keep_one_of_each(scene: &SceneState, met: &mut Vec<Met>) {
    let tree = |met: &Met| scene.ids_of(met.placed).tree;
    let triangle = |met: &Met| (met.crossing.instance, met.crossing.part, met.crossing.prim);
    met.sort_unstable_by_key(|met| (triangle(met), tree(met), met.placed, met.prim));
    // The first kept crossing of the triangle, and the first one in the same tree.
    let (mut of_triangle, mut of_tree, mut kept) = (0, 0, 0);
    for i in 0..met.len() {
        let now = met[i];
        if kept > 0 && triangle(&met[kept - 1]) == triangle(&now) {
            let last = met[kept - 1];
            let repeats = now.is_known && !scene.has_ids_of_faces(now.placed);
            if last.placed == now.placed && repeats {
                continue;
            }
            if tree(&last) != tree(&now) {
                of_tree = kept;
            }
            let is_beside = |other: &Met| {
                let is_one_mesh = scene.placed(other.placed).is_beside(&scene.placed(now.placed));
                is_one_mesh && !scene.has_ids_of_faces(other.placed)
            };
            if repeats && met[of_triangle..of_tree].iter().any(is_beside) {
                continue;
            }
        } else {
            (of_triangle, of_tree) = (kept, kept);
        }
        met[kept] = now;
        kept += 1;
    }
    met.truncate(kept);
}

impl SceneState {
    /// True if the primitive ids of a placed tree are those of faces, which have many triangles each.
    pub(super) fn has_ids_of_faces(&self, placed: u64) -> bool {
        let ids = self.ids_of(placed);
        self.models[ids.model as usize].trees()[ids.tree as usize].has_ids_of_faces()
    }
}
