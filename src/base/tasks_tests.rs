//! Tests of each kind of workers, of panics, cancellation and fairness.

use super::*;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::SeqCst};
use std::sync::mpsc;

fn plain(work: &mut dyn FnMut()) {
    work();
}

fn pool(threads: usize) -> Pool {
    Pool::new(threads, None, plain).unwrap()
}

/// Counts items. Runs `body` in each, for `rounds` rounds.
struct Count<F: Fn(usize) -> Result<()> + Send + Sync> {
    body: F,
    done: AtomicUsize,
    rounds: AtomicUsize,
    items: usize,
    ended: AtomicUsize,
}

impl<F: Fn(usize) -> Result<()> + Send + Sync> Count<F> {
    fn new(items: usize, rounds: usize, body: F) -> Arc<Self> {
        Arc::new(Self {
            body,
            done: AtomicUsize::new(0),
            rounds: AtomicUsize::new(rounds),
            items,
            ended: AtomicUsize::new(0),
        })
    }
}

impl<F: Fn(usize) -> Result<()> + Send + Sync> Work for Count<F> {
    fn run(&self, item: usize) -> Result<()> {
        (self.body)(item)?;
        self.done.fetch_add(1, SeqCst);
        Ok(())
    }
    fn round_done(&self) -> Result<usize> {
        let left = self.rounds.fetch_sub(1, SeqCst) - 1;
        Ok(if left > 0 { self.items } else { 0 })
    }
    fn ended(&self, _: &Ending) {
        self.ended.fetch_add(1, SeqCst);
    }
}

const LONG: Duration = Duration::from_secs(60);

/// Number of threads of this process, as the kernel counts them.
fn threads_now() -> usize {
    std::fs::read_dir("/proc/self/task").unwrap().count()
}

#[test]
fn rounds_follow_each_other_on_threads_and_without() {
    for threads in [0, 1, 3] {
        let pool = pool(threads);
        let work = Count::new(100, 3, |_| Ok(()));
        let job = pool.submit(100, work.clone());
        assert!(matches!(job.wait(LONG), Some(Ending::Finished)), "{threads} threads");
        assert_eq!((work.done.load(SeqCst), work.ended.load(SeqCst)), (300, 1));
    }
}

#[test]
fn a_job_without_items_ends_at_once() {
    let work = Count::new(0, 1, |_| Ok(()));
    let job = pool(0).submit(0, work.clone());
    assert!(matches!(job.ending(), Some(Ending::Finished)));
    assert_eq!(work.ended.load(SeqCst), 1);
}

#[test]
fn stepping_does_one_item_and_turns_between_jobs() {
    let pool = pool(0);
    let (a, b) = (Count::new(3, 1, |_| Ok(())), Count::new(3, 1, |_| Ok(())));
    let jobs = [pool.submit(3, a.clone()), pool.submit(3, b.clone())];
    for step in 1..=6 {
        assert!(pool.step());
        let done = [a.done.load(SeqCst), b.done.load(SeqCst)];
        assert_eq!(done.iter().sum::<usize>(), step);
        assert!(done[0].abs_diff(done[1]) <= 1, "one job runs ahead: {done:?}");
    }
    assert!(!pool.step());
    assert!(jobs.iter().all(|j| matches!(j.ending(), Some(Ending::Finished))));
}

#[test]
fn a_panic_fails_its_job_and_nothing_else() {
    let pool = pool(2);
    let bad = Count::new(1000, 1, |i| if i == 7 { panic!("item {i}") } else { Ok(()) });
    let good = Count::new(1000, 1, |_| Ok(()));
    let (bad_job, good_job) = (pool.submit(1000, bad.clone()), pool.submit(1000, good.clone()));
    match bad_job.wait(LONG) {
        Some(Ending::Failed(e)) => {
            assert!(matches!(&*e, Error::Internal(m) if m.contains("item 7")), "{e}")
        }
        other => panic!("{other:?}"),
    }
    assert!(matches!(good_job.wait(LONG), Some(Ending::Finished)));
    assert_eq!((good.done.load(SeqCst), bad.ended.load(SeqCst)), (1000, 1));
    // The workers survive the panic.
    let again = Count::new(10, 1, |_| Ok(()));
    assert!(matches!(pool.submit(10, again).wait(LONG), Some(Ending::Finished)));
}

#[test]
fn an_error_and_a_panic_between_rounds_end_the_job() {
    struct Between;
    impl Work for Between {
        fn run(&self, _: usize) -> Result<()> {
            Ok(())
        }
        fn round_done(&self) -> Result<usize> {
            panic!("between")
        }
    }
    assert!(matches!(pool(0).submit(2, Arc::new(Between)).wait(LONG), Some(Ending::Failed(_))));
    let failing = Count::new(50, 1, |i| if i == 3 { Err(Error::Cancelled) } else { Ok(()) });
    let pool = pool(0);
    let job = pool.submit(50, failing.clone());
    assert!(matches!(job.wait(LONG), Some(Ending::Failed(_))));
    assert_eq!(failing.done.load(SeqCst), 3, "items after the failure are dropped");
}

#[test]
fn a_cancel_with_nothing_running_ends_the_job_here() {
    let pool = pool(0);
    let work = Count::new(100, 1, |_| Ok(()));
    let job = pool.submit(100, work.clone());
    assert!(pool.step());
    job.cancel();
    assert!(matches!(job.ending(), Some(Ending::Cancelled)));
    job.cancel();
    assert!(!pool.step());
    assert_eq!((work.done.load(SeqCst), work.ended.load(SeqCst)), (1, 1));
}

#[test]
fn scoped_work_borrows() {
    let input: Vec<u64> = (0..1000).collect();
    let sum = AtomicU64::new(0);
    struct Sum<'a>(&'a [u64], &'a AtomicU64);
    impl Work for Sum<'_> {
        fn run(&self, item: usize) -> Result<()> {
            self.1.fetch_add(self.0[item], SeqCst);
            Ok(())
        }
    }
    for threads in [0, 2] {
        sum.store(0, SeqCst);
        let ending = pool(threads).run_scoped(1000, &Sum(&input, &sum));
        assert!(matches!(ending, Ending::Finished));
        assert_eq!(sum.load(SeqCst), 499_500);
    }
}

#[test]
fn the_caller_of_scoped_work_does_not_wait_for_busy_threads() {
    let pool = pool(1);
    let (begun, begins) = mpsc::channel();
    let (go, goes) = mpsc::channel::<()>();
    let (begun, goes) = (Mutex::new(begun), Mutex::new(goes));
    let busy = Count::new(1, 1, move |_| {
        let _ = lock(&begun).send(());
        let _ = lock(&goes).recv();
        Ok(())
    });
    let job = pool.submit(1, busy);
    begins.recv().unwrap();
    // All rounds run in this thread: the only other one is busy until it receives a message.
    let me = std::thread::current().id();
    let work = Count::new(3, 4, move |_| {
        assert_eq!(std::thread::current().id(), me);
        Ok(())
    });
    assert!(matches!(pool.run_scoped(4, &*work), Ending::Finished));
    go.send(()).unwrap();
    assert!(matches!(job.wait(LONG), Some(Ending::Finished)));
}

#[test]
fn work_may_wait_for_other_work_in_the_same_pool() {
    let pool = Arc::new(pool(1));
    let inner_pool = Arc::clone(&pool);
    let work = Count::new(1, 1, move |_| {
        let inner = Count::new(10, 1, |_| Ok(()));
        assert!(matches!(inner_pool.submit(10, inner).wait(LONG), Some(Ending::Finished)));
        Ok(())
    });
    assert!(matches!(pool.submit(1, work).wait(LONG), Some(Ending::Finished)));
}

/// An executor with two threads of the test's own.
struct Hosted {
    send: mpsc::Sender<Task>,
    tasks: AtomicUsize,
}

impl Executor for Hosted {
    fn concurrency(&self) -> usize {
        2
    }
    fn submit(&self, task: Task) {
        self.tasks.fetch_add(1, SeqCst);
        let _ = self.send.send(task);
    }
}

#[test]
fn with_an_executor_no_thread_of_ours_exists() {
    // Other tests start threads at any time, so the count is made in a process of its own.
    if std::env::var_os("OUTCROP_TEST_ALONE").is_none() {
        let me = std::env::current_exe().unwrap();
        let name = "base::tasks::tests::with_an_executor_no_thread_of_ours_exists";
        let child = std::process::Command::new(me)
            .args(["--exact", name, "--test-threads=1"])
            .env("OUTCROP_TEST_ALONE", "1")
            .output()
            .unwrap();
        assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
        return;
    }
    let (send, receive) = mpsc::channel::<Task>();
    let receive = Arc::new(Mutex::new(receive));
    let hosts: Vec<_> = (0..2)
        .map(|_| {
            let receive = Arc::clone(&receive);
            std::thread::spawn(move || {
                while let Ok(task) = { receive.lock().unwrap().recv() } {
                    task.run();
                }
            })
        })
        .collect();
    let before = threads_now();
    let executor = Arc::new(Hosted { send, tasks: AtomicUsize::new(0) });
    let pool = Pool::new(8, Some(executor.clone()), plain).unwrap();
    assert_eq!((pool.threads(), threads_now()), (0, before));
    let on_main = AtomicUsize::new(0);
    let main = std::thread::current().id();
    let work = Count::new(400, 2, move |_| {
        if std::thread::current().id() == main {
            on_main.fetch_add(1, SeqCst);
        }
        std::thread::sleep(Duration::from_micros(100));
        Ok(())
    });
    let job = pool.submit(400, work.clone());
    // This thread does not wait on the job: the host's threads must finish it without help.
    while job.ending().is_none() {
        assert_eq!(threads_now(), before);
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(work.done.load(SeqCst), 800);
    assert!(executor.tasks.load(SeqCst) > 2, "tasks hand their thread back in between");
    drop((job, pool, executor));
    for host in hosts {
        host.join().unwrap();
    }
}

/// Runs the task inside `submit`.
struct Inline;
impl Executor for Inline {
    fn concurrency(&self) -> usize {
        4
    }
    fn submit(&self, task: Task) {
        task.run();
    }
}

/// Drops the task.
struct Refusing;
impl Executor for Refusing {
    fn concurrency(&self) -> usize {
        4
    }
    fn submit(&self, _: Task) {}
}

#[test]
fn executors_may_run_at_once_or_never() {
    let pool = Pool::new(0, Some(Arc::new(Inline)), plain).unwrap();
    let slow = Count::new(30, 2, |_| {
        std::thread::sleep(Duration::from_millis(1));
        Ok(())
    });
    let job = pool.submit(30, slow.clone());
    assert!(matches!(job.ending(), Some(Ending::Finished)), "all done inside submit");
    assert_eq!(slow.done.load(SeqCst), 60);

    let pool = Pool::new(0, Some(Arc::new(Refusing)), plain).unwrap();
    let work = Count::new(30, 2, |_| Ok(()));
    let job = pool.submit(30, work);
    assert!(job.ending().is_none());
    assert!(matches!(job.wait(LONG), Some(Ending::Finished)), "the waiter works itself");
}

#[test]
fn a_long_job_does_not_hold_up_a_short_one() {
    let pool = pool(1);
    let stop = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stop);
    let long = Count::new(usize::MAX / 2, 1, move |_| if seen.load(SeqCst) { Err(Error::Cancelled) } else { Ok(()) });
    let long_job = pool.submit(usize::MAX / 2, long);
    let short = Count::new(100, 1, |_| Ok(()));
    assert!(matches!(pool.submit(100, short).wait(LONG), Some(Ending::Finished)));
    assert!(long_job.ending().is_none());
    stop.store(true, SeqCst);
    assert!(long_job.wait(LONG).is_some());
}

#[test]
fn dropping_a_pool_cancels_and_joins() {
    let pool = pool(2);
    let work = Count::new(1_000_000, 1, |_| {
        std::thread::sleep(Duration::from_micros(50));
        Ok(())
    });
    let job = pool.submit(1_000_000, work.clone());
    drop(pool);
    assert!(matches!(job.ending(), Some(Ending::Cancelled)));
    assert_eq!(work.ended.load(SeqCst), 1);
}

#[test]
fn cancels_from_everywhere_end_every_job_once() {
    let pool = Arc::new(pool(2));
    for i in 0..2000u64 {
        let work = Count::new(20, 2, |_| Ok(()));
        let job = pool.submit(20, work.clone());
        if i % 3 == 0 {
            pool.step();
        }
        job.cancel();
        assert!(job.wait(LONG).is_some());
        assert_eq!(work.ended.load(SeqCst), 1, "job {i}");
    }
}

thread_local! {
    /// A resource of an item that items of other jobs wait for.
    static HOLDS: Cell<bool> = const { Cell::new(false) };
}

/// A host's thread that works on one job and submits a task, which is run at once, does no other work in the middle of
/// its item. The work of the task is not lost.
#[test]
fn a_task_submitted_inside_an_item_is_done_after_it() {
    let pool = Arc::new(Pool::new(0, Some(Arc::new(Inline)), plain).unwrap());
    let (begun, has_begun) = mpsc::channel();
    let (go_on, goes_on) = mpsc::channel::<()>();
    let goes_on = Mutex::new(goes_on);
    let others = Count::new(2, 1, move |item| {
        assert!(!HOLDS.get(), "inside of an item that may hold what this one waits for");
        if item == 0 {
            begun.send(()).unwrap();
            lock(&goes_on).recv().unwrap();
        }
        Ok(())
    });
    let (their_pool, theirs) = (Arc::clone(&pool), others.clone());
    let thread = std::thread::spawn(move || their_pool.submit(2, theirs).wait(LONG).unwrap());
    has_begun.recv().unwrap();
    let begun_inside = Mutex::new(None);
    let inner = Count::new(2, 3, |_| Ok(()));
    let outer = Count::new(1, 1, |_| {
        HOLDS.set(true);
        assert!(matches!(pool.run_scoped(2, &*inner), Ending::Finished));
        let job = pool.submit(3, Count::new(3, 2, |_| Ok(())));
        assert!(job.ending().is_none());
        *lock(&begun_inside) = Some(job);
        HOLDS.set(false);
        Ok(())
    });
    assert!(matches!(pool.run_scoped(1, &*outer), Ending::Finished));
    assert_eq!((inner.done.load(SeqCst), others.done.load(SeqCst)), (6, 1));
    let job = lock(&begun_inside).take().expect("it was begun");
    assert!(matches!(job.ending(), Some(Ending::Finished)));
    go_on.send(()).unwrap();
    assert!(matches!(thread.join().unwrap(), Ending::Finished));
    assert_eq!(others.done.load(SeqCst), 2);
}
