use crate::import::UpAxis;
use crate::import::collect::Collector;
use crate::import::testing::{read_bytes, refused, refuses_every_truncation, survives_damage};
use glam::DVec3;
use proptest::prelude::*;

/// A file under construction in one of the three codings. Each value has a text form and little-endian bytes, which are
/// reversed for big-endian.
struct File {
    coding: &'static str,
    header: String,
    body: Vec<u8>,
}

impl File {
    fn new(coding: &'static str, header: &str) -> Self {
        Self { coding, header: format!("ply\nformat {coding} 1.0\n{header}end_header\n"), body: Vec::new() }
    }
    fn raw<const N: usize>(&mut self, little: [u8; N], text: String) -> &mut Self {
        let mut bytes = little;
        match self.coding {
            "ascii" => self.body.extend(format!("{text} ").bytes()),
            "binary_big_endian" => {
                bytes.reverse();
                self.body.extend(bytes);
            }
            _ => self.body.extend(bytes),
        }
        self
    }
    fn float(&mut self, x: f32) -> &mut Self {
        self.raw(x.to_le_bytes(), format!("{x:?}"))
    }
    fn double(&mut self, x: f64) -> &mut Self {
        self.raw(x.to_le_bytes(), format!("{x:?}"))
    }
    fn byte(&mut self, x: u8) -> &mut Self {
        self.raw([x], x.to_string())
    }
    fn short(&mut self, x: i16) -> &mut Self {
        self.raw(x.to_le_bytes(), x.to_string())
    }
    fn int(&mut self, x: i32) -> &mut Self {
        self.raw(x.to_le_bytes(), x.to_string())
    }
    fn end_row(&mut self) -> &mut Self {
        if self.coding == "ascii" {
            self.body.push(b'\n');
        }
        self
    }
    fn bytes(&self) -> Vec<u8> {
        [self.header.as_bytes(), &self.body].concat()
    }
}

const CODINGS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

fn positions(sink: &Collector) -> Vec<[DVec3; 3]> {
    sink.direct().iter().map(|t| t.positions).collect()
}

/// The quad (0,0) (1,0) (1,1) (0,1) at z = 0.5, with unusual properties around all data that is used.
fn odd_quad(coding: &'static str) -> File {
    let mut file = File::new(
        coding,
        "comment made by hand\nobj_info nothing\nelement camera 1\nproperty list uchar short view\n\
         element vertex 4\nproperty uchar quality\nproperty double x\nproperty list ushort float weights\n\
         property double z\nproperty double y\nproperty short tag\n\
         element face 2\nproperty short flags\nproperty list uchar int vertex_index\nproperty list uchar float uv\n\
         element edge 1\nproperty int a\nproperty int b\n",
    );
    file.byte(2).short(-7).short(9).end_row();
    for (x, y, n) in [(0.0, 0.0, 0), (1.0, 0.0, 2), (1.0, 1.0, 1), (0.0, 1.0, 0)] {
        file.byte(200).double(x);
        match coding {
            "ascii" => file.byte(n),
            _ => file.short(i16::from(n)),
        };
        for _ in 0..n {
            file.float(0.25);
        }
        file.double(0.5).double(y).short(-3).end_row();
    }
    file.short(1).byte(4).int(0).int(1).int(2).int(3).byte(2).float(0.0).float(1.0).end_row();
    file.short(1).byte(2).int(0).int(1).byte(0).end_row();
    file.int(0).int(1).end_row();
    file
}

#[test]
fn any_property_is_skipped_in_every_coding() {
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.5);
    let expected = [[p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)], [p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]];
    for coding in CODINGS {
        let sink = read_bytes("quad.ply", odd_quad(coding).bytes()).expect(coding);
        assert_eq!(positions(&sink), expected, "{coding}");
        assert_eq!(sink.parts.len(), 1);
        assert_eq!(sink.parts[0].name, "quad");
        assert_eq!(sink.notes.len(), 1, "{:?}", sink.notes);
        assert!(sink.notes[0].contains("1 faces with fewer than three corners"), "{:?}", sink.notes);
    }
}

#[test]
fn every_truncation_is_refused() {
    for coding in CODINGS {
        let bytes = odd_quad(coding).bytes();
        // In text the last row is complete without its line ending and without some digits of its last number.
        let end = if coding == "ascii" { bytes.len() - 3 } else { bytes.len() };
        refuses_every_truncation("quad.ply", &bytes[..end]);
    }
}

fn triangle_ascii() -> String {
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
     element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        .into()
}

#[test]
fn lines_may_end_in_any_way() {
    let expected = positions(&read_bytes("t.ply", triangle_ascii()).unwrap());
    for end in ["\r\n", "\r"] {
        let sink = read_bytes("t.ply", triangle_ascii().replace('\n', end)).unwrap();
        assert_eq!(positions(&sink), expected, "{end:?}");
        assert!(sink.notes.is_empty());
    }
    // A lone carriage return ends the header; the binary data after it begins with a line feed.
    let mut file = File::new(
        "binary_little_endian",
        "element vertex 3\nproperty uchar x\nproperty uchar y\nproperty uchar z\n\
         element face 1\nproperty list uchar uchar vertex_indices\n",
    );
    file.header = file.header.replace('\n', "\r");
    for x in [10, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2] {
        file.byte(x);
    }
    let sink = read_bytes("t.ply", file.bytes()).unwrap();
    assert_eq!(positions(&sink), [[DVec3::new(10.0, 0.0, 0.0), DVec3::X, DVec3::Y]]);
}

#[test]
fn rows_of_text_may_be_wrapped() {
    let sink = read_bytes("t.ply", triangle_ascii().replace("1 0 0\n", "1\n0 0\n\n")).unwrap();
    assert_eq!(sink.received, 1);
}

#[test]
fn faults_of_text_name_their_line() {
    for (from, to, line, words) in [
        ("3 0 1 2", "3 0 1 3", "line 13", "vertex 3 of 3"),
        ("3 0 1 2", "3 0 1 -1", "line 13", "vertex -1 of 3"),
        ("3 0 1 2", "3 0 1 4294967296", "line 13", "vertex 4294967296 of 3"),
        ("3 0 1 2", "-3 0 1 2", "line 13", "negative length -3"),
        ("3 0 1 2", "99999999999 0 1 2", "line 13", "ends before"),
        ("0 1 0", "0 one 0", "line 12", "\"one\" is not a number"),
        ("element face 1", "element face", "line 7", "needs a name and a count"),
        ("element vertex 3", "element vertex -3", "line 3", "needs a name and a count"),
        ("float x", "half x", "line 4", "unknown type \"half\""),
        ("ascii", "binary", "line 2", "unknown format \"binary\""),
        ("element vertex 3\n", "", "line 3", "before any element"),
        ("end_header", "end_heder", "line 13", "has no end_header"),
        ("property float x", "propety float x", "line 4", "unknown header keyword \"propety\""),
        ("property list", "prop list", "line 8", "unknown header keyword \"prop\""),
        ("element face", "elemnt face", "line 7", "unknown header keyword \"elemnt\""),
        ("1 0 0", "1,0 0 0", "line 11", "\"1,0\" is not a number (decimals need a point, not a comma)"),
        ("1 0 0\n0 1 0\n", "1 0 0 0 1 0\n", "line 12", "ends before the data"),
        ("property float z\n", "", "line 8", "no x, y and z"),
    ] {
        let text = triangle_ascii();
        assert!(text.contains(from));
        let error = refused("t.ply", text.replacen(from, to, 1));
        assert!(error.contains(line) && error.contains(words), "{to}: {error}");
    }
}

#[test]
fn faults_of_binary_files_name_their_byte() {
    let mut file = plain("binary_little_endian", "uchar", &[[0.0; 3]; 3], &[vec![0, 1, 2], vec![0, 1, 3]]);
    let bytes = file.bytes();
    let error = refused("t.ply", &bytes);
    assert!(error.contains(&format!("byte {}", bytes.len())) && error.contains("vertex 3 of 3"), "{error}");
    file.body.truncate(file.body.len() - 1);
    let error = refused("t.ply", file.bytes());
    assert!(error.contains("the file ends before"), "{error}");
}

#[test]
fn false_counts_are_refused() {
    for coding in CODINGS {
        for count in ["4294967295", "4294967296", "4294967297", "1000000000000000000"] {
            for element in ["element vertex 3", "element face 1"] {
                let bytes = plain(coding, "uchar", &[[0.0; 3]; 3], &[vec![0, 1, 2]]).bytes();
                let at = bytes.windows(10).position(|w| w == b"end_header").unwrap();
                let (head, body) = bytes.split_at(at);
                let head = String::from_utf8(head.to_vec()).unwrap();
                let name = element.rsplit_once(' ').unwrap().0;
                let claim = head.replace(element, &format!("{name} {count}"));
                refused("t.ply", [claim.as_bytes(), body].concat());
            }
        }
    }
    // An element without properties occupies no bytes, whatever its count.
    let nothing = triangle_ascii().replace("element face", "element nothing 1000000000000000000\nelement face");
    assert_eq!(read_bytes("t.ply", nothing).unwrap().received, 1);
}

#[test]
fn files_without_faces_are_empty_models_with_a_note() {
    let cloud = triangle_ascii().replace("element face 1", "element range_grid 1");
    let sink = read_bytes("t.ply", cloud).unwrap();
    assert_eq!(sink.received, 0);
    assert!(sink.notes[0].contains("3 vertex, 1 range_grid") && sink.notes[0].contains("empty"), "{:?}", sink.notes);
    let sink = read_bytes("t.ply", "ply\nformat ascii 1.0\nend_header\n").unwrap();
    assert!(sink.notes[0].contains("no triangles"));
}

#[test]
fn faces_may_come_before_vertices() {
    for coding in CODINGS {
        let mut file = File::new(
            coding,
            "element face 1\nproperty list uchar int vertex_indices\n\
             element vertex 3\nproperty float x\nproperty float y\nproperty float z\n",
        );
        file.byte(3).int(2).int(0).int(1).end_row();
        for x in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            file.float(x[0]).float(x[1]).float(x[2]).end_row();
        }
        let sink = read_bytes("t.ply", file.bytes()).unwrap();
        assert_eq!(positions(&sink), [[DVec3::Y, DVec3::ZERO, DVec3::X]], "{coding}");
    }
}

#[test]
fn strips_turn_every_other_triangle_and_restart() {
    let text = triangle_ascii()
        .replace("element face 1\nproperty list uchar int", "element tristrips 1\nproperty list int int")
        .replace("vertex 3", "vertex 5")
        .replace("0 1 0\n", "0 1 0\n1 1 0\n2 2 2\n")
        .replace("3 0 1 2\n", "10 0 1 2 3 -1 4 0 1 -1 2\n");
    let sink = read_bytes("t.ply", text).unwrap();
    let (a, b, c, d, e) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0), DVec3::splat(2.0));
    assert_eq!(positions(&sink), [[a, b, c], [c, b, d], [e, a, b]]);
}

#[test]
fn colours_are_averaged_in_linear_light() {
    let file = |ty: &str, rows: [&str; 3]| {
        let header = format!("property float z\nproperty {ty} red\nproperty {ty} green\nproperty {ty} blue\n");
        triangle_ascii()
            .replace("property float z\n", &header)
            .replace("0 0 0\n1 0 0\n0 1 0\n", &format!("0 0 0 {}\n1 0 0 {}\n0 1 0 {}\n", rows[0], rows[1], rows[2]))
    };
    for bytes in [
        file("uchar", ["255 0 128", "0 0 128", "0 255 128"]),
        file("float", ["1 0 0.50196078", "0 0 0.50196078", "0 1 0.50196078"]),
        file("ushort", ["65535 0 32896", "0 0 32896", "0 65535 32896"]),
    ] {
        let sink = read_bytes("t.ply", bytes).unwrap();
        let colour = sink.direct()[0].colour().unwrap();
        // 128 / 255 is 0.2158605 in linear light.
        for (found, expected) in colour.into_iter().zip([1.0 / 3.0, 1.0 / 3.0, 0.215_860_5]) {
            assert!((found - expected).abs() < 1e-6, "{colour:?}");
        }
    }
    // The colour of the face takes precedence.
    let text = file("uchar", ["255 0 128", "0 0 128", "0 255 128"])
        .replace("vertex_indices\n", "vertex_indices\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n")
        .replace("3 0 1 2\n", "3 0 1 2 0 255 0\n");
    assert_eq!(read_bytes("t.ply", text).unwrap().direct()[0].colour(), Some([0.0, 1.0, 0.0]));
}

#[test]
fn our_own_tables_name_parts_and_materials() {
    let text = triangle_ascii()
        .replace(
            "element vertex",
            "comment outcrop units 0.001 up z\n\
             comment outcrop material 0 0.5 0.25 1 0.75 1 0.125 steel\n\
             comment outcrop part 0 100 - - whole\n\
             comment outcrop part 1 18446744073709551615 0 0 a bolt\n\
             comment outcrop part 3 7 9 - out of order\n\
             comment outcrops are rocks\nelement vertex",
        )
        .replace("element face 1", "element face 3")
        .replace("vertex_indices\n", "vertex_indices\nproperty int part\n")
        .replace("3 0 1 2\n", "3 0 1 2 1\n3 0 1 2 0\n3 0 1 2 1\n");
    let sink = read_bytes("t.ply", text).unwrap();
    assert_eq!((sink.metres_per_unit, sink.up), (Some(0.001), UpAxis::Z));
    assert_eq!(sink.parts.len(), 2);
    assert_eq!((sink.parts[1].id, sink.parts[1].name.as_str()), (Some(u64::MAX), "a bolt"));
    assert_eq!((sink.parts[1].parent, sink.parts[1].material), (Some(0), Some(0)));
    assert_eq!((sink.materials[0].colour, sink.materials[0].roughness), ([0.5, 0.25, 1.0], 0.125));
    assert_eq!(sink.direct().iter().map(|t| t.part).collect::<Vec<_>>(), [1, 0, 1]);
    assert!(sink.notes.len() == 1 && sink.notes[0].contains("1 comments"), "{:?}", sink.notes);
}

#[test]
fn parts_of_other_programs_keep_their_number() {
    let text = triangle_ascii()
        .replace("element face 1", "element face 2")
        .replace("vertex_indices\n", "vertex_indices\nproperty int part_id\n")
        .replace("3 0 1 2\n", "3 0 1 2 12\n3 0 1 2 -1\n");
    let sink = read_bytes("t.ply", text).unwrap();
    let ids: Vec<_> = sink.parts.iter().map(|p| (p.id, p.parent)).collect();
    assert_eq!(ids, [(None, None), (Some(12), Some(0)), (None, Some(0))]);
    assert_eq!(sink.direct().iter().map(|t| t.part).collect::<Vec<_>>(), [1, 2]);
}

/// Float positions and int indices: the layout of the fast path, if the file is binary and `count` is `uchar`.
fn plain(coding: &'static str, count: &str, vertices: &[[f32; 3]], faces: &[Vec<i32>]) -> File {
    let mut file = File::new(
        coding,
        &format!(
            "element vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
             element face {}\nproperty list {count} int vertex_indices\n",
            vertices.len(),
            faces.len()
        ),
    );
    for v in vertices {
        file.float(v[0]).float(v[1]).float(v[2]).float(9.0).end_row();
    }
    for face in faces {
        match count {
            "uchar" => file.byte(face.len() as u8),
            _ => file.short(face.len() as i16),
        };
        for &i in face {
            file.int(i);
        }
        file.end_row();
    }
    file
}

#[test]
fn more_triangles_than_a_batch_or_a_window_hold() {
    // 30,000 faces are 390 KB and 7.3 batches. Every 1000th is a quad, so that the reader leaves and re-enters the fast
    // path.
    let vertices: Vec<[f32; 3]> = (0..1000).map(|i| [i as f32, (i * i) as f32, -1.0]).collect();
    let faces: Vec<Vec<i32>> = (0..30_000)
        .map(|i| (0..if i % 1000 == 500 { 4 } else { 3 }).map(|k| (i * 7 + k * 13) % 1000).collect())
        .collect();
    let fast = read_bytes("t.ply", plain("binary_little_endian", "uchar", &vertices, &faces).bytes()).unwrap();
    assert_eq!(fast.received, 30_030);
    for (coding, count) in [("ascii", "uchar"), ("binary_big_endian", "uchar"), ("binary_little_endian", "short")] {
        let slow = read_bytes("t.ply", plain(coding, count, &vertices, &faces).bytes()).unwrap();
        assert!(positions(&slow) == positions(&fast), "{coding}");
    }
}

#[test]
fn parts_are_the_same_on_the_fast_path() {
    let rows: Vec<(i32, [i32; 3])> =
        (0..20_000).map(|i| (i / 700 % 9 - 1, [i % 5, (i + 1) % 5, (i * 3) % 5])).collect();
    let read = |coding: &'static str, count: &str, part_first: bool| {
        let list = format!("property list {count} int vertex_indices\n");
        let part = "property int part\n".to_owned();
        let header = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement face 20000\n";
        let properties = if part_first { part + &list } else { list + &part };
        let mut file = File::new(coding, &format!("{header}{properties}"));
        for i in 0..5u8 {
            file.float(i.into()).float(0.5).float(-1.0).end_row();
        }
        for (part, corners) in &rows {
            if part_first {
                file.int(*part);
            }
            if count == "uchar" {
                file.byte(3)
            } else {
                file.short(3)
            };
            for &c in corners {
                file.int(c);
            }
            if !part_first {
                file.int(*part);
            }
            file.end_row();
        }
        read_bytes("t.ply", file.bytes()).unwrap()
    };
    let expected = read("ascii", "uchar", false);
    let ids: Vec<_> = expected.direct().iter().map(|t| expected.parts[t.part as usize].name.clone()).collect();
    assert!(ids.iter().zip(&rows).all(|(name, (id, _))| *name == format!("part {id}")));
    for (coding, count) in
        [("binary_little_endian", "uchar"), ("binary_big_endian", "uchar"), ("binary_big_endian", "short")]
    {
        for part_first in [false, true] {
            let found = read(coding, count, part_first);
            assert!(found.direct() == expected.direct() && found.parts == expected.parts, "{coding} {count}");
        }
    }
}

#[test]
fn cancel_stops_reading() {
    let cancel = crate::base::progress::Cancel::new();
    cancel.cancel();
    let mut sink = Collector::with_cancel(cancel);
    let folder = crate::import::testing::temporary();
    let path = folder.path().join("t.ply");
    std::fs::write(&path, triangle_ascii()).unwrap();
    let outcome = crate::import::read_file(&path, &Default::default(), &mut sink);
    assert!(matches!(outcome, Err(crate::Error::Cancelled)));
    assert_eq!(sink.received, 0);
}

fn mesh() -> impl Strategy<Value = (Vec<[f32; 3]>, Vec<Vec<i32>>)> {
    let vertices = prop::collection::vec(prop::array::uniform3(any::<f32>()), 3..20);
    vertices.prop_flat_map(|v| {
        let n = v.len() as i32;
        let face = prop::collection::vec(0..n, 0..6);
        (Just(v), prop::collection::vec(face, 0..30))
    })
}

#[test]
fn generated_files_are_read_as_they_were_generated() {
    use crate::import::generate::{GenerateOptions, NAMES, generate, generate_file};
    let (options, cancel) = (GenerateOptions { triangles: 100_000, seed: 3, ..Default::default() }, Default::default());
    for name in NAMES {
        let mut pushed = Collector::new();
        generate(name, &options, &cancel, &mut pushed).unwrap();
        let folder = crate::import::testing::temporary();
        let path = folder.path().join("model.ply");
        generate_file(name, &options, &cancel, &path, &mut |_| {}).unwrap();
        let mut read = Collector::new();
        crate::import::read_file(&path, &Default::default(), &mut read).unwrap();
        assert!(read.direct() == pushed.direct(), "{name}");
        assert_eq!((read.metres_per_unit, read.up), (pushed.metres_per_unit, pushed.up), "{name}");
        assert_eq!(read.materials, pushed.materials, "{name}");
        for (i, part) in pushed.parts.iter_mut().enumerate() {
            part.id.get_or_insert(i as u64);
        }
        assert_eq!(read.parts, pushed.parts, "{name}");
        assert!(read.notes.is_empty(), "{name}: {:?}", read.notes);
    }
}

proptest! {
    #[test]
    fn all_codings_give_the_fan_of_every_face((vertices, faces) in mesh()) {
        let corner = |i: i32| DVec3::from(vertices[i as usize].map(f64::from));
        let expected: Vec<[DVec3; 3]> = faces
            .iter()
            .flat_map(|f| (2..f.len()).map(move |k| [f[0], f[k - 1], f[k]].map(corner)))
            .collect();
        for coding in CODINGS {
            let sink = read_bytes("t.ply", plain(coding, "uchar", &vertices, &faces).bytes()).unwrap();
            let bits = |t: &[[DVec3; 3]]| t.iter().flatten().flat_map(|p| p.to_array()).map(same).collect::<Vec<_>>();
            prop_assert_eq!(bits(&positions(&sink)), bits(&expected), "{}", coding);
        }
    }

    #[test]
    fn damage_is_survived(changes in prop::collection::vec((any::<usize>(), any::<u8>()), 1..4), coding in 0..3usize) {
        survives_damage("t.ply", &odd_quad(CODINGS[coding]).bytes(), &changes);
        let fast = plain(CODINGS[coding], "uchar", &[[0.0; 3]; 3], &[vec![0, 1, 2], vec![0, 1, 2]]);
        survives_damage("t.ply", &fast.bytes(), &changes);
    }
}

/// Returns the bits of a number, with one pattern for all NaNs.
fn same(x: f64) -> u64 {
    if x.is_nan() { u64::MAX } else { x.to_bits() }
}
