//! Leaves: their triangles in order and the vertices that these share.

use super::TreeInput;
use super::refs::Ref;
use crate::lod::Content;
use crate::structure::bvh::layout::{MAX_TRIANGLES, MAX_VERTICES};
use crate::structure::bvh::leaf::{LeafForm, MIXED};
use glam::{Vec3, Vec4};

/// A leaf's triangles and vertices, found once to build over it and once to write it.
#[derive(Debug)]
pub struct LeafShape {
    /// Triangles by ascending primitive id.
    pub triangles: [u32; MAX_TRIANGLES],
    /// How many.
    pub count: usize,
    /// Distinct vertices (equal as numbers; -0 equals 0, and the first one's bits stay): x of all, y, z.
    /// NaN, which equals nothing, behind the last one.
    pub vertices: [[f32; 3 * MAX_TRIANGLES]; 3],
    /// How many.
    pub vertex_count: usize,
    /// Vertices of the triangles.
    pub corners: [[u8; 3]; MAX_TRIANGLES],
    /// Whether the triangles belong to several parts.
    pub mixed: bool,
}

impl LeafShape {
    /// Of these references, if they fit a leaf.
    pub fn that_fits(refs: &[Ref], input: TreeInput) -> Option<Self> {
        let shape = (refs.len() <= MAX_TRIANGLES).then(|| Self::of(refs, input))?;
        (shape.vertex_count <= MAX_VERTICES).then_some(shape)
    }

    /// Of at most [`MAX_TRIANGLES`] references.
    pub fn of(refs: &[Ref], input: TreeInput) -> Self {
        let mut shape = Self {
            triangles: [0; MAX_TRIANGLES],
            count: 0,
            vertices: [[f32::NAN; 3 * MAX_TRIANGLES]; 3],
            vertex_count: 0,
            corners: [[0; 3]; MAX_TRIANGLES],
            mixed: false,
        };
        let mut order = [u32::MAX; MAX_TRIANGLES];
        for (slot, r) in order.iter_mut().zip(refs) {
            *slot = r.triangle() as u32;
        }
        let order = &mut order[..refs.len().min(MAX_TRIANGLES)];
        // Input order is that of the primitive ids.
        order.sort_unstable();
        for &t in order.iter() {
            // Spatial splits can bring a triangle into one leaf twice.
            if shape.count == 0 || shape.triangles[shape.count - 1] != t {
                shape.add(t, input);
            }
        }
        shape
    }

    fn add(&mut self, triangle: u32, input: TreeInput) {
        let parts = input.parts;
        self.mixed |= self.count > 0 && parts[triangle as usize] != parts[self.triangles[0] as usize];
        for (corner, &p) in input.triangles[triangle as usize].iter().enumerate() {
            let at = self.find(p).unwrap_or_else(|| {
                for axis in 0..3 {
                    self.vertices[axis][self.vertex_count] = p[axis];
                }
                self.vertex_count += 1;
                self.vertex_count - 1
            });
            self.corners[self.count][corner] = at as u8;
        }
        self.triangles[self.count] = triangle;
        self.count += 1;
    }

    /// Where a vertex stands. Four are compared at once: which of them is equal cannot be predicted.
    #[inline(always)]
    fn find(&self, p: Vec3) -> Option<usize> {
        let mut at = 0;
        while at < self.vertex_count {
            let equal = |axis: usize| Vec4::from_slice(&self.vertices[axis][at..]).cmpeq(Vec4::splat(p[axis]));
            let mask = (equal(0) & equal(1) & equal(2)).bitmask();
            if mask != 0 {
                return Some(at + mask.trailing_zeros() as usize);
            }
            at += 4;
        }
        None
    }

    /// What its references, one or more, hold.
    pub fn content(&self, refs: &[Ref]) -> Content {
        let [x, y, z] = &self.vertices;
        let points = (0..self.vertex_count).map(|i| Vec3::new(x[i], y[i], z[i])).collect();
        let place = |r: &Ref| self.triangles[..self.count].iter().position(|&t| t as usize == r.triangle()).unwrap_or(0);
        Content::of_triangles(points, refs.iter().map(|r| self.corners[place(r)].map(u16::from)).collect())
    }

    /// How it is stored, and the bits of its coordinates.
    pub fn stored(&self) -> (LeafForm, [[u32; MAX_VERTICES]; 3]) {
        let bits = self.vertices.each_ref().map(|axis| std::array::from_fn(|i| axis[i].to_bits()));
        (LeafForm::of(self.count, self.vertex_count, self.mixed, self.is_apart(), bits.each_ref()), bits)
    }

    /// Whether no vertex is shared. Vertices are numbered as corners come, so these are in order then.
    fn is_apart(&self) -> bool {
        self.vertex_count == 3 * self.count
    }

    /// Words in the trace form.
    pub fn words(&self) -> usize {
        if self.is_apart() {
            return self.stored().0.words();
        }
        LeafForm { triangles: self.count, vertices: self.vertex_count, flags: if self.mixed { MIXED } else { 0 } }.words()
    }
}
