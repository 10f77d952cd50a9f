//! Triangles that are none, hardly any, or all there is: counted by reason and left out, or rendered.

use super::pictures::{POE, Picture, Setting, Stage, perspective, sun};
use super::table::{judge, judge_each};
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::picture::coverage_ratio;
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::DVec3;
use outcrop::build::{BuildOptions, BuildReport};
use outcrop::render::Buffer;
use outcrop::scene::{Camera, Light};

const SLIVERS: &str = "slivers";

fn camera() -> Camera {
    perspective(DVec3::new(3.0, -4.0, 2.5), DVec3::ZERO)
}

/// What is counted of the triangles, and their pictures at each pixels of error.
fn made(tris: &[Tri]) -> (BuildReport, [Picture; POE.len()]) {
    let options = BuildOptions { threads: 1, ..Default::default() };
    let (built, report) = built::build_with(options, |builder| built::push(builder, &Part::white(1, tris.to_vec())));
    let lights = vec![Light::HEADLIGHT, sun(DVec3::new(1.0, 2.0, -3.0))];
    let stage = Stage::new(&built.path, Setting { lights, samples: 2, ..Setting::default() });
    (report, POE.map(|poe| stage.picture(&camera(), poe)))
}

fn ball() -> Vec<Tri> {
    scenes::bumpy_sphere(60, 90, 4)
}

fn covered(picture: &Picture) -> usize {
    picture.covered().filter(|c| *c).count()
}

/// Points, lines, NaN and infinities of each sign in each place, and what lies beyond all range.
fn none_at_all() -> Vec<(Tri, &'static str)> {
    let mut rng = Rng::new(2);
    let mut out = Vec::new();
    for _ in 0..50 {
        let (a, b) = (scenes::rounded(rng.direction() * 3.0), scenes::rounded(rng.direction() * 3.0));
        out.extend([([a, a, a], "degenerate"), ([a, b, a], "degenerate"), ([a, b, b], "degenerate")]);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut tri = [a, b, DVec3::ZERO];
            tri[rng.below(3)][rng.below(3)] = bad;
            out.push((tri, "not finite"));
        }
        // A float, as all the others: so positions stay as they are.
        out.push(([a, b, DVec3::new(0.0, 2f64.powi(54), 0.0)], "out of range"));
    }
    out
}

#[test]
fn what_is_no_triangle_is_counted_and_left_out() {
    let none = none_at_all();
    let count = |why: &str| none.iter().filter(|n| n.1 == why).count() as u64;
    // Spread among the others, so that ids are what they were only if those left out count too.
    let mut mixed = ball();
    let own = mixed.len() as u64;
    for (i, (tri, _)) in none.iter().enumerate() {
        mixed.insert(i * 20, *tri);
    }
    let (report, pictures) = made(&mixed);
    let said = [report.triangles_in, report.triangles_kept, report.degenerate, report.non_finite, report.out_of_range];
    let expected = [mixed.len() as u64, own, count("degenerate"), count("not finite"), count("out of range")];
    assert_eq!(said, expected, "read, kept, degenerate, not finite, out of range");
    let (_, truth) = made(&ball());
    for ((picture, truth), poe) in pictures.iter().zip(&truth).zip(POE) {
        let buffers = Buffer::ALL.into_iter().filter(|b| *b != Buffer::Primitive);
        let differs = buffers.filter(|b| picture.bytes(*b) != truth.bytes(*b)).collect::<Vec<_>>();
        assert_eq!(differs, [], "PoE {poe}: another picture than without them");
        assert!(covered(truth) > 1000);
    }
}

/// One corner astray among coordinates that are no floats, which are rounded around the middle of the mesh: it does not
/// move that.
#[test]
fn one_corner_astray_costs_no_other_triangle() {
    let thirds = |t: Tri| t.map(|v| v / 3.0);
    let mut tris: Vec<Tri> = ball().into_iter().map(thirds).collect();
    let own = tris.len() as u64;
    tris.push([DVec3::ZERO, DVec3::X, DVec3::new(0.0, 1e16, 0.0)]);
    let (report, _) = made(&tris);
    assert_eq!(report.triangles_in, report.triangles_kept + report.degenerate + report.out_of_range, "all are counted");
    judge("one corner astray: triangles lost", &[(0.0, (own - report.triangles_kept.min(own)) as f64, 0.0)]);
}

#[test]
fn slivers_doubles_one_and_none_are_rendered() {
    // A thousandth as wide as long, all through a ball.
    let mut rng = Rng::new(8);
    let slivers = (0..3000).map(|_| {
        let (a, b) = (rng.direction() * 1.5, rng.direction() * 1.5);
        [a, b, (a + b) * 0.5 + rng.direction() * 1e-3].map(scenes::rounded)
    });
    let slivers: Vec<Tri> = slivers.filter(scenes::has_area).collect();
    let three_times = [ball(), ball(), ball()].concat();
    let large = [[DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.5)]];
    let cases: [(&str, Vec<Tri>, bool); 5] = [
        (SLIVERS, slivers, true),
        ("doubles", three_times, true),
        ("one", large.to_vec(), true),
        ("none", Vec::new(), false),
        ("only such as are none", none_at_all().into_iter().map(|n| n.0).collect(), false),
    ];
    for (name, tris, is_seen) in cases {
        let (report, pictures) = made(&tris);
        assert_eq!(report.triangles_in, tris.len() as u64);
        for (picture, poe) in pictures.iter().zip(POE) {
            println!(
                "{name}, PoE {poe}: {} of {} triangles, {} pixels",
                report.triangles_kept,
                tris.len(),
                covered(picture)
            );
            // Slivers are wires: rays pass what stands in for them, as many as pass them.
            assert!(name == SLIVERS || picture.holes(&pictures[0]) == 0, "{name}, PoE {poe}: holes");
            assert!(covered(picture) > 200 || !is_seen, "{name}, PoE {poe}: not seen");
            assert!(
                report.triangles_kept > 0 || covered(picture) == 0,
                "{name}, PoE {poe}: nothing is seen as something"
            );
        }
        if name == SLIVERS {
            let ratios = pictures.each_ref().map(|p| coverage_ratio(p.coverage(), pictures[0].coverage()));
            judge_each("slivers: coverage", ratios.map(|ratio| (ratio - 1.0).abs()), 0.03);
        }
    }
    // Three times the same is the same, up to the digits of shading normals, which depend on the leaves.
    let ((_, once), (report, thrice)) = (made(&ball()), made(&[ball(), ball(), ball()].concat()));
    assert_eq!(report.triangles_kept, 3 * ball().len() as u64);
    for buffer in [Buffer::Kind, Buffer::Depth, Buffer::Normal] {
        assert!(once[0].bytes(buffer) == thrice[0].bytes(buffer), "{buffer:?} of exact doubles");
    }
    let colours = |picture: &Picture| -> Vec<f32> {
        picture.bytes(Buffer::ColourLinear).as_chunks().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect()
    };
    let differences = colours(&once[0]).into_iter().zip(colours(&thrice[0])).map(|(a, b)| (a - b).abs());
    assert!(differences.fold(0.0, f32::max) < 0.03);
}
