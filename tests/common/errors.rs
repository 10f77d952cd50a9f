//! The errors, defined once.
//!
//! **Hit agreement.** An answer (primitive p at distance t, or a miss) agrees with the oracle when
//!
//! 1. *claim*: the ray passes p, or passes it by at most [`shift`]; t is within [`Seen::t_bound`] of where the
//!    ray meets p's plane (no farther than p's corners reach), and inside the ray's range;
//! 2. *nothing lost*: every primitive q that the ray meets nearer than t by more than q's own bound (and p's, if t
//!    was worked out again after the choice) is
//!    grazed: it is entered no deeper than [`shift`], or met no farther than its bound from an end of the
//!    ray's range;
//! 3. *no crack*: where a grazed q was lost, the mesh around the ray must be able to lose it. The patch of
//!    q is every triangle within [`shift`] of the ray that is joined to q by shared edges within
//!    [`shift`]. If no border of the patch (edge used an odd number of times) comes that near, then the number of
//!    layers of the patch over the ray is odd or even whatever the rounding of shared corners does
//!    (a winding number does not change while its curve stays away); if it is odd, some triangle
//!    of the patch must be hit, and a loss is a crack;
//! 4. *lowest twin*: no primitive with the same corners in the same order has a lower id than p.
//!
//! Agreement is then [`Verdict::Same`] (the oracle's primitive), [`Verdict::Tied`] (another as near, within both
//! bounds) or [`Verdict::Grazing`] with its reason; everything else is [`Verdict::Wrong`].
//!
//! **Distance error.** |t - t of the same primitive in f64| * |dir|, world units; also relative to the bound of 1.
//! **Stated error.** Distance of the hit point to p, which must not exceed the answer's own `error`.
//! **Normal error.** Angle to p's f64 normal, turned to the ray's origin, radians; relative to [`normal_bound`].
//! **Part error.** The part is p's part or it is not.

use super::brute::{Hit64, Oracle, Ray64, Tri, meet_line};
use super::rounding::{Rounding, Seen, U, point_distance, shift};
use glam::DVec3;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;

/// What the code under test said of a hit.
#[derive(Debug, Clone, Copy)]
pub struct Answer {
    pub t: f64,
    pub prim: u32,
    /// Its own statement of the error in world units, if it makes one.
    pub stated: Option<f64>,
    /// Its normal, if asked for.
    pub normal: Option<DVec3>,
    /// Whether its part is the primitive's.
    pub part_right: bool,
    /// Whether `t` was worked out again in double precision, so that another was compared when the hit was chosen.
    pub refined: bool,
}

impl Answer {
    /// Just a distance and a primitive.
    pub fn new(t: f64, prim: u32) -> Self {
        Self { t, prim, stated: None, normal: None, part_right: true, refined: false }
    }
}

/// Why an answer that differs is right all the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Graze {
    /// At a fold or silhouette: an even number of layers, all within the rounding of an edge.
    Silhouette,
    /// At an edge without a neighbour (a border, or corners of one side inside edges of the other).
    OpenEdge,
    /// At an end of the ray's range.
    Range,
    /// Hit although it passes by, within the rounding of an edge.
    Outside,
}

/// Why an answer is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Wrong {
    /// The primitive is nowhere near the ray.
    Phantom,
    /// The distance is off by more than the bound, or not a number, or outside the ray's range.
    Distance,
    /// A nearer primitive was entered deeply and lost.
    Lost,
    /// A closed mesh let the ray through at an edge.
    Crack,
    /// A twin of the primitive has a lower id.
    HigherTwin,
    /// The answer's own `error` is smaller than its error.
    Understated,
    /// The normal is off by more than the bound.
    Normal,
    /// The part is not the primitive's.
    Part,
    /// No such primitive.
    NoSuchPrim,
}

/// The judgement of one answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Verdict {
    Same,
    Tied,
    Grazing(Graze),
    Wrong(Wrong),
}

/// The judgement with its figures.
#[derive(Debug, Clone, Copy)]
pub struct Ruling {
    pub verdict: Verdict,
    /// Distance error in world units.
    pub distance: f64,
    /// The same relative to its bound.
    pub distance_rel: f64,
    /// Distance of the hit point to the primitive, relative to the stated error.
    pub stated_rel: f64,
    /// Normal error in radians relative to its bound.
    pub normal_rel: f64,
}

impl Ruling {
    fn of(verdict: Verdict) -> Self {
        Self { verdict, distance: 0.0, distance_rel: 0.0, stated_rel: 0.0, normal_rel: 0.0 }
    }
}

/// Greatest angle between the normal from f32 edges and the true one. Edges are rounded (u each coordinate),
/// the cross product's products and differences (3 u |e1| |e2|), then the quotient by its length (4 u);
/// a world transform rounds both factors again (6 u).
pub fn normal_bound(tri: &Tri) -> f64 {
    let (e1, e2) = (tri[1] - tri[0], tri[2] - tri[0]);
    let area2 = e1.cross(e2).length();
    (2.0 * 1.7321 + 3.0 + 6.0) * U * e1.length() * e2.length() / area2 + 4.0 * U
}

fn corner_bits(v: DVec3) -> [u64; 3] {
    // Adding zero turns -0 into 0.
    [v.x + 0.0, v.y + 0.0, v.z + 0.0].map(f64::to_bits)
}

type EdgeKey = [[u64; 3]; 2];

fn edge_key(tri: &Tri, i: usize) -> EdgeKey {
    let mut key = [corner_bits(tri[i]), corner_bits(tri[(i + 1) % 3])];
    key.sort_unstable();
    key
}

/// Judges answers over one set of triangles.
pub struct Judge<'a> {
    oracle: &'a dyn Oracle,
    /// The lowest primitive with the same corners in the same order.
    lowest_twin: Vec<u32>,
    rounding: Rounding,
    /// Least and greatest corner.
    bounds: [DVec3; 2],
}

impl<'a> Judge<'a> {
    pub fn new(oracle: &'a dyn Oracle, rounding: Rounding) -> Self {
        let mut seen = HashMap::new();
        let lowest_twin =
            (0u32..).zip(oracle.tris()).map(|(i, tri)| *seen.entry(tri.map(corner_bits)).or_insert(i)).collect();
        let bounds = oracle
            .tris()
            .iter()
            .flatten()
            .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[lo, hi], v| [lo.min(*v), hi.max(*v)]);
        Self { oracle, lowest_twin, rounding, bounds }
    }

    /// Judges a closest hit, given the oracle's own (from any oracle over the same triangles).
    pub fn closest(&self, ray: &Ray64, truth: Option<Hit64>, got: Option<Answer>) -> Ruling {
        let Some(a) = got else {
            return Ruling::of(match self.lost(ray, f64::INFINITY, None) {
                Err(wrong) => Verdict::Wrong(wrong),
                Ok(Some(graze)) => Verdict::Grazing(graze),
                Ok(None) => Verdict::Same,
            });
        };
        let mut ruling = match self.claim(ray, &a) {
            Err(wrong) => return Ruling::of(Verdict::Wrong(wrong)),
            Ok(ruling) => ruling,
        };
        if ruling.verdict == Verdict::Same && truth.is_some_and(|o| o.prim == a.prim) {
            return ruling;
        }
        // What the choice was made by may have been this much nearer.
        let chosen_at = if a.refined { a.t - self.t_bound(ray, a.prim) } else { a.t };
        ruling.verdict = match self.lost(ray, chosen_at, Some(a.prim)) {
            Err(wrong) => Verdict::Wrong(wrong),
            Ok(Some(graze)) => Verdict::Grazing(graze),
            Ok(None) if ruling.verdict == Verdict::Same || truth.is_some_and(|o| self.as_near(ray, &a, &o)) => {
                Verdict::Tied
            }
            Ok(None) => ruling.verdict,
        };
        ruling
    }

    /// Whether the oracle's hit is as near as the answer, within both bounds.
    fn as_near(&self, ray: &Ray64, a: &Answer, truth: &Hit64) -> bool {
        (a.t - truth.t).abs() <= self.t_bound(ray, a.prim) + self.t_bound(ray, truth.prim)
    }

    fn t_bound(&self, ray: &Ray64, prim: u32) -> f64 {
        let tri = &self.oracle.tris()[prim as usize];
        Seen::new(ray, tri).t_bound(shift(ray, tri, self.rounding))
    }

    /// Judges an any-hit answer, given the oracle's own.
    pub fn any(&self, ray: &Ray64, truth: bool, got: bool) -> Verdict {
        if got == truth {
            return Verdict::Same;
        }
        if got {
            return if self.something_near(ray) {
                Verdict::Grazing(Graze::Outside)
            } else {
                Verdict::Wrong(Wrong::Phantom)
            };
        }
        match self.lost(ray, f64::INFINITY, None) {
            Err(wrong) => Verdict::Wrong(wrong),
            Ok(Some(graze)) => Verdict::Grazing(graze),
            Ok(None) => Verdict::Same,
        }
    }

    /// Point 1 and 4, and the figures. `Same` here means: the ray truly meets the primitive.
    fn claim(&self, ray: &Ray64, a: &Answer) -> Result<Ruling, Wrong> {
        let tri = self.oracle.tris().get(a.prim as usize).ok_or(Wrong::NoSuchPrim)?;
        let seen = Seen::new(ray, tri);
        let moved = shift(ray, tri, self.rounding);
        let exact = meet_line(ray, tri).map(|(t, ..)| t);
        if exact.is_none() && (seen.depth() < -moved || seen.depth().is_nan()) {
            return Err(Wrong::Phantom);
        }
        let (lo, hi) = seen.t_range();
        let bound = seen.t_bound(moved);
        // In the plane of an edge-on triangle every depth is as true as any other.
        let plane = exact.unwrap_or_else(|| plane_t(ray, tri)).clamp(lo, hi);
        let off = (a.t - if plane.is_nan() { a.t.clamp(lo, hi) } else { plane }).abs();
        if !(off <= bound && a.t >= ray.t_min && a.t <= ray.t_max) {
            return Err(Wrong::Distance);
        }
        if self.lowest_twin[a.prim as usize] != a.prim {
            return Err(Wrong::HigherTwin);
        }
        let in_range = |t: f64| t >= ray.t_min && t <= ray.t_max;
        let verdict = match exact {
            Some(t) if in_range(t) => Verdict::Same,
            Some(_) => Verdict::Grazing(Graze::Range),
            None => Verdict::Grazing(Graze::Outside),
        };
        let mut ruling = Ruling::of(verdict);
        ruling.distance = off / seen.t_per_unit;
        ruling.distance_rel = off / bound;
        self.attributes(ray, tri, a, &mut ruling)?;
        Ok(ruling)
    }

    fn attributes(&self, ray: &Ray64, tri: &Tri, a: &Answer, ruling: &mut Ruling) -> Result<(), Wrong> {
        if let Some(stated) = a.stated {
            let away = point_distance(ray.at(a.t), tri);
            ruling.stated_rel = if away == 0.0 { 0.0 } else { away / stated };
            if ruling.stated_rel > 1.0 || ruling.stated_rel.is_nan() {
                return Err(Wrong::Understated);
            }
        }
        if let Some(normal) = a.normal {
            let n = (tri[1] - tri[0]).cross(tri[2] - tri[0]).normalize();
            let facing = if n.dot(ray.dir) > 0.0 { -n } else { n };
            // Edge-on, either side may be the one that faces the origin.
            let edge_on = n.dot(ray.dir.normalize()).abs() < normal_bound(tri) + 4.0 * U;
            let angle = normal.cross(facing).length().atan2(normal.dot(facing));
            let angle = if edge_on { angle.min(std::f64::consts::PI - angle) } else { angle };
            ruling.normal_rel = angle / normal_bound(tri);
            if !(ruling.normal_rel <= 1.0 || normal_bound(tri) > 1.0) || (normal.length() - 1.0).abs() > 1e-5 {
                return Err(Wrong::Normal);
            }
        }
        if a.part_right { Ok(()) } else { Err(Wrong::Part) }
    }

    /// Points 2 and 3: whether anything nearer than `limit` was lost, and why that is allowed.
    fn lost(&self, ray: &Ray64, limit: f64, answer: Option<u32>) -> Result<Option<Graze>, Wrong> {
        let mut reason = None;
        for q in self.oracle.all(ray, limit) {
            let tri = &self.oracle.tris()[q.prim as usize];
            let seen = Seen::new(ray, tri);
            let moved = shift(ray, tri, self.rounding);
            let bound = seen.t_bound(moved);
            if q.t + bound >= limit || Some(q.prim) == answer {
                continue;
            }
            reason = Some(if q.t - ray.t_min <= bound || ray.t_max - q.t <= bound {
                Graze::Range
            } else if seen.depth() > moved {
                return Err(Wrong::Lost);
            } else {
                self.patch_reason(ray, limit, q.prim, answer)?
            });
        }
        Ok(reason)
    }

    fn patch_reason(&self, ray: &Ray64, limit: f64, lost: u32, answer: Option<u32>) -> Result<Graze, Wrong> {
        let patch = Patch::around(self.oracle, ray, lost, self.widest_shift(ray));
        if patch.border_near {
            return Ok(Graze::OpenEdge);
        }
        let reached = answer.is_some_and(|p| patch.holds(self.oracle.tris(), p));
        let whole = patch.t.0 > ray.t_min && patch.t.1 < ray.t_max;
        // A patch that reaches behind the answer may be hit there.
        if patch.odd && !reached && whole && patch.t.1 < limit {
            return Err(Wrong::Crack);
        }
        Ok(if whole { Graze::Silhouette } else { Graze::Range })
    }

    /// No corner may have moved farther than this.
    pub fn widest_shift(&self, ray: &Ray64) -> f64 {
        let [min, max] = self.bounds;
        shift(ray, &[min, max, max], self.rounding)
    }

    fn something_near(&self, ray: &Ray64) -> bool {
        let eps = self.widest_shift(ray);
        let mut found = false;
        self.oracle.near_line(ray, eps, &mut |_, tri| {
            let seen = Seen::new(ray, tri);
            let moved = shift(ray, tri, self.rounding);
            let (lo, hi) = seen.t_range();
            let bound = seen.t_bound(moved);
            found |= seen.depth() >= -moved && hi + bound >= ray.t_min && lo - bound <= ray.t_max;
        });
        found
    }
}

/// Where the ray meets the triangle's plane, however far outside.
fn plane_t(ray: &Ray64, tri: &Tri) -> f64 {
    let n = (tri[1] - tri[0]).cross(tri[2] - tri[0]);
    n.dot(tri[0] - ray.org) / n.dot(ray.dir)
}

/// The triangles around a ray that are joined to a lost one; see point 3 of the module.
struct Patch {
    tris: HashSet<[[u64; 3]; 3]>,
    border_near: bool,
    odd: bool,
    /// Range of `t` over all corners.
    t: (f64, f64),
}

fn sorted_corners(tri: &Tri) -> [[u64; 3]; 3] {
    let mut c = tri.map(corner_bits);
    c.sort_unstable();
    c
}

impl Patch {
    fn holds(&self, tris: &[Tri], prim: u32) -> bool {
        self.tris.contains(&sorted_corners(&tris[prim as usize]))
    }

    fn around(oracle: &dyn Oracle, ray: &Ray64, lost: u32, eps: f64) -> Self {
        // Twins and turned twins once.
        let mut near: HashMap<[[u64; 3]; 3], (Tri, Seen)> = HashMap::new();
        oracle.near_line(ray, eps, &mut |_, tri| {
            let seen = Seen::new(ray, tri);
            if seen.depth() >= -eps {
                near.insert(sorted_corners(tri), (*tri, seen));
            }
        });
        let mut users: HashMap<EdgeKey, Vec<[[u64; 3]; 3]>> = HashMap::new();
        for (key, (tri, _)) in &near {
            for i in 0..3 {
                users.entry(edge_key(tri, i)).or_default().push(*key);
            }
        }
        let mut patch = HashSet::from([sorted_corners(&oracle.tris()[lost as usize])]);
        let mut todo: Vec<_> = patch.iter().copied().collect();
        while let Some(key) = todo.pop() {
            let Some((tri, seen)) = near.get(&key) else { continue };
            for i in (0..3).filter(|&i| seen.edge_distance(i) <= eps) {
                for &next in &users[&edge_key(tri, i)] {
                    if patch.insert(next) {
                        todo.push(next);
                    }
                }
            }
        }
        Self::measure(&near, patch, eps)
    }

    fn measure(near: &HashMap<[[u64; 3]; 3], (Tri, Seen)>, tris: HashSet<[[u64; 3]; 3]>, eps: f64) -> Self {
        let mut edges: HashMap<EdgeKey, (u32, f64, bool)> = HashMap::new();
        let mut t = (f64::INFINITY, f64::NEG_INFINITY);
        for (tri, seen) in tris.iter().filter_map(|k| near.get(k)) {
            let (lo, hi) = seen.t_range();
            t = (t.0.min(lo), t.1.max(hi));
            for i in 0..3 {
                let (a, b) = (seen.p[i], seen.p[(i + 1) % 3]);
                let crosses = (a.y > 0.0) != (b.y > 0.0) && a.x + (b.x - a.x) * (-a.y / (b.y - a.y)) > 0.0;
                edges.entry(edge_key(tri, i)).or_insert((0, seen.edge_distance(i), crosses)).0 += 1;
            }
        }
        let border = || edges.values().filter(|e| e.0 % 2 == 1);
        let border_near = border().any(|e| e.1 <= eps);
        let odd = border().filter(|e| e.2).count() % 2 == 1;
        Self { tris, border_near, odd, t }
    }
}

/// Rulings of many answers, by a label (the kind of ray): prints, and asserts that none is wrong.
#[derive(Debug, Clone, Default)]
pub struct Summary {
    counts: BTreeMap<(&'static str, Verdict), u64>,
    examples: Vec<String>,
    distance: f64,
    distance_rel: f64,
    stated_rel: f64,
    normal_rel: f64,
    total: u64,
}

impl Summary {
    /// Adds one ruling; `describe` is only called for the first wrong ones.
    pub fn add(&mut self, label: &'static str, ruling: &Ruling, describe: impl FnOnce() -> String) {
        self.total += 1;
        *self.counts.entry((label, ruling.verdict)).or_default() += 1;
        self.distance = self.distance.max(ruling.distance);
        self.distance_rel = self.distance_rel.max(ruling.distance_rel);
        self.stated_rel = self.stated_rel.max(ruling.stated_rel);
        self.normal_rel = self.normal_rel.max(ruling.normal_rel);
        if let Verdict::Wrong(why) = ruling.verdict
            && self.examples.len() < 5
        {
            self.examples.push(format!("{label}, {why:?}: {}", describe()));
        }
    }

    /// Adds a bare verdict.
    pub fn add_verdict(&mut self, label: &'static str, verdict: Verdict, describe: impl FnOnce() -> String) {
        self.add(label, &Ruling::of(verdict), describe);
    }

    /// Adds another summary (of another thread).
    pub fn merge(&mut self, o: Summary) {
        for (k, n) in o.counts {
            *self.counts.entry(k).or_default() += n;
        }
        self.examples.extend(o.examples);
        self.examples.truncate(5);
        self.distance = self.distance.max(o.distance);
        self.distance_rel = self.distance_rel.max(o.distance_rel);
        self.stated_rel = self.stated_rel.max(o.stated_rel);
        self.normal_rel = self.normal_rel.max(o.normal_rel);
        self.total += o.total;
    }

    /// How many answers got a verdict that `pick` accepts.
    pub fn count(&self, pick: impl Fn(Verdict) -> bool) -> u64 {
        self.counts.iter().filter(|((_, v), _)| pick(*v)).map(|(_, n)| n).sum()
    }

    /// How many answers were judged.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Prints, and panics if any answer was wrong or nothing was judged.
    pub fn assert_clean(&self, name: &str) {
        println!("{name}: {self}");
        let wrong = self.count(|v| matches!(v, Verdict::Wrong(_)));
        assert!(
            wrong == 0,
            "{name}: {wrong} of {} answers are wrong\n{}\n{self}",
            self.total,
            self.examples.join("\n")
        );
        assert!(self.total > 0, "{name}: nothing was judged");
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of = |pick: &dyn Fn(Verdict) -> bool| self.count(pick);
        write!(
            f,
            "{} answers, {} same, {} tied, {} grazing; distance error <= {:.3e} ({:.3} of the bound), \
             of the stated error {:.3}, of the normal's bound {:.3}",
            self.total,
            of(&|v| v == Verdict::Same),
            of(&|v| v == Verdict::Tied),
            of(&|v| matches!(v, Verdict::Grazing(_))),
            self.distance,
            self.distance_rel,
            self.stated_rel,
            self.normal_rel
        )?;
        for ((label, verdict), n) in self.counts.iter().filter(|((_, v), _)| *v != Verdict::Same) {
            write!(f, "\n    {label}: {n} {verdict:?}")?;
        }
        Ok(())
    }
}
