"""Tests the Python binding. OUTCROP_LIBRARY: path of the installed library. OUTCROP_INCLUDE: folder of outcrop.h."""

import ctypes
import os
import re
import subprocess
import tempfile
import unittest

import outcrop

TETRA = ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])
STRUCTS = {
    outcrop.ContextDesc: "oc_context_desc", outcrop.Progress: "oc_progress", outcrop.Camera: "oc_camera",
    outcrop.Part: "oc_part", outcrop.Triangles: "oc_triangles", outcrop.BuildReport: "oc_build_report",
    outcrop.ModelInfo: "oc_model_info", outcrop.PartInfo: "oc_part_info", outcrop.Ray: "oc_ray", outcrop.Hit: "oc_hit",
    outcrop.Query: "oc_query", outcrop.FrameDesc: "oc_frame_desc", outcrop.FrameSettings: "oc_frame_settings",
    outcrop.Pixels: "oc_pixels",
}


class Binding(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = os.path.join(folder.name, "tetra.oc")

    def test_structs_are_those_of_the_header(self):
        include = os.environ["OUTCROP_INCLUDE"]
        asserts = ["#include <outcrop.h>", "#include <stddef.h>"]
        for python, name in STRUCTS.items():
            asserts.append(f'_Static_assert(sizeof({name}) == {ctypes.sizeof(python)}, "{name}");')
            for field, _ in python._fields_:
                offset = getattr(python, field).offset
                asserts.append(f'_Static_assert(offsetof({name}, {field}) == {offset}, "{name}.{field}");')
        command = ["cc", "-std=c11", "-fsyntax-only", "-x", "c", "-I", include, "-"]
        subprocess.run(command, input="\n".join(asserts) + "\n", text=True, check=True)
        with open(os.path.join(include, "outcrop.h"), encoding="utf-8") as header:
            version = re.search(r"#define OC_HEADER_VERSION (\d+)", header.read())
        self.assertEqual(int(version[1]), outcrop.HEADER_VERSION)

    def test_from_memory_to_picture_and_pick(self):
        fractions = []
        with outcrop.Context(threads=2) as context:
            report = context.build(self.path, meshes=[(7, "tetra", *TETRA)], progress=fractions.append)
            self.assertEqual((report.triangles_in, report.triangles_kept, report.parts), (4, 4, 1))
            self.assertEqual((sorted(fractions), fractions[-1]), (fractions, 1.0))
            model = context.open(self.path)
            self.assertEqual(model.parts, [(7, "tetra")])
            scene = context.scene([(5, model, [1, 0, 0, 0, 1, 0, 0, 0, 1, 10, 0, 0])])

            hit, miss = scene.closest([((10.1, 0.1, -1), (0, 0, 1)), ((0, 0, -1), (0, 0, 1))])
            self.assertEqual((hit.kind, hit.t, hit.part, hit.instance, hit.prim), (outcrop.EXACT, 1.0, 7, 5, 0))
            self.assertFalse(miss)

            camera = outcrop.Camera(eye=(10.3, 0.3, 5), at=(10.2, 0.2, 0), up=(0, 1, 0))
            picture = context.render(scene, camera, 64, 48)
            width, height, pixels = picture.pixels()
            self.assertEqual((width, height, len(pixels)), (64, 48, 64 * 48 * 4))
            self.assertGreater(len(set(pixels)), 10)
            self.assertEqual(picture.pick(32, 24).part, 7)

            ray = [((10.1, 0.1, -1), (0, 0, 1))]
            scene.set_parts_look([7], hidden=True, instance=5)
            scene.commit()
            self.assertFalse(scene.closest(ray)[0])
            scene.isolate([7], below=True, instance=5)
            scene.commit()
            self.assertEqual(scene.closest(ray)[0].part, 7)
            with self.assertRaisesRegex(outcrop.Error, "no part 8"):
                scene.set_parts_look([7, 8], colour=(1, 0, 0, 1), instance=5)
            scene.clear_part_looks(instance=5)
            scene.commit()

    def test_failures_are_exceptions(self):
        with outcrop.Context(threads=0) as context:
            with self.assertRaisesRegex(outcrop.Error, "missing.oc") as caught:
                context.open(self.path.replace("tetra", "missing"))
            self.assertEqual(caught.exception.status, 500)
            with self.assertRaisesRegex(outcrop.Error, "no-such-file"):
                context.build(self.path, files=["no-such-file.ply"])
            with self.assertRaisesRegex(outcrop.Error, "is 9, but there are 4"):
                context.build(self.path, meshes=[(7, "", TETRA[0], [0, 1, 9])])


if __name__ == "__main__":
    unittest.main()
