//! The committed, immutable state of a scene: what jobs read.

use super::context::Context;

/// How an instance or a part of it is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Whether rays meet it at all.
    pub visible: bool,
    /// Linear RGBA in place of its own colour; alpha is the opacity.
    pub colour: Option<[f32; 4]>,
    /// Whether it is shown highlighted.
    pub selected: bool,
}

impl Default for State {
    fn default() -> Self {
        Self { visible: true, colour: None, selected: false }
    }
}

/// A scene as it was at a commit: immutable, shared by the jobs that began with it. Thread-safe.
pub struct SceneState {
    context: Context,
}

impl SceneState {
    pub(crate) fn empty(context: &Context) -> Self {
        Self { context: context.clone() }
    }

    /// The context.
    pub fn context(&self) -> &Context {
        &self.context
    }
}
