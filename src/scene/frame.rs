//! Scenes in scenes, as rays and searches enter them: the top trees of all levels as one tree, whose leaves are placed
//! trees. Nothing is stored for it: a scene's tree is the same in all places.

use super::inner::Inner;
use super::measures::Measures;
use super::placed::{Placed, placed_bounds};
use super::placement::Member;
use super::state::{SceneState, States};
use super::tints;
use super::walk::HitTree;
use super::widths::least_width;
use crate::math::DBounds;
use crate::structure::{MemberChild, Members, Tree};
use glam::{DAffine3, DVec3};
use std::borrow::Cow;

/// A node of a top tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NodeRef {
    /// The number of the first placed tree of its scene, and how many scenes are around that.
    first: u64,
    level: u32,
    node: u32,
}

/// The child of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Target {
    Inner(NodeRef),
    /// A placed tree, by its number.
    Placed(u64),
}

/// A scene in another, at any depth, or that one itself.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub scene: &'a SceneState,
    /// The states of what is in it, under those of the scenes around it.
    states: &'a States,
    /// The masks of members of arrays around it, together.
    mask: u32,
    /// `None`: it is the outermost one.
    pub world_from_scene: Option<DAffine3>,
    /// The number of its first placed tree.
    pub first: u64,
    /// Number of scenes around it.
    level: u32,
    /// True if single occurrences in it have looks of their own, or all of it is see-through, because scenes around it
    /// say so.
    has_looks: bool,
}

/// A frame without its scene, for walks that wait.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameKey {
    world_from_scene: Option<DAffine3>,
    first: u64,
    level: u32,
    mask: u32,
    has_looks: bool,
}

impl FrameKey {
    pub const OUTERMOST: Self = Self { world_from_scene: None, first: 0, level: 0, mask: u32::MAX, has_looks: false };
}

/// A [`Target`] with its scene.
pub(super) enum Fork<'a> {
    /// A node of the top tree of a scene.
    Node(Frame<'a>, u32),
    /// A placed tree, by its number.
    Placed(u64),
}

impl Fork<'_> {
    fn target(&self) -> Target {
        match *self {
            Self::Node(Frame { first, level, .. }, node) => Target::Inner(NodeRef { first, level, node }),
            Self::Placed(number) => Target::Placed(number),
        }
    }
}

impl<'a> Frame<'a> {
    pub fn outermost(scene: &'a SceneState) -> Self {
        let (states, mask) = (&*scene.states, u32::MAX);
        Self { scene, states, mask, world_from_scene: None, first: 0, level: 0, has_looks: false }
    }

    /// The scene with placed tree `number` that has so many scenes around it.
    pub fn with(scene: &'a SceneState, level: u32, number: u64) -> Self {
        let inner = |frame: Self, _| frame.inside(frame.scene.placement.scene_with(number - frame.first));
        (0..level).fold(Self::outermost(scene), inner)
    }

    /// The frame of `key`, which was made in the same scene.
    #[inline]
    pub fn of(scene: &'a SceneState, key: &FrameKey) -> Self {
        let FrameKey { world_from_scene, first, level, mask, has_looks } = *key;
        let (mut inner, mut states, mut before) = (scene, &*scene.states, 0);
        for _ in 0..level {
            let it = inner.placement.scene_with(first - before);
            states = states.in_scene(&inner.placement, &it);
            (inner, before) = (it.scene, before + it.first);
        }
        Self { scene: inner, states, mask, world_from_scene, first, level, has_looks }
    }

    /// See [`FrameKey`].
    pub fn key(&self) -> FrameKey {
        let Self { world_from_scene, first, level, mask, has_looks, .. } = *self;
        FrameKey { world_from_scene, first, level, mask, has_looks }
    }

    /// A scene in this one.
    pub fn inside(&self, it: Inner<'a>) -> Self {
        let map = self.world_from_scene.map_or(it.world_from_scene(), |outer| outer * it.world_from_scene());
        let states = self.states.in_scene(&self.scene.placement, &it);
        let (first, level, mask) = (self.first + it.first, self.level + 1, self.mask & it.mask());
        let has_looks = self.has_looks || self.states.has_occurrence_of(&it) || tints::is_clear(it.tint());
        Self { scene: it.scene, states, mask, world_from_scene: Some(map), first, level, has_looks }
    }

    /// The mask of the rays that see anything in the scene.
    pub fn seen_by(&self) -> u32 {
        self.states.seen_by & self.mask
    }

    /// The tree over its members, if it has more than one, and the frame of the boxes there.
    #[inline]
    pub fn walked(&self) -> Option<(&'a Members, Cow<'a, Placed>)> {
        let (members, boxes) = self.scene.top().walked()?;
        let boxes = match &self.world_from_scene {
            None => Cow::Borrowed(boxes),
            Some(map) => Cow::Owned(boxes.inside(map)),
        };
        Some((members, boxes))
    }

    /// The tree over its members, if it has more than one.
    #[inline]
    pub fn tree(&self) -> Option<Tree<'a>> {
        let isa = self.scene.context().isa();
        self.scene.top().walked().map(|(members, _)| members.tree(isa))
    }

    /// True if stand-ins for several members show what is there: it looks here as it was committed.
    #[inline]
    pub fn has_cells(&self) -> bool {
        self.scene.groups.stand_in && !self.has_looks && std::ptr::eq(self.states, &*self.scene.states)
    }

    /// The tree over its members, for hits.
    #[inline]
    pub fn hit_tree(&self) -> HitTree {
        HitTree::Top { first: self.first, level: self.level }
    }

    /// The number of the first placed tree of a member.
    pub fn first_in(&self, member: u32) -> u64 {
        let first = match self.scene.placement.member(member) {
            Member::Placed(number) => u64::from(number),
            Member::Scene(it) => it.first,
        };
        self.first + first
    }

    /// Where a child leads to: scenes with one member are passed by. `None`: there is nothing below that `scenes` has.
    #[inline]
    pub fn fork(mut self, mut child: MemberChild, scenes: Scenes) -> Option<Fork<'a>> {
        loop {
            let member = match child {
                MemberChild::Node(node) => return Some(Fork::Node(self, node)),
                MemberChild::Member(member) => member,
            };
            match self.scene.placement.member(member) {
                Member::Placed(number) => return Some(Fork::Placed(self.first + u64::from(number))),
                Member::Scene(it) => self = self.inside(it),
            }
            if !scenes.has(self.seen_by()) {
                return None;
            }
            child = self.scene.placement.top.root()?;
        }
    }

    /// Where its root leads to; `None`: there is nothing in it.
    #[inline]
    pub fn root(self, scenes: Scenes) -> Option<Fork<'a>> {
        if !scenes.has(self.seen_by()) {
            return None;
        }
        self.fork(self.scene.placement.top.root()?, scenes)
    }

    /// Bounds in the world of a box of the scene, rounding included.
    pub fn bounds_in_world(&self, b: DBounds) -> DBounds {
        self.world_from_scene.map_or(b, |map| placed_bounds(&b, &map, greatest(&b)))
    }

    /// Calls `visit` with the children of a node, at most eight, their boxes in the world, and the least width of rays
    /// for which their cells may stand in.
    #[inline]
    fn children(self, node: u32, scenes: Scenes, mut visit: impl FnMut(Target, DBounds, f64)) {
        let has_cells = self.has_cells();
        let widen = || match &self.world_from_scene {
            None => 1.0,
            Some(map) => Measures::of(&map.matrix3).stretch,
        };
        self.scene.top().children(node, |child, bounds| {
            let least = match child {
                MemberChild::Node(_) if has_cells => least_width(&bounds) * widen(),
                _ => f64::INFINITY,
            };
            if let Some(fork) = self.fork(child, scenes) {
                visit(fork.target(), self.bounds_in_world(bounds), least);
            }
        });
    }
}

/// The greatest magnitudes of coordinates in a box.
fn greatest(b: &DBounds) -> DVec3 {
    b.min.abs().max(b.max.abs())
}

/// Bounds of all that rays may hit in a scene that is placed in another. They are those of the boxes below the root of
/// its tree: around a turned scene they are tighter than around its box.
pub(super) fn bounds_of_scene(scene: &SceneState, map: &DAffine3) -> DBounds {
    let top = &scene.placement.top;
    let Some(MemberChild::Node(root)) = top.root() else {
        return placed_bounds(top.around(), map, greatest(top.around()));
    };
    let mut all = DBounds::EMPTY;
    top.children(root, |_, b| all = all.union(placed_bounds(&b, map, greatest(&b))));
    all
}

impl SceneState {
    /// The root of the trees over placed trees of all levels; `None`: there is nothing to hit.
    #[inline]
    pub(crate) fn root(&self, scenes: Scenes) -> Option<Target> {
        Frame::outermost(self).root(scenes).map(|fork| fork.target())
    }

    /// Calls `visit` with the children of a node, at most eight, and boxes around all that rays may hit there.
    #[inline]
    pub(crate) fn children(&self, node: NodeRef, scenes: Scenes, mut visit: impl FnMut(Target, DBounds)) {
        self.children_and_widths(node, scenes, |child, bounds, _| visit(child, bounds));
    }

    /// [`SceneState::children`], also with the least width of rays for which the child's cell may stand in.
    #[inline]
    pub(super) fn children_and_widths(&self, node: NodeRef, scenes: Scenes, visit: impl FnMut(Target, DBounds, f64)) {
        Frame::with(self, node.level, node.first).children(node.node, scenes, visit);
    }

    /// The placed trees that are not in boxes outside of what `enters` accepts, in no order. It gets boxes around all
    /// that rays may hit. Placed trees that are hidden, though the scene that they are in is not, are among them.
    pub(crate) fn placed_in(&self, scenes: Scenes, enters: impl Fn(&DBounds) -> bool) -> impl Iterator<Item = u64> {
        let mut search = Search::begin(self, scenes);
        std::iter::from_fn(move || search.next(self, &enters))
    }
}

/// Which scenes in a scene a search enters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Scenes {
    /// All, hidden ones too.
    #[default]
    All,
    /// Those with anything that rays with this mask see.
    SeenBy(u32),
}

impl Scenes {
    /// Those with anything visible.
    pub const VISIBLE: Self = Self::SeenBy(u32::MAX);

    fn has(self, seen_by: u32) -> bool {
        match self {
            Self::All => true,
            Self::SeenBy(mask) => seen_by & mask != 0,
        }
    }
}

/// A search for placed trees, from the root down.
#[derive(Debug, Default)]
pub(crate) struct Search {
    left: Vec<Target>,
    scenes: Scenes,
}

impl NodeRef {
    /// The node in its tree.
    pub fn node(self) -> u32 {
        self.node
    }
}

impl From<MemberChild> for Target {
    /// The target in a tree whose members are placed trees, by their numbers.
    fn from(child: MemberChild) -> Self {
        match child {
            MemberChild::Node(node) => Self::Inner(NodeRef { first: 0, level: 0, node }),
            MemberChild::Member(number) => Self::Placed(number.into()),
        }
    }
}

impl Search {
    pub fn begin(scene: &SceneState, scenes: Scenes) -> Self {
        Self { left: scene.root(scenes).into_iter().collect(), scenes }
    }

    /// Begins in one of the scenes in a scene.
    pub(super) fn in_scene(scene: &SceneState, inner: Inner, scenes: Scenes) -> Self {
        let root = Frame::outermost(scene).inside(inner).root(scenes);
        Self { left: root.iter().map(Fork::target).collect(), scenes }
    }

    /// Begins again.
    pub fn restart(&mut self, scene: &SceneState, scenes: Scenes) {
        self.scenes = scenes;
        self.left.clear();
        self.left.extend(scene.root(scenes));
    }

    /// Ends the search.
    pub fn end(&mut self) {
        self.left.clear();
    }

    /// The next placed tree in boxes that `enters` accepts.
    pub fn next(&mut self, scene: &SceneState, mut enters: impl FnMut(&DBounds) -> bool) -> Option<u64> {
        loop {
            match self.left.pop()? {
                Target::Placed(placed) => return Some(placed),
                Target::Inner(node) => scene.children(node, self.scenes, |child, bounds| {
                    if enters(&bounds) {
                        self.left.push(child);
                    }
                }),
            }
        }
    }
}
