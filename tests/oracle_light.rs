//! The oracle's coverage, ambient occlusion and direct light are held to closed forms: what an estimate says is off by,
//! times a few, and what the shapes' facets take away.

use crate::common::brute::{Brute, Oracle, Ray64, Tri};
use crate::common::bvh64::Bvh64;
use crate::common::light::{Lighting, Surface};
use crate::common::rng::Rng;
use crate::common::samples::{Estimate, Samples, point};
use crate::common::scenes;
use crate::common::view::View;
use glam::{DMat3, DVec2, DVec3};
use outcrop::Camera;
use outcrop::scene::{Light, LightKind};
use std::f64::consts::{PI, TAU};

const SAMPLES: Samples = Samples { points: 1024, rounds: 16, seed: 1 };
/// Standard errors that a mean of 16 rounds may be off by: Student's t with 15 degrees of freedom exceeds it once
/// in 3000.
const DEVIATIONS: f64 = 4.5;

#[track_caller]
fn agrees(found: Estimate, truth: f64, slack: f64) {
    assert!(found.agrees(truth, DEVIATIONS, slack + 1e-12), "{found:?} is not {truth}");
    // It says something: nowhere near what one random sample would be off by over all samples' root, sqrt(1/4 / 16384).
    assert!(found.error < 0.004, "{found:?} is too rough");
}

/// Straight down on the plane of x and y, one unit a pixel: x to the right, y down from `corner`.
fn plan(corner: DVec2, width: u32, height: u32) -> View {
    let middle = corner + DVec2::new(f64::from(width), -f64::from(height)) / 2.0;
    let at = middle.extend(0.0);
    View::new(
        &Camera::Orthographic { eye: at + DVec3::Z * 50.0, at, up: DVec3::Y, height: f64::from(height) },
        width,
        height,
    )
}

fn quad(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Vec<Tri> {
    vec![[a, b, c], [a, c, d]]
}

/// A flat regular polygon as a fan.
fn disc(middle: DVec3, across: DVec3, radius: f64, corners: usize) -> Vec<Tri> {
    let (x, y) = across.any_orthonormal_pair();
    let at = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / corners as f64).sin_cos();
        middle + (x * cos + y * sin) * radius
    };
    (0..corners).map(|k| [middle, at(k), at(k + 1)]).collect()
}

fn turned(tris: Vec<Tri>, turn: DMat3) -> Vec<Tri> {
    tris.into_iter().map(|t| t.map(|v| turn * v)).collect()
}

/// A point that looks along `normal`.
fn facing(position: DVec3, normal: DVec3) -> Surface {
    Surface { position, normal, to_eye: normal, prim: 0 }
}

fn openness(tris: Vec<Tri>, at: DVec3, reach: f64) -> Estimate {
    let oracle = Bvh64::new(tris);
    Lighting::new(&oracle).openness(&facing(at, DVec3::Z), reach, &SAMPLES, 3)
}

// The samples.

#[test]
fn a_point_lies_in_every_elementary_interval_whatever_the_digits() {
    let mut rng = Rng::new(4);
    for scramble in [0, rng.bits(), rng.bits()] {
        for columns in 0..=8 {
            let (wide, high) = (1usize << columns, 1usize << (8 - columns));
            let mut seen = vec![0; 256];
            for i in 0..256 {
                let [x, y] = point(i, scramble);
                assert!(x > 0.0 && x < 1.0 && y > 0.0 && y < 1.0);
                seen[(x * wide as f64) as usize + (y * high as f64) as usize * wide] += 1;
            }
            assert!(seen.iter().all(|n| *n == 1), "{wide} by {high}");
        }
    }
}

#[test]
fn estimates_say_how_far_off_they_are() {
    // A quarter of a disc: pi / 4. Of many seeds the errors, in the standard errors that were stated, are like
    // Student's t with 15 degrees of freedom: variance 15 / 13.
    let quarter = |[x, y]: [f64; 2]| [f64::from(u8::from(x * x + y * y < 1.0)), x * y];
    let count = 400;
    let (mut squares, mut sums) = ([0.0; 2], [0.0; 2]);
    for seed in 0..count {
        let samples = Samples { points: 128, rounds: 16, seed };
        let found = samples.estimate(7, quarter);
        for (c, truth) in [PI / 4.0, 0.25].into_iter().enumerate() {
            let off = (found[c].mean - truth) / found[c].error;
            squares[c] += off * off;
            sums[c] += off;
        }
        // Far better than as many random points, which are off by sqrt(p (1 - p) / n) = 0.009.
        assert!(found[0].error < 0.005, "{found:?}");
    }
    for c in 0..2 {
        let (variance, bias) = (squares[c] / count as f64, sums[c] / (count as f64).sqrt());
        assert!((0.8..1.6).contains(&variance), "{variance}");
        assert!(bias.abs() < 4.0, "{bias} standard errors of bias");
    }
}

#[test]
fn keys_and_seeds_take_other_samples_and_threads_do_not() {
    let oracle = Bvh64::new(scenes::bumpy_sphere(30, 40, 2));
    let lighting = Lighting::new(&oracle);
    let view = plan(DVec2::new(-2.0, 2.0), 4, 4);
    let picture = |samples: Samples, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let all = pool.install(|| view.pixels(|x, y| lighting.coverage(&view, x, y, &samples)));
        all.iter().map(|e| (e.mean.to_bits(), e.error.to_bits())).collect::<Vec<_>>()
    };
    let samples = Samples { points: 64, ..SAMPLES };
    let one = picture(samples, 1);
    assert!(one == picture(samples, 3));
    assert!(one != picture(Samples { seed: 2, ..samples }, 1));
    // Opposite corners of a symmetric scene are alike, and not the same.
    let slanted = |[x, y]: [f64; 2]| [x * y];
    assert_ne!(samples.estimate(1, slanted), samples.estimate(2, slanted));
}

// Coverage.

#[test]
fn a_view_is_the_camera_that_pictures_are_made_with() {
    let (eye, at, up) = (DVec3::new(3.0, -4.0, 5.0), DVec3::new(0.5, 1.0, -1.0), DVec3::new(0.1, 0.2, 1.0));
    for camera in
        [Camera::Perspective { eye, at, up, fov_y_degrees: 37.0 }, Camera::Orthographic { eye, at, up, height: 6.0 }]
    {
        let (view, rays) = (View::new(&camera, 30, 20), camera.prepare(30, 20).expect("a camera"));
        for (x, y) in [(0.0, 0.0), (0.5, 19.5), (15.0, 10.0), (29.25, 3.0)] {
            let (ours, theirs) = (view.ray(x, y), rays.ray(x, y));
            assert!(ours.org.distance(theirs.origin) < 1e-12);
            // Theirs are in single precision.
            assert!(ours.dir.distance(theirs.dir.as_dvec3().normalize()) < 1e-6, "{ours:?} {theirs:?}");
        }
        assert!((view.pixel_width(2.5) - rays.pixel_width(2.5)).abs() < 1e-12);
        assert!((view.depth(at) - eye.distance(at)).abs() < 1e-12);
    }
}

#[test]
fn a_half_plane_covers_what_lies_below_its_edge() {
    // y < 0.3 + 0.25 x, of the pixels [0, 1] and [1, 2] by [0, 1]: 0.3 + 0.125 and 0.55 + 0.125.
    let edge = |x: f64| DVec3::new(x, 0.3 + 0.25 * x, 0.0);
    let deep = |x: f64| DVec3::new(x, -100.0, 0.0);
    let oracle = Brute::new(quad(deep(-90.0), deep(90.0), edge(90.0), edge(-90.0)));
    let (lighting, view) = (Lighting::new(&oracle), plan(DVec2::new(0.0, 1.0), 2, 1));
    let found = view.pixels(|x, y| lighting.coverage(&view, x, y, &SAMPLES));
    agrees(found[0], 0.425, 0.0);
    agrees(found[1], 0.675, 0.0);
    // Seen in perspective from 50 above, where a pixel at distance 1 is a fiftieth: the same.
    let fov_y_degrees = 2.0 * (0.5f64 / 50.0).atan().to_degrees();
    let eye = DVec3::new(1.0, 0.5, 50.0);
    let camera = Camera::Perspective { eye, at: eye - DVec3::Z, up: DVec3::Y, fov_y_degrees };
    let view = View::new(&camera, 2, 1);
    agrees(lighting.coverage(&view, 0, 0, &SAMPLES), 0.425, 0.0);
    // All and nothing are exact.
    let view = plan(DVec2::new(0.0, 3.0), 1, 5);
    let found = view.pixels(|x, y| lighting.coverage(&view, x, y, &SAMPLES));
    assert_eq!((found[0], found[4]), (Estimate::default(), Estimate { mean: 1.0, error: 0.0 }));
}

#[test]
fn a_disc_covers_its_area() {
    let corners = 360;
    let area = |radius: f64| 0.5 * corners as f64 * radius * radius * (TAU / corners as f64).sin();
    // Within a pixel.
    let small = Bvh64::new(disc(DVec3::new(0.45, 0.55, 1.0), DVec3::Z, 0.4, corners));
    agrees(Lighting::new(&small).coverage(&plan(DVec2::Y, 1, 1), 0, 0, &SAMPLES), area(0.4), 0.0);
    // Over many: the sum, whose errors are independent.
    let large = Bvh64::new(disc(DVec3::new(0.2, 0.1, 1.0), DVec3::Z, 3.3, corners));
    let (lighting, view) = (Lighting::new(&large), plan(DVec2::new(-4.0, 4.0), 8, 8));
    let found = view.pixels(|x, y| lighting.coverage(&view, x, y, &SAMPLES));
    let mean = found.iter().map(|e| e.mean).sum();
    let error = found.iter().map(|e| e.error * e.error).sum::<f64>().sqrt();
    agrees(Estimate { mean, error }, area(3.3), 0.0);
}

#[test]
fn a_thin_wire_covers_its_width_times_its_length() {
    // A square bar 0.02 thick, straight through a pixel from the left border to the right one at 20 degrees: 0.02 /
    // cos 20.
    let thin = 0.02;
    let angle = 20f64.to_radians();
    let bar = scenes::cuboid(DVec3::new(-9.0, -thin / 2.0, -thin / 2.0), DVec3::new(9.0, thin / 2.0, thin / 2.0));
    let oracle = Bvh64::new(turned(bar, DMat3::from_rotation_z(angle)));
    let (lighting, view) = (Lighting::new(&oracle), plan(DVec2::new(-0.5, 0.5), 1, 1));
    agrees(lighting.coverage(&view, 0, 0, &SAMPLES), thin / angle.cos(), 0.0);
    // Two tenths of a pixel of it: a needle that ends inside.
    let needle = scenes::cuboid(DVec3::new(-0.1, -thin / 2.0, 0.0), DVec3::new(0.1, thin / 2.0, 0.0)).into_iter();
    let oracle = Brute::new(turned(needle.filter(scenes::has_area).collect(), DMat3::from_rotation_z(angle)));
    agrees(Lighting::new(&oracle).coverage(&view, 0, 0, &SAMPLES), thin * 0.2, 0.0);
}

#[test]
fn coverage_does_not_depend_on_how_triangles_are_found() {
    let tris = scenes::boxes(40, 3);
    let (brute, tree) = (Brute::new(tris.clone()), Bvh64::new(tris));
    let view =
        View::new(&Camera::Orthographic { eye: DVec3::Z * 300.0, at: DVec3::ZERO, up: DVec3::Y, height: 240.0 }, 6, 6);
    let samples = Samples { points: 32, ..SAMPLES };
    let cover = |oracle: &dyn Oracle| view.pixels(|x, y| Lighting::new(oracle).coverage(&view, x, y, &samples));
    let found = cover(&brute);
    assert_eq!(found, cover(&tree));
    assert!(found.iter().any(|e| e.error > 0.0));
}

// Ambient occlusion.

/// The share of a cosine-weighted hemisphere that a polygon above the horizon takes (Lambert 1760): the sum over its
/// edges of the angle between their ends times the normal's share of their plane's normal, over 2 pi.
fn form_factor(at: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let to: Vec<DVec3> = corners.iter().map(|c| (c - at).normalize()).collect();
    let edge = |k: usize| {
        let (a, b) = (to[k], to[(k + 1) % to.len()]);
        a.angle_between(b) * normal.dot(a.cross(b).normalize_or_zero())
    };
    (0..to.len()).map(edge).sum::<f64>().abs() / TAU
}

#[test]
fn a_disc_overhead_shades_its_cap() {
    // Radius 1 at height 2: 1 / (1 + 4), less what a polygon of 512 corners lacks of the circle (2 pi^2 / 3 / 512^2).
    agrees(openness(disc(DVec3::Z * 2.0, DVec3::Z, 1.0, 512), DVec3::ZERO, f64::INFINITY), 0.8, 0.2 * 3e-5);
    // Aslant and aside: by Lambert's sum.
    let (middle, across) = (DVec3::new(1.5, -0.5, 2.0), DVec3::new(0.3, 0.8, 0.6).normalize());
    let tris = disc(middle, across, 1.2, 40);
    let corners: Vec<DVec3> = tris.iter().map(|t| t[1]).collect();
    let share = form_factor(DVec3::ZERO, DVec3::Z, &corners);
    assert!(share > 0.05, "{share}");
    agrees(openness(tris, DVec3::ZERO, f64::INFINITY), 1.0 - share, 0.0);
}

#[test]
fn a_sphere_above_shades_its_cap_by_the_cosine() {
    // (r / d)^2 cos: radius 1, 2.5 away, 40 degrees off the normal. Facets lie within pi / 128 of the sphere's angles:
    // within 3e-4 of its radius, twice that of the share.
    let angle = 40f64.to_radians();
    let middle = DVec3::new(angle.sin(), 0.0, angle.cos()) * 2.5;
    let tris = scenes::sphere(128, 256).into_iter().map(|t| t.map(|v| v + middle)).collect();
    let share = angle.cos() / (2.5 * 2.5);
    agrees(openness(tris, DVec3::ZERO, f64::INFINITY), 1.0 - share, share * 6e-4);
}

/// Floor, and walls at x = 0 and y = 0 that are `size` long and high.
fn corner(walls: usize, size: f64) -> (Vec<Tri>, Vec<[DVec3; 4]>) {
    let (x, y, z) = (DVec3::X * size, DVec3::Y * size, DVec3::Z * size);
    let faces = [[DVec3::ZERO, y, y + z, z], [DVec3::ZERO, x, x + z, z]];
    let faces: Vec<_> = faces[..walls].to_vec();
    let mut tris = quad(-x - y, x - y, x + y, -x + y);
    tris.extend(faces.iter().flat_map(|[a, b, c, d]| quad(*a, *b, *c, *d)));
    (tris, faces)
}

#[test]
fn corners_of_planes_take_half_and_three_quarters() {
    let at = DVec3::new(0.7, 1.1, 0.0);
    for walls in [0, 1, 2] {
        let (tris, faces) = corner(walls, 3.0);
        let shares: Vec<f64> = faces.iter().map(|face| form_factor(at, DVec3::Z, face)).collect();
        agrees(openness(tris, at, f64::INFINITY), 1.0 - shares.iter().sum::<f64>(), 0.0);
    }
    // The limit of high and long walls, which the wall that is nearer lacks 1e-6 of; the wall at x = 0 begins at y = 0.
    let far = 1e6;
    let (tris, _) = corner(2, far);
    agrees(openness(tris, DVec3::new(0.7, 1.1, 0.0), f64::INFINITY), 0.25, 1e-5);
    let (tris, _) = corner(1, far);
    agrees(openness(tris, DVec3::new(0.7, far / 2.0, 0.0), f64::INFINITY), 0.5, 1e-5);
}

#[test]
fn what_is_out_of_reach_shades_nothing() {
    // A wall at distance 1 as far as 2 reaches: of the hemisphere's disc the segment beyond 1 / 2.
    let (tris, _) = corner(1, 1e3);
    let at = DVec3::new(1.0, 500.0, 0.0);
    let segment = (0.5f64.acos() - 0.5 * 0.75f64.sqrt()) / PI;
    agrees(openness(tris.clone(), at, 2.0), 1.0 - segment, 0.0);
    assert_eq!(openness(tris, at, 0.999), Estimate { mean: 1.0, error: 0.0 });
}

// Direct light.

const LAMP: Light = Light { kind: LightKind::Headlight, colour: [1.0, 0.5, 0.25], intensity: 8.0, shadows: true };

fn lamp(position: DVec3) -> Light {
    Light { kind: LightKind::Point(position), ..LAMP }
}

fn sun(along: DVec3) -> Light {
    Light { kind: LightKind::Directional(along), ..LAMP }
}

#[track_caller]
fn near(found: DVec3, truth: DVec3) {
    assert!(found.distance(truth) <= 1e-9 * (1.0 + truth.length()), "{found} is not {truth}");
}

#[test]
fn lights_on_a_plane_fall_off_with_cosine_and_square() {
    let (tris, _) = corner(0, 100.0);
    let oracle = Brute::new(tris);
    let lighting = Lighting::new(&oracle);
    let colour = DVec3::new(8.0, 4.0, 2.0);
    let at = facing(DVec3::new(3.0, 1.0, 0.0), DVec3::Z);
    // 4 to the side, 3 up: cosine 3 / 5, square 25.
    near(lighting.irradiance(&at, &[lamp(DVec3::new(7.0, 1.0, 3.0))]), colour * (0.6 / 25.0));
    near(lighting.irradiance(&at, &[sun(DVec3::new(4.0, 0.0, -3.0) * 9.0)]), colour * 0.6);
    let aslant = Surface { to_eye: DVec3::new(0.0, 0.6, 0.8), ..at };
    near(lighting.irradiance(&aslant, &[LAMP]), colour * 0.8);
    // From below: nothing, with shadows or without.
    for shadows in [true, false] {
        let below = [Light { shadows, ..lamp(DVec3::new(3.0, 1.0, -2.0)) }, Light { shadows, ..sun(DVec3::Z) }];
        near(lighting.irradiance(&at, &below), DVec3::ZERO);
    }
    // They add up.
    let both = [lamp(DVec3::new(3.0, 1.0, 2.0)), sun(-DVec3::Z)];
    near(lighting.irradiance(&at, &both), colour * 1.25);
}

#[test]
fn shadows_end_where_the_blocker_does() {
    // A disc of radius 1 halfway up to a lamp at 4 throws a shadow of radius 2; of the sun, of radius 1.
    let (mut tris, _) = corner(0, 100.0);
    tris.extend(disc(DVec3::Z * 2.0, DVec3::Z, 1.0, 720));
    let oracle = Bvh64::new(tris);
    let lighting = Lighting::new(&oracle);
    let is_lit = |x: f64, light: Light| lighting.irradiance(&facing(DVec3::X * x, DVec3::Z), &[light]) != DVec3::ZERO;
    let (above, down) = (lamp(DVec3::Z * 4.0), sun(-DVec3::Z));
    assert_eq!([0.0, 1.99, 2.01].map(|x| is_lit(x, above)), [false, false, true]);
    assert_eq!([0.0, 0.99, 1.01].map(|x| is_lit(x, down)), [false, false, true]);
    // What lies behind a lamp shades nothing, nor does anything where shadows are off, or the light is where the eye
    // is.
    assert!(is_lit(0.0, LAMP) && is_lit(0.0, lamp(DVec3::Z * 1.9)) && is_lit(0.0, Light { shadows: false, ..above }));
}

#[test]
fn a_pixels_radiance_is_the_mean_of_its_square() {
    // The mean of z / (x^2 + y^2 + z^2)^(3/2) over a square from the foot of the lamp is the solid angle of it over its
    // area: atan(a b / (z sqrt(a^2 + b^2 + z^2))).
    let (tris, _) = corner(0, 100.0);
    let oracle = Brute::new(tris);
    let lighting = Lighting::new(&oracle);
    let view = plan(DVec2::new(0.0, 1.0), 1, 1);
    // The eye's plane is at 50, the lamp below it.
    let found =
        lighting.radiance(&view, [0, 0], &[lamp(DVec3::Z * 0.8)], &|_| DVec3::new(0.5, 1.0, 0.0), DVec3::ONE, &SAMPLES);
    let solid_angle = (1.0 / (0.8 * (2.0f64 + 0.64).sqrt())).atan();
    for (found, strength) in found.into_iter().zip([4.0, 4.0, 0.0]) {
        agrees(found, strength * solid_angle, 0.0);
    }
    // Where nothing is, the background.
    let aside = plan(DVec2::new(200.0, 1.0), 1, 1);
    let found = lighting.radiance(&aside, [0, 0], &[LAMP], &|_| DVec3::ONE, DVec3::new(0.1, 0.2, 0.3), &SAMPLES);
    agrees(found[1], 0.2, 0.0);
}

// Furnaces.

#[test]
fn nothing_gets_into_a_closed_box() {
    // Not parallel to anything, far from zero too.
    for shift in [DVec3::ZERO, DVec3::new(1e6, -2e6, 5e5)] {
        let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_y(-0.4);
        let tris = turned(scenes::cuboid(-DVec3::ONE, DVec3::ONE), turn);
        let oracle = Bvh64::new(tris.iter().map(|t| t.map(|v| v + shift)).collect());
        let lighting = Lighting::new(&oracle);
        let mut rng = Rng::new(6);
        for i in 0..200 {
            // On an inner wall, up to its edges.
            let ray = Ray64::new(shift, rng.direction());
            let inner = lighting.surface(&ray).expect("a wall");
            assert!(inner.normal.dot(ray.dir) < 0.0);
            let lights = [lamp(shift + rng.direction() * 5.0), sun(rng.direction())];
            assert_eq!(lighting.irradiance(&inner, &lights), DVec3::ZERO, "{inner:?} {lights:?}");
            let samples = Samples { points: 64, ..SAMPLES };
            assert_eq!(lighting.openness(&inner, f64::INFINITY, &samples, i), Estimate::default());
            // Outside, the whole sky is there.
            let outer = lighting.surface(&Ray64::new(shift - ray.dir * 9.0, ray.dir)).expect("the box");
            assert_eq!(lighting.openness(&outer, f64::INFINITY, &samples, i).mean, 1.0);
        }
    }
}

#[test]
fn a_uniform_sky_of_suns_gives_a_convex_body_pi_everywhere() {
    // n suns of 4 pi / n from all over the sphere: the integral of the cosine, pi. On a lattice that is spread as
    // evenly as can be (Fibonacci's spiral), so that 2000 are off by less than 1 in 1000.
    let n = 2000;
    let golden = PI * (3.0 - 5f64.sqrt());
    let sky: Vec<Light> = (0..n)
        .map(|i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let (sin, cos) = (golden * f64::from(i)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Light {
                colour: [1.0; 3],
                intensity: (4.0 * PI / f64::from(n)) as f32,
                ..sun(DVec3::new(r * cos, r * sin, z))
            }
        })
        .collect();
    let oracle = Bvh64::new(scenes::sphere(24, 48));
    let lighting = Lighting::new(&oracle);
    let mut rng = Rng::new(8);
    for _ in 0..30 {
        let from = rng.direction() * 4.0;
        let at = lighting.surface(&Ray64::new(from, -from.normalize())).expect("the sphere");
        let found = lighting.irradiance(&at, &sky).x;
        assert!((found - PI).abs() < 3e-3, "{found}");
    }
}

#[test]
fn a_lamp_in_the_middle_of_a_sphere_lights_every_pixel_alike() {
    // Radius 1, strength 1: 1 everywhere. Facets lean by half of what they span, pi / 100, and are as much nearer
    // squared.
    let oracle = Bvh64::new(scenes::sphere(100, 200));
    let lighting = Lighting::new(&oracle);
    let eye = DVec3::new(0.3, -0.2, 0.4);
    let camera = Camera::Perspective { eye, at: DVec3::new(-1.0, 0.5, 0.0), up: DVec3::Z, fov_y_degrees: 90.0 };
    let view = View::new(&camera, 8, 8);
    let light = Light { colour: [1.0; 3], intensity: 1.0, ..lamp(DVec3::ZERO) };
    let samples = Samples { points: 64, ..SAMPLES };
    let found =
        view.pixels(|x, y| lighting.radiance(&view, [x, y], &[light], &|_| DVec3::ONE, DVec3::ZERO, &samples)[0]);
    for pixel in found {
        agrees(pixel, 1.0, 1e-3);
        assert!(pixel.mean > 0.9995, "{pixel:?}");
    }
}
