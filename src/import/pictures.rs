//! The pictures of a mesh file's textures: each is decoded once, whatever uses it.
//!
//! Beyond a limit pictures move from memory to a scratch file, and textures that were not used for longest are made
//! again from their picture.

use super::ReadOptions;
use super::decode::Decoding;
use super::input::{Fault, Parsed};
use super::picture::{Picture, Spilled};
use super::texture::{Alpha, Texture};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::base::scratch::{Scratch, ScratchSpace};
use std::cell::Cell;
use std::collections::HashMap;
use std::rc::Rc;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_128;

/// Limit of pictures and textures in memory without a budget, in bytes. A large texture has 21 MiB, its picture up
/// to 28.
const KEPT: u64 = 256 << 20;

/// Most pixels of all pictures of a mesh file: some, and others for each byte of input. A picture of one colour has a
/// thousand pixels in a byte. Without a limit a small file could have a decoder work for hours, because pictures may
/// share bytes.
const PIXELS: u64 = 1 << 28;
const PIXELS_A_BYTE: u64 = 1 << 10;

/// The place of an encoded picture.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Encoded {
    /// In a file of its own.
    File,
    /// Among other data, in this number of bytes of input.
    Within(u64),
}

/// Index of a picture.
pub(crate) type PictureId = usize;

/// Decoded pictures and their textures.
pub(crate) struct Pictures {
    /// Limit in bytes of pictures and textures in memory.
    kept: u64,
    /// Limit in bytes of decoding one; `u64::MAX` without a budget.
    limit: u64,
    /// True if the first row of a picture is the last row of texels.
    flip: bool,
    /// Pictures, with the place of those that are not in memory.
    all: Vec<(Picture, Option<Spilled>)>,
    /// The pictures by a hash of their encoded bytes; `None` for those that cannot be decoded.
    known: HashMap<u128, Option<PictureId>>,
    /// Number of pixels of all pictures, and of bytes of those in files of their own.
    pixels: u64,
    own_bytes: u64,
    /// Textures, most recently used last.
    textures: Vec<(PictureId, Alpha, Rc<Texture>)>,
    /// Bytes of pictures and textures in memory.
    bytes: u64,
    space: Arc<ScratchSpace>,
    file: Option<Scratch>,
}

impl Pictures {
    /// No pictures yet.
    pub(crate) fn new(options: &ReadOptions, flip: bool) -> Self {
        let (kept, limit) = match options.textures {
            0 => (KEPT, u64::MAX),
            limit => (limit.min(KEPT), limit),
        };
        let space = options.scratch();
        Self {
            kept,
            limit,
            flip,
            all: Vec::new(),
            known: HashMap::new(),
            pixels: 0,
            own_bytes: 0,
            textures: Vec::new(),
            bytes: 0,
            space,
            file: None,
        }
    }

    /// Largest picture file that is decoded, in bytes.
    pub(crate) fn largest_file(&self) -> u64 {
        self.limit.min(1 << 30)
    }

    /// Decodes a picture, unless it is known, and keeps it.
    pub(crate) fn add(&mut self, bytes: &[u8], place: Encoded, cancel: &Cancel) -> Parsed<PictureId> {
        let hash = xxh3_128(bytes);
        match self.known.get(&hash) {
            Some(&Some(known)) => return Ok(known),
            Some(None) => return Err("a picture cannot be decoded, like another one with the same bytes".into()),
            None => {}
        }
        let input = match place {
            Encoded::File => 0,
            Encoded::Within(bytes) => bytes,
        };
        let own = if matches!(place, Encoded::File) { bytes.len() as u64 } else { 0 };
        self.own_bytes += own;
        let most = (self.own_bytes.saturating_add(input)).saturating_mul(PIXELS_A_BYTE).saturating_add(PIXELS);
        // The encoded bytes are in memory too.
        let limit = self.limit.saturating_sub(bytes.len() as u64);
        let left = Cell::new(most.saturating_sub(self.pixels));
        let picture = Decoding { limit, flip: self.flip, pixels: &left, cancel }.decode(bytes);
        self.pixels = most.saturating_sub(left.get());
        if !matches!(&picture, Err(Fault::Failed(error)) if error.ends_work()) {
            self.known.insert(hash, picture.is_ok().then_some(self.all.len()));
        }
        let picture = picture?;
        self.bytes += picture.bytes();
        self.all.push((picture, None));
        self.settle()?;
        Ok(self.all.len() - 1)
    }

    /// Returns the texture of a picture for a use of its alpha channel.
    pub(crate) fn texture(&mut self, id: PictureId, alpha: Alpha) -> Result<Rc<Texture>> {
        if let Some(at) = self.textures.iter().position(|known| (known.0, known.1) == (id, alpha)) {
            let known = self.textures.remove(at);
            let texture = Rc::clone(&known.2);
            self.textures.push(known);
            return Ok(texture);
        }
        let texture = match (&self.all[id], &self.file) {
            ((picture, None), _) => Texture::of(picture, alpha)?,
            ((picture, Some(place)), Some(file)) => Texture::of(&picture.read_back(file, place)?, alpha)?,
            _ => return Err(Error::Internal("the temporary file of pictures is missing".into())),
        };
        let texture = Rc::new(texture);
        self.bytes += texture.bytes();
        self.textures.push((id, alpha, Rc::clone(&texture)));
        self.settle()?;
        Ok(texture)
    }

    /// Frees memory beyond the limit: first pictures, then textures except the one that was used last.
    fn settle(&mut self) -> Result<()> {
        let mut next = 0;
        while self.bytes > self.kept && next < self.all.len() {
            let (picture, place) = &mut self.all[next];
            if place.is_none() {
                let file = match self.file.take() {
                    Some(file) => file,
                    None => self.space.file()?,
                };
                self.bytes -= picture.bytes();
                *place = Some(picture.spill(self.file.insert(file))?);
            }
            next += 1;
        }
        while self.bytes > self.kept && self.textures.len() > 1 {
            self.bytes -= self.textures.remove(0).2.bytes();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::texture::{Mapping, Wrap};
    use glam::Vec2;

    /// A picture with colours of its own, half of it transparent.
    fn png(seed: u8) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let pixel =
            |x: u32, y: u32| image::Rgba([seed, (16 * x) as u8, (16 * y) as u8, if x < 8 { 255 } else { seed }]);
        image::RgbaImage::from_fn(16, 16, pixel).write_to(&mut bytes, image::ImageFormat::Png).expect("a picture");
        bytes.into_inner()
    }

    #[test]
    fn pictures_in_a_scratch_file_give_the_same_textures() {
        let folder = tempfile::tempdir().expect("a folder");
        let here = || ReadOptions { temp_dir: Some(folder.path().into()), ..Default::default() };
        let mut all = Pictures::new(&here(), false);
        let mut few = Pictures { kept: 5000, ..Pictures::new(&here(), false) };
        let (cancel, seeds) = (Cancel::new(), [10, 100, 200]);
        for seed in seeds {
            let bytes = png(seed);
            assert_eq!(all.add(&bytes, Encoded::File, &cancel).ok(), few.add(&bytes, Encoded::File, &cancel).ok());
        }
        let wrap = Mapping { offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE, wrap: [Wrap::Repeat; 2] };
        let corners = [Vec2::ZERO, Vec2::new(0.7, 0.1), Vec2::new(0.2, 0.9)];
        for round in 0..3 {
            for (id, alpha) in [0, 1, 2].into_iter().flat_map(|id| [Alpha::Ignored, Alpha::Opacity].map(|a| (id, a))) {
                let [one, other] = [&mut all, &mut few].map(|it| it.texture(id, alpha).expect("a texture"));
                assert!(one.mean(corners, &wrap).is_some(), "{round}");
                assert_eq!(one.mean(corners, &wrap), other.mean(corners, &wrap), "{id} {alpha:?}");
            }
        }
        assert!(few.all.iter().all(|(_, place)| place.is_some()) && few.textures.len() == 1);
        assert!(all.file.is_none() && all.textures.len() == 6);
    }

    /// Pictures that share bytes, so that none of them is known from another one.
    #[test]
    fn pictures_have_a_limit_of_pixels_for_their_bytes() {
        let (bytes, cancel) = (png(1), Cancel::new());
        let longer = |more: usize| [&bytes[..], &vec![0; more]].concat();
        let near_the_limit = || Pictures { pixels: PIXELS - 2 * 256, ..Pictures::new(&ReadOptions::default(), false) };
        let add = |all: &mut Pictures, more, place| all.add(&longer(more), place, &cancel).ok();
        let mut all = near_the_limit();
        let found = [0, 1, 2, 1].map(|more| add(&mut all, more, Encoded::Within(0)));
        assert_eq!(found, [Some(0), Some(1), None, Some(1)]);
        let mut all = near_the_limit();
        assert_eq!([0, 1, 2].map(|more| add(&mut all, more, Encoded::File)), [Some(0), Some(1), Some(2)]);
        // A picture that cannot be decoded counts too.
        let mut all = near_the_limit();
        let broken = |more: usize| [&bytes[..bytes.len() / 2], &vec![0; more]].concat();
        assert!((0..2).all(|more| all.add(&broken(more), Encoded::Within(0), &cancel).is_err()));
        assert_eq!((all.pixels, add(&mut all, 0, Encoded::Within(0))), (PIXELS, None));
    }
}
