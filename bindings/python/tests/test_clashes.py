"""Clashes of parts, against the known overlaps of boxes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy
import pytest

import outcrop
from outcrop import ClashKind, ClashSkipFlags

FACES = numpy.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3),
                     (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)], numpy.uint32)
LOW = numpy.random.default_rng(5).integers(0, 60, (24, 3)) / 8.0
"""Least corners of boxes with sides of 1."""


def box(low: numpy.typing.ArrayLike, size: float = 1.0) -> numpy.typing.NDArray[numpy.float32]:
    """Returns the corners of a box."""
    units = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    return (numpy.asarray(low) + size * numpy.array(units)).astype(numpy.float32)


@pytest.fixture
def boxes(context: outcrop.Context, tmp_path: Path) -> Iterator[outcrop.Scene]:
    """A scene of boxes, parts 1 to 24."""
    meshes = [outcrop.Mesh(box(low), FACES, name=f"box {i}", id=i + 1) for i, low in enumerate(LOW)]
    context.build(tmp_path / "boxes.oc", meshes)
    with context.open(tmp_path / "boxes.oc") as model, context.scene(model) as scene:
        yield scene


def gaps() -> dict[tuple[int, int], float]:
    """Returns the distance of each pair of boxes; 0 if they meet."""
    found = {}
    for a, b in itertools.combinations(range(len(LOW)), 2):
        apart = numpy.maximum(abs(LOW[a] - LOW[b]) - 1.0, 0)
        found[a + 1, b + 1] = float(numpy.linalg.norm(apart))
    return found


def test_boxes_meet_and_are_near(boxes: outcrop.Scene) -> None:
    for clearance in (0.0, 0.3):
        found = boxes.clash(clearance=clearance)
        expected = {pair: gap for pair, gap in gaps().items() if gap <= clearance}
        assert len(expected) > 5
        assert {tuple(one["part"].tolist()): None for one in found}.keys() == expected.keys()
        for one in found:
            gap = expected[tuple(one["part"].tolist())]
            assert abs(one["distance"] - gap) <= one["error"] + 1e-12
            assert (one["kind"] == ClashKind.CLEARANCE) == (gap > 0) and one["open"] == 0
            assert set(one["prim"].tolist()) == {outcrop.NO_ID} and (one["low"] <= one["high"]).all()
    assert len(set(boxes.clash()["id"].tolist())) == len(boxes.clash())


def test_sets_rules_and_jobs(boxes: outcrop.Scene) -> None:
    pairs = [pair for pair, gap in gaps().items() if gap == 0]
    part = pairs[0][0]
    with outcrop.PartSet() as one, outcrop.PartSet() as everything:
        one.add_part(part)
        everything.add_instance()
        found = boxes.clash(one, everything)
        assert found["part"][:, 0].tolist() == [part] * len(found)
        assert sorted(found["part"][:, 1].tolist()) == sorted(sum(pair) - part for pair in pairs if part in pair)
        assert len(boxes.clash(one)) == 0
    assert len(boxes.clash(skip=ClashSkipFlags.SAME_INSTANCE)) == 0
    assert len(boxes.clash(skip_pairs=pairs[1:])) == 1
    with boxes.clash_start(triangles=True, limit=7) as job:
        job.wait()
        first = job.take(3)
        rest = job.result()
        summary = job.summary()
    assert summary.is_cut and summary.clashes == len(first) + len(rest) and len(first) == 3
    assert (numpy.concatenate([first, rest])["prim"][:, 0] != outcrop.NO_ID).sum() == 7
    with pytest.raises(outcrop.ArgumentError, match="clearance"):
        boxes.clash(clearance=-1)
    with pytest.raises(outcrop.ArgumentError, match="a part 99"), outcrop.PartSet() as foreign:
        boxes.clash(foreign.add_part(99))
    for wrong in ([(1, 2, 3)], [(1, 2, 3), (4,)]):
        with pytest.raises(ValueError, match="pairs"):
            boxes.clash(skip_pairs=wrong)  # type: ignore[arg-type]


CUBES = [((0, 0, 0), 4.0), ((0.5, 0, 0), 1.0), ((4, 0, 0), 3.0), ((5.75, 0.25, 0), 2.0), ((8, 0, 0), 1.0),
         ((9.25, 0.25, 0), 1.5), ((11, 2, 0), 2.0), ((12.5, 3.5, 1.5), 1.0), ((20, 0, 0), 2.0)]
"""Centres and sizes of cubes, in eighths, so that contacts are exact. Contacts are of an edge, a corner and a face."""


def relation(a: int, b: int) -> tuple[ClashKind, float]:
    """Returns the kind of clash of two of the cubes by the gap along each axis, and their distance."""
    (near, small), (far, large) = sorted([CUBES[a], CUBES[b]], key=lambda cube: cube[1])
    between = abs(numpy.subtract(near, far))
    gaps = between - (small + large) / 2
    if gaps.max() > 0:
        return ClashKind.CLEARANCE, float(numpy.linalg.norm(numpy.maximum(gaps, 0)))
    if gaps.max() == 0:  # an edge or a corner, or a face
        return (ClashKind.TOUCHING if (gaps == 0).sum() >= 2 else ClashKind.COPLANAR), 0.0
    return (ClashKind.CONTAINED if (between + small / 2 < large / 2).all() else ClashKind.CROSSING), 0.0


def test_kinds_are_those_of_cubes(context: outcrop.Context, tmp_path: Path) -> None:
    meshes = [outcrop.Mesh(box(numpy.subtract(at, size / 2), size), FACES, name=f"cube {i}", id=i)
              for i, (at, size) in enumerate(CUBES)]
    context.build(tmp_path / "cubes.oc", meshes)
    clearance = 0.8
    known = {pair: relation(*pair) for pair in itertools.combinations(range(len(CUBES)), 2)}
    expected = {pair: kind for pair, (kind, gap) in known.items() if gap <= clearance}
    assert set(expected.values()) == {ClashKind.CROSSING, ClashKind.COPLANAR, ClashKind.TOUCHING, ClashKind.CLEARANCE,
                                      ClashKind.CONTAINED}
    deep = {ClashKind.CROSSING: ClashKind.HARD, ClashKind.COPLANAR: ClashKind.TOUCHING}
    with context.open(tmp_path / "cubes.oc") as model, context.scene(model) as scene:
        found = scene.clash(clearance=clearance)
        assert {tuple(one["part"].tolist()): ClashKind(one["kind"]) for one in found} == expected
        for one in found:
            assert abs(one["distance"] - known[tuple(one["part"].tolist())][1]) <= one["error"] + 1e-12
        for one in scene.clash(clearance=clearance, tolerance=1e-3):
            kind = expected[tuple(one["part"].tolist())]
            assert ClashKind(one["kind"]) == deep.get(kind, kind)
            assert (one["depth"] > 0.1) == (kind in (ClashKind.CROSSING, ClashKind.CONTAINED))
            far = one["depth"] + one["distance"]
            points = numpy.linalg.norm(one["first_point"] - one["second_point"])
            assert (far == 0 or abs(far - points) < 1e-9) and one["error"] <= 1e-3
        # The sets exchanged: the parts of each clash too, but not its id.
        with outcrop.PartSet() as some, outcrop.PartSet() as others:
            for part in range(len(CUBES)):
                (some if part % 2 else others).add_part(part)
            one_way = scene.clash(some, others, clearance=clearance)
            other_way = scene.clash(others, some, clearance=clearance)
        assert len(one_way) > 3 and one_way["id"].tolist() == other_way["id"].tolist()
        assert (one_way["part"] == other_way["part"][:, ::-1]).all()
