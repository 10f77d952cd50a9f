// Builds two smooth surfaces from memory: a creased subdivision cage, and a NURBS vase, both as triangles and as grids
// (OC_STRUCTURE_PATCH). Prints the triangles into which they are diced at several tolerances, and their bytes in
// memory. Looks for cracks with rays from the inside, clicks on a face of the cage, prints how the surface bends there,
// and writes a picture. Fails if a ray leaves the closed surface.
//
//     12_surfaces NAME PICTURE.png          (writes NAME_0.oc to NAME_2.oc, and NAME_triangles.oc)
#include <outcrop.hpp>

#include "png.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

const std::uint32_t WIDTH = 640, HEIGHT = 360;

// A box with a smaller one pushed out of its top. The rim of the lower part is a semi-sharp crease: two subdivisions
// keep the edge, all further ones make it smooth.
struct Cage {
    std::vector<double> positions;
    std::vector<std::uint32_t> indices;
    std::vector<std::uint32_t> creases;
    std::vector<float> sharpness;
};

Cage cage() {
    Cage c;
    const double rings[3][2] = {{1, 0}, {1, 0.8}, {0.55, 0.8}};
    const double top = 1.8;
    for (const auto &ring : rings) {
        for (int i = 0; i < 4; i++) {
            const double x = i == 0 || i == 3 ? -1 : 1, y = i < 2 ? -1 : 1;
            c.positions.insert(c.positions.end(), {x * ring[0], y * ring[0], ring[1]});
        }
    }
    for (int i = 0; i < 4; i++) {
        const double x = i == 0 || i == 3 ? -1 : 1, y = i < 2 ? -1 : 1;
        c.positions.insert(c.positions.end(), {0.5 * x, 0.5 * y, top});
    }
    c.indices = {3, 2, 1, 0};
    for (std::uint32_t ring = 0; ring < 3; ring++) {
        for (std::uint32_t i = 0; i < 4; i++) {
            const std::uint32_t next = (i + 1) % 4, from = 4 * ring;
            c.indices.insert(c.indices.end(), {from + i, from + next, from + 4 + next, from + 4 + i});
        }
    }
    c.indices.insert(c.indices.end(), {12, 13, 14, 15});
    for (std::uint32_t ring : {0u, 1u}) {
        for (std::uint32_t i = 0; i < 4; i++) {
            c.creases.insert(c.creases.end(), {4 * ring + i, 4 * ring + (i + 1) % 4});
            c.sharpness.push_back(ring == 0 ? 10.0f : 2.0f); // the lower edge stays sharp
        }
    }
    return c;
}

// A profile turned round the z axis: nine control points make a circle exactly.
struct Vase {
    std::vector<double> points, weights;
    std::vector<double> around{0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4}, along{0, 0, 0, 0, 1, 2, 3, 3, 3, 3};
    std::uint32_t profile = 6;
};

Vase vase(double x) {
    Vase v;
    const double radius[] = {0.5, 1.1, 0.9, 0.2, 0.35, 0.6}, height[] = {0, 0.2, 0.9, 1.2, 1.6, 1.9};
    const int circle[9][2] = {{1, 0}, {1, 1}, {0, 1}, {-1, 1}, {-1, 0}, {-1, -1}, {0, -1}, {1, -1}, {1, 0}};
    for (int i = 0; i < 9; i++) {
        for (std::uint32_t j = 0; j < v.profile; j++) {
            v.points.insert(v.points.end(), {x + radius[j] * circle[i][0], radius[j] * circle[i][1], height[j]});
            v.weights.push_back(i % 2 ? std::sqrt(0.5) : 1.0);
        }
    }
    return v;
}

const std::uint64_t BOX = 100, VASE = 1;

outcrop::model build(const outcrop::context &context, const std::string &path, double tolerance,
                     oc_structure structure) {
    auto desc = outcrop::init<oc_build_desc>();
    desc.structure = structure;
    desc.surface_tolerance = tolerance;
    outcrop::build build(context, desc);
    auto material = outcrop::init<oc_material>();
    material.colour[0] = 0.75f, material.colour[1] = 0.3f, material.colour[2] = 0.12f;
    material.opacity = 1, material.roughness = 0.5f;
    const std::uint32_t red = build.add_material(material);
    material.colour[0] = 0.2f, material.colour[2] = 0.55f;
    build.add_part(VASE, "vase", build.add_material(material));

    const Cage c = cage();
    std::vector<std::uint64_t> parts; // each face of the cage is a part, to click on
    for (std::size_t face = 0; face < c.indices.size() / 4; face++) {
        parts.push_back(BOX + face);
        build.add_part(parts.back(), "face " + std::to_string(face), red);
    }
    auto surface = outcrop::init<oc_cage>();
    surface.positions = c.positions.data();
    surface.position_count = c.positions.size() / 3;
    surface.scalar = OC_SCALAR_F64;
    surface.indices = c.indices.data();
    surface.index_count = c.indices.size();
    surface.face_count = parts.size();
    surface.face_parts = parts.data();
    surface.creases = c.creases.data();
    surface.crease_sharpness = c.sharpness.data();
    surface.crease_count = c.sharpness.size();
    build.add_cage(surface);

    const Vase v = vase(3);
    auto nurbs = outcrop::init<oc_nurbs>();
    nurbs.part = VASE;
    nurbs.degree_u = 2, nurbs.count_u = 9, nurbs.knots_u = v.around.data();
    nurbs.degree_v = 3, nurbs.count_v = v.profile, nurbs.knots_v = v.along.data();
    nurbs.points = v.points.data(), nurbs.weights = v.weights.data();
    build.add_nurbs(nurbs);
    build.start(path).wait();
    return context.open(path);
}

// Rays from the inside of the cage in many directions. Returns how many meet nothing.
std::uint64_t leaks(const outcrop::scene &scene) {
    const std::uint32_t count = 100000;
    std::vector<oc_ray> rays(count);
    for (std::uint32_t i = 0; i < count; i++) {
        const double z = 1 - (2 * i + 1.0) / count, turn = i * 2.399963229728653, r = std::sqrt(1 - z * z);
        rays[i] = oc_ray();
        rays[i].origin[2] = 0.6;
        rays[i].direction[0] = float(r * std::cos(turn)), rays[i].direction[1] = float(r * std::sin(turn));
        rays[i].direction[2] = float(z);
        rays[i].t_max = INFINITY, rays[i].mask = UINT32_MAX;
    }
    std::uint64_t lost = 0;
    for (const oc_hit &hit : scene.closest(rays)) lost += hit.kind != OC_HIT_EXACT;
    return lost;
}

// Bytes in memory of the geometry of a model, for each of its triangles.
double bytes_each(const outcrop::model &model) {
    const oc_model_info info = model.info();
    return double(info.geometry_bytes) / double(info.triangles_stored);
}

void run(const std::string &name, const char *picture) {
    const outcrop::context context(OC_ALL_THREADS);
    outcrop::scene scene(context);
    for (int i = 0; i < 3; i++) {
        const double tolerance = std::pow(10.0, -2 - i);
        const double as_triangles = bytes_each(build(context, name + "_triangles.oc", tolerance, OC_STRUCTURE_BVH));
        const outcrop::model model =
            build(context, name + "_" + std::to_string(i) + ".oc", tolerance, OC_STRUCTURE_PATCH);
        scene = outcrop::scene(context);
        scene.add_instance(model, 1);
        scene.commit();
        const std::uint64_t lost = leaks(scene);
        std::printf("tolerance %g: %llu triangles of %.1f bytes (%.1f as triangles), %llu rays left the closed surface\n",
                    tolerance, static_cast<unsigned long long>(model.info().triangles_stored), bytes_each(model),
                    as_triangles, static_cast<unsigned long long>(lost));
        if (lost > 0) throw std::runtime_error("the surface has a crack");
    }

    auto camera = outcrop::init<oc_camera>();
    camera.eye[0] = 4.5, camera.eye[1] = -6.5, camera.eye[2] = 4.2;
    camera.at[0] = 1.5, camera.at[2] = 0.8, camera.up[2] = 1, camera.fov_y = 28;
    auto desc = outcrop::init<oc_frame_desc>();
    desc.width = WIDTH, desc.height = HEIGHT;
    desc.buffers = 1u << OC_BUFFER_COLOUR_SRGB8;
    outcrop::frame frame(context, desc);
    frame.request(scene, camera, outcrop::init<oc_frame_settings>());
    frame.wait();
    const oc_hit clicked = frame.pick(WIDTH * 3 / 10, HEIGHT * 6 / 10);
    if (clicked.kind != OC_HIT_EXACT || clicked.part < BOX) throw std::runtime_error("the click missed the box");
    // The cage was added first, so the primitive ids of its faces begin with 0.
    if (clicked.prim != clicked.part - BOX) throw std::runtime_error("the click has another face than its part");
    std::printf("a click: face %llu of the cage, normal %.3f %.3f %.3f\n",
                static_cast<unsigned long long>(clicked.prim), double(clicked.shading_normal[0]),
                double(clicked.shading_normal[1]), double(clicked.shading_normal[2]));
    const oc_surface_point bend = scene.evaluate({clicked}).at(0);
    std::printf("principal curvatures there: %.3f and %.3f\n", bend.curvatures[0], bend.curvatures[1]);
    // Seen from outside a surface that bulges bends away from its normal.
    if (bend.curvatures[1] >= 0) throw std::runtime_error("the box is hollow where it was clicked");
    const outcrop::pixels pixels = frame.map(OC_BUFFER_COLOUR_SRGB8);
    std::vector<unsigned char> bytes;
    for (std::uint32_t y = 0; y < HEIGHT; y++) {
        bytes.insert(bytes.end(), pixels.row<unsigned char>(y), pixels.row<unsigned char>(y) + 4 * WIDTH);
    }
    if (png_write(picture, bytes.data(), WIDTH, HEIGHT, 4 * WIDTH)) throw std::runtime_error("the picture failed");
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: %s NAME PICTURE.png\n", argv[0]);
        return 2;
    }
    try {
        run(argv[1], argv[2]);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
