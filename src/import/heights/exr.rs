//! OpenEXR maps, block by block. The crate `image` reads none but those with the channels R, G and B; maps of heights
//! mostly have one.

use super::Map;
use crate::base::progress::Cancel;
use crate::import::decode::{cannot_decode, cannot_read};
use crate::import::input::{Fault, Parsed};
use ::exr::block::lines::LineRef;
use ::exr::block::reader::ChunksReader;
use ::exr::meta::attribute::{ChannelDescription, SampleType};
use ::exr::meta::header::Header;
use ::exr::prelude::f16;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Greatest size of a decompressed block in bytes: a header may state any.
const MAX_BLOCK: usize = 512 << 20;

/// Decodes the channel Y, or R, or else the first that is not A, of the first layer with one, at full resolution.
/// Channels of half and single precision and of integers are read, from scan lines or tiles.
pub(super) fn decode(bytes: &[u8], cancel: &Cancel) -> Parsed<Map> {
    // The decoder's checks of damaged files are not complete: some end in a panic.
    let decoded = catch_unwind(AssertUnwindSafe(|| decode_checked(bytes, cancel)));
    decoded.unwrap_or_else(|_| Err("a picture cannot be decoded: it is damaged".into()))
}

fn decode_checked(bytes: &[u8], cancel: &Cancel) -> Parsed<Map> {
    let reader = ::exr::block::read(Cursor::new(bytes), false).map_err(cannot_read)?;
    let found = reader.headers().iter().enumerate().find_map(|(layer, header)| Some((layer, header, channel(header)?)));
    let (layer, header, channel) = found.ok_or("a picture has no layer with a channel of heights")?;
    if header.max_block_byte_size() > MAX_BLOCK {
        return Err("a picture cannot be decoded: its blocks are too large".into());
    }
    let side = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
    let mut map = Map::new(side(header.layer_size.width()), side(header.layer_size.height()))?;
    let (channels, kind) = (header.channels.clone(), header.channels.list[channel].sample_type);
    let is_wanted = |block: ::exr::block::BlockIndex| block.layer == layer && block.level.0 == 0 && block.level.1 == 0;
    let chunks = reader.filter_chunks(false, |_, _, block| is_wanted(block)).map_err(cannot_read)?;
    let mut blocks = chunks.sequential_decompressor(false);
    while let Some(block) = blocks.decompress_next_block() {
        cancel.check()?;
        let block = block.map_err(cannot_decode)?;
        for line in block.lines(&channels).filter(|line| line.location.channel == channel) {
            copy(&mut map, &line, kind)?;
        }
    }
    Ok(map)
}

/// The index of the channel of heights.
fn channel(header: &Header) -> Option<usize> {
    let all = &header.channels.list;
    let is_named = |channel: &ChannelDescription, name: &str| channel.name.eq_case_insensitive(name);
    let named = |name| all.iter().position(|channel| is_named(channel, name));
    let other = || all.iter().position(|channel| !is_named(channel, "A"));
    let found = named("Y").or_else(|| named("R")).or_else(other).filter(|_| !header.deep)?;
    let sampling = all[found].sampling;
    (sampling.0 == 1 && sampling.1 == 1).then_some(found)
}

/// Copies the samples of a line to their place.
fn copy(map: &mut Map, line: &LineRef<'_>, kind: SampleType) -> Parsed<()> {
    let (x, y, count) = (line.location.position.x(), line.location.position.y(), line.location.sample_count);
    let outside = || Fault::from("a picture cannot be decoded: a block is outside of it");
    if y >= map.height as usize {
        return Err(outside());
    }
    let out = map.row(y as u32).get_mut(x..).and_then(|row| row.get_mut(..count)).ok_or_else(outside)?;
    match kind {
        SampleType::F32 => out.iter_mut().zip(line.read_samples::<f32>()).try_for_each(|(to, s)| s.map(|s| *to = s)),
        SampleType::F16 => {
            out.iter_mut().zip(line.read_samples::<f16>()).try_for_each(|(to, s)| s.map(|s| *to = s.to_f32()))
        }
        SampleType::U32 => {
            out.iter_mut().zip(line.read_samples::<u32>()).try_for_each(|(to, s)| s.map(|s| *to = s as f32))
        }
    }
    .map_err(cannot_decode)
}
