//! The `.bpt` format of Bézier patches, known from Newell's teapot: the number of patches, and of each its degrees
//! along u and v, and its control points of three numbers, v fastest. White space separates all numbers.

use super::SurfaceData;
use crate::base::error::{Error, Place, Result};
use crate::base::memory;
use crate::base::progress::Cancel;
use crate::geom::surface::nurbs::MAX_DEGREE;
use crate::import::text;
use glam::DVec3;
use std::path::Path;

/// Reads all patches of a text. Each becomes a surface over `[0, 1]²`.
///
/// Fails with [`Error::Parse`], naming line and patch: a number is missing or not finite, a degree is not in
/// `1..=MAX_DEGREE`, or something follows the last patch. Fails with `Cancelled` and `NoMemory`.
pub fn parse(bytes: &[u8], file: &Path, cancel: &Cancel) -> Result<Vec<SurfaceData>> {
    let mut words = Words { rest: text::unpadded(bytes), line: 1, file };
    let count = words.whole("the number of patches", 0..=u64::MAX)?;
    // The count of a damaged file may be anything; memory is taken as patches come.
    let mut patches = Vec::new();
    for patch in 0..count {
        cancel.check()?;
        let read = patch_of(&mut words, patch)?;
        memory::make_room(&mut patches, 1, "the patches of a file")?;
        patches.push(read);
    }
    match words.next() {
        Some(word) => Err(words.fault(format!("{} follows the last patch", text::shown(word)))),
        None => Ok(patches),
    }
}

fn patch_of(words: &mut Words<'_>, patch: u64) -> Result<SurfaceData> {
    let mut degree = [0; 2];
    for (degree, name) in degree.iter_mut().zip(["u", "v"]) {
        *degree = words.whole(&format!("patch {patch}: its degree along {name}"), 1..=u64::from(MAX_DEGREE))? as u32;
    }
    let counts = degree.map(|p| p + 1);
    let total = (counts[0] * counts[1]) as usize;
    let mut points = memory::room(total, "the patches of a file")?;
    for at in 0..total {
        let mut point = [0.0; 3];
        for number in &mut point {
            *number = words.number(&format!("patch {patch}: point {at}"))?;
        }
        points.push(DVec3::from_array(point));
    }
    let knots = counts.map(|n| [vec![0.0; n as usize], vec![1.0; n as usize]].concat());
    let domain = [[0.0, 1.0]; 2];
    Ok(SurfaceData { face: patch, degree, counts, knots, points, weights: None, domain, is_reversed: false })
}

/// The words of a text, with the line for errors.
struct Words<'a> {
    rest: &'a [u8],
    line: u64,
    file: &'a Path,
}

impl<'a> Words<'a> {
    fn next(&mut self) -> Option<&'a [u8]> {
        let before = self.rest;
        let word = text::word(&mut self.rest)?;
        let skipped = &before[..before.len() - self.rest.len() - word.len()];
        self.line += memchr::memchr_iter(b'\n', skipped).count() as u64;
        Some(word)
    }

    fn fault(&self, why: String) -> Error {
        Error::parse(self.file, Place::Line(self.line), why)
    }

    fn expect(&mut self, what: &str) -> Result<&'a [u8]> {
        self.next().ok_or_else(|| self.fault(format!("{what} is missing")))
    }

    fn whole(&mut self, what: &str, range: std::ops::RangeInclusive<u64>) -> Result<u64> {
        let word = self.expect(what)?;
        let number = str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.filter(|n| range.contains(n)).ok_or_else(|| self.fault(format!("{what} is {}", text::shown(word))))
    }

    fn number(&mut self, what: &str) -> Result<f64> {
        let word = self.expect(what)?;
        let number = text::double(word).ok_or_else(|| self.fault(format!("{what}: {}", text::not_a_number(word))))?;
        let is_finite = number.is_finite();
        is_finite.then_some(number).ok_or_else(|| self.fault(format!("{what} is not finite")))
    }
}
