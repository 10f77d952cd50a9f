// Compares the hits of outcrop and Embree one by one. Every disagreement is examined again in double precision. It is
// explained if the difference is below the rounding error of single precision: two surfaces at the same distance (a
// tie), or a ray through an edge or along a triangle (grazing). Any other disagreement is a defect.
#ifndef COMPARE_AGREEMENT_HPP
#define COMPARE_AGREEMENT_HPP

#include "mesh.hpp"
#include "rays.hpp"

#include <cstdio>
#include <limits>

struct Answer {
    bool hit;
    double t;
    std::uint64_t prim;
};

class Agreement {
  public:
    explicit Agreement(const Mesh &mesh) : mesh_(mesh) {
        for (float p : mesh.positions) extent_ = std::fmax(extent_, std::fabs(p));
    }

    void compare(const oc_ray &ray, const Answer &ours, const Answer &theirs) {
        rays_++;
        if (!ours.hit && !theirs.hit) return;
        if (ours.hit && theirs.hit) {
            const double apart = std::fabs(ours.t - theirs.t);
            if (apart <= slack(ray, ours) + slack(ray, theirs)) {
                ties_ += ours.prim != theirs.prim;
                return;
            }
        }
        // The nearer hit is one that the other side does not have.
        const bool we_hit = ours.hit && (!theirs.hit || ours.t < theirs.t);
        if (ours.hit && theirs.hit && ours.prim == theirs.prim) return unexplained(ray, ours, theirs, "distances differ");
        if (hangs_by_a_hair(ray, we_hit ? ours : theirs)) {
            grazing_++;
        } else {
            unexplained(ray, ours, theirs, we_hit ? "only outcrop hits" : "only Embree hits");
        }
    }

    // For a shadow ray whose shadows differ: `ours` and `theirs` are the closest hits of the same ray.
    void compare_shadow(const oc_ray &ray, const Answer &ours, const Answer &theirs) {
        const Answer &found = ours.hit ? ours : theirs;
        if (found.hit && hangs_by_a_hair(ray, found)) {
            rays_++;
            grazing_++;
        } else {
            rays_++;
            unexplained(ray, ours, theirs, "shadows differ");
        }
    }
    void same_shadows(std::uint64_t count) { rays_ += count; }

    std::uint64_t unexplained() const { return unexplained_; }
    void print() const {
        std::printf("agreement: %llu rays, %llu ties, %llu grazing, %llu UNEXPLAINED\n", (unsigned long long)rays_,
                    (unsigned long long)ties_, (unsigned long long)grazing_, (unsigned long long)unexplained_);
    }

  private:
    struct Look {
        double t;      // distance of the triangle's plane
        double inside; // distance of the hit point to the nearest edge, negative outside
        double cosine; // between the ray and the plane's normal
    };

    V3 corner(std::uint64_t prim, int k) const { return v3(&mesh_.positions[3 * std::size_t(mesh_.indices[3 * prim + k])]); }

    Look look(const oc_ray &ray, std::uint64_t prim) const {
        const V3 v[3] = {corner(prim, 0), corner(prim, 1), corner(prim, 2)};
        const V3 o = v3(ray.origin), d = v3(ray.direction), normal = cross(v[1] - v[0], v[2] - v[0]);
        if (!(length(normal) > 0)) return Look{0, 0, 0};
        const V3 n = unit(normal);
        const double along = dot(n, d), t = dot(n, v[0] - o) / along;
        double inside = std::numeric_limits<double>::infinity();
        for (int k = 0; k < 3; k++) {
            const V3 edge = v[(k + 1) % 3] - v[k];
            inside = std::fmin(inside, dot(cross(n, unit(edge)), o + d * t - v[k]));
        }
        return Look{t, inside, std::fabs(along) / length(d)};
    }

    // Rounding error of single precision in world units: a few roundings of the largest coordinate.
    double rounding(const oc_ray &ray) const { return 16 * 5.96e-8 * std::fmax(extent_, largest(v3(ray.origin))); }

    // Error bound of a distance.
    double slack(const oc_ray &ray, const Answer &a) const {
        const Look l = look(ray, a.prim);
        return rounding(ray) / std::fmax(l.cosine, 1e-12) + 1e-6 * a.t;
    }

    bool hangs_by_a_hair(const oc_ray &ray, const Answer &a) const {
        const Look l = look(ray, a.prim);
        if (l.cosine < 1e-6) return true; // the ray lies in the triangle's plane
        const double hair = rounding(ray) * (1 + 1 / l.cosine);
        const double t_max = ray.t_max == 0 ? std::numeric_limits<double>::infinity() : ray.t_max;
        return std::fabs(l.inside) <= hair || std::fabs(l.t - ray.t_min) <= hair || std::fabs(l.t - t_max) <= hair;
    }

    void unexplained(const oc_ray &ray, const Answer &ours, const Answer &theirs, const char *what) {
        if (unexplained_++ >= 10) return;
        auto say = [&](const char *who, const Answer &a) {
            if (!a.hit) return std::printf("    %s: nothing\n", who);
            const Look l = look(ray, a.prim);
            return std::printf("    %s: t %.9g, triangle %llu; in double precision t %.12g, %.3g inside its edges, cosine %.3g\n",
                               who, a.t, (unsigned long long)a.prim, l.t, l.inside, l.cosine);
        };
        std::printf("UNEXPLAINED (%s): from (%.9g, %.9g, %.9g) along (%.9g, %.9g, %.9g), rounding %.3g\n", what, ray.origin[0],
                    ray.origin[1], ray.origin[2], double(ray.direction[0]), double(ray.direction[1]),
                    double(ray.direction[2]), rounding(ray));
        say("outcrop", ours);
        say("Embree", theirs);
    }

    const Mesh &mesh_;
    double extent_ = 0;
    std::uint64_t rays_ = 0, ties_ = 0, grazing_ = 0, unexplained_ = 0;
};

#endif
