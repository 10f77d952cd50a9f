"""Smooth surfaces from arrays and files."""

from __future__ import annotations

from pathlib import Path

import numpy
import pytest

import outcrop

CUBE = numpy.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
FACES = numpy.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])


def directions(count: int) -> numpy.ndarray:
    """Unit vectors in all directions."""
    z = 1 - (2 * numpy.arange(count) + 1) / count
    turn, r = numpy.arange(count) * 2.399963229728653, numpy.sqrt(1 - z * z)
    return numpy.stack([r * numpy.cos(turn), r * numpy.sin(turn), z], 1).astype(numpy.float32)


def distances(context: outcrop.Context, path: Path) -> numpy.ndarray:
    """Distances from the origin in all directions; infinite where a ray leaves the model."""
    with context.open(path) as model, context.scene(model) as scene:
        return scene.closest(numpy.zeros(3), directions(5000))["t"]


def test_cages_are_smooth_and_closed(context: outcrop.Context, tmp_path: Path) -> None:
    options = outcrop.BuildOptions(surface_level=4)
    with context.new_build(options) as build:
        parts = [build.add_part(None, id=10 + face) for face in range(6)]
        build.add_cage(parts, CUBE, FACES)
        with build.start(tmp_path / "cube.oc") as job:
            assert job.result().triangles_in == 6 * 2 * 4**4
    smooth = distances(context, tmp_path / "cube.oc")
    assert numpy.isfinite(smooth).all() and smooth.max() < 1
    # The middle of a face, by the mask of the limit after one step: a point, its four edges and its four corners.
    assert abs(smooth.min() - (16 + 4 * 4 * 0.75 + 4 * 5 / 9) / 36) < 0.003
    with context.open(tmp_path / "cube.oc") as model, context.scene(model) as scene:
        assert scene.closest([(5, 0.01, 0.02)], (-1, 0, 0))["part"][0] == 15

    with context.new_build(options) as build:
        edges = {tuple(sorted((a, b))) for face in FACES for a, b in zip(face, numpy.roll(face, 1))}
        part = build.add_part("sharp")
        build.add_cage(part, CUBE.astype(numpy.float32), FACES.ravel(), [4] * 6, creases=sorted(edges),
                       crease_sharpness=numpy.full(12, 10.0), corners=numpy.arange(8))
        with build.start(tmp_path / "sharp.oc") as job:
            job.result()
    # All edges sharp: the cube itself.
    sharp = distances(context, tmp_path / "sharp.oc") * numpy.abs(directions(5000)).max(1)
    assert numpy.allclose(sharp, 1, atol=1e-6)


def test_surfaces_under_patch_are_hit_where_their_triangles_are(context: outcrop.Context, tmp_path: Path) -> None:
    hits, sizes = [], []
    for structure in outcrop.Structure.BVH, outcrop.Structure.PATCH:
        path = tmp_path / f"{structure.name}.oc"
        with context.new_build(outcrop.BuildOptions(structure=structure, surface_level=5)) as build:
            # A second cage beside the first: its faces have the next numbers.
            for first, x in (10, 0), (20, 4):
                parts = [build.add_part(None, id=first + face) for face in range(6)]
                build.add_cage(parts, CUBE + (x, 0, 0), FACES)
            with build.start(path) as job:
                assert job.result().triangles_kept == 2 * 6 * 2 * 4**5
        with context.open(path) as model, context.scene(model) as scene:
            hits.append([scene.closest((x, 0, 0), directions(3000)) for x in (0, 4)])
            sizes.append(model.info.geometry_bytes / model.info.triangles_stored)
            # All triangles of a face are read back, though they have one id.
            read = model.triangles(23)
            assert len(read) == 2 * 4**5
        assert len(numpy.unique(read["prim"])) == (1 if structure == outcrop.Structure.PATCH else 2 * 4**5)
    for number, (flat, patch) in enumerate(zip(*hits)):
        assert (patch["kind"] == outcrop.HitKind.EXACT).all()
        assert numpy.abs(flat["t"] - patch["t"]).max() < 1e-6
        # Rays along edges of triangles may meet either neighbour.
        same = flat["part"] == patch["part"]
        assert same.mean() > 0.999
        assert (patch["prim"] == patch["part"] - 10 * (number + 1) + 6 * number).all()
        assert (flat["prim"] // (2 * 4**5) == patch["prim"])[same].all()
    assert sizes[1] < 15 < 25 < sizes[0]


def test_wrong_cages_are_refused(context: outcrop.Context) -> None:
    with context.new_build() as build:
        part = build.add_part("cube")
        with pytest.raises(ValueError, match="faces"):
            build.add_cage(part, CUBE, FACES.ravel())
        with pytest.raises(ValueError, match="creases"):
            build.add_cage(part, CUBE, FACES, creases=[(0, 1, 2)])
        with pytest.raises(ValueError, match="crease_sharpness"):
            build.add_cage(part, CUBE, FACES, creases=[(0, 1)], crease_sharpness=[1, 2])
        with pytest.raises(outcrop.Error, match="crease 0 to 7"):
            build.add_cage(part, CUBE, FACES, creases=[(0, 7)])
        with pytest.raises(outcrop.Error, match="hole 6"):
            build.add_cage(part, CUBE, FACES, holes=[6])
        with pytest.raises(ValueError, match="part"):
            build.add_cage([part, part], CUBE, FACES)


def test_spheres_of_nurbs(context: outcrop.Context, tmp_path: Path) -> None:
    half = numpy.sqrt(0.5)
    ring = numpy.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)], float)
    profile = numpy.array([(0, -1), (1, -1), (1, 0), (1, 1), (0, 1)], float)
    points = numpy.zeros((9, 5, 3))
    points[..., :2], points[..., 2] = ring[:, None] * profile[None, :, :1], profile[:, 1]
    weights = numpy.outer(numpy.where(numpy.arange(9) % 2, half, 1), numpy.where(numpy.arange(5) % 2, half, 1))
    knots_u, knots_v = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], [0, 0, 0, 1, 1, 2, 2, 2]
    with context.new_build(outcrop.BuildOptions(surface_tolerance=1e-4)) as build:
        part = build.add_part("sphere")
        build.add_nurbs(part, points, knots_u, knots_v, weights=weights)
        with build.start(tmp_path / "sphere.oc") as job:
            job.result()
    away = distances(context, tmp_path / "sphere.oc")
    assert numpy.abs(away - 1).max() <= 1e-4
    with context.new_build() as build:
        part = build.add_part("wrong")
        with pytest.raises(ValueError, match="points"):
            build.add_nurbs(part, points[0], knots_u, knots_v)
        with pytest.raises(ValueError, match="knots_v"):
            build.add_nurbs(part, points, knots_u, knots_v[:5])
        with pytest.raises(ValueError, match="weights"):
            build.add_nurbs(part, points, knots_u, knots_v, weights=weights.T)
        with pytest.raises(outcrop.Error, match="weight"):
            build.add_nurbs(part, points, knots_u, knots_v, weights=-weights)


def test_files_of_cages(context: outcrop.Context, tmp_path: Path) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE] + ["f " + " ".join(str(v + 1) for v in face) for face in FACES]
    (tmp_path / "cube.obj").write_text("\n".join(lines + ["t crease 2/1/0 0 1 2"]))
    options = outcrop.BuildOptions(surface_level=2, subdivide=1)
    report = context.build(tmp_path / "cube.oc", tmp_path / "cube.obj", options=options)
    assert report.triangles_in == 6 * 2 * 4**2 and not report.texts


def test_spheres_are_evaluated(context: outcrop.Context, tmp_path: Path) -> None:
    """A scaled sphere of triangles: points, derivatives and curvatures of an ellipsoid at its ends."""
    side = 48
    down, turn = numpy.linspace(0, numpy.pi, side)[:, None], numpy.linspace(0, 2 * numpy.pi, 2 * side)
    ring = numpy.sin(down)
    ball = ring * numpy.cos(turn), ring * numpy.sin(turn), numpy.cos(down) + 0 * turn
    points = numpy.stack(ball, 2).reshape(-1, 3)
    at = numpy.arange(points.shape[0]).reshape(side, 2 * side)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = numpy.concatenate([numpy.stack(one, 2).reshape(-1, 3) for one in ((a, b, c), (a, c, d))])
    context.build(tmp_path / "ball.oc", outcrop.Mesh(points, faces, normals=points, name="ball", id=1))
    with context.open(tmp_path / "ball.oc") as model, context.scene() as scene:
        scene.add(7, model, numpy.diag([2.0, 1.0, 3.0, 1.0]))
        scene.commit()
        eyes = numpy.array([(9, 0.01, 0.02), (0.02, 9, 0.01), (99, 99, 99)])
        hits = scene.closest(eyes, numpy.array([(-1, 0, 0), (0, -1, 0), (1, 0, 0)], float))
        found = scene.evaluate(hits)
        assert found.dtype == outcrop.SURFACE_POINT and found.shape == (3,)
        kinds = outcrop.Evaluated.TRIANGLE, outcrop.Evaluated.TRIANGLE, outcrop.Evaluated.NOTHING
        assert found["kind"].tolist() == list(kinds)
        assert numpy.allclose(found["position"][:2], hits["position"][:2], atol=1e-5)
        # At the end of the axis a: a / b^2 and a / c^2.
        assert numpy.allclose(found["curvatures"][0], (-2 / 9, -2), rtol=0.15)
        assert numpy.allclose(found["curvatures"][1], (-1 / 9, -1 / 4), rtol=0.15)
        assert numpy.allclose(found["normal"][0], (1, 0, 0), atol=0.05)
        corners = scene.triangles(hits[:2])["corners"]
        assert numpy.allclose(found["du"][:2], corners[:, 1] - corners[:, 0], atol=1e-6)
        assert numpy.allclose(found["dv"][:2], corners[:, 2] - corners[:, 0], atol=1e-6)
        one = scene.evaluate(scene.closest_one(eyes[0], (-1, 0, 0)))
        assert one.shape == (1,) and numpy.allclose(one["du"], found["du"][:1])
        assert scene.evaluate(hits, now=True)["kind"][2] == outcrop.Evaluated.NOTHING
        wrong = hits.copy()
        wrong["prim"][1] = 10**6
        with pytest.raises(outcrop.ArgumentError, match="hit 1"):
            scene.evaluate(wrong)
        # Parameters of pixels are those of the triangle under them.
        camera = outcrop.Camera(eye=(9, 0.01, 0.02), at=(0, 0.01, 0.02), up=(0, 0, 1), fov_y=10)
        with context.frame(9, 9, buffers=[outcrop.Buffer.UV, outcrop.Buffer.PRIM]) as frame:
            frame.request(scene, camera)
            frame.wait()
            uv, prim = frame.map(outcrop.Buffer.UV), frame.map(outcrop.Buffer.PRIM)
            assert uv.shape == (9, 9, 2) and uv.dtype == numpy.float32
            assert prim[4, 4] == hits["prim"][0] and numpy.allclose(uv[4, 4], hits["uv"][0], atol=1e-3)
