//! Cameras that show given content as large as the picture allows.
//!
//! The content is a set of boxes. Along a given view, the nearest camera that holds them depends only on their
//! supports: the greatest values of some linear functions over all corners. Each side of the frustum bounds one such
//! function, and the two sides of an axis together give the distance of the eye.

use super::camera::{Camera, axes};
use super::edit::{Scope, choose};
use super::frame::{Scenes, Search};
use super::model::Model;
use super::state::{ROUGH, SceneState};
use crate::base::error::{Error, Result};
use crate::base::units::UpAxis;
use crate::math::DBounds;
use glam::{DAffine3, DVec3};
use std::collections::HashMap;
use std::ops::Range;

/// A view with a name, relative to an up axis. Front is the side towards -Y if Z is up, +Z if Y is up, +Y if X is up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum NamedView {
    /// From the front, the right and above, all three at the same angle.
    IsoFrontRight = 0,
    /// From the front, the left and above.
    IsoFrontLeft = 1,
    /// From the back, the right and above.
    IsoBackRight = 2,
    /// From the back, the left and above.
    IsoBackLeft = 3,
    /// From the front.
    Front = 4,
    /// From the back.
    Back = 5,
    /// From the left, as seen from the front.
    Left = 6,
    /// From the right, as seen from the front.
    Right = 7,
    /// From above; the back is up in the picture.
    Top = 8,
    /// From below; the front is up in the picture.
    Bottom = 9,
}

impl NamedView {
    /// All named views, in the order of their numbers.
    pub const ALL: [Self; 10] = [
        Self::IsoFrontRight,
        Self::IsoFrontLeft,
        Self::IsoBackRight,
        Self::IsoBackLeft,
        Self::Front,
        Self::Back,
        Self::Left,
        Self::Right,
        Self::Top,
        Self::Bottom,
    ];

    /// The direction of the view, from the eye, and the direction that is up in the picture.
    pub fn directions(self, axis: UpAxis) -> (DVec3, DVec3) {
        let [right, front, up] = axes(axis);
        let (from, above) = match self {
            Self::IsoFrontRight => (front + right + up, up),
            Self::IsoFrontLeft => (front - right + up, up),
            Self::IsoBackRight => (right - front + up, up),
            Self::IsoBackLeft => (up - front - right, up),
            Self::Front => (front, up),
            Self::Back => (-front, up),
            Self::Left => (-right, up),
            Self::Right => (right, up),
            Self::Top => (up, -front),
            Self::Bottom => (-up, front),
        };
        (-from, above)
    }

    /// Returns the direction that is up in a picture along `direction`: the up axis, or that of the view from the top
    /// or from the bottom if the direction is parallel to it.
    pub fn up_along(direction: DVec3, axis: UpAxis) -> DVec3 {
        let up = axes(axis)[2];
        let unit = direction.normalize_or(DVec3::ZERO);
        match unit.dot(up) {
            along if unit.cross(up).length() > LEAST_ANGLE || along == 0.0 => up,
            along if along < 0.0 => Self::Top.directions(axis).1,
            _ => Self::Bottom.directions(axis).1,
        }
    }
}

/// Sine of the least angle between a view and the direction that is up.
const LEAST_ANGLE: f64 = 1e-6;

/// The kind of camera that is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Rays from the eye; the vertical field of view in degrees.
    Perspective(f64),
    /// Parallel rays.
    Orthographic,
}

/// A choice of content: parts of an instance, or all of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chosen {
    /// The caller's id of the instance.
    pub instance: u64,
    /// The caller's id of the part; `None` for all parts.
    pub part: Option<u64>,
}

/// The picture in which content is to fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Direction of the view, from the eye. Need not be unit.
    pub direction: DVec3,
    /// Direction that is up in the picture. Need not be perpendicular to the view, but must not be parallel to it.
    pub up: DVec3,
    /// Kind of camera.
    pub lens: Lens,
    /// Width and height of the picture in pixels.
    pub size: (u32, u32),
    /// Share of the width and of the height that stays free on each side, from 0 to below 0.5.
    pub margin: f64,
}

/// The usual [`Fit::margin`].
pub const MARGIN: f64 = 0.05;

/// Least size of what a camera is fitted to; what is smaller counts as a point. Rays are in single precision, in which
/// squares of such lengths are lost.
const LEAST_SIZE: f64 = 1e-18;

/// The instance that is chosen, or the scene in the scene, by its first instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Of {
    Instance(u64),
    Scene(u64),
}

/// Returns the chosen parts of an instance; `None` stands for all.
type ChosenOf<'a> = &'a dyn Fn(u64) -> Result<Option<Vec<u32>>>;

/// The indices of the parts that `ids` choose, among those that the model has.
fn choose_known(model: &Model, ids: &[u64], scope: Scope) -> Result<Vec<u32>> {
    let known: Vec<u64> = ids.iter().copied().filter(|id| model.part_index(*id).is_some()).collect();
    choose(model, &known, scope)
}

/// Least distance from the eye to the content, as a fraction of the content's size.
const LEAST_AHEAD: f64 = 1e-3;

impl SceneState {
    /// Returns the camera that shows the visible parts as large as the picture allows: their boxes touch the margin on
    /// two opposite sides, and lie within it on the others. `chosen`: show only these; all if empty. The boxes of parts
    /// are those of the model, placed with the instance: turned with it, not aligned to the axes again. Where scenes
    /// are in this one, the picture may leave up to a thousandth of its size more room on each side.
    ///
    /// Fails with `BadArgument` for a setting out of range or an unknown instance or part, and with `BadState` if no
    /// chosen part is visible and has triangles.
    pub fn fit(&self, fit: &Fit, chosen: &[Chosen], scope: Scope) -> Result<Camera> {
        let frame = Frame::of(fit)?;
        let mut supports = Supports::new(&frame, self.bounds().center());
        // Of boxes that stand for all in them: they let no others reach farther.
        let mut rough = Supports::new(&frame, self.bounds().center());
        if chosen.is_empty() {
            for instance in 0..self.placement.own_instances() {
                self.support(instance, self.all_parts(instance), &mut supports);
            }
            if !self.placement.has_no_scenes() {
                self.support_scenes(Search::begin(self, Scenes::VISIBLE), None, [&mut supports, &mut rough])?;
            }
        } else {
            for (of, parts) in self.chosen(chosen)? {
                let chosen = |instance: u64| {
                    let of_model = |parts: &Vec<u64>| choose_known(self.model_of_instance(instance), parts, scope);
                    parts.as_ref().map(of_model).transpose()
                };
                match of {
                    Of::Instance(instance) => match chosen(instance)? {
                        Some(parts) => self.support(instance, parts, &mut supports),
                        None => self.support(instance, self.all_parts(instance), &mut supports),
                    },
                    Of::Scene(first) => {
                        let Some(it) = self.inner_of(first) else { continue };
                        let search = Search::in_scene(self, it, Scenes::VISIBLE);
                        self.support_scenes(search, Some(&chosen), [&mut supports, &mut rough])?;
                    }
                }
            }
        }
        if supports.is_empty() {
            let what = if chosen.is_empty() { "the scene" } else { "the choice" };
            return Err(Error::BadState(format!("fit: {what} has no visible part with triangles")));
        }
        supports.join(&rough);
        Ok(supports.camera(fit, &frame))
    }

    /// Returns the ids of the chosen parts by their instance or scene; `None` stands for all parts.
    fn chosen(&self, chosen: &[Chosen]) -> Result<HashMap<Of, Option<Vec<u64>>>> {
        let mut all: HashMap<Of, Option<Vec<u64>>> = HashMap::new();
        let ids = self.instance_ids();
        for one in chosen {
            let instances = ids.with(one.instance);
            if instances.is_empty() {
                return Err(Error::bad_argument(format!("fit: instance {} does not exist", one.instance)));
            }
            let inner = self.inner_of(instances.start);
            let of = inner.map_or(Of::Instance(instances.start), |it| Of::Scene(it.first_instance));
            let has = |part: u64| match inner {
                None => self.model_of_instance(instances.start).part_index(part).is_some(),
                Some(it) => it.scene.models.iter().any(|model| model.part_index(part).is_some()),
            };
            if let Some(part) = one.part.filter(|part| !has(*part)) {
                return Err(Error::bad_argument(format!("fit: the model has no part {part}")));
            }
            let parts = all.entry(of).or_insert(Some(Vec::new()));
            match one.part {
                None => *parts = None,
                Some(part) => parts.iter_mut().for_each(|parts| parts.push(part)),
            }
        }
        Ok(all)
    }

    /// Adds the visible ones of the parts of a search, or of those that `chosen` returns for an instance.
    fn support_scenes(
        &self,
        mut search: Search,
        chosen: Option<ChosenOf>,
        [supports, rough]: [&mut Supports; 2],
    ) -> Result<()> {
        let world = supports.placed(&DAffine3::IDENTITY);
        while let Some(number) = search.next(self, |b| {
            // A box that reaches but a little beyond the rest stands for all in it: otherwise all at the bounds would
            // be visited.
            let is_far = supports.reaches(&world, b, ROUGH);
            if !is_far {
                rough.add(&world, b);
            }
            is_far
        }) {
            let p = self.ids_of(number);
            let parts = chosen.map_or(Ok(None), |chosen| chosen(p.instance))?;
            let of_tree = p.first_part..p.first_part.saturating_add(self.models[p.model as usize].local_parts(p.tree));
            match parts {
                Some(mut parts) => {
                    parts.retain(|part| of_tree.contains(part));
                    self.support(p.instance, parts, supports);
                }
                None => self.support(p.instance, of_tree, supports),
            }
        }
        Ok(())
    }

    fn all_parts(&self, instance: u64) -> Range<u32> {
        0..self.model_of_instance(instance).parts().len() as u32
    }

    /// Adds the visible ones of some parts of an instance.
    fn support(&self, instance: u64, parts: impl IntoIterator<Item = u32>, supports: &mut Supports) {
        let state = self.state_of(instance);
        if !state.look.visible {
            return;
        }
        let model = self.model_of_instance(instance);
        let placed = supports.placed(&self.world_from_model(instance));
        // Most instances of a large scene lie within the others.
        if !supports.grows(&placed, &model.info().bounds) {
            return;
        }
        let looks = &state.parts.looks;
        let mut add = |part: u32| {
            if !looks.hides(part)
                && let Some(info) = model.parts().get(part as usize)
            {
                supports.add(&placed, &info.bounds);
            }
        };
        parts.into_iter().for_each(&mut add);
    }
}

/// Returns the camera that shows all parts of a model, placed as it is; `None` if it has no triangles or a setting is
/// out of range.
pub(super) fn fit_model(model: &Model, fit: &Fit) -> Option<Camera> {
    let frame = Frame::of(fit).ok()?;
    let mut supports = Supports::new(&frame, model.info().bounds.center());
    let placed = supports.placed(&DAffine3::IDENTITY);
    model.parts().iter().for_each(|part| supports.add(&placed, &part.bounds));
    (!supports.is_empty()).then(|| supports.camera(fit, &frame))
}

/// Axes of a view, and the slopes of the frustum within the margin.
struct Frame {
    right: DVec3,
    upward: DVec3,
    forward: DVec3,
    /// Half of the width and of the height within the margin at distance 1; 0 for parallel rays.
    slopes: [f64; 2],
    aspect: f64,
    /// Share of the picture within the margin.
    inside: f64,
}

impl Frame {
    fn of(fit: &Fit) -> Result<Self> {
        let bad = |why: &str| Err(Error::bad_argument(format!("fit: {why}")));
        let (width, height) = fit.size;
        if !(1..=1 << 16).contains(&width) || !(1..=1 << 16).contains(&height) {
            return bad("the width and height of the picture must be from 1 to 65536");
        }
        if !(fit.margin >= 0.0 && fit.margin < 0.5) {
            return bad("the margin must be from 0 to below 0.5");
        }
        let unit = |v: DVec3| if v.is_finite() { v.try_normalize() } else { None };
        let Some(forward) = unit(fit.direction) else { return bad("the direction must be finite and not zero") };
        let across = unit(fit.up).map(|up| forward.cross(up));
        let Some(right) = across.filter(|a| a.length() > LEAST_ANGLE).and_then(DVec3::try_normalize) else {
            return bad("up must be finite, not zero and not parallel to the direction");
        };
        let (aspect, inside) = (f64::from(width) / f64::from(height), 1.0 - 2.0 * fit.margin);
        let tangent = match fit.lens {
            Lens::Orthographic => 0.0,
            Lens::Perspective(degrees) if degrees > 0.0 && degrees < 180.0 => (degrees.to_radians() * 0.5).tan(),
            Lens::Perspective(_) => return bad("the angle of view must be above 0 and below 180 degrees"),
        };
        let slopes = [tangent * aspect * inside, tangent * inside];
        Ok(Self { right, upward: right.cross(forward), forward, slopes, aspect, inside })
    }
}

/// The supports of boxes in the directions of the frustum's sides and of the axes.
struct Supports {
    /// Right, left, upper and lower side; then right, left, up, down, towards the eye and away from it.
    directions: [DVec3; SUPPORTS],
    /// Greatest product of each direction with a corner; -infinity before there is one.
    most: [f64; SUPPORTS],
    /// Corners are relative to this point, for their digits.
    origin: DVec3,
}

const SUPPORTS: usize = 10;

/// The directions of [`Supports`] in the frame of placed boxes, and their products with its origin.
struct PlacedSupports([(DVec3, f64); SUPPORTS]);

impl Supports {
    fn new(frame: &Frame, origin: DVec3) -> Self {
        let [wide, high] = frame.slopes.map(|slope| frame.forward * slope);
        let (right, upward, forward) = (frame.right, frame.upward, frame.forward);
        let sides = [right - wide, -right - wide, upward - high, -upward - high];
        let axes = [right, -right, upward, -upward, -forward, forward];
        let directions = std::array::from_fn(|i| if i < 4 { sides[i] } else { axes[i - 4] });
        let origin = if origin.is_finite() { origin } else { DVec3::ZERO };
        Self { directions, most: [f64::NEG_INFINITY; SUPPORTS], origin }
    }

    fn is_empty(&self) -> bool {
        self.most[0] == f64::NEG_INFINITY
    }

    fn placed(&self, world_from_model: &DAffine3) -> PlacedSupports {
        let (turned, offset) = (world_from_model.matrix3.transpose(), world_from_model.translation - self.origin);
        PlacedSupports(self.directions.map(|direction| (turned * direction, direction.dot(offset))))
    }

    /// The supports of one box.
    fn of(placed: &PlacedSupports, bounds: &DBounds) -> [f64; SUPPORTS] {
        let (center, half) = (bounds.center(), bounds.extent() * 0.5);
        placed.0.map(|(direction, offset)| direction.dot(center) + offset + direction.abs().dot(half))
    }

    /// True if a box is not within the supports.
    fn grows(&self, placed: &PlacedSupports, bounds: &DBounds) -> bool {
        !bounds.is_empty() && Self::of(placed, bounds).iter().zip(&self.most).any(|(new, most)| new > most)
    }

    fn join(&mut self, other: &Self) {
        self.most.iter_mut().zip(&other.most).for_each(|(most, new)| *most = most.max(*new));
    }

    /// True if a box is beyond the supports by more than a fraction of their greatest width.
    fn reaches(&self, placed: &PlacedSupports, bounds: &DBounds, fraction: f64) -> bool {
        let width = [4, 6, 8].iter().map(|&axis| self.most[axis] + self.most[axis + 1]).fold(0.0, f64::max);
        Self::of(placed, bounds).iter().zip(&self.most).any(|(new, most)| *new > most + width * fraction)
    }

    fn add(&mut self, placed: &PlacedSupports, bounds: &DBounds) {
        if !bounds.is_empty() {
            self.most.iter_mut().zip(Self::of(placed, bounds)).for_each(|(most, new)| *most = most.max(new));
        }
    }

    /// The camera whose frustum the boxes touch. A corner p is inside if p·right - eye·right is at most slope times its
    /// distance ahead of the eye, on each side; the sum over two opposite sides leaves the place of the eye along the
    /// view, the difference that across it.
    fn camera(&self, fit: &Fit, frame: &Frame) -> Camera {
        let [right, left, upper, lower, .., near, far] = self.most;
        let across = frame.right * ((right - left) * 0.5) + frame.upward * ((upper - lower) * 0.5);
        let place = |ahead: f64| self.origin + across + frame.forward * ahead;
        let [wide, high, depth] = [4, 6, 8].map(|axis| self.most[axis] + self.most[axis + 1]);
        // Points have no size: any does that leaves enough digits.
        let size = wide.max(high).max(depth);
        let reach = place(0.0).abs().max_element();
        let is_point = size <= (reach * 1e-12).max(LEAST_SIZE);
        let size = if is_point { (reach * 1e-6).max(1.0) } else { size };
        let at = place((far - near) * 0.5);
        match fit.lens {
            Lens::Perspective(fov_y_degrees) => {
                let [wide_slope, high_slope] = frame.slopes;
                let ahead = (-(right + left) / wide_slope).min(-(upper + lower) / high_slope) * 0.5;
                let least = if is_point { size } else { size * LEAST_AHEAD };
                let eye = place(ahead.min(-near - least));
                Camera::Perspective { eye, at, up: fit.up, fov_y_degrees }
            }
            Lens::Orthographic => {
                let height = high.max(wide / frame.aspect) / frame.inside;
                let height = if height > size * 1e-9 { height } else { size };
                Camera::Orthographic { eye: place(-near - size), at, up: fit.up, height }
            }
        }
    }
}
