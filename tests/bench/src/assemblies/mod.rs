//! Assemblies: scenes whose meshes are placed, each a tree of its own.

mod airliner;
mod bolts;
mod gltf;
pub mod shapes;
mod station;

use crate::data::SceneRow;
use crate::failure::{Failure, Outcome};
use outcrop::import::Sink;

/// An assembly of the table `ALL`.
#[derive(Debug, Clone, Copy)]
pub struct Kind(fn(&SceneRow, &mut dyn Sink) -> Outcome);

/// By name, as rows have it.
const ALL: [(&str, Kind); 3] =
    [("bolts", Kind(bolts::fill)), ("station", Kind(station::fill)), ("airliner", Kind(airliner::fill))];

impl Kind {
    pub fn of(name: &str) -> Result<Self, Failure> {
        let found = ALL.into_iter().find(|(known, _)| *known == name);
        found
            .map(|(_, kind)| kind)
            .ok_or_else(|| Failure::new(format!("no assembly {name:?}; there are {:?}", ALL.map(|(name, _)| name))))
    }

    /// Sends the meshes and their placements to a sink.
    pub fn fill(self, row: &SceneRow, sink: &mut dyn Sink) -> Outcome {
        (self.0)(row, sink)
    }
}
