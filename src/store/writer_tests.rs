use super::*;
use crate::store::reader::ModelFile;
use std::fs;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::SeqCst};

/// Fails at its call number `fail_at`, counted from 0, as a full disk does.
struct FaultyDisk {
    inner: OutputFile,
    calls: Arc<AtomicU32>,
    fail_at: u32,
}

impl FaultyDisk {
    fn call(&self) -> Result<()> {
        if self.calls.fetch_add(1, SeqCst) == self.fail_at {
            return Err(Error::io("model.oc", "write", io::ErrorKind::StorageFull.into()));
        }
        Ok(())
    }
}

impl Medium for FaultyDisk {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.call()?;
        self.inner.append(bytes)
    }
    fn overwrite_start(&mut self, bytes: &[u8]) -> Result<()> {
        self.call()?;
        self.inner.overwrite_start(bytes)
    }
    fn publish(&mut self) -> Result<()> {
        self.call()?;
        self.inner.publish()
    }
}

/// Incompressible blocks that fill the buffer three times.
fn write(mut writer: Writer) -> Result<u64> {
    let header = Header { geometry_blocks: 9, has_colours: true, ..Header::default() };
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 56) as u8
    };
    let payload: Vec<u8> = (0..BUFFER_LEN / 8 - 5).map(|_| random()).collect();
    for id in 0..27 {
        assert_eq!(writer.block(&payload, 1)?, BlockId(id));
    }
    writer.finish(&header, &[], &[], &[], &[TreeRow { block_count: 9, class_blocks: [9, 0, 0, 0], ..TREE }])
}

const TREE: TreeRow = TreeRow { block_count: 1, class_blocks: [1, 0, 0, 0], bounds: [0.0; 6], ..TreeRow::EMPTY };

#[test]
fn a_disk_that_fails_at_any_call_leaves_the_old_file_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    fs::write(&path, "old").unwrap();
    for fail_at in 0.. {
        let calls = Arc::new(AtomicU32::new(0));
        let disk = FaultyDisk { inner: OutputFile::create(&path).unwrap(), calls: calls.clone(), fail_at };
        let result = write(Writer::through(Box::new(disk)).unwrap());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        match result {
            Err(Error::Io { source, .. }) => assert_eq!(source.kind(), io::ErrorKind::StorageFull),
            Err(e) => panic!("{e}"),
            Ok(len) => {
                assert!(fail_at > 4 && fail_at == calls.load(SeqCst));
                assert_eq!(fs::metadata(&path).unwrap().len(), len);
                ModelFile::open_path(&path).unwrap();
                return;
            }
        }
        assert_eq!(fs::read(&path).unwrap(), b"old");
    }
}

#[test]
fn a_writer_that_failed_does_not_go_on() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    let disk = FaultyDisk { inner: OutputFile::create(&path).unwrap(), calls: Arc::default(), fail_at: 0 };
    let mut writer = Writer::through(Box::new(disk)).unwrap();
    assert!(writer.flush().is_err());
    assert!(matches!(writer.block(b"x", 1), Err(Error::BadState(_))));
    assert!(matches!(write(writer), Err(Error::BadState(_))));
    assert!(!path.exists());
}

#[test]
fn a_model_that_could_not_be_opened_is_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    let writer = || Writer::create(&path).unwrap();
    let header = Header { geometry_blocks: 1, ..Header::default() };
    let refused = |result: Result<u64>| assert!(matches!(result, Err(Error::BadArgument(_))), "{result:?}");
    refused(writer().finish(&header, &[], &[], &[], &[TREE])); // no blocks
    let mut w = writer();
    w.block(b"geometry", 1).unwrap();
    w.block(b"ids", 1).unwrap();
    refused(w.finish(&header, &[], &[], &[], &[])); // blocks of no tree
    let mut w = writer();
    w.block(b"geometry", header.block_size + 1).unwrap();
    w.block(b"ids", 1).unwrap();
    refused(w.finish(&header, &[], &[], &[], &[TREE])); // too large
    assert!(matches!(writer().block(b"", 1), Err(Error::BadArgument(_))));
    refused(writer().finish(&Header { up: 9, ..Header::default() }, &[], &[], &[], &[]));
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    writer().finish(&Header::default(), &[], &[], &[], &[]).unwrap();
}

/// Sections of any length end at the next rows once the work is cancelled.
#[test]
fn a_cancel_ends_the_sections_and_leaves_the_old_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.oc");
    fs::write(&path, "old").unwrap();
    let (mut writer, cancel) = (Writer::create(&path).unwrap(), Cancel::new());
    writer.stop_with(&cancel);
    let mut pieces = 0;
    let section = writer.section(Kind::Parts, 5, |take| {
        (0..5u8).try_for_each(|i| {
            pieces += 1;
            take(&[i])?;
            if i == 2 {
                cancel.cancel();
            }
            Ok(())
        })
    });
    assert!(matches!(section, Err(Error::Cancelled)) && pieces == 4, "{pieces}");
    assert!(matches!(writer.finish(&Header::default(), &[], &[], &[], &[]), Err(Error::Cancelled)));
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
}
