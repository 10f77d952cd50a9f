//! Normals and parts of what the rays of a packet hit, all at once: reading them is a few loads a ray that do not wait for each
//! other, and the arithmetic goes over all rays in vectors. The answers are, to the bit, those of [`super::finish`] and of
//! [`super::stand_in`], which do the same for one ray.

use super::{finish, stand_in};
use crate::base::ids::BlockId;
use crate::lod::{stored_colour, stored_normal};
use crate::math::Bounds;
use crate::scene::placed::Placed;
use crate::scene::walk::{SceneView, bits};
use crate::simd::{Op, Simd, dispatch, prefetch};
use crate::structure::bvh::layout::{Block, Node, StoredVoxel};
use crate::structure::bvh::trace::{PACKET, PacketSurfaces, PacketWalk};
use glam::{DVec3, Vec3};

/// A number for each ray, or for each triangle that was hit.
type Row<T> = [T; PACKET];
/// Triangles up to which half the work does.
const FEW: usize = PACKET / 2;

/// A triangle that rays of a packet hit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facet {
    /// The rays that hit it.
    pub rays: u32,
    /// Its normal in the world, of any length.
    pub across: DVec3,
    /// The same of length 1.
    pub unit: Vec3,
    /// The model's part.
    pub part: u32,
}

/// What the rays of a packet see. Reusable.
#[derive(Debug)]
#[repr(C, align(64))]
pub(crate) struct Surfaces {
    /// Corners of triangles, axis by axis; so many triangles as were hit.
    corners: [[Row<f32>; 3]; 3],
    /// Their normals of any length, and of length 1.
    across: [Row<f64>; 3],
    unit: [Row<f32>; 3],
    is_extreme: Row<u32>,
    part: Row<u32>,
    /// Of rays that hit cells: their directions; and where a cell has a sample for each side, origin and direction in the
    /// tree's frame and the planes that are met first.
    dir: [Row<f32>; 3],
    local: [[Row<f64>; 3]; 2],
    planes: [Row<f32>; 3],
    /// The side that a cell is entered by, and the word of its normal.
    side: Row<u32>,
    word: Row<u32>,
    /// See [`Surfaces::cell`].
    normal: [Row<f32>; 3],
    part_of_cell: Row<u32>,
    /// For pictures: the words of cells' colours, those of which they count, and their boxes.
    colour: Row<u32>,
    coloured: u32,
    boxes: [Row<f32>; 6],
    hits: PacketSurfaces,
}

impl Default for Surfaces {
    fn default() -> Self {
        let none = [[0.0; PACKET]; 3];
        let precise = [[0.0; PACKET]; 3];
        Self {
            corners: [none; 3],
            across: precise,
            unit: none,
            is_extreme: [0; PACKET],
            part: [0; PACKET],
            dir: none,
            local: [precise; 2],
            planes: none,
            side: [0; PACKET],
            word: [0; PACKET],
            normal: none,
            part_of_cell: [0; PACKET],
            colour: [0; PACKET],
            coloured: 0,
            boxes: [[0.0; PACKET]; 6],
            hits: PacketSurfaces::default(),
        }
    }
}

impl Surfaces {
    /// Looks at what rays hit in a scene's one placed tree, `placed`, whose frame differs from the world by its zero only;
    /// `met`: those with hits in `walk`. False if that cannot be told here: of stand-ins for what is missing, of what is no
    /// longer in memory, and of normals that single precision cannot tell.
    ///
    /// `ray`: origin and direction of one. `PICTURE`: what pictures need of stand-ins too.
    pub fn look<const PICTURE: bool>(
        &mut self,
        view: &SceneView,
        placed: u32,
        ray: impl Fn(usize) -> (DVec3, Vec3),
        walk: &PacketWalk,
        met: u32,
    ) -> bool {
        walk.hits(view.tree(placed).isa, met, &mut self.hits);
        self.coloured = 0;
        (self.hits.count == 0 || self.look_at_triangles(view, placed, walk))
            && (self.hits.cells == 0 || self.look_at_cells::<PICTURE>(view, placed, ray, walk))
    }

    /// The triangles that were hit.
    pub fn triangles(&self) -> impl Iterator<Item = Facet> {
        (0..self.hits.count).map(|s| Facet {
            rays: self.hits.rays[s],
            across: DVec3::new(self.across[0][s], self.across[1][s], self.across[2][s]),
            unit: Vec3::new(self.unit[0][s], self.unit[1][s], self.unit[2][s]),
            part: self.part[s],
        })
    }

    /// The rays that hit stand-ins.
    pub fn cells(&self) -> u32 {
        self.hits.cells
    }

    /// What ray `i` of those sees: the unit normal in the world, against the ray, and the model's part.
    #[inline]
    pub fn cell(&self, i: usize) -> (Vec3, u32) {
        (Vec3::new(self.normal[0][i], self.normal[1][i], self.normal[2][i]), self.part_of_cell[i])
    }

    /// Those of which the colour counts, and not that of the part.
    pub fn coloured(&self) -> u32 {
        self.coloured
    }

    /// The linear colour that ray `i` of those sees.
    #[inline]
    pub fn colour_of_cell(&self, i: usize) -> Vec3 {
        stored_colour(self.colour[i])
    }

    /// Unit normals against the rays, whose directions are `dir`, and parts, ray by ray.
    pub fn each(&self, dir: &[Row<f32>; 3], normals: &mut [Row<f32>; 3], parts: &mut Row<u32>) {
        for facet in self.triangles() {
            for i in bits(facet.rays) {
                let turn = finish::faces_away(facet.across, DVec3::new(dir[0][i].into(), dir[1][i].into(), dir[2][i].into()));
                let normal = if turn { -facet.unit } else { facet.unit };
                (normals[0][i], normals[1][i], normals[2][i]) = (normal.x, normal.y, normal.z);
                parts[i] = facet.part;
            }
        }
        for i in bits(self.cells()) {
            (normals[0][i], normals[1][i], normals[2][i]) = (self.normal[0][i], self.normal[1][i], self.normal[2][i]);
            parts[i] = self.part_of_cell[i];
        }
    }

    /// Errors of the hits of rays that begin at `eye` on cells, `t` from there, in the world; of other rays whatever.
    pub fn errors(&self, view: &SceneView, placed: u32, eye: DVec3, t: &Row<f32>, out: &mut Row<f32>) {
        let isa = view.tree(placed).isa;
        dispatch(isa, Errors { all: self, placed: &view.scene.placement.placed[placed as usize], eye, t, out });
    }

    /// False if one is no longer in memory, or has a normal that single precision cannot tell.
    fn look_at_triangles(&mut self, view: &SceneView, placed: u32, walk: &PacketWalk) -> bool {
        let tree = view.tree(placed);
        let first_part = view.scene.placement.placed[placed as usize].first_part;
        let count = self.hits.count;
        for s in 0..count {
            let i = self.hits.rays[s].trailing_zeros() as usize;
            let Some(triangle) = tree.triangle(&walk.best(i)) else { return false };
            for (c, corner) in triangle.vertices.iter().enumerate() {
                for axis in 0..3 {
                    self.corners[c][axis][s] = corner[axis];
                }
            }
            self.part[s] = first_part.saturating_add(triangle.part);
        }
        dispatch(tree.isa, OfTriangles(self));
        self.is_extreme[..count].iter().all(|it| *it == 0)
    }

    /// False if one stands in for what is missing, or is no longer in memory.
    fn look_at_cells<const PICTURE: bool>(
        &mut self,
        view: &SceneView,
        placed: u32,
        ray: impl Fn(usize) -> (DVec3, Vec3),
        walk: &PacketWalk,
    ) -> bool {
        let tree = view.tree(placed);
        let placed = &view.scene.placement.placed[placed as usize];
        let mut here: [Option<(StoredVoxel, &Node, usize)>; PACKET] = [None; PACKET];
        for i in bits(self.hits.cells) {
            let hit = walk.best(i);
            let Some(cell) = hit.stand_in().filter(|cell| !cell.is_missing) else { return false };
            let Some(words) = tree.snapshot.block(BlockId(hit.block)) else { return false };
            let block = Block::new(words);
            let voxel = block.voxel(cell.node, cell.slot);
            prefetch(voxel.words().as_ptr());
            here[i] = Some((voxel, block.node(cell.node), cell.slot));
            let (_, dir) = ray(i);
            for axis in 0..3 {
                self.dir[axis][i] = dir[axis];
            }
        }
        let (mut have_sides, mut coloured) = (0, 0);
        for i in bits(self.hits.cells) {
            let Some((voxel, node, slot)) = &here[i] else { continue };
            self.word[i] = voxel.words()[0];
            self.part_of_cell[i] = placed.first_part.saturating_add(voxel.part().0);
            if PICTURE {
                self.colour[i] = voxel.words()[1];
                coloured |= u32::from(voxel.has_colours()) << i;
                for row in 0..6 {
                    self.boxes[row][i] = node.stored_plane(row, *slot);
                }
            }
            if !voxel.has_sides() {
                continue;
            }
            have_sides |= 1 << i;
            let sides = voxel.sides();
            prefetch(sides.as_ptr());
            prefetch(&sides[sides.len() - 1]);
            let (org, dir) = ray(i);
            let (org, dir) = (placed.local_point(org), placed.local_vector(dir.as_dvec3()));
            for axis in 0..3 {
                let row = if dir[axis] >= 0.0 { axis } else { axis + 3 };
                self.planes[axis][i] = node.stored_plane(row, *slot);
                (self.local[0][axis][i], self.local[1][axis][i]) = (org[axis], dir[axis]);
            }
        }
        if have_sides != 0 {
            dispatch(tree.isa, SidesOfCells(self));
            for i in bits(have_sides) {
                let Some((voxel, ..)) = &here[i] else { continue };
                let (sides, at) = (voxel.sides(), 2 * self.side[i] as usize);
                self.word[i] = sides[at];
                if PICTURE {
                    self.colour[i] = sides[at + 1];
                }
            }
        }
        self.coloured = coloured;
        dispatch(tree.isa, OfCells(self));
        true
    }
}

/// Works out normals of triangles, and whether single precision does for them.
struct OfTriangles<'a>(&'a mut Surfaces);

impl Op for OfTriangles<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        if self.0.hits.count <= FEW { first_triangles::<FEW>(self.0) } else { first_triangles::<PACKET>(self.0) }
    }
}

/// The first `N`, at most [`PACKET`].
#[inline(always)]
fn first_triangles<const N: usize>(all: &mut Surfaces) {
    let Surfaces { corners: [a, b, c], across, unit, is_extreme, .. } = all;
    for i in 0..N {
        let corner = DVec3::new(f64::from(a[0][i]), f64::from(a[1][i]), f64::from(a[2][i]));
        let ab = DVec3::new(f64::from(b[0][i]), f64::from(b[1][i]), f64::from(b[2][i])) - corner;
        let ac = DVec3::new(f64::from(c[0][i]), f64::from(c[1][i]), f64::from(c[2][i])) - corner;
        let n = ab.cross(ac);
        let square = n.length_squared();
        let one = finish::unit(n, square);
        (across[0][i], across[1][i], across[2][i]) = (n.x, n.y, n.z);
        (unit[0][i], unit[1][i], unit[2][i]) = (one.x, one.y, one.z);
        is_extreme[i] = u32::from(finish::is_extreme(square));
    }
}

/// Works out by which side each ray enters its cell: the axis whose plane is met last. As `stand_in::Crossing`.
struct SidesOfCells<'a>(&'a mut Surfaces);

impl Op for SidesOfCells<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Surfaces { local: [org, dir], planes, side, .. } = self.0;
        for i in 0..PACKET {
            let (mut enter, mut first) = (f64::NEG_INFINITY, 0);
            for axis in 0..3 {
                let here = if dir[axis][i] >= 0.0 { axis as u32 } else { axis as u32 + 3 };
                let from = (f64::from(planes[axis][i]) - org[axis][i]) * (1.0 / dir[axis][i]);
                first = if from > enter { here } else { first };
                enter = if from > enter { from } else { enter };
            }
            side[i] = first;
        }
    }
}

/// Works out normals of cells.
struct OfCells<'a>(&'a mut Surfaces);

impl Op for OfCells<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Surfaces { dir, word, normal, .. } = self.0;
        for i in 0..PACKET {
            let n = stored_normal(word[i]);
            let turn = stand_in::faces_away(n, Vec3::new(dir[0][i], dir[1][i], dir[2][i]));
            normal[0][i] = if turn { -n.x } else { n.x };
            normal[1][i] = if turn { -n.y } else { n.y };
            normal[2][i] = if turn { -n.z } else { n.z };
        }
    }
}

/// Works out [`Surfaces::errors`].
struct Errors<'a> {
    all: &'a Surfaces,
    placed: &'a Placed,
    eye: DVec3,
    t: &'a Row<f32>,
    out: &'a mut Row<f32>,
}

impl Op for Errors<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { all: Surfaces { dir, boxes, .. }, placed, eye, t, out } = self;
        // A copy: it stays as it is while `out` is written.
        let placed = *placed;
        let Some(offset) = placed.only_shifted() else { return };
        for i in 0..PACKET {
            let along = Vec3::new(dir[0][i], dir[1][i], dir[2][i]).as_dvec3() * f64::from(t[i]);
            let cell = Bounds {
                min: Vec3::new(boxes[0][i], boxes[1][i], boxes[2][i]),
                max: Vec3::new(boxes[3][i], boxes[4][i], boxes[5][i]),
            };
            out[i] = stand_in::error_at(&placed, eye, along, eye + along - offset, &cell);
        }
    }
}
