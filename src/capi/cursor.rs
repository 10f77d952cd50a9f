//! Cursors: nodes of a model's trees, for programs that walk the trees by themselves.

use super::guard::{Checked, Failure, Fill, Sized32, Strided, bad, boundary, out};
use super::handles::{self, Shell, handle};
use super::model::{ModelObject, oc_model};
use super::query::{OC_NO_ID, same_places};
use super::status::oc_status;
use crate::base::error::Error;
use crate::query::{Cursor, CursorOptions, Found, Node, NodeTriangle};
use std::sync::{Mutex, TryLockError};

/// Flags of oc_cursor_create.
pub type oc_cursor_flags = u32;
/// The cursor never reads. A call that needs a block which is not in memory returns OC_STATUS_MISSING.
pub const OC_CURSOR_NOW: oc_cursor_flags = 1;

/// Reads the nodes of a model's trees, one at a time, in any order.
///
/// A node has a number of 64 bits, its id, which holds for the model file as long as the file is not built anew. The
/// upper 32 bits are the block of the node, below `blocks` of oc_model_info. The lower 32 bits have no meaning outside.
pub struct oc_cursor {
    _private: [u8; 0],
}

handle!(oc_cursor, CursorObject, 10);

pub(crate) struct CursorObject(Mutex<Cursor>);

/// A node of a tree: a leaf, which has triangles, or a node with children.
///
/// Boxes are in double precision, rounded outward, in the coordinates of the tree, see oc_tree_place. The box of a
/// child holds all triangles below; of triangles that the build divided (see `splits` of oc_build_desc) the pieces that
/// are below. `bounds_min` and `bounds_max` are around the boxes of the children, or around all corners of a leaf.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_node {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Index of the tree.
    pub tree: u32,
    /// Number of children, at most 8. 0: the node is a leaf.
    pub child_count: u32,
    /// Number of triangles of a leaf, at most 64. 0: the node has children.
    pub triangle_count: u32,
    /// Bit i: child i is a leaf.
    pub leaf_children: u32,
    /// Number, in the tree, of the part that all triangles below belong to. OC_NO_INDEX: they belong to several, or the
    /// model does not say. See oc_tree_place.
    pub part: u32,
    /// Least corner of the box.
    pub bounds_min: [f64; 3],
    /// Greatest corner of the box.
    pub bounds_max: [f64; 3],
    /// Ids of the children. OC_NO_ID behind the last.
    pub children: [u64; 8],
    /// Boxes of the children, 6 numbers each: least x, y, z, greatest x, y, z. 0 behind the last.
    pub child_bounds: [f64; 48],
}

// SAFETY: `repr(C)`, numbers without padding, `struct_size` first.
unsafe impl Sized32 for oc_node {
    const NAME: &'static str = "oc_node";
}
same_places!(oc_node, Node: struct_size is reserved, tree is tree, child_count is children,
    triangle_count is triangles, leaf_children is leaves, part is part, bounds_min is bounds, children is child,
    child_bounds is child_bounds);

/// A triangle of a leaf. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_node_triangle {
    /// x, y, z of the first corner, of the second, of the third, in the coordinates of the tree, see oc_tree_place. The
    /// stored positions are exact in double precision.
    pub corners: [f64; 9],
    /// As oc_hit.prim. OC_NO_ID if it was not asked for.
    pub prim: u64,
    /// Number of the part in the tree, see oc_tree_place.
    pub part: u32,
    /// Index of the tree.
    pub tree: u32,
}
same_places!(oc_node_triangle, NodeTriangle: corners is corners, prim is prim, part is part, tree is tree);

/// A place of a tree in its model. Element of an array.
///
/// Tree 0 holds the triangles that are placed directly; each other tree holds a shared mesh, or some of a large one,
/// and has a place for each of its instances.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_tree_place {
    /// Transform from the coordinates of the tree to the model, by column: x axis, y axis, z axis, origin.
    pub model_from_tree: [f64; 12],
    /// Id of the root of the tree.
    pub root: u64,
    /// Index of the tree.
    pub tree: u32,
    /// Index, for oc_model_get_part, of part 0 of the tree in this place: part p of a node or a triangle has index
    /// `first_part` + p.
    pub first_part: u32,
}

/// Makes a cursor over a model.
///
/// Blocks in memory are used where they are, without a lock; the cursor does not keep them there. Other blocks are read
/// by the calling thread into memory of the cursor's own, which drops those that were not used for longest. They are
/// neither those of frames and queries, nor of other cursors. For fast walks call oc_model_load or oc_scene_prefetch
/// first.
///
/// - `flags`: OC_CURSOR_ flags, combined with `|`.
/// - `bytes`: size of that memory, of the budget of the context. 0: 4 MiB. Not used with OC_CURSOR_NOW.
/// - `out_cursor`: receives the cursor. It keeps the model alive.
///
/// Memory: `bytes`, and 272 KiB, of the budget.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: `flags` are unknown, or `bytes` are not 0 and too few to read a block. The message
///   names the least number.
/// - OC_STATUS_OVER_BUDGET: the budget of the context has less. oc_last_error_need returns the least budget that
///   suffices.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Makes room in the budget, for which it may wait until frames give up what they use.
/// # Safety
/// `model` is a live handle; `out_cursor` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_create(
    model: *const oc_model,
    flags: oc_cursor_flags,
    bytes: u64,
    out_cursor: *mut *mut oc_cursor,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_cursor, "out_cursor")?;
        if flags & !OC_CURSOR_NOW != 0 {
            return bad(format!("flags {flags:#x} are unknown"));
        }
        handles::with(model, |model: &Shell<ModelObject>| {
            let cursor = model.model.cursor(CursorOptions { now: flags & OC_CURSOR_NOW != 0, bytes })?;
            out.write(handles::give(CursorObject(Mutex::new(cursor))));
            Ok(())
        })
    })
}

/// Runs `f` on a cursor that no other thread uses. It never waits.
///
/// # Safety
/// As for [`handles::with`].
#[inline]
unsafe fn with(cursor: *const oc_cursor, f: impl FnOnce(&mut Cursor) -> Checked<()>) -> Checked<()> {
    // SAFETY: the caller's contract.
    unsafe {
        handles::with(cursor, |cursor: &Shell<CursorObject>| match cursor.0.try_lock() {
            Ok(mut cursor) => f(&mut cursor),
            Err(TryLockError::Poisoned(poisoned)) => f(&mut poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => {
                Err(Error::BadState("the cursor is in use: one thread may use it at a time".into()).into())
            }
        })
    }
}

fn there<T>(found: Found<T>) -> Checked<T> {
    match found {
        Found::There(found) => Ok(found),
        Found::Missing(block) => Err(Failure::Missing(block.0)),
    }
}

/// Writes the count, and the elements if they fit.
///
/// # Safety
/// `out_count` is writable, and the array for its elements; the bytes of any `U` are a valid `T`.
unsafe fn hand_out<T: Copy, U: Copy>(found: &[U], array: &Strided<T>, out_count: *mut u64) -> Checked<()> {
    let (need, have) = (found.len() as u64, array.count as u64);
    // SAFETY: the caller's contract.
    unsafe { out_count.write(need) };
    if have == 0 {
        return Ok(());
    }
    if need > have {
        return Err(Failure::TooSmall { need, have });
    }
    // SAFETY: within the array, by the test above.
    unsafe { array.copy_from(0, found) };
    Ok(())
}

/// Returns the root of a tree. For a model without instances of its own, tree 0 is all of it.
///
/// - `tree`: index of the tree.
/// - `out_node`: receives the id of the root. OC_NO_ID: the tree has no triangles.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no such tree.
///
/// Thread safety: any thread, one at a time. Cheap.
/// # Safety
/// `cursor` is a live handle; `out_node` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_root(cursor: *mut oc_cursor, tree: u32, out_node: *mut u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_node, "out_node")?;
        with(cursor, |cursor| {
            out.write(cursor.root(tree)?.unwrap_or(OC_NO_ID));
            Ok(())
        })
    })
}

/// Returns the places of all trees with triangles in the model: where walks of the whole model begin.
///
/// - `out_places`: receives the places, tightly packed.
/// - `capacity`: number of elements that `out_places` has room for. 0: only the count is written, `out_places` is
///   ignored.
/// - `out_count`: receives the number of places, also with OC_STATUS_BUFFER_TOO_SMALL.
///
/// Errors: OC_STATUS_BUFFER_TOO_SMALL if `capacity` is not 0 and below the number of places.
///
/// Thread safety: any thread, one at a time. Cheap: reads nothing.
/// # Safety
/// `cursor` is a live handle; the array is as documented; `out_count` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_places(
    cursor: *mut oc_cursor,
    out_places: *mut oc_tree_place,
    capacity: u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let (count, places) = (out(out_count, "out_count")?, Strided::new(out_places, capacity, 0, "out_places")?);
        with(cursor, |cursor| {
            let need = cursor.places().count() as u64;
            count.write(need);
            if places.count > 0 && need > capacity {
                return Err(Failure::TooSmall { need, have: capacity });
            }
            for (i, place) in cursor.places().take(places.count).enumerate() {
                let model_from_tree = place.model_from_tree.to_cols_array();
                let (root, tree, first_part) = (place.root, place.tree, place.first_part);
                places.set(i, oc_tree_place { model_from_tree, root, tree, first_part });
            }
            Ok(())
        })
    })
}

/// Returns a node, with the ids and boxes of its children.
///
/// - `node`: id of the node. Any number may be passed.
/// - `out_node`: receives the node. Initialise it with OC_INIT.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: no node of the model has the id.
/// - OC_STATUS_MISSING: with OC_CURSOR_NOW, the block is not in memory.
/// - OC_STATUS_INVALID_STATE: another thread uses the cursor now.
/// - OC_STATUS_IO, OC_STATUS_CORRUPT: the block cannot be read.
///
/// Thread safety: any thread, one at a time. Cheap if the block is in memory, or with OC_CURSOR_NOW; otherwise reads
/// the disk.
/// # Safety
/// `cursor` is a live handle; `out_node` is initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_node(cursor: *mut oc_cursor, node: u64, out_node: *mut oc_node) -> oc_status {
    // SAFETY: the function's own contract. Any `Node` has the bytes of an `oc_node`.
    boundary(|| unsafe {
        let fill = Fill::new(out_node)?;
        with(cursor, |cursor| {
            fill.with_same(there(cursor.node(node)?)?);
            Ok(())
        })
    })
}

/// Returns the triangles of a leaf.
///
/// - `node`: id of a leaf. Any number may be passed.
/// - `with_prims`: 1: `prim` of the triangles is filled. It is in a block of its own. 0: it is OC_NO_ID.
/// - `out_triangles`: receives the triangles, tightly packed.
/// - `capacity`: number of elements that `out_triangles` has room for; 64 always suffices. 0: only the count is
///   written, `out_triangles` is ignored.
/// - `out_count`: receives the number of triangles, also with OC_STATUS_BUFFER_TOO_SMALL.
///
/// A triangle may be in several leaves, see `splits` of oc_build_desc.
///
/// Errors: as for oc_cursor_node. OC_STATUS_INVALID_ARGUMENT also if the node has children, or `with_prims` is above 1.
/// OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of triangles.
///
/// Thread safety: as for oc_cursor_node.
/// # Safety
/// `cursor` is a live handle; the array is as documented; `out_count` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_triangles(
    cursor: *mut oc_cursor,
    node: u64,
    with_prims: u32,
    out_triangles: *mut oc_node_triangle,
    capacity: u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract. Any `NodeTriangle` has the bytes of an `oc_node_triangle`.
    boundary(|| unsafe {
        let count = out(out_count, "out_count")?;
        let triangles = Strided::new(out_triangles, capacity, 0, "out_triangles")?;
        if with_prims > 1 {
            return bad(format!("with_prims is {with_prims}; it must be 0 or 1"));
        }
        with(cursor, |cursor| hand_out(there(cursor.triangles(node, with_prims == 1)?)?, &triangles, count))
    })
}

/// Returns the ids of all nodes of a block, leaves included. All blocks together have each node of the model once.
///
/// - `block`: number of the block, below `blocks` of oc_model_info.
/// - `out_nodes`: receives the ids, tightly packed.
/// - `capacity`: number of elements that `out_nodes` has room for; 16384 always suffices. 0: only the count is written,
///   `out_nodes` is ignored.
/// - `out_count`: receives the number of nodes, also with OC_STATUS_BUFFER_TOO_SMALL.
///
/// Errors: as for oc_cursor_node. OC_STATUS_INVALID_ARGUMENT if there is no such block. OC_STATUS_BUFFER_TOO_SMALL:
/// `capacity` is not 0 and below the number of nodes.
///
/// Thread safety: as for oc_cursor_node.
/// # Safety
/// `cursor` is a live handle; the array is as documented; `out_count` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_block_nodes(
    cursor: *mut oc_cursor,
    block: u32,
    out_nodes: *mut u64,
    capacity: u64,
    out_count: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let (count, nodes) = (out(out_count, "out_count")?, Strided::new(out_nodes, capacity, 0, "out_nodes")?);
        with(cursor, |cursor| hand_out(&there(cursor.block_nodes(block)?)?, &nodes, count))
    })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `cursor` is a live handle or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_retain(cursor: *mut oc_cursor) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(cursor) }
}

/// Releases one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `cursor` is a live handle or NULL, and is not used after the last release.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_cursor_release(cursor: *mut oc_cursor) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(cursor) }
}
