//! Parts that intersect a box or a frustum, decided exactly by their triangles.

use super::batch::Policy;
use super::sweep::sweep;
use super::volume::{Side, Volume};
use crate::base::error::{Error, Result};
use crate::math::DBounds;
use crate::scene::SceneState;
use crate::scene::camera::PixelRays;
use crate::scene::frame::Scenes;
use crate::scene::placed::Placed;
use crate::scene::walk::SceneView;
use crate::structure::{Descent, Triangle};
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// A half space: the points p with `normal · p + d >= 0`. `normal` need not be unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Normal that points into the half space.
    pub normal: DVec3,
    /// Offset, in units of `|normal|`.
    pub d: f64,
}

impl Plane {
    /// Returns the half spaces of the points that a camera shows within a rectangle of its picture: four sides, and the
    /// plane through the eye. `corners`: two opposite picture points, see [`PixelRays::ray`].
    pub fn frustum(rays: &PixelRays, corners: [DVec2; 2]) -> [Plane; 5] {
        let ordered = [corners[0].min(corners[1]), corners[0].max(corners[1])];
        rays.half_spaces(ordered).map(|(normal, d)| Plane { normal, d })
    }
}

/// The way a part intersects a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum How {
    /// Some of the part is inside the volume or touches it.
    Intersects = 1,
    /// All of the part is inside.
    Inside = 2,
}

/// A part that intersects a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartOverlap {
    /// The caller's id of the instance.
    pub instance: u64,
    /// The caller's id of the part.
    pub part: u64,
    /// The way the part intersects the volume.
    pub how: How,
}

impl SceneState {
    /// Returns the visible parts that intersect the closed box, by instance in the order added, then by part in the
    /// file's order. An empty box intersects nothing. Blocks; may read the disk. Thread-safe. Fails with `BadArgument`
    /// for NaN.
    pub fn overlap_box(&self, bounds: &DBounds) -> Result<Vec<PartOverlap>> {
        if bounds.min.is_nan() || bounds.max.is_nan() {
            return Err(Error::bad_argument("overlap: the box contains NaN"));
        }
        if bounds.is_empty() {
            return Ok(Vec::new());
        }
        self.overlap(&Volume::Box(*bounds))
    }

    /// Returns the visible parts that intersect the intersection of the half spaces, in the same order. The
    /// intersection is always convex, and should be bounded. Blocks; may read the disk. Thread-safe. Fails with
    /// `BadArgument` if there are no planes, or if one is not finite or has a zero normal.
    pub fn overlap_frustum(&self, planes: &[Plane]) -> Result<Vec<PartOverlap>> {
        let fine = |p: &Plane| p.normal.is_finite() && p.d.is_finite() && p.normal != DVec3::ZERO;
        if planes.is_empty() || !planes.iter().all(fine) {
            return Err(Error::bad_argument(
                "overlap: at least one plane is needed, and all must be finite and have normals that are not zero",
            ));
        }
        self.overlap(&Volume::Planes(planes.to_vec()))
    }

    fn overlap(&self, volume: &Volume) -> Result<Vec<PartOverlap>> {
        let near = |p: &Placed| self.state_of(p.instance).look.visible && volume.may_meet(&p.bounds);
        let mut trees = self.placed_in(Scenes::VISIBLE, |b| volume.may_meet(b)).filter(|&i| near(&self.placed(i)));
        let mut met: BTreeMap<(u64, u32), bool> = BTreeMap::new();
        while let Some(some) = next_trees(&mut trees) {
            let found = sweep(self, &some, Policy::Exact, &|view, visit, left, met: &mut BTreeMap<u32, bool>| {
                meet(view, some[visit], volume, left, met);
                Vec::new()
            })?;
            for (tree, parts) in some.iter().zip(found) {
                for (part, inside) in parts {
                    *met.entry((self.ids_of(*tree).instance, part)).or_insert(true) &= inside;
                }
            }
        }
        self.refute_inside(volume, &mut met)?;
        // A scene in this one may have a part in several places: the first stands for all.
        let mut first: HashMap<(u64, Option<usize>, u32), (u64, u32)> = HashMap::new();
        let mut named: BTreeMap<(u64, u32), bool> = BTreeMap::new();
        for (&(instance, part), &inside) in &met {
            let key = match self.scene_of(instance) {
                None => (instance, part),
                Some(scene) => {
                    let model = self.models.iter().position(|it| it.same(self.model_of_instance(instance)));
                    *first.entry((scene, model, part)).or_insert((instance, part))
                }
            };
            *named.entry(key).or_insert(true) &= inside;
        }
        let answer = |(&(instance, part), &inside): (&(u64, u32), &bool)| {
            let how = if inside { How::Inside } else { How::Intersects };
            let part = self.model_of_instance(instance).parts().id(part as usize)?;
            Some(PartOverlap { instance: self.instance_id(instance), part, how })
        };
        Ok(named.iter().filter_map(answer).collect())
    }

    /// Corrects parts that were found inside. The first sweep skips boxes that are wholly outside, so a part with all
    /// visited triangles inside may have others outside. This sweep searches for those, unless the part's bounds settle
    /// the question.
    fn refute_inside(&self, volume: &Volume, met: &mut BTreeMap<(u64, u32), bool>) -> Result<()> {
        let mut doubtful: BTreeMap<u64, (BTreeSet<u32>, DBounds)> = BTreeMap::new();
        for (&(instance, part), _) in met.iter().filter(|(_, inside)| **inside) {
            let Some(info) = self.model_of_instance(instance).parts().get(part as usize) else { continue };
            let size = info.bounds.extent().max_element() * 1e-6;
            let grown = DBounds { min: info.bounds.min - size, max: info.bounds.max + size };
            let bounds = grown.transformed(&self.world_from_model(instance));
            if !volume.holds(&bounds) {
                let doubt = doubtful.entry(instance).or_insert((BTreeSet::new(), DBounds::EMPTY));
                doubt.0.insert(part);
                doubt.1 = doubt.1.union(bounds);
            }
        }
        let concerned = |p: &Placed| doubtful.get(&p.instance).is_some_and(|d| d.1.overlaps(&p.bounds));
        let around = doubtful.values().fold(DBounds::EMPTY, |all, d| all.union(d.1));
        let mut trees = self.placed_in(Scenes::VISIBLE, |b| around.overlaps(b)).filter(|&i| concerned(&self.placed(i)));
        while let Some(some) = next_trees(&mut trees) {
            let found = sweep(self, &some, Policy::Exact, &|view, visit, left, refuted: &mut BTreeSet<u32>| {
                let (parts, bounds) = &doubtful[&self.ids_of(some[visit]).instance];
                outside(view, some[visit], volume, (parts, bounds), left, refuted);
                Vec::new()
            })?;
            for (tree, refuted) in some.iter().zip(found) {
                for part in refuted {
                    met.insert((self.ids_of(*tree).instance, part), false);
                }
            }
        }
        Ok(())
    }
}

/// Greatest number of placed trees that a sweep visits: each takes memory for its results.
const TREES: usize = 1 << 14;

/// Takes the trees of the next sweep; `None` if there are no more.
fn next_trees(trees: &mut impl Iterator<Item = u64>) -> Option<Vec<u64>> {
    let some: Vec<u64> = trees.take(TREES).collect();
    (!some.is_empty()).then_some(some)
}

/// Finds the parts of a placed tree that intersect the volume, and if all visited triangles of each are inside.
fn meet(view: &SceneView, tree: u64, volume: &Volume, left: &mut Descent, met: &mut BTreeMap<u32, bool>) {
    let placed = view.scene.placed(tree);
    let looks = &view.scene.state_of(placed.instance).parts.looks;
    left.go_on(&view.tree(tree), &mut |b| volume.may_meet(&placed.world_bounds(b)), &mut |_, triangle| {
        let part = placed.first_part.saturating_add(triangle.part);
        // The part is settled: it intersects the volume and is not inside.
        if met.get(&part) == Some(&false) || looks.hides(part) {
            return;
        }
        match volume.side(&world_triangle(&placed, triangle)) {
            Side::Inside => {
                met.entry(part).or_insert(true);
            }
            Side::Crossing => {
                met.insert(part, false);
            }
            // The part is not inside; other triangles decide if it intersects the volume.
            Side::Outside => {
                if let Some(inside) = met.get_mut(&part) {
                    *inside = false;
                }
            }
        }
    });
}

/// Finds those of `parts` that have a triangle in the placed tree outside or across the volume's border.
fn outside(
    view: &SceneView,
    tree: u64,
    volume: &Volume,
    (parts, bounds): (&BTreeSet<u32>, &DBounds),
    left: &mut Descent,
    refuted: &mut BTreeSet<u32>,
) {
    let placed = view.scene.placed(tree);
    left.go_on(
        &view.tree(tree),
        &mut |b| {
            let b = placed.world_bounds(b);
            bounds.overlaps(&b) && !volume.holds(&b)
        },
        &mut |_, triangle| {
            let part = placed.first_part.saturating_add(triangle.part);
            if parts.contains(&part) && volume.side(&world_triangle(&placed, triangle)) != Side::Inside {
                refuted.insert(part);
            }
        },
    );
}

fn world_triangle(placed: &Placed, triangle: &Triangle) -> [DVec3; 3] {
    triangle.vertices.map(|v| placed.world_point(v.as_dvec3()))
}
