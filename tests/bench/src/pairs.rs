//! Pairs in turn, and what is told of them.

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// Median and ends of some measurements.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    pub median: f64,
    pub least: f64,
    pub most: f64,
}

impl Spread {
    /// Of at least one value; the median of an even number is the mean of the two in the middle.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (n, half) = (sorted.len(), sorted.len() / 2);
        let median = if n % 2 == 1 { sorted[half] } else { (sorted[half - 1] + sorted[half]) / 2.0 };
        Self { median, least: sorted[0], most: sorted[n - 1] }
    }
}

/// The clock of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    Wall,
    /// CPU time of the calling thread, for runs of one thread on a busy machine: the time of other programs is not in
    /// it.
    Thread,
    /// CPU time of all threads of this program.
    Process,
}

impl Clock {
    /// Seconds since some moment.
    pub fn now(self) -> f64 {
        let time = clock_gettime(match self {
            Clock::Wall => ClockId::Monotonic,
            Clock::Thread => ClockId::ThreadCPUTime,
            Clock::Process => ClockId::ProcessCPUTime,
        });
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }

    /// What the records of its times say.
    pub fn remark(self) -> &'static str {
        if self == Clock::Wall { "" } else { ", CPU time" }
    }
}

/// Seconds that a measurement lasts at least: so many runs are one. (Of runs of 3 ms ratios spread by a third.)
const LEAST: f64 = 0.03;

/// Seconds of a run, of so many that they last long enough together. `once`: runs, and says how long that took.
pub fn steady(mut once: impl FnMut() -> f64) -> f64 {
    let (mut sum, mut runs) = (0.0, 0);
    while sum < LEAST {
        sum += once();
        runs += 1;
    }
    sum / f64::from(runs)
}

/// Seconds of two sides, pair by pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Pairs {
    pub a: Vec<f64>,
    pub b: Vec<f64>,
}

impl Pairs {
    /// Measures A B A B, after one of each that warms caches and does not count.
    pub fn in_turn(rounds: usize, mut a: impl FnMut() -> f64, mut b: impl FnMut() -> f64) -> Self {
        a();
        b();
        let (a, b) = (0..rounds).map(|_| (a(), b())).unzip();
        Self { a, b }
    }

    /// How many times as fast A is as B, of each pair.
    pub fn ratio(&self) -> Spread {
        let ratios: Vec<f64> = self.a.iter().zip(&self.b).map(|(a, b)| b / a).collect();
        Spread::of(&ratios)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    #[test]
    fn medians_and_ends() {
        assert_eq!(Spread::of(&[3.0]), Spread { median: 3.0, least: 3.0, most: 3.0 });
        assert_eq!(Spread::of(&[5.0, 1.0, 2.0]), Spread { median: 2.0, least: 1.0, most: 5.0 });
        assert_eq!(Spread::of(&[5.0, 1.0, 2.0, 4.0]).median, 3.0);
    }

    #[test]
    fn sides_take_turns_and_the_first_pair_warms() {
        let order = RefCell::new(String::new());
        let mut times = [9.0, 1.0, 2.0, 4.0].into_iter();
        let a = || {
            order.borrow_mut().push('a');
            times.next().expect("four runs")
        };
        let b = || {
            order.borrow_mut().push('b');
            4.0
        };
        let pairs = Pairs::in_turn(3, a, b);
        assert_eq!(*order.borrow(), "abababab");
        assert_eq!(pairs.a, [1.0, 2.0, 4.0]);
        assert_eq!(pairs.ratio(), Spread { median: 2.0, least: 1.0, most: 4.0 });
    }

    #[test]
    fn a_thread_that_sleeps_takes_no_cpu_time() {
        let begun = [Clock::Wall, Clock::Thread].map(Clock::now);
        std::thread::sleep(std::time::Duration::from_millis(20));
        let [wall, thread] = [Clock::Wall.now() - begun[0], Clock::Thread.now() - begun[1]];
        assert!(wall >= 0.02 && (0.0..wall).contains(&thread), "{wall} {thread}");
    }

    #[test]
    fn the_time_of_other_threads_is_in_that_of_the_program() {
        let begun = [Clock::Process, Clock::Thread].map(Clock::now);
        let busy = || {
            let begun = Clock::Thread.now();
            while Clock::Thread.now() - begun < 0.02 {}
        };
        std::thread::spawn(busy).join().expect("it ends");
        let [process, thread] = [Clock::Process.now() - begun[0], Clock::Thread.now() - begun[1]];
        assert!(process >= 0.02 && thread < process, "{process} {thread}");
    }

    #[test]
    fn short_runs_are_measured_together() {
        let mut times = [0.02, 0.04, 9.0].into_iter();
        assert!((steady(|| times.next().expect("two runs")) - 0.03).abs() < 1e-12);
        assert_eq!((steady(|| 0.5), times.len()), (0.5, 1));
    }

    #[test]
    fn a_ratio_is_of_pairs_not_of_medians() {
        // A busy machine slows both of a pair: the ratio stays.
        let pairs = Pairs { a: vec![1.0, 10.0, 3.0], b: vec![2.0, 20.0, 6.0] };
        assert_eq!(pairs.ratio(), Spread { median: 2.0, least: 2.0, most: 2.0 });
    }
}
