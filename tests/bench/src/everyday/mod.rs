//! Everyday scenes, of the kinds that most people open, made by formula: each a list of parts with names and colours.
//! The number of triangles decides how finely curved surfaces are cut; the number of parts stays.

mod car;
mod hall;
mod machine;
mod room;
mod scan;
mod shapes;

use crate::common::rng::Rng;
use crate::data::SceneRow;
use crate::failure::{Failure, Outcome};
use glam::DAffine3;
use outcrop::base::units::UpAxis;
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink};
use shapes::Shape;

/// A scene of the table `ALL`: makes parts at a fineness.
#[derive(Debug, Clone, Copy)]
pub struct Kind(fn(&mut Maker));

/// By name, as rows have it.
const ALL: [(&str, Kind); 5] = [
    ("room", Kind(room::make)),
    ("hall", Kind(hall::make)),
    ("machine", Kind(machine::make)),
    ("car", Kind(car::make)),
    ("scan", Kind(scan::make)),
];

/// A part of a scene.
#[derive(Debug, Clone)]
pub struct Part {
    pub name: String,
    pub material: MaterialDesc,
    pub shape: Shape,
}

/// How far the number of triangles may be off the one that a row asks for.
const OFF: f64 = 0.02;

/// Tries that find the fineness for a number of triangles.
const TRIES: usize = 16;

impl Kind {
    pub fn of(name: &str) -> Result<Self, Failure> {
        let found = ALL.into_iter().find(|(known, _)| *known == name);
        found
            .map(|(_, kind)| kind)
            .ok_or_else(|| Failure::new(format!("no everyday {name:?}; there are {:?}", ALL.map(|(name, _)| name))))
    }

    /// Sends the scene to a sink.
    pub fn fill(self, row: &SceneRow, sink: &mut dyn Sink) -> Outcome {
        sink.units(Some(1.0), UpAxis::Z);
        let mut known: Vec<(MaterialDesc, u32)> = Vec::new();
        for Part { name, material, shape } in self.parts(row)? {
            let key = match known.iter().find(|(other, _)| *other == material) {
                Some((_, key)) => *key,
                None => {
                    let key = sink.material(material)?;
                    known.push((material, key));
                    key
                }
            };
            let part = sink.part(PartDesc { name, material: Some(key), ..PartDesc::default() })?;
            sink.triangles(MeshKey::DIRECT, part, &shape.corners(), Attributes::NONE)?;
        }
        Ok(())
    }

    /// The parts at the fineness that comes nearest to the number of triangles. Surfaces take triangles by the square
    /// of the fineness, which the next try supposes.
    fn parts(self, row: &SceneRow) -> Result<Vec<Part>, Failure> {
        let wanted = row.triangles as f64;
        let off = |count: usize| (count as f64 / wanted - 1.0).abs();
        let (mut fineness, mut best) = (1.0, None::<(usize, Vec<Part>)>);
        for _ in 0..TRIES {
            let mut maker = Maker::new(fineness, row.seed);
            (self.0)(&mut maker);
            let count: usize = maker.parts.iter().map(|part| part.shape.triangles.len()).sum();
            fineness *= (wanted / count as f64).sqrt();
            if best.as_ref().is_none_or(|(least, _)| off(count) < off(*least)) {
                best = Some((count, maker.parts));
            }
            if off(count) < 0.2 * OFF {
                break;
            }
        }
        let (count, parts) = best.expect("one try at least");
        if off(count) > OFF {
            return Err(Failure::new(format!("scene {:?} comes to {count} triangles at best", row.name)));
        }
        Ok(parts)
    }
}

/// Collects the parts of a scene.
pub struct Maker {
    pub rng: Rng,
    /// Factor to the numbers of sides.
    fineness: f64,
    /// Likewise, of the thing in the making.
    own: f64,
    pub parts: Vec<Part>,
}

impl Maker {
    fn new(fineness: f64, seed: u64) -> Self {
        Self { rng: Rng::new(seed), fineness, own: fineness, parts: Vec::new() }
    }

    /// Begins a thing: equal ones are cut a little differently, as exporters cut them by size.
    pub fn begin(&mut self) {
        self.own = self.fineness * self.rng.between(0.85, 1.15);
    }

    /// How many sides a curve has that has `usual` ones at fineness 1, and at least 3.
    pub fn sides(&self, usual: f64) -> usize {
        self.at_least(3, usual)
    }

    /// How many pieces something has that may have as few as `least`.
    pub fn at_least(&self, least: usize, usual: f64) -> usize {
        ((usual * self.own).round() as usize).max(least)
    }

    pub fn fineness(&self) -> f64 {
        self.fineness
    }

    /// Turns all parts about the z axis by an angle in degrees.
    pub fn turn(&mut self, degrees: f64) {
        let turn = DAffine3::from_rotation_z(degrees.to_radians());
        for part in &mut self.parts {
            part.shape.vertices.iter_mut().for_each(|v| *v = turn.transform_point3(*v));
        }
    }

    pub fn add(&mut self, name: impl Into<String>, material: MaterialDesc, shape: Shape) {
        self.parts.push(Part { name: name.into(), material, shape });
    }
}

/// Matt paint, wood, stone and cloth.
pub const fn matt(red: f32, green: f32, blue: f32) -> MaterialDesc {
    MaterialDesc { colour: [red, green, blue], opacity: 1.0, metalness: 0.0, roughness: 0.8 }
}

/// Lacquer and plastics.
pub const fn glossy(red: f32, green: f32, blue: f32) -> MaterialDesc {
    MaterialDesc { colour: [red, green, blue], opacity: 1.0, metalness: 0.0, roughness: 0.3 }
}

pub const fn metal(grey: f32) -> MaterialDesc {
    MaterialDesc { colour: [grey, grey, grey], opacity: 1.0, metalness: 1.0, roughness: 0.4 }
}

pub const fn glass() -> MaterialDesc {
    MaterialDesc { colour: [0.25, 0.3, 0.3], opacity: 0.35, metalness: 0.0, roughness: 0.1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use outcrop::import::collect::Collector;

    fn made(name: &str, triangles: u64) -> Collector {
        let text = format!("name = 'test'\ntitle = ''\neveryday = '{name}'\ntriangles = {triangles}\nseed = 1");
        let row: SceneRow = toml::from_str(&text).expect("a row");
        let mut collector = Collector::new();
        Kind::of(name).expect("a scene").fill(&row, &mut collector).expect("it is made");
        collector
    }

    /// As `benchmarks.toml` has them, each with its least number of parts and a box that it is in.
    #[test]
    fn scenes_are_as_large_as_they_are_to_be() {
        let scenes = [
            ("room", 300_000, 1000, DVec3::new(16.0, 12.0, 4.0)),
            ("hall", 70_000, 100, DVec3::new(44.0, 24.0, 16.0)),
            ("machine", 700_000, 1000, DVec3::new(8.0, 5.0, 5.0)),
            ("car", 300_000, 100, DVec3::new(5.0, 2.5, 1.8)),
            ("scan", 70_000, 1, DVec3::new(0.2, 0.2, 0.2)),
        ];
        for (name, triangles, parts, size) in scenes {
            let scene = made(name, triangles);
            let off = scene.received as f64 / triangles as f64 - 1.0;
            assert!(off.abs() < OFF, "{name}: {} triangles", scene.received);
            assert!(scene.parts.len() >= parts, "{name}: {} parts", scene.parts.len());
            assert!(scene.parts.iter().all(|part| !part.name.is_empty() && part.material.is_some()), "{name}");
            let mut has = vec![false; scene.parts.len()];
            scene.direct().iter().for_each(|t| has[t.part as usize] = true);
            assert!(has.iter().all(|has| *has), "{name}: a part without triangles");
            assert!(scene.direct().iter().flat_map(|t| t.positions).all(|p| p.is_finite()), "{name}");
            let extent = scene.bounds().extent();
            assert!(extent.cmple(size).all() && extent.cmpge(0.5 * size).all(), "{name}: {extent}");
        }
    }

    #[test]
    fn scenes_are_the_same_each_time_and_parts_do_not_depend_on_size() {
        for (name, _) in ALL {
            let [once, again, finer] = [40_000, 40_000, 60_000].map(|triangles| match name {
                "machine" => made(name, 8 * triangles),
                "room" | "car" => made(name, 4 * triangles),
                _ => made(name, triangles),
            });
            assert!(once.direct() == again.direct() && once.parts == again.parts, "{name}");
            assert_eq!(once.parts, finer.parts, "{name}");
            assert!(finer.received > once.received, "{name}");
        }
    }
}
