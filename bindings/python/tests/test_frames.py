"""Frames and pictures."""

from __future__ import annotations

import struct
import threading
import zlib
from pathlib import Path
from typing import Any

import numpy
import pytest
from conftest import bumps, need

import outcrop
from outcrop import Buffer, State

ALL = list(Buffer)


def read_png(content: bytes) -> Any:
    """Reads a PNG of RGBA without filters."""
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    at, chunks = 8, {}
    while at < len(content):
        size, kind = struct.unpack_from(">I4s", content, at)
        assert zlib.crc32(content[at + 4:at + 8 + size]) == struct.unpack_from(">I", content, at + 8 + size)[0]
        chunks[kind] = content[at + 8:at + 8 + size]
        at += 12 + size
    width, height = struct.unpack_from(">II", chunks[b"IHDR"])
    rows = numpy.frombuffer(zlib.decompress(chunks[b"IDAT"]), numpy.uint8).reshape(height, 1 + 4 * width)
    return rows[:, 1:].reshape(height, width, 4)


def test_all_buffers(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    fractions: list[float] = []
    picture = context.render(scene, camera, 64, 48, samples=4, buffers=ALL, progress=fractions.append)
    assert picture.complete and picture.state == State.DONE and picture.shape == (48, 64) and fractions[-1] == 1
    assert picture.accuracy.pixels_exact == picture.accuracy.pixels_total == 64 * 48
    shapes = {buffer: (picture[buffer].shape[2:], picture[buffer].dtype.str[1:]) for buffer in ALL}
    assert shapes.items() >= {
        Buffer.COLOUR_SRGB8: ((4,), "u1"), Buffer.COLOUR_LINEAR: ((4,), "f4"), Buffer.DEPTH: ((), "f4"),
        Buffer.NORMAL: ((3,), "f4"), Buffer.PART: ((), "u8"), Buffer.PRIM: ((), "u8"), Buffer.INSTANCE: ((), "u8"),
        Buffer.OCCURRENCE: ((), "u8"), Buffer.KIND: ((), "u1"), Buffer.ERROR: ((), "f4"),
    }.items()
    hit = picture.pick(32, 24)
    assert hit and hit.part == picture[Buffer.PART][24, 32] == 7 and hit.prim == picture[Buffer.PRIM][24, 32]
    assert picture[Buffer.DEPTH][0, 0] == numpy.inf and picture[Buffer.PART][0, 0] == outcrop.NO_ID
    assert not picture.pick(0, 0) and "64x48" in repr(picture)
    with pytest.raises(KeyError, match="Buffer.DEPTH"):
        context.render(scene, camera, 8, 8)[Buffer.DEPTH]
    with pytest.raises(outcrop.ArgumentError):
        picture.pick(64, 0)


def test_arrays_outlive_their_frame(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    frame = context.frame(64, 48, buffers=[Buffer.COLOUR_SRGB8, Buffer.DEPTH])
    with pytest.raises(outcrop.StateError):
        frame.map()
    frame.request(scene, camera)
    assert frame.wait().state == State.DONE
    first, again = frame.map(), frame.map()
    assert numpy.shares_memory(first, again) and not first.flags.writeable
    content = first.copy()
    frame.request(scene, outcrop.Camera(eye=(9, 9, 9)))
    frame.wait()
    assert not numpy.shares_memory(first, frame.map())
    frame.close()
    row = first[10]
    del first, again
    assert numpy.array_equal(row, content[10]) and outcrop.live().count("Mapping") == 1
    with pytest.raises(ValueError, match="this Frame is closed"):
        frame.poll()


def test_targets_have_the_elements_of_mapped_buffers(context: outcrop.Context, scene: outcrop.Scene,
                                                     camera: outcrop.Camera) -> None:
    picture = context.render(scene, camera, 64, 48, buffers=ALL)
    targets = {buffer: numpy.zeros_like(picture[buffer]) for buffer in ALL}
    with context.frame(64, 48, targets=targets) as frame:
        frame.request(scene, camera)
        frame.wait()
    assert all(numpy.array_equal(targets[buffer], picture[buffer]) for buffer in ALL)


def test_targets(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    depth = numpy.zeros((48, 80), numpy.float32)[:, 8:72]
    colour = numpy.zeros((48, 64, 4), numpy.uint8)
    with context.frame(64, 48, targets={Buffer.DEPTH: depth, Buffer.COLOUR_SRGB8: colour}) as frame:
        frame.request(scene, camera)
        frame.wait()
    picture = context.render(scene, camera, 64, 48, buffers=[Buffer.DEPTH, Buffer.COLOUR_SRGB8])
    assert numpy.array_equal(depth, picture[Buffer.DEPTH]) and numpy.array_equal(colour, picture.pixels)
    for wrong, error in [(depth.astype("f8"), TypeError), ([1, 2], TypeError), (depth[:, ::2], ValueError),
                         (depth.T, ValueError), (depth[::-1], ValueError), (depth[:40], ValueError)]:
        with pytest.raises(error, match=r"targets\[Buffer.DEPTH\]: expected"):
            context.frame(64, 48, targets={Buffer.DEPTH: wrong})


def test_course_of_a_request(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    woken = threading.Event()
    with context.frame(64, 48) as frame:
        assert frame.poll().state == State.IDLE and frame.accuracy.request == 0
        frame.on_picture(woken.set)
        frame.request(scene, camera, outcrop.FrameSettings(samples=2, poe=1))
        frame.wait()
        assert woken.wait(30) and frame.accuracy.pictures >= 1 and frame.accuracy.request == 1
        frame.on_picture(None)
        frame.resize(32, 16)
        frame.request(scene, camera)
        frame.wait()
        assert frame.picture().shape == (16, 32)
        frame.request(scene, camera, outcrop.FrameSettings(samples=1024))
        frame.cancel()
        if frame.poll().state == State.CANCELLED:
            with pytest.raises(outcrop.Cancelled):
                frame.wait()
        with pytest.raises(outcrop.ArgumentError):
            frame.request(scene, outcrop.Camera())


def test_png_and_files(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera, tmp_path: Path) -> None:
    picture = context.render(scene, camera, 33, 17)
    assert numpy.array_equal(read_png(picture._repr_png_()), picture.pixels)
    picture.save(tmp_path / "a.png")
    assert numpy.array_equal(read_png((tmp_path / "a.png").read_bytes()), picture.pixels)
    assert numpy.array_equal(numpy.asarray(picture), picture.pixels)
    assert numpy.asarray(picture, dtype=float).dtype == float and numpy.array(picture).flags.writeable
    image = need("PIL.Image")
    picture.save(tmp_path / "a.jpg")
    with image.open(tmp_path / "a.jpg") as jpg, image.open(tmp_path / "a.png") as png:
        assert jpg.size == (33, 17) and numpy.array_equal(numpy.asarray(png), picture.pixels)


def test_a_picture_within_the_budget_is_no_error(tmp_path: Path) -> None:
    with outcrop.Context(threads=2) as context:
        context.build(tmp_path / "large.oc", outcrop.Mesh(*bumps(1000)))
    with outcrop.Context(threads=2, memory_budget=4 << 20) as context:
        with context.open(tmp_path / "large.oc") as model, context.scene(model) as scene:
            settings = outcrop.FrameSettings(flags=outcrop.FrameFlags.AT_ONCE)
            picture = context.render(scene, model.view(), 800, 600, settings=settings)
            assert picture.state == State.COMPLETE_WITHIN_BUDGET and not picture.complete
            assert "COMPLETE_WITHIN_BUDGET" in repr(picture) and picture.accuracy.effective_poe > 0
            assert picture.pixels.shape == (600, 800, 4)
            with scene.prefetch_box(*model.bounds) as job:
                assert job.result().state == State.COMPLETE_WITHIN_BUDGET
