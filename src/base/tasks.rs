//! Workers that serve jobs: threads of the pool, the host's executor, or the caller, which works step by step.
//!
//! A [`Job`] is [`Work`] in rounds of items. Workers claim items one by one and turn to the next job every millisecond,
//! so that several jobs advance side by side. Workers share one queue under a mutex, which they take once per slice of
//! time and not once per item; the handle of each job, with its end and its present round; and the rounds
//! ([`super::round`]). No lock is held while work, a callback or the executor runs.

use super::error::{Error, Result};
use super::handle::{Handle, WakeFn};
use super::inside_read::refuse_inside_read;
use super::reserve;
use super::round::Round;
use super::threads;
use std::any::Any;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time that a worker serves one job before it turns to the next.
const SLICE: Duration = Duration::from_millis(1);
/// Time that a task occupies a thread of the host before it is submitted anew.
const HOST_SLICE: Duration = Duration::from_millis(5);

/// The work of a job. Any worker may call any method.
pub trait Work: Send + Sync {
    /// Works on one item of the present round. It is called once for each item, for several items at the same time. An
    /// error ends the job: items that have not begun are dropped.
    fn run(&self, item: usize) -> Result<()>;
    /// Called when all items of a round are finished. Returns the number of items of the next round; 0 ends the job.
    fn round_done(&self) -> Result<usize> {
        Ok(0)
    }
    /// Called once, as the last call of this work.
    fn ended(&self, ending: &Ending) {
        let _ = ending;
    }
}

/// How a job has ended.
#[derive(Debug, Clone)]
pub enum Ending {
    /// All rounds were completed.
    Finished,
    /// The job was cancelled before.
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
    /// Number of tasks that the executor can run at once. The pool submits at most this many at a time.
    fn concurrency(&self) -> usize;
    /// Runs the task soon, on any thread; it may also run it before it returns. Any thread of the host may call this,
    /// and none of them holds a lock of this crate. If a task is dropped without being run, other workers do its work.
    fn submit(&self, task: Task);
}

/// A piece of work for an [`Executor`], which calls [`Task::run`] once.
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
    /// True inside `Executor::submit`. A task that runs there would recurse if it submitted another task.
    static SUBMITTING: Cell<bool> = const { Cell::new(false) };
    /// True inside an item. A thread that waits there has to work, or it would wait for itself.
    static WORKING: Cell<bool> = const { Cell::new(false) };
    /// The pools of tasks that were run inside an item and left their work. Tasks are submitted again when the item is
    /// done.
    static LEFT: RefCell<Vec<Arc<Shared>>> = const { RefCell::new(Vec::new()) };
}

/// Runs the work of an item.
fn working(work: impl FnOnce()) {
    let before = WORKING.replace(true);
    work();
    WORKING.set(before);
    serve_left();
}

/// Submits tasks again for the work that tasks left inside items, if this thread is outside of all items. (Not inside
/// `submit`: a thread that serves there goes on until no round is open.)
fn serve_left() {
    if !WORKING.get() && !SUBMITTING.get() {
        // A thread that is ending has no list any more.
        let left = LEFT.try_with(RefCell::take).unwrap_or_default();
        left.into_iter().for_each(|shared| shared.hand_in_for_open());
    }
}

/// A function that wraps the work of a worker and sets the thread up for it, for instance its rounding mode.
pub type Around = fn(&mut dyn FnMut());

/// A pool of workers. Dropping it cancels all jobs and ends its threads.
pub struct Pool {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

/// Data that the workers share.
struct Shared {
    queue: Mutex<Queue>,
    /// Signalled when the queue gains a job or the pool stops.
    work_there: Condvar,
    executor: Option<Arc<dyn Executor>>,
    around: Around,
    /// Number of threads of the pool itself. Without any, a waiting thread has to work.
    threads: usize,
}

#[derive(Default)]
struct Queue {
    /// Rounds that may have unclaimed items; the first is served next.
    open: VecDeque<(Arc<Inner>, Arc<Round>)>,
    /// Number of tasks that the executor has not yet returned.
    tasks_out: usize,
    stop: bool,
}

impl Queue {
    /// Counts tasks that the caller submits afterwards, and returns their number: as many as there are free places of
    /// `hands`, but at most `most`.
    fn count_tasks(&mut self, hands: usize, most: usize) -> usize {
        let tasks = hands.saturating_sub(self.tasks_out).min(most);
        self.tasks_out += tasks;
        tasks
    }
}

/// A job in a pool: a cloneable handle. The job continues if all handles are dropped.
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

// SAFETY: `Work` is `Sync`, so any thread may use a shared borrow of it.
unsafe impl Send for ScopedWork {}
// SAFETY: as above.
unsafe impl Sync for ScopedWork {}

impl WorkRef {
    /// True if threads that wait for the job also work on it.
    fn is_scoped(&self) -> bool {
        matches!(self, WorkRef::Scoped(_))
    }

    fn get(&self) -> &dyn Work {
        match self {
            WorkRef::Owned(work) => &**work,
            // SAFETY: `get` is called only before the job has ended: by threads with a claimed item that is not
            // completed, or by the one that ended the round. `run_scoped` keeps the borrow alive until the end.
            WorkRef::Scoped(work) => unsafe { &*work.0 },
        }
    }
}

/// Locks `mutex`. A panic of another thread does not matter: the data under the locks of this module is valid at every
/// step.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pool {
    /// A pool with `threads` threads of its own, or with the host's `executor` and no threads. `around` wraps the work
    /// of every thread. Fails if a thread cannot be started.
    pub fn new(threads: usize, executor: Option<Arc<dyn Executor>>, around: Around) -> Result<Self> {
        let threads = if executor.is_some() { 0 } else { threads };
        let shared =
            Arc::new(Shared { queue: Mutex::default(), work_there: Condvar::new(), executor, around, threads });
        let mut pool = Self { shared, threads: Vec::new() };
        for i in 0..threads {
            let shared = Arc::clone(&pool.shared);
            let thread = threads::named(format!("outcrop {i}"))
                .spawn(move || shared.serve_until_stopped())
                .map_err(|e| Error::io("worker thread", "start", e))?;
            pool.threads.push(thread);
        }
        Ok(pool)
    }

    /// Number of threads of the pool itself.
    pub fn threads(&self) -> usize {
        self.threads.len()
    }

    /// Number of workers that may serve a job at once, at least 1.
    pub fn concurrency(&self) -> usize {
        let hosts = self.shared.executor.as_ref().map_or(0, |e| e.concurrency());
        self.threads.len().max(hosts).max(1)
    }

    /// Begins a job with a first round of `items` items, and returns at once. A job with 0 items ends in this call.
    pub fn submit(&self, items: usize, work: Arc<dyn Work>) -> Job {
        self.begin(items, WorkRef::Owned(work))
    }

    /// Runs a job to its end, and returns how it ended. This is the only way to work on borrowed data.
    ///
    /// The caller works too, in place of one of the threads: to wake a thread, and to be woken by it, takes longer than
    /// small work does.
    pub fn run_scoped(&self, items: usize, work: &dyn Work) -> Ending {
        if let Err(error) = refuse_inside_read() {
            return Ending::Failed(Arc::new(error));
        }
        if items <= 1 {
            return self.run_here(items, work);
        }
        // SAFETY: only the lifetime changes. The pointer is dereferenced only until the job's ending is set
        // (`WorkRef::get`), and the caller does not leave before that: neither by returning, nor by unwinding
        // (`Ended`).
        let work: *const (dyn Work + 'static) =
            unsafe { std::mem::transmute::<*const (dyn Work + '_), *const (dyn Work + 'static)>(work) };
        let job = Ended(self.begin(items, WorkRef::Scoped(ScopedWork(work))));
        job.0.wait_to_the_end()
    }

    /// Runs something small in the caller's thread, which is set up like a worker's. It must not wait for other work. A
    /// panic becomes an error.
    pub fn here<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        refuse_inside_read()?;
        let (mut work, mut done) = (Some(work), None);
        (self.shared.around)(&mut || done = work.take().map(caught));
        done.unwrap_or_else(|| Err(Error::Internal("the wrapper of the work did not run it".into())))
    }

    /// Works through all rounds in the caller's thread.
    fn run_here(&self, mut items: usize, work: &dyn Work) -> Ending {
        let mut ending = Ending::Finished;
        working(|| {
            (self.shared.around)(&mut || {
                let rounds = caught(|| {
                    while items > 0 {
                        (0..items).try_for_each(|item| reserve::check().and_then(|()| work.run(item)))?;
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

    /// Works on one item in the caller's thread. Returns `false` if there was none.
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
            // The last owner of the pool may be one of its workers, which drops the data of a job.
            if thread.thread().id() != me {
                let _ = thread.join();
            }
        }
    }
}

/// A job that is over once this is dropped, even if the waiting thread unwinds. (Panics of the work are caught, but the
/// payload of a panic may panic again when it is dropped.)
struct Ended(Job);

impl Drop for Ended {
    fn drop(&mut self) {
        self.0.cancel();
        self.0.wait_to_the_end();
    }
}

impl Job {
    /// [`Job::wait`] without a limit of time.
    pub fn wait_to_the_end(&self) -> Ending {
        loop {
            if let Some(ending) = self.wait(Duration::from_secs(3600)) {
                return ending;
            }
        }
    }

    /// Cancels the job: items that have not begun are dropped. If no item is running, the job has ended when this
    /// returns.
    pub fn cancel(&self) {
        self.shared.cancel(&self.inner);
    }

    /// How the job has ended; `None` while it runs. Never blocks.
    pub fn ending(&self) -> Option<Ending> {
        self.inner.handle.ending()
    }

    /// Waits, for `timeout` at most, for the end and for the return of a wake function that another thread calls. The
    /// thread works meanwhile if the pool has no threads, if the work is scoped, or if the thread is inside an item.
    pub fn wait(&self, timeout: Duration) -> Option<Ending> {
        let works = self.shared.threads == 0 || self.inner.work.is_scoped() || WORKING.get();
        let todo = |state: &State| (works && state.round.has_items()).then(|| Arc::clone(&state.round));
        let work = |round, time: Duration| self.shared.serve(&self.inner, &round, time.min(SLICE));
        self.inner.handle.wait_working(timeout, todo, work)
    }

    /// Like [`Handle::set_wake`]. No work of the job runs any more when the function is called.
    pub(crate) fn set_wake(&self, wake: Option<WakeFn>) {
        self.inner.handle.set_wake(wake);
    }
}

impl Shared {
    /// Returns the round to serve next, which goes to the back of the queue. `None` if there is none.
    fn next_open(&self) -> Option<(Arc<Inner>, Arc<Round>)> {
        take_turn(&mut lock(&self.queue))
    }

    /// The loop of a thread of the pool.
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

    /// The work of a task on a thread of the host.
    fn serve_as_task(self: Arc<Self>) {
        // Inside `submit`, to submit another task would recurse. The task therefore goes on until no round is open.
        let inline = SUBMITTING.get();
        if inline && WORKING.get() {
            // The item that submitted the task may hold a resource that items of others wait for (a lease).
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
                // The decision to leave and the change of the count are one step under the lock: a thread that opens a
                // round after this sees the free place.
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

    /// Submits one task, which is already counted, to the executor.
    fn hand_in(self: &Arc<Self>) {
        if let Some(executor) = &self.executor {
            let before = SUBMITTING.replace(true);
            // If the host panics, the task is dropped, and other workers do its work.
            quietly(|| executor.submit(Task(Some(Arc::clone(self)))));
            SUBMITTING.set(before);
            serve_left();
        }
    }

    /// Works on items of a round for `time`, and on at least one item if there is one.
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
        if let Err(error) = caught(|| reserve::check().and_then(|()| job.work.get().run(item))) {
            job.handle.lock().failure.get_or_insert(error);
            // The item of this thread is not completed yet, so draining cannot end the round.
            let _ = round.drain();
        }
        if round.complete() {
            self.end_round(job);
        }
    }

    /// Called by the participant that ended the present round.
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
        // A cancelled round may still be queued. No entry of an ended job stays in the queue.
        lock(&self.queue).open.retain(|(j, _)| !Arc::ptr_eq(j, job));
        quietly(|| job.work.get().ended(&ending));
        quietly(|| job.handle.end(ending));
    }

    /// Number of tasks that the executor has at a time; 0 without an executor.
    fn hands(&self) -> usize {
        self.executor.as_ref().map_or(0, |e| e.concurrency().max(1))
    }

    /// Puts a job's new round into the queue, and wakes workers.
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

    /// Submits one task for each open round, as far as places are free.
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
        // A pool without threads may never read the queue again; an entry that stays would keep the work alive.
        lock(&self.queue).open.retain(|(open, _)| !Arc::ptr_eq(open, job));
        if over {
            self.end_round(job);
        }
    }
}

/// Takes the first round with unclaimed items and moves it to the back.
fn take_turn(queue: &mut Queue) -> Option<(Arc<Inner>, Arc<Round>)> {
    while let Some((job, round)) = queue.open.pop_front() {
        if round.has_items() {
            queue.open.push_back((Arc::clone(&job), Arc::clone(&round)));
            return Some((job, round));
        }
    }
    None
}

/// Runs `f`; a panic becomes [`Error::Internal`].
fn caught<T>(f: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(f)).unwrap_or_else(|panic| Err(Error::Internal(message(&*panic))))
}

/// Runs `f`, and ignores a panic in it.
fn quietly(f: impl FnOnce()) {
    let _ = catch_unwind(AssertUnwindSafe(f));
}

/// Returns the message of a panic.
fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    format!("a worker panicked: {}", text.unwrap_or("no message"))
}

#[cfg(test)]
#[path = "tasks_tests.rs"]
mod tests;
