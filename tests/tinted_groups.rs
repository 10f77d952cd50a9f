//! Stand-ins for groups of instances with masks and tints of their own: tinted groups stand in, in the colours of what
//! they stand for, before and after tints change; no ray meets a group with a member that it does not see.

use crate::common::built;
use crate::group_cells::{
    FIRST_TILE, FIRST_TREE, Forest, HALF, TILES, TREES, check, check_with_mask, is_group, rays_of_a_setting,
};
use crate::nested::{hits_of_a_picture, seen_from};
use glam::DVec3;
use outcrop::query::Hit;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Background, Camera, Context, SceneState};
use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

type Tint = [u8; 4];

/// Two tints with the same little blue, and one that is blue.
const WARM: [Tint; 2] = [[255, 51, 51, 255], [51, 255, 51, 255]];
const BLUE: Tint = [51, 51, 255, 255];

/// The linear colours of a picture.
fn colours(context: &Context, state: &Arc<SceneState>, camera: &Camera, poe: f32, samples: u32) -> Vec<[f32; 3]> {
    let outputs = Outputs::of(Buffer::ColourLinear);
    let frame = Frame::new(context, FrameOptions { width: 90, height: 70, outputs, ..FrameOptions::default() });
    let frame = frame.expect("a frame");
    frame.request(state, camera, &FrameSettings { poe, samples, ..FrameSettings::default() }).expect("a request");
    assert_eq!(frame.wait(Duration::from_secs(300)).state, FrameState::Converged);
    let bytes = frame.map(Buffer::ColourLinear).expect("a buffer").bytes().to_vec();
    let float = |it: &[u8]| f32::from_le_bytes([it[0], it[1], it[2], it[3]]);
    bytes.chunks_exact(16).map(|it| [0, 4, 8].map(|at| float(&it[at..]))).collect()
}

/// The shares of red, green and blue in the light of a picture. (Its sum may differ: groups of twigs cover more.)
fn shares(all: &[[f32; 3]]) -> [f64; 3] {
    let sums = [0, 1, 2].map(|i| all.iter().map(|it| f64::from(it[i])).sum::<f64>());
    sums.map(|sum| sum / sums.iter().sum::<f64>())
}

/// The forest with black around it; trees of two tints, or tiles.
fn forest(context: &Context, of_tiles: bool) -> Forest {
    let forest = Forest::around(context, DVec3::ZERO);
    let tints = |count: usize| (0..count).map(|i| WARM[i % 2]).collect::<Vec<_>>();
    if of_tiles {
        forest.scene.set_tints(FIRST_TILE, &tints(TILES)).expect("tints");
    } else {
        forest.tile.set_tints(FIRST_TREE, &tints(TREES)).expect("tints");
        forest.tile.commit().expect("a commit");
    }
    forest.scene.set_background(Background::Colour([0.0; 4])).expect("black");
    forest.scene.commit().expect("a commit");
    forest
}

fn view(forest: &Forest, away: f64) -> Camera {
    let eye = forest.middle() + DVec3::new(0.3, -1.0, 0.8) * HALF * 8.0 * away;
    seen_from(eye, forest.middle(), 40.0)
}

/// The hits of a picture's pixels, and how many are on groups.
fn groups(context: &Context, forest: &Forest, camera: &Camera, poe: f32) -> (Vec<Hit>, usize) {
    let hits = hits_of_a_picture(context, &forest.scene.state(), camera, poe);
    let groups = hits.iter().filter(|hit| is_group(hit)).count();
    (hits, groups)
}

/// A group is in a colour between those of its trees. A mean over the picture is close to that of triangles.
#[test]
fn tinted_groups_stand_in_between_their_colours() {
    let context = built::context(2);
    let forest = forest(&context, false);
    let plain = Forest::around(&context, DVec3::ZERO);
    let (away, poe) = (3.0, 40.0);
    let camera = view(&forest, away);
    let ((hits, tinted), without) = (groups(&context, &forest, &camera, poe), groups(&context, &plain, &camera, poe).1);
    assert!(tinted > 100 && 10 * tinted > 9 * without, "{tinted} pixels show groups, without tints {without}");
    let state = forest.scene.state();
    let shown = colours(&context, &state, &camera, poe, 1);
    for (hit, [r, g, b]) in hits.iter().zip(&shown).filter(|it| is_group(it.0)) {
        // White in the light, times a mean of the tints: red and green are together six times the blue.
        let sum = (r + g) / 6.0;
        assert!((b - sum).abs() <= 0.05 * sum + 0.01, "{hit:?}: {r} {g} {b}");
        let (low, high) = (r.min(*g), r.max(*g));
        assert!(low >= 0.9 * b - 0.01 && high <= 5.3 * b + 0.02, "{hit:?}: {r} {g} {b}");
    }
    let all = shares(&colours(&context, &state, &camera, poe, 2));
    let exact = shares(&colours(&context, &state, &camera, 0.0, 2));
    println!("PoE {poe}: {tinted} pixels of groups; shown {all:.3?}, exact {exact:.3?}");
    // Blue is the same part of each tint; the others depend on the trees that are seen most. Without tints in
    // the cells, all would be a third.
    for ((all, exact), most) in all.iter().zip(exact).zip([0.15, 0.15, 0.05]) {
        assert!((all / exact - 1.0).abs() < most, "{all} {exact}");
    }
}

/// After few tints have changed, what is shown has them: groups in the colours of before do not stand in.
#[test]
fn tints_that_changed_are_shown() {
    let context = built::context(2);
    for of_tiles in [false, true] {
        let forest = forest(&context, of_tiles);
        let camera = view(&forest, 4.0);
        let before = shares(&colours(&context, &forest.scene.state(), &camera, 60.0, 4));
        for i in 0..4 {
            if of_tiles {
                forest.scene.set_tints(FIRST_TILE + 11 * i, &[BLUE]).expect("tints");
            } else {
                forest.tile.set_tints(FIRST_TREE + 20 * i, &[BLUE; 2]).expect("tints");
            }
        }
        forest.tile.commit().expect("a commit");
        forest.scene.commit().expect("a commit");
        let state = forest.scene.state();
        let [shown, exact] = [60.0, 0.0].map(|poe| shares(&colours(&context, &state, &camera, poe, 4)));
        println!("tiles: {of_tiles}, blue before {:.3}, shown {:.3}, exact {:.3}", before[2], shown[2], exact[2]);
        assert!(exact[2] > 1.15 * before[2], "the change is to be seen");
        // In the colours of before all would have the blue of before. Other groups cover more than single trees do.
        let share = (shown[2] - before[2]) / (exact[2] - before[2]);
        assert!(share > 0.4 && share < 1.1, "the share of the change that is shown: {share}");
        let (_, groups) = groups(&context, &forest, &camera, 60.0);
        assert!(groups > 20 || !of_tiles, "{groups} pixels show groups");
    }
}

/// Members that no ray sees are in no group; those that some see are met by these, and no others are met by the rest.
#[test]
fn rays_meet_no_groups_of_members_that_they_do_not_see() {
    let context = built::context(2);
    let forest = Forest::around(&context, DVec3::ZERO);
    let mut hidden = HashSet::new();
    for tree in [3, 40, 41] {
        forest.tile.set_masks(FIRST_TREE + tree as u64, &[0]).expect("masks");
        hidden.extend((0..TILES).map(|tile| tile * TREES + tree));
    }
    forest.tile.commit().expect("a commit");
    forest.scene.commit().expect("a commit");
    check("masked in all tiles", &forest, &hidden, rays_of_a_setting() / 6);
    for tile in [7, 20] {
        forest.scene.set_masks(FIRST_TILE + tile as u64, &[0]).expect("masks");
        hidden.extend((0..TREES).map(|tree| tile * TREES + tree));
    }
    forest.scene.commit().expect("a commit");
    let few = check("masked", &forest, &hidden, rays_of_a_setting());
    assert!(few.len() > 1000, "{} hits on groups", few.len());
    // Many at once: the tree is built anew.
    let half: Vec<u32> = (0..TILES).map(|tile| if tile < TILES / 2 { 0 } else { u32::MAX }).collect();
    forest.scene.set_masks(FIRST_TILE, &half).expect("masks");
    forest.scene.commit().expect("a commit");
    let mut hidden: HashSet<usize> = (0..TILES / 2 * TREES).collect();
    for tree in [3, 40, 41] {
        hidden.extend((0..TILES).map(|tile| tile * TREES + tree));
    }
    let many = check("masked anew", &forest, &hidden, rays_of_a_setting() / 2);
    assert!(many.len() > 500, "{} hits on groups", many.len());
    let away: Vec<u32> = (0..TILES as u32).map(|tile| 1 + tile % 2).collect();
    forest.scene.set_masks(FIRST_TILE, &away).expect("masks");
    forest.tile.set_masks(FIRST_TREE, &[u32::MAX; TREES]).expect("masks");
    forest.tile.commit().expect("a commit");
    forest.scene.commit().expect("a commit");
    let seen_by_all = check("of two masks", &forest, &HashSet::new(), rays_of_a_setting() / 2);
    assert!(seen_by_all.len() > 500, "groups within tiles stand in: {}", seen_by_all.len());
    let odd: HashSet<usize> = (0..TILES * TREES).filter(|at| at / TREES % 2 == 1).collect();
    let of_one = check_with_mask("of one mask", &forest, &odd, rays_of_a_setting() / 2, 1);
    assert!(of_one.len() > 500, "groups within tiles stand in: {}", of_one.len());
}
