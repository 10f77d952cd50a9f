"""Enumerations of the C API.

This file is generated from include/outcrop.h: run `python3 generate.py`.
"""

from __future__ import annotations

import enum


class Status(enum.IntEnum):
    """Result of a call, or the reason why background work failed. Numbers are never reused. The hundreds name the
    cause:
    - 1: the calling program
    - 2: the file
    - 3: the installation
    - 4: the memory budget, or another limit
    - 5: the machine
    - 6: the library itself
    """

    OK = 0
    """Success."""
    INVALID_ARGUMENT = 100
    """The calling program: an argument is NULL, is out of its range, or belongs to another context. Nothing changed."""
    INVALID_STATE = 101
    """The calling program: the object's present state does not allow the call, or the object belongs to the parent
    process: after `fork` a child can only release it. Nothing changed.
    """
    BUFFER_TOO_SMALL = 102
    """The calling program: the array is too small. The required count was written, nothing else."""
    CANCELLED = 103
    """The calling program: the work was cancelled on request."""
    MISSING = 104
    """The calling program: the block of a node is not in memory, and a cursor with CursorFlags.NOW does not read it.
    Nothing changed.
    """
    PARSE = 200
    """The file: an input file of a build cannot be parsed."""
    CORRUPT = 201
    """The file: the model file is damaged, is not a model, or has an older format."""
    VERSION_MISMATCH = 300
    """The installation: the program was compiled with the header of another version."""
    NEWER_FORMAT = 301
    """The installation: a newer version of the library wrote the model."""
    OVER_BUDGET = 400
    """The budget: the memory budget is too small. oc_last_error_need returns the least budget that suffices."""
    OVER_LIMIT = 401
    """The limit: a build exceeds a limit of BuildOptions. oc_last_error names the limit and what exceeds it."""
    IO = 500
    """The machine: reading or writing failed, or a thread could not be started."""
    OUT_OF_MEMORY = 501
    """The machine: the system refused memory. oc_last_error names its purpose and size. Nothing changed, or the
    state is that after any other error.

    Allocations of up to 4 MiB that the system refuses come from a reserve of 32 MiB in the library. The reserve
    takes memory only while it is used. While more than half of it is taken and the system still refuses memory,
    builds, loads, queries and frames end with this status, and return what they took. Larger allocations fail by
    themselves. Exceptions, in which the process ends: many threads take the rest of the reserve between two steps
    of their work; the lists of parts, names and vertices of mesh files grow beyond 4 MiB.
    """
    INTERNAL = 600
    """The library: a defect. The object is poisoned: further calls return Status.POISONED. oc_last_error describes
    the defect; for background work the log does too. Rust's standard library also writes the description to
    standard error, because outcrop installs no panic hook (a hook would be global state).
    """
    POISONED = 601
    """The library: a defect occurred in this object before. The only valid call is the release."""


class State(enum.IntEnum):
    """State of long work."""

    IDLE = 0
    """Frames only: nothing was requested yet."""
    RUNNING = 1
    """The work runs or waits for a thread."""
    DONE = 2
    """The work has ended with the complete result, as exact as requested."""
    CANCELLED = 3
    """The work was cancelled. Do not use its outputs."""
    FAILED = 4
    """The work has failed. Do not use its outputs."""
    COMPLETE_WITHIN_BUDGET = 5
    """The work has ended with a part of the result: all that fits the memory budget or can be read. Only frames and
    prefetches end so. The picture of such a frame is coarser than requested; oc_frame_get_accuracy returns by how
    much.
    """


class Phase(enum.IntEnum):
    """Phase of a build or load."""

    WAITING = 0
    """The work has not begun, or it is neither a build nor a load."""
    READ = 1
    """Reading the input, or the model."""
    BUILD = 2
    """Building trees."""
    WRITE = 3
    """Encoding and writing blocks."""
    SEAL = 4
    """Flushing the file to the disk and giving it its name."""
    DONE = 5
    """The work has ended."""


class LogLevel(enum.IntEnum):
    """Severity of a log line."""

    ERROR = 1
    """An operation failed."""
    WARNING = 2
    """Something is wrong, but the operation continues."""
    INFO = 3
    """Information for users."""
    DEBUG = 4
    """Information for developers."""


class InstructionSet(enum.IntEnum):
    """Set of vector instructions."""

    BEST = 0
    """The best set that the machine has."""
    BASELINE = 1
    """The set that every machine of this architecture has."""
    AVX2 = 2
    """AVX2."""
    AVX512 = 3
    """AVX-512."""


class ContextFlags(enum.IntFlag):
    """Flags of ContextDesc."""

    NO_READ_AHEAD = 1
    """The library reads only the data that frames and queries need. Without this flag it also reads the geometry and
    colours of a model that fits the memory budget, in the background, while nothing more urgent waits to be read.
    Primitive ids are read only on request.
    """
    COMPACT = 2
    """Models only have their compact form in memory. Without this flag a model that is in memory as a whole also
    gets a form in which exact rays are traced faster, made in the background. It takes some 50 to 70 bytes for
    each triangle, as far as `memory_budget` has room, and is given back when other data needs the room. Answers
    and pictures are the same.
    """


class Property(enum.IntEnum):
    """Property of a context."""

    VERSION = 1
    """Version of the library, in the format of OC_HEADER_VERSION."""
    THREADS = 2
    """Number of the library's own threads."""
    CONCURRENCY = 3
    """Number of threads, the library's or the host's, that may work at once."""
    MEMORY_BUDGET = 4
    """Memory budget in bytes."""
    INSTRUCTION_SET = 5
    """Vector instructions in use: one of the InstructionSet constants."""
    MAX_FRAME_SIZE = 6
    """Largest width and height of a frame, in pixels."""
    FORMAT = 7
    """Newest format of model files that the library reads: major * 65536 + minor."""
    MEMORY_USED = 8
    """Bytes of the memory budget that are in use now."""


class CameraKind(enum.IntEnum):
    """Kind of a camera."""

    PERSPECTIVE = 0
    """All rays start at the eye."""
    ORTHOGRAPHIC = 1
    """Parallel rays start on a plane through the eye. Nothing behind the plane is visible."""


class Structure(enum.IntEnum):
    """Acceleration structure of a model."""

    DEFAULT = 0
    """The library chooses. At present Structure.BVH."""
    BVH = 1
    """A wide, quantised bounding volume hierarchy. Surfaces are diced into triangles."""
    PATCH = 4
    """Surfaces as grids under quadtrees of quantised boxes, about a byte of memory for each triangle that they are
    diced into, if each face has some ten thousand; some ten if a face has hundreds (see `surface_leaves`).
    Triangles as with Structure.BVH.

    Hit.prim of a hit on a surface is the face, in the order in which the faces of all surfaces were added. The
    error of exact hits includes `surface_tolerance`. Surfaces keep their own normals if `crease_angle` is below 0
    too. Rays are traced one by one, also those of pictures.
    """


class Splits(enum.IntEnum):
    """Spatial splits: a triangle may be referenced by several leaves. This speeds up models with long thin
    triangles.
    """

    AUTO = 0
    """Split if it speeds up the model."""
    OFF = 1
    """Never split."""
    ON = 2
    """Always split."""


class Resolution(enum.IntEnum):
    """Answer of oc_resolve_fn."""

    DEFAULT = 0
    """The library looks for the file, by the rule of `trusted_folder` in BuildOptions."""
    BYTES = 1
    """The content of the file is at `bytes`."""
    PATH = 2
    """The file at `path` is read, wherever it is."""
    REFUSED = 3
    """The file must not be read."""


class StandIns(enum.IntEnum):
    """The look of stand-ins: what a picture shows for geometry that is small or not in memory."""

    AUTO = 0
    """The library chooses. At present StandIns.VOXELS."""
    VOXELS = 1
    """Each cell has a look of its own, from the sides of its box."""
    PROXIES = 2
    """Subtrees of some hundred triangles have a look from eighteen directions, which all cells in them show. These
    looks are always in memory and count in the budget: about 0.3 bytes for each triangle.
    """


class SurfaceLeaves(enum.IntEnum):
    """The leaves of surfaces with Structure.PATCH: how rays that stand-ins do not serve find their triangles."""

    AUTO = 0
    """The library chooses. At present SurfaceLeaves.BOXES."""
    BOXES = 1
    """Boxes alone are stored: the triangles are computed from the control points where a ray comes to them, at about
    a byte of memory for each triangle. Displaced surfaces, surfaces of degrees above 3, and small squares at
    vertices where the surface is no polynomial have facets.
    """
    FACETS = 2
    """The vertices of all triangles are stored, about seven bytes for each triangle: rays find them sooner."""


class Scalar(enum.IntEnum):
    """Type of coordinates."""

    F32 = 0
    """float."""
    F64 = 1
    """double."""


class Index(enum.IntEnum):
    """Type of indices."""

    NONE = 0
    """No indices: each three successive corners are a triangle."""
    U32 = 1
    """uint32_t."""
    U64 = 2
    """uint64_t."""


class Boundary(enum.IntEnum):
    """Where a subdivision surface ends."""

    EDGES = 0
    """Its boundary is a smooth curve along the boundary edges of the cage."""
    EDGES_AND_CORNERS = 1
    """Likewise, and the curve passes through boundary vertices that are in one face only."""
    NONE = 2
    """Faces at the boundary of the cage are no surface: they only shape their neighbours."""


class Creasing(enum.IntEnum):
    """Sharpness of creases after a subdivision."""

    UNIFORM = 0
    """One less than before."""
    CHAIKIN = 1
    """Chaikin's rule: one less than a mean over the edges of the crease that follow each other."""


class TriangleRule(enum.IntEnum):
    """Rule for triangles in a cage."""

    CATMULL_CLARK = 0
    """That of all faces."""
    SMOOTH = 1
    """Weights with which regular triangles become smoother surfaces."""


class Wrap(enum.IntEnum):
    """Texels beyond the border of a map."""

    REPEAT = 0
    """The map repeats."""
    CLAMP = 1
    """The border continues."""


class UpAxis(enum.IntEnum):
    """Axis that points up."""

    UNKNOWN = 0
    """Unknown. The views of oc_model_get_view and oc_scene_fit then take +Z."""
    X = 1
    """+X."""
    Y = 2
    """+Y (glTF)."""
    Z = 3
    """+Z (most CAD)."""


class PartFlags(enum.IntFlag):
    """Flags of a part."""

    CLOSED = 1
    """The part's own triangles form a closed surface: each edge belongs to an even number of them. Rays cross the
    part an even number of times. The stored positions decide, and triangles without area count.
    """
    ORIENTED = 2
    """The surface is closed, and its triangles face one way: each edge is passed as often in one direction as in the
    other. Rays leave the part as often as they enter it. A part that is closed without this flag has triangles
    that face the wrong way, or has no inside.
    """


class PlacementFlags(enum.IntFlag):
    """Flags of oc_model_get_placement."""

    UP_UNKNOWN = 1
    """The model does not say which axis is up: it was not turned."""
    UNIT_UNKNOWN = 2
    """The model does not say how long its unit is: it was not scaled."""


class LightKind(enum.IntEnum):
    """Kind of a light."""

    HEAD = 0
    """At the eye. No falloff, no shadows."""
    POINT = 1
    """At a point. Its light falls off with the square of the distance."""
    DIRECTIONAL = 2
    """Infinitely far away."""


class TransformForm(enum.IntEnum):
    """Form of the transforms of an array, from the space of a model or a scene to world space."""



class LookFlags(enum.IntFlag):
    """Flags of Look: how an instance or a part is shown."""

    HIDDEN = 1
    """Hidden: no ray hits it. A part of opacity 0 looks the same, but rays hit it: hide the parts that picks and
    queries must not return.
    """
    SELECTED = 2
    """Highlighted."""
    COLOURED = 4
    """Shown in the colour of Look instead of its own."""


class PartsFlags(enum.IntFlag):
    """Flags of a choice of parts."""

    BELOW = 1
    """The parts below the given parts are meant too: all parts whose chain of parents leads to one of them."""


class Want(enum.IntFlag):
    """Flags: members of Hit to compute, combined with `|`. Fewer members take less time."""

    T = 1
    """Only `t` and `kind`, which are always set."""
    POSITION = 2
    """`position`."""
    NORMAL = 4
    """`normal`."""
    UV = 8
    """`uv`."""
    PART = 16
    """`part`."""
    INSTANCE = 32
    """`instance`."""
    PRIM = 64
    """`prim`. May have to read the disk."""
    ERROR = 128
    """`error` and `t_free`; `t` in double precision."""
    ALL = 255
    """All members but `shading_normal`."""
    SHADING_NORMAL = 256
    """`shading_normal`. May have to read the disk."""


class QueryFlags(enum.IntFlag):
    """Flags of Query."""

    COHERENT = 1
    """Hint: each 32 successive rays start near each other and have similar directions. They are traced as one
    packet, which is faster. The answers do not change. Without the flag, the library recognises rays of
    neighbouring pixels if they enter few placed meshes.
    """
    NOW = 2
    """Answer at once from the data in memory. Stand-ins replace missing data; their hits are HitKind.MISSING. The
    call neither reads nor requests data (oc_scene_prefetch_box does). Without the flag, the call reads all data
    that it needs, and the answers do not depend on the data in memory.
    """


class HitKind(enum.IntEnum):
    """Kind of a hit."""

    MISS = 0
    """No hit between t_min and t_max, or stand-ins in the interval transmitted the ray (see `t_free`)."""
    EXACT = 1
    """Hit on an original triangle, of any opacity (also 0), unless its part or instance is hidden."""
    LOD = 2
    """Hit on a stand-in as fine as the ray's cone requires: a cell that contains original surface.
    - `t`: where the ray enters the cell.
    - `normal`: mean normal of the surface visible there.
    - `part`: the part with the largest visible area, over all directions.
    - `uv`, `prim`: as for a miss.

    A cell may hold several instances: `part`, `instance` and `occurrence` are then those of the one with the
    largest visible area. A cell with wires, leaves or the like is a partly open stand-in: it transmits the same
    share of rays as its content does (see `t_free`).
    """
    MISSING = 3
    """Hit on a stand-in that is coarser than required, because the data below it is not in memory. Only frames and
    QueryFlags.NOW return it. Members as for HitKind.LOD.

    An exact hit whose primitive id was requested (Want.PRIM, part of the default) but is not in memory has this
    kind too. Its other members are those of the exact hit; `prim` is OC_NO_ID.

    Exception: if the ray starts inside of the cell, `t` is where it leaves the cell and `t_free` is t_min: the
    cell may contain surface anywhere.
    """


class Evaluated(enum.IntEnum):
    """Where the members of SurfacePoint come from."""

    NOTHING = 0
    """The hit is a miss: `position` is infinite, all other members are 0."""
    SURFACE = 1
    """The surface, evaluated at the parameters of the hit."""
    TRIANGLE = 2
    """A triangle, and the normals at its corners."""
    STAND_IN = 3
    """The hit is HitKind.LOD: `position` and `normal` are those of the hit, all other members are 0."""
    MISSING = 4
    """The hit is HitKind.MISSING, or with QueryFlags.NOW the data of its triangle is not in memory. Members as for
    Evaluated.STAND_IN.
    """


class Side(enum.IntEnum):
    """The side of a triangle."""

    FRONT = 1
    """The side from which the corners appear counter-clockwise. There a ray enters a solid whose triangles face
    outward.
    """
    BACK = 2
    """The other side, where a ray leaves such a solid."""


class CursorFlags(enum.IntFlag):
    """Flags of oc_cursor_create."""

    NOW = 1
    """The cursor never reads. A call that needs a block which is not in memory returns Status.MISSING."""


class Holds(enum.IntEnum):
    """The relation of a part to a point."""

    INSIDE = 1
    """The part is closed (PartFlags.CLOSED), and the point is inside."""
    UNDECIDED = 2
    """The part is not closed, and the point is within its bounds: nothing says whether it is inside."""


class OverlapKind(enum.IntEnum):
    """How a part intersects a volume."""

    INTERSECTS = 1
    """Some of the part is inside the volume or touches it."""
    INSIDE = 2
    """All of the part is inside the volume."""


class ClashDetail(enum.IntEnum):
    """Results of a search for clashes."""

    PARTS = 0
    """One clash for each pair of parts. The default."""
    TRIANGLES = 1
    """One clash for each pair of triangles that meet, and one for each pair of parts without such."""


class ClashSkipFlags(enum.IntFlag):
    """Flags: pairs of parts that are not compared."""

    SAME_MODEL = 1
    """Pairs in instances of one model."""
    SAME_INSTANCE = 2
    """Pairs in one instance."""
    SAME_PARENT = 4
    """Pairs in one instance whose parts have the same parent part, or both have none."""
    SAME_MATERIAL = 8
    """Pairs of one model whose parts have equal materials."""


class ClashKind(enum.IntEnum):
    """The way in which two parts clash."""

    CROSSING = 1
    """Their surfaces cross. How deep is not known: the tolerance is 0, a part is not closed, or the triangles of
    both parts do not fit the budget.
    """
    COPLANAR = 2
    """Their surfaces overlap in a plane, and do not cross. The parts may lie against each other or in one another:
    that is not known, for the same reasons.
    """
    TOUCHING = 3
    """Their surfaces have common points, and do not cross or overlap. With a tolerance: neither closed part reaches
    deeper into the other than that.
    """
    CLEARANCE = 4
    """They are apart, and their distance is at most the clearance, within `Clash.error`."""
    HARD = 5
    """Both are closed, and one reaches deeper into the other than the tolerance."""
    PIERCING = 6
    """As ClashKind.HARD, and one goes through the other, like a rod through a plate: its surface outside of the
    other is in several pieces. Decided by edges of triangles and their ends.
    """
    CONTAINED = 7
    """One part is inside of the other, which is closed. With tolerance 0, their surfaces have no point in common.
    With a tolerance, it is deeper inside than that, and its surface is nowhere farther outside than about that.
    """
    DUPLICATE = 8
    """With a tolerance: both are closed, and each surface is nowhere farther from the other than about that."""


class ClashOpenFlags(enum.IntFlag):
    """Flags: parts of a clash that are not closed."""

    FIRST = 1
    """The first part is not closed: nothing is known of its inside."""
    SECOND = 2
    """The second part is not closed."""


class NearestFlags(enum.IntFlag):
    """Flags of NearestDesc."""

    INSIDE = 1
    """Fill `NearestPoint.holds`: whether a part of the set holds the point. Not together with NearestFlags.NOW."""
    NOW = 2
    """Answer at once from the data in memory. The exact distance is within `NearestPoint.error` of each answer. The
    call neither reads nor requests data (oc_scene_prefetch_box does). Without the flag, the call reads all data
    that it needs, and the answers do not depend on the data in memory.
    """


class View(enum.IntEnum):
    """Direction of a view, relative to an up axis. Front is the side towards -Y if Z is up, +Z if Y is up, +Y if X
    is up. Left and right are as seen from the front.
    """

    ISO_FRONT_RIGHT = 0
    """From the front, the right and above, all three at the same angle."""
    ISO_FRONT_LEFT = 1
    """From the front, the left and above."""
    ISO_BACK_RIGHT = 2
    """From the back, the right and above."""
    ISO_BACK_LEFT = 3
    """From the back, the left and above."""
    FRONT = 4
    """From the front."""
    BACK = 5
    """From the back."""
    LEFT = 6
    """From the left."""
    RIGHT = 7
    """From the right."""
    TOP = 8
    """From above. The back is up in the picture."""
    BOTTOM = 9
    """From below. The front is up in the picture."""
    ALONG = 10
    """Along `direction` of Fit."""


class Buffer(enum.IntEnum):
    """Buffer of a picture. The first row is the top one, the first pixel of a row the left one."""

    COLOUR_SRGB8 = 0
    """4 bytes: red, green and blue in sRGB, and linear alpha."""
    COLOUR_LINEAR = 1
    """4 floats: linear RGB, not clamped, and alpha."""
    DEPTH = 2
    """1 float: distance from the eye along the view direction, in world units. Miss: infinity."""
    NORMAL = 3
    """3 floats: unit geometric normal in world space, on the side of the eye. Miss: 0."""
    PART = 4
    """1 uint64_t: id of the part. Miss: OC_NO_ID."""
    PRIM = 5
    """1 uint64_t: as Hit.prim. OC_NO_ID for a miss, for a stand-in, and in early pictures for a triangle whose id is
    not read yet.
    """
    INSTANCE = 6
    """1 uint64_t: id of the instance. Miss: OC_NO_ID."""
    KIND = 7
    """1 byte: one of the HitKind constants."""
    ERROR = 8
    """1 float: an original surface lies within this distance of the surface shown, in world units. Infinity if
    stand-ins have transmitted the ray to a triangle or to the background: an original surface may lie anywhere
    before it.
    """
    SHADING_NORMAL = 9
    """3 floats: unit normal in world space with which the surface is shaded, see `Hit.shading_normal`. Miss: 0."""
    OCCURRENCE = 10
    """1 uint64_t: number of the place where the mesh of an instance was met, by a triangle or a stand-in, below
    2^63; see `Hit.occurrence`. oc_scene_get_path returns the ids on the way there. It holds for the commit that
    the picture shows: after a later commit of the scene it may stand for another place, or for none. Miss:
    OC_NO_ID.
    """
    UV = 11
    """2 floats: as Hit.uv of the ray through the pixel's centre. Miss: 0."""


class FrameFlags(enum.IntFlag):
    """Flags of FrameSettings."""

    AT_ONCE = 1
    """If the data of the picture does not fit the memory budget at once, the request ends with the picture that
    does, as State.COMPLETE_WITHIN_BUDGET. That picture has one threshold, `effective_poe`, and may be coarser in
    places than those before. The threshold may depend on earlier views. Without this flag the request goes on
    until the picture is as requested, whatever was seen before.
    """
    EXACT_COLOURS = 2
    """Each value in Buffer.COLOUR_SRGB8 is the level nearest to that in Buffer.COLOUR_LINEAR times `exposure`.
    Without this flag:
    - Linear values of surfaces above 0.8 are compressed so that they stay below white, and bright parts keep
      their shading. Values up to 0.8 and backgrounds stay as they are.
    - Gradients are dithered, so that they have no bands: a value between two levels becomes one or the other, by
      an ordered pattern that depends only on the place of the pixel. A colour that is a level stays that level
      everywhere.
    """


class Format(enum.IntEnum):
    """Type of the elements of a buffer."""

    U8X4 = 1
    """4 bytes."""
    F32X4 = 2
    """4 floats."""
    F32 = 3
    """1 float."""
    F32X3 = 4
    """3 floats."""
    U64 = 5
    """1 uint64_t."""
    U8 = 6
    """1 byte."""
    F32X2 = 7
    """2 floats."""


__all__ = [
    "Status", "State", "Phase", "LogLevel", "InstructionSet", "ContextFlags", "Property", "CameraKind", "Structure",
    "Splits", "Resolution", "StandIns", "SurfaceLeaves", "Scalar", "Index", "Boundary", "Creasing", "TriangleRule",
    "Wrap", "UpAxis", "PartFlags", "PlacementFlags", "LightKind", "TransformForm", "LookFlags", "PartsFlags", "Want",
    "QueryFlags", "HitKind", "Evaluated", "Side", "CursorFlags", "Holds", "OverlapKind", "ClashDetail",
    "ClashSkipFlags", "ClashKind", "ClashOpenFlags", "NearestFlags", "View", "Buffer", "FrameFlags", "Format",
]
