//! The top-level tree: a tree over the bounds of placed trees and of scenes in this one, its members, with boxes in
//! single precision around an origin in double precision. Rays walk it as they walk the trees of models.

use super::placed::Placed;
use crate::base::error::Result;
use crate::math::{Bounds, DBounds};
use crate::structure::{Appearance, MemberChild, MemberLook, Members, Move};
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;

/// The tree. Invariants: every member with non-empty bounds is in it exactly once; each box holds all that is below it.
#[derive(Debug)]
pub struct TopTree {
    around: DBounds,
    root: Option<MemberChild>,
    /// The nodes; `None` over fewer than two members.
    nodes: Option<Nodes>,
}

#[derive(Debug)]
struct Nodes {
    tree: Members,
    frame: Frame,
    /// Number of the members, and of those that were moved since the tree was built.
    count: usize,
    moved: usize,
    /// True if its cells may stand in.
    has_cells: bool,
}

/// The frame of the boxes.
#[derive(Debug, Clone, Copy)]
struct Frame {
    /// The tree, placed in the world.
    placed: Placed,
    /// Growth of the boxes, in the world.
    grown: f64,
}

impl Frame {
    /// A box of the world, grown.
    fn grow(&self, b: &DBounds) -> DBounds {
        DBounds { min: b.min - self.grown, max: b.max + self.grown }
    }

    /// A box of the world in the frame, grown.
    fn local(&self, b: &DBounds) -> Bounds {
        let (b, local) = (self.grow(b), |v: DVec3| self.placed.local_point(v).to_array());
        Bounds {
            min: Vec3::from(local(b.min).map(|x| (x as f32).next_down())),
            max: Vec3::from(local(b.max).map(|x| (x as f32).next_up())),
        }
    }
}

impl Frame {
    /// A look of the scene in the frame.
    fn local_look<'a>(&self, it: MemberLook<'a>) -> MemberLook<'a> {
        let (origin, scale) = (self.placed.frame().translation, self.placed.stretch);
        let map = DAffine3 { matrix3: it.map.matrix3 / scale, translation: (it.map.translation - origin) / scale };
        MemberLook { map, stretch: it.stretch / scale, ..it }
    }
}

impl Default for TopTree {
    fn default() -> Self {
        Self { around: DBounds::EMPTY, root: None, nodes: None }
    }
}

/// Growth of boxes, as a fraction of half the tree's extent. Walks misplace a ray by a few roundings of that
/// (h = 2^-24), and the walk in a placed tree misplaces it otherwise: a ray that meets something there must meet the
/// box.
const GROWTH: f64 = 1.0 / 131_072.0;

/// The tree has room for this many times its extent, so that members may move without a build.
const ROOM: f64 = 1.5;

/// The tree is built anew once one in so many members has moved: boxes get no smaller otherwise.
const MOST_MOVED: usize = 8;

/// Greatest number of members that are searched one by one.
const FEW: usize = 8;

/// Range of the greatest coordinate for frames that are not scaled.
const USUAL: std::ops::RangeInclusive<f64> = 1e-12..=1e12;

impl TopTree {
    /// Upper bound of the bytes of memory for each member, while the tree is built.
    pub const BYTES_EACH: usize = Members::BYTES_EACH_DESCRIBED;

    /// Builds the tree over `bounds`, the numbers of members, below 2^31, and their boxes, and leaves out empty ones.
    /// `look_of` returns what a member looks like, with the map to the scene; `position_error`: the greatest distance
    /// of stored vertices from those of the input, in the scene. The same input gives the same tree. Fails with
    /// `NoMemory`.
    pub fn build<'a>(
        mut bounds: Vec<(u32, DBounds)>,
        position_error: f64,
        mut look_of: impl FnMut(u32) -> Option<MemberLook<'a>>,
    ) -> Result<Self> {
        bounds.retain(|it| !it.1.is_empty());
        let around = bounds.iter().fold(DBounds::EMPTY, |all, it| all.union(it.1));
        match bounds[..] {
            [] => return Ok(Self::default()),
            [(only, _)] => return Ok(Self { around, root: Some(MemberChild::Member(only)), nodes: None }),
            _ => {}
        }
        let origin = around.center();
        let rounding = origin.abs().max_element() * (8.0 * f64::EPSILON);
        let reach = (around.extent().max_element() * 0.5 + rounding).max(f64::MIN_POSITIVE);
        let scale = if USUAL.contains(&reach) { 1.0 } else { reach.log2().round().exp2() };
        let grown = reach * GROWTH + rounding;
        // Room for members that move.
        let all = DVec3::splat(reach * ROOM);
        let all = DBounds { min: origin - all, max: origin + all };
        let max_coord = (reach * ROOM / scale) as f32;
        let mut frame = Frame { placed: Placed::of_boxes(origin, scale, &all, max_coord), grown };
        frame.placed.position_error = position_error;
        let count = bounds.len();
        let mut has_cells = false;
        let local_look = |number: u32| {
            let look = look_of(number)?;
            has_cells = true;
            Some(frame.local_look(look))
        };
        let boxes = bounds.into_iter().map(|(number, b)| (number, frame.local(&b)));
        let tree = Members::build_described(boxes, max_coord, local_look)?;
        let root = MemberChild::Node(tree.root());
        Ok(Self { around, root: Some(root), nodes: Some(Nodes { tree, frame, count, moved: 0, has_cells }) })
    }

    /// Number of members in the tree.
    pub fn count(&self) -> usize {
        self.nodes.as_ref().map_or(usize::from(self.root.is_some()), |nodes| nodes.count)
    }

    /// True if cells may stand in for several members.
    pub fn has_cells(&self) -> bool {
        self.nodes.as_ref().is_some_and(|nodes| nodes.has_cells)
    }

    /// What all members look like together, and the map to the scene. `None` if that is not known.
    pub fn appearance(&self) -> Option<(Arc<Appearance>, DAffine3)> {
        let Nodes { tree, frame, .. } = self.nodes.as_ref()?;
        Some((Arc::clone(tree.appearance()?), frame.placed.frame()))
    }

    /// The tree in which no cell above some members stands in: `members`, in ascending order, of which `bounds_of`
    /// returns the bounds. `None` if there is no memory for it.
    pub fn without_cells_above(&self, members: &[u32], bounds_of: impl Fn(u32) -> DBounds) -> Option<Self> {
        let nodes = self.nodes.as_ref()?;
        let Nodes { tree, frame, .. } = nodes;
        let stays = |&member: &u32| {
            let b = bounds_of(member);
            (!b.is_empty()).then(|| frame.local(&b)).map(|b| Move { member, from: b, to: b })
        };
        // Few members are found by their boxes, many in one pass over all.
        let tree = if members.len() <= FEW {
            tree.moved(&members.iter().filter_map(stays).collect::<Vec<_>>())?
        } else {
            tree.without_cells_above(|member| members.binary_search(&member).is_ok()).ok()?
        };
        let nodes = Nodes { tree, ..*nodes };
        Some(Self { around: self.around, root: self.root, nodes: Some(nodes) })
    }

    /// True if so many more members may move without a build of the tree.
    pub fn may_move(&self, more: usize) -> bool {
        self.nodes.as_ref().is_some_and(|nodes| nodes.moved + more <= nodes.count / MOST_MOVED)
    }

    /// The tree after moves of members: their numbers, and their bounds before and after; `position_error` as for
    /// [`TopTree::build`]. `None` if it must be built anew: too many have moved since it was built, or one leaves the
    /// room around it.
    pub fn moved(&self, moves: &[(u32, [DBounds; 2])], position_error: f64) -> Option<Self> {
        let nodes = self.nodes.as_ref().filter(|_| self.may_move(moves.len()))?;
        let Nodes { tree, frame, moved, .. } = nodes;
        let is_in_room = |b: &DBounds| !b.is_empty() && frame.placed.bounds.contains(&frame.grow(b));
        if !moves.iter().all(|it| is_in_room(&it.1[1])) {
            return None;
        }
        let local = |&(member, [from, to]): &(u32, [DBounds; 2])| Move {
            member,
            from: frame.local(&from),
            to: frame.local(&to),
        };
        let tree = tree.moved(&moves.iter().map(local).collect::<Vec<_>>())?;
        // It does not shrink: to find out by how much it may, all would have to be looked at.
        let around = moves.iter().fold(self.around, |all, it| all.union(it.1[1]));
        let mut frame = *frame;
        frame.placed.position_error = position_error;
        let nodes = Nodes { tree, frame, moved: moved + moves.len(), ..*nodes };
        Some(Self { around, root: self.root, nodes: Some(nodes) })
    }

    /// Bytes of memory of nodes that differ from those of the build.
    pub fn changed_bytes(&self) -> u64 {
        self.nodes.as_ref().map_or(0, |nodes| nodes.tree.changed_bytes())
    }

    /// Bounds of all that the tree was built over.
    #[inline]
    pub fn around(&self) -> &DBounds {
        &self.around
    }

    /// The root of all walks; `None` if the tree is empty.
    #[inline]
    pub fn root(&self) -> Option<MemberChild> {
        self.root
    }

    /// The tree for walks of rays, and its frame; `None` over fewer than two members.
    #[inline]
    pub(crate) fn walked(&self) -> Option<(&Members, &Placed)> {
        self.nodes.as_ref().map(|nodes| (&nodes.tree, &nodes.frame.placed))
    }

    /// Calls `visit` with the children of an inner node, at most eight, and their boxes.
    #[inline]
    pub fn children(&self, node: u32, mut visit: impl FnMut(MemberChild, DBounds)) {
        let Some(Nodes { tree, frame, .. }) = &self.nodes else { return };
        tree.children(node, |child, b| {
            let in_world = |v: Vec3| frame.placed.world_point(v.as_dvec3());
            visit(child, DBounds { min: in_world(b.min), max: in_world(b.max) });
        });
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> u64 {
        self.nodes.as_ref().map_or(0, |nodes| nodes.tree.bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::super::box_ray::BoxRay;
    use super::*;
    use crate::math::Ray;
    use glam::{DVec3, Vec3};

    fn grid(n: i32) -> Vec<DBounds> {
        let corner = |i: i32| DVec3::new((i % 7) as f64, (i / 7 % 5) as f64, (i / 35) as f64) * 3.0;
        (0..n).map(|i| DBounds { min: corner(i), max: corner(i) + DVec3::splat(1.0 + (i % 3) as f64) }).collect()
    }

    fn walk(tree: &TopTree, box_rays: &BoxRay, t_max: f64) -> Vec<u32> {
        let mut found = Vec::new();
        let mut stack: Vec<_> = tree.root().into_iter().collect();
        while let Some(r) = stack.pop() {
            match r {
                MemberChild::Member(i) => found.push(i),
                MemberChild::Node(i) => tree.children(i, |child, bounds| {
                    if box_rays.enter(&bounds, 0.0, t_max).is_some() {
                        stack.push(child);
                    }
                }),
            }
        }
        found.sort_unstable();
        found
    }

    /// Number of levels, that of the leaves included.
    fn depth(tree: &TopTree) -> usize {
        let (mut deepest, mut todo) = (0, vec![(1, tree.root().unwrap())]);
        while let Some((depth, node)) = todo.pop() {
            deepest = deepest.max(depth);
            if let MemberChild::Node(i) = node {
                tree.children(i, |child, _| todo.push((depth + 1, child)));
            }
        }
        deepest
    }

    #[test]
    fn every_box_that_a_ray_meets_is_a_leaf_it_reaches() {
        let boxes = grid(200);
        let tree = TopTree::build((0..).zip(boxes.iter().copied()).collect(), 0.0, |_| None).unwrap();
        assert!(depth(&tree) < 24);
        // Directions are axis-parallel, in planes of boxes, and diagonal; origins lie on the grid of the boxes.
        for (i, dir) in
            [Vec3::X, -Vec3::Y, Vec3::Z, Vec3::ONE, Vec3::new(1.0, -1.0, 0.0)].iter().cycle().take(500).enumerate()
        {
            let i = i as i32;
            let org = DVec3::new((i % 11 - 2) as f64, (i / 11 % 9) as f64, (i % 5) as f64 * 3.0);
            let box_rays = BoxRay::new(&Ray::new(org, *dir));
            let reached = walk(&tree, &box_rays, f64::INFINITY);
            let expected: Vec<u32> =
                (0..200).filter(|&i| box_rays.enter(&boxes[i as usize], 0.0, f64::INFINITY).is_some()).collect();
            for e in &expected {
                assert!(reached.contains(e), "ray {i} misses box {e}");
            }
        }
    }

    #[test]
    fn boundary_rays_are_inside_and_outside_rays_are_out() {
        let unit = DBounds { min: DVec3::ZERO, max: DVec3::ONE };
        let enter = |o: [f64; 3], d: Vec3| BoxRay::new(&Ray::new(DVec3::from(o), d)).enter(&unit, 0.0, f64::INFINITY);
        assert!(enter([-1.0, 0.0, 0.0], Vec3::X).is_some(), "along an edge");
        assert!(enter([-1.0, 1.0, 1.0], Vec3::X).is_some(), "along the opposite edge");
        assert!(enter([-1.0, 1.0 + 1e-9, 0.5], Vec3::X).is_none());
        assert!(enter([2.0, 0.5, 0.5], Vec3::X).is_none(), "behind");
        assert!(enter([0.5, 0.5, 0.5], Vec3::new(0.0, -0.0, 1.0)).is_some(), "from inside, with zeros");
    }

    #[test]
    fn coincident_boxes_still_make_a_tree() {
        let boxes = vec![DBounds { min: DVec3::ZERO, max: DVec3::ONE }; 1000];
        let tree = TopTree::build((0..).zip(boxes.iter().copied()).collect(), 0.0, |_| None).unwrap();
        assert!(depth(&tree) <= 12, "halved where nothing tells them apart: depth {}", depth(&tree));
        let inside = BoxRay::new(&Ray::new(DVec3::splat(0.5), Vec3::X));
        assert_eq!(walk(&tree, &inside, 1.0), (0..1000).collect::<Vec<_>>());
        assert!(TopTree::build(vec![(0, DBounds::EMPTY)], 0.0, |_| None).unwrap().root().is_none());
    }
}
