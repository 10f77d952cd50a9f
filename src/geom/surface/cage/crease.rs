//! Quads along a semi-sharp edge that goes on with the same sharpness at both ends, where nothing else is irregular.
//!
//! All rules are products there: along the edge those of a cubic B-spline, across it those of a curve with a semi-sharp
//! point. So the surface is one bicubic patch for each level that the sharpness lasts, as long as the edge, instead of
//! twice as many at each level. Nießner, Loop, Greiner, "Efficient evaluation of semi-smooth creases in Catmull-Clark
//! subdivision surfaces", Eurographics 2012 short papers.

use super::desc::Creasing;
use super::level::Cage;
use super::masks::Row;
use super::rules::is_semi_sharp;

/// Points of a patch as numbers, or sums of them: four rows along the edge, the first one beyond it.
pub(super) type Strip = [[u32; 4]; 4];

impl Cage {
    /// The side of a quad that is such an edge, and its sharpness.
    pub(super) fn creased_side(&self, quad: u32, walk: &mut Vec<u32>) -> Option<(u32, f32)> {
        let first = self.topology.face_start[quad as usize];
        let sharpness = |side: u32| self.edge_sharpness[self.topology.corner_edge[(first + side) as usize] as usize];
        let side = (0..4).find(|&side| is_semi_sharp(sharpness(side)))?;
        let far = |step: u32, walk: &mut Vec<u32>| {
            let sector = self.sector(first + (side + step) % 4, walk);
            sector.is_some_and(|sector| sector.is_regular() && sector.is_closed())
        };
        let edge = self.topology.corner_edge[(first + side) as usize];
        let even = self.creasing == Creasing::Uniform
            && self.goes_on(first + side, edge, walk)
            && self.goes_on(first + (side + 1) % 4, edge, walk)
            && far(2, walk)
            && far(3, walk);
        even.then(|| (side, sharpness(side)))
    }

    /// True if the vertex of a corner has four quads, and no sharp edges but this one and the opposite one, alike.
    fn goes_on(&self, h: u32, edge: u32, walk: &mut Vec<u32>) -> bool {
        let topology = &self.topology;
        let vertex = topology.corners[h as usize];
        let is_quad = |&h: &u32| topology.face_size(topology.corner_face[h as usize]) == 4;
        let regular = topology.sector(h, |_| false, walk)
            && walk.len() == 4
            && topology.corners_at(vertex).len() == 4
            && walk.iter().all(is_quad)
            && self.vertex_sharpness[vertex as usize] <= 0.0;
        let around: Vec<u32> = walk.iter().map(|&h| topology.corner_edge[h as usize]).collect();
        let own = self.edge_sharpness[edge as usize];
        regular
            && (0..4).all(|i| {
                let sharpness = self.edge_sharpness[around[i] as usize];
                let on_crease = around[i] == edge || around[(i + 2) % 4] == edge;
                if on_crease { sharpness == own } else { sharpness <= 0.0 }
            })
    }
}

/// The patches of a quad with 16 control points, rows along the edge: from the far half of the first level to the last
/// level's near part. `point` numbers a sum of points.
pub(super) fn strips(control: Strip, mut sharpness: f32, mut point: impl FnMut(&mut Row) -> u32) -> Vec<Strip> {
    let (mut out, mut near) = (Vec::new(), control);
    while sharpness > 0.0 {
        let sharp = f64::from(sharpness.min(1.0));
        let mut sum = |weights: [f64; 4]| {
            [0, 1, 2, 3].map(|column| {
                let mut row: Row = (0..4).map(|i| (near[i][column], weights[i])).collect();
                point(&mut row)
            })
        };
        let smooth = (1.0 - sharp) / 8.0;
        let beyond = sum([0.5, 0.5, 0.0, 0.0]);
        let on = if sharp < 1.0 { sum([smooth, sharp + 6.0 * smooth, smooth, 0.0]) } else { near[1] };
        let next = sum([0.0, 0.5, 0.5, 0.0]);
        let third = sum([0.0, 0.125, 0.75, 0.125]);
        out.push([on, next, third, sum([0.0, 0.0, 0.5, 0.5])]);
        near = [beyond, on, next, third];
        sharpness = (sharpness - 1.0).max(0.0);
    }
    out.push(near);
    out
}
