//! The looks of instances and of their parts. Edits take effect at a commit.

use super::guard::{Checked, Sized32, Strided, bad, boundary, read_or_default};
use super::handles::{self, Shell};
use super::model::{ModelObject, oc_model};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::scene::{Look, Scope};

/// Flags of oc_look: how an instance or a part is shown.
pub type oc_look_flags = u32;
/// Hidden: no ray hits it. A part of opacity 0 looks the same, but rays hit it: hide the parts that picks and queries
/// must not return.
pub const OC_LOOK_HIDDEN: oc_look_flags = 1;
/// Highlighted.
pub const OC_LOOK_SELECTED: oc_look_flags = 2;
/// Shown in the colour of oc_look instead of its own.
pub const OC_LOOK_COLOURED: oc_look_flags = 4;

/// Appearance of an instance or a part. All zeros: unchanged.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_look {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// OC_LOOK_ flags, combined with `|`.
    pub flags: oc_look_flags,
    /// Linear RGBA, finite and 0 or more. Alpha is the opacity, at most 1. Ignored without OC_LOOK_COLOURED.
    pub colour: [f32; 4],
}

// SAFETY: `repr(C)`, integers and floats without padding, `struct_size` first.
unsafe impl Sized32 for oc_look {
    const NAME: &'static str = "oc_look";
}

impl oc_look {
    pub(super) fn to_rust(self) -> Checked<Look> {
        let known = OC_LOOK_HIDDEN | OC_LOOK_SELECTED | OC_LOOK_COLOURED;
        if self.flags & !known != 0 {
            return bad(format!("oc_look.flags {:#x}: unknown flags", self.flags));
        }
        let colour = (self.flags & OC_LOOK_COLOURED != 0).then_some(self.colour);
        if colour.is_some_and(|c| c.iter().any(|x| !x.is_finite() || *x < 0.0)) {
            return bad("oc_look.colour must be finite and 0 or more");
        }
        Ok(Look { visible: self.flags & OC_LOOK_HIDDEN == 0, colour, selected: self.flags & OC_LOOK_SELECTED != 0 })
    }
}

/// Flags of a choice of parts.
pub type oc_parts_flags = u32;
/// The parts below the given parts are meant too: all parts whose chain of parents leads to one of them.
pub const OC_PARTS_BELOW: oc_parts_flags = 1;

/// Copies an array of ids.
///
/// # Safety
/// `parts` points to `count` ids unless `count` is 0.
unsafe fn ids(parts: *const u64, count: u64) -> Checked<Vec<u64>> {
    let all = Strided::new(parts, count, 0, "parts")?;
    let mut own = crate::base::memory::room(all.count, "the ids of parts")?;
    // SAFETY: the function's own contract.
    own.extend((0..all.count).map(|i| unsafe { all.get(i) }));
    Ok(own)
}

pub(super) fn scope(flags: oc_parts_flags) -> Checked<Scope> {
    match flags {
        0 => Ok(Scope::Own),
        OC_PARTS_BELOW => Ok(Scope::Below),
        _ => bad(format!("flags {flags:#x}: unknown flags")),
    }
}

/// Sets the look of an instance. Takes effect at oc_scene_commit.
///
/// - `id`: id of the instance.
/// - `look`: the new look. NULL: unchanged appearance.
///
/// A part is hidden or highlighted if its own look or that of its instance says so. The colour of its own look
/// overrides that of its instance.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`, or a flag or colour is not as documented.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; `look` is initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_instance_look(scene: *mut oc_scene, id: u64, look: *const oc_look) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let state = read_or_default(look)?.to_rust()?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_instance_look(id, state)?))
    })
}

/// Sets the look of a part of an instance. Its child parts do not change. Takes effect at oc_scene_commit.
///
/// - `instance`: id of the instance.
/// - `part`: id of the part. If several parts of the model have this id, the first is meant.
/// - `look`: the new look. NULL: unchanged appearance.
///
/// The call is oc_scene_set_parts_look for one part.
///
/// Errors: as oc_scene_set_parts_look.
///
/// Thread safety: any thread. Blocks as oc_scene_set_parts_look does.
/// # Safety
/// `scene` is a live handle; `look` is initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_part_look(
    scene: *mut oc_scene,
    instance: u64,
    part: u64,
    look: *const oc_look,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let state = read_or_default(look)?.to_rust()?;
        handles::with_callbacks(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.set_part_look(instance, part, state)?)
        })
    })
}

/// Sets the look of many parts of an instance. Takes effect at oc_scene_commit.
///
/// - `instance`: id of the instance.
/// - `parts`: array of ids of parts. If several parts of the model have an id, the first is meant. Ignored if `count`
///   is 0.
/// - `flags`: OC_PARTS_ flags, combined with `|`, or 0.
/// - `look`: the new look. NULL: unchanged appearance.
///
/// What hides parts does not make a frame read more: blocks of hidden parts alone are not read, and a stand-in never
/// shows a hidden part, nor a part in another colour than its look's. The first call that hides a part of a model reads
/// the list of parts of each block from the file, some bytes for each block and part in it. These lists then stay in
/// memory and count against the budget.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no such instance or part, or a flag or colour is not as documented;
/// OC_STATUS_OVER_BUDGET, OC_STATUS_IO, OC_STATUS_CORRUPT and OC_STATUS_OUT_OF_MEMORY for the lists of parts. After an
/// error no look has changed.
///
/// Thread safety: any thread. Blocks while it reads; otherwise cheap.
/// # Safety
/// `scene` is a live handle; `parts` points to `count` ids; `look` is initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_parts_look(
    scene: *mut oc_scene,
    instance: u64,
    parts: *const u64,
    count: u64,
    flags: oc_parts_flags,
    look: *const oc_look,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let (state, scope) = (read_or_default(look)?.to_rust()?, scope(flags)?);
        let parts = ids(parts, count)?;
        handles::with_callbacks(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.set_parts_look(instance, &parts, scope, state)?)
        })
    })
}

/// Hides all parts of an instance but the given ones, and shows these. Colours and highlights do not change. Takes
/// effect at oc_scene_commit. oc_scene_clear_part_looks shows all parts again.
///
/// - `instance`: id of the instance.
/// - `parts`: array of ids of parts. If several parts of the model have an id, the first is meant. Ignored if `count`
///   is 0: all parts are then hidden.
/// - `flags`: OC_PARTS_ flags, combined with `|`, or 0.
///
/// Errors: as oc_scene_set_parts_look.
///
/// Thread safety: any thread. Blocks as oc_scene_set_parts_look does.
/// # Safety
/// `scene` is a live handle; `parts` points to `count` ids.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_isolate(
    scene: *mut oc_scene,
    instance: u64,
    parts: *const u64,
    count: u64,
    flags: oc_parts_flags,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let (scope, parts) = (scope(flags)?, ids(parts, count)?);
        handles::with_callbacks(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.isolate_parts(instance, &parts, scope)?)
        })
    })
}

/// Exchanges the model of an instance, for example after the model was built anew and opened. Takes effect at
/// oc_scene_commit.
///
/// - `instance`: id of the instance. It keeps its transform, mask and look.
/// - `model`: the new model, of the same context. The scene keeps it alive, and releases the old one once no frame or
///   batch uses it.
///
/// Each part keeps the look of the part with the same id in the old model. Looks of parts that the new model lacks are
/// lost.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no such instance or the model belongs to another context;
/// OC_STATUS_INVALID_STATE if another thread edits the looks of the instance at the same time; those of
/// oc_scene_set_parts_look if parts are hidden. After an error nothing has changed.
///
/// Thread safety: any thread. Blocks as oc_scene_set_parts_look does.
/// # Safety
/// `scene` and `model` are live handles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_model(scene: *mut oc_scene, instance: u64, model: *const oc_model) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let model: &Shell<ModelObject> = handles::borrow(model)?;
        handles::with_callbacks(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.set_model(instance, &model.model)?)
        })
    })
}

/// Removes the looks of all parts of an instance. Takes effect at oc_scene_commit.
///
/// - `instance`: id of the instance.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no such instance.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_clear_part_looks(scene: *mut oc_scene, instance: u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.clear_part_looks(instance)?))
    })
}
