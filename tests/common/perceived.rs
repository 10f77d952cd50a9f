//! How much two pictures differ to the eye: FLIP and SSIM.
//!
//! FLIP comes from the crate `nv-flip`, which wraps its authors' own program. SSIM is written here from its paper: the
//! crate that has it under a free licence averages over blocks of 8 by 8 without weights, which is not what is
//! published.

use super::picture::{Colours, Spread};
use nv_flip::{FlipImageRgb8, flip as flip_map, pixels_per_degree};

/// FLIP: what someone notices who flips between two pictures on a screen, from 0 (nothing) to 1, of each pixel; the
/// mean is what its authors say to report.
///
/// Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", HPG 2020, for the screen that they take:
/// 3840 pixels on 0.7 m, seen from 0.7 m (the crate's own default rounds that to 67 pixels a degree, which moves the
/// fourth digit). Colours are compared as a screen shows them, with 256 levels. `width`: pixels in a row.
pub fn flip(seen: Colours, truth: Colours, width: usize) -> Spread {
    let height = rows(seen, truth, width);
    let image = |of: Colours| {
        let level = |pixel: usize| of.coded(pixel).map(|c| (c * 255.0).round() as u8);
        let bytes: Vec<u8> = (0..of.count()).flat_map(level).collect();
        FlipImageRgb8::with_data(width as u32, height as u32, &bytes)
    };
    let map = flip_map(image(truth), image(seen), pixels_per_degree(0.7, 3840.0, 0.7));
    Spread::of(map.to_vec().into_iter().map(f64::from))
}

/// The height of two pictures of one size, or a panic that says what does not fit.
fn rows(seen: Colours, truth: Colours, width: usize) -> usize {
    assert_eq!(seen.count(), truth.count(), "pictures of one size are compared");
    assert_eq!(seen.count() % width, 0, "rows are whole");
    seen.count() / width
}

/// Width of SSIM's window.
const WINDOW: usize = 11;
/// Its weights' standard deviation.
const DEVIATION: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Mean structural similarity, 1 for the same picture: of every whole window of 11 by 11 pixels,
///
/// ```text
/// (2 m m0 + C1) (2 s(x, x0) + C2) / ((m^2 + m0^2 + C1) (s(x, x) + s(x0, x0) + C2))
/// ```
///
/// with the means m, variances and covariance s under Gaussian weights of deviation 1.5, C1 = 0.01^2, C2 = 0.03^2.
///
/// Wang, Bovik, Sheikh, Simoncelli, "Image Quality Assessment: From Error Visibility to Structural Similarity", IEEE
/// TIP 13(4), 2004, eq. 13 to 17. Of the coded grey 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601) in [0, 1], as their
/// program takes it.
pub fn ssim(seen: Colours, truth: Colours, width: usize) -> f64 {
    let height = rows(seen, truth, width);
    assert!(width >= WINDOW && height >= WINDOW, "a picture is at least {WINDOW} pixels wide and high");
    let (x, y) = (grey(seen), grey(truth));
    let product = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let [mx, my] = [&x, &y].map(|plane| blurred(plane, width));
    let [xx, yy, xy] = [product(&x, &x), product(&y, &y), product(&x, &y)].map(|plane| blurred(&plane, width));
    let of_window = |i: usize| {
        let (mx, my) = (mx[i], my[i]);
        let (vx, vy, cov) = (xx[i] - mx * mx, yy[i] - my * my, xy[i] - mx * my);
        (2.0 * mx * my + C1) * (2.0 * cov + C2) / ((mx * mx + my * my + C1) * (vx + vy + C2))
    };
    (0..mx.len()).map(of_window).sum::<f64>() / mx.len() as f64
}

fn grey(of: Colours) -> Vec<f64> {
    let one = |[r, g, b]: [f64; 3]| 0.299 * r + 0.587 * g + 0.114 * b;
    (0..of.count()).map(|pixel| one(of.coded(pixel))).collect()
}

/// The weighted means of all windows that lie in the plane, window by window, row by row.
fn blurred(plane: &[f64], width: usize) -> Vec<f64> {
    let middle = (WINDOW / 2) as f64;
    let raw: [f64; WINDOW] = std::array::from_fn(|i| (-0.5 * ((i as f64 - middle) / DEVIATION).powi(2)).exp());
    let sum: f64 = raw.iter().sum();
    let weights = raw.map(|w| w / sum);
    // Along rows first, then down columns: the weights are those of their product.
    let across: Vec<f64> = plane
        .chunks_exact(width)
        .flat_map(|row| row.windows(WINDOW).map(|span| span.iter().zip(&weights).map(|(v, w)| v * w).sum()))
        .collect();
    let narrow = width + 1 - WINDOW;
    let down = |at: usize| (0..WINDOW).map(|k| across[at + k * narrow] * weights[k]).sum();
    (0..across.len() - (WINDOW - 1) * narrow).map(down).collect()
}
