//! Subdivision tags of an OBJ file, as OpenSubdiv's tools write them: `t NAME I/F/S`, then I integers, F numbers and
//! S words. Vertices and faces of tags count from 0, unlike those of faces.
//!
//! - `crease`: a chain of vertices, with one sharpness for all of its edges or one for each.
//! - `corner`: vertices, with one sharpness for all or one for each.
//! - `hole`: faces that are no surface.
//! - `interpolateboundary`: 0 none, 1 edges and corners, 2 edges alone.
//! - `creasemethod`: `normal` or `chaikin`.
//! - `smoothtriangles`: `catmark` or `smooth`; 1 and 2 in older files.
//!
//! The rules of values at face corners (`facevarying…`) are for textures and ignored.

use super::mtl::next_number;
use crate::geom::surface::cage::{Boundary, Creasing, TriangleRule};
use crate::import::input::Parsed;
use crate::import::text;

/// The tags of a file.
#[derive(Default)]
pub(crate) struct Tags {
    /// Two vertices and a sharpness each.
    pub creases: Vec<(u32, u32, f32)>,
    /// A vertex and a sharpness each.
    pub corners: Vec<(u32, f32)>,
    pub holes: Vec<u32>,
    /// `None`: not stated.
    pub boundary: Option<Boundary>,
    pub creasing: Option<Creasing>,
    pub triangles: Option<TriangleRule>,
}

/// The arguments of a tag.
struct Arguments<'a> {
    integers: Vec<u32>,
    numbers: Vec<f32>,
    words: Vec<&'a [u8]>,
}

/// Greatest number of arguments of one kind. A longer list is a damaged count.
const MOST: usize = 1 << 24;

impl<'a> Arguments<'a> {
    /// Reads them behind the name of a tag.
    fn read(mut rest: &'a [u8]) -> Parsed<Self> {
        let counts = text::word(&mut rest).unwrap_or(b"");
        let mut parts = counts.split(|&b| b == b'/').map(|part| {
            let count = text::integer(part).and_then(|n| usize::try_from(n).ok()).filter(|&n| n <= MOST);
            count.ok_or_else(|| format!("{} are not the counts of a tag's arguments", text::shown(counts)))
        });
        let mut next = || parts.next().unwrap_or(Ok(0));
        let [integers, numbers, words] = [next()?, next()?, next()?];
        if counts.split(|&b| b == b'/').count() > 3 {
            return Err(format!("{} are not the counts of a tag's arguments", text::shown(counts)).into());
        }
        let mut all = Self { integers: Vec::new(), numbers: Vec::new(), words: Vec::new() };
        for _ in 0..integers {
            let word = text::word(&mut rest).ok_or("a tag has fewer integers than stated")?;
            let value = text::integer(word).and_then(|n| u32::try_from(n).ok());
            all.integers.push(value.ok_or_else(|| format!("{} is not an index of a tag", text::shown(word)))?);
        }
        for _ in 0..numbers {
            all.numbers.push(next_number(&mut rest).ok_or("a tag has fewer numbers than stated")?);
        }
        for _ in 0..words {
            all.words.push(text::word(&mut rest).ok_or("a tag has fewer words than stated")?);
        }
        match text::word(&mut rest) {
            Some(word) if !word.starts_with(b"#") => return Err("a tag has more arguments than stated".into()),
            _ => {}
        }
        Ok(all)
    }

    /// The sharpness of element `i` of `count`.
    fn sharpness(&self, i: usize, count: usize) -> Parsed<f32> {
        match self.numbers[..] {
            [one] => Ok(one),
            _ if self.numbers.len() == count => Ok(self.numbers[i]),
            _ => Err(format!("a tag of {count} elements has {} values of sharpness", self.numbers.len()).into()),
        }
    }
}

impl Tags {
    /// Reads a tag behind the `t`. Returns false for a tag that is unknown, or for textures.
    pub fn read(&mut self, mut rest: &[u8]) -> Parsed<bool> {
        let name = text::word(&mut rest).unwrap_or(b"");
        match name {
            b"crease" => {
                let all = Arguments::read(rest)?;
                let count = all.integers.len().saturating_sub(1);
                if count == 0 {
                    return Err("a crease needs two vertices".into());
                }
                for (i, ends) in all.integers.windows(2).enumerate() {
                    self.creases.push((ends[0], ends[1], all.sharpness(i, count)?));
                }
            }
            b"corner" => {
                let all = Arguments::read(rest)?;
                for (i, &vertex) in all.integers.iter().enumerate() {
                    self.corners.push((vertex, all.sharpness(i, all.integers.len())?));
                }
            }
            b"hole" => self.holes.extend(Arguments::read(rest)?.integers),
            b"interpolateboundary" => {
                self.boundary = Some(match Arguments::read(rest)?.integers[..] {
                    [0] => Boundary::None,
                    [1] => Boundary::EdgeAndCorner,
                    [2] => Boundary::EdgeOnly,
                    _ => return Err("interpolateboundary is 0, 1 or 2".into()),
                });
            }
            b"creasemethod" => {
                self.creasing = Some(match Arguments::read(rest)?.words[..] {
                    [b"normal"] => Creasing::Uniform,
                    [b"chaikin"] => Creasing::Chaikin,
                    _ => return Err("creasemethod is normal or chaikin".into()),
                });
            }
            b"smoothtriangles" => {
                let all = Arguments::read(rest)?;
                self.triangles = Some(match (&all.integers[..], &all.words[..]) {
                    ([], [b"catmark"]) | ([1], []) => TriangleRule::CatmullClark,
                    ([], [b"smooth"]) | ([2], []) => TriangleRule::Smooth,
                    _ => return Err("smoothtriangles is catmark or smooth".into()),
                });
            }
            _ => return Ok(false),
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(lines: &[&str]) -> Result<Tags, String> {
        let mut tags = Tags::default();
        for line in lines {
            match tags.read(line.as_bytes()) {
                Ok(is_known) => assert!(is_known, "{line}"),
                Err(crate::import::input::Fault::Why(why)) => return Err(why),
                Err(_) => return Err("another error".into()),
            }
        }
        Ok(tags)
    }

    #[test]
    fn tags_are_read() {
        let lines = [
            "crease 3/1/0 0 1 2 2.5",
            "crease 3/2/0 4 5 6 1 10",
            "corner 2/2/0 3 4 1.5 2.5",
            "corner 1/1/0 7 3.0",
            "hole 2/0/0 8 9",
            "interpolateboundary 1/0/0 2",
            "creasemethod 0/0/1 chaikin",
            "smoothtriangles 0/0/1 smooth",
        ];
        let tags = read(&lines).expect("tags");
        assert_eq!(tags.creases, [(0, 1, 2.5), (1, 2, 2.5), (4, 5, 1.0), (5, 6, 10.0)]);
        assert_eq!((&tags.corners[..], &tags.holes[..]), (&[(3, 1.5), (4, 2.5), (7, 3.0)][..], &[8, 9][..]));
        assert_eq!(tags.boundary, Some(Boundary::EdgeOnly));
        assert_eq!((tags.creasing, tags.triangles), (Some(Creasing::Chaikin), Some(TriangleRule::Smooth)));
        assert!(matches!(Tags::default().read(b"facevaryinginterpolateboundary 1/0/0 1"), Ok(false)));
    }

    #[test]
    fn wrong_tags_are_named() {
        for (line, why) in [
            ("crease 2/1/0 0 -1 2", "-1"),
            ("crease 3/1/0 0 1", "fewer integers"),
            ("crease 2/1/0 0 1", "fewer numbers"),
            ("crease 4/2/0 0 1 2 3 1 2", "2 values"),
            ("crease 1/1/0 0 2", "two vertices"),
            ("crease 2/1/0 0 1 2 3", "more arguments"),
            ("corner 1/1/0/7 0 2", "counts"),
            ("corner x/1/0 0", "counts"),
            ("corner 999999999999/1/0 0", "counts"),
            ("creasemethod 0/0/1", "fewer words"),
            ("creasemethod 0/0/1 sharp", "chaikin"),
            ("interpolateboundary 1/0/0 3", "0, 1 or 2"),
            ("smoothtriangles 1/0/0 3", "smooth"),
        ] {
            let error = read(&[line]).err().unwrap_or_default();
            assert!(error.contains(why), "{line}: {error}");
        }
    }
}
