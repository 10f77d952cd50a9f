//! Clashes: pairs of parts whose surfaces cross, touch, or are nearer to each other than a clearance, and parts inside
//! of others. Decided by the triangles, in exact arithmetic on their corners, which are placed once in double
//! precision in a frame near the pair. So answers do not depend on threads, on the order of both sets, or on the
//! blocks in memory.

mod contained;
mod cut;
mod depth;
mod depths;
mod facts;
pub(super) mod ids;
mod quest;
mod rules;
mod solid;
mod task;
mod through;

use crate::base::error::{Error, Result};
use crate::base::progress::{Cancel, Progress};
use crate::geom::pairs::Relation;
use crate::math::DBounds;
use crate::query::hit::NONE;
use crate::query::part_set::PartSet;
use crate::scene::SceneState;
use crate::structure::Place;
pub use crate::structure::pairs::PairCounters;
use depth::Reach;
use depths::Depths;
use facts::{Contact, Facts, Found, Met, PairKey};
use glam::DVec3;
use quest::WALKS_SHARE;
pub use rules::ClashRules;
use std::collections::{BTreeMap, BTreeSet};
use task::{PartKey, Task};

/// The results of a clash query that are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[repr(u32)]
pub enum ClashDetail {
    /// One clash for each pair of parts.
    #[default]
    Parts = 1,
    /// One clash for each pair of triangles that meet, and for each pair of parts without such.
    Triangles = 2,
}

/// The way in which two parts clash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum ClashKind {
    /// Their surfaces cross. How deep is not known: no tolerance is given, a part is not closed, or the triangles of
    /// both do not fit the budget.
    Crossing = 1,
    /// Their surfaces overlap in a plane, and do not cross. The parts may lie against each other, or in one another:
    /// that is not known, for the same reasons.
    Coplanar = 2,
    /// Their surfaces have common points, and do not cross or overlap. With a tolerance: neither closed part reaches
    /// deeper into the other than that.
    Touching = 3,
    /// They are apart, and not farther from each other than the clearance.
    Clearance = 4,
    /// Both are closed, and one reaches deeper into the other than the tolerance.
    Hard = 5,
    /// As [`Hard`](Self::Hard), and one goes through the other: its surface outside of the other is in several pieces.
    Piercing = 6,
    /// One part is inside of the other, which is closed. Without a tolerance, their surfaces have no point in common.
    /// With one, it is deeper inside than that, and its surface is nowhere farther outside.
    Contained = 7,
    /// With a tolerance: both are closed, and each surface is nowhere farther from the other.
    Duplicate = 8,
}

impl From<Relation> for ClashKind {
    fn from(relation: Relation) -> Self {
        match relation {
            Relation::Crossing => Self::Crossing,
            Relation::Coplanar => Self::Coplanar,
            _ => Self::Touching,
        }
    }
}

/// Options of a clash query.
#[derive(Debug, Clone, PartialEq)]
pub struct ClashOptions {
    /// Parts of which a clash has one.
    pub a: PartSet,
    /// Parts of which a clash has the other; `None`: `a`.
    pub b: Option<PartSet>,
    /// Pairs of parts that are not compared.
    pub rules: ClashRules,
    /// Distance in world units up to which parts that are apart clash; 0: parts that are apart do not clash.
    pub clearance: f64,
    /// Distance in world units up to which closed parts that reach into each other touch, and up to which the depths
    /// of others are found. 0: depths are not sought.
    pub tolerance: f64,
    /// The results that are asked for.
    pub detail: ClashDetail,
    /// Greatest number of pairs of triangles that are returned.
    pub limit: u64,
}

impl Default for ClashOptions {
    fn default() -> Self {
        Self {
            a: PartSet::all(),
            b: None,
            rules: ClashRules::default(),
            clearance: 0.0,
            tolerance: 0.0,
            detail: ClashDetail::default(),
            limit: 1 << 20,
        }
    }
}

impl ClashOptions {
    /// Fails with `BadArgument` if a set is empty, or the clearance or tolerance is negative or not finite.
    pub fn check(&self) -> Result<()> {
        for (name, given) in [("clearance", self.clearance), ("tolerance", self.tolerance)] {
            if !(given >= 0.0 && given.is_finite()) {
                return Err(Error::BadArgument(format!("the {name} is {given}; it must be finite and not negative")));
            }
        }
        if self.a.is_empty() || self.b.as_ref().is_some_and(PartSet::is_empty) {
            return Err(Error::bad_argument("a set of parts is empty"));
        }
        Ok(())
    }
}

/// A clash of two parts, or of a triangle of each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clash {
    /// The caller's ids of both instances. The first part is in the first set, and the second in the second set; if
    /// both may be either, the one comes first whose instance was added first, or that comes first in its model.
    pub instances: [u64; 2],
    /// The caller's ids of both parts.
    pub parts: [u64; 2],
    /// The indices of both triangles in the inputs of their models' builds; [`NONE`] in a clash of parts.
    pub prims: [u64; 2],
    /// The way in which they clash.
    pub kind: ClashKind,
    /// World space. If there is a depth: the deepest point of a part in the other, and the point of the other's surface
    /// nearest to it. Clearance: a point of each part, nearest to each other. Otherwise the ends of the common segment
    /// of two triangles, or a corner of the part inside, twice.
    pub points: [DVec3; 2],
    /// The direction in which the second part moves away from the first, of length 1: between `points` if there is a
    /// depth or distance, otherwise along the normal of a triangle there. Zero if none is known.
    pub normal: DVec3,
    /// The greatest distance from a point of a part's surface that is inside of the other part to the other's surface;
    /// 0 if it is not known.
    pub depth: f64,
    /// Distance between the parts; 0 if they have points in common, or one is in the other.
    pub distance: f64,
    /// Bound of the error of `depth` or `distance`.
    pub error: f64,
    /// Bounds of all common points of the surfaces; of `points` if there are none.
    pub bounds: DBounds,
    /// Number of pairs of triangles that meet. Where spatial splits put triangles into several leaves, pairs of these
    /// are counted several times in a clash of parts.
    pub count: u64,
    /// True for each part that is not closed: nothing is known of its inside.
    pub is_open: [bool; 2],
}

impl Clash {
    /// A number that depends on the ids of instances, parts and triangles alone, so that clashes of two queries can be
    /// compared: not on which part is the first, which follows the sets and the order of instances.
    pub fn id(&self) -> u64 {
        let side = |k: usize| [self.instances[k], self.parts[k], self.prims[k]];
        let (a, b) = (side(0), side(1));
        let sides = [a.min(b), a.max(b)];
        sides.as_flattened().iter().fold(0x9e37_79b9_7f4a_7c15, |id, word| {
            // The finaliser of SplitMix64 (Steele, Lea, Flood 2014).
            let mixed = (id ^ *word).wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
            mixed ^ mixed >> 31
        })
    }
}

/// The end of a clash query.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClashSummary {
    /// Number of clashes.
    pub clashes: u64,
    /// Number of pairs of parts that clash.
    pub pairs: u64,
    /// True if pairs of triangles were left out, because there are more than the limit.
    pub is_cut: bool,
    /// Steps of the search. They depend on neither threads nor the blocks in memory.
    pub steps: PairCounters,
}

impl SceneState {
    /// Finds the pairs of visible parts that clash, and calls `take` in the caller's thread for each: by instance in
    /// the order added, then by part in the file's order, then by triangle.
    ///
    /// Parts of one instance are compared too, and each instance of a shared mesh counts; the triangles of one part are
    /// not compared with each other. Parts that meet in a corner or an edge touch.
    ///
    /// Blocks; may read the disk. Thread-safe. Fails with `BadArgument` for an empty set, for ids that the scene lacks,
    /// and for a clearance or tolerance that is negative or not finite; with `Cancelled`, and with the error of a disk
    /// read.
    pub fn clash(
        &self,
        options: &ClashOptions,
        progress: &Progress,
        cancel: &Cancel,
        take: &mut dyn FnMut(&Clash),
    ) -> Result<ClashSummary> {
        options.check()?;
        let task = Task::new(self, options, progress, cancel)?;
        let mut found = quest::search(&task, &task.tree_pairs()?)?;
        cancel.check()?;
        found.keep(options.limit, true);
        let ids = ids::of_triangles(self, &found.met)?;
        let contained = contained::search(&task, &found)?;
        cancel.check()?;
        hand_out(&task, found, &ids, &contained, take)
    }
}

/// Hands out all clashes in order, with the depths of some pairs of parts at a time.
fn hand_out(
    task: &Task,
    found: Found,
    ids: &[[u64; 2]],
    contained: &BTreeMap<PairKey, DVec3>,
    take: &mut dyn FnMut(&Clash),
) -> Result<ClashSummary> {
    let mut summary = ClashSummary { is_cut: found.is_cut, steps: found.steps, ..ClashSummary::default() };
    let mut met: Vec<_> = found.met.iter().zip(ids).collect();
    // A triangle has one id in several leaves; a face has one id for many triangles, which their places tell apart.
    let place = |at: (u64, Place)| task.scene.has_ids_of_faces(at.0).then_some(at);
    let key = |(met, ids): &(&Met, &[u64; 2])| (met.parts, **ids, met.at.map(place));
    met.sort_unstable_by_key(key);
    met.dedup_by_key(|one| key(one));
    let mut met = met.into_iter().peekable();
    let keys: BTreeSet<PairKey> = found.facts.keys().chain(contained.keys()).copied().collect();
    let mut clashes: Vec<(PairKey, Clash)> = Vec::new();
    for key in keys {
        let clash = of_parts(task, key, found.facts.get(&key), contained.get(&key));
        clashes.extend(clash.map(|clash| (key, clash)));
    }
    let has_depth = |clash: &Clash| {
        task.options.tolerance > 0.0 && clash.is_open == [false; 2] && clash.kind != ClashKind::Clearance
    };
    let deep: Vec<PairKey> = clashes.iter().filter(|(_, clash)| has_depth(clash)).map(|(key, _)| *key).collect();
    let (mut depths, mut reaches, mut done) = (Depths::new(task), BTreeMap::new(), 0);
    for (key, mut clash) in clashes {
        if has_depth(&clash) {
            if !reaches.contains_key(&key) {
                let now = &deep[done..done + depths.count(&deep[done..])];
                reaches = now.iter().copied().zip(depths.of(now)?).collect();
                done += now.len();
                task.progress.advance(WALKS_SHARE + (1.0 - WALKS_SHARE) * done as f64 / deep.len() as f64);
            }
            if let Some(Some(reach)) = reaches.get(&key) {
                clash.add_depth(reach, task.options.tolerance);
            }
        }
        summary.pairs += 1;
        let mut has_triangles = false;
        while let Some((of, prims)) = met.next_if(|(met, _)| met.parts == key) {
            let [a, b] = of.points;
            let (kind, bounds) = (of.relation.into(), DBounds { min: a.min(b), max: a.max(b) });
            let one = Clash { prims: *prims, kind, points: of.points, normal: of.normal, bounds, count: 1, ..clash };
            (summary.clashes, has_triangles) = (summary.clashes + 1, true);
            take(&task.in_order(key, one));
        }
        if !has_triangles {
            summary.clashes += 1;
            take(&task.in_order(key, clash));
        }
    }
    Ok(summary)
}

/// The clash of a pair of parts, without its depth; `None` if they do not clash.
fn of_parts(task: &Task, key: PairKey, facts: Option<&Facts>, inside: Option<&DVec3>) -> Option<Clash> {
    let info = key.map(|[instance, part]| {
        let part = task.scene.model_of_instance(instance.into()).parts().get(part as usize);
        (
            task.scene.instance_id(instance.into()),
            part.as_ref().map_or(NONE, |part| part.id),
            part.is_none_or(|part| !part.is_closed),
        )
    });
    let clash = Clash {
        instances: info.map(|it| it.0),
        parts: info.map(|it| it.1),
        prims: [NONE; 2],
        kind: ClashKind::Crossing,
        points: [DVec3::ZERO; 2],
        normal: DVec3::ZERO,
        depth: 0.0,
        distance: 0.0,
        error: 0.0,
        bounds: DBounds::EMPTY,
        count: 0,
        is_open: info.map(|it| it.2),
    };
    if let Some(facts) = facts
        && let Some(Contact { relation, points, normal }) = facts.contact
    {
        let (kind, count) = (relation.into(), facts.counts.iter().sum());
        return Some(Clash { kind, points, normal, bounds: facts.bounds, count, ..clash });
    }
    if let Some(&corner) = inside {
        return Some(Clash { kind: ClashKind::Contained, points: [corner; 2], ..clash }.bounded());
    }
    let (squared, error, points) = facts?.nearest?;
    let distance = squared.sqrt();
    let normal = (points[1] - points[0]).normalize_or_zero();
    let is_near = distance - error <= task.options.clearance;
    is_near.then(|| Clash { kind: ClashKind::Clearance, points, normal, distance, error, ..clash }.bounded())
}

impl Clash {
    /// With the bounds of its points.
    fn bounded(self) -> Self {
        let [a, b] = self.points;
        Self { bounds: DBounds { min: a.min(b), max: a.max(b) }, ..self }
    }

    fn add_depth(&mut self, reach: &Reach, tolerance: f64) {
        (self.depth, self.error) = (reach.depth, reach.error);
        self.kind = match (reach.depth > tolerance, reach.is_outside, reach.goes_through) {
            (false, [false, false], _) => ClashKind::Duplicate,
            (false, ..) => ClashKind::Touching,
            (true, [true, true], false) => ClashKind::Hard,
            (true, [true, true], true) => ClashKind::Piercing,
            (true, ..) => ClashKind::Contained,
        };
        if reach.depth > 0.0 {
            self.points = reach.points;
            self.normal = (reach.points[0] - reach.points[1]).normalize_or(self.normal);
        }
        if self.count == 0 {
            *self = self.bounded();
        }
    }
}

impl Task<'_> {
    /// Puts the parts of a clash into the order of the sets.
    fn in_order(&self, [x, y]: [PartKey; 2], clash: Clash) -> Clash {
        if self.is_in_order(x, y) {
            return clash;
        }
        let turn = |[a, b]: [u64; 2]| [b, a];
        Clash {
            instances: turn(clash.instances),
            parts: turn(clash.parts),
            prims: turn(clash.prims),
            points: [clash.points[1], clash.points[0]],
            normal: -clash.normal,
            is_open: [clash.is_open[1], clash.is_open[0]],
            ..clash
        }
    }
}
