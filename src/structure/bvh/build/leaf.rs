//! Leaves: their triangles in order and the vertices that these share.

use super::TreeInput;
use super::refs::Ref;
use crate::structure::bvh::layout::{MAX_TRIANGLES, MAX_VERTICES, leaf_words};
use glam::{Vec3, Vec4};

/// What a leaf takes.
#[derive(Debug, Clone, Copy)]
pub struct LeafSize {
    /// Triangles, each once.
    pub triangles: u32,
    /// Words in the trace form.
    pub words: u32,
}

impl LeafSize {
    /// Of a leaf of these references, or `None` where they do not fit one.
    pub fn of(refs: &[Ref], input: TreeInput) -> Option<Self> {
        if refs.len() > MAX_TRIANGLES {
            return None;
        }
        let shape = LeafShape::of(refs, input);
        shape.fits().then(|| Self { triangles: shape.count as u32, words: shape.words() as u32 })
    }
}

/// A leaf's triangles and vertices, found once to measure and once to write.
pub struct LeafShape {
    /// Triangles by ascending primitive id.
    pub triangles: [u32; MAX_TRIANGLES],
    /// How many.
    pub count: usize,
    /// Distinct vertices (equal as numbers; -0 equals 0, and the first one's bits stay): x of all, y, z.
    /// NaN, which equals nothing, behind the last one.
    pub vertices: [[f32; 3 * MAX_TRIANGLES]; 3],
    /// How many; more than fit a leaf if [`LeafShape::fits`] is false.
    pub vertex_count: usize,
    /// Vertices of the triangles.
    pub corners: [[u8; 3]; MAX_TRIANGLES],
    /// Whether the triangles belong to several parts.
    pub mixed: bool,
}

impl LeafShape {
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
        (0..self.vertex_count).step_by(4).find_map(|at| {
            let equal = |axis: usize| Vec4::from_slice(&self.vertices[axis][at..]).cmpeq(Vec4::splat(p[axis]));
            let mask = (equal(0) & equal(1) & equal(2)).bitmask();
            (mask != 0).then(|| at + mask.trailing_zeros() as usize)
        })
    }

    /// Whether a leaf can hold it.
    pub fn fits(&self) -> bool {
        self.vertex_count <= MAX_VERTICES
    }

    /// Words in the trace form.
    pub fn words(&self) -> usize {
        leaf_words(self.count, self.vertex_count, self.mixed)
    }
}
