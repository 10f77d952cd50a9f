//! Normals of vertices, four bytes each.

use crate::math::octahedral;
use glam::Vec3;

/// Normals by index. Those that are zero or not finite come back as NaN.
#[derive(Default)]
pub(crate) struct Normals(Vec<u32>);

/// Stands for a normal that cannot be used; no code of a direction.
const UNUSABLE: u32 = 0;

impl Normals {
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        Self(Vec::with_capacity(capacity))
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn push(&mut self, normal: [f32; 3]) {
        self.0.push(octahedral::encode_any(Vec3::from(normal)).unwrap_or(UNUSABLE));
    }

    #[inline]
    pub(crate) fn get(&self, index: usize) -> Vec3 {
        self.0.get(index).filter(|code| **code != UNUSABLE).map_or(Vec3::NAN, |code| octahedral::decode(*code))
    }
}
