//! Rows of weights: points as sums of earlier ones.

use super::masks::Row;
use glam::DVec3;

/// Rows of a sparse matrix.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    start: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl Default for Rows {
    fn default() -> Self {
        Rows { start: vec![0], entries: Vec::new() }
    }
}

impl Rows {
    pub fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// Adds a row in which no number occurs twice and no weight is zero.
    pub fn push(&mut self, row: &mut Row) {
        merge(row);
        self.entries.extend_from_slice(row);
        self.start.push(self.entries.len() as u32);
    }

    pub fn row(&self, i: usize) -> &[(u32, f64)] {
        &self.entries[self.start[i] as usize..self.start[i + 1] as usize]
    }

    /// The length of the longest row.
    pub fn longest(&self) -> usize {
        (0..self.len()).map(|i| self.row(i).len()).max().unwrap_or(0)
    }

    /// The sum of row `i`'s points.
    pub fn point(&self, i: usize, points: &[DVec3]) -> DVec3 {
        self.row(i).iter().fold(DVec3::ZERO, |sum, &(j, weight)| sum + points[j as usize] * weight)
    }

    /// The product of a vector from the left with the matrix, of `columns` columns.
    pub fn left(&self, vector: &[f64], columns: usize) -> Vec<f64> {
        let mut out = vec![0.0; columns];
        for (i, &x) in vector.iter().enumerate().filter(|&(_, &x)| x != 0.0) {
            self.row(i).iter().for_each(|&(j, weight)| out[j as usize] += x * weight);
        }
        out
    }
}

/// Sums the weights of each number, in ascending order, and drops those of zero.
pub(super) fn merge(row: &mut Row) {
    row.sort_unstable_by_key(|&(i, _)| i);
    row.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 += next.1;
        }
        same
    });
    row.retain(|&(_, weight)| weight != 0.0);
}
