//! (scene: being built.)
