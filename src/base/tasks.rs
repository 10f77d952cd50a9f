//! Workers that serve jobs: our own threads, the host's executor, or the caller stepping.
//!
//! A [`Job`] is [`Work`] in rounds of items. Workers take items one by one and turn to the next job every
//! millisecond, so that several jobs advance together. They share one queue under a mutex, taken once a slice, not
//! once an item; the handle of each job, for its end and its rounds; and [`super::round`]. No lock is held while
//! work, a callback or the executor runs.

use super::error::{Error, Result};
use super::handle::{Handle, WakeFn};
use super::round::Round;
use std::any::Any;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long a worker stays with one job before it turns to the next.
const SLICE: Duration = Duration::from_millis(1);
/// How long a task keeps a thread of the host before it is handed in anew.
const HOST_SLICE: Duration = Duration::from_millis(5);

/// What a job does. All methods may be called from any worker.
pub trait Work: Send + Sync {
    /// Works on one item of the present round; called once for each, several at once. An error ends
    /// the job: items not yet begun are dropped.
    fn run(&self, item: usize) -> Result<()>;
    /// Called when all items of a round are finished: the number of items of the next, 0 for the end.
    fn round_done(&self) -> Result<usize> {
        Ok(0)
    }
    /// Called once, last; nothing else of this work runs then or later.
    fn ended(&self, ending: &Ending) {
        let _ = ending;
    }
}

/// How a job ended.
#[derive(Debug, Clone)]
pub enum Ending {
    /// All rounds were worked through.
    Finished,
    /// Cancelled before.
    Cancelled,
    /// An item failed, or panicked ([`Error::Internal`]).
    Failed(Arc<Error>),
}

impl Ending {
    /// The result of a call that waited for the job.
    pub(crate) fn into_result(self) -> Result<()> {
        match self {
            Ending::Finished => Ok(()),
            Ending::Cancelled => Err(Error::Cancelled),
            Ending::Failed(error) => Err(Error::clone(&error)),
        }
    }
}

/// The host's threads.
pub trait Executor: Send + Sync {
    /// How many tasks it can run at once; at most so many are handed in at a time.
    fn concurrency(&self) -> usize;
    /// Runs the task soon, on any thread; may also run it at once. Called from any thread of the
    /// host, never under a lock of ours. A task dropped without being run is work
    /// left to the others.
    fn submit(&self, task: Task);
}

/// A piece of work for an [`Executor`]: call [`Task::run`] once.
pub struct Task(Option<Arc<Shared>>);

impl Task {
    /// Works for a few milliseconds.
    pub fn run(mut self) {
        if let Some(shared) = self.0.take() {
            shared.serve_as_task();
        }
    }
}

impl Drop for Task {
    fn drop(&mut self) {
        if let Some(shared) = self.0.take() {
            lock(&shared.queue).tasks_out -= 1;
        }
    }
}

thread_local! {
    /// Inside `Executor::submit`: a task that runs now would recurse if it handed in another.
    static SUBMITTING: Cell<bool> = const { Cell::new(false) };
    /// Inside an item: a thread that waits here has to work, or it would wait for itself.
    static WORKING: Cell<bool> = const { Cell::new(false) };
    /// Whose tasks were run inside an item, and left their work: it is handed in again when the item is done.
    static LEFT: RefCell<Vec<Arc<Shared>>> = const { RefCell::new(Vec::new()) };
}

/// Does what is an item's work.
fn working(work: impl FnOnce()) {
    let before = WORKING.replace(true);
    work();
    WORKING.set(before);
    serve_left();
}

/// Outside of all items, has the work served that tasks left inside of them. (Not from inside `submit`: a thread that
/// serves there goes on until nothing is open.)
fn serve_left() {
    if !WORKING.get() && !SUBMITTING.get() {
        // A thread that ends has none any more.
        let left = LEFT.try_with(RefCell::take).unwrap_or_default();
        left.into_iter().for_each(|shared| shared.hand_in_for_open());
    }
}

/// Wraps what a worker does with its thread set up as needed (rounding modes, say).
pub type Around = fn(&mut dyn FnMut());

/// A pool of workers. Dropping it cancels all jobs and ends its threads.
pub struct Pool {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

/// What workers share.
struct Shared {
    queue: Mutex<Queue>,
    /// Signalled when the queue gains a job or the pool stops.
    work_there: Condvar,
    executor: Option<Arc<dyn Executor>>,
    around: Around,
    /// Threads of its own. Without any a waiter has to work itself.
    threads: usize,
}

#[derive(Default)]
struct Queue {
    /// Rounds that may have unclaimed items, next to be served first.
    open: VecDeque<(Arc<Inner>, Arc<Round>)>,
    /// Tasks handed to the executor and not yet returned.
    tasks_out: usize,
    stop: bool,
}

impl Queue {
    /// Counts tasks that are handed in after this: as many as there are places free of `hands`, `most` of them at most.
    fn count_tasks(&mut self, hands: usize, most: usize) -> usize {
        let tasks = hands.saturating_sub(self.tasks_out).min(most);
        self.tasks_out += tasks;
        tasks
    }
}

/// A job in a pool: a handle, cloneable; the job goes on without it.
#[derive(Clone)]
pub struct Job {
    inner: Arc<Inner>,
    shared: Arc<Shared>,
}

struct Inner {
    work: WorkRef,
    /// Notified when the job begins a round.
    handle: Handle<Ending, State>,
}

struct State {
    round: Arc<Round>,
    cancelled: bool,
    /// The first failure.
    failure: Option<Error>,
}

/// Work that the job owns, or that the caller of [`Pool::run_scoped`] owns.
enum WorkRef {
    Owned(Arc<dyn Work>),
    Scoped(ScopedWork),
}

/// Borrowed work with its lifetime erased: see [`Pool::run_scoped`].
struct ScopedWork(*const (dyn Work + 'static));

// SAFETY: `Work` is `Sync`, so a shared borrow of it may be used from any thread.
unsafe impl Send for ScopedWork {}
// SAFETY: as above.
unsafe impl Sync for ScopedWork {}

impl WorkRef {
    /// Threads that wait for it work on it.
    fn is_scoped(&self) -> bool {
        matches!(self, WorkRef::Scoped(_))
    }

    fn get(&self) -> &dyn Work {
        match self {
            WorkRef::Owned(work) => &**work,
            // SAFETY: only called before the job has ended (items claimed and not completed, or the one
            // that was told that the round is over), and `run_scoped` keeps the borrow alive until then.
            WorkRef::Scoped(work) => unsafe { &*work.0 },
        }
    }
}

/// Locks; a panic elsewhere does not matter, the data under our locks is valid at every step.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pool {
    /// A pool with `threads` threads of its own, or with the host's `executor` and none.
    /// `around` wraps the work of every thread. Fails if a thread cannot be started.
    pub fn new(threads: usize, executor: Option<Arc<dyn Executor>>, around: Around) -> Result<Self> {
        let threads = if executor.is_some() { 0 } else { threads };
        let shared =
            Arc::new(Shared { queue: Mutex::default(), work_there: Condvar::new(), executor, around, threads });
        let mut pool = Self { shared, threads: Vec::new() };
        for i in 0..threads {
            let shared = Arc::clone(&pool.shared);
            let thread = std::thread::Builder::new()
                .name(format!("outcrop {i}"))
                .spawn(move || shared.serve_until_stopped())
                .map_err(|e| Error::io("worker thread", "start", e))?;
            pool.threads.push(thread);
        }
        Ok(pool)
    }

    /// Threads of its own.
    pub fn threads(&self) -> usize {
        self.threads.len()
    }

    /// How many workers may serve a job at once, at least 1.
    pub fn concurrency(&self) -> usize {
        let hosts = self.shared.executor.as_ref().map_or(0, |e| e.concurrency());
        self.threads.len().max(hosts).max(1)
    }

    /// Begins a job with a first round of `items`; returns at once. With 0 items it ends at once, here.
    pub fn submit(&self, items: usize, work: Arc<dyn Work>) -> Job {
        self.begin(items, WorkRef::Owned(work))
    }

    /// Runs a job to its end, and returns how it ended: the only way to work on borrowed data.
    ///
    /// The caller works too, in place of one of the threads: to wake a thread, and to be woken by it, takes longer than
    /// small work does.
    pub fn run_scoped(&self, items: usize, work: &dyn Work) -> Ending {
        if items <= 1 {
            return self.run_here(items, work);
        }
        // SAFETY: only the lifetime changes. The pointer is followed only until the job's ending is
        // set (`WorkRef::get`), and no caller leaves before that: neither by returning, nor by unwinding (`Ended`).
        let work: *const (dyn Work + 'static) =
            unsafe { std::mem::transmute::<*const (dyn Work + '_), *const (dyn Work + 'static)>(work) };
        let job = Ended(self.begin(items, WorkRef::Scoped(ScopedWork(work))));
        job.0.wait_to_the_end()
    }

    /// Does something small in the caller's thread, set up as a worker's is; it must not wait for work. A panic becomes
    /// an error.
    pub fn here<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let (mut work, mut done) = (Some(work), None);
        (self.shared.around)(&mut || done = work.take().map(caught));
        done.unwrap_or_else(|| Err(Error::Internal("what is to be around work did not do it".into())))
    }

    /// Works through all rounds in the caller's thread.
    fn run_here(&self, mut items: usize, work: &dyn Work) -> Ending {
        let mut ending = Ending::Finished;
        working(|| {
            (self.shared.around)(&mut || {
                let rounds = caught(|| {
                    while items > 0 {
                        (0..items).try_for_each(|item| work.run(item))?;
                        items = work.round_done()?;
                    }
                    Ok(())
                });
                if let Err(error) = rounds {
                    ending = Ending::Failed(Arc::new(error));
                }
            });
        });
        quietly(|| work.ended(&ending));
        ending
    }

    fn begin(&self, items: usize, work: WorkRef) -> Job {
        let round = Arc::new(Round::new(items));
        let state = State { round, cancelled: false, failure: None };
        let inner = Arc::new(Inner { work, handle: Handle::new(state) });
        let job = Job { inner, shared: Arc::clone(&self.shared) };
        if items == 0 {
            self.shared.end_round(&job.inner);
        } else {
            self.shared.open_round(&job.inner, items);
        }
        job
    }

    /// Works on one item in the caller's thread; `false` if there was none.
    pub fn step(&self) -> bool {
        let Some((job, round)) = self.shared.next_open() else { return false };
        self.shared.serve(&job, &round, Duration::ZERO);
        true
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        let open: Vec<_> = {
            let mut queue = lock(&self.shared.queue);
            queue.stop = true;
            queue.open.drain(..).collect()
        };
        self.shared.work_there.notify_all();
        for (job, _) in open {
            self.shared.cancel(&job);
        }
        let me = std::thread::current().id();
        for thread in self.threads.drain(..) {
            // The last owner may be a worker itself, dropping what its job held.
            if thread.thread().id() != me {
                let _ = thread.join();
            }
        }
    }
}

/// A job that has ended when this is gone, even where what waits for it unwinds. (Work's panics are caught; what a
/// panic says may panic again when it is dropped.)
struct Ended(Job);

impl Drop for Ended {
    fn drop(&mut self) {
        self.0.cancel();
        self.0.wait_to_the_end();
    }
}

impl Job {
    /// [`Job::wait`] for as long as it takes.
    pub fn wait_to_the_end(&self) -> Ending {
        loop {
            if let Some(ending) = self.wait(Duration::from_secs(3600)) {
                return ending;
            }
        }
    }

    /// Asks the job to end: items not yet begun are dropped. When none is running it has ended when this returns.
    pub fn cancel(&self) {
        self.shared.cancel(&self.inner);
    }

    /// How it ended; `None` while it runs. Never blocks.
    pub fn ending(&self) -> Option<Ending> {
        self.inner.handle.ending()
    }

    /// Waits for the end, and for the return of a wake function that another thread calls, `timeout` at most. Works
    /// itself where the pool has no threads, on scoped work, and inside other work.
    pub fn wait(&self, timeout: Duration) -> Option<Ending> {
        let works = self.shared.threads == 0 || self.inner.work.is_scoped() || WORKING.get();
        let todo = |state: &State| (works && state.round.has_items()).then(|| Arc::clone(&state.round));
        let work = |round, time: Duration| self.shared.serve(&self.inner, &round, time.min(SLICE));
        self.inner.handle.wait_working(timeout, todo, work)
    }

    /// See [`Handle::set_wake`]. Nothing of the work runs any more when it is called.
    pub(crate) fn set_wake(&self, wake: Option<WakeFn>) {
        self.inner.handle.set_wake(wake);
    }
}

impl Shared {
    /// The job to serve next; it goes to the back of the queue. `None` if there is none.
    fn next_open(&self) -> Option<(Arc<Inner>, Arc<Round>)> {
        take_turn(&mut lock(&self.queue))
    }

    /// A thread of our own.
    fn serve_until_stopped(self: &Arc<Self>) {
        loop {
            let mut queue = lock(&self.queue);
            let (job, round) = loop {
                if queue.stop {
                    return;
                }
                if let Some(turn) = take_turn(&mut queue) {
                    break turn;
                }
                queue = self.work_there.wait(queue).unwrap_or_else(PoisonError::into_inner);
            };
            drop(queue);
            self.serve(&job, &round, SLICE);
        }
    }

    /// A task on a thread of the host.
    fn serve_as_task(self: Arc<Self>) {
        // Run from inside `submit`: handing in another task would recurse, so all is done now.
        let inline = SUBMITTING.get();
        if inline && WORKING.get() {
            // The item that handed it in may hold what others' items wait for (a lease).
            lock(&self.queue).tasks_out -= 1;
            let _ = LEFT.try_with(|left| left.borrow_mut().push(self));
            return;
        }
        let begun = Instant::now();
        loop {
            let (turn, again) = {
                let mut queue = lock(&self.queue);
                let late = !inline && begun.elapsed() >= HOST_SLICE;
                let turn = if late || queue.stop { None } else { take_turn(&mut queue) };
                // Leaving and the count change together: a thread that opens a round after this sees the
                // free place.
                let again = turn.is_none() && late && !queue.open.is_empty();
                if turn.is_none() && !again {
                    queue.tasks_out -= 1;
                }
                (turn, again)
            };
            match turn {
                Some((job, round)) => self.serve(&job, &round, SLICE),
                None if again => return self.hand_in(),
                None => return,
            }
        }
    }

    /// Hands one task, already counted, to the executor.
    fn hand_in(self: &Arc<Self>) {
        if let Some(executor) = &self.executor {
            let before = SUBMITTING.replace(true);
            // Dropped by a host that panics, it is work left to the others.
            quietly(|| executor.submit(Task(Some(Arc::clone(self)))));
            SUBMITTING.set(before);
            serve_left();
        }
    }

    /// Works on items of a round for `time` (one item at least, if there is one).
    fn serve(self: &Arc<Self>, job: &Arc<Inner>, round: &Arc<Round>, time: Duration) {
        working(|| {
            (self.around)(&mut || {
                let begun = Instant::now();
                while let Some(item) = round.claim() {
                    self.run_item(job, round, item);
                    if begun.elapsed() >= time {
                        return;
                    }
                }
                lock(&self.queue).open.retain(|(_, r)| !Arc::ptr_eq(r, round));
            });
        });
    }

    fn run_item(self: &Arc<Self>, job: &Arc<Inner>, round: &Round, item: usize) {
        if let Err(error) = caught(|| job.work.get().run(item)) {
            job.handle.lock().failure.get_or_insert(error);
            // Our own item is not completed yet: draining cannot end the round.
            let _ = round.drain();
        }
        if round.complete() {
            self.end_round(job);
        }
    }

    /// Called by the one that was told that the present round is over.
    fn end_round(self: &Arc<Self>, job: &Arc<Inner>) {
        let failed = {
            let state = job.handle.lock();
            state.failure.is_some() || state.cancelled
        };
        let next = if failed { Ok(0) } else { caught(|| job.work.get().round_done()) };
        let ending = {
            let mut state = job.handle.lock();
            let items = next.unwrap_or_else(|error| {
                state.failure.get_or_insert(error);
                0
            });
            if let Some(error) = state.failure.take() {
                Ending::Failed(Arc::new(error))
            } else if state.cancelled {
                Ending::Cancelled
            } else if items == 0 {
                Ending::Finished
            } else {
                state.round = Arc::new(Round::new(items));
                drop(state);
                job.handle.notify();
                return self.open_round(job, items);
            }
        };
        // A cancelled round may still be queued: nothing of an ended job stays behind.
        lock(&self.queue).open.retain(|(j, _)| !Arc::ptr_eq(j, job));
        quietly(|| job.work.get().ended(&ending));
        quietly(|| job.handle.end(ending));
    }

    /// Tasks that the executor, if there is one, has at a time.
    fn hands(&self) -> usize {
        self.executor.as_ref().map_or(0, |e| e.concurrency().max(1))
    }

    /// Puts a job's new round where workers find it.
    fn open_round(self: &Arc<Self>, job: &Arc<Inner>, items: usize) {
        let round = Arc::clone(&job.handle.lock().round);
        let hands = self.hands();
        let tasks = {
            let mut queue = lock(&self.queue);
            if round.has_items() {
                queue.open.push_back((Arc::clone(job), round));
            }
            queue.count_tasks(hands, items)
        };
        for _ in 0..items.min(self.threads).saturating_sub(usize::from(job.work.is_scoped())) {
            self.work_there.notify_one();
        }
        for _ in 0..tasks {
            self.hand_in();
        }
    }

    /// Hands in as many tasks as there are open rounds, and places free.
    fn hand_in_for_open(self: &Arc<Self>) {
        let hands = self.hands();
        let tasks = {
            let mut queue = lock(&self.queue);
            let open = queue.open.len();
            queue.count_tasks(hands, open)
        };
        (0..tasks).for_each(|_| self.hand_in());
    }

    fn cancel(self: &Arc<Self>, job: &Arc<Inner>) {
        let over = {
            // Under the lock: a round that begins after this one sees the flag instead.
            let mut state = job.handle.lock();
            if state.ending().is_some() {
                return;
            }
            state.cancelled = true;
            state.round.drain()
        };
        // A pool without threads may never look into the queue again, which would keep the work alive.
        lock(&self.queue).open.retain(|(open, _)| !Arc::ptr_eq(open, job));
        if over {
            self.end_round(job);
        }
    }
}

/// Takes the first open round and puts it last.
fn take_turn(queue: &mut Queue) -> Option<(Arc<Inner>, Arc<Round>)> {
    while let Some((job, round)) = queue.open.pop_front() {
        if round.has_items() {
            queue.open.push_back((Arc::clone(&job), Arc::clone(&round)));
            return Some((job, round));
        }
    }
    None
}

/// Runs `f`, turning a panic into [`Error::Internal`].
fn caught<T>(f: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(f)).unwrap_or_else(|panic| Err(Error::Internal(message(&*panic))))
}

/// Runs `f`, and drops a panic in it.
fn quietly(f: impl FnOnce()) {
    let _ = catch_unwind(AssertUnwindSafe(f));
}

/// What a panic said.
fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    format!("a worker panicked: {}", text.unwrap_or("no message"))
}

#[cfg(test)]
#[path = "tasks_tests.rs"]
mod tests;
