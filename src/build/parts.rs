//! Bounds and counts of parts, mesh by mesh.

use super::edges::Edges;
use super::origin::Placed;
use super::spool::Copies;
use super::survey::OfPart;
use super::tight::Tight;
use crate::base::error::Result;
use crate::base::groups::Groups;
use crate::base::progress::Cancel;
use crate::math::{Bounds, DBounds};
use crate::store::{InstanceRow, MaterialRow, PartRow};
use crate::structure::Par;
use glam::{DAffine3, DVec3, Vec3, Vec4};
use std::collections::BTreeMap;

/// Parts, their materials, and the instances of shared meshes.
#[derive(Default)]
pub struct Assembly {
    pub parts: Vec<PartRow>,
    /// Edges of each part.
    pub edges: Vec<Edges>,
    pub materials: Vec<MaterialRow>,
    pub instances: Vec<InstanceRow>,
    /// The instances of each tree.
    pub placings: Groups,
    /// Bounds of meshes that are placed with a turn.
    pub tight: Tight,
}

/// Number of triangles that one task counts, and number of tasks whose results are kept until they are added up: if
/// neighbouring triangles all belong to different parts, counts take more memory than triangles.
const CHUNK: usize = 1 << 16;
const TOGETHER: usize = 16;

/// Returns bounds, count and edges of each part that has triangles.
pub fn count(placed: &Placed, par: &Par, cancel: &Cancel) -> Result<BTreeMap<u32, OfPart>> {
    let Placed { origin, triangles, parts, .. } = placed;
    let mut all: BTreeMap<u32, OfPart> = BTreeMap::new();
    for (triangles, parts) in triangles.chunks(CHUNK * TOGETHER).zip(parts.chunks(CHUNK * TOGETHER)) {
        let chunks: Vec<_> = triangles.chunks(CHUNK).zip(parts.chunks(CHUNK)).collect();
        let counted = par.map_items(chunks, |(triangles, parts)| -> Result<_> {
            cancel.check()?;
            Ok(count_chunk(*origin, triangles, parts))
        });
        for counted in counted {
            cancel.check()?;
            counted?.into_iter().for_each(|(part, of)| of.add_to(&mut all, part));
        }
    }
    Ok(all)
}

/// Returns the counts without those of triangles that are `copies`.
pub fn but(mut of_parts: BTreeMap<u32, OfPart>, copies: &Copies) -> BTreeMap<u32, OfPart> {
    for (part, (count, edges)) in copies {
        if let Some(of) = of_parts.get_mut(part) {
            of.count = of.count.saturating_sub(*count);
            of.edges.remove(*edges);
        }
    }
    of_parts
}

fn count_chunk(origin: DVec3, triangles: &[[Vec3; 3]], parts: &[u32]) -> BTreeMap<u32, OfPart> {
    let mut all: BTreeMap<u32, OfPart> = BTreeMap::new();
    let mut at = 0;
    // Neighbouring triangles mostly belong to one part.
    for run in parts.chunk_by(|a, b| a == b) {
        let (mut bounds, mut edges) = (Bounds::EMPTY, Edges::NONE);
        for corners in &triangles[at..at + run.len()] {
            bounds = corners.iter().fold(bounds, |b, &p| b.with(p));
            edges.add(Edges::of(origin, corners.map(Vec3::as_dvec3)));
        }
        OfPart { bounds, count: run.len() as u64, edges }.add_to(&mut all, run[0]);
        at += run.len();
    }
    all
}

impl Assembly {
    /// Adds the triangles of a mesh, whose bounds are relative to `origin`. Those of tree 0 are added by part, those of
    /// other trees by local part, for each instance.
    pub fn add(&mut self, tree: usize, origin: DVec3, of_parts: &BTreeMap<u32, OfPart>, cancel: &Cancel) -> Result<()> {
        let Self { parts, edges, instances, placings, tight, .. } = self;
        let mut add = |first: u32, world_from_mesh: &DAffine3| {
            let tight = tight.placed(tree, world_from_mesh);
            for (&part, of) in of_parts {
                cancel.check()?;
                let row = &mut parts[first as usize + part as usize];
                edges[first as usize + part as usize].add(of.edges.placed(world_from_mesh));
                if of.bounds.is_empty() {
                    continue;
                }
                let local = DBounds { min: of.bounds.min.as_dvec3() + origin, max: of.bounds.max.as_dvec3() + origin };
                row.bounds = flat(&unflat(&row.bounds).union(tight(part, local.transformed(world_from_mesh))));
                row.triangles += of.count;
            }
            Ok(())
        };
        if tree == 0 {
            return add(0, &DAffine3::IDENTITY);
        }
        let mut placed = placings.get(tree).iter().map(|&i| &instances[i as usize]);
        placed.try_for_each(|i| add(i.first_part, &DAffine3::from_cols_array(&i.world_from_mesh)))
    }
}

impl Assembly {
    /// Sets the flags of the parts once all meshes are added.
    pub fn flag_closed(&mut self) {
        for (row, edges) in self.parts.iter_mut().zip(&self.edges) {
            row.flags = if row.triangles > 0 { edges.flags() } else { 0 };
        }
    }

    /// Returns the linear colours of a mesh's local parts, with their opacity, as of its first instance.
    pub fn colours(&self, tree: usize, local_parts: u32) -> Vec<Vec4> {
        let placing = self.placings.get(tree).first().map(|&i| &self.instances[i as usize]);
        let first = placing.map_or(0, |i| i.first_part) as usize;
        let rows = self.parts.iter().skip(first).take(local_parts as usize);
        let colour = |row: &PartRow| {
            let material = &self.materials[row.material as usize];
            Vec3::from(material.colour).extend(material.opacity)
        };
        rows.map(colour).collect()
    }
}

/// Returns the bounds of all placed triangles.
pub fn model_bounds(parts: &[PartRow]) -> [f64; 6] {
    flat(&parts.iter().fold(DBounds::EMPTY, |all, part| all.union(unflat(&part.bounds))))
}

fn flat(b: &DBounds) -> [f64; 6] {
    [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z]
}

fn unflat(b: &[f64; 6]) -> DBounds {
    DBounds { min: DVec3::new(b[0], b[1], b[2]), max: DVec3::new(b[3], b[4], b[5]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_parts_do_not_depend_on_threads_or_chunks() {
        let count = CHUNK * (TOGETHER + 1) + 99;
        let at = |i: usize| Vec3::new((i % 977) as f32, (i % 13) as f32 - 6.0, (i / 1000) as f32);
        let triangles: Vec<[Vec3; 3]> = (0..count).map(|i| [at(i), at(i + 1), -at(i / 7)]).collect();
        // Runs of triangles of one part, and single triangles of different parts.
        let parts: Vec<u32> =
            (0..count).map(|i| if i % 5000 < 4000 { (i / 5000) as u32 } else { i as u32 % 7 }).collect();
        let origin = DVec3::new(7.0, 0.5, 0.0);
        let expected = count_chunk(origin, &triangles, &parts);
        let placed = Placed {
            origin,
            triangles,
            parts,
            prims: Vec::new(),
            values: super::super::values::Values::default(),
            fates: Default::default(),
            flat: Default::default(),
        };
        for threads in [1, 2] {
            let found = super::count(&placed, &Par { threads }, &Cancel::new()).unwrap();
            assert!(found.keys().eq(expected.keys()));
            assert!(found.values().zip(expected.values()).all(|(a, b)| a == b));
        }
    }
}
