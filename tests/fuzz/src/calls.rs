//! Sequences of C calls on live handles, with hostile numbers and structs: a status each, never one that says that the
//! library is at fault, and all memory is returned at the end (AddressSanitizer looks for leaks).

use super::objects::{Kind, Objects};
use super::{base_models, builds, files, geometry_calls, seeds};
use arbitrary::{Result, Unstructured};
use outcrop::capi::build::*;
use outcrop::capi::contents::*;
use outcrop::capi::context::*;
use outcrop::capi::frame::*;
use outcrop::capi::job::*;
use outcrop::capi::looks::*;
use outcrop::capi::model::*;
use outcrop::capi::overlap::*;
use outcrop::capi::pixels::*;
use outcrop::capi::prefetch::*;
use outcrop::capi::query::*;
use outcrop::capi::report::*;
use outcrop::capi::scene::*;
use outcrop::capi::status::*;
use outcrop::capi::triangles::*;
use outcrop::capi::version::*;
use outcrop::capi::view::*;
use std::collections::VecDeque;
use std::ffi::{CStr, CString, c_char, c_void};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Most calls of an input.
const CALLS: usize = 60;

/// The target.
pub fn run(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let mut objects = Objects::default();
    for _ in 0..CALLS {
        if u.is_empty() || call(&mut u, &mut objects).is_err() {
            break;
        }
    }
    // In an order of the input's: each object keeps what it needs.
    let order = u.arbitrary().unwrap_or(0);
    objects.release_all(order);
}

/// Checks a status and the message that belongs to it.
pub(super) fn fine(status: oc_status) -> oc_status {
    let message = oc_last_error();
    // SAFETY: the message of the last call in this thread, which ends with 0.
    let text = unsafe { CStr::from_ptr(message) }.to_str().expect("UTF-8");
    assert!(status != OC_STATUS_INTERNAL && status != OC_STATUS_POISONED, "status {status}: {text}");
    assert!(status == OC_STATUS_OK || !text.is_empty(), "status {status} without a message");
    status
}

/// Checks a status that does not matter otherwise.
pub(super) fn ok(status: oc_status) {
    fine(status);
}

/// A struct of the header: zeros, with its size.
pub(super) fn init<T: Copy>() -> T {
    let mut value = std::mem::MaybeUninit::<T>::zeroed();
    // SAFETY: all structs of the header begin with a u32, and zeros are a valid value of each (`Sized32`).
    unsafe {
        value.as_mut_ptr().cast::<u32>().write(size_of::<T>() as u32);
        value.assume_init()
    }
}

/// A pointer to the struct, or NULL; sometimes its size is wrong.
pub(super) fn given<T>(u: &mut Unstructured, value: &mut T) -> Result<*mut T> {
    Ok(match u.int_in_range(0..=30)? {
        0 => null_mut(),
        1 => {
            let size: u32 = u.int_in_range(0..=size_of::<T>() as u32 + 8)?;
            // SAFETY: all structs of the header begin with a u32, their size. A smaller one is a struct of an older
            // header, and a larger one is refused.
            unsafe { (&raw mut *value).cast::<u32>().write(size) };
            value
        }
        _ => value,
    })
}

pub(super) fn double(u: &mut Unstructured) -> Result<f64> {
    builds::coordinate(u, 1.0, 0.0)
}

fn float(u: &mut Unstructured) -> Result<f32> {
    Ok(if u.ratio(3, 4)? { f32::from(u.int_in_range::<u8>(0..=8)?) / 8.0 } else { double(u)? as f32 })
}

pub(super) fn doubles<const N: usize>(u: &mut Unstructured) -> Result<[f64; N]> {
    let mut all = [0.0; N];
    for x in &mut all {
        *x = double(u)?;
    }
    Ok(all)
}

/// A small number, or any.
pub(super) fn small(u: &mut Unstructured, most: u32) -> Result<u32> {
    if u.ratio(15, 16)? { u.int_in_range(0..=most) } else { u.arbitrary() }
}

pub(super) fn id(u: &mut Unstructured) -> Result<u64> {
    Ok(if u.ratio(7, 8)? { 100 + u64::from(u.int_in_range::<u8>(0..=4)?) } else { u.arbitrary()? })
}

/// A file that exists, one that does not, or what is no path.
fn path(u: &mut Unstructured, o: &mut Objects) -> Result<*const c_char> {
    let folder = files::path("");
    let name: &[u8] = match u.int_in_range(0..=8)? {
        0 => return Ok(null()),
        1 => b"",
        2 => b"\xff\xfe",
        3 => b"none/at/all.oc",
        4 | 5 => b"built.oc",
        6 => b"input.ply",
        7 => b"input.obj",
        _ => b"base.oc",
    };
    if name == b"input.ply" {
        std::fs::write(folder.join("input.ply"), &seeds::ply()[0]).expect("an input");
    } else if name == b"input.obj" {
        std::fs::write(folder.join("input.obj"), &seeds::obj()[0]).expect("an input");
    } else if name == b"base.oc" {
        std::fs::write(folder.join("base.oc"), base_models::bytes(0)).expect("an input");
    }
    let whole = [folder.as_os_str().as_encoded_bytes(), name].concat();
    Ok(o.keep_text(CString::new(if name.is_empty() { Vec::new() } else { whole }).unwrap_or_default()))
}

/// Where a host's model comes from.
struct Io {
    bytes: &'static [u8],
    /// Reads up to this one succeed.
    fails_at: u32,
    reads: AtomicU32,
}

/// The sources of this input and of those before it. A source must outlive the last handle until it is closed, which
/// another thread may do a moment later.
static SOURCES: Mutex<VecDeque<Box<Io>>> = Mutex::new(VecDeque::new());

/// Number of sources that are kept.
const SOURCES_KEPT: usize = 4096;

/// # Safety
/// `user` is an [`Io`], and `buffer` has room for `bytes`.
unsafe extern "C" fn read_at(user: *mut c_void, offset: u64, buffer: *mut c_void, bytes: u64) -> u32 {
    // SAFETY: the function's own contract; `SOURCES` keeps the `Io` long enough.
    let io = unsafe { &*user.cast::<Io>() };
    if io.reads.fetch_add(1, Relaxed) >= io.fails_at {
        return 5;
    }
    let Some(from) = io.bytes.get(offset as usize..(offset + bytes) as usize) else { return 1 };
    // SAFETY: the function's own contract.
    unsafe { buffer.cast::<u8>().copy_from_nonoverlapping(from.as_ptr(), from.len()) };
    0
}

fn io(u: &mut Unstructured) -> Result<oc_io> {
    let bytes = base_models::bytes(u.int_in_range(0..=base_models::COUNT - 1)?);
    let fails_at = if u.ratio(1, 4)? { u.int_in_range(0..=12)? } else { u32::MAX };
    let mut io = Box::new(Io { bytes, fails_at, reads: 0.into() });
    let user = (&raw mut *io).cast();
    let mut sources = SOURCES.lock().unwrap_or_else(PoisonError::into_inner);
    sources.push_back(io);
    if sources.len() > SOURCES_KEPT {
        sources.pop_front();
    }
    let size = if u.ratio(1, 16)? { u.arbitrary()? } else { bytes.len() as u64 };
    Ok(oc_io { size, read_at: if u.ratio(1, 30)? { None } else { Some(read_at) }, user, ..init() })
}

pub(super) fn camera(u: &mut Unstructured) -> Result<oc_camera> {
    let kind = small(u, 1)?;
    let (eye, at) = if u.arbitrary()? { ([4.0, 3.0, 2.0], [0.0; 3]) } else { (doubles(u)?, doubles(u)?) };
    let up = if u.arbitrary()? { [0.0; 3] } else { doubles(u)? };
    Ok(oc_camera {
        kind,
        eye,
        at,
        up,
        fov_y: if u.arbitrary()? { 0.0 } else { double(u)? },
        height: double(u)?,
        ..init()
    })
}

fn rays(u: &mut Unstructured) -> Result<Vec<oc_ray>> {
    (0..u.int_in_range(0..=40)?)
        .map(|_| {
            let direction = if u.arbitrary()? { [1.0, -0.5, 0.25] } else { [float(u)?, float(u)?, float(u)?] };
            let (t_min, t_max) = if u.arbitrary()? { (0.0, 0.0) } else { (double(u)?, double(u)?) };
            let (cone_a, cone_b) = if u.arbitrary()? { (0.0, 0.0) } else { (float(u)?, float(u)?) };
            Ok(oc_ray { origin: doubles(u)?, t_min, t_max, direction, cone_a, cone_b, mask: small(u, 1)? })
        })
        .collect()
}

/// A query over rays that the objects keep, and their number.
pub(super) fn query(u: &mut Unstructured, o: &mut Objects) -> Result<(oc_query, usize)> {
    let rays = rays(u)?;
    let count = rays.len();
    let rays = o.keep_all(rays);
    let (want, flags) = (small(u, 511)?, small(u, 3)?);
    let stride = if u.ratio(7, 8)? { 0 } else { *u.choose(&[1, size_of::<oc_ray>() as u64])? };
    Ok((oc_query { want, flags, rays, count: count as u64, stride, ..init() }, count))
}

fn look(u: &mut Unstructured) -> Result<oc_look> {
    Ok(oc_look { flags: small(u, 7)?, colour: [float(u)?, float(u)?, float(u)?, float(u)?], ..init() })
}

/// One call. Pointers are to memory that lives until all objects are released.
fn call(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    let group = u.int_in_range(0..=12)?;
    // SAFETY: handles are live or NULL, structs are initialised, arrays have as many elements as is said, and what
    // background work reads or writes is kept until all objects are released.
    unsafe {
        match group {
            0 => contexts(u, o),
            1 | 2 => build(u, o),
            3 => jobs(u, o),
            4 => models(u, o),
            5 | 6 => scenes(u, o),
            7 => queries(u, o),
            8 | 9 => frames(u, o),
            10 => geometry_calls::views(u, o),
            _ => geometry_calls::geometry(u, o),
        }
    }
}

/// # Safety
/// See [`call`]; so for the functions below.
unsafe fn contexts(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract.
    unsafe {
        match u.int_in_range(0..=5)? {
            0 | 1 => {
                let mut desc = oc_context_desc {
                    threads: if u.ratio(1, 8)? { small(u, 2)? } else { 0 },
                    memory_budget: if u.ratio(1, 8)? { u.arbitrary()? } else { 24 << 20 },
                    instruction_set: small(u, 3)?,
                    flags: small(u, 1)?,
                    ..init()
                };
                // Not more threads than a machine takes.
                desc.threads = if desc.threads > 2 { 9999 } else { desc.threads };
                let version = if u.ratio(1, 20)? { u.arbitrary()? } else { OC_HEADER_VERSION };
                let desc = given(u, &mut desc)?;
                // NULL means all defaults, with a budget that is this machine's.
                o.made(Kind::Context, |out: *mut *mut oc_context| fine(oc_context_create(version, desc, out)));
            }
            2 => {
                let mut did = 0;
                fine(oc_context_step(o.any(Kind::Context, u)?.cast(), &raw mut did));
            }
            3 => {
                let mut value = 0;
                fine(oc_context_property(o.any(Kind::Context, u)?.cast(), small(u, 9)?, &raw mut value));
            }
            4 => o.retain(u)?,
            _ => o.release(u)?,
        }
    }
    Ok(())
}

/// # Safety
/// See [`call`].
unsafe fn build(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract.
    unsafe {
        let build: *mut oc_build = o.any(Kind::Build, u)?.cast();
        match u.int_in_range(0..=9)? {
            0 => {
                let mut desc = oc_build_desc {
                    structure: small(u, 1)?,
                    memory_budget: if u.ratio(1, 4)? { u.arbitrary()? } else { 0 },
                    metres_per_unit: if u.ratio(1, 4)? { double(u)? } else { 0.0 },
                    up: small(u, 3)?,
                    splits: small(u, 2)?,
                    threads: small(u, 2)?.min(2),
                    crease_angle: if u.ratio(1, 2)? { float(u)? * 90.0 } else { 0.0 },
                    ..init()
                };
                let (context, desc) = (o.any(Kind::Context, u)?, given(u, &mut desc)?);
                o.made(Kind::Build, |out| fine(oc_build_create(context.cast(), desc, out)));
            }
            1 => ok(oc_build_add_file(build, path(u, o)?)),
            2 => {
                let mut material = oc_material {
                    colour: [float(u)?, float(u)?, float(u)?],
                    opacity: float(u)?,
                    metalness: float(u)?,
                    roughness: float(u)?,
                    ..init()
                };
                let mut out = 0;
                fine(oc_build_add_material(build, given(u, &mut material)?, &raw mut out));
            }
            3 | 4 => {
                let name = if u.arbitrary()? { null() } else { path(u, o)? };
                let mut part = oc_part { material: small(u, 2)?, id: id(u)?, parent: id(u)?, name, ..init() };
                part.has_parent = small(u, 1)?;
                fine(oc_build_add_part(build, given(u, &mut part)?));
            }
            5 => {
                let mut out = 0;
                fine(oc_build_add_shared_mesh(build, small(u, 3)?, &raw mut out));
            }
            6 => {
                let matrix: [f64; 12] = if u.arbitrary()? { doubles(u)? } else { IDENTITY };
                fine(oc_build_add_instance(build, small(u, 2)?, id(u)?, matrix.as_ptr()));
            }
            7 | 8 => {
                let (mut soup, _kept) = triangles(u)?;
                fine(oc_build_add_triangles(build, given(u, &mut soup)?));
            }
            _ => {
                let path = path(u, o)?;
                o.made(Kind::Job, |out| fine(oc_build_start(build, path, out)));
            }
        }
    }
    Ok(())
}

const IDENTITY: [f64; 12] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

type Arrays = (Vec<f64>, Vec<u64>, Vec<f32>);

/// Triangles with their arrays.
fn triangles(u: &mut Unstructured) -> Result<(oc_triangles, Arrays)> {
    let corners = 3 * u.int_in_range(0..=5usize)? + usize::from(u.ratio(1, 16)?);
    let positions = (0..3 * corners).map(|_| double(u)).collect::<Result<Vec<f64>>>()?;
    let (scalar, index) = (small(u, 1)?, small(u, 2)?);
    let most = if u.ratio(1, 16)? { u64::MAX } else { corners as u64 };
    let indices = (0..6).map(|_| u.int_in_range(0..=most)).collect::<Result<Vec<u64>>>()?;
    let three = [float(u)?, float(u)?, float(u)?];
    let turned = |i: usize| if i % 4 == 3 { -three[i % 3] } else { three[i % 3] };
    let colours: Vec<f32> = (0..3 * corners.max(6)).map(turned).collect();
    let mut soup = oc_triangles {
        mesh: small(u, 1)?,
        part: if u.arbitrary()? { id(u)? } else { small(u, 2)?.into() },
        positions: positions.as_ptr().cast(),
        position_count: corners as u64,
        scalar,
        index,
        ..init()
    };
    if index != 0 {
        // As 32-bit numbers these are zeros between, but for large ones.
        (soup.indices, soup.index_count) = (indices.as_ptr().cast(), *u.choose(&[0, 3, 6, 4])?);
    }
    if u.arbitrary()? {
        soup.colours = colours.as_ptr();
    }
    if u.arbitrary()? {
        soup.normals = colours.as_ptr();
    }
    if u.ratio(1, 4)? {
        soup.position_colours = colours.as_ptr();
    }
    Ok((soup, (positions, indices, colours)))
}

/// # Safety
/// See [`call`].
unsafe fn jobs(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract.
    unsafe {
        let job: *mut oc_job = o.any(Kind::Job, u)?.cast();
        let mut progress: oc_progress = init();
        match u.int_in_range(0..=6)? {
            0 => ok(oc_job_poll(job, given(u, &mut progress)?)),
            1 | 2 => ok(oc_job_wait(job, *u.choose(&[0, 1, 20, OC_FOREVER])?, given(u, &mut progress)?)),
            3 => ok(oc_job_cancel(job)),
            4 => {
                o.made(Kind::Model, |out| fine(oc_job_model(job, out)));
            }
            5 => ok(oc_job_build_report(job, given(u, &mut init())?)),
            _ => {
                let mut text = null();
                fine(oc_job_build_note(job, small(u, 2)?, &raw mut text));
            }
        }
        assert!(progress.error != OC_STATUS_INTERNAL, "a job failed by a defect");
    }
    Ok(())
}

/// # Safety
/// See [`call`].
unsafe fn models(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract.
    unsafe {
        let (context, model) = (o.any(Kind::Context, u)?, o.any(Kind::Model, u)?.cast::<oc_model>());
        match u.int_in_range(0..=7)? {
            0 | 1 => {
                let mut io = io(u)?;
                let io = given(u, &mut io)?;
                o.made(Kind::Model, |out| fine(oc_model_open_io(context.cast(), io, out)));
            }
            2 => {
                let path = path(u, o)?;
                o.made(Kind::Model, |out| fine(oc_model_open(context.cast(), path, out)));
            }
            3 => {
                let mut io = io(u)?;
                let (io, path) = if u.arbitrary()? { (given(u, &mut io)?, null()) } else { (null_mut(), path(u, o)?) };
                o.made(Kind::Job, |out| fine(oc_model_load(context.cast(), path, io, out)));
            }
            4 => ok(oc_model_get_info(model, given(u, &mut init())?)),
            5 => ok(oc_model_get_part(model, small(u, 6)?, given(u, &mut init())?)),
            6 => {
                let mut index = 0;
                fine(oc_model_find_part(model, id(u)?, &raw mut index));
            }
            _ => ok(oc_model_get_view(model, small(u, 4)?, given(u, &mut init())?)),
        }
    }
    Ok(())
}

/// # Safety
/// See [`call`].
unsafe fn scenes(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract.
    unsafe {
        let scene: *mut oc_scene = o.any(Kind::Scene, u)?.cast();
        let instance = u64::from(small(u, 3)?);
        let matrix: [f64; 12] = if u.ratio(1, 4)? { doubles(u)? } else { IDENTITY };
        let matrix = if u.ratio(1, 4)? { null() } else { matrix.as_ptr() };
        match u.int_in_range(0..=16)? {
            0 => {
                let context = o.any(Kind::Context, u)?;
                o.made(Kind::Scene, |out| fine(oc_scene_create(context.cast(), out)));
            }
            1..=3 => {
                let model = o.any(Kind::Model, u)?;
                fine(oc_scene_add_instance(scene, model.cast(), instance, matrix));
            }
            4 => ok(oc_scene_remove_instance(scene, instance)),
            5 => ok(oc_scene_set_transform(scene, instance, matrix)),
            6 => ok(oc_scene_set_instance_mask(scene, instance, u.arbitrary()?)),
            7 => {
                let mut look = look(u)?;
                ok(oc_scene_set_instance_look(scene, instance, given(u, &mut look)?));
            }
            8 => {
                let mut look = look(u)?;
                ok(oc_scene_set_part_look(scene, instance, id(u)?, given(u, &mut look)?));
            }
            9 => ok(oc_scene_clear_part_looks(scene, instance)),
            10 => {
                let light = oc_light {
                    vector: doubles(u)?,
                    colour: [float(u)?, float(u)?, float(u)?],
                    intensity: float(u)?,
                    kind: small(u, 2)?,
                    shadows: small(u, 1)?,
                };
                let lights = vec![light; u.int_in_range(0..=3)?];
                fine(oc_scene_set_lights(scene, lights.as_ptr(), lights.len() as u64, 0));
            }
            11 => {
                let (bottom, top) = ([float(u)?; 4], [float(u)?, 0.5, 0.25, 1.0]);
                fine(oc_scene_set_background(scene, given(u, &mut oc_background { bottom, top, ..init() })?));
            }
            12 => {
                let parts = (0..u.int_in_range(0..=6)?).map(|_| id(u)).collect::<Result<Vec<u64>>>()?;
                let (mut look, flags, count) = (look(u)?, small(u, 1)?, parts.len() as u64);
                let look = given(u, &mut look)?;
                ok(oc_scene_set_parts_look(scene, instance, parts.as_ptr(), count, flags, look));
            }
            13 => {
                let parts = (0..u.int_in_range(0..=6)?).map(|_| id(u)).collect::<Result<Vec<u64>>>()?;
                let (flags, count) = (small(u, 1)?, parts.len() as u64);
                ok(oc_scene_isolate(scene, instance, parts.as_ptr(), count, flags));
            }
            14 => {
                let model = o.any(Kind::Model, u)?;
                ok(oc_scene_set_model(scene, instance, model.cast()));
            }
            _ => ok(oc_scene_commit(scene)),
        }
    }
    Ok(())
}

/// # Safety
/// See [`call`].
unsafe fn queries(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract.
    unsafe {
        let scene: *mut oc_scene = o.any(Kind::Scene, u)?.cast();
        let (mut query, count) = query(u, o)?;
        let query = given(u, &mut query)?;
        let hits: *mut oc_hit = o.keep_all(vec![std::mem::zeroed::<oc_hit>(); count]);
        let any: *mut u8 = o.keep_all(vec![0u8; count]);
        match u.int_in_range(0..=7)? {
            0 | 1 => ok(oc_scene_closest(scene, query, hits, 0)),
            2 => ok(oc_scene_any(scene, query, any, 0)),
            3 => {
                o.made(Kind::Job, |out| fine(oc_scene_closest_start(scene, query, hits, 0, out)));
            }
            4 => {
                o.made(Kind::Job, |out| fine(oc_scene_any_start(scene, query, any, 0, out)));
            }
            5 => {
                let (low, high): ([f64; 3], [f64; 3]) = (doubles(u)?, doubles(u)?);
                let mut parts = [std::mem::zeroed::<oc_overlap>(); 4];
                let (capacity, mut found) = (u.int_in_range(0..=4)?, 0);
                let (low, high) = (low.as_ptr(), high.as_ptr());
                fine(oc_scene_overlap_box(scene, low, high, parts.as_mut_ptr(), capacity, &raw mut found));
            }
            6 => {
                let count = u.int_in_range(0..=6)?;
                let plane = |_| Ok(oc_plane { normal: doubles(u)?, d: double(u)? });
                let planes = (0..count).map(plane).collect::<Result<Vec<oc_plane>>>()?;
                let (mut parts, mut found) = ([std::mem::zeroed::<oc_overlap>(); 4], 0);
                fine(oc_scene_overlap_frustum(
                    scene,
                    planes.as_ptr(),
                    count as u64,
                    parts.as_mut_ptr(),
                    4,
                    &raw mut found,
                ));
            }
            _ => {
                let (low, high, cell): ([f64; 3], [f64; 3], f64) = (doubles(u)?, doubles(u)?, double(u)?);
                o.made(Kind::Job, |out| fine(oc_scene_prefetch_box(scene, low.as_ptr(), high.as_ptr(), cell, out)));
            }
        }
    }
    Ok(())
}

/// # Safety
/// See [`call`].
unsafe fn frames(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract.
    unsafe {
        let frame: *mut oc_frame = o.any(Kind::Frame, u)?.cast();
        let scene: *mut oc_scene = o.any(Kind::Scene, u)?.cast();
        let mut progress: oc_progress = init();
        let mut size = || Ok(if u.ratio(1, 16)? { *u.choose(&[0, 65537, u32::MAX])? } else { u.int_in_range(1..=20)? });
        let (width, height): (u32, u32) = (size()?, size()?);
        match u.int_in_range(0..=12)? {
            0 | 1 => {
                let mut desc = oc_frame_desc { width, height, buffers: small(u, 1023)?, ..init() };
                if u.ratio(1, 4)? {
                    let memory = o.keep_all(vec![0u64; 20 * 20 * 2]).cast();
                    let buffer = small(u, 9)?;
                    let target = oc_target { memory, size: 20 * 20 * 16, row_pitch: 0, buffer, reserved: 0 };
                    (desc.targets, desc.target_count) = (o.keep_all(vec![target]), 1);
                }
                let (context, desc) = (o.any(Kind::Context, u)?, given(u, &mut desc)?);
                o.made(Kind::Frame, |out| fine(oc_frame_create(context.cast(), desc, out)));
            }
            2..=4 => {
                let mut camera = camera(u)?;
                let mut settings =
                    oc_frame_settings { samples: small(u, 3)?, poe: float(u)?, ambient: float(u)?, ..init() };
                (settings.flags, settings.exposure) = (small(u, 3)?, float(u)?);
                settings.samples = if settings.samples > 3 { 1025 } else { settings.samples };
                fine(oc_frame_request(frame, scene, given(u, &mut camera)?, given(u, &mut settings)?));
            }
            5 => ok(oc_frame_poll(frame, given(u, &mut progress)?)),
            6 | 7 => ok(oc_frame_wait(frame, *u.choose(&[0, 1, 20, OC_FOREVER])?, given(u, &mut progress)?)),
            8 => ok(oc_frame_cancel(frame)),
            9 => ok(oc_frame_resize(frame, width, height)),
            10 => ok(oc_frame_get_accuracy(frame, given(u, &mut init())?)),
            11 => {
                let mut hit = std::mem::zeroed();
                fine(oc_frame_pick(frame, small(u, 20)?, small(u, 20)?, &raw mut hit));
            }
            _ => {
                let mut pixels: oc_pixels = init();
                if fine(oc_frame_map(frame, small(u, 9)?, given(u, &mut pixels)?)) == OC_STATUS_OK {
                    // All of it is readable.
                    let bytes = std::slice::from_raw_parts(pixels.data.cast::<u8>(), pixels.size as usize);
                    std::hint::black_box(bytes.iter().fold(0u8, |sum, b| sum ^ b));
                    o.add(Kind::Mapping, pixels.mapping.cast());
                }
            }
        }
        assert!(progress.error != OC_STATUS_INTERNAL, "a frame failed by a defect");
    }
    Ok(())
}
