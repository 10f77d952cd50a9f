//! The buffers of a picture: mapped, or in the caller's memory.

use super::frame::{FrameObject, oc_frame};
use super::guard::{Checked, Fill, Sized32, bad, boundary, reserved};
use super::handles::{self, Shell, handle};
use super::status::oc_status;
use crate::render::{Buffer, Mapped, Target};
use std::ffi::c_void;

/// A buffer of a picture. Rows from the top, pixels from the left.
pub type oc_buffer = u32;
/// 4 bytes: sRGB red, green, blue, and linear alpha.
pub const OC_BUFFER_COLOUR_SRGB8: oc_buffer = 0;
/// 4 floats: linear RGB, not clamped, and alpha.
pub const OC_BUFFER_COLOUR_LINEAR: oc_buffer = 1;
/// 1 float: distance from the eye along the view direction, world units; infinity for a miss.
pub const OC_BUFFER_DEPTH: oc_buffer = 2;
/// 3 floats: unit geometric normal in world space, facing the eye; 0 for a miss.
pub const OC_BUFFER_NORMAL: oc_buffer = 3;
/// 1 uint64_t: the part's id; OC_NO_ID for a miss.
pub const OC_BUFFER_PART: oc_buffer = 4;
/// 1 uint64_t: the triangle's index in the input of the build; OC_NO_ID for a miss.
pub const OC_BUFFER_PRIM: oc_buffer = 5;
/// 1 uint64_t: the instance's id; OC_NO_ID for a miss.
pub const OC_BUFFER_INSTANCE: oc_buffer = 6;
/// 1 byte: an OC_HIT_ number.
pub const OC_BUFFER_KIND: oc_buffer = 7;
/// 1 float: some original surface lies within this distance of what is shown; world units. Infinity where a triangle,
/// or nothing, is seen through stand-ins that let the ray pass: there something nearer may be.
pub const OC_BUFFER_ERROR: oc_buffer = 8;

/// The element of a buffer.
pub type oc_format = u32;
/// 4 bytes.
pub const OC_FORMAT_U8X4: oc_format = 1;
/// 4 floats.
pub const OC_FORMAT_F32X4: oc_format = 2;
/// 1 float.
pub const OC_FORMAT_F32: oc_format = 3;
/// 3 floats.
pub const OC_FORMAT_F32X3: oc_format = 4;
/// 1 uint64_t.
pub const OC_FORMAT_U64: oc_format = 5;
/// 1 byte.
pub const OC_FORMAT_U8: oc_format = 6;

pub(crate) fn buffer(number: oc_buffer) -> Checked<Buffer> {
    match Buffer::ALL.get(number as usize) {
        Some(buffer) => Ok(*buffer),
        None => bad(format!("buffer {number} is unknown")),
    }
}

fn format(buffer: Buffer) -> oc_format {
    match buffer {
        Buffer::ColourSrgb8 => OC_FORMAT_U8X4,
        Buffer::ColourLinear => OC_FORMAT_F32X4,
        Buffer::Depth | Buffer::Error => OC_FORMAT_F32,
        Buffer::Normal => OC_FORMAT_F32X3,
        Buffer::Part | Buffer::Primitive | Buffer::Instance => OC_FORMAT_U64,
        Buffer::Kind => OC_FORMAT_U8,
    }
}

/// The caller's memory for a buffer; an element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_target {
    /// The first pixel of the first row. Written from any thread while a frame renders; whole once the
    /// frame is done. Must stay until the frame is released or resized.
    pub memory: *mut c_void,
    /// Bytes there.
    pub size: u64,
    /// Bytes from a row to the next; 0: tightly packed.
    pub row_pitch: u64,
    /// An OC_BUFFER_ number.
    pub buffer: oc_buffer,
    /// Must be 0.
    pub reserved: u32,
}

/// The caller's memory behind the crate's trait.
pub(crate) struct HostTarget {
    memory: *mut u8,
    row_pitch: usize,
    pixel: usize,
}

// SAFETY: the header says that the memory is written from any thread.
unsafe impl Send for HostTarget {}
// SAFETY: as above; two writes never meet the same pixels.
unsafe impl Sync for HostTarget {}

impl HostTarget {
    pub(crate) fn new(target: &oc_target, buffer: Buffer, width: u32, height: u32) -> Checked<Self> {
        reserved(target.reserved, "oc_target.reserved")?;
        let pixel = buffer.pixel_bytes();
        let row = u64::from(width) * pixel as u64;
        let row_pitch = if target.row_pitch == 0 { row } else { target.row_pitch };
        if target.memory.is_null() {
            return bad("oc_target.memory is NULL");
        }
        if row_pitch < row {
            return bad(format!("oc_target.row_pitch of {row_pitch} bytes is below a row's {row}"));
        }
        let need = u64::from(height - 1).checked_mul(row_pitch).and_then(|b| b.checked_add(row));
        match need {
            Some(need) if need <= target.size && target.size <= isize::MAX as u64 => {
                Ok(Self { memory: target.memory.cast(), row_pitch: row_pitch as usize, pixel })
            }
            _ => bad(format!("oc_target.size of {} bytes is too small for {width} x {height}", target.size)),
        }
    }
}

impl Target for HostTarget {
    fn write(&self, x: u32, y: u32, pixels: &[u8]) {
        // SAFETY: `new` found that all rows fit; the frame writes pixels inside the picture only.
        unsafe {
            let at = self.memory.add(y as usize * self.row_pitch + x as usize * self.pixel);
            at.copy_from_nonoverlapping(pixels.as_ptr(), pixels.len());
        }
    }
}

/// Keeps a buffer of a complete picture readable.
pub struct oc_mapping {
    _private: [u8; 0],
}

handle!(oc_mapping, MappingObject, 6);

pub(crate) struct MappingObject {
    _mapped: Mapped,
}

/// A buffer of a complete picture.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_pixels {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// An OC_FORMAT_ number.
    pub format: oc_format,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The first pixel of the first row, aligned for its elements; nobody writes there.
    pub data: *const c_void,
    /// Bytes from a row to the next.
    pub row_pitch: u64,
    /// Bytes in all.
    pub size: u64,
    /// Keeps `data` alive: release it when done.
    pub mapping: *mut oc_mapping,
}

// SAFETY: `repr(C)`, words and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_pixels {
    const NAME: &'static str = "oc_pixels";
}

/// Maps a buffer of the last complete picture, without a copy. It stays whole and readable until the mapping
/// is released, whatever the frame does meanwhile, even if the frame is released.
///
/// OC_STATUS_INVALID_STATE before a picture is complete, or if the frame does not keep this buffer.
/// Ownership: the caller owns a count of `out_pixels->mapping`. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_pixels` initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_frame_map(
    frame: *const oc_frame,
    buffer: oc_buffer,
    out_pixels: *mut oc_pixels,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_pixels)?;
        let buffer = self::buffer(buffer)?;
        handles::with(frame, |frame: &Shell<FrameObject>| {
            let mapped = frame.frame.map(buffer)?;
            let mut pixels = oc_pixels {
                struct_size: 0,
                format: format(buffer),
                width: mapped.width(),
                height: mapped.height(),
                data: mapped.bytes().as_ptr().cast(),
                row_pitch: mapped.row_pitch() as u64,
                size: mapped.bytes().len() as u64,
                mapping: std::ptr::null_mut(),
            };
            pixels.mapping = handles::give::<oc_mapping>(MappingObject { _mapped: mapped });
            fill.with(pixels);
            Ok(())
        })
    })
}

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_mapping_retain(mapping: *mut oc_mapping) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(mapping) }
}

/// Takes a count back; with the last one the pixels may go. NULL does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_mapping_release(mapping: *mut oc_mapping) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(mapping) }
}
