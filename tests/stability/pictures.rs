//! Pictures of a scene in every way in which they can be made: one thread and two, each vector path. All must be the
//! same to the bit, so that what is measured of one is measured of all.

use crate::common::picture::{Colours, luminance};
use crate::common::trees;
use glam::{DAffine3, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::query::HitKind;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Background, Camera, Context, ContextOptions, Light, LightKind, Model, Scene, SceneState};
use outcrop::simd::Isa;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Pixels of error that every row is looked at with.
pub const POE: [f32; 5] = [0.0, 0.5, 1.0, 3.0, 10.0];
pub const LONG: Duration = Duration::from_secs(120);

/// What a scene is besides its models; black behind them.
#[derive(Clone)]
pub struct Setting {
    pub lights: Vec<Light>,
    pub ambient: f32,
    pub size: (u32, u32),
    /// Rays for a pixel's colour.
    pub samples: u32,
    /// Models have no form for exact rays, which is made at some time meanwhile. Of slivers met edge-on, which seams of
    /// surfaces have, it may say other than the blocks (`tests/exact.rs`).
    pub is_compact: bool,
}

impl Default for Setting {
    fn default() -> Self {
        Self { lights: vec![Light::HEADLIGHT], ambient: 0.0, size: (96, 72), samples: 1, is_compact: false }
    }
}

/// A light from far away, with shadows.
pub fn sun(along: DVec3) -> Light {
    Light { kind: LightKind::Directional(along), shadows: true, ..Light::HEADLIGHT }
}

pub fn perspective(eye: DVec3, at: DVec3) -> Camera {
    Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees: 40.0 }
}

/// Threads and instruction set of each way.
pub fn ways() -> Vec<(usize, Isa)> {
    trees::isas().into_iter().flat_map(|isa| [(1, isa), (2, isa)]).collect()
}

/// One way to make pictures of a scene.
struct Way {
    name: String,
    state: Arc<SceneState>,
    frame: Frame,
}

/// All ways, with the whole scene in memory.
pub struct Stage {
    ways: Vec<Way>,
    setting: Setting,
}

impl Stage {
    pub fn new(path: &Path, setting: Setting) -> Self {
        Self::placed(path, &[DAffine3::IDENTITY], setting)
    }

    /// With an instance of the model at each place.
    pub fn placed(path: &Path, places: &[DAffine3], setting: Setting) -> Self {
        Self::edited(&ways(), path, places, setting, |_| ())
    }

    /// In some ways, with an instance of the model at each place, numbered from 0, and what `edit` does to the scene.
    pub fn edited(
        ways: &[(usize, Isa)],
        path: &Path,
        places: &[DAffine3],
        setting: Setting,
        edit: impl Fn(&Scene),
    ) -> Self {
        let way = |&(threads, isa): &(usize, Isa)| {
            let options = ContextOptions {
                threads,
                isa: Some(isa),
                read_ahead: false,
                compact: setting.is_compact,
                ..Default::default()
            };
            let context = Context::new(options).expect("a context");
            let model = Model::open(&context, path).expect("a model");
            assert!(model.load(&Cancel::new()).expect("it loads"));
            let scene = lit(&context, &setting);
            for (id, place) in places.iter().enumerate() {
                scene.add_instance(&model, id as u64, *place).expect("an instance");
            }
            edit(&scene);
            scene.commit().expect("a commit");
            let name = format!("{threads} threads, {}", isa.name());
            Way { name, state: scene.state(), frame: frame(&context, setting.size) }
        };
        Self { ways: ways.iter().map(way).collect(), setting }
    }

    /// Width and height of its pictures.
    pub fn size(&self) -> (u32, u32) {
        self.setting.size
    }

    /// The picture, in all ways.
    pub fn picture(&self, camera: &Camera, poe: f32) -> Picture {
        let picture = self.quick(camera, poe);
        for way in &self.ways[1..] {
            let other = self.render(way, camera, poe);
            let differs = Buffer::ALL.into_iter().find(|b| picture.bytes(*b) != other.bytes(*b));
            assert_eq!(differs, None, "PoE {poe}, {}: another picture than with {}", way.name, self.ways[0].name);
        }
        picture
    }

    /// The picture in one way.
    pub fn quick(&self, camera: &Camera, poe: f32) -> Picture {
        self.render(&self.ways[0], camera, poe)
    }

    /// The exact picture in one way, with `times` pixels for each along each edge.
    pub fn fine(&self, camera: &Camera, times: u32) -> Picture {
        let (way, (width, height)) = (&self.ways[0], self.setting.size);
        way.frame.resize(width * times, height * times).expect("a size");
        let picture = self.render(way, camera, 0.0);
        way.frame.resize(width, height).expect("a size");
        picture
    }

    fn render(&self, way: &Way, camera: &Camera, poe: f32) -> Picture {
        let Setting { samples, ambient, .. } = self.setting;
        way.frame
            .request(&way.state, camera, &FrameSettings { poe, samples, ambient, ..FrameSettings::default() })
            .expect("a request");
        let status = way.frame.wait(LONG);
        assert_eq!((status.state, status.pixels_missing), (FrameState::Converged, 0), "{}", way.name);
        Picture::of(&way.frame)
    }
}

/// A scene of no models yet.
pub fn lit(context: &Context, setting: &Setting) -> Scene {
    let scene = Scene::new(context);
    scene.set_lights(setting.lights.clone()).expect("lights");
    scene.set_background(Background::Colour([0.0; 4])).expect("a background");
    scene
}

pub fn frame(context: &Context, (width, height): (u32, u32)) -> Frame {
    let options = FrameOptions { width, height, outputs: Outputs::ALL, ..Default::default() };
    Frame::new(context, options).expect("a frame")
}

/// All buffers of a picture, by number.
pub struct Picture {
    buffers: Vec<Vec<u8>>,
    pub linear: Vec<f32>,
}

impl Picture {
    /// What a frame shows; nothing in it is a NaN.
    pub fn of(frame: &Frame) -> Self {
        let buffers = Buffer::ALL.map(|b| frame.map(b).expect("a picture").bytes().to_vec()).to_vec();
        for buffer in [Buffer::ColourLinear, Buffer::Depth, Buffer::Normal, Buffer::Error] {
            let numbers = frame.map(buffer).expect("a picture");
            assert!(numbers.floats().expect("floats").iter().all(|x| !x.is_nan()), "a NaN in {buffer:?}");
        }
        let linear = frame.map(Buffer::ColourLinear).expect("a picture").floats().expect("floats").to_vec();
        Self { buffers, linear }
    }

    pub fn bytes(&self, buffer: Buffer) -> &[u8] {
        &self.buffers[buffer as usize]
    }

    /// Of each pixel, the caller's id of the part that it shows; [`outcrop::query::NONE`] of none.
    pub fn parts(&self) -> Vec<u64> {
        let id = |bytes: &[u8]| u64::from_ne_bytes(bytes.try_into().expect("8 bytes"));
        self.bytes(Buffer::Part).chunks_exact(8).map(id).collect()
    }

    pub fn colours(&self) -> Colours<'_> {
        Colours::Linear(&self.linear)
    }

    pub fn coded(&self) -> Colours<'_> {
        Colours::Srgb8(self.bytes(Buffer::ColourSrgb8))
    }

    /// Of each pixel, whether the ray through its middle hits anything.
    pub fn covered(&self) -> impl Iterator<Item = bool> {
        self.bytes(Buffer::Kind).iter().map(|kind| *kind != HitKind::Miss as u8)
    }

    /// Of each pixel, how much of it is covered.
    pub fn coverage(&self) -> impl Iterator<Item = f64> {
        self.linear.chunks_exact(4).map(|p| f64::from(p[3]))
    }

    /// Of each pixel.
    pub fn luminance(&self) -> Vec<f64> {
        (0..self.linear.len() / 4).map(|i| luminance(self.colours().linear(i))).collect()
    }

    /// Pixels that show a stand-in.
    pub fn stand_ins(&self) -> usize {
        self.bytes(Buffer::Kind).iter().filter(|kind| **kind == HitKind::Lod as u8).count()
    }

    /// Pixels that `exact` covers and this does not.
    pub fn holes(&self, exact: &Picture) -> usize {
        self.covered().zip(exact.covered()).filter(|(now, exact)| *exact && !*now).count()
    }
}
