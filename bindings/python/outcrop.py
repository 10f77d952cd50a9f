"""outcrop for Python: renders and queries models, over the C library.

    import outcrop
    with outcrop.Context() as context:
        context.build("pump.oc", files=["pump.glb"])
        model = context.open("pump.oc")
        scene = context.scene([(1, model)])
        picture = context.render(scene, model.view(0), 1024, 768)
        print(picture.pick(512, 384))

outcrop.h documents names, units and blocking. The environment variable OUTCROP_LIBRARY may contain the path of the
shared library; otherwise the system's search path is used.

A C call that fails raises Error.
"""

import ctypes as c
import os

HEADER_VERSION = 100
ALL_THREADS = 0xFFFFFFFF
FOREVER = 0xFFFFFFFF
NO_ID = 0xFFFFFFFFFFFFFFFF
MISS, EXACT, LOD, MISSING = range(4)
RUNNING, DONE, CANCELLED, FAILED = 1, 2, 3, 4


class Error(Exception):
    """A C call has failed, or a job. `status` is an OC_STATUS_ number; the text is that of oc_last_error."""

    def __init__(self, status, message):
        super().__init__(message)
        self.status = status


class _Sized(c.Structure):
    """A struct of outcrop.h that begins with `struct_size`. The constructor zeroes the other members."""

    def __init__(self, **members):
        super().__init__(struct_size=c.sizeof(type(self)), **members)


class ContextDesc(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("threads", c.c_uint32), ("memory_budget", c.c_uint64),
        ("executor", c.c_void_p), ("log", c.c_void_p), ("log_user", c.c_void_p),
        ("instruction_set", c.c_uint32), ("flags", c.c_uint32),
    ]


class Progress(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("state", c.c_uint32), ("fraction", c.c_double), ("done", c.c_uint64),
        ("total", c.c_uint64), ("bytes", c.c_uint64), ("need", c.c_uint64), ("error", c.c_uint32), ("phase", c.c_uint32),
    ]


class Camera(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("kind", c.c_uint32), ("eye", c.c_double * 3), ("at", c.c_double * 3),
        ("up", c.c_double * 3), ("fov_y", c.c_double), ("height", c.c_double),
    ]


class Part(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("material", c.c_uint32), ("id", c.c_uint64), ("parent", c.c_uint64),
        ("name", c.c_char_p), ("has_parent", c.c_uint32), ("reserved", c.c_uint32),
    ]


class Triangles(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("mesh", c.c_uint32), ("part", c.c_uint64), ("positions", c.c_void_p),
        ("position_count", c.c_uint64), ("position_stride", c.c_uint64), ("indices", c.c_void_p),
        ("index_count", c.c_uint64), ("colours", c.c_void_p), ("colour_stride", c.c_uint64),
        ("scalar", c.c_uint32), ("index", c.c_uint32),
    ]


class BuildReport(_Sized):
    _fields_ = [("struct_size", c.c_uint32), ("notes", c.c_uint32)] + [
        (name, c.c_uint64) for name in (
            "triangles_in", "triangles_kept", "dropped_non_finite", "dropped_degenerate", "dropped_out_of_range",
            "parts", "instances", "geometry_bytes", "file_bytes")
    ] + [(name, c.c_double) for name in ("seconds_read", "seconds_build", "seconds_write", "position_error")]


class ModelInfo(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("up", c.c_uint32), ("bounds_min", c.c_double * 3), ("bounds_max", c.c_double * 3),
        ("metres_per_unit", c.c_double), ("triangles_in", c.c_uint64), ("triangles_stored", c.c_uint64),
        ("triangles_placed", c.c_uint64), ("file_bytes", c.c_uint64), ("geometry_bytes", c.c_uint64),
        ("resident_bytes", c.c_uint64), ("parts", c.c_uint32), ("instances", c.c_uint32), ("blocks", c.c_uint32),
        ("has_colours", c.c_uint32),
    ]


class PartInfo(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("parent", c.c_uint32), ("id", c.c_uint64), ("name", c.c_char_p),
        ("triangles", c.c_uint64), ("bounds_min", c.c_double * 3), ("bounds_max", c.c_double * 3),
        ("colour", c.c_float * 4), ("metalness", c.c_float), ("roughness", c.c_float),
    ]


class Look(_Sized):
    _fields_ = [("struct_size", c.c_uint32), ("flags", c.c_uint32), ("colour", c.c_float * 4)]


class Ray(c.Structure):
    _fields_ = [
        ("origin", c.c_double * 3), ("t_min", c.c_double), ("t_max", c.c_double), ("direction", c.c_float * 3),
        ("cone_a", c.c_float), ("cone_b", c.c_float), ("mask", c.c_uint32),
    ]


class Hit(c.Structure):
    _fields_ = [
        ("t", c.c_double), ("position", c.c_double * 3), ("t_free", c.c_double), ("part", c.c_uint64),
        ("instance", c.c_uint64), ("prim", c.c_uint64), ("normal", c.c_float * 3), ("uv", c.c_float * 2),
        ("error", c.c_float), ("kind", c.c_uint32), ("reserved", c.c_uint32),
    ]

    def __bool__(self):
        return self.kind != MISS

    def __repr__(self):
        if not self:
            return "Hit(nothing)"
        return f"Hit(t={self.t:g}, part={self.part}, instance={self.instance}, prim={self.prim})"


class Query(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("want", c.c_uint32), ("flags", c.c_uint32), ("reserved", c.c_uint32),
        ("rays", c.c_void_p), ("count", c.c_uint64), ("stride", c.c_uint64),
    ]


class FrameDesc(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("width", c.c_uint32), ("height", c.c_uint32), ("buffers", c.c_uint32),
        ("targets", c.c_void_p), ("target_count", c.c_uint64),
    ]


class FrameSettings(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("samples", c.c_uint32), ("poe", c.c_float), ("ambient", c.c_float),
        ("flags", c.c_uint32),
    ]


class Pixels(_Sized):
    _fields_ = [
        ("struct_size", c.c_uint32), ("format", c.c_uint32), ("width", c.c_uint32), ("height", c.c_uint32),
        ("data", c.c_void_p), ("row_pitch", c.c_uint64), ("size", c.c_uint64), ("mapping", c.c_void_p),
    ]


class _Library:
    """The C functions. Each call checks the status. The library is loaded at the first use."""

    _p, _u32, _u64, _s = c.c_void_p, c.c_uint32, c.c_uint64, c.c_char_p
    _arguments = {
        "oc_context_create": [_u32, _p, _p], "oc_context_property": [_p, _u32, _p], "oc_context_step": [_p, _p],
        "oc_build_create": [_p, _p, _p], "oc_build_add_file": [_p, _s], "oc_build_add_part": [_p, _p],
        "oc_build_add_triangles": [_p, _p], "oc_build_start": [_p, _s, _p],
        "oc_job_wait": [_p, _u32, _p], "oc_job_build_report": [_p, _p], "oc_job_cancel": [_p],
        "oc_model_open": [_p, _s, _p], "oc_model_get_info": [_p, _p], "oc_model_get_part": [_p, _u32, _p],
        "oc_model_get_view": [_p, _u32, _p],
        "oc_scene_create": [_p, _p], "oc_scene_add_instance": [_p, _p, _u64, _p], "oc_scene_commit": [_p],
        "oc_scene_closest": [_p, _p, _p, _u64], "oc_scene_set_parts_look": [_p, _u64, _p, _u64, _u32, _p],
        "oc_scene_isolate": [_p, _u64, _p, _u64, _u32], "oc_scene_clear_part_looks": [_p, _u64],
        "oc_frame_create": [_p, _p, _p], "oc_frame_request": [_p, _p, _p, _p], "oc_frame_wait": [_p, _u32, _p],
        "oc_frame_map": [_p, _u32, _p], "oc_frame_pick": [_p, _u32, _u32, _p],
    }
    _releases = ["context", "build", "job", "model", "scene", "frame", "mapping"]

    def __init__(self):
        self._c = None

    def _load(self):
        library = c.CDLL(os.environ.get("OUTCROP_LIBRARY", "liboutcrop.so.0.1"))
        library.oc_last_error.restype = c.c_char_p
        for name, arguments in self._arguments.items():
            getattr(library, name).argtypes = arguments
            getattr(library, name).restype = c.c_uint32
        for kind in self._releases:
            getattr(library, f"oc_{kind}_release").argtypes = [c.c_void_p]
            getattr(library, f"oc_{kind}_release").restype = None
        return library

    def __getattr__(self, name):
        if self._c is None:
            self._c = self._load()
        function = getattr(self._c, name)

        def checked(*arguments):
            status = function(*arguments)
            if status:
                raise Error(status, self._c.oc_last_error().decode())

        return function if name.endswith("_release") else checked

    def last_error(self):
        return self._c.oc_last_error().decode()


_lib = _Library()


class _Object:
    """An object of the library. It is released at the end of a `with` block, by `close`, or with the last reference."""

    def __init__(self, kind, make, *arguments):
        handle = c.c_void_p()
        make(*arguments, c.byref(handle))
        self._kind, self._handle = kind, handle

    def close(self):
        handle, self._handle = getattr(self, "_handle", None), None
        if handle:
            getattr(_lib, f"oc_{self._kind}_release")(handle)

    __del__ = close

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def _array(values, element):
    """Copies a buffer (numpy, array) or a flat or nested list to a C array. Returns address, length and the array."""
    try:
        view = memoryview(values)
    except TypeError:
        view = None
    if view is not None and view.format == element._type_ and view.c_contiguous:
        owner = (element * (view.nbytes // c.sizeof(element))).from_buffer_copy(view.cast("B"))
    else:
        flat = []
        for value in values if view is None else view.tolist():
            if hasattr(value, "__iter__"):
                flat.extend(value)
            else:
                flat.append(value)
        owner = (element * len(flat))(*flat)
    return c.addressof(owner), len(owner), owner


class Context(_Object):
    """Threads and memory budget of all other objects.

    `threads`: number of worker threads; ALL_THREADS: one for each core; 0: none.
    `memory_budget`: limit in bytes of the memory of all models; 0: three quarters of the machine's memory.
    """

    def __init__(self, threads=ALL_THREADS, memory_budget=0):
        desc = ContextDesc(threads=threads, memory_budget=memory_budget)
        super().__init__("context", _lib.oc_context_create, HEADER_VERSION, c.byref(desc))

    def build(self, path, files=(), meshes=(), progress=None):
        """Builds the model file `path` from mesh files and from meshes in memory. Blocks until it is done.

        `files`: paths of PLY, OBJ, STL, glTF, GLB or raw files.
        `meshes`: tuples (part id, name, positions, indices). Positions are floats, three for each corner; indices are
        integers, three for each triangle. Both may be flat or nested.
        `progress`: a function that is called about every 100 ms with the fraction done, 0 to 1.
        Returns a BuildReport.
        """
        with _Object("build", _lib.oc_build_create, self._handle, None) as build:
            for number, name, positions, indices in meshes:
                _lib.oc_build_add_part(build._handle, c.byref(Part(id=number, name=name.encode())))
                at, count, owner = _array(positions, c.c_float)
                index_at, index_count, index_owner = _array(indices, c.c_uint32)
                triangles = Triangles(part=number, positions=at, position_count=count // 3, indices=index_at,
                                      index_count=index_count, index=1)
                _lib.oc_build_add_triangles(build._handle, c.byref(triangles))
                del owner, index_owner
            for file in files:
                _lib.oc_build_add_file(build._handle, os.fsencode(file))
            with _Object("job", _lib.oc_build_start, build._handle, os.fsencode(path)) as job:
                state = Progress(state=RUNNING)
                while state.state == RUNNING:
                    _lib.oc_job_wait(job._handle, 100 if progress else FOREVER, c.byref(state))
                    if progress:
                        progress(state.fraction)
                if state.state != DONE:
                    raise Error(state.error, _lib.last_error())
                report = BuildReport()
                _lib.oc_job_build_report(job._handle, c.byref(report))
                return report

    def open(self, path):
        """Opens a model file. Blocks while it reads."""
        return Model("model", _lib.oc_model_open, self._handle, os.fsencode(path))

    def scene(self, instances):
        """Returns a committed scene of instances: tuples (id, model) or (id, model, transform).

        The transform is 12 numbers by column: x axis, y axis, z axis, origin.
        """
        scene = Scene("scene", _lib.oc_scene_create, self._handle)
        for number, model, *place in instances:
            matrix = (c.c_double * 12)(*place[0]) if place else None
            _lib.oc_scene_add_instance(scene._handle, model._handle, number, matrix)
        _lib.oc_scene_commit(scene._handle)
        return scene

    def render(self, scene, camera, width, height, samples=1):
        """Renders an exact picture of the scene with `samples` rays for each pixel. Blocks until it is done.

        Raises Error if the picture is not exact, e.g. because its data does not fit the memory budget.
        """
        desc = FrameDesc(width=width, height=height)
        frame = Frame("frame", _lib.oc_frame_create, self._handle, c.byref(desc))
        settings, state = FrameSettings(samples=samples), Progress()
        _lib.oc_frame_request(frame._handle, scene._handle, c.byref(camera), c.byref(settings))
        _lib.oc_frame_wait(frame._handle, FOREVER, c.byref(state))
        if state.state != DONE:
            raise Error(state.error, _lib.last_error())
        return frame


class Model(_Object):
    """A built model."""

    @property
    def info(self):
        info = ModelInfo()
        _lib.oc_model_get_info(self._handle, c.byref(info))
        return info

    @property
    def parts(self):
        """A list of (id, name) of all parts."""
        found = []
        for index in range(self.info.parts):
            part = PartInfo()
            _lib.oc_model_get_part(self._handle, index, c.byref(part))
            found.append((part.id, part.name.decode()))
        return found

    def view(self, number):
        """Returns a camera that fits the model: 0 and 1 show all of it, 2 and 3 from a quarter of the distance."""
        camera = Camera()
        _lib.oc_model_get_view(self._handle, number, c.byref(camera))
        return camera


class Scene(_Object):
    """A committed scene of instances of models."""

    def closest(self, rays):
        """Returns the closest Hit of each ray. A ray is (origin, direction), three numbers each. A miss is false."""
        batch = (Ray * len(rays))()
        for ray, (origin, direction) in zip(batch, rays):
            ray.origin[:], ray.direction[:] = origin, direction
        hits = (Hit * len(rays))()
        query = Query(rays=c.addressof(batch), count=len(rays))
        _lib.oc_scene_closest(self._handle, c.byref(query), hits, 0)
        return list(hits)


    def set_parts_look(self, parts, hidden=False, selected=False, colour=None, below=False, instance=1):
        """Sets the look of parts, given by id; with `below`, of all parts below them too. Takes effect at commit()."""
        flags = (1 if hidden else 0) | (2 if selected else 0) | (4 if colour else 0)
        look = Look(flags=flags)
        if colour:
            look.colour[:] = colour
        ids = (c.c_uint64 * len(parts))(*parts)
        _lib.oc_scene_set_parts_look(self._handle, instance, ids, len(parts), 1 if below else 0, c.byref(look))

    def isolate(self, parts, below=False, instance=1):
        """Hides all parts but these. Takes effect at commit()."""
        ids = (c.c_uint64 * len(parts))(*parts)
        _lib.oc_scene_isolate(self._handle, instance, ids, len(parts), 1 if below else 0)

    def clear_part_looks(self, instance=1):
        """Shows all parts as in the file. Takes effect at commit()."""
        _lib.oc_scene_clear_part_looks(self._handle, instance)

    def commit(self):
        """Makes the edits visible to later requests and queries."""
        _lib.oc_scene_commit(self._handle)


class Frame(_Object):
    """A complete picture."""

    def pixels(self):
        """Returns (width, height, bytes). A pixel has four bytes: sRGB and alpha. The first row is the top one."""
        pixels = Pixels()
        _lib.oc_frame_map(self._handle, 0, c.byref(pixels))
        try:
            return pixels.width, pixels.height, c.string_at(pixels.data, pixels.size)
        finally:
            _lib.oc_mapping_release(pixels.mapping)

    def pick(self, x, y):
        """Returns the exact Hit at a pixel, counted from the top left corner."""
        hit = Hit()
        _lib.oc_frame_pick(self._handle, x, y, c.byref(hit))
        return hit
