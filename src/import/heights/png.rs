//! PNG maps, row by row.

use super::Map;
use crate::base::progress::Cancel;
use crate::import::input::Parsed;
use crate::import::png_rows::png_rows;
use png::BitDepth;

/// Decodes the first channel: 255 or 65535 becomes 1.
pub(super) fn decode(bytes: &[u8], cancel: &Cancel) -> Parsed<Map> {
    png_rows(bytes, cancel, Map::new, |map, row| {
        let (x, dx) = row.place;
        let out = map.row(row.y)[x as usize..].iter_mut().step_by(dx as usize);
        let samples = row.colour.samples();
        if row.depth == BitDepth::Sixteen {
            let pixels = row.data.as_chunks::<2>().0.chunks_exact(samples);
            out.zip(pixels).for_each(|(to, p)| *to = f32::from(u16::from_be_bytes(p[0])) / 65535.0);
        } else {
            out.zip(row.data.chunks_exact(samples)).for_each(|(to, p)| *to = f32::from(p[0]) / 255.0);
        }
    })
}
