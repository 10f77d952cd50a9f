// The true hits of a ray: every triangle of the mesh is tested in long double, in the order of the file. Boxes around
// runs of triangles only spare tests of triangles far from the ray.
#ifndef COMPARE_TRUTH_HPP
#define COMPARE_TRUTH_HPP

#include "mesh.hpp"
#include "rays.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

// A true hit. `touches`: the ray meets the border of the surface, or the end of its own interval, within the rounding of
// long double; then a miss is as right as a hit. An edge or a corner inside of a surface is no border.
struct TrueHit {
    double t;
    std::uint64_t prim;
    bool touches;
};

class Truth {
  public:
    explicit Truth(const Mesh &mesh) : mesh_(mesh) {
        for (std::size_t first = 0; first < mesh.triangles(); first += RUN) {
            Box box;
            for (std::size_t i = 3 * first; i < 3 * std::min(first + RUN, mesh.triangles()); i++) box.add(v3(&mesh.positions[3 * std::size_t(mesh.indices[i])]));
            boxes_.push_back(box);
            for (int k = 0; k < 3; k++) extent_ = std::fmax(extent_, std::fmax(std::fabs(box.low[k]), std::fabs(box.high[k])));
        }
    }

    // Returns all hits of the ray, the nearest first.
    std::vector<TrueHit> hits(const oc_ray &ray) const {
        std::vector<TrueHit> hits = hits_beside(ray, V3{0, 0, 0});
        if (std::none_of(hits.begin(), hits.end(), [](const TrueHit &hit) { return hit.touches; })) return hits;
        // An edge inside of a surface: rays a little beside it, on all sides, hit at the same distance.
        const V3 d = unit(v3(ray.direction)), other = std::fabs(d.x) < 0.6 ? V3{1, 0, 0} : V3{0, 1, 0}, u = unit(cross(d, other)), w = cross(d, u);
        std::vector<std::vector<TrueHit>> around;
        for (int i = 0; i < 8; i++) {
            const double angle = 0.3 + 0.7853981633974483 * i, size = 1e-13 * (largest(v3(ray.origin)) + extent_);
            around.push_back(hits_beside(ray, u * (size * std::cos(angle)) + w * (size * std::sin(angle))));
        }
        for (TrueHit &hit : hits) {
            const auto is_near = [&hit](const TrueHit &a) { return std::fabs(a.t - hit.t) <= 1e-9 * std::fabs(hit.t) && !a.touches; };
            const auto has_it = [&is_near](const std::vector<TrueHit> &list) { return std::any_of(list.begin(), list.end(), is_near); };
            if (hit.touches) hit.touches = !std::all_of(around.begin(), around.end(), has_it);
        }
        return hits;
    }

  private:
    typedef long double Real;

    // Returns all hits of a ray that is moved by `beside`, the nearest first.
    std::vector<TrueHit> hits_beside(const oc_ray &ray, V3 beside) const {
        std::vector<TrueHit> hits;
        for (std::size_t run = 0; run < boxes_.size(); run++) {
            if (!boxes_[run].may_meet(ray)) continue;
            for (std::size_t i = run * RUN; i < std::min((run + 1) * RUN, mesh_.triangles()); i++) test(ray, beside, i, hits);
        }
        std::sort(hits.begin(), hits.end(), [](const TrueHit &a, const TrueHit &b) { return a.t < b.t; });
        return hits;
    }

    static const std::size_t RUN = 64;

    struct Box {
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        void add(V3 v) {
            const double p[3] = {v.x, v.y, v.z};
            for (int k = 0; k < 3; k++) low[k] = std::fmin(low[k], p[k]), high[k] = std::fmax(high[k], p[k]);
        }
        // The box is enlarged by far more than the rounding of this test.
        bool may_meet(const oc_ray &ray) const {
            double size = 0, near = 0, far = INFINITY;
            for (int k = 0; k < 3; k++) size = std::fmax(size, std::fmax(std::fabs(low[k]), std::fabs(high[k]))), size = std::fmax(size, std::fabs(ray.origin[k]));
            const double more = 1e-9 * size;
            for (int k = 0; k < 3; k++) {
                const double a = low[k] - more - ray.origin[k], b = high[k] + more - ray.origin[k], d = ray.direction[k];
                if (d == 0) {
                    if (a > 0 || b < 0) return false;
                    continue;
                }
                near = std::fmax(near, std::fmin(a / d, b / d)), far = std::fmin(far, std::fmax(a / d, b / d));
            }
            return near <= far * (1 + 1e-9);
        }
    };

    // The signs of the volumes that the ray spans with the three edges say if it passes inside. Vertices, origins and
    // directions have single precision: each volume is off by a few roundings of long double at most.
    void test(const oc_ray &ray, V3 beside, std::size_t prim, std::vector<TrueHit> &hits) const {
        Real v[3][3], d[3];
        const double more[3] = {beside.x, beside.y, beside.z};
        for (int k = 0; k < 3; k++) {
            const float *p = &mesh_.positions[3 * std::size_t(mesh_.indices[3 * prim + k])];
            for (int axis = 0; axis < 3; axis++) v[k][axis] = Real(p[axis]) - Real(ray.origin[axis]) - Real(more[axis]);
        }
        for (int axis = 0; axis < 3; axis++) d[axis] = Real(ray.direction[axis]);
        Real volume[3], sum = 0;
        bool is_above = false, is_below = false, touches = false;
        for (int k = 0; k < 3; k++) {
            const Real *a = v[(k + 1) % 3], *b = v[(k + 2) % 3];
            Real size = 0;
            volume[k] = 0;
            for (int axis = 0; axis < 3; axis++) {
                const int y = (axis + 1) % 3, z = (axis + 2) % 3;
                volume[k] += d[axis] * (a[y] * b[z] - a[z] * b[y]);
                size += std::fabs(d[axis]) * (std::fabs(a[y] * b[z]) + std::fabs(a[z] * b[y]));
            }
            const Real rounding = size * 8 * std::numeric_limits<Real>::epsilon();
            if (std::fabs(volume[k]) <= rounding) touches = true;
            else (volume[k] > 0 ? is_above : is_below) = true;
            sum += volume[k];
        }
        // Both signs: outside. None or a sum of 0: the ray lies in the plane of the triangle, which it does not cross.
        if (is_above == is_below || sum == 0) return;
        Real t = 0;
        const Real length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        for (int axis = 0; axis < 3; axis++) {
            const Real at = (volume[0] * v[0][axis] + volume[1] * v[1][axis] + volume[2] * v[2][axis]) / sum;
            t += at * d[axis] / (length * length);
        }
        const Real t_max = ray.t_max == 0 ? Real(INFINITY) : Real(ray.t_max), end = std::fabs(t) * 64 * std::numeric_limits<Real>::epsilon();
        if (t < Real(ray.t_min) - end || t > t_max + end) return;
        touches = touches || t < Real(ray.t_min) + end || t > t_max - end;
        hits.push_back(TrueHit{double(t), prim, touches});
    }

    const Mesh &mesh_;
    std::vector<Box> boxes_;
    double extent_ = 0;
};

#endif
