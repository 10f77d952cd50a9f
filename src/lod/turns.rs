//! Which way the second axis of a cell's slabs is turned: the one along which its content is least wide, of eight, then
//! of those between.

use super::oriented_slabs::{Content, TURNS, turned};
use super::support::{AXES, Axes, extents};
use crate::simd::{Isa, Lanes, Op, Simd, dispatch};

/// Turns of which the best is sought first: every so many.
const COARSE: u32 = TURNS / AXES as u32;
/// Those between its neighbours are looked along together; behind them is room for the axis that turns are across.
const ACROSS: usize = 2 * AXES - 1;
const _: () = assert!(2 * COARSE as usize == ACROSS + 1);

/// What was found.
pub struct Narrowest {
    /// The turn.
    pub turn: u32,
    /// Its axis.
    pub second: [f32; 3],
    /// How far the content reaches along that, or farther.
    pub along_second: [f64; 2],
    /// The same along the axis that turns are across.
    pub along_normal: [f64; 2],
}

/// The turn around `across` along whose axis `content` is least wide.
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

/// The axes of eight turns around `across`, the first of them `from` and each `step` more than the one before.
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

/// How wide something is that reaches so far along some axes, which are of any length.
#[inline(always)]
fn widths([x, y, z]: &Axes, [low, high]: &[[f64; AXES]; 2]) -> [f64; AXES] {
    let mut wide = [0.0; AXES];
    for i in 0..AXES {
        let length = (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
        wide[i] = (high[i] - low[i]) / f64::from(length);
    }
    wide
}
