//! The peers: other ray tracers in this very process, which get the same rays in the same order.

mod embree;
mod embree_calls;
mod obvhs;
mod parry3d;

use crate::rays::Batch;
use crate::scenes::Mesh;
use crate::sides::Run;
use outcrop::math::Ray;
use std::sync::Arc;

/// One way of building a peer's structure.
pub struct Build {
    pub peer: &'static str,
    /// Its quality or preset.
    pub quality: &'static str,
    build: Builder,
}

/// Of a mesh, with a quality and a number of threads, 0 for all.
type Builder = fn(&Arc<Mesh>, &str, usize) -> Option<Box<dyn Peer>>;

impl Build {
    /// Builds with so many threads; `None` after a message where the peer is not on this machine.
    pub fn build(&self, mesh: &Arc<Mesh>, threads: usize) -> Option<Box<dyn Peer>> {
        (self.build)(mesh, self.quality, threads)
    }
}

/// A structure over a mesh.
pub trait Peer {
    /// Its version, for the record.
    fn version(&self) -> String;
    /// Bytes of the structure with the triangles that it traces.
    fn bytes(&self) -> u64;
    /// The ways of asking it about such rays.
    fn calls(&self, batch: &Batch) -> Vec<&'static str>;
    /// Makes rays ready for a call.
    fn ready<'a>(&'a self, call: &str, batch: &Batch, rays: &[Ray]) -> Box<dyn Run + 'a>;
}

/// The ways of building a peer. Tracing tries those that are `for_tracing`, and takes the fastest.
pub fn builds(peer: &str, for_tracing: bool) -> Vec<Build> {
    let embree = |quality| Build { peer: "embree", quality, build: embree::build };
    let obvhs = |quality| Build { peer: "obvhs", quality, build: obvhs::build };
    match (peer, for_tracing) {
        ("embree", true) => vec![embree("medium"), embree("high")],
        ("embree", false) => vec![embree("low"), embree("compact"), embree("medium"), embree("high")],
        ("obvhs", true) => vec![obvhs("medium"), obvhs("slow")],
        ("obvhs", false) => vec![obvhs("fast"), obvhs("medium"), obvhs("slow")],
        ("parry3d", _) => vec![Build { peer: "parry3d", quality: "default", build: parry3d::build }],
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{PEERS, RayKind};
    use crate::sides::Answer;
    use glam::{DVec3, Vec3};

    /// A square at height 0 and one at height 1, and rays from above and from between.
    #[test]
    fn peers_answer_what_is_plain_to_see() {
        let square = |z: f64| {
            let at = |x: f64, y: f64| DVec3::new(x, y, z);
            [[at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)], [at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]]
        };
        let mesh = Arc::new(Mesh::of([square(0.0), square(1.0)].into_iter().flatten().map(|t| (0, t))));
        let ray = |x: f64, z: f64, t_max: f64| Ray { t_max, ..Ray::new(DVec3::new(x, 0.25, z), Vec3::NEG_Z) };
        let rays = vec![ray(0.5, 3.0, 1e9), ray(0.5, 0.75, 1e9), ray(1.5, 3.0, 1e9), ray(0.5, 3.0, 1.5)];
        let mut asked = 0;
        for peer in PEERS {
            for build in builds(peer, true).into_iter().chain(builds(peer, false)) {
                let Some(built) = build.build(&mesh, 1) else { continue };
                assert!(built.bytes() > 0, "{peer}");
                for kind in [RayKind::Primary, RayKind::Bounce, RayKind::Shadow] {
                    let batch = Batch { kind, rays: rays.clone() };
                    for call in built.calls(&batch) {
                        let mut run = built.ready(call, &batch, &rays);
                        // The second run finds what the first has overwritten put back.
                        for _ in 0..2 {
                            run.prepare();
                            let sum = run.run(2);
                            let hits: Vec<f64> = run.answers().iter().map(|a: &Answer| a.t).collect();
                            let far = f64::INFINITY;
                            let wanted = if batch.is_any() { [0.0, 0.0, far, far] } else { [2.0, 0.75, far, far] };
                            assert_eq!(hits, wanted, "{peer} {} {call} {}", build.quality, kind.name());
                            assert!((sum - 2.0).abs() < 1e-5, "{peer} {call}: {sum}");
                        }
                        asked += 1;
                    }
                }
            }
        }
        assert!(asked >= 8, "obvhs and parry3d are always here");
    }
}
