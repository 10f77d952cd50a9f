//! Neighbourhoods as words: the same after reading; damaged words give an error or some surface.

use super::super::{Finder, Neighbourhood, Plans, QuadSurface};
use super::shapes::{Rng, tangle};

/// Words of all quads of a random cage.
fn all(rng: &mut Rng) -> Vec<Vec<u32>> {
    let cage = tangle(rng).cage();
    let (mut finder, mut found, mut vertices) = (Finder::new(&cage), Neighbourhood::default(), Vec::new());
    let mut out = Vec::new();
    for face in 0..cage.face_count() as u32 {
        for corner in 0..cage.quads_of(face) {
            finder.find(face, corner, &mut found, &mut vertices);
            let mut words = Vec::new();
            found.write(&mut words);
            assert_eq!(Neighbourhood::read(&words).unwrap(), found);
            out.push(words);
        }
    }
    out
}

#[test]
fn words_are_read_back() {
    let rng = &mut Rng(1);
    (0..100).for_each(|_| drop(all(rng)));
}

#[test]
fn truncated_words_are_refused() {
    for words in all(&mut Rng(2)) {
        (0..words.len()).for_each(|len| assert!(Neighbourhood::read(&words[..len]).is_err()));
        assert!(Neighbourhood::read(&[words.as_slice(), &[0]].concat()).is_err());
    }
}

#[test]
fn damaged_words_do_not_panic() {
    let rng = &mut Rng(3);
    let mut made = 0;
    for _ in 0..60 {
        for mut words in all(rng) {
            let at = rng.below(words.len() as u32) as usize;
            let sharp = [0.4f32, 2.0, 10.0][rng.below(3) as usize].to_bits();
            words[at] = [rng.below(8), words[at] + 1, u32::MAX, sharp, 0][rng.below(5) as usize];
            let Ok(found) = Neighbourhood::read(&words) else { continue };
            let Ok(plan) = Plans::new().plan(&found) else { continue };
            made += 1;
            let points = (0..plan.control_points()).map(|_| rng.vector()).collect::<Vec<_>>();
            let surface = QuadSurface::new(plan, points).unwrap();
            assert!(surface.evaluate(0.3, 0.0).position.is_finite());
            assert!(surface.bounds(3, 1, 1).min.is_finite());
        }
    }
    assert!(made > 100, "only {made} damaged neighbourhoods were read");
}
