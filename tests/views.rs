//! Views: fitted cameras, rays and frusta of picture points, and picks that favour thin parts.

use crate::common::built::{self, Part};
use crate::common::frames::{LONG, perspective, render};
use crate::common::scenes;
use glam::{DAffine3, DVec2, DVec3};
use outcrop::base::units::UpAxis;
use outcrop::query::{HitKind, NONE, Plane};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, Outputs};
use outcrop::scene::{Camera, Chosen, Fit, Lens, Look, MARGIN, Model, NamedView, Scene, Scope};
use outcrop::{Context, Error};
use std::collections::BTreeSet;

/// The corners of a box under a transform.
fn corners(min: DVec3, max: DVec3, m: &DAffine3) -> Vec<DVec3> {
    let side = |i: usize, axis: usize| if i >> axis & 1 == 1 { max[axis] } else { min[axis] };
    (0..8).map(|i| m.transform_point3(DVec3::new(side(i, 0), side(i, 1), side(i, 2)))).collect()
}

/// The corners of the boxes of a model's parts with these ids.
fn corners_of(model: &Model, m: &DAffine3, ids: &[u64]) -> Vec<DVec3> {
    let parts = model.parts().iter().filter(|part| ids.contains(&part.id));
    parts.flat_map(|part| corners(part.bounds.min, part.bounds.max, m)).collect()
}

/// The picture point of `p`, from 0 to 1 in both axes; found from the camera alone.
fn projected(camera: &Camera, (width, height): (u32, u32), p: DVec3) -> DVec2 {
    let (Camera::Perspective { eye, at, up, .. } | Camera::Orthographic { eye, at, up, .. }) = *camera;
    let forward = (at - eye).normalize();
    let right = forward.cross(up).normalize();
    let from_eye = p - eye;
    assert!(from_eye.dot(forward) > 0.0, "{p} is behind the eye {eye}");
    let high = match *camera {
        Camera::Perspective { fov_y_degrees, .. } => {
            2.0 * (fov_y_degrees.to_radians() / 2.0).tan() * from_eye.dot(forward)
        }
        Camera::Orthographic { height, .. } => height,
    };
    let wide = high * f64::from(width) / f64::from(height);
    DVec2::new(0.5 + from_eye.dot(right) / wide, 0.5 - from_eye.dot(right.cross(forward)) / high)
}

/// Asserts that points lie within the margin, and touch it on both sides of an axis.
fn assert_tight(camera: &Camera, size: (u32, u32), points: &[DVec3], margin: f64, what: &str) {
    let all: Vec<DVec2> = points.iter().map(|&p| projected(camera, size, p)).collect();
    let least = all.iter().fold(DVec2::INFINITY, |a, b| a.min(*b));
    let most = all.iter().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
    let inside = (least - margin).min_element().min((1.0 - margin - most).min_element());
    assert!(inside > -1e-6, "{what}: {least} to {most}");
    let gap = (least - margin).max(1.0 - margin - most);
    assert!(gap.min_element() < 0.01, "{what}: {least} to {most} does not touch");
}

/// A long bar with a mast, and a small ball beside it.
fn long_model(context: &Context) -> (Scene, Model) {
    let ball = scenes::sphere(12, 24).iter().map(|t| t.map(|v| v * 0.3 + DVec3::new(-1.0, 2.0, 0.5))).collect();
    let parts = [
        Part::white(1, scenes::cuboid(DVec3::ZERO, DVec3::new(20.0, 1.0, 0.5))),
        Part::white(2, scenes::cuboid(DVec3::new(19.0, 0.0, 0.5), DVec3::new(19.5, 0.5, 4.0))),
        Part::white(3, ball),
    ];
    built::scene(context, &built::parts(&parts))
}

const LENSES: [Lens; 3] = [Lens::Perspective(45.0), Lens::Perspective(90.0), Lens::Orthographic];

fn fit_of(view: NamedView, lens: Lens, size: (u32, u32)) -> Fit {
    let (direction, up) = view.directions(UpAxis::Z);
    Fit { direction, up, lens, size, margin: MARGIN }
}

#[test]
fn fitted_cameras_touch_the_margin() {
    let context = built::context(1);
    let (scene, model) = long_model(&context);
    let aside = DAffine3::from_rotation_x(0.7) * DAffine3::from_scale(DVec3::new(0.2, 0.5, 0.3));
    let aside = DAffine3::from_translation(DVec3::new(3.0, 8.0, -2.0)) * aside;
    scene.add_instance(&model, 9, aside).unwrap();
    scene.commit().unwrap();
    let mut points = corners_of(&model, &DAffine3::IDENTITY, &[1, 2, 3]);
    points.extend(corners_of(&model, &aside, &[1, 2, 3]));
    for view in NamedView::ALL {
        for lens in LENSES {
            for (size, margin) in [((640, 480), MARGIN), ((300, 900), 0.0), ((900, 300), 0.2)] {
                let fit = Fit { margin, ..fit_of(view, lens, size) };
                let camera = scene.state().fit(&fit, &[], Scope::Own).unwrap();
                assert_tight(&camera, size, &points, margin, &format!("{view:?} {lens:?} {size:?}"));
            }
        }
    }
}

#[test]
fn named_views_look_along_the_axes() {
    for (axis, front, up) in
        [(UpAxis::Z, -DVec3::Y, DVec3::Z), (UpAxis::Y, DVec3::Z, DVec3::Y), (UpAxis::X, DVec3::Y, DVec3::X)]
    {
        let right = up.cross(front);
        let looks = |view: NamedView| view.directions(axis);
        assert_eq!(looks(NamedView::Front), (-front, up));
        assert_eq!(looks(NamedView::Back), (front, up));
        assert_eq!(looks(NamedView::Left), (right, up));
        assert_eq!(looks(NamedView::Right), (-right, up));
        // The right is right in the pictures from above and from below too.
        for view in [NamedView::Front, NamedView::Top, NamedView::Bottom] {
            let (direction, up) = looks(view);
            assert_eq!(direction.cross(up), right, "{view:?}");
        }
        assert_eq!(NamedView::up_along(-up * 3.0, axis), looks(NamedView::Top).1);
        assert_eq!(NamedView::up_along(up, axis), looks(NamedView::Bottom).1);
        assert_eq!(NamedView::up_along(front + up, axis), up);
        for view in [NamedView::IsoFrontRight, NamedView::IsoFrontLeft, NamedView::IsoBackRight, NamedView::IsoBackLeft]
        {
            let from = -looks(view).0.normalize();
            assert!([front, right, up].iter().all(|v| (from.dot(*v).abs() - 3f64.sqrt().recip()).abs() < 1e-12));
            assert!(from.dot(up) > 0.0);
        }
    }
}

#[test]
fn hidden_parts_do_not_count_and_chosen_parts_fill_the_picture() {
    let context = built::context(1);
    let (scene, model) = long_model(&context);
    scene.add_instance(&model, 9, DAffine3::from_translation(DVec3::Y * 30.0)).unwrap();
    scene.commit().unwrap();
    let size = (400, 300);
    let points = |ids: &[u64]| corners_of(&model, &DAffine3::IDENTITY, ids);
    for lens in LENSES {
        let fit = fit_of(NamedView::IsoFrontLeft, lens, size);
        let part = |instance, part| Chosen { instance, part: Some(part) };
        let camera = |chosen: &[Chosen]| scene.state().fit(&fit, chosen, Scope::Own).unwrap();
        assert_tight(&camera(&[part(7, 3)]), size, &points(&[3]), MARGIN, "one part");
        assert_tight(&camera(&[part(7, 3), part(7, 2)]), size, &points(&[2, 3]), MARGIN, "two parts");
        let all = [part(7, 3), Chosen { instance: 7, part: None }];
        assert_tight(&camera(&all), size, &points(&[1, 2, 3]), MARGIN, "an instance");
        scene.set_instance_look(9, Look { visible: false, ..Look::default() }).unwrap();
        scene.set_part_look(7, 2, Look { visible: false, ..Look::default() }).unwrap();
        scene.commit().unwrap();
        assert_tight(&scene.state().fit(&fit, &[], Scope::Own).unwrap(), size, &points(&[1, 3]), MARGIN, "shown");
        let hidden = scene.state().fit(&fit, &[part(7, 2)], Scope::Own);
        assert!(matches!(&hidden, Err(Error::BadState(why)) if why.contains("the choice")), "{hidden:?}");
        scene.set_instance_look(9, Look::default()).unwrap();
        scene.clear_part_looks(7).unwrap();
        scene.commit().unwrap();
    }
}

/// Parts without a size are shown from a distance of 1.
#[test]
fn points_are_shown_from_a_distance() {
    let context = built::context(1);
    let tiny = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| p * 1e-30);
    let parts = [Part::white(1, scenes::sphere(6, 9)), Part::white(2, vec![tiny])];
    let (scene, _) = built::scene(&context, &built::parts(&parts));
    let chosen = [Chosen { instance: 7, part: Some(2) }];
    for lens in LENSES {
        let camera = scene.state().fit(&fit_of(NamedView::Front, lens, (400, 300)), &chosen, Scope::Own).unwrap();
        assert!((camera.eye() - DVec3::NEG_Y).length() < 1e-9, "{camera:?}");
    }
}

#[test]
fn bad_fits_have_a_reason() {
    let context = built::context(1);
    let (scene, _) = long_model(&context);
    let fit = fit_of(NamedView::Front, Lens::Perspective(45.0), (400, 300));
    let why = |fit: Fit, chosen: &[Chosen]| match scene.state().fit(&fit, chosen, Scope::Own) {
        Err(Error::BadArgument(why)) => why,
        other => panic!("{other:?}"),
    };
    assert!(why(fit, &[Chosen { instance: 8, part: None }]).contains("instance 8"));
    assert!(why(fit, &[Chosen { instance: 7, part: Some(99) }]).contains("part 99"));
    for (fit, word) in [
        (Fit { size: (0, 3), ..fit }, "width"),
        (Fit { margin: 0.5, ..fit }, "margin"),
        (Fit { margin: f64::NAN, ..fit }, "margin"),
        (Fit { direction: DVec3::ZERO, ..fit }, "direction"),
        (Fit { direction: DVec3::splat(f64::INFINITY), ..fit }, "direction"),
        (Fit { up: fit.direction, ..fit }, "up"),
        (Fit { lens: Lens::Perspective(180.0), ..fit }, "angle"),
    ] {
        assert!(why(fit, &[]).contains(word), "{fit:?}");
    }
    let empty = Scene::new(&context).state().fit(&fit, &[], Scope::Own);
    assert!(matches!(&empty, Err(Error::BadState(why)) if why.contains("the scene")), "{empty:?}");
}

#[test]
fn points_and_far_places_are_shown() {
    let context = built::context(1);
    let (scene, model) = long_model(&context);
    for (far, scale) in [(DVec3::new(3.0, 4.0, 5.0), 1e-20), (DVec3::splat(1e9), 1e-12), (DVec3::splat(1e9), 1.0)] {
        let place = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), glam::DQuat::IDENTITY, far);
        scene.set_transform(7, place).unwrap();
        scene.commit().unwrap();
        for lens in LENSES {
            let fit = fit_of(NamedView::IsoBackLeft, lens, (400, 300));
            let camera = scene.state().fit(&fit, &[], Scope::Own).unwrap();
            camera.prepare(400, 300).expect("a camera");
            let points = corners_of(&model, &place, &[1, 2, 3]);
            if scale == 1.0 {
                assert_tight(&camera, (400, 300), &points, MARGIN, "far away");
            }
            for p in points {
                let at = projected(&camera, (400, 300), p);
                assert!((at - 0.5).abs().max_element() < 0.46, "{lens:?} at {far}: {at}");
            }
        }
    }
}

#[test]
fn views_of_long_models_fill_the_picture() {
    let context = built::context(1);
    let (_, model) = long_model(&context);
    for size in [(1, 1), (1024, 768)] {
        let views = model.fitted_views(UpAxis::Z, size);
        let points = corners_of(&model, &DAffine3::IDENTITY, &[1, 2, 3]);
        views[..2].iter().for_each(|camera| assert_tight(camera, size, &points, MARGIN, "a view"));
        assert_eq!(views[2..], model.views_with(UpAxis::Z)[2..]);
    }
    let none = Model::open(&context, built::build(|_| ()).path).unwrap();
    assert_eq!(none.fitted_views(UpAxis::Z, (1, 1)), none.views());
}

#[test]
fn placements_give_models_one_up_axis_and_unit() {
    let context = built::context(1);
    let build = |up, metres_per_unit| {
        let options = outcrop::build::BuildOptions { up, metres_per_unit, ..built::options() };
        let part = Part::white(1, scenes::cuboid(DVec3::ZERO, DVec3::ONE));
        let built = built::build_with(options, |builder| built::push(builder, &part)).0;
        Model::open(&context, &built.path).unwrap()
    };
    let millimetres = build(Some(UpAxis::Y), Some(0.001));
    let unknown = build(None, None);
    let m = millimetres.placement(Some(UpAxis::Z), Some(1.0)).unwrap();
    assert!(m.transform_point3(DVec3::Y * 1000.0).abs_diff_eq(DVec3::Z, 1e-12), "up");
    assert!(m.transform_point3(DVec3::Z * 1000.0).abs_diff_eq(-DVec3::Y, 1e-12), "front");
    assert!(m.transform_point3(DVec3::X * 1000.0).abs_diff_eq(DVec3::X, 1e-12), "right");
    assert_eq!(millimetres.placement(None, None).unwrap(), DAffine3::IDENTITY);
    assert_eq!(millimetres.placement(Some(UpAxis::Y), Some(0.001)).unwrap(), DAffine3::IDENTITY);
    assert_eq!(unknown.placement(Some(UpAxis::X), Some(0.01)).unwrap(), DAffine3::IDENTITY);
    for to in [UpAxis::X, UpAxis::Y, UpAxis::Z] {
        assert!((millimetres.placement(Some(to), None).unwrap().matrix3.determinant() - 1.0).abs() < 1e-12);
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(millimetres.placement(None, Some(bad)).is_err());
    }
}

/// Balls on a grid, each a part.
fn grid_of_balls(context: &Context) -> (Scene, Model) {
    let ball = |i: u64| {
        let middle = DVec3::new((i % 5) as f64 - 2.0, (i / 5) as f64 - 2.0, (i * 7 % 5) as f64 - 2.0);
        scenes::sphere(8, 16).iter().map(|t| t.map(|v| v * 0.2 + middle)).collect()
    };
    built::scene(context, &built::parts(&(0..25).map(|i| Part::white(i, ball(i))).collect::<Vec<_>>()))
}

#[test]
fn frusta_of_rectangles_hold_what_is_seen_in_them() {
    let context = built::context(1);
    let (scene, _) = grid_of_balls(&context);
    let (eye, at) = (DVec3::new(4.0, 5.0, 6.0), DVec3::new(0.2, 0.1, 0.0));
    let (width, height) = (120, 90);
    let frame = picture_frame(&context, width, height);
    for camera in [perspective(eye, at), Camera::Orthographic { eye, at, up: DVec3::Y, height: 5.0 }] {
        render(&frame, &scene, &camera, &FrameSettings::default());
        let seen = frame.map(Buffer::Part).unwrap();
        let rays = camera.prepare(width, height).unwrap();
        for [x0, y0, x1, y1] in [[0, 0, 120, 90], [50, 20, 80, 60], [100, 70, 20, 50], [61, 41, 61, 41]] {
            let corner = |x: u32, y: u32| DVec2::new(f64::from(x), f64::from(y));
            let planes = Plane::frustum(&rays, [corner(x0, y0), corner(x1, y1)]);
            let found = scene.state().overlap_frustum(&planes).unwrap();
            let found: BTreeSet<u64> = found.iter().map(|overlap| overlap.part).collect();
            let inside = |x: u32, y: u32| x >= x0.min(x1) && x < x0.max(x1) && y >= y0.min(y1) && y < y0.max(y1);
            for (i, &part) in seen.ids().unwrap().iter().enumerate().filter(|(_, part)| **part != NONE) {
                let (x, y) = (i as u32 % width, i as u32 / width);
                assert!(!inside(x, y) || found.contains(&part), "pixel {x}, {y} shows {part}");
            }
            assert!(found.len() < 25 || x1 == 120, "not everything");
            // Rays through points within lie in all half spaces, those outside do not.
            for (x, y) in [(0.5, 0.5), (61.0, 41.0), (70.0, 30.0), (30.0, 60.0), (119.0, 89.0)] {
                let ray = rays.ray(x, y);
                let point = ray.origin + ray.dir.as_dvec3() * 3.0;
                let is_in = planes.iter().all(|plane| plane.normal.dot(point) + plane.d >= -1e-3);
                let within = |v: f64, a: u32, b: u32| f64::from(a.min(b)) <= v && v <= f64::from(a.max(b));
                assert_eq!(is_in, within(x, x0, x1) && within(y, y0, y1), "{x}, {y} in {x0} {y0} {x1} {y1}");
                assert!(planes.iter().any(|plane| plane.normal.dot(eye - (at - eye)) + plane.d < 0.0), "behind");
            }
        }
    }
}

/// Frame with ids only.
fn picture_frame(context: &Context, width: u32, height: u32) -> Frame {
    let outputs = Outputs::of(Buffer::Part) | Outputs::of(Buffer::Depth);
    Frame::new(context, FrameOptions { width, height, outputs, ..Default::default() }).unwrap()
}

/// A wire between two points: a bar with a square section.
fn wire(a: DVec3, b: DVec3, thick: f64) -> Vec<[DVec3; 3]> {
    let along = (b - a).normalize();
    let (u, v) = along.any_orthonormal_pair();
    let turn = DAffine3::from_cols(along * a.distance(b), u * thick, v * thick, a - (u + v) * (thick / 2.0));
    scenes::cuboid(DVec3::ZERO, DVec3::ONE).iter().map(|t| t.map(|p| turn.transform_point3(p))).collect()
}

#[test]
fn picks_with_a_radius_find_wires_and_leave_plain_surfaces() {
    let context = built::context(1);
    // 100 pixels for 10 units: 0.1 a pixel. Wires of 0.01 to 0.02: a tenth to a fifth of a pixel.
    let parts = [
        Part::white(1, scenes::cuboid(DVec3::new(-4.0, -4.0, -1.0), DVec3::new(4.0, 4.0, -0.5))),
        Part::white(2, wire(DVec3::new(-3.0, 1.013, 0.0), DVec3::new(3.0, 1.013, 0.0), 0.01)),
        Part::white(3, wire(DVec3::new(-2.037, -3.0, 0.0), DVec3::new(-2.037, 3.0, 0.0), 0.01)),
        Part::white(4, wire(DVec3::new(0.0, -3.0, 0.0), DVec3::new(3.0, 0.0, 0.0), 0.02)),
        Part::white(5, scenes::cuboid(DVec3::new(2.0, 2.0, -0.5), DVec3::new(4.0, 4.0, 0.0))),
    ];
    let (scene, _) = built::scene(&context, &built::parts(&parts));
    let frame = picture_frame(&context, 100, 100);
    let tall = 10.0;
    let (eye, at) = (DVec3::Z * (tall / 2.0 / 20f64.to_radians().tan()), DVec3::ZERO);
    let pixel = |x: f64, y: f64| {
        let of = |v: f64| (50.0 + v / tall * 100.0).floor() as u32;
        (of(x), of(-y))
    };
    let flat = Camera::Orthographic { eye, at, up: DVec3::Y, height: tall };
    for camera in [perspective(eye, at), flat] {
        frame.request(&scene.state(), &camera, &FrameSettings::default()).unwrap();
        frame.wait(LONG);
        let near = |(x, y): (u32, u32), radius: f64| frame.pick_near(x, y, radius).unwrap().part;
        // Up to three pixels beside each wire.
        for beside in [-0.2, -0.1, 0.0, 0.07, 0.15, 0.21] {
            for along in [-1.0, -0.3, 0.7] {
                assert_eq!(near(pixel(along, 1.013 + beside), 4.0), 2, "{beside} beside the level wire");
                assert_eq!(near(pixel(-2.037 + beside, along - 1.0), 4.0), 3, "{beside} beside the upright wire");
                let slant = DVec2::new(1.5 + along, -1.5 + along) + DVec2::new(1.0, -1.0) * (beside * 0.7);
                assert_eq!(near(pixel(slant.x, slant.y), 4.0), 4, "{beside} beside the slanted wire");
            }
        }
        // Plain surfaces, also near the edges of others and of the picture: the centre.
        for (x, y) in [(0.0, 0.0), (1.9, 3.0), (2.1, 3.0), (3.0, 2.05), (-3.8, -3.8), (3.9, 3.9), (-3.8, 0.0)] {
            let (px, py) = pixel(x, y);
            let own = frame.pick(px, py).unwrap();
            let found = frame.pick_near(px, py, 4.0).unwrap();
            assert_eq!((found.part, found.t, found.position), (own.part, own.t, own.position), "at {x}, {y}");
            assert_eq!(frame.pick_near(px, py, 0.0).unwrap(), own);
        }
        // Beside everything: the nearest, if it is within the radius.
        let (x, y) = pixel(-4.0, 3.5);
        let found = frame.pick_near(x - 8, y, 12.0).unwrap();
        assert_eq!((found.part, found.kind), (1, HitKind::Exact));
        assert_eq!(frame.pick_near(0, 0, 4.0).unwrap().part, NONE);
    }
    for bad in [-1.0, 33.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(frame.pick_near(5, 5, bad), Err(Error::BadArgument(_))));
    }
    assert!(frame.pick_near(100, 5, 1.0).is_err());
}
