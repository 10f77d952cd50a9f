// Compares the hits of outcrop and Embree one by one. Where they differ, brute force in long double over the triangles of
// the mesh decides which side is wrong: neither counts as right from the start.
//
// An answer is right if it is a true hit with no certain hit before it, or a miss without a certain hit. An answer that is
// not right may be off by the rounding of single precision: the ray passes within it of an edge of the triangle that was
// hit or missed. Any other answer is wrong.
#ifndef COMPARE_AGREEMENT_HPP
#define COMPARE_AGREEMENT_HPP

#include "mesh.hpp"
#include "rays.hpp"
#include "truth.hpp"

#include <cstdio>
#include <limits>

struct Answer {
    bool hit;
    double t;
    std::uint64_t prim;
};

enum class Verdict { RIGHT, ROUNDING, WRONG };

class Agreement {
  public:
    explicit Agreement(const Mesh &mesh) : mesh_(mesh), truth_(mesh) {
        for (float p : mesh.positions) extent_ = std::fmax(extent_, std::fabs(p));
    }

    void compare(const oc_ray &ray, const Answer &ours, const Answer &theirs) {
        rays_++;
        if (!ours.hit && !theirs.hit) return;
        if (ours.hit && theirs.hit && std::fabs(ours.t - theirs.t) <= slack(ray, ours) + slack(ray, theirs)) {
            ties_ += ours.prim != theirs.prim;
            return;
        }
        decide(ray, ours, theirs, true);
    }

    // For a shadow ray whose shadows differ: `hit` says if the ray is blocked, and `t` and `prim` are those of the closest
    // hit of the same ray, if there is one.
    void compare_shadow(const oc_ray &ray, const Answer &ours, const Answer &theirs) {
        rays_++;
        decide(ray, ours, theirs, false);
    }
    void same_shadows(std::uint64_t count) { rays_ += count; }

    // Returns the verdict on an answer. `by_distance`: a hit must be the closest; otherwise any hit will do.
    Verdict judge(const oc_ray &ray, const Answer &a, bool by_distance) const { return judge(ray, a, by_distance, truth_.hits(ray)); }

    // Number of answers of outcrop that are off by more than rounding.
    std::uint64_t wrong() const { return count_[2][0] + count_[2][1] + count_[2][2]; }

    void print() const {
        const auto n = [this](int ours, int theirs) { return (unsigned long long)count_[ours][theirs]; };
        std::printf("agreement: %llu rays, %llu ties (another triangle at the same distance), %llu that differ\n", (unsigned long long)rays_,
                    (unsigned long long)ties_, (unsigned long long)differ_);
        std::printf("  decided in long double     Embree right   by rounding         WRONG\n");
        const char *const rows[] = {"outcrop right", "outcrop by rounding", "outcrop WRONG"};
        for (int i = 0; i < 3; i++) std::printf("  %-22s %16llu %13llu %13llu\n", rows[i], n(i, 0), n(i, 1), n(i, 2));
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

    // Error bound of a distance in single precision.
    double slack(const oc_ray &ray, const Answer &a) const {
        return rounding(ray) / std::fmax(look(ray, a.prim).cosine, 1e-12) + 1e-6 * a.t;
    }

    bool hangs_by_a_hair(const oc_ray &ray, std::uint64_t prim) const {
        if (prim >= mesh_.triangles()) return false;
        const Look l = look(ray, prim);
        if (l.cosine < 1e-6) return true; // the ray lies in the triangle's plane
        const double hair = rounding(ray) * (1 + 1 / l.cosine);
        const double t_max = ray.t_max == 0 ? std::numeric_limits<double>::infinity() : ray.t_max;
        return std::fabs(l.inside) <= hair || std::fabs(l.t - ray.t_min) <= hair || std::fabs(l.t - t_max) <= hair;
    }

    Verdict judge(const oc_ray &ray, const Answer &a, bool by_distance, const std::vector<TrueHit> &hits) const {
        const TrueHit *certain = nullptr;
        for (std::size_t i = 0; i < hits.size() && !certain; i++) certain = hits[i].touches ? nullptr : &hits[i];
        if (!a.hit) {
            if (!certain) return Verdict::RIGHT;
            // It missed all certain hits.
            for (const TrueHit &hit : hits) {
                if (!hit.touches && !hangs_by_a_hair(ray, hit.prim)) return Verdict::WRONG;
            }
            return Verdict::ROUNDING;
        }
        if (!by_distance && !hits.empty()) return Verdict::RIGHT;
        bool is_true = false, missed = false, missed_by_a_hair = true;
        for (const TrueHit &hit : hits) {
            const double off = slack(ray, Answer{true, hit.t, hit.prim});
            is_true = is_true || std::fabs(hit.t - a.t) <= off;
            if (hit.touches || hit.t >= a.t - off) continue;
            missed = true;
            missed_by_a_hair = missed_by_a_hair && hangs_by_a_hair(ray, hit.prim);
        }
        if (is_true && !missed) return Verdict::RIGHT;
        const bool excused = (is_true || hangs_by_a_hair(ray, a.prim)) && missed_by_a_hair;
        return excused ? Verdict::ROUNDING : Verdict::WRONG;
    }

    void decide(const oc_ray &ray, const Answer &ours, const Answer &theirs, bool by_distance) {
        differ_++;
        const std::vector<TrueHit> hits = truth_.hits(ray);
        const Verdict of_ours = judge(ray, ours, by_distance, hits), of_theirs = judge(ray, theirs, by_distance, hits);
        count_[int(of_ours)][int(of_theirs)]++;
        if (of_ours == Verdict::WRONG || of_theirs == Verdict::WRONG) show(ray, ours, theirs, hits, of_ours, of_theirs);
    }

    void show(const oc_ray &ray, const Answer &ours, const Answer &theirs, const std::vector<TrueHit> &hits, Verdict of_ours, Verdict of_theirs) {
        std::uint64_t &shown = of_ours == Verdict::WRONG ? shown_ours_ : shown_theirs_;
        if (shown++ >= 5) return;
        std::printf("%s WRONG: from (%.9g, %.9g, %.9g) along (%.9g, %.9g, %.9g), rounding %.3g\n",
                    of_ours == Verdict::WRONG ? of_theirs == Verdict::WRONG ? "both" : "outcrop" : "Embree", ray.origin[0], ray.origin[1], ray.origin[2],
                    double(ray.direction[0]), double(ray.direction[1]), double(ray.direction[2]), rounding(ray));
        auto say = [&](const char *who, const Answer &a) {
            if (!a.hit || a.prim >= mesh_.triangles()) return std::printf("    %s: %s\n", who, a.hit ? "something" : "nothing");
            const Look l = look(ray, a.prim);
            return std::printf("    %s: t %.9g, triangle %llu, whose plane is at t %.12g; %.3g inside its edges, cosine %.3g\n", who, a.t,
                               (unsigned long long)a.prim, l.t, l.inside, l.cosine);
        };
        say("outcrop", ours);
        say("Embree", theirs);
        if (hits.empty()) {
            std::printf("    in long double: nothing\n");
        } else {
            std::printf("    in long double: t %.12g, triangle %llu%s\n", hits[0].t, (unsigned long long)hits[0].prim, hits[0].touches ? ", at an edge" : "");
        }
    }

    const Mesh &mesh_;
    const Truth truth_;
    double extent_ = 0;
    std::uint64_t rays_ = 0, ties_ = 0, differ_ = 0, shown_ours_ = 0, shown_theirs_ = 0;
    std::uint64_t count_[3][3] = {}; // by the verdicts on outcrop and on Embree
};

#endif
