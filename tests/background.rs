//! What goes on in the background, and whoever waits for it.

use glam::DVec3;
use outcrop::base::tasks::{Executor, Task};
use outcrop::render::{Frame, FrameOptions, FrameSettings, FrameState};
use outcrop::scene::{Camera, Context, ContextOptions, Scene};
use std::sync::{Arc, Barrier};
use std::time::Duration;

const LONG: Duration = Duration::from_secs(120);

/// Threads of a host that take a task only once they are let go, and then drop it.
struct Held {
    submitting: Barrier,
    let_go: Barrier,
}

impl Executor for Held {
    fn concurrency(&self) -> usize {
        1
    }
    fn submit(&self, task: Task) {
        self.submitting.wait();
        self.let_go.wait();
        drop(task);
    }
}

/// A wait that comes while another thread is still beginning the request sleeps until the job is there.
#[test]
fn a_wait_in_the_middle_of_a_request_learns_of_its_job() {
    let held = Arc::new(Held { submitting: Barrier::new(2), let_go: Barrier::new(2) });
    let executor = Arc::clone(&held) as Arc<dyn Executor>;
    let options = ContextOptions { executor: Some(executor), ..Default::default() };
    let context = Context::new(options).expect("a context");
    // No model: making one would hand in tasks too.
    let scene = Scene::new(&context);
    let frame = Frame::new(&context, FrameOptions { width: 8, height: 8, ..Default::default() }).expect("a frame");
    let camera = Camera::Perspective { eye: DVec3::Z, at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 40.0 };
    std::thread::scope(|threads| {
        threads.spawn(|| frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request"));
        held.submitting.wait();
        assert_eq!(frame.wait(Duration::from_millis(20)).state, FrameState::Running);
        let waiter = threads.spawn(|| frame.wait(LONG));
        // Asleep by now, most likely; either way it has to end.
        std::thread::sleep(Duration::from_millis(20));
        held.let_go.wait();
        assert_eq!(waiter.join().expect("the waiter").state, FrameState::Converged);
    });
}
