//! The tables of a model: parts, materials, assembly, trees (FORMAT.md, section 5).
//!
//! Decoding is strict: code that uses tables which [`Tables::validate`] has accepted needs no further checks.

use super::header::Header;
use crate::base::bytes::{ByteReader, Checked, Malformed, PutBytes, ensure};
use crate::base::error::Result;

/// Bounds that contain nothing: +infinity thrice, then -infinity thrice.
pub const EMPTY_BOUNDS: [f64; 6] = {
    let (least, greatest) = (f64::INFINITY, f64::NEG_INFINITY);
    [least, least, least, greatest, greatest, greatest]
};
/// [`EMPTY_BOUNDS`] in single precision.
pub const EMPTY_BOUNDS_F32: [f32; 6] = {
    let (least, greatest) = (f32::INFINITY, f32::NEG_INFINITY);
    [least, least, least, greatest, greatest, greatest]
};
/// Maximum number of classes of blocks of a structure.
pub const CLASSES: usize = 4;
/// The parent, in the file, of a part without a parent.
pub(super) const NO_PARENT: u32 = u32::MAX;

/// A part: the unit that a CAD user selects.
#[derive(Debug, Clone, PartialEq)]
pub struct PartRow {
    /// The caller's id.
    pub id: u64,
    /// Name in the input; may be empty.
    pub name: String,
    /// Row of the parent, which is before this one.
    pub parent: Option<u32>,
    /// Row of the material table.
    pub material: u32,
    /// Bounds, in world units, of the part's own triangles: least corner, then greatest corner. Either finite or
    /// [`EMPTY_BOUNDS`].
    pub bounds: [f64; 6],
    /// Number of the part's own triangles in the trees.
    pub triangles: u64,
    /// [`PartRow::CLOSED`] and [`PartRow::ORIENTED`], combined with `|`.
    pub flags: u32,
}

impl PartRow {
    /// Every edge of the part's triangles belongs to an even number of them: the surface has no border.
    pub const CLOSED: u32 = 1;
    /// Every edge is passed as often in one direction as in the other, so the triangles face one way. Only with
    /// [`PartRow::CLOSED`].
    pub const ORIENTED: u32 = 2;
}

/// A material. Each number is in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaterialRow {
    /// Linear red, green, blue.
    pub colour: [f32; 3],
    /// 1 is opaque.
    pub opacity: f32,
    /// 1 is a metal.
    pub metalness: f32,
    /// 1 is rough.
    pub roughness: f32,
}

impl MaterialRow {
    /// Returns the nearest row that a file may hold: each number is clamped to [0, 1], NaN becomes 0.
    pub fn clamped(self) -> Self {
        let unit = |v: f32| if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) };
        Self {
            colour: self.colour.map(unit),
            opacity: unit(self.opacity),
            metalness: unit(self.metalness),
            roughness: unit(self.roughness),
        }
    }
    fn numbers(&self) -> [f32; 6] {
        let [r, g, b] = self.colour;
        [r, g, b, self.opacity, self.metalness, self.roughness]
    }
}

/// One instance of a shared mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InstanceRow {
    /// Row of the tree; not tree 0.
    pub tree: u32,
    /// Row of the part that is local part 0 of the tree in this instance; the rows behind it are the others.
    pub first_part: u32,
    /// Column-major 3x4 matrix: the images of x, y and z, then the translation. It must pass [`is_invertible`].
    pub world_from_mesh: [f64; 12],
}

/// A tree. Row 0 holds the triangles that are placed directly, each further row a shared mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TreeRow {
    /// Id of the first geometry block. The geometry blocks of each tree follow those of the tree before.
    pub first_block: u32,
    /// Number of geometry blocks.
    pub block_count: u32,
    /// Numbers of geometry blocks of each class, in the order of the structure's classes; their sum is `block_count`.
    /// Blocks of the first class are coarse, and all others are below them: there is at least 1, unless the tree has no
    /// blocks.
    pub class_blocks: [u32; CLASSES],
    /// Root of the tree, in an encoding of the structure.
    pub root: u32,
    /// Number of the tree's acceleration structure, not 0. The module `structure` defines the valid numbers.
    pub structure: u32,
    /// Point that the tree's f32 positions are relative to, in the tree's own f64 coordinates; finite.
    pub origin: [f64; 3],
    /// Bounds relative to the origin: least corner, then greatest corner. Either finite or [`EMPTY_BOUNDS_F32`].
    pub bounds: [f32; 6],
    /// Number of triangles, each counted once.
    pub triangles: u64,
    /// Number of references to triangles in leaves: more than triangles if some were split.
    pub references: u64,
    /// Number of inner nodes.
    pub nodes: u64,
    /// Number of leaves.
    pub leaves: u64,
    /// Greatest distance between a stored position and the input's, in the tree's units; finite, >= 0.
    pub position_error: f64,
    /// Number of local parts that the triangles refer to; not more than there are parts.
    pub local_parts: u32,
    /// Greatest stack size that a traversal needs, in a unit of the structure.
    pub max_stack: u32,
}

impl TreeRow {
    /// A tree of structure 1 without triangles and blocks.
    pub const EMPTY: Self = Self {
        first_block: 0,
        block_count: 0,
        class_blocks: [0; CLASSES],
        root: 0,
        structure: 1,
        origin: [0.0; 3],
        bounds: EMPTY_BOUNDS_F32,
        triangles: 0,
        references: 0,
        nodes: 0,
        leaves: 0,
        position_error: 0.0,
        local_parts: 0,
        max_stack: 0,
    };
}

/// True if the transform (column-major 3x4) is finite and invertible: its determinant and the reciprocal of that are
/// normal numbers.
pub fn is_invertible(m: &[f64; 12]) -> bool {
    let [a, b, c, d, e, f, g, h, i, ..] = *m;
    let determinant = a * (e * i - f * h) - d * (b * i - c * h) + g * (b * f - c * e);
    is_finite(m) && determinant.is_normal() && determinant.recip().is_normal()
}

/// True if all numbers are finite.
pub(super) fn is_finite(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite())
}

/// Accepts finite bounds and [`EMPTY_BOUNDS`].
pub(super) fn check_bounds(b: &[f64; 6]) -> Checked<()> {
    let ordered = is_finite(b) && (0..3).all(|axis| b[axis] <= b[axis + 3]);
    ensure(ordered || *b == EMPTY_BOUNDS, "invalid bounds")
}

/// All tables of a model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tables<'a> {
    /// Parts.
    pub parts: &'a [PartRow],
    /// Materials.
    pub materials: &'a [MaterialRow],
    /// Instances of shared meshes.
    pub instances: &'a [InstanceRow],
    /// Trees.
    pub trees: &'a [TreeRow],
}

impl Tables<'_> {
    /// Checks every documented range of the rows, among themselves and against the header.
    pub fn validate(&self, header: &Header) -> Checked<()> {
        each(self.parts, "part", |i, part| {
            ensure(part.name.len() <= u32::MAX as usize, "the name is too long")?;
            check_part(i, part.parent, part.material, &part.bounds, part.flags, self.materials.len() as u64)
        })?;
        let triangles = self.parts.iter().map(|part| part.triangles).try_fold(0, u64::checked_add);
        let Self { materials, instances, trees, .. } = *self;
        Others { parts: self.parts.len(), triangles, materials, instances, trees }.validate(header)
    }
}

/// Checks the ranges of the part in row `index`; there are `materials` materials.
pub(super) fn check_part(
    index: usize,
    parent: Option<u32>,
    material: u32,
    bounds: &[f64; 6],
    flags: u32,
    materials: u64,
) -> Checked<()> {
    // Parents come first, hence there are no cycles.
    ensure(parent.is_none_or(|p| (p as usize) < index), "the parent does not precede the part")?;
    ensure(u64::from(material) < materials, "the material does not exist")?;
    ensure(matches!(flags, 0 | PartRow::CLOSED | 3), "the flags are unknown")?;
    check_bounds(bounds)
}

/// All tables but the parts, of which only the numbers are needed.
pub(super) struct Others<'a> {
    /// Number of parts, and the sum of their triangles; `None` if that is too large.
    pub parts: usize,
    pub triangles: Option<u64>,
    pub materials: &'a [MaterialRow],
    pub instances: &'a [InstanceRow],
    pub trees: &'a [TreeRow],
}

impl Others<'_> {
    /// Checks every documented range of the rows, among themselves and against the header.
    pub fn validate(&self, header: &Header) -> Checked<()> {
        let too_many = |rows: usize| rows >= u32::MAX as usize;
        let counts = [self.parts, self.materials.len(), self.instances.len(), self.trees.len()];
        ensure(!counts.into_iter().any(too_many), "too many rows in a table")?;
        each(self.materials, "material", |_, m| {
            ensure(m.numbers().iter().all(|v| (0.0..=1.0).contains(v)), "a number is outside of [0, 1]")
        })?;
        each(self.instances, "instance", |_, instance| self.check_instance(instance))?;
        self.check_trees(header.geometry_blocks)
    }

    fn check_instance(&self, instance: &InstanceRow) -> Checked<()> {
        let tree = self.trees.get(instance.tree as usize).filter(|_| instance.tree != 0);
        let tree = tree.ok_or(Malformed::new("the shared mesh does not exist"))?;
        let last = u64::from(instance.first_part) + u64::from(tree.local_parts);
        ensure(last <= self.parts as u64, "the parts are not in the table of parts")?;
        ensure(is_invertible(&instance.world_from_mesh), "the transform is not finite or not invertible")
    }

    fn check_trees(&self, geometry_blocks: u32) -> Checked<()> {
        let mut next = 0u64;
        each(self.trees, "tree", |_, tree| {
            ensure(u64::from(tree.first_block) == next, "the blocks do not follow those of the previous tree")?;
            next += u64::from(tree.block_count);
            let sum: u64 = tree.class_blocks.iter().map(|&blocks| u64::from(blocks)).sum();
            ensure(sum == u64::from(tree.block_count), "the block counts of the classes are inconsistent")?;
            ensure(tree.class_blocks[0] > 0 || tree.block_count == 0, "there is no coarse block")?;
            ensure(tree.structure != 0, "the structure is 0")?;
            ensure(tree.local_parts as usize <= self.parts, "there are more local parts than parts")?;
            ensure(is_finite(&tree.origin), "invalid origin")?;
            check_bounds(&tree.bounds.map(f64::from))?;
            ensure(tree.position_error.is_finite() && tree.position_error >= 0.0, "invalid position error")
        })?;
        let counts = self.trees.iter().flat_map(|t| [t.triangles, t.references, t.nodes, t.leaves]);
        let sum = counts.map(Some).chain([self.triangles]).try_fold(0u64, |sum, count| sum.checked_add(count?));
        ensure(sum.is_some(), "the sum of the counts of trees and parts is too large")?;
        ensure(next == u64::from(geometry_blocks), "the trees do not cover all geometry blocks")
    }
}

/// Calls `check` for all rows. The error names the row that fails.
fn each<T>(rows: &[T], what: &str, mut check: impl FnMut(usize, &T) -> Checked<()>) -> Checked<()> {
    rows.iter().enumerate().try_for_each(|(i, row)| check(i, row).map_err(|why| of_row(what, i, &why)))
}

/// Returns `why` with the row in front.
pub(super) fn of_row(what: &str, index: usize, why: &Malformed) -> Malformed {
    Malformed::new(format!("{what} {index}: {why}"))
}

/// A row of a section: a fixed number of bytes, and for parts a text behind all rows.
pub(super) trait FileRow: Sized {
    /// Number of bytes of a row.
    const LEN: usize;
    /// Appends [`Self::LEN`] bytes.
    fn encode(&self, out: &mut Vec<u8>);
    /// The text that is stored behind all rows.
    fn text(&self) -> &str {
        ""
    }
}

/// Number of rows, or of texts, that are encoded at a time.
const TOGETHER: usize = 1024;

/// Calls `take` with the bytes of a section, some at a time: those of all rows, then all texts.
pub(super) fn encode<T: FileRow>(rows: &[T], take: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
    let mut out = Vec::new();
    for some in rows.chunks(TOGETHER) {
        out.clear();
        some.iter().for_each(|row| row.encode(&mut out));
        debug_assert_eq!(out.len(), some.len() * T::LEN);
        take(&out)?;
    }
    for some in rows.chunks(TOGETHER) {
        out.clear();
        some.iter().for_each(|row| out.put_bytes(row.text().as_bytes()));
        take(&out)?;
    }
    Ok(())
}

/// Returns the bytes of a section.
#[cfg(test)]
pub(super) fn encoded<T: FileRow>(rows: &[T]) -> Vec<u8> {
    let mut all = Vec::new();
    let taken = encode(rows, &mut |some| {
        all.extend_from_slice(some);
        Ok(())
    });
    taken.expect("memory");
    all
}

/// A row without a text.
pub(super) trait PlainRow: FileRow {
    /// Reads the [`FileRow::LEN`] bytes of a row.
    fn decode(r: &mut ByteReader) -> Checked<Self>;
}

impl FileRow for PartRow {
    const LEN: usize = 80;
    fn encode(&self, out: &mut Vec<u8>) {
        out.put_u64(self.id);
        out.put_u64(self.triangles);
        out.put_f64s(&self.bounds);
        out.put_u32(self.parent.unwrap_or(NO_PARENT));
        out.put_u32(self.material);
        out.put_u32(self.name.len() as u32);
        out.put_u32(self.flags);
    }
    fn text(&self) -> &str {
        &self.name
    }
}

impl FileRow for MaterialRow {
    const LEN: usize = 24;
    fn encode(&self, out: &mut Vec<u8>) {
        out.put_f32s(&self.numbers());
    }
}

impl PlainRow for MaterialRow {
    fn decode(r: &mut ByteReader) -> Checked<Self> {
        let [red, green, blue, opacity, metalness, roughness] = r.f32s()?;
        Ok(Self { colour: [red, green, blue], opacity, metalness, roughness })
    }
}

impl FileRow for InstanceRow {
    const LEN: usize = 104;
    fn encode(&self, out: &mut Vec<u8>) {
        out.put_u32(self.tree);
        out.put_u32(self.first_part);
        out.put_f64s(&self.world_from_mesh);
    }
}

impl PlainRow for InstanceRow {
    fn decode(r: &mut ByteReader) -> Checked<Self> {
        Ok(Self { tree: r.u32()?, first_part: r.u32()?, world_from_mesh: r.f64s()? })
    }
}

impl FileRow for TreeRow {
    const LEN: usize = 128;
    fn encode(&self, out: &mut Vec<u8>) {
        out.put_u32(self.first_block);
        out.put_u32(self.block_count);
        out.put_u32(self.root);
        out.put_u32(self.structure);
        out.put_f64s(&self.origin);
        out.put_f32s(&self.bounds);
        out.put_u64(self.triangles);
        out.put_u64(self.references);
        out.put_u64(self.nodes);
        out.put_u64(self.leaves);
        out.put_f64(self.position_error);
        out.put_u32(self.local_parts);
        out.put_u32(self.max_stack);
        self.class_blocks.iter().for_each(|&blocks| out.put_u32(blocks));
    }
}

impl PlainRow for TreeRow {
    fn decode(r: &mut ByteReader) -> Checked<Self> {
        Ok(Self {
            first_block: r.u32()?,
            block_count: r.u32()?,
            root: r.u32()?,
            structure: r.u32()?,
            origin: r.f64s()?,
            bounds: r.f32s()?,
            triangles: r.u64()?,
            references: r.u64()?,
            nodes: r.u64()?,
            leaves: r.u64()?,
            position_error: r.f64()?,
            local_parts: r.u32()?,
            max_stack: r.u32()?,
            class_blocks: [r.u32()?, r.u32()?, r.u32()?, r.u32()?],
        })
    }
}

#[cfg(test)]
#[path = "sections_tests.rs"]
mod tests;
