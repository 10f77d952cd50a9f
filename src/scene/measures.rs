//! Measures of transforms: the factors by which they change lengths, and the rounding errors of their use.

use crate::base::error::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};

/// The greatest ratio of singular values of a transform.
const MOST_SKEW: f64 = 1e12;

/// Rejects transforms that are not finite, singular, or so close to singular that double precision fails.
pub(crate) fn check_transform(m: &DAffine3) -> Result<()> {
    let inverse = m.matrix3.inverse();
    let skew = largest_singular_value(&m.matrix3) * largest_singular_value(&inverse);
    let fine = m.is_finite() && inverse.is_finite() && skew <= MOST_SKEW;
    if fine { Ok(()) } else { Err(Error::bad_argument("the transform is singular or not finite")) }
}

/// An upper bound of the largest singular value of `m`, tight to rounding.
pub(crate) fn largest_singular_value(m: &DMat3) -> f64 {
    // Scaling keeps the squares from overflow and underflow.
    let size = m.to_cols_array().iter().fold(0.0f64, |s, x| s.max(x.abs()));
    if !(size > 0.0 && size.is_finite()) {
        return size;
    }
    let m = *m * (1.0 / size);
    let s = m.transpose() * m;
    // The eigenvalues of a symmetric 3x3 matrix in closed form (Smith 1961).
    let (a, b, c) = (s.x_axis.x, s.y_axis.y, s.z_axis.z);
    let off = s.y_axis.x.powi(2) + s.z_axis.x.powi(2) + s.z_axis.y.powi(2);
    let q = (a + b + c) / 3.0;
    let p = (((a - q).powi(2) + (b - q).powi(2) + (c - q).powi(2) + 2.0 * off) / 6.0).sqrt();
    let greatest = if p <= 1e-15 * q {
        q
    } else {
        let r = ((s - DMat3::from_diagonal(DVec3::splat(q))) * (1.0 / p)).determinant() / 2.0;
        q + 2.0 * p * (r.clamp(-1.0, 1.0).acos() / 3.0).cos()
    };
    greatest.max(0.0).sqrt() * size * (1.0 + 1e-12)
}

/// The square of the factor by which a map changes all lengths, if it changes all alike within a part in a million, as
/// rotations in single precision do. `s` is the product of the transpose of its linear part and that part. The square
/// is an upper bound: rows of `s` bound its eigenvalues (Gershgorin).
fn square_of_similarity(s: &DMat3) -> Option<f64> {
    let sizes = s.abs();
    let rows = sizes.x_axis + sizes.y_axis + sizes.z_axis;
    let least = s.x_axis.x.min(s.y_axis.y).min(s.z_axis.z);
    let square = rows.max_element();
    (square <= least * (1.0 + 1e-6)).then_some(square)
}

/// Bound of the distance between a point and `there` of `back` of it, as a fraction of the greatest coordinate. It adds
/// the difference of the product from the identity and eight roundings of its terms, which are large for skewed
/// transforms.
fn loss(there: &DMat3, back: &DMat3) -> f64 {
    let rows = |m: DMat3| (m.abs() * DVec3::ONE).length();
    rows(*there * *back - DMat3::IDENTITY) + rows(there.abs() * back.abs()) * (8.0 * f64::EPSILON)
}

/// Measures of the linear part of a map to the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measures {
    /// See [`super::placed::Placed::stretch`].
    pub stretch: f64,
    /// Relative rounding error of a transformation there and back.
    pub loss: f64,
}

/// A bound of [`loss`] for maps that change all lengths alike. No element of a rotation exceeds 1, so eight roundings
/// are at most 24 times the root of 3. As much again bounds the difference of the product from the identity, twice
/// over.
const LOSS_OF_SIMILARITY: f64 = 128.0 * f64::EPSILON;

impl Measures {
    /// The measures of `linear`, which [`check_transform`] accepts.
    pub fn of(linear: &DMat3) -> Self {
        Self::of_similarity(linear).unwrap_or_else(|| {
            let inverse = linear.inverse();
            let loss = loss(linear, &inverse).max(loss(&inverse, linear));
            Self { stretch: largest_singular_value(linear), loss }
        })
    }

    /// The measures of a linear part that changes all lengths alike; `None` for others, which take much longer.
    #[inline]
    pub fn of_similarity(linear: &DMat3) -> Option<Self> {
        if *linear == DMat3::IDENTITY {
            return Some(Self { stretch: 1.0, loss: 8.0 * f64::EPSILON });
        }
        // Outside of this range squares overflow or lose digits.
        let size = linear.x_axis.abs().max_element();
        if !(1e-100..=1e100).contains(&size) {
            return None;
        }
        let square = square_of_similarity(&(linear.transpose() * *linear))?;
        Some(Self { stretch: square.sqrt() * (1.0 + 1e-12), loss: LOSS_OF_SIMILARITY })
    }
}

/// The greatest ratio of singular values of a transform of scenes: rays go through their trees in frames of their own,
/// and rounding on the way there must stay far below the size of what is in them.
const MOST_SKEW_OF_SCENES: f64 = 1e8;

/// Range of the factors by which all transforms down to a placed tree together may change lengths.
const FACTORS: std::ops::RangeInclusive<f64> = 1e-100..=1e100;

/// Bounds of the factors by which maps change lengths.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Factors {
    least: f64,
    greatest: f64,
    /// Greatest ratio of the factors of one map.
    skew: f64,
    /// The same of the maps of scenes alone.
    scenes: f64,
}

impl Factors {
    /// Those of no map.
    pub const NONE: Self = Self { least: f64::INFINITY, greatest: 0.0, skew: 1.0, scenes: 1.0 };

    /// Those of a map that [`check_transform`] accepts.
    pub fn of(linear: &DMat3) -> Self {
        if let Some(Measures { stretch, .. }) = Measures::of_similarity(linear) {
            return Self { least: stretch, greatest: stretch, skew: 1.0, scenes: 1.0 };
        }
        let (greatest, least) = (largest_singular_value(linear), 1.0 / largest_singular_value(&linear.inverse()));
        Self { least, greatest, skew: greatest / least, scenes: 1.0 }
    }

    /// Those of either.
    pub fn union(self, other: Self) -> Self {
        Self {
            least: self.least.min(other.least),
            greatest: self.greatest.max(other.greatest),
            skew: self.skew.max(other.skew),
            scenes: self.scenes.max(other.scenes),
        }
    }

    /// Those of the maps after which a scene's map is applied.
    pub fn under(self, scene: &DMat3) -> Self {
        let outer = Self::of(scene);
        Self {
            least: outer.least * self.least,
            greatest: outer.greatest * self.greatest,
            skew: outer.skew * self.skew,
            scenes: outer.skew * self.scenes,
        }
    }

    /// True if double precision suffices for all the maps.
    pub fn are_sound(&self) -> bool {
        let is_none = self.greatest == 0.0;
        let are_in_range = FACTORS.contains(&self.least) && FACTORS.contains(&self.greatest);
        is_none || are_in_range && self.skew <= MOST_SKEW && self.scenes <= MOST_SKEW_OF_SCENES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn singular_values_of_known_matrices() {
        let turn = DMat3::from_quat(DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(-1.1));
        for d in [[1.0, 1.0, 1.0], [3.0, 2.0, 1.0], [1e-9, 1.0, 1.0], [5.0, 5.0, 1e-3], [1e200, 1e190, 1e180]] {
            let m = turn * DMat3::from_diagonal(DVec3::from(d)) * turn.transpose();
            let greatest = d.iter().fold(0.0f64, |s, &x| s.max(x));
            let found = largest_singular_value(&m);
            assert!((found / greatest - 1.0).abs() < 1e-9, "{d:?}: {found}");
        }
    }

    #[test]
    fn bad_transforms_are_refused() {
        let flat = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0));
        let nan = DAffine3::from_translation(DVec3::NAN);
        let thin = DAffine3::from_scale(DVec3::new(1.0, 1.0, 1e-13));
        for bad in [flat, nan, thin, DAffine3::ZERO] {
            assert!(check_transform(&bad).is_err(), "{bad:?}");
        }
        for good in [1e-6, 1.0, 1e9] {
            assert!(check_transform(&DAffine3::from_scale(DVec3::new(good, -1.0, 1.0))).is_ok());
        }
    }

    /// Maps that change all lengths alike are told from others, and their measures bound what is computed for others.
    #[test]
    fn similarities_are_known_and_bounded() {
        // The identity comes first: nothing is rounded there.
        for i in 1..2000 {
            let [x, y, z] = [0.37, 0.59, 0.83].map(|step| (f64::from(i) * step).sin() * 3.0);
            let turn = DMat3::from_quat(
                (DQuat::from_rotation_x(x) * DQuat::from_rotation_y(y) * DQuat::from_rotation_z(z)).normalize(),
            );
            let scale = [1.0, -0.3, 1e-9, 7e5, 1e-120][i as usize % 5];
            let linear = turn * scale;
            match Measures::of_similarity(&linear) {
                None => assert!(scale == 1e-120),
                Some(Measures { stretch, loss: said }) => {
                    let inverse = linear.inverse();
                    let computed = loss(&linear, &inverse).max(loss(&inverse, &linear));
                    assert!(computed <= said, "{computed:e}, said {said:e}");
                    assert!(stretch >= scale.abs() && stretch <= scale.abs() * (1.0 + 1e-9), "{stretch}");
                }
            }
            let stretched = turn * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1.0 + 1e-5)) * scale;
            assert!(Measures::of_similarity(&stretched).is_none());
        }
    }
}
