//! Blocks on their way to the file: encoded in parallel, in batches; a batch is written while the next is encoded.

use super::part_sets::{BlockParts, TreeParts};
use super::proxies::BlockRuns;
use super::report::BuildReport;
use super::shares::Shares;
use super::values::Has;
use crate::base::error::Result;
use crate::base::progress::{Cancel, Progress};
use crate::base::scratch::{Scratch, ScratchSpace};
use crate::store::{Aside, EncodedBlock, PartSets, Writer};
use crate::structure::bake::{BakedBlock, BakedProxy};
use crate::structure::{Par, streams};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

/// Number of items whose blocks are encoded before they are written.
const BATCH: usize = 64;

/// The file that is being written, and the state that all passes share.
pub struct Output<'a> {
    pub writer: Writer,
    /// Blocks of primitive ids, for all geometry blocks written so far.
    pub prims: Aside,
    /// Blocks of colours and of normals, likewise.
    pub colours: Aside,
    pub normals: Aside,
    /// The streams that are kept.
    pub has: Has,
    /// True if any block has normals other than those of its triangles.
    pub are_smooth: bool,
    /// Parts of all geometry blocks of the trees before the present one, and of the present one.
    pub part_sets: PartSets,
    pub tree_parts: TreeParts,
    /// All proxies, and the nodes of the blocks written so far that show them.
    pub proxies: Vec<BakedProxy>,
    pub runs: BlockRuns,
    /// Scratch file of the spilled input.
    pub spilled: Option<Scratch>,
    /// Number of trees that follow the present one.
    pub trees_left: usize,
    pub space: Arc<ScratchSpace>,
    pub shares: Shares,
    pub report: BuildReport,
    /// The greatest distance by which rounding moved a corner beyond the input's own digits, and their step.
    pub coarsened: Option<(f64, f64)>,
    pub progress: &'a Progress,
    pub cancel: &'a Cancel,
    pub par: Par,
}

/// An interval of the progress of the whole build: from one fraction to another.
#[derive(Debug, Clone, Copy)]
pub struct Span(pub f64, pub f64);

impl Span {
    /// Returns the part of the interval between two fractions of it.
    pub fn part(self, from: f64, to: f64) -> Self {
        let at = |f: f64| self.0 + (self.1 - self.0) * f.clamp(0.0, 1.0);
        Self(at(from), at(to))
    }
}

struct Encoded {
    geometry: EncodedBlock,
    prims: EncodedBlock,
    colours: Option<EncodedBlock>,
    normals: Option<EncodedBlock>,
    is_smooth: bool,
    parts: BlockParts,
    proxies: Vec<(u16, u32)>,
    trace_bytes: u32,
}

/// Blocks of one class of a tree. They are kept because all of them come behind the blocks of earlier classes.
pub struct ClassAside {
    geometry: Aside,
    prims: Aside,
    colours: Aside,
    normals: Aside,
    is_smooth: bool,
    parts: TreeParts,
    runs: BlockRuns,
}

impl ClassAside {
    /// Number of geometry blocks.
    pub fn blocks(&self) -> usize {
        self.geometry.len()
    }

    fn push(&mut self, block: Encoded, report: &mut BuildReport) -> Result<()> {
        report.bytes_trace += u64::from(block.trace_bytes);
        self.parts.push(block.parts)?;
        self.runs.push(&block.proxies);
        self.geometry.push(block.geometry)?;
        self.prims.push(block.prims)?;
        self.is_smooth |= block.is_smooth;
        block.normals.map_or(Ok(()), |n| self.normals.push(n))?;
        block.colours.map_or(Ok(()), |c| self.colours.push(c))
    }
}

impl Output<'_> {
    /// Returns an empty store for the blocks of one class.
    pub fn aside(&self) -> ClassAside {
        let aside = || Aside::new(self.shares.aside, &self.space);
        ClassAside {
            geometry: aside(),
            prims: aside(),
            colours: aside(),
            normals: aside(),
            is_smooth: false,
            parts: TreeParts::default(),
            runs: BlockRuns::default(),
        }
    }

    /// Encodes the blocks of each item of `all`. Writes the first block of each item, and behind all of these the other
    /// blocks, class by class.
    pub fn write_blocks<P: Send>(
        &mut self,
        all: Vec<P>,
        blocks: impl Fn(P) -> Vec<BakedBlock> + Sync,
        span: Span,
    ) -> Result<()> {
        let mut later: Vec<ClassAside> = Vec::new();
        let (has, par, progress, cancel) = (self.has, self.par, self.progress, self.cancel);
        each_batch(
            all,
            &par,
            cancel,
            |one| encode(blocks(one), has),
            |encoded, done| {
                for (class, block) in encoded.into_iter().enumerate() {
                    if class > later.len() {
                        later.push(self.aside());
                    }
                    match class.checked_sub(1) {
                        Some(class) => later[class].push(block, &mut self.report)?,
                        None => self.write(block)?,
                    }
                }
                progress.bytes_written.store(self.writer.bytes_written(), Relaxed);
                progress.advance(span.part(done, 1.0).0);
                Ok(())
            },
        )?;
        later.into_iter().try_for_each(|class| self.write_aside(class, Span(span.1, span.1)))
    }

    fn write(&mut self, block: Encoded) -> Result<()> {
        self.report.bytes_trace += u64::from(block.trace_bytes);
        self.tree_parts.push(block.parts)?;
        self.runs.push(&block.proxies);
        self.writer.encoded_block(block.geometry)?;
        self.prims.push(block.prims)?;
        self.are_smooth |= block.is_smooth;
        block.normals.map_or(Ok(()), |n| self.normals.push(n))?;
        block.colours.map_or(Ok(()), |c| self.colours.push(c))
    }

    /// Encodes the blocks of each item of `all`, and keeps them by class.
    pub fn put_aside<P: Send>(
        &mut self,
        all: Vec<P>,
        blocks: impl Fn(P) -> Vec<BakedBlock> + Sync,
        classes: &mut [ClassAside],
        span: Span,
    ) -> Result<()> {
        let (has, par, progress, cancel) = (self.has, self.par, self.progress, self.cancel);
        each_batch(
            all,
            &par,
            cancel,
            |one| encode(blocks(one), has),
            |encoded, done| {
                classes.iter_mut().zip(encoded).try_for_each(|(class, block)| class.push(block, &mut self.report))?;
                progress.advance(span.part(done, 1.0).0);
                Ok(())
            },
        )
    }

    /// Writes the blocks of a class.
    pub fn write_aside(&mut self, aside: ClassAside, span: Span) -> Result<()> {
        let progress = self.progress;
        self.tree_parts.append(aside.parts)?;
        self.runs.append(aside.runs);
        aside.geometry.write_to(&mut self.writer, self.cancel, |done| progress.advance(span.part(done, 1.0).0))?;
        self.progress.bytes_written.store(self.writer.bytes_written(), Relaxed);
        self.prims.append(aside.prims)?;
        self.are_smooth |= aside.is_smooth;
        self.normals.append(aside.normals)?;
        self.colours.append(aside.colours)
    }
}

/// Applies `make` to the items of `all` in parallel and `take` to the results in order, for each batch while the next
/// is made. `take` also receives the fraction of results so far.
fn each_batch<P: Send, T: Send>(
    all: Vec<P>,
    par: &Par,
    cancel: &Cancel,
    make: impl Fn(P) -> T + Sync + Send,
    mut take: impl FnMut(T, f64) -> Result<()> + Send,
) -> Result<()> {
    let (count, mut all) = (all.len(), all.into_iter());
    let mut batch = || par.map_items(all.by_ref().take(BATCH).collect(), &make);
    let mut ready = batch();
    for from in (0..count).step_by(BATCH) {
        cancel.check()?;
        let done = |i: usize| (from + i + 1) as f64 / count as f64;
        let mut take_all = || ready.drain(..).enumerate().try_for_each(|(i, made)| take(made, done(i)));
        let (next, taken) = par.join(&mut batch, &mut take_all);
        taken?;
        ready = next;
    }
    Ok(())
}

fn encode(blocks: Vec<BakedBlock>, has: Has) -> Vec<Encoded> {
    let one = |block: BakedBlock| {
        let beside = 4 * block.prims.len() as u32;
        // A block without triangles also gets blocks of colours and normals, because their ids are derived from that of
        // the geometry block.
        let colours = has.colours.then(|| streams::encode_colours(&block.colours));
        let is_smooth = block.normals.iter().any(|word| *word != 0);
        let normals = if is_smooth { &block.normals[..] } else { &[0] };
        let normals =
            has.normals.then(|| EncodedBlock::encode(&streams::encode_normals(normals), 4 * normals.len() as u32));
        Encoded {
            geometry: EncodedBlock::encode(&block.payload, block.trace_bytes),
            prims: EncodedBlock::encode(&streams::encode_prims(&block.prims), beside),
            colours: colours.map(|(payload, words)| EncodedBlock::encode(&payload, 4 * words as u32)),
            normals,
            is_smooth,
            parts: BlockParts { own: block.parts, below: block.below },
            proxies: block.proxies,
            trace_bytes: block.trace_bytes,
        }
    };
    blocks.into_iter().map(one).collect()
}
