use super::tiles::{COUNT, Edges, LEAST_SIDE, edges, number};
use super::*;

/// Sides of tiles in least distances, from the least on.
const SIDES: [f64; 4] = [LEAST_SIDE, 4.0, 6.3, 12.0];
/// Coordinates of points of other tiles are rounded.
const ROUNDED: f64 = 1.0 - 1e-12;

fn made(side: f64, seed: u64) -> Vec<Vec<DVec2>> {
    tiles::tiles(side, 1.0, seed, &Cancel::new()).unwrap()
}

fn forest(trees: u64, seed: u64) -> Forest {
    let options = ForestOptions { trees, seed, ..ForestOptions::default() };
    Forest::plant(&options, &Cancel::new()).unwrap()
}

/// Distance of the nearest two points of two tiles, of which the second is moved.
fn least(a: &[DVec2], b: &[DVec2], moved: DVec2) -> f64 {
    let pairs = a.iter().flat_map(|p| b.iter().map(move |q| p.distance(*q + moved)));
    pairs.fold(f64::INFINITY, f64::min)
}

#[test]
fn trees_of_a_tile_keep_their_distance() {
    for side in SIDES {
        for seed in 0..4 {
            for tile in made(side, seed) {
                for (i, p) in tile.iter().enumerate() {
                    assert!(p.cmpge(DVec2::ZERO).all() && p.cmple(DVec2::splat(side)).all());
                    assert!(least(&[*p], &tile[..i], DVec2::ZERO) >= ROUNDED, "{side} {seed} {i}");
                }
            }
        }
    }
}

/// Brute force over all pairs of tiles that may be neighbours. Any two tiles may have a corner in common.
#[test]
fn trees_of_neighbours_keep_their_distance() {
    for side in SIDES {
        for seed in 0..3 {
            let tiles = made(side, seed);
            for (a, b) in (0..COUNT).flat_map(|a| (0..COUNT).map(move |b| (a, b))) {
                let [[_, right, _, upper], [left, _, lower, _]] = [edges(a), edges(b)];
                let mut moves = vec![[side, side], [side, -side]];
                moves.extend((right == left).then_some([side, 0.0]));
                moves.extend((upper == lower).then_some([0.0, side]));
                for moved in moves {
                    let found = least(&tiles[a], &tiles[b], moved.into());
                    assert!(found >= ROUNDED, "{side} {seed}: tiles {a}, {b} moved by {moved:?}: {found}");
                }
            }
        }
    }
}

#[test]
fn edges_of_neighbours_match_and_all_tiles_occur() {
    for tile in 0..COUNT {
        assert_eq!(number(edges(tile)), tile);
    }
    for seed in 0..5 {
        let mut seen = [0u32; COUNT];
        let at = |column, row| -> Edges { edges(tile_at(seed, column, row)) };
        for (column, row) in (0..80).flat_map(|row| (0..80).map(move |column| (column, row))) {
            let [_, right, _, upper] = at(column, row);
            assert_eq!(right, at(column + 1, row)[0]);
            assert_eq!(upper, at(column, row + 1)[2]);
            seen[tile_at(seed, column, row)] += 1;
        }
        // 400 of each on average, with a standard deviation of about 20.
        assert!(seen.iter().all(|n| (300..500).contains(n)), "{seen:?}");
    }
}

/// The trees of a forest of 6 by 6 tiles, by squares of the least distance, and their number.
fn gridded(side: f64, seed: u64) -> (Vec<Vec<DVec2>>, usize, u32) {
    const ACROSS: u32 = 6;
    let tiles = made(side, seed);
    let width = (side * f64::from(ACROSS)).ceil() as usize + 1;
    let (mut grid, mut trees) = (vec![Vec::new(); width * width], 0);
    for (column, row) in (0..ACROSS).flat_map(|row| (0..ACROSS).map(move |column| (column, row))) {
        for p in &tiles[tile_at(seed, column, row)] {
            let p = *p + DVec2::new(column.into(), row.into()) * side;
            grid[p.y as usize * width + p.x as usize].push(p);
            trees += 1;
        }
    }
    (grid, width, trees)
}

/// In a forest of many tiles no further tree fits in: no place is farther from all trees than the least distance. That
/// makes it a maximal packing. Its density, on average over seeds, is that of discs placed at random one after the
/// other, within 3 % for the order in which regions are filled: 0.547 of the area with half of the distance as radius.
#[test]
fn no_further_tree_fits_in() {
    for side in SIDES {
        const SEEDS: u64 = 12;
        let mut trees = 0.0;
        for seed in 0..SEEDS {
            let (grid, width, found) = gridded(side, seed);
            trees += f64::from(found);
            let mut rng = Rng::new(seed);
            for _ in 0..20_000 {
                let p = DVec2::new(rng.range(1.0, 6.0 * side - 1.0), rng.range(1.0, 6.0 * side - 1.0));
                let [x, y] = [p.x as usize, p.y as usize];
                let rows = y - 1..=y + 1;
                let mut near = rows.flat_map(|y| grid[y * width + x - 1..=y * width + x + 1].iter().flatten());
                assert!(near.any(|q| q.distance(p) < 1.0 + 1e-6), "{side}: a tree fits in at {p}");
            }
        }
        let density = trees / (SEEDS as f64 * 36.0 * side * side);
        println!("side {side}: {density:.4} trees in a square of the least distance");
        assert!((density / 0.6965 - 1.0).abs() < 0.03, "{side}: {density}");
    }
}

#[test]
fn counts_are_within_one_percent() {
    for (trees, seeds) in [(100, 4), (137, 4), (1_000, 4), (2_000, 4), (9_999, 2), (300_000, 1), (40_000_000, 1)] {
        for seed in 0..seeds {
            let forest = forest(trees, seed);
            let found = forest.trees();
            assert!((found as f64 / trees as f64 - 1.0).abs() <= 0.01, "{trees} {seed}: {found}");
            let across = forest.across();
            let cells = (0..across).flat_map(|row| (0..across).map(move |column| (column, row)));
            let counted: usize = cells.map(|(column, row)| forest.tiles()[forest.tile_at(column, row)].len()).sum();
            assert_eq!(counted as u64, found);
        }
    }
}

/// Trees of the whole forest, in its own coordinates, keep the distance in metres, about its middle.
#[test]
fn a_forest_is_its_tiles_side_by_side() {
    let options = ForestOptions { trees: 2_000, spacing: 3.5, species: 4, seed: 11 };
    let forest = Forest::plant(&options, &Cancel::new()).unwrap();
    let across = forest.across();
    let cells = (0..across).flat_map(|row| (0..across).map(move |column| (column, row)));
    let places: Vec<DVec2> = cells
        .flat_map(|(column, row)| {
            let middle = forest.middle_of(column, row);
            forest.tiles()[forest.tile_at(column, row)].iter().map(move |tree| middle + tree.place)
        })
        .collect();
    assert_eq!(places.len() as u64, forest.trees());
    let half = 0.5 * forest.side() * f64::from(across);
    for (i, p) in places.iter().enumerate() {
        assert!(p.abs().max_element() <= half * (1.0 + 1e-12));
        assert!(least(&[*p], &places[..i], DVec2::ZERO) >= 3.5 * ROUNDED, "{i}");
    }
    let mean = places.iter().sum::<DVec2>() / places.len() as f64;
    assert!(mean.abs().max_element() < 0.05 * half, "{mean}");
}

#[test]
fn trees_differ_in_species_turn_and_size() {
    let forest = forest(50_000, 3);
    let mut species = [0u32; plant::COUNT];
    let mut turns = [0u32; 8];
    let mut trees = 0;
    for tree in forest.tiles().iter().flatten() {
        assert!((0.7..=1.3).contains(&tree.scale), "{}", tree.scale);
        let [x, y, z, w] = tree.rotation.map(f64::from);
        assert!(x == 0.0 && y == 0.0 && (z * z + w * w - 1.0).abs() < 1e-6);
        turns[((2.0 * z.atan2(w)).rem_euclid(std::f64::consts::TAU) * 8.0 / std::f64::consts::TAU) as usize % 8] += 1;
        species[tree.species as usize] += 1;
        trees += 1;
    }
    // Each is within 5 standard deviations of its mean.
    let near = |n: u32, of: u32| (f64::from(n) - f64::from(trees / of)).abs() < 5.0 * f64::from(trees / of).sqrt();
    assert!(species.iter().all(|n| near(*n, 13)), "{species:?}");
    assert!(turns.iter().all(|n| near(*n, 8)), "{turns:?}");
}

/// FNV-1a over the bits of a forest.
fn hash(forest: &Forest) -> u64 {
    let trees = forest.tiles().iter().flatten().flat_map(|tree| {
        let [z, w] = [tree.rotation[2], tree.rotation[3]].map(f32::to_bits);
        let small = [tree.species, tree.scale.to_bits(), z, w].map(u64::from);
        tree.place.to_array().map(f64::to_bits).into_iter().chain(small)
    });
    let numbers = [u64::from(forest.across()), forest.side().to_bits()].into_iter().chain(trees);
    let bytes = numbers.flat_map(u64::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, b| (hash ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

/// The number was computed once, with this code: the same options give the same bits on every machine.
#[test]
fn seeds_make_forests() {
    let (one, same, other) = (forest(20_000, 1), forest(20_000, 1), forest(20_000, 2));
    assert_eq!(one, same);
    assert_ne!(one.tiles(), other.tiles());
    assert_eq!(hash(&one), 0x28e0_789f_07ec_e0be, "{:#x}", hash(&one));
}

#[test]
fn bad_options_are_refused() {
    let good = ForestOptions::default();
    for (bad, why) in [
        (ForestOptions { trees: 99, ..good }, "number of trees"),
        (ForestOptions { trees: 1_000_000_000_001, ..good }, "number of trees"),
        (ForestOptions { spacing: 0.0, ..good }, "spacing"),
        (ForestOptions { spacing: f64::NAN, ..good }, "spacing"),
        (ForestOptions { spacing: 1e5, ..good }, "spacing"),
        (ForestOptions { species: 0, ..good }, "species must be from 1 to 13"),
        (ForestOptions { species: 14, ..good }, "species must be from 1 to 13"),
    ] {
        let refused = Forest::plant(&bad, &Cancel::new());
        assert!(matches!(refused, Err(Error::BadArgument(text)) if text.contains(why)), "{bad:?}");
    }
    let cancel = Cancel::new();
    cancel.cancel();
    assert!(matches!(Forest::plant(&good, &cancel), Err(Error::Cancelled)));
}

#[test]
#[ignore = "a measurement: run alone, with --nocapture"]
fn time_of_forests() {
    for trees in [2_000, 1_000_000, 40_000_000, 1_000_000_000] {
        let start = std::time::Instant::now();
        let forest = forest(trees, 0);
        println!("{trees}: {} trees, {} tiles across, {:?}", forest.trees(), forest.across(), start.elapsed());
    }
}
