// Traces and shades the same rays of the same mesh with outcrop and with Embree. Compares the hits one by one, and the
// speed.
//
//     03_compare_embree MESH.ply MODEL.oc [--rounds 5] [--size 1024x768] [--threads 2] [--poe 1,3]
//     03_compare_embree torus:TRIANGLES MODEL.oc ...
//
// MODEL.oc is built if it does not exist or has another format. Speed is measured in pairs of runs, alternately outcrop
// and Embree, so that a busy machine slows both. The ratio is computed for each pair.
//
// With --poe outcrop also answers from stand-ins that cover at most that many pixels, and Embree exactly. The error of
// the stand-ins is printed with the speed. This is measured twice: for batches of rays with their hits, and for whole
// pictures, from the camera to the bytes.
//
// Where the hits differ, brute force in long double finds the wrong answer. The exit code is 1 if outcrop is wrong by more
// than the rounding of single precision. It does not depend on speed.
#include "compare/agreement.hpp"
#include "compare/embree.hpp"
#include "compare/mesh.hpp"
#include "compare/picture.hpp"
#include "compare/rays.hpp"

#include <outcrop.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <thread>

namespace {

struct Options {
    std::string mesh, model;
    unsigned rounds = 5, width = 1024, height = 768, threads = 2;
    std::vector<double> poes;
};

double seconds() {
    using namespace std::chrono;
    return duration<double>(steady_clock::now().time_since_epoch()).count();
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values.empty() ? 0 : values[values.size() / 2];
}

// --- outcrop's side --------------------------------------------------------------------------------------

// The members that Embree's hits have too.
const oc_want WANT = OC_WANT_T | OC_WANT_NORMAL | OC_WANT_UV | OC_WANT_PART;

// Rays in one query.
const std::size_t CHUNK = 1024;

class Outcrop {
  public:
    Outcrop(const std::string &path, unsigned threads) : context_(threads), threads_(threads) {
        const double begun = seconds();
        model_ = context_.open(path);
        open_seconds_ = seconds() - begun;
        scene_ = outcrop::scene(context_);
        scene_.add_instance(model_, 1);
        scene_.commit();
        // Reads the whole model before the measurements.
        const double low[3] = {-INFINITY, -INFINITY, -INFINITY}, high[3] = {INFINITY, INFINITY, INFINITY};
        scene_.prefetch(low, high).wait();
        read_seconds_ = seconds() - begun;
    }

    const outcrop::model &model() const { return model_; }
    double open_seconds() const { return open_seconds_; }
    double read_seconds() const { return read_seconds_; }

    std::vector<oc_hit> closest(const std::vector<oc_ray> &rays, oc_want want, bool coherent) const {
        return scene_.closest(rays, want, coherent ? OC_QUERY_COHERENT : 0);
    }
    std::vector<std::uint8_t> any(const std::vector<oc_ray> &rays, bool coherent) const {
        return scene_.any(rays, coherent ? OC_QUERY_COHERENT : 0);
    }

    // Allocates memory for the answers, before the time is measured.
    void prepare() {
        hits_.resize(std::size_t(threads_) * CHUNK);
        blocked_.resize(std::size_t(threads_) * CHUNK);
    }

    // Creates a frame with an RGBA picture.
    outcrop::frame frame(unsigned width, unsigned height) const { return outcrop::frame(context_, width, height); }
    void render(outcrop::frame &frame, const oc_camera &camera, double poe) const {
        auto settings = outcrop::init<oc_frame_settings>();
        settings.poe = float(poe);
        frame.request(scene_, camera, settings);
        frame.wait();
    }

    // Traces and shades all rays, as EmbreeRays::run does: each thread traces a chunk of rays and shades it while the
    // hits are in its cache. The library answers such a small batch in the calling thread.
    double run(const std::vector<oc_ray> &rays, bool coherent, bool any) {
        std::atomic<std::size_t> next(0);
        std::vector<double> sums(threads_, 0.0);
        std::vector<std::thread> others;
        auto work = [&](unsigned me) {
            for (std::size_t first; (first = next.fetch_add(CHUNK)) < rays.size();) {
                const std::size_t count = std::min(CHUNK, rays.size() - first);
                sums[me] += span(&rays[first], count, coherent, any, &hits_[me * CHUNK], &blocked_[me * CHUNK]);
            }
        };
        for (unsigned i = 1; i < threads_; i++) others.emplace_back(work, i);
        work(0);
        double sum = 0;
        for (std::thread &t : others) t.join();
        for (double s : sums) sum += s;
        return sum;
    }

  private:
    double span(const oc_ray *rays, std::size_t count, bool coherent, bool any, oc_hit *hits, std::uint8_t *blocked) const {
        auto query = outcrop::init<oc_query>();
        query.rays = rays;
        query.count = count;
        query.want = WANT;
        query.flags = coherent ? OC_QUERY_COHERENT : 0;
        double sum = 0;
        if (any) {
            outcrop::check(oc_scene_any(scene_.get(), &query, blocked, 0));
            for (std::size_t i = 0; i < count; i++) sum += blocked[i];
            return sum;
        }
        outcrop::check(oc_scene_closest(scene_.get(), &query, hits, 0));
        for (std::size_t i = 0; i < count; i++) {
            const float *n = hits[i].normal, *d = rays[i].direction;
            if (hits[i].kind != OC_HIT_MISS) sum += std::fabs(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]);
        }
        return sum;
    }

    outcrop::context context_;
    unsigned threads_;
    outcrop::model model_;
    outcrop::scene scene_;
    double open_seconds_ = 0, read_seconds_ = 0;
    std::vector<oc_hit> hits_;
    std::vector<std::uint8_t> blocked_;
};

// True if the model exists and this version can read it.
bool opens(const std::string &path) {
    if (!std::ifstream(path.c_str())) return false;
    try {
        outcrop::context context(1);
        context.open(path);
        return true;
    } catch (const outcrop::error &e) {
        std::fprintf(stderr, "%s: built anew\n", e.what());
        return false;
    }
}

void build(const Options &options, const Mesh &mesh) {
    const outcrop::context context(options.threads);
    outcrop::build build(context);
    build.add_part(0, "mesh");
    auto t = outcrop::init<oc_triangles>();
    t.positions = mesh.positions.data();
    t.position_count = mesh.positions.size() / 3;
    t.indices = mesh.indices.data();
    t.index_count = mesh.indices.size();
    t.index = OC_INDEX_U32;
    build.add_triangles(t);
    const double begun = seconds();
    build.start(options.model).wait();
    std::printf("outcrop: built in %.2f s, file written\n", seconds() - begun);
}

// --- agreement -------------------------------------------------------------------------------------------

// OC_WANT_ERROR: `t` in double precision. Without it, `t` has the rounding of single precision, as Embree's.
const oc_want JUDGED = OC_WANT_T | OC_WANT_PRIM | OC_WANT_ERROR;

Answer answer(const oc_hit &hit) { return Answer{hit.kind != OC_HIT_MISS, hit.t, hit.prim}; }
Answer answer(const RTCRayHit &hit) {
    return Answer{hit.hit.geomID != RTC_INVALID_GEOMETRY_ID, hit.ray.tfar, hit.hit.primID};
}

void agree_closest(const Outcrop &ours, const EmbreeScene &theirs, const std::vector<oc_ray> &rays, Agreement &agreement) {
    const std::vector<oc_hit> hits = ours.closest(rays, JUDGED, false);
    const std::vector<oc_hit> packets = ours.closest(rays, JUDGED, true);
    EmbreeRays embree;
    embree.prepare(rays, EmbreeRays::SINGLE, false);
    embree.run(theirs.get(), false, 2);
    for (std::size_t i = 0; i < rays.size(); i++) {
        agreement.compare(rays[i], answer(hits[i]), answer(embree.hits()[i]));
        if (std::memcmp(&hits[i], &packets[i], sizeof(oc_hit)) != 0) {
            std::fprintf(stderr, "ray %zu: alone and in a packet outcrop's hits differ\n", i);
            std::exit(1);
        }
    }
}

void agree_any(const Outcrop &ours, const EmbreeScene &theirs, const std::vector<oc_ray> &rays, Agreement &agreement) {
    const std::vector<std::uint8_t> blocked = ours.any(rays, false);
    EmbreeRays embree;
    embree.prepare(rays, EmbreeRays::SINGLE, true);
    embree.run(theirs.get(), false, 2);
    std::vector<oc_ray> differ;
    std::vector<bool> we_block;
    for (std::size_t i = 0; i < rays.size(); i++) {
        if (bool(blocked[i]) == (embree.shadows()[i].tfar < 0)) continue;
        differ.push_back(rays[i]);
        we_block.push_back(blocked[i] != 0);
    }
    agreement.same_shadows(rays.size() - differ.size());
    if (differ.empty()) return;
    const std::vector<oc_hit> hits = ours.closest(differ, JUDGED, false);
    embree.prepare(differ, EmbreeRays::SINGLE, false);
    embree.run(theirs.get(), false, 2);
    for (std::size_t i = 0; i < differ.size(); i++) {
        Answer a = answer(hits[i]), b = answer(embree.hits()[i]);
        a.hit = we_block[i], b.hit = !we_block[i];
        agreement.compare_shadow(differ[i], a, b);
    }
}

// --- speed -----------------------------------------------------------------------------------------------

struct Batch {
    const char *name;
    std::vector<oc_ray> rays;
    bool any, coherent;
};

std::vector<Batch> batches(const Outcrop &ours, const View &view, const Options &options, double step) {
    std::vector<Batch> all(3);
    all[0] = Batch{"primary", primary_rays(view, options.width, options.height), false, true};
    const std::vector<oc_hit> hits = ours.closest(all[0].rays, OC_WANT_POSITION | OC_WANT_NORMAL, true);
    all[1] = Batch{"shadow", shadow_rays(view, hits, step), true, true};
    all[2] = Batch{"bounce", bounce_rays(hits, step), false, false};
    return all;
}

struct Contender {
    const EmbreeScene *scene;
    EmbreeRays::Call call;
    std::string name;
};

double time_embree(EmbreeRays &rays, const Contender &c, const Batch &batch, unsigned threads, double *sum = nullptr) {
    rays.prepare(batch.rays, c.call, batch.any);
    const double begun = seconds();
    const double s = rays.run(c.scene->get(), batch.coherent, threads);
    const double took = seconds() - begun;
    if (sum) *sum = s;
    return took;
}

double time_outcrop(Outcrop &ours, const Batch &batch, bool packets, double *sum = nullptr) {
    ours.prepare();
    const double begun = seconds();
    const double s = ours.run(batch.rays, packets, batch.any);
    const double took = seconds() - begun;
    if (sum) *sum = s;
    return took;
}

// Results for one kind of rays, over all views.
struct Duel {
    std::vector<double> ratios;
    double ours = 0, theirs = 0, rays = 0; // seconds: medians, summed over the views
};

void report(const char *kind, const char *what, const Duel &duel, const std::string &their_call) {
    if (duel.ratios.empty()) return;
    std::printf("  %-8s %-8s outcrop %7.2f Mrays/s   Embree %7.2f (%s)   ratio %.3f  [%.3f .. %.3f]\n", kind, what,
                duel.rays / duel.ours * 1e-6, duel.rays / duel.theirs * 1e-6, their_call.c_str(), median(duel.ratios),
                *std::min_element(duel.ratios.begin(), duel.ratios.end()),
                *std::max_element(duel.ratios.begin(), duel.ratios.end()));
}

// Measures alternately: outcrop, Embree, outcrop, Embree.
void duel(Outcrop &ours, EmbreeRays &rays, const Contender &c, const Batch &batch, bool packets, unsigned threads,
          unsigned rounds, Duel &result) {
    std::vector<double> a, b;
    for (unsigned r = 0; r < rounds; r++) {
        a.push_back(time_outcrop(ours, batch, packets));
        b.push_back(time_embree(rays, c, batch, threads));
        result.ratios.push_back(b.back() / a.back());
    }
    result.ours += median(a);
    result.theirs += median(b);
    result.rays += double(batch.rays.size());
}

// Errors of hits on stand-ins, relative to Embree's exact hits.
struct Accuracy {
    double rays = 0, hits = 0, lod = 0, both = 0, pixels_off = 0, border = 0;

    void add(const std::vector<oc_ray> &rays_, const std::vector<oc_hit> &ours, const std::vector<RTCRayHit> &theirs, double poe) {
        for (std::size_t i = 0; i < rays_.size(); i++) {
            const bool we_hit = ours[i].kind != OC_HIT_MISS, they_hit = theirs[i].hit.geomID != RTC_INVALID_GEOMETRY_ID;
            rays++;
            hits += we_hit;
            lod += ours[i].kind == OC_HIT_LOD;
            border += we_hit != they_hit;
            if (!we_hit || !they_hit) continue;
            both++;
            const double t = double(theirs[i].ray.tfar), pixel = double(rays_[i].cone_b) / std::sqrt(poe) * t;
            pixels_off += std::fabs(ours[i].t - t) / pixel;
        }
    }
    void print() const {
        std::printf("                    %.1f %% stand-ins, mean depth error %.3f pixels, %.3f %% of the rays hit only for one of both\n",
                    100 * lod / hits, pixels_off / both, 100 * border / rays);
    }
};

// Returns the fastest of Embree's calls for the primary rays of a view.
const Contender *best_for(EmbreeRays &rays, const std::vector<Contender> &contenders, const Batch &batch, unsigned threads) {
    const Contender *best = nullptr;
    double least = 0;
    for (const Contender &c : contenders) {
        const double warm = time_embree(rays, c, batch, threads);
        const double took = std::min(warm, time_embree(rays, c, batch, threads));
        if (!best || took < least) best = &c, least = took;
    }
    return best;
}

// Returns the fastest of Embree's packet sizes for pictures of a view.
const Contender &best_for_pictures(const std::vector<Contender> &contenders, const Options &options, unsigned threads,
                                   const View &view, const Look &look) {
    EmbreePicture picture(options.width, options.height, look);
    const Contender *best = nullptr;
    double least = 0;
    for (const Contender &c : contenders) {
        if (c.call != EmbreeRays::PACKET4 && c.call != EmbreeRays::PACKET8 && c.call != EmbreeRays::PACKET16) continue;
        for (int run = 0; run < 3; run++) {
            const double begun = seconds();
            picture.render(c.scene->get(), view, c.call, threads);
            const double took = seconds() - begun;
            if (!best || took < least) best = &c, least = took;
        }
    }
    return *best;
}

// Compares pictures with stand-ins of at most `poe` pixels of error to Embree's exact pictures.
void measure_pictures(Outcrop &ours, const Contender &c, const Options &options, unsigned threads, unsigned v, const View &view,
                      double poe) {
    outcrop::frame frame = ours.frame(options.width, options.height);
    EmbreePicture theirs(options.width, options.height, Look(ours.model().part(0)));
    const oc_camera camera = ours.model().view(v);
    ours.render(frame, camera, poe);
    theirs.render(c.scene->get(), view, c.call, threads);
    Duel duel;
    std::vector<double> a, b;
    for (unsigned r = 0; r < 3 * options.rounds; r++) { // more runs, because each is short
        const double begun = seconds();
        ours.render(frame, camera, poe);
        const double between = seconds();
        theirs.render(c.scene->get(), view, c.call, threads);
        a.push_back(between - begun), b.push_back(seconds() - between);
        duel.ratios.push_back(b.back() / a.back());
    }
    const outcrop::pixels pixels = frame.map();
    const oc_frame_accuracy accuracy = frame.accuracy();
    std::printf("  picture  PoE %-4g outcrop %7.2f ms        Embree %7.2f ms (%s)   ratio %.3f  [%.3f .. %.3f]\n", poe, 1e3 * median(a),
                1e3 * median(b), c.name.c_str(), median(duel.ratios), *std::min_element(duel.ratios.begin(), duel.ratios.end()),
                *std::max_element(duel.ratios.begin(), duel.ratios.end()));
    std::printf("                    stated mean error %.3f pixels; colours differ by %.2f of 255 in the mean\n",
                double(accuracy.mean_error),
                difference(static_cast<const std::uint8_t *>(pixels.data()), theirs.pixels().data(),
                           std::size_t(options.width) * options.height));
}

// Compares primary rays with stand-ins to Embree's exact ones, traced by Embree's fastest call for the view.
void measure_poe(Outcrop &ours, EmbreeRays &rays, const std::vector<Contender> &contenders, const Options &options,
                 unsigned threads, const std::vector<View> &views) {
    for (std::size_t v = 0; !options.poes.empty() && v < views.size(); v++) {
        const Batch exact = {"primary", primary_rays(views[v], options.width, options.height), false, true};
        const Contender *best = best_for(rays, contenders, exact, threads);
        std::printf("  view %zu\n", v + 1);
        for (double poe : options.poes) {
            Duel one;
            Accuracy accuracy;
            const Batch batch = {"primary", primary_rays(views[v], options.width, options.height, poe), false, true};
            rays.prepare(batch.rays, EmbreeRays::SINGLE, false);
            rays.run(best->scene->get(), false, threads);
            accuracy.add(batch.rays, ours.closest(batch.rays, OC_WANT_T, true), rays.hits(), poe);
            duel(ours, rays, *best, batch, true, threads, options.rounds, one);
            char name[32];
            std::snprintf(name, sizeof name, "PoE %g", poe);
            report("primary", name, one, best->name);
            accuracy.print();
        }
        const Contender &packets = best_for_pictures(contenders, options, threads, views[v], Look(ours.model().part(0)));
        measure_pictures(ours, packets, options, threads, unsigned(v), views[v], 0);
        for (double poe : options.poes) measure_pictures(ours, packets, options, threads, unsigned(v), views[v], poe);
    }
}

void measure(const Options &options, unsigned threads, const std::vector<Contender> &contenders,
             const std::vector<View> &views, double step) {
    Outcrop ours(options.model, threads);
    EmbreeRays rays;
    std::map<std::string, Duel> single, packet;
    std::map<std::string, Contender> best_single, best_packet;
    const char *const kinds[] = {"primary", "shadow", "bounce"};
    std::printf("\n%u thread%s, %u x %u rays, %zu views, %u pairs each\n", threads, threads > 1 ? "s" : "", options.width,
                options.height, views.size(), options.rounds);
    for (const View &view : views) {
        for (const Batch &batch : batches(ours, view, options, step)) {
            if (batch.rays.empty()) continue;
            if (!best_single.count(batch.name)) {
                // Tries every call of Embree to find the fastest.
                std::printf("  %-8s Embree, every call, first view:", batch.name);
                double fastest_single = 0, fastest_packet = 0, sum = 0, our_sum = 0;
                for (const Contender &c : contenders) {
                    const double warm = time_embree(rays, c, batch, threads);
                    const double took = std::min(warm, time_embree(rays, c, batch, threads, &sum));
                    const double speed = double(batch.rays.size()) / took * 1e-6;
                    std::printf(" %s %.2f", c.name.c_str(), speed);
                    const bool alone = c.call == EmbreeRays::SINGLE;
                    double &fastest = alone ? fastest_single : fastest_packet;
                    if (speed > fastest) fastest = speed, (alone ? best_single : best_packet)[batch.name] = c;
                }
                time_outcrop(ours, batch, true, &our_sum);
                std::printf("\n  %-8s sum of shades: outcrop %.9g, Embree %.9g\n", batch.name, our_sum, sum);
            }
            duel(ours, rays, best_single[batch.name], batch, false, threads, options.rounds, single[batch.name]);
            duel(ours, rays, best_packet[batch.name], batch, true, threads, options.rounds, packet[batch.name]);
        }
    }
    for (const char *kind : kinds) {
        report(kind, "single", single[kind], best_single[kind].name);
        report(kind, "packets", packet[kind], best_packet[kind].name);
    }
    measure_poe(ours, rays, contenders, options, threads, views);
}

// --- main program -------------------------------------------------------------------------------------------

bool parse(int argc, char **argv, Options &options) {
    std::vector<std::string> names;
    for (int i = 1; i < argc; i++) {
        const std::string argument = argv[i];
        const char *value = i + 1 < argc ? argv[i + 1] : "";
        if (argument == "--rounds") {
            options.rounds = unsigned(std::atoi(value)), i++;
        } else if (argument == "--threads") {
            options.threads = unsigned(std::atoi(value)), i++;
        } else if (argument == "--poe") {
            for (std::istringstream list(value); list.good();) {
                std::string one;
                std::getline(list, one, ',');
                const double poe = std::atof(one.c_str());
                if (!(poe > 0) || !std::isfinite(poe)) return false;
                options.poes.push_back(poe);
            }
            i++;
        } else if (argument == "--size") {
            if (std::sscanf(value, "%ux%u", &options.width, &options.height) != 2) return false;
            i++;
        } else {
            names.push_back(argument);
        }
    }
    options.width = options.width / 4 * 4, options.height = options.height / 4 * 4;
    if (names.size() != 2 || !options.width || !options.height || !options.threads) return false;
    options.mesh = names[0], options.model = names[1];
    return true;
}

int run(const Options &options) {
    flush_denormals();
    const Mesh mesh = options.mesh.compare(0, 6, "torus:") == 0 ? torus(std::size_t(std::atol(options.mesh.c_str() + 6)))
                                                                : PlyReader(options.mesh).read();
    std::printf("%zu triangles, %zu vertices\n", mesh.triangles(), mesh.positions.size() / 3);
    if (mesh.indices.empty()) throw std::runtime_error("there is nothing to trace");
    if (!opens(options.model)) build(options, mesh);

    auto timed = [&](RTCBuildQuality quality, RTCSceneFlags flags, const char *name) {
        const double begun = seconds();
        std::unique_ptr<EmbreeScene> scene(new EmbreeScene(mesh, quality, flags));
        const double arrays = 4.0 * double(mesh.positions.size() + mesh.indices.size()), n = double(mesh.triangles());
        std::printf("Embree %d, %-12s built in %6.2f s, %6.1f bytes a triangle, %.1f with vertices and indices\n",
                    EMBREE_MAJOR, name, seconds() - begun, double(scene->bytes()) / n, (double(scene->bytes()) + arrays) / n);
        return scene;
    };
    timed(RTC_BUILD_QUALITY_MEDIUM, RTC_SCENE_FLAG_COMPACT, "compact:");
    const auto robust = timed(RTC_BUILD_QUALITY_MEDIUM, RTC_SCENE_FLAG_ROBUST, "robust:");

    Agreement agreement(mesh);
    std::vector<View> views;
    double step = 0;
    {
        const Outcrop ours(options.model, options.threads);
        const oc_model_info info = ours.model().info();
        std::printf("outcrop:              opened in %5.3f s, read in %.2f s, %6.1f bytes a triangle with its vertices, %.1f in the file\n",
                    ours.open_seconds(), ours.read_seconds(), double(info.geometry_bytes) / double(info.triangles_stored),
                    double(info.file_bytes) / double(info.triangles_stored));
        step = 1e-5 * length(v3(info.bounds_max) - v3(info.bounds_min));
        for (std::uint32_t i = 0; i < 4; i++) {
            views.push_back(make_view(ours.model().view(i), double(options.width) / options.height));
            for (const Batch &batch : batches(ours, views.back(), options, step)) {
                if (batch.any) {
                    agree_any(ours, *robust, batch.rays, agreement);
                } else {
                    agree_closest(ours, *robust, batch.rays, agreement);
                }
            }
        }
    }
    agreement.print();

    if (options.rounds) {
        const auto medium = timed(RTC_BUILD_QUALITY_MEDIUM, RTC_SCENE_FLAG_NONE, "medium:");
        const auto high = timed(RTC_BUILD_QUALITY_HIGH, RTC_SCENE_FLAG_NONE, "high:");
        std::vector<Contender> contenders;
        for (EmbreeRays::Call call : EmbreeRays::calls()) {
            contenders.push_back(Contender{medium.get(), call, std::string(EmbreeRays::name(call)) + " medium"});
            contenders.push_back(Contender{high.get(), call, std::string(EmbreeRays::name(call)) + " high"});
        }
        measure(options, 1, contenders, views, step);
        if (options.threads > 1) measure(options, options.threads, contenders, views, step);
    }
    return agreement.wrong() ? 1 : 0;
}

} // namespace

int main(int argc, char **argv) {
    Options options;
    if (!parse(argc, argv, options)) {
        std::fprintf(stderr, "usage: %s MESH.ply|torus:TRIANGLES MODEL.oc [--rounds N] [--size WxH] [--threads N] [--poe P,P]\n", argv[0]);
        return 2;
    }
    try {
        return run(options);
    } catch (const std::exception &e) {
        std::fprintf(stderr, "%s\n", e.what());
        return 1;
    }
}
