//! Rays of a packet in rows, and their way into the frames of placed trees, all at once.
#![allow(clippy::needless_range_loop)] // loops index several arrays at once

use super::placed::Placed;
use crate::math::{Cone, PACKET, Ray, bits};
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::{LocalRay, LocalRays, USUAL_DIRS};
use glam::{DVec3, Vec3};

/// Rays in the world, one column each. Columns that are not set hold arbitrary values.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(crate) struct RayRows {
    pub origin: [[f64; PACKET]; 3],
    pub dir: [[f32; PACKET]; 3],
    pub t_min: [f64; PACKET],
    /// Widths at the origins, and their growth for each unit of distance.
    pub cone: [[f32; PACKET]; 2],
}

impl RayRows {
    pub const NONE: Self =
        Self { origin: [[0.0; PACKET]; 3], dir: [[0.0; PACKET]; 3], t_min: [0.0; PACKET], cone: [[0.0; PACKET]; 2] };

    /// Sets ray `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, ray: &Ray) {
        (self.origin[0][i], self.origin[1][i], self.origin[2][i]) = (ray.origin.x, ray.origin.y, ray.origin.z);
        (self.dir[0][i], self.dir[1][i], self.dir[2][i]) = (ray.dir.x, ray.dir.y, ray.dir.z);
        (self.cone[0][i], self.cone[1][i]) = (ray.cone.a, ray.cone.b);
        self.t_min[i] = ray.t_min;
    }

    #[inline(always)]
    pub fn origin(&self, i: usize) -> DVec3 {
        DVec3::new(self.origin[0][i], self.origin[1][i], self.origin[2][i])
    }

    #[inline(always)]
    pub fn dir(&self, i: usize) -> Vec3 {
        Vec3::new(self.dir[0][i], self.dir[1][i], self.dir[2][i])
    }

    #[inline(always)]
    pub fn cone(&self, i: usize) -> Cone {
        Cone { a: self.cone[0][i], b: self.cone[1][i] }
    }

    /// Takes the rays of `among`, up to the distances `best`, into the frame of a placed tree, as [`Placed::local`]
    /// does; `beyond`: see there. Returns those that have the same distances there as in the world; the others need
    /// that function.
    #[inline(always)]
    pub fn take_into_tree(
        &self,
        isa: Isa,
        placed: &Placed,
        among: u32,
        (best, beyond): (&[f64; PACKET], bool),
        out: &mut LocalRays<PACKET>,
    ) -> u32 {
        among & dispatch(isa, IntoTree { rays: self, placed, best, beyond, out })
    }

    /// [`RayRows::take_into_tree`] of all rays of `among`. Calls `moved` for those that have other distances there,
    /// with shift and scale: see [`Placed::local`]. Returns the rays that may hit something in the tree; the others of
    /// `among` are [`LocalRay::NONE`] there.
    #[inline(always)]
    pub fn take_all_into_tree(
        &self,
        isa: Isa,
        placed: &Placed,
        among: u32,
        (best, beyond): (&[f64; PACKET], bool),
        out: &mut LocalRays<PACKET>,
        mut moved: impl FnMut(usize, (f64, f64)),
    ) -> u32 {
        let mut inside = self.take_into_tree(isa, placed, among, (best, beyond), out);
        for i in bits(among & !inside) {
            let ray = Ray {
                t_min: self.t_min[i],
                t_max: best[i],
                cone: self.cone(i),
                ..Ray::new(self.origin(i), self.dir(i))
            };
            let mut local = LocalRay::NONE;
            if let Some(way) = placed.local(&ray, best[i], beyond, &mut local) {
                moved(i, way);
                inside |= 1 << i;
            }
            out.set(i, &local);
        }
        inside
    }
}

struct IntoTree<'a> {
    rays: &'a RayRows,
    placed: &'a Placed,
    best: &'a [f64; PACKET],
    beyond: bool,
    out: &'a mut LocalRays<PACKET>,
}

impl Op for IntoTree<'_> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        // A frame that is only translated changes neither directions nor widths.
        if self.placed.only_shifted().is_some() { into_tree::<false>(self) } else { into_tree::<true>(self) }
    }
}

#[inline(always)]
fn into_tree<const IS_TURNED: bool>(IntoTree { rays, placed, best, beyond, out }: IntoTree) -> u32 {
    // A local copy is known not to change while the columns are written.
    let placed = *placed;
    let (mut org_size, mut dir_size) = ([0.0; PACKET], [0.0; PACKET]);
    for i in 0..PACKET {
        let org = placed.local_point(rays.origin(i));
        org_size[i] = org.abs().max_element();
        let org = org.as_vec3();
        (out.org[0][i], out.org[1][i], out.org[2][i]) = (org.x, org.y, org.z);
    }
    if IS_TURNED {
        for i in 0..PACKET {
            let dir = placed.local_vector(rays.dir(i).as_dvec3());
            dir_size[i] = dir.abs().max_element();
            let dir = dir.as_vec3();
            (out.dir[0][i], out.dir[1][i], out.dir[2][i]) = (dir.x, dir.y, dir.z);
        }
    } else {
        out.dir = rays.dir;
        for i in 0..PACKET {
            dir_size[i] = f64::from(rays.dir(i).abs().max_element());
        }
    }
    for i in 0..PACKET {
        let ends = placed.rounded([rays.t_min[i], best[i]], org_size[i], dir_size[i], beyond);
        (out.t_min[i], out.t_max[i]) = (ends[0], ends[1]);
    }
    for i in 0..PACKET {
        let dir = Vec3::new(out.dir[0][i], out.dir[1][i], out.dir[2][i]);
        let cone = LocalRay::cone_of(placed.local_cone(rays.cone(i)), dir);
        (out.cone[0][i], out.cone[1][i]) = (cone.a, cone.b);
    }
    let mut is_same = [0; PACKET];
    for i in 0..PACKET {
        let is_near = placed.is_near_by(org_size[i]);
        let is_usual = USUAL_DIRS.contains(&(dir_size[i] as f32));
        // The interval is not empty, as in `Ray::has_interval`.
        let is_some = (rays.t_min[i].abs() < f64::INFINITY) & (rays.t_min[i].max(0.0) <= best[i]);
        is_same[i] = u32::from(is_near & is_usual & is_some) << i;
    }
    is_same.iter().fold(0, |all, it| all | it)
}
