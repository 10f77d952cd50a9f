//! Nearest points and distances of sets, against all triangles in double precision and against closed forms.

use super::common::brute::Tri;
use super::common::built::{self, Part};
use super::common::rng::Rng;
use super::common::scenes::{self, rounded};
use super::{World, cuboid, soup, world};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::build::Structure;
use outcrop::geom::distances::{point_triangle, triangle_triangle};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::query::PartSet;
use outcrop::query::{DistanceOptions, HitKind, NearestOptions, NearestPoint, Policy, SetDistance};
use outcrop::scene::{Context, ContextOptions, Model, Scene};

fn ask(world: &World, points: &[DVec3], options: &NearestOptions) -> Vec<NearestPoint> {
    let mut out = vec![NearestPoint::MISS; points.len()];
    world.scene.state().nearest(points, options, &mut out).expect("an answer");
    out
}

/// All triangles: instance, part, primitive id, corners in the world relative to `origin`.
fn triangles(world: &World, origin: DVec3) -> Vec<(u64, u64, u64, Tri)> {
    let mut all = Vec::new();
    for (instance, place, parts) in &world.all {
        // As in the library, the part of the map that is far from zero comes off first.
        let place = DAffine3 { translation: place.translation - origin, ..*place };
        let mut prim = 0;
        for part in parts {
            for tri in &part.tris {
                all.push((*instance, part.id, prim, tri.map(|v| place.transform_point3(v))));
                prim += 1;
            }
        }
    }
    all
}

/// Asserts that answers are those of all triangles.
fn assert_nearest(world: &World, points: &[DVec3], name: &str) {
    let answers = ask(world, points, &NearestOptions::default());
    for (&p, answer) in points.iter().zip(&answers) {
        let all: Vec<_> = triangles(world, p)
            .into_iter()
            .map(|(instance, part, prim, tri)| {
                (point_triangle(DVec3::ZERO, &tri).squared.sqrt(), (instance, part, prim))
            })
            .collect();
        let least = all.iter().map(|it| it.0).fold(f64::INFINITY, f64::min);
        assert_eq!(answer.kind, HitKind::Exact, "{name}");
        let is_near = (answer.distance - least).abs() <= answer.error;
        assert!(is_near, "{name}: {} and not {least}, said {:e}", answer.distance, answer.error);
        assert!(answer.error <= 1e-7 * (1.0 + p.length() * 1e-7 + least), "{name}: {:e}", answer.error);
        assert!((answer.position.distance(p) - least).abs() <= answer.error + 1e-9 * p.length().max(1.0), "{name}");
        let of_it = all.iter().find(|it| it.1 == (answer.instance, answer.part, answer.prim)).expect("a triangle");
        assert!(of_it.0 <= least + answer.error, "{name}: {} is that of another triangle", of_it.0);
    }
}

fn points(rng: &mut Rng, count: usize, at: DVec3, size: f64) -> Vec<DVec3> {
    (0..count).map(|i| at + rng.direction() * size * [0.1, 0.5, 1.0, 3.0][i % 4] * rng.unit()).collect()
}

#[test]
fn nearest_points_are_those_of_all_triangles() {
    let mut rng = Rng::new(61);
    let parts =
        |seed| (1..=5).map(|id| Part::white(id, soup(&mut Rng::new(seed + id), 120, 0.25, 1.0))).collect::<Vec<_>>();
    let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.4), DVec3::new(0.6, 0.2, -0.1));
    let mirrored =
        DAffine3 { matrix3: DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.5)), translation: DVec3::new(0.3, 0.0, 2.25) };
    let skewed = DAffine3 {
        matrix3: DMat3::from_cols(DVec3::new(1.0, 0.4, 0.0), DVec3::new(-0.3, 9.0, 0.2), DVec3::new(0.0, 0.1, 0.05)),
        translation: DVec3::new(-2.0, 0.5, 1.0),
    };
    for threads in [0, 2] {
        let near =
            world(vec![(parts(70), vec![DAffine3::IDENTITY, turned]), (parts(80), vec![mirrored, skewed])], threads);
        assert_nearest(&near, &points(&mut rng, 300, DVec3::ZERO, 2.0), "turned, mirrored, skewed");
        assert_nearest(&near, &points(&mut rng, 40, DVec3::ZERO, 1e6), "from far away");
        let at = DVec3::new(1e7, -1e7, 3e6);
        let far = |place: DAffine3| DAffine3 { translation: place.translation + at, ..place };
        let away = world(vec![(parts(90), vec![far(DAffine3::IDENTITY), far(turned), far(skewed)])], threads);
        assert_nearest(&away, &points(&mut rng, 200, at, 2.0), "far from zero");
    }
}

/// Corners, edges, faces and the inside of a box: ties between triangles go to the least primitive id.
#[test]
fn the_nearest_point_of_a_box_is_that_of_the_closed_form() {
    let (min, max) = (DVec3::splat(-1.0), DVec3::new(1.0, 2.0, 3.0));
    let grid: Vec<DVec3> =
        (0..343).map(|i| DVec3::new((i % 7) as f64 - 3.0, (i / 7 % 7) as f64 - 2.5, (i / 49) as f64 - 1.5)).collect();
    let one = world(vec![(vec![Part::white(7, cuboid(min, max))], vec![DAffine3::IDENTITY])], 0);
    let options = NearestOptions { inside: true, ..NearestOptions::default() };
    let brute = triangles(&one, DVec3::ZERO);
    for (p, answer) in grid.iter().zip(ask(&one, &grid, &options)) {
        let outside = p.distance(p.clamp(min, max));
        let inside = (*p - min).min(max - *p).min_element();
        let expected = if outside > 0.0 { outside } else { inside };
        assert!((answer.distance - expected).abs() < 1e-12, "{p}: {} and not {expected}", answer.distance);
        let on_surface = outside == 0.0 && inside == 0.0;
        assert!(on_surface || (answer.holds == 1) == (outside == 0.0), "{p}: {}", answer.holds);
        let squared = |tri: &Tri| point_triangle(DVec3::ZERO, &tri.map(|v| v - *p)).squared;
        let least = brute.iter().map(|it| squared(&it.3)).fold(f64::INFINITY, f64::min);
        let first = brute.iter().position(|it| squared(&it.3) == least);
        assert_eq!(Some(answer.prim as usize), first, "{p}");
    }
}

#[test]
fn sets_limits_and_hidden_parts_count() {
    let at = |x: f64| cuboid(DVec3::new(x, 0.0, 0.0), DVec3::new(x + 1.0, 1.0, 1.0));
    let parts = vec![Part::white(1, at(0.0)), Part::white(2, at(10.0)), Part::white(3, at(20.0))];
    let up = DAffine3::from_translation(DVec3::new(0.0, 5.0, 0.0));
    let both = world(vec![(parts, vec![DAffine3::IDENTITY, up])], 0);
    let p = [DVec3::new(-2.0, 0.5, 0.5)];
    let of = |set: PartSet, max_distance| {
        ask(&both, &p, &NearestOptions { set, max_distance, ..NearestOptions::default() })[0]
    };
    let one = |instance, part| {
        let mut set = PartSet::default();
        set.add_part(instance, part);
        set
    };
    let none = f64::INFINITY;
    let answer = of(PartSet::all(), none);
    assert_eq!((answer.distance, answer.instance, answer.part), (2.0, 100, 1));
    let answer = of(one(None, 2), none);
    assert_eq!((answer.distance, answer.instance, answer.part), (12.0, 100, 2));
    let answer = of(one(Some(101), 1), none);
    assert!((answer.distance - (4.0f64 + 4.5 * 4.5).sqrt()).abs() < 1e-12 && answer.instance == 101);
    assert_eq!(of(PartSet::all(), 2.0).kind, HitKind::Exact, "the limit counts");
    let miss = of(PartSet::all(), 1.999);
    assert_eq!((miss.kind, miss.distance, miss.part), (HitKind::Miss, none, u64::MAX));
    // Hidden parts and instances are not there.
    let hidden = outcrop::scene::Look { visible: false, ..outcrop::scene::Look::default() };
    both.scene.set_part_look(100, 1, hidden).expect("a part");
    both.scene.commit().expect("a commit");
    let answer = of(PartSet::all(), none);
    assert_eq!((answer.instance, answer.part), (101, 1));
    both.scene.set_instance_look(101, hidden).expect("an instance");
    both.scene.commit().expect("a commit");
    let answer = of(PartSet::all(), none);
    assert_eq!((answer.instance, answer.part, answer.distance), (100, 2, 12.0));
}

#[test]
fn bad_questions_are_refused() {
    let one = world(vec![(vec![Part::white(1, cuboid(DVec3::ZERO, DVec3::ONE))], vec![DAffine3::IDENTITY])], 0);
    let state = one.scene.state();
    let fails = |points: &[DVec3], options: NearestOptions, what: &str| {
        let mut out = vec![NearestPoint::MISS; points.len()];
        let error = state.nearest(points, &options, &mut out).expect_err("it is refused").to_string();
        assert!(error.contains(what), "{error}");
    };
    let unknown = || {
        let mut set = PartSet::default();
        set.add_part(None, 77);
        set
    };
    fails(&[DVec3::ZERO, DVec3::NAN], NearestOptions::default(), "point 1");
    fails(&[DVec3::INFINITY], NearestOptions::default(), "not finite");
    for max_distance in [-1.0, f64::NAN] {
        fails(&[], NearestOptions { max_distance, ..NearestOptions::default() }, "greatest distance");
        let options = DistanceOptions { max_distance, ..DistanceOptions::default() };
        assert!(state.distance(&options).expect_err("refused").to_string().contains("greatest distance"));
    }
    fails(&[], NearestOptions { set: PartSet::default(), ..NearestOptions::default() }, "empty");
    fails(&[], NearestOptions { set: unknown(), ..NearestOptions::default() }, "part 77");
    fails(&[], NearestOptions { inside: true, policy: Policy::Now, ..NearestOptions::default() }, "without reading");
    let mut too_few = [];
    assert!(state.nearest(&[DVec3::ZERO], &NearestOptions::default(), &mut too_few).is_err());
    let options = DistanceOptions { b: Some(PartSet::default()), ..DistanceOptions::default() };
    assert!(state.distance(&options).expect_err("refused").to_string().contains("empty"));
    let options = DistanceOptions { b: Some(unknown()), ..DistanceOptions::default() };
    assert!(state.distance(&options).expect_err("refused").to_string().contains("part 77"));
    // Nothing to find is no error.
    assert_eq!(state.distance(&DistanceOptions::default()).expect("an answer"), None);
    let empty = Scene::new(&one._context);
    empty.commit().expect("a commit");
    assert_eq!(empty.state().distance(&DistanceOptions::default()).expect("an answer"), None);
    let mut out = [NearestPoint::MISS];
    empty.state().nearest(&[DVec3::ZERO], &NearestOptions::default(), &mut out).expect("an answer");
    assert_eq!(out[0].kind, HitKind::Miss);
}

fn of_instance(id: u64) -> PartSet {
    let mut set = PartSet::default();
    set.add_instance(id);
    set
}

/// Asserts that the distance of two sets is that of all pairs of triangles.
fn assert_distance(world: &World, [a, b]: [u64; 2], name: &str) -> SetDistance {
    let options = DistanceOptions { a: of_instance(a), b: Some(of_instance(b)), max_distance: f64::INFINITY };
    let found = world.scene.state().distance(&options).expect("an answer").expect("two parts");
    let turned = DistanceOptions { a: of_instance(b), b: Some(of_instance(a)), ..options };
    let other = world.scene.state().distance(&turned).expect("an answer").expect("two parts");
    let swap = |[x, y]: [u64; 2]| [y, x];
    assert_eq!(
        (other.distance, other.prims, other.parts),
        (found.distance, swap(found.prims), swap(found.parts)),
        "{name}"
    );
    assert_eq!([other.points[1], other.points[0]], found.points, "{name}");
    let all = triangles(world, found.points[0]);
    let pairs = all.iter().filter(|x| x.0 == a).flat_map(|x| all.iter().filter(|y| y.0 == b).map(move |y| (x, y)));
    let mut least = f64::INFINITY;
    let mut of_it = None;
    for (x, y) in pairs {
        let distance = triangle_triangle(&x.3, &y.3).squared.sqrt();
        least = least.min(distance);
        if [x.1, y.1] == found.parts && [x.2, y.2] == found.prims {
            of_it = Some(distance);
        }
    }
    assert!((found.distance - least).abs() <= found.error + 1e-12, "{name}: {} and not {least}", found.distance);
    assert!(of_it.expect("two triangles") <= least + found.error + 1e-12, "{name}");
    let apart = found.points[0].distance(found.points[1]);
    assert!((apart - found.distance).abs() <= found.error + 1e-8, "{name}: {apart}");
    assert!(found.error <= 1e-6, "{name}: {:e}", found.error);
    found
}

#[test]
fn the_distance_of_sets_is_that_of_all_pairs() {
    let parts =
        |seed| (1..=3).map(|id| Part::white(id, soup(&mut Rng::new(seed + id), 60, 0.1, 0.6))).collect::<Vec<_>>();
    for threads in [0, 2] {
        for (case, at) in [(0u64, 3.0), (1, 1.4), (2, 0.4), (3, 0.0)] {
            let turn = DQuat::from_rotation_z(0.7 * case as f64);
            let place = DAffine3::from_rotation_translation(turn, DVec3::new(at, at * 0.3, -at * 0.2));
            let skewed = DAffine3 {
                matrix3: DMat3::from_cols(DVec3::X, DVec3::new(0.3, -2.0, 0.0), DVec3::new(0.0, 0.1, 0.2)),
                ..place
            };
            let far = DVec3::new(-1e7, 1e7, 2e6);
            for (kind, move_by) in [("", DVec3::ZERO), (" far from zero", far)] {
                let all = [DAffine3::IDENTITY, place, skewed]
                    .map(|it| DAffine3 { translation: it.translation + move_by, ..it });
                let scene = world(vec![(parts(10 * case), all.to_vec())], threads);
                for pair in [[100, 101], [100, 102], [101, 102]] {
                    assert_distance(&scene, pair, &format!("case {case}{kind}, {threads} threads, {pair:?}"));
                }
            }
        }
    }
}

/// Walks read the places of any structure in rows of eight: those of large blocks are groups of what these hold.
#[test]
fn every_structure_gives_the_same_answers() {
    let parts: Vec<_> = (1..=3).map(|id| Part::white(id, soup(&mut Rng::new(70 + id), 250, 0.1, 0.6))).collect();
    let place = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.7), DVec3::new(1.9, 0.4, -0.3));
    for structure in Structure::ALL {
        built::with(structure, || {
            let parts = parts.iter().map(|part| Part::white(part.id, part.tris.clone())).collect();
            let both = world(vec![(parts, vec![DAffine3::IDENTITY, place])], 0);
            assert_nearest(&both, &points(&mut Rng::new(71), 100, DVec3::ZERO, 1.0), structure.name());
            assert!(assert_distance(&both, [100, 101], structure.name()).distance > 0.0);
            assert!(both.assert_equals_brute(structure.name()) > 50);
        });
    }
}

#[test]
fn boxes_have_the_distance_of_the_closed_form() {
    let shell = cuboid(DVec3::splat(-2.0), DVec3::splat(2.0));
    let inside = cuboid(DVec3::splat(-0.5), DVec3::splat(0.75));
    let beside = cuboid(DVec3::new(3.0, -0.5, 4.0), DVec3::new(4.0, 0.5, 5.0));
    let touching = cuboid(DVec3::new(-4.0, -0.25, -0.25), DVec3::new(-2.0, 0.5, 0.5));
    let parts = vec![Part::white(1, shell), Part::white(2, inside), Part::white(3, beside), Part::white(4, touching)];
    let one = world(vec![(parts, vec![DAffine3::IDENTITY])], 0);
    let of = |a: u64, b: u64, max_distance: f64| {
        let set = |part| {
            let mut set = PartSet::default();
            set.add_part(None, part);
            set
        };
        let options = DistanceOptions { a: set(a), b: Some(set(b)), max_distance };
        one.scene.state().distance(&options).expect("an answer")
    };
    let none = f64::INFINITY;
    assert_eq!(of(1, 2, none).map(|it| it.distance), Some(1.25), "containment does not count");
    assert_eq!(of(1, 3, none).map(|it| (it.distance, it.parts)), Some((5f64.sqrt(), [1, 3])));
    assert_eq!(of(3, 1, none).map(|it| (it.distance, it.parts)), Some((5f64.sqrt(), [3, 1])));
    let touch = of(1, 4, none).expect("two parts");
    assert_eq!((touch.distance, touch.error, touch.points[0].x), (0.0, 0.0, -2.0));
    assert_eq!(of(1, 1, none), None, "a part is not compared with itself");
    assert!(of(1, 2, 1.25).is_some() && of(1, 2, 1.2499).is_none() && of(1, 4, 0.0).is_some());
    // Of one set: the nearest two of its parts.
    let mut set = PartSet::default();
    [2, 3, 4].iter().for_each(|&part| set.add_part(None, part));
    let options = DistanceOptions { a: set, ..DistanceOptions::default() };
    let found = one.scene.state().distance(&options).expect("an answer").expect("parts");
    assert_eq!((found.distance, found.parts), (1.5, [2, 4]));
}

/// An airliner larger than the budget: the same answers by any number of threads; and what is answered without reading
/// holds the exact distance.
#[test]
fn budgets_threads_and_missing_blocks_do_not_matter() {
    let file = built::build_with(built::options(), |builder| {
        let options = GenerateOptions { triangles: 100_000, seed: 3, ..Default::default() };
        generate("airliner", &options, &Cancel::new(), builder).expect("an airliner");
    })
    .0;
    let open = |threads: usize, memory_budget: u64| {
        let options = ContextOptions { threads, memory_budget, read_ahead: false, ..ContextOptions::default() };
        let context = Context::new(options).expect("a context");
        let model = Model::open_cold(&context, &file.path).expect("it opens");
        let scene = Scene::new(&context);
        let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.3), DVec3::new(0.0, 40.0, 7.0));
        scene.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
        scene.add_instance(&model, 2, turned).expect("an instance");
        scene.commit().expect("a commit");
        (scene, model, context)
    };
    let (all, model, _context) = open(2, 0);
    let bounds = all.state().bounds();
    let mut rng = Rng::new(62);
    let points: Vec<DVec3> = (0..150).map(|_| rng.inside(bounds.min - 2.0, bounds.max + 2.0)).collect();
    // What a cold model says at once.
    let now = NearestOptions { policy: Policy::Now, ..NearestOptions::default() };
    let mut cold = vec![NearestPoint::MISS; points.len()];
    all.state().nearest(&points, &now, &mut cold).expect("an answer");
    let mut expected = cold.clone();
    let exact = NearestOptions { inside: true, ..NearestOptions::default() };
    all.state().nearest(&points, &exact, &mut expected).expect("an answer");
    assert!(cold.iter().all(|it| it.kind == HitKind::Missing && it.error.is_finite()), "nothing was in memory");
    let holds = |early: &NearestPoint, exact: &NearestPoint| {
        let [least, most] = early.bounds();
        least <= exact.distance + exact.error && exact.distance - exact.error <= most
    };
    assert!(cold.iter().zip(&expected).all(|(early, exact)| holds(early, exact)));
    let sets =
        |a: u64, b: u64| DistanceOptions { a: of_instance(a), b: Some(of_instance(b)), ..DistanceOptions::default() };
    let distance = all.state().distance(&sets(1, 2)).expect("an answer");
    let within = all.state().distance(&DistanceOptions::default()).expect("an answer");
    println!("{distance:?}, of all parts {within:?}");
    let bytes = model.memory().geometry;
    let mut early = 0;
    for (threads, budget) in [(0, bytes), (2, bytes * 3 / 4), (4, bytes * 11 / 20)] {
        let (scene, model, _context) = open(threads, budget);
        let mut found = vec![NearestPoint::MISS; points.len()];
        scene.state().nearest(&points, &exact, &mut found).expect("an answer");
        let differs = found.iter().zip(&expected).position(|(a, b)| a != b);
        assert_eq!(differs, None, "{threads} threads, {budget} bytes");
        assert!(model.memory().resident <= budget);
        // Some blocks are in memory now.
        scene.state().nearest(&points, &now, &mut found).expect("an answer");
        for (early, exact) in found.iter().zip(&expected) {
            assert!(holds(early, exact), "{early:?} {exact:?}");
        }
        early += found.iter().filter(|it| it.kind == HitKind::Missing && it.error > 0.0).count();
        assert_eq!(scene.state().distance(&sets(1, 2)).expect("an answer"), distance, "{threads}, {budget}");
        assert_eq!(
            scene.state().distance(&DistanceOptions::default()).expect("an answer"),
            within,
            "{threads}, {budget}"
        );
        assert!(model.memory().resident <= budget);
    }
    assert!(early > 0, "some answers were early");
}

/// A mesh of which the nearest points are corners and edges of many triangles.
#[test]
fn the_least_primitive_of_many_at_a_corner_counts() {
    let tris = scenes::polar(3, 64, |_, _| 1.0).into_iter().map(|t| t.map(rounded)).collect::<Vec<_>>();
    let one = world(vec![(vec![Part::white(1, tris)], vec![DAffine3::IDENTITY])], 2);
    let all = triangles(&one, DVec3::ZERO);
    let above: Vec<DVec3> = all.iter().flat_map(|it| it.3).map(|corner| corner * 1.5).collect();
    for (p, answer) in above.iter().zip(ask(&one, &above, &NearestOptions::default())) {
        let squared: Vec<f64> =
            all.iter().map(|it| point_triangle(DVec3::ZERO, &it.3.map(|v| v - *p)).squared).collect();
        let least = squared.iter().copied().fold(f64::INFINITY, f64::min);
        assert_eq!(Some(answer.prim as usize), squared.iter().position(|it| *it == least), "{p}");
    }
}
