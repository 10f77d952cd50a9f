//! Leaves: their triangles in order, and the vertices that these share.

use super::refs::Ref;
use crate::lod::Content;
use crate::simd::{Isa, Lanes, Mask, Op, Portable, Simd, dispatch};
use crate::structure::bake::TreeInput;
use crate::structure::bvh::layout::{MAX_TRIANGLES, MAX_VERTICES};
use crate::structure::bvh::leaf::{LeafForm, MIXED};
use glam::Vec3;

/// Triangles and vertices of a leaf, found once to build the tree over it and once to write it.
#[derive(Debug)]
pub struct LeafShape {
    /// Triangles by ascending primitive id.
    pub triangles: [u32; MAX_TRIANGLES],
    /// Number of triangles.
    pub count: usize,
    /// Distinct vertices: x of all, then y, then z. Vertices are equal if their coordinates are equal as numbers; -0
    /// equals 0, and the bits of the first vertex stay. NaN, which equals nothing, follows the last vertex.
    pub vertices: [[f32; CORNERS]; 3],
    /// Number of vertices.
    pub vertex_count: usize,
    /// Vertex numbers of each triangle.
    pub corners: [[u8; 3]; MAX_TRIANGLES],
    /// True if the triangles belong to several parts.
    pub mixed: bool,
}

impl LeafShape {
    /// Returns the shape of these references, if they fit a leaf.
    pub fn that_fits(refs: &[Ref], input: TreeInput) -> Option<Self> {
        let shape = (refs.len() <= MAX_TRIANGLES).then(|| Self::of(refs, input))?;
        (shape.vertex_count <= MAX_VERTICES).then_some(shape)
    }

    /// Returns the shape of at most [`MAX_TRIANGLES`] references.
    pub fn of(refs: &[Ref], input: TreeInput) -> Self {
        Self::with(Isa::best(), refs, input)
    }

    fn with(isa: Isa, refs: &[Ref], input: TreeInput) -> Self {
        let mut shape = Self {
            triangles: [0; MAX_TRIANGLES],
            count: 0,
            vertices: [[f32::NAN; CORNERS]; 3],
            vertex_count: 0,
            corners: [[0; 3]; MAX_TRIANGLES],
            mixed: false,
        };
        let mut order = [u32::MAX; MAX_TRIANGLES];
        for (slot, r) in order.iter_mut().zip(refs) {
            *slot = r.triangle() as u32;
        }
        let mut positions = Positions([[0.0; CORNERS + 8]; 3]);
        // The order of the input is that of the primitive ids.
        for &t in &sorted(order)[..refs.len().min(MAX_TRIANGLES)] {
            // Spatial splits can put a triangle into one leaf twice.
            if shape.count == 0 || shape.triangles[shape.count - 1] != t {
                shape.mixed |= shape.count > 0 && input.parts[t as usize] != input.parts[shape.triangles[0] as usize];
                for (corner, p) in input.triangles[t as usize].iter().enumerate() {
                    (0..3).for_each(|axis| positions.0[axis][3 * shape.count + corner] = p[axis]);
                }
                shape.triangles[shape.count] = t;
                shape.count += 1;
            }
        }
        dispatch(isa, Share { shape: &mut shape, positions: &positions });
        shape
    }

    /// Returns the content of its references, of which there is at least one.
    pub fn content(&self, refs: &[Ref]) -> Content {
        let [x, y, z] = &self.vertices;
        let points = (0..self.vertex_count).map(|i| Vec3::new(x[i], y[i], z[i])).collect();
        let place =
            |r: &Ref| self.triangles[..self.count].iter().position(|&t| t as usize == r.triangle()).unwrap_or(0);
        Content::of_triangles(points, refs.iter().map(|r| self.corners[place(r)].map(u16::from)).collect())
    }

    /// Returns the form in which the leaf is stored, and the bits of its coordinates.
    pub fn stored(&self) -> (LeafForm, [[u32; MAX_VERTICES]; 3]) {
        let bits = self.vertices.each_ref().map(|axis| std::array::from_fn(|i| axis[i].to_bits()));
        (
            LeafForm::of(
                Portable::new(),
                (self.count, self.vertex_count),
                self.mixed,
                self.is_apart(),
                bits.each_ref(),
            ),
            bits,
        )
    }

    /// True if no vertex is shared. Vertices are numbered in the order of corners, so these are in order then.
    fn is_apart(&self) -> bool {
        self.vertex_count == 3 * self.count
    }

    /// Number of words in the trace form.
    pub fn words(&self) -> usize {
        if self.is_apart() {
            return self.stored().0.words();
        }
        LeafForm { triangles: self.count, vertices: self.vertex_count, flags: if self.mixed { MIXED } else { 0 } }
            .words()
    }
}

/// Greatest number of corners of a leaf's triangles.
const CORNERS: usize = 3 * MAX_TRIANGLES;

/// Positions of all corners, axis by axis, in two vectors of sixteen.
#[repr(align(64))]
struct Positions([[f32; CORNERS + 8]; 3]);
const _: () = assert!(CORNERS + 8 == 32);

/// Sorts ascending. The position of an element is the number of elements that are less, or equal and before it. There
/// are no branches, because there are few elements.
fn sorted(all: [u32; MAX_TRIANGLES]) -> [u32; MAX_TRIANGLES] {
    let mut out = [0; MAX_TRIANGLES];
    for (i, &one) in all.iter().enumerate() {
        let mut before = 0;
        for (k, &other) in all.iter().enumerate() {
            before += u32::from(other < one || (other == one && k < i));
        }
        out[before as usize & (MAX_TRIANGLES - 1)] = one;
    }
    out
}

/// Finds the corners that share vertices. Vertices are numbered in the order of their first corners.
struct Share<'a> {
    shape: &'a mut LeafShape,
    positions: &'a Positions,
}

impl Op for Share<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { shape, positions: Positions(positions) } = self;
        let (mut numbers, mut count) = ([0u8; CORNERS + 8], 0);
        for i in 0..3 * shape.count {
            let p = [positions[0][i], positions[1][i], positions[2][i]];
            let mut equal = equal(s, positions, 0, p);
            if i >= 16 {
                equal |= self::equal(s, positions, 16, p) << 16;
            }
            // The corner itself, if no earlier one is equal.
            let first = (equal.trailing_zeros() as usize).min(i);
            let is_new = first == i;
            // The second line overwrites this number unless the vertex is new.
            numbers[i] = count as u8;
            numbers[i] = numbers[first];
            for (axis, at) in p.into_iter().enumerate() {
                shape.vertices[axis][count] = at;
            }
            count += usize::from(is_new);
            shape.corners[i / 3][i % 3] = numbers[i];
        }
        for axis in 0..3 {
            shape.vertices[axis][count..].fill(f32::NAN);
        }
        shape.vertex_count = count;
    }
}

/// Returns the corners, of sixteen, that are equal to `p` as numbers: NaN equals nothing.
#[inline(always)]
fn equal<S: Simd>(s: S, positions: &[[f32; CORNERS + 8]; 3], from: usize, p: [f32; 3]) -> u32 {
    let mut equal = 0xffff;
    for axis in 0..3 {
        let Some(here) = positions[axis][from..].first_chunk::<16>() else { unreachable!() };
        equal &= s.load16(here).eq(s.splat16(p[axis])).bits();
    }
    equal
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Bounds;
    use proptest::prelude::*;

    proptest! {
        /// Compares with vertices found one after the other. On a small grid most vertices are shared; zeros of both
        /// signs are equal.
        #[test]
        fn vertices_are_the_same_as_those_found_one_by_one(
            corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1i32..2)), 1..12),
            signs: u64, picked in prop::collection::vec(0usize..12, 1..=MAX_TRIANGLES),
            parts in prop::collection::vec(0u32..2, 12),
        ) {
            let number = |x: i32, i: usize| if x == 0 && signs >> (i % 64) & 1 == 1 { -0.0 } else { x as f32 };
            let vertex = |t: usize, c: usize, p: [i32; 3]| {
                Vec3::new(number(p[0], t + c), number(p[1], 2 * t + c), number(p[2], t + 3 * c))
            };
            let triangle = |(t, all): (usize, &[[i32; 3]; 3])| [0, 1, 2].map(|c| vertex(t, c, all[c]));
            let triangles: Vec<[Vec3; 3]> = corners.iter().enumerate().map(triangle).collect();
            let prims: Vec<u32> = (0..triangles.len() as u32).collect();
            let parts = &parts[..triangles.len()];
            let input = TreeInput { triangles: &triangles, parts, prims: &prims, colours: &[], normals: &[], part_colours: &[] };
            let picked: Vec<usize> = picked.into_iter().map(|t| t % triangles.len()).collect();
            let refs: Vec<Ref> = picked.iter().map(|&t| Ref::new(Bounds::of(&triangles[t]), t as u32)).collect();
            let mut expected = picked.clone();
            expected.sort_unstable();
            expected.dedup();
            let ids: Vec<u32> = expected.iter().map(|t| *t as u32).collect();
            let mut vertices: Vec<Vec3> = Vec::new();
            let mut numbers = Vec::new();
            for &t in &expected {
                numbers.push(triangles[t].map(|p| {
                    let at = vertices.iter().position(|v| *v == p).unwrap_or(vertices.len());
                    if at == vertices.len() {
                        vertices.push(p);
                    }
                    at as u8
                }));
            }
            for isa in Isa::ALL {
                let shape = LeafShape::with(isa, &refs, input);
                prop_assert_eq!(&shape.triangles[..shape.count], &ids[..]);
                prop_assert_eq!(&shape.corners[..shape.count], &numbers[..]);
                for axis in 0..3 {
                    let found = shape.vertices[axis][..shape.vertex_count].iter().map(|x| x.to_bits());
                    prop_assert!(found.eq(vertices.iter().map(|v| v[axis].to_bits())));
                    prop_assert!(shape.vertices[axis][shape.vertex_count..].iter().all(|x| x.is_nan()));
                }
                prop_assert_eq!(shape.mixed, expected.iter().any(|t| parts[*t] != parts[expected[0]]));
            }
        }
    }
}
