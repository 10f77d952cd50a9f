//! Shapes of furniture, buildings and machines, beside those of `assemblies::shapes`, in metres, z up.

pub use crate::assemblies::shapes::{Shape, around, bolt, ring, turned};
use glam::{DAffine3, DVec2, DVec3};
use std::f64::consts::TAU;

impl Shape {
    /// The shape at a place.
    pub fn at(mut self, place: DAffine3) -> Self {
        self.vertices.iter_mut().for_each(|v| *v = place.transform_point3(*v));
        self
    }

    /// The shape moved.
    pub fn moved(self, x: f64, y: f64, z: f64) -> Self {
        self.at(DAffine3::from_translation(DVec3::new(x, y, z)))
    }

    /// Both as one.
    pub fn and(mut self, other: Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| first + i)));
        self
    }

    /// Without the triangles whose middle is in what is cut away.
    pub fn without(mut self, is_cut: impl Fn(DVec3) -> bool) -> Self {
        let Self { vertices, triangles } = &mut self;
        triangles.retain(|t| !is_cut(t.iter().map(|&i| vertices[i as usize]).sum::<DVec3>() / 3.0));
        self
    }
}

/// A surface of revolution about z with open ends: `profile` holds radius and height. If its last point is the first
/// one, the surface is a closed hoop.
pub fn lathe(profile: &[(f64, f64)], sides: usize) -> Shape {
    let ring = |&(r, z): &(f64, f64)| around(sides).map(|(c, s)| DVec3::new(r * c, r * s, z)).collect();
    Shape::of_rings(&profile.iter().map(ring).collect::<Vec<_>>())
}

/// A surface over the unit square in `nu` by `nv` cells.
pub fn sheet(nu: usize, nv: usize, at: impl Fn(f64, f64) -> DVec3) -> Shape {
    let row = nu as u32 + 1;
    let vertex = |v: usize| move |u: usize| (u as f64 / nu as f64, v as f64 / nv as f64);
    let vertices = (0..=nv).flat_map(|v| (0..=nu).map(vertex(v))).map(|(u, v)| at(u, v)).collect();
    let cell = |v: u32, u: u32| [[0, 1, row + 1], [0, row + 1, row]].map(|t| t.map(|i| v * row + u + i));
    let triangles = (0..nv as u32).flat_map(|v| (0..nu as u32).flat_map(move |u| cell(v, u))).collect();
    Shape { vertices, triangles }
}

/// A box with its least corner and its size: twelve triangles.
pub fn cuboid(least: DVec3, size: DVec3) -> Shape {
    let vertices = (0..8).map(|i| least + size * DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64));
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Shape { vertices: vertices.collect(), triangles }
}

/// A rectangle with one corner and two edges: two triangles.
pub fn quad(corner: DVec3, along: DVec3, across: DVec3) -> Shape {
    sheet(1, 1, |u, v| corner + along * u + across * v)
}

/// A superellipsoid with half axes; `square` is 1 for an ellipsoid, and near 0 for a box. (Barr, "Superquadrics and
/// Angle-Preserving Transformations", 1981.)
pub fn blob(half: DVec3, square: f64, around_it: usize, rings: usize) -> Shape {
    let power = |x: f64| x.signum() * x.abs().powf(square);
    let ring = |i: usize| -> Vec<DVec3> {
        let (up, out) = (0.5 * TAU * ((i as f64 + 0.5) / rings as f64 - 0.5)).sin_cos();
        around(around_it)
            .map(|(c, s)| half * DVec3::new(power(c) * power(out), power(s) * power(out), power(up)))
            .collect()
    };
    let mut shape = Shape::of_rings(&(0..rings).map(ring).collect::<Vec<_>>());
    let last = ((rings - 1) * around_it) as u32;
    shape.close(0, around_it as u32, -half.z * DVec3::Z);
    shape.close(last, around_it as u32, half.z * DVec3::Z);
    shape
}

/// A closed prism over an outline that is star-shaped about its middle, from height 0 up.
pub fn prism(outline: &[DVec2], height: f64) -> Shape {
    let ring = |z: f64| outline.iter().map(|p| p.extend(z)).collect::<Vec<_>>();
    let mut shape = Shape::of_rings(&[ring(0.0), ring(height)]);
    let middle = outline.iter().copied().sum::<DVec2>() / outline.len() as f64;
    shape.close(0, outline.len() as u32, middle.extend(0.0));
    shape.close(outline.len() as u32, outline.len() as u32, middle.extend(height));
    shape
}

/// A circle's outline.
pub fn circle(radius: f64, sides: usize) -> Vec<DVec2> {
    around(sides).map(|(c, s)| radius * DVec2::new(c, s)).collect()
}

/// A section that goes along a path, both ends closed. Its frame turns as little as it can (rotation minimising by
/// projection, step by step).
pub fn swept(path: &[DVec3], section: &[DVec2]) -> Shape {
    let last = path.len() - 1;
    let along = |i: usize| (path[(i + 1).min(last)] - path[i.saturating_sub(1)]).normalize_or(DVec3::Z);
    let mut side = along(0).any_orthonormal_vector();
    let mut rings = Vec::new();
    for (i, &at) in path.iter().enumerate() {
        let ahead = along(i);
        side = side.reject_from_normalized(ahead).normalize_or(ahead.any_orthonormal_vector());
        let up = ahead.cross(side);
        rings.push(section.iter().map(|p| at + side * p.x + up * p.y).collect::<Vec<_>>());
    }
    let mut shape = Shape::of_rings(&rings);
    let sides = section.len() as u32;
    shape.close(0, sides, path[0]);
    shape.close(last as u32 * sides, sides, path[last]);
    shape
}

/// A path through corners that are rounded with a radius, in `steps` pieces each.
pub fn rounded(corners: &[DVec3], radius: f64, steps: usize) -> Vec<DVec3> {
    let last = corners.len() - 1;
    let mut path = vec![corners[0]];
    for i in 1..last {
        let (back, ahead) = (corners[i - 1] - corners[i], corners[i + 1] - corners[i]);
        let reach = radius.min(0.45 * back.length()).min(0.45 * ahead.length());
        let (from, to) = (corners[i] + back.normalize() * reach, corners[i] + ahead.normalize() * reach);
        path.extend((0..=steps).map(|k| {
            let t = k as f64 / steps as f64;
            // A parabola: tangent to both legs.
            from.lerp(corners[i], t).lerp(corners[i].lerp(to, t), t)
        }));
    }
    path.push(corners[last]);
    path
}

/// A helical spring about z, from height 0 up.
pub fn spring(radius: f64, wire: f64, height: f64, turns: f64, a_turn: usize, across: usize) -> Shape {
    let steps = (turns * a_turn as f64).round() as usize;
    let path: Vec<DVec3> = (0..=steps)
        .map(|i| {
            let t = i as f64 / steps as f64;
            let (s, c) = (TAU * turns * t).sin_cos();
            DVec3::new(radius * c, radius * s, height * t)
        })
        .collect();
    swept(&path, &circle(wire, across))
}

/// A spur gear about z with a bore, from height 0 up; a tooth is `fine` times four points of its outline.
pub fn gear(teeth: usize, radius: f64, bore: f64, width: f64, fine: usize) -> Shape {
    let depth = 2.25 * 2.0 * radius / teeth as f64;
    let points = 4 * fine * teeth;
    let height = |i: usize| {
        // Up the flank, along the tip, down, along the root; flanks bulge as involutes do.
        let (quarter, t) = (i / fine % 4, (i % fine) as f64 / fine as f64);
        match quarter {
            0 => t * (2.0 - t),
            1 => 1.0,
            2 => 1.0 - t * t,
            _ => 0.0,
        }
    };
    let ring = |is_bore: bool, z: f64| -> Vec<DVec3> {
        (around(points).enumerate())
            .map(|(i, (c, s))| {
                let r = if is_bore { bore } else { radius - depth * (0.55 - height(i)) };
                DVec3::new(r * c, r * s, z)
            })
            .collect()
    };
    let ends = [(true, 0.0), (false, 0.0), (false, width), (true, width), (true, 0.0)];
    Shape::of_rings(&ends.map(|(is_bore, z)| ring(is_bore, z)))
}

/// A plate from height 0 up, cut into cells by lines along x and y, where a cell may have a round hole in its middle.
/// Faces go from the corners of cells to the circles, as CAD kernels make them: large triangles, and slivers.
pub fn drilled(xs: &[f64], ys: &[f64], thickness: f64, sides: usize, hole: impl Fn(usize, usize) -> f64) -> Shape {
    let mut shape = Shape::default();
    let quarter = sides.div_ceil(4).max(1);
    for (j, y) in ys.windows(2).enumerate() {
        for (i, x) in xs.windows(2).enumerate() {
            let (least, most) = (DVec2::new(x[0], y[0]), DVec2::new(x[1], y[1]));
            let radius = hole(i, j).min(0.45 * (most - least).min_element());
            shape = shape.and(cell([least, most], thickness, radius, quarter));
        }
    }
    let (low, high) = (DVec3::new(xs[0], ys[0], 0.0), DVec3::new(xs[xs.len() - 1], ys[ys.len() - 1], 0.0));
    let up = thickness * DVec3::Z;
    let (along, across) = ((high.x - low.x) * DVec3::X, (high.y - low.y) * DVec3::Y);
    let walls = [(low, along), (low + along, across), (high, -along), (low + across, -across)];
    walls.into_iter().fold(shape, |shape, (from, along)| shape.and(quad(from, along, up)))
}

/// Both faces of a cell of a plate, and the wall of its hole.
fn cell([least, most]: [DVec2; 2], thickness: f64, radius: f64, quarter: usize) -> Shape {
    let corners = [DVec2::new(most.x, most.y), DVec2::new(least.x, most.y), least, DVec2::new(most.x, least.y)];
    let faces = [thickness, 0.0];
    let mut shape = Shape::default();
    if radius <= 0.0 {
        for z in faces {
            let [a, b, c, d] = corners.map(|p| p.extend(z));
            shape = shape.and(Shape { vertices: vec![a, b, c, d], triangles: vec![[0, 1, 2], [0, 2, 3]] });
        }
        return shape;
    }
    let middle = 0.5 * (least + most);
    let sides = 4 * quarter;
    let round: Vec<DVec2> = circle(radius, sides).into_iter().map(|p| middle + p).collect();
    for z in faces {
        let mut face =
            Shape { vertices: corners.iter().chain(&round).map(|p| p.extend(z)).collect(), ..Shape::default() };
        let on = |i: usize| (4 + i % sides) as u32;
        for (k, corner) in (0..4u32).enumerate() {
            face.triangles.extend((0..quarter).map(|i| [corner, on(k * quarter + i + 1), on(k * quarter + i)]));
            face.triangles.push([corner, (corner + 1) % 4, on((k + 1) * quarter)]);
        }
        shape = shape.and(face);
    }
    let wall = |z: f64| round.iter().map(|p| p.extend(z)).collect::<Vec<_>>();
    shape.and(Shape::of_rings(&[wall(0.0), wall(thickness)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    fn is_closed(shape: &Shape) -> bool {
        let place = |i: u32| shape.vertices[i as usize].to_array().map(|x| (x * 1e9).round() as i64);
        let mut edges = HashMap::new();
        for t in &shape.triangles {
            for i in 0..3 {
                let (a, b) = (place(t[i]), place(t[(i + 1) % 3]));
                *edges.entry((a.min(b), a.max(b))).or_insert(0) += 1;
            }
        }
        edges.values().all(|n| n % 2 == 0)
    }

    #[test]
    fn solids_are_closed() {
        let bend = rounded(&[DVec3::ZERO, DVec3::X, DVec3::ONE], 0.2, 4);
        let solids = [
            cuboid(DVec3::ZERO, DVec3::ONE),
            blob(DVec3::ONE, 0.4, 12, 7),
            prism(&circle(1.0, 7), 2.0),
            swept(&bend, &circle(0.1, 6)),
            spring(1.0, 0.1, 3.0, 2.5, 12, 6),
            gear(12, 1.0, 0.3, 0.2, 2),
        ];
        for (i, solid) in solids.iter().enumerate() {
            assert!(is_closed(solid), "solid {i}");
            assert!(solid.vertices.iter().all(|v| v.is_finite()), "solid {i}");
        }
    }

    #[test]
    fn plates_have_the_area_that_holes_leave() {
        let plate = drilled(&[0.0, 1.0, 5.0], &[0.0, 2.0], 0.5, 64, |i, _| if i == 1 { 0.5 } else { 0.0 });
        let flat: f64 = plate
            .corners()
            .iter()
            .map(|t| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]))
            .filter(|n| n.z.abs() > 0.99 * n.length())
            .map(|n| n.length())
            .sum();
        let wanted = 2.0 * (10.0 - 0.5 * TAU * 0.25);
        assert!((flat - wanted).abs() < 0.01, "{flat} for {wanted}");
        assert!(plate.corners().len() == 2 * (2 + 68) + 128 + 8);
    }
}
