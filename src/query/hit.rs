//! What a query answers.

use glam::{DVec3, Vec3};

/// The id in fields of a [`Hit`] that were not asked for, or of a miss.
pub const NONE: u64 = u64::MAX;

/// What was hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum HitKind {
    /// Nothing within the ray's interval, or the ray was let through what stands in there: see [`Hit::t_free`].
    #[default]
    Miss = 0,
    /// An original triangle.
    Exact = 1,
    /// A stand-in, as fine as asked for.
    Lod = 2,
    /// Data that is not in memory was needed: the hit is a stand-in for it, or unknown.
    Missing = 3,
}

/// The closest hit of a ray, in world units. (Members in the order of the C struct, so that handing it over is a copy.)
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// Distance in units of the ray's `|dir|`; infinity for a miss. In double precision with [`Want::POSITION`] or
    /// [`Want::ERROR`]; without, in single precision, and on long thin triangles near the ray's origin it may be off by
    /// more than its last digits.
    pub t: f64,
    /// Where, in world space.
    pub position: DVec3,
    /// No original surface lies on the ray before this. Left out are surfaces that the ray meets within 0.9 degrees of
    /// edge-on, the one that it starts on, and edges that it grazes. Finite for a miss if the ray passed stand-ins:
    /// then, as of hits behind these, it is that of the hit that there would be if no ray passed any.
    pub t_free: f64,
    /// The caller's id of the part.
    pub part: u64,
    /// The caller's id of the instance.
    pub instance: u64,
    /// The triangle's index in the input of its model's build.
    pub prim: u64,
    /// Unit geometric normal in world space, facing the ray's origin.
    pub normal: Vec3,
    /// Weights of the triangle's second and third vertex.
    pub uv: [f32; 2],
    /// Some original surface lies within this distance of `position` (world units).
    pub error: f32,
    /// What was hit.
    pub kind: HitKind,
    /// 0: there is nothing between members that is not written.
    pub reserved: u32,
}

impl Hit {
    /// Nothing hit.
    pub const MISS: Self = Self {
        t: f64::INFINITY,
        position: DVec3::INFINITY,
        normal: Vec3::ZERO,
        uv: [0.0; 2],
        part: NONE,
        instance: NONE,
        prim: NONE,
        kind: HitKind::Miss,
        error: 0.0,
        t_free: f64::INFINITY,
        reserved: 0,
    };
}

impl Default for Hit {
    fn default() -> Self {
        Self::MISS
    }
}

/// Which fields of a [`Hit`] to fill: a set, joined with `|`. `t` and `kind` always are; the others
/// keep their values of [`Hit::MISS`] unless asked for. What is not asked for is not worked for:
/// primitive ids, for instance, are read from the disk only when asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Want(pub u32);

impl Want {
    /// Only `t` and `kind`.
    pub const NOTHING: Self = Self(0);
    /// `position`.
    pub const POSITION: Self = Self(1);
    /// `normal`.
    pub const NORMAL: Self = Self(2);
    /// `uv`.
    pub const UV: Self = Self(4);
    /// `part`.
    pub const PART: Self = Self(8);
    /// `instance`.
    pub const INSTANCE: Self = Self(16);
    /// `prim`.
    pub const PRIM: Self = Self(32);
    /// `error` and `t_free`, and a `t` to within the stated error: the hit is worked out
    /// again in double precision. Without it `t` is what single precision gave.
    pub const ERROR: Self = Self(64);
    /// Everything.
    pub const ALL: Self = Self(127);
    /// What takes where the ray meets the triangle in double precision.
    pub(crate) const MEETING: Self = Self(Self::POSITION.0 | Self::ERROR.0);
    /// What the triangle is needed for.
    pub(crate) const SURFACE: Self = Self(Self::POSITION.0 | Self::NORMAL.0 | Self::PART.0 | Self::ERROR.0);

    /// Whether all of `other` is in here.
    #[inline]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
    /// Whether some of `other` is in here.
    #[inline]
    pub const fn any_of(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

impl std::ops::BitOr for Want {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}
