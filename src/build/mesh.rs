//! The build of one mesh: it is placed and built in one chunk or several, and its blocks are written.

use super::BuildOptions;
use super::batch::Batch;
use super::builder::asked_for_splits;
use super::distribute::{Bucket, Distributor};
use super::margins;
use super::normals::{self, Faces};
use super::origin::{self, FAR, Placed};
use super::output::{ClassAside, Output, Span};
use super::parts::{self, Assembly};
use super::spool::{Copies, Spool};
use super::survey::{self, Batches, OfPart};
use super::values::Has;
use crate::base::error::Result;
use crate::base::progress::{Cancel, Phase, Stretch};
use crate::base::scratch::Scratch;
use crate::math::Bounds;
use crate::store::TreeRow;
use crate::structure::Par;
use crate::structure::bake::{BakeOp, Baker, Counts, TreeInput, TreeOptions, with_baker};
use glam::{DVec3, Vec3, Vec4};
use std::borrow::Cow;
use std::time::Instant;

/// Maximum number of references that splits add, per triangle.
const SPLIT_BUDGET: f32 = 0.5;

/// A spooled mesh that is read without being consumed.
struct Waiting<'a> {
    spool: &'a Spool,
    from: Option<&'a Scratch>,
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
        self.spool.origin
    }
    fn bounds(&self) -> Bounds {
        let around = |p: DVec3| (p - self.spool.origin).as_vec3().clamp(Vec3::splat(-FAR), Vec3::splat(FAR));
        Bounds { min: around(self.spool.bounds.min), max: around(self.spool.bounds.max) }
    }
}

/// A mesh that is to be built and written as tree number `index`.
pub struct Mesh<'m, 'o> {
    pub output: &'m mut Output<'o>,
    pub spool: Spool,
    pub options: &'m BuildOptions,
    pub index: usize,
    pub assembly: &'m mut Assembly,
    pub span: Span,
}

impl Mesh<'_, '_> {
    /// Builds and writes the mesh. Returns its row of the file's tree table.
    pub fn build(self) -> Result<TreeRow> {
        with_baker(self.options.structure, self)
    }
}

impl BakeOp for Mesh<'_, '_> {
    type Out = Result<TreeRow>;

    fn run<B: Baker>(self) -> Result<TreeRow> {
        let Self { output, spool, options, index, assembly, span } = self;
        let row = TreeRow {
            first_block: output.writer.blocks_written(),
            root: B::root(),
            structure: options.structure.of_triangles() as u32,
            local_parts: spool.local_parts,
            ..TreeRow::EMPTY
        };
        if spool.is_spilled() && spool.triangles > output.shares.chunk {
            output.in_chunks::<B>(spool, options, index, assembly, row, span)
        } else {
            output.in_one::<B>(spool, options, index, assembly, row, span)
        }
    }
}

impl Output<'_> {
    fn in_one<B: Baker>(
        &mut self,
        mut spool: Spool,
        options: &BuildOptions,
        index: usize,
        assembly: &mut Assembly,
        mut row: TreeRow,
        span: Span,
    ) -> Result<TreeRow> {
        let begun = Instant::now();
        let (copies, moved, step) = (std::mem::take(&mut spool.copies), spool.moved, spool.step);
        let mut placed = origin::place(spool, self.spilled.as_ref(), &self.par, self.cancel)?;
        self.cancel.check()?;
        self.judged(&placed.fates.moved(moved), placed.origin, &copies, &mut row);
        self.coarsened(&row, step);
        let mut of_parts = parts::count(&placed, &self.par, self.cancel)?;
        placed.flat.iter().for_each(|(part, edges)| OfPart::flat(*edges).add_to(&mut of_parts, *part));
        let of_parts = parts::but(of_parts, &copies);
        let all = (&placed.triangles[..], &placed.parts[..]);
        assembly.tight.search(index, placed.origin, all, &self.par, self.cancel)?;
        assembly.add(index, placed.origin, &of_parts, self.cancel)?;
        if placed.triangles.is_empty() {
            return Ok(row);
        }
        self.report.chunks += 1;
        let split = asked_for_splits(options.splits).unwrap_or_else(|| B::splits_pay(&placed.triangles));
        let (par, cancel) = (self.par, self.cancel);
        let part_colours = assembly.colours(index, row.local_parts);
        let own = placed.triangles.len();
        let normals = make_normals(&mut placed, own, options, &par, cancel)?;
        let stretch = Stretch::new(self.progress, cancel, (span.part(0.05, 1.0).0, span.part(0.7, 1.0).0));
        let asked = TreeOptions { proxies: options.proxies(self.proxies.len()), ..self.split(split, 0.0) };
        let built = B::build(input(&placed, &normals, &part_colours), &asked, true, &par, &stretch)?;
        self.report.seconds.build += begun.elapsed().as_secs_f64();
        self.proxies.extend(built.proxies);
        let mut chunk = built.chunk;
        let plans = B::take_plans(&mut chunk);
        row.bounds = flat(&built.bounds);
        let span = span.part(0.7, 1.0);
        self.progress.advance(span.0);
        self.progress.enter(Phase::Write);
        let Some(top) = built.top else {
            (row.block_count, row.class_blocks[0]) = (1, 1);
            self.write_blocks(plans, |plan| B::encode(&chunk, plan), span)?;
            return Ok(counted::<B>(row, &built.counts));
        };
        let upper_tree = B::join(vec![top])?;
        self.coarse::<B>(&upper_tree, plans.len(), &mut row)?;
        self.write_blocks(plans, |plan| B::encode(&chunk, plan), span)?;
        Ok(row)
    }

    fn in_chunks<B: Baker>(
        &mut self,
        mut spool: Spool,
        options: &BuildOptions,
        index: usize,
        assembly: &mut Assembly,
        mut row: TreeRow,
        span: Span,
    ) -> Result<TreeRow> {
        let begun = Instant::now();
        let from = self.spilled.as_ref();
        let mesh = Waiting { spool: &spool, from };
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
        let margins = match buckets.len() > 1 && options.crease() >= 0.0 {
            true => margins::find(&distributor, &buckets)?,
            false => buckets.iter().map(|_| Bucket::empty()).collect(),
        };
        assembly.tight.search_batches(index, &mesh, &self.par, self.cancel)?;
        let origin = spool.origin;
        let mesh_half_area = spool.bounds.half_area() as f32;
        let (copies, moved, step) = (std::mem::take(&mut spool.copies), spool.moved, spool.step);
        let has = spool.has;
        drop(spool);
        if self.trees_left == 0 {
            self.spilled = None;
        }
        self.judged(&found.fates.moved(moved), origin, &copies, &mut row);
        self.coarsened(&row, step);
        assembly.add(index, origin, &parts::but(found.parts, &copies), self.cancel)?;
        let split = asked_for_splits(options.splits).unwrap_or_else(|| B::splits_pay(&found.samples));
        self.report.seconds.distribute += begun.elapsed().as_secs_f64();
        let part_colours = assembly.colours(index, row.local_parts);
        let mut aside: Vec<ClassAside> = (1..B::CLASSES).map(|_| self.aside()).collect();
        let (mut tops, mut bounds, mut done) = (Vec::new(), Bounds::EMPTY, 0);
        for (bucket, margin) in buckets.iter().zip(&margins) {
            let part = |done: u64| 0.25 + 0.7 * done as f64 / found.fates.kept as f64;
            let here = span.part(part(done), part(done + bucket.triangles));
            done += bucket.triangles;
            let source = Source { bucket, margin, from: &buckets_in, has, options };
            let (top, its_bounds) =
                self.chunk::<B>(source, &part_colours, (split, mesh_half_area), &mut aside, here)?;
            tops.push(top);
            bounds = bounds.union(its_bounds);
        }
        drop(buckets_in);
        if tops.is_empty() {
            return Ok(row);
        }
        self.progress.enter(Phase::Write);
        row.bounds = flat(&bounds);
        let upper_tree = B::join(tops)?;
        self.coarse::<B>(&upper_tree, aside.first().map_or(0, ClassAside::blocks), &mut row)?;
        let classes = aside.len() as f64;
        for (i, class) in aside.into_iter().enumerate() {
            let of_classes = span.part(0.95, 1.0);
            self.write_aside(class, of_classes.part(i as f64 / classes, (i + 1) as f64 / classes))?;
        }
        Ok(row)
    }

    /// Builds one of several chunks of a mesh.
    fn chunk<B: Baker>(
        &mut self,
        source: Source,
        part_colours: &[Vec4],
        (split, mesh_half_area): (bool, f32),
        aside: &mut [ClassAside],
        span: Span,
    ) -> Result<(B::Top, Bounds)> {
        let begun = Instant::now();
        let (par, cancel) = (self.par, self.cancel);
        let extents = [&source.bucket.extents[..], &source.margin.extents].concat();
        let mut placed = origin::load(&extents, source.from, source.has, &par, cancel)?;
        let own = source.bucket.triangles as usize;
        let normals = make_normals(&mut placed, own, source.options, &par, cancel)?;
        let stretch = Stretch::new(self.progress, cancel, (span.part(0.05, 1.0).0, span.part(0.7, 1.0).0));
        let proxies = source.options.proxies(self.proxies.len());
        let options = TreeOptions { proxies, ..self.split(split, mesh_half_area) };
        let built = B::build(input(&placed, &normals, part_colours), &options, false, &par, &stretch)?;
        self.proxies.extend(built.proxies);
        self.report.seconds.build += begun.elapsed().as_secs_f64();
        self.report.chunks += 1;
        let span = span.part(0.7, 1.0);
        self.progress.advance(span.0);
        let mut chunk = built.chunk;
        self.put_aside(B::take_plans(&mut chunk), |plan| B::encode(&chunk, plan), aside, span)?;
        let top = built.top.ok_or_else(|| crate::Error::Internal("a chunk was built as a whole tree".into()))?;
        Ok((top, built.bounds))
    }

    /// Writes the coarse blocks, and sets the numbers of blocks of each class in `row`. `plans`: number of plans of all
    /// chunks, each of which has a block of each class except the first.
    fn coarse<B: Baker>(&mut self, upper_tree: &B::UpperTree, plans: usize, row: &mut TreeRow) -> Result<()> {
        let coarse = B::coarse_blocks(upper_tree);
        row.class_blocks[..B::CLASSES].fill(plans as u32);
        row.class_blocks[0] = coarse as u32;
        row.block_count = row.class_blocks.iter().sum();
        *row = counted::<B>(*row, &B::counts(upper_tree));
        let (first, at) = (row.first_block, self.progress.fraction());
        self.write_blocks((0..coarse).collect(), |i| vec![B::encode_coarse(upper_tree, i, first)], Span(at, at))
    }

    fn judged(&mut self, fates: &origin::Fates, origin: DVec3, copies: &Copies, row: &mut TreeRow) {
        self.report.degenerate += fates.degenerate;
        self.report.out_of_range += fates.out_of_range;
        self.report.position_error = self.report.position_error.max(fates.position_error);
        row.origin = origin.to_array();
        row.triangles = fates.kept.saturating_sub(copies.values().map(|copies| copies.0).sum());
        row.position_error = fates.position_error;
    }

    /// Notes a tree whose corners moved by more than rounding to the input's own digits allows.
    fn coarsened(&mut self, row: &TreeRow, step: Option<f64>) {
        let Some(step) = step.filter(|step| row.position_error > 3f64.sqrt() / 2.0 * step) else { return };
        let worst = self.coarsened.map_or(0.0, |(error, _)| error);
        if row.position_error > worst {
            self.coarsened = Some((row.position_error, step));
        }
    }

    fn split(&mut self, split: bool, mesh_half_area: f32) -> TreeOptions {
        self.report.spatial_splits |= split;
        TreeOptions { split_budget: if split { SPLIT_BUDGET } else { 0.0 }, mesh_half_area, proxies: None }
    }
}

/// One of several chunks of a mesh, and the triangles around it.
struct Source<'a> {
    bucket: &'a Bucket,
    margin: &'a Bucket,
    from: &'a Scratch,
    has: Has,
    options: &'a BuildOptions,
}

/// Makes the normals of the first `own` triangles, and drops those behind them.
fn make_normals(
    placed: &mut Placed,
    own: usize,
    options: &BuildOptions,
    par: &Par,
    cancel: &Cancel,
) -> Result<Vec<[u32; 3]>> {
    let faces = Faces { triangles: &placed.triangles, prims: &placed.prims, given: &placed.values.normals, own };
    let made = normals::make(&faces, options.crease(), par, cancel)?;
    placed.triangles.truncate(own);
    placed.parts.truncate(own);
    placed.prims.truncate(own);
    placed.values.colours.truncate(own);
    placed.values.normals = Vec::new();
    Ok(made)
}

fn input<'a>(placed: &'a Placed, normals: &'a [[u32; 3]], part_colours: &'a [Vec4]) -> TreeInput<'a> {
    let Placed { triangles, parts, prims, values, .. } = placed;
    TreeInput { triangles, parts, prims, colours: &values.colours, normals, part_colours }
}

/// Returns the row with the counts of its tree.
fn counted<B: Baker>(row: TreeRow, counts: &Counts) -> TreeRow {
    let Counts { depth, nodes, leaves, references } = *counts;
    TreeRow { max_stack: B::max_stack(depth), nodes, leaves, references, ..row }
}

fn flat(Bounds { min, max }: &Bounds) -> [f32; 6] {
    [min.x, min.y, min.z, max.x, max.y, max.z]
}
