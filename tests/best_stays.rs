//! Pictures that only improve: within a request no picture has a greater error than one before, and in any budget that
//! holds a pane the end is the picture that an unlimited budget gives.

use crate::common::frames::LONG;
use crate::part_budgets::{airliner, open};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Outputs};
use outcrop::scene::{Camera, Context, Scene};
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (256, 192);

fn frame(context: &Context) -> Frame {
    let options = FrameOptions { width: SIZE.0, height: SIZE.1, outputs: Outputs::ALL, ..Default::default() };
    Frame::new(context, options).expect("a frame")
}

fn settings(poe: f32) -> FrameSettings {
    FrameSettings { poe, ..FrameSettings::default() }
}

/// All pictures of a request that can be caught: the status and the depths of each. The last one is its end.
fn pictures(frame: &Frame, scene: &Scene, camera: &Camera, poe: f32) -> Vec<(FrameStatus, Vec<f32>)> {
    frame.request(&scene.state(), camera, &settings(poe)).expect("a request");
    let (mut all, begun): (Vec<(FrameStatus, Vec<f32>)>, _) = (Vec::new(), Instant::now());
    loop {
        let before = frame.poll();
        let is_new = before.pictures > all.last().map_or(0, |(status, _)| status.pictures);
        let has_ended = before.state != FrameState::Running;
        if is_new || has_ended {
            let depth = frame.map(Buffer::Depth).expect("a picture");
            // The status and the picture belong together only if no other picture came between.
            let after = frame.poll();
            if (after.pictures, after.state) == (before.pictures, before.state) {
                all.push((before, depth.floats().expect("floats").to_vec()));
            }
            if has_ended {
                return all;
            }
        }
        assert!(begun.elapsed() < LONG, "the request does not end");
        frame.wait(Duration::from_millis(1));
    }
}

/// The mean distance of depths from the exact ones; a hit in place of a miss, or the other way, counts as the extent.
fn true_error(depth: &[f32], exact: &[f32], extent: f64) -> f64 {
    let of = |(&a, &b): (&f32, &f32)| match (a.is_finite(), b.is_finite()) {
        (true, true) => f64::from(a - b).abs(),
        (false, false) => 0.0,
        _ => extent,
    };
    depth.iter().zip(exact).map(of).sum::<f64>() / depth.len() as f64
}

fn bytes(frame: &Frame) -> Vec<Vec<u8>> {
    let of = |buffer: &Buffer| frame.map(*buffer).expect("a buffer").bytes().to_vec();
    // The error of an exact hit is that of rounding; all else is the same.
    Buffer::ALL.iter().filter(|buffer| **buffer != Buffer::Error).map(of).collect()
}

#[test]
fn pictures_only_improve_and_end_as_in_an_unlimited_budget() {
    let path = &airliner().path;
    let (context, scene, model) = open(path, 0);
    let unlimited = frame(&context);
    let (views, extent) = (model.views(), model.info().bounds.extent().length());
    // Pictures, and those with a greater true error than the one before; a stand-in of smaller stated error may be
    // farther off.
    let (mut counts, mut most) = ([0; 2], 1.0f64);
    for (poe, least) in [(0.0, 8), (2.0, 8), (0.0, 10)] {
        let (small_context, small_scene, _small) = open(path, least << 20);
        let small = frame(&small_context);
        for camera in &views {
            unlimited.request(&scene.state(), camera, &settings(0.0)).expect("a request");
            assert_eq!(unlimited.wait(LONG).state, FrameState::Converged);
            let exact = unlimited.map(Buffer::Depth).expect("a picture").floats().expect("floats").to_vec();
            unlimited.request(&scene.state(), camera, &settings(poe)).expect("a request");
            assert_eq!(unlimited.wait(LONG).state, FrameState::Converged);
            let all = pictures(&small, &small_scene, camera, poe);
            let mut before: Option<(f32, f32, f64)> = None;
            for (status, depth) in &all {
                let now = (status.mean_error_px, status.worst_error_px, true_error(depth, &exact, extent));
                counts[0] += 1;
                if let Some(before) = before {
                    // Where stand-ins are requested, one of them may replace another one of a smaller error.
                    let slack = if poe > 0.0 { 1.02 } else { 1.0001 };
                    assert!(now.0 <= before.0 * slack + 1e-6, "stated mean: {now:?} after {before:?}");
                    assert!(now.1 <= before.1 * slack, "stated worst: {now:?} after {before:?}");
                    let has_risen = now.2 > before.2 * 1.001 + 1e-9;
                    counts[1] += usize::from(has_risen);
                    most = most.max(if has_risen { now.2 / before.2 } else { 1.0 });
                }
                before = Some(now);
            }
            let end = &all.last().expect("an end").0;
            assert_eq!(end.state, FrameState::Converged, "{end:?}");
            assert_eq!((end.effective_poe, end.pixels_missing), (poe, 0));
            assert!(bytes(&small) == bytes(&unlimited), "PoE {poe} in {least} MiB");
        }
    }
    println!("{} pictures; the true error rose {} times, {most:.3} times at the most", counts[0], counts[1]);
    assert!(counts[0] > 30 && counts[1] * 10 <= counts[0] && most < 1.5, "{counts:?}, {most}");
}

/// Frames of one context take turns with their panes: all end as in an unlimited budget, also one that is asked for
/// again while the others go on.
#[test]
fn frames_take_turns() {
    let path = &airliner().path;
    let (context, scene, model) = open(path, 0);
    let (unlimited, views) = (frame(&context), model.views());
    let exact: Vec<_> = views[..3]
        .iter()
        .map(|camera| {
            unlimited.request(&scene.state(), camera, &settings(0.0)).expect("a request");
            assert_eq!(unlimited.wait(LONG).state, FrameState::Converged);
            bytes(&unlimited)
        })
        .collect();
    let (small_context, small_scene, _small) = open(path, 10 << 20);
    let frames: Vec<Frame> = (0..3).map(|_| frame(&small_context)).collect();
    for (frame, camera) in frames.iter().zip(&views) {
        frame.request(&small_scene.state(), camera, &settings(0.0)).expect("a request");
    }
    std::thread::sleep(Duration::from_millis(300));
    frames[0].request(&small_scene.state(), &views[0], &settings(0.0)).expect("a request");
    for (frame, exact) in frames.iter().zip(&exact) {
        let status = frame.wait(LONG);
        assert_eq!(status.state, FrameState::Converged, "{status:?}");
        assert!(&bytes(frame) == exact);
    }
}
