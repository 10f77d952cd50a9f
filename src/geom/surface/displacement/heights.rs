//! Heights as a biquadratic B-spline in texels.
//!
//! Texel i of a row is the control value in the middle of its area, and the knots are the borders of the areas. Thus
//! each area is one polynomial piece of 3 × 3 texels, and the gradient is continuous. The Bézier coefficients of a
//! piece are the texel itself and means of neighbours; they bound the heights.

use super::range::Pyramid;
use crate::base::error::{Error, Result};

/// Coordinates of this many texels and more are not known to a texel.
const FARTHEST: f64 = (1u64 << 40) as f64;

/// The texels beyond the border of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The map repeats.
    #[default]
    Repeat,
    /// The texels of the border go on. Along the border, the heights depend on its texels alone.
    Clamp,
}

impl Wrap {
    /// The texel that stands at an index.
    #[inline]
    fn index(self, i: i64, size: u32) -> usize {
        match self {
            Self::Repeat => i.rem_euclid(i64::from(size)) as usize,
            Self::Clamp => i.clamp(0, i64::from(size) - 1) as usize,
        }
    }
}

/// A height and its derivatives by two parameters, in heights over squares of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HeightSample {
    /// The height.
    pub value: f64,
    /// First derivatives.
    pub gradient: [f64; 2],
    /// Second derivatives: by the first parameter, mixed, by the second. They jump at the borders of texels.
    pub second: [f64; 3],
}

impl HeightSample {
    /// The first derivatives by the parameters u and v of a surface, from those by the coordinates s and t of a map:
    /// `ds` are the derivatives of s by u and v, `dt` those of t.
    pub fn gradient_by(&self, ds: [f64; 2], dt: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| self.gradient[0] * ds[axis] + self.gradient[1] * dt[axis])
    }
}

/// Maps of heights of one size: a texture, or a grid for each face of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Heights {
    size: [u32; 2],
    wrap: [Wrap; 2],
    /// All maps, one after another: rows along s, the first one at t = 0.
    texels: Vec<f32>,
    /// The greatest magnitude of a texel.
    greatest: f64,
    pyramid: Pyramid,
}

impl Heights {
    /// Takes over `count` maps of `size[0]` × `size[1]` texels, each in rows of constant t, beginning with s = t = 0.
    /// Heights are in the surface's unit of length.
    ///
    /// Fails with [`Error::BadArgument`] if a size is 0, the number of texels differs, or a texel is not finite, which
    /// the error names; with [`Error::NoMemory`] for bounds of up to two thirds of the texels' bytes.
    pub fn new(size: [u32; 2], count: u32, wrap: [Wrap; 2], texels: Vec<f32>) -> Result<Self> {
        let fault = |why: String| Err(Error::BadArgument(format!("displacement: {why}")));
        let [width, height] = size;
        let area = u64::from(width) * u64::from(height);
        if area.checked_mul(u64::from(count)) != Some(texels.len() as u64) || texels.is_empty() {
            return fault(format!("{} texels are not {count} maps of {width} × {height}, or none", texels.len()));
        }
        if let Some(at) = texels.iter().position(|h| !h.is_finite()) {
            let (map, at) = (at as u64 / area, at as u64 % area);
            let (x, y) = (at % u64::from(width), at / u64::from(width));
            return fault(format!("texel ({x}, {y}) of map {map} is not finite"));
        }
        let greatest = texels.iter().fold(0.0, |most: f32, h| most.max(h.abs()));
        let range = |map: usize, column: u32, row: u32| {
            let texels = &texels[map * area as usize..][..area as usize];
            piece_range(neighbours(texels, size, wrap, [i64::from(column), i64::from(row)]), [[0.0, 1.0]; 2])
        };
        let pyramid = Pyramid::new(size, count, range)?;
        Ok(Self { size, wrap, texels, greatest: f64::from(greatest), pyramid })
    }

    /// Width and height of a map in texels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Number of maps.
    pub fn count(&self) -> u32 {
        (self.texels.len() / self.area()) as u32
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        size_of_val(&self.texels[..]) as u64 + self.pyramid.bytes()
    }

    fn area(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// The height at (s, t) of a map, which covers `[0, 1]²`; other coordinates are wrapped. A coordinate that is not
    /// finite, or exceeds 2⁴⁰ texels, is taken as 0.
    ///
    /// # Panics
    /// Panics unless `map` is less than [`Self::count`].
    pub fn sample(&self, map: u32, s: f64, t: f64) -> HeightSample {
        let texels = &self.texels[map as usize * self.area()..][..self.area()];
        let (column, along_s) = piece(s, self.size[0]);
        let (row, along_t) = piece(t, self.size[1]);
        // The value and both derivatives by s, in each of three rows.
        let rows = neighbours(texels, self.size, self.wrap, [column, row])
            .map(|values| along_s.map(|weights| sum(weights, values)));
        let at = |by_s: usize, by_t: usize| sum(along_t[by_t], rows.map(|sums| sums[by_s]));
        HeightSample { value: at(0, 0), gradient: [at(1, 0), at(0, 1)], second: [at(2, 0), at(1, 1), at(0, 2)] }
    }

    /// Bounds of the heights of a map within a rectangle, the ranges of s and of t; wider by rounding. Those of a
    /// rectangle of at most 8 × 8 texels are its Bézier coefficients; of a larger one those of whole texels, up to a
    /// quarter of its side around it, from at most 81 cells, and four times as many across seams. An empty range is
    /// taken as its first value, one that is not finite as the whole map.
    ///
    /// # Panics
    /// Panics unless `map` is less than [`Self::count`].
    pub fn range(&self, map: u32, [s, t]: [[f64; 2]; 2]) -> [f64; 2] {
        let mut found = [f64::INFINITY, f64::NEG_INFINITY];
        for rows in stretches(t, self.size[1], self.wrap[1]).into_iter().flatten() {
            for columns in stretches(s, self.size[0], self.wrap[0]).into_iter().flatten() {
                found = union(found, self.range_within(map as usize, [columns, rows]));
            }
        }
        // Weights sum to 1 but for some units in the last place.
        let margin = 16.0 * f64::EPSILON * self.greatest;
        [found[0] - margin, found[1] + margin]
    }

    /// The range within stretches of texels that do not cross the border of the map.
    fn range_within(&self, map: usize, [columns, rows]: [Stretch; 2]) -> [f64; 2] {
        let mut found = [f64::INFINITY, f64::NEG_INFINITY];
        let level = Pyramid::level([columns.texels, rows.texels]);
        if level > 0 {
            return self.pyramid.range(map, level, [columns.texels, rows.texels]);
        }
        let texels = &self.texels[map * self.area()..][..self.area()];
        for row in rows.texels[0]..=rows.texels[1] {
            for column in columns.texels[0]..=columns.texels[1] {
                let near = neighbours(texels, self.size, self.wrap, [i64::from(column), i64::from(row)]);
                found = union(found, piece_range(near, [columns.part_of(column), rows.part_of(row)]));
            }
        }
        found
    }
}

fn sum(weights: [f64; 3], values: [f64; 3]) -> f64 {
    weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2]
}

/// A coordinate in texels.
fn in_texels(s: f64, size: u32) -> f64 {
    let x = s * f64::from(size);
    if x.abs() < FARTHEST { x } else { 0.0 }
}

/// The texel that a coordinate is in; and of it and its neighbours the weights of the value and of both derivatives by
/// the coordinate.
fn piece(s: f64, size: u32) -> (i64, [[f64; 3]; 3]) {
    let x = in_texels(s, size);
    let (f, n) = (x - x.floor(), f64::from(size));
    let value = [0.5 * (1.0 - f) * (1.0 - f), 0.5 + f * (1.0 - f), 0.5 * f * f];
    let first = [(f - 1.0) * n, (1.0 - 2.0 * f) * n, f * n];
    (x.floor() as i64, [value, first, [n * n, -2.0 * n * n, n * n]])
}

/// A texel and its neighbours, in rows.
fn neighbours(texels: &[f32], size: [u32; 2], wrap: [Wrap; 2], [column, row]: [i64; 2]) -> [[f64; 3]; 3] {
    let columns = [-1, 0, 1].map(|i| wrap[0].index(column + i, size[0]));
    [-1, 0, 1].map(|j| {
        let line = &texels[wrap[1].index(row + j, size[1]) * size[0] as usize..];
        columns.map(|i| f64::from(line[i]))
    })
}

/// Least and greatest Bézier coefficient of a part of a texel's area, of which the texel and its neighbours are the
/// control values. The part is given by ranges within `[0, 1]`.
fn piece_range(near: [[f64; 3]; 3], [along_s, along_t]: [[f64; 2]; 2]) -> [f64; 2] {
    let rows = near.map(|row| coefficients(row, along_s));
    let columns = [0, 1, 2].map(|i| coefficients(rows.map(|row| row[i]), along_t));
    let all = columns.as_flattened();
    all.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |found, &c| union(found, [c, c]))
}

/// The Bézier coefficients of a quadratic B-spline over a part of its middle span: its blossom at the ends.
fn coefficients([a, b, c]: [f64; 3], [begin, end]: [f64; 2]) -> [f64; 3] {
    // The knots around the span are −1, 0, 1 and 2.
    let blossom = |x: f64, y: f64| {
        let (lower, upper) = (a + (b - a) * 0.5 * (x + 1.0), b + (c - b) * 0.5 * x);
        lower + (upper - lower) * y
    };
    [blossom(begin, begin), blossom(begin, end), blossom(end, end)]
}

fn union(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// A range of a coordinate in texels that does not cross the border of a map.
#[derive(Clone, Copy)]
struct Stretch {
    /// First and last texel.
    texels: [u32; 2],
    /// Parts of the area of the first and of the last texel: first and last coordinate within it.
    begin: f64,
    end: f64,
}

impl Stretch {
    /// The part of a texel's area, as a range within `[0, 1]`.
    fn part_of(&self, texel: u32) -> [f64; 2] {
        let [first, last] = self.texels;
        [if texel == first { self.begin } else { 0.0 }, if texel == last { self.end } else { 1.0 }]
    }
}

/// The stretches of the texels that a range of a coordinate is in, at most two.
fn stretches([begin, end]: [f64; 2], size: u32, wrap: Wrap) -> [Option<Stretch>; 2] {
    let whole = [Some(Stretch { texels: [0, size - 1], begin: 0.0, end: 1.0 }), None];
    let is_known = |s: f64| (s * f64::from(size)).abs() < FARTHEST;
    if !is_known(begin) || !is_known(end) {
        return whole;
    }
    let [begin, end] = [begin, end.max(begin)].map(|s| in_texels(s, size));
    let [first, last] = [begin, end].map(|x| x.floor() as i64);
    let [from, to] = [first, last].map(|i| wrap.index(i, size) as u32);
    let (begin, end) = (begin - begin.floor(), end - end.floor());
    match wrap {
        // Beyond the border, heights are those of the border.
        Wrap::Clamp => {
            let begin = if first < 0 {
                0.0
            } else if first >= i64::from(size) {
                1.0
            } else {
                begin
            };
            let end = if last < 0 {
                0.0
            } else if last >= i64::from(size) {
                1.0
            } else {
                end
            };
            [Some(Stretch { texels: [from, to], begin, end }), None]
        }
        Wrap::Repeat if last - first >= i64::from(size) => whole,
        Wrap::Repeat if from <= to => [Some(Stretch { texels: [from, to], begin, end }), None],
        Wrap::Repeat => [
            Some(Stretch { texels: [from, size - 1], begin, end: 1.0 }),
            Some(Stretch { texels: [0, to], begin: 0.0, end }),
        ],
    }
}
