//! Heights from pictures, and their faults.

use super::{HeightOptions, decode};
use crate::base::progress::Cancel;
use crate::geom::surface::displacement::{Heights, Wrap};
use std::path::Path;

fn png(width: u32, height: u32, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.write_header().and_then(|mut w| w.write_image_data(data)).expect("a picture");
    bytes
}

fn read(bytes: &[u8], options: &HeightOptions) -> Result<Heights, String> {
    decode(bytes, Path::new("map.png"), options, &Cancel::new()).map_err(|e| e.to_string())
}

/// The height in the corner s = t = 0, where the border texel alone counts.
fn corner(heights: &Heights) -> f64 {
    heights.sample(0, 0.0, 0.0).value
}

const CLAMPED: HeightOptions = HeightOptions { scale: 2.0, middle: 0.5, flip: false, wrap: [Wrap::Clamp; 2] };

#[test]
fn pictures_of_8_and_16_bits_are_read_with_their_meaning() {
    use png::{BitDepth, ColorType};
    let grey = png(2, 2, ColorType::Grayscale, BitDepth::Eight, &[255, 0, 0, 51]);
    let red = png(2, 2, ColorType::Rgb, BitDepth::Eight, &[255, 9, 9, 0, 9, 9, 0, 9, 9, 51, 9, 9]);
    let deep = png(
        2,
        2,
        ColorType::GrayscaleAlpha,
        BitDepth::Sixteen,
        &[255, 255, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 51, 51, 1, 1],
    );
    for bytes in [grey, red, deep] {
        let heights = read(&bytes, &CLAMPED).expect("heights");
        assert_eq!((heights.size(), heights.count(), corner(&heights)), ([2, 2], 1, 1.0));
        assert_eq!(heights.sample(0, 1.0, 1.0).value, f64::from(2.0 * (51.0f32 / 255.0 - 0.5)));
        let flipped = read(&bytes, &HeightOptions { flip: true, ..CLAMPED }).expect("heights");
        assert_eq!((corner(&flipped), flipped.sample(0, 0.0, 1.0).value), (-1.0, 1.0));
    }
    // The least step of 16 bits is not lost.
    let steps = png(2, 1, ColorType::Grayscale, BitDepth::Sixteen, &[128, 0, 128, 1]);
    let heights = read(&steps, &HeightOptions { middle: 0.0, scale: 65535.0, ..CLAMPED }).expect("heights");
    assert_eq!((corner(&heights), heights.sample(0, 1.0, 0.0).value), (32768.0, 32769.0));
}

#[test]
fn faults_of_maps_name_the_file() {
    let good = png(2, 2, png::ColorType::Grayscale, png::BitDepth::Eight, &[0; 4]);
    for (bytes, expected) in [(&b"GIF"[..], "no PNG"), (&good[..good.len() / 2], "cannot be")] {
        let why = read(bytes, &CLAMPED).expect_err("a fault");
        assert!(why.contains("map.png") && why.contains(expected), "{why}");
    }
    let mut large = good.clone();
    large[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    let why = read(&large, &CLAMPED).expect_err("too large");
    assert!(why.contains("map.png"), "{why}");
    let why = read(&good, &HeightOptions { scale: f32::NAN, ..CLAMPED }).expect_err("NaN");
    assert!(why.contains("scale"), "{why}");
    let why = read(&good, &HeightOptions { scale: f32::MAX, middle: 2.0, ..CLAMPED }).expect_err("infinite");
    assert!(why.contains("texel (0, 0) is not finite"), "{why}");
}

#[test]
fn a_beginning_of_a_picture_is_refused_or_has_all_pixels() {
    let data: Vec<u8> = (0..64 * 64).map(|i| (i * i % 251) as u8).collect();
    let good = png(64, 64, png::ColorType::Grayscale, png::BitDepth::Eight, &data);
    let whole = read(&good, &CLAMPED).expect("heights");
    let read = (0..good.len()).filter_map(|end| read(&good[..end], &CLAMPED).ok());
    // Only checksums and the end mark may lack.
    let count = read.map(|heights| assert_eq!(heights, whole)).count();
    assert!(count < 40, "{count}");
}
