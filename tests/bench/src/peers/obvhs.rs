//! obvhs: its compressed 8-wide tree. It has one ray a call, and chooses its vector instructions when it is compiled.

use super::Peer;
use crate::rays::Batch;
use crate::scenes::Mesh;
use crate::sides::{Answer, CHUNK, Run, deal};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray as TheirRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use outcrop::math::Ray;
use std::sync::Arc;
use std::time::Duration;

struct Obvhs {
    tree: CwBvh,
    /// In the order of the leaves, so that no index is looked up.
    triangles: Vec<RtTriangle>,
}

/// It builds in one thread: its parallel build is a feature that changes how it sorts.
pub fn build(mesh: &Arc<Mesh>, quality: &str, _threads: usize) -> Option<Box<dyn Peer>> {
    let corner = |i: u32| mesh.vertices[i as usize].into();
    let triangle = |t: &[u32; 3]| Triangle { v0: corner(t[0]), v1: corner(t[1]), v2: corner(t[2]) };
    let triangles: Vec<Triangle> = mesh.triangles.iter().map(triangle).collect();
    let params = match quality {
        "fast" => BvhBuildParams::fast_build(),
        "slow" => BvhBuildParams { pre_split: true, ..BvhBuildParams::slow_build() },
        _ => BvhBuildParams::medium_build(),
    };
    let tree = build_cwbvh_from_tris(&triangles, params, &mut Duration::default());
    let triangles = tree.primitive_indices.iter().map(|&i| RtTriangle::from(&triangles[i as usize])).collect();
    Some(Box::new(Obvhs { tree, triangles }))
}

impl Peer for Obvhs {
    fn version(&self) -> String {
        "obvhs 0.4".into()
    }

    fn bytes(&self) -> u64 {
        let triangles = size_of_val(self.triangles.as_slice());
        (self.tree.nodes.len() * size_of::<obvhs::cwbvh::node::CwBvhNode>() + triangles) as u64
    }

    fn calls(&self, _: &Batch) -> Vec<&'static str> {
        vec!["1"]
    }

    fn ready<'a>(&'a self, _: &str, batch: &Batch, rays: &[Ray]) -> Box<dyn Run + 'a> {
        let their = |ray: &Ray| {
            let (from, dir) = (ray.origin.as_vec3().to_array(), ray.dir.to_array());
            TheirRay::new(from.into(), dir.into(), ray.t_min as f32, (ray.t_max as f32).min(f32::MAX))
        };
        let rays: Vec<TheirRay> = rays.iter().map(their).collect();
        let answers = vec![Answer::MISS; rays.len()];
        Box::new(Ready { peer: self, is_any: batch.is_any(), rays, answers })
    }
}

struct Ready<'a> {
    peer: &'a Obvhs,
    is_any: bool,
    rays: Vec<TheirRay>,
    answers: Vec<Answer>,
}

impl Ready<'_> {
    fn trace(peer: &Obvhs, is_any: bool, ray: &TheirRay, answer: &mut Answer) -> f64 {
        *answer = Answer::MISS;
        if is_any {
            let missed = peer.tree.ray_traverse_miss(*ray, |ray, i| peer.triangles[i].intersect(ray));
            if !missed {
                answer.t = 0.0;
            }
            return f64::from(u8::from(!missed));
        }
        let mut hit = RayHit::none();
        if !peer.tree.ray_traverse(*ray, &mut hit, |ray, i| peer.triangles[i].intersect(ray)) {
            return 0.0;
        }
        answer.t = f64::from(hit.t);
        let normal = peer.triangles[hit.primitive_id as usize].compute_normal();
        f64::from(normal.dot(ray.direction).abs())
    }
}

impl Run for Ready<'_> {
    fn prepare(&mut self) {}

    fn run(&mut self, threads: usize) -> f64 {
        let (peer, is_any) = (self.peer, self.is_any);
        let chunks = self.rays.chunks(CHUNK).zip(self.answers.chunks_mut(CHUNK));
        deal(
            threads,
            chunks,
            || (),
            |(), (rays, answers)| {
                rays.iter().zip(answers).map(|(ray, answer)| Self::trace(peer, is_any, ray, answer)).sum()
            },
        )
    }

    fn answers(&self) -> Vec<Answer> {
        self.answers.clone()
    }
}
