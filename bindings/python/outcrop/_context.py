"""Contexts: threads and the memory budget of all other objects."""

from __future__ import annotations

import ctypes as c
import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from . import _abi
from ._arrays import Array
from ._build import Build, BuildJob, BuildReport, Resolver
from ._callbacks import LOG, SUBMIT, Entry
from ._enums import Buffer, ContextFlags, InstructionSet, LogLevel, Property, StandIns, State
from ._errors import Error
from ._frame import Frame, Picture
from ._handles import Handle, Reference, made
from ._io import Opening, Source, reader
from ._jobs import Job, release_job
from ._library import lib
from ._meshes import Mesh, Sources, flatten
from ._model import Model
from ._scene import Placed, Scene
from ._value import whole
from ._values import BuildOptions, Camera, FrameSettings, Progress


class Context(Handle):
    """Threads, log and memory budget. All other objects are made by a context.

    threads: number of worker threads. ALL_THREADS: one for each core. 0: none; work is then done in waits and `step`.
    memory_budget: limit in bytes of the memory of all models. 0: three quarters of the machine's memory.
    log: a function that receives a level and a line, from any thread.
    executor: a concurrent.futures.Executor whose threads do the work, in place of threads of the library.
    concurrency: number of tasks that the executor runs at once. None: its number of workers.
    instruction_set: vector instructions. All sets give the same answers.
    read_ahead: models that fit the budget are read in the background.
    compact: models only have their compact form in memory, not also the form for exact rays.
    """

    _kind = "Context"
    _release = lib.oc_context_release

    def __init__(self, threads: int = _abi.OC_ALL_THREADS, memory_budget: int = 0, *,
                 log: Callable[[LogLevel, str], object] | None = None, executor: Any = None,
                 concurrency: int | None = None, instruction_set: InstructionSet = InstructionSet.BEST,
                 read_ahead: bool = True, compact: bool = False) -> None:
        desc = _abi.oc_context_desc(threads=whole("threads", threads, 32), instruction_set=instruction_set,
                                    memory_budget=whole("memory_budget", memory_budget))
        entries: list[Entry] = []
        desc.flags = (0 if read_ahead else ContextFlags.NO_READ_AHEAD) | (ContextFlags.COMPACT if compact else 0)
        if log is not None:
            entries.append(Entry(log))
            desc.log, desc.log_user = LOG, entries[-1].key
        if executor is not None:
            if concurrency is None:
                concurrency = getattr(executor, "_max_workers", None)
            if concurrency is None:
                raise ValueError("concurrency: the executor does not tell the number of its workers")
            entries.append(Entry(executor))
            table = _abi.oc_executor(concurrency=whole("concurrency", concurrency, 32), user=entries[-1].key,
                                     submit=SUBMIT)
            desc.executor = c.addressof(table)
        super().__init__(made(lib.oc_context_create, _abi.OC_HEADER_VERSION, c.byref(desc)))
        self._h.keep.extend(entries)

    def property(self, which: Property) -> int:
        """Returns a property, e.g. Property.MEMORY_USED."""
        value = c.c_uint64()
        lib.oc_context_property(self._h, whole("which", which, 32), c.byref(value))
        return value.value

    def step(self) -> bool:
        """Does one small piece of waiting work in this thread. Returns False if there was none."""
        did = c.c_uint32()
        lib.oc_context_step(self._h, c.byref(did))
        return bool(did.value)

    def new_build(self, options: BuildOptions | None = None, *, resolve: Resolver | None = None) -> Build:
        """Returns an empty build, to which meshes are added one by one. `build` does it all for most models."""
        return Build(self._h, options, resolve)

    def build_start(self, path: str | os.PathLike[str], sources: Sources, *, options: BuildOptions | None = None,
                    stand_ins: StandIns | str | None = None, resolve: Resolver | None = None) -> BuildJob:
        """Begins `build` in the background: `await` the job, or call its `result()`."""
        if stand_ins is not None:
            options = BuildOptions(**{**vars(options or BuildOptions()), "stand_ins": _stand_ins(stand_ins)})
        with self.new_build(options, resolve=resolve) as build:
            for source in flatten(sources):
                if isinstance(source, Mesh):
                    build.add_mesh(source)
                else:
                    build.add_file(source)
            return build.start(path)

    def build(self, path: str | os.PathLike[str], sources: Sources, *, options: BuildOptions | None = None,
              stand_ins: StandIns | str | None = None, resolve: Resolver | None = None,
              progress: Callable[[float], object] | None = None) -> BuildReport:
        """Builds the model file `path`. Waits until it is done; Ctrl-C cancels it and leaves no file.

        sources: paths of mesh files (PLY, OBJ, STL, glTF, GLB), `Mesh`, trimesh.Trimesh or Scene, pyvista.PolyData or
            MultiBlock; one of them, a list, or a dict whose keys are the names of the parts.
        options: memory budget, limits, up axis and the like.
        stand_ins: the look of stand-ins: "auto", "voxels", "proxies", or one of StandIns. Overrides that of `options`.
        resolve: finds files that mesh files refer to.
        progress: is called about 20 times a second with the share that is done, 0 to 1.
        """
        with self.build_start(path, sources, options=options, stand_ins=stand_ins, resolve=resolve) as job:
            return job.result(progress)

    def load(self, source: Source) -> Job[Model]:
        """Begins to open a model in the background: `await` the job, or call its `result()`. See `open`."""
        own = reader(source)
        if own is None:
            path = os.fsencode(source)  # type: ignore[arg-type]
            return _LoadJob(made(lib.oc_model_load, self._h, path, None), self._h, None)
        opening = Opening(own, getattr(source, "name", None) or type(source).__name__)
        return _LoadJob(made(lib.oc_model_load, self._h, None, c.byref(opening.table)), self._h, opening)

    def open(self, source: Source) -> Model:
        """Opens a model. Waits while it is read; the model may be larger than the memory budget.

        source: a path, bytes, a binary file object that can seek, or an object with `size` and `read_at(offset,
            buffer)`, which any thread calls.
        """
        with self.load(source) as job:
            return job.result()

    def scene(self, instances: Placed | Iterable[Placed] = ()) -> Scene:
        """Returns a committed scene of instances.

        instances: a model, or a list of models, of (id, model), or of (id, model, transform).
        """
        scene = Scene(self._h)
        scene.add_all(instances)
        scene.commit()
        return scene

    def open_scene(self, path: str | os.PathLike[str]) -> Scene:
        """Opens a scene file, and the models that it names. Waits while they are read.

        The scene is committed, and can be edited like any other.
        """
        return Scene(self._h, os.fsencode(path))

    def frame(self, width: int, height: int, *, buffers: Iterable[Buffer] = (),
              targets: Mapping[Buffer, Array] | None = None) -> Frame:
        """Returns a frame, which renders pictures in the background.

        buffers: what its pictures hold. None given: the colours.
        targets: your own memory for some buffers, which the frame writes to while it renders.
        """
        return Frame(self._h, width, height, buffers, targets or {})

    def render(self, scene: Scene, camera: Camera, width: int = 1024, height: int = 768, *, samples: int | None = None,
               settings: FrameSettings | None = None, buffers: Iterable[Buffer] = (Buffer.COLOUR_SRGB8,),
               progress: Callable[[float], object] | None = None) -> Picture:
        """Renders a picture. Waits until it is as exact as requested, or as the memory budget allows: see its `state`.

        samples: rays for the colour of a pixel. Overrides that of `settings`.
        settings: pixels of error, ambient light and the like. None: exact.
        """
        options = FrameSettings(**vars(settings)) if settings is not None else FrameSettings()
        if samples is not None:
            options.samples = samples
        frame = self.frame(width, height, buffers=buffers)
        frame.request(scene, camera, options)
        frame.wait(progress=progress)
        return frame.picture()


class _LoadJob(Job[Model]):
    """A model that is being opened. If the reader raised an exception, the wait raises it."""

    _release = release_job

    def __init__(self, address: int | None, context: Reference, opening: Opening | None) -> None:
        super().__init__(address, context, _model)
        self._opening = opening

    def wait(self, timeout: float | None = None, progress: Callable[[float], object] | None = None) -> Progress:
        if self._opening is None:
            return super().wait(timeout, progress)
        try:
            done = super().wait(timeout, progress)
        except Error as error:
            cause, self._opening.error = self._opening.error, None
            if cause is not None and not isinstance(cause, Exception):
                raise cause from None  # KeyboardInterrupt, in a context without threads
            raise error from cause
        self._opening.is_open = done.state != State.RUNNING
        return done


def _model(job: Reference, _progress: Progress) -> Model:
    """Returns the model of a load."""
    return Model(made(lib.oc_job_model, job), job)


def _stand_ins(kind: StandIns | str) -> StandIns:
    """Returns a kind of stand-ins, which may be given by its name."""
    if isinstance(kind, StandIns):
        return kind
    kinds = {one.name.lower(): one for one in StandIns}
    message = f"stand_ins must be StandIns or one of {', '.join(map(repr, kinds))}, not {kind!r}"
    if not isinstance(kind, str):
        raise TypeError(message)
    if kind not in kinds:
        raise ValueError(message)
    return kinds[kind]
