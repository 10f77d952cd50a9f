"""Builds from files, arrays, and objects of trimesh and pyvista."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy
import pytest
from conftest import TETRA, TETRA_FACES, bumps, need

import outcrop

OBJ = "mtllib colours.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\no plate\nf 1 2 3\n"
MTL = "newmtl red\nKd 1 0 0\n"


def names(context: outcrop.Context, path: Path) -> dict[int, str]:
    with context.open(path) as model:
        return {part.id: part.name or "" for part in model.parts}


def test_report_and_progress(context: outcrop.Context, tmp_path: Path) -> None:
    fractions: list[float] = []
    report = context.build(tmp_path / "a.oc", {"tetra": outcrop.Mesh(TETRA, TETRA_FACES)}, progress=fractions.append)
    assert (report.triangles_in, report.triangles_kept, report.parts, report.texts) == (4, 4, 1, ())
    assert fractions == sorted(fractions) and fractions[-1] == 1
    assert names(context, tmp_path / "a.oc") == {0: "tetra"}
    (tmp_path / "plate.obj").write_text(OBJ)
    context.build(tmp_path / "a.oc", [tmp_path / "plate.obj", {"tetra": outcrop.Mesh(TETRA, TETRA_FACES)}])
    assert names(context, tmp_path / "a.oc") == {0: "tetra", 1: "plate"}


def test_files_and_notes(context: outcrop.Context, tmp_path: Path) -> None:
    (tmp_path / "plate.obj").write_text(OBJ)
    report = context.build(tmp_path / "a.oc", tmp_path / "plate.obj")
    assert report.triangles_kept == 1 and report.notes == len(report.texts) > 0
    assert any("colours.mtl" in text for text in report.texts)
    with pytest.raises(outcrop.MachineError, match="no-such-file") as caught:
        context.build(tmp_path / "b.oc", "no-such-file.ply")
    assert caught.value.status == outcrop.Status.IO and not (tmp_path / "b.oc").exists()
    (tmp_path / "bad.ply").write_text("ply\nformat ascii 1.0\nelement vertex x\n")
    with pytest.raises(outcrop.InputError, match="bad.ply"):
        context.build(tmp_path / "b.oc", tmp_path / "bad.ply")


@pytest.mark.parametrize("kind", ["bytes", "path", "default", "refused", "missing"])
def test_resolver(context: outcrop.Context, tmp_path: Path, kind: str) -> None:
    (tmp_path / "plate.obj").write_text(OBJ)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "x.mtl").write_text(MTL)
    asked = []

    def resolve(uri: str, file: str) -> Any:
        asked.append((uri, Path(file).name))
        if kind == "missing":
            raise FileNotFoundError(uri)
        answers = {"bytes": MTL.encode(), "path": tmp_path / "other" / "x.mtl", "default": None}
        return answers.get(kind, outcrop.Resolution.REFUSED)

    report = context.build(tmp_path / "a.oc", tmp_path / "plate.obj", resolve=resolve)
    assert ("colours.mtl", "plate.obj") in asked
    with context.open(tmp_path / "a.oc") as model:
        is_red = model.parts[0].colour == (1, 0, 0, 1)
    assert is_red == (kind in ("bytes", "path")) and (report.notes == 0) == is_red


def test_exceptions_of_a_resolver_end_the_build(context: outcrop.Context, tmp_path: Path) -> None:
    (tmp_path / "plate.obj").write_text(OBJ)

    def resolve(uri: str, _file: str) -> Any:
        raise ZeroDivisionError(uri)

    with pytest.raises(ZeroDivisionError, match="colours.mtl"):
        context.build(tmp_path / "a.oc", tmp_path / "plate.obj", resolve=resolve)
    assert not (tmp_path / "a.oc").exists()


def test_options(context: outcrop.Context, tmp_path: Path) -> None:
    options = outcrop.BuildOptions(up=outcrop.UpAxis.Y, metres_per_unit=0.001, temp_dir=str(tmp_path))
    context.build(tmp_path / "a.oc", outcrop.Mesh(TETRA, TETRA_FACES), options=options)
    with context.open(tmp_path / "a.oc") as model:
        assert model.info.up == outcrop.UpAxis.Y and model.info.metres_per_unit == 0.001
    with pytest.raises(outcrop.LimitError, match="3"):
        context.build(tmp_path / "b.oc", outcrop.Mesh(TETRA, TETRA_FACES),
                      options=outcrop.BuildOptions(max_triangles=3))
    with pytest.raises(outcrop.LimitError) as caught:
        context.new_build(outcrop.BuildOptions(memory_budget=1))
    assert caught.value.status == outcrop.Status.OVER_BUDGET and caught.value.need == 32 << 20


def test_parts_materials_and_placements(context: outcrop.Context, tmp_path: Path) -> None:
    red = outcrop.Material(colour=(1, 0, 0), opacity=1)
    places = [("left", numpy.eye(4)), ("right", numpy.array([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0]]))]
    with context.new_build() as build:
        body = build.add_part("body", id=40, material=red)
        build.add_triangles(body, TETRA + numpy.float32(20), TETRA_FACES)
        assert build.add_mesh(outcrop.Mesh(TETRA, TETRA_FACES, name="bolt", placements=places)) == [41, 42]
        mesh = build.add_shared_mesh(2)
        build.add_triangles(0, TETRA, TETRA_FACES, mesh=mesh)
        build.add_triangles(1, TETRA + numpy.float32(1), TETRA_FACES, mesh=mesh)
        first = build.add_part("pair 0", parent=body)
        build.add_part("pair 1", parent=body)
        build.add_instance(mesh, first, [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 50, 0])
        with pytest.raises(outcrop.ArgumentError, match="40"):
            build.add_part("again", id=40)
        with build.start(tmp_path / "a.oc") as job:
            assert job.result().instances == 3
            with pytest.raises(outcrop.StateError):
                build.add_part("late")
    with context.open(tmp_path / "a.oc") as model, context.scene(model) as scene:
        assert [part.name for part in model.parts] == ["body", "left", "right", "pair 0", "pair 1"]
        assert model.part(40).colour == (1, 0, 0, 1) and model.parts[model.parts[3].parent].id == 40
        assert model.find_part(42) == 2
        hits = scene.closest([(0.1, 0.1, 9), (5.1, 0.1, 9), (0.1, 50.1, 9), (1.1, 51.1, 9)], (0, 0, -1))
        assert hits["part"].tolist() == [41, 42, first, first + 1]


def test_stand_ins(context: outcrop.Context, tmp_path: Path) -> None:
    vertices, faces = bumps(20)
    for stand_ins in outcrop.StandIns:
        options = outcrop.BuildOptions(stand_ins=stand_ins, proxy_rays=16, proxy_triangles=100)
        context.build(tmp_path / "m.oc", outcrop.Mesh(vertices, faces), options=options)
        with context.open(tmp_path / "m.oc") as model:
            has_some = stand_ins == outcrop.StandIns.PROXIES
            assert (model.info.proxies > 0) == has_some and (model.info.proxy_bytes > 0) == has_some
    with pytest.raises(outcrop.ArgumentError, match="proxy_rays"):
        context.new_build(outcrop.BuildOptions(proxy_rays=1 << 21))


def test_stand_ins_by_name(context: outcrop.Context, tmp_path: Path) -> None:
    mesh = outcrop.Mesh(*bumps(20))
    options = outcrop.BuildOptions(stand_ins=outcrop.StandIns.PROXIES, proxy_rays=16, proxy_triangles=100)
    kinds: list[tuple[outcrop.StandIns | str | None, bool]] = [
        (None, True), ("proxies", True), ("voxels", False), ("auto", False), (outcrop.StandIns.VOXELS, False)]
    for kind, has_some in kinds:
        context.build(tmp_path / "m.oc", mesh, options=options, stand_ins=kind)
        with context.open(tmp_path / "m.oc") as model:
            assert (model.info.proxies > 0) == has_some, kind
    assert options.stand_ins == outcrop.StandIns.PROXIES
    context.build_start(tmp_path / "m.oc", mesh, stand_ins="proxies").result()
    wrong: list[tuple[object, type[Exception]]] = [
        ("boxes", ValueError), ("PROXIES", ValueError), ("", ValueError), (2, TypeError), (b"voxels", TypeError)]
    for bad, error in wrong:
        with pytest.raises(error, match="stand_ins must be StandIns or one of 'auto', 'voxels', 'proxies', not "):
            context.build(tmp_path / "wrong.oc", mesh, stand_ins=bad)  # type: ignore[arg-type]
    assert not (tmp_path / "wrong.oc").exists()


def test_normals_and_colours_of_vertices(context: outcrop.Context, tmp_path: Path) -> None:
    vertices, faces = bumps(20)
    tilted = numpy.zeros((len(vertices), 4))[:, :3] + (0.6, 0, 0.8)
    flat = outcrop.BuildOptions(crease_angle=-1)
    kinds: list[tuple[outcrop.Mesh, outcrop.BuildOptions | None]] = [
        (outcrop.Mesh(vertices, faces, normals=tilted), flat), (outcrop.Mesh(vertices, faces), flat),
        (outcrop.Mesh(vertices, faces), None), (outcrop.Mesh(vertices, faces, vertex_colours=abs(tilted)), flat)]
    shading = []
    for number, (mesh, options) in enumerate(kinds):
        context.build(tmp_path / f"{number}.oc", mesh, options=options)
        with context.open(tmp_path / f"{number}.oc") as model, context.scene(model) as scene:
            hit = scene.closest([(0.33, 0.41, 9)], (0, 0, -1), want=outcrop.Want.ALL | outcrop.Want.SHADING_NORMAL)[0]
            shading.append((model.info.has_normals, hit["shading_normal"], hit["normal"], model.info.has_colours))
    assert [one[0] for one in shading] == [1, 0, 1, 0] and [one[3] for one in shading] == [0, 0, 0, 1]
    assert numpy.allclose(shading[0][1], (0.6, 0, 0.8), atol=0.02) and numpy.array_equal(*shading[1][1:3])
    assert 0.9 < shading[2][1] @ shading[2][2] < 0.99999


def test_what_is_no_mesh_is_refused(context: outcrop.Context, tmp_path: Path) -> None:
    for wrong in [7, None, TETRA, b"x", [3.5]]:
        with pytest.raises(TypeError, match="sources: expected a path, an outcrop.Mesh or an object of trimesh"):
            context.build(tmp_path / "a.oc", wrong)
    with pytest.raises(ValueError, match="faces: the index 9"):
        context.build(tmp_path / "a.oc", outcrop.Mesh(TETRA, [[0, 1, 9]]))


def test_trimesh(context: outcrop.Context, tmp_path: Path) -> None:
    trimesh = need("trimesh")
    ball, cube = trimesh.creation.icosphere(3, 2.0), trimesh.creation.box((1, 1, 1))
    cube.visual.face_colors = [255, 0, 0, 255]
    paint = trimesh.visual.material.PBRMaterial(baseColorFactor=[0, 51, 255, 255])
    ball.visual = trimesh.visual.TextureVisuals(material=paint)
    whole = trimesh.Scene()
    whole.add_geometry(ball, node_name="ball", transform=trimesh.transformations.translation_matrix((10, 0, 0)))
    whole.add_geometry(cube, node_name="cube 1", geom_name="cube")
    whole.graph.update(frame_to="cube 2", frame_from="world", geometry="cube",
                       matrix=trimesh.transformations.translation_matrix((0, 10, 0)))
    report = context.build(tmp_path / "a.oc", whole)
    assert report.triangles_in == 1280 + 12 and report.instances == 2
    with context.open(tmp_path / "a.oc") as model, context.scene(model) as scene:
        by_name = {part.name: part.id for part in model.parts}
        assert set(by_name) == {"ball", "cube 1", "cube 2"}
        # Factors of materials are linear, as in the glTF file.
        assert model.part(by_name["ball"]).colour == pytest.approx((0, 0.2, 1, 1))
        hits = scene.closest([(10, 0, 9), (0, 0, 9), (0, 10, 9)], (0, 0, -1))
        assert hits["part"].tolist() == [by_name["ball"], by_name["cube 1"], by_name["cube 2"]]
        assert numpy.allclose(hits["position"][:, 2], [2, 0.5, 0.5], atol=0.01)
    context.build(tmp_path / "b.oc", {"one": ball, "two": [cube]})
    assert list(names(context, tmp_path / "b.oc").values()) == ["one", "two"]
    with context.open(tmp_path / "b.oc") as model:
        assert model.info.has_colours == 1


class Cube:
    """What pyvista.Cube() has: a point of three faces has the mean of their normals."""

    points = numpy.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    faces = numpy.array([[3, *corners] for a, b, c, d in [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6),
                                                          (0, 2, 6, 4), (1, 5, 7, 3)]
                         for corners in [(a, b, c), (a, c, d)]]).ravel()
    point_data = {"Normals": points / numpy.sqrt(3)}
    is_all_triangles = True


def test_edges_of_pyvista_objects_stay_edges(context: outcrop.Context, tmp_path: Path) -> None:
    context.build(tmp_path / "a.oc", Cube())
    with context.open(tmp_path / "a.oc") as model, context.scene(model) as scene:
        hit = scene.closest([(0.9, 0.8, 9)], (0, 0, -1), want=outcrop.Want.ALL | outcrop.Want.SHADING_NORMAL)[0]
        assert hit["shading_normal"] == pytest.approx((0, 0, 1))


def test_pyvista(context: outcrop.Context, tmp_path: Path) -> None:
    # With vtk it takes 800 MB, so the environment of the tests does without it.
    pyvista = pytest.importorskip("pyvista")
    ball, cube = pyvista.Sphere(radius=2.0), pyvista.Cube(center=(10, 0, 0))
    assert not cube.is_all_triangles
    report = context.build(tmp_path / "a.oc", {"ball": ball, "cube": cube})
    assert report.triangles_in == ball.n_cells + 12
    with context.open(tmp_path / "a.oc") as model, context.scene(model) as scene:
        assert [part.name for part in model.parts] == ["ball", "cube"]
        hits = scene.closest([(0.01, 0.01, 9), (10.1, 0.1, 9)], (0, 0, -1))
        assert hits["part"].tolist() == [0, 1] and numpy.allclose(hits["t"], [7, 8.5], atol=0.02)
    blocks = pyvista.MultiBlock({"first": ball, "second": cube})
    context.build(tmp_path / "b.oc", blocks)
    assert list(names(context, tmp_path / "b.oc").values()) == ["first", "second"]


def test_same_hits_as_trimesh_with_embree(context: outcrop.Context, tmp_path: Path) -> None:
    trimesh = need("trimesh")
    need("embreex")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    vertices, faces = bumps(40)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    random = numpy.random.default_rng(46)
    origins = random.uniform((-0.2, -0.2, 0.5), (1.2, 1.2, 1.5), (20_000, 3))
    directions = random.uniform((0, 0, -0.1), (1, 1, 0.1), (20_000, 3)) - origins
    context.build(tmp_path / "a.oc", mesh)
    with context.open(tmp_path / "a.oc") as model, context.scene(model) as scene:
        ours = scene.closest(origins, directions)
        any_hit = scene.any(origins, directions)
    peer = RayMeshIntersector(mesh, scale_to_box=False)
    triangle = peer.intersects_first(origins, directions)
    hit = ours["kind"] == outcrop.HitKind.EXACT
    # Rays that graze the rim, or run through an edge, may differ in the last digit of a float.
    assert 0.3 < hit.mean() < 0.99 and (hit != (triangle >= 0)).sum() <= 2 and numpy.array_equal(hit, any_hit)
    both = hit & (triangle >= 0)
    same = ours["prim"][both] == triangle[both].astype(numpy.uint64)
    corners = mesh.triangles[triangle[both]]
    normal = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    t = ((corners[:, 0] - origins[both]) * normal).sum(1) / (directions[both] * normal).sum(1)
    assert (~same).sum() <= 10
    assert numpy.allclose(ours["t"][both][same], t[same], rtol=1e-4, atol=1e-4)
    assert numpy.allclose(ours["t"][both][~same], t[~same], rtol=1e-3, atol=1e-3)
