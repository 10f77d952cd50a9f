//! Trees, blocks, tables: the passes from gathered meshes to a sealed file.

use super::builder::asked_for_splits;
use super::origin::{self, Placed};
use super::report::{BuildReport, PhaseSeconds};
use super::spool::Spool;
use super::BuildOptions;
use crate::base::error::Result;
use crate::base::progress::{Cancel, Phase, Progress};
use crate::import::UpAxis;
use crate::lod::SAMPLE_BYTES;
use crate::math::{Bounds, DBounds};
use crate::store::{
    Drops, EncodedBlock, Header, InstanceRow, MaterialRow, Options, PartRow, TreeRow, Writer, sections,
};
use crate::structure::bvh::build::{Par, Tree, TreeInput, TreeOptions, splits_pay};
use crate::structure::bvh::codec;
use crate::structure::bvh::layout::MAX_TRIANGLES;
use crate::structure::bvh::trace::TreeView;
use glam::{DAffine3, DVec3, Vec3};
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// All input, checked.
pub struct Gathered {
    pub meshes: Vec<Spool>,
    pub parts: Vec<PartRow>,
    pub materials: Vec<MaterialRow>,
    pub instances: Vec<InstanceRow>,
    pub triangles_in: u64,
    pub non_finite: u64,
    pub metres_per_unit: f64,
    pub up: UpAxis,
}

/// Blocks encoded before they are written together.
const BATCH: usize = 64;

/// Share of splitting: references added, at most, for each triangle.
const SPLIT_BUDGET: f32 = 1.0;

struct Output<'a> {
    writer: Writer,
    beside: Vec<EncodedBlock>,
    colours: Vec<EncodedBlock>,
    report: BuildReport,
    progress: &'a Progress,
    cancel: &'a Cancel,
    par: Par,
}

/// Builds and writes everything.
pub fn run(
    mut gathered: Gathered,
    options: &BuildOptions,
    threads: usize,
    out: &Path,
    progress: &Progress,
    cancel: &Cancel,
    done: f64,
) -> Result<BuildReport> {
    let begun = Instant::now();
    let par = Par { threads };
    progress.enter(Phase::Build);
    progress.advance(done);
    let has_colours = gathered.meshes.iter().any(|m| m.has_colours);
    // Fails early where the folder cannot be written.
    let writer = Writer::create(out)?;
    let report = BuildReport { triangles_in: gathered.triangles_in, ..BuildReport::default() };
    let (beside, colours) = (Vec::new(), Vec::new());
    let mut output = Output { writer, beside, colours, report, progress, cancel, par };
    let mut rows = Vec::new();
    let meshes = std::mem::take(&mut gathered.meshes);
    let count = meshes.len();
    for (index, mut spool) in meshes.into_iter().enumerate() {
        spool.has_colours = has_colours;
        if index == 0 {
            spool.local_parts = gathered.parts.len() as u32;
        }
        let (low, high) = (index as f64 / count as f64, (index + 1) as f64 / count as f64);
        let span = (done + (0.98 - done) * low, done + (0.98 - done) * high);
        let row = output.tree(spool, options, index, &mut gathered, span)?;
        rows.push(row);
    }
    output.seal(&gathered, rows, has_colours, options, begun)
}

impl Output<'_> {
    /// One mesh: placed, built, encoded, written.
    fn tree(
        &mut self,
        spool: Spool,
        options: &BuildOptions,
        index: usize,
        gathered: &mut Gathered,
        span: (f64, f64),
    ) -> Result<TreeRow> {
        let begun = Instant::now();
        let local_parts = spool.local_parts;
        let placed = origin::place(spool, &self.par, self.cancel)?;
        self.cancel.check()?;
        self.report.degenerate += placed.degenerate;
        self.report.out_of_range += placed.out_of_range;
        self.report.position_error = self.report.position_error.max(placed.position_error);
        part_bounds(&placed, index, local_parts, gathered);
        let mut row = TreeRow {
            first_block: self.writer.blocks_written(),
            block_count: 0,
            coarse_blocks: 0,
            root: u64::from(TreeView::EMPTY),
            origin: placed.origin.to_array(),
            bounds: sections::EMPTY_BOUNDS_F32,
            triangles: placed.triangles.len() as u64,
            references: 0,
            nodes: 0,
            leaves: 0,
            position_error: placed.position_error,
            local_parts,
            max_stack: 0,
        };
        if placed.triangles.is_empty() {
            return Ok(row);
        }
        let split = asked_for_splits(options.splits).unwrap_or_else(|| splits_pay(&placed.triangles));
        self.report.spatial_splits |= split;
        let input = TreeInput {
            triangles: &placed.triangles,
            parts: &placed.parts,
            prims: &placed.prims,
            colours: &placed.colours,
            part_colours: &part_colours(index, local_parts, gathered),
        };
        let tree_options = TreeOptions { split_budget: if split { SPLIT_BUDGET } else { 0.0 } };
        let tree = Tree::build(input, &tree_options, &self.par, self.cancel)?;
        self.report.seconds.build += begun.elapsed().as_secs_f64();
        self.progress.advance(span.0 + 0.7 * (span.1 - span.0));
        row.block_count = tree.blocks() as u32;
        row.coarse_blocks = tree.coarse_blocks() as u32;
        row.root = u64::from(tree.root);
        let Bounds { min, max } = tree.bounds;
        row.bounds = [min.x, min.y, min.z, max.x, max.y, max.z];
        row.references = tree.references();
        (row.nodes, row.leaves) = (tree.nodes, tree.leaves);
        row.max_stack = 7 * tree.depth + 1;
        let has_colours = !placed.colours.is_empty();
        self.blocks(&tree, row.first_block, has_colours, (span.0 + 0.7 * (span.1 - span.0), span.1))?;
        Ok(row)
    }

    fn blocks(&mut self, tree: &Tree, first: u32, has_colours: bool, span: (f64, f64)) -> Result<()> {
        self.progress.enter(Phase::Write);
        let count = tree.blocks();
        let par = self.par;
        let batch = |from: usize| {
            let size = BATCH.min(count.saturating_sub(from));
            par.map(size, |i| encode(tree, from + i, first, has_colours))
        };
        let mut ready = batch(0);
        for from in (0..count).step_by(BATCH) {
            self.cancel.check()?;
            let done = (from + ready.len()) as f64 / count as f64;
            // One batch is written while the next is encoded.
            let (next, written) = par.join(|| batch(from + BATCH), || self.write(ready));
            written?;
            ready = next;
            self.progress.advance(span.0 + (span.1 - span.0) * done);
        }
        Ok(())
    }

    fn write(&mut self, batch: Vec<Encoded>) -> Result<()> {
        for block in batch {
            self.report.bytes_trace += u64::from(block.trace_bytes);
            self.writer.encoded_block(block.geometry)?;
            self.beside.push(block.prims);
            self.colours.extend(block.colours);
        }
        self.progress.bytes_written.store(self.writer.bytes_written(), Relaxed);
        Ok(())
    }

    fn seal(
        mut self,
        gathered: &Gathered,
        trees: Vec<TreeRow>,
        has_colours: bool,
        options: &BuildOptions,
        begun: Instant,
    ) -> Result<BuildReport> {
        let geometry_blocks = self.writer.blocks_written();
        let before = self.writer.bytes_written();
        for block in std::mem::take(&mut self.beside) {
            self.writer.encoded_block(block)?;
        }
        self.report.bytes_ids = self.writer.bytes_written() - before;
        for block in std::mem::take(&mut self.colours) {
            self.cancel.check()?;
            self.writer.encoded_block(block)?;
        }
        let report = &mut self.report;
        report.non_finite = gathered.non_finite;
        report.triangles_kept = trees.iter().map(|t| t.triangles).sum();
        report.references = trees.iter().map(|t| t.references).sum();
        report.nodes = trees.iter().map(|t| t.nodes).sum();
        report.leaves = trees.iter().map(|t| t.leaves).sum();
        report.blocks = u64::from(geometry_blocks);
        report.parts = gathered.parts.len() as u64;
        report.trees = trees.len() as u64;
        report.instances = gathered.instances.len() as u64;
        let header = Header {
            metres_per_unit: gathered.metres_per_unit,
            up: gathered.up as u32,
            bounds: flat(&model_bounds(&trees, &gathered.instances)),
            triangles_in: report.triangles_in,
            triangles_kept: report.triangles_kept,
            drops: Drops {
                non_finite: report.non_finite,
                degenerate: report.degenerate,
                out_of_range: report.out_of_range,
            },
            geometry_blocks,
            has_colours,
            options: Options {
                spatial_splits: report.spatial_splits,
                leaf_triangles: MAX_TRIANGLES as u32,
                memory_budget: options.memory_budget,
                sample_bytes: SAMPLE_BYTES as u32,
            },
            ..Header::default()
        };
        self.cancel.check()?;
        self.progress.enter(Phase::Seal);
        let Gathered { parts, materials, instances, .. } = gathered;
        let bytes = self.writer.finish(&header, parts, materials, instances, &trees)?;
        let build = self.report.seconds.build;
        let write = (begun.elapsed().as_secs_f64() - build).max(0.0);
        Ok(BuildReport { bytes, seconds: PhaseSeconds { read: 0.0, build, write }, ..self.report })
    }
}

struct Encoded {
    geometry: EncodedBlock,
    prims: EncodedBlock,
    colours: Option<EncodedBlock>,
    trace_bytes: u32,
}

fn encode(tree: &Tree, index: usize, first: u32, has_colours: bool) -> Encoded {
    let block = tree.encode(index, first);
    let trace_bytes = 4 * block.words.len() as u32;
    let beside = 4 * block.prims.len() as u32;
    // Also for a block of nodes alone: each geometry block has one of colours, or the ids do not fit.
    let colours = has_colours.then(|| codec::encode_colours(&block.colours));
    Encoded {
        geometry: EncodedBlock::encode(&codec::encode_geometry(&block.words), trace_bytes),
        prims: EncodedBlock::encode(&codec::encode_prims(&block.prims), beside),
        colours: colours.map(|c| EncodedBlock::encode(&c, beside)),
        trace_bytes,
    }
}

/// Brings bounds and counts of the parts up to date with one mesh.
fn part_bounds(placed: &Placed, tree: usize, local_parts: u32, gathered: &mut Gathered) {
    let mut bounds = vec![Bounds::EMPTY; local_parts as usize];
    let mut counts = vec![0u64; local_parts as usize];
    for (triangle, &part) in placed.triangles.iter().zip(&placed.parts) {
        let b = &mut bounds[part as usize];
        *b = triangle.iter().fold(*b, |b, &p| b.with(p));
        counts[part as usize] += 1;
    }
    let mut add = |first: u32, world_from_mesh: &DAffine3| {
        for (i, (b, count)) in bounds.iter().zip(&counts).enumerate().filter(|(_, (_, c))| **c > 0) {
            let row = &mut gathered.parts[first as usize + i];
            let local = DBounds { min: b.min.as_dvec3() + placed.origin, max: b.max.as_dvec3() + placed.origin };
            row.bounds = flat(&unflat(&row.bounds).union(local.transformed(world_from_mesh)));
            row.triangles += count;
        }
    };
    if tree == 0 {
        add(0, &DAffine3::IDENTITY);
        return;
    }
    for instance in gathered.instances.iter().filter(|i| i.tree as usize == tree) {
        add(instance.first_part, &DAffine3::from_cols_array(&instance.world_from_mesh));
    }
}

/// Linear colours of a mesh's local parts, as where it is placed first.
fn part_colours(tree: usize, local_parts: u32, gathered: &Gathered) -> Vec<Vec3> {
    let placing = gathered.instances.iter().find(|i| i.tree as usize == tree);
    let first = placing.map_or(0, |i| i.first_part) as usize;
    let rows = gathered.parts.iter().skip(first).take(local_parts as usize);
    rows.map(|row| Vec3::from(gathered.materials[row.material as usize].colour)).collect()
}

/// Bounds of all that is placed.
fn model_bounds(trees: &[TreeRow], instances: &[InstanceRow]) -> DBounds {
    let of_tree = |t: &TreeRow| {
        let [a, b, c, d, e, f] = t.bounds.map(f64::from);
        let origin = DVec3::from_array(t.origin);
        DBounds { min: DVec3::new(a, b, c) + origin, max: DVec3::new(d, e, f) + origin }
    };
    let direct = trees.first().map_or(DBounds::EMPTY, of_tree);
    instances.iter().fold(direct, |all, i| {
        let m = DAffine3::from_cols_array(&i.world_from_mesh);
        all.union(of_tree(&trees[i.tree as usize]).transformed(&m))
    })
}

fn flat(b: &DBounds) -> [f64; 6] {
    [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z]
}

fn unflat(b: &[f64; 6]) -> DBounds {
    DBounds { min: DVec3::new(b[0], b[1], b[2]), max: DVec3::new(b[3], b[4], b[5]) }
}
