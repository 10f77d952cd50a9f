//! Requests that are replaced, cancelled and released while they complete a picture pane by pane: each one that is
//! waited for ends.

use crate::common::frames::LONG;
use crate::common::rng::Rng;
use crate::part_budgets::airliner;
use glam::DAffine3;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use std::time::{Duration, Instant};

struct Rig {
    context: Context,
    scene: Scene,
    model: Model,
}

impl Rig {
    fn new(threads: usize, memory_budget: u64) -> Self {
        let options = ContextOptions { threads, memory_budget, read_ahead: false, ..Default::default() };
        let context = Context::new(options).expect("a context");
        let model = Model::open_cold(&context, &airliner().path).expect("a model");
        let scene = Scene::new(&context);
        scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        Self { context, scene, model }
    }

    fn frame(&self, (width, height): (u32, u32)) -> Frame {
        let outputs = Outputs::of(Buffer::Part) | Outputs::of(Buffer::Depth);
        Frame::new(&self.context, FrameOptions { width, height, outputs, ..Default::default() }).expect("a frame")
    }

    fn request(&self, frame: &Frame, view: usize, poe: f32) {
        let settings = FrameSettings { poe, ..FrameSettings::default() };
        frame.request(&self.scene.state(), &self.model.views()[view], &settings).expect("a request");
    }
}

fn parts(frame: &Frame) -> Vec<u64> {
    frame.map(Buffer::Part).expect("a picture").ids().expect("ids").to_vec()
}

/// Fractions of a second that a test waits between two calls: none, within a pass, and within panes.
const PAUSES: [f64; 6] = [0.0, 0.0, 0.0002, 0.001, 0.005, 0.03];

#[test]
fn requests_that_are_replaced_within_panes_leave_their_successors_alone() {
    for threads in [0, 1, 2] {
        let (rig, mut rng) = (Rig::new(threads, 6 << 20), Rng::new(threads as u64 + 1));
        let mut frames = [rig.frame((32, 24)), rig.frame((24, 16))];
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(5) {
            for _ in 0..1 + rng.below(30) {
                let which = rng.below(2);
                match rng.below(12) {
                    0 => frames[which].cancel(),
                    1 => frames[which] = rig.frame((32, 24)),
                    _ => rig.request(&frames[which], rng.below(4), [0.0, 0.0, 1.0, 3.0][rng.below(4)]),
                }
                std::thread::sleep(Duration::from_secs_f64(PAUSES[rng.below(6)] * rng.unit()));
            }
            for frame in &frames {
                let status = frame.wait(LONG);
                assert_ne!(status.state, FrameState::Running, "{threads} threads: {status:?}");
                assert_ne!(status.state, FrameState::CompleteWithinBudget, "{threads} threads: {status:?}");
            }
        }
    }
}

/// The end of a request is the same in budgets that hold hardly more than the roots, in contexts with and without
/// threads, and beside frames that move.
#[test]
fn the_end_is_that_of_an_unlimited_budget() {
    let size = (48, 36);
    let exact: Vec<Vec<u64>> = {
        let (rig, of) = (Rig::new(2, 0), |rig: &Rig, view| {
            let frame = rig.frame(size);
            rig.request(&frame, view, 0.0);
            assert_eq!(frame.wait(LONG).state, FrameState::Converged);
            parts(&frame)
        });
        (0..2).map(|view| of(&rig, view)).collect()
    };
    for (threads, budget) in [(0, 6.0), (2, 6.0), (2, 4.5), (0, 4.5)] {
        let rig = Rig::new(threads, (budget * f64::from(1 << 20)) as u64);
        for (view, exact) in exact.iter().enumerate() {
            let (frame, moving) = (rig.frame(size), rig.frame((64, 48)));
            rig.request(&frame, view, 0.0);
            for step in 0..20 {
                rig.request(&moving, step % 4, 0.0);
                frame.wait(Duration::from_millis(5));
            }
            moving.cancel();
            let status = frame.wait(LONG);
            assert_eq!(status.state, FrameState::Converged, "{threads} threads, {budget} MiB: {status:?}");
            assert!(&parts(&frame) == exact, "{threads} threads, {budget} MiB");
        }
    }
}
