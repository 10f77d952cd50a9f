//! Scenes: instances, lights, the looks of parts; edits take effect at a commit.

use super::context::{ContextObject, oc_context};
use super::guard::{Checked, Sized32, Strided, bad, boundary, out, read, read_or_default, reserved};
use super::handles::{self, Shell, handle};
use super::model::{ModelObject, oc_model};
use super::query::check_id;
use super::status::oc_status;
use super::view::transform;
use crate::scene::{Background, Light, LightKind, Look, Scene};
use glam::DVec3;

/// What is looked at: instances of models, lights, the looks of parts. Edits collect until
/// oc_scene_commit; frames and batches in flight keep the state that they began with.
pub struct oc_scene {
    _private: [u8; 0],
}

handle!(oc_scene, SceneObject, 4);

pub(crate) struct SceneObject {
    pub(crate) scene: Scene,
}

/// How an instance or a part is shown: flags of oc_look.
pub type oc_look_flags = u32;
/// Rays do not meet it.
pub const OC_LOOK_HIDDEN: oc_look_flags = 1;
/// It is highlighted.
pub const OC_LOOK_SELECTED: oc_look_flags = 2;
/// It has the colour of oc_look instead of its own.
pub const OC_LOOK_COLOURED: oc_look_flags = 4;

/// How an instance or a part is shown. All zeros: as it is.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_look {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// OC_LOOK_ flags, joined with `|`.
    pub flags: oc_look_flags,
    /// Linear RGBA, alpha is the opacity; used with OC_LOOK_COLOURED.
    pub colour: [f32; 4],
}

// SAFETY: `repr(C)`, words and floats without padding, `struct_size` first.
unsafe impl Sized32 for oc_look {
    const NAME: &'static str = "oc_look";
}

impl oc_look {
    fn to_rust(self) -> Checked<Look> {
        let known = OC_LOOK_HIDDEN | OC_LOOK_SELECTED | OC_LOOK_COLOURED;
        if self.flags & !known != 0 {
            return bad(format!("oc_look.flags {:#x}: some are unknown", self.flags));
        }
        let colour = (self.flags & OC_LOOK_COLOURED != 0).then_some(self.colour);
        if colour.is_some_and(|c| c.iter().any(|x| !x.is_finite() || *x < 0.0)) {
            return bad("oc_look.colour must be finite, 0 or more");
        }
        Ok(Look { visible: self.flags & OC_LOOK_HIDDEN == 0, colour, selected: self.flags & OC_LOOK_SELECTED != 0 })
    }
}

/// The kind of a light.
pub type oc_light_kind = u32;
/// At the eye, without falloff and shadows.
pub const OC_LIGHT_HEAD: oc_light_kind = 0;
/// A point; its light falls off with the square of the distance.
pub const OC_LIGHT_POINT: oc_light_kind = 1;
/// From infinitely far away.
pub const OC_LIGHT_DIRECTIONAL: oc_light_kind = 2;

/// A light; an element of an array. All zeros: a white headlight.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_light {
    /// Where a point light is, or whereto a directional light shines (need not be unit). World space.
    pub vector: [f64; 3],
    /// Linear RGB, 0 or more. All 0: white.
    pub colour: [f32; 3],
    /// Factor to the colour. A white matt surface that faces a light (a point light at distance 1) of
    /// intensity 1 is white. 0: 1.
    pub intensity: f32,
    /// An OC_LIGHT_ number.
    pub kind: oc_light_kind,
    /// 1: it casts shadows; 0: it does not. A transparent part lets through 1 minus its opacity, as of what is seen.
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

/// Makes an empty scene with a headlight.
///
/// Ownership: the caller owns a count. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_scene` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_create(context: *const oc_context, out_scene: *mut *mut oc_scene) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_scene, "out_scene")?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let scene = Scene::new(&context.context);
            out.write(handles::give::<oc_scene>(SceneObject { scene }));
            Ok(())
        })
    })
}

/// Adds a model as an instance with the caller's own `id`, which must be new in the scene, and not OC_NO_ID.
/// `world_from_model`: 12 doubles, invertible; NULL leaves the model where it is.
///
/// Ownership: the scene keeps the model alive. Thread safety: any thread. Cheap.
/// # Safety
/// Live handles; `world_from_model` has 12 doubles or is NULL.
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

/// Removes an instance.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_remove_instance(scene: *mut oc_scene, id: u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe { handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.remove_instance(id)?)) })
}

/// Moves an instance; the matrix as for oc_scene_add_instance.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `world_from_model` has 12 doubles or is NULL.
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

/// Sets which rays of batches see an instance: those with a common bit in their mask. At first all do.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_instance_mask(scene: *mut oc_scene, id: u64, mask: u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_instance_mask(id, mask)?))
    })
}

/// Sets how an instance is shown. What its parts say for themselves comes first; hidden in either is
/// hidden. `look` may be NULL: as it is.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `look` initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_instance_look(scene: *mut oc_scene, id: u64, look: *const oc_look) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let state = read_or_default(look)?.to_rust()?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_instance_look(id, state)?))
    })
}

/// Sets how the part with id `part` of an instance is shown, without the parts below it. `look` may be
/// NULL: as it is.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `look` initialised or NULL.
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
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_part_look(instance, part, state)?))
    })
}

/// Shows all parts of an instance as they are.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_clear_part_looks(scene: *mut oc_scene, instance: u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.clear_part_looks(instance)?))
    })
}

/// More lights than any scene has: a larger count is a mistake.
const MAX_LIGHTS: u64 = 65536;

/// Replaces all lights; none at all leaves the ambient light of the frame.
///
/// `lights`: `count` of them, up to 65536, `stride` bytes apart (0: tightly packed). Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; the array is as said.
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
            return bad(format!("{count} lights; at most {MAX_LIGHTS}"));
        }
        let lights = Strided::new(lights, count, stride, "lights")?;
        let lights: Checked<Vec<Light>> = (0..lights.count).map(|i| lights.get(i).to_rust()).collect();
        let lights = lights?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_lights(lights)?))
    })
}

/// What is seen where nothing is. All zeros: black and transparent.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_background {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Linear RGBA of the lowest row.
    pub bottom: [f32; 4],
    /// Linear RGBA of the highest row.
    pub top: [f32; 4],
}

// SAFETY: `repr(C)`, words and floats without padding, `struct_size` first.
unsafe impl Sized32 for oc_background {
    const NAME: &'static str = "oc_background";
}

/// Replaces the background; NULL brings back the grey one that a scene begins with.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `background` initialised or NULL.
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

/// Makes all edits since the last commit visible at once to frames and batches that begin from now on.
///
/// Takes time by the number of instances. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_commit(scene: *mut oc_scene) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe { handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.commit()?)) })
}

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_retain(scene: *mut oc_scene) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(scene) }
}

/// Takes a count back; frames and batches in flight keep what they need. NULL does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_release(scene: *mut oc_scene) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(scene) }
}
