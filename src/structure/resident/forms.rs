//! The resident forms of all trees of a model, made some at a time.

use super::WHAT;
use super::build::{Make, Size, Stopped};
use super::layout::Resident;
use crate::base::error::Result;
use crate::base::memory::room;
use crate::structure::tree::Tree;

/// The resident forms of the trees of a model, in the order of the file's table. Some trees may have none.
#[derive(Debug)]
pub struct Forms(Vec<Option<Resident>>);

impl Forms {
    /// The form of a tree.
    #[inline(always)]
    pub fn of(&self, tree: u32) -> Option<&Resident> {
        self.0.get(tree as usize)?.as_ref()
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let forms: u64 = self.0.iter().flatten().map(Resident::bytes).sum();
        forms + (self.0.capacity() * size_of::<Option<Resident>>()) as u64
    }
}

/// The state of [`MakeForms`].
pub enum Made {
    /// There is more to do.
    Some,
    /// All forms are measured: they take so many bytes. The caller goes on if it has them.
    Measured(u64),
    /// All forms are made.
    All(Forms),
    /// A block has left the memory.
    Nothing,
}

/// Forms in the making: first all are measured, then made. Between two calls no snapshot is held.
#[derive(Default)]
pub struct MakeForms {
    tree: usize,
    make: Option<Make>,
    /// The sizes of the forms of the trees that were measured.
    sizes: Vec<Option<Size>>,
    is_measured: bool,
    forms: Vec<Option<Resident>>,
}

impl MakeForms {
    /// Adds up to `steps` nodes and leaves. `tree` returns each tree of the model, in a snapshot with all its blocks;
    /// `None` behind the last. Fails with `NoMemory`.
    pub fn go_on<'a>(&mut self, tree: impl Fn(usize) -> Option<Tree<'a>>, steps: usize) -> Result<Made> {
        let Some(now) = tree(self.tree) else { return Ok(self.phase_done()) };
        if self.make.is_none() {
            let begun = match (self.is_measured, self.sizes.get(self.tree)) {
                // The blocks of surfaces are small because they are not triangles.
                (false, _) if now.has_parameters() => Err(Stopped::Impossible),
                (false, _) => Make::measuring(&now),
                (true, Some(Some(size))) => Make::making(&now, *size)?,
                (true, _) => Err(Stopped::Impossible),
            };
            match begun {
                Ok(make) => self.make = Some(make),
                Err(stopped) => return self.stopped(&stopped),
            }
        }
        match self.make.as_mut().map(|make| make.go_on(&now, steps)) {
            Some(Ok(false)) => return Ok(Made::Some),
            Some(Err(stopped)) => return self.stopped(&stopped),
            Some(Ok(true)) | None => {}
        }
        let Some(make) = self.make.take() else { return Ok(Made::Some) };
        if self.is_measured {
            let size = self.sizes.get(self.tree).copied().flatten().unwrap_or_default();
            self.push_form(make.finish(size))
        } else {
            self.push_size(Some(make.size()))
        }
    }

    fn stopped(&mut self, stopped: &Stopped) -> Result<Made> {
        self.make = None;
        match stopped {
            Stopped::Missing(_) => Ok(Made::Nothing),
            Stopped::Impossible if self.is_measured => self.push_form(None),
            Stopped::Impossible => self.push_size(None),
        }
    }

    fn push_size(&mut self, size: Option<Size>) -> Result<Made> {
        crate::base::memory::make_room(&mut self.sizes, 1, WHAT)?;
        self.sizes.push(size);
        self.tree += 1;
        Ok(Made::Some)
    }

    fn push_form(&mut self, form: Option<Resident>) -> Result<Made> {
        if self.forms.capacity() == 0 {
            self.forms = room(self.sizes.len(), WHAT)?;
        }
        self.forms.push(form);
        self.tree += 1;
        Ok(Made::Some)
    }

    fn phase_done(&mut self) -> Made {
        if self.is_measured {
            return Made::All(Forms(std::mem::take(&mut self.forms)));
        }
        (self.is_measured, self.tree) = (true, 0);
        Made::Measured(self.sizes.iter().flatten().map(Size::bytes).sum())
    }
}
