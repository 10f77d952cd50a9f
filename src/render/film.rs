//! Buffers of a picture, during rendering and when it is complete.

use super::merged::Rows;
use super::tile::TilePixels;
use crate::base::error::Result;
use crate::base::memory::zeroed;
use crate::scene::SceneState;
use crate::scene::camera::PixelRays;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// A buffer of a picture. Rows run from top to bottom, pixels from left to right, without padding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Buffer {
    /// 4 bytes: sRGB red, green, blue, and linear alpha (1 where something opaque was hit).
    ColourSrgb8 = 0,
    /// 4 floats: linear RGB (not clamped) and alpha.
    ColourLinear = 1,
    /// 1 float: distance from the eye along the view direction, world units; infinity for a miss.
    Depth = 2,
    /// 3 floats: unit geometric normal in world space facing the eye; 0 for a miss.
    Normal = 3,
    /// 1 u64: the caller's part id; [`crate::query::NONE`] for a miss.
    Part = 4,
    /// 1 u64: primitive id; [`crate::query::NONE`] for a miss, for a stand-in, and in early pictures for a triangle
    /// whose id is not read yet.
    Primitive = 5,
    /// 1 u64: the caller's instance id; [`crate::query::NONE`] for a miss.
    Instance = 6,
    /// 1 byte: a [`crate::query::HitKind`].
    Kind = 7,
    /// 1 float: [`crate::query::Hit::error`], world units; infinity for a triangle or a miss behind transmitting
    /// stand-ins, because an original surface may lie before it.
    Error = 8,
    /// 3 floats: [`crate::query::Hit::shading_normal`]; 0 for a miss.
    ShadingNormal = 9,
    /// 1 u64: [`crate::query::Hit::occurrence`], the number of the place where the instance's mesh was met, by a
    /// triangle or a stand-in; [`crate::query::NONE`] for a miss. [`SceneState::path`] of the state that was requested
    /// resolves it; other states may number places otherwise.
    Occurrence = 10,
    /// 2 floats: [`crate::query::Hit::uv`]; 0 for a miss, and for a stand-in that has no parameters.
    Uv = 11,
}

impl Buffer {
    /// All buffers, in the order of their numbers.
    pub const ALL: [Buffer; 12] = [
        Buffer::ColourSrgb8,
        Buffer::ColourLinear,
        Buffer::Depth,
        Buffer::Normal,
        Buffer::Part,
        Buffer::Primitive,
        Buffer::Instance,
        Buffer::Kind,
        Buffer::Error,
        Buffer::ShadingNormal,
        Buffer::Occurrence,
        Buffer::Uv,
    ];

    /// Bytes of one pixel.
    pub const fn pixel_bytes(self) -> usize {
        match self {
            Buffer::ColourSrgb8 | Buffer::Depth | Buffer::Error => 4,
            Buffer::ColourLinear => 16,
            Buffer::Normal | Buffer::ShadingNormal => 12,
            Buffer::Part | Buffer::Primitive | Buffer::Instance | Buffer::Occurrence | Buffer::Uv => 8,
            Buffer::Kind => 1,
        }
    }
}

/// A set of [`Buffer`]s: bit `b as u32` stands for buffer `b`. `|` joins sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs(pub u32);

impl Outputs {
    /// Only the sRGB colour.
    pub const COLOUR: Self = Self(1 << Buffer::ColourSrgb8 as u32);
    /// Every buffer.
    pub const ALL: Self = Self((1 << Buffer::ALL.len()) - 1);

    /// Returns the set of one buffer.
    pub const fn of(buffer: Buffer) -> Self {
        Self(1 << buffer as u32)
    }
    /// True if the set contains `buffer`.
    pub const fn has(self, buffer: Buffer) -> bool {
        self.0 >> buffer as u32 & 1 == 1
    }
}

impl std::ops::BitOr for Outputs {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// The caller's memory for one buffer. It receives finished pixels tile by tile while a frame renders, and holds a
/// complete picture once the request is complete. A cancelled or replaced request leaves it partly overwritten. (Mapped
/// buffers are not affected.)
pub trait Target: Send + Sync {
    /// Receives `pixels` for row `y` from column `x` on: a whole number of pixels in the buffer's format. Any worker
    /// may call it, several at once, but never two at once for the same pixels. No lock is held during the call.
    fn write(&self, x: u32, y: u32, pixels: &[u8]);
}

/// A complete picture, with the scene and the camera rays that it shows.
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    /// Number of the request within its frame.
    pub request: u64,
    pub scene: Arc<SceneState>,
    pub rays: PixelRays,
    buffers: [Option<Pixels>; BUFFERS],
}

const BUFFERS: usize = Buffer::ALL.len();

/// The bytes of a buffer, stored as u64 so that every element type is aligned.
struct Pixels(Vec<u64>);

impl Pixels {
    fn new((width, height): (u32, u32), buffer: Buffer) -> Result<Self> {
        let bytes = width as usize * height as usize * buffer.pixel_bytes();
        zeroed(bytes.div_ceil(8), &format!("a buffer of {width}x{height} pixels")).map(Self)
    }
    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

/// A picture during rendering. Each buffer has its own lock, held while one tile is copied.
pub(super) struct Film {
    pub width: u32,
    pub height: u32,
    buffers: [Option<Mutex<Pixels>>; BUFFERS],
    targets: Vec<(Buffer, Arc<dyn Target>)>,
}

/// Buffers of a picture that is no longer needed, for reuse.
pub(super) struct Spare {
    pub size: (u32, u32),
    buffers: [Option<Pixels>; BUFFERS],
}

impl Film {
    /// Creates a film with buffers for `outputs`; reuses those of `spare` that match. Fails with `NoMemory`.
    pub fn new(
        size: (u32, u32),
        outputs: Outputs,
        targets: &[(Buffer, Arc<dyn Target>)],
        spare: Option<Spare>,
    ) -> Result<Self> {
        let buffers = Spare::of(size, outputs, spare)?.buffers.map(|pixels| pixels.map(Mutex::new));
        Ok(Self { width: size.0, height: size.1, buffers, targets: targets.to_vec() })
    }

    /// Returns the buffers that the film keeps or a target receives.
    pub fn wanted(&self) -> Outputs {
        let mut all = Outputs(0);
        for buffer in Buffer::ALL {
            if self.buffers[buffer as usize].is_some() || self.targets.iter().any(|(b, _)| *b == buffer) {
                all = all | Outputs::of(buffer);
            }
        }
        all
    }

    /// Copies those pixels of a tile with upper left pixel (`x`, `y`) that are in `rows` to the buffers and the
    /// targets.
    pub fn take(&self, x: u32, y: u32, tile: &TilePixels, rows: &Rows) {
        for buffer in Buffer::ALL {
            let size = buffer.pixel_bytes();
            if let Some(pixels) = &self.buffers[buffer as usize] {
                let mut pixels = pixels.lock().unwrap_or_else(PoisonError::into_inner);
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut pixels.0);
                for (row, columns) in runs(rows) {
                    let at = ((y + row) as usize * self.width as usize + x as usize + columns.start) * size;
                    let source = &tile.row(buffer, row)[columns.start * size..columns.end * size];
                    bytes[at..at + source.len()].copy_from_slice(source);
                }
            }
            for (_, target) in self.targets.iter().filter(|(b, _)| *b == buffer) {
                for (row, columns) in runs(rows) {
                    let pixels = &tile.row(buffer, row)[columns.start * size..columns.end * size];
                    target.write(x + columns.start as u32, y + row, pixels);
                }
            }
        }
    }

    /// Copies all buffers; reuses those of `spare` that match. Requires that no tile is being rendered. Fails with
    /// `NoMemory`.
    pub fn copy(&self, spare: Option<Spare>) -> Result<Spare> {
        let outputs = Buffer::ALL
            .iter()
            .filter(|b| self.buffers[**b as usize].is_some())
            .fold(Outputs(0), |all, b| all | Outputs::of(*b));
        let mut copy = Spare::of((self.width, self.height), outputs, spare)?;
        for (to, from) in copy.buffers.iter_mut().zip(&self.buffers) {
            if let (Some(to), Some(from)) = (to, from) {
                to.0.copy_from_slice(&from.lock().unwrap_or_else(PoisonError::into_inner).0);
            }
        }
        Ok(copy)
    }

    /// Turns the film into buffers for another picture.
    pub fn into_spare(self) -> Spare {
        let bare = |b: Option<Mutex<Pixels>>| b.map(|m| m.into_inner().unwrap_or_else(PoisonError::into_inner));
        Spare { size: (self.width, self.height), buffers: self.buffers.map(bare) }
    }
}

/// Iterates over the runs of neighbouring pixels in `rows`: for each, its row and its columns.
fn runs(rows: &Rows) -> impl Iterator<Item = (u32, Range<usize>)> {
    rows.iter().zip(0..).flat_map(|(&pixels, row)| {
        let mut left = pixels;
        std::iter::from_fn(move || {
            let start = left.trailing_zeros();
            let len = left.checked_shr(start)?.trailing_ones();
            left &= !(u32::MAX >> (32 - len) << start);
            Some((row, start as usize..(start + len) as usize))
        })
    })
}

impl Spare {
    /// Returns buffers for `outputs` with arbitrary content; reuses those of `old` that match. Fails with `NoMemory`.
    pub fn of(size: (u32, u32), outputs: Outputs, old: Option<Spare>) -> Result<Self> {
        let mut buffers = old.filter(|s| s.size == size).map_or_else(Default::default, |s| s.buffers);
        for b in Buffer::ALL {
            let place = &mut buffers[b as usize];
            let wanted = outputs.has(b);
            match place {
                Some(_) if !wanted => *place = None,
                None if wanted => *place = Some(Pixels::new(size, b)?),
                _ => {}
            }
        }
        Ok(Self { size, buffers })
    }

    /// Turns the buffers into a complete picture.
    pub fn into_picture(self, request: u64, scene: Arc<SceneState>, rays: PixelRays) -> Picture {
        Picture { width: self.size.0, height: self.size.1, request, scene, rays, buffers: self.buffers }
    }
}

impl Picture {
    /// Turns the picture into buffers for another one.
    pub fn into_spare(self) -> Spare {
        Spare { size: (self.width, self.height), buffers: self.buffers }
    }

    pub fn has(&self, buffer: Buffer) -> bool {
        self.buffers[buffer as usize].is_some()
    }
}

/// A buffer of the last complete picture, without a copy. It stays complete and readable until it is dropped, even if
/// the frame makes other pictures meanwhile. Thread-safe.
#[derive(Clone)]
pub struct Mapped {
    picture: Arc<Picture>,
    buffer: Buffer,
}

impl Mapped {
    /// Returns `None` if the picture does not have the buffer.
    pub(super) fn of(picture: Arc<Picture>, buffer: Buffer) -> Option<Self> {
        picture.has(buffer).then_some(Self { picture, buffer })
    }
    /// Number of pixels in a row.
    pub fn width(&self) -> u32 {
        self.picture.width
    }
    /// Number of rows.
    pub fn height(&self) -> u32 {
        self.picture.height
    }
    /// The mapped buffer.
    pub fn buffer(&self) -> Buffer {
        self.buffer
    }
    /// Number of the request that made the picture ([`super::FrameStatus::request`]).
    pub fn request(&self) -> u64 {
        self.picture.request
    }
    /// Number of bytes from the start of one row to the start of the next.
    pub fn row_pitch(&self) -> usize {
        self.picture.width as usize * self.buffer.pixel_bytes()
    }
    /// The pixels in the machine's byte order, aligned for the buffer's element type.
    pub fn bytes(&self) -> &[u8] {
        let all = self.picture.buffers[self.buffer as usize].as_ref().map_or(&[][..], Pixels::bytes);
        &all[..(self.row_pitch() * self.picture.height as usize).min(all.len())]
    }
    /// Returns the floats of a float buffer; `None` for other buffers.
    pub fn floats(&self) -> Option<&[f32]> {
        use Buffer::{ColourLinear, Depth, Error, Normal, ShadingNormal, Uv};
        let floats = [ColourLinear, Depth, Normal, Error, ShadingNormal, Uv];
        floats.contains(&self.buffer).then(|| bytemuck::cast_slice(self.bytes()))
    }
    /// Returns the ids or occurrences of a buffer of u64; `None` for other buffers.
    pub fn ids(&self) -> Option<&[u64]> {
        let ids = [Buffer::Part, Buffer::Primitive, Buffer::Instance, Buffer::Occurrence];
        ids.contains(&self.buffer).then(|| bytemuck::cast_slice(self.bytes()))
    }
}
