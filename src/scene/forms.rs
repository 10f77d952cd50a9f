//! The moment at which a model gets its form for exact rays (`structure::resident`). Workers of the context make the
//! form in the background once all geometry of the model is in memory. No call waits for it.
//!
//! Small models get theirs when they are opened. Larger ones get it when they are loaded whole by [`Model::load`], or
//! after [`USES`] jobs for each million of triangles. The budget holds the form beside the blocks; when other data
//! needs the room, the form goes first, and is not made again within [`PAUSE`].

use super::context::LogLevel;
use super::model::{Model, WeakModel};
use crate::base::error::Result;
use crate::base::tasks::Work;
use crate::residency::CompanionRoom;
use crate::structure::{Forms, Made, MakeForms, Visit};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Most triangles of a model that gets its form when it is opened. (A triangle takes 0.13 to 0.36 µs of one core.)
pub(super) const SMALL: u64 = 2_000_000;

/// Jobs for each million of triangles after which a larger model gets its form.
const USES: u64 = 4;

/// Least bytes of a form for each triangle.
const LEAST_BYTES: u64 = 40;

/// Least time between two attempts to make a form.
const PAUSE: Duration = Duration::from_secs(1);

/// The state of a model's form.
#[derive(Default)]
pub(super) struct FormState {
    /// True while a job makes the form.
    is_being_made: AtomicBool,
    /// Jobs that traced the model.
    uses: AtomicU64,
    last_attempt: Mutex<Option<Instant>>,
    /// Bytes of a form that did not fit.
    needs: AtomicU64,
    /// The form that the job makes: it goes with the model, also while no worker runs.
    making: Mutex<Making>,
}

impl FormState {
    /// Counts a use; true if a model of this size was used often enough.
    fn counts_enough(&self, triangles: u64) -> bool {
        let uses = self.uses.fetch_add(1, Relaxed) + 1;
        triangles <= SMALL || uses >= triangles / (1_000_000 / USES)
    }

    /// Notes the bytes of a form that does not fit.
    pub(super) fn refused(&self, bytes: u64) {
        self.needs.store(bytes, Relaxed);
    }

    /// True if the caller may try to make the form now.
    fn may_try(&self) -> bool {
        let mut last = self.last_attempt.lock().unwrap_or_else(PoisonError::into_inner);
        let may = last.is_none_or(|at| at.elapsed() >= PAUSE);
        if may {
            *last = Some(Instant::now());
        }
        may
    }
}

/// The pool belongs to the context, and the model keeps the context: a job that waits must not keep the model.
struct MakeForm {
    model: WeakModel,
    has_more: AtomicBool,
}

/// A form in the making, and the memory for it.
#[derive(Default)]
struct Making {
    forms: MakeForms,
    room: Option<CompanionRoom>,
}

/// Nodes and leaves that a worker adds before it turns to other work: some 0.2 ms.
const STEPS: usize = 512;

impl Work for MakeForm {
    fn run(&self, _: usize) -> Result<()> {
        let Some(model) = self.model.upgrade() else { return Ok(()) };
        let mut making = model.form_state().making.lock().unwrap_or_else(PoisonError::into_inner);
        let step = model.step_form(&mut making);
        let has_more = matches!(step, Ok(None));
        self.has_more.store(has_more, Relaxed);
        if !has_more {
            *making = Making::default();
            model.form_state().is_being_made.store(false, Relaxed);
        }
        // The host's function is called under no lock.
        drop(making);
        if let Err(why) = step {
            // The blocks serve all rays.
            model.context().log(LogLevel::Info, &format!("{}: {why}", model.info().name));
        }
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        Ok(usize::from(self.has_more.swap(false, Relaxed)))
    }
}

impl Model {
    /// Makes the form for exact rays of all trees, if all geometry is in memory and the budget has room beside it. The
    /// form is given back when the room is needed. Returns false if it was not made. Fails with `NoMemory`.
    pub fn make_resident(&self) -> Result<bool> {
        let mut making = Making::default();
        loop {
            if let Some(is_made) = self.step_form(&mut making)? {
                return Ok(is_made);
            }
        }
    }

    /// Goes on to make the form. Returns true once it is there, and false if it cannot be made; `None` if there is more
    /// to do.
    fn step_form(&self, making: &mut Making) -> Result<Option<bool>> {
        let (blocks, there) = (self.blocks(), self.blocks().snapshot());
        if there.companion::<Forms>().is_some() {
            return Ok(Some(true));
        }
        let (trees, isa) = (self.trees(), self.context().isa());
        let tree = |index: usize| trees.get(index).map(|tree| tree.view(&there, isa, Visit::default()));
        match making.forms.go_on(tree, STEPS)? {
            Made::Some => Ok(None),
            Made::Nothing => Ok(Some(false)),
            Made::Measured(bytes) => {
                making.room = blocks.companion_room(bytes);
                if making.room.is_none() {
                    self.form_state().refused(bytes);
                }
                Ok(if making.room.is_some() { None } else { Some(false) })
            }
            Made::All(forms) => {
                let Some(room) = making.room.take() else { return Ok(Some(false)) };
                debug_assert!(forms.bytes() <= room.bytes() + 4096);
                drop(there);
                Ok(Some(blocks.put_companion(Box::new(forms), room)))
            }
        }
    }

    /// Starts to make the form for exact rays in the background, if it pays: for a job that is about to trace the
    /// model.
    #[inline]
    pub(super) fn used(&self) {
        let state = self.form_state();
        if state.counts_enough(self.info().triangles_stored) {
            self.begin_form();
        }
    }

    /// Starts to make the form for exact rays in the background.
    pub(super) fn begin_form(&self) {
        let (state, triangles) = (self.form_state(), self.info().triangles_stored);
        // To measure a form takes a pass over the model: it must have a chance to fit.
        let least = state.needs.load(Relaxed).max(triangles.saturating_mul(LEAST_BYTES));
        let may = !self.context().is_compact()
            && triangles > 0
            && self.blocks().companion_bytes() == 0
            && self.blocks().is_complete()
            && state.may_try()
            && self.blocks().companion_room(least).is_some()
            && !state.is_being_made.swap(true, Relaxed);
        if may {
            let make = MakeForm { model: self.downgrade(), has_more: AtomicBool::new(false) };
            let _ = self.context().pool().submit(1, Arc::new(make));
        }
    }
}
