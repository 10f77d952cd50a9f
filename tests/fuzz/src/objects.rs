//! The live handles of a sequence of C calls, and the memory that the host lends to the library.

use arbitrary::{Result, Unstructured};
use outcrop::capi::build::{oc_build_release, oc_build_retain};
use outcrop::capi::context::{oc_context_release, oc_context_retain};
use outcrop::capi::frame::{oc_frame_release, oc_frame_retain};
use outcrop::capi::geometry::{oc_part_reader_release, oc_part_reader_retain};
use outcrop::capi::job::{oc_job_release, oc_job_retain};
use outcrop::capi::model::{oc_model_release, oc_model_retain};
use outcrop::capi::pixels::{oc_mapping_release, oc_mapping_retain};
use outcrop::capi::scene::{oc_scene_release, oc_scene_retain};
use outcrop::capi::status::{OC_STATUS_OK, oc_status};
use std::any::Any;
use std::ffi::{CString, c_char, c_void};
use std::ptr::null_mut;

/// A kind of handles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `oc_context`
    Context,
    /// `oc_build`
    Build,
    /// `oc_job`
    Job,
    /// `oc_model`
    Model,
    /// `oc_scene`
    Scene,
    /// `oc_frame`
    Frame,
    /// `oc_mapping`
    Mapping,
    /// `oc_part_reader`
    PartReader,
}

/// Most objects at a time: contexts take the most memory.
const MOST: usize = 12;

/// Handles, each as often as there are references to it, and the memory that they may use. The memory is returned
/// last.
#[derive(Default)]
pub struct Objects {
    handles: Vec<(Kind, *mut c_void)>,
    kept: Vec<Box<dyn Any>>,
}

impl Objects {
    /// A handle of this kind, or sometimes NULL.
    pub fn any(&self, kind: Kind, u: &mut Unstructured) -> Result<*mut c_void> {
        let some: Vec<_> = self.handles.iter().filter(|handle| handle.0 == kind).collect();
        Ok(if some.is_empty() || u.ratio(1, 30)? { null_mut() } else { u.choose(&some)?.1 })
    }

    /// Adds a handle.
    pub fn add(&mut self, kind: Kind, handle: *mut c_void) {
        assert!(!handle.is_null());
        self.handles.push((kind, handle));
        if self.handles.len() > MOST {
            let (kind, handle) = self.handles.remove(0);
            release(kind, handle);
        }
    }

    /// Calls a function that makes an object, and adds it. The function writes a handle exactly if it succeeds.
    pub fn made<T>(&mut self, kind: Kind, make: impl FnOnce(*mut *mut T) -> oc_status) {
        let mut out = null_mut();
        let status = make(&raw mut out);
        assert_eq!(status == OC_STATUS_OK, !out.is_null(), "status {status} and handle {out:?}");
        if status == OC_STATUS_OK {
            self.add(kind, out.cast());
        }
    }

    /// Retains a handle: there is one reference more.
    pub fn retain(&mut self, u: &mut Unstructured) -> Result<()> {
        if !self.handles.is_empty() {
            let (kind, handle) = *u.choose(&self.handles)?;
            // SAFETY: a live handle of this kind.
            unsafe {
                match kind {
                    Kind::Context => oc_context_retain(handle.cast()),
                    Kind::Build => oc_build_retain(handle.cast()),
                    Kind::Job => oc_job_retain(handle.cast()),
                    Kind::Model => oc_model_retain(handle.cast()),
                    Kind::Scene => oc_scene_retain(handle.cast()),
                    Kind::Frame => oc_frame_retain(handle.cast()),
                    Kind::Mapping => oc_mapping_retain(handle.cast()),
                    Kind::PartReader => oc_part_reader_retain(handle.cast()),
                }
            }
            self.add(kind, handle);
        }
        Ok(())
    }

    /// Releases a handle.
    pub fn release(&mut self, u: &mut Unstructured) -> Result<()> {
        if !self.handles.is_empty() {
            let (kind, handle) = self.handles.swap_remove(u.choose_index(self.handles.len())?);
            release(kind, handle);
        }
        Ok(())
    }

    /// Releases all handles in some order, then the memory.
    pub fn release_all(&mut self, order: u64) {
        let mut order = order;
        while !self.handles.is_empty() {
            let (kind, handle) = self.handles.swap_remove(order as usize % self.handles.len());
            release(kind, handle);
            order = order.rotate_right(7);
        }
        self.kept.clear();
    }

    /// Keeps a value until all objects are released.
    pub fn keep<T: 'static>(&mut self, value: T) -> *mut T {
        self.keep_all(vec![value])
    }

    /// Keeps an array until all objects are released.
    pub fn keep_all<T: 'static>(&mut self, values: Vec<T>) -> *mut T {
        let mut values = values;
        let pointer = values.as_mut_ptr();
        self.kept.push(Box::new(values));
        pointer
    }

    /// Keeps a string until all objects are released.
    pub fn keep_text(&mut self, text: CString) -> *const c_char {
        let pointer = text.as_ptr();
        self.kept.push(Box::new(text));
        pointer
    }
}

fn release(kind: Kind, handle: *mut c_void) {
    // SAFETY: a live handle of this kind, which is not used afterwards as often as it was retained.
    unsafe {
        match kind {
            Kind::Context => oc_context_release(handle.cast()),
            Kind::Build => oc_build_release(handle.cast()),
            Kind::Job => oc_job_release(handle.cast()),
            Kind::Model => oc_model_release(handle.cast()),
            Kind::Scene => oc_scene_release(handle.cast()),
            Kind::Frame => oc_frame_release(handle.cast()),
            Kind::Mapping => oc_mapping_release(handle.cast()),
            Kind::PartReader => oc_part_reader_release(handle.cast()),
        }
    }
}
