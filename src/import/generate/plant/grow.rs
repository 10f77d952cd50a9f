//! Growth: stems on stems, level by level, and the places of leaves. One mechanism serves all species; the rows of
//! [`super::species`] make the difference.

use super::super::rng::Rng;
use super::super::turn::sin_cos;
use super::species::{Branching, Leaf, Phyllotaxis, Species};
use glam::DVec3;

/// Number of triangles at which the numbers of the table hold.
const NOMINAL: f64 = 25_000.0;
/// Largest share of the triangles for the stems below the last level, and for all stems of a species with leaves.
const SHARES: [f64; 2] = [0.5, 0.7];
/// Stems with less lift hang down, whatever their first direction.
const HANGING: f64 = -1.5;
/// Stream of random numbers of the trunks; those of their descendants follow from it.
const ROOT: u64 = 0x9_1a27;

/// A point of a stem's axis with a frame, and the radius there.
#[derive(Debug, Clone, Copy)]
pub struct Station {
    /// The point.
    pub at: DVec3,
    /// Unit vector along the axis.
    pub dir: DVec3,
    /// Unit vector across the axis.
    pub side: DVec3,
    /// Radius; 0 at the tip.
    pub radius: f64,
}

/// A trunk, branch or twig.
#[derive(Debug, Clone)]
pub struct Stem {
    /// Axis from the base to the tip, of at least two stations.
    pub axis: Vec<Station>,
    /// Length in metres.
    pub length: f64,
    /// Seed of its own random numbers.
    key: u64,
}

/// The place where a stem or leaf is attached to its parent.
#[derive(Debug, Clone, Copy)]
pub struct Joint {
    /// Point on the parent's axis.
    pub at: DVec3,
    /// Initial direction.
    pub dir: DVec3,
    /// Radius of the parent there.
    pub radius: f64,
    /// Position within the attached range of the parent, from 0 to 1.
    pub place: f64,
}

/// A plant without surfaces.
pub struct Plant<'a> {
    /// Its species.
    pub species: &'a Species,
    /// Stems by level; the last level has the leaves.
    pub levels: Vec<Vec<Stem>>,
    /// Sides of the stems of each level.
    pub sides: Vec<u32>,
    /// Number of leaves of each stem of the last level.
    pub leaves: Vec<u64>,
    /// Factors to length and width of leaves, which keep their total area about equal at any number of them.
    pub leaf_scale: [f64; 2],
}

impl<'a> Plant<'a> {
    /// Grows a plant of about `height` metres and of `triangles` triangles, with the random numbers of `seed`.
    pub fn grow(species: &'a Species, height: f64, triangles: u64, seed: u64) -> Self {
        let detail = Detail::new(triangles);
        let mut plant = Self {
            species,
            levels: Vec::new(),
            sides: species.stems.iter().map(|b| detail.sides(b)).collect(),
            leaves: Vec::new(),
            leaf_scale: species.leaf.as_ref().map_or([1.0; 2], |leaf| detail.leaf_scale(leaf)),
        };
        let (mut used, mut nominal) = (0, 1.0);
        for (level, branching) in species.stems.iter().enumerate() {
            let cost = tube_triangles(plant.sides[level], detail.segments(branching));
            let parents = plant.levels.last();
            nominal *= branching.count;
            let wanted = nominal * detail.power(branching.growth);
            let is_last = level + 1 == species.stems.len();
            let share = SHARES[usize::from(is_last)];
            let count = if is_last && species.leaf.is_none() {
                triangles.saturating_sub(used) / cost
            } else {
                let room = (share * triangles as f64) as u64;
                (wanted.round() as u64).min(room.saturating_sub(used) / cost)
            };
            let count = count.max(1);
            used += count * cost;
            let segments = detail.segments(branching);
            let stems = match parents {
                None => trunks(species, branching, segments, height, count, seed),
                Some(parents) => children(parents, branching, segments, height, count),
            };
            plant.levels.push(stems);
        }
        if let (Some(leaf), Some(twigs)) = (&species.leaf, plant.levels.last()) {
            plant.leaves = shares(twigs, triangles.saturating_sub(used) / leaf.triangles());
        }
        plant
    }
}

/// Returns the number of triangles of a closed tube that ends in a point.
pub fn tube_triangles(sides: u32, segments: u32) -> u64 {
    u64::from((segments - 1) * 2 * sides + sides + (sides - 2))
}

/// The level of detail, from the number of triangles.
struct Detail {
    /// Fourth root of the number of triangles over the nominal one.
    quarter: f64,
}

impl Detail {
    fn new(triangles: u64) -> Self {
        Self { quarter: (triangles as f64 / NOMINAL).sqrt().sqrt() }
    }

    /// Returns the detail to the power of `quarters` / 4.
    fn power(&self, quarters: u32) -> f64 {
        (0..quarters).fold(1.0, |product, _| product * self.quarter)
    }

    fn sides(&self, branching: &Branching) -> u32 {
        ((f64::from(branching.sides) * self.quarter).round() as u32).clamp(3, 32)
    }

    fn segments(&self, branching: &Branching) -> u32 {
        let scaled = ((f64::from(branching.segments) * self.quarter).round() as u32).max(2);
        // A knot is a pair of segments.
        if branching.knots > 0.0 { scaled.next_multiple_of(2) } else { scaled }
    }

    /// Fronds and blades keep their length; only their width changes.
    fn leaf_scale(&self, leaf: &Leaf) -> [f64; 2] {
        let half = (1.0 / self.power(2)).clamp(0.3, 2.0);
        if leaf.stations > 1 { [1.0, half * half.max(0.7)] } else { [half, half] }
    }
}

/// Divides `total` among the stems in proportion to their length.
fn shares(stems: &[Stem], total: u64) -> Vec<u64> {
    let sum: f64 = stems.iter().map(|s| s.length).sum();
    let (mut before, mut given) = (0.0, 0);
    let last = stems.len().saturating_sub(1);
    let share = |(i, stem): (usize, &Stem)| {
        before += stem.length;
        let upto = if i == last { total } else { ((total as f64 * before / sum) as u64).min(total) };
        let own = upto - given;
        given = upto;
        own
    };
    stems.iter().enumerate().map(share).collect()
}

/// Grows the trunks: upright if there is one, else spread over a disc and leaning outward.
fn trunks(species: &Species, branching: &Branching, segments: u32, height: f64, count: u64, seed: u64) -> Vec<Stem> {
    let mut rng = Rng::stream(seed, ROOT);
    let mut trunk = |i: u64| {
        let out = if count == 1 { 0.0 } else { ((i as f64 + 0.5) / count as f64).sqrt() };
        let (s, c) = sin_cos(i as f64 * 137.507_764 + rng.range(-15.0, 15.0));
        let lean = sin_cos(species.lean * (out + rng.range(0.0, 0.3)));
        let away = DVec3::new(c, s, 0.0);
        let joint = Joint {
            at: away * (out * species.spread * height),
            dir: away * lean.0 + DVec3::Z * lean.1,
            radius: height,
            place: out,
        };
        stem(branching, segments, height, &joint, height, rng.next())
    };
    (0..count).map(&mut trunk).collect()
}

/// Grows `count` stems on the parents.
fn children(parents: &[Stem], branching: &Branching, segments: u32, height: f64, count: u64) -> Vec<Stem> {
    let mut all = Vec::with_capacity(count as usize);
    for (parent, share) in parents.iter().zip(shares(parents, count)) {
        parent.attach(&branching.at, share, |joint, rng| {
            all.push(stem(branching, segments, parent.length, joint, height, rng.next()));
        });
    }
    all
}

impl Stem {
    /// Calls `each` with `count` joints on the stem and the random numbers to use for them.
    pub fn attach(&self, at: &Phyllotaxis, count: u64, mut each: impl FnMut(&Joint, &mut Rng)) {
        let mut rng = Rng::stream(self.key, count);
        let whorl = u64::from(at.whorl);
        let nodes = count.div_ceil(whorl) as f64;
        // Two rows are level, to both sides of the stem. Other arrangements begin anywhere.
        let first = if at.turn == 180.0 { 0.0 } else { rng.range(0.0, 360.0) };
        for i in 0..count {
            let (node, member) = ((i / whorl) as f64, (i % whorl) as f64);
            let place = ((node + 0.5 + rng.range(-0.4, 0.4)) / nodes).clamp(0.0, 1.0);
            let azimuth = first + at.turn * node + 360.0 / whorl as f64 * member + rng.range(-1.0, 1.0) * at.jitter;
            let angle = at.angle[0] + (at.angle[1] - at.angle[0]) * place + rng.range(-0.5, 0.5) * at.jitter;
            let here = self.station(at.from + (at.to - at.from) * place);
            let ((sa, ca), (s, c)) = (sin_cos(azimuth), sin_cos(angle));
            let away = here.side * ca + here.dir.cross(here.side) * sa;
            let joint = Joint { at: here.at, dir: here.dir * c + away * s, radius: here.radius, place };
            each(&joint, &mut rng);
        }
    }

    /// Returns the station at a fraction of the length.
    fn station(&self, t: f64) -> Station {
        let last = self.axis.len() - 1;
        let scaled = t * last as f64;
        let i = (scaled as usize).min(last - 1);
        let (a, b, w) = (&self.axis[i], &self.axis[i + 1], scaled - i as f64);
        let dir = a.dir.lerp(b.dir, w).normalize_or(a.dir);
        Station { at: a.at.lerp(b.at, w), dir, side: across(a.side, dir), radius: a.radius + (b.radius - a.radius) * w }
    }
}

/// Returns the part of `side` across the unit vector `dir`, of length 1.
pub fn across(side: DVec3, dir: DVec3) -> DVec3 {
    let rest = side - dir * side.dot(dir);
    if rest.length_squared() > 1e-6 { rest.normalize() } else { dir.any_orthonormal_vector() }
}

/// Returns the level vector across the unit vector `dir`.
pub fn level_across(dir: DVec3) -> DVec3 {
    across(DVec3::new(-dir.y, dir.x, 0.0), dir)
}

/// Returns the value at `t` in [0, 1] of the polyline through four equally spaced values.
fn polyline(values: &[f64; 4], t: f64) -> f64 {
    let scaled = t * 3.0;
    let i = (scaled as usize).min(2);
    values[i] + (values[i + 1] - values[i]) * (scaled - i as f64)
}

/// Grows one stem from a joint. `parent`: length of the parent; `height`: that of the plant.
fn stem(branching: &Branching, segments: u32, parent: f64, joint: &Joint, height: f64, key: u64) -> Stem {
    let mut rng = Rng::new(key);
    let mut length = parent * branching.length * polyline(&branching.shape, joint.place) * rng.range(0.8, 1.15);
    // A stem stays above the ground: what hangs ends there, other stems creep on it.
    let ground = if branching.is_trunk { 0.0 } else { 0.02 * height };
    if branching.lift < HANGING {
        length = length.min((1.1 * (joint.at.z - ground)).max(0.25 * length));
    }
    let thinnest = height / 5000.0;
    let base = (branching.radius * joint.radius).max(thinnest).min(length * 0.2);
    let bend = DVec3::Z * (branching.lift / f64::from(segments));
    let wobble = branching.wobble / f64::from(segments).sqrt();
    let mut dir = joint.dir.normalize_or(DVec3::Z);
    let mut here = Station { at: joint.at, dir, side: level_across(dir), radius: base };
    let mut axis = Vec::with_capacity(segments as usize + 1);
    for i in 0..=segments {
        let t = position(branching, i, segments);
        let aside = here.side * rng.range(-1.0, 1.0) + dir.cross(here.side) * rng.range(-1.0, 1.0);
        let before = dir;
        dir = (dir + bend + aside * wobble).normalize_or(dir);
        let step = length * (position(branching, i + 1, segments) - t);
        if here.at.z + dir.z * step < ground {
            dir = DVec3::new(dir.x, dir.y, 0.0).normalize_or(here.side);
        }
        // Half way between the directions, so that a sharp bend does not flatten the tube.
        here.dir = if i == 0 { dir } else { (before + dir).normalize_or(dir) };
        here.side = across(here.side, here.dir);
        here.radius = if i == segments { 0.0 } else { base * thickness(branching, i, t) };
        axis.push(here);
        here.at += dir * step;
    }
    if branching.is_trunk {
        axis[0].dir = DVec3::Z;
        axis[0].side = across(axis[0].side, DVec3::Z);
    }
    Stem { axis, length, key: rng.next() }
}

/// Returns the place of ring `i` as a fraction of the length. With knots, rings come in pairs: a narrow one just below
/// a wide one.
fn position(branching: &Branching, i: u32, segments: u32) -> f64 {
    let even = if branching.knots > 0.0 && i % 2 == 1 { f64::from(i) + 0.7 } else { f64::from(i) };
    even / f64::from(segments)
}

/// Returns the radius of ring `i`, at `t` of the length, over that of the base.
fn thickness(branching: &Branching, i: u32, t: f64) -> f64 {
    let foot = (1.0 - 9.0 * t).max(0.0);
    let knot = if i.is_multiple_of(2) { branching.knots } else { 0.0 };
    (1.0 - branching.taper * t) * (1.0 + knot) + branching.flare * foot * foot
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight upright stem of 10 m.
    fn upright() -> Stem {
        let station = |z: f64| Station { at: DVec3::Z * z, dir: DVec3::Z, side: DVec3::X, radius: 1.0 - 0.1 * z };
        Stem { axis: vec![station(0.0), station(4.0), station(8.0), station(12.0)], length: 12.0, key: 3 }
    }

    #[test]
    fn angles_of_joints_are_those_of_the_arrangement() {
        for (whorl, turn) in [(1, 137.5), (1, 180.0), (5, 36.0), (2, 90.0)] {
            let at = Phyllotaxis { from: 0.25, to: 0.75, whorl, turn, angle: [100.0, 40.0], jitter: 0.0 };
            let mut joints = Vec::new();
            upright().attach(&at, 60, |joint, _| joints.push(*joint));
            assert_eq!(joints.len(), 60);
            let azimuth = |j: &Joint| j.dir.y.atan2(j.dir.x).to_degrees();
            for (i, j) in joints.iter().enumerate() {
                let t = j.at.z / 12.0;
                assert!((0.25..=0.75).contains(&t) && ((t - 0.25) * 2.0 - j.place).abs() < 1e-12);
                assert!((j.radius - (1.0 - 0.1 * j.at.z)).abs() < 1e-12);
                let angle = j.dir.angle_between(DVec3::Z).to_degrees();
                assert!((angle - (100.0 - 60.0 * j.place)).abs() < 1e-9, "{angle}");
                let (node, member) = (i as u32 / whorl, i as u32 % whorl);
                let expected = f64::from(node) * turn + f64::from(member) * 360.0 / f64::from(whorl);
                let off = (azimuth(j) - azimuth(&joints[0]) - expected).rem_euclid(360.0);
                assert!(off.min(360.0 - off) < 1e-9, "{whorl} {turn} {i}: {off}");
            }
            // Nodes are spread over the range.
            let low = joints.iter().filter(|j| j.place < 0.5).count();
            assert!((25..=35).contains(&low), "{low}");
        }
    }

    #[test]
    fn shares_are_in_proportion_to_length() {
        let stems: Vec<_> = (1..=9).map(|i| Stem { length: f64::from(i), ..upright() }).collect();
        for total in [0, 1, 44, 45, 90, 1_000_003] {
            let shares = shares(&stems, total);
            assert_eq!(shares.iter().sum::<u64>(), total);
            for (stem, share) in stems.iter().zip(shares) {
                let exact = total as f64 * stem.length / 45.0;
                assert!((share as f64 - exact).abs() <= 1.0, "{share} of {exact}");
            }
        }
    }
}
