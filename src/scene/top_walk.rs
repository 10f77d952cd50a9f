//! The walk of a ray through the top trees of a scene and of the scenes in it, up to the next placed tree that it may
//! enter.

use super::frame::{Fork, Frame, FrameKey};
use super::placed::At;
use super::placement::Member;
use super::walk::{NOTHING, SceneView};
use crate::math::{Cone, Ray};
use crate::structure::{LocalRay, Outcome, Walk};

/// A ray in top trees, at one for each level. Reusable.
#[derive(Debug, Default)]
pub(super) struct TopWalk {
    /// The scene that the ray is in is the last of the first `depth`.
    levels: Vec<Level>,
    depth: usize,
    /// The placed tree that the ray is to enter next: nothing else is in its scene.
    only: Option<u64>,
}

/// A ray in a top tree.
#[derive(Debug)]
struct Level {
    walk: Walk,
    at: At,
    /// The scene that the tree is of.
    frame: FrameKey,
}

impl TopWalk {
    /// Puts a ray at the root.
    #[inline]
    pub fn begin(&mut self, view: &SceneView, ray: &Ray) {
        self.end();
        if ray.can_hit() {
            self.enter(view, ray, Frame::outermost(view.scene), ray.t_max);
        }
    }

    /// Ends the walk.
    pub fn end(&mut self) {
        (self.depth, self.only) = (0, None);
    }

    /// Puts the ray into the tree of a scene, unless it certainly meets nothing there before `best`.
    fn enter(&mut self, view: &SceneView, ray: &Ray, frame: Frame, best: f64) {
        let frame = match frame.first_fork() {
            None => return,
            Some(Fork::Placed(number)) => return self.only = Some(number),
            Some(Fork::Several(frame)) => frame,
        };
        let Some((members, boxes)) = frame.walked() else { return };
        let mut local = LocalRay::NONE;
        let Some((shift, scale)) = boxes.local(ray, best, true, &mut local) else { return };
        // No cell of this tree stands in.
        local.cone = Cone::ZERO;
        if self.levels.len() == self.depth {
            let (walk, at) = (Walk::new(), At::NONE);
            self.levels.push(Level { walk, at, frame: FrameKey::OUTERMOST });
        }
        let level = &mut self.levels[self.depth];
        level.walk.begin(&members.tree(view.scene.context().isa()), &local);
        (level.at, level.frame) = (At { placed: NOTHING, shift, scale }, frame.key());
        self.depth += 1;
    }

    /// The next placed tree that the ray may enter before `best`.
    #[inline]
    pub fn next(&mut self, view: &SceneView, ray: &Ray, best: f64) -> Option<u64> {
        loop {
            if let Some(only) = self.only.take() {
                return Some(only);
            }
            let level = self.levels[..self.depth].last_mut()?;
            let frame = Frame::of(view.scene, &level.frame);
            let (members, _) = frame.scene.placement.top.walked()?;
            level.walk.shorten(level.at.in_tree(best));
            match members.tree(view.scene.context().isa()).closest(None, &mut level.walk) {
                Outcome::Member(member) => match frame.scene.placement.member(member) {
                    Member::Placed(number) => return Some(frame.first + u64::from(number)),
                    Member::Scene(it) => {
                        let inner = frame.inside(it);
                        if inner.seen_by() & ray.mask != 0 {
                            self.enter(view, ray, inner, best);
                        }
                    }
                },
                // All blocks of this tree are in memory.
                Outcome::Done | Outcome::Pending(_) => self.depth -= 1,
            }
        }
    }

    /// Gives back memory that the walk does not need now, because it is going to wait.
    pub fn fit(&mut self) {
        self.levels.truncate(self.depth);
        self.levels.shrink_to_fit();
        self.levels.iter_mut().for_each(|level| level.walk.fit());
    }

    /// Bytes of memory in addition to the walk itself.
    pub fn bytes(&self) -> u64 {
        let own = (self.levels.capacity() * size_of::<Level>()) as u64;
        own + self.levels.iter().map(|level| level.walk.bytes()).sum::<u64>()
    }
}
