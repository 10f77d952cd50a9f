"""Models: built files that are opened for reading."""

from __future__ import annotations

import ctypes as c
from collections.abc import Iterator
from typing import Any

import numpy
from numpy.typing import NDArray

from . import _abi
from ._arrays import TRIANGLE, Array, address
from ._cursor import Cursor
from ._enums import CursorFlags, PlacementFlags, UpAxis
from ._handles import Handle, made
from ._library import lib
from ._value import real, whole
from ._values import Camera, ModelInfo, PartInfo


class _Reader(Handle):
    """A reader of the triangles of a part."""

    _kind = "Reader"
    _release = lib.oc_part_reader_release


class Model(Handle):
    """A built model, opened by `Context.open`. Scenes share it."""

    _kind = "Model"
    _release = lib.oc_model_release

    @property
    def info(self) -> ModelInfo:
        """Bounds, counts, and the bytes in memory now."""
        info = _abi.oc_model_info()
        lib.oc_model_get_info(self._h, c.byref(info))
        return ModelInfo._from_c(info)

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Least and greatest corner of all triangles."""
        info = self.info
        return tuple(info.bounds_min), tuple(info.bounds_max)

    def _part_at(self, index: int) -> PartInfo:
        part = _abi.oc_part_info()
        lib.oc_model_get_part(self._h, index, c.byref(part))
        return PartInfo._from_c(part)

    @property
    def parts(self) -> list[PartInfo]:
        """All parts. `parent` of a part is an index of this list, or NO_INDEX."""
        return [self._part_at(index) for index in range(self.info.parts)]

    def find_part(self, part: int) -> int:
        """Returns the index in `parts` of a part, given by id.

        Raises:
            ArgumentError: no part has the id.
        """
        index = c.c_uint32()
        lib.oc_model_find_part(self._h, whole("part", part), c.byref(index))
        return index.value

    def part(self, part: int) -> PartInfo:
        """Returns a part, given by id, e.g. that of a hit.

        Raises:
            ArgumentError: no part has the id.
        """
        return self._part_at(self.find_part(part))

    def read_part(self, part: int, chunk: int = 65536) -> Iterator[NDArray[Any]]:
        """Yields the triangles of a part, given by id, as arrays of dtype TRIANGLE of at most `chunk` elements.

        Each triangle comes once; those of parts below it are not included. The corners are in model space and exact.

        Raises:
            ArgumentError: no part has the id.
        """
        if chunk < 1:
            raise ValueError(f"chunk: expected a positive number, not {chunk}")
        reader = _Reader(made(lib.oc_model_read_part, self._h, whole("part", part)))
        with reader:
            while True:
                triangles = numpy.empty(chunk, TRIANGLE)
                count = c.c_uint64()
                lib.oc_part_reader_next(reader._h, address(triangles), chunk, c.byref(count))
                if not count.value:
                    return
                yield triangles[:count.value]

    def triangles(self, part: int) -> NDArray[Any]:
        """Returns all triangles of a part, given by id, as an array of dtype TRIANGLE. See `read_part`."""
        some = list(self.read_part(part))
        found = numpy.empty(sum(map(len, some)), TRIANGLE)
        # Without `out` the result would have another layout.
        return numpy.concatenate(some, out=found) if some else found

    def cursor(self, *, now: bool = False, memory: int = 0) -> Cursor:
        """Returns a cursor, which reads the nodes of the model's trees one at a time. For one thread at a time.

        now: the cursor never reads. A node that is not in memory raises StateError with Status.MISSING.
        memory: bytes of the context's budget for blocks that the cursor reads. 0: 4 MiB.
        """
        flags = CursorFlags.NOW if now else CursorFlags(0)
        return Cursor(made(lib.oc_cursor_create, self._h, flags, whole("memory", memory)))

    def view(self, number: int = 0) -> Camera:
        """Returns a perspective camera: 0 and 1 show the whole model, 2 and 3 are closer. See `Scene.fit`."""
        camera = _abi.oc_camera()
        lib.oc_model_get_view(self._h, whole("number", number, 32), c.byref(camera))
        return Camera._from_c(camera)

    def placement(self, up: UpAxis = UpAxis.UNKNOWN, metres_per_unit: float = 0) -> tuple[Array, PlacementFlags]:
        """Returns the (4, 4) transform that gives the model this up axis and unit, for `Scene.add`, and what it lacks.

        With the same arguments for each model of a scene, all stand upright and have the same scale. The flags say
        what was asked but the model does not say: it is then not turned or not scaled.

        up: the up axis of the world. UNKNOWN: the model is not turned.
        metres_per_unit: length of a unit of the world, e.g. 0.001 for millimetres. 0: the model is not scaled.
        """
        columns, flags = (c.c_double * 12)(), c.c_uint32()
        lib.oc_model_get_placement(self._h, whole("up", up, 32), real("metres_per_unit", metres_per_unit), columns,
                                   c.byref(flags))
        matrix = numpy.eye(4)
        matrix[:3] = numpy.reshape(columns, (4, 3)).T
        return matrix, PlacementFlags(flags.value)

    def __repr__(self) -> str:
        if self.closed:
            return "<Model, closed>"
        info = self.info
        return f"<Model of {info.triangles_placed} triangles in {info.parts} parts>"
