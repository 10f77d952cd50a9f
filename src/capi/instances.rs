//! Arrays of instances.

use super::guard::{Checked, Sized32, Strided, bad, boundary, read, reserved};
use super::handles::{self, Shell};
use super::model::{ModelObject, oc_model};
use super::query::check_id;
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use crate::scene::{Instances, Place, Prototypes, Transforms};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// Form of the transforms of an array, from the space of a model or a scene to world space.
pub type oc_transform_form = u32;
/// 12 doubles by column: the images of the three axes, then the translation. As for oc_scene_add_instance.
pub const OC_TRANSFORM_AFFINE_F64: oc_transform_form = 0;
/// The same in 12 floats, for models near zero.
pub const OC_TRANSFORM_AFFINE_F32: oc_transform_form = 1;
/// An oc_place.
pub const OC_TRANSFORM_PLACE: oc_transform_form = 2;

/// A position with a rotation and a scale. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_place {
    /// Place of the origin of the model or scene in world space. Finite.
    pub position: [f64; 3],
    /// Quaternion x, y, z, w of the rotation, applied after the scale. Finite and not zero; need not be unit.
    pub rotation: [f32; 4],
    /// Scale along all axes. Finite and not 0. Below 0 it mirrors at this origin.
    pub scale: f32,
    /// Must be 0.
    pub reserved: u32,
}

/// Many instances of a few models, or of a few scenes. OC_INIT and the prototypes or the scenes, the transforms and
/// their count are the least.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_instances {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Form of `transforms`.
    pub form: oc_transform_form,
    /// The models, all of the scene's context. NULL if there are scenes.
    pub prototypes: *const *const oc_model,
    /// Number of models, at least 1; 0 if there are scenes.
    pub prototype_count: u64,
    /// Index among the models or the scenes of each instance's own, tightly packed. NULL: all are of the first.
    pub prototype_of: *const u32,
    /// The transform of each instance, finite and invertible.
    pub transforms: *const std::ffi::c_void,
    /// Bytes from one transform to the next. 0: tightly packed.
    pub stride: u64,
    /// Number of instances, from 1 to below 2^31.
    pub count: u64,
    /// Id of the first instance; each further one has the next higher id. None may be of another instance of the scene,
    /// nor OC_NO_ID.
    pub first_id: u64,
    /// A ray of a batch can hit the instances only if its mask has a common bit with this one. 0: all bits.
    pub mask: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Scenes as instances, as oc_scene_add_scene describes. NULL if there are models.
    pub scenes: *const *const oc_scene,
    /// Number of scenes, at least 1; 0 if there are models.
    pub scene_count: u64,
    /// The mask of each instance: a ray can hit it only if its mask has a bit in common with both this one and `mask`.
    /// 0: no ray. NULL: all bits.
    pub masks: *const u32,
    /// Bytes from one mask to the next. 0: tightly packed.
    pub mask_stride: u64,
    /// The tint of each instance, 4 bytes: factors to linear red, green and blue and to the opacity of all that it
    /// shows, where 255 stands for 1. With an opacity below 255 it is see-through. Colours of looks replace those that
    /// a tint changes, and have no tint. Those of scenes in scenes are multiplied. NULL: no instance has a tint.
    pub tints: *const u8,
    /// Bytes from one tint to the next. 0: tightly packed.
    pub tint_stride: u64,
}

// SAFETY: `repr(C)`, numbers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_instances {
    const NAME: &'static str = "oc_instances";
}

/// Transforms in the caller's memory.
struct Given {
    form: oc_transform_form,
    transforms: *const std::ffi::c_void,
    count: u64,
    stride: u64,
}

/// Copies the transforms.
///
/// # Safety
/// `given` describes an array of the form that it names, which is readable.
unsafe fn copied(given: &Given) -> Checked<Transforms> {
    // SAFETY: the caller's contract, for each form.
    unsafe fn all<T: Copy, U>(given: &Given, of: impl Fn(T) -> Checked<U>) -> Checked<Arc<[U]>> {
        let from = Strided::new(given.transforms.cast::<T>(), given.count, given.stride, "transforms")?;
        // SAFETY: the caller's contract; each index is below the count.
        (0..from.count).map(|i| of(unsafe { from.get(i) })).collect()
    }
    // SAFETY: the caller's contract.
    unsafe {
        match given.form {
            OC_TRANSFORM_AFFINE_F64 => {
                let affine = |columns: [f64; 12]| Ok(DAffine3::from_cols_array(&columns));
                Ok(Transforms::Affine(all(given, affine)?))
            }
            OC_TRANSFORM_AFFINE_F32 => Ok(Transforms::Affine32(all(given, |columns: [f32; 12]| Ok(columns))?)),
            OC_TRANSFORM_PLACE => {
                let place = |it: oc_place| {
                    reserved(it.reserved, "oc_place.reserved")?;
                    Ok(Place { position: DVec3::from_array(it.position), rotation: it.rotation, scale: it.scale })
                };
                Ok(Transforms::Places(all(given, place)?))
            }
            other => bad(format!("the form {other} of transforms is unknown")),
        }
    }
}

/// The models or the scenes of an array.
///
/// # Safety
/// Those of `given` are as [`oc_instances`] documents.
unsafe fn prototypes(given: &oc_instances) -> Checked<Prototypes> {
    let (has_models, has_scenes) = (given.prototype_count > 0, given.scene_count > 0);
    if has_models && has_scenes {
        return bad("oc_instances has prototypes and scenes; an array has one of both");
    }
    // SAFETY: the caller's contract; each index is below the count.
    unsafe {
        if has_scenes {
            let scenes = Strided::new(given.scenes, given.scene_count, 0, "oc_instances.scenes")?;
            let scene = |i| -> Checked<_> {
                let scene: &Shell<SceneObject> = handles::borrow(scenes.get(i))?;
                Ok(scene.scene.clone())
            };
            return Ok(Prototypes::Scenes((0..scenes.count).map(scene).collect::<Checked<_>>()?));
        }
        let models = Strided::new(given.prototypes, given.prototype_count, 0, "oc_instances.prototypes")?;
        let model = |i| -> Checked<_> {
            let model: &Shell<ModelObject> = handles::borrow(models.get(i))?;
            Ok(model.model.clone())
        };
        Ok(Prototypes::Models((0..models.count).map(model).collect::<Checked<_>>()?))
    }
}

/// Fails for more than an array may have.
fn check_count(count: u64, what: &str) -> Checked<()> {
    if count >= 1 << 31 { bad(format!("{count} {what} are too many")) } else { Ok(()) }
}

/// Copies masks.
///
/// # Safety
/// `masks` points to `count` masks, `stride` bytes apart.
unsafe fn masks_of(masks: *const u32, count: u64, stride: u64) -> Checked<Arc<[u32]>> {
    let all = Strided::new(masks, count, stride, "masks")?;
    // SAFETY: the function's own contract; each index is below the count.
    Ok((0..all.count).map(|i| unsafe { all.get(i) }).collect())
}

/// Copies tints.
///
/// # Safety
/// `tints` points to `count` tints of 4 bytes, `stride` bytes apart.
unsafe fn tints_of(tints: *const u8, count: u64, stride: u64) -> Checked<Arc<[[u8; 4]]>> {
    let all = Strided::new(tints.cast::<[u8; 4]>(), count, stride, "tints")?;
    // SAFETY: the function's own contract; each index is below the count.
    Ok((0..all.count).map(|i| unsafe { all.get(i) }).collect())
}

/// Adds many instances of a few models or scenes at once. Takes effect at oc_scene_commit.
///
/// The arrays are copied: 96 bytes for an affine transform in doubles, 48 for the other forms, 4 for an index of a
/// prototype, and 4 for a mask or a tint, unless 512 in a row have all bits or no tint. A commit adds some 60 to 77
/// bytes for each mesh that is placed, or for each member that is a scene, for the tree over all of them, 16 more if a
/// transform stretches or scenes differ in the number of meshes in them, and 250 while it runs. The members of the
/// array are instances like those of oc_scene_add_instance, but none can be removed alone or given another model, and
/// one with an oc_place takes another place (oc_scene_set_transforms), but no matrix. A mask or a look that is set for
/// one of them takes memory for that one.
///
/// - `instances`: models or scenes, transforms and ids.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if a member is not as documented: the message names the first instance that is
/// wrong; OC_STATUS_OVER_BUDGET if the budget has no room for the array. Nothing is then added.
///
/// Ownership: the scene keeps the models and scenes alive; the arrays are not used after the call.
/// Thread safety: any thread. Takes time in proportion to the number of instances.
/// # Safety
/// `scene` is a live handle; `instances` is initialised, its models and scenes are live handles, and its arrays are as
/// documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_add_instances(scene: *mut oc_scene, instances: *const oc_instances) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let given = read(instances)?;
        reserved(given.reserved, "oc_instances.reserved")?;
        if given.count == 0 || given.count >= 1 << 31 {
            return bad(format!("oc_instances.count {} must be from 1 to below 2^31", given.count));
        }
        check_id(given.first_id)?;
        let prototypes = prototypes(&given)?;
        let prototype_of: Arc<[u32]> = if given.prototype_of.is_null() {
            Arc::new([])
        } else {
            let all = Strided::new(given.prototype_of, given.count, 0, "oc_instances.prototype_of")?;
            (0..all.count).map(|i| all.get(i)).collect()
        };
        let mask = if given.mask == 0 { u32::MAX } else { given.mask };
        let oc_instances { form, transforms, count, stride, .. } = given;
        let transforms = copied(&Given { form, transforms, count, stride })?;
        let first_id = given.first_id;
        let has = [!given.masks.is_null(), !given.tints.is_null()];
        let masks = has[0].then(|| masks_of(given.masks, count, given.mask_stride)).transpose()?;
        let tints = has[1].then(|| tints_of(given.tints, count, given.tint_stride)).transpose()?;
        let instances = Instances { prototypes, prototype_of, transforms, first_id, mask, masks, tints };
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.add_instances(&instances)?))
    })
}

/// Moves instances of an array. Takes effect at oc_scene_commit.
///
/// - `first_id`: id of the first; each further one has the next higher id. All are of one array.
/// - `form`: that of the array's transforms.
/// - `transforms`: the new transforms, as in oc_instances.
/// - `count`: number of transforms.
/// - `stride`: bytes from one transform to the next. 0: tightly packed.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented: the message names the first transform that
/// is wrong; OC_STATUS_OVER_BUDGET if the budget has no room for copies of the parts of the array that change, because
/// jobs in flight and the last commit need them as they are. Nothing has then moved.
///
/// Thread safety: any thread. Takes time in proportion to `count`. So does the commit, if nothing else was moved, added
/// or removed, and no more than an eighth of the meshes have moved since a commit placed all.
/// # Safety
/// `scene` is a live handle; the array is as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_transforms(
    scene: *mut oc_scene,
    first_id: u64,
    form: oc_transform_form,
    transforms: *const std::ffi::c_void,
    count: u64,
    stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        check_count(count, "transforms")?;
        let all = copied(&Given { form, transforms, count, stride })?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_transforms(first_id, &all)?))
    })
}

/// Replaces the masks of instances of an array. Takes effect at oc_scene_commit.
///
/// - `first_id`: id of the first; each further one has the next higher id. All are of one array.
/// - `masks`: the new masks, as in oc_instances. They replace those of oc_scene_set_instance_mask too, and that call
///   replaces the mask of the array with that of the instance.
/// - `count`: number of masks.
/// - `stride`: bytes from one mask to the next. 0: tightly packed.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented; OC_STATUS_OVER_BUDGET if the budget has no
/// room for copies of the parts of the array that change. No mask has then changed.
///
/// Thread safety: any thread. Takes time in proportion to `count`; the commit as after oc_scene_set_transforms, where
/// instances with new masks count as moved.
/// # Safety
/// `scene` is a live handle; the array is as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_masks(
    scene: *mut oc_scene,
    first_id: u64,
    masks: *const u32,
    count: u64,
    stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        check_count(count, "masks")?;
        let all = masks_of(masks, count, stride)?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_masks(first_id, &all)?))
    })
}

/// Replaces the tints of instances of an array. Takes effect at oc_scene_commit.
///
/// - `first_id`: id of the first; each further one has the next higher id. All are of one array.
/// - `tints`: the new tints, 4 bytes each, as in oc_instances.
/// - `count`: number of tints.
/// - `stride`: bytes from one tint to the next. 0: tightly packed.
///
/// Errors: as oc_scene_set_masks.
///
/// Thread safety: any thread. Takes time as oc_scene_set_masks does.
/// # Safety
/// `scene` is a live handle; the array is as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_set_tints(
    scene: *mut oc_scene,
    first_id: u64,
    tints: *const u8,
    count: u64,
    stride: u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        check_count(count, "tints")?;
        let all = tints_of(tints, count, stride)?;
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.set_tints(first_id, &all)?))
    })
}

/// Removes all instances that one call of oc_scene_add_instances added. Takes effect at oc_scene_commit.
///
/// - `first_id`: id of the first of them.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if no call added instances from that id on.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_remove_instances(scene: *mut oc_scene, first_id: u64) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with(scene, |scene: &Shell<SceneObject>| Ok(scene.scene.remove_instances(first_id)?))
    })
}
