//! Detail that ranges over a million in scale: what is not seen costs next to nothing, however much of it there is.

use super::pictures::{LONG, POE, Setting, Stage, frame, lit, perspective, ways};
use crate::common::brute::Tri;
use crate::common::built::{self, Built, Part};
use crate::common::scenes;
use crate::common::sources::meddled;
use glam::{DAffine3, DVec3};
use outcrop::render::{FrameSettings, FrameState};
use outcrop::scene::{Camera, Context, ContextOptions, Model};
use outcrop::simd::Isa;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, OnceLock};

/// How large the land is, where the detail has a radius of 1.
const LAND: f64 = 1e6;
/// Where the detail is: above the land.
const PLACE: DVec3 = DVec3::new(123_456.0, -65_432.0, 40_000.0);

/// Both at four hundred thousand triangles.
struct Files {
    land: Built,
    detail: Built,
    /// Bytes of the geometry of either in memory, whichever has less.
    bytes: u64,
}

fn files() -> &'static Files {
    static FILES: OnceLock<Files> = OnceLock::new();
    FILES.get_or_init(|| {
        let n = 448;
        let hilly = |v: DVec3| {
            let v = v / n as f64 - DVec3::new(0.5, 0.5, 0.0);
            scenes::rounded((v + DVec3::Z * 0.02 * (v.x * 30.0).sin() * (v.y * 40.0).cos()) * LAND)
        };
        let land: Vec<Tri> = scenes::plane_grid(n, 0.0).into_iter().map(|t| t.map(hilly)).collect();
        let detail = scenes::bumpy_sphere(448, 448, 8);
        let [land, detail] = [land, detail].map(|tris| built::parts(&[Part::white(1, tris)]));
        let bytes = |file: &Built| Model::open(&built::context(0), &file.path).expect("it opens").memory().geometry;
        let bytes = bytes(&land).min(bytes(&detail));
        Files { land, detail, bytes }
    })
}

/// Bytes read of a file.
type Count = Arc<AtomicUsize>;

fn counted(context: &Context, file: &Built) -> (Model, Count) {
    let count = Count::default();
    let on = Arc::clone(&count);
    let source = meddled(&file.path, move |_, bytes| {
        on.fetch_add(bytes.len(), SeqCst);
        Ok(())
    });
    (Model::open_source(context, source).expect("it opens"), count)
}

/// What a picture reads of the land and of the detail after these were opened, as shares of the files.
fn cost(camera: &Camera, poe: f32, threads: usize, isa: Isa) -> [f64; 2] {
    let setting = Setting::default();
    // Both fit, but neither is so small beside it that all of it is read when it is opened.
    let memory_budget = files().bytes * 39 / 10;
    let options = ContextOptions { threads, isa: Some(isa), memory_budget, read_ahead: false, ..Default::default() };
    let context = Context::new(options).expect("a context");
    let scene = lit(&context, &setting);
    let (land, of_land) = counted(&context, &files().land);
    let (detail, of_detail) = counted(&context, &files().detail);
    scene.add_instance(&land, 0, DAffine3::IDENTITY).expect("an instance");
    scene.add_instance(&detail, 1, DAffine3::from_translation(PLACE)).expect("an instance");
    scene.commit().expect("a commit");
    let opened = [of_land.load(SeqCst), of_detail.load(SeqCst)];
    let frame = frame(&context, setting.size);
    frame.request(&scene.state(), camera, &FrameSettings { poe, ..Default::default() }).expect("a request");
    let status = frame.wait(LONG);
    assert_eq!((status.state, status.pixels_missing), (FrameState::Converged, 0), "{status:?}");
    let size = |file: &Built| std::fs::metadata(&file.path).expect("the file").len() as f64;
    let read = |count: &Count, opened| (count.load(SeqCst) - opened) as f64;
    [read(&of_land, opened[0]) / size(&files().land), read(&of_detail, opened[1]) / size(&files().detail)]
}

fn far() -> Camera {
    perspective(DVec3::new(0.0, -1.1, 0.9) * LAND, DVec3::ZERO)
}

/// The land fills what the detail leaves of the picture.
fn near() -> Camera {
    perspective(PLACE + DVec3::new(0.4, -2.0, 2.6), PLACE)
}

/// Of each pixels of error, the costs in all ways.
fn costs(camera: &Camera) -> Vec<(f32, [f64; 2])> {
    let of = |poe| {
        let all = ways().into_iter().map(|(threads, isa)| cost(camera, poe, threads, isa));
        let most = all.fold([0.0f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
        println!("PoE {poe}: read of the land {:.4}, of the detail {:.4}", most[0], most[1]);
        (poe, most)
    };
    POE.into_iter().map(of).collect()
}

#[test]
fn far_away_the_detail_costs_next_to_nothing() {
    let costs = costs(&far());
    assert!(costs[0].1[0] > 0.3, "the land is not looked at");
    assert!(costs.iter().all(|(_, [_, detail])| *detail <= 0.01), "{costs:?}");
    // And all that is seen of it is less than a pixel.
    let stage = Stage::new(&files().detail.path, Setting::default());
    let shown = stage.picture(&perspective(DVec3::new(0.0, -1.1, 0.9) * LAND - PLACE, -PLACE), 1.0);
    assert!(shown.covered().filter(|c| *c).count() <= 1);
}

#[test]
fn near_the_detail_the_rest_costs_next_to_nothing() {
    let costs = costs(&near());
    assert!(costs[0].1[1] > 0.3, "the detail is not looked at");
    // One read of neighbouring blocks may be 7 % of it.
    assert!(costs.iter().all(|(_, [land, _])| *land <= 0.1), "{costs:?}");
}
