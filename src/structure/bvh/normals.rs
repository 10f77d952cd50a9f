//! Normals at the corners of the triangles of a block: the words that shading reads, in a block of their own.
//!
//! | words | content |
//! |---|---|
//! | 0 | number of windows, each of [`WINDOW`] consecutive triangles; 0: every triangle is flat |
//! | .. | u16 for each window: the word at which its record begins, or 0 if its triangles are flat; padded to a word |
//! | .. | the records |
//!
//! A record begins with a word whose bit `i` is set if a leaf begins at triangle `i` of the window. A u8 for each such
//! leaf follows: its class in bits 0 to 3; above, the number of its vertices less 1, or of its triangles less 1, by the
//! class. Entries of 12 bits follow without a gap, leaf by leaf; the record is padded to a word.
//!
//! | class | entries |
//! |---|---|
//! | 0 | none: the triangles are flat |
//! | 1 to 4 | one for each vertex, within 1/16, 1/8, 1/4, 1/2 of the frame |
//! | 5 | two for each vertex |
//! | 6 to 9, 10 | as 1 to 5, for each corner, triangle by triangle |
//!
//! The *frame* of a leaf is the mean normal of its first and its last triangle and two directions across. One entry
//! holds the components of a unit normal across the frame, each of 6 bits in units of 1/31 of the class's limit: the
//! less the normals of a leaf differ, the finer they are. Two entries hold the two coordinates of the unfolded
//! octahedron (`math::octahedral`) in 12 bits each. Entries whose bits are all set stand for the triangle's own normal.
//!
//! Readers test every access, for the block of triangles and this one may not match in a malformed file.

use super::leaf::Leaf;
use crate::math::octahedral;
use bytemuck::cast_slice;
use glam::{Vec2, Vec3};

/// Triangles of a window.
const WINDOW: usize = 32;
/// An entry that stands for the triangle's own normal.
const OWN: u32 = 0xfff;
/// Number of classes with entries for vertices.
const CLASSES: u32 = 5;
/// The class of these whose entries come in twos.
const WIDE: u32 = 5;

/// A leaf's triangles and normals, for the encoder.
pub struct LeafNormals<'a> {
    /// Corners of the triangles.
    pub triangles: &'a [[Vec3; 3]],
    /// Codes of their normals (`math::octahedral`); the triangle's own below 2.
    pub codes: &'a [[u32; 3]],
    /// Vertex numbers of the corners.
    pub corners: &'a [[u8; 3]],
    /// Number of vertices.
    pub vertices: usize,
}

/// Collects the normals of a block, leaf by leaf.
#[derive(Default)]
pub struct Encoder {
    windows: Vec<Window>,
    triangles: usize,
}

#[derive(Default)]
struct Window {
    begins: u32,
    heads: Vec<u8>,
    entries: Vec<u16>,
}

impl Encoder {
    /// Adds the next leaf.
    pub fn push(&mut self, leaf: &LeafNormals) {
        let first = self.triangles;
        self.triangles += leaf.triangles.len();
        self.windows.resize_with(self.triangles.div_ceil(WINDOW), Window::default);
        let window = &mut self.windows[first / WINDOW];
        window.begins |= 1 << (first % WINDOW);
        let class = leaf.encode(&mut window.entries);
        let count = if class <= CLASSES { leaf.vertices } else { leaf.triangles.len() };
        window.heads.push(class as u8 | (count as u8 - 1) << 4);
    }

    /// The words of the block.
    pub fn words(&self) -> Vec<u32> {
        if self.windows.iter().all(|window| window.entries.is_empty()) {
            return vec![0];
        }
        let mut words = vec![self.windows.len() as u32];
        words.resize(1 + self.windows.len().div_ceil(2), 0);
        for (i, window) in self.windows.iter().enumerate().filter(|(_, window)| !window.entries.is_empty()) {
            words[1 + i / 2] |= (words.len() as u32) << (16 * (i % 2));
            window.put(&mut words);
        }
        words
    }
}

impl Window {
    fn put(&self, words: &mut Vec<u32>) {
        words.push(self.begins);
        let mut bytes = self.heads.clone();
        for pair in self.entries.chunks(2) {
            let both = u32::from(pair[0]) | pair.get(1).map_or(0, |&second| u32::from(second) << 12);
            bytes.extend(&both.to_le_bytes()[..3]);
        }
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        words.extend(bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    }
}

impl LeafNormals<'_> {
    /// Adds the entries of the leaf; returns its class.
    fn encode(&self, entries: &mut Vec<u16>) -> u32 {
        if self.codes.iter().flatten().all(|&code| code < 2) {
            return 0;
        }
        let of_vertices = self.of_vertices();
        let codes: &[u32] = of_vertices.as_deref().unwrap_or(self.codes.as_flattened());
        let normals: Vec<Option<Vec3>> =
            codes.iter().map(|&code| (code >= 2).then(|| octahedral::decode(code))).collect();
        let frame = Frame::of([&self.triangles[0], &self.triangles[self.triangles.len() - 1]]);
        let class = (1..WIDE).find(|&class| normals.iter().flatten().all(|n| frame.holds(*n, limit(class))));
        for normal in normals {
            match (normal, class) {
                (None, Some(_)) => entries.push(OWN as u16),
                (None, None) => entries.extend([OWN as u16; 2]),
                (Some(normal), Some(class)) => entries.push(frame.entry(normal, limit(class))),
                (Some(normal), None) => entries.extend(wide(normal)),
            }
        }
        class.unwrap_or(WIDE) + if of_vertices.is_some() { 0 } else { CLASSES }
    }

    /// The code of each vertex, if all its corners have the same.
    fn of_vertices(&self) -> Option<Vec<u32>> {
        let mut of_vertices = vec![None; self.vertices];
        for (&vertex, &code) in self.corners.as_flattened().iter().zip(self.codes.as_flattened()) {
            let code = code.max(1);
            if *of_vertices[usize::from(vertex)].get_or_insert(code) != code {
                return None;
            }
        }
        Some(of_vertices.into_iter().map(|code| code.unwrap_or(1)).collect())
    }
}

/// Limit of the components across the frame.
#[inline(always)]
fn limit(class: u32) -> f32 {
    1.0 / (32 >> class) as f32
}

/// Returns the two entries of a normal, neither pair of which is that of the triangle's own.
fn wide(normal: Vec3) -> [u16; 2] {
    let at = octahedral::fold(normal);
    [at.x, at.y].map(|x| ((x * 0.5 + 0.5) * 4094.0).round() as u16)
}

/// A unit normal and two directions across.
struct Frame {
    axes: [Vec3; 3],
}

impl Frame {
    /// The frame of a leaf with this first and this last triangle. (Duff and others, "Building an Orthonormal Basis,
    /// Revisited", JCGT 2017.)
    #[inline(always)]
    fn of([first, last]: [&[Vec3; 3]; 2]) -> Self {
        let first = own_normal(first);
        let sum = first + own_normal(last);
        let square = sum.length_squared();
        let n = if square > 0.01 { sum / square.sqrt() } else { first } + Vec3::ZERO;
        let sign = 1.0f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        let first = Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
        Self { axes: [first, Vec3::new(b, sign + n.y * n.y * a, -n.y), n] }
    }

    fn holds(&self, normal: Vec3, limit: f32) -> bool {
        let [x, y, z] = self.axes.map(|axis| axis.dot(normal));
        z > 0.0 && x.abs() <= limit && y.abs() <= limit
    }

    fn entry(&self, normal: Vec3, limit: f32) -> u16 {
        let [x, y] = [0, 1].map(|axis| (self.axes[axis].dot(normal) / limit * 31.0).round() as i32 + 31);
        (x | y << 6) as u16
    }

    #[inline(always)]
    fn normal(&self, entry: u32, limit: f32) -> Vec3 {
        let [x, y] = [entry & 63, entry >> 6].map(|bits| (bits as f32 - 31.0) * (limit / 31.0));
        self.axes[0] * x + self.axes[1] * y + self.axes[2] * (1.0 - x * x - y * y).max(0.0).sqrt()
    }
}

/// The unit normal of a triangle in single precision; z if it has none. Encoder and reader compute the same.
#[inline(always)]
fn own_normal([a, b, c]: &[Vec3; 3]) -> Vec3 {
    let across = (*b - *a).cross(*c - *a);
    let square = across.length_squared();
    // The sum makes one zero of both: the encoder and the reader may have other signs of zeros.
    let normal = if square > 1e-30 && square < 1e30 {
        across / square.sqrt()
    } else {
        extreme(a.as_dvec3(), b.as_dvec3(), c.as_dvec3())
    };
    normal + Vec3::ZERO
}

#[cold]
fn extreme(a: glam::DVec3, b: glam::DVec3, c: glam::DVec3) -> Vec3 {
    (b - a).cross(c - a).try_normalize().map_or(Vec3::Z, |n| n.as_vec3())
}

/// Returns the normals at the corners of triangle `index` of a leaf, on the side from which they appear
/// counter-clockwise; `None` if the triangle is flat. `words`: the block of normals.
#[inline]
pub fn of_triangle(words: &[u32], leaf: &Leaf, index: usize) -> Option<[Vec3; 3]> {
    let (window, first) = (leaf.first / WINDOW, leaf.first % WINDOW);
    if window >= *words.first()? as usize {
        return None;
    }
    let at = words.get(1 + window / 2)? >> (16 * (window % 2)) & 0xffff;
    let record = words.get(at as usize..).filter(|_| at != 0)?;
    let begins = record.first()?;
    let before = (begins & ((1 << first) - 1)).count_ones() as usize;
    let bytes: &[u8] = cast_slice(&record[1..]);
    let (heads, rest) = bytes.split_at_checked(begins.count_ones() as usize)?;
    let class = u32::from(*heads.get(before)?) & 15;
    if begins >> first & 1 == 0 || class == 0 || class > 2 * CLASSES {
        return None;
    }
    let entries = Entries { bytes: rest, first: heads[..before].iter().map(|head| entries_of(*head)).sum() };
    // Few triangles need it.
    let own = || own_normal(&leaf.triangle(index));
    let number = |corner: usize| {
        if class > CLASSES { 3 * index + corner } else { usize::from(leaf.corners8(corner)[index & 7]) }
    };
    let class = if class > CLASSES { class - CLASSES } else { class };
    let frame = Frame::of([&leaf.triangle(0), &leaf.triangle(leaf.triangles - 1)]);
    let mut normals = [Vec3::ZERO; 3];
    for (corner, normal) in normals.iter_mut().enumerate() {
        let number = number(corner);
        *normal = if class == WIDE {
            match (entries.get(2 * number)?, entries.get(2 * number + 1)?) {
                (OWN, OWN) => own(),
                (x, y) => octahedral::unfold(Vec2::new(x as f32, y as f32) * (2.0 / 4094.0) - 1.0),
            }
        } else {
            match entries.get(number)? {
                OWN => own(),
                entry => frame.normal(entry, limit(class)),
            }
        };
    }
    Some(normals)
}

/// Number of the entries of a leaf.
#[inline(always)]
fn entries_of(head: u8) -> usize {
    let (class, count) = (usize::from(head & 15), usize::from(head >> 4) + 1);
    // Per class: entries for each vertex or triangle.
    const EACH: [u8; 16] = [0, 1, 1, 1, 1, 2, 3, 3, 3, 3, 6, 0, 0, 0, 0, 0];
    usize::from(EACH[class]) * count
}

/// The entries of a leaf.
struct Entries<'a> {
    bytes: &'a [u8],
    first: usize,
}

impl Entries<'_> {
    #[inline(always)]
    fn get(&self, index: usize) -> Option<u32> {
        let index = self.first + index;
        let [low, high] = *self.bytes.get(index / 2 * 3 + index % 2..)?.first_chunk()?;
        Some(u32::from(u16::from_le_bytes([low, high])) >> (4 * (index % 2)) & 0xfff)
    }
}
