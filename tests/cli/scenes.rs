//! Scene files on the command line, and files that are damaged.

use super::{fails, json, outcrop};
use glam::{DAffine3, DVec3};
use outcrop::scene::{
    Background, Context, ContextOptions, Instances, Look, Model, Place, Prototypes, Scene, Transforms,
};
use std::path::Path;
use std::sync::Arc;

#[test]
fn a_damaged_model_fails_its_check() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    json(dir, &["generate", "mandelbulb", "--triangles", "5K", "-o", "b.ply"]);
    json(dir, &["build", "b.ply", "-o", "b.oc"]);
    let mut bytes = std::fs::read(dir.join("b.oc")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(dir.join("b.oc"), bytes).unwrap();
    fails(dir, &["check", "b.oc"], 1, "b.oc");
}

/// A forest of two tiles in a folder with its model: each tile has four trees and one beside them.
fn forest(dir: &Path) {
    let args = ["generate", "plant", "--species", "spruce", "--triangles", "2K", "-o", "tree.ply"];
    assert!(outcrop(dir, &args).status.success());
    assert!(outcrop(dir, &["build", "tree.ply", "-o", "tree.oc", "--threads", "1"]).status.success());
    let context = Context::new(ContextOptions { threads: 1, ..ContextOptions::default() }).unwrap();
    let model = Model::open(&context, dir.join("tree.oc")).unwrap();
    let wide = model.info().bounds.extent().max_element();
    let places = |count: usize, step: f64| {
        let place = |i: usize| {
            let position = DVec3::new(step * (i % 2) as f64, step * (i / 2) as f64, 0.0);
            Place { position, rotation: [0.0, 0.0, 0.0, 1.0], scale: 1.0 }
        };
        Transforms::Places((0..count).map(place).collect())
    };
    let [tile, all] = [Scene::new(&context), Scene::new(&context)];
    let array = |prototypes: Prototypes, transforms: Transforms| Instances {
        prototypes,
        prototype_of: Arc::from([]),
        transforms,
        first_id: 10,
        mask: u32::MAX,
        masks: None,
        tints: None,
    };
    tile.add_instances(&array(vec![model.clone()].into(), places(4, wide))).unwrap();
    tile.add_instance(&model, 1, DAffine3::from_translation(DVec3::X * 2.0 * wide)).unwrap();
    tile.commit().unwrap();
    all.add_instances(&array(Prototypes::Scenes(vec![tile]), places(2, 4.0 * wide))).unwrap();
    all.set_instance_look(11, Look { colour: Some([1.0, 0.0, 0.0, 1.0]), ..Look::default() }).unwrap();
    all.set_background(Background::Colour([0.0, 0.0, 1.0, 1.0])).unwrap();
    all.commit().unwrap();
    all.save(dir.join("forest.oc")).unwrap();
}

#[test]
fn scene_files_are_shown_checked_and_rendered() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    forest(dir);
    let bytes = std::fs::metadata(dir.join("forest.oc")).unwrap().len();
    let info = json(dir, &["info", "forest.oc"]);
    assert_eq!((&info["bytes"], &info["scenes"], &info["levels"]), (&bytes.into(), &2.into(), &2.into()));
    // Five trees, and the two places of their tile.
    assert_eq!((&info["stored"], &info["instances"], &info["occurrences"]), (&7.into(), &10.into(), &10.into()));
    assert_eq!(info["bytes_each"], bytes as f64 / 7.0);
    assert!(info["bytes_memory"].as_u64().unwrap() > 7 * 48);
    let models = info["models"].as_array().unwrap();
    assert!(models.len() == 1 && models[0]["file"].as_str().unwrap().ends_with("tree.oc"));
    assert_eq!(models[0]["triangles"], json(dir, &["info", "tree.oc"])["triangles"]);
    let out = outcrop(dir, &["info", "forest.oc"]);
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("a scene, 1 model, 2 scenes in 2 levels") && text.contains("7 stored instances"), "{text}");
    assert!(text.contains("10 instances and 10 meshes in all places") && text.contains("bytes each"), "{text}");

    let check = json(dir, &["check", "forest.oc"]);
    assert_eq!((&check["ok"], &check["models"], &check["stored"]), (&true.into(), &1.into(), &7.into()));
    assert_eq!(check["triangles"], models[0]["triangles"]);

    let args = [
        "render",
        "forest.oc",
        "-o",
        "f.png",
        "--size",
        "160x60",
        "--samples",
        "1",
        "--threads",
        "1",
        "--view",
        "front",
    ];
    let picture = json(dir, &args);
    assert_eq!(picture["pixels"]["exact"], 160 * 60);
    let image = image::open(dir.join("f.png")).unwrap().into_rgb8();
    // Its own background; and the trees of one tile are red, those of the other are not.
    assert_eq!(image.get_pixel(0, 0).0, [0, 0, 255]);
    let count = |is: fn(&[u8; 3]) -> bool| image.pixels().filter(|pixel| is(&pixel.0)).count();
    let (red, green) = (count(|p| p[0] > 2 * p[1] && p[2] < 20), count(|p| p[1] > p[2] && p[1] > p[0]));
    assert!(red > 50 && green > 50, "{red} {green}");
    fails(dir, &["render", "forest.oc", "-o", "f.png", "--hide", "1"], 2, "require a model");
    fails(dir, &["info", "forest.oc", "--parts"], 2, "requires a model");

    // The model is built anew: it is not that of the scene any more.
    std::fs::rename(dir.join("tree.oc"), dir.join("kept.oc")).unwrap();
    assert!(outcrop(dir, &["build", "tree.ply", "-o", "tree.oc", "--up", "x", "--threads", "1"]).status.success());
    for verb in ["info", "check"] {
        fails(dir, &[verb, "forest.oc"], 1, "is not the file that the scene was saved with");
    }
    std::fs::rename(dir.join("kept.oc"), dir.join("tree.oc")).unwrap();
    let mut damaged = std::fs::read(dir.join("forest.oc")).unwrap();
    damaged[200] ^= 1;
    std::fs::write(dir.join("forest.oc"), damaged).unwrap();
    fails(dir, &["check", "forest.oc"], 1, "forest.oc: damaged (checksum mismatch)");
}
