//! Scenes: instances and lights. Edits take effect at a commit.

use super::context::{ContextObject, oc_context};
use super::guard::{Checked, Sized32, Strided, bad, boundary, out, read, reserved};
use super::handles::{self, Shell, handle};
use super::model::{ModelObject, oc_model};
use super::query::check_id;
use super::status::oc_status;
use super::view::transform;
use crate::scene::{Background, Light, LightKind, Scene};
use glam::DVec3;
use std::sync::Arc;

/// A scene: instances of models, lights, and the looks of parts.
///
/// Edits take effect together at oc_scene_commit. Frames and batches in flight keep the state that they began with.
pub struct oc_scene {
    _private: [u8; 0],
}

handle!(oc_scene, SceneObject, 4);

pub(crate) struct SceneObject {
    pub(crate) scene: Scene,
    /// The context in which it was created.
    pub(crate) context: Arc<Shell<ContextObject>>,
}

/// Kind of a light.
pub type oc_light_kind = u32;
/// At the eye. No falloff, no shadows.
pub const OC_LIGHT_HEAD: oc_light_kind = 0;
/// At a point. Its light falls off with the square of the distance.
pub const OC_LIGHT_POINT: oc_light_kind = 1;
/// Infinitely far away.
pub const OC_LIGHT_DIRECTIONAL: oc_light_kind = 2;

/// A light. Element of an array. All zeros: a white headlight.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_light {
    /// World space, finite. Point light: position. Directional light: direction in which the light travels; must not be
    /// zero, need not be unit. Headlight: ignored.
    pub vector: [f64; 3],
    /// Linear RGB, finite and 0 or more. All 0: white.
    pub colour: [f32; 3],
    /// Factor of the colour, finite and 0 or more. A white matt surface that faces a light of intensity 1 is white
    /// (point light: at distance 1). 0: 1.
    pub intensity: f32,
    /// One of the OC_LIGHT_ constants.
    pub kind: oc_light_kind,
    /// 1: the light casts shadows. 0: it does not. A transparent part transmits the share 1 - opacity of the light,
    /// as it does of the surfaces seen through it.
    pub shadows: u32,
}

impl oc_light {
    fn to_rust(self) -> Checked<Light> {
        let vector = DVec3::from_array(self.vector);
        let kind = match self.kind {
            OC_LIGHT_HEAD => LightKind::Headlight,
            OC_LIGHT_POINT => LightKind::Point(vector),
            OC_LIGHT_DIRECTIONAL => LightKind::Directional(vector),
            other => return bad(format!("oc_light.kind {other} is unknown")),
        };
        if self.shadows > 1 {
            return bad("oc_light.shadows must be 0 or 1");
        }
        let colour = if self.colour == [0.0; 3] { [1.0; 3] } else { self.colour };
        let intensity = if self.intensity == 0.0 { 1.0 } else { self.intensity };
        let light = Light { kind, colour, intensity, shadows: self.shadows == 1 };
        light.check()?;
        Ok(light)
    }
}

/// Creates an empty scene with a headlight.
///
/// - `out_scene`: receives the scene.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `context` is a live handle; `out_scene` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_create(context: *const oc_context, out_scene: *mut *mut oc_scene) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_scene, "out_scene")?;
        let shared = handles::share(context)?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let scene = Scene::new(&context.context);
            out.write(handles::give::<oc_scene>(SceneObject { scene, context: shared }));
            Ok(())
        })
    })
}

/// Adds a model to the scene as an instance. Takes effect at oc_scene_commit.
///
/// - `model`: a model of the same context.
/// - `id`: the caller's own id. Must be unique in the scene and not OC_NO_ID.
/// - `world_from_model`: transform of 12 doubles, finite and invertible. NULL: the identity.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented; OC_STATUS_OVER_BUDGET if the budget has no
/// room for another instance.
///
/// Ownership: the scene keeps the model alive.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` and `model` are live handles; `world_from_model` has 12 doubles or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_add_instance(
    scene: *mut oc_scene,
    model: *const oc_model,
    id: u64,
    world_from_model: *const f64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let model: &Shell<ModelObject> = handles::borrow(model)?;
        check_id(id)?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.add_instance(&model.model, id, transform(world_from_model))?)
        })
    })
}

/// Removes an instance. Takes effect at oc_scene_commit.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_remove_instance(scene: *mut oc_scene, id: u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe { handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.remove_instance(id)?)) })
}

/// Replaces the transform of an instance. Takes effect at oc_scene_commit.
///
/// - `id`: id of the instance.
/// - `world_from_model`: as for oc_scene_add_instance.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`, or the transform is not invertible.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; `world_from_model` has 12 doubles or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_transform(
    scene: *mut oc_scene,
    id: u64,
    world_from_model: *const f64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(scene, |scene: &Shell<SceneObject>| {
            Ok(scene.scene.set_transform(id, transform(world_from_model))?)
        })
    })
}

/// Sets the mask of an instance. Takes effect at oc_scene_commit.
///
/// - `id`: id of the instance.
/// - `mask`: a ray of a batch can hit the instance only if its mask has a common bit with this one. Initially all bits
///   are set.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_instance_mask(scene: *mut oc_scene, id: u64, mask: u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_instance_mask(id, mask)?))
    })
}

/// No scene needs more lights: a larger count is a mistake of the caller.
const MAX_LIGHTS: u64 = 65536;

/// Replaces all lights. Takes effect at oc_scene_commit. Without lights only the ambient light of the frame remains.
///
/// - `lights`: array of lights. Ignored if `count` is 0.
/// - `count`: number of lights, at most 65536.
/// - `stride`: bytes from one light to the next. 0: tightly packed.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if a light is not as documented. No light is replaced.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; the array is as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_lights(
    scene: *mut oc_scene,
    lights: *const oc_light,
    count: u64,
    stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        if count > MAX_LIGHTS {
            return bad(format!("{count} lights are too many; at most {MAX_LIGHTS} are allowed"));
        }
        let lights = Strided::new(lights, count, stride, "lights")?;
        let lights: Checked<Vec<Light>> = (0..lights.count).map(|i| lights.get(i).to_rust()).collect();
        let lights = lights?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_lights(lights)?))
    })
}

/// Background of a picture: a vertical gradient. All numbers must be finite and 0 or more. All zeros: black and
/// transparent.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_background {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Linear RGBA at the bottom of the picture.
    pub bottom: [f32; 4],
    /// Linear RGBA at the top of the picture.
    pub top: [f32; 4],
}

// SAFETY: `repr(C)`, integers and floats without padding, `struct_size` first.
unsafe impl Sized32 for oc_background {
    const NAME: &'static str = "oc_background";
}

/// Replaces the background. Takes effect at oc_scene_commit.
///
/// - `background`: the new background. NULL: the initial grey one.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if a number is not as documented.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; `background` is initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_background(scene: *mut oc_scene, background: *const oc_background) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let background = if background.is_null() {
            Background::default()
        } else {
            let given = read(background)?;
            reserved(given.reserved, "oc_background.reserved")?;
            Background::Gradient { bottom: given.bottom, top: given.top }
        };
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_background(background)?))
    })
}

/// Makes all edits since the last commit take effect at once, for frames, batches and other queries that begin later.
///
/// Placed meshes, instances and looks of parts count against the budget, but for 80 KiB of each scene.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if the scene would hold 2^31 or more placed meshes or instances of its own, or
/// 2^63 with those in scenes in it, scenes in scenes at more than 64 levels, or transforms that are singular or nearly
/// so together; OC_STATUS_OVER_BUDGET if the budget has no room for them beside the data that must stay. Later jobs
/// then see the scene as it was before.
///
/// Thread safety: any thread. Cheap. Takes time in proportion to the number of instances, or of those that have moved:
/// see oc_scene_set_transforms.
/// # Safety
/// `scene` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_commit(scene: *mut oc_scene) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe { handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.commit()?)) })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_retain(scene: *mut oc_scene) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(scene) }
}

/// Releases one reference. Frames and batches in flight keep the data that they need. NULL: does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_release(scene: *mut oc_scene) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(scene) }
}
