//! Smooth surfaces where they are hard: poles, extraordinary vertices, creases, darts, boundaries, edges of three
//! faces, spikes, cusps, collapsed sides, far from zero. Closed ones let no ray out, at any pixels of error; the others
//! cover the middles of the pixels that the surface, in double precision, covers.

use super::pictures::{POE, Setting, Stage, perspective};
use super::table::judge_each;
use crate::common::brute::Oracle;
use crate::common::built::{self, Built, build_with};
use crate::common::bvh64::Bvh64;
use crate::common::nurbs::{self, Nurbs};
use crate::common::shapes::{Shape, jumping_heights, own};
use crate::common::view::View;
use glam::DVec3;
use outcrop::build::{BuildOptions, Structure};
use outcrop::import::surfaces::{CageMesh, Dicing, Displacement, NurbsMesh};
use outcrop::import::{MeshKey, PartDesc, Sink};

const SIZE: (u32, u32) = (96, 72);

fn setting() -> Setting {
    Setting { size: SIZE, is_compact: true, ..Setting::default() }
}

fn cage(structure: Structure, shape: &Shape, displacement: Option<Displacement>, tolerance: f64) -> Built {
    let options = BuildOptions { structure, dicing: Some(Dicing::Tolerance(tolerance)), ..built::options() };
    let fill = |builder: &mut outcrop::build::Builder| {
        let part = builder.part(PartDesc::default()).expect("a part");
        let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &[part], displacement };
        builder.cage(MeshKey::DIRECT, &mesh).expect("a surface");
    };
    build_with(options, fill).0
}

fn nurbs(structure: Structure, shape: &Nurbs, tolerance: f64) -> Built {
    let options = BuildOptions { structure, dicing: Some(Dicing::Tolerance(tolerance)), ..built::options() };
    let fill = |builder: &mut outcrop::build::Builder| {
        let part = builder.part(PartDesc::default()).expect("a part");
        let mesh = NurbsMesh { desc: shape.desc(), is_reversed: false, domain: None, extent: 0.0, part };
        builder.nurbs(MeshKey::DIRECT, &mesh).expect("a surface");
    };
    build_with(options, fill).0
}

/// From inside a closed surface all pixels show it, in six directions, at all pixels of error.
fn check_closed(name: &str, built: &Built, eye: DVec3) {
    let stage = Stage::new(&built.path, setting());
    // Off the axes, or rays would all lie in planes of symmetry.
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.1, 0.2, 0.3);
    let mut through = [0.0f64; POE.len()];
    for (i, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]).enumerate() {
        let camera = perspective(eye, eye + turn * axis);
        for (p, poe) in POE.into_iter().enumerate() {
            // All ways are compared in one direction.
            let picture = if i == 0 { stage.picture(&camera, poe) } else { stage.quick(&camera, poe) };
            through[p] += picture.covered().filter(|covered| !covered).count() as f64;
        }
    }
    judge_each(&format!("{name}: pixels through a closed surface"), through, 0.0);
}

/// From outside: no pixel whose neighbours the surface covers too is a hole. Returns the number of pixels with
/// stand-ins.
fn check_open(name: &str, built: &Built, surface: Vec<[DVec3; 3]>) -> usize {
    let corners = || surface.iter().flatten();
    let low = corners().fold(DVec3::INFINITY, |a, &p| a.min(p));
    let high = corners().fold(DVec3::NEG_INFINITY, |a, &p| a.max(p));
    let (middle, size) = ((low + high) / 2.0, (high - low).length());
    let oracle = Bvh64::new(surface);
    let stage = Stage::new(&built.path, setting());
    let (mut holes, mut stand_ins) = ([0.0f64; POE.len()], 0);
    for towards in [DVec3::new(1.0, 0.7, 0.9), DVec3::new(-0.4, 1.0, 0.6), DVec3::new(0.5, -0.8, -1.0)] {
        let camera = perspective(middle + 1.5 * size * towards.normalize(), middle);
        let view = View::new(&camera, SIZE.0, SIZE.1);
        let meets = |x: f64, y: f64| oracle.closest(&view.ray(x, y)).is_some();
        let truth = view.pixels(|x, y| meets(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let width = SIZE.0 as usize;
        let is_inside = |i: usize| {
            let (x, y) = (i % width, i / width);
            let inner = 1..width - 1;
            inner.contains(&x)
                && (1..SIZE.1 as usize - 1).contains(&y)
                && (0..9).all(|k| truth[i - width - 1 + k % 3 + width * (k / 3)])
        };
        for (p, poe) in POE.into_iter().enumerate() {
            let picture = stage.picture(&camera, poe);
            holes[p] += picture.covered().enumerate().filter(|(i, covered)| !covered && is_inside(*i)).count() as f64;
            stand_ins += picture.stand_ins();
        }
        assert!((0..truth.len()).filter(|i| is_inside(*i)).count() > 100, "{name}: little is seen");
    }
    judge_each(&format!("{name}: holes"), holes, 0.0);
    stand_ins
}

fn middle(shape: &Shape) -> DVec3 {
    shape.points.iter().sum::<DVec3>() / shape.points.len() as f64
}

/// The structures that surfaces have.
const STRUCTURES: [Structure; 2] = [Structure::Bvh, Structure::Patch];

/// Returns the number of pixels with stand-ins of a surface that is not closed.
fn check_cage(structure: Structure, shape: &Shape, place: &str) -> usize {
    let (built, name) = (cage(structure, shape, None, 1e-3 * shape.extent()), format!("{}{place}", shape.name));
    let name = format!("{name}, {}", structure.name());
    // The middle of `two_cubes_vertex` is the vertex that its cubes share.
    if shape.is_closed() && shape.name != "two_cubes_vertex" {
        check_closed(&name, &built, middle(shape));
        0
    } else {
        check_open(&name, &built, shape.fine())
    }
}

/// Cubes with creases of sharpness 0.1 to infinity and with corners, vertices of valence 3 to 64, darts.
#[test]
fn cages_are_whole() {
    for structure in STRUCTURES {
        let stand_ins: usize = own().iter().map(|shape| check_cage(structure, shape, "")).sum();
        assert!(stand_ins > 10_000, "{}: {stand_ins} stand-ins", structure.name());
    }
}

#[test]
fn cages_are_whole_far_from_zero() {
    let far = DVec3::new(1e7, -2e7, 1e7);
    for mut shape in own().into_iter().filter(|it| ["cube_creases", "valence_7"].contains(&it.name.as_str())) {
        shape.points.iter_mut().for_each(|p| *p += far);
        for structure in STRUCTURES {
            check_cage(structure, &shape, " far away");
        }
    }
}

/// Heights that jump from texel to texel, in and out, along creases, at corners and over seams of the map.
#[test]
fn spikes_are_whole() {
    for shape in own().into_iter().filter(|it| ["cube", "cube_creases", "cube_corners"].contains(&it.name.as_str())) {
        let (heights, coordinates) = (jumping_heights(), shape.coordinates());
        let scale = 0.1 * shape.extent();
        let displacement = Displacement { heights: &heights, scale, coordinates: &coordinates };
        for structure in STRUCTURES {
            let built = cage(structure, &shape, Some(displacement), 4e-3 * shape.extent());
            let name = format!("{} with spikes, {}", shape.name, structure.name());
            check_closed(&name, &built, middle(&shape));
        }
    }
}

/// Collapsed sides are points of a sphere, where the normal has a limit, and tips of cones, where it has none.
#[test]
fn poles_and_cusps_are_whole() {
    let side = 200;
    let at = |i: i32, y: f64| {
        let t = f64::from(i) / f64::from(side);
        DVec3::new(t * t, y, t * t * t)
    };
    let strips = (-side..side).flat_map(|i| {
        let [a, b, c, d] = [at(i, -1.0), at(i + 1, -1.0), at(i + 1, 1.0), at(i, 1.0)];
        [[a, b, c], [a, c, d]]
    });
    let strips: Vec<_> = strips.collect();
    for structure in STRUCTURES {
        let name = |of: &str| format!("{of}, {}", structure.name());
        let build = |shape: &Nurbs, tolerance: f64| nurbs(structure, shape, tolerance);
        check_closed(&name("sphere"), &build(&nurbs::sphere(), 1e-3), DVec3::new(0.1, 0.2, -0.3));
        check_closed(&name("torus"), &build(&nurbs::torus(), 3e-3), DVec3::new(3.1, 0.2, -0.1));
        check_closed(&name("double cone"), &build(&nurbs::double_cone(), 1e-3), DVec3::new(0.1, 0.1, -0.2));
        let stand_ins = check_open(&name("cusp"), &build(&nurbs::cusp(), 1e-3), strips.clone());
        assert!(stand_ins > 100, "{stand_ins}");
    }
}
