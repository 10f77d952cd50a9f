"""Objects of the library: each holds one reference, and gives it back when it is closed or no longer used."""

from __future__ import annotations

import ctypes as c
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, ClassVar, TypeVar

_Self = TypeVar("_Self", bound="Handle")

_live: weakref.WeakSet[Reference] = weakref.WeakSet()

# A release may wait for other threads of the library. One inside of a callback, e.g. by a garbage collection, could
# wait for the very thread that it is in: it is left to the next object that is made or released outside of callbacks.
_thread = threading.local()
_left: list[tuple[Callable[[Any], None], Any, list[Any]]] = []


@contextmanager
def in_callback() -> Iterator[None]:
    """Marks the thread as inside of a callback."""
    _thread.depth = getattr(_thread, "depth", 0) + 1
    try:
        yield
    finally:
        _thread.depth -= 1


def release_left() -> None:
    """Does the releases that callbacks have left."""
    while _left and not getattr(_thread, "depth", 0):
        try:
            release, handle, _keep = _left.pop()
        except IndexError:  # another thread was faster
            return
        release(handle)


class Reference:
    """One reference to an object of the library, which is given back with the last use of this one.

    ctypes takes it as an argument. A call that is in progress in another thread therefore keeps the object alive, even
    if it is closed meanwhile. `keep` holds memory that the object uses: it outlives the object.
    """

    __slots__ = ("_as_parameter_", "_release", "keep", "kind", "__weakref__")

    def __init__(self, kind: str, address: int | None, release: Callable[[Any], None]) -> None:
        self._as_parameter_ = c.c_void_p(address)
        self._release = release
        self.kind = kind
        self.keep: list[Any] = []
        _live.add(self)
        release_left()

    def release(self) -> None:
        """Gives the reference back. The second call does nothing."""
        handle, self._as_parameter_ = self._as_parameter_, c.c_void_p()
        if not handle:
            return
        if getattr(_thread, "depth", 0):
            _left.append((self._release, handle, self.keep))
        else:
            release_left()
            self._release(handle)

    def __del__(self) -> None:
        self.release()


def made(function: Callable[..., Any], *arguments: Any) -> int | None:
    """Calls a function whose last argument receives a new object. Returns the object's address."""
    handle = c.c_void_p()
    function(*arguments, c.byref(handle))
    return handle.value


def live() -> list[str]:
    """Returns the kinds of all objects that are not released yet, sorted."""
    release_left()
    return sorted(one.kind for one in list(_live) if one._as_parameter_)


def release_all() -> None:
    """Releases all objects, those first that call back."""
    order = {"Job": 0, "Frame": 1}
    for one in sorted(list(_live), key=lambda one: (order.get(one.kind, 2), one.kind == "Context")):
        one.release()


class Handle:
    """An object of the library.

    It is released at the end of a `with` block, by `close()`, or with the last Python reference. The order does not
    matter: an object keeps those alive that it needs.
    """

    _kind: ClassVar[str]
    _release: ClassVar[Callable[[Any], None]]

    def __init__(self, address: int | None, made_from: Reference | None = None) -> None:
        """Takes over a reference. The callbacks of the object that it was made from live as long as this one."""
        self._reference: Reference | None = Reference(self._kind, address, type(self)._release)
        if made_from is not None:
            self._reference.keep.extend(made_from.keep)

    @property
    def _h(self) -> Reference:
        """The reference, as an argument of a call."""
        if self._reference is None:
            raise ValueError(f"this {type(self).__name__} is closed")
        return self._reference

    @property
    def closed(self) -> bool:
        """True after `close()`."""
        return self._reference is None

    def close(self) -> None:
        """Releases the object. It cannot be used any more. The second call does nothing."""
        self._reference = None

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
