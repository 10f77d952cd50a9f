//! Means over a square by low-discrepancy samples, with how far off they are.
//!
//! The points are the (0,2)-sequence of van der Corput and Sobol with random digit scrambling: Kollig and Keller,
//! "Efficient Multidimensional Sampling", EG 2002, section 3. A scrambled point is uniform in the square, so that every
//! round, with digits of its own, is an unbiased estimate, and the spread of independent rounds says how far off their
//! mean is.

use super::rng::Rng;

/// How many samples, and which.
#[derive(Debug, Clone, Copy)]
pub struct Samples {
    /// Of a round; a power of two is spread best.
    pub points: u32,
    /// At least 2.
    pub rounds: u32,
    pub seed: u64,
}

/// A mean over the square, estimated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    pub mean: f64,
    /// The standard deviation expected of `mean`: that of the rounds, s / sqrt(rounds). 0 where all rounds agree, which
    /// is not proof: what takes less than one part in points * rounds of the square may have been missed.
    pub error: f64,
}

impl Estimate {
    /// Whether the mean is `truth` within `deviations` standard errors and a `slack` for what is not sampling (the
    /// truth's own approximation). A NaN is not.
    pub fn agrees(&self, truth: f64, deviations: f64, slack: f64) -> bool {
        (self.mean - truth).abs() <= deviations * self.error + slack
    }
}

impl Samples {
    /// Estimates the means of `value` over the unit square. Another `key` (the pixel) takes other samples.
    pub fn estimate<const N: usize>(&self, key: u64, mut value: impl FnMut([f64; 2]) -> [f64; N]) -> [Estimate; N] {
        assert!(self.points > 0 && self.rounds > 1, "one round does not tell how far off it is");
        // Keys and seeds that differ in a bit have nothing in common.
        let mut rng = Rng::new(Rng::new(self.seed).bits() ^ key);
        let (mut means, mut squares) = ([0.0; N], [0.0; N]);
        for round in 1..=self.rounds {
            let scramble = rng.bits();
            let mut sums = [0.0; N];
            for i in 0..self.points {
                let values = value(point(i, scramble));
                (0..N).for_each(|c| sums[c] += values[c]);
            }
            // The mean so far, and the sum of squares around it (Welford), which does not cancel.
            for c in 0..N {
                let off = sums[c] / f64::from(self.points) - means[c];
                means[c] += off / f64::from(round);
                squares[c] += off * off * f64::from(round - 1) / f64::from(round);
            }
        }
        let rounds = f64::from(self.rounds);
        std::array::from_fn(|c| Estimate { mean: means[c], error: (squares[c] / (rounds - 1.0) / rounds).sqrt() })
    }
}

/// Point `i` of the sequence, its digits scrambled by the two halves of `scramble`; in the open square.
pub fn point(i: u32, scramble: u64) -> [f64; 2] {
    let mut second = 0;
    let (mut digits, mut column) = (i, 1u32 << 31);
    while digits != 0 {
        if digits & 1 != 0 {
            second ^= column;
        }
        digits >>= 1;
        column ^= column >> 1;
    }
    // The middle of the 2^32 cells a side.
    let unit = |bits: u32| (f64::from(bits) + 0.5) / (1u64 << 32) as f64;
    [unit(i.reverse_bits() ^ scramble as u32), unit(second ^ (scramble >> 32) as u32)]
}
