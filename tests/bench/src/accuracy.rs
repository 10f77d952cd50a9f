//! How far answers are off exact ones, ray by ray, and whether exact ones are what the oracle finds.

use crate::common::brute::{Oracle, Ray64};
use crate::common::bvh64::Bvh64;
use crate::common::errors::{Answer as Judged, Judge, Summary, Verdict};
use crate::common::picture;
use crate::common::promise::slack;
use crate::common::rounding::Rounding;
use crate::common::stored;
use crate::failure::{Failure, Outcome};
use crate::rays::Batch;
use crate::record::Accuracy;
use crate::sides::Answer;
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind};
use std::path::Path;

/// Rays of each kind that the oracle looks at.
const SAMPLE: usize = 2000;

/// More rays than one in so many that a peer answers otherwise are no matter of rounding.
const PEER_DIFFERS: f64 = 0.002;

/// Of rays with the footprint of a pixel.
pub fn of_rays(rays: &[Ray], seen: &[Answer], truth: &[Answer]) -> Accuracy {
    assert!(rays.len() == seen.len() && rays.len() == truth.len(), "answers of the same rays are compared");
    let ways = |all: &[Answer]| -> Vec<f64> { all.iter().map(|a| a.t).collect() };
    let width = |i: usize, t: f64| f64::from(rays[i].cone.a + rays[i].cone.b * t as f32);
    let (off, otherwise) = picture::along_rays(&ways(seen), &ways(truth), width);
    let depths = |all: &[Answer]| -> Vec<f32> { all.iter().map(|a| a.t as f32).collect() };
    Accuracy { otherwise: Some(otherwise), ..of_depths(off, &depths(seen), &depths(truth)) }
}

/// Of pictures: errors that were worked out, and what depths say of coverage.
pub fn of_depths(off: picture::Spread, seen: &[f32], truth: &[f32]) -> Accuracy {
    let silhouette = picture::silhouette(seen, truth);
    let covered = |all: &[f32]| all.iter().map(|d| f64::from(u8::from(picture::is_covered(*d)))).collect::<Vec<_>>();
    Accuracy {
        mean_px: off.mean,
        p95_px: off.p95,
        p999_px: off.p999,
        worst_px: off.worst,
        overlap: silhouette.overlap,
        coverage: picture::coverage_ratio(covered(seen), covered(truth)),
        differ: (silhouette.lost + silhouette.added) as f64 / truth.len().max(1) as f64,
        ..Accuracy::default()
    }
}

/// Fails if a peer's hits are not ours but for what rounding explains.
pub fn assert_peer_agrees(who: &str, accuracy: &Accuracy, rays: &[Ray], seen: &[Answer], truth: &[Answer]) -> Outcome {
    let far = |(a, b): &(&Answer, &Answer)| a.is_hit() && b.is_hit() && (a.t - b.t).abs() > 1e-3 * b.t.max(1e-6);
    let far = seen.iter().zip(truth).filter(far).count() as f64 / rays.len().max(1) as f64;
    if accuracy.differ + far <= PEER_DIFFERS {
        return Ok(());
    }
    let percent = 100.0 * (accuracy.differ + far);
    Err(Failure::new(format!("{who}: wrong answers: {percent:.2} % of the rays end elsewhere than ours")))
}

/// A ray ends at the same place in a scene of many trees and in the flattened one if its ends are no farther apart than
/// this share of its length and of its origin's distance from zero together: corners are rounded to a share of where
/// they are.
const SAME: f64 = 1e-4;

/// How the exact answers of a scene of many trees are those of the flattened one. Transformed corners are rounded
/// otherwise there, so the answers are not the same bits: more rays that differ than [`PEER_DIFFERS`] are a failure.
pub fn compare_flattened(id: &str, rays: &[Ray], placed: &[Answer], flattened: &[Answer]) -> Outcome {
    let (mut one_sided, mut apart) = (0, 0);
    for ((ray, a), b) in rays.iter().zip(placed).zip(flattened) {
        one_sided += usize::from(a.is_hit() != b.is_hit());
        apart += usize::from(a.is_hit() && b.is_hit() && (a.t - b.t).abs() > SAME * (b.t + ray.origin.length()));
    }
    let (rays, share) = (rays.len(), (one_sided + apart) as f64 / placed.len().max(1) as f64);
    let [ours, theirs] = [placed, flattened].map(|all| all.iter().filter(|a| a.is_hit()).count());
    let text = format!(
        "{ours} hits, {theirs} flattened; {one_sided} rays hit in one only, {apart} end farther apart than rounding explains, of {rays}"
    );
    eprintln!("{id}: {text}");
    if share > PEER_DIFFERS {
        Err(Failure::new(format!("{id}: the flattened scene answers otherwise: {text}")))
    } else {
        Ok(())
    }
}

/// The f64 oracle over what a model stores, and its judge.
pub struct Truth {
    tree: stored::StoredTree,
    oracle: Bvh64,
}

impl Truth {
    /// Of a model of one tree.
    pub fn of(path: &Path) -> Result<Self, Failure> {
        let mut trees = stored::trees(path);
        if trees.len() != 1 {
            return Err(Failure::new(format!("{}: {} trees, where the oracle takes one", path.display(), trees.len())));
        }
        let tree = trees.swap_remove(0);
        let oracle = Bvh64::new(tree.corners());
        Ok(Self { tree, oracle })
    }

    /// Its judge: it takes as long to make as the oracle.
    pub fn judge(&self) -> Judge<'_> {
        Judge::new(&self.oracle, Rounding::LOCALISED)
    }

    /// The median slack (`tests/common/promise.rs`) of a sample of hits that stand in; none where none does. Fails
    /// where the promise is broken.
    pub fn slack(&self, id: &str, hits: &[Hit]) -> Result<Option<f64>, Failure> {
        let stand_ins: Vec<&Hit> = hits.iter().filter(|hit| hit.kind == HitKind::Lod).collect();
        let mut all = Vec::new();
        for hit in stand_ins.iter().step_by(stand_ins.len().div_ceil(SAMPLE).max(1)) {
            let slack = slack(&self.oracle, hit.position - self.tree.origin, hit.error.into());
            let broken = |truth| {
                Failure::new(format!("{id}: a hit states {} and is {truth} from any surface: {hit:?}", hit.error))
            };
            all.push(slack.map_err(broken)?);
        }
        all.sort_by(f64::total_cmp);
        Ok(all.get(all.len() / 2).copied())
    }

    /// Judges a sample of exact answers (`tests/common/errors.rs`); fails with the first ones that are wrong. Of shadow
    /// rays it takes whether they hit.
    pub fn check(&self, judge: &Judge, id: &str, batch: &Batch, hits: &[Hit]) -> Outcome {
        let mut summary = Summary::default();
        let mut wrong = Vec::new();
        let stride = batch.rays.len().div_ceil(SAMPLE).max(1);
        for (ray, hit) in batch.rays.iter().zip(hits).step_by(stride) {
            let org = ray.origin - self.tree.origin;
            let local = Ray64 { org, dir: ray.dir.as_dvec3(), t_min: ray.t_min, t_max: ray.t_max };
            let verdict = if batch.is_any() {
                judge.any(&local, self.oracle.any(&local), hit.kind != HitKind::Miss)
            } else {
                judge.closest(&local, self.oracle.closest(&local), self.judged(hit)).verdict
            };
            summary.add_verdict(batch.kind.name(), verdict, || format!("{ray:?}: {hit:?}"));
            if let (Verdict::Wrong(why), true) = (verdict, wrong.len() < 3) {
                wrong.push(format!("{why:?}: {ray:?}: {hit:?}"));
            }
        }
        match wrong.is_empty() {
            true => Ok(()),
            false => {
                Err(Failure::new(format!("{id}: the oracle finds wrong answers\n{}\n{summary}", wrong.join("\n"))))
            }
        }
    }

    fn judged(&self, hit: &Hit) -> Option<Judged> {
        let position_error = self.tree.position_error;
        (hit.kind != HitKind::Miss).then(|| Judged {
            t: hit.t,
            prim: self.tree.index_of(hit.prim).unwrap_or(u32::MAX),
            stated: Some(f64::from(hit.error) - position_error),
            normal: Some(hit.normal.as_dvec3()),
            part_right: true,
            refined: true,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};
    use outcrop::math::Cone;

    #[test]
    fn errors_are_in_widths_of_a_pixels_ray() {
        let ray = Ray { cone: Cone { a: 0.0, b: 0.01 }, ..Ray::new(DVec3::ZERO, Vec3::X) };
        let answers = |all: [f64; 4]| all.map(|t| Answer { t });
        let far = f64::INFINITY;
        let (seen, truth) = (answers([11.0, 10.0, far, 5.0]), answers([10.0, 10.0, 10.0, far]));
        let accuracy = of_rays(&[ray; 4], &seen, &truth);
        assert!((accuracy.worst_px - 10.0).abs() < 1e-6 && (accuracy.mean_px - 5.0).abs() < 1e-6, "{accuracy:?}");
        assert_eq!((accuracy.overlap, accuracy.coverage, accuracy.differ), (0.5, 1.0, 0.5));
        // One is ten pixels off, one is lost, one is added.
        assert_eq!(accuracy.otherwise, Some(0.75));
        assert!(assert_peer_agrees("x", &accuracy, &[ray; 4], &seen, &truth).is_err());
        let same = of_rays(&[ray; 4], &truth, &truth);
        assert_eq!((same.mean_px, same.overlap, same.differ), (0.0, 1.0, 0.0));
        assert!(assert_peer_agrees("x", &same, &[ray; 4], &truth, &truth).is_ok());
        assert!(compare_flattened("x", &[ray; 4], &seen, &truth).is_err());
        assert!(compare_flattened("x", &[ray; 4], &answers([10.0001, 10.0, 10.0, far]), &truth).is_ok());
    }
}
