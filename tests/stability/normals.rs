//! Sheets that face away from each other, far closer than a voxel: the mean of their normals is next to nothing. What
//! stands in for them is never a NaN, never black where the exact picture is lit, and as bright and as much on the
//! whole.

use super::pictures::{POE, Setting, Stage, perspective};
use super::table::judge_each;
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::picture::{coverage_ratio, radiance_ratio};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DQuat, DVec3};
use outcrop::scene::{Camera, Light, LightKind};

const SIZE: (u32, u32) = (96, 72);
/// Off a mean brightness, as a share of it: Wald's bias.
const LINE: f64 = 0.02;
/// Off a mean coverage, as a share of it.
const COVERAGE_LINE: f64 = 0.03;

/// Two wavy sheets of 120 by 120 cells, a thousandth of a cell apart, the lower one wound the other way; tilted, so
/// that cells' boxes are thick.
fn sheets() -> Vec<Tri> {
    let tilt = DQuat::from_rotation_x(0.5) * DQuat::from_rotation_y(0.3);
    let wavy = |t: Tri, below: f64| {
        t.map(|v| {
            let height = 0.8 * (v.x * 0.35).sin() * (v.y * 0.27).cos();
            scenes::rounded(tilt * (v * 0.1 - DVec3::new(6.0, 6.0, 0.0) + DVec3::Z * (0.1 * height - below)))
        })
    };
    let upper = scenes::plane_grid(120, 0.0).into_iter().map(|t| wavy(t, 0.0));
    let lower = scenes::plane_grid(120, 0.0).into_iter().map(|[a, b, c]| wavy([a, c, b], 1e-4));
    upper.chain(lower).collect()
}

/// Plates a ten-thousandth as thick as long, closed, turned anyhow.
fn plates() -> Vec<Tri> {
    let mut rng = Rng::new(21);
    let plate = |_| {
        let at = rng.inside(DVec3::splat(-5.0), DVec3::splat(5.0));
        let turn = DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0));
        let half = DVec3::new(0.12, 0.09, 1e-5);
        scenes::cuboid(-half, half).into_iter().map(move |t| t.map(|v| scenes::rounded(at + turn * v)))
    };
    (0..12_000).flat_map(plate).filter(scenes::has_area).collect()
}

/// The least luminance of what the exact picture shows within the radius of a stand-in around a pixel that it has lit:
/// its content may be seen that far off, and is a quarter as bright at the least, however mixed its normals.
fn least_nearby(exact: &[f64], pixel: usize, poe: f32) -> Option<f64> {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let radius = 1 + (2f64.sqrt() * f64::from(poe)).sqrt().ceil() as usize;
    let around = |at: usize, end: usize| at.saturating_sub(radius)..(at + radius + 1).min(end);
    let nearby =
        around(pixel / width, height).flat_map(|y| around(pixel % width, width).map(move |x| exact[y * width + x]));
    (exact[pixel] > 0.1).then(|| nearby.filter(|y| *y > 0.0).fold(f64::INFINITY, f64::min))
}

/// What there is.
enum Kind {
    /// Closed as seen from any side: what is not shown is black.
    Closed,
    /// Pieces with gaps between them. Rays pass what stands in for such, as many as pass them, so how much is shown is
    /// one measure, and whether it is black another: of pixels all of whose rays hit something. (One ray of a pixel
    /// alone may see a plate almost from its edge, as dark as that is.)
    Gaps,
}

/// By the light of the eye, and by one beside it that nothing shades: whatever is seen is lit.
fn check(name: &str, kind: Kind, tris: Vec<Tri>, cameras: &[Camera]) {
    let aside = Light { kind: LightKind::Directional(DVec3::new(0.2, 0.3, -1.0)), intensity: 0.5, ..Light::HEADLIGHT };
    let setting = Setting { lights: vec![Light::HEADLIGHT, aside], size: SIZE, samples: 4, ..Setting::default() };
    let file = built::parts(&[Part::white(1, tris)]);
    let stage = Stage::new(&file.path, setting);
    let mut off = [0.0f64; POE.len()];
    let mut black = [0usize; POE.len()];
    let mut covered = [0.0f64; POE.len()];
    for camera in cameras {
        let exact = stage.picture(camera, 0.0);
        let truth = exact.luminance();
        let lit = truth.iter().filter(|y| **y > 0.1).count();
        assert!(lit * 5 > truth.len(), "{name}: {lit} pixels are lit");
        for (p, poe) in POE.into_iter().enumerate() {
            let picture = stage.picture(camera, poe);
            let (now, shown) = (picture.luminance(), picture.coverage().collect::<Vec<_>>());
            let judged: Vec<usize> =
                (0..now.len()).filter(|i| matches!(kind, Kind::Closed) || shown[*i] == 1.0).collect();
            assert!(judged.len() * 5 > truth.len(), "{name}, PoE {poe}: {} pixels are judged", judged.len());
            let is_black = |i: &&usize| least_nearby(&truth, **i, poe).is_some_and(|least| now[**i] < 0.25 * least);
            black[p] += judged.iter().filter(is_black).count();
            // Where the exact picture shows something: what is added around it is another row's.
            let ratio = radiance_ratio(picture.colours(), exact.colours(), |i| truth[i] > 0.0);
            println!("{name}, PoE {poe}: {ratio:.4} of the brightness, {} stand-ins", picture.stand_ins());
            assert!(poe < 3.0 || picture.stand_ins() > 500, "{name}, PoE {poe}: nothing stands in");
            off[p] = off[p].max((ratio - 1.0).abs());
            covered[p] = covered[p].max((coverage_ratio(picture.coverage(), exact.coverage()) - 1.0).abs());
        }
    }
    judge_each(&format!("{name}: black pixels"), black.map(|n| n as f64), 0.0);
    judge_each(&format!("{name}: brightness"), off, LINE);
    judge_each(&format!("{name}: coverage"), covered, COVERAGE_LINE);
}

#[test]
fn opposing_sheets() {
    let cameras = [
        perspective(DVec3::new(2.0, -9.0, 14.0), DVec3::ZERO),
        perspective(DVec3::new(-3.0, 5.0, -12.0), DVec3::ZERO),
        perspective(DVec3::new(9.0, -2.0, 3.0), DVec3::ZERO),
    ];
    check("sheets", Kind::Closed, sheets(), &cameras);
}

#[test]
fn thin_plates() {
    let cameras = [
        perspective(DVec3::new(4.0, -14.0, 8.0), DVec3::ZERO),
        Camera::Orthographic { eye: DVec3::new(-9.0, 9.0, -9.0), at: DVec3::ZERO, up: DVec3::Z, height: 9.0 },
    ];
    check("plates", Kind::Gaps, plates(), &cameras);
}
