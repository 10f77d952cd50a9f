//! Embree 3.13 as C declares it: the few calls and layouts that are used, from `embree3/rtcore*.h`. All that is unsafe
//! in this package is here and in `embree_calls/`. The library is opened when it is asked for, so that nothing but its
//! measurements needs it.

mod instances;
mod points;
pub mod surfaces;

pub use instances::resident;

use crate::placed::{Place, Placed};
use crate::scenes::Mesh;
use glam::DAffine3;
use libloading::Library;
use outcrop::math::Bounds;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::ptr;
use std::sync::atomic::{AtomicI64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// `RTC_INVALID_GEOMETRY_ID`.
pub const NONE: u32 = u32::MAX;

/// `RTCRay`.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(16))]
pub struct RtcRay {
    pub org: [f32; 3],
    pub tnear: f32,
    pub dir: [f32; 3],
    pub time: f32,
    pub tfar: f32,
    pub mask: u32,
    pub id: u32,
    pub flags: u32,
}

/// `RTCHit`.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(16))]
pub struct RtcHit {
    pub normal: [f32; 3],
    pub uv: [f32; 2],
    pub prim: u32,
    pub geometry: u32,
    pub instance: u32,
}

/// `RTCRayHit`.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
pub struct RtcRayHit {
    pub ray: RtcRay,
    pub hit: RtcHit,
}

/// `RTCRay4`, `RTCRay8` and `RTCRay16`.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct RtcRays<const N: usize> {
    pub org: [[f32; N]; 3],
    pub tnear: [f32; N],
    pub dir: [[f32; N]; 3],
    pub time: [f32; N],
    pub tfar: [f32; N],
    pub mask: [u32; N],
    pub id: [u32; N],
    pub flags: [u32; N],
}

/// `RTCHit4`, `RTCHit8` and `RTCHit16`. Aligned like what it is in, which C does not need.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct RtcHits<const N: usize> {
    pub normal: [[f32; N]; 3],
    pub uv: [[f32; N]; 2],
    pub prim: [u32; N],
    pub geometry: [u32; N],
    pub instance: [u32; N],
}

/// `RTCRayHit4`, `RTCRayHit8` and `RTCRayHit16`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct RtcRayHits<const N: usize> {
    pub rays: RtcRays<N>,
    pub hits: RtcHits<N>,
}

const _: () = assert!(size_of::<RtcRay>() == 48 && size_of::<RtcHit>() == 32 && size_of::<RtcRayHit>() == 80);
const _: () = assert!(size_of::<RtcRays<4>>() == 192 && size_of::<RtcRayHits<4>>() == 320);
const _: () = assert!(size_of::<RtcRays<8>>() == 384 && size_of::<RtcRayHits<8>>() == 640);
const _: () = assert!(size_of::<RtcRays<16>>() == 768 && size_of::<RtcRayHits<16>>() == 1280);

/// `RTCIntersectContext`; with the member that some builds of the library add at the end.
#[derive(Debug, Clone)]
#[repr(C)]
pub struct Context {
    flags: c_int,
    filter: *const c_void,
    instance: u32,
    min_width_distance_factor: f32,
}

impl Context {
    /// As `rtcInitIntersectContext` sets it, and whether rays are coherent.
    pub fn new(is_coherent: bool) -> Self {
        Self { flags: c_int::from(is_coherent), filter: ptr::null(), instance: NONE, min_width_distance_factor: 0.0 }
    }
}

/// Which of a packet's rays are traced (-1) and which are not (0).
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Valid<const N: usize>(pub [c_int; N]);

type Handle = *mut c_void;
type Monitor = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;
type One = unsafe extern "C" fn(Handle, *mut Context, *mut c_void);
type Stream = unsafe extern "C" fn(Handle, *mut Context, *mut c_void, c_uint, usize);
type Packet = unsafe extern "C" fn(*const c_int, Handle, *mut Context, *mut c_void);
type Bounder = unsafe extern "C" fn(*const BoundsArguments);
type Collided = unsafe extern "C" fn(*mut c_void, *const Collision, c_uint);
type Collide = unsafe extern "C" fn(Handle, Handle, Collided, *mut c_void);
type SharedBuffer = unsafe extern "C" fn(Handle, c_uint, c_uint, c_uint, *const c_void, usize, usize, usize);

macro_rules! calls {
    ($($field:ident, $symbol:literal, $kind:ty;)*) => {
        /// The library's functions.
        struct Calls {
            $($field: $kind,)*
            /// Loaded as long as its functions are here.
            _library: Library,
        }

        impl Calls {
            /// Opened once, and never closed: threads of its own still run when its last device is gone.
            fn get() -> Result<&'static Self, String> {
                static CALLS: OnceLock<Result<Calls, String>> = OnceLock::new();
                CALLS.get_or_init(|| Self::open().map_err(|e| e.to_string())).as_ref().map_err(Clone::clone)
            }

            fn open() -> Result<Self, libloading::Error> {
                // SAFETY: Debian's library has no constructors that need anything of the program.
                let library = unsafe { Library::new("libembree3.so.3") }?;
                // SAFETY: each type is that of the function in the headers of 3.13.
                unsafe { Ok(Self { $($field: *library.get::<$kind>($symbol)?,)* _library: library }) }
            }
        }
    };
}

calls! {
    new_device, b"rtcNewDevice\0", unsafe extern "C" fn(*const c_char) -> Handle;
    release_device, b"rtcReleaseDevice\0", unsafe extern "C" fn(Handle);
    device_error, b"rtcGetDeviceError\0", unsafe extern "C" fn(Handle) -> c_int;
    device_property, b"rtcGetDeviceProperty\0", unsafe extern "C" fn(Handle, c_int) -> isize;
    set_monitor, b"rtcSetDeviceMemoryMonitorFunction\0", unsafe extern "C" fn(Handle, Monitor, *mut c_void);
    new_scene, b"rtcNewScene\0", unsafe extern "C" fn(Handle) -> Handle;
    set_scene_quality, b"rtcSetSceneBuildQuality\0", unsafe extern "C" fn(Handle, c_int);
    set_scene_flags, b"rtcSetSceneFlags\0", unsafe extern "C" fn(Handle, c_int);
    commit_scene, b"rtcCommitScene\0", unsafe extern "C" fn(Handle);
    release_scene, b"rtcReleaseScene\0", unsafe extern "C" fn(Handle);
    new_geometry, b"rtcNewGeometry\0", unsafe extern "C" fn(Handle, c_int) -> Handle;
    set_shared_buffer, b"rtcSetSharedGeometryBuffer\0", SharedBuffer;
    set_geometry_quality, b"rtcSetGeometryBuildQuality\0", unsafe extern "C" fn(Handle, c_int);
    set_tessellation, b"rtcSetGeometryTessellationRate\0", unsafe extern "C" fn(Handle, f32);
    commit_geometry, b"rtcCommitGeometry\0", unsafe extern "C" fn(Handle);
    attach_geometry, b"rtcAttachGeometry\0", unsafe extern "C" fn(Handle, Handle) -> c_uint;
    release_geometry, b"rtcReleaseGeometry\0", unsafe extern "C" fn(Handle);
    set_instanced_scene, b"rtcSetGeometryInstancedScene\0", unsafe extern "C" fn(Handle, Handle);
    set_transform, b"rtcSetGeometryTransform\0", unsafe extern "C" fn(Handle, c_uint, c_int, *const c_void);
    get_geometry, b"rtcGetGeometry\0", unsafe extern "C" fn(Handle, c_uint) -> Handle;
    set_primitives, b"rtcSetGeometryUserPrimitiveCount\0", unsafe extern "C" fn(Handle, c_uint);
    set_user_data, b"rtcSetGeometryUserData\0", unsafe extern "C" fn(Handle, *mut c_void);
    set_bounds, b"rtcSetGeometryBoundsFunction\0", unsafe extern "C" fn(Handle, Bounder, *mut c_void);
    collide, b"rtcCollide\0", Collide;
    point_query, b"rtcPointQuery\0", points::Call;
    intersect, b"rtcIntersect1\0", One;
    occluded, b"rtcOccluded1\0", One;
    intersect_stream, b"rtcIntersect1M\0", Stream;
    occluded_stream, b"rtcOccluded1M\0", Stream;
    intersect4, b"rtcIntersect4\0", Packet;
    intersect8, b"rtcIntersect8\0", Packet;
    intersect16, b"rtcIntersect16\0", Packet;
    occluded4, b"rtcOccluded4\0", Packet;
    occluded8, b"rtcOccluded8\0", Packet;
    occluded16, b"rtcOccluded16\0", Packet;
}

/// How a scene is built.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// `RTCBuildQuality`: low, medium, high.
    pub quality: c_int,
    /// `RTC_SCENE_FLAG_COMPACT`.
    pub is_compact: bool,
    /// Of the build; 0 for all.
    pub threads: usize,
}

/// A committed scene: of one mesh, or of two levels, where the upper one holds instances of scenes of one mesh each.
pub struct Scene {
    calls: &'static Calls,
    device: Handle,
    scene: Handle,
    /// The lower level, scene by scene.
    below: Vec<Handle>,
    bytes: Box<AtomicI64>,
    /// What Embree reads in place.
    shared: Vec<Buffers>,
    surface: Option<surfaces::Shared>,
}

/// The buffers of a mesh that Embree shares.
struct Buffers {
    /// With one vertex more than the mesh: Embree reads 16 bytes at the last one.
    vertices: Vec<[f32; 3]>,
    mesh: Arc<Mesh>,
}

impl Buffers {
    fn of(mesh: &Arc<Mesh>) -> Self {
        Self { vertices: mesh.vertices.iter().copied().chain([[0.0; 3]]).collect(), mesh: Arc::clone(mesh) }
    }
}

// SAFETY: of a committed scene only its size is read and rays are traced, for which Embree takes any thread, several at
// once.
unsafe impl Sync for Scene {}

/// `RTC_DEVICE_PROPERTY_VERSION`, which is major, minor and patch in two decimal digits each.
const VERSION: c_int = 0;

unsafe extern "C" fn monitor(bytes: *mut c_void, change: isize, _is_done: bool) -> bool {
    // SAFETY: what `Scene::new` gave, which goes after the device.
    unsafe { &*bytes.cast::<AtomicI64>() }.fetch_add(change as i64, Relaxed);
    true
}

/// As "3.13.5".
fn version(calls: &Calls, device: Handle) -> String {
    // SAFETY: a live device.
    let version = unsafe { (calls.device_property)(device, VERSION) };
    format!("{}.{}.{}", version / 10000, version / 100 % 100, version % 100)
}

impl Scene {
    /// Builds a scene of one mesh; the error says why there is none.
    pub fn new(mesh: &Arc<Mesh>, options: Options) -> Result<Self, String> {
        let mut scene = Self::empty(options)?;
        scene.shared.push(Buffers::of(mesh));
        scene.commit_mesh(scene.scene, &scene.shared[0], options);
        scene.checked()
    }

    /// Builds a scene of two levels; instances are numbered as the places are.
    pub fn of_placed(placed: &Placed, options: Options) -> Result<Self, String> {
        let scene = Self::of_meshes(&placed.meshes, options)?;
        scene.commit_places(&placed.places, options);
        scene.checked()
    }

    /// Builds the lower level of a scene of two levels. The upper one has no instances yet.
    pub fn of_meshes(meshes: &[Arc<Mesh>], options: Options) -> Result<Self, String> {
        let mut scene = Self::empty(options)?;
        for mesh in meshes {
            scene.shared.push(Buffers::of(mesh));
            // SAFETY: a live device.
            scene.below.push(unsafe { (scene.calls.new_scene)(scene.device) });
        }
        for (&below, buffers) in scene.below.iter().zip(&scene.shared) {
            scene.commit_mesh(below, buffers, options);
        }
        scene.checked()
    }

    /// A device with a scene that is not committed.
    fn empty(options: Options) -> Result<Self, String> {
        let calls = Calls::get()?;
        let config = CString::new(format!("threads={}", options.threads)).expect("no zero in it");
        // SAFETY: a string that ends in zero.
        let device = unsafe { (calls.new_device)(config.as_ptr()) };
        if device.is_null() {
            return Err("Embree does not start".into());
        }
        let bytes = Box::new(AtomicI64::new(0));
        // SAFETY: a live device and a counter that outlives it.
        let scene = unsafe {
            (calls.set_monitor)(device, monitor, ptr::from_ref(&*bytes).cast_mut().cast());
            (calls.new_scene)(device)
        };
        Ok(Self { calls, device, scene, below: Vec::new(), bytes, shared: Vec::new(), surface: None })
    }

    /// The scene, if no call has failed.
    fn checked(self) -> Result<Self, String> {
        // SAFETY: a live device.
        match unsafe { (self.calls.device_error)(self.device) } {
            0 => Ok(self),
            error => Err(format!("Embree cannot build the scene: error {error}")),
        }
    }

    fn commit_mesh(&self, scene: Handle, Buffers { vertices, mesh }: &Buffers, options: Options) {
        const TRIANGLE: c_int = 0;
        const INDEX: c_uint = 0;
        const VERTEX: c_uint = 1;
        const UINT3: c_uint = 0x5003;
        const FLOAT3: c_uint = 0x9003;
        let (c, triangles) = (self.calls, &mesh.triangles);
        self.set(scene, options);
        // SAFETY: live handles; buffers of the stated counts, which stay where they are and as they are while the scene
        // lives.
        unsafe {
            let geometry = (c.new_geometry)(self.device, TRIANGLE);
            (c.set_shared_buffer)(geometry, VERTEX, 0, FLOAT3, vertices.as_ptr().cast(), 0, 12, vertices.len() - 1);
            (c.set_shared_buffer)(geometry, INDEX, 0, UINT3, triangles.as_ptr().cast(), 0, 12, triangles.len());
            (c.set_geometry_quality)(geometry, options.quality);
            (c.commit_geometry)(geometry);
            (c.attach_geometry)(scene, geometry);
            (c.release_geometry)(geometry);
            (c.commit_scene)(scene);
        }
    }

    fn commit_places(&self, places: &[Place], options: Options) {
        const INSTANCE: c_int = 121;
        let c = self.calls;
        self.set(self.scene, options);
        for Place { mesh, world_from_mesh } in places {
            // SAFETY: live handles.
            let geometry = unsafe { (c.new_geometry)(self.device, INSTANCE) };
            // SAFETY: live handles.
            unsafe { (c.set_instanced_scene)(geometry, self.below[*mesh]) };
            self.set_place(geometry, world_from_mesh);
            // SAFETY: live handles; the scene holds the geometry from here on.
            unsafe {
                (c.attach_geometry)(self.scene, geometry);
                (c.release_geometry)(geometry);
            }
        }
        // SAFETY: a live scene, all of whose geometries are committed.
        unsafe { (c.commit_scene)(self.scene) };
    }

    /// Places an instance of this device, and commits it.
    fn set_place(&self, geometry: Handle, world_from_mesh: &DAffine3) {
        const FLOAT3X4_COLUMN_MAJOR: c_int = 0x9234;
        let columns = world_from_mesh.to_cols_array().map(|x| x as f32);
        // SAFETY: a live handle; Embree copies the twelve numbers of the transform.
        unsafe {
            (self.calls.set_transform)(geometry, 0, FLOAT3X4_COLUMN_MAJOR, columns.as_ptr().cast());
            (self.calls.commit_geometry)(geometry);
        }
    }

    /// Quality and flags of a scene.
    fn set(&self, scene: Handle, options: Options) {
        const COMPACT: c_int = 1 << 1;
        // SAFETY: a live scene.
        unsafe {
            (self.calls.set_scene_quality)(scene, options.quality);
            (self.calls.set_scene_flags)(scene, if options.is_compact { COMPACT } else { 0 });
        }
    }

    /// Bytes of the structure alone.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Relaxed).max(0) as u64
    }

    /// As "3.13.5".
    pub fn version(&self) -> String {
        version(self.calls, self.device)
    }

    /// Closest hits, ray by ray.
    pub fn intersect(&self, context: &mut Context, rays: &mut [RtcRayHit]) {
        for ray in rays {
            // SAFETY: a committed scene, and one aligned ray with room for its hit.
            unsafe { (self.calls.intersect)(self.scene, context, ptr::from_mut(ray).cast()) }
        }
    }

    /// Any hits, ray by ray: `tfar` becomes minus infinity.
    pub fn occluded(&self, context: &mut Context, rays: &mut [RtcRay]) {
        for ray in rays {
            // SAFETY: a committed scene, and one aligned ray.
            unsafe { (self.calls.occluded)(self.scene, context, ptr::from_mut(ray).cast()) }
        }
    }

    /// Closest hits of a stream.
    pub fn intersect_stream(&self, context: &mut Context, rays: &mut [RtcRayHit]) {
        let (count, stride) = (rays.len() as c_uint, size_of::<RtcRayHit>());
        // SAFETY: a committed scene, and as many rays as stated, one after the other.
        unsafe { (self.calls.intersect_stream)(self.scene, context, rays.as_mut_ptr().cast(), count, stride) }
    }

    /// Any hits of a stream.
    pub fn occluded_stream(&self, context: &mut Context, rays: &mut [RtcRay]) {
        let (count, stride) = (rays.len() as c_uint, size_of::<RtcRay>());
        // SAFETY: a committed scene, and as many rays as stated, one after the other.
        unsafe { (self.calls.occluded_stream)(self.scene, context, rays.as_mut_ptr().cast(), count, stride) }
    }

    /// Closest hits of a packet of 4, 8 or 16.
    pub fn intersect_packet<const N: usize>(&self, context: &mut Context, valid: &Valid<N>, rays: &mut RtcRayHits<N>) {
        let call = self.of_width::<N>([self.calls.intersect4, self.calls.intersect8, self.calls.intersect16]);
        // SAFETY: a committed scene, and a packet of the call's width with its mask, both aligned to 64 bytes.
        unsafe { call(valid.0.as_ptr(), self.scene, context, ptr::from_mut(rays).cast()) }
    }

    /// Any hits of a packet of 4, 8 or 16.
    pub fn occluded_packet<const N: usize>(&self, context: &mut Context, valid: &Valid<N>, rays: &mut RtcRays<N>) {
        let call = self.of_width::<N>([self.calls.occluded4, self.calls.occluded8, self.calls.occluded16]);
        // SAFETY: a committed scene, and a packet of the call's width with its mask, both aligned to 64 bytes.
        unsafe { call(valid.0.as_ptr(), self.scene, context, ptr::from_mut(rays).cast()) }
    }

    fn of_width<const N: usize>(&self, [four, eight, sixteen]: [Packet; 3]) -> Packet {
        const { assert!(N == 4 || N == 8 || N == 16) };
        match N {
            4 => four,
            8 => eight,
            _ => sixteen,
        }
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: all are live, and this is their last use.
        unsafe {
            (self.calls.release_scene)(self.scene);
            self.below.iter().for_each(|&scene| (self.calls.release_scene)(scene));
            (self.calls.release_device)(self.device);
        }
    }
}

/// `RTCBounds`.
#[repr(C, align(16))]
struct RtcBounds {
    lower: [f32; 3],
    align0: f32,
    upper: [f32; 3],
    align1: f32,
}

/// `RTCBoundsFunctionArguments`.
#[repr(C)]
struct BoundsArguments {
    user: *mut c_void,
    prim: c_uint,
    time_step: c_uint,
    bounds: *mut RtcBounds,
}

/// `RTCCollision`.
#[repr(C)]
struct Collision {
    geometry0: c_uint,
    prim0: c_uint,
    geometry1: c_uint,
    prim1: c_uint,
}

/// Scenes of boxes, the geometry that `rtcCollide` takes, of one thread.
pub struct Boxes {
    calls: &'static Calls,
    device: Handle,
    scenes: Vec<Handle>,
    /// What the scenes' callback reads.
    _boxes: Vec<Vec<Bounds>>,
}

/// Gives Embree the box of a primitive.
unsafe extern "C" fn bound(arguments: *const BoundsArguments) {
    // SAFETY: Embree gives what `Boxes::new` has set, with a primitive of that geometry, and room for its box.
    unsafe {
        let BoundsArguments { user, prim, bounds, .. } = *arguments;
        let one = *user.cast::<Bounds>().add(prim as usize);
        *bounds = RtcBounds { lower: one.min.into(), align0: 0.0, upper: one.max.into(), align1: 0.0 };
    }
}

type Take<'a> = Mutex<&'a mut (dyn FnMut(u32, u32) + Send)>;

unsafe extern "C" fn collided(user: *mut c_void, collisions: *const Collision, count: c_uint) {
    // SAFETY: what `Boxes::collide` gave, which is there until `rtcCollide` returns, and as many pairs as stated.
    let (take, pairs) = unsafe { (&*user.cast::<Take>(), std::slice::from_raw_parts(collisions, count as usize)) };
    let mut take = take.lock().unwrap_or_else(PoisonError::into_inner);
    pairs.iter().for_each(|pair| take(pair.prim0, pair.prim1));
}

impl Boxes {
    /// A scene of each list of boxes; the error says why there is none.
    pub fn new(boxes: Vec<Vec<Bounds>>) -> Result<Self, String> {
        const USER: c_int = 120;
        let calls = Calls::get()?;
        // SAFETY: a string that ends in zero.
        let device = unsafe { (calls.new_device)(c"threads=1".as_ptr()) };
        if device.is_null() {
            return Err("Embree does not start".into());
        }
        let scene = |boxes: &Vec<Bounds>| {
            // SAFETY: live handles, and boxes of the stated count, which stay where they are while the scene lives.
            unsafe {
                let (scene, geometry) = ((calls.new_scene)(device), (calls.new_geometry)(device, USER));
                (calls.set_primitives)(geometry, boxes.len() as c_uint);
                (calls.set_user_data)(geometry, boxes.as_ptr().cast_mut().cast());
                (calls.set_bounds)(geometry, bound, ptr::null_mut());
                (calls.commit_geometry)(geometry);
                (calls.attach_geometry)(scene, geometry);
                (calls.release_geometry)(geometry);
                (calls.commit_scene)(scene);
                scene
            }
        };
        let scenes = boxes.iter().map(scene).collect();
        let all = Self { calls, device, scenes, _boxes: boxes };
        // SAFETY: a live device.
        match unsafe { (calls.device_error)(device) } {
            0 => Ok(all),
            error => Err(format!("Embree cannot build the scenes: error {error}")),
        }
    }

    /// As "3.13.5".
    pub fn version(&self) -> String {
        version(self.calls, self.device)
    }

    /// Calls `take` for each pair of boxes of two scenes that overlap.
    pub fn collide(&self, [a, b]: [usize; 2], take: &mut (dyn FnMut(u32, u32) + Send)) {
        let take: Take = Mutex::new(take);
        // SAFETY: committed scenes; the callback's data is there until the call returns.
        unsafe {
            (self.calls.collide)(self.scenes[a], self.scenes[b], collided, ptr::from_ref(&take).cast_mut().cast());
        }
    }
}

impl Drop for Boxes {
    fn drop(&mut self) {
        // SAFETY: all are live, and this is their last use.
        unsafe {
            self.scenes.iter().for_each(|&scene| (self.calls.release_scene)(scene));
            (self.calls.release_device)(self.device);
        }
    }
}
