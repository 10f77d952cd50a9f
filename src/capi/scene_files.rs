//! Scene files.

use super::context::{ContextObject, oc_context};
use super::guard::{self, boundary, out};
use super::handles::{self, Shell};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::scene::Scene;
use std::ffi::c_char;

/// Saves what the last commit has in a scene file, which oc_scene_open opens.
///
/// The file holds the instances, arrays and scenes in scenes with their ids, transforms, masks and looks, and the
/// lights and the background of the scene. A single instance takes 112 bytes; a member of an array 96, 48 or 44 for the
/// forms OC_TRANSFORM_AFFINE_F64, OC_TRANSFORM_AFFINE_F32 and OC_TRANSFORM_PLACE, and 4 for an index of a prototype. A
/// scene that is in several places takes its bytes once. Models stay in their own files, which the scene file names by
/// their paths, relative to its own folder.
///
/// - `path`: path of the scene file. A file of this name is replaced once the new one is complete.
///
/// Errors:
/// - OC_STATUS_INVALID_STATE: something cannot be saved; the message names it. This is a model that was not opened from
///   a path or whose file was replaced since then, a path that is no text in UTF-8, a look of parts, or a look of one
///   occurrence.
/// - OC_STATUS_INVALID_ARGUMENT: `path` is the file of a model of the scene.
/// - OC_STATUS_IO: the file cannot be written.
///
/// No file is then written, and an older one stays.
///
/// Thread safety: any thread. Blocks: writes the disk.
/// # Safety
/// `scene` is a live handle; `path` ends with 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_save(scene: *const oc_scene, path: *const c_char) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let path = guard::path(path, "path")?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.save(path).map(drop)?))
    })
}

/// Opens a scene file, and the models that it names.
///
/// The scene is committed, and can be edited like any other. Scenes in it stay as they were saved: there are no handles
/// of them. The memory budget of the context counts the scene and its models as if they had been made by other calls,
/// and some kilobytes for each scene in it, which other calls do not count.
///
/// - `path`: path of the scene file.
/// - `out_scene`: receives the scene.
///
/// Errors:
/// - OC_STATUS_CORRUPT: the file is damaged or is no scene file, or a model is not the file that the scene was saved
///   with; the message names the file and the place in it.
/// - OC_STATUS_NEWER_FORMAT: a newer version of the library wrote the file.
/// - OC_STATUS_IO: the file or a model cannot be read.
/// - OC_STATUS_OVER_BUDGET: the budget has no room for the scene or a model. oc_last_error_need returns the least
///   budget that suffices for what failed.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Blocks: reads the disk, as oc_model_open does for each model.
/// # Safety
/// `context` is a live handle; `path` ends with 0; `out_scene` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_open(
    context: *const oc_context,
    path: *const c_char,
    out_scene: *mut *mut oc_scene,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_scene, "out_scene")?;
        let path = guard::path(path, "path")?;
        let shared = handles::share(context)?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let scene = Scene::open(&context.context, path)?;
            out.write(handles::give::<oc_scene>(SceneObject { scene, context: shared }));
            Ok(())
        })
    })
}
