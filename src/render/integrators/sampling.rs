//! Where samples lie in a pixel, and how wide their rays are.

use std::sync::OnceLock;

/// The plastic number.
const PLASTIC: f64 = 1.324_717_957_244_746;

/// What pixels' widths are multiplied with. The area that a stand-in may cover is spread over an octave, 2^(u - 1/2)
/// times the pixels of error, so that one level of detail fades into the next; u is the additive recurrence of the
/// plastic number (Roberts 2018) over pixels and samples: even, without random numbers, at rest while the camera is.
#[derive(Clone, Copy)]
pub(super) struct Widths {
    root: f32,
    octave: &'static [f32; 1 << OCTAVE_BITS],
}

impl Widths {
    pub fn of(poe: f32) -> Self {
        Self { root: poe.sqrt(), octave: OCTAVE.get_or_init(octave) }
    }

    /// The step of the octave that a pixel's sample is at.
    #[inline(always)]
    pub fn step(x: u32, y: u32, sample: u32) -> u32 {
        const GOLDEN: f64 = 1.618_033_988_749_895;
        // Of a period of 2^32, which sums go around.
        const STEPS: [u32; 3] = [steps(1.0 / PLASTIC), steps(1.0 / (PLASTIC * PLASTIC)), steps(1.0 / GOLDEN)];
        let u =
            x.wrapping_mul(STEPS[0]).wrapping_add(y.wrapping_mul(STEPS[1])).wrapping_add(sample.wrapping_mul(STEPS[2]));
        u >> (32 - OCTAVE_BITS)
    }

    /// What the width at a step is multiplied with.
    #[inline(always)]
    pub fn factor(&self, step: u32) -> f32 {
        self.root * self.octave[step as usize & ((1 << OCTAVE_BITS) - 1)]
    }
}

const fn steps(part: f64) -> u32 {
    (part * 4_294_967_296.0) as u32
}

const OCTAVE_BITS: u32 = 8;

/// Square roots of 2^(u - 1/2), u over 0 to 1: a step is a third of a percent. (To work them out for each pixel took a
/// tenth of the time of a picture.)
static OCTAVE: OnceLock<[f32; 1 << OCTAVE_BITS]> = OnceLock::new();

fn octave() -> [f32; 1 << OCTAVE_BITS] {
    std::array::from_fn(|i| (0.5 * ((i as f64 + 0.5) / f64::from(1 << OCTAVE_BITS) - 0.5)).exp2() as f32)
}

/// Where in the pixel a sample lies: the middle first, then the additive recurrence of the plastic number
/// (Roberts 2018), which covers the square evenly however many are taken.
pub(super) fn offset(sample: u32) -> (f64, f64) {
    let n = f64::from(sample);
    ((0.5 + n / PLASTIC).fract(), (0.5 + n / (PLASTIC * PLASTIC)).fract())
}
