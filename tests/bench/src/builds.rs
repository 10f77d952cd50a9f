//! Measures builds: from triangles in memory to a file that is whole, beside peers that build in memory.

use crate::data::StructureRow;
use crate::expected::Expected;
use crate::failure::{Failure, Outcome};
use crate::pairs::Spread;
use crate::peers;
use crate::record::{Built, Outcomes, Record};
use crate::scenes::{self, Mesh};
use crate::trace::Task;
use glam::{DVec3, Vec3};
use outcrop::build::{BuildReport, Builder};
use outcrop::import::{Attributes, MeshKey, PartDesc, PartKey, Sink};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
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

/// All ways of building one scene, in turn. What outcrop builds is looked at: the same file, to the byte, each time.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let mut records = Vec::new();
    let mesh = Arc::new(task.scene.mesh()?);
    let structures: Vec<&StructureRow> =
        task.benchmark.structures.iter().map(|name| task.data.structure(name)).collect();
    if task.is_only_expecting {
        for structure in structures {
            ours(task, &mesh, structure, 0)?;
        }
        return Ok(records);
    }
    for &threads in &task.benchmark.threads {
        let mut sides: Vec<Side> = Vec::new();
        for round in 0..task.benchmark.rounds {
            eprintln!(
                "{}/{}: builds, {threads} threads, round {}",
                task.benchmark.name,
                task.scene.row.name,
                round + 1
            );
            for structure in &structures {
                let (seconds, report) = ours(task, &mesh, structure, threads)?;
                add(&mut sides, &structure.name, "default", false, seconds, report.bytes_trace, Some(report.bytes));
            }
            for build in task.benchmark.peers.iter().flat_map(|peer| peers::builds(peer, false)) {
                let begun = Instant::now();
                let Some(built) = build.build(&mesh, threads) else { continue };
                let seconds = begun.elapsed().as_secs_f64();
                add(&mut sides, build.peer, build.quality, true, seconds, built.bytes(), None);
            }
        }
        for side in sides {
            let seconds = Spread::of(&side.seconds);
            let key =
                format!("{}/{}/{}, {}/{threads}", task.benchmark.name, task.scene.row.name, side.name, side.quality);
            eprintln!(
                "{key}: {:.2} s, {:.1} bytes a triangle",
                seconds.median,
                side.bytes_model as f64 / mesh.triangles.len() as f64
            );
            let Side { name, quality, is_peer, bytes_model, bytes_file, .. } = side;
            let built =
                Built { side: name, is_peer, quality: quality.into(), threads, seconds, bytes_model, bytes_file };
            records.push(task.record(key, mesh.triangles.len() as u64, Outcomes::Build(built)));
        }
    }
    Ok(records)
}

fn add(
    sides: &mut Vec<Side>,
    name: &str,
    quality: &'static str,
    is_peer: bool,
    took: f64,
    bytes_model: u64,
    bytes_file: Option<u64>,
) {
    match sides.iter_mut().find(|side| side.name == name && side.quality == quality) {
        Some(side) => side.seconds.push(took),
        None => sides.push(Side { name: name.into(), quality, is_peer, seconds: vec![took], bytes_model, bytes_file }),
    }
}

/// Seconds of outcrop's build, into a file that is compared with the expected one and goes again.
fn ours(task: &mut Task, mesh: &Mesh, structure: &StructureRow, threads: usize) -> Result<(f64, BuildReport), Failure> {
    std::fs::create_dir_all(scenes::folder())?;
    let folder = tempfile::tempdir_in(scenes::folder())?;
    let path = folder.path().join("model.oc");
    let begun = Instant::now();
    let mut builder = scenes::builder(structure, threads)?;
    push(&mut builder, mesh)?;
    let report = builder.finish(&path)?;
    let seconds = begun.elapsed().as_secs_f64();
    let id = format!("{}/{}/{}/file", task.benchmark.name, task.scene.row.name, structure.name);
    task.book.check(&id, Expected::of_bytes(report.triangles_in as usize, &std::fs::read(&path)?))?;
    Ok((seconds, report))
}

/// All parts with their triangles.
fn push(builder: &mut Builder, mesh: &Mesh) -> Outcome {
    let corner = |i: u32| Vec3::from(mesh.vertices[i as usize]).as_dvec3();
    let mut pushed: Vec<[DVec3; 3]> = Vec::with_capacity(PUSHED);
    let mut keys: HashMap<u32, PartKey> = HashMap::new();
    let mut at = 0;
    for run in mesh.parts.chunk_by(|a, b| a == b) {
        let key = match keys.entry(run[0]) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => *new.insert(builder.part(PartDesc::default())?),
        };
        for triangles in mesh.triangles[at..at + run.len()].chunks(PUSHED) {
            pushed.clear();
            pushed.extend(triangles.iter().map(|t| t.map(corner)));
            builder.triangles(MeshKey::DIRECT, key, &pushed, Attributes::NONE)?;
        }
        at += run.len();
    }
    Ok(())
}
