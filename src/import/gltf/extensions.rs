//! The extensions that a file may require.
//!
//! A file states in `extensionsRequired` without which extensions it cannot be shown. Those that this reader honours,
//! and those that do not change the geometry, are accepted. A file that requires any other is refused, with its name.

use super::model::Model;
use crate::import::input::Parsed;

/// Accepted extensions.
const ACCEPTED: [&str; 14] = [
    // Honoured.
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_node_visibility",
    "EXT_mesh_gpu_instancing",
    "CESIUM_RTC",
    // Additional data next to the geometry.
    "KHR_animation_pointer",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_interactivity",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_structural_metadata",
    "EXT_mesh_manifold",
    "CESIUM_primitive_outline",
];

/// Beginnings of the names of extensions of materials, textures, lights and the like.
const ACCEPTED_KINDS: [&str; 14] = [
    "KHR_materials_",
    "EXT_materials_",
    "ADOBE_materials_",
    "MSFT_packing_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "MOZ_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_audio",
    "KHR_xmp",
    "KHR_physics_",
    "VRMC_",
];

/// Checks that the file requires no extension that this reader does not know.
pub(crate) fn check(model: &Model) -> Parsed<()> {
    let is_accepted =
        |name: &str| ACCEPTED.contains(&name) || ACCEPTED_KINDS.iter().any(|beginning| name.starts_with(beginning));
    match model.extensions_required.iter().find(|name| !is_accepted(name)) {
        Some(name) => Err(format!("needs the extension {}, which is not supported", name.escape_debug()).into()),
        None => Ok(()),
    }
}
