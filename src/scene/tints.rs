//! Tints of the members of arrays: factors to the colours of what a member shows. In scenes in scenes those of all
//! levels are multiplied.

use super::placement::{Holder, Member, Placement};
use super::walk::{HitTree, SceneView};
use glam::{Vec3, Vec4};

/// Linear factors to red, green, blue and opacity; 255 stands for 1.
pub(super) type Tint = [u8; 4];

/// That of members without one.
pub(super) const NO_TINT: Tint = [u8::MAX; 4];

/// The factors.
fn factors(tint: Tint) -> Vec4 {
    Vec4::from(tint.map(|value| f32::from(value) / f32::from(u8::MAX)))
}

/// The factors to the colours of a member with this mask and tint, for the cells above it. `None`: it is in no cell,
/// because not all rays see it, or because it is see-through.
pub(super) fn in_cells(mask: u32, tint: Tint) -> Option<Vec3> {
    (mask == u32::MAX && !is_clear(tint)).then(|| factors(tint).truncate())
}

/// True if it makes a member see-through.
pub(super) fn is_clear(tint: Tint) -> bool {
    tint[3] < u8::MAX
}

impl Placement {
    /// The factors to the colours of a member of the top tree in the cells above it. `None`: it is in none.
    pub(super) fn tint_in_cells(&self, member: &Member) -> Option<Vec3> {
        let number = match member {
            Member::Placed(number) => u64::from(*number),
            Member::Scene(it) => return in_cells(it.mask(), it.tint()),
        };
        if self.single(number).is_some() {
            return Some(Vec3::ONE);
        }
        match self.holder_of(number) {
            Holder::Array(it) => it.array.in_cells(it.member_of(number as u32)),
            Holder::Scene(it) => in_cells(it.mask(), it.tint()),
        }
    }

    /// The product of the tints of a placed tree and of the scenes around it.
    fn tint_of(&self, number: u64) -> Vec4 {
        if self.single(number).is_some() {
            return Vec4::ONE;
        }
        match self.holder_of(number) {
            Holder::Array(it) => factors(it.array.tint(it.member_of(number as u32))),
            Holder::Scene(it) => it.scene.placement.tint_of(number - it.first) * factors(it.tint()),
        }
    }

    /// The product of the tints of so many scenes around a placed tree, the outermost ones.
    fn tint_around(&self, number: u64, levels: u32) -> Vec4 {
        match levels {
            0 => Vec4::ONE,
            _ => {
                let it = self.scene_with(number);
                it.scene.placement.tint_around(number - it.first, levels - 1) * factors(it.tint())
            }
        }
    }
}

impl SceneView<'_> {
    /// The factors to the linear colour and the opacity of what a hit shows; `None` if it has no tint. Colours of looks
    /// are without them.
    pub(crate) fn tint(&self, tree: HitTree) -> Option<Vec4> {
        if !self.scene.has_tints {
            return None;
        }
        let placement = &self.scene.placement;
        let tint = match tree {
            HitTree::Placed(number) => placement.tint_of(number),
            // The tints of members below are in the colours of the cell.
            HitTree::Top { first, level } => placement.tint_around(first, level),
        };
        (tint != Vec4::ONE).then_some(tint)
    }
}
