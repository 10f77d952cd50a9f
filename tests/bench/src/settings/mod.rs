//! Pictures of a scene in each setting alone and in all together, beside Embree, which traces the same rays and shades
//! alike (`embree.rs`). Both work in the calling thread, in whose CPU time they are measured.

mod coloured;
mod embree;
mod places;
mod table;

use crate::data::{Residency, StructureRow};
use crate::expected::Expected;
use crate::failure::Failure;
use crate::ours::{ModelAt, Ours};
use crate::pairs::{Clock, Pairs, Spread, steady};
use crate::peers::embree_calls::{Options, Scene as Embree};
use crate::placed::{Place, Placed as Meshes};
use crate::record::{Against, Outcomes, Record, Setting as Measured};
use crate::scenes::{Mesh, Scene, builder};
use crate::trace::Task;
use coloured::Coloured;
use embree::{Lamp, Material, Picture, Rays, Renderer};
use glam::DVec3;
use outcrop::import::Sink;
use outcrop::import::collect::Collector;
use outcrop::math::srgb::Srgb;
use outcrop::scene::{Background, Camera, Light, LightKind, Look, Scene as OurScene, SceneState};
use outcrop::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use places::{Placed, Placing};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
pub use table::table;

/// A setting of a picture: what differs from a headlight picture of colours alone.
#[derive(Debug, Clone, Copy)]
struct Setting {
    name: &'static str,
    /// Beside the colour.
    buffers: &'static [Buffer],
    lamps: &'static [Kind],
    placing: Placing,
    is_parallel: bool,
    is_see_through: bool,
    has_colours: bool,
}

/// A kind of light; all but the first cast shadows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Head,
    Sun,
    Point,
}

const BASE: Setting = Setting {
    name: "headlight",
    buffers: &[],
    lamps: &[Kind::Head],
    placing: Placing::Once,
    is_parallel: false,
    is_see_through: false,
    has_colours: false,
};

const fn with(name: &'static str, buffers: &'static [Buffer]) -> Setting {
    Setting { name, buffers, ..BASE }
}

/// The base first; settings of one placing one after the other.
const ALL: [Setting; 16] = [
    BASE,
    with("depth", &[Buffer::Depth]),
    with("normal", &[Buffer::Normal]),
    with("ids", &[Buffer::Part, Buffer::Instance]),
    with("primitive", &[Buffer::Primitive]),
    with("error+kind", &[Buffer::Error, Buffer::Kind]),
    Setting { name: "sun", lamps: &[Kind::Sun], ..BASE },
    Setting { name: "point", lamps: &[Kind::Point], ..BASE },
    Setting { name: "orthographic", is_parallel: true, ..BASE },
    Setting { name: "transparent", is_see_through: true, ..BASE },
    Setting { name: "triangle colours", has_colours: true, ..BASE },
    Setting { name: "turned", placing: Placing::Turned, ..BASE },
    Setting { name: "mirrored", placing: Placing::Mirrored, ..BASE },
    Setting { name: "far second instance", placing: Placing::Far, ..BASE },
    Setting { name: "many instances", placing: Placing::Grid, ..BASE },
    Setting {
        name: "all",
        buffers: &[
            Buffer::Depth,
            Buffer::Normal,
            Buffer::Part,
            Buffer::Instance,
            Buffer::Primitive,
            Buffer::Error,
            Buffer::Kind,
        ],
        lamps: &[Kind::Head, Kind::Sun, Kind::Point],
        placing: Placing::All,
        is_parallel: true,
        is_see_through: true,
        has_colours: true,
    },
];

const BACKGROUND: [f32; 4] = [0.2, 0.25, 0.3, 1.0];

/// Opacity of a third of the parts, in the settings with transparent ones.
const OPACITY: f32 = 0.5;

/// Length of a wave of triangles' colours, in the size of the model.
const WAVE: f64 = 0.2;

/// Relative difference of depths from which a pixel differs.
const DIFFERS: f32 = 1e-3;

/// Embree's qualities; the faster one counts, setting by setting.
const QUALITIES: [(&str, i32); 2] = [("medium", 1), ("high", 2)];

/// A setting on a scene: what is seen, and how.
struct Case {
    setting: Setting,
    placed: Placed,
    camera: Camera,
    /// Of the light casting kinds: direction to the sun, and the point.
    to_sun: DVec3,
    point: DVec3,
    /// Of the point light, at distance 1.
    strength: f64,
}

/// All settings on the scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let mut records = Vec::new();
    let (structure, view) = (task.benchmark.structures[0].clone(), task.benchmark.views[0]);
    let row = task.data.structure(&structure);
    let plain = Ours::open(&task.scene.model(row)?, Residency::All, 0)?;
    let memory = plain.model.memory();
    let (name, mb) = (&task.scene.row.name, |bytes: u64| bytes as f64 / 1e6);
    eprintln!(
        "{name}: blocks {:.1} MB, the form for exact rays {:.1} MB",
        mb(memory.geometry),
        mb(memory.resident_form)
    );
    let size = plain.model.info().bounds.extent().length();
    let coloured = Ours::open(&coloured_model(task.scene, row, WAVE * size)?, Residency::All, 0)?;
    let mut input = Collector::new();
    task.scene.fill(&mut Coloured { to: &mut input, wave: WAVE * size })?;
    let mesh = Arc::new(Mesh::of(input.placed().map(|t| (t.part, t.positions))));
    let colours: Vec<[f32; 3]> = input.placed().filter_map(|t| t.colour()).collect();
    drop(input);
    let mut embrees: Option<(Placing, Vec<Embree>)> = None;
    let mut base = None;
    for setting in ALL {
        let ours = if setting.has_colours { &coloured } else { &plain };
        let case = Case::of(setting, ours, task.scene, view)?;
        let id = format!("{}/{}/{structure}/view {view}/{}", task.benchmark.name, task.scene.row.name, setting.name);
        let state = case.state(ours)?;
        let (depths, hits) = case.look(task, &id, ours, &state)?;
        if task.is_only_expecting {
            continue;
        }
        if embrees.as_ref().is_none_or(|(placing, _)| *placing != setting.placing) {
            embrees = Some((setting.placing, peers(task, &mesh, &case.placed, setting.placing)));
        }
        let theirs = embrees.as_ref().map_or(&[][..], |(_, scenes)| scenes);
        let look = case.embree_look(ours, &mesh, &colours);
        let measured = case.timed(task, ours, &state, theirs, &look, &depths)?;
        let base = *base.get_or_insert(measured.seconds.least);
        let measured = Measured { of_headlight: measured.seconds.least / base, hits, view, ..measured };
        eprintln!("{id}: {}", table::line(&measured));
        let triangles = ours.model.info().triangles_in;
        records.push(task.record(id, triangles, Outcomes::Settings(measured)));
    }
    Ok(records)
}

/// The model with colours of triangles.
fn coloured_model(scene: &Scene, structure: &StructureRow, wave: f64) -> Result<ModelAt, Failure> {
    let name = format!("{} coloured", structure.name);
    let build = |to: &Path| {
        let mut builder = builder(structure, 0)?;
        scene.fill(&mut Coloured { to: &mut builder as &mut dyn Sink, wave })?;
        builder.finish(to)?;
        Ok(())
    };
    Ok(ModelAt::once(scene.kept(structure, &name, &build)?))
}

/// Embree's scenes, of one level where the model is placed once as it is.
fn peers(task: &Task, mesh: &Arc<Mesh>, placed: &Placed, placing: Placing) -> Vec<Embree> {
    if !task.benchmark.peers.iter().any(|peer| peer == "embree") {
        return Vec::new();
    }
    let built = QUALITIES.map(|(_, quality)| {
        let options = Options { quality, is_compact: false, threads: 0 };
        if placing == Placing::Once {
            return Embree::new(mesh, options);
        }
        let places = placed.places.iter().map(|&world_from_mesh| Place { mesh: 0, world_from_mesh }).collect();
        Embree::of_placed(&Meshes { meshes: vec![Arc::clone(mesh)], places }, options)
    });
    let is_missing = |why: String| eprintln!("skipped: Embree ({why}; Debian's package is libembree-dev)");
    built.into_iter().collect::<Result<_, _>>().map_err(is_missing).unwrap_or_default()
}

impl Case {
    fn of(setting: Setting, ours: &Ours, scene: &Scene, view: usize) -> Result<Self, Failure> {
        let bounds = ours.model.info().bounds;
        let (seen, outside) = (ours.camera(scene, view), ours.model.views()[0]);
        let is_within = view == 0 && scene.row.view.is_some();
        let placed = setting.placing.of(&bounds, &seen, &outside)?;
        let is_outside = !is_within || matches!(setting.placing, Placing::Grid | Placing::All);
        let camera = match setting.is_parallel {
            true => places::parallel(&placed.camera, &bounds, !is_outside),
            false => placed.camera,
        };
        let Camera::Perspective { eye, at, up, .. } = placed.camera else {
            return Err(Failure::new("settings start from perspective views"));
        };
        let (way, up) = (at - eye, up.normalize());
        let right = way.cross(up).normalize();
        // Over the left shoulder; within a model between eye and target, a little higher.
        let to_sun = (0.6 * up - 0.5 * right - 0.6 * way.normalize()).normalize();
        let point =
            if is_outside { eye + (0.4 * up - 0.3 * right) * way.length() } else { eye + 0.35 * way + 0.8 * up };
        let strength = (if is_outside { at } else { eye + 0.7 * way }).distance_squared(point);
        Ok(Self { setting, placed, camera, to_sun, point, strength })
    }

    /// outcrop's scene.
    fn state(&self, ours: &Ours) -> Result<Arc<SceneState>, Failure> {
        let scene = OurScene::new(&ours.context);
        let white = Light { shadows: true, ..Light::HEADLIGHT };
        let lights = self.setting.lamps.iter().map(|lamp| match lamp {
            Kind::Head => Light::HEADLIGHT,
            Kind::Sun => Light { kind: LightKind::Directional(-self.to_sun), ..white },
            Kind::Point => Light { kind: LightKind::Point(self.point), intensity: self.strength as f32, ..white },
        });
        scene.set_lights(lights.collect())?;
        scene.set_background(Background::Colour(BACKGROUND))?;
        for (&place, id) in self.placed.places.iter().zip(1..) {
            scene.add_instance(&ours.model, id, place)?;
            if self.setting.is_see_through {
                for part in ours.model.parts().iter().step_by(3) {
                    let [red, green, blue, _] = part.colour;
                    let look = Look { colour: Some([red, green, blue, OPACITY]), ..Look::default() };
                    scene.set_part_look(id, part.id, look)?;
                }
            }
        }
        scene.commit()?;
        // What a context does when nothing is asked of it.
        while ours.context.step() {}
        Ok(scene.state())
    }

    fn outputs(&self) -> Outputs {
        self.setting.buffers.iter().fold(Outputs::COLOUR, |all, buffer| all | Outputs::of(*buffer))
    }

    fn frame(ours: &Ours, (width, height): (u32, u32), outputs: Outputs) -> Result<Frame, Failure> {
        Ok(Frame::new(&ours.context, FrameOptions { width, height, outputs, ..FrameOptions::default() })?)
    }

    fn render(&self, frame: &Frame, state: &Arc<SceneState>) -> Result<(), Failure> {
        frame.request(state, &self.camera, &FrameSettings::default())?;
        let status = frame.wait(Duration::from_secs(600));
        match status.state {
            FrameState::Converged => Ok(()),
            _ => Err(Failure::new(format!("a picture does not converge: {status:?}"))),
        }
    }

    /// Compares a picture with what is expected of it. Returns its depths, and how many pixels have one.
    fn look(
        &self,
        task: &mut Task,
        id: &str,
        ours: &Ours,
        state: &Arc<SceneState>,
    ) -> Result<(Vec<f32>, usize), Failure> {
        let alone = Self::frame(ours, task.benchmark.size, self.outputs())?;
        self.render(&alone, state)?;
        let frame = Self::frame(ours, task.benchmark.size, self.outputs() | Outputs::of(Buffer::Depth))?;
        self.render(&frame, state)?;
        let colours = alone.map(Buffer::ColourSrgb8)?.bytes().to_vec();
        let beside = frame.map(Buffer::ColourSrgb8)?.bytes().to_vec();
        let others = colours.chunks_exact(4).zip(beside.chunks_exact(4)).filter(|(a, b)| a != b).count();
        if others > 0 {
            let most = colours.iter().zip(&beside).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
            eprintln!("{id}: {others} pixels have other colours where depths are asked for, by up to {most} levels");
        }
        let depths = frame.map(Buffer::Depth)?;
        let mut bytes = colours;
        bytes.extend(depths.bytes());
        for buffer in self.setting.buffers {
            bytes.extend(frame.map(*buffer)?.bytes());
        }
        let depths = depths.floats().ok_or_else(|| Failure::new("depths are floats"))?.to_vec();
        let hits = depths.iter().filter(|depth| depth.is_finite()).count();
        task.book.check(id, Expected::of_bytes(hits, &bytes))?;
        Ok((depths, hits))
    }

    fn embree_look(&self, ours: &Ours, mesh: &Mesh, colours: &[[f32; 3]]) -> embree::Look {
        let parts = ours.model.parts();
        let material = |i: usize, part: outcrop::scene::PartInfo| {
            let is_clear = self.setting.is_see_through && i.is_multiple_of(3);
            let [red, green, blue, own] = part.colour;
            let colour = [red, green, blue, if is_clear { OPACITY } else { own }];
            Material::new(colour, part.metalness, part.roughness, !is_clear)
        };
        let lamp = |kind: &Kind| match kind {
            Kind::Head => Lamp::Head,
            Kind::Sun => Lamp::Sun(self.to_sun.as_vec3(), 1.0),
            Kind::Point => Lamp::Point(self.point.as_vec3(), self.strength as f32),
        };
        let is_instanced = self.setting.placing != Placing::Once;
        embree::Look {
            parts: mesh.parts.clone(),
            colours: if self.setting.has_colours { colours.to_vec() } else { Vec::new() },
            materials: parts.iter().enumerate().map(|(i, part)| material(i, part)).collect(),
            turns: if is_instanced { embree::Look::turns_of(&self.placed.places) } else { Vec::new() },
            ids: parts.iter().map(|part| part.id).collect(),
            lamps: self.setting.lamps.iter().map(lamp).collect(),
            ambient: FrameSettings::default().ambient,
            background: BACKGROUND,
            size: self.placed.size as f32,
        }
    }

    fn timed(
        &self,
        task: &Task,
        ours: &Ours,
        state: &Arc<SceneState>,
        theirs: &[Embree],
        look: &embree::Look,
        depths: &[f32],
    ) -> Result<Measured, Failure> {
        let (size, rounds) = (task.benchmark.size, task.benchmark.rounds);
        let frame = Self::frame(ours, size, self.outputs())?;
        let seconds = |work: &mut dyn FnMut()| {
            let begun = Clock::Thread.now();
            work();
            Clock::Thread.now() - begun
        };
        let mut mine = || steady(|| seconds(&mut || self.render(&frame, state).expect("it did before")));
        let camera = Rays::of(&self.camera, size);
        let mut picture = Picture::new(size, self.outputs());
        let mut render = |scene: &Embree| {
            let renderer = Renderer { scene, look, srgb: Srgb::new() };
            seconds(&mut || renderer.render(&camera, std::hint::black_box(&mut picture)))
        };
        let mut fastest = None::<(f64, usize)>;
        for (i, scene) in theirs.iter().enumerate() {
            let took = render(scene).min(render(scene));
            if fastest.is_none_or(|(least, _)| took < least) {
                fastest = Some((took, i));
            }
        }
        let Some((_, best)) = fastest else {
            mine();
            let seconds = Spread::of(&(0..rounds).map(|_| mine()).collect::<Vec<_>>());
            return Ok(Measured { setting: self.setting.name.into(), seconds, ..Measured::default() });
        };
        let scene = &theirs[best];
        let pairs = Pairs::in_turn(rounds, &mut mine, || steady(|| render(scene)));
        let call = format!("Embree {}, {}, 16 a call", scene.version(), QUALITIES[best].0);
        let against = Against { side: "embree".into(), call, seconds: Spread::of(&pairs.b), ratio: pairs.ratio() };
        let mut seen = Picture::new(size, Outputs::COLOUR | Outputs::of(Buffer::Depth));
        Renderer { scene, look, srgb: Srgb::new() }.render(&camera, &mut seen);
        Ok(Measured {
            setting: self.setting.name.into(),
            seconds: Spread::of(&pairs.a),
            against: Some(against),
            differ: Some(differing(depths, &seen.depths)),
            levels: Some(levels(&self.colours(&frame)?, &seen.colours)),
            ..Measured::default()
        })
    }

    fn colours(&self, frame: &Frame) -> Result<Vec<u8>, Failure> {
        Ok(frame.map(Buffer::ColourSrgb8)?.bytes().to_vec())
    }
}

/// Share of pixels that hit only in one of both, or whose depths differ.
fn differing(mine: &[f32], theirs: &[f32]) -> f64 {
    let differs = |(a, b): &(&f32, &f32)| match (a.is_finite(), b.is_finite()) {
        (true, true) => (*a - *b).abs() > DIFFERS * a.abs().max(b.abs()),
        (a, b) => a != b,
    };
    mine.iter().zip(theirs).filter(differs).count() as f64 / mine.len() as f64
}

/// Mean difference of colours, in levels of 255.
fn levels(mine: &[u8], theirs: &[[u8; 4]]) -> f64 {
    let apart: u64 = mine.iter().zip(theirs.as_flattened()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    apart as f64 / mine.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_have_names_of_their_own_and_pixels_differ_where_they_do() {
        let mut names: Vec<&str> = ALL.iter().map(|setting| setting.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!((names.len(), ALL[0].name), (ALL.len(), "headlight"));
        let far = f32::INFINITY;
        assert_eq!(differing(&[1.0, 1.0, far, far], &[1.0005, 1.01, far, 2.0]), 0.5);
        assert_eq!(levels(&[1, 2, 3, 4], &[[2, 2, 3, 1]]), 1.0);
    }
}
