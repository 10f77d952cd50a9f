//! Requests of frames: refused, replaced, cancelled, resized; who is woken, and what callers may map meanwhile.

use crate::common::built;
use crate::common::frames::{LONG, all_bytes, busy_scene, fine_sphere, frame, perspective, render};
use glam::{DVec3, Vec3};
use outcrop::math::Ray;
use outcrop::query::{Hit, QueryOptions};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs, Target};
use outcrop::scene::{Camera, Scene};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

#[test]
fn bad_requests_change_nothing() {
    let (context, other) = (built::context(0), built::context(0));
    let scene = busy_scene(&context);
    let frame = frame(&context, 16, 16);
    let good = perspective(DVec3::Z * 9.0, DVec3::ZERO);
    render(&frame, &scene, &good, &FrameSettings::default());
    let before = all_bytes(&frame);
    let defaults = FrameSettings::default();
    let bad_settings = [
        FrameSettings { samples: 0, ..defaults },
        FrameSettings { samples: 1025, ..defaults },
        FrameSettings { poe: -1.0, ..defaults },
        FrameSettings { ambient: f32::NAN, ..defaults },
    ];
    for settings in bad_settings {
        assert!(frame.request(&scene.state(), &good, &settings).is_err());
    }
    let eye = DVec3::Z * 9.0;
    for camera in [
        perspective(eye, eye),
        perspective(DVec3::NAN, DVec3::ZERO),
        Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 },
        Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 180.0 },
        Camera::Orthographic { eye, at: DVec3::ZERO, up: DVec3::Y, height: 0.0 },
    ] {
        assert!(frame.request(&scene.state(), &camera, &defaults).is_err(), "{camera:?}");
    }
    assert!(frame.request(&Scene::new(&other).state(), &good, &defaults).is_err());
    assert!(frame.resize(0, 5).is_err() && frame.resize(70_000, 5).is_err());
    assert_eq!((frame.poll().state, frame.poll().request), (FrameState::Converged, 1));
    assert!(before == all_bytes(&frame));
}

fn resizing_and_mapping_across_requests() {
    let context = built::context(1);
    let scene = busy_scene(&context);
    let frame = frame(&context, 40, 30);
    let camera = perspective(DVec3::Z * 9.0, DVec3::ZERO);
    render(&frame, &scene, &camera, &FrameSettings::default());
    let old = frame.map(Buffer::ColourSrgb8).unwrap();
    let copy = old.bytes().to_vec();
    frame.resize(50, 20).unwrap();
    assert_eq!(frame.map(Buffer::Depth).unwrap().width(), 40, "until the next is complete");
    for _ in 0..3 {
        render(&frame, &scene, &camera, &FrameSettings::default());
    }
    let new = frame.map(Buffer::ColourSrgb8).unwrap();
    assert_eq!((new.width(), new.height(), new.row_pitch(), new.bytes().len()), (50, 20, 200, 4000));
    assert_eq!((new.request(), old.request()), (4, 1));
    assert!(old.bytes() == copy, "a mapping stays as it was");
}

/// The caller's memory; notices two writers at once.
struct Memory {
    rows: Vec<Mutex<Vec<u8>>>,
    size: usize,
}

impl Target for Memory {
    fn write(&self, x: u32, y: u32, pixels: &[u8]) {
        let mut row = self.rows[y as usize].lock().unwrap();
        let at = x as usize * self.size;
        row[at..at + pixels.len()].copy_from_slice(pixels);
    }
}

fn the_callers_memory_gets_what_a_mapping_shows() {
    let context = built::context(2);
    let scene = busy_scene(&context);
    let (width, height) = (70, 45);
    let memory = |b: Buffer| {
        let row = || Mutex::new(vec![0xEE; width as usize * b.pixel_bytes()]);
        Arc::new(Memory { rows: (0..height).map(|_| row()).collect(), size: b.pixel_bytes() })
    };
    let all = Buffer::ALL.map(|b| (b, memory(b)));
    let targets = all.iter().map(|(b, m)| (*b, m.clone() as Arc<dyn Target>)).collect();
    let frame = Frame::new(&context, FrameOptions { width, height, outputs: Outputs::ALL, targets }).unwrap();
    let camera = perspective(DVec3::new(4.0, 3.0, 7.0), DVec3::ZERO);
    for i in 0..5 {
        let aside = perspective(DVec3::new(f64::from(i), 3.0, 7.0), DVec3::ZERO);
        frame.request(&scene.state(), &aside, &FrameSettings::default()).unwrap();
    }
    render(&frame, &scene, &camera, &FrameSettings::default());
    for (buffer, memory) in &all {
        let rows: Vec<u8> = memory.rows.iter().flat_map(|r| r.lock().unwrap().clone()).collect();
        assert!(rows == frame.map(*buffer).unwrap().bytes(), "{buffer:?}");
    }
    frame.request(&scene.state(), &camera, &FrameSettings::default()).unwrap();
    frame.resize(30, 30).unwrap();
    assert!(all.iter().all(|(_, m)| Arc::strong_count(m) == 1), "a resize lets go of the targets");
}

fn wake_is_called_once_for_each_ending_and_never_for_what_was_replaced() {
    for threads in [0, 2] {
        let context = built::context(threads);
        let scene = busy_scene(&context);
        let frame = Arc::new(frame(&context, 64, 64));
        let seen = Arc::new(Mutex::new(Vec::new()));
        let (log, weak) = (Arc::clone(&seen), Arc::downgrade(&frame));
        frame.set_wake(Some(Arc::new(move || {
            // The status is final when the wake comes.
            let status = weak.upgrade().unwrap().poll();
            // Better pictures wake too.
            if status.state != FrameState::Running {
                log.lock().unwrap().push((status.request, status.state));
            }
        })));
        let camera = perspective(DVec3::Z * 9.0, DVec3::ZERO);
        render(&frame, &scene, &camera, &FrameSettings::default());
        frame.request(&scene.state(), &camera, &FrameSettings { samples: 1024, ..Default::default() }).unwrap();
        frame.cancel();
        assert_eq!(frame.wait(LONG).state, FrameState::Cancelled);
        while Arc::strong_count(&frame) > 1 || seen.lock().unwrap().len() < 2 {
            std::thread::yield_now();
        }
        assert_eq!(*seen.lock().unwrap(), [(1, FrameState::Converged), (2, FrameState::Cancelled)]);
        frame.set_wake(None);
    }
}

/// Has a frame wake a function that takes `time`; counts its calls and its returns.
fn wake_slowly(frame: &Frame, time: Duration) -> Arc<[AtomicUsize; 2]> {
    let counts = Arc::new([const { AtomicUsize::new(0) }; 2]);
    let within = Arc::clone(&counts);
    frame.set_wake(Some(Arc::new(move || {
        within[0].fetch_add(1, SeqCst);
        std::thread::sleep(time);
        within[1].fetch_add(1, SeqCst);
    })));
    counts
}

/// A wait that says that a request has ended says that its wake function has returned.
#[test]
fn waits_end_after_the_wake_function() {
    let context = built::context(2);
    let scene = busy_scene(&context);
    let frame = frame(&context, 32, 32);
    for _ in 0..5 {
        let counts = wake_slowly(&frame, Duration::from_millis(20));
        frame.request(&scene.state(), &perspective(DVec3::Z * 9.0, DVec3::ZERO), &FrameSettings::default()).unwrap();
        while frame.wait(Duration::from_millis(3)).state == FrameState::Running {}
        let [begun, ended] = [0, 1].map(|at| counts[at].load(SeqCst));
        assert!(begun > 0 && begun == ended, "{begun} calls, {ended} returns");
    }
}

/// 1000 requests and cancels of one frame while another renders and queries run: cancels are prompt, fractions
/// never go back, and what is mapped is always exactly one of the two pictures.
#[test]
fn a_thousand_requests_and_cancels_while_queries_run() {
    let context = built::context(2);
    let scene = busy_scene(&context);
    let frame = frame(&context, 1024, 768);
    let cameras =
        [perspective(DVec3::new(4.0, 3.0, 7.0), DVec3::ZERO), perspective(DVec3::new(-4.0, 1.0, 6.0), DVec3::ZERO)];
    let settings = FrameSettings::default();
    let references: Vec<Vec<u8>> = cameras
        .iter()
        .map(|camera| {
            render(&frame, &scene, camera, &settings);
            frame.map(Buffer::ColourSrgb8).unwrap().bytes().to_vec()
        })
        .collect();
    let stop = AtomicBool::new(false);
    let (asked, pictures) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let mut cancels = Vec::new();
    std::thread::scope(|threads| {
        threads.spawn(|| {
            let state = scene.state();
            let rays: Vec<Ray> = (0..4096)
                .map(|i| {
                    Ray::new(DVec3::new(f64::from(i % 64) * 0.05 - 1.6, f64::from(i / 64) * 0.05 - 1.6, 9.0), -Vec3::Z)
                })
                .collect();
            let mut hits = vec![Hit::MISS; rays.len()];
            let mut first = None;
            while !stop.load(SeqCst) {
                state.closest(&rays, QueryOptions::default(), &mut hits).unwrap();
                assert!(*first.get_or_insert_with(|| hits.clone()) == hits);
                asked.fetch_add(1, SeqCst);
            }
        });
        threads.spawn(|| {
            let other = Frame::new(&context, FrameOptions { width: 200, height: 150, ..Default::default() }).unwrap();
            while !stop.load(SeqCst) {
                other.request(&scene.state(), &cameras[0], &settings).unwrap();
                assert_eq!(other.wait(LONG).state, FrameState::Converged);
                pictures.fetch_add(1, SeqCst);
            }
        });
        for i in 0..1000usize {
            frame.request(&scene.state(), &cameras[i % 2], &settings).unwrap();
            if i % 250 == 249 {
                assert_eq!(frame.wait(LONG).state, FrameState::Converged);
            } else {
                let mut fraction = 0.0;
                for _ in 0..i % 4 {
                    let status = frame.wait(Duration::from_micros(500));
                    assert!(status.fraction >= fraction && status.request == i as u64 + 3);
                    fraction = status.fraction;
                }
                if i % 3 != 0 {
                    let begun = Instant::now();
                    frame.cancel();
                    let status = frame.wait(LONG);
                    cancels.push(begun.elapsed());
                    assert!(matches!(status.state, FrameState::Cancelled | FrameState::Converged));
                }
            }
            if i % 20 == 0 {
                let mapped = frame.map(Buffer::ColourSrgb8).unwrap();
                assert!(references.iter().any(|r| r == mapped.bytes()), "request {i}: a torn picture");
            }
        }
        stop.store(true, SeqCst);
    });
    cancels.sort();
    let at = |share: f64| cancels[(cancels.len() as f64 * share) as usize];
    println!(
        "cancel at 1024x768: median {:?}, p99 {:?}, worst {:?}, of {}",
        at(0.5),
        at(0.99),
        cancels[cancels.len() - 1],
        cancels.len()
    );
    println!("meanwhile {} batches of 4096 rays and {} pictures", asked.load(SeqCst), pictures.load(SeqCst));
    assert!(asked.load(SeqCst) > 0 && pictures.load(SeqCst) > 0);
}

/// Once a frame is gone no thread is in its wake function any more: the data that this uses may go too.
fn dropping_a_frame_waits_for_whoever_is_being_woken() {
    let context = built::context(2);
    let (scene, _) = built::scene(&context, &built::parts(&fine_sphere()));
    let mut called = 0;
    for i in 0..30 {
        let frame = frame(&context, 64, 48);
        let counts = wake_slowly(&frame, Duration::from_millis(5));
        let settings = FrameSettings { samples: 4, ..Default::default() };
        frame
            .request(&scene.state(), &perspective(DVec3::new(1.0, 2.0, 4.0), DVec3::ZERO), &settings)
            .expect("a request");
        std::thread::sleep(Duration::from_millis(i));
        drop(frame);
        let [begun, ended] = [0, 1].map(|at| counts[at].load(SeqCst));
        assert_eq!(begun, ended, "somebody is still in the wake function");
        called += begun;
    }
    assert!(called > 0);
}

built::on_each_structure!(
    resizing_and_mapping_across_requests,
    the_callers_memory_gets_what_a_mapping_shows,
    wake_is_called_once_for_each_ending_and_never_for_what_was_replaced,
    dropping_a_frame_waits_for_whoever_is_being_woken,
);
