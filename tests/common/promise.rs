//! The promise of a hit (design, section 6): some original surface lies within its error, and none before `t_free`.

use super::brute::{Oracle, Ray64, Tri};
use super::bvh64::Bvh64;
use super::rays::Ray32;
use super::rounding::{Rounding, Seen, shift};
use glam::DVec3;
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::scene::SceneState;

/// In widths of its cone: so far from original surface a ray is at most where it is not free, of those that passed
/// stand-ins.
const LONG: f64 = 8.0;
/// `t_free` says nothing of surfaces met within 0.9 degrees of edge-on.
const EDGE_ON: f64 = 1.0 / 64.0;

/// What was seen.
#[derive(Default)]
pub struct Tally {
    pub exact: u64,
    pub lod: u64,
    pub missing: u64,
    pub misses: u64,
    /// Of these, such that passed stand-ins.
    pub transmitted: u64,
    /// How far original surface is from where these are not free, in widths of their cones.
    pub apart: f64,
    /// Stated over true error, of stand-ins.
    pub slack: Vec<f64>,
}

/// By how much a hit states more than it is off: its error over the distance of where it is from the nearest surface, a
/// million at most. Where the promise is broken that distance, as far as it was looked for: 1.5 times the error.
pub fn slack(oracle: &Bvh64, position: DVec3, error: f64) -> Result<f64, f64> {
    let truth = oracle.distance(position, error * 1.5);
    if truth <= error { Ok(error / truth.max(error * 1e-6)) } else { Err(truth) }
}

/// A pixel of a picture of some hundred rows, times the pixels of error; some rays have parallel sides.
pub fn with_cone(ray: &Ray32, i: usize, poe: f32, size: f64) -> Ray {
    let wide = ray.wide();
    let length = wide.dir.length();
    let (pixel, root) = (0.7 / 300.0, f64::from(poe).sqrt());
    let cone = match i % 4 {
        0 => Cone { a: (pixel * size * root) as f32, b: 0.0 },
        1 => Cone { a: (pixel * 0.1 * size * root) as f32, b: (pixel * length * root) as f32 },
        _ => Cone { a: 0.0, b: (pixel * length * root) as f32 },
    };
    Ray { t_min: wide.t_min, t_max: wide.t_max, cone, ..Ray::new(wide.org, ray.dir) }
}

fn is_plainly_met(ray: &Ray64, tri: &Tri) -> bool {
    let normal = (tri[1] - tri[0]).cross(tri[2] - tri[0]).normalize_or_zero();
    let cosine = normal.dot(ray.dir.normalize()).abs();
    cosine > EDGE_ON && Seen::new(ray, tri).depth() > shift(ray, tri, Rounding::LOCALISED)
}

impl Tally {
    /// A miss says that it passed a stand-in only if it has a cone, and where it is about the ray there is something:
    /// such cells are long and thin at most. (Of rays that lack what would tell nothing is free.)
    fn judge_passed(&mut self, oracle: &Bvh64, ray: &Ray, hit: &Hit) {
        let width = f64::from(ray.cone.a) + f64::from(ray.cone.b) * hit.t_free;
        assert!(width > 0.0, "a stand-in transmitted {ray:?}");
        if hit.t_free > ray.t_min {
            let at = ray.origin + ray.dir.as_dvec3() * hit.t_free;
            let apart = oracle.distance(at, LONG * width);
            self.apart = self.apart.max(apart / width);
            assert!(apart <= LONG * width, "nothing is near where {ray:?} is not free: {hit:?}");
        }
    }
}

/// Judges a hit against all triangles.
pub fn judge(oracle: &Bvh64, ray: &Ray, hit: &Hit, tally: &mut Tally) {
    let wide = Ray64 { org: ray.origin, dir: ray.dir.as_dvec3(), t_min: ray.t_min, t_max: ray.t_max };
    let free = hit.t_free.min(ray.t_max);
    if free > ray.t_min {
        let before = oracle.all(&wide, free.next_down());
        // Nor of the surface that the ray starts on.
        let start = if hit.kind == HitKind::Exact { hit.t - hit.t_free } else { 1e-5 * (1.0 + ray.origin.length()) };
        let mut before = before.iter().filter(|q| q.t > ray.t_min + start);
        let seen = before.find(|q| is_plainly_met(&wide, &oracle.tris()[q.prim as usize]));
        assert_eq!(seen, None, "a surface before t_free: {ray:?}: {hit:?}");
    }
    match hit.kind {
        HitKind::Miss => {
            tally.misses += 1;
            if hit.t_free < f64::INFINITY {
                tally.transmitted += 1;
                tally.judge_passed(oracle, ray, hit);
            }
        }
        HitKind::Exact => tally.exact += 1,
        HitKind::Lod => tally.lod += 1,
        HitKind::Missing => tally.missing += 1,
    }
    if hit.kind == HitKind::Miss {
        return;
    }
    assert!((ray.t_min..=ray.t_max).contains(&hit.t) && hit.t_free <= hit.t, "{ray:?}: {hit:?}");
    assert!((hit.normal.length() - 1.0).abs() < 1e-4 && hit.normal.dot(ray.dir) <= 1e-4 * ray.dir.length(), "{hit:?}");
    let stated = f64::from(hit.error);
    let slack = slack(oracle, hit.position, stated);
    let slack = slack.unwrap_or_else(|truth| panic!("the surface is {truth} away, not {stated}: {ray:?}: {hit:?}"));
    if hit.kind != HitKind::Exact {
        tally.slack.push(slack);
    }
}

/// The hits of rays, with all members.
pub fn ask(state: &SceneState, rays: &[Ray], coherent: bool, policy: Policy) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    state.closest(rays, QueryOptions { coherent, want: Want::ALL, policy }, &mut hits).expect("hits");
    hits
}
