// Builds a mesh with both kinds of stand-ins, and writes the first picture of each beside the exact one: voxels,
// proxies, exact. Prints how far they are off.
//
//     07_stand_ins MESH VOXELS.oc PROXIES.oc PICTURE.png
//
// A first picture shows the data that opening reads, a quarter of the budget at most: other reads wait until the
// picture is there.
#include <outcrop.hpp>

#include "png.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <fstream>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <thread>

namespace {

const std::uint32_t WIDTH = 640, HEIGHT = 320;
const std::uint64_t BUDGET = 8 << 20;
// Pixels by which a part may be out of place.
const int REACH = 2;

void build(const outcrop::context &context, const char *mesh, const char *path, oc_stand_ins stand_ins) {
    auto desc = outcrop::init<oc_build_desc>();
    desc.stand_ins = stand_ins;
    outcrop::build build(context, desc);
    build.add_file(mesh);
    build.start(path).wait();
}

// A file whose reads can be held up.
struct Source {
    std::mutex mutex;
    std::condition_variable is_opened;
    std::ifstream file;
    std::uint64_t bytes_read = 0;
    bool is_shut = false;

    static std::uint32_t read(void *user, std::uint64_t offset, void *buffer, std::uint64_t bytes) {
        Source &source = *static_cast<Source *>(user);
        std::unique_lock<std::mutex> lock(source.mutex);
        source.is_opened.wait(lock, [&] { return !source.is_shut; });
        source.file.seekg(static_cast<std::streamoff>(offset));
        source.file.read(static_cast<char *>(buffer), static_cast<std::streamsize>(bytes));
        source.bytes_read += bytes;
        return source.file ? 0 : 1;
    }
    static void close(void *user) { delete static_cast<Source *>(user); }
    void shut(bool is) {
        std::lock_guard<std::mutex> lock(mutex);
        is_shut = is;
        is_opened.notify_all();
    }
    std::uint64_t count() {
        std::lock_guard<std::mutex> lock(mutex);
        return bytes_read;
    }
};

// Lets reads go on at the end of a block, also if a call throws: the release of a context waits for them.
struct OpensAtEnd {
    Source &source;
    ~OpensAtEnd() { source.shut(false); }
};

struct Picture {
    std::vector<unsigned char> coded; // rows of 4 bytes for each pixel
    std::vector<float> linear;        // 4 for each pixel
    std::vector<std::uint64_t> parts;
    std::uint64_t missing = 0, bytes_read = 0, bytes = 0;
};

template <class Element>
std::vector<Element> copy(const outcrop::frame &frame, oc_buffer buffer, std::size_t each) {
    const outcrop::pixels pixels = frame.map(buffer);
    std::vector<Element> all;
    for (std::uint32_t y = 0; y < HEIGHT; y++) {
        all.insert(all.end(), pixels.row<Element>(y), pixels.row<Element>(y) + each * WIDTH);
    }
    return all;
}

Picture taken(const outcrop::frame &frame) {
    Picture picture;
    picture.coded = copy<unsigned char>(frame, OC_BUFFER_COLOUR_SRGB8, 4);
    picture.linear = copy<float>(frame, OC_BUFFER_COLOUR_LINEAR, 4);
    picture.parts = copy<std::uint64_t>(frame, OC_BUFFER_PART, 1);
    picture.missing = frame.accuracy().pixels_missing;
    return picture;
}

outcrop::scene place(const outcrop::context &context, const outcrop::model &model) {
    outcrop::scene scene(context);
    scene.add_instance(model, 1);
    scene.commit();
    return scene;
}

// The camera that shows the whole as large as a pane allows, from the side of the model's first view.
oc_camera fit(const outcrop::scene &scene, const oc_camera &view) {
    auto desc = outcrop::init<oc_fit>();
    desc.width = WIDTH, desc.height = HEIGHT;
    desc.view = OC_VIEW_ALONG;
    for (int axis = 0; axis < 3; axis++) desc.direction[axis] = view.at[axis] - view.eye[axis];
    return scene.fit(desc);
}

outcrop::frame request(const outcrop::context &context, const outcrop::scene &scene, const oc_camera &camera) {
    auto desc = outcrop::init<oc_frame_desc>();
    desc.width = WIDTH, desc.height = HEIGHT;
    desc.buffers = 1u << OC_BUFFER_COLOUR_SRGB8 | 1u << OC_BUFFER_COLOUR_LINEAR | 1u << OC_BUFFER_PART;
    outcrop::frame frame(context, desc);
    frame.request(scene, camera);
    return frame;
}

Picture first(const char *path, const oc_camera &camera) {
    auto desc = outcrop::init<oc_context_desc>();
    desc.threads = OC_ALL_THREADS;
    desc.memory_budget = BUDGET;
    desc.flags = OC_CONTEXT_NO_READ_AHEAD;
    const outcrop::context context(desc);
    std::unique_ptr<Source> source(new Source);
    source->file.open(path, std::ios::binary | std::ios::ate);
    if (!source->file) throw std::runtime_error(std::string(path) + " cannot be opened");
    auto io = outcrop::init<oc_io>();
    io.size = static_cast<std::uint64_t>(source->file.tellg());
    io.read_at = Source::read, io.close = Source::close;
    Source &reads = *source;
    io.user = source.release(); // deleted by `close`
    io.name = path;
    const outcrop::model model = context.open(io);
    const OpensAtEnd opens{reads};
    reads.shut(true);
    outcrop::frame frame = request(context, place(context, model), camera);
    // No oc_frame_wait: a read must not wait for a thread that is in it.
    while (!frame.accuracy().pictures) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    Picture picture = taken(frame);
    frame.cancel();
    picture.bytes_read = reads.count(), picture.bytes = io.size;
    return picture;
}

// Mean linear brightness over that of the exact picture, of the pixels that show a surface there.
double brightness(const Picture &seen, const Picture &exact) {
    double sums[2] = {0, 0};
    for (std::size_t i = 0; i < exact.parts.size(); i++) {
        if (exact.parts[i] == OC_NO_ID) continue;
        const float *a = &seen.linear[4 * i], *b = &exact.linear[4 * i];
        sums[0] += 0.2126 * a[0] + 0.7152 * a[1] + 0.0722 * a[2];
        sums[1] += 0.2126 * b[0] + 0.7152 * b[1] + 0.0722 * b[2];
    }
    return sums[0] / sums[1];
}

// Of the pixels with a surface in both pictures, the share with a part that the exact one does not show near them.
double foreign(const Picture &seen, const Picture &exact) {
    std::size_t count = 0, of = 0;
    for (int y = 0; y < int(HEIGHT); y++) {
        for (int x = 0; x < int(WIDTH); x++) {
            const std::uint64_t part = seen.parts[std::size_t(y) * WIDTH + x];
            if (part == OC_NO_ID || exact.parts[std::size_t(y) * WIDTH + x] == OC_NO_ID) continue;
            bool is_near = false;
            for (int v = std::max(y - REACH, 0); v <= std::min(y + REACH, int(HEIGHT) - 1); v++) {
                for (int u = std::max(x - REACH, 0); u <= std::min(x + REACH, int(WIDTH) - 1); u++) {
                    is_near = is_near || exact.parts[std::size_t(v) * WIDTH + u] == part;
                }
            }
            count += !is_near, of++;
        }
    }
    return double(count) / double(of);
}

void run(const char *mesh, const char *voxels, const char *proxies, const char *out) {
    const outcrop::context context(OC_ALL_THREADS);
    build(context, mesh, voxels, OC_STAND_INS_VOXELS);
    build(context, mesh, proxies, OC_STAND_INS_PROXIES);
    const outcrop::model model = context.open(voxels);
    const outcrop::scene scene = place(context, model);
    const oc_camera camera = fit(scene, model.view(0));
    const outcrop::frame frame = request(context, scene, camera);
    frame.wait();
    const Picture panes[3] = {first(voxels, camera), first(proxies, camera), taken(frame)};
    const char *const names[2] = {"voxels", "proxies"};
    for (int i = 0; i < 2; i++) {
        const Picture &pane = panes[i];
        if (!pane.missing) throw std::runtime_error("the first picture is exact: take a larger mesh");
        std::printf("%-7s: brightness %.3f, foreign parts %.1f %%, %.2f of %.2f MB read\n", names[i],
                    brightness(pane, panes[2]), 100 * foreign(pane, panes[2]), double(pane.bytes_read) * 1e-6,
                    double(pane.bytes) * 1e-6);
    }
    std::vector<unsigned char> all;
    for (std::size_t y = 0; y < HEIGHT; y++) {
        for (const Picture &pane : panes) {
            all.insert(all.end(), &pane.coded[4 * WIDTH * y], &pane.coded[4 * WIDTH * y] + 4 * WIDTH);
        }
    }
    if (png_write(out, all.data(), 3 * WIDTH, HEIGHT, 12 * WIDTH)) throw std::runtime_error("no picture is written");
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 5) {
        std::fprintf(stderr, "usage: %s MESH VOXELS.oc PROXIES.oc PICTURE.png\n", argv[0]);
        return 2;
    }
    try {
        run(argv[1], argv[2], argv[3], argv[4]);
        return 0;
    } catch (const std::exception &e) {
        std::fprintf(stderr, "%s\n", e.what());
        return 1;
    }
}
