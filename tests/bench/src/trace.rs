//! Measures rays: outcrop at each setting and its peers, each in turn with the same opponent.

use crate::accuracy::{self, Truth};
use crate::common::errors::Judge;
use crate::counted::OneTree;
use crate::data::{Benchmark, Case, Data, RayKind, Residency};
use crate::expected::{Book, Expected};
use crate::failure::Failure;
use crate::ours::{self, ModelAt, Ours, Ready};
use crate::pairs::{Clock, Pairs, Spread, steady};
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

/// A benchmark on one scene.
pub struct Task<'a> {
    pub data: &'a Data,
    pub benchmark: &'a Benchmark,
    pub scene: &'a Scene,
    pub book: &'a mut Book,
    /// Only what answers are, without times and peers.
    pub is_only_expecting: bool,
    pub clock: Clock,
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

    /// Seconds of a run.
    fn timed(&self, run: &mut dyn Run, threads: usize) -> f64 {
        run.prepare();
        let begun = self.clock.now();
        std::hint::black_box(run.run(threads));
        self.clock.now() - begun
    }
}

/// All cases of a benchmark on one scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let (mut records, mut peers) = (Vec::new(), Vec::new());
    if !task.is_only_expecting && !task.benchmark.peers.is_empty() {
        peers = all_peers(task)?;
    }
    for structure in &task.benchmark.structures {
        let row = task.data.structure(structure);
        let mut sides = vec![Side::open(structure.clone(), task.scene.model(row)?)?];
        if task.scene.row.has_many_trees() {
            let name = format!("{structure} flattened");
            let model = task.scene.flattened(row, &name)?;
            sides.push(Side::open(name, model)?);
        }
        let cases = || task.benchmark.cases().into_iter().filter(|case| case.structure == *structure);
        let (pictures, rays): (Vec<Case>, Vec<Case>) = cases().partition(|case| case.rays == RayKind::Picture);
        let shown: Vec<pictures::Side> = sides.iter().map(Side::shown).collect();
        // Pictures are the work of a context's own threads.
        let is_wall = task.clock == Clock::Wall;
        for case in pictures.iter().filter(|_| is_wall) {
            records.extend(pictures::measure(task, case, &shown[0], shown.get(1))?);
        }
        if rays.is_empty() {
            continue;
        }
        // The oracle takes one tree: of many trees the flattened one.
        let oracle = Oracle::of(&sides.last().expect("one side at least").model.path)?;
        let models = Models { sides: &sides, oracle: &oracle, judge: oracle.truth.judge() };
        for case in rays {
            records.extend(rays_of(task, &case, &models, &peers)?);
        }
    }
    Ok(records)
}

/// A model, all in memory, under the name that results have of it.
struct Side {
    name: String,
    model: ModelAt,
    ours: Ours,
}

impl Side {
    fn open(name: String, model: ModelAt) -> Result<Self, Failure> {
        Ok(Self { ours: Ours::open(&model, Residency::All, 0)?, name, model })
    }

    fn shown(&self) -> pictures::Side<'_> {
        pictures::Side { name: &self.name, model: &self.model, loaded: &self.ours }
    }
}

/// The truth of a model of one tree, and what its walks do.
struct Oracle {
    truth: Truth,
    tree: Option<OneTree>,
}

impl Oracle {
    fn of(path: &Path) -> Result<Self, Failure> {
        Ok(Self { truth: Truth::of(path)?, tree: OneTree::of(path)? })
    }
}

/// What is measured on a scene: its model, and of a scene of many trees the flattened model beside it.
struct Models<'a> {
    sides: &'a [Side],
    /// Of the last side.
    oracle: &'a Oracle,
    judge: Judge<'a>,
}

impl Models<'_> {
    /// The side of the oracle.
    fn last(&self) -> &Side {
        self.sides.last().expect("one side at least")
    }
}

/// A peer that was built.
struct Rival {
    name: &'static str,
    quality: &'static str,
    peer: Box<dyn Peer>,
}

/// Triangles of which peers build with spatial splits at most: of 40 million, beside their others and the oracle, that
/// takes more than 24 GB. (Of scans, which the larger ones are, splits gain nothing.)
const MOST_SPLIT: usize = 20_000_000;

/// Every peer in every quality that it is traced with; of a scene of many trees in two levels.
fn all_peers(task: &Task) -> Result<Vec<Rival>, Failure> {
    let builds = task.benchmark.peers.iter().flat_map(|peer| peers::builds(peer, true));
    if task.scene.row.has_many_trees() {
        let placed = task.scene.placed()?;
        eprintln!("{}: {} placements, {} triangles", task.scene.row.name, placed.places.len(), placed.triangles());
        let built = |build: peers::Build| {
            let peer = build.build_placed(&placed, 0)?;
            Some(Rival { name: build.peer, quality: build.quality, peer })
        };
        return Ok(builds.filter_map(built).collect());
    }
    let mesh = Arc::new(task.scene.mesh()?);
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
    /// Whether it is the flattened model of a scene of many trees.
    is_flattened: bool,
    is_peer: bool,
    call: String,
    poe: f32,
    run: Box<dyn Run + 'a>,
    counters: Counters,
    accuracy: Accuracy,
    hits: usize,
}

fn rays_of(task: &mut Task, case: &Case, models: &Models, peers: &[Rival]) -> Result<Vec<Record>, Failure> {
    let first = &models.sides[0];
    let camera = first.ours.camera(task.scene, case.view);
    let batch = Batch::new(case.rays, &first.ours.state, &camera, task.benchmark.size)?;
    let id = task.benchmark.id(&task.scene.row.name, case, 0.0);
    eprintln!("{id}: {} rays", batch.rays.len());
    if batch.rays.is_empty() {
        return Err(Failure::new("no rays: nothing is seen"));
    }
    let exact =
        |side: &Side| -> Result<Vec<Answer>, Failure> { Ok(ours::answers(&side.ours.hits(&batch.at(0.0), &batch)?)) };
    let truth = exact(models.last())?;
    if models.sides.len() > 1 {
        accuracy::compare_flattened(&id, &batch.rays, &exact(first)?, &truth)?;
    }
    let opened;
    let again = match case.residency {
        Residency::All => None,
        other => {
            opened = Ours::open(&first.model, other, 0)?;
            Some(&opened)
        }
    };
    let mut contenders = Vec::new();
    for side in models.sides {
        let case = Case { structure: side.name.clone(), ..case.clone() };
        for &poe in &task.benchmark.poe {
            contenders.push(our_side(task, &case, models, side, again.unwrap_or(&side.ours), &batch, poe, &truth)?);
        }
    }
    if task.is_only_expecting {
        return Ok(Vec::new());
    }
    let mut records = Vec::new();
    for &threads in task.benchmark.threads.iter().filter(|threads| task.clock == Clock::Wall || **threads == 1) {
        let mut all: Vec<&mut Contender> = contenders.iter_mut().collect();
        let mut others = best_calls(task, peers, &batch, threads, &truth)?;
        all.extend(others.iter_mut());
        records.extend(in_turn(task, case, &batch, threads, &mut all, models.last().ours.model.info().triangles_in));
    }
    Ok(records)
}

/// outcrop at one setting, its answers checked.
#[allow(clippy::too_many_arguments)] // a case, a model and a setting
fn our_side<'a>(
    task: &mut Task,
    case: &Case,
    models: &Models<'a>,
    side: &'a Side,
    ours: &'a Ours,
    batch: &Batch,
    poe: f32,
    truth: &[Answer],
) -> Result<Contender<'a>, Failure> {
    let rays = batch.at(poe);
    let hits = ours.hits(&rays, batch)?;
    let expected = Expected::of_hits(&hits);
    let id = task.benchmark.id(&task.scene.row.name, case, poe);
    let is_flattened = side.name != models.sides[0].name;
    // The oracle knows one tree; answers of many are compared with the flattened ones.
    let oracle = (is_flattened || models.sides.len() == 1).then_some(models.oracle);
    if let (Some(oracle), 0.0) = (oracle, poe) {
        oracle.truth.check(&models.judge, &id, batch, &hits)?;
    }
    let met = expected.hits;
    task.book.check(&id, expected)?;
    let stand_ins = hits.iter().filter(|hit| hit.kind == HitKind::Lod).count() as u64;
    let tree = oracle.and_then(|oracle| oracle.tree.as_ref());
    let counters = Counters {
        bytes_model: Some(ours.model.memory().geometry),
        bytes_working_set: Some(ours::working_set(&side.model, &rays, batch)?),
        // Any hits do not say what they are.
        stand_ins: (!batch.is_any()).then_some(stand_ins),
        each: tree.map(|tree| tree.count(&rays, batch.is_any())),
        together: tree.filter(|_| batch.is_coherent()).map(|tree| tree.count_together(&rays, batch.is_any())),
    };
    let slack = match oracle {
        Some(oracle) if !batch.is_any() => oracle.truth.slack(&id, &hits)?,
        _ => None,
    };
    let accuracy = Accuracy { slack, ..accuracy::of_rays(&batch.rays, &ours::answers(&hits), truth) };
    // However many are asked for at once, and whatever of each hit.
    let whole = (case.residency == Residency::All).then(|| ours.asked_as_timed(&rays, batch)).transpose()?;
    let mut run = Box::new(Ready::new(ours, &side.model, case.residency, batch, task.benchmark.asked.get(), rays));
    if let Some(whole) = whole {
        run.run(1);
        let (whole, asked) = (ours::answers(&whole), run.answers());
        if let Some(i) = (0..whole.len()).find(|&i| whole[i] != asked[i]) {
            return Err(Failure::new(format!(
                "{id}: ray {i} of calls as timed ends at {}, of one call at {}",
                asked[i].t, whole[i].t
            )));
        }
    }
    let call = if batch.is_coherent() { "coherent" } else { "any order" };
    let (side, call) = (case.structure.clone(), format!("{call}, {} a call", task.benchmark.asked));
    Ok(Contender { side, is_flattened, is_peer: false, call, poe, run, counters, accuracy, hits: met })
}

/// The fastest way of asking each peer, of two runs each; where ours are asked one by one, so are theirs.
fn best_calls<'a>(
    task: &Task,
    peers: &'a [Rival],
    batch: &Batch,
    threads: usize,
    truth: &[Answer],
) -> Result<Vec<Contender<'a>>, Failure> {
    let mut best: BTreeMap<&str, (f64, Contender<'a>)> = BTreeMap::new();
    let exact: Vec<Ray> = batch.at(0.0);
    for Rival { name, quality, peer } in peers {
        for call in peer.calls(batch).into_iter().filter(|call| task.benchmark.asked.get() > 1 || *call == "1") {
            let mut run = peer.ready(call, batch, &exact);
            let took = task.timed(&mut *run, threads).min(task.timed(&mut *run, threads));
            if best.get(name).is_some_and(|(least, _)| *least <= took) {
                continue;
            }
            let answers = run.answers();
            let accuracy = accuracy::of_rays(&batch.rays, &answers, truth);
            let call = format!("{}, {quality}, {call} a call", peer.version());
            accuracy::assert_peer_agrees(&call, &accuracy, &batch.rays, &answers, truth)?;
            let counters = Counters { bytes_model: Some(peer.bytes()), ..Counters::default() };
            let hits = answers.iter().filter(|a| a.is_hit()).count();
            let contender = Contender {
                side: (*name).into(),
                is_flattened: false,
                is_peer: true,
                call,
                poe: 0.0,
                run,
                counters,
                accuracy,
                hits,
            };
            best.insert(name, (took, contender));
        }
    }
    Ok(best.into_values().map(|(_, contender)| contender).collect())
}

/// The pairs of contenders: each with Embree, or where that is missing with the first, which is ours, exact. Of a scene
/// of many trees each setting of ours with the same setting of the flattened model, and the exact one with each peer.
fn pairs_of(all: &[&mut Contender]) -> Vec<(usize, usize)> {
    let of = |i: usize| &*all[i];
    if !all.iter().any(|c| c.is_flattened) {
        let opponent = all.iter().position(|c| c.side == "embree").unwrap_or(0);
        return (0..all.len()).filter(|&i| i != opponent).map(|i| (i, opponent)).collect();
    }
    let ours = (0..all.len()).filter(|&i| !of(i).is_peer && !of(i).is_flattened);
    let beside = |i: usize, j: usize| {
        if of(j).is_peer { of(i).poe == 0.0 } else { of(j).is_flattened && of(j).poe == of(i).poe }
    };
    ours.flat_map(|i| (0..all.len()).filter(move |&j| beside(i, j)).map(move |j| (i, j))).collect()
}

/// All pairs; what others are paired with has a record of its own, of its first pair.
fn in_turn(
    task: &Task,
    case: &Case,
    batch: &Batch,
    threads: usize,
    all: &mut [&mut Contender],
    triangles: u64,
) -> Vec<Record> {
    let mut records = Vec::new();
    let mut opponents: BTreeMap<usize, Spread> = BTreeMap::new();
    for (i, opponent) in pairs_of(all) {
        let [a, b] = all.get_disjoint_mut([i, opponent]).expect("two of them");
        let pairs = Pairs::in_turn(
            task.benchmark.rounds,
            || steady(|| task.timed(&mut *a.run, threads)),
            || steady(|| task.timed(&mut *b.run, threads)),
        );
        let (seconds, theirs) = (Spread::of(&pairs.a), Spread::of(&pairs.b));
        let against = Against { side: b.side.clone(), call: b.call.clone(), seconds: theirs, ratio: pairs.ratio() };
        records.push(result(task, case, batch, threads, a, seconds, Some(against), triangles));
        opponents.entry(opponent).or_insert(theirs);
    }
    if opponents.is_empty() {
        let run = &mut *all[0].run;
        task.timed(run, threads);
        opponents.insert(
            0,
            Spread::of(&(0..task.benchmark.rounds).map(|_| steady(|| task.timed(run, threads))).collect::<Vec<_>>()),
        );
    }
    for (opponent, seconds) in opponents {
        records.push(result(task, case, batch, threads, all[opponent], seconds, None, triangles));
    }
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
        call: format!("{}{}", contender.call, task.clock.remark()),
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
    // A side of a scene of many trees is in pairs with several.
    let beside = trace
        .against
        .as_ref()
        .filter(|_| task.scene.row.has_many_trees())
        .map_or(String::new(), |a| format!(" beside {}", a.side));
    let key = format!("{id}/{}{beside}/{threads}", contender.side);
    task.record(key, triangles, Outcomes::Trace(Box::new(trace)))
}
