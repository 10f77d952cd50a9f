//! Neighbourhoods as words, for files.

use super::around::Neighbourhood;
use super::desc::MAX_VALENCE;
use super::rules::INFINITE;
use crate::base::error::{Error, Result};

/// Words before the lists: rules, numbers of vertices and of faces.
const HEAD: usize = 3;

impl Neighbourhood {
    /// Appends the neighbourhood's words: rules, number of vertices, number of faces; sizes of the faces; vertex
    /// numbers of their corners; bits of the sharpness of the corners' edges; those of the first face's vertices.
    pub fn write(&self, out: &mut Vec<u32>) {
        out.extend([self.rules, self.vertices, self.sizes.len() as u32]);
        for list in [&self.sizes, &self.corners, &self.edges, &self.sharpness] {
            out.extend_from_slice(list);
        }
    }

    /// The neighbourhood of words that [`write`](Self::write) made, and nothing after them.
    ///
    /// # Errors
    /// [`Error::BadArgument`] if they are no neighbourhood. Words of one that no cage has can pass: then
    /// [`Plans::plan`](super::Plans::plan) fails, or there is some surface.
    pub fn read(words: &[u32]) -> Result<Self> {
        let parts = Self::parts(words).ok_or_else(|| bad("its lists do not fit their lengths"))?;
        let (vertices, faces) = (parts.vertices, parts.sizes.len());
        if parts.rules > 3 || faces == 0 || vertices as usize > parts.corners.len() {
            return Err(bad("its head is out of range"));
        }
        if parts.corners.iter().any(|&vertex| vertex >= vertices) {
            return Err(bad("a vertex is out of range"));
        }
        let is_sharpness = |&bits: &u32| (0.0..=INFINITE).contains(&f32::from_bits(bits));
        if !parts.edges.iter().chain(&parts.sharpness).all(is_sharpness) {
            return Err(bad("sharpness is out of range"));
        }
        parts.check_edges()?;
        Ok(parts)
    }

    /// Takes the lists apart; `None` if there are more or fewer words.
    fn parts(words: &[u32]) -> Option<Self> {
        let (&[rules, vertices, faces], rest) = words.split_first_chunk::<HEAD>()?;
        let (sizes, rest) = rest.split_at_checked(faces as usize)?;
        if sizes.iter().any(|size| !(3..=MAX_VALENCE as u32).contains(size)) {
            return None;
        }
        let corners = usize::try_from(sizes.iter().map(|&size| u64::from(size)).sum::<u64>()).ok()?;
        let first = sizes.first().copied().unwrap_or(0) as usize;
        let (of_corners, rest) = rest.split_at_checked(corners)?;
        let (of_edges, of_vertices) = rest.split_at_checked(corners)?;
        let lists = (of_corners.to_vec(), of_edges.to_vec(), of_vertices.to_vec());
        let (corners, edges, sharpness) = lists;
        let sizes = sizes.to_vec();
        (sharpness.len() == first).then_some(Neighbourhood { rules, vertices, sizes, corners, edges, sharpness })
    }

    /// Boundaries and non-manifold edges at the first face are sharp, and its vertices have few faces.
    fn check_edges(&self) -> Result<()> {
        let cage = self.cage();
        let topology = &cage.topology;
        for &vertex in topology.face(0) {
            let edges = topology.edges_at(vertex);
            if edges.len().max(topology.corners_at(vertex).len()) > MAX_VALENCE {
                return Err(bad("a vertex has too many edges or faces"));
            }
            let must_be_sharp =
                |&edge: &u32| topology.corners_of_edge(edge).len() != 2 || topology.edge_is_non_manifold(edge);
            if edges.iter().any(|edge| must_be_sharp(edge) && cage.edge_sharpness[*edge as usize] < INFINITE) {
                return Err(bad("an edge of other than two faces is not sharp"));
            }
        }
        Ok(())
    }
}

fn bad(why: &str) -> Error {
    Error::bad_argument(format!("words of a neighbourhood: {why}"))
}
