//! What is hidden stays hidden: a white skin over coloured ribs, flat and as a tube, from outside and from within, with
//! the skin hidden by state, and in first pictures.

use super::pictures::{LONG, Picture, Setting, Stage, frame, lit, ways};
use super::table::judge;
use super::worst::{Exact, Kinds, MEASURES, Worst, listed};
use crate::common::built::{self, Built};
use crate::common::ribs::{self, Ribbed, is_inner, is_skin};
use crate::common::sources::{Gate, OpensAtEnd, meddled};
use glam::DAffine3;
use outcrop::render::{FrameSettings, FrameState};
use outcrop::scene::{Camera, Context, ContextOptions, Look, Model, Scene, Scope};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Pixels of error.
const POE: [f32; 4] = [1.0, 3.0, 10.0, 30.0];
/// Its place among [`MEASURES`].
const SKIN_COLOURED: usize = 1;
/// The greatest share of the skin that is coloured where blocks are missing.
const FIRST_LINE: f64 = 0.12;

fn setting() -> Setting {
    Setting { size: (320, 240), ambient: 0.15, ..Setting::default() }
}

const KINDS: Kinds = Kinds { is_skin: &is_skin, is_inner: &is_inner };
/// From outside few ribs are seen.
const OF_SKIN: [&str; 4] = ["foreign parts", "skin coloured", "skin tinted", "brightness"];

struct Skin {
    file: Built,
    ribbed: Ribbed,
}

impl Skin {
    fn new(ribbed: Ribbed) -> Self {
        let triangles: usize = ribbed.parts.iter().map(|part| part.tris.len()).sum();
        assert!((100_000..200_000).contains(&triangles), "{triangles} triangles");
        Self { file: built::parts(&ribbed.parts), ribbed }
    }

    fn stage(&self, edit: impl Fn(&Scene)) -> Stage {
        Stage::edited(&ways(), &self.file.path, &[DAffine3::IDENTITY], setting(), edit)
    }
}

fn flat() -> &'static Skin {
    static FLAT: OnceLock<Skin> = OnceLock::new();
    FLAT.get_or_init(|| Skin::new(ribs::flat()))
}

fn tube() -> &'static Skin {
    static TUBE: OnceLock<Skin> = OnceLock::new();
    TUBE.get_or_init(|| Skin::new(ribs::tube()))
}

fn check(skin: &Skin, outside: &str, within: &str) {
    let stage = skin.stage(|_| ());
    let [outside, within] = [(outside, &skin.ribbed.outside), (within, &skin.ribbed.within)]
        .map(|(name, cameras)| Worst::of(name, &stage, cameras, KINDS, &POE));
    outside.judge(&OF_SKIN);
    within.judge(&MEASURES);
}

#[test]
fn under_a_flat_skin() {
    check(flat(), "flat skin, outside", "flat skin, within");
}

#[test]
fn under_a_curved_skin() {
    check(tube(), "tube, outside", "tube, within");
}

/// Without the skin, ribs are seen, which are not white.
#[test]
fn with_the_skin_hidden() {
    for (name, skin) in [("flat, skin hidden", flat()), ("tube, skin hidden", tube())] {
        let hidden: Vec<u64> = skin.ribbed.parts.iter().map(|part| part.id).filter(|id| is_skin(*id)).collect();
        let look = Look { visible: false, ..Look::default() };
        let stage = skin.stage(|scene| scene.set_parts_look(0, &hidden, Scope::Own, look).expect("a look"));
        let cameras = [&skin.ribbed.outside[..], &skin.ribbed.within].concat();
        let worst = Worst::of(name, &stage, &cameras, KINDS, &[3.0, 10.0]);
        worst.judge(&["foreign parts", "ribs white", "ribs faded", "brightness"]);
    }
}

/// A scene in a budget: the least that its model opens with, and a quarter of its geometry.
struct Small {
    scene: Scene,
    frame: outcrop::render::Frame,
    is_shut: Arc<AtomicBool>,
    gate: Arc<Gate>,
}

impl Small {
    fn new(path: &Path) -> Self {
        let (is_shut, gate) = (Arc::new(AtomicBool::new(false)), Arc::new(Gate::default()));
        let open = |memory_budget| {
            let options = ContextOptions { threads: 2, memory_budget, read_ahead: false, ..Default::default() };
            let context = Context::new(options).expect("a context");
            let (is_shut, gate) = (Arc::clone(&is_shut), Arc::clone(&gate));
            let source = meddled(path, move |_, _| {
                if is_shut.load(SeqCst) {
                    gate.pass();
                }
                Ok(())
            });
            Model::open_source(&context, source).map(|model| (context, model))
        };
        let geometry = Model::open(&built::context(0), path).expect("it opens").memory().geometry;
        let Err(outcrop::Error::OverBudget { need, .. }) = open(1) else { panic!("it opens with a byte") };
        let (context, model) = open(need + geometry / 4).expect("more than the least");
        let scene = lit(&context, &setting());
        scene.add_instance(&model, 0, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        Self { scene, frame: frame(&context, setting().size), is_shut, gate }
    }

    fn request(&self, camera: &Camera) {
        let settings = FrameSettings { poe: 1.0, at_once: true, ..FrameSettings::default() };
        self.frame.request(&self.scene.state(), camera, &settings).expect("a request");
    }
}

#[test]
fn in_first_pictures() {
    for (name, skin) in [("flat, first pictures", flat()), ("tube, first pictures", tube())] {
        let stage = skin.stage(|_| ());
        let exact: Vec<Exact> = skin.ribbed.outside.iter().map(|camera| Exact::of(&stage, camera, KINDS)).collect();
        let (mut worst, mut lacking) = ([0.0f64; 2], 0);
        for (i, camera) in skin.ribbed.outside.iter().enumerate() {
            let small = Small::new(&skin.file.path);
            small.request(camera);
            let status = small.frame.wait(LONG);
            assert_eq!(status.state, FrameState::CompleteWithinBudget, "all fits: the cache is not small");
            let values = exact[i].measure(&Picture::of(&small.frame));
            println!("{name}, view {i}: {}, PoE {} within the budget", listed(&values), status.effective_poe);
            // The next view, of which nothing is read.
            small.is_shut.store(true, SeqCst);
            let _open = OpensAtEnd(Arc::clone(&small.gate));
            let next = (i + 1) % exact.len();
            small.request(&skin.ribbed.outside[next]);
            let status = loop {
                let status = small.frame.wait(Duration::from_millis(1));
                if status.pictures > 0 {
                    break status;
                }
            };
            let next_values = exact[next].measure(&Picture::of(&small.frame));
            let missing = status.pixels_missing;
            println!("{name}, view {next} after {i}: {}, {missing} pixels lack blocks", listed(&next_values));
            lacking += missing;
            for (worst, values) in worst.iter_mut().zip([values, next_values]) {
                *worst = worst.max(values[SKIN_COLOURED].expect("the skin is seen"));
            }
        }
        assert!(lacking > 1000, "nothing is missing: {lacking} pixels");
        for (measure, worst) in ["skin coloured", "skin coloured after a jump"].into_iter().zip(worst) {
            judge(&format!("{name}: {measure}"), &[(1.0, worst, FIRST_LINE)]);
        }
    }
}
