//! NURBS surfaces from the caller's memory.

use super::build::{oc_build, with_input};
use super::guard::{Sized32, Strided, bad, boundary, read};
use super::status::oc_status;
use crate::import::surfaces::{MAX_DEGREE, NurbsDesc};
use crate::import::{NurbsMesh, Sink};
use glam::DVec3;

/// A NURBS surface without trims, rational or not. The arrays are read during the call, and are tightly packed. They
/// may have any alignment.
///
/// The surface covers the parameters from `knots_u[degree_u]` to `knots_u[count_u]`, and likewise in v. A periodic
/// surface repeats its first control points at the end.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_nurbs {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// 0: the surface is placed directly. Otherwise: number of a shared mesh from oc_build_add_shared_mesh.
    pub mesh: u32,
    /// The part that the surface belongs to. Placed directly: the id of the part. Shared mesh: the number of the part,
    /// from 0.
    pub part: u64,
    /// Degree along u, from 1 to 32.
    pub degree_u: u32,
    /// Degree along v, from 1 to 32.
    pub degree_v: u32,
    /// Number of control points along u, above `degree_u`.
    pub count_u: u32,
    /// Number of control points along v, above `degree_v`.
    pub count_v: u32,
    /// Array of `count_u + degree_u + 1` knots, which do not decrease. At most `degree_u + 1` of them are equal.
    pub knots_u: *const f64,
    /// Array of `count_v + degree_v + 1` knots, likewise.
    pub knots_v: *const f64,
    /// Array of `count_u * count_v` control points, three coordinates each, those along v one after the other. They are
    /// not multiplied by their weights.
    pub points: *const f64,
    /// Array of the weights of all control points, above 0. NULL: all are 1.
    pub weights: *const f64,
    /// 1: the outside is against du × dv. 0: along it.
    pub reversed: u32,
    /// Must be 0.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, numbers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_nurbs {
    const NAME: &'static str = "oc_nurbs";
    const FIRST_SIZE: usize = size_of::<oc_nurbs>();
}

/// Adds a NURBS surface from the caller's memory.
///
/// The surface is diced into triangles, without cracks within it, as finely as oc_build_desc.surface_tolerance or
/// surface_level asks for: of each of its Bézier patches. It is closed where its first and last control points are the
/// same. Each triangle counts in the ids of primitives. They have the normals of the surface, at poles their limits.
///
/// - `surface`: the arrays are copied.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a degree, a knot, a weight, a point or a count is out of its range; the part or mesh
///   was not added. The message names the argument. Nothing was added.
/// - OC_STATUS_INVALID_ARGUMENT, OC_STATUS_OVER_LIMIT, OC_STATUS_INVALID_STATE, OC_STATUS_IO: as for oc_build_add_cage.
///
/// Thread safety: any thread. Blocks while it dices.
/// # Safety
/// `build` is a live handle; `surface` is initialised and its arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_nurbs(build: *mut oc_build, surface: *const oc_nurbs) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let it = read(surface)?;
        super::guard::reserved(it.reserved, "oc_nurbs.reserved")?;
        if it.reversed > 1 {
            return bad(format!("oc_nurbs.reversed is {}; it must be 0 or 1", it.reversed));
        }
        let (degree, counts) = ([it.degree_u, it.degree_v], [it.count_u, it.count_v]);
        let knots = |axis: usize| u64::from(counts[axis]) + u64::from(degree[axis]) + 1;
        let count = u64::from(it.count_u) * u64::from(it.count_v);
        for (axis, name) in ["degree_u", "degree_v"].into_iter().enumerate() {
            if !(1..=MAX_DEGREE).contains(&degree[axis]) {
                return bad(format!("oc_nurbs.{name} is {}; it must be from 1 to {MAX_DEGREE}", degree[axis]));
            }
        }
        let points: Vec<[f64; 3]> = Strided::copied(it.points.cast(), count, "oc_nurbs.points")?;
        let knots_u: Vec<f64> = Strided::copied(it.knots_u, knots(0), "oc_nurbs.knots_u")?;
        let knots_v: Vec<f64> = Strided::copied(it.knots_v, knots(1), "oc_nurbs.knots_v")?;
        let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
        let weights = match it.weights.is_null() {
            true => None,
            false => Some(Strided::copied(it.weights, count, "oc_nurbs.weights")?),
        };
        with_input(build, |input| {
            let (mesh, part) = input.target(it.mesh, it.part)?;
            let (knots_u, knots_v, points, weights) = (&knots_u[..], &knots_v[..], &points[..], weights.as_deref());
            let desc = NurbsDesc { degree, counts, knots_u, knots_v, points, weights };
            let is_reversed = it.reversed == 1;
            Ok(input.builder.nurbs(mesh, &NurbsMesh { desc, is_reversed, domain: None, extent: 0.0, part })?)
        })
    })
}
