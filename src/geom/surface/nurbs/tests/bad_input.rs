//! Descriptions that are refused, each for its reason; and random ones, which never panic.

use super::{Owned, Rng};
use crate::geom::surface::nurbs::Nurbs;
use glam::DVec3;

fn plane() -> Owned {
    let knots = vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
    let points = (0..9).map(|i| DVec3::new(f64::from(i / 3), f64::from(i % 3), 0.0)).collect();
    Owned { degree: [2, 2], counts: [3, 3], knots: [knots.clone(), knots], points, weights: Some(vec![1.0; 9]) }
}

#[test]
fn faults_name_the_argument_and_the_index() {
    let why = |change: &dyn Fn(&mut Owned)| {
        let mut owned = plane();
        change(&mut owned);
        Nurbs::new(&owned.desc()).expect_err("a fault").to_string()
    };
    let set = |axis: usize, knots: &[f64]| {
        let knots = knots.to_vec();
        move |o: &mut Owned| o.knots[axis] = knots.clone()
    };
    let weight = |w: f64| move |o: &mut Owned| o.weights.as_mut().expect("weights")[4] = w;
    let cases: Vec<(String, &str)> = vec![
        (why(&|o| o.degree[0] = 0), "degree: 0 in the direction of knots_u, not in 1..=32"),
        (why(&|o| o.degree[1] = 33), "degree: 33 in the direction of knots_v"),
        (why(&|o| o.counts = [u32::MAX; 2]), "knots_u: 6 knots, not count + degree + 1 = 4294967298"),
        (why(&|o| o.counts[1] = 2), "counts: 2 control points for degree 2 (knots_v)"),
        (why(&|o| o.points.truncate(8)), "points: 8 points, but the counts are 3 × 3"),
        (why(&|o| o.points[7].y = f64::NAN), "points: point 7 is not finite"),
        (why(&|o| o.points[2].z = 1e31), "points: point 2 is not finite, or a coordinate exceeds 1e30"),
        (why(&|o| o.weights = Some(vec![1.0; 8])), "weights: 8 weights of 9 points"),
        (why(&weight(0.0)), "weights: weight 4 is 0, not a positive number"),
        (why(&weight(-1.0)), "weights: weight 4 is -1,"),
        (why(&weight(f64::NAN)), "weights: weight 4 is NaN,"),
        (why(&weight(f64::INFINITY)), "weights: weight 4 is inf,"),
        (why(&weight(1e-13)), "weights: weight 4 is under 1e12-th of the greatest"),
        (why(&set(0, &[0., 0., 0., 1., 0.5, 1.])), "knots_u: knot 4 is less than knot 3"),
        (why(&set(1, &[0., 0., f64::NAN, 1., 1., 1.])), "knots_v: knot 2 is not finite"),
        (why(&set(1, &[0., 0., 1., 1., 2., 2.])), "knots_v: the domain is empty: it is from knot 2 to knot 3"),
        (why(&set(1, &[0., 0., 0., 1e-40, 1., 1.])), "knots_v: knots 2 and 3 differ by less than 1e-30"),
    ];
    for (found, expected) in cases {
        assert!(found.starts_with(&format!("bad argument: surface: {expected}")), "{found}");
    }
    let four = vec![0., 0., 0., 1., 1., 1., 1., 2., 2., 2.];
    let found = why(&|o| {
        (o.counts[0], o.knots[0]) = (7, four.clone());
        o.points.resize(21, DVec3::ZERO);
    });
    assert!(found.starts_with("bad argument: surface: knots_u: more than degree + 1 knots equal knot 3"), "{found}");
}

#[test]
fn weights_of_any_size_are_the_same_surface() {
    let small = plane().surface();
    for factor in [1e-300, 3e-5, 7.0, 1e300] {
        let scaled = Owned { weights: Some(vec![factor; 9]), ..plane() };
        assert_eq!(scaled.surface(), small);
        let mut uneven = plane();
        uneven.weights.iter_mut().flatten().enumerate().for_each(|(i, w)| *w = (1.0 + i as f64) * factor);
        let point = uneven.surface().evaluate(0.3, 0.8);
        assert!(point.position.is_finite() && point.duv.is_finite() && point.position.z == 0.0);
    }
}

/// A number that is often awkward.
fn awkward(rng: &mut Rng) -> f64 {
    const ODD: [f64; 12] =
        [0.0, -0.0, 1.0, -1.0, f64::NAN, f64::INFINITY, f64::MIN, f64::MAX, f64::MIN_POSITIVE, 5e-324, 1e30, 1e-30];
    if rng.one_in(3) { ODD[rng.below(ODD.len())] } else { rng.between(-4.0, 4.0) }
}

fn hostile(rng: &mut Rng) -> Owned {
    let mut owned = Owned::random(rng, 4, true);
    for _ in 0..rng.below(4) {
        let [knots_u, knots_v] = &mut owned.knots;
        let (points, value) = (&mut owned.points, awkward(rng));
        let (knot, point) = (rng.below(knots_u.len()), rng.below(points.len()));
        match rng.below(8) {
            0 => owned.degree[rng.below(2)] = rng.below(40) as u32,
            1 => owned.counts[rng.below(2)] = rng.bits() as u32 >> rng.below(32),
            2 => knots_u[knot] = value,
            3 => knots_v.iter_mut().for_each(|t| *t *= value),
            4 => points[point].y = value,
            5 => points.iter_mut().for_each(|p| *p *= value),
            6 => owned.weights.iter_mut().flatten().for_each(|w| *w *= value.abs()),
            _ => knots_u.truncate(rng.below(knots_u.len() + 1).max(1)),
        }
        if owned.knots[0].len() < 2 {
            break;
        }
    }
    owned
}

#[test]
fn random_descriptions_never_panic_and_what_is_accepted_is_finite() {
    let (mut rng, mut accepted) = (Rng::new(14), 0);
    for _ in 0..3000 {
        let owned = hostile(&mut rng);
        let Ok(surface) = Nurbs::new(&owned.desc()) else { continue };
        accepted += 1;
        for _ in 0..4 {
            let (u, v) = (awkward(&mut rng), awkward(&mut rng));
            let point = surface.evaluate(u, v);
            let all = [point.position, point.du, point.dv, point.duu, point.duv, point.dvv];
            assert!(all.iter().all(|d| d.is_finite()), "{point:?}");
            assert!(surface.normal_limit(u, v).is_finite());
            let _ = surface.curvature_limit(u, v);
        }
        let patch = surface.piece(surface.piece_counts().map(|n| rng.below(n)));
        let part = patch.part([[awkward(&mut rng), awkward(&mut rng)], [awkward(&mut rng), awkward(&mut rng)]]);
        let _ = (part.normal_cone(), part.bounds(), part.evaluate(awkward(&mut rng), awkward(&mut rng)));
        let _ = patch.normal_cone();
    }
    assert!(accepted > 1000, "{accepted}");
}
