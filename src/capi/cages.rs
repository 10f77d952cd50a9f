//! Subdivision surfaces from the caller's memory.

use super::build::{Input, oc_build, with_input};
use super::guard::{Checked, Sized32, Strided, bad, boundary, read};
use super::status::oc_status;
use super::triangles::{Positions, oc_scalar};
use crate::import::surfaces::{Boundary, CageDesc, Creasing, Displacement, Heights, TriangleRule, Wrap};
use crate::import::{CageMesh, MeshKey, Sink};
use glam::DVec3;
use std::ffi::c_void;

/// Where a subdivision surface ends.
pub type oc_boundary = u32;
/// Its boundary is a smooth curve along the boundary edges of the cage.
pub const OC_BOUNDARY_EDGES: oc_boundary = 0;
/// Likewise, and the curve passes through boundary vertices that are in one face only.
pub const OC_BOUNDARY_EDGES_AND_CORNERS: oc_boundary = 1;
/// Faces at the boundary of the cage are no surface: they only shape their neighbours.
pub const OC_BOUNDARY_NONE: oc_boundary = 2;

/// Sharpness of creases after a subdivision.
pub type oc_creasing = u32;
/// One less than before.
pub const OC_CREASING_UNIFORM: oc_creasing = 0;
/// Chaikin's rule: one less than a mean over the edges of the crease that follow each other.
pub const OC_CREASING_CHAIKIN: oc_creasing = 1;

/// Rule for triangles in a cage.
pub type oc_triangle_rule = u32;
/// That of all faces.
pub const OC_TRIANGLE_RULE_CATMULL_CLARK: oc_triangle_rule = 0;
/// Weights with which regular triangles become smoother surfaces.
pub const OC_TRIANGLE_RULE_SMOOTH: oc_triangle_rule = 1;

/// Texels beyond the border of a map.
pub type oc_wrap = u32;
/// The map repeats.
pub const OC_WRAP_REPEAT: oc_wrap = 0;
/// The border continues.
pub const OC_WRAP_CLAMP: oc_wrap = 1;

/// Heights by which a surface is moved along its normal: a biquadratic B-spline with a control value in the middle of
/// each texel, so that the surface stays smooth. Where faces meet, the surface moves by the mean of their heights.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_displacement {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Number of maps: 1, or the number of faces if there are no coordinates.
    pub map_count: u32,
    /// Array of heights, tightly packed, finite: map by map, row by row, the first row at t = 0.
    pub texels: *const f32,
    /// Array of the coordinates s, t in the map at each corner of each face, in the order of oc_cage.indices. The map
    /// covers 0 to 1. NULL: each face has a map of its own along its sides, and must have four corners.
    pub coordinates: *const f32,
    /// Factor of all heights, finite.
    pub scale: f64,
    /// One of the OC_WRAP_ constants, for s.
    pub wrap_s: oc_wrap,
    /// One of the OC_WRAP_ constants, for t.
    pub wrap_t: oc_wrap,
}

// SAFETY: `repr(C)`, numbers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_displacement {
    const NAME: &'static str = "oc_displacement";
    const FIRST_SIZE: usize = size_of::<oc_displacement>();
}

/// A Catmull-Clark subdivision surface, as its cage. The arrays are read during the call. They may have any alignment.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_cage {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// 0: the surface is placed directly. Otherwise: number of a shared mesh from oc_build_add_shared_mesh.
    pub mesh: u32,
    /// The part that the surface belongs to. Placed directly: the id of the part. Shared mesh: the number of the part,
    /// from 0.
    pub part: u64,
    /// Array of parts, one for each face, which replace `part`. NULL: all faces belong to `part`. Faces of different
    /// parts are joined smoothly.
    pub face_parts: *const u64,
    /// Array of vertices, three coordinates each. `scalar` is their type.
    pub positions: *const c_void,
    /// Number of vertices.
    pub position_count: u64,
    /// Bytes from one vertex to the next. 0: tightly packed.
    pub position_stride: u64,
    /// Array of the number of corners of each face, at least 3. NULL: all faces have four.
    pub face_sizes: *const u32,
    /// Number of faces.
    pub face_count: u64,
    /// Array of indices of vertices: the corners of each face, counter-clockwise from outside, face by face.
    pub indices: *const u32,
    /// Number of indices: the sum of the numbers of corners.
    pub index_count: u64,
    /// Array of edges that are creases, two indices of vertices each.
    pub creases: *const u32,
    /// Array of sharpness, one for each crease: 0 is smooth, 10 or more stays sharp for ever, and between these the
    /// edge is sharp for so many subdivisions.
    pub crease_sharpness: *const f32,
    /// Number of creases.
    pub crease_count: u64,
    /// Array of indices of vertices that are corners.
    pub corners: *const u32,
    /// Array of sharpness, one for each corner, as that of creases.
    pub corner_sharpness: *const f32,
    /// Number of corners.
    pub corner_count: u64,
    /// Array of indices of faces that are holes: they shape their neighbours, and are no surface.
    pub holes: *const u32,
    /// Number of holes.
    pub hole_count: u64,
    /// One of the OC_SCALAR_ constants: the type of coordinates.
    pub scalar: oc_scalar,
    /// One of the OC_BOUNDARY_ constants.
    pub boundary: oc_boundary,
    /// One of the OC_CREASING_ constants.
    pub creasing: oc_creasing,
    /// One of the OC_TRIANGLE_RULE_ constants.
    pub triangle_rule: oc_triangle_rule,
    /// Heights by which the surface is moved along its normal, or NULL.
    pub displacement: *const oc_displacement,
}

// SAFETY: `repr(C)`, numbers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_cage {
    const NAME: &'static str = "oc_cage";
    const FIRST_SIZE: usize = size_of::<oc_cage>();
}

/// Copies of the arrays of an [`oc_cage`].
struct Arrays {
    positions: Vec<DVec3>,
    face_sizes: Vec<u32>,
    indices: Vec<u32>,
    creases: Vec<(u32, u32, f32)>,
    corners: Vec<(u32, f32)>,
    holes: Vec<u32>,
}

impl Arrays {
    /// # Safety
    /// The arrays are readable.
    unsafe fn of(cage: &oc_cage) -> Checked<Self> {
        // SAFETY: the caller's contract, for all of them.
        unsafe {
            let sharpness = Strided::copied(cage.crease_sharpness, cage.crease_count, "oc_cage.crease_sharpness")?;
            let ends: Vec<[u32; 2]> = Strided::copied(cage.creases.cast(), cage.crease_count, "oc_cage.creases")?;
            let of_corners = Strided::copied(cage.corner_sharpness, cage.corner_count, "oc_cage.corner_sharpness")?;
            let corners = Strided::copied(cage.corners, cage.corner_count, "oc_cage.corners")?;
            let indices = Strided::copied(cage.indices, cage.index_count, "oc_cage.indices")?;
            let face_sizes = match cage.face_sizes.is_null() {
                true if cage.face_count.checked_mul(4) != Some(cage.index_count) => {
                    let (faces, indices) = (cage.face_count, cage.index_count);
                    return bad(format!("oc_cage.index_count {indices} is not four times the number of faces {faces}"));
                }
                // The number fits `usize`: the indices are in memory.
                true => vec![4; cage.face_count as usize],
                false => Strided::copied(cage.face_sizes, cage.face_count, "oc_cage.face_sizes")?,
            };
            let (count, stride) = (cage.position_count, cage.position_stride);
            let positions = Positions::new(cage.positions, cage.scalar, (count, stride), "oc_cage")?;
            Ok(Self {
                positions: (0..positions.count()).map(|i| positions.get(i)).collect(),
                face_sizes,
                indices,
                creases: ends.into_iter().zip(sharpness).map(|([a, b], sharp)| (a, b, sharp)).collect(),
                corners: corners.into_iter().zip(of_corners).collect(),
                holes: Strided::copied(cage.holes, cage.hole_count, "oc_cage.holes")?,
            })
        }
    }
}

/// Copies the heights and coordinates.
///
/// # Safety
/// The arrays are readable; there are `corners` coordinates.
unsafe fn heights(of: &oc_displacement, corners: u64) -> Checked<(Heights, Vec<[f64; 2]>)> {
    let wrap = |it: oc_wrap, name: &str| match it {
        OC_WRAP_REPEAT => Ok(Wrap::Repeat),
        OC_WRAP_CLAMP => Ok(Wrap::Clamp),
        other => bad(format!("oc_displacement.{name} {other} is unknown")),
    };
    let wrap = [wrap(of.wrap_s, "wrap_s")?, wrap(of.wrap_t, "wrap_t")?];
    let texels = u64::from(of.width).checked_mul(u64::from(of.height));
    let Some(texels) = texels.and_then(|it| it.checked_mul(u64::from(of.map_count))) else {
        return bad("oc_displacement: the sizes are too large");
    };
    // SAFETY: the caller's contract.
    let texels = unsafe { Strided::copied(of.texels, texels, "oc_displacement.texels")? };
    let coordinates = match of.coordinates.is_null() {
        true => Vec::new(),
        // SAFETY: the caller's contract.
        false => unsafe { Strided::<[f32; 2]>::copied(of.coordinates.cast(), corners, "oc_displacement.coordinates")? },
    };
    let heights = Heights::new([of.width, of.height], of.map_count, wrap, texels)?;
    Ok((heights, coordinates.into_iter().map(|it| it.map(f64::from)).collect()))
}

/// The mesh and the parts of the faces.
///
/// # Safety
/// The array of parts is readable.
unsafe fn targets(input: &Input, cage: &oc_cage) -> Checked<(MeshKey, Vec<u32>)> {
    if cage.face_parts.is_null() {
        let (mesh, part) = input.target(cage.mesh, cage.part)?;
        return Ok((mesh, vec![part]));
    }
    // SAFETY: the caller's contract.
    let given: Vec<u64> = unsafe { Strided::copied(cage.face_parts, cage.face_count, "oc_cage.face_parts")? };
    let mut mesh = MeshKey::DIRECT;
    let mut parts = Vec::with_capacity(given.len());
    for part in given {
        let (of, part) = input.target(cage.mesh, part)?;
        mesh = of;
        parts.push(part);
    }
    Ok((mesh, parts))
}

/// Adds a Catmull-Clark subdivision surface from the caller's memory: the limit surface of its cage, with semi-sharp
/// creases and corners, by the rules of OpenSubdiv 3.5. Edges of more than two faces are allowed, and are sharp.
///
/// The surface is diced into triangles, without cracks, as finely as oc_build_desc.surface_tolerance or surface_level
/// asks for. Each triangle counts in the ids of primitives. They have the normals of the surface.
///
/// - `cage`: the arrays are copied.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a face has fewer than three corners, or more than 4096; a vertex has more than 4096
///   faces or edges; an index is out of range; a crease is on no edge; a sharpness is negative or NaN; a vertex is not
///   finite, or beyond 1e30; the part or mesh was not added; a count or stride is wrong; a height or coordinate of the
///   displacement is not finite. The message names the face, edge or vertex, counted from 0. Nothing was added.
/// - OC_STATUS_INVALID_ARGUMENT, OC_STATUS_OVER_LIMIT: the model would hold 2^32 - 1 triangles or more, or more than
///   oc_build_desc.max_triangles. The first of them may have been added.
/// - OC_STATUS_INVALID_STATE: after oc_build_start.
/// - OC_STATUS_IO: as for oc_build_add_triangles.
///
/// Memory: the cage, its patches and the map are not in the budget of the build: some hundred bytes for each face, more
/// at faces with irregular vertices or creases.
/// Thread safety: any thread. Blocks while it dices.
/// # Safety
/// `build` is a live handle; `cage` is initialised and its arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_cage(build: *mut oc_build, cage: *const oc_cage) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let cage = read(cage)?;
        let boundary = match cage.boundary {
            OC_BOUNDARY_EDGES => Boundary::EdgeOnly,
            OC_BOUNDARY_EDGES_AND_CORNERS => Boundary::EdgeAndCorner,
            OC_BOUNDARY_NONE => Boundary::None,
            other => return bad(format!("oc_cage.boundary {other} is unknown")),
        };
        let creasing = match cage.creasing {
            OC_CREASING_UNIFORM => Creasing::Uniform,
            OC_CREASING_CHAIKIN => Creasing::Chaikin,
            other => return bad(format!("oc_cage.creasing {other} is unknown")),
        };
        let triangles = match cage.triangle_rule {
            OC_TRIANGLE_RULE_CATMULL_CLARK => TriangleRule::CatmullClark,
            OC_TRIANGLE_RULE_SMOOTH => TriangleRule::Smooth,
            other => return bad(format!("oc_cage.triangle_rule {other} is unknown")),
        };
        let arrays = Arrays::of(&cage)?;
        let displacement = match cage.displacement.is_null() {
            true => None,
            false => {
                let of = read(cage.displacement)?;
                Some((heights(&of, cage.index_count)?, of.scale))
            }
        };
        let displacement = displacement.as_ref().map(|((heights, coordinates), scale)| Displacement {
            heights,
            scale: *scale,
            coordinates,
        });
        let Arrays { positions, face_sizes, indices, creases, corners, holes } = &arrays;
        with_input(build, |input| {
            let (mesh, parts) = targets(input, &cage)?;
            let desc = CageDesc { face_sizes, indices, creases, corners, holes, boundary, creasing, triangles };
            Ok(input.builder.cage(mesh, &CageMesh { desc, positions, parts: &parts, displacement })?)
        })
    })
}
