"""Loads the shared library and declares its functions. A call that returns a failure raises `Error`."""

from __future__ import annotations

import ctypes as c
import os
import sys
from pathlib import Path
from typing import Any

from . import _abi
from ._errors import Error, error

_NAMES = {
    "darwin": ("liboutcrop.dylib", "liboutcrop.0.1.dylib"),
    "win32": ("outcrop.dll", "outcrop.dll"),
}
_IN_PACKAGE, _IN_SYSTEM = _NAMES.get(sys.platform, ("liboutcrop.so", "liboutcrop.so.0.1"))


def _candidate() -> str:
    """Returns the library to load: OUTCROP_LIBRARY, else the package's own, else the one that the system finds."""
    chosen = os.environ.get("OUTCROP_LIBRARY")
    if chosen:
        return chosen
    own = Path(__file__).with_name(_IN_PACKAGE)
    return str(own) if own.exists() else _IN_SYSTEM


def _load() -> tuple[c.CDLL, str]:
    """Loads the library and checks its version."""
    path = _candidate()
    try:
        library = c.CDLL(path)
        library.oc_version.restype = c.c_uint32
        version = int(library.oc_version())
    except (OSError, AttributeError) as reason:
        raise ImportError(
            f"outcrop: the shared library {path} cannot be loaded: {reason}\n"
            "The library comes with the wheel of this package (`pip install bindings/python`). The environment "
            "variable OUTCROP_LIBRARY names another file.", name="outcrop", path=path) from reason
    if version // 100 != _abi.OC_HEADER_VERSION // 100:
        raise ImportError(
            f"outcrop: the shared library {path} has version {_dotted(version)}, but this package is for version "
            f"{_dotted(_abi.OC_HEADER_VERSION)}", name="outcrop", path=path)
    return library, path


def _dotted(version: int) -> str:
    return f"{version // 10000}.{version // 100 % 100}.{version % 100}"


def _check(status: int, _function: Any, _arguments: Any) -> int:
    """Raises the failure of a call."""
    if status:
        raise failure(status)
    return status


def failure(status: int) -> Error:
    """Returns the exception of the last failure in this thread."""
    return error(status, lib.oc_last_error().decode("utf-8", "replace"), lib.oc_last_error_need())


def _declare(library: c.CDLL, path: str) -> _abi.Functions:
    """Returns the functions with their signatures."""
    functions = _abi.Functions()
    for name, (result, arguments) in _abi.SIGNATURES.items():
        try:
            function = getattr(library, name)
        except AttributeError:
            raise ImportError(f"outcrop: the shared library {path} has no function {name}: it was built from an "
                              "older state of the sources", name="outcrop", path=path) from None
        function.restype, function.argtypes = result, arguments
        if name in _abi.FALLIBLE:
            function.errcheck = _check
        setattr(functions, name, function)
    return functions


_cdll, library_path = _load()
lib = _declare(_cdll, library_path)
"""The functions of the C API. One that returns a status raises `Error` if it fails."""

__version__ = _dotted(lib.oc_version())
