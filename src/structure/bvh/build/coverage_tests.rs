//! Tests of the shares of rays that cells stop, against closed forms and random lines counted in double precision.

use super::super::{refs, tree};
use super::*;
use crate::base::progress::{Cancel, Progress};
use glam::{DVec3, Vec3};

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn inside(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    fn direction(&mut self) -> DVec3 {
        loop {
            let at = self.inside();
            if at.length_squared() <= 1.0 && at.length_squared() > 1e-6 {
                return at.normalize();
            }
        }
    }
}

/// Returns a built tree, marked; fails as [`mark`] does.
fn marked(
    beside: Beside,
    triangles: &[[Vec3; 3]],
    isa: Isa,
    threads: usize,
    cancel: &Cancel,
) -> Result<(Vec<Piece>, Vec<Ref>)> {
    let parts = vec![0; triangles.len()];
    let prims: Vec<u32> = (0..triangles.len() as u32).collect();
    let input = TreeInput { triangles, parts: &parts, prims: &prims, colours: &[], normals: &[], part_colours: &[] };
    let par = Par { threads };
    let mut refs = refs::make(triangles, 0.5, &par).expect("room");
    let (progress, free) = (Progress::default(), Cancel::new());
    let built = tree::build(input, &mut refs, 0.0, &par, &Stretch::new(&progress, &free, (0.0, 1.0))).expect("a tree");
    let mut pieces = vec![InnerNode::over(built.children, tree::Place::Above)];
    mark_with(beside, &mut pieces, input, &refs, isa, &par, &Stretch::new(&progress, cancel, (0.0, 1.0)))?;
    Ok((pieces, refs))
}

/// Returns each cell, with the share of rays that it stops.
fn stops(pieces: &[Piece]) -> Vec<(f64, Cell<'_>)> {
    let (mut cells, mut words) = (Vec::new(), Vec::new());
    for piece in pieces {
        let Sub::InnerNode(inner) = &piece.sub else { panic!("a piece is an inner node") };
        all_cells(inner, &mut cells);
        first_words(inner, &mut words);
    }
    let share = |word: &u32| match crate::lod::stopped(*word) {
        0 => 1.0,
        stopped => f64::from(stopped) / 4096.0,
    };
    words.iter().map(share).zip(cells).collect()
}

fn first_words(inner: &InnerNode, out: &mut Vec<u32>) {
    for (coded, sub) in &inner.children {
        out.push(coded.words[0]);
        match sub {
            // Both are one cell, as in `cells`, and have one share.
            Sub::InnerNode(over) if lone_leaf(sub).is_some() => {
                assert_eq!(crate::lod::stopped(over.children[0].0.words[0]), crate::lod::stopped(coded.words[0]));
            }
            Sub::InnerNode(below) => first_words(below, out),
            _ => {}
        }
    }
}

fn quad(at: Vec3, u: Vec3, v: Vec3) -> [[Vec3; 3]; 2] {
    [[at, at + u, at + u + v], [at, at + u + v, at + v]]
}

/// Squares on a unit grid in random orientations, so small that hardly one is behind another.
fn cards(side: usize) -> Vec<[Vec3; 3]> {
    let mut random = Random(5);
    let mut out = Vec::new();
    for i in 0..side * side * side {
        let at = Vec3::new((i % side) as f32, (i / side % side) as f32, (i / side / side) as f32);
        let (u, v) = random.direction().as_vec3().any_orthonormal_pair();
        out.extend(quad(at, u * 0.2, v * 0.2));
    }
    out
}

/// Separate cubes: cells that hold one are full.
fn boxes(side: usize) -> Vec<[Vec3; 3]> {
    let one = |i: usize| {
        let at = Vec3::new((i % side) as f32, (i / side % side) as f32, (i / side / side) as f32);
        let [x, y, z] = Vec3::AXES.map(|axis| axis * 0.25);
        [quad(at, x, y), quad(at + z, y, x), quad(at, y, z), quad(at + x, z, y), quad(at, z, x), quad(at + y, x, z)]
            .into_iter()
            .flatten()
    };
    (0..side * side * side).flat_map(one).collect()
}

fn best(triangles: &[[Vec3; 3]]) -> (Vec<Piece>, Vec<Ref>) {
    marked(BESIDE, triangles, Isa::best(), 2, &Cancel::new()).expect("marked")
}

/// Marks a tree; no line counts as stopped because of near surface.
fn alone(triangles: &[[Vec3; 3]]) -> (Vec<Piece>, Vec<Ref>) {
    marked(Beside { of_nodes: 0.0, of_larger: 0.0, of_leaves: 0.0 }, triangles, Isa::best(), 2, &Cancel::new())
        .expect("marked")
}

/// Returns the share of random lines through a cell's region that hit its content. The points of the lines are uniform
/// over a square across a random direction.
fn counted(cell: &Cell, triangles: &[[Vec3; 3]], refs: &[Ref], random: &mut Random) -> f64 {
    let (middle, radius) = (cell.bounds.center().as_dvec3(), f64::from(cell.bounds.extent().length()) * 0.5);
    let mut below = Vec::new();
    gather(cell.sub, refs, &mut below);
    let (mut all, mut met) = (0.0, 0.0);
    while all < 3000.0 {
        let dir = random.direction();
        let (u, v) = dir.any_orthonormal_pair();
        let (x, y) = (random.unit() * 2.0 - 1.0, random.unit() * 2.0 - 1.0);
        let org = middle + (u * x + v * y) * radius;
        let mut way = [f64::NEG_INFINITY, f64::INFINITY];
        let mut clip = |low: f64, high: f64, from: f64, along: f64| {
            let (a, b) = ((low - from) / along, (high - from) / along);
            way = [way[0].max(a.min(b)), way[1].min(a.max(b))];
        };
        for axis in 0..3 {
            clip(cell.bounds.min[axis].into(), cell.bounds.max[axis].into(), org[axis], dir[axis]);
        }
        for slab in &cell.slabs {
            let axis = Vec3::from(slab.axis).as_dvec3();
            clip(slab.low.into(), slab.high.into(), org.dot(axis), dir.dot(axis));
        }
        if way[0] < way[1] {
            all += 1.0;
            met += f64::from(u8::from(below.iter().any(|t| meets(org, dir, &triangles[*t]))));
        }
    }
    met / all
}

fn gather(sub: &Sub, refs: &[Ref], out: &mut Vec<usize>) {
    match sub {
        Sub::Leaf { first, count, .. } => {
            out.extend(refs[*first as usize..(first + count) as usize].iter().map(Ref::triangle))
        }
        Sub::InnerNode(inner) => inner.children.iter().for_each(|(_, sub)| gather(sub, refs, out)),
        Sub::Placed(_) => {}
    }
}

fn meets(org: DVec3, dir: DVec3, triangle: &[Vec3; 3]) -> bool {
    let [a, b, c] = triangle.map(|v| v.as_dvec3() - org);
    let volumes = [b.cross(c).dot(dir), c.cross(a).dot(dir), a.cross(b).dot(dir)];
    volumes.iter().all(|v| *v >= 0.0) || volumes.iter().all(|v| *v <= 0.0)
}

#[test]
fn sparse_cells_stop_the_share_that_random_lines_hit() {
    for triangles in [cards(14), boxes(14)] {
        let (pieces, refs) = alone(&triangles);
        let (mut random, mut ratios) = (Random(3), Vec::new());
        for (stops, cell) in stops(&pieces) {
            // A treelet's cell is tested with 32 lines, a larger one with some hundreds. Single results are random, the
            // mean is not.
            if cell.bounds.extent().min_element() > 1.0 {
                ratios.push(stops / counted(&cell, &triangles, &refs, &mut random));
            }
        }
        assert!(ratios.len() > 50, "{}", ratios.len());
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        // Few lines seldom include short ones, at corners.
        assert!((0.9..1.15).contains(&mean), "{mean}");
    }
}

/// Square rods in random directions, in pieces of a fiftieth of the space that they are in.
fn forest(wires: usize) -> Vec<[Vec3; 3]> {
    let mut random = Random(11);
    let mut out = Vec::new();
    for _ in 0..wires {
        let (from, along) = (random.inside().as_vec3(), random.direction().as_vec3());
        let (u, v) = along.any_orthonormal_pair();
        let (u, v, step) = (u * 0.004, v * 0.004, along * 0.04);
        for i in 0..16 {
            let at = from + step * i as f32;
            out.extend(
                [quad(at, step, u), quad(at + v, u, step), quad(at, v, step), quad(at + u, step, v)]
                    .into_iter()
                    .flatten(),
            );
        }
    }
    out
}

/// Leaves, and nodes of few and of more triangles: the mean of each class is not random.
#[test]
fn cells_of_wires_stop_the_share_that_random_lines_hit() {
    let triangles = forest(300);
    let (pieces, refs) = alone(&triangles);
    let mut random = Random(3);
    // Number of cells, share according to the codes, share counted, and the squares of the latter and of the
    // difference.
    let mut sums = [[0.0; 5]; 4];
    for (i, (stops, cell)) in stops(&pieces).into_iter().enumerate() {
        let mut below = Vec::new();
        gather(cell.sub, &refs, &mut below);
        let (class, each) = match (below.len(), cell.sub) {
            (_, Sub::Leaf { .. }) => (0, 24),
            (..32, _) => (1, 2),
            (..128, _) => (2, 1),
            (..1024, _) => (3, 1),
            _ => continue,
        };
        if i % each == 0 {
            let counted = counted(&cell, &triangles, &refs, &mut random);
            let here = [1.0, stops, counted, counted * counted, (stops - counted).powi(2)];
            sums[class].iter_mut().zip(here).for_each(|(sum, here)| *sum += here);
        }
    }
    let mut all = [0.0; 5];
    for [cells, stops, counted, squares, apart] in sums {
        assert!(cells > 100.0 && (0.9..1.1).contains(&(stops / counted)), "{stops}, {counted} of {cells}");
        all.iter_mut().zip([cells, stops, counted, squares, apart]).for_each(|(sum, here)| *sum += here);
    }
    // Each cell has its own code: if codes went to other cells, the differences would be twice the spread.
    let [cells, _, counted, squares, apart] = all;
    let spread = squares - counted * counted / cells;
    assert!(4.0 * apart < spread, "{apart} of {spread}");
}

#[test]
fn a_closed_wall_stops_all() {
    let wall = |i: usize| {
        quad(Vec3::new((i % 64) as f32, (i / 64) as f32, ((i * 7) % 5) as f32 * 1e-3), Vec3::X * 1.01, Vec3::Y * 1.01)
    };
    let (pieces, _) = best(&(0..64 * 64).flat_map(wall).collect::<Vec<_>>());
    let all = stops(&pieces);
    assert!(all.len() > 500);
    for (stops, cell) in all {
        assert_eq!(stops, 1.0, "{:?}", cell.bounds);
    }
}

/// A sphere with bumps, of `n` by `2 n` quads.
fn ball(n: usize) -> Vec<[Vec3; 3]> {
    let at = |i: usize, j: usize| {
        let (lat, lon) =
            (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::PI * (j % (2 * n)) as f32 / n as f32);
        let r = 1.0 + 0.05 * (9.0 * lat).sin() * (7.0 * lon).cos();
        Vec3::new(lat.sin() * lon.cos(), lat.sin() * lon.sin(), lat.cos()) * r
    };
    let quads = (0..n).flat_map(|i| (0..2 * n).map(move |j| (i, j)));
    let two = |(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]];
    quads.flat_map(two).filter(|t| (t[1] - t[0]).cross(t[2] - t[0]).length() > 0.0).collect()
}

#[test]
fn a_closed_ball_stops_all() {
    for n in [6, 8, 12, 16, 24, 60, 100] {
        let (pieces, _) = best(&ball(n));
        for (stops, cell) in stops(&pieces) {
            assert_eq!(stops, 1.0, "{n}: {:?}", cell.bounds);
        }
    }
}

/// Returns the share of cells that are loose.
fn loose(triangles: &[[Vec3; 3]]) -> f64 {
    let ((pieces, _), mut words) = (best(triangles), Vec::new());
    inners(&pieces).for_each(|inner| first_words(inner, &mut words));
    words.iter().filter(|word| crate::lod::is_loose(**word)).count() as f64 / words.len() as f64
}

/// Cards are free at their edges, in dense heaps too. Faces of cubes and balls are not, and a grid is so at its border
/// only.
#[test]
fn cards_are_loose_and_closed_surfaces_are_not() {
    let heap: Vec<_> = cards(12).iter().map(|t| t.map(|v| v * Vec3::new(0.2, 0.2, 0.05))).collect();
    for (name, triangles) in [("cards", cards(12)), ("heap", heap)] {
        let share = loose(&triangles);
        assert!(share > 0.9, "{name}: {share}");
    }
    let grid: Vec<_> = (0..100 * 100)
        .flat_map(|i| quad(Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0), Vec3::X, Vec3::Y))
        .collect();
    for (name, triangles) in [("boxes", boxes(12)), ("ball", ball(100)), ("grid", grid)] {
        let share = loose(&triangles);
        assert!(share < 0.02, "{name}: {share}");
    }
}

/// Visits a node's children and everything below. Appends the number of triangles of each treelet, and counts larger
/// ranges, treelets of several children, and leaves under a node of their own.
fn look(inner: &InnerNode, refs: &[Ref], treelets: &mut Vec<usize>, seen: &mut [usize; 3]) {
    let mut below = Vec::new();
    for slots in runs(inner) {
        let held = |slot: usize, out: &mut Vec<usize>| {
            out.clear();
            gather(&inner.children[slot].1, refs, out);
            out.len()
        };
        if let Some(larger) = above_treelets(inner, slots[0]) {
            assert!(held(slots[0], &mut below) > tree::TREELET && slots[1] == slots[0] + 1);
            seen[0] += 1;
            look(larger, refs, treelets, seen);
            continue;
        }
        treelets.push((slots[0]..slots[1]).map(|slot| held(slot, &mut below)).sum());
        seen[1] += usize::from(slots[1] > slots[0] + 1);
        seen[2] += (slots[0]..slots[1]).filter(|slot| lone_leaf(&inner.children[*slot].1).is_some()).count();
    }
}

#[test]
fn treelets_are_of_limited_size_and_hold_all_triangles() {
    let mut seen = [0; 3];
    for (triangles, least) in [(forest(300), 150), (ball(60), 60), (ball(6), 1), (ball(100), 160)] {
        let (pieces, refs) = best(&triangles);
        let mut treelets = Vec::new();
        inners(&pieces).for_each(|inner| look(inner, &refs, &mut treelets, &mut seen));
        // Splits repeat some triangles.
        assert!(
            treelets.len() >= least && treelets.iter().all(|n| (1..=tree::TREELET * 5 / 4).contains(n)),
            "{treelets:?}"
        );
        assert!(treelets.iter().sum::<usize>() >= triangles.len());
    }
    assert!(seen.iter().all(|n| *n > 10), "{seen:?}");
}

#[test]
fn the_codes_are_the_same_with_any_vectors_and_threads() {
    // Walls, cells that transmit rays, and ranges larger than small subtrees.
    let triangles = [cards(14), ball(60)].concat();
    let codes = |isa, threads| {
        let (pieces, _) = marked(BESIDE, &triangles, isa, threads, &Cancel::new()).expect("marked");
        let mut words = Vec::new();
        pieces.iter().for_each(|p| {
            if let Sub::InnerNode(inner) = &p.sub {
                first_words(inner, &mut words)
            }
        });
        words
    };
    let expected = codes(Isa::Baseline, 1);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        for threads in [1, 2] {
            assert!(codes(isa, threads) == expected, "{isa:?}, {threads} threads");
        }
    }
}

#[test]
fn marking_can_be_cancelled() {
    let cancel = Cancel::new();
    cancel.cancel();
    let ends = marked(BESIDE, &cards(5), Isa::best(), 1, &cancel);
    assert!(matches!(ends, Err(crate::Error::Cancelled)));
}

#[test]
fn cells_without_lines_stop_all() {
    assert_eq!(Asked::default().code(BESIDE.of_nodes), 0);
    assert!(!Asked::default().is_wall(FOUND));
    let half = Asked { all: 8.0, transmitted: 4.0, sought: 4.0, found: 0.0 };
    assert_eq!((half.stops(BESIDE.of_nodes), half.is_wall(FOUND)), (0.5, false));
    // No line passes: the cell stops all rays, and is a wall by itself.
    let none = Asked { all: 8.0, ..Asked::default() };
    assert_eq!((none.code(BESIDE.of_nodes), none.is_wall(FOUND)), (0, true));
}
