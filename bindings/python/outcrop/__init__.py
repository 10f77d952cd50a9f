"""outcrop for Python: renders and queries models larger than memory, on the CPU.

    import outcrop
    with outcrop.Context() as context:
        context.build("pump.oc", "pump.glb")
        model = context.open("pump.oc")
        scene = context.scene(model)
        picture = context.render(scene, model.view(), 1024, 768)
        picture.save("pump.png")
        print(picture.pick(512, 384))
        hits = scene.closest([(0, 0, 9)], [(0, 0, -1)])
        print(hits["t"], hits["part"])

Arrays of numpy go in and out without copies. A call that fails raises `Error`, or ValueError and TypeError for a wrong
argument. All work can be waited for, which Ctrl-C ends, or awaited in asyncio.

The environment variable OUTCROP_LIBRARY may contain the path of the shared library; otherwise the package's own is
loaded, or the one that the system finds.
"""

from __future__ import annotations

from . import _enums, _values
from ._abi import OC_ALL_THREADS as ALL_THREADS
from ._abi import OC_HEADER_VERSION as HEADER_VERSION
from ._abi import OC_NO_ID as NO_ID
from ._abi import OC_NO_INDEX as NO_INDEX
from ._arrays import (
    CLASH, CROSSING, HIT, HIT_F32, NEAREST_POINT, NODE, NODE_TRIANGLE, OVERLAP, PART_AT, PLACE, PLANE, RAY,
    SURFACE_POINT, TREE_PLACE, TRIANGLE, empty_hits, rays,
)
from ._build import Build, BuildJob, BuildReport, Resolver
from ._clashes import ClashJob, PartSet
from ._context import Context
from ._cursor import Cursor
from ._enums import *  # noqa: F403
from ._errors import (
    ArgumentError, Cancelled, Error, InputError, InternalError, LimitError, MachineError, StateError, VersionError,
)
from ._frame import Frame, Picture
from ._handles import live
from ._io import Reader
from ._jobs import Job
from ._library import __version__, library_path
from ._meshes import Mesh
from ._model import Model
from ._queries import Hit
from ._ragged import Ragged
from ._scene import Scene
from ._values import *  # noqa: F403
from ._views import camera_frustum, camera_ray

__all__ = [
    "ALL_THREADS", "CLASH", "CROSSING", "ClashJob", "HEADER_VERSION", "HIT", "HIT_F32", "NEAREST_POINT", "NODE",
    "NODE_TRIANGLE", "NO_ID", "NO_INDEX", "OVERLAP", "PART_AT", "PLACE", "PLANE", "RAY", "SURFACE_POINT",
    "TREE_PLACE", "TRIANGLE", "ArgumentError", "Build", "BuildJob", "BuildReport", "Cancelled", "Context", "Cursor",
    "Error", "Frame", "Hit", "InputError", "InternalError", "Job", "LimitError", "MachineError", "Mesh", "Model",
    "PartSet", "Picture", "Ragged", "Reader", "Resolver", "Scene", "StateError", "VersionError", "__version__",
    "camera_frustum", "camera_ray", "empty_hits", "library_path", "live", "rays",
    *_enums.__all__, *_values.__all__,
]
