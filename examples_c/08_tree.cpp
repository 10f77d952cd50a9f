// A ray caster over the tree of a model that a program walks by itself, and a check of its hits against those of
// oc_scene_closest.
//
//     08_tree MODEL.oc [WIDTH HEIGHT]
#include <outcrop.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>

namespace {

const double INF = std::numeric_limits<double>::infinity();

struct vec {
    double x, y, z;
};
vec operator-(vec a, vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
double dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
vec cross(vec a, vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
vec at(const double *p) { return {p[0], p[1], p[2]}; }

struct hit {
    double t = INF;
    std::uint64_t prim = OC_NO_ID;
    std::uint32_t part = OC_NO_INDEX; // index in the model
};

struct ray {
    vec origin, direction;
};

// The ray in the coordinates of a tree. The distances along it stay the same.
ray in_tree(const ray &r, const double *m) {
    const vec x = at(m), y = at(m + 3), z = at(m + 6), from = r.origin - at(m + 9);
    const vec yz = cross(y, z), zx = cross(z, x), xy = cross(x, y);
    const double det = dot(x, yz);
    const auto turned = [&](vec v) { return vec{dot(yz, v) / det, dot(zx, v) / det, dot(xy, v) / det}; };
    return {turned(from), turned(r.direction)};
}

// Where the ray enters a box: infinity if it misses the box or enters it behind `end`.
double enters(const ray &r, const double *box, double end) {
    const double origin[] = {r.origin.x, r.origin.y, r.origin.z};
    const double direction[] = {r.direction.x, r.direction.y, r.direction.z};
    double first = 0, last = end;
    for (int axis = 0; axis < 3; axis++) {
        if (direction[axis] == 0) {
            if (origin[axis] < box[axis] || origin[axis] > box[axis + 3]) return INF;
            continue;
        }
        double a = (box[axis] - origin[axis]) / direction[axis], b = (box[axis + 3] - origin[axis]) / direction[axis];
        if (a > b) std::swap(a, b);
        // The quotients are rounded: the box must not become smaller.
        first = std::max(first, a - 4e-16 * std::fabs(a)), last = std::min(last, b + 4e-16 * std::fabs(b));
    }
    return first <= last ? first : INF;
}

// Distance of a triangle along the ray; infinity if the ray misses it.
double meets(const ray &r, const double *corners) {
    const vec a = at(corners), ab = at(corners + 3) - a, ac = at(corners + 6) - a, from = r.origin - a;
    const vec p = cross(r.direction, ac), q = cross(from, ab);
    const double det = dot(ab, p);
    if (det == 0) return INF;
    const double u = dot(from, p) / det, v = dot(r.direction, q) / det, t = dot(ac, q) / det;
    // A ray through a common edge must not slip between two triangles.
    const double give = 1e-9;
    return u >= -give && v >= -give && u + v <= 1 + give && t >= 0 ? t : INF;
}

struct entry {
    std::uint64_t node;
    double t;
    bool is_leaf;
};

// Traces rays through all trees of a model with a cursor.
class caster {
  public:
    explicit caster(const outcrop::model &model) : cursor_(model.cursor()), places_(cursor_.places()) {}

    hit closest(const ray &world) {
        hit best;
        for (const oc_tree_place &place : places_) walk(in_tree(world, place.model_from_tree), place, best);
        return best;
    }
    std::uint64_t nodes = 0;

  private:
    void walk(const ray &r, const oc_tree_place &place, hit &best) {
        stack_.assign(1, {place.root, 0, false});
        while (!stack_.empty()) {
            const entry next = stack_.back();
            stack_.pop_back();
            if (next.t > best.t) continue;
            nodes++;
            if (next.is_leaf) {
                leaf(r, place, next.node, best);
                continue;
            }
            cursor_.node(next.node, node_);
            if (node_.child_count == 0) leaf(r, place, next.node, best);
            const std::size_t bottom = stack_.size();
            for (std::uint32_t i = 0; i < node_.child_count; i++) {
                const double t = enters(r, node_.child_bounds + 6 * i, best.t);
                if (t < INF) stack_.push_back({node_.children[i], t, (node_.leaf_children >> i & 1) != 0});
            }
            // The nearest child is on top.
            std::sort(stack_.begin() + static_cast<std::ptrdiff_t>(bottom), stack_.end(),
                      [](const entry &a, const entry &b) { return a.t > b.t; });
        }
    }
    void leaf(const ray &r, const oc_tree_place &place, std::uint64_t node, hit &best) {
        cursor_.triangles(node, triangles_);
        for (const oc_node_triangle &triangle : triangles_) {
            const double t = meets(r, triangle.corners);
            if (t < best.t || (t == best.t && t < INF && triangle.prim < best.prim)) {
                best.t = t, best.prim = triangle.prim, best.part = place.first_part + triangle.part;
            }
        }
    }

    outcrop::cursor cursor_;
    std::vector<oc_tree_place> places_;
    std::vector<entry> stack_;
    std::vector<oc_node_triangle> triangles_;
    oc_node node_ = outcrop::init<oc_node>();
};

} // namespace

int main(int argc, char **argv) try {
    if (argc != 2 && argc != 4) {
        std::fprintf(stderr, "usage: %s MODEL.oc [WIDTH HEIGHT]\n", argv[0]);
        return 2;
    }
    const int width = argc == 4 ? std::atoi(argv[2]) : 128, height = argc == 4 ? std::atoi(argv[3]) : 96;
    outcrop::context context(OC_ALL_THREADS);
    outcrop::job job = context.load(argv[1]);
    job.wait();
    outcrop::model model = job.model();
    outcrop::scene scene(context);
    scene.add_instance(model, 1);
    scene.commit();

    std::vector<oc_ray> rays;
    for (std::uint32_t number = 0; number < 4; number++) {
        const oc_camera view = model.view(number);
        for (int y = 0; y < height; y++) {
            for (int x = 0; x < width; x++) {
                oc_ray ray = outcrop::camera_ray(view, static_cast<std::uint32_t>(width),
                                                 static_cast<std::uint32_t>(height), x + 0.5, y + 0.5);
                ray.cone_a = ray.cone_b = 0; // exact
                rays.push_back(ray);
            }
        }
    }
    const std::vector<oc_hit> expected = scene.closest(rays);

    caster own(model);
    unsigned long long hits = 0, ties = 0, differ = 0;
    std::vector<hit> found;
    const auto begin = std::chrono::steady_clock::now();
    for (const oc_ray &r : rays)
        found.push_back(own.closest({at(r.origin), {r.direction[0], r.direction[1], r.direction[2]}}));
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    for (std::size_t i = 0; i < rays.size(); i++) {
        const bool is_hit = expected[i].kind != OC_HIT_MISS;
        hits += is_hit;
        const double length = std::sqrt(dot(at(rays[i].origin), at(rays[i].origin))) + expected[i].t;
        const bool is_near = is_hit && std::fabs(found[i].t - expected[i].t) <= expected[i].error + 1e-6 * length;
        const bool is_same = is_hit && found[i].prim == expected[i].prim &&
                             model.part(found[i].part).id == expected[i].part;
        // Where two triangles meet, or lie in one another, rounding may decide for the other one at the same distance.
        ties += is_near && !is_same;
        differ += is_hit ? !is_near : found[i].prim != OC_NO_ID;
    }
    std::printf("%llu rays, %llu hits, %llu at the same place on another triangle, %llu differ; %.2f million rays/s, "
                "%.1f million nodes/s\n",
                static_cast<unsigned long long>(rays.size()), hits, ties, differ,
                static_cast<double>(rays.size()) / seconds / 1e6, static_cast<double>(own.nodes) / seconds / 1e6);
    // Rays that graze an edge may go either way.
    return hits > 0 && ties * 50 <= hits && differ * 1000 <= rays.size() ? 0 : 1;
} catch (const outcrop::error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
