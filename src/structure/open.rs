//! Opens the trees of a file, and makes the decoder that residency uses.

use super::Structure;
#[cfg(any(test, feature = "brute"))]
use super::brute;
use super::bvh;
use super::by_tree::ByTree;
use super::hit::Triangle;
use super::nodes::{LeafTriangle, Node, Starts};
use super::patch;
use super::place::Place;
use super::resident::Forms;
use super::tree::{Blocks, Tree, Visit};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::memory::room;
use crate::math::{Bounds, DBounds};
use crate::residency::{Decoder, Snapshot};
use crate::simd::Isa;
use crate::store::{ModelFile, TreeRow};
use glam::DVec3;

/// Everything that tracing in a file needs.
pub struct Opened {
    /// Decoder of the file's blocks.
    pub decoder: Box<dyn Decoder>,
    /// Trees of the file, in the order of the file's table.
    pub trees: Vec<StoredTree>,
}

/// A tree of a file.
#[derive(Debug, Clone, Copy)]
pub struct StoredTree {
    start: Start,
    /// Index of the tree in the file's table.
    index: u32,
    /// Origin of the tree's own frame, in mesh coordinates.
    pub origin: DVec3,
    /// Bounds in the tree's own frame; empty for an empty tree.
    pub bounds: DBounds,
    /// Greatest magnitude of a coordinate in the tree's own frame, above 0.
    pub max_coord: f32,
    /// Greatest distance between a stored vertex and the input vertex, in the tree's units.
    pub position_error: f64,
    /// Bounds of everything that rays can hit, stand-ins included, in the tree's own frame; `None` until
    /// [`StoredTree::look`] has read the root.
    pub around_hits: Option<Bounds>,
    /// The local part with the greatest visible area; 0 until [`StoredTree::look`] has read the root.
    pub main_part: u32,
}

/// Start of a tree, for each structure.
#[derive(Debug, Clone, Copy)]
enum Start {
    Bvh(bvh::open::Start),
    Patch(patch::open::Start),
    #[cfg(any(test, feature = "brute"))]
    Brute(brute::open::Start),
}

/// Opens the trees of a file. Fails with `Corrupt` if this version does not know the structure of a tree, or if a
/// tree's row contradicts itself.
pub fn open(file: &ModelFile) -> Result<Opened> {
    let decoder = decoder(file)?;
    let start = |index: u32, row: &TreeRow| {
        let start = match structure_of(file, row)? {
            Structure::Bvh => bvh::open::Start::of(file, row).map(Start::Bvh),
            Structure::Patch => patch::open::Start::of(file, row).map(Start::Patch),
            #[cfg(any(test, feature = "brute"))]
            Structure::Brute => brute::open::Start::of(file, row).map(Start::Brute),
        };
        start
            .map(|start| stored(row, start, index))
            .map_err(|why| Error::corrupt(file.name(), Some(row.first_block), why))
    };
    let mut trees = room(file.trees().len(), "the trees of a model")?;
    (0..).zip(file.trees()).try_for_each(|(index, row)| start(index, row).map(|tree| trees.push(tree)))?;
    Ok(Opened { decoder, trees })
}

/// Returns the decoder of a file: that of its trees' structure if they have one, or one that asks for each block the
/// decoder of its tree's structure.
fn decoder(file: &ModelFile) -> Result<Box<dyn Decoder>> {
    let (header, trees) = (file.header(), file.trees());
    let decoder = |structure: Structure| -> Box<dyn Decoder> {
        match structure {
            Structure::Bvh => Box::new(bvh::BvhDecoder::new(header, trees)),
            Structure::Patch => Box::new(patch::PatchDecoder::new(header, trees)),
            #[cfg(any(test, feature = "brute"))]
            Structure::Brute => Box::new(brute::BruteDecoder::new(header, trees)),
        }
    };
    let mut there: Vec<Structure> = Vec::with_capacity(Structure::ALL.len());
    for tree in trees {
        let structure = structure_of(file, tree)?;
        if !there.contains(&structure) {
            there.push(structure);
        }
    }
    Ok(match there[..] {
        // A file without trees has no blocks.
        [] => decoder(Structure::default()),
        [only] => decoder(only),
        _ => {
            let decoders = there.iter().map(|&structure| (structure as u32, decoder(structure))).collect();
            Box::new(ByTree::new(header, trees, decoders)?)
        }
    })
}

/// Bytes of memory for `trees` opened trees, those of the decoders included.
pub fn bytes_for(trees: u64) -> u64 {
    let own = bvh::BvhDecoder::BYTES_A_TREE.max(patch::PatchDecoder::BYTES_A_TREE);
    let of_decoders = own + ByTree::BYTES_A_TREE;
    trees.saturating_mul((size_of::<StoredTree>() + of_decoders) as u64)
}

/// Number of blocks of a tree that other blocks may refer to.
pub fn entered_blocks(tree: &TreeRow) -> u32 {
    match Structure::from_number(tree.structure) {
        Some(Structure::Bvh) => bvh::entered_blocks(tree),
        Some(Structure::Patch) => patch::entered_blocks(tree),
        _ => 0,
    }
}

/// Checks references between the blocks of a file, which no block can check by itself. Skips blocks that are not in
/// memory. Fails with the block and the fault.
pub fn check_links(file: &ModelFile, snapshot: &Snapshot) -> std::result::Result<(), (BlockId, String)> {
    // No block refers to a block of another tree: decoders refuse that.
    file.trees().iter().try_for_each(|tree| match structure_of(file, tree) {
        Ok(Structure::Bvh) => bvh::check_links(snapshot, std::slice::from_ref(tree)),
        // The statements of blocks about each other are compared as they are read.
        Ok(Structure::Patch) => Ok(()),
        // Each block of this structure checks its own references.
        #[cfg(any(test, feature = "brute"))]
        Ok(Structure::Brute) => Ok(()),
        Err(why) => Err((BlockId(tree.first_block), why.to_string())),
    })
}

/// The parts of a geometry block, for the check of the lists of parts.
pub struct ListedParts {
    /// Local parts of its triangles and stand-ins, ascending.
    pub parts: Vec<u32>,
    /// The block whose list names them: the block itself, or the one above that stands for it.
    pub listed_by: BlockId,
    /// The blocks directly below it that have lists of their own.
    pub below: Vec<BlockId>,
}

/// Returns the parts of geometry block `id`, which holds the decoded `words` and belongs to `tree`.
pub fn block_parts(file: &ModelFile, tree: &TreeRow, id: BlockId, words: &[u32]) -> Result<ListedParts> {
    let mut found = match structure_of(file, tree)? {
        Structure::Bvh => bvh::block_parts(tree, id, words),
        Structure::Patch => patch::block_parts(tree, id, words),
        #[cfg(any(test, feature = "brute"))]
        Structure::Brute => brute::block_parts(id, words),
    };
    found.parts.sort_unstable();
    found.parts.dedup();
    Ok(found)
}

/// A block with triangles, and the block whose list of parts holds its parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Holder {
    /// The block with the list.
    pub listed_by: BlockId,
    /// The block with the triangles.
    pub block: BlockId,
}

/// Returns block `index` of those of a tree that hold triangles; `None` behind the last.
pub fn holder(file: &ModelFile, tree: &TreeRow, index: usize) -> Result<Option<Holder>> {
    let index = u32::try_from(index).unwrap_or(u32::MAX);
    let (first, count, apart) = match structure_of(file, tree)? {
        Structure::Bvh => bvh::holders(tree),
        Structure::Patch => patch::holders(tree),
        #[cfg(any(test, feature = "brute"))]
        Structure::Brute => brute::holders(tree),
    };
    let holder = |listed_by: u32| Holder { listed_by: BlockId(listed_by), block: BlockId(listed_by + apart) };
    Ok((index < count).then(|| holder(first + index)))
}

/// Name of the structure with this number, see [`Structure`].
pub fn name(number: u32) -> &'static str {
    Structure::from_number(number).map_or("unknown", Structure::name)
}

fn structure_of(file: &ModelFile, tree: &TreeRow) -> Result<Structure> {
    let unknown = || {
        let why = format!("this version does not support structure {}", tree.structure);
        Error::corrupt(file.name(), Some(tree.first_block), why)
    };
    Structure::from_number(tree.structure).ok_or_else(unknown)
}

fn stored(row: &TreeRow, start: Start, index: u32) -> StoredTree {
    let [a, b, c, d, e, f] = row.bounds.map(f64::from);
    let is_empty = row.block_count == 0;
    let max_coord = row.bounds.iter().filter(|x| x.is_finite()).fold(0.0f32, |r, x| r.max(x.abs()));
    StoredTree {
        start,
        index,
        origin: DVec3::from(row.origin),
        bounds: if is_empty { DBounds::EMPTY } else { DBounds { min: DVec3::new(a, b, c), max: DVec3::new(d, e, f) } },
        max_coord: max_coord.max(f32::MIN_POSITIVE),
        position_error: row.position_error,
        around_hits: None,
        main_part: 0,
    }
}

impl StoredTree {
    /// Reads the root in a snapshot that contains it, and stores [`StoredTree::around_hits`] and
    /// [`StoredTree::main_part`].
    pub fn look(&mut self, snapshot: &Snapshot) {
        let tree = self.view(snapshot, Isa::Baseline, Visit::default());
        self.around_hits = tree.around_hits();
        if let Some(parts) = tree.root_parts() {
            let area_of = |part: u32| parts.iter().flatten().filter(|it| it.0 == part).map(|it| it.1).sum::<f32>();
            // The first of the largest.
            let larger = |a: u32, b: u32| if area_of(b) > area_of(a) { b } else { a };
            self.main_part = parts.iter().flatten().map(|it| it.0).reduce(larger).unwrap_or(0);
        }
    }

    /// Returns the block of the root, which must stay in memory, and the root's number in that block
    /// ([`crate::residency::ModelBlocks::expect_number`]); `None` for an empty tree.
    pub fn start(&self) -> Option<(BlockId, u32)> {
        let root = match &self.start {
            Start::Bvh(own) => own.root(),
            Start::Patch(own) => own.root(),
            #[cfg(any(test, feature = "brute"))]
            Start::Brute(own) => own.root(),
        };
        root.map(|(block, number)| (BlockId(block), number))
    }

    /// True if primitive ids are those of faces: many triangles have the same, and none is in several leaves or trees.
    pub fn has_ids_of_faces(&self) -> bool {
        match &self.start {
            Start::Bvh(_) => false,
            Start::Patch(_) => true,
            #[cfg(any(test, feature = "brute"))]
            Start::Brute(_) => false,
        }
    }

    /// Finds nodes in the blocks of the tree.
    pub fn nodes(&self) -> Nodes {
        let kind = match &self.start {
            Start::Bvh(own) => NodesOf::Bvh(own.leaves_at()),
            Start::Patch(own) => NodesOf::Patch(own.leaves_at()),
            #[cfg(any(test, feature = "brute"))]
            Start::Brute(_) => NodesOf::Brute,
        };
        Nodes { kind, tree: self.index, origin: self.origin.to_array() }
    }

    /// Place where walks begin; `None` for an empty tree.
    pub fn root(&self) -> Option<Place> {
        self.start().map(|(block, item)| Place { block: block.0, item })
    }

    /// The tree in a snapshot of its file's blocks.
    #[inline]
    pub fn view<'a>(&self, snapshot: &'a Snapshot, isa: Isa, visit: Visit<'a>) -> Tree<'a> {
        let blocks = match &self.start {
            Start::Bvh(own) => Blocks::Bvh(own.view(snapshot, self.max_coord, isa, visit)),
            Start::Patch(own) => Blocks::Patch(own.view(snapshot, self.max_coord, isa, visit)),
            #[cfg(any(test, feature = "brute"))]
            Start::Brute(own) => Blocks::Brute(own.view(snapshot, self.max_coord, isa, visit)),
        };
        let forms = snapshot.companion::<Forms>();
        Tree::new(blocks, forms.and_then(|forms| forms.of(self.index)))
    }
}

/// Finds nodes in the blocks of a tree.
#[derive(Debug, Clone, Copy)]
pub struct Nodes {
    kind: NodesOf,
    tree: u32,
    origin: [f64; 3],
}

/// How nodes lie in blocks, for each structure.
#[derive(Debug, Clone, Copy)]
enum NodesOf {
    /// Offset from the id of a fine block to that of its leaf block.
    Bvh(u32),
    /// The same.
    Patch(u32),
    #[cfg(any(test, feature = "brute"))]
    Brute,
}

impl Nodes {
    /// Index of the tree.
    pub fn tree(&self) -> u32 {
        self.tree
    }

    /// Finds the node at a place in the words of the place's block, which is one of the tree. Returns false if there is
    /// none; `node` has no meaning then.
    #[inline]
    pub fn node(&self, words: &[u32], place: Place, starts: &mut Starts, node: &mut Node) -> bool {
        node.tree = self.tree;
        match self.kind {
            NodesOf::Bvh(leaves_at) => bvh::nodes::node(words, place, (leaves_at, &self.origin), starts, node),
            NodesOf::Patch(leaves_at) => patch::nodes::node(words, place, (leaves_at, &self.origin), node),
            #[cfg(any(test, feature = "brute"))]
            NodesOf::Brute => brute::nodes::node(words, place, &self.origin, node),
        }
    }

    /// Visits the triangles of the leaf at a place. Returns false if there is no leaf.
    pub fn triangles(
        &self,
        words: &[u32],
        place: Place,
        starts: &mut Starts,
        visit: &mut dyn FnMut(LeafTriangle),
    ) -> bool {
        let origin = DVec3::from_array(self.origin);
        let visit = |number: u32, triangle: Triangle| {
            let corners = triangle.vertices.map(|v| v.as_dvec3() + origin);
            visit(LeafTriangle { corners, part: triangle.part, number });
        };
        match self.kind {
            NodesOf::Bvh(_) => bvh::nodes::triangles(words, place, starts, visit),
            NodesOf::Patch(_) => patch::nodes::triangles(words, place, visit),
            #[cfg(any(test, feature = "brute"))]
            NodesOf::Brute => brute::nodes::triangles(words, place, visit),
        }
    }

    /// Returns the places of all nodes of a block, in the block's order.
    pub fn all(&self, words: &[u32], block: u32) -> Vec<Place> {
        let items = match self.kind {
            NodesOf::Bvh(_) => bvh::nodes::items(words),
            NodesOf::Patch(_) => patch::nodes::items(words),
            #[cfg(any(test, feature = "brute"))]
            NodesOf::Brute => brute::nodes::items(words),
        };
        items.into_iter().map(|item| Place { block, item }).collect()
    }
}

#[cfg(test)]
impl StoredTree {
    /// A tree that has bounds but no blocks.
    pub fn for_tests(origin: DVec3, bounds: DBounds, max_coord: f32) -> Self {
        Self {
            start: Start::Bvh(bvh::open::Start::NONE),
            index: 0,
            origin,
            bounds,
            max_coord,
            position_error: 0.0,
            around_hits: None,
            main_part: 0,
        }
    }
}
