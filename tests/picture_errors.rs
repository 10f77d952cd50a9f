//! Errors between pictures, and measures of what they show, are what their formulas say, worked out by hand.

use crate::common::foreign::{Share, Shown, chroma, faded, foreign_parts, tinted, turned};
use crate::common::picture::{
    Colours, Silhouette, Spread, along_rays, coverage_ratio, depth_pixels, depth_relative, luminance, normal_angle,
    radiance_ratio, silhouette, srgb_decode, srgb_encode,
};

const MISS: f32 = f32::INFINITY;

#[track_caller]
fn close(a: f64, b: f64) {
    assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{a} is not {b}");
}

#[test]
fn spreads_are_ranks() {
    let spread = Spread::of((1..=2000).rev().map(f64::from));
    assert_eq!(spread, Spread { mean: 1000.5, p95: 1900.0, p999: 1998.0, worst: 2000.0, count: 2000 });
    // Of few values the high percentiles are the worst.
    let few = Spread::of([3.0, 1.0, 2.0]);
    assert_eq!(few, Spread { mean: 2.0, p95: 3.0, p999: 3.0, worst: 3.0, count: 3 });
    // 19 of 20 are 95 of 100; of 21, 19 are not enough.
    let twenty = |n: u32| Spread::of((1..=n).map(f64::from)).p95;
    assert_eq!((twenty(20), twenty(21)), (19.0, 20.0));
    assert_eq!(Spread::of([]), Spread { mean: 0.0, p95: 0.0, p999: 0.0, worst: 0.0, count: 0 });
}

#[test]
fn nan_is_not_hidden() {
    for nan in [f64::NAN, -f64::NAN] {
        let spread = Spread::of([1.0, nan, 2.0]);
        assert!(spread.worst.is_nan() && spread.mean.is_nan());
    }
}

#[test]
fn depths_are_compared_where_both_show_something() {
    let truth = [10.0, 20.0, MISS, 40.0, f32::NAN, 8.0];
    let seen = [11.0, 19.0, 5.0, MISS, MISS, 8.0];
    // 1 / 10, 1 / 20, 0.
    let relative = depth_relative(&seen, &truth);
    assert_eq!((relative.count, relative.worst), (3, 0.1));
    close(relative.mean, 0.05);
    // A pixel is a hundredth of the distance wide: the same times 100.
    let pixels = depth_pixels(&seen, &truth, |d| d / 100.0);
    close(pixels.mean, 5.0);
    close(pixels.worst, 10.0);
    // Of an orthographic camera it is as wide everywhere.
    close(depth_pixels(&seen, &truth, |_| 0.25).mean, 8.0 / 3.0);
}

#[test]
fn silhouettes_lose_and_gain() {
    let truth = [1.0, 1.0, 1.0, MISS, MISS, MISS];
    let seen = [2.0, 1.0, MISS, 1.0, f32::NAN, MISS];
    assert_eq!(silhouette(&seen, &truth), Silhouette { overlap: 0.5, lost: 1, added: 1, covered: 3 });
    assert_eq!(silhouette(&truth, &truth), Silhouette { overlap: 1.0, lost: 0, added: 0, covered: 3 });
    let nothing = [MISS; 6];
    assert_eq!(silhouette(&nothing, &nothing).overlap, 1.0);
    assert_eq!(silhouette(&truth, &nothing), Silhouette { overlap: 0.0, lost: 0, added: 3, covered: 0 });
}

#[test]
fn angles_of_normals_are_in_degrees() {
    let truth = [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let seen = [0.0, 0.0, 2.0, 0.0, 1.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0];
    // 0, 45, 90, not hit, 180.
    let angles = normal_angle(&seen, &truth);
    assert_eq!(angles.count, 4);
    close(angles.mean, 78.75);
    close(angles.worst, 180.0);
    // The arc cosine of these two would be 0.
    let small = normal_angle(&[1e-6, 0.0, 1.0], &[0.0, 0.0, 1.0]).worst;
    assert!((small - f64::from(1e-6f32).to_degrees()).abs() < 1e-15, "{small}");
    assert!(normal_angle(&[f32::NAN, 0.0, 1.0], &[0.0, 0.0, 1.0]).worst.is_nan());
}

#[test]
fn coverage_is_summed_before_it_is_divided() {
    // Not the mean of the pixels' ratios, which is 1.
    assert_eq!(coverage_ratio([0.5, 0.75, 0.0], [1.0, 0.5, 0.0]), 1.25 / 1.5);
    assert_eq!(coverage_ratio([0.0, 0.0], [0.0, 0.0]), 1.0);
    assert_eq!(coverage_ratio([0.5], [0.0]), f64::INFINITY);
}

#[test]
fn brightness_is_linear() {
    let (black, white, grey) = ([0, 0, 0, 255u8], [255, 255, 255, 255], [188, 188, 188, 255]);
    let halves = [black, white].concat();
    let greys = [grey, grey].concat();
    // Half of the light is sRGB 187.5, not 127.5.
    let ratio = radiance_ratio(Colours::Srgb8(&greys), Colours::Srgb8(&halves), |_| true);
    close(ratio, 2.0 * srgb_decode(188.0 / 255.0));
    assert!((ratio - 1.0).abs() < 0.006, "{ratio}");
    // Only where the truth is white.
    close(radiance_ratio(Colours::Srgb8(&greys), Colours::Srgb8(&halves), |i| i == 1), srgb_decode(188.0 / 255.0));
    // Linear colours may be brighter than 1, and alpha is no light.
    let bright = Colours::Linear(&[2.0, 2.0, 2.0, 0.0]);
    close(radiance_ratio(bright, Colours::Srgb8(&white), |_| true), 2.0);
    close(luminance([1.0, 0.0, 0.0]) + luminance([0.0, 1.0, 0.0]) + luminance([0.0, 0.0, 1.0]), 1.0);
    assert_eq!(radiance_ratio(Colours::Srgb8(&black), Colours::Srgb8(&black), |_| true), 1.0);
}

#[test]
fn srgb_goes_there_and_back() {
    for i in 0..=1000 {
        let x = f64::from(i) / 1000.0;
        // The standard's two constants do not meet to the last digit.
        assert!((srgb_decode(srgb_encode(x)) - x).abs() < 1e-7, "{x}");
    }
    // IEC 61966-2-1: the middle of the coded range is 21.4 % of the light.
    assert!((srgb_decode(0.5) - 0.214_041_140_482_232_55).abs() < 1e-15);
    assert_eq!(Colours::Linear(&[4.0, -1.0, 0.0, 1.0]).coded(0).map(|c| (c * 255.0).round()), [255.0, 0.0, 0.0]);
    assert_eq!(Colours::Srgb8(&[255, 51, 0, 9]).coded(0), [1.0, 0.2, 0.0]);
}

#[test]
fn rays_are_off_or_answered_otherwise() {
    let seen = [1.0, 5.0, f64::INFINITY, f64::INFINITY, 3.0];
    let truth = [1.0, 4.0, f64::INFINITY, 2.0, 2.5];
    let (off, otherwise) = along_rays(&seen, &truth, |_, t| 0.25 * t);
    assert_eq!((off.count, off.worst, otherwise), (3, 1.0, 0.2));
    // Twice as narrow, two of the three that hit in both are more than a width off.
    let (off, otherwise) = along_rays(&seen, &truth, |i, t| if i == 0 { t } else { 0.125 * t });
    assert_eq!((off.worst, otherwise), (2.0, 0.6));
}

/// Pixels of parts 1 (white), 2 (red), 3 (half red) and 4 (three tenths red), in their own colours.
fn shown(parts: &[u64], times: usize, test: impl FnOnce(&Shown)) {
    let colour = |part: &u64| match part {
        1 => [0.5, 0.5, 0.5, 1.0],
        2 => [0.5, 0.0, 0.0, 1.0],
        3 => [0.5, 0.25, 0.25, 1.0],
        4 => [0.5, 0.35, 0.35, 1.0],
        _ => [0.0; 4],
    };
    let colours: Vec<f32> = parts.iter().flat_map(colour).collect();
    test(&Shown { width: 8 * times, times, parts, colours: Colours::Linear(&colours) });
}

/// A row of a fine picture, each of its pixels nine of it, with one more pixel of a part.
fn refined(row: [u64; 8], (at, part): ([usize; 2], u64)) -> Vec<u64> {
    let mut fine: Vec<u64> = (0..3 * 24).map(|i| row[i % 24 / 3]).collect();
    fine[at[1] * 24 + at[0]] = part;
    fine
}

#[test]
fn what_the_truth_has_nowhere_near_is_foreign() {
    let none = outcrop::query::NONE;
    let seen = [1, 2, 1, 2, 1, 3, none, 1];
    // The truth shows part 2 in its last pixel alone, and part 3 nowhere.
    let share = |fine: &[u64]| {
        let mut found = None;
        shown(&seen, 1, |seen| shown(fine, 3, |truth| found = Some(foreign_parts(seen, truth))));
        found.expect("a share")
    };
    let row = [1, 1, 1, 1, 1, 1, 1, 2];
    assert_eq!(share(&refined(row, ([0, 0], 1))), Share { count: 3, of: 7 });
    // A pixel between the rays of the judged picture is enough: at column 11, of the pixel at 3, it is near both.
    assert_eq!(share(&refined(row, ([11, 2], 2))), Share { count: 1, of: 7 });
    // Of the pixel at 5 it is 2 from the one at 3, and 4 from the one at 1.
    assert_eq!(share(&refined(row, ([15, 0], 2))), Share { count: 2, of: 7 });
}

#[test]
fn kinds_are_judged_inside_of_them() {
    let none = outcrop::query::NONE;
    // White up to column 5; red is near the pixels from 4 on.
    let truth = refined([1, 1, 1, 1, 1, 1, 2, 2], ([0, 0], 1));
    shown(&truth, 3, |truth| {
        let skin = truth.inside(|part| part == 1);
        assert_eq!(skin, [0, 1, 2, 3]);
        shown(&[2, 3, none, 1, 2, 2, 2, 2], 1, |seen| {
            assert_eq!(turned(seen, &skin, |part| part > 1 && part != none), Share { count: 2, of: 4 });
            assert_eq!(tinted(seen, &skin), Share { count: 2, of: 4 });
        });
    });
    // Part 3 is half as far off grey as part 2, and is near the pixels from 4 on: less is asked of them.
    let truth = refined([2, 2, 2, 2, 2, 2, 3, 3], ([0, 0], 2));
    shown(&truth, 3, |truth| {
        let ribs = truth.inside(|part| part > 1);
        assert_eq!(ribs.len(), 8);
        shown(&[1, 2, 3, 4, none, 4, 3, 1], 1, |seen| {
            assert_eq!(faded(seen, truth, &ribs), Share { count: 3, of: 8 });
        });
    });
    close(chroma([0.2, 0.4, 0.3]), 0.5);
    assert_eq!((chroma([0.0; 3]), chroma([0.7; 3]), chroma([0.0, 0.1, 0.0])), (0.0, 0.0, 1.0));
}
