// Drops a box onto a bumpy ground for 215 steps, by distances alone, and writes a picture of its way. Fails if the box
// ever meets the ground, gains energy, or does not come to rest on it.
//
//     10_drop GROUND.oc BOX.oc PICTURE.png
//
// Each step moves the box no farther than its distance from the ground allows (conservative advancement: Mirtich,
// "Impulse-based Dynamic Simulation of Rigid Body Systems", 1996): so surfaces never cross, at any speed. Where the
// distance is below a margin, the two nearest points are a contact, and an impulse stops or reflects the approach.
#include <outcrop.hpp>

#include "png.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

namespace {

using Vec = std::array<double, 3>;

Vec operator+(const Vec &a, const Vec &b) { return {{a[0] + b[0], a[1] + b[1], a[2] + b[2]}}; }
Vec operator-(const Vec &a, const Vec &b) { return {{a[0] - b[0], a[1] - b[1], a[2] - b[2]}}; }
Vec operator*(const Vec &a, double by) { return {{a[0] * by, a[1] * by, a[2] * by}}; }
double dot(const Vec &a, const Vec &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double length(const Vec &a) { return std::sqrt(dot(a, a)); }
Vec cross(const Vec &a, const Vec &b) {
    return {{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]}};
}

const int STEPS = 215, SHOWN_EACH = 12, GRID = 48;
const double STEP = 1.0 / 60, MARGIN = 0.004, GRAVITY = 9.81, BOUNCE = 0.3, FRICTION = 0.5;
const Vec HALF = {{0.5, 0.35, 0.25}};
const std::uint32_t WIDTH = 640, HEIGHT = 400;
const std::uint64_t GROUND = 1, BOX = 2;

void build(const outcrop::context &context, const char *path, const std::vector<float> &positions,
           const std::vector<std::uint32_t> &indices, float red, float green, float blue) {
    outcrop::build build(context);
    auto material = outcrop::init<oc_material>();
    material.colour[0] = red, material.colour[1] = green, material.colour[2] = blue;
    auto part = outcrop::init<oc_part>();
    part.material = build.add_material(material);
    part.id = 1, part.name = "part";
    build.add_part(part);
    auto triangles = outcrop::init<oc_triangles>();
    triangles.part = 1;
    triangles.positions = positions.data(), triangles.position_count = positions.size() / 3;
    triangles.indices = indices.data(), triangles.index = OC_INDEX_U32, triangles.index_count = indices.size();
    build.add_triangles(triangles);
    build.start(path).wait();
}

// A bowl with bumps, over a square.
void build_ground(const outcrop::context &context, const char *path) {
    std::vector<float> positions;
    std::vector<std::uint32_t> indices;
    for (int i = 0; i <= GRID; i++) {
        for (int k = 0; k <= GRID; k++) {
            const double x = 8.0 * i / GRID - 4, y = 8.0 * k / GRID - 4;
            const double z = 0.05 * (x * x + y * y) + 0.08 * std::sin(3 * x) * std::cos(2.5 * y);
            for (double c : {x, y, z}) positions.push_back(float(c));
            if (i == GRID || k == GRID) continue;
            const std::uint32_t a = std::uint32_t(i * (GRID + 1) + k), b = a + GRID + 1;
            for (std::uint32_t corner : {a, b, b + 1, a, b + 1, a + 1}) indices.push_back(corner);
        }
    }
    build(context, path, positions, indices, 0.45f, 0.5f, 0.4f);
}

void build_box(const outcrop::context &context, const char *path) {
    std::vector<float> positions;
    for (int i = 0; i < 8; i++) {
        for (int axis = 0; axis < 3; axis++) positions.push_back(float(HALF[axis] * (i >> axis & 1 ? 1 : -1)));
    }
    const std::vector<std::uint32_t> indices = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                                                2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
    build(context, path, positions, indices, 0.8f, 0.35f, 0.15f);
}

// A box of mass 1.
struct Body {
    Vec at, velocity, spin;
    std::array<Vec, 3> axes; // of the box, in the world

    Vec inverse_inertia(const Vec &v) const {
        Vec sum = {{0, 0, 0}};
        for (int i = 0; i < 3; i++) {
            const double a = HALF[(i + 1) % 3], b = HALF[(i + 2) % 3];
            sum = sum + axes[i] * (dot(axes[i], v) * 3 / (a * a + b * b));
        }
        return sum;
    }
    Vec velocity_at(const Vec &arm) const { return velocity + cross(spin, arm); }
    double energy() const {
        double sum = 0.5 * dot(velocity, velocity) + GRAVITY * at[2];
        for (int i = 0; i < 3; i++) {
            const double a = HALF[(i + 1) % 3], b = HALF[(i + 2) % 3], along = dot(axes[i], spin);
            sum += 0.5 * along * along * (a * a + b * b) / 3;
        }
        return sum;
    }
    // No point of the box moves faster.
    double speed() const { return length(velocity) + length(spin) * length(HALF); }

    void push(const Vec &arm, const Vec &impulse) {
        velocity = velocity + impulse;
        spin = spin + inverse_inertia(cross(arm, impulse));
    }
    // The change of speed along a direction by an impulse of 1 along it.
    double yields(const Vec &arm, const Vec &dir) const {
        return 1 + dot(dir, cross(inverse_inertia(cross(arm, dir)), arm));
    }
    // Stops or reflects the approach of a point along a normal, with friction.
    void touch(const Vec &arm, const Vec &normal) {
        const double approach = dot(velocity_at(arm), normal);
        if (approach >= 0) return;
        const double bounce = approach < -0.5 ? BOUNCE : 0;
        const double size = -(1 + bounce) * approach / yields(arm, normal);
        push(arm, normal * size);
        const Vec left = velocity_at(arm), slide = left - normal * dot(left, normal);
        if (length(slide) < 1e-9) return;
        const Vec dir = slide * (1 / length(slide));
        push(arm, dir * -std::min(FRICTION * size, length(slide) / yields(arm, dir)));
    }
    void move(double time) {
        at = at + velocity * time;
        const double turn = length(spin) * time;
        if (turn == 0) return;
        const Vec about = spin * (1 / length(spin));
        for (Vec &axis : axes) { // Rodrigues' formula
            axis = axis * std::cos(turn) + cross(about, axis) * std::sin(turn) +
                   about * (dot(about, axis) * (1 - std::cos(turn)));
        }
        // Rounding must not stretch the box.
        axes[0] = axes[0] * (1 / length(axes[0]));
        axes[1] = axes[1] - axes[0] * dot(axes[0], axes[1]);
        axes[1] = axes[1] * (1 / length(axes[1]));
        axes[2] = cross(axes[0], axes[1]);
    }
    std::array<double, 12> transform() const {
        std::array<double, 12> m;
        for (int i = 0; i < 3; i++) {
            for (int axis = 0; axis < 3; axis++) m[std::size_t(3 * i + axis)] = axes[std::size_t(i)][std::size_t(axis)];
        }
        for (int axis = 0; axis < 3; axis++) m[std::size_t(9 + axis)] = at[std::size_t(axis)];
        return m;
    }
};

struct World {
    outcrop::scene scene;
    outcrop::part_set ground, box;
    int queries = 0;

    oc_distance distance(const Body &body) {
        scene.set_transform(BOX, body.transform().data());
        scene.commit();
        auto desc = outcrop::init<oc_distance_desc>();
        desc.first = ground.get(), desc.second = box.get();
        queries++;
        return scene.distance(desc);
    }

    // Moves the body on by one step; returns the least distance on the way.
    double step(Body &body) {
        double left = STEP, least = 1e300;
        body.velocity[2] -= GRAVITY * STEP;
        for (int i = 0; i < 40 && left > 0; i++) {
            const oc_distance now = distance(body);
            least = std::min(least, now.distance);
            const Vec p = {{now.second_point[0], now.second_point[1], now.second_point[2]}};
            const Vec q = {{now.first_point[0], now.first_point[1], now.first_point[2]}};
            if (now.distance < MARGIN && now.distance > 0) {
                const Vec normal = (p - q) * (1 / now.distance);
                body.touch(p - body.at, normal);
                // Away from the surface, so that there is room to move.
                body.at = body.at + normal * (MARGIN - now.distance);
            }
            const double room = std::max(now.distance, MARGIN) - 0.25 * MARGIN;
            const double time = std::min(left, room / std::max(body.speed(), 1e-9));
            body.move(time);
            left -= time;
        }
        return least;
    }
};

void write_picture(const outcrop::context &context, const outcrop::scene &scene, const char *path) {
    auto fit = outcrop::init<oc_fit>();
    fit.width = WIDTH, fit.height = HEIGHT;
    fit.view = OC_VIEW_ALONG;
    fit.direction[0] = 0.35, fit.direction[1] = 1, fit.direction[2] = -0.45;
    fit.up_axis = OC_UP_Z;
    auto desc = outcrop::init<oc_frame_desc>();
    desc.width = WIDTH, desc.height = HEIGHT;
    desc.buffers = 1u << OC_BUFFER_COLOUR_SRGB8;
    outcrop::frame frame(context, desc);
    frame.request(scene, scene.fit(fit));
    frame.wait();
    const outcrop::pixels pixels = frame.map(OC_BUFFER_COLOUR_SRGB8);
    std::vector<unsigned char> all;
    for (std::uint32_t y = 0; y < HEIGHT; y++) {
        all.insert(all.end(), pixels.row<unsigned char>(y), pixels.row<unsigned char>(y) + 4 * WIDTH);
    }
    if (png_write(path, all.data(), WIDTH, HEIGHT, 4 * WIDTH)) throw std::runtime_error("the picture failed");
}

void run(const char *ground_path, const char *box_path, const char *picture) {
    const outcrop::context context(OC_ALL_THREADS);
    build_ground(context, ground_path);
    build_box(context, box_path);
    const outcrop::model ground = context.open(ground_path), box = context.open(box_path);
    World world;
    outcrop::scene shown(context);
    world.scene = outcrop::scene(context);
    world.scene.add_instance(ground, GROUND);
    world.scene.add_instance(box, BOX);
    shown.add_instance(ground, GROUND);
    world.ground.add_instance(GROUND);
    world.box.add_instance(BOX);

    Body body = {{{-1.8, 0.6, 2.5}}, {{1.2, -0.3, 0}}, {{2.0, 3.0, -1.0}}, {{{{1, 0, 0}}, {{0, 1, 0}}, {{0, 0, 1}}}}};
    std::vector<double> milliseconds;
    double least = 1e300, energy = body.energy();
    for (int i = 0; i < STEPS; i++) {
        const auto begin = std::chrono::steady_clock::now();
        least = std::min(least, world.step(body));
        const auto took = std::chrono::steady_clock::now() - begin;
        milliseconds.push_back(std::chrono::duration<double, std::milli>(took).count());
        if (i % SHOWN_EACH == 0 || i + 1 == STEPS) shown.add_instance(box, 100 + std::uint64_t(i), body.transform().data());
    }
    std::sort(milliseconds.begin(), milliseconds.end());
    const double rest = world.distance(body).distance;
    std::printf("%d steps, %d distances, %.3f ms a step in the median, %.3f at most\n", STEPS, world.queries,
                milliseconds[milliseconds.size() / 2], milliseconds.back());
    std::printf("least distance %.5f; at the end %.5f, speed %.4f, energy %.3f of %.3f\n", least, rest, body.speed(),
                body.energy(), energy);
    shown.commit();
    write_picture(context, shown, picture);
    if (!(least > 0)) throw std::runtime_error("the box met the ground");
    if (!(rest < 4 * MARGIN && body.speed() < 0.5)) throw std::runtime_error("the box is not at rest on the ground");
    if (!(body.energy() < energy)) throw std::runtime_error("the box gained energy");
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 4) {
        std::fprintf(stderr, "usage: %s GROUND.oc BOX.oc PICTURE.png\n", argv[0]);
        return 2;
    }
    try {
        run(argv[1], argv[2], argv[3]);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
