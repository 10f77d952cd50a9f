//! Depths and kinds of clashes with a tolerance, against closed forms and dense samples.

use super::common::brute::Tri;
use super::common::built::{self, Part};
use super::common::models;
use super::common::rng::Rng;
use super::{World, cuboid, world};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::geom::point_triangle;
use outcrop::query::PartSet;
use outcrop::query::clash::{Clash, ClashDetail, ClashKind, ClashOptions};
use outcrop::scene::{Context, ContextOptions, Model, Scene};

const TOLERANCE: f64 = 1e-5;

fn pair(a: Vec<Tri>, b: Vec<Tri>, place: DAffine3) -> World {
    world(vec![(vec![Part::white(1, a), Part::white(2, b)], vec![place])], 0)
}

fn ask(world: &World, tolerance: f64) -> Vec<Clash> {
    world.clash(&ClashOptions { tolerance, ..ClashOptions::default() }).0
}

fn b(min: [f64; 3], max: [f64; 3]) -> Vec<Tri> {
    cuboid(DVec3::from(min), DVec3::from(max))
}

/// The triangles facing the other way.
fn turned(tris: &[Tri]) -> Vec<Tri> {
    tris.iter().map(|&[a, b, c]| [a, c, b]).collect()
}

/// Some places, each with the factor by which it scales lengths.
fn places() -> Vec<(DAffine3, f64)> {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 1.1);
    let mirror = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0));
    vec![
        (DAffine3::IDENTITY, 1.0),
        (DAffine3::from_rotation_translation(turn, DVec3::new(3.0, -7.0, 2.0)), 1.0),
        (DAffine3::from_translation(DVec3::new(1e7, -1e7, 5e6)), 1.0),
        (DAffine3 { matrix3: mirror * DMat3::from_quat(turn) * 4.0, translation: DVec3::new(1.0, 2.0, 3.0) }, 4.0),
    ]
}

/// A name, two solids, the kind and depth with a tolerance, and the kind without.
type Case = (&'static str, Vec<Tri>, Vec<Tri>, ClashKind, f64, ClashKind);

/// Pairs of solids, with the kind, the depth, and the kind without a tolerance.
#[test]
fn closed_forms() {
    use ClashKind::{Contained, Coplanar, Crossing, Duplicate, Hard, Piercing, Touching};
    let hollow = [b([0.0; 3], [4.0; 3]), turned(&b([1.0; 3], [3.0; 3]))].concat();
    let notch = [
        // A U: three boxes would have inner walls, so it is one outline, swept along z.
        prism(&[[0., 0.], [3., 0.], [3., 2.], [2., 2.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]], 1.0),
    ]
    .concat();
    let cases: Vec<Case> = vec![
        ("a box in a side", b([0.; 3], [2.; 3]), b([1.5, 0.5, 0.5], [3.5, 1.5, 1.5]), Hard, 0.5, Crossing),
        // Half the thickness: no pair of triangles crosses.
        ("aligned walls", b([0.; 3], [4.0, 0.25, 3.0]), b([3.0, 0., 0.], [7.0, 0.25, 3.0]), Hard, 0.125, Coplanar),
        ("stacked boxes", b([0.; 3], [2.; 3]), b([0.5, 0.5, 2.0], [1.5, 1.5, 3.0]), Touching, 0.0, Coplanar),
        ("an edge on an edge", b([0.; 3], [1.; 3]), b([1., 1., 0.], [2., 2., 1.]), Touching, 0.0, Touching),
        (
            "a rod in a plate",
            b([-0.125, -0.125, -1.], [0.125, 0.125, 1.]),
            b([-1., -1., -0.0625], [1., 1., 0.0625]),
            Piercing,
            0.125,
            Crossing,
        ),
        (
            "a rod in a block",
            b([-0.125, -0.125, -1.], [0.125, 0.125, 1.]),
            b([-1., -1., -3.], [1., 1., 0.]),
            Hard,
            1.0,
            Crossing,
        ),
        (
            "a crossing of walls",
            b([-4., 0., 0.], [4., 0.5, 3.]),
            b([0., -4., 0.], [0.5, 4., 3.]),
            Piercing,
            0.25,
            Crossing,
        ),
        ("a box in a box", b([-2.; 3], [2.; 3]), b([-0.5; 3], [0.5; 3]), Contained, 1.5, Contained),
        (
            "a box in a box, at a wall",
            b([-2.; 3], [2.; 3]),
            b([1.0, -0.5, -0.5], [2.0, 0.5, 0.5]),
            Contained,
            1.0,
            Coplanar,
        ),
        ("the same box", b([0.; 3], [2.; 3]), b([0.; 3], [2.; 3]), Duplicate, 0.0, Coplanar),
        ("a box in other triangles", b([0.; 3], [2.; 3]), refined(&b([0.; 3], [2.; 3])), Duplicate, 0.0, Coplanar),
        ("a box that fills a cavity", hollow.clone(), b([1.; 3], [3.; 3]), Touching, 0.0, Coplanar),
        ("a box in a notch", notch.clone(), b([1., 1., 0.], [2., 2., 1.]), Touching, 0.0, Coplanar),
        ("a box too wide for a notch", notch, b([0.75, 1.0, 0.25], [2.25, 2., 0.75]), Hard, 0.25, Crossing),
        ("a face inside out", turned(&b([0.; 3], [2.; 3])), b([1.5, 0.5, 0.5], [3.5, 1.5, 1.5]), Hard, 0.5, Crossing),
    ];
    for (name, one, two, kind, depth, surface) in &cases {
        for (k, (place, scale)) in places().into_iter().enumerate() {
            let name = format!("{name}, place {k}");
            let scene = pair(one.clone(), two.clone(), place);
            let found = ask(&scene, TOLERANCE);
            let [clash] = found[..] else { panic!("{name}: {found:?}") };
            assert_eq!(clash.kind, *kind, "{name}: {clash:?}");
            let (exact, rounding) = (depth * scale, if k == 2 { 1e-8 } else { 1e-12 });
            assert!(
                clash.depth <= exact + rounding && exact <= clash.depth + clash.error + rounding,
                "{name}: {clash:?}"
            );
            assert!(clash.error <= TOLERANCE + rounding, "{name}: {clash:?}");
            if clash.depth > TOLERANCE {
                let way = clash.points[0] - clash.points[1];
                assert!((way.length() - clash.depth).abs() <= 4.0 * rounding, "{name}: {clash:?}");
                assert!(clash.normal.distance(way.normalize()) < 1e-6, "{name}: {clash:?}");
            }
            // Planes stay planes if nothing is rounded.
            if [0, 2].contains(&k) {
                assert_eq!(ask(&scene, 0.0)[0].kind, *surface, "{name} without a tolerance");
            }
        }
    }
    let empty = pair(hollow, b([1.5; 3], [2.5; 3]), DAffine3::IDENTITY);
    assert!(ask(&empty, TOLERANCE).is_empty(), "a box in a cavity");
}

/// Each triangle divided at the middles of its edges.
fn refined(tris: &[Tri]) -> Vec<Tri> {
    tris.iter()
        .flat_map(|&[a, b, c]| {
            let (x, y, z) = ((a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5);
            [[a, x, z], [x, b, y], [z, y, c], [x, y, z]]
        })
        .collect()
}

/// An outline around the interior, counter-clockwise, swept along z. Its caps are fans of quadrilaterals of a U.
fn prism(outline: &[[f64; 2]; 8], height: f64) -> Vec<Tri> {
    let at = |i: usize, z: f64| DVec3::new(outline[i % 8][0], outline[i % 8][1], z);
    let sides = (0..8).flat_map(|i| {
        let [a, b, c, d] = [at(i, 0.0), at(i + 1, 0.0), at(i + 1, height), at(i, height)];
        [[a, b, c], [a, c, d]]
    });
    // Without corners within edges: the outline from above in ears.
    let ears = [[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]];
    let caps = ears.iter().flat_map(|&[a, b, c]| {
        let top = [at(a, height), at(b, height), at(c, height)];
        [top, [at(a, 0.0), at(c, 0.0), at(b, 0.0)]]
    });
    sides.chain(caps).collect()
}

/// A closed surface around zero: a sphere of rings, pushed in and out.
fn blob(rng: &mut Rng, rings: usize, size: f64) -> Vec<Tri> {
    let radii: Vec<f64> = (0..rings * 2 * rings + 2).map(|_| size * rng.between(0.75, 1.0)).collect();
    let at = |ring: usize, i: usize| {
        let (up, around) =
            (std::f64::consts::PI * ring as f64 / rings as f64, std::f64::consts::PI * i as f64 / rings as f64);
        let number = if ring == 0 {
            0
        } else if ring == rings {
            1
        } else {
            2 + (ring - 1) * 2 * rings + i % (2 * rings)
        };
        let dir = DVec3::new(up.sin() * around.cos(), up.sin() * around.sin(), up.cos());
        let dir = if ring == 0 || ring == rings { DVec3::Z * up.cos().signum() } else { dir };
        super::rounded(dir * radii[number])
    };
    let mut tris = Vec::new();
    for ring in 0..rings {
        for i in 0..2 * rings {
            // The last corner of a ring is its first one.
            let next = (i + 1) % (2 * rings);
            let [a, b, c, d] = [at(ring, i), at(ring + 1, i), at(ring + 1, next), at(ring, next)];
            if ring + 1 < rings {
                tris.push([a, b, c]);
            }
            if ring > 0 {
                tris.push([a, c, d]);
            }
        }
    }
    tris
}

/// How often a closed surface winds around a point, by solid angles (Van Oosterom, Strackee 1983).
fn winding(p: DVec3, tris: &[Tri]) -> f64 {
    let angle = |t: &Tri| {
        let [a, b, c] = t.map(|v| v - p);
        let [x, y, z] = [a.length(), b.length(), c.length()];
        2.0 * a.dot(b.cross(c)).atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y)
    };
    tris.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

fn distance(p: DVec3, tris: &[Tri]) -> f64 {
    tris.iter().map(|t| point_triangle(p, t).squared).fold(f64::INFINITY, f64::min).sqrt()
}

/// The greatest depth of sample points of each surface in the other.
fn sampled(rng: &mut Rng, sides: [&[Tri]; 2], each: usize) -> f64 {
    let mut deepest = 0.0f64;
    for of in 0..2 {
        for t in sides[of] {
            for i in 0..each + 3 {
                let (x, y) = (rng.between(0.0, 1.0), rng.between(0.0, 1.0));
                let (x, y) = if x + y > 1.0 { (1.0 - x, 1.0 - y) } else { (x, y) };
                let p = if i < 3 { t[i] } else { t[0] + (t[1] - t[0]) * x + (t[2] - t[0]) * y };
                let depth = distance(p, sides[1 - of]);
                if depth > deepest && winding(p, sides[1 - of]).abs() > 0.5 {
                    deepest = depth;
                }
            }
        }
    }
    deepest
}

#[test]
fn depths_are_those_of_dense_samples() {
    let mut rng = Rng::new(77);
    let (mut hard, mut other) = (0, 0);
    for round in 0..24 {
        let (a, b) = (blob(&mut rng, 5, 1.0), blob(&mut rng, 4, [1.0, 0.4][round % 2]));
        let at = |tris: &[Tri], place: &DAffine3| -> Vec<Tri> {
            tris.iter().map(|t| t.map(|p| place.transform_point3(p))).collect()
        };
        let mut turn = || DQuat::from_axis_angle(rng.direction(), 2.0);
        let stretch = DMat3::from_diagonal(DVec3::new(1.5, if round % 3 == 0 { -0.75 } else { 0.75 }, 1.0));
        let first = DAffine3 { matrix3: DMat3::from_quat(turn()) * stretch, translation: DVec3::ZERO };
        let turn = DMat3::from_quat(turn());
        let second = DAffine3 { matrix3: turn, translation: rng.direction() * rng.between(0.1, 1.7) };
        let scene = world(
            vec![(vec![Part::white(1, a.clone())], vec![first]), (vec![Part::white(2, b.clone())], vec![second])],
            0,
        );
        let sides = [at(&a, &first), at(&b, &second)];
        let deepest = sampled(&mut rng, [&sides[0], &sides[1]], 60);
        let found = ask(&scene, 1e-3);
        let Some(clash) = found.first() else {
            assert_eq!(deepest, 0.0, "round {round}");
            continue;
        };
        assert!(deepest <= clash.depth + clash.error + 1e-12, "round {round}: {deepest} {clash:?}");
        assert!(clash.error <= 1e-3 + 1e-9, "{clash:?}");
        // The depth is that of a point: it is on one surface and inside of the other, and the other point is on that.
        let [p, q] = clash.points;
        let is_deep = |p: DVec3, of: usize| {
            distance(p, &sides[of]) < 1e-9
                && winding(p, &sides[1 - of]).abs() > 0.5
                && (distance(p, &sides[1 - of]) - clash.depth).abs() < 1e-9
        };
        assert!(
            is_deep(p, 0) && distance(q, &sides[1]) < 1e-9 || is_deep(q, 1) && distance(p, &sides[0]) < 1e-9,
            "{clash:?}"
        );
        // The greatest sample is nearly as deep.
        assert!(deepest > clash.depth * 0.7 - 0.02, "round {round}: {deepest} {clash:?}");
        match clash.kind {
            ClashKind::Hard => hard += 1,
            _ => other += 1,
        }
    }
    println!("{hard} hard, {other} other");
    assert!(hard >= 6 && other >= 4);
}

/// Both orders of the sets, and both orders of the parts in the file.
#[test]
fn depths_do_not_depend_on_the_order() {
    let mut rng = Rng::new(5);
    let (a, b) = (blob(&mut rng, 5, 1.0), blob(&mut rng, 5, 0.8));
    let b: Vec<Tri> = b.iter().map(|t| t.map(|p| super::rounded(p + DVec3::new(0.9, 0.1, 0.2)))).collect();
    let set = |id| {
        let mut set = PartSet::default();
        set.add_part(None, id);
        set
    };
    let of = |first: u64, second: u64, is_turned: bool| {
        let mut parts = vec![Part::white(1, a.clone()), Part::white(2, b.clone())];
        if is_turned {
            parts.reverse();
        }
        let scene = world(vec![(parts, vec![DAffine3::IDENTITY])], 2);
        let options = ClashOptions { a: set(first), b: Some(set(second)), tolerance: 1e-4, ..ClashOptions::default() };
        let (found, _) = scene.clash(&options);
        assert_eq!((found.len(), found[0].parts), (1, [first, second]));
        found[0]
    };
    let expected = of(1, 2, false);
    assert_eq!(expected.kind, ClashKind::Hard);
    let turned = of(2, 1, false);
    assert_eq!((turned.depth, turned.error, turned.kind), (expected.depth, expected.error, expected.kind));
    assert_eq!(turned.points, [expected.points[1], expected.points[0]]);
    assert_eq!(turned.normal, -expected.normal);
    for (first, second) in [(1, 2), (2, 1)] {
        let other = of(first, second, true);
        assert!((other.depth - expected.depth).abs() <= 1e-4, "{other:?} {expected:?}");
    }
}

/// Blocks are read on demand, and the triangles of parts are kept in the budget. If those of two parts do not fit,
/// their depth is not known, and the search goes on.
#[test]
fn depths_do_not_depend_on_budgets_and_threads() {
    let ask = |file: &built::Built, threads: usize, memory_budget: u64| {
        let options = ContextOptions { threads, memory_budget, read_ahead: false, ..ContextOptions::default() };
        let context = Context::new(options).expect("a context");
        let model = Model::open_cold(&context, &file.path).expect("it opens");
        let scene = Scene::new(&context);
        scene.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        let options = ClashOptions { tolerance: 1e-3, ..ClashOptions::default() };
        let mut all = Vec::new();
        let take = &mut |clash: &Clash| all.push(*clash);
        scene.state().clash(&options, &Progress::default(), &Cancel::new(), take).expect("an answer");
        let memory = model.memory();
        assert!(memory_budget == 0 || memory.resident <= memory_budget);
        (all, memory.geometry)
    };
    let mut rng = Rng::new(31);
    let mut parts = Vec::new();
    for id in 0..50 {
        let (tris, at) = (blob(&mut rng, 18, 0.5), rng.direction() * rng.between(0.0, 2.5));
        parts.push(Part::white(id, tris.iter().map(|t| t.map(|p| super::rounded(p + at))).collect()));
    }
    // Most of the file is a part that is away from all others.
    let away = blob(&mut rng, 130, 1.0).iter().map(|t| t.map(|p| super::rounded(p + 9.0))).collect();
    parts.push(Part::white(999, away));
    let file = built::parts(&parts);
    let (expected, bytes) = ask(&file, 2, 0);
    let hard = expected.iter().filter(|clash| clash.kind >= ClashKind::Hard && clash.depth > 1e-3).count();
    println!("{hard} of {} are hard, {bytes} bytes of geometry", expected.len());
    assert!(hard > 50);
    for (threads, budget) in [(0, bytes), (4, bytes * 3 / 4)] {
        assert_eq!(ask(&file, threads, budget).0, expected, "{threads} threads, {budget} bytes");
    }
    let large = [blob(&mut rng, 70, 1.0), blob(&mut rng, 70, 1.1)];
    let file = built::parts(&[Part::white(1, large[0].clone()), Part::white(2, large[1].clone())]);
    let (found, bytes) = ask(&file, 2, 0);
    assert!(found.len() == 1 && found[0].kind >= ClashKind::Hard && found[0].depth > 0.01);
    let (found, _) = ask(&file, 2, bytes * 3 / 2);
    assert_eq!((found.len(), found[0].kind, found[0].depth), (1, ClashKind::Crossing, 0.0));
}

/// A surface with a border has no inside: such parts have no depth, and are named.
#[test]
fn open_parts_have_no_depth() {
    let open = b([0.; 3], [2.; 3])[2..].to_vec();
    let scene = pair(open, b([1.5, 0.5, 0.5], [3.5, 1.5, 1.5]), DAffine3::IDENTITY);
    let [clash] = ask(&scene, TOLERANCE)[..] else { panic!("one clash") };
    assert_eq!((clash.kind, clash.depth, clash.is_open), (ClashKind::Crossing, 0.0, [true, false]));
}

/// A model on itself, moved by a rounding.
#[test]
fn a_model_moved_by_a_rounding_is_a_duplicate() {
    let mut rng = Rng::new(9);
    let tris = blob(&mut rng, 8, 1.0);
    let moved = DAffine3::from_translation(DVec3::splat(f64::EPSILON));
    let turned = DAffine3::from_quat(DQuat::from_rotation_z(1e-9));
    for place in [DAffine3::IDENTITY, moved, turned] {
        let scene = world(vec![(vec![Part::white(1, tris.clone())], vec![DAffine3::IDENTITY, place])], 2);
        let [clash] = ask(&scene, 1e-6)[..] else { panic!("one clash") };
        assert_eq!(clash.kind, ClashKind::Duplicate, "{clash:?}");
        assert!(clash.depth <= 1e-8, "{clash:?}");
    }
}

/// Bolts in holes: their surfaces cross in many places, and none is deeper than 1e-5 of the diagonal.
#[test]
fn bolts_in_holes_touch() {
    let Some(path) = models::find("cad/as1_assembly.glb") else { return };
    let (file, _) = built::build_with(built::options(), |builder| builder.add_file(&path).expect("a mesh"));
    let (scene, model) = built::scene(&built::context(2), &file);
    let bounds = model.info().bounds;
    let tolerance = (bounds.max - bounds.min).length() * 1e-5;
    let ask = |options: &ClashOptions| {
        let mut found = Vec::new();
        let take = &mut |clash: &Clash| found.push(*clash);
        scene.state().clash(options, &Progress::default(), &Cancel::new(), take).expect("an answer");
        found
    };
    let found = ask(&ClashOptions { tolerance, ..ClashOptions::default() });
    assert_eq!(found.len(), 32);
    for clash in found {
        assert_eq!((clash.kind, clash.is_open), (ClashKind::Touching, [false; 2]), "{clash:?}");
        assert!(clash.error <= tolerance + 1e-9, "{clash:?}");
    }
    let all = ask(&ClashOptions { detail: ClashDetail::Triangles, ..ClashOptions::default() });
    let count = |kind| all.iter().filter(|clash| clash.kind == kind).count();
    assert_eq!(count(ClashKind::Crossing), 30_650);
}
