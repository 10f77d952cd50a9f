//! The rows of a PNG picture, as they are decoded.

use super::decode::{cannot_decode, cannot_read};
use super::input::Parsed;
use crate::base::progress::Cancel;
use png::{BitDepth, ColorType, Transformations};
use std::io::Cursor;

/// First column, first row, and distances of columns and of rows of the seven passes of an interlaced PNG.
pub(super) const ADAM7: [(u32, u32, u32, usize); 7] =
    [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)];

/// A row of a picture, or of a pass of an interlaced one.
pub(crate) struct Row<'a> {
    pub y: u32,
    /// Column of the first pixel, and the distance to the next.
    pub place: (u32, u32),
    pub data: &'a [u8],
    pub colour: ColorType,
    pub depth: BitDepth,
}

/// Decodes a picture. `begin` receives its width and height before memory is taken for its rows, and makes the value
/// that `each` adds rows to. Palettes and fewer than 8 bits are expanded.
pub(crate) fn png_rows<T>(
    bytes: &[u8],
    cancel: &Cancel,
    begin: impl FnOnce(u32, u32) -> Parsed<T>,
    mut each: impl FnMut(&mut T, Row<'_>),
) -> Parsed<T> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(cannot_read)?;
    let (width, height, is_interlaced) = (header.width, header.height, header.interlaced);
    let mut all = begin(width, height)?;
    let mut reader = decoder.read_info().map_err(cannot_read)?;
    let (colour, depth) = reader.output_color_type();
    for (x, y, dx, dy) in if is_interlaced { &ADAM7[..] } else { &[(0, 0, 1, 1)] } {
        for y in (*y..height).step_by(*dy).filter(|_| *x < width) {
            cancel.check()?;
            let row = reader.next_interlaced_row().map_err(cannot_decode)?;
            let row = row.ok_or("a picture cannot be decoded: it lacks rows")?;
            each(&mut all, Row { y, place: (*x, *dx), data: row.data(), colour, depth });
        }
    }
    Ok(all)
}
