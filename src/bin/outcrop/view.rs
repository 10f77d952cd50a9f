//! Arguments that choose a camera, and what a command shows: a model, or the scene of a scene file.

use crate::common::{self, Failure};
use glam::{DAffine3, DVec3};
use outcrop::Error;
use outcrop::import::{UpAxis, generate};
use outcrop::scene::camera::{FOV_Y as PRESET_FOV_Y, default_directions};
use outcrop::scene::{Camera, Context, Fit, Lens, Look, MARGIN, Model, NamedView, Scene, Scope};
use outcrop::store::FileSource;
use outcrop::store::scene_file::is_scene_file;
use std::path::Path;

/// Arguments of the camera.
#[derive(clap::Args)]
pub struct ViewArgs {
    /// One of four views: 0 and 1 show the visible parts as large as the picture allows, 2 and 3 are closer. Or a view
    /// that shows them likewise: front, back, left, right, top, bottom, iso (from the front, the right and above),
    /// iso-front-left, iso-back-right, iso-back-left
    #[arg(
        long,
        value_name = "0..3 or NAME",
        default_value = "0",
        allow_negative_numbers = true,
        value_parser = view,
        conflicts_with = "eye"
    )]
    view: View,
    /// Use the four views of this generated model instead of those from the bounds
    #[arg(long, value_name = "NAME", value_parser = generate::NAMES_WITH_VIEWS, conflicts_with_all = ["eye", "up"])]
    views: Option<String>,
    /// The eye point
    #[arg(long, value_name = "X,Y,Z", value_parser = common::point, requires = "at", allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// The point that the camera looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = common::point, requires = "eye", allow_hyphen_values = true)]
    at: Option<DVec3>,
    /// Upward direction: x, y or z, or with --eye any direction. Default: the up axis of the models, or z if they have
    /// none (scans often have none; `outcrop build --up` sets it)
    #[arg(long, value_name = "AXIS or X,Y,Z", value_parser = upward, allow_hyphen_values = true)]
    up: Option<Up>,
    /// Vertical angle of view in degrees
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = degrees)]
    fov: Option<f64>,
    /// Parallel projection; the height of the picture in the model's units, or "fit": as the view shows all
    #[arg(
        long,
        value_name = "HEIGHT or fit",
        conflicts_with = "fov",
        allow_negative_numbers = true,
        value_parser = ortho
    )]
    ortho: Option<Ortho>,
}

/// Value of `--view`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum View {
    Number(u8),
    Named(NamedView),
}

/// Names of views, in the order of [`NamedView::ALL`].
const NAMES: [&str; 10] =
    ["iso", "iso-front-left", "iso-back-right", "iso-back-left", "front", "back", "left", "right", "top", "bottom"];

fn view(text: &str) -> Result<View, String> {
    match text.parse() {
        Ok(number @ 0..=3) => Ok(View::Number(number)),
        _ => match NAMES.iter().position(|name| *name == text) {
            Some(at) => Ok(View::Named(NamedView::ALL[at])),
            None => Err(format!("expected a number from 0 to 3, or one of {}", NAMES.join(", "))),
        },
    }
}

/// Value of `--ortho`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ortho {
    Height(f64),
    Fit,
}

fn ortho(text: &str) -> Result<Ortho, String> {
    match text {
        "fit" => Ok(Ortho::Fit),
        _ => common::positive(text).map(Ortho::Height).map_err(|why| format!("{why}, or \"fit\"")),
    }
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
    /// Returns the camera for the arguments, for a picture of a size.
    pub fn camera(&self, shown: &Shown, size: (u32, u32)) -> Result<Camera, Failure> {
        let axis = match self.up {
            Some(Up::Axis(axis)) => axis,
            Some(Up::Direction(_)) if self.eye.is_none() => {
                return Err(Failure::Usage(
                    "--up X,Y,Z requires --eye and --at; without them --up must be x, y or z".into(),
                ));
            }
            _ => shown.up(),
        };
        let up = match (self.up, axis) {
            (Some(Up::Direction(up)), _) => up,
            (_, UpAxis::X) => DVec3::X,
            (_, UpAxis::Y) => DVec3::Y,
            (_, UpAxis::Z | UpAxis::Unknown) => DVec3::Z,
        };
        let preset = self.preset(shown, axis, size)?;
        let (eye, at, up, fov) = match (self.eye, self.at, preset) {
            (Some(eye), Some(at), _) => (eye, at, up, FOV_Y),
            (_, _, Camera::Perspective { eye, at, up, fov_y_degrees }) => (eye, at, up, fov_y_degrees),
            (_, _, Camera::Orthographic { eye, at, up, .. }) => (eye, at, up, FOV_Y),
        };
        Ok(match self.ortho {
            Some(Ortho::Height(height)) => Camera::Orthographic { eye, at, up, height },
            Some(Ortho::Fit) => match preset {
                Camera::Orthographic { .. } if self.eye.is_none() => preset,
                _ => return Err(Failure::Usage("--ortho fit requires --view 0, 1 or a name".into())),
            },
            None => Camera::Perspective { eye, at, up, fov_y_degrees: self.fov.unwrap_or(fov) },
        })
    }
}

impl ViewArgs {
    /// Returns the camera that `--view` names, before the other arguments change it.
    fn preset(&self, shown: &Shown, axis: UpAxis, size: (u32, u32)) -> Result<Camera, Failure> {
        let (direction, up) = match (self.view, self.views.as_deref()) {
            (View::Number(number), Some(of)) => match &shown.model {
                Some(model) => return Ok(four(model, Some(of))[usize::from(number)]),
                None => return Err(Failure::Usage("--views requires a model, not a scene".into())),
            },
            (View::Named(_), Some(_)) => return Err(Failure::Usage("--views requires --view 0, 1, 2 or 3".into())),
            (View::Number(number @ 2..), None) => return Ok(shown.views(axis)[usize::from(number)]),
            (View::Number(number), None) => {
                (-default_directions(axis)[usize::from(number)], NamedView::Front.directions(axis).1)
            }
            (View::Named(view), None) => view.directions(axis),
        };
        let lens = match self.ortho {
            Some(_) => Lens::Orthographic,
            None => Lens::Perspective(self.fov.unwrap_or(PRESET_FOV_Y)),
        };
        let fit = Fit { direction, up, lens, size, margin: MARGIN };
        match shown.scene.state().fit(&fit, &[], Scope::Own) {
            // Nothing is visible from anywhere.
            Err(Error::BadState(_)) => Ok(shown.views(axis)[0]),
            camera => Ok(camera?),
        }
    }
}

/// What a command shows.
pub struct Shown {
    /// The only model, if the file is that of a model.
    pub model: Option<Model>,
    /// The committed scene.
    pub scene: Scene,
}

impl Shown {
    /// Opens a model file or a scene file.
    pub fn open(context: &Context, path: &Path, parts: &PartArgs) -> Result<Self, Failure> {
        if !is_scene_file(&FileSource::open(path)?)? {
            let model = Model::open(context, path)?;
            let scene = alone(context, &model, parts)?;
            return Ok(Self { model: Some(model), scene });
        }
        if !(parts.only.is_empty() && parts.hide.is_empty()) {
            return Err(Failure::Usage("--only and --hide require a model, not a scene".into()));
        }
        Ok(Self { model: None, scene: Scene::open(context, path)? })
    }

    fn up(&self) -> UpAxis {
        self.model.as_ref().map_or_else(|| self.scene.state().up(), |model| model.info().up)
    }

    fn views(&self, up: UpAxis) -> [Camera; 4] {
        self.model.as_ref().map_or_else(|| self.scene.state().views_with(up), |model| model.views_with(up))
    }
}

/// Id of the only instance.
const INSTANCE: u64 = 0;

/// Returns a committed scene with one untransformed model.
pub fn alone(context: &Context, model: &Model, parts: &PartArgs) -> Result<Scene, Failure> {
    let scene = Scene::new(context);
    scene.add_instance(model, INSTANCE, DAffine3::IDENTITY)?;
    parts.apply(&scene)?;
    scene.commit()?;
    Ok(scene)
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

    #[test]
    fn views_are_numbers_or_names() {
        assert_eq!((view("3"), view("top")), (Ok(View::Number(3)), Ok(View::Named(NamedView::Top))));
        assert_eq!(view("iso"), Ok(View::Named(NamedView::IsoFrontRight)));
        assert!(["4", "-1", "", "above"].iter().all(|bad| view(bad).is_err()));
        assert_eq!((ortho("fit"), ortho("2.5")), (Ok(Ortho::Fit), Ok(Ortho::Height(2.5))));
        assert!(["0", "-1", "all"].iter().all(|bad| ortho(bad).is_err()));
    }
}
