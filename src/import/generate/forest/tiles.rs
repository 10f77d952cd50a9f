//! Wang tiles of Poisson discs: squares whose edges have colours. Beside each other, tiles have edges of one colour,
//! and the discs at an edge depend on its colour alone (Hiller, Deussen, Keller, "Tiled Blue Noise Samples", 2001; the
//! corners as in Lagae, Dutré, "A Procedural Object Distribution Function", 2005).
//!
//! Squares around corners are filled first, all alike. Then follow strips along edges, one for each colour, with
//! regard to the corners at their ends. Then follow the insides of tiles, with regard to their edges and corners. With
//! the sizes below, each region is at least one least distance away from all that it was filled without regard to.

use super::super::rng::Rng;
use super::discs::{Rect, Region, fill};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use glam::{DVec2, Vec2Swizzles};

/// Number of tiles: one for each choice of two colours for four edges.
pub const COUNT: usize = 16;
/// Half of the width of a strip, in least distances: insides of neighbours are a least distance apart.
const STRIP: f64 = 0.5;
/// Half of the side of the square at a corner, in least distances: the ends of strips at right angles, and a strip and
/// the inside of the tile beyond, are a least distance apart. 1/√2 from the end of a strip, rounded up.
const CORNER: f64 = STRIP + 0.708;
/// Least side of a tile, in least distances: the squares at the ends of an edge are a least distance apart.
pub const LEAST_SIDE: f64 = 2.0 * CORNER + 1.0;

/// Colours of the left, right, lower and upper edge of a tile, 0 or 1.
pub type Edges = [u8; 4];

/// Returns the number of the tile with these edges.
pub const fn number([left, right, lower, upper]: Edges) -> usize {
    (left | right << 1 | lower << 2 | upper << 3) as usize
}

/// Returns the edges of a tile.
pub fn edges(number: usize) -> Edges {
    [0, 1, 2, 3].map(|at| (number >> at & 1) as u8)
}

/// Returns the points of each tile, from (0, 0) to (`side`, `side`).
pub fn tiles(side: f64, spacing: f64, seed: u64, cancel: &Cancel) -> Result<Vec<Vec<DVec2>>> {
    debug_assert!(side >= LEAST_SIDE * spacing);
    let border = Border::new(side, spacing, seed);
    (0..COUNT).map(|tile| cancel.check().map(|()| border.tile(tile, &mut Rng::stream(seed, 5 + tile as u64)))).collect()
}

/// What tiles have in common.
struct Border {
    side: f64,
    spacing: f64,
    /// Points around a corner, which is the origin.
    corner: Vec<DVec2>,
    /// Points along an edge from the origin to the right, for each colour.
    along: [Vec<DVec2>; 2],
    /// Points along an edge from the origin upwards, for each colour.
    up: [Vec<DVec2>; 2],
}

impl Border {
    fn new(side: f64, spacing: f64, seed: u64) -> Self {
        let [strip, corner] = [STRIP * spacing, CORNER * spacing];
        let square = Region { whole: Rect::new([-corner; 2], [corner; 2]), holes: Vec::new() };
        let at_corner = fill(&square, spacing, &[], &mut Rng::stream(seed, 0));
        // An edge upwards is filled as one to the right, in a plane with x and y exchanged.
        let edge = |is_up: bool, stream: u64| {
            let turn = |p: DVec2| if is_up { p.yx() } else { p };
            let ends = [DVec2::ZERO, DVec2::new(side, 0.0)];
            let fixed: Vec<_> = ends.iter().flat_map(|end| at_corner.iter().map(|p| *end + turn(*p))).collect();
            let whole = Rect::new([corner, -strip], [side - corner, strip]);
            let points = fill(&Region { whole, holes: Vec::new() }, spacing, &fixed, &mut Rng::stream(seed, stream));
            points.into_iter().map(turn).collect::<Vec<_>>()
        };
        let (along, up) = ([edge(false, 1), edge(false, 2)], [edge(true, 3), edge(true, 4)]);
        Self { side, spacing, corner: at_corner, along, up }
    }

    /// Fills the inside of a tile; returns its points with those of the borders that are in the tile.
    fn tile(&self, tile: usize, rng: &mut Rng) -> Vec<DVec2> {
        let (side, [left, right, lower, upper]) = (self.side, edges(tile).map(usize::from));
        let mut borders: Vec<(DVec2, DVec2)> = Vec::new();
        let mut add = |at: [f64; 2], points: &[DVec2]| borders.extend(points.iter().map(|p| (DVec2::from(at), *p)));
        for at in [[0.0, 0.0], [side, 0.0], [0.0, side], [side, side]] {
            add(at, &self.corner);
        }
        add([0.0, 0.0], &self.up[left]);
        add([side, 0.0], &self.up[right]);
        add([0.0, 0.0], &self.along[lower]);
        add([0.0, side], &self.along[upper]);
        let fixed: Vec<DVec2> = borders.iter().map(|(at, p)| *at + *p).collect();
        let [strip, corner] = [STRIP * self.spacing, CORNER * self.spacing];
        let square = |x: f64, y: f64| Rect::new([x - corner, y - corner], [x + corner, y + corner]);
        let holes = vec![square(0.0, 0.0), square(side, 0.0), square(0.0, side), square(side, side)];
        let region = Region { whole: Rect::new([strip; 2], [side - strip; 2]), holes };
        let inside = fill(&region, self.spacing, &fixed, rng);
        // The side of an edge is decided in the frame of the edge, so that each point is in exactly one tile.
        let is_own = |at: f64, p: f64| if at == 0.0 { p >= 0.0 } else { p < 0.0 };
        let is_in = |(at, p): &(DVec2, DVec2)| is_own(at.x, p.x) && is_own(at.y, p.y);
        borders.iter().filter(|it| is_in(it)).map(|(at, p)| *at + *p).chain(inside).collect()
    }
}
