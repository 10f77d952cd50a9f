use super::*;
use crate::math::Cone;
use crate::residency::Slot;
use crate::structure::bake::BakedBlock;
use crate::structure::hit::Counters;
use crate::structure::patch::build::{Plans, Tile, Upper, build, encode};
use crate::structure::ray::LocalRay;
use glam::Vec2;

/// A tree over blocks in memory.
struct Tree {
    snapshot: Snapshot,
    leaves_at: u32,
}

fn words(block: &BakedBlock) -> Vec<u32> {
    block.payload.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

const SIDE: usize = 8;

/// Height of a wavy sheet over the unit square.
fn height(at: Vec2) -> f32 {
    0.05 * (9.0 * at.x).sin() * (7.0 * at.y).cos()
}

impl Tree {
    /// The sheet in tiles of a level.
    fn sheet(level: u32) -> Self {
        let mut plans = Plans::default();
        for number in 0..SIDE * SIDE {
            let (i, j) = super::super::layout::of_morton(number);
            let side = (1 << level) + 1;
            let at = |k: usize| {
                let share = [k % side, k / side].map(|x| x as f32 / (side - 1) as f32);
                let at = Vec2::new(i as f32 + share[0], j as f32 + share[1]) / SIDE as f32;
                at.extend(height(at))
            };
            let positions: Vec<Vec3> = (0..side * side).map(at).collect();
            let normals = vec![Vec3::Z; positions.len()];
            let place = [3, i as u32, j as u32];
            let tile = Tile {
                level,
                positions,
                normals,
                part: 0,
                colour: Vec3::ONE,
                face: 0,
                corner: 0,
                place,
                is_turned: false,
                square: [0; 3],
                steps: [0; 4],
                patch: None,
            };
            plans.push(build(&tile));
        }
        let (mut fine, mut leaves, mut cells) = (Vec::new(), Vec::new(), Vec::new());
        for plan in plans.close() {
            let ([of_frames, of_grids], cell, _) = encode(plan);
            fine.push(words(&of_frames));
            leaves.push(words(&of_grids));
            cells.push(cell);
        }
        let upper = Upper::over(cells);
        let leaves_at = fine.len() as u32;
        let coarse = (0..upper.count()).map(|index| words(&upper.encode(index, 0)));
        let all: Vec<Vec<u32>> = coarse.chain(fine).chain(leaves).collect();
        let slots = (0..).zip(&all).map(|(id, words)| (BlockId(id), Slot::new(words)));
        Self { snapshot: Snapshot::empty(all.len() as u32).with(slots), leaves_at }
    }

    fn view(&self, isa: Isa) -> TreeView<'_> {
        TreeView {
            snapshot: &self.snapshot,
            first_block: Some(0),
            max_coord: 1.0,
            leaves_at: self.leaves_at,
            colours_at: None,
            normals_at: None,
            isa,
            visit: Visit::default(),
        }
    }
}

/// Rays from above, a little aslant, and their hits; work done for them.
fn from_above(tree: &Tree, isa: Isa, cone: Cone) -> (Vec<TriHit>, Counters) {
    let (view, mut walk, mut hits) = (tree.view(isa), Walk::new(), Vec::new());
    for i in 0..4096 {
        let at = Vec2::new((i % 64) as f32 + 0.37, (i / 64) as f32 + 0.61) / 64.0;
        let ray =
            LocalRay { org: at.extend(1.0), dir: Vec3::new(0.1, 0.05, -1.0), t_min: 0.0, t_max: f32::INFINITY, cone };
        walk.begin(&view, &ray);
        assert_eq!(view.closest(None, &mut walk), Outcome::Done);
        hits.push(walk.best());
    }
    (hits, walk.counters)
}

/// The work of rays that meet a sheet once: about the depth of the tree, and one leaf. Numbers are those of this build;
/// an order of visits that is wrong shows in them.
#[test]
fn rays_do_little_work() {
    let tree = Tree::sheet(5);
    let (hits, counters) = from_above(&tree, Isa::Baseline, Cone::ZERO);
    println!("{counters:?}");
    let met = hits.iter().filter(|hit| hit.is_hit()).count();
    for isa in [Isa::Avx2, Isa::Avx512] {
        let (same, work) = from_above(&tree, isa, Cone::ZERO);
        assert_eq!((same, work), (hits.clone(), counters));
    }
    assert!(met > 3500, "{met}");
    let each = |count: u64| count as f64 / 4096.0;
    assert!(each(counters.leaves) < 2.0 && each(counters.nodes) < 12.0, "{counters:?}");
}

/// A frame that is farther than the best hit is not visited: none of its boxes may stand in before the frame begins,
/// though boxes reach out of it.
#[test]
fn stand_ins_are_no_nearer_than_their_frames() {
    let tree = Tree::sheet(2);
    let view = tree.view(Isa::Baseline);
    let (mut walk, mut checked) = (Walk::new(), 0);
    for i in 0..4096 {
        let at = Vec2::new((i % 64) as f32 + 0.37, (i / 64) as f32 + 0.61) / 64.0;
        // Nearly along the sheet, in all directions.
        let dir = Vec2::from_angle(i as f32).extend(-0.3);
        let cone = Cone { a: 0.1, b: 0.0 };
        let ray = LocalRay { org: at.extend(0.0) - dir, dir, t_min: 0.0, t_max: f32::INFINITY, cone };
        walk.begin(&view, &ray);
        assert_eq!(view.closest(None, &mut walk), Outcome::Done);
        let hit = walk.best();
        let Some(StandIn { item, .. }) = hit.stand_in() else { continue };
        let Cell::Frame(word, ..) = Cell::of(item) else { continue };
        let block = Block(view.words(hit.block).unwrap());
        let nodes = (0..block.nodes()).filter_map(|index| block.node(index));
        let mut slots = nodes.flat_map(|node| (0..8).map(move |slot| (node, slot)));
        let (node, slot) = slots.find(|(node, slot)| node.child(*slot) == Child::Frame(word)).unwrap();
        let ray = Prepared::new(ray, view.max_coord, None);
        let (met, enter) = ray.boxes(crate::simd::Portable::new(), node.rows(), f32::INFINITY);
        let enter = enter.to_array();
        assert!(met >> slot & 1 == 1 && hit.t >= enter[slot], "{hit:?}: the frame begins at {}", enter[slot]);
        checked += 1;
    }
    assert!(checked > 2000, "{checked}");
}
