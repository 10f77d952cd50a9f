//! The committed, immutable state of a scene, which jobs read.

use super::context::Context;
use super::light::{Background, Light};
use super::model::Model;
use super::placed::Placed;
use super::top::TopTree;
use crate::math::DBounds;
use glam::DAffine3;
use std::collections::HashMap;
use std::sync::Arc;

/// The look of an instance or of a part of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// True if rays can hit it.
    pub visible: bool,
    /// Linear RGBA that replaces its own colour; alpha is the opacity.
    pub colour: Option<[f32; 4]>,
    /// True if it is highlighted.
    pub selected: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self { visible: true, colour: None, selected: false }
    }
}

impl Look {
    /// True if its colour is transparent.
    pub(crate) fn see_through(&self) -> bool {
        self.colour.is_some_and(|c| c[3] < 1.0)
    }
}

/// The looks of an instance's parts that differ from the default.
#[derive(Debug, Clone, Default)]
pub(crate) struct PartLooks {
    /// Bit `i % 64` of word `i / 64`: part `i` is hidden. The last word is not 0.
    pub hidden: Vec<u64>,
    /// Looks by index of the part.
    pub shown: HashMap<u32, Look>,
    /// Number of parts in `shown` for each bit of a summary (`lod::summary_bit`).
    bits: [u32; 32],
}

impl PartLooks {
    /// Sets one part's look.
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

    /// The summary of the parts that are hidden or differ in look from the file, for a mesh with the local part 0 at
    /// `first_part`.
    pub fn touched(&self, first_part: u32) -> u32 {
        let all = self.bits.iter().enumerate().fold(0, |all, (bit, count)| all | u32::from(*count > 0) << bit);
        all.rotate_right(first_part % 32)
    }

    /// True if a part has a look with a transparent colour.
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

/// The placement of all trees; states that differ only in looks share it.
pub(crate) struct Placement {
    /// By instance in the order added, then by the model's own order.
    pub placed: Vec<Placed>,
    /// The top tree over the boxes of all that rays may hit.
    pub top: TopTree,
    /// Bounds of all triangles.
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
    /// True if anything may be transparent. Otherwise any surface that a shadow ray hits blocks it.
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

    /// Bounds of all instances, hidden ones too, in world space; empty if there are none.
    pub fn bounds(&self) -> DBounds {
        self.placement.bounds
    }

    /// Bounds in world space of all that rays can hit: stand-ins may extend beyond [`SceneState::bounds`].
    pub(crate) fn bounds_of_hits(&self) -> DBounds {
        *self.placement.top.around()
    }

    /// Bytes of its models' blocks in memory.
    pub(crate) fn resident_bytes(&self) -> u64 {
        self.models.iter().map(|m| m.memory().resident).sum()
    }
}
