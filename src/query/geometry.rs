//! Triangles as they are stored: all of a part, some at a time, and those of hits.

use super::batch::Policy;
use super::hit::Hit;
use super::located::{Located, locate};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::inside_read::refuse_inside_read;
use crate::base::memory::zeroed;
use crate::base::progress::Cancel;
use crate::residency::Kept;
use crate::scene::SceneState;
use crate::scene::model::KeptSets;
use crate::scene::model::Model;
use crate::structure::open::{self, Holder};
use crate::structure::{TriHit, Triangle, Visit};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// A triangle with everything that is stored of it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct StoredTriangle {
    /// The corners: of the model if a model is read, of the world for hits in a scene. A stored position is exact in
    /// double precision, unless its mesh is placed by a transform, whose rounding it then has.
    pub corners: [DVec3; 3],
    /// The caller's id of the part.
    pub part: u64,
    /// Primitive id.
    pub prim: u64,
    /// Unit shading normals at the corners, on the side from which the corners appear counter-clockwise.
    pub normals: [Vec3; 3],
    /// 0. It fills the struct.
    pub reserved: u32,
}

/// Places triangles of a tree.
struct Place3 {
    matrix: DMat3,
    /// The tree's origin, placed.
    offset: DVec3,
    is_plain: bool,
}

impl Place3 {
    fn of_tree(origin: DVec3, model_from_mesh: &DAffine3) -> Self {
        let matrix = model_from_mesh.matrix3;
        Self { matrix, offset: model_from_mesh.transform_point3(origin), is_plain: matrix == DMat3::IDENTITY }
    }

    fn stored(&self, triangle: &Triangle, normals: Option<[Vec3; 3]>, [part, prim]: [u64; 2]) -> StoredTriangle {
        let corner = |v: Vec3| if self.is_plain { v.as_dvec3() } else { self.matrix * v.as_dvec3() } + self.offset;
        let corners = triangle.vertices.map(corner);
        // Far from zero the differences of placed corners have few digits.
        let [a, b, c] = triangle.vertices.map(Vec3::as_dvec3);
        let across = (self.matrix * (b - a)).cross(self.matrix * (c - a));
        // A mirrored placement turns the side from which corners appear counter-clockwise.
        let cofactors = {
            let [x, y, z] = [self.matrix.x_axis, self.matrix.y_axis, self.matrix.z_axis];
            DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
        };
        let own = across.normalize_or_zero();
        let turned = |n: Vec3| if self.is_plain { n.as_dvec3() } else { (cofactors * n.as_dvec3()).normalize_or(own) };
        let normals = normals.map_or([own; 3], |normals| normals.map(turned)).map(|n| n.as_vec3());
        StoredTriangle { corners, part, prim, normals, reserved: 0 }
    }
}

/// A tree in which a part may be, as it is placed.
#[derive(Debug, Clone, Copy)]
struct Placing {
    tree: u32,
    /// Index in the model of the first part that the tree's triangles may have.
    first_part: u32,
    model_from_mesh: DAffine3,
    /// True if trees before it may have the same triangles in the same place: those of one divided mesh.
    goes_on: bool,
}

/// Reads the triangles of a part, some at a time, in memory that does not depend on their number, except for a bit for
/// each triangle of a model whose triangles may be stored twice. The order is that of the file, but for the trees of a
/// divided mesh, which follow one another.
pub struct PartReader {
    model: Model,
    part: u32,
    id: u64,
    sets: Option<Arc<KeptSets>>,
    placings: Vec<Placing>,
    /// The next block: its placing, and its number among those with triangles.
    at: (usize, usize),
    /// The triangles that were returned, if they may be stored in several leaves or trees.
    seen: Option<Seen>,
    /// Triangles of the last block, the first of them already returned.
    waiting: Vec<StoredTriangle>,
    returned: usize,
}

impl Model {
    /// Begins to read the triangles of the part with this index in [`Model::parts`], without those of parts below it.
    /// Fails with `BadArgument` if there is no such part, and with `OverBudget`, `Io` or `Corrupt`.
    pub fn read_part(&self, part: u32) -> Result<PartReader> {
        refuse_inside_read()?;
        let Some(id) = self.parts().id(part as usize) else {
            return Err(Error::BadArgument(format!("the model has no part with index {part}")));
        };
        let file = self.blocks().file();
        let has_part = |(tree, first, _): &(u32, u32, DAffine3)| {
            let count = file.trees()[*tree as usize].local_parts;
            (*first..first.saturating_add(count)).contains(&part)
        };
        let placings = in_places(self.placements().filter(has_part));
        let header = file.header();
        let seen = if header.options.spatial_splits || placings.iter().any(|placing| placing.goes_on) {
            Some(Seen::new(self, header.triangles_in)?)
        } else {
            None
        };
        let has_several = placings.iter().any(|placing| file.trees()[placing.tree as usize].local_parts > 1);
        let sets = if has_several { Some(self.part_sets()?) } else { None };
        Ok(PartReader {
            model: self.clone(),
            part,
            id,
            sets,
            placings,
            at: (0, 0),
            seen,
            waiting: Vec::new(),
            returned: 0,
        })
    }
}

impl PartReader {
    /// Returns the next triangles, at most `most`; none at the end. Blocks; reads the disk. After an error the next
    /// call tries the same block again. Fails with `Io`, `Corrupt`, `Cancelled` or `NoMemory`.
    pub fn next(&mut self, most: usize, cancel: &Cancel) -> Result<&[StoredTriangle]> {
        while self.returned == self.waiting.len() && most > 0 {
            (self.returned, self.waiting) = (0, Vec::new());
            if !self.read_block(cancel)? {
                break;
            }
        }
        let from = self.returned;
        self.returned = self.waiting.len().min(from.saturating_add(most));
        Ok(&self.waiting[from..self.returned])
    }

    /// Reads the next block that may hold the part. Returns false at the end.
    fn read_block(&mut self, cancel: &Cancel) -> Result<bool> {
        refuse_inside_read()?;
        loop {
            cancel.check()?;
            let Some(&placing) = self.placings.get(self.at.0) else { return Ok(false) };
            let Placing { tree, first_part, model_from_mesh, goes_on } = placing;
            if self.at.1 == 0 && !goes_on {
                // A mesh in another place has the same ids.
                self.seen.iter_mut().for_each(Seen::clear);
            }
            let file = self.model.blocks().file();
            let Some(Holder { listed_by, block }) = open::holder(file, &file.trees()[tree as usize], self.at.1)? else {
                self.at = (self.at.0 + 1, 0);
                continue;
            };
            let local = self.part - first_part;
            if self.may_hold(listed_by, local) {
                let mut found = Vec::new();
                self.load(tree, block, local, &model_from_mesh, cancel, &mut found)?;
                self.waiting = found;
                self.at.1 += 1;
                return Ok(true);
            }
            self.at.1 += 1;
        }
    }

    /// True unless the lists of parts exclude the part from a block.
    fn may_hold(&self, listed_by: BlockId, local: u32) -> bool {
        let Some(sets) = self.sets.as_ref().filter(|sets| !sets.is_empty()) else { return true };
        let mut listed = sets.of(listed_by.0 as usize).peekable();
        listed.peek().is_none() || listed.any(|part| part == local)
    }

    fn load(
        &mut self,
        tree: u32,
        block: BlockId,
        local: u32,
        place: &DAffine3,
        cancel: &Cancel,
        found: &mut Vec<StoredTriangle>,
    ) -> Result<()> {
        let file = self.model.blocks().file();
        let needed: Vec<BlockId> =
            [Some(block), Some(file.prim_block(block)), file.normal_block(block)].into_iter().flatten().collect();
        let mut lease = self.model.context().residency().lease();
        lease.fetch(self.model.blocks(), &needed, cancel)?;
        let snapshot = lease.snapshot(self.model.blocks())?;
        let view = self.model.tree_in(tree, &snapshot, Visit::default());
        let stored = &self.model.trees()[tree as usize];
        let place = Place3::of_tree(stored.origin, place);
        let (mut failed, id) = (None, self.id);
        let mut seen = self.seen.as_mut().filter(|_| !stored.has_ids_of_faces());
        let mut visit = |hit: &TriHit, triangle: &Triangle| {
            if triangle.part != local {
                return;
            }
            match (view.prim(hit), view.normals(hit)) {
                (Ok(prim), Ok(normals)) => {
                    let prim = prim.map_or(super::hit::NONE, u64::from);
                    if seen.as_mut().is_none_or(|seen| seen.insert(prim)) {
                        found.push(place.stored(triangle, normals, [id, prim]));
                    }
                }
                (Err(block), _) | (_, Err(block)) => failed = Some(block),
            }
        };
        let visited = view.triangles_of(block, &mut visit);
        match visited.err().or(failed) {
            None => Ok(()),
            Some(block) => Err(Error::corrupt(file.name(), Some(block.0), "it is not a block of triangles")),
        }
    }
}

/// Returns the placings such that those that may have the same triangles in the same place follow one another: trees of
/// one divided mesh. A tree that is placed several times has its triangles several times.
fn in_places(all: impl Iterator<Item = (u32, u32, DAffine3)>) -> Vec<Placing> {
    let place =
        |(_, first_part, at): &(u32, u32, DAffine3)| (*first_part, at.to_cols_array().map(|x| (x + 0.0).to_bits()));
    let all: Vec<_> = all.collect();
    // How often each tree is in each place, and the first placing of each such layer of a place.
    let (mut times, mut firsts) = (HashMap::new(), HashMap::new());
    let mut layered: Vec<(usize, usize)> = Vec::with_capacity(all.len());
    for (i, one) in all.iter().enumerate() {
        let time = times.entry((place(one), one.0)).or_insert(0u32);
        layered.push((*firsts.entry((place(one), *time)).or_insert(i), i));
        *time += 1;
    }
    layered.sort_unstable();
    let placing = |(first, i): (usize, usize)| {
        let (tree, first_part, model_from_mesh) = all[i];
        Placing { tree, first_part, model_from_mesh, goes_on: first != i }
    };
    layered.into_iter().map(placing).collect()
}

/// A set of primitive ids, a bit for each id of the model.
struct Seen {
    bits: Vec<u64>,
    /// The words that may not be 0.
    used: Range<usize>,
    _memory: Kept,
}

impl Seen {
    fn new(model: &Model, triangles: u64) -> Result<Self> {
        let words = triangles.div_ceil(64);
        let what = "the ids of triangles that were read";
        let memory = model.context().residency().keep(what, 8 * words)?;
        Ok(Self { bits: zeroed(usize::try_from(words).unwrap_or(usize::MAX), what)?, used: 0..0, _memory: memory })
    }

    /// Adds an id. Returns false if it was there.
    fn insert(&mut self, id: u64) -> bool {
        let index = (id / 64) as usize;
        let Some(word) = self.bits.get_mut(index) else { return true };
        let bit = 1 << (id % 64);
        let is_new = *word & bit == 0;
        *word |= bit;
        self.used = match self.used.is_empty() {
            true => index..index + 1,
            false => self.used.start.min(index)..self.used.end.max(index + 1),
        };
        is_new
    }

    fn clear(&mut self) {
        self.bits[self.used.clone()].fill(0);
        self.used = 0..0;
    }
}

impl SceneState {
    /// Returns the triangle of each hit, in world space: the one with the hit's instance, part and primitive id at its
    /// position. Blocks; reads what is not in memory. Fails with `BadArgument`, which names the hit, if a hit is not on
    /// a triangle of this scene or has no position, part, instance or primitive id; and with `Io`, `Corrupt`,
    /// `Cancelled`.
    pub fn triangles(&self, hits: &[Hit], cancel: &Cancel) -> Result<Vec<StoredTriangle>> {
        refuse_inside_read()?;
        let all: Vec<u32> = (0..hits.len() as u32).collect();
        let found = locate(self, (hits, &all), Policy::Exact, cancel, &|at: &Located| {
            let normals = at.tree.normals(at.hit)?;
            let frame = at.placed.frame();
            let is_plain = at.placed.only_shifted().is_some();
            let place = Place3 { matrix: frame.matrix3, offset: frame.translation, is_plain };
            let Hit { part, prim, .. } = hits[at.index];
            Ok(place.stored(at.triangle, normals, [part, prim]))
        })?;
        let lost = || Error::Internal("a search that reads has found nothing".into());
        found.into_iter().map(|found| found.ok_or_else(lost)).collect()
    }
}
