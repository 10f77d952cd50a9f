//! The walk of a ray through the top trees of a scene and of the scenes in it, up to the next placed tree that it may
//! enter.

use super::frame::{Fork, Frame, FrameKey, Scenes};
use super::placed::At;
use super::walk::{EndsIn, Found, NOTHING, SceneView};
use crate::math::{Cone, Ray};
use crate::structure::{LocalRay, MemberChild, Outcome, PartFilter, Walk};

/// A ray in top trees, at one for each level. Reusable.
#[derive(Debug, Default)]
pub(super) struct TopWalk {
    /// The scene that the ray is in is the last of the first `depth`.
    levels: Vec<Level>,
    depth: usize,
    /// The placed tree that the ray is to enter next.
    next: Option<u64>,
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
            let root = Frame::outermost(view.scene).root(Scenes::SeenBy(ray.mask));
            self.enter(view, ray, root, ray.t_max);
        }
    }

    /// Ends the walk.
    pub fn end(&mut self) {
        (self.depth, self.next) = (0, None);
    }

    /// Puts the ray into the tree of a scene, unless it certainly meets nothing there before `best`.
    fn enter(&mut self, view: &SceneView, ray: &Ray, fork: Option<Fork>, best: f64) {
        let frame = match fork {
            None => return,
            Some(Fork::Placed(number)) => return self.next = Some(number),
            Some(Fork::Node(frame, _)) => frame,
        };
        let Some((members, boxes)) = frame.walked() else { return };
        let mut local = LocalRay::NONE;
        let Some((shift, scale)) = boxes.local(ray, best, true, &mut local) else { return };
        if !frame.has_cells() {
            local.cone = Cone::ZERO;
        }
        if self.levels.len() == self.depth {
            let (walk, at) = (Walk::new(), At::NONE);
            self.levels.push(Level { walk, at, frame: FrameKey::OUTERMOST });
        }
        let level = &mut self.levels[self.depth];
        level.walk.begin(&members.tree(view.scene.context().isa()), &local);
        (level.at, level.frame) = (At { placed: NOTHING, shift, scale }, frame.key());
        self.depth += 1;
    }

    /// The next placed tree in which the ray may meet something better than `best`. Offers `best` the stand-ins for
    /// several members that the ray meets. `ANY`: the walk ends at the first.
    #[inline]
    pub fn next<const ANY: bool>(&mut self, view: &SceneView, ray: &Ray, best: &mut Found) -> Option<u64> {
        loop {
            if let Some(next) = self.next.take() {
                return Some(next);
            }
            let level = self.levels[..self.depth].last_mut()?;
            let frame = Frame::of(view.scene, &level.frame);
            let tree = frame.tree()?;
            let reach = best.reach(ray);
            level.walk.shorten(level.at.in_tree(reach));
            let (walk, within) = (&mut level.walk, view.within.map(|ends| EndsIn { ends, at: level.at }));
            let filter = within.as_ref().map(|within| PartFilter { within: Some(within), ..PartFilter::default() });
            match if ANY { tree.any(filter.as_ref(), walk) } else { tree.closest(filter.as_ref(), walk) } {
                Outcome::Member(member) => {
                    let fork = frame.fork(MemberChild::Member(member), Scenes::SeenBy(ray.mask));
                    self.enter(view, ray, fork, reach);
                }
                // All blocks of this tree are in memory.
                Outcome::Done | Outcome::Pending(_) => {
                    let (hit, first_cell) = (walk.best(), walk.first_cell());
                    best.offer_in::<ANY>(view.widen_interval, frame.hit_tree(), &level.at, hit, first_cell);
                    self.depth -= 1;
                    if ANY && best.is_hit() {
                        self.end();
                    }
                }
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
