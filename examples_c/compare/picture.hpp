// Whole pictures with Embree, from the camera to sRGB bytes, lit by a headlight. Each side renders in its own way.
// Embree traces packets of pixel blocks, tile by tile. Loops that compilers vectorise make the rays and shade the hits.
// All surfaces have the material of the model's first part: meant for models of one part.
#ifndef COMPARE_PICTURE_HPP
#define COMPARE_PICTURE_HPP

#include "embree.hpp"
#include "rays.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <thread>
#include <vector>

// The look of a part in outcrop's default scene: material, ambient light, and background colours.
struct Look {
    float colour[3], metalness, roughness;
    float ambient = 0.15f, bottom[3] = {0.55f, 0.58f, 0.62f}, top[3] = {0.12f, 0.16f, 0.23f};
    explicit Look(const oc_part_info &part) : colour{part.colour[0], part.colour[1], part.colour[2]}, metalness(part.metalness), roughness(part.roughness) {}
};

class EmbreePicture {
  public:
    EmbreePicture(unsigned width, unsigned height, const Look &look)
        : width_(width), height_(height), look_(look), pixels_(4 * std::size_t(width) * height) {
        for (int i = 0; i < STEPS; i++) {
            const double x = double(i) / (STEPS - 1);
            const double coded = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
            levels_[i] = std::uint8_t(coded * 255 + 0.5);
        }
    }

    // RGBA, rows from the top.
    const std::vector<std::uint8_t> &pixels() const { return pixels_; }

    void render(RTCScene scene, const View &view, EmbreeRays::Call call, unsigned threads) {
        switch (call) {
        case EmbreeRays::PACKET4: return tiles<4>(scene, view, threads);
        case EmbreeRays::PACKET8: return tiles<8>(scene, view, threads);
        default: return tiles<16>(scene, view, threads);
        }
    }

  private:
    static const unsigned TILE = 32;
    static const int STEPS = 8192;

    template <int N> void tiles(RTCScene scene, const View &view, unsigned threads) {
        const unsigned columns = (width_ + TILE - 1) / TILE, count = columns * ((height_ + TILE - 1) / TILE);
        std::atomic<unsigned> next(0);
        auto work = [&] {
            flush_denormals();
            Arguments arguments(true);
            for (unsigned i; (i = next.fetch_add(1)) < count;) {
                const unsigned x = i % columns * TILE, y = i / columns * TILE;
                for (unsigned dy = 0; dy < TILE && y + dy < height_; dy += N / 4) {
                    for (unsigned dx = 0; dx < TILE && x + dx < width_; dx += 4) packet<N>(scene, arguments, view, x + dx, y + dy);
                }
            }
        };
        std::vector<std::thread> others;
        for (unsigned i = 1; i < threads; i++) others.emplace_back(work);
        work();
        for (std::thread &t : others) t.join();
    }

    // Renders a block that is four pixels wide. Width and height of the picture are multiples of four.
    template <int N> void packet(RTCScene scene, Arguments &arguments, const View &v, unsigned x, unsigned y) {
        alignas(64) typename Packet<N>::Hit h;
        alignas(64) int valid[N];
        const float org[3] = {float(v.eye.x), float(v.eye.y), float(v.eye.z)};
        const float forward[3] = {float(v.forward.x), float(v.forward.y), float(v.forward.z)};
        const float right[3] = {float(v.right.x), float(v.right.y), float(v.right.z)};
        const float up[3] = {float(v.up.x), float(v.up.y), float(v.up.z)};
        for (int k = 0; k < N; k++) {
            const float across = 2 * (float(x + k % 4) + 0.5f) / float(width_) - 1, along = 1 - 2 * (float(y + k / 4) + 0.5f) / float(height_);
            const float dx = forward[0] + right[0] * across + up[0] * along, dy = forward[1] + right[1] * across + up[1] * along,
                        dz = forward[2] + right[2] * across + up[2] * along;
            const float scale = 1 / std::sqrt(dx * dx + dy * dy + dz * dz);
            h.ray.dir_x[k] = dx * scale, h.ray.dir_y[k] = dy * scale, h.ray.dir_z[k] = dz * scale;
            h.ray.org_x[k] = org[0], h.ray.org_y[k] = org[1], h.ray.org_z[k] = org[2];
            h.ray.tnear[k] = 0, h.ray.tfar[k] = std::numeric_limits<float>::infinity();
            h.ray.mask[k] = ~0u, h.ray.flags[k] = 0;
            h.hit.geomID[k] = h.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
            valid[k] = y + k / 4 < height_ ? -1 : 0;
        }
        Packet<N>::intersect(valid, scene, arguments, &h);
        // Shading in stages, each a loop over the packet, so that compilers vectorise it.
        float cosine[N], power[N], lobe[N], shade[3][N];
        for (int k = 0; k < N; k++) {
            const float nx = h.hit.Ng_x[k], ny = h.hit.Ng_y[k], nz = h.hit.Ng_z[k];
            const float dot = nx * h.ray.dir_x[k] + ny * h.ray.dir_y[k] + nz * h.ray.dir_z[k];
            cosine[k] = std::fabs(dot) / std::sqrt(std::max(nx * nx + ny * ny + nz * nz, 1e-37f));
            power[k] = cosine[k], lobe[k] = 1;
        }
        const float roughness = std::max(look_.roughness, 0.05f), square = roughness * roughness;
        const unsigned exponent = unsigned(2 / (square * square) + 0.5f);
        const float smooth = (1 - look_.roughness) * (1 - look_.roughness) * (float(exponent) + 8) / 8;
        for (unsigned n = exponent; n; n >>= 1) {
            for (int k = 0; k < N; k++) lobe[k] *= n & 1 ? power[k] : 1, power[k] *= power[k];
        }
        for (int c = 0; c < 3; c++) {
            const float own = look_.colour[c], facing = 0.04f + (own - 0.04f) * look_.metalness;
            const float ambient = own * look_.ambient, diffuse = own * (1 - 0.6f * look_.metalness);
            for (int k = 0; k < N; k++) {
                const float lit = ambient + (diffuse + facing * std::min(lobe[k] * smooth, 8.0f)) * cosine[k];
                shade[c][k] = std::min(std::max(0.0f, lit), 1.0f) * (STEPS - 1) + 0.5f;
            }
        }
        for (int row = 0; row < N / 4 && y + row < height_; row++) {
            const float high = 1 - (float(y + row) + 0.5f) / float(height_);
            std::uint8_t behind[3];
            for (int c = 0; c < 3; c++) {
                behind[c] = levels_[int((look_.bottom[c] + (look_.top[c] - look_.bottom[c]) * high) * (STEPS - 1) + 0.5f)];
            }
            for (int k = 4 * row; k < 4 * row + 4; k++) {
                std::uint8_t *to = &pixels_[4 * ((y + row) * std::size_t(width_) + x + k % 4)];
                const bool hit = h.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
                for (int c = 0; c < 3; c++) to[c] = hit ? levels_[int(shade[c][k])] : behind[c];
                to[3] = 255;
            }
        }
    }

    unsigned width_, height_;
    Look look_;
    std::vector<std::uint8_t> pixels_;
    std::uint8_t levels_[STEPS];
};

// Returns the mean difference of red, green and blue of two pictures, in levels of 255.
inline double difference(const std::uint8_t *a, const std::uint8_t *b, std::size_t pixels) {
    double sum = 0;
    for (std::size_t i = 0; i < 4 * pixels; i++) sum += i % 4 == 3 ? 0 : std::abs(int(a[i]) - int(b[i]));
    return sum / (3.0 * double(pixels));
}

#endif
