//! Search for missing blocks along the rays of some pixels.

use super::Lacking;
use crate::math::Cone;
use crate::query::stand_in;
use crate::scene::camera::PixelRays;
use crate::scene::walk::{Found, SceneView, SceneWalk, Step};

/// Rays that may still lack blocks.
pub(super) struct InView {
    rays: PixelRays,
    /// Ratio of the rays' widths to those of pixels.
    widen: f32,
    /// Pixels to trace in this pass.
    todo: Vec<(u32, u32)>,
    /// Pixels that lacked a block.
    waiting: Vec<(u32, u32)>,
    walk: SceneWalk,
}

/// Distance in pixels between traced pixels, along each side.
const STEP: usize = 4;

/// Number of rays traced per step.
const PIECE: usize = 256;

/// Frames dither thresholds by up to half an octave in both directions. A prefetch needs the finest one.
const FINEST: f32 = 0.707;

impl InView {
    pub fn new(rays: PixelRays, size: (u32, u32), poe: f32) -> Self {
        let middles = |n: u32| (0..n).step_by(STEP).map(move |at| (at + STEP as u32 / 2).min(n - 1));
        let waiting = middles(size.1).flat_map(|y| middles(size.0).map(move |x| (x, y))).collect();
        Self { rays, widen: (poe * FINEST).sqrt(), todo: Vec::new(), waiting, walk: SceneWalk::default() }
    }

    pub fn begin(&mut self) {
        self.todo.append(&mut self.waiting);
    }

    /// Traces up to [`PIECE`] rays. Returns true if there is more to trace in this pass.
    pub fn step(&mut self, view: &SceneView, lacking: &mut Lacking) -> bool {
        for _ in 0..PIECE {
            let Some(pixel) = self.todo.pop() else { return false };
            if self.look(view, pixel, lacking) {
                self.waiting.push(pixel);
            }
        }
        true
    }

    /// Traces the ray of a pixel. Returns true if a block is missing.
    fn look(&mut self, view: &SceneView, (x, y): (u32, u32), lacking: &mut Lacking) -> bool {
        let mut ray = self.rays.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let pixel = ray.cone;
        ray.cone = Cone { a: pixel.a * self.widen, b: pixel.b * self.widen };
        self.walk.begin(view, &ray);
        if let Step::Pending(need) = view.trace::<false>(&ray, &mut self.walk) {
            // Only a root block can be missing in this way.
            lacking.add(need, f32::MAX);
            return true;
        }
        let found = self.walk.best();
        if !found.is_hit() {
            return false;
        }
        let Some(need) = view.wanted(found.tree, &found.tri) else { return look_beside(view, &found, lacking) };
        let (t, error) = stand_in::look(view, &ray, &found).map_or((found.t, 0.0), |look| (look.t, look.error()));
        let width = f64::from(pixel.a) + f64::from(pixel.b) * t;
        lacking.add(need, (f64::from(error) / width.max(f64::MIN_POSITIVE)) as f32);
        true
    }
}

/// Adds the blocks that shading the triangle of a hit needs. Returns true if one is missing.
fn look_beside(view: &SceneView, found: &Found, lacking: &mut Lacking) -> bool {
    if found.tri.stand_in().is_some() {
        return false;
    }
    let tree = view.tree_with(found.tree);
    let missing = [tree.normals(&found.tri).err(), tree.colours(&found.tri).err()];
    missing.iter().flatten().for_each(|block| lacking.add(view.need(found.placed(), *block), 0.0));
    missing.iter().any(Option::is_some)
}
