//! The visible parts of a set, and where they are: which placed trees and blocks a walk enters for them.

use super::part_set::{Members, PartSet};
use crate::base::error::Result;
use crate::base::memory::make_room;
use crate::math::DBounds;
use crate::scene::frame::{NodeRef, Scenes, Target};
use crate::scene::top::TopTree;
use crate::scene::walk::SceneView;
use crate::scene::{SceneState, blocks_with};
use crate::structure::{ShownBlocks, Tree};
use std::collections::BTreeMap;

pub(super) struct Among<'a> {
    scene: &'a SceneState,
    /// `None`: all parts.
    members: Option<Members>,
    /// The tree over placed trees with members; `None`: that of the scene.
    top: Option<TopTree>,
    /// For placed trees of which only some parts are members: the blocks that have such.
    blocks: BTreeMap<u64, ShownBlocks>,
}

impl<'a> Among<'a> {
    /// Fails with `BadArgument` for an instance or part that the scene lacks. With `reads` it may read which blocks
    /// have parts of the set, and fails with the error of a read.
    pub fn new(scene: &'a SceneState, set: &PartSet, name: &str, reads: bool) -> Result<Self> {
        let mut among = Self { scene, members: None, top: None, blocks: BTreeMap::new() };
        if *set == PartSet::all() {
            return Ok(among);
        }
        let members = Members::of(scene, set, name)?;
        let mut bounds = Vec::new();
        // Sets of parts bound the number.
        for placed in 0..scene.placement.len() {
            let p = scene.placed(placed);
            let (model, looks) = (&scene.models[p.model as usize], &scene.state_of(p.instance).parts.looks);
            let count = model.local_parts(p.tree);
            let has_any = members.has_any(p.instance, p.first_part, count);
            if has_any {
                make_room(&mut bounds, 1, "a set of parts")?;
                bounds.push((placed as u32, p.bounds));
            }
            if reads && has_any && count > 1 && !members.has_all(p.instance) {
                let has = |part: u32| {
                    let part = p.first_part.saturating_add(part);
                    members.has(p.instance, part) && !looks.hides(part)
                };
                among.blocks.insert(placed, blocks_with(model, p.tree, &has)?);
            }
        }
        among.top = Some(TopTree::build(bounds, 0.0, |_| None)?);
        among.members = Some(members);
        Ok(among)
    }

    /// The root of the tree over placed trees that may have members.
    pub fn root(&self) -> Option<Target> {
        match &self.top {
            None => self.scene.root(Scenes::VISIBLE),
            Some(top) => top.root().map(Target::from),
        }
    }

    /// Calls `visit` with the children of a node of this tree, and their boxes.
    #[inline]
    pub fn children(&self, node: NodeRef, mut visit: impl FnMut(Target, DBounds)) {
        match &self.top {
            None => self.scene.children(node, Scenes::VISIBLE, visit),
            Some(top) => top.children(node.node(), |child, bounds| visit(child.into(), bounds)),
        }
    }

    /// Bounds of all that is in it.
    pub fn around(&self) -> &DBounds {
        self.top.as_ref().unwrap_or(&self.scene.placement.top).around()
    }

    /// True if walks enter a placed tree.
    #[inline]
    pub fn enters(&self, placed: u64) -> bool {
        let p = self.scene.placed(placed);
        let instance = self.scene.state_of(p.instance);
        let is_hidden = |shown: &ShownBlocks| shown.lacks(shown.first_block);
        instance.look.visible && !p.bounds.is_empty() && !self.shown(placed).is_some_and(is_hidden)
    }

    /// True if a part of an instance is a visible member.
    #[inline]
    pub fn has(&self, instance: u64, part: u32) -> bool {
        self.members.as_ref().is_none_or(|members| members.has(instance, part))
            && !self.scene.state_of(instance).parts.looks.hides(part)
    }

    /// True if all parts of a placed tree are visible members.
    #[inline]
    pub fn is_whole(&self, placed: u64) -> bool {
        let instance = self.scene.ids_of(placed).instance;
        self.members.as_ref().is_none_or(|members| members.has_all(instance))
            && self.scene.state_of(instance).parts.looks.hidden.is_empty()
    }

    fn shown(&self, placed: u64) -> Option<&ShownBlocks> {
        self.blocks.get(&placed).or_else(|| self.scene.shown_blocks(placed))
    }

    /// A placed tree without the blocks that have no members.
    #[inline]
    pub fn tree<'b>(&'b self, view: &SceneView<'b>, placed: u64) -> Tree<'b> {
        view.tree_showing(placed, self.shown(placed))
    }
}
