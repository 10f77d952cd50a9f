//! The parts of a model.

use super::model::bounds_of;
use crate::math::DBounds;
use crate::store::{ModelFile, Part, PartRow};

/// A part of a model, as stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartInfo<'a> {
    /// The caller's id.
    pub id: u64,
    /// Its name without characters NUL; may be empty.
    pub name: &'a str,
    /// Index of its parent part in [`Model::parts`].
    pub parent: Option<u32>,
    /// Linear RGBA of its material; alpha is the opacity.
    pub colour: [f32; 4],
    /// Its material's metalness, in [0, 1].
    pub metalness: f32,
    /// Its material's roughness, in [0, 1].
    pub roughness: f32,
    /// Bounds of all its triangles, in model space; empty if it has none.
    pub bounds: DBounds,
    /// Number of its own triangles, without those of the parts below it.
    pub triangles: u64,
    /// True if its own triangles have no border: each edge belongs to an even number of them.
    pub is_closed: bool,
    /// True if it is closed and its triangles face one way: each edge is passed as often in one direction as in the
    /// other.
    pub is_oriented: bool,
}

/// The parts of a model.
#[derive(Debug, Clone, Copy)]
pub struct ModelParts<'a>(pub(super) &'a ModelFile);

impl<'a> ModelParts<'a> {
    /// Number of parts.
    pub fn len(self) -> usize {
        self.0.parts().len()
    }

    /// True if there are no parts.
    pub fn is_empty(self) -> bool {
        self.0.parts().is_empty()
    }

    /// The part with this index, if there is one.
    #[inline]
    pub fn get(self, index: usize) -> Option<PartInfo<'a>> {
        self.0.parts().get(index).map(|part| part_info(part, self.0))
    }

    /// The caller's id of the part with this index, if there is one.
    #[inline]
    pub fn id(self, index: usize) -> Option<u64> {
        self.0.parts().id(index)
    }

    /// All parts; a parent comes before its children.
    pub fn iter(self) -> impl ExactSizeIterator<Item = PartInfo<'a>> + Clone {
        self.0.parts().iter().map(move |part| part_info(part, self.0))
    }

    /// The part with this index and all parts below it: bit `i % 64` of word `i / 64` is part `i`.
    pub(crate) fn with_all_below(self, index: u32) -> Vec<u64> {
        let parts = self.0.parts();
        let mut bits = vec![0u64; parts.len().div_ceil(64)];
        let has = |bits: &[u64], i: u32| bits.get(i as usize / 64).is_some_and(|word| word >> (i % 64) & 1 == 1);
        for (i, part) in (0u32..).zip(parts.iter()).skip(index as usize) {
            if i == index || part.parent.is_some_and(|parent| has(&bits, parent)) {
                bits[i as usize / 64] |= 1 << (i % 64);
            }
        }
        bits
    }

    /// The name of the part with this index, with a NUL behind it; empty if there is no such part.
    pub fn name_and_nul(self, index: usize) -> &'a str {
        self.0.parts().name_and_nul(index)
    }
}

fn part_info<'a>(part: Part<'a>, file: &ModelFile) -> PartInfo<'a> {
    let material = file.materials()[part.material as usize];
    let [r, g, b] = material.colour;
    PartInfo {
        id: part.id,
        name: part.name,
        parent: part.parent,
        colour: [r, g, b, material.opacity],
        metalness: material.metalness,
        roughness: material.roughness,
        bounds: bounds_of(part.bounds),
        triangles: part.triangles,
        is_closed: part.flags & PartRow::CLOSED != 0,
        is_oriented: part.flags & PartRow::ORIENTED != 0,
    }
}
