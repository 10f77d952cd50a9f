//! What shows of what is hidden, in the worst of several views. `tests/common/foreign.rs` defines the measures.

use super::pictures::{Picture, Stage};
use super::table::judge;
use crate::common::foreign::{Share, Shown, faded, foreign_parts, tinted, turned};
use crate::common::picture::radiance_ratio;
use outcrop::scene::Camera;

/// Pixels of the exact picture for each, along each edge.
const FINE: u32 = 3;
/// A share of fewer pixels says nothing.
const FEWEST: usize = 500;

/// Shares of pixels that show what is hidden, and how far the brightness is off.
pub const MEASURES: [&str; 6] =
    ["foreign parts", "skin coloured", "skin tinted", "ribs white", "ribs faded", "brightness"];

/// The most that a measure may come to; nothing is asked of the brightness above 10 pixels, nor of anything above 30.
fn line(measure: &str, poe: f32) -> Option<f64> {
    match measure {
        "brightness" => (poe <= 10.0).then_some(0.03),
        _ if poe <= 3.0 => Some(0.006),
        _ if poe <= 10.0 => Some(0.02),
        _ => (poe <= 30.0).then_some(0.05),
    }
}

/// Which parts are skin, and which ones it hides.
#[derive(Clone, Copy)]
pub struct Kinds<'a> {
    pub is_skin: &'a dyn Fn(u64) -> bool,
    pub is_inner: &'a dyn Fn(u64) -> bool,
}

/// A share of each of [`MEASURES`]; `None` of too few pixels.
pub type Measured = [Option<f64>; MEASURES.len()];

/// The exact picture of a view: with a ray for each pixel, and with several.
pub struct Exact<'a> {
    plain: Picture,
    fine: Picture,
    fine_parts: Vec<u64>,
    width: usize,
    kinds: Kinds<'a>,
    /// Pixels inside the skin, and inside of what it hides.
    skin: Vec<usize>,
    inner: Vec<usize>,
}

impl<'a> Exact<'a> {
    pub fn of(stage: &Stage, camera: &Camera, kinds: Kinds<'a>) -> Self {
        let (plain, fine, width) = (stage.quick(camera, 0.0), stage.fine(camera, FINE), stage.size().0 as usize);
        let (skin, inner, fine_parts) = (Vec::new(), Vec::new(), fine.parts());
        let exact = Self { plain, fine, fine_parts, width, kinds, skin, inner };
        let [skin, inner] = [kinds.is_skin, kinds.is_inner].map(|kind| exact.truth().inside(kind));
        Self { skin, inner, ..exact }
    }

    fn truth(&self) -> Shown<'_> {
        let times = FINE as usize;
        Shown { width: self.width * times, times, parts: &self.fine_parts, colours: self.fine.colours() }
    }

    pub fn measure(&self, picture: &Picture) -> Measured {
        let parts = picture.parts();
        let seen = &Shown { width: self.width, times: 1, parts: &parts, colours: picture.colours() };
        let truth = &self.truth();
        let shares = [
            foreign_parts(seen, truth),
            turned(seen, &self.skin, self.kinds.is_inner),
            tinted(seen, &self.skin),
            turned(seen, &self.inner, self.kinds.is_skin),
            faded(seen, truth, &self.inner),
        ];
        let is_covered: Vec<bool> = self.plain.covered().collect();
        let brightness = radiance_ratio(picture.colours(), self.plain.colours(), |i| is_covered[i]);
        let [a, b, c, d, e] = shares.map(|share: Share| (share.of >= FEWEST).then(|| share.value()));
        [a, b, c, d, e, Some((brightness - 1.0).abs())]
    }
}

/// What each of [`MEASURES`] comes to in the worst view, at each of some pixels of error.
pub struct Worst<'a> {
    name: &'a str,
    at: Vec<(f32, Measured)>,
}

impl<'a> Worst<'a> {
    pub fn of(name: &'a str, stage: &Stage, cameras: &[Camera], kinds: Kinds, poe: &[f32]) -> Self {
        let mut at: Vec<(f32, Measured)> = poe.iter().map(|poe| (*poe, Measured::default())).collect();
        for (i, camera) in cameras.iter().enumerate() {
            let exact = Exact::of(stage, camera, kinds);
            for (poe, worst) in &mut at {
                // In all ways of the stage once: other rows show that they agree.
                let in_all_ways = i == 0 && *poe == 10.0;
                let picture = if in_all_ways { stage.picture(camera, *poe) } else { stage.quick(camera, *poe) };
                let values = exact.measure(&picture);
                println!("{name}, view {i}, PoE {poe}: {}, {} stand-ins", listed(&values), picture.stand_ins());
                worst.iter_mut().zip(values).for_each(|(worst, value)| *worst = worse(*worst, value));
            }
        }
        Self { name, at }
    }

    /// The values of a measure by pixels of error, and their lines.
    fn values(&self, measure: &str) -> Vec<(f32, f64, f64)> {
        let index = MEASURES.iter().position(|m| *m == measure).expect("a measure");
        let value = |of: &Measured| of[index].unwrap_or_else(|| panic!("{}: {measure}: few pixels count", self.name));
        self.at.iter().filter_map(|(poe, of)| Some((*poe, value(of), line(measure, *poe)?))).collect()
    }

    /// Says which lines are missed.
    pub fn print_missed(&self) {
        for measure in MEASURES {
            for (poe, value, line) in self.values(measure).into_iter().filter(|(_, value, line)| value > line) {
                println!("    MISSED: {}, {measure}, PoE {poe}: {value:.4}, the line is {line}", self.name);
            }
        }
    }

    /// Holds some measures to their lines.
    pub fn judge(&self, measures: &[&str]) {
        measures.iter().for_each(|measure| judge(&format!("{}: {measure}", self.name), &self.values(measure)));
    }
}

fn worse(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    // A NaN is worst.
    [a, b].into_iter().flatten().max_by(f64::total_cmp)
}

/// Values in words.
pub fn listed(values: &Measured) -> String {
    let of = |(name, value): (&&str, &Option<f64>)| value.map(|value| format!("{name} {:.2} %", 100.0 * value));
    MEASURES.iter().zip(values).filter_map(of).collect::<Vec<_>>().join(", ")
}
