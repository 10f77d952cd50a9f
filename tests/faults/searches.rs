//! Searches for clashes, distances and nearest points of a model whose file fails while they run.

use super::*;
use outcrop::base::progress::Progress;
use outcrop::query::PartSet;
use outcrop::query::clash::{Clash, ClashDetail, ClashOptions};
use outcrop::query::distance::DistanceOptions;
use outcrop::query::nearest::{NearestOptions, NearestPoint};

/// The answers of all searches.
#[derive(Debug, PartialEq)]
struct Answers {
    clashes: Vec<Clash>,
    distance: f64,
    nearest: Vec<NearestPoint>,
}

/// With a tolerance above 0 also the depths of clashes, for which all triangles of both parts are read.
fn ask(state: &SceneState, tolerance: f64) -> outcrop::Result<Answers> {
    let mut clashes = Vec::new();
    let options = ClashOptions { detail: ClashDetail::Triangles, tolerance, ..ClashOptions::default() };
    state.clash(&options, &Progress::default(), &Cancel::new(), &mut |clash| clashes.push(*clash))?;
    let of_part = |id: u64| {
        let mut set = PartSet::default();
        set.add_part(None, id);
        set
    };
    let sets = DistanceOptions { a: of_part(5), b: Some(of_part(6)), ..DistanceOptions::default() };
    let distance = state.distance(&sets)?.map_or(f64::INFINITY, |it| it.distance);
    let points: Vec<DVec3> = whole().rays.iter().take(20).map(|ray| ray.origin).collect();
    let mut nearest = vec![NearestPoint::MISS; points.len()];
    let options = NearestOptions { inside: true, ..NearestOptions::default() };
    state.nearest(&points, &options, &mut nearest)?;
    Ok(Answers { clashes, distance, nearest })
}

/// Both parts of the model meet in a ring of edges. A read that fails once is tried again; if it fails for good, the
/// searches fail with an error that names the file, and nothing wrong is answered.
#[test]
fn searches_of_a_failing_disk_end() {
    let path = &whole().built.path;
    let (context, _) = context(2);
    let (scene, model) = built::scene(&context, &whole().built);
    assert!(model.load(&Cancel::new()).expect("it loads"));
    let expected = ask(&scene.state(), 0.0).expect("answers");
    assert!(expected.clashes.len() > 400 && expected.distance == 0.0, "{}", expected.clashes.len());
    for (threads, for_good) in [(0, false), (2, true)] {
        let mut failed = 0;
        // A search takes some hundred reads: the first ones, and ever fewer of the later ones.
        for fail_at in (0..).map(|i| (1 << i) - 1) {
            let calls = Arc::new(Calls::default());
            let count = Arc::clone(&calls);
            let source = meddled(path, move |_, _| match count.next() {
                Some(call) if call == fail_at || for_good && call > fail_at => Err(io::ErrorKind::TimedOut.into()),
                _ => Ok(()),
            });
            let (context, _) = super::context(threads);
            let (state, _model) = open(&context, source).expect("it opens");
            calls.arm();
            match ask(&state, 0.0) {
                Ok(found) => assert_eq!(found, expected, "call {fail_at}"),
                Err(error) => {
                    let names_file =
                        matches!(&error, Error::Io { .. }) && error.to_string().contains(&*path.to_string_lossy());
                    let names_it = names_file || names_an_unread_block(Some(&error), path);
                    assert!(for_good && names_it, "call {fail_at}: {error}");
                    failed += 1;
                }
            }
            if calls.count() <= fail_at {
                break;
            }
        }
        assert_eq!(failed > 2, for_good, "{failed} failed");
    }
}

/// A byte of a block is another than was written: an error names the block, or the search does not need it.
#[test]
fn searches_of_a_damaged_file_end() {
    let whole = whole();
    let path = &whole.built.path;
    let (context, _) = context(2);
    let (scene, _model) = built::scene(&context, &whole.built);
    let expected = ask(&scene.state(), 1e-3).expect("answers");
    let (mut failed, blocks) = (0, blocks(path));
    for (id, place) in blocks.iter().enumerate().skip(whole.coarse as usize).step_by(blocks.len() / 6) {
        let at = (place.start + place.end) / 2;
        let source = meddled(path, move |from, buf| {
            if reaches(from, buf.len(), &(at..at + 1)) {
                buf[(at - from) as usize] ^= 4;
            }
            Ok(())
        });
        let (context, _) = super::context(2);
        let (state, _model) = open(&context, source).expect("it opens");
        match ask(&state, 1e-3) {
            Ok(found) => assert_eq!(found, expected, "block {id}"),
            Err(Error::Corrupt { block: Some(block), .. }) => {
                assert_eq!(block as usize, id);
                failed += 1;
            }
            Err(other) => panic!("block {id}: {other}"),
        }
    }
    assert!(failed > 1, "{failed} failed");
}
