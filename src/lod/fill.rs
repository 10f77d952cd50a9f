//! How near to original surface all of the region is in which a cell is met: the part of its box inside of its slabs.
//!
//! The box is divided into 4x4x4 **subcells**, of diagonal `D/4` where `D` is the box's. A subcell is **occupied**, to
//! within a distance `d`, if original surface is known within `d` of some point of it. Where the region's points are
//! all in subcells that are at most `k` steps from an occupied one, a step being to a neighbour across a side, an edge
//! or a corner, each is within `(k + 1) D/4 + d` of original surface: along each axis a point of a subcell and one of
//! another that is `k` steps away are at most `k + 1` subcells apart.
//!
//! Of a content whose triangles are known, points of these occupy subcells, to within nothing. Of others the pieces'
//! subcells do: each occupied one of diagonal `p` has a point within `d'` of original surface, and its middle is within
//! `p/2` of that point; so the subcell that this middle is in is occupied to within `p/2 + d'`. As `p` is of half the
//! size from level to level, `d` tends to `D/8`.
//!
//! What is stored is a [`level`]: the greatest of a few limits, as parts of `D`, that the distance keeps to.
//!
//! **Where cells stand in.** It is what a stand-in's error may be that bounds it, and not its box: for a cell of which
//! nothing is known, both are the same. A cell of area `A` and diagonal `D` whose level says `c D` counts as one of
//! area `s A`, where `s >= c^2`: that of a cell of the same shape and of diagonal `s^0.5 D`, which is no less than `c
//! D`. So if `s A` is as large as may be, the error is no greater than the diagonal of a cell of the same shape whose
//! own area is as large as may be, as it is of cells of which nothing is known.
//!
//! Hits are in the region up to what single precision moves them by. So the region is taken larger, by [`MARGIN`] of
//! `D` across the slabs' planes, and what is said of it holds for all that [`holds`].

use super::oriented_slabs::{Content, OrientedSlabs};
use crate::math::Bounds;
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::{DVec3, Vec3};

/// Of each level: all of the region is within this part of the box's diagonal of original surface. The first says
/// nothing. (Of the Mandelbulb's cells of at most 256 triangles 80 % are of the third, of larger ones 60 % of the
/// second, most others of the first.)
const LIMITS: [f64; 4] = [f64::INFINITY, 0.83, 0.63, 0.53];
/// By how much less each level more makes a cell's area count where it may stand in. See the module: no less than the
/// square of the limit.
pub const LESS: f32 = 0.3;
/// What it counts for at least.
pub const LEAST: f32 = 0.29;
/// By how much the region is taken larger across its slabs' planes, as a part of the box's diagonal.
const MARGIN: f64 = 1.0 / 32.0;
/// What double precision rounds by is less, as a part of the box's diagonal.
const ROUNDING: f64 = 1e-6;
/// Of contents of more triangles than this fewer points of each are looked at.
const FEW: usize = 8;

/// What is known of where in a box there is original surface.
#[derive(Debug, Clone, Copy)]
pub struct Fill {
    /// Bit `x + 4 y + 16 z`: the subcell is occupied.
    occupied: u64,
    /// To within this.
    within: f64,
}

impl Fill {
    /// Of what `cell` holds.
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

    fn add_piece(&mut self, grid: &Grid, piece: &Grid, fill: &Self) {
        self.within = self.within.max(piece.size.length() * 0.5 + fill.within);
        let mut left = fill.occupied;
        while left != 0 {
            self.occupied |= grid.subcell(piece.middle(left.trailing_zeros()));
            left &= left - 1;
        }
    }

    /// The level of the part of `cell` inside of `slabs`.
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

/// How far original surface is at most from all that [`holds`], as a part of the box's diagonal; infinitely far if that
/// is not known.
#[inline(always)]
pub fn limit(level: u32) -> f64 {
    LIMITS[(level & 3) as usize]
}

/// Whether a point of a cell's box is inside of its slabs, or outside by no more than is allowed for.
#[inline]
pub fn holds(cell: &Bounds, slabs: &OrientedSlabs<f32>, p: DVec3) -> bool {
    let margin = (cell.max.as_dvec3() - cell.min.as_dvec3()).length() * MARGIN;
    slabs.iter().all(|slab| {
        let at = Vec3::from(slab.axis).as_dvec3().dot(p);
        at >= f64::from(slab.low) - margin && at <= f64::from(slab.high) + margin
    })
}

/// The least diagonal of a box for which points are sure to be what [`holds`], of rays from `origin` through a tree
/// whose coordinates are at most `reach` in magnitude: whatever single precision moves them off the region by.
///
/// Of the greatest of these coordinates, and with `h = 2^-24`: a slab's planes give way by 64 h, and where they are met
/// is off by 50 h (`trace/oriented_slabs.rs`); those of the box by 32 and 7, so that to take a point to the box moves
/// it by `39 3^0.5`; ends of the ray's interval are off by `2 3^0.5`. All of this is less than 256 h.
#[inline]
pub fn sure_from(origin: DVec3, max_coord: f32) -> f64 {
    origin.abs().max_element().max(f64::from(max_coord)) * (256.0 / 16_777_216.0 / MARGIN)
}

/// The subcells that points of triangles are in.
struct Points<'a> {
    grid: &'a Grid,
    triangles: &'a [[u16; 3]],
    corners: &'a [Vec3],
}

/// Points that are looked at together. Those of a triangle, of which each side is divided in three, are ten; these
/// repeat the last.
const TOGETHER: usize = 12;
/// How far along two sides of a triangle each of its points is.
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

    /// Without vectors of ours, which are of single precision: the loops over points become such.
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

/// A box's subcells.
struct Grid {
    low: DVec3,
    high: DVec3,
    /// Of a subcell.
    size: DVec3,
    per_size: DVec3,
}

impl Grid {
    fn of(cell: &Bounds) -> Self {
        let (low, high) = (cell.min.as_dvec3(), cell.max.as_dvec3());
        let size = (high - low) * 0.25;
        // Along an axis on which the box is flat all is in the first.
        let per_size = DVec3::select(size.cmpgt(DVec3::ZERO), size.recip(), DVec3::ZERO);
        Self { low, high, size, per_size }
    }

    /// The subcells that points are in, each into a word of its own; of those that are outside, for of a piece of a
    /// triangle the rest is elsewhere, or no numbers, none.
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

    /// The subcell that a point is in.
    fn subcell(&self, p: DVec3) -> u64 {
        let at = (p - self.low) * self.per_size;
        // A cast takes what is below zero to zero.
        let [x, y, z] = [at.x, at.y, at.z].map(|v| (v as u32).min(3));
        1 << (x + 4 * y + 16 * z)
    }

    fn middle(&self, bit: u32) -> DVec3 {
        let at = DVec3::new(f64::from(bit & 3), f64::from(bit >> 2 & 3), f64::from(bit >> 4));
        self.low + self.size * (at + 0.5)
    }

    /// The subcells that may have points inside of slabs that are larger by `margin`.
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

/// The subcells that are first along an axis.
const FIRST_X: u64 = 0x1111_1111_1111_1111;
const FIRST_Y: u64 = 0x000f_000f_000f_000f;
const FIRST_Z: u64 = 0xffff;

/// Subcells and all that touch them.
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

    /// A piece as the builder has it: its content with its box, slabs and what is known of it.
    fn piece(content: &Content, cell: Bounds, normal: u16) -> (OrientedSlabs<f32>, Fill) {
        let middle = Middle { at: cell.center().to_array(), half: (cell.extent() * 0.5).to_array() };
        let word = content.oriented_slabs(normal.into(), &middle);
        (oriented_slabs(fields(word), normal_bytes(normal.into()), &middle), Fill::of(content, &cell))
    }

    fn around(triangles: &[Tri]) -> Bounds {
        Bounds::of(triangles.as_flattened())
    }

    /// A piece over eight or fewer with nothing kept of triangles, as of large contents; of each the normal.
    fn over(pieces: &[(Content, Bounds, u16)]) -> (Content, Bounds) {
        let cell = pieces.iter().fold(Bounds::EMPTY, |all, (_, cell, _)| all.union(*cell));
        let coded = pieces.iter().map(|(content, cell, normal)| {
            let (slabs, fill) = piece(content, *cell, *normal);
            (*cell, slabs, fill)
        });
        (Content::of_cells(coded.collect()), cell)
    }

    /// Checks points of a piece's region against all triangles; returns the level.
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
        // Corners and sides are where it is tight.
        let along = prop_oneof![Just(0.0), Just(1.0), 0.0..1.0f64];
        [along.clone(), along.clone(), along]
    }

    /// Triangles about a bent sheet in the unit box, small and large, some off it.
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
        /// Few triangles by points all over them, many by their corners and middles; each where it is, or nowhere if
        /// that is outside.
        #[test]
        fn points_are_in_the_subcells_that_they_are_in(triangles in sheet(), few in 1usize..20, shrink in 0.0f32..0.5) {
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
        fn all_of_a_leafs_region_is_as_near_as_its_level_says(
            triangles in sheet(), normal: u16, points in prop::collection::vec(point(), 100),
        ) {
            let content = Content::of_points(triangles.as_flattened().to_vec());
            check(&content, around(&triangles), normal, &triangles, &points)?;
            // And of a part of it, as spatial splits make them.
            let cell = around(&triangles);
            check(&content, Bounds { max: cell.max - cell.extent() * 0.4, ..cell }, normal, &triangles, &points)?;
        }

        #[test]
        fn all_of_an_inner_cells_region_is_as_near_as_its_level_says(
            triangles in sheet(), normal: u16, points in prop::collection::vec(point(), 100),
        ) {
            // Three levels: by quarters in x and y, then halves in x, then all.
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

    /// A wall of `n` by `n` squares, up to a share of its width, slanted.
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
    fn a_wall_is_near_everywhere_and_a_strip_of_it_is_not() {
        let normal = super::super::coded::octahedral(TO_WALL.normalize()) as u16;
        let (whole, strip) = (wall(8, 1.0), wall(8, 0.1));
        let content = |triangles: &[Tri]| Content::of_points(triangles.as_flattened().to_vec());
        let (slabs, fill) = piece(&content(&whole), around(&whole), normal);
        assert_eq!(fill.level(&around(&whole), &slabs), 3);
        assert_eq!(Fill::of(&content(&strip), &around(&whole)).level(&around(&whole), &slabs), 0);
        assert_eq!(Fill::of(&Content::default(), &around(&whole)).level(&around(&whole), &slabs), 0);
    }

    #[test]
    fn a_wall_of_pieces_is_near_everywhere() {
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
