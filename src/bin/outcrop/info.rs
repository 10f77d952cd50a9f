//! `outcrop info`.

use crate::common::{self, Failure, Outcome};
use crate::info_scene;
use outcrop::base::ids::BlockId;
use outcrop::build::Structure;
use outcrop::store::scene_file::is_scene_file;
use outcrop::store::{FileSource, ModelFile, PartRow};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Show the contents of a model file or a scene file without reading all geometry
#[derive(clap::Args)]
pub struct Args {
    /// The model file or the scene file
    #[arg(value_name = "FILE.oc")]
    model: PathBuf,
    /// List the parts too
    #[arg(long)]
    parts: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    if is_scene_file(&FileSource::open(&args.model)?)? {
        return match args.parts {
            true => Err(Failure::Usage("--parts requires a model, not a scene".into())),
            false => info_scene::run(&args.model, args.json),
        };
    }
    let file = ModelFile::open_path(&args.model)?;
    let value = as_json(&file, args.parts);
    common::print(args.json, &value, &as_text(&file, args.parts))
}

/// Returns the size in bytes of the trace form of all geometry.
fn trace_bytes(file: &ModelFile) -> u64 {
    (0..file.header().geometry_blocks).map(|b| u64::from(file.decoded_len(BlockId(b)))).sum()
}

fn structure(file: &ModelFile) -> &'static str {
    Structure::from_number(file.header().structure).map_or("unknown", Structure::name)
}

fn up(file: &ModelFile) -> Option<&'static str> {
    [None, Some("x"), Some("y"), Some("z")].get(file.header().up as usize).copied().flatten()
}

/// Returns whether a part with these flags is closed.
fn closed(flags: u32) -> &'static str {
    match (flags & PartRow::CLOSED != 0, flags & PartRow::ORIENTED != 0) {
        (false, _) => "open",
        (true, false) => "closed, but its triangles do not face one way",
        (true, true) => "closed",
    }
}

fn as_json(file: &ModelFile, with_parts: bool) -> Value {
    let h = file.header();
    let empty = h.bounds.iter().any(|x| !x.is_finite());
    let mut value = json!({
        "file": file.name().to_string_lossy(),
        "bytes": file.file_len(),
        "structure": structure(file),
        "bytes_trace": trace_bytes(file),
        "proxies": file.proxies().len(),
        "bytes_proxies": file.proxies().memory(),
        "block_size": h.block_size,
        "blocks": h.geometry_blocks,
        "triangles_in": h.triangles_in,
        "triangles": h.triangles_kept,
        "dropped": {
            "non_finite": h.drops.non_finite, "degenerate": h.drops.degenerate, "out_of_range": h.drops.out_of_range,
        },
        "bounds": if empty { Value::Null } else { json!({ "min": h.bounds[..3], "max": h.bounds[3..] }) },
        "metres_per_unit": if h.metres_per_unit > 0.0 { json!(h.metres_per_unit) } else { Value::Null },
        "up": up(file),
        "parts": file.parts().len(),
        "materials": file.materials().len(),
        "trees": file.trees().len(),
        "instances": file.instances().len(),
        "nodes": file.trees().iter().map(|t| t.nodes).sum::<u64>(),
        "leaves": file.trees().iter().map(|t| t.leaves).sum::<u64>(),
        "references": file.trees().iter().map(|t| t.references).sum::<u64>(),
        "has_colours": h.has_colours,
        "has_normals": h.has_normals,
        "spatial_splits": h.options.spatial_splits,
    });
    if with_parts {
        let rows = file.parts().iter().map(|p| {
            json!({
                "id": p.id, "name": p.name, "parent": p.parent, "material": p.material, "triangles": p.triangles,
                "closed": p.flags & PartRow::CLOSED != 0, "oriented": p.flags & PartRow::ORIENTED != 0,
            })
        });
        value["part_list"] = rows.collect();
    }
    value
}

fn as_text(file: &ModelFile, with_parts: bool) -> String {
    let h = file.header();
    let bytes = trace_bytes(file);
    let unit = if h.metres_per_unit > 0.0 { format!("{} m", h.metres_per_unit) } else { "unknown".into() };
    let empty = h.bounds.iter().any(|x| !x.is_finite());
    let bounds = if empty { "empty".into() } else { format!("{:?} .. {:?}", &h.bounds[..3], &h.bounds[3..]) };
    let many = |n: usize, noun| common::counted(n as u64, noun);
    let proxies = match file.proxies().len() {
        0 => String::new(),
        n => format!(", proxies: {n} in {}", common::in_bytes(file.proxies().memory())),
    };
    let mut text = format!(
        "{}: {}, {}, {} of {} in the input\n\
         {} of at most {}, {} in memory ({})\n\
         {}, {}, {}, {}{proxies}\n\
         bounds {bounds}, unit {unit}, up {}\n",
        file.name().display(),
        structure(file),
        common::in_bytes(file.file_len()),
        common::counted(h.triangles_kept, "triangle"),
        h.triangles_in,
        common::counted(h.geometry_blocks.into(), "block"),
        common::in_bytes(h.block_size.into()),
        common::in_bytes(bytes),
        common::each(bytes, h.triangles_kept),
        many(file.parts().len(), "part"),
        many(file.materials().len(), "material"),
        many(file.trees().len(), "tree"),
        many(file.instances().len(), "instance"),
        up(file).unwrap_or("unknown"),
    );
    if with_parts {
        for p in file.parts().iter() {
            let triangles = common::counted(p.triangles, "triangle");
            text += &format!("{}\t{}\t{triangles}\t{}\n", p.id, p.name, closed(p.flags));
        }
    }
    text
}
