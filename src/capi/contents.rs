//! The content of a build except triangles: materials, parts, shared meshes and their instances.

use super::build::{Input, oc_build, with_input};
use super::guard::{self, Checked, Sized32, bad, boundary, out, read, reserved};
use super::query::check_id;
use super::status::oc_status;
use super::view::transform;
use crate::import::{MaterialDesc, MeshKey, PartDesc, PartKey, Sink};
use std::ffi::c_char;

/// Material of a part. Colours are linear. All zeros: grey, opaque, matt.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_material {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Linear RGB, each 0 to 1. All 0 with opacity 0: grey (0.6).
    pub colour: [f32; 3],
    /// Opacity, 0 to 1; 1 is opaque. 0: 1.
    pub opacity: f32,
    /// Metalness, 0 to 1.
    pub metalness: f32,
    /// Roughness, 0 to 1. 0: 0.6.
    pub roughness: f32,
    /// Must be 0.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, integers and floats without padding, `struct_size` first.
unsafe impl Sized32 for oc_material {
    const NAME: &'static str = "oc_material";
}

impl oc_material {
    fn to_rust(self) -> Checked<MaterialDesc> {
        reserved(self.reserved, "oc_material.reserved")?;
        let numbers = [self.colour[0], self.colour[1], self.colour[2], self.opacity, self.metalness, self.roughness];
        if numbers.iter().any(|x| !(0.0..=1.0).contains(x)) {
            return bad("oc_material: all numbers must be from 0 to 1");
        }
        let default = MaterialDesc::default();
        let grey = self.colour == [0.0; 3] && self.opacity == 0.0;
        Ok(MaterialDesc {
            colour: if grey { default.colour } else { self.colour },
            opacity: if self.opacity == 0.0 { 1.0 } else { self.opacity },
            metalness: self.metalness,
            roughness: if self.roughness == 0.0 { default.roughness } else { self.roughness },
        })
    }
}

/// Adds a material.
///
/// - `material`: copied.
/// - `out_material`: receives the number of the material: 1, 2, 3, ... (0 is the default material).
///
/// Errors: OC_STATUS_INVALID_STATE after oc_build_start.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `build` is a live handle; `material` is initialised; `out_material` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_material(
    build: *mut oc_build,
    material: *const oc_material,
    out_material: *mut u32,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_material, "out_material")?;
        let material = read(material)?.to_rust()?;
        with_input(build, |input| {
            let key = input.builder.material(material)?;
            input.materials.push(key);
            out.write(input.materials.len() as u32);
            Ok(())
        })
    })
}

/// A part: the unit that a user selects, hides or colours.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_part {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Number of a material from oc_build_add_material. 0: the default material.
    pub material: u32,
    /// The caller's own id. Must be unique in the build and not OC_NO_ID. Hits and pictures contain it.
    pub id: u64,
    /// Id of the parent part, which must have been added before. Ignored if `has_parent` is 0.
    pub parent: u64,
    /// Name in UTF-8. The string is copied. NULL: no name.
    pub name: *const c_char,
    /// 1: the part has a parent. 0: it has none.
    pub has_parent: u32,
    /// Must be 0.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, integers and a pointer without padding, `struct_size` first.
unsafe impl Sized32 for oc_part {
    const NAME: &'static str = "oc_part";
}

/// Adds a part.
///
/// - `part`: copied.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: the id is taken; the parent or the material was not added.
/// - OC_STATUS_INVALID_STATE: after oc_build_start.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `build` is a live handle; `part` is initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_part(build: *mut oc_build, part: *const oc_part) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let part = read(part)?;
        reserved(part.reserved, "oc_part.reserved")?;
        check_id(part.id)?;
        let name = guard::optional_text(part.name, "oc_part.name")?.unwrap_or("").to_string();
        with_input(build, |input| input.add_part(&part, name))
    })
}

impl Input {
    fn part(&self, id: u64) -> Checked<PartKey> {
        match self.parts.get(&id) {
            Some(key) => Ok(*key),
            None => bad(format!("no part {id} was added")),
        }
    }

    fn add_part(&mut self, part: &oc_part, name: String) -> Checked<()> {
        if self.parts.contains_key(&part.id) {
            return bad(format!("part {} was already added", part.id));
        }
        let parent = match part.has_parent {
            0 => None,
            1 => Some(self.part(part.parent)?),
            _ => return bad("oc_part.has_parent must be 0 or 1"),
        };
        let material = match part.material {
            0 => None,
            n => match self.materials.get(n as usize - 1) {
                Some(key) => Some(*key),
                None => return bad(format!("no material {n} was added")),
            },
        };
        let key = self.builder.part(PartDesc { id: Some(part.id), name, parent, material })?;
        self.parts.insert(part.id, key);
        self.part_count += 1;
        Ok(())
    }

    /// Returns the builder's keys of a mesh number and of a part in that mesh.
    pub(super) fn target(&self, mesh: u32, part: u64) -> Checked<(MeshKey, u32)> {
        if mesh == 0 {
            return Ok((MeshKey::DIRECT, self.part(part)?));
        }
        let Some((key, local_parts)) = self.meshes.get(mesh as usize - 1) else {
            return bad(format!("no shared mesh {mesh} was added"));
        };
        match u32::try_from(part) {
            Ok(part) if part < *local_parts => Ok((*key, part)),
            _ => bad(format!("shared mesh {mesh} has {local_parts} parts; part {part} does not exist")),
        }
    }
}

/// Begins a shared mesh. Its triangles are stored once, and instances place it any number of times.
///
/// - `parts`: number of parts of the mesh, 1 to 2^32 - 2. They are numbered from 0.
/// - `out_mesh`: receives the number of the mesh: 1, 2, 3, ...
///
/// Errors: OC_STATUS_INVALID_STATE after oc_build_start.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `build` is a live handle; `out_mesh` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_shared_mesh(build: *mut oc_build, parts: u32, out_mesh: *mut u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_mesh, "out_mesh")?;
        with_input(build, |input| {
            let key = input.builder.shared_mesh(parts)?;
            input.meshes.push((key, parts));
            out.write(input.meshes.len() as u32);
            Ok(())
        })
    })
}

/// Places a shared mesh.
///
/// - `mesh`: number of the mesh.
/// - `first_part`: id of the part that part 0 of the mesh becomes here. Part 1 becomes the part that was added next
///   after it, and so on.
/// - `world_from_mesh`: transform of 12 doubles, invertible. NULL: the identity.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: there is no such mesh or part; fewer parts than the mesh has were added from
///   `first_part` on; the transform is not finite or not invertible.
/// - OC_STATUS_INVALID_STATE: after oc_build_start.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `build` is a live handle; `world_from_mesh` has 12 doubles or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_build_add_instance(
    build: *mut oc_build,
    mesh: u32,
    first_part: u64,
    world_from_mesh: *const f64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        with_input(build, |input| {
            let Some((key, local_parts)) = (mesh as usize).checked_sub(1).and_then(|m| input.meshes.get(m)).copied()
            else {
                return bad(format!("no shared mesh {mesh} was added"));
            };
            let first = input.part(first_part)?;
            if u64::from(first) + u64::from(local_parts) > u64::from(input.part_count) {
                return bad(format!(
                    "the mesh has {local_parts} parts, but fewer parts were added from part {first_part} on"
                ));
            }
            Ok(input.builder.instance(key, transform(world_from_mesh), first)?)
        })
    })
}
