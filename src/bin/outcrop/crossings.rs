//! `outcrop crossings`.

use crate::common::{self, Outcome};
use glam::{DAffine3, DVec3, Vec3};
use outcrop::build::Structure;
use outcrop::math::Ray;
use outcrop::query::{Crossing, Holds, PartAt, Policy, Side};
use outcrop::scene::{Context, ContextOptions, Model, Scene, SceneState};
use serde_json::{Value, json};
use std::path::PathBuf;

/// List all surfaces that a ray crosses, in order, and the parts that hold its start point
#[derive(clap::Args)]
pub struct Args {
    /// The model file
    #[arg(value_name = "MODEL.oc")]
    model: PathBuf,
    /// Start point and direction of the ray
    #[arg(
        long, num_args = 6, required = true, allow_negative_numbers = true, value_names = ["OX", "OY", "OZ", "DX", "DY", "DZ"],
        value_parser = number
    )]
    ray: Vec<f64>,
    /// Bytes of memory, with suffix K, M, G or T; 0 for three quarters of the machine's memory
    #[arg(long, value_name = "BYTES", default_value = "0", allow_negative_numbers = true, value_parser = common::byte_size)]
    memory: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Parses a finite number.
fn number(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or("expected a finite number".into())
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let at = |i: usize| args.ray.get(i).copied().unwrap_or(0.0);
    let ray = Ray::new(DVec3::new(at(0), at(1), at(2)), DVec3::new(at(3), at(4), at(5)).as_vec3());
    if ray.dir == Vec3::ZERO {
        return Err(common::Failure::Usage("--ray: the direction is zero".into()));
    }
    let context = Context::new(ContextOptions { memory_budget: args.memory, ..ContextOptions::default() })?;
    let model = Model::open(&context, &args.model)?;
    let scene = Scene::new(&context);
    scene.add_instance(&model, 0, DAffine3::IDENTITY)?;
    scene.commit()?;
    let (crossings, parts) = ask(&scene.state(), &ray)?;
    common::print(args.json, &as_json(&model, &crossings, &parts), &as_text(&model, &crossings, &parts))
}

/// Returns the crossings of the ray, and the parts at its origin.
fn ask(scene: &SceneState, ray: &Ray) -> outcrop::Result<(Vec<Crossing>, Vec<PartAt>)> {
    let (mut crossings, mut parts) = (Vec::new(), Vec::new());
    scene.crossings(&&[*ray][..], Policy::Exact, &mut |_, found, _| crossings.extend_from_slice(found))?;
    scene.parts_at(&[ray.origin], &mut |_, found| parts.extend_from_slice(found))?;
    Ok((crossings, parts))
}

fn name(model: &Model, part: u64) -> &str {
    let index = model.part_index(part);
    index.and_then(|index| model.parts().get(index as usize)).map_or("", |part| part.name)
}

fn side(side: Side) -> &'static str {
    if side == Side::Front { "front" } else { "back" }
}

fn as_json(model: &Model, crossings: &[Crossing], parts: &[PartAt]) -> Value {
    let crossing = |c: &Crossing| {
        json!({
            "t": c.t, "side": side(c.side), "part": c.part, "name": name(model, c.part), "prim": c.prim,
            "normal": c.normal.to_array(), "error": c.error,
        })
    };
    let part = |p: &PartAt| {
        json!({
            "part": p.part, "name": name(model, p.part), "winding": p.winding, "decided": p.holds == Holds::Inside,
        })
    };
    json!({
        "crossings": crossings.iter().map(crossing).collect::<Value>(),
        "inside": parts.iter().map(part).collect::<Value>(),
    })
}

fn as_text(model: &Model, crossings: &[Crossing], parts: &[PartAt]) -> String {
    let mut text = String::new();
    for p in parts {
        let how = if p.holds == Holds::Inside { "in" } else { "perhaps in" };
        text += &format!("starts {how} part {} {:?}\n", p.part, name(model, p.part));
    }
    // The ids of both a triangle and a face of a surface.
    let of = if model.info().structure == Structure::Patch.name() { "primitive" } else { "triangle" };
    for c in crossings {
        text += &format!("{}\t{}\tpart {} {:?}\t{of} {}\n", c.t, side(c.side), c.part, name(model, c.part), c.prim);
    }
    text + &common::counted(crossings.len() as u64, "crossing")
}
