use super::*;
use crate::base::error::Error;
use crate::import::picture::Reducer;
use crate::import::png_rows::ADAM7;
use crate::import::texture::{Alpha, Texture};
use image::{ExtendedColorType, ImageFormat};

fn decode(bytes: &[u8], limit: u64) -> Parsed<Picture> {
    Decoding { limit, flip: false, pixels: &Cell::new(u64::MAX), cancel: &Cancel::new() }.decode(bytes)
}

fn why(outcome: Parsed<Picture>) -> String {
    match outcome {
        Err(Fault::Why(why)) => why,
        Err(Fault::Failed(error)) => error.to_string(),
        Ok(picture) => panic!("{} × {} texels were decoded", picture.width, picture.height),
    }
}

/// Bytes without order.
fn noise(count: usize) -> Vec<u8> {
    let mut seed = 1u32;
    let next = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 24) as u8
    };
    std::iter::repeat_with(next).take(count).collect()
}

/// A PNG of this type, with random samples.
fn png_of(width: u32, height: u32, colour: ColorType, depth: BitDepth) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == ColorType::Indexed {
        encoder.set_palette(noise(3 << depth as usize));
        encoder.set_trns(noise(1 << (depth as usize - 1)));
    }
    let samples = colour.samples() * width as usize * depth as usize;
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&noise(samples.div_ceil(8) * height as usize)).expect("an image");
    writer.finish().expect("a PNG");
    out
}

/// An interlaced PNG of eight-bit RGBA, compressed by nothing.
fn interlaced(width: u32, height: u32, rgba: &[u8]) -> Vec<u8> {
    let mut rows = Vec::new();
    for (x, y, dx, dy) in ADAM7 {
        for y in (y..height).step_by(dy).filter(|_| x < width) {
            rows.push(0);
            let row = (x..width).step_by(dx as usize);
            rows.extend(row.flat_map(|x| rgba[4 * (y * width + x) as usize..][..4].to_vec()));
        }
    }
    let (mut low, mut high) = (1u32, 0u32);
    for &byte in &rows {
        low = (low + u32::from(byte)) % 65521;
        high = (high + low) % 65521;
    }
    let len = (rows.len() as u16).to_le_bytes();
    let zlib = [&[0x78, 1, 1][..], &len, &len.map(|b| !b), &rows, &(high << 16 | low).to_be_bytes()].concat();
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let typed = [&kind[..], data].concat();
        let crc = typed.iter().fold(!0u32, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 * (crc & 1)))
        });
        [&(data.len() as u32).to_be_bytes()[..], &typed, &(!crc).to_be_bytes()].concat()
    };
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, 6, 0, 0, 1]].concat();
    [&b"\x89PNG\r\n\x1a\n"[..], &chunk(b"IHDR", &header), &chunk(b"IDAT", &zlib), &chunk(b"IEND", b"")].concat()
}

/// The picture as the library for images decodes it, which has the whole in memory.
fn expected(bytes: &[u8], flip: bool) -> Picture {
    let mut whole = image::load_from_memory(bytes).expect("a picture").into_rgba8();
    if flip {
        image::imageops::flip_vertical_in_place(&mut whole);
    }
    let (width, height) = whole.dimensions();
    let mut reducer = Reducer::new(width, height, false).expect("memory");
    for (y, row) in whole.rows().enumerate() {
        reducer.row(y as u32, (0, 1), row.map(|pixel| pixel.0));
    }
    reducer.finish()
}

fn assert_same(found: &Picture, expected: &Picture, what: &str) {
    assert_eq!(
        (found.width, found.height, &found.alphas),
        (expected.width, expected.height, &expected.alphas),
        "{what}"
    );
    assert_eq!(found.mean_coded, expected.mean_coded, "{what}");
    let close = |a: &f32, b: &f32| (a - b).abs() < 1e-5;
    let all = |picture: &Picture| {
        let plain = picture.plain.iter().flatten();
        picture.weighted.iter().flatten().chain(plain).copied().collect::<Vec<f32>>()
    };
    let (found, expected) = (all(found), all(expected));
    assert!(found.len() == expected.len() && found.iter().zip(&expected).all(|(a, b)| close(a, b)), "{what}");
}

#[test]
fn every_kind_of_png_is_read_row_by_row_as_a_whole() {
    use BitDepth::{Eight, Four, One, Sixteen, Two};
    use ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
    let kinds = [(Grayscale, One), (Grayscale, Two), (Grayscale, Eight), (Grayscale, Sixteen), (Indexed, Two)];
    let more = [(Indexed, Four), (Indexed, Eight), (GrayscaleAlpha, Eight), (GrayscaleAlpha, Sixteen)];
    let rest = [(Rgb, Eight), (Rgb, Sixteen), (Rgba, Eight), (Rgba, Sixteen)];
    for (colour, depth) in kinds.into_iter().chain(more).chain(rest) {
        for (width, height) in [(1, 1), (13, 7), (2500, 3)] {
            let bytes = png_of(width, height, colour, depth);
            for flip in [false, true] {
                let found = Decoding { limit: u64::MAX, flip, pixels: &Cell::new(u64::MAX), cancel: &Cancel::new() }
                    .decode(&bytes)
                    .ok();
                let what = format!("{colour:?} {depth:?} {width} × {height}");
                assert_same(&found.expect(&what), &expected(&bytes, flip), &what);
            }
        }
    }
    for (width, height) in [(1, 1), (3, 2), (13, 9), (64, 33)] {
        let bytes = interlaced(width, height, &noise((4 * width * height) as usize));
        assert_same(&decode(&bytes, u64::MAX).ok().expect("a picture"), &expected(&bytes, false), "interlaced");
    }
}

#[test]
fn jpeg_pictures_are_read() {
    for (colour, channels) in [(ExtendedColorType::L8, 1), (ExtendedColorType::Rgb8, 3)] {
        let mut out = Cursor::new(Vec::new());
        image::write_buffer_with_format(&mut out, &noise(1500 * 20 * channels), 1500, 20, colour, ImageFormat::Jpeg)
            .expect("a picture");
        let bytes = out.into_inner();
        assert_same(&decode(&bytes, u64::MAX).ok().expect("a picture"), &expected(&bytes, false), "JPEG");
        assert!(!is_progressive(&bytes));
        let limit = (1500 * 20 * channels) as u64;
        assert!(decode(&bytes, limit).is_ok());
        let why = why(decode(&bytes, limit - 1));
        assert!(
            why.contains(&format!("takes {limit} bytes")) && why.ends_with(&format!("leaves {}", limit - 1)),
            "{why}"
        );
    }
}

/// The frame header of a JPEG of this kind, behind other segments.
fn jpeg_header(kind: u8, width: u16, height: u16) -> Vec<u8> {
    let ([w, x], [h, y]) = (width.to_be_bytes(), height.to_be_bytes());
    let frame = [0xff, kind, 0, 17, 8, h, y, w, x, 3, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0];
    [&[0xff, 0xd8, 0xff, 0xe0, 0, 4, 0xff, 0xc2, 0xff, 0xff, 0xfe, 0, 2][..], &frame].concat()
}

#[test]
fn sizes_that_a_header_claims_are_refused_before_memory_is_taken() {
    assert!(
        is_progressive(&jpeg_header(0xc2, 10, 10))
            && !is_progressive(&[jpeg_header(0xc0, 9, 9), vec![0xff, 0xda]].concat())
    );
    let huge = |mut bytes: Vec<u8>, width: u32| {
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes
    };
    let small = png_of(1, 1, ColorType::Rgba, BitDepth::Eight);
    // The checksum of the header is checked first, or the size: either way nothing is decoded.
    for width in [60_000_000, u32::MAX >> 1] {
        let why = why(decode(&huge(small.clone(), width), u64::MAX));
        assert!(why.contains("picture"), "{why}");
    }
    let wide = png_of(MAX_WIDTH + 1, 1, ColorType::Grayscale, BitDepth::One);
    assert!(why(decode(&wide, u64::MAX)).contains("too large"));
    let fine = png_of(100_000, 2, ColorType::Rgba, BitDepth::Eight);
    assert!(decode(&fine, 4 << 20).is_ok());
    assert!(why(decode(&fine, 1 << 20)).contains("100000 × 2 pixels takes 2662144 bytes to decode"));
}

#[test]
fn a_cancelled_decoding_ends() {
    let cancel = Cancel::new();
    let mut source = Stoppable { bytes: Cursor::new(&[1, 2, 3]), cancel: &cancel };
    let mut one = [0];
    assert_eq!((source.read(&mut one).unwrap(), one, source.fill_buf().unwrap()), (1, [1], &[2, 3][..]));
    cancel.cancel();
    assert_eq!((source.read(&mut one).unwrap(), source.fill_buf().unwrap()), (0, &[][..]));
    let bytes = png_of(13, 7, ColorType::Rgb, BitDepth::Eight);
    let outcome =
        Decoding { limit: u64::MAX, flip: false, pixels: &Cell::new(u64::MAX), cancel: &cancel }.decode(&bytes);
    assert!(matches!(outcome, Err(Fault::Failed(Error::Cancelled))));
}

/// One picture for every use of its alpha channel.
#[test]
fn uses_of_alpha_are_made_from_one_picture() {
    let alphas = [0u8, 76, 77, 200, 255];
    let mut reducer = Reducer::new(5, 1, false).expect("memory");
    reducer.row(0, (0, 1), alphas.into_iter().map(|a| [255, 0, 255, a]));
    let picture = reducer.finish();
    let weights: f64 = alphas.iter().map(|&a| f64::from(a)).sum();
    let squares: f64 = alphas.iter().map(|&a| f64::from(a).powi(2)).sum();
    for (alpha, opacity) in [
        (Alpha::Ignored, 1.0),
        (Alpha::Opacity, (squares / (255.0 * weights)) as f32),
        (Alpha::cut(0.3), 1.0),
        (Alpha::cut(1.0), 1.0),
        (Alpha::cut(1.01), 0.0),
        (Alpha::cut(f32::NAN), 0.0),
    ] {
        assert_eq!(Texture::of(&picture, alpha).unwrap().opacity(), opacity, "{alpha:?}");
    }
    // 76 / 255 is below 0.3, 77 / 255 is not.
    assert_eq!((Alpha::cut(0.3), Alpha::cut(0.0), Alpha::cut(1.0)), (Alpha::Cut(77), Alpha::Cut(0), Alpha::Cut(255)));
    assert_eq!(Texture::of(&picture, Alpha::cut(0.3)).unwrap().mean_of_all(), Some([1.0, 0.0, 1.0]));
    assert_eq!(Texture::of(&picture, Alpha::cut(2.0)).unwrap().mean_of_all(), None);
}
