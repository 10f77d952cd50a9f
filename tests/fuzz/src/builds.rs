//! Small meshes with hostile coordinates: built, opened, asked in every way and on every instruction set, and compared
//! with brute force in double precision over the triangles that the file stores.

use super::brute::{Brute, Oracle, Ray64, Tri};
use super::errors::{Judge, Verdict};
use super::files;
use super::not_internal;
use super::rays::RayMaker;
use super::rounding::{Rounding, point_distance};
use super::stored::{self, StoredTree};
use super::within;
use arbitrary::{Result, Unstructured};
use glam::{DAffine3, DVec3, Vec3};
use outcrop::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder, Splits};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::scene::{Context, ContextOptions, Model, Scene, SceneState};
use outcrop::simd::Isa;
use std::path::Path;
use std::sync::Arc;

/// Bytes that building and asking of a model of a few hundred triangles may hold.
const MEMORY: u64 = 160 << 20;
const RAYS: usize = 40;

/// The target.
pub fn run(data: &[u8]) {
    let Ok(case) = Case::of(&mut Unstructured::new(data)) else { return };
    within(MEMORY, || case.check());
}

/// Options of a build in the calling thread.
pub fn options() -> BuildOptions {
    BuildOptions { threads: 1, temp_dir: files::path("").parent().map(Path::to_path_buf), ..BuildOptions::default() }
}

/// Builds a mesh file that was read, and asks the model.
pub fn file(path: &Path) {
    within(MEMORY, || {
        let out = files::path("built.oc");
        let mut builder = builder(options());
        builder.add_file(path).expect("the file was read before");
        builder.finish(&out).expect("a sound input is built");
        let trees = stored::trees(&out);
        let Some(tree) = trees.iter().find(|tree| !tree.tris.is_empty()) else { return };
        let corners = tree.corners();
        let rays: Vec<Ray> = RayMaker::new(&corners, 1).batch(20).iter().map(|ray| tree.place(ray).0).collect();
        Asked::of(&out).same(&rays);
    });
}

fn builder(options: BuildOptions) -> Builder {
    Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder")
}

/// Scenes of one model, one for each instruction set.
pub struct Asked(Vec<Arc<SceneState>>);

impl Asked {
    /// Opens the model at `path`.
    pub fn of(path: &Path) -> Self {
        Self(contexts(256 << 20).iter().map(|context| opened(context, path)).collect())
    }

    /// Returns the hits of all rays: the same as single rays and in packets, on every instruction set. `any` agrees
    /// with the hits in double precision or, on slivers, in single precision.
    pub fn same(&self, rays: &[Ray]) -> Vec<Hit> {
        let mut answers = self.0.iter().flat_map(|state| [false, true].map(|coherent| closest(state, rays, coherent)));
        let first = answers.next().expect("an instruction set");
        first.iter().zip(rays).for_each(|(hit, ray)| assert_sane(ray, hit));
        for other in answers {
            for ((a, b), ray) in first.iter().zip(&other).zip(rays) {
                assert_eq!(a, b, "another way, another answer: {ray:?}");
            }
        }
        for state in &self.0 {
            let mut any = vec![2; rays.len()];
            state.any(rays, QueryOptions::default(), &mut any).expect("answers");
            let mut single = vec![Hit::MISS; rays.len()];
            let options = QueryOptions { want: Want::NOTHING, ..QueryOptions::default() };
            state.closest(rays, options, &mut single).expect("hits");
            for (((hit, single), any), ray) in first.iter().zip(single).zip(any).zip(rays) {
                let agrees = |hit: &Hit| any == u8::from(hit.kind != HitKind::Miss);
                assert!(agrees(hit) || agrees(&single), "closest and any differ: {ray:?}: {hit:?}");
            }
        }
        first
    }
}

/// A context without threads for each instruction set of this machine.
pub fn contexts(memory_budget: u64) -> Vec<Context> {
    let of = |isa| {
        let options = ContextOptions {
            threads: 0,
            memory_budget,
            isa: Some(isa),
            read_ahead: false,
            ..ContextOptions::default()
        };
        Context::new(options).expect("a context")
    };
    Isa::ALL.into_iter().filter(|isa| isa.is_available()).map(of).collect()
}

fn opened(context: &Context, path: &Path) -> Arc<SceneState> {
    let model = Model::open(context, path).expect("what was built opens");
    model.check(&Cancel::new()).expect("what was built is sound");
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    scene.state()
}

fn closest(state: &SceneState, rays: &[Ray], coherent: bool) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    let want = Want::ALL | Want::SHADING_NORMAL;
    state.closest(rays, QueryOptions { coherent, want, ..QueryOptions::default() }, &mut hits).expect("hits");
    hits
}

fn assert_sane(ray: &Ray, hit: &Hit) {
    let numbers = [f64::from(hit.error), hit.t_free, hit.uv[0].into(), hit.uv[1].into()];
    let sane = !hit.t.is_nan() && numbers.iter().all(|x| !x.is_nan()) && !hit.position.is_nan();
    assert!(sane, "{ray:?}: {hit:?}");
    if hit.kind != HitKind::Miss {
        assert!(hit.kind == HitKind::Exact && hit.t.is_finite() && hit.t >= ray.begins(), "{ray:?}: {hit:?}");
        assert!((hit.normal.length() - 1.0).abs() < 1e-5, "{ray:?}: {hit:?}");
        assert!((hit.shading_normal.length() - 1.0).abs() < 1e-5, "{ray:?}: {hit:?}");
        assert!(hit.shading_normal.dot(hit.normal) >= -1e-6, "{ray:?}: {hit:?}");
    }
}

struct Case {
    splits: Splits,
    crease_angle: f32,
    parts: u32,
    /// Part and corners.
    direct: Vec<(u32, Tri)>,
    /// Normals of the corners of all direct triangles, if they are given.
    normals: Option<[Vec3; 3]>,
    shared: Vec<Tri>,
    instances: Vec<DAffine3>,
    rays: Vec<Ray>,
    seed: u64,
}

/// Numbers at which something changes: signs of zero, the ends of single precision, of its normal numbers, and beyond.
const SPECIAL: [f64; 16] = [
    0.0,
    -0.0,
    f32::MIN_POSITIVE as f64,
    1e-45,
    -1e-38,
    1e-30,
    f32::MAX as f64,
    -(f32::MAX as f64),
    1e15,
    -2e15,
    1e300,
    -f64::MAX,
    5e-324,
    f64::NAN,
    f64::INFINITY,
    16777217.0,
];

/// A small integer times the scale, or something hostile.
pub fn coordinate(u: &mut Unstructured, scale: f64, offset: f64) -> Result<f64> {
    Ok(match u.int_in_range(0..=15)? {
        0..=8 => f64::from(u.int_in_range(-4..=4)?) * scale + offset,
        9 => f64::from(u.arbitrary::<i16>()?) / 4096.0 * scale + offset,
        10 => (f64::from(u.int_in_range(-4..=4)?) * scale + offset).next_up(),
        11 => {
            let near = (f64::from(u.int_in_range(-4..=4)?) * scale + offset) as f32;
            f64::from(if u.arbitrary()? { near.next_up() } else { near.next_down() })
        }
        12 => f64::from(u.arbitrary::<f32>()?),
        13 => *u.choose(&SPECIAL)?,
        14 => offset + scale * 1e-7 * f64::from(u.int_in_range(-4..=4)?),
        _ => u.arbitrary()?,
    })
}

fn point(u: &mut Unstructured, scale: f64, offset: f64) -> Result<DVec3> {
    Ok(DVec3::new(coordinate(u, scale, offset)?, coordinate(u, scale, offset)?, coordinate(u, scale, offset)?))
}

impl Case {
    fn of(u: &mut Unstructured) -> Result<Self> {
        let splits = *u.choose(&Splits::ALL)?;
        let scale = *u.choose(&[1.0, 1.0, 1.0, 1e-3, 1e3, 1e7, 1e-12, 1e12, 1e-30, 1e30])?;
        let offset = *u.choose(&[0.0, 0.0, 0.0, 1e3, 1e6, -1e9, 1e12])?;
        let vertices = (0..u.int_in_range(3..=20)?).map(|_| point(u, scale, offset)).collect::<Result<Vec<DVec3>>>()?;
        let triangle = |u: &mut Unstructured| Ok([*u.choose(&vertices)?, *u.choose(&vertices)?, *u.choose(&vertices)?]);
        let parts = u.int_in_range(1..=3)?;
        let direct = (0..u.int_in_range(1..=40)?)
            .map(|_| Ok((u.int_in_range(0..=parts - 1)?, triangle(u)?)))
            .collect::<Result<Vec<(u32, Tri)>>>()?;
        let normal = |u: &mut Unstructured| point(u, 1.0, 0.0).map(|p| p.as_vec3());
        let normals = if u.ratio(1, 3)? { Some([normal(u)?, normal(u)?, normal(u)?]) } else { None };
        let crease_angle = *u.choose(&[0.0, 0.0, 180.0, 90.0, -1.0])?;
        let shared = (0..u.int_in_range(0..=4)?).map(|_| triangle(u)).collect::<Result<Vec<Tri>>>()?;
        let instances = (0..u.int_in_range(0..=2)?).map(|_| transform(u, scale)).collect::<Result<Vec<_>>>()?;
        let rays = (0..u.int_in_range(0..=8)?).map(|_| ray(u, &vertices, scale, offset)).collect::<Result<Vec<_>>>()?;
        Ok(Self { splits, crease_angle, parts, direct, normals, shared, instances, rays, seed: u.arbitrary()? })
    }

    fn check(&self) {
        let mut builder = builder(BuildOptions { splits: self.splits, crease_angle: self.crease_angle, ..options() });
        for id in 0..self.parts {
            builder.part(PartDesc { id: Some(u64::from(id) + 100), ..PartDesc::default() }).expect("a part");
        }
        for (part, triangle) in &self.direct {
            let normals = self.normals.map(|normals| [normals]);
            let values = Attributes { normals: normals.as_ref().map(|n| &n[..]), ..Attributes::NONE };
            builder.triangles(MeshKey::DIRECT, *part, &[*triangle], values).expect("a triangle");
        }
        let mesh = builder.shared_mesh(1).expect("a mesh");
        builder.triangles(mesh, 0, &self.shared, Attributes::NONE).expect("triangles");
        let mut placed = 0;
        for at in &self.instances {
            // Refused if it is not invertible.
            placed += usize::from(builder.instance(mesh, *at, 0).map_err(|e| not_internal(&e)).is_ok());
        }
        let out = files::path("case.oc");
        let report = match builder.finish(&out) {
            // A placement may carry a mesh beyond the numbers of double precision.
            Err(Error::BadArgument(why)) if self.is_far() => return assert!(why.contains("bounds"), "{why}"),
            built => built.expect("any triangles are built"),
        };
        let dropped = report.non_finite + report.degenerate + report.out_of_range;
        let unplaced = if placed == 0 { self.shared.len() as u64 } else { 0 };
        assert_eq!(report.triangles_in, (self.direct.len() + self.shared.len()) as u64);
        assert!(report.triangles_kept + dropped + unplaced >= report.triangles_in, "{report:?}");
        let asked = Asked::of(&out);
        let trees = stored::trees(&out);
        self.near_their_triangles(&asked.same(&self.rays));
        match &trees[..] {
            [only] if !only.tris.is_empty() => self.judge(&asked, only),
            [] => {}
            _ => {
                let some = trees.iter().filter(|tree| !tree.tris.is_empty());
                for tree in some {
                    let rays = RayMaker::new(&tree.corners(), self.seed).batch(RAYS / 2);
                    let rays: Vec<Ray> = rays.iter().map(|ray| tree.place(ray).0).collect();
                    self.near_their_triangles(&asked.same(&rays));
                }
            }
        }
    }

    /// An instance has a number that may overflow.
    fn is_far(&self) -> bool {
        self.instances.iter().flat_map(DAffine3::to_cols_array).any(|x| x.abs() > 1e200)
    }

    /// All answers of a model of one tree are those of brute force.
    fn judge(&self, asked: &Asked, tree: &StoredTree) {
        let oracle = Brute::new(tree.corners());
        let judge = Judge::new(&oracle, Rounding::LOCALISED);
        let rays = RayMaker::new(oracle.tris(), self.seed).batch(RAYS);
        let (world, local): (Vec<Ray>, Vec<Ray64>) = rays.iter().map(|ray| tree.place(ray)).unzip();
        let hits = asked.same(&world);
        self.near_their_triangles(&hits);
        for ((ray, local), hit) in world.iter().zip(&local).zip(&hits) {
            let truth = oracle.closest(local);
            let got = tree.answer(hit, |part| u64::from(part) + 100);
            let ruling = judge.closest(local, truth, got);
            let wrong = matches!(ruling.verdict, Verdict::Wrong(_));
            assert!(!wrong, "{:?}: {ray:?}, {hit:?}, {got:?}, oracle {truth:?}", ruling.verdict);
        }
    }

    /// Each hit is within its stated error of its triangle of the input.
    fn near_their_triangles(&self, hits: &[Hit]) {
        for hit in hits.iter().filter(|hit| hit.kind != HitKind::Miss) {
            let Some((part, triangle)) = self.direct.get(hit.prim as usize) else {
                assert!(hit.prim < (self.direct.len() + self.shared.len()) as u64, "{hit:?}");
                continue;
            };
            assert_eq!(hit.part, u64::from(*part) + 100, "{hit:?}");
            let size = triangle
                .iter()
                .map(|corner| corner.abs().max_element())
                .fold(hit.position.abs().max_element(), f64::max);
            let away = point_distance(hit.position, triangle);
            let allowed = f64::from(hit.error) * (1.0 + 1e-6) + size * 1e-15;
            assert!(away <= allowed || !away.is_finite(), "{away} is more than {allowed}: {hit:?} of {triangle:?}");
        }
    }
}

fn transform(u: &mut Unstructured, scale: f64) -> Result<DAffine3> {
    let mut at = DAffine3::from_translation(point(u, scale, 0.0)?);
    if u.arbitrary()? {
        for axis in 0..3 {
            at.matrix3.col_mut(axis)[axis] = coordinate(u, 1.0, 0.0)?;
        }
    }
    if u.arbitrary()? {
        at.matrix3.col_mut(0)[1] = coordinate(u, 1.0, 0.0)?;
    }
    Ok(at)
}

fn ray(u: &mut Unstructured, vertices: &[DVec3], scale: f64, offset: f64) -> Result<Ray> {
    let origin = if u.arbitrary()? { point(u, scale, offset)? } else { *u.choose(vertices)? };
    let to = match u.int_in_range(0..=3)? {
        0 => point(u, scale, offset)?,
        1 => *u.choose(vertices)?,
        2 => (*u.choose(vertices)? + *u.choose(vertices)?) * 0.5,
        _ => origin + point(u, 1.0, 0.0)?,
    };
    let mut ray = Ray::new(origin, (to - origin).as_vec3());
    if u.arbitrary()? {
        let mut number = || Ok(coordinate(u, 1.0, 0.0)? as f32);
        ray.dir = Vec3::new(number()?, number()?, number()?);
    }
    if u.arbitrary()? {
        (ray.t_min, ray.t_max) = (coordinate(u, 1.0, 0.0)?, coordinate(u, scale, 0.0)?);
    }
    Ok(ray)
}
