//! The blocks of one opened model, and its current snapshot.

use super::account::Charge;
use super::admit::{Admission, Needs};
use super::bring::Held;
use super::claims::Claims;
use super::core::{Residency, Shared};
use super::failures::{Failure, Failures};
use super::links::{Links, Statements};
use super::snapshot::{Shown, Snapshot};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::memory::room;
use crate::base::progress::Cancel;
use crate::store::ModelFile;
use arc_swap::ArcSwap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// Properties of a structure's blocks that the residency needs.
pub trait Decoder: Send + Sync {
    /// Decodes block `id` to its trace form and checks it, so that walks can trust it; or returns the defect. (In
    /// memory the block ends with a whole cache line: zeros may follow.)
    ///
    /// The result must have `words` words, as the directory states. A payload that claims more is refused before memory
    /// is taken for it.
    fn decode(&self, id: BlockId, payload: &[u8], words: usize) -> std::result::Result<Vec<u32>, String>;

    /// Returns the statements of a decoded block about itself and others. The residency compares those of all blocks
    /// that have been in memory: no reference leads to a missing node, and no node is referred to twice. (By default a
    /// block has any node, and refers to none.)
    fn statements(&self, id: BlockId, words: &[u32]) -> Statements {
        let _ = (id, words);
        Statements { nodes: u32::MAX, ..Statements::default() }
    }

    /// Returns how the block is kept. Blocks that the structure does not know have the default class.
    fn class(&self, id: BlockId) -> BlockClass {
        let _ = id;
        BlockClass::default()
    }
}

/// How a block is kept in memory, as its structure declares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockClass {
    /// True if any number of blocks may hang below this one: it is kept longest. (Opening a model reads the blocks of a
    /// tree's first class.)
    pub is_coarse: bool,
    /// The block below, if exactly one hangs below this one. This block counts as used whenever that one is used.
    pub below: Option<BlockId>,
    /// True if the block is read ahead of any request, if there is room.
    pub is_read_ahead: bool,
    /// True if other blocks may refer to nodes of this one.
    pub is_entered: bool,
}

impl Default for BlockClass {
    fn default() -> Self {
        Self { is_coarse: false, below: None, is_read_ahead: true, is_entered: false }
    }
}

/// Identifies a model within its context.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ModelKey(pub(super) u32);

/// The blocks of an opened model. Thread-safe. Dropping it frees its memory once no snapshot of it is held.
pub struct ModelBlocks {
    pub(super) inner: Arc<Inner>,
}

/// Function that receives the error after which a block is read again.
type Report = Box<dyn Fn(&Error) + Send + Sync>;

pub(super) struct Inner {
    pub key: ModelKey,
    pub file: Arc<ModelFile>,
    pub decoder: Box<dyn Decoder>,
    pub residency: Arc<Shared>,
    pub published: ArcSwap<Snapshot>,
    /// Claims on blocks that are being read, so that none is decoded twice.
    pub claims: Claims,
    pub links: Links,
    pub report: Report,
    pub read_again: AtomicU64,
    pub failures: Failures,
    /// Blocks that stay in memory.
    pinned: Box<[AtomicBool]>,
    /// Bytes of all tables when all blocks are in memory.
    pub table_bytes: u64,
    /// Bytes of pinned blocks.
    pub root_bytes: u64,
    /// Set once the model is opened: its blocks may then be read ahead.
    pub may_promote: AtomicBool,
    /// Bytes of all blocks that are read ahead.
    promoted_bytes: u64,
    /// Bytes of those that are in memory. Written under the residency's lock.
    promoted_there: AtomicU64,
    /// Missing bytes at the last search that found no block to read, because reads had failed or were under way.
    pub lacked_in_vain: AtomicU64,
    /// Set once all blocks are in memory or being read. `is_together` is set once the model was searched for huge
    /// pages.
    pub is_complete: AtomicBool,
    pub is_together: AtomicBool,
    _tables: Vec<Charge>,
}

impl ModelBlocks {
    /// Opens the blocks of `file`, with none in memory. `roots` are pinned: they stay once they are in memory.
    ///
    /// Fails with `OverBudget` if the budget cannot hold the tables, `roots`, the lease of exact jobs and the working
    /// memory of reads, beside the pinned data of the other models. The error names the least sufficient budget.
    pub fn open(
        residency: &Residency,
        file: Arc<ModelFile>,
        decoder: Box<dyn Decoder>,
        roots: &[BlockId],
        report: impl Fn(&Error) + Send + Sync + 'static,
        cancel: &Cancel,
    ) -> Result<Self> {
        let needs = needs_of(&file, &*decoder, roots);
        let admission = residency.admit(file.name(), needs, || Ok(Needs::default()), cancel)?;
        Self::open_admitted(admission, file, decoder, roots, report)
    }

    /// [`ModelBlocks::open`] of a file whose tables were admitted before they were read.
    pub fn open_read(
        mut admission: Admission,
        file: Arc<ModelFile>,
        decoder: Box<dyn Decoder>,
        roots: &[BlockId],
        report: impl Fn(&Error) + Send + Sync + 'static,
        cancel: &Cancel,
    ) -> Result<Self> {
        admission.add(needs_of(&file, &*decoder, roots), || Ok(Needs::default()), cancel)?;
        Self::open_admitted(admission, file, decoder, roots, report)
    }

    fn open_admitted(
        mut admission: Admission,
        file: Arc<ModelFile>,
        decoder: Box<dyn Decoder>,
        roots: &[BlockId],
        report: impl Fn(&Error) + Send + Sync + 'static,
    ) -> Result<Self> {
        const TABLE: &str = "the table of the blocks of a model";
        let count = file.block_count();
        let mut pinned: Vec<AtomicBool> = room(count as usize, TABLE)?;
        pinned.extend((0..count).map(|_| AtomicBool::new(false)));
        for root in roots {
            if let Some(pinned) = pinned.get(root.0 as usize) {
                pinned.store(true, Relaxed);
            }
        }
        let promoted = (0..count).map(BlockId).filter(|&id| decoder.class(id).is_read_ahead);
        let promoted_bytes = promoted.map(|id| super::load::slot_bytes(&file, id)).sum();
        let links = Links::new(file.header().geometry_blocks, |id| decoder.class(id).is_entered)?;
        let (published, failures) = (ArcSwap::from_pointee(Snapshot::none(count)?), Failures::new(count)?);
        let (needs, key, residency) = (admission.needs, admission.key(), Arc::clone(admission.shared()));
        let inner = Arc::new(Inner {
            key,
            decoder,
            residency: Arc::clone(&residency),
            published,
            claims: Claims::default(),
            links,
            report: Box::new(report),
            read_again: AtomicU64::new(0),
            failures,
            pinned: pinned.into(),
            table_bytes: needs.tables + needs.changes,
            root_bytes: needs.pinned,
            may_promote: AtomicBool::new(false),
            promoted_bytes,
            promoted_there: AtomicU64::new(0),
            lacked_in_vain: AtomicU64::new(u64::MAX),
            is_complete: AtomicBool::new(false),
            is_together: AtomicBool::new(false),
            _tables: admission.take(),
            file,
        });
        residency.register(&inner, needs.pinned);
        Ok(Self { inner })
    }

    /// Calls [`ModelBlocks::open`] without pinned blocks and without reports of failures.
    pub fn new(file: Arc<ModelFile>, decoder: Box<dyn Decoder>, residency: &Residency) -> Result<Self> {
        Self::open(residency, file, decoder, &[], |_| {}, &Cancel::new())
    }

    /// The model's file.
    pub fn file(&self) -> &Arc<ModelFile> {
        &self.inner.file
    }

    /// Key of the model among the models of its context.
    pub fn key(&self) -> ModelKey {
        self.inner.key
    }

    /// Returns the reason why the block is reported as unavailable: twice it was unreadable or damaged.
    pub fn why_failed(&self, id: BlockId) -> Option<Error> {
        let name = self.inner.file.name();
        match self.inner.failures.of(id)? {
            Failure::Unreadable => {
                let text = format!("block {} could not be read; a stand-in is shown in its place", id.0);
                Some(Error::io(name, "read", std::io::Error::other(text)))
            }
            Failure::Damaged => Some(self.inner.corrupt(id, "the block is damaged; a stand-in is shown in its place")),
        }
    }

    /// Allows failed blocks to be read again for all views that want them, because a disk or a network may be back.
    /// Blocks that are damaged for good are then read in vain. The call has an effect four times a second at most.
    pub fn forget_failures(&self) {
        if self.inner.failures.forget() {
            self.inner.lacked_in_vain.store(u64::MAX, Relaxed);
            let _ = self.inner.residency.lock().ranking.invalidate();
            self.inner.residency.wake();
        }
    }

    /// Returns the current snapshot. Never blocks.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.inner.published.load_full()
    }

    /// Like [`ModelBlocks::snapshot`], but without touching the reference count that threads share. This thread must
    /// drop it soon: only a few at a time are free of cost.
    pub fn shown(&self) -> Shown {
        self.inner.published.load()
    }

    /// True if `snapshot` is the current one.
    pub fn is_current(&self, snapshot: &Arc<Snapshot>) -> bool {
        Arc::ptr_eq(&self.inner.published.load(), snapshot)
    }

    /// Requires that block `id` has the node `number` whenever it is in memory: see [`Decoder::statements`].
    pub fn expect_number(&self, id: BlockId, number: u32) -> Result<()> {
        self.inner.links.expect(id, number).map_err(|why| self.inner.corrupt(id, why))
    }

    /// Number of times that blocks were read again after a failure.
    pub fn read_again(&self) -> u64 {
        self.inner.read_again.load(Relaxed)
    }

    /// Bytes of the tables when all blocks are in memory.
    pub fn table_bytes(&self) -> u64 {
        self.inner.table_bytes
    }

    /// Returns the current snapshot with the blocks of `held` added; `None` if the budget has no room for
    /// a changed table.
    pub fn snapshot_with(&self, held: &Held) -> Option<Arc<Snapshot>> {
        let shared = self.snapshot();
        let absent: Vec<_> = held.iter().filter(|(id, _)| shared.block(*id).is_none()).collect();
        if absent.is_empty() {
            return Some(shared);
        }
        let changes = absent.into_iter().map(|(id, slot)| (*id, Some(slot.clone()))).collect();
        shared.changed(changes, Some(&self.inner.residency.main)).map(Arc::new)
    }

    /// Bytes of the block in memory.
    pub fn slot_bytes(&self, id: BlockId) -> u64 {
        self.inner.slot_bytes(id)
    }

    /// Bytes of the blocks in memory.
    pub fn resident_bytes(&self) -> u64 {
        self.snapshot().resident().map(|(_, slot)| slot.bytes()).sum()
    }
}

/// The needs of the blocks of a file.
fn needs_of(file: &ModelFile, decoder: &dyn Decoder, roots: &[BlockId]) -> Needs {
    let (count, geometry) = (file.block_count(), file.header().geometry_blocks);
    let entered = (0..geometry).filter(|&id| decoder.class(BlockId(id)).is_entered).count();
    let mut needs = Needs::of_blocks(count, geometry, entered as u32);
    file.directory().iter().for_each(|row| needs.hold(row));
    roots.iter().filter_map(|root| file.directory().get(root.0 as usize)).for_each(|row| needs.pin(row));
    needs
}

impl Inner {
    /// True if the block is in memory.
    pub fn is_there(&self, id: BlockId) -> bool {
        self.published.load().block(id).is_some()
    }

    /// True if the block stays once it is in memory.
    pub fn is_pinned(&self, id: BlockId) -> bool {
        self.pinned.get(id.0 as usize).is_some_and(|p| p.load(Relaxed))
    }

    /// Bytes of the block in memory.
    pub fn slot_bytes(&self, id: BlockId) -> u64 {
        super::load::slot_bytes(&self.file, id)
    }

    /// Bytes of blocks that are read ahead and not in memory.
    pub fn promoted_lacking(&self) -> u64 {
        self.promoted_bytes.saturating_sub(self.promoted_there.load(Relaxed))
    }

    /// Counts blocks that have been added to memory or evicted. Requires the residency's lock.
    pub fn count_promoted(&self, ids: impl Iterator<Item = BlockId>, have_come: bool) {
        let bytes: u64 = ids.filter(|&id| self.decoder.class(id).is_read_ahead).map(|id| self.slot_bytes(id)).sum();
        if have_come {
            self.promoted_there.fetch_add(bytes, Relaxed);
        } else {
            self.promoted_there.fetch_sub(bytes, Relaxed);
        }
    }

    pub fn corrupt(&self, id: BlockId, why: impl Into<String>) -> Error {
        Error::corrupt(self.file.name(), Some(id.0), why)
    }
}

impl Drop for ModelBlocks {
    fn drop(&mut self) {
        self.inner.residency.forget(&self.inner);
        // A thread that is reading a block of this model publishes it to no effect.
        self.inner.published.store(Arc::default());
    }
}

impl std::fmt::Debug for ModelBlocks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ModelBlocks").field("blocks", &self.inner.file.block_count()).finish_non_exhaustive()
    }
}
