//! The benchmarks as data: what `benchmarks.toml` says, checked once.

use outcrop::build::{BuildOptions, Splits, StandIns, Structure};
use outcrop::scene::Camera;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::Path;

/// Edge of the blocks of pixels in whose order rays go.
pub const TILE: u32 = 4;

/// All structures, scenes and benchmarks.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    #[serde(rename = "structure")]
    pub structures: Vec<StructureRow>,
    #[serde(rename = "scene")]
    pub scenes: Vec<SceneRow>,
    #[serde(rename = "benchmark")]
    pub benchmarks: Vec<Benchmark>,
}

/// A way to build models. Whatever the crate can build is a row of data.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StructureRow {
    /// As benchmarks and charts call it.
    pub name: String,
    /// [`Structure::name`].
    pub structure: String,
    /// [`Splits::name`].
    #[serde(default = "automatic")]
    pub splits: String,
    /// [`StandIns::name`].
    #[serde(default = "automatic_look")]
    pub stand_ins: String,
}

fn automatic() -> String {
    Splits::default().name().into()
}

fn automatic_look() -> String {
    StandIns::default().name().into()
}

impl StructureRow {
    /// How it is built; a message for what the crate does not know.
    pub fn options(&self) -> Result<BuildOptions, String> {
        let unknown = |what: &str| format!("structure {:?}: no {what}", self.name);
        let structure = Structure::ALL.into_iter().find(|s| s.name() == self.structure);
        let splits = Splits::ALL.into_iter().find(|s| s.name() == self.splits);
        let stand_ins = StandIns::ALL.into_iter().find(|s| s.name() == self.stand_ins);
        Ok(BuildOptions {
            structure: structure.ok_or_else(|| unknown(&format!("structure {:?}", self.structure)))?,
            splits: splits.ok_or_else(|| unknown(&format!("splits {:?}", self.splits)))?,
            stand_ins: stand_ins.ok_or_else(|| unknown(&format!("stand-ins {:?}", self.stand_ins)))?,
            ..BuildOptions::default()
        })
    }
}

/// A scene: exactly one of `generator`, `formula`, `file`, `assembly` and `everyday` gives its triangles.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneRow {
    pub name: String,
    /// As charts call it.
    pub title: String,
    /// A generator of the crate, with the number of triangles and the seed.
    pub generator: Option<String>,
    #[serde(default)]
    pub triangles: u64,
    #[serde(default)]
    pub seed: u64,
    /// An assembly of `src/assemblies`, whose meshes are placed; `count` and `triangles` are its size.
    pub assembly: Option<String>,
    /// A scene of `src/everyday`, with the number of triangles and the seed.
    pub everyday: Option<String>,
    /// Further places of the model in the scene, beside the one at the origin.
    #[serde(default)]
    pub also_at: Vec<[f64; 3]>,
    /// A scene of `tests/common/scenes.rs`, with the number of its things.
    pub formula: Option<String>,
    #[serde(default)]
    pub count: usize,
    /// A file of the models folder; where it is missing the scene's benchmarks are skipped.
    pub file: Option<String>,
    /// View 0 of what is looked at from within; elsewhere that is the model's own first.
    pub view: Option<CameraRow>,
    /// Views 4, 5 and so on; 0 to 3 are the model's own (`Model::views`).
    #[serde(default, rename = "camera")]
    pub cameras: Vec<CameraRow>,
}

/// A perspective view.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraRow {
    pub eye: [f64; 3],
    pub at: [f64; 3],
    #[serde(default = "up")]
    pub up: [f64; 3],
    pub fov_y_degrees: f64,
}

fn up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

impl SceneRow {
    /// Whether rays meet several placed trees. Such a scene is measured beside its flattened twin: the same triangles
    /// in one tree.
    pub fn has_many_trees(&self) -> bool {
        self.assembly.is_some() || !self.also_at.is_empty()
    }

    /// View `view`, given the model's own.
    pub fn camera(&self, own: &[Camera; 4], view: usize) -> Camera {
        let row = match self.view {
            Some(row) if view == 0 => row,
            _ if view < own.len() => return own[view],
            _ => self.cameras[view - own.len()],
        };
        let CameraRow { eye, at, up, fov_y_degrees } = row;
        Camera::Perspective { eye: eye.into(), at: at.into(), up: up.into(), fov_y_degrees }
    }
}

/// Scenes, views, structures, residencies, settings and kinds of rays: every combination is a case.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Benchmark {
    pub name: String,
    pub measure: Measure,
    pub scenes: Vec<String>,
    /// See [`SceneRow::camera`].
    #[serde(default)]
    pub views: Vec<usize>,
    #[serde(default)]
    pub structures: Vec<String>,
    #[serde(default)]
    pub residency: Vec<Residency>,
    /// Pixels of error.
    #[serde(default)]
    pub poe: Vec<f32>,
    #[serde(default)]
    pub rays: Vec<RayKind>,
    pub threads: Vec<usize>,
    /// Rays that outcrop is asked for in a call, up to what a thread takes at a time (`sides::CHUNK`); of 1, peers are
    /// asked for single ones too. (Of 1,024 the answers stay in a thread's own cache, and the thread that asks
    /// answers.)
    #[serde(default = "many")]
    pub asked: NonZeroUsize,
    #[serde(default)]
    pub peers: Vec<String>,
    /// Pixels of the picture whose rays these are.
    pub size: (u32, u32),
    /// Pairs of each.
    #[serde(default = "five")]
    pub rounds: usize,
    /// Bytes a second that a throttled source gives, for `measure = "cold"`.
    #[serde(default)]
    pub rates: Vec<Bytes>,
    /// Whether models are opened without any block, and nothing is read but what pictures ask for, for `measure =
    /// "cold"`. By default opening reads coarse blocks, and the rest is read in the background if it fits.
    #[serde(default)]
    pub on_demand: bool,
    /// Radians by which a second instance is turned about the vertical through the model's middle, for `measure =
    /// "clash"` and `"distance"`: triangles of both are compared. By default clashes are those of different parts.
    pub turn: Option<f64>,
    /// Shares of the model's bytes that are budgets of searches out of core, for `measure = "clash"`: 8 is an eighth.
    #[serde(default)]
    pub budget_shares: Vec<u64>,
    /// Points of each kind, for `measure = "nearest"`.
    #[serde(default)]
    pub points: usize,
    /// Instances of the model, for `measure = "many"`.
    #[serde(default)]
    pub instances: usize,
    /// Levels to which a cage is diced, for `measure = "surfaces"`.
    #[serde(default)]
    pub levels: Vec<u32>,
    /// Gaps along x between the boxes of two instances, in diagonals of the model, for `measure = "distance"`.
    #[serde(default)]
    pub gaps: Vec<f64>,
    /// Only with `FULL=1`: it takes long, or much memory.
    #[serde(default)]
    pub full: bool,
}

fn many() -> NonZeroUsize {
    const { NonZeroUsize::new(1024).expect("not zero") }
}

fn five() -> usize {
    5
}

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Measure {
    /// Time of tracing rays, or of whole pictures.
    Trace,
    /// Error of a picture over the seconds since its model was opened with nothing in memory.
    Cold,
    /// Time and size of building.
    Build,
    /// Time from stored bytes in memory to what rays read.
    Decode,
    /// CPU time of exact pictures in one thread, in each setting alone and in all together, beside Embree.
    Settings,
    /// Time of finding all pairs of triangles of two instances, or of different parts, that meet.
    Clash,
    /// CPU time of finding the points of the surface that are nearest to others, in one thread.
    Nearest,
    /// CPU time of finding the distance of two instances, in one thread.
    Distance,
    /// Bytes of surfaces, and CPU time of rays on them, in one thread.
    Surfaces,
    /// CPU time of commits of many instances of a model, and of rays in three views of them, in one thread.
    Many,
}

/// What is traced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RayKind {
    /// Through the middles of pixels, closest hit.
    Primary,
    /// From what is seen to a light, any hit.
    Shadow,
    /// From what is seen anywhere over the surface, cosine-weighted, closest hit.
    Bounce,
    /// A frame, from the camera to bytes of colour.
    Picture,
}

impl RayKind {
    pub fn name(self) -> &'static str {
        match self {
            RayKind::Primary => "primary",
            RayKind::Shadow => "shadow",
            RayKind::Bounce => "bounce",
            RayKind::Picture => "picture",
        }
    }
}

/// What is in memory: "all", "cold" or a budget in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum Residency {
    /// The whole model, before the clock runs.
    All,
    /// As much as fits so many bytes.
    Budget(u64),
    /// Nothing, and the file is not in the system's memory either where we may empty that.
    Cold,
}

impl TryFrom<String> for Residency {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        Ok(match text.as_str() {
            "all" => Residency::All,
            "cold" => Residency::Cold,
            _ => Residency::Budget(Bytes::try_from(text)?.0),
        })
    }
}

impl Residency {
    pub fn name(self) -> String {
        match self {
            Residency::All => "all".into(),
            Residency::Cold => "cold".into(),
            Residency::Budget(bytes) => format!("{}M", bytes >> 20),
        }
    }
}

/// A number of bytes: digits, then K, M or G (powers of 1024).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Bytes(pub u64);

impl TryFrom<String> for Bytes {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        let wrong = || format!("{text:?} is no number of bytes: digits, then K, M or G");
        let unit = text.chars().next_back().and_then(|c| "KMG".find(c)).ok_or_else(wrong)?;
        let digits: u64 = text[..text.len() - 1].parse().map_err(|_| wrong())?;
        Ok(Self(digits << (10 * (unit + 1))))
    }
}

/// One measurement of rays or pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    pub view: usize,
    pub structure: String,
    pub residency: Residency,
    pub rays: RayKind,
}

impl Benchmark {
    /// Every combination but for the settings, which share their rays.
    pub fn cases(&self) -> Vec<Case> {
        let mut all = Vec::new();
        for structure in &self.structures {
            for &residency in &self.residency {
                for &view in &self.views {
                    let case = |&rays: &RayKind| Case { view, structure: structure.clone(), residency, rays };
                    all.extend(self.rays.iter().map(case));
                }
            }
        }
        all
    }

    /// What expected answers are kept under. Threads are not in it: the answers do not depend on them.
    pub fn id(&self, scene: &str, case: &Case, poe: f32) -> String {
        let Case { view, structure, residency, rays } = case;
        let (residency, rays) = (residency.name(), rays.name());
        format!("{}/{scene}/{structure}/{residency}/view {view}/{rays}/PoE {poe}", self.name)
    }
}

/// Peers by name.
pub const PEERS: [&str; 3] = ["embree", "obvhs", "parry3d"];

/// Peers whose scenes of two levels are bound here (`peers::Build::build_placed`).
pub const PLACING_PEERS: [&str; 1] = ["embree"];

impl Data {
    /// Reads and checks a file.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        Self::parse(&text).map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Checks a text: every name is known, every combination makes sense.
    pub fn parse(text: &str) -> Result<Self, String> {
        let data: Self = toml::from_str(text).map_err(|e| e.to_string())?;
        let mut structures = BTreeSet::new();
        for structure in &data.structures {
            structure.options()?;
            if !structures.insert(structure.name.as_str()) {
                return Err(format!("two structures are called {:?}", structure.name));
            }
        }
        let mut names = BTreeSet::new();
        for scene in &data.scenes {
            scene.check()?;
            if !names.insert(scene.name.as_str()) {
                return Err(format!("two scenes are called {:?}", scene.name));
            }
        }
        let mut benchmarks = BTreeSet::new();
        for benchmark in &data.benchmarks {
            benchmark.check(&names, &structures)?;
            for scene in benchmark.scenes.iter().map(|name| data.scene(name)) {
                if let Some(view) = benchmark.views.iter().find(|&&view| view >= 4 + scene.cameras.len()) {
                    return Err(format!("benchmark {:?}: scene {:?} has no view {view}", benchmark.name, scene.name));
                }
                benchmark.check_trees(scene)?;
            }
            if !benchmarks.insert(benchmark.name.as_str()) {
                return Err(format!("two benchmarks are called {:?}", benchmark.name));
            }
        }
        Ok(data)
    }

    pub fn structure(&self, name: &str) -> &StructureRow {
        self.structures
            .iter()
            .find(|s| s.name == name)
            .expect("structures of benchmarks were looked up when they were read")
    }

    pub fn scene(&self, name: &str) -> &SceneRow {
        self.scenes.iter().find(|s| s.name == name).expect("scenes of benchmarks were looked up when they were read")
    }
}

impl SceneRow {
    fn check(&self) -> Result<(), String> {
        let all = [&self.generator, &self.formula, &self.file, &self.assembly, &self.everyday];
        let sources = all.into_iter().flatten().count();
        if sources != 1 {
            return Err(format!(
                "scene {:?} has {sources} of generator, formula, file, assembly and everyday, not one",
                self.name
            ));
        }
        let has_no_size = self.assembly.is_some() && self.triangles == 0 && self.count == 0;
        let is_cut_to_size = self.generator.is_some() || self.everyday.is_some();
        if has_no_size || is_cut_to_size && self.triangles == 0 || self.formula.is_some() && self.count == 0 {
            return Err(format!("scene {:?} has no size", self.name));
        }
        Ok(())
    }
}

impl Benchmark {
    /// A scene of many trees is traced, all in memory, beside peers that place meshes too.
    fn check_trees(&self, scene: &SceneRow) -> Result<(), String> {
        let is_fit = self.measure == Measure::Trace
            && self.residency.iter().all(|r| *r == Residency::All)
            && self.peers.iter().all(|peer| PLACING_PEERS.contains(&peer.as_str()));
        if scene.has_many_trees() && !is_fit {
            let peers = PLACING_PEERS.join(", ");
            return Err(format!(
                "benchmark {:?}: many trees ({:?}) are traced, all in memory, beside {peers}",
                self.name, scene.name
            ));
        }
        Ok(())
    }

    fn check(&self, scenes: &BTreeSet<&str>, structures: &BTreeSet<&str>) -> Result<(), String> {
        let fault = |what: String| Err(format!("benchmark {:?}: {what}", self.name));
        if let Some(unknown) = self.scenes.iter().find(|s| !scenes.contains(s.as_str())) {
            return fault(format!("no scene {unknown:?}"));
        }
        if let Some(unknown) = self.structures.iter().find(|s| !structures.contains(s.as_str())) {
            return fault(format!("no structure {unknown:?}"));
        }
        if let Some(unknown) = self.peers.iter().find(|s| !PEERS.contains(&s.as_str())) {
            return fault(format!("no peer {unknown:?}; there are {}", PEERS.join(", ")));
        }
        if self.scenes.is_empty() || self.threads.is_empty() || self.threads.contains(&0) || self.rounds == 0 {
            return fault("scenes, threads and rounds are at least one each".into());
        }
        if self.poe.iter().any(|p| !(0.0..1e6).contains(p)) {
            return fault("pixels of error are 0 or more".into());
        }
        let has_budget = self.residency.iter().any(|r| matches!(r, Residency::Budget(_)));
        if self.measure == Measure::Trace && has_budget && self.rays.contains(&RayKind::Picture) {
            return fault("a picture in a budget is as coarse as it must be: nothing can be expected of it".into());
        }
        let (width, height) = self.size;
        if width == 0 || height == 0 || width % TILE != 0 || height % TILE != 0 {
            return fault(format!("a picture's sides are multiples of {TILE}"));
        }
        let is_exact_first = self.poe.first() == Some(&0.0);
        let lacks_rays = self.cases().is_empty() || !is_exact_first;
        match self.measure {
            Measure::Trace if lacks_rays => {
                fault("tracing takes structures, residency, views, rays and PoE, 0 first".into())
            }
            Measure::Cold
                if [
                    self.structures.is_empty(),
                    self.views.is_empty(),
                    self.residency.is_empty(),
                    self.rates.is_empty(),
                ]
                .contains(&true) =>
            {
                fault("cold pictures take structures, views, budgets and rates".into())
            }
            Measure::Build if self.structures.is_empty() => fault("builds take structures".into()),
            Measure::Settings if self.structures.len() != 1 || self.views.len() != 1 || self.threads != [1] => {
                fault("settings take one structure, one view and one thread".into())
            }
            Measure::Clash if self.structures.len() != 1 || self.budget_shares.contains(&0) => {
                fault("clashes take one structure, and shares of at least 1".into())
            }
            Measure::Nearest if self.structures.len() != 1 || self.points == 0 || self.threads != [1] => {
                fault("nearest points take one structure, one thread, and points".into())
            }
            Measure::Distance if self.structures.len() != 1 || self.gaps.is_empty() || self.threads != [1] => {
                fault("distances take one structure, one thread, and gaps".into())
            }
            Measure::Many
                if self.structures.len() != 1 || self.instances == 0 || self.threads != [1] || !is_exact_first =>
            {
                fault("many instances take one structure, one thread, a number of instances, and PoE, 0 first".into())
            }
            Measure::Surfaces if lacks_rays || self.levels.is_empty() || self.threads != [1] => {
                fault("surfaces take levels, and what tracing takes, in one thread".into())
            }
            Measure::Many if !self.peers.iter().all(|peer| PLACING_PEERS.contains(&peer.as_str())) => {
                fault(format!("many instances are measured beside {}", PLACING_PEERS.join(", ")))
            }
            Measure::Decode if self.structures.is_empty() || self.threads != [1] => {
                fault("decoding takes structures and one thread".into())
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STRUCTURE: &str = "[[structure]]\nname = 'bvh'\nstructure = 'bvh'\nsplits = 'off'\n";
    const SCENE: &str = "[[scene]]\nname = 'a'\ntitle = 'A'\ngenerator = 'mandelbulb'\ntriangles = 1000\n";
    const TRACE: &str = "[[benchmark]]\nname = 'b'\nmeasure = 'trace'\nscenes = ['a']\nviews = [0, 2]\nstructures = ['bvh']\n\
        residency = ['all', '64M']\npoe = [0, 1]\nrays = ['primary', 'shadow']\nthreads = [1]\nsize = [8, 8]\n";

    #[test]
    fn the_data_of_this_folder_is_in_order() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let data = Data::read(&folder.join("benchmarks.toml")).expect("the benchmarks");
        assert!(data.benchmarks.iter().any(|b| !b.full) && data.benchmarks.iter().any(|b| b.full));
    }

    #[test]
    fn structures_have_kinds_of_stand_ins() {
        let of = |text: &str| {
            let row: StructureRow = toml::from_str(&format!("name = 'a'\nstructure = 'bvh'\n{text}")).expect("a row");
            row.options().map(|options| options.stand_ins)
        };
        assert_eq!(of(""), Ok(StandIns::Auto));
        assert_eq!(of("stand_ins = 'proxies'"), Ok(StandIns::Proxies));
        assert!(of("stand_ins = 'boxes'").expect_err("no kind").contains("boxes"));
    }

    #[test]
    fn every_combination_is_a_case() {
        let data = Data::parse(&format!("{STRUCTURE}{SCENE}{TRACE}")).expect("data");
        let benchmark = &data.benchmarks[0];
        let ids: BTreeSet<String> = benchmark.cases().iter().map(|c| benchmark.id("a", c, 1.0)).collect();
        assert_eq!(ids.len(), 8);
        assert!(ids.contains("b/a/bvh/64M/view 2/shadow/PoE 1"), "{ids:?}");
    }

    #[test]
    fn a_view_from_within_takes_the_place_of_the_first() {
        let own = [0.0, 1.0, 2.0, 3.0].map(|x| Camera::Orthographic {
            eye: glam::DVec3::X * x,
            at: glam::DVec3::ONE,
            up: glam::DVec3::Z,
            height: 1.0,
        });
        let view = "view = { eye = [7, 0, 0], at = [1, 1, 1], fov_y_degrees = 60 }\n";
        let camera = "[[scene.camera]]\neye = [9, 0, 0]\nat = [1, 1, 1]\nup = [0, 1, 0]\nfov_y_degrees = 50\n";
        let data = Data::parse(&format!("{STRUCTURE}{SCENE}{view}{camera}{TRACE}")).expect("data");
        let eyes = [0, 1, 4].map(|view| data.scenes[0].camera(&own, view).eye().x);
        assert_eq!(eyes, [7.0, 1.0, 9.0]);
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let wrong = |from: &str, to: &str| {
            let text = format!("{STRUCTURE}{SCENE}{TRACE}");
            assert!(text.contains(from), "{from}");
            Data::parse(&text.replace(from, to)).expect_err(to)
        };
        assert!(wrong("['a']", "['c']").contains("no scene"));
        assert!(wrong("['bvh']", "['octree']").contains("no structure"));
        assert!(wrong("structure = 'bvh'", "structure = 'octree'").contains("no structure \"octree\""));
        assert!(wrong("splits = 'off'", "splits = 'many'").contains("no splits"));
        assert!(wrong("[0, 2]", "[0, 4]").contains("no view 4"));
        assert!(wrong("'shadow'", "'picture'").contains("budget"));
        assert!(wrong("triangles = 1000", "").contains("no size"));
        assert!(wrong("generator = 'mandelbulb'", "").contains("not one"));
        assert!(wrong("generator", "everyday = 'room'\ngenerator").contains("not one"));
        assert!(wrong("poe = [0, 1]", "poe = [1]").contains("0 first"));
        assert!(wrong("size = [8, 8]", "size = [8, 9]").contains("multiples"));
        assert!(wrong("64M", "64X").contains("bytes"));
        assert!(wrong("threads = [1]", "threads = [0]").contains("at least one"));
        let decoding = format!("{STRUCTURE}{SCENE}{}", TRACE.replace("'trace'", "'decode'"));
        assert!(Data::parse(&decoding).is_ok());
        assert!(
            Data::parse(&decoding.replace("threads = [1]", "threads = [2]"))
                .expect_err("two threads")
                .contains("one thread")
        );
        let settings = format!("{STRUCTURE}{SCENE}{}", TRACE.replace("'trace'", "'settings'").replace("[0, 2]", "[0]"));
        assert!(Data::parse(&settings).is_ok());
        assert!(Data::parse(&settings.replace("[0]", "[0, 1]")).expect_err("two views").contains("one view"));
        assert!(wrong("name = 'b'", "name = 'b'\npeer = 'x'").contains("peer"));
        assert!(wrong("'trace'", "'nearest'").contains("and points"));
        assert!(wrong("'trace'", "'distance'").contains("and gaps"));
        assert!(wrong("'trace'", "'many'").contains("a number of instances"));
        assert!(wrong("'trace'", "'surfaces'").contains("levels"));
        assert!(wrong("'trace'", "'many'\ninstances = 9\npeers = ['obvhs']").contains("beside embree"));
        let twice = SCENE.replace("triangles", "also_at = [[9, 0, 0]]\ntriangles");
        let many = |trace: &str| Data::parse(&format!("{STRUCTURE}{twice}{trace}"));
        assert!(many(&TRACE.replace("'all', '64M'", "'all'")).expect("all in memory").scenes[0].has_many_trees());
        assert!(many(TRACE).expect_err("a budget").contains("all in memory"));
        let rival = TRACE.replace("'all', '64M'", "'all'").replace("threads", "peers = ['obvhs']\nthreads");
        assert!(many(&rival).expect_err("a peer of one level").contains("embree"));
    }
}
