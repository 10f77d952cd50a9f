//! The budget that an error names suffices: each call succeeds after two retries at most, with large tables too.

use crate::common::built::{self, Built};
use crate::common::frames::LONG;
use glam::{DAffine3, DVec3};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::scene::{Context, ContextOptions, Look, Model, Scene, Scope};
use outcrop::{Error, Frame, FrameOptions, FrameSettings, FrameState, Result};
use std::collections::BTreeMap;

/// Retries of each call.
const TRIES: usize = 2;

fn triangle(i: usize) -> [DVec3; 3] {
    let at = DVec3::new((i % 500) as f64, (i / 500) as f64, (i % 7) as f64);
    [at, at + DVec3::X, at + DVec3::Y]
}

fn build(fill: impl FnOnce(&mut Builder)) -> Built {
    built::build_with(BuildOptions { threads: 2, ..built::options() }, fill).0
}

fn part(builder: &mut Builder, id: usize, parent: Option<u32>) -> u32 {
    let desc = PartDesc { id: Some(id as u64), name: format!("part {id}"), parent, material: None };
    builder.part(desc).expect("a part")
}

/// A model with many parts below one, each with a triangle.
fn many_parts(count: usize) -> Built {
    build(|builder| {
        let root = part(builder, 0, None);
        for i in 1..count {
            let part = part(builder, i, Some(root));
            builder.triangles(MeshKey::DIRECT, part, &[triangle(i)], Attributes::NONE).expect("a triangle");
        }
    })
}

/// A model that places one mesh many times.
fn many_placements(count: usize) -> Built {
    build(|builder| {
        let part = part(builder, 0, None);
        let mesh = builder.shared_mesh(1).expect("a mesh");
        builder.triangles(mesh, 0, &[triangle(0), triangle(501)], Attributes::NONE).expect("triangles");
        for i in 0..count {
            builder.instance(mesh, DAffine3::from_translation(triangle(3 * i)[0]), part).expect("an instance");
        }
    })
}

/// The name of a call, and its error.
type Failed = (&'static str, Error);

/// Opens a model in a budget, and makes the calls of a viewer.
fn view(built: &Built, budget: u64, places: usize) -> std::result::Result<(), Failed> {
    let at = |call: &'static str| move |error: Error| (call, error);
    let options = ContextOptions { threads: 2, memory_budget: budget, read_ahead: false, ..Default::default() };
    let context = Context::new(options).map_err(at("context"))?;
    let model = Model::open(&context, &built.path).map_err(at("open"))?;
    let scene = Scene::new(&context);
    let place = |i: usize| DAffine3::from_translation(DVec3::Z * (10 * i) as f64);
    let add = |i: usize| scene.add_instance(&model, i as u64, place(i));
    (0..places).try_for_each(add).map_err(at("add"))?;
    scene.commit().map_err(at("commit"))?;
    let parts: Vec<u64> = model.parts().iter().map(|part| part.id).collect();
    let look = Look { colour: Some([1.0, 0.0, 0.0, 1.0]), ..Look::default() };
    scene.set_parts_look(0, &parts, Scope::Own, look).map_err(at("colour"))?;
    scene.commit().map_err(at("commit of colours"))?;
    scene.isolate_parts(0, &parts[parts.len() / 2..], Scope::Below).map_err(at("isolate"))?;
    scene.commit().map_err(at("commit of hidden parts"))?;
    frame(&context, &scene, &model).map_err(at("frame"))
}

fn frame(context: &Context, scene: &Scene, model: &Model) -> Result<()> {
    let frame = Frame::new(context, FrameOptions { width: 160, height: 100, ..FrameOptions::default() })?;
    frame.request(&scene.state(), &model.views()[0], &FrameSettings::default())?;
    let status = frame.wait(LONG);
    match (status.state, status.error) {
        (FrameState::Converged | FrameState::CompleteWithinBudget, None) => Ok(()),
        (state, Some(error)) => {
            println!("{state:?}: {error}");
            Err(Error::clone(&error))
        }
        (state, None) => panic!("{state:?}"),
    }
}

/// Makes the calls in a budget, and again in the budget that the error names. Returns the budget that suffices.
fn check(built: &Built, mut budget: u64, places: usize) -> u64 {
    let first = budget;
    let mut tries = BTreeMap::<&str, usize>::new();
    while let Err((call, error)) = view(built, budget, places) {
        let Error::OverBudget { need, have, what } = error else { panic!("{call}: {error}") };
        println!("{call} in {have}: {what} needs {need}");
        assert!(have == budget && need > have, "{call}: {need} of {have}");
        let again = tries.entry(call).or_default();
        *again += 1;
        // Memory for instances is made by doubling, for as many as are added.
        assert!(*again <= TRIES || call == "add", "{call} fails again, in {need} bytes");
        budget = need;
    }
    println!("{first} bytes: {tries:?}, {budget} suffice");
    budget
}

/// Large tables where the code is optimised.
fn sized(optimised: usize, other: usize) -> usize {
    if cfg!(optimised) { optimised } else { other }
}

fn check_all(built: &Built, places: usize) {
    let least = check(built, 4096, places);
    for hundredths in [99, 90, 75, 50, 25] {
        let enough = check(built, least * hundredths / 100, places);
        assert!(enough <= least * 11 / 10, "{enough} instead of {least}");
    }
}

#[test]
fn many_parts_say_what_they_need() {
    check_all(&many_parts(sized(300_000, 30_000)), 1);
}

#[test]
fn many_instances_say_what_they_need() {
    check_all(&many_parts(20), sized(100_000, 10_000));
}

#[test]
fn many_placements_in_a_model_say_what_they_need() {
    check_all(&many_placements(sized(100_000, 10_000)), 1);
    check_all(&many_placements(3), 3);
}

/// A commit that fails for lack of room leaves each id with its instance, after others were removed too.
#[test]
fn ids_are_right_after_a_commit_that_fails() {
    let built = many_placements(sized(100_000, 10_000));
    let open = |memory_budget| {
        let options = ContextOptions { threads: 2, memory_budget, read_ahead: false, ..Default::default() };
        let context = Context::new(options).expect("a context");
        Model::open(&context, &built.path).map(|model| (Scene::new(&context), model))
    };
    let Err(Error::OverBudget { need, .. }) = open(4096).map(drop) else { panic!("a page does not do") };
    let (scene, model) = open(need).expect("the least does");
    for id in [5, 6, 7] {
        scene.add_instance(&model, id, DAffine3::IDENTITY).expect("an instance");
    }
    scene.remove_instance(5).expect("it is there");
    assert!(matches!(scene.commit(), Err(Error::OverBudget { .. })));
    scene.set_transform(7, DAffine3::IDENTITY).expect("it is there");
    scene.remove_instance(6).expect("it is there");
    scene.remove_instance(7).expect("it is there");
    scene.commit().expect("an empty scene");
    assert_eq!(scene.state().instance_count(), 0);
}
