//! The answer of a query to one ray, and the choice of its fields.

use glam::{DVec3, Vec3};

/// The id in those fields of a [`Hit`] that the caller did not request, and in all id fields of a miss.
pub const NONE: u64 = u64::MAX;

/// The kind of a hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum HitKind {
    /// No hit within the ray's interval, or stand-ins transmitted the ray there: see [`Hit::t_free`].
    #[default]
    Miss = 0,
    /// An original triangle.
    Exact = 1,
    /// A stand-in that is as fine as the ray's footprint requires.
    Lod = 2,
    /// The ray needed data that is not in memory: the hit is a stand-in for that data, or unknown.
    Missing = 3,
}

/// The closest hit of a ray, in world units. The members have the order of the C struct, so that a hit is handed over
/// as a copy.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// Distance in units of the ray's `|dir|`; infinity for a miss. It is computed in double precision with
    /// [`Want::POSITION`] or [`Want::ERROR`]. Without these it has single precision, and on long thin triangles near
    /// the ray's origin the error may exceed its last digits.
    pub t: f64,
    /// The point of the hit in world space.
    pub position: DVec3,
    /// No original surface lies on the ray before this distance. Exceptions are surfaces that the ray meets within 0.9
    /// degrees of edge-on, the surface on which the ray starts, and edges that it grazes. If the ray
    /// entered stand-ins before its hit or its end, this is the first entry into one; for a miss it is then finite.
    pub t_free: f64,
    /// The caller's id of the part.
    pub part: u64,
    /// The caller's id of the instance.
    pub instance: u64,
    /// The triangle's index in the input of its model's build. On a surface of structure `patch` the face's, among the
    /// faces of all surfaces in the order in which they were added: the faces of a cage, or the rectangles between the
    /// knots of a NURBS surface.
    pub prim: u64,
    /// Unit geometric normal in world space, facing the ray's origin.
    pub normal: Vec3,
    /// Weights of the triangle's second and third vertex. On a surface of structure `patch` the parameters u and v in
    /// the face, from 0 to 1, also of a stand-in of one face: those of its middle.
    pub uv: [f32; 2],
    /// Some original surface lies within this distance of `position` (world units).
    pub error: f32,
    /// The kind of the hit.
    pub kind: HitKind,
    /// Unit normal in world space that the surface is shaded with, on the side of `normal`: interpolated between the
    /// corners of the triangle. That of the triangle itself where the model has no others, and that of a stand-in.
    pub shading_normal: Vec3,
    /// The number of the placed tree that was hit, with [`Want::INSTANCE`]: it tells the places of one mesh apart. See
    /// [`SceneState::path`](crate::scene::SceneState::path).
    pub occurrence: u64,
}

impl Hit {
    /// A miss.
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
        shading_normal: Vec3::ZERO,
        occurrence: NONE,
    };
}

impl Default for Hit {
    fn default() -> Self {
        Self::MISS
    }
}

/// A set of the fields of a [`Hit`] that a query fills, joined with `|`. `t` and `kind` are always filled. Other fields
/// keep their values of [`Hit::MISS`] unless the caller requests them, and cost nothing then: primitive ids, for
/// instance, are read from the disk only on request.
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
    /// `error` and `t_free`, and a `t` that is accurate to within the stated error: the hit is recomputed in double
    /// precision. Without it `t` has single precision.
    pub const ERROR: Self = Self(64);
    /// `shading_normal`. May have to read blocks that nothing else needs.
    pub const SHADING_NORMAL: Self = Self(128);
    /// All fields but the shading normal.
    pub const ALL: Self = Self(127);
    /// Fields that need the normals of triangles.
    pub(crate) const NORMALS: Self = Self(Self::NORMAL.0 | Self::SHADING_NORMAL.0);
    /// Fields that need the intersection in double precision.
    pub(crate) const MEETING: Self = Self(Self::POSITION.0 | Self::ERROR.0);
    /// Fields that need the data of the triangle.
    pub(crate) const SURFACE: Self = Self(Self::POSITION.0 | Self::NORMALS.0 | Self::PART.0 | Self::ERROR.0);

    /// True if the set contains all of `other`.
    #[inline]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
    /// True if the set contains some of `other`.
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
