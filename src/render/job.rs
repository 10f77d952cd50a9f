//! One request of a frame as a job: tiles in rounds. A tile that lacks a block is rendered again once the
//! block is there; the film sees it only when it is whole.

use super::film::{Buffer, Film};
use super::frame::FrameSettings;
use super::integrators::direct::{Direct, Scratch};
use super::tile::{Tally, TilePixels, tiles_from_the_middle};
use crate::base::error::Result;
use crate::base::tasks::{Ending, Work};
use crate::math::srgb::Srgb;
use crate::scene::SceneState;
use crate::scene::camera::PixelRays;
use crate::scene::walk::{Hold, Need, SceneView, Snapshots, fetch, take_holding};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Instant;

/// Told when a request has ended.
pub(super) trait Owner: Send + Sync {
    /// `request` has ended with `film`; called once, under no lock.
    fn ended(&self, request: &Request, film: Film, ending: &Ending);
}

/// A request being rendered.
pub(super) struct Request {
    pub number: u64,
    pub scene: Arc<SceneState>,
    pub rays: PixelRays,
    pub settings: FrameSettings,
    pub begun: Instant,
    pub pixels: u64,
    pub size: (u32, u32),
    owner: Weak<dyn Owner>,
    srgb: Arc<Srgb>,
    /// Taken when the job ends.
    film: Mutex<Option<Arc<Film>>>,
    stop: AtomicBool,
    pixels_done: AtomicU64,
    rounds: Mutex<Rounds>,
}

struct Rounds {
    snapshots: Arc<Snapshots>,
    hold: Hold,
    /// Of the present round.
    tiles: Arc<Vec<(u32, u32)>>,
    /// To be rendered again.
    again: Vec<(u32, u32)>,
    needs: Vec<Need>,
    wanted: u64,
    tally: Tally,
    free: Vec<Box<Desk>>,
}

/// What a worker needs for a tile.
struct Desk {
    pixels: TilePixels,
    scratch: Scratch,
}

/// What a request is made of.
pub(super) struct Asked {
    pub number: u64,
    pub scene: Arc<SceneState>,
    pub rays: PixelRays,
    pub settings: FrameSettings,
    pub film: Film,
    pub srgb: Arc<Srgb>,
    pub owner: Weak<dyn Owner>,
}

impl Request {
    pub fn new(asked: Asked) -> Self {
        let Asked { number, scene, rays, settings, film, srgb, owner } = asked;
        let tiles = tiles_from_the_middle(film.width, film.height);
        let rounds = Rounds {
            snapshots: Arc::new(Snapshots::take(&scene)),
            hold: Hold::default(),
            tiles: Arc::new(tiles),
            again: Vec::new(),
            needs: Vec::new(),
            wanted: 0,
            tally: Tally::default(),
            free: Vec::new(),
        };
        Self {
            number,
            scene,
            rays,
            settings,
            begun: Instant::now(),
            size: (film.width, film.height),
            pixels: u64::from(film.width) * u64::from(film.height),
            owner,
            srgb,
            film: Mutex::new(Some(Arc::new(film))),
            stop: AtomicBool::new(false),
            pixels_done: AtomicU64::new(0),
            rounds: Mutex::new(rounds),
        }
    }

    /// Tiles of the first round.
    pub fn items(&self) -> usize {
        self.rounds().tiles.len()
    }

    /// Makes tiles in flight end within a packet.
    pub fn stop(&self) {
        self.stop.store(true, Relaxed);
    }

    /// Pixels of finished tiles.
    pub fn pixels_done(&self) -> u64 {
        self.pixels_done.load(Relaxed)
    }

    /// What finished tiles add up to, and the bytes of blocks now being waited for.
    pub fn tally(&self) -> (Tally, u64) {
        let rounds = self.rounds();
        (rounds.tally, rounds.wanted)
    }

    fn rounds(&self) -> MutexGuard<'_, Rounds> {
        self.rounds.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn film(&self) -> Option<Arc<Film>> {
        self.film.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn bytes_of(&self, needs: &[Need]) -> u64 {
        let bytes = |n: &Need| self.scene.models[n.model as usize].blocks().file().decoded_len(n.block);
        needs.iter().map(|n| u64::from(bytes(n))).sum()
    }
}

impl Work for Request {
    fn run(&self, item: usize) -> Result<()> {
        let Some(film) = self.film() else { return Ok(()) };
        let (tiles, snapshots, desk) = {
            let mut rounds = self.rounds();
            (Arc::clone(&rounds.tiles), Arc::clone(&rounds.snapshots), rounds.free.pop())
        };
        let tile = tiles[item];
        let mut desk =
            desk.unwrap_or_else(|| Box::new(Desk { pixels: TilePixels::new(), scratch: Scratch::new() }));
        let direct = Direct {
            view: SceneView { scene: &self.scene, snapshots: &snapshots, never_waits: false },
            rays: &self.rays,
            size: (film.width, film.height),
            samples: self.settings.samples,
            ambient: self.settings.ambient,
            poe: self.settings.poe,
            srgb: &self.srgb,
            prims: film.wants(Buffer::Primitive),
        };
        let mut needs = Vec::new();
        let stop = || self.stop.load(Relaxed);
        let Desk { pixels, scratch } = &mut *desk;
        let tally = pixels.render(&direct, tile, &self.srgb, scratch, &mut needs, stop);
        let whole = needs.is_empty();
        if let (Some(_), true) = (&tally, whole) {
            film.take(tile.0, tile.1, pixels);
            let pixels = u64::from(pixels.width) * u64::from(pixels.height);
            self.pixels_done.fetch_add(pixels, Relaxed);
        }
        let mut rounds = self.rounds();
        match tally {
            Some(tally) if whole => rounds.tally.add(&tally),
            Some(_) => {
                rounds.needs.append(&mut needs);
                rounds.again.push(tile);
            }
            None => {}
        }
        rounds.free.push(desk);
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        let mut needs = std::mem::take(&mut self.rounds().needs);
        if needs.is_empty() {
            return Ok(0);
        }
        needs.sort_unstable();
        needs.dedup();
        let mut hold = {
            let mut rounds = self.rounds();
            rounds.wanted = self.bytes_of(&needs);
            rounds.snapshots = Arc::new(Snapshots::none());
            std::mem::take(&mut rounds.hold)
        };
        fetch(&self.scene, needs, &mut hold)?;
        let mut rounds = self.rounds();
        rounds.wanted = 0;
        rounds.snapshots = Arc::new(take_holding(&self.scene, &hold)?);
        rounds.hold = hold;
        rounds.tiles = Arc::new(std::mem::take(&mut rounds.again));
        Ok(rounds.tiles.len())
    }

    fn ended(&self, ending: &Ending) {
        let film = self.film.lock().unwrap_or_else(PoisonError::into_inner).take();
        // No tile is in flight any more: the film is ours alone.
        let film = film.and_then(|f| Arc::try_unwrap(f).ok());
        self.rounds().free.clear();
        // Stopped before it was a job to be cancelled: its tiles were passed over.
        let cut_short = matches!(ending, Ending::Finished) && self.pixels_done() < self.pixels;
        let ending = if cut_short { &Ending::Cancelled } else { ending };
        if let (Some(owner), Some(film)) = (self.owner.upgrade(), film) {
            owner.ended(self, film, ending);
        }
    }
}
