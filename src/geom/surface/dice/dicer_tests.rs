//! Tiles against the triangles of `dice`, and against each other.

use super::tests::{Ridge, Round, is_closed};
use super::*;
use crate::geom::surface::cage::tests::shapes::{Rng, Shape, fan, grid};
use crate::geom::surface::cage::{CageQuads, Displacement, INFINITE};
use crate::geom::surface::displacement::{Heights, Wrap};
use crate::geom::surface::nurbs::NurbsQuads;
use crate::geom::surface::nurbs::tests::{Owned, rng, sphere};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicUsize, Ordering};

type Triangle = ([DVec3; 3], [Vec3; 3]);
type Bits = ([[u64; 3]; 3], [[u32; 3]; 3]);

fn position_bits(p: DVec3) -> [u64; 3] {
    p.to_array().map(f64::to_bits)
}

fn bits((positions, normals): &Triangle) -> Bits {
    (positions.map(position_bits), normals.map(|n| n.to_array().map(f32::to_bits)))
}

fn sorted(triangles: &[Triangle]) -> Vec<Bits> {
    let mut all: Vec<_> = triangles.iter().map(bits).collect();
    all.sort_unstable();
    all
}

/// The grid of a quad from its tiles, row by row. Samples that tiles share have the same bits.
fn grid_of<Q: Quads>(dicer: &Dicer<'_, Q>, quad: usize, level: u32, tile_level: u32) -> Vec<(DVec3, Vec3)> {
    let (width, side, mut tile) = ((1usize << level) + 1, 1usize << tile_level, Tile::default());
    let mut all = vec![None; width * width];
    let along = 1u32 << (level - tile_level);
    for (i, j) in (0..along * along).rev().map(|n| (n % along, n / along)) {
        dicer.tile(quad, level, tile_level, i, j, &mut tile);
        assert_eq!([tile.positions.len(), tile.normals.len()], [(side + 1) * (side + 1); 2]);
        for (n, sample) in tile.positions.iter().copied().zip(tile.normals.iter().copied()).enumerate() {
            let (column, row) = (i as usize * side + n % (side + 1), j as usize * side + n / (side + 1));
            let before = all[row * width + column].replace(sample);
            let same = |it: (DVec3, Vec3)| (position_bits(it.0), it.1.to_array().map(f32::to_bits));
            assert!(before.is_none_or(|it| same(it) == same(sample)), "quad {quad}, column {column}, row {row}");
        }
    }
    all.into_iter().map(|it| it.expect("a sample of a tile")).collect()
}

fn triangles_of(grid: &[(DVec3, Vec3)]) -> Vec<Triangle> {
    let (width, mut all) = (grid.len().isqrt(), Vec::new());
    for first in (0..width - 1).flat_map(|j| (0..width - 1).map(move |i| j * width + i)) {
        for corners in [[first, first + 1, first + width + 1], [first, first + width + 1, first + width]] {
            let [p, q, r] = corners.map(|at| grid[at].0);
            if p != q && q != r && r != p {
                all.push(([p, q, r], corners.map(|at| grid[at].1)));
            }
        }
    }
    all
}

/// Both quads of an edge have the same points on it, and all quads around a vertex have the same point there.
fn check_borders(surface: &impl Quads, grids: &[Vec<(DVec3, Vec3)>]) {
    let (mut edges, mut vertices) = (HashMap::new(), HashMap::new());
    for (quad, grid) in grids.iter().enumerate() {
        let width = grid.len().isqrt();
        let ends = [0, width - 1, width * (width - 1), width * width - 1];
        for (vertex, at) in surface.corners(quad).into_iter().zip(ends) {
            let point = position_bits(grid[at].0);
            assert_eq!(*vertices.entry(vertex).or_insert(point), point, "quad {quad}, vertex {vertex}");
        }
        for (which, side) in surface.sides(quad).into_iter().enumerate() {
            let (first, step) = [(0, 1), (ends[2], 1), (0, width), (ends[1], width)][which];
            let mut points: Vec<_> = (0..width).map(|i| position_bits(grid[first + i * step].0)).collect();
            points.dedup();
            if side.is_reversed {
                points.reverse();
            }
            assert_eq!(*edges.entry(side.edge).or_insert_with(|| points.clone()), points, "quad {quad}, side {which}");
        }
    }
}

/// Compares tiles of all sizes, made by three threads, with the triangles of `dice`, and returns those of all grids and
/// the number of quads of level 0, which have none to compare.
fn check(surface: &impl Quads, dicing: Dicing) -> (Vec<Triangle>, usize) {
    let (cancel, mut diced) = (Cancel::new(), vec![Vec::new(); surface.count()]);
    let mut emit = |quad: usize, micro: &Micro| {
        diced[quad].extend(micro.positions.iter().copied().zip(micro.normals.iter().copied()));
        Ok(())
    };
    dice(surface, dicing, &cancel, &mut emit).expect("triangles");
    let dicer = Dicer::new(surface, dicing, &cancel).expect("edges");
    let checked = |quad: usize| {
        let (level, is_lifted) = (dicer.level(quad), dicer.level_of_rule(quad) == 0);
        assert_eq!(level, dicer.level_of_rule(quad).max(1));
        for tile_level in 0..=level {
            let grid = grid_of(&dicer, quad, level, tile_level);
            let is_equal = is_lifted || sorted(&triangles_of(&grid)) == sorted(&diced[quad]);
            assert!(is_equal, "{dicing:?}, quad {quad}, level {level}, tiles of level {tile_level}");
        }
        (grid_of(&dicer, quad, level, level.min(2)), is_lifted)
    };
    let checked = &checked;
    let of_thread = |thread: usize| (thread..surface.count()).step_by(3).map(|it| (it, checked(it))).collect();
    let mut all: Vec<_> = std::thread::scope(|scope| {
        let threads = [0, 1, 2].map(|thread| scope.spawn(move || -> Vec<_> { of_thread(thread) }));
        threads.into_iter().flat_map(|it| it.join().expect("a thread that ends")).collect()
    });
    all.sort_by_key(|(quad, _)| *quad);
    let lifted = all.iter().filter(|(_, (_, is_lifted))| *is_lifted).count();
    let grids: Vec<_> = all.into_iter().map(|(_, (grid, _))| grid).collect();
    check_borders(surface, &grids);
    (grids.iter().flat_map(|grid| triangles_of(grid)).collect(), lifted)
}

/// A closed prism over a pentagon with creases of all kinds.
fn prism() -> Shape {
    let ring = |z: f64| {
        (0..5).map(move |i| {
            let (sin, cos) = (f64::from(i) * TAU / 5.0).sin_cos();
            DVec3::new(cos, sin, z)
        })
    };
    let (mut sizes, mut indices) = (vec![5, 5], vec![4, 3, 2, 1, 0, 5, 6, 7, 8, 9]);
    for i in 0..5 {
        let next = (i + 1) % 5;
        sizes.push(4);
        indices.extend([i, next, next + 5, i + 5]);
    }
    let creases = vec![(5, 6, INFINITE), (6, 7, INFINITE), (0, 5, 1.5), (2, 3, 3.0)];
    Shape { sizes, indices, points: ring(0.0).chain(ring(1.3)).collect(), creases, corners: vec![(8, 2.5)] }
}

fn heights(count: u32, seed: u64) -> Heights {
    let mut rng = Rng(seed);
    let texels = (0..64 * count).map(|_| rng.unit() as f32).collect();
    Heights::new([8, 8], count, [Wrap::Clamp; 2], texels).expect("heights")
}

#[test]
fn tiles_of_cages_are_those_of_their_triangles() {
    let mut rng = Rng(5);
    let mut star = fan(7, 2, &mut rng);
    star.creases = vec![(0, 1, INFINITE), (0, 5, 2.5), (0, 9, 0.5)];
    for shape in [prism(), star, grid(2, &mut rng)] {
        let cage = shape.cage();
        let quads = CageQuads::new(&cage, &shape.points, None).expect("quads");
        for dicing in [Dicing::Level(1), Dicing::Level(3), Dicing::Tolerance(0.02)] {
            check(&quads, dicing);
        }
    }
}

#[test]
fn tiles_of_displaced_cages_are_those_of_their_triangles() {
    // A map over all faces, with seams in its coordinates, and a grid for each face: both tear at edges.
    let (mut rng, shape) = (Rng(6), prism());
    let coordinates: Vec<_> = shape.indices.iter().map(|_| [rng.unit(), rng.unit()]).collect();
    let plate = grid(2, &mut rng);
    for (shape, heights, coordinates) in [(shape, heights(1, 7), coordinates), (plate, heights(4, 8), Vec::new())] {
        let (cage, scale) = (shape.cage(), 0.05);
        let displacement = Displacement { heights: &heights, scale, coordinates: &coordinates };
        let quads = CageQuads::new(&cage, &shape.points, Some(displacement)).expect("quads");
        for dicing in [Dicing::Level(2), Dicing::Tolerance(0.05)] {
            check(&quads, dicing);
        }
    }
}

#[test]
fn tiles_of_nurbs_are_those_of_their_triangles() {
    let mut rng = rng::Rng::new(9);
    let surfaces = [sphere(), Owned::random(&mut rng, 3, false), Owned::random(&mut rng, 3, true)];
    for surface in surfaces.map(|it| it.surface()) {
        let quads = NurbsQuads::new(&surface, None);
        for dicing in [Dicing::Level(3), Dicing::Tolerance(0.02)] {
            check(&quads, dicing);
        }
    }
}

/// Fine quads beside coarse ones, of which one is lifted, and quads that differ at their edges.
#[test]
fn tiles_meet_at_edges_of_other_levels() {
    let (_, lifted) = check(&Ridge, Dicing::Tolerance(1e-3));
    assert_eq!(lifted, 1);
    for is_sphere in [false, true] {
        let surface = Round { across: 4, along: 6, is_sphere, tear: 0.01 };
        let (all, _) = check(&surface, Dicing::Tolerance(0.01));
        assert!(is_closed(&all), "{is_sphere}");
    }
}

#[test]
fn quads_of_one_cell_have_four_without_cracks() {
    let shape = prism();
    let cage = shape.cage();
    let quads = CageQuads::new(&cage, &shape.points, None).expect("quads");
    let (all, lifted) = check(&quads, Dicing::Level(0));
    assert_eq!(lifted, quads.count());
    // Of the 8 triangles of a grid of two by two cells, 4 have two corners at the same end of a side.
    assert!(all.len() == 4 * lifted && is_closed(&all), "{} triangles of {lifted} quads", all.len());
    let surface = sphere().surface();
    let (all, lifted) = check(&NurbsQuads::new(&surface, None), Dicing::Level(0));
    assert!(lifted > 0 && is_closed(&all));
}

/// The rule itself: a sample is that of its quad, with the mean of the quads around for its position on edges and
/// corners.
#[test]
fn samples_are_those_of_the_surface_and_means_on_edges() {
    let (shape, heights, level) = (prism(), heights(1, 7), 2);
    let (cage, mut rng) = (shape.cage(), Rng(6));
    let coordinates: Vec<_> = shape.indices.iter().map(|_| [rng.unit(), rng.unit()]).collect();
    let displacement = Displacement { heights: &heights, scale: 0.05, coordinates: &coordinates };
    let surface = CageQuads::new(&cage, &shape.points, Some(displacement)).expect("quads");
    let mean = |points: Vec<DVec3>| points.iter().sum::<DVec3>() / points.len() as f64;
    let at_vertex = |vertex: u32| {
        let of = |quad: usize| surface.corners(quad).into_iter().enumerate().map(move |(i, it)| (quad, i, it));
        let uses = (0..surface.count()).flat_map(of).filter(|it| it.2 == vertex);
        mean(uses.map(|(quad, i, _)| surface.sample(quad, (i % 2) as f64, (i / 2) as f64).position).collect())
    };
    let on_edge = |edge: u32, t: f64| {
        let of = |quad: usize| surface.sides(quad).into_iter().enumerate().map(move |(i, it)| (quad, i, it));
        let uses = (0..surface.count()).flat_map(of).filter(|it| it.2.edge == edge);
        let points = uses.map(|(quad, which, side)| {
            let t = if side.is_reversed { 1.0 - t } else { t };
            let [u, v] = [[t, 0.0], [t, 1.0], [0.0, t], [1.0, t]][which];
            surface.sample(quad, u, v).position
        });
        mean(points.collect())
    };
    let dicer = Dicer::new(&surface, Dicing::Level(level), &Cancel::new()).expect("edges");
    for quad in 0..surface.count() {
        let (sides, corners) = (surface.sides(quad), surface.corners(quad));
        for (n, (position, normal)) in grid_of(&dicer, quad, level, 1).into_iter().enumerate() {
            let [u, v] = [n % 5, n / 5].map(|it| it as f64 / 4.0);
            let sample = surface.sample(quad, u, v);
            let on = |which: usize, t: f64| {
                let Side { edge, is_reversed } = sides[which];
                on_edge(edge, if is_reversed { 1.0 - t } else { t })
            };
            let expected = match (n % 5, n / 5) {
                (i @ (0 | 4), j @ (0 | 4)) => at_vertex(corners[i / 4 + 2 * (j / 4)]),
                (_, j @ (0 | 4)) => on(j / 4, u),
                (i @ (0 | 4), _) => on(2 + i / 4, v),
                _ => sample.position,
            };
            assert_eq!(position_bits(position), position_bits(expected), "quad {quad}, ({u}, {v})");
            assert_eq!(normal, sample.normal.as_vec3(), "quad {quad}, ({u}, {v})");
        }
    }
}

/// A surface that counts its evaluations.
struct Counted<Q>(Q, AtomicUsize);

impl<Q: Quads> Quads for Counted<Q> {
    fn count(&self) -> usize {
        self.0.count()
    }
    fn vertices(&self) -> usize {
        self.0.vertices()
    }
    fn edges(&self) -> usize {
        self.0.edges()
    }
    fn corners(&self, quad: usize) -> [u32; 4] {
        self.0.corners(quad)
    }
    fn sides(&self, quad: usize) -> [Side; 4] {
        self.0.sides(quad)
    }
    fn sample(&self, quad: usize, u: f64, v: f64) -> Sample {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.sample(quad, u, v)
    }
}

#[test]
fn tiles_evaluate_their_own_samples_alone() {
    let surface = Counted(Round { across: 3, along: 3, is_sphere: false, tear: 0.0 }, AtomicUsize::new(0));
    let dicer = Dicer::new(&surface, Dicing::Level(MOST_LEVEL), &Cancel::new()).expect("edges");
    let mut tile = Tile::default();
    // Inside; at one side, where five samples need three evaluations each; at a corner, which is a known mean.
    for ([i, j], expected) in [([3, 5], 25), ([0, 5], 20 + 5 * 3), ([1023, 1023], 16 + 2 * (1 + 4 * 3))] {
        surface.1.store(0, Ordering::Relaxed);
        dicer.tile(4, MOST_LEVEL, 2, i, j, &mut tile);
        assert_eq!(surface.1.load(Ordering::Relaxed), expected, "tile {i}, {j}");
    }
}
