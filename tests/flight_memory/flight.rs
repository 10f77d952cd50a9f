//! One flight of a camera, and the most memory that it took.

use crate::counting;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::math::DBounds;
use outcrop::{
    Camera, Context, ContextOptions, Frame, FrameOptions, FrameSettings, FrameState, Model, Outputs, Result, Scene,
};
use std::fmt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// The content of a scene.
pub enum Content {
    Model(PathBuf),
    /// Models, and the number of instances of all.
    Instances(Vec<PathBuf>, u64),
}

/// The greatest numbers of bytes during a flight.
pub struct Flight {
    pub budget: u64,
    /// Buffers of the picture that can be mapped and of the one in progress.
    pub buffers: u64,
    /// Bytes of the budget in use.
    pub used: u64,
    /// Bytes that the process had allocated.
    pub counted: u64,
    /// Bytes that the process had from the system, those of files not counted. 0 where the system does not say.
    pub resident: u64,
    pictures: u32,
    seconds: f64,
    /// Mean error in pixels at the end.
    error: f32,
}

impl Flight {
    /// Those of `bytes` that are neither the budget nor buffers.
    pub fn beside(&self, bytes: u64) -> i64 {
        bytes as i64 - (self.budget + self.buffers) as i64
    }
}

impl fmt::Display for Flight {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mb = |bytes: u64| bytes as f64 / 1e6;
        let beside = |bytes: u64| self.beside(bytes) as f64 / 1e6;
        write!(
            f,
            "budget {:>6.1} MB, used {:>6.1}, counted {:>6.1} ({:>+6.1}), resident {:>6.1} ({:>+6.1}), buffers {:.1}; \
             {} pictures in {:.1} s, {:.2} px at the end",
            mb(self.budget),
            mb(self.used),
            mb(self.counted),
            beside(self.counted),
            mb(self.resident),
            beside(self.resident),
            mb(self.buffers),
            self.pictures,
            self.seconds,
            self.error,
        )
    }
}

const SIZE: (u32, u32) = (1280, 800);
const OUTPUTS: Outputs = Outputs::COLOUR;
const PIXEL_BYTES: u64 = 4;
/// The time that a picture in motion has, and the one at rest.
const MOTION: Duration = Duration::from_millis(100);
const REST: Duration = Duration::from_secs(4);
/// No first picture takes as long. (A bound on hangs.)
const LONG: Duration = Duration::from_secs(120);

/// The bytes that this process has from the system and that are no file's.
pub fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    Some(line.trim().strip_suffix(" kB")?.parse::<u64>().ok()? << 10)
}

/// Flies over the content, in `pictures` pictures and one at rest, exact, at the end. Fails with `OverBudget` if the
/// budget is too small for the content.
pub fn fly(content: &Content, budget: u64, pictures: u32) -> Result<Flight> {
    let (ended, used, most_resident) = (AtomicBool::new(false), AtomicU64::new(0), AtomicU64::new(0));
    let begun = Instant::now();
    let (error, counted) = counting::most(|| {
        let context = Context::new(ContextOptions { threads: 2, memory_budget: budget, ..Default::default() })?;
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !ended.load(Relaxed) {
                    used.fetch_max(context.memory_used(), Relaxed);
                    most_resident.fetch_max(resident().unwrap_or(0), Relaxed);
                    std::thread::sleep(Duration::from_millis(1));
                }
            });
            let flown = watched(&context, content, pictures);
            ended.store(true, Relaxed);
            flown
        })
    });
    Ok(Flight {
        budget,
        buffers: 2 * PIXEL_BYTES * u64::from(SIZE.0) * u64::from(SIZE.1),
        used: used.into_inner(),
        counted: counted as u64,
        resident: most_resident.into_inner(),
        pictures,
        seconds: begun.elapsed().as_secs_f64(),
        error: error?,
    })
}

fn watched(context: &Context, content: &Content, pictures: u32) -> Result<f32> {
    let scene = Scene::new(context);
    let bounds = place(&scene, content)?;
    let options = FrameOptions { width: SIZE.0, height: SIZE.1, outputs: OUTPUTS, ..Default::default() };
    let frame = Frame::new(context, options)?;
    for i in 0..pictures {
        frame.request(
            &scene.state(),
            &camera(&bounds, i, pictures),
            &FrameSettings { poe: 1.0, ..Default::default() },
        )?;
        let asked = Instant::now();
        while frame.poll().pictures == 0 {
            frame.wait(Duration::from_millis(1));
            assert!(asked.elapsed() < LONG, "no picture: {:?}", frame.poll());
        }
        frame.wait(MOTION);
        if i % 8 == 0 {
            frame.pick(SIZE.0 / 2, SIZE.1 / 2)?;
        }
    }
    frame.request(&scene.state(), &camera(&bounds, pictures, pictures), &FrameSettings::default())?;
    let status = frame.wait(REST);
    assert!(!matches!(status.state, FrameState::Failed | FrameState::Cancelled), "{status:?}");
    Ok(status.mean_error_px)
}

/// Fills a scene. Returns the bounds of its content.
fn place(scene: &Scene, content: &Content) -> Result<DBounds> {
    let open = |path: &PathBuf| Model::open(scene.context(), path);
    match content {
        Content::Model(path) => {
            let model = open(path)?;
            scene.add_instance(&model, 1, DAffine3::IDENTITY)?;
            scene.commit()?;
            Ok(model.info().bounds)
        }
        Content::Instances(paths, count) => {
            let models = paths.iter().map(open).collect::<Result<Vec<Model>>>()?;
            let across = (*count as f64).sqrt().ceil();
            for i in 0..*count {
                let at = DVec3::new(i as f64 % across, (i as f64 / across).floor(), (i as f64 * 0.37).sin());
                let turn = DQuat::from_rotation_z(i as f64);
                let place = DAffine3::from_scale_rotation_translation(DVec3::splat(0.4), turn, at);
                scene.add_instance(&models[i as usize % models.len()], i, place)?;
            }
            scene.commit()?;
            Ok(DBounds { min: DVec3::new(0.0, 0.0, -1.0), max: DVec3::new(across, across, 1.0) })
        }
    }
}

/// A camera that goes round the content one and a half times and comes close to it in the middle of the flight.
fn camera(bounds: &DBounds, i: u32, pictures: u32) -> Camera {
    let (share, centre) = (f64::from(i) / f64::from(pictures), (bounds.min + bounds.max) * 0.5);
    let (angle, near) = (share * 3.0 * std::f64::consts::PI, (share * std::f64::consts::PI).sin());
    let size = (bounds.max - bounds.min).length();
    let from = DVec3::new(angle.cos(), angle.sin(), 0.4 + 0.3 * (5.0 * share).sin());
    let at = centre + DVec3::new((7.0 * share).sin(), (11.0 * share).cos(), 0.0) * (0.15 * size);
    Camera::Perspective { eye: at + from * (size * (1.1 - near)), at, up: DVec3::Z, fov_y_degrees: 45.0 }
}
