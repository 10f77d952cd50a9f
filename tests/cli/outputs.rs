//! Outputs of the commands: nothing is overwritten that was not meant, and `-` is standard output.
#![cfg(unix)]

use super::{fails, json, names, outcrop};
use std::fs;
use std::os::unix::fs::{FileTypeExt, symlink};
use std::path::Path;
use std::process::Command;

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// A folder with a mesh and its model.
fn with_model() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("a.obj"), OBJ).unwrap();
    json(dir.path(), &["build", "a.obj", "-o", "m.oc"]);
    dir
}

/// Each command with an output, without the name of the output.
fn writers() -> [(&'static str, Vec<&'static str>); 3] {
    [
        ("oc", vec!["build", "a.obj", "-o"]),
        ("png", vec!["render", "m.oc", "--size", "8x8", "--samples", "1", "-o"]),
        ("ply", vec!["generate", "mandelbulb", "--triangles", "1K", "-o"]),
    ]
}

#[test]
fn no_command_overwrites_its_input_by_any_name() {
    let dir = with_model();
    let dir = dir.path();
    let model = fs::read(dir.join("m.oc")).unwrap();
    fs::write(dir.join("b.obj"), OBJ).unwrap();
    for (link, to) in [("soft.png", "m.oc"), ("soft.oc", "b.obj")] {
        symlink(to, dir.join(link)).unwrap();
    }
    fs::hard_link(dir.join("m.oc"), dir.join("hard.png")).unwrap();
    fs::hard_link(dir.join("a.obj"), dir.join("hard.oc")).unwrap();
    let before = names(dir);
    for (args, why) in [
        (&["build", "a.obj", "-o", "a.obj"][..], "must end with .oc"),
        (&["build", "a.obj", "b.obj", "-o", "soft.oc"], "same file as the input b.obj"),
        (&["build", "b.obj", "a.obj", "-o", "hard.oc"], "same file as the input a.obj"),
        (&["render", "m.oc", "-o", "m.oc"], "must end with .png"),
        (&["render", "m.oc", "-o", "soft.png"], "same file as the input m.oc"),
        (&["render", "m.oc", "-o", "hard.png"], "same file as the input m.oc"),
    ] {
        fails(dir, args, 2, why);
    }
    assert_eq!(names(dir), before);
    assert_eq!(fs::read(dir.join("m.oc")).unwrap(), model);
    assert_eq!(fs::read_to_string(dir.join("a.obj")).unwrap(), OBJ);
    assert_eq!(fs::read_to_string(dir.join("b.obj")).unwrap(), OBJ);
}

/// Files that an input refers to, found only while it is read.
#[test]
fn a_build_overwrites_nothing_that_it_reads() {
    let dir = with_model();
    let dir = dir.path();
    let library = "newmtl m\nKd 1 0 0\n";
    fs::write(dir.join("b.obj"), format!("mtllib b.mtl\n{OBJ}")).unwrap();
    fs::write(dir.join("b.mtl"), library).unwrap();
    fs::hard_link(dir.join("b.mtl"), dir.join("hard.oc")).unwrap();
    symlink("b.mtl", dir.join("soft.oc")).unwrap();
    let before = names(dir);
    for out in ["hard.oc", "soft.oc"] {
        fails(dir, &["build", "b.obj", "-o", out], 2, &format!("the output {out} is the same file as the input b.mtl"));
    }
    assert_eq!((names(dir), fs::read_to_string(dir.join("b.mtl")).unwrap()), (before, library.to_owned()));
}

#[test]
fn paths_out_of_the_folder_and_limits_are_options() {
    let dir = with_model();
    let dir = dir.path();
    fs::create_dir(dir.join("sub")).unwrap();
    fs::write(dir.join("b.mtl"), "newmtl m\nKd 1 0 0\n").unwrap();
    fs::write(dir.join("sub/b.obj"), format!("mtllib ../b.mtl\nusemtl m\n{OBJ}")).unwrap();
    let notes = |more: &[&str]| {
        let built = json(dir, &[&["build", "sub/b.obj", "-o", "b.oc"], more].concat());
        built["notes"].as_array().unwrap().iter().map(|note| note.to_string()).collect::<String>()
    };
    assert!(notes(&[]).contains("is outside of the folder of the file"), "{}", notes(&[]));
    assert_eq!((notes(&["--trust-paths"]), notes(&["--trust-folder", "."])), (String::new(), String::new()));
    assert!(notes(&["--trust-folder", "sub"]).contains("is outside"));
    assert_eq!(
        json(dir, &["build", "a.obj", "-o", "b.oc", "--max-triangles", "1", "--max-bytes", "1M"])["triangles_in"],
        1
    );
    fs::write(dir.join("c.obj"), format!("{OBJ}f 3 2 1\n")).unwrap();
    fails(dir, &["build", "c.obj", "-o", "c.oc", "--max-triangles", "1"], 1, "more than 1, the limit max_triangles");
    fails(dir, &["build", "c.obj", "-o", "c.oc", "--max-bytes", "100"], 1, "more than 100, the limit max_bytes");
    assert!(!dir.join("c.oc").exists());
}

#[test]
fn links_stay_and_pipes_devices_and_folders_are_refused() {
    let dir = with_model();
    let dir = dir.path();
    fs::create_dir(dir.join("elsewhere")).unwrap();
    for (suffix, command) in writers() {
        let name = |stem: &str| format!("{stem}.{suffix}");
        let run = |to: &str| outcrop(dir, &[&command[..], &[to]].concat());
        let refused = |to: &str, why: &str| fails(dir, &[&command[..], &[to]].concat(), 1, why);
        symlink(format!("elsewhere/real.{suffix}"), dir.join(name("link"))).unwrap();
        refused(&name("link"), "leads to no file");
        fs::write(dir.join("elsewhere").join(name("real")), "old").unwrap();
        assert!(run(&name("link")).status.success(), "{suffix}");
        assert!(fs::symlink_metadata(dir.join(name("link"))).unwrap().is_symlink());
        assert!(fs::metadata(dir.join("elsewhere").join(name("real"))).unwrap().len() > 100, "{suffix}");
        assert!(Command::new("mkfifo").arg(dir.join(name("pipe"))).status().unwrap().success());
        refused(&name("pipe"), "not a regular file");
        assert!(fs::symlink_metadata(dir.join(name("pipe"))).unwrap().file_type().is_fifo());
        symlink("/dev/null", dir.join(name("null"))).unwrap();
        symlink("/dev/stdout", dir.join(name("stdout"))).unwrap();
        fs::create_dir(dir.join(name("folder"))).unwrap();
        refused(&name("null"), "not a regular file");
        refused(&name("stdout"), "not a regular file");
        refused(&name("folder"), "is a folder");
        refused(&format!("none/{}", name("new")), "none");
    }
    assert!(!fs::metadata("/dev/null").unwrap().is_file());
    let hidden: Vec<_> = names(dir).into_iter().filter(|name| name.starts_with('.')).collect();
    assert!(hidden.is_empty(), "{hidden:?}");
}

#[test]
fn the_suffix_says_the_format() {
    let dir = with_model();
    for (suffix, command) in writers() {
        for name in ["p.jpg", "p", "p.png.bak", "/dev/stdout"] {
            fails(dir.path(), &[&command[..], &[name]].concat(), 2, &format!("must end with .{suffix}"));
        }
        let upper = format!("UPPER.{}", suffix.to_uppercase());
        assert!(outcrop(dir.path(), &[&command[..], &[upper.as_str()]].concat()).status.success());
    }
    assert_eq!(names(dir.path()), ["UPPER.OC", "UPPER.PLY", "UPPER.PNG", "a.obj", "m.oc"]);
}

#[test]
fn a_dash_is_standard_output() {
    let dir = with_model();
    let dir = dir.path();
    let [build, render, generate] = writers().map(|(_, command)| command);
    fails(dir, &[&build[..], &["-"]].concat(), 2, "cannot be written to standard output");
    for (command, file) in [(render, "same.png"), (generate, "same.ply")] {
        let out = outcrop(dir, &[&command[..], &["-", "--json"]].concat());
        assert!(out.status.success());
        assert!(outcrop(dir, &[&command[..], &[file]].concat()).status.success());
        assert!(out.stdout == fs::read(dir.join(file)).unwrap(), "{file}");
        let report: serde_json::Value = serde_json::from_slice(&out.stderr).unwrap();
        assert_eq!(report["file"], "-");
    }
    assert!(!Path::new(&dir.join("-")).exists());
    assert_eq!(names(dir), ["a.obj", "m.oc", "same.ply", "same.png"]);
}

/// `render --occurrence` names what the picture shows at a pixel.
#[test]
fn a_picture_names_what_it_shows() {
    let dir = with_model();
    let at = |pixel: &'static str| {
        ["render", "m.oc", "-o", "p.png", "--size", "80x60", "--samples", "1", "--occurrence", pixel]
    };
    let shown =
        &json(dir.path(), &[&at("40,30")[..], &["--eye", "0.2,0.3,5", "--at", "0.2,0.2,0"]].concat())["occurrence"];
    assert_eq!((shown["number"].as_u64(), shown["prim"].as_u64()), (Some(0), Some(0)));
    assert_eq!((&shown["pixel"][0], &shown["pixel"][1]), (&40.into(), &30.into()));
    let place: Vec<f64> = shown["world_from_model"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    assert_eq!(place, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let z = shown["position"][2].as_f64().unwrap();
    assert!(z.abs() < 1e-5, "{z}");
    let away =
        &json(dir.path(), &[&at("0,0")[..], &["--eye", "0.2,1.2,50", "--at", "0.2,0.2,0"]].concat())["occurrence"];
    assert!(away.is_null());
    fails(dir.path(), &at("80,0"), 2, "outside of 80x60");
    fails(dir.path(), &at("1;2"), 2, "two whole numbers");
}

/// A plant is generated by number or name, and each of its parts can be hidden.
#[test]
fn plants_have_a_species_and_parts() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let plant = |species: &'static str, out: &'static str| {
        json(dir, &["generate", "plant", "--species", species, "--seed", "4", "--triangles", "5K", "-o", out])
    };
    let made = plant("3", "oak.ply");
    assert_eq!(plant("oak", "same.ply")["species"], "oak");
    assert_eq!((&made["species"], &made["seed"], &made["parts"]), (&"oak".into(), &4.into(), &4.into()));
    assert!(fs::read(dir.join("oak.ply")).unwrap() == fs::read(dir.join("same.ply")).unwrap());
    let built = json(dir, &["build", "oak.ply", "-o", "oak.oc"]);
    assert_eq!((&built["triangles_kept"], &built["triangles_in"]), (&made["triangles"], &made["triangles"]));
    let list = &json(dir, &["info", "oak.oc", "--parts"])["part_list"];
    let parts: Vec<_> = list.as_array().unwrap().iter().map(|p| (p["id"].as_u64(), p["name"].as_str())).collect();
    assert_eq!(parts, [(1, "oak"), (2, "bark"), (3, "twigs"), (4, "leaves")].map(|(id, name)| (Some(id), Some(name))));
    for part in ["2", "3", "4"] {
        json(dir, &["render", "oak.oc", "-o", "p.png", "--size", "16x16", "--samples", "1", "--hide", part]);
    }
    let wrong = |args: &[&str], why| fails(dir, &[&["generate"], args, &["-o", "x.ply"]].concat(), 2, why);
    for species in ["13", "-1", "elm", "4294967296"] {
        wrong(
            &["plant", "--species", species],
            "'--species <0..12 or NAME>': expected a number from 0 to 12, or one of",
        );
    }
    wrong(&["plant"], "plant requires --species");
    wrong(&["mandelbulb", "--species", "0"], "--species: mandelbulb has no species");
    wrong(&["plant", "--species", "0", "--seed", "-1"], "'--seed <SEED>'");
    wrong(&["plant", "--species", "0", "--triangles", "1999"], "number of triangles must be between 2,000");
    wrong(&["plant", "--species", "0", "--triangles", "-5"], "'--triangles <N>'");
    fails(dir, &["render", "oak.oc", "-o", "q.png", "--views", "plant"], 2, "'--views <NAME>'");
}
