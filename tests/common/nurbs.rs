//! NURBS surfaces with closed forms: a sphere, a torus, a cone whose tip is a collapsed side, a sheet with a cusp.

use glam::DVec3;
use outcrop::geom::surface::nurbs::NurbsDesc;

/// A surface, owned; the index of a control point runs fastest along v.
pub struct Nurbs {
    pub degree: [u32; 2],
    pub counts: [u32; 2],
    pub knots: [Vec<f64>; 2],
    pub points: Vec<DVec3>,
    pub weights: Vec<f64>,
}

impl Nurbs {
    pub fn desc(&self) -> NurbsDesc<'_> {
        NurbsDesc {
            degree: self.degree,
            counts: self.counts,
            knots_u: &self.knots[0],
            knots_v: &self.knots[1],
            points: &self.points,
            weights: Some(&self.weights),
        }
    }

    /// The surface that a profile in the plane of x and z draws around the z axis, which u goes round.
    fn turned(profile: &[(DVec3, f64)], degree: u32, knots: Vec<f64>) -> Self {
        let (knots_u, ring) = circle();
        let (mut points, mut weights) = (Vec::new(), Vec::new());
        for (around, of_ring) in &ring {
            for (p, of_profile) in profile {
                points.push(DVec3::new(around.x * p.x, around.y * p.x, p.z));
                weights.push(of_ring * of_profile);
            }
        }
        let counts = [ring.len() as u32, profile.len() as u32];
        Self { degree: [2, degree], counts, knots: [knots_u, knots], points, weights }
    }
}

/// A circle of radius 1 in the plane of x and y as nine control points of degree 2, with weights.
fn circle() -> (Vec<f64>, Vec<(DVec3, f64)>) {
    let knots = vec![0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0];
    let corners = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)];
    let point = |(i, (x, y)): (usize, (i32, i32))| {
        (DVec3::new(x.into(), y.into(), 0.0), if i % 2 == 0 { 1.0 } else { 0.5f64.sqrt() })
    };
    (knots, corners.into_iter().enumerate().map(point).collect())
}

/// A sphere of radius 1: one side of its rectangle is the lower pole, the opposite one the upper.
pub fn sphere() -> Nurbs {
    let corners = [(0, -1), (1, -1), (1, 0), (1, 1), (0, 1)];
    let point = |(i, (x, z)): (usize, (i32, i32))| {
        (DVec3::new(x.into(), 0.0, z.into()), if i % 2 == 0 { 1.0 } else { 0.5f64.sqrt() })
    };
    let half: Vec<_> = corners.into_iter().enumerate().map(point).collect();
    Nurbs::turned(&half, 2, vec![0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0])
}

/// A torus of radii 3 and 1.
pub fn torus() -> Nurbs {
    let (knots, profile) = circle();
    let profile: Vec<_> = profile.iter().map(|(p, w)| (DVec3::new(3.0 + p.x, 0.0, p.y), *w)).collect();
    Nurbs::turned(&profile, 2, knots)
}

/// Two cones of height 1 on one circle of radius 1: both outer sides of the rectangle are tips.
pub fn double_cone() -> Nurbs {
    let profile = [(DVec3::NEG_Z, 1.0), (DVec3::X, 1.0), (DVec3::Z, 1.0)];
    Nurbs::turned(&profile, 1, vec![0.0, 0.0, 1.0, 2.0, 2.0])
}

/// A sheet two units wide along y over the curve `z² = x³`, whose cusp is at the origin, for x up to 1.
pub fn cusp() -> Nurbs {
    // t in -1 to 1, (t², t³) as Bernstein coefficients of degree 3.
    let curve = [(1.0, -1.0), (-1.0 / 3.0, 1.0), (-1.0 / 3.0, -1.0), (1.0, 1.0)];
    let points = curve.iter().flat_map(|&(x, z)| [-1.0, 1.0].map(|y| DVec3::new(x, y, z))).collect();
    let knots = [vec![0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], vec![0.0, 0.0, 1.0, 1.0]];
    Nurbs { degree: [3, 1], counts: [4, 2], knots, points, weights: vec![1.0; 8] }
}
