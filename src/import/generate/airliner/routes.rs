//! Bundles of cables, and pipes with elbows, along any route.

use super::plan::{Look, Plan};
use super::soup::{Soup, Station};
use glam::DVec3;
use std::f64::consts::TAU;

/// A curve that has a station for each parameter in [0, 1].
pub trait Route: Fn(f64) -> Station + Send + Sync + 'static {}
impl<F: Fn(f64) -> Station + Send + Sync + 'static> Route for F {}

/// Dimensions of a bundle of cables.
#[derive(Debug, Clone, Copy)]
pub struct Bundle {
    /// Number of cables at detail 1.
    pub cables: f64,
    /// Radius of the bundle in metres.
    pub radius: f64,
    /// Length in metres, which determines the number of segments.
    pub length: f64,
}

/// Adds a bundle of cables that wind around each other along `route`; the radius of a cable is 2 to 5 mm.
pub fn cables(plan: &mut Plan, part: u32, bundle: Bundle, route: impl Route) {
    let sides = plan.scaled(5.0, 0.18, 3);
    let segments = plan.scaled(bundle.length * 1.0, 0.15, 1);
    let count = plan.scaled(bundle.cables, 0.55, 1);
    plan.family(part, count, 2 * sides * segments, move |_, soup| {
        let (turn, twist) = (soup.rng.range(0.0, TAU), soup.rng.range(-4.0, 4.0));
        let (out, wave) = (soup.rng.unit().sqrt(), soup.rng.range(1.0, 5.0));
        let thick = soup.rng.range(0.002, 0.005);
        // Begin, end and course of each cable are random.
        let (first, last) = (soup.rng.range(0.0, 0.25), soup.rng.range(0.75, 1.0));
        let path: Vec<DVec3> = (0..=segments)
            .map(|i| {
                let t = first + (last - first) * i as f64 / segments as f64;
                let s = route(t);
                let a = turn + twist * t + 0.3 * (wave * TAU * t).sin();
                let r = bundle.radius * out * (1.0 + 0.35 * (wave * 3.1 * t + turn).cos());
                s.at + (s.u * a.cos() + s.v * a.sin()) * r
            })
            .collect();
        soup.tube(&path, thick, sides);
    });
}

/// Adds parallel pipes along `route`, with radii in the range `radius`. Elbows shift each pipe sideways at intervals.
pub fn pipes(plan: &mut Plan, part: u32, count: f64, radius: (f64, f64), length: f64, route: impl Route) {
    let sides = plan.scaled(8.0, 0.25, 3);
    let legs = plan.scaled(length / 1.5, 0.2, 2);
    let bend = plan.scaled(4.0, 0.25, 1);
    let count = plan.scaled(count, 0.4, 1);
    plan.family(part, count, 2 * sides * legs * (bend + 1), move |i, soup| {
        let thick = soup.rng.range(radius.0, radius.1);
        let lane = (i as f64 - 0.5 * count as f64) * radius.1 * 2.2;
        let path = elbows(soup, legs, bend, lane, radius.1 * 2.5, &route);
        soup.tube(&path, thick, sides);
    });
}

/// Returns the points of a pipe: straight legs, each followed by a bend of `bend` pieces to the next offset.
fn elbows(soup: &mut Soup, legs: u64, bend: u64, lane: f64, step: f64, route: &impl Route) -> Vec<DVec3> {
    let mut place = |_| [lane + soup.rng.range(-step, step), soup.rng.range(-step, step)];
    let offsets: Vec<[f64; 2]> = (0..=legs).map(&mut place).collect();
    let at = |t: f64, [a, b]: [f64; 2]| {
        let s = route(t);
        s.at + s.u * a + s.v * b
    };
    let mut path = vec![at(0.0, offsets[0])];
    for leg in 0..legs {
        let (from, to) = (offsets[leg as usize], offsets[leg as usize + 1]);
        let t = |part: f64| (leg as f64 + part) / legs as f64;
        path.push(at(t(0.8), from));
        for i in 1..=bend {
            let w = i as f64 / bend as f64;
            // Half a cosine wave, smooth at both ends.
            let ease = 0.5 - 0.5 * (w * std::f64::consts::PI).cos();
            let blend = [from[0] + (to[0] - from[0]) * ease, from[1] + (to[1] - from[1]) * ease];
            path.push(at(t(0.8 + 0.2 * w), blend));
        }
    }
    path
}

/// Returns the colour of cable `i`.
pub fn cable_look(i: u64) -> Look {
    [Look::CableOrange, Look::CableYellow, Look::CableBlack, Look::CableYellow][i as usize % 4]
}

/// Returns the colour of pipe `i`.
pub fn pipe_look(i: u64) -> Look {
    [Look::PipeBlue, Look::Aluminium, Look::PipeRed, Look::Aluminium, Look::Titanium][i as usize % 5]
}
