//! Parametric surfaces, compared with other libraries, closed forms and deep subdivision in double precision.

mod common;
#[path = "surfaces/bfr.rs"]
mod bfr;
#[path = "surfaces/built.rs"]
mod built;
#[path = "surfaces/deep.rs"]
mod deep;
#[path = "surfaces/evaluated.rs"]
mod evaluated;
#[path = "surfaces/patches.rs"]
mod patches;
#[path = "surfaces/refined.rs"]
mod refined;
