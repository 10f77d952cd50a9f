//! Normals of hit triangles in the world, computed for rows of triangles in loops that the compiler vectorises.

use crate::math::bits;
use crate::scene::placed::Placed;
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::surface::{Groups, Surfaces};
use crate::structure::{Rooted, Tree, TriHit};
use glam::{DVec3, Vec3};

/// A triangle's normal in the world, on the side from which its corners appear counter-clockwise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WorldNormal {
    /// The normal, of any length.
    pub across: DVec3,
    /// The normal, of length 1.
    pub unit: Vec3,
    /// True if the square of `across` leaves the range of single precision: `unit` is then meaningless.
    pub is_extreme: bool,
}

impl WorldNormal {
    /// The normal of a triangle of a placed tree.
    #[inline(always)]
    pub fn new(placed: &Placed, corners: &[Vec3; 3]) -> Self {
        Self::of(placed.world_normal(across(corners)))
    }

    /// From a normal of any length.
    #[inline(always)]
    pub fn of(across: DVec3) -> Self {
        let square = across.length_squared();
        // The answer has single precision; a square root and a quotient in it take half the time.
        let unit = (across * f64::from(1.0 / (square as f32).sqrt())).as_vec3();
        Self { across, unit, is_extreme: !NORMAL_SQUARES.contains(&square) }
    }

    /// The unit normal on the side of the ray's origin. A triangle too thin to have a normal gets the opposite of
    /// `dir`.
    #[inline(always)]
    pub fn facing(&self, dir: Vec3) -> Vec3 {
        let dir = dir.as_dvec3();
        if self.is_extreme {
            return extreme_normal(self.across, dir).as_vec3();
        }
        if self.across.dot(dir) > 0.0 { -self.unit } else { self.unit }
    }
}

/// Squares of lengths for which square roots and reciprocals keep all digits of single precision.
const NORMAL_SQUARES: std::ops::Range<f64> = 1e-36..1e36;

/// The unit normal where the square of its length is 0 or leaves the range of single precision.
#[cold]
fn extreme_normal(normal: DVec3, dir: DVec3) -> DVec3 {
    let size = normal.abs().max_element();
    match (normal * (1.0 / size)).try_normalize() {
        Some(n) if n.dot(dir) <= 0.0 => n,
        Some(n) => -n,
        None => -dir.normalize_or_zero(),
    }
}

/// The cross product of a triangle's edges. The corners are single-precision numbers, so it carries few roundings.
#[inline(always)]
fn across([a, b, c]: &[Vec3; 3]) -> DVec3 {
    let a = a.as_dvec3();
    (b.as_dvec3() - a).cross(c.as_dvec3() - a)
}

/// The triangles that up to `N` rays hit in a placed tree, one column per triangle. Reusable.
#[derive(Debug)]
#[repr(C)]
pub(super) struct Triangles<const N: usize> {
    stored: Surfaces<N>,
    /// The fields of each triangle's [`WorldNormal`].
    across: [[f64; N]; 3],
    unit: [[f32; N]; 3],
    is_extreme: [u32; N],
}

impl<const N: usize> Triangles<N> {
    pub const NONE: Self =
        Self { stored: Surfaces::NONE, across: [[0.0; N]; 3], unit: [[0.0; N]; 3], is_extreme: [0; N] };

    /// Loads the triangles of `groups`; `hit` returns the hit of a ray. Returns the rays whose triangles' blocks have
    /// left the snapshot, and removes them from `groups`. Computes normals if `normals`.
    #[inline(always)]
    pub fn look(
        &mut self,
        tree: &Tree,
        placed: &Placed,
        groups: &mut Groups<N>,
        hit: impl Fn(usize) -> TriHit,
        normals: bool,
    ) -> u32 {
        let first = |column: usize| groups.rays[column].trailing_zeros() as usize;
        let mut gone = 0;
        for column in bits(tree.surfaces(groups.count, |column| hit(first(column)), &mut self.stored)) {
            gone |= std::mem::take(&mut groups.rays[column]);
        }
        if normals && N == 1 {
            first_normals::<N, N>(self, placed);
        } else if normals {
            dispatch(tree.isa(), Normals { triangles: self, placed, count: groups.count });
        }
        gone
    }

    /// The corners of a triangle in the tree's frame.
    #[inline(always)]
    pub fn corners(&self, column: usize) -> [Vec3; 3] {
        self.stored.corners_of(column)
    }

    /// The tree's local part of a triangle.
    #[inline(always)]
    pub fn part(&self, column: usize) -> u32 {
        self.stored.part[column]
    }

    #[inline(always)]
    pub fn normal(&self, column: usize) -> WorldNormal {
        let (across, unit) = (&self.across, &self.unit);
        WorldNormal {
            across: DVec3::new(across[0][column], across[1][column], across[2][column]),
            unit: Vec3::new(unit[0][column], unit[1][column], unit[2][column]),
            is_extreme: self.is_extreme[column] != 0,
        }
    }

    /// Writes the unit normals that face the rays to the columns of the rays that hit triangles. `dir` holds the rays'
    /// unit directions.
    pub fn normals_of_rays(&self, isa: Isa, groups: &Groups<N>, dir: &[[f32; N]; 3], out: &mut [[f32; N]; 3]) {
        for (column, rays) in groups.rays.iter().enumerate().take(groups.count) {
            let unit = self.normal(column).unit;
            for i in bits(*rays) {
                (out[0][i], out[1][i], out[2][i]) = (unit.x, unit.y, unit.z);
            }
        }
        let doubtful = dispatch(isa, Turn { dir, normals: out });
        for (column, rays) in groups.rays.iter().enumerate().take(groups.count) {
            let normal = self.normal(column);
            for i in bits(if normal.is_extreme { *rays } else { rays & doubtful }) {
                let normal = normal.facing(Vec3::new(dir[0][i], dir[1][i], dir[2][i]));
                (out[0][i], out[1][i], out[2][i]) = (normal.x, normal.y, normal.z);
            }
        }
    }
}

/// Computes the normals of the first `count` triangles.
struct Normals<'a, const N: usize> {
    triangles: &'a mut Triangles<N>,
    placed: &'a Placed,
    count: usize,
}

/// Greatest number of triangles for which the loop over half a packet suffices.
const FEW: usize = 16;

impl<const N: usize> Op for Normals<'_, N> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { triangles, placed, count } = self;
        if N > FEW && count <= FEW {
            first_normals::<N, FEW>(triangles, placed)
        } else {
            first_normals::<N, N>(triangles, placed)
        }
    }
}

/// Computes the normals of the first `COUNT` triangles, at most `N`.
#[inline(always)]
fn first_normals<const N: usize, const COUNT: usize>(triangles: &mut Triangles<N>, placed: &Placed) {
    let Triangles { stored, across: [x, y, z], unit, is_extreme } = triangles;
    for i in 0..COUNT {
        let n = across(&stored.corners_of(i));
        (x[i], y[i], z[i]) = (n.x, n.y, n.z);
    }
    if placed.only_shifted().is_none() {
        for i in 0..COUNT {
            let n = placed.world_normal(DVec3::new(x[i], y[i], z[i]));
            (x[i], y[i], z[i]) = (n.x, n.y, n.z);
        }
    }
    for i in 0..COUNT {
        let n = WorldNormal::of(DVec3::new(x[i], y[i], z[i]));
        (unit[0][i], unit[1][i], unit[2][i]) = (n.unit.x, n.unit.y, n.unit.z);
        is_extreme[i] = u32::from(n.is_extreme);
    }
}

/// Turns unit normals so that they face the rays with the unit directions `dir`. Returns the rays for which single
/// precision cannot decide the side.
struct Turn<'a, const N: usize> {
    dir: &'a [[f32; N]; 3],
    normals: &'a mut [[f32; N]; 3],
}

/// Cosines farther from zero than this have the sign of the exact cosine in [`WorldNormal::facing`]. The limit is eight
/// times the rounding of components and sums of unit vectors.
const SURE: f32 = 1.0 / (1 << 20) as f32;

impl<const N: usize> Op for Turn<'_, N> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let Self { dir, normals: [x, y, z] } = self;
        let mut is_doubtful = [0; N];
        for i in 0..N {
            let cosine = x[i] * dir[0][i] + y[i] * dir[1][i] + z[i] * dir[2][i];
            let turn = if cosine > 0.0 { -1.0 } else { 1.0 };
            (x[i], y[i], z[i]) = (x[i] * turn, y[i] * turn, z[i] * turn);
            is_doubtful[i] = u32::from(cosine.abs() <= SURE) << i;
        }
        is_doubtful.iter().fold(0, |all, it| all | it)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DMat3};

    fn corners(v: [[f32; 3]; 3]) -> [Vec3; 3] {
        v.map(Vec3::from)
    }

    #[test]
    fn normals_go_by_the_inverse_transpose_and_face_the_ray() {
        let squash = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.5));
        let p = Placed::for_tests(DVec3::ZERO, 2.0, &DAffine3 { matrix3: squash, translation: DVec3::ZERO });
        // The plane x + z = 0 becomes x + 2 z = 0.
        let t = corners([[0.0, 0.0, 0.0], [1.0, 0.0, -1.0], [0.0, 1.0, 0.0]]);
        for dir in [-DVec3::Z, DVec3::Z] {
            let n = WorldNormal::new(&p, &t).facing(dir.as_vec3());
            let expected = DVec3::new(1.0, 0.0, 2.0).normalize() * -dir.z.signum();
            assert!(n.as_dvec3().distance(expected) < 2e-7, "{n} {expected}");
        }
        let sliver = corners([[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        assert_eq!(WorldNormal::new(&p, &sliver).facing(Vec3::X), -Vec3::X);
        // The squares are too small or too large for single precision.
        for size in [1e-30f32, 1e15] {
            let t = corners([[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]]);
            assert_eq!(WorldNormal::new(&p, &t).facing(Vec3::Z), -Vec3::Z);
        }
    }
}
