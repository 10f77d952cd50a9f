//! The system fails at each of its calls in turn: opens, reads, writes, syncs, renames and starts of threads, of a
//! small build, an open, queries and a picture. Each time the result is an error or the right answer, the old file is
//! whole, nothing is left behind, and everything ends. In a process of its own: it replaces functions of the C library.
#![cfg(target_os = "linux")]

mod common;
#[path = "system_faults/crash.rs"]
mod crash;
#[path = "system_faults/libc_calls.rs"]
mod libc_calls;

use common::built::{self, Part};
use common::scenes;
use glam::{DAffine3, DVec3};
use libc_calls::{Call, fail_at};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, QueryOptions};
use outcrop::scene::{Camera, Context, ContextOptions, Model, Scene, SceneState};
use outcrop::store::ModelFile;
use outcrop::{Error, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// The replaced functions are those of the process: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(|e| e.into_inner())
}

const LONG: Duration = Duration::from_secs(60);

/// Mesh files that refer to others, in a folder.
struct Inputs {
    folder: tempfile::TempDir,
}

impl Inputs {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let sphere = scenes::sphere(24, 48);
        let mut obj = String::from("mtllib a.mtl\nusemtl red\n");
        for [a, b, c] in &sphere {
            for v in [a, b, c] {
                obj += &format!("v {} {} {}\n", v.x, v.y, v.z);
            }
            obj += "f -3 -2 -1\n";
        }
        let gltf = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"scene":0,
            "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
            "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
            "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"uri":"a.bin","byteLength":36}]}"#;
        let corners: Vec<u8> = [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|x| x.to_le_bytes()).collect();
        for (name, bytes) in [
            ("a.obj", obj.as_bytes()),
            ("a.mtl", b"newmtl red\nKd 1 0 0\n"),
            ("a.gltf", gltf.as_bytes()),
            ("a.bin", &corners),
        ] {
            std::fs::write(folder.path().join(name), bytes).expect("an input");
        }
        Self { folder }
    }

    /// Builds both files into one model.
    fn build(&self, out: &Path, options: BuildOptions) -> outcrop::Result<BuildReport> {
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new())?;
        builder.add_files(&[self.folder.path().join("a.obj"), self.folder.path().join("a.gltf")])?;
        builder.finish(out)
    }
}

/// A folder with `model.oc` in it, whose content is "old".
fn with_old_file() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("model.oc");
    std::fs::write(&path, "old").expect("the old file");
    (folder, path)
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    entries.map(|e| e.expect("an entry").file_name().into_string().expect("a name")).collect()
}

/// The error is the system's, and names a file or what it was for.
fn is_io(error: &Error) {
    assert!(matches!(error, Error::Io { .. }), "{error:?}");
}

/// Fails every `step`-th call of this kind in turn while `work` runs; `judge` takes each result, and whether a call
/// failed. Returns the number of the call that there was not.
fn at_each<T>(call: Call, step: usize, mut work: impl FnMut() -> T, mut judge: impl FnMut(T, u32, bool)) -> u32 {
    for n in (0..10_000).step_by(step) {
        let (result, failed) = fail_at(call, n, &mut work);
        judge(result, n, failed);
        if !failed {
            return n;
        }
    }
    panic!("{call:?}: too many calls");
}

/// Builds of `threads` threads while each call of each kind fails.
fn builds(threads: usize, calls: &[(Call, u32)]) {
    let inputs = Inputs::new();
    let (folder, path) = with_old_file();
    let temp_dir = tempfile::tempdir().expect("a folder");
    for &(call, least) in calls {
        let build = || {
            std::fs::write(&path, "old").expect("the old file");
            let temp_dir = Some(temp_dir.path().to_path_buf());
            libc_calls::armed(|| inputs.build(&path, BuildOptions { threads, temp_dir, ..BuildOptions::default() }))
        };
        let count = at_each(call, 1, build, |result, n, failed| {
            let what = format!("{call:?} {n} of a build with {threads} threads");
            assert_eq!(names(folder.path()), ["model.oc"], "{what}");
            assert!(names(temp_dir.path()).is_empty(), "{what}");
            match result {
                Ok(report) => {
                    // A failure may be one that does not matter, as that of an advice to the system.
                    assert_eq!(report.triangles_in, 24 * 48 * 2 - 2 * 48 + 1, "{what}");
                    let model = Model::open(&context(0), &path).expect("a model");
                    model.check(&Cancel::new()).expect("a sound model");
                }
                Err(error) => {
                    assert!(failed, "{what}: {error}");
                    is_io(&error);
                    let renamed = matches!(&error, Error::Io { doing: "syncing the folder", .. });
                    if !renamed {
                        assert_eq!(std::fs::read(&path).expect("the old file"), b"old", "{what}: {error}");
                    }
                }
            }
        });
        assert!(count >= least, "{call:?}: only {count} calls");
        println!("{count} calls of {call:?} in a build with {threads} threads");
    }
}

#[test]
fn builds_while_the_system_fails() {
    let _alone = alone();
    builds(
        1,
        &[(Call::Open, 6), (Call::Read, 3), (Call::Write, 2), (Call::Sync, 2), (Call::Rename, 1), (Call::Thread, 0)],
    );
    builds(3, &[(Call::Thread, 3), (Call::Write, 2)]);
}

/// A build that is too large for its memory, and keeps triangles in scratch files.
#[test]
fn builds_with_scratch_files_while_the_system_fails() {
    let _alone = alone();
    let (folder, path) = with_old_file();
    let temp_dir = tempfile::tempdir().expect("a folder");
    let triangles = scenes::bumpy_sphere(200, 400, 5);
    let build = || {
        std::fs::write(&path, "old").expect("the old file");
        let temp_dir = Some(temp_dir.path().to_path_buf());
        let options = BuildOptions { threads: 1, memory_budget: 32 << 20, temp_dir, ..BuildOptions::default() };
        libc_calls::armed(|| -> outcrop::Result<BuildReport> {
            let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new())?;
            let part = builder.part(PartDesc::default())?;
            triangles
                .chunks(4096)
                .try_for_each(|some| builder.triangles(MeshKey::DIRECT, part, some, Attributes::NONE))?;
            builder.finish(&path)
        })
    };
    for (call, step, least) in [(Call::Open, 4, 8), (Call::Read, 23, 40), (Call::Write, 13, 20), (Call::Sync, 2, 2)] {
        let count = at_each(call, step, build, |result, n, failed| {
            let what = format!("{call:?} {n} of a build with scratch files");
            assert_eq!(names(folder.path()), ["model.oc"], "{what}");
            assert!(names(temp_dir.path()).is_empty(), "{what}");
            match result {
                Ok(report) => {
                    let sound = ModelFile::open_path(&path)
                        .and_then(|file| file.check(&Progress::default(), &Cancel::new()))
                        .is_ok();
                    assert!(sound && report.chunks > 1, "{what}: {report:?}");
                }
                Err(error) => {
                    assert!(failed, "{what}: {error}");
                    is_io(&error);
                }
            }
        });
        assert!(count >= least, "{call:?}: only {count} calls");
        println!("{count} calls of {call:?} in a build with scratch files");
    }
}

fn context(threads: usize) -> Context {
    Context::new(ContextOptions { threads, memory_budget: 64 << 20, ..ContextOptions::default() }).expect("a context")
}

fn open(context: &Context, path: &Path) -> outcrop::Result<(Model, Arc<SceneState>)> {
    let model = Model::open(context, path)?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    scene.commit()?;
    Ok((model, scene.state()))
}

fn rays() -> Vec<Ray> {
    (0..50)
        .map(|i| Ray::new(DVec3::new(0.1, 0.2, 4.0), DVec3::new(f64::from(i % 7) * 0.03, -0.05, -1.0).as_vec3()))
        .collect()
}

fn hits(state: &SceneState) -> outcrop::Result<Vec<Hit>> {
    let rays = rays();
    let mut hits = vec![Hit::MISS; rays.len()];
    state.closest(&rays, QueryOptions::default(), &mut hits).map(|()| hits)
}

/// A context, an open, a query and a picture, with what became of them.
fn ask(threads: usize, path: &Path) -> outcrop::Result<Vec<Hit>> {
    let options = ContextOptions { threads, memory_budget: 64 << 20, ..ContextOptions::default() };
    let context = Context::new(options)?;
    let (_model, state) = open(&context, path)?;
    let found = hits(&state)?;
    let frame =
        Frame::new(&context, FrameOptions { width: 24, height: 16, outputs: Outputs::ALL, ..Default::default() })?;
    let camera =
        Camera::Perspective { eye: DVec3::new(2.2, 1.3, 1.0), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 45.0 };
    frame.request(&state, &camera, &FrameSettings::default())?;
    let status = frame.wait(LONG);
    assert_ne!(status.state, FrameState::Running, "it does not end: {status:?}");
    match status.error {
        Some(error) => Err(Error::clone(&error)),
        None => Ok(found),
    }
}

#[test]
fn opens_queries_and_pictures_while_the_system_fails() {
    let _alone = alone();
    let file = built::parts(&[Part::white(1, scenes::bumpy_sphere(60, 120, 3))]);
    let expected = ask(0, &file.path).expect("answers");
    for (threads, calls) in
        [(0, &[(Call::Open, 1), (Call::Read, 4)][..]), (2, &[(Call::Open, 1), (Call::Read, 4), (Call::Thread, 2)])]
    {
        for &(call, least) in calls {
            let count = at_each(
                call,
                1,
                || libc_calls::armed(|| ask(threads, &file.path)),
                |result, n, failed| match result {
                    Ok(found) => assert!(found == expected, "{call:?} {n}, {threads} threads: wrong hits"),
                    Err(error) => {
                        assert!(failed, "{error}");
                        is_io(&error);
                    }
                },
            );
            assert!(count >= least, "{call:?}: only {count} calls");
            println!("{count} calls of {call:?}, {threads} threads");
        }
    }
}

/// A scene file is saved whole or not at all, and opened or refused with the system's error.
#[test]
fn scene_files_while_the_system_fails() {
    let _alone = alone();
    let file = built::parts(&[Part::white(1, scenes::bumpy_sphere(20, 30, 3))]);
    let context = context(0);
    let model = Model::open(&context, &file.path).expect("a model");
    let [tile, scene] = [Scene::new(&context), Scene::new(&context)];
    tile.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
    tile.commit().expect("a commit");
    scene.add_scene(&tile, 1, DAffine3::IDENTITY).expect("a scene");
    scene.commit().expect("a commit");
    let path = file.path.with_file_name("scene.oc");
    for (call, least) in [(Call::Open, 2), (Call::Read, 2), (Call::Write, 1), (Call::Sync, 1), (Call::Rename, 1)] {
        let save = || {
            std::fs::write(&path, "old").expect("the old file");
            libc_calls::armed(|| scene.save(&path))
        };
        let count = at_each(call, 1, save, |result, n, failed| {
            let what = format!("{call:?} {n} of saving");
            assert_eq!(names(file.path.parent().expect("a folder")).len(), 2, "{what}");
            match result {
                Ok(_) => assert!(hits(&Scene::open(&context, &path).expect("a scene").state()).is_ok(), "{what}"),
                Err(error) => {
                    assert!(failed, "{what}: {error}");
                    is_io(&error);
                    let renamed = matches!(&error, Error::Io { doing: "syncing the folder", .. });
                    let is_old = std::fs::read(&path).expect("the old file") == b"old";
                    assert!(renamed || is_old, "{what}: {error}");
                }
            }
        });
        assert!(count >= least, "{call:?}: only {count} calls");
    }
    scene.save(&path).expect("a file");
    let expected = hits(&scene.state()).expect("hits");
    for (call, least) in [(Call::Open, 2), (Call::Read, 4)] {
        let ask = || libc_calls::armed(|| Scene::open(&context, &path).and_then(|scene| hits(&scene.state())));
        let count = at_each(call, 1, ask, |result, n, failed| match result {
            Ok(found) => assert!(found == expected, "{call:?} {n}: wrong hits"),
            Err(error) => {
                assert!(failed, "{error}");
                is_io(&error);
            }
        });
        assert!(count >= least, "{call:?}: only {count} calls");
    }
}
