//! A file whose trees have two structures: each block is decoded by that of its tree, and rays meet all trees.

use super::*;
use crate::Error;
use crate::import::Attributes;
use crate::residency::Snapshot;
use crate::store::{Header, MemorySource, TreeRow, Writer};
use glam::DAffine3;

/// Triangles of a tree of many blocks, and of one of few.
const MANY: usize = 9000;
const FEW: usize = 20;

/// A file with all of its blocks in memory.
struct Stored {
    file: Arc<ModelFile>,
    trees: Vec<StoredTree>,
    blocks: ModelBlocks,
}

impl Stored {
    fn open(bytes: Vec<u8>) -> crate::Result<Self> {
        let file = Arc::new(ModelFile::open(Arc::new(MemorySource::named("mixed.oc", bytes)))?);
        let open::Opened { decoder, trees } = open::open(&file)?;
        let blocks = ModelBlocks::new(Arc::clone(&file), decoder, &Residency::with_budget(1 << 30))?;
        let all: Vec<BlockId> = (0..file.block_count()).map(BlockId).collect();
        blocks.fetch(&all, &Cancel::new())?;
        Ok(Self { file, trees, blocks })
    }

    /// A model of trees with these numbers of triangles; all but the first are shared meshes.
    fn build(structure: Structure, counts: &[usize]) -> Self {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("model.oc");
        let options = BuildOptions { structure, ..BuildOptions::default() };
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("options");
        let part = builder.part(PartDesc::default()).expect("part");
        for (tree, &count) in counts.iter().enumerate() {
            let triangles: Vec<_> = soup(count, 0.1, 0.0).iter().map(|t| t.map(Vec3::as_dvec3)).collect();
            let mesh = if tree == 0 { MeshKey::DIRECT } else { builder.shared_mesh(1).expect("mesh") };
            builder.triangles(mesh, if tree == 0 { part } else { 0 }, &triangles, Attributes::NONE).expect("triangles");
            if tree > 0 {
                builder.instance(mesh, DAffine3::IDENTITY, part).expect("instance");
            }
        }
        builder.finish(&path).expect("build");
        Self::open(std::fs::read(&path).expect("file")).expect("a model")
    }

    fn row(&self, tree: usize) -> TreeRow {
        self.file.trees()[tree]
    }

    /// Returns the payload and the bytes of the trace form of each block of a tree; `stream` 0: geometry, 1: primitive
    /// ids.
    fn payloads(&self, tree: usize, stream: u32) -> Vec<(Vec<u8>, u32)> {
        let (row, mut scratch, mut payload) = (self.row(tree), Vec::new(), Vec::new());
        let first = row.first_block + stream * self.file.header().geometry_blocks;
        let mut read = |id| {
            self.file.read_block(BlockId(id), &mut scratch, &mut payload).expect("a block");
            (payload.clone(), self.file.decoded_len(BlockId(id)))
        };
        (first..first + row.block_count).map(&mut read).collect()
    }

    /// Returns the hit of a ray in a tree: its bits and the primitive id.
    fn hit(&self, tree: usize, snapshot: &Snapshot, ray: &LocalRay) -> Option<([u32; 3], Option<u32>)> {
        let view = self.trees[tree].view(snapshot, Isa::best(), Visit { stamp: 1, ..Visit::default() });
        let mut walk = Walk::new();
        walk.begin(&view, ray);
        assert_eq!(view.closest(None, &mut walk), Outcome::Done);
        let best = walk.best();
        best.is_hit().then(|| seen(&view, &best))
    }
}

/// Returns a file of these trees. Each tree has the block ids that it had in its own file.
fn joined(trees: &[(&Stored, usize)], change: impl Fn(&mut Vec<TreeRow>, &mut Vec<(Vec<u8>, u32)>)) -> Vec<u8> {
    let mut rows: Vec<TreeRow> = trees.iter().map(|(stored, tree)| stored.row(*tree)).collect();
    let (first, _) = trees[0];
    let geometry_blocks = rows.iter().map(|row| row.block_count).sum();
    let mut blocks: Vec<_> = [0, 1]
        .iter()
        .flat_map(|stream| trees.iter().flat_map(|(stored, tree)| stored.payloads(*tree, *stream)))
        .collect();
    change(&mut rows, &mut blocks);
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("mixed.oc");
    let mut writer = Writer::create(&path).expect("a file");
    for (payload, decoded) in &blocks {
        writer.block(payload, *decoded).expect("a block");
    }
    let header = Header { geometry_blocks, ..*first.file.header() };
    writer.finish(&header, &first.file.parts().to_rows(), first.file.materials(), &[], &rows).expect("a model");
    std::fs::read(&path).expect("the file")
}

/// The trees of two structures, in both orders: a tree of many blocks follows as many blocks of the other structure as
/// it follows in its own file.
fn with_mixed(test: impl Fn(&[(&Stored, usize)])) {
    let bvh = Stored::build(Structure::Bvh, &[FEW, FEW, MANY]);
    let brute = Stored::build(Structure::Brute, &[FEW, MANY]);
    // The blocks of each tree, as many as the trees of the files below need.
    let [of_bvh, of_brute] =
        [&bvh, &brute].map(|stored| stored.file.trees().iter().map(|row| row.block_count).collect::<Vec<_>>());
    assert!(of_bvh[..2] == [1, 1] && of_bvh[2] > 6, "{of_bvh:?}");
    assert!(of_brute[0] == 2 && of_brute[1] > 2, "{of_brute:?}");
    test(&[(&brute, 0), (&bvh, 2)]);
    test(&[(&bvh, 0), (&bvh, 1), (&brute, 1)]);
}

#[test]
fn each_block_is_decoded_by_the_structure_of_its_tree_and_rays_meet_all_trees() {
    with_mixed(|trees| {
        let mixed = Stored::open(joined(trees, |_, _| {})).expect("a file of two structures");
        let snapshot = mixed.blocks.snapshot();
        let decoder = open::open(&mixed.file).expect("trees").decoder;
        open::check_links(&mixed.file, &snapshot).expect("links");
        for (tree, &(own, of)) in trees.iter().enumerate() {
            let (own_snapshot, row) = (own.blocks.snapshot(), mixed.row(tree));
            let own_decoder = open::open(&own.file).expect("trees").decoder;
            for id in row.first_block..row.first_block + row.block_count {
                for stream in 0..2 {
                    let at = |file: &ModelFile| BlockId(id + stream * file.header().geometry_blocks);
                    let (here, there) = (at(&mixed.file), at(&own.file));
                    let (words, same) = (snapshot.block(here).expect("read"), own_snapshot.block(there).expect("read"));
                    assert_eq!(words, same, "tree {tree}, block {id}, stream {stream}");
                    assert_eq!(decoder.class(here), own_decoder.class(there), "tree {tree}, block {id}");
                    let (stated, same) = (decoder.statements(here, words), own_decoder.statements(there, words));
                    assert_eq!((stated.nodes, stated.entries), (same.nodes, same.entries), "tree {tree}, block {id}");
                }
                let parts = |stored: &Stored, row: &TreeRow, snapshot: &Snapshot| {
                    let words = snapshot.block(BlockId(id)).expect("read");
                    let found = open::block_parts(&stored.file, row, BlockId(id), words).expect("a known structure");
                    (found.parts, found.listed_by, found.below)
                };
                assert_eq!(parts(&mixed, &row, &snapshot), parts(own, &own.row(of), &own_snapshot));
            }
            for index in 0..row.block_count as usize {
                let holders = [(&mixed, tree), (own, of)]
                    .map(|(stored, tree)| open::holder(&stored.file, &stored.row(tree), index).expect("known"));
                assert_eq!(holders[0], holders[1]);
            }
            assert_eq!(open::entered_blocks(&row), open::entered_blocks(&own.row(of)));
            let (triangles, mut hits) = (soup(if row.block_count > 2 { MANY } else { FEW }, 0.1, 0.0), 0);
            for ray in rays(300) {
                let hit = mixed.hit(tree, &snapshot, &ray);
                let t = hit.map(|(bits, _)| bits[0]);
                assert_eq!(t, brute_force(&triangles, &ray).map(|best| best.0.to_bits()), "tree {tree}");
                assert_eq!(hit, own.hit(of, &own_snapshot, &ray), "tree {tree}");
                hits += usize::from(hit.is_some());
            }
            assert!(hits > if row.block_count > 2 { 100 } else { 0 }, "{hits} hits test little");
        }
    });
}

/// References between blocks are compared in a file of several structures too.
#[test]
fn blocks_of_a_mixed_file_must_agree() {
    with_mixed(|trees| {
        let (stored, tree) = *trees.last().expect("a tree");
        let at = stored.row(tree);
        // Lists of `brute` are not paired with other blocks.
        if at.structure != Structure::Bvh as u32 {
            return;
        }
        let last = (at.first_block + at.block_count) as usize - 1;
        // Two leaf blocks change places: each of them is sound, and does not match the fine block over it.
        let opened = Stored::open(joined(trees, |_, blocks| blocks.swap(last, last - 1)));
        let Err(Error::Corrupt { block: Some(block), .. }) = opened else { panic!("accepted") };
        assert!(block >= at.first_block && block as usize <= last, "block {block}");
    });
}

#[test]
fn a_tree_of_an_unknown_structure_is_refused() {
    with_mixed(|trees| {
        for tree in 0..trees.len() {
            let bytes = joined(trees, |rows, _| rows[tree].structure = 3);
            let first = trees[tree].0.row(trees[tree].1).first_block;
            let Err(Error::Corrupt { file, block, why }) = Stored::open(bytes) else { panic!("tree {tree}: accepted") };
            assert_eq!((file.as_path(), block), (std::path::Path::new("mixed.oc"), Some(first)));
            assert_eq!(why, "this version does not support structure 3");
        }
    });
}
