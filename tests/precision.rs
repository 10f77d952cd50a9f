//! Small things far from each other in one model: each keeps the precision of its surroundings, whichever way the model
//! comes in, and nothing cracks between them.

use crate::common::asked::ask;
use crate::common::brute::{Oracle, Ray64, Tri};
use crate::common::built::{self, Built};
use crate::common::bvh64::Bvh64;
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DQuat, DVec3};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{HitKind, QueryOptions};
use std::fmt::Write;
use std::path::Path;

/// Corner of a comb in the coordinates of a land survey.
const SURVEY: DVec3 = DVec3::new(512345.678, 5412345.678, 412.345);
/// Number of strips of the comb.
const STRIPS: usize = 20;

/// Strip `i` of a comb, as a quad: 10 mm wide and 200 mm long; every other strip is 1 mm higher.
fn strip(i: usize) -> [DVec3; 4] {
    let (x, z) = (0.010 * i as f64, 0.001 * (i % 2) as f64);
    [(x, 0.0), (x + 0.010, 0.0), (x + 0.010, 0.2), (x, 0.2)].map(|(x, y)| DVec3::new(x, y, z))
}

fn quad([a, b, c, d]: [DVec3; 4]) -> [Tri; 2] {
    [[a, b, c], [a, c, d]]
}

/// The triangle that was left behind at `by`.
fn stray(by: DVec3) -> Tri {
    [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| p + by)
}

fn comb_and_stray(by: DVec3) -> Vec<Tri> {
    let strips = (0..STRIPS).flat_map(|i| quad(strip(i).map(|p| p + SURVEY)));
    strips.chain([stray(by)]).collect()
}

fn build_file(file: &Path, options: BuildOptions) -> (Built, BuildReport) {
    built::build_with(options, |builder| builder.add_file(file).expect("a mesh"))
}

/// Checks the heights of the strips, and the stray triangle, of a model of [`comb_and_stray`].
fn check_comb(way: &str, (built, report): &(Built, BuildReport), others: u64, by: DVec3) {
    assert_eq!((report.triangles_in, report.triangles_kept), (others + 41, others + 41), "{way}");
    assert!(report.position_error < 1e-4, "{way}: {}", report.position_error);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, built);
    let above = |p: DVec3| Ray::new(p + DVec3::Z * 3.0, -glam::Vec3::Z);
    let tops: Vec<DVec3> = (0..STRIPS).map(|i| (strip(i)[0] + strip(i)[2]) / 2.0 + SURVEY).collect();
    let mut rays: Vec<Ray> = tops.iter().map(|&p| above(p)).collect();
    rays.push(above(DVec3::new(0.25, 0.25, 0.0) + by));
    let hits = ask(&scene.state(), &rays, QueryOptions::default());
    for (i, (hit, top)) in hits.iter().zip(&tops).enumerate() {
        assert_eq!(hit.kind, HitKind::Exact, "{way}, strip {i}");
        assert!((hit.position - *top).length() < 1e-4, "{way}, strip {i}: {} is not {top}", hit.position);
        assert!(hit.error < 1e-4, "{way}, strip {i}: {}", hit.error);
    }
    assert_eq!(hits[STRIPS].kind, HitKind::Exact, "{way}, stray");
    assert!((hits[STRIPS].position.z - by.z).abs() < 1e-6, "{way}, stray: {}", hits[STRIPS].position);
}

fn push(builder: &mut Builder, tris: &[Tri]) {
    let material = builder.material(MaterialDesc::default()).expect("a material");
    let part = builder.part(PartDesc { material: Some(material), ..PartDesc::default() }).expect("a part");
    builder.triangles(MeshKey::DIRECT, part, tris, Attributes::NONE).expect("triangles");
}

#[test]
fn a_stray_triangle_takes_no_precision_from_pushed_triangles() {
    for (by, trees) in [(DVec3::ZERO, 1), (DVec3::ONE / 3.0, 2)] {
        let built = built::build_with(built::options(), |builder| push(builder, &comb_and_stray(by)));
        check_comb("pushed", &built, 0, by);
        // A triangle that is not exact relative to the comb has a tree of its own, and a note says so.
        assert_eq!((built.1.trees, built.1.instances), (trees, trees - 1));
        assert_eq!(built.1.notes.len() as u64, trees - 1, "{:?}", built.1.notes);
    }
}

/// Other triangles, so many that the model is built in chunks: a terrain of tiles of 2 m at the comb.
#[test]
fn a_stray_triangle_takes_no_precision_out_of_core() {
    let by = DVec3::ONE / 3.0;
    let mut tris = comb_and_stray(by);
    let at =
        |x: usize, y: usize| SURVEY + DVec3::new(x as f64 * 2.0, y as f64 * 2.0, -3.0 + 0.1 * ((x * y) % 7) as f64);
    let tiles = (0..300 * 300).map(|i| (i % 300, i / 300));
    tris.extend(tiles.flat_map(|(x, y)| quad([at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)])));
    let others = tris.len() as u64 - 41;
    let built = |threads| {
        let options = BuildOptions { memory_budget: 32 << 20, threads, ..built::options() };
        built::build_with(options, |builder| push(builder, &tris))
    };
    let [one, two] = [1, 2].map(built);
    check_comb("out of core", &one, others, by);
    assert!(one.1.chunks > 2 && one.1.trees == 2, "{:?}", one.1);
    assert!(std::fs::read(&one.0.path).expect("a file") == std::fs::read(&two.0.path).expect("a file"));
}

#[test]
fn a_stray_triangle_takes_no_precision_from_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut obj = String::new();
    let mut ply = String::from("ply\nformat ascii 1.0\nelement vertex 123\nproperty double x\nproperty double y\n");
    ply += "property double z\nelement face 41\nproperty list uchar int vertex_index\nend_header\n";
    for tri in comb_and_stray(DVec3::ZERO) {
        for p in tri {
            writeln!(obj, "v {:.3} {:.3} {:.3}", p.x, p.y, p.z).expect("text");
            writeln!(ply, "{:.3} {:.3} {:.3}", p.x, p.y, p.z).expect("text");
        }
        obj += "f -3 -2 -1\n";
    }
    let grouped = obj.replace("v 0.000 0.000 0.000\n", "g stray\nv 0.000 0.000 0.000\n");
    (0..41).for_each(|i| writeln!(ply, "3 {} {} {}", 3 * i, 3 * i + 1, 3 * i + 2).expect("text"));
    // A mesh of single precision that a node moves to the survey's coordinates, and one that stays at zero.
    let floats: Vec<u8> = (0..STRIPS)
        .flat_map(|i| quad(strip(i)))
        .chain([stray(DVec3::ZERO)])
        .flatten()
        .flat_map(|p| p.as_vec3().to_array())
        .flat_map(f32::to_le_bytes)
        .collect();
    let accessor = |from: usize, count: usize| {
        format!(
            r#"{{"bufferView":0,"byteOffset":{},"componentType":5126,"count":{count},"type":"VEC3","min":[0,0,0],"max":[1,1,1]}}"#,
            12 * from
        )
    };
    let gltf = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],
        "nodes":[{{"mesh":0,"translation":[{},{},{}]}},{{"mesh":1}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}},{{"primitives":[{{"attributes":{{"POSITION":1}}}}]}}],
        "accessors":[{},{}],"bufferViews":[{{"buffer":0,"byteLength":{length}}}],
        "buffers":[{{"uri":"comb.bin","byteLength":{length}}}]}}"#,
        SURVEY.x,
        SURVEY.y,
        SURVEY.z,
        accessor(0, 120),
        accessor(120, 3),
        length = floats.len(),
    );
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("a file");
    write("comb.bin", &floats);
    for (name, text) in [("comb.obj", obj), ("grouped.obj", grouped), ("comb.ply", ply), ("comb.gltf", gltf)] {
        write(name, text.as_bytes());
        check_comb(name, &build_file(&folder.path().join(name), built::options()), 0, DVec3::ZERO);
    }
}

/// Compares rays near `center` with the input in double precision.
fn check_near(way: &str, scene: &outcrop::scene::Scene, oracle: &Bvh64, center: DVec3, radius: f64) {
    let mut rng = Rng::new(11);
    let rays: Vec<Ray> = (0..4000)
        .map(|_| {
            let from = center + rng.direction() * radius * 3.0;
            let to = center + rng.direction() * radius * rng.unit();
            Ray::new(from, (to - from).as_vec3())
        })
        .collect();
    let (mut met, mut wrong) = (0, 0);
    for (ray, hit) in rays.iter().zip(ask(&scene.state(), &rays, QueryOptions::default())) {
        let wide = Ray64 { org: ray.origin, dir: ray.dir.as_dvec3(), t_min: 0.0, t_max: f64::INFINITY };
        let truth = oracle.closest(&wide);
        met += u32::from(truth.is_some());
        let is_right = match truth {
            // Behind it, something larger.
            Some(truth) if wide.at(truth.t).distance(center) > radius * 9.0 => hit.kind == HitKind::Exact,
            Some(truth) => (wide.at(truth.t) - hit.position).length() < radius * 1e-3,
            None => hit.kind == HitKind::Miss,
        };
        wrong += u32::from(!is_right);
    }
    println!("{way}: {met} of 4000 rays hit, {wrong} wrong");
    // Rays that graze an edge may be answered either way.
    assert!(met > 2000 && wrong <= 4, "{way}: {met}, {wrong}");
}

/// A sphere of 1 mm, of 4,000 triangles, on a plain of 100 km that 20,000 triangles cover.
#[test]
fn a_bolt_on_a_wide_plain_keeps_its_shape() {
    let center = DVec3::new(31234.5671, -20123.4567, 0.0011);
    let bolt: Vec<Tri> = scenes::bumpy_sphere(40, 50, 1).into_iter().map(|t| t.map(|p| p * 0.001 + center)).collect();
    let at = |i: usize, j: usize| DVec3::new(i as f64 * 1000.1 - 50_000.0, j as f64 * 1000.1 - 50_000.0, -0.0123);
    let tiles = (0..100 * 100).map(|i| (i % 100, i / 100));
    let plain = tiles.flat_map(|(i, j)| quad([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]));
    let tris: Vec<Tri> = plain.chain(bolt).collect();
    let (built, report) = built::build_with(built::options(), |builder| push(builder, &tris));
    assert_eq!(report.triangles_kept, tris.len() as u64);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    let oracle = Bvh64::new(tris);
    check_near("bolt", &scene, &oracle, center, 0.001);
    check_near("plain", &scene, &oracle, DVec3::new(-30_000.0, 10_000.0, 0.0), 5000.0);
}

/// 120 triangles, each half as large as the one before, side by side.
#[test]
fn triangles_of_all_sizes_survive() {
    // Thirds are exact in no precision.
    let size = |k: i32| 2f64.powi(-k) / 3.0;
    let tris: Vec<Tri> = (0..120)
        .map(|k| {
            let at = DVec3::X * size(k);
            [at, at + DVec3::X * size(k + 1), at + DVec3::Y * size(k + 1)]
        })
        .collect();
    let (built, report) = built::build_with(built::options(), |builder| push(builder, &tris));
    assert_eq!((report.triangles_kept, report.trees), (120, 1));
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    for (k, tri) in tris.iter().enumerate().take(100) {
        let middle = (tri[0] + tri[1] + tri[2]) / 3.0;
        let hit = ask(
            &scene.state(),
            &[Ray::new(middle + DVec3::Z * size(k as i32), -glam::Vec3::Z)],
            QueryOptions::default(),
        );
        assert_eq!((hit[0].kind, hit[0].prim), (HitKind::Exact, k as u64), "triangle {k}");
    }
}

/// A closed sheet of 100 km with two places, far apart, at which its triangles shrink to millimetres: it is divided
/// into trees, and rays at its vertices and edges find no gap between them.
#[test]
fn nothing_cracks_between_trees() {
    let places = [DVec3::new(-30123.4567, 20456.789, 0.0), DVec3::new(28765.4321, -15432.1098, 0.0)];
    let lines = |axis: usize| {
        let mut all: Vec<f64> = places
            .iter()
            .flat_map(|p| (0..27).flat_map(move |k| [-1.0, 1.0].map(|side| p[axis] + side * 50_000.0 * 0.5f64.powi(k))))
            .filter(|x| x.abs() <= 50_000.0)
            .chain([-50_000.0, 50_000.0])
            .collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    };
    let (xs, ys) = (lines(0), lines(1));
    let turn = DQuat::from_rotation_x(0.3);
    let at = |i: usize, j: usize| turn * DVec3::new(xs[i], ys[j], (xs[i] * 3e-4).sin() * 50.0);
    let cells = || (0..xs.len() - 1).flat_map(|i| (0..ys.len() - 1).map(move |j| (i, j)));
    let tris: Vec<Tri> =
        cells().flat_map(|(i, j)| quad([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])).collect();
    let (built, report) = built::build_with(built::options(), |builder| push(builder, &tris));
    assert!(report.trees > 1, "the sheet is divided");
    // Triangles that are 65,536 times longer than wide may lose their area.
    assert_eq!(report.triangles_kept + report.degenerate, tris.len() as u64);
    assert!(report.degenerate < 500, "{}", report.degenerate);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    let mut rng = Rng::new(5);
    let mut rays = Vec::new();
    for (i, j) in cells().filter(|(i, j)| (1..xs.len() - 2).contains(i) && (1..ys.len() - 2).contains(j)) {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        let size = (a - c).length();
        let u = rng.unit();
        for to in [a, a.lerp(b, u), a.lerp(c, u), a.lerp(d, u)] {
            let from = to + turn * DVec3::Z * size * 0.1 + rng.direction() * size * 0.02;
            rays.push(Ray::new(from, (to - from).as_vec3()));
        }
    }
    check_positions("sheet", &scene, &Bvh64::new(tris), &rays, report.position_error);
    println!("{} trees", report.trees);
}

/// Compares rays with the input in double precision: none misses, and the hits are as near to the input's as the
/// greatest move of a corner allows.
fn check_positions(way: &str, scene: &outcrop::scene::Scene, oracle: &Bvh64, rays: &[Ray], most: f64) {
    let hits = ask(&scene.state(), rays, QueryOptions::default());
    let (mut missed, mut worst) = (0, 0.0f64);
    for (ray, hit) in rays.iter().zip(hits) {
        let wide = Ray64 { org: ray.origin, dir: ray.dir.as_dvec3(), t_min: 0.0, t_max: f64::INFINITY };
        let Some(truth) = oracle.closest(&wide) else { continue };
        match hit.kind {
            HitKind::Miss => missed += 1,
            _ => worst = worst.max((wide.at(truth.t) - hit.position).length()),
        }
    }
    println!("{way}: {} rays, {missed} missed, off by at most {worst:e}, corners moved by {most:e}", rays.len());
    assert!(missed == 0 && worst <= most, "{way}: {missed}, {worst:e}");
}

/// A place on a slope of 45 degrees: a cone of `n` triangles, `radius` high, on a hole of the ground around it, which
/// reaches to `ground(direction)`.
fn cone(n: usize, center: DVec3, radius: f64, ground: impl Fn(DVec3) -> DVec3) -> [Vec<Tri>; 2] {
    let around = |i: usize| {
        let angle = std::f64::consts::TAU * (i % n) as f64 / n as f64;
        DVec3::new(angle.cos(), angle.sin(), angle.cos())
    };
    let (near, far) = (|i| center + around(i) * radius, |i| center + ground(around(i)));
    let top = center + DVec3::Z * radius;
    let cone = (0..n).map(|i| [near(i), near(i + 1), top]).collect();
    let slope = (0..n).flat_map(|i| [[near(i), far(i), far(i + 1)], [near(i), far(i + 1), near(i + 1)]]).collect();
    [cone, slope]
}

/// Large triangles that overlap each other, above each other, far below zero.
fn layers(count: usize) -> Vec<Tri> {
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * 5e4;
    let layer = |i: usize| {
        let [low, high] = [-100.0 - 0.1 * i as f64, 400.0 - 0.1 * i as f64].map(|z| z / 5e4);
        quad([at(-1.0, -1.0, low), at(1.0, -1.0, low), at(1.0, 1.0, high), at(-1.0, 1.0, high)])
    };
    (0..count).flat_map(layer).collect()
}

fn rays_down(center: DVec3, radius: f64) -> Vec<Ray> {
    let mut rng = Rng::new(3);
    let to = (0..300).map(|_| center + DVec3::new(rng.unit() - 0.5, rng.unit() - 0.5, 0.0) * radius * 1.2);
    to.map(|to| Ray::new(to + DVec3::Z, -glam::Vec3::Z)).collect()
}

/// A cone of 1 mm in the ground, 41 km from the middle: the ground's triangles at it, which are 4 km long, do not hide
/// it although their other ends are in another tree.
#[test]
fn a_slope_hides_nothing_of_a_detail_in_it() {
    let center = DVec3::new(41234.56747, 40123.45691, 10.00121);
    let [cone, slope] = cone(70, center, 0.001, |to| to * 4000.0);
    let tris: Vec<Tri> = layers(3000).into_iter().chain(slope).chain(cone).collect();
    let (built, report) = built::build_with(built::options(), |builder| push(builder, &tris));
    assert_eq!((report.triangles_kept, report.trees), (tris.len() as u64, 2), "{:?}", report.notes);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    check_positions("cone", &scene, &Bvh64::new(tris), &rays_down(center, 0.001), 1e-6);
}

/// Two cones of 1 mm, 57 km apart, whose triangles of the ground reach from one to the other: each cone is seen.
#[test]
fn triangles_that_span_two_details_hide_neither() {
    let centers = [DVec3::new(20234.56747, 20123.45691, 10.00121), DVec3::new(-20345.67891, -20456.78912, -3.00567)];
    let (n, radius) = (64, 0.001);
    let [one, slope] = cone(n, centers[0], radius, |to| {
        // The half that looks to the other cone reaches it.
        if to.x + to.y < -0.5 { centers[1] - centers[0] + DVec3::new(to.x, to.y, to.x) * radius } else { to * 4000.0 }
    });
    let [two, _] = cone(n, centers[1], radius, |to| to);
    let spans = |t: &Tri| (0..3).any(|i| t[i].distance(t[(i + 1) % 3]) > 4e4);
    assert!(slope.iter().filter(|t| spans(t)).count() > 20);
    let tris: Vec<Tri> = layers(1500).into_iter().chain(slope).chain(one).chain(two).collect();
    let (built, report) = built::build_with(built::options(), |builder| push(builder, &tris));
    assert!(report.trees >= 2, "{:?}", report.notes);
    assert_eq!(report.triangles_kept + report.degenerate, tris.len() as u64);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    let oracle = Bvh64::new(tris);
    for center in centers {
        check_positions("spanned cone", &scene, &oracle, &rays_down(center, radius), 1e-5);
    }
}

/// A cube of 12 triangles among larger ones whose boxes contain it, but that pass it by.
#[test]
fn a_few_small_triangles_are_a_detail_if_nothing_crosses_them() {
    let corner = DVec3::new(41234.5671, 40123.4567, 10.0011);
    let at = |x: u32, y: u32, z: u32| corner + DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * 0.001;
    let faces = [0, 1].into_iter().flat_map(|k| {
        [
            [at(0, 0, k), at(1, 0, k), at(1, 1, k), at(0, 1, k)],
            [at(0, k, 0), at(1, k, 0), at(1, k, 1), at(0, k, 1)],
            [at(k, 0, 0), at(k, 1, 0), at(k, 1, 1), at(k, 0, 1)],
        ]
    });
    let tris: Vec<Tri> = layers(2000).into_iter().chain(faces.flat_map(quad)).collect();
    let (built, report) = built::build_with(built::options(), |builder| push(builder, &tris));
    assert_eq!((report.triangles_kept, report.trees), (4012, 2), "{:?}", report.notes);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    let middle = corner + DVec3::splat(0.0005);
    check_positions("cube", &scene, &Bvh64::new(tris), &rays_down(middle, 0.0006), 1e-6);
}

/// Details at 254 places on a terrain: as many trees, and the input's shape everywhere. With any number of threads and
/// any budget, the same triangles are in them.
#[test]
fn many_details_have_a_tree_each() {
    let mut rng = Rng::new(3);
    let at = |i: usize, j: usize| {
        let (x, y) = (i as f64 * 1000.0 - 50_000.0 + 0.123456789, j as f64 * 1000.0 - 50_000.0 + 0.123456789);
        DVec3::new(x, y, (x * 3e-4).sin() * 50.0)
    };
    let tiles = (0..100 * 100).map(|i| (i % 100, i / 100));
    let mut tris: Vec<Tri> =
        tiles.flat_map(|(i, j)| quad([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])).collect();
    let sphere = scenes::bumpy_sphere(6, 8, 1);
    let centers: Vec<DVec3> =
        (0..254).map(|_| DVec3::new(rng.unit() - 0.5, rng.unit() - 0.5, 0.0) * 9e4 + DVec3::Z * 200.0).collect();
    tris.extend(centers.iter().flat_map(|&c| sphere.iter().map(move |t| t.map(|p| p * 0.001 + c))));
    let build = |threads, memory_budget| {
        let options = BuildOptions { threads, memory_budget, ..built::options() };
        built::build_with(options, |builder| push(builder, &tris))
    };
    let (built, report) = build(2, 0);
    println!("{:?}", report.seconds);
    assert_eq!(report.triangles_kept, tris.len() as u64);
    assert!((254..=255).contains(&report.trees) && report.notes.len() == 1, "{:?}", report);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    let oracle = Bvh64::new(tris.clone());
    for &center in centers.iter().step_by(25) {
        check_near("one of many", &scene, &oracle, center, 0.001);
    }
    let one = build(1, 0);
    assert!(std::fs::read(&one.0.path).expect("a file") == std::fs::read(&built.path).expect("a file"));
    let small = build(2, 32 << 20).1;
    assert_eq!((small.triangles_kept, small.trees), (report.triangles_kept, report.trees));
}

/// Tiny triangles at more places than a model has trees for: the build says which of them lose their shape.
#[test]
fn a_build_says_what_it_could_not_resolve() {
    let places = |count: u32| -> Vec<Tri> {
        let at = |i: u32| DVec3::new(f64::from(i), 1.0, 0.0) * 1e7 / 3.0;
        (0..count).map(|i| stray(DVec3::ZERO).map(|p| p * 0.003 + at(i))).collect()
    };
    let report = |tris: Vec<Tri>| built::build_with(built::options(), |builder| push(builder, &tris)).1;
    let few = report(places(200));
    assert_eq!((few.triangles_kept, few.trees, few.notes.len()), (200, 200, 1), "{:?}", few.notes);
    assert!(few.position_error < 1e-6, "{}", few.position_error);
    let many = report(places(300));
    assert_eq!((many.triangles_in, many.trees, many.notes.len()), (300, 256, 2), "{:?}", many.notes);
    assert!(many.notes[1].starts_with("44 triangles are so small"), "{:?}", many.notes);
    assert_eq!(many.triangles_kept + many.degenerate, 300);
    assert!(many.triangles_kept >= 256, "{}", many.triangles_kept);
}

/// A terrain of 100 km with decimals of millimetres, which single precision does not hold: a note says so. A smaller
/// one keeps its digits.
#[test]
fn a_build_says_that_positions_lost_digits_of_the_input() {
    let report = |tile: f64| {
        let round = |x: f64| (x * 1000.0).round() / 1000.0;
        let at = |i: usize, j: usize| {
            let (x, y) = (512345.678 + i as f64 * tile, 5412345.678 + j as f64 * tile);
            DVec3::new(round(x), round(y), round(412.345 + ((i * j) as f64).sin()))
        };
        let tiles = (0..100 * 100).map(|i| (i % 100, i / 100));
        let tris: Vec<Tri> =
            tiles.flat_map(|(i, j)| quad([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])).collect();
        built::build_with(built::options(), |builder| push(builder, &tris)).1
    };
    let large = report(1000.123);
    assert!(large.position_error > 0.002, "{}", large.position_error);
    assert_eq!(large.notes.len(), 1, "{:?}", large.notes);
    assert!(large.notes[0].contains("input's digits (multiples of 0.001)"), "{:?}", large.notes);
    let small = report(10.123);
    assert!(small.position_error < 0.0005 && small.notes.is_empty(), "{small:?}");
}

/// Tiny triangles on a sphere of larger ones, as scans have them, do not divide it.
#[test]
fn small_triangles_among_large_ones_stay() {
    let sphere: Vec<Tri> = scenes::bumpy_sphere(100, 150, 3).into_iter().map(|t| t.map(|p| p / 3.0)).collect();
    let tiny = sphere.iter().step_by(100).map(|t| stray(DVec3::ZERO).map(|p| t[0] + p * 1e-7));
    let tris: Vec<Tri> = sphere.iter().copied().chain(tiny).collect();
    let report = built::build_with(built::options(), |builder| push(builder, &tris)).1;
    assert_eq!((report.trees, report.notes.len()), (1, 1), "{:?}", report.notes);
    assert_eq!(report.triangles_kept + report.degenerate, tris.len() as u64);
    assert!(report.triangles_kept >= sphere.len() as u64);
}
