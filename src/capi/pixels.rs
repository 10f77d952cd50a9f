//! Buffers of a picture: mapped, or in the caller's memory.

use super::frame::{FrameObject, oc_frame};
use super::guard::{Checked, Fill, Sized32, bad, boundary, reserved};
use super::handles::{self, Shell, handle};
use super::status::oc_status;
use crate::render::{Buffer, Mapped, Target};
use std::ffi::c_void;

/// Buffer of a picture. The first row is the top one, the first pixel of a row the left one.
pub type oc_buffer = u32;
/// 4 bytes: red, green and blue in sRGB, and linear alpha.
pub const OC_BUFFER_COLOUR_SRGB8: oc_buffer = 0;
/// 4 floats: linear RGB, not clamped, and alpha.
pub const OC_BUFFER_COLOUR_LINEAR: oc_buffer = 1;
/// 1 float: distance from the eye along the view direction, in world units. Miss: infinity.
pub const OC_BUFFER_DEPTH: oc_buffer = 2;
/// 3 floats: unit geometric normal in world space, on the side of the eye. Miss: 0.
pub const OC_BUFFER_NORMAL: oc_buffer = 3;
/// 1 uint64_t: id of the part. Miss: OC_NO_ID.
pub const OC_BUFFER_PART: oc_buffer = 4;
/// 1 uint64_t: as oc_hit.prim. OC_NO_ID for a miss, for a stand-in, and in early pictures for a triangle whose id is
/// not read yet.
pub const OC_BUFFER_PRIM: oc_buffer = 5;
/// 1 uint64_t: id of the instance. Miss: OC_NO_ID.
pub const OC_BUFFER_INSTANCE: oc_buffer = 6;
/// 1 byte: one of the OC_HIT_ constants.
pub const OC_BUFFER_KIND: oc_buffer = 7;
/// 1 float: an original surface lies within this distance of the surface shown, in world units. Infinity if stand-ins
/// have transmitted the ray to a triangle or to the background: an original surface may lie anywhere before it.
pub const OC_BUFFER_ERROR: oc_buffer = 8;
/// 3 floats: unit normal in world space with which the surface is shaded, see `oc_hit.shading_normal`. Miss: 0.
pub const OC_BUFFER_SHADING_NORMAL: oc_buffer = 9;
/// 1 uint64_t: number of the place where the mesh of an instance was met, by a triangle or a stand-in, below 2^63; see
/// `oc_hit.occurrence`. oc_scene_get_path returns the ids on the way there. It holds for the commit that the picture
/// shows: after a later commit of the scene it may stand for another place, or for none. Miss: OC_NO_ID.
pub const OC_BUFFER_OCCURRENCE: oc_buffer = 10;
/// 2 floats: as oc_hit.uv of the ray through the pixel's centre. Miss: 0.
pub const OC_BUFFER_UV: oc_buffer = 11;

/// Type of the elements of a buffer.
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
/// 2 floats.
pub const OC_FORMAT_F32X2: oc_format = 7;

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
        Buffer::Normal | Buffer::ShadingNormal => OC_FORMAT_F32X3,
        Buffer::Part | Buffer::Primitive | Buffer::Instance | Buffer::Occurrence => OC_FORMAT_U64,
        Buffer::Kind => OC_FORMAT_U8,
        Buffer::Uv => OC_FORMAT_F32X2,
    }
}

/// The caller's memory for a buffer. Element of an array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_target {
    /// First pixel of the first row. The library writes to it from any thread while the frame renders. It holds a
    /// complete picture after a request has ended as OC_STATE_DONE or OC_STATE_COMPLETE_WITHIN_BUDGET; a request that
    /// is cancelled or replaced may leave it incomplete. The memory must stay valid until the frame is released or
    /// resized.
    pub memory: *mut c_void,
    /// Size of the memory in bytes.
    pub size: u64,
    /// Bytes from one row to the next. 0: tightly packed.
    pub row_pitch: u64,
    /// One of the OC_BUFFER_ constants.
    pub buffer: oc_buffer,
    /// Must be 0.
    pub reserved: u32,
}

/// The caller's memory, as a [`Target`] of the crate.
pub(crate) struct HostTarget {
    memory: *mut u8,
    row_pitch: usize,
    pixel: usize,
}

// SAFETY: the header says that any thread may write to the memory.
unsafe impl Send for HostTarget {}
// SAFETY: as above. Two simultaneous writes never go to the same pixels.
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
            return bad(format!("oc_target.row_pitch of {row_pitch} bytes is less than the {row} bytes of a row"));
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
        // SAFETY: `new` checked that all rows fit. The frame only writes pixels inside of the picture.
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

/// A mapped buffer of a complete picture.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_pixels {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// One of the OC_FORMAT_ constants.
    pub format: oc_format,
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// First pixel of the first row, aligned for its type. The content does not change while it is mapped.
    pub data: *const c_void,
    /// Bytes from one row to the next.
    pub row_pitch: u64,
    /// Size of the buffer in bytes.
    pub size: u64,
    /// Keeps `data` valid. Release it with oc_mapping_release.
    pub mapping: *mut oc_mapping,
}

// SAFETY: `repr(C)`, integers and pointers without padding, `struct_size` first.
unsafe impl Sized32 for oc_pixels {
    const NAME: &'static str = "oc_pixels";
}

/// Maps a buffer of the last complete picture, without a copy. The content stays valid and unchanged until the mapping
/// is released, even if the frame renders other pictures or is released.
///
/// - `buffer`: one of the OC_BUFFER_ constants.
/// - `out_pixels`: receives the buffer. Initialise it with OC_INIT.
///
/// Errors:
/// - OC_STATUS_INVALID_ARGUMENT: there is no such buffer.
/// - OC_STATUS_INVALID_STATE: no picture is complete yet, or `buffers` of oc_frame_desc does not name this buffer. A
///   target alone does not suffice.
///
/// Ownership: the caller receives one reference to `out_pixels->mapping`.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `frame` is a live handle; `out_pixels` is initialised.
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

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `mapping` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_mapping_retain(mapping: *mut oc_mapping) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(mapping) }
}

/// Releases one reference. After the last release the pixels must not be read any more. NULL: does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `mapping` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_mapping_release(mapping: *mut oc_mapping) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(mapping) }
}
