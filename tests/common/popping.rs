//! Popping: what changes between neighbouring frames of a slow zoom although the model does not.

use super::picture::{Colours, Spread};

/// What popped between two frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pop {
    /// Of each pixel; see [`pop`].
    pub change: Spread,
    /// Pixels that changed by more than the threshold.
    pub pixels: usize,
    /// Of those, the pixels of the largest patch (joined by sides): a stand-in that appears at once pops as one patch,
    /// which pixels of error explain as long as it is not larger than they are.
    pub largest: usize,
}

/// A frame: what is shown, and the exact picture from there.
#[derive(Debug, Clone, Copy)]
pub struct Shown<'a> {
    pub seen: Colours<'a>,
    pub truth: Colours<'a>,
}

/// The change from frame to frame less the exact picture's own: of each pixel the largest over red, green and blue of
///
/// ```text
/// abs((after.seen - before.seen) - (after.truth - before.truth))
/// ```
///
/// of coded values, so that 1 is from black to white and 1/255 a level of the screen. An error that stays as it is does
/// not pop. `threshold`: above which a change counts; `width`: pixels in a row.
pub fn pop(before: Shown, after: Shown, width: usize, threshold: f64) -> Pop {
    let count = after.seen.count();
    for other in [before.seen, before.truth, after.truth] {
        assert_eq!(other.count(), count, "pictures of one size are compared");
    }
    assert_eq!(count % width, 0, "rows are whole");
    let of_pixel = |i: usize| {
        let [s1, s0, t1, t0] = [after.seen, before.seen, after.truth, before.truth].map(|picture| picture.coded(i));
        // Not f64::max, which would drop a NaN.
        (0..3).map(|c| ((s1[c] - s0[c]) - (t1[c] - t0[c])).abs()).max_by(f64::total_cmp).expect("three colours")
    };
    let changes: Vec<f64> = (0..count).map(of_pixel).collect();
    // So that a NaN pops.
    #[allow(clippy::neg_cmp_op_on_partial_ord)]
    let popped: Vec<bool> = changes.iter().map(|c| !(*c <= threshold)).collect();
    Pop {
        pixels: popped.iter().filter(|p| **p).count(),
        largest: largest_patch(popped, width),
        change: Spread::of(changes),
    }
}

/// Pixels of the largest set of `marked` pixels that are joined by sides.
fn largest_patch(mut marked: Vec<bool>, width: usize) -> usize {
    let mut largest = 0;
    let mut edge = Vec::new();
    for first in 0..marked.len() {
        let mut size = 0;
        edge.push(first);
        while let Some(at) = edge.pop() {
            if !std::mem::take(&mut marked[at]) {
                continue;
            }
            size += 1;
            let column = at % width;
            let left = (column > 0).then(|| at - 1);
            let right = (column + 1 < width).then_some(at + 1);
            let below = (at + width < marked.len()).then_some(at + width);
            edge.extend([left, right, at.checked_sub(width), below].into_iter().flatten());
        }
        largest = largest.max(size);
    }
    largest
}
