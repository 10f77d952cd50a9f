//! Selects the turn of the second axis of a cell's slabs: the turn with the least width of the content. The search
//! tests eight turns, then the turns between the neighbours of the best.

use super::oriented_slabs::{Content, TURNS, turned};
use super::support::{AXES, Axes, extents};
use crate::simd::{Isa, Lanes, Op, Simd, dispatch};

/// Distance between the turns of the first search.
const COARSE: u32 = TURNS / AXES as u32;
/// Number of turns in the second search. Its index is also that of one more lane, in which the normal's axis is
/// measured.
const ACROSS: usize = 2 * AXES - 1;
const _: () = assert!(2 * COARSE as usize == ACROSS + 1);

/// Result of the search.
pub struct Narrowest {
    /// The turn.
    pub turn: u32,
    /// The second axis.
    pub second: [f32; 3],
    /// Extent of the content along the second axis, or a larger one.
    pub along_second: [f64; 2],
    /// Extent of the content along the normal's axis, or a larger one.
    pub along_normal: [f64; 2],
}

/// Returns the turn around `across` for which the content has the least width.
pub fn narrowest(content: &Content, across: [f32; 3]) -> Narrowest {
    dispatch(Isa::best(), Search { content, across })
}

struct Search<'a> {
    content: &'a Content,
    across: [f32; 3],
}

impl Op for Search<'_> {
    type Out = Narrowest;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Narrowest {
        let Self { content, across } = self;
        let coarse = axes(s, across, 0, COARSE);
        let wide = widths(&coarse, &extents(content, &coarse));
        let mut best = (f64::INFINITY, 0);
        for (i, wide) in wide.into_iter().enumerate() {
            if wide < best.0 {
                best = (wide, i as u32 * COARSE);
            }
        }
        let from = best.1 + TURNS + 1 - COARSE;
        let (one, mut other) = (axes(s, across, from, 1), axes(s, across, from + AXES as u32, 1));
        for k in 0..3 {
            other[k][ACROSS - AXES] = across[k];
        }
        let around = [one, other];
        let ends = [extents(content, &one), extents(content, &other)];
        let wide = [widths(&one, &ends[0]), widths(&other, &ends[1])];
        let mut narrowest = (best.0, COARSE as usize - 1);
        for step in [4, 2, 1] {
            let middle = narrowest.1;
            for at in [middle - step, middle + step] {
                let wide = wide[at / AXES % 2][at % AXES];
                if wide < narrowest.0 {
                    narrowest = (wide, at);
                }
            }
        }
        let (half, lane) = (narrowest.1 / AXES % 2, narrowest.1 % AXES);
        let along = |half: usize, lane: usize| [ends[half][0][lane], ends[half][1][lane]];
        Narrowest {
            turn: (from + narrowest.1 as u32) % TURNS,
            second: [around[half][0][lane], around[half][1][lane], around[half][2][lane]],
            along_second: along(half, lane),
            along_normal: along(1, ACROSS - AXES),
        }
    }
}

/// Returns the axes of eight turns around `across`: the first is `from`, and each next one is `step` greater.
#[inline(always)]
fn axes<S: Simd>(s: S, across: [f32; 3], from: u32, step: u32) -> Axes {
    let mut turns = [0.0; AXES];
    for (i, turn) in turns.iter_mut().enumerate() {
        *turn = ((from + i as u32 * step) % TURNS) as f32;
    }
    let across = [s.splat8(across[0]), s.splat8(across[1]), s.splat8(across[2])];
    let [x, y, z] = turned(across, s.load8(&turns));
    [x.to_array(), y.to_array(), z.to_array()]
}

/// Widths from extents along axes of any length.
#[inline(always)]
fn widths([x, y, z]: &Axes, [low, high]: &[[f64; AXES]; 2]) -> [f64; AXES] {
    let mut wide = [0.0; AXES];
    for i in 0..AXES {
        let length = (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
        wide[i] = (high[i] - low[i]) / f64::from(length);
    }
    wide
}
