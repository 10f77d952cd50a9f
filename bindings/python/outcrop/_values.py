"""Structs without pointers, as dataclasses. A member that is 0 has its documented default.

This file is generated from include/outcrop.h: run `python3 generate.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

from . import _abi
from ._enums import (
    CameraKind, ClashKind, ClashOpenFlags, Evaluated, FrameFlags, HitKind, Holds, LightKind, LookFlags, OverlapKind,
    PartFlags, PartsFlags, Phase, Side, Splits, StandIns, State, Status, Structure, SurfaceLeaves, UpAxis, View,
)
from ._value import Value, Vector


@dataclass
class Progress(Value):
    """Progress of long work: builds, loads, batches of rays, prefetches and frames."""

    _struct = _abi.oc_progress

    state: State = State(0)
    """One of the State constants."""
    fraction: float = 0.0
    """Share of the work that is done, 0 to 1. Never decreases."""
    done: int = 0
    """Units done. Builds: triangles read. Batches: rays answered. Frames: pixels. Prefetches: blocks read."""
    total: int = 0
    """Units in total. 0: unknown."""
    bytes: int = 0
    """Builds and loads: bytes read and written so far. Frames and prefetches: bytes in memory."""
    need: int = 0
    """The least budget in bytes that suffices, if `error` is Status.OVER_BUDGET. Otherwise 0."""
    error: Status = Status(0)
    """Reason why the work failed or was cancelled. For a frame in State.COMPLETE_WITHIN_BUDGET: the reason why some
    data could not be read, else Status.OK. After a poll or wait, oc_last_error returns the reason in words.
    """
    phase: Phase = Phase(0)
    """Builds and loads: one of the Phase constants."""


@dataclass
class Camera(Value):
    """A camera in world space. All numbers must be finite."""

    _struct = _abi.oc_camera

    kind: CameraKind = CameraKind(0)
    """One of the CameraKind constants."""
    eye: Vector = (0.0, 0.0, 0.0)
    """Position of the eye. Orthographic: the centre of the picture's plane."""
    at: Vector = (0.0, 0.0, 0.0)
    """Target point. Only the direction from the eye to it matters. Must differ from the eye."""
    up: Vector = (0.0, 0.0, 0.0)
    """Direction that is up in the picture. Need not be unit. Must not be parallel to the view. All 0: +Z."""
    fov_y: float = 0.0
    """Perspective: vertical field of view in degrees, above 0 and below 180. 0: 45. Orthographic: ignored."""
    height: float = 0.0
    """Orthographic: height of the picture in world units, above 0. Perspective: ignored."""


@dataclass
class Ray(Value):
    """A ray. Element of an array. Distances `t` along a ray are in units of the length of `direction`."""

    _struct = _abi.oc_ray

    origin: Vector = (0.0, 0.0, 0.0)
    """Start point, world space. Not finite: the ray misses."""
    t_min: float = 0.0
    """Start of the interval: hits with a smaller `t` are ignored. Below 0: counts as 0. Infinite or NaN: the ray
    misses.
    """
    t_max: float = 0.0
    """End of the interval: hits with a greater `t` are ignored. 0: no end. Below `t_min` or NaN: the ray misses."""
    direction: Vector = (0.0, 0.0, 0.0)
    """Direction; need not be unit. Zero or not finite: the ray misses. Components below 1.2e-38 count as zero."""
    cone_a: float = 0.0
    """Footprint of the ray: its width at `t` is `cone_a + cone_b * t`, in world units. A stand-in may replace
    triangles if the area of its box, projected along the ray, is at most the square of the width there.

    - Exact answers: `cone_a` = 0, `cone_b` = 0.
    - p pixels of error, perspective camera, direction of length 1 along the view axis: `cone_a` = 0, `cone_b` =
      sqrt(p) * 2 tan(fov_y / 2) / (height of the picture in pixels). For a unit direction at the angle a to that
      axis, times cos(a).
    - p pixels of error, orthographic camera: `cone_b` = 0, `cone_a` = sqrt(p) * (height of the picture in world
      units) / (height of the picture in pixels).

    Below 0 or NaN: counts as 0. Infinite: the coarsest stand-ins.
    """
    cone_b: float = 0.0
    """See `cone_a`."""
    mask: int = 0
    """The ray can hit an instance only if the masks of both have a common bit. 0: all instances."""


@dataclass
class Plane(Value):
    """A half space: the points p with dot(normal, p) + d >= 0, in world space. Element of an array."""

    _struct = _abi.oc_plane

    normal: Vector = (0.0, 0.0, 0.0)
    """Normal of the plane. Points inward. Must be finite and not zero; need not be unit."""
    d: float = 0.0
    """Offset of the plane, in units of the normal's length. Must be finite."""


@dataclass
class BuildOptions(Value):
    """Options of a build. All zeros: suitable for most models."""

    _struct = _abi.oc_build_desc

    structure: Structure = Structure(0)
    """One of the Structure constants."""
    memory_budget: int = 0
    """Limit in bytes of the memory that the build takes, at least 32 MiB. Data that does not fit goes to temporary
    files. Names, parts, instances and one texture may take 64 MiB more. If names, parts and instances do not fit,
    the job fails with Status.OVER_BUDGET and names a budget that suffices for them; a texture that does not fit
    is left out with a note. Not included: vertices of OBJ files, colours of PLY vertices, buffers of glTF files,
    cages and maps of heights. 0: no limit.
    """
    temp_dir: str | None = None
    """Folder for temporary files. NULL: the system's (`TMPDIR`, if it is set). The folder is not accessed before the
    first temporary file is written.
    """
    metres_per_unit: float = 0.0
    """Length of a unit in metres, finite and above 0. Overrides the unit of the input. 0: the unit of the input."""
    up: int = 0
    """One of the UpAxis constants. Overrides the up axis of the input. UpAxis.UNKNOWN: the up axis of the input."""
    splits: Splits = Splits(0)
    """One of the Splits constants."""
    threads: int = 0
    """Number of threads, at most four for each core, or 64 if that is more. The build starts its own. 0: as many as
    the context has. OC_ALL_THREADS: one for each core. In a context without threads of its own, a build uses only
    the thread that runs it. The model file does not depend on this number.
    """
    trusted_folder: str | None = None
    """A folder of files that mesh files may refer to, with all folders below it. NULL: none.

    By default a mesh file may refer only to files in its own folder and below it: names with `..`, absolute names
    and symbolic links that lead out of it are refused. If the geometry needs the file (a buffer of glTF), the job
    fails with Status.PARSE; otherwise (material libraries, textures) the file is left out with a note.
    """
    max_triangles: int = 0
    """Greatest number of triangles in the input; those of a shared mesh count once. More: Status.OVER_LIMIT. 0: no
    limit.
    """
    max_bytes: int = 0
    """Greatest number of bytes that the model file and all temporary files take on the disk at any time. More:
    Status.OVER_LIMIT. 0: no limit.
    """
    trust_paths: int = 0
    """1: mesh files may refer to any file that the process may read. Only for mesh files from a trusted source. 0:
    the rule of `trusted_folder`.
    """
    crease_angle: float = 0.0
    """Angle in degrees, at most 180, up to which an edge between two triangles appears smooth, if the input has no
    normals there. 0: 40 degrees, with which chamfers of 45 degrees stay edges. Below 0: no normals are made, and
    surfaces without normals show their facets.
    """
    stand_ins: StandIns = StandIns(0)
    """One of the StandIns constants."""
    proxy_rays: int = 0
    """Number of rays that sample each look of StandIns.PROXIES, at most 1,048,576. 0: 512."""
    proxy_triangles: int = 0
    """Least number of triangles that such a look stands for. 0: so many that all looks take about 0.3 bytes of
    memory for each triangle.
    """
    surface_tolerance: float = 0.0
    """Greatest distance between a smooth surface and the triangles into which it is diced, as sampled, in units of
    the surface; finite. 0: 1/2048 of the surface's greatest extent. Not used with `surface_level`.
    """
    surface_level: int = 0
    """Number of times that each side of a face of a smooth surface is halved, from 1 to 12: of each Bézier patch of
    a NURBS surface, or of each half if one closed patch is the whole surface. 0: `surface_tolerance` decides.
    """
    subdivide: int = 0
    """1: faces of OBJ files are the cages of subdivision surfaces, with the tags of OpenSubdiv's tools. 0: they are
    polygons.
    """
    displacement_map: str | None = None
    """A picture of heights by which these surfaces are moved along their normals, through the texture coordinates:
    PNG with 8 or 16 bits, or EXR. Its last row is at t = 0. NULL: none.
    """
    displacement_scale: float = 0.0
    """Height of a value of 1 (white) of `displacement_map`, in units of the surface, finite."""
    surface_leaves: SurfaceLeaves = SurfaceLeaves(0)
    """One of the SurfaceLeaves constants."""
    surface_flat: float = 0.0
    """With Structure.PATCH, squares of surfaces with more than 128 triangles are divided while the normals of one
    are not within a cone of this opening, in degrees up to 180. Smaller angles give tighter boxes, which take
    more memory. 0: 30 degrees.
    """


@dataclass
class Material(Value):
    """Material of a part. Colours are linear. All zeros: grey, opaque, matt."""

    _struct = _abi.oc_material

    colour: Vector = (0.0, 0.0, 0.0)
    """Linear RGB, each 0 to 1. All 0 with opacity 0: grey (0.6)."""
    opacity: float = 0.0
    """Opacity, 0 to 1; 1 is opaque. 0: 1."""
    metalness: float = 0.0
    """Metalness, 0 to 1."""
    roughness: float = 0.0
    """Roughness, 0 to 1. 0: 0.6."""


@dataclass
class Part(Value):
    """A part: the unit that a user selects, hides or colours."""

    _struct = _abi.oc_part

    material: int = 0
    """Number of a material from oc_build_add_material. 0: the default material."""
    id: int = 0
    """The caller's own id. Must be unique in the build and not OC_NO_ID. Hits and pictures contain it."""
    parent: int = 0
    """Id of the parent part, which must have been added before. Ignored if `has_parent` is 0."""
    name: str | None = None
    """Name in UTF-8. The string is copied. NULL: no name."""
    has_parent: int = 0
    """1: the part has a parent. 0: it has none."""


@dataclass
class BuildReport(Value):
    """Statistics of a build."""

    _struct = _abi.oc_build_report

    notes: int = 0
    """Number of notes; oc_job_build_note returns them."""
    triangles_in: int = 0
    """Triangles in the input."""
    triangles_kept: int = 0
    """Triangles in the model."""
    dropped_non_finite: int = 0
    """Triangles dropped because a corner is NaN or infinite."""
    dropped_degenerate: int = 0
    """Triangles dropped because they have no area."""
    dropped_out_of_range: int = 0
    """Triangles dropped because a corner is more than 1e15 units from the origin of its mesh."""
    parts: int = 0
    """Number of parts."""
    instances: int = 0
    """Number of placed instances of shared meshes."""
    geometry_bytes: int = 0
    """Bytes that the geometry takes in memory when all of it is loaded."""
    file_bytes: int = 0
    """Size of the model file in bytes."""
    seconds_read: float = 0.0
    """Seconds spent on reading input."""
    seconds_build: float = 0.0
    """Seconds spent on building."""
    seconds_write: float = 0.0
    """Seconds spent on writing."""
    position_error: float = 0.0
    """Greatest distance between a corner of the input and the stored corner, in units of the model."""
    unusable_normals: int = 0
    """Normals of the input that are zero, NaN or infinite. The normals of their triangles replace them."""


@dataclass
class ModelInfo(Value):
    """Properties of a model."""

    _struct = _abi.oc_model_info

    up: UpAxis = UpAxis(0)
    """One of the UpAxis constants."""
    bounds_min: Vector = (0.0, 0.0, 0.0)
    """Least corner of the bounds of all triangles, in model space. Greater than `bounds_max` if there are none."""
    bounds_max: Vector = (0.0, 0.0, 0.0)
    """Greatest corner of the bounds."""
    metres_per_unit: float = 0.0
    """Length of a unit in metres. 0: unknown."""
    triangles_in: int = 0
    """Number of triangles in the input of the build."""
    triangles_stored: int = 0
    """Number of triangles stored. Triangles of shared meshes count once."""
    triangles_placed: int = 0
    """Number of triangles visible in the model. Triangles of shared meshes count once for each instance."""
    file_bytes: int = 0
    """Size of the file in bytes."""
    geometry_bytes: int = 0
    """Bytes that all nodes and triangles take in memory."""
    resident_bytes: int = 0
    """Bytes in memory now, including tables."""
    parts: int = 0
    """Number of parts."""
    instances: int = 0
    """Number of instances of shared meshes."""
    blocks: int = 0
    """Number of blocks of geometry."""
    has_colours: int = 0
    """1: triangles may have colours of their own. 0: they have the colours of their parts."""
    has_normals: int = 0
    """1: triangles may have normals at their corners that make them appear smooth. 0: each has only its own."""
    fast_form_bytes: int = 0
    """Bytes of the form for exact rays, in addition to `resident_bytes`. 0: there is none now. See
    ContextFlags.COMPACT.
    """
    proxies: int = 0
    """Number of looks from eighteen directions, see StandIns.PROXIES."""
    proxy_bytes: int = 0
    """Bytes of memory that these take, which `resident_bytes` includes."""


@dataclass
class PartInfo(Value):
    """Properties of a part of a model."""

    _struct = _abi.oc_part_info

    parent: int = 0
    """Index of the parent part. OC_NO_INDEX: it has none."""
    id: int = 0
    """Id of the part, as passed when the model was built."""
    name: str | None = None
    """Name in UTF-8; may be empty. The model owns the string: it is valid as long as the model."""
    triangles: int = 0
    """Number of the part's own triangles, without those of its child parts."""
    bounds_min: Vector = (0.0, 0.0, 0.0)
    """Least corner of the bounds of these triangles, in model space. Greater than `bounds_max` if there are none."""
    bounds_max: Vector = (0.0, 0.0, 0.0)
    """Greatest corner of the bounds."""
    colour: Vector = (0.0, 0.0, 0.0, 0.0)
    """Material: linear RGBA. Alpha is the opacity."""
    metalness: float = 0.0
    """Material: metalness, 0 to 1."""
    roughness: float = 0.0
    """Material: roughness, 0 to 1."""
    flags: PartFlags = PartFlags(0)
    """PartFlags flags, combined with `|`."""


@dataclass
class Light(Value):
    """A light. Element of an array. All zeros: a white headlight."""

    _struct = _abi.oc_light

    vector: Vector = (0.0, 0.0, 0.0)
    """World space, finite. Point light: position. Directional light: direction in which the light travels; must not
    be zero, need not be unit. Headlight: ignored.
    """
    colour: Vector = (0.0, 0.0, 0.0)
    """Linear RGB, finite and 0 or more. All 0: white."""
    intensity: float = 0.0
    """Factor of the colour, finite and 0 or more. A white matt surface that faces a light of intensity 1 is white
    (point light: at distance 1). 0: 1.
    """
    kind: LightKind = LightKind(0)
    """One of the LightKind constants."""
    shadows: int = 0
    """1: the light casts shadows. 0: it does not. A transparent part transmits the share 1 - opacity of the light,
    as it does of the surfaces seen through it.
    """


@dataclass
class Background(Value):
    """Background of a picture: a vertical gradient. All numbers must be finite and 0 or more. All zeros: black and
    transparent.
    """

    _struct = _abi.oc_background

    bottom: Vector = (0.0, 0.0, 0.0, 0.0)
    """Linear RGBA at the bottom of the picture."""
    top: Vector = (0.0, 0.0, 0.0, 0.0)
    """Linear RGBA at the top of the picture."""


@dataclass
class Look(Value):
    """Appearance of an instance or a part. All zeros: unchanged."""

    _struct = _abi.oc_look

    flags: LookFlags = LookFlags(0)
    """LookFlags flags, combined with `|`."""
    colour: Vector = (0.0, 0.0, 0.0, 0.0)
    """Linear RGBA, finite and 0 or more. Alpha is the opacity, at most 1. Ignored without LookFlags.COLOURED."""


@dataclass
class Hit(Value):
    """Closest hit of a ray. Element of an array. Members that were not requested have the values of a miss."""

    _struct = _abi.oc_hit

    t: float = 0.0
    """Distance from the origin, in units of the direction's length. Miss: infinity.

    The interval includes both ends. oc_scene_crossings finds all surfaces along a ray. (Tracing the ray again
    from behind each hit does not: of coincident surfaces it finds one, and at `t` = 0 it may return the same
    surface for ever.) Exceptions:
    - Two surfaces closer to each other than `t - t_free` may be returned in either order.
    - Within the single-precision rounding error of the origin, a surface behind the origin may be returned at 0,
      and one in front of it may be missed.
    - Within the same error of an end of the interval, a surface that the ray meets within about 4 degrees of
      edge-on may be missed.

    Precision: double with `Want.POSITION` or `Want.ERROR`, otherwise single. In single precision, the error on
    long thin triangles near the origin can exceed the last digits.
    """
    position: Vector = (0.0, 0.0, 0.0)
    """Position in world space. Miss: infinity."""
    t_free: float = 0.0
    """No original surface lies on the ray before this distance. Exceptions: surfaces that the ray meets within 0.9
    degrees of edge-on, the surface that the ray starts on, and edges that it grazes.

    - Exact hit: `t` less the possible rounding error.
    - Miss: infinity.
    - Stand-in, and a hit or a miss of a ray that entered stand-ins before: the distance at which the ray first
      entered one, less the possible rounding error. (A stand-in may transmit the ray.)
    """
    part: int = 0
    """Id of the part, as passed when the model was built. Miss: OC_NO_ID."""
    instance: int = 0
    """Id of the instance, as passed to oc_scene_add_instance. Miss: OC_NO_ID."""
    prim: int = 0
    """Index of the triangle in the input of the build, from 0. On a surface with Structure.PATCH that of the face,
    among the faces of all surfaces in the order in which they were added: the faces of a cage, or the rectangles
    between the knots of a NURBS surface. Miss: OC_NO_ID.
    """
    normal: Vector = (0.0, 0.0, 0.0)
    """Unit geometric normal in world space, on the side of the ray's origin. Miss: 0."""
    uv: Vector = (0.0, 0.0)
    """Barycentric weights of the triangle's second and third corner. On a surface with Structure.PATCH the
    parameters u and v in the face, from 0 to 1, also of a stand-in of one face: those of its middle. u runs along
    the first edge of a face of four corners; other faces consist of a quad at each corner, in which the
    parameters are (`SurfacePoint.corner` says in which). A stand-in of several faces: 0. Miss: 0.
    """
    error: float = 0.0
    """An original surface lies within this distance of `position`, in world units. Miss: 0."""
    kind: HitKind = HitKind(0)
    """One of the HitKind constants."""
    shading_normal: Vector = (0.0, 0.0, 0.0)
    """Unit normal in world space with which the surface is shaded, on the side of `normal`: interpolated between the
    corners of the triangle, so that coarse facets appear smooth. Where a model has no such normals, and for
    stand-ins, it is `normal`. Miss: 0.
    """
    occurrence: int = 0
    """Number of the place at which the mesh was hit, with Want.INSTANCE: it tells the places of one mesh in an
    instance apart, and the instances of scenes in scenes (oc_scene_get_path). It holds for the commit. Miss:
    OC_NO_ID.
    """


@dataclass
class RayF32(Value):
    """A ray in single precision, in world space."""

    _struct = _abi.oc_ray_f32

    origin: Vector = (0.0, 0.0, 0.0)
    """Start point. Not finite: the ray misses. Far from zero single precision has few digits: use Ray there."""
    t_min: float = 0.0
    """Start of the interval, as in Ray."""
    direction: Vector = (0.0, 0.0, 0.0)
    """Direction, as in Ray."""
    t_max: float = 0.0
    """End of the interval, as in Ray. 0: no end."""


@dataclass
class HitF32(Value):
    """A hit in single precision. Members that are not in `QueryF32.want` are as for a miss."""

    _struct = _abi.oc_hit_f32

    t: float = 0.0
    """Distance from the origin, in units of the direction's length. Miss: infinity."""
    normal: Vector = (0.0, 0.0, 0.0)
    """Unit geometric normal in world space, on the side of the ray's origin. Miss: 0."""
    uv: Vector = (0.0, 0.0)
    """Barycentric weights of the triangle's second and third corner. Miss: 0."""
    part: int = 0
    """The lowest 32 bits of the part's id. Miss: 0xFFFFFFFF."""
    instance: int = 0
    """The lowest 32 bits of the instance's id. Miss: 0xFFFFFFFF."""
    prim: int = 0
    """As Hit.prim. Miss: 0xFFFFFFFF."""
    kind: HitKind = HitKind(0)
    """One of the HitKind constants."""


@dataclass
class Triangle(Value):
    """A triangle with all that is stored of it. Element of an array."""

    _struct = _abi.oc_triangle

    corners: Vector = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """x, y, z of the first corner, of the second, of the third: in model space from oc_part_reader_next, in world
    space from oc_scene_triangles. The stored positions are exact in double precision, unless a transform places
    them.
    """
    part: int = 0
    """Id of the part, as passed when the model was built."""
    prim: int = 0
    """As Hit.prim."""
    normals: Vector = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Unit normals at the corners with which the surface is shaded, in the order of `corners`, on the side from
    which the corners appear counter-clockwise. Those of the triangle itself where the model has no others.
    """


@dataclass
class SurfacePoint(Value):
    """A point of a surface, in world space. Element of an array."""

    _struct = _abi.oc_surface_point

    position: Vector = (0.0, 0.0, 0.0)
    """The point of the surface, off `Hit.position` by up to the tolerance of dicing; or of the triangle, off by its
    rounding error.
    """
    du: Vector = (0.0, 0.0, 0.0)
    """First derivative by the first of `Hit.uv`. These parameters are u and v in the face on a surface with
    Structure.PATCH, otherwise the weights of the triangle's second and third corner: `du` is then the edge from
    the first to the second corner, `dv` that to the third.
    """
    dv: Vector = (0.0, 0.0, 0.0)
    """First derivative by the second of `Hit.uv`."""
    normal: Vector = (0.0, 0.0, 0.0)
    """Unit normal with which the surface is shaded, interpolated on triangles. It does not depend on the ray: it is
    on the outer side of a mesh whose corners appear counter-clockwise from outside, also where an instance is
    mirrored. Turn it to the eye by its sign with `Hit.normal`. 0 for a triangle without an area.
    """
    curvatures: Vector = (0.0, 0.0)
    """Principal curvatures in units of 1 / length, the larger one first: positive where the surface bends towards
    `normal`, so both are -1 / r on the outside of a sphere of radius r. On triangles they are those of a surface
    with the interpolated normals, which approach the true ones as triangles become finer, and 0 where the model
    has no normals.
    """
    kind: Evaluated = Evaluated(0)
    """One of the Evaluated constants."""
    corner: int = 0
    """A face with other than four corners consists, with Structure.PATCH, of a quad at each: the number of the
    corner, from 0, in whose quad the hit's parameters are. Otherwise 0.
    """


@dataclass
class Crossing(Value):
    """A point where a ray goes through an original triangle. Element of an array."""

    _struct = _abi.oc_crossing

    t: float = 0.0
    """Distance from the origin, in units of the direction's length, in double precision."""
    part: int = 0
    """Id of the part, as passed when the model was built."""
    instance: int = 0
    """Id of the instance, as passed to oc_scene_add_instance."""
    prim: int = 0
    """As Hit.prim. OC_NO_ID if `kind` is HitKind.MISSING."""
    normal: Vector = (0.0, 0.0, 0.0)
    """Unit geometric normal in world space, on the side of the ray's origin."""
    uv: Vector = (0.0, 0.0)
    """Barycentric weights of the triangle's second and third corner."""
    error: float = 0.0
    """An original surface lies within this distance of the point at `t`, in world units."""
    side: Side = Side(1)
    """The side on which the ray arrives: one of the Side constants."""
    kind: HitKind = HitKind(0)
    """HitKind.EXACT. With QueryFlags.NOW also HitKind.MISSING: the primitive id is not in memory."""


@dataclass
class TreePlace(Value):
    """A place of a tree in its model. Element of an array.

    Tree 0 holds the triangles that are placed directly; each other tree holds a shared mesh, or some of a large
    one, and has a place for each of its instances.
    """

    _struct = _abi.oc_tree_place

    model_from_tree: Vector = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Transform from the coordinates of the tree to the model, by column: x axis, y axis, z axis, origin."""
    root: int = 0
    """Id of the root of the tree."""
    tree: int = 0
    """Index of the tree."""
    first_part: int = 0
    """Index, for oc_model_get_part, of part 0 of the tree in this place: part p of a node or a triangle has index
    `first_part` + p.
    """


@dataclass
class Node(Value):
    """A node of a tree: a leaf, which has triangles, or a node with children.

    Boxes are in double precision, rounded outward, in the coordinates of the tree, see TreePlace. The box of a
    child holds all triangles below; of triangles that the build divided (see `splits` of BuildOptions) the pieces
    that are below. `bounds_min` and `bounds_max` are around the boxes of the children, or around all corners of a
    leaf.
    """

    _struct = _abi.oc_node

    tree: int = 0
    """Index of the tree."""
    child_count: int = 0
    """Number of children, at most 8. 0: the node is a leaf."""
    triangle_count: int = 0
    """Number of triangles of a leaf, at most 64. 0: the node has children."""
    leaf_children: int = 0
    """Bit i: child i is a leaf."""
    part: int = 0
    """Number, in the tree, of the part that all triangles below belong to. OC_NO_INDEX: they belong to several, or
    the model does not say. See TreePlace.
    """
    bounds_min: Vector = (0.0, 0.0, 0.0)
    """Least corner of the box."""
    bounds_max: Vector = (0.0, 0.0, 0.0)
    """Greatest corner of the box."""
    children: Vector = (0, 0, 0, 0, 0, 0, 0, 0)
    """Ids of the children. OC_NO_ID behind the last."""
    child_bounds: Vector = (0.0,) * 48
    """Boxes of the children, 6 numbers each: least x, y, z, greatest x, y, z. 0 behind the last."""


@dataclass
class NodeTriangle(Value):
    """A triangle of a leaf. Element of an array."""

    _struct = _abi.oc_node_triangle

    corners: Vector = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """x, y, z of the first corner, of the second, of the third, in the coordinates of the tree, see TreePlace. The
    stored positions are exact in double precision.
    """
    prim: int = 0
    """As Hit.prim. OC_NO_ID if it was not asked for."""
    part: int = 0
    """Number of the part in the tree, see TreePlace."""
    tree: int = 0
    """Index of the tree."""


@dataclass
class PartAt(Value):
    """A part at a point. Element of an array."""

    _struct = _abi.oc_part_at

    instance: int = 0
    """Id of the instance, as passed to oc_scene_add_instance."""
    part: int = 0
    """Id of the part, as passed when the model was built."""
    winding: int = 0
    """How many times the surface surrounds the point: 1 in a solid whose triangles face outward, -1 if they face
    inward. Without PartFlags.ORIENTED: 1. Holds.UNDECIDED: 0.
    """
    holds: Holds = Holds(1)
    """One of the Holds constants."""


@dataclass
class Overlap(Value):
    """A part that intersects a volume. Element of an array."""

    _struct = _abi.oc_overlap

    instance: int = 0
    """Id of the instance, as passed to oc_scene_add_instance."""
    part: int = 0
    """Id of the part, as passed when the model was built."""
    kind: OverlapKind = OverlapKind(1)
    """One of the OverlapKind constants."""


@dataclass
class Clash(Value):
    """A clash of two parts, or of a triangle of each. Element of an array. The first part is in the first set of the
    search and the second in the second set. If each part is in both, the part of the instance that was added
    first comes first, or the one that is first in the model.
    """

    _struct = _abi.oc_clash

    id: int = 0
    """Depends on the ids of instances, parts and triangles alone, not on which part is the first: the same clash of
    two searches has the same id.
    """
    instance: Vector = (0, 0)
    """Ids of the instances."""
    part: Vector = (0, 0)
    """Ids of the parts."""
    prim: Vector = (0, 0)
    """Indices of the triangles in the inputs of the builds, from 0. OC_NO_ID: a clash of parts."""
    first_point: Vector = (0.0, 0.0, 0.0)
    """World space. If there is a depth: the deepest point of the first part in the second, or if that reaches deeper
    into the first, the point of the first part's surface nearest to its deepest point. Clearance: the point of
    the first part that is nearest to the second. Otherwise an end of the common segment of two triangles, or a
    corner of the part inside.
    """
    second_point: Vector = (0.0, 0.0, 0.0)
    """World space. As `first_point`, of the second part; otherwise the other end of the segment, or the same corner."""
    normal: Vector = (0.0, 0.0, 0.0)
    """The direction in which the second part moves away from the first, of length 1: along both points if there is a
    depth or a distance, otherwise along the normal of a triangle there. Zero: none is known.
    """
    low: Vector = (0.0, 0.0, 0.0)
    """Least corner of the box around all common points of the parts (around both points if there are none)."""
    high: Vector = (0.0, 0.0, 0.0)
    """Greatest corner of that box."""
    depth: float = 0.0
    """The greatest distance, in world units, from a point of a part's surface that is inside of the other part to
    the other's surface; of both parts if this is a clash of two triangles. 0: it is not known, or they only
    touch.
    """
    distance: float = 0.0
    """Distance of the parts in world units. 0: they have common points, or one is inside of the other."""
    error: float = 0.0
    """Bound of the error of `depth` or `distance`. That of a depth is at most the tolerance and rounding, unless the
    search ended early after many tries.
    """
    count: int = 0
    """Number of pairs of triangles that meet. Some are counted several times in a clash of parts of a model that was
    built with spatial splits.
    """
    kind: ClashKind = ClashKind(1)
    """One of the ClashKind constants."""
    open: ClashOpenFlags = ClashOpenFlags(0)
    """ClashOpenFlags flags, combined with `|`."""


@dataclass
class ClashSummary(Value):
    """The end of a search for clashes."""

    _struct = _abi.oc_clash_summary

    is_cut: int = 0
    """1: pairs of triangles were left out, because there are more than the limit. Otherwise 0."""
    clashes: int = 0
    """Number of clashes, taken or not."""
    pairs: int = 0
    """Number of pairs of parts that clash."""


@dataclass
class NearestPoint(Value):
    """The nearest point of the surfaces of parts. Element of an array."""

    _struct = _abi.oc_nearest_point

    distance: float = 0.0
    """Distance from the point that was asked for to the nearest triangle, in world units, also from inside of a
    part. Miss: infinity.
    """
    error: float = 0.0
    """The exact distance differs from `distance` by no more than this, in world units: rounding and stored
    positions, and with HitKind.MISSING what is not in memory. Infinity: the exact distance is `distance` or more,
    and may be beyond the limit. Miss: 0.
    """
    position: Vector = (0.0, 0.0, 0.0)
    """The nearest point, world space. HitKind.MISSING without a part: the middle of a box that holds surface, or
    infinity. Miss: infinity.
    """
    instance: int = 0
    """Id of the instance, as passed to oc_scene_add_instance. OC_NO_ID: unknown, or a miss."""
    part: int = 0
    """Id of the part, as passed when the model was built. OC_NO_ID: unknown, or a miss."""
    prim: int = 0
    """As Hit.prim. OC_NO_ID: unknown, or a miss."""
    kind: HitKind = HitKind(0)
    """HitKind.EXACT. HitKind.MISS: no triangle is within the limit. HitKind.MISSING, only with NearestFlags.NOW:
    data is not in memory, so that the distance or the id of the triangle is not exact.
    """
    holds: Holds = Holds(1)
    """With NearestFlags.INSIDE one of the Holds constants if a part of the set holds the point that was asked for.
    Otherwise 0.
    """


@dataclass
class Distance(Value):
    """The distance of two sets of parts, and two points that have it. The first of two is of the first set; of one
    set, that of the instance that was added first, or of the part that is first in the model.
    """

    _struct = _abi.oc_distance

    found: int = 0
    """1: found. 0: the distance is greater than the limit, or there are no two parts. Other members are then not
    set, and `distance` is infinity.
    """
    distance: float = 0.0
    """Distance in world units. 0: triangles have a common point."""
    error: float = 0.0
    """Bound of the error of `distance`, in world units: of rounding and of stored positions. 0 if `distance` is 0."""
    first_point: Vector = (0.0, 0.0, 0.0)
    """The point of the first set, world space."""
    second_point: Vector = (0.0, 0.0, 0.0)
    """The point of the second set, world space."""
    instance: Vector = (0, 0)
    """Ids of the instances."""
    part: Vector = (0, 0)
    """Ids of the parts."""
    prim: Vector = (0, 0)
    """Indices of the triangles in the inputs of the builds, from 0."""


@dataclass
class Fit(Value):
    """The picture for which oc_scene_fit finds a camera. `width` and `height` must be set."""

    _struct = _abi.oc_fit

    kind: CameraKind = CameraKind(0)
    """Kind of the camera: one of the CameraKind constants."""
    width: int = 0
    """Width of the picture in pixels, 1 to 65536."""
    height: int = 0
    """Height of the picture in pixels, 1 to 65536."""
    view: View = View(0)
    """One of the View constants."""
    up_axis: UpAxis = UpAxis(0)
    """Up axis that `view` refers to: one of the UpAxis constants. UpAxis.UNKNOWN: +Z."""
    direction: Vector = (0.0, 0.0, 0.0)
    """View.ALONG: direction of the view, from the eye; finite and not zero, need not be unit. Otherwise ignored."""
    up: Vector = (0.0, 0.0, 0.0)
    """View.ALONG: direction that is up in the picture, not parallel to `direction`. All 0: that of `up_axis`, or of
    View.TOP or View.BOTTOM if that is parallel to `direction`. Otherwise ignored.
    """
    fov_y: float = 0.0
    """CameraKind.PERSPECTIVE: vertical field of view in degrees, above 0 and below 180. 0: 45. Otherwise ignored."""
    margin: float = 0.0
    """Share of the width and of the height that stays free on each side, below 0.5. 0: 0.05. Below 0: none."""
    flags: PartsFlags = PartsFlags(0)
    """PartsFlags flags for the chosen parts, combined with `|`, or 0."""


@dataclass
class PartRef(Value):
    """A part of an instance. Element of an array."""

    _struct = _abi.oc_part_ref

    instance: int = 0
    """Id of the instance, as passed to oc_scene_add_instance."""
    part: int = 0
    """Id of the part, as passed when the model was built. If several parts of the model have it, the first is meant.
    OC_NO_ID: all parts of the instance.
    """


@dataclass
class FrameSettings(Value):
    """Options of a request. All zeros: exact, one ray for each pixel."""

    _struct = _abi.oc_frame_settings

    samples: int = 0
    """Rays for the colour of a pixel, at most 1024. 0: 1. The other buffers take the ray through the pixel's centre."""
    poe: float = 0.0
    """Pixels of error, finite and 0 or more. A stand-in may replace triangles if its projection covers at most `poe`
    square pixels. 0 means exact.
    """
    ambient: float = 0.0
    """Intensity of the ambient light, which reaches all surfaces; finite. 0: 0.15. Below 0: none."""
    flags: FrameFlags = FrameFlags(0)
    """FrameFlags flags, combined with `|`."""
    exposure: float = 0.0
    """Factor to the light of surfaces in Buffer.COLOUR_SRGB8, finite and 0 or more. 0: 1. Backgrounds keep their
    colours, and so does Buffer.COLOUR_LINEAR.
    """


@dataclass
class Accuracy(Value):
    """Accuracy of the picture of the last request."""

    _struct = _abi.oc_frame_accuracy

    effective_poe: float = 0.0
    """The greatest threshold of a pixel, in pixels of error: `poe` of the request, or more as long as the picture
    has pixels with a raised threshold, because its data does not fit the memory budget at once. In pictures with
    a raised threshold stand-ins transmit no rays.
    """
    request: int = 0
    """Number of the request in this frame, from 1. 0: nothing was requested yet."""
    pixels_exact: int = 0
    """Pixels with an exact answer: triangles or background, without a stand-in in front."""
    pixels_lod: int = 0
    """Pixels that show a stand-in as fine as `effective_poe` requires, or a surface through such a stand-in."""
    pixels_missing: int = 0
    """Pixels that show a stand-in for missing data."""
    pixels_total: int = 0
    """Pixels of the picture in total."""
    bytes_resident: int = 0
    """Bytes in memory of the models in the scene."""
    bytes_wanted: int = 0
    """Bytes that the picture, or the present pane of it, needs and that are not in memory; 0 at the end of a picture
    that was completed pane by pane. After State.COMPLETE_WITHIN_BUDGET without panes: the data that could not be
    read or did not fit; 0 if all data for `effective_poe` is in memory.
    """
    seconds: float = 0.0
    """Seconds from the request until now, or until its end."""
    seconds_to_go: float = 0.0
    """Estimated remaining seconds at the present speed. Before the first picture: until that is ready. Later: until
    the missing data known now has arrived; data that better pictures will need is unknown. 0: nothing runs.
    Infinity: unknown.
    """
    worst_error: float = 0.0
    """Largest error in pixels. The rounding error of triangles counts only if the frame has Buffer.DEPTH or
    Buffer.ERROR.
    """
    mean_error: float = 0.0
    """Mean error in pixels, over the pixels that show a surface. Rounding errors as for `worst_error`."""
    pictures: int = 0
    """Number of complete pictures that the request has made so far. At 1 or more, one can be mapped. The first is
    made from the data in memory, each later one from more data. The very first picture of a frame waits up to 80
    ms for missing data.
    """
    state: State = State(0)
    """State of the request: one of the State constants."""


@dataclass
class Place(Value):
    """A position with a rotation and a scale. Element of an array."""

    _struct = _abi.oc_place

    position: Vector = (0.0, 0.0, 0.0)
    """Place of the origin of the model or scene in world space. Finite."""
    rotation: Vector = (0.0, 0.0, 0.0, 0.0)
    """Quaternion x, y, z, w of the rotation, applied after the scale. Finite and not zero; need not be unit."""
    scale: float = 0.0
    """Scale along all axes. Finite and not 0. Below 0 it mirrors at this origin."""


__all__ = [
    "Progress", "Camera", "Ray", "Plane", "BuildOptions", "Material", "Part", "ModelInfo", "PartInfo", "Light",
    "Background", "Look", "RayF32", "HitF32", "Triangle", "SurfacePoint", "Crossing", "TreePlace", "Node",
    "NodeTriangle", "PartAt", "Overlap", "Clash", "ClashSummary", "NearestPoint", "Distance", "Fit", "PartRef",
    "FrameSettings", "Accuracy", "Place",
]
