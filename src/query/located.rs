//! The search for the triangle that a hit lies on, by its ids and its position.

use super::batch::Policy;
use super::hit::{Hit, NONE};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::geom::distances::point_triangle;
use crate::math::{Bounds, DBounds};
use crate::residency::{Lease, Snapshot};
use crate::scene::SceneState;
use crate::scene::frame::Scenes;
use crate::scene::model::Model;
use crate::scene::placed::Placed;
use crate::structure::{Below, Place, Rooted, Tree, TriHit, Triangle, Visit};
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// A triangle that was found, with its blocks in memory.
pub(super) struct Located<'a> {
    pub placed: &'a Placed,
    pub view: Tree<'a>,
    /// A hit on the triangle: the weights are 0.
    pub hit: &'a TriHit,
    pub triangle: &'a Triangle,
    /// The hit's position in the tree's frame.
    pub at: DVec3,
}

/// The blocks of models that searches read. Those in memory are looked up in one snapshot until another is needed.
pub(super) struct Blocks<'a> {
    scene: &'a SceneState,
    policy: Policy,
    cancel: &'a Cancel,
    /// The model, and its blocks.
    last: Option<(u32, Arc<Snapshot>)>,
    lease: Option<Lease>,
}

impl<'a> Blocks<'a> {
    /// With [`Policy::Exact`] blocks that are not in memory are read, otherwise they are lacking.
    pub fn new(scene: &'a SceneState, policy: Policy, cancel: &'a Cancel) -> Self {
        Self { scene, policy, cancel, last: None, lease: None }
    }

    /// A snapshot with these blocks; `None` if they are not in memory and must not be read. Blocks that are read come
    /// into a lease of their own.
    fn with(&mut self, model: u32, blocks: &[BlockId]) -> Result<Option<Arc<Snapshot>>> {
        let has_all = |it: &Snapshot| blocks.iter().all(|id| it.block(*id).is_some());
        if let Some((of, snapshot)) = &self.last
            && *of == model
            && has_all(snapshot)
        {
            return Ok(Some(snapshot.clone()));
        }
        let model_blocks = self.scene.models[model as usize].blocks();
        let mut now = model_blocks.snapshot();
        if !has_all(&now) {
            if self.policy == Policy::Now {
                return Ok(None);
            }
            // The lease before is given back first: there is one for all.
            (self.last, self.lease) = (None, None);
            let held = self.lease.insert(self.scene.context().residency().lease());
            held.fetch(model_blocks, blocks, self.cancel)?;
            now = held.snapshot(model_blocks)?;
        }
        self.last = Some((model, now.clone()));
        Ok(Some(now))
    }
}

/// What a search has found in a placed tree.
enum Search<T> {
    /// A triangle with the hit's ids, and whether it holds the hit's position.
    Found(bool, T),
    Nothing,
    /// Blocks are not in memory.
    Lacking,
}

impl SceneState {
    /// Finds the triangle with the hit's instance, part and primitive id that is nearest to its position, and returns
    /// what `read` makes of it; `None` if blocks are lacking. Fails with `BadArgument`, which names the hit by
    /// `number`, if the hit lacks a position or one of these ids, or there is no such triangle.
    pub(super) fn find<T>(
        &self,
        number: usize,
        hit: &Hit,
        blocks: &mut Blocks,
        read: &impl Fn(&Located) -> std::result::Result<T, BlockId>,
    ) -> Result<Option<T>> {
        let wrong = |why: &str| Err(Error::BadArgument(format!("hit {number}: {why}")));
        if [hit.instance, hit.part, hit.prim].contains(&NONE) || !hit.position.is_finite() {
            return wrong("it needs a position, and the ids of instance, part and primitive");
        }
        // The number of the placed tree, if the hit has it, finds the tree without a search.
        if self.is_at(hit.occurrence, hit) {
            match self.search(hit.occurrence, hit, blocks, read)? {
                Search::Found(true, found) => return Ok(Some(found)),
                Search::Found(false, _) | Search::Nothing => {}
                Search::Lacking => return Ok(None),
            }
        }
        // Of coincident trees the first counts.
        let mut beside = None;
        let mut numbers: Vec<u64> = self.placed_in(Scenes::All, |b| holds(b, hit.position)).collect();
        numbers.sort_unstable();
        for number in numbers {
            blocks.cancel.check()?;
            if !self.is_at(number, hit) {
                continue;
            }
            match self.search(number, hit, blocks, read)? {
                Search::Found(true, found) => return Ok(Some(found)),
                Search::Found(false, found) => beside = beside.or(Some(found)),
                Search::Nothing => {}
                Search::Lacking => return Ok(None),
            }
        }
        if beside.is_none() {
            return wrong("no triangle of the scene has its ids at its position");
        }
        Ok(beside)
    }

    /// True if there is such a placed tree, of the hit's instance, and it may hold the hit's position.
    fn is_at(&self, number: u64, hit: &Hit) -> bool {
        number < self.placement.len()
            && self.instance_id(self.ids_of(number).instance) == hit.instance
            && holds(&self.placed(number).bounds, hit.position)
    }

    fn search<T>(
        &self,
        number: u64,
        hit: &Hit,
        blocks: &mut Blocks,
        read: &impl Fn(&Located) -> std::result::Result<T, BlockId>,
    ) -> Result<Search<T>> {
        let placed = self.placed(number);
        At { model: &self.models[placed.model as usize], placed: &placed, hit, blocks, read }.search()
    }
}

/// True if bounds hold a point, up to the roundings of hits.
fn holds(bounds: &DBounds, p: DVec3) -> bool {
    let give = slack(bounds.min.abs().max(bounds.max.abs()).max_element());
    (p - bounds.min + give).min_element() >= 0.0 && (bounds.max + give - p).min_element() >= 0.0
}

/// Distance by which a hit may be off its triangle, for coordinates of at most `size`.
fn slack(size: f64) -> f64 {
    size * 1e-6
}

/// The search for the triangle of a hit in a placed tree.
struct At<'a, 'b, F> {
    model: &'a Model,
    placed: &'a Placed,
    hit: &'a Hit,
    blocks: &'a mut Blocks<'b>,
    read: &'a F,
}

impl<T, F: Fn(&Located) -> std::result::Result<T, BlockId>> At<'_, '_, F> {
    /// Visits boxes in the order of their distances from the position, until none is nearer than the best triangle.
    fn search(mut self) -> Result<Search<T>> {
        let at = self.placed.local_point(self.hit.position);
        let give = slack(self.placed.max_coord().max(at.abs().max_element()));
        let mut best: Option<(f64, T)> = None;
        // Boxes that may hold the triangle with the squares of their distances, the nearest last.
        let mut places: Vec<(f64, Place)> = {
            let snapshot = self.model.blocks().snapshot();
            self.view(&snapshot).root().into_iter().map(|place| (0.0, place)).collect()
        };
        while let Some((distance, place)) = places.pop() {
            if best.as_ref().is_some_and(|(away, _)| distance > *away) {
                break;
            }
            self.blocks.cancel.check()?;
            let block = BlockId(place.block);
            let Some(snapshot) = self.blocks.with(self.placed.model, &[block])? else { return Ok(Search::Lacking) };
            let mut found: Vec<(f64, TriHit, Triangle)> = Vec::new();
            let mut child = |below: Place, bounds: &Bounds, _: bool| {
                if let Some(distance) = apart(bounds, at, give) {
                    let index = places.partition_point(|it| it.0 > distance);
                    places.insert(index, (distance, below));
                }
            };
            let mut triangle = |hit: &TriHit, triangle: &Triangle| {
                if apart(&Bounds::of(&triangle.vertices), at, give).is_some() {
                    let away = point_triangle(at, &triangle.vertices.map(Vec3::as_dvec3)).squared;
                    found.push((away, *hit, *triangle));
                }
            };
            let below = &mut Below { child: &mut child, triangle: &mut triangle };
            if let Err(block) = self.view(&snapshot).expand(place, below) {
                return Err(self.corrupt(block));
            }
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (away, hit, triangle) in found {
                if best.as_ref().is_some_and(|(least, _)| *least <= away) {
                    break;
                }
                match self.compare(&hit, &triangle, at)? {
                    Search::Found(_, found) => best = Some((away, found)),
                    Search::Nothing => {}
                    Search::Lacking => return Ok(Search::Lacking),
                }
            }
        }
        Ok(best.map_or(Search::Nothing, |(away, found)| Search::Found(away <= give * give, found)))
    }

    fn view<'s>(&self, snapshot: &'s Snapshot) -> Tree<'s>
    where
        Self: 's,
    {
        self.model.tree_in(self.placed.tree, snapshot, Visit::default())
    }

    fn corrupt(&self, block: BlockId) -> Error {
        Error::corrupt(self.model.blocks().file().name(), Some(block.0), "it lacks what other blocks refer to")
    }

    /// Reads the triangle if its ids are those of the hit.
    fn compare(&mut self, hit: &TriHit, triangle: &Triangle, at: DVec3) -> Result<Search<T>> {
        let part = self.placed.first_part.saturating_add(triangle.part);
        if self.model.parts().id(part as usize) != Some(self.hit.part) {
            return Ok(Search::Nothing);
        }
        let file = self.model.blocks().file();
        let block = {
            let snapshot = self.model.blocks().snapshot();
            self.view(&snapshot).block_of(hit)
        };
        let mut needed: Vec<BlockId> =
            [Some(block), Some(file.prim_block(block)), file.normal_block(block)].into_iter().flatten().collect();
        loop {
            let Some(snapshot) = self.blocks.with(self.placed.model, &needed)? else { return Ok(Search::Lacking) };
            let view = self.view(&snapshot);
            let prim = view.prim(hit).map_err(|block| self.corrupt(block))?;
            if prim.map(u64::from) != Some(self.hit.prim) {
                return Ok(Search::Nothing);
            }
            match (self.read)(&Located { placed: self.placed, view, hit, triangle, at }) {
                Ok(found) => return Ok(Search::Found(true, found)),
                // A block that is there and still lacking is wrong.
                Err(lacking) if needed.contains(&lacking) => return Err(self.corrupt(lacking)),
                Err(lacking) => needed.push(lacking),
            }
        }
    }
}

/// The square of the distance of a point from a box; `None` if it is farther than `give` along an axis.
fn apart(bounds: &Bounds, at: DVec3, give: f64) -> Option<f64> {
    let off = (bounds.min.as_dvec3() - at).max(at - bounds.max.as_dvec3()).max(DVec3::ZERO);
    (off.max_element() <= give).then(|| off.length_squared())
}
