//! The model file from outside: what is written comes back; whatever is damaged, cut off, lied about
//! or cannot be read is an error, never a crash, never other data.

use outcrop::Error;
use outcrop::base::ids::BlockId;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::store::*;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::SeqCst};

/// All that a model file holds.
#[derive(Debug, Clone, PartialEq)]
struct Model {
    header: Header,
    blocks: Vec<(Vec<u8>, u32)>,
    parts: Vec<PartRow>,
    materials: Vec<MaterialRow>,
    instances: Vec<InstanceRow>,
    trees: Vec<TreeRow>,
}

impl Model {
    fn bytes(&self) -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.oc");
        let mut writer = Writer::create(&path).unwrap();
        for (i, (payload, decoded_len)) in self.blocks.iter().enumerate() {
            assert_eq!(writer.block(payload, *decoded_len).unwrap(), BlockId(i as u32));
        }
        let len = writer.finish(&self.header, &self.parts, &self.materials, &self.instances, &self.trees).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes.len() as u64, len);
        bytes
    }

    /// Reads everything there is, by every way there is.
    fn read(source: Arc<dyn Source>) -> outcrop::Result<Self> {
        let file = ModelFile::open(source)?;
        let (mut scratch, mut out, mut blocks) = (Vec::new(), Vec::new(), Vec::new());
        for id in (0..file.block_count()).map(BlockId) {
            file.read_block(id, &mut scratch, &mut out)?;
            blocks.push((out.clone(), file.decoded_len(id)));
        }
        let report = file.check(&Progress::default(), &Cancel::new())?;
        assert_eq!((report.bytes, report.blocks as usize), (file.file_len(), blocks.len()));
        Ok(Self {
            header: *file.header(),
            blocks,
            parts: file.parts().to_vec(),
            materials: file.materials().to_vec(),
            instances: file.instances().to_vec(),
            trees: file.trees().to_vec(),
        })
    }

    fn of_bytes(bytes: &[u8]) -> outcrop::Result<Self> {
        Self::read(Arc::new(MemorySource::named("model.oc", bytes)))
    }

    /// Two trees, one of them placed twice, with colours; blocks of both codecs.
    fn small() -> Self {
        let tree = |first_block, block_count, local_parts| TreeRow {
            first_block,
            block_count,
            root: 7,
            origin: [1e7, 0.0, -1.0],
            bounds: [-1.0, -2.0, -3.0, 1.0, 2.0, 3.0],
            triangles: 20,
            references: 25,
            nodes: 3,
            leaves: 5,
            position_error: 0.0,
            local_parts,
            max_stack: 30,
        };
        let part = |id, name: &str, parent| PartRow {
            id,
            name: name.into(),
            parent,
            material: 1,
            bounds: [0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            triangles: 10,
        };
        let instance = |x, first_part| InstanceRow {
            tree: 1,
            first_part,
            world_from_mesh: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, x, 0.0, 0.0],
        };
        let material =
            |v| MaterialRow { colour: [v, 0.5, 0.25], opacity: 1.0, metalness: 0.0, roughness: 0.5 };
        let payload = |i: u8| if i.is_multiple_of(2) { vec![i; 60] } else { vec![i, 200, 3, 77] };
        Self {
            header: Header { geometry_blocks: 2, has_colours: true, triangles_in: 41, ..Header::default() },
            blocks: (0..6).map(|i| (payload(i), 100 + u32::from(i))).collect(),
            parts: vec![part(5, "plane", None), part(6, "bolt", Some(0)), part(u64::MAX, "Ø bolt", Some(0))],
            materials: vec![material(0.0), material(1.0)],
            instances: vec![instance(0.0, 1), instance(5.0, 2)],
            trees: vec![tree(0, 1, 3), tree(1, 1, 1)],
        }
    }
}

fn is_file_error(e: &Error) -> bool {
    match e {
        Error::Corrupt { file, .. } | Error::NewerFormat { file, .. } => file == Path::new("model.oc"),
        _ => false,
    }
}

#[test]
fn a_model_comes_back() {
    let model = Model::small();
    assert_eq!(Model::of_bytes(&model.bytes()).unwrap(), model);
    assert_eq!(model.bytes(), model.bytes());
}

#[test]
fn any_flipped_byte_is_an_error() {
    let good = Model::small().bytes();
    for at in 0..good.len() {
        for flip in [1, 0x80, 0xff] {
            let mut bytes = good.clone();
            bytes[at] ^= flip;
            let e = Model::of_bytes(&bytes).expect_err(&format!("byte {at} flipped by {flip:#x}"));
            assert!(is_file_error(&e), "byte {at}: {e:?}");
        }
    }
}

#[test]
fn any_other_length_is_an_error() {
    let good = Model::small().bytes();
    for len in 0..good.len() {
        let e = Model::of_bytes(&good[..len]).expect_err(&format!("cut off at {len}"));
        assert!(is_file_error(&e), "{len}: {e:?}");
    }
    for more in [1, 2, 63, 64, 65, 5000] {
        for fill in [0, 0xff] {
            let longer = [good.clone(), vec![fill; more]].concat();
            assert!(is_file_error(&Model::of_bytes(&longer).unwrap_err()));
        }
    }
    assert!(is_file_error(&Model::of_bytes(&[good.clone(), good.clone()].concat()).unwrap_err()));
}

/// A source with a fault; counts its calls.
struct Faulty {
    bytes: Vec<u8>,
    len: u64,
    fail_at: u32,
    calls: AtomicU32,
}

impl Faulty {
    fn new(bytes: &[u8], len: u64, fail_at: u32) -> Arc<Self> {
        Arc::new(Self { bytes: bytes.to_vec(), len, fail_at, calls: AtomicU32::new(0) })
    }
}

impl Source for Faulty {
    fn len(&self) -> u64 {
        self.len
    }
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        if self.calls.fetch_add(1, SeqCst) == self.fail_at {
            return Err(io::Error::other("the disk is on fire"));
        }
        let from = usize::try_from(offset).ok().and_then(|at| self.bytes.get(at..)?.get(..buf.len()));
        buf.copy_from_slice(from.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
    fn name(&self) -> &Path {
        Path::new("model.oc")
    }
}

#[test]
fn a_source_that_fails_at_any_call_is_an_error_that_says_so() {
    let bytes = Model::small().bytes();
    for fail_at in 0.. {
        let source = Faulty::new(&bytes, bytes.len() as u64, fail_at);
        match Model::read(source.clone()) {
            Ok(model) => {
                assert_eq!(model, Model::small());
                assert!(fail_at > 10 && source.calls.load(SeqCst) == fail_at);
                return;
            }
            Err(Error::Io { path, source, .. }) => {
                assert_eq!(path, Path::new("model.oc"));
                assert!(source.to_string().contains("on fire"));
            }
            Err(e) => panic!("call {fail_at}: {e}"),
        }
    }
}

#[test]
fn a_source_that_lies_about_its_length_is_found_out() {
    let bytes = Model::small().bytes();
    let len = bytes.len() as u64;
    for lie in [0, 1, 8, 255, 256, len - 1, len + 1, 2 * len, u64::from(u32::MAX), 1 << 62, u64::MAX] {
        let e = Model::read(Faulty::new(&bytes, lie, u32::MAX)).unwrap_err();
        assert!(is_file_error(&e), "{lie}: {e}");
    }
}

#[test]
fn a_source_that_ends_early_is_found_out() {
    let bytes = Model::small().bytes();
    for have in 0..bytes.len() {
        let e = Model::read(Faulty::new(&bytes[..have], bytes.len() as u64, u32::MAX)).unwrap_err();
        assert!(is_file_error(&e), "{have}: {e}");
    }
}

#[test]
fn a_file_replaced_after_opening_is_noticed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    let bytes = Model::small().bytes();
    std::fs::write(&path, &bytes).unwrap();
    let file = ModelFile::open_path(&path).unwrap();
    let mut other = Model::small();
    other.blocks[2].0[5] = 99;
    std::fs::write(&path, other.bytes()).unwrap();
    let (mut scratch, mut out) = (Vec::new(), Vec::new());
    let e = file.read_block(BlockId(2), &mut scratch, &mut out).unwrap_err();
    assert!(matches!(e, Error::Corrupt { block: Some(2), .. }), "{e}");
    assert!(file.check(&Progress::default(), &Cancel::new()).is_err());
    std::fs::write(&path, &bytes[..300]).unwrap();
    assert!(matches!(file.read_block(BlockId(5), &mut scratch, &mut out), Err(Error::Corrupt { .. })));
}

#[test]
fn check_counts_damaged_blocks_and_can_be_cancelled() {
    let mut bytes = Model::small().bytes();
    bytes[256] ^= 1;
    bytes[256 + 64] ^= 1;
    let file = ModelFile::open(Arc::new(MemorySource::named("model.oc", bytes))).unwrap();
    let progress = Progress::default();
    let e = file.check(&progress, &Cancel::new()).unwrap_err();
    assert!(matches!(e, Error::Corrupt { block: Some(0), .. }) && e.to_string().contains("1 more"), "{e}");
    let cancel = Cancel::new();
    cancel.cancel();
    assert!(matches!(file.check(&progress, &cancel), Err(Error::Cancelled)));
}

#[test]
fn a_block_that_is_not_there_is_the_callers_error() {
    let file = ModelFile::open(Arc::new(MemorySource::new(Model::small().bytes()))).unwrap();
    let e = file.read_block(BlockId(6), &mut Vec::new(), &mut Vec::new()).unwrap_err();
    assert!(matches!(e, Error::BadArgument(_)));
    assert_eq!(file.decoded_len(BlockId(6)), 0);
}

