"""Shared by all tests. OUTCROP_LIBRARY names the shared library, OUTCROP_INCLUDE the folder of outcrop.h."""

from __future__ import annotations

import gc
import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy
import pytest

import outcrop

PACKAGE = Path(__file__).resolve().parent.parent
ROOT = PACKAGE.parent.parent
INCLUDE = Path(os.environ.get("OUTCROP_INCLUDE") or ROOT / "include")

TETRA = numpy.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], numpy.float32)
TETRA_FACES = numpy.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], numpy.uint32)


def need(name: str) -> Any:
    """Imports a package that only tests need. Without it the test is skipped, but fails under CI."""
    try:
        return importlib.import_module(name)
    except ImportError:
        if os.environ.get("CI") and not os.environ.get("OUTCROP_ALLOW_MISSING_PACKAGES"):
            pytest.fail(f"{name} is missing: tests/requirements.txt; set OUTCROP_ALLOW_MISSING_PACKAGES to allow that")
        pytest.skip(f"{name} is missing: tests/requirements.txt")


def bumps(side: int = 40) -> tuple[Any, Any]:
    """Returns a height field of 2 * side^2 triangles over the unit square."""
    x, y = numpy.meshgrid(numpy.linspace(0, 1, side + 1), numpy.linspace(0, 1, side + 1), indexing="ij")
    height = 0.1 * numpy.sin(9 * x) * numpy.cos(7 * y)
    corners = numpy.stack([x, y, height], -1).reshape(-1, 3).astype(numpy.float32)
    first = (numpy.arange(side)[:, None] * (side + 1) + numpy.arange(side)).ravel()
    quads = numpy.stack([first, first + side + 1, first + side + 2, first + 1], 1)
    return corners, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(numpy.uint32)


@pytest.fixture(autouse=True)
def no_object_is_left() -> Iterator[None]:
    """Each test releases all that it made."""
    yield
    gc.collect()
    assert outcrop.live() == []


@pytest.fixture
def context() -> Iterator[outcrop.Context]:
    """A context of two threads."""
    with outcrop.Context(threads=2) as one:
        yield one


@pytest.fixture
def tetra(context: outcrop.Context, tmp_path: Path) -> Iterator[outcrop.Model]:
    """A tetrahedron, part 7."""
    context.build(tmp_path / "tetra.oc", outcrop.Mesh(TETRA, TETRA_FACES, name="tetra", id=7))
    with context.open(tmp_path / "tetra.oc") as model:
        yield model


@pytest.fixture
def scene(context: outcrop.Context, tetra: outcrop.Model) -> Iterator[outcrop.Scene]:
    """The tetrahedron as instance 1."""
    with context.scene(tetra) as one:
        yield one


@pytest.fixture
def three(context: outcrop.Context, tmp_path: Path) -> Iterator[outcrop.Scene]:
    """Three tetrahedra side by side along x, parts 1 to 3, `a`, `b` below `a`, and `c`."""
    with context.new_build() as build:
        for part, name, parent in [(1, "a", None), (2, "b", 1), (3, "c", None)]:
            build.add_part(name, id=part, parent=parent)
            build.add_triangles(part, TETRA + numpy.array((2 * part, 0, 0), numpy.float32), TETRA_FACES)
        with build.start(tmp_path / "three.oc") as job:
            job.result()
    with context.open(tmp_path / "three.oc") as model, context.scene(model) as one:
        yield one


@pytest.fixture
def camera() -> outcrop.Camera:
    """A view of the tetrahedron from above."""
    return outcrop.Camera(eye=(0.3, 0.3, 5), at=(0.2, 0.2, 0), up=(0, 1, 0))
