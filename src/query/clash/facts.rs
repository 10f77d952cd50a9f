//! Results of pairs of triangles, collected by pairs of parts. They do not depend on the order of visits.

use super::super::frames::Frames;
use super::ClashDetail;
use super::task::{PartKey, Task, key_of};
use crate::geom::Sifted;
use crate::geom::distances::apart_triangles;
use crate::geom::pairs::{Relation, meeting, relate};
use crate::math::{DBounds, bits};
use crate::scene::placed::Placed;
use crate::structure::Place;
use crate::structure::pairs::{Near, Opened, PairCounters, PairSide, PairVisit, PartsBelow};
use glam::DVec3;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// A pair of parts, the lesser key first.
pub(super) type PairKey = [PartKey; 2];

/// A pair of triangles that meet, in the order of their parts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Met {
    pub parts: PairKey,
    /// The placed tree of each triangle, and the place of its primitive id.
    pub at: [(u64, Place); 2],
    pub relation: Relation,
    pub points: [DVec3; 2],
    /// The unit normal of the first triangle; 0 if it has no area.
    pub normal: DVec3,
}

/// A point at which two parts meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contact {
    pub relation: Relation,
    /// The ends of the common segment of two triangles.
    pub points: [DVec3; 2],
    /// The unit normal of the triangle of the first part; 0 if it has no area.
    pub normal: DVec3,
}

/// All that is known of a pair of parts.
#[derive(Debug, Clone)]
pub(super) struct Facts {
    /// Numbers of pairs of triangles that cross, overlap in a plane, and touch. A pair that spatial splits put into
    /// several leaves counts several times.
    pub counts: [u64; 3],
    /// The one of the strongest relation that is least by x, y, z of its points, then of its normal.
    pub contact: Option<Contact>,
    /// Bounds of all common points.
    pub bounds: DBounds,
    /// The nearest points of triangles that are apart: squared distance, bound of the rounding error of the distance, a
    /// point of each.
    pub nearest: Option<(f64, f64, [DVec3; 2])>,
}

impl Facts {
    const NONE: Self = Self { counts: [0; 3], contact: None, bounds: DBounds::EMPTY, nearest: None };

    /// True if triangles meet.
    pub fn meets(&self) -> bool {
        self.counts != [0; 3]
    }

    fn merge(&mut self, other: &Self) {
        self.counts.iter_mut().zip(other.counts).for_each(|(own, other)| *own += other);
        self.bounds = self.bounds.union(other.bounds);
        if let Some(contact) = other.contact {
            self.meet(contact);
        }
        if let Some(nearest) = other.nearest {
            self.approach(nearest);
        }
    }

    fn meet(&mut self, contact: Contact) {
        let key =
            |of: &Contact| (std::cmp::Reverse(of.relation), of.points.map(|p| p.to_array()), of.normal.to_array());
        let is_less = |of: &Contact| key(&contact).partial_cmp(&key(of)).is_some_and(|order| order.is_lt());
        if self.contact.as_ref().is_none_or(is_less) {
            self.contact = Some(contact);
        }
    }

    fn approach(&mut self, nearest: (f64, f64, [DVec3; 2])) {
        let key = |(squared, _, points): &(f64, f64, [DVec3; 2])| (*squared, points.map(|p| p.to_array()));
        let is_less = |of: &_| key(&nearest).partial_cmp(&key(of)).is_some_and(|order| order.is_lt());
        if self.nearest.as_ref().is_none_or(is_less) {
            self.nearest = Some(nearest);
        }
    }
}

/// Results of walks.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub facts: BTreeMap<PairKey, Facts>,
    pub met: Vec<Met>,
    /// True if pairs of triangles were left out of `met`, because there are more than the limit.
    pub is_cut: bool,
    /// Steps of the walks.
    pub steps: PairCounters,
}

impl Found {
    pub fn merge(&mut self, other: Self, limit: u64) {
        for (key, facts) in other.facts {
            self.facts.entry(key).or_insert(Facts::NONE).merge(&facts);
        }
        self.met.extend(other.met);
        self.is_cut |= other.is_cut;
        self.steps += other.steps;
        self.keep(limit, false);
    }

    /// Keeps the least `limit` pairs of triangles by parts and places, each once. Without `now` it may keep more.
    pub fn keep(&mut self, limit: u64, now: bool) {
        let limit = usize::try_from(limit).unwrap_or(usize::MAX);
        if now || self.met.len() >= limit.saturating_mul(2).max(1 << 12) {
            let key = |met: &Met| (met.parts, met.at);
            self.met.sort_unstable_by_key(key);
            self.met.dedup_by_key(|met| key(met));
            self.is_cut |= self.met.len() > limit;
            self.met.truncate(limit);
        }
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        (self.facts.len() * size_of::<(PairKey, Facts)>() + self.met.capacity() * size_of::<Met>()) as u64
    }
}

/// Compares triangles of two placed trees.
pub(super) struct Meeting<'a> {
    task: &'a Task<'a>,
    /// Indices of the placed trees.
    pair: [u32; 2],
    placed: [Cow<'a, Placed>; 2],
    sides: &'a [PairSide<'a>; 2],
    frames: &'a Frames,
    /// -1 for a tree that is mirrored: its triangles turn the other way. Else 1.
    turns: [f64; 2],
    found: &'a mut Found,
    /// The last pair of parts, and whether it is compared.
    last: Option<(PairKey, bool)>,
    /// The members of both sets among the parts of each tree, see [`Task::bits_of`].
    members: [[u32; 2]; 2],
    /// True if a tree has several parts.
    selects: bool,
}

impl<'a> Meeting<'a> {
    pub fn new(
        task: &'a Task<'a>,
        pair: [u32; 2],
        sides: &'a [PairSide<'a>; 2],
        frames: &'a Frames,
        found: &'a mut Found,
        members: [[u32; 2]; 2],
    ) -> Self {
        let placed = pair.map(|at| task.scene.placed(at.into()));
        let selects = placed.iter().any(|p| task.scene.models[p.model as usize].local_parts(p.tree) > 1);
        let turns = placed.each_ref().map(|p| p.frame().matrix3.determinant().signum());
        Self { task, pair, placed, sides, frames, turns, found, last: None, members, selects }
    }

    /// The parts of two triangles, and true if that of the second comes first.
    #[inline]
    fn parts(&self, (a, i): (&Opened, usize), (b, j): (&Opened, usize)) -> (PairKey, bool) {
        let key = |placed: &Placed, part: u32| key_of(placed, placed.first_part.saturating_add(part));
        let [x, y] = [key(&self.placed[0], a.rows.parts[i]), key(&self.placed[1], b.rows.parts[j])];
        if y < x { ([y, x], true) } else { ([x, y], false) }
    }
}

impl PairVisit for Meeting<'_> {
    fn selects(&self) -> bool {
        self.selects
    }

    fn may_want(&mut self, a: &PartsBelow, b: &PartsBelow) -> bool {
        if let (Some(x), Some(y)) = (a.one(), b.one()) {
            let key = |placed: &Placed, part: u32| key_of(placed, placed.first_part.saturating_add(part));
            return self.wants(key(&self.placed[0], x), key(&self.placed[1], y));
        }
        let [[a_first, a_second], [b_first, b_second]] = self.members;
        a.bits & a_first != 0 && b.bits & b_second != 0 || a.bits & a_second != 0 && b.bits & b_first != 0
    }

    fn wanted(&mut self, near: &Near) -> u32 {
        let mut wanted = 0;
        for j in bits(near.mask) {
            let (parts, _) = self.parts(near.a, (near.b, j));
            wanted |= u32::from(self.wants(parts[0], parts[1])) << j;
        }
        wanted
    }

    fn take(&mut self, near: &Near, sifted: Sifted) -> bool {
        let apart = if self.task.options.clearance > 0.0 { 0 } else { sifted.apart };
        for j in bits(near.mask & !apart) {
            let known = match (sifted.apart >> j & 1 == 1, sifted.crossing >> j & 1 == 1) {
                (true, _) => Some(Relation::Apart),
                (_, true) => Some(Relation::Crossing),
                _ => None,
            };
            self.compare(near.a, (near.b, j), known);
        }
        !self.task.is_over()
    }
}

impl Meeting<'_> {
    /// [`Task::wants`]; it remembers the last answer.
    #[inline]
    fn wants(&mut self, x: PartKey, y: PartKey) -> bool {
        match self.last {
            Some((last, is_wanted)) if last == [x, y] => is_wanted,
            _ => {
                let is_wanted = self.task.wants(x, y);
                self.last = Some(([x, y], is_wanted));
                is_wanted
            }
        }
    }

    /// Compares two triangles, whose relation may be known.
    fn compare(&mut self, (a, i): (&Opened, usize), (b, j): (&Opened, usize), known: Option<Relation>) {
        let (parts, is_turned) = self.parts((a, i), (b, j));
        let (first, second) = (&a.triangles[i], &b.triangles[j]);
        let relation = known.unwrap_or_else(|| relate(first, second));
        let in_world = |points: [DVec3; 2]| points.map(|p| p + self.frames.origin);
        let at = match relation {
            Relation::Apart => {
                let clearance = self.task.options.clearance;
                if clearance > 0.0 {
                    let near = apart_triangles(first, second);
                    if near.bounds()[0] <= clearance {
                        let points = if is_turned { [near.points[1], near.points[0]] } else { near.points };
                        let nearest = (near.squared, near.error, in_world(points));
                        self.found.facts.entry(parts).or_insert(Facts::NONE).approach(nearest);
                    }
                }
                return;
            }
            Relation::Crossing => 0,
            Relation::Coplanar => 1,
            Relation::Touching | Relation::Adjacent => 2,
        };
        let Some(points) = meeting(first, second).map(in_world) else { return };
        let (of_first, turns) = if is_turned { (second, self.turns[1]) } else { (first, self.turns[0]) };
        let normal = (of_first[1] - of_first[0]).cross(of_first[2] - of_first[0]).normalize_or_zero() * turns;
        let facts = self.found.facts.entry(parts).or_insert(Facts::NONE);
        facts.counts[at] += 1;
        facts.meet(Contact { relation, points, normal });
        points.iter().for_each(|&p| facts.bounds = facts.bounds.union(DBounds { min: p, max: p }));
        if self.task.options.detail == ClashDetail::Triangles {
            let places = [self.sides[0].tree.prim_place(&a.rows.hit(i)), self.sides[1].tree.prim_place(&b.rows.hit(j))];
            if let [Some(x), Some(y)] = places {
                let [x, y] = [(self.pair[0].into(), x), (self.pair[1].into(), y)];
                let at = if is_turned { [y, x] } else { [x, y] };
                self.found.met.push(Met { parts, at, relation, points, normal });
                self.found.keep(self.task.options.limit, false);
            }
        }
    }
}
