//! Workers that serve jobs (being built).
