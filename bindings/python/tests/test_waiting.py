"""Ctrl-C ends waits, asyncio awaits, and other threads may use and close objects."""

from __future__ import annotations

import asyncio
import concurrent.futures
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy
import pytest
from conftest import PACKAGE, TETRA, TETRA_FACES, bumps

import outcrop
from outcrop import State

OBJ = "mtllib x.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
SLOWEST = outcrop.FrameSettings(samples=1024)


def interrupt(seconds: float) -> threading.Timer:
    """Presses Ctrl-C after some time."""
    timer = threading.Timer(seconds, signal.raise_signal, [signal.SIGINT])
    timer.start()
    return timer


@pytest.mark.parametrize("threads", [2, 0])
def test_ctrl_c_ends_a_picture(tetra: outcrop.Model, tmp_path: Path, camera: outcrop.Camera, threads: int) -> None:
    with outcrop.Context(threads=threads) as own, own.open(tmp_path / "tetra.oc") as model, own.scene(model) as scene:
        began = time.monotonic()
        interrupt(0.2)
        with pytest.raises(KeyboardInterrupt):
            own.render(scene, camera, 4096, 4096, settings=SLOWEST)
        assert time.monotonic() - began < 60
        assert own.render(scene, camera, 32, 32).complete and scene.any_one((0.1, 0.1, 9), (0, 0, -1))


def test_ctrl_c_ends_a_build(context: outcrop.Context, tmp_path: Path) -> None:
    (tmp_path / "x.obj").write_text(OBJ)

    def resolve(_uri: str, _file: str) -> None:
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.5)

    with pytest.raises(KeyboardInterrupt):
        context.build(tmp_path / "x.oc", tmp_path / "x.obj", resolve=resolve)
    assert not (tmp_path / "x.oc").exists()
    assert context.build(tmp_path / "x.oc", tmp_path / "x.obj").triangles_kept == 1


@pytest.mark.parametrize("threads", [2, 0])
def test_ctrl_c_ends_an_opening(tetra: outcrop.Model, tmp_path: Path, threads: int) -> None:
    content = (tmp_path / "tetra.oc").read_bytes()

    class Slow:
        size, calls = len(content), 0

        def read_at(self, offset: int, buffer: memoryview) -> None:
            self.calls += 1
            if self.calls == 1:
                signal.raise_signal(signal.SIGINT)
                time.sleep(0.2)
            buffer[:] = content[offset:offset + len(buffer)]

    with outcrop.Context(threads=threads) as own:
        with pytest.raises(KeyboardInterrupt):
            own.open(Slow())
        with own.open(content) as model:
            assert model.info.parts == 1


def test_ctrl_c_ends_a_batch(context: outcrop.Context, tmp_path: Path) -> None:
    context.build(tmp_path / "a.oc", outcrop.Mesh(*bumps(100)))
    with context.open(tmp_path / "a.oc") as model, context.scene(model) as scene:
        rays = outcrop.rays(numpy.random.default_rng(1).uniform(0, 1, (1_000_000, 3)), (0.3, 0.2, -1))
        interrupt(0.1)
        with pytest.raises(KeyboardInterrupt):
            while True:
                scene.any(rays)
        assert scene.closest(rays[:10]).shape == (10,)


def test_exceptions_of_the_progress_function_cancel(context: outcrop.Context, tmp_path: Path) -> None:
    def stop(_fraction: float) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        context.build(tmp_path / "a.oc", outcrop.Mesh(*bumps(500)), progress=stop)


def test_timeouts(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    with context.frame(2048, 2048) as frame:
        frame.request(scene, camera, SLOWEST)
        assert frame.wait(0).state == State.RUNNING and frame.wait(0.02).state == State.RUNNING
        frame.cancel()
        with pytest.raises(outcrop.Cancelled) as caught:
            frame.wait()
        assert caught.value.status == outcrop.Status.CANCELLED


def test_asyncio(context: outcrop.Context, tmp_path: Path, camera: outcrop.Camera) -> None:
    async def work() -> None:
        report = await context.build_start(tmp_path / "a.oc", outcrop.Mesh(TETRA, TETRA_FACES))
        assert report.triangles_kept == 4
        model = await context.load(tmp_path / "a.oc")
        with model, context.scene(model) as scene, context.frame(64, 48) as frame:
            rays = outcrop.rays(numpy.full((1000, 3), (0.1, 0.1, 9.0)), (0, 0, -1))
            hits, answers = await asyncio.gather(scene.closest_start(rays), scene.any_start(rays))
            assert hits["kind"].all() and answers.all()
            frame.request(scene, camera)
            assert (await frame).state == State.DONE and (await frame).state == State.DONE
            frame.request(scene, camera, outcrop.FrameSettings(samples=64))
            assert [picture.state async for picture in frame.pictures()][-1] == State.DONE
            frame.request(scene, camera, SLOWEST)
            frame.resize(2048, 2048)
            frame.request(scene, camera, SLOWEST)
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(_progress(frame), 0.1)
            with pytest.raises(outcrop.Cancelled):
                frame.wait()
        with pytest.raises(outcrop.MachineError, match="missing"):
            await context.load(tmp_path / "missing.oc")

    asyncio.run(work())


async def _progress(frame: outcrop.Frame) -> outcrop.Progress:
    return await frame


def test_listeners_of_jobs(context: outcrop.Context, scene: outcrop.Scene) -> None:
    calls: list[int] = []
    with scene.closest_start([(0, 0, 9)], [(0, 0, -1)]) as job:
        first, second = threading.Event(), threading.Event()
        job.on_end(first.set)
        assert first.wait(30)
        job.on_end(second.set)
        assert second.wait(30)
        job.on_end(lambda: calls.append(1))
        assert calls == [1]


def test_callbacks_may_drop_objects(context: outcrop.Context, tetra: outcrop.Model, tmp_path: Path,
                                    camera: outcrop.Camera) -> None:
    content = (tmp_path / "tetra.oc").read_bytes()
    garbage: list[Any] = [context.scene(tetra), context.frame(64, 48)]
    garbage[1].request(garbage[0], camera)

    class Dropping:
        size = len(content)

        def read_at(self, offset: int, buffer: memoryview) -> None:
            garbage.clear()
            buffer[:] = content[offset:offset + len(buffer)]

    with context.open(Dropping()) as model, context.scene(model) as scene:
        assert garbage == [] and outcrop.live() == ["Context", "Model", "Model", "Scene"]
        jobs = [scene.closest_start([(0, 0, 9)], [(0, 0, -1)])]
        ended = threading.Event()
        jobs[0].on_end(lambda: (jobs.pop().close(), ended.set()))  # type: ignore[func-returns-value]
        assert ended.wait(30) and "Job" not in outcrop.live()


def test_a_context_without_threads(tetra: outcrop.Model, tmp_path: Path, camera: outcrop.Camera) -> None:
    with outcrop.Context(threads=0) as own:
        assert own.property(outcrop.Property.THREADS) == 0 and not own.step()
        own.build(tmp_path / "b.oc", outcrop.Mesh(TETRA, TETRA_FACES))
        with own.open(tmp_path / "b.oc") as model, own.scene(model) as scene, own.frame(64, 48) as frame:
            assert scene.any([(0.1, 0.1, 9)], (0, 0, -1)).all()
            frame.request(scene, camera)
            while frame.poll().state == State.RUNNING:
                own.step()
            assert frame.picture().complete


def test_executor(tmp_path: Path, camera: outcrop.Camera) -> None:
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        with outcrop.Context(executor=pool) as own:
            assert own.property(outcrop.Property.CONCURRENCY) == 2 and own.property(outcrop.Property.THREADS) == 0
            own.build(tmp_path / "a.oc", outcrop.Mesh(TETRA, TETRA_FACES))
            with own.open(tmp_path / "a.oc") as model, own.scene(model) as scene:
                assert own.render(scene, camera, 64, 48).complete
                assert scene.closest([(0.1, 0.1, 9)], (0, 0, -1))["kind"][0] == outcrop.HitKind.EXACT
    with pytest.raises(ValueError, match="concurrency: the executor"):
        outcrop.Context(executor=object())


def test_log(tmp_path: Path) -> None:
    lines: list[tuple[outcrop.LogLevel, str]] = []
    with outcrop.Context(threads=1, log=lambda level, text: lines.append((level, text)), read_ahead=False,
                         instruction_set=outcrop.InstructionSet.BASELINE):
        pass
    assert lines and lines[0][0] == outcrop.LogLevel.INFO and "outcrop" in lines[0][1]


def test_objects_that_are_closed_while_others_use_them(context: outcrop.Context, tetra: outcrop.Model) -> None:
    scene = context.scene(tetra)
    rays = outcrop.rays(numpy.full((200_000, 3), (0.1, 0.1, 9.0)), (0, 0, -1))
    sums: list[Any] = []
    thread = threading.Thread(target=lambda: sums.append(int(scene.any(rays).sum())))
    job = scene.closest_start(rays)
    thread.start()
    job.close()
    thread.join()
    scene.close()
    scene.close()
    assert sums == [200_000]
    with pytest.raises(ValueError, match="this Scene is closed"):
        scene.commit()
    with pytest.raises(ValueError, match="this Job is closed"):
        job.wait()


def test_the_interpreter_ends_while_python_reads(tetra: outcrop.Model, tmp_path: Path) -> None:
    code = """
import sys, time, outcrop
class Slow:
    content = open("tetra.oc", "rb").read()
    size = len(content)
    def read_at(self, offset, buffer):
        time.sleep(0.3)
        buffer[:] = self.content[offset:offset + len(buffer)]
class Late:
    def __del__(self, sleep=time.sleep, write=sys.stderr.write):
        sleep(1)  # while the interpreter ends
        write("late")
late = Late()
context = outcrop.Context(threads=2, log=print)
job = context.load(Slow())
job.on_end(print)
time.sleep(0.1)
"""
    environment = {"PYTHONPATH": str(PACKAGE), "OUTCROP_LIBRARY": outcrop.library_path}
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], cwd=tmp_path, timeout=60, text=True,
                          capture_output=True, env=environment)
    assert done.returncode == 0 and done.stderr == "late", done


def test_a_job_released_while_it_runs_does_not_end_the_process(tmp_path: Path) -> None:
    # Its thread called the wake function while the interpreter ended, which aborts the process.
    code = """
import numpy, outcrop
context = outcrop.Context(threads=1)
corners = numpy.random.default_rng(1).random((900_000, 3))
job = context.build_start("a.oc", outcrop.Mesh(corners))
job.on_end(list)
job.close()
"""
    environment = {"PYTHONPATH": str(PACKAGE), "OUTCROP_LIBRARY": outcrop.library_path}
    for _ in range(4):
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, timeout=60, text=True, capture_output=True,
                              env=environment)
        assert done.returncode == 0 and not done.stderr, done
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_ends_thickness_and_triangles(context: outcrop.Context, three: outcrop.Scene) -> None:
    hits = three.closest(outcrop.rays(numpy.full((1_500_000, 3), (-5, 0.1, 0.2)), (1, 0, 0)))
    whole = three.thickness(hits[:200_000])
    assert (whole == whole[0]).all() and (three.triangles(hits[:200_000])["prim"] == hits["prim"][0]).all()
    hits["part"][150_000] = 77
    with pytest.raises(outcrop.ArgumentError, match="of the hits from 131072 on: .*hit 4"):
        three.triangles(hits[:200_000])
    hits["part"][150_000] = hits["part"][0]
    for call in (three.thickness, three.triangles):
        timer = interrupt(0.2)
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            call(hits)
        took = time.monotonic() - began
        timer.join()
        assert took < 2


def test_order_of_releases_is_free(tmp_path: Path, camera: outcrop.Camera) -> None:
    context = outcrop.Context(threads=1)
    context.build(tmp_path / "a.oc", outcrop.Mesh(TETRA, TETRA_FACES))
    model = context.open(tmp_path / "a.oc")
    scene = context.scene(model)
    picture = context.render(scene, camera, 32, 32)
    context.close()
    model.close()
    assert scene.any_one((0.1, 0.1, 9), (0, 0, -1))
    scene.close()
    assert picture.pick(16, 16).part == 0
