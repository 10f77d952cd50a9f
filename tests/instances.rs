//! Instances against the oracle on flattened f64 triangles: a model with its own assembly (shared meshes turned,
//! mirrored, squashed, nested in each other's space), placed several times in a scene (turned, mirrored, scaled, on top
//! of each other). Every hit names the right instance, part and primitive; equal hits go to the first.

use crate::common::brute::{Oracle, Ray64, Tri};
use crate::common::built::{self, Built};
use crate::common::bvh64::Bvh64;
use crate::common::errors::{Answer, Judge, Summary, Verdict};
use crate::common::rays::RayMaker;
use crate::common::rounding::{Rounding, U};
use crate::common::{scenes, stored};
use glam::{DAffine3, DQuat, DVec3};
use outcrop::base::error::Error;
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::scene::{ContextOptions, Model, Scene};
use std::collections::HashMap;

const RAYS: usize = 60_000;

/// Placements of the model's own assembly: tree, transform, first part.
type Placements = Vec<(usize, DAffine3, u32)>;

fn turn(x: f64, y: f64) -> DQuat {
    DQuat::from_rotation_x(x) * DQuat::from_rotation_y(y)
}

/// Part ids are 500 + index.
fn part_id(part: u32) -> u64 {
    500 + u64::from(part)
}

fn assembly() -> Placements {
    let at = DAffine3::from_scale_rotation_translation;
    vec![
        (0, DAffine3::IDENTITY, 0),
        (1, at(DVec3::ONE, turn(0.3, 1.0), DVec3::new(3.0, 0.0, 0.0)), 1),
        (1, at(DVec3::new(-1.0, 1.0, 1.0), turn(1.0, 0.2), DVec3::new(-3.0, 0.0, 0.5)), 3),
        (1, at(DVec3::new(2.0, 0.2, 1.0), turn(2.0, -0.7), DVec3::new(0.0, 3.0, 0.0)), 5),
        (2, at(DVec3::splat(0.5), turn(0.0, 0.0), DVec3::new(3.0, 0.0, 0.0)), 7),
        (2, at(DVec3::splat(1e-3), turn(0.4, 0.4), DVec3::new(0.0, -2.0, 1.0)), 8),
        (2, at(DVec3::new(4.0, 4.0, -1.0), turn(0.0, 0.0), DVec3::new(0.0, 0.0, -4.0)), 9),
    ]
}

fn build() -> Built {
    built::build(|builder| {
        for p in 0..10 {
            builder.part(PartDesc { id: Some(part_id(p)), ..Default::default() }).expect("a part");
        }
        builder.triangles(MeshKey::DIRECT, 0, &scenes::boxes(20, 1), Attributes::NONE).expect("triangles");
        let bumpy = builder.shared_mesh(2).expect("a mesh");
        let tris = scenes::bumpy_sphere(24, 36, 7);
        let (low, high) = tris.split_at(700);
        builder.triangles(bumpy, 0, low, Attributes::NONE).expect("triangles");
        builder.triangles(bumpy, 1, high, Attributes::NONE).expect("triangles");
        let cube = builder.shared_mesh(1).expect("a mesh");
        builder.triangles(cube, 0, &scenes::cuboid(-DVec3::ONE, DVec3::ONE), Attributes::NONE).expect("triangles");
        for (tree, transform, first_part) in assembly().into_iter().skip(1) {
            let mesh = if tree == 1 { bumpy } else { cube };
            builder.instance(mesh, transform, first_part).expect("an instance");
        }
    })
}

/// Instances of the scene, in the order in which they are added.
fn placements() -> Vec<(u64, DAffine3)> {
    let at = DAffine3::from_scale_rotation_translation;
    let here = at(DVec3::splat(1.5), turn(0.2, 0.2), DVec3::new(1.0, 2.0, 3.0));
    vec![
        (1, DAffine3::IDENTITY),
        (2, here),
        (5, here),
        (7, at(DVec3::new(-0.5, 0.5, 0.5), turn(-1.0, 0.5), DVec3::new(-20.0, 5.0, 30.0))),
        (8, at(DVec3::new(1.0, -1.0, 2.0), turn(0.0, 0.0), DVec3::new(0.0, 40.0, 0.0))),
    ]
}

struct Flat {
    tris: Vec<Tri>,
    /// Instance, part and primitive of each.
    names: Vec<(u64, u64, u64)>,
}

fn flatten(file: &Built) -> Flat {
    let trees = stored::trees(&file.path);
    let mut flat = Flat { tris: Vec::new(), names: Vec::new() };
    for (instance, world) in placements() {
        for (tree, mesh, first_part) in assembly() {
            let m = world * mesh;
            let tree = &trees[tree];
            for (prim, part, corners) in &tree.tris {
                flat.tris.push(corners.map(|v| m.transform_point3(tree.origin + v)));
                flat.names.push((instance, part_id(first_part + part), u64::from(*prim)));
            }
        }
    }
    flat
}

/// Ratio of singular values: 2 : 0.2 inside, times 2 outside.
const SKEW: f64 = 20.0;

fn nested_shared_mirrored_squashed_and_tied() {
    let file = build();
    let flat = flatten(&file);
    let index: HashMap<_, _> = flat.names.iter().enumerate().map(|(i, &name)| (name, i as u32)).collect();
    assert_eq!(index.len(), flat.names.len());
    let oracle = Bvh64::new(flat.tris.clone());
    let reach = flat.tris.iter().flatten().map(|v| v.abs().max_element()).fold(0.0, f64::max);
    let rounding =
        Rounding { origin: 0.0, direction: 1.7321, absolute: U * 1.7321 * SKEW * reach, stretch: 1.7321 * SKEW };
    let judge = Judge::new(&oracle, rounding);
    let context = built::context(2);
    let model = Model::open(&context, &file.path).expect("a model");
    let scene = Scene::new(&context);
    for (id, transform) in placements() {
        scene.add_instance(&model, id, transform).expect("an instance");
    }
    scene.commit().expect("a commit");

    let rays = RayMaker::new(&flat.tris, 5).batch(RAYS);
    let wide: Vec<Ray64> = rays.iter().map(|r| r.wide()).collect();
    let world: Vec<Ray> = wide
        .iter()
        .zip(&rays)
        .map(|(w, r)| Ray {
            origin: w.org,
            dir: r.dir,
            t_min: w.t_min,
            t_max: w.t_max,
            cone: Cone::ZERO,
            mask: u32::MAX,
        })
        .collect();
    let ask = |coherent| {
        let mut hits = vec![Hit::MISS; world.len()];
        let options = QueryOptions { coherent, want: Want::ALL, policy: Policy::Exact };
        scene.state().closest(&world, options, &mut hits).expect("hits");
        hits
    };
    let hits = ask(false);
    assert!(hits == ask(true), "packets answer otherwise");
    let mut summary = Summary::default();
    let mut seen = HashMap::new();
    for ((ray, local), hit) in rays.iter().zip(&wide).zip(&hits) {
        let truth = oracle.closest(local);
        let got = (hit.kind != HitKind::Miss).then(|| {
            *seen.entry((hit.instance, hit.part)).or_insert(0) += 1;
            let prim = index.get(&(hit.instance, hit.part, hit.prim)).copied().unwrap_or(u32::MAX);
            Answer {
                stated: Some(f64::from(hit.error)),
                normal: Some(hit.normal.as_dvec3()),
                refined: true,
                ..Answer::new(hit.t, prim)
            }
        });
        let ruling = judge.closest(local, truth, got);
        summary.add(ray.kind.name(), &ruling, || format!("{ray:?}: {hit:?} ({got:?}), oracle {truth:?}"));
        if got.is_some() {
            let position = local.at(hit.t);
            assert!(hit.position.distance(position) <= 1e-12 * (1.0 + position.length()), "{hit:?}");
        }
    }
    summary.assert_clean("instances");
    assert!(summary.count(|v| v == Verdict::Same) * 10 > 8 * summary.total());
    assert!(!seen.keys().any(|(instance, _)| *instance == 5), "what lies on top of another came first");
    // All placements but the tiny one and what is hidden behind others were met.
    assert!(seen.len() >= 30, "{} of 40 placed parts were met", seen.len());
}

fn the_file_itself_says_where_its_triangles_are() {
    let file = build();
    let flat = flatten(&file);
    let placed = placements();
    let instances = placed.iter().map(|(id, m)| stored::Instance { path: &file.path, id: *id, world_from_model: *m });
    let world = stored::world(&instances.collect::<Vec<_>>());
    assert!(world.tris == flat.tris, "other triangles, or in another order");
    let names: Vec<_> = world.names.iter().map(|n| (n.instance, n.part, n.prim)).collect();
    assert!(names == flat.names, "other names");
}

fn placed_triangles_have_their_parts_colours() {
    let colours = [[0.25, 0.5, 1.0], [1.0, 0.0, 0.125]];
    let parts = colours.map(|colour| built::Part {
        id: 1 + (colour[1] * 2.0) as u64,
        material: MaterialDesc { colour, ..built::WHITE },
        tris: scenes::cuboid(-DVec3::ONE, DVec3::ONE),
    });
    let file = built::parts(&parts);
    let here = stored::Instance { path: &file.path, id: 9, world_from_model: DAffine3::IDENTITY };
    let world = stored::world(&[here]);
    assert_eq!(world.names.len(), 24);
    for name in &world.names {
        assert_eq!((name.instance, name.colour), (9, colours[if name.part == 2 { 0 } else { 1 }]));
    }
}

/// Instances and what a commit makes of them count against the budget: more of them are refused, and the scene goes on
/// as it was.
fn instances_count_against_the_budget() {
    let file = built::parts(&[built::Part::white(1, scenes::cuboid(-DVec3::ONE, DVec3::ONE))]);
    let options = ContextOptions { threads: 1, memory_budget: 16 << 20, read_ahead: false, ..Default::default() };
    let context = outcrop::Context::new(options).expect("a context");
    let model = Model::open(&context, &file.path).expect("a model");
    let (scene, before) = (Scene::new(&context), context.memory_used());
    let at = |id: u64| DAffine3::from_translation(DVec3::X * 4.0 * id as f64);
    let add = |from: u64, to: u64| (from..to).try_for_each(|id| scene.add_instance(&model, id, at(id)));
    add(0, 5000).expect("some instances");
    scene.commit().expect("a commit");
    let used = context.memory_used() - before;
    // A transform alone takes 96 bytes, in the draft and in the state, and the world's boxes as much.
    assert!(used > 5000 * 400 && used < 5000 * 2000, "{used} bytes");
    let refused = add(5000, 1_000_000).and_then(|()| scene.commit()).expect_err("too many");
    let Error::OverBudget { need, have, .. } = refused else { panic!("{refused:?}") };
    assert!(need > have && have == 16 << 20, "{need} of {have}");
    assert!(context.memory_used() <= 16 << 20);
    let seen = |id: u64| {
        let mut hit = [Hit::MISS];
        let ray = Ray::new(DVec3::new(4.0 * id as f64 + 0.25, 0.125, -9.0), glam::Vec3::Z);
        scene.state().closest(&[ray], QueryOptions::default(), &mut hit).expect("a hit");
        hit[0].instance
    };
    assert_eq!((seen(0), seen(4999)), (0, 4999));
    (0..4000).for_each(|id| scene.remove_instance(id).expect("one less"));
    drop(model);
}

built::on_each_structure!(
    instances_count_against_the_budget,
    nested_shared_mirrored_squashed_and_tied,
    the_file_itself_says_where_its_triangles_are,
    placed_triangles_have_their_parts_colours,
);
