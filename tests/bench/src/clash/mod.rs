//! Measures searches for clashes: all pairs of triangles of two instances, or of different parts, that meet, beside
//! peers which get the same triangles, and out of core. Peers' pairs are compared with those of exact arithmetic.

mod bodies;
mod overlap;
mod rivals;

use crate::common::sources;
use crate::data::Residency;
use crate::expected::Expected;
use crate::failure::Failure;
use crate::ours::{ModelAt, Ours};
use crate::pairs::{Clock, Pairs, Spread, steady};
use crate::record::{Against, Clashed, Outcomes, Record};
use crate::trace::Task;
use bodies::{Bodies, Pair};
use glam::{DAffine3, DVec3};
use outcrop::base::error::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::geom::pairs::{Relation, relate};
use outcrop::query::clash::{ClashDetail, ClashKind, ClashOptions, ClashRules, ClashSummary};
use outcrop::scene::{Context, ContextOptions, Model, Scene, SceneState};
use rivals::{Rival, rivals};
use std::fmt::Write;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::time::Duration;

/// A search: what is compared, on which model.
struct Search {
    stored: ModelAt,
    bodies: Bodies,
    rules: ClashRules,
}

impl Search {
    fn of(task: &Task) -> Result<Self, Failure> {
        let row = task.data.structure(&task.benchmark.structures[0]);
        let (mut stored, mesh) = (task.scene.model(row)?, task.scene.mesh()?);
        let ours = Ours::open(&stored, Residency::Cold, 0)?;
        let corners = corners(&ours, mesh.triangles.len())?;
        let Some(angle) = task.benchmark.turn else {
            let bodies = Bodies::of_parts(&corners, &mesh.parts);
            return Ok(Self { stored, bodies, rules: ClashRules::default() });
        };
        let bounds = ours.model.info().bounds;
        let middle = (bounds.min + bounds.max) * 0.5;
        let about = |p: DVec3| DAffine3::from_translation(p);
        stored.places = vec![DAffine3::IDENTITY, about(middle) * DAffine3::from_rotation_z(angle) * about(-middle)];
        let bodies = Bodies::of_places(&corners, &stored.places);
        Ok(Self { stored, bodies, rules: ClashRules { same_instance: true, ..ClashRules::default() } })
    }

    fn options(&self, detail: ClashDetail) -> ClashOptions {
        ClashOptions { detail, rules: self.rules.clone(), limit: u64::MAX, ..ClashOptions::default() }
    }

    fn run(&self, state: &SceneState, detail: ClashDetail) -> Result<ClashSummary, Failure> {
        let mut sum = 0;
        let take = &mut |clash: &outcrop::query::clash::Clash| sum ^= clash.count;
        let summary = state.clash(&self.options(detail), &Progress::default(), &Cancel::new(), take)?;
        std::hint::black_box(sum);
        Ok(summary)
    }

    /// All pairs of triangles that meet, in order.
    fn pairs(&self, state: &SceneState) -> Result<Vec<Pair>, Failure> {
        let each = self.bodies.triangles / self.stored.places.len();
        let mut pairs = Vec::new();
        let options = self.options(ClashDetail::Triangles);
        state.clash(&options, &Progress::default(), &Cancel::new(), &mut |clash| {
            if clash.kind <= ClashKind::Touching {
                let id = |k: usize| (each as u64 * (clash.instances[k] - 1) + clash.prims[k]) as u32;
                pairs.push([id(0).min(id(1)), id(0).max(id(1))]);
            }
        })?;
        pairs.sort_unstable();
        Ok(pairs)
    }
}

/// The corners of the triangles as the model stores them: on models whose coordinates differ much in size they are
/// rounded, and which triangles touch depends on that. Those that it lacks have no area here either.
fn corners(ours: &Ours, count: usize) -> Result<Vec<[DVec3; 3]>, Failure> {
    let mut all = vec![[DVec3::ZERO; 3]; count];
    for part in 0..ours.model.info().parts {
        let mut reader = ours.model.read_part(part)?;
        loop {
            let some = reader.next(1 << 16, &Cancel::new())?;
            if some.is_empty() {
                break;
            }
            some.iter().for_each(|triangle| all[triangle.prim as usize] = triangle.corners);
        }
    }
    Ok(all)
}

/// How many pairs of `found` are apart by exact arithmetic, and how many of `exact` it lacks. Both are in order.
/// Fails if `exact` is what is wrong.
fn wrong(corners: &[[DVec3; 3]], exact: &[Pair], found: &[Pair]) -> Result<[usize; 2], Failure> {
    let meets = |pair: &Pair| relate(&corners[pair[0] as usize], &corners[pair[1] as usize]) != Relation::Apart;
    let not_in = |these: &[Pair], others: &[Pair]| -> Vec<Pair> {
        these.iter().filter(|pair| others.binary_search(pair).is_err()).copied().collect()
    };
    let (more, missed) = (not_in(found, exact), not_in(exact, found));
    if let Some(pair) = more.iter().find(|pair| meets(pair)) {
        return Err(Failure::new(format!("wrong answers: the triangles {pair:?} meet, and are not found")));
    }
    if let Some(pair) = missed.iter().find(|pair| !meets(pair)) {
        return Err(Failure::new(format!("wrong answers: the triangles {pair:?} are found, and are apart")));
    }
    Ok([more.len(), missed.len()])
}

/// A benchmark on one scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let search = Search::of(task)?;
    let name = format!("{}/{}", task.benchmark.name, task.scene.row.name);
    let ours = Ours::open(&search.stored, Residency::All, 0)?;
    let exact = search.pairs(&ours.state)?;
    let bytes: Vec<u8> = exact.as_flattened().iter().flat_map(|id| id.to_le_bytes()).collect();
    task.book.check(&format!("{name}/pairs"), Expected::of_bytes(exact.len(), &bytes))?;
    let mut records = Vec::new();
    if task.is_only_expecting {
        return Ok(records);
    }
    let triangles = search.bodies.triangles as u64;
    let mut add = |task: &Task, key: &str, found: Clashed| {
        eprintln!("{name}/{key}: {}", line(&found));
        records.push(task.record(format!("{name}/{key}"), triangles, Outcomes::Clash(found)));
    };
    let clock = task.clock;
    let timed = |work: &mut dyn FnMut()| {
        let begun = clock.now();
        work();
        clock.now() - begun
    };
    let timed = &timed;
    let search = &search;
    let run = |ours: &Ours, detail: ClashDetail| {
        let state = Arc::clone(&ours.state);
        move || {
            steady(|| {
                timed(&mut || {
                    search.run(&state, detail).expect("it did before");
                })
            })
        }
    };
    let corners = search.bodies.corners();
    let summary = search.run(&ours.state, ClashDetail::Parts)?;
    let mine = |call: &str, threads: usize, seconds: &[f64]| Clashed {
        side: task.benchmark.structures[0].clone(),
        call: call.into(),
        threads,
        seconds: Spread::of(seconds),
        pairs: exact.len(),
        places: Some(summary.steps.places),
        tested: Some(summary.steps.triangles),
        ..Clashed::default()
    };
    let rounds = task.benchmark.rounds;
    // The fastest of all peers is paired with outcrop; of the others there are times.
    let mut fastest: Option<(f64, Box<dyn Rival + '_>)> = None;
    for peer in &task.benchmark.peers {
        for rival in rivals(peer, &search.bodies) {
            let (mut met, mut tested) = (Vec::new(), 0);
            let took = timed(&mut || tested = rival.all(&mut met));
            met.sort_unstable();
            met.dedup();
            let wrong = wrong(&corners, &exact, &met)?;
            let first: Option<Vec<f64>> = (0..3)
                .map(|_| {
                    let mut is_told = None;
                    let took = timed(&mut || is_told = rival.any());
                    is_told.map(|_| took)
                })
                .collect();
            let found = Clashed {
                side: peer.clone(),
                is_peer: true,
                call: rival.name(),
                threads: 1,
                seconds: Spread::of(&[took]),
                pairs: met.len(),
                wrong: Some(wrong),
                tested: Some(tested),
                first: first.map(|seconds| Spread::of(&seconds)),
                ..Clashed::default()
            };
            add(task, &rival.name(), found);
            if fastest.as_ref().is_none_or(|(least, _)| took < *least) {
                fastest = Some((took, rival));
            }
        }
    }
    for (detail, called) in [(ClashDetail::Parts, "parts"), (ClashDetail::Triangles, "triangles")] {
        let mut mine_once = run(&ours, detail);
        let (times, against) = match &fastest {
            Some((_, rival)) => {
                let mut met = Vec::new();
                let mut theirs = || {
                    steady(|| {
                        timed(&mut || {
                            met.clear();
                            rival.all(&mut met);
                        })
                    })
                };
                let pairs = Pairs::in_turn(rounds, &mut mine_once, &mut theirs);
                let (side, call) = ("the fastest peer".into(), rival.name());
                let against = Against { side, call, seconds: Spread::of(&pairs.b), ratio: pairs.ratio() };
                (pairs.a, Some(against))
            }
            None => ((0..rounds).map(|_| mine_once()).collect(), None),
        };
        add(task, called, Clashed { against, ..mine(called, 1, &times) });
    }
    if task.clock == Clock::Thread {
        return Ok(records);
    }
    for &threads in task.benchmark.threads.iter().filter(|&&threads| threads > 1) {
        let many = Ours::open(&search.stored, Residency::All, threads)?;
        let (mut a, mut b) = (run(&many, ClashDetail::Parts), run(&ours, ClashDetail::Parts));
        let pairs = Pairs::in_turn(rounds, &mut a, &mut b);
        let (side, call) = ("one thread".into(), "parts".into());
        let against = Some(Against { side, call, seconds: Spread::of(&pairs.b), ratio: pairs.ratio() });
        add(task, &format!("{threads} threads"), Clashed { against, ..mine("parts", threads, &pairs.a) });
    }
    for &share in &task.benchmark.budget_shares {
        let budget = least_budget(search, ours.model.memory().geometry / share)?;
        let whole = OutOfCore::new(search, 0)?.run(search, &summary)?;
        let mut runs = Vec::new();
        let mut a = || {
            let out = OutOfCore::new(search, budget).and_then(|cold| cold.run(search, &summary));
            let seconds = out.as_ref().map_or(1.0, |out| out.seconds);
            runs.push(out);
            seconds
        };
        let pairs = Pairs::in_turn(rounds, &mut a, run(&ours, ClashDetail::Parts));
        let outs = runs.into_iter().collect::<Result<Vec<Out>, Failure>>()?;
        let last = &outs[outs.len() - 1];
        let (side, call) = ("in core".into(), "parts".into());
        let against = Some(Against { side, call, seconds: Spread::of(&pairs.b), ratio: pairs.ratio() });
        let found = Clashed {
            against,
            budget,
            blocks: Some([whole.blocks, last.blocks]),
            bytes_most: outs.iter().map(|out| out.bytes_most).max(),
            ..mine("parts", 1, &pairs.a)
        };
        add(task, &format!("budget 1 of {share}"), found);
    }
    Ok(records)
}

/// The budget, or the least one in which the model opens and is searched: of a small one that is more than a share.
fn least_budget(search: &Search, mut budget: u64) -> Result<u64, Failure> {
    loop {
        let tried = OutOfCore::context(budget).and_then(|context| {
            let model = Model::open_cold(&context, &search.stored.path)?;
            let scene = Scene::new(&context);
            for (&place, id) in search.stored.places.iter().zip(1..) {
                scene.add_instance(&model, id, place)?;
            }
            scene.commit()?;
            let options = search.options(ClashDetail::Parts);
            scene.state().clash(&options, &Progress::default(), &Cancel::new(), &mut |_| ())
        });
        match tried {
            Err(Error::OverBudget { need, .. }) if need > budget => budget = need,
            tried => return Ok(tried.map(|_| budget)?),
        }
    }
}

/// A model with nothing in memory, and a count of the reads of each block.
struct OutOfCore {
    ours: Ours,
    budget: u64,
    reads: Arc<Vec<(Range<u64>, AtomicU32)>>,
}

struct Out {
    seconds: f64,
    /// Blocks that were read, each as often as it was.
    blocks: usize,
    bytes_most: u64,
}

impl OutOfCore {
    fn context(memory_budget: u64) -> outcrop::Result<Context> {
        let options = ContextOptions { threads: 0, memory_budget, read_ahead: false, ..ContextOptions::default() };
        Context::new(options)
    }

    fn new(search: &Search, budget: u64) -> Result<Self, Failure> {
        let ranges = sources::blocks(&search.stored.path);
        let reads: Arc<Vec<_>> = Arc::new(ranges.into_iter().map(|range| (range, AtomicU32::new(0))).collect());
        let counted = Arc::clone(&reads);
        let source = sources::meddled(&search.stored.path, move |at, bytes| {
            let end = at + bytes.len() as u64;
            for (range, count) in counted.iter().filter(|(range, _)| at <= range.start && range.end <= end) {
                count.fetch_add(u32::from(range.start < range.end), Relaxed);
            }
            Ok(())
        });
        let context = Self::context(budget)?;
        let model = Model::open_cold_source(&context, source)?;
        Ok(Self { ours: Ours::with(context, model, &search.stored.places)?, budget, reads })
    }

    fn run(self, search: &Search, expected: &ClashSummary) -> Result<Out, Failure> {
        let (context, is_over) = (&self.ours.context, AtomicBool::new(false));
        let (summary, seconds, bytes_most) = std::thread::scope(|scope| {
            let watch = scope.spawn(|| {
                let mut most = 0;
                while !is_over.load(Relaxed) {
                    most = context.memory_used().max(most);
                    std::thread::sleep(Duration::from_micros(500));
                }
                most
            });
            let begun = Clock::Wall.now();
            let summary = search.run(&self.ours.state, ClashDetail::Parts);
            let seconds = Clock::Wall.now() - begun;
            is_over.store(true, Relaxed);
            (summary, seconds, watch.join().expect("it only reads a number"))
        });
        if summary? != *expected {
            return Err(Failure::new("wrong answers: a search out of core differs from one in core"));
        }
        if self.budget > 0 && bytes_most > self.budget {
            return Err(Failure::new(format!("{bytes_most} bytes are more than the budget of {}", self.budget)));
        }
        let blocks = self.reads.iter().map(|(_, count)| count.load(Relaxed) as usize).sum();
        Ok(Out { seconds, blocks, bytes_most })
    }
}

/// A search on a line.
fn line(found: &Clashed) -> String {
    let Clashed { seconds, against, pairs, wrong, places, tested, first, blocks, bytes_most, budget, .. } = found;
    let mut text = format!("{:.1} ms, {pairs} pairs", seconds.median * 1e3);
    if let Some(a) = against {
        let _ = write!(text, ", {:.2} [{:.2} .. {:.2}] x of {}", a.ratio.median, a.ratio.least, a.ratio.most, a.call);
    }
    if let Some([more, missed]) = wrong {
        let _ = write!(text, ", {more} false, {missed} missed");
    }
    if let (Some(places), Some(tested)) = (places, tested) {
        let _ = write!(text, ", {places} pairs of places, {tested} of boxes of triangles");
    } else if let Some(tested) = tested {
        let _ = write!(text, ", {tested} tested");
    }
    if let Some(first) = first {
        let _ = write!(text, ", first contact {:.3} ms", first.median * 1e3);
    }
    if let (Some([whole, read]), Some(most)) = (blocks, bytes_most) {
        let ratio = *read as f64 / *whole as f64;
        let _ = write!(text, ", {read} blocks read, {ratio:.2} times the {whole} touched, {most} of {budget} bytes");
    }
    text
}

/// All searches among the records in Markdown, a table a scene; empty if there are none.
pub fn table(records: &[Record]) -> String {
    let mut text = String::new();
    let mut last = None;
    for record in records {
        let Outcomes::Clash(found) = &record.result else { continue };
        if last != Some((&record.benchmark, &record.scene)) {
            last = Some((&record.benchmark, &record.scene));
            let _ = write!(text, "\n{}, {} ({} triangles)\n\n", record.benchmark, record.title, record.triangles);
            let head =
                "| side | ms | ratio | pairs | false | missed | first contact, ms |\n|---|---|---|---|---|---|---|";
            let _ = writeln!(text, "{head}");
        }
        let none = || "-".to_owned();
        let ms = |seconds: &Spread| format!("{:.1}", seconds.median * 1e3);
        let ratio = found.against.as_ref().map_or_else(none, |a| format!("{:.2} of {}", a.ratio.median, a.side));
        let wrong = found.wrong.map_or_else(|| "0 | 0".to_owned(), |[more, missed]| format!("{more} | {missed}"));
        let first = found.first.as_ref().map_or_else(none, |first| format!("{:.3}", first.median * 1e3));
        let side = record.key.rsplit('/').next().unwrap_or_default();
        let _ = writeln!(text, "| {side} | {} | {ratio} | {} | {wrong} | {first} |", ms(&found.seconds), found.pairs);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::PEERS;

    /// A grid of tetrahedra, each a part, that its copy passes through.
    fn mesh() -> (Vec<[DVec3; 3]>, Vec<u32>) {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| p * 1.25);
        let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let at = |i: u32| DVec3::new(f64::from(i % 4), f64::from(i / 4 % 4), f64::from(i / 16));
        (0..64).flat_map(|i| faces.map(|face| (face.map(|k| corners[k] + at(i)), i))).unzip()
    }

    fn brute(bodies: &Bodies) -> Vec<Pair> {
        let mut all = Vec::new();
        for (i, a) in bodies.each.iter().enumerate() {
            for b in &bodies.each[i + 1..] {
                for (x, p) in a.ids.iter().zip(&a.corners) {
                    let met = b.ids.iter().zip(&b.corners).filter(|(_, q)| relate(p, q) != Relation::Apart);
                    all.extend(met.map(|(y, _)| [*x.min(y), *x.max(y)]));
                }
            }
        }
        all.sort_unstable();
        all
    }

    #[test]
    fn peers_find_what_brute_force_finds() {
        let turn = DAffine3::from_rotation_z(0.3) * DAffine3::from_translation(DVec3::new(0.1, 0.2, 0.3));
        let (corners, parts) = mesh();
        let each = [Bodies::of_parts(&corners, &parts), Bodies::of_places(&corners, &[DAffine3::IDENTITY, turn])];
        let mut asked = 0;
        for bodies in &each {
            let exact = brute(bodies);
            assert!(exact.len() > 100);
            for rival in PEERS.iter().flat_map(|peer| rivals(peer, bodies)) {
                let mut met = Vec::new();
                assert!(rival.all(&mut met) >= met.len() as u64);
                met.sort_unstable();
                met.dedup();
                let [more, missed] = wrong(&bodies.corners(), &exact, &met).expect("exact pairs");
                // Tests with rounding err on touching triangles only.
                let bound = if rival.name().contains("doubles") { 0 } else { exact.len() / 4 };
                assert!(missed <= bound && more <= bound, "{}: {more} {missed}", rival.name());
                assert_ne!(rival.any(), Some(false));
                asked += 1;
            }
        }
        assert!(asked >= 4, "parry3d is always here");
    }

    #[test]
    fn wrong_pairs_are_told_from_wrong_answers() {
        let (corners, parts) = mesh();
        let bodies = Bodies::of_parts(&corners, &parts);
        let (corners, exact) = (bodies.corners(), brute(&bodies));
        let apart = [0, corners.len() as u32 - 1];
        let sorted = |mut pairs: Vec<Pair>| {
            pairs.sort_unstable();
            pairs
        };
        let found = sorted(exact[1..].iter().copied().chain([apart]).collect());
        assert_eq!(wrong(&corners, &exact, &found).expect("exact pairs"), [1, 1]);
        assert!(wrong(&corners, &exact[1..], &exact).expect_err("a pair is missing").to_string().contains("not found"));
        let more = sorted(exact.iter().copied().chain([apart]).collect());
        assert!(wrong(&corners, &more, &exact).expect_err("a pair too many").to_string().contains("apart"));
    }
}
