//! The committed, immutable state of a scene, which jobs read.

use super::context::Context;
use super::light::{Background, Light};
use super::looks::{Look, PartsShown};
use super::model::Model;
use super::placed::Placed;
use super::top::TopTree;
use crate::math::DBounds;
use crate::residency::Kept;
use crate::structure::ShownBlocks;
use glam::DAffine3;
use std::sync::Arc;

/// An instance as it was at the commit.
#[derive(Clone)]
pub(crate) struct Instance {
    /// The caller's id.
    pub id: u64,
    /// Index of its model.
    pub model: u32,
    pub world_from_model: DAffine3,
    pub mask: u32,
    pub look: Look,
    /// The looks of its parts.
    pub parts: Arc<PartsShown>,
}

/// The placement of all trees; states that differ only in looks share it.
pub(crate) struct Placement {
    /// By instance in the order added, then by the model's own order.
    pub placed: Vec<Placed>,
    /// Index of the first placed tree of each instance.
    pub firsts: Vec<u32>,
    /// The top tree over the boxes of all that rays may hit.
    pub top: TopTree,
    /// Bounds of all triangles.
    pub bounds: DBounds,
    pub _memory: Kept,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            placed: Vec::new(),
            firsts: Vec::new(),
            top: TopTree::default(),
            bounds: DBounds::EMPTY,
            _memory: Kept::default(),
        }
    }
}

/// A scene as it was at a commit: immutable, shared by the jobs that began with it. Thread-safe.
pub struct SceneState {
    pub(crate) context: Context,
    pub(crate) models: Vec<Model>,
    pub(crate) instances: Vec<Instance>,
    pub(crate) placement: Arc<Placement>,
    /// True if anything may be transparent. Otherwise any surface that a shadow ray hits blocks it.
    pub(crate) see_through: bool,
    /// True if parts are hidden.
    pub(crate) hides_parts: bool,
    pub(crate) lights: Vec<Light>,
    pub(crate) background: Background,
    pub(crate) _memory: Kept,
}

impl SceneState {
    /// The context.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Number of instances.
    pub fn instance_count(&self) -> usize {
        self.instances.len()
    }

    /// Bounds of all instances, hidden ones too, in world space; empty if there are none.
    pub fn bounds(&self) -> DBounds {
        self.placement.bounds
    }

    /// Bounds in world space of all that rays can hit: stand-ins may extend beyond [`SceneState::bounds`].
    pub(crate) fn bounds_of_hits(&self) -> DBounds {
        *self.placement.top.around()
    }

    /// The blocks of a placed tree that walks pass by, if parts are hidden there.
    #[inline]
    pub(crate) fn shown_blocks(&self, placed: u32) -> Option<&ShownBlocks> {
        if !self.hides_parts {
            return None;
        }
        let instance = self.placement.placed[placed as usize].instance as usize;
        self.instances[instance].parts.trees.get((placed - self.placement.firsts[instance]) as usize)
    }

    /// The mask of the rays that see the placed tree.
    #[inline]
    pub(super) fn seen_by(&self, placed: u32) -> u32 {
        let p = &self.placement.placed[placed as usize];
        let instance = &self.instances[p.instance as usize];
        // A tree of hidden parts alone is not entered.
        let is_hidden = self.shown_blocks(placed).is_some_and(|shown| shown.lacks(shown.first_block));
        if instance.look.visible && !is_hidden { instance.mask } else { 0 }
    }

    /// Bytes of its models' blocks in memory.
    pub(crate) fn resident_bytes(&self) -> u64 {
        self.models.iter().map(|m| m.memory().resident).sum()
    }
}
