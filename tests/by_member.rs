//! Masks and tints of the members of arrays, against the same instances added one by one with these masks and with
//! looks in the tinted colours: hits and pictures are equal to the bit, also after ranges were set anew. For members
//! that are scenes they are equal up to rounding.

use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::base::error::Error;
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Background, Camera, Context, Instances, Look, Model, Prototypes, Scene, SceneState, Transforms};
use std::sync::Arc;
use std::time::Duration;

const FIRST: u64 = 50;
/// Number of members, over several pages.
const COUNT: usize = 600;
/// The mask of all members together.
const ALL: u32 = 0b1111;
const COLOUR: [f32; 4] = [0.75, 0.5, 0.25, 1.0];

/// What is set for a member by itself.
const OWN: Look = Look { visible: true, colour: Some([0.1, 0.9, 0.3, 0.7]), selected: false };

type Tint = [u8; 4];

/// What the members of an array are.
#[derive(Clone)]
struct Members {
    maps: Vec<DAffine3>,
    masks: Vec<u32>,
    tints: Vec<Tint>,
}

impl Members {
    fn new(count: usize, reach: f64, rng: &mut Rng) -> Self {
        let map = |rng: &mut Rng| {
            let turn = DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0));
            let scale = DVec3::splat(rng.between(0.4, 1.0));
            let at = rng.inside(DVec3::splat(-reach), DVec3::splat(reach));
            DAffine3::from_scale_rotation_translation(scale, turn, at)
        };
        Self {
            maps: (0..count).map(|_| map(rng)).collect(),
            masks: (0..count).map(|_| mask(rng)).collect(),
            tints: (0..count).map(|_| tint(rng)).collect(),
        }
    }

    fn instances(&self, prototypes: Prototypes, has_lists: bool) -> Instances {
        Instances {
            prototypes,
            prototype_of: Arc::new([]),
            transforms: Transforms::Affine(self.maps.clone().into()),
            first_id: FIRST,
            mask: ALL,
            masks: has_lists.then(|| self.masks.clone().into()),
            tints: has_lists.then(|| self.tints.clone().into()),
        }
    }
}

fn mask(rng: &mut Rng) -> u32 {
    if rng.one_in(4) { u32::MAX } else { rng.below(32) as u32 }
}

/// Many have none, some are see-through.
fn tint(rng: &mut Rng) -> Tint {
    if rng.one_in(3) {
        return [255; 4];
    }
    let alpha = if rng.one_in(5) { 100 + rng.below(100) as u8 } else { 255 };
    [rng.below(256) as u8, rng.below(256) as u8, rng.below(256) as u8, alpha]
}

/// A colour times the product of tints.
fn tinted(tints: &[Tint]) -> [f32; 4] {
    let factor = |tint: &Tint, i: usize| f32::from(tint[i]) / 255.0;
    std::array::from_fn(|i| COLOUR[i] * tints.iter().map(|tint| factor(tint, i)).fold(1.0, |a, b| a * b))
}

fn model(context: &Context) -> (built::Built, Model) {
    let material =
        MaterialDesc { colour: [COLOUR[0], COLOUR[1], COLOUR[2]], opacity: COLOUR[3], metalness: 0.0, roughness: 1.0 };
    let file = built::parts(&[Part { id: 5, material, tris: scenes::bumpy_sphere(8, 12, 3) }]);
    let model = Model::open(context, &file.path).expect("a model");
    (file, model)
}

/// The look of a member that is an instance by itself.
fn look(tints: &[Tint]) -> Look {
    Look { colour: Some(tinted(tints)), ..Look::default() }
}

/// The members one by one.
fn alone(context: &Context, model: &Model, members: &Members) -> Scene {
    let scene = Scene::new(context);
    for (i, (map, (mask, tint))) in members.maps.iter().zip(members.masks.iter().zip(&members.tints)).enumerate() {
        let id = FIRST + i as u64;
        scene.add_instance(model, id, *map).expect("an instance");
        scene.set_instance_mask(id, mask & ALL).expect("a mask");
        scene.set_instance_look(id, look(&[*tint])).expect("a look");
    }
    scene
}

fn rays(count: usize, reach: f64) -> Vec<Ray> {
    let mut rng = Rng::new(count as u64);
    (0..count)
        .map(|i| {
            let from = rng.direction() * reach * rng.between(0.5, 3.0);
            let to = rng.inside(DVec3::splat(-reach), DVec3::splat(reach));
            let mask = [u32::MAX, 1, 2, 4, 8, 6, 16, 0][i % 8];
            Ray { mask, ..Ray::new(from, (to - from).as_vec3().normalize()) }
        })
        .collect()
}

fn closest(state: &SceneState, rays: &[Ray], coherent: bool) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    state.closest(rays, QueryOptions { coherent, ..QueryOptions::default() }, &mut hits).expect("hits");
    hits
}

/// What rays find in streams, in packets and alone, closest and any; a picture with all buffers.
struct Answers {
    hits: Vec<Vec<Hit>>,
    any: Vec<u8>,
    picture: Vec<Vec<u8>>,
}

fn picture(context: &Context, state: &Arc<SceneState>, reach: f64) -> Vec<Vec<u8>> {
    let options = FrameOptions { width: 56, height: 42, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options).expect("a frame");
    let eye = DVec3::new(0.3, -3.0, 1.0) * reach;
    let camera = Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 35.0 };
    frame.request(state, &camera, &FrameSettings { samples: 2, ..FrameSettings::default() }).expect("a request");
    assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
    Buffer::ALL.iter().map(|&buffer| frame.map(buffer).expect("a buffer").bytes().to_vec()).collect()
}

fn answers(context: &Context, state: &Arc<SceneState>, reach: f64) -> Answers {
    let rays = rays(700, reach);
    let mut hits: Vec<Vec<Hit>> = [false, true].map(|coherent| closest(state, &rays, coherent)).into();
    // Rays of one mask are in packets and streams together.
    for mask in [u32::MAX, 6] {
        let alike: Vec<Ray> = rays.iter().map(|ray| Ray { mask, ..*ray }).collect();
        hits.extend([false, true].map(|coherent| closest(state, &alike, coherent)));
    }
    hits.push(rays.iter().take(100).map(|ray| closest(state, std::slice::from_ref(ray), false)[0]).collect());
    let mut any = vec![0; rays.len()];
    state.any(&rays, QueryOptions::default(), &mut any).expect("hits");
    Answers { hits, any, picture: picture(context, state, reach) }
}

fn assert_equal(a: &Answers, b: &Answers, what: &str) {
    for (i, (a, b)) in a.hits.iter().zip(&b.hits).enumerate() {
        let met = a.iter().filter(|hit| hit.kind != HitKind::Miss).count();
        assert!(met > a.len() / 20, "{what}, rays {i}: {met} hits");
        let differs = a.iter().zip(b).position(|(a, b)| a != b);
        assert!(differs.is_none(), "{what}, rays {i}: {:?} {:?}", a[differs.unwrap()], b[differs.unwrap()]);
    }
    assert!(a.any == b.any, "{what}: any");
    for (buffer, (a, b)) in Buffer::ALL.iter().zip(a.picture.iter().zip(&b.picture)) {
        assert!(a == b, "{what}: the buffer {buffer:?} differs");
    }
}

/// Members have the masks and the colours of instances that were added one by one; looks that are set for a member
/// replace its tinted colour, and a mask its own.
#[test]
fn members_have_masks_and_tints_of_their_own() {
    let context = built::context(2);
    let (_file, model) = model(&context);
    let (members, reach) = (Members::new(COUNT, 9.0, &mut Rng::new(5)), 9.0);
    let array = Scene::new(&context);
    array.add_instances(&members.instances(vec![model.clone()].into(), true)).expect("instances");
    let one_by_one = alone(&context, &model, &members);
    for round in 0..2 {
        [&array, &one_by_one].iter().for_each(|scene| scene.commit().expect("a commit"));
        let [a, b] = [&array, &one_by_one].map(|scene| answers(&context, &scene.state(), reach));
        assert_equal(&a, &b, &format!("round {round}"));
        for id in (FIRST..FIRST + COUNT as u64 - 1).step_by(7) {
            for scene in [&array, &one_by_one] {
                scene.set_instance_look(id, OWN).expect("a look");
                scene.set_instance_mask(id + 1, 5).expect("a mask");
            }
        }
    }
}

/// Ranges of masks and tints are set anew, few and many, in arrays with and without such lists. Each commit answers as
/// a new scene does. A state that is held meanwhile answers as before.
#[test]
fn ranges_of_masks_and_tints_are_set_anew() {
    let context = built::context(2);
    let (_file, model) = model(&context);
    let mut rng = Rng::new(8);
    for has_lists in [false, true] {
        let (mut members, reach) = (Members::new(COUNT, 9.0, &mut Rng::new(6)), 9.0);
        let array = Scene::new(&context);
        array.add_instances(&members.instances(vec![model.clone()].into(), has_lists)).expect("instances");
        if !has_lists {
            (members.masks, members.tints) = (vec![u32::MAX; COUNT], vec![[255; 4]; COUNT]);
        }
        array.commit().expect("a commit");
        let mut held = None;
        for range in [3..4, 500..530, 0..COUNT, COUNT - 1..COUNT] {
            let masks: Vec<u32> = range.clone().map(|_| mask(&mut rng)).collect();
            let tints: Vec<Tint> = range.clone().map(|_| tint(&mut rng)).collect();
            let first = FIRST + range.start as u64;
            array.set_masks(first, &masks).expect("masks");
            array.set_tints(first, &tints).expect("tints");
            members.masks[range.clone()].copy_from_slice(&masks);
            members.tints[range.clone()].copy_from_slice(&tints);
            array.commit().expect("a commit");
            let new = alone(&context, &model, &members);
            new.commit().expect("a commit");
            let [a, b] = [&array, &new].map(|scene| answers(&context, &scene.state(), reach));
            assert_equal(&a, &b, &format!("{range:?}, lists: {has_lists}"));
            if let Some((state, before)) = held.replace((array.state(), a)) {
                assert_equal(&answers(&context, &state, reach), &before, &format!("held at {range:?}"));
            }
        }
        // A mask of an instance is replaced by the next of a range, and the other way round.
        array.set_instance_mask(FIRST + 9, 1).expect("a mask");
        array.set_masks(FIRST + 8, &[2, 4]).expect("masks");
        array.set_instance_mask(FIRST + 8, 8).expect("a mask");
        (members.masks[8], members.masks[9]) = (8, 4);
        array.commit().expect("a commit");
        let new = alone(&context, &model, &members);
        new.commit().expect("a commit");
        let [a, b] = [&array, &new].map(|scene| answers(&context, &scene.state(), reach));
        assert_equal(&a, &b, "masks of instances");
    }
}

/// Scenes as members: the masks and tints of all levels hold together, for singles, arrays and scenes of one instance.
#[test]
fn masks_and_tints_of_all_levels_hold_together() {
    let context = built::context(2);
    let (_file, model) = model(&context);
    let mut rng = Rng::new(15);
    let inner = Members::new(12, 2.0, &mut rng);
    let tile = Scene::new(&context);
    tile.add_instances(&inner.instances(vec![model.clone()].into(), true)).expect("instances");
    tile.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
    tile.set_instance_look(7 + FIRST, OWN).expect("a look");
    let lone = Scene::new(&context);
    let of_one = Members { maps: vec![DAffine3::IDENTITY], masks: vec![6], tints: vec![[200, 100, 50, 255]] };
    lone.add_instances(&of_one.instances(vec![model.clone()].into(), true)).expect("an instance");
    [&tile, &lone].iter().for_each(|scene| scene.commit().expect("a commit"));
    let mut outer = Members::new(40, 9.0, &mut rng);
    let scene = Scene::new(&context);
    let prototype_of: Arc<[u32]> = (0..40).map(|i| u32::from(i % 4 == 3)).collect();
    let all = outer.instances(Prototypes::Scenes(vec![tile, lone]), true);
    scene.add_instances(&Instances { prototype_of: Arc::clone(&prototype_of), ..all }).expect("scenes");
    scene.commit().expect("a commit");
    for round in 0..2 {
        if round == 1 {
            outer.masks[3..6].copy_from_slice(&[1, 2, 4]);
            outer.tints[2..7].fill([9, 99, 199, 255]);
            scene.set_masks(FIRST + 3, &[1, 2, 4]).expect("masks");
            scene.set_tints(FIRST + 2, &[[9, 99, 199, 255]; 5]).expect("tints");
            scene.commit().expect("a commit");
        }
        let state = scene.state();
        let flat = flat(&context, &model, [&outer, &inner, &of_one], &prototype_of);
        let [mut a, mut b] = [&state, &flat.state()].map(|state| answers(&context, state, 9.0));
        // Ids and numbers are others, and matrices are multiplied in another order.
        for hits in a.hits.iter_mut().chain(&mut b.hits) {
            hits.iter_mut().for_each(|hit| *hit = Hit { part: hit.part, kind: hit.kind, ..Hit::MISS });
        }
        let [a_colours, b_colours] = [&a, &b].map(|it| floats(&it.picture[1]));
        let far = a_colours.iter().zip(&b_colours).filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
        assert!(far <= a_colours.len() / 200, "round {round}: {far} colours differ");
        a.picture.clear();
        b.picture.clear();
        assert_equal(&a, &b, &format!("round {round}"));
    }
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|it| f32::from_le_bytes([it[0], it[1], it[2], it[3]])).collect()
}

/// All instances of the scene of [`masks_and_tints_of_all_levels_hold_together`], one by one.
fn flat(context: &Context, model: &Model, [outer, tile, lone]: [&Members; 3], prototype_of: &[u32]) -> Scene {
    let (scene, mut id) = (Scene::new(context), 0);
    let mut add = |map, mask: u32, look| {
        scene.add_instance(model, id, map).expect("an instance");
        scene.set_instance_mask(id, mask & ALL).expect("a mask");
        scene.set_instance_look(id, look).expect("a look");
        id += 1;
    };
    for (i, of) in prototype_of.iter().enumerate() {
        let (map, mask, tint) = (outer.maps[i], outer.masks[i], outer.tints[i]);
        let members = if *of == 0 { tile } else { lone };
        for (j, inner) in members.maps.iter().enumerate() {
            let look = if *of == 0 && j == 7 { OWN } else { look(&[members.tints[j], tint]) };
            add(map * *inner, mask & members.masks[j], look);
        }
        if *of == 0 {
            add(map, mask, look(&[tint]));
        }
    }
    scene.commit().expect("a commit");
    scene
}

/// Colours of vertices are tinted too.
#[test]
fn colours_of_vertices_are_tinted() {
    let context = built::context(2);
    let coloured = |factor: [f32; 3]| {
        let tris = scenes::sphere(20, 30);
        let corner = |i: usize| [0, 1, 2].map(|axis| factor[axis] * [0.9, 0.5, 0.3][(axis + i) % 3]);
        let colours: Vec<[[f32; 3]; 3]> = (0..tris.len()).map(|i| [corner(i); 3]).collect();
        built::build(|builder| {
            let part = builder.part(PartDesc { id: Some(1), ..Default::default() }).expect("a part");
            builder.triangles(MeshKey::DIRECT, part, &tris, Attributes::colours(&colours)).expect("triangles");
        })
    };
    let tint = [255, 128, 51, 255];
    let factor = [1.0, 128.0 / 255.0, 51.0 / 255.0];
    let pictures = [(coloured([1.0; 3]), Some(tint)), (coloured(factor), None)].map(|(file, tint)| {
        let model = Model::open(&context, &file.path).expect("a model");
        let scene = Scene::new(&context);
        let members = Members { maps: vec![DAffine3::IDENTITY], masks: Vec::new(), tints: Vec::new() };
        let all = members.instances(vec![model].into(), false);
        scene.add_instances(&Instances { tints: tint.map(|it| [it].into()), ..all }).expect("an instance");
        scene.set_background(Background::Colour([0.0; 4])).expect("black");
        scene.commit().expect("a commit");
        floats(&picture(&context, &scene.state(), 1.5)[1])
    });
    let lit = pictures[0].chunks_exact(4).filter(|it| it[0] > 0.05).count();
    assert!(lit > 250, "{lit} pixels");
    for (a, b) in pictures[0].iter().zip(&pictures[1]) {
        assert!((a - b).abs() < 0.01, "{a} {b}");
    }
}

fn refused(result: outcrop::base::error::Result<()>, why: &str) {
    match result {
        Err(Error::BadArgument(said)) => assert!(said.contains(why), "{said}"),
        other => panic!("{why}: {other:?}"),
    }
}

/// Lists of another length and ranges that are not of one array are refused, and change nothing.
#[test]
fn wrong_masks_and_tints_are_refused() {
    let context = built::context(0);
    let (_file, model) = model(&context);
    let (scene, members) = (Scene::new(&context), Members::new(4, 3.0, &mut Rng::new(1)));
    let good = members.instances(vec![model.clone()].into(), true);
    scene.add_instance(&model, 5, DAffine3::IDENTITY).expect("an instance");
    let masks = Instances { masks: Some([1; 3].into()), ..good.clone() };
    refused(scene.add_instances(&masks), "4 transforms, but 3 masks");
    let tints = Instances { tints: Some([[1; 4]; 5].into()), ..good.clone() };
    refused(scene.add_instances(&tints), "4 transforms, but 5 tints");
    scene.add_instances(&good).expect("instances");
    scene.commit().expect("a commit");
    let before = answers(&context, &scene.state(), 3.0);
    refused(scene.set_masks(5, &[1]), "instance 5 is of no array");
    refused(scene.set_tints(7, &[[1; 4]]), "instance 7 is of no array");
    refused(scene.set_masks(FIRST + 3, &[1; 2]), "2 masks, but 1 instances from 53 on");
    refused(scene.set_tints(FIRST, &[[0; 4]; 5]), "5 tints, but 4 instances from 50 on");
    scene.set_masks(FIRST + 3, &[]).expect("nothing");
    scene.commit().expect("a commit");
    assert_equal(&answers(&context, &scene.state(), 3.0), &before, "after refusals");
}

/// Masks and tints take 4 bytes each, only where there are any. A range that is set anew takes memory for itself.
#[test]
fn masks_and_tints_count_against_the_budget() {
    let context = built::context(0);
    let (_file, model) = model(&context);
    let (scene, count) = (Scene::new(&context), 100_000);
    let mut members = Members { maps: Vec::new(), masks: Vec::new(), tints: Vec::new() };
    members.maps =
        (0..count).map(|i| DAffine3::from_translation(DVec3::new((i % 400) as f64, (i / 400) as f64, 0.0))).collect();
    scene.add_instances(&members.instances(vec![model.clone()].into(), false)).expect("instances");
    scene.commit().expect("a commit");
    let used = || context.memory_used() as f64 / count as f64;
    let plain = used();
    scene.set_masks(FIRST, &vec![ALL; count]).expect("masks");
    let masks = used() - plain;
    assert!((4.0..4.3).contains(&masks), "{masks} bytes a mask");
    scene.set_masks(FIRST, &vec![u32::MAX; count]).expect("masks");
    assert!(used() - plain < 0.01, "masks of all bits take {} bytes", used() - plain);
    scene.set_tints(FIRST, &vec![[1; 4]; count]).expect("tints");
    scene.commit().expect("a commit");
    let tints = used();
    let held = scene.state();
    scene.set_tints(FIRST + 1000, &[[2; 4]; 100]).expect("tints");
    let more = (used() - tints) * count as f64;
    assert!(more < 30_000.0, "a change of a hundred took {more} bytes");
    drop(held);
}
