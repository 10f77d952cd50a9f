//! Axis-aligned boxes in single and double precision.

use glam::{DAffine3, DVec3, Vec3};

macro_rules! bounds {
    ($(#[$doc:meta])* $name:ident, $vec:ident, $scalar:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name {
            /// Least corner; +infinity in each component when empty.
            pub min: $vec,
            /// Greatest corner; -infinity in each component when empty.
            pub max: $vec,
        }
        impl $name {
            /// The empty box, the neutral element of [`Self::union`].
            pub const EMPTY: Self = Self { min: $vec::INFINITY, max: $vec::NEG_INFINITY };
            /// Returns the smallest box around `points`.
            pub fn of(points: &[$vec]) -> Self {
                points.iter().fold(Self::EMPTY, |b, &p| b.with(p))
            }
            /// Returns the smallest box that contains this one and `p`.
            #[inline]
            pub fn with(self, p: $vec) -> Self {
                Self { min: self.min.min(p), max: self.max.max(p) }
            }
            /// Returns the smallest box that contains both.
            #[inline]
            pub fn union(self, o: Self) -> Self {
                Self { min: self.min.min(o.min), max: self.max.max(o.max) }
            }
            /// Returns the common part of both; may be empty.
            #[inline]
            pub fn intersection(self, o: Self) -> Self {
                Self { min: self.min.max(o.min), max: self.max.min(o.max) }
            }
            /// True if the box contains no point. A flat box is not empty.
            #[inline]
            pub fn is_empty(&self) -> bool {
                !self.min.cmple(self.max).all()
            }
            /// Edge lengths; negative infinity when empty.
            #[inline]
            pub fn extent(&self) -> $vec {
                self.max - self.min
            }
            /// The centre.
            #[inline]
            pub fn center(&self) -> $vec {
                self.min + (self.max - self.min) * 0.5
            }
            /// Half of the surface area; 0 when empty.
            #[inline]
            pub fn half_area(&self) -> $scalar {
                let e = self.extent();
                if self.is_empty() { 0.0 } else { e.x * e.y + e.y * e.z + e.z * e.x }
            }
            /// True if this box contains `o`; their borders may touch.
            #[inline]
            pub fn contains(&self, o: &Self) -> bool {
                self.min.cmple(o.min).all() && o.max.cmple(self.max).all()
            }
            /// True if the two boxes share a point, borders included.
            #[inline]
            pub fn overlaps(&self, o: &Self) -> bool {
                self.min.cmple(o.max).all() && o.min.cmple(self.max).all()
            }
        }
    };
}

bounds!(
    /// A box in single precision.
    Bounds, Vec3, f32
);
bounds!(
    /// A box in double precision.
    DBounds, DVec3, f64
);

impl DBounds {
    /// Squared distance between two boxes; 0 if they share a point.
    #[inline]
    pub fn squared_distance(&self, o: &Self) -> f64 {
        let beyond = (self.min - o.max).max(o.min - self.max).max(DVec3::ZERO);
        beyond.dot(beyond)
    }

    /// Squared distance from a point; 0 inside.
    #[inline]
    pub fn squared_distance_to(&self, p: DVec3) -> f64 {
        self.squared_distance(&Self { min: p, max: p })
    }

    /// Returns the smallest box around the image of this one under `m`. An empty box stays empty.
    pub fn transformed(&self, m: &DAffine3) -> Self {
        if self.is_empty() {
            return *self;
        }
        (0..8).fold(Self::EMPTY, |b, i| {
            let pick = |bit: u32, lo: f64, hi: f64| if i >> bit & 1 == 0 { lo } else { hi };
            b.with(m.transform_point3(DVec3::new(
                pick(0, self.min.x, self.max.x),
                pick(1, self.min.y, self.max.y),
                pick(2, self.min.z, self.max.z),
            )))
        })
    }
}
