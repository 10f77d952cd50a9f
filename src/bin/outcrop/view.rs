//! Arguments that choose a camera, and a scene with one model.

use crate::common::{self, Failure};
use glam::{DAffine3, DVec3};
use outcrop::import::{UpAxis, generate};
use outcrop::scene::{Background, Camera, Context, Light, Look, Model, Scene, SceneState, Scope};
use std::sync::Arc;

/// Arguments of the camera.
#[derive(clap::Args)]
pub struct ViewArgs {
    /// One of four views: 0 and 1 show the whole model, 2 and 3 are closer
    #[arg(
        long,
        value_name = "0..3",
        default_value_t = 0,
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(u8).range(0..=3),
        conflicts_with = "eye"
    )]
    view: u8,
    /// Use the four views of this generated model instead of those from the bounds
    #[arg(long, value_name = "NAME", value_parser = generate::NAMES, conflicts_with_all = ["eye", "up"])]
    views: Option<String>,
    /// The eye point
    #[arg(long, value_name = "X,Y,Z", value_parser = common::point, requires = "at", allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// The point that the camera looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = common::point, requires = "eye", allow_hyphen_values = true)]
    at: Option<DVec3>,
    /// Upward direction: x, y or z, or with --eye any direction. Default: the up axis of the model, or z if it has none
    /// (scans often have none; `outcrop build --up` sets it)
    #[arg(long, value_name = "AXIS or X,Y,Z", value_parser = upward, allow_hyphen_values = true)]
    up: Option<Up>,
    /// Vertical angle of view in degrees
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = degrees)]
    fov: Option<f64>,
    /// Parallel projection; the height of the picture in the model's units
    #[arg(
        long,
        value_name = "HEIGHT",
        conflicts_with = "fov",
        allow_negative_numbers = true,
        value_parser = common::positive
    )]
    ortho: Option<f64>,
}

/// Arguments that choose the visible parts.
#[derive(clap::Args, Default)]
pub struct PartArgs {
    /// Show only the parts with these ids
    #[arg(long, value_name = "ID,...", value_delimiter = ',')]
    only: Vec<u64>,
    /// Hide the parts with these ids
    #[arg(long, value_name = "ID,...", value_delimiter = ',')]
    hide: Vec<u64>,
    /// With --only and --hide: the parts below these are meant too
    #[arg(long)]
    below: bool,
}

impl PartArgs {
    fn apply(&self, scene: &Scene) -> Result<(), Failure> {
        let scope = if self.below { Scope::Below } else { Scope::Own };
        if !self.only.is_empty() {
            scene.isolate_parts(INSTANCE, &self.only, scope)?;
        }
        if !self.hide.is_empty() {
            scene.set_parts_look(INSTANCE, &self.hide, scope, Look { visible: false, ..Look::default() })?;
        }
        Ok(())
    }
}

/// Value of `--up`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Up {
    Axis(UpAxis),
    Direction(DVec3),
}

fn upward(text: &str) -> Result<Up, String> {
    Ok(match text {
        "x" => Up::Axis(UpAxis::X),
        "y" => Up::Axis(UpAxis::Y),
        "z" => Up::Axis(UpAxis::Z),
        _ => Up::Direction(common::point(text).map_err(|e| format!("{e}, or an axis: x, y or z"))?),
    })
}

/// Parses an angle of view.
fn degrees(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(degrees) if degrees > 0.0 && degrees < 180.0 => Ok(degrees),
        _ => Err("expected degrees above 0 and below 180".into()),
    }
}

/// Default vertical angle of view in degrees.
const FOV_Y: f64 = 45.0;

/// Returns the four views of the model, or those of the named generator.
pub fn four(model: &Model, generator: Option<&str>) -> [Camera; 4] {
    match generator.and_then(generate::views) {
        Some(views) => {
            views.map(|v| Camera::Perspective { eye: v.eye, at: v.at, up: v.up, fov_y_degrees: v.fov_y_degrees })
        }
        None => model.views(),
    }
}

impl ViewArgs {
    /// Returns the camera for the arguments.
    pub fn camera(&self, model: &Model) -> Result<Camera, Failure> {
        let axis = match self.up {
            Some(Up::Axis(axis)) => axis,
            Some(Up::Direction(_)) if self.eye.is_none() => {
                return Err(Failure::Usage(
                    "--up X,Y,Z requires --eye and --at; without them --up must be x, y or z".into(),
                ));
            }
            _ => model.info().up,
        };
        let up = match (self.up, axis) {
            (Some(Up::Direction(up)), _) => up,
            (_, UpAxis::X) => DVec3::X,
            (_, UpAxis::Y) => DVec3::Y,
            (_, UpAxis::Z | UpAxis::Unknown) => DVec3::Z,
        };
        let presets = if self.views.is_some() { four(model, self.views.as_deref()) } else { model.views_with(axis) };
        let preset = presets[usize::from(self.view)];
        let (eye, at, up, fov) = match (self.eye, self.at, preset) {
            (Some(eye), Some(at), _) => (eye, at, up, FOV_Y),
            (_, _, Camera::Perspective { eye, at, up, fov_y_degrees }) => (eye, at, up, fov_y_degrees),
            (_, _, Camera::Orthographic { eye, at, up, .. }) => (eye, at, up, FOV_Y),
        };
        Ok(match self.ortho {
            Some(height) => Camera::Orthographic { eye, at, up, height },
            None => Camera::Perspective { eye, at, up, fov_y_degrees: self.fov.unwrap_or(fov) },
        })
    }
}

/// Id of the only instance.
const INSTANCE: u64 = 0;

/// Returns a scene with one untransformed model.
pub fn alone(
    context: &Context,
    model: &Model,
    lights: Vec<Light>,
    background: Background,
    parts: &PartArgs,
) -> Result<Arc<SceneState>, Failure> {
    let scene = Scene::new(context);
    scene.add_instance(model, INSTANCE, DAffine3::IDENTITY)?;
    parts.apply(&scene)?;
    scene.set_lights(lights)?;
    scene.set_background(background)?;
    scene.commit()?;
    Ok(scene.state())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upward_is_an_axis_or_a_direction() {
        assert_eq!(upward("y"), Ok(Up::Axis(UpAxis::Y)));
        assert_eq!(upward("0,-1,0"), Ok(Up::Direction(-DVec3::Y)));
        assert!(upward("w").is_err() && upward("").is_err());
    }
}
