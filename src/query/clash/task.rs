//! A clash query, prepared: which pairs of parts are compared.

use super::super::part_set::{Members, PartSet};
use super::ClashOptions;
use super::rules::Rules;
use crate::base::error::Result;
use crate::base::memory::make_room;
use crate::base::progress::{Cancel, Progress};
use crate::math::DBounds;
use crate::scene::SceneState;
use crate::scene::placed::Placed;
use crate::scene::state::Stand;

/// A part of an instance, by the indices of both: [`Members`] bounds the number of instances.
pub(super) type PartKey = [u32; 2];

/// The part of a placed tree's model.
pub(super) fn key_of(placed: &Placed, part: u32) -> PartKey {
    [placed.instance as u32, part]
}

pub(super) struct Task<'a> {
    pub scene: &'a SceneState,
    pub options: &'a ClashOptions,
    a: Members,
    /// `None`: as `a`.
    b: Option<Members>,
    rules: Rules<'a>,
    cancel: &'a Cancel,
    pub progress: &'a Progress,
}

impl<'a> Task<'a> {
    pub fn new(
        scene: &'a SceneState,
        options: &'a ClashOptions,
        progress: &'a Progress,
        cancel: &'a Cancel,
    ) -> Result<Self> {
        let a = Members::of(scene, &options.a, "the first set")?;
        let of_b = |set: &PartSet| Members::of(scene, set, "the second set");
        let b = options.b.as_ref().map(of_b).transpose()?;
        Ok(Self { scene, options, a, b, rules: Rules::new(scene, &options.rules), cancel, progress })
    }

    /// True if the query was cancelled.
    pub fn is_over(&self) -> bool {
        self.cancel.is_cancelled()
    }

    /// Set when the query is cancelled.
    pub fn cancel(&self) -> &Cancel {
        self.cancel
    }

    fn b(&self) -> &Members {
        self.b.as_ref().unwrap_or(&self.a)
    }

    /// True if a part is in the first set, and another in the second one.
    pub fn is_in_order(&self, x: PartKey, y: PartKey) -> bool {
        self.a.has(x[0].into(), x[1]) && self.b().has(y[0].into(), y[1])
    }

    /// True if a pair of parts is compared, in either order.
    #[inline]
    pub fn wants(&self, x: PartKey, y: PartKey) -> bool {
        x != y
            && (self.is_in_order(x, y) || self.is_in_order(y, x))
            && self.is_shown(x)
            && self.is_shown(y)
            && !self.rules.skips(x, y)
    }

    /// True if a part is in one of the sets and visible.
    pub fn has(&self, x: PartKey) -> bool {
        (self.a.has(x[0].into(), x[1]) || self.b().has(x[0].into(), x[1])) && self.is_shown(x)
    }

    /// The members of both sets among the parts of a placed tree, as bits of its local parts (`lod::summary_bit`).
    pub fn bits_of(&self, placed: &Placed) -> [u32; 2] {
        let count = self.scene.models[placed.model as usize].local_parts(placed.tree);
        [&self.a, self.b()].map(|set| set.bits(placed.instance, placed.first_part, count))
    }

    fn is_shown(&self, [instance, part]: PartKey) -> bool {
        let it = self.scene.state_of(instance.into());
        it.look.visible && !it.parts.looks.hides(part)
    }

    /// Returns the pairs of placed trees that may have pairs of parts within the clearance of each other, in order.
    pub fn tree_pairs(&self) -> Result<Vec<[u32; 2]>> {
        let what = "a clash search";
        // The placed trees that may have parts of either set: number, and the part if there is one. The sets bound the
        // numbers.
        let mut trees: Vec<(u32, Option<PartKey>)> = Vec::new();
        let (mut boxes, mut may): (Vec<DBounds>, Vec<[bool; 2]>) = (Vec::new(), Vec::new());
        for number in 0..self.scene.placement.len() {
            let Stand { ids, state, .. } = self.scene.stand(number);
            let count = self.scene.models[ids.model as usize].local_parts(ids.tree);
            let any = |members: &Members| members.has_any(ids.instance, ids.first_part, count);
            let has = if state.look.visible { [any(&self.a), any(self.b())] } else { [false; 2] };
            if has == [false; 2] {
                continue;
            }
            let placed = self.scene.placed(number);
            if !placed.bounds.is_empty() {
                make_room(&mut trees, 1, what)?;
                make_room(&mut boxes, 1, what)?;
                make_room(&mut may, 1, what)?;
                trees.push((number as u32, (count == 1).then_some(key_of(&placed, ids.first_part))));
                boxes.push(placed.bounds);
                may.push(has);
            }
        }
        let mut pairs = Vec::new();
        near_pairs(boxes.iter().copied(), &may, self.options.clearance, |x, y| {
            // The pair of parts decides where each tree has one.
            let is_wanted = match (trees[x].1, trees[y].1) {
                (Some(a), Some(b)) => self.wants(a, b),
                _ => true,
            };
            if is_wanted {
                pairs.push([trees[x.min(y)].0, trees[x.max(y)].0]);
            }
        });
        pairs.sort_unstable();
        Ok(pairs)
    }
}

/// Calls `take` for each pair of boxes, a box and itself included, that are within `reach` of each other along each
/// axis, of which one may be the first of a pair and the other the second. A sweep along the longest axis.
pub(super) fn near_pairs(
    boxes: impl Iterator<Item = DBounds>,
    may: &[[bool; 2]],
    reach: f64,
    mut take: impl FnMut(usize, usize),
) {
    let boxes: Vec<DBounds> = boxes.collect();
    let mut order: Vec<usize> = (0..boxes.len()).filter(|&i| may[i] != [false; 2]).collect();
    let all = order.iter().fold(DBounds::EMPTY, |all, &i| all.union(boxes[i]));
    let extent = all.extent();
    let axis = (1..3).fold(0, |best, axis| if extent[axis] > extent[best] { axis } else { best });
    order.sort_by(|&x, &y| boxes[x].min[axis].total_cmp(&boxes[y].min[axis]).then(x.cmp(&y)));
    let is_wanted = |x: usize, y: usize| may[x][0] && may[y][1] || may[y][0] && may[x][1];
    for (k, &x) in order.iter().enumerate() {
        let end = boxes[x].max[axis] + reach;
        for &y in order[k..].iter().take_while(|&&y| boxes[y].min[axis] <= end) {
            let is_near = |axis: usize| {
                boxes[x].min[axis] <= boxes[y].max[axis] + reach && boxes[y].min[axis] <= boxes[x].max[axis] + reach
            };
            if is_wanted(x, y) && (0..3).all(is_near) {
                take(x, y);
            }
        }
    }
}
