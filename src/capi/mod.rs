//! (capi: being built.)
