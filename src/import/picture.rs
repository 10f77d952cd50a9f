//! Decoded pictures, reduced to a size that suffices for mean colours.
//!
//! Pixels are added in any order while the picture is decoded, so that the whole picture is never in memory. Each texel
//! is the mean of its pixels. A picture serves every use of its alpha channel ([`super::texture::Alpha`]), and is
//! therefore decoded once.

use super::colour;
use crate::base::error::Result;
use crate::base::memory;
use crate::base::scratch::Scratch;

/// Longest side of a reduced picture in texels.
const MAX_SIDE: u32 = 1024;

/// Use of the memory of texels, in errors.
pub(super) const TEXELS: &str = "a texture";

/// A reduced picture.
pub(crate) struct Picture {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Linear colour times alpha, and alpha, of each texel.
    pub(crate) weighted: Vec<[f32; 4]>,
    /// Linear colour of each texel without regard to alpha; empty if every pixel is opaque.
    pub(crate) plain: Vec<[f32; 3]>,
    /// Mean of the coded values.
    pub(crate) mean_coded: [f32; 3],
    /// Number of pixels of each alpha value.
    pub(crate) alphas: Box<[u64; 256]>,
}

impl Picture {
    /// Size of the texels in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&self.weighted[..]) + size_of_val(&self.plain[..])) as u64
    }

    /// Moves the texels to a scratch file. Returns their place.
    pub(crate) fn spill(&mut self, to: &Scratch) -> Result<Spilled> {
        let at = to.append(bytemuck::cast_slice(&self.weighted))?;
        to.append(bytemuck::cast_slice(&self.plain))?;
        let place = Spilled { at, weighted: self.weighted.len(), plain: self.plain.len() };
        (self.weighted, self.plain) = (Vec::new(), Vec::new());
        Ok(place)
    }

    /// Returns the picture with its texels, which were moved to a scratch file.
    pub(crate) fn read_back(&self, from: &Scratch, place: &Spilled) -> Result<Self> {
        let mut weighted: Vec<[f32; 4]> = memory::zeroed(place.weighted, TEXELS)?;
        let mut plain: Vec<[f32; 3]> = memory::zeroed(place.plain, TEXELS)?;
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut weighted);
        from.read_at(place.at, bytes)?;
        let behind = place.at + bytes.len() as u64;
        from.read_at(behind, bytemuck::cast_slice_mut(&mut plain))?;
        Ok(Self { weighted, plain, alphas: self.alphas.clone(), ..*self })
    }
}

/// The place of a picture's texels in a scratch file.
pub(crate) struct Spilled {
    at: u64,
    weighted: usize,
    plain: usize,
}

/// A picture that is being decoded.
pub(crate) struct Reducer {
    /// Size in pixels.
    pixels: (u32, u32),
    /// Number of pixels along a side of a texel.
    step: u32,
    /// True if the first row of the picture is the last row of texels.
    flip: bool,
    sum_coded: [u64; 3],
    /// The picture with sums instead of means.
    sums: Picture,
}

impl Reducer {
    /// Begins a picture of this size in pixels, neither of which is 0. Fails with `NoMemory`.
    pub(crate) fn new(width: u32, height: u32, flip: bool) -> Result<Self> {
        let step = width.max(height).div_ceil(MAX_SIDE);
        let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
        let count = columns as usize * rows as usize;
        // `plain` is filled when the first pixel comes that is not opaque.
        let (weighted, plain) = (memory::zeroed(count, TEXELS)?, memory::room(count, TEXELS)?);
        let (mean_coded, alphas) = ([0.0; 3], Box::new([0; 256]));
        let sums = Picture { width: columns, height: rows, weighted, plain, mean_coded, alphas };
        Ok(Self { pixels: (width, height), step, flip, sum_coded: [0; 3], sums })
    }

    /// Adds pixels of row `y`: every `dx`-th from column `x` on.
    #[inline]
    pub(crate) fn row(&mut self, y: u32, (x, dx): (u32, u32), pixels: impl Iterator<Item = [u8; 4]>) {
        let y = if self.flip { self.pixels.1 - 1 - y } else { y };
        let begin = (y / self.step * self.sums.width) as usize;
        let end = begin + self.sums.width as usize;
        let (mut at, mut within) = (begin + (x / self.step) as usize, x % self.step);
        for pixel in pixels {
            if at >= end {
                break;
            }
            self.add(at, pixel);
            within += dx;
            while within >= self.step {
                within -= self.step;
                at += 1;
            }
        }
    }

    #[inline]
    fn add(&mut self, at: usize, [r, g, b, a]: [u8; 4]) {
        let Picture { weighted, plain, alphas, .. } = &mut self.sums;
        let coded = [r, g, b];
        let colour = colour::linear_bytes(coded);
        if a != 255 && plain.is_empty() {
            // All pixels so far are opaque.
            plain.extend(weighted.iter().map(|[r, g, b, _]| [*r, *g, *b]));
        }
        let alpha = f32::from(a) / 255.0;
        for i in 0..3 {
            weighted[at][i] += colour[i] * alpha;
            self.sum_coded[i] += u64::from(coded[i]);
        }
        weighted[at][3] += alpha;
        if let Some(plain) = plain.get_mut(at) {
            (0..3).for_each(|i| plain[i] += colour[i]);
        }
        alphas[usize::from(a)] += 1;
    }

    /// Returns the picture.
    pub(crate) fn finish(mut self) -> Picture {
        let (step, (width, height)) = (self.step, self.pixels);
        let side = |texel: u32, pixels: u32| (pixels - texel * step).min(step);
        for at in 0..self.sums.weighted.len() {
            let (x, y) = (at as u32 % self.sums.width, at as u32 / self.sums.width);
            let count = (side(x, width) * side(y, height)) as f32;
            self.sums.weighted[at] = self.sums.weighted[at].map(|c| c / count);
            if let Some(plain) = self.sums.plain.get_mut(at) {
                *plain = plain.map(|c| c / count);
            }
        }
        if self.sums.plain.is_empty() {
            self.sums.plain = Vec::new();
        }
        let all = f64::from(width) * f64::from(height);
        self.sums.mean_coded = self.sum_coded.map(|sum| (sum as f64 / (255.0 * all)) as f32);
        self.sums
    }
}
