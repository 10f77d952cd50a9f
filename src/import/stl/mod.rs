//! STL: text and binary, several solids, and both colour extensions of the binary form.
//!
//! Our own reader, because the crates at hand know neither colours nor several solids, trust the
//! header's count, and say neither line nor byte where a file is damaged.
//!
//! - Each `solid` of a text file is a part; a binary file is one part named after the file.
//! - Colours are in the 16 bits after each triangle, five a channel, taken to be sRGB-coded.
//!   VisCAM and SolidView: bit 15 set, red in bits 10 to 14. Materialise Magics (the header holds
//!   `COLOR=` and four bytes RGBA, which become the part's material): bit 15 *clear*, red in bits 0 to 4.
//! - Normals are ignored. The up axis is Z by habit; the file does not say its unit.

mod binary;
mod text_form;

#[cfg(test)]
mod tests;

pub(crate) use binary::read as read_binary;
pub(crate) use text_form::read as read_text;
