"""Builds: meshes become a model file."""

from __future__ import annotations

import ctypes as c
import os
from numbers import Integral
from collections.abc import Callable
from typing import Any, Union

import numpy
from numpy.typing import ArrayLike

from . import _abi, _values
from ._arrays import Array, address, given, integers, matrix, vectors
from ._arrays import faces as checked_faces
from ._callbacks import Entry, callback, find, forget, register
from ._enums import Boundary, Creasing, Index, Resolution, Scalar, Status, TriangleRule, Wrap
from ._handles import Handle, Reference, made
from ._jobs import Job, release_job
from ._library import lib
from ._meshes import Mesh, check_placements
from ._value import text, whole
from ._values import BuildOptions, Material, Progress

Resolved = Union[None, bytes, str, "os.PathLike[str]", Resolution]
"""Answer of a resolver. None: the library looks for the file by its rules. bytes: the content. A path: that file is
read, wherever it is. Resolution.REFUSED: the file must not be read."""

Resolver = Callable[[str, str], Resolved]
"""Finds a file that a mesh file refers to: receives its name and the path of the file that names it. An OSError counts
as a file that cannot be read. Any other exception ends the build, and the wait raises it."""


class BuildReport(_values.BuildReport):
    """Statistics of a build, with its notes: warnings about input that could be read nevertheless."""

    texts: tuple[str, ...] = ()
    """The notes."""


class _Resolving:
    """A resolver while a build uses it. `error` is its last exception."""

    def __init__(self, resolver: Resolver) -> None:
        self._resolver = resolver
        self.error: BaseException | None = None

    def take_error(self) -> BaseException | None:
        """Returns the last exception once."""
        error, self.error = self.error, None
        return error

    def answer(self, uri: str, file: str, out: Any) -> int:
        """Asks the resolver and fills the struct. Returns the status."""
        try:
            found = self._resolver(uri, file)
            if isinstance(found, Resolution):
                out.kind = found
            elif isinstance(found, (bytes, bytearray, memoryview)):
                content = bytes(found)
                out.kind, out.size = Resolution.BYTES, len(content)
                out.bytes = c.cast(c.c_char_p(content), c.c_void_p)
                out.release, out.release_user = RELEASE, register(content)
            elif found is not None:
                path = c.create_string_buffer(os.fsencode(found))
                out.kind, out.path = Resolution.PATH, c.cast(path, c.c_char_p)
                out.release, out.release_user = RELEASE, register(path)
        except OSError:
            return Status.IO
        except BaseException as error:  # noqa: BLE001 # it must not go through C
            self.error = error
            return Status.CANCELLED
        return Status.OK


def _resolve(user: int, uri: bytes, file: bytes, out: int) -> int:
    """Asks a resolver for the library."""
    resolving: _Resolving | None = find(user)
    if resolving is None:
        return int(Status.CANCELLED)
    return int(resolving.answer(os.fsdecode(uri), os.fsdecode(file), _abi.oc_resolved.from_address(out)))


RESOLVE = _abi.oc_resolve_fn(callback(_resolve))


def _release(user: int) -> None:
    """Frees the answer of a resolver."""
    forget(user)


RELEASE = _abi.oc_release_fn(callback(_release))


class BuildJob(Job[BuildReport]):
    """A build in flight. Its result is the report."""

    _release = release_job

    def __init__(self, address: int | None, build: Reference, resolving: _Resolving | None) -> None:
        super().__init__(address, build, _report)
        self._resolving = resolving

    def wait(self, timeout: float | None = None, progress: Callable[[float], object] | None = None) -> Progress:
        """Waits as `Job.wait` does. Raises the exception of the resolver, if it raised one."""
        try:
            return super().wait(timeout, progress)
        except Exception:
            # The traceback of what is raised refers to this job: the table of callbacks must not keep it.
            if self._resolving is not None and (error := self._resolving.take_error()) is not None:
                raise error from None
            raise


def _report(job: Reference, _progress: Progress) -> BuildReport:
    """Returns the report of a finished build."""
    struct = _abi.oc_build_report()
    lib.oc_job_build_report(job, c.byref(struct))
    report = BuildReport._from_c(struct)
    texts = []
    for index in range(report.notes):
        note = c.c_char_p()
        lib.oc_job_build_note(job, index, c.byref(note))
        texts.append((note.value or b"").decode("utf-8", "replace"))
    report.texts = tuple(texts)
    return report


def _rows(name: str, value: ArrayLike | None, count: int, of: str) -> Array | None:
    """Returns float32 rows, one for each of `count`, or None."""
    if value is None:
        return None
    rows = vectors(name, value).astype("f4", copy=False)
    if len(rows) != count:
        raise ValueError(f"{name}: expected shape ({count}, 3), one for each {of}, not {given(rows)}")
    return rows


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...], dtype: Any = numpy.uint32) -> Array:
    """Returns packed unsigned integers of a shape, in which -1 is any number."""
    array = integers(name, value)
    if array.size == 0:
        return numpy.zeros([max(side, 0) for side in shape], dtype)
    if array.ndim != len(shape) or any(side not in (-1, is_) for side, is_ in zip(shape, array.shape)):
        sides = ", ".join("N" if side < 0 else str(side) for side in shape)
        raise ValueError(f"{name}: expected shape ({sides}{',' if len(shape) == 1 else ''}), not {given(array)}")
    most = numpy.iinfo(dtype).max
    if array.max() > most:
        raise ValueError(f"{name}: {array.max()} is above {most}")
    return numpy.ascontiguousarray(array, dtype)


def _sharpness(name: str, value: ArrayLike, count: int) -> Array:
    """Returns packed float32 numbers: one for each of `count`, of which `value` may be a common one."""
    array = numpy.asarray(value, numpy.float32)
    if array.ndim > 0 and array.shape != (count,):
        raise ValueError(f"{name}: expected one number, or shape ({count},), not {given(array)}")
    return numpy.ascontiguousarray(numpy.broadcast_to(array, (count,)))


def _displacement(heights: ArrayLike | None, coordinates: ArrayLike | None,
                  corners: int) -> tuple[Any, tuple[Array, ...]]:
    """Returns the struct of a displacement, or None, and the arrays that it points to."""
    if heights is None:
        if coordinates is not None:
            raise ValueError("coordinates: there are no heights")
        return None, ()
    texels = numpy.ascontiguousarray(heights, numpy.float32)
    if texels.ndim != (3 if coordinates is None else 2):
        raise ValueError(f"heights: expected shape {'(M, H, W)' if coordinates is None else '(H, W)'}, "
                         f"not {given(texels)}")
    moved = _abi.oc_displacement(width=texels.shape[-1], height=texels.shape[-2],
                                 map_count=1 if texels.ndim == 2 else len(texels), texels=address(texels))
    if coordinates is None:
        return moved, (texels,)
    at = numpy.ascontiguousarray(coordinates, numpy.float32)
    if at.shape != (corners, 2):
        raise ValueError(f"coordinates: expected shape ({corners}, 2), one for each corner, not {given(at)}")
    moved.coordinates = address(at)
    return moved, (texels, at)


class Build(Handle):
    """A model under construction, made by `Context.new_build`: add meshes, then `start`.

    `Context.build` does all of this for most models.
    """

    _kind = "Build"
    _release = lib.oc_build_release

    def __init__(self, context: Reference, options: BuildOptions | None, resolve: Resolver | None) -> None:
        desc = (options or BuildOptions())._to_c()
        self._resolving = _Resolving(resolve) if resolve is not None else None
        entry = Entry(self._resolving) if resolve is not None else None
        if entry is not None:
            desc.resolve, desc.resolve_user = RESOLVE, entry.key
        super().__init__(made(lib.oc_build_create, context, c.byref(desc)), context)
        self._h.keep.append(entry)
        self._ids: set[int] = set()

    def add_file(self, path: str | os.PathLike[str]) -> None:
        """Adds a file: PLY, OBJ, STL, glTF, GLB, raw, BPT, NURBS faces. The job reads it and reports errors."""
        lib.oc_build_add_file(self._h, os.fsencode(path))

    def add_material(self, material: Material) -> int:
        """Adds a material. Returns its number, from 1; 0 is the default material."""
        number = c.c_uint32()
        lib.oc_build_add_material(self._h, c.byref(material._to_c()), c.byref(number))
        return number.value

    def add_part(self, name: str | None = None, *, id: int | None = None, parent: int | None = None,
                 material: int | Material = 0) -> int:
        """Adds a part: the unit that a user selects, hides or colours. Returns its id.

        id: your own, unique in the build. None: the next free one.
        parent: id of the parent part, which must have been added before.
        material: a material, or its number from `add_material`.
        """
        number = self._next_id() if id is None else whole("id", id)
        if isinstance(material, Material):
            material = self.add_material(material)
        part = _abi.oc_part(material=whole("material", material, 32), id=number, name=text("name", name))
        if parent is not None:
            part.parent, part.has_parent = whole("parent", parent), 1
        lib.oc_build_add_part(self._h, c.byref(part))
        self._ids.add(number)
        return number

    def _next_id(self) -> int:
        """Counts from 0, as the library does for the parts of files, which follow: ids then do not meet."""
        return max(self._ids, default=-1) + 1

    def add_triangles(self, part: int, vertices: ArrayLike, faces: ArrayLike | None = None, *,
                      colours: ArrayLike | None = None, normals: ArrayLike | None = None,
                      vertex_colours: ArrayLike | None = None, mesh: int = 0) -> None:
        """Adds triangles of one part from arrays, without a copy in Python.

        part: id of the part; with `mesh`, the number of the part in the shared mesh, from 0.
        vertices: (N, 3) float32 or float64; rows may lie apart.
        faces: (M, 3) integers below N, or None: each three vertices are a triangle.
        colours: (M, 3) linear RGB, one for each triangle, or None: the colour of the part.
        normals: (N, 3), one for each vertex, of any length, or None: `BuildOptions.crease_angle` decides.
        vertex_colours: (N, 3) linear RGB, one for each vertex, which are interpolated; in place of `colours`.
        mesh: number of a shared mesh, or 0: the triangles are placed directly.

        Raises:
            ValueError, TypeError: an array has another shape, dtype or layout. Nothing was added.
        """
        corners = vectors("vertices", vertices)
        scalar = Scalar.F64 if corners.dtype.itemsize == 8 else Scalar.F32
        triangles = _abi.oc_triangles(part=whole("part", part), mesh=whole("mesh", mesh, 32), scalar=scalar,
                                      positions=address(corners), position_count=len(corners),
                                      position_stride=corners.strides[0] if len(corners) > 1 else 0)
        indices = None
        if faces is not None:
            indices = checked_faces("faces", faces, len(corners))
            triangles.indices, triangles.index_count = address(indices), indices.size
            triangles.index = Index.U64 if indices.dtype.itemsize == 8 else Index.U32
        elif len(corners) % 3:
            raise ValueError(f"vertices: without faces, each three are a triangle, but there are {len(corners)}")
        count = len(corners) // 3 if indices is None else len(indices)
        shades = _rows("colours", colours, count, "triangle")
        if shades is not None:
            triangles.colours, triangles.colour_stride = address(shades), shades.strides[0]
        directions = _rows("normals", normals, len(corners), "vertex")
        if directions is not None:
            triangles.normals, triangles.normal_stride = address(directions), directions.strides[0]
        tints = _rows("vertex_colours", vertex_colours, len(corners), "vertex")
        if tints is not None:
            triangles.position_colours, triangles.position_colour_stride = address(tints), tints.strides[0]
        lib.oc_build_add_triangles(self._h, c.byref(triangles))

    def add_cage(self, part: int | ArrayLike, vertices: ArrayLike, faces: ArrayLike,
                 face_sizes: ArrayLike | None = None, *, creases: ArrayLike | None = None,
                 crease_sharpness: ArrayLike = 10.0, corners: ArrayLike | None = None,
                 corner_sharpness: ArrayLike = 10.0, holes: ArrayLike | None = None,
                 boundary: Boundary = Boundary.EDGES, creasing: Creasing = Creasing.UNIFORM,
                 triangle_rule: TriangleRule = TriangleRule.CATMULL_CLARK, heights: ArrayLike | None = None,
                 coordinates: ArrayLike | None = None, scale: float = 1.0, wrap: Wrap = Wrap.REPEAT,
                 mesh: int = 0) -> None:
        """Adds a Catmull-Clark subdivision surface by its cage.

        It is diced into triangles as finely as `BuildOptions.surface_tolerance` or `surface_level` asks for.

        part: id of the part, or one for each face; with `mesh`, numbers of parts in the shared mesh, from 0.
        vertices: (N, 3) float32 or float64; rows may lie apart.
        faces: (M, 4) integers below N; with `face_sizes`, the corners of all faces one after the other.
        face_sizes: (M,) integers from 3 on.
        creases: (K, 2) vertices at the ends of sharp edges.
        crease_sharpness: one for all, or one for each: 0 is smooth, 10 or more stays sharp for ever.
        corners: (K,) sharp vertices, with `corner_sharpness`.
        holes: (K,) faces that are no surface.
        heights: (H, W) map of heights by which the surface is moved along its normal, times `scale`; (M, H, W) without
            coordinates: a map for each face, along its sides.
        coordinates: (K, 2) s and t in the map at each corner of each face, in the order of `faces`.
        mesh: number of a shared mesh, or 0: the surface is placed directly.

        Raises:
            ValueError, TypeError: an array has another shape, dtype or layout. Nothing was added.
        """
        points = vectors("vertices", vertices)
        counted = None if face_sizes is None else _numbers("face_sizes", face_sizes, (-1,))
        indices = _numbers("faces", faces, (-1, 4) if counted is None else (-1,))
        count = len(indices) if counted is None else len(counted)
        cage = _abi.oc_cage(mesh=whole("mesh", mesh, 32), positions=address(points), position_count=len(points),
                            position_stride=points.strides[0] if len(points) > 1 else 0,
                            scalar=Scalar.F64 if points.dtype.itemsize == 8 else Scalar.F32, face_count=count,
                            indices=address(indices), index_count=indices.size, boundary=boundary,
                            creasing=creasing, triangle_rule=triangle_rule)
        if counted is not None:
            cage.face_sizes = address(counted)
        parts = None
        if isinstance(part, Integral):
            cage.part = whole("part", part)
        else:
            parts = _numbers("part", part, (count,), numpy.uint64)
            cage.face_parts = address(parts)
        edges = _numbers("creases", [] if creases is None else creases, (-1, 2))
        sharp_edges = _sharpness("crease_sharpness", crease_sharpness, len(edges))
        cage.creases, cage.crease_sharpness, cage.crease_count = address(edges), address(sharp_edges), len(edges)
        points_of = _numbers("corners", [] if corners is None else corners, (-1,))
        sharp = _sharpness("corner_sharpness", corner_sharpness, len(points_of))
        cage.corners, cage.corner_sharpness, cage.corner_count = address(points_of), address(sharp), len(points_of)
        empty = _numbers("holes", [] if holes is None else holes, (-1,))
        cage.holes, cage.hole_count = address(empty), len(empty)
        moved, kept = _displacement(heights, coordinates, indices.size)
        if moved is not None:
            moved.scale, moved.wrap_s, moved.wrap_t = scale, wrap, wrap
            cage.displacement = c.pointer(moved)
        lib.oc_build_add_cage(self._h, c.byref(cage))
        del kept

    def add_nurbs(self, part: int, points: ArrayLike, knots_u: ArrayLike, knots_v: ArrayLike, *,
                  weights: ArrayLike | None = None, reversed: bool = False, mesh: int = 0) -> None:
        """Adds a NURBS surface without trims, of degrees that follow from the numbers of points and knots.

        It is diced into triangles as `add_cage` does.

        part: id of the part; with `mesh`, the number of the part in the shared mesh, from 0.
        points: (U, V, 3) control points, not multiplied by weights. A periodic surface repeats its first ones.
        knots_u: U + degree + 1 numbers that do not decrease; the degree is from 1 to 32. `knots_v` likewise.
        weights: (U, V) numbers above 0, or None: all are 1.
        reversed: the outside is against du × dv.
        mesh: number of a shared mesh, or 0: the surface is placed directly.

        Raises:
            ValueError, TypeError: an array has another shape. Nothing was added.
        """
        net = numpy.ascontiguousarray(points, numpy.float64)
        if net.ndim != 3 or net.shape[2] != 3:
            raise ValueError(f"points: expected shape (U, V, 3), not {given(net)}")
        knots = [numpy.ascontiguousarray(one, numpy.float64) for one in (knots_u, knots_v)]
        degrees = []
        for name, count, along in zip("uv", net.shape, knots):
            if along.ndim != 1 or not 1 <= len(along) - count - 1 <= 32:
                raise ValueError(f"knots_{name}: expected from {count + 2} to {count + 33} numbers for {count} points, "
                                 f"not {given(along)}")
            degrees.append(len(along) - count - 1)
        surface = _abi.oc_nurbs(mesh=whole("mesh", mesh, 32), part=whole("part", part), degree_u=degrees[0],
                                degree_v=degrees[1], count_u=net.shape[0], count_v=net.shape[1],
                                knots_u=address(knots[0]), knots_v=address(knots[1]), points=address(net),
                                reversed=int(bool(reversed)))
        factors = None
        if weights is not None:
            factors = numpy.ascontiguousarray(weights, numpy.float64)
            if factors.shape != net.shape[:2]:
                raise ValueError(f"weights: expected shape {net.shape[:2]}, not {given(factors)}")
            surface.weights = address(factors)
        lib.oc_build_add_nurbs(self._h, c.byref(surface))

    def add_shared_mesh(self, parts: int = 1) -> int:
        """Begins a mesh of so many parts that instances place any number of times. Returns its number, from 1."""
        number = c.c_uint32()
        lib.oc_build_add_shared_mesh(self._h, whole("parts", parts, 32), c.byref(number))
        return number.value

    def add_instance(self, mesh: int, first_part: int, transform: ArrayLike | None = None) -> None:
        """Places a shared mesh.

        first_part: id of the part that part 0 of the mesh becomes here. Part 1 becomes the part that was added next.
        transform: as `Scene.add` has it.
        """
        lib.oc_build_add_instance(self._h, whole("mesh", mesh, 32), whole("first_part", first_part),
                                  matrix("transform", transform))

    def _add_arrays(self, part: int, mesh: Mesh, shared: int) -> None:
        self.add_triangles(part, mesh.vertices, mesh.faces, colours=mesh.colours, normals=mesh.normals,
                           vertex_colours=mesh.vertex_colours, mesh=shared)

    def add_mesh(self, mesh: Mesh) -> list[int]:
        """Adds a mesh with its parts. Returns the ids of the parts: one, or one for each placement."""
        material = self.add_material(mesh.material) if mesh.material is not None else 0
        if mesh.placements is None:
            part = self.add_part(mesh.name, id=mesh.id, material=material)
            self._add_arrays(part, mesh, 0)
            return [part]
        placements = check_placements(mesh.name or "mesh", mesh.placements)
        shared = self.add_shared_mesh()
        self._add_arrays(0, mesh, shared)
        parts = []
        for at, (name, place) in enumerate(placements):
            parts.append(self.add_part(name, id=None if mesh.id is None else mesh.id + at, material=material))
            lib.oc_build_add_instance(self._h, shared, parts[-1], place)
        return parts

    def start(self, path: str | os.PathLike[str]) -> BuildJob:
        """Begins to build the model and to write it to `path`, in the background. Nothing can be added any more.

        The file appears under this name when the job is done; until then an existing file stays.
        """
        job = made(lib.oc_build_start, self._h, os.fsencode(path))
        return BuildJob(job, self._h, self._resolving)
