"""Frames: views that are rendered in the background, and their pictures."""

from __future__ import annotations

import ctypes as c
import os
from collections.abc import AsyncIterator, Callable, Generator, Iterable, Mapping
from typing import Any

import numpy

from . import _abi
from ._arrays import Array, address, given
from ._callbacks import WAKE, Entry, Listeners
from ._enums import Buffer, Format, State
from ._handles import Handle, Reference, made
from ._jobs import awaited, read_progress, wait_in_slices
from ._library import lib
from ._png import png
from ._queries import Hit
from ._scene import Scene
from ._value import real, whole
from ._values import Accuracy, Camera, FrameSettings, Progress


def _elements(pixel: Format) -> tuple[str, int]:
    """Returns type and number of the elements of a pixel: ("f4", 3) of F32X3."""
    kind, _, count = pixel.name.partition("X")
    return f"{kind[0].lower()}{int(kind[1:]) // 8}", int(count or 1)


class MappedBuffer(Handle):
    """Keeps a buffer readable. numpy makes arrays of it, which keep it alive."""

    _kind = "Mapping"
    _release = lib.oc_mapping_release

    def __init__(self, pixels: _abi.oc_pixels) -> None:
        super().__init__(pixels.mapping)
        kind, channels = _elements(Format(pixels.format))
        size = numpy.dtype(kind).itemsize
        shape: tuple[int, ...] = (pixels.height, pixels.width) + ((channels,) if channels > 1 else ())
        strides: tuple[int, ...] = (pixels.row_pitch, size * channels) + ((size,) if channels > 1 else ())
        self.__array_interface__ = {
            "version": 3, "shape": shape, "strides": strides, "typestr": numpy.dtype(kind).str,
            "data": (pixels.data, True),
        }


def target_of(buffer: Buffer, array: Any, width: int, height: int) -> _abi.oc_target:
    """Checks the caller's memory for a buffer."""
    kind, channels = _abi.BUFFERS[buffer]
    dtype = numpy.dtype(kind)
    shape = (height, width) + ((channels,) if channels > 1 else ())
    name = f"targets[Buffer.{Buffer(buffer).name}]"
    if not isinstance(array, numpy.ndarray) or array.dtype != dtype:
        what = given(array) if isinstance(array, numpy.ndarray) else type(array).__name__
        raise TypeError(f"{name}: expected shape {shape}, dtype {dtype}, not {what}")
    packed = (dtype.itemsize * channels, dtype.itemsize)[:len(shape) - 1]
    is_whole = array.shape == shape and array.strides[1:] == packed and array.strides[0] >= packed[0] * width
    if not is_whole or not array.flags.writeable:
        raise ValueError(f"{name}: expected writeable memory of shape {shape}, dtype {dtype}, with packed rows, not "
                         f"{given(array)}, strides {array.strides}")
    pitch = array.strides[0]
    return _abi.oc_target(memory=address(array), size=pitch * (height - 1) + width * packed[0], row_pitch=pitch,
                          buffer=buffer)


class Frame(Handle):
    """One view that is rendered in the background, made by `Context.frame`.

    `request` begins a picture and returns at once. `wait`, `await` and `on_picture` tell when it is ready; `picture`
    and `map` return what is there.
    """

    _kind = "Frame"
    _release = lib.oc_frame_release

    def __init__(self, context: Reference, width: int, height: int, buffers: Iterable[Buffer],
                 targets: Mapping[Buffer, Array]) -> None:
        self._buffers = tuple(Buffer(one) for one in buffers) or (() if targets else (Buffer.COLOUR_SRGB8,))
        desc = _abi.oc_frame_desc(width=whole("width", width, 32), height=whole("height", height, 32))
        desc.buffers = sum({1 << one for one in self._buffers})
        checked = [target_of(buffer, array, width, height) for buffer, array in targets.items()]
        array = (_abi.oc_target * len(checked))(*checked)
        desc.targets, desc.target_count = c.addressof(array), len(checked)
        super().__init__(made(lib.oc_frame_create, context, c.byref(desc)), context)
        self._targets = list(targets.values())
        self._h.keep.append(self._targets)
        self._listeners = Listeners()
        self._wakes = False

    @property
    def buffers(self) -> tuple[Buffer, ...]:
        """The buffers that `map` returns."""
        return self._buffers

    def request(self, scene: Scene, camera: Camera, settings: FrameSettings | None = None) -> None:
        """Begins a picture of the committed scene. The previous request of this frame is cancelled and replaced."""
        options = None if settings is None else c.byref(settings._to_c())
        lib.oc_frame_request(self._h, scene._h, c.byref(camera._to_c()), options)

    def poll(self) -> Progress:
        """Returns the progress of the last request. Does not raise if it has failed: see its `state` and `error`."""
        return read_progress(lambda out: lib.oc_frame_poll(self._h, out))[0]

    def _checked_poll(self) -> Progress:
        """Returns the progress. Raises the failure of the request. (A wait would also wait for the wake function.)"""
        progress, wrong = read_progress(lambda out: lib.oc_frame_poll(self._h, out))
        if wrong is not None:
            raise wrong
        return progress

    def wait(self, timeout: float | None = None, progress: Callable[[float], object] | None = None) -> Progress:
        """Waits until the last request has ended, or for `timeout` seconds; the state is then RUNNING.

        The state is DONE, or COMPLETE_WITHIN_BUDGET: the picture is coarser than requested, because its data does not
        fit the memory budget. That is not an error. Ctrl-C cancels the request and raises KeyboardInterrupt.

        Raises:
            Cancelled: the request was cancelled.
            Error: the request failed.
        """
        frame = self._h
        return wait_in_slices(lambda ms, out: lib.oc_frame_wait(frame, ms, out), lambda: lib.oc_frame_cancel(frame),
                              timeout, progress)

    def cancel(self) -> None:
        """Cancels the last request. The last complete picture stays."""
        lib.oc_frame_cancel(self._h)

    def resize(self, width: int, height: int) -> None:
        """Changes the size of later pictures. The running request is cancelled, and the targets are removed."""
        lib.oc_frame_resize(self._h, whole("width", width, 32), whole("height", height, 32))
        self._targets.clear()

    @property
    def accuracy(self) -> Accuracy:
        """How exact the last complete picture is."""
        accuracy = _abi.oc_frame_accuracy()
        lib.oc_frame_get_accuracy(self._h, c.byref(accuracy))
        return Accuracy._from_c(accuracy)

    def map(self, buffer: Buffer = Buffer.COLOUR_SRGB8) -> Array:
        """Returns a buffer of the last complete picture, without a copy: read-only, the first row is the top one.

        The array stays valid and unchanged as long as it lives, whatever happens to the frame.
        """
        pixels = _abi.oc_pixels()
        lib.oc_frame_map(self._h, whole("buffer", buffer, 32), c.byref(pixels))
        return numpy.asarray(MappedBuffer(pixels))

    def picture(self) -> Picture:
        """Returns the last complete picture with all its buffers."""
        return Picture(self)

    def pick(self, x: int, y: int) -> Hit:
        """Returns the exact hit at a pixel, counted from the top left corner. A miss is false."""
        hit = _abi.oc_hit()
        lib.oc_frame_pick(self._h, whole("x", x, 32), whole("y", y, 32), c.byref(hit))
        return Hit._from_c(hit)

    def pick_near(self, x: int, y: int, radius: float = 4.0) -> Hit:
        """Returns a hit within a radius in pixels, and favours thin parts, such as wires of less than a pixel.

        A part is thin if it covers less than a fifth of the picture within `radius` of its nearest point. Without one,
        the hit is that at the pixel; or, if that is a miss, the nearest.
        """
        hit = _abi.oc_hit()
        lib.oc_frame_pick_near(self._h, whole("x", x, 32), whole("y", y, 32), real("radius", radius), c.byref(hit))
        return Hit._from_c(hit)

    def on_picture(self, listener: Callable[[], object] | None) -> None:
        """Calls the function for each better picture and at the end of each request, from any thread. None: no more.

        The function must return soon and must not wait. An event loop's `call_soon_threadsafe` is a good one.
        """
        self._listeners.always = listener
        self._set_wake()

    def _set_wake(self) -> None:
        """Registers the wake function at its first use."""
        if not self._wakes:
            self._wakes = True
            entry = Entry(self._listeners.wake)
            self._h.keep.append(entry)
            lib.oc_frame_set_wake(self._h, WAKE, entry.key)

    def _next_wake(self, listener: Callable[[], object]) -> None:
        """Calls the function at the next wake; at once if nothing runs."""
        self._listeners.add_once(listener)
        self._set_wake()
        if self.poll().state != State.RUNNING:
            self._listeners.wake()

    async def pictures(self) -> AsyncIterator[Picture]:
        """Returns each better picture of the request as it comes; the last one is as exact as it gets."""
        seen = 0
        while True:
            progress = self._checked_poll()
            if (now := self.accuracy.pictures) > seen:
                seen = now
                yield self.picture()
            if progress.state != State.RUNNING:
                return
            await awaited(self._next_wake, self.cancel)

    async def _awaited(self) -> Progress:
        while (progress := self._checked_poll()).state == State.RUNNING:
            await awaited(self._next_wake, self.cancel)
        return progress

    def __await__(self) -> Generator[Any, None, Progress]:
        return self._awaited().__await__()


class Picture:
    """A complete picture: its buffers, and how exact they are. Notebooks show it."""

    def __init__(self, frame: Frame) -> None:
        self._frame = frame
        self._maps = {one: frame.map(one) for one in frame.buffers}
        self.state: State = frame.poll().state
        """DONE: as exact as requested. COMPLETE_WITHIN_BUDGET: as exact as the memory budget allows. RUNNING: a better
        one will come."""
        self.accuracy: Accuracy = frame.accuracy
        """How exact the picture is."""

    @property
    def complete(self) -> bool:
        """True if the picture is as exact as requested."""
        return self.state == State.DONE

    @property
    def pixels(self) -> Array:
        """The colours: (height, width, 4) of uint8, sRGB and linear alpha. The first row is the top one."""
        return self[Buffer.COLOUR_SRGB8]

    def __getitem__(self, buffer: Buffer) -> Array:
        """A buffer, e.g. `picture[Buffer.DEPTH]`, as a read-only array without a copy."""
        try:
            return self._maps[Buffer(buffer)]
        except KeyError:
            raise KeyError(f"the frame has no Buffer.{Buffer(buffer).name}; name it in `buffers`") from None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        height, width = next(iter(self._maps.values())).shape[:2]
        return height, width

    def pick(self, x: int, y: int) -> Hit:
        """Returns the exact hit at a pixel, counted from the top left corner. A miss is false."""
        return self._frame.pick(x, y)

    def pick_near(self, x: int, y: int, radius: float = 4.0) -> Hit:
        """Returns a hit within a radius in pixels, with a preference for thin parts. See `Frame.pick_near`."""
        return self._frame.pick_near(x, y, radius)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        wants_copy = copy or (dtype is not None and numpy.dtype(dtype) != self.pixels.dtype)
        return self.pixels.astype(dtype or self.pixels.dtype) if wants_copy else self.pixels

    def _repr_png_(self) -> bytes:
        """The picture in a notebook."""
        return png(self.pixels)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the picture to a PNG file, or with Pillow, if it is installed, to any file that it knows."""
        if os.fspath(path).lower().endswith(".png"):
            with open(path, "wb") as file:
                file.write(png(self.pixels))
            return
        try:
            from PIL import Image
        except ImportError:
            raise ValueError(f"path: {os.fspath(path)} does not end with .png; other formats need Pillow") from None
        is_opaque = os.fspath(path).lower().endswith((".jpg", ".jpeg"))
        Image.fromarray(self.pixels[..., :3] if is_opaque else self.pixels).save(path)

    def __repr__(self) -> str:
        height, width = self.shape
        error = f", errors up to {self.accuracy.worst_error:.3g} pixels" if self.accuracy.worst_error else ""
        return f"<Picture {width}x{height}, {self.state.name}{error}>"
