//! parry3d: its triangle mesh. It has one ray a call, which answers the closest hit; for any hit that is asked too.

use super::Peer;
use crate::rays::Batch;
use crate::scenes::Mesh;
use crate::sides::{Answer, CHUNK, Run, deal};
use outcrop::math::Ray;
use parry3d::math::Vector;
use parry3d::partitioning::BvhNode;
use parry3d::query::{Ray as TheirRay, RayCast};
use parry3d::shape::TriMesh;
use std::sync::Arc;

struct Parry {
    mesh: TriMesh,
    bytes: u64,
}

/// It builds in one thread.
pub fn build(mesh: &Arc<Mesh>, _quality: &str, _threads: usize) -> Option<Box<dyn Peer>> {
    let vertices: Vec<Vector> = mesh.vertices.iter().map(|&[x, y, z]| Vector::new(x, y, z)).collect();
    let built = TriMesh::new(vertices, mesh.triangles.clone()).expect("a mesh of triangles");
    // It tells no bytes. A pair of nodes a leaf, and where the parent of each pair and each leaf are.
    let leaves = mesh.triangles.len();
    let bytes = mesh.bytes() + (leaves * (2 * size_of::<BvhNode>() + 2 * size_of::<usize>())) as u64;
    Some(Box::new(Parry { mesh: built, bytes }))
}

impl Peer for Parry {
    fn version(&self) -> String {
        "parry3d 0.31".into()
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }

    fn calls(&self, _: &Batch) -> Vec<&'static str> {
        vec!["1"]
    }

    fn ready<'a>(&'a self, _: &str, batch: &Batch, rays: &[Ray]) -> Box<dyn Run + 'a> {
        let vector = |v: [f32; 3]| Vector::new(v[0], v[1], v[2]);
        let their = |ray: &Ray| {
            let (from, dir) = (ray.origin.as_vec3().to_array(), ray.dir.to_array());
            (TheirRay::new(vector(from), vector(dir)), (ray.t_max as f32).min(f32::MAX))
        };
        let rays: Vec<(TheirRay, f32)> = rays.iter().map(their).collect();
        let answers = vec![Answer::MISS; rays.len()];
        Box::new(Ready { peer: self, is_any: batch.is_any(), rays, answers })
    }
}

struct Ready<'a> {
    peer: &'a Parry,
    is_any: bool,
    rays: Vec<(TheirRay, f32)>,
    answers: Vec<Answer>,
}

impl Ready<'_> {
    fn trace(mesh: &TriMesh, is_any: bool, (ray, t_max): &(TheirRay, f32), answer: &mut Answer) -> f64 {
        *answer = Answer::MISS;
        if is_any {
            let is_hit = mesh.cast_local_ray(ray, *t_max, false).is_some();
            if is_hit {
                answer.t = 0.0;
            }
            return f64::from(u8::from(is_hit));
        }
        let Some(hit) = mesh.cast_local_ray_and_get_normal(ray, *t_max, false) else { return 0.0 };
        answer.t = f64::from(hit.time_of_impact);
        f64::from(hit.normal.dot(ray.dir).abs())
    }
}

impl Run for Ready<'_> {
    fn prepare(&mut self) {}

    fn run(&mut self, threads: usize) -> f64 {
        let (mesh, is_any) = (&self.peer.mesh, self.is_any);
        let chunks = self.rays.chunks(CHUNK).zip(self.answers.chunks_mut(CHUNK));
        deal(
            threads,
            chunks,
            || (),
            |(), (rays, answers)| {
                rays.iter().zip(answers).map(|(ray, answer)| Self::trace(mesh, is_any, ray, answer)).sum()
            },
        )
    }

    fn answers(&self) -> Vec<Answer> {
        self.answers.clone()
    }
}
