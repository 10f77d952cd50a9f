//! Views, fetchers and exact jobs with an artificial model, read through a source that counts reads and can fail.

use super::*;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::{Header, MemorySource, ModelFile, Source, TreeRow, Writer};
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::SeqCst};
use std::sync::{Arc, Barrier, Mutex};
use std::time::Duration;

/// Number of geometry blocks: a tree of four levels in which block `b` has the children `8 b + 1` to `8 b + 8`.
pub(super) const BLOCKS: u32 = 1 + 8 + 64 + 512;
/// Number of blocks that have children.
const COARSE: u32 = 1 + 8 + 64;
/// Words of each geometry block.
const WORDS: usize = 4000;

struct Numbers {
    /// Number of calls of `class`.
    looks: Arc<AtomicU32>,
}

impl Decoder for Numbers {
    fn decode(&self, id: BlockId, payload: &[u8], _: usize) -> std::result::Result<Vec<u32>, String> {
        if payload.len() < 4 || payload[..4] != id.0.to_le_bytes() {
            return Err("it is another block".into());
        }
        Ok(vec![id.0; if id.0 < BLOCKS { WORDS } else { 4 }])
    }
    fn class(&self, id: BlockId) -> BlockClass {
        self.looks.fetch_add(1, SeqCst);
        BlockClass { is_coarse: id.0 < COARSE, is_read_ahead: id.0 < BLOCKS, ..BlockClass::default() }
    }
}

/// Returns the bytes of such a model. The directory gives block `wrong` one word too many.
fn file(wrong: Option<u32>) -> Vec<u8> {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("model.oc");
    let mut writer = Writer::create(&path).expect("a file");
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 56) as u8
    };
    for id in 0..2 * BLOCKS {
        let mut payload = id.to_le_bytes().to_vec();
        // As large as real blocks, and incompressible.
        payload.extend((0..if id < BLOCKS { 5000 } else { 12 }).map(|_| random()));
        let words = if id < BLOCKS { WORDS } else { 4 } + usize::from(wrong == Some(id));
        writer.block(&payload, words as u32 * 4).expect("a block");
    }
    let header = Header { geometry_blocks: BLOCKS, ..Header::default() };
    let tree = TreeRow {
        block_count: BLOCKS,
        class_blocks: [COARSE, BLOCKS - COARSE, 0, 0],
        bounds: [0.0; 6],
        ..TreeRow::EMPTY
    };
    writer.finish(&header, &[], &[], &[], &[tree]).expect("a model");
    std::fs::read(&path).expect("the file")
}

/// Called at each read with the number of the read and its offset.
type OnRead = Box<dyn Fn(u32, u64) -> io::Result<()> + Send + Sync>;

struct Watched {
    inner: MemorySource,
    reads: AtomicU32,
    on_read: OnRead,
}

impl Source for Watched {
    fn len(&self) -> u64 {
        self.inner.len()
    }
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        (self.on_read)(self.reads.fetch_add(1, SeqCst), offset)?;
        self.inner.read_at(offset, buf)
    }
    fn name(&self) -> &Path {
        Path::new("watched")
    }
}

pub(super) struct Rig {
    pub(super) residency: Residency,
    blocks: ModelBlocks,
    source: Arc<Watched>,
    told: Arc<Mutex<Vec<String>>>,
    looks: Arc<AtomicU32>,
}

fn rig_with(options: ResidencyOptions, bytes: Vec<u8>, on_read: OnRead) -> Result<Rig> {
    let source = Arc::new(Watched { inner: MemorySource::named("watched", bytes), reads: AtomicU32::new(0), on_read });
    let residency = Residency::new(options);
    let file = Arc::new(ModelFile::open(source.clone())?);
    let told = Arc::new(Mutex::new(Vec::new()));
    let tell = Arc::clone(&told);
    let report = move |e: &Error| tell.lock().expect("the list").push(e.to_string());
    let looks = Arc::default();
    let numbers = Numbers { looks: Arc::clone(&looks) };
    let blocks = ModelBlocks::open(&residency, file, Box::new(numbers), &[BlockId(0)], report, &Cancel::new())?;
    blocks.require(&[BlockId(0)], &Cancel::new())?;
    source.reads.store(0, SeqCst);
    Ok(Rig { residency, blocks, source, told, looks })
}

pub(super) fn rig(budget: u64, promote: bool) -> Rig {
    rig_with(ResidencyOptions { budget, promote }, file(None), Box::new(|_, _| Ok(()))).expect("a model")
}

/// Bytes of all geometry blocks. `budget_for` returns a budget that holds `share` of them beside the other data.
const ALL: u64 = BLOCKS as u64 * (WORDS as u64 * 4 + 192);

pub(super) fn budget_for(share: f64) -> u64 {
    (ALL as f64 * share) as u64 + (2 << 20) + 200_000
}

impl Rig {
    fn reads(&self) -> u32 {
        self.source.reads.load(SeqCst)
    }
    fn there(&self) -> Vec<u32> {
        let snapshot = self.blocks.snapshot();
        (0..snapshot.blocks()).filter(|&b| snapshot.block(BlockId(b)).is_some()).collect()
    }
    fn check(&self) {
        assert!(self.residency.used() <= self.residency.budget(), "{} bytes", self.residency.used());
        let there = self.there();
        let parent = |b: u32| there.binary_search(&((b - 1) / 8)).is_ok();
        assert!(there.iter().all(|&b| b == 0 || b >= BLOCKS || parent(b)), "a block without the one above it");
    }
    fn pump_all(&self) {
        while self.residency.pump() {
            self.check();
        }
    }
    pub(super) fn wanted(&self, block: u32, weight: f32) -> Wanted {
        Wanted { model: self.blocks.key(), block: BlockId(block), weight }
    }
}

/// A view at a position on a line. The blocks of each level divide the line among them; near blocks are refined more.
struct Eye {
    view: View,
    told: Arc<AtomicBool>,
    threshold: f32,
}

impl Eye {
    fn new(rig: &Rig, threshold: f32) -> Self {
        let (view, told) = (rig.residency.view(), Arc::new(AtomicBool::new(true)));
        let tell = Arc::clone(&told);
        view.on_change(Some(Arc::new(move || tell.store(true, SeqCst))));
        Self { view, told, threshold }
    }

    /// Makes a pass; returns the numbers of blocks that it used and that it lacked.
    fn pass(&self, rig: &Rig, at: f32, changed: bool) -> [usize; 2] {
        let stamp = self.view.begin_pass(changed);
        let threshold = self.threshold * self.view.pressure();
        let snapshot = rig.blocks.snapshot();
        let (mut used, mut wants) = (0, Vec::new());
        let mut stack = vec![(0u32, 0.0f32, 1.0f32)];
        while let Some((block, low, width)) = stack.pop() {
            let distance = (low - at).max(at - low - width).max(0.0);
            let error = width / (distance + 0.01);
            match snapshot.visit(BlockId(block), stamp) {
                None => wants.push(rig.wanted(block, error)),
                Some(words) => {
                    assert_eq!(words[0], block);
                    used += 1;
                    if block < COARSE && error > threshold {
                        let child = |i: u32| (8 * block + 1 + i, low + width / 8.0 * i as f32, width / 8.0);
                        stack.extend((0..8).map(child));
                    }
                }
            }
        }
        drop(snapshot);
        self.view.want(&wants);
        [used, wants.len()]
    }
}

/// Makes passes for notified views, at rest, until no view is notified any more; returns the number of rounds.
fn come_to_rest(rig: &Rig, eyes: &[(Eye, f32)]) -> usize {
    for passes in 0..1000 {
        rig.pump_all();
        let told: Vec<_> = eyes.iter().filter(|(eye, _)| eye.told.swap(false, SeqCst)).collect();
        if told.is_empty() {
            return passes;
        }
        told.iter().for_each(|(eye, at)| {
            eye.pass(rig, *at, false);
        });
        rig.check();
    }
    panic!("the views never rest");
}

#[test]
fn charges_stay_within_the_limit_and_are_given_back() {
    let account = account::Account::new(100);
    let mut first = account.charge(60, 0).expect("fits");
    assert!(account.charge(41, 0).is_none() && account.charge(u64::MAX, 0).is_none());
    assert!(account.charge(40, 1).is_none() && account.charge(1, 101).is_none());
    let part = first.split(20);
    drop(first);
    assert_eq!(account.used(), 20);
    drop((part, account.charge(80, 0).expect("fits")));
    assert_eq!(account.used(), 0);
}

#[test]
fn reads_stop_when_cameras_rest_for_any_budget() {
    for share in [0.02, 0.05, 0.2, 0.5, 1.1] {
        let rig = rig(budget_for(share), false);
        let mut eyes = [(Eye::new(&rig, 0.3), 0.1), (Eye::new(&rig, 0.1), 0.7)];
        // Jumps to places from which more or less is visible.
        for ats in [[0.1, 0.7], [0.9, 0.2], [30.0, 0.5], [30.0, 30.0], [0.4, 0.4]] {
            for ((eye, at), new) in eyes.iter_mut().zip(ats) {
                *at = new;
                eye.pass(&rig, new, true);
            }
            come_to_rest(&rig, &eyes);
            let reads = rig.reads();
            for _ in 0..3 {
                for (eye, at) in &eyes {
                    let [used, lacking] = eye.pass(&rig, *at, false);
                    assert!(used > 0 && lacking == 0, "{share}: {used} used, {lacking} missing");
                }
                rig.pump_all();
            }
            assert_eq!(rig.reads(), reads, "{share}, {ats:?}: reads at rest");
            assert!(eyes.iter().all(|(eye, _)| eye.view.status().state == ViewState::Satisfied));
            if share > 1.0 {
                assert_eq!(eyes[0].0.view.pressure(), 1.0);
            }
        }
        let strained = eyes[0].0.view.pressure();
        assert_eq!(strained > 1.0, share < 0.3, "{share}: {strained}");
        drop(eyes);
        let Rig { residency, blocks, .. } = rig;
        drop(blocks);
        assert_eq!(residency.used(), 0);
    }
}

#[test]
fn pressure_falls_when_a_camera_leaves_excessive_detail() {
    let rig = rig(budget_for(0.1), false);
    let eyes = [(Eye::new(&rig, 0.02), 0.5)];
    eyes[0].0.pass(&rig, 0.5, true);
    come_to_rest(&rig, &eyes);
    let high = eyes[0].0.view.pressure();
    assert!(high > 2.0, "{high}");
    // The pressure stays while the camera rests.
    eyes[0].0.pass(&rig, 0.5, false);
    come_to_rest(&rig, &eyes);
    assert_eq!(eyes[0].0.view.pressure(), high);
    let eyes = eyes.map(|(eye, _)| (eye, 200.0));
    eyes[0].0.pass(&rig, 200.0, true);
    come_to_rest(&rig, &eyes);
    assert_eq!(eyes[0].0.view.pressure(), 1.0);
}

#[test]
fn the_most_wanted_block_is_read_first_with_its_neighbours() {
    let order = Arc::new(Mutex::new(Vec::new()));
    let seen = Arc::clone(&order);
    let on_read = Box::new(move |_, offset| {
        seen.lock().expect("the list").push(offset);
        Ok(())
    });
    let rig = rig_with(ResidencyOptions { budget: 1 << 30, promote: false }, file(None), on_read).expect("a model");
    let (one, other) = (rig.residency.view(), rig.residency.view());
    one.begin_pass(true);
    one.want(&[rig.wanted(100, 2.0), rig.wanted(300, 3.0), rig.wanted(500, 1.0), rig.wanted(101, 0.1)]);
    other.begin_pass(true);
    other.want(&[rig.wanted(500, 1.5), rig.wanted(7, f32::NAN)]);
    assert_eq!(
        one.status(),
        ViewStatus { bytes_wanted: 4 * WORDS as u64 * 4, state: ViewState::Busy, is_alone: false }
    );
    order.lock().expect("the list").clear();
    rig.pump_all_unchecked();
    let block_at = |offset: u64| rig.blocks.file().directory().iter().position(|row| row.offset == offset);
    let blocks: Vec<_> = order.lock().expect("the list").iter().filter_map(|&offset| block_at(offset)).collect();
    assert_eq!(blocks, [300, 500, 100, 7]);
    assert_eq!(rig.there(), [0, 7, 100, 101, 300, 500]);
    assert_eq!(one.status(), ViewStatus { bytes_wanted: 0, state: ViewState::Satisfied, is_alone: false });
    // A dropped view wants nothing.
    other.want(&[rig.wanted(8, 1.0)]);
    drop(other);
    assert!(!rig.residency.pump());
}

#[test]
fn a_snapshot_that_is_held_keeps_its_memory_and_fetching_waits_for_it() {
    let rig = rig(budget_for(0.05), false);
    let view = rig.residency.view();
    let want = |from: u32| {
        view.begin_pass(true);
        view.want(&(from..from + 20).map(|b| rig.wanted(b, 1.0)).collect::<Vec<_>>());
    };
    want(100);
    while rig.residency.pump() {}
    let held = rig.blocks.snapshot();
    let before: Vec<_> = rig.there();
    assert!(before.len() > 10, "{}", before.len());
    // Two passes later the blocks of the first one are evictable.
    (0..4).for_each(|i| want(200 + 20 * i));
    while rig.residency.pump() {}
    let bytes = rig.residency.used();
    assert!(bytes <= rig.residency.budget());
    assert!(before.iter().all(|&b| held.block(BlockId(b)).is_some_and(|words| words[0] == b)));
    assert_eq!(view.status().state, ViewState::Busy, "it waits, and nobody says that it does not come");
    assert_eq!(view.pressure(), 1.0, "what is held is not in use");
    assert!(!rig.residency.pump() && rig.residency.pump_on(), "nobody wakes who pumps when it is let go of");
    drop(held);
    view.want(&(260..280).map(|b| rig.wanted(b, 1.0)).collect::<Vec<_>>());
    while rig.residency.pump() {}
    assert_eq!(view.status().state, ViewState::Satisfied);
}

#[test]
fn a_wanted_block_that_is_evicted_is_read_again() {
    let rig = rig(budget_for(0.05), false);
    let view = rig.residency.view();
    view.want(&[100, 200, 300].map(|b| rig.wanted(b, 1.0)));
    while rig.residency.pump() {}
    assert_eq!(view.status().state, ViewState::Satisfied);
    // Evicts as much as possible.
    let sizes = (1..rig.residency.budget() >> 10).rev();
    assert!(sizes.map(|kib| kib << 10).any(|bytes| rig.residency.shared().takes_room(bytes)));
    assert_eq!(view.status().state, ViewState::Busy);
    while rig.residency.pump() {}
    assert_eq!(view.status().state, ViewState::Satisfied);
}

#[test]
fn a_block_that_fails_twice_is_reported_and_not_read_again() {
    for times in [1, 2] {
        let armed = Arc::new(AtomicU32::new(0));
        let left = Arc::clone(&armed);
        let on_read = Box::new(move |_, _| {
            let fails = left.fetch_update(SeqCst, SeqCst, |n| n.checked_sub(1)).is_ok();
            if fails { Err(io::ErrorKind::ConnectionReset.into()) } else { Ok(()) }
        });
        let rig = rig_with(ResidencyOptions { budget: 1 << 30, promote: true }, file(None), on_read).expect("a model");
        let view = rig.residency.view();
        let calls = Arc::new(AtomicU32::new(0));
        let count = Arc::clone(&calls);
        view.on_change(Some(Arc::new(move || {
            count.fetch_add(1, SeqCst);
        })));
        view.begin_pass(true);
        armed.store(times, SeqCst);
        view.want(&[rig.wanted(40, 1.0)]);
        rig.pump_all_unchecked();
        assert_eq!((rig.told.lock().expect("the list").len(), rig.blocks.read_again()), (1, 1));
        assert!(calls.load(SeqCst) > 0);
        let state = if times == 1 { ViewState::Satisfied } else { ViewState::Failed };
        assert_eq!(view.status().state, state);
        let reads = rig.reads();
        view.want(&[rig.wanted(40, 1.0)]);
        rig.pump_all_unchecked();
        assert_eq!(rig.reads(), reads);
        // An exact job reads the block again and gets it, or an error of its own.
        assert_eq!(rig.blocks.bring(&[BlockId(40)], &Cancel::new()).expect("it is back").len(), 1);
    }
}

#[test]
fn a_block_of_another_size_than_the_directory_says_is_corrupt() {
    let rig = rig_with(ResidencyOptions { budget: 1 << 30, promote: false }, file(Some(9)), Box::new(|_, _| Ok(())));
    let rig = rig.expect("a model");
    let all: Vec<BlockId> = (0..20).map(BlockId).collect();
    let error = rig.blocks.bring(&all, &Cancel::new()).expect_err("block 9 is wrong");
    assert!(matches!(error, Error::Corrupt { block: Some(9), .. }), "{error}");
    assert!(rig.there().contains(&8), "what came before stays");
    assert!(rig.blocks.bring(&[BlockId(2 * BLOCKS)], &Cancel::new()).is_err());
}

#[test]
fn an_error_for_a_small_budget_names_the_least_sufficient_one() {
    let open = |budget| rig_with(ResidencyOptions { budget, promote: false }, file(None), Box::new(|_, _| Ok(())));
    let Err(Error::OverBudget { need, have: 1000, .. }) = open(1000) else { panic!("1000 bytes do not do") };
    assert!(need < 4 << 20, "{need}");
    assert!(matches!(open(need - 1), Err(Error::OverBudget { need: again, .. }) if again == need));
    let rig = open(need).expect("the least does");
    // Exact jobs can end with this budget.
    let mut lease = rig.residency.lease();
    lease.fetch(&rig.blocks, &[BlockId(500), BlockId(501)], &Cancel::new()).expect("room");
    let snapshot = lease.snapshot(&rig.blocks).expect("room");
    assert_eq!([0, 500, 501].map(|b| snapshot.block(BlockId(b)).map(|w| w[0])), [Some(0), Some(500), Some(501)]);
    rig.check();
}

#[test]
fn a_model_that_fits_is_read_in_the_order_of_the_file() {
    let rig = rig(1 << 30, true);
    assert!(!rig.residency.pump(), "not before it is opened");
    rig.blocks.opened();
    let mut last = 0;
    while rig.residency.pump() {
        let there = rig.there();
        assert_eq!(there.len() as u32, there[there.len() - 1] + 1, "in order");
        // When all blocks are in memory, huge pages are collapsed.
        assert!(there.len() > last || last == BLOCKS as usize);
        last = there.len();
    }
    // Ids are not read ahead; neighbours are read in one run.
    assert_eq!(rig.there().len() as u32, BLOCKS);
    assert!(rig.reads() < BLOCKS / 20, "{} reads", rig.reads());
    let small = self::rig(budget_for(0.9), true);
    small.blocks.opened();
    assert!(!small.residency.pump(), "not what does not fit");
}

/// The search for blocks to read holds a lock that frames take.
#[test]
fn reading_ahead_searches_no_model_in_vain() {
    for share in [0.5, 1.2] {
        let rig = rig(budget_for(share), true);
        rig.blocks.opened();
        rig.pump_all();
        assert_eq!(rig.there().len() == BLOCKS as usize, share > 1.0);
        let before = rig.looks.load(SeqCst);
        (0..100).for_each(|_| assert!(!rig.residency.pump()));
        assert_eq!(rig.looks.load(SeqCst), before, "with {share} of the model's bytes");
        // Evictions and reads are counted.
        let some: Vec<BlockId> = (100..140).map(BlockId).collect();
        rig.blocks.fetch(&some, &Cancel::new()).expect("there is room");
        let there = rig.there();
        let lacking = (0..BLOCKS).filter(|id| !there.contains(id)).map(|id| rig.blocks.slot_bytes(BlockId(id)));
        assert_eq!(rig.blocks.inner.promoted_lacking(), lacking.sum::<u64>());
    }
}

#[test]
fn failed_blocks_are_searched_once() {
    let rig =
        rig_with(ResidencyOptions { budget: budget_for(1.2), promote: true }, file(Some(300)), Box::new(|_, _| Ok(())))
            .expect("a model");
    rig.blocks.opened();
    rig.pump_all_unchecked();
    assert!(rig.there().len() == BLOCKS as usize - 1 && rig.blocks.why_failed(BlockId(300)).is_some());
    let before = rig.looks.load(SeqCst);
    (0..100).for_each(|_| assert!(!rig.residency.pump()));
    assert_eq!(rig.looks.load(SeqCst), before);
}

#[test]
fn a_complete_model_is_collapsed_once() {
    let rig = rig(budget_for(1.5), false);
    let ids: Vec<BlockId> = (0..BLOCKS).map(BlockId).collect();
    assert_eq!(rig.blocks.bring(&ids, &Cancel::new()).expect("they fit").len(), ids.len());
    assert!(!rig.residency.pump(), "nothing is to be done");
    rig.blocks.completed();
    let (before, reads) = (rig.blocks.snapshot(), rig.reads());
    // One search, then the pages: 9 MB in a row, except for other allocations of this process between the blocks.
    let units = (0..1000).take_while(|_| rig.residency.pump()).count();
    assert!((1..10).contains(&units), "{units}");
    rig.blocks.completed();
    assert!(!rig.residency.pump(), "once is enough");
    assert!(rig.blocks.is_current(&before));
    assert_eq!(rig.reads(), reads);
    rig.check();
}

/// Calls for few rays begin no pass. A block that they use all the time stays while other blocks are read and evicted.
#[test]
fn blocks_in_constant_use_stay() {
    let rig = rig(budget_for(0.05), false);
    // Among blocks with the same stamp the highest id is evicted first.
    let often = BlockId(400);
    rig.blocks.fetch(&[often], &Cancel::new()).expect("room");
    for id in 100..390 {
        assert!(rig.blocks.snapshot().visit(often, rig.residency.now()).is_some(), "it went before {id} came");
        rig.blocks.fetch(&[BlockId(id)], &Cancel::new()).expect("room");
    }
    let there = rig.there().len();
    assert!(there < 100, "{there} of 290 are there: nothing had to go");
}

#[test]
fn leases_take_turns_and_views_keep_their_blocks() {
    let rig = Arc::new(rig(budget_for(0.05), false));
    let view = rig.residency.view();
    view.begin_pass(true);
    view.want(&(100..200).map(|b| rig.wanted(b, 1.0)).collect::<Vec<_>>());
    rig.pump_all_unchecked();
    let used = rig.there();
    // All blocks are in use: no other block fits beside them.
    assert!(rig.blocks.bring(&[BlockId(300)], &Cancel::new()).expect("no error").is_empty());
    let inside = AtomicU32::new(0);
    std::thread::scope(|threads| {
        for i in 0..4 {
            let (rig, inside) = (&rig, &inside);
            threads.spawn(move || {
                for round in 0..20 {
                    let mut lease = rig.residency.lease();
                    assert_eq!(inside.fetch_add(1, SeqCst), 0, "one at a time");
                    let ids: Vec<BlockId> =
                        (0..20).map(|b| BlockId(300 + (i * 37 + round * 11 + b * 3) % 250)).collect();
                    lease.fetch(&rig.blocks, &ids, &Cancel::new()).expect("room");
                    let snapshot = lease.snapshot(&rig.blocks).expect("room");
                    assert!(ids.iter().all(|id| snapshot.block(*id).is_some_and(|w| w[0] == id.0)));
                    assert!(rig.residency.used() <= rig.residency.budget());
                    inside.fetch_sub(1, SeqCst);
                }
            });
        }
    });
    assert_eq!(rig.there(), used);
    // A request beyond the lease's room is an error, not a wait.
    let all: Vec<BlockId> = (0..BLOCKS).map(BlockId).collect();
    assert!(matches!(rig.residency.lease().fetch(&rig.blocks, &all, &Cancel::new()), Err(Error::OverBudget { .. })));
}

impl Rig {
    /// Pumps without checking parents: the wants are artificial here.
    pub(super) fn pump_all_unchecked(&self) {
        while self.residency.pump() {}
    }
}

#[test]
fn a_stuck_read_stops_no_other() {
    let (gate, stuck) = (Arc::new(Barrier::new(2)), Arc::new(Mutex::new(None::<u64>)));
    let (wait, place) = (Arc::clone(&gate), Arc::clone(&stuck));
    let on_read = Box::new(move |_, offset| {
        if *place.lock().expect("the place") == Some(offset) {
            wait.wait();
        }
        Ok(())
    });
    let rig = rig_with(ResidencyOptions { budget: 1 << 30, promote: false }, file(None), on_read).expect("a model");
    *stuck.lock().expect("the place") = Some(rig.blocks.file().directory()[200].offset);
    let fetchers = rig.residency.start(2).expect("threads");
    let view = rig.residency.view();
    let (come, came) = std::sync::mpsc::channel();
    view.on_change(Some(Arc::new(move || {
        let _ = come.send(());
    })));
    view.begin_pass(true);
    view.want(&[rig.wanted(200, 9.0), rig.wanted(300, 1.0), rig.wanted(400, 0.5)]);
    while !(rig.there().contains(&300) && rig.there().contains(&400)) {
        came.recv_timeout(Duration::from_secs(60)).expect("others come");
    }
    assert_eq!(view.status().state, ViewState::Busy);
    gate.wait();
    while view.status().state != ViewState::Satisfied {
        came.recv_timeout(Duration::from_secs(60)).expect("the last comes");
    }
    drop(fetchers);
}

#[test]
fn concurrent_users_stay_within_the_budget_and_see_their_blocks() {
    let rig = Arc::new(rig(budget_for(0.1), true));
    let fetchers = rig.residency.start(3).expect("threads");
    std::thread::scope(|threads| {
        for i in 0..2u32 {
            let rig = &rig;
            threads.spawn(move || {
                let eye = Eye::new(rig, 0.05 + 0.1 * i as f32);
                for step in 0..150 {
                    eye.pass(rig, (step as f32 * 0.37 + i as f32 * 0.5) % 1.0, true);
                    assert!(rig.residency.used() <= rig.residency.budget());
                }
            });
            threads.spawn(move || {
                for step in 0..150 {
                    let ids: Vec<BlockId> = (0..6).map(|b| BlockId((step * 31 + b * 97 + i * 13) % BLOCKS)).collect();
                    let held = rig.blocks.bring(&ids, &Cancel::new()).expect("no error");
                    assert!(held.iter().all(|(id, slot)| slot.words()[0] == id.0));
                    if held.len() < ids.len() {
                        let mut lease = rig.residency.lease();
                        lease.fetch(&rig.blocks, &ids, &Cancel::new()).expect("room");
                        let snapshot = lease.snapshot(&rig.blocks).expect("room");
                        assert!(ids.iter().all(|id| snapshot.block(*id).is_some_and(|w| w[0] == id.0)));
                    }
                }
            });
        }
    });
    drop(fetchers);
    let Ok(Rig { residency, blocks, .. }) = Arc::try_unwrap(rig) else { panic!("nobody else has it") };
    drop(blocks);
    assert_eq!(residency.used(), 0);
}
