//! The distribution of a mesh into chunks of neighbouring triangles, each of which fits memory.
//!
//! The middle of a triangle's box decides, by the regions of a grid. A region with too many triangles is a single cell,
//! and is divided again over a grid of its own. If all middles are in one cell of that, the triangles are divided by
//! order of arrival. Chunks depend only on the triangles and on the maximum size of a chunk.

use super::batch::{self, BATCH, Batch, Extent, Positions};
use super::origin;
use super::regions::{self, Regions};
use super::survey::{self, Batches, Grid, TOGETHER};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::base::scratch::Scratch;
use crate::math::Bounds;
use crate::structure::Par;
use glam::DVec3;
use std::borrow::Cow;

/// Triangles in a scratch file, in the order of their primitive ids, with positions relative to the mesh's origin.
pub struct Bucket {
    /// Places of the batches in the file.
    pub extents: Vec<Extent>,
    /// Number of triangles.
    pub triangles: u64,
    /// Bounds of the middles of their boxes.
    bounds: Bounds,
    /// Bounds of the triangles.
    pub reach: Bounds,
}

impl Bucket {
    /// A bucket without triangles.
    pub fn empty() -> Self {
        Self { extents: Vec::new(), triangles: 0, bounds: Bounds::EMPTY, reach: Bounds::EMPTY }
    }
}

/// Parameters of the distribution.
pub struct Distributor<'a> {
    /// Maximum number of triangles of a chunk.
    pub most: u64,
    /// Approximate maximum number of triangles that wait in memory, over all chunks.
    pub waiting: u64,
    /// Scratch file of the chunks.
    pub to: &'a Scratch,
    pub par: &'a Par,
    pub cancel: &'a Cancel,
}

/// A bucket as a source of batches.
struct Again<'a> {
    bucket: &'a Bucket,
    from: &'a Scratch,
}

impl Batches for Again<'_> {
    fn len(&self) -> usize {
        self.bucket.extents.len()
    }
    fn batch(&self, index: usize) -> Result<Cow<'_, Batch>> {
        batch::read(self.from, &self.bucket.extents[index]).map(Cow::Owned)
    }
    fn triangles(&self) -> u64 {
        self.bucket.triangles
    }
    fn origin(&self) -> DVec3 {
        DVec3::ZERO
    }
    fn bounds(&self) -> Bounds {
        self.bucket.bounds
    }
}

impl Distributor<'_> {
    /// Returns the chunks of `source`. `histogram`: its histogram over `grid`. Calls `seen` with the number of
    /// distributed triangles.
    pub fn chunks(
        &self,
        source: &dyn Batches,
        grid: &Grid,
        histogram: &[u32],
        seen: &mut dyn FnMut(u64),
    ) -> Result<Vec<Bucket>> {
        let regions = regions::divide(histogram, self.most);
        let buckets = self.distribute(source, grid, &regions, seen)?;
        let mut chunks = Vec::with_capacity(buckets.len());
        for bucket in buckets {
            self.divide(bucket, &mut chunks)?;
        }
        Ok(chunks)
    }

    /// Divides a bucket until no chunk is too large.
    fn divide(&self, bucket: Bucket, chunks: &mut Vec<Bucket>) -> Result<()> {
        if bucket.triangles <= self.most {
            chunks.push(bucket);
            return Ok(());
        }
        let again = Again { bucket: &bucket, from: self.to };
        let found = survey::survey(&again, self.par, self.cancel, |_| ())?;
        if found.histogram.iter().filter(|c| **c > 0).nth(1).is_none() {
            self.by_arrival(bucket, chunks);
            return Ok(());
        }
        chunks.extend(self.chunks(&again, &found.grid, &found.histogram, &mut |_| ())?);
        Ok(())
    }

    fn by_arrival(&self, bucket: Bucket, chunks: &mut Vec<Bucket>) {
        let empty = || Bucket { extents: Vec::new(), triangles: 0, ..bucket };
        let mut now = empty();
        for &extent in &bucket.extents {
            if now.triangles > 0 && now.triangles + u64::from(extent.count) > self.most {
                chunks.push(std::mem::replace(&mut now, empty()));
            }
            now.triangles += u64::from(extent.count);
            now.extents.push(extent);
        }
        chunks.push(now);
    }

    fn distribute(
        &self,
        source: &dyn Batches,
        grid: &Grid,
        regions: &Regions,
        seen: &mut dyn FnMut(u64),
    ) -> Result<Vec<Bucket>> {
        let mut pools: Vec<Pool> = regions.counts.iter().map(|_| Pool::new()).collect();
        let mut taken = 0;
        for first in (0..source.len()).step_by(TOGETHER) {
            self.cancel.check()?;
            let sorted = self.par.map(TOGETHER.min(source.len() - first), |i| -> Result<_> {
                let batch = source.batch(first + i)?;
                Ok((batch.positions.len(), sort(&batch, source.origin(), grid, regions)))
            });
            for sorted in sorted {
                let (count, pieces) = sorted?;
                taken += count as u64;
                for Piece { region, batch, bounds } in pieces {
                    pools[region as usize].add(batch, bounds);
                }
            }
            self.write_some(&mut pools)?;
            seen(taken);
        }
        self.buckets(pools)
    }

    /// Writes all triangles that wait. Returns the buckets.
    pub(super) fn buckets(&self, mut pools: Vec<Pool>) -> Result<Vec<Bucket>> {
        let all: Vec<usize> = (0..pools.len()).collect();
        for some in all.chunks(64) {
            self.write(&mut pools, some)?;
        }
        Ok(pools.into_iter().map(|p| p.bucket).collect())
    }

    /// Writes the pools that fill a batch. If too many triangles wait even then, also writes the largest pools.
    pub(super) fn write_some(&self, pools: &mut [Pool]) -> Result<()> {
        let mut some: Vec<usize> = (0..pools.len()).filter(|&i| pools[i].count >= BATCH).collect();
        self.write(pools, &some)?;
        let mut waiting: u64 = pools.iter().map(|p| p.count as u64).sum();
        if waiting <= self.waiting {
            return Ok(());
        }
        some = (0..pools.len()).collect();
        some.sort_by_key(|&i| (std::cmp::Reverse(pools[i].count), i));
        let enough = some.iter().take_while(|&&i| {
            let before = waiting;
            waiting -= pools[i].count as u64;
            before > self.waiting / 2
        });
        let enough = enough.count();
        self.write(pools, &some[..enough])
    }

    fn write(&self, pools: &mut [Pool], which: &[usize]) -> Result<()> {
        for some in which.chunks(TOGETHER) {
            self.cancel.check()?;
            let batches: Vec<(usize, Batch)> =
                some.iter().flat_map(|&i| pools[i].take().into_iter().map(move |b| (i, b))).collect();
            let refs: Vec<&Batch> = batches.iter().map(|(_, b)| b).collect();
            let extents = batch::write(&refs, self.to, self.par)?;
            for ((i, _), extent) in batches.iter().zip(extents) {
                pools[*i].bucket.extents.push(extent);
            }
        }
        Ok(())
    }
}

/// A bucket that is being filled.
pub(super) struct Pool {
    bucket: Bucket,
    /// Batches that are not yet written.
    waiting: Vec<Batch>,
    /// Number of their triangles.
    count: usize,
}

impl Pool {
    pub(super) fn new() -> Self {
        let bucket = Bucket::empty();
        Self { bucket, waiting: Vec::new(), count: 0 }
    }

    /// Number of all triangles that were added.
    pub(super) fn triangles(&self) -> u64 {
        self.bucket.triangles
    }

    /// Adds triangles, and the bounds of their middles.
    pub(super) fn add(&mut self, batch: Batch, bounds: Bounds) {
        if let Positions::Single(triangles) = &batch.positions {
            self.bucket.reach = triangles.iter().flatten().fold(self.bucket.reach, |reach, p| reach.with(*p));
        }
        self.bucket.triangles += batch.parts.len() as u64;
        self.bucket.bounds = self.bucket.bounds.union(bounds);
        self.count += batch.parts.len();
        self.waiting.push(batch);
    }

    /// Removes the waiting triangles, joined to few batches.
    fn take(&mut self) -> Vec<Batch> {
        self.count = 0;
        let mut out: Vec<Batch> = Vec::new();
        for next in std::mem::take(&mut self.waiting) {
            match out.last_mut() {
                Some(last) if last.parts.len() + next.parts.len() <= BATCH => append(last, next),
                _ => out.push(next),
            }
        }
        out
    }
}

/// Appends the triangles of `from`. Both batches are in single precision, as all placed triangles are.
fn append(to: &mut Batch, from: Batch) {
    to.values.append(to.parts.len(), &from.values, from.parts.len());
    if let (Positions::Single(to), Positions::Single(from)) = (&mut to.positions, from.positions) {
        to.extend(from);
    }
    to.parts.extend(from.parts);
    to.prims.extend(from.prims);
}

/// Triangles of one batch in one region.
struct Piece {
    region: u32,
    batch: Batch,
    /// Bounds of their middles.
    bounds: Bounds,
}

/// Places a batch, and divides it by regions, in the order of their first triangles.
fn sort(batch: &Batch, origin: DVec3, grid: &Grid, regions: &Regions) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = Vec::new();
    let mut piece_of = vec![u32::MAX; regions.counts.len()];
    origin::visit(batch, origin, |i, triangle| {
        let middle = survey::middle(&triangle);
        let region = regions.of_cell[survey::index(grid.cell(middle))];
        let piece = &mut piece_of[region as usize];
        if *piece == u32::MAX {
            *piece = pieces.len() as u32;
            pieces.push(Piece { region, batch: Batch::empty(true), bounds: Bounds::EMPTY });
        }
        let Piece { batch: to, bounds, .. } = &mut pieces[*piece as usize];
        *bounds = bounds.with(middle);
        if let Positions::Single(positions) = &mut to.positions {
            positions.push(triangle);
        }
        to.values.push(to.parts.len(), batch.values.get(i));
        to.parts.push(batch.parts[i]);
        to.prims.push(batch.prims[i]);
    });
    pieces
}
