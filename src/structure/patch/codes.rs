//! The boxes of a quadtree's nodes in 8 bits each: C332 (Selgrad 2016, sections 3.4 and 3.5).
//!
//! A word describes the boxes of the four children of a node, relative to the node's own box. The children are the
//! halves of a square along x and y: child `i + 2 j` is half `i` along x and half `j` along y. Both children of a half
//! share its two planes across the halved axis (a slab), so there are four planes along x and four along y, each with
//! three bits: how far it is from where a flat, evenly divided patch has it. Along z each child has two bits: one of
//! four intervals.
//!
//! | bits | content |
//! |---|---|
//! | 0 to 11 | planes along x: low and high of the lower half, low and high of the upper half |
//! | 12 to 23 | planes along y, likewise |
//! | 24 to 31 | intervals along z of the four children |
//!
//! The planes and intervals are those of the paper's figure 6. A decoded box never holds less than the box that was
//! encoded: the encoder decodes each candidate by [`children`], to the bit as walks do.

#![allow(clippy::needless_range_loop)] // children and planes index several arrays at once

use crate::simd::{Lanes, Simd};

/// Planes of a box: low x, y, z, then high x, y, z.
pub type Planes = [f32; 6];

/// Distances of a plane from its expected place, as shares of the node's extent.
const SHIFTS: [f32; 8] = [-1.0, -0.2, -0.01, -0.001, 0.001, 0.01, 0.2, 1.0];
/// The expected places of low and high planes of the lower and the upper half, as shares.
const PLACES: [f32; 4] = [0.0, 0.5, 0.5, 1.0];
/// The intervals along z, as shares.
const INTERVALS: [[f32; 2]; 4] = [[0.0, 1.0], [0.0, 0.7], [0.3, 1.0], [0.2, 0.8]];

/// Share at which a plane lies, by its number and its code.
const SHARES: [[f32; 8]; 4] = {
    let mut shares = [[0.0; 8]; 4];
    let mut plane = 0;
    while plane < 4 {
        let mut code = 0;
        while code < 8 {
            let share = PLACES[plane] + SHIFTS[code];
            // No child reaches beyond its node.
            shares[plane][code] = if share < 0.0 {
                0.0
            } else if share > 1.0 {
                1.0
            } else {
                share
            };
            code += 1;
        }
        plane += 1;
    }
    shares
};

/// The plane at a share between two others; exactly these for shares 0 and 1.
#[inline(always)]
fn between(low: f32, high: f32, share: f32) -> f32 {
    low * (1.0 - share) + high * share
}

/// The boxes of the four children of a node with box `node`: by plane, then by child.
#[inline(always)]
pub fn children(word: u32, node: &Planes) -> [[f32; 4]; 6] {
    let mut out = [[0.0; 4]; 6];
    for axis in 0..2 {
        let (low, high) = (node[axis], node[axis + 3]);
        // No closures here: they are compiled without the instruction set.
        let mut at = [0.0; 4];
        for which in 0..4 {
            let code = word >> (12 * axis + 3 * which) & 7;
            at[which] = between(low, high, SHARES[which][code as usize]);
        }
        for child in 0..4 {
            let half = child >> axis & 1;
            out[axis][child] = at[2 * half];
            out[axis + 3][child] = at[2 * half + 1];
        }
    }
    let (low, high) = (node[2], node[5]);
    for child in 0..4 {
        let interval = INTERVALS[(word >> (24 + 2 * child) & 3) as usize];
        out[2][child] = between(low, high, interval[0]);
        out[5][child] = between(low, high, interval[1]);
    }
    out
}

/// The boxes of the four children in the form in which rays meet them.
pub struct Slabs {
    /// Planes along x: low and high of the lower half, low and high of the upper half; then along y.
    pub across: [f32; 8],
    /// Low planes along z of the children, then their high planes.
    pub along: [f32; 8],
}

impl Slabs {
    /// Decodes the word of a node with box `node`; to the bit as [`children`].
    #[inline(always)]
    pub fn of<S: Simd>(s: S, word: u32, node: &Planes) -> Self {
        // No closures here: they are compiled without the instruction set.
        let (mut across, mut along) = ([0.0; 8], [0.0; 8]);
        for plane in 0..8 {
            across[plane] = SHARES[plane & 3][(word >> (3 * plane) & 7) as usize];
        }
        for child in 0..4 {
            let interval = INTERVALS[(word >> (24 + 2 * child) & 3) as usize];
            (along[child], along[child + 4]) = (interval[0], interval[1]);
        }
        let one = s.splat8(1.0);
        let (across, along) = (s.load8(&across), s.load8(&along));
        let low = s.load8(&[node[0], node[0], node[0], node[0], node[1], node[1], node[1], node[1]]);
        let high = s.load8(&[node[3], node[3], node[3], node[3], node[4], node[4], node[4], node[4]]);
        let across = low * (one - across) + high * across;
        let along = s.splat8(node[2]) * (one - along) + s.splat8(node[5]) * along;
        Self { across: across.to_array(), along: along.to_array() }
    }

    /// The box of a child.
    #[inline(always)]
    pub fn child(&self, which: usize) -> Planes {
        let (x, y, z) = (2 * (which & 1), 4 + (which & 2), which & 3);
        let (across, along) = (&self.across, &self.along);
        [across[x], across[y], along[z], across[x + 1], across[y + 1], along[z + 4]]
    }
}

/// One column of [`children`].
#[inline(always)]
pub fn child(boxes: &[[f32; 4]; 6], which: usize) -> Planes {
    let which = which & 3;
    [boxes[0][which], boxes[1][which], boxes[2][which], boxes[3][which], boxes[4][which], boxes[5][which]]
}

/// The word whose boxes hold `boxes`, which lie in `node`: the tightest code of each plane.
pub fn encode(boxes: &[[f64; 6]; 4], node: &Planes) -> u32 {
    let mut word = 0;
    for axis in 0..2 {
        for which in 0..4 {
            let of_half = (0..4).filter(|child| child >> axis & 1 == which >> 1);
            let is_low = which & 1 == 0;
            let bounds = of_half.map(|child| boxes[child][if is_low { axis } else { axis + 3 }]);
            let bound = bounds.reduce(|a, b| if is_low { a.min(b) } else { a.max(b) }).unwrap_or(0.0);
            let at = |code: &u32| f64::from(between(node[axis], node[axis + 3], SHARES[which][*code as usize]));
            // The outermost code is the node's own plane.
            let code = match is_low {
                true => (0..8).rev().find(|code| at(code) <= bound).unwrap_or(0),
                false => (0..8).find(|code| at(code) >= bound).unwrap_or(7),
            };
            word |= code << (12 * axis + 3 * which);
        }
    }
    for (child, bounds) in boxes.iter().enumerate() {
        let at = |share: f32| f64::from(between(node[2], node[5], share));
        let holds = |code: &u32| {
            let [low, high] = INTERVALS[*code as usize];
            at(low) <= bounds[2] && at(high) >= bounds[5]
        };
        // The narrowest that holds the content: the last has six tenths, the first all.
        let code = (0..4).rev().find(holds).unwrap_or(0);
        word |= code << (24 + 2 * child);
    }
    word
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decoded_boxes_hold_those_encoded(
            low in prop::array::uniform3(-3.0f32..1.0),
            size in prop::array::uniform3(0.0f32..2.0),
            shares in prop::array::uniform32(0.0f64..=1.0),
        ) {
            let node: Planes = std::array::from_fn(|i| if i < 3 { low[i] } else { low[i - 3] + size[i - 3] });
            let place = |axis: usize, share: f64| {
                let (low, high) = (f64::from(node[axis]), f64::from(node[axis + 3]));
                (low + (high - low) * share).clamp(low, high)
            };
            let boxes: [[f64; 6]; 4] = std::array::from_fn(|child| {
                let share = |i: usize| shares[child * 6 + i];
                std::array::from_fn(|i| {
                    let (a, b) = (share(i % 3), share(i % 3 + 3));
                    place(i % 3, if i < 3 { a.min(b) } else { a.max(b) })
                })
            });
            let found = children(encode(&boxes, &node), &node);
            for child in 0..4 {
                for axis in 0..3 {
                    prop_assert!(f64::from(found[axis][child]) <= boxes[child][axis]);
                    prop_assert!(f64::from(found[axis + 3][child]) >= boxes[child][axis + 3]);
                    // No child reaches beyond its node.
                    prop_assert!(found[axis][child] >= node[axis] && found[axis + 3][child] <= node[axis + 3]);
                }
            }
        }
    }

    struct Decode(u32, Planes);

    impl crate::simd::Op for Decode {
        type Out = [Planes; 4];
        fn run<S: Simd>(self, s: S) -> [Planes; 4] {
            let slabs = Slabs::of(s, self.0, &self.1);
            [0, 1, 2, 3].map(|which| slabs.child(which))
        }
    }

    proptest! {
        #[test]
        fn slabs_are_the_boxes_of_the_children(word: u32, planes in prop::array::uniform6(-2.0f32..2.0)) {
            let boxes = children(word, &planes);
            let expected = [0, 1, 2, 3].map(|which| child(&boxes, which));
            for isa in crate::simd::Isa::ALL {
                let found = crate::simd::dispatch(isa, Decode(word, planes));
                prop_assert_eq!(found.map(|b| b.map(f32::to_bits)), expected.map(|b| b.map(f32::to_bits)));
            }
        }
    }

    /// A flat patch that is divided evenly takes the tightest planes: each child a quarter, within the smallest shift.
    #[test]
    fn even_halves_are_tight() {
        let node = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        let boxes: [[f64; 6]; 4] = std::array::from_fn(|child| {
            let (x, y) = (0.5 * (child & 1) as f64, 0.5 * (child >> 1) as f64);
            [x, y, 0.25, x + 0.5, y + 0.5, 0.75]
        });
        let found = children(encode(&boxes, &node), &node);
        for child in 0..4 {
            for plane in 0..6 {
                let apart = (f64::from(found[plane][child]) - boxes[child][plane]).abs();
                assert!(apart <= if plane % 3 == 2 { 0.0501 } else { 0.00101 }, "{child} {plane}: {apart}");
            }
        }
    }
}
