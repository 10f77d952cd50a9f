//! The encoding of a batch in a scratch file: some ten bytes per triangle of a scan, compared to 44 in memory. After
//! the first four bytes everything is one LZ4 block. In the order of the bytes before compression:
//!
//! | bytes | content |
//! |---|---|
//! | 4 | u32: number of the following bytes |
//! | 4, 4 | u32: number of triangles, number of distinct vertices |
//! | 1 | bit 0: double precision; bit 1: colours; bit 2: normals |
//! | .. | parts, as runs of equal numbers; two varints per run: part, length |
//! | .. | primitive ids, as runs of consecutive numbers; two varints per run: numbers skipped, length |
//! | .. | corners, three varints per triangle: 0 for a new vertex, else the distance back to a known vertex |
//! | .. | x of the vertices, then y, then z: difference to the one before, ordered integers, zigzag, in byte planes |
//! | 12 x triangles | colours, corner by corner, channel by channel |
//! | 3 x triangles | for each corner: 1 for a normal other than the last one at its vertex, else 0 |
//! | 4 x such corners | their normals, in byte planes |

use super::batch::{Batch, Positions};
use super::values::Values;
use crate::base::bytes::{push_varint, take_varint};
use bytemuck::must_cast;
use glam::{DVec3, Vec3};
use lz4_flex::block;

const DOUBLE: u8 = 1;
const COLOURS: u8 = 2;
const NORMALS: u8 = 4;

/// A coordinate as an unsigned integer. The integers have the order of the coordinates.
trait Coordinate: Copy {
    /// Number of bytes.
    const LEN: usize;
    fn ordered(self) -> u64;
    fn from_ordered(value: u64) -> Self;
    /// Difference of two coordinates, in as many bytes as a coordinate; small if both are near.
    fn difference(now: u64, before: u64) -> u64;
    fn undo_difference(coded: u64, before: u64) -> u64;
}

impl Coordinate for f32 {
    const LEN: usize = 4;
    fn ordered(self) -> u64 {
        let bits = self.to_bits();
        u64::from(if bits >> 31 == 0 { bits | 1 << 31 } else { !bits })
    }
    fn from_ordered(value: u64) -> Self {
        let value = value as u32;
        f32::from_bits(if value >> 31 == 1 { value & !(1 << 31) } else { !value })
    }
    fn difference(now: u64, before: u64) -> u64 {
        let d = (now as u32).wrapping_sub(before as u32) as i32;
        u64::from((d << 1 ^ d >> 31) as u32)
    }
    fn undo_difference(coded: u64, before: u64) -> u64 {
        let coded = coded as u32;
        u64::from((before as u32).wrapping_add((coded >> 1) ^ (coded & 1).wrapping_neg()))
    }
}

impl Coordinate for f64 {
    const LEN: usize = 8;
    fn ordered(self) -> u64 {
        let bits = self.to_bits();
        if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
    }
    fn from_ordered(value: u64) -> Self {
        f64::from_bits(if value >> 63 == 1 { value & !(1 << 63) } else { !value })
    }
    fn difference(now: u64, before: u64) -> u64 {
        let d = now.wrapping_sub(before) as i64;
        (d << 1 ^ d >> 63) as u64
    }
    fn undo_difference(coded: u64, before: u64) -> u64 {
        before.wrapping_add((coded >> 1) ^ (coded & 1).wrapping_neg())
    }
}

/// Encodes a batch. The same batch gives the same bytes on every machine.
pub fn encode(batch: &Batch) -> Vec<u8> {
    let count = batch.positions.len();
    let mut out = Vec::with_capacity(count * 16);
    out.extend((count as u32).to_le_bytes());
    // Number of vertices, which is known later.
    out.extend([0; 4]);
    let double = if matches!(batch.positions, Positions::Double(_)) { DOUBLE } else { 0 };
    let Values { colours, normals } = &batch.values;
    let flag = |is_empty: bool, flag: u8| if is_empty { 0 } else { flag };
    out.push(double | flag(colours.is_empty(), COLOURS) | flag(normals.is_empty(), NORMALS));
    push_parts(&mut out, &batch.parts);
    push_prims(&mut out, &batch.prims);
    let vertices = match &batch.positions {
        Positions::Single(p) => push_positions(&mut out, count, |i| p[i].map(|c| c.to_array())),
        Positions::Double(p) => push_positions(&mut out, count, |i| p[i].map(|c| c.to_array())),
    };
    out[4..8].copy_from_slice(&vertices.count.to_le_bytes());
    (0..12).for_each(|byte| out.extend(colours.iter().map(|c| c.as_flattened()[byte])));
    push_normals(&mut out, normals, &vertices);
    block::compress_prepend_size(&out)
}

/// The vertices of a batch.
struct Numbered {
    count: u32,
    /// Vertex of each corner.
    corners: Vec<u32>,
}

fn push_normals(out: &mut Vec<u8>, normals: &[[u32; 3]], vertices: &Numbered) {
    if normals.is_empty() {
        return;
    }
    let mut last = vec![NONE; vertices.count as usize];
    let mut new = Vec::new();
    for (&normal, &vertex) in normals.as_flattened().iter().zip(&vertices.corners) {
        let last = &mut last[vertex as usize];
        out.push(u8::from(*last != normal));
        if *last != normal {
            *last = normal;
            new.push(normal);
        }
    }
    (0..4).for_each(|byte| out.extend(new.iter().map(|n| (n >> (8 * byte)) as u8)));
}

/// A code that no normal has (`math::octahedral`).
const NONE: u32 = u32::MAX;

fn push_parts(out: &mut Vec<u8>, parts: &[u32]) {
    for run in parts.chunk_by(|a, b| a == b) {
        push_varint(out, run[0]);
        push_varint(out, run.len() as u32);
    }
}

fn push_prims(out: &mut Vec<u8>, prims: &[u32]) {
    let mut next = 0u32;
    for run in prims.chunk_by(|a, b| a.wrapping_add(1) == *b) {
        push_varint(out, run[0].wrapping_sub(next));
        push_varint(out, run.len() as u32);
        next = run[0].wrapping_add(run.len() as u32);
    }
}

/// Writes corners and vertices. Returns the vertices.
fn push_positions<C: Coordinate>(out: &mut Vec<u8>, count: usize, triangle: impl Fn(usize) -> [[C; 3]; 3]) -> Numbered {
    let mut corners = Vec::with_capacity(3 * count);
    let mut vertices: Vec<[u64; 3]> = Vec::with_capacity(count);
    // The last vertex with each hash. A vertex whose entry was overwritten is written again, which is rare and
    // harmless.
    let bits = (usize::BITS - (2 * count).leading_zeros()).max(4);
    let mut last = vec![0u32; 1 << bits];
    for corner in (0..count).flat_map(&triangle) {
        let vertex = corner.map(C::ordered);
        let slot = &mut last[hash(vertex) >> (64 - bits)];
        let index = *slot as usize;
        if index < vertices.len() && vertices[index] == vertex {
            push_varint(out, (vertices.len() - index) as u32);
            corners.push(index as u32);
        } else {
            corners.push(vertices.len() as u32);
            *slot = vertices.len() as u32;
            out.push(0);
            vertices.push(vertex);
        }
    }
    for axis in 0..3 {
        let start = out.len();
        out.resize(start + C::LEN * vertices.len(), 0);
        let planes = &mut out[start..];
        let mut before = 0;
        for (i, vertex) in vertices.iter().enumerate() {
            let coded = C::difference(vertex[axis], before);
            before = vertex[axis];
            (0..C::LEN).for_each(|p| planes[p * vertices.len() + i] = (coded >> (8 * p)) as u8);
        }
    }
    Numbered { count: vertices.len() as u32, corners }
}

fn hash([x, y, z]: [u64; 3]) -> usize {
    // Odd constants without a pattern.
    let sum = x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F).rotate_left(21);
    ((sum ^ z).wrapping_mul(0x2545_F491_4F6C_DD1D)) as usize
}

/// Bytes that are being read. The methods return `None` at the end.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(taken)
    }
    fn u32(&mut self) -> Option<u32> {
        self.take(4)?.first_chunk().map(|b| u32::from_le_bytes(*b))
    }
    fn varint(&mut self) -> Option<u32> {
        take_varint(&mut self.0)
    }
}

/// Returns the batch that [`encode`] encoded, and mostly `None` for other bytes.
pub fn decode(bytes: &[u8]) -> Option<Batch> {
    let raw = block::decompress_size_prepended(bytes).ok()?;
    let mut reader = Reader(&raw);
    let (count, vertices) = (reader.u32()? as usize, reader.u32()? as usize);
    let flags = reader.take(1)?[0];
    let parts = read_runs(&mut reader, count, |part, _| (part, 0))?;
    let mut next = 0u32;
    let prims = read_runs(&mut reader, count, |skipped, length| {
        let first = next.wrapping_add(skipped);
        next = first.wrapping_add(length);
        (first, 1)
    })?;
    let numbered = read_corners(&mut reader, count, vertices)?;
    let positions = if flags & DOUBLE == 0 {
        let points = read_positions(&mut reader, &numbered)?;
        Positions::Single(points.into_iter().map(must_cast::<[[f32; 3]; 3], [Vec3; 3]>).collect())
    } else {
        let points = read_positions::<f64>(&mut reader, &numbered)?;
        Positions::Double(points.into_iter().map(|t| t.map(DVec3::from_array)).collect())
    };
    let mut values = Values::default();
    if flags & COLOURS != 0 {
        let planes = reader.take(count.checked_mul(12)?)?;
        let byte = |i: usize, corner: usize, channel: usize| planes[(4 * corner + channel) * count + i];
        let colours = |i: usize| [0, 1, 2].map(|corner| [0, 1, 2, 3].map(|channel| byte(i, corner, channel)));
        values.colours = (0..count).map(colours).collect();
    }
    if flags & NORMALS != 0 {
        values.normals = read_normals(&mut reader, &numbered)?;
    }
    reader.0.is_empty().then_some(Batch { positions, parts, prims, values })
}

fn read_normals(reader: &mut Reader, vertices: &Numbered) -> Option<Vec<[u32; 3]>> {
    let is_new = reader.take(vertices.corners.len())?;
    let new = is_new.iter().filter(|&&flag| flag != 0).count();
    let planes = reader.take(4 * new)?;
    let normal = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|byte| planes[byte * new + i]));
    let (mut last, mut at) = (vec![NONE; vertices.count as usize], 0);
    let mut out = Vec::with_capacity(is_new.len());
    for (&vertex, &is_new) in vertices.corners.iter().zip(is_new) {
        if is_new != 0 {
            last[vertex as usize] = normal(at);
            at += 1;
        }
        out.push(last[vertex as usize]);
    }
    Some(out.as_chunks().0.to_vec())
}

/// Reads numbers in runs. `run` returns the first number of a run and the step to the next one, from the run's two
/// varints.
fn read_runs(reader: &mut Reader, count: usize, mut run: impl FnMut(u32, u32) -> (u32, u32)) -> Option<Vec<u32>> {
    let mut all = Vec::with_capacity(count.min(super::batch::BATCH));
    while all.len() < count {
        let (value, length) = (reader.varint()?, reader.varint()?);
        if length == 0 || length as usize > count - all.len() {
            return None;
        }
        let (first, step) = run(value, length);
        all.extend((0..length).map(|i| first.wrapping_add(i.wrapping_mul(step))));
    }
    Some(all)
}

fn read_corners(reader: &mut Reader, count: usize, vertices: usize) -> Option<Numbered> {
    let (mut corners, mut known) = (Vec::with_capacity(3 * count.min(super::batch::BATCH)), 0u32);
    for _ in 0..3 * count {
        let back = reader.varint()?;
        corners.push(known.checked_sub(back)?);
        known += u32::from(back == 0);
    }
    (known as usize == vertices).then_some(Numbered { count: known, corners })
}

fn read_positions<C: Coordinate + Default>(reader: &mut Reader, numbered: &Numbered) -> Option<Vec<[[C; 3]; 3]>> {
    let vertices = numbered.count as usize;
    let mut points = vec![[C::default(); 3]; vertices];
    for axis in 0..3 {
        let planes = reader.take(C::LEN.checked_mul(vertices)?)?;
        let mut before = 0;
        for (i, point) in points.iter_mut().enumerate() {
            let coded = (0..C::LEN).fold(0, |c, p| c | u64::from(planes[p * vertices + i]) << (8 * p));
            before = C::undo_difference(coded, before);
            point[axis] = C::from_ordered(before);
        }
    }
    Some(numbered.corners.chunks_exact(3).map(|c| [0, 1, 2].map(|k| points[c[k] as usize])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[allow(clippy::type_complexity)] // the compared fields, and no more
    fn bits(batch: &Batch) -> (Vec<u64>, bool, &[u32], &[u32], &Values) {
        let bits = match &batch.positions {
            Positions::Single(p) => p.iter().flatten().flat_map(|c| c.to_array()).map(|x| x.to_bits().into()).collect(),
            Positions::Double(p) => p.iter().flatten().flat_map(|c| c.to_array()).map(f64::to_bits).collect(),
        };
        (bits, matches!(batch.positions, Positions::Double(_)), &batch.parts, &batch.prims, &batch.values)
    }

    fn batch(numbers: &[(u32, u64, u8)], double: bool, [coloured, normals]: [bool; 2], shared: bool) -> Batch {
        // With few different values, vertices are shared; with all values, they are not.
        let single = |n: u64| if shared { (n % 5) as f32 - 2.0 } else { f32::from_bits((n as u32) & 0xff7f_ffff) };
        let both = |n: u64| if shared { (n % 5) as f64 * -0.1 } else { f64::from_bits(n & !(1 << 62)) };
        let point = |n: u64| [n, n.rotate_left(13), n.rotate_left(29)];
        let triangle = |n: u64| [n, n.rotate_left(7), n.rotate_left(45)];
        let mut next = 0u32;
        Batch {
            positions: if double {
                Positions::Double(numbers.iter().map(|n| triangle(n.1).map(|p| point(p).map(both).into())).collect())
            } else {
                Positions::Single(numbers.iter().map(|n| triangle(n.1).map(|p| point(p).map(single).into())).collect())
            },
            parts: numbers.iter().map(|n| n.0 >> (n.2 % 32)).collect(),
            prims: numbers
                .iter()
                .map(|n| {
                    next = next.saturating_add(if n.2 < 200 { 1 } else { 1 + n.0 % 100_000 });
                    next
                })
                .collect(),
            values: Values {
                colours: if coloured {
                    numbers.iter().map(|n| [n.0, !n.0, n.0 / 3].map(u32::to_le_bytes)).collect()
                } else {
                    Vec::new()
                },
                normals: if normals {
                    numbers.iter().map(|n| [n.0 / 2, n.0 % 3, n.0 % 5]).collect()
                } else {
                    Vec::new()
                },
            },
        }
    }

    proptest! {
        #[test]
        fn any_batch_comes_back_to_the_bit(
            numbers in prop::collection::vec(any::<(u32, u64, u8)>(), 0..200), double: bool, has: [bool; 2], shared: bool,
        ) {
            let batch = batch(&numbers, double, has, shared);
            let coded = encode(&batch);
            let back = decode(&coded).expect("what was written");
            prop_assert_eq!(bits(&back), bits(&batch));
            for len in 0..coded.len() {
                prop_assert!(decode(&coded[..len]).is_none());
            }
        }

        #[test]
        fn damage_does_not_panic(
            numbers in prop::collection::vec(any::<(u32, u64, u8)>(), 1..50), at in any::<prop::sample::Index>(), flip in 1u8..,
        ) {
            let mut coded = encode(&batch(&numbers, false, [true; 2], true));
            let at = 4 + at.index(coded.len() - 4);
            coded[at] ^= flip;
            let _ = decode(&coded);
        }
    }

    #[test]
    fn a_surface_takes_few_bytes() {
        let height = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 1000) as f32 * 1e-3;
        let at = |x: usize, y: usize| Vec3::new(x as f32 * 0.1, y as f32 * 0.1, height(x, y));
        let triangle = |i: usize| {
            let (x, y) = (i / 2 % 200, i / 400);
            let corners = [at(x, y), at(x + 1, y), at(x, y + 1)];
            if i.is_multiple_of(2) { corners } else { [at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)] }
        };
        let count = 30_000;
        let batch = Batch {
            positions: Positions::Single((0..count).map(triangle).collect()),
            parts: vec![3; count],
            prims: (0..count as u32).collect(),
            values: Values::default(),
        };
        let bytes = encode(&batch).len() as f64 / count as f64;
        println!("{bytes} bytes a triangle");
        assert!(bytes < 10.0);
    }
}
