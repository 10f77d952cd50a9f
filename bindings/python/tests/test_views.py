"""Fitted cameras, rays and rectangles of pictures, placements, picks with a radius, and exposure."""

from __future__ import annotations

from pathlib import Path

import numpy
import pytest
from conftest import TETRA, TETRA_FACES

import outcrop
from outcrop import CameraKind, Fit, FrameFlags, PlacementFlags, UpAxis, View


def test_fitted_cameras_fill_the_picture(context: outcrop.Context, three: outcrop.Scene) -> None:
    for view in View:
        for kind in CameraKind:
            fit = Fit(kind=kind, width=80, height=60, view=view, direction=(0.2, 0.3, -1), margin=0.1)
            camera = three.fit(fit)
            assert camera.kind == kind
            parts = context.render(three, camera, 80, 60, buffers=[outcrop.Buffer.PART])[outcrop.Buffer.PART]
            rows, columns = numpy.nonzero(parts != outcrop.NO_ID)
            assert rows.min() >= 5 and rows.max() < 55 and columns.min() >= 7 and columns.max() < 73, view
            if view == View.FRONT:
                assert columns.min() <= 9 and columns.max() >= 70
    one = three.fit(Fit(width=80, height=60, view=View.TOP, kind=CameraKind.ORTHOGRAPHIC, margin=-1), [3])
    assert one.height == pytest.approx(1) and tuple(one.eye)[:2] == pytest.approx((6.5, 0.5))


def test_rectangles_select_parts_that_fit_again(three: outcrop.Scene) -> None:
    fit = Fit(width=80, height=60, view=View.FRONT)
    camera = three.fit(fit)
    planes = outcrop.camera_frustum(camera, 80, 60, 0, 0, 28, 60)
    chosen = three.overlap_frustum(planes)
    assert list(chosen["part"]) == [1]
    assert three.fit(fit, chosen) == three.fit(fit, [1]) != camera
    ray = outcrop.camera_ray(camera, 80, 60, 40, 30)
    assert ray.origin == tuple(camera.eye) and ray.direction == pytest.approx((0, 1, 0)) and ray.cone_b > 0
    by_numbers = three.closest(numpy.array([ray.origin]), numpy.array([ray.direction]), cone_b=ray.cone_b)
    assert numpy.array_equal(three.closest(ray), by_numbers) and three.closest([ray, ray]).shape == (2,)
    assert three.any(ray).tolist() == [by_numbers["kind"][0] != outcrop.HitKind.MISS]
    assert len(three.crossings(ray)) == 1
    with pytest.raises(outcrop.StateError):
        with three.edit():
            three.set_look(1, hidden=True)
        three.fit(fit)
    with pytest.raises(outcrop.ArgumentError, match="part 8"):
        three.fit(fit, [8])
    with pytest.raises(outcrop.ArgumentError, match="width"):
        three.fit(Fit())


def test_placements_agree(context: outcrop.Context, tetra: outcrop.Model, tmp_path: Path) -> None:
    matrix, unknown = tetra.placement(UpAxis.Y, 0.01)
    assert numpy.array_equal(matrix, numpy.eye(4))
    assert unknown == PlacementFlags.UP_UNKNOWN | PlacementFlags.UNIT_UNKNOWN
    options = outcrop.BuildOptions(up=UpAxis.Z, metres_per_unit=0.001)
    context.build(tmp_path / "up.oc", outcrop.Mesh(TETRA, TETRA_FACES), options=options)
    with context.open(tmp_path / "up.oc") as model:
        matrix, unknown = model.placement(UpAxis.Y, 1)
        assert unknown == 0 and matrix @ (0, 0, 1000, 1) == pytest.approx((0, 1, 0, 1))
        with context.scene([(1, model, matrix)]) as scene:
            assert scene.closest([(0.0001, 1, 0)], (0, -1, 0))["kind"][0] == outcrop.HitKind.EXACT
    with pytest.raises(outcrop.ArgumentError):
        tetra.placement(UpAxis.Y, -1)


def test_picks_near_a_pixel(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    picture = context.render(scene, camera, 64, 48)
    assert not picture.pick(0, 0) and not picture.pick_near(0, 0)
    assert picture.pick_near(32, 24, 0) == picture.pick(32, 24) and picture.pick_near(20, 24, 32).part == 7
    with pytest.raises(outcrop.ArgumentError, match="radius"):
        picture.pick_near(32, 24, 33)


def test_exposure_and_exact_colours(context: outcrop.Context, scene: outcrop.Scene, camera: outcrop.Camera) -> None:
    def middle(exposure: float = 0.0) -> int:
        options = outcrop.FrameSettings(flags=FrameFlags.EXACT_COLOURS, exposure=exposure)
        return int(context.render(scene, camera, 64, 48, settings=options).pixels[24, 32, 0])
    assert middle(exposure=0.25) < middle() == middle(exposure=1) <= middle(exposure=4) == 255
    assert context.render(scene, camera, 64, 48).pixels[24, 32, 0] < 255
