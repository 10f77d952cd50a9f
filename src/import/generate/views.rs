//! Four views of each generated model: two of the whole, two at a quarter of the distance.

use crate::math::View;
use glam::DVec3;

/// The views of the model `name`; `None` for an unknown name. They do not depend on size or seed.
pub fn views(name: &str) -> Option<[View; 4]> {
    let look = |at: [f64; 3], from: [f64; 3], distance: f64| {
        View::looking(DVec3::from(at), DVec3::from(from), distance, DVec3::Z)
    };
    match name {
        // The bulb is about 2.4 across; the near views graze its bumps and look into a pole's pit.
        "mandelbulb" => Some([
            look([0.0; 3], [0.75, 0.5, 0.45], 3.2),
            look([0.0; 3], [-0.3, 0.8, -0.55], 3.2),
            look([0.62, 0.45, 0.45], [0.75, 0.5, 0.45], 0.8),
            look([-0.25, 0.7, -0.5], [-0.3, 0.8, -0.55], 0.8),
        ]),
        _ => None,
    }
}
