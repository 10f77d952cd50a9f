// Plants a forest: three kinds of trees, built from memory, placed on a tile as one array of instances. The forest is an
// array of tiles, SIDE in each direction: a scene in a scene takes memory once, however often it stands there. Prints
// the memory of an instance and the times, clicks on a tree, highlights it in this tile alone, hides its neighbours, and
// writes a picture. Fails if a tree is not met where it was planted.
//
//     11_forest TREES SIDE NAME PICTURE.png          (writes NAME_0.oc to NAME_2.oc and NAME_ground.oc)
#include <outcrop.hpp>

#include "png.h"

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Vec = std::array<double, 3>;

const std::uint32_t WIDTH = 640, HEIGHT = 360;
const std::uint64_t GROUND = 1, FIRST = 1000, TILE = 1;
const double APART = 2.5; // metres between trees

// A seeded sequence of numbers from 0 to below 1 (Steele, Lea, Flood: "Fast splittable pseudorandom number
// generators", 2014).
struct Random {
    std::uint64_t state;
    double next() {
        std::uint64_t z = state += 0x9e3779b97f4a7c15u;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return double((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
    }
    double between(double low, double high) { return low + (high - low) * next(); }
};

// The height of the ground of a tile of half the size `half`. It is the same at opposite borders, so tiles join.
double height(double x, double y, double half) {
    const double turn = 3.141592653589793 / half;
    return 0.03 * half * std::sin(x * turn) * std::cos(y * turn) + 0.01 * half * std::sin(3 * x * turn);
}

struct Mesh {
    std::vector<float> positions;
    void triangle(const Vec &a, const Vec &b, const Vec &c) {
        for (const Vec *v : {&a, &b, &c}) {
            for (double x : *v) positions.push_back(float(x));
        }
    }
};

outcrop::model build(const outcrop::context &context, const std::string &path, const std::vector<Mesh> &meshes,
                     const std::vector<std::array<float, 3>> &colours) {
    outcrop::build build(context);
    for (std::size_t i = 0; i < meshes.size(); i++) {
        auto material = outcrop::init<oc_material>();
        for (std::size_t k = 0; k < 3; k++) material.colour[k] = colours[i][k];
        auto part = outcrop::init<oc_part>();
        part.material = build.add_material(material);
        part.id = i + 1, part.name = i == 0 ? "wood" : "leaves";
        build.add_part(part);
        auto triangles = outcrop::init<oc_triangles>();
        triangles.part = i + 1;
        triangles.positions = meshes[i].positions.data(), triangles.position_count = meshes[i].positions.size() / 3;
        build.add_triangles(triangles);
    }
    build.start(path).wait();
    return context.open(path);
}

// A trunk with whorls of branches, each with leaves of one triangle.
outcrop::model build_tree(const outcrop::context &context, const std::string &path, std::uint64_t kind) {
    Random random = {17 * kind + 1};
    Mesh wood, leaves;
    const double tall = 5 + 2.5 * double(kind), turn = 6.283185307179586;
    for (int i = 0; i < 6; i++) {
        const double a = i * turn / 6, b = (i + 1) * turn / 6, thick = 0.025 * tall;
        wood.triangle({{thick * std::cos(a), thick * std::sin(a), 0}}, {{thick * std::cos(b), thick * std::sin(b), 0}},
                      {{0, 0, tall}});
    }
    for (int i = 0; i < 60; i++) {
        const double up = random.between(0.2, 0.98), about = random.between(0, turn);
        const double reach = (1 - up) * (kind == 1 ? 2.4 : 1.6) + 0.2, from = up * tall;
        const Vec along = {{std::cos(about), std::sin(about), kind == 2 ? 0.35 : -0.2}};
        const Vec end = {{reach * along[0], reach * along[1], from + reach * along[2]}};
        wood.triangle({{0, 0, from}}, {{0, 0, from - 0.06}}, end);
        for (int k = 0; k < 8; k++) {
            const double t = random.between(0.3, 1.1), size = random.between(0.1, 0.35);
            const Vec at = {{t * end[0], t * end[1], from + t * (end[2] - from)}};
            auto near = [&]() -> Vec {
                return {{at[0] + random.between(-size, size), at[1] + random.between(-size, size),
                         at[2] + random.between(-size, size)}};
            };
            const Vec a = near(), b = near(), c = near();
            leaves.triangle(a, b, c);
        }
    }
    return build(context, path, {wood, leaves},
                 {{{0.23f, 0.14f, 0.08f}}, {{0.06f + 0.05f * float(kind), 0.22f + 0.06f * float(kind), 0.05f}}});
}

outcrop::model build_ground(const outcrop::context &context, const std::string &path, double half) {
    Mesh ground;
    const int grid = 64;
    auto at = [&](int i, int j) -> Vec {
        const double x = half * (2.0 * i / grid - 1), y = half * (2.0 * j / grid - 1);
        return {{x, y, height(x, y, half) - 0.3}};
    };
    for (int i = 0; i < grid; i++) {
        for (int j = 0; j < grid; j++) {
            ground.triangle(at(i, j), at(i + 1, j), at(i + 1, j + 1));
            ground.triangle(at(i, j), at(i + 1, j + 1), at(i, j + 1));
        }
    }
    return build(context, path, {ground}, {{{0.2f, 0.24f, 0.1f}}});
}

double seconds_since(std::chrono::steady_clock::time_point begin) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void run(std::uint64_t count, std::uint64_t tiles, const std::string &name, const char *picture) {
    const outcrop::context context(OC_ALL_THREADS);
    std::vector<outcrop::model> kinds;
    std::vector<const oc_model *> prototypes;
    for (std::uint64_t kind = 0; kind < 3; kind++) {
        kinds.push_back(build_tree(context, name + "_" + std::to_string(kind) + ".oc", kind));
    }
    for (const outcrop::model &kind : kinds) prototypes.push_back(kind.get());
    const auto side = std::uint64_t(std::ceil(std::sqrt(double(count))));
    const double half = 0.5 * APART * double(side);

    // One place for each tree: position, turn about the vertical, size.
    std::vector<oc_place> places(count);
    std::vector<std::uint32_t> kind_of(count);
    Random random = {42};
    for (std::uint64_t i = 0; i < count; i++) {
        const double x = APART * (double(i % side) + random.between(0.1, 0.9)) - half;
        const double y = APART * (double(i / side) + random.between(0.1, 0.9)) - half;
        const double turn = random.between(0, 3.14159);
        oc_place &place = places[i];
        place = oc_place();
        place.position[0] = x, place.position[1] = y, place.position[2] = height(x, y, half);
        place.rotation[2] = float(std::sin(turn)), place.rotation[3] = float(std::cos(turn));
        place.scale = float(random.between(0.6, 1.1));
        kind_of[i] = std::uint32_t(random.next() * 3);
    }

    outcrop::scene tile(context);
    tile.add_instance(build_ground(context, name + "_ground.oc", half), GROUND);
    tile.commit();
    const std::uint64_t before = context.property(OC_PROPERTY_MEMORY_USED);
    auto start = std::chrono::steady_clock::now();
    auto all = outcrop::init<oc_instances>();
    all.form = OC_TRANSFORM_PLACE;
    all.prototypes = prototypes.data(), all.prototype_count = prototypes.size(), all.prototype_of = kind_of.data();
    all.transforms = places.data(), all.count = count, all.first_id = FIRST;
    tile.add_instances(all);
    tile.commit();
    std::printf("%llu trees: %.0f bytes each, planted in %.2f s\n", static_cast<unsigned long long>(count),
                double(context.property(OC_PROPERTY_MEMORY_USED) - before) / double(count), seconds_since(start));

    // The forest: the tile in many places.
    start = std::chrono::steady_clock::now();
    std::vector<oc_place> corners(tiles * tiles);
    for (std::uint64_t i = 0; i < corners.size(); i++) {
        corners[i] = oc_place();
        corners[i].position[0] = half * (2 * double(i % tiles) + 1 - double(tiles));
        corners[i].position[1] = half * (2 * double(i / tiles) + 1 - double(tiles));
        corners[i].rotation[3] = corners[i].scale = 1;
    }
    outcrop::scene scene(context);
    scene.add_instances(tile, corners, TILE);
    scene.commit();
    std::printf("%llu trees in %llu tiles: %.1f MB in all, in %.3f s\n",
                static_cast<unsigned long long>(count * corners.size()), static_cast<unsigned long long>(corners.size()),
                double(context.property(OC_PROPERTY_MEMORY_USED)) / 1e6, seconds_since(start));

    // The trunk of a tree is where it was planted, and the way there leads through its tile.
    for (std::uint64_t i = 0; i < count; i += count / 7 + 1) {
        const std::uint64_t at = i * 5 % corners.size();
        auto ray = oc_ray();
        for (int k = 0; k < 3; k++) ray.origin[k] = corners[at].position[k] + places[i].position[k];
        ray.origin[0] -= 0.5 * double(places[i].scale), ray.origin[2] += 0.1 * double(places[i].scale);
        ray.direction[0] = 1, ray.t_max = 1, ray.mask = UINT32_MAX;
        const oc_hit hit = scene.closest(std::vector<oc_ray>(1, ray))[0];
        if (hit.part != 1 || scene.path(hit) != std::vector<std::uint64_t>{TILE + at, FIRST + i}) {
            throw std::runtime_error("a tree is not where it was planted");
        }
    }

    // A click in the middle: the tree is highlighted, those beside it are hidden, in this tile alone.
    auto camera = outcrop::init<oc_camera>();
    const double edge = half * double(tiles);
    camera.eye[0] = -edge - 10, camera.eye[1] = -edge - 10, camera.eye[2] = 30;
    camera.at[2] = -10, camera.up[2] = 1, camera.fov_y = 35;
    auto desc = outcrop::init<oc_frame_desc>();
    desc.width = WIDTH, desc.height = HEIGHT;
    desc.buffers = 1u << OC_BUFFER_COLOUR_SRGB8;
    outcrop::frame frame(context, desc);
    auto settings = outcrop::init<oc_frame_settings>();
    settings.poe = 3;
    start = std::chrono::steady_clock::now();
    frame.request(scene, camera, settings);
    frame.wait();
    std::printf("picture of all in %.2f s\n", seconds_since(start));
    const oc_hit clicked = frame.pick(WIDTH / 2, HEIGHT * 3 / 4);
    const auto way = clicked.kind == OC_HIT_MISS ? std::vector<std::uint64_t>() : scene.path(clicked);
    if (way.size() == 2 && way[1] >= FIRST) {
        auto look = outcrop::init<oc_look>();
        look.flags = OC_LOOK_SELECTED;
        scene.set_occurrence_look(clicked.occurrence, look);
        // The trees of a tile have consecutive numbers.
        look.flags = OC_LOOK_HIDDEN;
        for (std::uint64_t k = 1; k <= 3 && way[1] - k >= FIRST; k++) {
            scene.set_occurrence_look(clicked.occurrence - k, look);
        }
        start = std::chrono::steady_clock::now();
        scene.commit();
        std::printf("tree %llu of tile %llu highlighted in %.4f s\n", static_cast<unsigned long long>(way[1]),
                    static_cast<unsigned long long>(way[0]), seconds_since(start));
    }
    frame.request(scene, camera, settings);
    frame.wait();
    const outcrop::pixels pixels = frame.map(OC_BUFFER_COLOUR_SRGB8);
    std::vector<unsigned char> bytes;
    for (std::uint32_t y = 0; y < HEIGHT; y++) {
        bytes.insert(bytes.end(), pixels.row<unsigned char>(y), pixels.row<unsigned char>(y) + 4 * WIDTH);
    }
    if (png_write(picture, bytes.data(), WIDTH, HEIGHT, 4 * WIDTH)) throw std::runtime_error("the picture failed");
}

} // namespace

int main(int argc, char **argv) {
    const long long count = argc == 5 ? std::atoll(argv[1]) : 0, side = argc == 5 ? std::atoll(argv[2]) : 0;
    if (count < 1 || side < 1 || side > 10000) {
        std::fprintf(stderr, "usage: %s TREES SIDE NAME PICTURE.png\n", argv[0]);
        return 2;
    }
    try {
        run(std::uint64_t(count), std::uint64_t(side), argv[3], argv[4]);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
