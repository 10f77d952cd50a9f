//! Hidden parts by their colours: the colour of a hidden part, and the former colour of a coloured one, appear in no
//! pixel of any picture, whatever data is missing. Colours also tell of stand-ins that mix several parts.

use crate::common::built::WHITE;
use crate::common::changed::{self, Change};
use crate::common::frames::LONG;
use crate::part_budgets::open;
use glam::DVec3;
use outcrop::base::error::Result;
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::GenerateOptions;
use outcrop::import::{MaterialDesc, MaterialKey, PartDesc, PartKey, Sink};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs, Target};
use outcrop::scene::{Background, Camera, Context, Look, Model, Scene, Scope};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (256, 192);

/// A tenth of the parts is blue, a fiftieth is green, and the others are red.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Class {
    Red,
    Green,
    Blue,
}

const CLASSES: [Class; 3] = [Class::Red, Class::Green, Class::Blue];

impl Class {
    fn of(part: usize) -> Self {
        match part % 50 {
            7 => Self::Green,
            n if n % 10 == 5 => Self::Blue,
            _ => Self::Red,
        }
    }

    fn colour(self) -> [f32; 3] {
        std::array::from_fn(|channel| if channel == self as usize { 1.0 } else { 0.0 })
    }
}

/// Gives each part the material of its class.
#[derive(Default)]
struct Coloured {
    parts: usize,
    materials: Vec<MaterialKey>,
}

impl Change for Coloured {
    fn material(&mut self, _: &mut Builder, _: MaterialDesc) -> Result<MaterialKey> {
        Ok(0)
    }
    fn part(&mut self, to: &mut Builder, part: PartDesc) -> Result<PartKey> {
        if self.parts == 0 {
            for class in CLASSES {
                self.materials.push(to.material(MaterialDesc { colour: class.colour(), ..WHITE })?);
            }
        }
        let class = Class::of(self.parts);
        self.parts += 1;
        to.part(PartDesc { material: Some(self.materials[class as usize]), ..part })
    }
}

fn build(folder: &Path) -> PathBuf {
    let (path, size) =
        (folder.join("coloured.oc"), GenerateOptions { triangles: 200_000, seed: 0, ..Default::default() });
    let options = BuildOptions { threads: 2, ..BuildOptions::default() };
    changed::build(&path, "airliner", &size, options, Coloured::default());
    path
}

/// Counts the pixels of all pictures, as they are rendered, in which each channel appears.
#[derive(Default)]
struct Channels([AtomicUsize; 3]);

impl Target for Channels {
    fn write(&self, _: u32, _: u32, pixels: &[u8]) {
        for pixel in pixels.chunks_exact(16) {
            for (channel, count) in pixel.chunks_exact(4).zip(&self.0) {
                let value = f32::from_le_bytes(channel.try_into().expect("four bytes"));
                count.fetch_add(usize::from(value != 0.0), Relaxed);
            }
        }
    }
}

impl Channels {
    fn counts(&self) -> [usize; 3] {
        self.0.each_ref().map(|count| count.load(Relaxed))
    }
}

/// The colour of a part under looks; `None`: it is hidden.
type Expected<'a> = &'a dyn Fn(Class) -> Option<[f32; 3]>;

/// Requests a picture, and judges each one that is shown: a pixel that shows a part has its colour. Returns the number
/// of pictures, and the number of pixels of each class in them.
fn watch(
    frame: &Frame,
    scene: &Scene,
    camera: &Camera,
    settings: &FrameSettings,
    class_of: &dyn Fn(u64) -> Class,
    expected: Expected,
) -> (u32, [usize; 3]) {
    frame.request(&scene.state(), camera, settings).expect("a request");
    let (begun, mut shown, mut pixels) = (Instant::now(), 0, [0; 3]);
    loop {
        let status = frame.poll();
        let has_ended = status.state != FrameState::Running;
        if status.pictures > shown || has_ended {
            let (colours, parts) = (frame.map(Buffer::ColourLinear), frame.map(Buffer::Part));
            let (colours, parts) = (colours.expect("a picture"), parts.expect("a picture"));
            // Both are of one picture only if no other picture came between.
            let after = frame.poll();
            if (after.pictures, after.state) == (status.pictures, status.state) {
                shown = status.pictures;
                for (part, colour) in parts.ids().expect("ids").iter().zip(colours.floats().expect("floats").chunks(4))
                {
                    if *part == outcrop::query::NONE {
                        assert_eq!(colour[..3], [0.0; 3], "the background");
                        continue;
                    }
                    let class = class_of(*part);
                    let is_its_own = expected(class).is_some_and(|own| is_like(colour, own));
                    assert!(is_its_own, "part {part}, {class:?}: {colour:?} in {status:?}");
                    pixels[class as usize] += 1;
                }
            }
        }
        if has_ended {
            assert!(matches!(status.state, FrameState::Converged | FrameState::CompleteWithinBudget), "{status:?}");
            return (shown, pixels);
        }
        assert!(begun.elapsed() < LONG, "the request does not end: {status:?}");
        frame.wait(Duration::from_millis(1));
    }
}

/// True if both colours have the same channels, up to rounding.
fn is_like(colour: &[f32], own: [f32; 3]) -> bool {
    colour.iter().zip(own).all(|(&a, b)| (a == 0.0) == (b == 0.0) && (a - b).abs() < 1e-4)
}

fn frame(context: &Context, channels: &Arc<Channels>) -> Frame {
    let targets: Vec<(Buffer, Arc<dyn Target>)> = vec![(Buffer::ColourLinear, channels.clone())];
    let outputs = Outputs::of(Buffer::ColourLinear) | Outputs::of(Buffer::Part);
    Frame::new(context, FrameOptions { width: SIZE.0, height: SIZE.1, outputs, targets }).expect("a frame")
}

/// The views: the whole model, two close ones, and one from between its parts.
fn views(model: &Model) -> Vec<Camera> {
    let (own, bounds) = (model.views(), model.info().bounds);
    let centre = (bounds.min + bounds.max) * 0.5;
    let inside = Camera::Perspective { eye: centre, at: centre + DVec3::X, up: DVec3::Z, fov_y_degrees: 80.0 };
    vec![own[0], own[2], own[3], inside]
}

/// Renders all views in small budgets, at once and pane by pane, and judges all pictures.
fn judge(path: &Path, set: &dyn Fn(&Scene, &Model), expected: Expected) {
    let (mut pictures, mut pixels) = (0, [0; 3]);
    let mut ends = HashSet::new();
    for budget in [6 << 20, 10 << 20] {
        let (context, scene, model) = open(path, budget);
        scene.set_lights(vec![]).expect("no lights");
        scene.set_background(Background::Colour([0.0; 4])).expect("black");
        set(&scene, &model);
        scene.commit().expect("a commit");
        let class_of = |id: u64| Class::of(model.part_index(id).expect("a part") as usize);
        let channels = Arc::new(Channels::default());
        for (poe, at_once) in [(0.0, false), (3.0, false), (0.0, true), (3.0, true)] {
            // A frame of its own begins with stand-ins for missing data.
            let frame = frame(&context, &channels);
            for camera in views(&model) {
                let settings = FrameSettings { poe, at_once, ambient: 1.0, ..FrameSettings::default() };
                let (shown, of_classes) = watch(&frame, &scene, &camera, &settings, &class_of, expected);
                pictures += shown;
                (0..3).for_each(|i| pixels[i] += of_classes[i]);
                ends.insert(format!("{:?}", frame.poll().state));
            }
        }
        let counts = channels.counts();
        for class in CLASSES {
            let is_shown = CLASSES.iter().filter_map(|class| expected(*class)).any(|c| c[class as usize] != 0.0);
            assert_eq!(counts[class as usize] > 0, is_shown, "{class:?}: {counts:?}");
        }
    }
    println!("{pictures} pictures, {pixels:?} pixels of each class, ends {ends:?}");
    assert!(pictures > 64 && ends.len() == 2, "{pictures} pictures, {ends:?}");
    let is_seen = |class: &Class| expected(*class).is_some() == (pixels[*class as usize] > 100);
    assert!(CLASSES.iter().all(is_seen), "{pixels:?}");
}

fn ids(model: &Model, class: Class) -> Vec<u64> {
    let of_class = |(i, part): (usize, u64)| (Class::of(i) == class).then_some(part);
    model.parts().iter().map(|part| part.id).enumerate().filter_map(of_class).collect()
}

#[test]
fn no_pixel_of_any_picture_has_the_colour_of_a_hidden_part() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = build(folder.path());
    let dark = [0.25, 0.0, 0.0];
    // A tenth is hidden, and green parts are dark red.
    let set = |scene: &Scene, model: &Model| {
        let hidden = Look { visible: false, ..Look::default() };
        scene.set_parts_look(7, &ids(model, Class::Blue), Scope::Own, hidden).expect("looks");
        let coloured = Look { colour: Some([dark[0], dark[1], dark[2], 1.0]), ..Look::default() };
        scene.set_parts_look(7, &ids(model, Class::Green), Scope::Own, coloured).expect("looks");
    };
    judge(&path, &set, &|class| match class {
        Class::Red => Some([1.0, 0.0, 0.0]),
        Class::Green => Some(dark),
        Class::Blue => None,
    });
    // All parts but a fiftieth are hidden.
    let isolate = |scene: &Scene, model: &Model| {
        scene.isolate_parts(7, &ids(model, Class::Green), Scope::Own).expect("looks");
    };
    judge(&path, &isolate, &|class| (class == Class::Green).then(|| class.colour()));
}
