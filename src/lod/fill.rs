//! Bounds the distance from a cell's **region** to original surface. The region is the part of the cell's box inside of
//! its oriented slabs; the hits of its stand-in lie there.
//!
//! The box is divided into 4x4x4 **subcells** of diagonal `D/4`, where `D` is the diagonal of the box. A subcell is
//! **occupied**, to within a distance `d`, if one of its points is known to be within `d` of original surface. A step
//! leads to a neighbour across a side, an edge or a corner. If all points of the region lie in subcells at most `k`
//! steps from an occupied one, each is within `(k + 1) D/4 + d` of original surface: along each axis the points of two
//! subcells that are `k` steps apart differ by at most `k + 1` subcells.
//!
//! If the triangles of the content are known, points on them occupy subcells to within 0. Otherwise the subcells of the
//! content's pieces do. An occupied subcell of a piece, of diagonal `p`, has a point within `d'` of original surface,
//! and its centre is within `p/2` of that point. The subcell that contains this centre is therefore occupied to within
//! `p/2 + d'`. As `p` halves from level to level, `d` tends to `D/8`. The stored level selects the least of a few
//! limits (see [`limit`]) that the bound keeps to.

use super::oriented_slabs::{Content, OrientedSlabs};
use crate::math::Bounds;
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::{DVec3, Vec3};

/// Limit of each level: all points of the region are within this part of the box's diagonal of original surface. Level
/// 0 states nothing. (Of the Mandelbulb's cells with at most 256 triangles 80 % have level 2; of larger cells 60 % have
/// level 1 and most others level 0.)
const LIMITS: [f64; 4] = [f64::INFINITY, 0.83, 0.63, 0.53];
/// Reduction of a cell's counted area for each level, where the walk decides if its stand-in is acceptable.
///
/// The error of a stand-in is bounded by its limit and not by its box. A cell of area `A` and diagonal `D` with limit
/// `c D` counts as one of area `s A`, where `s = max(1 - level * LESS, LEAST)` and `s >= c^2`. A cell of the same shape
/// with area `s A` has the diagonal `s^0.5 D`, which is at least `c D`. So if `s A` is acceptable, the error is at most
/// the diagonal of a cell of the same shape with the greatest acceptable area. The same bound holds for cells of
/// level 0.
pub const LESS: f32 = 0.3;
/// Least share of its area that a cell counts for.
pub const LEAST: f32 = 0.29;
/// Enlargement of the region across the planes of its slabs, as a part of the box's diagonal. Single precision moves
/// hits off the region by less, for boxes that are not too small (see [`sure_from`]). The bounds therefore hold for all
/// points that [`holds`] accepts.
const MARGIN: f64 = 1.0 / 32.0;
/// Upper bound on the rounding errors of double precision, as a part of the box's diagonal.
const ROUNDING: f64 = 1e-6;
/// Contents with more triangles than this are sampled with fewer points for each triangle.
const FEW: usize = 8;

/// Occupied subcells of a box.
#[derive(Debug, Clone, Copy)]
pub struct Fill {
    /// Bit `x + 4 y + 16 z`: the subcell is occupied.
    occupied: u64,
    /// Subcells are occupied to within this distance.
    within: f64,
}

impl Fill {
    /// Computes the occupied subcells of `cell` from its content.
    pub fn of(content: &Content, cell: &Bounds) -> Self {
        let grid = Grid::of(cell);
        let mut out = Self { occupied: 0, within: 0.0 };
        let (triangles, corners) = content.triangles();
        out.occupied = dispatch(Isa::best(), Points { grid: &grid, triangles, corners });
        for (cell, _, fill) in content.cells() {
            out.add_piece(&grid, &Grid::of(cell), fill);
        }
        out
    }

    /// Computes the occupied subcells of `cell` from points that are `within` this distance of its content. Points
    /// outside of the cell say nothing.
    pub fn of_points(points: impl Iterator<Item = DVec3>, within: f64, cell: &Bounds) -> Self {
        let grid = Grid::of(cell);
        let inside = |p: &DVec3| p.cmpge(grid.low).all() && p.cmple(grid.high).all();
        let occupied = points.filter(inside).fold(0, |all, p| all | grid.subcell(p));
        Self { occupied, within }
    }

    /// The middles of the occupied subcells of `cell`, and how far they are from its content at most.
    pub fn middles(&self, cell: &Bounds) -> (Vec<DVec3>, f64) {
        let grid = Grid::of(cell);
        let occupied = (0..64).filter(|bit| self.occupied >> bit & 1 == 1);
        (occupied.map(|bit| grid.middle(bit)).collect(), grid.size.length() * 0.5 + self.within)
    }

    fn add_piece(&mut self, grid: &Grid, piece: &Grid, fill: &Self) {
        self.within = self.within.max(piece.size.length() * 0.5 + fill.within);
        let mut left = fill.occupied;
        while left != 0 {
            self.occupied |= grid.subcell(piece.middle(left.trailing_zeros()));
            left &= left - 1;
        }
    }

    /// Returns the level of the part of `cell` inside of `slabs`.
    pub fn level(&self, cell: &Bounds, slabs: &OrientedSlabs<f32>) -> u32 {
        let grid = Grid::of(cell);
        let diagonal = (grid.high - grid.low).length();
        let region = grid.region(slabs, diagonal * MARGIN);
        let mut near = self.occupied;
        for steps in 1..=4 {
            if region & !near == 0 {
                let distance = f64::from(steps) * 0.25 + self.within / diagonal + ROUNDING;
                return (1..4).rev().find(|&level| distance <= LIMITS[level as usize]).unwrap_or(0);
            }
            near = with_neighbours(near);
        }
        0
    }
}

/// Greatest distance from points that [`holds`] accepts to original surface, as a part of the box's diagonal; infinite
/// if it is unknown.
#[inline(always)]
pub fn limit(level: u32) -> f64 {
    LIMITS[(level & 3) as usize]
}

/// True if a point of a cell's box is inside of its slabs, or outside by no more than the margin.
#[inline]
pub fn holds(cell: &Bounds, slabs: &OrientedSlabs<f32>, p: DVec3) -> bool {
    let margin = (cell.max.as_dvec3() - cell.min.as_dvec3()).length() * MARGIN;
    slabs.iter().all(|slab| {
        let at = Vec3::from(slab.axis).as_dvec3().dot(p);
        at >= f64::from(slab.low) - margin && at <= f64::from(slab.high) + margin
    })
}

/// Returns the least diagonal of a box for which [`holds`] certainly accepts hits of rays from `origin` through a tree
/// with coordinates of magnitude at most `max_coord`, in spite of single precision.
///
/// The errors, relative to the greatest of these coordinates and with `h = 2^-24`: the tolerance of a slab's planes is
/// 64 h, and the intersection with them is off by 50 h (`trace/oriented_slabs.rs`). The box's planes have 32 h and 7 h,
/// so clamping a point to the box moves it by `39 3^0.5 h`. The ends of the ray's interval are off by `2 3^0.5 h`. The
/// sum is less than 256 h.
#[inline]
pub fn sure_from(origin: DVec3, max_coord: f32) -> f64 {
    origin.abs().max_element().max(f64::from(max_coord)) * (256.0 / 16_777_216.0 / MARGIN)
}

/// Computes the subcells that contain points of triangles.
struct Points<'a> {
    grid: &'a Grid,
    triangles: &'a [[u16; 3]],
    corners: &'a [Vec3],
}

/// Number of points that are processed at once. A triangle has ten points, which divide each of its sides in three; the
/// remaining entries repeat the last point.
const TOGETHER: usize = 12;
/// Position of each point of a triangle along two of its sides.
const ALONG: [[f64; TOGETHER]; 2] = {
    const THIRD: f64 = 1.0 / 3.0;
    let (one, two, three) = (THIRD, 2.0 * THIRD, 3.0 * THIRD);
    [
        [0.0, 0.0, 0.0, 0.0, one, one, one, two, two, three, three, three],
        [0.0, one, two, three, 0.0, one, two, 0.0, one, 0.0, 0.0, 0.0],
    ]
};

impl Op for Points<'_> {
    type Out = u64;

    /// Uses no vector types of `simd`, which are single precision. The compiler vectorises the loops over points.
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u64 {
        let Self { grid, triangles, corners } = self;
        let mut occupied = [0; TOGETHER];
        if triangles.len() <= FEW {
            for triangle in triangles {
                let [a, b, c] = [0, 1, 2].map(|i| corners[usize::from(triangle[i])].as_dvec3());
                let (b, c) = (b - a, c - a);
                let mut points = [[0.0; TOGETHER]; 3];
                for axis in 0..3 {
                    for i in 0..TOGETHER {
                        points[axis][i] = a[axis] + b[axis] * ALONG[0][i] + c[axis] * ALONG[1][i];
                    }
                }
                grid.add(&points, &mut occupied);
            }
        } else {
            for some in corners.chunks(TOGETHER) {
                let mut points = [[f64::NAN; TOGETHER]; 3];
                for (i, p) in some.iter().enumerate() {
                    (points[0][i], points[1][i], points[2][i]) = (f64::from(p.x), f64::from(p.y), f64::from(p.z));
                }
                grid.add(&points, &mut occupied);
            }
            for some in triangles.chunks(TOGETHER) {
                let mut points = [[f64::NAN; TOGETHER]; 3];
                for (i, triangle) in some.iter().enumerate() {
                    let [a, b, c] = [0, 1, 2].map(|i| corners[usize::from(triangle[i])].as_dvec3());
                    let p = (a + b + c) * (1.0 / 3.0);
                    (points[0][i], points[1][i], points[2][i]) = (p.x, p.y, p.z);
                }
                grid.add(&points, &mut occupied);
            }
        }
        occupied.iter().fold(0, |all, one| all | one)
    }
}

/// The subcells of a box.
struct Grid {
    low: DVec3,
    high: DVec3,
    /// Extent of a subcell.
    size: DVec3,
    per_size: DVec3,
}

impl Grid {
    fn of(cell: &Bounds) -> Self {
        let (low, high) = (cell.min.as_dvec3(), cell.max.as_dvec3());
        let size = (high - low) * 0.25;
        // On an axis along which the box is flat, all points are in the first subcell.
        let per_size = DVec3::select(size.cmpgt(DVec3::ZERO), size.recip(), DVec3::ZERO);
        Self { low, high, size, per_size }
    }

    /// Sets the bits of the subcells that contain the points, each in a word of its own. Points outside of the box,
    /// from the other pieces of a split triangle, and NaN set no bit.
    #[inline(always)]
    fn add(&self, points: &[[f64; TOGETHER]; 3], occupied: &mut [u64; TOGETHER]) {
        let mut places = [0u64; TOGETHER];
        let mut inside = [u64::MAX; TOGETHER];
        for (axis, points) in points.iter().enumerate() {
            let (low, high, per_size) = (self.low[axis], self.high[axis], self.per_size[axis]);
            for i in 0..TOGETHER {
                let p = points[i];
                inside[i] &= if p >= low && p <= high { u64::MAX } else { 0 };
                let at = (p - low) * per_size;
                let place = u64::from(at >= 1.0) + u64::from(at >= 2.0) + u64::from(at >= 3.0);
                places[i] += place << (2 * axis);
            }
        }
        for i in 0..TOGETHER {
            occupied[i] |= (1 << places[i]) & inside[i];
        }
    }

    /// The bit of the subcell that contains a point.
    fn subcell(&self, p: DVec3) -> u64 {
        let at = (p - self.low) * self.per_size;
        // A cast turns negative values into zero.
        let [x, y, z] = [at.x, at.y, at.z].map(|v| (v as u32).min(3));
        1 << (x + 4 * y + 16 * z)
    }

    fn middle(&self, bit: u32) -> DVec3 {
        let at = DVec3::new(f64::from(bit & 3), f64::from(bit >> 2 & 3), f64::from(bit >> 4));
        self.low + self.size * (at + 0.5)
    }

    /// Subcells that may have points inside of the slabs, enlarged by `margin`.
    fn region(&self, slabs: &OrientedSlabs<f32>, margin: f64) -> u64 {
        let mut region = u64::MAX;
        for (axis, mask) in [FIRST_X, FIRST_Y, FIRST_Z].into_iter().enumerate() {
            if self.size[axis] <= 0.0 {
                region &= mask;
            }
        }
        for slab in slabs {
            let axis = Vec3::from(slab.axis).as_dvec3();
            let step = axis * self.size;
            let max_coord = step.abs().element_sum() * 0.5 + margin;
            let (low, high) = (f64::from(slab.low) - max_coord, f64::from(slab.high) + max_coord);
            let first = self.middle(0).dot(axis);
            let mut inside = 0;
            for row in 0..16u32 {
                let at = first + step.y * f64::from(row & 3) + step.z * f64::from(row >> 2);
                let mut bits = 0;
                for x in 0..4u32 {
                    let at = at + step.x * f64::from(x);
                    bits |= u64::from(at >= low && at <= high) << x;
                }
                inside |= bits << (4 * row);
            }
            region &= inside;
        }
        region
    }
}

/// Subcells that are first along an axis.
const FIRST_X: u64 = 0x1111_1111_1111_1111;
const FIRST_Y: u64 = 0x000f_000f_000f_000f;
const FIRST_Z: u64 = 0xffff;

/// The subcells and all their neighbours.
fn with_neighbours(cells: u64) -> u64 {
    let x = cells | (cells << 1 & !FIRST_X) | (cells & !FIRST_X) >> 1;
    let y = x | (x << 4 & !FIRST_Y) | (x & !FIRST_Y) >> 4;
    y | y << 16 | y >> 16
}

#[cfg(test)]
mod tests {
    use super::super::oriented_slabs::{Middle, fields, normal_bytes, oriented_slabs};
    use super::*;
    use proptest::prelude::*;

    type Tri = [Vec3; 3];

    /// Distance of a point from a triangle (Ericson, "Real-Time Collision Detection", 2004, section 5.1.5, by its
    /// feature planes).
    fn distance(p: DVec3, tri: &Tri) -> f64 {
        let [a, b, c] = tri.map(|v| v.as_dvec3());
        let edge = |a: DVec3, b: DVec3| {
            let along = b - a;
            let t = ((p - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            p.distance(a + along * if t.is_nan() { 0.0 } else { t })
        };
        let n = (b - a).cross(c - a);
        let inside = [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| n.cross(to - from).dot(p - from) >= 0.0);
        let plane = (p - a).dot(n).abs() / n.length();
        let edges = edge(a, b).min(edge(b, c)).min(edge(c, a));
        if inside && plane.is_finite() { plane.min(edges) } else { edges }
    }

    /// Slabs and occupied subcells of a piece, as the builder computes them.
    fn piece(content: &Content, cell: Bounds, normal: u16) -> (OrientedSlabs<f32>, Fill) {
        let middle = Middle { at: cell.center().to_array(), half: (cell.extent() * 0.5).to_array() };
        let word = content.oriented_slabs(normal.into(), &middle);
        (oriented_slabs(fields(word), normal_bytes(normal.into()), &middle), Fill::of(content, &cell))
    }

    fn around(triangles: &[Tri]) -> Bounds {
        Bounds::of(triangles.as_flattened())
    }

    /// Combines pieces to a content that keeps their cells and no triangles, as large contents do. Each piece has its
    /// normal.
    fn over(pieces: &[(Content, Bounds, u16)]) -> (Content, Bounds) {
        let cell = pieces.iter().fold(Bounds::EMPTY, |all, (_, cell, _)| all.union(*cell));
        let coded = pieces.iter().map(|(content, cell, normal)| {
            let (slabs, fill) = piece(content, *cell, *normal);
            (*cell, slabs, fill)
        });
        (Content::of_cells(coded.collect()), cell)
    }

    /// Checks points of a piece's region against all triangles. Returns the level.
    fn check(
        content: &Content,
        cell: Bounds,
        normal: u16,
        all: &[Tri],
        points: &[[f64; 3]],
    ) -> Result<u32, TestCaseError> {
        let (slabs, fill) = piece(content, cell, normal);
        let level = fill.level(&cell, &slabs);
        let limit = limit(level);
        let (low, extent) = (cell.min.as_dvec3(), cell.max.as_dvec3() - cell.min.as_dvec3());
        for p in points.iter().map(|p| low + extent * DVec3::from(*p)).filter(|p| holds(&cell, &slabs, *p)) {
            let nearest = all.iter().map(|t| distance(p, t)).fold(f64::INFINITY, f64::min);
            prop_assert!(nearest <= limit * extent.length(), "level {level}: {p} is {nearest} away");
        }
        Ok(level)
    }

    fn point() -> impl Strategy<Value = [f64; 3]> {
        // The bound is tight at corners and sides.
        let along = prop_oneof![Just(0.0), Just(1.0), 0.0..1.0f64];
        [along.clone(), along.clone(), along]
    }

    /// Triangles near a bent sheet in the unit box, small and large, some of them off the sheet.
    fn sheet() -> impl Strategy<Value = Vec<Tri>> {
        let corner = || [0.0f32..1.0, 0.0f32..1.0, -0.05f32..0.05];
        let one = (corner(), 0.02f32..0.6, [corner(), corner()]);
        (prop::collection::vec(one, 1..80), -0.5f32..0.5, -0.5f32..0.5).prop_map(|(all, slope, bend)| {
            let lift = |[x, y, z]: [f32; 3]| Vec3::new(x, y, z + slope * x + bend * y * y);
            let tri = |(a, size, [b, c]): ([f32; 3], f32, [[f32; 3]; 2])| {
                let to = |b: [f32; 3]| [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * size);
                [lift(a), lift(to(b)), lift(to(c))]
            };
            all.into_iter().map(tri).collect()
        })
    }

    proptest! {
        /// Few triangles are sampled all over, many by their corners and centroids. Each point sets the bit of its
        /// subcell, or none if it is outside of the box.
        #[test]
        fn points_occupy_their_subcells(triangles in sheet(), few in 1usize..20, shrink in 0.0f32..0.5) {
            let triangles = &triangles[..triangles.len().min(few)];
            let content = Content::of_points(triangles.as_flattened().to_vec());
            let cell = around(triangles);
            let cell = Bounds { max: cell.max - cell.extent() * shrink, ..cell };
            let grid = Grid::of(&cell);
            let mut expected = 0u64;
            let mut add = |p: DVec3| {
                if p.cmpge(grid.low).all() && p.cmple(grid.high).all() {
                    expected |= grid.subcell(p);
                }
            };
            for [a, b, c] in triangles.iter().map(|t| t.map(|p| p.as_dvec3())) {
                if triangles.len() <= FEW {
                    for (i, j) in (0..4).flat_map(|i| (0..4 - i).map(move |j| (f64::from(i), f64::from(j)))) {
                        add(a + (b - a) * (i * (1.0 / 3.0)) + (c - a) * (j * (1.0 / 3.0)));
                    }
                } else {
                    [a, b, c, (a + b + c) * (1.0 / 3.0)].into_iter().for_each(&mut add);
                }
            }
            let (triangles, corners) = content.triangles();
            for isa in Isa::ALL {
                let found = dispatch(isa, Points { grid: &grid, triangles, corners });
                prop_assert_eq!(found, expected, "{:x} {:x}", found, expected);
            }
        }

        #[test]
        fn region_of_a_leaf_is_within_its_limit(
            triangles in sheet(), normal: u16, points in prop::collection::vec(point(), 100),
        ) {
            let content = Content::of_points(triangles.as_flattened().to_vec());
            check(&content, around(&triangles), normal, &triangles, &points)?;
            // Tests a part of the cell as well, as spatial splits make it.
            let cell = around(&triangles);
            check(&content, Bounds { max: cell.max - cell.extent() * 0.4, ..cell }, normal, &triangles, &points)?;
        }

        #[test]
        fn region_of_an_inner_cell_is_within_its_limit(
            triangles in sheet(), normal: u16, points in prop::collection::vec(point(), 100),
        ) {
            // Three levels: quarters in x and y, then halves in x, then the whole.
            let quarter = |i: usize| {
                let within = |v: f32, k: usize| ((v * 4.0) as usize).min(3) == k;
                let here: Vec<Tri> = triangles.iter().filter(|t| within(t[0].x, i & 3) && within(t[0].y, i >> 2)).copied().collect();
                let cell = around(&here);
                (!here.is_empty()).then(|| (Content::of_points(here.as_flattened().to_vec()), cell, normal.wrapping_add(i as u16)))
            };
            let mut halves = Vec::new();
            for half in 0..4 {
                let below: Vec<_> = (0..4).filter_map(|i| quarter(4 * half + i)).collect();
                if !below.is_empty() {
                    let (content, cell) = over(&below);
                    check(&content, cell, normal, &triangles, &points)?;
                    halves.push((content, cell, normal));
                }
            }
            let (content, cell) = over(&halves);
            check(&content, cell, normal, &triangles, &points)?;
        }
    }

    /// A slanted wall of `n` by `n` squares, of which only a share of the width exists.
    fn wall(n: u32, share: f32) -> Vec<Tri> {
        let at = |i: u32, j: u32| {
            let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
            Vec3::new(x, y, 0.5 * x + 0.25 * y)
        };
        let squares = (0..n * n).map(|k| (k % n, k / n)).filter(|(i, _)| (*i as f32) < share * n as f32);
        squares
            .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i, j + 1)], [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]])
            .collect()
    }

    const TO_WALL: Vec3 = Vec3::new(-0.5, -0.25, 1.0);

    #[test]
    fn a_wall_has_the_best_level_and_a_strip_of_it_the_worst() {
        let normal = super::super::coded::octahedral(TO_WALL.normalize()) as u16;
        let (whole, strip) = (wall(8, 1.0), wall(8, 0.1));
        let content = |triangles: &[Tri]| Content::of_points(triangles.as_flattened().to_vec());
        let (slabs, fill) = piece(&content(&whole), around(&whole), normal);
        assert_eq!(fill.level(&around(&whole), &slabs), 3);
        assert_eq!(Fill::of(&content(&strip), &around(&whole)).level(&around(&whole), &slabs), 0);
        assert_eq!(Fill::of(&Content::default(), &around(&whole)).level(&around(&whole), &slabs), 0);
    }

    #[test]
    fn a_wall_of_pieces_has_a_good_level() {
        let normal = super::super::coded::octahedral(TO_WALL.normalize()) as u16;
        let all = wall(16, 1.0);
        let pieces: Vec<_> = (0..4)
            .map(|k| {
                let here: Vec<Tri> = all
                    .iter()
                    .filter(|t| (t[0].x >= 0.5) == (k & 1 == 1) && (t[0].y >= 0.5) == (k & 2 == 2))
                    .copied()
                    .collect();
                (Content::of_points(here.as_flattened().to_vec()), around(&here), normal)
            })
            .collect();
        let (content, cell) = over(&pieces);
        let (slabs, fill) = piece(&content, cell, normal);
        assert!(fill.level(&cell, &slabs) >= 2, "{fill:?}");
        assert!(fill.within > 0.0);
    }

    #[test]
    fn areas_count_for_no_less_than_the_square_of_the_limit() {
        for level in 1..4 {
            let share = (1.0 - LESS * level as f32).max(LEAST);
            assert!(f64::from(share) >= limit(level) * limit(level), "{level}: {share}");
        }
    }

    #[test]
    fn neighbours_are_those_that_touch() {
        for bit in 0..64u32 {
            let at = |b: u32| [b & 3, b >> 2 & 3, b >> 4];
            let near = |b: u32| (0..3).all(|k| at(b)[k].abs_diff(at(bit)[k]) <= 1);
            let expected = (0..64).filter(|b| near(*b)).fold(0, |all, b| all | 1u64 << b);
            assert_eq!(with_neighbours(1 << bit), expected, "{bit}");
        }
    }
}
