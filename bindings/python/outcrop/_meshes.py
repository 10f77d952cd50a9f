"""Meshes as sources of a build: arrays, and objects of trimesh and pyvista, which need not be installed."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Union

import numpy
from numpy.typing import ArrayLike

from ._arrays import Array, matrix
from ._values import Material


@dataclass
class Mesh:
    """Triangles of one part.

    vertices: (N, 3) float32 or float64.
    faces: (M, 3) integers, or None: each three vertices are a triangle.
    name, id: of the part. None: the name of its key in the sources, the next free id.
    colours: (M, 3) linear RGB, one for each triangle, or None.
    normals: (N, 3), one for each vertex, of any length, or None: edges below the crease angle appear smooth.
    vertex_colours: (N, 3) linear RGB, one for each vertex, in place of `colours`.
    material: colour, opacity and the like. None: grey.
    placements: names and transforms at which the mesh is placed, each a part of its own. The mesh is stored once.
        None: once, where it is.
    """

    vertices: ArrayLike
    faces: ArrayLike | None = None
    name: str | None = None
    id: int | None = None
    colours: ArrayLike | None = None
    normals: ArrayLike | None = None
    vertex_colours: ArrayLike | None = None
    material: Material | None = None
    placements: Sequence[tuple[str, ArrayLike]] | None = None


Source = Union[str, "os.PathLike[str]", Mesh, Any]
"""A mesh file, a Mesh, or an object of trimesh (Trimesh, Scene) or pyvista (PolyData, MultiBlock)."""

Sources = Union[Source, Mapping[str, Source], Iterable[Source]]
"""One source, a list, or a dict whose keys are the names of the parts."""


def flatten(sources: Any, name: str | None = None) -> Iterator[str | os.PathLike[str] | Mesh]:
    """Returns all files and meshes of the sources."""
    if isinstance(sources, (str, os.PathLike)):
        yield sources
    elif isinstance(sources, Mesh):
        yield sources if sources.name is not None else Mesh(**{**vars(sources), "name": name})
    elif hasattr(sources, "graph") and hasattr(sources, "geometry"):
        yield from _trimesh_scene(sources)
    elif hasattr(sources, "vertices") and hasattr(sources, "faces"):
        yield _trimesh(sources, name)
    elif hasattr(sources, "points") and hasattr(sources, "faces"):
        yield _pyvista(sources, name)
    elif hasattr(sources, "keys") and hasattr(sources, "n_blocks"):
        for at, key in enumerate(sources.keys()):
            if sources[at] is not None:
                yield from flatten(sources[at], _below(name, key))
    elif isinstance(sources, Mapping):
        for key, source in sources.items():
            yield from flatten(source, str(key))
    elif isinstance(sources, Iterable) and not isinstance(sources, (bytes, numpy.ndarray)):
        for source in sources:
            yield from flatten(source, name)
    else:
        raise TypeError(f"sources: expected a path, an outcrop.Mesh or an object of trimesh or pyvista, not "
                        f"{type(sources).__module__}.{type(sources).__name__}")


def _below(name: str | None, key: Any) -> str:
    return str(key) if name is None else f"{name}/{key}"


def linear(colour: ArrayLike) -> Array:
    """Returns linear RGB of colours in sRGB with 8 bits, (..., 3) or (..., 4)."""
    share = numpy.asarray(colour)[..., :3].astype(numpy.float64) / 255
    return numpy.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _trimesh(mesh: Any, name: str | None) -> Mesh:
    """Converts a trimesh.Trimesh. Its normals are left out: it has them for vertices at any edge."""
    vertices, faces = numpy.asarray(mesh.vertices), numpy.asarray(mesh.faces)
    own = getattr(mesh, "metadata", None) or {}
    made = Mesh(vertices, faces, name=name or own.get("name"))
    visual = getattr(mesh, "visual", None)
    kind = getattr(visual, "kind", None)
    if kind == "face":
        made.colours = linear(visual.face_colors)  # type: ignore[union-attr]
    elif kind == "vertex":
        made.vertex_colours = linear(visual.vertex_colors)  # type: ignore[union-attr]
    elif kind == "texture":
        made.material = _trimesh_material(getattr(visual, "material", None))
    return made


def _trimesh_material(material: Any) -> Material | None:
    """Converts the main colour of a trimesh material. As in the files that it comes from, it is linear."""
    colour = getattr(material, "main_color", None)
    if colour is None:
        return None
    opacity = float(colour[3]) / 255 if len(colour) > 3 else 1.0
    return Material(colour=numpy.asarray(colour)[:3] / 255, opacity=opacity or 1.0,
                    metalness=float(getattr(material, "metallicFactor", None) or 0.0),
                    roughness=float(getattr(material, "roughnessFactor", None) or 0.0))


def _trimesh_scene(scene: Any) -> Iterator[Mesh]:
    """Converts a trimesh.Scene. A part has the name of its node; geometry of several nodes is stored once."""
    nodes: dict[str, list[tuple[str, Array]]] = {}
    for node in scene.graph.nodes_geometry:
        transform, key = scene.graph[node]
        nodes.setdefault(key, []).append((str(node), numpy.asarray(transform, numpy.float64)))
    for key, placements in nodes.items():
        if not hasattr(scene.geometry[key], "faces"):
            continue  # paths and clouds of points have no surface
        mesh = _trimesh(scene.geometry[key], placements[0][0])
        mesh.name = placements[0][0]
        if len(placements) > 1:
            mesh.placements = placements
        elif not numpy.array_equal(placements[0][1], numpy.eye(4)):
            place = placements[0][1]
            mesh.vertices = numpy.asarray(mesh.vertices) @ place[:3, :3].T + place[:3, 3]
        yield mesh


def _pyvista(data: Any, name: str | None) -> Mesh:
    """Converts a pyvista.PolyData. Polygons and strips are divided into triangles.

    Its normals are left out: those of points are means, also across the edges of a cube.
    """
    strips = getattr(data, "n_strips", 0)
    if strips or not data.is_all_triangles:
        data = data.triangulate()
    faces = numpy.asarray(data.faces).reshape(-1, 4)[:, 1:]
    return Mesh(numpy.asarray(data.points), faces, name=name)


def check_placements(name: str, placements: Sequence[tuple[str, ArrayLike]]) -> list[tuple[str, Any]]:
    """Returns the names and C transforms of placements."""
    return [(str(part), matrix(f"{name}.placements[{at}]", place)) for at, (part, place) in enumerate(placements)]
