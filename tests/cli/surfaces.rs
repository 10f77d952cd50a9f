//! Smooth surfaces in both structures: what each command says of the same cages.

use super::{fails, json, names, outcrop};
use serde_json::Value;
use std::fs;
use std::path::Path;

const LEVEL: &str = "4";
/// Of the six faces of a cube.
const TRIANGLES: u64 = 6 * 2 * 4u64.pow(4);
const STRUCTURES: [&str; 2] = ["bvh", "patch"];

/// A cube around (x, 0, 0) from -1 to 1 whose faces are, in order, at -z, +z, -y, +x, +y and -x.
fn cube(name: &str, x: f64) -> String {
    let at = |z: i32| [(-1, -1), (1, -1), (1, 1), (-1, 1)].map(|(a, y)| format!("v {} {y} {z}\n", x + f64::from(a)));
    let faces = ["1 4 3 2", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"].map(|face| format!("f {face}\n"));
    format!("o {name}\n{}{}{}", at(-1).concat(), at(1).concat(), faces.concat())
}

/// Builds `bvh.oc` and `patch.oc` of the files. Returns what the command said of each.
fn build(dir: &Path, files: &[&str], options: &[&str]) -> [Value; 2] {
    STRUCTURES.map(|structure| {
        let out = format!("{structure}.oc");
        json(dir, &[&["build", "--subdivide", "--structure", structure, "-o", &out][..], files, options].concat())
    })
}

/// What a command says of both models. The name of the model takes the place of `MODEL`.
fn of_both(dir: &Path, args: &[&str]) -> [Value; 2] {
    STRUCTURES.map(|structure| {
        let named: Vec<String> = args.iter().map(|arg| arg.replace("MODEL", structure)).collect();
        json(dir, &named.iter().map(String::as_str).collect::<Vec<_>>())
    })
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn numbers(list: &Value, key: &str) -> Vec<f64> {
    list.as_array().unwrap().iter().map(|one| number(&one[key])).collect()
}

fn ids(list: &Value, key: &str) -> Vec<u64> {
    list.as_array().unwrap().iter().map(|one| one[key].as_u64().unwrap()).collect()
}

fn sides(list: &Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|one| one["side"].as_str().unwrap()).collect()
}

fn near(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * (1.0 + a.abs()))
}

#[test]
fn cages_are_built_described_and_checked() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    fs::write(dir.join("cube.obj"), cube("ball", 0.0)).unwrap();
    let built = build(dir, &["cube.obj"], &["--level", LEVEL]);
    let info = of_both(dir, &["info", "MODEL.oc", "--parts"]);
    let checked = of_both(dir, &["check", "MODEL.oc"]);
    for (i, structure) in STRUCTURES.into_iter().enumerate() {
        let (built, info, checked) = (&built[i], &info[i], &checked[i]);
        assert_eq!((info["structure"].as_str(), info["has_normals"].as_bool()), (Some(structure), Some(true)));
        for count in [&built["triangles_in"], &built["triangles_kept"], &info["triangles"], &checked["triangles"]] {
            assert_eq!(count, TRIANGLES, "{structure}: {built} {info} {checked}");
        }
        for key in ["trees", "instances", "nodes", "leaves", "blocks", "references", "bytes", "bytes_trace"] {
            assert_eq!(built[key], info[key], "{structure}, {key}");
        }
        assert_eq!(built["dropped"], serde_json::json!({ "non_finite": 0, "degenerate": 0, "out_of_range": 0 }));
        assert_eq!(info["bytes"], fs::metadata(dir.join(format!("{structure}.oc"))).unwrap().len());
        assert_eq!(info["part_list"][0]["name"], "ball");
        let part = &info["part_list"][0];
        assert_eq!(
            (&part["triangles"], &part["closed"], &part["oriented"]),
            (&TRIANGLES.into(), &true.into(), &true.into())
        );
        assert_eq!((checked["ok"].as_bool(), &checked["bytes"]), (Some(true), &info["bytes"]));
        let text = String::from_utf8(outcrop(dir, &["info", &format!("{structure}.oc")]).stdout).unwrap();
        assert!(text.starts_with(&format!("{structure}.oc: {structure}, ")), "{text}");
    }
    let bounds =
        |i: usize, end: &str| info[i]["bounds"][end].as_array().unwrap().iter().map(number).collect::<Vec<f64>>();
    assert!(["min", "max"].iter().all(|end| near(&bounds(0, end), &bounds(1, end))), "{info:?}");

    // With facets the grid of a face costs little more than its vertices, with boxes much less.
    let mut sizes = Vec::new();
    for (leaves, flat, bytes) in [("facets", "40", 6.0..10.0), ("boxes", "40", 1.0..5.0), ("boxes", "5", 1.0..6.0)] {
        let fine = ["build", "cube.obj", "--subdivide", "--structure", "patch", "--level", "6", "-o", "fine.oc"];
        let fine = json(dir, &[&fine[..], &["--leaves", leaves, "--flat", flat]].concat());
        let each = number(&fine["bytes_trace"]) / number(&fine["triangles_kept"]);
        assert!(bytes.contains(&each), "{leaves}: {each} bytes for each triangle");
        sizes.push(each);
    }
    // Flatter squares are more.
    assert!(sizes[2] > sizes[1], "{sizes:?}");

    // Neighbours of different levels meet in triangles: none is dropped, and errors include the tolerance.
    let both = build(dir, &["cube.obj"], &["--tolerance", "0.01"]);
    assert_eq!(both[0]["triangles_kept"], both[1]["triangles_kept"]);
    for said in &both {
        assert_eq!(
            (&said["triangles_in"], &said["dropped"]["degenerate"]),
            (&said["triangles_kept"], &0.into()),
            "{said}"
        );
    }
    let errors = both.each_ref().map(|said| number(&said["position_error"]));
    assert!(errors[0] < 1e-6 && errors[1] > 0.01 && errors[1] < 0.0101, "{errors:?}");
    build(dir, &["cube.obj"], &["--level", LEVEL]);

    // The same file at any number of threads.
    json(
        dir,
        &["build", "cube.obj", "--subdivide", "--structure", "patch", "--level", LEVEL, "--threads", "1", "-o", "1.oc"],
    );
    assert!(fs::read(dir.join("1.oc")).unwrap() == fs::read(dir.join("patch.oc")).unwrap());
    let most = (TRIANGLES - 1).to_string();
    let limited =
        ["build", "cube.obj", "--subdivide", "--structure", "patch", "--level", LEVEL, "--max-triangles", &most];
    fails(dir, &[&limited[..], &["-o", "no.oc"]].concat(), 1, "max_triangles");
    fails(dir, &["build", "cube.obj", "--structure", "grid", "-o", "no.oc"], 2, "patch");
    assert!(!names(dir).contains(&"no.oc".to_string()));
}

/// Two cages and their parts: rays, points, clashes and exports.
#[test]
fn queries_find_the_same_in_both_structures() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    fs::write(dir.join("a.obj"), cube("a", 0.0)).unwrap();
    fs::write(dir.join("b.obj"), cube("b", 3.0)).unwrap();
    build(dir, &["a.obj", "b.obj"], &["--level", "3"]);

    let ray = ["--ray", "-5", "0.1", "0.2", "1", "0", "0"];
    let met = of_both(dir, &[&["crossings", "MODEL.oc"][..], &ray].concat());
    let [flat, faces] = met.each_ref().map(|met| &met["crossings"]);
    assert!(near(&numbers(flat, "t"), &numbers(faces, "t")), "{met:?}");
    assert_eq!(sides(faces), ["front", "back", "front", "back"]);
    // Of each cube the ray meets the faces at -x and +x. Those of the second come after those of the first.
    assert_eq!((ids(faces, "prim"), ids(faces, "part")), (vec![5, 3, 11, 9], vec![0, 0, 1, 1]));
    let text = |model| String::from_utf8(outcrop(dir, &[&["crossings", model][..], &ray].concat()).stdout).unwrap();
    assert!(text("bvh.oc").contains("\"b\"\ttriangle ") && text("patch.oc").contains("\"b\"\tprimitive 11\n"));
    let inside = of_both(dir, &["crossings", "MODEL.oc", "--ray", "3.1", "0", "0.2", "0.3", "1", "0.2"]);
    assert_eq!(inside[0]["inside"], inside[1]["inside"]);
    assert_eq!((&inside[1]["inside"][0]["name"], &inside[1]["inside"][0]["winding"]), (&"b".into(), &1.into()));

    let points = ["--point", "4.5", "0.3", "0.1", "--point", "0.1", "0.2", "0.3", "--inside"];
    let nearest = of_both(dir, &[&["nearest", "MODEL.oc"][..], &points].concat());
    let [flat, faces] = nearest.each_ref().map(|found| &found["points"]);
    assert!(near(&numbers(flat, "distance"), &numbers(faces, "distance")), "{nearest:?}");
    assert_eq!((ids(faces, "part"), ids(faces, "triangle")[0]), (vec![1, 0], 9));
    let places = |list: &Value| ["outside", "inside"].map(|place| ids_at(list, place));
    assert_eq!(places(faces), [vec![0], vec![1]]);
    let apart = of_both(dir, &["nearest", "MODEL.oc", "--from", "0", "--to", "1"]);
    let between = apart.each_ref().map(|found| number(&found["distance"]));
    assert!(near(&between[..1], &between[1..]) && (between[1] - (3.0 - 2.0 * 0.8395061492919922)).abs() < 1e-6);

    // All triangles are read back, though those of a face have one id.
    for structure in STRUCTURES {
        let out = format!("{structure}.ply");
        let said = json(dir, &["export", &format!("{structure}.oc"), "-o", &out]);
        assert_eq!((&said["parts"], &said["triangles"]), (&2.into(), &(2 * TRIANGLES / 4).into()), "{structure}");
        let one = json(dir, &["export", &format!("{structure}.oc"), "--part", "1", "-o", "one.ply"]);
        assert_eq!(one["triangles"], TRIANGLES / 4, "{structure}");
        let again = json(dir, &["build", &out, "-o", "again.oc"]);
        assert_eq!(again["triangles_kept"], 2 * TRIANGLES / 4, "{structure}");
    }

    // A ball that reaches into the first: the same pairs of triangles.
    fs::write(dir.join("c.obj"), cube("c", -1.2)).unwrap();
    json(dir, &["build", "c.obj", "--subdivide", "--structure", "patch", "--level", "3", "-o", "c.oc"]);
    let clashes = of_both(dir, &["clash", "MODEL.oc", "c.oc"]);
    let of_parts = clashes.each_ref().map(|found| &found["clashes"][0]);
    assert_eq!((&of_parts[0]["kind"], &of_parts[0]["count"]), (&of_parts[1]["kind"], &of_parts[1]["count"]));
    let pairs = of_both(dir, &["clash", "MODEL.oc", "c.oc", "--triangles"]);
    let counts = pairs.each_ref().map(|found| found["clashes"].as_array().unwrap().len());
    assert!(counts[0] == counts[1] && counts[1] > 50, "{counts:?} pairs of triangles");
}

/// The indices of the points that are at this place.
fn ids_at(list: &Value, place: &str) -> Vec<usize> {
    let all = list.as_array().unwrap().iter().enumerate();
    all.filter(|(_, one)| one["inside"] == place).map(|(i, _)| i).collect()
}

/// An arch of one face: a ray meets both of its legs.
#[test]
fn a_ray_meets_a_face_more_than_once() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // A patch whose control points go up along x and down again: an arch of one face.
    let points: Vec<String> = (0..4)
        .flat_map(|i| {
            [(0.0, 0.0), (0.0, 4.0), (3.0, 4.0), (3.0, 0.0)].map(|(x, z)| format!("{x} {} {z}\n", f64::from(i)))
        })
        .collect();
    fs::write(dir.join("arch.bpt"), format!("1\n3 3\n{}", points.concat())).unwrap();
    build(dir, &["arch.bpt"], &["--level", "4"]);
    let met = of_both(dir, &["crossings", "MODEL.oc", "--ray", "-2", "1.2", "1.1", "1", "0.1", "0"]);
    let [flat, faces] = met.each_ref().map(|met| numbers(&met["crossings"], "t"));
    assert!(flat.len() == 2 && near(&flat, &faces), "{met:?}");
    assert_eq!(ids(&met[1]["crossings"], "prim"), [0, 0]);
    let sides = sides(&met[1]["crossings"]);
    assert_ne!(sides[0], sides[1]);
}

#[test]
fn pictures_of_both_structures_are_alike() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    fs::write(dir.join("cube.obj"), cube("ball", 0.0)).unwrap();
    build(dir, &["cube.obj"], &["--level", LEVEL]);
    let render = ["render", "MODEL.oc", "-o", "MODEL.png", "--size", "64x48", "--samples", "1"];
    let exact = of_both(dir, &[&render[..], &["--occurrence", "32,24"]].concat());
    for said in &exact {
        assert_eq!(
            (said["state"].as_str(), &said["pixels"]["exact"]),
            (Some("converged"), &(64 * 48).into()),
            "{said}"
        );
    }
    let [flat, faces] = exact.each_ref().map(|said| &said["occurrence"]);
    assert_eq!((&faces["name"], &faces["kind"]), (&"ball".into(), &"exact".into()));
    let place = |shown: &Value| shown["position"].as_array().unwrap().iter().map(number).collect::<Vec<f64>>();
    assert!(near(&place(flat), &place(faces)), "{flat} {faces}");
    // It looks at the side of -y.
    assert_eq!((&faces["prim"], place(faces)[1] < -0.5), (&2.into(), true));
    let [a, b] = STRUCTURES.map(|name| image::open(dir.join(format!("{name}.png"))).unwrap().into_rgb8());
    let apart = |(p, q): (&u8, &u8)| p.abs_diff(*q);
    let other = a.as_raw().iter().zip(b.as_raw().iter()).filter(|pair| apart((pair.0, pair.1)) > 3).count();
    assert!(other * 100 < a.as_raw().len(), "{other} values differ");
    let colours: std::collections::HashSet<_> = b.pixels().collect();
    assert!(colours.len() > 50, "{} colours", colours.len());

    // Stand-ins take the place of geometry.
    let coarse =
        json(dir, &["render", "patch.oc", "-o", "coarse.png", "--size", "64x48", "--samples", "1", "--poe", "12"]);
    assert!(coarse["pixels"]["lod"].as_u64().unwrap() > 100 && coarse["pixels"]["missing"] == 0, "{coarse}");
    let bench = json(dir, &["bench", "patch.oc", "--size", "32x24", "--runs", "1", "--view", "0", "--threads", "1"]);
    assert!(number(&bench["results"][0]["hits"]) > 0.1, "{bench}");
}
