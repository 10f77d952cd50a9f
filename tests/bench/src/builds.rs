//! Measures builds: from triangles in memory to a file that is whole, beside peers that build in memory.

use crate::failure::Failure;
use crate::pairs::Spread;
use crate::peers;
use crate::record::{Built, Outcomes, Record};
use crate::scenes::{self, Mesh};
use crate::trace::Task;
use glam::{DVec3, Vec3};
use outcrop::build::BuildReport;
use outcrop::import::{MeshKey, PartDesc, Sink};
use std::sync::Arc;
use std::time::Instant;

/// Triangles that are pushed at once.
const PUSHED: usize = 1 << 16;

/// Seconds and sizes of one way of building.
struct Side {
    name: String,
    quality: &'static str,
    is_peer: bool,
    seconds: Vec<f64>,
    bytes_model: u64,
    bytes_file: Option<u64>,
}

/// All ways of building one scene, in turn.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let mut records = Vec::new();
    if task.is_only_expecting {
        return Ok(records);
    }
    let mesh = Arc::new(task.scene.mesh()?);
    for &threads in &task.benchmark.threads {
        let mut sides: Vec<Side> = Vec::new();
        for round in 0..task.benchmark.rounds {
            eprintln!("{}/{}: builds, {threads} threads, round {}", task.benchmark.name, task.scene.row.name, round + 1);
            let begun = Instant::now();
            let report = ours(&mesh, threads)?;
            let seconds = begun.elapsed().as_secs_f64();
            add(&mut sides, "bvh", "default", false, seconds, report.bytes_trace, Some(report.bytes));
            for build in task.benchmark.peers.iter().flat_map(|peer| peers::builds(peer, false)) {
                let begun = Instant::now();
                let Some(built) = build.build(&mesh, threads) else { continue };
                let seconds = begun.elapsed().as_secs_f64();
                add(&mut sides, build.peer, build.quality, true, seconds, built.bytes(), None);
            }
        }
        for side in sides {
            let seconds = Spread::of(&side.seconds);
            let key = format!("{}/{}/{}, {}/{threads}", task.benchmark.name, task.scene.row.name, side.name, side.quality);
            eprintln!("{key}: {:.2} s, {:.1} bytes a triangle", seconds.median, side.bytes_model as f64 / mesh.triangles.len() as f64);
            let Side { name, quality, is_peer, bytes_model, bytes_file, .. } = side;
            let built = Built { side: name, is_peer, quality: quality.into(), threads, seconds, bytes_model, bytes_file };
            records.push(task.record(key, mesh.triangles.len() as u64, Outcomes::Build(built)));
        }
    }
    Ok(records)
}

fn add(sides: &mut Vec<Side>, name: &str, quality: &'static str, is_peer: bool, took: f64, bytes_model: u64, bytes_file: Option<u64>) {
    match sides.iter_mut().find(|side| side.name == name && side.quality == quality) {
        Some(side) => side.seconds.push(took),
        None => sides.push(Side { name: name.into(), quality, is_peer, seconds: vec![took], bytes_model, bytes_file }),
    }
}

/// outcrop's build, into a file that goes again.
fn ours(mesh: &Mesh, threads: usize) -> Result<BuildReport, Failure> {
    std::fs::create_dir_all(scenes::folder())?;
    let folder = tempfile::tempdir_in(scenes::folder())?;
    let mut builder = scenes::builder(threads)?;
    let part = builder.part(PartDesc::default())?;
    let corner = |i: u32| Vec3::from(mesh.vertices[i as usize]).as_dvec3();
    let mut pushed: Vec<[DVec3; 3]> = Vec::with_capacity(PUSHED);
    for triangles in mesh.triangles.chunks(PUSHED) {
        pushed.clear();
        pushed.extend(triangles.iter().map(|t| t.map(corner)));
        builder.triangles(MeshKey::DIRECT, part, &pushed, None)?;
    }
    Ok(builder.finish(&folder.path().join("model.oc"))?)
}
