"""Queries of a scene: batches of rays, volumes, and reading ahead."""

from __future__ import annotations

import ctypes as c
from typing import Any, Callable, Union

import numpy
from numpy.typing import ArrayLike, NDArray

from . import _abi, _values
from ._arrays import (
    CROSSING, HIT, HIT_F32, OVERLAP, PART_AT, PLANE, RAY, SURFACE_POINT, TRIANGLE, Array, address, elements, floats,
    given, rays, stride_of, structs, vectors,
)
from ._enums import HitKind, QueryFlags, Want
from ._errors import ArgumentError
from ._handles import Handle, made
from ._jobs import Job, release_job
from ._library import lib
from ._ragged import CHUNK, Ragged, gather, tolerate_small
from ._value import Vector, numbers, real, whole
from ._values import Camera, Progress


Rays = Union[ArrayLike, Array, _values.Ray, "list[_values.Ray]"]
"""Origins, which need directions; or whole rays."""


class Hit(_values.Hit):
    """The closest hit of one ray. A miss is false."""

    def __bool__(self) -> bool:
        return self.kind != HitKind.MISS


def _of_hits(hits: Array | Hit | list[Hit], dtype: numpy.dtype[Any],
             some: Callable[[int, int, int, int], None]) -> Array:
    """Returns an element of a type for each hit. `some` fills them, given the first hit, count, stride and memory."""
    array = structs("hits", hits, HIT, "HIT", _abi.oc_hit)
    found = numpy.empty(array.shape, dtype)
    stride, memory = stride_of("hits", array), address(found)
    for first in range(0, array.size, CHUNK):
        count = min(CHUNK, array.size - first)
        try:
            some(address(array) + first * stride, count, stride, memory + first * dtype.itemsize)
        except ArgumentError as error:
            if first:
                raise ArgumentError(f"of the hits from {first} on: {error}", error.status) from None
            raise
    return found


class _Batch:
    """A checked batch: the arrays, and the struct that points to them."""

    def __init__(self, origins: Rays, directions: ArrayLike | None, want: Want, coherent: bool, now: bool,
                 options: dict[str, Any]) -> None:
        if directions is not None:
            self.rays = rays(origins, directions, **options)  # type: ignore[arg-type] # a Ray is refused there
        elif options:
            raise TypeError(f"{', '.join(options)}: members of the ray array; give directions, or set them there")
        else:
            self.rays = structs("rays", origins, RAY, "RAY", _abi.oc_ray)
        flags = (QueryFlags.COHERENT if coherent else 0) | (QueryFlags.NOW if now else 0)
        self.struct = _abi.oc_query(want=whole("want", want, 32), flags=flags, count=self.rays.size,
                                    rays=address(self.rays), stride=stride_of("rays", self.rays))

    def output(self, name: str, out: Array | None, dtype: numpy.dtype[Any], of: str) -> Array:
        """Returns memory for the answers: that of the caller, or new."""
        if out is None:
            return numpy.empty(self.rays.shape, dtype)
        if of == "HIT":
            elements(name, out, dtype, of)
        elif not isinstance(out, numpy.ndarray) or out.dtype not in (numpy.bool_, numpy.uint8):
            raise TypeError(f"{name}: expected an array of bool or uint8")
        if out.shape != self.rays.shape or not out.flags.writeable:
            raise ValueError(f"{name}: expected writeable memory of shape {self.rays.shape}, not {given(out)}")
        return out


_STEP = 1 << 18
"""Rays of one call in single precision."""


class _Prefetch(Job[Progress]):
    """Reading ahead."""

    _release = release_job


class Queries(Handle):
    """The queries of a scene. They see its committed state."""

    def closest(self, origins: Rays, directions: ArrayLike | None = None, *, want: Want = Want.ALL,
                coherent: bool = False, now: bool = False, out: Array | None = None, **members: Any) -> Array:
        """Returns the closest hit of each ray, as an array of dtype HIT and of the shape of the rays.

        origins, directions: (N, 3) or (..., 3) arrays; one of them may be a single vector. `members` are those of
            `rays`: t_min, t_max, cone_a, cone_b, mask. Or only an array of dtype RAY, which is read in place, or a
            `Ray`, e.g. of `camera_ray`, or a list of these.
        want: members of the hits to compute. Fewer take less time.
        coherent: a hint that each 32 successive rays start near each other and have similar directions.
        now: answer at once from the data in memory.
        out: memory for the hits, see `empty_hits`.

        Ctrl-C cancels the query and raises KeyboardInterrupt.
        """
        return self.closest_start(origins, directions, want=want, coherent=coherent, now=now, out=out,
                                  **members).result()

    def closest_start(self, origins: Rays, directions: ArrayLike | None = None, *, want: Want = Want.ALL,
                      coherent: bool = False, now: bool = False, out: Array | None = None,
                      **members: Any) -> Job[Array]:
        """Begins `closest` in the background. The result of the job are the hits.

        An array of dtype RAY must stay unchanged until the job has ended.
        """
        batch = _Batch(origins, directions, want, coherent, now, members)
        hits = batch.output("out", out, HIT, "HIT")
        return self._start(lib.oc_scene_closest_start, batch, hits, hits)

    def any(self, origins: Rays, directions: ArrayLike | None = None, *, coherent: bool = False,
            now: bool = False, out: Array | None = None, **members: Any) -> NDArray[numpy.bool_]:
        """Returns for each ray whether it hits anything. Faster than `closest`. Arguments as there."""
        return self.any_start(origins, directions, coherent=coherent, now=now, out=out, **members).result()

    def any_start(self, origins: Rays, directions: ArrayLike | None = None, *, coherent: bool = False,
                  now: bool = False, out: Array | None = None, **members: Any) -> Job[NDArray[numpy.bool_]]:
        """Begins `any` in the background. The result of the job are the answers."""
        batch = _Batch(origins, directions, Want.ALL, coherent, now, members)
        answers = batch.output("out", out, numpy.dtype(numpy.bool_), "bool")
        return self._start(lib.oc_scene_any_start, batch, answers, answers.view(numpy.bool_))

    def _start(self, call: Callable[..., Any], batch: _Batch, memory: Array, result: Array) -> Job[Array]:
        job = made(call, self._h, c.byref(batch.struct), address(memory), stride_of("out", memory))
        return Job(job, self._h, lambda _job, _progress: result, (batch, memory))

    def closest_f32(self, rays: ArrayLike | Array, *, want: Want | int = 0, coherent: bool = False,
                    now: bool = False, out: Array | None = None) -> Array:
        """Returns the closest hit of each ray in single precision, as an array of dtype HIT_F32.

        rays: (..., 8) array: origin, t_min, direction, t_max (0: no end). Read in place if it is float32 without gaps.
        want: of Want.T, NORMAL, UV, PART, INSTANCE, PRIM. 0: all of these.
        out: memory for the hits: writeable, dtype HIT_F32, of the shape of the rays.

        Takes less memory than `closest`. Ctrl-C raises KeyboardInterrupt.
        """
        return self._in_single(lib.oc_scene_closest_f32, rays, want, coherent, now, out, HIT_F32)

    def any_f32(self, rays: ArrayLike | Array, *, coherent: bool = False, now: bool = False,
                out: Array | None = None) -> NDArray[numpy.bool_]:
        """Returns for each ray in single precision whether it hits anything. Arguments as for `closest_f32`."""
        return self._in_single(lib.oc_scene_any_f32, rays, 0, coherent, now, out, numpy.dtype(numpy.bool_))

    def _in_single(self, call: Callable[..., Any], rays: ArrayLike | Array, want: Want | int, coherent: bool,
                   now: bool, out: Array | None, dtype: numpy.dtype[Any]) -> Array:
        given_rays = floats("rays", rays)
        if given_rays.ndim < 1 or given_rays.shape[-1] != 8:
            raise ValueError(f"rays: expected shape (..., 8): origin, t_min, direction, t_max, not {given(given_rays)}")
        rows = numpy.ascontiguousarray(given_rays, numpy.float32)
        if out is None:
            out = numpy.empty(rows.shape[:-1], dtype)
        elif not isinstance(out, numpy.ndarray) or out.dtype != dtype:
            raise TypeError(f"out: expected an array of dtype {dtype}")
        elif out.shape != rows.shape[:-1] or not out.flags.writeable or not out.flags.c_contiguous:
            raise ValueError("out: expected writeable memory without gaps of shape "
                             f"{rows.shape[:-1]}, not {given(out)}")
        flags = (QueryFlags.COHERENT if coherent else 0) | (QueryFlags.NOW if now else 0)
        count = rows.size // 8
        # In steps, so that Ctrl-C comes through.
        for first in range(0, count, _STEP):
            query = _abi.oc_query_f32(want=whole("want", want, 32), flags=flags, count=min(count - first, _STEP),
                                      rays=address(rows) + 32 * first)
            call(self._h, c.byref(query), address(out) + dtype.itemsize * first, 0)
        return out

    def closest_one(self, origin: Vector, direction: Vector, *, want: Want = Want.ALL, now: bool = False) -> Hit:
        """Returns the closest hit of one ray. A miss is false.

        The call itself traces: it is the fastest for a single ray, and Ctrl-C does not end it.
        """
        ray = _abi.oc_ray(numbers("origin", origin, c.c_double, 3), 0.0, float("inf"),
                          numbers("direction", direction, c.c_float, 3), 0.0, 0.0, 0xFFFFFFFF)
        query = _abi.oc_query(want=whole("want", want, 32), flags=QueryFlags.NOW if now else 0, count=1,
                              rays=c.addressof(ray))
        hit = _abi.oc_hit()
        lib.oc_scene_closest(self._h, c.byref(query), c.byref(hit), 0)
        return Hit._from_c(hit)

    def any_one(self, origin: Vector, direction: Vector, *, t_min: float = 0.0, t_max: float = float("inf"),
                now: bool = False) -> bool:
        """Returns whether one ray hits anything between t_min and t_max, e.g. whether one point sees another."""
        ray = _abi.oc_ray(numbers("origin", origin, c.c_double, 3), real("t_min", t_min), real("t_max", t_max),
                          numbers("direction", direction, c.c_float, 3), 0.0, 0.0, 0xFFFFFFFF)
        query = _abi.oc_query(flags=QueryFlags.NOW if now else 0, count=1, rays=c.addressof(ray))
        answer = c.c_uint8()
        lib.oc_scene_any(self._h, c.byref(query), c.byref(answer), 0)
        return bool(answer.value)

    def triangles(self, hits: Array | Hit | list[Hit]) -> Array:
        """Returns the triangles of hits in world space, as an array of dtype TRIANGLE.

        hits: an array of dtype HIT, of `closest`; or a Hit, of a pick, which counts as an array of one.

        The hits must be exact and have position, part, instance and prim.

        Raises:
            ArgumentError: a hit is none of this scene's.
        """
        def some(start: int, count: int, stride: int, out: int) -> None:
            lib.oc_scene_triangles(self._h, start, count, stride, out)

        return _of_hits(hits, TRIANGLE, some)

    def evaluate(self, hits: Array | Hit | list[Hit], *, now: bool = False) -> Array:
        """Returns the points of surfaces under hits in world space, as an array of dtype SURFACE_POINT.

        hits: as for `triangles`. Stand-ins and misses may be among them: `kind` of the result says so (`Evaluated`).
        now: answer from the data in memory, without a wait.

        A point has the derivatives by the parameters of the hit, the shading normal and the principal curvatures.

        Raises:
            ArgumentError: an exact hit is none of this scene's.
        """
        def some(start: int, count: int, stride: int, out: int) -> None:
            lib.oc_scene_evaluate(self._h, start, count, stride, QueryFlags.NOW if now else 0, out, 0)

        return _of_hits(hits, SURFACE_POINT, some)

    def crossings(self, origins: Rays, directions: ArrayLike | None = None, *, coherent: bool = False,
                  now: bool = False, **members: Any) -> Ragged:
        """Returns all surfaces that each ray crosses, nearest first, coincident ones too.

        Arguments as for `closest`. The result is a list for each ray, of dtype CROSSING: `result[i]`. Rays of several
        dimensions are counted in one.
        """
        batch = _Batch(origins, directions, Want.ALL, coherent, now, members)
        if not batch.rays.flags.c_contiguous and batch.rays.ndim > 1:
            raise ValueError(f"rays: {given(batch.rays)} must be contiguous")
        all_rays = batch.rays.reshape(-1)

        def call(part: slice, found: Array, ends: Array, complete: Array) -> int:
            batch.struct.rays, batch.struct.count = address(all_rays[part]), part.stop - part.start
            count = c.c_uint64()
            tolerate_small(lambda: lib.oc_scene_crossings(
                self._h, c.byref(batch.struct), address(found), len(found), address(ends), address(complete),
                c.byref(count)))
            return count.value

        return gather(call, len(all_rays), CROSSING)

    def parts_at(self, points: ArrayLike) -> Ragged:
        """Returns the visible parts that hold each point, of dtype PART_AT: `result[i]`.

        points: (N, 3), world space.
        """
        array = numpy.ascontiguousarray(vectors("points", points), numpy.float64)

        def call(part: slice, found: Array, ends: Array, _complete: Array) -> int:
            count = c.c_uint64()
            tolerate_small(lambda: lib.oc_scene_parts_at(
                self._h, address(array[part]), part.stop - part.start, 0, address(found), len(found), address(ends),
                c.byref(count)))
            return count.value

        return gather(call, len(array), PART_AT)

    def thickness(self, hits: Array | Hit | list[Hit]) -> NDArray[numpy.float64]:
        """Returns how thick the parts are at hits: the distance straight into the part to its other side.

        hits: an array of dtype HIT, of `closest`; or a Hit, of a pick, which counts as an array of one.

        Infinite for a miss, and where there is no other side.
        """
        array = structs("hits", hits, HIT, "HIT", _abi.oc_hit)
        distances = numpy.empty(array.shape, numpy.float64)
        stride, memory = stride_of("hits", array), address(distances)
        for first in range(0, array.size, CHUNK):
            lib.oc_scene_thickness(self._h, address(array) + first * stride, min(CHUNK, array.size - first), stride,
                                   memory + first * distances.itemsize, 0)
        return distances

    def overlap_box(self, low: Vector, high: Vector) -> Array:
        """Returns the visible parts that intersect a box, as an array of dtype OVERLAP. The test is exact."""
        corners = numbers("low", low, c.c_double, 3), numbers("high", high, c.c_double, 3)
        return self._overlaps(lib.oc_scene_overlap_box, *corners)

    def overlap_frustum(self, planes: ArrayLike | Array) -> Array:
        """Returns the visible parts that intersect the common part of half spaces, e.g. of the six of a frustum.

        planes: (N, 4): normals that point inward, and offsets d: the points p with dot(normal, p) + d >= 0. Or an
            array of dtype PLANE.
        """
        if not isinstance(planes, numpy.ndarray) or planes.dtype != PLANE:
            rows = floats("planes", planes)
            if rows.ndim != 2 or rows.shape[1] != 4:
                raise ValueError(f"planes: expected shape (N, 4), float32 or float64, not {given(rows)}")
            planes = numpy.ascontiguousarray(rows, numpy.float64)
        packed = numpy.ascontiguousarray(planes)
        return self._overlaps(lib.oc_scene_overlap_frustum, address(packed), len(packed))

    def _overlaps(self, call: Callable[..., Any], *volume: Any) -> Array:
        """Counts the parts first. Another commit between the calls can add some: then it counts again."""
        count, capacity = c.c_uint64(), 0
        found = numpy.empty(0, OVERLAP)
        while True:
            room = capacity
            tolerate_small(lambda: call(self._h, *volume, address(found), room, c.byref(count)))
            if count.value <= capacity:
                return found[:count.value]
            capacity = count.value
            found = numpy.empty(capacity, OVERLAP)

    def prefetch_box(self, low: Vector, high: Vector, cell: float = 0.0) -> Job[Progress]:
        """Begins to read the part of the scene that lies in a box, in the background.

        cell: length in world units. Only blocks below longer cells are read. 0: all blocks of geometry.
        """
        job = made(lib.oc_scene_prefetch_box, self._h, numbers("low", low, c.c_double, 3),
                   numbers("high", high, c.c_double, 3), real("cell", cell))
        return _Prefetch(job, self._h, lambda _job, progress: progress)

    def prefetch_camera(self, camera: Camera, width: int, height: int, poe: float = 0.0) -> Job[Progress]:
        """Begins to read the blocks that a picture would need, in the background, e.g. for the next view."""
        job = made(lib.oc_scene_prefetch_camera, self._h, c.byref(camera._to_c()), whole("width", width, 32),
                   whole("height", height, 32), real("poe", poe))
        return _Prefetch(job, self._h, lambda _job, progress: progress)
