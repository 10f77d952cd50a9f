//! Both formats and their faults.

use super::{SurfaceData, bpt, trimmed_nurbs};
use crate::base::progress::Cancel;
use crate::geom::surface::nurbs::Nurbs;
use crate::geom::surface::nurbs::tests::rng::Rng;
use glam::DVec3;
use std::path::Path;

fn patches(text: &str) -> Result<Vec<SurfaceData>, String> {
    bpt::parse(text.as_bytes(), Path::new("a.bpt"), &Cancel::new()).map_err(|e| e.to_string())
}

fn faces(text: &str) -> Result<trimmed_nurbs::Faces, String> {
    trimmed_nurbs::parse(text.as_bytes(), Path::new("a.json"), &Cancel::new()).map_err(|e| e.to_string())
}

#[test]
fn a_text_of_patches_is_read() {
    let text = "2\n1 2\n0 0 0\n0 1 0\n0 2 0\n1 0 0\n1 1 1\n1 2 0\n1 1\n0 0 0 0 1 0\r\n1 0 0 1 1e0 .5\n\n";
    let read = patches(text).expect("two patches");
    assert_eq!((read[0].degree, read[0].counts, read[1].face), ([1, 2], [2, 3], 1));
    assert_eq!(read[0].points[4], DVec3::ONE);
    let surface = Nurbs::new(&read[0].desc()).expect("a surface");
    assert_eq!(surface.evaluate(1.0, 0.5).position, DVec3::new(1.0, 1.0, 0.5));
}

#[test]
fn faults_of_patches_name_line_and_patch() {
    for (text, expected) in [
        ("", "line 1: the number of patches is missing"),
        ("-1", "line 1: the number of patches is \"-1\""),
        ("99999999999999\n1 1\n", "line 2: patch 0: point 0 is missing"),
        ("1\n0 1\n", "line 2: patch 0: its degree along u is \"0\""),
        ("1\n1 33\n", "line 2: patch 0: its degree along v is \"33\""),
        ("1\n1 1\n0 0 0\n0 x 0", "line 4: patch 0: point 1: \"x\" is not a number"),
        ("1\n1 1\n0 0 0\n0 nan 0", "line 4: patch 0: point 1 is not finite"),
        ("1\n1 1\n0 0 0 0 0 0\n0 0 0 0 0 0\n5", "line 5: \"5\" follows the last patch"),
    ] {
        let why = patches(text).expect_err("a fault");
        assert!(why.contains(expected), "{why}: {expected}");
    }
}

/// A plane over [0, 2] × [0, 1] with the knot 1 in u.
fn plane(more: &str) -> String {
    let points = "\"cp\":[[[0,0,0],[0,1,0]],[[1,0,0],[1,1,0]],[[2,0,0],[2,1,0]]]";
    format!("{{\"degree_u\":1,\"degree_v\":1,\"knots_u\":[0,0,1,2,2],\"knots_v\":[0,0,1,1],{points}{more}}}")
}

fn file(faces: &[String]) -> String {
    format!("{{\"note\":{{\"a\":[1]}},\"faces\":[{}],\"face_count\":7}}", faces.join(","))
}

fn looped(corners: &str) -> String {
    let corners: Vec<_> = corners.split(' ').collect();
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let curves: Vec<_> = sides.map(|(a, b)| format!("{{\"degree\":1,\"cp\":[[{a}],[{b}]]}}")).collect();
    format!("{{\"outer\":true,\"curves\":[{}]}}", curves.join(","))
}

#[test]
fn faces_are_whole_parts_or_trimmed() {
    let with = |loops: &[&str]| {
        plane(&format!(",\"loops\":[{}]", loops.iter().map(|l| looped(l)).collect::<Vec<_>>().join(",")))
    };
    let text = file(&[
        plane(""),
        with(&["0,0 2,0 2,1 0,1"]),
        with(&["0,0 0,0.5 1.0000000001,0.5 1.0000000001,0"]),
        with(&["0,0 2,0 1,1"]),
        with(&["0,0 2,0 2,1 0,1", "0.1,0.1 0.2,0.1 0.2,0.2"]),
        with(&["0,0 3,0 3,1 0,1"]),
        with(&["0,0 2,0 2,1 1,1 1,0.5 0,0.5"]),
        with(&["0,0 0,0"]),
        with(&["0,0 2,0 2,1 2,0"]),
        plane(",\"reversed\":true,\"uv_bounds\":null"),
    ]);
    let read = faces(&text).expect("faces");
    let domains: Vec<_> = read.surfaces.iter().map(|s| (s.face, s.domain, s.is_reversed)).collect();
    let whole = [[0.0, 2.0], [0.0, 1.0]];
    let part = [[0.0, 1.0], [0.0, 0.5]];
    assert_eq!(domains, [(0, whole, false), (1, whole, false), (2, part, false), (9, whole, true)]);
    assert_eq!(read.trimmed, [3, 4, 5, 6, 7, 8]);
}

#[test]
fn faults_of_faces_name_line_and_face() {
    let good = plane("");
    let bad = |from: &str, to: &str| file(&[good.clone(), good.replacen(from, to, 1)]);
    for (text, expected) in [
        ("[]".to_owned(), "an object"),
        ("{}".to_owned(), "has no \"faces\""),
        (
            file(std::slice::from_ref(&good)).replace("],\"face_c", ",{},\"face_c"),
            "line 1: face 1: has no \"degree_u\"",
        ),
        (bad("\"degree_u\":1", "\"degree_u\":-1"), "line 1: face 1: "),
        (bad("\"degree_u\":1", "\"degree_u\":0"), "face 1: bad argument: surface: degree: 0"),
        (bad("0,0,1,2,2", "0,0,3,2,2"), "face 1: bad argument: surface: knots_u: knot 3 is less than knot 2"),
        (bad("[0,0,1,2,2]", "7"), "face 1: invalid type"),
        (bad("[1,1,0]]", "[1,1,0],[1,2,0]]"), "face 1: row 1 of \"cp\" has 3 points, not 2 as the first"),
        (bad("[1,1,0]", "[1,1,0,1]"), "face 1: point 3 of \"cp\" has 4 numbers"),
        (bad("[1,1,0]", "[1,1]"), "face 1: point 3 of \"cp\" has 2 numbers"),
        (bad("[1,1,0]", "[1,1,1e999]"), "face 1: number out of range"),
        (bad("[0,0,0]", "[0,0,1e31]"), "face 1: bad argument: surface: points: point 0"),
        (file(std::slice::from_ref(&good)).replace("\"face_count\":7}", ""), "line 1: "),
    ] {
        let why = faces(&text).expect_err("a fault");
        assert!(why.contains(expected), "{why}: {expected}");
    }
}

#[test]
fn every_beginning_of_a_text_is_refused_or_read() {
    let text = file(&[plane(""), plane(",\"loops\":[]")]);
    let read = (0..text.len()).filter(|&end| faces(&text[..end]).is_ok()).count();
    assert_eq!(read, 0);
    let deep = format!("{{\"x\":{}", "[".repeat(100_000));
    assert!(faces(&deep).is_err());
}

#[test]
fn a_cancelled_read_ends() {
    let cancel = Cancel::new();
    cancel.cancel();
    let text = file(&[plane("")]);
    let e = trimmed_nurbs::parse(text.as_bytes(), Path::new("a"), &cancel).expect_err("cancelled");
    assert!(matches!(e, crate::Error::Cancelled), "{e}");
}

#[test]
fn damaged_texts_never_panic() {
    let mut rng = Rng::new(31);
    let loops = format!(",\"loops\":[{}]", looped("0,0 2,0 2,1 0,1"));
    let json = file(&[plane(""), plane(&loops)]).into_bytes();
    let patch = b"2\n1 2\n0 0 0\n0 1 0\n0 2 0\n1 0 0\n1 1 1\n1 2 0\n1 1\n0 0 0 0 1 0\n1 0 0 1 1e0 .5\n".to_vec();
    let (mut read, cancel) = (0, Cancel::new());
    for round in 0..20_000 {
        let mut text = if round % 2 == 0 { json.clone() } else { patch.clone() };
        for _ in 0..1 + rng.below(3) {
            let at = rng.below(text.len());
            text[at] = b"0123456789.-e,[]{}\" \n"[rng.below(21)];
        }
        let is_read = match round % 2 {
            0 => trimmed_nurbs::parse(&text, Path::new("a"), &cancel).is_ok(),
            _ => bpt::parse(&text, Path::new("a"), &cancel).is_ok(),
        };
        read += usize::from(is_read);
    }
    assert!((500..19_500).contains(&read), "{read}");
}
