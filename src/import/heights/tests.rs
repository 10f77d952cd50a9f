//! Heights from pictures, and their faults.

use super::{HeightOptions, decode};
use crate::base::progress::Cancel;
use crate::geom::surface::displacement::{Heights, Wrap};
use ::exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, Text, Vec2, WritableImage,
    f16,
};
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

/// An OpenEXR picture of a layer with these channels.
fn exr(size: [usize; 2], encoding: Encoding, channels: &[(&str, FlatSamples)]) -> Vec<u8> {
    let channel = |(name, samples): &(&str, FlatSamples)| AnyChannel::new(Text::from(*name), samples.clone());
    let all: SmallVec<[_; 4]> = channels.iter().map(channel).collect();
    let layer = Layer::new(Vec2(size[0], size[1]), LayerAttributes::default(), encoding, AnyChannels::sort(all));
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).expect("a picture");
    bytes.into_inner()
}

fn noise(count: usize) -> Vec<f32> {
    (0..count).map(|i| (i * i % 257) as f32 * 0.25 - 8.0).collect()
}

#[test]
fn open_exr_of_any_channel_and_layout_is_read() {
    let (size, values) = ([70, 50], noise(3500));
    let options = HeightOptions { scale: 1.0, middle: 0.0, ..CLAMPED };
    let expected = Heights::new([70, 50], 1, options.wrap, values.clone()).expect("heights");
    let half = FlatSamples::F16(values.iter().map(|&v| f16::from_f32(v)).collect());
    let (float, zeros) = (FlatSamples::F32(values.clone()), FlatSamples::F32(vec![0.0; 3500]));
    let pictures = [
        exr(size, Encoding::FAST_LOSSLESS, &[("Y", float.clone())]),
        exr(size, Encoding::SMALL_LOSSLESS, &[("A", zeros.clone()), ("height.Z", half.clone())]),
        exr(size, Encoding::UNCOMPRESSED, &[("B", zeros.clone()), ("G", zeros), ("R", half)]),
    ];
    for bytes in &pictures {
        assert_eq!(read(bytes, &options).expect("heights"), expected);
    }
    let whole = FlatSamples::U32(values.iter().map(|v| (v * 4.0 + 32.0) as u32).collect());
    let scaled = HeightOptions { scale: 0.25, middle: 32.0, ..CLAMPED };
    assert_eq!(read(&exr(size, Encoding::FAST_LOSSLESS, &[("Y", whole)]), &scaled).expect("heights"), expected);
}

#[test]
fn bad_open_exr_is_an_error() {
    let mut values = noise(3500);
    values[71] = f32::NAN;
    let why = read(&exr([70, 50], Encoding::UNCOMPRESSED, &[("Y", FlatSamples::F32(values))]), &CLAMPED);
    assert!(why.expect_err("NaN").contains("map.png: the height of texel (1, 1) is not finite"));
    let alpha = exr([2, 2], Encoding::UNCOMPRESSED, &[("A", FlatSamples::F32(vec![1.0; 4]))]);
    assert!(read(&alpha, &CLAMPED).expect_err("no heights").contains("no layer with a channel of heights"));
    let good = exr([70, 50], Encoding::SMALL_LOSSLESS, &[("Y", FlatSamples::F32(noise(3500)))]);
    (0..good.len() - 1).step_by(7).for_each(|end| assert!(read(&good[..end], &CLAMPED).is_err(), "{end}"));
    // Damage is refused, or changes values; it does not panic.
    for at in 0..good.len() {
        for bits in [0x01, 0x80, 0xff] {
            let mut damaged = good.clone();
            damaged[at] ^= bits;
            let _ = read(&damaged, &CLAMPED);
        }
    }
}

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
    for (bytes, expected) in [(&b"GIF"[..], "neither PNG nor OpenEXR"), (&good[..good.len() / 2], "cannot be")] {
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
