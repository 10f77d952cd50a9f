//! Normals with which surfaces are shaded: made, given, and the pictures of them.

use crate::common::built::{self, Built, WHITE, on_each_structure, options};
use crate::common::models;
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::base::ids::BlockId;
use outcrop::build::{BuildOptions, BuildReport, Builder, Structure};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Light, LightKind, Scene};
use outcrop::store::ModelFile;
use std::time::Duration;

type Tri = [DVec3; 3];

/// Builds one part. Normals are made as by default.
fn build(tris: &[Tri], normals: Option<&[[Vec3; 3]]>, memory_budget: u64) -> (Built, BuildReport) {
    let options = BuildOptions { crease_angle: 0.0, memory_budget, threads: 2, ..options() };
    built::build_with(options, |builder| {
        let part = part(builder);
        for from in (0..tris.len()).step_by(4096) {
            let of = from..tris.len().min(from + 4096);
            let attributes = Attributes { colours: None, normals: normals.map(|n| &n[of.clone()]) };
            builder.triangles(MeshKey::DIRECT, part, &tris[of], attributes).expect("triangles");
        }
    })
}

fn part(builder: &mut Builder) -> u32 {
    let material = builder.material(WHITE).expect("a material");
    builder.part(PartDesc { id: Some(3), material: Some(material), ..PartDesc::default() }).expect("a part")
}

/// Rays from points of a sphere around zero to points of a smaller one.
fn rays(count: usize, [from, to]: [f64; 2]) -> Vec<Ray> {
    let mut rng = Rng::new(5);
    let mut ray = |_| {
        let eye = rng.direction() * from;
        Ray::new(eye, (rng.direction() * to - eye).as_vec3())
    };
    (0..count).map(&mut ray).collect()
}

const WITH_SHADING: QueryOptions = QueryOptions {
    coherent: false,
    want: Want(Want::ALL.0 | Want::SHADING_NORMAL.0),
    policy: outcrop::query::Policy::Exact,
};

/// Hits, the same for single rays and packets.
fn hits(built: &Built, rays: &[Ray]) -> Vec<Hit> {
    let (scene, _model) = built::scene(&built::context(2), built);
    let of = |coherent| {
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.state().closest(rays, QueryOptions { coherent, ..WITH_SHADING }, &mut hits).expect("hits");
        hits
    };
    let all = of(false);
    assert_eq!(all, of(true));
    let single: Vec<Hit> = rays[..100]
        .iter()
        .map(|ray| {
            let mut hit = [Hit::MISS];
            scene.state().closest(&[*ray], WITH_SHADING, &mut hit).expect("a hit");
            hit[0]
        })
        .collect();
    assert_eq!(all[..100], single);
    all
}

fn degrees(a: Vec3, b: DVec3) -> f64 {
    let (a, b) = (a.as_dvec3(), b.normalize());
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Greatest angle between the shading normals of hits and those of a function of the point, facing the ray.
fn worst(built: &Built, rays: &[Ray], normal: impl Fn(DVec3) -> DVec3) -> f64 {
    let hits = hits(built, rays);
    let met = || hits.iter().zip(rays).filter(|(hit, _)| hit.kind == HitKind::Exact);
    assert!(met().count() > rays.len() / 4);
    met().fold(0.0, |worst: f64, (hit, ray)| {
        assert!((hit.shading_normal.length() - 1.0).abs() < 1e-5 && hit.shading_normal.dot(hit.normal) >= 0.0);
        let normal = normal(hit.position);
        let facing = if normal.dot(ray.dir.as_dvec3()) > 0.0 { -normal } else { normal };
        worst.max(degrees(hit.shading_normal, facing))
    })
}

/// A cylinder of 32 facets along z, closed.
fn cylinder() -> Vec<Tri> {
    let at = |i: usize, z: f64| {
        let angle = std::f64::consts::TAU * (i % 32) as f64 / 32.0;
        DVec3::new(angle.cos(), angle.sin(), z)
    };
    (0..32)
        .flat_map(|i| {
            let [a, b, c, d] = [at(i, -1.0), at(i + 1, -1.0), at(i + 1, 1.0), at(i, 1.0)];
            [[a, b, c], [a, c, d], [b, a, DVec3::NEG_Z], [d, c, DVec3::Z]]
        })
        .collect()
}

fn spheres_and_cylinders_are_smooth() {
    for (rings, segments) in [(16, 32), (40, 80)] {
        let (built, _) = build(&scenes::sphere(rings, segments), None, 0);
        let off = worst(&built, &rays(20_000, [3.0, 0.9]), |p| p);
        assert!(off < 1.0, "{rings} rings: {off}");
    }
    let (built, _) = build(&cylinder(), None, 0);
    let off =
        worst(&built, &rays(20_000, [4.0, 0.9]), |p| if p.z.abs() > 0.999_999 { DVec3::Z } else { p.with_z(0.0) });
    assert!(off < 1.0, "{off}");
}

/// A box whose edges are cut at 45 degrees, and whose corners by triangles.
fn chamfered() -> Vec<Tri> {
    let (near, far) = (0.8, 1.0);
    // The three corners of the cut at each corner of the box: on the faces across x, y and z.
    let on = |signs: DVec3, axis: usize| {
        let mut p = signs * near;
        p[axis] = signs[axis] * far;
        p
    };
    let mut tris = Vec::new();
    let mut add = |points: &[DVec3]| {
        let outward: DVec3 = points.iter().sum();
        for i in 2..points.len() {
            let [a, b, c] = [points[0], points[i - 1], points[i]];
            tris.push(if (b - a).cross(c - a).dot(outward) > 0.0 { [a, b, c] } else { [a, c, b] });
        }
    };
    let signs = [-1.0, 1.0];
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let of = |a: f64, b: f64, c: f64| {
            let mut s = DVec3::ZERO;
            (s[axis], s[u], s[v]) = (a, b, c);
            s
        };
        for s in signs {
            add(&[of(s, -1.0, -1.0), of(s, 1.0, -1.0), of(s, 1.0, 1.0), of(s, -1.0, 1.0)].map(|s| on(s, axis)));
            for t in signs {
                let ends = signs.map(|along| of(along, s, t));
                add(&[on(ends[0], u), on(ends[1], u), on(ends[1], v), on(ends[0], v)]);
            }
        }
    }
    for i in 0..8 {
        let s = DVec3::from_array([0, 1, 2].map(|bit| if i >> bit & 1 == 1 { 1.0 } else { -1.0 }));
        add(&[on(s, 0), on(s, 1), on(s, 2)]);
    }
    tris
}

/// Edges of 45 degrees stay, and a model of flat faces has no normals in its file.
fn chamfers_stay_edges() {
    let tris = chamfered();
    assert_eq!(tris.len(), 6 * 2 + 12 * 2 + 8);
    // The triangles at the corners meet the chamfers at 35.3 degrees: without them.
    let (built, report) = build(&tris[..6 * 2 + 12 * 2], None, 0);
    assert!(!ModelFile::open_path(&built.path).expect("the file").header().has_normals);
    assert_eq!(report.bytes_normals, 0);
    for hit in hits(&built, &rays(5000, [3.0, 0.9])) {
        assert_eq!(hit.shading_normal, hit.normal);
    }
    // With them only the chamfers bend, towards them. The faces of the box stay flat to the last digit.
    let (built, _) = build(&tris, None, 0);
    for hit in hits(&built, &rays(5000, [3.0, 0.9])).iter().filter(|hit| hit.normal.abs().max_element() > 0.99) {
        assert!(degrees(hit.shading_normal, hit.normal.as_dvec3()) < 1e-3, "{hit:?}");
    }
    // With a greater angle they are smooth.
    let options = BuildOptions { crease_angle: 60.0, ..options() };
    let (built, _) = built::build_with(options, |builder| {
        let part = part(builder);
        builder.triangles(MeshKey::DIRECT, part, &tris, Attributes::NONE).expect("triangles");
    });
    assert!(hits(&built, &rays(5000, [3.0, 0.9])).iter().any(|hit| hit.shading_normal.dot(hit.normal) < 0.99));
}

/// Made in chunks the normals are those of the whole (`build::normals`, to the bit), up to the digits of a leaf, which
/// depend on the other normals in it.
#[test]
fn chunks_leave_no_seams() {
    let tris = scenes::bumpy_sphere(300, 500, 2);
    let [whole, chunked] = [0, 32 << 20].map(|budget| build(&tris, None, budget));
    assert!(chunked.1.chunks > whole.1.chunks + 2, "{} chunks", chunked.1.chunks);
    let rays = rays(60_000, [3.0, 0.7]);
    let [a, b] = [&whole, &chunked].map(|(built, _)| hits(built, &rays));
    let (mut worst, mut sum) = (0.0f64, 0.0);
    for (a, b) in a.iter().zip(&b) {
        assert_eq!((a.t, a.prim, a.normal), (b.t, b.prim, b.normal));
        let off = degrees(a.shading_normal, b.shading_normal.as_dvec3());
        (worst, sum) = (worst.max(off), sum + off);
    }
    let mean = sum / rays.len() as f64;
    println!("worst {worst:.3} degrees, mean {mean:.4}");
    assert!(worst < 1.3 && mean < 0.1, "worst {worst}, mean {mean}");
}

/// Bytes of the normals in memory for each triangle.
fn bytes_a_triangle(built: &Built) -> f64 {
    let file = ModelFile::open_path(&built.path).expect("the file");
    let blocks = (0..file.header().geometry_blocks).filter_map(|id| file.normal_block(BlockId(id)));
    blocks.map(|id| f64::from(file.decoded_len(id))).sum::<f64>() / file.header().triangles_kept as f64
}

#[test]
fn normals_of_scans_take_few_bytes() {
    let bytes = bytes_a_triangle(&build(&scenes::bumpy_sphere(300, 500, 2), None, 0).0);
    println!("bumpy sphere: {bytes:.2} bytes a triangle");
    assert!(bytes < 3.0, "{bytes}");
    // The dragon was made of a scan of seventy times as many triangles: neighbours differ by so much that the normals
    // of many leaves need two entries.
    for (name, most) in [("armadillo.ply", 3.0), ("turbine_blade_200k.ply", 3.0), ("asian_dragon_100k.ply", 3.5)] {
        let Some(path) = models::find(&format!("scans/{name}")) else { continue };
        let options = BuildOptions { crease_angle: 0.0, threads: 2, ..options() };
        let (built, _) = built::build_with(options, |builder| builder.add_file(&path).expect("a scan"));
        let bytes = bytes_a_triangle(&built);
        println!("{name}: {bytes:.2} bytes a triangle");
        assert!(bytes < most, "{name}: {bytes}");
    }
}

/// Given normals count, whatever the angle; turned, stretched and mirrored placements take them along; those that are
/// zero or not finite are counted, and the triangle's own replaces them.
fn given_normals_are_used() {
    let tris = scenes::sphere(6, 8);
    let normals: Vec<[Vec3; 3]> = tris.iter().map(|t| t.map(|p| p.as_vec3() * 3.0)).collect();
    let turned: Vec<[Vec3; 3]> = normals.iter().map(|n| n.map(|n| -n)).collect();
    for given in [&normals, &turned] {
        let (built, report) = build(&tris, Some(given), 0);
        assert_eq!(report.unusable_normals, 0);
        // Between corners of coarse facets, the interpolated normal is that of the interpolated point.
        let off = worst(&built, &rays(5000, [3.0, 0.6]), |p| p);
        assert!(off < 0.5, "{off}");
    }
    let mut bad = normals.clone();
    bad[3] = [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY];
    let (built, report) = build(&tris, Some(&bad), 0);
    assert_eq!(report.unusable_normals, 3);
    assert!(report.notes.iter().any(|note| note.contains("3 normals")), "{:?}", report.notes);
    let all = hits(&built, &rays(5000, [3.0, 0.6]));
    let own = all.iter().filter(|hit| hit.prim == 3);
    assert!(own.clone().count() > 5);
    own.for_each(|hit| assert!(degrees(hit.shading_normal, hit.normal.as_dvec3()) < 0.1, "{hit:?}"));
}

fn placements_take_normals_along() {
    let tris = scenes::sphere(24, 48);
    let (built, _) = build(&tris, None, 0);
    let context = built::context(1);
    let model = outcrop::scene::Model::open(&context, &built.path).expect("a model");
    for stretch in [DVec3::new(1.0, 2.0, 0.5), DVec3::new(-1.5, 1.0, 1.0)] {
        let place = DAffine3::from_scale_rotation_translation(stretch, DQuat::from_rotation_x(0.4), DVec3::X);
        let scene = Scene::new(&context);
        scene.add_instance(&model, 7, place).expect("an instance");
        scene.commit().expect("a commit");
        let rays: Vec<Ray> =
            rays(4000, [8.0, 0.8]).iter().map(|ray| Ray::new(ray.origin + DVec3::X, ray.dir)).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.state().closest(&rays, WITH_SHADING, &mut hits).expect("hits");
        let mut met = 0;
        for (hit, ray) in hits.iter().zip(&rays).filter(|(hit, _)| hit.kind == HitKind::Exact) {
            met += 1;
            let local = place.inverse().transform_point3(hit.position);
            let normal = place.matrix3.inverse().transpose() * local;
            let facing = if normal.dot(ray.dir.as_dvec3()) > 0.0 { -normal } else { normal };
            assert!(degrees(hit.shading_normal, facing) < 2.0, "{hit:?}");
        }
        assert!(met > 1000, "{met}");
    }
}
on_each_structure!(
    spheres_and_cylinders_are_smooth,
    chamfers_stay_edges,
    given_normals_are_used,
    placements_take_normals_along,
);

/// The blocks of normals are read by queries and frames that need them, and by no others.
#[test]
fn normals_are_read_when_they_are_needed() {
    let (built, _) = build(&scenes::sphere(200, 400), None, 0);
    let context = built::context(0);
    let (scene, model) = built::scene(&context, &built);
    let rays = rays(20_000, [3.0, 0.9]);
    let mut hits = vec![Hit::MISS; rays.len()];
    scene.state().closest(&rays, QueryOptions::default(), &mut hits).expect("hits");
    assert!(hits.iter().all(|hit| hit.shading_normal == Vec3::ZERO));
    let before = model.memory().resident;
    let file = ModelFile::open_path(&built.path).expect("the file");
    let geometry_and_ids: u64 = (0..2 * file.header().geometry_blocks)
        .map(|id| u64::from(file.decoded_len(BlockId(id))).next_multiple_of(64))
        .sum();
    assert!(before <= geometry_and_ids, "{before} of {geometry_and_ids}");
    scene.state().closest(&rays, WITH_SHADING, &mut hits).expect("hits");
    assert!(model.memory().resident > before);
}

fn picture(scene: &Scene, settings: FrameSettings) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let context = scene.state().context().clone();
    let size = FrameOptions { width: 200, height: 200, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(&context, size).expect("a frame");
    let camera =
        Camera::Perspective { eye: DVec3::new(0.0, -4.0, 0.5), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 35.0 };
    frame.request(&scene.state(), &camera, &settings).expect("a request");
    let status = frame.wait(Duration::from_secs(60));
    assert_eq!(status.state, FrameState::Converged);
    let floats = |buffer| frame.map(buffer).expect("a buffer").floats().expect("floats").to_vec();
    (floats(Buffer::ColourLinear), floats(Buffer::Normal), floats(Buffer::ShadingNormal))
}

/// A pick has every field, also the one that queries leave out unless it is requested.
#[test]
fn picks_have_a_shading_normal() {
    let (built, _) = build(&scenes::sphere(24, 48), None, 0);
    let (scene, _model) = built::scene(&built::context(2), &built);
    let size = FrameOptions { width: 64, height: 64, ..FrameOptions::default() };
    let frame = Frame::new(scene.state().context(), size).expect("a frame");
    let camera =
        Camera::Perspective { eye: DVec3::new(0.0, -4.0, 0.5), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 35.0 };
    frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request");
    for hit in [frame.pick(40, 24).expect("a hit"), frame.pick_near(40, 24, 3.0).expect("a hit")] {
        assert_eq!(hit.kind, HitKind::Exact);
        assert!(degrees(hit.shading_normal, hit.position) < 1.0, "{hit:?}");
        assert!(degrees(hit.normal, hit.position) > 1.0, "{hit:?}");
    }
}

fn lit(built: &Built, light: LightKind, shadows: bool) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let (scene, _model) = built::scene(&built::context(2), built);
    scene.set_lights(vec![Light { kind: light, colour: [1.0; 3], intensity: 3.0, shadows }]).expect("lights");
    scene.commit().expect("a commit");
    picture(&scene, FrameSettings { ambient: 0.0, poe: 0.0, ..FrameSettings::default() })
}

/// A coarse sphere looks like a fine one: also where the light grazes it, where facets would end in steps of shadow.
#[test]
fn coarse_facets_are_shaded_as_the_sphere_is() {
    let [coarse, fine] =
        [(24, 48), (300, 600)].map(|(rings, segments)| build(&scenes::sphere(rings, segments), None, 0).0);
    let flat = built::parts(&[built::Part::white(3, scenes::sphere(24, 48))]);
    let lights = [
        LightKind::Headlight,
        LightKind::Directional(DVec3::new(-1.0, 0.4, -0.2)),
        LightKind::Point(DVec3::new(3.0, -1.0, 2.0)),
    ];
    for light in lights {
        let [(a, geometric, shading), (b, ..), (c, ..)] = [&coarse, &fine, &flat].map(|built| lit(built, light, true));
        // Mean and greatest difference where both pictures have the sphere, without its outline.
        let difference = |a: &[f32]| {
            let inner = |i: usize| is_inner(&shading, i);
            let all: Vec<f32> = (0..b.len() / 4).filter(|i| inner(*i)).map(|i| (a[4 * i] - b[4 * i]).abs()).collect();
            assert!(all.len() > 5000);
            (all.iter().sum::<f32>() / all.len() as f32, all.iter().fold(0.0f32, |m, x| m.max(*x)))
        };
        let (mean, most) = difference(&a);
        let (mean_flat, most_flat) = difference(&c);
        println!("{light:?}: smooth {mean:.4} {most:.3}, flat {mean_flat:.4} {most_flat:.3}");
        assert!(mean < 0.3 * mean_flat && mean < 0.01, "{light:?}: {mean} of {mean_flat}");
        assert!(most < 0.15, "{light:?}: {most}");
        assert!(geometric != shading);
    }
}

/// True for a pixel whose neighbours three pixels away have a surface too.
fn is_inner(normals: &[f32], i: usize) -> bool {
    let (x, y) = (i % 200, i / 200);
    let covered = |x: usize, y: usize| normals[3 * (200 * y + x)..][..3] != [0.0; 3];
    (3..197).contains(&x)
        && (3..197).contains(&y)
        && [(-3, 0), (3, 0), (0, -3), (0, 3)]
            .iter()
            .all(|(dx, dy)| covered((x as i32 + dx) as usize, (y as i32 + dy) as usize))
}

/// Colours between corners are interpolated in linear light.
#[test]
fn colours_of_corners_are_interpolated() {
    let triangle = [DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 0.0, -1.0), DVec3::new(-1.0, 0.0, 1.0)];
    let corners = [[1.0f32, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for structure in Structure::ALL {
        let built = built::with(structure, || {
            built::build(|builder| {
                let part = part(builder);
                builder
                    .triangles(MeshKey::DIRECT, part, &[triangle], Attributes::colours(&[corners]))
                    .expect("triangles");
            })
        });
        let (scene, _model) = built::scene(&built::context(1), &built);
        scene.set_lights(Vec::new()).expect("lights");
        scene.commit().expect("a commit");
        let context = scene.state().context().clone();
        let size = FrameOptions { width: 32, height: 32, outputs: Outputs::ALL, ..FrameOptions::default() };
        let frame = Frame::new(&context, size).expect("a frame");
        let camera = Camera::Orthographic { eye: DVec3::NEG_Y, at: DVec3::ZERO, up: DVec3::Z, height: 2.0 };
        let settings = FrameSettings { ambient: 1.0, poe: 0.0, ..FrameSettings::default() };
        frame.request(&scene.state(), &camera, &settings).expect("a request");
        frame.wait(Duration::from_secs(60));
        let floats = |buffer| frame.map(buffer).expect("a buffer").floats().expect("floats").to_vec();
        let (colours, depth) = (floats(Buffer::ColourLinear), floats(Buffer::Depth));
        let mut seen = 0;
        for (i, colour) in colours.chunks_exact(4).enumerate().filter(|(i, _)| depth[*i].is_finite()) {
            let [x, z] = [i % 32, 31 - i / 32].map(|k| (k as f32 + 0.5) / 32.0);
            for (seen, expected) in colour.iter().zip([1.0 - x - z, x, z]) {
                assert!((seen - expected).abs() < 0.01, "{structure:?} {i}: {colour:?}, {x} {z}");
            }
            seen += 1;
        }
        assert!(seen > 400, "{seen}");
    }
}
