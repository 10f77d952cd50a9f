//! How much a picture with stand-ins shows of the parts and colours that the exact picture hides.
//!
//! `seen` is the picture that is judged. `truth` is the exact one of the same view, with several pixels for each of
//! `seen`: parts that are seen between the rays of `seen` are not hidden. A pixel without surface has the part
//! [`NONE`]. "Near" a pixel is what lies at most [`REACH`] pixels of `seen` aside.
//!
//! | measure | the share | of the pixels | function |
//! |---|---|---|---|
//! | foreign parts | whose part the truth has nowhere near | with surface in `seen` | [`foreign_parts`] |
//! | turned | whose part is of another kind | near which the truth shows one kind alone | [`turned`] |
//! | tinted | whose colour is more than [`TINT`] off grey | likewise, of a grey kind | [`tinted`] |
//! | faded | whose colour is less than half as far off grey as all near it in the truth | likewise, of a coloured kind | [`faded`] |
//!
//! Near the borders of parts a stand-in may show either: those pixels do not count, or may show both.

use super::picture::Colours;
use outcrop::query::NONE;

/// Pixels by which a part may be out of place.
pub const REACH: usize = 2;

/// Least [`chroma`] of a colour that is not grey.
pub const TINT: f64 = 0.1;

/// What is compared of a picture.
#[derive(Debug, Clone, Copy)]
pub struct Shown<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Pixels for each pixel of the picture that is judged, along each edge; odd, so that one has the same ray.
    pub times: usize,
    /// Of each pixel, by rows.
    pub parts: &'a [u64],
    pub colours: Colours<'a>,
}

/// Pixels of which something is true, and pixels that count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    pub count: usize,
    pub of: usize,
}

impl Share {
    /// NaN if no pixel counts, which meets no line.
    pub fn value(self) -> f64 {
        self.count as f64 / self.of as f64
    }

    fn among(pixels: impl IntoIterator<Item = usize>, is_true: impl Fn(usize) -> bool) -> Self {
        pixels.into_iter().fold(Self { count: 0, of: 0 }, |share, pixel| Self {
            count: share.count + usize::from(is_true(pixel)),
            of: share.of + 1,
        })
    }
}

impl Shown<'_> {
    /// The size of the picture that is judged.
    fn judged(&self) -> [usize; 2] {
        [self.width / self.times, self.parts.len() / self.width / self.times]
    }

    /// The pixels near one of the picture that is judged.
    fn near(&self, pixel: usize) -> impl Iterator<Item = usize> {
        let [width, height] = self.judged();
        let around =
            |at: usize, end: usize| at.saturating_sub(REACH) * self.times..(at + REACH + 1).min(end) * self.times;
        let (columns, rows) = (around(pixel % width, width), around(pixel / width, height));
        rows.flat_map(move |row| columns.clone().map(move |column| row * self.width + column))
    }

    /// The pixel with the ray of one of the picture that is judged.
    fn middle(&self, pixel: usize) -> usize {
        let [width, _] = self.judged();
        let middle = |at: usize| at * self.times + self.times / 2;
        middle(pixel / width) * self.width + middle(pixel % width)
    }

    /// The pixels of the picture that is judged near which all parts of this one are of a kind.
    pub fn inside(&self, kind: impl Fn(u64) -> bool) -> Vec<usize> {
        let is_of_kind: Vec<bool> = self.parts.iter().map(|part| kind(*part)).collect();
        let [width, height] = self.judged();
        (0..width * height).filter(|pixel| self.near(*pixel).all(|near| is_of_kind[near])).collect()
    }
}

/// Of the pixels with surface, those that show a part which the truth has nowhere near.
pub fn foreign_parts(seen: &Shown, truth: &Shown) -> Share {
    assert!(seen.times == 1 && truth.times % 2 == 1 && seen.judged() == truth.judged(), "pictures of one view");
    let has_surface = (0..seen.parts.len()).filter(|pixel| seen.parts[*pixel] != NONE);
    Share::among(has_surface, |pixel| {
        let part = seen.parts[pixel];
        // Most are found there.
        truth.parts[truth.middle(pixel)] != part && truth.near(pixel).all(|near| truth.parts[near] != part)
    })
}

/// Of the pixels [`inside`](Shown::inside) a kind, those that show a part of another one.
pub fn turned(seen: &Shown, inside: &[usize], to: impl Fn(u64) -> bool) -> Share {
    Share::among(inside.iter().copied(), |pixel| to(seen.parts[pixel]))
}

/// Of the pixels [`inside`](Shown::inside) a kind that is grey, those that are not grey.
pub fn tinted(seen: &Shown, inside: &[usize]) -> Share {
    Share::among(inside.iter().copied(), |pixel| chroma(seen.colours.linear(pixel)) > TINT)
}

/// Of the pixels [`inside`](Shown::inside) a kind that is coloured, those with surface that are less than half as far
/// off grey as each pixel of the truth near them.
pub fn faded(seen: &Shown, truth: &Shown, inside: &[usize]) -> Share {
    Share::among(inside.iter().copied(), |pixel| {
        let own = chroma(seen.colours.linear(pixel));
        let is_less = |of: usize| own < 0.5 * chroma(truth.colours.linear(of));
        seen.parts[pixel] != NONE && is_less(truth.middle(pixel)) && truth.near(pixel).all(is_less)
    })
}

/// How far a linear colour is off grey, whatever its brightness: (greatest - least) / greatest of red, green and blue
/// (the saturation of HSV); 0 of black.
pub fn chroma(colour: [f64; 3]) -> f64 {
    let (least, greatest) = colour.iter().fold((f64::INFINITY, 0.0f64), |(a, b), c| (a.min(*c), b.max(*c)));
    if greatest > 0.0 { (greatest - least) / greatest } else { 0.0 }
}
