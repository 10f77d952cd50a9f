//! Where a setting places the model, and from where it is seen.

use crate::failure::Failure;
use glam::{DAffine3, DMat3, DVec3};
use outcrop::math::DBounds;
use outcrop::scene::Camera;

/// Places of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placing {
    /// At the origin, as it is stored.
    Once,
    /// Turned about an axis that is along none of the world's; the camera is turned with it.
    Turned,
    /// Reflected at a plane that is along none of the world's; the camera likewise, so that the picture is the mirror
    /// image.
    Mirrored,
    /// At the origin, and again far behind the eye.
    Far,
    /// [`GRID`] by [`GRID`] copies side by side, seen from outside.
    Grid,
    /// Such a grid of turned copies, every other one mirrored, and one far behind the eye.
    All,
}

/// Copies along each side of a grid.
const GRID: usize = 4;

/// Distance of neighbours in a grid, in the model's size.
const APART: f64 = 1.1;

/// How far behind the eye the second instance is, in the model's size.
const FAR: f64 = 30.0;

/// Vertical angle of the view of a grid, degrees.
const FOV_Y: f64 = 40.0;

fn turned() -> DMat3 {
    DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7)
}

fn mirrored() -> DMat3 {
    let n = DVec3::new(2.0, -1.0, 0.5).normalize();
    DMat3::from_cols(DVec3::X - 2.0 * n.x * n, DVec3::Y - 2.0 * n.y * n, DVec3::Z - 2.0 * n.z * n)
}

/// What a picture shows and from where.
#[derive(Debug, Clone)]
pub struct Placed {
    pub places: Vec<DAffine3>,
    pub camera: Camera,
    /// Diagonal of what is in sight.
    pub size: f64,
}

impl Placing {
    /// The places of a model with these bounds that `camera` looks at; `outside`: a camera that looks at it from
    /// outside, for grids.
    pub fn of(self, bounds: &DBounds, camera: &Camera, outside: &Camera) -> Result<Placed, Failure> {
        let size = bounds.extent().length();
        let (eye, at, _) = sight(camera)?;
        let origin = DAffine3::IDENTITY;
        let once = |place: DAffine3| Placed { places: vec![place], camera: seen_through(camera, place.matrix3), size };
        Ok(match self {
            Placing::Once => once(origin),
            Placing::Turned => once(DAffine3::from_mat3(turned())),
            Placing::Mirrored => once(DAffine3::from_mat3(mirrored())),
            Placing::Far => {
                let away = DAffine3::from_translation((eye - at).normalize() * FAR * size);
                Placed { places: vec![origin, away], camera: *camera, size }
            }
            Placing::Grid => grid(bounds, outside, |_| DMat3::IDENTITY)?,
            Placing::All => {
                let mut all = grid(bounds, outside, |i| if i % 2 == 0 { turned() } else { turned() * mirrored() })?;
                let (eye, at, _) = sight(&all.camera)?;
                all.places.push(DAffine3::from_translation((eye - at).normalize() * FAR * all.size));
                all
            }
        })
    }
}

/// A grid in the plane across the camera's upward axis; each copy is turned about its middle.
fn grid(bounds: &DBounds, outside: &Camera, turn: impl Fn(usize) -> DMat3) -> Result<Placed, Failure> {
    let (eye, at, up) = sight(outside)?;
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let across: Vec<DVec3> = axes.into_iter().filter(|axis| axis.dot(up).abs() < 0.5).collect();
    let [first, second] = across[..] else { return Err(Failure::new("a grid needs an upward axis")) };
    let (middle, extent) = (bounds.center(), bounds.extent());
    let is_turned = turn(0) != DMat3::IDENTITY;
    let step = |axis: DVec3| APART * if is_turned { extent.length() } else { axis.dot(extent) };
    let off = |i: usize| i as f64 - 0.5 * (GRID - 1) as f64;
    let places: Vec<DAffine3> = (0..GRID * GRID)
        .map(|i| {
            let at = first * (step(first) * off(i % GRID)) + second * (step(second) * off(i / GRID));
            // Neighbours differ: rows begin in turn.
            let turn = turn(i + i / GRID);
            DAffine3::from_mat3_translation(turn, middle + at - turn * middle)
        })
        .collect();
    let wide = GRID as f64 * DVec3::new(step(first), step(second), 0.0).length();
    let size = wide.hypot(extent.length());
    let distance = 0.5 * size / (0.5 * FOV_Y.to_radians()).sin();
    let eye = middle + (eye - at).normalize() * distance;
    Ok(Placed { places, camera: Camera::Perspective { eye, at: middle, up, fov_y_degrees: FOV_Y }, size })
}

/// Eye, target and upward direction of a perspective camera.
fn sight(camera: &Camera) -> Result<(DVec3, DVec3, DVec3), Failure> {
    match *camera {
        Camera::Perspective { eye, at, up, .. } => Ok((eye, at, up)),
        Camera::Orthographic { .. } => Err(Failure::new("settings start from perspective views")),
    }
}

fn seen_through(camera: &Camera, turn: DMat3) -> Camera {
    match *camera {
        Camera::Perspective { eye, at, up, fov_y_degrees } => {
            Camera::Perspective { eye: turn * eye, at: turn * at, up: turn * up, fov_y_degrees }
        }
        Camera::Orthographic { eye, at, up, height } => {
            Camera::Orthographic { eye: turn * eye, at: turn * at, up: turn * up, height }
        }
    }
}

/// The parallel view that shows what is at the target as large as a perspective one does. From within a model it shows
/// as little as keeps the plane of the picture inside.
pub fn parallel(camera: &Camera, bounds: &DBounds, is_within: bool) -> Camera {
    match *camera {
        Camera::Perspective { eye, at, up, fov_y_degrees } => {
            let whole = 2.0 * (0.5 * fov_y_degrees.to_radians()).tan() * eye.distance(at);
            let inside = 0.5 * bounds.extent().min_element();
            Camera::Orthographic { eye, at, up, height: if is_within { inside } else { whole } }
        }
        parallel => parallel,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turned_pictures_show_the_same_and_grids_are_in_sight() {
        let bounds = DBounds { min: DVec3::ZERO, max: DVec3::new(3.0, 2.0, 1.0) };
        let eye = DVec3::new(9.0, 7.0, 5.0);
        let camera = Camera::Perspective { eye, at: bounds.center(), up: DVec3::Z, fov_y_degrees: 40.0 };
        let rays = camera.prepare(64, 48).expect("rays");
        for (placing, is_mirrored) in [(Placing::Turned, false), (Placing::Mirrored, true)] {
            let Placed { places, camera, .. } = placing.of(&bounds, &camera, &camera).expect("places");
            let seen = camera.prepare(64, 48).expect("rays");
            let there = seen.ray(if is_mirrored { 54.0 } else { 10.0 }, 20.0);
            let here = rays.ray(10.0, 20.0);
            let wanted = places[0].transform_vector3(here.dir.as_dvec3());
            assert!(there.dir.as_dvec3().distance(wanted) < 1e-6, "{placing:?}");
            assert!(there.origin.distance(places[0].transform_point3(here.origin)) < 1e-9);
        }
        for placing in [Placing::Grid, Placing::All] {
            let Placed { places, camera, .. } = placing.of(&bounds, &camera, &camera).expect("places");
            let seen = camera.prepare(640, 480).expect("rays");
            for place in &places[..16] {
                let middle = place.transform_point3(bounds.center());
                let around = DBounds { min: middle - 1.0, max: middle + 1.0 };
                let [least, most] = seen.rectangle_of(&around).expect("in front of the eye");
                assert!(least.min_element() >= 0.0 && most.x <= 640.0 && most.y <= 480.0, "{placing:?} {least} {most}");
            }
            assert_eq!(places.len(), if placing == Placing::All { 17 } else { 16 });
        }
    }
}
