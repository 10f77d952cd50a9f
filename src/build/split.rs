//! The division of a mesh into several trees, each with an origin of its own, where single precision relative to one
//! origin would lose the shape of triangles: a bolt on one side of a plain, or a triangle that was left behind at zero.
//!
//! All places with details that the mesh's origin does not resolve are found first (`places`). Then the triangles are
//! distributed over the trees of these places and of the mesh in one pass, so that nothing cracks between them
//! (`owners`). Single small triangles among larger ones stay.

use super::batch::Batch;
use super::edges::Edges;
use super::origin;
use super::owners::{self, Mark, Owners, Pairs};
use super::parts::Assembly;
use super::places::{Around, Places};
use super::resolve::{self, Samples};
use super::shares::Shares;
use super::spool::{Spool, Taken};
use super::survey::TOGETHER;
use crate::base::error::Result;
use crate::base::groups::Groups;
use crate::base::progress::Stretch;
use crate::base::scratch::Scratch;
use crate::math::DBounds;
use crate::store::InstanceRow;
use crate::structure::Par;
use glam::{DAffine3, DVec3};

/// Greatest number of trees of a mesh. The last one takes all triangles that are left.
const MOST_TREES: usize = 256;

/// Approximate number of triangles that decide an origin, or the places of one round.
const SAMPLES: u64 = 4096;

/// Mean number of bits that the samples of a mesh must lose for its origin to leave the middle (`resolve::lost`).
const LEAST_LOST: f64 = 0.25;

/// Greatest number of rounds in which places are searched. (Samples of one round may miss places with few triangles.)
const ROUNDS: usize = 4;

/// Number of passes over a mesh that is divided after one round, for the progress.
pub const PASSES: u64 = 9;

/// Resources of the passes over a mesh.
pub struct Splitter<'a> {
    /// Scratch file of the spilled meshes.
    pub spilled: Option<&'a Scratch>,
    pub shares: &'a Shares,
    pub par: &'a Par,
    /// The progress of these passes, in triangles; stops them once cancelled.
    pub stretch: &'a Stretch<'a>,
}

/// The result of a division.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub struct Found {
    /// Number of trees that were added.
    pub trees: usize,
    /// Number of triangles that no tree resolves.
    pub unresolved: u64,
}

impl Found {
    /// Notes for the user.
    pub fn notes(&self) -> Vec<String> {
        let Self { trees, unresolved } = *self;
        let mut notes = Vec::new();
        if trees > 0 {
            notes.push(format!("the model has details far apart: {trees} more trees keep their precision"));
        }
        if unresolved > 0 {
            notes.push(format!(
                "{unresolved} triangles are so small and so far apart that rounding moves their corners by more than \
                 1/2048 of their size, or drops them as triangles without area"
            ));
        }
        notes
    }
}

/// True if every position is exact relative to the mesh's origin.
fn is_exact(mesh: &Spool) -> bool {
    mesh.is_single && mesh.origin == DVec3::ZERO
}

fn triangles(batch: &Batch) -> impl Iterator<Item = [DVec3; 3]> {
    (0..batch.positions.len()).map(|i| batch.positions.triangle(i))
}

/// The trees of the triangles of a batch, except those that stay as they are.
struct Routes {
    batch: Batch,
    /// Taken from the scratch file, in which it stays.
    was_spilled: Option<Taken>,
    bounds: DBounds,
    routes: Vec<Route>,
    unresolved: u64,
}

/// A tree of a triangle.
struct Route {
    /// Index of the triangle in its batch.
    index: u32,
    tree: u32,
    corners: [DVec3; 3],
    /// Set if another tree counts it: the edges, if both trees have it in the same place.
    copy: Option<Edges>,
    /// Greatest distance between a corner of the input and the stored corner, if any was moved before it was rounded.
    moved: f64,
}

impl Splitter<'_> {
    /// Sets the origins of all meshes. Meshes that are divided get further trees at the end of `meshes`, and instances
    /// of these in `assembly`.
    pub fn run(&self, meshes: &mut Vec<Spool>, assembly: &mut Assembly) -> Result<Found> {
        let mut all = Found::default();
        assembly.placings = Groups::of(meshes.len(), assembly.instances.iter().map(|i| i.tree));
        for index in 0..meshes.len() {
            self.stretch.check()?;
            let mesh = std::mem::replace(&mut meshes[index], Spool::new(0));
            let (trees, unresolved) = self.divide(mesh)?;
            all.unresolved += unresolved;
            all.trees += trees.len() - 1;
            for (i, tree) in trees.into_iter().enumerate() {
                if i == 0 {
                    meshes[index] = tree;
                } else {
                    place(assembly, index as u32, meshes.len() as u32);
                    meshes.push(tree);
                }
            }
        }
        Ok(all)
    }

    /// Divides a mesh into one tree or several. Also returns the number of triangles that their trees do not resolve.
    fn divide(&self, mut mesh: Spool) -> Result<(Vec<Spool>, u64)> {
        self.choose(&mut mesh)?;
        if is_exact(&mesh) {
            return Ok((vec![mesh], 0));
        }
        let unresolved = self.unresolved(&mesh)?;
        if unresolved == 0 {
            return Ok((vec![mesh], 0));
        }
        let (places, details) = self.places(&mesh, unresolved)?;
        if places.len() == 0 {
            return Ok((vec![mesh], unresolved));
        }
        let owners = self.owners(&mesh, &places, details)?;
        self.distribute(mesh, &owners)
    }

    /// Chooses the origin of a mesh.
    fn choose(&self, mesh: &mut Spool) -> Result<()> {
        mesh.origin = origin::choose(&mesh.bounds, mesh.is_single);
        if is_exact(mesh) {
            return Ok(());
        }
        let step = (mesh.triangles / SAMPLES).max(1) as u32;
        let mut samples = Samples::new();
        let sample = |batch: &Batch| {
            let mut here = Samples::new();
            resolve::sample(batch, step, |_| true, &mut here);
            here
        };
        self.each(mesh, sample, |here| {
            samples.extend(here);
            Ok(())
        })?;
        mesh.step = resolve::decimal_step(&samples);
        // A few small triangles do not move the origin.
        if resolve::lost(&samples, mesh.origin) > LEAST_LOST * samples.len() as f64 {
            mesh.origin = resolve::best(&samples, mesh.origin);
        }
        Ok(())
    }

    /// Calls `f` for all batches of a mesh in parallel, and `take` with the results in order.
    fn each<T: Send>(
        &self,
        mesh: &Spool,
        f: impl Fn(&Batch) -> T + Sync + Send,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        for first in (0..mesh.batches()).step_by(TOGETHER) {
            let count = TOGETHER.min(mesh.batches() - first);
            let one = |i: usize| -> Result<T> {
                self.stretch.check()?;
                let batch = mesh.batch(first + i, self.spilled)?;
                self.stretch.did(batch.positions.len() as u64);
                Ok(f(&batch))
            };
            for one in self.par.map(count, one) {
                take(one?)?;
            }
        }
        Ok(())
    }

    /// Counts the triangles that the mesh's origin does not resolve.
    fn unresolved(&self, mesh: &Spool) -> Result<u64> {
        let mut all = 0;
        let count = |batch: &Batch| triangles(batch).filter(|t| !resolve::is_resolved(t, mesh.origin)).count();
        self.each(mesh, count, |count| {
            all += count as u64;
            Ok(())
        })?;
        Ok(all)
    }

    /// Finds the places of a mesh with details, given the number of its unresolved triangles. Also returns the number
    /// of triangles in all details.
    fn places(&self, mesh: &Spool, mut unresolved: u64) -> Result<(Places, u64)> {
        let mut places = Places::new(mesh.origin);
        for _ in 0..ROUNDS {
            let samples = self.samples(mesh, &places, unresolved)?;
            let from = places.len();
            let found = places.find(&samples, MOST_TREES - 1 - from);
            if found == 0 {
                break;
            }
            unresolved = self.surround(mesh, &mut places, from)?;
            if unresolved == 0 {
                break;
            }
        }
        places.group();
        let mut around = vec![Around::default(); places.len()];
        let count = |batch: &Batch| {
            let mut here = vec![Around::default(); places.len()];
            triangles(batch).for_each(|t| places.count(&t, &mut here));
            here
        };
        self.each(mesh, count, |here| {
            around.iter_mut().zip(&here).for_each(|(all, here)| *all = all.and(here));
            Ok(())
        })?;
        places.keep_details(&around);
        Ok((places, around.iter().map(|around| around.moved).sum()))
    }

    /// Samples the triangles that neither the mesh's origin nor a place resolves, given about how many there are.
    fn samples(&self, mesh: &Spool, places: &Places, unresolved: u64) -> Result<Samples> {
        let step = (unresolved / SAMPLES).max(1) as u32;
        let is_unresolved = |t: &[DVec3; 3]| !resolve::is_resolved(t, mesh.origin) && places.resolving(t).is_none();
        let mut samples = Samples::new();
        let sample = |batch: &Batch| {
            let mut here = Samples::new();
            resolve::sample(batch, step, is_unresolved, &mut here);
            here
        };
        self.each(mesh, sample, |here| {
            samples.extend(here);
            Ok(())
        })?;
        Ok(samples)
    }

    /// Sets the bounds of the places behind the first `from`. Returns the number of triangles that no place resolves.
    fn surround(&self, mesh: &Spool, places: &mut Places, from: usize) -> Result<u64> {
        let mut unresolved = 0;
        let mut all = vec![DBounds::EMPTY; places.len()];
        let surround = |batch: &Batch| {
            let (mut here, mut left) = (vec![DBounds::EMPTY; places.len()], 0);
            for t in triangles(batch).filter(|t| !resolve::is_resolved(t, mesh.origin)) {
                match places.resolving(&t) {
                    Some(place) => here[place] = here[place].union(DBounds::of(&t)),
                    None => left += 1,
                }
            }
            (here, left)
        };
        self.each(mesh, surround, |(here, left)| {
            unresolved += left;
            all.iter_mut().zip(here).for_each(|(all, here)| *all = all.union(here));
            Ok(())
        })?;
        all.into_iter().enumerate().skip(from).for_each(|(place, bounds)| places.widen(place, bounds));
        Ok(unresolved)
    }

    /// Finds the trees of the triangles, given the number of those in details.
    fn owners<'p>(&self, mesh: &Spool, places: &'p Places, details: u64) -> Result<Owners<'p>> {
        let mut owners = Owners::new(places)?;
        owners.details = self.pairs(mesh, details, |t, _, marks| {
            if !resolve::is_resolved(t, mesh.origin)
                && let Some(home) = places.home(t)
            {
                owners.detail_marks(t, home, marks);
            }
        })?;
        owners.around = self.pairs(mesh, details, |t, trees, marks| owners.around_marks(t, trees, marks))?;
        owners.shared = self.pairs(mesh, details, |t, trees, marks| owners.shared_marks(t, trees, marks))?;
        Ok(owners)
    }

    /// Returns the marks that `f` adds for the triangles of a mesh. It may use the other vector for anything.
    fn pairs(
        &self,
        mesh: &Spool,
        details: u64,
        f: impl Fn(&[DVec3; 3], &mut Vec<usize>, &mut Vec<Mark>) + Sync + Send,
    ) -> Result<Pairs> {
        let mut pairs = Pairs::of(details, self.shares)?;
        let marks = |batch: &Batch| {
            let (mut trees, mut marks) = (Vec::new(), Vec::new());
            triangles(batch).for_each(|t| f(&t, &mut trees, &mut marks));
            marks
        };
        self.each(mesh, marks, |marks| {
            pairs.insert(&marks);
            Ok(())
        })?;
        Ok(pairs)
    }

    /// Divides a mesh. Batches whose triangles all stay as they are are moved as a whole.
    fn distribute(&self, mesh: Spool, owners: &Owners) -> Result<(Vec<Spool>, u64)> {
        let count = owners.places.len() + 1;
        let mut trees: Vec<Spool> = (0..count).map(|_| Spool::new(mesh.local_parts)).collect();
        trees.iter_mut().enumerate().for_each(|(i, tree)| {
            (tree.origin, tree.step) = (owners.origin(i), mesh.step);
        });
        let is_spilled = mesh.is_spilled();
        let (mut unresolved, mut batches) = (0, mesh.take().into_iter());
        loop {
            // The order of the results does not depend on their number.
            let few: Vec<Taken> = batches.by_ref().take(self.par.threads.min(TOGETHER)).collect();
            if few.is_empty() {
                break;
            }
            for routes in self.par.map_items(few, |taken| self.routes(taken, owners)) {
                let routes = routes?;
                unresolved += routes.unresolved;
                self.follow(routes, &mut trees)?;
            }
        }
        if let (true, Some(to)) = (is_spilled, self.spilled) {
            trees.iter_mut().try_for_each(|tree| tree.spill(to, self.par))?;
        }
        Ok((trees, unresolved))
    }

    /// Finds the trees of the triangles of a batch.
    fn routes(&self, taken: Taken, owners: &Owners) -> Result<Routes> {
        self.stretch.check()?;
        let was_spilled = taken.again();
        let batch = taken.batch(self.spilled)?;
        self.stretch.did(batch.positions.len() as u64);
        let mut found = Routes { was_spilled, bounds: DBounds::EMPTY, routes: Vec::new(), unresolved: 0, batch };
        let mut buffer = Vec::new();
        for (index, t) in triangles(&found.batch).enumerate() {
            if !origin::is_too_large(&t) {
                found.bounds = found.bounds.union(DBounds::of(&t));
            }
            let (first, mut is_resolved) = (found.routes.len(), false);
            owners.put(&t, &mut buffer, |tree, corners| {
                let origin = owners.origin(tree);
                is_resolved |= resolve::is_resolved(&t, origin);
                let moved = if corners == t { 0.0 } else { moved(&t, &corners, origin) };
                let route = Route { index: index as u32, tree: tree as u32, corners, copy: None, moved };
                found.routes.push(route);
            });
            found.unresolved += u64::from(!is_resolved);
            settle(&mut found.routes, first, &t, owners);
        }
        Ok(found)
    }

    /// Adds the triangles of a batch to their trees.
    fn follow(&self, routes: Routes, trees: &mut [Spool]) -> Result<()> {
        let Routes { batch, was_spilled, bounds, routes, .. } = routes;
        if routes.is_empty() {
            return trees[0].push_batch(batch, was_spilled, bounds, self.spilled, self.par);
        }
        let mut routes = routes.into_iter().peekable();
        for i in 0..batch.positions.len() {
            let (part, prim) = (batch.parts[i], batch.prims[i]);
            let value = batch.values.get(i);
            let mut stays = true;
            while let Some(route) = routes.next_if(|route| route.index as usize == i) {
                let tree = &mut trees[route.tree as usize];
                tree.push(&route.corners, part, prim, value)?;
                tree.moved = tree.moved.max(route.moved);
                if let Some(copy) = route.copy {
                    let copies = tree.copies.entry(part).or_default();
                    copies.0 += 1;
                    copies.1.add(copy);
                }
                stays = false;
            }
            if stays {
                trees[0].push(&batch.positions.triangle(i), part, prim, value)?;
            }
        }
        if let Some(to) = self.spilled
            && trees.iter().map(Spool::bytes).sum::<u64>() > self.shares.spool / 2
        {
            trees.iter_mut().try_for_each(|tree| tree.spill(to, self.par))?;
        }
        Ok(())
    }
}

/// Greatest distance between the corners of the input and those that a tree with this origin stores.
fn moved(input: &[DVec3; 3], corners: &[DVec3; 3], origin: DVec3) -> f64 {
    input.iter().zip(corners).fold(0.0, |most, (p, c)| p.distance(owners::stored(*c, origin)).max(most))
}

/// Completes the routes of a triangle, which are those behind the first `from`: drops them if the triangle stays as it
/// is, and those to trees in which rounding makes it a line. One tree counts the triangle; in the others it is a copy.
fn settle(routes: &mut Vec<Route>, from: usize, input: &[DVec3; 3], owners: &Owners) {
    if let [only] = &routes[from..] {
        if only.tree == 0 && only.corners == *input {
            routes.truncate(from);
        }
        return;
    }
    let has_area = |route: &Route| {
        let origin = owners.origin(route.tree as usize);
        origin::has_area(&route.corners.map(|c| (c - origin).as_vec3()))
    };
    let mut kept = routes.split_off(from);
    let areas: Vec<bool> = kept.iter().map(has_area).collect();
    let first = areas.iter().position(|&has| has).unwrap_or(0);
    let mut index = 0..;
    kept.retain(|_| index.next().is_some_and(|i: usize| i == first || areas[i]));
    routes.append(&mut kept);
    let stored = |route: &Route| route.corners.map(|c| owners::stored(c, owners.origin(route.tree as usize)));
    let first = stored(&routes[from]);
    for route in routes.iter_mut().skip(from + 1) {
        let corners = stored(route);
        route.copy = Some(if corners == first { Edges::of(DVec3::ZERO, corners) } else { Edges::NONE });
    }
}

/// Adds instances for what is in `mesh` and has a `tree` of its own.
pub fn place(assembly: &mut Assembly, mesh: u32, tree: u32) {
    if mesh == 0 {
        let world_from_mesh = DAffine3::IDENTITY.to_cols_array();
        assembly.instances.push(InstanceRow { tree, first_part: 0, world_from_mesh });
        return;
    }
    let placed = assembly.placings.get(mesh as usize).iter().map(|&i| &assembly.instances[i as usize]);
    let again: Vec<InstanceRow> = placed.map(|i| InstanceRow { tree, ..*i }).collect();
    assembly.instances.extend(again);
}
