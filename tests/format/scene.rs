//! The section on scene files against the golden file: each table describes the bytes at its place.

use super::page::{check_row, fields, numbers, section};
use super::{hash, le_f32s, magic};
use outcrop::store::scene_file::{
    ArrayRow, LightRow, MOST_LIGHTS, MOST_PATH, ModelFileRow, SCENE_FOOTER_LEN, SCENE_HEADER_LEN, SCENE_MAGIC,
    SCENE_VERSION, SceneFileRow, SceneRow, SingleRow, StateRow,
};

const HEADER: &str = "### Scene file: header";

#[test]
fn title_and_sizes_are_those_of_the_code() {
    let (heading, text) = section("## 9. The scene file");
    assert!(heading.ends_with(&format!("format {}.{}", SCENE_VERSION.0, SCENE_VERSION.1)), "{heading}");
    for part in [
        format!("| header | {SCENE_HEADER_LEN} |"),
        format!("| lights | {} each |", LightRow::LEN),
        format!("| models | {} each, ", ModelFileRow::LEN),
        format!("a u64 | {SCENE_FOOTER_LEN} |"),
    ] {
        assert!(text.contains(&part), "{part}");
    }
    assert_eq!(magic(HEADER), SCENE_MAGIC);
    let limit = |begin: &str, name: &str| {
        let all = fields(begin);
        let range = all.iter().find(|field| field.name.starts_with(name)).expect("a field").range;
        numbers(&range.replace(',', "")).last().copied()
    };
    assert_eq!(limit(HEADER, "lights"), Some(MOST_LIGHTS.into()));
    assert_eq!(limit("### Scene file: model", "bytes of the path"), Some(MOST_PATH as u64));
    let behind = section("### Scene file: array").1;
    for len in ArrayRow::FORMS {
        assert!(behind.contains(&format!("| {len} x n |")), "{len}");
    }
}

/// The golden file has two lights, the model `model.oc`, and two scenes.
#[test]
fn rows_of_scene_files() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scene_files/golden.bin");
    let bytes = std::fs::read(path).expect("the golden file");
    let at = |from: usize, len: usize| bytes[from..from + len].to_vec();
    let header = [
        ("magic", SCENE_MAGIC.to_vec()),
        ("major version", le!(SCENE_VERSION.0)),
        ("minor version", le!(SCENE_VERSION.1)),
        ("bytes of the header", le!(SCENE_HEADER_LEN as u32)),
        ("bytes of the file", le!(bytes.len() as u64)),
        ("models", le!(1u32)),
        ("scenes", le!(2u32)),
        ("lights", le!(2u32)),
        ("background", le!(1u32)),
        ("the colour, or that at the bottom", le_f32s(&[0.55, 0.58, 0.62, 1.0])),
        ("the colour at the top", le_f32s(&[0.12, 0.16, 0.23, 1.0])),
        ("reserved", vec![0; 16]),
        ("checksum of bytes 0 to 87", hash(&bytes[..88])),
    ];
    check_row(HEADER, &at(0, SCENE_HEADER_LEN), &header);
    let sun = SCENE_HEADER_LEN + LightRow::LEN;
    let light = [
        ("kind: 0 headlight, 1 point, 2 directional", le!(2u32)),
        ("flags: bit 0 casts shadows", le!(1u32)),
        ("linear red, green, blue", le_f32s(&[1.0, 0.5, 0.25])),
        ("intensity", le!(2.0f32)),
        ("position, or direction", le!(0.5f64, 0.25f64, -1.0f64)),
    ];
    check_row("### Scene file: light", &at(sun, LightRow::LEN), &light);
    let model = sun + LightRow::LEN;
    let named = [
        ("bytes of its file", at(model, 8)),
        ("checksum of all 256 bytes of its header", at(model + 8, 8)),
        ("bytes of the path", le!(8u32)),
        ("reserved", le!(0u32)),
    ];
    check_row("### Scene file: model", &at(model, ModelFileRow::LEN), &named);
    assert_eq!(at(model + ModelFileRow::LEN, 8), b"model.oc");
    let inner = model + ModelFileRow::LEN + 8;
    let rows = |values: [u32; 6]| {
        let names = [
            "single instances of models",
            "states of these",
            "single instances of scenes",
            "states of these",
            "arrays of models",
            "arrays of scenes",
        ];
        names.into_iter().zip(values.map(|value| le!(value))).collect::<Vec<_>>()
    };
    check_row("### Scene file: scene", &at(inner, SceneRow::LEN), &rows([2, 1, 0, 0, 1, 0]));
    let singles = inner + SceneRow::LEN;
    let single = [
        ("the caller's id", le!(7u64)),
        ("row of the model", le!(0u32)),
        ("reserved", le!(0u32)),
        ("map to the scene", at(singles + 16, 96)),
    ];
    check_row("### Scene file: single instance", &at(singles, SingleRow::LEN), &single);
    let states = singles + 2 * SingleRow::LEN;
    let state = [
        ("index of the instance", le!(1u32)),
        ("mask", le!(u32::MAX)),
        ("flags: bit 0 hidden, bit 1 highlighted, bit 2 has a colour", le!(4u32)),
        ("reserved", le!(0u32)),
        ("colour", le_f32s(&[1.0, 0.25, 0.0, 1.0])),
    ];
    check_row("### Scene file: state", &at(states, StateRow::LEN), &state);
    let array = states + StateRow::LEN;
    let places = [
        ("form of the transforms: 0 affine in f64, 1 affine in f32, 2 place", le!(2u32)),
        ("members", le!(3u32)),
        ("id of the first member", le!(20u64)),
        ("prototypes", le!(1u32)),
        ("flags: bit 0 members have indices", le!(6u32)),
        ("mask", le!(u32::MAX)),
        ("states", le!(1u32)),
    ];
    check_row("### Scene file: array", &at(array, ArrayRow::LEN), &places);
    // One prototype and four zeros, three places of 44 bytes and four zeros, masks and tints, a state.
    let lists = array + ArrayRow::LEN + 8 + 136;
    let masks = le!(1u32, u32::MAX, u32::MAX);
    assert_eq!(at(lists, 12), masks);
    assert_eq!(at(lists + 12, 12), [255, 255, 255, 255, 255, 128, 0, 255, 255, 255, 255, 255]);
    let outer = lists + 24 + StateRow::LEN;
    check_row("### Scene file: scene", &at(outer, SceneRow::LEN), &rows([0, 0, 1, 1, 1, 1]));
    assert_eq!(at(bytes.len() - SCENE_FOOTER_LEN, SCENE_FOOTER_LEN), hash(&bytes[..bytes.len() - SCENE_FOOTER_LEN]));
}
