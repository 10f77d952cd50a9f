// A viewer that has its meshes in memory: builds a model from them, renders it, hides parts, and queries a ray and a
// box.
//
//     02_from_memory MODEL.oc [PICTURE.png]
#include <outcrop.hpp>

#include "png.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

namespace {

// Output of a tessellator: interleaved vertices, and indices.
struct Vertex {
    float position[3];
    float normal[3]; // not used: the stride skips it
};
struct Mesh {
    std::vector<Vertex> vertices;
    std::vector<std::uint32_t> indices;
};

// Returns a grid of `u` x `v` quads over a closed surface.
template <class Surface> Mesh tessellate(std::uint32_t u, std::uint32_t v, Surface surface) {
    Mesh mesh;
    for (std::uint32_t j = 0; j <= v; j++) {
        for (std::uint32_t i = 0; i <= u; i++) {
            Vertex vertex = {};
            // The seam closes exactly: the last vertex of a row equals the first, bit by bit.
            surface(double(i % u) / u, double(j) / v, vertex.position);
            mesh.vertices.push_back(vertex);
        }
    }
    for (std::uint32_t j = 0; j < v; j++) {
        for (std::uint32_t i = 0; i < u; i++) {
            const std::uint32_t a = j * (u + 1) + i, b = a + 1, c = a + u + 1, d = c + 1;
            for (std::uint32_t index : {a, b, d, a, d, c}) mesh.indices.push_back(index);
        }
    }
    return mesh;
}

const double TAU = 6.283185307179586;

Mesh torus(double major, double minor) {
    return tessellate(96, 48, [=](double s, double t, float *p) {
        const double r = major + minor * std::cos(TAU * t);
        p[0] = float(r * std::cos(TAU * s));
        p[1] = float(r * std::sin(TAU * s));
        p[2] = float(minor * std::sin(TAU * t));
    });
}

// Returns a closed prism around z. A bolt is two of them: a round shaft and a hexagonal head.
Mesh bolt(std::uint32_t corners, double radius, double low, double high) {
    return tessellate(corners, 3, [=](double s, double t, float *p) {
        const double r = t < 0.1 || t > 0.9 ? 0 : radius; // closes both ends
        p[0] = float(r * std::cos(TAU * s));
        p[1] = float(r * std::sin(TAU * s));
        p[2] = float(t < 0.5 ? low : high);
    });
}

oc_triangles triangles(const Mesh &mesh, std::uint32_t shared, std::uint64_t part) {
    auto t = outcrop::init<oc_triangles>();
    t.mesh = shared;
    t.part = part;
    t.positions = mesh.vertices.data();
    t.position_count = mesh.vertices.size();
    t.position_stride = sizeof(Vertex);
    t.indices = mesh.indices.data();
    t.index_count = mesh.indices.size();
    t.index = OC_INDEX_U32;
    return t;
}

oc_material material(float r, float g, float b) {
    auto m = outcrop::init<oc_material>();
    m.colour[0] = r, m.colour[1] = g, m.colour[2] = b;
    m.opacity = 1;
    return m;
}

// The part ids are the viewer's own. Hits and pictures contain them.
const std::uint64_t RING = 500, BOLTS = 1000, BOLT_COUNT = 12;

void build(const outcrop::context &context, const std::string &path) {
    outcrop::build build(context);
    const std::uint32_t orange = build.add_material(material(0.9f, 0.3f, 0.05f));
    const std::uint32_t steel = build.add_material(material(0.5f, 0.55f, 0.6f));
    build.add_part(RING, "ring", orange);
    build.add_triangles(triangles(torus(2, 0.5), 0, RING));

    // A bolt has two parts. It is stored once and placed twelve times.
    const std::uint32_t shared = build.add_shared_mesh(2);
    build.add_triangles(triangles(bolt(24, 0.12, -0.8, 0.6), shared, 0));
    build.add_triangles(triangles(bolt(6, 0.22, 0.55, 0.7), shared, 1));
    for (std::uint64_t i = 0; i < BOLT_COUNT; i++) {
        build.add_part(BOLTS + 2 * i, "shaft " + std::to_string(i), steel);
        build.add_part(BOLTS + 2 * i + 1, "head " + std::to_string(i), steel);
        const double angle = TAU * double(i) / BOLT_COUNT;
        const double place[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 2 * std::cos(angle), 2 * std::sin(angle), 0};
        build.add_instance(shared, BOLTS + 2 * i, place);
    }
    const outcrop::job job = build.start(path);
    job.wait();
    const oc_build_report report = job.report();
    std::printf("%llu triangles pushed, %llu kept, %llu parts, %llu instances, %llu bytes\n",
                (unsigned long long)report.triangles_in, (unsigned long long)report.triangles_kept,
                (unsigned long long)report.parts, (unsigned long long)report.instances,
                (unsigned long long)report.file_bytes);
}

// Renders a picture, and counts the pixels that show a bolt.
std::size_t render(outcrop::frame &frame, const outcrop::scene &scene, const oc_camera &camera) {
    frame.request(scene, camera);
    frame.wait();
    const outcrop::pixels parts = frame.map(OC_BUFFER_PART);
    std::size_t bolts = 0;
    for (std::uint32_t y = 0; y < parts.height(); y++) {
        for (std::uint32_t x = 0; x < parts.width(); x++) {
            const std::uint64_t part = parts.row<std::uint64_t>(y)[x];
            bolts += part >= BOLTS && part < BOLTS + 2 * BOLT_COUNT;
        }
    }
    return bolts;
}

void expect(bool condition, const char *what) {
    if (condition) return;
    std::fprintf(stderr, "not as it should be: %s\n", what);
    std::exit(1);
}

int run(const std::string &path, const char *picture) {
    const outcrop::context context(OC_ALL_THREADS);
    build(context, path);
    const outcrop::model model = context.open(path);
    expect(model.info().parts == 1 + 2 * BOLT_COUNT, "every part is there");
    expect(std::string(model.part(model.find_part(BOLTS + 1)).name) == "head 0", "parts have their names");

    outcrop::scene scene(context);
    scene.add_instance(model, 42);
    scene.commit();
    auto desc = outcrop::init<oc_frame_desc>();
    desc.width = 640, desc.height = 480;
    desc.buffers = 1u << OC_BUFFER_COLOUR_SRGB8 | 1u << OC_BUFFER_PART;
    outcrop::frame frame(context, desc);
    auto camera = outcrop::init<oc_camera>();
    camera.eye[0] = 3, camera.eye[1] = -4, camera.eye[2] = 4.5;

    const std::size_t all = render(frame, scene, camera);
    expect(all > 1000, "bolts are seen");
    if (picture) {
        const outcrop::pixels colour = frame.map();
        expect(!png_write(picture, colour.row<unsigned char>(0), colour.width(), colour.height(), colour.row_pitch()),
               "the picture can be written");
    }

    // A ray from above. The top of the head of bolt 0 is at (2, 0, 0.7).
    auto ray = oc_ray();
    ray.origin[0] = 2, ray.origin[1] = 0.01, ray.origin[2] = 10;
    ray.direction[2] = -1;
    const oc_hit hit = scene.closest({ray})[0];
    expect(hit.part == BOLTS + 1 && hit.instance == 42, "the ray hits the head of bolt 0");
    expect(std::fabs(hit.t - 9.3) <= 1e-6, "at its height");

    // No ray hits hidden parts. The edits take effect at the commit; frames in flight would keep the old state.
    auto hidden = outcrop::init<oc_look>();
    hidden.flags = OC_LOOK_HIDDEN;
    for (std::uint64_t i = 0; i < 2 * BOLT_COUNT; i++) scene.set_part_look(42, BOLTS + i, hidden);
    expect(scene.any({ray})[0] == 1, "nothing changes before the commit");
    expect(scene.closest({ray})[0].part == BOLTS + 1, "not the hits either");
    scene.commit();
    expect(scene.closest({ray})[0].part == RING, "now the ring is hit");
    expect(render(frame, scene, camera) == 0, "no bolt is seen");
    scene.clear_part_looks(42);
    scene.commit();
    expect(render(frame, scene, camera) == all, "the same picture as at first");

    const double low[3] = {1.5, -0.5, 0.65}, high[3] = {2.5, 0.5, 1};
    const std::vector<oc_overlap> found = scene.overlap_box(low, high);
    expect(found.size() == 1 && found[0].part == BOLTS + 1, "one head reaches into the box");
    std::printf("%zu pixels show bolts; box: part %llu\n", all, (unsigned long long)found[0].part);
    return 0;
}

} // namespace

int main(int argc, char **argv) {
    if (argc < 2 || argc > 3) {
        std::fprintf(stderr, "usage: %s MODEL.oc [PICTURE.png]\n", argv[0]);
        return 2;
    }
    try {
        return run(argv[1], argc == 3 ? argv[2] : nullptr);
    } catch (const std::exception &e) {
        std::fprintf(stderr, "%s\n", e.what());
        return 1;
    }
}
