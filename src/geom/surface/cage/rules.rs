//! Sharpness and the rules that follow from it: DeRose, Kass, Truong, "Subdivision Surfaces in Character Animation",
//! SIGGRAPH 1998, in the form of OpenSubdiv 3.5 (`Sdc::Crease`).

use super::desc::Creasing;

/// Sharpness from which edges and vertices stay sharp at all levels.
pub const INFINITE: f32 = 10.0;

/// The rule of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Rule {
    /// No sharp edge.
    Smooth,
    /// One sharp edge: the rule of the vertex is smooth, that of the edge is not.
    Dart,
    /// Two sharp edges.
    Crease,
    /// Three sharp edges or more, or a sharp vertex.
    Corner,
}

impl Rule {
    pub fn of(vertex: f32, edges: impl Iterator<Item = f32>) -> Self {
        if vertex > 0.0 {
            return Rule::Corner;
        }
        match edges.filter(|&sharpness| sharpness > 0.0).count() {
            0 => Rule::Smooth,
            1 => Rule::Dart,
            2 => Rule::Crease,
            _ => Rule::Corner,
        }
    }

    /// True if the vertex has the smooth rule.
    pub fn is_smooth(self) -> bool {
        matches!(self, Rule::Smooth | Rule::Dart)
    }
}

pub(super) fn is_semi_sharp(sharpness: f32) -> bool {
    sharpness > 0.0 && sharpness < INFINITE
}

/// Sharpness one level deeper.
pub(super) fn decremented(sharpness: f32) -> f32 {
    if sharpness >= INFINITE { INFINITE } else { (sharpness - 1.0).max(0.0) }
}

/// The sum and number of sharpnesses. Fixed point, so that the order does not matter: neighbours see one vertex's edges
/// in different orders, and their surfaces must meet.
fn total(sharpness: impl Iterator<Item = f32>) -> (f64, usize) {
    const UNIT: f64 = (1u64 << 40) as f64;
    let (sum, count) = sharpness.fold((0u64, 0), |(sum, count), s| (sum + (f64::from(s) * UNIT) as u64, count + 1));
    (sum as f64 / UNIT, count)
}

/// Sharpness of the child edge at a vertex. `around`: sharpness of all edges at the vertex.
pub(super) fn child_sharpness(sharpness: f32, around: impl Iterator<Item = f32>, creasing: Creasing) -> f32 {
    if creasing == Creasing::Uniform || !is_semi_sharp(sharpness) {
        return decremented(sharpness);
    }
    let (sum, count) = total(around.filter(|&s| is_semi_sharp(s)));
    if count < 2 {
        return decremented(sharpness);
    }
    let own = f64::from(sharpness);
    let others = (sum - own) / (count - 1) as f64;
    (0.75 * own + 0.25 * others - 1.0).max(0.0) as f32
}

/// Weight of the parent's rule where the child's rule is another one: the mean of the sharpnesses that run out between
/// them, at most 1. `edges`: sharpness of each edge at the vertex and of its child there.
pub(super) fn transition(
    vertex: f32,
    vertex_child: f32,
    edges: impl Iterator<Item = (f32, f32)>,
    creasing: Creasing,
) -> f64 {
    let runs_out = |&(parent, child): &(f32, f32)| match creasing {
        Creasing::Uniform => parent > 0.0 && parent <= 1.0,
        Creasing::Chaikin => parent > 0.0 && child <= 0.0,
    };
    let vertex = (vertex > 0.0 && vertex_child <= 0.0).then_some(vertex);
    let (sum, count) = total(edges.filter(runs_out).map(|(parent, _)| parent).chain(vertex));
    if count == 0 { 0.0 } else { (sum / count as f64).min(1.0) }
}
