//! OBJ and MTL text as programs write it: marks, codings, comments, endings of lines.

use super::tests::{SQUARE, parts};
use crate::import::testing::{read_bytes, read_files, refused};
use glam::DVec3;

/// Bytes of a text with `{}` replaced.
fn filled(text: &str, with: &[u8]) -> Vec<u8> {
    let (before, after) = text.split_once("{}").expect("a place");
    [before.as_bytes(), with, after.as_bytes()].concat()
}

#[test]
fn a_byte_order_mark_hides_no_vertex() {
    let text = "\u{feff}v 5 0 0\nv 1 0 0\nv 0 1 0\nv 9 9 9\nf 1 2 3\n";
    let sink = read_bytes("file.obj", text).unwrap();
    assert_eq!(sink.direct()[0].positions, [DVec3::new(5.0, 0.0, 0.0), DVec3::X, DVec3::Y]);
    assert!(sink.notes.is_empty(), "{:?}", sink.notes);
    // Also without the file extension, and in a library.
    assert_eq!(read_bytes("file", text).unwrap().received, 1);
    let obj = format!("mtllib a.mtl\n{SQUARE}usemtl red\nf 1 2 3\n");
    let mtl = "\u{feff}newmtl red\nKd 1 0 0\n";
    let sink = read_files(&[("file.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes())]).unwrap();
    assert_eq!(sink.materials[0].colour, [1.0, 0.0, 0.0]);
    assert!(sink.notes.is_empty(), "{:?}", sink.notes);
}

#[test]
fn a_byte_order_mark_within_the_text_hides_no_vertex() {
    let one = "\u{feff}v 5 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n";
    for text in [format!("{one}{one}"), format!("\u{feff}{one}\u{feff}# a\n{one}")] {
        let sink = read_bytes("file.obj", text).unwrap();
        let triangles: Vec<_> = sink.direct().iter().map(|t| t.positions).collect();
        assert_eq!(triangles, [[DVec3::new(5.0, 0.0, 0.0), DVec3::X, DVec3::Y]; 2]);
        assert!(sink.notes.is_empty(), "{:?}", sink.notes);
    }
}

#[test]
fn text_in_utf_16_is_named() {
    for bytes in [&b"\xff\xfev\0 \0"[..], b"\xfe\xff\0v\0 "] {
        let error = refused("file.obj", bytes);
        assert!(error.contains("UTF-16"), "{error}");
    }
}

/// Left, right and front in Shift-JIS and GBK, and German words in Latin-1. The second bytes of some letters are `\`.
const NAMES: [[&[u8]; 3]; 4] = [
    [b"\x8d\xb6", b"\x89E", b"\x91O"],
    [b"\x95\\", b"\x83\\", b"\x94\\"],
    [b"\xd7\xf3", b"\xd3\xd2", b"\xc7\xb0"],
    [b"T\xfcr", b"T\xf6r", b"T\xe4r"],
];

#[test]
fn names_in_any_coding_stay_different() {
    for names in NAMES {
        let (mut obj, mut mtl) = (format!("mtllib a.mtl\n{SQUARE}").into_bytes(), Vec::new());
        for (i, name) in names.iter().enumerate() {
            obj.extend(filled("g {}\n", name));
            obj.extend(filled("usemtl {}\nf 1 2 3\n", name));
            mtl.extend(filled("newmtl {}\n", name));
            mtl.extend(format!("Kd {i} 0.5 1\n").bytes());
        }
        let sink = read_files(&[("file.obj", &obj), ("a.mtl", &mtl)]).unwrap();
        assert!(sink.notes.is_empty(), "{:?}", sink.notes);
        assert_eq!(sink.parts.iter().map(|p| p.material).collect::<Vec<_>>(), [Some(0), Some(1), Some(2)]);
        let colours: Vec<_> = sink.materials.iter().map(|m| m.colour[0]).collect();
        assert_eq!(colours, [0.0, 1.0, 1.0], "Kd is clamped to 1");
        let shown: std::collections::HashSet<_> = sink.parts.iter().map(|p| p.name.clone()).collect();
        assert_eq!(shown.len(), 3, "{shown:?}");
        assert_eq!(sink.direct().iter().map(|t| t.part).collect::<Vec<_>>(), [0, 1, 2]);
    }
    assert_eq!(read_bytes("a.obj", filled("g {}\nv 0 0 0\nf 1 1 1\n", b"T\xfcr")).unwrap().parts[0].name, "T\u{fc}r");
}

#[test]
fn comments_may_follow_any_value() {
    for text in [
        "v 0 0 0 # a\nv 1 0 0#b 7\nv 0 1 0 # 1 2 3\nf 1 2 3 # c 4\n",
        "v 0 0 0\t#a\nv 1 0 0 #\nv 0 1 0\nf 1/1 2/2 3/3#c d 1\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 # the folder is C:\\\nf 1 2 3 #\\\n",
    ] {
        let sink = read_bytes("file.obj", text).unwrap();
        assert_eq!(sink.direct()[0].positions, [DVec3::ZERO, DVec3::X, DVec3::Y], "{text}");
        assert_eq!(sink.received as usize, text.matches('f').count() - text.matches("fo").count(), "{text}");
        assert!(sink.notes.is_empty() && sink.direct()[0].colour().is_none(), "{text}: {:?}", sink.notes);
    }
    let obj = format!("mtllib a.mtl # library\n{SQUARE}usemtl red # first\nf 1 2 3\nusemtl a #1\nf 1 2 3\n");
    let mtl =
        b"newmtl red # red\nKd 1 0 0 # full\nd 0.5# half\nPr 0.25 # smooth\nnewmtl a #1\nKd 0.5 # grey\nnewmtl a\n";
    let sink = read_files(&[("file.obj", obj.as_bytes()), ("a.mtl", mtl)]).unwrap();
    assert!(sink.notes.is_empty(), "{:?}", sink.notes);
    let red = sink.materials[0];
    assert_eq!((red.colour, red.opacity, red.roughness), ([1.0, 0.0, 0.0], 0.5, 0.25));
    assert_eq!(sink.materials[1].colour, [0.5; 3], "the whole name comes first");
}

#[test]
fn text_behind_coordinates_is_noted() {
    let sink = read_bytes("file.obj", "v 0 0 0\nv 1 0 0 top\nv 0 1 0 0.5 corner\nf 1 2 3\n").unwrap();
    assert_eq!(sink.direct()[0].positions, [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert!(sink.notes[0].contains("2 × text behind coordinates (first in line 2)"), "{:?}", sink.notes);
}

#[test]
fn numbers_that_would_be_guessed_are_refused() {
    for (line, words) in [
        ("v 1,5 0 0", "\"1,5\" is not a number (decimals need a point, not a comma)"),
        ("v 1.0f 0 0", "\"1.0f\" is not a number"),
        ("v 0 # 0 0", "three coordinates"),
        ("v 0 0 x#0", "\"x#0\" is not a number"),
        ("f 1 2 3 x # 4", "\"x\" is not a vertex"),
        ("f 1 2 y#3", "\"y\" is not a vertex"),
        ("f 1 2 9#3", "vertex 9 is out of range"),
    ] {
        let error = refused("file.obj", format!("{SQUARE}{line}\n"));
        assert!(error.contains("line 5") && error.contains(words), "{line}: {error}");
    }
}

#[test]
fn lines_may_end_in_any_way_also_mixed() {
    let text = format!("# a\n{SQUARE}g b\nusemtl c\nf 1 2 3\nf 1 3 \\\n4\n");
    let expected = read_bytes("file.obj", &text).unwrap();
    assert_eq!(expected.received, 2);
    let ends = ["\r", "\r\n", "\n"];
    let mixed: String = text.lines().enumerate().map(|(i, line)| format!("{line}{}", ends[i % 3])).collect();
    for text in [text.replace('\n', "\r"), text.replace('\n', "\r\n"), mixed] {
        let sink = read_bytes("file.obj", &text).unwrap();
        assert_eq!((sink.direct(), &sink.parts), (expected.direct(), &expected.parts), "{text:?}");
        let error = refused("file.obj", format!("{text}f 9 9 9"));
        assert!(error.contains("line 11"), "{error}");
    }
    // An ending of two bytes may lie across the border of the window.
    for filler in (256 << 10) - 40..(256 << 10) + 8 {
        let text = format!("#{}\r\n{}f 1 2 3\r\nf 9 9 9", "x".repeat(filler), SQUARE.replace('\n', "\r\n"));
        assert!(refused("file.obj", text).contains("line 7"), "{filler}");
    }
}

#[test]
fn padding_behind_the_text_is_not_data() {
    for padding in [&b"\x1a"[..], &[0; 2000], b"\n\0\0\0"] {
        let sink = read_bytes("file.obj", [SQUARE.as_bytes(), b"f 1 2 3", padding].concat()).unwrap();
        assert!(sink.received == 1 && sink.notes.is_empty(), "{:?}", sink.notes);
    }
}

#[test]
fn usemtl_without_a_name_ends_a_material() {
    let obj = format!("mtllib a.mtl\n{SQUARE}usemtl red\nf 1 2 3\nusemtl\nf 1 2 3\n");
    let sink = read_files(&[("file.obj", obj.as_bytes()), ("a.mtl", b"newmtl red\nKd 1 0 0\n")]).unwrap();
    assert_eq!(parts(&sink), [("file", "", 0), ("red", "file", 1), ("no material", "file", 1)]);
    assert!(sink.parts[2].material.is_none() && sink.notes.is_empty(), "{:?}", sink.notes);
}

#[test]
fn libraries_are_found_under_names_of_other_systems() {
    let mtl = b"newmtl red\nKd 1 0 0\n";
    for (name, file) in [
        ("my colours.mtl", "my colours.mtl"),
        ("\"my colours.mtl\"", "my colours.mtl"),
        ("C:\\models\\car\\car.mtl", "car.mtl"),
        ("/home/me/car.mtl", "car.mtl"),
        (".\\car.mtl", "car.mtl"),
        ("Car.MTL", "car.mtl"),
    ] {
        let obj = format!("mtllib {name}\n{SQUARE}usemtl red\nf 1 2 3\n");
        let sink = read_files(&[("file.obj", obj.as_bytes()), (file, mtl)]).unwrap();
        assert!(sink.materials.len() == 1 && sink.notes.is_empty(), "{name}: {:?}", sink.notes);
    }
    let obj = format!("mtllib gone.mtl\n{SQUARE}usemtl red\nf 1 2 3\n");
    let sink = read_bytes("file.obj", obj).unwrap();
    assert!(sink.received == 1 && sink.notes.len() == 2, "{:?}", sink.notes);
    assert!(sink.notes[0].contains("gone.mtl") && sink.notes[1].contains("\"red\""), "{:?}", sink.notes);
}

#[test]
fn a_backslash_that_ends_a_name_does_not_join_lines() {
    let text = format!("{SQUARE}g C:\\dir\\\nf 1 2 3\ng a \\\nb\nf 1 3 \\\n4\nf 1 2\\\n 3\n");
    let sink = read_bytes("file.obj", text).unwrap();
    assert_eq!(sink.received, 3, "{:?}", sink.notes);
    let names: Vec<_> = sink.parts.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["C:\\dir\\", "a  b"]);
}

#[test]
fn values_of_materials_that_are_no_numbers_are_noted() {
    let obj = format!("mtllib a.mtl\n{SQUARE}usemtl a\nf 1 2 3\n");
    let mtl = b"newmtl a\nd nan\nKd nan 0 0\nPr nan\n";
    let sink = read_files(&[("file.obj", obj.as_bytes()), ("a.mtl", mtl)]).unwrap();
    for word in ["invalid \"d\"", "invalid \"Kd\"", "invalid \"Pr\""] {
        assert!(sink.notes[0].contains(word), "{:?}", sink.notes);
    }
    assert_eq!(sink.materials[0].opacity, 1.0);
    for mtl in [&b"\xff\xfen\0e\0"[..], b"\xfe\xff\0n\0e"] {
        let sink = read_files(&[("file.obj", obj.as_bytes()), ("a.mtl", mtl)]).unwrap();
        assert!(sink.notes.iter().any(|note| note.contains("UTF-16")), "{:?}", sink.notes);
    }
}
