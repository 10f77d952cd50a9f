//! The oracle: what the crate's answers are compared with.
//!
//! Everything here is in double precision and written anew: none of it uses the crate's
//! tracing code (`structure`, `geom`, `simd`), so that a defect there cannot hide itself.
//!
//! | file | what |
//! |---|---|
//! | [`rng`] | seeded random numbers |
//! | [`brute`] | ray against triangle in f64, closest, any, all, by looking at every triangle |
//! | [`bvh64`] | the same answers faster, from a plain f64 BVH that `tests/oracle.rs` checks against `brute` |
//! | [`samples`] | means over a square by low-discrepancy samples, with their standard errors |
//! | [`view`] | a camera's rays |
//! | [`light`] | coverage of pixels, ambient occlusion, direct light; `tests/oracle_light.rs` checks them against closed forms |
//! | [`rounding`] | how far single precision may move things: the bounds, derived, not tuned |
//! | [`errors`] | what agreeing means: ties, grazing, distance, normal, part; and a summary that asserts |
//! | [`picture`] | errors between two pictures, each with its formula |
//! | [`foreign`] | how much a picture shows of parts and colours that the exact one hides |
//! | [`perceived`] | how much two pictures differ to the eye: FLIP and SSIM |
//! | [`popping`] | what changes from frame to frame although the model does not |
//! | [`promise`] | whether some surface lies within a hit's error |
//! | [`asked`] | plain rays of the world around something, and a scene's answers |
//! | [`rays`] | seeded rays of every awkward kind |
//! | [`models`], [`scenes`] | the models folder and the five test models as triangle lists |
//! | [`shapes`], [`nurbs`] | cages with tags, and their limit surfaces as small triangles; NURBS with closed forms |
//! | [`ribs`] | a skin over ribs, flat and as a tube |
//! | [`airliner`] | the generated airliner, whole and a slice of it |
//! | [`changed`] | generated models with changes on their way to the build |
//! | [`closed`] | closed models on a grid, and their crossings in integers |
//! | [`built`], [`stored`] | files under test, built through the public API, and what they store |
//! | [`frames`] | cameras, requests that must converge, scenes with something of everything |
//! | [`trees`] | the trees under test, with any blocks missing |
//! | [`sources`] | sources that fail, stall and dawdle |
// Each test binary uses its own share of this folder.
#![allow(dead_code)]

pub mod airliner;
pub mod asked;
pub mod brute;
pub mod built;
pub mod bvh64;
pub mod changed;
pub mod closed;
pub mod errors;
pub mod foreign;
pub mod frames;
pub mod light;
pub mod models;
pub mod nurbs;
pub mod perceived;
pub mod picture;
pub mod popping;
pub mod promise;
pub mod rays;
pub mod ribs;
pub mod rng;
pub mod rounding;
pub mod samples;
pub mod scenes;
pub mod shapes;
pub mod sources;
pub mod stored;
pub mod trees;
pub mod view;
