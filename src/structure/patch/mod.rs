//! `patch`: surfaces as grids under quadtrees of quantised boxes, each in the system of a flat part of the surface
//! (Selgrad, Lier, Martinek, Buchenau, Guthe, Kranz, Schäfer, Stamminger: "A compressed representation for ray tracing
//! parametric surfaces", ACM Transactions on Graphics 36 (1), 2016).
//!
//! A wide tree of full precision leads to **frames**, square parts of a surface whose normals differ little. Below a
//! frame is a complete quadtree, a byte for each node. The boxes of the quadtree are the stand-ins of the surface: a
//! ray whose footprint covers a box meets it there. Other rays meet the triangles of the frame's grid, whose vertices
//! are on the surface. They are computed where a ray comes to them, from the control points of a patch that many grids
//! share (`net`), or stored (the paper's exact variant PREGEN^C, section 3.6).
//!
//! Differences from the paper: the map of a frame is affine, not projective. A leaf of the quadtree is four cells,
//! eight triangles, which one vector test takes. Boxes enclose the vertices of the grid. Exact rays meet triangles
//! instead of the surface by Newton's method: neighbours then share the vertices of their border to the bit, no ray
//! passes between them, and all other queries find the same surface.

pub mod build;
mod cells;
pub mod codes;
mod decoder;
pub mod layout;
mod leaf;
pub mod net;
pub mod nodes;
pub mod open;
mod points;
mod ray;
mod rows;
pub mod trace;

pub use decoder::{PatchDecoder, block_parts, entered_blocks, holders};
