//! Where rays pass stand-ins, and where parts are hidden, all walks say the same: rays alone, in packets, and side by
//! side, of which the first steps are shared.

use crate::common::rays::{Ray32, RayKind, RayMaker};
use crate::common::scenes;
use crate::common::trees::{self, TestTree};
use glam::Vec3;
use outcrop::math::Cone;
use outcrop::math::{PACKET, STREAM};
use outcrop::simd::Isa;
use outcrop::structure::Stream;
use outcrop::structure::bvh::trace::TreeView;
use outcrop::structure::{Outcome, PacketWalk, PartFilter, TriHit, Walk};

/// What a walk says of a ray: what it hits, and where it first entered a stand-in up to that.
type Said = (Option<TriHit>, Option<u32>);

fn said(best: TriHit, first_cell: f32) -> Said {
    // What is behind the hit may be told or not.
    (Some(best).filter(TriHit::is_hit), (first_cell <= best.t.min(f32::MAX)).then_some(first_cell.to_bits()))
}

/// True if a stand-in transmitted the ray: it entered one before it hit another, or a triangle, or nothing.
fn was_transmitted((hit, first_cell): &Said) -> bool {
    let own = hit.filter(|hit| hit.stand_in().is_some()).map(|hit| hit.t.to_bits());
    first_cell.is_some() && *first_cell != own
}

fn alone(view: &TreeView, filter: Option<&PartFilter>, rays: &[Ray32]) -> Vec<Said> {
    let mut walk = Walk::new();
    let each = |ray: &Ray32| {
        walk.begin(view, &trees::local(ray));
        assert_eq!(view.closest(filter, &mut walk), Outcome::Done);
        said(walk.best(), walk.first_cell())
    };
    rays.iter().map(each).collect()
}

fn together(view: &TreeView, filter: Option<&PartFilter>, rays: &[Ray32]) -> Vec<Said> {
    let (mut walk, mut all) = (PacketWalk::of_queries(), Vec::new());
    for rays in rays.chunks(PACKET) {
        trees::begin_together(view, rays, &mut walk);
        assert_eq!(view.closest_together(filter, &mut walk), Outcome::Done);
        all.extend((0..rays.len()).map(|i| said(walk.best(i), walk.first_cell()[i])));
    }
    all
}

fn side_by_side(view: &TreeView, filter: Option<&PartFilter>, rays: &[Ray32]) -> Vec<Said> {
    let (mut stream, mut all) = (Stream::of_queries(), Vec::new());
    for rays in rays.chunks(STREAM) {
        rays.iter().enumerate().for_each(|(i, ray)| stream.set(i, &trees::local(ray)));
        let mut hits = vec![TriHit::none(0.0); rays.len()];
        view.closest_each(filter, &mut stream, &mut hits);
        assert!(stream.unfinished().is_empty());
        // Of a ray that hits nothing a stream does not say how far it went.
        let far = |i: usize| TriHit::none(rays[i].t_max);
        all.extend(
            hits.iter()
                .enumerate()
                .map(|(i, hit)| said(if hit.is_hit() { *hit } else { far(i) }, stream.first_cell()[i])),
        );
    }
    all
}

/// From a point of view, and from what is seen there on in all directions: groups that share their first steps and soon
/// part.
fn rays(tree: &TestTree, view: &TreeView) -> Vec<Ray32> {
    let mut maker = RayMaker::new(&tree.stored, 5);
    let mut rays: Vec<Ray32> = (0..4096).map(|_| maker.make(RayKind::Grid)).collect();
    let mut walk = Walk::new();
    let seen: Vec<(Ray32, TriHit)> =
        rays.iter().filter_map(|ray| Some((*ray, trees::closest(view, ray, &mut walk)?))).collect();
    let bounced = (0..4 * seen.len()).map(|i| {
        let (ray, hit) = &seen[i / 4];
        let turn = |k: usize| ((i * k) % 17) as f32 - 8.0;
        let dir = Vec3::new(turn(5), turn(7), turn(11)) * 0.1 - ray.dir.normalize();
        Ray32 { org: ray.org + ray.dir * (hit.t * 0.999), dir, t_min: 0.0, ..*ray }
    });
    rays.extend(bounced);
    rays
}

#[test]
fn all_walks_pass_the_same_stand_ins_and_leave_out_the_same_parts() {
    let mut tris = scenes::wire_forest(400, 12, 3);
    tris.extend(scenes::bumpy_sphere(60, 90, 1).iter().map(|t| t.map(|v| scenes::rounded(v * 8.0))));
    let tree = TestTree::around_middle(&tris, 0.0);
    let base = tree.view(&tree.snapshot, Isa::Baseline);
    let exact = rays(&tree, &base);
    let hidden =
        PartFilter { hidden: &[0b10], first_part: 0, touched: outcrop::lod::summary_bit(1), ..PartFilter::default() };
    let (mut transmitted, mut lods, mut changed) = (0, 0, 0);
    for width in [0.0, 0.003, 0.01, 0.05, 0.2] {
        let rays: Vec<Ray32> =
            exact.iter().map(|ray| Ray32 { cone: Cone { a: width * tree.max_coord, b: width }, ..*ray }).collect();
        let mut unfiltered: Vec<Said> = Vec::new();
        for filter in [None, Some(&hidden)] {
            let truth = alone(&base, filter, &rays);
            transmitted += truth.iter().filter(|said| was_transmitted(said)).count();
            lods += truth.iter().filter(|(hit, _)| hit.is_some_and(|hit| hit.stand_in().is_some())).count();
            changed += unfiltered.iter().zip(&truth).filter(|(a, b)| a != b).count();
            for isa in trees::isas() {
                let view = TreeView { isa, ..base };
                for (walks, found) in
                    [("packets", together(&view, filter, &rays)), ("streams", side_by_side(&view, filter, &rays))]
                {
                    let differs = truth.iter().zip(&found).position(|(a, b)| a != b);
                    let what = |i: usize| (rays[i], truth[i], found[i]);
                    assert_eq!(
                        differs.map(what),
                        None,
                        "{}, {walks}, width {width}, filter {}",
                        isa.name(),
                        filter.is_some()
                    );
                }
            }
            unfiltered = truth;
        }
    }
    let all = exact.len();
    assert!(all > 6000, "{all}");
    assert!(transmitted > all / 4 && lods > all / 4 && changed > all / 20, "{transmitted}, {lods}, {changed} of {all}");
}
