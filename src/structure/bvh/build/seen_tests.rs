//! Tests of what cells show from outside, against random lines that are traced in double precision.

use super::super::{refs, tree};
use super::*;
use crate::base::progress::{Cancel, Progress};
use crate::lod::{Curtain, OrientedSlabs, curtain_from};
use glam::{DVec3, Vec4};

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

/// A mesh: triangles, and the part of each.
#[derive(Default)]
struct Mesh {
    triangles: Vec<[Vec3; 3]>,
    parts: Vec<u32>,
}

impl Mesh {
    /// Adds a parallelogram of `count` by `count` cells.
    fn sheet(&mut self, part: u32, [at, u, v]: [Vec3; 3], count: usize) {
        let (u, v) = (u / count as f32, v / count as f32);
        for i in 0..count * count {
            let at = at + u * (i % count) as f32 + v * (i / count) as f32;
            self.triangles.extend([[at, at + u, at + v], [at + u, at + u + v, at + v]]);
            self.parts.extend([part; 2]);
        }
    }

    /// A skin (part 0) that lies askew, and ribs (the other parts) below it that end just below it.
    fn skin_over_ribs() -> Self {
        let (u, v) = (Vec3::new(8.0, 1.0, 2.0), Vec3::new(-1.5, 7.0, 1.0));
        let down = v.cross(u).normalize();
        let mut mesh = Self::default();
        mesh.sheet(0, [Vec3::ZERO, u, v], 24);
        for rib in 1..RIBS {
            let at = u * (rib as f32 / RIBS as f32) + down * 0.004;
            mesh.sheet(rib, [at, v, down * 0.3 + u * 0.01], 3);
        }
        mesh
    }

    fn input<'a>(&'a self, prims: &'a [u32], part_colours: &'a [Vec4]) -> TreeInput<'a> {
        TreeInput { triangles: &self.triangles, parts: &self.parts, prims, colours: &[], normals: &[], part_colours }
    }
}

/// One past the last rib.
const RIBS: u32 = 17;
const COLOURS: [Vec4; RIBS as usize] = {
    let mut colours = [Vec4::new(0.6, 0.1, 0.1, 1.0); RIBS as usize];
    colours[0] = Vec4::ONE;
    colours
};

/// Returns a built tree with its samples.
fn sampled(mesh: &Mesh, colours: &[Vec4], isa: Isa, threads: usize) -> Vec<Piece> {
    let prims: Vec<u32> = (0..mesh.parts.len() as u32).collect();
    let (input, par) = (mesh.input(&prims, colours), Par { threads });
    let mut refs = refs::make(input.triangles, 0.5, &par).expect("room");
    let (progress, free) = (Progress::default(), Cancel::new());
    let stretch = || Stretch::new(&progress, &free, (0.0, 1.0));
    let built = tree::build(input, &mut refs, 0.0, &par, &stretch()).expect("a tree");
    let mut pieces = vec![InnerNode::over(built.children, tree::Place::Above)];
    sample(&mut pieces, input, &refs, isa, &par, &stretch()).expect("samples");
    pieces
}

/// Calls `f` with each cell: its box, its slabs, its voxel.
fn each_cell(inner: &InnerNode, f: &mut impl FnMut(Bounds, &OrientedSlabs<f32>, &Coded, u32)) {
    for (slot, (voxel, sub)) in inner.children.iter().enumerate() {
        f(inner.node.stored_box(slot), &inner.node.stored_oriented_slabs(slot), voxel, inner.node.level(slot));
        if let Sub::InnerNode(below) = sub {
            each_cell(below, f);
        }
    }
}

/// The part that a voxel shows to an eye.
fn shown(voxel: &Coded, to_eye: Vec3) -> u32 {
    let all = voxel.curtains.get(1..).unwrap_or_default().chunks_exact(3).map(|c| [c[0], c[1], c[2]]);
    let hides = all.into_iter().find(|words| curtain_from(words[0], to_eye));
    hides.map_or(Coded::part(voxel.words[2]).0, |words| Curtain::shown(words).1)
}

/// The part that a ray meets first inside of a cell, by the signs of volumes, in double precision.
fn first(mesh: &Mesh, cell: Bounds, slabs: &OrientedSlabs<f32>, from: DVec3, dir: DVec3) -> Option<u32> {
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    let mut clip = |at: f64, along: f64, low: f64, high: f64| {
        let (a, b) = ((low - at) / along, (high - at) / along);
        (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
    };
    for axis in 0..3 {
        clip(from[axis], dir[axis], f64::from(cell.min[axis]), f64::from(cell.max[axis]));
    }
    for slab in slabs {
        let axis = Vec3::from(slab.axis).as_dvec3();
        clip(from.dot(axis), dir.dot(axis), f64::from(slab.low), f64::from(slab.high));
    }
    let mut best = (far, None);
    for (triangle, part) in mesh.triangles.iter().zip(&mesh.parts) {
        let [a, b, c] = triangle.map(|v| v.as_dvec3() - from);
        let volumes = [b.cross(c).dot(dir), c.cross(a).dot(dir), a.cross(b).dot(dir)];
        let across = (b - a).cross(c - a);
        let t = across.dot(a) / across.dot(dir);
        let is_on = volumes.iter().all(|v| *v >= 0.0) || volumes.iter().all(|v| *v <= 0.0);
        if is_on && t >= near && t <= best.0 {
            best = (t, Some(*part));
        }
    }
    best.1
}

/// Of rays that meet something in cells of ribs, most show the right part: far more than if each cell showed its own.
#[test]
fn cells_show_what_rays_meet_first() {
    let mesh = Mesh::skin_over_ribs();
    let pieces = sampled(&mesh, &COLOURS, Isa::best(), 2);
    let Sub::InnerNode(root) = &pieces[0].sub else { panic!("the root is a node") };
    let mut random = Random(7);
    let (mut met, mut right, mut own, mut cells, mut with_curtains) = (0.0, 0.0, 0.0, 0, 0);
    each_cell(root, &mut |cell, slabs, voxel, _| {
        let (part, _) = Coded::part(voxel.words[2]);
        if part == 0 || cells >= 250 {
            return;
        }
        cells += 1;
        with_curtains += u32::from(!voxel.curtains.is_empty());
        for _ in 0..30 {
            let at = cell.center().as_dvec3() + random.inside() * cell.extent().as_dvec3() * 0.5;
            let dir = random.direction();
            let Some(hit) = first(&mesh, cell, slabs, at - dir * 100.0, dir) else { continue };
            met += 1.0;
            right += f64::from(u8::from(shown(voxel, -dir.as_vec3()) == hit));
            own += f64::from(u8::from(part == hit));
        }
    });
    println!("{cells} cells, {with_curtains} with curtains: {:.3} right, {:.3} by their own", right / met, own / met);
    assert!(cells > 100 && with_curtains > 20);
    // The rest are directions near edge-on to the skin, of which one bit covers both sides, and cells over several
    // ribs.
    assert!((met - right) < 0.6 * (met - own), "{right}, {own} of {met}");
}

#[test]
fn samples_depend_on_neither_threads_nor_vectors() {
    let mesh = Mesh::skin_over_ribs();
    let words = |pieces: &[Piece]| {
        let Sub::InnerNode(root) = &pieces[0].sub else { panic!("the root is a node") };
        let mut all = Vec::new();
        each_cell(root, &mut |_, _, voxel, level| all.push((voxel.clone(), level)));
        all
    };
    let expected = words(&sampled(&mesh, &COLOURS, Isa::best(), 1));
    assert!(words(&sampled(&mesh, &COLOURS, Isa::best(), 2)) == expected);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        assert!(words(&sampled(&mesh, &COLOURS, isa, 2)) == expected, "{}", isa.name());
    }
}

/// A see-through skin hides nothing, and one part alone needs no samples.
#[test]
fn what_is_see_through_hides_nothing() {
    let mut mesh = Mesh::skin_over_ribs();
    let mut glass = COLOURS;
    glass[0].w = 0.5;
    let with_skin = |mesh: &Mesh, colours: &[Vec4]| {
        let pieces = sampled(mesh, colours, Isa::best(), 2);
        let Sub::InnerNode(root) = &pieces[0].sub else { panic!("the root is a node") };
        let mut found = 0;
        each_cell(root, &mut |_, _, voxel, _| {
            let all = voxel.curtains.get(1..).unwrap_or_default().chunks_exact(3);
            found += all.filter(|c| Curtain::shown([c[0], c[1], c[2]]).1 == 0).count();
        });
        found
    };
    assert!(with_skin(&mesh, &COLOURS) > 20);
    assert_eq!(with_skin(&mesh, &glass), 0);
    mesh.parts.fill(0);
    assert_eq!(with_skin(&mesh, &COLOURS), 0);
}
