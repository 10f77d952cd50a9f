//! Four views of generated models: two of the whole model, two at a quarter of the distance.

use super::airliner::attitude;
use crate::math::View;
use glam::DVec3;

/// Returns the views of the model `name`; `None` for a name that is not in [`super::NAMES_WITH_VIEWS`]: the plant's
/// species differ in size, and views from the bounds suit them. Views do not depend on size or seed.
pub fn views(name: &str) -> Option<[View; 4]> {
    let look = |at: [f64; 3], from: [f64; 3], distance: f64| {
        View::looking(DVec3::from(at), DVec3::from(from), distance, DVec3::Z)
    };
    match name {
        // The bulb is about 2.4 across. The near views show its bumps at a grazing angle, and the pit at a pole.
        "mandelbulb" => Some([
            look([0.0; 3], [0.75, 0.5, 0.45], 3.2),
            look([0.0; 3], [-0.3, 0.8, -0.55], 3.2),
            look([0.62, 0.45, 0.45], [0.75, 0.5, 0.45], 0.8),
            look([-0.25, 0.7, -0.5], [-0.3, 0.8, -0.55], 0.8),
        ]),
        // In the airliner's frame: from the left in front, at the cutaway, and from the right below; then into the
        // cabin, and into the left engine.
        "airliner" => {
            let world = attitude();
            let own = |at: [f64; 3], from: [f64; 3], distance: f64| {
                let (at, from) = (DVec3::from(at), DVec3::from(from));
                let (at, from) = (world.transform_point3(at), world.transform_vector3(from));
                View::looking(at, from, distance, DVec3::Z)
            };
            Some([
                own([31.0, 0.0, 0.0], [-45.0, -44.0, 17.0], 66.0),
                own([37.0, 0.0, 2.0], [37.0, 48.0, -14.0], 66.0),
                own([22.0, 0.0, 0.0], [-14.0, -13.0, 7.0], 16.5),
                own([22.0, -10.0, -2.6], [-10.0, -6.0, 1.1], 16.5),
            ])
        }
        _ => None,
    }
}
