"""Compares a batch of rays from numpy with the C call on prepared arrays: `python3 tests/bench.py [ROUNDS]`.

Prints the best of alternating rounds. OUTCROP_LIBRARY must name an optimised library.
"""

from __future__ import annotations

import ctypes
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy
from conftest import bumps

import outcrop
from outcrop import _abi
from outcrop._library import lib

COUNT = 1_000_000


def main() -> None:
    """Measures."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    with tempfile.TemporaryDirectory() as folder, outcrop.Context() as context:
        path = Path(folder) / "bumps.oc"
        context.build(path, outcrop.Mesh(*bumps(700)))
        with context.open(path) as model, context.scene(model) as scene:
            compare(scene, rounds)


def new_hits() -> ctypes.c_void_p:
    """Returns new memory for hits, as a C program would have it from malloc."""
    memory = outcrop.empty_hits(COUNT).ctypes
    return memory.data_as(ctypes.c_void_p)


def compare(scene: outcrop.Scene, rounds: int) -> None:
    """Traces the same rays in each way."""
    random = numpy.random.default_rng(46)
    origins = random.uniform((0, 0, 1), (1, 1, 2), (COUNT, 3))
    directions = random.uniform((0, 0, -0.1), (1, 1, 0.1), (COUNT, 3)) - origins
    rays, hits, any_hit = outcrop.rays(origins, directions), outcrop.empty_hits(COUNT), numpy.empty(COUNT, bool)
    query = _abi.oc_query(rays=rays.ctypes.data, count=COUNT)
    handle, options = scene._h, ctypes.byref(query)
    ways: dict[str, Callable[[], object]] = {
        "C: closest": lambda: lib.oc_scene_closest(handle, options, hits.ctypes.data, 0),
        "closest(rays, out=hits)": lambda: scene.closest(rays, out=hits),
        "C: closest, new hits": lambda: lib.oc_scene_closest(handle, options, new_hits(), 0),
        "closest(rays)": lambda: scene.closest(rays),
        "closest(origins, directions)": lambda: scene.closest(origins, directions),
        "C: any": lambda: lib.oc_scene_any(handle, options, any_hit.ctypes.data, 0),
        "any(rays)": lambda: scene.any(rays),
        "any(origins, directions)": lambda: scene.any(origins, directions),
        "rays(origins, directions)": lambda: outcrop.rays(origins, directions),
    }
    best = dict.fromkeys(ways, float("inf"))
    for _ in range(rounds):
        for name, call in ways.items():
            began = time.perf_counter()
            call()
            best[name] = min(best[name], time.perf_counter() - began)
    base = 1.0
    for name, seconds in best.items():
        base = seconds if name.startswith("C:") else base
        print(f"{name:32}{seconds * 1e3:9.1f} ms{seconds / base:8.3f} of C")


if __name__ == "__main__":
    main()
