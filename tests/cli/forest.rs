//! Forests on the command line: what is generated is what the generator planted, and pictures say what they show.

use super::{fails, json, names};
use glam::{DAffine3, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::import::generate::{Forest, ForestOptions, SPECIES};
use outcrop::query::HitKind;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Context, ContextOptions, Scene, SceneState};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::time::Duration;

const SIZE: (u32, u32) = (64, 36);
/// Above the forest, which is 130 m wide, looking along it.
const EYE: [f64; 3] = [-90.0, -80.0, 45.0];
const AT: [f64; 3] = [0.0, 10.0, 5.0];

fn generate(dir: &Path, seed: &str) -> Value {
    let args = ["generate", "forest", "f.oc", "--trees", "2K", "--species", "3", "--triangles", "2K", "--seed", seed];
    json(dir, &args)
}

/// What the generator plants for [`generate`] with a seed.
fn planted(seed: u64) -> Forest {
    let options = ForestOptions { trees: 2_000, species: 3, seed, ..ForestOptions::default() };
    Forest::plant(&options, &Cancel::new()).unwrap()
}

/// A picture of the forest by the library.
struct Picture {
    state: std::sync::Arc<SceneState>,
    frame: Frame,
}

impl Picture {
    fn new(path: &Path, poe: f32) -> Self {
        let context = Context::new(ContextOptions { threads: 1, ..ContextOptions::default() }).unwrap();
        let state = Scene::open(&context, path).unwrap().state();
        let (width, height) = SIZE;
        let outputs = Outputs::ALL;
        let frame = Frame::new(&context, FrameOptions { width, height, outputs, ..FrameOptions::default() }).unwrap();
        let camera =
            Camera::Perspective { eye: DVec3::from(EYE), at: DVec3::from(AT), up: DVec3::Z, fov_y_degrees: 45.0 };
        let settings = FrameSettings { poe, samples: 1, ..FrameSettings::default() };
        frame.request(&state, &camera, &settings).unwrap();
        while frame.wait(Duration::from_secs(1)).state == FrameState::Running {}
        Self { state, frame }
    }

    fn occurrences(&self) -> Vec<u64> {
        self.frame.map(Buffer::Occurrence).unwrap().ids().unwrap().to_vec()
    }

    /// The pixels of a kind, and the errors of all.
    fn of_kind(&self, kind: HitKind) -> (Vec<usize>, Vec<f32>) {
        let kinds = self.frame.map(Buffer::Kind).unwrap();
        let pixels = (0..kinds.bytes().len()).filter(|at| kinds.bytes()[*at] == kind as u8).collect();
        (pixels, self.frame.map(Buffer::Error).unwrap().floats().unwrap().to_vec())
    }
}

/// What the command line says of a pixel.
fn said(dir: &Path, pixel: usize, poe: &str) -> Value {
    let text = |v: [f64; 3]| format!("{},{},{}", v[0], v[1], v[2]);
    let at = format!("{},{}", pixel % SIZE.0 as usize, pixel / SIZE.0 as usize);
    let (size, eye, look) = (format!("{}x{}", SIZE.0, SIZE.1), text(EYE), text(AT));
    let args = ["--eye", &eye, "--at", &look, "--up", "z", "--fov", "45", "--occurrence", &at, "--poe", poe];
    let args = [&["render", "f.oc", "-o", "p.png", "--size", &size, "--samples", "1", "--threads", "1"], &args[..]];
    json(dir, &args.concat())["occurrence"].take()
}

fn ids(value: &Value) -> Vec<u64> {
    value.as_array().unwrap().iter().map(|it| it.as_u64().unwrap()).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect()
}

#[test]
fn a_forest_is_generated_checked_and_rendered() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let made = generate(dir, "5");
    let forest = planted(5);
    let trees = made["trees"].as_u64().unwrap();
    assert!((1_980..=2_020).contains(&trees) && trees == forest.trees(), "{trees}");
    assert_eq!(names(dir), ["f.oc", "f.plants"]);
    assert_eq!(names(&dir.join("f.plants")), ["cypress.oc", "ground.oc", "pine.oc", "spruce.oc"]);
    let check = json(dir, &["check", "f.oc"]);
    assert_eq!((&check["ok"], &check["models"], &check["scenes"]), (&true.into(), &4.into(), &17.into()));
    let info = json(dir, &["info", "f.oc"]);
    assert_eq!((&info["levels"], &info["instances"]), (&2.into(), &(trees + 1).into()));
    assert_eq!(info["bytes"], made["bytes"]);

    // Each pixel of a tree leads to a tree that the generator planted, of that species, in that place.
    let exact = Picture::new(&dir.join("f.oc"), 0.0);
    let all = exact.occurrences();
    let mut seen = std::collections::BTreeSet::new();
    for occurrence in all.iter().filter(|it| **it != u64::MAX) {
        let (path, place) = exact.state.path(*occurrence).unwrap();
        let model = exact.state.model_of(*occurrence).unwrap().info().name.clone();
        let [tile, tree] = path[..] else {
            assert_eq!((&path[..], place), (&[0][..], DAffine3::IDENTITY));
            assert!(model.ends_with("ground.oc"), "{model}");
            continue;
        };
        let across = u64::from(forest.across());
        let (column, row) = (((tile - 1) % across) as u32, ((tile - 1) / across) as u32);
        let tree = &forest.tiles()[forest.tile_at(column, row)][tree as usize];
        let foot = (forest.middle_of(column, row) + tree.place).extend(0.0);
        assert!(place.translation.distance(foot) < 1e-9, "{place:?}");
        let [z, w] = [2, 3].map(|i| f64::from(tree.rotation[i]));
        let turned = DVec3::new(w * w - z * z, 2.0 * z * w, 0.0) * f64::from(tree.scale);
        assert!(place.matrix3.x_axis.distance(turned) < 1e-6, "{place:?}");
        assert!(model.ends_with(&format!("{}.oc", SPECIES[tree.species as usize])), "{model}");
        seen.insert(*occurrence);
    }
    assert!(seen.len() > 100, "{} trees are seen", seen.len());

    // The command line says of a pixel what the library does: of a triangle, and of a stand-in.
    let coarse = Picture::new(&dir.join("f.oc"), 30.0);
    for (picture, poe, kind, name) in [(&exact, "0", HitKind::Exact, "exact"), (&coarse, "30", HitKind::Lod, "lod")] {
        let (pixels, errors) = picture.of_kind(kind);
        let occurrences = picture.occurrences();
        let of_tree = |at: &&usize| picture.state.path(occurrences[**at]).is_some_and(|(path, _)| path.len() == 2);
        let pixels: Vec<usize> = pixels.iter().filter(of_tree).copied().collect();
        let pixel = pixels[pixels.len() / 2];
        let said = said(dir, pixel, poe);
        let (path, place) = picture.state.path(occurrences[pixel]).unwrap();
        assert_eq!((&said["number"], &said["kind"]), (&occurrences[pixel].into(), &name.into()));
        assert_eq!(ids(&said["path"]), path);
        let (columns, expected) = (numbers(&said["world_from_model"]), place.to_cols_array());
        // The parser of the test may round.
        assert!(columns.iter().zip(&expected).all(|(a, b)| (a - b).abs() <= 1e-15 * b.abs()), "{columns:?} {place:?}");
        match errors[pixel] {
            error if error.is_finite() => assert_eq!(said["error"].as_f64().map(|it| it as f32), Some(error)),
            _ => assert!(said["error"].is_null()),
        }
        assert_eq!(said["prim"].is_null(), kind == HitKind::Lod);
        if kind == HitKind::Exact {
            // The highest of the species is 30 m high.
            let at = DVec3::from_slice(&numbers(&said["position"]));
            assert!((at - place.translation).length() < 1.3 * 30.0 * 1.5, "{at} {place:?}");
        }
    }
}

#[test]
fn seeds_of_forests_give_the_same_files() {
    let dirs = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let [one, same, other] = [0, 1, 2].map(|i| dirs[i].path());
    generate(one, "1");
    generate(same, "1");
    generate(other, "2");
    let bytes = |dir: &Path| {
        let plants = names(&dir.join("f.plants")).into_iter().map(|name| fs::read(dir.join("f.plants").join(name)));
        plants.chain([fs::read(dir.join("f.oc"))]).collect::<Result<Vec<_>, _>>().unwrap()
    };
    let (first, second, third) = (bytes(one), bytes(same), bytes(other));
    assert!(first == second);
    // The plants and the scene differ. The ground, a square, may be the same.
    assert!([0, 2, 3, 4].into_iter().all(|i| first[i] != third[i]));
}

#[test]
fn bad_options_of_forests_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let wrong = |args: &[&str], why| fails(dir, &[&["generate", "forest"], args].concat(), 2, why);
    wrong(&[], "<OUT>");
    wrong(&["f.ply"], "must end with .oc");
    wrong(&["f.oc", "-o", "g.oc"], "cannot be used with");
    wrong(&["-o", "-"], "cannot be written to standard output");
    wrong(&["f.oc", "--trees", "99"], "number of trees must be from 100");
    wrong(&["f.oc", "--trees", "2T"], "number of trees must be from 100");
    wrong(&["f.oc", "--trees", "many"], "'--trees <N>': unknown suffix 'y'");
    wrong(&["f.oc", "--species", "0"], "species must be from 1 to 13");
    wrong(&["f.oc", "--species", "14"], "species must be from 1 to 13");
    wrong(&["f.oc", "--species", "oak"], "takes the number of its species");
    wrong(&["f.oc", "--spacing", "-1"], "'--spacing <METRES>': expected a finite number above 0");
    wrong(&["f.oc", "--spacing", "20000"], "spacing must be from 0.01 to 10,000");
    wrong(&["f.oc", "--triangles", "1999", "--trees", "100"], "number of triangles must be between 2,000");
    fails(dir, &["generate", "plant", "--species", "0", "--trees", "5", "p.ply"], 2, "--trees: only a forest has it");
    fails(dir, &["generate", "airliner", "--spacing", "5", "p.ply"], 2, "--spacing: only a forest has it");
    fs::write(dir.join("h.plants"), "in the way").unwrap();
    fails(dir, &["generate", "forest", "h.oc", "--trees", "100"], 2, "h.plants is there already");
    assert_eq!(names(dir), ["h.plants"]);
}
