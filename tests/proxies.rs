//! Models with proxies: their size, their look, and all that must not depend on them.

use crate::common::asked;
use crate::common::built::{self, Built, Part};
use crate::common::frames;
use crate::common::scenes;
use glam::DVec3;
use outcrop::Error;
use outcrop::base::progress::Cancel;
use outcrop::build::{BuildOptions, StandIns};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions};
use outcrop::render::{Buffer, Frame, FrameSettings};
use outcrop::scene::{Background, Camera, Context, ContextOptions, Model, Scene};
use outcrop::store::ModelFile;

fn options(stand_ins: StandIns) -> BuildOptions {
    BuildOptions { threads: 2, stand_ins, ..built::options() }
}

fn generated(name: &str, triangles: u64, options: BuildOptions) -> Built {
    let size = GenerateOptions { triangles, seed: 0, ..Default::default() };
    built::build_with(options, |sink| {
        generate(name, &size, &Cancel::new(), sink).expect("a model");
    })
    .0
}

fn of(parts: &[Part], options: BuildOptions) -> Built {
    built::build_with(options, |builder| parts.iter().for_each(|part| built::push(builder, part))).0
}

#[test]
fn proxies_take_a_third_of_a_byte() {
    for name in ["airliner", "mandelbulb"] {
        let model = generated(name, 100_000, BuildOptions { proxy_rays: 16, ..options(StandIns::Proxies) });
        let file = ModelFile::open_path(&model.path).expect("a file");
        let (proxies, triangles) = (file.proxies(), file.header().triangles_kept as f64);
        let in_file = 80 * proxies.len() + 10 * proxies.runs().count();
        let each = [proxies.memory() as f64 / triangles, in_file as f64 / triangles];
        println!("{name}: {} proxies, {each:.3?} bytes for each triangle in memory and in the file", proxies.len());
        assert!(each.iter().all(|each| (0.2..=0.35).contains(each)), "{name}: {each:?}");
        let least = file.proxies().rows().iter().map(|row| row.area).fold(f32::INFINITY, f32::min);
        assert!(least > 0.0);
    }
}

#[test]
fn the_file_does_not_depend_on_threads() {
    for memory_budget in [0, 32 << 20] {
        let of = |threads| {
            let options = BuildOptions { threads, memory_budget, proxy_rays: 32, ..options(StandIns::Proxies) };
            std::fs::read(generated("airliner", 100_000, options).path).expect("a file")
        };
        let one = of(1);
        assert!(one == of(4) && one == of(3), "budget {memory_budget}");
    }
}

/// A budget that holds all but the proxies is refused, and the error names the need: that of the same model without
/// proxies, and the proxies.
#[test]
fn a_budget_without_room_for_proxies_names_the_need() {
    let need = |model: &Built, memory_budget| {
        let options = ContextOptions { threads: 1, memory_budget, read_ahead: false, ..Default::default() };
        match Model::open(&Context::new(options).expect("a context"), &model.path).map(drop) {
            Err(Error::OverBudget { need, .. }) => Some(need),
            Ok(()) => None,
            Err(other) => panic!("{other}"),
        }
    };
    let [with, without] = [StandIns::Proxies, StandIns::Voxels]
        .map(|kind| generated("mandelbulb", 300_000, BuildOptions { proxy_rays: 8, ..options(kind) }));
    let proxies = ModelFile::open_path(&with.path).expect("a file").proxies().memory();
    assert!(proxies > 60_000, "{proxies}");
    let (of_with, of_without) = (need(&with, 4096).expect("too small"), need(&without, 4096).expect("too small"));
    // Blocks with proxies have no samples of sides. So there are fewer blocks, and their directory is a little smaller.
    assert!(of_with > of_without + proxies / 2 && of_with < of_without + proxies, "{of_with} {of_without} {proxies}");
    assert_eq!([need(&without, of_without), need(&with, of_with)], [None, None]);
    assert_eq!(need(&with, of_without), Some(of_with));
    assert_eq!(need(&with, of_with - 1), Some(of_with));
    let context = built::context(1);
    let (model, plain) = [&with, &without].map(|built| Model::open(&context, &built.path).expect("a model")).into();
    assert_eq!((model.info().proxy_bytes, plain.info().proxy_bytes, plain.info().proxies), (proxies, 0, 0));
    assert!(model.memory().tables > plain.memory().tables + proxies / 2);
}

#[test]
fn options_out_of_range_are_refused() {
    let options = BuildOptions { proxy_rays: outcrop::build::MOST_PROXY_RAYS + 1, ..options(StandIns::Proxies) };
    let made = outcrop::build::Builder::new(options, Default::default(), Cancel::new());
    assert!(matches!(made.map(drop), Err(Error::BadArgument(why)) if why.contains("proxy_rays")));
}

/// Rays with cones find the same stand-ins, at the same places and with the same bounds; only the look differs. Exact
/// rays find the same. (Of one part: voxels of several parts also say which part is seen from where.)
#[test]
fn only_the_look_differs() {
    let cuboid = scenes::cuboid(DVec3::splat(-1.5), DVec3::new(1.5, 1.5, -1.0));
    let parts = [Part::white(1, [scenes::bumpy_sphere(120, 160, 3), cuboid].concat())];
    let hits = |kind, cone| {
        let built = of(&parts, BuildOptions { proxy_rays: 64, proxy_triangles: 20, ..options(kind) });
        let (scene, _) = built::scene(&built::context(1), &built);
        let rays: Vec<Ray> = asked::rays(400, 5, DVec3::ZERO, 1.5).into_iter().map(|ray| Ray { cone, ..ray }).collect();
        asked::ask(&scene.state(), &rays, QueryOptions::default())
    };
    for cone in [Cone::ZERO, Cone { a: 0.05, b: 0.0 }, Cone { a: 0.3, b: 0.01 }] {
        let (with, without): (Vec<Hit>, Vec<Hit>) = (hits(StandIns::Proxies, cone), hits(StandIns::Voxels, cone));
        let mut others = 0;
        for (a, b) in with.iter().zip(&without) {
            assert_eq!(
                (a.t, a.kind, a.part, a.error, a.t_free, a.prim),
                (b.t, b.kind, b.part, b.error, b.t_free, b.prim)
            );
            assert!(a.kind == HitKind::Miss || (a.normal.length() - 1.0).abs() < 1e-3);
            others += usize::from(a.normal != b.normal);
        }
        assert_eq!(others > 50, cone != Cone::ZERO, "{others} other normals");
    }
}

/// Mean light of the covered pixels of a picture, and their number.
fn mean_light(frame: &Frame, scene: &Scene, camera: &Camera, poe: f32) -> [f64; 2] {
    let settings = FrameSettings { poe, ambient: 0.0, ..Default::default() };
    frame.request(&scene.state(), camera, &settings).expect("a request");
    frame.wait(frames::LONG);
    let (kinds, colours) = (frame.map(Buffer::Kind).expect("kinds"), frame.map(Buffer::ColourLinear).expect("colours"));
    let (mut sum, mut count) = (0.0, 0.0);
    for (kind, colour) in kinds.bytes().iter().zip(colours.floats().expect("floats").chunks(4)) {
        if *kind != 0 {
            (sum, count) = (sum + f64::from(colour[0]), count + 1.0);
        }
    }
    [sum / f64::max(count, 1.0), count]
}

/// A lone proxy over a plate, an edge and a sphere: over many views its light is that of the triangles, and in each
/// view nearly so.
#[test]
fn a_lone_proxy_is_as_bright_as_its_triangles() {
    let side = |n: usize| (0..n * n).map(move |i| [(i % n) as f64 / n as f64, (i / n) as f64 / n as f64]);
    let square = |at: &dyn Fn([f64; 2]) -> DVec3| {
        let d = 1.0 / 24.0;
        side(24)
            .flat_map(|[u, v]| {
                let [a, b, c, e] = [[u, v], [u + d, v], [u + d, v + d], [u, v + d]].map(at);
                [[a, b, c], [a, c, e]]
            })
            .collect::<Vec<_>>()
    };
    let plate = square(&|[u, v]| DVec3::new(u - 0.5, v - 0.5, 0.0));
    let edge =
        [square(&|[u, v]| DVec3::new(u - 0.5, v - 0.5, 0.0)), square(&|[u, v]| DVec3::new(u - 0.5, 0.5, -v))].concat();
    for (name, tris) in [("plate", plate), ("edge", edge), ("sphere", scenes::sphere(24, 48))] {
        let rays = BuildOptions { proxy_rays: 4096, proxy_triangles: tris.len() as u32, ..options(StandIns::Proxies) };
        let model = of(&[Part::white(1, tris)], rays);
        let context = built::context(2);
        let (scene, _) = built::scene(&context, &model);
        scene.set_background(Background::Colour([0.0; 4])).expect("a background");
        scene.commit().expect("a commit");
        assert_eq!(ModelFile::open_path(&model.path).expect("a file").proxies().len(), 1, "{name}");
        let frame = frames::frame(&context, 48, 48);
        let (mut sums, mut worst) = ([0.0; 3], 0.0f64);
        let views = 300;
        for i in 0..views {
            // Directions spread evenly.
            let z = 1.0 - f64::from(2 * i + 1) / f64::from(views);
            let (across, turn) = ((1.0 - z * z).sqrt(), 2.399_963 * f64::from(i));
            let camera =
                frames::perspective(DVec3::new(across * turn.cos(), across * turn.sin(), z) * 40.0, DVec3::ZERO);
            let Camera::Perspective { eye, at, up, .. } = camera else { panic!("a perspective camera") };
            let camera = Camera::Perspective { eye, at, up, fov_y_degrees: 4.0 };
            let ([exact, count], [own, _]) =
                (mean_light(&frame, &scene, &camera, 0.0), mean_light(&frame, &scene, &camera, 20.0));
            sums = [sums[0] + exact * count, sums[1] + own * count, sums[2] + count];
            worst = if count > 100.0 { worst.max((own - exact).abs()) } else { worst };
        }
        let [exact, own] = [sums[0] / sums[2], sums[1] / sums[2]];
        println!("{name}: exact {exact:.4}, proxy {own:.4}; at most {worst:.4} apart in one view");
        assert!((own / exact - 1.0).abs() < 0.02, "{name}: {own} instead of {exact}");
        assert!(worst < 0.25, "{name}: {worst}");
    }
}

/// Data that is not there yet shows proxies too.
#[test]
fn missing_blocks_show_proxies() {
    let model = generated("mandelbulb", 60_000, BuildOptions { proxy_rays: 64, ..options(StandIns::Proxies) });
    let context = built::context(1);
    let cold = Model::open_cold(&context, &model.path).expect("a model");
    let scene = Scene::new(&context);
    scene.add_instance(&cold, 1, glam::DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    let rays = asked::rays(300, 1, cold.info().bounds.center(), 2.0);
    // The first rays bring in what they need; the others see stand-ins for the rest.
    asked::ask(&scene.state(), &rays[..3], QueryOptions::default());
    let hits = asked::ask(&scene.state(), &rays, QueryOptions { policy: Policy::Now, ..QueryOptions::default() });
    let missing = hits.iter().filter(|hit| hit.kind == HitKind::Missing && (hit.normal.length() - 1.0).abs() < 1e-3);
    assert!(missing.clone().count() > 20, "{}", missing.count());
}
