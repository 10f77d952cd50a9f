"""Clashes: sets of parts, and the search for pairs of parts that cross, touch or are too near to each other."""

from __future__ import annotations

import ctypes as c
from collections.abc import Sequence

import numpy

from . import _abi
from ._arrays import CLASH, Array, address
from ._enums import ClashDetail, ClashSkipFlags
from ._handles import Handle, Reference, made
from ._jobs import Job, release_job
from ._library import lib
from ._value import real, whole
from ._values import ClashSummary, Progress


class PartSet(Handle):
    """A set of parts of a scene, by ids: `PartSet().add_part(7).add_instance(2)`. It may be used with any scene."""

    _kind = "PartSet"
    _release = lib.oc_part_set_release

    def __init__(self) -> None:
        super().__init__(made(lib.oc_part_set_create))

    def add_instance(self, instance: int = _abi.OC_NO_ID) -> PartSet:
        """Adds all parts of an instance, given by id; without an id those of all instances."""
        lib.oc_part_set_add_instance(self._h, whole("instance", instance))
        return self

    def add_part(self, part: int, instance: int = _abi.OC_NO_ID) -> PartSet:
        """Adds a part and all parts below it, given by ids; without an instance those of all instances."""
        lib.oc_part_set_add_part(self._h, whole("instance", instance), whole("part", part))
        return self


class ClashJob(Job[Array]):
    """A search for clashes. `result()` returns those that were not taken before, as an array of dtype CLASH."""

    _release = release_job

    def take(self, most: int = 1 << 16) -> Array:
        """Returns clashes that were found so far, each once, at most `most`."""
        return taken(self._h, most)

    def summary(self) -> ClashSummary:
        """Returns the numbers of clashes and pairs of parts. The job must have ended."""
        summary = _abi.oc_clash_summary()
        lib.oc_job_clash_summary(self._h, c.byref(summary))
        return ClashSummary._from_c(summary)


def taken(job: Reference, most: int | None = None) -> Array:
    """Takes clashes of a job: those that wait, or `most` of these."""
    count = c.c_uint64()
    lib.oc_job_take_clashes(job, None, 0, c.byref(count))
    found = numpy.empty(count.value if most is None else min(most, count.value), CLASH)
    if len(found):
        lib.oc_job_take_clashes(job, address(found), len(found), c.byref(count))
    return found[:count.value]


class Clashes(Handle):
    """The search for clashes of a scene. It sees the committed state."""

    def clash_start(self, first: PartSet | None = None, second: PartSet | None = None, *, clearance: float = 0.0,
                    tolerance: float = 0.0, triangles: bool = False, limit: int = 0,
                    skip: ClashSkipFlags = ClashSkipFlags(0),
                    skip_pairs: Sequence[tuple[int, int]] = ()) -> ClashJob:
        """Begins to search for clashes in the background. Arguments: see `clash`."""
        pairs = [whole("skip_pairs", part) for pair in skip_pairs for part in pair]
        if any(len(pair) != 2 for pair in skip_pairs):
            raise ValueError("skip_pairs: expected pairs of part ids")
        desc = _abi.oc_clash_desc(
            detail=ClashDetail.TRIANGLES if triangles else ClashDetail.PARTS,
            first=None if first is None else first._h._as_parameter_,
            second=None if second is None else second._h._as_parameter_,
            clearance=real("clearance", clearance), tolerance=real("tolerance", tolerance),
            limit=whole("limit", limit),
            skip_pairs=c.cast((c.c_uint64 * len(pairs))(*pairs), c.c_void_p), skip_count=len(skip_pairs),
            skip=whole("skip", skip, 32))
        job = made(lib.oc_scene_clash_start, self._h, c.byref(desc))
        return ClashJob(job, self._h, lambda job, _progress: taken(job))

    def clash(self, first: PartSet | None = None, second: PartSet | None = None, *, clearance: float = 0.0,
              tolerance: float = 0.0, triangles: bool = False, limit: int = 0,
              skip: ClashSkipFlags = ClashSkipFlags(0),
              skip_pairs: Sequence[tuple[int, int]] = ()) -> Array:
        """Returns pairs of visible parts that cross, touch, hold one another or are too near, of dtype CLASH.

        first: parts of which a clash has one; all by default.
        second: parts of which a clash has the other; those of `first` by default.
        clearance: distance up to which parts that are apart clash, in world units.
        tolerance: depth up to which closed parts that reach into each other touch, and greatest error of the depths of
            others, in world units; 0: depths are not sought.
        triangles: returns pairs of triangles, not of parts; at most `limit` (0: 1048576).
        skip: pairs that are not compared.
        skip_pairs: pairs of part ids that are not compared.

        The column `kind` has the constants of ClashKind, and `open` those of ClashOpenFlags.
        """
        return self.clash_start(first, second, clearance=clearance, tolerance=tolerance, triangles=triangles,
                                limit=limit, skip=skip, skip_pairs=skip_pairs).result()
