//! Images of a crash: what may be on the disk if the machine stops at any moment of a build. Between two syncs writes
//! may reach the disk in any order, each as a whole, in part, or not at all.

use super::common::rng::Rng;
use super::libc_calls::{Event, recorded};
use super::{BuildOptions, Inputs, alone, with_old_file};
use outcrop::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::store::{MemorySource, ModelFile};
use std::sync::Arc;

/// Opens an image. One that opens is the whole model.
fn judge(image: &[u8], whole: &[u8], what: &str) {
    let opened = ModelFile::open(Arc::new(MemorySource::named("model.oc", image)));
    match opened.and_then(|file| file.check(&Progress::default(), &Cancel::new())) {
        Ok(_) => assert!(image == whole, "{what}: an image that is not the whole model opens"),
        Err(Error::Corrupt { .. } | Error::NewerFormat { .. }) => {}
        Err(error) => panic!("{what}: {error}"),
    }
}

fn apply(image: &mut Vec<u8>, at: u64, bytes: &[u8]) {
    let end = at as usize + bytes.len();
    if image.len() < end {
        image.resize(end, 0);
    }
    image[at as usize..end].copy_from_slice(bytes);
}

#[test]
fn no_image_of_a_crash_opens_as_another_model() {
    let _alone = alone();
    let inputs = Inputs::new();
    let (_folder, path) = with_old_file();
    let options = BuildOptions { threads: 1, ..BuildOptions::default() };
    let (report, events) = recorded(|| inputs.build(&path, options).expect("a build"));
    let whole = std::fs::read(&path).expect("the model");
    assert_eq!(whole.len() as u64, report.bytes);
    let renamed = events.iter().position(|event| *event == Event::Rename).expect("a rename");
    let Some(Event::Sync(file)) = events[..renamed].last() else { panic!("the file is not synced: {events:?}") };
    assert!(matches!(events[renamed + 1..], [Event::Sync(_)]), "the folder is synced last");
    let writes: Vec<(u64, &[u8])> = events[..renamed]
        .iter()
        .filter_map(|event| match event {
            Event::Write(fd, at, bytes) if fd == file => Some((*at, bytes.as_slice())),
            _ => None,
        })
        .collect();
    assert!(writes.len() > 1 && writes.last().is_some_and(|last| last.0 == 0), "the header is not written last");
    // Each prefix of the writes, and of each write.
    let mut image = Vec::new();
    for (i, (at, bytes)) in writes.iter().enumerate() {
        for part in [0, 1, 63, 64, bytes.len() / 3, bytes.len() / 2, bytes.len() - 1] {
            let mut some = image.clone();
            apply(&mut some, *at, &bytes[..part.min(bytes.len())]);
            judge(&some, &whole, &format!("{part} bytes of write {i}"));
        }
        apply(&mut image, *at, bytes);
        judge(&image, &whole, &format!("after write {i}"));
    }
    assert!(image == whole);
    // Sectors of all writes, some on the disk and some not, the size of the file set or not.
    let mut rng = Rng::new(1);
    let sectors: Vec<(u64, &[u8])> = writes
        .iter()
        .flat_map(|(at, bytes)| bytes.chunks(512).enumerate().map(move |(i, part)| (at + 512 * i as u64, part)))
        .collect();
    for round in 0..600 {
        let mut image = if rng.one_in(2) { vec![0; whole.len()] } else { Vec::new() };
        let lost = 1 + rng.below(40);
        for (at, bytes) in sectors.iter().filter(|_| !rng.one_in(lost)).collect::<Vec<_>>() {
            apply(&mut image, *at, bytes);
        }
        judge(&image, &whole, &format!("round {round}"));
    }
}
