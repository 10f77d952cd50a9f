//! (geom: being built.)
