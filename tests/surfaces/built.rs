//! Surfaces in built models: closed, as near to the surface as asked, with its normals and parts.

use crate::common::asked::ask;
use crate::common::built::{self, Built, build_with};
use crate::common::models;
use crate::common::nurbs::{Nurbs, sphere, torus};
use crate::common::rng::Rng;
use crate::common::shapes::{Shape, own};
use glam::{DVec3, Vec3};
use outcrop::base::error::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::geom::point_triangle;
use outcrop::import::surfaces::{CageMesh, Dicing, Displacement, HeightMap, Heights, NurbsMesh, Wrap};
use outcrop::import::{MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use std::sync::Arc;

fn diced(dicing: Dicing) -> BuildOptions {
    BuildOptions { dicing: Some(dicing), ..built::options() }
}

/// Builds a cage, each face a part with its number as id if `by_face`.
fn cage(shape: &Shape, dicing: Dicing, by_face: bool) -> (Built, BuildReport) {
    build_with(diced(dicing), |builder| {
        let count = if by_face { shape.sizes.len() as u64 } else { 1 };
        let part = |id| PartDesc { id: Some(id), ..PartDesc::default() };
        let parts: Vec<u32> = (0..count).map(|id| builder.part(part(id)).expect("a part")).collect();
        let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &parts, displacement: None };
        builder.cage(MeshKey::DIRECT, &mesh).expect("a surface");
    })
}

/// Hits of rays from a point in random directions.
fn around(built: &Built, from: DVec3, count: usize) -> Vec<(Ray, Hit)> {
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, built);
    let mut rng = Rng::new(7);
    let rays: Vec<Ray> = (0..count).map(|_| Ray::new(from, rng.direction().as_vec3())).collect();
    let options = QueryOptions { want: Want::ALL | Want::SHADING_NORMAL, ..QueryOptions::default() };
    let hits = ask(&scene.state(), &rays, options);
    rays.into_iter().zip(hits).collect()
}

fn distance(p: DVec3, triangles: &[[DVec3; 3]]) -> f64 {
    triangles.iter().map(|t| point_triangle(p, t).squared).fold(f64::MAX, f64::min).sqrt()
}

#[test]
fn closed_cages_let_no_ray_out_and_are_near_their_surface() {
    let mut count = 0;
    // The middle of `two_cubes_vertex` is the vertex that its cubes share.
    for shape in own().iter().filter(|it| it.is_closed() && it.name != "two_cubes_vertex") {
        let tolerance = 1e-3 * shape.extent();
        let (built, report) = cage(shape, Dicing::Tolerance(tolerance), false);
        let middle = shape.points.iter().sum::<DVec3>() / shape.points.len() as f64;
        let hits = around(&built, middle, 20_000);
        let lost = hits.iter().filter(|(_, hit)| hit.kind != HitKind::Exact).count();
        assert_eq!(lost, 0, "{}: rays from the middle", shape.name);
        let surface = shape.fine();
        let far = hits.iter().step_by(100).map(|(_, hit)| distance(hit.position, &surface)).fold(0.0, f64::max);
        println!("{}: {} triangles, {:.2} of the tolerance", shape.name, report.triangles_kept, far / tolerance);
        assert!(far <= tolerance && far > 0.01 * tolerance, "{}: {far} of {tolerance}", shape.name);
        count += 1;
    }
    assert!(count >= 6, "{count} closed cages");
}

/// A smooth cube is symmetric: the axes meet its faces in their middles, along their normals.
#[test]
fn faces_are_parts_and_have_the_normals_of_the_surface() {
    let mut shape = own().into_iter().find(|it| it.name == "cube").expect("a cube");
    // The file's own has one corner elsewhere.
    shape.points.iter_mut().for_each(|p| *p = p.signum());
    let (built, _) = cage(&shape, Dicing::Level(5), true);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    let middle = shape.points.iter().sum::<DVec3>() / 8.0;
    let mut first = 0;
    for (face, &size) in shape.sizes.iter().enumerate() {
        let of_face = &shape.indices[first..first + size as usize];
        first += size as usize;
        let to = of_face.iter().map(|&v| shape.points[v as usize]).sum::<DVec3>() / f64::from(size) - middle;
        let ray = Ray::new(middle + 5.0 * to + DVec3::new(1e-4, 2e-4, 3e-4), -to.as_vec3());
        let hit =
            ask(&scene.state(), &[ray], QueryOptions { want: Want::ALL | Want::SHADING_NORMAL, ..Default::default() })
                [0];
        assert_eq!((hit.kind, hit.part), (HitKind::Exact, face as u64));
        assert!(hit.shading_normal.dot(to.normalize().as_vec3()) > 0.9999, "{:?}", hit.shading_normal);
    }
    // Elsewhere the normal is that of the surface, not that of the triangle.
    for (ray, hit) in around(&built, middle, 1000) {
        let normal = hit.shading_normal.as_dvec3();
        assert!(hit.kind == HitKind::Exact && normal.dot(ray.dir.as_dvec3()).abs() > 0.8, "{hit:?}");
    }
}

#[test]
fn levels_give_their_number_of_triangles() {
    let shapes = own();
    let of = |name: &str| shapes.iter().find(|it| it.name == name).expect("a shape");
    for level in [1, 3] {
        assert_eq!(cage(of("cube"), Dicing::Level(level), false).1.triangles_in, (6 * 2) << (2 * level));
        // Each corner of a face that is no quad is a quad of half its sides.
        assert_eq!(cage(of("tetrahedron"), Dicing::Level(level), false).1.triangles_in, (4 * 3 * 2) << (2 * level - 2));
    }
}

/// An OBJ file with tags is the same surface as the cage from memory.
#[test]
fn files_with_tags_are_the_cages_of_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    for shape in own() {
        let path = folder.path().join(format!("{}.obj", shape.name));
        std::fs::write(&path, text_of(&shape)).expect("a file");
        let options = BuildOptions { subdivide: true, ..diced(Dicing::Level(2)) };
        let (from_file, report) = build_with(options, |builder| builder.add_file(&path).expect("a file"));
        let (from_memory, expected) = cage(&shape, Dicing::Level(2), false);
        assert_eq!(report.triangles_in, expected.triangles_in, "{}", shape.name);
        let bits = |built: &Built| {
            let hits = around(built, shape.points[0] + DVec3::new(0.1, 0.2, 0.3), 500);
            hits.iter().map(|(_, hit)| (hit.t.to_bits(), hit.prim)).collect::<Vec<_>>()
        };
        assert!(bits(&from_file) == bits(&from_memory), "{}", shape.name);
    }
    // Without being asked for, faces stay polygons, and the tags are noted.
    let path = folder.path().join("cube_creases.obj");
    let (_, report) = build_with(built::options(), |builder| builder.add_file(&path).expect("a file"));
    assert_eq!(report.triangles_in, 12);
    assert!(report.notes.iter().any(|note| note.contains("× \"t\"")), "{:?}", report.notes);
}

fn text_of(shape: &Shape) -> String {
    use outcrop::geom::surface::cage::{Boundary, Creasing, TriangleRule};
    let mut lines: Vec<String> = shape.points.iter().map(|p| format!("v {:?} {:?} {:?}", p.x, p.y, p.z)).collect();
    let mut first = 0;
    for &size in &shape.sizes {
        let face = shape.indices[first..first + size as usize].iter().map(|v| format!(" {}", v + 1));
        lines.push(format!("f{}", face.collect::<String>()));
        first += size as usize;
    }
    lines.extend(shape.creases.iter().map(|(a, b, s)| format!("t crease 2/1/0 {a} {b} {s:?}")));
    lines.extend(shape.corners.iter().map(|(v, s)| format!("t corner 1/1/0 {v} {s:?}")));
    lines.extend(shape.holes.iter().map(|face| format!("t hole 1/0/0 {face}")));
    let boundary =
        [Boundary::None, Boundary::EdgeAndCorner, Boundary::EdgeOnly].iter().position(|b| *b == shape.boundary);
    lines.push(format!("t interpolateboundary 1/0/0 {}", boundary.expect("a rule")));
    if shape.creasing == Creasing::Chaikin {
        lines.push("t creasemethod 0/0/1 chaikin".into());
    }
    if shape.triangles == TriangleRule::Smooth {
        lines.push("t smoothtriangles 0/0/1 smooth".into());
    }
    lines.join("\n")
}

fn nurbs(shape: &Nurbs, dicing: Dicing) -> (Built, BuildReport) {
    build_with(diced(dicing), |builder| {
        let part = builder.part(PartDesc::default()).expect("a part");
        let mesh = NurbsMesh { desc: shape.desc(), is_reversed: false, domain: None, extent: 0.0, part };
        builder.nurbs(MeshKey::DIRECT, &mesh).expect("a surface");
    })
}

#[test]
fn spheres_and_tori_of_nurbs_are_closed_and_round() {
    let tolerance = 1e-3;
    for (is_sphere, from) in [(true, DVec3::new(0.1, 0.2, -0.3)), (false, DVec3::new(3.1, 0.2, -0.1))] {
        let shape = if is_sphere { sphere() } else { torus() };
        let (built, report) = nurbs(&shape, Dicing::Tolerance(tolerance));
        let mut far = 0.0f64;
        for (_, hit) in around(&built, from, 50_000) {
            assert_eq!(hit.kind, HitKind::Exact);
            let p = hit.position;
            let centre = if is_sphere { DVec3::ZERO } else { 3.0 * p.with_z(0.0).normalize() };
            far = far.max((p.distance(centre) - 1.0).abs());
            let outward = (p - centre).normalize().as_vec3();
            assert!(hit.shading_normal.dot(outward).abs() > 1.0 - 1e-5, "{hit:?}");
            assert!(Vec3::dot(hit.normal, outward).abs() > 0.99);
        }
        println!("sphere {is_sphere}: {} triangles, {far}", report.triangles_kept);
        assert!(far <= tolerance && far > tolerance / 10.0, "{far}");
    }
}

#[test]
fn surfaces_of_files_are_read() {
    for (name, least, note) in
        [("teapot.bpt", 3000, None), ("NIST_MBE_PMI_1.trimmed_nurbs.json", 100, Some("have trims and are left out"))]
    {
        let Some(path) = models::find(&format!("nurbs/{name}")) else { continue };
        let (_, report) = build_with(built::options(), |builder| builder.add_file(&path).expect("a file"));
        println!("{name}: {} triangles; {:?}", report.triangles_kept, report.notes);
        assert!(report.triangles_kept > least, "{name}: {}", report.triangles_kept);
        assert!(note.is_none_or(|note| report.notes.iter().any(|it| it.contains(note))), "{name}: {:?}", report.notes);
    }
}

#[test]
fn wrong_surfaces_are_refused_and_add_nothing() {
    let shape = own().into_iter().find(|it| it.name == "cube").expect("a cube");
    let mut builder = Builder::new(built::options(), Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    let part = builder.part(PartDesc::default()).expect("a part");
    let mut refused = |change: &dyn Fn(&mut Shape), parts: &[u32], why: &str| {
        let mut wrong = shape.clone();
        change(&mut wrong);
        let mesh = CageMesh { desc: wrong.desc(), positions: &wrong.points, parts, displacement: None };
        match builder.cage(MeshKey::DIRECT, &mesh) {
            Err(Error::BadArgument(text)) => assert!(text.contains(why), "{text}, not {why}"),
            other => panic!("{other:?}, not {why}"),
        }
        assert_eq!(builder.triangles_read(), 0);
    };
    refused(&|it| it.points[3].y = f64::NAN, &[part], "vertex 3 (from 0) is not finite");
    refused(&|it| it.creases.push((0, 6, 1.0)), &[part], "crease 0 to 6");
    refused(&|it| it.corners.push((1, -1.0)), &[part], "vertex 1");
    refused(&|it| it.sizes[2] = 2, &[part], "face 2");
    refused(&|it| it.indices[5] = 8, &[part], "vertex 8");
    refused(&|it| it.holes.push(6), &[part], "hole 6");
    refused(&|_| (), &[part, part], "6 faces, but 2 parts");
    refused(&|_| (), &[part + 1], "no such part");
    let wrong = [Dicing::Level(13), Dicing::Tolerance(-1.0), Dicing::Tolerance(f64::INFINITY)];
    for dicing in wrong {
        assert!(Builder::new(diced(dicing), Arc::new(Progress::default()), Cancel::new()).is_err(), "{dicing:?}");
    }
}

/// A sphere of radius 1, moved by a constant height, is a sphere; by a wave of the map, its height is that of the wave.
#[test]
fn displaced_surfaces_follow_their_map() {
    let shape = own().into_iter().find(|it| it.name == "cube").expect("a cube");
    // The coordinates of each face cover the map.
    let coordinates = shape.coordinates();
    let plain = shape.fine();
    let middle = shape.points.iter().sum::<DVec3>() / 8.0;
    for (texels, most) in [(vec![1.0f32; 64], 0.1), (bumps(), 0.1)] {
        let heights = Heights::new([8, 8], 1, [Wrap::Repeat; 2], texels).expect("heights");
        for (scale, is_grid) in [(0.1, false), (-0.1, false), (0.1, true)] {
            let grids = Heights::new([8, 8], 6, [Wrap::Repeat; 2], bumps().repeat(6)).expect("heights");
            let displacement = Displacement {
                heights: if is_grid { &grids } else { &heights },
                scale,
                coordinates: if is_grid { &[] } else { &coordinates },
            };
            let (built, _) = build_with(diced(Dicing::Tolerance(1e-3)), |builder| {
                let part = builder.part(PartDesc::default()).expect("a part");
                let mesh = CageMesh {
                    desc: shape.desc(),
                    positions: &shape.points,
                    parts: &[part],
                    displacement: Some(displacement),
                };
                builder.cage(MeshKey::DIRECT, &mesh).expect("a surface");
            });
            let (mut nearest, mut farthest) = (f64::MAX, 0.0f64);
            for (i, (_, hit)) in around(&built, middle, 4000).into_iter().enumerate() {
                assert_eq!(hit.kind, HitKind::Exact);
                if i % 40 == 0 {
                    let away = distance(hit.position, &plain);
                    (nearest, farthest) = (nearest.min(away), farthest.max(away));
                }
            }
            assert!(farthest <= most + 3e-3 && farthest > 0.05, "{scale} {is_grid}: {farthest}");
            let is_constant = heights.range(0, [[0.0, 1.0]; 2])[0] > 0.9 && !is_grid;
            assert!(!is_constant || nearest > most - 3e-3, "{scale}: {nearest}");
            assert!(is_constant || nearest < 0.02, "{scale} {is_grid}: {nearest}");
        }
    }
}

/// A map of 8 × 8 texels with a bump of height 1 in its middle, and 0 at its borders.
fn bumps() -> Vec<f32> {
    let is_high = |at: usize| (2..6).contains(&at);
    (0..64).map(|i| if is_high(i % 8) && is_high(i / 8) { 1.0 } else { 0.0 }).collect()
}

/// A picture of heights displaces the cage of an OBJ file; a missing one, and corners without coordinates, are named.
#[test]
fn pictures_displace_the_cages_of_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let (obj, map) = (folder.path().join("square.obj"), folder.path().join("heights.png"));
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n\
                t interpolateboundary 1/0/0 1\n";
    std::fs::write(&obj, text).expect("a file");
    image::GrayImage::from_fn(16, 16, |_, _| image::Luma([51])).save(&map).expect("a picture");
    let build = |map: &std::path::Path| {
        let displacement = Some(HeightMap { path: map.into(), scale: 0.5 });
        let options = BuildOptions { subdivide: true, displacement, ..diced(Dicing::Level(3)) };
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
        builder.add_file(&obj).map(|()| builder)
    };
    let out = folder.path().join("square.oc");
    build(&map).and_then(|builder| builder.finish(&out)).expect("a build");
    let context = built::context(1);
    let model = outcrop::scene::Model::open(&context, &out).expect("a model");
    // White is 255, so 51 is a fifth of the scale.
    let bounds = model.info().bounds;
    assert!((bounds.min.z - 0.1).abs() < 1e-6 && (bounds.max.z - 0.1).abs() < 1e-6, "{bounds:?}");
    let error = build(&folder.path().join("none.png")).expect_err("an error").to_string();
    assert!(error.contains("none.png"), "{error}");
    std::fs::write(&obj, text.replace("3/3", "3")).expect("a file");
    let error = build(&map).expect_err("an error").to_string();
    assert!(error.contains("line 9") && error.contains("texture coordinates"), "{error}");
}

/// Surfaces that no level makes finer, or that would be too large, end soon: nothing waits, and memory stays small.
#[test]
fn hard_surfaces_end() {
    let cube = own().into_iter().find(|it| it.name == "cube").expect("a cube");
    let (mut one_point, mut far) = (cube.clone(), cube.clone());
    one_point.points.fill(DVec3::new(0.1, 0.2, 0.3));
    far.points.iter_mut().for_each(|p| *p = *p * 1e-7 + DVec3::splat(3e6));
    for (shape, tolerance) in [(&one_point, 1e-9), (&far, 1e-12), (&one_point, f64::MIN_POSITIVE)] {
        let (_, report) = cage(shape, Dicing::Tolerance(tolerance), false);
        assert!(report.triangles_in <= (24 * 2) << 6, "{} triangles", report.triangles_in);
    }
    let limited = |shape: &Shape, dicing: Dicing| {
        let options = BuildOptions { max_triangles: 1000, ..diced(dicing) };
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
        let part = builder.part(PartDesc::default()).expect("a part");
        let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &[part], displacement: None };
        builder.cage(MeshKey::DIRECT, &mesh)
    };
    assert!(matches!(limited(&cube, Dicing::Level(12)), Err(Error::OverLimit { .. })));
    let heights = Heights::new([1, 1], 1, [Wrap::Repeat; 2], vec![1e30]).expect("heights");
    let displacement = Displacement { heights: &heights, scale: 1e300, coordinates: &[[0.0; 2]; 24] };
    let mut builder = Builder::new(built::options(), Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    let part = builder.part(PartDesc::default()).expect("a part");
    let mesh =
        CageMesh { desc: cube.desc(), positions: &cube.points, parts: &[part], displacement: Some(displacement) };
    match builder.cage(MeshKey::DIRECT, &mesh) {
        Err(Error::BadArgument(why)) => assert!(why.contains("heights"), "{why}"),
        other => panic!("{other:?}"),
    }
}
