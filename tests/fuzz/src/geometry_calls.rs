//! Sequences of C calls, continued from `calls`: crossings, closed parts, stored triangles, and views.

use super::calls::{camera, double, doubles, fine, given, id, init, ok, query, small};
use super::objects::{Kind, Objects};
use arbitrary::{Result, Unstructured};
use outcrop::capi::crossings::*;
use outcrop::capi::evaluate::*;
use outcrop::capi::fit::*;
use outcrop::capi::frame::*;
use outcrop::capi::geometry::*;
use outcrop::capi::inside::*;
use outcrop::capi::model::*;
use outcrop::capi::overlap::*;
use outcrop::capi::query::*;
use outcrop::capi::scene::*;
use outcrop::capi::status::*;
use outcrop::capi::view::*;
use std::mem::zeroed;
use std::ptr::null_mut;

/// Hits of the scene, some with other members than the library wrote.
///
/// # Safety
/// `scene` is live or NULL.
unsafe fn hits(u: &mut Unstructured, o: &mut Objects, scene: *const oc_scene) -> Result<Vec<oc_hit>> {
    let (mut query, count) = query(u, o)?;
    if u.ratio(3, 4)? {
        (query.want, query.flags) = (OC_WANT_ALL, 0);
    }
    // SAFETY: zeros are a valid hit.
    let mut hits = vec![unsafe { zeroed::<oc_hit>() }; count];
    // SAFETY: the caller's contract; the rays are kept, and the array has room for their hits.
    ok(unsafe { oc_scene_closest(scene, &raw const query, hits.as_mut_ptr(), 0) });
    if let Some(last) = hits.last_mut()
        && u.ratio(1, 4)?
    {
        (last.position, last.prim, last.part, last.kind) = (doubles(u)?, u.arbitrary()?, id(u)?, small(u, 3)?);
    }
    Ok(hits)
}

/// Tests the ends of rows: no row ends before the one before it, and the last at the number of all.
fn rows(status: oc_status, ends: &[u64], count: u64) {
    if matches!(fine(status), OC_STATUS_OK | OC_STATUS_BUFFER_TOO_SMALL) {
        assert!(ends.is_sorted(), "{ends:?}");
        assert_eq!(ends.last().copied().unwrap_or(0), count);
    }
}

/// # Safety
/// Handles are live or NULL.
pub(super) unsafe fn geometry(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract; arrays have as many elements as is said.
    unsafe {
        let scene: *mut oc_scene = o.any(Kind::Scene, u)?.cast();
        let model: *mut oc_model = o.any(Kind::Model, u)?.cast();
        let capacity: usize = u.int_in_range(0..=20)?;
        let mut count = 0;
        match u.int_in_range(0..=7)? {
            0 | 1 => {
                let (mut query, rays) = query(u, o)?;
                let (mut ends, mut complete) = (vec![0u64; rays], vec![0u8; rays]);
                let mut met = vec![zeroed::<oc_crossing>(); capacity];
                let complete = if u.arbitrary()? { null_mut() } else { complete.as_mut_ptr() };
                let query = given(u, &mut query)?;
                let (met, room, to) = (met.as_mut_ptr(), capacity as u64, ends.as_mut_ptr());
                let status = oc_scene_crossings(scene, query, met, room, to, complete, &raw mut count);
                rows(status, &ends, count);
            }
            2 => {
                let points = (0..u.int_in_range(0..=6)?).map(|_| doubles::<3>(u)).collect::<Result<Vec<_>>>()?;
                let mut ends = vec![0u64; points.len()];
                let mut parts = vec![zeroed::<oc_part_at>(); capacity];
                let (from, number) = (points.as_ptr().cast(), points.len() as u64);
                let (to, room, last) = (parts.as_mut_ptr(), capacity as u64, ends.as_mut_ptr());
                rows(oc_scene_parts_at(scene, from, number, 0, to, room, last, &raw mut count), &ends, count);
            }
            3 => {
                let hits = hits(u, o, scene)?;
                let mut thick = vec![0.0; hits.len()];
                let status = oc_scene_thickness(scene, hits.as_ptr(), hits.len() as u64, 0, thick.as_mut_ptr(), 0);
                if fine(status) == OC_STATUS_OK {
                    assert!(thick.iter().all(|x| *x >= 0.0), "{thick:?}");
                }
            }
            4 => {
                let hits = hits(u, o, scene)?;
                let mut triangles = vec![zeroed::<oc_triangle>(); hits.len()];
                ok(oc_scene_triangles(scene, hits.as_ptr(), hits.len() as u64, 0, triangles.as_mut_ptr()));
            }
            5 => {
                let (hits, flags) = (hits(u, o, scene)?, small(u, 3)?);
                let mut points = vec![zeroed::<oc_surface_point>(); hits.len()];
                let to = points.as_mut_ptr();
                let status = oc_scene_evaluate(scene, hits.as_ptr(), hits.len() as u64, 0, flags, to, 0);
                if fine(status) == OC_STATUS_OK {
                    let is_number = |p: &oc_surface_point| {
                        p.curvatures.iter().chain(&p.normal).chain(&p.du).chain(&p.dv).all(|x| x.is_finite())
                    };
                    assert!(points.iter().filter(|p| p.kind <= OC_EVALUATED_TRIANGLE).all(is_number));
                }
            }
            6 => {
                let part = id(u)?;
                o.made(Kind::PartReader, |out| fine(oc_model_read_part(model, part, out)));
            }
            _ => {
                let reader = o.any(Kind::PartReader, u)?;
                let mut triangles = vec![zeroed::<oc_triangle>(); capacity];
                let (to, room) = (triangles.as_mut_ptr(), capacity as u64);
                if fine(oc_part_reader_next(reader.cast(), to, room, &raw mut count)) == OC_STATUS_OK {
                    assert!(count <= room);
                    let is_number = |t: &oc_triangle| t.corners.iter().all(|x| x.is_finite());
                    assert!(triangles[..count as usize].iter().all(is_number));
                }
            }
        }
    }
    Ok(())
}

/// # Safety
/// Handles are live or NULL.
pub(super) unsafe fn views(u: &mut Unstructured, o: &mut Objects) -> Result<()> {
    // SAFETY: the caller's contract; arrays have as many elements as is said.
    unsafe {
        let scene: *mut oc_scene = o.any(Kind::Scene, u)?.cast();
        let mut camera = camera(u)?;
        let (width, height) = (small(u, 40)?, small(u, 40)?);
        match u.int_in_range(0..=4)? {
            0 => {
                let mut ray = zeroed::<oc_ray>();
                let (x, y) = (double(u)?, double(u)?);
                ok(oc_camera_ray(given(u, &mut camera)?, width, height, x, y, &raw mut ray));
            }
            1 => {
                let mut planes = [zeroed::<oc_plane>(); 5];
                let [x0, y0, x1, y1] = doubles(u)?;
                let camera = given(u, &mut camera)?;
                ok(oc_camera_frustum(camera, width, height, x0, y0, x1, y1, planes.as_mut_ptr()));
            }
            2 => {
                let mut fit = oc_fit {
                    kind: small(u, 1)?,
                    width,
                    height,
                    view: small(u, 10)?,
                    up_axis: small(u, 3)?,
                    direction: doubles(u)?,
                    up: if u.arbitrary()? { [0.0; 3] } else { doubles(u)? },
                    fov_y: if u.arbitrary()? { 0.0 } else { double(u)? * 10.0 },
                    margin: if u.arbitrary()? { 0.0 } else { double(u)? },
                    flags: small(u, 1)?,
                    ..init()
                };
                let part = |u: &mut Unstructured| Ok(oc_part_ref { instance: small(u, 3)?.into(), part: id(u)? });
                let parts = (0..u.int_in_range(0..=3)?).map(|_| part(u)).collect::<Result<Vec<_>>>()?;
                let (fit, out) = (given(u, &mut fit)?, given(u, &mut camera)?);
                let status = oc_scene_fit(scene, fit, parts.as_ptr(), parts.len() as u64, 0, out);
                if fine(status) == OC_STATUS_OK {
                    assert!(camera.eye.iter().chain(&camera.at).all(|x| x.is_finite()), "{:?}", camera.eye);
                }
            }
            3 => {
                let (mut matrix, mut flags) = ([0.0; 12], 0);
                let model: *mut oc_model = o.any(Kind::Model, u)?.cast();
                let (up, unit) = (small(u, 3)?, double(u)?);
                ok(oc_model_get_placement(model, up, unit, matrix.as_mut_ptr(), &raw mut flags));
            }
            _ => {
                let mut hit = zeroed::<oc_hit>();
                let frame: *mut oc_frame = o.any(Kind::Frame, u)?.cast();
                ok(oc_frame_pick_near(frame, small(u, 20)?, small(u, 20)?, double(u)?, &raw mut hit));
            }
        }
    }
    Ok(())
}
