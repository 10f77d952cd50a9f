//! `outcrop build`.

use crate::common::{self, Outcome};
use crate::output::Destination;
use outcrop::base::progress::Progress;
use outcrop::build::{BuildOptions, BuildReport, Builder, MOST_PROXY_RAYS, Splits, StandIns, Structure, SurfaceLeaves};
use outcrop::import::surfaces::{Dicing, HeightMap, MOST_LEVEL};
use outcrop::import::{Access, UpAxis};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;

/// Build a model file from mesh files (PLY, OBJ, STL, glTF, GLB, raw soup, BPT and NURBS faces)
#[derive(clap::Args)]
pub struct Args {
    /// Mesh files; all of them become one model
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The model file to write: a regular file or a new one, and none of the inputs
    #[arg(short, long, value_name = "OUT.oc")]
    output: PathBuf,
    /// The acceleration structure. With patch smooth surfaces are kept as grids, and the primitive ids of hits on them
    /// are faces
    #[arg(long, default_value = "bvh", value_parser = common::one_of(Structure::ALL, Structure::name))]
    structure: Structure,
    /// Bytes of memory that the build may use, with suffix K, M, G or T, at least 32M; data beyond that goes to
    /// temporary files. 0: no limit
    #[arg(long, value_name = "BYTES", default_value = "0", allow_negative_numbers = true, value_parser = common::byte_size)]
    memory: u64,
    /// Number of threads; 0 for all of the machine
    #[arg(long, value_name = "N", default_value = "0", allow_negative_numbers = true, value_parser = common::threads)]
    threads: usize,
    /// Folder for temporary files
    #[arg(long, value_name = "FOLDER")]
    temp: Option<PathBuf>,
    /// Spatial splits, for long thin parts
    #[arg(long, default_value = "auto", value_parser = common::one_of(Splits::ALL, Splits::name))]
    splits: Splits,
    /// Length unit in metres, overriding the files
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, value_parser = common::positive)]
    unit: Option<f64>,
    /// The axis that points up, overriding the files
    #[arg(long, value_parser = ["x", "y", "z"])]
    up: Option<String>,
    /// Edges between triangles that meet at less than this angle appear smooth, where the files give no normals; at
    /// most 180 degrees. 0: 40. Below 0: surfaces without normals show their facets
    #[arg(long, value_name = "DEGREES", default_value = "0", allow_negative_numbers = true)]
    crease: f32,
    /// A folder of files that mesh files may refer to, besides the folder of each mesh file and those below it; may be
    /// repeated
    #[arg(long, value_name = "FOLDER")]
    trust_folder: Vec<PathBuf>,
    /// Mesh files may refer to any file, by absolute paths, `..` and links: only for files from a trusted source
    #[arg(long)]
    trust_paths: bool,
    /// Greatest number of triangles of the input, with suffix K, M, G or T; more is an error. 0: no limit
    #[arg(long, value_name = "N", default_value = "0", value_parser = common::count)]
    max_triangles: u64,
    /// Greatest number of bytes that the model and temporary files take on the disk, with suffix K, M, G or T; more is
    /// an error. 0: no limit
    #[arg(long, value_name = "BYTES", default_value = "0", value_parser = common::byte_size)]
    max_bytes: u64,
    /// The look of stand-ins, shown for what is small or not in memory: each cell's own (voxels), or one from eighteen
    /// directions for subtrees of some hundred triangles (proxies)
    #[arg(long, default_value = "auto", value_parser = common::one_of(StandIns::ALL, StandIns::name))]
    stand_ins: StandIns,
    /// Number of rays that sample each proxy [default: 512]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_PROXY_RAYS)))]
    proxy_rays: Option<u32>,
    /// Fewest triangles of a subtree with a proxy. 0: so many that all proxies take about 0.3 bytes for each triangle
    #[arg(long, value_name = "N", default_value = "0")]
    proxy_triangles: u32,
    /// Faces of OBJ files are the cages of Catmull-Clark subdivision surfaces, with creases and corners by `t` lines
    #[arg(long)]
    subdivide: bool,
    /// A picture of heights by which subdivision surfaces are moved along their normals (PNG with 8 or 16 bits, or EXR)
    #[arg(long, value_name = "MAP", requires = "subdivide")]
    displace: Option<PathBuf>,
    /// Height of white in the picture of heights, in units of the surface [default: 1]
    #[arg(long, value_name = "S", allow_negative_numbers = true, requires = "displace")]
    scale: Option<f64>,
    /// Greatest distance between smooth surfaces and their triangles, in units of the surface [default: 1/2048 of its
    /// extent]
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = common::positive)]
    tolerance: Option<f64>,
    /// Number of times that each side of a face of a smooth surface is halved, in place of a tolerance
    #[arg(long, value_name = "N", conflicts_with = "tolerance",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_LEVEL)))]
    level: Option<u32>,
    /// With patch: triangles of surfaces are computed from control points where a ray comes to them, at about a byte
    /// for each (boxes), or their vertices are stored (facets)
    #[arg(long, default_value = "boxes", value_parser = common::one_of(SurfaceLeaves::ALL, SurfaceLeaves::name))]
    leaves: SurfaceLeaves,
    /// With patch: squares of surfaces are divided while their normals are not within a cone of this opening, at most
    /// 180 degrees. 0: 30
    #[arg(long, value_name = "DEGREES", default_value = "0")]
    flat: f32,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let inputs: Vec<_> = args.files.iter().map(PathBuf::as_path).collect();
    let to = Destination::new(&args.output, "oc", "a model file", &inputs, false)?;
    let cancel = common::cancel_on_ctrl_c();
    let options = BuildOptions {
        structure: args.structure,
        memory_budget: args.memory,
        threads: args.threads,
        temp_dir: args.temp.clone(),
        splits: args.splits,
        metres_per_unit: args.unit,
        up: args.up.as_deref().map(|up| match up {
            "x" => UpAxis::X,
            "y" => UpAxis::Y,
            _ => UpAxis::Z,
        }),
        crease_angle: args.crease,
        access: Access { folders: args.trust_folder.clone(), any: args.trust_paths, resolver: None },
        max_triangles: args.max_triangles,
        max_bytes: args.max_bytes,
        stand_ins: args.stand_ins,
        proxy_rays: args.proxy_rays.unwrap_or(0),
        proxy_triangles: args.proxy_triangles,
        dicing: args.level.map(Dicing::Level).or(args.tolerance.map(Dicing::Tolerance)),
        surface_leaves: args.leaves,
        surface_flat: args.flat,
        subdivide: args.subdivide,
        displacement: args.displace.clone().map(|path| HeightMap { path, scale: args.scale.unwrap_or(1.0) }),
    };
    let progress = Arc::new(Progress::default());
    let mut builder = Builder::new(options, Arc::clone(&progress), cancel)?;
    let bar = common::progress_bar(1000);
    let report = common::watched(&progress, &bar, || {
        builder.add_files(&args.files)?;
        builder.finish(&args.output)
    });
    bar.finish_and_clear();
    let report = report?;
    for note in &report.notes {
        eprintln!("outcrop: note: {note}");
    }
    let file = args.output.display().to_string();
    to.report(args.json, &as_json(&file, &report), &as_text(&file, &report))
}

fn seconds(r: &BuildReport) -> f64 {
    r.seconds.read + r.seconds.distribute + r.seconds.build + r.seconds.write
}

fn as_json(file: &str, r: &BuildReport) -> Value {
    json!({
        "file": file,
        "triangles_in": r.triangles_in,
        "triangles_kept": r.triangles_kept,
        "dropped": {
            "non_finite": r.non_finite, "degenerate": r.degenerate, "out_of_range": r.out_of_range,
        },
        "references": r.references,
        "spatial_splits": r.spatial_splits,
        "parts": r.parts,
        "trees": r.trees,
        "instances": r.instances,
        "nodes": r.nodes,
        "leaves": r.leaves,
        "blocks": r.blocks,
        "blocks_coarse": r.blocks_coarse,
        "chunks": r.chunks,
        "bytes": r.bytes,
        "bytes_ids": r.bytes_ids,
        "bytes_normals": r.bytes_normals,
        "bytes_trace": r.bytes_trace,
        "proxies": r.proxies,
        "bytes_proxies": r.bytes_proxies,
        "bytes_temporary": r.bytes_temporary,
        "position_error": r.position_error,
        "unusable_normals": r.unusable_normals,
        "notes": r.notes,
        "seconds": {
            "read": r.seconds.read, "distribute": r.seconds.distribute, "build": r.seconds.build,
            "write": r.seconds.write, "total": seconds(r),
        },
    })
}

fn as_text(file: &str, r: &BuildReport) -> String {
    use common::{counted, each};
    let dropped: String =
        [("not finite", r.non_finite), ("without area", r.degenerate), ("out of range", r.out_of_range)]
            .iter()
            .filter(|(_, n)| *n > 0)
            .map(|(why, n)| format!(", {n} {why}"))
            .collect();
    let moved = match r.position_error {
        0.0 => String::new(),
        error => format!(", moved by up to {error:.2e} units"),
    };
    let sizes = match r.triangles_kept {
        0 => String::new(),
        n => format!(
            " ({}, of which {:.1} are primitive ids{}); {} in memory\n{:.2} references per triangle{}",
            each(r.bytes, n),
            r.bytes_ids as f64 / n as f64,
            match r.bytes_normals {
                0 => String::new(),
                bytes => format!(" and {:.1} normals", bytes as f64 / n as f64),
            },
            each(r.bytes_trace, n),
            r.references as f64 / n as f64,
            if r.spatial_splits { " (spatial splits)" } else { "" },
        ),
    };
    let chunks = match r.bytes_temporary {
        0 => String::new(),
        n => format!(
            ", into {} through {} of temporary files {:.1}",
            counted(r.chunks, "chunk"),
            common::in_bytes(n),
            r.seconds.distribute
        ),
    };
    format!(
        "{file}: {} of {}{dropped}{moved}; {}, {}, {}\n{}{sizes}; {:.1} s (read {:.1}{}, build {:.1}, write {:.1})",
        r.triangles_kept,
        counted(r.triangles_in, "triangle"),
        counted(r.parts, "part"),
        counted(r.trees, "tree"),
        counted(r.instances, "instance"),
        common::in_bytes(r.bytes),
        seconds(r),
        r.seconds.read,
        chunks,
        r.seconds.build,
        r.seconds.write,
    )
}
