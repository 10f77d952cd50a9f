//! outcrop's side.

use crate::common::sources;
use crate::data::Residency;
use crate::failure::Failure;
use crate::rays::Batch;
use crate::scenes::Scene;
use crate::sides::{Answer, CHUNK, Run, deal};
use glam::DAffine3;
use outcrop::base::progress::Cancel;
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::scene::{Camera, Context, ContextOptions, Model, Scene as OurScene, SceneState};
use std::path::PathBuf;
use std::sync::Arc;

/// What peers tell of a hit too.
const WANT: Want = Want(Want::NORMAL.0 | Want::UV.0 | Want::PART.0);

/// The file of a model, and the places of the model in its scene.
pub struct ModelAt {
    pub path: PathBuf,
    pub places: Vec<DAffine3>,
}

impl ModelAt {
    /// Placed once, at the origin.
    pub fn once(path: PathBuf) -> Self {
        Self { path, places: vec![DAffine3::IDENTITY] }
    }
}

/// An opened model in a scene of its own.
pub struct Ours {
    pub context: Context,
    pub model: Model,
    pub state: Arc<SceneState>,
}

impl Ours {
    /// Opens the model, brings into memory as much of it as `residency` says, and places it.
    pub fn open(stored: &ModelAt, residency: Residency, threads: usize) -> Result<Self, Failure> {
        let path = &stored.path;
        let memory_budget = if let Residency::Budget(bytes) = residency { bytes } else { 0 };
        let options = ContextOptions { threads, memory_budget, read_ahead: false, ..ContextOptions::default() };
        let context = Context::new(options)?;
        let model =
            if residency == Residency::Cold { Model::open_cold(&context, path)? } else { Model::open(&context, path)? };
        if residency == Residency::All && !model.load(&Cancel::new())? {
            return Err(Failure::new(format!("{}: it does not fit this machine's memory", path.display())));
        }
        // What a context does when nothing is asked of it.
        while context.step() {}
        Self::with(context, model, &stored.places)
    }

    pub fn with(context: Context, model: Model, places: &[DAffine3]) -> Result<Self, Failure> {
        let scene = OurScene::new(&context);
        for (&place, id) in places.iter().zip(1..) {
            scene.add_instance(&model, id, place)?;
        }
        scene.commit()?;
        Ok(Self { state: scene.state(), context, model })
    }

    pub fn camera(&self, scene: &Scene, view: usize) -> Camera {
        scene.row.camera(&self.model.views(), view)
    }

    /// All that is known of each hit; of any hits only their kind.
    pub fn hits(&self, rays: &[Ray], batch: &Batch) -> Result<Vec<Hit>, Failure> {
        self.wanted(rays, batch, Want::ALL)
    }

    /// What is asked of each where time is taken, all in one call.
    pub fn asked_as_timed(&self, rays: &[Ray], batch: &Batch) -> Result<Vec<Hit>, Failure> {
        self.wanted(rays, batch, WANT)
    }

    fn wanted(&self, rays: &[Ray], batch: &Batch, want: Want) -> Result<Vec<Hit>, Failure> {
        let mut hits = vec![Hit::MISS; rays.len()];
        let options = QueryOptions { coherent: batch.is_coherent(), want, ..QueryOptions::default() };
        if batch.is_any() {
            let mut met = vec![0u8; rays.len()];
            self.state.any(rays, options, &mut met)?;
            hits.iter_mut().zip(met).filter(|(_, met)| *met != 0).for_each(|(hit, _)| *hit = SHADOWED);
        } else {
            self.state.closest(rays, options, &mut hits)?;
        }
        Ok(hits)
    }
}

const SHADOWED: Hit = Hit { t: 0.0, kind: HitKind::Exact, ..Hit::MISS };

/// As all sides tell hits.
pub fn answers(hits: &[Hit]) -> Vec<Answer> {
    hits.iter().map(|hit| Answer { t: hit.t }).collect()
}

/// Bytes of the blocks that rays visit in a model with none in memory.
pub fn working_set(stored: &ModelAt, rays: &[Ray], batch: &Batch) -> Result<u64, Failure> {
    let cold = Ours::open(stored, Residency::Cold, 0)?;
    let options = QueryOptions { coherent: batch.is_coherent(), want: WANT, ..QueryOptions::default() };
    if batch.is_any() {
        cold.state.any(rays, options, &mut vec![0; rays.len()])?;
    } else {
        cold.state.closest(rays, options, &mut vec![Hit::MISS; rays.len()])?;
    }
    Ok(cold.model.memory().resident)
}

/// Rays that outcrop traces; a cold model is opened anew for each run, which counts.
pub struct Ready<'a> {
    ours: &'a Ours,
    cold: Option<&'a ModelAt>,
    is_any: bool,
    is_coherent: bool,
    /// Rays a call.
    asked: usize,
    rays: Vec<Ray>,
    answers: Vec<Answer>,
}

impl<'a> Ready<'a> {
    pub fn new(
        ours: &'a Ours,
        stored: &'a ModelAt,
        residency: Residency,
        batch: &Batch,
        asked: usize,
        rays: Vec<Ray>,
    ) -> Self {
        let cold = (residency == Residency::Cold).then_some(stored);
        let (is_any, is_coherent) = (batch.is_any(), batch.is_coherent());
        Self { ours, cold, is_any, is_coherent, asked, answers: vec![Answer::MISS; rays.len()], rays }
    }
}

/// What a thread keeps between chunks.
struct Room {
    hits: Vec<Hit>,
    met: Vec<u8>,
}

impl Run for Ready<'_> {
    fn prepare(&mut self) {
        if self.cold.is_some() {
            sources::forget_files();
        }
    }

    fn run(&mut self, threads: usize) -> f64 {
        let opened = self.cold.map(|stored| Ours::open(stored, Residency::Cold, threads).expect("it opened before"));
        let state = &opened.as_ref().unwrap_or(self.ours).state;
        let (is_any, is_coherent) = (self.is_any, self.is_coherent);
        let options = QueryOptions { coherent: is_coherent, want: WANT, ..QueryOptions::default() };
        let asked = self.asked;
        let chunks = self.rays.chunks(CHUNK).zip(self.answers.chunks_mut(CHUNK));
        let room = || Room { hits: vec![Hit::MISS; asked], met: vec![0; asked] };
        let ask = |room: &mut Room, (rays, answers): (&[Ray], &mut [Answer])| -> f64 {
            if is_any {
                let met = &mut room.met[..rays.len()];
                state.any(rays, options, met).expect("the file was read before");
                answers.iter_mut().zip(&*met).for_each(|(a, met)| a.t = if *met != 0 { 0.0 } else { f64::INFINITY });
                return met.iter().map(|met| f64::from(*met)).sum();
            }
            let hits = &mut room.hits[..rays.len()];
            state.closest(rays, options, hits).expect("the file was read before");
            rays.iter()
                .zip(&*hits)
                .zip(answers)
                .map(|((ray, hit), answer)| {
                    answer.t = hit.t;
                    if hit.kind != HitKind::Miss { f64::from(hit.normal.dot(ray.dir).abs()) } else { 0.0 }
                })
                .sum()
        };
        deal(threads, chunks, room, |room, (rays, answers)| {
            rays.chunks(asked).zip(answers.chunks_mut(asked)).map(|call| ask(room, call)).sum()
        })
    }

    fn answers(&self) -> Vec<Answer> {
        self.answers.clone()
    }
}
