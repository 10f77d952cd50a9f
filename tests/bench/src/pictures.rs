//! Measures pictures: frames from the camera to bytes of colour, at rest.

use crate::accuracy;
use crate::common::{perceived, picture};
use crate::data::{Case, Residency};
use crate::expected::Expected;
use crate::failure::Failure;
use crate::ours::{ModelAt, Ours};
use crate::pairs::{Pairs, Spread, steady};
use crate::record::{Accuracy, Against, Counters, Outcomes, Record, Trace};
use crate::trace::Task;
use outcrop::scene::{Camera, Context};
use outcrop::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Outputs};
use std::time::{Duration, Instant};

/// What [`Shown`] compares.
pub fn outputs() -> Outputs {
    Outputs::COLOUR | Outputs::of(Buffer::Depth) | Outputs::of(Buffer::Normal) | Outputs::of(Buffer::Kind)
}

/// A frame with all that is compared.
fn frame(context: &Context, size: (u32, u32)) -> Result<Frame, Failure> {
    frame_with(context, outputs(), size)
}

pub fn frame_with(context: &Context, outputs: Outputs, (width, height): (u32, u32)) -> Result<Frame, Failure> {
    Ok(Frame::new(context, FrameOptions { width, height, outputs, ..FrameOptions::default() })?)
}

/// A frame with what a viewer shows: what is timed.
fn colours(context: &Context, size: (u32, u32)) -> Result<Frame, Failure> {
    frame_with(context, Outputs::COLOUR, size)
}

/// Asks for a picture, and waits until it rests.
pub fn render(frame: &Frame, ours: &Ours, camera: &Camera, poe: f32) -> Result<FrameStatus, Failure> {
    frame.request(&ours.state, camera, &FrameSettings { poe, ..FrameSettings::default() })?;
    let status = frame.wait(Duration::from_secs(600));
    match status.state {
        FrameState::Converged => Ok(status),
        _ => Err(Failure::new(format!("a picture does not converge: {status:?}"))),
    }
}

/// What a picture shows.
#[derive(PartialEq)]
pub struct Shown {
    pub depths: Vec<f32>,
    /// Three floats a pixel; 0 where nothing is hit.
    pub normals: Vec<f32>,
    /// sRGB and alpha.
    pub colours: Vec<u8>,
}

impl Shown {
    pub fn of(frame: &Frame) -> Result<Self, Failure> {
        let floats = |buffer| -> Result<Vec<f32>, Failure> {
            Ok(frame.map(buffer)?.floats().ok_or_else(|| Failure::new("depths and normals are floats"))?.to_vec())
        };
        let (depths, normals) = (floats(Buffer::Depth)?, floats(Buffer::Normal)?);
        Ok(Self { depths, normals, colours: frame.map(Buffer::ColourSrgb8)?.bytes().to_vec() })
    }

    /// The exact picture.
    pub fn exact(ours: &Ours, camera: &Camera, size: (u32, u32)) -> Result<Self, Failure> {
        let frame = frame(&ours.context, size)?;
        render(&frame, ours, camera, 0.0)?;
        Self::of(&frame)
    }

    /// Against the exact picture: depths in pixels, normals in degrees, FLIP and SSIM.
    pub fn errors(&self, truth: &Self, camera: &Camera, (width, height): (u32, u32)) -> Result<Accuracy, Failure> {
        let pixels = camera.prepare(width, height)?;
        let off = picture::depth_pixels(&self.depths, &truth.depths, |depth| pixels.pixel_width(depth));
        let [seen, wanted] = [self, truth].map(|shown| picture::Colours::Srgb8(&shown.colours));
        let flip = Some(perceived::flip(seen, wanted, width as usize).mean);
        let ssim = Some(perceived::ssim(seen, wanted, width as usize));
        let normal_degrees = Some(picture::normal_angle(&self.normals, &truth.normals).mean);
        Ok(Accuracy { flip, ssim, normal_degrees, ..accuracy::of_depths(off, &self.depths, &truth.depths) })
    }
}

/// A model of which pictures are made: where it is, all in memory, and as results name it.
pub struct Side<'a> {
    pub name: &'a str,
    pub model: &'a ModelAt,
    pub loaded: &'a Ours,
}

/// All settings of a case, each in turn with the exact picture; of a scene of many trees with the same picture of the
/// flattened model, whose exact picture is the truth then.
pub fn measure(task: &mut Task, case: &Case, one: &Side, flattened: Option<&Side>) -> Result<Vec<Record>, Failure> {
    let (size, Side { model, loaded, .. }) = (task.benchmark.size, one);
    let camera = loaded.camera(task.scene, case.view);
    let truth = Shown::exact(flattened.unwrap_or(one).loaded, &camera, size)?;
    let mut records = Vec::new();
    let threads = if task.is_only_expecting { &[0][..] } else { &task.benchmark.threads };
    for &threads in threads {
        let ours = Ours::open(model, Residency::All, threads)?;
        let one = frame(&ours.context, size)?;
        // All answers are looked at before anything is timed.
        let mut looks = Vec::new();
        for &poe in &task.benchmark.poe {
            let id = task.benchmark.id(&task.scene.row.name, case, poe);
            let stand_ins = render(&one, &ours, &camera, poe)?.pixels_lod;
            let seen = Shown::of(&one)?;
            let kinds = one.map(Buffer::Kind)?.bytes().to_vec();
            let hits = kinds.iter().filter(|kind| **kind != 0).count();
            let bytes = [&seen.colours, one.map(Buffer::Depth)?.bytes(), &kinds].concat();
            task.book.check(&id, Expected::of_bytes(hits, &bytes))?;
            looks.push((poe, id, seen, hits, stand_ins));
        }
        if task.is_only_expecting {
            continue;
        }
        drop(one);
        let beside = flattened.map(|side| Ours::open(side.model, Residency::All, threads)).transpose()?;
        let theirs = beside.as_ref().unwrap_or(&ours);
        let [one, other] = [colours(&ours.context, size)?, colours(&theirs.context, size)?];
        for (poe, id, seen, hits, stand_ins) in looks {
            let accuracy = seen.errors(&truth, &camera, size)?;
            let timed = |frame: &Frame, ours: &Ours, poe: f32| {
                steady(|| {
                    let begun = Instant::now();
                    render(frame, ours, &camera, poe).expect("it did before");
                    begun.elapsed().as_secs_f64()
                })
            };
            let (opponent, their_call, their_poe) = match flattened {
                Some(side) => (side.name, "frame", poe),
                None => (case.structure.as_str(), "exact frame", 0.0),
            };
            let pairs =
                Pairs::in_turn(task.benchmark.rounds, || timed(&one, &ours, poe), || timed(&other, theirs, their_poe));
            let (seconds, their_seconds) = (Spread::of(&pairs.a), Spread::of(&pairs.b));
            let (side, call, ratio) = (case.structure.clone(), "frame".to_owned(), pairs.ratio());
            let against = Against { side: opponent.into(), call: their_call.into(), seconds: their_seconds, ratio };
            let counters = Counters {
                bytes_model: Some(ours.model.memory().geometry),
                bytes_working_set: Some(working_set(model, &camera, size, poe)?),
                stand_ins: Some(stand_ins),
                ..Counters::default()
            };
            let count = truth.depths.len();
            let mrays = count as f64 / seconds.median / 1e6;
            let beside = flattened.map_or(String::new(), |side| {
                format!(", {:.2} [{:.2} .. {:.2}] of {}", ratio.median, ratio.least, ratio.most, side.name)
            });
            eprintln!("{id}, {threads} threads: {:.1} ms{beside}; {:.3} px", seconds.median * 1e3, accuracy.mean_px);
            let residency = case.residency.name();
            let (view, rays) = (case.view, case.rays.name().into());
            let against = Some(against);
            let trace = Trace {
                side,
                is_peer: false,
                call,
                residency,
                view,
                rays,
                poe,
                threads,
                count,
                hits,
                seconds,
                mrays,
                against,
                counters,
                accuracy,
            };
            let triangles = ours.model.info().triangles_in;
            records.push(task.record(
                format!("{id}/{}/{threads}", case.structure),
                triangles,
                Outcomes::Trace(Box::new(trace)),
            ));
        }
    }
    Ok(records)
}

/// Bytes of the blocks that a picture takes, of a model with none in memory.
fn working_set(model: &ModelAt, camera: &Camera, size: (u32, u32), poe: f32) -> Result<u64, Failure> {
    let cold = Ours::open(model, Residency::Cold, 1)?;
    render(&frame(&cold.context, size)?, &cold, camera, poe)?;
    Ok(cold.model.memory().resident)
}
