//! The passes from the collected meshes to a sealed file.

use super::BuildOptions;
use super::edges::Edges;
use super::mesh::Mesh;
use super::output::{Output, Span};
use super::part_sets::TreeParts;
use super::parts::{self, Assembly};
use super::patches::Patches;
use super::proxies::BlockRuns;
use super::report::{BuildReport, PhaseSeconds};
use super::shares::Shares;
use super::split::{self, Splitter};
use super::spool::Spool;
use super::surfaces::Surface;
use super::tight::Tight;
use super::values::Has;
use crate::base::error::Result;
use crate::base::groups::Groups;
use crate::base::inputs::Inputs;
use crate::base::memory::room;
use crate::base::progress::{Cancel, Phase, Progress, Stretch};
use crate::base::quota::Quota;
use crate::base::scratch::{Scratch, ScratchSpace};
use crate::import::UpAxis;
use crate::lod::SAMPLE_BYTES;
use crate::store::{Aside, Drops, Header, Options, PartSets, TreeRow, Writer};
use crate::structure::Par;
use crate::structure::bake::{BakeOp, Baker, with_baker};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// All input, checked.
pub struct Gathered {
    pub meshes: Vec<Spool>,
    /// Surfaces with trees of their own.
    pub surfaces: Vec<Surface>,
    /// Scratch file of parts of the meshes.
    pub spilled: Option<Scratch>,
    pub assembly: Assembly,
    pub triangles_in: u64,
    pub non_finite: u64,
    pub metres_per_unit: f64,
    pub up: UpAxis,
}

/// The request of the build.
pub struct Asked<'a> {
    pub options: &'a BuildOptions,
    pub shares: Shares,
    pub space: Arc<ScratchSpace>,
    pub out: &'a Path,
    pub inputs: Inputs,
    pub quota: Quota,
    pub progress: &'a Progress,
    pub cancel: &'a Cancel,
    /// Fraction of the progress before these passes.
    pub done: f64,
}

/// Fraction of the trees' progress after their triangles are placed.
const PLACED: f64 = 0.05;

/// Triangles that a face counts as in the progress.
const OF_FACE: f64 = 256.0;

/// Fraction of the progress after all trees.
const TREES_DONE: f64 = 0.94;

/// Fraction of the progress after the primitive ids.
const IDS_DONE: f64 = 0.98;

/// Builds the trees and writes the file.
pub fn run(mut gathered: Gathered, asked: &Asked, threads: usize) -> Result<BuildReport> {
    let begun = Instant::now();
    let par = Par { threads };
    let Asked { options, shares, space, out, inputs, quota, progress, cancel, done } = asked;
    progress.enter(Phase::Build);
    progress.advance(*done);
    let any = |has: fn(&Has) -> bool| gathered.meshes.iter().any(|m| has(&m.has));
    let given = Has { colours: any(|has| has.colours), normals: any(|has| has.normals) };
    // Normals are made unless the crease angle is negative. Surfaces have their own.
    let are_made = options.crease() >= 0.0 || !gathered.surfaces.is_empty();
    let has = Has { normals: given.normals || are_made, ..given };
    // Fails early if the folder cannot be written, or if the target is an input.
    let writer = Writer::guarded(out, inputs, quota)?;
    let mut meshes = std::mem::take(&mut gathered.meshes);
    if let Some(to) = &gathered.spilled {
        // Input that stays in memory would take memory that the trees need.
        for mesh in &mut meshes {
            cancel.check()?;
            mesh.spill(to, &par)?;
        }
    }
    meshes[0].local_parts = gathered.assembly.parts.len() as u32;
    gathered.assembly.edges = room(gathered.assembly.parts.len(), "the edges of parts")?;
    gathered.assembly.edges.resize(gathered.assembly.parts.len(), Edges::NONE);
    let triangles: u64 = meshes.iter().map(|m| m.triangles).sum();
    let placed = Span(*done, TREES_DONE).part(0.0, PLACED).1;
    let stretch = Stretch::new(progress, cancel, (*done, placed)).part(0.0, 1.0, triangles * split::PASSES);
    let splitter = Splitter { spilled: gathered.spilled.as_ref(), shares, par: &par, stretch: &stretch };
    let found = splitter.run(&mut meshes, &mut gathered.assembly)?;
    let seconds = PhaseSeconds { build: begun.elapsed().as_secs_f64(), ..PhaseSeconds::default() };
    let aside = || Aside::new(shares.aside, space);
    let mut output = Output {
        writer,
        prims: aside(),
        colours: aside(),
        normals: aside(),
        has,
        are_smooth: false,
        part_sets: PartSets::default(),
        tree_parts: TreeParts::default(),
        proxies: Vec::new(),
        runs: BlockRuns::default(),
        spilled: gathered.spilled.take(),
        trees_left: meshes.len(),
        space: space.clone(),
        shares: *shares,
        report: BuildReport {
            triangles_in: gathered.triangles_in,
            notes: found.notes(),
            seconds,
            ..BuildReport::default()
        },
        coarsened: None,
        progress,
        cancel,
        par,
    };
    let sizes: Vec<(u64, u32)> = meshes.iter().map(|m| (m.triangles, m.local_parts)).collect();
    gathered.assembly.tight = Tight::plan(&sizes, &gathered.assembly.instances, cancel)?;
    // The trees of surfaces follow those of triangles.
    let surfaces = std::mem::take(&mut gathered.surfaces);
    for (surface, tree) in surfaces.iter().zip(meshes.len() as u32..) {
        split::place(&mut gathered.assembly, surface.mesh, tree);
    }
    let trees = gathered.assembly.instances.iter().map(|i| i.tree);
    gathered.assembly.placings = Groups::of(meshes.len() + surfaces.len(), trees);
    let mut rows = Vec::new();
    let all: f64 = meshes.iter().map(|m| 1.0 + m.triangles as f64).sum::<f64>()
        + surfaces.iter().map(|surface| OF_FACE * f64::from(surface.shape.faces())).sum::<f64>();
    let mut before = 0.0;
    for (index, mut spool) in meshes.into_iter().enumerate() {
        spool.has.colours = has.colours;
        let size = 1.0 + spool.triangles as f64;
        let span = Span(placed, TREES_DONE).part(before / all, (before + size) / all);
        before += size;
        output.trees_left -= 1;
        let mesh = Mesh { output: &mut output, spool, options, index, assembly: &mut gathered.assembly, span };
        rows.push(mesh.build()?);
        output.end_tree_parts()?;
        progress.advance(span.1);
    }
    for surface in &surfaces {
        let index = rows.len();
        let size = OF_FACE * f64::from(surface.shape.faces());
        let span = Span(placed, TREES_DONE).part(before / all, (before + size) / all);
        before += size;
        let local_parts = sizes[surface.mesh as usize].1;
        let row = Patches { surface, options, index, local_parts, span }.build(&mut output, &mut gathered.assembly)?;
        output.report.triangles_in += row.triangles;
        rows.push(row);
        output.end_tree_parts()?;
        progress.advance(span.1);
    }
    gathered.assembly.flag_closed();
    seal(output, &gathered, &rows, options, begun)
}

fn seal(
    mut output: Output,
    gathered: &Gathered,
    trees: &[TreeRow],
    options: &BuildOptions,
    begun: Instant,
) -> Result<BuildReport> {
    let proxies = output.all_proxies()?;
    let Output { mut writer, prims, colours, normals, has, part_sets, mut report, space, progress, cancel, .. } =
        output;
    let has_normals = output.are_smooth;
    if let Some((moved, step)) = output.coarsened {
        report.notes.push(format!(
            "positions of large triangles moved by up to {moved:.2e} units, which is more than the input's digits \
             (multiples of {step}) allow: single precision holds no more of them"
        ));
    }
    if trees.iter().any(|tree| tree.local_parts > 1) {
        writer.set_part_sets(part_sets);
    }
    report.proxies = proxies.len() as u64;
    report.bytes_proxies = proxies.memory();
    writer.set_proxies(proxies);
    let geometry_blocks = writer.blocks_written();
    let before = writer.bytes_written();
    let ids = Span(TREES_DONE, IDS_DONE);
    prims.write_to(&mut writer, cancel, |done| progress.advance(ids.part(done, 1.0).0))?;
    report.bytes_ids = writer.bytes_written() - before;
    let last = Span(IDS_DONE, 1.0);
    colours.write_to(&mut writer, cancel, |done| progress.advance(last.part(done / 4.0, 1.0).0))?;
    let before = writer.bytes_written();
    if has_normals {
        normals.write_to(&mut writer, cancel, |done| progress.advance(last.part(0.25 + done / 4.0, 1.0).0))?;
    }
    report.bytes_normals = writer.bytes_written() - before;
    let Assembly { parts, materials, instances, .. } = &gathered.assembly;
    report.non_finite = gathered.non_finite;
    report.triangles_kept = trees.iter().map(|t| t.triangles).sum();
    report.references = trees.iter().map(|t| t.references).sum();
    report.nodes = trees.iter().map(|t| t.nodes).sum();
    report.leaves = trees.iter().map(|t| t.leaves).sum();
    report.blocks = u64::from(geometry_blocks);
    report.blocks_coarse = trees.iter().map(|t| u64::from(t.class_blocks[0])).sum();
    report.parts = parts.len() as u64;
    report.trees = trees.len() as u64;
    report.instances = instances.len() as u64;
    let header = Header {
        structure: options.structure as u32,
        metres_per_unit: gathered.metres_per_unit,
        up: gathered.up as u32,
        bounds: parts::model_bounds(parts),
        triangles_in: report.triangles_in,
        triangles_kept: report.triangles_kept,
        drops: Drops {
            non_finite: report.non_finite,
            degenerate: report.degenerate,
            out_of_range: report.out_of_range,
        },
        geometry_blocks,
        has_colours: has.colours,
        has_normals,
        options: Options {
            spatial_splits: report.spatial_splits,
            leaf_triangles: with_baker(options.structure, LeafTriangles),
            memory_budget: options.memory_budget,
            sample_bytes: SAMPLE_BYTES as u32,
        },
        ..Header::default()
    };
    cancel.check()?;
    writer.stop_with(cancel);
    progress.enter(Phase::Seal);
    report.bytes = writer.finish(&header, parts, materials, instances, trees)?;
    report.bytes_temporary = space.peak();
    let PhaseSeconds { distribute, build, .. } = report.seconds;
    let write = (begun.elapsed().as_secs_f64() - distribute - build).max(0.0);
    report.seconds = PhaseSeconds { read: 0.0, distribute, build, write };
    Ok(report)
}

/// Returns the maximum number of triangles of a leaf.
struct LeafTriangles;

impl BakeOp for LeafTriangles {
    type Out = u32;

    fn run<B: Baker>(self) -> u32 {
        B::LEAF_TRIANGLES
    }
}
