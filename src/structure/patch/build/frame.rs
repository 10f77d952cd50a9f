//! A frame from a tile of a grid: the system, the boxes of the quadtree, the words.

use super::cell::Cell;
use super::grid;
use crate::geom::surface::dice::BicubicPatch;
use crate::lod::{Facet, coded_normal};
use crate::math::Bounds;
use crate::structure::patch::codes::{Planes, child, children, encode};
use crate::structure::patch::layout::{FRAME_WORDS, ROOT, TURNED, of_morton, tree_words};
use glam::{DMat3, DVec3, Mat3, Vec3};

/// A square part of a surface: a grid of 2^level cells along each side.
#[derive(Debug, Clone)]
pub struct Tile {
    /// From 1 to [`crate::structure::patch::layout::MOST_LEVEL`].
    pub level: u32,
    /// Vertices relative to the tree's origin, rows along u; finite.
    pub positions: Vec<Vec3>,
    /// Their unit normals; zero where there is none.
    pub normals: Vec<Vec3>,
    /// The tree's local part, with its linear colour.
    pub part: u32,
    /// See `part`.
    pub colour: Vec3,
    /// Primitive id: number of the face.
    pub face: u32,
    /// Corner of a face that has other than four.
    pub corner: u32,
    /// Level of the tile in the square of the face, and its place there along x and along y.
    pub place: [u32; 3],
    /// True if x runs along the face's v: the tile was turned over.
    pub is_turned: bool,
    /// Level, column and row of the tile in the quad that it was diced from.
    pub square: [u32; 3],
    /// By how many levels the edges at the lower and the upper end of y, then of x, are coarser than the cells.
    pub steps: [u32; 4],
    /// The patch that it is a part of, relative to the tree's origin, if its vertices are to be computed.
    pub patch: Option<BicubicPatch>,
}

/// A frame before it is in a block.
#[derive(Debug)]
pub struct BuiltFrame {
    /// The words of the frame; the number of its grid is not entered yet.
    pub words: Vec<u32>,
    /// The words of the grid; the numbers of the first normal and of the net are not entered yet.
    pub grid: Vec<u32>,
    /// The words of the net of a computed grid.
    pub net: Option<Vec<u32>>,
    /// Codes of the normals of a stored grid.
    pub normals: Vec<u32>,
    /// What stand-ins above the frame know of it.
    pub cell: Cell,
    /// The local part.
    pub part: u32,
    /// Triangles that have an area.
    pub triangles: u64,
}

impl Tile {
    pub(super) fn side(&self) -> usize {
        (1 << self.level) + 1
    }

    /// True if a vertex is not at the border.
    pub fn is_inside(&self, number: usize) -> bool {
        let inside = 1..self.side() - 1;
        inside.contains(&(number % self.side())) && inside.contains(&(number / self.side()))
    }

    /// The corners of the two triangles of a cell.
    fn triangles_at(&self, i: usize, j: usize) -> [[Vec3; 3]; 2] {
        let at = |i: usize, j: usize| self.positions[j * self.side() + i];
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    }

    /// True if the cosine between each normal and their mean is at least this.
    pub fn is_flat(&self, cosine: f32) -> bool {
        let mean = self.normals.iter().sum::<Vec3>().normalize_or_zero();
        self.normals.iter().all(|n| *n == Vec3::ZERO || n.dot(mean) >= cosine)
    }

    /// A quarter: of the lower half along u for even numbers, along v for those below 2. The level is above 1.
    pub fn quarter(&self, number: usize) -> Self {
        let (side, half) = (self.side(), (self.side() - 1) / 2);
        let (i, j) = (number % 2, number / 2);
        let of = |all: &[Vec3]| {
            let row = |row: usize| (j * half + row) * side + i * half;
            (0..=half).flat_map(|at| all[row(at)..=row(at) + half].to_vec()).collect::<Vec<Vec3>>()
        };
        let below = |[level, column, row]: [u32; 3]| [level + 1, 2 * column + i as u32, 2 * row + j as u32];
        let ([a, b, c, d], at) = (self.steps, |is_there: bool, step: u32| if is_there { step } else { 0 });
        Self {
            level: self.level - 1,
            positions: of(&self.positions),
            normals: of(&self.normals),
            place: below(self.place),
            square: below(self.square),
            steps: [at(j == 0, a), at(j == 1, b), at(i == 0, c), at(i == 1, d)],
            patch: self.patch.as_ref().map(|patch| patch.quarter(i as u32, j as u32)),
            ..*self
        }
    }

    /// Turns the tile over: u and v change places, so that cells keep their diagonals.
    pub fn turn_over(&mut self) {
        let side = self.side();
        let turned = |all: &[Vec3]| (0..side * side).map(|at| all[at % side * side + at / side]).collect::<Vec<Vec3>>();
        self.positions = turned(&self.positions);
        self.normals = turned(&self.normals).into_iter().map(|n| -n).collect();
        self.place.swap(1, 2);
        self.is_turned = !self.is_turned;
        self.square.swap(1, 2);
        self.steps.rotate_left(2);
        self.patch = self.patch.as_ref().map(BicubicPatch::transposed);
    }

    /// The vertices around the tile, counter-clockwise in (u, v).
    pub fn border(&self) -> Vec<Vec3> {
        let last = self.side() - 1;
        let at = |i: usize, j: usize| self.positions[j * self.side() + i];
        let low = (0..last).map(|i| at(i, 0)).chain((0..last).map(|j| at(last, j)));
        low.chain((1..=last).rev().map(|i| at(i, last))).chain((1..=last).rev().map(|j| at(0, j))).collect()
    }

    /// The triangles that have an area.
    pub fn triangles(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        let cells = self.side() - 1;
        let all = (0..cells * cells).flat_map(move |cell| self.triangles_at(cell % cells, cell / cells));
        all.filter(|triangle| double_area(triangle) != DVec3::ZERO)
    }
}

fn double_area([a, b, c]: &[Vec3; 3]) -> DVec3 {
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
    (b - a).cross(c - a)
}

/// The local system of a frame.
struct System {
    centre: Vec3,
    map: Mat3,
}

/// Least thickness of a system as a share of its width, so that the map of a flat tile has an inverse.
const THIN: f64 = 1e-5;
/// Least sine of the angle between the sides of a system.
const SLANT: f64 = 0.05;

impl System {
    /// The system of a tile: x and y along the mean sides, z across them (the paper's frame F, section 3.3), scaled so
    /// that all vertices lie between -1 and 1.
    fn of(tile: &Tile) -> Self {
        let (side, last) = (tile.side(), tile.side() - 1);
        let at = |i: usize, j: usize| tile.positions[j * side + i].as_dvec3();
        let [a, b, c, d] = [at(0, 0), at(last, 0), at(0, last), at(last, last)];
        let (u, v) = ((b - a + d - c) * 0.5, (c - a + d - b) * 0.5);
        let axes = axes_of(u, v, &tile.positions);
        // Coordinates along the axes, around the middle of the tile's box, in single precision.
        let bounds = Bounds::of(&tile.positions);
        let rough = axes.inverse();
        let local = |p: &Vec3| rough * (p.as_dvec3() - bounds.center().as_dvec3());
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in &tile.positions {
            (low, high) = (low.min(local(p)), high.max(local(p)));
        }
        let centre = (bounds.center().as_dvec3() + axes * ((low + high) * 0.5)).as_vec3();
        Self { centre, map: map_around(&tile.positions, centre, rough) }
    }

    fn local(&self, p: Vec3) -> DVec3 {
        self.map.as_dmat3() * (p.as_dvec3() - self.centre.as_dvec3())
    }
}

/// Axes along the sides of a tile, and across them; any where the sides collapse.
fn axes_of(u: DVec3, v: DVec3, positions: &[Vec3]) -> DMat3 {
    let across = u.cross(v);
    if across.length() > SLANT * u.length() * v.length() && across.length() > 0.0 {
        return DMat3::from_cols(u.normalize(), v.normalize(), across.normalize());
    }
    // The longer side, and the normal of the largest triangle with it.
    let first = positions[0].as_dvec3();
    let along = if u.length() >= v.length() { u } else { v };
    let along = if along.length() > 0.0 { along } else { DVec3::X };
    let most = |a: DVec3, b: DVec3| if b.length_squared() > a.length_squared() { b } else { a };
    let normal = positions.iter().map(|p| along.cross(p.as_dvec3() - first)).fold(DVec3::ZERO, most);
    let normal = normal.try_normalize().unwrap_or_else(|| along.any_orthonormal_vector());
    let along = along.normalize();
    DMat3::from_cols(along, normal.cross(along), normal)
}

/// The linear map, in single precision, that takes all positions to between -1 and 1.
fn map_around(positions: &[Vec3], centre: Vec3, rough: DMat3) -> Mat3 {
    let reach = |map: &DMat3| {
        positions.iter().fold(DVec3::ZERO, |most, p| most.max((*map * (p.as_dvec3() - centre.as_dvec3())).abs()))
    };
    let most = reach(&rough);
    let least = (most.max_element() * THIN).max(f64::from(f32::MIN_POSITIVE) * 1e6);
    let half = most.max(DVec3::splat(least));
    let mut scale = DVec3::ONE / half;
    loop {
        let map = (DMat3::from_diagonal(scale) * rough).as_mat3();
        if reach(&map.as_dmat3()).max_element() <= 1.0 {
            return map;
        }
        scale *= 1.0 - 1e-7;
    }
}

/// Builds the frame of a tile.
pub fn build(tile: &Tile) -> BuiltFrame {
    let (system, levels) = (System::of(tile), tile.level - 1);
    let second = cell_of(tile);
    let words = words_of(tile, &system, levels, second.second());
    let (grid, net, normals) = match grid::computed(tile) {
        Some((grid, net)) => (grid, Some(net), Vec::new()),
        None => grid::stored(tile),
    };
    let triangles = tile.triangles().count() as u64;
    BuiltFrame { words, grid, net, normals, cell: second, part: tile.part, triangles }
}

fn words_of(tile: &Tile, system: &System, levels: u32, second: u32) -> Vec<u32> {
    let rows = system.map.transpose();
    let numbers = [system.centre, rows.x_axis, rows.y_axis, rows.z_axis];
    let mut words: Vec<u32> = numbers.iter().flat_map(|v| v.to_array().map(f32::to_bits)).collect();
    let ([level, column, row], turned) = (tile.place, if tile.is_turned { TURNED << 28 } else { 0 });
    words.extend([tile.part, tile.face, levels, level | column << 4 | row << 16 | turned, tile.corner]);
    let last = tile.side() - 1;
    let mean = tile.normals.iter().sum::<Vec3>().normalize_or(Vec3::Z);
    let normal = |i: usize, j: usize| coded_normal(tile.normals[j * tile.side() + i].normalize_or(mean));
    words.extend([normal(0, 0) | normal(last, 0) << 16, normal(0, last) | normal(last, last) << 16, second]);
    debug_assert_eq!(words.len(), FRAME_WORDS);
    words.extend(tree_of(tile, system, levels));
    words
}

/// The words of the quadtree's inner nodes.
fn tree_of(tile: &Tile, system: &System, levels: u32) -> Vec<u32> {
    let local: Vec<DVec3> = tile.positions.iter().map(|p| system.local(*p)).collect();
    // The boxes of each level, the leaves last.
    let mut boxes: Vec<Vec<[f64; 6]>> = vec![leaf_boxes(&local, tile.side(), levels)];
    for _ in 0..levels {
        let above = boxes[0].chunks(4).map(|four| four.iter().fold(NOTHING, union)).collect();
        boxes.insert(0, above);
    }
    let mut words = Vec::with_capacity(tree_words(levels));
    let mut planes: Vec<Planes> = vec![ROOT];
    for level in 0..levels as usize {
        let mut next = Vec::with_capacity(4 * planes.len());
        for (node, four) in planes.iter().zip(boxes[level + 1].as_chunks::<4>().0) {
            let word = encode(four, node);
            words.push(word);
            let decoded = children(word, node);
            next.extend((0..4).map(|which| child(&decoded, which)));
        }
        planes = next;
    }
    words
}

const NOTHING: [f64; 6] =
    [f64::INFINITY, f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];

fn union(all: [f64; 6], one: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| if i < 3 { all[i].min(one[i]) } else { all[i].max(one[i]) })
}

/// The boxes of the leaves: nine vertices each.
fn leaf_boxes(local: &[DVec3], side: usize, levels: u32) -> Vec<[f64; 6]> {
    let leaves = 1usize << (2 * levels);
    let of_leaf = |number: usize| {
        let (i, j) = of_morton(number);
        (0..9).fold(NOTHING, |all, at| {
            let p = local[(2 * j + at / 3) * side + 2 * i + at % 3];
            union(all, &[p.x, p.y, p.z, p.x, p.y, p.z])
        })
    };
    (0..leaves).map(of_leaf).collect()
}

/// Cells along a side that the voxel of a frame is made of.
const FACETS: usize = 8;

fn cell_of(tile: &Tile) -> Cell {
    let cells = tile.side() - 1;
    let step = (cells / FACETS).max(1);
    let mut facets = Vec::with_capacity(2 * FACETS * FACETS);
    for (i, j) in (0..cells).step_by(step).flat_map(|j| (0..cells).step_by(step).map(move |i| (i, j))) {
        let at = |i: usize, j: usize| tile.positions[j * tile.side() + i];
        let [a, b, c, d] = [at(i, j), at(i + step, j), at(i + step, j + step), at(i, j + step)];
        for [p, q, r] in [[a, b, c], [a, c, d]] {
            let normal = (q - p).cross(r - p);
            facets.push(Facet { normal, colour: tile.colour, part: tile.part, is_own_colour: false });
        }
    }
    let side = tile.side();
    let corners = |cell: usize| {
        let (i, j) = (cell % cells, cell / cells);
        let at = |i: usize, j: usize| (j * side + i) as u16;
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    };
    Cell::of_triangles(tile.positions.clone(), (0..cells * cells).flat_map(corners).collect(), &facets)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::structure::patch::layout::{Frame, bounds_of};
    use proptest::prelude::*;

    fn tile(level: u32, at: impl Fn(f32, f32) -> Vec3) -> Tile {
        let side = (1 << level) + 1;
        let share = |i: usize| i as f32 / (side - 1) as f32;
        let positions: Vec<Vec3> = (0..side * side).map(|k| at(share(k % side), share(k / side))).collect();
        let normals = vec![Vec3::Z; positions.len()];
        Tile {
            level,
            positions,
            normals,
            part: 0,
            colour: Vec3::ONE,
            face: 0,
            corner: 0,
            place: [0; 3],
            is_turned: false,
            square: [0; 3],
            steps: [0; 4],
            patch: None,
        }
    }

    /// All vertices of a node are in its decoded box, and in the box around that in the tree's frame.
    fn check(tile: &Tile) {
        let built = build(tile);
        let (head, tree) = built.words.split_first_chunk::<FRAME_WORDS>().unwrap();
        let frame = Frame { head, tree };
        assert_eq!((frame.size(), tree.len()), (built.words.len(), tree_words(frame.levels())));
        let (map, centre) = (frame.map().as_dmat3(), frame.centre().as_dvec3());
        let side = tile.side();
        for level in 0..=frame.levels() {
            let span = (side - 1) >> level;
            for number in 0..1 << (2 * level) {
                let planes = crate::structure::patch::trace::planes_of(&frame, level, number);
                let around = bounds_of(&planes, &frame.back(), frame.centre());
                let (i, j) = of_morton(number);
                for k in 0..(span + 1) * (span + 1) {
                    let p = tile.positions[(j * span + k / (span + 1)) * side + i * span + k % (span + 1)];
                    let local = map * (p.as_dvec3() - centre);
                    for axis in 0..3 {
                        let inside = f64::from(planes[axis])..=f64::from(planes[axis + 3]);
                        assert!(inside.contains(&local[axis]), "{level} {number}: {local} in {planes:?}");
                    }
                    assert!(p.cmpge(around.min).all() && p.cmple(around.max).all());
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn boxes_hold_their_vertices(
            level in 1u32..=4,
            corners in prop::array::uniform12(-2.0f32..2.0),
            bend in -1.0f32..1.0,
            far in prop::sample::select(vec![0.0f32, 10.0, 1e5]),
        ) {
            let corner = |i: usize| Vec3::new(corners[3 * i] + far, corners[3 * i + 1] - far, corners[3 * i + 2]);
            check(&tile(level, |u, v| {
                let low = corner(0).lerp(corner(1), u);
                low.lerp(corner(2).lerp(corner(3), u), v) + Vec3::new(u * v, v * v, bend * u * u) * bend
            }));
        }
    }

    /// Tiles that collapse to lines or to a point, flat ones, and tiny ones.
    #[test]
    fn degenerate_tiles_have_a_system() {
        check(&tile(2, |u, v| Vec3::new(u, v, 0.0)));
        check(&tile(2, |u, _| Vec3::new(u, 2.0 * u, 1.0)));
        check(&tile(2, |_, v| Vec3::new(7.0, v * v, 1.0)));
        check(&tile(3, |_, _| Vec3::splat(0.1)));
        check(&tile(1, |u, v| Vec3::new(u, v, u * v) * 1e-20));
        check(&tile(3, |u, v| Vec3::new(u * v, v, 0.3 * u * v)));
        check(&tile(3, |u, v| Vec3::new(u, u + 1e-6 * v, 1e-9 * v * v)));
    }

    /// A flat tile has tight boxes: 16 leaves fill little more than the tile.
    #[test]
    fn even_tiles_have_tight_boxes() {
        let tile = tile(3, |u, v| Vec3::new(2.0 * u + 0.3 * v, v, 0.1 * u));
        let built = build(&tile);
        let (head, tree) = built.words.split_first_chunk::<FRAME_WORDS>().unwrap();
        let frame = Frame { head, tree };
        let area = |number: usize| {
            let p = crate::structure::patch::trace::planes_of(&frame, 2, number);
            (p[3] - p[0]) * (p[4] - p[1])
        };
        let all: f32 = (0..16).map(area).sum();
        assert!((4.0..4.1).contains(&all), "{all} of 4");
    }
}
