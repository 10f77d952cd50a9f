//! The limit at a vertex: its point and two vectors that span its tangent plane, as weights of the points around it.
//!
//! They are left eigenvectors of the matrix that takes one level's points to the next: Halstead, Kass, DeRose,
//! "Efficient, fair interpolation using Catmull-Clark surfaces", SIGGRAPH 1993; Biermann, Levin, Zorin, "Piecewise
//! smooth subdivision surfaces with normal control", SIGGRAPH 2000, section 4. The rules here are without that paper's
//! changes, so that at creases and corners of three faces or more the vectors differ from OpenSubdiv's masks, which
//! have them.
//!
//! Points around the vertex v in a sector of k faces, in the order of the ring: v, e₀, f₀, e₁, f₁, ..., e_k.

use super::rules::Rule;
use super::settled::{Ends, Sector};
use super::sparse::Rows;
use std::f64::consts::PI;

/// Weights of the points of a ring for the limit at its first vertex.
#[derive(Debug, Clone, Default)]
pub(super) struct Masks {
    pub position: Vec<f64>,
    /// Along the quad's edge of u, or a vector that spans the tangent plane with `dv`, of the orientation of u and v.
    pub du: Vec<f64>,
    pub dv: Vec<f64>,
}

/// Steps of the power method where there is no closed form: beyond them nothing changes in double precision, except at
/// darts of more than about 30 faces.
const STEPS: usize = 2000;

/// The masks of a quad in a sector. `matrix` takes the ring to the next level.
pub(super) fn masks(sector: Sector, matrix: &Rows) -> Masks {
    let ring = Ring { sector, len: matrix.len() };
    match (sector.rule, sector.ends) {
        (Rule::Smooth, Ends::Closed) if sector.faces > 2 => ring.smooth(),
        (Rule::Crease, Ends::Two) => ring.crease(),
        (Rule::Corner, Ends::Closed) if sector.faces > 2 => ring.closed_corner(),
        (Rule::Corner, Ends::Two | Ends::Dart) => ring.corner(),
        _ => ring.by_powers(matrix),
    }
}

/// Eigenvalue of the Fourier mode of angle θ (Halstead et al., appendix).
pub(super) fn eigenvalue(theta: f64) -> f64 {
    let cos = theta.cos();
    (5.0 + cos + (theta / 2.0).cos() * (2.0 * (9.0 + cos)).sqrt()) / 16.0
}

struct Ring {
    sector: Sector,
    len: usize,
}

impl Ring {
    fn faces(&self) -> usize {
        self.sector.faces as usize
    }

    /// Place of e_i.
    fn edge(&self, i: usize) -> usize {
        let wraps = self.sector.ends != Ends::Two && i == self.faces();
        if wraps { 1 } else { 1 + 2 * i }
    }

    fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.len]
    }

    /// e_i − v.
    fn spoke(&self, i: usize) -> Vec<f64> {
        let mut mask = self.zeros();
        mask[0] = -1.0;
        mask[self.edge(i)] += 1.0;
        mask
    }

    /// The mode whose value at e_i is `wave(i)`: 4 times that at e_i, and the sum of both edges' at f_i over 4 λ − 1.
    /// The scale is that of a derivative for the regular valence 4, where λ is 1/2.
    fn mode(&self, lambda: f64, wave: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut mask = self.zeros();
        let scale = 4.0 / (3.0 * self.faces() as f64);
        for i in 0..self.faces() {
            mask[1 + 2 * i] = scale * wave(i);
            mask[2 + 2 * i] = scale * (wave(i) + wave(i + 1)) / (4.0 * (4.0 * lambda - 1.0));
        }
        mask
    }

    fn smooth(&self) -> Masks {
        let n = self.faces() as f64;
        let mut position = self.zeros();
        position[0] = n / (n + 5.0);
        for i in 0..self.faces() {
            position[1 + 2 * i] = 4.0 / (n * (n + 5.0));
            position[2 + 2 * i] = 1.0 / (n * (n + 5.0));
        }
        let angle = 2.0 * PI / n;
        let along = |first: f64| self.mode(eigenvalue(angle), |i| ((i as f64 - first) * angle).cos());
        Masks { position, du: along(0.0), dv: along(1.0) }
    }

    /// The mode sin(p π i / k) of a sector: zero at both ends but for what flows in from v, e₀ and e_k, for which three
    /// columns of the eigenvector's equation are solved. `own` is the weight of v in its own rule.
    fn sine(&self, p: usize, own: f64) -> Vec<f64> {
        let k = self.faces();
        let angle = p as f64 * PI / k as f64;
        let lambda = eigenvalue(angle);
        let mut mask = self.mode(lambda, |i| if i == k { 0.0 } else { (i as f64 * angle).sin() });
        let inner: f64 = (1..k).map(|i| mask[1 + 2 * i]).sum();
        let faces: f64 = (0..k).map(|i| mask[2 + 2 * i]).sum();
        let first = mask[if k > 1 { 3 } else { 0 }] / 16.0 + mask[2] / 4.0;
        let into_vertex = 0.375 * inner + 0.25 * faces;
        // (λ − 1/2) b − (1 − own) a / 2 = first; (λ − own) a − (b₀ + b_k) / 2 = into_vertex.
        let (half, gain) = (lambda - 0.5, (1.0 - own) / 2.0);
        let (vertex, ends) = if p.is_multiple_of(2) {
            (0.0, [first / half, -first / half])
        } else {
            let det = half * (lambda - own) - gain;
            let vertex = (half * into_vertex + first) / det;
            let end = ((lambda - own) * first + gain * into_vertex) / det;
            (vertex, [end, end])
        };
        mask[0] = vertex;
        mask[self.edge(0)] += ends[0];
        mask[self.edge(k)] += ends[1];
        mask
    }

    /// Along the boundary at v: half of e₀ − e_k.
    fn along_boundary(&self) -> Vec<f64> {
        let mut mask = self.zeros();
        mask[self.edge(0)] += 0.5;
        mask[self.edge(self.faces())] -= 0.5;
        mask
    }

    /// Two vectors at an open sector of three faces or more: `inwards`, the mode that all inner edges share, and the
    /// one that decays next, to which the normals inside of the faces tend. From five faces this is the second mode;
    /// with four it ties with the boundary's 1/2 and feeds it. With three the boundary decides, and at sharp vertices
    /// its two edges, `ends`, do so for faces of their own.
    fn spanning(&self, ends: [Vec<f64>; 2], inwards: Vec<f64>, own: f64) -> (Vec<f64>, Vec<f64>) {
        let [first, last] = ends;
        match (self.faces(), self.sector.position) {
            (3, 0) => (first, inwards),
            (3, 2) => (inwards, last),
            (3 | 4, _) => (self.along_boundary(), inwards),
            _ => (self.sine(2, own), inwards),
        }
    }

    fn crease(&self) -> Masks {
        let k = self.faces();
        let mut position = self.zeros();
        position[0] = 2.0 / 3.0;
        position[self.edge(0)] += 1.0 / 6.0;
        position[self.edge(k)] += 1.0 / 6.0;
        let along = self.along_boundary();
        if k == 1 {
            // e₀ and e₁ leave in opposite directions: the plane is that of the boundary curve.
            let (du, dv) = (self.spoke(0), self.spoke(1));
            return Masks { position, du, dv };
        }
        let (inwards, back) = (self.sine(1, 0.75), along.iter().map(|x| -x).collect());
        let (du, dv) = self.spanning([along, back], inwards, 0.75);
        Masks { position, du, dv }
    }

    fn corner(&self) -> Masks {
        let k = self.faces();
        let mut position = self.zeros();
        position[0] = 1.0;
        let ends = [self.spoke(0), self.spoke(k)];
        // With two faces the inner edge's share of the ends' sum decays as slowly as they and grows by a step a level.
        let (du, dv) = match k {
            1 | 2 => ends.into(),
            _ => self.spanning(ends, self.sine(1, 1.0), 1.0),
        };
        Masks { position, du, dv }
    }

    /// A sharp vertex without sharp edges: all edges leave in one direction, the surface is a spike.
    fn closed_corner(&self) -> Masks {
        let mut position = self.zeros();
        position[0] = 1.0;
        let mut axis = self.mode(eigenvalue(0.0), |_| 1.0);
        axis[0] = -axis.iter().sum::<f64>();
        let angle = 2.0 * PI / self.faces() as f64;
        // The difference of the directions of the quad's edges 1 and 0.
        let around = self.mode(eigenvalue(angle), |i| ((i as f64 - 1.0) * angle).cos() - (i as f64 * angle).cos());
        Masks { position, du: axis, dv: around }
    }

    fn by_powers(&self, matrix: &Rows) -> Masks {
        let mut position = self.zeros();
        position[0] = 1.0;
        let i = self.sector.position as usize;
        let (mut du, mut dv) = (self.spoke(i), self.spoke(i + 1));
        for _ in 0..STEPS {
            position = matrix.left(&position, self.len);
            // Weights of a direction sum to 0. Rounding adds a share of the limit point's, which decays slowest and
            // would take over.
            du = unit(direction(matrix.left(&du, self.len), &position));
            // Without its part along du this converges to the second mode, and the orientation stays.
            dv = direction(matrix.left(&dv, self.len), &position);
            let shared: f64 = du.iter().zip(&dv).map(|(a, b)| a * b).sum();
            dv = unit(dv.iter().zip(&du).map(|(b, a)| b - shared * a).collect());
        }
        Masks { position, du, dv }
    }
}

/// The mask without its share of `position`, whose weights sum to 1: its own then sum to 0.
fn direction(mask: Vec<f64>, position: &[f64]) -> Vec<f64> {
    let sum: f64 = mask.iter().sum();
    mask.iter().zip(position).map(|(weight, of_point)| weight - sum * of_point).collect()
}

fn unit(mask: Vec<f64>) -> Vec<f64> {
    let length = mask.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { mask.iter().map(|x| x / length).collect() } else { mask }
}
