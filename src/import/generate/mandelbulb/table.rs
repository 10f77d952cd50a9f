//! Polygons of a grid cell for each of the 256 sign patterns of its corners.
//!
//! Corner `c` of a cell is at +x if bit 0 of `c` is set, at +y for bit 1, at +z for bit 2. Bit `c` of a *mask* is set
//! if corner `c` is inside. Edge `4a + i + 2j` runs along axis `a`, at `i` along axis `a + 1` and `j` along axis `a +
//! 2` (axes modulo 3).

use std::sync::LazyLock;

/// Marks the absence of a polygon or a vertex.
pub const NONE: u8 = u8::MAX;

/// Structure of the surface in a cell with one mask.
#[derive(Debug, Clone, Copy)]
pub struct CellCase {
    /// Number of polygons, 0 to 4, each with one vertex of the mesh. Two vertices for each ambiguous low face follow
    /// them.
    pub polygons: u8,
    /// The polygon that crosses each edge, or [`NONE`].
    pub edge_polygon: [u8; 12],
    /// First vertex of the low face of each axis if its signs alternate, else [`NONE`].
    pub face_vertex: [u8; 3],
    /// Segment (0 or 1) of the low face of each axis that ends on each edge.
    pub face_segment: [[u8; 12]; 3],
}

/// Cases, indexed by mask.
pub static CASES: LazyLock<[CellCase; 256]> = LazyLock::new(|| std::array::from_fn(|m| case(m as u8)));

/// Returns the two corners of an edge, the lower one first.
pub const fn edge_corners(edge: usize) -> (usize, usize) {
    let (a, at) = (edge / 4, edge % 4);
    let (u, v) = ((a + 1) % 3, (a + 2) % 3);
    let low = ((at & 1) << u) | ((at >> 1) << v);
    (low, low | (1 << a))
}

/// Returns the index of the edge along `axis` with lower corner `low`; bit `axis` of `low` is clear.
const fn edge_at(axis: usize, low: usize) -> usize {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    axis * 4 + ((low >> u) & 1) + 2 * ((low >> v) & 1)
}

/// Returns the segments in which the surface crosses the face `side` (0 low, 1 high) across `axis`, as pairs of edges.
/// If signs alternate, each inside corner is cut off separately, so that both cells of the face agree.
fn face_segments(mask: u8, axis: usize, side: usize) -> Vec<[usize; 2]> {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let corner = |i: usize, j: usize| (side << axis) | (i << u) | (j << v);
    let inside = |c: usize| mask >> c & 1 == 1;
    let edges_of = |i: usize, j: usize| [edge_at(u, corner(0, j)), edge_at(v, corner(i, 0))];
    let crossed = |e: &usize| {
        let (a, b) = edge_corners(*e);
        inside(a) != inside(b)
    };
    let all = [edges_of(0, 0)[0], edges_of(0, 1)[0], edges_of(0, 0)[1], edges_of(1, 0)[1]];
    let hit: Vec<usize> = all.into_iter().filter(crossed).collect();
    match hit.len() {
        2 => vec![[hit[0], hit[1]]],
        4 => {
            let own = |i, j| inside(corner(i, j)).then(|| edges_of(i, j));
            [own(0, 0), own(1, 0), own(0, 1), own(1, 1)].into_iter().flatten().collect()
        }
        _ => Vec::new(),
    }
}

fn case(mask: u8) -> CellCase {
    let mut group: [usize; 12] = std::array::from_fn(|e| e);
    let mut crossed = [false; 12];
    for axis in 0..3 {
        for side in 0..2 {
            for [a, b] in face_segments(mask, axis, side) {
                (crossed[a], crossed[b]) = (true, true);
                let (from, to) = (group[a].max(group[b]), group[a].min(group[b]));
                group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
            }
        }
    }
    let mut edge_polygon = [NONE; 12];
    let mut polygons = 0;
    for e in 0..12 {
        if crossed[e] {
            if group[e] == e {
                edge_polygon[e] = polygons;
                polygons += 1;
            } else {
                edge_polygon[e] = edge_polygon[group[e]];
            }
        }
    }
    let mut vertices = polygons;
    let mut face_vertex = [NONE; 3];
    let mut face_segment = [[NONE; 12]; 3];
    for axis in 0..3 {
        let segments = face_segments(mask, axis, 0);
        if segments.len() == 2 {
            face_vertex[axis] = vertices;
            vertices += 2;
            for (i, s) in segments.iter().enumerate() {
                face_segment[axis][s[0]] = i as u8;
                face_segment[axis][s[1]] = i as u8;
            }
        }
    }
    CellCase { polygons, edge_polygon, face_vertex, face_segment }
}
