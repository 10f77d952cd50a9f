//! Pictures of cameras that are far from a board, of cameras that stand on a surface: pixels are as exact as rays in
//! double precision, and all alike.

use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::view::View;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::query::HitKind;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Context, Model, Scene};
use std::time::Duration;

const SIZE: u32 = 200;
/// Squares of the board on each side.
const SQUARES: usize = 12;

/// A board of side 1 around `at`, of squares in two parts, seen along its normal -z.
fn board(at: DVec3) -> [Vec<Tri>; 2] {
    let step = 1.0 / SQUARES as f64;
    let corner = |i: usize, j: usize| at + DVec3::new(i as f64 * step - 0.5, j as f64 * step - 0.5, 0.0);
    let mut of = [Vec::new(), Vec::new()];
    for i in 0..SQUARES {
        for j in 0..SQUARES {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            of[(i + j) % 2].extend([[a, b, c], [a, c, d]]);
        }
    }
    of
}

/// The part at a point of the board's plane, and 0 beside it.
fn part_at(p: DVec3) -> u64 {
    let [i, j] = [p.x, p.y].map(|x| ((x + 0.5) * SQUARES as f64).floor());
    let is_inside = [i, j].iter().all(|i| (0.0..SQUARES as f64).contains(i));
    if is_inside { 1 + (i as u64 + j as u64) % 2 } else { 0 }
}

/// Ids of parts, and the kinds, of a converged picture. Without a hit the id is 0.
fn picture(context: &Context, scene: &Scene, camera: Camera, outputs: &[Buffer]) -> (Vec<u64>, Vec<u8>) {
    let outputs =
        outputs.iter().fold(Outputs::of(Buffer::Part) | Outputs::of(Buffer::Kind), |all, b| all | Outputs::of(*b));
    let options = FrameOptions { width: SIZE, height: SIZE, outputs, ..Default::default() };
    let frame = Frame::new(context, options).expect("a frame");
    frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request");
    assert_eq!(frame.wait(Duration::from_secs(600)).state, FrameState::Converged);
    let map = |buffer| frame.map(buffer).expect("a picture").bytes().to_vec();
    let id = |bytes: &[u8]| u64::from_ne_bytes(bytes.try_into().expect("an id"));
    let parts = map(Buffer::Part).chunks(8).map(id).map(|id| if id == u64::MAX { 0 } else { id }).collect();
    (parts, map(Buffer::Kind))
}

/// Number of pixels that show another part than the ray in double precision meets on the board at `at`.
fn wrong(view: &View, at: DVec3, seen: &[u64], covered: impl Fn(DVec3, DVec3) -> bool + Sync) -> usize {
    let truth = view.pixels(|x, y| {
        let ray = view.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let from = ray.org - at;
        // The point of the plane z = 0, without the distance, which has fewer digits.
        let p = DVec3::new(from.x - from.z * (ray.dir.x / ray.dir.z), from.y - from.z * (ray.dir.y / ray.dir.z), 0.0);
        if covered(ray.org, ray.dir) { 9 } else { part_at(p) }
    });
    assert!(truth.iter().filter(|id| **id > 0).count() * 3 > truth.len(), "too little is seen");
    truth.iter().zip(seen).filter(|(a, b)| a != b).count()
}

/// A camera that sees the board whole from `distance`, at 25 degrees from its normal.
fn from_afar(at: DVec3, distance: f64, is_perspective: bool) -> Camera {
    let eye = at + DQuat::from_rotation_y(0.3) * DQuat::from_rotation_x(0.31) * DVec3::Z * distance;
    let up = DVec3::new(0.1, 1.0, 0.0);
    if is_perspective {
        Camera::Perspective { eye, at, up, fov_y_degrees: 2.0 * (0.6 / distance).atan().to_degrees() }
    } else {
        Camera::Orthographic { eye, at, up, height: 1.2 }
    }
}

fn a_board_through_a_long_lens() {
    let context = built::context(2);
    for at in [DVec3::ZERO, DVec3::new(1e7, -2e7, 3e7)] {
        let [light, dark] = board(at);
        let file = built::parts(&[Part::white(1, light), Part::white(2, dark)]);
        let model = Model::open(&context, &file.path).expect("a model");
        let scene = Scene::new(&context);
        scene.add_instance(&model, 0, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        for k in 0..9 {
            for is_perspective in [true, false] {
                let camera = from_afar(at, 10f64.powi(k), is_perspective);
                let view = View::new(&camera, SIZE, SIZE);
                for more in [&[][..], &[Buffer::Depth]] {
                    let (seen, kinds) = picture(&context, &scene, camera, more);
                    let wrong = wrong(&view, at, &seen, |_, _| false);
                    let all = (SIZE * SIZE) as usize;
                    println!(
                        "{at}, 10^{k} times the size, perspective {is_perspective}, {more:?}: {wrong} of {all} pixels"
                    );
                    assert!(wrong * 1000 <= all, "{wrong} pixels differ");
                    assert!(kinds.iter().all(|kind| *kind <= 1), "all is exact");
                }
            }
        }
    }
}

/// The same past a plain that the camera stands over, so that the scene begins at the eye.
fn a_board_at_the_end_of_a_plain() {
    let context = built::context(2);
    let at = DVec3::new(0.0, 0.0, -20_000.0);
    let [light, dark] = board(DVec3::ZERO);
    let file = built::parts(&[Part::white(1, light), Part::white(2, dark)]);
    let corner = |x: f64, z: f64| DVec3::new(x, -0.2, z);
    let (side, end) = (30_000.0, -19_990.0);
    let [a, b, c, d] = [corner(-side, end), corner(side, end), corner(side, side), corner(-side, side)];
    let plain = built::parts(&[Part::white(9, vec![[a, b, c], [a, c, d]])]);
    let scene = Scene::new(&context);
    for (id, file, placed) in [(1, &file, at), (2, &plain, DVec3::ZERO)] {
        let model = Model::open(&context, &file.path).expect("a model");
        scene.add_instance(&model, id, DAffine3::from_translation(placed)).expect("an instance");
    }
    scene.commit().expect("a commit");
    let camera = Camera::Perspective {
        eye: DVec3::new(0.0, 3.0, 0.0),
        at,
        up: DVec3::Y,
        fov_y_degrees: 2.0 * (0.6f64 / 20_000.0).atan().to_degrees(),
    };
    let view = View::new(&camera, SIZE, SIZE);
    let (seen, _) = picture(&context, &scene, camera, &[]);
    // The plain hides the foot of the board.
    let is_hidden = |org: DVec3, dir: DVec3| dir.y < 0.0 && org.z + dir.z * ((org.y + 0.2) / -dir.y) >= end;
    let wrong = wrong(&view, at, &seen, is_hidden);
    println!("past a plain: {wrong} pixels");
    assert!(wrong * 1000 <= (SIZE * SIZE) as usize, "{wrong} pixels differ");
    // A pick finds the same.
    let frame =
        Frame::new(&context, FrameOptions { width: SIZE, height: SIZE, ..Default::default() }).expect("a frame");
    frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request");
    frame.wait(Duration::from_secs(600));
    let hit = frame.pick(SIZE / 2 + 3, SIZE / 2 - 3).expect("a hit");
    assert_eq!(hit.part, seen[((SIZE / 2 - 3) * SIZE + SIZE / 2 + 3) as usize]);
}

/// A camera on a turned floor of many triangles, which looks along it at a wall: no pixel shows the floor, whose plane
/// goes through the eye. From a little above, all pixels below the horizon do.
fn a_floor_through_the_eye() {
    let context = built::context(2);
    let turn = DQuat::from_rotation_x(0.3) * DQuat::from_rotation_z(0.2);
    let n = 40;
    let corner = |i: usize, j: usize| {
        turn * (DVec3::new(i as f64 / n as f64 - 0.5, j as f64 / n as f64 - 0.5, 0.0) * 20.0 + DVec3::splat(1.0 / 3.0))
    };
    let cells = (0..n * n).map(|c| (c % n, c / n));
    let floor: Vec<Tri> = cells
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let wall = |x: f64, z: f64| turn * DVec3::new(x, 8.0, z);
    let [a, b, c, d] = [wall(-12.0, -1.0), wall(2.0, -1.0), wall(2.0, 3.0), wall(-12.0, 3.0)];
    let file = built::parts(&[Part::white(1, floor.clone()), Part::white(2, vec![[a, b, c], [a, c, d]])]);
    let (scene, _model) = built::scene(&context, &file);
    let corners = floor[n * n + 7];
    let eye = (corners[0] + corners[1] * 2.0 + corners[2] * 3.0) / 6.0;
    for more in [&[][..], &[Buffer::Depth]] {
        for (above, is_seen) in [(0.0, false), (1e-7, false), (1e-3, true)] {
            let eye = eye + turn * DVec3::Z * above;
            let camera =
                Camera::Perspective { eye, at: eye + turn * DVec3::Y, up: turn * DVec3::Z, fov_y_degrees: 60.0 };
            let (seen, _) = picture(&context, &scene, camera, more);
            let count = |part: u64| seen.iter().filter(|id| **id == part).count();
            println!("{above} above, {more:?}: floor {}, wall {}", count(1), count(2));
            assert!(count(2) > 1000, "the wall is seen");
            if is_seen {
                // Below the horizon, up to the floor's end and the wall's foot.
                let below = &seen[(SIZE * (SIZE / 2 + 2)) as usize..];
                assert!(below.iter().all(|id| *id == 1), "{} of {} pixels", count(1), below.len());
            } else {
                assert_eq!(count(1), 0, "{above} above");
            }
        }
    }
}

/// Eyes on a floor and 1e-7 above it, which look up past it at a ceiling, or along it: a pick finds what the picture
/// shows at the pixel, which is never the floor.
fn a_pick_passes_a_floor_through_the_eye() {
    let context = built::context(2);
    let square = |z: f64| {
        let at = |x: f64, y: f64| DVec3::new(x, y, z);
        let [a, b, c, d] = [at(-9.0, -9.0), at(9.0, -9.0), at(9.0, 9.0), at(-9.0, 9.0)];
        vec![[a, b, c], [a, c, d]]
    };
    let file = built::parts(&[Part::white(1, square(0.0)), Part::white(2, square(4.0))]);
    let (scene, _model) = built::scene(&context, &file);
    for (above, at) in [(0.0, DVec3::Z), (1e-7, DVec3::Z), (0.0, DVec3::new(1.0, 0.1, 0.3)), (1e-7, -DVec3::Z)] {
        let eye = DVec3::new(0.3, 0.2, above);
        let camera = Camera::Perspective { eye, at: eye + at, up: DVec3::Y, fov_y_degrees: 60.0 };
        let (seen, _) = picture(&context, &scene, camera, &[]);
        let options = FrameOptions { width: SIZE, height: SIZE, ..Default::default() };
        let frame = Frame::new(&context, options).expect("a frame");
        frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request");
        frame.wait(Duration::from_secs(600));
        for (x, y) in (0..40).map(|i| (i * 37 % SIZE, i * 53 % SIZE)) {
            let hit = frame.pick(x, y).expect("a pick");
            // Pixels that show nothing have the id 0.
            let part = if hit.kind == HitKind::Miss { 0 } else { hit.part };
            assert_eq!(part, seen[(y * SIZE + x) as usize], "{above} above, to {at}, pixel {x} {y}: {hit:?}");
            assert!(part != 1);
        }
    }
}

built::on_each_structure!(
    a_board_through_a_long_lens,
    a_board_at_the_end_of_a_plain,
    a_floor_through_the_eye,
    a_pick_passes_a_floor_through_the_eye
);
