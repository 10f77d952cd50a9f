"""Structs, callbacks and functions of the C API, under their own names.

This file is generated from include/outcrop.h: run `python3 generate.py`.
"""

from __future__ import annotations

import ctypes as c
from typing import Any, Callable

OC_VERSION_MAJOR = 0
"""Major version. Programs compiled for another major version do not work."""
OC_VERSION_MINOR = 1
"""Minor version. While the major version is 0, programs compiled for another minor version do not work."""
OC_VERSION_PATCH = 0
"""Patch version."""
OC_HEADER_VERSION = 100
"""Version of this header: `major * 10000 + minor * 100 + patch`. Pass it to oc_context_create."""
OC_FOREVER = 4294967295
"""Timeout: wait without a limit."""
OC_ALL_THREADS = 4294967295
"""Number of threads: one for each core of the machine."""
OC_NO_INDEX = 4294967295
"""Index of the parent of a part that has none."""
OC_NO_ID = 18446744073709551615
"""The value of ids that are not set: of a miss, or not requested."""
OC_TRANSFORM_AFFINE_F64 = 0
"""12 doubles by column: the images of the three axes, then the translation. As for oc_scene_add_instance."""
OC_TRANSFORM_AFFINE_F32 = 1
"""The same in 12 floats, for models near zero."""
OC_TRANSFORM_PLACE = 2
"""An Place."""

# Callbacks.
oc_wake_fn = c.CFUNCTYPE(None, c.c_void_p)
oc_run_fn = c.CFUNCTYPE(None, c.c_void_p)
oc_submit_fn = c.CFUNCTYPE(None, c.c_void_p, oc_run_fn, c.c_void_p)
oc_log_fn = c.CFUNCTYPE(None, c.c_void_p, c.c_uint32, c.c_char_p)
oc_release_fn = c.CFUNCTYPE(None, c.c_void_p)
oc_resolve_fn = c.CFUNCTYPE(c.c_uint32, c.c_void_p, c.c_char_p, c.c_char_p, c.c_void_p)
oc_read_fn = c.CFUNCTYPE(c.c_uint32, c.c_void_p, c.c_uint64, c.c_void_p, c.c_uint64)
oc_close_fn = c.CFUNCTYPE(None, c.c_void_p)


class Sized(c.Structure):
    """A struct that begins with `struct_size`. The constructor sets it and zeroes the rest."""

    def __init__(self, **members: Any) -> None:
        super().__init__(struct_size=c.sizeof(type(self)), **members)


class oc_progress(Sized):
    """Progress of long work: builds, loads, batches of rays, prefetches and frames."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("state", c.c_uint32), ("fraction", c.c_double), ("done", c.c_uint64),
        ("total", c.c_uint64), ("bytes", c.c_uint64), ("need", c.c_uint64), ("error", c.c_uint32),
        ("phase", c.c_uint32),
    ]


class oc_executor(Sized):
    """The host's own threads. A context with an executor never starts a thread."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("concurrency", c.c_uint32), ("user", c.c_void_p), ("submit", oc_submit_fn),
    ]


class oc_context_desc(Sized):
    """Options of a context. All zeros: no threads, three quarters of the machine's memory."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("threads", c.c_uint32), ("memory_budget", c.c_uint64), ("executor", c.c_void_p),
        ("log", oc_log_fn), ("log_user", c.c_void_p), ("instruction_set", c.c_uint32), ("flags", c.c_uint32),
    ]


class oc_camera(Sized):
    """A camera in world space. All numbers must be finite."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("kind", c.c_uint32), ("eye", c.c_double * 3), ("at", c.c_double * 3),
        ("up", c.c_double * 3), ("fov_y", c.c_double), ("height", c.c_double),
    ]


class oc_ray(c.Structure):
    """A ray. Element of an array. Distances `t` along a ray are in units of the length of `direction`."""

    _fields_ = [
        ("origin", c.c_double * 3), ("t_min", c.c_double), ("t_max", c.c_double), ("direction", c.c_float * 3),
        ("cone_a", c.c_float), ("cone_b", c.c_float), ("mask", c.c_uint32),
    ]


class oc_plane(c.Structure):
    """A half space: the points p with dot(normal, p) + d >= 0, in world space. Element of an array."""

    _fields_ = [
        ("normal", c.c_double * 3), ("d", c.c_double),
    ]


class oc_resolved(Sized):
    """Receives the answer of oc_resolve_fn. All members but `struct_size` are 0 or NULL before the call."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("kind", c.c_uint32), ("bytes", c.c_void_p), ("size", c.c_uint64),
        ("path", c.c_char_p), ("release", oc_release_fn), ("release_user", c.c_void_p),
    ]


class oc_build_desc(Sized):
    """Options of a build. All zeros: suitable for most models."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("structure", c.c_uint32), ("memory_budget", c.c_uint64),
        ("temp_dir", c.c_char_p), ("metres_per_unit", c.c_double), ("up", c.c_uint32), ("splits", c.c_uint32),
        ("threads", c.c_uint32), ("reserved", c.c_uint32), ("resolve", oc_resolve_fn), ("resolve_user", c.c_void_p),
        ("trusted_folder", c.c_char_p), ("max_triangles", c.c_uint64), ("max_bytes", c.c_uint64),
        ("trust_paths", c.c_uint32), ("reserved_2", c.c_uint32), ("crease_angle", c.c_float),
        ("stand_ins", c.c_uint32), ("proxy_rays", c.c_uint32), ("proxy_triangles", c.c_uint32),
        ("surface_tolerance", c.c_double), ("surface_level", c.c_uint32), ("subdivide", c.c_uint32),
        ("displacement_map", c.c_char_p), ("displacement_scale", c.c_double), ("surface_leaves", c.c_uint32),
        ("surface_flat", c.c_float),
    ]


class oc_material(Sized):
    """Material of a part. Colours are linear. All zeros: grey, opaque, matt."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("colour", c.c_float * 3), ("opacity", c.c_float), ("metalness", c.c_float),
        ("roughness", c.c_float), ("reserved", c.c_uint32),
    ]


class oc_part(Sized):
    """A part: the unit that a user selects, hides or colours."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("material", c.c_uint32), ("id", c.c_uint64), ("parent", c.c_uint64),
        ("name", c.c_char_p), ("has_parent", c.c_uint32), ("reserved", c.c_uint32),
    ]


class oc_triangles(Sized):
    """Triangles in the caller's memory. The arrays are read during the call. They may have any alignment."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("mesh", c.c_uint32), ("part", c.c_uint64), ("positions", c.c_void_p),
        ("position_count", c.c_uint64), ("position_stride", c.c_uint64), ("indices", c.c_void_p),
        ("index_count", c.c_uint64), ("colours", c.c_void_p), ("colour_stride", c.c_uint64), ("scalar", c.c_uint32),
        ("index", c.c_uint32), ("normals", c.c_void_p), ("normal_stride", c.c_uint64),
        ("position_colours", c.c_void_p), ("position_colour_stride", c.c_uint64),
    ]


class oc_displacement(Sized):
    """Heights by which a surface is moved along its normal: a biquadratic B-spline with a control value in the
    middle of each texel, so that the surface stays smooth. Where faces meet, the surface moves by the mean of
    their heights.
    """

    _fields_ = [
        ("struct_size", c.c_uint32), ("width", c.c_uint32), ("height", c.c_uint32), ("map_count", c.c_uint32),
        ("texels", c.c_void_p), ("coordinates", c.c_void_p), ("scale", c.c_double), ("wrap_s", c.c_uint32),
        ("wrap_t", c.c_uint32),
    ]


class oc_cage(Sized):
    """A Catmull-Clark subdivision surface, as its cage. The arrays are read during the call. They may have any
    alignment.
    """

    _fields_ = [
        ("struct_size", c.c_uint32), ("mesh", c.c_uint32), ("part", c.c_uint64), ("face_parts", c.c_void_p),
        ("positions", c.c_void_p), ("position_count", c.c_uint64), ("position_stride", c.c_uint64),
        ("face_sizes", c.c_void_p), ("face_count", c.c_uint64), ("indices", c.c_void_p), ("index_count", c.c_uint64),
        ("creases", c.c_void_p), ("crease_sharpness", c.c_void_p), ("crease_count", c.c_uint64),
        ("corners", c.c_void_p), ("corner_sharpness", c.c_void_p), ("corner_count", c.c_uint64),
        ("holes", c.c_void_p), ("hole_count", c.c_uint64), ("scalar", c.c_uint32), ("boundary", c.c_uint32),
        ("creasing", c.c_uint32), ("triangle_rule", c.c_uint32), ("displacement", c.c_void_p),
    ]


class oc_nurbs(Sized):
    """A NURBS surface without trims, rational or not. The arrays are read during the call, and are tightly packed.
    They may have any alignment.
    """

    _fields_ = [
        ("struct_size", c.c_uint32), ("mesh", c.c_uint32), ("part", c.c_uint64), ("degree_u", c.c_uint32),
        ("degree_v", c.c_uint32), ("count_u", c.c_uint32), ("count_v", c.c_uint32), ("knots_u", c.c_void_p),
        ("knots_v", c.c_void_p), ("points", c.c_void_p), ("weights", c.c_void_p), ("reversed", c.c_uint32),
        ("reserved", c.c_uint32),
    ]


class oc_build_report(Sized):
    """Statistics of a build."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("notes", c.c_uint32), ("triangles_in", c.c_uint64),
        ("triangles_kept", c.c_uint64), ("dropped_non_finite", c.c_uint64), ("dropped_degenerate", c.c_uint64),
        ("dropped_out_of_range", c.c_uint64), ("parts", c.c_uint64), ("instances", c.c_uint64),
        ("geometry_bytes", c.c_uint64), ("file_bytes", c.c_uint64), ("seconds_read", c.c_double),
        ("seconds_build", c.c_double), ("seconds_write", c.c_double), ("position_error", c.c_double),
        ("unusable_normals", c.c_uint64),
    ]


class oc_io(Sized):
    """The caller's own functions that read a model, in place of a file."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("reserved", c.c_uint32), ("size", c.c_uint64), ("read_at", oc_read_fn),
        ("close", oc_close_fn), ("user", c.c_void_p), ("name", c.c_char_p),
    ]


class oc_model_info(Sized):
    """Properties of a model."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("up", c.c_uint32), ("bounds_min", c.c_double * 3),
        ("bounds_max", c.c_double * 3), ("metres_per_unit", c.c_double), ("triangles_in", c.c_uint64),
        ("triangles_stored", c.c_uint64), ("triangles_placed", c.c_uint64), ("file_bytes", c.c_uint64),
        ("geometry_bytes", c.c_uint64), ("resident_bytes", c.c_uint64), ("parts", c.c_uint32),
        ("instances", c.c_uint32), ("blocks", c.c_uint32), ("has_colours", c.c_uint32), ("has_normals", c.c_uint32),
        ("reserved", c.c_uint32), ("fast_form_bytes", c.c_uint64), ("proxies", c.c_uint64),
        ("proxy_bytes", c.c_uint64),
    ]


class oc_part_info(Sized):
    """Properties of a part of a model."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("parent", c.c_uint32), ("id", c.c_uint64), ("name", c.c_char_p),
        ("triangles", c.c_uint64), ("bounds_min", c.c_double * 3), ("bounds_max", c.c_double * 3),
        ("colour", c.c_float * 4), ("metalness", c.c_float), ("roughness", c.c_float), ("flags", c.c_uint32),
        ("reserved", c.c_uint32),
    ]


class oc_light(c.Structure):
    """A light. Element of an array. All zeros: a white headlight."""

    _fields_ = [
        ("vector", c.c_double * 3), ("colour", c.c_float * 3), ("intensity", c.c_float), ("kind", c.c_uint32),
        ("shadows", c.c_uint32),
    ]


class oc_background(Sized):
    """Background of a picture: a vertical gradient. All numbers must be finite and 0 or more. All zeros: black and
    transparent.
    """

    _fields_ = [
        ("struct_size", c.c_uint32), ("reserved", c.c_uint32), ("bottom", c.c_float * 4), ("top", c.c_float * 4),
    ]


class oc_instances(Sized):
    """Many instances of a few models, or of a few scenes. OC_INIT and the prototypes or the scenes, the transforms
    and their count are the least.
    """

    _fields_ = [
        ("struct_size", c.c_uint32), ("form", c.c_uint32), ("prototypes", c.c_void_p),
        ("prototype_count", c.c_uint64), ("prototype_of", c.c_void_p), ("transforms", c.c_void_p),
        ("stride", c.c_uint64), ("count", c.c_uint64), ("first_id", c.c_uint64), ("mask", c.c_uint32),
        ("reserved", c.c_uint32), ("scenes", c.c_void_p), ("scene_count", c.c_uint64), ("masks", c.c_void_p),
        ("mask_stride", c.c_uint64), ("tints", c.c_void_p), ("tint_stride", c.c_uint64),
    ]


class oc_look(Sized):
    """Appearance of an instance or a part. All zeros: unchanged."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("flags", c.c_uint32), ("colour", c.c_float * 4),
    ]


class oc_query(Sized):
    """A batch of rays."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("want", c.c_uint32), ("flags", c.c_uint32), ("reserved", c.c_uint32),
        ("rays", c.c_void_p), ("count", c.c_uint64), ("stride", c.c_uint64),
    ]


class oc_hit(c.Structure):
    """Closest hit of a ray. Element of an array. Members that were not requested have the values of a miss."""

    _fields_ = [
        ("t", c.c_double), ("position", c.c_double * 3), ("t_free", c.c_double), ("part", c.c_uint64),
        ("instance", c.c_uint64), ("prim", c.c_uint64), ("normal", c.c_float * 3), ("uv", c.c_float * 2),
        ("error", c.c_float), ("kind", c.c_uint32), ("shading_normal", c.c_float * 3), ("occurrence", c.c_uint64),
    ]


class oc_ray_f32(c.Structure):
    """A ray in single precision, in world space."""

    _fields_ = [
        ("origin", c.c_float * 3), ("t_min", c.c_float), ("direction", c.c_float * 3), ("t_max", c.c_float),
    ]


class oc_rays_soa(c.Structure):
    """Rays in single precision as a structure of arrays: one array for each number, without gaps."""

    _fields_ = [
        ("origin", c.c_void_p * 3), ("direction", c.c_void_p * 3), ("t_min", c.c_void_p), ("t_max", c.c_void_p),
    ]


class oc_query_f32(Sized):
    """A batch of rays in single precision. The rays are exact: they have no footprint."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("want", c.c_uint32), ("flags", c.c_uint32), ("reserved", c.c_uint32),
        ("rays", c.c_void_p), ("columns", c.c_void_p), ("count", c.c_uint64), ("stride", c.c_uint64),
    ]


class oc_hit_f32(c.Structure):
    """A hit in single precision. Members that are not in `QueryF32.want` are as for a miss."""

    _fields_ = [
        ("t", c.c_float), ("normal", c.c_float * 3), ("uv", c.c_float * 2), ("part", c.c_uint32),
        ("instance", c.c_uint32), ("prim", c.c_uint32), ("kind", c.c_uint32),
    ]


class oc_triangle(c.Structure):
    """A triangle with all that is stored of it. Element of an array."""

    _fields_ = [
        ("corners", c.c_double * 9), ("part", c.c_uint64), ("prim", c.c_uint64), ("normals", c.c_float * 9),
        ("reserved", c.c_uint32),
    ]


class oc_surface_point(c.Structure):
    """A point of a surface, in world space. Element of an array."""

    _fields_ = [
        ("position", c.c_double * 3), ("du", c.c_double * 3), ("dv", c.c_double * 3), ("normal", c.c_double * 3),
        ("curvatures", c.c_double * 2), ("kind", c.c_uint32), ("corner", c.c_uint32),
    ]


class oc_crossing(c.Structure):
    """A point where a ray goes through an original triangle. Element of an array."""

    _fields_ = [
        ("t", c.c_double), ("part", c.c_uint64), ("instance", c.c_uint64), ("prim", c.c_uint64),
        ("normal", c.c_float * 3), ("uv", c.c_float * 2), ("error", c.c_float), ("side", c.c_uint32),
        ("kind", c.c_uint32),
    ]


class oc_tree_place(c.Structure):
    """A place of a tree in its model. Element of an array."""

    _fields_ = [
        ("model_from_tree", c.c_double * 12), ("root", c.c_uint64), ("tree", c.c_uint32), ("first_part", c.c_uint32),
    ]


class oc_node(Sized):
    """A node of a tree: a leaf, which has triangles, or a node with children."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("tree", c.c_uint32), ("child_count", c.c_uint32),
        ("triangle_count", c.c_uint32), ("leaf_children", c.c_uint32), ("part", c.c_uint32),
        ("bounds_min", c.c_double * 3), ("bounds_max", c.c_double * 3), ("children", c.c_uint64 * 8),
        ("child_bounds", c.c_double * 48),
    ]


class oc_node_triangle(c.Structure):
    """A triangle of a leaf. Element of an array."""

    _fields_ = [
        ("corners", c.c_double * 9), ("prim", c.c_uint64), ("part", c.c_uint32), ("tree", c.c_uint32),
    ]


class oc_part_at(c.Structure):
    """A part at a point. Element of an array."""

    _fields_ = [
        ("instance", c.c_uint64), ("part", c.c_uint64), ("winding", c.c_int32), ("holds", c.c_uint32),
    ]


class oc_overlap(c.Structure):
    """A part that intersects a volume. Element of an array."""

    _fields_ = [
        ("instance", c.c_uint64), ("part", c.c_uint64), ("kind", c.c_uint32), ("reserved", c.c_uint32),
    ]


class oc_clash_desc(Sized):
    """A search for clashes. All zeros: all parts against each other, without a clearance."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("detail", c.c_uint32), ("first", c.c_void_p), ("second", c.c_void_p),
        ("clearance", c.c_double), ("tolerance", c.c_double), ("limit", c.c_uint64), ("skip_pairs", c.c_void_p),
        ("skip_count", c.c_uint64), ("skip", c.c_uint32), ("reserved", c.c_uint32),
    ]


class oc_clash(c.Structure):
    """A clash of two parts, or of a triangle of each. Element of an array. The first part is in the first set of the
    search and the second in the second set. If each part is in both, the part of the instance that was added
    first comes first, or the one that is first in the model.
    """

    _fields_ = [
        ("id", c.c_uint64), ("instance", c.c_uint64 * 2), ("part", c.c_uint64 * 2), ("prim", c.c_uint64 * 2),
        ("first_point", c.c_double * 3), ("second_point", c.c_double * 3), ("normal", c.c_double * 3),
        ("low", c.c_double * 3), ("high", c.c_double * 3), ("depth", c.c_double), ("distance", c.c_double),
        ("error", c.c_double), ("count", c.c_uint64), ("kind", c.c_uint32), ("open", c.c_uint32),
    ]


class oc_clash_summary(Sized):
    """The end of a search for clashes."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("is_cut", c.c_uint32), ("clashes", c.c_uint64), ("pairs", c.c_uint64),
    ]


class oc_nearest_desc(Sized):
    """A batch of points whose nearest points are searched. All zeros: no points, of all parts, without a limit."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("flags", c.c_uint32), ("points", c.c_void_p), ("count", c.c_uint64),
        ("stride", c.c_uint64), ("parts", c.c_void_p), ("max_distance", c.c_double),
    ]


class oc_nearest_point(c.Structure):
    """The nearest point of the surfaces of parts. Element of an array."""

    _fields_ = [
        ("distance", c.c_double), ("error", c.c_double), ("position", c.c_double * 3), ("instance", c.c_uint64),
        ("part", c.c_uint64), ("prim", c.c_uint64), ("kind", c.c_uint32), ("holds", c.c_uint32),
    ]


class oc_distance_desc(Sized):
    """A search for the distance of two sets of parts. All zeros: of all parts, the nearest two."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("reserved", c.c_uint32), ("first", c.c_void_p), ("second", c.c_void_p),
        ("max_distance", c.c_double),
    ]


class oc_distance(Sized):
    """The distance of two sets of parts, and two points that have it. The first of two is of the first set; of one
    set, that of the instance that was added first, or of the part that is first in the model.
    """

    _fields_ = [
        ("struct_size", c.c_uint32), ("found", c.c_uint32), ("distance", c.c_double), ("error", c.c_double),
        ("first_point", c.c_double * 3), ("second_point", c.c_double * 3), ("instance", c.c_uint64 * 2),
        ("part", c.c_uint64 * 2), ("prim", c.c_uint64 * 2),
    ]


class oc_fit(Sized):
    """The picture for which oc_scene_fit finds a camera. `width` and `height` must be set."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("kind", c.c_uint32), ("width", c.c_uint32), ("height", c.c_uint32),
        ("view", c.c_uint32), ("up_axis", c.c_uint32), ("direction", c.c_double * 3), ("up", c.c_double * 3),
        ("fov_y", c.c_double), ("margin", c.c_double), ("flags", c.c_uint32), ("reserved", c.c_uint32),
    ]


class oc_part_ref(c.Structure):
    """A part of an instance. Element of an array."""

    _fields_ = [
        ("instance", c.c_uint64), ("part", c.c_uint64),
    ]


class oc_target(c.Structure):
    """The caller's memory for a buffer. Element of an array."""

    _fields_ = [
        ("memory", c.c_void_p), ("size", c.c_uint64), ("row_pitch", c.c_uint64), ("buffer", c.c_uint32),
        ("reserved", c.c_uint32),
    ]


class oc_frame_desc(Sized):
    """Options of a frame. `width` and `height` must be set."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("width", c.c_uint32), ("height", c.c_uint32), ("buffers", c.c_uint32),
        ("targets", c.c_void_p), ("target_count", c.c_uint64),
    ]


class oc_frame_settings(Sized):
    """Options of a request. All zeros: exact, one ray for each pixel."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("samples", c.c_uint32), ("poe", c.c_float), ("ambient", c.c_float),
        ("flags", c.c_uint32), ("exposure", c.c_float),
    ]


class oc_frame_accuracy(Sized):
    """Accuracy of the picture of the last request."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("effective_poe", c.c_float), ("request", c.c_uint64),
        ("pixels_exact", c.c_uint64), ("pixels_lod", c.c_uint64), ("pixels_missing", c.c_uint64),
        ("pixels_total", c.c_uint64), ("bytes_resident", c.c_uint64), ("bytes_wanted", c.c_uint64),
        ("seconds", c.c_double), ("seconds_to_go", c.c_double), ("worst_error", c.c_float), ("mean_error", c.c_float),
        ("pictures", c.c_uint32), ("state", c.c_uint32),
    ]


class oc_pixels(Sized):
    """A mapped buffer of a complete picture."""

    _fields_ = [
        ("struct_size", c.c_uint32), ("format", c.c_uint32), ("width", c.c_uint32), ("height", c.c_uint32),
        ("data", c.c_void_p), ("row_pitch", c.c_uint64), ("size", c.c_uint64), ("mapping", c.c_void_p),
    ]


class oc_place(c.Structure):
    """A position with a rotation and a scale. Element of an array."""

    _fields_ = [
        ("position", c.c_double * 3), ("rotation", c.c_float * 4), ("scale", c.c_float), ("reserved", c.c_uint32),
    ]


STRUCTS: list[type[c.Structure]] = [
    oc_progress, oc_executor, oc_context_desc, oc_camera, oc_ray, oc_plane, oc_resolved, oc_build_desc, oc_material,
    oc_part, oc_triangles, oc_displacement, oc_cage, oc_nurbs, oc_build_report, oc_io, oc_model_info, oc_part_info,
    oc_light, oc_background, oc_instances, oc_look, oc_query, oc_hit, oc_ray_f32, oc_rays_soa, oc_query_f32,
    oc_hit_f32, oc_triangle, oc_surface_point, oc_crossing, oc_tree_place, oc_node, oc_node_triangle, oc_part_at,
    oc_overlap, oc_clash_desc, oc_clash, oc_clash_summary, oc_nearest_desc, oc_nearest_point, oc_distance_desc,
    oc_distance, oc_fit, oc_part_ref, oc_target, oc_frame_desc, oc_frame_settings, oc_frame_accuracy, oc_pixels,
    oc_place,
]
"""All structs, in the order of the header."""


class Functions:
    """The functions of the C API, as attributes. The loader sets them."""

    oc_version: Callable[..., int]
    oc_status_name: Callable[..., bytes]
    oc_last_error: Callable[..., bytes]
    oc_last_error_need: Callable[..., int]
    oc_init: Callable[..., None]
    oc_job_poll: Callable[..., int]
    oc_job_wait: Callable[..., int]
    oc_job_cancel: Callable[..., int]
    oc_job_set_wake: Callable[..., int]
    oc_job_model: Callable[..., int]
    oc_job_retain: Callable[..., None]
    oc_job_release: Callable[..., None]
    oc_context_create: Callable[..., int]
    oc_context_step: Callable[..., int]
    oc_context_property: Callable[..., int]
    oc_context_retain: Callable[..., None]
    oc_context_release: Callable[..., None]
    oc_camera_ray: Callable[..., int]
    oc_camera_frustum: Callable[..., int]
    oc_build_create: Callable[..., int]
    oc_build_add_file: Callable[..., int]
    oc_build_start: Callable[..., int]
    oc_build_retain: Callable[..., None]
    oc_build_release: Callable[..., None]
    oc_build_add_material: Callable[..., int]
    oc_build_add_part: Callable[..., int]
    oc_build_add_shared_mesh: Callable[..., int]
    oc_build_add_instance: Callable[..., int]
    oc_build_add_triangles: Callable[..., int]
    oc_build_add_cage: Callable[..., int]
    oc_build_add_nurbs: Callable[..., int]
    oc_job_build_report: Callable[..., int]
    oc_job_build_note: Callable[..., int]
    oc_model_open: Callable[..., int]
    oc_model_open_io: Callable[..., int]
    oc_model_load: Callable[..., int]
    oc_model_get_info: Callable[..., int]
    oc_model_get_part: Callable[..., int]
    oc_model_find_part: Callable[..., int]
    oc_model_get_view: Callable[..., int]
    oc_model_get_placement: Callable[..., int]
    oc_model_retain: Callable[..., None]
    oc_model_release: Callable[..., None]
    oc_scene_create: Callable[..., int]
    oc_scene_add_instance: Callable[..., int]
    oc_scene_remove_instance: Callable[..., int]
    oc_scene_set_transform: Callable[..., int]
    oc_scene_set_instance_mask: Callable[..., int]
    oc_scene_set_lights: Callable[..., int]
    oc_scene_set_background: Callable[..., int]
    oc_scene_commit: Callable[..., int]
    oc_scene_retain: Callable[..., None]
    oc_scene_release: Callable[..., None]
    oc_scene_add_instances: Callable[..., int]
    oc_scene_set_transforms: Callable[..., int]
    oc_scene_set_masks: Callable[..., int]
    oc_scene_set_tints: Callable[..., int]
    oc_scene_remove_instances: Callable[..., int]
    oc_scene_add_scene: Callable[..., int]
    oc_scene_set_occurrence_look: Callable[..., int]
    oc_scene_get_path: Callable[..., int]
    oc_scene_save: Callable[..., int]
    oc_scene_open: Callable[..., int]
    oc_scene_set_instance_look: Callable[..., int]
    oc_scene_set_part_look: Callable[..., int]
    oc_scene_set_parts_look: Callable[..., int]
    oc_scene_isolate: Callable[..., int]
    oc_scene_set_model: Callable[..., int]
    oc_scene_clear_part_looks: Callable[..., int]
    oc_scene_closest: Callable[..., int]
    oc_scene_any: Callable[..., int]
    oc_scene_closest_start: Callable[..., int]
    oc_scene_any_start: Callable[..., int]
    oc_scene_closest_f32: Callable[..., int]
    oc_scene_any_f32: Callable[..., int]
    oc_model_read_part: Callable[..., int]
    oc_part_reader_next: Callable[..., int]
    oc_part_reader_retain: Callable[..., None]
    oc_part_reader_release: Callable[..., None]
    oc_scene_triangles: Callable[..., int]
    oc_scene_evaluate: Callable[..., int]
    oc_scene_crossings: Callable[..., int]
    oc_cursor_create: Callable[..., int]
    oc_cursor_root: Callable[..., int]
    oc_cursor_places: Callable[..., int]
    oc_cursor_node: Callable[..., int]
    oc_cursor_triangles: Callable[..., int]
    oc_cursor_block_nodes: Callable[..., int]
    oc_cursor_retain: Callable[..., None]
    oc_cursor_release: Callable[..., None]
    oc_scene_parts_at: Callable[..., int]
    oc_scene_thickness: Callable[..., int]
    oc_scene_overlap_box: Callable[..., int]
    oc_scene_overlap_frustum: Callable[..., int]
    oc_part_set_create: Callable[..., int]
    oc_part_set_add_instance: Callable[..., int]
    oc_part_set_add_part: Callable[..., int]
    oc_part_set_retain: Callable[..., None]
    oc_part_set_release: Callable[..., None]
    oc_scene_clash_start: Callable[..., int]
    oc_job_take_clashes: Callable[..., int]
    oc_job_clash_summary: Callable[..., int]
    oc_scene_nearest: Callable[..., int]
    oc_scene_distance: Callable[..., int]
    oc_scene_fit: Callable[..., int]
    oc_frame_create: Callable[..., int]
    oc_frame_request: Callable[..., int]
    oc_frame_poll: Callable[..., int]
    oc_frame_wait: Callable[..., int]
    oc_frame_cancel: Callable[..., int]
    oc_frame_resize: Callable[..., int]
    oc_frame_set_wake: Callable[..., int]
    oc_frame_get_accuracy: Callable[..., int]
    oc_frame_pick: Callable[..., int]
    oc_frame_pick_near: Callable[..., int]
    oc_frame_retain: Callable[..., None]
    oc_frame_release: Callable[..., None]
    oc_frame_map: Callable[..., int]
    oc_mapping_retain: Callable[..., None]
    oc_mapping_release: Callable[..., None]
    oc_scene_prefetch_box: Callable[..., int]
    oc_scene_prefetch_camera: Callable[..., int]


SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "oc_version": (c.c_uint32, []),
    "oc_status_name": (c.c_char_p, [c.c_uint32]),
    "oc_last_error": (c.c_char_p, []),
    "oc_last_error_need": (c.c_uint64, []),
    "oc_init": (None, [c.c_void_p, c.c_size_t]),
    "oc_job_poll": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_job_wait": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_job_cancel": (c.c_uint32, [c.c_void_p]),
    "oc_job_set_wake": (c.c_uint32, [c.c_void_p, oc_wake_fn, c.c_void_p]),
    "oc_job_model": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_job_retain": (None, [c.c_void_p]),
    "oc_job_release": (None, [c.c_void_p]),
    "oc_context_create": (c.c_uint32, [c.c_uint32, c.c_void_p, c.c_void_p]),
    "oc_context_step": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_context_property": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_context_retain": (None, [c.c_void_p]),
    "oc_context_release": (None, [c.c_void_p]),
    "oc_camera_ray": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_uint32, c.c_double, c.c_double, c.c_void_p]),
    "oc_camera_frustum": (c.c_uint32, [
        c.c_void_p, c.c_uint32, c.c_uint32, c.c_double, c.c_double, c.c_double, c.c_double, c.c_void_p,
    ]),
    "oc_build_create": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p]),
    "oc_build_add_file": (c.c_uint32, [c.c_void_p, c.c_char_p]),
    "oc_build_start": (c.c_uint32, [c.c_void_p, c.c_char_p, c.c_void_p]),
    "oc_build_retain": (None, [c.c_void_p]),
    "oc_build_release": (None, [c.c_void_p]),
    "oc_build_add_material": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p]),
    "oc_build_add_part": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_build_add_shared_mesh": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_build_add_instance": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_uint64, c.c_void_p]),
    "oc_build_add_triangles": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_build_add_cage": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_build_add_nurbs": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_job_build_report": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_job_build_note": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_model_open": (c.c_uint32, [c.c_void_p, c.c_char_p, c.c_void_p]),
    "oc_model_open_io": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p]),
    "oc_model_load": (c.c_uint32, [c.c_void_p, c.c_char_p, c.c_void_p, c.c_void_p]),
    "oc_model_get_info": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_model_get_part": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_model_find_part": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_model_get_view": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_model_get_placement": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_double, c.c_void_p, c.c_void_p]),
    "oc_model_retain": (None, [c.c_void_p]),
    "oc_model_release": (None, [c.c_void_p]),
    "oc_scene_create": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_scene_add_instance": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_remove_instance": (c.c_uint32, [c.c_void_p, c.c_uint64]),
    "oc_scene_set_transform": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_set_instance_mask": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_uint32]),
    "oc_scene_set_lights": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_uint64]),
    "oc_scene_set_background": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_scene_commit": (c.c_uint32, [c.c_void_p]),
    "oc_scene_retain": (None, [c.c_void_p]),
    "oc_scene_release": (None, [c.c_void_p]),
    "oc_scene_add_instances": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_scene_set_transforms": (c.c_uint32, [
        c.c_void_p, c.c_uint64, c.c_uint32, c.c_void_p, c.c_uint64, c.c_uint64,
    ]),
    "oc_scene_set_masks": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p, c.c_uint64, c.c_uint64]),
    "oc_scene_set_tints": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p, c.c_uint64, c.c_uint64]),
    "oc_scene_remove_instances": (c.c_uint32, [c.c_void_p, c.c_uint64]),
    "oc_scene_add_scene": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_set_occurrence_look": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_get_path": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p, c.c_uint64, c.c_void_p, c.c_void_p]),
    "oc_scene_save": (c.c_uint32, [c.c_void_p, c.c_char_p]),
    "oc_scene_open": (c.c_uint32, [c.c_void_p, c.c_char_p, c.c_void_p]),
    "oc_scene_set_instance_look": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_set_part_look": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_uint64, c.c_void_p]),
    "oc_scene_set_parts_look": (c.c_uint32, [
        c.c_void_p, c.c_uint64, c.c_void_p, c.c_uint64, c.c_uint32, c.c_void_p,
    ]),
    "oc_scene_isolate": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p, c.c_uint64, c.c_uint32]),
    "oc_scene_set_model": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_clear_part_looks": (c.c_uint32, [c.c_void_p, c.c_uint64]),
    "oc_scene_closest": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64]),
    "oc_scene_any": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64]),
    "oc_scene_closest_start": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_any_start": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_closest_f32": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64]),
    "oc_scene_any_f32": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64]),
    "oc_model_read_part": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_part_reader_next": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_part_reader_retain": (None, [c.c_void_p]),
    "oc_part_reader_release": (None, [c.c_void_p]),
    "oc_scene_triangles": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_uint64, c.c_void_p]),
    "oc_scene_evaluate": (c.c_uint32, [
        c.c_void_p, c.c_void_p, c.c_uint64, c.c_uint64, c.c_uint32, c.c_void_p, c.c_uint64,
    ]),
    "oc_scene_crossings": (c.c_uint32, [
        c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p, c.c_void_p, c.c_void_p,
    ]),
    "oc_cursor_create": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_uint64, c.c_void_p]),
    "oc_cursor_root": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_cursor_places": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_cursor_node": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_cursor_triangles": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_uint32, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_cursor_block_nodes": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_cursor_retain": (None, [c.c_void_p]),
    "oc_cursor_release": (None, [c.c_void_p]),
    "oc_scene_parts_at": (c.c_uint32, [
        c.c_void_p, c.c_void_p, c.c_uint64, c.c_uint64, c.c_void_p, c.c_uint64, c.c_void_p, c.c_void_p,
    ]),
    "oc_scene_thickness": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_uint64, c.c_void_p, c.c_uint64]),
    "oc_scene_overlap_box": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_scene_overlap_frustum": (c.c_uint32, [
        c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p, c.c_uint64, c.c_void_p,
    ]),
    "oc_part_set_create": (c.c_uint32, [c.c_void_p]),
    "oc_part_set_add_instance": (c.c_uint32, [c.c_void_p, c.c_uint64]),
    "oc_part_set_add_part": (c.c_uint32, [c.c_void_p, c.c_uint64, c.c_uint64]),
    "oc_part_set_retain": (None, [c.c_void_p]),
    "oc_part_set_release": (None, [c.c_void_p]),
    "oc_scene_clash_start": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p]),
    "oc_job_take_clashes": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_uint64, c.c_void_p]),
    "oc_job_clash_summary": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_scene_nearest": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64]),
    "oc_scene_distance": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p]),
    "oc_scene_fit": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_uint64, c.c_uint64, c.c_void_p]),
    "oc_frame_create": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p]),
    "oc_frame_request": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_void_p]),
    "oc_frame_poll": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_frame_wait": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_frame_cancel": (c.c_uint32, [c.c_void_p]),
    "oc_frame_resize": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_uint32]),
    "oc_frame_set_wake": (c.c_uint32, [c.c_void_p, oc_wake_fn, c.c_void_p]),
    "oc_frame_get_accuracy": (c.c_uint32, [c.c_void_p, c.c_void_p]),
    "oc_frame_pick": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_uint32, c.c_void_p]),
    "oc_frame_pick_near": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_uint32, c.c_double, c.c_void_p]),
    "oc_frame_retain": (None, [c.c_void_p]),
    "oc_frame_release": (None, [c.c_void_p]),
    "oc_frame_map": (c.c_uint32, [c.c_void_p, c.c_uint32, c.c_void_p]),
    "oc_mapping_retain": (None, [c.c_void_p]),
    "oc_mapping_release": (None, [c.c_void_p]),
    "oc_scene_prefetch_box": (c.c_uint32, [c.c_void_p, c.c_void_p, c.c_void_p, c.c_double, c.c_void_p]),
    "oc_scene_prefetch_camera": (c.c_uint32, [
        c.c_void_p, c.c_void_p, c.c_uint32, c.c_uint32, c.c_float, c.c_void_p,
    ]),
}
"""Result and arguments of each function."""

FALLIBLE = frozenset([
    "oc_job_poll", "oc_job_wait", "oc_job_cancel", "oc_job_set_wake", "oc_job_model", "oc_context_create",
    "oc_context_step", "oc_context_property", "oc_camera_ray", "oc_camera_frustum", "oc_build_create",
    "oc_build_add_file", "oc_build_start", "oc_build_add_material", "oc_build_add_part", "oc_build_add_shared_mesh",
    "oc_build_add_instance", "oc_build_add_triangles", "oc_build_add_cage", "oc_build_add_nurbs",
    "oc_job_build_report", "oc_job_build_note", "oc_model_open", "oc_model_open_io", "oc_model_load",
    "oc_model_get_info", "oc_model_get_part", "oc_model_find_part", "oc_model_get_view", "oc_model_get_placement",
    "oc_scene_create", "oc_scene_add_instance", "oc_scene_remove_instance", "oc_scene_set_transform",
    "oc_scene_set_instance_mask", "oc_scene_set_lights", "oc_scene_set_background", "oc_scene_commit",
    "oc_scene_add_instances", "oc_scene_set_transforms", "oc_scene_set_masks", "oc_scene_set_tints",
    "oc_scene_remove_instances", "oc_scene_add_scene", "oc_scene_set_occurrence_look", "oc_scene_get_path",
    "oc_scene_save", "oc_scene_open", "oc_scene_set_instance_look", "oc_scene_set_part_look",
    "oc_scene_set_parts_look", "oc_scene_isolate", "oc_scene_set_model", "oc_scene_clear_part_looks",
    "oc_scene_closest", "oc_scene_any", "oc_scene_closest_start", "oc_scene_any_start", "oc_scene_closest_f32",
    "oc_scene_any_f32", "oc_model_read_part", "oc_part_reader_next", "oc_scene_triangles", "oc_scene_evaluate",
    "oc_scene_crossings", "oc_cursor_create", "oc_cursor_root", "oc_cursor_places", "oc_cursor_node",
    "oc_cursor_triangles", "oc_cursor_block_nodes", "oc_scene_parts_at", "oc_scene_thickness", "oc_scene_overlap_box",
    "oc_scene_overlap_frustum", "oc_part_set_create", "oc_part_set_add_instance", "oc_part_set_add_part",
    "oc_scene_clash_start", "oc_job_take_clashes", "oc_job_clash_summary", "oc_scene_nearest", "oc_scene_distance",
    "oc_scene_fit", "oc_frame_create", "oc_frame_request", "oc_frame_poll", "oc_frame_wait", "oc_frame_cancel",
    "oc_frame_resize", "oc_frame_set_wake", "oc_frame_get_accuracy", "oc_frame_pick", "oc_frame_pick_near",
    "oc_frame_map", "oc_scene_prefetch_box", "oc_scene_prefetch_camera",
])
"""Functions that return a status."""

BUFFERS: dict[int, tuple[str, int]] = {
    0: ("u1", 4),
    1: ("f4", 4),
    2: ("f4", 1),
    3: ("f4", 3),
    4: ("u8", 1),
    5: ("u8", 1),
    6: ("u8", 1),
    7: ("u1", 1),
    8: ("f4", 1),
    9: ("f4", 3),
    10: ("u8", 1),
    11: ("f4", 2),
}
"""Type and number of the elements of a pixel, by buffer."""
