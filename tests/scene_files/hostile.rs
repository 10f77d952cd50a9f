//! Damaged scene files, and files that are wrong under right checksums.

use super::{Folder, GOLDEN, golden, sealed, why};
use crate::common::built;
use crate::common::rng::Rng;
use glam::DAffine3;
use outcrop::base::error::Error;
use outcrop::scene::{Context, ContextOptions, Scene};
use std::path::Path;

fn context() -> Context {
    let options = ContextOptions { threads: 0, memory_budget: 64 << 20, ..ContextOptions::default() };
    Context::new(options).expect("a context")
}

fn open(context: &Context, path: &Path, bytes: &[u8]) -> Result<Scene, Error> {
    std::fs::write(path, bytes).expect("a file");
    Scene::open(context, path)
}

/// Each byte changed, and each prefix: an error that names the file.
#[test]
fn every_damage_is_found() {
    let (folder, context) = (Folder::new(), context());
    GOLDEN.iter().for_each(|(name, _)| find_every_damage(&context, &folder.at("scene.oc"), &golden(&folder, name)));
}

fn find_every_damage(context: &Context, path: &Path, good: &[u8]) {
    open(context, path, good).expect("a scene");
    let check = |bytes: &[u8], what: &str| {
        let error = open(context, path, bytes).err().unwrap_or_else(|| panic!("{what} was opened"));
        let is_known = matches!(error, Error::Corrupt { .. } | Error::NewerFormat { .. });
        assert!(is_known && error.to_string().contains("scene.oc"), "{what}: {error}");
    };
    for at in 0..good.len() {
        for change in [0x01, 0x80, 0xff] {
            let mut bytes = good.to_vec();
            bytes[at] ^= change;
            check(&bytes, &format!("byte {at} ^ {change}"));
        }
    }
    for len in 0..good.len() {
        check(&good[..len], &format!("{len} bytes"));
    }
    check(&[good, &[0]].concat(), "one byte more");
    assert_eq!(context.memory_used(), 0);
}

/// Each byte changed under right checksums: a scene or an error, within the budget, and what opens is saved again as it
/// is.
#[test]
fn wrong_values_under_right_checksums_end_in_an_error_or_a_scene() {
    let (folder, context) = (Folder::new(), context());
    let (path, good) = (folder.at("scene.oc"), golden(&folder, GOLDEN[1].0));
    let (mut opened, mut refused) = (0, 0);
    for at in 0..good.len() {
        for value in [0, 1, 0x7f, 0x80, 0xff] {
            let mut bytes = good.clone();
            bytes[at] = value;
            let bytes = sealed(bytes);
            match open(&context, &path, &bytes) {
                Ok(scene) => {
                    opened += 1;
                    // To write a file takes longer than to open it.
                    if opened % 16 == 0 {
                        scene.save(&path).expect("a file");
                        assert!(std::fs::read(&path).expect("a file") == bytes, "byte {at}: {value}");
                    }
                }
                Err(Error::Internal(why)) => panic!("byte {at}: {value}: {why}"),
                Err(_) => refused += 1,
            }
        }
    }
    assert!(opened > 500 && refused > 500, "{opened} {refused}");
}

/// Several wrong numbers at a time, with rows that are there twice or not at all: each ends, and no memory is left.
#[test]
fn any_file_under_right_checksums_ends_in_an_error_or_a_scene() {
    let (folder, context) = (Folder::new(), context());
    let (path, good, mut rng) = (folder.at("scene.oc"), golden(&folder, GOLDEN[1].0), Rng::new(11));
    let mut opened = 0;
    for _ in 0..2500 {
        let mut bytes = good.clone();
        if rng.one_in(3) {
            let words = (bytes.len() - 96) / 8;
            let at = 96 + 8 * rng.below(words);
            let count = 8 * (1 + rng.below(16));
            let end = bytes.len().min(at + count);
            if rng.one_in(2) {
                bytes.splice(end..end, good[at..end].to_vec());
            } else {
                bytes.drain(at..end);
            }
        }
        for _ in 0..rng.below(4) {
            let at = 4 * rng.below(bytes.len() / 4);
            let value = match rng.below(6) {
                0 => rng.below(5) as u32,
                1 => u32::MAX - rng.below(3) as u32,
                2 => 1 << rng.below(32),
                3 => f32::to_bits([f32::NAN, f32::INFINITY, 0.0, -1.0, 1e30, 1e-30][rng.below(6)]),
                _ => rng.below(1 << 30) as u32,
            };
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        let len = bytes.len() as u64;
        bytes[16..24].copy_from_slice(&len.to_le_bytes());
        match open(&context, &path, &sealed(bytes)) {
            Ok(scene) => opened += usize::from(scene.state().summary().levels > 0),
            Err(Error::Internal(why)) => panic!("{why}"),
            Err(_) => {}
        }
        assert_eq!(context.memory_used(), 0);
    }
    assert!(opened > 100, "{opened}");
}

/// Offsets in the golden file.
const MODEL: usize = 96 + 2 * 48;
const INNER: usize = MODEL + 24 + 8;
const SINGLES: usize = INNER + 24;
const PLACES: usize = SINGLES + 2 * 112 + 32;
const TRANSFORMS: usize = PLACES + 32 + 8;
const LISTS: usize = TRANSFORMS + 136;
const OUTER: usize = LISTS + 24 + 32;
const SCENES: usize = OUTER + 24;

/// Each wrong value is named, with its place.
#[test]
fn errors_name_the_place() {
    let (folder, context) = (Folder::new(), context());
    let (path, good) = (folder.at("scene.oc"), golden(&folder, GOLDEN[1].0));
    let u32s = |value: u32| value.to_le_bytes().to_vec();
    let array = format!("array at byte {PLACES}");
    let of_lists = format!("byte {PLACES}");
    let of_masks: &[&str] = &[&of_lists, "no member has a mask of its own"];
    let of_tints: &[&str] = &[&of_lists, "no member has a tint"];
    let of_plain: &[&str] = &[&of_lists, "masks or tints in a file of format 0.1"];
    let of_array: &[&str] = &["scene 0", &array, "instance 0"];
    let cases: Vec<(usize, Vec<u8>, &[&str])> = vec![
        (24, u32s(1 << 30), &["1073741824 models"]),
        (28, u32s(0), &["no scene"]),
        (28, u32s(1 << 31), &["2147483648 scenes"]),
        (32, u32s(1 << 16), &["65536 lights"]),
        (32, u32s(1 << 17), &["more than 65536 lights"]),
        (10, vec![3], &["format 0.3", "0.2"]),
        (10, vec![1], of_plain),
        (96 + 8, f32::NAN.to_le_bytes().to_vec(), &["byte 96", "light"]),
        (MODEL + 24, b"/etc".to_vec(), &["byte 192", "not relative"]),
        (MODEL + 24, vec![0xff], &["byte 192", "UTF-8"]),
        (INNER, u32s(1 << 20), &["1048576 instances"]),
        (INNER + 4, u32s(3), &["3 states of 2 instances"]),
        (SINGLES + 8, u32s(1), &["scene 0", "it has model 1", "has 1"]),
        (SINGLES + 112, 7u64.to_le_bytes().to_vec(), &["scene 0", "instance 7 is there twice"]),
        (SINGLES, u64::MAX.to_le_bytes().to_vec(), &["scene 0", "too many"]),
        (SINGLES + 16, f64::NAN.to_le_bytes().to_vec(), &["scene 0", "instance 7", "singular or not finite"]),
        (SINGLES + 16, vec![0; 72], &["scene 0", "instance 7", "singular or not finite"]),
        (SINGLES + 2 * 112, u32s(2), &["a state is that of no instance"]),
        (PLACES, u32s(3), &["unknown form"]),
        (PLACES + 4, u32s(0), &["2^31 - 1 members"]),
        (PLACES + 4, u32s((1 << 31) - 1), &["2147483647 transforms"]),
        (PLACES + 8, 6u64.to_le_bytes().to_vec(), &["scene 0", "instance 7 is there twice"]),
        (PLACES + 16, u32s(0), &["no prototype"]),
        (TRANSFORMS + 24, vec![0; 16], of_array),
        (TRANSFORMS + 132, vec![1], &["padding is not zero"]),
        (PLACES + 20, u32s(8), &["unknown flags"]),
        (LISTS, vec![0xff; 12], of_masks),
        (LISTS + 12, vec![0xff; 12], of_tints),
        (SCENES + 8, u32s(1), &["scene 1", "scene 1, which is not before it"]),
        (SCENES + 8, u32s(9), &["scene 1", "scene 9, which is not before it"]),
    ];
    for (at, value, has) in cases {
        let mut bytes = good.clone();
        bytes[at..at + value.len()].copy_from_slice(&value);
        let text = why(open(&context, &path, &sealed(bytes)));
        assert!(text.contains("scene.oc") && has.iter().all(|it| text.contains(it)), "byte {at}: {text}");
    }
    let text = why(open(&context, &path, b"solid stl\n"));
    assert!(text.contains("not an outcrop scene"), "{text}");
}

/// As many levels as scenes may have, and one more; and more occurrences than numbers.
#[test]
fn levels_and_occurrences_are_limited() {
    let (folder, context) = (Folder::new(), built::context(1));
    let model = &folder.open(&context)[1];
    let mut scene = Scene::new(&context);
    scene.add_instance(model, 1, DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    for _ in 1..64 {
        let outer = Scene::new(&context);
        outer.add_scene(&scene, 1, DAffine3::IDENTITY).expect("a scene");
        outer.commit().expect("a commit");
        scene = outer;
    }
    let path = folder.at("scene.oc");
    scene.save(&path).expect("a file");
    assert_eq!(Scene::open(&context, &path).expect("a scene").state().path(0).expect("a way").0, [1; 64]);
    let good = std::fs::read(&path).expect("a file");
    // A scene row, and a row of the instance: of the scene before.
    let (row, end) = (24 + 112, good.len() - 8);
    let mut deep = [&good[..end], &good[end - row..]].concat();
    deep[end + 24 + 8..end + 24 + 12].copy_from_slice(&63u32.to_le_bytes());
    let len = deep.len() as u64;
    deep[16..24].copy_from_slice(&len.to_le_bytes());
    deep[28..32].copy_from_slice(&65u32.to_le_bytes());
    let text = why(open(&context, &path, &sealed(deep)));
    assert!(text.contains("scene 64") && text.contains("64 levels"), "{text}");

    // Each of these levels has the one before twice: 2^63 in all.
    let first = good.len() - 8 - 63 * row;
    let mut many = good[..first].to_vec();
    for level in 1..64u32 {
        let at = good.len() - 8 - 63 * row;
        let mut scene = good[at..at + 24].to_vec();
        scene[8..12].copy_from_slice(&2u32.to_le_bytes());
        for id in 1..3u64 {
            let mut single = good[at + 24..at + row].to_vec();
            single[..8].copy_from_slice(&id.to_le_bytes());
            single[8..12].copy_from_slice(&(level - 1).to_le_bytes());
            scene.extend(single);
        }
        many.extend(scene);
    }
    many.extend([0; 8]);
    let len = many.len() as u64;
    many[16..24].copy_from_slice(&len.to_le_bytes());
    let text = why(open(&context, &path, &sealed(many)));
    assert!(text.contains("scene 63") && text.contains("2^63"), "{text}");
}

/// What takes little memory is not counted, but a file may have any number of it: it counts together.
#[test]
fn many_small_scenes_must_fit_the_budget() {
    let (folder, context) = (Folder::new(), context());
    let path = folder.at("scene.oc");
    let file = |count: u32| {
        let mut bytes = golden(&folder, GOLDEN[0].0)[..96].to_vec();
        bytes[24..28].copy_from_slice(&0u32.to_le_bytes());
        bytes[28..32].copy_from_slice(&(count + 1).to_le_bytes());
        bytes[32..36].copy_from_slice(&0u32.to_le_bytes());
        bytes.extend(vec![0; 24 * count as usize]);
        bytes.extend([0, 0, count, 0, 0, 0].iter().flat_map(|count: &u32| count.to_le_bytes()));
        for index in 0..count {
            bytes.extend(u64::from(index).to_le_bytes());
            bytes.extend(u64::from(index).to_le_bytes());
            bytes.extend(DAffine3::IDENTITY.to_cols_array().iter().flat_map(|number| number.to_le_bytes()));
        }
        bytes.extend([0; 8]);
        let len = bytes.len() as u64;
        bytes[16..24].copy_from_slice(&len.to_le_bytes());
        sealed(bytes)
    };
    let scene = open(&context, &path, &file(1000)).expect("a scene");
    assert_eq!((scene.state().summary().scenes, scene.state().summary().stored), (1001, 1000));
    let used = context.memory_used();
    assert!((1_000_000..32_000_000).contains(&used), "{used}");
    drop(scene);
    let error = open(&context, &path, &file(60_000)).err().expect("an error");
    assert!(matches!(error, Error::OverBudget { .. }), "{error}");
    assert_eq!(context.memory_used(), 0);
}
