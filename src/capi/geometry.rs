//! Triangles as they are stored: of a part, and of hits.

use super::guard::{Checked, Strided, bad, boundary, out};
use super::handles::{self, Shell, handle};
use super::model::{ModelObject, oc_model};
use super::query::oc_hit;
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::base::error::Error;
use crate::base::inside_read::refuse_inside_read;
use crate::base::progress::Cancel;
use crate::query::{Hit, PartReader, StoredTriangle};
use bytemuck::must_cast;
use glam::DVec3;
use std::sync::{Mutex, PoisonError};

/// A triangle with all that is stored of it. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_triangle {
    /// x, y, z of the first corner, of the second, of the third: in model space from oc_part_reader_next, in world
    /// space from oc_scene_triangles. The stored positions are exact in double precision, unless a transform places
    /// them.
    pub corners: [f64; 9],
    /// Id of the part, as passed when the model was built.
    pub part: u64,
    /// As oc_hit.prim.
    pub prim: u64,
    /// Unit normals at the corners with which the surface is shaded, in the order of `corners`, on the side from which
    /// the corners appear counter-clockwise. Those of the triangle itself where the model has no others.
    pub normals: [f32; 9],
    /// Always 0.
    pub reserved: u32,
}

const _: () = assert!(size_of::<oc_triangle>() == size_of::<StoredTriangle>());

fn to_c(t: &StoredTriangle) -> oc_triangle {
    oc_triangle {
        corners: must_cast(t.corners.map(|c| c.to_array())),
        part: t.part,
        prim: t.prim,
        normals: must_cast(t.normals.map(|n| n.to_array())),
        reserved: 0,
    }
}

/// The triangles of a part of a model, read some at a time.
pub struct oc_part_reader {
    _private: [u8; 0],
}

handle!(oc_part_reader, ReaderObject, 8);

pub(crate) struct ReaderObject(Mutex<PartReader>);

/// Begins to read the triangles of a part, for example to export it, or to snap to its corners.
///
/// Triangles of parts below it are not included. Each triangle comes once, also if several leaves refer to it, in an
/// order that depends on nothing but the file. If the part is in a shared mesh, its triangles are placed as they are in
/// the model.
///
/// - `part`: the id of the part, as passed when the model was built.
/// - `out_reader`: receives the reader. It keeps the model alive.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: the model has no such part.
/// - OC_STATUS_OVER_BUDGET: the lists of parts do not fit the budget, nor, in a model whose triangles several leaves
///   may refer to, one bit for each triangle of its input.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: the lists of parts cannot be read.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `model` is a live handle; `out_reader` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_model_read_part(
    model: *const oc_model,
    part: u64,
    out_reader: *mut *mut oc_part_reader,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_reader, "out_reader")?;
        handles::with(model, |model: &Shell<ModelObject>| {
            let Some(index) = model.model.part_index(part) else {
                return bad(format!("the model has no part with id {part}"));
            };
            let reader = model.model.read_part(index)?;
            out.write(handles::give(ReaderObject(Mutex::new(reader))));
            Ok(())
        })
    })
}

/// Reads the next triangles of a part.
///
/// - `out_triangles`: receives the triangles, tightly packed.
/// - `capacity`: greatest number of triangles to read, above 0.
/// - `out_count`: receives the number of triangles. 0: there are no more.
///
/// Memory: one block of the model at a time, some 600 KB at most, whatever the size of the part.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: `capacity` is 0.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: a block cannot be read. The next call tries it again.
///
/// Thread safety: any thread, one at a time. Blocks; may read the disk.
/// # Safety
/// `reader` is a live handle; `out_triangles` has room for `capacity` elements; `out_count` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_reader_next(
    reader: *mut oc_part_reader,
    out_triangles: *mut oc_triangle,
    capacity: u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let (triangles, count) = (out(out_triangles, "out_triangles")?, out(out_count, "out_count")?);
        if capacity == 0 {
            return bad("capacity is 0");
        }
        handles::with(reader, |reader: &Shell<ReaderObject>| {
            // Otherwise a read function that is called for this reader would wait for itself.
            refuse_inside_read()?;
            let mut reader = reader.0.lock().unwrap_or_else(PoisonError::into_inner);
            let most = usize::try_from(capacity).unwrap_or(usize::MAX);
            let next = reader.next(most, &Cancel::new())?;
            for (i, triangle) in next.iter().enumerate() {
                // The array has room for as many as were asked for.
                triangles.add(i).write(to_c(triangle));
            }
            count.write(next.len() as u64);
            Ok(())
        })
    })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `reader` is a live handle or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_reader_retain(reader: *mut oc_part_reader) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(reader) }
}

/// Releases one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `reader` is a live handle or NULL, and is not used after the last release.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_part_reader_release(reader: *mut oc_part_reader) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(reader) }
}

/// Greatest number of hits that are looked up at a time.
const BATCH: usize = 1024;

/// Returns the triangles of hits, in world space: to snap to corners and edges, or to highlight what was picked.
///
/// - `hits`: hits of oc_scene_closest or oc_frame_pick in this scene, exact ones with `position`, `part`, `instance`
///   and `prim`.
/// - `count`: number of hits.
/// - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
/// - `out_triangles`: receives one triangle for each hit, tightly packed. Do not use it if the call fails.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: a hit has not all of these members, or no triangle of the committed scene has its ids
///   at its position. The message names its number.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: a block cannot be read.
///
/// Thread safety: any thread. Blocks; may read the disk.
/// # Safety
/// `scene` is a live handle; the arrays are as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_triangles(
    scene: *const oc_scene,
    hits: *const oc_hit,
    count: u64,
    hit_stride: u64,
    out_triangles: *mut oc_triangle,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        if count == 0 {
            return Ok(());
        }
        let hits: Strided<oc_hit> = Strided::new(hits, count, hit_stride, "hits")?;
        let triangles = out(out_triangles, "out_triangles")?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let state = scene.scene.state();
            // The number fits `usize`: the hits are in memory.
            for first in (0..count as usize).step_by(BATCH) {
                let batch: Vec<Hit> =
                    (first..(count as usize).min(first + BATCH)).map(|i| hit_of_c(hits.get(i))).collect();
                let found = state.triangles(&batch, &Cancel::new()).map_err(|error| in_batch(error, first))?;
                for (i, triangle) in found.iter().enumerate() {
                    triangles.add(first + i).write(to_c(triangle));
                }
            }
            Checked::Ok(())
        })
    })
}

/// The members of a hit by which its triangle is found.
pub(super) fn hit_of_c(hit: oc_hit) -> Hit {
    let oc_hit { part, instance, prim, occurrence, .. } = hit;
    Hit { position: DVec3::from_array(hit.position), part, instance, prim, occurrence, ..Hit::MISS }
}

/// Adds the number of the batch's first hit to that in the message.
pub(super) fn in_batch(error: Error, first: usize) -> Error {
    match error {
        Error::BadArgument(why) if first > 0 => Error::BadArgument(format!("of the hits from {first} on, {why}")),
        other => other,
    }
}
