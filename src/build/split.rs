//! The division of a mesh into several trees, each with an origin of its own, where single precision relative to one
//! origin would lose the shape of triangles: a bolt on one side of a plain, or a triangle that was left behind at zero.
//!
//! Details that the origin of a tree does not resolve (`resolve`) go to a further tree, which is divided in the same
//! way. Single small triangles among larger ones stay.
//!
//! Nothing cracks between trees: around each point of a surface, one tree has all triangles. Resolved triangles at a
//! vertex of an unresolved one are in both trees. There, their other vertices have the positions of the first tree.
//! (Rounding moves these by no more than the first tree's triangles allow.)

use super::batch::Batch;
use super::origin;
use super::parts::Assembly;
use super::resolve::{self, Samples};
use super::shares::Shares;
use super::spool::Spool;
use super::survey::TOGETHER;
use crate::base::error::Result;
use crate::base::memory::zeroed;
use crate::base::progress::Cancel;
use crate::base::scratch::Scratch;
use crate::math::DBounds;
use crate::store::InstanceRow;
use crate::structure::Par;
use glam::{DAffine3, DVec3};
use xxhash_rust::xxh3::xxh3_64;

/// Greatest number of trees of a mesh. The last one takes all triangles that are left.
const MOST_TREES: usize = 256;

/// Approximate number of triangles that decide an origin.
const SAMPLES: u64 = 4096;

/// Mean number of bits that the samples of a mesh must lose for its origin to leave the middle (`resolve::lost`).
const LEAST_LOST: f64 = 0.25;

/// So many small triangles are a detail even if more larger ones cross the box around them.
const MANY: u64 = 64;

/// Bits of [`Vertices`] for each triangle: 32 to 64 for a vertex, of which four are set. One in 5,000 vertices, or
/// fewer, is taken for another.
const BITS: u64 = 192;

/// Resources of the passes over a mesh.
pub struct Splitter<'a> {
    /// Scratch file of the spilled meshes.
    pub spilled: Option<&'a Scratch>,
    pub shares: &'a Shares,
    pub par: &'a Par,
    pub cancel: &'a Cancel,
}

/// The result of a division.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub struct Found {
    /// Number of trees that were added.
    pub trees: usize,
    /// Number of triangles that no tree resolves.
    pub unresolved: u64,
}

impl Found {
    /// Notes for the user.
    pub fn notes(&self) -> Vec<String> {
        let Self { trees, unresolved } = *self;
        let mut notes = Vec::new();
        if trees > 0 {
            notes.push(format!("the model has details far apart: {trees} more trees keep their precision"));
        }
        if unresolved > 0 {
            notes.push(format!(
                "{unresolved} triangles are so small and so far apart that rounding moves their corners by more than \
                 1/2048 of their size, or drops them as triangles without area"
            ));
        }
        notes
    }
}

/// A place with details that the origin of a mesh does not resolve.
struct Place {
    /// Number of triangles of the mesh that the origin does not resolve.
    unresolved: u64,
    /// Number of these that are in the bounds, and go to a tree of their own; 0 if there is no such place.
    moved: u64,
    bounds: DBounds,
}

impl Place {
    const NONE: Self = Self { unresolved: 0, moved: 0, bounds: DBounds::EMPTY };

    /// True if a triangle goes to another tree than the one with this origin.
    fn moves(&self, corners: &[DVec3; 3], origin: DVec3) -> bool {
        self.bounds.contains(&DBounds::of(corners)) && !resolve::is_resolved(corners, origin)
    }
}

/// True if every position is exact relative to the mesh's origin.
fn is_exact(mesh: &Spool) -> bool {
    mesh.is_single && mesh.origin == DVec3::ZERO
}

fn triangles(batch: &Batch) -> impl Iterator<Item = [DVec3; 3]> {
    (0..batch.positions.len()).map(|i| batch.positions.triangle(i))
}

impl Splitter<'_> {
    /// Sets the origins of all meshes. Meshes that are divided get further trees at the end of `meshes`, and instances
    /// of these in `assembly`.
    pub fn run(&self, meshes: &mut Vec<Spool>, assembly: &mut Assembly) -> Result<Found> {
        let mut all = Found::default();
        for index in 0..meshes.len() {
            let mesh = std::mem::replace(&mut meshes[index], Spool::new(0));
            let (trees, unresolved) = self.divide(mesh)?;
            all.unresolved += unresolved;
            all.trees += trees.len() - 1;
            for (i, tree) in trees.into_iter().enumerate() {
                if i == 0 {
                    meshes[index] = tree;
                } else {
                    place(assembly, index as u32, meshes.len() as u32);
                    meshes.push(tree);
                }
            }
        }
        Ok(all)
    }

    /// Divides a mesh into one tree or several. Also returns the number of triangles that their trees do not resolve.
    fn divide(&self, mut mesh: Spool) -> Result<(Vec<Spool>, u64)> {
        let (mut trees, mut unresolved) = (Vec::new(), 0);
        self.choose(&mut mesh)?;
        let mut todo = vec![mesh];
        while let Some(mesh) = todo.pop() {
            let place = if trees.len() + todo.len() + 1 < MOST_TREES { self.scan(&mesh)? } else { self.count(&mesh)? };
            if place.moved == 0 || place.moved == mesh.triangles {
                unresolved += place.unresolved;
                trees.push(mesh);
                continue;
            }
            let [taken, mut left] = self.part(&mesh, &place)?;
            self.choose(&mut left)?;
            // The tree that goes on with this origin comes first.
            todo.extend([left, taken]);
        }
        Ok((trees, unresolved))
    }

    /// Chooses the origin of a mesh.
    fn choose(&self, mesh: &mut Spool) -> Result<()> {
        mesh.origin = origin::choose(&mesh.bounds, mesh.is_single);
        if is_exact(mesh) {
            return Ok(());
        }
        let step = (mesh.triangles / SAMPLES).max(1) as u32;
        let mut samples = Samples::new();
        let sample = |batch: &Batch| {
            let mut here = Samples::new();
            resolve::sample(batch, step, |_| true, &mut here);
            here
        };
        self.each(mesh, sample, |here| {
            samples.extend(here);
            Ok(())
        })?;
        // A few small triangles do not move the origin.
        if resolve::lost(&samples, mesh.origin) > LEAST_LOST * samples.len() as f64 {
            mesh.origin = resolve::best(&samples, mesh.origin);
        }
        Ok(())
    }

    /// Calls `f` for all batches of a mesh in parallel, and `take` with the results in order.
    fn each<T: Send>(
        &self,
        mesh: &Spool,
        f: impl Fn(&Batch) -> T + Sync + Send,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        for first in (0..mesh.batches()).step_by(TOGETHER) {
            self.cancel.check()?;
            let count = TOGETHER.min(mesh.batches() - first);
            for one in self.par.map(count, |i| Ok(f(&*mesh.batch(first + i, self.spilled)?))) {
                take(one?)?;
            }
        }
        Ok(())
    }

    /// Counts the triangles that the mesh's origin does not resolve.
    fn count(&self, mesh: &Spool) -> Result<Place> {
        let mut all = Place::NONE;
        if !is_exact(mesh) {
            let count = |batch: &Batch| triangles(batch).filter(|t| !resolve::is_resolved(t, mesh.origin)).count();
            self.each(mesh, count, |count| {
                all.unresolved += count as u64;
                Ok(())
            })?;
        }
        Ok(all)
    }

    /// Finds a place with triangles that the mesh's origin does not resolve, but another one does. Small triangles
    /// among many larger ones, as scans and CAD exports have them, are no such place.
    fn scan(&self, mesh: &Spool) -> Result<Place> {
        let origin = mesh.origin;
        let mut place = self.count(mesh)?;
        if place.unresolved == 0 {
            return Ok(place);
        }
        let is_unresolved = |t: &[DVec3; 3]| !resolve::is_resolved(t, origin);
        let step = (place.unresolved / SAMPLES).max(1) as u32;
        let mut samples = Samples::new();
        let sample = |batch: &Batch| {
            let mut here = Samples::new();
            resolve::sample(batch, step, is_unresolved, &mut here);
            here
        };
        self.each(mesh, sample, |here| {
            samples.extend(here);
            Ok(())
        })?;
        let Some(other) = resolve::most_resolved(&samples) else { return Ok(place) };
        let at_other = |batch: &Batch| {
            let there = triangles(batch).filter(|t| is_unresolved(t) && resolve::is_resolved(t, other));
            there.flatten().fold(DBounds::EMPTY, DBounds::with)
        };
        self.each(mesh, at_other, |bounds| {
            place.bounds = place.bounds.union(bounds);
            Ok(())
        })?;
        // Triangles that move, larger ones with a corner among them, and larger ones that may cross the place.
        let mut counts = [0; 3];
        let near = |batch: &Batch| {
            let mut here = [0; 3];
            for t in triangles(batch).filter(|t| place.bounds.overlaps(&DBounds::of(t))) {
                let moves = place.moves(&t, origin);
                let has_corner = t.iter().any(|&c| place.bounds.contains(&DBounds::of(&[c])));
                here[0] += u64::from(moves);
                here[1] += u64::from(!moves && has_corner);
                here[2] += u64::from(!moves);
            }
            here
        };
        self.each(mesh, near, |here| {
            counts.iter_mut().zip(here).for_each(|(all, here)| *all += here);
            Ok(())
        })?;
        let [moved, touching, crossing] = counts;
        let is_detail = 4 * moved >= touching && (moved >= MANY || moved >= crossing);
        place.moved = if is_detail { moved } else { 0 };
        Ok(place)
    }

    /// Divides a mesh into the triangles that stay with its origin, and the others with those around them.
    fn part(&self, mesh: &Spool, place: &Place) -> Result<[Spool; 2]> {
        let origin = mesh.origin;
        let mut vertices = Vertices::of(place.moved, self.shares)?;
        let moved = |batch: &Batch| -> Vec<u64> {
            triangles(batch).filter(|t| place.moves(t, origin)).flatten().map(hash).collect()
        };
        self.each(mesh, moved, |hashes| {
            hashes.into_iter().for_each(|hash| vertices.insert(hash));
            Ok(())
        })?;
        let mut taken = Spool::new(mesh.local_parts);
        taken.origin = origin;
        let mut left = Spool::new(mesh.local_parts);
        for index in 0..mesh.batches() {
            self.cancel.check()?;
            let batch = mesh.batch(index, self.spilled)?;
            for i in 0..batch.positions.len() {
                let corners = batch.positions.triangle(i);
                // The bounds keep vertices elsewhere from being taken for marked ones.
                let shared = corners.map(|c| place.bounds.contains(&DBounds::of(&[c])) && vertices.has(hash(c)));
                let is_left = shared.contains(&true);
                let stays = !is_left || !place.moves(&corners, origin);
                let (part, prim) = (batch.parts[i], batch.prims[i]);
                let colour = batch.colours.get(i).filter(|c| c[3] != 0).copied();
                let is_copy = mesh.copies.contains_key(&prim);
                if stays {
                    taken.push(&corners, part, prim, colour)?;
                    is_copy.then(|| taken.copies.insert(prim, part));
                }
                if is_left {
                    let corners = if stays { on_both(corners, shared, origin) } else { corners };
                    left.push(&corners, part, prim, colour)?;
                    (is_copy || stays).then(|| left.copies.insert(prim, part));
                }
            }
            if let Some(to) = self.spilled
                && taken.bytes() + left.bytes() > self.shares.spool / 2
            {
                taken.spill(to, self.par)?;
                left.spill(to, self.par)?;
            }
        }
        if let (true, Some(to)) = (mesh.is_spilled(), self.spilled) {
            taken.spill(to, self.par)?;
            left.spill(to, self.par)?;
        }
        Ok([taken, left])
    }
}

/// Moves the corners that are not marked as `shared` with unresolved triangles to the positions that a tree with this
/// origin stores. At a marked corner the other tree has all triangles, so its position stays.
fn on_both(corners: [DVec3; 3], shared: [bool; 3], origin: DVec3) -> [DVec3; 3] {
    std::array::from_fn(|i| match shared[i] {
        true => corners[i],
        false => origin + (corners[i] - origin).as_vec3().as_dvec3(),
    })
}

/// Adds instances for the triangles of `mesh` that are in a `tree` of their own.
fn place(assembly: &mut Assembly, mesh: u32, tree: u32) {
    if mesh == 0 {
        let world_from_mesh = DAffine3::IDENTITY.to_cols_array();
        assembly.instances.push(InstanceRow { tree, first_part: 0, world_from_mesh });
        return;
    }
    let again: Vec<InstanceRow> =
        assembly.instances.iter().filter(|i| i.tree == mesh).map(|i| InstanceRow { tree, ..*i }).collect();
    assembly.instances.extend(again);
}

/// A hash of a position.
fn hash(p: DVec3) -> u64 {
    // The sum makes one zero of both.
    xxh3_64(bytemuck::bytes_of(&(p + DVec3::ZERO).to_array()))
}

/// A set of positions in a few bytes each. It may hold positions that were not inserted; it always answers the same for
/// the same position. (A Bloom filter: Bloom, "Space/time trade-offs in hash coding with allowable errors", CACM 1970.)
struct Vertices {
    words: Vec<u64>,
}

impl Vertices {
    /// An empty set for the corners of `triangles` triangles, in less memory than the triangles that wait.
    fn of(triangles: u64, shares: &Shares) -> Result<Self> {
        let most = shares.waiting.min(1 << 32) * 4;
        let words = 1 << (triangles * BITS / 64).clamp(1 << 10, most.max(1 << 10)).ilog2();
        Ok(Self { words: zeroed(words, "vertices of small triangles")? })
    }

    /// The words and bits of a position, given its [`hash`].
    fn places(&self, hash: u64) -> [(usize, u64); 4] {
        let (mut at, step) = (hash, hash.rotate_left(32) | 1);
        std::array::from_fn(|_| {
            at = at.wrapping_add(step);
            ((at >> 6) as usize & (self.words.len() - 1), 1 << (at & 63))
        })
    }

    fn insert(&mut self, hash: u64) {
        for (word, bit) in self.places(hash) {
            self.words[word] |= bit;
        }
    }

    fn has(&self, hash: u64) -> bool {
        self.places(hash).iter().all(|&(word, bit)| self.words[word] & bit != 0)
    }
}
