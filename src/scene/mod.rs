//! The scene: the context, opened models, instances under a top-level tree, cameras, lights, and the looks of parts. A
//! scene is independent of cameras. Jobs read immutable [`SceneState`]s.
#![forbid(unsafe_code)]

pub(crate) mod alike;
mod array;
pub(crate) mod beam;
pub mod camera;
mod commit;
mod commit_inner;
pub mod context;
mod draft;
pub(crate) mod entered;
pub mod edit;
mod fit;
pub(crate) mod frame;
mod forms;
mod given;
mod inner;
pub mod light;
mod looks;
pub(crate) mod measures;
pub mod model;
mod occurrence;
mod open;
mod part_check;
mod parts;
pub(crate) mod placed;
pub(crate) mod placement;
mod refit;
pub(crate) mod ray_rows;
mod save;
pub mod state;
mod summary;
mod tints;
mod values;
pub(crate) mod through;
pub(crate) mod top;
mod top_walk;
pub(crate) mod group;
mod groups;
mod appearances;
mod by_member;
pub(crate) mod packet;
mod box_ray;
pub(crate) mod stream;
pub(crate) mod walk;
pub(crate) mod widths;

pub(crate) use alike::Alike;
pub use array::{Instances, Place, Prototypes, Transforms};
pub use camera::Camera;
pub use context::{Context, ContextOptions, LogLevel};
pub use edit::{Scene, Scope};
pub use fit::{Chosen, Fit, Lens, MARGIN, NamedView};
pub(crate) use group::Group;
pub use light::{Background, Light, LightKind};
pub use model::{Model, ModelInfo, ModelMemory};
pub use parts::{ModelParts, PartInfo};

pub use looks::Look;
pub(crate) use looks::blocks_with;
pub use state::SceneState;
pub use summary::SceneSummary;
