//! How rays are traced: single rays, packets, streams, bundles, intervals and queries, compared with double precision.

mod arrays;
mod bundles;
mod closed_parts;
mod common;
mod counters;
mod coverage;
mod crossings;
mod exact;
mod exact_scene;
mod far_away;
mod few_rays;
mod instances;
mod intervals;
mod many_trees;
mod memory;
mod nested;
mod oracle;
mod paths;
mod precision;
mod queries;
mod query_packets;
mod resident;
mod robust_rays;
mod slivers;
mod structures;
mod walk;
