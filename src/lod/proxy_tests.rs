use super::*;
use crate::lod::{Facing, stored_colour, stored_likeness, stored_normal, visible};
use glam::DVec3;
use proptest::prelude::*;

/// Unit vectors spread evenly over all directions.
fn views(count: usize) -> impl Iterator<Item = DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (across, turn) = ((1.0 - z * z).sqrt(), golden * i as f64);
        DVec3::new(across * turn.cos(), across * turn.sin(), z)
    })
}

/// A shape: the unit normal of the first surface on a ray, from outside of the unit box.
type Shape = fn(DVec3, DVec3) -> Option<DVec3>;

/// A rectangle in the unit box: the coordinate of its plane's axis, and its ends on the axes.
fn rectangle(org: DVec3, dir: DVec3, axis: usize, at: f64) -> Option<(f64, DVec3)> {
    let t = (at - org[axis]) / dir[axis];
    let p = org + dir * t;
    let is_in = (0..3).all(|i| i == axis || (0.0..=1.0).contains(&p[i]));
    (t.is_finite() && is_in).then_some((t, DVec3::AXES[axis]))
}

fn first(all: impl IntoIterator<Item = Option<(f64, DVec3)>>) -> Option<DVec3> {
    all.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0)).map(|hit| hit.1)
}

fn plate(org: DVec3, dir: DVec3) -> Option<DVec3> {
    first([rectangle(org, dir, 2, 0.5)])
}

/// A plate that no axis and no direction of the proxy is along.
fn tilted(org: DVec3, dir: DVec3) -> Option<DVec3> {
    let normal = DVec3::new(0.37, -0.21, 0.88).normalize();
    let t = (0.5 * normal.element_sum() - org.dot(normal)) / dir.dot(normal);
    let is_in = (org + dir * t - 0.5).abs().max_element() <= 0.5;
    (t.is_finite() && is_in).then_some(normal)
}

/// Two faces of a box at its edge.
fn edge(org: DVec3, dir: DVec3) -> Option<DVec3> {
    first([rectangle(org, dir, 0, 1.0), rectangle(org, dir, 1, 1.0)])
}

fn cube(org: DVec3, dir: DVec3) -> Option<DVec3> {
    first((0..6).map(|i| rectangle(org, dir, i / 2, (i % 2) as f64)))
}

fn sphere(org: DVec3, dir: DVec3) -> Option<DVec3> {
    let from = org - 0.5;
    let (b, c) = (from.dot(dir), from.length_squared() - 0.25);
    let root = (b * b - c).sqrt();
    (root >= 0.0).then(|| (from + dir * (-b - root)) * 2.0)
}

const SHAPES: [(&str, Shape); 5] =
    [("plate", plate), ("tilted plate", tilted), ("edge", edge), ("cube", cube), ("sphere", sphere)];

const UNIT: Bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };

/// Mean cosine between eye and normals over the visible surface, by a grid of rays in double precision, and their
/// number.
fn exact(shape: Shape, to_eye: DVec3) -> [f64; 2] {
    let (u, v) = to_eye.any_orthonormal_pair();
    let (mut sum, mut hits) = (0.0, 0.0f64);
    for i in 0..100 * 100 {
        let at = |i: usize| (i as f64 + 0.5) / 50.0 - 1.0;
        let org = DVec3::splat(0.5) + u * at(i % 100) + v * at(i / 100) + to_eye * 4.0;
        if let Some(n) = shape(org, -to_eye) {
            (sum, hits) = (sum + n.dot(to_eye).abs(), hits + 1.0);
        }
    }
    [sum / hits.max(1.0), hits]
}

/// Samples a shape with `rays` lines, as `structure::bvh::build` samples subtrees.
fn sampled(shape: Shape, rays: u32) -> Sampler {
    let mut sampler = Sampler::default();
    for i in 0..rays {
        let (org, dir) = line_into(&UNIT, [2, 3, 5, 7].map(|base| halton(i, base)));
        // The origin is moved back, so that no rounding puts it behind a face of the cube.
        if let Some(n) = shape((org - dir).as_dvec3(), dir.as_dvec3()) {
            sampler.push(dir, n.as_vec3(), Vec3::splat(0.6));
        }
    }
    sampler
}

/// The light of a light at the eye that a proxy reflects.
fn brightness(looks: &Looks, to_eye: Vec3) -> f32 {
    let (firsts, _, shares) = seen(looks, to_eye);
    let normals = firsts.map(|first| {
        let n = stored_normal(first);
        visible(if n.dot(to_eye) < 0.0 { -n } else { n }, stored_likeness(first), to_eye)
    });
    Facing::new(normals, shares).mean().dot(to_eye)
}

/// The same in the paper's way: the interpolated directions of the mean normals of each direction.
fn papers(sampler: &Sampler, to_eye: Vec3) -> f32 {
    let (at, shares) = nearest(to_eye);
    let mut mean = Vec3::ZERO;
    for (k, share) in at.into_iter().zip(shares) {
        let mut normal = Vec3::ZERO;
        for hit in &sampler.hits {
            normal += (0..3).filter(|&i| hit.at[i] == k).map(|i| hit.normal * hit.shares[i]).sum::<Vec3>();
        }
        mean += normal.normalize_or_zero() * share;
    }
    mean.normalize_or_zero().dot(to_eye)
}

/// Mean brightness over views, weighted by what is visible: exact, of the proxy and in the paper's way. And the mean
/// and the greatest difference of the proxy in one view.
fn compared(shape: Shape, rays: u32) -> [f64; 5] {
    let mut sampler = sampled(shape, rays);
    let looks = sampler.looks().expect("hits");
    let (mut sums, mut all, mut apart, mut most) = ([0.0; 3], 0.0, 0.0, 0.0f64);
    for to_eye in views(400) {
        let [right, weight] = exact(shape, to_eye);
        let own = f64::from(brightness(&looks, to_eye.as_vec3()));
        let of_paper = f64::from(papers(&sampler, to_eye.as_vec3()));
        for (sum, value) in sums.iter_mut().zip([right, own, of_paper]) {
            *sum += value * weight;
        }
        all += weight;
        apart += (own - right).abs() * weight;
        most = if weight > 100.0 { most.max((own - right).abs()) } else { most };
    }
    [sums[0] / all, sums[1] / all, sums[2] / all, apart / all, most]
}

/// The mean over all views is right, and that in one view nearly so. The paper's way is too bright where normals
/// differ.
#[test]
fn mean_brightness_is_that_of_double_precision() {
    for (name, shape) in SHAPES {
        for (rays, within) in [(10_000, 0.01), (512, 0.02)] {
            let [right, own, of_paper, apart, most] = compared(shape, rays);
            println!(
                "{name}, {rays} rays: exact {right:.4}, proxy {own:.4}, paper {of_paper:.4}; apart {apart:.4}, {most:.4}"
            );
            assert!((own / right - 1.0).abs() < within, "{name}, {rays} rays: {own} instead of {right}");
            assert!(apart < 0.07, "{name}, {rays} rays: {apart}");
            if name == "edge" || name == "sphere" || name == "cube" {
                assert!(of_paper > 1.08 * right, "{name}: {of_paper}");
            }
        }
    }
}

#[test]
fn a_plate_and_a_sphere_are_right_in_each_view() {
    for (name, shape, limit) in [("plate", plate as Shape, 0.02), ("sphere", sphere, 0.02)] {
        let looks = sampled(shape, 10_000).looks().expect("hits");
        for to_eye in views(400) {
            let expected = if name == "plate" { to_eye.z.abs() } else { 2.0 / 3.0 };
            let own = f64::from(brightness(&looks, to_eye.as_vec3()));
            assert!((own - expected).abs() < limit, "{name} {to_eye}: {own} instead of {expected}");
        }
    }
}

/// An edge seen from straight ahead: both faces appear at 45 degrees.
#[test]
fn an_edge_is_not_too_bright_from_ahead() {
    let mut sampler = sampled(edge, 10_000);
    let ahead = Vec3::new(1.0, 1.0, 0.0).normalize();
    assert!(papers(&sampler, ahead) > 0.97);
    let own = brightness(&sampler.looks().expect("hits"), ahead);
    assert!((own - std::f32::consts::FRAC_1_SQRT_2).abs() < 0.04, "{own}");
}

/// Colours of 5 and 6 bits are coarse, but the mean over the directions is not.
#[test]
fn mean_colour_is_that_of_the_samples() {
    for (i, given) in
        [Vec3::new(0.6, 0.6, 0.6), Vec3::new(0.03, 0.5, 0.9), Vec3::new(0.2, 0.0, 1.0)].into_iter().enumerate()
    {
        let mut sampler = sampled(SHAPES[i + 2].1, 2000);
        sampler.hits.iter_mut().for_each(|hit| hit.colour = given);
        let looks = sampler.looks().expect("hits");
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for view in views(400) {
            let (_, seconds, shares) = seen(&looks, view.as_vec3());
            (0..3).for_each(|i| sum += stored_colour(seconds[i]) * shares[i]);
            count += 1.0;
        }
        assert!((sum / count - given).abs().max_element() < 0.01, "{} instead of {given}", sum / count);
    }
}

/// Each direction is its own nearest, and lies among the three of a vector near it.
#[test]
fn eighteen_directions_are_found_again() {
    for k in 0..DIRECTIONS {
        let [own, across, second] = frame(k);
        assert!((own.length() - 1.0).abs() < 1e-6 && own.dot(across).abs() + own.dot(second).abs() < 1e-6);
        let (at, shares) = nearest(own * 3.0);
        let share: f32 = (0..3).filter(|&i| at[i] == k).map(|i| shares[i]).sum();
        assert!(share > 0.9999, "{k}: {at:?} {shares:?}");
        for lean in [across, second, -across, -second] {
            assert!(nearest(own + lean * 0.1).0.contains(&k), "{k}");
        }
    }
}

proptest! {
    #[test]
    fn shares_place_the_direction(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
        let v = Vec3::new(x, y, z);
        prop_assume!(v.length() > 1e-3);
        let (at, shares) = nearest(v);
        prop_assert!(shares.iter().all(|s| *s >= -1e-6) && (shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        // On the octahedron, corners and middles of edges add up to the point of the direction.
        let on = |k: usize| frame(k)[0] / frame(k)[0].abs().element_sum();
        let sum: Vec3 = at.iter().zip(shares).map(|(k, share)| on(*k) * share).sum();
        prop_assert!((sum - v / v.abs().element_sum()).length() < 1e-4, "{} {}", v, sum);
        prop_assert!(at.iter().all(|k| frame(*k)[0].dot(v.normalize()) > 0.49));
    }

    #[test]
    fn normals_come_back(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0, k in 0usize..DIRECTIONS) {
        let n = Vec3::new(x, y, z);
        prop_assume!(n.length() > 1e-3);
        let (n, frame) = (n.normalize(), frame(k));
        let back = decode_normal(encode_normal(n, &frame), &frame).normalize();
        prop_assert!(back.dot(n).abs() > 4.0f32.to_radians().cos(), "{} {}", n, back);
    }

    /// Any bits give finite numbers in range.
    #[test]
    fn any_looks_are_shown(words in prop::array::uniform18(any::<u32>()), at in prop::array::uniform3(any::<f32>())) {
        let (firsts, seconds, shares) = seen(&words, at.into());
        prop_assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-4, "{:?}", shares);
        for (first, second) in firsts.into_iter().zip(seconds) {
            prop_assert!(first >> 24 == 0 && stored_normal(first).is_normalized());
            prop_assert!(stored_colour(second).max_element() <= 1.0);
        }
    }
}

#[test]
fn lines_are_uniform_over_those_that_cross_the_box() {
    // Cauchy: the share of lines that hit a convex body inside is the ratio of the surface areas.
    let outer = Bounds { min: Vec3::new(-1.0, 2.0, 0.0), max: Vec3::new(2.0, 3.0, 4.0) };
    let (count, mut inside) = (40_000, 0);
    for i in 0..count {
        let (org, dir) = line_into(&outer, [2, 3, 5, 7].map(|base| halton(i, base)));
        let from = org.as_dvec3() - DVec3::new(0.3, 2.5, 1.2);
        let b = from.dot(dir.as_dvec3());
        inside += u32::from(b * b - from.length_squared() + 0.16 > 0.0);
    }
    let expected = 4.0 * std::f64::consts::PI * 0.16 / (2.0 * (3.0 + 12.0 + 4.0));
    assert!((f64::from(inside) / f64::from(count) / expected - 1.0).abs() < 0.02, "{inside} {expected}");
}

#[test]
fn lines_into_flat_and_empty_boxes_are_finite() {
    for extent in [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::splat(1e-30)] {
        for i in 0..64 {
            let at = [2, 3, 5, 7].map(|base| halton(i, base));
            let (org, dir) = line_into(&Bounds { min: Vec3::ONE, max: Vec3::ONE + extent }, at);
            assert!(org.is_finite() && (dir.length() - 1.0).abs() < 1e-5);
        }
    }
    assert_eq!(Sampler::default().looks(), None);
}
