//! The blocks of one opened model, and which of them are in memory.

use super::account::Charge;
use super::bring::Held;
use super::claims::Claims;
use super::core::{Residency, Shared};
use super::failures::{Failure, Failures};
use super::links::{Links, Reference};
use super::snapshot::{Shown, Snapshot};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::ModelFile;
use arc_swap::ArcSwap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// What residency has to know of a structure's blocks.
pub trait Decoder: Send + Sync {
    /// The trace form of block `id`, checked so that a walk can trust it; or what is wrong with it. (In memory it ends
    /// with a whole cache line: zeros may follow.)
    fn decode(&self, id: BlockId, payload: &[u8]) -> std::result::Result<Vec<u32>, String>;

    /// Calls `refer` with what a decoded block says of others. Returns how many numbers the block itself has. No
    /// reference leads to where nothing is: that is checked between each two blocks that are ever in memory.
    fn links(&self, id: BlockId, words: &[u32], refer: &mut dyn FnMut(Reference)) -> u32 {
        let _ = (id, words, refer);
        u32::MAX
    }

    /// How the block is kept. A block beyond those that the structure knows is of the default class.
    fn class(&self, id: BlockId) -> BlockClass {
        let _ = id;
        BlockClass::default()
    }
}

/// How a block is kept in memory, as its structure declares it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockClass {
    /// Any number of blocks hang below this one: it is kept longest. (Opening reads the blocks of a tree's first
    /// class.)
    pub is_coarse: bool,
    /// The one block that hangs below this one alone: this one counts as used whenever that is.
    pub below: Option<BlockId>,
    /// The block is read before it is asked for, where there is room.
    pub is_read_ahead: bool,
}

impl Default for BlockClass {
    fn default() -> Self {
        Self { is_coarse: false, below: None, is_read_ahead: true }
    }
}

/// Names a model in its context.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ModelKey(pub(super) u32);

/// The blocks of an opened model. Thread-safe. Dropping it gives its memory back, once no snapshot of it is held.
pub struct ModelBlocks {
    pub(super) inner: Arc<Inner>,
}

/// Told why a block is read again.
type Report = Box<dyn Fn(&Error) + Send + Sync>;

pub(super) struct Inner {
    pub key: ModelKey,
    pub file: Arc<ModelFile>,
    pub decoder: Box<dyn Decoder>,
    pub residency: Arc<Shared>,
    pub published: ArcSwap<Snapshot>,
    /// Blocks being read now, so that none is decoded twice.
    pub claims: Claims,
    pub links: Links,
    pub report: Report,
    pub read_again: AtomicU64,
    pub failures: Failures,
    /// Blocks that stay.
    pinned: Box<[AtomicBool]>,
    /// Bytes of all tables, when all is in memory.
    pub table_bytes: u64,
    /// Bytes of blocks that stay.
    pub root_bytes: u64,
    /// Set once opened: its blocks may be read ahead.
    pub may_promote: AtomicBool,
    /// Bytes of all blocks that are read ahead.
    promoted_bytes: u64,
    /// Bytes of those of them that are in memory. Written under the residency's lock.
    promoted_there: AtomicU64,
    /// The bytes that were lacking when none of them could be had: their reads had failed, or were under way.
    pub lacked_in_vain: AtomicU64,
    /// Set once all of it is in memory, or being read; and once huge pages were looked for in what is there.
    pub is_complete: AtomicBool,
    pub is_together: AtomicBool,
    _tables: Charge,
}

impl ModelBlocks {
    /// Of `file`, with nothing in memory. `roots` stay in memory once they are there.
    ///
    /// Fails with `OverBudget` if the budget does not hold the tables, `roots`, the lease of exact jobs and what
    /// reading needs, beside what must stay of the other models: it names the least that would do.
    pub fn open(
        residency: &Residency,
        file: Arc<ModelFile>,
        decoder: Box<dyn Decoder>,
        roots: &[BlockId],
        report: impl Fn(&Error) + Send + Sync + 'static,
        cancel: &Cancel,
    ) -> Result<Self> {
        let count = file.block_count();
        let [stays, each] = Snapshot::bytes_for(count);
        let stays = stays + file.memory() + u64::from(count) * 2 + Links::bytes_for(file.header().geometry_blocks);
        let root_bytes = roots.iter().map(|&id| super::load::slot_bytes(&file, id)).sum();
        let (key, tables) = residency.shared().admit(file.name(), [stays, stays + each, root_bytes], cancel)?;
        let pinned = (0..count).map(|_| AtomicBool::new(false)).collect::<Box<[_]>>();
        for root in roots {
            if let Some(pinned) = pinned.get(root.0 as usize) {
                pinned.store(true, Relaxed);
            }
        }
        let promoted = (0..count).map(BlockId).filter(|&id| decoder.class(id).is_read_ahead);
        let promoted_bytes = promoted.map(|id| super::load::slot_bytes(&file, id)).sum();
        let inner = Arc::new(Inner {
            key,
            decoder,
            residency: Arc::clone(residency.shared()),
            published: ArcSwap::from_pointee(Snapshot::empty(count)),
            claims: Claims::default(),
            links: Links::new(file.header().geometry_blocks),
            report: Box::new(report),
            read_again: AtomicU64::new(0),
            failures: Failures::new(count),
            pinned,
            table_bytes: stays + each,
            root_bytes,
            may_promote: AtomicBool::new(false),
            promoted_bytes,
            promoted_there: AtomicU64::new(0),
            lacked_in_vain: AtomicU64::new(u64::MAX),
            is_complete: AtomicBool::new(false),
            is_together: AtomicBool::new(false),
            _tables: tables,
            file,
        });
        residency.shared().register(&inner, root_bytes);
        Ok(Self { inner })
    }

    /// [`ModelBlocks::open`] without blocks that stay, and without reports of failures.
    pub fn new(file: Arc<ModelFile>, decoder: Box<dyn Decoder>, residency: &Residency) -> Result<Self> {
        Self::open(residency, file, decoder, &[], |_| {}, &Cancel::new())
    }

    /// The file.
    pub fn file(&self) -> &Arc<ModelFile> {
        &self.inner.file
    }

    /// What the model is called where blocks of several are wanted.
    pub fn key(&self) -> ModelKey {
        self.inner.key
    }

    /// Why views have been told that the block does not come: it could not be read, or was damaged, twice.
    pub fn why_failed(&self, id: BlockId) -> Option<Error> {
        let name = self.inner.file.name();
        match self.inner.failures.of(id)? {
            Failure::Unreadable => {
                let text = format!("block {} could not be read: a stand-in is shown for it", id.0);
                Some(Error::io(name, "read", std::io::Error::other(text)))
            }
            Failure::Damaged => Some(self.inner.corrupt(id, "it is damaged: a stand-in is shown for it")),
        }
    }

    /// Blocks that failed are asked for again from now on, for all views that want them: a disk or a network may be
    /// back. (What is damaged for good is then read in vain; this counts four times a second at most.)
    pub fn forget_failures(&self) {
        if self.inner.failures.forget() {
            self.inner.lacked_in_vain.store(u64::MAX, Relaxed);
            let _ = self.inner.residency.lock().ranking.invalidate();
            self.inner.residency.wake();
        }
    }

    /// What is in memory now. Never blocks.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.inner.published.load_full()
    }

    /// [`ModelBlocks::snapshot`] without a count that threads share, to be let go soon, by this thread: there are few
    /// at a time that cost nothing.
    pub fn shown(&self) -> Shown {
        self.inner.published.load()
    }

    /// Whether `snapshot` is what is in memory now.
    pub fn is_current(&self, snapshot: &Arc<Snapshot>) -> bool {
        Arc::ptr_eq(&self.inner.published.load(), snapshot)
    }

    /// Demands that block `id`, whenever it is in memory, has the number `number`: see [`Decoder::links`].
    pub fn expect_number(&self, id: BlockId, number: u32) -> Result<()> {
        self.inner.links.expect(id, number).map_err(|why| self.inner.corrupt(id, why))
    }

    /// How many times blocks were read again because they had failed.
    pub fn read_again(&self) -> u64 {
        self.inner.read_again.load(Relaxed)
    }

    /// Bytes of the tables, when all is in memory.
    pub fn table_bytes(&self) -> u64 {
        self.inner.table_bytes
    }

    /// What is in memory now, and `held`; `None` if there is no memory for the table.
    pub fn snapshot_with(&self, held: &Held) -> Option<Arc<Snapshot>> {
        let shared = self.snapshot();
        let absent: Vec<_> = held.iter().filter(|(id, _)| shared.block(*id).is_none()).collect();
        if absent.is_empty() {
            return Some(shared);
        }
        let changes = absent.into_iter().map(|(id, slot)| (*id, Some(slot.clone()))).collect();
        shared.changed(changes, Some(&self.inner.residency.main)).map(Arc::new)
    }

    /// Bytes that the block takes in memory.
    pub fn slot_bytes(&self, id: BlockId) -> u64 {
        self.inner.slot_bytes(id)
    }

    /// Bytes of the blocks in memory.
    pub fn resident_bytes(&self) -> u64 {
        self.snapshot().resident().map(|(_, slot)| slot.bytes()).sum()
    }
}

impl Inner {
    /// Whether the block is in memory.
    pub fn is_there(&self, id: BlockId) -> bool {
        self.published.load().block(id).is_some()
    }

    /// Whether the block stays once it is in memory.
    pub fn is_pinned(&self, id: BlockId) -> bool {
        self.pinned.get(id.0 as usize).is_some_and(|p| p.load(Relaxed))
    }

    /// Bytes that the block takes in memory.
    pub fn slot_bytes(&self, id: BlockId) -> u64 {
        super::load::slot_bytes(&self.file, id)
    }

    /// Bytes of blocks that are read ahead and are not in memory.
    pub fn promoted_lacking(&self) -> u64 {
        self.promoted_bytes.saturating_sub(self.promoted_there.load(Relaxed))
    }

    /// Counts blocks that have come to memory, or are gone from it. Under the lock of what is in memory.
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
        // A thread that reads a block of it just now publishes into nothing.
        self.inner.published.store(Arc::default());
    }
}

impl std::fmt::Debug for ModelBlocks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ModelBlocks").field("blocks", &self.inner.file.block_count()).finish_non_exhaustive()
    }
}
