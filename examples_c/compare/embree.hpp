// Embree's side: scenes, and calls for single rays, packets and streams, with any number of threads.
#ifndef COMPARE_EMBREE_HPP
#define COMPARE_EMBREE_HPP

#if EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
#include <pmmintrin.h>
#include <xmmintrin.h>

#include "mesh.hpp"

#include <outcrop.h>

#include <atomic>
#include <cstddef>
#include <limits>
#include <memory>
#include <thread>
#include <vector>

// Flushes denormals to zero, as outcrop does.
inline void flush_denormals() {
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
}

class EmbreeScene {
  public:
    EmbreeScene(const Mesh &mesh, RTCBuildQuality quality, RTCSceneFlags flags) {
        device_ = rtcNewDevice("threads=2");
        if (!device_) throw std::runtime_error("Embree does not start");
        rtcSetDeviceMemoryMonitorFunction(
            device_,
            [](void *self, ssize_t bytes, bool) {
                static_cast<EmbreeScene *>(self)->bytes_ += bytes;
                return true;
            },
            this);
        scene_ = rtcNewScene(device_);
        rtcSetSceneBuildQuality(scene_, quality);
        rtcSetSceneFlags(scene_, flags);
        RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, mesh.positions.data(), 0, 12,
                                   mesh.positions.size() / 3);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.indices.data(), 0, 12,
                                   mesh.triangles());
        rtcSetGeometryBuildQuality(geometry, quality);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene_, geometry);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene_);
        if (rtcGetDeviceError(device_) != RTC_ERROR_NONE) throw std::runtime_error("Embree cannot build the scene");
    }
    ~EmbreeScene() {
        rtcReleaseScene(scene_);
        rtcReleaseDevice(device_);
    }
    EmbreeScene(const EmbreeScene &) = delete;
    EmbreeScene &operator=(const EmbreeScene &) = delete;

    RTCScene get() const { return scene_; }
    // Bytes of the acceleration structure, without the caller's vertices and indices.
    std::ptrdiff_t bytes() const { return bytes_; }

  private:
    std::atomic<std::ptrdiff_t> bytes_{0};
    RTCDevice device_;
    RTCScene scene_;
};

// Arguments of a call, for Embree 4 and Embree 3.
#if EMBREE_MAJOR >= 4
struct Arguments {
    RTCIntersectArguments intersect;
    RTCOccludedArguments occluded;
    explicit Arguments(bool coherent) {
        rtcInitIntersectArguments(&intersect);
        rtcInitOccludedArguments(&occluded);
        const RTCRayQueryFlags flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
        intersect.flags = occluded.flags = flags;
    }
};
#define COMPARE_CALL(N)                                                                                           \
    static void intersect(const int *v, RTCScene s, Arguments &a, RTCRayHit##N *r) { rtcIntersect##N(v, s, r, &a.intersect); } \
    static void occluded(const int *v, RTCScene s, Arguments &a, RTCRay##N *r) { rtcOccluded##N(v, s, r, &a.occluded); }
inline void intersect_one(RTCScene s, Arguments &a, RTCRayHit *r) { rtcIntersect1(s, r, &a.intersect); }
inline void occluded_one(RTCScene s, Arguments &a, RTCRay *r) { rtcOccluded1(s, r, &a.occluded); }
#else
struct Arguments {
    RTCIntersectContext context;
    explicit Arguments(bool coherent) {
        rtcInitIntersectContext(&context);
        context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    }
};
#define COMPARE_CALL(N)                                                                                           \
    static void intersect(const int *v, RTCScene s, Arguments &a, RTCRayHit##N *r) { rtcIntersect##N(v, s, &a.context, r); } \
    static void occluded(const int *v, RTCScene s, Arguments &a, RTCRay##N *r) { rtcOccluded##N(v, s, &a.context, r); }
inline void intersect_one(RTCScene s, Arguments &a, RTCRayHit *r) { rtcIntersect1(s, &a.context, r); }
inline void occluded_one(RTCScene s, Arguments &a, RTCRay *r) { rtcOccluded1(s, &a.context, r); }
#endif

template <int N> struct Packet;
#define COMPARE_PACKET(N)               \
    template <> struct Packet<N> {      \
        using Hit = RTCRayHit##N;       \
        using Ray = RTCRay##N;          \
        COMPARE_CALL(N)                 \
    };
COMPARE_PACKET(4)
COMPARE_PACKET(8)
COMPARE_PACKET(16)

inline RTCRay embree_ray(const oc_ray &ray) {
    RTCRay r = RTCRay();
    r.org_x = float(ray.origin[0]), r.org_y = float(ray.origin[1]), r.org_z = float(ray.origin[2]);
    r.dir_x = ray.direction[0], r.dir_y = ray.direction[1], r.dir_z = ray.direction[2];
    r.tnear = float(ray.t_min);
    r.tfar = ray.t_max == 0 ? std::numeric_limits<float>::infinity() : float(ray.t_max);
    r.mask = ~0u;
    return r;
}

// Rays in the layouts that Embree's calls take. They are converted before each run; only the run is timed.
class EmbreeRays {
  public:
    enum Call { SINGLE, PACKET4, PACKET8, PACKET16, STREAM };
    static const char *name(Call call) {
        static const char *const names[] = {"1", "4", "8", "16", "1M"};
        return names[call];
    }
    static std::vector<Call> calls() {
        std::vector<Call> all = {SINGLE, PACKET4, PACKET8, PACKET16};
#if EMBREE_MAJOR < 4
        all.push_back(STREAM);
#endif
        return all;
    }

    void prepare(const std::vector<oc_ray> &rays, Call call, bool any) {
        count_ = rays.size(), call_ = call, any_ = any;
        switch (call) {
        case PACKET4: return pack<4>(rays, packets4_, shadows4_);
        case PACKET8: return pack<8>(rays, packets8_, shadows8_);
        case PACKET16: return pack<16>(rays, packets16_, shadows16_);
        default: break;
        }
        hits_.clear();
        shadows_.clear();
        for (const oc_ray &ray : rays) {
            if (any) {
                shadows_.push_back(embree_ray(ray));
            } else {
                RTCRayHit hit = RTCRayHit();
                hit.ray = embree_ray(ray);
                hit.hit.geomID = hit.hit.primID = RTC_INVALID_GEOMETRY_ID;
                hits_.push_back(hit);
            }
        }
    }

    // Traces and shades all rays. Returns the sum of the shades; the shade of a shadow ray is 1 if it is blocked.
    double run(RTCScene scene, bool coherent, unsigned threads) {
        const std::size_t chunk = 4096;
        std::atomic<std::size_t> next(0);
        std::vector<double> sums(threads, 0.0);
        auto work = [&](unsigned me) {
            flush_denormals();
            Arguments arguments(coherent);
            for (std::size_t first; (first = next.fetch_add(chunk)) < count_;) {
                const std::size_t end = first + chunk < count_ ? first + chunk : count_;
                sums[me] += span(scene, arguments, first, end);
            }
        };
        std::vector<std::thread> others;
        for (unsigned i = 1; i < threads; i++) others.emplace_back(work, i);
        work(0);
        double sum = 0;
        for (std::thread &t : others) t.join();
        for (double s : sums) sum += s;
        return sum;
    }

    // The results, after a run of single rays.
    const std::vector<RTCRayHit> &hits() const { return hits_; }
    const std::vector<RTCRay> &shadows() const { return shadows_; }

  private:
    static double shade(float nx, float ny, float nz, float dx, float dy, float dz) {
        const float length = std::sqrt(nx * nx + ny * ny + nz * nz);
        return length > 0 ? std::fabs(nx * dx + ny * dy + nz * dz) / length : 0;
    }
    // Embree marks a blocked ray with tfar = -infinity.
    static bool blocked(float tfar) { return tfar < 0; }

    double span(RTCScene scene, Arguments &a, std::size_t first, std::size_t end) {
        switch (call_) {
        case PACKET4: return packet_span<4>(scene, a, first, end, packets4_, shadows4_);
        case PACKET8: return packet_span<8>(scene, a, first, end, packets8_, shadows8_);
        case PACKET16: return packet_span<16>(scene, a, first, end, packets16_, shadows16_);
        default: break;
        }
        double sum = 0;
        if (any_) {
#if EMBREE_MAJOR < 4
            if (call_ == STREAM) rtcOccluded1M(scene, &a.context, &shadows_[first], unsigned(end - first), sizeof(RTCRay));
#endif
            for (std::size_t i = first; i < end; i++) {
                if (call_ == SINGLE) occluded_one(scene, a, &shadows_[i]);
                sum += blocked(shadows_[i].tfar);
            }
            return sum;
        }
#if EMBREE_MAJOR < 4
        if (call_ == STREAM) rtcIntersect1M(scene, &a.context, &hits_[first], unsigned(end - first), sizeof(RTCRayHit));
#endif
        for (std::size_t i = first; i < end; i++) {
            RTCRayHit &h = hits_[i];
            if (call_ == SINGLE) intersect_one(scene, a, &h);
            if (h.hit.geomID != RTC_INVALID_GEOMETRY_ID) {
                sum += shade(h.hit.Ng_x, h.hit.Ng_y, h.hit.Ng_z, h.ray.dir_x, h.ray.dir_y, h.ray.dir_z);
            }
        }
        return sum;
    }

    template <int N, class Hits, class Rays> void pack(const std::vector<oc_ray> &rays, Hits &hits, Rays &shadows) {
        const std::size_t packets = (rays.size() + N - 1) / N;
        hits.assign(any_ ? 0 : packets, typename Packet<N>::Hit());
        shadows.assign(any_ ? packets : 0, typename Packet<N>::Ray());
        for (std::size_t i = 0; i < packets * N; i++) {
            const RTCRay one = embree_ray(rays[i < rays.size() ? i : rays.size() - 1]);
            typename Packet<N>::Ray &to = any_ ? shadows[i / N] : hits[i / N].ray;
            const std::size_t k = i % N;
            to.org_x[k] = one.org_x, to.org_y[k] = one.org_y, to.org_z[k] = one.org_z;
            to.dir_x[k] = one.dir_x, to.dir_y[k] = one.dir_y, to.dir_z[k] = one.dir_z;
            to.tnear[k] = one.tnear, to.tfar[k] = one.tfar, to.mask[k] = one.mask;
            if (!any_) hits[i / N].hit.geomID[k] = hits[i / N].hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
        }
    }

    template <int N, class Hits, class Rays>
    double packet_span(RTCScene scene, Arguments &a, std::size_t first, std::size_t end, Hits &hits, Rays &shadows) {
        double sum = 0;
        for (std::size_t p = first / N; p * N < end; p++) {
            alignas(64) int valid[N];
            for (int k = 0; k < N; k++) valid[k] = p * N + k < end ? -1 : 0;
            if (any_) {
                Packet<N>::occluded(valid, scene, a, &shadows[p]);
                for (int k = 0; k < N; k++) sum += valid[k] && blocked(shadows[p].tfar[k]);
                continue;
            }
            typename Packet<N>::Hit &h = hits[p];
            Packet<N>::intersect(valid, scene, a, &h);
            for (int k = 0; k < N; k++) {
                if (!valid[k] || h.hit.geomID[k] == RTC_INVALID_GEOMETRY_ID) continue;
                sum += shade(h.hit.Ng_x[k], h.hit.Ng_y[k], h.hit.Ng_z[k], h.ray.dir_x[k], h.ray.dir_y[k], h.ray.dir_z[k]);
            }
        }
        return sum;
    }

    // Packets need an alignment of up to 64 bytes, which the allocator of C++11 does not guarantee.
    template <class T> struct Aligned {
        using value_type = T;
        Aligned() = default;
        template <class U> Aligned(const Aligned<U> &) {}
        T *allocate(std::size_t n) {
            void *p = nullptr;
            if (posix_memalign(&p, 64, n * sizeof(T))) throw std::bad_alloc();
            return static_cast<T *>(p);
        }
        void deallocate(T *p, std::size_t) { free(p); }
        template <class U> bool operator==(const Aligned<U> &) const { return true; }
        template <class U> bool operator!=(const Aligned<U> &) const { return false; }
    };
    template <class T> using Array = std::vector<T, Aligned<T>>;

    std::size_t count_ = 0;
    Call call_ = SINGLE;
    bool any_ = false;
    std::vector<RTCRayHit> hits_;
    std::vector<RTCRay> shadows_;
    Array<RTCRayHit4> packets4_;
    Array<RTCRayHit8> packets8_;
    Array<RTCRayHit16> packets16_;
    Array<RTCRay4> shadows4_;
    Array<RTCRay8> shadows8_;
    Array<RTCRay16> shadows16_;
};

#endif
