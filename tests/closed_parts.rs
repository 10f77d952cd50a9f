//! Closed parts, in models that are assembled, divided into trees, built out of core, cold, or of a CAD system: the
//! flags of parts, and crossings that are even.

use crate::common::asked::ask;
use crate::common::brute::{self, Ray64, Tri};
use crate::common::built::{self, Part};
use crate::common::closed::twelve;
use crate::common::rng::Rng;
use crate::common::{models, scenes};
use glam::{DAffine3, DQuat, DVec3};
use outcrop::Error;
use outcrop::base::progress::Cancel;
use outcrop::build::BuildOptions;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::{DBounds, Ray};
use outcrop::query::{Crossing, HitKind, PartAt, PartOverlap, Policy, QueryOptions, Side, StoredTriangle};
use outcrop::scene::{Context, ContextOptions, Look, Model, Scene, SceneState};
use std::collections::BTreeMap;

/// The crossings of a ray, and whether they are complete.
type Answer = (Vec<Crossing>, bool);

/// The crossings of each ray.
fn crossings(scene: &SceneState, rays: &[Ray], policy: Policy) -> Vec<Answer> {
    let mut found = Vec::new();
    scene
        .crossings(&rays, policy, &mut |_, all, is_complete| found.push((all.to_vec(), is_complete)))
        .expect("crossings");
    found
}

/// Fails unless rays enter the closed parts as often as they leave them. Returns the number of crossings of these.
fn check_even(scene: &SceneState, models: &[(u64, &Model)], rays: &[Ray]) -> usize {
    let mut count = 0;
    for (ray, (all, _)) in rays.iter().zip(crossings(scene, rays, Policy::Exact)) {
        let mut parts = BTreeMap::<(u64, u64), [u32; 2]>::new();
        all.iter().for_each(|c| parts.entry((c.instance, c.part)).or_default()[usize::from(c.side == Side::Back)] += 1);
        for ((instance, part), [front, back]) in parts {
            let model = models.iter().find(|m| m.0 == instance).expect("an instance").1;
            let info = model.parts().get(model.part_index(part).expect("a part") as usize).expect("a part");
            assert!(!info.is_closed || (front + back) % 2 == 0, "{ray:?}, part {part}: {front} and {back}");
            assert!(!info.is_oriented || front == back, "{ray:?}, part {part}: {front} and {back}");
            count += if info.is_closed { (front + back) as usize } else { 0 };
        }
    }
    count
}

/// Rays from outside towards corners, edges and insides of triangles.
fn rays_to(tris: &[Tri], count: usize, far: f64) -> Vec<Ray> {
    let mut rng = Rng::new(count as u64);
    let mut one = || {
        let [a, b, c] = tris[rng.below(tris.len())];
        let to = [a, a.lerp(b, 0.5), a.lerp(b, rng.unit()), (a + b + c) / 3.0][rng.below(4)];
        let from = rng.direction() * far;
        Ray::new(to + from, -from.as_vec3())
    };
    (0..count).map(|_| one()).collect()
}

/// A ball whose halves are two meshes, which one part joins; the same halves apart; all turned, mirrored and stretched.
#[test]
fn halves_of_an_assembly_are_closed_where_they_meet() {
    let ball = scenes::bumpy_sphere(12, 20, 3);
    let (low, high) = ball.split_at(ball.len() / 2);
    let turned = DAffine3::from_scale_rotation_translation(
        DVec3::new(2.0, -1.0, 0.5),
        DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(1.0),
        DVec3::new(3.0, 0.1, 0.7),
    );
    let moved = DAffine3::from_translation(DVec3::X * 9.0);
    let file = built::build(|builder| {
        for id in 0..3 {
            builder.part(PartDesc { id: Some(id), ..Default::default() }).expect("a part");
        }
        for (half, places) in [(low, [turned, moved]), (high, [turned, moved * turned])] {
            let mesh = builder.shared_mesh(1).expect("a mesh");
            builder.triangles(mesh, 0, half, Attributes::NONE).expect("triangles");
            for (part, place) in places.into_iter().enumerate() {
                builder.instance(mesh, place, part as u32).expect("an instance");
            }
        }
        builder.triangles(MeshKey::DIRECT, 2, &ball, Attributes::NONE).expect("triangles");
    });
    let context = built::context(2);
    let model = Model::open(&context, &file.path).expect("a model");
    let flags: Vec<_> = model.parts().iter().map(|part| (part.is_closed, part.is_oriented)).collect();
    assert_eq!(flags, [(true, true), (false, false), (true, true)]);
    let place = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.7), DVec3::new(1e4, 0.0, 2e5)) * turned;
    let scene = Scene::new(&context);
    scene.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
    scene.add_instance(&model, 2, place).expect("an instance");
    scene.commit().expect("a commit");
    let all = [DAffine3::IDENTITY, turned, place, place * turned];
    let tris: Vec<Tri> = all.iter().flat_map(|m| ball.iter().map(|t| t.map(|p| m.transform_point3(p)))).collect();
    let found = check_even(&scene.state(), &[(1, &model), (2, &model)], &rays_to(&tris, 4000, 30.0));
    assert!(found > 4000, "{found}");
}

/// A sheet of 100 km whose triangles shrink to millimetres at two places, closed below by a fan. (With two such places
/// some triangles span both, no tree has all of their corners in place, and the part is not closed.)
#[test]
fn a_part_that_is_divided_into_trees_keeps_its_word() {
    let places = [DVec3::new(-30123.4567, 20456.789, 0.0), DVec3::new(28765.4321, -15432.1098, 0.0)];
    let lines = |axis: usize| {
        let near = |p: &DVec3| {
            let at = p[axis];
            (2..27).flat_map(move |k| [-1.0, 1.0].map(|side| at + side * 50_000.0 * 0.5f64.powi(k)))
        };
        let mut all: Vec<f64> = places.iter().flat_map(near).chain([-50_000.0, 50_000.0]).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    };
    let (xs, ys) = (lines(0), lines(1));
    let at = |i: usize, j: usize| DVec3::new(xs[i], ys[j], (xs[i] * 3e-4).sin() * 50.0);
    let (wide, high) = (xs.len() - 1, ys.len() - 1);
    let cells = (0..wide).flat_map(|i| (0..high).map(move |j| (i, j)));
    let mut tris: Vec<Tri> = cells
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let apex = DVec3::Z * -9000.0;
    let rows = (0..wide).flat_map(|i| [[at(i + 1, 0), at(i, 0), apex], [at(i, high), at(i + 1, high), apex]]);
    let columns = (0..high).flat_map(|j| [[at(0, j), at(0, j + 1), apex], [at(wide, j + 1), at(wide, j), apex]]);
    tris.extend(rows.chain(columns));
    let context = built::context(2);
    let (file, report) = built::build_with(BuildOptions { threads: 1, ..built::options() }, |builder| {
        built::push(builder, &Part::white(1, tris.clone()));
    });
    assert!(report.trees > 1, "the sheet is divided");
    let (scene, model) = built::scene(&context, &file);
    let info = model.parts().get(0).expect("a part");
    println!("{} trees, closed: {}", report.trees, info.is_closed);
    check_even(&scene.state(), &[(7, &model)], &rays_to(&tris, 6000, 1e5));
    // From near by, where rays meet the small triangles.
    let rays: Vec<Ray> = rays_to(&tris, 6000, 0.1)
        .into_iter()
        .map(|r| Ray { origin: r.origin + DVec3::Z * 1e5, dir: -glam::Vec3::Z, ..r })
        .collect();
    check_even(&scene.state(), &[(7, &model)], &rays);
}

/// The flags do not depend on the memory of the build: triangles in chunks, and dropped ones, count alike.
#[test]
fn a_part_that_is_built_in_chunks_is_closed() {
    let cube = |i: usize| {
        let low = DVec3::new((i % 25) as f64, (i / 25 % 25) as f64, (i / 625) as f64) * 1.5;
        scenes::cuboid(low, low + 1.0)
    };
    let flags = |memory_budget, opens: bool| {
        let (file, report) = built::build_with(BuildOptions { threads: 2, memory_budget, ..built::options() }, |to| {
            let part = to.part(PartDesc::default()).expect("a part");
            let mut push =
                |tris: &[Tri]| to.triangles(MeshKey::DIRECT, part, tris, Attributes::NONE).expect("triangles");
            (0..12_500).for_each(|i| push(&cube(i)));
            // One without area has no border, one with area has.
            push(&[[DVec3::ZERO, DVec3::X, DVec3::X]]);
            push(&[[DVec3::ZERO, DVec3::X, DVec3::Y]][..usize::from(opens)]);
        });
        let model = Model::open(&built::context(1), &file.path).expect("a model");
        let part = model.parts().get(0).expect("a part");
        (part.is_closed, part.is_oriented, report.chunks > 1)
    };
    assert_eq!(flags(0, false), (true, true, false));
    assert_eq!(flags(32 << 20, false), (true, true, true));
    assert_eq!(flags(32 << 20, true), (false, false, true));
}

/// The answers to the other questions that visit trees: parts that meet a box, parts at points, and thicknesses.
type Others = (Vec<PartOverlap>, Vec<Vec<PartAt>>, Vec<f64>);

fn others(scene: &SceneState, rays: &[Ray]) -> Others {
    let bounds = scene.bounds();
    let met = scene.overlap_box(&DBounds { max: bounds.center(), ..bounds }).expect("parts");
    let mut at = Vec::new();
    let points: Vec<DVec3> = rays.iter().map(|ray| ray.origin + ray.dir.as_dvec3() * 1.01).collect();
    scene.parts_at(&points, &mut |_, parts| at.push(parts.to_vec())).expect("parts");
    let hits = ask(scene, rays, QueryOptions::default());
    (met, at, scene.thickness(&hits).expect("thicknesses"))
}

/// Rays that lack blocks: the same answer in any budget, the least one included, or an incomplete one at once.
#[test]
fn cold_models_give_the_same_crossings() {
    let closed = twelve().into_iter().find(|closed| closed.name == "mandelbulb").expect("a model");
    let whole: Vec<Tri> = (0..12)
        .flat_map(|i| {
            closed
                .part(0)
                .into_iter()
                .map(move |t| t.map(|p| p + DVec3::X * f64::from(i % 4) * 7.0 + DVec3::Y * f64::from(i / 4) * 7.0))
        })
        .collect();
    let file = built::parts(&[Part::white(1, whole.clone())]);
    let rays = rays_to(&whole, 600, 50.0);
    let (scene, _) = built::scene(&built::context(2), &file);
    let expected = crossings(&scene.state(), &rays, Policy::Exact);
    let others_expected = others(&scene.state(), &rays);
    assert!(others_expected.1.iter().flatten().count() > 20 && others_expected.2.iter().any(|t| t.is_finite()));
    let small = Context::new(ContextOptions { memory_budget: 1 << 16, ..Default::default() }).expect("a context");
    let Err(Error::OverBudget { need: least, .. }) = Model::open_cold(&small, &file.path) else { panic!("too small") };
    for budget in [0, least] {
        for threads in [0, 1, 2] {
            let options = ContextOptions { threads, memory_budget: budget, read_ahead: false, ..Default::default() };
            let context = Context::new(options).expect("a context");
            let model = Model::open_cold(&context, &file.path).expect("a model");
            let scene = Scene::new(&context);
            scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
            scene.commit().expect("a commit");
            let now = crossings(&scene.state(), &rays, Policy::Now);
            let is_short = |(now, all): (&Answer, &Answer)| {
                let known = |c: &Crossing| all.0.iter().any(|all| all.t == c.t && all.side == c.side);
                assert!(now.0.iter().all(known) && (!now.1 || now == all));
                assert!(now.0.iter().all(|c| (c.kind == HitKind::Missing) == (c.prim == outcrop::query::NONE)));
                !now.1
            };
            assert!(now.iter().zip(&expected).filter(|both| is_short(*both)).count() > 200);
            assert!(crossings(&scene.state(), &rays, Policy::Exact) == expected, "{budget}, {threads}");
            assert!(others(&scene.state(), &rays) == others_expected, "{budget}, {threads}");
        }
    }
}

#[test]
fn intervals_masks_and_looks_are_those_of_hits() {
    let closed = twelve().into_iter().find(|closed| closed.name == "nested boxes").expect("a model");
    let file = built::parts(&(0..3).map(|i| Part::white(u64::from(i), closed.part(i))).collect::<Vec<_>>());
    let (scene, model) = built::scene(&built::context(1), &file);
    let count = |ray: &Ray| crossings(&scene.state(), &[*ray], Policy::Exact)[0].0.len();
    let ray = Ray::new(DVec3::new(-9.0, 0.1, 0.2), glam::Vec3::X * 2.0);
    assert_eq!(count(&ray), 6);
    let interval = |t_min, t_max| Ray { t_min, t_max, ..ray };
    let inside = [(2.5, 6.5), (2.51, 6.49), (-1.0, 2.5), (2.6, 2.6), (3.0, 2.0), (f64::NAN, 9.0), (0.0, f64::NAN)];
    assert_eq!(inside.map(|(a, b)| count(&interval(a, b))), [6, 4, 1, 0, 0, 0, 0]);
    let bad = [DVec3::NAN, DVec3::INFINITY].map(|origin| count(&Ray { origin, ..ray }));
    assert_eq!(bad, [0, 0]);
    assert_eq!([0.0, f32::NAN, 1e-40].map(|x| count(&Ray { dir: glam::Vec3::X * x, ..ray })), [0; 3]);
    scene.set_instance_mask(7, 2).expect("a mask");
    scene.add_instance(&model, 8, DAffine3::from_translation(DVec3::Y * 0.01)).expect("an instance");
    scene.set_part_look(8, 1, Look { visible: false, ..Look::default() }).expect("a look");
    scene.set_instance_mask(8, 4).expect("a mask");
    scene.commit().expect("a commit");
    assert_eq!([1, 2, 4, 6, 0].map(|mask| count(&Ray { mask, ..ray })), [0, 6, 4, 10, 0]);
    // Two instances in one place: all surfaces twice, ordered by instance.
    scene.set_transform(8, DAffine3::IDENTITY).expect("a transform");
    scene.clear_part_looks(8).expect("looks");
    scene.commit().expect("a commit");
    let both = &crossings(&scene.state(), &[ray], Policy::Exact)[0].0;
    let keys: Vec<_> = both.iter().map(|c| (c.t, c.part, c.instance)).collect();
    assert!(
        keys.len() == 12 && keys.is_sorted() && keys.chunks(2).all(|two| two[0].2 == 7 && two[1].2 == 8),
        "{keys:?}"
    );
}

/// Many coincident surfaces: all are found, and too many for the budget are an error that names one that suffices.
#[test]
fn crossings_stay_in_the_budget() {
    let tri = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let file = built::parts(&[Part::white(1, vec![tri; 20_000])]);
    let rays = vec![Ray::new(DVec3::new(0.2, 0.2, 1.0), glam::Vec3::NEG_Z); 20];
    let ask = |memory_budget| {
        let context = Context::new(ContextOptions { memory_budget, ..Default::default() }).expect("a context");
        let (scene, _) = built::scene(&context, &file);
        let mut counts = Vec::new();
        let result = scene.state().crossings(&&rays[..], Policy::Exact, &mut |_, all, _| {
            assert!(all.windows(2).all(|w| w[0].prim < w[1].prim));
            counts.push(all.len());
        });
        result.map(|()| counts)
    };
    let Err(Error::OverBudget { need, have, .. }) = ask(6 << 20) else { panic!("a budget too small") };
    assert!(need > have && need < 20 << 20, "{need}");
    assert_eq!(ask(need).expect("the budget that was named"), [20_000; 20]);
}

/// The assembly that the issue names: stepping from hit to hit lost coincident faces of it.
#[test]
fn an_assembly_of_a_cad_system_is_crossed_evenly() {
    let Some(path) = models::find("cad/as1_assembly.glb") else { return };
    let (file, _) = built::build_with(built::options(), |builder| builder.add_file(&path).expect("a mesh"));
    let (scene, model) = built::scene(&built::context(2), &file);
    let closed = model.parts().iter().filter(|part| part.is_closed).count();
    let with_triangles = model.parts().iter().filter(|part| part.triangles > 0).count();
    println!("{closed} of {with_triangles} parts are closed");
    assert!(closed > 0);
    let mut rng = Rng::new(1);
    let bounds = model.info().bounds;
    let rays: Vec<Ray> = (0..3000)
        .map(|i| {
            let to = rng.inside(bounds.min, bounds.max).round();
            let dir = if i % 2 == 0 { DVec3::AXES[i % 3] } else { rng.direction() };
            Ray::new(to - dir * 1000.0, dir.as_vec3())
        })
        .collect();
    assert!(check_even(&scene.state(), &[(7, &model)], &rays) > 1000);
    let found = crossings(&scene.state(), &rays, Policy::Exact);
    let stepped = hits_in_steps(&scene.state(), &rays);
    let other = found.iter().zip(&stepped).filter(|(found, stepped)| (found.0.len() + **stepped) % 2 == 1).count();
    let met = found.iter().filter(|found| !found.0.is_empty()).count();
    println!("{met} rays cross the assembly; stepping from hit to hit has another parity in {other}");
    assert!(other > 0, "stepping loses coincident faces");
}

/// Numbers of the hits of each ray, each of which is traced again from behind its last hit.
fn hits_in_steps(scene: &SceneState, rays: &[Ray]) -> Vec<usize> {
    let mut counts = vec![0; rays.len()];
    let mut left: Vec<(usize, Ray)> = rays.iter().copied().enumerate().collect();
    while !left.is_empty() {
        let now: Vec<Ray> = left.iter().map(|it| it.1).collect();
        let hits = ask(scene, &now, QueryOptions::default());
        for ((i, ray), hit) in left.iter_mut().zip(&hits) {
            counts[*i] += usize::from(hit.kind == HitKind::Exact);
            ray.t_min = if hit.kind == HitKind::Exact { hit.t.next_up() } else { f64::NAN };
        }
        left.retain(|(_, ray)| ray.t_min.is_finite());
    }
    counts
}

/// The generated soup of triangles: no part is closed, and thicknesses are those of brute force.
#[test]
fn parts_of_a_soup_are_not_closed() {
    let size = GenerateOptions { triangles: 200_000, seed: 0, ..Default::default() };
    let file = built::build(|to| {
        generate("airliner", &size, &Cancel::new(), to).expect("triangles");
    });
    let (scene, model) = built::scene(&built::context(2), &file);
    let flags: Vec<_> = model.parts().iter().map(|part| (part.is_closed, part.triangles)).collect();
    let of = |closed: bool| flags.iter().filter(|(is, triangles)| *is == closed && *triangles > 0).count();
    println!("{} parts of {} are closed", of(true), of(true) + of(false));
    assert_eq!(of(true), 0, "each corner of each triangle is moved by its own random numbers");
    let bounds = model.info().bounds;
    let mut rng = Rng::new(4);
    let rays: Vec<Ray> = (0..400)
        .map(|_| {
            let (to, dir) = (rng.inside(bounds.min, bounds.max), rng.direction());
            Ray::new(to - dir * 100.0, dir.as_vec3())
        })
        .collect();
    let hits = ask(&scene.state(), &rays, QueryOptions::default());
    let found = scene.state().thickness(&hits).expect("thicknesses");
    let mut finite = 0;
    for (hit, thickness) in hits.iter().zip(found).filter(|(hit, _)| hit.kind == HitKind::Exact) {
        let tris = read(&model, hit.part);
        let own = tris.iter().find(|it| it.prim == hit.prim).expect("the triangle that was hit");
        let (inward, point) = (-hit.normal.as_dvec3(), hit.position);
        let facing = |tri: &Tri| (tri[1] - tri[0]).cross(tri[2] - tri[0]).dot(inward) > 0.0;
        let line = Ray64::new(point, inward);
        let behind = |it: &&StoredTriangle| facing(&it.corners) != facing(&own.corners);
        let at = tris.iter().filter(behind).filter_map(|it| brute::meet_line(&line, &it.corners)).map(|met| met.0);
        let expected = at.filter(|t| *t > 1e-6).fold(f64::INFINITY, f64::min);
        let is_near = thickness == expected || (thickness - expected).abs() < 1e-5;
        assert!(is_near, "{thickness}, not {expected}: {hit:?}");
        finite += usize::from(thickness.is_finite());
    }
    println!("{finite} of {} hits have an opposite side", hits.iter().filter(|hit| hit.kind == HitKind::Exact).count());
    assert!(finite > 5, "{finite}");
}

/// The triangles of a part.
fn read(model: &Model, part: u64) -> Vec<StoredTriangle> {
    let mut reader = model.read_part(model.part_index(part).expect("a part")).expect("a reader");
    let mut all = Vec::new();
    loop {
        let some = reader.next(1 << 16, &Cancel::new()).expect("triangles");
        if some.is_empty() {
            return all;
        }
        all.extend_from_slice(some);
    }
}
