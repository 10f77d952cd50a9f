//! STL: text and binary, several solids, and both colour extensions of the binary form.
//!
//! This crate has its own reader because available crates support neither colours nor several solids, trust the
//! header's count, and report neither line nor byte of an error.
//!
//! - Each `solid` of a text file is a part. A binary file is one part with the name of the file.
//! - Colours are in the 16 bits after each triangle, with five bits per channel, taken as sRGB-coded. VisCAM and
//!   SolidView: bit 15 is set, red is in bits 10 to 14. Materialise Magics: bit 15 is *clear*, red is in bits 0 to 4;
//!   the header contains `COLOR=` and four bytes RGBA, which become the part's material.
//! - Normals are ignored. The up axis is Z by convention; the file does not state a unit.

mod binary;
mod text_form;

#[cfg(test)]
mod tests;

pub(crate) use binary::read as read_binary;
pub(crate) use text_form::read as read_text;
