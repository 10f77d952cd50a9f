//! `outcrop clash`.

use crate::clash_groups::{Group, Grouping};
use crate::common::{self, Failure, Outcome};
use glam::{DAffine3, DVec3};
use outcrop::base::progress::Progress;
use outcrop::math::DBounds;
use outcrop::query::NONE;
use outcrop::query::PartSet;
use outcrop::query::clash::{Clash, ClashDetail, ClashKind, ClashOptions, ClashRules, ClashSummary};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// List the parts of a model that clash: within it, or with those of another model
#[derive(clap::Args)]
pub struct Args {
    /// The model file
    #[arg(value_name = "A.oc")]
    first: PathBuf,
    /// A second model: parts of the first are compared with parts of this one
    #[arg(value_name = "B.oc")]
    second: Option<PathBuf>,
    /// Distance up to which parts that are apart clash, in the unit of the model
    #[arg(long, value_name = "DISTANCE", default_value = "0", allow_negative_numbers = true, value_parser = distance)]
    clearance: f64,
    /// Depth up to which closed parts that reach into each other only touch, in the unit of the model: finds how deep
    /// the others are, up to this. 0: no depths
    #[arg(long, value_name = "DISTANCE", default_value = "0", allow_negative_numbers = true, value_parser = distance)]
    tolerance: f64,
    /// List pairs of triangles, not of parts
    #[arg(long)]
    triangles: bool,
    /// Greatest number of pairs of triangles
    #[arg(long, value_name = "COUNT", default_value = "1M", value_parser = common::count)]
    limit: u64,
    /// Pairs of parts that are not compared
    #[arg(long, value_name = "RULE", value_parser = common::one_of(Skip::ALL, Skip::name))]
    skip: Vec<Skip>,
    /// Pairs of part ids that are not compared: a JSON file with a list of pairs, such as [[3, 7], [3, 8]]
    #[arg(long, value_name = "RULES.json")]
    rules: Option<PathBuf>,
    /// List clashes in groups: those of a part, of two parts, or those whose boxes overlap
    #[arg(long, value_name = "BY", value_parser = common::one_of(Grouping::ALL, Grouping::name))]
    group: Option<Grouping>,
    /// An earlier output with --json: each clash is new or remains, and those that are gone are counted
    #[arg(long, value_name = "OLD.json")]
    against: Option<PathBuf>,
    /// Write a table to this file
    #[arg(long, value_name = "FILE.csv")]
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

/// Pairs of parts that are not compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Skip {
    SameParent,
    SameMaterial,
}

impl Skip {
    const ALL: [Self; 2] = [Self::SameParent, Self::SameMaterial];

    fn name(self) -> &'static str {
        match self {
            Self::SameParent => "same-parent",
            Self::SameMaterial => "same-material",
        }
    }
}

/// Parses a distance: a finite number, 0 or more.
fn distance(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0).ok_or("expected a finite number, 0 or more".into())
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let old = args.against.as_deref().map(old_ids).transpose()?;
    let cancel = common::cancel_on_ctrl_c();
    let options = ContextOptions { memory_budget: args.memory, ..ContextOptions::default() };
    let threads = if args.threads == 0 { options.threads } else { args.threads };
    let context = Context::new(ContextOptions { threads, ..options })?;
    let scene = Scene::new(&context);
    let files = [Some(&args.first), args.second.as_ref()];
    let mut models = Vec::new();
    for (id, file) in (0..).zip(files.into_iter().flatten()) {
        let model = Model::open(&context, file)?;
        scene.add_instance(&model, id, DAffine3::IDENTITY)?;
        models.push(model);
    }
    scene.commit()?;
    let options = options_of(args)?;
    let (progress, bar, mut clashes) = (Progress::default(), common::progress_bar(1000), Vec::new());
    let summary = common::watched(&progress, &bar, || {
        scene.state().clash(&options, &progress, &cancel, &mut |clash| clashes.push(*clash))
    })?;
    bar.finish_and_clear();
    let near = 0.5 * args.clearance + args.tolerance;
    let groups = args.group.map(|by| (by, by.of(&clashes, near)));
    let report = Report { models, clashes, summary, old, groups };
    if let Some(path) = &args.csv {
        std::fs::write(path, report.as_csv())
            .map_err(|e| outcrop::Error::io(path.display().to_string(), "write", e))?;
    }
    common::print(args.json, &report.as_json(), &report.as_text())
}

fn options_of(args: &Args) -> Result<ClashOptions, Failure> {
    let of_instance = |id| {
        let mut set = PartSet::default();
        set.add_instance(id);
        set
    };
    let has = |skip| args.skip.contains(&skip);
    Ok(ClashOptions {
        a: of_instance(0),
        b: args.second.as_ref().map(|_| of_instance(1)),
        rules: ClashRules {
            same_parent: has(Skip::SameParent),
            same_material: has(Skip::SameMaterial),
            pairs: args.rules.as_deref().map(pairs_of).transpose()?.unwrap_or_default(),
            ..ClashRules::default()
        },
        clearance: args.clearance,
        tolerance: args.tolerance,
        detail: if args.triangles { ClashDetail::Triangles } else { ClashDetail::Parts },
        limit: args.limit,
    })
}

fn read_json(path: &Path) -> Result<Value, Failure> {
    let text = std::fs::read_to_string(path).map_err(|e| outcrop::Error::io(path.display().to_string(), "read", e))?;
    serde_json::from_str(&text).map_err(|e| Failure::Usage(format!("{}: {e}", path.display())))
}

/// Reads pairs of part ids.
fn pairs_of(path: &Path) -> Result<Vec<[u64; 2]>, Failure> {
    let pair = |value: &Value| match value.as_array().map(Vec::as_slice) {
        Some([a, b]) => Some([a.as_u64()?, b.as_u64()?]),
        _ => None,
    };
    let rules = read_json(path)?;
    let pairs = rules.as_array().and_then(|all| all.iter().map(pair).collect());
    pairs.ok_or_else(|| Failure::Usage(format!("{}: expected a list of pairs of part ids", path.display())))
}

/// Reads the ids of the clashes in an earlier output.
fn old_ids(path: &Path) -> Result<BTreeSet<u64>, Failure> {
    let all = read_json(path)?;
    let id = |clash: &Value| u64::from_str_radix(clash["id"].as_str()?, 16).ok();
    let ids = all["clashes"].as_array().and_then(|all| all.iter().map(id).collect());
    ids.ok_or_else(|| Failure::Usage(format!("{}: expected the output of outcrop clash --json", path.display())))
}

struct Report {
    models: Vec<Model>,
    clashes: Vec<Clash>,
    summary: ClashSummary,
    old: Option<BTreeSet<u64>>,
    groups: Option<(Grouping, Vec<Group>)>,
}

impl Report {
    fn name(&self, instance: u64, part: u64) -> &str {
        let model = &self.models[instance as usize];
        let index = model.part_index(part);
        index.and_then(|index| model.parts().get(index as usize)).map_or("", |part| part.name)
    }

    fn is_new(&self, clash: &Clash) -> Option<bool> {
        self.old.as_ref().map(|old| !old.contains(&clash.id()))
    }

    /// Number of earlier clashes that are gone.
    fn gone(&self) -> Option<usize> {
        let now: BTreeSet<u64> = self.clashes.iter().map(Clash::id).collect();
        self.old.as_ref().map(|old| old.difference(&now).count())
    }

    fn as_json(&self) -> Value {
        let side = |clash: &Clash, i: usize| {
            json!({
                "model": clash.instances[i], "part": clash.parts[i],
                "name": self.name(clash.instances[i], clash.parts[i]),
                "triangle": (clash.prims[i] != NONE).then_some(clash.prims[i]), "open": clash.is_open[i],
            })
        };
        let clash = |clash: &Clash| {
            let (eye, at) = camera(clash);
            let mut value = json!({
                "id": format!("{:016x}", clash.id()), "kind": kind(clash.kind),
                "first": side(clash, 0), "second": side(clash, 1),
                "points": clash.points.map(|p| p.to_array()),
                "bounds": [clash.bounds.min.to_array(), clash.bounds.max.to_array()],
                "normal": clash.normal.to_array(), "depth": clash.depth,
                "distance": clash.distance, "error": clash.error, "count": clash.count,
                "camera": {"eye": eye.to_array(), "at": at.to_array()},
            });
            if let Some(is_new) = self.is_new(clash) {
                value["status"] = if is_new { "new" } else { "remaining" }.into();
            }
            value
        };
        let mut all = json!({
            "clashes": self.clashes.iter().map(clash).collect::<Value>(),
            "pairs": self.summary.pairs, "cut": self.summary.is_cut,
        });
        if let Some(gone) = self.gone() {
            all["gone"] = gone.into();
        }
        if let Some((by, groups)) = &self.groups {
            let id = |i: &usize| format!("{:016x}", self.clashes[*i].id());
            let group = |group: &Group| {
                let ids: Value = group.clashes.iter().map(id).collect();
                json!({"name": self.title(*by, group), "clashes": ids})
            };
            all["groups"] = groups.iter().map(group).collect();
        }
        all
    }

    /// The name of a group.
    fn title(&self, by: Grouping, group: &Group) -> String {
        let clashes = || group.clashes.iter().map(|&i| &self.clashes[i]);
        let Some(first) = clashes().next() else { return String::new() };
        let side = |k: usize| self.name(first.instances[k], first.parts[k]);
        match (by, group.part) {
            (_, Some([instance, part])) => self.name(instance, part).to_string(),
            (Grouping::Near, _) => {
                let bounds = clashes().fold(DBounds::EMPTY, |all, clash| all.union(clash.bounds));
                let at = (bounds.min + bounds.max) * 0.5;
                format!("at {:.6} {:.6} {:.6}", at.x, at.y, at.z)
            }
            _ => format!("{} and {}", side(0), side(1)),
        }
    }

    fn as_csv(&self) -> String {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let mut text = "id,kind,part a,name a,part b,name b,x,y,z,depth,distance,error,count\n".to_string();
        for c in &self.clashes {
            let [a, b] = [0, 1].map(|i| format!("{},{}", c.parts[i], quoted(self.name(c.instances[i], c.parts[i]))));
            let p = c.points[0];
            let (id, kind) = (c.id(), kind(c.kind));
            let Clash { depth, distance, error, count, .. } = c;
            text += &format!("{id:016x},{kind},{a},{b},{},{},{},{depth},{distance},{error},{count}\n", p.x, p.y, p.z);
        }
        text
    }

    /// The line of a clash.
    fn line(&self, c: &Clash) -> String {
        let [a, b] = [0, 1].map(|i| format!("{} {:?}", c.parts[i], self.name(c.instances[i], c.parts[i])));
        let p = c.points[0];
        let mut text = format!("{}\t{a}\t{b}\tat {:.6} {:.6} {:.6}", kind(c.kind), p.x, p.y, p.z);
        if c.depth > 0.0 {
            text += &format!("\tdepth {}", c.depth);
        }
        text += &match c.kind {
            ClashKind::Clearance => format!("\tdistance {}", c.distance),
            _ if c.count > 0 => format!("\t{}", common::counted(c.count, "triangle pair")),
            _ => String::new(),
        };
        text += match self.is_new(c) {
            Some(true) => "\tnew\n",
            Some(false) => "\tremaining\n",
            None => "\n",
        };
        text
    }

    fn as_text(&self) -> String {
        let mut text = match &self.groups {
            None => self.clashes.iter().map(|clash| self.line(clash)).collect(),
            Some((by, groups)) => {
                let group = |group: &Group| {
                    let count = common::counted_as(group.clashes.len() as u64, "clash", "clashes");
                    let lines: String =
                        group.clashes.iter().map(|&i| format!("  {}", self.line(&self.clashes[i]))).collect();
                    format!("{}: {count}\n{lines}", self.title(*by, group))
                };
                groups.iter().map(group).collect::<String>()
            }
        };
        let open: BTreeSet<(u64, u64)> = self
            .clashes
            .iter()
            .flat_map(|c| [0, 1].into_iter().filter(|&i| c.is_open[i]).map(|i| (c.instances[i], c.parts[i])))
            .collect();
        if !open.is_empty() {
            text += &format!(
                "{} not closed: nothing is known of their inside\n",
                common::counted(open.len() as u64, "part")
            );
        }
        if self.summary.is_cut {
            text += "there are more pairs of triangles: see --limit\n";
        }
        if let Some(gone) = self.gone() {
            text += &format!("{} gone\n", common::counted_as(gone as u64, "clash", "clashes"));
        }
        text + &common::counted(self.summary.pairs, "pair") + " of parts"
    }
}

fn kind(kind: ClashKind) -> &'static str {
    match kind {
        ClashKind::Crossing => "crossing",
        ClashKind::Coplanar => "coplanar",
        ClashKind::Touching => "touching",
        ClashKind::Clearance => "clearance",
        ClashKind::Hard => "hard",
        ClashKind::Piercing => "piercing",
        ClashKind::Contained => "contained",
        ClashKind::Duplicate => "duplicate",
    }
}

/// A camera that shows the place of a clash: its eye, and the point that it looks at.
fn camera(clash: &Clash) -> (DVec3, DVec3) {
    let at = (clash.bounds.min + clash.bounds.max) * 0.5;
    let size = (clash.bounds.max - clash.bounds.min).length().max(clash.distance).max(clash.depth);
    let size = if size > 0.0 { size } else { at.abs().max_element().max(1.0) * 1e-2 };
    (at + DVec3::new(-0.6, -0.64, 0.48) * (3.0 * size), at)
}
