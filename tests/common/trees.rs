//! Trees under test: built in memory by the structure room alone, with any blocks missing.

use super::brute::{Ray64, Tri};
use super::rays::Ray32;
use glam::{DVec3, Vec3};
use outcrop::base::ids::BlockId;
use outcrop::base::progress::{Cancel, Progress, Stretch};
use outcrop::math::{PACKET, STREAM, first_rays};
use outcrop::residency::{Slot, Snapshot};
use outcrop::simd::Isa;
use outcrop::structure::Par;
use outcrop::structure::Stream;
use outcrop::structure::bake::{TreeInput, TreeOptions};
use outcrop::structure::bvh::build::{self, Chunk, TreeBlock, UpperTree};
use outcrop::structure::bvh::trace::TreeView;
use outcrop::structure::{Blocks, LocalRay, Outcome, PacketWalk, Tree, TriHit, Walk, for_each_triangle};

/// A tree with all its blocks, and the triangles that it holds.
pub struct TestTree {
    pub snapshot: Snapshot,
    root: u32,
    leaves_at: u32,
    geometry: u32,
    /// Greatest coordinate.
    pub max_coord: f32,
    /// By primitive: the stored corners, around the origin.
    pub stored: Vec<Tri>,
    /// What the origin was.
    pub origin: DVec3,
    /// References to triangles; more than triangles with splits.
    pub references: usize,
}

/// The instruction sets that this machine has; says which it lacks.
pub fn isas() -> Vec<Isa> {
    let lacking = Isa::ALL.iter().filter(|i| !i.is_available());
    lacking.for_each(|i| println!("skipped: {} (not on this machine)", i.name()));
    Isa::ALL.into_iter().filter(|i| i.is_available()).collect()
}

impl TestTree {
    /// Builds the tree of `tris` (each with an area), rounded to f32 around `origin`.
    pub fn build(tris: &[Tri], origin: DVec3, split_budget: f32) -> Self {
        // Runs of three parts in turn.
        Self::of_parts(tris, origin, split_budget, |i| i / 50 % 3)
    }

    /// The same with other parts of the triangles.
    pub fn of_parts(tris: &[Tri], origin: DVec3, split_budget: f32, part_of: impl Fn(u32) -> u32) -> Self {
        let local: Vec<[Vec3; 3]> = tris.iter().map(|t| t.map(|v| (v - origin).as_vec3())).collect();
        let parts: Vec<u32> = (0..tris.len() as u32).map(part_of).collect();
        let prims: Vec<u32> = (0..tris.len() as u32).collect();
        let input = TreeInput {
            triangles: &local,
            parts: &parts,
            prims: &prims,
            colours: &[],
            normals: &[],
            part_colours: &[],
        };
        let par = Par { threads: 1 };
        let options = TreeOptions { split_budget, mesh_half_area: 0.0, proxies: None };
        let (progress, cancel) = (Progress::default(), Cancel::new());
        let mut built =
            Chunk::build(input, &options, true, &par, &Stretch::new(&progress, &cancel, (0.0, 1.0))).expect("a tree");
        // Fine blocks refer to no others: where they are is all that they need to know.
        let plans = built.chunk.take_plans();
        let (chunk, upper_tree) =
            (&built.chunk, built.top.map(|top| UpperTree::over(vec![top]).expect("an upper tree")));
        let coarse = upper_tree.iter().flat_map(|c| (0..c.blocks()).map(|i| c.encode(i, 0)));
        let (fine, leaves): (Vec<TreeBlock>, Vec<Option<TreeBlock>>) =
            plans.into_iter().map(|plan| chunk.encode(plan)).unzip();
        let leaves: Vec<TreeBlock> = leaves.into_iter().flatten().collect();
        let leaves_at = leaves.len() as u32;
        let blocks: Vec<TreeBlock> = coarse.chain(fine).chain(leaves).collect();
        let geometry = blocks.len() as u32;
        let mut slots = Vec::new();
        for (i, block) in (0..).zip(&blocks) {
            slots.push((BlockId(i), Slot::new(&block.words)));
            slots.push((BlockId(geometry + i), Slot::new(&block.prims)));
        }
        let max_coord = built.bounds.min.abs().max(built.bounds.max.abs()).max_element();
        let stored = local.iter().map(|t| t.map(|v| v.as_dvec3())).collect();
        let snapshot = Snapshot::empty(2 * geometry).with(slots);
        let references = built.counts.references as usize;
        Self { snapshot, root: build::root(), leaves_at, geometry, max_coord, stored, origin, references }
    }

    /// Around the middle of the bounds.
    pub fn around_middle(tris: &[Tri], split_budget: f32) -> Self {
        let fold = |f: fn(DVec3, DVec3) -> DVec3| tris.iter().flatten().copied().reduce(f).unwrap_or_default();
        let origin = (fold(DVec3::min) + fold(DVec3::max)) * 0.5;
        Self::build(tris, origin, split_budget)
    }

    /// The tree in `snapshot` (of its own blocks).
    pub fn view<'a>(&self, snapshot: &'a Snapshot, isa: Isa) -> TreeView<'a> {
        TreeView {
            snapshot,
            root_block: 0,
            root: self.root,
            max_coord: self.max_coord,
            leaves_at: self.leaves_at,
            prims_at: self.geometry,
            colours_at: None,
            normals_at: None,
            isa,
            accept_missing: false,
            ties_by_place: false,
            stamp: 1,
            shown: None,
            has_members: false,
            proxies: None,
            stop: &outcrop::structure::NEVER,
        }
    }

    /// Blocks, those with primitive ids among them.
    pub fn blocks(&self) -> u32 {
        2 * self.geometry
    }

    /// The tree itself, read back leaf by leaf, has every triangle's corners in their order, and no others.
    pub fn assert_holds_its_triangles(&self) {
        let view = self.view(&self.snapshot, Isa::Baseline);
        let mut seen = vec![false; self.stored.len()];
        let visited = for_each_triangle(&Tree::new(Blocks::Bvh(view), None), &mut |hit, triangle| {
            let prim = view.prim(hit).expect("all blocks are here") as usize;
            seen[prim] = true;
            assert_eq!(triangle.vertices.map(Vec3::as_dvec3), self.stored[prim], "corners of {prim}");
        });
        visited.expect("all blocks are here");
        assert!(seen.iter().all(|&s| s), "a triangle is in no leaf");
    }
}

/// A ray as the tree takes it.
pub fn local(ray: &Ray32) -> LocalRay {
    LocalRay { org: ray.org, dir: ray.dir, t_min: ray.t_min, t_max: ray.t_max, cone: ray.cone }
}

/// As the oracle takes it.
pub fn wide(ray: &Ray32) -> Ray64 {
    ray.wide()
}

/// The hit of one ray; every block is there.
pub fn closest(view: &TreeView, ray: &Ray32, walk: &mut Walk) -> Option<TriHit> {
    walk.begin(view, &local(ray));
    assert_eq!(view.closest(None, walk), Outcome::Done);
    Some(walk.best()).filter(TriHit::is_hit)
}

/// Rays from what rays hit to a light, to the side of where these begin; every block is there.
pub fn shadows(view: &TreeView, rays: &[Ray32]) -> Vec<Ray32> {
    let mut walk = Walk::new();
    let shadow = |ray: &Ray32| {
        let hit = closest(view, ray, &mut walk)?;
        let (org, eye) = (ray.org + ray.dir * (hit.t * 0.999), ray.org);
        let light = eye + 1.5 * Vec3::new(eye.y, eye.z, eye.x);
        Some(Ray32 { org, dir: light - org, t_min: 0.0, t_max: 1.0, ..*ray })
    };
    rays.iter().filter_map(shadow).collect()
}

/// Whether one ray hits anything; every block is there.
pub fn any(view: &TreeView, ray: &Ray32, walk: &mut Walk) -> bool {
    walk.begin(view, &local(ray));
    assert_eq!(view.any(None, walk), Outcome::Done);
    walk.best().is_hit()
}

/// The hits of up to a packet's rays as a packet; every block is there.
pub fn closest_together(view: &TreeView, rays: &[Ray32], walk: &mut PacketWalk) -> Vec<Option<TriHit>> {
    begin_together(view, rays, walk);
    assert_eq!(view.closest_together(None, walk), Outcome::Done);
    (0..rays.len()).map(|i| Some(walk.best(i)).filter(TriHit::is_hit)).collect()
}

/// Whether each of up to a packet's rays hits anything; every block is there.
pub fn any_together(view: &TreeView, rays: &[Ray32], walk: &mut PacketWalk) -> Vec<bool> {
    begin_together(view, rays, walk);
    assert_eq!(view.any_together(None, walk), Outcome::Done);
    (0..rays.len()).map(|i| walk.best(i).is_hit()).collect()
}

/// The hits of rays side by side; `None` for those that the stream leaves unfinished.
pub fn closest_each(view: &TreeView, rays: &[Ray32], stream: &mut Stream) -> Vec<Option<Option<TriHit>>> {
    let mut all = Vec::new();
    for rays in rays.chunks(STREAM) {
        rays.iter().enumerate().for_each(|(i, ray)| stream.set(i, &local(ray)));
        let mut hits = vec![TriHit::none(0.0); rays.len()];
        view.closest_each(None, stream, &mut hits);
        let mut hits: Vec<_> = hits.into_iter().map(|hit| Some(Some(hit).filter(TriHit::is_hit))).collect();
        stream.unfinished().iter().for_each(|&i| hits[i as usize] = None);
        all.append(&mut hits);
    }
    all
}

/// Whether rays side by side hit anything; every block is there.
pub fn any_each(view: &TreeView, rays: &[Ray32], stream: &mut Stream) -> Vec<bool> {
    let mut all = Vec::new();
    for rays in rays.chunks(STREAM) {
        rays.iter().enumerate().for_each(|(i, ray)| stream.set(i, &local(ray)));
        let mut hits = vec![TriHit::none(0.0); rays.len()];
        view.any_each(None, stream, &mut hits);
        assert!(stream.unfinished().is_empty());
        all.extend(hits.iter().map(TriHit::is_hit));
    }
    all
}

/// Puts up to a packet's rays into the first lanes of a packet.
pub fn begin_together(view: &TreeView, rays: &[Ray32], walk: &mut PacketWalk) {
    let mut lanes = [local(&rays[0]); PACKET];
    for (lane, ray) in lanes.iter_mut().zip(rays) {
        *lane = local(ray);
    }
    walk.begin(view, &lanes, first_rays(rays.len()));
}

/// Everything a hit says, as bits: distance, weights and primitive. Not where the triangle is stored: spatial
/// splits store it several times, and which of them a walk meets first is its own business.
pub fn bits(view: &TreeView, hit: &Option<TriHit>) -> Option<[u32; 4]> {
    hit.map(|h| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), view.prim(&h).expect("resident")])
}
