//! Where the system gives no memory for something large, that is an error which says how much for what, and what was
//! there goes on. In a process of its own, for the limit is the process's.
#![cfg(target_os = "linux")]

mod common;

use common::built::{self, Part};
use common::scenes;
use glam::DVec3;
use outcrop::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::Camera;
use std::sync::Arc;
use std::time::Duration;

/// Address space of this process in bytes.
fn taken() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:")).unwrap();
    line.trim().strip_suffix(" kB").unwrap().parse::<u64>().unwrap() << 10
}

/// Gives the process no more than `more` bytes beside what it has.
fn limit(more: u64) {
    let limit = libc::rlimit { rlim_cur: taken() + more, rlim_max: libc::RLIM_INFINITY };
    // SAFETY: a limit that lives through the call.
    assert_eq!(unsafe { libc::setrlimit(libc::RLIMIT_AS, &raw const limit) }, 0);
}

#[test]
fn what_is_too_large_is_refused_and_all_else_goes_on() {
    let context = built::context(2);
    let file = built::parts(&[Part::white(1, scenes::sphere(60, 120))]);
    let (scene, _) = built::scene(&context, &file);
    let camera = Camera::Perspective { eye: DVec3::Z * 4.0, at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 45.0 };
    let settings = FrameSettings::default();
    let mut builder = Builder::new(
        BuildOptions { threads: 2, ..BuildOptions::default() },
        Arc::new(Progress::default()),
        Cancel::new(),
    )
    .unwrap();
    let part = builder.part(PartDesc::default()).unwrap();
    let tris = scenes::sphere(1000, 2000);
    builder.triangles(MeshKey::DIRECT, part, &tris, Attributes::NONE).unwrap();
    limit(192 << 20);

    // 65 GB, and 1.2 GB.
    for (width, height, outputs) in [(1 << 15, 1 << 15, Outputs::ALL), (5000, 4000, Outputs::ALL)] {
        let error = Frame::new(&context, FrameOptions { width, height, outputs, ..FrameOptions::default() })
            .map(drop)
            .unwrap_err();
        assert!(
            matches!(&error, Error::NoMemory { bytes, .. } if *bytes >= u64::from(width) * u64::from(height)),
            "{error}"
        );
        assert!(error.to_string().starts_with(&format!("a buffer of {width}x{height} pixels")), "{error}");
    }
    let frame =
        Frame::new(&context, FrameOptions { width: 64, height: 48, outputs: Outputs::ALL, ..FrameOptions::default() })
            .unwrap();
    let renders = || {
        frame.request(&scene.state(), &camera, &settings).unwrap();
        assert_eq!(frame.wait(Duration::from_secs(60)).state, FrameState::Converged);
    };
    renders();
    assert!(matches!(frame.resize(1 << 15, 1 << 15), Err(Error::NoMemory { .. })));
    renders();
    // Two pictures fit, one that is mapped and one that is shown; a third to render beside them does not: the request
    // is refused, and what is shown stays.
    frame.resize(1100, 1000).unwrap();
    renders();
    let mapped = frame.map(Buffer::Depth).unwrap();
    renders();
    let before = frame.poll();
    assert!(matches!(frame.request(&scene.state(), &camera, &settings), Err(Error::NoMemory { .. })));
    let after = frame.poll();
    assert_eq!((after.state, after.request, after.pictures), (FrameState::Converged, before.request, before.pictures));
    assert!(mapped.floats().unwrap().iter().any(|depth| depth.is_finite()));
    drop(mapped);
    renders();

    let folder = tempfile::tempdir().unwrap();
    let error = builder.finish(&folder.path().join("m.oc")).unwrap_err();
    assert!(matches!(&error, Error::NoMemory { bytes, .. } if *bytes > 200 << 20), "{error}");
    assert!(error.to_string().starts_with(&format!("a tree of {} triangles", tris.len())), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
