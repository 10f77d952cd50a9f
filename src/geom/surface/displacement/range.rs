//! Bounds of the heights of large rectangles, from a pyramid.

use crate::base::error::Result;
use crate::base::memory;

/// Cells along a side that are read at most, but for one: the more, the closer are the bounds of a large rectangle.
const CELLS: u32 = 8;

/// Of each map, levels of bounds: a cell of level k covers the areas of 2ᵏ × 2ᵏ texels, from k = 1 up to a level of few
/// cells.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pyramid {
    /// Offset and width of each level, in the cells of a map.
    levels: Vec<(usize, u32)>,
    /// Number of cells of a map.
    cells: usize,
    /// Rounded outwards.
    all: Vec<[f32; 2]>,
}

impl Pyramid {
    /// Bytes of memory.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(&self.all[..]) as u64
    }

    /// Makes the pyramids of `count` maps of a size. `texel` returns the bounds of the area of a texel, by map, column
    /// and row. Fails with [`crate::Error::NoMemory`].
    pub(super) fn new(size: [u32; 2], count: u32, texel: impl Fn(usize, u32, u32) -> [f64; 2]) -> Result<Self> {
        let (mut levels, mut cells, mut sizes) = (Vec::new(), 0, vec![size]);
        while let Some(&[width, height]) = sizes.last().filter(|size| size[0].max(size[1]) > CELLS) {
            let [width, height] = [width.div_ceil(2), height.div_ceil(2)];
            levels.push((cells, width));
            cells += width as usize * height as usize;
            sizes.push([width, height]);
        }
        let mut all: Vec<[f32; 2]> = memory::room(cells * count as usize, "the bounds of a displacement")?;
        for map in 0..count as usize {
            let begin = all.len();
            for (level, &[width, height]) in sizes[..levels.len()].iter().enumerate() {
                for (x, y) in (0..height).step_by(2).flat_map(|y| (0..width).step_by(2).map(move |x| (x, y))) {
                    let (right, down) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
                    let four =
                        [(x, y), (right, y), (x, down), (right, down)].map(|(x, y)| match level.checked_sub(1) {
                            None => outwards(texel(map, x, y)),
                            Some(below) => all[begin + levels[below].0 + y as usize * width as usize + x as usize],
                        });
                    all.push(four.into_iter().fold([f32::INFINITY, f32::NEG_INFINITY], union));
                }
            }
        }
        Ok(Self { levels, cells, all })
    }

    /// The least level of which not too many cells cover a rectangle of texels, ends included; 0 stands for the texels.
    pub(super) fn level(rectangle: [[u32; 2]; 2]) -> u32 {
        let longest = rectangle.iter().fold(0, |longest, [from, to]| longest.max(to - from + 1));
        longest.div_ceil(CELLS).next_power_of_two().trailing_zeros()
    }

    /// Bounds of the cells of a level, from 1 on, that cover a rectangle of texels of a map.
    pub(super) fn range(&self, map: usize, level: u32, rectangle: [[u32; 2]; 2]) -> [f64; 2] {
        let [columns, rows] = rectangle.map(|[from, to]| (from >> level) as usize..=(to >> level) as usize);
        let (offset, width) = self.levels[level as usize - 1];
        let row = |y: usize| &self.all[map * self.cells + offset + y * width as usize..][columns.clone()];
        let found = rows.flat_map(row).copied().fold([f32::INFINITY, f32::NEG_INFINITY], union);
        found.map(f64::from)
    }
}

fn union(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// The range in single precision that encloses one in double precision.
fn outwards([least, greatest]: [f64; 2]) -> [f32; 2] {
    let (low, high) = (least as f32, greatest as f32);
    let is_above = f64::from(low) > least;
    let is_below = f64::from(high) < greatest;
    [if is_above { low.next_down() } else { low }, if is_below { high.next_up() } else { high }]
}
