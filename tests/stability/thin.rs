//! Wires and leaves thinner than a voxel: their mean coverage is the oracle's.

use super::pictures::{LONG, POE, Picture, Setting, Stage, frame, lit, sun};
use super::table::{judge, judge_each};
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::bvh64::Bvh64;
use crate::common::light::Lighting;
use crate::common::picture::coverage_ratio;
use crate::common::rng::Rng;
use crate::common::samples::Samples;
use crate::common::scenes;
use crate::common::view::View;
use glam::{DAffine3, DVec3};
use outcrop::render::{Buffer, FrameSettings, FrameState};
use outcrop::scene::{Camera, Context, ContextOptions, Light, Model as Opened};

const SIZE: (u32, u32) = (96, 72);
const VIEWS: usize = 6;

/// Views of one kind, by number.
struct Group {
    name: &'static str,
    views: [usize; VIEWS / 2],
}

type Model = (Vec<Tri>, [Camera; VIEWS], [Group; 2]);

/// Off a mean coverage, as a share of it.
const LINE: f64 = 0.03;

/// From all around, seen whole, 1.5 pixels of a wire's cell across, and from among them.
fn wires(seed: u64) -> Model {
    let camera = |eye: DVec3, at: DVec3| Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees: 40.0 };
    let around = |turn: f64| DVec3::new(turn.sin(), -turn.cos(), 0.0);
    let whole = |n: f64| camera(around(n * 2.1) * 26.0 + DVec3::Z * 6.0, DVec3::Z * 2.0);
    let among = |n: f64| camera(around(n * 2.1) * 4.0 + DVec3::Z * 2.0, DVec3::new(0.5, 0.0, 2.2));
    let cameras = [whole(0.0), whole(1.0), whole(2.0), among(0.0), among(1.0), among(2.0)];
    let groups = [Group { name: "seen whole", views: [0, 1, 2] }, Group { name: "from among them", views: [3, 4, 5] }];
    (scenes::wire_forest(500, 24, seed), cameras, groups)
}

/// Cards of two triangles, turned anyhow, in a ball of radius 4.
fn leaf_cards(count: usize) -> Model {
    let mut rng = Rng::new(11);
    let card = |_| {
        let at = rng.direction() * 4.0 * rng.unit().cbrt();
        let normal = rng.direction();
        let across = normal.cross(rng.direction()).normalize();
        let (u, v) = (across * 0.03, normal.cross(across) * 0.02);
        let [a, b, c, d] = [at - u - v, at + u - v, at + u + v, at - u + v].map(scenes::rounded);
        [[a, b, c], [a, c, d]]
    };
    let tris = (0..count).flat_map(card).collect();
    let camera = |eye: DVec3| Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    let eyes = [
        [3.0, -12.0, 4.0],
        [-1.0, 5.5, -1.0],
        [12.0, 2.0, -3.0],
        [-5.0, 1.0, 3.0],
        [-8.0, 7.0, 6.0],
        [1.0, -5.0, -2.5],
    ];
    let groups = [Group { name: "seen whole", views: [0, 2, 4] }, Group { name: "from near", views: [1, 3, 5] }];
    (tris, eyes.map(|eye| camera(eye.into())), groups)
}

/// Pixels along an edge of the squares in which something must be seen where the oracle sees that much.
const SQUARE: usize = 12;
const SEEN: f64 = 0.05;

/// How many squares show nothing although they are covered.
fn empty_squares(now: &[f64], truth: &[f64]) -> usize {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let mean = |of: &[f64], x: usize, y: usize| {
        let rows = (y..y + SQUARE).map(|row| of[row * width + x..][..SQUARE].iter().sum::<f64>());
        rows.sum::<f64>() / (SQUARE * SQUARE) as f64
    };
    let squares = (0..height).step_by(SQUARE).flat_map(|y| (0..width).step_by(SQUARE).map(move |x| (x, y)));
    squares.filter(|&(x, y)| mean(truth, x, y) >= SEEN && mean(now, x, y) == 0.0).count()
}

/// How much of all pixels is covered is judged, in the worst view and on the mean; and nowhere nothing is seen of what
/// is there. (Not which: where a cell stands in, some rays that would hit pass, and others hit.) Means of views of one
/// kind are printed: they differ.
fn check(name: &str, (tris, cameras, groups): Model) {
    let setting = Setting { size: SIZE, samples: 16, ..Setting::default() };
    let file = built::parts(&[Part::white(1, tris.clone())]);
    let stage = Stage::new(&file.path, setting);
    let oracle = Bvh64::new(tris);
    let lighting = Lighting::new(&oracle);
    let samples = Samples { points: 32, rounds: 2, seed: 5 };
    // Of each view, at each pixels of error.
    let mut ratios = [[0.0f64; POE.len()]; VIEWS];
    for (v, (camera, ratios)) in cameras.iter().zip(&mut ratios).enumerate() {
        let view = View::new(camera, SIZE.0, SIZE.1);
        let truth = view.pixels(|x, y| lighting.coverage(&view, x, y, &samples).mean);
        assert!(truth.iter().sum::<f64>() > 0.02 * truth.len() as f64, "{name}, view {v}: hardly anything is seen");
        let exact = stage.picture(camera, 0.0);
        for (ratio, poe) in ratios.iter_mut().zip(POE) {
            let picture = stage.picture(camera, poe);
            let shown: Vec<f64> = picture.coverage().collect();
            assert_eq!(empty_squares(&shown, &truth), 0, "{name}, PoE {poe}: nothing is seen where there is something");
            let now = coverage_ratio(picture.coverage(), truth.iter().copied());
            let (holes, stand_ins) = (picture.holes(&exact), picture.stand_ins());
            println!(
                "{name}, PoE {poe}: view {v}, {holes} holes, {now:.3} of the oracle's coverage, {stand_ins} stand-ins"
            );
            assert!(poe < 1.0 || stand_ins > 100, "{name}, PoE {poe}, view {v}: nothing stands in");
            *ratio = now;
        }
    }
    let mean = |views: &[usize], p: usize| views.iter().map(|v| ratios[*v][p]).sum::<f64>() / views.len() as f64;
    for (p, poe) in POE.into_iter().enumerate() {
        let of_groups = groups.iter().map(|group| format!("{:.3} {}", mean(&group.views, p), group.name));
        println!(
            "{name}, PoE {poe}: {} of the oracle's coverage on the mean",
            of_groups.collect::<Vec<_>>().join(", ")
        );
    }
    let worst = |p: usize| ratios.iter().map(|of_view| (of_view[p] - 1.0).abs()).fold(0.0, f64::max);
    judge_each(&format!("{name}: coverage"), std::array::from_fn(worst), LINE);
    let all: [usize; VIEWS] = std::array::from_fn(|v| v);
    judge_each(&format!("{name}: mean coverage"), std::array::from_fn(|p| (mean(&all, p) - 1.0).abs()), LINE);
}

#[test]
fn coverage_of_wires() {
    check("wires", wires(3));
}

/// Other ones: how thick they are, and where they stand, matters at 10 pixels of error.
#[test]
fn coverage_of_other_wires() {
    check("other wires", wires(8));
}

#[test]
fn coverage_of_leaf_cards() {
    check("leaf cards", leaf_cards(20_000));
}

/// Where the wall behind is shown instead of a wire, its pixel is not counted among the exact ones: by light of the
/// eye, and with shadows, which takes another way.
#[test]
fn a_wall_behind_wires_is_not_exact() {
    let (wires, cameras, _) = wires(3);
    let wall = [[-40.0, 14.0, -20.0], [40.0, 14.0, -20.0], [40.0, 14.0, 30.0], [-40.0, 14.0, 30.0]].map(DVec3::from);
    let wall = vec![[wall[0], wall[1], wall[2]], [wall[0], wall[2], wall[3]]];
    let file = built::parts(&[Part::white(1, wires), Part::white(2, wall)]);
    let context = built::context(2);
    for lights in [vec![Light::HEADLIGHT], vec![sun(DVec3::new(0.3, 1.0, -0.2))]] {
        let (scene, _model) = built::scene(&context, &file);
        scene.set_lights(lights).expect("lights");
        scene.commit().expect("a commit");
        let frame = frame(&context, SIZE);
        let render = |poe| {
            frame
                .request(&scene.state(), &cameras[0], &FrameSettings { poe, ..Default::default() })
                .expect("a request");
            let status = frame.wait(LONG);
            assert_eq!(status.pixels_exact + status.pixels_lod, status.pixels_total, "{status:?}");
            let parts = frame.map(Buffer::Part).expect("parts").ids().expect("ids").to_vec();
            (status.pixels_lod, parts, Picture::of(&frame))
        };
        let (_, truth, _) = render(0.0);
        for poe in [3.0, 10.0] {
            let (lod, parts, picture) = render(poe);
            let through = parts.iter().zip(&truth).filter(|(now, truth)| (**now, **truth) == (2, 1)).count();
            println!(
                "PoE {poe}: {through} pixels show the wall for a wire; {lod} lod, {} of them stand-ins",
                picture.stand_ins()
            );
            assert!(through > 50, "PoE {poe}: {through} pixels through stand-ins");
            assert!(lod as usize >= picture.stand_ins() + through, "PoE {poe}: {lod} lod, {through} through stand-ins");
            let errors =
                picture.bytes(Buffer::Error).chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            let mut seen = errors.zip(parts.iter().zip(&truth));
            assert!(
                seen.all(|(error, (now, truth))| (*now, *truth) != (2, 1) || error == f32::INFINITY),
                "PoE {poe}: an error that is none"
            );
        }
    }
}

/// Where memory does not do for what is seen, wires are as thick as at as many pixels of error that are asked for.
#[test]
fn wires_in_a_small_budget() {
    let file = built::parts(&[Part::white(1, scenes::wire_forest(4000, 24, 3))]);
    let cameras = wires(3).1;
    let setting = Setting { size: SIZE, ..Setting::default() };
    let stage = Stage::new(&file.path, setting.clone());
    let bytes = Opened::open(&built::context(0), &file.path).expect("a model").memory().geometry;
    let (mut largest, mut uncovered) = (0f32, 0f64);
    for budget in [bytes / 2, bytes / 3, bytes / 4] {
        let options = ContextOptions { threads: 2, memory_budget: budget, ..Default::default() };
        let context = Context::new(options).expect("a context");
        let model = Opened::open(&context, &file.path).expect("a model");
        let scene = lit(&context, &setting);
        scene.add_instance(&model, 0, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        let frame = frame(&context, SIZE);
        for (v, camera) in cameras.iter().enumerate() {
            frame
                .request(&scene.state(), camera, &FrameSettings { ambient: 0.0, at_once: true, ..Default::default() })
                .expect("a request");
            let status = frame.wait(LONG);
            assert_eq!(status.state, FrameState::CompleteWithinBudget, "it all fits: {status:?}");
            let [seen, asked] =
                [Picture::of(&frame), stage.quick(camera, status.effective_poe)].map(|p| p.coverage().sum::<f64>());
            println!(
                "{budget} of {bytes} bytes, view {v}, PoE {}: {:.3} of what is seen when that is asked for",
                status.effective_poe,
                seen / asked
            );
            assert!((seen / asked - 1.0).abs() < LINE, "view {v}, PoE {}: {seen} for {asked}", status.effective_poe);
            largest = largest.max(status.effective_poe);
            // Rays pass what stands in for wires by chance: what the exact picture shows is not shown everywhere.
            let (seen, exact) = (Picture::of(&frame), stage.quick(camera, 0.0));
            let lost = seen.coverage().zip(exact.coverage()).filter(|(now, truth)| *now == 0.0 && *truth > 0.0).count();
            uncovered = uncovered.max(lost as f64 / exact.coverage().filter(|c| *c > 0.0).count() as f64);
        }
    }
    judge("wires in a small cache: pixels uncovered", &[(1.0, uncovered, 0.0)]);
    assert!(largest > 10.0, "{largest} pixels of error are not what is to be looked at");
}
