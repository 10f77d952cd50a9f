//! Decoding of PNG and JPEG pictures, in the memory that the build leaves for it and with cancellation.
//!
//! A PNG is decoded row by row. A JPEG is decoded as a whole: a baseline one can be stopped at any row; a progressive
//! one cannot be stopped during its last step, and is therefore limited in size.

use super::input::{Fault, Parsed};
use super::picture::{Picture, Reducer};
use super::png_rows::{Row, png_rows};
use crate::base::memory;
use crate::base::progress::Cancel;
use png::{BitDepth, ColorType};
use std::cell::Cell;
use std::io::{self, BufRead, Cursor, Read, Seek, SeekFrom};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Largest picture that is decoded, in pixels.
const MAX_PIXELS: u64 = 1 << 26;
/// Largest progressive JPEG that is decoded, in pixels.
const MAX_PROGRESSIVE: u64 = 1 << 24;
/// Longest row that is decoded, in pixels.
const MAX_WIDTH: u32 = 1 << 20;

/// Conditions of decoding.
pub(crate) struct Decoding<'a> {
    /// Limit in bytes of the memory that is taken besides the reduced picture.
    pub(crate) limit: u64,
    /// True if the first row of the picture is the last row of texels.
    pub(crate) flip: bool,
    /// Number of pixels that may still be decoded.
    pub(crate) pixels: &'a Cell<u64>,
    pub(crate) cancel: &'a Cancel,
}

impl Decoding<'_> {
    /// Decodes a picture. Fails with a reason if it is invalid, too large or of another format, with `Cancelled`, or
    /// with `NoMemory`.
    pub(crate) fn decode(&self, bytes: &[u8]) -> Parsed<Picture> {
        self.cancel.check()?;
        #[cfg(test)]
        DECODED.set(DECODED.get() + 1);
        match bytes {
            [0x89, b'P', b'N', b'G', ..] => self.png(bytes),
            [0xff, 0xd8, 0xff, ..] => self.jpeg(bytes),
            _ => Err("a picture cannot be read: it is neither PNG nor JPEG".into()),
        }
    }

    /// Fails if a picture of this size, which takes `working` bytes to decode, is not decoded.
    fn admit(&self, width: u32, height: u32, most: u64, working: u64) -> Parsed<()> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels > most || width > MAX_WIDTH {
            return Err(format!("a picture of {width} × {height} pixels is empty or too large").into());
        }
        if pixels > self.pixels.get() {
            let why = "the pictures of the mesh file have too many pixels for their number of bytes";
            return Err(format!("a picture of {width} × {height} pixels is left out: {why}").into());
        }
        if working > self.limit {
            return Err(format!(
                "a picture of {width} × {height} pixels takes {working} bytes to decode, and the memory budget leaves {}",
                self.limit
            )
            .into());
        }
        self.pixels.set(self.pixels.get() - pixels);
        Ok(())
    }

    fn png(&self, bytes: &[u8]) -> Parsed<Picture> {
        let begin = |width: u32, height: u32| {
            // The present row and the one before, each of at most four channels of 16 bits, and the window of the
            // decompressor.
            self.admit(width, height, MAX_PIXELS, 3 * 8 * u64::from(width) + (256 << 10))?;
            Ok(Reducer::new(width, height, self.flip)?)
        };
        let reducer = png_rows(bytes, self.cancel, begin, |reducer, row| {
            let Row { y, place, data, colour, depth } = row;
            match colour {
                ColorType::Grayscale => add::<1>(reducer, y, place, data, depth),
                ColorType::GrayscaleAlpha => add::<2>(reducer, y, place, data, depth),
                ColorType::Rgb | ColorType::Indexed => add::<3>(reducer, y, place, data, depth),
                ColorType::Rgba => add::<4>(reducer, y, place, data, depth),
            }
        })?;
        Ok(reducer.finish())
    }

    fn jpeg(&self, bytes: &[u8]) -> Parsed<Picture> {
        let options =
            DecoderOptions::default().set_strict_mode(false).set_max_width(usize::MAX).set_max_height(usize::MAX);
        let source = Stoppable { bytes: Cursor::new(bytes), cancel: self.cancel };
        let mut decoder = JpegDecoder::new_with_options(source, options);
        decoder.decode_headers().map_err(cannot_read)?;
        let (width, height) = decoder.dimensions().ok_or("a picture cannot be read: it has no size")?;
        let (width, height) = (width as u32, height as u32);
        let is_grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
        let channels = if is_grey { 1 } else { 3 };
        let pixels = u64::from(width) * u64::from(height);
        // A progressive picture is kept as coefficients, in two bytes each, until its end.
        let (most, each) = if is_progressive(bytes) { (MAX_PROGRESSIVE, 3 * channels) } else { (MAX_PIXELS, channels) };
        self.admit(width, height, most, each * pixels)?;
        let out = if is_grey { ColorSpace::Luma } else { ColorSpace::RGB };
        decoder.set_options(options.jpeg_set_out_colorspace(out));
        let mut decoded = memory::zeroed::<u8>((channels * pixels) as usize, "a texture")?;
        let outcome = decoder.decode_into(&mut decoded);
        self.cancel.check()?;
        outcome.map_err(cannot_decode)?;
        drop(decoder);
        let mut reducer = Reducer::new(width, height, self.flip)?;
        for (y, row) in decoded.chunks_exact((channels * u64::from(width)) as usize).enumerate() {
            self.cancel.check()?;
            match is_grey {
                true => add::<1>(&mut reducer, y as u32, (0, 1), row, BitDepth::Eight),
                false => add::<3>(&mut reducer, y as u32, (0, 1), row, BitDepth::Eight),
            }
        }
        Ok(reducer.finish())
    }
}

pub(super) fn cannot_read(e: impl std::fmt::Display) -> Fault {
    Fault::Why(format!("a picture cannot be read: {e}"))
}

pub(super) fn cannot_decode(e: impl std::fmt::Display) -> Fault {
    Fault::Why(format!("a picture cannot be decoded: {e}"))
}

/// Adds the pixels of a row, which have `N` channels of one or two bytes.
fn add<const N: usize>(reducer: &mut Reducer, y: u32, place: (u32, u32), data: &[u8], depth: BitDepth) {
    let rgba = |c: [u8; N]| match N {
        1 => [c[0], c[0], c[0], 255],
        2 => [c[0], c[0], c[0], c[1]],
        3 => [c[0], c[1], c[2], 255],
        _ => [c[0], c[1], c[2], c[3]],
    };
    if depth != BitDepth::Sixteen {
        return reducer.row(y, place, data.as_chunks::<N>().0.iter().map(|c| rgba(*c)));
    }
    let narrow = |pair: &[u8; 2]| ((u32::from(u16::from_be_bytes(*pair)) + 128) / 257) as u8;
    let pairs = data.as_chunks::<2>().0.chunks_exact(N);
    reducer.row(y, place, pairs.map(|pairs| rgba(std::array::from_fn(|i| narrow(&pairs[i])))));
}

/// True if a JPEG is progressive, as its frame header says.
fn is_progressive(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    // Segments before the first scan: a marker, a length that counts itself, and that many bytes.
    while let [0xff, marker, more @ ..] = rest {
        match (*marker, more) {
            (0xff, _) => rest = &rest[1..],
            (0xc2 | 0xc6 | 0xca | 0xce, _) => return true,
            (0xda, _) => return false,
            (0x01 | 0xd0..=0xd8, _) => rest = more,
            (_, [high, low, ..]) => {
                rest = more.get(usize::from(u16::from_be_bytes([*high, *low]))..).unwrap_or_default();
            }
            _ => return false,
        }
    }
    // A damaged header: the stricter limit.
    true
}

/// Bytes that end when the work is cancelled.
struct Stoppable<'a> {
    bytes: Cursor<&'a [u8]>,
    cancel: &'a Cancel,
}

impl Read for Stoppable<'_> {
    #[inline]
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.cancel.is_cancelled() { Ok(0) } else { self.bytes.read(out) }
    }
}

impl BufRead for Stoppable<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.cancel.is_cancelled() { Ok(&[]) } else { self.bytes.fill_buf() }
    }
    fn consume(&mut self, n: usize) {
        self.bytes.consume(n);
    }
}

impl Seek for Stoppable<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.bytes.seek(to)
    }
}

#[cfg(test)]
thread_local! {
    /// Number of pictures that this thread has decoded.
    pub(crate) static DECODED: std::cell::Cell<usize> = const { std::cell::Cell::new(0) };
}

#[cfg(test)]
#[path = "decode_tests.rs"]
mod tests;
