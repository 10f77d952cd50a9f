use super::*;
use crate::geom::distances::point_triangle;
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// A surface of revolution in `u`, of `across` × `along` quads: a torus, or a sphere with poles where `v` ends.
pub(super) struct Round {
    pub across: u32,
    pub along: u32,
    pub is_sphere: bool,
    /// Quads differ by so much in what they evaluate, as displacements do at seams.
    pub tear: f64,
}

impl Round {
    fn rows(&self) -> u32 {
        self.along + u32::from(self.is_sphere)
    }

    fn vertex(&self, i: u32, j: u32) -> u32 {
        match self.is_sphere && (j == 0 || j == self.along) {
            true => j.min(1),
            false => 2 + i % self.across + self.across * (j % self.rows()),
        }
    }

    fn at(&self, u: f64, v: f64) -> Sample {
        let (round, side) = (TAU * u / f64::from(self.across), v / f64::from(self.along));
        let out = DVec3::new(round.cos(), round.sin(), 0.0);
        let (centre, tilt) = if self.is_sphere { (DVec3::ZERO, PI * side - PI / 2.0) } else { (3.0 * out, TAU * side) };
        let normal = out * tilt.cos() + DVec3::Z * tilt.sin();
        Sample { position: centre + normal, normal }
    }

    fn distance(&self, p: DVec3) -> f64 {
        let out = p.truncate().length();
        if self.is_sphere { (p.length() - 1.0).abs() } else { ((out - 3.0).hypot(p.z) - 1.0).abs() }
    }
}

impl Quads for Round {
    fn count(&self) -> usize {
        (self.across * self.along) as usize
    }
    fn vertices(&self) -> usize {
        (2 + self.across * self.rows()) as usize
    }
    fn edges(&self) -> usize {
        2 * (self.across * self.rows()) as usize
    }
    fn corners(&self, quad: usize) -> [u32; 4] {
        let [i, j] = [quad as u32 % self.across, quad as u32 / self.across];
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| self.vertex(i + x, j + y))
    }
    fn sides(&self, quad: usize) -> [Side; 4] {
        let [i, j] = [quad as u32 % self.across, quad as u32 / self.across];
        let along_u = |j: u32| 2 * (i + self.across * (j % self.rows()));
        let along_v = |i: u32| 2 * (i % self.across + self.across * j) + 1;
        let side = |edge| Side { edge, is_reversed: false };
        [side(along_u(j)), side(along_u(j + 1)), side(along_v(i)), side(along_v(i + 1))]
    }
    fn sample(&self, quad: usize, u: f64, v: f64) -> Sample {
        let [i, j] = [quad as u32 % self.across, quad as u32 / self.across].map(f64::from);
        let mut sample = self.at(i + u, j + v);
        let torn = self.tear * f64::from(quad as u32 % 3);
        sample.position += sample.normal * torn;
        sample
    }
}

fn triangles(surface: &impl Quads, dicing: Dicing) -> Vec<([DVec3; 3], [Vec3; 3])> {
    let mut all = Vec::new();
    let mut emit = |_, micro: &Micro| {
        all.extend(micro.positions.iter().copied().zip(micro.normals.iter().copied()));
        Ok(())
    };
    dice(surface, dicing, &Cancel::new(), &mut emit).expect("triangles");
    all
}

/// Each edge of a triangle is that of another one, the other way, to the bit.
pub(super) fn is_closed(triangles: &[([DVec3; 3], [Vec3; 3])]) -> bool {
    let mut edges: HashMap<[[u64; 3]; 2], i32> = HashMap::new();
    let bits = |p: DVec3| (p + 0.0).to_array().map(f64::to_bits);
    for (corners, _) in triangles {
        for i in 0..3 {
            let (a, b) = (bits(corners[i]), bits(corners[(i + 1) % 3]));
            *edges.entry(if a < b { [a, b] } else { [b, a] }).or_default() += if a < b { 1 } else { -1 };
        }
    }
    edges.values().all(|count| *count == 0)
}

#[test]
fn tori_and_spheres_are_closed_and_near() {
    for is_sphere in [false, true] {
        for tolerance in [0.1, 1e-2, 1e-3] {
            let surface = Round { across: 5, along: 3, is_sphere, tear: 0.0 };
            let all = triangles(&surface, Dicing::Tolerance(tolerance));
            assert!(is_closed(&all), "{is_sphere} {tolerance}");
            // The samples of a triangle, and the other way: points of the surface.
            let weights = [[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [1.0 / 3.0; 3], [0.6, 0.2, 0.2]];
            let of = |p: &[DVec3; 3], w: &[f64; 3]| p[0] * w[0] + p[1] * w[1] + p[2] * w[2];
            let far = all.iter().flat_map(|(p, _)| weights.iter().map(|w| surface.distance(of(p, w))));
            let far = far.fold(0.0, f64::max);
            println!("sphere {is_sphere}, tolerance {tolerance}: {} triangles, {far} off", all.len());
            assert!(far <= tolerance && far > tolerance / 30.0, "{far} of {tolerance}");
            for (corners, normals) in &all {
                let facet = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                // A corner on a coarser side may move to a pole: then all three are on one meridian.
                let longest =
                    (corners[1] - corners[0]).length_squared().max((corners[2] - corners[0]).length_squared());
                assert!(facet.dot(normals[0].as_dvec3()) > -1e-7 * longest, "{corners:?}");
            }
        }
    }
}

#[test]
fn levels_give_their_number_of_triangles() {
    let torus = Round { across: 4, along: 3, is_sphere: false, tear: 0.0 };
    assert_eq!(triangles(&torus, Dicing::Level(3)).len(), 4 * 3 * 2 * 64);
    // Each quad at a pole loses one triangle of each cell there.
    let sphere = Round { across: 4, along: 3, is_sphere: true, tear: 0.0 };
    assert_eq!(triangles(&sphere, Dicing::Level(3)).len(), 4 * 3 * 2 * 64 - 2 * 4 * 8);
}

/// Quads of other sizes meet in edges of other levels, and what they evaluate differs: nothing tears.
#[test]
fn torn_quads_are_joined() {
    for dicing in [Dicing::Level(2), Dicing::Tolerance(0.003)] {
        for is_sphere in [false, true] {
            let surface = Round { across: 4, along: 6, is_sphere, tear: 0.01 };
            let all = triangles(&surface, dicing);
            assert!(is_closed(&all), "{dicing:?} {is_sphere}");
        }
    }
}

/// A ridge in one quad alone: its inside is fine, its neighbours are not.
pub(super) struct Ridge;

impl Quads for Ridge {
    fn count(&self) -> usize {
        2
    }
    fn vertices(&self) -> usize {
        6
    }
    fn edges(&self) -> usize {
        7
    }
    fn corners(&self, quad: usize) -> [u32; 4] {
        [[0, 1, 3, 4], [1, 2, 4, 5]][quad]
    }
    fn sides(&self, quad: usize) -> [Side; 4] {
        [[0, 1, 2, 3], [4, 5, 3, 6]][quad].map(|edge| Side { edge, is_reversed: false })
    }
    fn sample(&self, quad: usize, u: f64, v: f64) -> Sample {
        let height = if quad == 0 { (4.0 * u * (1.0 - u) * v * (1.0 - v)).powi(3) } else { 0.0 };
        Sample { position: DVec3::new(quad as f64 + u, v, height), normal: DVec3::Z }
    }
}

#[test]
fn coarse_neighbours_meet_fine_quads() {
    let all = triangles(&Ridge, Dicing::Tolerance(1e-4));
    let flat = all.iter().filter(|(p, _)| p.iter().all(|p| p.x >= 1.0)).count();
    assert_eq!(flat, 2);
    assert!(all.len() > 500);
    // All area is covered once.
    let area: f64 = all.iter().map(|(p, _)| (p[1] - p[0]).truncate().perp_dot((p[2] - p[0]).truncate()) / 2.0).sum();
    assert!((area - 2.0).abs() < 1e-12, "{area}");
    let height = |p: DVec3| all.iter().map(|(t, _)| point_triangle(p, t).squared).fold(f64::MAX, f64::min).sqrt();
    let far = (0..900).map(|i| Ridge.sample(0, f64::from(i % 30) / 29.0, f64::from(i / 30) / 29.0));
    let far = far.map(|it| height(it.position)).fold(0.0, f64::max);
    assert!(far <= 1e-4, "{far}");
    let wrong = [Dicing::Level(13), Dicing::Tolerance(0.0), Dicing::Tolerance(f64::NAN)];
    assert!(wrong.iter().all(|it| dice(&Ridge, *it, &Cancel::new(), &mut |_, _| Ok(())).is_err()));
}
