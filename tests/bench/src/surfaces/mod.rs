//! Measures surfaces at several levels: the same dice as a model of grids, as one of triangles, and as Embree's grids,
//! and Embree's own subdivision of the same cage at the same rate. Bytes of a triangle, and rays of one thread, all
//! sides in turn.

mod cage;
mod table;

use crate::data::{RayKind, Residency};
use crate::failure::Failure;
use crate::many::timed;
use crate::ours::{self, ModelAt, Ours, Ready};
use crate::pairs::{Spread, steady};
use crate::peers::{Peer, embree};
use crate::rays::Batch;
use crate::record::{Outcomes, Record, Surfaced};
use crate::scenes::builder_with;
use crate::sides::{Answer, Run};
use crate::trace::Task;
use cage::Cage;
use outcrop::build::BuildOptions;
use outcrop::import::surfaces::Dicing;
pub use table::table;

/// Rays end at the same place if their ways differ by no more than this share.
const SAME: f64 = 1e-3;

/// Names of Embree's sides.
pub const GRID: &str = "Embree GRID";
/// See [`GRID`].
pub const SUBDIVISION: &str = "Embree SUBDIVISION";

/// One of our models at a level.
struct Mine {
    name: String,
    stored: ModelAt,
    ours: Ours,
    /// Bytes of all blocks, and of the form for exact rays.
    bytes: u64,
}

/// One of Embree's scenes.
struct Theirs {
    name: &'static str,
    peer: Box<dyn Peer>,
}

/// A side's rays at one setting.
struct Asked<'a> {
    found: Surfaced,
    run: Box<dyn Run + 'a>,
    best: Vec<f64>,
}

/// A benchmark on one cage, level by level.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let Some(path) = task.scene.file() else {
        return Err(Failure::new("surfaces come from a file of a cage"));
    };
    let cage = Cage::read(path)?;
    let mut records = Vec::new();
    for level in task.benchmark.levels.clone() {
        records.extend(of_level(task, &cage, level)?);
    }
    Ok(records)
}

fn of_level(task: &mut Task, cage: &Cage, level: u32) -> Result<Vec<Record>, Failure> {
    let mut mine = Vec::new();
    for name in &task.benchmark.structures {
        let row = task.data.structure(name);
        let path = task.scene.kept(row, &format!("{name}-level{level}"), &|to| {
            let options = BuildOptions { dicing: Some(Dicing::Level(level)), ..row.options()? };
            let mut builder = builder_with(options)?;
            cage.fill(&mut builder)?;
            builder.finish(to)?;
            Ok(())
        })?;
        let stored = ModelAt::once(path);
        let ours = Ours::open(&stored, Residency::All, 0)?;
        let memory = ours.model.memory();
        mine.push(Mine { name: name.clone(), stored, bytes: memory.geometry + memory.resident_form, ours });
    }
    let triangles = mine[0].ours.model.info().triangles_placed;
    if let Some(other) = mine.iter().find(|it| it.ours.model.info().triangles_placed != triangles) {
        return Err(Failure::new(format!("{}: {} triangles", other.name, other.ours.model.info().triangles_placed)));
    }
    let mut theirs = Vec::new();
    if !task.is_only_expecting && !task.benchmark.peers.is_empty() {
        let grids = embree::build_grids(cage.grids(level)?, 1);
        theirs.extend(grids.map(|peer| Theirs { name: GRID, peer }));
        let cage = embree::build_cage(cage.for_embree(), (1u32 << level) as f32, 1);
        theirs.extend(cage.map(|peer| Theirs { name: SUBDIVISION, peer }));
    }
    let mut records = Vec::new();
    for view in task.benchmark.views.clone() {
        let camera = mine[0].ours.camera(task.scene, view);
        for kind in task.benchmark.rays.clone() {
            let batch = Batch::new(kind, &mine[0].ours.state, &camera, task.benchmark.size)?;
            records.extend(of_rays(task, (level, view), &mine, &theirs, &batch)?);
        }
    }
    Ok(records)
}

/// Rays that hit in one only, or end at other places.
fn differ(seen: &[Answer], truth: &[Answer], is_any: bool) -> usize {
    let is_far = |a: &Answer, b: &Answer| !is_any && (a.t - b.t).abs() > SAME * b.t;
    let is_other = |(a, b): &(&Answer, &Answer)| a.is_hit() != b.is_hit() || a.is_hit() && is_far(a, b);
    seen.iter().zip(truth).filter(is_other).count()
}

/// All sides in turn, as many rounds as asked for; the first round warms.
fn of_rays(
    task: &mut Task,
    (level, view): (u32, usize),
    mine: &[Mine],
    theirs: &[Theirs],
    batch: &Batch,
) -> Result<Vec<Record>, Failure> {
    let name =
        format!("{}/{}/level {level}/view {view}/{}", task.benchmark.name, task.scene.row.name, batch.kind.name());
    eprintln!("{name}: {} rays", batch.rays.len());
    if batch.rays.is_empty() {
        return Err(Failure::new("no rays: nothing is seen"));
    }
    let (is_any, count) = (batch.is_any(), batch.rays.len());
    let truth = ours::answers(&mine[0].ours.hits(&batch.at(0.0), batch)?);
    let of = |side: &str, is_peer: bool, bytes: u64, poe: f32, call: String| Surfaced {
        side: side.into(),
        is_peer,
        call,
        level,
        view,
        rays: batch.kind.name().into(),
        poe,
        count,
        hits: truth.iter().filter(|answer| answer.is_hit()).count(),
        bytes,
        ..Surfaced::default()
    };
    let mut all = Vec::new();
    for it in mine {
        let exact = ours::answers(&it.ours.hits(&batch.at(0.0), batch)?);
        let off = differ(&exact, &truth, is_any);
        // Trees have origins of their own: rays past silhouettes and along edges meet one neighbour or the other.
        if off * 500 > count {
            return Err(Failure::new(format!("{name}: {off} rays end elsewhere under {}", it.name)));
        }
        for &poe in &task.benchmark.poe {
            let rays = batch.at(poe);
            let answers = ours::answers(&it.ours.hits(&rays, batch)?);
            let asked = task.benchmark.asked.get();
            let found = Surfaced {
                differ: differ(&answers, &truth, is_any),
                ..of(&it.name, false, it.bytes, poe, String::new())
            };
            let run = Box::new(Ready::new(&it.ours, &it.stored, Residency::All, batch, asked, rays));
            all.push(Asked { found, run, best: Vec::new() });
        }
    }
    if task.is_only_expecting {
        return Ok(Vec::new());
    }
    for it in theirs {
        let rays = batch.at(0.0);
        let mut best: Option<(f64, Asked)> = None;
        for way in it.peer.calls(batch) {
            let mut run = it.peer.ready(way, batch, &rays);
            let took = timed(&mut *run).min(timed(&mut *run));
            if best.as_ref().is_none_or(|(least, _)| took < *least) {
                let call = format!("{}, {way} a call", it.peer.version());
                let found = Surfaced {
                    differ: differ(&run.answers(), &truth, is_any),
                    ..of(it.name, true, it.peer.bytes(), 0.0, call)
                };
                best = Some((took, Asked { found, run, best: Vec::new() }));
            }
        }
        all.extend(best.map(|(_, asked)| asked));
    }
    for round in 0..=task.benchmark.rounds {
        for Asked { run, best, .. } in &mut all {
            let seconds = steady(|| timed(&mut **run));
            if round > 0 {
                best.push(seconds);
            }
        }
    }
    let triangles = mine[0].ours.model.info().triangles_placed;
    let record = |Asked { found, best, .. }: Asked| {
        let seconds = Spread::of(&best);
        let mrays = count as f64 / seconds.median / 1e6;
        let key = format!("{name}/PoE {}/{}", found.poe, found.side);
        task.record(key, triangles, Outcomes::Surfaces(Box::new(Surfaced { seconds, mrays, ..found })))
    };
    Ok(all.into_iter().map(record).collect())
}

/// The kinds of rays in the order of the chart.
pub const KINDS: [RayKind; 3] = [RayKind::Primary, RayKind::Shadow, RayKind::Bounce];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::brute::{Oracle, Ray64};
    use crate::common::bvh64::Bvh64;
    use glam::DVec3;
    use outcrop::math::Ray;

    /// Embree's grids are met where the dice is in double precision, its subdivision near there.
    #[test]
    fn embrees_surfaces_are_where_the_dice_is() {
        let cage = Cage::of_cube();
        let truth = Bvh64::new(cage.triangles(4).expect("triangles"));
        let mut rng = crate::common::rng::Rng::new(3);
        let ray = |_| {
            let (at, dir) = (0.4 * rng.inside(DVec3::NEG_ONE, DVec3::ONE), rng.direction());
            Ray::new((at - 4.0 * dir).as_vec3().as_dvec3(), dir.as_vec3())
        };
        let rays: Vec<Ray> = (0..2000).map(ray).collect();
        let batch = Batch { kind: RayKind::Primary, rays: rays.clone() };
        let way =
            |ray: &Ray| truth.closest(&Ray64::new(ray.origin, ray.dir.as_dvec3())).map_or(f64::INFINITY, |hit| hit.t);
        let wanted: Vec<Answer> = rays.iter().map(|ray| Answer { t: way(ray) }).collect();
        let met = wanted.iter().filter(|answer| answer.is_hit()).count();
        assert!(met > 1000, "{met}");
        let grids = embree::build_grids(cage.grids(4).expect("grids"), 1);
        let subdivided = embree::build_cage(cage.for_embree(), 16.0, 1);
        for peer in [grids, subdivided].into_iter().flatten() {
            assert!(peer.bytes() > 0);
            for call in peer.calls(&batch) {
                let mut run = peer.ready(call, &batch, &rays);
                timed(&mut *run);
                let off = differ(&run.answers(), &wanted, false);
                println!("{}, {call}: {off} rays of {met} end elsewhere", peer.bytes());
                assert!(off <= 20, "{call}: {off}");
            }
        }
    }
}
