//! The upper level of a scene of two levels: instances that are added, moved and forgotten.

use super::{Options, Scene};
use crate::placed::Place;
use glam::DAffine3;
use libloading::Library;
use std::ffi::{c_int, c_uint};

impl Scene {
    /// Forgets all instances.
    pub fn clear(&mut self) {
        // SAFETY: the scene and the device are live, and no other code has the scene.
        unsafe {
            (self.calls.release_scene)(self.scene);
            self.scene = (self.calls.new_scene)(self.device);
        }
    }

    /// Adds instances to a scene that has none, numbered as the places are, and commits it.
    pub fn place(&mut self, places: &[Place], options: Options) {
        self.commit_places(places, options);
    }

    /// Moves instances, and commits the scene.
    pub fn shift(&mut self, moved: &[(usize, DAffine3)]) {
        for (instance, world_from_mesh) in moved {
            // SAFETY: a live scene, and the number of one of its instances.
            let geometry = unsafe { (self.calls.get_geometry)(self.scene, *instance as c_uint) };
            self.set_place(geometry, world_from_mesh);
        }
        // SAFETY: a live scene, all of whose geometries are committed.
        unsafe { (self.calls.commit_scene)(self.scene) };
    }
}

/// Bytes of this program that are in memory, without what was freed; `None` where the system does not tell.
pub fn resident() -> Option<u64> {
    const PAGE: u64 = 4096;
    // SAFETY: the library of this program's allocator, which is loaded already.
    let library = unsafe { Library::new("libc.so.6") }.ok()?;
    // SAFETY: the type is that of glibc's function.
    let trim = unsafe { library.get::<unsafe extern "C" fn(usize) -> c_int>(b"malloc_trim\0") }.ok()?;
    // SAFETY: the call takes any number, and gives back only memory that the C library does not use.
    unsafe { trim(0) };
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(text.split(' ').nth(1)?.parse::<u64>().ok()? * PAGE)
}
