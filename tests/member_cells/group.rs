//! Groups of members under test: a few models, placed, with the tree over them and the oracle over all triangles; and
//! walks that trace the members they come to in double precision.

use crate::common::brute::{Ray64, Tri, meet};
use crate::common::bvh64::Bvh64;
use crate::common::rng::Rng;
use crate::common::scenes;
use crate::common::trees::TestTree;
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use outcrop::math::{Bounds, PACKET, bits};
use outcrop::simd::Isa;
use outcrop::structure::{Appearance, Blocks, LocalRay, MemberLook, Members, Outcome, PacketWalk, Tree, TriHit, Walk};
use std::sync::OnceLock;

/// Extent of the space that members are in.
pub const SPACE: f64 = 8.0;
/// Members and boxes reach beyond.
pub const MAX_COORD: f32 = 12.0;

/// Members of a few models, and all their triangles.
pub struct Group {
    pub looks: Vec<(Appearance, Vec3)>,
    pub members: Vec<Member>,
    pub oracle: Bvh64,
    pub tree: Members,
}

#[derive(Clone)]
pub struct Member {
    pub model: usize,
    pub map: DAffine3,
    pub bounds: Bounds,
    pub tris: Vec<Tri>,
}

pub fn bounds_of(tris: &[Tri]) -> Bounds {
    let corners = || tris.iter().flatten().copied();
    let (low, high) =
        (corners().reduce(DVec3::min).expect("a triangle"), corners().reduce(DVec3::max).expect("a triangle"));
    let f32 = |v: DVec3, up: bool| {
        Vec3::from(v.to_array().map(|x| if up { (x as f32).next_up() } else { (x as f32).next_down() }))
    };
    Bounds { min: f32(low, false), max: f32(high, true) }
}

impl Member {
    pub fn new(model: usize, map: DAffine3, stored: &[Tri]) -> Self {
        let tris: Vec<Tri> = stored.iter().map(|t| t.map(|v| map.transform_point3(v))).collect();
        Self { model, map, bounds: bounds_of(&tris), tris }
    }
}

/// Number of a member in the tree: not its index.
pub fn number(index: usize) -> u32 {
    2 * index as u32 + 5
}

pub fn index(number: u32) -> usize {
    (number as usize - 5) / 2
}

/// Greatest factor by which a map lengthens, or more.
pub fn stretch(map: &DAffine3) -> f64 {
    let square = map.matrix3.transpose() * map.matrix3;
    // The greatest eigenvalue is at most the greatest sum of a row's magnitudes.
    (0..3).map(|k| square.row(k).abs().element_sum()).fold(0.0, f64::max).sqrt()
}

/// Turned, scaled by half an octave, and one in two sheared, one in three mirrored.
pub fn any_map(rng: &mut Rng, at: DVec3) -> DAffine3 {
    let turn = DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 6.0));
    let scale = DVec3::from([(); 3].map(|()| rng.between(0.5, 1.0)));
    let mut linear = DMat3::from_quat(turn) * DMat3::from_diagonal(scale);
    if rng.one_in(2) {
        linear *= DMat3::from_cols(DVec3::X, DVec3::new(rng.between(-1.0, 1.0), 1.0, 0.0), DVec3::Z);
    }
    if rng.one_in(3) {
        linear *= DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    }
    DAffine3::from_mat3_translation(linear, at)
}

/// Small triangles here and there, as leaves are.
pub fn leaves(rng: &mut Rng, count: usize) -> Vec<Tri> {
    (0..count)
        .map(|_| {
            let at = rng.direction() * rng.unit().cbrt();
            [(); 3].map(|()| at + rng.direction() * 0.1)
        })
        .collect()
}

/// A closed surface, cuboids and leaves, each within a ball of radius 1.
pub fn models() -> [Vec<Tri>; 3] {
    [scenes::bumpy_sphere(5, 7, 1), scenes::boxes(6, 2), leaves(&mut Rng::new(3), 60)].map(|tris| {
        let size = tris.iter().flatten().map(|v| v.length()).fold(0.0, f64::max);
        tris.iter().map(|t| t.map(|v| v / size)).collect()
    })
}

pub fn members(models: &[Vec<Tri>], count: usize, seed: u64) -> (Vec<TestTree>, Vec<Member>) {
    let mut rng = Rng::new(seed);
    let trees: Vec<TestTree> = models.iter().map(|tris| TestTree::around_middle(tris, 0.0)).collect();
    let members = (0..count)
        .map(|i| {
            let model = i % models.len();
            // Half of them in heaps.
            let at = match i % 4 {
                0 | 1 => rng.inside(DVec3::splat(-SPACE), DVec3::splat(SPACE)),
                heap => DVec3::splat(heap as f64 * 4.0 - 10.0) + rng.direction() * rng.between(0.0, 3.0),
            };
            Member::new(model, any_map(&mut rng, at), &trees[model].stored)
        })
        .collect();
    (trees, members)
}

pub const COLOURS: [Vec3; 3] = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1.0)];

impl Group {
    pub fn new(trees: &[TestTree], members: Vec<Member>) -> Self {
        let looks: Vec<_> = trees
            .iter()
            .zip(COLOURS)
            .map(|(it, colour)| {
                let tree = Tree::new(Blocks::Bvh(it.view(&it.snapshot, Isa::Baseline)), None);
                (tree.appearance(&|_| colour).expect("a root in memory"), colour)
            })
            .collect();
        let tree = described(&looks, &members, |_| true);
        let oracle = Bvh64::new(members.iter().flat_map(|it| it.tris.iter().copied()).collect());
        Self { looks, members, oracle, tree }
    }

    pub fn usual() -> &'static Self {
        static USUAL: OnceLock<Group> = OnceLock::new();
        USUAL.get_or_init(|| {
            let (trees, members) = members(&models(), 320, 9);
            Self::new(&trees, members)
        })
    }
}

/// The tree over members, of which `is_described` chooses those with a look.
pub fn described(looks: &[(Appearance, Vec3)], members: &[Member], is_described: impl Fn(usize) -> bool) -> Members {
    let is_near = |it: &Member| it.bounds.min.abs().max(it.bounds.max.abs()).max_element() < MAX_COORD * 0.98;
    assert!(members.iter().all(is_near));
    let boxes = members.iter().enumerate().map(|(i, it)| (number(i), it.bounds));
    let look = |number: u32| {
        let it = &members[index(number)];
        let (appearance, tint) = (&looks[it.model].0, Vec3::ONE);
        let look = MemberLook { appearance, map: it.map, stretch: stretch(&it.map), tint };
        is_described(index(number)).then_some(look)
    };
    Members::build_described(boxes, MAX_COORD, look).expect("a tree")
}

/// What a ray found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// The cell.
    pub cell: Option<TriHit>,
    /// The nearest triangle before it, of members that the walk came to.
    pub t: f32,
    pub first_cell: f32,
}

/// The nearest triangle of a member.
pub fn trace(member: &Member, ray: &Ray64) -> f64 {
    let (b, inv) = (&member.bounds, ray.dir.recip());
    let (p, q) = ((b.min.as_dvec3() - ray.org) * inv, (b.max.as_dvec3() - ray.org) * inv);
    if p.min(q).max_element() > p.max(q).min_element() {
        return f64::INFINITY;
    }
    let hits = member.tris.iter().filter_map(|tri| meet(ray, tri, 0)).map(|hit| hit.t);
    hits.fold(f64::INFINITY, f64::min)
}

pub fn wide(ray: &LocalRay) -> Ray64 {
    Ray64 { org: ray.org.as_dvec3(), dir: ray.dir.as_dvec3(), t_min: f64::from(ray.t_min), t_max: f64::from(ray.t_max) }
}

/// Walks to the end; tells `visited` of each member that the walk comes to, with what was found before.
pub fn alone(
    tree: &Tree,
    members: &[Member],
    ray: &LocalRay,
    walk: &mut Walk,
    mut visited: impl FnMut(u32, TriHit),
) -> Answer {
    walk.begin(tree, ray);
    let mut t = f32::INFINITY;
    while let Outcome::Member(number) = tree.closest(None, walk) {
        visited(number, walk.best());
        t = t.min(trace(&members[index(number)], &wide(ray)) as f32);
        walk.shorten(t);
    }
    let best = walk.best();
    Answer {
        cell: best.is_hit().then_some(best),
        t: if best.is_hit() { f32::INFINITY } else { t },
        first_cell: walk.first_cell(),
    }
}

pub fn together(tree: &Tree, members: &[Member], rays: &[LocalRay; PACKET], walk: &mut PacketWalk) -> Vec<Answer> {
    walk.begin(tree, rays, u32::MAX);
    let mut t = [f32::INFINITY; PACKET];
    while let Outcome::Member(number) = tree.closest_together(None, walk) {
        for i in bits(walk.at_member()) {
            t[i] = t[i].min(trace(&members[index(number)], &wide(&rays[i])) as f32);
            walk.shorten(i, t[i]);
        }
    }
    let answer = |i: usize| {
        let best = walk.best(i);
        let t = if best.is_hit() { f32::INFINITY } else { t[i] };
        Answer { cell: best.is_hit().then_some(best), t, first_cell: walk.first_cell()[i] }
    };
    (0..PACKET).map(answer).collect()
}
