//! Wavefront OBJ: polygons in objects and groups, materials from libraries next to the file.
//!
//! Our own reader, because the crates at hand load whole files, keep neither objects above groups
//! nor the line of an error, and hold texture coordinates and normals that we do not want.
//!
//! The file is read twice: first for its objects, groups and materials, then for its geometry, so
//! that parts are known before their triangles and memory holds positions only (24 bytes a vertex,
//! and 12 where vertices have colours).
//!
//! - Each `o` and each `g` within it is a part. If faces of one use several materials, it has a child
//!   for each. A file without either is one part, named after the file. `o` ends the group before it.
//! - Polygons are fanned from their first corner. Indices count from 1, or back from -1.
//! - `v x y z w`: the weight is for curves and ignored. `v x y z r g b`: sRGB-coded colours, averaged
//!   over each triangle in linear light.
//! - Everything else is ignored; what carries shape (points, lines, curves, subdivision tags) is noted.

mod geometry;
mod lines;
mod mtl;
mod parts;
mod survey;

#[cfg(test)]
mod tests;

use super::Sink;
use super::input::Input;
use crate::base::error::Result;

/// Reads an OBJ file from its beginning.
pub(crate) fn read(input: &mut Input, sink: &mut dyn Sink) -> Result<()> {
    let survey = survey::read(input, sink)?;
    let parts = parts::declare(input.path(), &survey, sink)?;
    input.seek(0, 0)?;
    geometry::read(input, &parts, sink)
}
