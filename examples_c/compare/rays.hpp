// The rays that both sides trace: primary rays of a camera, shadow rays to a light, and bounced rays from hits. Origins
// are rounded to single precision, because Embree takes no other: both sides get the same rays.
#ifndef COMPARE_RAYS_HPP
#define COMPARE_RAYS_HPP

#include <outcrop.h>

#include <cmath>
#include <cstdint>
#include <vector>

struct V3 {
    double x, y, z;
};
inline V3 v3(const double *p) { return V3{p[0], p[1], p[2]}; }
inline V3 v3(const float *p) { return V3{p[0], p[1], p[2]}; }
inline V3 operator+(V3 a, V3 b) { return V3{a.x + b.x, a.y + b.y, a.z + b.z}; }
inline V3 operator-(V3 a, V3 b) { return V3{a.x - b.x, a.y - b.y, a.z - b.z}; }
inline V3 operator*(V3 a, double s) { return V3{a.x * s, a.y * s, a.z * s}; }
inline double dot(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline V3 cross(V3 a, V3 b) { return V3{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline double length(V3 a) { return std::sqrt(dot(a, a)); }
inline V3 unit(V3 a) { return a * (1 / length(a)); }
inline double largest(V3 a) { return std::fmax(std::fabs(a.x), std::fmax(std::fabs(a.y), std::fabs(a.z))); }

inline oc_ray make_ray(V3 origin, V3 direction, double t_max) {
    oc_ray ray = oc_ray();
    ray.origin[0] = float(origin.x), ray.origin[1] = float(origin.y), ray.origin[2] = float(origin.z);
    ray.direction[0] = float(direction.x), ray.direction[1] = float(direction.y), ray.direction[2] = float(direction.z);
    ray.t_max = float(t_max);
    return ray;
}

struct View {
    V3 eye, forward, right, up; // right and up: half of the picture's size at distance 1
    V3 light;
};

inline View make_view(const oc_camera &camera, double aspect) {
    View v;
    v.eye = v3(camera.eye);
    const V3 to = v3(camera.at) - v.eye;
    v.forward = unit(to);
    const V3 right = unit(cross(v.forward, v3(camera.up))), up = cross(right, v.forward);
    const double tall = std::tan(camera.fov_y * 3.141592653589793 / 360);
    v.right = right * (tall * aspect);
    v.up = up * tall;
    v.light = v.eye + (up * 0.8 - right * 0.6) * (0.5 * length(to));
    return v;
}

// Returns one ray for each pixel, in blocks of 4 x 4 pixels. Width and height are multiples of 4. `poe`: pixels of
// error, the area in pixels that a stand-in of outcrop may cover.
inline std::vector<oc_ray> primary_rays(const View &v, unsigned width, unsigned height, double poe = 0) {
    const double wide = std::sqrt(poe) * 2 * length(v.up) / height;
    std::vector<oc_ray> rays;
    rays.reserve(std::size_t(width) * height);
    for (unsigned y0 = 0; y0 < height; y0 += 4) {
        for (unsigned x0 = 0; x0 < width; x0 += 4) {
            for (unsigned i = 0; i < 16; i++) {
                const double x = x0 + i % 4 + 0.5, y = y0 + i / 4 + 0.5;
                const V3 d = v.forward + v.right * (2 * x / width - 1) + v.up * (1 - 2 * y / height);
                rays.push_back(make_ray(v.eye, unit(d), 0));
                rays.back().cone_b = float(wide / length(d));
            }
        }
    }
    return rays;
}

// Returns rays from the hits to the light.
inline std::vector<oc_ray> shadow_rays(const View &v, const std::vector<oc_hit> &hits, double step) {
    std::vector<oc_ray> rays;
    for (const oc_hit &hit : hits) {
        if (hit.kind == OC_HIT_MISS) continue;
        const V3 from = v3(hit.position) + v3(hit.normal) * step, to = v.light - from;
        rays.push_back(make_ray(from, unit(to), 0.999 * length(to)));
    }
    return rays;
}

// Returns rays from the hits into the half space in front of the surface, distributed by the cosine.
inline std::vector<oc_ray> bounce_rays(const std::vector<oc_hit> &hits, double step) {
    std::vector<oc_ray> rays;
    std::uint64_t state = 1;
    auto random = [&state] {
        state = state * 6364136223846793005u + 1442695040888963407u;
        return double(state >> 40) / double(1 << 24);
    };
    for (const oc_hit &hit : hits) {
        if (hit.kind == OC_HIT_MISS) continue;
        const V3 n = v3(hit.normal);
        const double z = 2 * random() - 1, a = 6.283185307179586 * random(), r = std::sqrt(1 - z * z);
        const V3 d = n * 1.0001 + V3{r * std::cos(a), r * std::sin(a), z};
        rays.push_back(make_ray(v3(hit.position) + n * step, unit(d), 0));
    }
    return rays;
}

#endif
