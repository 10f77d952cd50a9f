//! The placed trees that a group of rays may enter, found by the group's beam.

use super::beam::Beam;
use super::frame::{Scenes, Target};
use super::walk::SceneView;
use super::widths::Width;
use crate::math::DBounds;

/// A placed tree that rays of a beam may enter.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EnteredTree {
    pub placed: u64,
    /// Bounds of all that rays may hit in it.
    pub bounds: DBounds,
}

/// The placed trees that rays of a beam may enter, of one beam after the other. Reusable.
#[derive(Debug, Default)]
pub(crate) struct Entered {
    pub trees: Vec<EnteredTree>,
    /// Number of the last beams in a row whose lists were incomplete.
    failed: u32,
}

/// After so many beams in a row that enter more trees than [`FEW`], only each [`AGAIN`]th is tried. (In a forest nearly
/// all enter more: to find that out took a tenth of the time of a picture.)
const PATIENCE: u32 = 8;
/// See [`PATIENCE`].
const AGAIN: u32 = 16;

/// Greatest number of placed trees that a beam collects. Rays that enter more go tree by tree, each ray where it enters
/// the tree's bounds.
pub(super) const FEW: usize = 4;

impl SceneView<'_> {
    /// Collects in `out` the placed trees that rays of a beam may enter up to `t_max` and that are visible to them.
    /// Returns false if the list is incomplete: there are more than [`FEW`], a stand-in for several may answer one of
    /// the rays, the top tree is too deep for the stack, or the list was not tried after many that were incomplete.
    /// `width`: that of the rays.
    pub fn entered(&self, beam: &Beam, width: Width, t_max: f64, out: &mut Entered) -> bool {
        out.trees.clear();
        let is_tried = out.failed < PATIENCE || out.failed.is_multiple_of(AGAIN);
        let is_few = is_tried && self.collect(beam, width, t_max, &mut out.trees);
        out.failed = if is_few { 0 } else { out.failed.wrapping_add(1) };
        is_few
    }

    fn collect(&self, beam: &Beam, width: Width, t_max: f64, out: &mut Vec<EnteredTree>) -> bool {
        let around = *self.scene.placement.top.around();
        let Some(root) = self.scene.root(Scenes::SeenBy(beam.mask)).filter(|_| beam.enter(&around, t_max).is_some())
        else {
            return true;
        };
        let mut todo = [(root, around); MOST_OPEN];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (node, bounds) = todo[count];
            match node {
                Target::Placed(placed) if self.seen_by(placed) & beam.mask == 0 => {}
                Target::Placed(placed) => {
                    if out.len() == FEW {
                        return false;
                    }
                    out.push(EnteredTree { placed, bounds });
                }
                Target::Inner(node) => {
                    if count + MOST_CHILDREN > MOST_OPEN {
                        return false;
                    }
                    let mut may_stand_in = false;
                    self.scene.children_and_widths(node, Scenes::SeenBy(beam.mask), |child, bounds, least| {
                        if beam.enter(&bounds, t_max).is_some() {
                            may_stand_in |= width.may_reach(least, &bounds, beam);
                            todo[count] = (child, bounds);
                            count += 1;
                        }
                    });
                    if may_stand_in {
                        return false;
                    }
                }
            }
        }
        true
    }
}

/// Size of the stack of top-tree nodes: a depth-first walk holds up to seven nodes for each level.
const MOST_OPEN: usize = 64;
/// Greatest number of children of a node.
const MOST_CHILDREN: usize = 8;
