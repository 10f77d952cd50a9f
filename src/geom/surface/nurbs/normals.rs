//! The normal of a Bézier patch as a polynomial: control vectors of a multiple of du × dv.
//!
//! With S = A / w, S_u × S_v = (w A_u × A_v + w_v A × A_u + w_u A_v × A) / w³. The numerator is a polynomial of the
//! degrees (3p − 1, 3q − 1), or (2p − 1, 2q − 1) where w = 1. As w > 0, it has the direction of the normal, and all
//! normals are convex combinations of its control vectors but for a positive factor.
//!
//! Source: Sederberg, Meyers, "Loop detection in surface patch intersections", CAGD 5(2), 1988 (normals of a
//! polynomial patch as a hodograph's cross product); the rational form follows from the quotient rule.

use super::bezier::BezierPatch;
use glam::{DVec3, DVec4};
use std::ops::{Add, Mul, Sub};

/// A polynomial of two variables in Bernstein form.
pub(super) struct Polynomial<T> {
    pub(super) degree: [usize; 2],
    /// Coefficients times both binomial coefficients, v fastest: products are then plain convolutions.
    scaled: Vec<T>,
}

impl<T: Copy + Default + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>> Polynomial<T> {
    fn new(degree: [usize; 2], coefficient: impl Fn(usize, usize) -> T) -> Self {
        let binomials = degree.map(binomials);
        let mut scaled = Vec::with_capacity((degree[0] + 1) * (degree[1] + 1));
        for (i, of_u) in binomials[0].iter().enumerate() {
            scaled.extend(binomials[1].iter().enumerate().map(|(j, of_v)| coefficient(i, j) * (of_u * of_v)));
        }
        Self { degree, scaled }
    }

    fn times<U: Copy, V>(&self, other: &Polynomial<U>, product: impl Fn(T, U) -> V) -> Polynomial<V>
    where
        V: Copy + Default + Add<Output = V>,
    {
        let degree = [0, 1].map(|axis| self.degree[axis] + other.degree[axis]);
        let mut scaled = vec![V::default(); (degree[0] + 1) * (degree[1] + 1)];
        for (row, line) in self.scaled.chunks_exact(self.degree[1] + 1).enumerate() {
            for (other_row, other_line) in other.scaled.chunks_exact(other.degree[1] + 1).enumerate() {
                let out = &mut scaled[(row + other_row) * (degree[1] + 1)..];
                for (j, &a) in line.iter().enumerate() {
                    for (to, &b) in out[j..].iter_mut().zip(other_line) {
                        *to = *to + product(a, b);
                    }
                }
            }
        }
        Polynomial { degree, scaled }
    }

    fn plus(mut self, other: &Self) -> Self {
        self.scaled.iter_mut().zip(&other.scaled).for_each(|(a, &b)| *a = *a + b);
        self
    }

    /// The coefficients in Bernstein form, v fastest.
    pub(super) fn coefficients(&self) -> Vec<T> {
        let binomials = self.degree.map(binomials);
        let divided = |(at, &scaled): (usize, &T)| {
            let (i, j) = (at / (self.degree[1] + 1), at % (self.degree[1] + 1));
            scaled * (1.0 / (binomials[0][i] * binomials[1][j]))
        };
        self.scaled.iter().enumerate().map(divided).collect()
    }
}

/// The binomial coefficients of a degree; at most 3 · 32 − 1, so that none exceeds 10²⁸.
pub(super) fn binomials(degree: usize) -> Vec<f64> {
    let mut all = vec![1.0; degree + 1];
    for i in 1..=degree {
        all[i] = all[i - 1] * (degree + 1 - i) as f64 / i as f64;
    }
    all
}

impl BezierPatch {
    /// The numerator of du × dv by parameters from 0 to 1. `centre` is a point near the patch in coordinates around its
    /// origin: the polynomial does not depend on it, its rounding does.
    pub(super) fn normal_polynomial(&self, centre: DVec3) -> Polynomial<DVec3> {
        let [p, q] = self.degree;
        let point = |i: usize, j: usize| {
            let point = self.points[i * (q + 1) + j];
            (point.truncate() - centre * point.w).extend(point.w)
        };
        let by_u = |i, j| (point(i + 1, j) - point(i, j)) * p as f64;
        let by_v = |i, j| (point(i, j + 1) - point(i, j)) * q as f64;
        let (by_u, by_v) = (Polynomial::new([p - 1, q], by_u), Polynomial::new([p, q - 1], by_v));
        let cross = |a: DVec4, b: DVec4| a.truncate().cross(b.truncate());
        let tangents = by_u.times(&by_v, cross);
        if !self.is_rational {
            return tangents;
        }
        let value = Polynomial::new([p, q], point);
        let with_weight = |a: DVec3, b: DVec4| a * b.w;
        tangents
            .times(&value, with_weight)
            .plus(&value.times(&by_u, cross).times(&by_v, with_weight))
            .plus(&by_v.times(&value, cross).times(&by_u, with_weight))
    }
}
