//! The buffers of a picture.

use crate::base::error::Error;

/// A buffer of a picture. Rows from the top, pixels from the left, no padding.
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
    /// 1 u64: primitive id; [`crate::query::NONE`] for a miss.
    Primitive = 5,
    /// 1 u64: the caller's instance id; [`crate::query::NONE`] for a miss.
    Instance = 6,
    /// 1 byte: a [`crate::query::HitKind`].
    Kind = 7,
    /// 1 float: [`crate::query::Hit::error`], world units.
    Error = 8,
}

impl Buffer {
    /// All of them, by number.
    pub const ALL: [Buffer; 9] = [
        Buffer::ColourSrgb8,
        Buffer::ColourLinear,
        Buffer::Depth,
        Buffer::Normal,
        Buffer::Part,
        Buffer::Primitive,
        Buffer::Instance,
        Buffer::Kind,
        Buffer::Error,
    ];

    /// Bytes of one pixel.
    pub const fn pixel_bytes(self) -> usize {
        match self {
            Buffer::ColourSrgb8 | Buffer::Depth | Buffer::Error => 4,
            Buffer::ColourLinear => 16,
            Buffer::Normal => 12,
            Buffer::Part | Buffer::Primitive | Buffer::Instance => 8,
            Buffer::Kind => 1,
        }
    }
}

/// A set of [`Buffer`]s: bit `b as u32` for buffer `b`; joined with `|`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs(pub u32);

impl Outputs {
    /// Just the sRGB colour.
    pub const COLOUR: Self = Self(1 << Buffer::ColourSrgb8 as u32);
    /// Every buffer.
    pub const ALL: Self = Self((1 << 9) - 1);

    /// The set of one.
    pub const fn of(buffer: Buffer) -> Self {
        Self(1 << buffer as u32)
    }
    /// Whether `buffer` is in it.
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

/// The caller's memory for one buffer: takes finished pixels tile by tile while a frame renders. It is whole
/// once the frame has converged, and is not spared when a frame is cancelled or replaced (the mapped
/// buffers are).
pub trait Target: Send + Sync {
    /// Takes `pixels` (a whole number of pixels in the buffer's format) for row `y` from column `x` on. Called from any
    /// worker, also several at once, never twice at once for the same pixels, never under a lock.
    fn write(&self, x: u32, y: u32, pixels: &[u8]);
}

/// A buffer of the last complete picture: no copy; stays whole and readable until dropped, whatever the
/// frame does meanwhile. Thread-safe.
pub struct Mapped {
    width: u32,
    height: u32,
}

impl Mapped {
    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }
    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }
    /// Bytes from a row to the next.
    pub fn row_pitch(&self) -> usize {
        0
    }
    /// The pixels, in the machine's byte order; aligned for the buffer's element type.
    pub fn bytes(&self) -> &[u8] {
        &[]
    }
    /// The floats of a float buffer; `None` for others.
    pub fn floats(&self) -> Option<&[f32]> {
        None
    }
    /// The ids of an id buffer; `None` for others.
    pub fn ids(&self) -> Option<&[u64]> {
        None
    }
}

/// Kept out of the public face: what a mapping of a missing buffer answers.
pub(crate) fn no_picture() -> Error {
    Error::BadState("map: no picture has been completed yet".into())
}
