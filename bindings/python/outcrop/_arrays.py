"""numpy arrays as arguments: they are taken as they lie in memory, or refused with a message that says why.

The dtypes RAY, HIT, OVERLAP and PLANE equal the structs of the C API, so that arrays of them are passed without a copy.
"""

from __future__ import annotations

import ctypes as c
from collections.abc import Sequence
from typing import Any

import numpy
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._value import Value, numbers

Array = NDArray[Any]


def dtype_of(struct: type[c.Structure]) -> numpy.dtype[Any]:
    """Returns the numpy dtype of a C struct."""
    names: list[str] = []
    formats: list[Any] = []
    offsets: list[int] = []
    members: list[Any] = list(struct._fields_)
    for name, kind in members:
        length: int = getattr(kind, "_length_", 0)
        base = numpy.dtype(kind._type_ if length else kind)
        names.append(name)
        formats.append((base, (length,)) if length else base)
        offsets.append(getattr(struct, name).offset)
    return numpy.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": c.sizeof(struct)})


RAY = dtype_of(_abi.oc_ray)
"""dtype of a ray: origin, t_min, t_max, direction, cone_a, cone_b, mask. See `Ray`."""
HIT = dtype_of(_abi.oc_hit)
"""dtype of a hit: t, position, t_free, part, instance, prim, normal, uv, error, kind. See `Hit`."""
HIT_F32 = dtype_of(_abi.oc_hit_f32)
"""dtype of a hit in single precision: t, normal, uv, part, instance, prim, kind."""
CROSSING = dtype_of(_abi.oc_crossing)
"""dtype of a crossing: t, part, instance, prim, normal, uv, error, side, kind. See `Crossing`."""
PART_AT = dtype_of(_abi.oc_part_at)
"""dtype of a part at a point: instance, part, winding, holds. See `PartAt`."""
OVERLAP = dtype_of(_abi.oc_overlap)
"""dtype of a part that intersects a volume: instance, part, kind. See `Overlap`."""
CLASH = dtype_of(_abi.oc_clash)
"""dtype of a clash: id, instance, part, prim, first_point, second_point, normal, low, high, depth, distance, error,
count, kind, open. See `Clash`."""
NEAREST_POINT = dtype_of(_abi.oc_nearest_point)
"""dtype of a nearest point: distance, error, position, instance, part, prim, kind, holds. See `NearestPoint`."""
TRIANGLE = numpy.dtype({
    "names": ["corners", "part", "prim", "normals"],
    "formats": [(numpy.float64, (3, 3)), numpy.uint64, numpy.uint64, (numpy.float32, (3, 3))],
    "offsets": [getattr(_abi.oc_triangle, name).offset for name in ("corners", "part", "prim", "normals")],
    "itemsize": c.sizeof(_abi.oc_triangle)})
"""dtype of a stored triangle: corners (3, 3), part, prim, normals (3, 3)."""
SURFACE_POINT = dtype_of(_abi.oc_surface_point)
"""dtype of a point of a surface: position, du, dv, normal, curvatures, kind, corner. See `SurfacePoint`."""
NODE = numpy.dtype({
    "names": ["tree", "child_count", "triangle_count", "leaf_children", "part", "bounds", "children", "child_bounds"],
    "formats": [numpy.uint32] * 5 + [(numpy.float64, (2, 3)), (numpy.uint64, (8,)), (numpy.float64, (8, 2, 3))],
    "offsets": [getattr(_abi.oc_node, name).offset for name in (
        "tree", "child_count", "triangle_count", "leaf_children", "part", "bounds_min", "children", "child_bounds")],
    "itemsize": c.sizeof(_abi.oc_node)})
"""dtype of a node of a tree: tree, child_count, triangle_count, leaf_children, part, bounds (2, 3), children (8),
child_bounds (8, 2, 3): least and greatest corners. See `Node`."""
NODE_TRIANGLE = numpy.dtype({
    "names": ["corners", "prim", "part", "tree"],
    "formats": [(numpy.float64, (3, 3)), numpy.uint64, numpy.uint32, numpy.uint32],
    "offsets": [getattr(_abi.oc_node_triangle, name).offset for name in ("corners", "prim", "part", "tree")],
    "itemsize": c.sizeof(_abi.oc_node_triangle)})
"""dtype of a triangle of a leaf: corners (3, 3), prim, part, tree. See `NodeTriangle`."""
TREE_PLACE = dtype_of(_abi.oc_tree_place)
"""dtype of a place of a tree: model_from_tree (12 numbers by column), root, tree, first_part. See `TreePlace`."""
PLACE = dtype_of(_abi.oc_place)
"""dtype of a position with a rotation (quaternion x, y, z, w) and a scale: position, rotation, scale, reserved."""
PLANE = dtype_of(_abi.oc_plane)
"""dtype of a half space: normal, d. See `Plane`."""

_FLOATS = (numpy.dtype(numpy.float32), numpy.dtype(numpy.float64))


def given(array: Array) -> str:
    """Describes an array in a message."""
    return f"shape {array.shape}, dtype {array.dtype}"


def plain(name: str, value: ArrayLike) -> Array:
    """Returns the value as an array, without a copy if it is one."""
    try:
        array: Array = numpy.asarray(value)
    except ValueError as reason:
        raise ValueError(f"{name}: no array can be made of it: {reason}") from None
    if array.dtype.hasobject:
        raise TypeError(f"{name}: Python objects ({given(array)}) are not numbers; rows of different lengths?")
    return array


def floats(name: str, value: ArrayLike) -> Array:
    """Returns float32 or float64 numbers. Other types of arrays are refused; lists become float64."""
    array = plain(name, value)
    if not isinstance(value, numpy.ndarray) and array.dtype.kind in "iuf" and array.dtype not in _FLOATS:
        array = array.astype(numpy.float64)
    if array.size == 0 and not isinstance(value, numpy.ndarray):
        array = array.reshape(0, 3)
    if array.dtype not in _FLOATS:
        raise TypeError(f"{name}: expected float32 or float64, not {given(array)}")
    return array


def vectors(name: str, value: ArrayLike) -> Array:
    """Returns an (N, 3) array of float32 or float64 whose rows C can read in place."""
    array = floats(name, value)
    if array.ndim != 2 or array.shape[1] != 3:
        hint = "; transpose it" if array.ndim == 2 and array.shape[0] == 3 else ""
        raise ValueError(f"{name}: expected shape (N, 3), float32 or float64, not {given(array)}{hint}")
    row, inner = array.strides
    packed = inner == array.itemsize and (row >= 3 * array.itemsize or array.shape[0] <= 1)
    if array.size and not packed:
        raise ValueError(f"{name}: the three numbers of a row must be adjacent, and rows must not overlap, but "
                         f"the strides of {given(array)} are {array.strides}; numpy.ascontiguousarray copies it")
    return array


def integers(name: str, value: ArrayLike) -> Array:
    """Returns unsigned integers of 32 or 64 bits. Negative numbers are refused. Copies only other widths."""
    array = plain(name, value)
    if array.size == 0 and not isinstance(value, numpy.ndarray):
        return array.astype(numpy.uint32)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name}: expected integers, not {given(array)}")
    if array.dtype.kind == "i" and array.size and array.min() < 0:
        raise ValueError(f"{name}: negative numbers, e.g. {array.min()}, in {given(array)}")
    if array.dtype.itemsize < 4 or not array.dtype.isnative:
        return array.astype(numpy.uint32 if array.dtype.itemsize <= 4 else numpy.uint64)
    return array.view(f"u{array.dtype.itemsize}")


def faces(name: str, value: ArrayLike, corners: int) -> Array:
    """Returns an (M, 3) array of uint32 or uint64, tightly packed, of indices below `corners`."""
    array = integers(name, value)
    if array.size == 0:
        array = array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        hint = "; transpose it" if array.ndim == 2 and array.shape[0] == 3 else ""
        raise ValueError(f"{name}: expected shape (M, 3), integers, not {given(array)}{hint}")
    if array.size and (most := int(array.max())) >= corners:
        raise ValueError(f"{name}: the index {most} in {given(array)} is out of range: there are {corners} positions")
    return numpy.ascontiguousarray(array)


def ids(name: str, value: ArrayLike) -> NDArray[numpy.uint64]:
    """Returns ids, tightly packed. One id is a list of one."""
    array = integers(name, numpy.atleast_1d(plain(name, value)) if numpy.size(value) else [])
    if array.ndim != 1:
        raise ValueError(f"{name}: expected ids in one dimension, not {given(array)}")
    return numpy.ascontiguousarray(array, dtype=numpy.uint64)


def matrix(name: str, value: ArrayLike | None) -> Any:
    """Returns an affine transform as C has it, or None.

    It may be a (3, 4) or (4, 4) matrix that transforms columns (the translation is the last column), or 12 numbers by
    column: x axis, y axis, z axis, origin.
    """
    if value is None:
        return None
    array = plain(name, value)
    if array.shape == (4, 4) and not numpy.array_equal(array[3], (0, 0, 0, 1)):
        raise ValueError(f"{name}: the last row of an affine matrix is 0, 0, 0, 1, not {array[3].tolist()}")
    if array.shape in ((4, 4), (3, 4)):
        array = array[:3].T.ravel()
    if array.shape != (12,):
        raise ValueError(f"{name}: expected shape (4, 4), (3, 4) or (12,), not {given(array)}")
    return numbers(name, array.tolist(), c.c_double, 12)


def transforms_of(name: str, value: ArrayLike) -> tuple[Array, int]:
    """Returns the transforms of an array of instances, tightly packed, and their form."""
    array = numpy.ascontiguousarray(value)
    if array.dtype == PLACE and array.ndim == 1:
        return array, _abi.OC_TRANSFORM_PLACE
    if array.dtype not in _FLOATS or array.ndim < 2 or array.shape[1:] not in ((12,), (4, 3)):
        raise TypeError(f"{name}: expected an array of dtype outcrop.PLACE, or float64 or float32 of shape (n, 12) or "
                        f"(n, 4, 3), not {given(array)}")
    single = array.dtype == numpy.float32
    return array, _abi.OC_TRANSFORM_AFFINE_F32 if single else _abi.OC_TRANSFORM_AFFINE_F64


def _integers(name: str, value: ArrayLike, most: int) -> Array:
    array = numpy.asarray(value)
    if array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() > most):
        raise ValueError(f"{name}: expected integers from 0 to {most}, not {given(array)}")
    return array


def masks_of(value: ArrayLike, count: int | None = None) -> Array:
    """Returns masks, tightly packed. count: how many there must be."""
    array = _integers("masks", value, 0xFFFFFFFF)
    if array.ndim != 1 or count not in (None, len(array)):
        raise ValueError(f"masks: expected the shape ({'n' if count is None else count},), not {array.shape}")
    return numpy.ascontiguousarray(array, numpy.uint32)


def tints_of(value: ArrayLike, count: int | None = None) -> Array:
    """Returns tints of four bytes, tightly packed. count: how many there must be."""
    array = _integers("tints", value, 255)
    if array.ndim != 2 or array.shape[1] not in (3, 4) or count not in (None, len(array)):
        n = "n" if count is None else count
        raise ValueError(f"tints: expected the shape ({n}, 3) or ({n}, 4), not {array.shape}")
    packed = numpy.full((len(array), 4), 255, numpy.uint8)
    packed[:, :array.shape[1]] = array
    return packed


def address(array: Array) -> int:
    """Returns the address of the first element."""
    return int(array.__array_interface__["data"][0])


def elements(name: str, array: Any, dtype: numpy.dtype[Any], of: str) -> Array:
    """Checks an array whose elements are structs of the C API."""
    if not isinstance(array, numpy.ndarray) or array.dtype != dtype:
        what = given(array) if isinstance(array, numpy.ndarray) else type(array).__name__
        raise TypeError(f"{name}: expected an array of dtype outcrop.{of}, not {what}")
    return array


def structs(name: str, value: Any, dtype: numpy.dtype[Any], of: str, struct: type[c.Structure]) -> Array:
    """Returns an array of structs: the value itself, or one made of a value class, such as a Hit, or a list of them."""
    listed = [value] if isinstance(value, Value) else value
    if isinstance(listed, (list, tuple)) and listed and all(getattr(one, "_struct", None) is struct for one in listed):
        return numpy.frombuffer(b"".join(bytes(one._to_c()) for one in listed), dtype)
    return elements(name, value, dtype, of)


def stride_of(name: str, array: Array) -> int:
    """Returns the bytes between elements, which lie in one line in memory."""
    if array.flags.c_contiguous:
        return array.itemsize
    if array.ndim != 1 or array.strides[0] < array.itemsize:
        raise ValueError(f"{name}: an array of several dimensions must be contiguous, and one of one dimension must "
                         f"have strides of at least {array.itemsize}, but those of {given(array)} are {array.strides}")
    return int(array.strides[0])


def rays(origins: ArrayLike, directions: ArrayLike, *, t_min: ArrayLike = 0.0, t_max: ArrayLike = numpy.inf,
         cone_a: ArrayLike = 0.0, cone_b: ArrayLike = 0.0, mask: ArrayLike = 0xFFFFFFFF) -> Array:
    """Returns an array of rays (dtype RAY) from arrays of shape (..., 3), e.g. (N, 3) or (height, width, 3).

    A single origin, direction or number counts for all rays. `Ray` documents the members. The directions become
    float32.
    """
    origin, direction = floats("origins", origins), floats("directions", directions)
    for name, array in (("origins", origin), ("directions", direction)):
        if array.ndim == 0 or array.shape[-1] != 3:
            hint = "; transpose it" if array.ndim == 2 and array.shape[0] == 3 else ""
            raise ValueError(f"{name}: expected shape (N, 3), float32 or float64, not {given(array)}{hint}")
    try:
        shape = numpy.broadcast_shapes(origin.shape[:-1], direction.shape[:-1])
    except ValueError:
        raise ValueError(f"origins ({given(origin)}) and directions ({given(direction)}) do not match") from None
    made = numpy.empty(shape or (1,), RAY)
    made["origin"], made["direction"] = origin, direction
    members: Sequence[tuple[str, ArrayLike]] = (
        ("t_min", t_min), ("t_max", t_max), ("cone_a", cone_a), ("cone_b", cone_b), ("mask", mask))
    for name, value in members:
        number = integers(name, value) if name == "mask" else plain(name, value)
        try:
            made[name] = number
        except (ValueError, TypeError):
            raise ValueError(f"{name}: expected a number or shape {made.shape}, not {given(number)}") from None
    return made


def empty_hits(shape: int | tuple[int, ...]) -> Array:
    """Returns memory for hits (dtype HIT), for the argument `out` of queries."""
    return numpy.empty(shape, HIT)
