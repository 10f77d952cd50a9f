//! The allocator of the C libraries.

use crate::base::reserve::Reserve;
use std::alloc::System;

#[global_allocator]
static ALLOCATOR: Reserve = Reserve(System);
