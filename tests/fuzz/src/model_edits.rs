//! A grammar of edits of a model file whose checksums are right afterwards.
//!
//! Edits of the content (blocks, references between blocks, rows of tables) go through the writer, which refuses some
//! of them. Edits of the written bytes come after it, and [`reseal`] corrects all checksums over them.

use super::base_models::{self, Content};
use super::files;
use arbitrary::{Result, Unstructured};
use outcrop::store::contents::{KINDS, ROW_LEN, TABLE_LEN};
use outcrop::store::{PartSets, Writer};
use xxhash_rust::xxh3::xxh3_64;

/// Counts and sizes that code must not trust.
const NUMBERS: [u64; 20] = [
    0,
    1,
    2,
    3,
    7,
    8,
    63,
    64,
    255,
    256,
    65535,
    65536,
    1 << 20,
    1 << 24,
    1 << 31,
    u32::MAX as u64 - 1,
    u32::MAX as u64,
    1 << 40,
    u64::MAX / 2,
    u64::MAX,
];
const FLOATS: [f64; 14] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-300,
    1e300,
    f64::MAX,
    f64::MIN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
    1e-40,
    3.5e38,
    1e15,
];
/// Most blocks of an edited file.
const MOST_BLOCKS: usize = 300;

/// Returns the bytes of an edited model file; `None` if the format has no such file.
pub fn edited(u: &mut Unstructured) -> Result<Option<Vec<u8>>> {
    let base = u.int_in_range(0..=base_models::COUNT - 1)?;
    let mut content = Content::of(base);
    for _ in 0..u.int_in_range(0..=6)? {
        edit(&mut content, u)?;
    }
    let Some(mut bytes) = written(&content) else { return Ok(None) };
    for _ in 0..u.int_in_range(0..=3)? {
        patch(&mut bytes, u)?;
    }
    if u.ratio(1, 16)? {
        // Without right checksums.
        let at = u.choose_index(bytes.len())?;
        bytes[at] ^= u.arbitrary::<u8>()?;
    }
    if u.ratio(1, 32)? {
        bytes.truncate(u.int_in_range(0..=bytes.len())?);
    }
    Ok(Some(bytes))
}

fn written(content: &Content) -> Option<Vec<u8>> {
    let path = files::path("edited.oc");
    let mut writer = Writer::create(&path).expect("a file");
    for (payload, decoded_len) in &content.blocks {
        writer.block(payload, *decoded_len).ok()?;
    }
    let mut sets = PartSets::default();
    for set in &content.part_sets {
        sets.push(set.iter().copied()).ok()?;
    }
    writer.set_part_sets(sets);
    let Content { header, parts, materials, instances, trees, .. } = content;
    writer.finish(header, parts, materials, instances, trees).ok()?;
    Some(std::fs::read(&path).expect("the file"))
}

fn number(u: &mut Unstructured) -> Result<u64> {
    Ok(if u.ratio(1, 4)? { u.arbitrary()? } else { *u.choose(&NUMBERS)? })
}

/// A number near `old`, or any.
fn near(u: &mut Unstructured, old: u64) -> Result<u64> {
    Ok(match u.int_in_range(0..=4)? {
        0 => old.wrapping_add(1),
        1 => old.wrapping_sub(1),
        2 => old.wrapping_mul(2),
        _ => number(u)?,
    })
}

fn float(u: &mut Unstructured) -> Result<f64> {
    Ok(if u.ratio(1, 4)? { u.arbitrary()? } else { *u.choose(&FLOATS)? })
}

fn edit(c: &mut Content, u: &mut Unstructured) -> Result<()> {
    let geometry = (c.header.geometry_blocks as usize).min(c.blocks.len());
    match u.int_in_range(0..=11)? {
        0..=2 if geometry > 0 => {
            let block = if u.ratio(3, 4)? { u.choose_index(geometry)? } else { u.choose_index(c.blocks.len())? };
            payload(&mut c.blocks[block].0, u)?;
        }
        3 | 4 if geometry > 0 => {
            let block = u.choose_index(geometry)?;
            let to = (u.int_in_range(0..=geometry as u32)?, u.int_in_range(0..=40)?);
            refer(&mut c.blocks[block].0, u, to)?;
        }
        5 if geometry > 0 => {
            let (a, b) = (u.choose_index(c.blocks.len())?, u.choose_index(c.blocks.len())?);
            match u.int_in_range(0..=2)? {
                0 => c.blocks.swap(a, b),
                1 => c.blocks[a] = c.blocks[b].clone(),
                _ => c.blocks[a].1 = near(u, c.blocks[a].1.into())? as u32,
            }
        }
        6 | 7 if geometry > 0 => again(c, u.choose_index(geometry)?, u.int_in_range(1..=16)?),
        8 if !c.trees.is_empty() => tree(c, u)?,
        9 => header(c, u)?,
        10 => rows(c, u)?,
        _ if !c.parts.is_empty() => {
            let at = u.choose_index(c.parts.len())?;
            let part = &mut c.parts[at];
            match u.int_in_range(0..=5)? {
                0 => part.id = number(u)?,
                1 => part.parent = Some(near(u, at as u64)? as u32),
                2 => part.material = number(u)? as u32,
                3 => part.bounds[u.int_in_range(0..=5)?] = float(u)?,
                4 => part.triangles = near(u, part.triangles)?,
                _ => part.name = "n".repeat(u.int_in_range(0..=3000)?),
            }
        }
        _ => {}
    }
    Ok(())
}

/// Changes bytes of a payload, more often near its beginning, where counts are.
fn payload(bytes: &mut Vec<u8>, u: &mut Unstructured) -> Result<()> {
    let within = if u.arbitrary()? { bytes.len() } else { bytes.len().min(24) };
    if within == 0 {
        return Ok(());
    }
    let at = u.choose_index(within)?;
    match u.int_in_range(0..=5)? {
        0 => bytes[at] = u.arbitrary()?,
        1 => bytes[at] ^= 1 << u.int_in_range(0..=7)?,
        2 => {
            let number = number(u)?.to_le_bytes();
            let len = (*u.choose(&[1, 2, 4])?).min(bytes.len() - at);
            bytes[at..at + len].copy_from_slice(&number[..len]);
        }
        3 => {
            let end = (at + u.int_in_range(1..=16)?).min(bytes.len());
            bytes.drain(at..end);
        }
        4 => {
            let some = vec![u.arbitrary()?; u.int_in_range(1..=64)?];
            bytes.splice(at..at, some);
        }
        _ => {
            let value: u8 = u.arbitrary()?;
            let end = (at + u.int_in_range(1..=64)?).min(bytes.len());
            bytes[at..end].fill(value);
        }
    }
    Ok(())
}

/// Points an external reference of a block of nodes to another node of another block (FORMAT.md, "Nodes").
fn refer(bytes: &mut [u8], u: &mut Unstructured, to: (u32, u32)) -> Result<()> {
    let count = |at: usize| bytes.get(at..at + 2).map(|b| usize::from(u16::from_le_bytes([b[0], b[1]])));
    let (Some(nodes), Some(externals)) = (count(1), count(3)) else { return Ok(()) };
    let masks = 7 + 12 * nodes + 3 * nodes;
    let children =
        bytes.get(masks..masks + nodes).map(|masks| masks.iter().map(|m| m.count_ones() as usize).sum::<usize>());
    let Some(children) = children.filter(|_| externals > 0) else { return Ok(()) };
    let first = masks + nodes + 6 * children + 2 * nodes;
    let which = u.choose_index(externals)?;
    for (start, number) in [(first, to.0), (first + 4 * externals, to.1)] {
        for (byte, value) in number.to_le_bytes().into_iter().enumerate() {
            if let Some(place) = bytes.get_mut(start + byte * externals + which) {
                *place = value;
            }
        }
    }
    Ok(())
}

/// Inserts copies of a geometry block behind it, with its ids and colours, as coarse blocks of its tree.
fn again(c: &mut Content, block: usize, copies: usize) {
    let geometry = c.header.geometry_blocks as usize;
    let streams = c.header.block_count() as usize / geometry.max(1);
    if c.blocks.len() != geometry * streams || c.blocks.len() + copies * streams > MOST_BLOCKS {
        return;
    }
    for stream in (0..streams).rev() {
        let at = stream * geometry + block;
        let copy = c.blocks[at].clone();
        c.blocks.splice(at..at, vec![copy; copies]);
    }
    c.header.geometry_blocks += copies as u32;
    if let Some(set) = c.part_sets.get(block).cloned() {
        c.part_sets.splice(block..block, vec![set; copies]);
    }
    for tree in &mut c.trees {
        let first = tree.first_block as usize;
        if first > block {
            tree.first_block = tree.first_block.wrapping_add(copies as u32);
        } else if block < first + tree.block_count as usize {
            tree.block_count = tree.block_count.wrapping_add(copies as u32);
            tree.class_blocks[0] = tree.class_blocks[0].wrapping_add(copies as u32);
        }
    }
}

fn tree(c: &mut Content, u: &mut Unstructured) -> Result<()> {
    let at = u.choose_index(c.trees.len())?;
    let tree = &mut c.trees[at];
    match u.int_in_range(0..=12)? {
        0 => tree.first_block = near(u, tree.first_block.into())? as u32,
        1 => tree.block_count = near(u, tree.block_count.into())? as u32,
        2 => {
            let class = u.int_in_range(0..=3)?;
            tree.class_blocks[class] = near(u, tree.class_blocks[class].into())? as u32;
        }
        3 => tree.root = near(u, tree.root.into())? as u32,
        4 => tree.origin[u.int_in_range(0..=2)?] = float(u)?,
        5 => tree.bounds[u.int_in_range(0..=5)?] = float(u)? as f32,
        6 => tree.triangles = near(u, tree.triangles)?,
        7 => tree.references = near(u, tree.references)?,
        8 => tree.nodes = near(u, tree.nodes)?,
        9 => tree.leaves = near(u, tree.leaves)?,
        10 => tree.position_error = float(u)?,
        11 => tree.local_parts = near(u, tree.local_parts.into())? as u32,
        _ => tree.max_stack = near(u, tree.max_stack.into())? as u32,
    }
    Ok(())
}

fn header(c: &mut Content, u: &mut Unstructured) -> Result<()> {
    let header = &mut c.header;
    match u.int_in_range(0..=8)? {
        // The header's structure alone decides nothing.
        0 => {
            header.structure = number(u)? as u32;
            c.trees.iter_mut().take(1).for_each(|tree| tree.structure = header.structure);
        }
        1 => header.block_size = *u.choose(&[1024, 4096, 65536, 1 << 20, 1 << 24])?,
        2 => header.metres_per_unit = float(u)?,
        3 => header.up = number(u)? as u32,
        4 => header.bounds[u.int_in_range(0..=5)?] = float(u)?,
        5 => header.triangles_in = number(u)?,
        6 => header.triangles_kept = near(u, header.triangles_kept)?,
        7 => header.geometry_blocks = near(u, header.geometry_blocks.into())? as u32,
        _ => header.has_colours = !header.has_colours,
    }
    Ok(())
}

/// Changes or repeats rows of the other tables.
fn rows(c: &mut Content, u: &mut Unstructured) -> Result<()> {
    match u.int_in_range(0..=5)? {
        0 if !c.instances.is_empty() => {
            let at = u.choose_index(c.instances.len())?;
            let row = &mut c.instances[at];
            match u.int_in_range(0..=2)? {
                0 => row.tree = near(u, row.tree.into())? as u32,
                1 => row.first_part = near(u, row.first_part.into())? as u32,
                _ => row.world_from_mesh[u.int_in_range(0..=11)?] = float(u)?,
            }
        }
        1 if !c.instances.is_empty() => {
            let row = c.instances[u.choose_index(c.instances.len())?];
            c.instances.extend(vec![row; u.int_in_range(1..=2000)?]);
        }
        2 if !c.parts.is_empty() => {
            let row = c.parts[u.choose_index(c.parts.len())?].clone();
            c.parts.extend(vec![row; u.int_in_range(1..=2000)?]);
        }
        3 if !c.trees.is_empty() => {
            let row = c.trees[u.choose_index(c.trees.len())?];
            c.trees.push(row);
        }
        4 if !c.part_sets.is_empty() => {
            let at = u.choose_index(c.part_sets.len())?;
            match u.int_in_range(0..=3)? {
                0 => c.part_sets[at].clear(),
                1 => c.part_sets[at].push(number(u)? as u32),
                2 => c.part_sets.truncate(at),
                _ => c.part_sets[at] = (0..u.int_in_range(1..=5)?).collect(),
            }
        }
        _ => c.materials.truncate(u.int_in_range(0..=1)?),
    }
    Ok(())
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..at.checked_add(8)?)?.try_into().ok().map(u64::from_le_bytes)
}

/// Changes bytes of a written file, of its header, its directory, another section, the section table or a stored
/// block, and corrects the checksums.
fn patch(bytes: &mut [u8], u: &mut Unstructured) -> Result<()> {
    let table = u64_at(bytes, 24).unwrap_or(0) as usize;
    let section =
        |row: usize, member: usize| u64_at(bytes, table.saturating_add(ROW_LEN * row + member)).unwrap_or(0) as usize;
    let (start, len) = match u.int_in_range(0..=5)? {
        0 => (8, 240),
        1 => (section(0, 16), section(0, 24)),
        2 => {
            let row = u.int_in_range(1..=KINDS.len() - 1)?;
            (section(row, 16), section(row, 24))
        }
        3 => (table, TABLE_LEN),
        4 => (256, section(0, 16).saturating_sub(256)),
        _ => (0, bytes.len()),
    };
    if len == 0 || start.saturating_add(len) > bytes.len() {
        return Ok(());
    }
    let at = start + u.choose_index(len)?;
    let at = if u.arbitrary()? { at / 4 * 4 } else { at };
    let value = if u.arbitrary()? { number(u)? } else { near(u, u64_at(bytes, at).unwrap_or(0))? };
    let size = (*u.choose(&[1, 1, 2, 4, 8])?).min(bytes.len() - at);
    bytes[at..at + size].copy_from_slice(&value.to_le_bytes()[..size]);
    reseal(bytes);
    Ok(())
}

/// Corrects all checksums, from the blocks to the footer, as far as the offsets lie in the file.
pub fn reseal(bytes: &mut [u8]) {
    let len = bytes.len();
    let Some(table) = u64_at(bytes, 24).map(|at| at as usize).filter(|&at| at <= len.saturating_sub(TABLE_LEN + 32))
    else {
        return;
    };
    let range = |bytes: &[u8], at: u64, size: u64| {
        let end = at.checked_add(size).filter(|&end| end <= len as u64)?;
        Some(xxh3_64(&bytes[at as usize..end as usize]))
    };
    let (directory, directory_len) = (u64_at(bytes, table + 16).unwrap_or(0), u64_at(bytes, table + 24).unwrap_or(0));
    if directory.checked_add(directory_len).is_some_and(|end| end <= len as u64) {
        for row in (directory as usize..(directory + directory_len) as usize).step_by(32) {
            let stored = u64_at(bytes, row + 8).unwrap_or(0) & 0xffff_ffff;
            if let Some(sum) = range(bytes, u64_at(bytes, row).unwrap_or(0), stored) {
                put(bytes, row + 24, sum);
            }
        }
    }
    for row in (0..KINDS.len()).map(|row| table + ROW_LEN * row) {
        let (at, size) = (u64_at(bytes, row + 16).unwrap_or(0), u64_at(bytes, row + 24).unwrap_or(0));
        if let Some(sum) = range(bytes, at, size) {
            put(bytes, row + 32, sum);
        }
    }
    put(bytes, 32, xxh3_64(&bytes[table..table + TABLE_LEN]));
    put(bytes, 248, xxh3_64(&bytes[..248]));
    put(bytes, len - 16, xxh3_64(&bytes[..256]));
    put(bytes, len - 8, xxh3_64(&bytes[len - 32..len - 8]));
}

fn put(bytes: &mut [u8], at: usize, value: u64) {
    if let Some(place) = bytes.get_mut(at..at + 8) {
        place.copy_from_slice(&value.to_le_bytes());
    }
}
