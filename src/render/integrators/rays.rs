//! The rays of a packet's pixels, one column each.
#![allow(clippy::needless_range_loop)] // each loop indexes several arrays

use super::direct::{Direct, Pixels};
use super::shading::{Row, Vectors};
use crate::math::{Cone, PACKET, Ray, bits};
use crate::scene::camera::PixelRays;
use crate::scene::group::CameraRays;
use crate::scene::ray_rows::RayRows;
use crate::scene::widths::Width;
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::PacketWalk;
use glam::{DVec3, Vec3};

/// Rays of a camera that go on behind transparent surfaces. Directions are unit up to rounding; widths include pixels
/// of error.
#[derive(Clone)]
pub(super) struct CameraPacket {
    rows: RayRows,
    /// The common origin of all rays, if they share one: the origins of the rows are then arbitrary.
    eye: Option<DVec3>,
}

impl CameraPacket {
    pub const NONE: Self = Self { rows: RayRows::NONE, eye: None };

    /// The direction of ray `i`.
    #[inline(always)]
    pub fn dir(&self, i: usize) -> Vec3 {
        self.rows.dir(i)
    }

    /// The directions, axis by axis.
    pub fn dirs(&self) -> &Vectors {
        &self.rows.dir
    }

    /// The common origin of all rays, if they share one.
    pub fn eye(&self) -> Option<DVec3> {
        self.eye
    }

    /// The origin of ray `i`.
    #[inline(always)]
    pub fn origin(&self, i: usize) -> DVec3 {
        self.eye.unwrap_or(self.rows.origin(i))
    }

    /// Distances at which the rays begin.
    pub fn begins(&self) -> &Row<f64> {
        &self.rows.t_min
    }

    /// Ray `i` goes on from distance `t`.
    pub fn go_on(&mut self, i: usize, t: f64) {
        self.rows.t_min[i] = t;
    }

    /// Ray `i`.
    #[inline(always)]
    pub fn ray(&self, i: usize) -> Ray {
        Ray { t_min: self.rows.t_min[i], cone: self.rows.cone(i), ..Ray::new(self.origin(i), self.dir(i)) }
    }

    /// The width of ray `i` at distance `t`.
    #[inline(always)]
    pub fn width(&self, i: usize, t: f64) -> f32 {
        self.rows.cone[0][i] + self.rows.cone[1][i] * t as f32
    }

    /// The rays of `among`, and [`Ray::NONE`] for the others.
    pub fn of(&self, among: u32) -> [Ray; PACKET] {
        let mut rays = [Ray::NONE; PACKET];
        bits(among).for_each(|i| rays[i] = self.ray(i));
        rays
    }

    /// The rays for [`crate::scene::group::CameraTree`].
    pub fn of_camera(&mut self) -> CameraRays<'_> {
        self.fill_origins();
        CameraRays { rays: &self.rows, eye: self.eye }
    }

    /// Takes directions and widths over from a walk in a frame that is only translated.
    pub fn take(&mut self, eye: DVec3, walk: &PacketWalk) {
        (self.eye, self.rows.t_min) = (Some(eye), [0.0; PACKET]);
        (self.rows.dir, self.rows.cone) = (*walk.dirs(), *walk.cones());
    }

    /// Least and greatest origin and direction.
    pub fn extremes(&self, isa: Isa) -> ([DVec3; 2], [[f32; 2]; 3]) {
        let (origins, dirs) = dispatch(isa, Extremes(self));
        (self.eye.map_or(origins, |eye| [eye; 2]), dirs)
    }

    /// A bound of the widths of the rays.
    pub fn widest(&self) -> Width {
        let greatest = |row: &[f32; PACKET]| row.iter().fold(0.0, |greatest: f32, width| greatest.max(*width));
        let [a, b] = &self.rows.cone;
        Width::of_units(Cone { a: greatest(a), b: greatest(b) })
    }

    /// Gives each ray an origin of its own, if they share one.
    pub fn spread(&mut self) {
        self.fill_origins();
        self.eye = None;
    }

    /// Sets the origins of the rows to the eye, if the rays share one.
    fn fill_origins(&mut self) {
        if let Some(eye) = self.eye {
            self.rows.origin = eye.to_array().map(|x| [x; PACKET]);
        }
    }

    /// Moves the beginning of ray `i` by `ahead` along `dir`, its direction with all digits. Only after
    /// [`CameraPacket::spread`].
    pub fn advance(&mut self, i: usize, dir: DVec3, ahead: f64) {
        let (origin, rows) = (self.origin(i) + dir * ahead, &mut self.rows);
        (rows.origin[0][i], rows.origin[1][i], rows.origin[2][i]) = (origin.x, origin.y, origin.z);
        rows.cone[0][i] += rows.cone[1][i] * ahead as f32;
        rows.t_min[i] -= ahead;
    }
}

impl Direct<'_> {
    /// Computes the rays of a packet's pixels.
    pub(super) fn make_rays(&self, pixels: &Pixels, rays: &mut CameraPacket) {
        rays.rows.t_min = [0.0; PACKET];
        rays.eye = self.rays.is_perspective().then_some(self.rays.eye());
        if rays.eye.is_some() {
            dispatch(self.isa(), FromEye { camera: self.rays, pixels, rays: &mut rays.rows });
        } else {
            dispatch(self.isa(), Parallel { camera: self.rays, pixels, rays: &mut rays.rows });
        }
    }
}

/// See [`CameraPacket::extremes`]; the origins are those of the rows.
struct Extremes<'a>(&'a CameraPacket);

impl Op for Extremes<'_> {
    type Out = ([DVec3; 2], [[f32; 2]; 3]);

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Self::Out {
        let CameraPacket { rows, eye } = self.0;
        let dirs = rows.dir.each_ref().map(|row| [least(row, |a, b| a < b), least(row, |a, b| a > b)]);
        if eye.is_some() {
            return ([DVec3::ZERO; 2], dirs);
        }
        let origins = rows.origin.each_ref().map(|row| [least(row, |a, b| a < b), least(row, |a, b| a > b)]);
        let [x, y, z] = origins;
        ([DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1])], dirs)
    }
}

/// The element of a row that comes before all others, found in halves that the compiler vectorises.
#[inline(always)]
fn least<T: Copy>(row: &Row<T>, before: impl Fn(T, T) -> bool) -> T {
    let (mut all, mut half) = (*row, PACKET / 2);
    while half > 0 {
        for i in 0..half {
            all[i] = if before(all[i + half], all[i]) { all[i + half] } else { all[i] };
        }
        half /= 2;
    }
    all[0]
}

/// The rays of a perspective camera.
struct FromEye<'a> {
    camera: &'a PixelRays,
    pixels: &'a Pixels,
    rays: &'a mut RayRows,
}

impl Op for FromEye<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { camera, pixels, rays: RayRows { dir, cone: [near, width], .. } } = self;
        // The copies are constant while the rows are written.
        let (camera, pixels) = (*camera, *pixels);
        for i in 0..PACKET {
            let (x, y) = pixels.point(i);
            let (to, one) = camera.toward(x, y);
            (dir[0][i], dir[1][i], dir[2][i], width[i]) = (to.x, to.y, to.z, one);
        }
        *near = [0.0; PACKET];
        widen(&pixels, width);
    }
}

/// The rays of an orthographic camera.
struct Parallel<'a> {
    camera: &'a PixelRays,
    pixels: &'a Pixels,
    rays: &'a mut RayRows,
}

impl Op for Parallel<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { camera, pixels, rays: RayRows { dir, origin, cone: [width, growth], .. } } = self;
        let (camera, pixels) = (*camera, *pixels);
        let (to, wide) = (camera.forward().as_vec3(), camera.pixel_width(0.0) as f32);
        for i in 0..PACKET {
            let (x, y) = pixels.point(i);
            let from = camera.origin(x, y);
            (origin[0][i], origin[1][i], origin[2][i]) = (from.x, from.y, from.z);
        }
        *dir = [[to.x; PACKET], [to.y; PACKET], [to.z; PACKET]];
        (*width, *growth) = ([wide; PACKET], [0.0; PACKET]);
        widen(&pixels, width);
    }
}

/// Multiplies widths by the factors of their pixels.
#[inline(always)]
fn widen(pixels: &Pixels, width: &mut Row<f32>) {
    let mut steps = [0; PACKET];
    for i in 0..PACKET {
        steps[i] = pixels.step(i);
    }
    // A separate loop, because it reads a table.
    for i in 0..PACKET {
        width[i] *= pixels.width(steps[i]);
    }
}
