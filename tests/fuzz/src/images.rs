//! Pictures, as the texture of a GLB file: any bytes are decoded, or noted and left out.

use super::{importers, seeds};

/// Bytes that a reader may hold for a picture whatever its file: one that decodes to the most pixels that the readers
/// accept, and its levels.
pub const PICTURE: u64 = 1 << 30;

/// Reads a model of one triangle with this texture.
pub fn run(data: &[u8]) {
    importers::read(&["model.glb"], &seeds::textured(data), PICTURE);
}
