//! Mesh files in, model files out and in again, and their blocks in memory: import, build, damage, budgets, prefetch.

mod background;
mod bad_input;
mod build_limits;
mod cancelled_builds;
mod common;
mod contact_sheet;
mod cursor;
mod failing_builds;
mod faults;
mod format;
mod gltf_files;
mod hostile_oc;
mod import_models;
mod models;
mod needs;
mod out_of_core_build;
mod prefetch;
mod read_back;
mod residency;
mod scene_files;
mod sheet;
mod streaming;
mod surface_models;
