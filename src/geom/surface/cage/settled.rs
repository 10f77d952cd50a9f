//! Quads whose surface needs no further subdivision: regular ones, which are bicubic B-splines, and those with one
//! irregular vertex around which each level repeats the last one.

use super::level::Cage;
use super::masks::Row;
use super::rules::{INFINITE, Rule, is_semi_sharp};

/// The faces around one vertex of a quad between infinitely sharp edges, where nothing is semi-sharp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Sector {
    /// Number of faces.
    pub faces: u32,
    /// The quad's number in the sector, anticlockwise; 0 if it is closed.
    pub position: u32,
    /// Edges at both ends, or `closed` (no end), or one edge at both ends.
    pub ends: Ends,
    /// The rule of the vertex.
    pub rule: Rule,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Ends {
    Closed,
    /// One sharp edge in a closed fan.
    Dart,
    Two,
}

impl Sector {
    /// True if the vertex is one of a uniform bicubic B-spline, mirrored at sharp edges.
    pub fn is_regular(self) -> bool {
        matches!(
            (self.ends, self.rule, self.faces),
            (Ends::Closed, Rule::Smooth, 4) | (Ends::Two, Rule::Crease, 2) | (Ends::Two, Rule::Corner, 1)
        )
    }

    pub fn is_closed(self) -> bool {
        self.ends == Ends::Closed
    }
}

/// A quad's state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Quad {
    Regular,
    /// Regular but for this corner; so is its child there, with the same sector.
    Irregular(u32, Sector),
    /// Along an even semi-sharp edge: its side and sharpness.
    Creased(u32, f32),
    Unsettled,
}

impl Cage {
    fn is_infinite(&self, edge: u32) -> bool {
        self.edge_sharpness[edge as usize] >= INFINITE
    }

    /// The edge from corner `side` of a quad to the next one has infinite sharpness.
    fn side_is_sharp(&self, quad: u32, side: u32) -> bool {
        let first = self.topology.face_start[quad as usize];
        self.is_infinite(self.topology.corner_edge[(first + side % 4) as usize])
    }

    /// The sector of a corner, or `None` if something at the vertex is semi-sharp or a face there is no quad.
    pub(super) fn sector(&self, h: u32, walk: &mut Vec<u32>) -> Option<Sector> {
        let topology = &self.topology;
        let vertex = topology.corners[h as usize];
        let quads = |&h: &u32| topology.face_size(topology.corner_face[h as usize]) == 4;
        if is_semi_sharp(self.vertex_sharpness[vertex as usize])
            || self.sharpness_around(vertex).any(is_semi_sharp)
            || !topology.corners_at(vertex).iter().all(quads)
        {
            return None;
        }
        let closed = topology.sector(h, |edge| self.is_infinite(edge), walk);
        let first = topology.corner_edge[walk[0] as usize];
        let last = topology.corner_edge[topology.prev(walk[walk.len() - 1]) as usize];
        let ends = match closed {
            true => Ends::Closed,
            false if first == last => Ends::Dart,
            false => Ends::Two,
        };
        let position = walk.iter().position(|&other| other == h).unwrap_or(0) as u32;
        Some(Sector { faces: walk.len() as u32, position, ends, rule: self.rule_of(vertex) })
    }

    /// The state of a face.
    pub(super) fn state(&self, face: u32, walk: &mut Vec<u32>) -> Quad {
        if self.topology.face_size(face) != 4 {
            return Quad::Unsettled;
        }
        let first = self.topology.face_start[face as usize];
        let mut state = Quad::Regular;
        for corner in 0..4 {
            let Some(sector) = self.sector(first + corner, walk) else {
                let creased = self.creased_side(face, walk);
                return creased.map_or(Quad::Unsettled, |(side, sharpness)| Quad::Creased(side, sharpness));
            };
            if sector.is_regular() {
                continue;
            }
            // The far sides of the child are inside of the quad: those of the quad must be smooth like them.
            let repeats = !self.side_is_sharp(face, corner + 1) && !self.side_is_sharp(face, corner + 2);
            if state != Quad::Regular || !repeats {
                return Quad::Unsettled;
            }
            state = Quad::Irregular(corner, sector);
        }
        state
    }

    /// The vertices that the surface of a settled quad depends on: those of the faces of the sectors at its corners,
    /// from `corner` on. Equal sectors give equal orders.
    pub(super) fn ring(&self, quad: u32, corner: u32) -> Vec<u32> {
        let topology = &self.topology;
        let first = topology.face_start[quad as usize];
        let mut numbered = std::collections::HashSet::new();
        let (mut ring, mut walk) = (Vec::new(), Vec::new());
        for step in 0..4 {
            let h = first + (corner + step) % 4;
            topology.sector(h, |edge| self.is_infinite(edge), &mut walk);
            let vertices = walk.iter().flat_map(|&h| (0..4).map(move |step| topology.ahead(h, step)));
            ring.extend(vertices.map(|h| topology.corners[h as usize]).filter(|&vertex| numbered.insert(vertex)));
        }
        // At non-manifold vertices a crease can leave the sector.
        let vertex = ring[0];
        let sharp = topology.edges_at(vertex).iter().filter(|&&edge| self.is_infinite(edge));
        if self.rule_of(vertex) == Rule::Crease {
            ring.extend(sharp.map(|&edge| topology.other_end(edge, vertex)).filter(|&end| numbered.insert(end)));
        }
        ring
    }

    /// The 4 × 4 control points of a regular quad, rows along u, as weights of vertices. `corner` is that at u = v = 0.
    ///
    /// Beyond infinitely sharp edges a point is mirrored at the edge (2 P₁ − P₂): the second derivative across is zero
    /// there, and the edge is the cubic B-spline of its own points. See Nießner, Loop, Meyer, DeRose, "Feature-adaptive
    /// GPU rendering of Catmull-Clark subdivision surfaces", ACM Transactions on Graphics 31(1), 2012, section 4.2.
    pub(super) fn control_points(&self, quad: u32, corner: u32) -> [Row; 16] {
        let topology = &self.topology;
        let first = topology.face_start[quad as usize];
        let mut grid: [Row; 16] = Default::default();
        let vertex = |h: u32| vec![(topology.corners[h as usize], 1.0)];
        for side in 0..4 {
            let h = first + (corner + side) % 4;
            grid[place(side, 1, 1)] = vertex(h);
            let twin = topology.twin(h).filter(|_| !self.is_infinite(topology.corner_edge[h as usize]));
            let Some(twin) = twin else { continue };
            // The twin runs from the side's second vertex to its first one.
            grid[place(side, 1, 0)] = vertex(topology.ahead(twin, 2));
            grid[place(side, 2, 0)] = vertex(topology.ahead(twin, 3));
            let beyond = topology.next(twin);
            if let Some(diagonal) = self.diagonal(beyond) {
                grid[place(side, 0, 0)] = vertex(diagonal);
            }
        }
        for side in 0..4 {
            for column in [1, 2] {
                extrapolate(&mut grid, place(side, column, 0), place(side, column, 1), place(side, column, 2));
            }
        }
        for side in 0..4 {
            let (along, across) = (place(side, 1, 0), place(side, 0, 1));
            // Along a crease the rows go on in the neighbour's points; the mirror is across the sharp side.
            if self.side_is_sharp(quad, corner + side) {
                extrapolate(&mut grid, place(side, 0, 0), across, place(side, 0, 2));
            } else {
                extrapolate(&mut grid, place(side, 0, 0), along, place(side, 2, 0));
            }
        }
        grid
    }

    /// The corner across the diagonal of the face that shares the clockwise edge of the face of `h` at its vertex.
    fn diagonal(&self, h: u32) -> Option<u32> {
        let topology = &self.topology;
        if self.is_infinite(topology.corner_edge[h as usize]) {
            return None;
        }
        let beyond = topology.next(topology.twin(h)?);
        Some(topology.ahead(beyond, 2))
    }
}

/// Index of a column and row of the grid that is turned so that `side` is its lower one.
fn place(side: u32, column: usize, row: usize) -> usize {
    let (column, row) = match side % 4 {
        0 => (column, row),
        1 => (3 - row, column),
        2 => (3 - column, 3 - row),
        _ => (row, 3 - column),
    };
    4 * row + column
}

/// Sets a point that is not there yet to 2 `at` − `inner`.
fn extrapolate(grid: &mut [Row; 16], outer: usize, at: usize, inner: usize) {
    if grid[outer].is_empty() {
        let mut row: Row = grid[at].iter().map(|&(vertex, weight)| (vertex, 2.0 * weight)).collect();
        row.extend(grid[inner].iter().map(|&(vertex, weight)| (vertex, -weight)));
        grid[outer] = row;
    }
}
