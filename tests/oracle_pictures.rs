//! Exact frames are what the oracle sees of the same scene of instances: depth, normals, silhouette, light and shadow
//! in the middle of every pixel, coverage and brightness over their areas. So both mean the same by a view, a light and
//! a placement.

use crate::common::brute::{Oracle, Tri};
use crate::common::built::{self, Part, WHITE};
use crate::common::bvh64::Bvh64;
use crate::common::light::Lighting;
use crate::common::picture::{
    Colours, coverage_ratio, depth_pixels, luminance, normal_angle, radiance_ratio, silhouette,
};
use crate::common::samples::{Estimate, Samples};
use crate::common::scenes;
use crate::common::stored::{self, Instance, World};
use crate::common::view::View;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::import::MaterialDesc;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Background, Camera, Light, LightKind, Model, Scene};
use std::time::Duration;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;

/// Where the model is in its own coordinates: so far from zero that trees have origins of their own.
const SHIFT: DVec3 = DVec3::new(1e5, -2e5, 5e4);

/// A bumpy ball on a plate, in two colours.
fn model() -> built::Built {
    let matt = |colour| MaterialDesc { colour, ..WHITE };
    let far = |tris: Vec<Tri>| tris.into_iter().map(|t| t.map(|v| v + SHIFT)).collect();
    built::parts(&[
        Part { id: 1, material: matt([0.9, 0.6, 0.3]), tris: far(scenes::bumpy_sphere(40, 60, 3)) },
        Part {
            id: 2,
            material: matt([0.2, 0.5, 0.8]),
            tris: far(scenes::cuboid(DVec3::new(-2.0, -2.0, -1.5), DVec3::new(2.0, 2.0, -1.25))),
        },
    ])
}

fn placements() -> [(u64, DAffine3); 2] {
    let turn = DQuat::from_rotation_z(0.6) * DQuat::from_rotation_x(0.4);
    let aside = DAffine3::from_scale_rotation_translation(DVec3::new(0.6, -0.5, 0.6), turn, DVec3::new(2.2, 1.0, 0.4));
    let back = DAffine3::from_translation(-SHIFT);
    [(1, back), (2, aside * back)]
}

fn lights() -> Vec<Light> {
    let light = |kind, intensity| Light { kind, colour: [1.0, 0.9, 0.7], intensity, shadows: true };
    vec![
        light(LightKind::Directional(DVec3::new(-1.0, 2.0, -3.0)), 0.5),
        light(LightKind::Point(DVec3::new(-1.0, -3.0, 4.0)), 6.0),
        light(LightKind::Headlight, 0.25),
    ]
}

/// Both sides of the comparison.
struct Both {
    frame: Frame,
    scene: Scene,
    world: World,
    oracle: Bvh64,
    camera: Camera,
}

impl Both {
    fn new() -> Self {
        let file = model();
        let context = built::context(2);
        let model = Model::open(&context, &file.path).expect("a model");
        let scene = Scene::new(&context);
        for (id, transform) in placements() {
            scene.add_instance(&model, id, transform).expect("an instance");
        }
        scene.set_lights(lights()).expect("lights");
        scene.set_background(Background::Colour([0.0; 4])).expect("a background");
        scene.commit().expect("a commit");
        let instances = placements().map(|(id, m)| Instance { path: &file.path, id, world_from_model: m });
        let world = stored::world(&instances);
        let oracle = Bvh64::new(world.tris.clone());
        let options = FrameOptions { width: WIDTH, height: HEIGHT, outputs: Outputs::ALL, ..Default::default() };
        let frame = Frame::new(&context, options).expect("a frame");
        let (eye, at) = (DVec3::new(3.0, -7.0, 4.0), DVec3::new(0.7, 0.3, -0.2));
        let camera = Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees: 40.0 };
        Self { frame, scene, world, oracle, camera }
    }

    fn render(&self, samples: u32) {
        let settings = FrameSettings { samples, ambient: 0.0, ..Default::default() };
        self.frame.request(&self.scene.state(), &self.camera, &settings).expect("a request");
        assert_eq!(self.frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
    }

    fn floats(&self, buffer: Buffer) -> Vec<f32> {
        self.frame.map(buffer).expect("a picture").floats().expect("floats").to_vec()
    }

    fn colour(&self, prim: u32) -> DVec3 {
        let [r, g, b] = self.world.names[prim as usize].colour.map(f64::from);
        DVec3::new(r, g, b)
    }
}

#[test]
fn the_middles_of_pixels_are_the_same() {
    let both = Both::new();
    both.render(1);
    let (lighting, view) = (Lighting::new(&both.oracle), View::new(&both.camera, WIDTH, HEIGHT));
    let seen = view.pixels(|x, y| {
        let at = lighting.surface(&view.ray(f64::from(x) + 0.5, f64::from(y) + 0.5))?;
        Some((view.depth(at.position), at.normal, both.colour(at.prim) * lighting.irradiance(&at, &lights())))
    });
    let depth: Vec<f32> = seen.iter().map(|s| s.map_or(f32::INFINITY, |s| s.0 as f32)).collect();
    let normal: Vec<f32> =
        seen.iter().flat_map(|s| s.map_or(DVec3::ZERO, |s| s.1).to_array()).map(|c| c as f32).collect();
    let light: Vec<DVec3> = seen.iter().map(|s| s.map_or(DVec3::ZERO, |s| s.2)).collect();
    // A ray or two may pass by an edge on the other side.
    let outline = silhouette(&both.floats(Buffer::Depth), &depth);
    assert!(outline.lost + outline.added <= 2 && outline.covered > 1500, "{outline:?}");
    let off = depth_pixels(&both.floats(Buffer::Depth), &depth, |d| view.pixel_width(d));
    assert!(off.p999 < 1e-3, "{off:?}");
    let off = normal_angle(&both.floats(Buffer::Normal), &normal);
    assert!(off.p999 < 0.1, "{off:?}");
    // The rims of shadows may move; and shadows there are, on a tenth of what is seen.
    let linear = both.floats(Buffer::ColourLinear);
    let alike = |(pixel, truth): (&[f32], &DVec3)| {
        truth.distance(DVec3::new(f64::from(pixel[0]), f64::from(pixel[1]), f64::from(pixel[2]))) < 1e-4
    };
    let other = linear.chunks_exact(4).zip(&light).filter(|pair| !alike(*pair)).count();
    println!("{outline:?}, {off:?}, {other} lit otherwise");
    assert!(other * 200 < outline.covered, "{other} of {} pixels are lit otherwise", outline.covered);
    let unshaded: Vec<Light> = lights().into_iter().map(|l| Light { shadows: false, ..l }).collect();
    let shaded = view.pixels(|x, y| {
        let at = lighting.surface(&view.ray(f64::from(x) + 0.5, f64::from(y) + 0.5))?;
        Some(lighting.irradiance(&at, &lights()) != lighting.irradiance(&at, &unshaded))
    });
    assert!(shaded.iter().filter(|s| **s == Some(true)).count() * 10 > outline.covered);
}

#[test]
fn the_means_over_pixels_are_the_same() {
    let both = Both::new();
    both.render(64);
    let linear = both.floats(Buffer::ColourLinear);
    let (lighting, view) = (Lighting::new(&both.oracle), View::new(&both.camera, WIDTH, HEIGHT));
    let samples = Samples { points: 32, rounds: 4, seed: 1 };
    let cover = view.pixels(|x, y| lighting.coverage(&view, x, y, &samples));
    let alpha = || linear.chunks_exact(4).map(|p| f64::from(p[3]));
    let ratio = coverage_ratio(alpha(), cover.iter().map(|e| e.mean));
    println!("coverage {ratio}");
    assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
    // Half-covered pixels too: the sides' samples are independent, each off by 1/20 at most.
    let edges: Vec<(f64, &Estimate)> = alpha().zip(&cover).filter(|(_, e)| e.mean > 0.1 && e.mean < 0.9).collect();
    assert!(edges.len() > 100 && edges.iter().all(|(a, e)| (a - e.mean).abs() < 0.1));
    let light = view.pixels(|x, y| {
        lighting.radiance(&view, [x, y], &lights(), &|prim| both.colour(prim), DVec3::ZERO, &samples).map(|e| e.mean)
    });
    let truth: Vec<f32> = light.iter().flat_map(|l| [l[0], l[1], l[2], 1.0]).map(|c| c as f32).collect();
    let ratio = radiance_ratio(Colours::Linear(&linear), Colours::Linear(&truth), |_| true);
    println!("brightness {ratio}");
    assert!((ratio - 1.0).abs() < 2e-3, "{ratio}");
    assert!(light.iter().map(|l| luminance(*l)).sum::<f64>() > 100.0 && both.oracle.tris().len() > 4000);
}
