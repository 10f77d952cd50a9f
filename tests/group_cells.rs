//! Stand-ins for groups of instances, in scenes: what such a hit promises is checked in double precision against all
//! triangles, over arrays of trees in turned, mirrored and sheared scenes, near zero and far from it. Members that are
//! hidden or that have moved are not shown, and all kinds of queries and pictures find the same.

use crate::common::brute::{Oracle, Tri};
use crate::common::built::{self, Part};
use crate::common::bvh64::Bvh64;
use crate::common::promise::{Tally, ask, judge, with_cone};
use crate::common::rays::{RayKind, RayMaker};
use crate::common::rng::Rng;
use crate::common::scenes;
use crate::nested::{hits_of_a_picture, seen_from};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, Policy, QueryOptions};
use outcrop::scene::{Context, Instances, Look, Model, Place, Prototypes, Scene, SceneState, Transforms};
use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

/// Trees of a tile, and tiles.
pub const TREES: usize = 90;
pub const TILES: usize = 48;
/// Half the size of a tile, and the greatest size of a tree.
pub const HALF: f64 = 14.0;
const TREE: f64 = 3.0;
pub const FIRST_TREE: u64 = 100;
pub const FIRST_TILE: u64 = 1000;

/// Two kinds of trees: crowns on trunks, and crossed twigs.
fn kinds() -> [Vec<Tri>; 2] {
    let moved = |tris: Vec<Tri>, by: DVec3| tris.into_iter().map(move |tri| tri.map(|v| v * 0.5 + by));
    let crown = moved(scenes::bumpy_sphere(5, 7, 3), DVec3::new(0.0, 0.0, 1.2));
    let trunk = scenes::cuboid(DVec3::new(-0.08, -0.08, 0.0), DVec3::new(0.08, 0.08, 0.9));
    let twigs = scenes::wires(9, 4, 7).flatten().map(|tri| tri.map(|v| scenes::rounded(v * 0.9)));
    [crown.chain(trunk).map(|tri| tri.map(scenes::rounded)).collect(), twigs.collect()]
}

/// Tiles of trees, tilted and otherwise changed, in a scene.
pub struct Forest {
    kinds: [Vec<Tri>; 2],
    pub tile: Scene,
    pub scene: Scene,
    /// The kinds and the places of the trees of a tile, and the places of the tiles.
    trees: Vec<(usize, DAffine3)>,
    tiles: Vec<DAffine3>,
    _files: Vec<built::Built>,
}

fn turned(rng: &mut Rng) -> DQuat {
    DQuat::from_axis_angle((DVec3::Z + rng.direction() * 0.4).normalize(), rng.between(0.0, 6.0))
}

fn array(prototypes: Prototypes, prototype_of: Vec<u32>, transforms: Transforms, first_id: u64) -> Instances {
    Instances {
        prototypes,
        prototype_of: Arc::from(prototype_of),
        transforms,
        first_id,
        mask: u32::MAX,
        masks: None,
        tints: None,
    }
}

impl Forest {
    pub fn around(context: &Context, middle: DVec3) -> Self {
        let mut rng = Rng::new(9);
        let kinds = kinds();
        let files: Vec<built::Built> = (1..)
            .zip(&kinds)
            .map(|(id, tris)| {
                let (low, high) = tris.split_at(tris.len() / 2);
                built::parts(&[Part::white(id, low.to_vec()), Part::white(id + 10, high.to_vec())])
            })
            .collect();
        let models: Vec<Model> = files.iter().map(|it| Model::open(context, &it.path).expect("a model")).collect();
        models.iter().for_each(|it| assert!(it.load(&Cancel::new()).expect("it loads")));
        let places: Vec<(usize, Place)> = (0..TREES)
            .map(|_| {
                let at = rng.inside(DVec3::new(-HALF, -HALF, 0.0), DVec3::new(HALF, HALF, 0.2));
                let turn = turned(&mut rng).as_quat().normalize().to_array();
                (rng.below(2), Place { position: at, rotation: turn, scale: rng.between(0.6, 1.2) as f32 })
            })
            .collect();
        let tile = Scene::new(context);
        let of_kinds = places.iter().map(|it| it.0 as u32).collect();
        let transforms = Transforms::Places(places.iter().map(|it| it.1).collect());
        tile.add_instances(&array(models.into(), of_kinds, transforms, FIRST_TREE)).expect("trees");
        tile.commit().expect("a commit");
        let map = |place: &Place| {
            let [x, y, z, w] = place.rotation.map(f64::from);
            let turn = DQuat::from_xyzw(x, y, z, w).normalize();
            DAffine3::from_scale_rotation_translation(DVec3::splat(place.scale.into()), turn, place.position)
        };
        let trees = places.iter().map(|(kind, place)| (*kind, map(place))).collect();
        let side = (TILES as f64).sqrt().ceil() as usize;
        let tiles: Vec<DAffine3> = (0..TILES)
            .map(|i| {
                let at = DVec3::new((i % side) as f64, (i / side) as f64, 0.0) * (2.0 * HALF);
                let mirror = DVec3::new(if i % 5 == 0 { -1.0 } else { 1.0 }, rng.between(0.8, 1.3), 1.0);
                let shear = if i % 4 == 1 { DVec3::new(0.2, 1.0, 0.1) } else { DVec3::Y };
                let linear = DMat3::from_quat(turned(&mut rng))
                    * DMat3::from_cols(DVec3::X, shear, DVec3::Z)
                    * DMat3::from_diagonal(mirror);
                DAffine3 { matrix3: linear, translation: middle + at }
            })
            .collect();
        let scene = Scene::new(context);
        let transforms = Transforms::Affine(tiles.clone().into());
        let of_tiles = array(Prototypes::Scenes(vec![tile.clone()]), Vec::new(), transforms, FIRST_TILE);
        scene.add_instances(&of_tiles).expect("tiles");
        scene.commit().expect("a commit");
        Self { kinds, tile, scene, trees, tiles, _files: files }
    }

    /// The triangles of all trees but those at the indices of `hidden`, tile by tile.
    pub fn oracle(&self, hidden: &HashSet<usize>) -> Bvh64 {
        let mut tris = Vec::new();
        for (i, at) in self.tiles.iter().enumerate() {
            for (j, (kind, place)) in self.trees.iter().enumerate() {
                if !hidden.contains(&(i * TREES + j)) {
                    let map = *at * *place;
                    tris.extend(self.kinds[*kind].iter().map(|tri| tri.map(|v| map.transform_point3(v))));
                }
            }
        }
        Bvh64::new(tris)
    }

    pub fn middle(&self) -> DVec3 {
        self.tiles.iter().map(|it| it.translation).sum::<DVec3>() / TILES as f64
    }

    /// Rays with cones from about the scene, near it and far from it, some of them toward surfaces.
    pub fn rays(&self, oracle: &Bvh64, count: usize, poe: f32) -> Vec<Ray> {
        let (mut rng, reach) = (Rng::new(poe.to_bits().into()), HALF * 8.0);
        let far = |rng: &mut Rng| self.middle() + (rng.direction() + DVec3::Z * 0.3) * rng.between(1.5, 9.0) * reach;
        let from_afar = (0..count).map(|i| {
            let (eye, tri) = (far(&mut rng), oracle.tris()[rng.below(oracle.tris().len())]);
            let to = tri[0] + rng.direction() * if i % 3 == 0 { TREE } else { 0.0 };
            let dir = (to - eye).normalize().as_vec3();
            let width = 0.7 / 300.0 * f64::from(poe).sqrt();
            let cone = outcrop::math::Cone { a: 0.0, b: width as f32 };
            Ray { cone, ..Ray::new(eye, dir) }
        });
        let from_afar: Vec<Ray> = from_afar.collect();
        let made = RayMaker::new(oracle.tris(), 7).batch(count / 2);
        let made = made.iter().filter(|ray| ray.kind != RayKind::Tiny).enumerate();
        made.map(|(i, ray)| with_cone(ray, i, poe, reach)).chain(from_afar).collect()
    }
}

/// The hits of rays, which are those of the same rays in packets and alone.
fn hits_of(state: &SceneState, rays: &[Ray]) -> Vec<Hit> {
    let hits = ask(state, rays, false, Policy::Exact);
    for (i, (hit, other)) in hits.iter().zip(ask(state, rays, true, Policy::Exact)).enumerate() {
        assert_eq!(*hit, other, "packets see otherwise: {:?}", rays[i]);
    }
    for (ray, hit) in rays.iter().zip(&hits).step_by(5) {
        assert_eq!(*hit, ask(state, &[*ray], false, Policy::Exact)[0], "alone the ray sees otherwise: {ray:?}");
    }
    hits
}

/// What stands in is a group if its error is greater than a tree.
pub fn is_group(hit: &Hit) -> bool {
    hit.kind == HitKind::Lod && hit.error > TREE as f32
}

/// Judges many rays; returns the hits on groups.
pub fn check(name: &str, forest: &Forest, hidden: &HashSet<usize>, count: usize) -> Vec<Hit> {
    check_with_mask(name, forest, hidden, count, u32::MAX)
}

/// [`check`] for rays with a mask.
pub fn check_with_mask(name: &str, forest: &Forest, hidden: &HashSet<usize>, count: usize, mask: u32) -> Vec<Hit> {
    let (oracle, state, mut groups) = (forest.oracle(hidden), forest.scene.state(), Vec::<Hit>::new());
    for poe in [1.0, 10.0, 60.0, 400.0] {
        let rays: Vec<Ray> = forest.rays(&oracle, count, poe).iter().map(|ray| Ray { mask, ..*ray }).collect();
        let (hits, mut tally) = (hits_of(&state, &rays), Tally::default());
        rays.iter().zip(&hits).for_each(|(ray, hit)| judge(&oracle, ray, hit, &mut tally));
        let before = groups.len();
        groups.extend(hits.iter().copied().filter(is_group));
        tally.slack.sort_by(f64::total_cmp);
        let Tally { exact, lod, misses, transmitted, slack, .. } = tally;
        let median = slack.get(slack.len() / 2).copied().unwrap_or(0.0);
        let of_groups = groups.len() - before;
        println!(
            "{name}, PoE {poe}: {exact} exact, {lod} stand-ins, {of_groups} of groups, {misses} misses, \
             {transmitted} behind stand-ins; stated over true error: median {median:.1}"
        );
    }
    for hit in &groups {
        let (path, _) = state.path(hit.occurrence).expect("a way");
        assert_eq!((path.len(), path[0]), (2, hit.instance));
        let at = (path[0] - FIRST_TILE) as usize * TREES + (path[1] - FIRST_TREE) as usize;
        assert!(!hidden.contains(&at), "{hit:?} shows a hidden tree");
        let kind = forest.trees[at % TREES].0 as u64 + 1;
        assert!([kind, kind + 10].contains(&hit.part), "{hit:?} is of kind {kind}");
    }
    groups
}

pub fn rays_of_a_setting() -> usize {
    built::sized(6000, 300)
}

#[test]
fn groups_keep_the_promise() {
    let context = built::context(2);
    let forest = Forest::around(&context, DVec3::ZERO);
    let groups = check("near", &forest, &HashSet::new(), rays_of_a_setting());
    assert!(groups.len() > 3000, "{} hits on groups", groups.len());
    let shown: BTreeMap<u64, usize> = groups.iter().fold(BTreeMap::new(), |mut all, hit| {
        *all.entry(hit.occurrence).or_default() += 1;
        all
    });
    assert!(shown.len() > 50, "groups show {} occurrences", shown.len());
}

#[test]
fn groups_far_from_zero_keep_the_promise() {
    let context = built::context(2);
    let forest = Forest::around(&context, DVec3::new(1e7, -2e7, 3e6));
    let groups = check("far", &forest, &HashSet::new(), rays_of_a_setting() / 2);
    assert!(groups.len() > 1000, "{} hits on groups", groups.len());
}

/// Rays that begin or end at a hit on a group, or close to it, find what lies in their intervals, also if that is
/// beside the group's stand-in.
#[test]
fn intervals_that_end_at_groups_hold() {
    let context = built::context(2);
    let forest = Forest::around(&context, DVec3::ZERO);
    let (oracle, state) = (forest.oracle(&HashSet::new()), forest.scene.state());
    let (mut rays, mut tally) = (Vec::new(), Tally::default());
    for poe in [60.0, 400.0] {
        let all = forest.rays(&oracle, rays_of_a_setting() / 6, poe);
        for (ray, hit) in all.iter().zip(hits_of(&state, &all)).filter(|it| is_group(&it.1)) {
            let far = f64::INFINITY;
            for (t_min, t_max) in [
                (0.0, hit.t.next_down()),
                (0.0, hit.t * (1.0 - 1e-6)),
                (hit.t.next_up(), far),
                (hit.t * (1.0 + 1e-6), far),
            ] {
                rays.push(Ray { t_min, t_max, ..*ray });
            }
        }
    }
    assert!(rays.len() > built::sized(1000, 50), "{} rays", rays.len());
    let hits = hits_of(&state, &rays);
    rays.iter().zip(&hits).for_each(|(ray, hit)| judge(&oracle, ray, hit, &mut tally));
    let mut any = vec![0; rays.len()];
    state.any(&rays, QueryOptions::default(), &mut any).expect("hits");
    for ((ray, hit), any) in rays.iter().zip(&hits).zip(any) {
        assert_eq!(hit.kind != HitKind::Miss, any != 0, "{ray:?}: {hit:?}");
    }
    let Tally { exact, lod, misses, .. } = tally;
    println!("{exact} exact, {lod} stand-ins, {misses} misses");
    assert!(exact > 0 && lod > 0 && misses > 0);
}

/// A ray with a mask of 0 hits nothing, however wide it is.
#[test]
fn rays_without_a_mask_hit_no_group() {
    let context = built::context(2);
    let forest = Forest::around(&context, DVec3::ZERO);
    let oracle = forest.oracle(&HashSet::new());
    let rays: Vec<Ray> =
        forest.rays(&oracle, 800, 400.0).into_iter().map(|ray| Ray { mask: 0, ..ray }).take(1024).collect();
    for count in [1, 16, 1024] {
        for coherent in [false, true] {
            let hits = ask(&forest.scene.state(), &rays[..count], coherent, Policy::Exact);
            assert!(hits.iter().all(|hit| hit.kind == HitKind::Miss));
        }
    }
}

/// Members that are hidden, in all places of their scene or in one, are in no group that stands in.
#[test]
fn hidden_members_are_not_shown() {
    let context = built::context(2);
    let forest = Forest::around(&context, DVec3::ZERO);
    let (gone, mut hidden) = (Look { visible: false, ..Look::default() }, HashSet::new());
    // Trees of all tiles, a tile, and trees of one tile.
    for tree in [3, 40, 41] {
        forest.tile.set_instance_look(FIRST_TREE + tree as u64, gone).expect("a look");
        hidden.extend((0..TILES).map(|tile| tile * TREES + tree));
    }
    forest.tile.commit().expect("a commit");
    forest.scene.commit().expect("a commit");
    check("hidden in all tiles", &forest, &hidden, rays_of_a_setting() / 6);
    forest.scene.set_instance_look(FIRST_TILE + 20, gone).expect("a look");
    hidden.extend((0..TREES).map(|tree| 20 * TREES + tree));
    for tree in (0..TREES).step_by(2) {
        // Occurrences have their numbers tile by tile.
        let occurrence = (31 * TREES + tree) as u64;
        forest.scene.set_occurrence_look(occurrence, gone).expect("the look of an occurrence");
        hidden.insert(31 * TREES + tree);
    }
    forest.scene.commit().expect("a commit");
    let groups = check("hidden", &forest, &hidden, rays_of_a_setting());
    assert!(groups.len() > 1000, "{} hits on groups", groups.len());
}

/// Groups from which members have moved away do not stand in, in the places where they were and are.
#[test]
fn moved_members_are_met_where_they_are() {
    let context = built::context(2);
    let mut forest = Forest::around(&context, DVec3::ZERO);
    for tile in [5, 17] {
        let lifted = DAffine3::from_translation(DVec3::new(3.0, -2.0, 9.0)) * forest.tiles[tile];
        forest.tiles[tile] = lifted;
        forest.scene.set_transforms(FIRST_TILE + tile as u64, &Transforms::Affine([lifted].into())).expect("a move");
    }
    forest.scene.commit().expect("a commit");
    let groups = check("moved", &forest, &HashSet::new(), rays_of_a_setting());
    assert!(groups.len() > 1000, "{} hits on groups", groups.len());
}

/// Pictures show in each pixel the hit that a query with the pixel's ray returns, on groups too.
#[test]
fn pictures_show_the_groups_of_queries() {
    let context = built::context(2);
    let forest = Forest::around(&context, DVec3::ZERO);
    let (state, middle) = (forest.scene.state(), forest.middle());
    let mut groups = 0;
    for (away, poe) in [(1.0, 30.0), (2.0, 30.0), (4.0, 60.0)] {
        let eye = middle + DVec3::new(0.3, -1.0, 0.8) * HALF * 8.0 * away;
        let hits = hits_of_a_picture(&context, &state, &seen_from(eye, middle, 40.0), poe);
        groups += hits.iter().filter(|hit| is_group(hit)).count();
    }
    assert!(groups > 500, "{groups} pixels show groups");
}
