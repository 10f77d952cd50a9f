//! One mesh: placed, built in one chunk or several, its blocks written.

use super::BuildOptions;
use super::builder::asked_for_splits;
use super::distribute::{Bucket, Distributor};
use super::batch::Batch;
use super::origin::{self, FAR, Placed};
use super::output::{Output, Span};
use super::parts::{self, Assembly};
use super::spool::Spool;
use super::survey::{self, Batches};
use crate::base::error::Result;
use crate::base::progress::Phase;
use crate::base::scratch::Scratch;
use crate::math::Bounds;
use crate::store::TreeRow;
use crate::structure::bvh::build::{self, Chunk, Counts, Crown, Top, TreeInput, TreeOptions, splits_pay};
use crate::structure::bvh::trace::TreeView;
use glam::{DVec3, Vec3};
use std::borrow::Cow;
use std::time::Instant;

/// Share of splitting: references added, at most, for each triangle.
const SPLIT_BUDGET: f32 = 0.5;

/// A spooled mesh that is looked at and left where it is.
struct Waiting<'a> {
    spool: &'a Spool,
    from: Option<&'a Scratch>,
    origin: DVec3,
}

impl Batches for Waiting<'_> {
    fn len(&self) -> usize {
        self.spool.batches()
    }
    fn batch(&self, index: usize) -> Result<Cow<'_, Batch>> {
        self.spool.batch(index, self.from)
    }
    fn triangles(&self) -> u64 {
        self.spool.triangles
    }
    fn origin(&self) -> DVec3 {
        self.origin
    }
    fn bounds(&self) -> Bounds {
        let around = |p: DVec3| (p - self.origin).as_vec3().clamp(Vec3::splat(-FAR), Vec3::splat(FAR));
        Bounds { min: around(self.spool.bounds.min), max: around(self.spool.bounds.max) }
    }
}

impl Output<'_> {
    /// Builds and writes tree number `index`.
    pub fn tree(
        &mut self,
        spool: Spool,
        options: &BuildOptions,
        index: usize,
        assembly: &mut Assembly,
        span: Span,
    ) -> Result<TreeRow> {
        let row = TreeRow {
            first_block: self.writer.blocks_written(),
            root: u64::from(TreeView::EMPTY),
            local_parts: spool.local_parts,
            ..TreeRow::EMPTY
        };
        if spool.is_spilled() && spool.triangles > self.shares.chunk {
            self.in_chunks(spool, options, index, assembly, row, span)
        } else {
            self.in_one(spool, options, index, assembly, row, span)
        }
    }

    fn in_one(
        &mut self,
        spool: Spool,
        options: &BuildOptions,
        index: usize,
        assembly: &mut Assembly,
        mut row: TreeRow,
        span: Span,
    ) -> Result<TreeRow> {
        let begun = Instant::now();
        let placed = origin::place(spool, self.spilled.as_ref(), &self.par, self.cancel)?;
        self.cancel.check()?;
        self.judged(&placed.fates, placed.origin, &mut row);
        let of_parts = parts::count(&placed.triangles, &placed.parts, &self.par);
        assembly.add(index, placed.origin, &of_parts);
        if placed.triangles.is_empty() {
            return Ok(row);
        }
        self.report.chunks += 1;
        let split = asked_for_splits(options.splits).unwrap_or_else(|| splits_pay(&placed.triangles));
        let (par, cancel) = (self.par, self.cancel);
        let part_colours = assembly.colours(index, row.local_parts);
        let built = Chunk::build(input(&placed, &part_colours), &self.split(split, 0.0), true, &par, cancel)?;
        self.report.seconds.build += begun.elapsed().as_secs_f64();
        let mut chunk = built.chunk;
        let plans = chunk.take_plans();
        row.bounds = flat(&built.bounds);
        let span = span.part(0.7, 1.0);
        self.progress.advance(span.0);
        self.progress.enter(Phase::Write);
        let Some(top) = built.top else {
            (row.block_count, row.coarse_blocks) = (1, 1);
            self.write_blocks(plans, |plan| chunk.encode(plan), span)?;
            return Ok(rooted(row, &built.counts));
        };
        let crown = Crown::over(vec![top])?;
        self.coarse(&crown, plans.len(), &mut row)?;
        self.write_blocks(plans, |plan| chunk.encode(plan), span)?;
        Ok(row)
    }

    fn in_chunks(
        &mut self,
        spool: Spool,
        options: &BuildOptions,
        index: usize,
        assembly: &mut Assembly,
        mut row: TreeRow,
        span: Span,
    ) -> Result<TreeRow> {
        let begun = Instant::now();
        let from = self.spilled.as_ref();
        let mesh = Waiting { spool: &spool, from, origin: origin::choose(&spool.bounds, spool.is_single) };
        let total = spool.triangles as f64;
        let heard = |part: Span| move |seen: u64| part.part(seen as f64 / total, 1.0).0;
        let (at, progress) = (heard(span.part(0.0, 0.08)), self.progress);
        let found = survey::survey(&mesh, &self.par, self.cancel, |seen| progress.advance(at(seen)))?;
        let buckets_in = self.space.file()?;
        let distributor = Distributor {
            most: self.shares.chunk,
            waiting: self.shares.waiting,
            to: &buckets_in,
            par: &self.par,
            cancel: self.cancel,
        };
        let at = heard(span.part(0.08, 0.25));
        let mut seen = |seen: u64| progress.advance(at(seen));
        let buckets = distributor.chunks(&mesh, &found.grid, &found.histogram, &mut seen)?;
        let origin = mesh.origin;
        let mesh_half_area = spool.bounds.half_area() as f32;
        drop(spool);
        if self.trees_left == 0 {
            self.spilled = None;
        }
        self.judged(&found.fates, origin, &mut row);
        assembly.add(index, origin, &found.parts);
        let split = asked_for_splits(options.splits).unwrap_or_else(|| splits_pay(&found.samples));
        self.report.seconds.distribute += begun.elapsed().as_secs_f64();
        let part_colours = assembly.colours(index, row.local_parts);
        let mut aside = [self.fine_aside(), self.fine_aside()];
        let (mut tops, mut bounds, mut done) = (Vec::new(), Bounds::EMPTY, 0);
        for bucket in &buckets {
            let part = |done: u64| 0.25 + 0.7 * done as f64 / found.fates.kept as f64;
            let here = span.part(part(done), part(done + bucket.triangles));
            done += bucket.triangles;
            let (top, its_bounds) = self.chunk(bucket, &buckets_in, &part_colours, (split, mesh_half_area), &mut aside, here)?;
            tops.push(top);
            bounds = bounds.union(its_bounds);
        }
        drop(buckets_in);
        if tops.is_empty() {
            return Ok(row);
        }
        self.progress.enter(Phase::Write);
        row.bounds = flat(&bounds);
        let crown = Crown::over(tops)?;
        let [nodes, leaves] = aside;
        self.coarse(&crown, nodes.blocks(), &mut row)?;
        self.write_aside(nodes)?;
        self.write_aside(leaves)?;
        Ok(row)
    }

    /// One of several chunks of a mesh.
    fn chunk(
        &mut self,
        bucket: &Bucket,
        from: &Scratch,
        part_colours: &[Vec3],
        (split, mesh_half_area): (bool, f32),
        aside: &mut [super::output::FineAside; 2],
        span: Span,
    ) -> Result<(Top, Bounds)> {
        let begun = Instant::now();
        let placed = origin::load(&bucket.extents, from, self.has_colours, &self.par, self.cancel)?;
        let (par, cancel) = (self.par, self.cancel);
        let built = Chunk::build(input(&placed, part_colours), &self.split(split, mesh_half_area), false, &par, cancel)?;
        self.report.seconds.build += begun.elapsed().as_secs_f64();
        self.report.chunks += 1;
        let span = span.part(0.7, 1.0);
        self.progress.advance(span.0);
        let mut chunk = built.chunk;
        self.put_aside(chunk.take_plans(), |plan| chunk.encode(plan), aside, span)?;
        let top = built.top.ok_or_else(|| crate::Error::Internal("a chunk took itself for the whole".into()))?;
        Ok((top, built.bounds))
    }

    /// Writes the coarse blocks, and says in `row` what the tree is with `fine` blocks, and as many leaf blocks, behind them.
    fn coarse(&mut self, crown: &Crown, fine: usize, row: &mut TreeRow) -> Result<()> {
        row.coarse_blocks = crown.blocks() as u32;
        row.block_count = row.coarse_blocks + 2 * fine as u32;
        *row = rooted(*row, &crown.counts);
        let (first, at) = (row.first_block, self.progress.fraction());
        self.write_blocks((0..crown.blocks()).collect(), |i| (crown.encode(i, first), None), Span(at, at))
    }

    fn judged(&mut self, fates: &origin::Fates, origin: DVec3, row: &mut TreeRow) {
        self.report.degenerate += fates.degenerate;
        self.report.out_of_range += fates.out_of_range;
        self.report.position_error = self.report.position_error.max(fates.position_error);
        row.origin = origin.to_array();
        row.triangles = fates.kept;
        row.position_error = fates.position_error;
    }

    fn split(&mut self, split: bool, mesh_half_area: f32) -> TreeOptions {
        self.report.spatial_splits |= split;
        TreeOptions { split_budget: if split { SPLIT_BUDGET } else { 0.0 }, mesh_half_area }
    }
}

fn input<'a>(placed: &'a Placed, part_colours: &'a [Vec3]) -> TreeInput<'a> {
    let Placed { triangles, parts, prims, colours, .. } = placed;
    TreeInput { triangles, parts, prims, colours, part_colours }
}

/// With the counts of its tree, which has a root.
fn rooted(row: TreeRow, counts: &Counts) -> TreeRow {
    let Counts { depth, nodes, leaves, references } = *counts;
    TreeRow { root: build::root().into(), max_stack: 7 * depth + 1, nodes, leaves, references, ..row }
}

fn flat(Bounds { min, max }: &Bounds) -> [f32; 6] {
    [min.x, min.y, min.z, max.x, max.y, max.z]
}
