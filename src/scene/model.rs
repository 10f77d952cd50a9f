//! A model: one built file, opened read-only.

use super::appearances::Appearances;
use super::camera::{Camera, FOV_Y, axes, default_directions, default_views};
use super::context::{Context, LogLevel};
use super::fit::{Fit, Lens, MARGIN, fit_model};
use super::forms::{FormState, SMALL};
use super::part_check::PartCheck;
use super::parts::ModelParts;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::inside_read::refuse_inside_read;
use crate::base::progress::{Cancel, Phase, Progress};
use crate::base::units::UpAxis;
use crate::lod::SAMPLE_BYTES;
use crate::math::DBounds;
use crate::residency::{Kept, ModelBlocks, Needs, Snapshot};
use crate::store::contents::Kind;
use crate::store::directory::Row;
use crate::store::{FileSource, Header, InstanceRow, ModelFile, Outline, PartSets, Source, TreeRow};
use crate::structure::open::{self, Opened, StoredTree};
use crate::structure::{Tree, Visit};
use glam::{DAffine3, DMat3, DVec3};
use std::ops::Deref;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Properties of a model, from its header.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelInfo {
    /// The file, or a name for a source that has none.
    pub name: String,
    /// The name of its structure: "bvh".
    pub structure: &'static str,
    /// Number of triangles in the input.
    pub triangles_in: u64,
    /// Number of stored triangles, shared ones counted once.
    pub triangles_stored: u64,
    /// Number of visible triangles, shared ones counted once for each instance.
    pub triangles_placed: u64,
    /// Number of parts.
    pub parts: u32,
    /// Number of trees: one for the directly placed triangles, and one for each shared mesh.
    pub trees: u32,
    /// Number of placements in the model's own assembly.
    pub instances: u32,
    /// Number of blocks of geometry.
    pub geometry_blocks: u32,
    /// Bounds of everything; empty for a model without triangles.
    pub bounds: DBounds,
    /// Length unit, if known.
    pub metres_per_unit: Option<f64>,
    /// Up axis, if known.
    pub up: UpAxis,
    /// True if single triangles have colours.
    pub has_colours: bool,
    /// True if triangles may have normals at their corners that differ from their own.
    pub has_normals: bool,
    /// Number of proxies of subtrees, which give stand-ins their look.
    pub proxies: u64,
    /// Bytes of memory that the proxies take.
    pub proxy_bytes: u64,
    /// Bytes of the file.
    pub file_bytes: u64,
}

/// Memory that a model holds, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ModelMemory {
    /// Blocks in memory now, in trace form.
    pub resident: u64,
    /// All geometry blocks in trace form (nodes and triangles).
    pub geometry: u64,
    /// The form for exact rays, in addition to the blocks; 0 if there is none.
    pub resident_form: u64,
    /// Directory, parts and other tables.
    pub tables: u64,
}

/// An opened model; cloning is cheap and gives the same model. Thread-safe.
#[derive(Clone)]
pub struct Model(Arc<Inner>);

/// A model that may be gone.
pub(super) struct WeakModel(Weak<Inner>);

impl WeakModel {
    /// The model, if it is in use.
    pub fn upgrade(&self) -> Option<Model> {
        self.0.upgrade().map(Model)
    }
}

struct Inner {
    context: Context,
    info: ModelInfo,
    /// True if a part is transparent.
    see_through: bool,
    trees: Vec<StoredTree>,
    blocks: ModelBlocks,
    geometry_bytes: u64,
    /// The parts of blocks, once they were needed.
    part_sets: Mutex<Option<Arc<KeptSets>>>,
    form: FormState,
    appearances: Mutex<Appearances>,
}

/// The parts of blocks, and the charge for their memory.
pub(crate) struct KeptSets {
    sets: PartSets,
    _memory: Kept,
}

impl Deref for KeptSets {
    type Target = PartSets;

    fn deref(&self) -> &PartSets {
        &self.sets
    }
}

impl Model {
    /// Opens the built file at `path`. Reads the disk.
    ///
    /// The call reads tables and coarse blocks, and all blocks of a small model. Other blocks are read on use, or in
    /// the background, so a model may be larger than the budget. `OverBudget` means that not even its tables and roots
    /// fit in addition to the data that models in use must keep, and names the least sufficient budget. Otherwise fails
    /// with `Io`, `Corrupt` or `NewerFormat`. A damaged block that is not read yet fails the call that needs it.
    pub fn open(context: &Context, path: impl AsRef<Path>) -> Result<Self> {
        Self::open_source(context, Arc::new(FileSource::open(path)?))
    }

    /// Opens a built file with bytes from `source`. Fails like [`Model::open`].
    pub fn open_source(context: &Context, source: Arc<dyn Source>) -> Result<Self> {
        Self::open_watched(context, source, &Progress::default(), &Cancel::new())
    }

    /// [`Model::open_source`] under observation from other threads: progress counts the bytes of blocks, and a
    /// cancellation ends the call with `Cancelled` within the blocks being read.
    pub fn open_watched(
        context: &Context,
        source: Arc<dyn Source>,
        progress: &Progress,
        cancel: &Cancel,
    ) -> Result<Self> {
        Self::open_with(context, source, true, progress, cancel)
    }

    /// For tests: opens a model with no block in memory and without read-ahead, so that every ray needs missing blocks.
    #[doc(hidden)]
    pub fn open_cold(context: &Context, path: impl AsRef<Path>) -> Result<Self> {
        Self::open_cold_source(context, Arc::new(FileSource::open(path)?))
    }

    /// For tests: [`Model::open_cold`] with bytes from `source`.
    #[doc(hidden)]
    pub fn open_cold_source(context: &Context, source: Arc<dyn Source>) -> Result<Self> {
        Self::open_with(context, source, false, &Progress::default(), &Cancel::new())
    }

    fn open_with(
        context: &Context,
        source: Arc<dyn Source>,
        all: bool,
        progress: &Progress,
        cancel: &Cancel,
    ) -> Result<Self> {
        refuse_inside_read()?;
        progress.enter(Phase::Read);
        let outline = Outline::read(source)?;
        let header = *outline.header();
        if header.options.sample_bytes as usize != SAMPLE_BYTES {
            let why = format!("this version does not support samples of {} bytes", header.options.sample_bytes);
            return Err(Error::corrupt(outline.name(), None, why));
        }
        let residency = context.residency();
        let tables = outline.memory().saturating_add(open::bytes_for(outline.count(Kind::Trees)));
        let needs = Needs { tables, ..Needs::default() };
        // Tables that do not fit are not read, except for the error.
        let admission = residency.admit(outline.name(), needs, || needs_of(&outline, cancel), cancel)?;
        let file = Arc::new(outline.open(cancel)?);
        let Opened { decoder, mut trees } = open::open(&file)?;
        let geometry = (0..header.geometry_blocks).map(BlockId);
        let geometry_bytes = geometry.map(|b| u64::from(file.decoded_len(b))).sum();
        let log = context.clone();
        let again = move |why: &Error| log.log(LogLevel::Warning, &format!("{why}; the block is read again"));
        let starts: Vec<_> = trees.iter().filter_map(StoredTree::start).collect();
        let roots: Vec<BlockId> = starts.iter().map(|start| start.0).collect();
        let blocks = ModelBlocks::open_read(admission, Arc::clone(&file), decoder, &roots, again, cancel)?;
        starts.iter().try_for_each(|&(root, number)| blocks.expect_number(root, number))?;
        if all {
            blocks.fill(&first_blocks(&file, residency.budget()), context.pool(), progress, cancel)?;
            blocks.require(&roots, cancel)?;
            blocks.opened();
            let there = blocks.snapshot();
            trees.iter_mut().for_each(|tree| tree.look(&there));
        }
        let is_transparent = |material: u32| file.materials()[material as usize].opacity < 1.0;
        let see_through = file.parts().iter().any(|part| is_transparent(part.material));
        let info = info_of(&file, &header);
        let context = context.clone();
        let (part_sets, form, appearances) = (Mutex::default(), FormState::default(), Mutex::default());
        let model = Self(Arc::new(Inner {
            context,
            info,
            see_through,
            trees,
            blocks,
            geometry_bytes,
            part_sets,
            form,
            appearances,
        }));
        if all && model.info().triangles_stored <= SMALL && model.is_whole() {
            model.blocks().completed();
            model.begin_form();
        }
        Ok(model)
    }

    /// The context in which it was opened.
    pub fn context(&self) -> &Context {
        &self.0.context
    }

    /// Properties of the model.
    pub fn info(&self) -> &ModelInfo {
        &self.0.info
    }

    /// Its parts, in the file's order.
    pub fn parts(&self) -> ModelParts<'_> {
        ModelParts(self.0.blocks.file())
    }

    /// The index in [`Model::parts`] of the first part with this id.
    pub fn part_index(&self, id: u64) -> Option<u32> {
        self.0.blocks.file().parts().index_of(id)
    }

    /// Bytes that it holds in memory now.
    pub fn memory(&self) -> ModelMemory {
        let blocks = &self.0.blocks;
        ModelMemory {
            resident: blocks.resident_bytes(),
            geometry: self.0.geometry_bytes,
            resident_form: blocks.companion_bytes(),
            tables: blocks.table_bytes(),
        }
    }

    /// Reads all of its geometry into memory, with all workers of the context. Returns false if the budget does not
    /// hold it in addition to the data in use. Blocks. Data that is not used may be evicted later, when room is needed.
    /// Fails with `Io`, `Corrupt` or `Cancelled`.
    pub fn load(&self, cancel: &Cancel) -> Result<bool> {
        let blocks = &self.0.blocks;
        let all: Vec<BlockId> = (0..self.0.info.geometry_blocks).map(BlockId).collect();
        blocks.fill(&all, self.0.context.pool(), &Progress::default(), cancel)?;
        let is_all = self.is_whole();
        if is_all {
            blocks.completed();
            self.begin_form();
        }
        Ok(is_all)
    }

    /// True if all geometry is in memory.
    fn is_whole(&self) -> bool {
        let there = self.0.blocks.snapshot();
        (0..self.0.info.geometry_blocks).all(|id| there.block(BlockId(id)).is_some())
    }

    /// The appearances of its trees that were needed.
    pub(super) fn appearances(&self) -> MutexGuard<'_, Appearances> {
        self.0.appearances.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The state of the form for exact rays.
    pub(super) fn form_state(&self) -> &FormState {
        &self.0.form
    }

    /// Reads, decodes and validates all of its geometry and the links between its blocks, and compares the parts of
    /// blocks with them. Any budget holds the blocks; the lists of parts must fit it. Blocks. Fails with the error of
    /// the first faulty block, or with `OverBudget`.
    pub fn check(&self, cancel: &Cancel) -> Result<()> {
        let all: Vec<BlockId> = (0..self.0.info.geometry_blocks).map(BlockId).collect();
        self.load(cancel)?;
        let (there, sets) = (self.0.blocks.snapshot(), self.part_sets()?);
        let check = PartCheck::new(self, &sets);
        let (here, left): (Vec<_>, Vec<_>) = all.into_iter().partition(|&id| there.block(id).is_some());
        check.run(&here, &there, cancel)?;
        drop(there);
        // A lease holds at least four blocks.
        left.chunks(4).try_for_each(|few| {
            let mut lease = self.0.context.residency().lease();
            lease.fetch(&self.0.blocks, few, cancel)?;
            check.run(few, &*lease.snapshot(&self.0.blocks)?, cancel)
        })
    }

    /// Number of blocks that were read again because reading or checking had failed; the log says why.
    pub fn blocks_read_again(&self) -> u64 {
        self.0.blocks.read_again()
    }

    /// Four views from its bounds: two of the whole and two from a quarter of the distance. Z is up if the model does
    /// not define an up axis.
    pub fn views(&self) -> [Camera; 4] {
        self.views_with(self.0.info.up)
    }

    /// [`Model::views`] with another up axis.
    pub fn views_with(&self, up: UpAxis) -> [Camera; 4] {
        default_views(&self.0.info.bounds, up)
    }

    /// Four views for pictures of a size: 0 and 1 of the whole as large as the picture allows, from the directions of
    /// [`Model::views`], and 2 and 3 of those. Perspective cameras of 40°.
    pub fn fitted_views(&self, up: UpAxis, size: (u32, u32)) -> [Camera; 4] {
        let mut views = self.views_with(up);
        for (view, from) in views.iter_mut().zip(default_directions(up)) {
            let (lens, margin) = (Lens::Perspective(FOV_Y), MARGIN);
            let fit = Fit { direction: -from, up: axes(up)[2], lens, size, margin };
            *view = fit_model(self, &fit).unwrap_or(*view);
        }
        views
    }

    /// Returns the transform that gives the model an up axis and a unit: it turns the model's up axis to `up`, about
    /// the origin, and scales its units to units of `metres_per_unit` metres. Where the model does not say, its axis or
    /// unit counts as the requested one, and stays; `None` leaves them in any case.
    pub fn placement(&self, up: Option<UpAxis>, metres_per_unit: Option<f64>) -> Result<DAffine3> {
        let info = self.info();
        let turn = match (up, info.up) {
            (Some(to), from) if from != UpAxis::Unknown && to != UpAxis::Unknown => {
                let [to, from] = [to, from].map(|axis| DMat3::from_cols_array_2d(&axes(axis).map(|v| v.to_array())));
                to * from.transpose()
            }
            _ => DMat3::IDENTITY,
        };
        let scale = match (metres_per_unit, info.metres_per_unit) {
            (Some(to), _) if !(to.is_finite() && to > 0.0) => {
                return Err(Error::bad_argument(format!(
                    "placement: {to} metres per unit; it must be finite and above 0"
                )));
            }
            (Some(to), Some(from)) => from / to,
            _ => 1.0,
        };
        Ok(DAffine3 { matrix3: turn * scale, translation: DVec3::ZERO })
    }

    /// True if a part is transparent.
    pub(crate) fn see_through(&self) -> bool {
        self.0.see_through
    }

    /// The model without keeping it.
    pub(super) fn downgrade(&self) -> WeakModel {
        WeakModel(Arc::downgrade(&self.0))
    }

    /// True if both are the same opened model.
    pub fn same(&self, other: &Model) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// The placements of its own assembly.
    pub(crate) fn assembly(&self) -> &[InstanceRow] {
        self.0.blocks.file().instances()
    }

    /// Its trees with triangles, in the order in which a scene places them: the tree's index, the part that is its
    /// local part 0, and its placement in the model.
    pub(crate) fn placements(&self) -> impl Iterator<Item = (u32, u32, DAffine3)> {
        let direct = std::iter::once((0, 0, DAffine3::IDENTITY));
        let all = direct.chain(self.assembly().iter().map(|row| (row.tree, row.first_part, model_from_mesh(row))));
        all.filter(|(tree, ..)| self.0.trees.get(*tree as usize).is_some_and(|t| !t.bounds.is_empty()))
    }

    /// The parts of its blocks. The first call reads them and keeps them in memory. Fails with `OverBudget`, `Io`,
    /// `Corrupt`, or, if a source's read function calls it, `BadState`.
    pub(crate) fn part_sets(&self) -> Result<Arc<KeptSets>> {
        let held = || self.0.part_sets.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(sets) = &*held() {
            return Ok(Arc::clone(sets));
        }
        refuse_inside_read()?;
        // The lock is not held meanwhile: a source of the host may call the library.
        let file = self.0.blocks.file();
        let mut memory = self.0.context.residency().keep("the parts of blocks", file.part_sets_memory())?;
        // As with blocks: a disk or a network may have failed briefly.
        let sets = match file.part_sets() {
            Err(error @ (Error::Io { .. } | Error::Corrupt { .. })) => {
                self.0.context.log(LogLevel::Warning, &format!("{error}; the parts of blocks are read again"));
                file.part_sets()?
            }
            sets => sets?,
        };
        memory.shrink_to(sets.memory());
        let sets = Arc::new(KeptSets { sets, _memory: memory });
        Ok(Arc::clone(held().get_or_insert(sets)))
    }

    /// Number of parts that a tree may have triangles of.
    pub(crate) fn local_parts(&self, tree: u32) -> u32 {
        self.0.blocks.file().trees()[tree as usize].local_parts
    }

    pub(crate) fn trees(&self) -> &[StoredTree] {
        &self.0.trees
    }

    pub(crate) fn blocks(&self) -> &ModelBlocks {
        &self.0.blocks
    }

    /// Its tree `index` in `snapshot`.
    #[inline]
    pub(crate) fn tree_in<'a>(&'a self, index: u32, snapshot: &'a Snapshot, visit: Visit<'a>) -> Tree<'a> {
        let proxies = self.0.blocks.file().proxies();
        let visit = Visit { proxies: (!proxies.is_empty()).then_some(proxies), ..visit };
        self.0.trees[index as usize].view(snapshot, self.0.context.isa(), visit)
    }
}

/// Bytes of blocks that are read at opening: all blocks of a small model, otherwise the coarse ones nearest to the
/// roots.
const OPENING_BYTES: u64 = 48 << 20;

fn first_blocks(file: &ModelFile, budget: u64) -> Vec<BlockId> {
    let most = OPENING_BYTES.min(budget / 4);
    let bytes = |id: BlockId| u64::from(file.decoded_len(id));
    let all: Vec<BlockId> = (0..file.header().geometry_blocks).map(BlockId).collect();
    if all.iter().map(|&id| bytes(id)).sum::<u64>() <= most {
        return all;
    }
    let coarse = |t: &TreeRow| (0..t.class_blocks[0]).map(move |i| (i, t.first_block + i)).collect::<Vec<_>>();
    let mut by_depth: Vec<(u32, u32)> = file.trees().iter().flat_map(coarse).collect();
    by_depth.sort_unstable();
    let mut sum = 0;
    let fits = |&(depth, id): &(u32, u32)| {
        sum += bytes(BlockId(id));
        // The roots are read in any case.
        depth == 0 || sum <= most
    };
    by_depth.into_iter().take_while(fits).map(|(_, id)| BlockId(id)).collect()
}

fn model_from_mesh(row: &InstanceRow) -> DAffine3 {
    let m = &row.world_from_mesh;
    let column = |c: usize| DVec3::new(m[3 * c], m[3 * c + 1], m[3 * c + 2]);
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// The most rows of the directory and of the trees that are read only to name a budget. A directory of this length
/// takes some tenths of a second.
const MOST_ROWS: u64 = 4 << 20;

/// The needs of a model beside those of its tables, found without reading these into memory. If there are more than
/// [`MOST_ROWS`] rows, which a damaged file may claim, the result is a bound: each block is as large as blocks may be.
fn needs_of(outline: &Outline, cancel: &Cancel) -> Result<Needs> {
    let (blocks, geometry) = (outline.block_count(), outline.header().geometry_blocks);
    let trees = outline.count(Kind::Trees);
    if u64::from(blocks).saturating_add(trees) > MOST_ROWS {
        let mut blocks_read = Needs::default();
        blocks_read.pin(&Row::largest(outline.header().block_size));
        blocks_read.pinned = blocks_read.pinned.saturating_mul(trees.min(geometry.into()));
        return Ok(Needs::of_blocks(blocks, geometry, geometry).and(blocks_read));
    }
    let (mut blocks_read, mut entered) = (Needs::default(), 0);
    outline.for_each_block(cancel, |row, begins| {
        blocks_read.hold(row);
        if let Some(tree) = begins {
            blocks_read.pin(row);
            entered += open::entered_blocks(tree);
        }
    })?;
    Ok(Needs::of_blocks(blocks, geometry, entered).and(blocks_read))
}

#[inline]
pub(super) fn bounds_of(b: [f64; 6]) -> DBounds {
    DBounds { min: DVec3::new(b[0], b[1], b[2]), max: DVec3::new(b[3], b[4], b[5]) }
}

fn info_of(file: &ModelFile, header: &Header) -> ModelInfo {
    let (trees, instances) = (file.trees(), file.instances());
    let repeated = |i: &InstanceRow| trees.get(i.tree as usize).map_or(0, |t| t.triangles);
    let direct = trees.first().map_or(0, |t| t.triangles);
    ModelInfo {
        name: file.name().display().to_string(),
        structure: open::name(header.structure),
        triangles_in: header.triangles_in,
        triangles_stored: trees.iter().map(|t| t.triangles).sum(),
        triangles_placed: instances.iter().map(repeated).fold(direct, u64::saturating_add),
        parts: file.parts().len() as u32,
        trees: trees.len() as u32,
        instances: instances.len() as u32,
        geometry_blocks: header.geometry_blocks,
        bounds: bounds_of(header.bounds),
        metres_per_unit: (header.metres_per_unit > 0.0).then_some(header.metres_per_unit),
        up: match header.up {
            1 => UpAxis::X,
            2 => UpAxis::Y,
            3 => UpAxis::Z,
            _ => UpAxis::Unknown,
        },
        has_colours: header.has_colours,
        has_normals: header.has_normals,
        proxies: file.proxies().len() as u64,
        proxy_bytes: file.proxies().memory(),
        file_bytes: file.file_len(),
    }
}
