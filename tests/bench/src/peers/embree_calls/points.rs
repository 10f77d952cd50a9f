//! Nearest points: `rtcPointQuery` and its layouts, from `embree3/rtcore_common.h`.

use super::{Handle, NONE, Scene};
use std::ffi::{c_uint, c_void};
use std::ptr;

/// `RTCPointQuery`.
#[repr(C, align(16))]
pub struct Query {
    at: [f32; 3],
    time: f32,
    radius: f32,
}

/// `RTCPointQueryContext`, of one level of instances.
#[repr(C, align(16))]
pub struct Context {
    transforms: [[f32; 16]; 2],
    instance: u32,
    depth: u32,
}

/// `RTCPointQueryFunctionArguments`.
#[repr(C, align(16))]
pub struct Arguments {
    query: *mut Query,
    user: *mut c_void,
    prim: c_uint,
    geometry: c_uint,
    context: *mut Context,
    scale: f32,
}

const _: () = assert!(size_of::<Query>() == 32 && size_of::<Context>() == 144 && size_of::<Arguments>() == 48);

pub type Visit = unsafe extern "C" fn(*mut Arguments) -> bool;
pub type Call = unsafe extern "C" fn(Handle, *mut Query, *mut Context, Visit, *mut c_void) -> bool;

/// Gives a primitive to the closure; returns true if the radius is less than before, as Embree asks.
unsafe extern "C" fn visit<F: FnMut(u32, f32) -> f32>(arguments: *mut Arguments) -> bool {
    // SAFETY: Embree gives the query and the data of `Scene::around`, which are there until that returns, and nothing
    // else refers to them meanwhile.
    let (query, nearer, prim) = unsafe {
        let (query, user, prim) = ((*arguments).query, (*arguments).user, (*arguments).prim);
        (&mut *query, &mut *user.cast::<F>(), prim)
    };
    let radius = nearer(prim, query.radius);
    let is_less = radius < query.radius;
    query.radius = radius;
    is_less
}

impl Scene {
    /// Visits the primitives of a scene of one mesh that may be within a radius of a point, at first any. `nearer`
    /// takes a primitive and the radius, and returns the radius from there on, which must not be greater.
    pub fn around<F: FnMut(u32, f32) -> f32>(&self, at: [f32; 3], nearer: &mut F) {
        let mut query = Query { at, time: 0.0, radius: f32::INFINITY };
        let mut context = Context { transforms: [[0.0; 16]; 2], instance: NONE, depth: 0 };
        // SAFETY: a committed scene; an aligned query and context; the callback is the one for this closure, which is
        // there until the call returns.
        unsafe {
            (self.calls.point_query)(self.scene, &mut query, &mut context, visit::<F>, ptr::from_mut(nearer).cast());
        }
    }
}
