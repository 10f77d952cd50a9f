//! Stability: what must hold where the methods fail (design, section 10), row by row, each as a generated, seeded scene
//! with a pass line that is a property. Pictures are made at 0, 0.5, 1, 3 and 10 pixels of error, with one thread and
//! two, on each vector path; where a row is about builds, files, reading, or what is hidden, the tests that the table
//! names say what they vary.
//!
//! [`table`] says which test shows which row, where present parts miss a line, and which rows wait for later parts.
//! `cargo test --test pictures stability:: -- --nocapture` prints what is measured.

#[path = "stability/awkward.rs"]
mod awkward;
#[path = "stability/brightness.rs"]
mod brightness;
#[path = "stability/degenerate.rs"]
mod degenerate;
#[path = "stability/dense.rs"]
mod dense;
#[path = "stability/far.rs"]
mod far;
#[path = "stability/foliage.rs"]
mod foliage;
#[path = "stability/hidden.rs"]
mod hidden;
#[path = "stability/normals.rs"]
mod normals;
#[path = "stability/pictures.rs"]
mod pictures;
#[path = "stability/scale.rs"]
mod scale;
#[path = "stability/small_cache.rs"]
mod small_cache;
#[path = "stability/soups.rs"]
mod soups;
#[path = "stability/starts.rs"]
mod starts;
#[path = "stability/smooth_surfaces.rs"]
mod smooth_surfaces;
#[path = "stability/table.rs"]
mod table;
#[path = "stability/thin.rs"]
mod thin;
#[path = "stability/up_to_date.rs"]
mod up_to_date;
#[path = "stability/worst.rs"]
mod worst;
#[path = "stability/zoom.rs"]
mod zoom;
