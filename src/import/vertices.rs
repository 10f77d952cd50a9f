//! Vertices of formats that index them globally, in as few bytes as hold them exactly.

use glam::DVec3;

/// Positions by index: 12 or 24 bytes each.
pub(crate) enum Vertices {
    /// Every coordinate of the file fits single precision.
    Single(Vec<[f32; 3]>),
    /// Some may not.
    Double(Vec<[f64; 3]>),
}

impl Vertices {
    pub(crate) fn len(&self) -> usize {
        match self {
            Vertices::Single(v) => v.len(),
            Vertices::Double(v) => v.len(),
        }
    }

    /// The position of vertex `i`, if there is one.
    #[inline]
    pub(crate) fn get(&self, i: usize) -> Option<DVec3> {
        match self {
            Vertices::Single(v) => v.get(i).map(|p| DVec3::from(p.map(f64::from))),
            Vertices::Double(v) => v.get(i).map(|&p| DVec3::from(p)),
        }
    }
}
