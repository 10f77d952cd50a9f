//! Normals and parts of what up to a packet's rays hit, together or side by side, all at once: reading them is a few loads a ray that do not wait for each
//! other, and the arithmetic goes over all rays in vectors. The answers are, to the bit, those of [`super::finish`] and of
//! [`super::stand_in`], which do the same for one ray.

use super::finish::WorldNormal;
use super::stand_in;
use crate::base::ids::BlockId;
use crate::lod::{blended_colour, limit, shares, stored_likeness, stored_normal, sure_from, visible};
use crate::math::Bounds;
use crate::scene::placed::Placed;
use crate::math::bits;
use crate::scene::walk::{Found, SceneView};
use crate::simd::{Isa, Op, Simd, dispatch, prefetch};
use crate::structure::bvh::layout::{Block, Node, StoredVoxel};
use crate::structure::{Rooted, PacketSurfaces, PacketWalk, TriHit};
use crate::math::PACKET;
use glam::{DVec3, Vec3};

/// A number for each ray, or for each triangle that was hit.
type Row<T> = [T; PACKET];
/// Triangles up to which half the work does.
const FEW: usize = PACKET / 2;

/// What rays have hit in a tree, each something.
pub(crate) trait TreeHits {
    /// That of ray `i`.
    fn hit(&self, i: usize) -> TriHit;
    /// Those of `rays`: on triangles, as far as it is told together where several rays hit the same, and on stand-ins.
    fn sort(&self, isa: Isa, rays: u32, out: &mut PacketSurfaces);
}

impl TreeHits for PacketWalk {
    #[inline]
    fn hit(&self, i: usize) -> TriHit {
        self.best(i)
    }
    #[inline]
    fn sort(&self, isa: Isa, rays: u32, out: &mut PacketSurfaces) {
        self.hits(isa, rays, out);
    }
}

impl TreeHits for [Found] {
    #[inline]
    fn hit(&self, i: usize) -> TriHit {
        self[i].tri
    }
    #[inline]
    fn sort(&self, _: Isa, rays: u32, out: &mut PacketSurfaces) {
        (out.cells, out.count) = (0, 0);
        for i in bits(rays) {
            let is_cell = self[i].tri.stand_in().is_some();
            out.cells |= u32::from(is_cell) << i;
            out.rays[out.count & (PACKET - 1)] = 1 << i;
            out.count += usize::from(!is_cell);
        }
    }
}

/// A triangle that rays hit.
#[derive(Debug, Clone, Copy)]
pub(super) struct HitTriangle {
    /// The rays that hit it.
    pub rays: u32,
    pub normal: WorldNormal,
    /// The model's part.
    pub part: u32,
}

/// What up to a packet's rays see. Reusable.
#[derive(Debug)]
#[repr(C, align(64))]
pub(crate) struct Surfaces {
    /// Corners of triangles, axis by axis; so many triangles as were hit.
    corners: [[Row<f32>; 3]; 3],
    /// Their normals, as [`WorldNormal`] has them.
    across: [Row<f64>; 3],
    unit: [Row<f32>; 3],
    is_extreme: Row<u32>,
    part: Row<u32>,
    /// Of rays that hit cells: their directions, the samples of the sides that they see, and the shares of these; of cells of one sample
    /// that of all is the first.
    dir: [Row<f32>; 3],
    firsts: [Row<u32>; 3],
    seconds: [Row<u32>; 3],
    shares: [Row<f32>; 3],
    /// See [`Surfaces::cell`].
    normal: [Row<f32>; 3],
    part_of_cell: Row<u32>,
    /// For pictures: see [`Surfaces::along`].
    along: Row<f32>,
    /// The cells of which the colours count; all boxes, and those of cells that tell their sides apart if it is not for pictures.
    coloured: u32,
    boxes: [Row<f32>; 6],
    /// What their levels say, see `lod::limit`.
    near: Row<f64>,
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
            firsts: [[0; PACKET]; 3],
            seconds: [[0; PACKET]; 3],
            shares: none,
            normal: none,
            part_of_cell: [0; PACKET],
            along: [0.0; PACKET],
            coloured: 0,
            boxes: [[0.0; PACKET]; 6],
            near: [0.0; PACKET],
            hits: PacketSurfaces::default(),
        }
    }
}

impl Surfaces {
    /// Looks at what rays hit in a scene's one placed tree, `placed`, whose frame differs from the world by its zero only;
    /// `met`: those with something in `hits`. False if that cannot be told here: of stand-ins for what is missing, and of what is no
    /// longer in memory.
    ///
    /// `ray`: origin and direction of one. `PICTURE`: what pictures need of stand-ins too.
    pub fn look<const PICTURE: bool>(
        &mut self,
        view: &SceneView,
        placed: u32,
        ray: impl Fn(usize) -> (DVec3, Vec3),
        hits: &(impl TreeHits + ?Sized),
        met: u32,
    ) -> bool {
        hits.sort(view.tree(placed).isa(), met, &mut self.hits);
        self.coloured = 0;
        (self.hits.count == 0 || self.look_at_triangles(view, placed, hits))
            && (self.hits.cells == 0 || self.look_at_cells::<PICTURE>(view, placed, ray, hits))
    }

    /// The triangles that were hit.
    pub(super) fn triangles(&self) -> impl Iterator<Item = HitTriangle> {
        (0..self.hits.count).map(|s| HitTriangle {
            rays: self.hits.rays[s],
            normal: WorldNormal {
                across: DVec3::new(self.across[0][s], self.across[1][s], self.across[2][s]),
                unit: Vec3::new(self.unit[0][s], self.unit[1][s], self.unit[2][s]),
                is_extreme: self.is_extreme[s] != 0,
            },
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

    /// Of each ray of those, the mean cosine between the ray and what it sees.
    pub fn along(&self) -> &Row<f32> {
        &self.along
    }

    /// Those of which the colour counts, and not that of the part.
    pub fn coloured(&self) -> u32 {
        self.coloured
    }

    /// The linear colour that ray `i` of those sees.
    #[inline]
    pub fn colour_of_cell(&self, i: usize) -> Vec3 {
        blended_colour(self.seconds.map(|row| row[i]), self.shares.map(|row| row[i]))
    }

    /// Unit normals against the rays, whose directions are `dir`, and parts, ray by ray.
    pub fn each(&self, isa: Isa, dir: &[Row<f32>; 3], normals: &mut [Row<f32>; 3], parts: &mut Row<u32>) {
        for triangle in self.triangles() {
            let unit = triangle.normal.unit;
            for i in bits(triangle.rays) {
                (normals[0][i], normals[1][i], normals[2][i]) = (unit.x, unit.y, unit.z);
                parts[i] = triangle.part;
            }
        }
        let doubtful = dispatch(isa, Turn { dir, normals });
        for triangle in self.triangles() {
            let left = if triangle.normal.is_extreme { triangle.rays } else { triangle.rays & doubtful };
            for i in bits(left) {
                let normal = triangle.normal.facing(Vec3::new(dir[0][i], dir[1][i], dir[2][i]));
                (normals[0][i], normals[1][i], normals[2][i]) = (normal.x, normal.y, normal.z);
            }
        }
        for i in bits(self.cells()) {
            (normals[0][i], normals[1][i], normals[2][i]) = (self.normal[0][i], self.normal[1][i], self.normal[2][i]);
            parts[i] = self.part_of_cell[i];
        }
    }

    /// Errors of the hits of `walk`'s rays, which begin at `eye`, on cells, in the world; of other rays whatever.
    pub fn errors(&self, view: &SceneView, placed: u32, eye: DVec3, walk: &PacketWalk, out: &mut Row<f32>) {
        let tree = view.tree(placed);
        let placed = &view.scene.placement.placed[placed as usize];
        let local = placed.local_point(eye);
        let sure = sure_from(local, tree.reach());
        let doubtful = dispatch(tree.isa(), Errors { all: self, placed, eye, sure, t: walk.distances(), out });
        for i in bits(doubtful & self.cells()) {
            let hit = walk.best(i);
            let along = self.dir_of(i).as_dvec3() * f64::from(hit.t);
            let here = placed.local_point(eye + along);
            let near = match (hit.stand_in(), tree.snapshot().block(BlockId(hit.block))) {
                (Some(cell), Some(words)) => stand_in::near(Block::new(words).node(cell.node), cell.slot, sure, here),
                _ => f64::INFINITY,
            };
            out[i] = stand_in::error_at(placed, eye, along, here, &self.box_of(i), near);
        }
    }

    fn dir_of(&self, i: usize) -> Vec3 {
        Vec3::new(self.dir[0][i], self.dir[1][i], self.dir[2][i])
    }

    /// That of a cell.
    #[inline(always)]
    fn box_of(&self, i: usize) -> Bounds {
        let b = &self.boxes;
        Bounds { min: Vec3::new(b[0][i], b[1][i], b[2][i]), max: Vec3::new(b[3][i], b[4][i], b[5][i]) }
    }

    /// False if one is no longer in memory.
    fn look_at_triangles(&mut self, view: &SceneView, placed: u32, hits: &(impl TreeHits + ?Sized)) -> bool {
        let tree = view.tree(placed);
        let first_part = view.scene.placement.placed[placed as usize].first_part;
        for s in 0..self.hits.count {
            let i = self.hits.rays[s].trailing_zeros() as usize;
            let Some(triangle) = tree.triangle(&hits.hit(i)) else { return false };
            for (c, corner) in triangle.vertices.iter().enumerate() {
                for axis in 0..3 {
                    self.corners[c][axis][s] = corner[axis];
                }
            }
            self.part[s] = first_part.saturating_add(triangle.part);
        }
        dispatch(tree.isa(), OfTriangles(self));
        true
    }

    /// False if one stands in for what is missing, or is no longer in memory.
    fn look_at_cells<const PICTURE: bool>(
        &mut self,
        view: &SceneView,
        placed: u32,
        ray: impl Fn(usize) -> (DVec3, Vec3),
        hits: &(impl TreeHits + ?Sized),
    ) -> bool {
        let tree = view.tree(placed);
        let placed = &view.scene.placement.placed[placed as usize];
        let mut here: [Option<(StoredVoxel, &Node, usize)>; PACKET] = [None; PACKET];
        for i in bits(self.hits.cells) {
            let hit = hits.hit(i);
            let Some(cell) = hit.stand_in().filter(|cell| !cell.is_missing) else { return false };
            let Some(words) = tree.snapshot().block(BlockId(hit.block)) else { return false };
            let block = Block::new(words);
            let voxel = block.voxel(cell.node, cell.slot);
            prefetch(voxel.words().as_ptr());
            here[i] = Some((voxel, block.node(cell.node), cell.slot));
            let (_, dir) = ray(i);
            for axis in 0..3 {
                self.dir[axis][i] = dir[axis];
            }
        }
        let (mut have_three, mut coloured) = (0, 0);
        for i in bits(self.hits.cells) {
            let Some((voxel, node, slot)) = &here[i] else { continue };
            (self.firsts[0][i], self.seconds[0][i]) = (voxel.words()[0], voxel.words()[1]);
            self.part_of_cell[i] = placed.first_part.saturating_add(voxel.part().0);
            if PICTURE {
                coloured |= u32::from(voxel.has_colours()) << i;
                self.near[i] = limit(node.level(*slot));
            }
            let is_along_axes = voxel.is_along_axes();
            if PICTURE || voxel.has_sides() || is_along_axes {
                for row in 0..6 {
                    self.boxes[row][i] = node.stored_plane(row, *slot);
                }
            }
            have_three |= u32::from(is_along_axes) << i;
            if voxel.has_sides() {
                have_three |= 1 << i;
                let sides = voxel.sides();
                prefetch(sides.as_ptr());
                prefetch(&sides[sides.len() - 1]);
            }
        }
        for i in bits(have_three) {
            let Some((voxel, ..)) = &here[i] else { continue };
            let (firsts, seconds) = stand_in::three(voxel, self.dir_of(i).as_dvec3());
            for axis in 0..3 {
                (self.firsts[axis][i], self.seconds[axis][i]) = (firsts[axis], seconds[axis]);
            }
        }
        self.coloured = coloured;
        dispatch(tree.isa(), OfCells { all: self, have_three });
        true
    }
}

/// Works out normals of triangles.
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
        let n = WorldNormal::of(ab.cross(ac));
        (across[0][i], across[1][i], across[2][i]) = (n.across.x, n.across.y, n.across.z);
        (unit[0][i], unit[1][i], unit[2][i]) = (n.unit.x, n.unit.y, n.unit.z);
        is_extreme[i] = u32::from(n.is_extreme);
    }
}

/// Turns unit normals against unit directions; returns the rays for which single precision cannot tell which side they see.
struct Turn<'a> {
    dir: &'a [Row<f32>; 3],
    normals: &'a mut [Row<f32>; 3],
}

/// Cosines of unit vectors that are farther from zero than this have the sign of the exact ones, which are those of
/// [`WorldNormal::facing`] to double precision: eight times what components and sums are rounded by.
const SURE: f32 = 1.0 / (1 << 20) as f32;

impl Op for Turn<'_> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let Self { dir, normals: [x, y, z] } = self;
        let mut is_doubtful = [0; PACKET];
        for i in 0..PACKET {
            let cosine = x[i] * dir[0][i] + y[i] * dir[1][i] + z[i] * dir[2][i];
            let turn = if cosine > 0.0 { -1.0 } else { 1.0 };
            (x[i], y[i], z[i]) = (x[i] * turn, y[i] * turn, z[i] * turn);
            is_doubtful[i] = u32::from(cosine.abs() <= SURE) << i;
        }
        is_doubtful.iter().fold(0, |all, it| all | it)
    }
}

/// Works out how cells face the rays; `have_three`: those that have a sample for each side.
struct OfCells<'a> {
    all: &'a mut Surfaces,
    have_three: u32,
}

impl Op for OfCells<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { all, have_three } = self;
        let Surfaces { dir, firsts, seconds, boxes, shares: rows, .. } = all;
        if have_three == 0 {
            *rows = [[1.0; PACKET], [0.0; PACKET], [0.0; PACKET]];
            return facing::<1>(all);
        }
        for i in 0..PACKET {
            let low = Vec3::new(boxes[0][i], boxes[1][i], boxes[2][i]);
            let extent = Vec3::new(boxes[3][i], boxes[4][i], boxes[5][i]) - low;
            let dir = Vec3::new(dir[0][i], dir[1][i], dir[2][i]);
            let words = |rows: &[Row<u32>; 3]| [rows[0][i], rows[1][i], rows[2][i]];
            let [x, y, z] = shares(extent, dir, words(firsts), words(seconds));
            let has_three = have_three >> i & 1 == 1;
            rows[0][i] = if has_three { x } else { 1.0 };
            rows[1][i] = if has_three { y } else { 0.0 };
            rows[2][i] = if has_three { z } else { 0.0 };
        }
        facing::<3>(all);
    }
}

/// The same of the first `SIDES` of three samples: the others have no share. As [`Facing`](crate::lod::Facing), in loops that become vectors: one for
/// each step.
#[inline(always)]
fn facing<const SIDES: usize>(all: &mut Surfaces) {
    let Surfaces { dir, firsts, shares, normal, along, .. } = all;
    let mut to_eye = [[0.0f32; PACKET]; 3];
    for i in 0..PACKET {
        let e = stand_in::to_eye(Vec3::new(dir[0][i], dir[1][i], dir[2][i]));
        (to_eye[0][i], to_eye[1][i], to_eye[2][i]) = (e.x, e.y, e.z);
    }
    let mut mean = [[0.0f32; PACKET]; 3];
    let mut side_normal = [[0.0f32; PACKET]; 3];
    for side in 0..SIDES {
        for i in 0..PACKET {
            let n = stored_normal(firsts[side][i]);
            let turn = stand_in::faces_away(n, Vec3::new(dir[0][i], dir[1][i], dir[2][i]));
            side_normal[0][i] = if turn { -n.x } else { n.x };
            side_normal[1][i] = if turn { -n.y } else { n.y };
            side_normal[2][i] = if turn { -n.z } else { n.z };
        }
        for i in 0..PACKET {
            let n = Vec3::new(side_normal[0][i], side_normal[1][i], side_normal[2][i]);
            let e = Vec3::new(to_eye[0][i], to_eye[1][i], to_eye[2][i]);
            let seen = visible(n, stored_likeness(firsts[side][i]), e) * shares[side][i];
            (mean[0][i], mean[1][i], mean[2][i]) = (mean[0][i] + seen.x, mean[1][i] + seen.y, mean[2][i] + seen.z);
        }
    }
    for i in 0..PACKET {
        let mean = Vec3::new(mean[0][i], mean[1][i], mean[2][i]);
        let n = stand_in::unit(mean, Vec3::new(to_eye[0][i], to_eye[1][i], to_eye[2][i]));
        (normal[0][i], normal[1][i], normal[2][i]) = (n.x, n.y, n.z);
        along[i] = -(mean.x * dir[0][i] + mean.y * dir[1][i] + mean.z * dir[2][i]);
    }
}

/// Works out [`Surfaces::errors`]; returns the rays for which it must be seen where in their cells they hit (see
/// [`stand_in::near`]), of others than those of cells whatever.
struct Errors<'a> {
    all: &'a Surfaces,
    placed: &'a Placed,
    eye: DVec3,
    sure: f64,
    t: &'a Row<f32>,
    out: &'a mut Row<f32>,
}

impl Op for Errors<'_> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let Self { all, placed, eye, sure, t, out } = self;
        // A copy: it stays as it is while `out` is written.
        let placed = *placed;
        let Some(offset) = placed.only_shifted() else { return 0 };
        let mut is_doubtful = [0; PACKET];
        for i in 0..PACKET {
            let along = Vec3::new(all.dir[0][i], all.dir[1][i], all.dir[2][i]).as_dvec3() * f64::from(t[i]);
            let (cell, near) = (all.box_of(i), all.near[i]);
            out[i] = stand_in::error_at(&placed, eye, along, eye + along - offset, &cell, near);
            is_doubtful[i] = u32::from(near < f64::INFINITY && stand_in::diagonal(&cell) < sure) << i;
        }
        is_doubtful.iter().fold(0, |all, it| all | it)
    }
}
