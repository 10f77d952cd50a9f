//! A point of a surface as shading needs it: derivatives, the unit normal, and how the surface bends.

use super::point::SurfacePoint;
use glam::{DAffine3, DVec3};

/// A point of a surface or of a triangle with its first derivatives by two parameters and its shading normal.
///
/// The bend is kept as a second fundamental form along two tangents, not as second derivatives: of a triangle only the
/// change of its interpolated normal is known, and an affine map takes the form to that of the mapped surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadingPoint {
    /// The point.
    pub position: DVec3,
    /// First derivative by u.
    pub du: DVec3,
    /// First derivative by v.
    pub dv: DVec3,
    /// Unit normal; of triangles on the side from which their corners appear counter-clockwise. Zero where there is
    /// none.
    pub normal: DVec3,
    /// True if the point is evaluated on the surface, false if it is on a triangle.
    pub is_surface: bool,
    /// The parts of `du` and `dv` across the normal.
    tangents: [DVec3; 2],
    /// Second fundamental form for these tangents: of u and u, of u and v, of v and v.
    form: [f64; 3],
}

impl ShadingPoint {
    /// A point evaluated on a surface. `normal`: its unit normal there; zero: along `du × dv`.
    pub fn of_surface(point: &SurfacePoint, normal: DVec3) -> Self {
        let SurfacePoint { position, du, dv, duu, duv, dvv } = *point;
        let normal = if normal == DVec3::ZERO { point.normal() } else { normal };
        let form = [duu, duv, dvv].map(|second| second.dot(normal));
        Self { position, du, dv, normal, is_surface: true, tangents: [du, dv].map(|d| across(d, normal)), form }
    }

    /// A point of a triangle. `weights`: those of the second and the third corner. `parameters`: u and v of the
    /// corners. `normals`: unit normals at the corners, between which the normal is interpolated; `None`: the
    /// triangle's own.
    ///
    /// The bend is that of a surface with the interpolated normals n: its form is -dn · dP (do Carmo, "Differential
    /// Geometry of Curves and Surfaces", section 3.2), made symmetric. Derivatives are zero where the parameters of the
    /// corners are on a line.
    pub fn of_triangle(
        corners: &[DVec3; 3],
        normals: Option<&[DVec3; 3]>,
        parameters: &[[f64; 2]; 3],
        weights: [f64; 2],
    ) -> Self {
        let [by_second, by_third] = [1, 2].map(|i| [0, 1].map(|axis| parameters[i][axis] - parameters[0][axis]));
        let area = by_second[0] * by_third[1] - by_second[1] * by_third[0];
        let scale = if area == 0.0 { 0.0 } else { 1.0 / area };
        // The derivatives by u and v of what is linear over the triangle.
        let by_parameters = |[a, b, c]: &[DVec3; 3]| {
            let [second, third] = [*b - *a, *c - *a];
            let du = (second * by_third[1] - third * by_second[1]) * scale;
            let dv = (third * by_second[0] - second * by_third[0]) * scale;
            [du, dv]
        };
        let mixed = |[a, b, c]: &[DVec3; 3]| *a + (*b - *a) * weights[0] + (*c - *a) * weights[1];
        let [du, dv] = by_parameters(corners);
        let [a, b, c] = corners;
        let own = (*b - *a).cross(*c - *a).normalize_or_zero();
        let smooth = normals.map(|normals| (mixed(normals), normals)).filter(|it| it.0.length_squared() > LEAST);
        let (position, is_surface) = (mixed(corners), false);
        let Some((mean, normals)) = smooth else {
            return Self { position, du, dv, normal: own, is_surface, tangents: [du, dv], form: [0.0; 3] };
        };
        let length = mean.length();
        let normal = mean / length;
        // The derivatives of the unit normal: the part of the mean's along the normal changes its length only.
        let turns = by_parameters(normals).map(|d| across(d, normal) / length);
        let tangents = [du, dv].map(|d| across(d, normal));
        let form = [
            -turns[0].dot(tangents[0]),
            -0.5 * (turns[0].dot(tangents[1]) + turns[1].dot(tangents[0])),
            -turns[1].dot(tangents[1]),
        ];
        Self { position, du, dv, normal, is_surface, tangents, form }
    }

    /// The point of the surface that an affine map makes. `normal`: the normal taken by the inverse transpose of the
    /// map's linear part, of the length that it then has.
    pub fn mapped(&self, map: &DAffine3, normal: DVec3) -> Self {
        let length = normal.length();
        // A second derivative s becomes M s, whose product with M⁻ᵀ n is that of s and n.
        let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
        let linear = |v: DVec3| map.matrix3 * v;
        Self {
            position: map.transform_point3(self.position),
            du: linear(self.du),
            dv: linear(self.dv),
            normal: normal.normalize_or_zero(),
            is_surface: self.is_surface,
            tangents: self.tangents.map(linear),
            form: self.form.map(|x| x * scale),
        }
    }

    /// The principal curvatures, the larger one first, positive where the surface bends towards its normal; 0 where
    /// the tangents have one direction.
    pub fn curvatures(&self) -> [f64; 2] {
        let [du, dv] = self.tangents;
        let is_opposite = du.cross(dv).dot(self.normal) < 0.0;
        let side = if is_opposite { -self.normal } else { self.normal };
        let [duu, duv, dvv] = self.form.map(|x| side * if is_opposite { -x } else { x });
        let found = SurfacePoint { position: self.position, du, dv, duu, duv, dvv }.curvatures();
        let [more, less] = found.filter(|it| it.iter().all(|x| x.is_finite())).unwrap_or_default();
        if is_opposite { [-less, -more] } else { [more, less] }
    }
}

/// Square of the length below which a mean of unit normals has no direction.
const LEAST: f64 = 1e-12;

/// The part of a vector across a unit vector.
fn across(v: DVec3, unit: DVec3) -> DVec3 {
    v - unit * v.dot(unit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    const WEIGHTS: [[f64; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

    /// A paraboloid z = (a x² + b y²) / 2 at its vertex, in a system that is turned.
    fn paraboloid(a: f64, b: f64) -> SurfacePoint {
        SurfacePoint {
            position: DVec3::ZERO,
            du: DVec3::X,
            dv: DVec3::Y,
            duu: DVec3::Z * a,
            duv: DVec3::ZERO,
            dvv: DVec3::Z * b,
        }
    }

    fn mapped(point: &ShadingPoint, linear: DMat3) -> ShadingPoint {
        let map = DAffine3 { matrix3: linear, translation: DVec3::new(1.0, 2.0, 3.0) };
        point.mapped(&map, linear.inverse().transpose() * point.normal)
    }

    fn assert_near(found: [f64; 2], expected: [f64; 2], within: f64) {
        let far = (found[0] - expected[0]).abs().max((found[1] - expected[1]).abs());
        assert!(far <= within, "{found:?}, not {expected:?}");
    }

    /// z = (a x² + b y²) / 2 scaled by (p, q, r) is z = (a r / p² x² + b r / q² y²) / 2.
    #[test]
    fn scales_change_curvatures_as_those_of_the_scaled_surface() {
        let point = ShadingPoint::of_surface(&paraboloid(3.0, -0.5), DVec3::ZERO);
        assert_near(point.curvatures(), [3.0, -0.5], 1e-14);
        let scaled = mapped(&point, DMat3::from_diagonal(DVec3::new(2.0, 0.5, 3.0)));
        assert_near(scaled.curvatures(), [3.0 * 3.0 / 4.0, -0.5 * 3.0 / 0.25], 1e-12);
        // A mirror keeps the normal's side, and so the signs.
        let mirrored = mapped(&point, DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)));
        assert_near(mirrored.curvatures(), [3.0, -0.5], 1e-14);
        assert_eq!(mirrored.normal, DVec3::Z);
        // A shear along the tangent plane leaves the vertex's curvatures; with the opposite normal both change sign.
        let turned = ShadingPoint::of_surface(&paraboloid(3.0, -0.5), DVec3::NEG_Z);
        assert_near(turned.curvatures(), [0.5, -3.0], 1e-14);
    }

    /// Triangles on spheres: of the normals the curvature is that of the sphere through the point, whatever the
    /// parameters are.
    #[test]
    fn triangles_bend_as_their_normals() {
        let corner = |x: f64, y: f64| DVec3::new(x, y, (4.0 - x * x - y * y).sqrt());
        let corners = [corner(0.1, 0.2), corner(0.4, 0.25), corner(0.2, 0.5)];
        let normals = corners.map(|p| p / 2.0);
        for parameters in [WEIGHTS, [[0.5, 0.25], [0.75, 0.25], [0.75, 0.5]]] {
            let point = ShadingPoint::of_triangle(&corners, Some(&normals), &parameters, [0.3, 0.4]);
            let expected = -1.0 / point.position.length();
            assert_near(point.curvatures(), [expected; 2], 1e-12);
            assert!((point.normal - point.position.normalize()).length() < 1e-14);
            let flat = ShadingPoint::of_triangle(&corners, None, &parameters, [0.3, 0.4]);
            assert_eq!((flat.position, flat.du, flat.curvatures()), (point.position, point.du, [0.0; 2]));
            // The derivatives lead from corner to corner.
            let to = |i: usize| {
                let [u, v] = [0, 1].map(|axis| parameters[i][axis] - parameters[0][axis]);
                corners[0] + point.du * u + point.dv * v
            };
            assert!(to(1).distance(corners[1]) < 1e-14 && to(2).distance(corners[2]) < 1e-14);
        }
    }

    #[test]
    fn degenerate_triangles_have_no_bend() {
        let line = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        let normals = [DVec3::Z, DVec3::Y, DVec3::Z];
        for parameters in [WEIGHTS, [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]] {
            let point = ShadingPoint::of_triangle(&line, Some(&normals), &parameters, [0.2, 0.2]);
            assert_eq!(point.curvatures(), [0.0; 2]);
            assert!(point.du.is_finite() && point.normal.is_finite());
        }
        let opposite = [DVec3::Z, DVec3::NEG_Z, DVec3::Z];
        let point = ShadingPoint::of_triangle(&line, Some(&opposite), &WEIGHTS, [0.5, 0.0]);
        assert_eq!((point.normal, point.curvatures()), (DVec3::ZERO, [0.0; 2]));
    }
}
