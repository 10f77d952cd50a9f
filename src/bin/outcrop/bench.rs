//! `outcrop bench`.

use crate::accuracy::{self, Task};
use crate::common::{self, Failure, Outcome};
use crate::rays::Kind;
use crate::view::{self, PartArgs};
use outcrop::base::error::Error;
use outcrop::base::progress::Cancel;
use outcrop::import::generate;
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::scene::{Context, ContextOptions, Model, SceneState};
use outcrop::simd::Isa;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Measure the tracing speed in millions of rays per second: single rays and packets of 32, or packets at given pixels
/// of error
#[derive(clap::Args)]
pub struct Args {
    /// The model file
    #[arg(value_name = "MODEL.oc")]
    model: PathBuf,
    /// Kinds of rays
    #[arg(long, value_name = "KINDS", value_delimiter = ',', default_value = "primary,shadow,bounce")]
    rays: Vec<Kind>,
    /// Size of the picture, which has a primary ray for each pixel
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = common::size)]
    size: (u32, u32),
    /// The views to measure, numbered 0 to 3
    #[arg(
        long, value_name = "0..3", value_delimiter = ',', default_value = "0,2", allow_negative_numbers = true,
        value_parser = clap::value_parser!(u8).range(0..=3)
    )]
    view: Vec<u8>,
    /// Use the four views of this generated model instead of those from the bounds
    #[arg(long, value_name = "NAME", value_parser = generate::NAMES_WITH_VIEWS)]
    views: Option<String>,
    /// Numbers of threads
    #[arg(
        long, value_name = "N", value_delimiter = ',', default_value = "1,2", allow_negative_numbers = true,
        value_parser = some_threads
    )]
    threads: Vec<usize>,
    /// Runs of each measurement; the result is their median
    #[arg(
        long, value_name = "N", default_value_t = 5, allow_negative_numbers = true,
        value_parser = clap::value_parser!(u32).range(1..=1000)
    )]
    runs: u32,
    /// Instruction set
    #[arg(long, value_parser = ["baseline", "avx2", "avx512"])]
    isa: Option<String>,
    /// Bytes of memory for the model, with suffix K, M, G or T; may be less than the model needs. 0: three quarters of
    /// the machine's memory
    #[arg(
        long, visible_alias = "memory", value_name = "BYTES", default_value = "0", allow_negative_numbers = true,
        value_parser = common::byte_size
    )]
    cache: u64,
    /// Pixels of error: instead of exact rays, measure pixel rays in packets, with stand-ins of at most this many
    /// square pixels, and the error of the result
    #[arg(
        long, value_name = "POE", value_delimiter = ',', conflicts_with = "rays", allow_negative_numbers = true,
        value_parser = pixels_of_error
    )]
    poe: Vec<f32>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Parses a number of threads of which 0 is none.
fn some_threads(text: &str) -> Result<usize, String> {
    if text == "0" { Err("expected 1 or more".into()) } else { common::threads(text) }
}

fn pixels_of_error(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(poe) if (0.0..=f32::MAX).contains(&poe) => Ok(poe),
        _ => Err("expected a finite number, 0 or more".into()),
    }
}

/// Median speeds in millions of rays per second for one kind of ray, and the number of hits.
struct Row {
    view: u8,
    kind: Kind,
    threads: usize,
    rays: usize,
    hits: usize,
    single: f64,
    packet: f64,
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let cancel = common::cancel_on_ctrl_c();
    let isa = args.isa.as_deref().map(|name| match name {
        "avx512" => Isa::Avx512,
        "avx2" => Isa::Avx2,
        _ => Isa::Baseline,
    });
    let (mut rows, mut rough, mut facts) = (Vec::new(), Vec::new(), Value::Null);
    let kinds = if args.poe.is_empty() { &args.rays[..] } else { &[] };
    let bar = common::progress_bar((args.threads.len() * args.view.len() * kinds.len().max(1)) as u64);
    for &threads in &args.threads {
        let options = ContextOptions { threads, memory_budget: args.cache, isa, ..ContextOptions::default() };
        let context = Context::new(options.clone())?;
        let model = Model::open(&context, &args.model)?;
        let all_in_memory = model.load(&cancel)?;
        let scene = view::alone(&context, &model, &PartArgs::default())?.state();
        facts = json!({
            "model": args.model.to_string_lossy(), "triangles": model.info().triangles_placed,
            "bytes_trace": model.memory().geometry, "all_in_memory": all_in_memory, "isa": context.isa().name(),
        });
        let cameras = view::four(&model, args.views.as_deref());
        for &view in &args.view {
            if !args.poe.is_empty() {
                let task = Task { path: &args.model, options: options.clone(), size: args.size, runs: args.runs };
                let found = accuracy::rows(&task, &scene, &cameras[usize::from(view)], &args.poe, &cancel)?;
                rough.extend(found.into_iter().map(|row| row.at(view, threads)));
                bar.inc(1);
            }
            for &kind in kinds {
                let rays = kind.rays(&scene, &cameras[usize::from(view)], args.size)?;
                rows.push(measure(&scene, kind, &rays, args.runs, &cancel)?.at(view, threads));
                bar.inc(1);
            }
        }
    }
    bar.finish_and_clear();
    let mut value = as_json(facts, args, &rows);
    if args.poe.is_empty() {
        return common::print(args.json, &value, &as_text(&value, &rows));
    }
    value["results"] = accuracy::as_json(&rough);
    common::print(args.json, &value, &(heading(&value) + &accuracy::as_text(&rough)))
}

impl Row {
    fn at(self, view: u8, threads: usize) -> Self {
        Self { view, threads, ..self }
    }
}

/// Measures single rays and packets alternately. The first run of each is a warm-up; its results must agree.
fn measure(scene: &Arc<SceneState>, kind: Kind, rays: &[Ray], runs: u32, cancel: &Cancel) -> Result<Row, Failure> {
    let (single_hits, _) = trace(scene, kind, rays, false)?;
    let (packet_hits, _) = trace(scene, kind, rays, true)?;
    let differ = single_hits.iter().zip(&packet_hits).filter(|(a, b)| a != b).count();
    if differ > 0 {
        let what = format!("{differ} of {} {} rays differ between single and packet", rays.len(), kind.name());
        return Err(Error::Internal(what).into());
    }
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..runs {
        cancel.check()?;
        for (coherent, list) in [false, true].into_iter().zip(&mut times) {
            list.push(trace(scene, kind, rays, coherent)?.1);
        }
    }
    let [single, packet] = times.map(|mut list| {
        list.sort_by(f64::total_cmp);
        rays.len() as f64 / list[list.len() / 2].max(1e-12) / 1e6
    });
    let hits = single_hits.iter().filter(|t| t.is_finite()).count();
    Ok(Row { view: 0, kind, threads: 0, rays: rays.len(), hits, single, packet })
}

/// Returns the distances and the seconds taken. Any-hit queries give 0 or infinity.
fn trace(scene: &Arc<SceneState>, kind: Kind, rays: &[Ray], coherent: bool) -> Result<(Vec<f64>, f64), Failure> {
    let options = QueryOptions { coherent, want: Want::NOTHING, ..QueryOptions::default() };
    if kind == Kind::Shadow {
        let mut hits = vec![0u8; rays.len()];
        let begun = Instant::now();
        scene.any(rays, options, &mut hits)?;
        let seconds = begun.elapsed().as_secs_f64();
        return Ok((hits.iter().map(|&h| if h == 0 { f64::INFINITY } else { 0.0 }).collect(), seconds));
    }
    let mut hits = vec![Hit::MISS; rays.len()];
    let begun = Instant::now();
    scene.closest(rays, options, &mut hits)?;
    let seconds = begun.elapsed().as_secs_f64();
    Ok((hits.iter().map(|h| if h.kind == HitKind::Miss { f64::INFINITY } else { h.t }).collect(), seconds))
}

fn as_json(facts: Value, args: &Args, rows: &[Row]) -> Value {
    let mut value = facts;
    value["width"] = args.size.0.into();
    value["height"] = args.size.1.into();
    value["runs"] = args.runs.into();
    value["results"] = rows
        .iter()
        .map(|r| {
            json!({
                "view": r.view, "rays": r.kind.name(), "threads": r.threads, "count": r.rays, "hits": r.hits,
                "mrays_single": r.single, "mrays_packet": r.packet,
            })
        })
        .collect();
    value
}

fn heading(facts: &Value) -> String {
    format!(
        "{}: {} triangles, {}; Mrays/s, median of {}\n",
        facts["model"].as_str().unwrap_or_default(),
        facts["triangles"],
        facts["isa"].as_str().unwrap_or_default(),
        facts["runs"]
    )
}

fn as_text(facts: &Value, rows: &[Row]) -> String {
    let mut text = heading(facts) + "view  rays     threads  single  packet  hits\n";
    for r in rows {
        let part = 100.0 * r.hits as f64 / r.rays.max(1) as f64;
        text += &format!(
            "{:>4}  {:8} {:>7}  {:>6.2}  {:>6.2}  {part:.0} %\n",
            r.view,
            r.kind.name(),
            r.threads,
            r.single,
            r.packet
        );
    }
    text
}
