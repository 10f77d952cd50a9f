//! What walks do for rays, counted. Ray by ray, on the baseline: figures of rays, the same on every machine, whatever goes together
//! when times are taken.

use crate::failure::Failure;
use crate::record::PerRay;
use glam::DVec3;
use outcrop::base::ids::BlockId;
use outcrop::base::progress::Cancel;
use outcrop::math::Ray;
use outcrop::residency::{ModelBlocks, Residency};
use outcrop::simd::Isa;
use outcrop::store::ModelFile;
use outcrop::structure::bvh::trace::{LocalRay, Outcome, TreeView, Walk};
use outcrop::structure::bvh::layout::{EXTERNAL_WORDS, LINE_WORDS, NODE_WORDS};
use outcrop::structure::bvh::{BvhDecoder, leaves_at};
use std::path::Path;
use std::sync::Arc;

/// One ray of so many is counted.
const EVERY: usize = 16;

/// The tree of a model that has one, all in memory.
pub struct OneTree {
    file: Arc<ModelFile>,
    blocks: ModelBlocks,
}

impl OneTree {
    /// `None` for a model of several trees, or of none: which of them a ray visits is the scene's business.
    pub fn of(path: &Path) -> Result<Option<Self>, Failure> {
        let file = Arc::new(ModelFile::open_path(path)?);
        if file.trees().len() != 1 || !file.instances().is_empty() || file.trees()[0].block_count == 0 {
            return Ok(None);
        }
        let geometry = file.header().geometry_blocks;
        let decoder = BvhDecoder::new(geometry, file.trees());
        let blocks = ModelBlocks::new(Arc::clone(&file), Box::new(decoder), &Residency::with_budget(u64::MAX))?;
        blocks.fetch(&(0..geometry).map(BlockId).collect::<Vec<_>>(), &Cancel::new())?;
        Ok(Some(Self { file, blocks }))
    }

    /// What is done for each of `rays`, on the mean; `is_any`: until anything is hit.
    pub fn count(&self, rays: &[Ray], is_any: bool) -> PerRay {
        let row = &self.file.trees()[0];
        let snapshot = self.blocks.snapshot();
        let view = TreeView {
            snapshot: &snapshot,
            root_block: row.first_block,
            root: row.root as u32,
            reach: row.bounds.iter().fold(f32::MIN_POSITIVE, |reach, x| reach.max(x.abs())),
            leaves_at: leaves_at(row),
            prims_at: self.file.header().geometry_blocks,
            colours_at: None,
            isa: Isa::Baseline,
            never_waits: false,
            is_solid: false,
            stamp: 1,
        };
        let (mut walk, mut count) = (Walk::new(), 0);
        for ray in rays.iter().step_by(EVERY) {
            let org = (ray.origin - DVec3::from(row.origin)).as_vec3();
            walk.begin(&view, &LocalRay { org, dir: ray.dir, t_min: ray.t_min as f32, t_max: ray.t_max as f32, cone: ray.cone });
            let ended = if is_any { view.any(None, &mut walk) } else { view.closest(None, &mut walk) };
            // Ties ask for primitive ids, which are not here: such a ray is counted up to there.
            debug_assert!(matches!(ended, Outcome::Done | Outcome::Pending(_)));
            count += 1;
        }
        let each = |n: u64| n as f64 / f64::from(count.max(1));
        let counted = walk.counters;
        // A node is lines of its own. A reference to another block is found by the header, in two lines more.
        let lines = counted.nodes * (NODE_WORDS / LINE_WORDS) as u64 + counted.leaf_lines + 2 * counted.blocks;
        let words = counted.nodes * NODE_WORDS as u64 + counted.leaf_lines * LINE_WORDS as u64 + counted.blocks * (EXTERNAL_WORDS + 1) as u64;
        PerRay {
            nodes: each(counted.nodes),
            leaves: each(counted.leaves),
            triangles: each(counted.triangles),
            blocks: each(counted.blocks),
            bytes: each(4 * words),
            lines: each(lines),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::built::{self, Part};
    use crate::common::scenes;
    use glam::Vec3;

    #[test]
    fn rays_that_pass_visit_less_than_rays_that_hit() {
        let built = built::parts(&[Part::white(1, scenes::cuboid(DVec3::ZERO, DVec3::ONE))]);
        let tree = OneTree::of(&built.path).expect("it opens").expect("it has one tree");
        let toward = |z: f64| Ray::new(DVec3::new(0.3, 0.4, z), Vec3::Z);
        // One of sixteen counts.
        let hits = tree.count(&vec![toward(-1.0); 32], false);
        assert!(hits.nodes >= 1.0 && hits.leaves >= 1.0 && (1.0..=12.0).contains(&hits.triangles), "{hits:?}");
        assert_eq!(tree.count(&vec![toward(-1.0); 160], false), hits);
        let any = tree.count(&vec![toward(-1.0); 32], true);
        assert!(any.triangles <= hits.triangles && any.triangles >= 1.0, "{any:?}");
        let passes = tree.count(&vec![toward(2.0); 32], false);
        assert_eq!((passes.nodes, passes.triangles, passes.lines, passes.bytes), (1.0, 0.0, 2.0, 128.0));
        assert!(hits.lines > 2.0 && hits.bytes > 128.0, "{hits:?}");
    }
}
