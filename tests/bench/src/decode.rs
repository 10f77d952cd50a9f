//! Measures decoding: from the stored bytes of all geometry blocks, in memory, to what rays read, in one thread. What
//! is decoded is looked at: the same words each time.

use crate::expected::Expected;
use crate::failure::Failure;
use crate::pairs::Spread;
use crate::record::{Decoded, Outcomes, Record};
use crate::trace::Task;
use outcrop::base::ids::BlockId;
use outcrop::residency::Decoder;
use outcrop::store::ModelFile;
use outcrop::structure::bvh::BvhDecoder;
use std::path::Path;
use std::time::Instant;
use xxhash_rust::xxh3::Xxh3;

/// The steps of a block, and all of them.
const STEPS: [&str; 4] = ["checksum and LZ4", "decoding", "links", "all"];

/// A file's geometry blocks as they are stored.
struct Stored {
    file: ModelFile,
    decoder: BvhDecoder,
    blocks: Vec<Vec<u8>>,
}

/// What a run over all blocks gives.
struct Run {
    /// Of each of [`STEPS`].
    seconds: [f64; 4],
    bytes: u64,
    /// Of the words, if they were asked for.
    hash: u64,
}

impl Stored {
    fn read(path: &Path) -> Result<Self, Failure> {
        let file = ModelFile::open_path(path)?;
        let count = file.header().geometry_blocks;
        let mut blocks = Vec::new();
        for id in (0..count).map(BlockId) {
            let mut bytes = Vec::new();
            file.read_stored(id, id, &mut bytes)?;
            blocks.push(bytes);
        }
        Ok(Self { decoder: BvhDecoder::new(file.header(), file.trees()), file, blocks })
    }

    /// As blocks are loaded, one after the other. Hashing what they become is not timed.
    fn run(&self, is_hashed: bool) -> Result<Run, Failure> {
        let (mut payload, mut seconds, mut bytes, mut hash) = (Vec::new(), [0.0; 4], 0, Xxh3::new());
        for (id, stored) in (0..).map(BlockId).zip(&self.blocks) {
            let begun = Instant::now();
            self.file.open_stored(id, id, stored, &mut payload)?;
            let opened = Instant::now();
            let words = self
                .decoder
                .decode(id, &payload, self.file.decoded_len(id) as usize / 4)
                .map_err(|why| format!("block {}: {why}", id.0))?;
            let decoded = Instant::now();
            std::hint::black_box(self.decoder.statements(id, &words));
            let linked = Instant::now();
            let ends = [(begun, opened), (opened, decoded), (decoded, linked), (begun, linked)];
            seconds.iter_mut().zip(ends).for_each(|(sum, (from, to))| *sum += (to - from).as_secs_f64());
            bytes += 4 * words.len() as u64;
            if is_hashed {
                words.iter().for_each(|word| hash.update(&word.to_le_bytes()));
            }
        }
        Ok(Run { seconds, bytes, hash: hash.digest() })
    }
}

/// All structures of a benchmark on one scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let mut records = Vec::new();
    for structure in &task.benchmark.structures {
        let stored = Stored::read(&task.scene.model(task.data.structure(structure))?.path)?;
        let key = format!("{}/{}/{structure}/words", task.benchmark.name, task.scene.row.name);
        // Warms caches too.
        let first = stored.run(true)?;
        task.book.check(&key, Expected::of_hash(stored.blocks.len(), first.hash))?;
        if task.is_only_expecting {
            continue;
        }
        let runs = (0..task.benchmark.rounds).map(|_| stored.run(false)).collect::<Result<Vec<Run>, Failure>>()?;
        let spreads =
            [0, 1, 2, 3].map(|step| Spread::of(&runs.iter().map(|run| run.seconds[step]).collect::<Vec<f64>>()));
        eprintln!("{key}: {:.1} MB in one thread", first.bytes as f64 / 1e6);
        for (step, seconds) in STEPS.iter().zip(spreads) {
            let rate = |seconds: f64| first.bytes as f64 / 1e9 / seconds;
            eprintln!("    {step}: {:.2} GB/s at best, {:.2} in the median", rate(seconds.least), rate(seconds.median));
        }
        let [opened, decoded, linked, all] = spreads;
        let bytes_stored = stored.blocks.iter().map(|block| block.len() as u64).sum();
        let decoded = Decoded {
            structure: structure.clone(),
            bytes_stored,
            bytes_trace: first.bytes,
            opened,
            decoded,
            linked,
            all,
        };
        records.push(task.record(key, stored.file.header().triangles_in, Outcomes::Decode(decoded)));
    }
    Ok(records)
}
