//! Triangles from the caller's memory.

use super::build::{oc_build, with_input};
use super::guard::{Checked, Sized32, Strided, bad, boundary, read};
use super::status::oc_status;
use crate::import::{Attributes, Sink};
use glam::{DVec3, Vec3};
use std::ffi::c_void;

/// Type of coordinates.
pub type oc_scalar = u32;
/// float.
pub const OC_SCALAR_F32: oc_scalar = 0;
/// double.
pub const OC_SCALAR_F64: oc_scalar = 1;

/// Type of indices.
pub type oc_index = u32;
/// No indices: each three successive corners are a triangle.
pub const OC_INDEX_NONE: oc_index = 0;
/// uint32_t.
pub const OC_INDEX_U32: oc_index = 1;
/// uint64_t.
pub const OC_INDEX_U64: oc_index = 2;

/// Triangles in the caller's memory. The arrays are read during the call. They may have any alignment.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_triangles {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// 0: the triangles are placed directly. Otherwise: number of a shared mesh from oc_build_add_shared_mesh.
    pub mesh: u32,
    /// The part that the triangles belong to. Directly placed: the id of the part. Shared mesh: the number of the part,
    /// from 0.
    pub part: u64,
    /// Array of corners, three coordinates each. `scalar` is their type.
    pub positions: *const c_void,
    /// Number of corners. Without indices it must be a multiple of 3.
    pub position_count: u64,
    /// Bytes from one corner to the next. 0: tightly packed.
    pub position_stride: u64,
    /// Array of indices of corners, three for each triangle, tightly packed. `index` is their type. Must be NULL with
    /// OC_INDEX_NONE.
    pub indices: *const c_void,
    /// Number of indices: three times the number of triangles. Must be 0 with OC_INDEX_NONE.
    pub index_count: u64,
    /// Array of colours, one for each triangle: three floats, linear RGB. NULL: the colour of the part's material.
    pub colours: *const f32,
    /// Bytes from one colour to the next. 0: tightly packed.
    pub colour_stride: u64,
    /// One of the OC_SCALAR_ constants: the type of coordinates.
    pub scalar: oc_scalar,
    /// One of the OC_INDEX_ constants: the type of indices.
    pub index: oc_index,
    /// Array of normals, one for each entry of `positions`: three floats, of any length. They make the surface appear
    /// smooth. The normal of a triangle replaces one that is zero, NaN or infinite. NULL: normals are made from the
    /// triangles, see oc_build_desc.crease_angle.
    pub normals: *const f32,
    /// Bytes from one normal to the next. 0: tightly packed.
    pub normal_stride: u64,
    /// Array of colours, one for each entry of `positions`: three floats, linear RGB, which are interpolated. NULL:
    /// none. With `colours` it must be NULL.
    pub position_colours: *const f32,
    /// Bytes from one of these colours to the next. 0: tightly packed.
    pub position_colour_stride: u64,
}

// SAFETY: `repr(C)`, integers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_triangles {
    const NAME: &'static str = "oc_triangles";
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_triangles, normals);
}

/// Positions in the caller's memory.
pub(super) enum Positions {
    F32(Strided<[f32; 3]>),
    F64(Strided<[f64; 3]>),
}

impl Positions {
    /// Checks the array. `of` names the struct.
    pub fn new(array: *const c_void, scalar: oc_scalar, (count, stride): (u64, u64), of: &str) -> Checked<Self> {
        let name = format!("{of}.positions");
        match scalar {
            OC_SCALAR_F32 => Ok(Self::F32(Strided::new(array.cast(), count, stride, &name)?)),
            OC_SCALAR_F64 => Ok(Self::F64(Strided::new(array.cast(), count, stride, &name)?)),
            other => bad(format!("{of}.scalar {other} is unknown")),
        }
    }

    /// Their number.
    pub fn count(&self) -> usize {
        match self {
            Self::F32(all) => all.count,
            Self::F64(all) => all.count,
        }
    }

    /// Reads one.
    ///
    /// # Safety
    /// `index` is below their number; the caller's array is readable.
    #[inline]
    pub unsafe fn get(&self, index: usize) -> DVec3 {
        // SAFETY: the caller's contract.
        unsafe {
            match self {
                Self::F32(all) => DVec3::from_array(all.get(index).map(f64::from)),
                Self::F64(all) => DVec3::from_array(all.get(index)),
            }
        }
    }
}

enum Indices {
    None,
    U32(Strided<u32>),
    U64(Strided<u64>),
}

/// The arrays of [`oc_triangles`], checked.
struct Soup {
    positions: Positions,
    indices: Indices,
    colours: Option<Strided<[f32; 3]>>,
    position_colours: Option<Strided<[f32; 3]>>,
    normals: Option<Strided<[f32; 3]>>,
    triangles: usize,
}

impl Soup {
    fn new(t: &oc_triangles) -> Checked<Self> {
        let count = t.position_count;
        let positions = Positions::new(t.positions, t.scalar, (count, t.position_stride), "oc_triangles")?;
        let name = "oc_triangles.indices";
        let (indices, corners) = match t.index {
            OC_INDEX_NONE if t.indices.is_null() && t.index_count == 0 => (Indices::None, count),
            OC_INDEX_NONE => return bad("oc_triangles: there are indices, but oc_triangles.index is OC_INDEX_NONE"),
            OC_INDEX_U32 => (Indices::U32(Strided::new(t.indices.cast(), t.index_count, 0, name)?), t.index_count),
            OC_INDEX_U64 => (Indices::U64(Strided::new(t.indices.cast(), t.index_count, 0, name)?), t.index_count),
            other => return bad(format!("oc_triangles.index {other} is unknown")),
        };
        if !corners.is_multiple_of(3) {
            return bad(format!("oc_triangles: {corners} corners are not a multiple of 3"));
        }
        let triangles = corners / 3;
        let colours = if t.colours.is_null() {
            None
        } else {
            Some(Strided::new(t.colours.cast(), triangles, t.colour_stride, "oc_triangles.colours")?)
        };
        let at_positions = |array: *const f32, stride: u64, name: &'static str| {
            if array.is_null() { Ok(None) } else { Strided::new(array.cast(), count, stride, name).map(Some) }
        };
        let normals = at_positions(t.normals, t.normal_stride, "oc_triangles.normals")?;
        let position_colours =
            at_positions(t.position_colours, t.position_colour_stride, "oc_triangles.position_colours")?;
        if colours.is_some() && position_colours.is_some() {
            return bad("oc_triangles: there are both colours and position_colours");
        }
        // The number fits `usize`: the corners are in memory.
        Ok(Self { positions, indices, colours, position_colours, normals, triangles: triangles as usize })
    }

    /// Returns the index of a corner.
    ///
    /// # Safety
    /// `corner` is below three times the number of triangles; the caller's arrays are readable.
    #[inline]
    unsafe fn index(&self, corner: usize) -> u64 {
        // SAFETY: the caller's contract.
        unsafe {
            match &self.indices {
                Indices::None => corner as u64,
                Indices::U32(i) => u64::from(i.get(corner)),
                Indices::U64(i) => i.get(corner),
            }
        }
    }

    /// Returns the position of a corner.
    ///
    /// # Safety
    /// As for [`Soup::index`], and the index is in range.
    #[inline]
    unsafe fn position(&self, corner: usize) -> DVec3 {
        // SAFETY: the caller's contract.
        unsafe { self.positions.get(self.index(corner) as usize) }
    }

    /// Refuses indices that are out of range, before any triangle is added.
    ///
    /// # Safety
    /// The caller's arrays are readable.
    unsafe fn check_indices(&self, positions: u64) -> Checked<()> {
        if let Indices::None = self.indices {
            return Ok(());
        }
        for corner in 0..self.triangles * 3 {
            // SAFETY: the index is within the array.
            let index = unsafe { self.index(corner) };
            if index >= positions {
                return bad(format!("oc_triangles.indices[{corner}] is {index}, but there are {positions} positions"));
            }
        }
        Ok(())
    }
}

/// Number of triangles that are passed to the builder at a time.
const BATCH: usize = 4096;

/// Adds triangles of one part from the caller's memory. Triangles with NaN or infinite coordinates, and triangles
/// without area, are allowed: the build drops and counts them.
///
/// - `triangles`: the arrays are copied.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: an index is out of range, the part or mesh was not added, or a count or stride is
///   wrong. Nothing was added.
/// - OC_STATUS_INVALID_ARGUMENT: the model would hold 2^32 - 1 triangles or more. The first of them may have been
///   added.
/// - OC_STATUS_INVALID_STATE: after oc_build_start.
/// - OC_STATUS_IO: the temporary file for data above the build's budget cannot be written. The build can then only be
///   released.
///
/// Thread safety: any thread. Blocks while it copies.
/// # Safety
/// `build` is a live handle; `triangles` is initialised and its arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_triangles(build: *mut oc_build, triangles: *const oc_triangles) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let desc = read(triangles)?;
        let soup = Soup::new(&desc)?;
        soup.check_indices(desc.position_count)?;
        with_input(build, |input| {
            let (mesh, part) = input.target(desc.mesh, desc.part)?;
            let (mut corners, mut colours, mut normals) = (Vec::with_capacity(BATCH), Vec::new(), Vec::new());
            for first in (0..soup.triangles).step_by(BATCH) {
                let batch = first..soup.triangles.min(first + BATCH);
                corners.clear();
                corners.extend(batch.clone().map(|t| [0, 1, 2].map(|c| soup.position(3 * t + c))));
                colours.clear();
                if let Some(given) = &soup.colours {
                    colours.extend(batch.clone().map(|t| [given.get(t); 3]));
                }
                let at =
                    |given: &Strided<[f32; 3]>, t: usize| [0, 1, 2].map(|c| given.get(soup.index(3 * t + c) as usize));
                if let Some(given) = &soup.position_colours {
                    colours.extend(batch.clone().map(|t| at(given, t)));
                }
                normals.clear();
                if let Some(given) = &soup.normals {
                    normals.extend(batch.map(|t| at(given, t).map(Vec3::from)));
                }
                let attributes = Attributes {
                    colours: (!colours.is_empty()).then_some(&colours[..]),
                    normals: (!normals.is_empty()).then_some(&normals[..]),
                };
                input.builder.triangles(mesh, part, &corners, attributes)?;
            }
            Ok(())
        })
    })
}
