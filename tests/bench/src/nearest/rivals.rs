//! Peers: distances of points from a mesh, in single precision.

use super::Surface;
use crate::peers::embree_calls::{Options, Scene};
use crate::scenes::Mesh;
use glam::{Vec3, Vec3A};
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use parry3d::shape::TriMesh;

/// A peer's way of finding nearest points.
pub trait Rival {
    /// The peer, its version and its way.
    fn name(&self) -> String;
    /// Finds the distance of each point.
    fn distances(&self, points: &[Vec3], out: &mut [f32]);
}

/// All ways of a peer: points in the order in which they come, and sorted first, which counts. None after a message
/// if the peer is not on this machine.
pub fn rivals<'a>(peer: &str, surface: &'a Surface) -> Vec<Box<dyn Rival + 'a>> {
    let mut all: Vec<Box<dyn Rival + 'a>> = Vec::new();
    for is_sorted in [false, true] {
        match peer {
            "parry3d" => all.push(Box::new(Way { is_sorted, of: Parry(mesh(&surface.mesh)) })),
            "embree" => {
                for (quality, number) in [("medium", 1), ("high", 2)] {
                    let options = Options { quality: number, is_compact: false, threads: 1 };
                    match Scene::new(&surface.mesh, options) {
                        Ok(scene) => {
                            all.push(Box::new(Way { is_sorted, of: Embree { scene, mesh: &surface.mesh, quality } }));
                        }
                        Err(why) => {
                            eprintln!("skipped: Embree ({why}; Debian's package is libembree-dev)");
                            return all;
                        }
                    }
                }
            }
            _ => {}
        }
    }
    all
}

/// parry3d's mesh of triangles.
pub fn mesh(mesh: &Mesh) -> TriMesh {
    let vertices = mesh.vertices.iter().map(|&[x, y, z]| Vector::new(x, y, z)).collect();
    TriMesh::new(vertices, mesh.triangles.clone()).expect("a mesh of triangles")
}

/// A peer that answers a point at a time.
trait One {
    fn name(&self) -> String;
    fn distance(&self, p: Vec3) -> f32;
}

struct Way<T> {
    is_sorted: bool,
    of: T,
}

impl<T: One> Rival for Way<T> {
    fn name(&self) -> String {
        let sorted = if self.is_sorted { ", points sorted" } else { "" };
        format!("{}{sorted}", self.of.name())
    }

    fn distances(&self, points: &[Vec3], out: &mut [f32]) {
        if self.is_sorted {
            along_curve(points).into_iter().for_each(|i| out[i as usize] = self.of.distance(points[i as usize]));
        } else {
            points.iter().zip(out).for_each(|(&p, out)| *out = self.of.distance(p));
        }
    }
}

/// The indices of points in the order of a Morton curve of 1,024 cells a side, so that neighbours follow one another.
fn along_curve(points: &[Vec3]) -> Vec<u32> {
    let (min, max) = points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), &p| (a.min(p), b.max(p)));
    let scale = 1023.0 / (max - min).max(Vec3::splat(f32::MIN_POSITIVE));
    let spread = |x: f32| {
        let bits = [(16, 0x0300_00ff), (8, 0x0300_f00f), (4, 0x030c_30c3), (2, 0x0924_9249)];
        bits.iter().fold(x as u32, |x, (by, mask)| (x | x << by) & mask)
    };
    let key = |p: &Vec3| {
        let [x, y, z] = ((*p - min) * scale).to_array().map(spread);
        x | y << 1 | z << 2
    };
    let mut order: Vec<(u32, u32)> = points.iter().map(key).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

struct Parry(TriMesh);

impl One for Parry {
    fn name(&self) -> String {
        "parry3d 0.31".into()
    }

    fn distance(&self, p: Vec3) -> f32 {
        let p = Vector::new(p.x, p.y, p.z);
        (self.0.project_local_point(p, false).point - p).length()
    }
}

struct Embree<'a> {
    scene: Scene,
    mesh: &'a Mesh,
    quality: &'static str,
}

impl One for Embree<'_> {
    fn name(&self) -> String {
        format!("Embree {} {}, rtcPointQuery", self.scene.version(), self.quality)
    }

    fn distance(&self, p: Vec3) -> f32 {
        let Mesh { vertices, triangles, .. } = self.mesh;
        let at = Vec3A::from(p);
        // A caller asks for the nearest point and its triangle, not for the distance alone.
        let (mut distance, mut nearest) = (f32::INFINITY, (u32::MAX, Vec3A::ZERO));
        self.scene.around(p.to_array(), &mut |prim, radius| {
            let corners = triangles[prim as usize].map(|i| Vec3A::from(vertices[i as usize]));
            let point = closest(at, corners);
            let length = point.distance(at);
            if length < radius {
                (distance, nearest) = (length, (prim, point));
                length
            } else {
                radius
            }
        });
        std::hint::black_box(nearest);
        distance
    }
}

/// The point of a triangle that is nearest to `p`: Ericson, Real-Time Collision Detection, 5.1.5, as Embree's own
/// example has it.
#[inline(always)]
fn closest(p: Vec3A, [a, b, c]: [Vec3A; 3]) -> Vec3A {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    let (from_b, from_c) = (d4 - d3, d5 - d6);
    if va <= 0.0 && from_b >= 0.0 && from_c >= 0.0 {
        return b + (c - b) * (from_b / (from_b + from_c));
    }
    let scale = 1.0 / (va + vb + vc);
    a + ab * (vb * scale) + ac * (vc * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::rng::Rng;
    use crate::common::rounding::point_distance;
    use glam::DVec3;

    #[test]
    fn sorted_points_are_all_there_and_neighbours_are_near() {
        let mut rng = Rng::new(3);
        let points: Vec<Vec3> = (0..4096).map(|_| rng.inside(DVec3::ZERO, DVec3::ONE).as_vec3()).collect();
        let order = along_curve(&points);
        let mut all = order.clone();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..4096));
        let mean = |order: &[u32]| {
            let steps = order.windows(2).map(|w| points[w[0] as usize].distance(points[w[1] as usize]));
            steps.sum::<f32>() / 4095.0
        };
        let as_given: Vec<u32> = (0..4096).collect();
        assert!(mean(&order) < 0.2 * mean(&as_given), "{}", mean(&order));
    }

    #[test]
    fn the_nearest_point_of_a_triangle_is_that_in_doubles() {
        let mut rng = Rng::new(4);
        for _ in 0..2000 {
            let [p, a, b, c] = [(); 4].map(|()| rng.inside(-DVec3::ONE, DVec3::ONE).as_vec3());
            let found = closest(p.into(), [a.into(), b.into(), c.into()]).distance(p.into());
            let exact = point_distance(p.as_dvec3(), &[a, b, c].map(|v| v.as_dvec3()));
            assert!((f64::from(found) - exact).abs() < 1e-5, "{found} {exact}");
        }
    }
}
