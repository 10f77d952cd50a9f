//! `outcrop bench --poe`: speed and error of coherent batches at given pixels of error.

use crate::common::{self, Failure};
use crate::rays;
use crate::view::{self, PartArgs};
use outcrop::base::progress::Cancel;
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::scene::{Camera, Context, ContextOptions, Model, SceneState};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Result of one view at one value of pixels of error.
pub struct Row {
    view: u8,
    threads: usize,
    poe: f32,
    rays: usize,
    /// Median speed in millions of rays per second.
    mrays: f64,
    /// Share of stand-ins among the rays that hit.
    lod: f64,
    /// Share of all rays for which only one of the exact and the approximate answer is a hit.
    border: f64,
    /// Mean difference from the exact distance in pixels, over rays that hit both times.
    mean: f64,
    /// 99.9th percentile of this difference.
    nearly_worst: f64,
    /// Bytes in memory of the blocks that the rays visit.
    working_set: u64,
    /// True if the budget held all of these blocks at once.
    is_held: bool,
}

impl Row {
    pub fn at(self, view: u8, threads: usize) -> Self {
        Self { view, threads, ..self }
    }
}

/// Parameters that all rows share.
pub struct Task<'a> {
    pub path: &'a Path,
    pub options: ContextOptions,
    pub size: (u32, u32),
    pub runs: u32,
}

/// Measures the pixel rays of a view at each value of `poes`.
pub fn rows(
    task: &Task,
    scene: &Arc<SceneState>,
    camera: &Camera,
    poes: &[f32],
    cancel: &Cancel,
) -> Result<Vec<Row>, Failure> {
    let pixels = rays::primary(camera, task.size)?;
    let exact = trace(scene, &widened(&pixels, 0.0))?.0;
    poes.iter().map(|&poe| row(task, scene, &pixels, &exact, poe, cancel)).collect()
}

/// Returns the rays with wider cones, so that a stand-in may cover `poe` square pixels.
fn widened(pixels: &[Ray], poe: f32) -> Vec<Ray> {
    let wide = poe.sqrt();
    pixels.iter().map(|ray| Ray { cone: Cone { a: ray.cone.a * wide, b: ray.cone.b * wide }, ..*ray }).collect()
}

fn trace(scene: &SceneState, rays: &[Ray]) -> Result<(Vec<Hit>, f64), Failure> {
    let options = QueryOptions { coherent: true, want: Want::NOTHING, ..QueryOptions::default() };
    let mut hits = vec![Hit::MISS; rays.len()];
    let begun = Instant::now();
    scene.closest(rays, options, &mut hits)?;
    Ok((hits, begun.elapsed().as_secs_f64()))
}

fn row(
    task: &Task,
    scene: &SceneState,
    pixels: &[Ray],
    exact: &[Hit],
    poe: f32,
    cancel: &Cancel,
) -> Result<Row, Failure> {
    let rays = widened(pixels, poe);
    let (hits, _) = trace(scene, &rays)?;
    let mut times = Vec::new();
    for _ in 0..task.runs {
        cancel.check()?;
        times.push(trace(scene, &rays)?.1);
    }
    times.sort_by(f64::total_cmp);
    let is_hit = |hit: &&Hit| hit.kind != HitKind::Miss;
    let met = hits.iter().filter(is_hit).count();
    let lod = hits.iter().filter(|hit| hit.kind == HitKind::Lod).count();
    let both = |(_, (a, b)): &(&Ray, (&Hit, &Hit))| is_hit(a) && is_hit(b);
    let off = |(ray, (a, b)): (&Ray, (&Hit, &Hit))| {
        let width = f64::from(ray.cone.a) + f64::from(ray.cone.b) * b.t;
        (a.t - b.t).abs() / width.max(f64::MIN_POSITIVE)
    };
    let pairs = || pixels.iter().zip(hits.iter().zip(exact));
    let mut errors: Vec<f64> = pairs().filter(both).map(off).collect();
    errors.sort_by(f64::total_cmp);
    let border = pairs().filter(|(_, (a, b))| is_hit(a) != is_hit(b)).count();
    let (working_set, is_held) = working_set(task, &rays)?;
    let share = |n: usize, of: usize| n as f64 / of.max(1) as f64;
    Ok(Row {
        view: 0,
        threads: 0,
        poe,
        rays: rays.len(),
        mrays: rays.len() as f64 / times[times.len() / 2].max(1e-12) / 1e6,
        lod: share(lod, met),
        border: share(border, rays.len()),
        mean: errors.iter().sum::<f64>() / errors.len().max(1) as f64,
        nearly_worst: errors.get(errors.len() * 999 / 1000).copied().unwrap_or(0.0),
        working_set,
        is_held,
    })
}

/// Returns the bytes of the blocks that the rays visit, in a context that starts without any of them, and `true` if the
/// budget holds all of them.
fn working_set(task: &Task, rays: &[Ray]) -> Result<(u64, bool), Failure> {
    let context = Context::new(ContextOptions { read_ahead: false, ..task.options.clone() })?;
    let model = Model::open_cold(&context, task.path)?;
    let scene = view::alone(&context, &model, &PartArgs::default())?.state();
    trace(&scene, rays)?;
    let before = model.memory().resident;
    // The second trace reloads blocks that were evicted to make room.
    trace(&scene, rays)?;
    let after = model.memory().resident;
    Ok((before.max(after), context.memory_used().saturating_add(1 << 20) < context.memory_budget() / 8 * 7))
}

pub fn as_json(rows: &[Row]) -> Value {
    let value = |r: &Row| {
        json!({
            "view": r.view, "threads": r.threads, "poe": r.poe, "count": r.rays, "mrays": r.mrays, "lod": r.lod,
            "border": r.border, "mean_error_px": r.mean, "p999_error_px": r.nearly_worst, "bytes_working_set": r.working_set,
            "working_set_fits": r.is_held,
        })
    };
    rows.iter().map(value).collect()
}

pub fn as_text(rows: &[Row]) -> String {
    let mut text = String::from("view  threads   PoE  Mrays/s  stand-ins  error mean  99.9 %  border  working set\n");
    for r in rows {
        text += &format!(
            "{:>4}  {:>7}  {:>4}  {:>7.2}  {:>7.1} %  {:>7.3} px  {:>6.2}  {:>4.2} %  {}{}\n",
            r.view,
            r.threads,
            r.poe,
            r.mrays,
            100.0 * r.lod,
            r.mean,
            r.nearly_worst,
            100.0 * r.border,
            if r.is_held { "" } else { "over " },
            common::in_bytes(r.working_set),
        );
    }
    text
}
