//! The peers: other ray tracers in this very process, which get the same rays in the same order.

pub mod embree;
pub mod embree_calls;
mod obvhs;
mod parry3d;

use crate::placed::Placed;
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
    build_placed: Option<PlacedBuilder>,
}

/// Of a mesh, with a quality and a number of threads, 0 for all.
type Builder = fn(&Arc<Mesh>, &str, usize) -> Option<Box<dyn Peer>>;

/// Of placed meshes, likewise.
type PlacedBuilder = fn(&Placed, &str, usize) -> Option<Box<dyn Peer>>;

impl Build {
    /// Builds with so many threads; `None` after a message where the peer is not on this machine.
    pub fn build(&self, mesh: &Arc<Mesh>, threads: usize) -> Option<Box<dyn Peer>> {
        (self.build)(mesh, self.quality, threads)
    }

    /// Builds a scene of two levels; `None` also for a peer whose scenes of two levels are not bound here.
    pub fn build_placed(&self, placed: &Placed, threads: usize) -> Option<Box<dyn Peer>> {
        self.build_placed.and_then(|build| build(placed, self.quality, threads))
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
    let embree =
        |quality| Build { peer: "embree", quality, build: embree::build, build_placed: Some(embree::build_placed) };
    let obvhs = |quality| Build { peer: "obvhs", quality, build: obvhs::build, build_placed: None };
    match (peer, for_tracing) {
        ("embree", true) => vec![embree("medium"), embree("high")],
        ("embree", false) => vec![embree("low"), embree("compact"), embree("medium"), embree("high")],
        ("obvhs", true) => vec![obvhs("medium"), obvhs("slow")],
        ("obvhs", false) => vec![obvhs("fast"), obvhs("medium"), obvhs("slow")],
        ("parry3d", _) => {
            vec![Build { peer: "parry3d", quality: "default", build: parry3d::build, build_placed: None }]
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{PEERS, PLACING_PEERS, RayKind};
    use crate::placed::Place;
    use crate::sides::Answer;
    use glam::{DAffine3, DVec3, Vec3};

    /// A square at height 0 and one at height 1, and rays from above and from between; as one mesh, and as two
    /// placements of a square that is turned on its side.
    #[test]
    fn peers_answer_what_is_plain_to_see() {
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let square = [[at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)], [at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]];
        let lifted = |z: f64| square.map(|t| t.map(|p| p + z * DVec3::Z));
        let mesh = Arc::new(Mesh::of([lifted(0.0), lifted(1.0)].into_iter().flatten().map(|t| (0, t))));
        let turn = DAffine3::from_rotation_x(1.0);
        let turned = Mesh::of(square.into_iter().map(|t| (0, t.map(|p| turn.transform_point3(p)))));
        let place =
            |z: f64| Place { mesh: 0, world_from_mesh: DAffine3::from_translation(z * DVec3::Z) * turn.inverse() };
        let placed = Placed { meshes: vec![Arc::new(turned)], places: vec![place(0.0), place(1.0)] };
        let ray = |x: f64, z: f64, t_max: f64| Ray { t_max, ..Ray::new(DVec3::new(x, 0.25, z), Vec3::NEG_Z) };
        let rays = vec![ray(0.5, 3.0, 1e9), ray(0.5, 0.75, 1e9), ray(1.5, 3.0, 1e9), ray(0.5, 3.0, 1.5)];
        let mut asked = 0;
        for peer in PEERS {
            for build in builds(peer, true).into_iter().chain(builds(peer, false)) {
                let is_placing = build.build_placed.is_some();
                assert_eq!(is_placing, PLACING_PEERS.contains(&peer), "{peer}");
                for built in [build.build(&mesh, 1), build.build_placed(&placed, 1)].into_iter().flatten() {
                    assert!(built.bytes() > 0, "{peer}");
                    for kind in [RayKind::Primary, RayKind::Bounce, RayKind::Shadow] {
                        let batch = Batch { kind, rays: rays.clone() };
                        for call in built.calls(&batch) {
                            let mut run = built.ready(call, &batch, &rays);
                            // The second run finds what the first has overwritten put back.
                            for _ in 0..2 {
                                run.prepare();
                                let sum = run.run(2);
                                // What is turned twice is rounded.
                                let hits: Vec<f64> =
                                    run.answers().iter().map(|a: &Answer| (a.t * 65536.0).round() / 65536.0).collect();
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
        }
        assert!(asked >= 8, "obvhs and parry3d are always here");
    }
}
