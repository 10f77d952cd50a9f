//! Peers: each finds the pairs of bodies whose boxes overlap by parry3d's tree of boxes, and then pairs of triangles.

use super::bodies::{Bodies, Pair, bounds};
use super::overlap::overlap;
use crate::peers::embree_calls::Boxes;
use glam::DVec3;
use parry3d::math::{Pose, Vector};
use parry3d::partitioning::{Bvh, BvhNode};
use parry3d::query::details::intersection_test_support_map_support_map;
use parry3d::shape::{TriMesh, Triangle};

/// Boxes of triangles by a peer, and a test of two triangles.
pub trait Rival {
    /// The peer, its version and its test.
    fn name(&self) -> String;
    /// Finds all pairs, in any order; returns the number of pairs of triangles that were tested.
    fn all(&self, met: &mut Vec<Pair>) -> u64;
    /// True if any pair meets, as soon as that is known; `None` if the peer cannot stop.
    fn any(&self) -> Option<bool>;
}

/// The test of two triangles.
#[derive(Clone, Copy, PartialEq)]
enum Test {
    /// parry3d's own for triangles, in single precision.
    Gjk,
    /// [`overlap`].
    Doubles,
}

struct Parry<'a> {
    bodies: &'a Bodies,
    boxes: Bvh,
    meshes: Vec<TriMesh>,
    test: Test,
}

struct Embree<'a> {
    bodies: &'a Bodies,
    boxes: Bvh,
    scenes: Boxes,
}

/// All peers of a name with their ways of testing triangles; none after a message if one is not on this machine.
pub fn rivals<'a>(peer: &str, bodies: &'a Bodies) -> Vec<Box<dyn Rival + 'a>> {
    match peer {
        "parry3d" => [Test::Gjk, Test::Doubles]
            .map(|test| Box::new(Parry { bodies, boxes: bodies.tree(), meshes: meshes(bodies), test }) as _)
            .into(),
        "embree" => {
            let boxes = bodies.each.iter().map(|body| body.corners.iter().map(bounds).collect()).collect();
            match Boxes::new(boxes) {
                Ok(scenes) => vec![Box::new(Embree { bodies, boxes: bodies.tree(), scenes })],
                Err(why) => {
                    eprintln!("skipped: Embree ({why}; Debian's package is libembree-dev)");
                    Vec::new()
                }
            }
        }
        _ => Vec::new(),
    }
}

fn meshes(bodies: &Bodies) -> Vec<TriMesh> {
    let vector = |p: &DVec3| Vector::new(p.x as f32, p.y as f32, p.z as f32);
    let mesh = |corners: &Vec<[DVec3; 3]>| {
        let vertices = corners.as_flattened().iter().map(vector).collect();
        let triangles = (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        TriMesh::new(vertices, triangles).expect("a mesh of triangles")
    };
    bodies.each.iter().map(|body| mesh(&body.corners)).collect()
}

fn in_order(a: u32, b: u32) -> Pair {
    [a.min(b), a.max(b)]
}

impl Parry<'_> {
    /// Calls `met` for each pair until it returns false; returns the number of pairs that were tested.
    fn visit(&self, mut met: impl FnMut(Pair) -> bool) -> u64 {
        let (mut near, mut tested) = (Vec::new(), 0);
        Bodies::near(&self.boxes, &mut near);
        for pair in near {
            let [a, b] = pair.map(|i| (&self.bodies.each[i as usize], &self.meshes[i as usize]));
            for (i, j) in a.1.bvh().leaf_pairs(b.1.bvh(), |x: &BvhNode, y: &BvhNode| x.intersects(y)) {
                tested += 1;
                let is_met = match self.test {
                    Test::Gjk => {
                        let (first, second): (Triangle, Triangle) = (a.1.triangle(i), b.1.triangle(j));
                        intersection_test_support_map_support_map(&Pose::IDENTITY, &first, &second)
                    }
                    Test::Doubles => overlap(&a.0.corners[i as usize], &b.0.corners[j as usize]),
                };
                if is_met && !met(in_order(a.0.ids[i as usize], b.0.ids[j as usize])) {
                    return tested;
                }
            }
        }
        tested
    }
}

impl Rival for Parry<'_> {
    fn name(&self) -> String {
        let test = if self.test == Test::Gjk { "its own test" } else { "test in doubles" };
        format!("parry3d 0.31, {test}")
    }

    fn all(&self, met: &mut Vec<Pair>) -> u64 {
        self.visit(|pair| {
            met.push(pair);
            true
        })
    }

    fn any(&self) -> Option<bool> {
        let mut is_met = false;
        self.visit(|_| {
            is_met = true;
            false
        });
        Some(is_met)
    }
}

impl Rival for Embree<'_> {
    fn name(&self) -> String {
        format!("Embree {}, rtcCollide, test in doubles", self.scenes.version())
    }

    fn all(&self, met: &mut Vec<Pair>) -> u64 {
        let (mut near, mut tested) = (Vec::new(), 0);
        Bodies::near(&self.boxes, &mut near);
        for pair in near {
            let [a, b] = pair.map(|i| &self.bodies.each[i as usize]);
            self.scenes.collide(pair.map(|i| i as usize), &mut |i, j| {
                tested += 1;
                if overlap(&a.corners[i as usize], &b.corners[j as usize]) {
                    met.push(in_order(a.ids[i as usize], b.ids[j as usize]));
                }
            });
        }
        tested
    }

    fn any(&self) -> Option<bool> {
        None
    }
}
