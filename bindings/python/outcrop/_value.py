"""The base of the value classes: dataclasses that are converted to structs of the C API and back."""

from __future__ import annotations

import ctypes as c
import dataclasses
import enum
import operator
from collections.abc import Sequence
from typing import Any, ClassVar, TypeVar, Union

import numpy
from numpy.typing import NDArray

Vector = Union[Sequence[float], NDArray[Any]]
"""A few numbers: a position, a direction or a colour."""

_Self = TypeVar("_Self", bound="Value")

_RANGES = {
    c.c_uint8: (0, 1 << 8), c.c_uint32: (0, 1 << 32), c.c_uint64: (0, 1 << 64), c.c_int32: (-1 << 31, 1 << 31),
    c.c_int64: (-1 << 63, 1 << 63),
}


def _number(name: str, value: Any, kind: Any) -> Any:
    """Returns a number that a member of type `kind` can hold. ctypes itself would cut off bits."""
    limits = _RANGES.get(kind)
    try:
        if limits is None:
            if isinstance(value, (str, bytes)):
                raise TypeError
            return float(value)
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be {'a number' if limits is None else 'an integer'}, not {value!r}") from None
    if not limits[0] <= number < limits[1]:
        raise ValueError(f"{name} must be {limits[0]} to {limits[1] - 1}, not {number}")
    return number


def whole(name: str, value: Any, bits: int = 64) -> int:
    """Returns an unsigned integer of so many bits."""
    return int(_number(name, value, c.c_uint64 if bits == 64 else c.c_uint32))


def real(name: str, value: Any) -> float:
    """Returns a number. ctypes itself would not name what is wrong."""
    return float(_number(name, value, c.c_double))


def numbers(name: str, values: Any, kind: Any, length: int) -> Any:
    """Returns a C array of `length` numbers. `name` is that of the argument, for the message of an error."""
    if numpy.shape(values) != (length,):
        raise ValueError(f"{name} must be {length} numbers, not {values!r}")
    return (kind * length)(*[_number(name, value, kind) for value in values])


def text(name: str, value: Any) -> bytes | None:
    """Returns a string as C has it."""
    if value is None:
        return None
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a string, not {value!r}")
    if "\0" in value:
        raise ValueError(f"{name} contains a zero character: {value!r}")
    return value.encode("utf-8", "surrogateescape")


class Value:
    """A struct of the C API as a dataclass. A member that is 0 or None has its documented default."""

    _struct: ClassVar[type[c.Structure]]

    def _to_c(self) -> c.Structure:
        """Returns the struct."""
        struct = self._struct()
        types: dict[str, Any] = {one[0]: one[1] for one in self._struct._fields_}
        for member in dataclasses.fields(self):  # type: ignore[arg-type] # each subclass is a dataclass
            name = f"{type(self).__name__}.{member.name}"
            kind, value = types[member.name], getattr(self, member.name)
            if kind is c.c_char_p:
                setattr(struct, member.name, text(name, value))
            elif hasattr(kind, "_length_"):
                setattr(struct, member.name, numbers(name, value, kind._type_, kind._length_))
            else:
                setattr(struct, member.name, _number(name, value, kind))
        return struct

    @classmethod
    def _from_c(cls: type[_Self], struct: c.Structure) -> _Self:
        """Returns the value of a struct. Strings are copied."""
        values = {}
        for member in dataclasses.fields(cls):  # type: ignore[arg-type]
            value = getattr(struct, member.name)
            if isinstance(value, c.Array):
                value = tuple(value)
            elif isinstance(value, bytes):
                value = value.decode("utf-8", "replace")
            elif isinstance(member.default, enum.Enum):
                value = type(member.default)(value)
            values[member.name] = value
        return cls(**values)
