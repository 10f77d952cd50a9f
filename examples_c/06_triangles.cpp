// Writes the part under the middle of a view as an OBJ file, with its normals, and prints the corner of the hit triangle
// that is nearest to the hit.
//
//     06_triangles MODEL.oc OUT.obj
#include <outcrop.hpp>

#include <cmath>
#include <cstdio>

namespace {

// The closest hit of the ray through the middle of the model's first view.
oc_hit middle(const outcrop::model &model, const outcrop::scene &scene) {
    const oc_camera view = model.view(0);
    oc_ray ray = {};
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = view.eye[axis];
        ray.direction[axis] = static_cast<float>(view.at[axis] - view.eye[axis]);
    }
    return scene.closest({ray})[0];
}

double distance(const double *a, const double *b) {
    return std::hypot(std::hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

} // namespace

int main(int argc, char **argv) try {
    if (argc != 3) {
        std::fprintf(stderr, "usage: %s MODEL.oc OUT.obj\n", argv[0]);
        return 2;
    }
    outcrop::context context(OC_ALL_THREADS);
    outcrop::model model = context.open(argv[1]);
    outcrop::scene scene(context);
    scene.add_instance(model, 1);
    scene.commit();

    const oc_hit hit = middle(model, scene);
    if (hit.kind != OC_HIT_EXACT) {
        std::fprintf(stderr, "nothing is in the middle of the view\n");
        return 1;
    }
    const oc_triangle own = scene.triangles({hit})[0];
    const double *nearest = own.corners;
    for (int corner = 1; corner < 3; corner++) {
        const double *other = own.corners + 3 * corner;
        if (distance(other, hit.position) < distance(nearest, hit.position)) nearest = other;
    }
    std::printf("part %llu, triangle %llu, nearest corner %g %g %g\n", static_cast<unsigned long long>(hit.part),
                static_cast<unsigned long long>(hit.prim), nearest[0], nearest[1], nearest[2]);

    std::FILE *out = std::fopen(argv[2], "w");
    if (!out) {
        std::perror(argv[2]);
        return 1;
    }
    outcrop::part_reader reader = model.read_part(hit.part);
    unsigned long long count = 0;
    for (std::vector<oc_triangle> some = reader.next(); !some.empty(); some = reader.next()) {
        for (const oc_triangle &triangle : some) {
            for (int corner = 0; corner < 3; corner++) {
                const double *p = triangle.corners + 3 * corner;
                const float *n = triangle.normals + 3 * corner;
                std::fprintf(out, "v %.17g %.17g %.17g\nvn %.9g %.9g %.9g\n", p[0], p[1], p[2], n[0], n[1], n[2]);
            }
            std::fputs("f -3//-3 -2//-2 -1//-1\n", out);
            count++;
        }
    }
    if (std::fclose(out) != 0) {
        std::perror(argv[2]);
        return 1;
    }
    std::printf("%s: %llu triangles\n", argv[2], count);
} catch (const outcrop::error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
