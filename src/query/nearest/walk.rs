//! The walk from a point to the nearest triangle: down the tree over placed trees and into these, the nearest box
//! first. It ends where blocks are missing, and continues later.

use super::super::among::Among;
use crate::geom::point_triangle;
use crate::math::bits;
use crate::scene::SceneState;
use crate::scene::frame::Target;
use crate::scene::placed::Placed;
use crate::scene::walk::SceneView;
use crate::structure::nearest::{PointFrame, at_most, sort_nearest_last, squared_to_triangles, triangle_of};
use crate::structure::{Place, Rooted, Rows, Tree, TriHit};
use glam::DVec3;
use std::borrow::Cow;

/// Where a walk has still to go, and a bound of the squared distance to all that is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    pub squared: f64,
    pub at: At,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum At {
    /// A node of the tree over placed trees, or a placed tree.
    Top(Target),
    /// A place of a placed tree.
    In(u64, Place),
}

/// A triangle that may be the nearest one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    /// Number of the placed tree.
    pub placed: u64,
    /// Index of the part in its model.
    pub part: u32,
    /// The place of its primitive id, and the id once it is known: `u64::MAX` if there is none.
    pub prim_at: Place,
    pub prim: Option<u64>,
    /// Its nearest point, relative to the point asked for.
    pub point: DVec3,
    /// Bound of the error of the distance.
    pub error: f64,
}

/// All that is known of the distance from a point.
#[derive(Debug, Clone, Default)]
pub(super) struct Best {
    /// Squared distance to the nearest triangle so far, or the limit.
    pub squared: f64,
    /// The triangles at this distance, of one part.
    pub ties: Vec<Candidate>,
    /// Upper bound of the squared distance, and the middle of a box that holds surface within it: of boxes whose
    /// triangles are all asked for.
    pub around: Option<(f64, DVec3)>,
}

impl Best {
    /// Begins with a limit.
    pub fn begin(&mut self, squared: f64) {
        self.squared = squared;
        self.ties.clear();
        self.around = None;
    }
}

/// Working memory of a thread.
#[derive(Default)]
pub(super) struct Scratch {
    pub best: Best,
    pub stack: Vec<Entry>,
    /// The entries that lack their blocks.
    pub left: Vec<Entry>,
    rows: Rows,
}

/// The placed tree that a walk is in.
struct Inside<'a> {
    index: u64,
    placed: Cow<'a, Placed>,
    tree: Tree<'a>,
    frame: PointFrame,
    /// Distances to boxes and triangles of the tree are exact within this.
    slack: f64,
    /// The squared distance beyond which nothing is sought.
    limit: f64,
    /// Every triangle counts.
    is_whole: bool,
}

/// A walk that has a scene's blocks in memory.
pub(super) struct Walker<'a> {
    view: &'a SceneView<'a>,
    among: &'a Among<'a>,
    /// The rounding of distances to boxes of placed trees.
    slack: f64,
}

/// The squared distance beyond which there is nothing nearer than `squared`, in distances that are exact within
/// `slack`.
#[inline(always)]
fn limit(squared: f64, slack: f64) -> f64 {
    let distance = squared.sqrt() * (1.0 + 1e-12) + slack;
    distance * distance
}

/// Bound of the errors of distances from a point to boxes and triangles of a tree: of coordinates on the way to the
/// frame of the point, and of [`point_triangle`] for triangles that are nearer than `reach`.
fn slack_of(placed: &Placed, p: DVec3) -> f64 {
    const POINT_TRIANGLE: f64 = 1.0 / (1u64 << 45) as f64;
    let size = p.abs().max_element();
    let reach = (placed.bounds.max - p).abs().max((placed.bounds.min - p).abs()).length();
    2.0 * placed.rounding(size) + reach * POINT_TRIANGLE
}

impl<'a> Walker<'a> {
    pub fn new(view: &'a SceneView<'a>, among: &'a Among<'a>) -> Self {
        Self { view, among, slack: 0.0 }
    }

    fn scene(&self) -> &'a SceneState {
        self.view.scene
    }

    #[inline(always)]
    fn enter(&self, index: u64, p: DVec3, best: f64) -> Inside<'a> {
        let placed = self.scene().placed(index);
        let frame = PointFrame::new(placed.frame_around(p), placed.local_point(p), [placed.shrink(), placed.stretch]);
        let slack = slack_of(&placed, p);
        let (tree, is_whole) = (self.among.tree(self.view, index), self.among.is_whole(index));
        Inside { index, placed, tree, frame, slack, limit: limit(best, slack), is_whole }
    }

    /// Goes on from the stack as far as the blocks in memory allow. With `BOXES` it also finds upper bounds from boxes.
    #[inline(always)]
    pub fn go_on<const BOXES: bool>(&self, p: DVec3, scratch: &mut Scratch) {
        let Scratch { best, stack, left, rows } = scratch;
        let mut inside: Option<Inside> = None;
        // Boxes around placed trees are rounded outward, but the distances to triangles are rounded too.
        let around = self.among.around();
        let far = (around.max - p).abs().max((around.min - p).abs()).length();
        let top_slack = self.slack + far * 1e-12;
        while let Some(entry) = stack.pop() {
            match entry.at {
                At::Top(target) => {
                    if entry.squared <= limit(best.squared, top_slack) {
                        self.open_top::<BOXES>(p, target, best, stack);
                    }
                }
                At::In(index, place) => {
                    let now = match &mut inside {
                        Some(now) if now.index == index => now,
                        other => other.insert(self.enter(index, p, best.squared)),
                    };
                    if entry.squared > now.limit {
                        continue;
                    }
                    if now.tree.rows(place, false, rows).is_err() {
                        left.push(entry);
                    } else if rows.is_leaf {
                        self.meet(p, now, rows, best);
                    } else {
                        let bottom = stack.len();
                        Self::open::<BOXES>(now, rows, best, stack);
                        sort_nearest_last(&mut stack[bottom..], |entry| entry.squared);
                    }
                }
            }
        }
    }

    /// Puts the children of a node over placed trees on the stack.
    fn open_top<const BOXES: bool>(&self, p: DVec3, target: Target, best: &mut Best, stack: &mut Vec<Entry>) {
        match target {
            Target::Placed(index) if self.among.enters(index) => {
                let placed = self.scene().placed(index);
                if BOXES && self.among.is_whole(index) {
                    let far = (placed.bounds.max - p).abs().max((placed.bounds.min - p).abs());
                    around(best, far.dot(far), (placed.bounds.min + placed.bounds.max) * 0.5 - p);
                }
                let root = self.among.tree(self.view, index).root();
                stack.extend(
                    root.map(|root| Entry { squared: placed.bounds.squared_distance_to(p), at: At::In(index, root) }),
                );
            }
            Target::Placed(_) => {}
            Target::Inner(node) => {
                let bottom = stack.len();
                self.among.children(node, |child, bounds| {
                    stack.push(Entry { squared: bounds.squared_distance_to(p), at: At::Top(child) });
                });
                sort_nearest_last(&mut stack[bottom..], |entry| entry.squared);
            }
        }
    }

    /// Puts children on the stack.
    #[inline(always)]
    fn open<const BOXES: bool>(now: &Inside, rows: &Rows, best: &mut Best, stack: &mut Vec<Entry>) {
        let boxes = rows.boxes();
        let squared = now.frame.squared(&boxes);
        if BOXES && now.is_whole {
            let far = now.frame.farthest(&boxes);
            let image = now.frame.image(&boxes);
            for lane in bits(rows.mask) {
                let middle = DVec3::new(image[0][0][lane], image[1][0][lane], image[2][0][lane]);
                around(best, limit(far[lane], now.slack), middle);
            }
        }
        for lane in bits(rows.mask & at_most(&squared, now.limit)) {
            stack.push(Entry { squared: squared[lane], at: At::In(now.index, rows.places[lane]) });
        }
    }

    /// Measures the distances to triangles.
    #[inline(always)]
    fn meet(&self, p: DVec3, now: &mut Inside, rows: &Rows, best: &mut Best) {
        let corners = now.frame.corners(rows);
        let squared = squared_to_triangles(&corners);
        for lane in bits(rows.mask & at_most(&squared, now.limit)) {
            if squared[lane] > now.limit {
                continue;
            }
            let part = now.placed.first_part.saturating_add(rows.parts[lane]);
            if !now.is_whole && !self.among.has(now.placed.instance, part) {
                continue;
            }
            let near = point_triangle(DVec3::ZERO, &triangle_of(&corners, lane));
            if near.squared <= best.squared {
                self.offer(p, now, &rows.hit(lane), (near.squared, near.point, near.error, part), best);
            }
        }
    }

    /// Takes a triangle that is not farther than the nearest so far.
    fn offer(
        &self,
        p: DVec3,
        now: &mut Inside,
        hit: &TriHit,
        (squared, point, error, part): (f64, DVec3, f64, u32),
        best: &mut Best,
    ) {
        if squared == best.squared
            && let Some(other) = best.ties.first()
        {
            let instance = |placed: u64| self.scene().ids_of(placed).instance;
            let (own, other) = ((now.placed.instance, part), (instance(other.placed), other.part));
            if own > other {
                return;
            }
            if own < other {
                best.ties.clear();
            }
        } else {
            best.ties.clear();
        }
        // The triangle's block is in memory here.
        let Some(prim_at) = now.tree.prim_place(hit) else { return };
        let error = error + now.placed.corner_rounding(p.abs().max_element()) + now.placed.position_error;
        // A triangle in several leaves counts once.
        if !best.ties.iter().any(|tie| (tie.placed, tie.prim_at) == (now.index, prim_at)) {
            best.ties.push(Candidate { placed: now.index, part, prim_at, prim: None, point, error });
        }
        if squared < best.squared {
            best.squared = squared;
            now.limit = limit(squared, now.slack);
        }
    }

    /// Finds the primitive ids of the nearest triangles. Returns false if blocks are missing.
    pub fn name(&self, best: &mut Best) -> bool {
        let mut is_all = true;
        for tie in best.ties.iter_mut().filter(|tie| tie.prim.is_none()) {
            match self.view.tree(tie.placed).prim_at(tie.prim_at) {
                Ok(prim) => tie.prim = Some(prim.map_or(u64::MAX, u64::from)),
                Err(_) => is_all = false,
            }
        }
        is_all
    }

    /// Removes the entries that are farther than the nearest triangle.
    pub fn prune(&self, p: DVec3, squared: f64, left: &mut Vec<Entry>) {
        left.retain(|entry| match entry.at {
            At::Top(_) => true,
            At::In(index, _) => {
                let placed = self.scene().placed(index);
                entry.squared <= limit(squared, slack_of(&placed, p))
            }
        });
    }

    /// The lower bound of the distance to what is left.
    pub fn least(&self, p: DVec3, left: &[Entry]) -> f64 {
        let of = |entry: &Entry| {
            let slack = match entry.at {
                At::In(index, _) => slack_of(&self.scene().placed(index), p),
                At::Top(_) => 0.0,
            };
            (entry.squared.sqrt() * (1.0 - 1e-12) - slack).max(0.0)
        };
        left.iter().map(of).fold(f64::INFINITY, f64::min)
    }
}

/// Takes an upper bound from a box.
#[inline(always)]
fn around(best: &mut Best, squared: f64, middle: DVec3) {
    if best.around.is_none_or(|(least, _)| squared < least) {
        best.around = Some((squared, middle));
    }
}
