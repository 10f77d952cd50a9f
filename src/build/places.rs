//! Places of a mesh with details that its origin does not resolve. Each gets a tree with its own origin (`split`).

use super::resolve::{self, Samples};
use crate::math::DBounds;
use glam::DVec3;
use std::cmp::Reverse;

/// So many small triangles are a detail even if more larger ones cross the box around them.
const MANY: u64 = 64;

/// Number of places in a group whose boxes are tested at once.
const GROUP: usize = 16;

/// A place with details.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// The origin of its tree.
    pub origin: DVec3,
    /// Bounds of the triangles that this origin resolves and that of the mesh does not.
    pub bounds: DBounds,
}

/// Numbers of triangles in and around a place.
#[derive(Debug, Clone, Copy, Default)]
pub struct Around {
    /// Triangles that the place resolves and the mesh's origin does not.
    pub moved: u64,
    /// Other triangles with a corner in the bounds.
    pub touching: u64,
    /// Other triangles that cross the bounds.
    pub crossing: u64,
}

impl Around {
    /// The sums of both.
    pub fn and(self, o: &Self) -> Self {
        Self { moved: self.moved + o.moved, touching: self.touching + o.touching, crossing: self.crossing + o.crossing }
    }

    /// True if the triangles are a detail. Small triangles among many larger ones, as scans and CAD exports have them,
    /// are none.
    fn is_detail(&self) -> bool {
        self.moved > 0 && 4 * self.moved >= self.touching && (self.moved >= MANY || self.moved >= self.crossing)
    }
}

/// The places of a mesh.
pub struct Places {
    /// The origin of the mesh.
    pub origin: DVec3,
    all: Vec<Place>,
    /// Bounds of each [`GROUP`] places.
    groups: Vec<DBounds>,
}

impl Places {
    /// No places, in a mesh with this origin.
    pub fn new(origin: DVec3) -> Self {
        Self { origin, all: Vec::new(), groups: Vec::new() }
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Place `index`.
    pub fn place(&self, index: usize) -> &Place {
        &self.all[index]
    }

    /// Adds places, which have no bounds yet, for the origins that resolve the samples; at most `most`. Returns their
    /// number.
    pub fn find(&mut self, samples: &Samples, most: usize) -> usize {
        let mut found = origins(samples);
        found.truncate(most);
        self.all.extend(found.iter().map(|&origin| Place { origin, bounds: DBounds::EMPTY }));
        found.len()
    }

    /// The first place that resolves a triangle.
    pub fn resolving(&self, corners: &[DVec3; 3]) -> Option<usize> {
        self.all.iter().position(|place| resolve::is_near(corners, place.origin))
    }

    /// Widens the bounds of a place.
    pub fn widen(&mut self, index: usize, by: DBounds) {
        self.all[index].bounds = self.all[index].bounds.union(by);
    }

    /// Keeps the places that are details, and sorts them so that groups are small.
    pub fn keep_details(&mut self, around: &[Around]) {
        let mut at = around.iter();
        self.all.retain(|_| at.next().is_some_and(Around::is_detail));
        self.all.sort_by(|a, b| a.origin.x.total_cmp(&b.origin.x));
        self.all.chunks_mut(4 * GROUP).for_each(|few| few.sort_by(|a, b| a.origin.y.total_cmp(&b.origin.y)));
        self.group();
    }

    /// Sets the bounds of the groups.
    pub fn group(&mut self) {
        let bounds = |few: &[Place]| few.iter().fold(DBounds::EMPTY, |all, place| all.union(place.bounds));
        self.groups = self.all.chunks(GROUP).map(bounds).collect();
    }

    /// Calls `f` with the places whose bounds overlap a box. The groups must be set.
    pub fn overlapping(&self, bounds: &DBounds, mut f: impl FnMut(usize, &Place)) {
        for (g, few) in self.all.chunks(GROUP).enumerate() {
            if self.groups[g].overlaps(bounds) {
                let those = few.iter().enumerate().filter(|(_, place)| place.bounds.overlaps(bounds));
                those.for_each(|(i, place)| f(g * GROUP + i, place));
            }
        }
    }

    /// The place that has an unresolved triangle as a detail. The groups must be set.
    pub fn home(&self, corners: &[DVec3; 3]) -> Option<usize> {
        let (bounds, mut home) = (DBounds::of(corners), None);
        self.overlapping(&bounds, |index, place| {
            if home.is_none() && place.bounds.contains(&bounds) && resolve::is_near(corners, place.origin) {
                home = Some(index);
            }
        });
        home
    }

    /// Counts a triangle at the places around it. The groups must be set.
    pub fn count(&self, corners: &[DVec3; 3], around: &mut [Around]) {
        let is_resolved = resolve::is_resolved(corners, self.origin);
        let home = if is_resolved { None } else { self.home(corners) };
        if let Some(home) = home {
            around[home].moved += 1;
        }
        self.overlapping(&DBounds::of(corners), |index, place| {
            if home != Some(index) {
                let has_corner = corners.iter().any(|&c| place.bounds.contains(&DBounds::of(&[c])));
                around[index].touching += u64::from(has_corner);
                around[index].crossing += u64::from(crosses(corners, &place.bounds));
            }
        });
    }
}

/// Origins that resolve the samples, first those that resolve the most. (Origins near the smallest triangles resolve
/// the larger ones around these too.)
fn origins(samples: &Samples) -> Vec<DVec3> {
    let mut left: Vec<(f64, &[DVec3; 3])> = samples.iter().map(|t| (resolve::size(t), t)).collect();
    left.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found = Vec::new();
    while let Some((_, smallest)) = left.first() {
        let (origin, before) = (resolve::near(smallest), left.len());
        left.retain(|(_, t)| !resolve::is_near(t, origin));
        match before - left.len() {
            // Too thin for any origin.
            0 => drop(left.remove(0)),
            count => found.push((count, origin)),
        }
    }
    found.sort_by_key(|(count, _)| Reverse(*count));
    found.into_iter().map(|(_, origin)| origin).collect()
}

/// True if a triangle and a box share a point.
///
/// Source: Akenine-Möller, "Fast 3D Triangle-Box Overlap Testing", Journal of Graphics Tools 6(1), 2001.
pub fn crosses(corners: &[DVec3; 3], bounds: &DBounds) -> bool {
    if !bounds.overlaps(&DBounds::of(corners)) {
        return false;
    }
    let (middle, half) = (bounds.center(), bounds.extent() * 0.5);
    let [a, b, c] = corners.map(|p| p - middle);
    let is_apart = |axis: DVec3| {
        let (at, reach) = ([a, b, c].map(|p| p.dot(axis)), half.dot(axis.abs()));
        at.iter().all(|&at| at > reach) || at.iter().all(|&at| at < -reach)
    };
    let edges = [b - a, c - b, a - c];
    let axes = edges.iter().flat_map(|&edge| DVec3::AXES.map(|axis| axis.cross(edge)));
    !is_apart(edges[0].cross(edges[1])) && !axes.into_iter().any(is_apart)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A right triangle with legs of `size`.
    fn triangle(at: DVec3, size: f64) -> [DVec3; 3] {
        [at, at + DVec3::X * size, at + DVec3::Y * size]
    }

    #[test]
    fn every_detail_has_an_origin() {
        let at = |i: i32| DVec3::new(f64::from(i % 20) * 5e3 + 0.123, f64::from(i / 20) * 5e3 + 0.456, 0.0);
        let mut samples: Samples = (0..400).map(|i| triangle(at(i), 0.001)).collect();
        // Some more at one of them.
        samples.extend((0..9).map(|i| triangle(at(77) + DVec3::X * f64::from(i), 0.1)));
        let found = origins(&samples);
        assert_eq!(found.len(), 400);
        assert!(samples.iter().all(|t| found.iter().any(|&origin| resolve::is_resolved(t, origin))));
        assert!(found[0].distance(at(77)) < 1.0, "the one with the most samples is first: {}", found[0]);
        assert_eq!(origins(&Samples::new()), Vec::new());
    }

    #[test]
    fn a_triangle_crosses_a_box_or_passes_by() {
        let bounds = DBounds { min: DVec3::ZERO, max: DVec3::ONE };
        let across = |z: f64| [DVec3::new(-50.0, -50.0, z), DVec3::new(90.0, -50.0, z), DVec3::new(-50.0, 90.0, z)];
        assert!(crosses(&across(0.5), &bounds) && crosses(&across(1.0), &bounds));
        assert!(!crosses(&across(1.1), &bounds));
        // A slope whose bounds contain the box.
        let slope = |z: f64| {
            [DVec3::new(-50.0, -50.0, -50.0 + z), DVec3::new(50.0, -50.0, -50.0 + z), DVec3::new(0.0, 50.0, 50.0 + z)]
        };
        assert!(crosses(&slope(0.0), &bounds) && !crosses(&slope(3.0), &bounds) && !crosses(&slope(-3.0), &bounds));
        // Beside a corner of the triangle.
        assert!(!crosses(&[DVec3::new(0.9, 2.0, 0.5), DVec3::new(2.0, 0.9, 0.5), DVec3::new(3.0, 3.0, 0.5)], &bounds));
    }

    #[test]
    fn places_are_found_by_their_boxes() {
        let at = |i: usize| DVec3::new((i % 17) as f64, (i / 17) as f64, 0.0) * 1e4;
        let mut places = Places::new(DVec3::ZERO);
        for i in 0..200 {
            let bounds = DBounds { min: at(i), max: at(i) + 0.01 };
            places.all.push(Place { origin: at(i), bounds });
        }
        places.keep_details(&[Around { moved: 1, ..Around::default() }; 200]);
        for i in 0..200 {
            let mut found = Vec::new();
            places.overlapping(&DBounds::of(&[at(i) + 0.005]), |index, place| found.push((index, place.origin)));
            assert_eq!(found.len(), 1);
            assert_eq!((found[0].1, places.place(found[0].0).origin), (at(i), at(i)));
            assert_eq!(places.home(&triangle(at(i), 0.002)), Some(found[0].0));
        }
        assert_eq!(places.home(&triangle(at(3) + 7.0, 0.002)), None);
    }
}
