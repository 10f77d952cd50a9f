//! Vertices of formats with global indices, in the fewest bytes that hold them exactly. Beyond a limit they move from
//! memory to a scratch file, which is read page by page.

use super::ReadOptions;
use crate::base::error::{Error, Result};
use crate::base::scratch::{Scratch, ScratchSpace};
use glam::DVec3;
use std::cell::RefCell;
use std::sync::Arc;

/// Vertices per page. Vertices that are neighbours in a file are mostly close in space and used by the same faces.
const PAGE: usize = 4096;

/// Positions by index, with 12 or 24 bytes each.
pub(crate) struct Vertices {
    held: Held,
    spilled: Option<Spilled>,
    limit: u64,
    space: Arc<ScratchSpace>,
}

/// Positions in memory. Of a spilled list these are the newest ones, until the list is complete.
pub(crate) enum Held {
    /// Every coordinate of the file fits single precision.
    Single(Vec<[f32; 3]>),
    /// Some coordinates may need double precision.
    Double(Vec<[f64; 3]>),
}

struct Spilled {
    file: Scratch,
    count: usize,
    pages: RefCell<Pages>,
}

/// A direct-mapped cache of pages, and the first error of reading one.
struct Pages {
    slots: Vec<(usize, Vec<u8>)>,
    failed: Option<Error>,
}

impl Held {
    fn len(&self) -> usize {
        match self {
            Held::Single(v) => v.len(),
            Held::Double(v) => v.len(),
        }
    }

    /// Size of a vertex in bytes.
    fn each(&self) -> usize {
        match self {
            Held::Single(_) => 12,
            Held::Double(_) => 24,
        }
    }

    fn bytes(&self) -> &[u8] {
        match self {
            Held::Single(v) => bytemuck::cast_slice(v),
            Held::Double(v) => bytemuck::cast_slice(v),
        }
    }
}

impl Vertices {
    /// Creates an empty list with room for `capacity` vertices.
    pub(crate) fn new(single: bool, capacity: usize, options: &ReadOptions) -> Self {
        let limit = if options.memory == 0 { u64::MAX } else { options.memory };
        let room = |each: u64| capacity.min(usize::try_from(limit / each).unwrap_or(usize::MAX).saturating_add(PAGE));
        let held = if single {
            Held::Single(Vec::with_capacity(room(12)))
        } else {
            Held::Double(Vec::with_capacity(room(24)))
        };
        Self { held, spilled: None, limit, space: options.scratch() }
    }

    /// Returns the list in memory for adding vertices. The caller calls [`Vertices::settle`] from time to time.
    pub(crate) fn held(&mut self) -> &mut Held {
        &mut self.held
    }

    /// Spills the positions in memory if they exceed the limit.
    pub(crate) fn settle(&mut self) -> Result<()> {
        let most = if self.spilled.is_some() { self.limit.min(1 << 20) } else { self.limit };
        if self.held.bytes().len() as u64 > most { self.spill() } else { Ok(()) }
    }

    /// Completes the list. Must be called after the last vertex was added.
    pub(crate) fn complete(&mut self) -> Result<()> {
        if self.spilled.is_some() { self.spill() } else { Ok(()) }
    }

    fn spill(&mut self) -> Result<()> {
        let page = (PAGE * self.held.each()) as u64;
        let spilled = match self.spilled.take() {
            Some(spilled) => spilled,
            None => {
                let slots = (self.limit / page).max(4) as usize;
                let slots = (0..slots).map(|_| (usize::MAX, Vec::new())).collect();
                let pages = RefCell::new(Pages { slots, failed: None });
                Spilled { file: self.space.file()?, count: 0, pages }
            }
        };
        let spilled = self.spilled.insert(spilled);
        spilled.file.append(self.held.bytes())?;
        spilled.count += self.held.len();
        // Frees the memory as well: the cached pages need it.
        match &mut self.held {
            Held::Single(v) => *v = Vec::new(),
            Held::Double(v) => *v = Vec::new(),
        }
        Ok(())
    }

    pub(crate) fn len(&self) -> usize {
        self.held.len() + self.spilled.as_ref().map_or(0, |s| s.count)
    }

    /// Returns the position of vertex `i`, if it exists. After a failed read [`Vertices::check`] returns the error.
    #[inline]
    pub(crate) fn get(&self, i: usize) -> Option<DVec3> {
        if let Some(spilled) = &self.spilled {
            return spilled.get(i, self.held.each());
        }
        match &self.held {
            Held::Single(v) => v.get(i).map(|p| DVec3::from(p.map(f64::from))),
            Held::Double(v) => v.get(i).map(|&p| DVec3::from(p)),
        }
    }

    /// Fails if reading a vertex failed.
    pub(crate) fn check(&self) -> Result<()> {
        let failed = self.spilled.as_ref().and_then(|s| s.pages.borrow_mut().failed.take());
        failed.map_or(Ok(()), Err)
    }
}

impl Spilled {
    fn get(&self, i: usize, each: usize) -> Option<DVec3> {
        if i >= self.count {
            return None;
        }
        let pages = &mut *self.pages.borrow_mut();
        let (page, count) = (i / PAGE, pages.slots.len());
        let slot = &mut pages.slots[page % count];
        if slot.0 != page {
            slot.1.resize(each * PAGE.min(self.count - page * PAGE), 0);
            slot.0 = page;
            if let Err(e) = self.file.read_at((page * PAGE * each) as u64, &mut slot.1) {
                slot.0 = usize::MAX;
                pages.failed.get_or_insert(e);
                return None;
            }
        }
        let bytes = &slot.1[i % PAGE * each..][..each];
        let four = |at: usize| bytes[at..].first_chunk().map_or(0.0, |b| f64::from(f32::from_ne_bytes(*b)));
        let eight = |at: usize| bytes[at..].first_chunk().map_or(0.0, |b| f64::from_ne_bytes(*b));
        Some(if each == 12 { DVec3::new(four(0), four(4), four(8)) } else { DVec3::new(eight(0), eight(8), eight(16)) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spilled_vertices_equal_those_in_memory() {
        let dir = tempfile::tempdir().unwrap();
        let at = |i: usize| [i as f64, -0.25 * i as f64, 1e6 - i as f64];
        for (single, memory) in [(true, 0), (true, 100_000), (false, 100_000), (false, 1)] {
            let options = ReadOptions { temp_dir: Some(dir.path().into()), memory, ..ReadOptions::default() };
            let mut vertices = Vertices::new(single, 50_000, &options);
            for i in 0..50_000 {
                match vertices.held() {
                    Held::Single(v) => v.push(at(i).map(|x| x as f32)),
                    Held::Double(v) => v.push(at(i)),
                }
                if i % 1000 == 0 {
                    vertices.settle().unwrap();
                }
            }
            vertices.complete().unwrap();
            assert_eq!((vertices.len(), vertices.spilled.is_some()), (50_000, memory > 0));
            for i in (0..50_000).map(|i| i * 7919 % 50_000) {
                assert_eq!(vertices.get(i), Some(at(i).into()));
            }
            assert_eq!(vertices.get(50_000), None);
            vertices.check().unwrap();
        }
    }
}
