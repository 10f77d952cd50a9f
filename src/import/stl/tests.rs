use crate::import::UpAxis;
use crate::import::collect::Collector;
use crate::import::testing::{read_bytes, refused, refuses_every_truncation, survives_damage};
use glam::DVec3;
use proptest::prelude::*;

fn text() -> String {
    let facet = |z: u32| {
        format!(
            " facet normal 0 0 1\n  outer loop\n   vertex 0 0 {z}\n   vertex 1.0e+000 0 {z}\n   vertex 0 1 {z}\n  endloop\n endfacet\n"
        )
    };
    format!("solid first one\n{}{}endsolid first one\nSOLID\n{}ENDSOLID", facet(0), facet(1), facet(2))
}

/// Returns a binary file with one triangle for each of `attributes`, the 16 bits of a triangle.
fn binary(header: &[u8], attributes: &[u16]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((attributes.len() as u32).to_le_bytes());
    for (i, bits) in attributes.iter().enumerate() {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, i as f32]];
        for x in [0.0f32; 3].into_iter().chain(corners.into_iter().flatten()) {
            bytes.extend(x.to_le_bytes());
        }
        bytes.extend(bits.to_le_bytes());
    }
    bytes
}

fn colours(sink: &Collector) -> Vec<Option<[f32; 3]>> {
    sink.direct().iter().map(|t| t.colour()).collect()
}

#[test]
fn solids_are_parts() {
    let sink = read_bytes("parts.stl", text()).unwrap();
    assert_eq!(sink.parts.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["first one", "parts"]);
    assert_eq!(sink.direct().iter().map(|t| t.part).collect::<Vec<_>>(), [0, 0, 1]);
    assert_eq!(sink.direct()[2].positions, [(0, 0), (1, 0), (0, 1)].map(|(x, y)| DVec3::new(x.into(), y.into(), 2.0)));
    assert_eq!(sink.up, UpAxis::Z);
    assert!(sink.notes.is_empty());
}

#[test]
fn facets_may_have_more_corners_and_share_a_line() {
    let quad = "solid q facet\nfacet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 1 1 0 vertex 0 1 0 \
                endloop endfacet color 1 0 0\nendsolid";
    assert_eq!(read_bytes("q.stl", quad).unwrap().received, 2);
    let two = quad.replace("vertex 1 1 0 vertex 0 1 0", "");
    let sink = read_bytes("q.stl", two).unwrap();
    assert_eq!((sink.received, sink.notes.len()), (0, 2), "{:?}", sink.notes);
}

#[test]
fn faults_of_text_name_their_line() {
    for (from, to, line, words) in [
        ("facet normal", "facett normal", "line 3", "expected \"facet\" or \"endsolid\", found \"outer\""),
        ("outer loop", "inner loop", "line 3", "expected \"outer\", found \"loop\""),
        ("  outer loop\n", "", "line 3", "expected \"outer\", found \"vertex\""),
        ("vertex 0 0 0", "vertex 0 0", "line 5", "\"vertex\" is not a number"),
        ("vertex 0 0 0", "vertes 0 0 0", "line 4", "expected \"vertex\" or \"endloop\", found \"vertes\""),
        ("  endloop\n endfacet\n", "", "line 7", "expected \"vertex\" or \"endloop\", found \"facet\""),
        (" endfacet\n", "", "line 8", "expected \"endfacet\", found \"facet\""),
        ("1.0e+000", "1,0", "line 5", "\"1,0\" is not a number (decimals need a point, not a comma)"),
        ("1.0e+000", "1.0f", "line 5", "\"1.0f\" is not a number"),
    ] {
        let error = refused("t.stl", text().replacen(from, to, 1));
        assert!(error.contains(line) && error.contains(words), "{to}: {error}");
    }
}

#[test]
fn text_may_be_written_in_any_manner() {
    let plain = text();
    let expected = read_bytes("t.stl", &plain).unwrap();
    let same = |text: Vec<u8>, notes: &[&str]| {
        let shown = String::from_utf8_lossy(&text).into_owned();
        let sink = read_bytes("t.stl", &text).unwrap_or_else(|e| panic!("{e}: {shown}"));
        let positions = |sink: &Collector| sink.direct().iter().map(|t| t.positions).collect::<Vec<_>>();
        assert_eq!(positions(&sink), positions(&expected), "{shown}");
        let all = sink.notes.join("\n");
        assert!(notes.iter().all(|note| all.contains(note)), "{shown}: {all}");
        assert_eq!(all.is_empty(), notes.is_empty(), "{shown}: {all}");
    };
    // Without a word, and what a note says.
    same(plain.replace("endsolid", "end solid").into_bytes(), &[]);
    same(plain.replace("endfacet", "End Facet").replace("endloop", "end loop").into_bytes(), &[]);
    same(format!("\u{feff}{plain}").into_bytes(), &[]);
    same(
        format!("# made by hand\n{}", plain.replace("0 0 0\n", "0 0 0 # a\n").replace("0 1 0\n", "0 1 0#b 7\n")).into(),
        &[],
    );
    same(plain.replace('\n', "\r").into_bytes(), &[]);
    for padding in [&b"\0"[..], &[0; 5000], b"\n\x1a"] {
        same([plain.as_bytes(), padding].concat(), &[]);
    }
    same(plain.replace("normal 0 0 1", "normal").into_bytes(), &[]);
    same(plain.replace("normal 0 0 1", "normal 0,5 -nan 1.0f").into_bytes(), &[]);
    // A name with the words of a facet, and padding between facets.
    same(plain.replace("first one", "facet normal plate").into_bytes(), &[]);
    same(plain.replace(" facet normal", "\0\0\0 facet normal").into_bytes(), &[]);
    same(plain.replace(" facet normal", "\0\0\n facet normal").into_bytes(), &[]);
    // With a note.
    for comment in ["// x", ";", "; endloop", "//"] {
        let text = plain.replacen("  outer", &format!("{comment}\n  outer"), 1);
        let text = text.replacen("   vertex 0 1", &format!("{comment}\n   vertex 0 1"), 1);
        same(text.into_bytes(), &["2 × comments within facets (first in line 3)"]);
    }
    same(
        plain.replace("0 1 0\n", "0 1 0 1\n").into_bytes(),
        &["1 × vertices with more than three numbers (first in line 6)"],
    );
    same(plain.replace("ENDSOLID", "").into_bytes(), &["endsolid\" at the end of the file", "(first in line 24)"]);
    same(plain.replace("endsolid first one\n", "").into_bytes(), &["1 × missing \"endsolid\" (first in line 16)"]);
    same(format!("; made by hand\n\n{plain}").into_bytes(), &["1 × lines with \";\" (first in line 1)"]);
    same(
        plain.replace("SOLID\n", "LIQUID\n").replace("ENDLIQUID", "").into_bytes(),
        &["\"LIQUID\"", "missing \"solid\""],
    );
    same(plain.replace(" facet", " // top\n facet").into_bytes(), &["3 × lines with \"//\" (first in line 2)"]);
    same(format!("{plain}\nmade by hand\n").into_bytes(), &["1 × lines with \"made\" (first in line 26)"]);
}

#[test]
fn a_whole_file_may_be_one_line() {
    let sink = read_bytes("t.stl", text().replace("one\n facet", "one facet").replace('\n', " ")).unwrap();
    assert_eq!((sink.received, sink.parts[0].name.as_str()), (3, "first one"), "{:?}", sink.notes);
}

#[test]
fn a_comment_before_the_solid_does_not_hide_the_format() {
    for name in ["t.stl", "t", "t.txt"] {
        let sink = read_bytes(name, format!("// a comment\n# another\n{}", text())).unwrap();
        assert_eq!(sink.parts.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["first one", "t"], "{name}");
    }
}

#[test]
fn truncations_are_refused_or_noted() {
    // A truncation inside a facet is refused. Between facets only the end of the solid is missing.
    let bytes = text().into_bytes();
    for len in 1..bytes.len() {
        let cut = std::str::from_utf8(&bytes[..len]).unwrap();
        let begun = cut.matches(" facet").count() > cut.matches("endfacet").count();
        match read_bytes("t.stl", cut) {
            Ok(sink) => {
                assert!(!begun, "{cut}");
                let upper = cut.to_ascii_uppercase();
                let open = upper.replace("ENDSOLID", "").contains("SOLID") && !upper.trim_end().ends_with("ENDSOLID");
                let between = upper.rfind("ENDSOLID").is_some_and(|at| !upper[at..].contains("\nSOLID"));
                assert!(
                    between || !open || sink.notes.iter().any(|n| n.contains("cut short")),
                    "{cut}: {:?}",
                    sink.notes
                );
            }
            Err(error) => assert!(begun || len < 6, "{cut}: {error}"),
        }
    }
    refuses_every_truncation("t.stl", &binary(b"header", &[0, 0, 0]));
}

#[test]
fn binary_files_may_begin_like_text() {
    let sink = read_bytes("t.stl", binary(b"solid facet normal", &[0, 0])).unwrap();
    assert_eq!((sink.received, sink.parts[0].name.as_str()), (2, "t"));
    // The same holds without the file extension.
    assert_eq!(read_bytes("t.bin", binary(b"solid facet", &[0])).unwrap().received, 1);
}

#[test]
fn announced_counts_are_checked_against_the_file() {
    for count in [2u32, u32::MAX] {
        let mut bytes = binary(b"", &[0]);
        bytes[80..84].copy_from_slice(&count.to_le_bytes());
        let error = refused("t.stl", &bytes);
        assert!(error.contains(&format!("1 of the {count} triangles")) && error.contains("byte 134"), "{error}");
    }
    let longer = [binary(b"", &[0]), vec![1, 2, 3]].concat();
    let sink = read_bytes("t.stl", longer).unwrap();
    assert!(sink.received == 1 && sink.notes[0].contains("3 bytes after"), "{:?}", sink.notes);
    assert!(read_bytes("t.stl", binary(b"", &[])).unwrap().notes[0].contains("no triangles"));
}

#[test]
fn solid_view_sets_bit_15_and_begins_with_blue() {
    let red = 1 << 15 | 31 << 10;
    let sink = read_bytes("t.stl", binary(b"", &[red, 0, 1 << 15 | 31])).unwrap();
    let grey = crate::import::MaterialDesc::default().colour;
    assert_eq!(colours(&sink), [Some([1.0, 0.0, 0.0]), Some(grey), Some([0.0, 0.0, 1.0])]);
    assert!(sink.materials.is_empty());
    // The triangles before the first coloured one get the grey too.
    assert_eq!(
        colours(&read_bytes("t.stl", binary(b"", &[0, 0, red])).unwrap()),
        [Some(grey), Some(grey), Some([1.0, 0.0, 0.0])]
    );
    // Without bit 15 the other bits are not a colour.
    assert_eq!(colours(&read_bytes("t.stl", binary(b"", &[31, 5])).unwrap()), [None, None]);
}

#[test]
fn magics_clears_bit_15_and_begins_with_red() {
    let header = b"some writer COLOR=\x00\xff\x00\x80,MATERIAL=";
    let sink = read_bytes("t.stl", binary(header, &[31, 1 << 15])).unwrap();
    assert_eq!(colours(&sink), [Some([1.0, 0.0, 0.0]), Some([0.0, 1.0, 0.0])]);
    assert_eq!(sink.materials[0].colour, [0.0, 1.0, 0.0]);
    assert!((sink.materials[0].opacity - 128.0 / 255.0).abs() < 1e-6);
    assert_eq!(sink.parts[0].material, Some(0));
}

proptest! {
    #[test]
    fn damage_is_survived(changes in prop::collection::vec((any::<usize>(), any::<u8>()), 1..4)) {
        survives_damage("t.stl", text().as_bytes(), &changes);
        survives_damage("t.stl", &binary(b"solid COLOR=abcd", &[0, 1 << 15, 77]), &changes);
    }
}
