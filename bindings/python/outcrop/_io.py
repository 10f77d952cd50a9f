"""Models that Python reads: from file objects, bytes, or any object that has `read_at`."""

from __future__ import annotations

import ctypes as c
import io
import os
import sys
import threading
from dataclasses import dataclass
from types import TracebackType
from typing import Any, BinaryIO, Protocol, Union, runtime_checkable

from . import _abi
from ._callbacks import callback, find, forget, register


@runtime_checkable
class Reader(Protocol):
    """The caller's own reading of a model. Any thread calls `read_at`, several at once."""

    @property
    def size(self) -> int:
        """Size of the model in bytes."""

    def read_at(self, offset: int, buffer: memoryview) -> None:
        """Fills the buffer with the bytes from `offset` on, or raises an exception."""


Source = Union[str, "os.PathLike[str]", bytes, bytearray, memoryview, BinaryIO, Reader]
"""What `Context.open` takes: a path, the bytes of a model, a seekable binary file, or a Reader."""


class _File:
    """Reads a seekable binary file. Reads take turns, because a file has one position."""

    def __init__(self, file: Any) -> None:
        self._file, self._lock = file, threading.Lock()
        self.size = file.seek(0, io.SEEK_END)

    def read_at(self, offset: int, buffer: memoryview) -> None:
        with self._lock:
            self._file.seek(offset)
            while buffer:
                some = self._file.read(len(buffer))
                if not some:
                    raise EOFError("the file ends before its end")
                buffer[:len(some)] = some
                buffer = buffer[len(some):]


class _Bytes:
    """Reads bytes in memory."""

    def __init__(self, content: Any) -> None:
        self._content = memoryview(content).cast("B")
        self.size = len(self._content)

    def read_at(self, offset: int, buffer: memoryview) -> None:
        buffer[:] = self._content[offset:offset + len(buffer)]


def reader(source: Any) -> Reader | None:
    """Returns the reader of a source, or None if it is a path."""
    if isinstance(source, (str, os.PathLike)):
        return None
    if isinstance(source, (bytes, bytearray, memoryview)):
        return _Bytes(source)
    if hasattr(source, "read_at"):
        return source  # type: ignore[no-any-return]
    if hasattr(source, "read") and hasattr(source, "seek"):
        if isinstance(source, io.TextIOBase):
            raise TypeError("source: the file must be opened in binary mode")
        return _File(source)
    raise TypeError(f"source: expected a path, bytes, a seekable binary file or an object with `size` and `read_at`, "
                    f"not {type(source).__name__}")


@dataclass
class Unraisable:
    """The argument of sys.unraisablehook."""

    exc_type: type[BaseException]
    exc_value: BaseException | None
    exc_traceback: TracebackType | None
    err_msg: str | None
    object: object


class Opening:
    """A reader while the library uses it.

    `error` is the last exception of the reader. An opening raises it. Later, queries and frames say only that reading
    failed, and sys.unraisablehook shows the exception.
    """

    def __init__(self, source: Reader, name: str) -> None:
        self.reader = source
        self.error: BaseException | None = None
        self.is_open = False
        self.key = register(self)
        self.table = _abi.oc_io(size=source.size, read_at=READ_AT, close=CLOSE, user=self.key, name=name.encode())

    def read(self, offset: int, buffer: memoryview) -> int:
        """Reads; returns 0, or 1 if the reader raised an exception."""
        try:
            self.reader.read_at(offset, buffer)
        except BaseException as error:  # noqa: BLE001 # it must not go through C
            self.error = error
            if self.is_open:
                sys.unraisablehook(Unraisable(type(error), error, error.__traceback__, None, self.reader))
            return 1
        return 0


def _read_at(user: int, offset: int, buffer: int, count: int) -> int:
    """Reads for the library."""
    opening: Opening | None = find(user)
    if opening is None or not buffer:
        return 0 if count == 0 else 1
    return opening.read(offset, memoryview((c.c_char * count).from_address(buffer)).cast("B"))


READ_AT = _abi.oc_read_fn(callback(_read_at))


def _close(user: int) -> None:
    """Forgets a reader that the library will not use any more."""
    forget(user)


CLOSE = _abi.oc_close_fn(callback(_close))
