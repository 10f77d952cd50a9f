use super::grow::Stem;
use super::*;
use crate::import::{MaterialKey, PartKey};
use std::collections::HashMap;

/// A target that keeps everything it receives.
#[derive(Default)]
struct Kept {
    units: Option<(Option<f64>, UpAxis)>,
    materials: Vec<(MaterialDesc, String)>,
    parts: Vec<PartDesc>,
    vertices: Vec<[f32; 3]>,
    faces: Vec<(PartKey, [u32; 3])>,
}

impl Target for Kept {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) -> Result<()> {
        self.units = Some((metres_per_unit, up));
        Ok(())
    }
    fn material(&mut self, material: MaterialDesc, name: &str) -> Result<MaterialKey> {
        self.materials.push((material, name.into()));
        Ok(self.materials.len() as u32 - 1)
    }
    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        self.parts.push(part);
        Ok(self.parts.len() as u32 - 1)
    }
    fn indexed(
        &mut self,
        part: PartKey,
        vertices: &[[f32; 3]],
        faces: &[[u32; 3]],
        at: &dyn Fn(u32) -> [f32; 3],
    ) -> Result<()> {
        self.vertices.extend(vertices);
        for face in faces {
            assert_eq!(face.map(at), face.map(|v| self.vertices[v as usize]));
            self.faces.push((part, *face));
        }
        Ok(())
    }
    fn soup(&mut self, _: PartKey, _: &[[[f32; 3]; 3]]) -> Result<()> {
        Err(Error::bad_argument("unused"))
    }
}

impl Kept {
    fn triangles(&self) -> impl Iterator<Item = (PartKey, [DVec3; 3])> {
        let at = |v: u32| DVec3::from(self.vertices[v as usize].map(f64::from));
        self.faces.iter().map(move |(part, face)| (*part, face.map(at)))
    }

    /// Returns the total area of a part.
    fn area(&self, part: PartKey) -> f64 {
        self.triangles().filter(|(p, _)| *p == part).map(|(_, t)| area(&t)).sum()
    }

    /// Returns the FNV-1a hash of all coordinates, parts and indices.
    fn hash(&self) -> u64 {
        let numbers = self.vertices.iter().flatten().map(|c| c.to_bits());
        let faces = self.faces.iter().flat_map(|(part, [a, b, c])| [*part, *a, *b, *c]);
        let bytes = numbers.chain(faces).flat_map(u32::to_le_bytes);
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash, b| (hash ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
    }
}

fn area(t: &[DVec3; 3]) -> f64 {
    0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length()
}

fn made(species: usize, triangles: u64, seed: u64) -> Kept {
    let mut kept = Kept::default();
    let options = GenerateOptions { triangles, seed, species: species as u32 };
    generate(&options, &Cancel::new(), &mut kept).unwrap();
    kept
}

#[test]
fn counts_are_met_but_for_one_leaf_or_twig() {
    for (i, species) in SPECIES.iter().enumerate() {
        for wanted in [2_000, 5_000, 25_000, 60_000, 200_000] {
            let found = made(i, wanted, 1).faces.len() as u64;
            assert!(found <= wanted && wanted - found < 40, "{} {wanted}: {found}", species.name);
        }
    }
}

#[test]
fn plants_stand_on_the_ground_and_are_as_high_as_their_species() {
    for (i, species) in SPECIES.iter().enumerate() {
        let mut heights = Vec::new();
        for seed in 0..4 {
            for triangles in [5_000, 25_000] {
                let kept = made(i, triangles, seed);
                let [low, high] = [f32::min, f32::max].map(|f| kept.vertices.iter().map(|v| v[2]).reduce(f).unwrap());
                let name = format!("{} {seed} {triangles}", species.name);
                assert_eq!(low, 0.0, "{name}");
                assert!(kept.vertices.iter().flatten().all(|c| c.is_finite()), "{name}");
                let [least, most] = species.height.map(|h| h as f32);
                assert!((least * 0.999_999..most * 1.000_001).contains(&high), "{name}: {high} m");
                let wide = kept.vertices.iter().map(|v| v[0].hypot(v[1])).reduce(f32::max).unwrap();
                assert!(wide < 1.5 * high, "{name}: {wide} m wide, {high} m high");
                let foot = kept.vertices.iter().filter(|v| v[2] < 0.01 * high);
                let near = foot.map(|v| v[0].hypot(v[1])).reduce(f32::min).unwrap();
                assert!(near < 0.06 * high, "{name}: foot {near} m from the origin");
                heights.push(high);
            }
        }
        heights.dedup_by(|a, b| (*a / *b - 1.0).abs() < 1e-6);
        assert_eq!(heights.len(), 4, "{}: one height for each seed", species.name);
    }
}

#[test]
fn stems_are_closed_and_no_triangle_is_degenerate() {
    for (i, species) in SPECIES.iter().enumerate() {
        for triangles in [5_000, 60_000] {
            let kept = made(i, triangles, 2);
            let thinnest = kept
                .triangles()
                .map(|(_, t)| {
                    let longest = (0..3).map(|k| t[k].distance(t[(k + 1) % 3])).fold(0.0, f64::max);
                    2.0 * area(&t) / longest
                })
                .fold(f64::INFINITY, f64::min);
            println!("{} {triangles}: thinnest {thinnest:e} m", species.name);
            assert!(thinnest > 1e-5 * species.height[0], "{} {triangles}: {thinnest:e} m", species.name);
            for organ in [Organ::Bark, Organ::Twigs] {
                let part = 1 + organ as u32;
                let mut edges: HashMap<(u32, u32), [u32; 2]> = HashMap::new();
                for (_, f) in kept.faces.iter().filter(|f| f.0 == part) {
                    for k in 0..3 {
                        let (a, b) = (f[k], f[(k + 1) % 3]);
                        edges.entry((a.min(b), a.max(b))).or_default()[usize::from(a < b)] += 1;
                    }
                }
                assert!(edges.values().all(|n| *n == [1, 1]), "{} {triangles} {organ:?}", species.name);
                // Outward orientation: the divergence theorem gives a positive volume.
                let solid = kept.triangles().filter(|(p, _)| *p == part);
                let volume: f64 = solid.map(|(_, t)| t[0].dot(t[1].cross(t[2])) / 6.0).sum();
                assert!(volume > 0.0, "{} {organ:?}: {volume}", species.name);
            }
        }
    }
}

#[test]
fn parts_are_bark_twigs_and_leaves() {
    for (i, species) in SPECIES.iter().enumerate() {
        let kept = made(i, 5_000, 0);
        let names: Vec<_> = kept.parts.iter().map(|p| p.name.as_str()).collect();
        let expected = [species.name, "bark", "twigs", "leaves"];
        let expected = if species.name == "dead tree" { &expected[..3] } else { &expected[..] };
        assert_eq!(names, expected);
        assert_eq!(kept.units, Some((Some(1.0), UpAxis::Z)));
        for (part, desc) in kept.parts.iter().enumerate() {
            assert_eq!((desc.id, desc.parent), (Some(part as u64 + 1), (part > 0).then_some(0)));
            let material = desc.material.map(|m| kept.materials[m as usize].1.as_str());
            assert_eq!(material, (part > 0).then_some(expected[part]));
            let count = kept.faces.iter().filter(|f| f.0 == part as u32).count();
            assert_eq!(count > 0, part > 0, "{} {}: {count} triangles", species.name, desc.name);
        }
    }
}

/// The least distance from a point to the axes of some stems, by brute force.
fn distance(point: DVec3, stems: &[Stem]) -> f64 {
    let segments = stems.iter().flat_map(|s| s.axis.windows(2));
    let to_segment = |pair: &[grow::Station]| {
        let (a, along) = (pair[0].at, pair[1].at - pair[0].at);
        let t = ((point - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        point.distance(a + along * t)
    };
    segments.map(to_segment).fold(f64::INFINITY, f64::min)
}

#[test]
fn leaves_are_on_twigs_and_twigs_on_branches() {
    for species in &SPECIES {
        let plant = Plant::grow(species, species.height[1], 3_000, 5);
        for pair in plant.levels.windows(2) {
            for stem in &pair[1] {
                let d = distance(stem.axis[0].at, &pair[0]);
                assert!(d < 1e-9 * species.height[1], "{}: a stem {d} m from its parent", species.name);
            }
        }
        let twigs = plant.levels.last().unwrap();
        let width = species.leaf.map_or(0.0, |l| l.length * l.width * plant.leaf_scale[1] * 1.2);
        let mut raised = 0;
        let Ok(()) = pieces(&plant, Organ::Leaves, |leaf| {
            let d = distance(leaf.vertices[0], twigs);
            raised += u64::from(d > 1e-9 * species.height[1]);
            assert!(d <= width, "{}: a leaf {d} m from its twig", species.name);
            Ok::<_, std::convert::Infallible>(())
        });
        let leaves: u64 = plant.leaves.iter().sum();
        assert!(raised * 4 <= leaves, "{}: {raised} of {leaves} leaves are raised", species.name);
    }
}

/// Returns the mean distance of the surface from the vertical axis in each tenth of the height, over the height.
fn profile(kept: &Kept) -> [f64; 10] {
    let high = kept.vertices.iter().map(|v| f64::from(v[2])).fold(0.0, f64::max);
    let mut sums = [(0.0, 1e-9); 10];
    for (_, t) in kept.triangles() {
        let middle = (t[0] + t[1] + t[2]) / 3.0;
        let sum = &mut sums[((middle.z / high * 10.0) as usize).min(9)];
        sum.0 += area(&t) * middle.truncate().length() / high;
        sum.1 += area(&t);
    }
    sums.map(|(r, a)| r / a)
}

/// Outline, height, share of leaves and colours as one vector, the mean of three plants.
fn features(species: usize) -> Vec<f64> {
    let of_seed = |seed: u64| {
        let kept = made(species, 10_000, seed);
        let high = kept.vertices.iter().map(|v| f64::from(v[2])).fold(0.0, f64::max);
        let whole: f64 = (1..kept.parts.len()).map(|p| kept.area(p as u32)).sum();
        let colours = SPECIES[species].colours.as_flattened().iter().map(|&c| 2.0 * f64::from(c));
        let others = [0.2 * high.ln(), kept.area(3) / whole];
        profile(&kept).into_iter().chain(others).chain(colours).collect::<Vec<_>>()
    };
    let [a, b, c] = [1, 2, 3].map(of_seed);
    (0..a.len()).map(|i| (a[i] + b[i] + c[i]) / 3.0).collect()
}

#[test]
fn species_differ() {
    let all: Vec<_> = (0..SPECIES.len()).map(features).collect();
    for (i, a) in all.iter().enumerate() {
        for (j, b) in all.iter().enumerate().skip(i + 1) {
            let apart = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
            assert!(apart > 0.25, "{} and {}: {apart}", SPECIES[i].name, SPECIES[j].name);
        }
    }
}

#[test]
fn leaf_area_hardly_depends_on_the_number_of_triangles() {
    for (i, species) in SPECIES.iter().enumerate().filter(|(_, s)| s.leaf.is_some()) {
        let [coarse, fine] = [10_000, 100_000].map(|triangles| made(i, triangles, 3).area(3));
        println!("{}: {coarse} m² in 10,000 triangles, {fine} m² in 100,000", species.name);
        assert!((0.5..2.0).contains(&(coarse / fine)), "{}: {coarse} and {fine} m²", species.name);
    }
}

/// Hashes of 5,000 triangles with seed 7, equal on all machines. A change of the table changes them.
const HASHES: [u64; SPECIES.len()] = [
    0x0aeb_5e2d_95be_07fa,
    0x89c0_bb4e_e02c_5dec,
    0x5f48_9e6c_b524_8fce,
    0x5109_b313_23af_36ee,
    0x3a8f_b62e_69ed_bf16,
    0xc908_b38f_17f1_96e4,
    0x53f1_b5dd_5091_b37d,
    0x19e7_a8bc_a82f_a1c1,
    0x6045_09ee_2cf8_62ef,
    0x7ac1_602d_5be3_c694,
    0xd422_3cf6_f62a_e2ac,
    0xf78c_b48f_3bc9_8565,
    0x2fa8_8d4b_7684_7f07,
];

#[test]
fn bits_are_the_same_everywhere() {
    let found: Vec<_> = (0..SPECIES.len()).map(|i| made(i, 5_000, 7).hash()).collect();
    assert_eq!(found, HASHES, "{found:#018x?}");
    for i in 0..SPECIES.len() {
        assert_ne!(made(i, 5_000, 8).hash(), found[i], "{}", SPECIES[i].name);
    }
}

#[test]
fn bad_options_are_refused_by_name() {
    let refused = |species: u32, triangles: u64| {
        let mut kept = Kept::default();
        let out = generate(&GenerateOptions { triangles, seed: 0, species }, &Cancel::new(), &mut kept);
        assert!(kept.parts.is_empty() && kept.faces.is_empty());
        match out {
            Err(Error::BadArgument(why)) => why,
            other => panic!("{species} {triangles}: {other:?}"),
        }
    };
    for species in [13, u32::MAX] {
        assert!(refused(species, 25_000).contains(&format!("species {species}")));
    }
    for triangles in [0, 1_999, 4_000_001, u64::MAX] {
        assert!(refused(0, triangles).contains("number of triangles"));
    }
}
