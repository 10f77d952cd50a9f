//! Builds that end badly: the old file stays, temporaries go, and the error says what it was.

use glam::{DAffine3, DVec3};
use outcrop::Error;
use outcrop::base::progress::{Cancel, Phase, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::store::ModelFile;
use std::fs;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

struct Watched {
    builder: Builder,
    progress: Arc<Progress>,
    cancel: Cancel,
}

/// A builder with `count` triangles on a bumpy plane.
fn filled(count: usize, options: BuildOptions) -> Watched {
    let (progress, cancel) = (Arc::new(Progress::default()), Cancel::new());
    let mut builder = Builder::new(options, progress.clone(), cancel.clone()).unwrap();
    let part = builder.part(PartDesc::default()).unwrap();
    let triangle = |i: usize| {
        let (x, y) = ((i % 1000) as f64, (i / 1000) as f64);
        let z = (x * 12.9898 + y * 78.233).sin();
        [DVec3::new(x, y, z), DVec3::new(x + 1.0, y, -z), DVec3::new(x, y + 1.0, 0.5)]
    };
    let triangles: Vec<_> = (0..count).map(triangle).collect();
    builder.triangles(MeshKey::DIRECT, part, &triangles, Attributes::NONE).unwrap();
    Watched { builder, progress, cancel }
}

fn one_thread() -> BuildOptions {
    BuildOptions { threads: 1, ..BuildOptions::default() }
}

fn build(count: usize, out: &Path) -> outcrop::Result<BuildReport> {
    filled(count, one_thread()).builder.finish(out)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A folder with `model.oc` in it, whose content is "old".
fn with_old_file() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    fs::write(&path, "old").unwrap();
    (dir, path)
}

fn assert_untouched(dir: &Path) {
    assert_eq!(fs::read(dir.join("model.oc")).unwrap(), b"old");
    assert_eq!(names(dir), ["model.oc"]);
}

fn assert_io_about(result: outcrop::Result<BuildReport>, path: &Path) {
    match result {
        Err(Error::Io { path: named, .. }) => assert_eq!(named, path),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_good_build_replaces_the_old_file() {
    let (dir, path) = with_old_file();
    let report = build(1000, &path).unwrap();
    assert_eq!(names(dir.path()), ["model.oc"]);
    let file = ModelFile::open_path(&path).unwrap();
    assert_eq!(file.check(&Progress::default(), &Cancel::new()).unwrap().bytes, report.bytes);
}

#[test]
fn where_no_file_can_be() {
    let (dir, path) = with_old_file();
    for out in [
        dir.path().join("none/model.oc"),
        path.join("model.oc"),
        dir.path().to_path_buf(),
        "/dev/full".into(),
        "".into(),
    ] {
        assert_io_about(build(10, &out), &out);
    }
    assert!(fs::metadata("/dev/full").is_ok_and(|m| !m.is_file()));
    assert_untouched(dir.path());
}

#[cfg(unix)]
#[test]
fn a_folder_that_may_not_be_written() {
    use std::os::unix::fs::PermissionsExt;
    let (dir, path) = with_old_file();
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o555)).unwrap();
    let privileged = fs::write(dir.path().join("probe"), "").is_ok();
    if privileged {
        // Root may write anywhere but there.
        let out = Path::new("/proc/model.oc");
        assert_io_about(build(10, out), out);
        fs::remove_file(dir.path().join("probe")).unwrap();
    } else {
        assert_io_about(build(10, &path), &path);
    }
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o755)).unwrap();
    assert_untouched(dir.path());
}

#[test]
fn cancelled_before_it_begins() {
    let (dir, path) = with_old_file();
    let Watched { builder, cancel, .. } = filled(1000, one_thread());
    cancel.cancel();
    assert!(matches!(builder.finish(&path), Err(Error::Cancelled)));
    assert_untouched(dir.path());
}

#[test]
fn cancelled_at_any_moment() {
    let (dir, path) = with_old_file();
    for threads in [1, 2] {
        let whole = {
            let Watched { builder, .. } = filled(60_000, BuildOptions { threads, ..BuildOptions::default() });
            let began = Instant::now();
            builder.finish(&path).unwrap();
            began.elapsed()
        };
        let mut cancelled = 0;
        for step in 0..12 {
            fs::write(&path, "old").unwrap();
            let Watched { builder, cancel, .. } = filled(60_000, BuildOptions { threads, ..BuildOptions::default() });
            let out = path.clone();
            let build = std::thread::spawn(move || builder.finish(&out));
            std::thread::sleep(whole * step / 12);
            cancel.cancel();
            match build.join().unwrap() {
                Err(Error::Cancelled) => {
                    cancelled += 1;
                    assert_untouched(dir.path());
                }
                // It had ended, or there was nothing left to ask.
                Ok(_) => drop(ModelFile::open_path(&path).unwrap()),
                Err(e) => panic!("{e}"),
            }
        }
        assert!(cancelled > 0);
    }
}

#[test]
fn cancelled_while_it_writes() {
    let (dir, path) = with_old_file();
    let Watched { builder, cancel, progress } = filled(200_000, one_thread());
    let out = path.clone();
    let build = std::thread::spawn(move || builder.finish(&out));
    let began = Instant::now();
    while progress.phase() < Phase::Write && began.elapsed() < Duration::from_secs(60) && !build.is_finished() {
        std::thread::yield_now();
    }
    cancel.cancel();
    match build.join().unwrap() {
        Err(Error::Cancelled) => assert_untouched(dir.path()),
        Ok(_) => drop(ModelFile::open_path(&path).unwrap()),
        Err(e) => panic!("{e}"),
    }
}

/// `src/import/change_tests.rs` has each kind of change, and each format.
#[test]
fn an_input_that_is_written_again_while_it_is_read_fails_the_build() {
    let inputs = tempfile::tempdir().unwrap();
    let input = inputs.path().join("input.obj");
    let square = |z: usize| format!("v 0 0 {z}\nv 1 0 {z}\nv 1 1 {z}\nv 0 1 {z}\nf -4 -3 -2 -1\n");
    let text: String = (10_000..25_000).map(square).collect();
    fs::write(&input, &text).unwrap();
    let build = |path: &Path| -> outcrop::Result<BuildReport> {
        let mut builder = Builder::new(one_thread(), Arc::new(Progress::default()), Cancel::new())?;
        builder.add_file(&input)?;
        builder.finish(path)
    };
    let ended = std::sync::atomic::AtomicBool::new(false);
    let failed = std::thread::scope(|scope| {
        scope.spawn(|| {
            // The clock of a file system may be too coarse for a test.
            let mut time = std::time::SystemTime::now();
            let mut file = fs::File::options().write(true).open(&input).unwrap();
            while !ended.load(std::sync::atomic::Ordering::SeqCst) {
                time += Duration::from_secs(1);
                file.rewind().and_then(|()| file.write_all(text.as_bytes())).unwrap();
                file.set_modified(time).unwrap();
            }
        });
        // On a busy machine the other thread may not run while the file is read.
        let failed = (0..100).find_map(|_| {
            let (dir, path) = with_old_file();
            build(&path).err().map(|error| (dir, error))
        });
        ended.store(true, std::sync::atomic::Ordering::SeqCst);
        failed
    });
    let (dir, error) = failed.expect("a build that fails");
    assert!(matches!(&error, Error::Parse { file, why, .. } if *file == input && why.contains("changed")), "{error:?}");
    assert_untouched(dir.path());
    let (_dir, path) = with_old_file();
    assert_eq!(build(&path).unwrap().triangles_in, 30_000);
}

#[test]
fn what_contradicts_itself_is_refused_where_it_is_said() {
    let mut builder = Builder::new(one_thread(), Arc::new(Progress::default()), Cancel::new()).unwrap();
    let refused = |result: outcrop::Result<()>| assert!(matches!(result, Err(Error::BadArgument(_))), "{result:?}");
    let some = [[DVec3::ZERO, DVec3::X, DVec3::Y]];
    refused(builder.triangles(MeshKey::DIRECT, 0, &some, Attributes::NONE));
    refused(builder.triangles(MeshKey(9), 0, &some, Attributes::NONE));
    refused(builder.part(PartDesc { parent: Some(0), ..PartDesc::default() }).map(|_| ()));
    refused(builder.part(PartDesc { material: Some(9), ..PartDesc::default() }).map(|_| ()));
    refused(builder.shared_mesh(0).map(|_| ()));
    refused(builder.shared_mesh(u32::MAX).map(|_| ()));
    let part = builder.part(PartDesc::default()).unwrap();
    let mesh = builder.shared_mesh(2).unwrap();
    refused(builder.triangles(mesh, 2, &some, Attributes::NONE));
    refused(builder.instance(mesh, DAffine3::IDENTITY, part));
    builder.part(PartDesc::default()).unwrap();
    for flat in [
        DAffine3::ZERO,
        DAffine3::from_scale(DVec3::new(1.0, f64::NAN, 1.0)),
        DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)),
    ] {
        refused(builder.instance(mesh, flat, part));
    }
    refused(builder.instance(MeshKey::DIRECT, DAffine3::IDENTITY, part));
    refused(builder.triangles(MeshKey::DIRECT, part, &some, Attributes::colours(&[])));
    builder.instance(mesh, DAffine3::IDENTITY, part).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let report = builder.finish(&dir.path().join("model.oc")).unwrap();
    assert_eq!((report.triangles_in, report.instances), (0, 1));
}

/// A mesh of more parts than there are can be placed nowhere; one that is placed nowhere cannot be seen.
#[test]
fn a_shared_mesh_that_is_placed_nowhere_is_left_out_and_said() {
    let dir = tempfile::tempdir().unwrap();
    let some = [[DVec3::ZERO, DVec3::X, DVec3::Y], [DVec3::ZERO, DVec3::X, DVec3::Z]];
    let build = |name: &str, unplaced: &[u32]| {
        let mut builder = Builder::new(one_thread(), Arc::new(Progress::default()), Cancel::new()).unwrap();
        let part = builder.part(PartDesc::default()).unwrap();
        let mesh = builder.shared_mesh(1).unwrap();
        builder.triangles(mesh, 0, &some, Attributes::NONE).unwrap();
        builder.instance(mesh, DAffine3::IDENTITY, part).unwrap();
        for &parts in unplaced {
            let mesh = builder.shared_mesh(parts).unwrap();
            builder.triangles(mesh, parts - 1, &some[..1], Attributes::NONE).unwrap();
        }
        let path = dir.path().join(name);
        let report = builder.finish(&path).unwrap();
        assert_eq!((report.triangles_in, report.triangles_kept), (2 + unplaced.len() as u64, 2));
        ModelFile::open_path(&path).unwrap();
        report
    };
    assert!(build("placed.oc", &[]).notes.is_empty());
    let report = build("not.oc", &[1, 5, u32::MAX - 1]);
    assert_eq!(report.notes, ["3 shared meshes have no instances: their 3 triangles were left out"]);
}

#[test]
fn nothing_is_a_model_too() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    let builder = Builder::new(one_thread(), Arc::new(Progress::default()), Cancel::new()).unwrap();
    let report = builder.finish(&path).unwrap();
    assert_eq!((report.triangles_in, report.blocks), (0, 0));
    let file = ModelFile::open_path(&path).unwrap();
    file.check(&Progress::default(), &Cancel::new()).unwrap();
    assert_eq!(file.header().triangles_kept, 0);
}

/// In processes of their own: a limit on files, and a kill.
#[cfg(unix)]
mod in_a_process {
    use super::*;
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};

    const PATH: &str = "OUTCROP_TEST_FAILING_BUILD";

    /// Not a test by itself: one build; says what became of it.
    #[test]
    fn child() {
        let Some(path) = std::env::var_os(PATH).map(PathBuf::from) else { return };
        let Watched { builder, .. } = filled(400_000, one_thread());
        println!("begins");
        match builder.finish(&path) {
            Ok(_) => std::process::exit(4),
            Err(e) => println!("ended: {e}"),
        }
        std::process::exit(3);
    }

    fn command(shell: &str, path: &Path) -> Command {
        let mut command = Command::new("sh");
        let me = std::env::current_exe().unwrap();
        command
            .args(["-c", &format!("{shell} exec \"$0\" --exact failing_builds::in_a_process::child --nocapture")])
            .arg(me);
        command.env(PATH, path).stdout(Stdio::piped());
        command
    }

    #[test]
    fn out_of_space() {
        let (dir, path) = with_old_file();
        // A limit on the size of files stands for a full disk; the signal is turned into an error.
        let out = command("trap '' XFSZ; ulimit -f 2000;", &path).output().unwrap();
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        assert_eq!(out.status.code(), Some(3), "{said}");
        assert!(said.contains("model.oc: write failed"), "{said}");
        assert_untouched(dir.path());
    }

    #[test]
    fn killed() {
        let (dir, path) = with_old_file();
        let mut child = command("", &path).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(lines.by_ref().any(|line| line.unwrap().contains("begins")));
        let began = Instant::now();
        while names(dir.path()).len() == 1 && began.elapsed() < Duration::from_secs(60) {
            std::thread::yield_now();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"old");
        // A temporary may be left; the next build to the same name removes it.
        build(100, &path).unwrap();
        assert_eq!(names(dir.path()), ["model.oc"]);
        ModelFile::open_path(&path).unwrap();
    }
}

/// The fraction moves in each phase: a watcher that samples it sees more than one value in each phase that takes a
/// while, it never falls, and it takes no large step.
#[test]
fn the_progress_moves_in_all_phases() {
    let dir = tempfile::tempdir().unwrap();
    for (threads, memory_budget, count) in [(1, 0, 40_000), (2, 0, 40_000), (1, 32 << 20, 80_000)] {
        let options = BuildOptions { threads, memory_budget, ..BuildOptions::default() };
        let Watched { builder, progress, .. } = filled(count, options);
        let out = dir.path().join("model.oc");
        assert_eq!((progress.phase(), progress.fraction()), (Phase::Read, 0.0));
        let report = builder.finish(&out).unwrap();
        assert_eq!(report.chunks > 1, memory_budget > 0);
        assert_eq!((progress.phase(), progress.fraction()), (Phase::Done, 1.0));
        for (phase, least) in [(Phase::Build, 20), (Phase::Write, 4)] {
            let steps = progress.steps(phase);
            println!("{threads} threads, budget {memory_budget}: {steps} steps in {phase:?}");
            assert!(steps >= least, "{threads} threads, budget {memory_budget}: {steps} steps in {phase:?}");
        }
    }
}

/// A model with colours and more than one block could not be sealed: blocks of nodes alone had no block
/// of colours.
#[test]
fn colours_in_many_blocks() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    let Watched { mut builder, .. } = filled(20_000, one_thread());
    builder
        .triangles(MeshKey::DIRECT, 0, &[[DVec3::ZERO, DVec3::X, DVec3::Y]], Attributes::colours(&[[[0.5; 3]; 3]]))
        .unwrap();
    let report = builder.finish(&path).unwrap();
    assert!(report.blocks > 4, "{} blocks test little", report.blocks);
    let file = ModelFile::open_path(&path).unwrap();
    assert!(file.header().has_colours);
    assert_eq!(u64::from(file.block_count()), (3 + u64::from(file.header().has_normals)) * report.blocks);
}
