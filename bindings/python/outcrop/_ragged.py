"""Answers of different length for each ray or point, in one array."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy
from numpy.typing import NDArray

from ._arrays import Array
from ._enums import Status
from ._errors import StateError

CHUNK = 1 << 16
"""Rays or points of one call. Ctrl-C takes effect between calls."""


class Ragged:
    """Lists of answers, e.g. the crossings of each ray. `self[i]` is the list of ray i, a view of `elements`."""

    def __init__(self, elements: Array, ends: NDArray[numpy.uint64], complete: NDArray[numpy.bool_]) -> None:
        self.elements = elements
        """All answers: those of the first ray, then those of the second, and so on."""
        self.ends = ends
        """For each ray, the number of answers up to and including its own."""
        self.complete = complete
        """For each ray, whether its answers are all. False only with `now`."""

    @property
    def counts(self) -> NDArray[numpy.uint64]:
        """The number of answers of each ray."""
        return numpy.diff(self.ends, prepend=numpy.uint64(0))

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, index: int) -> Array:
        index = range(len(self.ends))[index]
        return self.elements[int(self.ends[index - 1]) if index else 0:int(self.ends[index])]

    def __iter__(self) -> Iterator[Array]:
        return (self[index] for index in range(len(self)))


def gather(call: Callable[[slice, Array, Array, Array], int], count: int, dtype: numpy.dtype[Any]) -> Ragged:
    """Calls for some rays at a time. `call` fills elements, ends and complete, and returns the number of elements.

    It may find more elements than there is room for: it then sees a greater array.
    """
    ends, complete = numpy.zeros(count, numpy.uint64), numpy.ones(count, numpy.uint8)
    pieces: list[Array] = []
    total, room = 0, 4
    for first in range(0, count, CHUNK):
        part = slice(first, min(first + CHUNK, count))
        length = part.stop - part.start
        found = numpy.empty(length * room, dtype)
        number = call(part, found, ends[part], complete[part])
        while number > len(found):
            found = numpy.empty(number, dtype)
            number = call(part, found, ends[part], complete[part])
        ends[part] += numpy.uint64(total)
        pieces.append(found[:number].copy() if number < len(found) // 2 else found[:number])
        total += number
        room = max(1, 1 + 5 * number // (4 * length))
    elements = pieces[0] if len(pieces) == 1 else numpy.concatenate([numpy.empty(0, dtype), *pieces])
    return Ragged(elements, ends, complete.view(numpy.bool_))


def tolerate_small(call: Callable[[], object]) -> None:
    """Calls a function whose array may be too small: its count says so."""
    try:
        call()
    except StateError as error:
        if error.status != Status.BUFFER_TOO_SMALL:
            raise
