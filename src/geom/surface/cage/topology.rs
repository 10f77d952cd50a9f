//! Faces, edges and vertices of a cage, and the walk around a vertex.
//!
//! A *corner* is a vertex of a face; it also stands for the edge of its face from this corner to the next one.

/// Faces with their edges and the faces at edges and vertices. All lists are flat: a list of starts, one more than
/// there are items, and the items' contents.
#[derive(Debug, Clone, Default)]
pub(super) struct Topology {
    /// First corner of each face.
    pub face_start: Vec<u32>,
    /// Vertex of each corner.
    pub corners: Vec<u32>,
    /// Face of each corner.
    pub corner_face: Vec<u32>,
    /// Edge from each corner to the next one of its face.
    pub corner_edge: Vec<u32>,
    /// Vertices of each edge, the smaller one first; edges are in ascending order. Few occur twice (`face_repeats`).
    pub edges: Vec<[u32; 2]>,
    /// First of the corners of each edge in `edge_corners`.
    pub edge_start: Vec<u32>,
    /// Corners whose edge this is: one a face.
    pub edge_corners: Vec<u32>,
    /// First of the corners of each vertex in `vertex_corners`.
    pub vertex_start: Vec<u32>,
    /// Corners at each vertex.
    pub vertex_corners: Vec<u32>,
    /// First of the edges of each vertex in `vertex_edges`.
    pub vertex_edge_start: Vec<u32>,
    /// Edges at each vertex.
    pub vertex_edges: Vec<u32>,
}

/// Ends of lists by their lengths: 0, then the sums.
fn starts(counts: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut sum = 0;
    let mut out = vec![0];
    out.extend(counts.map(|count| {
        sum += count;
        sum
    }));
    out
}

/// Items sorted by a key below `keys` (counting sort): starts of the lists, and the lists.
fn grouped(keys: usize, items: &[u32], key: impl Fn(u32) -> u32) -> (Vec<u32>, Vec<u32>) {
    let mut counts = vec![0; keys];
    for &item in items {
        counts[key(item) as usize] += 1;
    }
    let start = starts(counts.iter().copied());
    counts.fill(0);
    let mut lists = vec![0; items.len()];
    for &item in items {
        let list = key(item) as usize;
        lists[(start[list] + counts[list]) as usize] = item;
        counts[list] += 1;
    }
    (start, lists)
}

impl Topology {
    /// Topology of faces whose vertices are below `vertices`. The counts fit `u32`.
    pub fn new(face_start: Vec<u32>, corners: Vec<u32>, vertices: usize) -> Self {
        let mut corner_face = Vec::with_capacity(corners.len());
        for (face, ends) in face_start.windows(2).enumerate() {
            corner_face.extend((ends[0]..ends[1]).map(|_| face as u32));
        }
        let all: Vec<u32> = (0..corners.len() as u32).collect();
        let (vertex_start, vertex_corners) = grouped(vertices, &all, |h| corners[h as usize]);
        let mut made = Topology { face_start, corners, corner_face, vertex_start, vertex_corners, ..Self::default() };
        made.make_edges(&all, vertices);
        made
    }

    fn make_edges(&mut self, all: &[u32], vertices: usize) {
        let (start, mut sorted) = grouped(vertices, all, |h| self.ends(h)[0]);
        for list in start.windows(2) {
            sorted[list[0] as usize..list[1] as usize].sort_unstable_by_key(|&h| (self.ends(h)[1], h));
        }
        self.corner_edge = vec![0; all.len()];
        self.edge_start.push(0);
        for (i, &h) in sorted.iter().enumerate() {
            let ends = self.ends(h);
            if self.edges.last() != Some(&ends) || ends[0] == ends[1] || self.face_repeats(&sorted[..=i]) {
                if i > 0 {
                    self.edge_start.push(i as u32);
                }
                self.edges.push(ends);
            }
            self.corner_edge[h as usize] = self.edges.len() as u32 - 1;
        }
        if !sorted.is_empty() {
            self.edge_start.push(sorted.len() as u32);
        }
        self.edge_corners = sorted;
        let sides: Vec<u32> = (0..2 * self.edges.len() as u32).collect();
        let (start, mut lists) = grouped(vertices, &sides, |s| self.edges[s as usize / 2][s as usize % 2]);
        lists.iter_mut().for_each(|side| *side /= 2);
        (self.vertex_edge_start, self.vertex_edges) = (start, lists);
    }

    /// The last of some corners, in ascending order, is of the face of the one before it. A face that runs along an
    /// edge twice has two edges there, and an edge from a vertex to itself has no other face: as in OpenSubdiv, both
    /// are non-manifold.
    fn face_repeats(&self, corners: &[u32]) -> bool {
        let [.., before, last] = corners else { return false };
        self.corner_face[*before as usize] == self.corner_face[*last as usize]
    }

    fn ends(&self, h: u32) -> [u32; 2] {
        let (a, b) = (self.corners[h as usize], self.corners[self.next(h) as usize]);
        [a.min(b), a.max(b)]
    }

    pub fn faces(&self) -> usize {
        self.face_start.len() - 1
    }

    pub fn vertices(&self) -> usize {
        self.vertex_start.len() - 1
    }

    pub fn face_size(&self, face: u32) -> u32 {
        self.face_start[face as usize + 1] - self.face_start[face as usize]
    }

    /// Vertices of a face.
    pub fn face(&self, face: u32) -> &[u32] {
        let face = face as usize;
        &self.corners[self.face_start[face] as usize..self.face_start[face + 1] as usize]
    }

    pub fn corners_of_edge(&self, edge: u32) -> &[u32] {
        let edge = edge as usize;
        &self.edge_corners[self.edge_start[edge] as usize..self.edge_start[edge + 1] as usize]
    }

    pub fn corners_at(&self, vertex: u32) -> &[u32] {
        let vertex = vertex as usize;
        &self.vertex_corners[self.vertex_start[vertex] as usize..self.vertex_start[vertex + 1] as usize]
    }

    pub fn edges_at(&self, vertex: u32) -> &[u32] {
        let vertex = vertex as usize;
        &self.vertex_edges[self.vertex_edge_start[vertex] as usize..self.vertex_edge_start[vertex + 1] as usize]
    }

    /// The end of an edge that is not `vertex`.
    pub fn other_end(&self, edge: u32, vertex: u32) -> u32 {
        let [a, b] = self.edges[edge as usize];
        if a == vertex { b } else { a }
    }

    pub fn find_edge(&self, a: u32, b: u32) -> Option<u32> {
        self.edges.binary_search(&[a.min(b), a.max(b)]).ok().map(|edge| edge as u32)
    }

    /// The corner `steps` after `h` in its face.
    pub fn ahead(&self, h: u32, steps: u32) -> u32 {
        let face = self.corner_face[h as usize];
        let start = self.face_start[face as usize];
        start + (h - start + steps) % self.face_size(face)
    }

    pub fn next(&self, h: u32) -> u32 {
        self.ahead(h, 1)
    }

    pub fn prev(&self, h: u32) -> u32 {
        self.ahead(h, self.face_size(self.corner_face[h as usize]) - 1)
    }

    /// The corner of the only other face at the edge of `h`, if that face runs along the edge in the other direction.
    pub fn twin(&self, h: u32) -> Option<u32> {
        let &[a, b] = self.corners_of_edge(self.corner_edge[h as usize]) else { return None };
        (self.corners[a as usize] != self.corners[b as usize]).then_some(if a == h { b } else { a })
    }

    /// True for edges of more than two faces, of two that run along it in the same direction, from a vertex to itself,
    /// and along which a face runs twice.
    pub fn edge_is_non_manifold(&self, edge: u32) -> bool {
        let (corners, ends) = (self.corners_of_edge(edge), self.edges[edge as usize]);
        let again = |other: u32| self.edges.get(other as usize) == Some(&ends);
        corners.len() > 2
            || corners.len() == 2 && self.twin(corners[0]).is_none()
            || ends[0] == ends[1]
            || again(edge.wrapping_sub(1))
            || again(edge + 1)
    }

    /// The corners around a vertex from one edge at which `stop` holds, or at which the faces end, to the next one,
    /// anticlockwise. `h` is among them. Returns whether the walk closed, in which case it starts at `h`.
    pub fn sector(&self, h: u32, stop: impl Fn(u32) -> bool, out: &mut Vec<u32>) -> bool {
        out.clear();
        let clockwise = |h: u32| {
            let twin = self.twin(h).filter(|_| !stop(self.corner_edge[h as usize]))?;
            Some(self.next(twin))
        };
        let anticlockwise = |h: u32| {
            let entering = self.prev(h);
            self.twin(entering).filter(|_| !stop(self.corner_edge[entering as usize]))
        };
        let mut first = h;
        while let Some(corner) = clockwise(first) {
            first = corner;
            if corner == h {
                break;
            }
        }
        let closed = first == h && clockwise(h).is_some();
        out.push(first);
        while let Some(corner) = out.last().copied().and_then(anticlockwise) {
            if corner == first {
                break;
            }
            out.push(corner);
        }
        closed
    }

    /// True if the faces at the vertex form one fan and its edges have two faces at most.
    pub fn vertex_is_manifold(&self, vertex: u32, walk: &mut Vec<u32>) -> bool {
        let corners = self.corners_at(vertex);
        if corners.is_empty() {
            return true;
        }
        self.sector(corners[0], |_| false, walk);
        walk.len() == corners.len() && !self.edges_at(vertex).iter().any(|&edge| self.edge_is_non_manifold(edge))
    }
}
