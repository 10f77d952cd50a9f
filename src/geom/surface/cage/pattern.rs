//! Subdivision around one irregular vertex, where each level repeats the last one.
//!
//! Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values", SIGGRAPH 1998: the
//! points of the ring one level deeper are a matrix times those of this level, and three of the quad's four children
//! are bicubic. The matrix is applied once a level instead of by its powers: half of all points need one step, and
//! numbers near the vertex are exact to a few units of their own size, since the limit point is taken off.

use super::level::Cage;
use super::limit::{Masks, masks};
use super::masks::Row;
use super::settled::{Quad, Sector};
use super::sparse::Rows;
use crate::base::error::{Error, Result};
use std::collections::HashMap;

/// The matrices of one sector. The vertex is at u = v = 0 of its quad.
#[derive(Debug)]
pub(super) struct Pattern {
    /// The ring one level deeper by this one.
    pub ring: Rows,
    /// The 16 control points of the quad's children 1, 2 and 3 (those not at the vertex), by the ring.
    pub children: Rows,
    /// The limit at the vertex by the ring.
    pub masks: Masks,
}

impl Pattern {
    /// The pattern of an irregular quad of a cage.
    pub fn new(cage: &Cage, quad: u32, corner: u32, sector: Sector) -> Result<Self> {
        let ring = cage.ring(quad, corner);
        let (part, vertices) = cage.around(&[quad]);
        let place: HashMap<u32, u32> = ring.iter().zip(0..).map(|(&vertex, i)| (vertex, i)).collect();
        let columns: Vec<Option<u32>> = vertices.iter().map(|vertex| place.get(vertex).copied()).collect();
        let child = part.refined();
        let deeper = child.ring(corner, corner);
        let mut rows = Rows::default();
        for &vertex in &deeper {
            rows.push(&mut expanded(&part, &columns, &[(vertex, 1.0)])?);
        }
        if rows.len() != ring.len() {
            return Err(broken());
        }
        let mut children = Rows::default();
        for step in 1..4 {
            let other = (corner + step) % 4;
            if child.state(other, &mut Vec::new()) != Quad::Regular {
                return Err(broken());
            }
            for point in child.control_points(other, corner) {
                children.push(&mut expanded(&part, &columns, &point)?);
            }
        }
        let masks = masks(sector, &rows);
        Ok(Pattern { ring: rows, children, masks })
    }
}

fn broken() -> Error {
    Error::Internal("subdivision around a vertex does not repeat".to_string())
}

/// Weights of children of a cage as weights of its vertices, renumbered by `columns`.
fn expanded(cage: &Cage, columns: &[Option<u32>], of: &[(u32, f64)]) -> Result<Row> {
    let vertices = cage.vertex_count() as u32;
    let (mut out, mut mask, mut face) = (Row::new(), Row::new(), Row::new());
    for &(child, weight) in of {
        cage.mask(child, &mut mask);
        if (vertices..cage.child_of_edge(0)).contains(&child) {
            out.extend(mask.iter().map(|&(vertex, w)| (vertex, w * weight)));
            continue;
        }
        for &(i, w) in &mask {
            if i < vertices {
                out.push((i, w * weight));
            } else {
                cage.mask(i, &mut face);
                out.extend(face.iter().map(|&(vertex, part)| (vertex, part * w * weight)));
            }
        }
    }
    super::sparse::merge(&mut out);
    for entry in &mut out {
        entry.0 = columns[entry.0 as usize].ok_or_else(broken)?;
    }
    Ok(out)
}
