//! Tests of NURBS surfaces: against definitions in doubled precision, closed forms and random samples.

mod bad_input;
mod closed_forms;
pub(crate) use closed_forms::sphere;
mod enclosure;
mod oracle;
mod pieces;
#[path = "../../../../../tests/common/rng.rs"]
#[allow(dead_code)]
pub(crate) mod rng;

use super::{Nurbs, NurbsDesc};
use glam::DVec3;
use rng::Rng;

/// A description that owns its arrays.
#[derive(Clone)]
pub(crate) struct Owned {
    pub degree: [u32; 2],
    pub counts: [u32; 2],
    pub knots: [Vec<f64>; 2],
    pub points: Vec<DVec3>,
    pub weights: Option<Vec<f64>>,
}

impl Owned {
    pub fn desc(&self) -> NurbsDesc<'_> {
        let [knots_u, knots_v] = self.knots.each_ref().map(Vec::as_slice);
        let weights = self.weights.as_deref();
        NurbsDesc { degree: self.degree, counts: self.counts, knots_u, knots_v, points: &self.points, weights }
    }

    pub fn surface(&self) -> Nurbs {
        Nurbs::new(&self.desc()).expect("a surface")
    }

    /// A surface of random degrees, knots with repetitions (up to degree + 1 inside if `is_torn`), and weights.
    pub fn random(rng: &mut Rng, most_degree: usize, is_torn: bool) -> Self {
        let degree = [1 + rng.below(most_degree), 1 + rng.below(most_degree)];
        let counts = degree.map(|p| p + 1 + rng.below(6));
        let knots = [0, 1].map(|axis| random_knots(rng, degree[axis], counts[axis], is_torn));
        let total = counts[0] * counts[1];
        let points = (0..total).map(|_| rng.inside(DVec3::splat(-1.0), DVec3::ONE)).collect();
        let weights = rng.one_in(2).then(|| (0..total).map(|_| rng.between(0.2, 3.0)).collect());
        Self { degree: degree.map(|p| p as u32), counts: counts.map(|n| n as u32), knots, points, weights }
    }
}

fn random_knots(rng: &mut Rng, degree: usize, count: usize, is_torn: bool) -> Vec<f64> {
    let most = degree + usize::from(is_torn);
    let is_clamped = rng.one_in(2);
    let mut knots = Vec::new();
    let mut at = rng.between(-2.0, 2.0);
    while knots.len() < count + degree + 1 {
        let run = if is_clamped && knots.is_empty() { degree + 1 } else { 1 + rng.below(most) * rng.below(2) };
        knots.extend(std::iter::repeat_n(at, run));
        at += rng.between(0.2, 1.0);
    }
    knots.truncate(count + degree + 1);
    if is_clamped {
        let last = knots[count];
        knots[count..].fill(last);
        // A run of equal knots before the end would exceed degree + 1 with it.
        while knots.windows(degree + 2).any(|run| run[0] == run[degree + 1]) {
            let end = knots[count] + 0.5;
            knots[count..].fill(end);
        }
    }
    if knots[degree] < knots[count] { knots } else { random_knots(rng, degree, count, is_torn) }
}

/// A parameter of a domain; often a knot.
pub(crate) fn parameter(rng: &mut Rng, knots: &[f64], [first, last]: [f64; 2]) -> f64 {
    if rng.one_in(4) { knots[rng.below(knots.len())].clamp(first, last) } else { rng.between(first, last) }
}
