//! PLY files as programs write them: marks, rows that are too long, header lines without a keyword.

use crate::import::testing::{read_bytes, refused};
use glam::DVec3;

const HEADER: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                      element face 1\nproperty list uchar int vertex_indices\nend_header\n";
const BODY: &str = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

/// Reads a text file, which must hold the one triangle. Returns the notes.
fn notes(bytes: impl AsRef<[u8]>) -> Vec<String> {
    let sink = read_bytes("t.ply", bytes).unwrap();
    assert_eq!(sink.direct().iter().map(|t| t.positions).collect::<Vec<_>>(), [[DVec3::ZERO, DVec3::X, DVec3::Y]]);
    sink.notes
}

/// The same triangle, with binary data.
fn binary(header: &str) -> Vec<u8> {
    let header = header.replace("ascii", "binary_little_endian");
    let floats = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].into_iter().flat_map(f32::to_le_bytes);
    let list = [3].into_iter().chain([0i32, 1, 2].into_iter().flat_map(i32::to_le_bytes));
    header.bytes().chain(floats).chain(list).collect()
}

#[test]
fn a_byte_order_mark_is_not_part_of_the_header() {
    for name in ["t.ply", "t"] {
        let text = format!("\u{feff}{HEADER}{BODY}");
        assert_eq!(read_bytes(name, text).unwrap().received, 1, "{name}");
    }
    assert!(notes(binary(&format!("\u{feff}{HEADER}"))).is_empty());
}

#[test]
fn rows_that_are_too_long_are_noted() {
    let all = notes(format!("{HEADER}{}", BODY.replace("1 0 0\n0 1 0\n", "1 0 0 0.5 0.5\n0 1 0 9\n")));
    assert!(all[0].contains("2 × values behind the last property of a row (first in line 11)"), "{all:?}");
    let all = notes(format!("{HEADER}{}", BODY.replace("3 0 1 2\n", "3 0 1 2 255 0 0\n")));
    assert!(all[0].contains("(first in line 13)"), "{all:?}");
    assert!(notes(format!("{HEADER}{}", BODY.replace("3 0 1 2\n", "3 0 1 2 # the only one\n"))).is_empty());
    for comment in ["# x", "#", "  # 1 2 3"] {
        let body = BODY.replace("1 0 0\n", &format!("{comment}\n1 0 0\n{comment}\n"));
        assert!(notes(format!("{HEADER}{comment}\n{body}")).is_empty(), "{comment}");
    }
    // A row that is too short takes values of the next.
    let error = refused("t.ply", format!("{HEADER}{}", BODY.replace("1 0 0\n", "1 0\n") + "1 2 3\n"));
    assert!(error.contains("line 12") && error.contains("\"1\" follows the last property of a row"), "{error}");
    // Faces before vertices: the vertices are read first, and the rows twice.
    let (start, faces) = HEADER.split_once("element vertex").unwrap();
    let (vertices, faces) = faces.split_once("element face").unwrap();
    let header =
        format!("{start}element face{}element vertex{vertices}end_header\n", faces.replace("end_header\n", ""));
    let all = notes(format!("{header}3 0 1 2 7\n0 0 0\n1 0 0 8\n0 1 0\n"));
    assert!(all[0].contains("2 × values"), "{all:?}");
}

#[test]
fn header_lines_without_a_keyword_are_noted() {
    for line in ["made by a program", "# made by hand", "Version 1 2", "element_count is 3 now", "comments are here"] {
        let header = HEADER.replace("element face", &format!("{line}\nelement face"));
        for all in [notes(format!("{header}{BODY}")), notes(binary(&header))] {
            assert_eq!(all.len(), usize::from(!line.starts_with('#')), "{line}: {all:?}");
            assert!(
                all.iter().all(|note| note.contains("1 × header lines with \"") && note.contains("line 7")),
                "{all:?}"
            );
        }
    }
    let error = refused("t.ply", format!("{}{BODY}", HEADER.replace("element face 1", "elements face 1")));
    assert!(error.contains("line 7") && error.contains("unknown header keyword"), "{error}");
}

#[test]
fn text_may_end_with_padding_and_mixed_ends_of_lines() {
    assert!(notes(format!("{HEADER}{BODY}\u{1a}")).is_empty());
    assert!(notes([HEADER.as_bytes(), BODY.as_bytes(), &[0; 3000]].concat()).is_empty());
    assert!(notes(format!("{HEADER}{}", BODY.trim_end()) + "\0\0").is_empty());
    assert!(notes(format!("{HEADER}{}", BODY.replace('\n', "\r"))).is_empty());
    assert!(notes(format!("{}{BODY}", HEADER.replace('\n', "\r\n"))).is_empty());
}
