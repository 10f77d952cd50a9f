//! A lease over a model with many blocks that are smaller than their pages of the table.

use super::snapshot::PAGE;
use super::*;
use crate::base::error::Error;
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::{Header, MemorySource, ModelFile, TreeRow, Writer};
use std::sync::Arc;

/// Number of geometry blocks.
const BLOCKS: u32 = 800 * PAGE as u32;
/// Words of each block.
const WORDS: usize = 250;

struct Small;

impl Decoder for Small {
    fn decode(&self, id: BlockId, _: &[u8], _: usize) -> std::result::Result<Vec<u32>, String> {
        Ok(vec![id.0; WORDS])
    }
}

fn model(residency: &Residency) -> ModelBlocks {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("small.oc");
    let mut writer = Writer::create(&path).expect("a file");
    for id in 0..2 * BLOCKS {
        writer.block(&id.to_le_bytes(), 4 * WORDS as u32).expect("a block");
    }
    let header = Header { geometry_blocks: BLOCKS, ..Header::default() };
    let tree = TreeRow { block_count: BLOCKS, class_blocks: [1, BLOCKS - 1, 0, 0], bounds: [0.0; 6], ..TreeRow::EMPTY };
    writer.finish(&header, &[], &[], &[], &[tree]).expect("a model");
    let source = MemorySource::named("small", std::fs::read(&path).expect("the file"));
    let file = Arc::new(ModelFile::open(Arc::new(source)).expect("a model"));
    ModelBlocks::open(residency, file, Box::new(Small), &[BlockId(0)], |_| (), &Cancel::new()).expect("it opens")
}

#[test]
fn blocks_count_with_their_pages_of_the_table() {
    let residency = Residency::with_budget(12 << 20);
    let blocks = model(&residency);
    // Each block has a page of its own.
    let all: Vec<BlockId> = (0..BLOCKS).step_by(PAGE).map(|id| BlockId(id + 1)).collect();
    let bytes = |id: BlockId| blocks.slot_bytes(id);
    let mut sum = 0;
    let fit = all.iter().take_while(|&&id| {
        sum += Lease::counts(bytes(id));
        sum <= residency.lease_room()
    });
    let some: Vec<BlockId> = fit.copied().collect();
    assert!(some.len() > 50, "{}", some.len());
    let mut lease = residency.lease();
    lease.fetch(&blocks, &some, &Cancel::new()).expect("room for what counts as no more");
    let snapshot = lease.snapshot(&blocks).expect("room for their pages");
    assert!(some.iter().all(|&id| snapshot.block(id).is_some_and(|words| words[0] == id.0)));
    drop((snapshot, lease));
    assert!(all.iter().map(|&id| bytes(id)).sum::<u64>() <= residency.lease_room());
    let mut lease = residency.lease();
    lease.fetch(&blocks, &all, &Cancel::new()).expect("the blocks alone fit");
    let Err(Error::OverBudget { need, have, .. }) = lease.snapshot(&blocks).map(drop) else {
        panic!("with their pages they do not");
    };
    let larger = Residency::with_budget(need);
    assert!(need > have && larger.lease_room() > residency.lease_room());
}
