"""Callbacks from the library into Python.

The C function of each kind is made once and lives as long as the module: it can never be freed while it runs. `user`
is the key of a Python object in a table.
"""

from __future__ import annotations

import atexit
import itertools
import threading
import time
from collections.abc import Callable
from typing import Any

from . import _abi
from ._enums import LogLevel
from ._handles import in_callback, release_all

_objects: dict[int, Any] = {}
_keys = itertools.count(1)
_inside: set[int] = set()

_ends: list[Callable[[float], None]] = []
"""Functions that wait at the end of the interpreter for released objects that still call back."""

EXIT_SECONDS = 10
"""Longest wait at the end of the interpreter, for callbacks in progress."""


def register(target: Any) -> int:
    """Puts an object into the table. Returns the `user` of its callbacks."""
    key = next(_keys)
    _objects[key] = target
    return key


def forget(key: int) -> Any:
    """Takes an object out of the table."""
    return _objects.pop(key, None)


def find(key: int) -> Any:
    """Returns an object of the table, or None."""
    return _objects.get(key)


class Entry:
    """Keeps an object in the table as long as it lives itself."""

    def __init__(self, target: Any) -> None:
        self.target = target
        self.key = register(target)

    def __del__(self) -> None:
        forget(self.key)


class Listeners:
    """The Python functions behind one wake function. It refers to no object of the library: those can be collected."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._once: list[Callable[[], object]] = []
        self.always: Callable[[], object] | None = None

    def add_once(self, listener: Callable[[], object]) -> None:
        """Adds a function that is called at the next wake only."""
        with self._lock:
            self._once.append(listener)

    def wake(self) -> None:
        """Calls the functions."""
        with self._lock:
            once, self._once = self._once, []
        for one in [self.always, *once]:
            if one is not None:
                one()


def callback(call: Callable[..., Any]) -> Callable[..., Any]:
    """Makes a callback of a function: the end of the interpreter waits for it, and it releases no objects."""

    def noted(*arguments: Any) -> Any:
        key = next(_keys)
        _inside.add(key)
        try:
            with in_callback():
                return call(*arguments)
        finally:
            _inside.discard(key)

    return noted


def _wake(user: int) -> None:
    """Calls a Python function without arguments."""
    target: Callable[[], object] | None = find(user)
    if target is not None:
        target()


WAKE = _abi.oc_wake_fn(callback(_wake))


def _log(user: int, level: int, message: bytes) -> None:
    """Calls a Python function with a log line."""
    target: Callable[[LogLevel, str], object] | None = find(user)
    if target is not None:
        target(LogLevel(level), message.decode("utf-8", "replace"))


LOG = _abi.oc_log_fn(callback(_log))


def _submit(user: int, run: Callable[[int], None], task: int) -> None:
    """Hands a task to an executor. A task that it refuses is run at once: each must run exactly once."""
    target = find(user)
    try:
        target.submit(run, task)
    except Exception:  # the executor is shut down
        run(task)


SUBMIT = _abi.oc_submit_fn(callback(_submit))


def wait_at_exit(wait: Callable[[float], None]) -> None:
    """Registers a function that waits for so many seconds at most."""
    _ends.append(wait)


@atexit.register
def _at_exit() -> None:
    """Ends all work that calls back: a thread that enters Python while the interpreter ends would end the process."""
    if next(_keys) == 1:
        return
    release_all()
    for wait in _ends:
        wait(EXIT_SECONDS)
    end = time.monotonic() + EXIT_SECONDS
    while _inside and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(0.01)  # the last one returns to C
