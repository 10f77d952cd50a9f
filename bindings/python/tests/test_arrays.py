"""Arrays go in and out without copies. What cannot be meant is refused with the argument, shape and dtype."""

from __future__ import annotations

from typing import Any

import numpy
import pytest
from conftest import TETRA, TETRA_FACES, bumps

import outcrop
from outcrop._arrays import faces, ids, matrix, vectors

N = 100
POINTS = numpy.zeros((N, 3))


@pytest.mark.parametrize("value, error, words", [
    (numpy.zeros((3, N)), ValueError, r"vertices: expected shape \(N, 3\).*shape \(3, 100\), dtype float64; transpose"),
    (numpy.zeros((N, 3), numpy.float16), TypeError, r"vertices: expected float32 or float64, .*dtype float16"),
    (numpy.zeros((N, 3), numpy.int32), TypeError, "dtype int32"),
    (numpy.zeros((N, 3), ">f8"), TypeError, "dtype >f8"),
    (numpy.zeros((N, 3), complex), TypeError, "dtype complex128"),
    (numpy.zeros((N, 4)), ValueError, r"shape \(100, 4\)"),
    (numpy.zeros(3 * N), ValueError, r"shape \(300,\)"),
    (numpy.zeros((3, N)).T, ValueError, "must be adjacent.*ascontiguousarray"),
    (numpy.zeros((N, 6))[:, ::2], ValueError, "must be adjacent"),
    (numpy.zeros((N, 3))[::-1], ValueError, "must not overlap"),
    (numpy.broadcast_to(numpy.zeros(3), (N, 3)), ValueError, "must not overlap"),
    (numpy.array([[0, 1, None]]), TypeError, "Python objects"),
    ([[0, 1, 2], [3, 4]], ValueError, "vertices: no array can be made"),
    (["abc"], TypeError, "vertices: expected float32"),
    (None, TypeError, "vertices: Python objects"),
])
def test_wrong_vertices_are_refused(value: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        vectors("vertices", value)


@pytest.mark.parametrize("value, error, words", [
    (numpy.zeros((3, N), int), ValueError, r"faces: expected shape \(M, 3\), integers, not .*\(3, 100\).*transpose"),
    (numpy.zeros((N, 4), int), ValueError, r"shape \(100, 4\)"),
    (numpy.zeros((N, 3)), TypeError, "faces: expected integers, not .*dtype float64"),
    (numpy.array([[0, -1, 2]]), ValueError, "faces: negative numbers, e.g. -1"),
    (numpy.array([[0, 1, 4]]), ValueError, r"faces: the index 4 in shape \(1, 3\).*there are 4 positions"),
    (numpy.array([[0, 1, 2**40]]), ValueError, "the index 1099511627776"),
    (numpy.array([[True, False, True]]), TypeError, "dtype bool"),
    (numpy.array([[0, 1, None]]), TypeError, "Python objects"),
    ([[0, 1, 2], [3]], ValueError, "faces: no array"),
    ([[0, 1, 2**64]], TypeError, "faces"),
])
def test_wrong_faces_are_refused(value: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        faces("faces", value, 4)


def test_arrays_are_not_copied_where_their_layout_allows() -> None:
    vertex = numpy.zeros(N, [("position", "f8", 3), ("normal", "f4", 3)])
    for array in [POINTS, POINTS.astype("f4"), vertex["position"], POINTS[::2]]:
        assert numpy.shares_memory(vectors("vertices", array), array)
    for kind in [numpy.uint32, numpy.int32, numpy.uint64, numpy.int64]:
        own = TETRA_FACES.astype(kind)
        assert numpy.shares_memory(faces("faces", own, 4), own)
    others: list[Any] = [TETRA_FACES.astype(numpy.uint8), numpy.asfortranarray(TETRA_FACES), TETRA_FACES.astype(">u4")]
    for other in others:
        assert numpy.array_equal(faces("faces", other, 4), TETRA_FACES)
    assert vectors("vertices", []).shape == faces("faces", [], 0).shape == (0, 3)


def test_ids_are_unsigned() -> None:
    assert ids("parts", 7).tolist() == [7] and ids("parts", []).tolist() == []
    own = numpy.array([1, 2], numpy.uint64)
    assert numpy.shares_memory(ids("parts", own), own)
    with pytest.raises(ValueError, match="parts: negative"):
        ids("parts", [-1])
    with pytest.raises(TypeError, match="parts: expected integers"):
        ids("parts", [1.5])
    with pytest.raises(ValueError, match="one dimension"):
        ids("parts", [[1, 2]])


def test_transforms_are_by_column() -> None:
    place = numpy.array([[1, 2, 3, 10], [4, 5, 6, 20], [7, 8, 9, 30], [0, 0, 0, 1]])
    wanted = [1, 4, 7, 2, 5, 8, 3, 6, 9, 10, 20, 30]
    assert list(matrix("transform", place)) == list(matrix("transform", place[:3])) == wanted
    assert list(matrix("transform", wanted)) == wanted
    assert matrix("transform", None) is None
    with pytest.raises(ValueError, match="last row"):
        matrix("transform", place.T)
    with pytest.raises(ValueError, match=r"transform: expected shape .* not shape \(3, 3\)"):
        matrix("transform", numpy.eye(3))


@pytest.mark.parametrize("origins, directions, error, words", [
    (numpy.zeros((3, N)), (0, 0, 1), ValueError, r"origins: .*shape \(3, 100\).*transpose"),
    (POINTS, numpy.zeros((N, 2)), ValueError, r"directions: expected .*shape \(100, 2\)"),
    (POINTS, numpy.zeros((7, 3)), ValueError, r"origins \(shape \(100, 3\).*directions .*\(7, 3\).*do not match"),
    (POINTS.astype("f2"), (0, 0, 1), TypeError, "origins: .*float16"),
    (POINTS, numpy.zeros((N, 3), int), TypeError, "directions: .*int64"),
    (POINTS.astype(object), (0, 0, 1), TypeError, "origins: Python objects"),
    ((0, 0), (0, 0, 1), ValueError, r"origins: expected shape"),
])
def test_wrong_rays_are_refused(origins: Any, directions: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        outcrop.rays(origins, directions)


def test_rays_are_made_from_arrays_of_any_shape() -> None:
    rays = outcrop.rays(POINTS, (0, 0, 1), t_max=5, mask=3)
    assert rays.dtype == outcrop.RAY and rays.shape == (N,)
    assert rays["direction"][9].tolist() == [0, 0, 1] and rays["t_max"][9] == 5 and rays["mask"][9] == 3
    assert outcrop.rays((0, 0, 0), numpy.ones((4, 5, 3))).shape == (4, 5)
    assert outcrop.rays(POINTS[:, ::-1], POINTS, t_min=numpy.arange(N))["t_min"][7] == 7
    assert outcrop.rays((0, 0, 0), (0, 0, 1)).shape == (1,)
    with pytest.raises(ValueError, match=r"t_max: expected a number or shape \(100,\)"):
        outcrop.rays(POINTS, (0, 0, 1), t_max=numpy.zeros(5))
    with pytest.raises(TypeError, match="mask: expected integers"):
        outcrop.rays(POINTS, (0, 0, 1), mask=1.5)


def test_rays_in_single_precision_have_the_same_hits(scene: outcrop.Scene) -> None:
    rows = numpy.zeros((600, 8), numpy.float32)
    rows[:, :2] = numpy.random.default_rng(5).random((600, 2)) * 1.2 - 0.1
    rows[:, 2], rows[:, 6] = -1, 1
    hits = scene.closest(outcrop.rays(rows[:, :3], rows[:, 4:7]))
    for coherent in (False, True):
        narrow = scene.closest_f32(rows, coherent=coherent)
        assert narrow.dtype == outcrop.HIT_F32 and narrow.shape == (600,)
        assert (narrow["kind"] == hits["kind"]).all() and (hits["kind"] != 0).sum() > 50
        met = hits["kind"] != 0
        assert numpy.allclose(narrow["t"][met], hits["t"][met], rtol=1e-6)
        assert (narrow["prim"][met] == hits["prim"][met]).all() and (narrow["prim"][~met] == 0xFFFFFFFF).all()
        assert (narrow["normal"] == hits["normal"]).all()
        assert (scene.any_f32(rows, coherent=coherent) == met).all()
    out = numpy.zeros((20, 30), outcrop.HIT_F32)
    assert scene.closest_f32(rows.reshape(20, 30, 8), out=out) is out and (out["kind"].ravel() == hits["kind"]).all()
    assert scene.closest_f32(rows[:0]).shape == (0,)
    with pytest.raises(ValueError, match=r"rays: expected shape \(..., 8\)"):
        scene.closest_f32(rows[:, :7])
    with pytest.raises(TypeError, match="out: expected an array of dtype"):
        scene.closest_f32(rows, out=numpy.zeros(600))
    with pytest.raises(ValueError, match=r"out: expected writeable memory without gaps of shape \(600,\)"):
        scene.closest_f32(rows, out=out)
    with pytest.raises(outcrop.Error, match="oc_query_f32.want"):
        scene.closest_f32(rows, want=outcrop.Want.POSITION)


def test_wrong_arrays_of_rays_and_hits_are_refused(scene: outcrop.Scene) -> None:
    rays = outcrop.rays(numpy.zeros((8, 3)), (0, 0, 1))
    with pytest.raises(TypeError, match=r"rays: expected an array of dtype outcrop.RAY, not shape \(8, 3\)"):
        scene.closest(POINTS[:8])
    with pytest.raises(TypeError, match="t_max: members of the ray array"):
        scene.closest(rays, t_max=3)
    with pytest.raises(TypeError, match="out: expected an array of dtype outcrop.HIT"):
        scene.closest(rays, out=numpy.zeros(8))
    with pytest.raises(ValueError, match=r"out: expected writeable memory of shape \(8,\), not shape \(7,\)"):
        scene.closest(rays, out=outcrop.empty_hits(7))
    locked = outcrop.empty_hits(8)
    locked.flags.writeable = False
    with pytest.raises(ValueError, match="writeable"):
        scene.closest(rays, out=locked)
    with pytest.raises(ValueError, match="rays: .*strides"):
        scene.closest(rays[::-1])
    with pytest.raises(ValueError, match="rays: an array of several dimensions"):
        scene.closest(rays.reshape(2, 4)[:, ::2])
    with pytest.raises(TypeError, match="out: expected an array of bool"):
        scene.any(rays, out=numpy.zeros(8))


def test_numbers_out_of_range_are_refused(context: outcrop.Context, scene: outcrop.Scene) -> None:
    with pytest.raises(ValueError, match="id must be 0 to 18446744073709551615, not -1"):
        scene.remove(-1)
    with pytest.raises(ValueError, match="mask must be 0 to 4294967295"):
        scene.set_mask(1, 1 << 32)
    with pytest.raises(TypeError, match="id must be an integer"):
        scene.remove(1.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="Camera.eye must be 3 numbers"):
        context.render(scene, outcrop.Camera(eye=(0, 1)), 8, 8)
    with pytest.raises(ValueError, match="FrameSettings.samples must be 0 to"):
        context.render(scene, outcrop.Camera(eye=(0, 0, 1)), 8, 8, samples=-1)
    with pytest.raises(ValueError, match="width must be 0 to"):
        context.frame(-1, 8)
    with pytest.raises(TypeError, match="Camera.fov_y must be a number"):
        context.render(scene, outcrop.Camera(eye=(0, 0, 1), fov_y="wide"), 8, 8)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="zero character"):
        context.build("x.oc", outcrop.Mesh(TETRA, TETRA_FACES, name="a\0b"))


def test_vertices_with_strides_make_the_same_model(context: outcrop.Context, tmp_path: Any) -> None:
    corners, triangles = bumps(20)
    apart = numpy.zeros((len(corners), 8), numpy.float32)
    apart[:, 2:5] = corners
    colours = numpy.linspace(0, 1, 3 * len(triangles)).reshape(-1, 3)
    files: list[bytes] = []
    for vertices, own in [(corners, triangles), (apart[:, 2:5], triangles.astype(numpy.int64)),
                          (corners[triangles].reshape(-1, 3), None)]:
        path = tmp_path / f"{len(files)}.oc"
        report = context.build(path, outcrop.Mesh(vertices, own, colours=colours))
        assert report.triangles_kept == len(triangles)
        files.append(path.read_bytes())
    assert files[0] == files[1] == files[2]


def test_wrong_colours_are_refused(context: outcrop.Context) -> None:
    with context.new_build() as build:
        part = build.add_part("a")
        with pytest.raises(ValueError, match=r"colours: expected shape \(4, 3\), one for each triangle, not shape"):
            build.add_triangles(part, TETRA, TETRA_FACES, colours=numpy.zeros((3, 3)))
        for name in ["normals", "vertex_colours"]:
            few: Any = {name: numpy.zeros((3, 3))}
            turned: Any = {name: numpy.zeros((3, 4))}
            with pytest.raises(ValueError, match=rf"{name}: expected shape \(4, 3\), one for each vertex, not shape"):
                build.add_triangles(part, TETRA, TETRA_FACES, **few)
            with pytest.raises(ValueError, match=rf"{name}: expected shape \(N, 3\).*transpose"):
                build.add_triangles(part, TETRA, TETRA_FACES, **turned)
        with pytest.raises(ValueError, match="vertices: without faces, each three are a triangle, but there are 4"):
            build.add_triangles(part, TETRA)
