//! Scenes of surfaces: grids of vertices, and Catmull-Clark cages that Embree dices when it builds.

use super::{Handle, Options, Scene};
use std::ffi::{c_int, c_uint, c_void};

/// `RTCGrid`: vertices in rows.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Grid {
    pub first: u32,
    /// Vertices from a row to the next.
    pub stride: u32,
    pub width: u16,
    pub height: u16,
}

const _: () = assert!(size_of::<Grid>() == 12);

/// Grids that Embree reads in place.
#[derive(Debug, Clone, Default)]
pub struct Grids {
    pub vertices: Vec<[f32; 3]>,
    pub grids: Vec<Grid>,
}

impl Grids {
    /// Bytes of vertices and grids.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&*self.vertices) + size_of_val(&*self.grids)) as u64
    }
}

/// A cage that Embree reads in place.
#[derive(Debug, Clone, Default)]
pub struct Cage {
    pub vertices: Vec<[f32; 3]>,
    pub sizes: Vec<u32>,
    pub indices: Vec<u32>,
    pub creases: Vec<[u32; 2]>,
    pub crease_weights: Vec<f32>,
    pub corners: Vec<u32>,
    pub corner_weights: Vec<f32>,
}

impl Cage {
    /// Bytes of all arrays.
    pub fn bytes(&self) -> u64 {
        let edges = size_of_val(&*self.creases) + size_of_val(&*self.crease_weights);
        let corners = size_of_val(&*self.corners) + size_of_val(&*self.corner_weights);
        let faces = size_of_val(&*self.sizes) + size_of_val(&*self.indices);
        (size_of_val(&*self.vertices) + faces + edges + corners) as u64
    }
}

/// What a scene of a surface keeps, because Embree reads it in place.
pub enum Shared {
    Grids(Grids),
    Cage(Cage),
}

/// `RTCBufferType`.
#[derive(Clone, Copy)]
enum Kind {
    Index = 0,
    Vertex = 1,
    Grid = 8,
    Face = 16,
    Crease = 18,
    CreaseWeight = 19,
    Corner = 20,
    CornerWeight = 21,
}

/// `RTCFormat`.
const UINT: c_uint = 0x5001;
const UINT2: c_uint = 0x5002;
const FLOAT: c_uint = 0x9001;
const FLOAT3: c_uint = 0x9003;
const GRID: c_uint = 0xA001;

impl Scene {
    /// Builds a scene of grids.
    pub fn of_grids(mut grids: Grids, options: Options) -> Result<Self, String> {
        const TYPE: c_int = 2;
        // Embree reads 16 bytes at the last vertex.
        let count = grids.vertices.len();
        grids.vertices.push([0.0; 3]);
        let mut scene = Self::empty(options)?;
        scene.surface = Some(Shared::Grids(grids));
        let Some(Shared::Grids(Grids { vertices, grids })) = &scene.surface else { unreachable!() };
        // SAFETY: a live device.
        let geometry = unsafe { (scene.calls.new_geometry)(scene.device, TYPE) };
        scene.share(geometry, Kind::Vertex, FLOAT3, &vertices[..count]);
        scene.share(geometry, Kind::Grid, GRID, grids);
        scene.commit_surface(geometry, options);
        scene.checked()
    }

    /// Builds a scene of a cage with `rate` segments along each side of a face.
    pub fn of_cage(mut cage: Cage, rate: f32, options: Options) -> Result<Self, String> {
        const TYPE: c_int = 8;
        let count = cage.vertices.len();
        cage.vertices.push([0.0; 3]);
        let mut scene = Self::empty(options)?;
        scene.surface = Some(Shared::Cage(cage));
        let Some(Shared::Cage(cage)) = &scene.surface else { unreachable!() };
        // SAFETY: a live device.
        let geometry = unsafe { (scene.calls.new_geometry)(scene.device, TYPE) };
        scene.share(geometry, Kind::Vertex, FLOAT3, &cage.vertices[..count]);
        scene.share(geometry, Kind::Face, UINT, &cage.sizes);
        scene.share(geometry, Kind::Index, UINT, &cage.indices);
        scene.share(geometry, Kind::Crease, UINT2, &cage.creases);
        scene.share(geometry, Kind::CreaseWeight, FLOAT, &cage.crease_weights);
        scene.share(geometry, Kind::Corner, UINT, &cage.corners);
        scene.share(geometry, Kind::CornerWeight, FLOAT, &cage.corner_weights);
        // SAFETY: a live handle.
        unsafe { (scene.calls.set_tessellation)(geometry, rate) };
        scene.commit_surface(geometry, options);
        scene.checked()
    }

    /// Lends items of a geometry to Embree; none if there are none.
    fn share<T>(&self, geometry: Handle, kind: Kind, format: c_uint, items: &[T]) {
        if items.is_empty() {
            return;
        }
        let data: *const c_void = items.as_ptr().cast();
        // SAFETY: a live handle; as many items of that format as stated, which stay where they are and as they are
        // while the scene lives.
        unsafe {
            let share = self.calls.set_shared_buffer;
            share(geometry, kind as c_uint, 0, format, data, 0, size_of::<T>(), items.len());
        }
    }

    fn commit_surface(&self, geometry: Handle, options: Options) {
        let c = self.calls;
        self.set(self.scene, options);
        // SAFETY: live handles, and a geometry all of whose buffers are set.
        unsafe {
            (c.set_geometry_quality)(geometry, options.quality);
            (c.commit_geometry)(geometry);
            (c.attach_geometry)(self.scene, geometry);
            (c.release_geometry)(geometry);
            (c.commit_scene)(self.scene);
        }
    }
}
