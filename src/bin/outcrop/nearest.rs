//! `outcrop nearest`.

use crate::common::{self, Failure, Outcome};
use glam::{DAffine3, DVec3};
use outcrop::query::PartSet;
use outcrop::query::{DistanceOptions, HitKind, NONE, NearestOptions, NearestPoint, SetDistance};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Find the surface nearest to points, or the distance between parts
#[derive(clap::Args)]
pub struct Args {
    /// The model file
    #[arg(value_name = "MODEL.oc")]
    model: PathBuf,
    /// A point; may be given several times
    #[arg(
        long, num_args = 3, allow_negative_numbers = true, value_names = ["X", "Y", "Z"], value_parser = number,
        required_unless_present_any = ["points", "from"]
    )]
    point: Vec<f64>,
    /// A text file with a point in each line: three numbers, separated by spaces or commas
    #[arg(long, value_name = "FILE")]
    points: Option<PathBuf>,
    /// Say whether a closed part holds each point
    #[arg(long)]
    inside: bool,
    /// Ids of parts, separated by commas: the parts that are searched, or the first of two sets
    #[arg(long, value_name = "PARTS", value_delimiter = ',')]
    from: Vec<u64>,
    /// Ids of parts: print the distance between those of --from and these
    #[arg(
        long, value_name = "PARTS", value_delimiter = ',', requires = "from",
        conflicts_with_all = ["point", "points", "inside"]
    )]
    to: Vec<u64>,
    /// Distance beyond which nothing is found, in the unit of the model
    #[arg(long, value_name = "DISTANCE", default_value = "inf", allow_negative_numbers = true, value_parser = distance)]
    within: f64,
    /// Write a table of the points to this file
    #[arg(long, value_name = "FILE.csv", conflicts_with = "to")]
    csv: Option<PathBuf>,
    /// Bytes of memory, with suffix K, M, G or T; 0 for three quarters of the machine's memory
    #[arg(long, value_name = "BYTES", default_value = "0", value_parser = common::byte_size)]
    memory: u64,
    /// Threads, 0 for all of the machine
    #[arg(long, value_name = "COUNT", default_value = "0", value_parser = common::threads)]
    threads: usize,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Parses a finite number.
fn number(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or("expected a finite number".into())
}

/// Parses a distance: a number, 0 or more.
fn distance(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| *x >= 0.0).ok_or("expected a number, 0 or more".into())
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let mut points: Vec<DVec3> = args.point.chunks_exact(3).map(DVec3::from_slice).collect();
    if let Some(path) = &args.points {
        points.extend(read_points(path)?);
    }
    if args.to.is_empty() && points.is_empty() {
        return Err(Failure::Usage("give points, or --from and --to with ids of parts".into()));
    }
    let options = ContextOptions { memory_budget: args.memory, ..ContextOptions::default() };
    let threads = if args.threads == 0 { options.threads } else { args.threads };
    let context = Context::new(ContextOptions { threads, ..options })?;
    let model = Model::open(&context, &args.model)?;
    let scene = Scene::new(&context);
    scene.add_instance(&model, 0, DAffine3::IDENTITY)?;
    scene.commit()?;
    let of = |ids: &[u64]| {
        let mut set = PartSet::default();
        ids.iter().for_each(|&id| set.add_part(None, id));
        if ids.is_empty() { PartSet::all() } else { set }
    };
    if !args.to.is_empty() {
        let options = DistanceOptions { a: of(&args.from), b: Some(of(&args.to)), max_distance: args.within };
        let found = scene.state().distance(&options)?;
        return common::print(
            args.json,
            &distance_as_json(&model, found.as_ref()),
            &distance_as_text(&model, found.as_ref()),
        );
    }
    let options = NearestOptions {
        set: of(&args.from),
        max_distance: args.within,
        inside: args.inside,
        ..NearestOptions::default()
    };
    let mut found = vec![NearestPoint::MISS; points.len()];
    scene.state().nearest(&points, &options, &mut found)?;
    let report = Report { model, points, found, inside: args.inside };
    if let Some(path) = &args.csv {
        std::fs::write(path, report.as_csv())
            .map_err(|e| outcrop::Error::io(path.display().to_string(), "write", e))?;
    }
    common::print(args.json, &report.as_json(), &report.as_text())
}

/// Reads points, one a line.
fn read_points(path: &Path) -> Result<Vec<DVec3>, Failure> {
    let text = std::fs::read_to_string(path).map_err(|e| outcrop::Error::io(path.display().to_string(), "read", e))?;
    let point = |(line, text): (usize, &str)| {
        let words = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty());
        let numbers: Result<Vec<f64>, String> = words.map(number).collect();
        match numbers.as_deref() {
            Ok(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
            _ => Err(Failure::Usage(format!("{}, line {}: expected three numbers", path.display(), line + 1))),
        }
    };
    text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()).map(point).collect()
}

fn name(model: &Model, part: u64) -> &str {
    let index = model.part_index(part);
    index.and_then(|index| model.parts().get(index as usize)).map_or("", |part| part.name)
}

fn distance_as_json(model: &Model, found: Option<&SetDistance>) -> Value {
    let Some(found) = found else { return json!({"distance": null}) };
    let side = |i: usize| {
        json!({
            "part": found.parts[i], "name": name(model, found.parts[i]), "triangle": found.prims[i],
            "point": found.points[i].to_array(),
        })
    };
    json!({"distance": found.distance, "error": found.error, "from": side(0), "to": side(1)})
}

fn distance_as_text(model: &Model, found: Option<&SetDistance>) -> String {
    let Some(found) = found else { return "nothing within the distance".into() };
    let side = |i: usize| {
        let (part, p) = (found.parts[i], found.points[i]);
        format!("{part} {:?} at {:.6} {:.6} {:.6}", name(model, part), p.x, p.y, p.z)
    };
    format!("distance {}\tfrom {}\tto {}", found.distance, side(0), side(1))
}

struct Report {
    model: Model,
    points: Vec<DVec3>,
    found: Vec<NearestPoint>,
    inside: bool,
}

impl Report {
    fn as_json(&self) -> Value {
        let one = |(point, it): (&DVec3, &NearestPoint)| {
            let mut value = if it.kind == HitKind::Miss {
                json!({"point": point.to_array(), "distance": null})
            } else {
                json!({
                    "point": point.to_array(), "distance": it.distance, "error": it.error,
                    "position": it.position.to_array(), "part": it.part, "name": name(&self.model, it.part),
                    "triangle": (it.prim != NONE).then_some(it.prim),
                })
            };
            if self.inside {
                value["inside"] = holds(it.holds).into();
            }
            value
        };
        json!({"points": self.points.iter().zip(&self.found).map(one).collect::<Value>()})
    }

    fn as_csv(&self) -> String {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let mut text = "x,y,z,distance,error,nearest x,nearest y,nearest z,part,name,triangle,inside\n".to_string();
        for (p, it) in self.points.iter().zip(&self.found) {
            text += &format!("{},{},{},", p.x, p.y, p.z);
            text += &if it.kind == HitKind::Miss {
                ",,,,,,,".to_string()
            } else {
                let at = it.position;
                let name = quoted(name(&self.model, it.part));
                format!("{},{},{},{},{},{},{name},{}", it.distance, it.error, at.x, at.y, at.z, it.part, it.prim)
            };
            text += &format!(",{}\n", if self.inside { holds(it.holds) } else { "" });
        }
        text
    }

    fn as_text(&self) -> String {
        let mut lines = Vec::new();
        for (p, it) in self.points.iter().zip(&self.found) {
            let mut line = format!("{} {} {}", p.x, p.y, p.z);
            line += &if it.kind == HitKind::Miss {
                "\tnothing within the distance".to_string()
            } else {
                let (at, name) = (it.position, name(&self.model, it.part));
                format!("\tdistance {}\tat {:.6} {:.6} {:.6}\tpart {} {name:?}", it.distance, at.x, at.y, at.z, it.part)
            };
            if self.inside {
                line += "\t";
                line += holds(it.holds);
            }
            lines.push(line);
        }
        lines.join("\n")
    }
}

fn holds(holds: u32) -> &'static str {
    match holds {
        0 => "outside",
        1 => "inside",
        _ => "undecided",
    }
}
