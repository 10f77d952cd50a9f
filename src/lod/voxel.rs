//! The look of a cell from each of its six sides.
//!
//! Áfra 2012, section 4.2, stores an attribute sample for each side of a voxel. The paper computes the samples with
//! rays or by rasterising triangles. Here they are composited from those of the children, front to back on a small grid
//! over each side. This needs no second pass over the triangles and no random numbers.

use crate::math::Bounds;
use glam::Vec3;

/// Cells of the grid along each edge of a side.
const GRID: usize = 4;
/// Greatest number of children of a node.
const CHILDREN: usize = 8;
/// Lanes in which all six sides are computed at once, and two unused lanes: they fill vectors of four and of eight.
const LANES: usize = 8;

/// One triangle of a leaf.
#[derive(Debug, Clone, Copy)]
pub struct Facet {
    /// Unit normal, of either sign, times twice the area.
    pub normal: Vec3,
    /// Linear colour.
    pub colour: Vec3,
    /// The triangle's part.
    pub part: u32,
    /// True if the colour is the triangle's own and not its part's.
    pub is_own_colour: bool,
}

/// Means over the surface that is visible from one side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Mean of the unit normals, each turned towards this side. The more the normals differ, the shorter it is.
    pub normal: Vec3,
    /// Linear colour.
    pub colour: Vec3,
    /// Covered share of the side, 0 to 1.
    pub cover: f32,
}

impl Sample {
    /// No surface.
    pub const NOTHING: Self = Self { normal: Vec3::ZERO, colour: Vec3::ZERO, cover: 0.0 };
}

/// Samples and parts of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Voxel {
    /// Samples of the sides: low x, y, z, then high x, y, z.
    pub sides: [Sample; 6],
    /// The part with the greatest visible area.
    pub part: u32,
    /// Visible area of that part.
    weight: f32,
    /// True if there are other parts.
    pub is_mixed: bool,
    /// The bits of all parts in the cell ([`summary_bit`]).
    pub summary: u32,
    /// True if some triangles have a colour other than that of their part.
    pub has_own_colours: bool,
}

/// Returns a part's bit in a summary. If a summary lacks the bit, its set of parts lacks the part. Consecutive parts
/// have consecutive bits, so the summary of a shared mesh's parts, rotated, is that of the model's parts.
#[inline]
pub fn summary_bit(part: u32) -> u32 {
    1 << (part % 32)
}

/// Axis of a side, and true if it is the high side.
#[inline]
pub(super) fn axis_of(side: usize) -> (usize, bool) {
    (side % 3, side >= 3)
}

/// A weighted sum of samples, from which a mean is computed.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sum {
    pub normal: Vec3,
    pub colour: Vec3,
    pub weight: f32,
}

impl Sum {
    pub fn add(&mut self, normal: Vec3, colour: Vec3, weight: f32) {
        self.normal += normal * weight;
        self.colour += colour * weight;
        self.weight += weight;
    }

    pub fn mean(&self, cover: f32) -> Sample {
        if !(self.weight > 0.0 && self.weight.is_finite()) {
            return Sample::NOTHING;
        }
        let by = 1.0 / self.weight;
        let sample = Sample { normal: self.normal * by, colour: self.colour * by, cover };
        if sample.normal.is_finite() && sample.colour.is_finite() { sample } else { Sample::NOTHING }
    }
}

/// Turns a normal so that it points out of the cell on `side`.
pub(super) fn toward(normal: Vec3, side: usize) -> Vec3 {
    let (axis, high) = axis_of(side);
    if (normal[axis] < 0.0) == high { -normal } else { normal }
}

impl Voxel {
    /// Returns the voxel of the triangles of a leaf, at least one, in `cell`.
    pub fn of_leaf(cell: &Bounds, facets: &[Facet]) -> Self {
        let extent = cell.extent();
        let mut sums = [Sum::default(); 6];
        for f in facets {
            let size = f.normal.length();
            if size > 0.0 && size.is_finite() {
                let unit = f.normal / size;
                for (side, sum) in sums.iter_mut().enumerate() {
                    sum.add(toward(unit, side), f.colour, f.normal[axis_of(side).0].abs());
                }
            }
        }
        let mut sides = [Sample::NOTHING; 6];
        for (side, (sample, sum)) in sides.iter_mut().zip(&sums).enumerate() {
            let (axis, _) = axis_of(side);
            let face = extent[(axis + 1) % 3] * extent[(axis + 2) % 3];
            // The length of a facet's normal is twice the facet's area.
            let cover = if face > 0.0 { (0.5 * sum.weight / face).min(1.0) } else { 1.0 };
            *sample = sum.mean(cover);
        }
        let has_own_colours = facets.iter().any(|f| f.is_own_colour);
        let mut voxel = Self { sides, part: facets[0].part, weight: 0.0, is_mixed: false, summary: 0, has_own_colours };
        voxel.fill_unseen(facets);
        let parts = facets.iter().map(|f| (f.part, f.normal.length(), summary_bit(f.part), false));
        voxel.gather_parts(parts);
        voxel
    }

    /// A voxel that shows `sides`, all of one part and in colours of its own.
    pub fn of_sides(sides: [Sample; 6], part: u32) -> Self {
        Self { sides, part, weight: 0.0, is_mixed: false, summary: summary_bit(part), has_own_colours: true }
    }

    /// Composites the voxels of a node's children, at least one and at most eight, each in its box.
    pub fn over<'a>(children: impl Iterator<Item = (&'a Bounds, &'a Voxel)> + Clone) -> Self {
        let cell = children.clone().fold(Bounds::EMPTY, |all, (b, _)| all.union(*b));
        let (sides, seen) = composite(&cell, children.clone());
        let has_own_colours = children.clone().any(|(_, v)| v.has_own_colours);
        let (mut part, mut parts) = (0, [(0, 0.0, 0, false); CHILDREN]);
        for (i, (_, v)) in children.enumerate().take(CHILDREN) {
            (parts[i], part) = ((v.part, seen[i], v.summary, v.is_mixed), i + 1);
        }
        let mut voxel = Self { sides, part: parts[0].0, weight: 0.0, is_mixed: false, summary: 0, has_own_colours };
        voxel.gather_parts(parts[..part].iter().copied());
        voxel
    }

    /// Fills sides from which nothing is visible, because all facets are edge-on there. They get the mean of all
    /// facets.
    fn fill_unseen(&mut self, facets: &[Facet]) {
        let is_unseen = |sample: &Sample| sample.cover == 0.0 || sample.normal == Vec3::ZERO;
        if !self.sides.iter().any(is_unseen) {
            return;
        }
        let mut sum = Sum::default();
        for f in facets {
            let size = f.normal.length();
            if size > 0.0 && size.is_finite() {
                let unit = f.normal / size;
                sum.add(if unit.dot(sum.normal) < 0.0 { -unit } else { unit }, f.colour, size);
            }
        }
        let all = sum.mean(0.0);
        for (side, sample) in self.sides.iter_mut().enumerate() {
            if is_unseen(sample) {
                *sample = Sample { normal: toward(all.normal, side), cover: sample.cover, ..all };
            }
        }
    }

    /// Finds the part with the greatest visible area. `parts`: part, visible area, summary, true if mixed.
    fn gather_parts(&mut self, parts: impl Iterator<Item = (u32, f32, u32, bool)> + Clone) {
        let weight_of = |part: u32| parts.clone().filter(|p| p.0 == part).map(|p| p.1).sum::<f32>();
        (self.part, self.weight) = (self.part, weight_of(self.part));
        for (part, _, summary, mixed) in parts.clone() {
            self.is_mixed |= mixed || part != self.part;
            self.summary |= summary;
            let weight = if part == self.part { self.weight } else { weight_of(part) };
            // The lowest of equally visible parts wins, so that the order of children does not matter.
            if weight > self.weight || weight == self.weight && part < self.part {
                (self.part, self.weight) = (part, weight);
            }
        }
    }
}

/// Composites the children from all sides, front to back. Each child is weighted by the light that those in front of it
/// transmit. Also returns the visible area of each child.
///
/// All sides are computed at once, one in each lane; from each side the nearest child comes first.
fn composite<'a>(
    cell: &Bounds,
    children: impl Iterator<Item = (&'a Bounds, &'a Voxel)>,
) -> ([Sample; 6], [f32; CHILDREN]) {
    let mut voxels = [None; CHILDREN];
    let (mut along, mut near, mut count) = ([[[0.0; GRID]; 3]; CHILDREN], [[0.0; CHILDREN]; 6], 0);
    for (bounds, voxel) in children.take(CHILDREN) {
        voxels[count] = Some(voxel);
        along[count] = [0, 1, 2].map(|axis| shares(cell, bounds, axis));
        for (side, near) in near.iter_mut().enumerate() {
            let (axis, high) = axis_of(side);
            near[count] = if high { -bounds.max[axis] } else { bounds.min[axis] };
        }
        count += 1;
    }
    let orders = near.map(|near| nearest_first(&near, count));
    let extent = cell.extent();
    let mut through = [[1.0; LANES]; GRID * GRID];
    let (mut sums, mut seen) = ([Sum::default(); 6], [0.0f32; CHILDREN]);
    let mut seen_of = [[0.0f32; 6]; CHILDREN];
    for nth in 0..count {
        let (mut along_u, mut along_v, mut cover) = ([[0.0; LANES]; GRID], [[0.0; LANES]; GRID], [0.0; LANES]);
        for (side, order) in orders.iter().enumerate() {
            let ((axis, _), slot) = (axis_of(side), order[nth]);
            let Some(voxel) = voxels[slot] else { continue };
            for i in 0..GRID {
                (along_u[i][side], along_v[i][side]) = (along[slot][(axis + 1) % 3][i], along[slot][(axis + 2) % 3][i]);
            }
            cover[side] = voxel.sides[side].cover;
        }
        let visible = cover_grid(&mut through, &along_u, &along_v, &cover);
        for (side, order) in orders.iter().enumerate() {
            let ((axis, _), slot) = (axis_of(side), order[nth]);
            let Some(voxel) = voxels[slot] else { continue };
            // A side without area is treated as if it were large: all children then lie in one plane or line.
            sums[side].add(voxel.sides[side].normal, voxel.sides[side].colour, visible[side].max(1e-6));
            seen_of[slot][side] =
                visible[side] * (extent[(axis + 1) % 3] * extent[(axis + 2) % 3]).max(f32::MIN_POSITIVE);
        }
    }
    for (seen, of) in seen.iter_mut().zip(&seen_of) {
        of.iter().for_each(|of_side| *seen += of_side);
    }
    let mut left = [0.0; LANES];
    for cell in &through {
        (0..LANES).for_each(|lane| left[lane] += cell[lane]);
    }
    let mut sides = [Sample::NOTHING; 6];
    for (side, sample) in sides.iter_mut().enumerate() {
        *sample = sums[side].mean((1.0 - left[side] / (GRID * GRID) as f32).clamp(0.0, 1.0));
    }
    (sides, seen)
}

/// The first `count` slots, sorted by distance, nearest first.
fn nearest_first(near: &[f32; CHILDREN], count: usize) -> [usize; CHILDREN] {
    let mut order = [0, 1, 2, 3, 4, 5, 6, 7];
    for i in 1..count {
        let (mut at, slot) = (i, order[i]);
        while at > 0 && near[slot].total_cmp(&near[order[at - 1]]).is_lt() {
            order[at] = order[at - 1];
            at -= 1;
        }
        order[at] = slot;
    }
    order
}

/// Covers the columns of the grid and reduces the light that they transmit. Returns the visible part of the cover. Each
/// lane is one side.
fn cover_grid(
    through: &mut [[f32; LANES]; GRID * GRID],
    along_u: &[[f32; LANES]; GRID],
    along_v: &[[f32; LANES]; GRID],
    cover: &[f32; LANES],
) -> [f32; LANES] {
    let mut visible = [0.0; LANES];
    for (i, left) in through.iter_mut().enumerate() {
        let (su, sv) = (&along_u[i / GRID], &along_v[i % GRID]);
        for lane in 0..LANES {
            let covered = su[lane] * sv[lane] * cover[lane];
            visible[lane] += left[lane] * covered;
            left[lane] *= 1.0 - covered;
        }
    }
    visible
}

/// The share of each column of the grid that a box covers along an axis.
fn shares(cell: &Bounds, b: &Bounds, axis: usize) -> [f32; GRID] {
    let size = cell.max[axis] - cell.min[axis];
    if size.is_nan() || size <= 0.0 {
        return [1.0; GRID];
    }
    let scale = GRID as f32 / size;
    let (from, to) = ((b.min[axis] - cell.min[axis]) * scale, (b.max[axis] - cell.min[axis]) * scale);
    let mut out = [0.0; GRID];
    for (i, share) in out.iter_mut().enumerate() {
        let low = i as f32;
        *share = (to.min(low + 1.0) - from.max(low)).clamp(0.0, 1.0);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cell(min: [f32; 3], max: [f32; 3]) -> Bounds {
        Bounds { min: min.into(), max: max.into() }
    }

    fn facet(normal: [f32; 3], colour: [f32; 3], part: u32) -> Facet {
        Facet { normal: normal.into(), colour: colour.into(), part, is_own_colour: true }
    }

    const RED: [f32; 3] = [1.0, 0.0, 0.0];
    const BLUE: [f32; 3] = [0.0, 0.0, 1.0];

    #[test]
    fn a_square_in_its_plane_covers_its_side_and_faces_both_ways() {
        // Two triangles of the unit square at z = 0, with opposite windings.
        let flat = cell([0.0; 3], [1.0, 1.0, 0.0]);
        let v = Voxel::of_leaf(&flat, &[facet([0.0, 0.0, 1.0], RED, 3), facet([0.0, 0.0, -1.0], RED, 3)]);
        assert_eq!(v.sides[2].normal, -Vec3::Z);
        assert_eq!(v.sides[5].normal, Vec3::Z);
        assert_eq!((v.sides[2].cover, v.part, v.is_mixed, v.summary), (1.0, 3, false, summary_bit(3)));
    }

    #[test]
    fn front_children_hide_back_children() {
        let (front, back) = (cell([0.0; 3], [1.0, 1.0, 0.1]), cell([0.0, 0.0, 0.9], [1.0, 1.0, 1.0]));
        let a = Voxel::of_leaf(&front, &[facet([0.0, 0.0, 2.0], RED, 0)]);
        let b = Voxel::of_leaf(&back, &[facet([0.0, 0.0, 2.0], BLUE, 1)]);
        let v = Voxel::over([(&front, &a), (&back, &b)].into_iter());
        assert!(v.sides[2].colour.distance(RED.into()) < 1e-4, "{:?}", v.sides[2]);
        assert!(v.sides[5].colour.distance(BLUE.into()) < 1e-4, "{:?}", v.sides[5]);
        assert!(v.is_mixed && v.summary == summary_bit(0) | summary_bit(1));
    }

    #[test]
    fn half_covered_sides_transmit_half_and_averages_are_linear() {
        // On a side of 1 x 1, red has an area of a half and is in front of blue, which has an area of 1.
        let front = cell([0.0; 3], [1.0, 1.0, 0.1]);
        let back = cell([0.0, 0.0, 0.5], [1.0, 1.0, 1.0]);
        let a = Voxel::of_leaf(&front, &[facet([0.0, 0.0, 1.0], RED, 0)]);
        let b = Voxel::of_leaf(&back, &[facet([0.0, 0.0, 2.0], BLUE, 0)]);
        let v = Voxel::over([(&front, &a), (&back, &b)].into_iter());
        // Red and blue each contribute a half. Then nothing is transmitted.
        assert!(v.sides[2].colour.distance(Vec3::new(0.5, 0.0, 0.5)) < 1e-4);
        assert!((v.sides[2].cover - 1.0).abs() < 1e-5);
        // From behind, blue hides red.
        assert!(v.sides[5].colour.distance(BLUE.into()) < 1e-4);
    }

    #[test]
    fn opposing_sheets_never_cancel_out() {
        let c = cell([0.0; 3], [1.0; 3]);
        let v = Voxel::of_leaf(&c, &[facet([0.3, 0.0, 1.0], RED, 0), facet([-0.3, 0.0, -1.0], RED, 0)]);
        for (side, s) in v.sides.iter().enumerate() {
            assert!(s.normal.length() > 0.2, "{side}: {s:?}");
            assert!(s.colour == Vec3::from(RED));
        }
    }

    #[test]
    fn the_order_of_children_does_not_matter_for_the_part() {
        let boxes = [cell([0.0; 3], [1.0; 3]), cell([1.0, 0.0, 0.0], [2.0, 1.0, 1.0])];
        let voxels = [7, 4].map(|p| Voxel::of_leaf(&boxes[0], &[facet([0.0, 0.0, 2.0], RED, p)]));
        let one = Voxel::over(boxes.iter().zip(&voxels));
        let two = Voxel::over(boxes.iter().zip(voxels.iter().rev()));
        assert_eq!((one.part, two.part), (4, 4));
    }

    #[test]
    fn nothing_is_ever_nan() {
        for (normal, extent) in [([0.0; 3], 0.0), ([f32::MAX; 3], 1e30), ([1e-38, 0.0, 0.0], 1e-30)] {
            let c = cell([0.0; 3], [extent; 3]);
            let leaf = Voxel::of_leaf(&c, &[facet(normal, RED, 0)]);
            let v = Voxel::over([(&c, &leaf), (&c, &leaf)].into_iter());
            for s in leaf.sides.iter().chain(&v.sides) {
                assert!(s.normal.is_finite() && s.colour.is_finite() && (0.0..=1.0).contains(&s.cover), "{s:?}");
            }
        }
    }

    // The scalar twin of `composite`: one side after the other.

    /// A child's box and its sample for the side.
    type Seen<'a> = (&'a Bounds, &'a Sample);

    /// Composites the children from one side, front to back. Each child is weighted by the light that those in front of
    /// it transmit. Adds the visible area of each child to `seen`.
    fn from_one_side<'a>(
        cell: &Bounds,
        side: usize,
        children: impl Iterator<Item = (&'a Bounds, &'a Voxel)>,
        seen: &mut [f32; 8],
    ) -> Sample {
        let (axis, high) = axis_of(side);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut order: [(f32, usize, Option<Seen>); 8] = [(f32::INFINITY, 8, None); 8];
        for ((slot, entry), (bounds, voxel)) in order.iter_mut().enumerate().zip(children) {
            let near = if high { -bounds.max[axis] } else { bounds.min[axis] };
            *entry = (near, slot, Some((bounds, &voxel.sides[side])));
        }
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut through = [[1.0f32; GRID]; GRID];
        let mut sum = Sum::default();
        for (_, slot, child) in order {
            let Some((bounds, sample)) = child else { break };
            let (along_u, along_v) = (shares(cell, bounds, u), shares(cell, bounds, v));
            let mut visible = 0.0;
            for (row, su) in through.iter_mut().zip(along_u) {
                for (left, sv) in row.iter_mut().zip(along_v) {
                    let covered = su * sv * sample.cover;
                    visible += *left * covered;
                    *left *= 1.0 - covered;
                }
            }
            // A side without area is treated as if it were large: all children then lie in one plane or line.
            sum.add(sample.normal, sample.colour, visible.max(1e-6));
            let extent = cell.extent();
            seen[slot & 7] += visible * (extent[u] * extent[v]).max(f32::MIN_POSITIVE);
        }
        let left: f32 = through.iter().flatten().sum();
        sum.mean((1.0 - left / (GRID * GRID) as f32).clamp(0.0, 1.0))
    }

    proptest! {
        /// Equality to the bit, for boxes on a grid: many begin at the same plane, and some are flat.
        #[test]
        fn composite_equals_one_side_after_the_other(
            boxes in prop::collection::vec(prop::array::uniform3((0i32..4, 0i32..3)), 1..=8),
            facets in prop::collection::vec((prop::array::uniform3(-1.0f32..1.0), prop::array::uniform3(0.0f32..1.0), 0u32..3), 8),
        ) {
            let all: Vec<(Bounds, Voxel)> = boxes.iter().zip(&facets).map(|(at, (normal, colour, part))| {
                let [low, high] = [0, 1].map(|end| at.map(|(from, size)| (from + end * size) as f32));
                let b = cell(low, high);
                (b, Voxel::of_leaf(&b, &[facet(*normal, *colour, *part)]))
            }).collect();
            let children = || all.iter().map(|(b, v)| (b, v));
            let whole = all.iter().fold(Bounds::EMPTY, |whole, (b, _)| whole.union(*b));
            let (sides, seen) = composite(&whole, children());
            let mut seen_one_by_one = [0.0; CHILDREN];
            for (side, found) in sides.iter().enumerate() {
                prop_assert_eq!(*found, from_one_side(&whole, side, children(), &mut seen_one_by_one), "{}", side);
            }
            prop_assert_eq!(seen, seen_one_by_one);
        }
    }
}
