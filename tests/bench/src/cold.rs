//! Measures a picture's error over the seconds since its model was opened with nothing in memory, from a source that
//! gives so many bytes a second.

use crate::common::sources::meddled;
use crate::data::{Bytes, Residency};
use crate::failure::{Failure, Outcome};
use crate::looks::{Look, Truth};
use crate::ours::Ours;
use crate::pictures;
use crate::record::{Cold, Moment, Outcomes, Record};
use crate::trace::Task;
use outcrop::scene::{Context, ContextOptions, Model};
use outcrop::store::Source;
use outcrop::{FrameSettings, FrameState};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A disk that serves one read after the other, each taking its bytes' share of a second, and adds up their bytes.
fn throttled(path: &Path, rate: u64, bytes_read: Arc<AtomicU64>) -> Arc<dyn Source> {
    let free_at = Mutex::new(Instant::now());
    meddled(path, move |_, bytes| {
        let takes = Duration::from_secs_f64(bytes.len() as f64 / rate as f64);
        let done = {
            let mut free_at = free_at.lock().expect("no reader panics");
            *free_at = (*free_at).max(Instant::now()) + takes;
            *free_at
        };
        std::thread::sleep(done.saturating_duration_since(Instant::now()));
        bytes_read.fetch_add(bytes.len() as u64, Relaxed);
        Ok(())
    })
}

/// All budgets and rates of a benchmark on one scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let mut records = Vec::new();
    if task.is_only_expecting {
        return Ok(records);
    }
    let benchmark = task.benchmark;
    for structure in &benchmark.structures {
        let stored = task.scene.model(task.data.structure(structure))?;
        let loaded = Ours::open(&stored, Residency::All, 0)?;
        for &view in &benchmark.views {
            let camera = loaded.camera(task.scene, view);
            let truth = Truth::of(&loaded, &camera, benchmark.size)?;
            for &Bytes(rate) in &benchmark.rates {
                for budget in
                    benchmark.residency.iter().map(|r| if let Residency::Budget(bytes) = r { *bytes } else { 0 })
                {
                    let poe = benchmark.poe.first().copied().unwrap_or(0.0);
                    let threads = benchmark.threads[0];
                    let read_ahead = !benchmark.on_demand;
                    let options =
                        ContextOptions { threads, memory_budget: budget, read_ahead, ..ContextOptions::default() };
                    let context = Context::new(options)?;
                    let bytes_read = Arc::new(AtomicU64::new(0));
                    let source = throttled(&stored.path, rate, Arc::clone(&bytes_read));
                    let begun = Instant::now();
                    let open = if benchmark.on_demand { Model::open_cold_source } else { Model::open_source };
                    let model = open(&context, source)?;
                    let opened_seconds = begun.elapsed().as_secs_f64();
                    let ours = Ours::with(context, model, &stored.places)?;
                    let clock = Clock { begun, bytes_read: &bytes_read };
                    let pictures = watch(&ours, &camera, benchmark.size, poe, &truth, &clock)?;
                    let last = pictures.last().map_or(0.0, |m| m.seconds);
                    let megabytes = |bytes: u64| bytes >> 20;
                    let scene = &task.scene.row.name;
                    let key = format!(
                        "{}/{scene}/{structure}/view {view}/{}M/{}M a second",
                        benchmark.name,
                        megabytes(budget),
                        megabytes(rate)
                    );
                    eprintln!("{key}: {} pictures, {last:.2} s", pictures.len());
                    let bytes_resident = ours.model.memory().resident;
                    let structure = structure.clone();
                    let cold =
                        Cold { structure, view, poe, threads, budget, rate, opened_seconds, pictures, bytes_resident };
                    records.push(task.record(key, ours.model.info().triangles_in, Outcomes::Cold(cold)));
                }
            }
        }
    }
    Ok(records)
}

/// What has converged is the exact picture, and what has not says so.
fn check(state: &FrameState, last: &Look, truth: &Look) -> Outcome {
    let is_exact = last.shown == truth.shown;
    match state {
        FrameState::Converged if is_exact => Ok(()),
        FrameState::Converged => {
            let differ = last.differences(truth);
            Err(Failure::new(format!("wrong answers: a picture that has converged is not the exact one: {differ}")))
        }
        FrameState::CompleteWithinBudget => Ok(()),
        other => Err(Failure::new(format!("a picture ends as {other:?}"))),
    }
}

/// What is measured since opening began.
struct Clock<'a> {
    begun: Instant,
    bytes_read: &'a AtomicU64,
}

/// Every picture until the frame rests.
fn watch(
    ours: &Ours,
    camera: &outcrop::Camera,
    size: (u32, u32),
    poe: f32,
    truth: &Truth,
    clock: &Clock,
) -> Result<Vec<Moment>, Failure> {
    let frame = pictures::frame_with(&ours.context, Look::outputs(), size)?;
    frame.request(&ours.state, camera, &FrameSettings { poe, ..FrameSettings::default() })?;
    let (mut shown, mut pictures) = (Vec::new(), 0);
    loop {
        let status = frame.wait(Duration::from_millis(2));
        let is_over = status.state != FrameState::Running;
        if status.pictures > pictures || is_over {
            pictures = status.pictures;
            shown.push((clock.begun.elapsed().as_secs_f64(), clock.bytes_read.load(Relaxed), Look::of(&frame)?));
        }
        if is_over {
            check(&status.state, &shown.last().expect("a picture was just taken").2, &truth.look)?;
            break;
        }
        if clock.begun.elapsed() > Duration::from_secs(300) {
            return Err(Failure::new(format!("a picture does not come to rest: {status:?}")));
        }
    }
    let moment = |(seconds, bytes_read, look): (f64, u64, Look)| {
        Ok(Moment { seconds, bytes_read, accuracy: truth.errors(&look)? })
    };
    shown.into_iter().map(moment).collect()
}
