"""The demo: a small machine from numpy arrays, a picture of it, and a pick."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy

from ._arrays import Array
from ._context import Context
from ._enums import LightKind, UpAxis
from ._meshes import Mesh
from ._values import BuildOptions, Camera, Light, Material

Arrays = tuple[Array, Array]


def grid(rows: int, columns: int) -> Array:
    """Returns the triangles of a grid of (rows + 1) x (columns + 1) corners."""
    first = (numpy.arange(rows)[:, None] * (columns + 1) + numpy.arange(columns)).ravel()
    low = numpy.stack([first, first + 1, first + columns + 2], 1)
    high = numpy.stack([first, first + columns + 2, first + columns + 1], 1)
    return numpy.concatenate([low, high]).astype(numpy.uint32)


def lathe(profile: Array, facets: int) -> Arrays:
    """Turns a profile of (radius, height) about the z axis."""
    angle = numpy.linspace(0, 2 * numpy.pi, facets + 1)
    around = numpy.stack([numpy.cos(angle), numpy.sin(angle)], 1)
    corners = numpy.empty((len(profile), facets + 1, 3), numpy.float32)
    corners[..., :2] = profile[:, None, :1] * around
    corners[..., 2] = profile[:, 1:]
    return corners.reshape(-1, 3), grid(len(profile) - 1, facets)


def sphere(radius: float, facets: int = 96) -> Arrays:
    """Returns a sphere."""
    angle = numpy.linspace(-numpy.pi / 2, numpy.pi / 2, facets // 2 + 1)
    return lathe(radius * numpy.stack([numpy.cos(angle), numpy.sin(angle)], 1), facets)


def cylinder(radius: float, low: float, high: float, facets: int = 96) -> Arrays:
    """Returns a closed cylinder along the z axis."""
    return lathe(numpy.array([(0, low), (radius, low), (radius, high), (0, high)]), facets)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Arrays:
    """Returns a box."""
    bits = numpy.arange(8)[:, None] >> numpy.array([2, 1, 0]) & 1
    quads = numpy.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    corners = numpy.where(bits == 1, high, low).astype(numpy.float32)
    return corners, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(numpy.uint32)


def machine() -> list[Mesh]:
    """Returns the parts of the machine: a base, a shaft with a ball, and bolts that share a mesh."""
    steel = Material(colour=(0.55, 0.57, 0.6), metalness=0.6, roughness=0.4)
    at = [(x, y) for x in (-1.6, 1.6) for y in (-1.1, 1.1)]
    bolts = [(f"bolt {number}", numpy.array([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, 0.4]]))
             for number, (x, y) in enumerate(at, 1)]
    ball, ball_faces = sphere(0.7)
    profile = numpy.array([(0.45, 0.4), (0.9, 0.4), (0.9, 0.6), (0.7, 0.7), (0.6, 1.3), (0.45, 1.3)])
    return [
        Mesh(*box((-2, -1.5, 0), (2, 1.5, 0.4)), name="base", material=Material(colour=(0.1, 0.22, 0.45))),
        Mesh(*lathe(profile, 96), name="bearing", material=Material(colour=(0.75, 0.35, 0.06))),
        Mesh(*cylinder(0.4, 0.4, 2.4), name="shaft", material=steel),
        Mesh(ball + numpy.array((0, 0, 2.9), numpy.float32), ball_faces, name="ball",
             material=Material(colour=(0.6, 0.05, 0.04), roughness=0.3)),
        Mesh(*cylinder(0.18, 0, 0.18, 6), name="bolt", material=steel, placements=bolts),
    ]


def camera() -> Camera:
    """Returns the view of the demo."""
    return Camera(eye=(5.5, -7.5, 5), at=(0, 0, 1.4), up=(0, 0, 1), fov_y=32)


def show(path: Path) -> None:
    """Opens the picture in the viewer of the desktop, if there is one."""
    viewers = {"darwin": "open", "win32": "start"}
    has_display = sys.platform in viewers or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not has_display:
        return
    try:
        subprocess.Popen([viewers.get(sys.platform, "xdg-open"), str(path)], stdout=subprocess.DEVNULL,
                         stderr=subprocess.DEVNULL, shell=sys.platform == "win32")
    except OSError:
        pass


def demo(output: Path, width: int = 1024, height: int = 768, viewer: bool = True) -> None:
    """Builds the machine, writes a picture of it, and says what lies in its middle."""
    with tempfile.TemporaryDirectory() as folder, Context() as context:
        path = Path(folder) / "machine.oc"
        report = context.build(path, machine(), options=BuildOptions(up=UpAxis.Z))
        model = context.open(path)
        print(f"built {report.triangles_kept} triangles in {report.parts} parts: {report.file_bytes} bytes")
        scene = context.scene(model)
        with scene.edit():
            scene.set_lights([Light(intensity=0.5), Light(kind=LightKind.DIRECTIONAL, vector=(-1, 1, -2),
                                                          intensity=0.7, shadows=1)])
        picture = context.render(scene, camera(), width, height, samples=16)
        picture.save(output)
        print(f"wrote {output} ({width} x {height} pixels, {picture.state.name})")
        x, y = width // 2, height // 2
        hit = picture.pick(x, y)
        if hit:
            place = ", ".join(f"{number:.3f}" for number in hit.position)
            print(f"at pixel {x}, {y}: {model.part(hit.part).name}, {hit.t:.3f} from the eye, at ({place})")
        model.close()
    if viewer:
        show(output)
