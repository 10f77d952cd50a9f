//! Regions of a grid, which are compact and hold similar numbers of triangles: a k-d tree over a histogram.

use super::survey::{SIDE, index};

/// A box of cells: the first cell, and one past the last, on each axis.
#[derive(Debug, Clone, Copy)]
struct Cells {
    low: [usize; 3],
    high: [usize; 3],
}

impl Cells {
    fn each(self) -> impl Iterator<Item = [usize; 3]> {
        let [x, y, z] = [0, 1, 2].map(|a| self.low[a]..self.high[a]);
        z.flat_map(move |z| {
            let x = x.clone();
            y.clone().flat_map(move |y| x.clone().map(move |x| [x, y, z]))
        })
    }

    fn half_area(&self) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|a| (self.high[a] - self.low[a]) as f64);
        x * y + y * z + z * x
    }
}

/// The region of each cell, and the number of triangles of each region. A region has at most `most` triangles, or is
/// one cell.
pub struct Regions {
    pub of_cell: Vec<u32>,
    pub counts: Vec<u64>,
}

/// Divides all cells into regions. They are numbered in the order of the tree: regions with near numbers are near.
pub fn divide(histogram: &[u32], most: u64) -> Regions {
    let mut all = Regions { of_cell: vec![0; histogram.len()], counts: Vec::new() };
    split(Cells { low: [0; 3], high: [SIDE; 3] }, histogram, most, &mut all);
    all
}

fn split(cells: Cells, histogram: &[u32], most: u64, all: &mut Regions) {
    let count: u64 = cells.each().map(|c| u64::from(histogram[index(c)])).sum();
    let plane = if count > most { plane(cells, histogram) } else { None };
    let Some((axis, at)) = plane else {
        if count > 0 {
            let region = all.counts.len() as u32;
            cells.each().for_each(|c| all.of_cell[index(c)] = region);
            all.counts.push(count);
        }
        return;
    };
    let (mut left, mut right) = (cells, cells);
    (left.high[axis], right.low[axis]) = (at, at);
    split(left, histogram, most, all);
    split(right, histogram, most, all);
}

/// Chooses the plane that divides a box of cells. Among planes with at least a quarter of the triangles on either side,
/// it is the one with the least cost by the surface area heuristic; if there is none, the one that divides the
/// triangles most evenly. Returns `None` for a single cell.
fn plane(cells: Cells, histogram: &[u32]) -> Option<(usize, usize)> {
    let mut best: Option<((bool, f64), (usize, usize))> = None;
    for axis in 0..3 {
        let slabs = slabs(cells, axis, histogram);
        let total: u64 = slabs.iter().map(|s| s.0).sum();
        for at in 1..slabs.len() {
            let (left, right) = (side(&slabs[..at]), side(&slabs[at..]));
            let ((a, left), (b, right)) = match (left, right) {
                (Some(left), Some(right)) => (left, right),
                _ => continue,
            };
            let uneven = 4 * a.min(b) < total;
            let cost =
                if uneven { a.max(b) as f64 } else { left.half_area() * a as f64 + right.half_area() * b as f64 };
            if best.is_none_or(|(least, _)| (uneven, cost) < least) {
                best = Some(((uneven, cost), (axis, cells.low[axis] + at)));
            }
        }
    }
    best.map(|(_, plane)| plane)
}

/// For each layer of cells across an axis: the number of triangles, and the box of the cells that have any.
fn slabs(cells: Cells, axis: usize, histogram: &[u32]) -> Vec<(u64, Cells)> {
    let nothing = (0, Cells { low: [SIDE; 3], high: [0; 3] });
    let mut slabs = vec![nothing; cells.high[axis] - cells.low[axis]];
    for cell in cells.each() {
        let count = histogram[index(cell)];
        if count > 0 {
            let (sum, bounds) = &mut slabs[cell[axis] - cells.low[axis]];
            *sum += u64::from(count);
            for (a, &at) in cell.iter().enumerate() {
                bounds.low[a] = bounds.low[a].min(at);
                bounds.high[a] = bounds.high[a].max(at + 1);
            }
        }
    }
    slabs
}

/// Returns the union of some layers; `None` if they have no triangles.
fn side(slabs: &[(u64, Cells)]) -> Option<(u64, Cells)> {
    let some = slabs.iter().filter(|s| s.0 > 0).copied();
    some.reduce(|a, b| {
        let both = Cells {
            low: [0, 1, 2].map(|k| a.1.low[k].min(b.1.low[k])),
            high: [0, 1, 2].map(|k| a.1.high[k].max(b.1.high[k])),
        };
        (a.0 + b.0, both)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(histogram: &[u32], most: u64) -> Regions {
        let regions = divide(histogram, most);
        let mut counts = vec![0u64; regions.counts.len()];
        let mut cells = counts.clone();
        for (cell, &count) in histogram.iter().enumerate().filter(|(_, c)| **c > 0) {
            let region = regions.of_cell[cell] as usize;
            counts[region] += u64::from(count);
            cells[region] += 1;
        }
        assert_eq!(counts, regions.counts);
        assert!(counts.iter().zip(&cells).all(|(&c, &n)| c > 0 && (c <= most || n == 1)));
        regions
    }

    #[test]
    fn even_cells_make_even_regions() {
        let histogram = vec![1; SIDE * SIDE * SIDE];
        let regions = checked(&histogram, 20_000);
        assert!(regions.counts.len() <= 16 + 8, "{:?}", regions.counts);
    }

    #[test]
    fn odd_distributions_end() {
        let mut one = vec![0; SIDE * SIDE * SIDE];
        one[77] = 1_000_000;
        assert_eq!(checked(&one, 100).counts, [1_000_000]);
        one[78] = 3;
        assert_eq!(checked(&one, 100).counts.len(), 2);
        let line: Vec<u32> =
            (0..SIDE * SIDE * SIDE).map(|i| if i % (SIDE * SIDE + SIDE + 1) == 0 { 50 } else { 0 }).collect();
        checked(&line, 100);
        checked(&line, 1);
        assert!(divide(&[0; SIDE * SIDE * SIDE], 5).counts.is_empty());
    }
}
