//! Scene files: what is saved and opened again answers like the scene that was built in memory, and damaged, hostile or
//! swapped files are errors that name the file and the place in it.

#[path = "scene_files/hostile.rs"]
mod hostile;

use crate::common::asked::ask;
use crate::common::built::{self, Built, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::base::error::Error;
use outcrop::math::Ray;
use outcrop::query::{HitKind, QueryOptions};
use outcrop::scene::{
    Background, Context, ContextOptions, Instances, Light, LightKind, Look, Model, Place, Prototypes, Scene, Scope,
    Transforms,
};
use outcrop::store::MemorySource;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const RED: Look = Look { visible: true, colour: Some([1.0, 0.25, 0.0, 1.0]), selected: false };
const HIDDEN: Look = Look { visible: false, colour: None, selected: true };

/// A folder with two models: `models/ball.oc`, and `model.oc`.
struct Folder {
    dir: tempfile::TempDir,
    models: [PathBuf; 2],
}

impl Folder {
    fn new() -> Self {
        let dir = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(dir.path().join("models")).expect("a folder");
        let models = [dir.path().join("models/ball.oc"), dir.path().join("model.oc")];
        for (built, to) in [ball(), cube()].iter().zip(&models) {
            std::fs::copy(&built.path, to).expect("a copy");
        }
        Self { dir, models }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn open(&self, context: &Context) -> [Model; 2] {
        self.models.each_ref().map(|path| Model::open(context, path).expect("a model"))
    }
}

fn ball() -> Built {
    built::parts(&[Part::white(5, scenes::bumpy_sphere(8, 12, 3)), Part::white(6, scenes::sphere(6, 8))])
}

fn cube() -> Built {
    built::parts(&[Part::white(9, scenes::cuboid(-DVec3::ONE, DVec3::ONE))])
}

fn map(rng: &mut Rng, reach: f64) -> DAffine3 {
    let turn = DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0));
    let scale = DVec3::new(rng.between(0.6, 1.2), if rng.one_in(3) { -0.8 } else { 1.0 }, 1.0);
    let at = rng.inside(DVec3::splat(-reach), DVec3::splat(reach));
    DAffine3::from_scale_rotation_translation(scale, turn, at)
}

/// Transforms of each form.
fn transforms(form: usize, count: usize, (rng, reach): (&mut Rng, f64)) -> Transforms {
    let maps: Vec<DAffine3> = (0..count).map(|_| map(rng, reach)).collect();
    let place = |it: &DAffine3| {
        let rotation = DQuat::from_mat3(&it.matrix3).to_array().map(|x| 2.0 * x as f32);
        Place { position: it.translation, rotation, scale: if it.translation.x > 0.0 { -0.7 } else { 0.9 } }
    };
    match form {
        0 => Transforms::Affine(maps.into()),
        1 => Transforms::Affine32(maps.iter().map(|it| it.to_cols_array().map(|x| x as f32)).collect()),
        _ => Transforms::Places(maps.iter().map(place).collect()),
    }
}

/// Single instances, arrays of all forms, one of them moved in part, and masks and looks.
fn flat(context: &Context, models: &[Model; 2], count: usize, seed: u64) -> Scene {
    let (scene, mut rng) = (Scene::new(context), Rng::new(seed));
    for id in 0..5 {
        scene.add_instance(&models[id as usize % 2], 2 * id, map(&mut rng, 4.0)).expect("an instance");
    }
    scene.set_instance_mask(4, 2).expect("a mask");
    scene.set_instance_look(6, RED).expect("a look");
    scene.set_instance_look(8, HIDDEN).expect("a look");
    for form in 0..3 {
        let first_id = 100 + 100_000 * form as u64;
        let transforms = transforms(form, count, (&mut rng, 6.0));
        let prototype_of = if form == 0 { Arc::from([]) } else { (0..count as u32).map(|i| i % 3 % 2).collect() };
        let mask = if form == 1 { 3 } else { u32::MAX };
        let prototypes = models.to_vec().into();
        scene
            .add_instances(&Instances {
                prototypes,
                prototype_of,
                transforms,
                first_id,
                mask,
                masks: None,
                tints: None,
            })
            .expect("an array");
        scene.set_instance_look(first_id + 3, RED).expect("a look");
        scene.set_instance_look(first_id + 1, HIDDEN).expect("a look");
        scene.set_instance_mask(first_id, 6).expect("a mask");
    }
    scene.commit().expect("a commit");
    // Few members move: the array keeps them in pages of their own, as the state before needs the others.
    let _before = scene.state();
    let moved = transforms(2, 2, (&mut rng, 6.0));
    scene.set_transforms(200_100 + count as u64 / 2, &moved).expect("transforms");
    scene.commit().expect("a commit");
    scene
}

/// Four levels: scenes in scenes and arrays of scenes, some in several places, with masks and looks.
fn nested(context: &Context, models: &[Model; 2], count: usize) -> Scene {
    let mut rng = Rng::new(3);
    let ground = flat(context, models, count, 1);
    let single = Scene::new(context);
    single.add_instance(&models[1], 77, map(&mut rng, 1.0)).expect("an instance");
    single.commit().expect("a commit");
    let mut inner = ground.clone();
    for level in 1..4u64 {
        let (scene, reach) = (Scene::new(context), 20.0 * level as f64);
        scene.add_scene(&inner, 3, map(&mut rng, reach)).expect("a scene");
        scene.add_scene(&single, 1, map(&mut rng, reach)).expect("a scene");
        scene.add_scene(&ground, 2, map(&mut rng, reach)).expect("a scene");
        scene.add_instance(&models[0], 9, map(&mut rng, reach)).expect("an instance");
        scene.set_instance_look(2, RED).expect("a look");
        scene.set_instance_mask(1, 5).expect("a mask");
        for form in 0..3 {
            let prototypes = Prototypes::Scenes(vec![single.clone(), inner.clone()]);
            let prototype_of: Arc<[u32]> = Arc::from([0, 1, 0, 1, 1]);
            let transforms = transforms(form, 5, (&mut rng, reach));
            let (first_id, mask) = (1000 * (form as u64 + 1), if form == 2 { 7 } else { u32::MAX });
            let array = Instances { prototypes, prototype_of, transforms, first_id, mask, masks: None, tints: None };
            scene.add_instances(&array).expect("an array of scenes");
            scene.set_instance_look(first_id + 1, if form == 1 { HIDDEN } else { RED }).expect("a look");
            scene.set_instance_mask(first_id + 4, 4).expect("a mask");
        }
        scene.commit().expect("a commit");
        inner = scene;
    }
    let sun = LightKind::Directional(DVec3::new(0.5, 0.25, -1.0));
    let lamp = LightKind::Point(DVec3::new(1e7, 2.0, 3.0));
    let light = |kind| Light { kind, colour: [1.0, 0.5, 0.25], intensity: 2.0, shadows: true };
    inner.set_lights(vec![light(sun), Light::HEADLIGHT, light(lamp)]).expect("lights");
    inner.set_background(Background::Colour([0.5, 0.25, 0.125, 1.0])).expect("a background");
    inner.commit().expect("a commit");
    inner
}

/// Both have the same hits, ways and numbers.
fn assert_alike(a: &Scene, b: &Scene, reach: f64, least: usize) {
    let (a, b) = (a.state(), b.state());
    assert_eq!(a.instance_count(), b.instance_count());
    let mut rng = Rng::new(8);
    let rays: Vec<Ray> = (0..2500)
        .map(|i| {
            let [eye, to] = [2.0, 1.0].map(|k| rng.inside(DVec3::splat(-k * reach), DVec3::splat(k * reach)));
            let mask = if i % 4 == 0 { 2 } else { u32::MAX };
            Ray { mask, ..Ray::new(eye, (to - eye).as_vec3().normalize()) }
        })
        .collect();
    for coherent in [false, true] {
        let [of_a, of_b] =
            [&a, &b].map(|state| ask(state, &rays, QueryOptions { coherent, ..QueryOptions::default() }));
        assert!(of_a == of_b, "hits differ");
        let met: Vec<_> = of_a.iter().filter(|hit| hit.kind != HitKind::Miss).collect();
        assert!(met.len() > least, "{} hits", met.len());
        for hit in met {
            assert_eq!(a.path(hit.occurrence), b.path(hit.occurrence));
        }
    }
}

/// Saved, opened and saved again: the same answers, and the same bytes.
#[test]
fn a_scene_that_was_opened_answers_like_the_one_that_was_saved() {
    let (folder, context) = (Folder::new(), built::context(1));
    let models = folder.open(&context);
    let cases = [(flat(&context, &models, 700, 1), 8.0, 200), (nested(&context, &models, 40), 90.0, 100)];
    for (scene, reach, least) in cases {
        let [first, second] = ["first.oc", "second.oc"].map(|name| folder.at(name));
        let bytes = scene.save(&first).expect("a file");
        assert_eq!(bytes, std::fs::metadata(&first).expect("a file").len());
        let opened = Scene::open(&context, &first).expect("a scene");
        assert_alike(&scene, &opened, reach, least);
        assert_eq!(opened.save(&second).expect("a file"), bytes);
        assert!(std::fs::read(&first).expect("a file") == std::fs::read(&second).expect("a file"));
        // The edits that both take are the same.
        for it in [&scene, &opened] {
            it.set_instance_look(1000, Look::default()).ok();
            it.add_instance(&models[0], 50_000, DAffine3::from_translation(DVec3::splat(2.0))).expect("an instance");
            it.commit().expect("a commit");
        }
        assert_alike(&scene, &opened, reach, least);
        for (it, path) in [(&scene, &first), (&opened, &second)] {
            it.save(path).expect("a file");
        }
        assert!(std::fs::read(&first).expect("a file") == std::fs::read(&second).expect("a file"));
    }
}

/// An empty scene, and a scene of empty ones.
#[test]
fn scenes_without_instances_are_saved() {
    let (folder, context) = (Folder::new(), built::context(1));
    let (empty, outer) = (Scene::new(&context), Scene::new(&context));
    outer.add_scene(&empty, 1, DAffine3::IDENTITY).expect("a scene");
    outer.commit().expect("a commit");
    for scene in [&empty, &outer] {
        scene.save(folder.at("scene.oc")).expect("a file");
        let opened = Scene::open(&context, folder.at("scene.oc")).expect("a scene");
        assert_eq!(opened.state().instance_count(), 0);
    }
    // What was not committed is not saved.
    let model = &folder.open(&context)[0];
    empty.add_instance(model, 1, DAffine3::IDENTITY).expect("an instance");
    let before = std::fs::read(folder.at("scene.oc")).expect("a file").len();
    assert!(empty.save(folder.at("scene.oc")).expect("a file") < before as u64);
}

/// The folder can move with its models; from another folder the models are found too.
#[test]
fn models_are_named_from_the_folder_of_the_scene() {
    let (folder, context) = (Folder::new(), built::context(1));
    let scene = flat(&context, &folder.open(&context), 20, 2);
    std::fs::create_dir_all(folder.at("a/b")).expect("folders");
    for name in ["scene.oc", "a/b/scene.oc"] {
        scene.save(folder.at(name)).expect("a file");
    }
    let bytes = std::fs::read(folder.at("a/b/scene.oc")).expect("a file");
    let has = |path: &[u8]| bytes.windows(path.len()).any(|it| it == path);
    assert!(has(b"../../models/ball.oc") && has(b"../../model.oc"));
    let moved = tempfile::tempdir().expect("a folder");
    let there = moved.path().join("all");
    std::fs::rename(folder.dir.path(), &there).expect("a rename");
    for name in ["scene.oc", "a/b/scene.oc"] {
        let opened = Scene::open(&context, there.join(name)).expect("a scene");
        assert_alike(&scene, &opened, 8.0, 20);
    }
    std::fs::rename(&there, folder.dir.path()).expect("a rename");
}

fn why(result: Result<impl Sized, Error>) -> String {
    match result {
        Ok(_) => panic!("no error"),
        Err(error) => error.to_string(),
    }
}

/// A swapped or missing model is an error that names it; so is a file of the other kind.
#[test]
fn models_that_are_not_those_of_the_scene_are_refused() {
    let (folder, context) = (Folder::new(), built::context(1));
    let path = folder.at("scene.oc");
    flat(&context, &folder.open(&context), 5, 2).save(&path).expect("a file");
    let [ball, cube] = folder.models.each_ref().map(|path| std::fs::read(path).expect("a model"));
    std::fs::write(&folder.models[0], &cube).expect("a file");
    let swapped = Scene::open(&context, &path);
    assert!(matches!(swapped, Err(Error::Corrupt { .. })));
    let text = why(swapped);
    assert!(text.contains("scene.oc") && text.contains("ball.oc") && text.contains("is not the file"), "{text}");
    std::fs::remove_file(&folder.models[0]).expect("a removal");
    let missing = Scene::open(&context, &path);
    assert!(matches!(&missing, Err(Error::Io { .. })) && why(missing).contains("ball.oc"));
    std::fs::write(&folder.models[0], &ball).expect("a file");
    Scene::open(&context, &path).expect("a scene");
    assert!(why(Scene::open(&context, &folder.models[0])).contains("a model file, not a scene file"));
    assert!(why(Model::open(&context, &path)).contains("a scene file, not a model file"));
}

/// What a file does not hold is an error that names it, and an older file stays as it is.
#[test]
fn what_cannot_be_saved_is_named() {
    let (folder, context) = (Folder::new(), built::context(1));
    let (models, path) = (folder.open(&context), folder.at("scene.oc"));
    let refused = |scene: &Scene, has: &[&str]| {
        std::fs::write(&path, "before").expect("a file");
        let result = scene.save(&path);
        assert!(matches!(result, Err(Error::BadState(_))));
        let text = why(result);
        assert!(has.iter().all(|it| text.contains(it)), "{text}");
        assert_eq!(std::fs::read(&path).expect("a file"), b"before");
    };
    let scene = flat(&context, &models, 5, 2);
    scene.set_parts_look(102, &[5], Scope::Own, HIDDEN).expect("a look");
    scene.commit().expect("a commit");
    refused(&scene, &["instance 102", "looks of parts"]);
    let outer = Scene::new(&context);
    outer.add_scene(&scene, 4, DAffine3::IDENTITY).expect("a scene");
    outer.commit().expect("a commit");
    refused(&outer, &["instance 102", "looks of parts"]);
    scene.clear_part_looks(102).expect("a look");
    scene.commit().expect("a commit");
    outer.commit().expect("a commit");
    outer.set_occurrence_look(3, RED).expect("a look");
    outer.commit().expect("a commit");
    refused(&outer, &["occurrence", "4, 6"]);

    let bytes = std::fs::read(&folder.models[0]).expect("a model");
    let model = Model::open_source(&context, Arc::new(MemorySource::named("from memory", bytes))).expect("a model");
    let scene = Scene::new(&context);
    scene.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    refused(&scene, &["from memory", "not opened from a file"]);

    // A model is not overwritten, nor is one saved that was replaced.
    let scene = flat(&context, &models, 5, 2);
    assert!(matches!(scene.save(&folder.models[1]), Err(Error::BadArgument(_))));
    let cube = std::fs::read(&folder.models[1]).expect("a model");
    std::fs::rename(&folder.models[0], folder.at("kept.oc")).expect("a rename");
    std::fs::write(&folder.models[0], cube).expect("a file");
    refused(&scene, &["ball.oc", "replaced"]);
    assert!(matches!(scene.save(folder.at("none/scene.oc")), Err(Error::Io { .. })));
}

/// An opened scene takes the memory of the budget that the built one takes, and gives it back.
#[test]
fn memory_counts_as_for_built_scenes() {
    let folder = Folder::new();
    let context = |memory_budget| {
        Context::new(ContextOptions { threads: 1, memory_budget, ..ContextOptions::default() }).expect("a context")
    };
    let large = context(1 << 30);
    let models = folder.open(&large);
    let before = large.memory_used();
    let scene = flat(&large, &models, 40_000, 4);
    let built = large.memory_used() - before;
    scene.save(folder.at("scene.oc")).expect("a file");
    drop((scene, models));
    // Until the workers have ended, they may hold what a form of the models takes.
    let settled = |context: &Context| {
        let mut used = context.memory_used();
        for _ in 0..200 {
            std::thread::sleep(std::time::Duration::from_millis(5));
            let now = context.memory_used();
            if now == used {
                break;
            }
            used = now;
        }
        used
    };
    let opened = Scene::open(&large, folder.at("scene.oc")).expect("a scene");
    let took = settled(&large);
    assert!(took > built * 9 / 10 && took < built * 11 / 10 + (4 << 20), "{took} bytes, {built} when it was built");
    drop(opened);
    assert_eq!(settled(&large), 0);
    let error = Scene::open(&context(16 << 20), folder.at("scene.oc")).err().expect("an error");
    assert!(matches!(error, Error::OverBudget { .. }), "{error}");
}

/// The golden files, of both formats; true: members of arrays have masks and tints.
const GOLDEN: [(&str, bool); 2] = [("golden_0_1.bin", false), ("golden.bin", true)];

/// A golden file: bytes with the size and hash of the folder's own `model.oc`.
fn golden(folder: &Folder, name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scene_files").join(name);
    let mut bytes = std::fs::read(path).expect("the golden file");
    let model = std::fs::read(&folder.models[1]).expect("a model");
    // The row of the only model follows the header and two lights.
    let row = 96 + 2 * 48;
    bytes[row..row + 8].copy_from_slice(&(model.len() as u64).to_le_bytes());
    bytes[row + 8..row + 16].copy_from_slice(&xxhash_rust::xxh3::xxh3_64(&model[..256]).to_le_bytes());
    sealed(bytes)
}

/// Bytes with the checksums that they should have.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let end = bytes.len() - 8;
    let sum = xxhash_rust::xxh3::xxh3_64(&bytes[..88]).to_le_bytes();
    bytes[88..96].copy_from_slice(&sum);
    let sum = xxhash_rust::xxh3::xxh3_64(&bytes[..end]).to_le_bytes();
    bytes[end..].copy_from_slice(&sum);
    bytes
}

/// A scene of all kinds of rows: the content of the golden files. `has_lists`: members of arrays have masks and tints.
fn small(context: &Context, model: &Model, has_lists: bool) -> Scene {
    let mut rng = Rng::new(6);
    let scene = Scene::new(context);
    scene.add_instance(model, 7, map(&mut rng, 2.0)).expect("an instance");
    scene.add_instance(model, 5, map(&mut rng, 2.0)).expect("an instance");
    scene.set_instance_look(5, RED).expect("a look");
    let models = || Prototypes::Models(vec![model.clone()]);
    let of_three = transforms(2, 3, (&mut rng, 3.0));
    add(&scene, (models(), Arc::from([])), of_three, 20);
    if has_lists {
        scene.set_masks(20, &[1, 6, u32::MAX]).expect("masks");
        scene.set_tints(21, &[[255, 128, 0, 255]]).expect("a tint");
    }
    scene.set_instance_mask(21, 2).expect("a mask");
    scene.commit().expect("a commit");
    let outer = Scene::new(context);
    outer.add_scene(&scene, 1, map(&mut rng, 9.0)).expect("a scene");
    outer.set_instance_mask(1, 3).expect("a mask");
    add(&outer, (models(), Arc::from([0, 0])), transforms(1, 2, (&mut rng, 9.0)), 30);
    let scenes = Prototypes::Scenes(vec![scene.clone()]);
    add(&outer, (scenes, Arc::from([])), transforms(0, 2, (&mut rng, 9.0)), 40);
    if has_lists {
        outer.set_masks(41, &[5]).expect("a mask");
        outer.set_tints(40, &[[10, 20, 30, 40]]).expect("a tint");
    }
    outer.set_instance_look(41, HIDDEN).expect("a look");
    let sun = LightKind::Directional(DVec3::new(0.5, 0.25, -1.0));
    let sun = Light { kind: sun, colour: [1.0, 0.5, 0.25], intensity: 2.0, shadows: true };
    outer.set_lights(vec![Light::HEADLIGHT, sun]).expect("lights");
    outer.commit().expect("a commit");
    outer
}

fn add(scene: &Scene, of: (Prototypes, Arc<[u32]>), transforms: Transforms, first_id: u64) {
    let (prototypes, prototype_of) = of;
    let array = Instances { prototypes, prototype_of, transforms, first_id, mask: u32::MAX, masks: None, tints: None };
    scene.add_instances(&array).expect("an array");
}

/// The format does not change by accident: a file of an earlier day opens, and is the same when it is saved again. Only
/// the size and the hash of its model are those of this day, as the format of models changes for other reasons. With
/// `OUTCROP_WRITE_GOLDEN` set the file of the newest format is written anew.
#[test]
fn a_golden_file_stays_as_it_is() {
    let (folder, context) = (Folder::new(), built::context(1));
    let path = folder.at("scene.oc");
    if std::env::var_os("OUTCROP_WRITE_GOLDEN").is_some() {
        // That of an older format stays as it is.
        let (name, has_lists) = GOLDEN[1];
        small(&context, &folder.open(&context)[1], has_lists).save(&path).expect("a file");
        let to = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scene_files").join(name);
        std::fs::copy(&path, to).expect("a copy");
        return;
    }
    for (name, has_lists) in GOLDEN {
        stays_as_it_is(&folder, &context, name, has_lists);
    }
}

fn stays_as_it_is(folder: &Folder, context: &Context, name: &str, has_lists: bool) {
    let path = folder.at("scene.oc");
    let bytes = golden(folder, name);
    assert_eq!(bytes[10..12], [1 + u8::from(has_lists), 0], "the minor version");
    std::fs::write(&path, &bytes).expect("a file");
    let opened = Scene::open(context, &path).expect("a scene");
    let state = opened.state();
    assert_eq!(state.instance_count(), 2 + 3 * 5);
    let ways: Vec<Vec<u64>> = (0..17).map(|number| state.path(number).expect("a way").0).collect();
    assert_eq!(ways[..4], [vec![30], vec![31], vec![1, 7], vec![1, 5]]);
    assert_eq!(ways[16], [41, 22]);
    opened.save(folder.at("again.oc")).expect("a file");
    assert!(std::fs::read(folder.at("again.oc")).expect("a file") == bytes);
    let built = small(context, &folder.open(context)[1], has_lists);
    assert_alike(&built, &opened, 10.0, 10);
}
