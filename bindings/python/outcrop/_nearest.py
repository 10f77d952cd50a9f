"""Nearest points of surfaces, and the distance of two sets of parts."""

from __future__ import annotations

import ctypes as c

import numpy
from numpy.typing import ArrayLike

from . import _abi
from ._arrays import NEAREST_POINT, Array, address, vectors
from ._clashes import PartSet
from ._enums import NearestFlags
from ._errors import ArgumentError
from ._handles import Handle
from ._library import lib
from ._value import real
from ._values import Distance

CHUNK = 1 << 20
"""Points of a call: between calls, Python can handle an interrupt."""


class Distances(Handle):
    """Distances in a scene. They are those of the committed state."""

    def nearest(self, points: ArrayLike, *, parts: PartSet | None = None, max_distance: float = 0.0,
                inside: bool = False, now: bool = False) -> Array:
        """Returns, for each point, the nearest point of the visible parts, as an array of dtype NEAREST_POINT.

        points: (N, 3), world space, finite.
        parts: the parts that are searched; all by default.
        max_distance: distance in world units beyond which nothing is found; 0: no limit.
        inside: fill the column `holds`: whether a part of the set holds the point that was asked for.
        now: answer from the data in memory alone; the exact distance is within the column `error`.

        The column `kind` has the constants of HitKind: EXACT, MISS, and with `now` MISSING.
        """
        array = numpy.ascontiguousarray(vectors("points", points), numpy.float64)
        found = numpy.empty(len(array), NEAREST_POINT)
        flags = (NearestFlags.INSIDE if inside else 0) | (NearestFlags.NOW if now else 0)
        desc = _abi.oc_nearest_desc(
            flags=flags, max_distance=real("max_distance", max_distance),
            parts=None if parts is None else parts._h._as_parameter_)
        for first in range(0, max(len(array), 1), CHUNK):
            some = array[first:first + CHUNK]
            desc.points, desc.count = address(some), len(some)
            try:
                lib.oc_scene_nearest(self._h, c.byref(desc), address(found[first:]), 0)
            except ArgumentError as error:
                if first:
                    raise ArgumentError(f"of the points from {first} on: {error}", error.status) from None
                raise
        return found

    def distance(self, first: PartSet | None = None, second: PartSet | None = None, *,
                 max_distance: float = 0.0) -> Distance | None:
        """Returns the distance of two sets of parts with the two nearest points, or None if it is beyond the limit.

        first: the first set; all parts by default.
        second: the second set; the other parts of `first` by default.
        max_distance: distance in world units beyond which nothing is found; 0: no limit.

        The distance is that of surfaces, also for a part inside of another. None too if there are no two parts.
        """
        desc = _abi.oc_distance_desc(
            first=None if first is None else first._h._as_parameter_,
            second=None if second is None else second._h._as_parameter_,
            max_distance=real("max_distance", max_distance))
        found = _abi.oc_distance()
        lib.oc_scene_distance(self._h, c.byref(desc), c.byref(found))
        return Distance._from_c(found) if found.found else None
