//! A part of an instance as a solid of its own: its triangles in a tree in memory, for nearest points and for points
//! inside. Depths ask the same two parts again and again, from many points; the blocks of a model, in which other parts
//! lie between, would answer slower.

use super::super::frames::rounded;
use super::task::PartKey;
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::geom::{Line, Nearest, Side, point_triangle};
use crate::math::DBounds;
use crate::scene::SceneState;
use glam::{DAffine3, DVec3};
use std::collections::HashMap;
use std::sync::OnceLock;

/// Triangles of a leaf, at most.
const LEAF: usize = 4;
/// Triangles that are read at a time.
const READ: usize = 1 << 12;
/// The direction of the rays that decide whether a point is inside, an arbitrary one of length 1 without zeros.
const DIR: DVec3 = DVec3::new(0.36, 0.48, 0.8);

/// The triangles of a part.
pub(super) struct Solid {
    /// The point of the world that is zero here. It has few digits, so that differences of origins are exact.
    pub origin: DVec3,
    /// Bounds of all corners.
    pub bounds: DBounds,
    /// The corners of each triangle.
    pub triangles: Vec<[DVec3; 3]>,
    nodes: Vec<Node>,
    /// True if the triangles face one way.
    is_oriented: bool,
    corners: OnceLock<Vec<[u32; 3]>>,
}

/// A node of the tree.
struct Node {
    bounds: DBounds,
    /// The first of its triangles, or if `count` is 0 the first of its two children.
    first: u32,
    count: u32,
}

impl Solid {
    /// Bytes of a part of so many triangles: a node for each two triangles at most, and corner numbers with their map.
    pub fn bytes(triangles: u64) -> u64 {
        const EACH: usize = size_of::<[DVec3; 3]>() + size_of::<Node>() + size_of::<[u32; 3]>() + 20;
        triangles * EACH as u64
    }

    /// Reads a part.
    pub fn read(scene: &SceneState, [instance, part]: PartKey, cancel: &Cancel) -> Result<Self> {
        let (model, world_from_model) =
            (scene.model_of_instance(instance.into()), scene.world_from_model(instance.into()));
        let info = model.parts().get(part as usize);
        let placed = info.as_ref().map_or(DBounds::EMPTY, |info| info.bounds.transformed(&world_from_model));
        let origin = rounded((placed.min + placed.max) * 0.5, (placed.max - placed.min).max_element());
        let place = DAffine3 { translation: world_from_model.translation - origin, ..world_from_model };
        let mut triangles = Vec::with_capacity(info.as_ref().map_or(0, |info| info.triangles as usize));
        let mut reader = model.read_part(part)?;
        loop {
            let more = reader.next(READ, cancel)?;
            if more.is_empty() {
                break;
            }
            triangles.extend(more.iter().map(|t| t.corners.map(|corner| place.transform_point3(corner))));
        }
        Ok(Self::new(origin, triangles, info.is_some_and(|info| info.is_oriented)))
    }

    /// The solid of a list of triangles.
    pub fn new(origin: DVec3, mut triangles: Vec<[DVec3; 3]>, is_oriented: bool) -> Self {
        let bounds = around(&triangles);
        // Of the rounding of rays and of boxes.
        let slack = (bounds.max - bounds.min).max_element() * 1e-12;
        let mut nodes = vec![Node { bounds, first: 0, count: triangles.len() as u32 }];
        let mut at = 0;
        while let Some(&Node { first, count, bounds }) = nodes.get(at) {
            let (from, all) = (first as usize, count as usize);
            if all > LEAF {
                let extent = bounds.max - bounds.min;
                let axis = (1..3).fold(0, |best, axis| if extent[axis] > extent[best] { axis } else { best });
                let own = &mut triangles[from..from + all];
                let centre = |t: &[DVec3; 3]| t[0][axis] + t[1][axis] + t[2][axis];
                own.select_nth_unstable_by(all / 2, |a, b| centre(a).total_cmp(&centre(b)));
                let below = nodes.len() as u32;
                for (first, count) in [(from, all / 2), (from + all / 2, all - all / 2)] {
                    let bounds = around(&triangles[first..first + count]);
                    nodes.push(Node { bounds, first: first as u32, count: count as u32 });
                }
                nodes[at] = Node { bounds, first: below, count: 0 };
            }
            nodes[at].bounds = DBounds { min: bounds.min - slack, max: bounds.max + slack };
            at += 1;
        }
        Self { origin, bounds, triangles, nodes, is_oriented, corners: OnceLock::new() }
    }

    /// The nearest point of the surface, and the index of its triangle; `None` if there are no triangles.
    pub fn nearest(&self, p: DVec3) -> Option<(Nearest, u32)> {
        let mut best: Option<(Nearest, u32)> = None;
        let mut stack = [(0.0, 0u32); 64];
        let mut top = usize::from(!self.triangles.is_empty());
        while top > 0 {
            top -= 1;
            let (squared, at) = stack[top];
            if best.as_ref().is_some_and(|(best, _)| squared >= best.squared) {
                continue;
            }
            let node = &self.nodes[at as usize];
            for index in node.first..node.first + node.count {
                let near = point_triangle(p, &self.triangles[index as usize]);
                if best.as_ref().is_none_or(|(best, _)| near.squared < best.squared) {
                    best = Some((near, index));
                }
            }
            if node.count == 0 {
                let squared = |at: u32| self.nodes[at as usize].bounds.squared_distance_to(p);
                let both = [(squared(node.first), node.first), (squared(node.first + 1), node.first + 1)];
                // The nearer one is visited first.
                let [far, near] = if both[0].0 <= both[1].0 { [both[1], both[0]] } else { both };
                (stack[top], stack[top + 1], top) = (far, near, top + 2);
            }
        }
        best
    }

    /// Calls `take` with the index of each triangle whose box overlaps a box, until it returns false.
    pub fn near(&self, bounds: &DBounds, mut take: impl FnMut(u32) -> bool) {
        self.descend(
            |own| own.overlaps(bounds),
            |index| !around(&self.triangles[index as usize..][..1]).overlaps(bounds) || take(index),
        );
    }

    /// True if a point is inside. Points on the surface may be on either side.
    pub fn holds(&self, p: DVec3) -> bool {
        if !(p.cmpge(self.bounds.min).all() && p.cmple(self.bounds.max).all()) {
            return false;
        }
        let line = Line::new(p, DIR);
        let (mut winding, mut count) = (0i32, 0u32);
        let meets = |b: &DBounds| {
            let (enters, leaves) = ((b.min - p) / DIR, (b.max - p) / DIR);
            enters.max_element().max(0.0) <= leaves.min_element()
        };
        self.descend(meets, |index| {
            let triangle = &self.triangles[index as usize];
            if let Some(side) = line.crosses(triangle).filter(|&side| line.is_ahead(triangle, side)) {
                winding += if side == Side::Back { 1 } else { -1 };
                count += 1;
            }
            true
        });
        if self.is_oriented { winding != 0 } else { count % 2 == 1 }
    }

    /// Calls `take` for each triangle of the leaves whose boxes, and those above, meet something.
    fn descend(&self, meets: impl Fn(&DBounds) -> bool, mut take: impl FnMut(u32) -> bool) {
        let mut stack = [0u32; 64];
        let mut top = usize::from(!self.triangles.is_empty());
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            if !meets(&node.bounds) {
                continue;
            }
            if node.count == 0 {
                (stack[top], stack[top + 1], top) = (node.first + 1, node.first, top + 2);
            } else if !(node.first..node.first + node.count).all(&mut take) {
                return;
            }
        }
    }

    /// A number for each corner of each triangle, the same for equal corners.
    pub fn corner_numbers(&self) -> &[[u32; 3]] {
        self.corners.get_or_init(|| {
            let mut numbers = HashMap::new();
            let mut number = |p: DVec3| {
                let next = numbers.len() as u32;
                *numbers.entry((p + 0.0).to_array().map(f64::to_bits)).or_insert(next)
            };
            self.triangles.iter().map(|t| t.map(&mut number)).collect()
        })
    }
}

/// The box around triangles.
pub(super) fn around(triangles: &[[DVec3; 3]]) -> DBounds {
    triangles.as_flattened().iter().fold(DBounds::EMPTY, |b, &p| b.with(p))
}
