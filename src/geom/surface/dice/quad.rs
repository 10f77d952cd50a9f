//! The triangles of one quad, row by row: memory is that of its sides and of two rows.

use super::{Dicer, Micro, Quads, Sample};
use crate::base::error::Result;
use crate::base::progress::Cancel;

/// Least number of triangles that are handed on at a time, unless the quad has fewer.
const BATCH: usize = 4096;

/// Dices a quad. `micro` is emptied first.
pub fn dice<Q: Quads>(
    dicer: &Dicer<'_, Q>,
    quad: usize,
    cancel: &Cancel,
    micro: &mut Micro,
    emit: &mut dyn FnMut(usize, &Micro) -> Result<()>,
) -> Result<()> {
    let level = dicer.level_of_rule(quad);
    let count = 1 << level;
    let block = dicer.block(quad, level, [[0, count]; 2]);
    let mut below: Vec<_> = block.row(0).collect();
    let mut above = Vec::with_capacity(count + 1);
    micro.clear();
    for j in 1..=count {
        cancel.check()?;
        above.clear();
        above.extend(block.row(j));
        add_row(micro, &below, &above);
        if micro.positions.len() >= BATCH {
            emit(quad, micro)?;
            micro.clear();
        }
        std::mem::swap(&mut below, &mut above);
    }
    if micro.positions.is_empty() { Ok(()) } else { emit(quad, micro) }
}

/// Adds the triangles between two rows. Those without area, where points coincide at poles and coarser edges, are none.
fn add_row(micro: &mut Micro, below: &[Sample], above: &[Sample]) {
    for (low, high) in below.windows(2).zip(above.windows(2)) {
        for corners in [[low[0], low[1], high[1]], [low[0], high[1], high[0]]] {
            let [p, q, r] = corners.map(|it| it.position);
            if p != q && q != r && r != p {
                micro.positions.push([p, q, r]);
                micro.normals.push(corners.map(|it| it.normal.as_vec3()));
            }
        }
    }
}
