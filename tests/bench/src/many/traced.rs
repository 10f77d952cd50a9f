//! Rays of three views, exact and with pixels of error, and shadow rays toward one sun, beside Embree's best call.

use super::commits::Mine;
use super::forest::{Edit, Forest, sun};
use super::side_of;
use crate::accuracy;
use crate::data::{RayKind, Residency};
use crate::expected::Expected;
use crate::failure::Failure;
use crate::ours::{self, ModelAt, Ours, Ready};
use crate::pairs::{Clock, Pairs, Spread, steady};
use crate::peers::{self, Peer};
use crate::rays::Batch;
use crate::record::{Against, Many, Outcomes, Record};
use crate::sides::{Answer, Run};
use crate::trace::Task;
use outcrop::query::{Hit, HitKind};
use std::sync::Arc;

/// Rays end at the same place if their ways differ by no more than this share.
const SAME: f64 = 1e-4;

/// Seconds of a run in this thread.
pub fn timed(run: &mut dyn Run) -> f64 {
    run.prepare();
    let begun = Clock::Thread.now();
    std::hint::black_box(run.run(1));
    Clock::Thread.now() - begun
}

/// Rays that hit in one only, or end at other places.
fn differ(seen: &[Answer], truth: &[Answer]) -> usize {
    let is_other =
        |(a, b): &(&Answer, &Answer)| a.is_hit() != b.is_hit() || a.is_hit() && (a.t - b.t).abs() > SAME * b.t;
    seen.iter().zip(truth).filter(is_other).count()
}

/// Root of the mean square of the difference of ways, each over the exact one, of rays that hit in both.
fn rms(seen: &[Answer], truth: &[Answer]) -> f64 {
    let both = seen.iter().zip(truth).filter(|(a, b)| a.is_hit() && b.is_hit());
    let (sum, count) = both.fold((0.0, 0), |(sum, count), (a, b)| (sum + ((a.t - b.t) / b.t).powi(2), count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

/// Mean error that stand-ins state, in widths of the ray that covers a pixel there; 0 if there are none.
fn stated(batch: &Batch, hits: &[Hit]) -> f64 {
    let stand_ins = batch.rays.iter().zip(hits).filter(|(_, hit)| hit.kind == HitKind::Lod);
    let (sum, count) = stand_ins.fold((0.0, 0), |(sum, count), (ray, hit)| {
        (sum + f64::from(hit.error / (ray.cone.a + ray.cone.b * hit.t as f32)), count + 1)
    });
    sum / f64::from(count.max(1))
}

/// A peer that was built, and its name and quality.
struct Rival {
    call: String,
    peer: Box<dyn Peer>,
}

/// Records of the rays of all views.
pub fn measure(task: &mut Task, ours: &Ours, stored: &ModelAt, forest: &Forest) -> Result<Vec<Record>, Failure> {
    let mut rivals = Vec::new();
    if !task.is_only_expecting {
        let placed = forest.placed(&Arc::new(task.scene.mesh()?));
        for build in task.benchmark.peers.iter().flat_map(|peer| peers::builds(peer, true)) {
            if let Some(peer) = build.build_placed(&placed, 1) {
                let call = format!("{}, single instances, {}", peer.version(), build.quality);
                rivals.push(Rival { call, peer });
            }
        }
    }
    let mut records = Vec::new();
    for (view, camera) in forest.views() {
        let primary = Batch::new(RayKind::Primary, &ours.state, &camera, task.benchmark.size)?;
        let exact = ours.hits(&primary.at(0.0), &primary)?;
        let shadow = Batch::to_sun(&primary.rays, &exact, sun());
        if view == "edge" {
            check_moved(task, ours, forest, &primary)?;
        }
        for batch in [primary, shadow] {
            records.extend(rays_of(task, ours, stored, &rivals, view, &batch)?);
        }
    }
    Ok(records)
}

/// Fails unless a scene after moves answers as one that is committed with the new places at once.
fn check_moved(task: &mut Task, ours: &Ours, forest: &Forest, batch: &Batch) -> Result<(), Failure> {
    let after = forest.after(Edit::MoveMany);
    let hits_of = |mine: &Mine| -> Result<Vec<Hit>, Failure> {
        let (context, model, state) = (ours.context.clone(), ours.model.clone(), mine.scene().state());
        Ours { context, model, state }.hits(&batch.at(0.0), batch)
    };
    let moved = hits_of(&Mine::new(&ours.context, &ours.model, forest).edited(Edit::MoveMany))?;
    let anew = hits_of(&Mine::new(&ours.context, &ours.model, &after))?;
    let name = format!("{}/{}/{}", task.benchmark.name, task.scene.row.name, Edit::MoveMany.name());
    if let Some(i) = (0..anew.len()).find(|&i| moved[i].t != anew[i].t) {
        let why = format!("ray {i} ends at {} after a move, and at {} in a new scene", moved[i].t, anew[i].t);
        return Err(Failure::new(format!("{name}: wrong answers: {why}")));
    }
    task.book.check(&name, Expected::of_hits(&moved))
}

/// A side's rays at one setting.
struct Asked<'a> {
    found: Many,
    run: Box<dyn Run + 'a>,
}

fn rays_of(
    task: &mut Task,
    ours: &Ours,
    stored: &ModelAt,
    rivals: &[Rival],
    view: &str,
    batch: &Batch,
) -> Result<Vec<Record>, Failure> {
    let asked = format!("{view}, {}", batch.kind.name());
    let name = format!("{}/{}/{asked}", task.benchmark.name, task.scene.row.name);
    eprintln!("{name}: {} rays", batch.rays.len());
    if batch.rays.is_empty() {
        return Err(Failure::new("no rays: nothing is seen"));
    }
    let truth = ours::answers(&ours.hits(&batch.at(0.0), batch)?);
    let mut all = Vec::new();
    for &poe in &task.benchmark.poe {
        let rays = batch.at(poe);
        let hits = ours.hits(&rays, batch)?;
        task.book.check(&format!("{name}/PoE {poe}"), Expected::of_hits(&hits))?;
        let answers = ours::answers(&hits);
        let is_any = batch.is_any();
        let found = Many {
            side: side_of(task),
            call: format!("coherent, {} a call", task.benchmark.asked),
            asked: asked.clone(),
            poe,
            instances: task.benchmark.instances,
            count: batch.rays.len(),
            differ: Some(differ(&answers, &truth)),
            stand_ins: (!is_any).then(|| hits.iter().filter(|hit| hit.kind == HitKind::Lod).count()),
            rms: (!is_any).then(|| rms(&answers, &truth)),
            stated: (!is_any).then(|| stated(batch, &hits)),
            accuracy: Some(accuracy::of_rays(&batch.rays, &answers, &truth)),
            ..Many::default()
        };
        let run = Box::new(Ready::new(ours, stored, Residency::All, batch, task.benchmark.asked.get(), rays));
        all.push(Asked { found, run });
    }
    if task.is_only_expecting {
        return Ok(Vec::new());
    }
    let triangles = task.benchmark.instances as u64 * ours.model.info().triangles_in;
    let mut records = Vec::new();
    let mut add = |found: Many| {
        let key = format!("{name}/PoE {}/{}", found.poe, found.side);
        records.push(task.record(key, triangles, Outcomes::Many(Box::new(found))));
    };
    let mut best = best_call(rivals, batch, &truth)?;
    for (i, Asked { found, run }) in all.iter_mut().enumerate() {
        let rounds = task.benchmark.rounds;
        let Some(Asked { found: theirs, run: opponent }) = &mut best else {
            let seconds: Vec<f64> = (0..rounds).map(|_| steady(|| timed(&mut **run))).collect();
            add(Many { seconds: Spread::of(&seconds), ..found.clone() });
            continue;
        };
        let pairs = Pairs::in_turn(rounds, || steady(|| timed(&mut **run)), || steady(|| timed(&mut **opponent)));
        let (side, call, seconds) = (theirs.side.clone(), theirs.call.clone(), Spread::of(&pairs.b));
        let against = Some(Against { side, call, seconds, ratio: pairs.ratio() });
        if i == 0 {
            add(Many { seconds, asked: asked.clone(), instances: found.instances, ..theirs.clone() });
        }
        add(Many { seconds: Spread::of(&pairs.a), against, ..found.clone() });
    }
    Ok(records)
}

/// The fastest way of asking a peer, of two runs each; `None` without peers.
fn best_call<'a>(rivals: &'a [Rival], batch: &Batch, truth: &[Answer]) -> Result<Option<Asked<'a>>, Failure> {
    let mut best: Option<(f64, Asked<'a>)> = None;
    let rays = batch.at(0.0);
    for Rival { call, peer } in rivals {
        for way in peer.calls(batch) {
            let mut run = peer.ready(way, batch, &rays);
            let took = timed(&mut *run).min(timed(&mut *run));
            if best.as_ref().is_some_and(|(least, _)| *least <= took) {
                continue;
            }
            let answers = run.answers();
            let accuracy = accuracy::of_rays(&batch.rays, &answers, truth);
            let call = format!("{call}, {way} a call");
            accuracy::assert_peer_agrees(&call, &accuracy, &batch.rays, &answers, truth)?;
            let differ = Some(differ(&answers, truth));
            let (side, is_peer, count) = ("embree".to_owned(), true, batch.rays.len());
            let found = Many { side, is_peer, call, count, differ, accuracy: Some(accuracy), ..Many::default() };
            best = Some((took, Asked { found, run }));
        }
    }
    Ok(best.map(|(_, asked)| asked))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::brute::{Oracle, Ray64};
    use crate::common::built::{self, Part};
    use crate::common::bvh64::Bvh64;
    use crate::common::scenes;
    use crate::many::forest::affine;
    use crate::scenes::Mesh;
    use glam::DVec3;

    /// outcrop's scene of instances, Embree's, and all triangles where they are seen, in double precision.
    #[test]
    fn rays_of_all_views_end_where_the_placed_triangles_are() {
        let tower = scenes::cuboid(DVec3::new(-1.0, -0.6, 0.0), DVec3::new(0.7, 1.0, 5.0));
        let built = built::parts(&[Part::white(1, tower.clone())]);
        let stored = ModelAt { path: built.path.clone(), places: Vec::new() };
        let Ours { context, model, .. } = Ours::open(&stored, Residency::All, 0).expect("a model");
        let forest = Forest::new(90);
        let state = Mine::new(&context, &model, &forest).scene().state();
        let ours = Ours { context, model, state };
        let placed = |place| tower.iter().map(move |tri| tri.map(|v| affine(place).transform_point3(v)));
        let truth = Bvh64::new(forest.places.iter().flat_map(placed).collect());
        let mesh = Arc::new(Mesh::of(tower.iter().map(|&tri| (0, tri))));
        let rivals: Vec<Box<dyn Peer>> = peers::builds("embree", true)
            .iter()
            .filter_map(|build| build.build_placed(&forest.placed(&mesh), 1))
            .collect();
        for (view, camera) in forest.views() {
            let primary = Batch::new(RayKind::Primary, &ours.state, &camera, (64, 32)).expect("rays");
            let exact = ours.hits(&primary.at(0.0), &primary).expect("hits");
            let shadow = Batch::to_sun(&primary.rays, &exact, sun());
            for batch in [primary, shadow] {
                let rays = batch.at(0.0);
                let seen = ours::answers(&ours.hits(&rays, &batch).expect("hits"));
                let local = |ray: &outcrop::math::Ray| Ray64::new(ray.origin, ray.dir.as_dvec3());
                let way = |ray| {
                    let hit = truth.closest(&local(ray)).map(|hit| if batch.is_any() { 0.0 } else { hit.t });
                    Answer { t: hit.unwrap_or(f64::INFINITY) }
                };
                let wanted: Vec<Answer> = rays.iter().map(way).collect();
                let hits = wanted.iter().filter(|answer| answer.is_hit()).count();
                assert!(hits > rays.len() / 20, "{view}, {}: {hits} of {}", batch.kind.name(), rays.len());
                // Edges are seen either way.
                assert!(differ(&seen, &wanted) <= 2, "{view}, {}: {}", batch.kind.name(), differ(&seen, &wanted));
                for rival in &rivals {
                    for call in rival.calls(&batch) {
                        let mut run = rival.ready(call, &batch, &rays);
                        timed(&mut *run);
                        let differ = differ(&run.answers(), &wanted);
                        assert!(differ <= 4, "{view}, {}, {call}: {differ}", batch.kind.name());
                    }
                }
            }
        }
    }

    #[test]
    fn rays_that_end_elsewhere_are_counted() {
        let answers = |all: [f64; 4]| all.map(|t| Answer { t });
        let truth = answers([1.0, 10.0, f64::INFINITY, 4.0]);
        let seen = answers([1.00005, 11.0, 3.0, f64::INFINITY]);
        assert_eq!((differ(&seen, &truth), differ(&truth, &truth)), (3, 0));
        assert!((rms(&seen, &truth) - (0.5f64 * (0.00005f64.powi(2) + 0.01)).sqrt()).abs() < 1e-12);
    }
}
