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
    sink.direct().iter().map(|t| t.colour).collect()
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
        ("facet normal", "facett normal", "line 2", "expected \"facet\" or \"endsolid\", found \"facett\""),
        ("outer loop", "inner loop", "line 3", "expected \"outer\", found \"inner\""),
        ("vertex 0 0 0", "vertex 0 0", "line 5", "\"vertex\" is not a number"),
        ("1.0e+000", "1,0", "line 5", "\"1,0\" is not a number"),
        ("SOLID\n", "LIQUID\n", "line 17", "expected \"solid\", found \"LIQUID\""),
    ] {
        let error = refused("t.stl", text().replacen(from, to, 1));
        assert!(error.contains(line) && error.contains(words), "{to}: {error}");
    }
}

#[test]
fn every_truncation_is_refused() {
    // Exceptions are truncations between two solids, and inside the name at the end.
    let bytes = text().into_bytes();
    let fine = |len: usize| {
        let cut = std::str::from_utf8(&bytes[..len]).unwrap();
        let last = cut.rfind("endsolid").is_some_and(|at| !cut[at..].to_ascii_uppercase().contains("\nSOLID"));
        last && !cut.trim_end().ends_with("SOLI")
            && !["S", "SO", "SOL"].iter().any(|s| cut.ends_with(&format!("\n{s}")))
    };
    for len in 0..bytes.len() {
        let read = read_bytes("t.stl", &bytes[..len]);
        assert_eq!(read.is_ok(), fine(len), "{len}: {:?}", read.err().map(|e| e.to_string()));
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
