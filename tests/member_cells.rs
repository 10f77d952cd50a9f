//! Stand-ins for groups of members: a walk with a cone through a tree over members may end at a cell. What such a hit
//! promises is checked in double precision against the triangles of all members, placed by turned, mirrored, sheared
//! and scaled maps; so are its looks against what rays meet first. All kinds of walks find the same cells.

mod group;

use crate::common::brute::{Oracle, Tri};
use crate::common::bvh64::Bvh64;
use crate::common::rng::Rng;
use crate::common::scenes;
use crate::common::trees::{TestTree, isas};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use group::{
    Answer, COLOURS, Group, MAX_COORD, Member, SPACE, alone, any_map, bounds_of, described, index, leaves, members,
    models, number, together, wide,
};
use outcrop::lod::{LEAST, LESS, blended_colour, holds, limit, shares, stored_normal, sure_from};
use outcrop::math::{Bounds, Cone, PACKET};
use outcrop::simd::Isa;
use outcrop::structure::cell::Cells;
use outcrop::structure::{LocalRay, MemberChild, Members, Move, PacketWalk, Stream, Tree, TriHit, Walk};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

/// Rays with cones of several widths, 32 from about the same place; one in eight with parallel sides.
fn packets(count: usize, seed: u64) -> Vec<[LocalRay; PACKET]> {
    let mut rng = Rng::new(seed);
    let packet = |i: usize| {
        let reach = if i.is_multiple_of(3) { 1.0 } else { 2.5 };
        let org = rng.inside(DVec3::splat(-SPACE * reach), DVec3::splat(SPACE * reach));
        let to = rng.inside(DVec3::splat(-SPACE), DVec3::splat(SPACE)) * 0.6;
        let width = [0.1, 0.3, 0.6, 1.5][i % 4];
        let spread = [0.02, 0.3][i / 4 % 2];
        std::array::from_fn(|_| {
            let dir = ((to - org).normalize() + rng.direction() * spread).normalize().as_vec3();
            let cone = if i % 8 == 3 { Cone { a: 4.0 * width, b: 0.0 } } else { Cone { a: 0.0, b: width } };
            LocalRay { org: org.as_vec3(), dir, t_min: 0.0, t_max: f32::INFINITY, cone }
        })
    };
    (0..count).map(packet).collect()
}

/// The cell of a hit.
struct Cell {
    cells: Box<Cells<1>>,
    bounds: Bounds,
    level: u32,
}

fn cell_of(tree: &Tree, ray: &LocalRay, hit: TriHit) -> Cell {
    let mut cells = Box::new(Cells::<1>::NONE);
    assert_eq!(tree.cells(1, |_| hit, |_| ray.dir.as_dvec3(), (true, 0), &mut cells), 0);
    let (bounds, level) = (cells.bounds_of(0), cells.level[0]);
    Cell { cells, bounds, level }
}

/// The error that `query::answers::stand_in` states for a hit on a cell.
fn stated_error(tree: &Tree, ray: &LocalRay, hit: TriHit, cell: &Cell) -> f64 {
    let (b, here) = (&cell.bounds, wide(ray).at(f64::from(hit.t)));
    let (low, high) = (b.min.as_dvec3(), b.max.as_dvec3());
    let (diagonal, inside) = ((high - low).length(), here.max(low).min(high));
    let farthest = (here - low).abs().max((here - high).abs()).length();
    let slabs = tree.oriented_slabs(&hit).expect("a cell");
    let is_sure = diagonal >= sure_from(ray.org.as_dvec3(), MAX_COORD) || holds(b, &slabs, inside);
    let limit = if is_sure { limit(cell.level) } else { f64::INFINITY };
    (diagonal * limit + here.distance(inside)).min(farthest)
}

/// The projected area of a cell as it counts, over what the ray allows.
fn area_of(ray: &LocalRay, hit: TriHit, cell: &Cell) -> f32 {
    let e = cell.bounds.extent();
    let area = Vec3::new(e.y * e.z, e.z * e.x, e.x * e.y).dot(ray.dir.abs());
    let width = ray.cone.a + ray.cone.b * hit.t;
    area * (1.0 - cell.level as f32 * LESS).max(LEAST) / (width * width)
}

/// What is known of the hits of many rays.
#[derive(Default, Debug)]
struct Tally {
    cells: usize,
    exact: usize,
    misses: usize,
    transmitted: usize,
    levels: [usize; 4],
    slack: Vec<f64>,
}

fn judge(group: &Group, tree: &Tree, ray: &LocalRay, answer: &Answer, tally: &mut Tally) {
    let truth = group.oracle.closest(&wide(ray)).map_or(f64::INFINITY, |hit| hit.t);
    // No surface lies before the first cell, nor before the hit if there was no cell.
    let free = f64::from(answer.first_cell.min(answer.t));
    assert!(truth >= free * (1.0 - 1e-6), "{ray:?}: {answer:?}, but a surface at {truth}");
    let Some(hit) = answer.cell else {
        if answer.first_cell < answer.t {
            tally.transmitted += 1;
        } else {
            // Single precision rounds it.
            assert!(
                truth == f64::INFINITY && answer.t == f32::INFINITY || truth as f32 == answer.t,
                "{truth}: {answer:?}"
            );
        }
        let count = if answer.t < f32::INFINITY { &mut tally.exact } else { &mut tally.misses };
        *count += 1;
        return;
    };
    let cell = cell_of(tree, ray, hit);
    let area = area_of(ray, hit, &cell);
    assert!(area <= 1.0001, "the cell of {answer:?} is {area} times too large: {ray:?}");
    let (error, here) = (stated_error(tree, ray, hit, &cell), wide(ray).at(f64::from(hit.t)));
    let off = group.oracle.distance(here, error * 1.5);
    assert!(off <= error * (1.0 + 1e-6), "the surface is {off} away, not {error}: {ray:?}: {answer:?}");
    // The dominant member is in the cell.
    let member = &group.members[index(cell.cells.part[0])];
    assert!(cell.bounds.contains(&member.bounds), "{:?}", cell.bounds);
    tally.cells += 1;
    tally.levels[cell.level as usize] += 1;
    tally.slack.push(error / off.max(error * 1e-6));
}

/// 10,240 rays.
#[test]
fn groups_keep_the_promise() {
    let (group, mut tally, mut walk) = (Group::usual(), Tally::default(), Walk::new());
    let tree = group.tree.tree(Isa::best());
    let boxes = stored_boxes(&group.tree);
    for ray in packets(320, 1).iter().flatten() {
        let answer = alone(&tree, &group.members, ray, &mut walk, |number, best| {
            // Members that begin behind the cell that was hit are not visited.
            if best.is_hit() {
                let enter = enter(ray, &boxes[index(number)]);
                assert!(enter <= f64::from(best.t) * (1.0 + 1e-5), "{number} at {enter}, the cell at {}", best.t);
            }
        });
        judge(group, &tree, ray, &answer, &mut tally);
    }
    tally.slack.sort_by(f64::total_cmp);
    let Tally { cells, exact, misses, transmitted, levels, slack } = &tally;
    println!(
        "{cells} cells, {exact} exact, {misses} misses, {transmitted} transmitted, levels {levels:?}, median {:.1}",
        slack[slack.len() / 2]
    );
    assert!(*cells > 2000 && *exact > 2000 && *misses > 500 && *transmitted > 100, "{tally:?}");
    assert!(levels[1..].iter().sum::<usize>() > 200, "{levels:?}");
}

/// The boxes of all members, as the tree has them.
fn stored_boxes(tree: &Members) -> Vec<Bounds> {
    let (mut boxes, mut todo) = (BTreeMap::new(), vec![tree.root()]);
    while let Some(node) = todo.pop() {
        tree.children(node, |child, b| match child {
            MemberChild::Member(number) => {
                boxes.insert(number, b);
            }
            MemberChild::Node(node) => todo.push(node),
        });
    }
    boxes.into_values().collect()
}

/// Where a ray enters a box in double precision, up to the tolerance of walks.
fn enter(ray: &LocalRay, b: &Bounds) -> f64 {
    let grown = f64::from(MAX_COORD) * (40.0 / 16_777_216.0);
    let (org, inv) = (ray.org.as_dvec3(), ray.dir.as_dvec3().recip());
    let (p, q) = ((b.min.as_dvec3() - grown - org) * inv, (b.max.as_dvec3() + grown - org) * inv);
    p.min(q).max_element()
}

#[test]
fn all_kinds_of_walks_find_the_same_cells() {
    let group = Group::usual();
    let (mut walk, mut packet, mut stream) = (Walk::new(), PacketWalk::new(), Stream::new());
    let mut cells = 0;
    for rays in &packets(32, 2) {
        let expected: Vec<Answer> = rays
            .iter()
            .map(|ray| alone(&group.tree.tree(Isa::Baseline), &group.members, ray, &mut walk, |_, _| {}))
            .collect();
        cells += expected.iter().filter(|it| it.cell.is_some()).count();
        // What lies beyond the hit is said or not.
        let known = |it: &Answer| {
            let end = it.cell.map_or(it.t, |hit| hit.t);
            Answer { first_cell: if it.first_cell <= end { it.first_cell } else { f32::INFINITY }, ..*it }
        };
        for isa in isas() {
            let tree = group.tree.tree(isa);
            let packed = together(&tree, &group.members, rays, &mut packet);
            for (i, ray) in rays.iter().enumerate() {
                let single = alone(&tree, &group.members, ray, &mut walk, |_, _| {});
                assert_eq!(known(&single), known(&expected[i]), "{}: {ray:?}", isa.name());
                assert_eq!(known(&packed[i]), known(&expected[i]), "{} together: {ray:?}", isa.name());
            }
            // A stream leaves these rays to single walks.
            rays.iter().enumerate().for_each(|(i, ray)| stream.set(i, ray));
            let mut hits = vec![TriHit::none(0.0); PACKET];
            tree.closest_each(None, &mut stream, &mut hits);
            assert_eq!(stream.unfinished(), (0..PACKET as u32).collect::<Vec<_>>());
            tree.any_each(None, &mut stream, &mut hits);
            assert_eq!(stream.unfinished().len(), PACKET);
            assert!(hits.iter().all(|hit| !hit.is_hit()));
        }
    }
    assert!(cells > 250, "{cells}");
}

/// Members that lack a look: no cell above one of them stands in, and all walks come to them.
#[test]
fn cells_above_members_without_looks_do_not_stand_in() {
    let group = Group::usual();
    let lacks = |i: usize| i % 40 == 3;
    let members = described(&group.looks, &group.members, |i| !lacks(i));
    let none = Members::build(group.members.iter().enumerate().map(|(i, it)| (number(i), it.bounds)), MAX_COORD);
    let none = none.expect("a tree");
    let (mut walk, mut cells, mut tally) = (Walk::new(), 0, Tally::default());
    for ray in packets(60, 3).iter().flatten() {
        let tree = members.tree(Isa::best());
        let answer = alone(&tree, &group.members, ray, &mut walk, |_, _| {});
        judge(group, &tree, ray, &answer, &mut tally);
        if let Some(hit) = answer.cell {
            cells += 1;
            assert!(below(&members, hit).iter().all(|number| !lacks(index(*number))));
        }
        let exact = alone(&none.tree(Isa::best()), &group.members, ray, &mut walk, |_, _| {});
        assert_eq!((exact.cell, exact.first_cell), (None, f32::INFINITY));
        let truth = group.oracle.closest(&wide(ray)).map_or(f32::INFINITY, |hit| hit.t as f32);
        assert_eq!(exact.t, truth);
    }
    assert!(cells > 100, "{cells}");
}

/// One pass over all members keeps the same cells from standing in as moves of each to where it is.
#[test]
fn cells_above_chosen_members_do_not_stand_in() {
    let (group, mut rng, mut walk) = (Group::usual(), Rng::new(12), Walk::new());
    for count in [1, 5, 60] {
        let own: BTreeSet<usize> = (0..count).map(|_| rng.below(group.members.len())).collect();
        let stay = |at: &usize| {
            let bounds = group.members[*at].bounds;
            Move { member: number(*at), from: bounds, to: bounds }
        };
        let moved = group.tree.moved(&own.iter().map(stay).collect::<Vec<_>>()).expect("members that are there");
        let passed = group.tree.without_cells_above(|member| own.contains(&index(member))).expect("memory");
        assert_eq!(moved.changed_bytes(), passed.changed_bytes());
        let mut others = 0;
        for ray in packets(24, 50 + count as u64).iter().flatten() {
            let [a, b, all] = [&moved, &passed, &group.tree]
                .map(|tree| alone(&tree.tree(Isa::best()), &group.members, ray, &mut walk, |_, _| {}));
            assert_eq!(a, b, "{ray:?}");
            others += usize::from(a.cell != all.cell);
            if let Some(hit) = b.cell {
                assert!(below(&group.tree, hit).iter().all(|member| !own.contains(&index(*member))), "{hit:?}");
            }
        }
        assert!(others > 0, "{count} members change nothing");
    }
}

/// After moves the cells above what moved do not stand in; all others keep the promise for what is there now.
#[test]
fn cells_above_moved_members_do_not_stand_in() {
    let usual = Group::usual();
    let (mut rng, mut members) = (Rng::new(8), usual.members.clone());
    let trees = models().map(|tris| TestTree::around_middle(&tris, 0.0));
    let mut tree = described(&usual.looks, &members, |_| true);
    let (mut walk, mut cells) = (Walk::new(), 0);
    for round in 0..4 {
        let moves: Vec<Move> = (0..3)
            .map(|k| {
                let at = rng.below(members.len());
                let it = &members[at];
                // Some far, some a little, some only look different.
                let by = rng.direction() * [4.0, 0.02, 0.0][k % 3];
                let map = DAffine3 {
                    translation: (it.map.translation + by).clamp(DVec3::splat(-SPACE), DVec3::splat(SPACE)),
                    ..it.map
                };
                let new = Member::new(it.model, map, &trees[it.model].stored);
                let one = Move { member: number(at), from: it.bounds, to: new.bounds };
                members[at] = new;
                one
            })
            .collect();
        tree = tree.moved(&moves).expect("members that are there");
        let group = Group {
            looks: usual.looks.clone(),
            members: members.clone(),
            oracle: Bvh64::new(members.iter().flat_map(|it| it.tris.iter().copied()).collect()),
            tree,
        };
        let (view, mut tally) = (group.tree.tree(Isa::best()), Tally::default());
        for ray in packets(32, 40 + round).iter().flatten() {
            let answer = alone(&view, &group.members, ray, &mut walk, |_, _| {});
            judge(&group, &view, ray, &answer, &mut tally);
            if let Some(hit) = answer.cell {
                let below = below(&group.tree, hit);
                assert!(!below.is_empty());
                let moved = moves.iter().find(|it| below.contains(&it.member));
                assert!(moved.is_none(), "{moved:?} is below a cell that stands in");
            }
        }
        cells += tally.cells;
        tree = group.tree;
    }
    assert!(cells > 100, "{cells}");
}

/// Groups of groups, as scenes in scenes are: the appearance of a tree over members describes a member of another.
#[test]
fn groups_of_groups_keep_the_promise() {
    let (trees, mut inner) = members(&models(), 24, 31);
    for it in &mut inner {
        *it = Member::new(
            it.model,
            DAffine3 { translation: it.map.translation * 0.25, ..it.map },
            &trees[it.model].stored,
        );
    }
    let inner = Group::new(&trees, inner);
    let own: Vec<Tri> = inner.members.iter().flat_map(|it| it.tris.iter().copied()).collect();
    let look = inner.tree.appearance().expect("all members are described").as_ref().clone();
    let mut rng = Rng::new(32);
    let outer: Vec<Member> = (0..80)
        .map(|_| {
            let at = rng.inside(DVec3::splat(-SPACE), DVec3::splat(SPACE));
            let map = any_map(&mut rng, at);
            Member::new(0, DAffine3 { matrix3: map.matrix3 * 0.4, ..map }, &own)
        })
        .collect();
    let looks = vec![(look, Vec3::ONE)];
    let tree = described(&looks, &outer, |_| true);
    let oracle = Bvh64::new(outer.iter().flat_map(|it| it.tris.iter().copied()).collect());
    let group = Group { looks, members: outer, oracle, tree };
    let (view, mut walk, mut tally) = (group.tree.tree(Isa::best()), Walk::new(), Tally::default());
    for ray in packets(64, 33).iter().flatten() {
        let answer = alone(&view, &group.members, ray, &mut walk, |_, _| {});
        judge(&group, &view, ray, &answer, &mut tally);
    }
    let Tally { cells, exact, misses, transmitted, levels, .. } = tally;
    println!("{cells} cells, {exact} exact, {misses} misses, {transmitted} transmitted, levels {levels:?}");
    assert!(cells > 100 && transmitted > 50);
}

/// The members below the cell of a hit: those that a walk from its node comes to.
fn below(tree: &Members, hit: TriHit) -> Vec<u32> {
    // A node's number is its block times 512, plus its index there; a cell's is the node's times 8, plus the slot.
    let item = hit.tri & 0x1fff_ffff;
    let (node, slot) = (hit.block * 512 + (item >> 3), (item & 7) as usize);
    let (mut children, mut out) = (Vec::new(), Vec::new());
    tree.children(node, |child, _| children.push(child));
    let mut todo = vec![children[slot]];
    while let Some(child) = todo.pop() {
        match child {
            MemberChild::Member(number) => out.push(number),
            MemberChild::Node(node) => tree.children(node, |child, _| todo.push(child)),
        }
    }
    out
}

/// From each side a group shows what is met first: sheets of red plates before green ones, turned in any way.
#[test]
fn groups_show_what_is_met_first() {
    let plate = scenes::plane_grid(2, 0.0);
    let trees = [plate.clone(), plate].map(|tris| TestTree::around_middle(&tris, 0.0));
    // The plates lie in the planes x = -2 (red) and x = 2 (green), each turned in its plane; some are mirrored.
    let mut rng = Rng::new(4);
    let extent = bounds_of(&trees[0].stored).extent().max_element();
    let members: Vec<Member> = (0..512)
        .map(|i| {
            let (model, row, column) = (i % 2, i / 2 % 16, i / 32);
            let at = DVec3::new(model as f64 * 4.0 - 2.0, row as f64 - 7.5, column as f64 - 7.5);
            let quarter = DQuat::from_rotation_x(rng.below(4) as f64 * std::f64::consts::FRAC_PI_2);
            let turn = DMat3::from_quat(quarter * DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
            let mirror = DVec3::new(if rng.one_in(2) { -1.0 } else { 1.0 }, 1.0, 1.0) / f64::from(extent);
            Member::new(
                model,
                DAffine3::from_mat3_translation(turn * DMat3::from_diagonal(mirror), at),
                &trees[model].stored,
            )
        })
        .collect();
    let group = Group::new(&trees, members);
    let tree = group.tree.tree(Isa::best());
    let mut walk = Walk::new();
    for (from, colour) in [(Vec3::NEG_X, COLOURS[0]), (Vec3::X, COLOURS[1])] {
        let mut seen = 0;
        for _ in 0..200 {
            let org = from * 11.0 + rng.inside(DVec3::new(0.0, -7.0, -7.0), DVec3::new(0.0, 7.0, 7.0)).as_vec3();
            let cone = Cone { a: 40.0, b: 0.0 };
            let ray = LocalRay { org, dir: -from, t_min: 0.0, t_max: f32::INFINITY, cone };
            let answer = alone(&tree, &group.members, &ray, &mut walk, |_, _| {});
            let hit = answer.cell.expect("a closed wall stops all rays");
            let Cell { cells, bounds, .. } = cell_of(&tree, &ray, hit);
            let (firsts, seconds) = (cells.firsts.map(|row| row[0]), cells.seconds.map(|row| row[0]));
            let parts = if cells.have_three & 1 == 1 {
                shares(bounds.extent(), ray.dir, firsts, seconds)
            } else {
                [1.0, 0.0, 0.0]
            };
            let shown = blended_colour(if cells.have_three & 1 == 1 { seconds } else { [seconds[0]; 3] }, parts);
            assert!(cells.coloured & 1 == 1 && shown.distance(colour) < 0.02, "{shown}, not {colour}: {bounds:?}");
            assert!(stored_normal(firsts[0]).dot(from).abs() > 0.99, "{:?}", stored_normal(firsts[0]));
            seen += 1;
        }
        assert_eq!(seen, 200);
    }
}

/// A tilted wall of sheared plates: the slabs of its groups, turned through the inverse transpose, are as thin as the
/// wall, and no ray passes it.
#[test]
fn tilted_walls_are_thin_and_stay_closed() {
    let trees = [TestTree::around_middle(&scenes::plane_grid(2, 0.0), 0.0)];
    let size = bounds_of(&trees[0].stored).extent();
    let (u, v) = (DVec3::new(0.6, 0.3, 0.2), DVec3::new(-0.1, 0.5, -0.6));
    let normal = u.cross(v).normalize();
    let linear = DMat3::from_cols(u / f64::from(size.x), v / f64::from(size.y), normal * 3.0 - u);
    let middle = DVec3::new(0.4, -0.3, 0.2);
    let members = (0..256).map(|i| {
        let at = middle + u * (f64::from(i % 16) - 7.5) + v * (f64::from(i / 16) - 7.5);
        Member::new(0, DAffine3::from_mat3_translation(linear, at), &trees[0].stored)
    });
    let group = Group::new(&trees, members.collect());
    let (tree, mut walk, mut rng, mut tally) =
        (group.tree.tree(Isa::best()), Walk::new(), Rng::new(5), Tally::default());
    let mut thickest: f64 = 0.0;
    for i in 0..1500 {
        let to = middle + u * rng.between(-6.0, 6.0) + v * rng.between(-6.0, 6.0);
        let dir = rng.direction();
        if dir.dot(normal).abs() < 0.5 {
            continue;
        }
        let (org, cone) = ((to - dir * 14.0).as_vec3(), Cone { a: [1.5, 3.0, 6.0][i % 3], b: 0.0 });
        let ray = LocalRay { org, dir: dir.as_vec3(), t_min: 0.0, t_max: f32::INFINITY, cone };
        let answer = alone(&tree, &group.members, &ray, &mut walk, |_, _| {});
        assert!(answer.cell.is_some() || answer.t < f32::INFINITY, "{ray:?} passes");
        judge(&group, &tree, &ray, &answer, &mut tally);
        if let Some(hit) = answer.cell {
            let off = (wide(&ray).at(f64::from(hit.t)) - middle).dot(normal).abs();
            let cell = cell_of(&tree, &ray, hit).bounds.extent();
            thickest = thickest.max(off / f64::from(cell.length()));
        }
    }
    println!(
        "{} cells, {} exact; hits at most {thickest:.3} of a cell's diagonal before the wall",
        tally.cells, tally.exact
    );
    assert!(tally.cells > 200 && tally.transmitted == 0 && thickest < 0.05, "{thickest}: {tally:?}");
}

/// Groups of loose members stop about as many rays as their triangles do: the mean of eight heaps.
#[test]
fn groups_cover_what_their_members_cover() {
    let soup: Vec<Tri> = leaves(&mut Rng::new(3), 400).iter().map(|t| t.map(|v| t[0] + (v - t[0]) * 0.5)).collect();
    let (trees, mut rng) = ([TestTree::of_parts(&soup, DVec3::ZERO, 0.0, |_| 0)], Rng::new(12));
    let (widths, mut counts) = ([8.0, 10.0, 12.0], [[0; 3]; 3]);
    let mut walk = Walk::new();
    for _ in 0..8 {
        let one = |_| {
            let at = rng.inside(DVec3::splat(-5.0), DVec3::splat(5.0));
            Member::new(0, any_map(&mut rng, at), &trees[0].stored)
        };
        let group = Group::new(&trees, (0..60).map(one).collect());
        let tree = group.tree.tree(Isa::best());
        for (width, [truth, found, cells]) in widths.into_iter().zip(&mut counts) {
            for _ in 0..3000 {
                // Uniform over all lines through a ball around the members.
                let dir = rng.direction();
                let turn = DQuat::from_axis_angle(dir, rng.between(0.0, TAU));
                let off = turn * dir.any_orthonormal_vector() * (9.7 * rng.unit().sqrt());
                let (org, cone) = ((off - dir * 20.0).as_vec3(), Cone { a: width, b: 0.0 });
                let ray = LocalRay { org, dir: dir.as_vec3(), t_min: 0.0, t_max: f32::INFINITY, cone };
                let answer = alone(&tree, &group.members, &ray, &mut walk, |_, _| {});
                *cells += usize::from(answer.cell.is_some());
                *found += usize::from(answer.cell.is_some() || answer.t < f32::INFINITY);
                *truth += usize::from(group.oracle.any(&wide(&ray)));
            }
        }
    }
    for (width, [truth, found, cells]) in widths.into_iter().zip(counts) {
        let ratio = found as f64 / truth as f64;
        println!("width {width}: {found} rays stopped, {cells} by cells; triangles stop {truth}: {ratio:.2}");
        assert!(cells * 2 > found && (ratio - 1.0).abs() < 0.12, "{found} of {truth} at {width}, {cells} by cells");
    }
}

/// Bytes for each member, in both forms.
#[test]
fn trees_are_small() {
    let group = Group::usual();
    let (mut rng, count) = (Rng::new(21), 6000);
    let members: Vec<Member> = (0..count)
        .map(|i| {
            let map = any_map(&mut rng, DVec3::ZERO);
            let at = rng.inside(DVec3::splat(-SPACE), DVec3::splat(SPACE));
            let corner = [DVec3::splat(-1.0), DVec3::splat(1.0), DVec3::new(1.0, -1.0, 0.5)];
            Member::new(i % 3, DAffine3 { translation: at, ..map }, &[corner])
        })
        .collect();
    let plain = Members::build(members.iter().enumerate().map(|(i, it)| (number(i), it.bounds)), MAX_COORD);
    let each = [plain.expect("a tree"), described(&group.looks, &members, |_| true)]
        .map(|it| it.bytes() as f64 / count as f64);
    println!("bytes a member: {:.1}, described {:.1}", each[0], each[1]);
    assert!(each[0] < 54.0 && each[1] < 78.0, "{each:?}");
    assert!(each[0] <= Members::BYTES_EACH as f64 && each[1] <= Members::BYTES_EACH_DESCRIBED as f64);
}
