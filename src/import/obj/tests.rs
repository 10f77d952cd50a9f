use crate::import::collect::Collector;
use crate::import::testing::{read_bytes, read_files, refused, survives_damage, survives_every_truncation};
use glam::DVec3;
use proptest::prelude::*;

pub(super) const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn read(faces: &str) -> Collector {
    read_bytes("file.obj", format!("{SQUARE}{faces}")).unwrap()
}

/// Returns name, parent's name and number of triangles of each part.
pub(super) fn parts(sink: &Collector) -> Vec<(&str, &str, usize)> {
    let name = |p: u32| sink.parts[p as usize].name.as_str();
    (0..sink.parts.len() as u32)
        .map(|p| {
            let parent = sink.parts[p as usize].parent.map_or("", name);
            (name(p), parent, sink.direct().iter().filter(|t| t.part == p).count())
        })
        .collect()
}

#[test]
fn every_form_of_corner_is_understood() {
    let expected = read("f 1 2 3 4\n");
    assert_eq!(expected.received, 2);
    for faces in [
        "f 1/1 2/2 3/3 4/4",
        "f 1//1 2//1 3//1 4//1",
        "f 1/1/1 2/2/1 3/3/1 4/4/1",
        "f -4 -3 -2 -1",
        "f -4/-1/-1 -3//-1 -2 -1/9",
        "  f\t1 2   3 4  ",
        "f 1 2 \\\n3 4",
        "f 1 2 \\  \r\n 3\\\n 4",
        "fo 1 2 3 4",
    ] {
        let sink = read(faces);
        assert_eq!(sink.direct(), expected.direct(), "{faces}");
        assert!(sink.notes.is_empty(), "{faces}: {:?}", sink.notes);
    }
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    assert_eq!(expected.direct()[1].positions, [p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]);
}

#[test]
fn negative_indices_count_back_from_their_line() {
    let sink = read("f -1 -2 -3\nv 9 9 9\nf -1 -2 -3\n");
    assert_eq!(sink.direct()[1].positions[0], DVec3::splat(9.0));
    assert_eq!(sink.direct()[1].positions[1], sink.direct()[0].positions[0]);
}

#[test]
fn faults_name_their_line() {
    for (line, words) in [
        ("f 1 2 5", "vertex 5 is out of range: 4"),
        ("f 1 2 -5", "vertex -5 is out of range: 4"),
        ("f 0 1 2", "vertex 0 is out of range"),
        ("f 1 2 4294967297", "vertex 4294967297 is out of range"),
        ("f 1 2 99999999999999999999", "is not a vertex"),
        ("f 1 2 x", "\"x\" is not a vertex"),
        ("f 1 2 /3", "\"/3\" is not a vertex"),
        ("v 1 2", "three coordinates"),
        ("v 1 2 z", "\"z\" is not a number"),
    ] {
        let error = refused("file.obj", format!("{SQUARE}# a comment\n\n{line}\nf 1 2 3\n"));
        assert!(error.contains("line 7") && error.contains(words), "{line}: {error}");
    }
    // An error in a continued line names the first physical line.
    let error = refused("file.obj", format!("{SQUARE}f 1 \\\n2 \\\n7\n"));
    assert!(error.contains("line 5"), "{error}");
}

#[test]
fn objects_groups_and_materials_make_a_hierarchy() {
    let sink = read(
        "f 1 2 3\no A\nf 1 2 3\ng left\nusemtl m\nf 1 2 3\nusemtl n\nf 1 2 3 4\ng right side\nf 1 2 3\n\
         o B\nf 1 2 3\ng left\nf 1 2 3\no A\ng left\nusemtl m\nf 1 2 3\n",
    );
    assert_eq!(
        parts(&sink),
        [
            ("file", "", 1),
            ("A", "", 1),
            ("left", "A", 0),
            ("m", "left", 2),
            ("n", "left", 2),
            ("right side", "A", 1),
            ("B", "", 1),
            ("left", "B", 1),
        ]
    );
}

#[test]
fn an_object_is_a_part_also_if_only_its_groups_have_faces() {
    let sink = read("o A\ng one\nf 1 2 3\ng\nf 1 2 3\no empty\n");
    assert_eq!(parts(&sink), [("A", "", 0), ("one", "A", 1), ("default", "A", 1)]);
}

#[test]
fn libraries_give_materials() {
    let obj = format!("mtllib sub lib.mtl\n{SQUARE}usemtl red\nf 1 2 3\nusemtl glass\nf 1 2 3\nusemtl none\nf 1 2 3\n");
    let mtl =
        b"# library\nnewmtl red\nKd 1 0.25 0\nPm 1\nPr 0.5\nNs 2\nKd spectral file.rfl\nnewmtl glass\nd 0.25\nTr 0.9\n\
                newmtl old\nTr 0.9\nd -halo x\nnewmtl unused\n";
    let sink = read_files(&[("file.obj", obj.as_bytes()), ("sub lib.mtl", mtl)]).unwrap();
    assert_eq!(parts(&sink), [("file", "", 0), ("red", "file", 1), ("glass", "file", 1), ("none", "file", 1)]);
    assert_eq!(sink.materials.len(), 2);
    let red = sink.materials[0];
    assert_eq!((red.colour, red.opacity, red.metalness, red.roughness), ([1.0, 0.25, 0.0], 1.0, 1.0, 0.5));
    assert_eq!(sink.materials[1].opacity, 0.25);
    let materials: Vec<_> = sink.parts.iter().map(|p| p.material).collect();
    assert_eq!(materials, [None, Some(0), Some(1), None]);
    assert_eq!(sink.notes.len(), 2, "{:?}", sink.notes);
    assert!(
        sink.notes[0].contains("1 × invalid \"Kd\" (first in line 7)") && sink.notes[1].contains("\"none\""),
        "{:?}",
        sink.notes
    );
}

#[test]
fn one_library_line_may_name_several_files() {
    let obj = format!("mtllib a.mtl b.mtl missing.mtl\n{SQUARE}g g\nusemtl b\nf 1 2 3\n");
    let files = [("file.obj", obj.as_bytes()), ("a.mtl", &b"newmtl a\n"[..]), ("b.mtl", b"newmtl b\nTr 0.25\n")];
    let sink = read_files(&files).unwrap();
    assert_eq!(sink.parts[0].material, Some(0));
    assert_eq!(sink.materials[0].opacity, 0.75);
    assert!(sink.notes.len() == 1 && sink.notes[0].contains("missing.mtl"), "{:?}", sink.notes);
}

#[test]
fn vertices_may_have_weights_or_colours() {
    let text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0 1\nv 1 1 0 0 0 1\nv 0 1 0 0.5\nf 1 2 3\nf 1 2 4\n";
    let sink = read_bytes("file.obj", text).unwrap();
    assert_eq!(sink.direct()[0].colour(), Some([1.0 / 3.0; 3]));
    // The triangle has a corner without a colour and takes the material's.
    assert_eq!(sink.direct()[1].colour(), Some(crate::import::MaterialDesc::default().colour));
    assert_eq!(sink.direct()[1].positions[2], DVec3::Y);
}

#[test]
fn colours_of_vertices_may_reach_to_255() {
    let text = "v 0 0 0 0 0 0\nv 1 0 0 255 0 0\nv 0 1 0 0 0 255\nv 0 0 1 1 0 0\nf 1 2 3\nf 2 2 2\nf 4 4 4\n";
    let sink = read_bytes("file.obj", text).unwrap();
    let third = 1.0 / 3.0;
    assert_eq!(sink.direct()[0].colour(), Some([third, 0.0, third]));
    assert_eq!(sink.direct()[1].colour(), Some([1.0, 0.0, 0.0]));
    assert!(sink.direct()[2].colour().is_some_and(|c| c[0] > 0.0 && c[0] < 0.001));
    assert!(
        sink.notes.len() == 1 && sink.notes[0].contains("0 to 255") && sink.notes[0].contains("line 2"),
        "{:?}",
        sink.notes
    );
}

#[test]
fn ignored_lines_are_noted_once() {
    let sink = read("vt 0 0\nvn 0 0 1\ns 1\np 1\nl 1 2\nl 2 3\nt crease 1\ncurv 0 1\nf 1 2 3\nf 1 2\n");
    assert_eq!(sink.received, 1);
    assert_eq!(sink.notes.len(), 2, "{:?}", sink.notes);
    assert!(sink.notes[0].contains("2 × \"l\" (first in line 9)") && !sink.notes[0].contains("vt"), "{:?}", sink.notes);
    assert!(sink.notes[1].contains("1 faces with fewer than three"), "{:?}", sink.notes);
    let sink = read_bytes("file.obj", "# nothing\n").unwrap();
    assert!(sink.parts.is_empty() && sink.notes[0].contains("no triangles"), "{:?}", sink.notes);
}

#[test]
fn positions_keep_double_precision() {
    let sink = read_bytes("file.obj", "v 10000000.0625 0.1 -1e-300\nv 1.#INF nan 0\nv 0 0 1\nf 1 2 3\n").unwrap();
    assert_eq!(sink.direct()[0].positions[0], DVec3::new(10_000_000.062_5, 0.1, -1e-300));
    assert!(!sink.direct()[0].positions[1].is_finite());
}

#[test]
fn binary_rubbish_is_not_an_object_file() {
    let error = refused("main.obj", b"\x64\x86\x02\0\0\0\0\0v 1 2 3\n");
    assert!(error.contains("binary"), "{error}");
}

#[test]
fn truncation_is_survived() {
    let text = format!("mtllib a.mtl\n{SQUARE}o A\nusemtl m\nf 1/1 2/2 3/3 \\\n4/4\ng B\nf -1 -2 -3\n");
    survives_every_truncation("file.obj", text.as_bytes());
}

#[test]
fn lines_longer_than_the_window_are_read() {
    let corners: String = (0..200_000).map(|i| format!("{} ", i % 4 + 1)).collect();
    let sink = read(&format!("f {corners}\n"));
    assert_eq!(sink.received, 199_998);
}

proptest! {
    #[test]
    fn damage_is_survived(changes in prop::collection::vec((any::<usize>(), any::<u8>()), 1..4)) {
        let text = format!("{SQUARE}o A\nusemtl m\nf 1/1 2/2 3/3 \\\n4/4\ng B\nusemtl n\nf -1 -2 -3\n");
        survives_damage("file.obj", text.as_bytes(), &changes);
    }

    #[test]
    fn relative_and_absolute_indices_agree(faces in prop::collection::vec(prop::array::uniform4(0usize..4), 1..20)) {
        let text = |relative: bool| -> String {
            let index = |i: &usize| if relative { *i as i64 - 4 } else { *i as i64 + 1 };
            faces.iter().map(|f| format!("f {}\n", f.iter().map(|i| index(i).to_string()).collect::<Vec<_>>().join(" "))).collect()
        };
        let (absolute, relative) = (read(&text(false)), read(&text(true)));
        prop_assert_eq!(absolute.direct(), relative.direct());
        prop_assert_eq!(absolute.received as usize, 2 * faces.len());
    }
}
