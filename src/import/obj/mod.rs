//! Wavefront OBJ: polygons in objects and groups, with materials from library files.
//!
//! This crate has its own reader because available crates load whole files, keep neither the hierarchy of objects and
//! groups nor the line of an error, and store unneeded texture coordinates and normals.
//!
//! The file is read twice: first for its objects, groups and materials, then for its geometry. Parts are therefore
//! known before their triangles, and memory holds only positions (24 bytes per vertex, and 12 more if vertices have
//! colours), with textures also texture coordinates (8 bytes each) and decoded pictures.
//!
//! - Each `o`, and each `g` within it, is a part. If faces of a group use several materials, its part has a child for
//!   each. A file without objects and groups is one part with the name of the file. `o` ends the group before it.
//! - Polygons become fans around their first corner. Indices count from 1, or backwards from -1.
//! - `v x y z w`: the weight is for curves and ignored. `v x y z r g b`: sRGB-coded colours, averaged over each
//!   triangle in linear light.
//! - Names are bytes. Their coding is unknown; two names are the same if their bytes are.
//! - A texture `map_Kd` gives each triangle its mean colour ([`super::texture`]); vertex colours do not count there.
//! - `#` begins a comment behind numbers. In a name it may be a letter: a material is looked for under its whole name
//!   first, then under the name before the comment; names of objects and groups are kept whole.
//! - With [`super::ReadOptions::subdivide`] the faces are the cage of a subdivision surface, and `t` lines are its
//!   tags; colours of vertices and textures do not count.
//! - All other lines are ignored. Those that carry geometry (points, lines, curves, subdivision tags) are noted.

mod beside;
mod cage;
mod geometry;
mod lines;
mod mtl;
mod parts;
mod survey;
mod tags;
mod textures;

#[cfg(test)]
mod material_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod text_tests;

use super::Sink;
use super::access::Files;
use super::input::Input;
use crate::base::error::Result;

/// Reads an OBJ file from its beginning.
pub(crate) fn read(input: &mut Input, files: &Files<'_>, sink: &mut dyn Sink) -> Result<()> {
    let survey = survey::read(input, files.options.account.claim(), sink)?;
    let mut parts = parts::declare(input.path(), files, &survey, sink)?;
    drop(survey);
    input.seek(0, 0)?;
    geometry::read(input, &mut parts, files.options, sink)
}
