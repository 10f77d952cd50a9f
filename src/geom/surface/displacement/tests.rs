//! Heights against sums over all texels and finite differences; displaced surfaces against closed forms.

use super::{Displaced, HeightSample, Heights, NormalFrame, Wrap, displace};
use crate::geom::surface::SurfacePoint;
use crate::geom::surface::nurbs::tests::rng::Rng;
use crate::geom::surface::nurbs::tests::sphere;
use glam::DVec3;

fn random(rng: &mut Rng, size: [u32; 2], count: u32, wrap: [Wrap; 2]) -> (Heights, Vec<f32>) {
    let texels: Vec<f32> = (0..size[0] * size[1] * count).map(|_| rng.between(-1.0, 1.0) as f32).collect();
    (Heights::new(size, count, wrap, texels.clone()).expect("heights"), texels)
}

fn any_wrap(rng: &mut Rng) -> [Wrap; 2] {
    [0, 1].map(|_| if rng.one_in(2) { Wrap::Clamp } else { Wrap::Repeat })
}

/// The quadratic B-spline of unit knots around 0, by its three pieces.
fn bump(x: f64) -> f64 {
    let x = x.abs();
    if x < 0.5 { 0.75 - x * x } else { 0.5 * (1.5 - x).max(0.0).powi(2) }
}

#[test]
fn heights_are_sums_of_bumps() {
    let mut rng = Rng::new(21);
    for _ in 0..200 {
        let (size, wrap) = ([1 + rng.below(6) as u32, 1 + rng.below(6) as u32], any_wrap(&mut rng));
        let (heights, texels) = random(&mut rng, size, 3, wrap);
        let (map, s, t) = (rng.below(3), rng.between(-1.5, 2.5), rng.between(-1.5, 2.5));
        let index = |axis: usize, i: i64| match wrap[axis] {
            Wrap::Repeat => i.rem_euclid(i64::from(size[axis])),
            Wrap::Clamp => i.clamp(0, i64::from(size[axis]) - 1),
        };
        let mut sum = 0.0;
        for (i, j) in (-20..40i64).flat_map(|i| (-20..40i64).map(move |j| (i, j))) {
            let texel = map as i64 * i64::from(size[0] * size[1]) + index(1, j) * i64::from(size[0]) + index(0, i);
            let (x, y) = (s * f64::from(size[0]) - i as f64 - 0.5, t * f64::from(size[1]) - j as f64 - 0.5);
            sum += f64::from(texels[texel as usize]) * bump(x) * bump(y);
        }
        let found = heights.sample(map as u32, s, t).value;
        assert!((found - sum).abs() < 1e-13, "{size:?} {wrap:?} {s} {t}: {found} {sum}");
    }
}

#[test]
fn derivatives_of_heights_are_limits_of_differences() {
    let (mut rng, h) = (Rng::new(22), 1e-5);
    let (heights, _) = random(&mut rng, [7, 5], 1, [Wrap::Repeat, Wrap::Clamp]);
    for _ in 0..1000 {
        // Away from the borders of texels, where second derivatives jump.
        let at = |rng: &mut Rng, size: usize| (rng.below(size) as f64 + rng.between(0.01, 0.99)) / size as f64;
        let (s, t) = (at(&mut rng, 7), at(&mut rng, 5));
        let value = |i: f64, j: f64| heights.sample(0, s + i * h, t + j * h);
        let (a, b, c, d) = (value(-1.0, 0.0), value(1.0, 0.0), value(0.0, -1.0), value(0.0, 1.0));
        let difference = |a: f64, b: f64| (b - a) / (2.0 * h);
        let near =
            |exact: f64, found: f64| assert!((exact - found).abs() < 1e-5 * exact.abs().max(1.0), "{exact} {found}");
        let HeightSample { gradient, second, .. } = heights.sample(0, s, t);
        near(gradient[0], difference(a.value, b.value));
        near(gradient[1], difference(c.value, d.value));
        near(second[0], difference(a.gradient[0], b.gradient[0]));
        near(second[1], difference(c.gradient[0], d.gradient[0]));
        near(second[1], difference(a.gradient[1], b.gradient[1]));
        near(second[2], difference(c.gradient[1], d.gradient[1]));
    }
}

#[test]
fn the_gradient_is_continuous_at_texels_and_at_the_seam() {
    let (heights, _) = random(&mut Rng::new(23), [8, 8], 1, [Wrap::Repeat, Wrap::Clamp]);
    for s in (0..=8).map(|i| f64::from(i) / 8.0) {
        let (before, after) = (heights.sample(0, s - 1e-12, 0.3), heights.sample(0, s + 1e-12, 0.3));
        assert!((before.value - after.value).abs() < 1e-9 && (before.gradient[0] - after.gradient[0]).abs() < 1e-8);
    }
}

#[test]
fn ranges_enclose_all_heights_and_are_close() {
    let (mut rng, mut looseness) = (Rng::new(24), Vec::new());
    for round in 0..400 {
        let (most, wrap) = ([5, 40, 300][round % 3], any_wrap(&mut rng));
        let size = [0, 1].map(|_| 1 + rng.below(most) as u32);
        let (heights, texels) = random(&mut rng, size, 2, wrap);
        let map = rng.below(2) as u32;
        let side = 10f64.powf(rng.between(-3.0, 0.3));
        let rect = [0, 1].map(|_| rng.between(-1.0, 1.5)).map(|begin| [begin, begin + side * rng.unit()]);
        let range = heights.range(map, rect);
        let mut seen = [f64::INFINITY, f64::NEG_INFINITY];
        for _ in 0..300 {
            let [s, t] = rect.map(|[a, b]| if rng.one_in(8) { a } else { rng.between(a, b) });
            let value = heights.sample(map, s, t).value;
            assert!(range[0] <= value && value <= range[1], "{size:?} {rect:?}: {value} {range:?}");
            seen = [seen[0].min(value), seen[1].max(value)];
        }
        let area = (size[0] * size[1]) as usize;
        let all = &texels[map as usize * area..][..area];
        assert!(range[0] >= f64::from(all.iter().copied().fold(1.0, f32::min)) - 1e-14, "no less than all texels");
        if size[0].min(size[1]) > 8 {
            looseness.push((range[1] - range[0]) / (seen[1] - seen[0]).max(1e-3));
        }
    }
    looseness.sort_by(f64::total_cmp);
    println!("ranges: {:.2} of that of the samples, median of noise", looseness[looseness.len() / 2]);
}

#[test]
fn a_rectangle_has_the_range_of_the_texels_around_it() {
    let mut texels = vec![0.0; 64 * 64];
    texels[20 * 64 + 30] = 1.0;
    let heights = Heights::new([64, 64], 1, [Wrap::Repeat; 2], texels).expect("heights");
    let greatest = |x: f64, y: f64| heights.range(0, [[x / 64.0, (x + 0.5) / 64.0], [y / 64.0, (y + 0.5) / 64.0]])[1];
    // The bump reaches 1 ½ texels; its top is 9/16.
    assert!((0.5625..0.66).contains(&greatest(30.2, 20.2)), "{}", greatest(30.2, 20.2));
    assert!(greatest(29.2, 20.2) > 0.1 && greatest(31.2, 20.2) > 0.1 && greatest(29.2, 19.2) > 0.05);
    assert!(greatest(28.2, 20.2) < 0.1 && greatest(32.2, 20.2) < 0.1 && greatest(30.2, 22.2) < 0.1);
    // A large one reads cells of up to a quarter of its side beyond.
    assert!(heights.range(0, [[0.0, 0.3], [0.5, 0.9]])[1] < 0.1 && heights.range(0, [[0.0, 0.9]; 2])[1] > 0.7);
}

#[test]
fn bounds_of_large_rectangles_are_rounded_outwards() {
    // The mean of both heights is no single-precision number, and would be rounded up.
    let (low, high) = (1.0 + f32::EPSILON, 1.0 + 2.0 * f32::EPSILON);
    let texels = (0..32 * 32).map(|at| if at % 32 < 16 { low } else { high }).collect();
    let heights = Heights::new([32, 32], 1, [Wrap::Clamp; 2], texels).expect("heights");
    let least = heights.sample(0, 0.5, 0.5).value;
    assert_eq!(least, 0.5 * (f64::from(low) + f64::from(high)));
    assert!(heights.range(0, [[0.5, 1.0], [0.0, 1.0]])[0] <= least);
}

#[test]
fn bad_heights_are_refused_and_bad_coordinates_are_not() {
    let new = |size, count, texels| Heights::new(size, count, [Wrap::Clamp; 2], texels).map_err(|e| e.to_string());
    assert!(new([0, 4], 1, vec![]).expect_err("empty").contains("0 texels are not 1 maps of 0 × 4, or none"));
    assert!(new([u32::MAX; 2], u32::MAX, vec![0.0]).is_err() && new([2, 2], 2, vec![0.0; 4]).is_err());
    let mut texels = vec![0.0; 12];
    texels[11] = f32::NAN;
    assert_eq!(
        new([3, 2], 2, texels).expect_err("NaN"),
        "bad argument: displacement: texel (2, 1) of map 1 is not finite"
    );
    for wrap in [Wrap::Clamp, Wrap::Repeat] {
        let heights = Heights::new([2, 2], 1, [wrap; 2], vec![1.0; 4]).expect("heights");
        for s in [f64::NAN, f64::INFINITY, f64::MAX, -1e300, 1e11] {
            assert_eq!(heights.sample(0, s, 0.0).value, 1.0);
            let range = heights.range(0, [[s, 0.5], [0.0, s]]);
            assert!(range[0] < 1.0 && range[1] > 1.0 && range[1] - range[0] < 1e-13);
        }
    }
}

#[test]
fn faces_with_equal_border_texels_meet() {
    let mut rng = Rng::new(25);
    let (_, mut texels) = random(&mut rng, [4, 4], 2, [Wrap::Clamp; 2]);
    // The right border of map 0 is the left border of map 1.
    (0..4).for_each(|row| texels[16 + row * 4] = texels[row * 4 + 3]);
    let heights = Heights::new([4, 4], 2, [Wrap::Clamp; 2], texels).expect("heights");
    for t in (0..=20).map(|i| f64::from(i) / 20.0) {
        assert_eq!(heights.sample(0, 1.0, t).value, heights.sample(1, 0.0, t).value);
    }
}

#[test]
fn a_sphere_moved_by_a_constant_is_a_sphere() {
    let (surface, mut rng) = (sphere().surface(), Rng::new(26));
    for height in [0.5, -0.25, -2.0] {
        for _ in 0..1000 {
            let (u, v) = (rng.between(0.0, 4.0), rng.between(0.01, 1.99));
            let point = surface.evaluate(u, v);
            let frame = NormalFrame::of(&point).expect("a normal");
            let found = displace(&point, &frame, height, [0.0; 2]);
            assert!((found.position.length() - (1.0 + height).abs()).abs() < 1e-14);
            // Both derivatives grow with the radius.
            assert!(found.du.distance(point.du * (1.0 + height)) < 1e-12);
            assert!(found.dv.distance(point.dv * (1.0 + height)) < 1e-12);
        }
        let pole = surface.evaluate(0.4, 0.0);
        let frame = surface.frame_limit(0.4, 0.0).expect("a limit");
        let found = displace(&pole, &frame, height, [0.0; 2]);
        assert!(found.dv.distance(pole.dv * (1.0 + height)) < 1e-7);
    }
}

#[test]
fn derivatives_of_the_displaced_surface_are_limits_of_differences() {
    let (surface, mut rng, h) = (sphere().surface(), Rng::new(27), 1e-6);
    let (heights, _) = random(&mut rng, [4, 4], 1, [Wrap::Repeat; 2]);
    for _ in 0..500 {
        let (u, v) = (rng.between(0.1, 3.9), rng.between(0.1, 1.9));
        // s = 0.3 u + 0.1 v, t = 0.2 v.
        let at = |u: f64, v: f64| -> Displaced {
            let point: SurfacePoint = surface.evaluate(u, v);
            let sample = heights.sample(0, 0.3 * u + 0.1 * v, 0.2 * v);
            let gradient = sample.gradient_by([0.3, 0.1], [0.0, 0.2]);
            displace(&point, &NormalFrame::of(&point).expect("a normal"), sample.value, gradient)
        };
        let difference = |a: Displaced, b: Displaced| -> DVec3 { (b.position - a.position) / (2.0 * h) };
        let found = at(u, v);
        let by_u = difference(at(u - h, v), at(u + h, v));
        let by_v = difference(at(u, v - h), at(u, v + h));
        assert!(
            found.du.distance(by_u) < 1e-5 && found.dv.distance(by_v) < 1e-5,
            "({u}, {v}): {found:?} {by_u} {by_v}"
        );
        assert!((found.normal().length() - 1.0).abs() < 1e-14);
    }
}
