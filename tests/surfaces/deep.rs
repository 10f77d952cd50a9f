//! The limit by subdivision alone, many levels deep around one point, in double precision: no patches, no masks.

use crate::common::shapes::Shape;
use glam::DVec3;
use outcrop::geom::surface::cage::{Boundary, Cage, CageDesc};
use std::collections::BTreeMap;

pub struct Limit {
    pub position: DVec3,
    pub normal: DVec3,
}

/// Levels for the position: the last quad is smaller than 10⁻⁹ of the first one even at valence 64.
const LEVELS: usize = 60;

/// Levels for the normal below the one at which the quad is as far from the corner as it is large.
const FINER: usize = 26;

/// The limit point, from the quads that hold it on each level.
pub fn limit(shape: &Shape, face: u32, corner: u32, mut u: f64, mut v: f64) -> Limit {
    let quad = shape.sizes[face as usize] == 4;
    let (mut cage, mut points, mut target) = (shape.cage(), shape.points.clone(), face);
    let first: u32 = shape.sizes[..face as usize].iter().sum();
    let nearest = u.min(1.0 - u).max(v.min(1.0 - v));
    let depth = (-nearest.log2()).ceil().clamp(0.0, 30.0) as usize + FINER;
    let (mut normal, mut origin) = (DVec3::ZERO, DVec3::ZERO);
    for level in 0..LEVELS {
        let child = match (level, quad) {
            (0, false) => first + corner,
            (0, true) => first + descend(&mut u, &mut v),
            _ => descend(&mut u, &mut v),
        };
        let finer = cage.refine_points(&points).unwrap();
        let next = cage.refine().unwrap();
        (cage, points) = around(&next, &finer, child);
        target = 0;
        // Relative to a vertex of the quad, numbers keep their precision while the quad shrinks.
        let shift = points[cage.face(0)[0] as usize];
        points.iter_mut().for_each(|p| *p -= shift);
        origin += shift;
        if level == depth {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| points[cage.face(0)[i] as usize]);
            normal = (c - a).cross(d - b).normalize_or_zero();
        }
    }
    let position = cage.face(target).iter().map(|&vertex| points[vertex as usize]).sum::<DVec3>() / 4.0;
    Limit { position: origin + position, normal }
}

fn descend(u: &mut f64, v: &mut f64) -> u32 {
    let (right, upper) = (*u >= 0.5, *v >= 0.5);
    *u = 2.0 * *u - f64::from(u8::from(right));
    *v = 2.0 * *v - f64::from(u8::from(upper));
    [[0, 1], [3, 2]][usize::from(upper)][usize::from(right)]
}

/// A face as face 0 of a cage with all faces that share a vertex with it.
fn around(cage: &Cage, points: &[DVec3], face: u32) -> (Cage, Vec<DVec3>) {
    let own = cage.face(face).to_vec();
    let near = |&other: &u32| other != face && cage.face(other).iter().any(|vertex| own.contains(vertex));
    let faces: Vec<u32> = std::iter::once(face).chain((0..cage.face_count() as u32).filter(near)).collect();
    let mut number = BTreeMap::new();
    let (mut kept, mut indices, mut creases, mut corners) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for &face in &faces {
        for &vertex in cage.face(face) {
            let next = number.len() as u32;
            indices.push(*number.entry(vertex).or_insert_with(|| {
                kept.push(points[vertex as usize]);
                corners.push((next, cage.vertex_sharpness(vertex)));
                next
            }));
        }
    }
    let sizes: Vec<u32> = faces.iter().map(|&face| cage.face(face).len() as u32).collect();
    for &face in &faces {
        let corners = cage.face(face);
        for (&a, &b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            creases.push((number[&a], number[&b], cage.edge_sharpness(a, b).unwrap()));
        }
    }
    let (boundary, creasing, triangles) = (Boundary::EdgeOnly, cage.creasing(), cage.triangles());
    let (face_sizes, indices) = (sizes.as_slice(), indices.as_slice());
    let (creases, corners) = (creases.as_slice(), corners.as_slice());
    let desc = CageDesc { face_sizes, indices, creases, corners, holes: &[], boundary, creasing, triangles };
    (Cage::new(&desc, kept.len()).unwrap(), kept)
}
