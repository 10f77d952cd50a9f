"""Nearest points and distances, against those of boxes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy
import pytest

import outcrop
from outcrop import HitKind, Holds

FACES = numpy.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3),
                     (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)], numpy.uint32)
LOW = numpy.random.default_rng(7).integers(0, 80, (24, 3)) / 8.0
"""Least corners of boxes with sides of 1."""
POINTS = numpy.random.default_rng(8).uniform(-3, 13, (500, 3))


@pytest.fixture
def boxes(context: outcrop.Context, tmp_path: Path) -> Iterator[outcrop.Scene]:
    """A scene of boxes, parts 1 to 24."""
    units = numpy.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    meshes = [outcrop.Mesh((low + units).astype(numpy.float32), FACES, id=i + 1) for i, low in enumerate(LOW)]
    context.build(tmp_path / "boxes.oc", meshes)
    with context.open(tmp_path / "boxes.oc") as model, context.scene(model) as scene:
        yield scene


def to_box(low: numpy.typing.NDArray[numpy.float64]) -> numpy.typing.NDArray[numpy.float64]:
    """Returns the distance of each point from the surface of a box."""
    beyond = numpy.maximum(low - POINTS, POINTS - low - 1)
    outside = numpy.linalg.norm(numpy.maximum(beyond, 0), axis=1)
    result: numpy.typing.NDArray[numpy.float64] = numpy.where(outside > 0, outside, -beyond.max(axis=1))
    return result


def test_nearest_points_are_those_of_boxes(boxes: outcrop.Scene) -> None:
    all_boxes = numpy.array([to_box(low) for low in LOW])
    found = boxes.nearest(POINTS, inside=True)
    assert (found["kind"] == HitKind.EXACT).all() and (found["error"] < 1e-10).all()
    assert (abs(found["distance"] - all_boxes.min(axis=0)) <= found["error"]).all()
    assert (all_boxes[found["part"].astype(int) - 1, range(len(POINTS))] <= found["distance"] + found["error"]).all()
    assert numpy.allclose(numpy.linalg.norm(found["position"] - POINTS, axis=1), found["distance"], atol=1e-9)
    inside = ((POINTS > LOW[:, None]) & (POINTS < LOW[:, None] + 1)).all(axis=2).any(axis=0)
    assert ((found["holds"] == Holds.INSIDE) == inside).all() and inside.any()
    few = outcrop.PartSet().add_part(3).add_part(9)
    of_few = numpy.minimum(all_boxes[2], all_boxes[8])
    found = boxes.nearest(POINTS, parts=few, max_distance=4.0)
    is_near = of_few <= 4
    assert ((found["kind"] == HitKind.EXACT) == is_near).all() and is_near.any() and not is_near.all()
    assert (abs(found["distance"] - of_few)[is_near] <= found["error"][is_near]).all()
    assert numpy.isinf(found["distance"][~is_near]).all()
    early = boxes.nearest(POINTS, now=True)
    assert (abs(early["distance"] - all_boxes.min(axis=0)) <= early["error"]).all()
    assert len(boxes.nearest(numpy.empty((0, 3)))) == 0


def test_distances_are_those_of_boxes(boxes: outcrop.Scene) -> None:
    def gap(a: int, b: int) -> float:
        return float(numpy.linalg.norm(numpy.maximum(abs(LOW[a - 1] - LOW[b - 1]) - 1, 0)))

    for a, b in [(1, 2), (3, 17), (24, 5), (8, 13)]:
        found = boxes.distance(outcrop.PartSet().add_part(a), outcrop.PartSet().add_part(b))
        assert found is not None and tuple(found.part) == (a, b)
        assert abs(found.distance - gap(a, b)) <= found.error + 1e-15
        ends = numpy.array(found.first_point) - numpy.array(found.second_point)
        assert abs(float(numpy.linalg.norm(ends)) - found.distance) < 1e-12
        if found.distance > 0:
            within = found.distance * 0.99
            assert boxes.distance(outcrop.PartSet().add_part(a), outcrop.PartSet().add_part(b),
                                  max_distance=within) is None
    least = min(gap(a, b) for a in range(1, 25) for b in range(a + 1, 25))
    nearest = boxes.distance()
    assert nearest is not None and abs(nearest.distance - least) <= nearest.error + 1e-15


def test_bad_questions_are_refused(boxes: outcrop.Scene) -> None:
    with pytest.raises(outcrop.ArgumentError, match="point 1 is not finite"):
        boxes.nearest([(0, 0, 0), (numpy.nan, 0, 0)])
    with pytest.raises(outcrop.ArgumentError, match="greatest distance"):
        boxes.nearest(POINTS, max_distance=-1)
    with pytest.raises(outcrop.ArgumentError, match="part 99"):
        boxes.nearest(POINTS, parts=outcrop.PartSet().add_part(99))
    with pytest.raises(outcrop.ArgumentError, match="without reading"):
        boxes.nearest(POINTS, inside=True, now=True)
    with pytest.raises(ValueError, match="points"):
        boxes.nearest([1.0, 2.0])
    with pytest.raises(outcrop.ArgumentError, match="empty"):
        boxes.distance(outcrop.PartSet(), None)
    with pytest.raises(outcrop.ArgumentError, match="greatest distance"):
        boxes.distance(max_distance=float("nan"))
