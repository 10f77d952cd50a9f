//! Positions of samples in a pixel, and widths of their rays.

use std::sync::OnceLock;

/// The plastic number.
const PLASTIC: f64 = 1.324_717_957_244_746;

/// Factors for the widths of pixels. The area that a stand-in may cover is spread over an octave, 2^(u - 1/2) times the
/// pixels of error, so that one level of detail fades into the next. u is the additive recurrence of the plastic number
/// (Roberts 2018) over pixels and samples: evenly spread, without random numbers, and constant while the camera rests.
#[derive(Clone, Copy)]
pub(super) struct Widths {
    root: f32,
    octave: &'static [f32; 1 << OCTAVE_BITS],
}

impl Widths {
    pub fn of(poe: f32) -> Self {
        Self { root: poe.sqrt(), octave: OCTAVE.get_or_init(octave) }
    }

    /// Returns the step within the octave of a pixel's sample.
    #[inline(always)]
    pub fn step(x: u32, y: u32, sample: u32) -> u32 {
        const GOLDEN: f64 = 1.618_033_988_749_895;
        // Fixed-point numbers with a period of 2^32, in which sums wrap around.
        const STEPS: [u32; 3] = [steps(1.0 / PLASTIC), steps(1.0 / (PLASTIC * PLASTIC)), steps(1.0 / GOLDEN)];
        let u =
            x.wrapping_mul(STEPS[0]).wrapping_add(y.wrapping_mul(STEPS[1])).wrapping_add(sample.wrapping_mul(STEPS[2]));
        u >> (32 - OCTAVE_BITS)
    }

    /// Returns the factor for the width at a step.
    #[inline(always)]
    pub fn factor(&self, step: u32) -> f32 {
        self.root * self.octave[step as usize & ((1 << OCTAVE_BITS) - 1)]
    }
}

const fn steps(part: f64) -> u32 {
    (part * 4_294_967_296.0) as u32
}

const OCTAVE_BITS: u32 = 8;

/// Square roots of 2^(u - 1/2) for u from 0 to 1. One step changes the area by 0.27 %. (Computing them per pixel took a
/// tenth of a picture's time.)
static OCTAVE: OnceLock<[f32; 1 << OCTAVE_BITS]> = OnceLock::new();

fn octave() -> [f32; 1 << OCTAVE_BITS] {
    std::array::from_fn(|i| (0.5 * ((i as f64 + 0.5) / f64::from(1 << OCTAVE_BITS) - 0.5)).exp2() as f32)
}

/// Returns the position of a sample in its pixel: the centre first, then the additive recurrence of the plastic number
/// (Roberts 2018), which covers the square evenly for any number of samples.
pub(super) fn offset(sample: u32) -> (f64, f64) {
    let n = f64::from(sample);
    ((0.5 + n / PLASTIC).fract(), (0.5 + n / (PLASTIC * PLASTIC)).fract())
}
