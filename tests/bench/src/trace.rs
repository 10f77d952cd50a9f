//! Measures rays: outcrop at each setting and its peers, each in turn with the same opponent.

use crate::accuracy::{self, Truth};
use crate::common::errors::Judge;
use crate::counted::OneTree;
use crate::data::{Benchmark, Case, Data, RayKind, Residency};
use crate::expected::{Book, Expected};
use crate::failure::Failure;
use crate::ours::{self, Ours, Ready};
use crate::pairs::{Pairs, Spread, steady};
use crate::peers::{self, Peer};
use crate::pictures;
use crate::rays::Batch;
use crate::record::{Accuracy, Against, Counters, Outcomes, Record, Run as At, Trace};
use crate::scenes::Scene;
use crate::sides::{Answer, Run};
use outcrop::math::Ray;
use outcrop::query::HitKind;
use outcrop::simd::Isa;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// A benchmark on one scene.
pub struct Task<'a> {
    pub data: &'a Data,
    pub benchmark: &'a Benchmark,
    pub scene: &'a Scene,
    pub book: &'a mut Book,
    /// Only what answers are, without times and peers.
    pub is_only_expecting: bool,
}

/// Where and when it is now.
pub fn run_now() -> At {
    At::now(Isa::best().name())
}

impl Task<'_> {
    pub fn record(&self, key: String, triangles: u64, result: Outcomes) -> Record {
        let row = &self.scene.row;
        let (scene, title) = (row.name.clone(), row.title.clone());
        let run = run_now();
        Record { key, benchmark: self.benchmark.name.clone(), scene, title, triangles, run, result }
    }
}

/// All cases of a benchmark on one scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let (mut records, mut peers) = (Vec::new(), Vec::new());
    if !task.is_only_expecting && !task.benchmark.peers.is_empty() {
        peers = all_peers(task)?;
    }
    for structure in &task.benchmark.structures {
        let path = task.scene.model(task.data.structure(structure))?;
        let ours = Ours::open(&path, Residency::All, 0)?;
        let cases = || task.benchmark.cases().into_iter().filter(|case| case.structure == *structure);
        let (pictures, rays): (Vec<Case>, Vec<Case>) = cases().partition(|case| case.rays == RayKind::Picture);
        for case in pictures {
            records.extend(pictures::measure(task, &case, &path, &ours)?);
        }
        if rays.is_empty() {
            continue;
        }
        let truth = Truth::of(&path)?;
        let tree = OneTree::of(&path)?;
        let model = Opened { path: &path, ours: &ours, truth: &truth, judge: truth.judge(), tree };
        for case in rays {
            records.extend(rays_of(task, &case, &model, &peers)?);
        }
    }
    Ok(records)
}

/// A model under test.
struct Opened<'a> {
    path: &'a Path,
    /// All in memory.
    ours: &'a Ours,
    truth: &'a Truth,
    judge: Judge<'a>,
    tree: Option<OneTree>,
}

/// A peer that was built.
struct Rival {
    name: &'static str,
    quality: &'static str,
    peer: Box<dyn Peer>,
}

/// Triangles of which peers build with spatial splits at most: of 40 million, beside their others and the oracle, that takes more than 24 GB.
/// (Of scans, which the larger ones are, splits gain nothing.)
const MOST_SPLIT: usize = 20_000_000;

/// Every peer in every quality that it is traced with.
fn all_peers(task: &Task) -> Result<Vec<Rival>, Failure> {
    let mesh = Arc::new(task.scene.mesh()?);
    let builds = task.benchmark.peers.iter().flat_map(|peer| peers::builds(peer, true));
    let builds = builds.filter(|build| {
        let is_too_much = build.quality == "high" && mesh.triangles.len() > MOST_SPLIT;
        if is_too_much {
            eprintln!("skipped: {} ({}): its build does not fit the memory", build.peer, build.quality);
        }
        !is_too_much
    });
    let built = |build: peers::Build| {
        eprintln!("{}: {} builds ({})", task.scene.row.name, build.peer, build.quality);
        Some(Rival { name: build.peer, quality: build.quality, peer: build.build(&mesh, 0)? })
    };
    Ok(builds.filter_map(built).collect())
}

/// Something that traces the rays of a case.
struct Contender<'a> {
    side: String,
    is_peer: bool,
    call: String,
    poe: f32,
    run: Box<dyn Run + 'a>,
    counters: Counters,
    accuracy: Accuracy,
    hits: usize,
}

fn rays_of(task: &mut Task, case: &Case, model: &Opened, peers: &[Rival]) -> Result<Vec<Record>, Failure> {
    let camera = model.ours.camera(task.scene, case.view);
    let batch = Batch::new(case.rays, &model.ours.state, &camera, task.benchmark.size)?;
    eprintln!("{}: {} rays", task.benchmark.id(&task.scene.row.name, case, 0.0), batch.rays.len());
    if batch.rays.is_empty() {
        return Err(Failure::new("no rays: nothing is seen"));
    }
    let opened;
    let ours = match case.residency {
        Residency::All => model.ours,
        other => {
            opened = Ours::open(model.path, other, 0)?;
            &opened
        }
    };
    let truth = ours::answers(&model.ours.hits(&batch.at(0.0), &batch)?);
    let mut contenders = Vec::new();
    for &poe in &task.benchmark.poe {
        contenders.push(our_side(task, case, model, ours, &batch, poe, &truth)?);
    }
    if task.is_only_expecting {
        return Ok(Vec::new());
    }
    let mut records = Vec::new();
    for &threads in &task.benchmark.threads {
        let mut all: Vec<&mut Contender> = contenders.iter_mut().collect();
        let mut others = best_calls(peers, task.benchmark.asked.get(), &batch, threads, &truth)?;
        all.extend(others.iter_mut());
        records.extend(in_turn(task, case, &batch, threads, &mut all, model.ours.model.info().triangles_in));
    }
    Ok(records)
}

/// outcrop at one setting, its answers checked.
fn our_side<'a>(
    task: &mut Task,
    case: &Case,
    model: &Opened,
    ours: &'a Ours,
    batch: &Batch,
    poe: f32,
    truth: &[Answer],
) -> Result<Contender<'a>, Failure> {
    let rays = batch.at(poe);
    let hits = ours.hits(&rays, batch)?;
    let expected = Expected::of_hits(&hits);
    let id = task.benchmark.id(&task.scene.row.name, case, poe);
    if poe == 0.0 {
        model.truth.check(&model.judge, &id, batch, &hits)?;
    }
    let met = expected.hits;
    task.book.check(&id, expected)?;
    let stand_ins = hits.iter().filter(|hit| hit.kind == HitKind::Lod).count() as u64;
    let counters = Counters {
        bytes_model: Some(ours.model.memory().geometry),
        bytes_working_set: Some(ours::working_set(model.path, &rays, batch)?),
        // Any hits do not say what they are.
        stand_ins: (!batch.is_any()).then_some(stand_ins),
        each: model.tree.as_ref().map(|tree| tree.count(&rays, batch.is_any())),
        together: model.tree.as_ref().filter(|_| batch.is_coherent()).map(|tree| tree.count_together(&rays, batch.is_any())),
    };
    let slack = if batch.is_any() { None } else { model.truth.slack(&id, &hits)? };
    let accuracy = Accuracy { slack, ..accuracy::of_rays(&batch.rays, &ours::answers(&hits), truth) };
    // However many are asked for at once, and whatever of each hit.
    let whole = (case.residency == Residency::All).then(|| ours.asked_as_timed(&rays, batch)).transpose()?;
    let mut run = Box::new(Ready::new(ours, model.path, case.residency, batch, task.benchmark.asked.get(), rays));
    if let Some(whole) = whole {
        run.run(1);
        let (whole, asked) = (ours::answers(&whole), run.answers());
        if let Some(i) = (0..whole.len()).find(|&i| whole[i] != asked[i]) {
            return Err(Failure::new(format!("{id}: ray {i} of calls as timed ends at {}, of one call at {}", asked[i].t, whole[i].t)));
        }
    }
    let call = if batch.is_coherent() { "coherent" } else { "any order" };
    let (side, call) = (case.structure.clone(), format!("{call}, {} a call", task.benchmark.asked));
    Ok(Contender { side, is_peer: false, call, poe, run, counters, accuracy, hits: met })
}

/// The fastest way of asking each peer, of two runs each; where ours are asked one by one, so are theirs.
fn best_calls<'a>(
    peers: &'a [Rival],
    asked: usize,
    batch: &Batch,
    threads: usize,
    truth: &[Answer],
) -> Result<Vec<Contender<'a>>, Failure> {
    let mut best: BTreeMap<&str, (f64, Contender<'a>)> = BTreeMap::new();
    let exact: Vec<Ray> = batch.at(0.0);
    for Rival { name, quality, peer } in peers {
        for call in peer.calls(batch).into_iter().filter(|call| asked > 1 || *call == "1") {
            let mut run = peer.ready(call, batch, &exact);
            let took = timed(&mut *run, threads).min(timed(&mut *run, threads));
            if best.get(name).is_some_and(|(least, _)| *least <= took) {
                continue;
            }
            let answers = run.answers();
            let accuracy = accuracy::of_rays(&batch.rays, &answers, truth);
            let call = format!("{}, {quality}, {call} a call", peer.version());
            accuracy::assert_peer_agrees(&call, &accuracy, &batch.rays, &answers, truth)?;
            let counters = Counters { bytes_model: Some(peer.bytes()), ..Counters::default() };
            let hits = answers.iter().filter(|a| a.is_hit()).count();
            let contender = Contender { side: (*name).into(), is_peer: true, call, poe: 0.0, run, counters, accuracy, hits };
            best.insert(name, (took, contender));
        }
    }
    Ok(best.into_values().map(|(_, contender)| contender).collect())
}

/// Seconds of a run.
fn timed(run: &mut dyn Run, threads: usize) -> f64 {
    run.prepare();
    let begun = Instant::now();
    std::hint::black_box(run.run(threads));
    begun.elapsed().as_secs_f64()
}

/// Each in pairs with Embree, or where that is missing with the first: ours, exact.
fn in_turn(task: &Task, case: &Case, batch: &Batch, threads: usize, all: &mut [&mut Contender], triangles: u64) -> Vec<Record> {
    let opponent = all.iter().position(|c| c.side == "embree").unwrap_or(0);
    let mut records = Vec::new();
    let mut against_itself = None;
    for i in (0..all.len()).filter(|&i| i != opponent) {
        let [a, b] = all.get_disjoint_mut([i, opponent]).expect("two of them");
        let pairs = Pairs::in_turn(task.benchmark.rounds, || steady(|| timed(&mut *a.run, threads)), || steady(|| timed(&mut *b.run, threads)));
        let (seconds, theirs) = (Spread::of(&pairs.a), Spread::of(&pairs.b));
        let against = Against { side: b.side.clone(), call: b.call.clone(), seconds: theirs, ratio: pairs.ratio() };
        records.push(result(task, case, batch, threads, a, seconds, Some(against), triangles));
        against_itself.get_or_insert(theirs);
    }
    let itself = against_itself.unwrap_or_else(|| {
        let run = &mut *all[opponent].run;
        timed(run, threads);
        Spread::of(&(0..task.benchmark.rounds).map(|_| steady(|| timed(run, threads))).collect::<Vec<_>>())
    });
    records.push(result(task, case, batch, threads, all[opponent], itself, None, triangles));
    records
}

#[allow(clippy::too_many_arguments)] // a row of a table
fn result(
    task: &Task,
    case: &Case,
    batch: &Batch,
    threads: usize,
    contender: &Contender,
    seconds: Spread,
    against: Option<Against>,
    triangles: u64,
) -> Record {
    let count = batch.rays.len();
    let mrays = count as f64 / seconds.median / 1e6;
    let id = task.benchmark.id(&task.scene.row.name, case, contender.poe);
    let ratio = against.as_ref().map_or(String::new(), |a| {
        format!(", {:.2} [{:.2} .. {:.2}] of {}", a.ratio.median, a.ratio.least, a.ratio.most, a.side)
    });
    let poe = if contender.is_peer { String::new() } else { format!(" PoE {}", contender.poe) };
    let off = match case.rays {
        RayKind::Primary => format!("{:.3} px", contender.accuracy.mean_px),
        _ => format!("{:.2} % otherwise", 100.0 * contender.accuracy.otherwise.unwrap_or(0.0)),
    };
    eprintln!("    {}{poe}, {threads} threads: {mrays:.2} Mrays/s{ratio}; {off}", contender.side);
    let trace = Trace {
        side: contender.side.clone(),
        is_peer: contender.is_peer,
        call: contender.call.clone(),
        residency: case.residency.name(),
        view: case.view,
        rays: case.rays.name().into(),
        poe: contender.poe,
        threads,
        count,
        hits: contender.hits,
        seconds,
        mrays,
        against,
        counters: contender.counters.clone(),
        accuracy: contender.accuracy.clone(),
    };
    task.record(format!("{id}/{}/{threads}", contender.side), triangles, Outcomes::Trace(Box::new(trace)))
}
