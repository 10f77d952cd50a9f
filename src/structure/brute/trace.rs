//! Traces single rays: rows of index blocks by their boxes, triangles of lists eight at a time.
//!
//! Hits are identical, to the bit, to those of other structures with the same triangles: the triangle test is the same,
//! and the tolerance of boxes exceeds the rounding errors of single precision. Stand-ins are boxes and stop all rays.

use super::layout::{Block, Row, TRIANGLE_WORDS, triangle};
use crate::base::ids::BlockId;
use crate::geom::Shear;
use crate::geom::watertight::{Sheared, intersect, shear};
use crate::lod::Coded;
use crate::math::octahedral;
use crate::math::{Bounds, Cone, bits};
use crate::residency::Snapshot;
use crate::simd::{Isa, Lanes, Op, Simd, dispatch};
use crate::structure::cell::CellParts;
use crate::structure::cursor::Below;
use crate::structure::fallback::SingleWalks;
use crate::structure::filter::PartFilter;
use crate::structure::hit::{Outcome, StandIn, TriHit, Triangle};
use crate::structure::place::{Place, Rooted};
use crate::structure::ray::{self, LocalRay};
use crate::structure::streams::colours_of;
use crate::structure::tree::Visit;
use crate::structure::walk::{Entry, Walk, push_sorted};
use glam::Vec3;
use std::sync::atomic::Ordering::Relaxed;

/// One tree of a model in one snapshot.
#[derive(Debug, Clone, Copy)]
pub struct TreeView<'a> {
    /// Snapshot with the blocks in memory.
    pub snapshot: &'a Snapshot,
    /// Block of the root; `None` for a tree without triangles.
    pub first_block: Option<u32>,
    /// Greatest magnitude of a coordinate of the tree.
    pub max_coord: f32,
    /// Difference between the id of the block with primitive ids and the id of its block of triangles.
    pub prims_at: u32,
    /// The same difference for colours; `None` if the model has none.
    pub colours_at: Option<u32>,
    /// Offset from the id of a block to the id of the block that holds its normals; `None` if each triangle's is its
    /// own.
    pub normals_at: Option<u32>,
    /// Instruction set to trace with.
    pub isa: Isa,
    /// Options of walks.
    pub visit: Visit<'a>,
}

impl Rooted for TreeView<'_> {
    fn root(&self) -> Option<Place> {
        self.first_block.map(|block| Place { block, item: super::layout::INDEX })
    }
    fn max_coord(&self) -> f32 {
        self.max_coord
    }
    fn isa(&self) -> Isa {
        self.isa
    }
}

impl SingleWalks for TreeView<'_> {
    fn closest(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        self.go_on::<false>(filter, walk)
    }
    fn any(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        self.go_on::<true>(filter, walk)
    }
}

/// A ray with the constants that tests need.
struct Prepared<'a> {
    ray: LocalRay,
    inv: Vec3,
    /// Tolerance of the planes of cells, with the sign of `inv`.
    slack: Vec3,
    shear: Shear,
    /// True if the ray accepts small cells as stand-ins.
    is_lod: bool,
    filter: Option<&'a PartFilter<'a>>,
}

/// Tolerance of boxes as a multiple of that of cells. A ray that enters a cell therefore also enters the boxes around
/// it.
const BOXES: f32 = 2.0;

impl<'a> Prepared<'a> {
    fn new(ray: LocalRay, max_coord: f32, filter: Option<&'a PartFilter<'a>>) -> Self {
        let least = ray.dir.abs().max_element() * 1e-18;
        let inv = Vec3::ONE / ray.dir.abs().max(Vec3::splat(least)).copysign(ray.dir);
        let slack = Vec3::from([0, 1, 2].map(|axis| ray::slack(ray.org[axis], inv[axis], max_coord)));
        Self { ray, inv, slack, shear: Shear::new(ray.dir), is_lod: ray.cone != Cone::ZERO, filter }
    }

    /// Distances at which the ray enters and leaves a box, with `times` the usual tolerance.
    fn cross(&self, b: &Bounds, times: f32) -> [f32; 2] {
        let is_positive = self.inv.cmpge(Vec3::ZERO);
        let (near, far) = (Vec3::select(is_positive, b.min, b.max), Vec3::select(is_positive, b.max, b.min));
        let slack = self.slack * times;
        let enter = (near - slack - self.ray.org) * self.inv;
        let leave = (far + slack - self.ray.org) * self.inv;
        [enter.max_element(), leave.min_element()]
    }
}

/// Result of testing a cell.
enum Verdict {
    /// The cell is a hit, or everything in it is hidden: nothing below remains to be visited.
    Settled,
    /// The content of the cell has to be visited.
    Descend,
}

impl<'a> TreeView<'a> {
    fn block(&self, id: u32) -> Option<Block<'a>> {
        self.snapshot.block(BlockId(id)).map(Block::new)
    }

    /// Reads the words of a block and sets its last-used stamp. Returns `None` if the block is missing.
    pub(super) fn visited(&self, id: u32) -> Option<&'a [u32]> {
        if self.visit.stop.load(Relaxed) {
            return None;
        }
        self.snapshot.visit(BlockId(id), self.visit.stamp)
    }

    fn go_on<const ANY: bool>(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        let ray = Prepared::new(walk.ray, self.max_coord, filter);
        while let Some(entry) = walk.stack.pop() {
            // An entry at the distance of the best hit is visited, because a triangle at an equal distance wins if its
            // primitive id is lower.
            if entry.t > walk.best.t {
                continue;
            }
            let Some(words) = self.visited(entry.block) else {
                walk.stack.push(entry);
                return Outcome::Pending(BlockId(entry.block));
            };
            walk.counters.blocks += 1;
            match Block::new(words) {
                Block::Index(rows) => self.index::<ANY>(&ray, rows, entry.block, walk),
                Block::List(list) => {
                    if let Err(missing) = self.list::<ANY>(&ray, list, entry.block, walk) {
                        walk.stack.push(entry);
                        return Outcome::Pending(missing);
                    }
                }
            }
            if ANY && walk.best.is_hit() {
                walk.stack.clear();
            }
        }
        Outcome::Done
    }

    fn index<const ANY: bool>(
        &self,
        ray: &Prepared,
        rows: &[[u32; super::layout::ROW_WORDS]],
        block: u32,
        walk: &mut Walk,
    ) {
        walk.counters.nodes += 1;
        let bottom = walk.stack.len();
        for (index, row) in rows.iter().enumerate() {
            let (row, bounds) = (Row(row), Row(row).bounds());
            let [enter, leave] = ray.cross(&bounds, BOXES);
            let t = enter.max(ray.ray.t_min);
            let is_met = t <= leave.min(walk.best.t);
            if !is_met {
                continue;
            }
            let (below, kind) = row.below();
            let mut cell = StandIn { item: index as u32, is_missing: false, is_inside: false };
            if ray.is_lod && matches!(judge_small(ray, row, block, cell, walk), Verdict::Settled) {
                continue;
            }
            if self.visit.accept_missing && self.block(below).is_none() {
                cell.is_missing = true;
                stand_for_missing::<ANY>(ray, row, block, cell, walk);
                continue;
            }
            push_sorted(&mut walk.stack, bottom, Entry { t, block: below, child: kind });
        }
    }

    /// Fails with a missing block that is needed to decide a tie.
    fn list<const ANY: bool>(
        &self,
        ray: &Prepared,
        list: &[[u32; TRIANGLE_WORDS]],
        block: u32,
        walk: &mut Walk,
    ) -> Result<(), BlockId> {
        walk.counters.leaves += 1;
        walk.counters.triangles += list.len() as u64;
        for (eight, first) in list.chunks(8).zip((0..).step_by(8)) {
            let found = dispatch(self.isa, Eight { ray, triangles: eight, t_max: walk.best.t });
            for i in bits(found.hits) {
                let (t, part) = (found.t[i], eight[i][9]);
                if ray.filter.is_some_and(|filter| filter.rejects(|| part, || triangle(&eight[i]), t)) {
                    continue;
                }
                let hit = TriHit { t, u: found.u[i], v: found.v[i], block, tri: first + i as u32 };
                if self.is_better(&hit, walk)? {
                    walk.best = hit;
                }
                if ANY {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// True if `hit` is better than the best hit so far: it is nearer, or equally near with a lower primitive id.
    fn is_better(&self, hit: &TriHit, walk: &mut Walk) -> Result<bool, BlockId> {
        let best = &walk.best;
        if hit.t != best.t || !best.is_hit() {
            return Ok(hit.t < best.t || !best.is_hit());
        }
        if let Some(answer) = hit.untie(best) {
            return Ok(answer);
        }
        // A list is in the order of its primitive ids.
        if hit.block == best.block {
            return Ok(hit.tri < best.tri);
        }
        walk.counters.ties += 1;
        match (self.prim(hit), self.prim(best)) {
            (Ok(a), Ok(b)) => Ok((a, hit.place()) < (b, best.place())),
            _ if self.visit.ties_by_place => Ok((hit.block, hit.tri) < (best.block, best.tri)),
            (a, b) => Ok((a?, hit.place()) < (b?, best.place())),
        }
    }

    /// Returns the triangle of a hit; `None` if its block has left the snapshot.
    pub fn triangle(&self, hit: &TriHit) -> Option<Triangle> {
        self.block(hit.block)?.triangle(hit.tri as usize)
    }

    /// Returns the primitive id of a hit, or the block that is needed for it.
    pub fn prim(&self, hit: &TriHit) -> Result<u32, BlockId> {
        self.prim_at(self.prim_place(hit).ok_or(BlockId(hit.block))?)
    }

    /// See [`crate::structure::Tree::prim_place`].
    pub fn prim_place(&self, hit: &TriHit) -> Option<Place> {
        Some(Place { block: hit.block + self.prims_at, item: hit.tri })
    }

    /// Returns the primitive id at a place, or the block of the place if it is not in memory.
    pub fn prim_at(&self, place: Place) -> Result<u32, BlockId> {
        let words = self.visited(place.block).ok_or(BlockId(place.block))?;
        // Only a deliberately malformed file has fewer words than its block has triangles.
        Ok(words.get(place.item as usize).copied().unwrap_or(u32::MAX))
    }

    /// See [`crate::structure::Tree::colours`].
    pub fn colours(&self, hit: &TriHit) -> Result<Option<[[u8; 4]; 3]>, BlockId> {
        let Some(at) = self.colours_at else { return Ok(None) };
        Ok(Some(colours_of(self.beside(hit, at)?, hit.tri as usize)))
    }

    /// See [`crate::structure::Tree::normals`].
    pub fn normals(&self, hit: &TriHit) -> Result<Option<[Vec3; 3]>, BlockId> {
        let Some(at) = self.normals_at else { return Ok(None) };
        let codes: Option<&[u32; 3]> = self.beside(hit, at)?.as_chunks().0.get(hit.tri as usize);
        let own = self
            .triangle(hit)
            .map_or(Vec3::Z, |t| (t.vertices[1] - t.vertices[0]).cross(t.vertices[2] - t.vertices[0]).normalize());
        let normal = |code: u32| if code < 2 { own } else { octahedral::decode(code) };
        Ok(codes.filter(|codes| codes.iter().any(|code| *code >= 2)).map(|codes| codes.map(normal)))
    }

    fn beside(&self, hit: &TriHit, offset: u32) -> Result<&'a [u32], BlockId> {
        let id = BlockId(hit.block + offset);
        self.visited(id.0).ok_or(id)
    }

    /// See [`crate::structure::Tree::parts_in_cell`].
    pub fn parts_in_cell(&self, hit: &TriHit) -> Option<CellParts> {
        let row = self.row_of(hit.block, hit.stand_in()?)?;
        let (part, is_mixed) = Coded::part(row.voxel()[2]);
        Some(CellParts { part, is_mixed, summary: row.voxel()[3], listed_by: row.below().0, shown: 0 })
    }

    /// Returns the block that the stand-in of `hit` replaces, if that block is missing.
    pub fn wanted(&self, hit: &TriHit) -> Option<u32> {
        let cell = hit.stand_in().filter(|cell| cell.is_missing)?;
        self.row_of(hit.block, cell).map(|row| row.below().0)
    }

    pub(super) fn row_of(&self, block: u32, cell: StandIn) -> Option<Row<'a>> {
        self.block(block)?.row(cell.item as usize)
    }

    /// See [`crate::structure::Tree::triangles_of`].
    pub fn triangles_of(&self, block: BlockId, visit: &mut dyn FnMut(&TriHit, &Triangle)) -> Result<(), BlockId> {
        let place = Place { block: block.0, item: super::layout::LIST };
        self.expand(place, &mut Below { child: &mut |_, _, _| {}, triangle: visit })
    }

    /// Visits the children or triangles below a place. Fails with the block of the place if that is not in memory.
    pub fn expand(&self, place: Place, below: &mut Below) -> Result<(), BlockId> {
        match self.visited(place.block).map(Block::new).ok_or(BlockId(place.block))? {
            Block::Index(rows) => {
                for row in rows.iter().map(Row) {
                    let (block, item) = row.below();
                    (below.child)(Place { block, item }, &row.bounds(), item == super::layout::LIST);
                }
            }
            Block::List(list) => {
                for (words, tri) in list.iter().zip(0..) {
                    (below.triangle)(&TriHit { block: place.block, tri, ..TriHit::none(0.0) }, &triangle(words));
                }
            }
        }
        Ok(())
    }
}

/// Tests the parts of a cell that may become a stand-in: true if the filter allows it, or `None` if everything in the
/// cell is hidden.
fn allowed(row: Row, filter: Option<&PartFilter>) -> Option<bool> {
    let Some(filter) = filter else { return Some(true) };
    match (Coded::part(row.voxel()[2]), row.voxel()[3]) {
        ((part, is_mixed), summary) if filter.hides(part) => {
            (is_mixed && summary & filter.visible_bits != 0).then_some(false)
        }
        _ => Some(true),
    }
}

/// Accepts a cell as a stand-in if it is no larger than the ray's footprint there, and the ray begins outside of it.
fn judge_small(ray: &Prepared, row: Row, block: u32, cell: StandIn, walk: &mut Walk) -> Verdict {
    let bounds = row.bounds();
    let [enter, leave] = ray.cross(&bounds, 1.0);
    let LocalRay { dir, t_min, cone, .. } = ray.ray;
    let (t, size) = (enter.max(t_min), bounds.extent());
    let (width, faces) = (cone.a + cone.b * t, Vec3::new(size.y * size.z, size.z * size.x, size.x * size.y));
    let is_small = t <= leave && enter > t_min && dir.abs().dot(faces) <= width * width;
    if !is_small {
        return Verdict::Descend;
    }
    match allowed(row, ray.filter) {
        Some(false) => return Verdict::Descend,
        Some(true) if ray.filter.is_some_and(|filter| filter.descends(t)) => return Verdict::Descend,
        Some(true) => {
            walk.first_cell = walk.first_cell.min(t);
            TriHit { t, u: 0.0, v: 0.0, block, tri: cell.code() }.offer_to(&mut walk.best);
        }
        None => {}
    }
    Verdict::Settled
}

/// Offers a cell as a stand-in for the missing block below. For any-hit queries a cell that the ray begins in is no
/// hit, because nothing is known of its content.
fn stand_for_missing<const ANY: bool>(ray: &Prepared, row: Row, block: u32, cell: StandIn, walk: &mut Walk) {
    let [enter, leave] = ray.cross(&row.bounds(), 1.0);
    let (t, is_inside) = (enter.max(ray.ray.t_min), enter <= ray.ray.t_min);
    let is_beyond = || ray.filter.is_some_and(|filter| filter.is_beyond(t));
    let counts = t <= leave && allowed(row, ray.filter).is_some() && !(ANY && is_inside) && !is_beyond();
    if counts {
        if !is_inside {
            walk.first_cell = walk.first_cell.min(t);
        }
        let tri = StandIn { is_inside, ..cell }.code();
        TriHit { t, u: 0.0, v: 0.0, block, tri }.offer_to(&mut walk.best);
    }
}

/// Tests up to eight triangles against a ray.
struct Eight<'a> {
    ray: &'a Prepared<'a>,
    triangles: &'a [[u32; TRIANGLE_WORDS]],
    t_max: f32,
}

/// Triangles that are hit, and their hits.
struct Found {
    hits: u32,
    t: [f32; 8],
    u: [f32; 8],
    v: [f32; 8],
}

impl Op for Eight<'_> {
    type Out = Found;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Found {
        let Self { ray: Prepared { ray, shear: Shear { k, s: by }, .. }, triangles, t_max } = self;
        let zero = s.splat8(0.0);
        let by = [s.splat8(by[0]), s.splat8(by[1]), s.splat8(by[2])];
        let mut corners = [Sheared { x: zero, y: zero, z: zero }; 3];
        for (corner, sheared) in corners.iter_mut().enumerate() {
            let mut p = [zero; 3];
            for axis in 0..3 {
                let mut lanes = [0.0; 8];
                for (lane, words) in lanes.iter_mut().zip(triangles) {
                    *lane = f32::from_bits(words[3 * corner + k[axis]]);
                }
                p[axis] = s.load8(&lanes) - s.splat8(ray.org[k[axis]]);
            }
            *sheared = shear(p, by);
        }
        let lanes = (1 << triangles.len()) - 1;
        let found = intersect::<8, _>(lanes, corners, zero, s.splat8(ray.t_min), s.splat8(t_max));
        Found { hits: found.hits, t: found.t.to_array(), u: found.u.to_array(), v: found.v.to_array() }
    }
}
