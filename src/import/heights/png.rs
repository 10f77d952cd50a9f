//! PNG maps, row by row.

use super::Map;
use crate::base::progress::Cancel;
use crate::import::decode::{ADAM7, cannot_decode, cannot_read};
use crate::import::input::Parsed;
use png::{BitDepth, Transformations};
use std::io::Cursor;

/// Decodes the first channel: 255 or 65535 becomes 1.
pub(super) fn decode(bytes: &[u8], cancel: &Cancel) -> Parsed<Map> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(cannot_read)?;
    let (width, height, is_interlaced) = (header.width, header.height, header.interlaced);
    let mut map = Map::new(width, height)?;
    let mut reader = decoder.read_info().map_err(cannot_read)?;
    let (colour, depth) = reader.output_color_type();
    for (x, y, dx, dy) in if is_interlaced { &ADAM7[..] } else { &[(0, 0, 1, 1)] } {
        for y in (*y..height).step_by(*dy).filter(|_| *x < width) {
            cancel.check()?;
            let row = reader.next_interlaced_row().map_err(cannot_decode)?;
            let row = row.ok_or("a picture cannot be decoded: it lacks rows")?;
            let out = map.row(y)[*x as usize..].iter_mut().step_by(*dx as usize);
            if depth == BitDepth::Sixteen {
                let pixels = row.data().as_chunks::<2>().0.chunks_exact(colour.samples());
                out.zip(pixels).for_each(|(to, p)| *to = f32::from(u16::from_be_bytes(p[0])) / 65535.0);
            } else {
                let pixels = row.data().chunks_exact(colour.samples());
                out.zip(pixels).for_each(|(to, p)| *to = f32::from(p[0]) / 255.0);
            }
        }
    }
    Ok(map)
}
