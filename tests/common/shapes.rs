//! Cages of OBJ files with the tags of OpenSubdiv's test shapes, and the cages of `cages.obj`.
//!
//! `t crease 2/1/0 a b s`, `t corner 1/1/0 v s` and `t hole 1/0/0 f` count from 0, faces from 1. `t
//! interpolateboundary 1/0/0 n`: 0 none, 1 edge and corner, 2 edge only, which holds without this tag. `t creasemethod
//! 0/0/1 chaikin` and `t smoothtriangles 0/0/1 smooth` choose rules.

use super::models;
use super::rng::Rng;
use glam::DVec3;
use outcrop::geom::surface::cage::{Boundary, Cage, CageDesc, CagePatches, Creasing, TriangleRule};
use outcrop::import::surfaces::{Heights, Wrap};
use std::collections::HashMap;

/// A cage with its positions, owned.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    pub name: String,
    pub points: Vec<DVec3>,
    pub sizes: Vec<u32>,
    pub indices: Vec<u32>,
    pub creases: Vec<(u32, u32, f32)>,
    pub corners: Vec<(u32, f32)>,
    pub holes: Vec<u32>,
    pub boundary: Boundary,
    pub creasing: Creasing,
    pub triangles: TriangleRule,
}

impl Shape {
    pub fn desc(&self) -> CageDesc<'_> {
        CageDesc {
            face_sizes: &self.sizes,
            indices: &self.indices,
            creases: &self.creases,
            corners: &self.corners,
            holes: &self.holes,
            boundary: self.boundary,
            creasing: self.creasing,
            triangles: self.triangles,
        }
    }

    pub fn cage(&self) -> Cage {
        Cage::new(&self.desc(), self.points.len()).unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }

    /// The greatest edge of the box around the points.
    pub fn extent(&self) -> f64 {
        let low = self.points.iter().fold(DVec3::INFINITY, |a, &p| a.min(p));
        let high = self.points.iter().fold(DVec3::NEG_INFINITY, |a, &p| a.max(p));
        (high - low).max_element()
    }

    /// Coordinates of a map that covers each face of four corners.
    pub fn coordinates(&self) -> Vec<[f64; 2]> {
        let at = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        (0..self.indices.len()).map(|i| at[i % 4]).collect()
    }

    /// True if each edge has two faces, which run along it in opposite directions.
    pub fn is_closed(&self) -> bool {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        let mut first = 0;
        for &size in &self.sizes {
            let face = &self.indices[first..first + size as usize];
            first += size as usize;
            for (i, &a) in face.iter().enumerate() {
                *edges.entry((a, face[(i + 1) % face.len()])).or_default() += 1;
            }
        }
        let is_one = |(&(a, b), &count): (&(u32, u32), &i32)| count == 1 && edges.get(&(b, a)) == Some(&1);
        self.holes.is_empty() && edges.iter().all(is_one)
    }

    /// The limit surface as small triangles, without that of holes.
    pub fn fine(&self) -> Vec<[DVec3; 3]> {
        const SIDE: usize = 48;
        let (cage, mut all) = (self.cage(), Vec::new());
        let surface = CagePatches::new(&cage, &self.points).expect("a surface");
        for face in (0..cage.face_count() as u32).filter(|face| !cage.is_hole(*face)) {
            for corner in 0..cage.quads_of(face) {
                let share = |i: usize| i as f64 / SIDE as f64;
                let at = |i: usize, j: usize| surface.evaluate(face, corner, share(i), share(j)).position;
                for (i, j) in (0..SIDE * SIDE).map(|n| (n / SIDE, n % SIDE)) {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    all.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        all
    }

    fn line(&mut self, line: &str) {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["v", x, y, z] => self.points.push(DVec3::new(number(x), number(y), number(z))),
            ["f", corners @ ..] => {
                self.sizes.push(corners.len() as u32);
                let vertex = |c: &&str| c.split('/').next().unwrap().parse::<u32>().unwrap() - 1;
                self.indices.extend(corners.iter().map(vertex));
            }
            ["t", "crease", _, a, b, s] => self.creases.push((index(a), index(b), number(s) as f32)),
            ["t", "corner", _, v, s] => self.corners.push((index(v), number(s) as f32)),
            ["t", "hole", _, f] => self.holes.push(index(f)),
            ["t", "interpolateboundary", _, rule] => {
                self.boundary = [Boundary::None, Boundary::EdgeAndCorner, Boundary::EdgeOnly][index(rule) as usize];
            }
            ["t", "creasemethod", _, "chaikin"] => self.creasing = Creasing::Chaikin,
            ["t", "smoothtriangles", _, "smooth"] => self.triangles = TriangleRule::Smooth,
            ["t", ..] => panic!("unknown tag: {line}"),
            _ => {}
        }
    }
}

/// Heights of -1 and 1 that jump from texel to texel.
pub fn jumping_heights() -> Heights {
    let mut rng = Rng::new(3);
    let texels = (0..256).map(|_| if rng.unit() < 0.5 { -1.0 } else { 1.0 }).collect();
    Heights::new([16, 16], 1, [Wrap::Repeat; 2], texels).expect("heights")
}

fn number(word: &str) -> f64 {
    word.parse().unwrap()
}

fn index(word: &str) -> u32 {
    word.parse().unwrap()
}

/// The shapes of a text, one after each line `o NAME`; a text without such a line is one shape.
pub fn parsed(text: &str, name: &str) -> Vec<Shape> {
    let mut shapes: Vec<Shape> = Vec::new();
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("o ") {
            shapes.push(Shape { name: name.trim().to_string(), ..Shape::default() });
        } else {
            if shapes.is_empty() && line.starts_with("v ") {
                shapes.push(Shape { name: name.to_string(), ..Shape::default() });
            }
            if let Some(shape) = shapes.last_mut() {
                shape.line(line);
            }
        }
    }
    shapes
}

/// A shape of the models folder, without its extension, or `None` after saying that it is missing.
pub fn model(name: &str) -> Option<Shape> {
    let path = models::find(&format!("subdivision/{name}.obj"))?;
    let text = std::fs::read_to_string(path).unwrap();
    let mut shapes = parsed(&text, name);
    assert_eq!(shapes.len(), 1, "{name}");
    shapes.pop()
}

/// The shapes of `cages.obj`: creases, valences 3 to 64, darts, boundaries, non-manifold edges, ...
pub fn own() -> Vec<Shape> {
    parsed(include_str!("cages.obj"), "own")
}
