//! The margins of chunks: for each chunk the triangles of others that share a vertex with one of its own. With them a
//! chunk knows all triangles around its vertices, although it is built without the other chunks.
//!
//! Three passes. The first finds the vertices that several chunks have, the second the triangles at them and which
//! chunks have which vertex, the third, over these triangles alone, hands them over. Sets of vertices are Bloom
//! filters: where one errs, a margin has a triangle too many, which does no harm. Only vertices within the bounds of
//! another chunk are looked at.
//!
//! Margins take memory beside their chunks, so they are limited. A vertex at which very many triangles meet, such as
//! the middle of a fan, would bring them all into every chunk that has it: such vertices do not count, and each chunk
//! knows only its own triangles around them.

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

/// Most triangles of a batch at a vertex that counts.
const MOST_AT_VERTEX: usize = 4096;

/// Most chunks, per triangle, to which the triangles of a batch are handed over. Most triangles of a border go to one.
const MOST_COPIES: usize = 4;

/// A margin has at most the triangles of the largest chunk divided by this.
const SHARE: u64 = 2;

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
                // Shared vertices, and the triangles that have them.
                let mut met: Vec<(u64, u32)> = Vec::new();
                for (i, triangle) in positions(batch).iter().enumerate() {
                    let within = triangle.iter().filter(|p| near.iter().any(|(_, reach)| contains(reach, **p)));
                    let hashes = within.map(|p| normals::hash(*p)).filter(|hash| self.shared.has(*hash));
                    met.extend(hashes.map(|hash| (hash, i as u32)));
                }
                met.sort_unstable();
                let (mut triangles, mut pairs) = (Vec::new(), Vec::new());
                for at in met.chunk_by(|a, b| a.0 == b.0).filter(|at| at.len() <= MOST_AT_VERTEX) {
                    pairs.push(bloom::pair(at[0].0, index));
                    triangles.extend(at.iter().map(|(_, triangle)| *triangle));
                }
                triangles.sort_unstable();
                triangles.dedup();
                let mut some = Batch::empty(true);
                triangles.iter().for_each(|i| add(&mut some, batch, *i as usize));
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
                let mut left = MOST_COPIES * positions(batch).len();
                for (i, triangle) in positions(batch).iter().enumerate() {
                    for &(chunk, reach) in near {
                        let has =
                            |p: &Vec3| contains(&reach, *p) && self.pairs.has(bloom::pair(normals::hash(*p), chunk));
                        if left > 0 && triangle.iter().any(has) {
                            left -= 1;
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
                for (chunk, batch) in to {
                    if pools[chunk].triangles() + batch.parts.len() as u64 <= self.by.most / SHARE {
                        pools[chunk].add(batch, Bounds::EMPTY);
                    }
                }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Cancel;
    use crate::base::quota::Quota;
    use crate::base::scratch::{Scratch, ScratchSpace};
    use crate::structure::Par;
    use std::collections::{BTreeMap, BTreeSet};

    fn load(bucket: &Bucket, from: &Scratch) -> Vec<(u32, [Vec3; 3])> {
        let batches = bucket.extents.iter().map(|extent| batch::read(from, extent).expect("a batch"));
        let all = batches.flat_map(|batch| {
            let prims = batch.prims.clone();
            prims.into_iter().zip(positions(&batch).to_vec()).collect::<Vec<_>>()
        });
        all.collect()
    }

    /// Each margin has the triangles of other chunks at the chunk's vertices, each once, and hardly any others.
    #[test]
    fn margins_are_the_triangles_around_a_chunk() {
        let side = 60;
        let at = |x: usize, y: usize| Vec3::new(x as f32, y as f32, ((x * 7 + y * 3) % 11) as f32 * 0.3);
        let square = |i: usize| {
            let (x, y) = (i % side, i / side);
            [[at(x, y), at(x + 1, y), at(x, y + 1)], [at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]]
        };
        let triangles: Vec<[Vec3; 3]> = (0..side * side).flat_map(square).collect();
        for threads in [1, 2] {
            let to = ScratchSpace::limited(None, Quota::new(0)).file().expect("a file");
            let (par, cancel) = (Par { threads }, Cancel::new());
            let by = Distributor { most: 4000, waiting: 5000, to: &to, par: &par, cancel: &cancel };
            // Stripes, and one chunk that has triangles everywhere.
            let chunk_of = |i: usize| if i % 97 == 5 { 9 } else { i * 9 / triangles.len() };
            let mut pools: Vec<Pool> = (0..10).map(|_| Pool::new()).collect();
            for (i, triangle) in triangles.iter().enumerate() {
                let mut one = Batch::empty(true);
                let from = Batch {
                    positions: Positions::Single(vec![*triangle]),
                    parts: vec![0],
                    prims: vec![i as u32],
                    ..Batch::empty(true)
                };
                add(&mut one, &from, 0);
                pools[chunk_of(i)].add(one, Bounds::EMPTY);
            }
            let chunks = by.buckets(pools).expect("chunks");
            let margins = find(&by, &chunks).expect("margins");
            let mut chunks_at: BTreeMap<[u32; 3], BTreeSet<usize>> = BTreeMap::new();
            for (i, triangle) in triangles.iter().enumerate() {
                for p in triangle {
                    chunks_at.entry(p.to_array().map(f32::to_bits)).or_default().insert(chunk_of(i));
                }
            }
            for (chunk, margin) in margins.iter().enumerate() {
                let found = load(margin, &to);
                let prims: BTreeSet<u32> = found.iter().map(|(prim, _)| *prim).collect();
                assert_eq!(prims.len(), found.len());
                let touches = |triangle: &[Vec3; 3]| {
                    triangle.iter().any(|p| chunks_at[&p.to_array().map(f32::to_bits)].contains(&chunk))
                };
                let expected: BTreeSet<u32> = (0..triangles.len())
                    .filter(|i| chunk_of(*i) != chunk && touches(&triangles[*i]))
                    .map(|i| i as u32)
                    .collect();
                assert!(!expected.is_empty() && prims.is_superset(&expected), "chunk {chunk}");
                assert!(prims.len() <= expected.len() + expected.len() / 20, "{} of {}", prims.len(), expected.len());
            }
        }
    }
}
