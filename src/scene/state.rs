//! The committed, immutable state of a scene: what jobs read.

use super::context::Context;
use super::light::{Background, Light};
use super::model::Model;
use super::placed::Placed;
use super::top::TopTree;
use crate::math::DBounds;
use glam::DAffine3;
use std::collections::HashMap;
use std::sync::Arc;

/// How an instance or a part of it is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Whether rays meet it at all.
    pub visible: bool,
    /// Linear RGBA in place of its own colour; alpha is the opacity.
    pub colour: Option<[f32; 4]>,
    /// Whether it is shown highlighted.
    pub selected: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self { visible: true, colour: None, selected: false }
    }
}

impl Look {
    /// Whether its colour lets light through.
    pub(crate) fn see_through(&self) -> bool {
        self.colour.is_some_and(|c| c[3] < 1.0)
    }
}

/// The states of an instance's parts, where they differ from the default.
#[derive(Debug, Clone, Default)]
pub(crate) struct PartLooks {
    /// Bit `i % 64` of word `i / 64`: part `i` is hidden. As long as the last hidden part needs.
    pub hidden: Vec<u64>,
    /// By index of the part.
    pub shown: HashMap<u32, Look>,
    /// How many parts of `shown` have each bit of a summary (`lod::summary_bit`).
    bits: [u32; 32],
}

impl PartLooks {
    /// Sets one part's state.
    pub fn set(&mut self, part: u32, look: Look) {
        let (word, bit) = (part as usize / 64, part % 64);
        if !look.visible && self.hidden.len() <= word {
            self.hidden.resize(word + 1, 0);
        }
        if let Some(w) = self.hidden.get_mut(word) {
            *w = *w & !(1 << bit) | u64::from(!look.visible) << bit;
        }
        while self.hidden.last() == Some(&0) {
            self.hidden.pop();
        }
        let count = &mut self.bits[part as usize % 32];
        if look == Look::default() {
            *count -= u32::from(self.shown.remove(&part).is_some());
        } else {
            *count += u32::from(self.shown.insert(part, look).is_none());
        }
    }

    /// The summary of the parts that are hidden or look otherwise than in the file, for a mesh whose local part 0 is
    /// `first_part`.
    pub fn touched(&self, first_part: u32) -> u32 {
        let all = self.bits.iter().enumerate().fold(0, |all, (bit, count)| all | u32::from(*count > 0) << bit);
        all.rotate_right(first_part % 32)
    }

    /// Whether light passes through one of the parts whose state has a colour.
    pub fn see_through(&self) -> bool {
        self.shown.values().any(Look::see_through)
    }
}

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
    pub parts: Arc<PartLooks>,
}

/// Where everything is: shared by states that differ in looks only.
pub(crate) struct Placement {
    /// By instance in the order added, then by the model's own order.
    pub placed: Vec<Placed>,
    /// Over the boxes of all that rays may hit.
    pub top: TopTree,
    /// Around all triangles.
    pub bounds: DBounds,
}

impl Default for Placement {
    fn default() -> Self {
        Self { placed: Vec::new(), top: TopTree::default(), bounds: DBounds::EMPTY }
    }
}

/// A scene as it was at a commit: immutable, shared by the jobs that began with it. Thread-safe.
pub struct SceneState {
    pub(crate) context: Context,
    pub(crate) models: Vec<Model>,
    pub(crate) instances: Vec<Instance>,
    pub(crate) placement: Arc<Placement>,
    /// Whether anything may be transparent: else whatever a shadow ray meets is dark.
    pub(crate) see_through: bool,
    pub(crate) lights: Vec<Light>,
    pub(crate) background: Background,
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

    /// Around all instances, hidden ones too, in world space; empty if there is nothing.
    pub fn bounds(&self) -> DBounds {
        self.placement.bounds
    }

    /// Around all that rays can hit, in world space: stand-ins reach out of [`SceneState::bounds`].
    pub(crate) fn bounds_of_hits(&self) -> DBounds {
        *self.placement.top.around()
    }

    /// Bytes of its models' blocks in memory.
    pub(crate) fn resident_bytes(&self) -> u64 {
        self.models.iter().map(|m| m.memory().resident).sum()
    }
}
