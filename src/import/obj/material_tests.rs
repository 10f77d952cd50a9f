//! Materials as photogrammetry and exporters write them: opacity, textures, notes.

use super::tests::SQUARE;
use crate::import::MaterialDesc;
use crate::import::collect::Collector;
use crate::import::testing::read_files;
use image::{ImageFormat, Rgba, RgbaImage};
use std::io::Cursor;

/// Reads a square with one material that has the given statements.
fn material(statements: &str) -> (MaterialDesc, Vec<String>) {
    let obj = format!("mtllib a.mtl\n{SQUARE}usemtl m\nf 1 2 3\n");
    let mtl = format!("newmtl m\n{statements}\n");
    let sink = read_files(&[("file.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes())]).unwrap();
    (sink.materials[0], sink.notes)
}

#[test]
fn opacity_is_what_viewers_show() {
    for (statements, opacity) in [
        ("d 0.25\nTr 0.25", 0.25),
        ("d 1\nTr 1", 1.0),
        ("Tr 0", 1.0),
        ("Tr 0.75", 0.25),
        ("Tr 1", 1.0),
        ("Tr 1.000\nillum 2\nTf 0.1 0.1 0.1", 1.0),
        // A car's windows.
        ("d 1\nTf 0.4 0.4 0.4\nillum 4", 0.6),
        ("Tf 0.9 0.6 0.3\nillum 7", 0.4),
        ("d 0.5\nTf 0.5\nillum 6", 0.25),
        // A material of Maya, and opaque models of illumination.
        ("illum 4\nTf 1.00 1.00 1.00", 1.0),
        ("illum 2\nTf 0.7 0.7 0.7", 1.0),
        ("Tf 0.7 0.7 0.7", 1.0),
        ("illum 4", 1.0),
    ] {
        let (looks, notes) = material(statements);
        assert!((looks.opacity - opacity).abs() < 1e-6, "{statements}: {}", looks.opacity);
        assert_eq!(notes.len(), usize::from(statements.starts_with("Tr 1")), "{statements}: {notes:?}");
    }
    let (_, notes) = material("Tr 1");
    assert!(notes[0].contains("a.mtl") && notes[0].contains("opaque (first in line 1)"), "{notes:?}");
}

#[test]
fn statements_without_effect_are_noted() {
    let (_, notes) =
        material("Ka 1 1 1\nKs 0 0 0\nNi 1\nKe 0 0 0\nmap_Bump a.png\nbump a.png\nrefl b.png\nmap_Bump c.png");
    assert_eq!(notes.len(), 1, "{notes:?}");
    for words in ["2 × \"map_Bump\" (first in line 6)", "1 × \"bump\"", "1 × \"refl\""] {
        assert!(notes[0].contains(words), "{notes:?}");
    }
    assert!(material("Ke 5 5 5").1[0].contains("1 × \"Ke\" (first in line 2)"));
    let (looks, notes) = material("Kd 0,5 0,5 0,5");
    assert_eq!(looks.colour, MaterialDesc::default().colour);
    assert!(notes[0].contains("invalid \"Kd\" (first in line 2)"), "{notes:?}");
}

/// A picture with a green upper half and a red lower half, 4 × 4 pixels, with the given alpha.
fn picture(alpha: u8) -> Vec<u8> {
    let colour = |y| if y < 2 { [0, 255, 0, alpha] } else { [255, 0, 0, 255] };
    let mut bytes = Vec::new();
    let picture = RgbaImage::from_fn(4, 4, |_, y| Rgba(colour(y)));
    picture.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).expect("a picture");
    bytes
}

/// Reads two triangles, one in the upper half of the picture and one in the lower, with material statements.
fn painted(statements: &str, picture: &[u8]) -> Collector {
    let obj = format!(
        "mtllib a.mtl\n{SQUARE}vt 0.1 0.6\nvt 0.9 0.6\nvt 0.5 0.9\nvt 0.1 0.1\nvt 0.9 0.1\nvt 0.5 0.4\n\
         usemtl m\nf 1/1 2/2 3/3\nf 1/4 2/5/1 3/-1\n"
    );
    let mtl = format!("newmtl m\n{statements}\n");
    read_files(&[("file.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes()), ("my wall.png", picture)]).unwrap()
}

fn colours(sink: &Collector) -> Vec<[f32; 3]> {
    sink.direct().iter().map(|t| t.colour().expect("a colour").map(|c| (c * 1000.0).round() / 1000.0)).collect()
}

const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
const RED: [f32; 3] = [1.0, 0.0, 0.0];

#[test]
fn a_texture_colours_each_triangle() {
    for statements in [
        "Kd 1 1 1\nmap_Kd my wall.png",
        "Kd 0 0 0\nmap_Kd my wall.png",
        "map_Kd my wall.png",
        "map_Kd -s 1 1 1 -o 0 0 0 -clamp on -blendu off -mm 0 1 C:\\textures\\My Wall.PNG\nKd 0.0 0.0 0.0 # none",
        "map_Kd -o 0 1 my wall.png # a wall\nKd 0 0 0",
    ] {
        let sink = painted(statements, &picture(255));
        assert_eq!(colours(&sink), [GREEN, RED], "{statements}");
        assert_eq!(sink.materials[0].colour, [0.5, 0.5, 0.0], "the mean of the texture");
        assert!(sink.notes.is_empty(), "{statements}: {:?}", sink.notes);
    }
    let factor = painted("Kd 0.5 0.25 1\nmap_Kd my wall.png", &picture(255));
    assert_eq!(colours(&factor), [[0.0, 0.25, 0.0], [0.5, 0.0, 0.0]]);
    let moved = painted("Kd 1 1 1\nmap_Kd -o 0 0.5 my wall.png", &picture(255));
    assert_eq!(colours(&moved), [RED, GREEN]);
    // Half of the coordinates: the upper triangle reaches from 0.3 to 0.45.
    assert_eq!(colours(&painted("Kd 1 1 1\nmap_Kd -s 0.5 0.5 my wall.png", &picture(255))), [RED, RED]);
}

#[test]
fn alpha_counts_only_with_a_texture_of_opacity() {
    let sink = painted("Kd 0 0 0\nmap_Kd my wall.png", &picture(0));
    assert_eq!((colours(&sink), sink.materials[0].colour), (vec![GREEN, RED], [0.5, 0.5, 0.0]));
    let sink = painted("Kd 1 1 1\nmap_Kd my wall.png\nmap_d my wall.png", &picture(0));
    assert_eq!(colours(&sink), [RED, RED], "without colours of its own a triangle has the mean");
    assert!(sink.notes[0].contains("1 × \"map_d\""), "{:?}", sink.notes);
}

#[test]
fn a_texture_that_cannot_be_used_leaves_one_colour() {
    let grey = MaterialDesc::default().colour;
    for (kd, colour) in [("Kd 0 0 0", grey), ("Kd 1 0.5 0", [1.0, 0.5, 0.0])] {
        for (name, bytes, words) in
            [("gone.png", picture(255), "gone.png"), ("my wall.png", b"no".to_vec(), "my wall.png")]
        {
            let sink = painted(&format!("{kd}\nmap_Kd {name}"), &bytes);
            assert_eq!(sink.materials[0].colour, colour);
            assert!(sink.direct().iter().all(|t| t.colour().is_none()));
            let note = &sink.notes[0];
            assert!(note.contains("1 textures were left out") && note.contains(words), "{note}");
        }
    }
}

#[test]
fn triangles_without_texture_coordinates_have_the_mean_of_the_texture() {
    let obj = format!(
        "mtllib a.mtl\n{SQUARE}vt 0.5 x\nvt 0.5 0.9\nusemtl m\nf 1 2 3\nf 1/9 2/9 3/9\nf 1/1 2/1 3/1\nf 1/2 2/2 3/2\n"
    );
    let files =
        [("file.obj", obj.as_bytes()), ("a.mtl", &b"newmtl m\nKd 0 0 0\nmap_Kd t.png\n"[..]), ("t.png", &picture(255))];
    let sink = read_files(&files).unwrap();
    let mean = [0.5, 0.5, 0.0];
    assert_eq!(colours(&sink), [mean, mean, RED, GREEN]);
}
