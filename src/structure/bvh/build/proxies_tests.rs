//! Tests of the samples of proxies, against brute force in double precision.

use super::super::{refs, tree};
use super::*;
use crate::base::progress::{Cancel, Progress};
use crate::lod;
use glam::DVec3;
use glam::Vec4;

/// A chunk's tree with proxies of subtrees of `least` triangles.
struct Made {
    triangles: Vec<[Vec3; 3]>,
    parts: Vec<u32>,
    pieces: Vec<Piece>,
    refs: Vec<Ref>,
    proxies: Vec<BakedProxy>,
}

const COLOURS: [Vec4; 2] = [Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(0.0, 0.0, 1.0, 1.0)];

impl Made {
    /// Builds the triangles, each with its part.
    fn of(all: &[([Vec3; 3], u32)], least: u32, rays: u32, isa: Isa, threads: usize, cancel: &Cancel) -> Result<Self> {
        let (triangles, parts): (Vec<_>, Vec<_>) = all.iter().copied().unzip();
        let prims: Vec<u32> = (0..triangles.len() as u32).collect();
        let input = TreeInput {
            triangles: &triangles,
            parts: &parts,
            prims: &prims,
            colours: &[],
            normals: &[],
            part_colours: &COLOURS,
        };
        let par = Par { threads };
        let mut refs = refs::make(&triangles, 0.5, &par).expect("room");
        let (progress, free) = (Progress::default(), Cancel::new());
        let stretch = Stretch::new(&progress, &free, (0.0, 1.0));
        let built = tree::build(input, &mut refs, 0.0, &par, &stretch).expect("a tree");
        let mut pieces = vec![InnerNode::over(built.children, tree::Place::Above)];
        let options = ProxyOptions { rays, triangles: least, first: 7 };
        let work = Stretch::new(&progress, cancel, (0.0, 1.0));
        let proxies = sample(&mut pieces, input, &refs, &options, isa, &par, &work)?;
        Ok(Self { triangles, parts, pieces, refs, proxies })
    }

    fn root(&self) -> &InnerNode {
        match &self.pieces[0].sub {
            Sub::InnerNode(root) => root,
            _ => panic!("the piece is an inner node"),
        }
    }
}

fn quad(at: Vec3, u: Vec3, v: Vec3, part: u32) -> [([Vec3; 3], u32); 2] {
    [([at, at + u, at + u + v], part), ([at, at + u + v, at + v], part)]
}

/// The faces of a cube, each of `n` times `n` squares.
fn cube(low: Vec3, size: f32, n: usize, part: u32) -> Vec<([Vec3; 3], u32)> {
    let mut all = Vec::new();
    for axis in 0..3 {
        let (u, v) = (Vec3::AXES[(axis + 1) % 3] * (size / n as f32), Vec3::AXES[(axis + 2) % 3] * (size / n as f32));
        for (i, j, side) in (0..n * n * 2).map(|i| (i % n, i / n % n, i / n / n)) {
            let at = low + u * i as f32 + v * j as f32 + Vec3::AXES[axis] * (size * side as f32);
            all.extend(quad(at, u, v, part));
        }
    }
    all
}

fn count(inner: &InnerNode) -> u32 {
    let below = inner.children.iter().map(|(_, sub)| match sub {
        Sub::InnerNode(below) => count(below),
        Sub::Leaf { count, .. } => *count,
        Sub::Placed(_) => 0,
    });
    below.sum()
}

/// Nodes of enough triangles have their own proxy, in preorder; all below show the last one on the way.
#[test]
fn nodes_show_the_last_proxy_on_the_way() {
    fn check(inner: &InnerNode, above: u32, next: &mut u32) {
        if count(inner) >= 40 {
            assert_eq!(inner.proxy, *next);
            *next += 1;
        } else {
            assert_eq!(inner.proxy, above);
        }
        for (_, sub) in &inner.children {
            if let Sub::InnerNode(below) = sub {
                check(below, inner.proxy, next);
            }
        }
    }
    let made = Made::of(&cube(Vec3::ZERO, 1.0, 12, 0), 40, 32, Isa::Baseline, 1, &Cancel::new()).expect("a tree");
    let mut next = 7;
    check(made.root(), NO_PROXY, &mut next);
    assert_eq!(next as usize, 7 + made.proxies.len());
    assert!(made.proxies.len() > 10);
    // The area of the root's proxy is that of the cube.
    assert!((made.proxies[0].area - 6.0).abs() < 1e-4, "{}", made.proxies[0].area);
}

/// Without a number, there is at most one proxy for so many triangles.
#[test]
fn their_number_is_chosen_by_bytes() {
    for n in [2, 6, 20, 40] {
        let all = cube(Vec3::ZERO, 1.0, n, 0);
        let made = Made::of(&all, 0, 8, Isa::Baseline, 1, &Cancel::new()).expect("a tree");
        let most = all.len() / TRIANGLES_A_PROXY;
        assert!(made.proxies.len() <= most && 2 * made.proxies.len() >= most, "{} of {most}", made.proxies.len());
    }
}

#[test]
fn the_same_on_any_threads_and_instruction_set() {
    let all = [cube(Vec3::ZERO, 1.0, 8, 0), cube(Vec3::splat(0.3), 0.5, 8, 1)].concat();
    let of = |isa, threads| Made::of(&all, 30, 64, isa, threads, &Cancel::new()).expect("a tree").proxies;
    let expected = of(Isa::Baseline, 1);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        assert_eq!(of(isa, 4), expected, "{}", isa.name());
    }
}

#[test]
fn a_cancel_ends_the_sampling() {
    let cancel = Cancel::new();
    cancel.cancel();
    let made = Made::of(&cube(Vec3::ZERO, 1.0, 8, 0), 30, 64, Isa::Baseline, 1, &cancel);
    assert!(matches!(made, Err(crate::Error::Cancelled)));
}

/// A red cube in a blue one: what hides it counts.
#[test]
fn what_is_hidden_stays_hidden() {
    let all = [cube(Vec3::ZERO, 1.0, 6, 1), cube(Vec3::splat(0.1), 0.8, 12, 0)].concat();
    let made = Made::of(&all, all.len() as u32, 500, Isa::Baseline, 1, &Cancel::new()).expect("a tree");
    for to_eye in [Vec3::X, Vec3::NEG_ONE, Vec3::new(1.0, -2.0, 0.3)] {
        let seen = lod::Look::Proxy(&made.proxies[0].looks).seen(-to_eye);
        let colour = seen.seconds.map(lod::stored_colour);
        assert!(colour.iter().all(|c| c.distance(COLOURS[1].truncate()) < 0.01), "{to_eye}: {colour:?}");
    }
}

/// The first triangle of each line is the one that a search over all triangles in double precision finds.
#[test]
fn lines_find_the_first_triangle() {
    struct All<'a>(&'a Scene<'a>, &'a Bounds);
    impl Op for All<'_> {
        type Out = Vec<(Option<usize>, [Vec3; 2])>;
        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> Self::Out {
            let (near, mut stack, mut out) = (self.0.around(self.1), Vec::new(), Vec::new());
            for numbers in &self.0.lines {
                let line = Line::into(self.1, *numbers);
                out.push((self.0.first(s, &line, &near, &mut stack), [line.org, line.dir]));
            }
            out
        }
    }
    let all = [cube(Vec3::ZERO, 1.0, 5, 1), cube(Vec3::splat(0.25), 0.6, 4, 0), cube(Vec3::splat(0.9), 0.7, 3, 0)];
    let made = Made::of(&all.concat(), 1, 1, Isa::Baseline, 1, &Cancel::new()).expect("a tree");
    let prims: Vec<u32> = (0..made.triangles.len() as u32).collect();
    let input = TreeInput {
        triangles: &made.triangles,
        parts: &made.parts,
        prims: &prims,
        colours: &[],
        normals: &[],
        part_colours: &COLOURS,
    };
    let lines = (0..2000).map(|i| BASES.map(|base| halton(i, base))).collect();
    let scene = Scene { pieces: &made.pieces, input, refs: &made.refs, lines };
    let distance = |[org, dir]: [Vec3; 2], triangle: &[Vec3; 3]| {
        let (org, dir) = (org.as_dvec3(), dir.as_dvec3());
        let [a, b, c]: [DVec3; 3] = triangle.map(|v| v.as_dvec3() - org);
        let volumes = [b.cross(c).dot(dir), c.cross(a).dot(dir), a.cross(b).dot(dir)];
        let across = (b - a).cross(c - a);
        let is_on = volumes.iter().all(|v| *v >= -1e-7) || volumes.iter().all(|v| *v <= 1e-7);
        let t = across.dot(a) / across.dot(dir);
        if is_on && t > -1e-5 { t } else { f64::INFINITY }
    };
    for cell in
        [Bounds { min: Vec3::ZERO, max: Vec3::splat(1.6) }, Bounds { min: Vec3::splat(0.2), max: Vec3::splat(0.95) }]
    {
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let (mut hits, mut apart) = (0, 0);
            for (found, line) in dispatch(isa, All(&scene, &cell)) {
                let end =
                    f64::from(Line { inv: line[1].recip(), org: line[0], dir: line[1], way: [0.0; 2] }.leaves(&cell));
                let nearest = made.triangles.iter().map(|t| distance(line, t)).fold(f64::INFINITY, f64::min);
                let own = found.map_or(f64::INFINITY, |t| distance(line, &made.triangles[t]));
                let expected = if nearest <= end { nearest } else { f64::INFINITY };
                hits += usize::from(found.is_some());
                apart += usize::from(!(own == expected || (own - expected).abs() < 1e-5));
            }
            // Lines along an edge, and hits where a line leaves the cell, may go either way.
            assert!(hits > 500 && apart <= 4, "{}: {hits} hits, {apart} apart", isa.name());
        }
    }
}

#[test]
fn runs_are_as_few_as_possible() {
    assert_eq!(runs(&[3, 3, 5, 5, 3, NO_PROXY]), [(0, 3), (2, 5), (4, 3), (5, NO_PROXY)]);
    assert_eq!(runs(&[NO_PROXY, NO_PROXY, 1]), [(2, 1)]);
    assert_eq!(runs(&[NO_PROXY; 4]), []);
}
