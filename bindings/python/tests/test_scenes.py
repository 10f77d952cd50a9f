"""Scenes: edits, looks, and queries."""

from __future__ import annotations

from pathlib import Path

import numpy
import pytest
from conftest import TETRA, TETRA_FACES

import outcrop

DOWN = (0, 0, -1)
OVER = [(2.1, 0.1, 9), (4.1, 0.1, 9), (6.1, 0.1, 9)]


def seen(scene: outcrop.Scene) -> list[int]:
    """The parts below the three points above the tetrahedra."""
    hits = scene.closest(OVER, DOWN)
    return [int(hit["part"]) if hit["kind"] else 0 for hit in hits]


def test_looks_of_parts(three: outcrop.Scene) -> None:
    assert seen(three) == [1, 2, 3]
    with three.edit():
        three.set_part_look(2, hidden=True)
    assert seen(three) == [1, 0, 3]
    with three.edit():
        three.set_parts_look([1], hidden=True, below=True)
        three.set_parts_look(numpy.array([3], numpy.int32), colour=(1, 0, 0), selected=True)
    assert seen(three) == [0, 0, 3]
    with three.edit():
        three.isolate([1], below=True)
    assert seen(three) == [1, 2, 0]
    with three.edit():
        three.isolate([])
    assert seen(three) == [0, 0, 0]
    with three.edit():
        three.clear_part_looks()
    assert seen(three) == [1, 2, 3]
    with pytest.raises(outcrop.ArgumentError, match="no part 8"):
        three.set_parts_look([1, 8], hidden=True)
    with pytest.raises(ValueError, match="colour must be 4 numbers"):
        three.set_parts_look([1], colour=(1, 0))
    with pytest.raises(ZeroDivisionError), three.edit():
        three.set_part_look(1, hidden=True)
        raise ZeroDivisionError
    assert seen(three) == [1, 2, 3]


def test_arrays_of_instances(context: outcrop.Context, tetra: outcrop.Model) -> None:
    count = 50
    over = numpy.array([(3 * i + 0.1, 0.1, 9) for i in range(count)])
    places = numpy.zeros(count, outcrop.PLACE)
    places["position"][:, 0] = 3 * numpy.arange(count)
    places["rotation"][:, 3] = places["scale"] = 1
    affine = numpy.tile(numpy.eye(3).ravel().tolist() + [0, 0, 0], (count, 1))
    affine[:, 9] = 3 * numpy.arange(count)
    for transforms in (places, affine, affine.astype(numpy.float32), affine.reshape(count, 4, 3)):
        with context.scene([]) as scene:
            with scene.edit():
                scene.add_instances(tetra, transforms, first_id=100)
            assert scene.closest(over, DOWN)["instance"].tolist() == list(range(100, 100 + count))
            with scene.edit():
                scene.set_look(103, hidden=True)
                scene.set_mask(104, 2)
            hits = scene.closest(over, DOWN)
            assert [i for i in range(count) if hits[i]["kind"] == 0] == [3]
            with scene.edit():
                scene.set_transforms(110, transforms[20:30])
            assert scene.closest(over, DOWN)["instance"].tolist()[20:22] in ([110, 111], [120, 121])
            assert not scene.closest(over[10:20], DOWN)["kind"].any()
            with pytest.raises(outcrop.ArgumentError, match="50 transforms, but 40 instances from 110 on"):
                scene.set_transforms(110, transforms)
            with scene.edit():
                scene.add_instances([tetra, tetra], transforms, model_of=numpy.arange(count) % 2, first_id=1000)
                scene.remove_instances(100)
            assert scene.closest(over, DOWN)["instance"].tolist() == list(range(1000, 1000 + count))
            with pytest.raises(outcrop.ArgumentError, match="no array of instances begins with 100"):
                scene.remove_instances(100)
            with pytest.raises(outcrop.ArgumentError, match="instance 1010 already exists"):
                scene.add_instances(tetra, transforms, first_id=1010)
            with pytest.raises(ValueError, match="model_of"):
                scene.add_instances(tetra, transforms, model_of=[0], first_id=1)
    masks = numpy.where(numpy.arange(count) % 2, 6, 3)
    tints = numpy.tile([[255, 0, 0], [0, 51, 255]], (count // 2, 1))
    with context.scene([]) as scene:
        with scene.edit():
            scene.add_instances(tetra, places, first_id=100, mask=7, masks=masks, tints=tints)
        seen_by = {mask: scene.closest(over, DOWN, mask=mask)["kind"].astype(bool) for mask in (1, 2, 4, 8)}
        assert [seen.tolist() for seen in seen_by.values()] == [
            (masks & mask & 7 != 0).tolist() for mask in (1, 2, 4, 8)]
        with scene.edit():
            scene.set_masks(110, [4, 4])
            scene.set_tints(110, [[1, 2, 3, 4], [5, 6, 7, 255]])
        assert scene.closest(over, DOWN, mask=4)["kind"].astype(bool)[9:13].tolist() == [True, True, True, False]
        for wrong in ([1, 2], numpy.full(count, -1), numpy.full(count, 1 << 32), numpy.ones((count, 1))):
            with pytest.raises(ValueError, match="masks"):
                scene.add_instances(tetra, places, first_id=1000, masks=wrong)
        for wrong in (tints[:5], tints * 2, -tints, numpy.ones((count, 5))):
            with pytest.raises(ValueError, match="tints"):
                scene.add_instances(tetra, places, first_id=1000, tints=wrong)
        with pytest.raises(outcrop.ArgumentError, match="2 masks, but 1 instances from 149 on"):
            scene.set_masks(149, [1, 2])
        with pytest.raises(outcrop.ArgumentError, match="2 tints, but 1 instances from 149 on"):
            scene.set_tints(149, tints[:2])
    with context.scene([]) as scene:
        affine[7] = 0
        with pytest.raises(outcrop.ArgumentError, match="instance 7: the transform is singular"):
            scene.add_instances(tetra, affine, first_id=1)
        with pytest.raises(TypeError, match="transforms"):
            scene.add_instances(tetra, numpy.zeros((4, 5)), first_id=1)


def test_scenes_in_scenes(context: outcrop.Context, tetra: outcrop.Model) -> None:
    at = numpy.eye(4)
    with context.scene([]) as outer, context.scene([tetra]) as inner:
        with outer.edit():
            for i in range(3):
                at[0, 3] = 3 * i
                outer.add_scene(10 + i, inner, at)
        over = [(3 * i + 0.1, 0.1, 9) for i in range(3)]
        hits = outer.closest(over, DOWN)
        assert hits["instance"].tolist() == [10, 11, 12]
        ids, place = outer.path(hits[2]["occurrence"])
        assert ids == [12, 1] and place.tolist() == at.tolist()
        high = outcrop.Camera(eye=(3.2, 0.2, 20), at=(3.2, 0.2, 0), up=(0, 1, 0))
        picture = context.render(outer, high, 160, 90, buffers=[outcrop.Buffer.OCCURRENCE, outcrop.Buffer.INSTANCE])
        shown, instances = picture[outcrop.Buffer.OCCURRENCE], picture[outcrop.Buffer.INSTANCE]
        assert shown.dtype == numpy.uint64 and shown.shape == (90, 160)
        assert numpy.array_equal(shown == outcrop.NO_ID, instances == outcrop.NO_ID) and (shown == outcrop.NO_ID).any()
        assert {int(instances[shown == met][0]) for met in hits["occurrence"]} == {10, 11, 12}
        for met in numpy.unique(shown[shown != outcrop.NO_ID]):
            assert set(instances[shown == met]) == {outer.path(met)[0][0]}
        assert picture.pick(80, 45).occurrence == shown[45, 80] != outcrop.NO_ID
        with inner.edit():
            inner.set_look(1, hidden=True)
        assert outer.closest(over, DOWN)["kind"].all()
        outer.commit()
        assert not outer.closest(over, DOWN)["kind"].any()
        with pytest.raises(outcrop.ArgumentError, match="in itself"):
            inner.add_scene(5, outer)
        with pytest.raises(outcrop.ArgumentError, match="no occurrence 7"):
            outer.path(7)


def test_arrays_of_scenes(context: outcrop.Context, tetra: outcrop.Model) -> None:
    places = numpy.zeros(4, outcrop.PLACE)
    places["position"][:, 0] = 3 * numpy.arange(4)
    places["rotation"][:, 3] = places["scale"] = 1
    over = [(3 * i + 0.1, 0.1, 9) for i in range(4)]
    with context.scene([]) as outer, context.scene([tetra]) as inner, context.scene([]) as empty:
        with outer.edit():
            outer.add_instances([inner, empty], places, model_of=[0, 1, 0, 0], first_id=20)
        hits = outer.closest(over, DOWN)
        assert hits["kind"].astype(bool).tolist() == [True, False, True, True]
        assert [outer.path(hits[i]["occurrence"])[0] for i in (0, 2, 3)] == [[20, 1], [22, 1], [23, 1]]
        with outer.edit():
            outer.set_occurrence_look(hits[2]["occurrence"], hidden=True)
        assert outer.closest(over, DOWN)["kind"].astype(bool).tolist() == [True, False, False, True]
        with outer.edit():
            outer.set_occurrence_look(hits[2]["occurrence"])
        assert outer.closest(over, DOWN)["kind"].astype(bool).tolist() == [True, False, True, True]
        with pytest.raises(TypeError, match="not both"):
            outer.add_instances([inner, tetra], places, first_id=50)  # type: ignore[arg-type]
        with pytest.raises(outcrop.ArgumentError, match="in itself"):
            inner.add_instances(outer, places, first_id=50)
        with pytest.raises(outcrop.ArgumentError, match="no occurrence 9"):
            outer.set_occurrence_look(9)


def test_instances(context: outcrop.Context, tetra: outcrop.Model, tmp_path: Path) -> None:
    place = numpy.eye(4)
    place[0, 3] = 10
    with context.scene([tetra, (5, tetra, place)]) as scene:
        hits = scene.closest([(0.1, 0.1, 9), (10.1, 0.1, 9)], DOWN)
        assert hits["instance"].tolist() == [1, 5]
        with scene.edit():
            place[0, 3] = 20
            scene.set_transform(5, place)
            scene.set_mask(1, 2)
            scene.add(9, tetra, [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 30, 0])
        points = [(0.1, 0.1, 9), (20.1, 0.1, 9), (0.1, 30.1, 9)]
        assert scene.any(points, DOWN, mask=1).tolist() == [False, True, True]
        assert scene.any(points, DOWN, mask=2).tolist() == [True, True, True]
        with scene.edit():
            scene.remove(5)
            scene.set_look(9, hidden=True)
        assert scene.any(points, DOWN).tolist() == [True, False, False]
        with pytest.raises(outcrop.ArgumentError, match="5"):
            scene.remove(5)
        with pytest.raises(TypeError, match=r"instances\[0\]: expected a Model"):
            context.scene([("a", 3)])  # type: ignore[list-item]

        context.build(tmp_path / "new.oc", outcrop.Mesh(TETRA + numpy.float32(3), TETRA_FACES, id=7))
        with context.open(tmp_path / "new.oc") as other, scene.edit():
            scene.set_model(1, other)
        assert scene.any([(3.1, 3.1, 9), (0.1, 0.1, 9)], DOWN).tolist() == [True, False]


def test_lights_and_background(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    usual = context.render(scene, camera, 64, 48).pixels
    with scene.edit():
        scene.set_background(outcrop.Background(bottom=(1, 0, 0, 1), top=(1, 0, 0, 1)))
        scene.set_lights([])
    dark = context.render(scene, camera, 64, 48, settings=outcrop.FrameSettings(ambient=-1)).pixels
    assert dark[0, 0].tolist() == [255, 0, 0, 255] and dark[24, 32, :3].max() == 0
    sun = outcrop.Light(kind=outcrop.LightKind.DIRECTIONAL, vector=(0, 0, -1), shadows=1)
    with scene.edit():
        scene.set_background(None)
        scene.set_lights([sun, outcrop.Light()])
    assert context.render(scene, camera, 64, 48).pixels[0, 0].tolist() == usual[0, 0].tolist()
    with pytest.raises(outcrop.ArgumentError):
        scene.set_lights([outcrop.Light(intensity=-1)])


def test_closest_and_any(three: outcrop.Scene) -> None:
    rays = outcrop.rays([*OVER, (0, 0, 9)], DOWN)
    hits = three.closest(rays)
    assert hits.dtype == outcrop.HIT and hits["part"].tolist() == [1, 2, 3, outcrop.NO_ID]
    assert three.any(rays).tolist() == [True, True, True, False]
    one = three.closest_one(OVER[1], DOWN)
    assert one and one.part == 2 and one.t == hits["t"][1] and one.kind == outcrop.HitKind.EXACT
    assert not three.closest_one((0, 0, 9), DOWN)
    assert three.any_one(OVER[0], DOWN) and not three.any_one(OVER[0], DOWN, t_max=3)
    grid = three.closest(rays.reshape(2, 2), want=outcrop.Want.POSITION, coherent=True)
    assert grid.shape == (2, 2) and grid["t"].ravel().tolist() == hits["t"].tolist()
    assert grid["part"][0, 0] == outcrop.NO_ID
    assert three.closest(rays[::2], now=True)["part"].tolist() == [1, 3]

    out = outcrop.empty_hits(4)
    assert three.closest(rays, out=out) is out and numpy.array_equal(out, hits)
    answers = numpy.zeros(4, numpy.uint8)
    assert three.any(rays, out=answers).tolist() == [True, True, True, False] and answers.tolist() == [1, 1, 1, 0]
    table = numpy.zeros(4, [("mine", "u4"), ("hit", outcrop.HIT)])
    three.closest(rays, out=table["hit"])
    assert table["hit"]["part"].tolist() == hits["part"].tolist() and not table["mine"].any()

    with three.closest_start(rays) as job, three.any_start(rays) as other:
        assert job.result()["part"].tolist() == hits["part"].tolist() and other.result().sum() == 3
    assert len(three.closest(numpy.empty(0, outcrop.RAY))) == 0
    misses = three.closest([(numpy.nan, 0, 0)], [(0, 0, 1)])
    assert misses["kind"].tolist() == [outcrop.HitKind.MISS]


def test_crossings_and_points_inside(three: outcrop.Scene) -> None:
    along = outcrop.rays([(-5, 0.1, 0.2), (-5, 9, 9), (2.1, 0.1, 9)], [(1, 0, 0), (1, 0, 0), (0, 0, -1)])
    found = three.crossings(along)
    assert len(found) == 3 and found.counts.tolist() == [6, 0, 2] and found.complete.all()
    assert found[0]["part"].tolist() == [1, 1, 2, 2, 3, 3] and found[0].dtype == outcrop.CROSSING
    assert found[0]["side"].tolist() == 3 * [outcrop.Side.FRONT, outcrop.Side.BACK]
    assert numpy.array_equal(found[-1], found[2]) and [len(one) for one in found] == [6, 0, 2]
    with pytest.raises(IndexError):
        found[3]
    many = three.crossings(numpy.repeat(along, 70_000))
    assert many.counts.sum() == 8 * 70_000 and numpy.array_equal(many[100]["t"], found[0]["t"])
    assert len(three.crossings(numpy.empty(0, outcrop.RAY)).elements) == 0

    held = three.parts_at([(2.1, 0.1, 0.1), (9, 9, 9), (6.1, 0.1, 0.1)])
    assert [one["part"].tolist() for one in held] == [[1], [], [3]] and held[0]["winding"].tolist() == [1]
    assert held[0]["holds"].tolist() == [outcrop.Holds.INSIDE]
    with pytest.raises(ValueError, match=r"points: expected shape \(N, 3\)"):
        three.parts_at([1.0, 2.0])

    hits = three.closest(along)
    thick = three.thickness(hits)
    assert numpy.isinf(thick[1]) and 0 < thick[0] < 1
    one = three.closest_one(along["origin"][0], along["direction"][0])
    assert three.thickness(one) == thick[:1] and three.thickness([one, one]).shape == (2,)
    assert three.triangles(one)["prim"] == hits["prim"][:1]
    with pytest.raises(TypeError, match="hits: expected an array of dtype outcrop.HIT"):
        three.thickness(thick)


def test_overlaps(three: outcrop.Scene) -> None:
    found = three.overlap_box((1.9, -1, -1), (4.5, 2, 2))
    assert found.dtype == outcrop.OVERLAP and found["part"].tolist() == [1, 2]
    assert found["kind"].tolist() == [outcrop.OverlapKind.INSIDE, outcrop.OverlapKind.INTERSECTS]
    assert len(three.overlap_box((50, 0, 0), (60, 1, 1))) == 0
    assert three.overlap_frustum([(1, 0, 0, -3.5), (-1, 0, 0, 5.5)])["part"].tolist() == [2]
    planes = numpy.zeros(1, outcrop.PLANE)
    planes["normal"], planes["d"] = (1, 0, 0), -5.5
    assert three.overlap_frustum(planes)["part"].tolist() == [3]
    with pytest.raises(ValueError, match=r"planes: expected shape \(N, 4\)"):
        three.overlap_frustum([(1, 0, 0)])
    with pytest.raises(outcrop.ArgumentError):
        three.overlap_box((numpy.nan, 0, 0), (1, 1, 1))


def test_prefetch(three: outcrop.Scene, camera: outcrop.Camera) -> None:
    for job in [three.prefetch_box((0, 0, 0), (9, 9, 9)), three.prefetch_camera(camera, 640, 480, 1.0)]:
        with job:
            assert job.result().state == outcrop.State.DONE


def test_many_looks_from_an_array(context: outcrop.Context, tmp_path: Path) -> None:
    with context.new_build() as build:
        for part in range(2000):
            build.add_part(None, id=part)
            build.add_triangles(part, TETRA + numpy.array((2 * part, 0, 0), numpy.float32), TETRA_FACES)
        with build.start(tmp_path / "many.oc") as job:
            job.result()
    with context.open(tmp_path / "many.oc") as model, context.scene(model) as scene:
        with scene.edit():
            scene.set_parts_look(numpy.arange(0, 2000, 2), hidden=True)
        points = numpy.stack([2 * numpy.arange(2000) + 0.1, numpy.full(2000, 0.1), numpy.full(2000, 9.0)], 1)
        assert scene.any(points, DOWN).tolist() == [part % 2 == 1 for part in range(2000)]


def test_scene_files(context: outcrop.Context, tetra: outcrop.Model, tmp_path: Path) -> None:
    places = numpy.zeros(3, outcrop.PLACE)
    places["position"][:, 0] = 3 * numpy.arange(3)
    places["rotation"][:, 3] = places["scale"] = 1
    over = numpy.array([(3 * i + 0.1, 0.1, 9) for i in range(6)])
    lifted = numpy.eye(4)
    lifted[0, 3] = 9
    with context.scene([]) as inner, context.scene([]) as outer:
        with inner.edit():
            inner.add_instances(tetra, places, first_id=100)
        with outer.edit():
            outer.add_scene(1, inner)
            outer.add_scene(2, inner, lifted)
            outer.set_look(2, hidden=True)
        outer.save(tmp_path / "scene.oc")
        with context.open_scene(tmp_path / "scene.oc") as opened:
            hits = [one.closest(over, DOWN) for one in (outer, opened)]
            assert hits[0].tobytes() == hits[1].tobytes()
            assert hits[1]["kind"].tolist() == [1, 1, 1, 0, 0, 0]
            assert opened.path(hits[1][1]["occurrence"])[0] == [1, 101]
            with opened.edit():
                opened.set_look(2)
            assert opened.closest(over, DOWN)["instance"].tolist() == [1, 1, 1, 2, 2, 2]
        with inner.edit():
            inner.set_part_look(7, instance=101, hidden=True)
        with pytest.raises(outcrop.StateError, match="instance 101 has looks of parts"):
            inner.save(tmp_path / "scene.oc")
    with pytest.raises(outcrop.InputError, match="a model file, not a scene file"):
        context.open_scene(tmp_path / "tetra.oc")
