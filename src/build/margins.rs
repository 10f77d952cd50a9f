//! The margins of chunks: for each chunk the triangles of others that share a vertex with one of its own. With them a
//! chunk knows all triangles around its vertices, although it is built without the other chunks.
//!
//! Three passes. The first finds the vertices that several chunks have, the second the triangles at them and which
//! chunks have which vertex, the third, over these triangles alone, hands them over. Sets of vertices are Bloom
//! filters: where one errs, a margin has a triangle too many, which does no harm. Only vertices within the bounds of
//! another chunk are looked at.

use super::batch::{self, Batch, Extent, Positions};
use super::bloom::{self, Bloom};
use super::distribute::{Bucket, Distributor, Pool};
use super::normals;
use crate::base::error::Result;
use crate::math::Bounds;
use glam::Vec3;

/// Number of batches that are read together.
const TOGETHER: usize = 8;

/// Bits of a set for each triangle, as far as memory allows.
const BITS: u64 = 24;

struct Margins<'a> {
    by: &'a Distributor<'a>,
    chunks: &'a [Bucket],
    /// Vertices that several chunks have.
    shared: Bloom,
    /// Pairs of such a vertex and a chunk.
    pairs: Bloom,
}

/// Returns the margin of each of `chunks`.
pub fn find(by: &Distributor, chunks: &[Bucket]) -> Result<Vec<Bucket>> {
    let triangles: u64 = chunks.iter().map(|chunk| chunk.triangles).sum();
    // Nothing waits now in the memory of the triangles that wait.
    let bits = (triangles * BITS).min(by.waiting.saturating_mul(8 * 16)).max(1 << 16);
    let set = |bits: u64| Bloom::with_bits(bits / 2, "vertices of chunks");
    let mut margins = Margins { by, chunks, shared: set(bits / 2)?, pairs: set(bits / 2)? };
    margins.find_shared(set(bits)?)?;
    let border = margins.border()?;
    margins.hand_over(&border)
}

impl Margins<'_> {
    /// Returns the chunks whose bounds overlap those of chunk `of`, with their bounds.
    fn near(&self, of: usize) -> Vec<(usize, Bounds)> {
        let reach = &self.chunks[of].reach;
        let others = self.chunks.iter().enumerate().filter(|(i, other)| *i != of && other.reach.overlaps(reach));
        others.map(|(i, other)| (i, other.reach)).collect()
    }

    /// Calls `f` for the batches of a bucket in parallel, with the chunks of `near` that reach into each, and `take`
    /// with the results in order.
    fn each<T: Send>(
        &self,
        extents: &[Extent],
        near: &[(usize, Bounds)],
        f: impl Fn(&Batch, &[(usize, Bounds)]) -> T + Sync + Send,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        for some in extents.chunks(TOGETHER) {
            self.by.cancel.check()?;
            let one = |i: usize| -> Result<T> {
                let batch = batch::read(self.by.to, &some[i])?;
                let reach = Bounds::of(positions(&batch).as_flattened());
                let here: Vec<_> = near.iter().filter(|(_, other)| other.overlaps(&reach)).copied().collect();
                Ok(f(&batch, &here))
            };
            for one in self.by.par.map(some.len(), one) {
                take(one?)?;
            }
        }
        Ok(())
    }

    /// Finds the vertices that several chunks have. `seen`: an empty set.
    fn find_shared(&mut self, mut seen: Bloom) -> Result<()> {
        for (index, chunk) in self.chunks.iter().enumerate() {
            let near = self.near(index);
            let (mut own, mut shared) = (Vec::new(), Vec::new());
            let hashes = |batch: &Batch, near: &[(usize, Bounds)]| {
                let vertices = positions(batch).as_flattened().iter();
                let within = vertices.filter(|p| near.iter().any(|(_, reach)| contains(reach, **p)));
                let mut all: Vec<u64> = within.map(|p| normals::hash(*p)).collect();
                all.sort_unstable();
                all.dedup();
                all
            };
            self.each(&chunk.extents, &near, hashes, |hashes| {
                shared.extend(hashes.iter().filter(|hash| seen.has(**hash)));
                own.extend(hashes);
                Ok(())
            })?;
            own.iter().for_each(|hash| seen.insert(*hash));
            shared.iter().for_each(|hash| self.shared.insert(*hash));
        }
        Ok(())
    }

    /// Returns the triangles of each chunk that have a shared vertex, and notes the chunks of these vertices.
    fn border(&mut self) -> Result<Vec<Bucket>> {
        let mut pools: Vec<Pool> = self.chunks.iter().map(|_| Pool::new()).collect();
        for (index, chunk) in self.chunks.iter().enumerate() {
            let near = self.near(index);
            let mut pairs = Vec::new();
            let at_border = |batch: &Batch, near: &[(usize, Bounds)]| {
                let (mut some, mut pairs) = (Batch::empty(true), Vec::new());
                for (i, triangle) in positions(batch).iter().enumerate() {
                    let before = pairs.len();
                    for p in triangle.iter().filter(|p| near.iter().any(|(_, reach)| contains(reach, **p))) {
                        let hash = normals::hash(*p);
                        if self.shared.has(hash) {
                            pairs.push(bloom::pair(hash, index));
                        }
                    }
                    if pairs.len() > before {
                        add(&mut some, batch, i);
                    }
                }
                (some, pairs)
            };
            self.each(&chunk.extents, &near, at_border, |(some, of_batch)| {
                pairs.extend(of_batch);
                pools[index].add(some, Bounds::EMPTY);
                self.by.write_some(&mut pools)
            })?;
            pairs.iter().for_each(|pair| self.pairs.insert(*pair));
        }
        self.by.buckets(pools)
    }

    /// Hands the triangles at shared vertices to the chunks that have these.
    fn hand_over(&self, border: &[Bucket]) -> Result<Vec<Bucket>> {
        let mut pools: Vec<Pool> = self.chunks.iter().map(|_| Pool::new()).collect();
        for (index, bucket) in border.iter().enumerate() {
            let near = self.near(index);
            let route = |batch: &Batch, near: &[(usize, Bounds)]| {
                let mut to: Vec<(usize, Batch)> = Vec::new();
                for (i, triangle) in positions(batch).iter().enumerate() {
                    for &(chunk, reach) in near {
                        let has =
                            |p: &Vec3| contains(&reach, *p) && self.pairs.has(bloom::pair(normals::hash(*p), chunk));
                        if triangle.iter().any(has) {
                            let at = to.iter().position(|(to, _)| *to == chunk).unwrap_or_else(|| {
                                to.push((chunk, Batch::empty(true)));
                                to.len() - 1
                            });
                            add(&mut to[at].1, batch, i);
                        }
                    }
                }
                to
            };
            self.each(&bucket.extents, &near, route, |to| {
                to.into_iter().for_each(|(chunk, batch)| pools[chunk].add(batch, Bounds::EMPTY));
                self.by.write_some(&mut pools)
            })?;
        }
        self.by.buckets(pools)
    }
}

/// The corners of a batch in single precision, as all placed triangles are.
fn positions(batch: &Batch) -> &[[Vec3; 3]] {
    match &batch.positions {
        Positions::Single(positions) => positions,
        Positions::Double(_) => &[],
    }
}

fn contains(bounds: &Bounds, p: Vec3) -> bool {
    p.cmpge(bounds.min).all() && p.cmple(bounds.max).all()
}

/// Adds triangle `i` of `from`, without colours and normals.
fn add(to: &mut Batch, from: &Batch, i: usize) {
    if let Positions::Single(to) = &mut to.positions {
        to.push(positions(from)[i]);
    }
    to.parts.push(from.parts[i]);
    to.prims.push(from.prims[i]);
}
