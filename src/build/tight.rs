//! Tight bounds of shared meshes that are placed with a turn.
//!
//! The box around a turned box is larger than the box around its content: a disc that is turned by 45 degrees would get
//! bounds that are 1.41 times too wide. A coordinate of a placed vertex is a linear function of the vertex, given by a
//! row of the placement's matrix, plus a translation. For each mesh, the least and the greatest value of each distinct
//! row are therefore found over the vertices, and give the bounds of all placements. A row with only one component
//! that is not 0 needs no search, because the box gives its exact values.
//!
//! The work of all searched meshes (distinct rows times triangles) is limited to [`MOST`] turned placements per
//! triangle of the model. Meshes with the least work come first. The others, and meshes with very many parts, keep the
//! box around the turned box of each part, which is never too small.

use super::origin;
use super::survey::{Batches, TOGETHER};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::math::DBounds;
use crate::store::InstanceRow;
use crate::structure::Par;
use glam::{DAffine3, DVec3, Vec3};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of distinct turned placements that are searched per triangle of the model.
const MOST: u64 = 8;
/// Maximum number of intervals of a mesh, which has one for each part and row. They take 1 MiB.
const INTERVALS: usize = 1 << 16;
/// Number of triangles that one task searches.
const CHUNK: usize = 1 << 16;
/// Number of triangles that are skipped at once if their box cannot enlarge an interval.
const BLOCK: usize = 64;

/// The searched meshes by the index of their tree.
#[derive(Default)]
pub struct Tight {
    meshes: BTreeMap<usize, Intervals>,
}

/// The values of rows over the vertices of a mesh.
struct Intervals {
    /// Distinct rows, ordered by their bits.
    rows: Vec<DVec3>,
    /// Least and greatest value of each row, for each local part.
    values: Vec<[f64; 2]>,
}

/// Returns the rows of a placement's matrix. Zeros are positive, so that equal rows have equal bits.
fn rows(m: &DAffine3) -> [DVec3; 3] {
    let m = m.matrix3.transpose();
    [m.x_axis, m.y_axis, m.z_axis].map(|row| row + DVec3::ZERO)
}

fn bits(row: &DVec3) -> [u64; 3] {
    row.to_array().map(f64::to_bits)
}

/// True if the value of a row depends on more than one coordinate.
fn is_turned(row: &DVec3) -> bool {
    row.to_array().iter().filter(|x| **x != 0.0).count() > 1
}

/// Returns the value of a row, rounded as in [`DAffine3::transform_point3`].
#[inline]
fn value(row: DVec3, p: DVec3) -> f64 {
    row.x * p.x + row.y * p.y + row.z * p.z
}

impl Tight {
    /// Chooses the meshes that are searched. `meshes`: numbers of triangles and of local parts of each tree.
    pub fn plan(meshes: &[(u64, u32)], instances: &[InstanceRow], cancel: &Cancel) -> Result<Self> {
        let mut found: BTreeMap<usize, BTreeSet<[u64; 3]>> = BTreeMap::new();
        for instance in instances {
            cancel.check()?;
            let turned = rows(&DAffine3::from_cols_array(&instance.world_from_mesh)).into_iter().filter(is_turned);
            let turned: Vec<[u64; 3]> = turned.map(|row| bits(&row)).collect();
            if !turned.is_empty() {
                found.entry(instance.tree as usize).or_default().extend(turned);
            }
        }
        let work = |tree: usize, rows: usize| meshes[tree].0.saturating_mul(rows as u64);
        let mut candidates: Vec<(u64, usize)> =
            found.iter().map(|(&tree, rows)| (work(tree, rows.len()), tree)).collect();
        candidates.sort_unstable();
        let mut left = 3 * MOST * meshes.iter().map(|mesh| mesh.0).sum::<u64>();
        let mut planned = BTreeMap::new();
        for (work, tree) in candidates {
            cancel.check()?;
            let rows = found.remove(&tree).unwrap_or_default();
            let intervals = rows.len().saturating_mul(meshes[tree].1 as usize);
            if work > left || intervals > INTERVALS {
                continue;
            }
            left -= work;
            let rows = rows.into_iter().map(|bits| DVec3::from_array(bits.map(f64::from_bits))).collect();
            planned.insert(tree, Intervals { rows, values: vec![EMPTY; intervals] });
        }
        Ok(Self { meshes: planned })
    }

    /// Searches the triangles of a mesh, which are relative to `origin`.
    pub fn search(
        &mut self,
        tree: usize,
        origin: DVec3,
        (triangles, parts): (&[[Vec3; 3]], &[u32]),
        par: &Par,
        cancel: &Cancel,
    ) -> Result<()> {
        let Some(intervals) = self.meshes.get_mut(&tree) else { return Ok(()) };
        // A few at a time, because each task has its own intervals.
        for (triangles, parts) in triangles.chunks(TOGETHER * CHUNK).zip(parts.chunks(TOGETHER * CHUNK)) {
            let chunks: Vec<_> = triangles.chunks(CHUNK).zip(parts.chunks(CHUNK)).collect();
            let start = &*intervals;
            let found = par.map_items(chunks, |(triangles, parts)| -> Result<Vec<[f64; 2]>> {
                cancel.check()?;
                Ok(start.searched(origin, triangles, parts))
            });
            for values in found {
                intervals.join(values?);
            }
        }
        Ok(())
    }

    /// Searches the kept triangles of a mesh that is built in chunks.
    pub fn search_batches(&mut self, tree: usize, source: &dyn Batches, par: &Par, cancel: &Cancel) -> Result<()> {
        let Some(intervals) = self.meshes.get_mut(&tree) else { return Ok(()) };
        let origin = source.origin();
        for first in (0..source.len()).step_by(TOGETHER) {
            cancel.check()?;
            let start = &*intervals;
            let found = par.map(TOGETHER.min(source.len() - first), |i| -> Result<Vec<[f64; 2]>> {
                let batch = source.batch(first + i)?;
                let (mut triangles, mut parts) = (Vec::new(), Vec::new());
                origin::visit(&batch, origin, |i, triangle| {
                    triangles.push(triangle);
                    parts.push(batch.parts[i]);
                });
                Ok(start.searched(origin, &triangles, &parts))
            });
            for values in found {
                intervals.join(values?);
            }
        }
        Ok(())
    }

    /// Returns a function from a local part, and the box around the box of its placed triangles, to the tight box, for
    /// a placement of mesh `tree`. The mesh must have been searched before, if it was chosen.
    pub fn placed(&self, tree: usize, world_from_mesh: &DAffine3) -> impl Fn(u32, DBounds) -> DBounds {
        let intervals = self.meshes.get(&tree);
        let columns = rows(world_from_mesh).map(|row| {
            let intervals = intervals.filter(|_| is_turned(&row))?;
            intervals.rows.binary_search_by_key(&bits(&row), bits).ok()
        });
        let translation = world_from_mesh.translation;
        move |part, mut around| {
            for (axis, row) in columns.iter().enumerate() {
                let (Some(intervals), Some(row)) = (intervals, row) else { continue };
                let [least, greatest] = intervals.values[part as usize * intervals.rows.len() + row];
                // Products beyond the range of numbers give no interval.
                if least <= greatest {
                    around.min[axis] = around.min[axis].max(least + translation[axis]);
                    around.max[axis] = around.max[axis].min(greatest + translation[axis]);
                }
            }
            around
        }
    }
}

const EMPTY: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

impl Intervals {
    /// Returns the intervals, extended by some triangles.
    fn searched(&self, origin: DVec3, triangles: &[[Vec3; 3]], parts: &[u32]) -> Vec<[f64; 2]> {
        let mut values = self.values.clone();
        let mut at = 0;
        for run in parts.chunk_by(|a, b| a == b) {
            let of_part = &mut values[run[0] as usize * self.rows.len()..][..self.rows.len()];
            for block in triangles[at..at + run.len()].chunks(BLOCK) {
                self.extend(of_part, origin, block.as_flattened());
            }
            at += run.len();
        }
        values
    }

    fn extend(&self, of_part: &mut [[f64; 2]], origin: DVec3, corners: &[Vec3]) {
        let (least, greatest) =
            corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), &p| (a.min(p), b.max(p)));
        let (least, greatest) = (least.as_dvec3() + origin, greatest.as_dvec3() + origin);
        let (middle, half) = (least * 0.5 + greatest * 0.5, greatest * 0.5 - least * 0.5);
        for (row, interval) in self.rows.iter().zip(of_part) {
            // The values in the box, with a margin that is much larger than the rounding errors.
            let rounding = 1e-14 * value(row.abs(), least.abs().max(greatest.abs()));
            let (at, reach) = (value(*row, middle), value(row.abs(), half) + rounding);
            if at - reach >= interval[0] && at + reach <= interval[1] {
                continue;
            }
            for &corner in corners {
                let value = value(*row, corner.as_dvec3() + origin);
                *interval = [interval[0].min(value), interval[1].max(value)];
            }
        }
    }

    fn join(&mut self, values: Vec<[f64; 2]>) {
        for (all, found) in self.values.iter_mut().zip(values) {
            *all = [all[0].min(found[0]), all[1].max(found[1])];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat};

    fn instance(tree: u32, m: DAffine3) -> InstanceRow {
        InstanceRow { tree, first_part: 0, world_from_mesh: m.to_cols_array() }
    }

    fn planned(meshes: &[(u64, u32)], instances: &[InstanceRow]) -> Tight {
        Tight::plan(meshes, instances, &Cancel::new()).expect("not cancelled")
    }

    #[test]
    fn a_cancel_ends_the_plan_and_the_search() {
        let cancel = Cancel::new();
        let instances = [instance(0, DAffine3::from_quat(DQuat::from_rotation_z(0.7)))];
        let mut tight = planned(&[(1, 1)], &instances);
        cancel.cancel();
        assert!(Tight::plan(&[(1, 1)], &instances, &cancel).is_err());
        let all = (&[[Vec3::ONE; 3]][..], &[0][..]);
        assert!(tight.search(0, DVec3::ZERO, all, &Par { threads: 1 }, &cancel).is_err());
    }

    /// Returns a random number in [-1, 1).
    fn next(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    #[test]
    fn intervals_give_the_bounds_of_the_transformed_vertices() {
        let mut seed = 7;
        let origin = DVec3::new(1e6, -3.0, 77.0);
        let count = CHUNK + 1000;
        let mut point = || Vec3::from([0; 3].map(|_| next(&mut seed) as f32)).normalize();
        let triangles: Vec<[Vec3; 3]> = (0..count).map(|_| [point(), point(), point()]).collect();
        let parts: Vec<u32> = (0..count as u32).map(|i| i / 700 % 3).collect();
        let turn = DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(-0.3);
        let placements = [
            DAffine3::from_scale_rotation_translation(DVec3::new(1.0, 2.0, -3.0), turn, DVec3::new(5.0, 6.0, -1e5)),
            DAffine3::from_quat(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4)),
            DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 2.0, 1.0))),
        ];
        let instances: Vec<_> = placements.iter().map(|m| instance(1, *m)).collect();
        for threads in [1, 2] {
            let cancel = Cancel::new();
            let mut tight = Tight::plan(&[(0, 1), (count as u64, 3)], &instances, &cancel).expect("not cancelled");
            let searched = tight.search(1, origin, (&triangles, &parts), &Par { threads }, &cancel);
            searched.expect("not cancelled");
            for (m, part) in placements.iter().flat_map(|m| (0..3).map(move |part| (m, part))) {
                let corners = triangles.iter().zip(&parts).filter(|(_, p)| **p == part).flat_map(|(t, _)| t);
                let (mut expected, mut local) = (DBounds::EMPTY, DBounds::EMPTY);
                for corner in corners.map(|c| c.as_dvec3() + origin) {
                    (expected, local) = (expected.with(m.transform_point3(corner)), local.with(corner));
                }
                assert_eq!(tight.placed(1, m)(part, local.transformed(m)), expected, "{m:?} {part}");
            }
        }
    }

    #[test]
    fn the_work_is_limited_to_a_multiple_of_the_triangles() {
        let turned = |i: u32| DAffine3::from_quat(DQuat::from_rotation_z(0.01 + 0.01 * f64::from(i)));
        // Each placement has two distinct rows with two components; the third one is an axis.
        let plan = |triangles: &[u64], placements: &[u32]| {
            let meshes: Vec<_> = triangles.iter().map(|&n| (n, 1)).collect();
            let places = (1..).zip(placements).flat_map(|(tree, &n)| (0..n).map(move |i| instance(tree, turned(i))));
            planned(&meshes, &places.collect::<Vec<_>>()).meshes.into_keys().collect::<Vec<_>>()
        };
        assert_eq!(plan(&[0, 100], &[12]), [1]);
        assert_eq!(plan(&[0, 100], &[13]), [] as [usize; 0]);
        assert_eq!(plan(&[100, 100], &[24]), [1]);
        // The meshes with the least work come first.
        assert_eq!(plan(&[0, 100, 100], &[20, 5]), [2]);
        assert_eq!(plan(&[0, 100, 100], &[19, 5]), [1, 2]);
        // Equal turns count once, moves and mirrored axes do not count.
        let places = [turned(3), DAffine3::from_translation(DVec3::X) * turned(3), DAffine3::from_scale(-DVec3::ONE)];
        let instances: Vec<_> = places.iter().cycle().take(300).map(|m| instance(1, *m)).collect();
        assert_eq!(planned(&[(0, 1), (9, 1)], &instances).meshes[&1].rows.len(), 2);
        assert!(planned(&[(0, 1), (9, 1)], &instances[2..3]).meshes.is_empty());
        // Too many intervals.
        assert!(planned(&[(0, 1), (9, 40_000)], &instances).meshes.is_empty());
    }
}
