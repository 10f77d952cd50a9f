//! The structure `patch`: hits are those of the same triangles under `bvh`, to the bit; stand-ins keep the promise.

use crate::common::asked::ask;
use crate::common::brute::Tri;
use crate::common::built::{self, Built, build_with};
use crate::common::bvh64::Bvh64;
use crate::common::nurbs::{self, Nurbs};
use crate::common::promise::{Tally, judge};
use crate::common::rng::Rng;
use crate::common::shapes::{Shape, jumping_heights, own};
use glam::DVec3;
use outcrop::base::progress::Cancel;
use outcrop::build::{BuildOptions, BuildReport, Builder, Structure, SurfaceLeaves};
use outcrop::geom::surface::cage::CagePatches;
use outcrop::geom::surface::dice::{Dicer, Quads};
use outcrop::import::surfaces::{CageMesh, Dicing, Displacement, Heights, NurbsMesh, Wrap};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use outcrop::simd::Isa;

type Fill<'a> = &'a dyn Fn(&mut Builder);

fn build(structure: Structure, dicing: Dicing, fill: Fill) -> (Built, BuildReport) {
    build_leaves(structure, SurfaceLeaves::Boxes, dicing, fill)
}

fn build_leaves(
    structure: Structure,
    surface_leaves: SurfaceLeaves,
    dicing: Dicing,
    fill: Fill,
) -> (Built, BuildReport) {
    let options = BuildOptions { structure, surface_leaves, dicing: Some(dicing), ..built::options() };
    build_with(options, |builder| fill(builder))
}

/// Adds a cage, each face a part of its own.
fn cage(builder: &mut Builder, shape: &Shape, displacement: Option<Displacement>) {
    let part = |id| PartDesc { id: Some(id), ..PartDesc::default() };
    let parts: Vec<u32> = (0..shape.sizes.len() as u64).map(|id| builder.part(part(id)).expect("a part")).collect();
    let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &parts, displacement };
    builder.cage(MeshKey::DIRECT, &mesh).expect("a surface");
}

fn nurbs(builder: &mut Builder, shape: &Nurbs, is_reversed: bool) {
    let part = builder.part(PartDesc::default()).expect("a part");
    let mesh = NurbsMesh { desc: shape.desc(), is_reversed, domain: None, extent: 0.0, part };
    builder.nurbs(MeshKey::DIRECT, &mesh).expect("a surface");
}

/// A scene of a model, with all of it in memory or with little.
fn scene(built: &Built, isa: Option<Isa>) -> (Context, Scene, Model) {
    let context = Context::new(ContextOptions { threads: 1, isa, ..Default::default() }).expect("a context");
    let (scene, model) = built::scene(&context, built);
    assert!(model.load(&Cancel::new()).expect("it loads"));
    (context, scene, model)
}

/// Rays through a box around points, from outside and inside, also along axes.
fn rays(points: &[DVec3], count: usize) -> Vec<Ray> {
    let low = points.iter().fold(DVec3::INFINITY, |a, &p| a.min(p));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |a, &p| a.max(p));
    let (middle, size, mut rng) = ((low + high) / 2.0, (high - low).max_element(), Rng::new(11));
    let through = |rng: &mut Rng| middle + size * 0.6 * rng.inside(DVec3::NEG_ONE, DVec3::ONE);
    let ray = |i: usize| {
        let at = through(&mut rng);
        let dir = if i.is_multiple_of(10) { [DVec3::X, DVec3::NEG_Y, DVec3::Z][i / 10 % 3] } else { rng.direction() };
        let back = if i.is_multiple_of(3) { 0.0 } else { 3.0 * size };
        Ray::new(at - back * dir, dir.as_vec3())
    };
    (0..count).map(ray).collect()
}

fn asked(scene: &Scene, rays: &[Ray]) -> Vec<Hit> {
    ask(&scene.state(), rays, QueryOptions { want: Want::ALL | Want::SHADING_NORMAL, ..QueryOptions::default() })
}

/// The same hit but for `prim`, which is the face under `patch`, and the error, which states the tolerance there. Trees
/// have origins of their own, so vertices differ by a rounding.
fn same(a: &Hit, b: &Hit, size: f64) -> bool {
    let is_near = (a.t - b.t).abs() <= 1e-6 * size * (1.0 + 1.0 / f64::from(a.normal.dot(a.shading_normal).abs()));
    let is_alike = a.normal.dot(b.normal) > 0.999 && a.shading_normal.dot(b.shading_normal) > 0.999;
    (a.kind, a.part) == (b.kind, b.part) && (a.kind == HitKind::Miss || is_near && is_alike)
}

/// The same rays meet the same points of both, with all vector paths.
fn compare(name: &str, points: &[DVec3], dicing: Dicing, fill: Fill) {
    let (flat, of_flat) = build(Structure::Bvh, dicing, fill);
    let [(boxes, of_boxes), (facets, of_facets)] =
        SurfaceLeaves::ALL.map(|leaves| build_leaves(Structure::Patch, leaves, dicing, fill));
    let rays = rays(points, 6000);
    let expected = asked(&scene(&flat, None).1, &rays);
    let met = expected.iter().filter(|hit| hit.kind == HitKind::Exact).count();
    let isas = Isa::ALL.into_iter().filter(|isa| isa.is_available());
    for (patch, isa) in [&boxes, &facets].into_iter().flat_map(|built| isas.clone().map(move |isa| (built, isa))) {
        let found = asked(&scene(patch, Some(isa)).1, &rays);
        let size = points.iter().map(|p| p.length()).fold(0.0, f64::max);
        let pairs = expected.iter().zip(&found).enumerate();
        let other: Vec<_> = pairs.filter(|(_, (a, b))| !same(a, b, size)).collect();
        // Rays along edges and past silhouettes meet one neighbour or the other.
        assert!(other.len() * 1000 <= rays.len(), "{name}, {isa:?}: {} rays, {:?}", other.len(), other[0]);
    }
    let triangles = [of_flat.triangles_kept, of_boxes.triangles_kept, of_facets.triangles_kept];
    let bytes = [of_flat.bytes_trace, of_boxes.bytes_trace, of_facets.bytes_trace];
    println!("{name}: {met} of {} rays meet {triangles:?} triangles, {bytes:?} bytes", rays.len());
    assert!(met > 100, "{name}: {met} hits");
}

#[test]
fn cages_are_hit_where_their_triangles_are() {
    for shape in own() {
        compare(&shape.name, &shape.points, Dicing::Level(3), &|builder| cage(builder, &shape, None));
    }
    let cube = own().into_iter().find(|it| it.name == "cube_creases").expect("a cube");
    let tolerance = Dicing::Tolerance(2e-3 * cube.extent());
    for (name, dicing) in [("level 2", Dicing::Level(2)), ("level 7", Dicing::Level(7)), ("tolerance", tolerance)] {
        compare(name, &cube.points, dicing, &|builder| cage(builder, &cube, None));
    }
}

#[test]
fn nurbs_and_displaced_cages_too() {
    for (name, shape, is_reversed) in [
        ("sphere", nurbs::sphere(), false),
        ("torus", nurbs::torus(), true),
        ("cone", nurbs::double_cone(), false),
        ("cusp", nurbs::cusp(), true),
    ] {
        compare(name, &shape.points, Dicing::Tolerance(2e-3), &|builder| nurbs(builder, &shape, is_reversed));
    }
    let shape = own().into_iter().find(|it| it.name == "cube_creases").expect("a cube");
    let mut rng = Rng::new(5);
    let heights = Heights::new([8, 8], 1, [Wrap::Repeat; 2], (0..64).map(|_| rng.unit() as f32).collect());
    let heights = heights.expect("heights");
    let coordinates = shape.coordinates();
    let displacement = Displacement { heights: &heights, scale: 0.2, coordinates: &coordinates };
    let tolerance = Dicing::Tolerance(2e-3 * shape.extent());
    compare("displaced", &shape.points, tolerance, &|builder| cage(builder, &shape, Some(displacement)));
}

/// Surfaces, triangles and a shared mesh of both in one model: trees of two structures.
#[test]
fn triangles_and_surfaces_share_a_model() {
    let shape = own().into_iter().find(|it| it.name == "valence_7").expect("a shape");
    let fill = |builder: &mut Builder| {
        cage(builder, &shape, None);
        let part = builder.part(PartDesc { id: Some(77), ..PartDesc::default() }).expect("a part");
        let triangle: Tri = [DVec3::new(-3.0, -3.0, -1.5), DVec3::new(3.0, -3.0, -1.5), DVec3::new(0.0, 4.0, -1.5)];
        builder.triangles(MeshKey::DIRECT, part, &[triangle], Attributes::NONE).expect("triangles");
        let shared = builder.shared_mesh(1).expect("a mesh");
        let ball = nurbs::sphere();
        let mesh = NurbsMesh { desc: ball.desc(), is_reversed: false, domain: None, extent: 0.0, part: 0 };
        builder.nurbs(shared, &mesh).expect("a surface");
        for x in [-2.0, 2.5] {
            let part = builder.part(PartDesc { id: Some(100), ..PartDesc::default() }).expect("a part");
            let map = glam::DAffine3::from_scale_rotation_translation(
                DVec3::new(1.0, 0.5, 0.7),
                glam::DQuat::from_rotation_x(0.4),
                DVec3::new(x, 0.2, 0.9),
            );
            builder.instance(shared, map, part).expect("an instance");
        }
    };
    compare("mixed", &[DVec3::splat(-4.0), DVec3::splat(4.0)], Dicing::Tolerance(1e-2), &fill);
}

/// Every hit has a point of the surface within its error, and none before it: with cones from small to large.
#[test]
fn stand_ins_keep_the_promise() {
    let shapes = [("cube_creases", 0.0), ("valence_5", 0.0), ("spike", 0.0), ("grid_2", 0.0), ("cube_creases", 0.15)];
    // Some thousand rays a cone, or as many times more.
    let times = std::env::var("OUTCROP_RAYS").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let mut rng = Rng::new(6);
    let texels = (0..64).map(|_| rng.unit() as f32).collect();
    let heights = Heights::new([8, 8], 1, [Wrap::Repeat; 2], texels).expect("heights");
    for (name, scale) in shapes {
        let shape = own().into_iter().find(|it| it.name == name).expect("a shape");
        let coordinates = shape.coordinates();
        let moved = Displacement { heights: &heights, scale, coordinates: &coordinates };
        let displacement = (scale != 0.0).then_some(moved);
        let (built, _) = build(Structure::Patch, Dicing::Level(6), &|builder| cage(builder, &shape, displacement));
        let (_context, scene, model) = scene(&built, None);
        let mut triangles: Vec<Tri> = Vec::new();
        let mut collect = |_: u32, micro: &outcrop::geom::surface::dice::Micro| {
            triangles.extend(micro.positions.iter().map(|t| t.map(|p| p.as_vec3().as_dvec3())));
            Ok(())
        };
        let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &[0], displacement };
        mesh.dice(Some(Dicing::Level(6)), &Cancel::new(), &mut collect).expect("triangles");
        let oracle = Bvh64::new(triangles);
        let mut lods = 0;
        for width in [0.0f32, 1e-3, 1e-2, 0.03, 0.1, 0.3] {
            let cone = Cone { a: width * shape.extent() as f32, b: 0.0 };
            let rays: Vec<Ray> = rays(&shape.points, 3000 * times).into_iter().map(|ray| Ray { cone, ..ray }).collect();
            let mut tally = Tally::default();
            for (ray, hit) in rays.iter().zip(asked(&scene, &rays)) {
                lods += usize::from(hit.kind == HitKind::Lod);
                judge(&oracle, ray, &hit, &mut tally);
            }
            let slack = tally.slack.iter().copied().fold(f64::MAX, f64::min);
            let (exact, lod) = (tally.exact, tally.lod);
            println!("{name}, {scale}, {width}: {exact} exact, {lod} stand-ins, least slack {slack:.2e}");
        }
        assert!(lods > 1000, "{name}: {lods} stand-ins");
        drop(model);
    }
}

/// The surface at the parameters of a hit is where the hit is: within a part of a cell, or within the error of a
/// stand-in.
fn check_parameters(name: &str, points: &[DVec3], fill: Fill, at: &dyn Fn(u64, [f32; 2]) -> DVec3) {
    let (built, _) = build(Structure::Patch, Dicing::Level(6), fill);
    let cell = 0.01;
    let (_context, scene, _model) = scene(&built, None);
    let size = points.iter().map(|p| p.length()).fold(0.0, f64::max) as f32;
    for (width, least) in [(0.0, 500), (0.03 * size, 100)] {
        let cone = Cone { a: width, b: 0.0 };
        let rays: Vec<Ray> = rays(points, 4000).into_iter().map(|ray| Ray { cone, ..ray }).collect();
        let hits = asked(&scene, &rays).into_iter().filter(|hit| hit.kind != HitKind::Miss && hit.uv != [0.0; 2]);
        let (mut count, mut kinds) = (0, [0; 2]);
        for hit in hits {
            let apart = at(hit.prim, hit.uv).distance(hit.position);
            // Parameters are interpolated over triangles: along the surface they are off by a part of a cell. (Where an
            // edge is coarser than the face beside it, by a part of its segments: no edge is here.)
            let most = if hit.kind == HitKind::Exact { cell } else { f64::from(hit.error) + cell };
            assert!(apart <= most, "{name}: {apart} apart: {hit:?}");
            (count, kinds[usize::from(hit.kind == HitKind::Lod)]) =
                (count + 1, kinds[usize::from(hit.kind == HitKind::Lod)] + 1);
        }
        println!("{name}, {width}: {kinds:?}");
        assert!(count >= least && (width == 0.0 || kinds[1] > 50), "{name}, {width}: {kinds:?}");
    }
}

#[test]
fn hits_have_the_parameters_of_their_faces() {
    for name in ["cube_creases", "cube_corners", "valence_5"] {
        let shape = own().into_iter().find(|it| it.name == name).expect("a shape");
        let surface = CagePatches::new(&shape.cage(), &shape.points).expect("a surface");
        let at = |face: u64, [u, v]: [f32; 2]| surface.evaluate(face as u32, 0, u.into(), v.into()).position;
        check_parameters(name, &shape.points, &|builder| cage(builder, &shape, None), &at);
    }
    for is_reversed in [false, true] {
        let shape = nurbs::torus();
        let mesh = NurbsMesh { desc: shape.desc(), is_reversed, domain: None, extent: 0.0, part: 0 };
        let surface = mesh.checked().expect("a surface");
        let quads = mesh.quads(&surface);
        let at = |face: u64, [u, v]: [f32; 2]| quads.sample(face as usize, u.into(), v.into()).position;
        check_parameters("torus", &shape.points, &|builder| nurbs(builder, &shape, is_reversed), &at);
    }
}

/// Displacements that jump at a vertex, where the normal has no limit, do not make all of a face as fine as can be.
#[test]
fn jumps_at_vertices_do_not_explode() {
    for name in ["cube_creases", "cube_corners", "spike"] {
        let shape = own().into_iter().find(|it| it.name == name).expect("a shape");
        let (heights, coordinates) = (jumping_heights(), shape.coordinates());
        let scale = 0.1 * shape.extent();
        let displacement = Displacement { heights: &heights, scale, coordinates: &coordinates };
        let tolerance = Dicing::Tolerance(4e-3 * shape.extent());
        let mesh =
            CageMesh { desc: shape.desc(), positions: &shape.points, parts: &[0], displacement: Some(displacement) };
        let cage = mesh.checked().expect("a cage");
        let quads = mesh.quads(&cage).expect("quads");
        let dicer = Dicer::new(&quads, tolerance, &Cancel::new()).expect("edges");
        let most = (0..quads.count()).map(|quad| dicer.level(quad)).max();
        println!("{name}: level {most:?}");
        assert!(most.is_some_and(|most| (3..=8).contains(&most)), "{name}: level {most:?}");
    }
}
