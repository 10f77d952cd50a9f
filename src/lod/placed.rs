//! The look of a cell in another frame: the samples of its six sides as those of a box along the axes of that frame.
//!
//! A side of the box sees the cell along a direction that is slanted in the cell's own frame, so it sees up to three
//! sides of the cell, each with the area that the linear map gives it. Normals turn through the inverse transpose.

use super::seen::LEAST_SEEN;
use super::voxel::{Sample, Sum, axis_of, toward};
use super::{Seen, Shares, shares, stored_colour, stored_cover, stored_likeness, stored_normal};
use glam::{DMat3, DVec3, Vec3};

/// Least sum of visible areas, as shares of the box's side, of which a mean is taken.
const LEAST_AREA: f32 = 1e-12;

/// Unit vector out of a side of a cell.
fn outward(side: usize) -> Vec3 {
    let (axis, is_high) = axis_of(side);
    Vec3::AXES[axis] * if is_high { 1.0 } else { -1.0 }
}

/// Returns the sample that a cell of extent `extent` shows on `side`, from what a ray to that side sees of it. `colour`
/// replaces its colours, if it has none of its own, and `cover` the covers of its samples. (Only voxels of six sides
/// store the covers of sides. In others they are meant for comparison with each other.)
pub fn side_seen(side: usize, extent: Vec3, seen: &Seen, colour: Option<Vec3>, cover: Option<f32>) -> Sample {
    let weights = match seen.shares {
        Shares::One => [1.0, 0.0, 0.0],
        Shares::OfSides => shares(extent, -outward(side), seen.firsts, seen.seconds),
        Shares::Given(shares) => shares,
    };
    let (mut sum, mut covered) = (Sum::default(), 0.0);
    for ((first, second), weight) in seen.firsts.into_iter().zip(seen.seconds).zip(weights) {
        let normal = toward(stored_normal(first) * stored_likeness(first), side);
        sum.add(normal, colour.unwrap_or_else(|| stored_colour(second)), weight);
        covered += cover.unwrap_or_else(|| stored_cover(second)) * weight;
    }
    sum.mean(covered.clamp(0.0, 1.0))
}

/// A cell in its own frame, and its place in another.
#[derive(Debug, Clone, Copy)]
pub struct PlacedSides<'a> {
    /// The samples of its sides: low x, y, z, then high x, y, z.
    pub sides: &'a [Sample; 6],
    /// Its extent.
    pub extent: Vec3,
    /// The linear map from its frame, and the inverse.
    pub linear: DMat3,
    /// See `linear`.
    pub inverse: DMat3,
}

/// Returns the samples of the six sides of a box of extent `extent` around the placed cell.
pub fn placed_sides(cell: &PlacedSides, extent: Vec3) -> [Sample; 6] {
    let turn = cell.inverse.transpose();
    let turned = cell.sides.map(|sample| {
        let unit = (turn * sample.normal.as_dvec3()).normalize_or_zero().as_vec3();
        unit * sample.normal.length()
    });
    let size = cell.linear.determinant().abs();
    let own = cell.extent.as_dvec3();
    let areas = DVec3::new(own.y * own.z, own.z * own.x, own.x * own.y) * size;
    std::array::from_fn(|side| {
        let out = outward(side);
        let (axis, _) = axis_of(side);
        let face = f64::from(extent[(axis + 1) % 3]) * f64::from(extent[(axis + 2) % 3]);
        // A side of the cell with an area vector `A e` has the vector `det A (inverse transpose of the map) e` here.
        let to_eye = cell.inverse * out.as_dvec3();
        let facing = [0, 1, 2].map(|k| if to_eye[k] < 0.0 { k } else { k + 3 });
        let (mut sum, mut covered) = (Sum::default(), 0.0);
        for (k, at) in facing.into_iter().enumerate() {
            let seen = areas[k] * to_eye[k].abs() / face;
            let area = f64::from(cell.sides[at].cover) * seen;
            let alike = f64::from(cell.sides[at].normal.length_squared());
            covered += area;
            let weight = area * alike + f64::from(LEAST_SEEN) * seen;
            sum.add(toward(turned[at], side), cell.sides[at].colour, weight as f32);
        }
        if !(sum.weight > LEAST_AREA && sum.weight.is_finite()) {
            // A flat cell seen edge-on, or a box without area there: the sides count by the directions that they face.
            sum = Sum::default();
            let most = to_eye.abs().max_element();
            for (k, at) in facing.into_iter().enumerate() {
                let weight = to_eye[k].abs() / most;
                sum.add(toward(turned[at], side), cell.sides[at].colour, weight as f32);
            }
        }
        sum.mean(if covered.is_finite() { covered.min(1.0) as f32 } else { 1.0 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const RED: Vec3 = Vec3::new(1.0, 0.0, 0.0);
    const GREY: Vec3 = Vec3::new(0.5, 0.5, 0.5);

    /// The faces of a cuboid: that across low x is red.
    fn cuboid() -> [Sample; 6] {
        std::array::from_fn(|side| Sample {
            normal: outward(side),
            colour: if side == 0 { RED } else { GREY },
            cover: 1.0,
        })
    }

    fn placed(sides: &[Sample; 6], extent: Vec3, linear: DMat3) -> [Sample; 6] {
        let corners = (0..8).map(|i| {
            let at = |axis: usize| if i >> axis & 1 == 1 { f64::from(extent[axis]) } else { 0.0 };
            linear * DVec3::new(at(0), at(1), at(2))
        });
        let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        placed_sides(&PlacedSides { sides, extent, linear, inverse: linear.inverse() }, (high - low).as_vec3())
    }

    /// Samples keep their values where the sides of the cell are those of the box, mirrored or stretched.
    #[test]
    fn sides_that_stay_sides_keep_their_samples() {
        // x goes to -y, y to z, z to x; each is stretched.
        let linear = DMat3::from_cols(DVec3::new(0.0, -2.0, 0.0), DVec3::new(0.0, 0.0, 3.0), DVec3::new(0.5, 0.0, 0.0));
        let got = placed(&cuboid(), Vec3::new(1.0, 2.0, 3.0), linear);
        for (side, sample) in got.iter().enumerate() {
            // Low x of the cell is high y of the box.
            let colour = if side == 4 { RED } else { GREY };
            assert!(sample.normal.distance(outward(side)) < 1e-5 && sample.cover > 0.999, "{side}: {sample:?}");
            assert!(sample.colour.distance(colour) < 1e-5, "{side}: {sample:?}");
        }
    }

    /// Compares with the silhouette of a turned cube, and with the normals of the two faces that are seen.
    #[test]
    fn a_turned_cube_shows_its_faces_by_their_areas() {
        let turn = DMat3::from_quat(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4 / 2.0));
        let got = placed(&cuboid(), Vec3::ONE, turn);
        let (sin, cos) = (std::f32::consts::FRAC_PI_8).sin_cos();
        for side in [0, 1, 3, 4] {
            // Silhouette and box have the same width, cos + sin.
            assert!(got[side].cover > 0.999, "{side}");
            // The faces have the shares cos and sin of it; their normals differ from the side's by the angle.
            let out = outward(side);
            let expected = (cos * cos + sin * sin) / (cos + sin);
            assert!((got[side].normal.dot(out) - expected).abs() < 1e-4, "{side}: {:?}", got[side]);
        }
        assert!(got[0].colour.x > got[0].colour.y && got[3].colour.distance(GREY) < 1e-5);
        // The top covers 1 of (cos + sin)^2.
        assert!((got[5].cover - 1.0 / (cos + sin).powi(2)).abs() < 1e-4);
    }

    /// A sheared plane keeps its own direction: the inverse transpose turns normals, the map does not.
    #[test]
    fn normals_turn_through_the_inverse_transpose() {
        let normal = Vec3::new(1.0, 0.0, 1.0).normalize();
        let sides = [Sample { normal, colour: GREY, cover: 0.7 }; 6];
        let linear = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(2.0, 0.0, -1.0));
        let got = placed(&sides, Vec3::ONE, linear);
        // Two directions in the plane, and their cross product.
        let (u, v) = (linear * DVec3::new(1.0, 0.0, -1.0), linear * DVec3::Y);
        let expected = u.cross(v).normalize().as_vec3();
        for (side, sample) in got.iter().enumerate().filter(|it| it.1.normal.length() > 0.9) {
            let unit = sample.normal.normalize();
            assert!(unit.dot(expected).abs() > 0.9999, "{side}: {sample:?}");
        }
        assert!(got[0].normal.length() > 0.9, "{got:?}");
    }

    #[test]
    fn flat_cells_and_odd_maps_are_neither_black_nor_nan() {
        let edge_on = DMat3::from_quat(DQuat::from_rotation_y(1.0));
        for extent in [Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 1.0, 0.0), Vec3::ZERO, Vec3::splat(1e30)] {
            for linear in [DMat3::IDENTITY, edge_on, edge_on * 1e-20, DMat3::from_diagonal(DVec3::new(1e9, 1.0, 1e-9))]
            {
                for sample in placed(&cuboid(), extent, linear) {
                    assert!(sample.colour.max_element() > 0.1 && sample.colour.is_finite(), "{extent}: {sample:?}");
                    assert!(sample.normal.is_finite() && (0.0..=1.0).contains(&sample.cover), "{extent}: {sample:?}");
                }
            }
        }
    }
}
