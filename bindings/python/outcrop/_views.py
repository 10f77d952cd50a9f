"""Rays and frusta of cameras, and the transforms that set models upright."""

from __future__ import annotations

import ctypes as c

import numpy

from . import _abi
from ._arrays import PLANE, Array, address
from ._library import lib
from ._value import real, whole
from ._values import Camera, Ray


def camera_ray(camera: Camera, width: int, height: int, x: float, y: float) -> Ray:
    """Returns the ray through a point of a picture, as frames trace it, with the footprint for 1 pixel of error.

    x, y: pixels from the top left corner; fractions are allowed. The centre of pixel (i, j) is (i + 0.5, j + 0.5).
    """
    ray = _abi.oc_ray()
    lib.oc_camera_ray(c.byref(camera._to_c()), whole("width", width, 32), whole("height", height, 32),
                      real("x", x), real("y", y), c.byref(ray))
    return Ray._from_c(ray)


def camera_frustum(camera: Camera, width: int, height: int, x0: float, y0: float, x1: float, y1: float) -> Array:
    """Returns five half spaces, of dtype PLANE, that contain all that a camera sees within a rectangle of the picture.

    `Scene.overlap_frustum` takes them, to select the parts in a rectangle that a user draws.

    x0, y0, x1, y1: two opposite corners, in pixels from the top left corner.
    """
    planes = numpy.empty(5, PLANE)
    lib.oc_camera_frustum(c.byref(camera._to_c()), whole("width", width, 32), whole("height", height, 32),
                          real("x0", x0), real("y0", y0), real("x1", x1), real("y1", y1), address(planes))
    return planes
