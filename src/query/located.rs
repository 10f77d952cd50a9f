//! The search for the triangles that hits lie on, by their ids and their positions, in [rounds](super::rounds).

use super::batch::Policy;
use super::hit::{Hit, NONE};
use super::rounds::{Quest, Rounds};
use super::waiting::{Lacking, Waiting};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::memory::room;
use crate::base::progress::Cancel;
use crate::geom::distances::point_triangle;
use crate::math::{Bounds, DBounds};
use crate::scene::SceneState;
use crate::scene::frame::Scenes;
use crate::scene::placed::Placed;
use crate::scene::walk::{Need, SceneView, Snapshots};
use crate::structure::{Below, Place, Rooted, Tree, TriHit, Triangle};
use glam::{DVec3, Vec3};
use std::cmp::Reverse;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A triangle that was found, with its block in memory.
pub(super) struct Located<'a> {
    /// Index of its hit in the batch.
    pub index: usize,
    pub placed: &'a Placed,
    pub tree: Tree<'a>,
    /// A hit on the triangle with arbitrary weights.
    pub hit: &'a TriHit,
    pub triangle: &'a Triangle,
    /// The position of the batch's hit in the tree's frame.
    pub at: DVec3,
}

/// Makes a result of a triangle; fails with a block that it needs.
pub(super) type Read<'a, T> = &'a (dyn Fn(&Located) -> std::result::Result<T, BlockId> + Sync);

/// Hits that a worker takes at a time.
const CHUNK: usize = 128;

/// For each hit of `sought`, indices in `hits`, finds the triangle with its instance, part and primitive id that is
/// nearest to its position, and returns what `read` makes of it, in order. With [`Policy::Now`] nothing is read from
/// the disk, and the result is `None` where blocks are lacking.
///
/// Fails with `BadArgument`, which names the first such hit, if a hit lacks a position or one of these ids, or there is
/// no such triangle.
pub(super) fn locate<T: Send>(
    scene: &SceneState,
    (hits, sought): (&[Hit], &[u32]),
    policy: Policy,
    cancel: &Cancel,
    read: Read<T>,
) -> Result<Vec<Option<T>>> {
    let mut out = room(sought.len(), "what is found of hits")?;
    out.resize_with(sought.len(), || None);
    let stamp = scene.context().residency().stamp();
    let out = Mutex::new((out, None));
    let rounds = Rounds::new(Locate { scene, hits, sought, policy, cancel, read, stamp, out });
    scene.context().pool().run_scoped(sought.len().div_ceil(CHUNK), &rounds).into_result()?;
    let (found, failed) = rounds.quest.out.into_inner().unwrap_or_else(PoisonError::into_inner);
    failed.map_or(Ok(found), |(_, error)| Err(error))
}

/// The results, and the failure of the first hit that failed, with its index in `sought`.
type Out<T> = (Vec<Option<T>>, Option<(u32, Error)>);

/// The quest: its items are chunks of hits, its pieces are searches.
struct Locate<'a, T> {
    scene: &'a SceneState,
    hits: &'a [Hit],
    sought: &'a [u32],
    policy: Policy,
    cancel: &'a Cancel,
    read: Read<'a, T>,
    stamp: u32,
    out: Mutex<Out<T>>,
}

/// A search that lacks blocks.
struct Piece<T> {
    /// Index in `sought`.
    index: u32,
    search: Search<T>,
    /// The blocks of the next step.
    needs: Vec<Need>,
}

/// The search for one triangle.
struct Search<T> {
    /// True once the number that the hit gives was followed.
    is_hinted: bool,
    /// The numbers of the placed trees that remain, the first one last; `None`: not yet looked up.
    trees: Option<Vec<u64>>,
    tree: Option<InTree<T>>,
    /// A result beside the position, if no tree has one at it.
    beside: Option<T>,
}

/// The search in a placed tree.
struct InTree<T> {
    number: u64,
    /// The position in the tree's frame, and the distance by which it may be off the triangle.
    at: DVec3,
    give: f64,
    /// Boxes that may hold the triangle, with the squares of their distances, the nearest last.
    places: Vec<(f64, Place)>,
    /// Triangles that remain to be compared, likewise.
    found: Vec<(f64, TriHit, Triangle)>,
    /// Blocks that the comparison of the nearest one needs.
    held: Vec<Need>,
    best: Option<(f64, T)>,
}

/// Why a search has stopped.
enum Stopped {
    Lacking(Vec<Need>),
    Failed(Error),
}

impl<T: Send> Lacking for Piece<T> {
    type Step = Vec<Need>;

    fn bytes(&self) -> u64 {
        let of_tree = self.search.tree.as_ref().map_or(0, |tree| {
            tree.places.capacity() * size_of::<(f64, Place)>()
                + tree.found.capacity() * size_of::<(f64, TriHit, Triangle)>()
                + tree.held.capacity() * size_of::<Need>()
        });
        let of_trees = self.search.trees.as_ref().map_or(0, |trees| trees.capacity() * size_of::<u64>());
        (of_tree + of_trees + self.needs.capacity() * size_of::<Need>()) as u64
    }

    fn steps(&self) -> impl Iterator<Item = Vec<Need>> {
        std::iter::once(self.needs.clone())
    }

    /// The blocks that most searches need come first.
    fn sort(steps: &mut Vec<Vec<Need>>) {
        steps.sort_unstable();
        let mut counts: Vec<_> =
            steps.chunk_by(|a, b| a == b).map(|alike| (Reverse(alike.len()), alike[0].clone())).collect();
        counts.sort_unstable();
        *steps = counts.into_iter().map(|(_, step)| step).collect();
    }
}

impl<T: Send> Quest for Locate<'_, T> {
    type Waiting = Waiting<Piece<T>>;
    const ITEM_BYTES: u64 = 1 << 15;
    const RENEWAL: usize = 16;
    const FETCH: usize = 16;

    fn scene(&self) -> &SceneState {
        self.scene
    }

    fn begin(&self, item: usize, snapshots: &Snapshots) -> Vec<Piece<T>> {
        let first = item * CHUNK;
        let (mut found, mut parked) = (Vec::with_capacity(CHUNK), Vec::new());
        for index in first..self.sought.len().min(first + CHUNK) {
            let new = Search { is_hinted: false, trees: None, tree: None, beside: None };
            let piece = Piece { index: index as u32, search: new, needs: Vec::new() };
            parked.extend(self.go_on(piece, snapshots, &mut found));
        }
        let mut out = self.out();
        found.into_iter().for_each(|(index, found)| out.0[index as usize] = Some(found));
        parked
    }

    fn resume(&self, piece: Piece<T>, snapshots: &Snapshots) -> Option<Piece<T>> {
        let mut found = Vec::new();
        let parked = self.go_on(piece, snapshots, &mut found);
        found.into_iter().for_each(|(index, found)| self.out().0[index as usize] = Some(found));
        parked
    }
}

impl<T: Send> Locate<'_, T> {
    fn out(&self) -> MutexGuard<'_, Out<T>> {
        self.out.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a search as far as the blocks in memory allow; returns it if it lacks others.
    fn go_on(&self, mut piece: Piece<T>, snapshots: &Snapshots, found: &mut Vec<(u32, T)>) -> Option<Piece<T>> {
        let view = SceneView::new(self.scene, snapshots, self.stamp);
        match self.search(&view, &mut piece) {
            Ok(result) => found.push((piece.index, result)),
            Err(Stopped::Lacking(needs)) if self.policy == Policy::Exact => {
                piece.needs = needs;
                return Some(piece);
            }
            Err(Stopped::Lacking(_)) => {}
            Err(Stopped::Failed(error)) => {
                let failed = &mut self.out().1;
                if failed.as_ref().is_none_or(|(index, _)| piece.index < *index) {
                    *failed = Some((piece.index, error));
                }
            }
        }
        None
    }

    fn search(&self, view: &SceneView, piece: &mut Piece<T>) -> std::result::Result<T, Stopped> {
        self.cancel.check().map_err(Stopped::Failed)?;
        let number = self.sought[piece.index as usize] as usize;
        let hit = &self.hits[number];
        let wrong = |why: &str| Err(Stopped::Failed(Error::BadArgument(format!("hit {number}: {why}"))));
        if [hit.instance, hit.part, hit.prim].contains(&NONE) || !hit.position.is_finite() {
            return wrong("it needs a position, and the ids of instance, part and primitive");
        }
        let search = &mut piece.search;
        loop {
            if search.tree.is_none() {
                let Some(tree) = self.next_tree(view, hit, search) else { break };
                search.tree = Some(tree);
            }
            let Some(tree) = &mut search.tree else { break };
            self.search_tree(view, (number, hit), tree)?;
            let give = tree.give * tree.give;
            match search.tree.take().and_then(|tree| tree.best) {
                Some((away, found)) if away <= give => return Ok(found),
                // Of coincident trees the first counts.
                Some((_, found)) => search.beside = search.beside.take().or(Some(found)),
                None => {}
            }
        }
        search.beside.take().map_or_else(|| wrong("no triangle of the scene has its ids at its position"), Ok)
    }

    /// Begins the search in the next tree that may hold the hit. That of the number that the hit has comes first: it is
    /// found without a search.
    fn next_tree(&self, view: &SceneView, hit: &Hit, search: &mut Search<T>) -> Option<InTree<T>> {
        let hint = (!std::mem::replace(&mut search.is_hinted, true)).then_some(hit.occurrence);
        let number = hint.filter(|number| self.scene.may_hold(*number, hit)).or_else(|| {
            let look_up = || {
                let all = self.scene.placed_in(Scenes::All, |b| holds(b, hit.position));
                let mut numbers: Vec<u64> = all.filter(|number| self.scene.may_hold(*number, hit)).collect();
                numbers.sort_unstable_by_key(|number| Reverse(*number));
                numbers
            };
            search.trees.get_or_insert_with(look_up).pop()
        })?;
        let placed = self.scene.placed(number);
        let at = placed.local_point(hit.position);
        let give = slack(placed.max_coord().max(at.abs().max_element()));
        let root = view.tree_showing(number, None).root();
        let places = root.into_iter().map(|place| (0.0, place)).collect();
        Some(InTree { number, at, give, places, found: Vec::new(), held: Vec::new(), best: None })
    }

    /// Visits boxes in the order of their distances from the position, until none is nearer than the best triangle.
    fn search_tree(
        &self,
        view: &SceneView,
        (index, hit): (usize, &Hit),
        of: &mut InTree<T>,
    ) -> std::result::Result<(), Stopped> {
        let placed = self.scene.placed(of.number);
        let tree = view.tree_showing(of.number, None);
        loop {
            while let Some((away, tri, triangle)) = of.found.last() {
                let away = *away;
                if of.best.as_ref().is_some_and(|(least, _)| *least <= away) {
                    of.found.clear();
                    break;
                }
                let located = Located { index, placed: &placed, tree, hit: tri, triangle, at: of.at };
                match self.compare(&located, hit) {
                    Ok(None) => {}
                    Ok(Some(found)) => of.best = Some((away, found)),
                    Err(block) => {
                        let own = tree.block_of(tri);
                        return Err(self.lacking(view, of, [own, block]));
                    }
                }
                of.found.pop();
                of.held.clear();
            }
            let Some((distance, place)) = of.places.pop() else { return Ok(()) };
            if of.best.as_ref().is_some_and(|(away, _)| distance > *away) {
                return Ok(());
            }
            let (at, give) = (of.at, of.give);
            let InTree { places, found, .. } = of;
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
            if let Err(block) = tree.expand(place, below) {
                of.places.push((distance, place));
                return Err(self.lacking(view, of, [block; 2]));
            }
            of.held.clear();
            of.found.sort_by(|a, b| b.0.total_cmp(&a.0));
        }
    }

    /// Reads the triangle if its ids are those of the hit; fails with a block that is needed for it.
    fn compare(&self, at: &Located, hit: &Hit) -> std::result::Result<Option<T>, BlockId> {
        let part = at.placed.first_part.saturating_add(at.triangle.part);
        let model = &self.scene.models[at.placed.model as usize];
        if model.parts().id(part as usize) != Some(hit.part) || at.tree.prim(at.hit)?.map(u64::from) != Some(hit.prim) {
            return Ok(None);
        }
        (self.read)(at).map(Some)
    }

    /// The blocks of the step that has failed for want of the last one. One that is there and still lacking is wrong.
    fn lacking(&self, view: &SceneView, of: &mut InTree<T>, blocks: [BlockId; 2]) -> Stopped {
        let [own, last] = blocks.map(|block| view.need(of.number, block));
        if view.snapshots.has(last) {
            let model = &self.scene.models[last.model as usize];
            let why = "it lacks what other blocks refer to";
            return Stopped::Failed(Error::corrupt(model.blocks().file().name(), Some(last.block.0), why));
        }
        for need in [own, last] {
            if !of.held.contains(&need) {
                of.held.push(need);
            }
        }
        Stopped::Lacking(of.held.clone())
    }
}

impl SceneState {
    /// True if there is such a placed tree, of the hit's instance, and it may hold the hit's position.
    fn may_hold(&self, number: u64, hit: &Hit) -> bool {
        number < self.placement.len()
            && self.instance_id(self.ids_of(number).instance) == hit.instance
            && holds(&self.placed(number).bounds, hit.position)
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

/// The square of the distance of a point from a box; `None` if it is farther than `give` along an axis.
fn apart(bounds: &Bounds, at: DVec3, give: f64) -> Option<f64> {
    let off = (bounds.min.as_dvec3() - at).max(at - bounds.max.as_dvec3()).max(DVec3::ZERO);
    (off.max_element() <= give).then(|| off.length_squared())
}
