//! What is hidden stays hidden in dense CAD: an airliner, a slice of a finer one, a car.
//!
//! `cargo test --test pictures stability::dense::of_three_million -- --ignored --nocapture` prints what the airliner of
//! the benchmarks comes to, which takes minutes and 4 GB. OUTCROP_AIRLINER_FILE names one that is built already.

use super::pictures::{Setting, Stage, ways};
use super::worst::{Kinds, MEASURES, Worst};
use crate::common::airliner::{self, view};
use crate::common::built;
use crate::common::foreign::chroma;
use crate::common::models;
use crate::common::picture::coverage_ratio;
use glam::{DAffine3, DVec3};
use outcrop::build::BuildOptions;
use outcrop::import::{ReadOptions, read_file};
use outcrop::scene::{Camera, Model, PartInfo};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Pixels of error.
const POE: [f32; 4] = [1.0, 3.0, 10.0, 30.0];

fn stage(path: &Path, size: (u32, u32)) -> Stage {
    let setting = Setting { size, ambient: 0.15, ..Setting::default() };
    // One way is enough for large models.
    let way = ways().pop().expect("a way");
    Stage::edited(&[way], path, &[DAffine3::IDENTITY], setting, |_| ())
}

/// The ids of the parts that are skin, and of those that it hides.
struct Parts {
    skin: HashSet<u64>,
    inner: HashSet<u64>,
}

impl Parts {
    fn of(path: &Path, is_skin: &dyn Fn(&PartInfo) -> bool, is_inner: &dyn Fn(&PartInfo) -> bool) -> Self {
        let model = Model::open(&built::context(1), path).expect("a model");
        let ids = |is: &dyn Fn(&PartInfo) -> bool| {
            let parts = model.parts().iter().filter(|part| part.triangles > 0 && is(part));
            parts.map(|part| part.id).collect()
        };
        Self { skin: ids(is_skin), inner: ids(is_inner) }
    }

    /// White paint, and materials that are not grey.
    fn of_airliner(path: &Path) -> Self {
        let linear = |part: &PartInfo| std::array::from_fn(|c| f64::from(part.colour[c]));
        Self::of(path, &|part| part.colour[..3].iter().all(|c| *c >= 0.8), &|part| chroma(linear(part)) > 0.2)
    }

    fn worst<'a>(&self, name: &'a str, stage: &Stage, cameras: &[Camera], poe: &[f32]) -> Worst<'a> {
        let kinds = Kinds { is_skin: &|id| self.skin.contains(&id), is_inner: &|id| self.inner.contains(&id) };
        Worst::of(name, stage, cameras, kinds, poe)
    }
}

/// The whole airliner from both sides and from above; its right side and an engine; the cabin.
fn views_of_airliner() -> [Vec<Camera>; 3] {
    let whole = [
        view([31.0, 0.0, 0.0], [-45.0, -44.0, 17.0], 66.0, 45.0),
        view([37.0, 0.0, 2.0], [37.0, 48.0, -14.0], 66.0, 45.0),
        view([31.0, 0.0, 0.0], [-10.0, 40.0, 40.0], 60.0, 45.0),
    ];
    let near = [
        view([22.0, 0.0, 0.0], [-14.0, 13.0, 7.0], 16.5, 45.0),
        view([22.0, -10.0, -2.6], [-10.0, -6.0, 1.1], 16.5, 45.0),
    ];
    [whole.to_vec(), near.to_vec(), vec![view([45.0, 0.3, 0.6], [-1.0, 0.0, 0.02], 20.0, 45.0)]]
}

#[test]
fn of_an_airliner() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("airliner.oc");
    airliner::build(&path, 300_000, None);
    let (parts, stage) = (Parts::of_airliner(&path), stage(&path, (640, 480)));
    let [whole, near, cabin] = views_of_airliner();
    let outside = ["foreign parts", "skin coloured", "skin tinted", "brightness"];
    parts.worst("airliner, whole", &stage, &whole, &POE).judge(&outside);
    parts.worst("airliner, near", &stage, &near, &POE).judge(&outside);
    let within = ["foreign parts", "ribs white", "ribs faded", "brightness"];
    parts.worst("airliner, cabin", &stage, &cabin, &POE).judge(&within);
}

/// As fine as one of three million triangles, and behind its wings, where the skin is closed. That of a small airliner
/// has such large facets that stringers are seen through it.
#[test]
fn of_a_slice_of_an_airliner() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("slice.oc");
    airliner::build(&path, 3_000_000, Some(38.5..42.5));
    let (parts, stage) = (Parts::of_airliner(&path), stage(&path, (320, 240)));
    let outside =
        [view([40.5, 0.0, 0.0], [-3.0, 14.0, 6.0], 11.0, 45.0), view([40.5, 0.0, 0.0], [3.0, -9.0, 5.0], 14.0, 45.0)];
    let measures = ["foreign parts", "skin coloured", "skin tinted", "brightness"];
    parts.worst("slice, outside", &stage, &outside, &POE).judge(&measures);
    let within = [view([41.0, -1.0, 2.2], [-1.0, 1.0, -0.6], 2.5, 70.0)];
    parts.worst("slice, within", &stage, &within, &POE).judge(&MEASURES);
}

/// Blue paint; all that is not paint is hidden, or beside it.
#[test]
fn of_a_car() {
    let Some(mesh) = models::find("cad/sportsCar.obj") else { return };
    let (file, _) = built::build_with(BuildOptions::default(), |builder| {
        read_file(&mesh, &ReadOptions::default(), builder).expect("a car");
    });
    let is_paint = |part: &PartInfo| part.colour[..3] == [0.01, 0.1, 0.3];
    let parts = Parts::of(&file.path, &is_paint, &|part| !is_paint(part));
    let look = |eye: [f64; 3]| {
        let (eye, at) = (DVec3::from(eye), DVec3::new(0.0, 0.4, 0.0));
        Camera::Perspective { eye, at, up: DVec3::Y, fov_y_degrees: 40.0 }
    };
    let cameras = [look([4.0, 2.5, 5.0]), look([-5.0, 1.5, -5.0]), look([-9.0, 4.0, 7.0])];
    let worst = parts.worst("car", &stage(&file.path, (320, 240)), &cameras, &POE);
    worst.judge(&["foreign parts", "skin coloured", "brightness"]);
}

#[test]
#[ignore = "measures three million triangles"]
fn of_three_million() {
    let folder = tempfile::tempdir().expect("a folder");
    let given = std::env::var_os("OUTCROP_AIRLINER_FILE").map(PathBuf::from);
    let path = given.unwrap_or_else(|| {
        let path = folder.path().join("airliner.oc");
        airliner::build(&path, 3_000_000, None);
        path
    });
    let (parts, stage) = (Parts::of_airliner(&path), stage(&path, (1024, 768)));
    for (name, cameras) in ["whole", "near", "cabin"].into_iter().zip(views_of_airliner()) {
        parts.worst(name, &stage, &cameras, &[3.0, 10.0, 30.0, 100.0]).print_missed();
        let exact = stage.quick(&cameras[0], 0.0);
        let coverage = coverage_ratio(stage.quick(&cameras[0], 10.0).coverage(), exact.coverage());
        assert!((coverage - 1.0).abs() <= 0.03, "{name}: {coverage} of the coverage");
    }
}
