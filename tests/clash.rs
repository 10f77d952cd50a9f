//! Clashes, against brute force over all pairs of triangles by exact predicates.

mod common;
#[path = "clash/depths.rs"]
mod depths;
mod nearest;

use common::brute::Tri;
use common::built::{self, Part};
use common::rng::Rng;
use common::scenes::{self, rounded};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::geom::pairs::{Relation, relate};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::query::PartSet;
use outcrop::query::clash::{Clash, ClashDetail, ClashKind, ClashOptions, ClashRules, ClashSummary};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use std::collections::BTreeMap;

/// A box between two corners, 12 triangles that face outward.
fn cuboid(min: DVec3, max: DVec3) -> Vec<Tri> {
    let at = |i: usize| DVec3::new([min.x, max.x][i & 1], [min.y, max.y][i >> 1 & 1], [min.z, max.z][i >> 2]);
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).map(|t: [usize; 3]| t.map(at)).collect()
}

/// Instances, parts and primitive ids of a pair of triangles.
type PairIds = ([u64; 2], [u64; 2], [u64; 2]);

struct World {
    _context: Context,
    scene: Scene,
    /// For each instance its id, its placement and its parts.
    all: Vec<(u64, DAffine3, Vec<Part>)>,
}

/// One model for each list of parts, in one place each.
fn world(models: Vec<(Vec<Part>, Vec<DAffine3>)>, threads: usize) -> World {
    let context = built::context(threads);
    let scene = Scene::new(&context);
    let mut all = Vec::new();
    for (parts, places) in models {
        let file = built::parts(&parts);
        let model = Model::open(&context, &file.path).expect("it opens");
        for place in places {
            let id = 100 + all.len() as u64;
            scene.add_instance(&model, id, place).expect("an instance");
            let parts = parts.iter().map(|p| Part::white(p.id, p.tris.clone())).collect();
            all.push((id, place, parts));
        }
        // The file is read to its end: all of it is in memory.
        model.load(&Cancel::new()).expect("it loads");
    }
    scene.commit().expect("a commit");
    World { _context: context, scene, all }
}

impl World {
    fn clash(&self, options: &ClashOptions) -> (Vec<Clash>, ClashSummary) {
        let mut out = Vec::new();
        let summary = self
            .scene
            .state()
            .clash(options, &Progress::default(), &Cancel::new(), &mut |clash| out.push(*clash))
            .expect("an answer");
        assert_eq!(summary.clashes as usize, out.len());
        (out, summary)
    }

    /// All pairs of triangles of different parts that meet: parts with instances, indices, relation.
    fn brute(&self) -> BTreeMap<PairIds, Relation> {
        let mut tris = Vec::new();
        for (instance, place, parts) in &self.all {
            let mut prim = 0;
            for part in parts {
                for tri in &part.tris {
                    tris.push((*instance, part.id, prim, tri.map(|v| place.transform_point3(v))));
                    prim += 1;
                }
            }
        }
        let mut out = BTreeMap::new();
        for (i, a) in tris.iter().enumerate() {
            for b in &tris[i + 1..] {
                if (a.0, a.1) != (b.0, b.1) {
                    let relation = relate(&a.3, &b.3);
                    if relation != Relation::Apart {
                        out.insert(([a.0, b.0], [a.1, b.1], [a.2, b.2]), relation);
                    }
                }
            }
        }
        out
    }

    fn assert_equals_brute(&self, name: &str) -> usize {
        let options = ClashOptions { detail: ClashDetail::Triangles, ..ClashOptions::default() };
        let (clashes, summary) = self.clash(&options);
        assert!(!summary.is_cut);
        let meets = |kind| kind <= ClashKind::Touching;
        let found: BTreeMap<_, _> =
            clashes.iter().filter(|c| meets(c.kind)).map(|c| ((c.instances, c.parts, c.prims), c.kind)).collect();
        assert_eq!(found.len(), clashes.iter().filter(|c| meets(c.kind)).count(), "{name}: each pair once");
        let expected = self.brute();
        for (key, relation) in &expected {
            assert_eq!(found.get(key), Some(&kind_of(*relation)), "{name}: {key:?} {relation:?}");
        }
        assert_eq!(found.len(), expected.len(), "{name}");
        found.len()
    }
}

fn kind_of(relation: Relation) -> ClashKind {
    match relation {
        Relation::Crossing => ClashKind::Crossing,
        Relation::Coplanar => ClashKind::Coplanar,
        _ => ClashKind::Touching,
    }
}

fn soup(rng: &mut Rng, count: usize, size: f64, spread: f64) -> Vec<Tri> {
    (0..count)
        .map(|_| {
            let at = DVec3::new(rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), rng.between(-1.0, 1.0)) * spread;
            [0, 1, 2].map(|_| rounded(at + rng.direction() * size))
        })
        .filter(scenes::has_area)
        .collect()
}

#[test]
fn soups_equal_brute_force() {
    let mut rng = Rng::new(41);
    for threads in [0, 2] {
        let parts =
            || (1..=6).map(|id| Part::white(id, soup(&mut Rng::new(40 + id), 150, 0.25, 1.0))).collect::<Vec<_>>();
        let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.4), DVec3::new(0.1, 0.2, -0.1));
        let far = DAffine3::from_translation(DVec3::new(1e7, -1e7, 0.0));
        let mirrored = DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.5)),
            translation: DVec3::new(0.3, 0.0, 0.25),
        };
        let other = vec![Part::white(9, soup(&mut rng, 200, 0.25, 0.8))];
        let one = world(vec![(parts(), vec![DAffine3::IDENTITY])], threads);
        assert!(one.assert_equals_brute("parts of one mesh") > 500);
        let two = world(vec![(parts(), vec![DAffine3::IDENTITY, turned]), (other, vec![mirrored])], threads);
        assert!(two.assert_equals_brute("turned and mirrored") > 1000);
        let other = vec![Part::white(9, soup(&mut rng, 200, 0.25, 0.8))];
        let away = world(vec![(parts(), vec![far]), (other, vec![far])], threads);
        assert!(away.assert_equals_brute("far from zero") > 500);
    }
}

/// Boxes in a grid: faces, edges and corners in common, exactly.
#[test]
fn boxes_in_a_grid_touch_and_overlap_in_planes() {
    let at = |i: usize| DVec3::new((i % 3) as f64, (i / 3 % 3) as f64, (i / 9) as f64);
    let parts = (0..27).map(|i| Part::white(i as u64, cuboid(at(i), at(i) + 1.0))).collect();
    let grid = world(vec![(parts, vec![DAffine3::IDENTITY])], 2);
    grid.assert_equals_brute("a grid");
    let (clashes, _) = grid.clash(&ClashOptions::default());
    // Each box meets all of its up to 26 neighbours.
    let neighbours = (0..27).flat_map(|a| (a + 1..27).map(move |b| (a, b)));
    let expected = neighbours.filter(|&(a, b)| (at(a) - at(b)).abs().max_element() <= 1.0).count();
    assert_eq!(clashes.len(), expected);
}

#[test]
fn a_part_in_a_part_is_contained() {
    let shell = cuboid(DVec3::splat(-2.0), DVec3::splat(2.0));
    let inside = cuboid(DVec3::splat(-0.5), DVec3::splat(0.5));
    let beside = cuboid(DVec3::new(3.0, -0.5, -0.5), DVec3::new(4.0, 0.5, 0.5));
    let parts = vec![Part::white(1, shell), Part::white(2, inside), Part::white(3, beside)];
    let one = world(vec![(parts, vec![DAffine3::IDENTITY])], 0);
    let (clashes, summary) = one.clash(&ClashOptions::default());
    assert_eq!((clashes.len(), summary.pairs), (1, 1));
    assert_eq!((clashes[0].kind, clashes[0].parts), (ClashKind::Contained, [1, 2]));
    // The other way round, the first part is that of the first set.
    let mut set = PartSet::default();
    set.add_part(None, 2);
    let options = ClashOptions { a: set, b: Some(PartSet::all()), ..ClashOptions::default() };
    assert_eq!(one.clash(&options).0[0].parts, [2, 1]);
}

/// Ids that followed the order of both parts told a search with its sets exchanged, or with instances added in another
/// order, that all of its clashes were new.
#[test]
fn ids_do_not_depend_on_the_order_of_sets_and_instances() {
    let file = built::parts(&[Part::white(1, cuboid(DVec3::ZERO, DVec3::ONE))]);
    let context = built::context(0);
    let model = Model::open(&context, &file.path).expect("it opens");
    let place =
        |id: u64| DAffine3::from_translation(DVec3::new(id as f64 * 0.625, 0.25 * id as f64, 0.125 * id as f64));
    let ask = |order: [u64; 3], sets: [u64; 2], detail: ClashDetail| {
        let scene = Scene::new(&context);
        order.iter().for_each(|&id| scene.add_instance(&model, id, place(id)).expect("an instance"));
        scene.commit().expect("a commit");
        let [a, b] = sets.map(|id| {
            let mut set = PartSet::default();
            set.add_instance(id);
            set
        });
        let options = ClashOptions { a, b: Some(b), detail, ..ClashOptions::default() };
        let mut found = Vec::new();
        let take = &mut |clash: &Clash| found.push((clash.id(), clash.instances));
        scene.state().clash(&options, &Progress::default(), &Cancel::new(), take).expect("an answer");
        assert!(found.iter().all(|(_, instances)| *instances == sets), "the first is of the first set");
        let ids: std::collections::BTreeSet<u64> = found.iter().map(|(id, _)| *id).collect();
        assert_eq!(ids.len(), found.len(), "each clash has its own");
        ids
    };
    for (detail, least) in [(ClashDetail::Parts, 1), (ClashDetail::Triangles, 6)] {
        let expected = ask([1, 2, 3], [1, 2], detail);
        assert!(expected.len() >= least);
        for order in [[1, 2, 3], [3, 2, 1]] {
            for sets in [[1, 2], [2, 1]] {
                assert_eq!(ask(order, sets, detail), expected, "{order:?} {sets:?}");
            }
        }
        assert_ne!(ask([1, 2, 3], [2, 3], detail), expected, "other instances");
    }
}

#[test]
fn clearances_are_those_of_all_pairs() {
    let mut rng = Rng::new(43);
    let parts: Vec<Part> = (1..=8).map(|id| Part::white(id, soup(&mut rng, 20, 0.05, 0.5))).collect();
    let one = world(vec![(parts, vec![DAffine3::IDENTITY])], 2);
    for clearance in [0.0, 0.01, 0.05] {
        let (clashes, _) = one.clash(&ClashOptions { clearance, ..ClashOptions::default() });
        let parts = &one.all[0].2;
        for (i, a) in parts.iter().enumerate() {
            for b in &parts[i + 1..] {
                let all = a.tris.iter().flat_map(|x| b.tris.iter().map(move |y| (x, y)));
                let least = all
                    .map(|(x, y)| outcrop::geom::distances::triangle_triangle(x, y).squared.sqrt())
                    .fold(f64::INFINITY, f64::min);
                let found = clashes.iter().find(|c| c.parts == [a.id, b.id]);
                match found {
                    Some(c) if least == 0.0 => assert!(c.kind != ClashKind::Clearance),
                    Some(c) => {
                        assert_eq!(c.kind, ClashKind::Clearance);
                        assert!((c.distance - least).abs() <= c.error + 1e-12, "{} {least}", c.distance);
                        assert!((c.points[0].distance(c.points[1]) - least).abs() < 1e-9);
                    }
                    None => assert!(least > clearance, "{least} of {:?} is missed", [a.id, b.id]),
                }
            }
        }
    }
}

#[test]
fn rules_skip_pairs() {
    let at = |x: f64| cuboid(DVec3::new(x, 0.0, 0.0), DVec3::new(x + 1.5, 1.0, 1.0));
    let parts = || vec![Part::white(1, at(0.0)), Part::white(2, at(1.0)), Part::white(3, at(2.0))];
    let up = DAffine3::from_translation(DVec3::new(0.0, 0.5, 0.5));
    let both = world(vec![(parts(), vec![DAffine3::IDENTITY, up])], 0);
    let pairs = |rules: ClashRules| both.clash(&ClashOptions { rules, ..ClashOptions::default() }).1.pairs;
    let all = pairs(ClashRules::default());
    assert_eq!(all, 2 + 2 + 7);
    assert_eq!(pairs(ClashRules { same_instance: true, ..ClashRules::default() }), 7);
    assert_eq!(pairs(ClashRules { same_model: true, ..ClashRules::default() }), 0);
    assert_eq!(pairs(ClashRules { same_material: true, ..ClashRules::default() }), 0);
    assert_eq!(pairs(ClashRules { same_parent: true, ..ClashRules::default() }), 7);
    assert_eq!(pairs(ClashRules { pairs: vec![[2, 1]], ..ClashRules::default() }), all - 2 - 2);
}

/// Searches leave out pairs of places whose parts are not compared. More parts than the bits by which nodes know them:
/// each search finds exactly those clashes of a search for all whose parts it compares.
#[test]
fn sets_and_rules_only_leave_out() {
    let parts = || {
        let mut rng = Rng::new(47);
        (0..70)
            .map(|id| {
                let at = DVec3::new(rng.between(-0.7, 0.7), rng.between(-0.7, 0.7), rng.between(-0.7, 0.7));
                let tris = soup(&mut rng, 60, 0.15, 0.3).iter().map(|t| t.map(|v| rounded(v + at))).collect();
                Part::white(id, tris)
            })
            .collect::<Vec<_>>()
    };
    let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.4), DVec3::new(0.1, 0.2, -0.1));
    let scene = world(vec![(parts(), vec![DAffine3::IDENTITY, turned])], 2);
    let detail = ClashDetail::Triangles;
    let ask = |options: ClashOptions| {
        let (clashes, summary) = scene.clash(&ClashOptions { detail, clearance: 0.01, ..options });
        let mut key: Vec<_> = clashes
            .iter()
            .map(|c| {
                let side = |k: usize| (c.instances[k], c.parts[k], c.prims[k]);
                (side(0).min(side(1)), side(0).max(side(1)), c.kind, c.distance.to_bits(), c.count)
            })
            .collect();
        key.sort_unstable();
        (key, summary.steps)
    };
    let (all, all_steps) = ask(ClashOptions::default());
    assert!(all.len() > 10_000, "{}", all.len());
    let set = |parts: &[u64]| {
        let mut set = PartSet::default();
        parts.iter().for_each(|part| set.add_part(Some(100), *part));
        set
    };
    let has = |parts: &[u64], side: &(u64, u64, u64)| side.0 == 100 && parts.contains(&side.1);
    // Parts 3 and 35 have one bit, as have 1 and 65.
    for (a, b) in [(vec![3], vec![34, 35, 36, 65, 67]), (vec![1, 2, 3, 33], vec![65, 66]), (vec![5], (0..70).collect())]
    {
        let expected: Vec<_> =
            all.iter().filter(|c| has(&a, &c.0) && has(&b, &c.1) || has(&a, &c.1) && has(&b, &c.0)).copied().collect();
        let (found, steps) = ask(ClashOptions { a: set(&a), b: Some(set(&b)), ..ClashOptions::default() });
        assert!(!expected.is_empty());
        assert_eq!(found, expected, "{a:?} {b:?}");
        assert!(steps.triangles * 4 < all_steps.triangles, "{steps:?} of {all_steps:?}");
    }
    let rules = ClashRules { pairs: vec![[3, 35], [4, 5]], same_instance: true, ..ClashRules::default() };
    let is_skipped = |c: &(u64, u64)| [(3, 35), (35, 3), (4, 5), (5, 4)].contains(c);
    let expected: Vec<_> = all.iter().filter(|c| c.0.0 != c.1.0 && !is_skipped(&(c.0.1, c.1.1))).copied().collect();
    assert_eq!(ask(ClashOptions { rules, ..ClashOptions::default() }).0, expected);
}

#[test]
fn bad_sets_and_clearances_are_refused() {
    let one = world(vec![(vec![Part::white(1, cuboid(DVec3::ZERO, DVec3::ONE))], vec![DAffine3::IDENTITY])], 0);
    let state = one.scene.state();
    let fails = |options: ClashOptions, what: &str| {
        let error = state
            .clash(&options, &Progress::default(), &Cancel::new(), &mut |_| ())
            .expect_err("it is refused")
            .to_string();
        assert!(error.contains(what), "{error}");
    };
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        fails(ClashOptions { clearance: bad, ..ClashOptions::default() }, "clearance");
        fails(ClashOptions { tolerance: bad, ..ClashOptions::default() }, "tolerance");
    }
    fails(ClashOptions { a: PartSet::default(), ..ClashOptions::default() }, "empty");
    let mut set = PartSet::default();
    set.add_part(Some(100), 77);
    fails(ClashOptions { b: Some(set), ..ClashOptions::default() }, "part 77");
    let mut set = PartSet::default();
    set.add_instance(5);
    fails(ClashOptions { a: set, ..ClashOptions::default() }, "instance 5");
    let cancel = Cancel::new();
    cancel.cancel();
    assert!(matches!(
        state.clash(&ClashOptions::default(), &Progress::default(), &cancel, &mut |_| ()),
        Err(outcrop::base::error::Error::Cancelled)
    ));
}

/// A generated model with parts in and next to each other, larger than the budget: the same clashes, with blocks read
/// on demand, by any number of threads.
#[test]
fn budgets_and_threads_do_not_matter() {
    let file = built::build_with(built::options(), |builder| {
        let options = GenerateOptions { triangles: 100_000, seed: 3, ..Default::default() };
        generate("airliner", &options, &Cancel::new(), builder).expect("an airliner");
    })
    .0;
    let ask = |threads: usize, memory_budget: u64, detail: ClashDetail| {
        let options = ContextOptions { threads, memory_budget, read_ahead: false, ..ContextOptions::default() };
        let context = Context::new(options).expect("a context");
        let model = Model::open_cold(&context, &file.path).expect("it opens");
        let scene = Scene::new(&context);
        scene.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        let options = ClashOptions { detail, limit: 20_000, ..ClashOptions::default() };
        let mut all = Vec::new();
        let summary = scene
            .state()
            .clash(&options, &Progress::default(), &Cancel::new(), &mut |clash| all.push(*clash))
            .expect("an answer");
        assert!(memory_budget == 0 || model.memory().resident <= memory_budget);
        (all, summary, model.memory().geometry)
    };
    for detail in [ClashDetail::Parts, ClashDetail::Triangles] {
        let (expected, summary, bytes) = ask(2, 0, detail);
        assert!(expected.len() > 100, "{}", expected.len());
        println!("{} clashes of {} pairs of parts, {bytes} bytes of geometry", expected.len(), summary.pairs);
        for (threads, budget) in [(0, bytes), (2, bytes * 3 / 4), (0, bytes * 11 / 20), (4, bytes * 11 / 20)] {
            let (found, of_found, _) = ask(threads, budget, detail);
            assert_eq!(of_found, summary, "{threads} threads, {budget} bytes");
            let differs = found.iter().zip(&expected).find(|(a, b)| a != b);
            assert!(differs.is_none() && found.len() == expected.len(), "{threads}, {budget}: {differs:?}");
        }
    }
}

/// Assemblies of CAD systems that are stored as they are read: pairs of triangles equal brute force.
#[test]
fn assemblies_equal_brute_force() {
    for (name, least) in [("as1_assembly", 80_000), ("sheet_box_assembly", 0), ("franka_fer_arm", 0)] {
        let Some(path) = common::models::find(&format!("cad/{name}.glb")) else { return };
        let (file, _) = built::build_with(built::options(), |builder| builder.add_file(&path).expect("a mesh"));
        let (scene, model) = built::scene(&built::context(2), &file);
        let mut all: Vec<(u64, u64, Tri)> = Vec::new();
        for part in 0..model.parts().len() as u32 {
            let mut reader = model.read_part(part).expect("a part");
            loop {
                let some = reader.next(1 << 12, &Cancel::new()).expect("triangles");
                if some.is_empty() {
                    break;
                }
                all.extend(some.iter().map(|t| (t.part, t.prim, t.corners)));
            }
        }
        // Sorted along x: only triangles whose boxes overlap are compared.
        let bounds = |t: &Tri| (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
        let mut sorted: Vec<_> = all.iter().map(|it| (bounds(&it.2), it)).collect();
        sorted.sort_by(|a, b| a.0.0.x.total_cmp(&b.0.0.x));
        let mut expected = BTreeMap::new();
        for (i, ((low, high), a)) in sorted.iter().enumerate() {
            for (of_b, b) in sorted[i..].iter().take_while(|((least, _), _)| least.x <= high.x) {
                if a.0 != b.0 && low.cmple(of_b.1).all() && of_b.0.cmple(*high).all() {
                    let relation = relate(&a.2, &b.2);
                    if relation != Relation::Apart {
                        let (a, b) = if a.0 < b.0 { (a, b) } else { (b, a) };
                        expected.insert(([a.0, b.0], [a.1, b.1]), relation);
                    }
                }
            }
        }
        let options = ClashOptions { detail: ClashDetail::Triangles, limit: u64::MAX, ..ClashOptions::default() };
        let mut found = BTreeMap::new();
        let take = &mut |clash: &Clash| {
            if clash.kind <= ClashKind::Touching {
                let turned = clash.parts[1] < clash.parts[0];
                let sort = |[a, b]: [u64; 2]| if turned { [b, a] } else { [a, b] };
                found.insert((sort(clash.parts), sort(clash.prims)), clash.kind);
            }
        };
        scene.state().clash(&options, &Progress::default(), &Cancel::new(), take).expect("an answer");
        let count = |kind| found.values().filter(|&&it| it == kind).count();
        let [crossing, coplanar, touching] = [ClashKind::Crossing, ClashKind::Coplanar, ClashKind::Touching].map(count);
        println!("{name}: {crossing} crossing, {coplanar} coplanar, {touching} touching");
        assert!(found.len() >= least);
        let differs = expected.iter().find(|(key, relation)| found.get(key) != Some(&kind_of(**relation)));
        assert_eq!(differs, None, "{name}");
        assert_eq!(found.len(), expected.len(), "{name}");
    }
}

/// The pairs of places and of triangles that a search compares, with any number of threads: of two bumpy balls, of
/// parts of one mesh among each other, and of a ball and its copy beside it. A change of the builder or of the walks
/// changes them: look whether it is for the better, and write the new ones down.
#[test]
fn what_a_search_compares_is_pinned() {
    let ball = || vec![Part::white(1, scenes::bumpy_sphere(48, 96, 3))];
    let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.4), DVec3::new(0.3, 0.2, -0.1));
    let soups = || (1..=6).map(|id| Part::white(id, soup(&mut Rng::new(50 + id), 300, 0.08, 0.6))).collect();
    for threads in [0, 2] {
        let of = |parts: Vec<Part>, places: Vec<DAffine3>| {
            let (_, summary) = world(vec![(parts, places)], threads).clash(&ClashOptions::default());
            (summary.steps.places, summary.steps.triangles)
        };
        let found = [
            of(ball(), vec![DAffine3::IDENTITY, turned]),
            of(soups(), vec![DAffine3::IDENTITY]),
            of(ball(), vec![DAffine3::IDENTITY, DAffine3::from_translation(DVec3::X * 1.95)]),
        ];
        assert_eq!(found, PINNED, "{threads} threads");
    }
}

const PINNED: [(u64, u64); 3] = [(3715, 11183), (3407, 3212), (179, 556)];
