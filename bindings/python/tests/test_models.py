"""Models are opened from paths, bytes, files and the caller's own functions."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy
import pytest
from conftest import TETRA, TETRA_FACES, bumps

import outcrop


@pytest.fixture
def path(context: outcrop.Context, tmp_path: Path) -> Path:
    context.build(tmp_path / "a.oc", outcrop.Mesh(TETRA, TETRA_FACES, name="tetra", id=7))
    return tmp_path / "a.oc"


class Slow:
    """A reader that counts its calls and fails on request."""

    def __init__(self, content: bytes, error: Exception | None = None) -> None:
        self.content, self.size, self.error, self.calls = content, len(content), error, 0

    def read_at(self, offset: int, buffer: memoryview) -> None:
        self.calls += 1
        if self.error is not None:
            raise self.error
        buffer[:] = self.content[offset:offset + len(buffer)]


def test_sources(context: outcrop.Context, path: Path) -> None:
    content = path.read_bytes()
    reader = Slow(content)
    with path.open("rb") as file:
        sources: list[Any] = [path, str(path), content, bytearray(content), memoryview(content), io.BytesIO(content),
                              file, reader]
        for source in sources:
            with context.open(source) as model:
                assert model.part(7).name == "tetra" and model.bounds == ((0, 0, 0), (1, 1, 1))
                assert repr(model) == "<Model of 4 triangles in 1 parts>"
    assert reader.calls > 0 and repr(model) == "<Model, closed>"


def test_failures(context: outcrop.Context, path: Path, tmp_path: Path) -> None:
    with pytest.raises(outcrop.MachineError, match="missing.oc") as caught:
        context.open(tmp_path / "missing.oc")
    assert caught.value.status == outcrop.Status.IO
    with pytest.raises(outcrop.InputError):
        context.open(path.read_bytes()[:-100])
    with pytest.raises(outcrop.Error) as failed:
        context.open(Slow(path.read_bytes(), ZeroDivisionError("the network is down")))
    assert isinstance(failed.value.__cause__, ZeroDivisionError)
    with pytest.raises(TypeError, match="source: expected a path"):
        context.open(3)  # type: ignore[arg-type]
    with path.open("r", encoding="latin-1") as text, pytest.raises(TypeError, match="binary mode"):
        context.open(text)  # type: ignore[arg-type]


def test_failures_after_opening(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    shown: list[Any] = []
    monkeypatch.setattr("sys.unraisablehook", shown.append)
    with outcrop.Context(threads=2, memory_budget=4 << 20, read_ahead=False) as context:
        context.build(tmp_path / "large.oc", outcrop.Mesh(*bumps(400)))
        reader = Slow((tmp_path / "large.oc").read_bytes())
        with context.open(reader) as model, context.scene(model) as scene:
            reader.error = ZeroDivisionError("the network is down")
            rays = numpy.random.default_rng(1).uniform(0, 1, (1000, 3))
            with pytest.raises(outcrop.MachineError):
                scene.closest(rays + (0, 0, 1), (0, 0, -1))
            assert shown and all(isinstance(one.exc_value, ZeroDivisionError) for one in shown)
            reader.error = None
            assert scene.any(rays + (0, 0, 1), (0, 0, -1)).all()
        shown.clear()


def test_parts_and_views(context: outcrop.Context, path: Path) -> None:
    with context.load(path) as job:
        model = job.result()
        assert job.done and job.poll().state == outcrop.State.DONE
    with model:
        assert model.info.triangles_stored == 4 and model.parts[0].parent == outcrop.NO_INDEX
        assert model.view(0).eye != model.view(2).eye
        with pytest.raises(outcrop.ArgumentError, match="8"):
            model.part(8)
        with pytest.raises(outcrop.ArgumentError):
            model.view(4)


def test_a_budget_that_is_too_small_says_so(path: Path) -> None:
    with outcrop.Context(memory_budget=1 << 20) as small, pytest.raises(outcrop.LimitError) as caught:
        small.open(path)
    assert caught.value.status == outcrop.Status.OVER_BUDGET and caught.value.need > 1 << 20


def test_numbers_of_other_types_are_named(path: Path) -> None:
    with outcrop.Context(threads=1) as context, context.open(path) as model:
        for call in (model.find_part, model.part, model.triangles):
            with pytest.raises(TypeError, match="part must be an integer, not '7'"):
                call("7")  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="number must be an integer"):
            model.view(1.5)  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="x must be a number, not 'a'"):
            outcrop.camera_ray(model.view(), 8, 8, "a", 0)  # type: ignore[arg-type]


def test_triangles_come_back(context: outcrop.Context, path: Path) -> None:
    with context.open(path) as model:
        triangles = model.triangles(7)
        assert triangles.dtype == outcrop.TRIANGLE and len(triangles) == 4
        assert (triangles["part"] == 7).all()
        corners = numpy.asarray(TETRA, numpy.float64)[numpy.asarray(TETRA_FACES)]
        assert (triangles["corners"][numpy.argsort(triangles["prim"])] == corners).all()
        assert numpy.allclose(numpy.linalg.norm(triangles["normals"], axis=-1), 1.0)
        assert sum(len(some) for some in model.read_part(7, chunk=3)) == 4
        # A reader that is left early gives its reference back.
        next(model.read_part(7, chunk=1))
        with pytest.raises(outcrop.ArgumentError, match="no part with id 8"):
            model.triangles(8)
        with pytest.raises(ValueError, match="chunk"):
            next(model.read_part(7, chunk=0))
        with context.scene([(1, model)]) as scene:
            center = corners.mean(axis=(0, 1))
            hits = scene.closest(numpy.full((8, 3), 9.0) + numpy.arange(8)[:, None], center - 9.0)
            hits = hits[hits["kind"] == outcrop.HitKind.EXACT]
            assert len(hits) and (scene.triangles(hits)["prim"] == hits["prim"]).all()
            with pytest.raises(outcrop.ArgumentError, match="hit 0"):
                scene.triangles(outcrop.empty_hits(1))


def test_cursors_walk_trees(context: outcrop.Context, path: Path) -> None:
    with context.open(path) as model, model.cursor() as cursor:
        root = cursor.root()
        assert root is not None
        places = cursor.places
        assert len(places) == 1 and places[0]["root"] == root and places[0]["tree"] == 0
        assert places[0]["model_from_tree"].tolist() == [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]
        found, seen, stack = [], set(), [root]
        while stack:
            node = cursor.node(stack.pop())
            children = node["children"][:node["child_count"]]
            for i, child in enumerate(map(int, children)):
                seen.add(child)
                if node["leaf_children"] >> i & 1:
                    triangles = cursor.triangles(child)
                    box = node["child_bounds"][i]
                    assert (triangles["corners"] >= box[0]).all() and (triangles["corners"] <= box[1]).all()
                    assert cursor.node(child)["triangle_count"] == len(triangles)
                    found.append(triangles)
                else:
                    stack.append(child)
            assert (node["bounds"][0] == node["child_bounds"][:len(children), 0].min(axis=0)).all()
        own = numpy.concatenate(found)
        expected = model.triangles(7)
        order = numpy.argsort(own["prim"])
        assert (own["corners"][order] == expected["corners"][numpy.argsort(expected["prim"])]).all()
        assert model.parts[int(places[0]["first_part"] + own["part"][0])].id == 7
        listed = numpy.concatenate([cursor.block_nodes(block) for block in range(model.info.blocks)])
        assert set(listed.tolist()) == seen | {root}
        with pytest.raises(outcrop.ArgumentError, match="is not the id of a node"):
            cursor.node(outcrop.NO_ID)
        with pytest.raises(outcrop.ArgumentError, match="no such leaf"):
            cursor.triangles(root)
        with pytest.raises(outcrop.ArgumentError, match="tree 1 does not exist"):
            cursor.root(1)
        with pytest.raises(outcrop.ArgumentError, match="at least"):
            model.cursor(memory=1)
        with model.cursor(now=True) as now:
            assert now.node(root) == cursor.node(root)  # a small model is in memory
