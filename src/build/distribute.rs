//! A mesh into chunks: triangles that are near each other, as many as fit memory.
//!
//! By the middles of the triangles' boxes, over the regions of a grid; a region that holds too much, which is
//! one cell then, is divided again, over a grid of its own. Where all middles are one point, by order of
//! arrival. Chunks depend on the triangles and on how many may be in one, on nothing else.

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

/// Triangles in a scratch file, by primitive id, around the mesh's origin.
pub struct Bucket {
    /// Where.
    pub extents: Vec<Extent>,
    /// How many.
    pub triangles: u64,
    /// Of the middles of their boxes.
    bounds: Bounds,
}

/// What distributing needs besides the triangles.
pub struct Distributor<'a> {
    /// Triangles of a chunk, at most.
    pub most: u64,
    /// Triangles in memory, over all chunks, about.
    pub waiting: u64,
    /// Where chunks go.
    pub to: &'a Scratch,
    pub par: &'a Par,
    pub cancel: &'a Cancel,
}

/// A bucket as input again.
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
    /// The chunks of `source`, given its histogram over `grid`. `seen` hears how many triangles were taken up.
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

    /// Divides what is too much.
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
        let bounds = bucket.bounds;
        let mut now = Bucket { extents: Vec::new(), triangles: 0, bounds };
        for extent in bucket.extents {
            if now.triangles > 0 && now.triangles + u64::from(extent.count) > self.most {
                chunks.push(std::mem::replace(&mut now, Bucket { extents: Vec::new(), triangles: 0, bounds }));
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
        let all: Vec<usize> = (0..pools.len()).collect();
        for some in all.chunks(64) {
            self.write(&mut pools, some)?;
        }
        Ok(pools.into_iter().map(|p| p.bucket).collect())
    }

    /// Writes what is a batch or more, and if too much waits then, the most of it.
    fn write_some(&self, pools: &mut [Pool]) -> Result<()> {
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

/// A bucket being filled.
struct Pool {
    bucket: Bucket,
    /// Not yet written.
    waiting: Vec<Batch>,
    /// Triangles of these.
    count: usize,
}

impl Pool {
    fn new() -> Self {
        let bucket = Bucket { extents: Vec::new(), triangles: 0, bounds: Bounds::EMPTY };
        Self { bucket, waiting: Vec::new(), count: 0 }
    }

    fn add(&mut self, batch: Batch, bounds: Bounds) {
        self.bucket.triangles += batch.parts.len() as u64;
        self.bucket.bounds = self.bucket.bounds.union(bounds);
        self.count += batch.parts.len();
        self.waiting.push(batch);
    }

    /// What waits, as few batches.
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

/// Adds the triangles of `from`, which are in single precision as all that was placed.
fn append(to: &mut Batch, from: Batch) {
    if !to.colours.is_empty() || !from.colours.is_empty() {
        to.colours.resize(to.parts.len(), [0; 4]);
        to.colours.extend(&from.colours);
        to.colours.resize(to.parts.len() + from.parts.len(), [0; 4]);
    }
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
    /// Of the middles.
    bounds: Bounds,
}

/// A batch, placed, by regions in the order in which they are met.
fn sort(batch: &Batch, origin: DVec3, grid: &Grid, regions: &Regions) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = Vec::new();
    let mut piece_of = vec![u32::MAX; regions.counts.len()];
    origin::visit(batch, origin, |i, triangle| {
        let middle = survey::middle(&triangle);
        let region = regions.of_cell[survey::index(grid.cell(middle))];
        let piece = &mut piece_of[region as usize];
        if *piece == u32::MAX {
            *piece = pieces.len() as u32;
            let (parts, prims, colours) = (Vec::new(), Vec::new(), Vec::new());
            let batch = Batch { positions: Positions::Single(Vec::new()), parts, prims, colours };
            pieces.push(Piece { region, batch, bounds: Bounds::EMPTY });
        }
        let Piece { batch: to, bounds, .. } = &mut pieces[*piece as usize];
        *bounds = bounds.with(middle);
        if let Positions::Single(positions) = &mut to.positions {
            positions.push(triangle);
        }
        to.parts.push(batch.parts[i]);
        to.prims.push(batch.prims[i]);
        if !batch.colours.is_empty() {
            to.colours.push(batch.colours[i]);
        }
    });
    pieces
}
