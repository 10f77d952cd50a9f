//! Textures, and their mean colour over a triangle.
//!
//! A picture becomes a pyramid: each level halves the one below, in linear light and weighted by alpha, so that masked
//! texels add no colour. The mean over a triangle is that of 15 points, the centroids of a regular pattern in
//! barycentric coordinates (5 points along each edge). Each point is read from the level with texels about as large as
//! the point's share of the triangle. Small triangles therefore read their few texels, large ones cover all of theirs,
//! and both cost the same.

use super::picture::{Picture, TEXELS};
use crate::base::error::Result;
use crate::base::memory;
use glam::Vec2;

/// Number of points along an edge of the pattern.
const PATTERN: u32 = 5;

/// A level of the pyramid. Texels hold the linear colour times alpha, and alpha.
struct Level {
    width: u32,
    height: u32,
    texels: Vec<[f32; 4]>,
}

/// A decoded picture and its coarser levels.
pub(crate) struct Texture {
    /// Levels, finest first; never empty.
    levels: Vec<Level>,
    /// Mean of the coded values.
    mean_coded: [f32; 3],
    /// Mean of alpha, weighted by alpha.
    opacity: f32,
}

/// Wrapping of texture coordinates outside of [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wrap {
    Repeat,
    ClampToEdge,
    MirroredRepeat,
}

/// Use of the alpha channel of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Alpha {
    /// All texels are opaque.
    Ignored,
    /// Texels of at least this coded alpha are opaque, the others are invisible. 256 makes all invisible.
    Cut(u16),
    /// Alpha is opacity.
    Opacity,
}

impl Alpha {
    /// Texels of at least the alpha `least` are opaque.
    pub(crate) fn cut(least: f32) -> Self {
        Self::Cut((0..=255u8).find(|&a| f32::from(a) / 255.0 >= least).map_or(256, u16::from))
    }

    /// Returns the alpha that a texel of alpha `coded` has.
    fn of(self, coded: u8) -> u8 {
        match self {
            Self::Ignored => 255,
            Self::Cut(least) => 255 * u8::from(u16::from(coded) >= least),
            Self::Opacity => coded,
        }
    }
}

/// Mapping of texture coordinates by a material: a transform, and the wrapping outside of [0, 1].
#[derive(Clone, Copy)]
pub(crate) struct Mapping {
    pub(crate) offset: Vec2,
    pub(crate) rotation: f32,
    pub(crate) scale: Vec2,
    pub(crate) wrap: [Wrap; 2],
}

impl Mapping {
    /// Applies KHR_texture_transform: scales, then rotates, then translates.
    pub(crate) fn apply(&self, uv: [f32; 2]) -> Vec2 {
        let [u, v] = (Vec2::from(uv) * self.scale).to_array();
        let (sin, cos) = self.rotation.sin_cos();
        Vec2::new(cos * u + sin * v, cos * v - sin * u) + self.offset
    }
}

impl Texture {
    /// Creates a texture from a picture. Fails with `NoMemory`.
    pub(crate) fn of(picture: &Picture, alpha: Alpha) -> Result<Self> {
        let texel = |i: usize| {
            let [r, g, b, mean_alpha] = picture.weighted[i];
            match alpha {
                Alpha::Opacity => [r, g, b, mean_alpha],
                Alpha::Ignored => {
                    let [r, g, b] = picture.plain.get(i).copied().unwrap_or([r, g, b]);
                    [r, g, b, 1.0]
                }
                // A texel of several pixels has the mean of their alpha.
                Alpha::Cut(least) if mean_alpha > 0.0 && (255.0 * mean_alpha).round() >= f32::from(least) => {
                    [r / mean_alpha, g / mean_alpha, b / mean_alpha, 1.0]
                }
                Alpha::Cut(_) => [0.0; 4],
            }
        };
        let mut texels = memory::room(picture.weighted.len(), TEXELS)?;
        texels.extend((0..picture.weighted.len()).map(texel));
        let mut last = Level { width: picture.width, height: picture.height, texels };
        let mut levels = Vec::new();
        while let Some(coarser) = last.halved()? {
            levels.push(std::mem::replace(&mut last, coarser));
        }
        levels.push(last);
        // The sum over all pixels of a power of their alpha.
        let sum = |power: u32| -> f64 {
            let each = (0..=255u8).zip(picture.alphas.iter());
            each.map(|(a, &n)| n as f64 * f64::from(alpha.of(a)).powi(power as i32)).sum()
        };
        let opacity = (sum(2) / (255.0 * sum(1)).max(1.0)) as f32;
        Ok(Self { levels, mean_coded: picture.mean_coded, opacity })
    }

    /// Returns the mean of the coded values, for textures that are not colours.
    pub(crate) fn mean_coded(&self) -> [f32; 3] {
        self.mean_coded
    }

    /// Returns the mean linear colour of the whole picture; `None` if it is fully transparent.
    pub(crate) fn mean_of_all(&self) -> Option<[f32; 3]> {
        let &[r, g, b, alpha] = self.levels.last()?.texels.first()?;
        (alpha > 1e-4).then(|| [r / alpha, g / alpha, b / alpha])
    }

    /// Returns the size of all levels in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.levels.iter().map(|level| size_of_val(&level.texels[..]) as u64).sum()
    }

    /// Returns the mean opacity of the visible texels: the mean of alpha, weighted by alpha. Empty areas around the
    /// used ones of an atlas therefore do not count. A picture that is fully transparent has 0.
    pub(crate) fn opacity(&self) -> f32 {
        self.opacity
    }

    /// Returns the mean linear colour over a triangle of mapped coordinates; `None` if the area is fully transparent.
    pub(crate) fn mean(&self, corners: [Vec2; 3], wrap: &Mapping) -> Option<[f32; 3]> {
        let finest = &self.levels[0];
        let size = Vec2::new(finest.width as f32, finest.height as f32);
        let edge = |a: usize, b: usize| (corners[b] - corners[a]) * size;
        let area = edge(0, 1).perp_dot(edge(0, 2)).abs() * 0.5;
        let points = (PATTERN * (PATTERN + 1) / 2) as f32;
        // The level's texels have the size of a point's share of the triangle's texels. NaN gives level 0.
        let level = (area / points).max(1.0).log2() * 0.5;
        let level = &self.levels[(level.round() as usize).min(self.levels.len() - 1)];
        let mut sum = [0.0; 4];
        for j in 0..PATTERN {
            for k in 0..PATTERN - j {
                let (b, c) = (centre(j), centre(k));
                let at = corners[0] * (1.0 - b - c) + corners[1] * b + corners[2] * c;
                add(&mut sum, level.texel(at, wrap));
            }
        }
        let [r, g, b, alpha] = sum;
        (alpha > 1e-4 * points).then(|| [r / alpha, g / alpha, b / alpha])
    }
}

/// Returns the barycentric coordinate of row `j` of the pattern, at the centroid of a cell.
fn centre(j: u32) -> f32 {
    (j as f32 + 1.0 / 3.0) / PATTERN as f32
}

fn add(sum: &mut [f32; 4], x: [f32; 4]) {
    for (s, x) in sum.iter_mut().zip(x) {
        *s += x;
    }
}

impl Level {
    /// Returns a level of half the size, in which each texel is the mean of up to four; `None` for a single texel.
    fn halved(&self) -> Result<Option<Level>> {
        if self.width == 1 && self.height == 1 {
            return Ok(None);
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut texels = memory::room(width as usize * height as usize, TEXELS)?;
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let (mut sum, mut n) = ([0.0; 4], 0.0);
            for y in (2 * y)..(2 * y + 2).min(self.height) {
                for x in (2 * x)..(2 * x + 2).min(self.width) {
                    add(&mut sum, self.texels[(y * self.width + x) as usize]);
                    n += 1.0;
                }
            }
            texels.push(sum.map(|s| s / n));
        }
        Ok(Some(Level { width, height, texels }))
    }

    fn texel(&self, at: Vec2, mapping: &Mapping) -> [f32; 4] {
        let x = wrapped(at.x, self.width, mapping.wrap[0]);
        let y = wrapped(at.y, self.height, mapping.wrap[1]);
        self.texels[(y * self.width + x) as usize]
    }
}

/// Returns the texel in [0, size) at coordinate `t`; 0 for NaN.
fn wrapped(t: f32, size: u32, mode: Wrap) -> u32 {
    let t = match mode {
        Wrap::Repeat => t - t.floor(),
        Wrap::ClampToEdge => t,
        Wrap::MirroredRepeat => 1.0 - (t.rem_euclid(2.0) - 1.0).abs(),
    };
    // Casts of NaN and of negative numbers give 0.
    ((t * size as f32) as u32).min(size - 1)
}
