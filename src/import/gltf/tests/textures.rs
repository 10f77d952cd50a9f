use super::*;
use crate::import::decode::DECODED;
use crate::import::gltf::texture::{Alpha, Mapping, Texture, Wrap};
use crate::import::picture::Reducer;
use glam::Vec2;

pub(super) fn png(width: u32, height: u32, rgba: &[u8]) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut out,
        rgba,
        width,
        height,
        image::ExtendedColorType::Rgba8,
        image::ImageFormat::Png,
    )
    .unwrap();
    out.into_inner()
}

/// Returns a mesh with a texture and two triangles: one in the left half of the picture, one in the right.
pub(super) fn textured(picture: &[u8]) -> Document {
    let mut document = Document::new(json!([{ "mesh": 0 }]), json!([0]));
    let positions = document.floats("VEC3", &[0.0; 18]);
    let uv = document.floats("VEC2", &[0.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 1.0, 0.0, 1.0, 1.0]);
    document.mesh(json!([{ "attributes": { "POSITION": positions, "TEXCOORD_0": uv }, "material": 0 }]));
    let view = document.view(picture);
    document.json["images"] = json!([{ "bufferView": view, "mimeType": "image/png" }]);
    document.json["textures"] = json!([{ "source": 0 }]);
    document.json["materials"] = json!([
        { "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "baseColorFactor": [1, 0.5, 1, 1] } }
    ]);
    document
}

fn colours(sink: &Collector) -> Vec<[f32; 3]> {
    sink.direct().iter().map(|t| t.colour().expect("a colour")).collect()
}

#[test]
fn textures_are_averaged_over_each_triangle() {
    // The texels are red, and blue with a little green.
    let picture = png(2, 1, &[255, 0, 0, 255, 0, 128, 255, 255]);
    let mut document = textured(&picture);
    let expect = |document: &Document, expected: [[f32; 3]; 2]| {
        for (found, expected) in colours(&document.read()).iter().zip(expected) {
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            }
        }
    };
    let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.215_860_5 * 0.5, 1.0]);
    expect(&document, [red, blue]);
    // An offset of half a picture swaps the colours.
    let info = "/materials/0/pbrMetallicRoughness/baseColorTexture";
    document.json.pointer_mut(info).unwrap()["extensions"] = json!({ "KHR_texture_transform": { "offset": [0.5, 0] } });
    expect(&document, [blue, red]);
    // With clamping the right texel stays.
    document.json["samplers"] = json!([{ "wrapS": 33071 }]);
    document.json["textures"][0]["sampler"] = json!(0);
    expect(&document, [blue, blue]);
    // Vertex colours multiply.
    let mut document = textured(&picture);
    let quarter = document.floats("VEC3", &[0.25; 18]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(quarter);
    expect(&document, [red, blue].map(|c| c.map(|c| c * 0.25)));
}

#[test]
fn pictures_that_cannot_be_read_are_noted() {
    for (picture, words) in [
        (b"not a picture".to_vec(), "cannot be read"),
        (png(2, 1, &[0; 8])[..40].to_vec(), "picture"),
        // A header that claims 60000 × 60000 pixels.
        (
            [&png(2, 1, &[0; 8])[..16], &[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60, 8, 6, 0, 0, 0, 0, 0, 0, 0]].concat(),
            "picture",
        ),
    ] {
        let sink = textured(&picture).read();
        assert_eq!(sink.direct()[0].colour(), None);
        assert!(sink.notes.len() == 1 && sink.notes[0].contains(words), "{:?}", sink.notes);
    }
    let mut document = textured(&png(1, 1, &[255; 4]));
    document.json["textures"] = json!([]);
    assert!(document.read().notes[0].contains("textures[0] does not exist"));
}

#[test]
fn large_triangles_take_the_mean_of_the_whole_picture() {
    // A triangle that repeats a picture of random texels 18 times has the picture's mean, regardless of the sample
    // points.
    let mut seed = 1u32;
    let rgba: Vec<u8> = std::iter::repeat_with(|| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 24) as u8
    })
    .take(64 * 64 * 4)
    .collect();
    let opaque: Vec<u8> = rgba.iter().enumerate().map(|(i, &b)| if i % 4 == 3 { 255 } else { b }).collect();
    let many = texture(64, &opaque);
    let mapping = mapping();
    let mean = |size: f32| many.mean([Vec2::ZERO, Vec2::new(size, 0.0), Vec2::new(0.0, size)], &mapping).unwrap();
    let texel = |p: &[u8]| crate::import::colour::linear_bytes([p[0], p[1], p[2]]);
    let linear = |c: usize| opaque.chunks(4).map(|p| texel(p)[c]).sum::<f32>() / (64.0 * 64.0);
    for c in 0..3 {
        assert!((mean(6.0)[c] - linear(c)).abs() < 0.005, "{} {}", mean(6.0)[c], linear(c));
    }
    // A tiny triangle takes one texel.
    assert!((0..3).all(|c| (mean(0.001)[c] - texel(&opaque)[c]).abs() < 1e-6));
    // Transparent texels add no colour, and a fully transparent area has none.
    let half = texture(2, &[200, 10, 10, 255, 0, 255, 0, 0]);
    let whole = half.mean([Vec2::ZERO, Vec2::new(2.0, 0.0), Vec2::new(0.0, 2.0)], &mapping).unwrap();
    assert!((whole[0] - texel(&[200, 0, 0])[0]).abs() < 1e-6, "{whole:?}");
    assert_eq!(texture(1, &[1, 2, 3, 0]).mean([Vec2::ZERO; 3], &mapping), None);
    assert!(half.mean([Vec2::NAN, Vec2::INFINITY, Vec2::splat(-1e30)], &mapping).is_some());
}

/// Many images, textures and materials, with every use of alpha, of one picture: in one buffer view, in views with the
/// same bytes, in one URI.
#[test]
fn a_picture_is_decoded_once() {
    let picture = png(2, 1, &[255, 0, 0, 255, 0, 128, 255, 100]);
    let mut document = textured(&picture);
    let view = document.json["images"][0]["bufferView"].clone();
    let same = document.json["bufferViews"][view.as_u64().unwrap() as usize].clone();
    let views = document.json["bufferViews"].as_array_mut().unwrap();
    views.push(same);
    let again = views.len() - 1;
    let images: Vec<Value> =
        (0..32).map(|i| json!({ "bufferView": if i % 2 == 0 { view.clone() } else { json!(again) } })).collect();
    let textures: Vec<Value> = (0..32).map(|i| json!({ "source": i })).collect();
    let material = |i: usize| {
        let (mode, cutoff) = (["OPAQUE", "MASK", "BLEND"][i % 3], i as f64 / 40.0);
        json!({
            "pbrMetallicRoughness": { "baseColorTexture": { "index": i }, "metallicRoughnessTexture": { "index": i } },
            "alphaMode": mode, "alphaCutoff": cutoff,
        })
    };
    let primitive = document.json["meshes"][0]["primitives"][0].clone();
    let with = |i: usize| {
        let mut primitive = primitive.clone();
        primitive["material"] = json!(i);
        primitive
    };
    document.json["meshes"][0]["primitives"] = (0..32).map(with).collect();
    (document.json["images"], document.json["textures"]) = (images.into(), textures.into());
    document.json["materials"] = (0..32).map(material).collect();
    let before = DECODED.get();
    let sink = document.read();
    assert_eq!((DECODED.get() - before, sink.received, sink.materials.len()), (1, 64, 32));
    assert!(sink.direct().iter().all(|t| t.colour().is_some()));
    let uri = format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(&picture));
    document.json["images"] = (0..32).map(|_| json!({ "uri": uri })).collect();
    let before = DECODED.get();
    document.read();
    assert_eq!(DECODED.get() - before, 1);
    // One that cannot be decoded is noted once for each image, and tried once.
    document.json["images"] = (0..32).map(|_| json!({ "uri": "data:,nothing" })).collect();
    let before = DECODED.get();
    let sink = document.read();
    assert_eq!((DECODED.get() - before, sink.received), (1, 64));
    assert!(sink.notes[0].contains("cannot be read"), "{:?}", sink.notes);
}

/// Returns the texture of rows of `width` pixels with opacities.
fn texture(width: usize, rgba: &[u8]) -> Texture {
    let (pixels, height) = (rgba.as_chunks().0, rgba.len() / 4 / width);
    let mut reducer = Reducer::new(width as u32, height as u32, false).unwrap();
    for (y, row) in pixels.chunks(width).enumerate() {
        reducer.row(y as u32, (0, 1), row.iter().copied());
    }
    Texture::of(&reducer.finish(), Alpha::Opacity).unwrap()
}

fn mapping() -> Mapping {
    Mapping { offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE, wrap: [Wrap::Repeat; 2] }
}
