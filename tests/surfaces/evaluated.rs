//! Points of surfaces under hits, against closed forms of their derivatives and curvatures.

use crate::common::asked::ask;
use crate::common::built::{self, Built, build_with};
use crate::common::nurbs::{Nurbs, sphere, torus};
use crate::common::rng::Rng;
use crate::common::shapes::own;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use outcrop::base::error::Error;
use outcrop::base::progress::Cancel;
use outcrop::build::{BuildOptions, Structure};
use outcrop::import::surfaces::{CageMesh, Dicing, NurbsMesh};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Evaluated, Hit, HitKind, Policy, QueryOptions, SurfaceAt, Want};
use outcrop::scene::{Context, ContextOptions, Model, Scene};

const STRUCTURES: [Structure; 2] = [Structure::Bvh, Structure::Patch];

fn options(structure: Structure, level: u32) -> BuildOptions {
    BuildOptions { structure, dicing: Some(Dicing::Level(level)), ..built::options() }
}

fn of_nurbs(shape: &Nurbs, structure: Structure, level: u32, is_reversed: bool) -> Built {
    let fill = |builder: &mut outcrop::build::Builder| {
        let part = builder.part(PartDesc::default()).expect("a part");
        let mesh = NurbsMesh { desc: shape.desc(), is_reversed, domain: None, extent: 0.0, part };
        builder.nurbs(MeshKey::DIRECT, &mesh).expect("a surface");
    };
    build_with(options(structure, level), fill).0
}

fn placed(context: &Context, built: &Built, place: DAffine3) -> Scene {
    let model = Model::open(context, &built.path).expect("a model");
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, place).expect("an instance");
    scene.commit().expect("a commit");
    scene
}

const ALL: QueryOptions =
    QueryOptions { coherent: false, want: Want(Want::ALL.0 | Want::SHADING_NORMAL.0), policy: Policy::Exact };

fn evaluate(scene: &Scene, hits: &[Hit]) -> Vec<SurfaceAt> {
    scene.state().evaluate(hits, Policy::Exact, &Cancel::new()).expect("points")
}

/// Hits of rays through points of the unit sphere that `place` moves, from the inside in random directions, with their
/// points.
fn from_inside(scene: &Scene, place: &DAffine3, from: DVec3, count: usize) -> Vec<(Ray, Hit, SurfaceAt)> {
    let mut rng = Rng::new(11);
    let origin = place.transform_point3(from);
    let dir = |rng: &mut Rng| place.transform_vector3(rng.direction()).normalize().as_vec3();
    let rays: Vec<Ray> = (0..count).map(|_| Ray::new(origin, dir(&mut rng))).collect();
    let hits = ask(&scene.state(), &rays, ALL);
    let points = evaluate(scene, &hits);
    assert!(hits.iter().all(|hit| hit.kind == HitKind::Exact));
    rays.into_iter().zip(hits).zip(points).map(|((ray, hit), point)| (ray, hit, point)).collect()
}

/// Checks what holds for every point, and returns the greatest error of its curvatures, relative to the greater one.
/// `expected`: the outward normal and the curvatures for it.
fn error(hit: &Hit, point: &SurfaceAt, (outward, [more, less]): (DVec3, [f64; 2])) -> f64 {
    assert!(matches!(point.kind, Evaluated::Triangle | Evaluated::Surface), "{point:?}");
    let is_surface = point.kind == Evaluated::Surface;
    let away = point.position.distance(hit.position);
    assert!(away <= if is_surface { 0.02 * hit.position.length() } else { f64::from(hit.error) }, "{hit:?} {point:?}");
    assert!((point.normal.length() - 1.0).abs() < 1e-12);
    // The same normal as that of the query, which faces the ray.
    let facing = hit.shading_normal.as_dvec3();
    assert!(point.normal.cross(facing).length() < if is_surface { 0.05 } else { 1e-5 }, "{point:?} {hit:?}");
    assert!(!is_surface || point.normal.cross(outward).length() < 1e-6, "{point:?} {outward}");
    let side = point.normal.dot(outward).signum();
    let expected = if side > 0.0 { [more, less] } else { [-less, -more] };
    let size = more.abs().max(less.abs());
    let found = (0..2).map(|i| (point.curvatures[i] - expected[i]).abs() / size).fold(0.0, f64::max);
    assert!(point.curvatures[0] >= point.curvatures[1]);
    found
}

fn outward_on_torus(p: DVec3) -> (DVec3, [f64; 2]) {
    let ring = p.with_z(0.0).normalize();
    let outward = (p - 3.0 * ring).normalize();
    let cosine = outward.dot(ring);
    let around = -cosine / (3.0 + cosine);
    (outward, [around.max(-1.0), around.min(-1.0)])
}

/// Points that are evaluated on the surface have its curvatures. Those of triangles approach them as levels rise: with
/// `patch` as the size of the cells, with `bvh` as near as its rounded normals allow.
#[test]
fn curvatures_of_diced_surfaces_converge() {
    let (context, place) = (built::context(2), DAffine3::IDENTITY);
    for (name, shape, from) in [("sphere", sphere(), DVec3::new(0.1, 0.2, -0.3)), ("torus", torus(), DVec3::X * 3.1)] {
        for structure in STRUCTURES {
            let mut before = f64::INFINITY;
            for level in [3, 4, 5] {
                let scene = placed(&context, &of_nurbs(&shape, structure, level, false), place);
                let mut errors: Vec<f64> = Vec::new();
                let mut surfaces = 0;
                for (_, hit, point) in from_inside(&scene, &place, from, 2000) {
                    let p = point.position;
                    let expected = if name == "torus" { outward_on_torus(p) } else { (p.normalize(), [-1.0; 2]) };
                    // The facets at the poles of the sphere are slivers.
                    if name == "torus" || p.z.abs() < 0.9 * p.length() {
                        errors.push(error(&hit, &point, expected));
                        if point.kind == Evaluated::Surface {
                            let centre = if name == "torus" { 3.0 * p.with_z(0.0).normalize() } else { DVec3::ZERO };
                            assert!((p.distance(centre) - 1.0).abs() < 1e-9, "{point:?}");
                            surfaces += 1;
                        }
                    }
                }
                errors.sort_by(f64::total_cmp);
                let (usual, most) = (errors[errors.len() * 9 / 10], errors[errors.len() - 1]);
                println!("{name} {structure:?} level {level}: {usual:.2e}, at most {most:.2e}, {surfaces} of surfaces");
                assert!(structure == Structure::Patch || surfaces == 0);
                if surfaces == errors.len() {
                    assert!(most < 1e-6, "{most}");
                } else if structure == Structure::Patch {
                    // Over a cell the curvature of a torus changes in proportion to the size of the cell. Normals are
                    // coded to some 1e-4, over cells of a twentieth.
                    assert!(usual < (before / 1.6).max(0.003) && usual < 0.05, "{usual} after {before}");
                    assert!(most < 4.0 * usual.max(0.003), "{most}");
                } else {
                    assert!(usual < 0.15, "{usual}");
                }
                before = usual;
            }
        }
    }
}

/// Principal curvatures of the ellipsoid with these half axes, for its outward normal, and that normal.
fn of_ellipsoid(p: DVec3, axes: DVec3) -> (DVec3, [f64; 2]) {
    let gradient = p / (axes * axes);
    let (w, product) = (gradient.length_squared(), (axes.x * axes.y * axes.z).powi(2));
    let gauss = 1.0 / (product * w * w);
    let mean = (axes.length_squared() - p.length_squared()) / (2.0 * product * w.powf(1.5));
    let root = (mean * mean - gauss).max(0.0).sqrt();
    (gradient.normalize(), [-mean + root, -mean - root])
}

/// Scaled, mirrored and turned instances of a sphere are ellipsoids.
#[test]
fn instances_have_the_curvatures_of_what_they_show() {
    let context = built::context(2);
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    for structure in STRUCTURES {
        let built = of_nurbs(&sphere(), structure, 5, false);
        let mut side = None;
        for axes in [DVec3::ONE, DVec3::new(2.0, 0.5, 1.5), DVec3::new(-2.0, 0.5, 1.5), DVec3::new(-1.0, -30.0, -2.0)] {
            for (turn, offset) in [(DQuat::IDENTITY, DVec3::ZERO), (turn, DVec3::new(1e5, -2e5, 3e4))] {
                let place =
                    DAffine3 { matrix3: DMat3::from_quat(turn) * DMat3::from_diagonal(axes), translation: offset };
                let scene = placed(&context, &built, place);
                let (mut errors, back) = (Vec::new(), place.inverse());
                for (_, hit, point) in from_inside(&scene, &place, DVec3::new(0.1, 0.2, -0.3), 1000) {
                    let local = back.transform_point3(point.position);
                    if local.z.abs() > 0.8 {
                        continue;
                    }
                    let (outward, curvatures) = of_ellipsoid(local * axes.abs() / local.length(), axes.abs());
                    let outward = turn * (outward * axes.signum());
                    errors.push(error(&hit, &point, (outward, curvatures)));
                    // Mirrors keep the side of normals.
                    let now = point.normal.dot(outward) > 0.0;
                    assert_eq!(*side.get_or_insert(now), now, "{axes} {point:?}");
                    // The derivatives lie along the surface, and span it.
                    let across = point.du.cross(point.dv).normalize();
                    assert!(across.dot(point.normal).abs() > 0.9, "{point:?}");
                }
                errors.sort_by(f64::total_cmp);
                let usual = errors[errors.len() * 9 / 10];
                println!("{structure:?} {axes}: {usual:.2e}");
                assert!(usual < if structure == Structure::Patch { 1e-6 } else { 0.15 }, "{axes}: {usual}");
            }
        }
    }
}

/// Two hits near each other differ by their parameters times the derivatives. A reversed surface, whose grids are
/// turned over, has the same derivatives and the opposite normals.
#[test]
fn derivatives_are_by_the_parameters_of_hits() {
    let context = built::context(2);
    let place = DAffine3 { matrix3: DMat3::from_diagonal(DVec3::new(2.0, 0.5, 1.0)), translation: DVec3::X };
    let sides: Vec<bool> = [false, true]
        .into_iter()
        .map(|is_reversed| {
            let scene = placed(&context, &of_nurbs(&torus(), Structure::Patch, 5, is_reversed), place);
            let mut rng = Rng::new(5);
            let mut rays = Vec::new();
            for _ in 0..500 {
                let dir = (rng.direction() + DVec3::X * 0.01).as_vec3();
                let aside = rng.direction() * 0.004;
                let origin = place.transform_point3(DVec3::X * 3.1);
                rays.extend([Ray::new(origin, dir), Ray::new(origin + aside, dir)]);
            }
            let hits = ask(&scene.state(), &rays, ALL);
            let points = evaluate(&scene, &hits);
            let mut count = 0;
            for (hits, points) in hits.chunks(2).zip(points.chunks(2)) {
                if hits[0].prim != hits[1].prim {
                    continue;
                }
                let by = |axis: usize| f64::from(hits[1].uv[axis]) - f64::from(hits[0].uv[axis]);
                let step = points[0].du * by(0) + points[0].dv * by(1);
                let moved = points[1].position - points[0].position;
                // The derivatives of cells differ by the angles between them.
                assert!(step.distance(moved) < 0.25 * moved.length() + 1e-6, "{step} {moved}");
                count += 1;
            }
            assert!(count > 300, "{count}");
            let across = points[0].du.cross(points[0].dv).dot(points[0].normal);
            across > 0.0
        })
        .collect();
    assert!(sides[0] != sides[1], "{sides:?}");
}

/// A cylinder of triangles with normals: no curvature along its axis, 1 / r across it. Derivatives are edges.
#[test]
fn triangles_with_normals_bend_and_flat_ones_do_not() {
    let (r, count) = (2.0, 64);
    let at = |i: usize, z: f64| {
        let turn = std::f64::consts::TAU * i as f64 / count as f64;
        DVec3::new(r * turn.cos(), r * turn.sin(), z)
    };
    let tris: Vec<[DVec3; 3]> = (0..count)
        .flat_map(|i| {
            let [a, b, c, d] = [at(i, -1.0), at(i + 1, -1.0), at(i + 1, 1.0), at(i, 1.0)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let normals: Vec<_> = tris.iter().map(|tri| tri.map(|p| p.with_z(0.0).normalize().as_vec3())).collect();
    let context = built::context(1);
    for is_smooth in [true, false] {
        let fill = |builder: &mut outcrop::build::Builder| {
            let part = builder.part(PartDesc::default()).expect("a part");
            let normals = is_smooth.then_some(&normals[..]);
            let attributes = Attributes { colours: None, normals };
            builder.triangles(MeshKey::DIRECT, part, &tris, attributes).expect("triangles");
        };
        let (built, _) = build_with(built::options(), fill);
        let scene = placed(&context, &built, DAffine3::IDENTITY);
        let rays: Vec<Ray> = (0..500)
            .map(|i| {
                let turn = f64::from(i) * 0.7;
                let dir = DVec3::new(-turn.cos(), -turn.sin(), 0.0);
                Ray::new(-5.0 * dir + DVec3::Z * (f64::from(i) / 300.0 - 0.8), dir.as_vec3())
            })
            .collect();
        let hits = ask(&scene.state(), &rays, ALL);
        for (hit, point) in hits.iter().zip(evaluate(&scene, &hits)) {
            let [a, b, c] = tris[hit.prim as usize];
            assert!(point.du.distance(b - a) < 1e-6 && point.dv.distance(c - a) < 1e-6, "{point:?}");
            let expected = if is_smooth { [0.0, -1.0 / r] } else { [0.0; 2] };
            let far = (0..2).map(|i| (point.curvatures[i] - expected[i]).abs()).fold(0.0, f64::max);
            assert!(far < if is_smooth { 0.1 / r } else { 1e-12 }, "{point:?}");
            let radial =
                if is_smooth { hit.position.with_z(0.0).normalize() } else { (b - a).cross(c - a).normalize() };
            assert!(point.normal.dot(radial) > 1.0 - 1e-5, "{point:?}");
            assert_eq!((point.kind, point.corner), (Evaluated::Triangle, 0));
        }
    }
}

/// Of a cage of triangles each corner of a face has a quad of its own: its number is that of the nearest vertex.
#[test]
fn corners_of_faces_are_those_that_the_quads_are_at() {
    let shape = own().into_iter().find(|it| it.name == "tetrahedron").expect("a tetrahedron");
    let fill = |builder: &mut outcrop::build::Builder| {
        let part = builder.part(PartDesc::default()).expect("a part");
        let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &[part], displacement: None };
        builder.cage(MeshKey::DIRECT, &mesh).expect("a surface");
    };
    let context = built::context(1);
    let middle = shape.points.iter().sum::<DVec3>() / 4.0;
    for structure in STRUCTURES {
        let (built, _) = build_with(options(structure, 4), fill);
        let scene = placed(&context, &built, DAffine3::IDENTITY);
        let mut seen = [[0; 3]; 4];
        for (_, hit, point) in from_inside(&scene, &DAffine3::IDENTITY, middle, 3000) {
            if structure == Structure::Bvh {
                assert_eq!(point.corner, 0);
                continue;
            }
            let face = hit.prim as usize;
            let of_face = &shape.indices[3 * face..3 * face + 3];
            let near = |at: &usize| {
                (shape.points[of_face[*at] as usize] - middle).normalize().dot((hit.position - middle).normalize())
            };
            let nearest = (0..3).max_by(|a, b| near(a).total_cmp(&near(b))).expect("three");
            // At the parameters (0, 0) is the corner, at (1, 1) the middle of the face.
            if hit.uv[0].max(hit.uv[1]) < 0.7 {
                assert_eq!(point.corner as usize, nearest, "{hit:?}");
            }
            seen[face][point.corner as usize] += 1;
        }
        assert!(structure == Structure::Bvh || seen.iter().flatten().all(|&count| count > 20), "{seen:?}");
    }
}

/// Misses and stand-ins are answered as such, hits of before a commit are refused, and the number names the hit.
#[test]
fn other_hits_are_said_to_be_such() {
    let context = built::context(2);
    for structure in STRUCTURES {
        let scene = placed(&context, &of_nurbs(&sphere(), structure, 4, false), DAffine3::IDENTITY);
        let ray = Ray::new(DVec3::new(0.1, 0.2, 5.0), -DVec3::Z.as_vec3());
        let wide = Ray { cone: outcrop::math::Cone { a: 0.4, b: 0.0 }, ..ray };
        let hits = ask(&scene.state(), &[ray, wide, Ray::new(ray.origin, -ray.dir)], ALL);
        assert_eq!([0, 1, 2].map(|i: usize| hits[i].kind), [HitKind::Exact, HitKind::Lod, HitKind::Miss]);
        let points = evaluate(&scene, &hits);
        assert_eq!(points[2], SurfaceAt::NOTHING);
        assert_eq!((points[1].kind, points[1].position), (Evaluated::StandIn, hits[1].position));
        assert_eq!((points[1].normal.as_vec3(), points[1].du), (hits[1].shading_normal, DVec3::ZERO));
        assert!(points[0].normal != DVec3::ZERO && points[0].du != DVec3::ZERO);
        let missing = Hit { kind: HitKind::Missing, ..hits[1] };
        assert_eq!(evaluate(&scene, &[missing])[0].kind, Evaluated::Missing);
        // Many hits, of which one is wrong.
        let mut many = vec![hits[0]; 1000];
        assert!(evaluate(&scene, &many).iter().all(|point| *point == points[0]));
        many[700].prim = 12_345_678;
        let state = scene.state();
        let refused = |hits: &[Hit], why: &str| match state.evaluate(hits, Policy::Exact, &Cancel::new()) {
            Err(Error::BadArgument(text)) => assert!(text.contains(why), "{text}"),
            other => panic!("{:?}", other.map(|points| points.len())),
        };
        refused(&many, "hit 700: no triangle of the scene");
        refused(&[Hit { kind: HitKind::Exact, ..Hit::MISS }], "hit 0: it needs a position");
        // A number of another place is no hint.
        for occurrence in [u64::MAX - 1, u64::MAX, 1] {
            assert_eq!(evaluate(&scene, &[Hit { occurrence, ..hits[0] }])[0], points[0]);
        }
        scene.set_transform(7, DAffine3::from_translation(DVec3::X)).expect("a transform");
        scene.commit().expect("a commit");
        let stale = scene.state().evaluate(&hits[..1], Policy::Exact, &Cancel::new());
        assert!(matches!(stale, Err(Error::BadArgument(_))), "{stale:?}");
        assert_eq!(state.evaluate(&hits[..1], Policy::Exact, &Cancel::new()).expect("points")[0], points[0]);
    }
}

/// Of coincident instances, and in scenes in scenes, the hit's occurrence tells which one is meant.
#[test]
fn nested_scenes_are_evaluated_in_their_place() {
    let context = built::context(1);
    let built = of_nurbs(&sphere(), Structure::Patch, 5, false);
    let model = Model::open(&context, &built.path).expect("a model");
    let (inner, outer) = (Scene::new(&context), Scene::new(&context));
    let squash = |axes: DVec3| DAffine3 { matrix3: DMat3::from_diagonal(axes), translation: DVec3::ZERO };
    inner.add_instance(&model, 3, squash(DVec3::new(2.0, 1.0, 1.0))).expect("an instance");
    inner.commit().expect("a commit");
    for (id, axes) in [(1, DVec3::new(1.0, -3.0, 1.0)), (2, DVec3::new(5.0, 5.0, 0.5))] {
        let place = DAffine3 { translation: DVec3::X * (100.0 * id as f64), ..squash(axes) };
        outer.add_scene(&inner, id, place).expect("a scene");
    }
    outer.commit().expect("a commit");
    for (id, axes) in [(1.0, DVec3::new(2.0, 3.0, 1.0)), (2.0, DVec3::new(10.0, 5.0, 0.5))] {
        let place = DAffine3 { translation: DVec3::X * 100.0 * id, ..squash(axes) };
        let mut errors = Vec::new();
        for (_, hit, point) in from_inside(&outer, &place, DVec3::new(0.1, 0.2, -0.3), 500) {
            let p = point.position - place.translation;
            if (p / axes).z.abs() < 0.8 {
                let on = p / (p / axes).length();
                errors.push(error(&hit, &point, of_ellipsoid(on, axes)));
            }
        }
        errors.sort_by(f64::total_cmp);
        assert!(errors[errors.len() * 9 / 10] < 0.01, "{errors:?}");
    }
}

/// With a small budget the points are those of all memory; at once, what is not in memory is said to be missing.
#[test]
fn points_do_not_depend_on_memory() {
    for structure in STRUCTURES {
        let built = of_nurbs(&torus(), structure, 6, false);
        let in_budget = |memory_budget: u64| {
            let options = ContextOptions { threads: 2, memory_budget, read_ahead: false, ..ContextOptions::default() };
            Context::new(options).expect("a context")
        };
        let all = placed(&in_budget(0), &built, DAffine3::IDENTITY);
        let (hits, points): (Vec<_>, Vec<_>) = from_inside(&all, &DAffine3::IDENTITY, DVec3::X * 3.1, 600)
            .into_iter()
            .map(|(_, hit, point)| (hit, point))
            .unzip();
        let small = placed(&in_budget(8 << 20), &built, DAffine3::IDENTITY);
        // What was read for them is still in memory.
        let again = all.state().evaluate(&hits, Policy::Now, &Cancel::new()).expect("points");
        assert!(again == points, "{structure:?}: {:?}", again.iter().map(|p| p.kind).max_by_key(|kind| *kind as u32));
        let now = small.state().evaluate(&hits, Policy::Now, &Cancel::new()).expect("points");
        for (now, expected) in now.iter().zip(&points) {
            assert!(now == expected || now.kind == Evaluated::Missing && now.du == DVec3::ZERO, "{now:?}");
        }
        assert!(evaluate(&small, &hits) == points, "{structure:?}");

        println!(
            "{structure:?}: {} of {} missing",
            now.iter().filter(|p| p.kind == Evaluated::Missing).count(),
            hits.len()
        );
    }
}
