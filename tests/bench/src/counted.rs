//! What walks do for rays, counted: ray by ray, and in packets where rays are near each other, on the baseline: the
//! same on every machine.

use crate::failure::Failure;
use crate::record::PerRay;
use glam::DVec3;
use outcrop::base::ids::BlockId;
use outcrop::base::progress::Cancel;
use outcrop::math::Ray;
use outcrop::math::{PACKET, first_rays};
use outcrop::residency::{ModelBlocks, Residency, Snapshot};
use outcrop::simd::Isa;
use outcrop::store::ModelFile;
use outcrop::structure::bvh::layout::{EXTERNAL_WORDS, LINE_WORDS, NODE_WORDS};
use outcrop::structure::bvh::trace::TreeView;
use outcrop::structure::bvh::{BvhDecoder, leaves_at};
use outcrop::structure::{Counters, LocalRay, PacketWalk, Walk};
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
        let decoder = BvhDecoder::new(file.header(), file.trees());
        let blocks = ModelBlocks::new(Arc::clone(&file), Box::new(decoder), &Residency::with_budget(u64::MAX))?;
        blocks.fetch(&(0..geometry).map(BlockId).collect::<Vec<_>>(), &Cancel::new())?;
        Ok(Some(Self { file, blocks }))
    }

    /// What is done for each of `rays`, on the mean; `is_any`: until anything is hit.
    pub fn count(&self, rays: &[Ray], is_any: bool) -> PerRay {
        let snapshot = self.blocks.snapshot();
        let view = self.view(&snapshot);
        let (mut walk, mut count) = (Walk::new(), 0);
        for ray in rays.iter().step_by(EVERY) {
            alone(&view, &self.local(ray), is_any, &mut walk);
            count += 1;
        }
        per_ray(&walk.counters, count)
    }

    /// What is done for each of `rays` in packets of neighbours, of what packets do their share; those that cannot go
    /// together go one by one.
    pub fn count_together(&self, rays: &[Ray], is_any: bool) -> PerRay {
        let snapshot = self.blocks.snapshot();
        let view = self.view(&snapshot);
        let (mut packet, mut walk, mut count) = (PacketWalk::of_queries(), Walk::new(), 0);
        for group in rays.chunks(PACKET).step_by(EVERY) {
            let mut local = [LocalRay::NONE; PACKET];
            group.iter().zip(&mut local).for_each(|(ray, local)| *local = self.local(ray));
            packet.begin(&view, &local, first_rays(group.len()));
            if packet.is_coherent(&view, true) {
                // As far as all can go: see `alone`.
                let _ = if is_any {
                    view.any_together(None, &mut packet)
                } else {
                    view.closest_together(None, &mut packet)
                };
            } else {
                local[..group.len()].iter().for_each(|ray| alone(&view, ray, is_any, &mut walk));
            }
            count += group.len();
        }
        let mut all = packet.counters();
        all += walk.counters;
        per_ray(&all, count)
    }

    fn local(&self, ray: &Ray) -> LocalRay {
        let org = (ray.origin - DVec3::from(self.file.trees()[0].origin)).as_vec3();
        LocalRay { org, dir: ray.dir, t_min: ray.t_min as f32, t_max: ray.t_max as f32, cone: ray.cone }
    }

    fn view<'a>(&self, snapshot: &'a Snapshot) -> TreeView<'a> {
        let row = &self.file.trees()[0];
        TreeView {
            snapshot,
            root_block: row.first_block,
            root: row.root,
            max_coord: row.bounds.iter().fold(f32::MIN_POSITIVE, |max_coord, x| max_coord.max(x.abs())),
            leaves_at: leaves_at(row),
            prims_at: self.file.header().geometry_blocks,
            colours_at: None,
            normals_at: None,
            proxies: None,
            isa: Isa::Baseline,
            accept_missing: false,
            ties_by_place: false,
            stamp: 1,
            shown: None,
            stop: &outcrop::structure::NEVER,
            has_members: false,
        }
    }
}

/// Ties ask for primitive ids, which are not here: such a ray is counted up to there.
fn alone(view: &TreeView, ray: &LocalRay, is_any: bool, walk: &mut Walk) {
    walk.begin(view, ray);
    let _ = if is_any { view.any(None, walk) } else { view.closest(None, walk) };
}

fn per_ray(counted: &Counters, rays: usize) -> PerRay {
    let each = |n: u64| n as f64 / rays.max(1) as f64;
    // A node is lines of its own. A reference to another block is found by the header, in two lines more.
    let lines = counted.nodes * (NODE_WORDS / LINE_WORDS) as u64 + counted.leaf_lines + 2 * counted.blocks;
    let words = counted.nodes * NODE_WORDS as u64
        + counted.leaf_lines * LINE_WORDS as u64
        + counted.blocks * (EXTERNAL_WORDS + 1) as u64;
    PerRay {
        nodes: each(counted.nodes),
        leaves: each(counted.leaves),
        triangles: each(counted.triangles),
        blocks: each(counted.blocks),
        bytes: each(4 * words),
        lines: each(lines),
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
        // In packets they share what they visit: of one packet of sixteen one counts.
        let near = tree.count_together(&vec![toward(-1.0); 64], false);
        assert!(
            near.nodes < 0.5 * hits.nodes && near.lines < 0.5 * hits.lines && near.triangles > 0.0,
            "{near:?} {hits:?}"
        );
        assert_eq!(tree.count_together(&vec![toward(2.0); 64], false).nodes, 1.0 / 32.0);
        // Into several octants they go one by one.
        let apart: Vec<Ray> =
            (0..32).map(|i| Ray { dir: if i % 2 == 0 { Vec3::Z } else { -Vec3::Z }, ..toward(-1.0) }).collect();
        assert_eq!(
            tree.count_together(&apart, false).nodes,
            tree.count(&apart[..1], false).nodes * 0.5 + tree.count(&apart[1..2], false).nodes * 0.5
        );
    }
}
