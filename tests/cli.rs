//! The command line `outcrop`, driven as a user would.
#![cfg(feature = "cli")]

#[path = "cli/forest.rs"]
mod forest;
#[path = "cli/outputs.rs"]
mod outputs;
#[path = "cli/scenes.rs"]
mod scenes;
#[path = "cli/surfaces.rs"]
mod surfaces;

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn outcrop(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outcrop")).current_dir(dir).args(args).output().unwrap()
}

/// What a verb prints with `--json`: one object and nothing else.
fn json(dir: &Path, args: &[&str]) -> Value {
    let out = outcrop(dir, &[args, &["--json"]].concat());
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{args:?}: {stderr}");
    let text = String::from_utf8(out.stdout).unwrap();
    assert_eq!(text.lines().count(), 1, "{text}");
    let value: Value = serde_json::from_str(&text).unwrap();
    assert!(value.is_object());
    value
}

/// Fails with this exit code, says why on stderr, and nothing on stdout.
fn fails(dir: &Path, args: &[&str], code: i32, why: &str) {
    let out = outcrop(dir, args);
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(code), "{args:?}: {stderr}");
    assert!(stderr.contains(why), "{args:?}: {stderr}");
    assert!(out.stdout.is_empty());
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn from_generator_to_picture() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let made = json(dir, &["generate", "airliner", "--triangles", "150K", "-o", "a.ply"]);
    let triangles = made["triangles"].as_u64().unwrap();
    assert!((147_000..153_000).contains(&triangles));

    let built = json(dir, &["build", "a.ply", "-o", "a.oc", "--memory", "1G", "--threads", "2"]);
    assert_eq!(built["triangles_in"], triangles);
    assert_eq!(built["parts"], made["parts"]);

    let info = json(dir, &["info", "a.oc", "--parts"]);
    assert_eq!(info["triangles"], built["triangles_kept"]);
    assert_eq!((info["up"].as_str(), info["metres_per_unit"].as_f64()), (Some("z"), Some(1.0)));
    assert_eq!(info["part_list"][0]["name"], "airliner");
    let length = std::fs::metadata(dir.join("a.oc")).unwrap().len();
    assert_eq!(info["bytes"], length);

    assert_eq!(json(dir, &["check", "a.oc"])["ok"], true);

    let args = ["render", "a.oc", "-o", "a.png", "--size", "160x120", "--views", "airliner", "--samples", "1"];
    let picture = json(dir, &args);
    assert_eq!(picture["pixels"]["exact"], 160 * 120);
    let image = image::open(dir.join("a.png")).unwrap().into_rgb8();
    assert_eq!(image.dimensions(), (160, 120));
    let colours: std::collections::HashSet<_> = image.pixels().collect();
    assert!(colours.len() > 100, "{} colours", colours.len());

    let bench = json(dir, &["bench", "a.oc", "--size", "64x48", "--runs", "1", "--view", "0", "--threads", "1"]);
    let rows = bench["results"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    assert!(rows.iter().all(|r| r["hits"].as_u64().unwrap() > 0 && r["mrays_single"].as_f64().unwrap() > 0.0));

    let args = [
        "bench",
        "a.oc",
        "--size",
        "64x48",
        "--runs",
        "1",
        "--view",
        "0",
        "--threads",
        "1",
        "--poe",
        "0,1,10",
        "--cache",
        "64M",
    ];
    let bench = json(dir, &args);
    let rows = bench["results"].as_array().unwrap();
    let member = |i: usize, name: &str| rows[i][name].as_f64().unwrap();
    assert_eq!(rows.len(), 3);
    assert_eq!((member(0, "lod"), member(0, "mean_error_px"), member(0, "border")), (0.0, 0.0, 0.0));
    assert!(member(1, "lod") > 0.1 && member(2, "lod") >= member(1, "lod"), "{bench}");
    assert!(member(1, "mean_error_px") > 0.0 && member(2, "mean_error_px") > member(1, "mean_error_px"), "{bench}");
    assert!((0..3).all(|i| member(i, "p999_error_px") >= member(i, "mean_error_px") && member(i, "mrays") > 0.0));
    assert!(member(0, "bytes_working_set") >= member(2, "bytes_working_set") && member(2, "bytes_working_set") > 0.0);

    assert_eq!(names(dir), ["a.oc", "a.ply", "a.png"]);
}

/// A model larger than its memory: the first picture, the best that fits, and what is asked for and does not.
#[test]
fn pictures_in_a_small_cache() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    json(dir, &["generate", "mandelbulb", "--triangles", "1M", "-o", "b.ply"]);
    json(dir, &["build", "b.ply", "-o", "b.oc"]);
    let render = ["render", "b.oc", "-o", "b.png", "--size", "320x240", "--samples", "1", "--cache", "12MB"];
    let with = |more: &[&str]| json(dir, &[&render, more].concat());
    let first = with(&["--until", "first"]);
    let share = |picture: &Value, name: &str| {
        picture["pixels"][name].as_f64().unwrap() / picture["pixels"]["total"].as_f64().unwrap()
    };
    assert!(first["pictures"].as_u64().unwrap() >= 1);
    let count = |name: &str| first["pixels"][name].as_u64().unwrap();
    assert_eq!(count("exact") + count("lod") + count("missing"), count("total"), "{first}");
    let whole = with(&["--until", "complete"]);
    assert_eq!((whole["state"].as_str(), share(&whole, "exact")), (Some("converged"), 1.0), "{whole}");
    assert!(whole["bytes_resident"].as_u64().unwrap() <= 12 << 20, "{whole}");
    let best = with(&["--until", "complete", "--at-once"]);
    assert_eq!(best["state"], "complete_within_budget");
    assert!(
        best["effective_poe"].as_f64().unwrap() > 0.0 && best["bytes_resident"].as_u64().unwrap() <= 12 << 20,
        "{best}"
    );
    // The first may be finer where it has what it needs; what fits is fine everywhere.
    assert!(share(&best, "missing") == 0.0 && best["worst_error_px"].as_f64().unwrap() < 16.0, "{first} {best}");
    let coarse = with(&["--until", "converged", "--poe", "30"]);
    assert_eq!((coarse["state"].as_str(), coarse["effective_poe"].as_f64()), (Some("converged"), Some(30.0)));
    assert_eq!((coarse["bytes_wanted"].as_u64(), coarse["fraction"].as_f64()), (Some(0), Some(1.0)));
    let soon = with(&["--until", "0.05"]);
    assert!(soon["seconds"]["first"].as_f64().unwrap() <= soon["seconds"]["render"].as_f64().unwrap() + 0.05, "{soon}");
    std::fs::remove_file(dir.join("b.png")).unwrap();
    fails(dir, &[&render[..], &["--until", "converged", "--at-once"]].concat(), 1, "does not converge");
    let short = outcrop(dir, &[&render[..], &["--until", "converged", "--at-once", "--json"]].concat());
    let said: Value = serde_json::from_slice(&short.stdout).unwrap();
    assert_eq!((short.status.code(), &said["state"], &said["file"]), (Some(1), &best["state"], &Value::Null));
    let stderr = String::from_utf8_lossy(&short.stderr);
    assert!(stderr.contains("pixels of error") && !stderr.contains(" 0 B "), "{stderr}");
    fails(dir, &[&render[..], &["--poe=-1"]].concat(), 2, "poe");
    fails(dir, &[&render[..], &["--poe", "-1"]].concat(), 2, "0 or more");
    fails(dir, &[&render[..], &["--poe", "nan"]].concat(), 2, "poe");
    fails(dir, &[&render[..], &["--until", "soon"]].concat(), 2, "seconds");
    fails(dir, &["bench", "b.oc", "--poe", "0,-1"], 2, "0 or more");
    fails(dir, &["render", "b.oc", "-o", "b.png", "--cache", "1000T"], 2, "more than");
    fails(dir, &["render", "b.oc", "-o", "b.png", "--cache", "1M"], 1, "at least");
    assert_eq!(names(dir), ["b.oc", "b.ply"]);
}

#[test]
fn proxies_are_built_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    json(dir, &["generate", "mandelbulb", "--triangles", "2K", "-o", "b.ply"]);
    let build = |args: &[&str]| json(dir, &[&["build", "b.ply", "-o", "b.oc"], args].concat());
    let with = ["--stand-ins", "proxies", "--proxy-rays", "16", "--proxy-triangles", "200"];
    for (args, has_some) in [(&[][..], false), (&["--stand-ins", "voxels"], false), (&with, true)] {
        let (built, info) = (build(args), json(dir, &["info", "b.oc"]));
        assert_eq!(built["proxies"].as_u64().unwrap() > 0, has_some, "{args:?}");
        assert_eq!([&built["proxies"], &built["bytes_proxies"]], [&info["proxies"], &info["bytes_proxies"]]);
    }
    for args in [["--proxy-rays", "0"], ["--proxy-rays", "2000000"], ["--stand-ins", "boxes"]] {
        fails(dir, &[&["build", "b.ply", "-o", "b.oc"][..], &args].concat(), 2, args[0]);
    }
}

#[test]
fn two_files_make_one_model_and_cameras_are_free() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("1.obj"), "o floor\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
    std::fs::write(dir.join("2.obj"), "o roof\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\n").unwrap();
    let built = json(dir, &["build", "1.obj", "2.obj", "-o", "m.oc", "--up", "z", "--unit", "0.001", "--splits", "on"]);
    assert_eq!(built["triangles_kept"], 3);
    for camera in [
        &["--eye", "-1,-2,3", "--at", "0.5,0.5,0", "--fov", "30"][..],
        &["--eye", "0.5,0.5,5", "--at", "0.5,0.5,0", "--up", "0,1,0", "--ortho", "2"],
        &["--view", "1", "--up", "y"],
        &["--view", "3", "--light", "sun:1,1,-1*0.7", "--light", "point:0,0,4*9", "--no-shadows"],
        &["--view", "front", "--exposure", "2", "--exact-colours"],
        &["--view", "top", "--ortho", "fit"],
    ] {
        let picture = json(dir, &[&["render", "m.oc", "-o", "m.png", "--size", "32x32"], camera].concat());
        assert_eq!(picture["pixels"]["total"], 1024);
    }
    // A square of side 1 from above, and from above without the roof: it touches the margin of a twentieth.
    let high = |args: &[&str]| {
        let fixed = ["render", "m.oc", "-o", "m.png", "--size", "100x100", "--samples", "1", "--view", "top"];
        let pixels = json(dir, &[&fixed[..], args].concat())["pixels"].clone();
        assert_eq!(pixels["total"], 10_000);
        let picture = image::open(dir.join("m.png")).unwrap().into_rgba8();
        let background = *picture.get_pixel(0, 50);
        (0..100)
            .filter(|&x| picture.get_pixel(x, 50).0.iter().zip(background.0).any(|(a, b)| a.abs_diff(b) > 8))
            .count()
    };
    assert_eq!(high(&["--ortho", "fit"]), 90);
    assert_eq!(high(&["--ortho", "fit", "--only", "0"]), 90);
    assert_eq!(high(&["--ortho", "2"]), 50);
    fails(dir, &["render", "m.oc", "-o", "m.png", "--view", "2", "--ortho", "fit"], 2, "--ortho fit");
    fails(dir, &["render", "m.oc", "-o", "m.png", "--view", "above"], 2, "iso-front-left");
    fails(dir, &["render", "m.oc", "-o", "m.png", "--exposure", "-1"], 2, "exposure");
    let up = |axis: &str| json(dir, &["render", "m.oc", "-o", "m.png", "--size", "8x8", "--up", axis])["up"].clone();
    assert_eq!((up("y"), up("z")), (serde_json::json!([0.0, 1.0, 0.0]), serde_json::json!([0.0, 0.0, 1.0])));
    let text = String::from_utf8(outcrop(dir, &["info", "m.oc"]).stdout).unwrap();
    assert!(text.contains("3 triangles of 3") && text.contains("1 block of") && text.contains("up z"), "{text}");
    // Each of two ways to say where the camera is, and a direction that has no eye.
    for both in [&["--view", "1"][..], &["--views", "airliner"]] {
        let eye = ["render", "m.oc", "-o", "m.png", "--eye", "1,2,3", "--at", "0,0,0"];
        fails(dir, &[&eye, both].concat(), 2, "cannot be used with");
    }
    fails(dir, &["render", "m.oc", "-o", "m.png", "--up", "0,1,0"], 2, "--eye");
}

/// A pipe through a wall, a box that touches the wall, a box near it, and a box in a box; as text, JSON and CSV.
#[test]
fn clashes_are_listed_and_compared_with_earlier_ones() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let write = |pipe: f64| {
        let boxes = [
            ("wall", [0.0, 0.0, 0.0, 1.0, 10.0, 10.0]),
            ("pipe", [-2.0, pipe, 4.0, 3.0, pipe + 1.0, 5.0]),
            ("shelf", [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]),
            ("lamp", [1.25, 8.0, 8.0, 2.0, 9.0, 9.0]),
            ("core", [0.25, 0.5, 0.5, 0.75, 0.75, 0.75]),
        ];
        let mut obj = String::new();
        for (i, (name, b)) in boxes.iter().enumerate() {
            obj += &format!("o {name}\n");
            for k in 0..8 {
                obj += &format!("v {} {} {}\n", b[3 * (k & 1)], b[1 + 3 * (k >> 1 & 1)], b[2 + 3 * (k >> 2)]);
            }
            for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
                let f = face.map(|v: usize| 8 * i + v + 1);
                obj += &format!("f {} {} {} {}\n", f[0], f[1], f[2], f[3]);
            }
        }
        std::fs::write(dir.join("m.obj"), obj).unwrap();
        json(dir, &["build", "m.obj", "-o", "m.oc"])
    };
    write(4.0);
    let list = |args: &[&'static str]| {
        let all = json(dir, &[&["clash", "m.oc"][..], args].concat());
        let clashes = all["clashes"].as_array().unwrap().clone();
        let name = |c: &serde_json::Value, side: &str| c[side]["name"].as_str().unwrap().to_string();
        let each =
            |c: &serde_json::Value| (c["kind"].as_str().unwrap().to_string(), name(c, "first"), name(c, "second"));
        (clashes.iter().map(each).collect::<Vec<_>>(), all)
    };
    let of = |all: &[(&str, &str)]| -> Vec<_> {
        all.iter().map(|(kind, other)| (kind.to_string(), "wall".to_string(), other.to_string())).collect()
    };
    let met = [("crossing", "pipe"), ("coplanar", "shelf"), ("contained", "core")];
    assert_eq!(list(&[]).0, of(&met));
    let near = [met[0], met[1], ("clearance", "lamp"), met[2]];
    let (found, all) = list(&["--clearance", "0.25", "--csv", "m.csv"]);
    assert_eq!(found, of(&near));
    assert_eq!((&all["clashes"][2]["distance"], &all["pairs"]), (&serde_json::json!(0.25), &serde_json::json!(4)));
    let table = std::fs::read_to_string(dir.join("m.csv")).unwrap();
    assert!(table.lines().count() == 5 && table.contains(",clearance,") && table.contains("\"lamp\""), "{table}");
    // The pipe has gone elsewhere.
    std::fs::write(dir.join("old.json"), all.to_string()).unwrap();
    write(20.0);
    let (found, all) = list(&["--clearance", "0.25", "--against", "old.json"]);
    assert_eq!(found, of(&near[1..]));
    assert!(all["clashes"].as_array().unwrap().iter().all(|c| c["status"] == "remaining") && all["gone"] == 1);
    let part = |c: &serde_json::Value| [c["first"]["part"].clone(), c["second"]["part"].clone()];
    let pairs: Vec<_> = all["clashes"].as_array().unwrap().iter().map(part).collect();
    std::fs::write(dir.join("rules.json"), serde_json::json!([pairs[0], pairs[2]]).to_string()).unwrap();
    assert_eq!(list(&["--clearance", "0.25", "--rules", "rules.json"]).0, of(&near[2..3]));
    let text = String::from_utf8(outcrop(dir, &["clash", "m.oc", "m.oc"]).stdout).unwrap();
    assert!(text.ends_with(" of parts\n") && text.contains("coplanar\t"), "{text}");
    let (triangles, _) = list(&["--triangles"]);
    assert!(triangles.iter().filter(|(kind, ..)| kind != "contained").count() > 2, "{triangles:?}");
    // With a tolerance: the pipe is back, and goes through the wall.
    write(4.0);
    let deep = [("piercing", "pipe"), ("touching", "shelf"), ("contained", "core")];
    let (found, all) = list(&["--tolerance", "0.001", "--group", "part"]);
    assert_eq!(found, of(&deep));
    assert!((all["clashes"][0]["depth"].as_f64().unwrap() - 0.5).abs() <= 0.001);
    let groups = |all: &serde_json::Value| -> Vec<(String, usize)> {
        let group =
            |g: &serde_json::Value| (g["name"].as_str().unwrap().into(), g["clashes"].as_array().unwrap().len());
        all["groups"].as_array().unwrap().iter().map(group).collect()
    };
    let named = |all: &[(&str, usize)]| -> Vec<_> { all.iter().map(|(name, n)| (name.to_string(), *n)).collect() };
    assert_eq!(groups(&all), named(&[("wall", 3), ("pipe", 1), ("shelf", 1), ("core", 1)]));
    let (_, all) = list(&["--group", "pair"]);
    assert_eq!(groups(&all), named(&[("wall and pipe", 1), ("wall and shelf", 1), ("wall and core", 1)]));
    // Boxes of 4 and more apart, and near each other by the clearance.
    assert_eq!(groups(&list(&["--group", "near"]).1).len(), 3);
    assert_eq!(groups(&list(&["--group", "near", "--clearance", "4"]).1).len(), 1);
    let text = String::from_utf8(outcrop(dir, &["clash", "m.oc", "--group", "part"]).stdout).unwrap();
    assert!(text.contains("wall: 3 clashes\n  crossing\t") && text.contains("pipe: 1 clash\n"), "{text}");
    fails(dir, &["clash", "m.oc", "--tolerance", "-1"], 2, "0 or more");
    fails(dir, &["clash", "m.oc", "--clearance", "-1"], 2, "0 or more");
    fails(dir, &["clash", "no.oc"], 1, "no.oc");
    fails(dir, &["clash", "m.oc", "--rules", "old.json"], 2, "pairs of part ids");
    fails(dir, &["clash", "m.oc", "--against", "rules.json"], 2, "outcrop clash --json");
}

/// Two boxes and points around them; as text, JSON and CSV.
#[test]
fn nearest_points_and_distances_are_printed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let mut obj = String::new();
    for (i, (name, x)) in [("near", 0.0), ("far", 4.0)].iter().enumerate() {
        obj += &format!("o {name}\n");
        for k in 0..8 {
            obj += &format!("v {} {} {}\n", x + f64::from(k & 1), k >> 1 & 1, k >> 2);
        }
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            let f = face.map(|v: usize| 8 * i + v + 1);
            obj += &format!("f {} {} {} {}\n", f[0], f[1], f[2], f[3]);
        }
    }
    std::fs::write(dir.join("m.obj"), obj).unwrap();
    json(dir, &["build", "m.obj", "-o", "m.oc"]);
    let point = ["nearest", "m.oc", "--point", "-2", "0.25", "0.5"];
    let all = json(dir, &[&point[..], &["--point", "0.5", "0.5", "0.25", "--inside"]].concat());
    let each = |i: usize| {
        let it = &all["points"][i];
        (it["distance"].as_f64().unwrap(), it["name"].as_str().unwrap(), it["inside"].as_str().unwrap())
    };
    assert_eq!([each(0), each(1)], [(2.0, "near", "outside"), (0.25, "near", "inside")]);
    assert_eq!(all["points"][0]["position"], serde_json::json!([0.0, 0.25, 0.5]));
    let [near, far] = [0, 1].map(|i: usize| {
        let at = [["-1", "0.5", "0.5"], ["9", "0.5", "0.5"]][i];
        let all = json(dir, &[&["nearest", "m.oc", "--point"][..], &at].concat());
        all["points"][0]["part"].to_string()
    });
    let all = json(dir, &["nearest", "m.oc", "--from", &near, "--to", &far]);
    assert_eq!((&all["distance"], &all["to"]["name"]), (&serde_json::json!(3.0), &serde_json::json!("far")));
    let all = json(dir, &["nearest", "m.oc", "--from", &near, "--to", &far, "--within", "2.5"]);
    assert!(all["distance"].is_null());
    std::fs::write(dir.join("points.txt"), "-2, 0.25, 0.5\n\n5.5 0.5 0.5\n").unwrap();
    let file = ["nearest", "m.oc", "--points", "points.txt", "--from", &far, "--within", "1", "--csv", "m.csv"];
    let text = String::from_utf8(outcrop(dir, &file).stdout).unwrap();
    assert!(text.lines().count() == 2 && text.contains("nothing within") && text.contains("distance 0.5"), "{text}");
    let table = std::fs::read_to_string(dir.join("m.csv")).unwrap();
    let row = table.lines().nth(2).unwrap();
    assert!(table.lines().count() == 3 && row.starts_with("5.5,0.5,0.5,0.5,") && row.contains("\"far\""), "{table}");
    assert!(table.lines().all(|line| line.split(',').count() == 12), "{table}");
    std::fs::write(dir.join("bad.txt"), "1 2 3\n1 2\n").unwrap();
    fails(dir, &["nearest", "m.oc", "--points", "bad.txt"], 2, "line 2");
    fails(dir, &["nearest", "m.oc"], 2, "--point");
    fails(dir, &[&point[..], &["--within", "-1"]].concat(), 2, "0 or more");
    fails(dir, &[&point[..], &["--from", "99"]].concat(), 2, "part 99");
    fails(dir, &["nearest", "no.oc", "--point", "0", "0", "0"], 1, "no.oc");
}

/// A closed tetrahedron with an open triangle behind it.
#[test]
fn crossings_are_listed_with_the_parts_around_the_start() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let corners = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\nv 9 -9 -9\nv 9 9 0\nv 9 -9 9\n";
    let faces = "o solid\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\no sheet\nf 5 6 7\n";
    std::fs::write(dir.join("m.obj"), format!("{corners}{faces}")).unwrap();
    json(dir, &["build", "m.obj", "-o", "m.oc"]);
    let ray = ["crossings", "m.oc", "--ray", "-1", "0.5", "0.5", "2", "0", "0"];
    let all = json(dir, &ray);
    let crossings = all["crossings"].as_array().unwrap();
    let seen: Vec<_> = crossings
        .iter()
        .map(|c| (c["t"].as_f64().unwrap(), c["side"].as_str().unwrap(), c["name"].as_str().unwrap()))
        .collect();
    assert_eq!(seen, [(0.5, "front", "solid"), (2.0, "back", "solid"), (5.0, seen[2].1, "sheet")]);
    assert_eq!(crossings[0]["normal"], serde_json::json!([-1.0, 0.0, 0.0]));
    assert_eq!(crossings.iter().map(|c| c["prim"].as_u64().unwrap()).collect::<Vec<_>>(), [2, 3, 4]);
    assert_eq!(all["inside"], serde_json::json!([]));
    // From inside, with the words.
    let ray = ["crossings", "m.oc", "--ray", "1", "0.5", "0.5", "-1", "0", "0", "--memory", "64M"];
    let inside = json(dir, &ray)["inside"].clone();
    assert_eq!((&inside[0]["name"], &inside[0]["winding"]), (&serde_json::json!("solid"), &serde_json::json!(1)));
    assert_eq!((&inside[0]["decided"], &inside[1]), (&serde_json::json!(true), &serde_json::Value::Null));
    let text = String::from_utf8(outcrop(dir, &ray).stdout).unwrap();
    let lines: Vec<_> = text.lines().collect();
    assert!(lines.len() == 3 && lines[0].starts_with("starts in part"), "{text}");
    assert!(lines[1].starts_with("1\tback\tpart") && lines[1].ends_with("\"solid\"\ttriangle 2"), "{text}");
    assert_eq!(lines[2], "1 crossing");
    // Past everything.
    let past = json(dir, &["crossings", "m.oc", "--ray", "-1", "50", "0", "1", "0", "0"]);
    assert_eq!(past["crossings"], serde_json::json!([]));
    let numbers = |last: [&'static str; 3]| [&["crossings", "m.oc", "--ray", "0", "0", "0"][..], &last].concat();
    fails(dir, &numbers(["0", "0", "0"]), 2, "direction is zero");
    fails(dir, &numbers(["1", "nan", "0"]), 2, "expected a finite number");
    fails(dir, &["crossings", "m.oc", "--ray", "0", "0", "0", "1", "0"], 2, "6 values");
    fails(dir, &["crossings", "m.oc"], 2, "--ray");
    fails(dir, &["crossings", "no.oc", "--ray", "0", "0", "0", "1", "0", "0"], 1, "no.oc");
    fails(dir, &["crossings", "m.oc", "--ray", "0", "0", "0", "1", "0", "0", "--memory", "1"], 1, "budget");
}

/// Two parts below that of the file, which has no triangles of its own.
#[test]
fn parts_are_exported_each_once_and_with_those_below() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 2\nproperty list uchar int vertex_indices\nproperty int part\nend_header\n";
    let rows = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2 7\n3 0 1 3 8\n";
    std::fs::write(dir.join("m.ply"), format!("{header}{rows}")).unwrap();
    json(dir, &["build", "m.ply", "-o", "m.oc"]);
    let counts = |of: &[&str]| {
        let said = json(dir, &[&["export", "m.oc", "-o", "out.ply"], of].concat());
        ["parts", "triangles", "vertices"].map(|key| said[key].as_u64().unwrap())
    };
    assert_eq!(counts(&["--part", "7"]), [1, 1, 3]);
    assert_eq!(counts(&["--part", "7,7"]), [1, 1, 3]);
    assert_eq!(counts(&["--part", "0"]), [1, 0, 0]);
    assert_eq!(counts(&["--part", "0", "--below"]), [3, 2, 6]);
    assert_eq!(counts(&[]), [3, 2, 6]);
    let text = String::from_utf8(outcrop(dir, &["export", "m.oc", "--part", "8", "-o", "8.ply"]).stdout).unwrap();
    assert_eq!(text, "8.ply: 1 part, 1 triangle, 3 vertices\n");
    assert_eq!(json(dir, &["build", "out.ply", "-o", "again.oc"])["triangles_kept"], 2);
    fails(dir, &["export", "m.oc", "--part", "9", "-o", "no.ply"], 2, "no part with id 9");
    fails(dir, &["export", "m.oc", "-o", "m.oc"], 2, "must end with .ply");
    fails(dir, &["export", "m.ply", "-o", "no.ply"], 1, "not an outcrop model");
    assert!(!names(dir).contains(&"no.ply".to_string()));
}

#[test]
fn each_verb_has_help() {
    let dir = tempfile::tempdir().unwrap();
    for verb in ["generate", "build", "info", "check", "crossings", "render", "bench"] {
        let out = outcrop(dir.path(), &[verb, "--help"]);
        assert!(out.status.success());
        assert!(String::from_utf8(out.stdout).unwrap().contains("--json"), "{verb}");
    }
}

#[test]
fn wrong_usage_is_2_and_failure_is_1() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("not.oc"), "no model").unwrap();
    std::fs::write(dir.join("not.ply"), "no mesh").unwrap();
    fails(dir, &[], 2, "Usage");
    fails(dir, &["teach"], 2, "teach");
    fails(dir, &["generate", "teapot", "-o", "t.ply"], 2, "teapot");
    fails(dir, &["generate", "mandelbulb", "--triangles", "10", "-o", "t.ply"], 2, "1,000");
    fails(dir, &["build", "-o", "m.oc"], 2, "FILE");
    fails(dir, &["build", "not.ply", "-o", "m.oc", "--memory", "1X"], 2, "suffix");
    fails(dir, &["render", "not.oc", "-o", "p.png", "--eye", "1,2,3"], 2, "--at");
    fails(dir, &["render", "not.oc", "-o", "p.png", "--light", "moon"], 2, "sun");
    for (args, why) in [
        (
            &["build", "not.ply", "-o", "m.oc", "--unit", "-1"][..],
            "'--unit <METRES>': expected a finite number above 0",
        ),
        (&["build", "not.ply", "-o", "m.oc", "--unit", "0"], "above 0"),
        (&["build", "not.ply", "-o", "m.oc", "--threads", "99999"], "'--threads <N>': expected a number from 0 to "),
        (&["build", "not.ply", "-o", "m.oc", "--threads", "-1"], "'--threads <N>': expected a number from 0 to "),
        (&["render", "not.oc", "-o", "p.png", "--threads", "99999"], "'--threads <N>': expected a number from 0 to "),
        (&["bench", "not.oc", "--threads", "99999"], "'--threads <N>': expected a number from 0 to "),
        (&["bench", "not.oc", "--threads", "0"], "1 or more"),
        (
            &["render", "not.oc", "-o", "p.png", "--ortho", "-2"],
            "'--ortho <HEIGHT or fit>': expected a finite number above 0",
        ),
        (&["render", "not.oc", "-o", "p.png", "--ortho", "inf"], "above 0"),
        (&["render", "not.oc", "-o", "p.png", "--fov", "-30"], "'--fov <DEGREES>': expected degrees above 0"),
        (&["render", "not.oc", "-o", "p.png", "--samples", "-4"], "'--samples <N>'"),
        (&["render", "not.oc", "-o", "p.png", "--view", "-1"], "'--view <0..3 or NAME>'"),
        (&["render", "not.oc", "-o", "p.png", "--until", "-1"], "expected first, complete"),
        (&["render", "not.oc", "-o", "p.png", "--size", "0x0"], "from 1 to 65536"),
        (&["render", "not.oc", "-o", "p.png", "--size", "65536x65536"], "at most 1073741824 pixels"),
        (&["build", "not.ply", "-o", "m.oc", "--memory", "-1"], "'--memory <BYTES>': out of range"),
        (&["render", "not.oc", "-o", "p.png", "--cache", "-1"], "'--cache <BYTES>': out of range"),
        (&["check", "not.oc", "--memory", "-1"], "'--memory <BYTES>': out of range"),
        (&["bench", "not.oc", "--cache", "-1"], "'--cache <BYTES>': out of range"),
        (&["generate", "airliner", "-o", "t.ply", "--triangles", "-5"], "'--triangles <N>': out of range"),
    ] {
        fails(dir, args, 2, why);
    }
    fails(dir, &["build", "not.ply", "-o", "m.oc"], 1, "not.ply");
    fails(dir, &["build", "missing.ply", "-o", "m.oc"], 1, "missing.ply");
    // Before anything is read or made.
    fails(dir, &["build", "missing.ply", "-o", "x.oc/"], 1, "is the name of a folder");
    fails(dir, &["generate", "airliner", "-o", "x.ply/"], 1, "is the name of a folder");
    for verb in
        [&["info", "not.oc"][..], &["check", "not.oc"], &["render", "not.oc", "-o", "p.png"], &["bench", "not.oc"]]
    {
        fails(dir, verb, 1, "not.oc");
    }
    assert_eq!(names(dir), ["not.oc", "not.ply"]);
}

#[test]
fn a_budget_too_small_names_its_need() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    json(dir, &["generate", "mandelbulb", "--triangles", "5K", "-o", "b.ply"]);
    json(dir, &["build", "b.ply", "-o", "b.oc"]);
    fails(dir, &["build", "b.ply", "-o", "c.oc", "--memory", "1K"], 1, "bytes");
    fails(dir, &["render", "b.oc", "-o", "b.png", "--memory", "1K"], 1, "bytes");
    assert_eq!(names(dir), ["b.oc", "b.ply"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing_behind() {
    use std::io::Read;
    let dir = tempfile::tempdir().unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_outcrop"))
        .current_dir(dir.path())
        .args(["generate", "airliner", "--triangles", "200M", "-o", "a.ply"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // Its temporary appears; then it is interrupted.
    while names(dir.path()).is_empty() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let mut stderr = String::new();
    child.stderr.unwrap().read_to_string(&mut stderr).unwrap();
    assert!(stderr.contains("cancelled"), "{stderr}");
    assert!(names(dir.path()).is_empty(), "{:?}", names(dir.path()));
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_build_and_the_old_model_stays() {
    let dir = tempfile::tempdir().unwrap();
    let side = 400;
    let mut obj = String::new();
    for i in 0..side * side {
        obj += &format!("v {} {} {}\n", i % side, i / side, i * 7919 % 100);
    }
    for i in (0..side * (side - 1)).filter(|i| i % side + 1 < side) {
        obj += &format!("f {} {} {}\n", i + 1, i + 2, i + side + 1);
    }
    std::fs::write(dir.path().join("a.obj"), obj).unwrap();
    std::fs::write(dir.path().join("a.oc"), "old").unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_outcrop"))
        .current_dir(dir.path())
        .args(["build", "a.obj", "-o", "a.oc"])
        .spawn()
        .unwrap();
    // Its temporary appears; then it is interrupted.
    while names(dir.path()).len() < 3 {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(names(dir.path()), ["a.obj", "a.oc"]);
    assert_eq!(std::fs::read(dir.path().join("a.oc")).unwrap(), b"old");
}

/// The file of the airliner is 265 MB; that it is made in a tenth is what "streamed" means.
#[cfg(target_os = "linux")]
#[test]
fn generating_takes_bounded_memory() {
    let dir = tempfile::tempdir().unwrap();
    for (name, triangles, most_kb) in [("airliner", "5M", 96 << 10), ("mandelbulb", "1M", 64 << 10)] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_outcrop"))
            .current_dir(dir.path())
            .args(["generate", name, "--triangles", triangles, "-o", "m.ply"])
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let (mut most, status) = (0, format!("/proc/{}/status", child.id()));
        let code = loop {
            let text = std::fs::read_to_string(&status).unwrap_or_default();
            let peak = text.lines().find_map(|l| l.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
            most = peak.and_then(|kb| kb.parse().ok()).unwrap_or(0).max(most);
            if let Some(code) = child.try_wait().unwrap() {
                break code;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        };
        assert!(code.success());
        assert!(most > 1 << 10 && most < most_kb, "{name}: {most} KB");
    }
}
