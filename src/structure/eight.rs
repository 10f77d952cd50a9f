//! What is below a place, eight at a time by lanes: boxes of children, or corners of triangles. Walks that measure
//! distances use it, because they test all boxes of a node against one point or box at once.

use super::hit::TriHit;
#[cfg(any(test, feature = "brute"))]
use super::hit::Triangle;
use super::place::Place;
#[cfg(any(test, feature = "brute"))]
use crate::base::ids::BlockId;
#[cfg(any(test, feature = "brute"))]
use crate::math::Bounds;

/// Number of lanes.
pub const EIGHT: usize = 8;

/// A number for each lane.
pub type Lanes = [f64; EIGHT];

/// Up to eight children or triangles of a place, in the tree's frame. Lanes outside of the mask hold arbitrary numbers.
#[derive(Debug, Clone)]
pub struct Eight {
    /// Bit `i`: lane `i` is in use.
    pub mask: u32,
    /// True if these are triangles.
    pub is_leaf: bool,
    /// Children: bit `i`: only triangles are below child `i`.
    pub leaves: u32,
    /// Children: least x, y, z and greatest x, y, z of boxes that hold all below, up to a rounding of double precision.
    pub bounds: [Lanes; 6],
    /// Children: their places.
    pub places: [Place; EIGHT],
    /// Triangles: coordinates by corner and axis.
    pub corners: [[Lanes; 3]; 3],
    /// Triangles: the tree's local parts.
    pub parts: [u32; EIGHT],
    /// Triangles: their block, and their items there.
    pub block: u32,
    /// See `block`.
    pub items: [u32; EIGHT],
}

impl Default for Eight {
    fn default() -> Self {
        Self {
            mask: 0,
            is_leaf: false,
            leaves: 0,
            bounds: [[0.0; EIGHT]; 6],
            places: [Place { block: 0, item: 0 }; EIGHT],
            corners: [[[0.0; EIGHT]; 3]; 3],
            parts: [0; EIGHT],
            block: 0,
            items: [0; EIGHT],
        }
    }
}

impl Eight {
    /// The triangle of a lane, as a hit.
    #[inline(always)]
    pub fn hit(&self, lane: usize) -> TriHit {
        TriHit { block: self.block, tri: self.items[lane % EIGHT], ..TriHit::none(0.0) }
    }

    /// Removes everything; what follows are triangles or children.
    #[cfg(any(test, feature = "brute"))]
    pub(super) fn clear(&mut self, is_leaf: bool) {
        (self.mask, self.leaves, self.is_leaf) = (0, 0, is_leaf);
    }

    /// Adds a child; true if all lanes are in use.
    #[cfg(any(test, feature = "brute"))]
    pub(super) fn child(&mut self, place: Place, bounds: &Bounds, is_leaf: bool) -> bool {
        let lane = self.mask.trailing_ones() as usize % EIGHT;
        let ends = [bounds.min, bounds.max];
        (0..6).for_each(|row| self.bounds[row][lane] = ends[row / 3][row % 3].into());
        self.places[lane] = place;
        self.leaves |= u32::from(is_leaf) << lane;
        self.add()
    }

    /// Adds a triangle; true if all lanes are in use.
    #[cfg(any(test, feature = "brute"))]
    pub(super) fn add_triangle(&mut self, hit: &TriHit, triangle: &Triangle) -> bool {
        let lane = self.mask.trailing_ones() as usize % EIGHT;
        for (corner, v) in self.corners.iter_mut().zip(triangle.vertices) {
            (0..3).for_each(|axis| corner[axis][lane] = v[axis].into());
        }
        (self.block, self.items[lane], self.parts[lane]) = (hit.block, hit.tri, triangle.part);
        self.add()
    }

    #[cfg(any(test, feature = "brute"))]
    fn add(&mut self) -> bool {
        self.mask = self.mask << 1 | 1;
        self.mask == (1 << EIGHT) - 1
    }
}

/// Makes eights of what `expand` finds: for a structure that has none of its own.
#[cfg(any(test, feature = "brute"))]
pub(super) fn eights_of(
    expand: impl FnOnce(&mut super::Below) -> Result<(), BlockId>,
    out: &mut Eight,
    each: &mut impl FnMut(&Eight),
) -> Result<(), BlockId> {
    let shared = std::cell::RefCell::new((out, each));
    shared.borrow_mut().0.clear(false);
    let mut child = |place, bounds: &Bounds, is_leaf| {
        let (out, each) = &mut *shared.borrow_mut();
        if out.child(place, bounds, is_leaf) {
            each(out);
            out.clear(false);
        }
    };
    let mut triangle = |hit: &TriHit, triangle: &Triangle| {
        let (out, each) = &mut *shared.borrow_mut();
        if !out.is_leaf {
            out.clear(true);
        }
        if out.add_triangle(hit, triangle) {
            each(out);
            out.clear(true);
        }
    };
    expand(&mut super::Below { child: &mut child, triangle: &mut triangle })?;
    let (out, each) = shared.into_inner();
    if out.mask != 0 {
        each(out);
    }
    Ok(())
}
