//! Sizes and offsets of every struct, told by Rust and asserted by C.

use outcrop::capi::build::oc_build_desc;
use outcrop::capi::cages::{oc_cage, oc_displacement};
use outcrop::capi::clash::{oc_clash, oc_clash_desc, oc_clash_summary};
use outcrop::capi::contents::{oc_material, oc_part};
use outcrop::capi::context::{oc_context_desc, oc_executor};
use outcrop::capi::crossings::oc_crossing;
use outcrop::capi::cursor::{oc_node, oc_node_triangle, oc_tree_place};
use outcrop::capi::evaluate::oc_surface_point;
use outcrop::capi::fit::{oc_fit, oc_part_ref};
use outcrop::capi::frame::{oc_frame_accuracy, oc_frame_desc, oc_frame_settings};
use outcrop::capi::geometry::oc_triangle;
use outcrop::capi::inside::oc_part_at;
use outcrop::capi::instances::{oc_instances, oc_place};
use outcrop::capi::job::oc_progress;
use outcrop::capi::looks::oc_look;
use outcrop::capi::model::{oc_io, oc_model_info, oc_part_info};
use outcrop::capi::nearest::{oc_distance, oc_distance_desc, oc_nearest_desc, oc_nearest_point};
use outcrop::capi::nurbs::oc_nurbs;
use outcrop::capi::overlap::{oc_overlap, oc_plane};
use outcrop::capi::pixels::{oc_pixels, oc_target};
use outcrop::capi::query::{oc_hit, oc_query, oc_ray};
use outcrop::capi::query_f32::{oc_hit_f32, oc_query_f32, oc_ray_f32, oc_rays_soa};
use outcrop::capi::report::oc_build_report;
use outcrop::capi::resolve::oc_resolved;
use outcrop::capi::scene::{oc_background, oc_light};
use outcrop::capi::triangles::oc_triangles;
use outcrop::capi::view::oc_camera;
use std::collections::BTreeMap;
use std::mem::{offset_of, size_of};
use std::path::PathBuf;
use std::process::Command;

struct Layout {
    name: &'static str,
    size: usize,
    members: Vec<(&'static str, usize)>,
}

macro_rules! layouts {
    ($($name:ident { $($member:ident),+ $(,)? })+) => {
        vec![$(Layout {
            name: stringify!($name),
            size: size_of::<$name>(),
            members: vec![$((stringify!($member), offset_of!($name, $member))),+],
        }),+]
    };
}

fn layouts() -> Vec<Layout> {
    layouts! {
        oc_progress { struct_size, state, fraction, done, total, bytes, need, error, phase }
        oc_executor { struct_size, concurrency, user, submit }
        oc_context_desc { struct_size, threads, memory_budget, executor, log, log_user, instruction_set, flags }
        oc_camera { struct_size, kind, eye, at, up, fov_y, height }
        oc_resolved { struct_size, kind, bytes, size, path, release, release_user }
        oc_build_desc {
            struct_size, structure, memory_budget, temp_dir, metres_per_unit, up, splits, threads, reserved, resolve,
            resolve_user, trusted_folder, max_triangles, max_bytes, trust_paths, reserved_2,
            crease_angle, stand_ins, proxy_rays, proxy_triangles, surface_tolerance, surface_level, subdivide,
            displacement_map, displacement_scale, surface_leaves, surface_flat,
        }
        oc_material { struct_size, colour, opacity, metalness, roughness, reserved }
        oc_part { struct_size, material, id, parent, name, has_parent, reserved }
        oc_triangles {
            struct_size, mesh, part, positions, position_count, position_stride, indices, index_count, colours,
            colour_stride, scalar, index, normals, normal_stride, position_colours, position_colour_stride,
        }
        oc_cage {
            struct_size, mesh, part, face_parts, positions, position_count, position_stride, face_sizes, face_count, indices,
            index_count, creases, crease_sharpness, crease_count, corners, corner_sharpness, corner_count, holes,
            hole_count, scalar, boundary, creasing, triangle_rule, displacement,
        }
        oc_displacement {
            struct_size, width, height, map_count, texels, coordinates, scale, wrap_s, wrap_t,
        }
        oc_nurbs {
            struct_size, mesh, part, degree_u, degree_v, count_u, count_v, knots_u, knots_v, points, weights, reversed,
            reserved,
        }
        oc_build_report {
            struct_size, notes, triangles_in, triangles_kept, dropped_non_finite, dropped_degenerate,
            dropped_out_of_range, parts, instances, geometry_bytes, file_bytes, seconds_read, seconds_build,
            seconds_write, position_error, unusable_normals,
        }
        oc_io { struct_size, reserved, size, read_at, close, user, name }
        oc_model_info {
            struct_size, up, bounds_min, bounds_max, metres_per_unit, triangles_in, triangles_stored,
            triangles_placed, file_bytes, geometry_bytes, resident_bytes, parts, instances, blocks, has_colours,
            has_normals, reserved, fast_form_bytes, proxies, proxy_bytes,
        }
        oc_part_info {
            struct_size, parent, id, name, triangles, bounds_min, bounds_max, colour, metalness, roughness, flags,
            reserved,
        }
        oc_place { position, rotation, scale, reserved }
        oc_instances {
            struct_size, form, prototypes, prototype_count, prototype_of, transforms, stride, count, first_id, mask,
            reserved, scenes, scene_count, masks, mask_stride, tints, tint_stride,
        }
        oc_look { struct_size, flags, colour }
        oc_light { vector, colour, intensity, kind, shadows }
        oc_background { struct_size, reserved, bottom, top }
        oc_ray { origin, t_min, t_max, direction, cone_a, cone_b, mask }
        oc_query { struct_size, want, flags, reserved, rays, count, stride }
        oc_hit { t, position, t_free, part, instance, prim, normal, uv, error, kind, shading_normal, occurrence }
        oc_ray_f32 { origin, t_min, direction, t_max }
        oc_rays_soa { origin, direction, t_min, t_max }
        oc_hit_f32 { t, normal, uv, part, instance, prim, kind }
        oc_query_f32 { struct_size, want, flags, reserved, rays, columns, count, stride }
        oc_triangle { corners, part, prim, normals, reserved }
        oc_surface_point { position, du, dv, normal, curvatures, kind, corner }
        oc_node {
            struct_size, tree, child_count, triangle_count, leaf_children, part, bounds_min, bounds_max, children,
            child_bounds,
        }
        oc_node_triangle { corners, prim, part, tree }
        oc_tree_place { model_from_tree, root, tree, first_part }
        oc_crossing { t, part, instance, prim, normal, uv, error, side, kind }
        oc_part_at { instance, part, winding, holds }
        oc_overlap { instance, part, kind, reserved }
        oc_plane { normal, d }
        oc_clash_desc {
            struct_size, detail, first, second, clearance, tolerance, limit, skip_pairs, skip_count, skip, reserved,
        }
        oc_clash {
            id, instance, part, prim, first_point, second_point, normal, low, high, depth, distance, error, count, kind,
            open,
        }
        oc_clash_summary { struct_size, is_cut, clashes, pairs }
        oc_nearest_desc { struct_size, flags, points, count, stride, parts, max_distance }
        oc_nearest_point { distance, error, position, instance, part, prim, kind, holds }
        oc_distance_desc { struct_size, reserved, first, second, max_distance }
        oc_distance { struct_size, found, distance, error, first_point, second_point, instance, part, prim }
        oc_fit {
            struct_size, kind, width, height, view, up_axis, direction, up, fov_y, margin, flags, reserved,
        }
        oc_part_ref { instance, part }
        oc_target { memory, size, row_pitch, buffer, reserved }
        oc_frame_desc { struct_size, width, height, buffers, targets, target_count }
        oc_frame_settings { struct_size, samples, poe, ambient, flags, exposure }
        oc_frame_accuracy {
            struct_size, effective_poe, request, pixels_exact, pixels_lod, pixels_missing, pixels_total,
            bytes_resident, bytes_wanted, seconds, seconds_to_go, worst_error, mean_error, pictures, state,
        }
        oc_pixels { struct_size, format, width, height, data, row_pitch, size, mapping }
    }
}

/// The structs of the header and their members, as written there.
fn declared() -> BTreeMap<String, Vec<String>> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("include/outcrop.h");
    let header = std::fs::read_to_string(path).expect("include/outcrop.h");
    let mut structs = BTreeMap::new();
    let mut open: Option<(String, Vec<String>)> = None;
    // Comments have lines of members' form.
    for line in header.lines().filter(|line| !line.trim_start().starts_with(['*', '/'])) {
        if let Some(name) = line.strip_prefix("typedef struct ").and_then(|l| l.strip_suffix(" {")) {
            open = Some((name.to_string(), Vec::new()));
        } else if line.starts_with('}') {
            structs.extend(open.take());
        } else if let (Some((_, members)), Some(member)) = (&mut open, line.trim().strip_suffix(';')) {
            let name = member.split('[').next().expect("a name");
            members.push(name.rsplit([' ', '*']).next().expect("a name").to_string());
        }
    }
    structs
}

#[test]
fn every_struct_and_member_is_checked() {
    let told: BTreeMap<String, Vec<String>> =
        layouts().iter().map(|l| (l.name.to_string(), l.members.iter().map(|m| m.0.to_string()).collect())).collect();
    assert_eq!(told, declared());
}

#[test]
fn sizes_and_offsets_agree_with_c() {
    let mut c = String::from("#include <outcrop.h>\n#include <stddef.h>\n");
    for l in layouts() {
        c += &format!("_Static_assert(sizeof({}) == {}, \"{}\");\n", l.name, l.size, l.name);
        for (member, offset) in l.members {
            let name = format!("{}.{member}", l.name);
            c += &format!("_Static_assert(offsetof({}, {member}) == {offset}, \"{name}\");\n", l.name);
        }
    }
    let dir = tempfile::tempdir().expect("a temporary folder");
    let file = dir.path().join("layout.c");
    std::fs::write(&file, c).expect("layout.c");
    let include = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("include");
    let output = Command::new("cc")
        .args(["-std=c11", "-c", "-o"])
        .arg(dir.path().join("layout.o"))
        .arg("-I")
        .arg(include)
        .arg(&file)
        .output()
        .expect("cc");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
