//! Scenes in scenes, and the ways to what was hit there.

use super::guard::{Failure, Strided, bad, boundary, out, read_or_default};
use super::handles::{self, Shell};
use super::looks::oc_look;
use super::query::check_id;
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use super::view::transform;

/// Adds a scene to a scene as an instance. Takes effect at oc_scene_commit.
///
/// Each commit of `scene` takes `inner` as it was committed last. Its lights and its background are left out. Scenes
/// may be in scenes, up to 64 levels, and one scene any number of times: it takes some 700 bytes each time, however
/// much is in it, and less in arrays (oc_scene_add_instances). The mask and the look of the instance apply to all in
/// it: colours that `inner` sets have precedence. Its parts have looks in `inner` only.
///
/// - `inner`: another scene of the same context.
/// - `id`: the caller's own id. Must be unique in the scene and not OC_NO_ID. Hits return it as their instance.
/// - `world_from_inner`: transform of 12 doubles, finite and invertible. NULL: the identity.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented, or `inner` is or holds `scene`.
///
/// Ownership: `scene` keeps `inner` alive.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` and `inner` are live handles; `world_from_inner` has 12 doubles or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_add_scene(
    scene: *mut oc_scene,
    inner: *const oc_scene,
    id: u64,
    world_from_inner: *const f64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let inner: &Shell<SceneObject> = handles::borrow(inner)?;
        check_id(id)?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.add_scene(&inner.scene, id, transform(world_from_inner))?)
        })
    })
}

/// Sets the look of one occurrence of an instance: of the instance in one place of the scene that it is in, such as one
/// tree of a part of a forest that is there many times. Takes effect at oc_scene_commit.
///
/// The look applies to all parts of the instance in that place, and to no other place of it. Its colour has precedence
/// over those of the instance and of the scenes around it, but not over those of parts. What one of these hides or
/// highlights stays so. The ids on the way to the instance (oc_scene_get_path) are remembered: later commits keep the
/// look as long as they lead to an instance. For an instance that is in no other scene it is that of
/// oc_scene_set_instance_look.
///
/// - `occurrence`: `oc_hit.occurrence` of a hit since the last commit, or a value of OC_BUFFER_OCCURRENCE in a picture
///   that was requested since then.
/// - `look`: the look. NULL, or one that changes nothing, removes it.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if the scene has no such occurrence, or a flag or colour is not as documented;
/// OC_STATUS_OVER_BUDGET if the budget has no room for another look, some 300 bytes.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; `look` is initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_occurrence_look(
    scene: *mut oc_scene,
    occurrence: u64,
    look: *const oc_look,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let look = read_or_default(look)?.to_rust()?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_occurrence_look(occurrence, look)?))
    })
}

/// Returns the way to what a hit met: the ids of the instances from the outermost to the innermost. An instance that is
/// in no other scene has one.
///
/// - `occurrence`: `oc_hit.occurrence` of a hit since the last commit, or a value of OC_BUFFER_OCCURRENCE in a picture
///   that was requested since then.
/// - `out_ids`: receives the ids. NULL if `capacity` is 0.
/// - `capacity`: number of ids that `out_ids` has room for.
/// - `out_count`: receives the number of ids, also with OC_STATUS_BUFFER_TOO_SMALL.
/// - `out_world_from_model`: receives 12 doubles, the transform of the innermost instance to the world. NULL: ignored.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if the scene has no such occurrence; OC_STATUS_BUFFER_TOO_SMALL if
/// `capacity` is not 0 and below the number of ids.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; the outputs are writable as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_get_path(
    scene: *const oc_scene,
    occurrence: u64,
    out_ids: *mut u64,
    capacity: u64,
    out_count: *mut u64,
    out_world_from_model: *mut f64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let count = out(out_count, "out_count")?;
        let room = Strided::new(out_ids, capacity, 0, "out_ids")?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let Some((ids, world_from_model)) = scene.scene.state().path(occurrence) else {
                return bad(format!("the scene has no occurrence {occurrence}"));
            };
            count.write(ids.len() as u64);
            if room.count > 0 && ids.len() > room.count {
                return Err(Failure::TooSmall { need: ids.len() as u64, have: capacity });
            }
            ids.iter().take(room.count).enumerate().for_each(|(i, &id)| room.set(i, id));
            if !out_world_from_model.is_null() {
                out_world_from_model.cast::<[f64; 12]>().write_unaligned(world_from_model.to_cols_array());
            }
            Ok(())
        })
    })
}
