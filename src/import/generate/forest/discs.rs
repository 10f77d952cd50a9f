//! Poisson-disc sampling: random points that keep a least distance, so many that no further point fits in.
//!
//! Darts are thrown at squares of a grid. Squares that points cover are left out, the others are cut into four, and so
//! on until none is left (Ebeida, Mitchell, Patney, Davidson, Owens, "A Simple Algorithm for Maximal Poisson-Disk
//! Sampling in High Dimensions", 2012).

use super::super::rng::Rng;
use glam::DVec2;
use std::f64::consts::FRAC_1_SQRT_2;

/// Number of times that squares are cut. The squares that are left then are 10⁻⁸ least distances wide.
const DEEPEST: u32 = 26;
/// A cell without a point.
const NONE: u32 = u32::MAX;

/// An axis-parallel rectangle.
#[derive(Debug, Clone, Copy)]
pub struct Rect {
    pub low: DVec2,
    pub high: DVec2,
}

impl Rect {
    pub fn new(low: [f64; 2], high: [f64; 2]) -> Self {
        Self { low: low.into(), high: high.into() }
    }

    /// True if the point is in it. A point on the upper or right border is not.
    pub fn has(&self, p: DVec2) -> bool {
        p.cmpge(self.low).all() && p.cmplt(self.high).all()
    }

    fn has_all_of(&self, other: &Rect) -> bool {
        other.low.cmpge(self.low).all() && other.high.cmple(self.high).all()
    }

    fn meets(&self, other: &Rect) -> bool {
        other.low.cmplt(self.high).all() && other.high.cmpgt(self.low).all()
    }
}

/// The area to fill: a rectangle without some others.
#[derive(Debug, Clone)]
pub struct Region {
    pub whole: Rect,
    pub holes: Vec<Rect>,
}

impl Region {
    fn has(&self, p: DVec2) -> bool {
        self.whole.has(p) && !self.holes.iter().any(|hole| hole.has(p))
    }

    /// False if no point of the rectangle is in the region.
    fn may_meet(&self, rect: &Rect) -> bool {
        self.whole.meets(rect) && !self.holes.iter().any(|hole| hole.has_all_of(rect))
    }
}

/// Points in a grid. Its cells are as wide as possible with one point each.
struct Grid {
    spacing: f64,
    low: DVec2,
    width: f64,
    /// Number of columns and of rows.
    size: [usize; 2],
    /// The point of each cell.
    cells: Vec<u32>,
    points: Vec<DVec2>,
}

impl Grid {
    /// An empty grid over `whole`, and over what is nearer to it than `spacing`.
    fn new(whole: &Rect, spacing: f64) -> Self {
        let width = spacing * FRAC_1_SQRT_2;
        let low = whole.low - spacing;
        let size = ((whole.high + spacing - low) / width).to_array().map(|n| n as usize + 1);
        Self { spacing, low, width, size, cells: vec![NONE; size[0] * size[1]], points: Vec::new() }
    }

    /// The column and the row of a point; `None` if it is outside of the grid.
    fn cell_of(&self, p: DVec2) -> Option<[usize; 2]> {
        let cell = (p - self.low) / self.width;
        if cell.min_element() < 0.0 {
            return None;
        }
        let cell = cell.to_array().map(|n| n as usize);
        (cell[0] < self.size[0] && cell[1] < self.size[1]).then_some(cell)
    }

    fn rect_of(&self, [column, row]: [usize; 2]) -> Rect {
        let low = self.low + DVec2::new(column as f64, row as f64) * self.width;
        Rect { low, high: low + self.width }
    }

    /// The points in the cells that a disc around a point of this cell may meet.
    fn around(&self, [column, row]: [usize; 2]) -> impl Iterator<Item = DVec2> {
        let columns = column.saturating_sub(2)..(column + 3).min(self.size[0]);
        let rows = row.saturating_sub(2)..(row + 3).min(self.size[1]);
        let cells = rows.flat_map(move |row| columns.clone().map(move |column| row * self.size[0] + column));
        cells.filter(|cell| self.cells[*cell] != NONE).map(|cell| self.points[self.cells[cell] as usize])
    }

    fn add(&mut self, p: DVec2) {
        if let Some([column, row]) = self.cell_of(p) {
            self.cells[row * self.size[0] + column] = self.points.len() as u32;
            self.points.push(p);
        }
    }

    /// Adds a point if it keeps the distance to all others.
    fn try_add(&mut self, p: DVec2) {
        let least = self.spacing * self.spacing;
        if let Some(cell) = self.cell_of(p)
            && self.around(cell).all(|other| other.distance_squared(p) >= least)
        {
            self.add(p);
        }
    }

    /// True if no point of the rectangle keeps the distance to one of the points.
    fn covers(&self, rect: &Rect) -> bool {
        let middle = 0.5 * (rect.low + rect.high);
        let least = self.spacing * self.spacing;
        self.cell_of(middle).is_none_or(|cell| {
            self.around(cell).any(|p| (p - rect.low).abs().max((p - rect.high).abs()).length_squared() < least)
        })
    }
}

/// Returns points in `region` that keep the distance `spacing` to each other and to `fixed`. No further point fits.
pub fn fill(region: &Region, spacing: f64, fixed: &[DVec2], rng: &mut Rng) -> Vec<DVec2> {
    let mut grid = Grid::new(&region.whole, spacing);
    fixed.iter().for_each(|p| grid.add(*p));
    let first = grid.points.len();
    let cells = (0..grid.size[1]).flat_map(|row| (0..grid.size[0]).map(move |column| [column, row]));
    let mut active: Vec<Rect> = cells.map(|cell| grid.rect_of(cell)).filter(|rect| region.may_meet(rect)).collect();
    active.retain(|rect| !grid.covers(rect));
    for _ in 0..DEEPEST {
        for _ in 0..active.len() {
            let rect = active[rng.below(active.len() as u64) as usize];
            let p = rect.low + (rect.high - rect.low) * DVec2::new(rng.unit(), rng.unit());
            if region.has(p) {
                grid.try_add(p);
            }
        }
        active = active.iter().flat_map(quarters).filter(|rect| region.may_meet(rect) && !grid.covers(rect)).collect();
        if active.is_empty() {
            break;
        }
    }
    grid.points.split_off(first)
}

fn quarters(rect: &Rect) -> [Rect; 4] {
    let (low, middle, high) = (rect.low, 0.5 * (rect.low + rect.high), rect.high);
    [
        Rect { low, high: middle },
        Rect::new([middle.x, low.y], [high.x, middle.y]),
        Rect::new([low.x, middle.y], [middle.x, high.y]),
        Rect { low: middle, high },
    ]
}
