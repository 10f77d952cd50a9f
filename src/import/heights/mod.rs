//! Maps of heights from pictures: PNG of 8 and 16 bits, and OpenEXR.

mod exr;
mod png;
#[cfg(test)]
mod tests;

use super::input::{Fault, Parsed};
use crate::base::error::{Error, Place, Result};
use crate::base::memory;
use crate::base::progress::Cancel;
use crate::geom::surface::displacement::{Heights, Wrap};
use std::path::Path;

/// Greatest number of pixels of a map: 16384².
const MAX_PIXELS: u64 = 1 << 28;

/// The meaning of a map's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightOptions {
    /// Height of a value of 1 over `middle`, in the surface's unit of length.
    pub scale: f32,
    /// The value that displaces nothing.
    pub middle: f32,
    /// True if the last row of the picture is at t = 0, as in OBJ files; else the first one is, as in glTF.
    pub flip: bool,
    /// The texels beyond the border, along s and t.
    pub wrap: [Wrap; 2],
}

impl Default for HeightOptions {
    /// Heights as they are in the picture, whose last row is at t = 0, repeated.
    fn default() -> Self {
        Self { scale: 1.0, middle: 0.0, flip: true, wrap: [Wrap::Repeat; 2] }
    }
}

/// Decodes a map from the bytes of a picture. Of a PNG the first channel counts, grey or red, and values are in
/// `[0, 1]`, without regard to gamma. Of an OpenEXR picture the channel Y counts, or R, or else the first but A.
///
/// Fails with [`Error::Parse`] for `file` if the picture cannot be decoded, is larger than 2²⁸ pixels, or has a value
/// that is not finite, which the error names by its column and row from the top; with [`Error::BadArgument`] if `scale`
/// or `middle` is not finite; with `Cancelled` and `NoMemory`.
pub fn decode(bytes: &[u8], file: &Path, options: &HeightOptions, cancel: &Cancel) -> Result<Heights> {
    if !options.scale.is_finite() || !options.middle.is_finite() {
        return Err(Error::bad_argument("displacement: scale or middle is not finite"));
    }
    let map = match bytes {
        [0x89, b'P', b'N', b'G', ..] => png::decode(bytes, cancel),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::decode(bytes, cancel),
        _ => Err("a map of heights is neither PNG nor OpenEXR".into()),
    };
    map.and_then(|map| map.heights(options)).map_err(|fault| fault.at(file, Place::File))
}

/// The first channel of a picture, rows from the top.
struct Map {
    width: u32,
    height: u32,
    values: Vec<f32>,
}

impl Map {
    /// A map of zeros, in memory that is not yet touched.
    fn new(width: u32, height: u32) -> Parsed<Self> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels > MAX_PIXELS {
            return Err(format!("a map of {width} × {height} pixels is empty or too large").into());
        }
        Ok(Self { width, height, values: memory::zeroed(pixels as usize, "a displacement")? })
    }

    fn row(&mut self, y: u32) -> &mut [f32] {
        let width = self.width as usize;
        &mut self.values[y as usize * width..][..width]
    }

    fn heights(mut self, options: &HeightOptions) -> Parsed<Heights> {
        let width = self.width as usize;
        for (at, value) in self.values.iter_mut().enumerate() {
            *value = options.scale * (*value - options.middle);
            if !value.is_finite() {
                return Err(format!("the height of texel ({}, {}) is not finite", at % width, at / width).into());
            }
        }
        if options.flip {
            for y in 0..self.height as usize / 2 {
                let (above, below) = self.values.split_at_mut((self.height as usize - 1 - y) * width);
                above[y * width..][..width].swap_with_slice(&mut below[..width]);
            }
        }
        Heights::new([self.width, self.height], 1, options.wrap, self.values).map_err(Fault::Failed)
    }
}
