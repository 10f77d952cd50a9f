/* The event loop of a viewer: its own read function for the model, a moving camera, and a wake function that announces
 * each better picture.
 *
 *     04_viewer_loop MODEL.oc LAST.png
 *
 * There is no window: the program prints a line where a viewer would draw. After the model is open, this thread never
 * waits for the disk.
 */
#define _POSIX_C_SOURCE 200809L
#define _FILE_OFFSET_BITS 64
#include <outcrop.h>

#include "png.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

static void check(oc_status status, const char *call) {
    if (status == OC_STATUS_OK) return;
    fprintf(stderr, "%s: %s: %s\n", call, oc_status_name(status), oc_last_error());
    exit(1);
}
#define CHECK(call) check((call), #call)

/* Source of the model: here a file; it could be a network connection or an archive. */
typedef struct {
    int file;
} source;

/* Several threads call this function at once. pread is safe: it shares no file position. */
static uint32_t read_at(void *user, uint64_t offset, void *buffer, uint64_t bytes) {
    const source *from = user;
    char *to = buffer;
    while (bytes) {
        const ssize_t got = pread(from->file, to, (size_t)bytes, (off_t)offset);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return 1; /* the library tries again, and shows a stand-in meanwhile */
        to += got;
        offset += (uint64_t)got;
        bytes -= (uint64_t)got;
    }
    return 0;
}

/* Called when no thread reads any more, perhaps a moment after the last release: only this function frees `user`. */
static void close_source(void *user) {
    source *it = user;
    close(it->file);
    free(it);
}

static oc_model *open_model(const oc_context *context, const char *path) {
    struct stat about;
    oc_model *model;
    oc_io io;
    source *from = malloc(sizeof *from);
    if (!from || (from->file = open(path, O_RDONLY)) < 0 || fstat(from->file, &about) != 0) {
        perror(path);
        exit(1);
    }
    OC_INIT(&io);
    io.size = (uint64_t)about.st_size;
    io.read_at = read_at;
    io.close = close_source;
    io.user = from;
    io.name = path;
    CHECK(oc_model_open_io(context, &io, &model));
    return model;
}

/* A flag that wakes the event loop. */
typedef struct {
    pthread_mutex_t lock;
    pthread_cond_t rings;
    int news;
} bell;

/* The wake function. Any thread may call it, and it must not block: it only sets the flag for the event loop. */
static void wake(void *user) {
    bell *b = user;
    pthread_mutex_lock(&b->lock);
    b->news = 1;
    pthread_cond_signal(&b->rings);
    pthread_mutex_unlock(&b->lock);
}

static void wait_for_news(bell *b) {
    pthread_mutex_lock(&b->lock);
    while (!b->news) pthread_cond_wait(&b->rings, &b->lock);
    b->news = 0;
    pthread_mutex_unlock(&b->lock);
}

/* Draws the latest picture, if it is new. `drawn` is the number of the last picture of this request that was drawn.
 * Returns 1 while the request is running, else 0. */
static int draw(const oc_frame *frame, uint32_t *drawn) {
    oc_frame_accuracy a;
    oc_pixels pixels;
    OC_INIT(&a);
    OC_INIT(&pixels);
    CHECK(oc_frame_get_accuracy(frame, &a));
    if (a.state == OC_STATE_FAILED) {
        oc_progress why;
        OC_INIT(&why);
        CHECK(oc_frame_poll(frame, &why));
        check(why.error, "rendering");
    }
    if (a.pictures > *drawn) {
        *drawn = a.pictures;
        CHECK(oc_frame_map(frame, OC_BUFFER_COLOUR_SRGB8, &pixels));
        printf("  picture %u after %3.0f ms: %3.0f %% as fine as asked, error %.2f pixels, %.1f MB in memory\n", (unsigned)a.pictures,
               a.seconds * 1e3, 100.0 * (double)(a.pixels_exact + a.pixels_lod) / (double)a.pixels_total, (double)a.mean_error,
               (double)a.bytes_resident * 1e-6);
        oc_mapping_release(pixels.mapping);
    }
    return a.state == OC_STATE_RUNNING;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: %s MODEL.oc LAST.png\n", argv[0]);
        return 2;
    }
    oc_context *context;
    oc_context_desc desc;
    OC_INIT(&desc);
    desc.threads = OC_ALL_THREADS;
    desc.memory_budget = 64 << 20;
    CHECK(oc_context_create(OC_HEADER_VERSION, &desc, &context));
    oc_model *model = open_model(context, argv[1]);
    oc_camera camera;
    OC_INIT(&camera);
    CHECK(oc_model_get_view(model, 0, &camera));
    oc_scene *scene;
    CHECK(oc_scene_create(context, &scene));
    CHECK(oc_scene_add_instance(scene, model, 1, NULL));
    CHECK(oc_scene_commit(scene));

    oc_frame *frame;
    oc_frame_settings settings;
    bell news = {PTHREAD_MUTEX_INITIALIZER, PTHREAD_COND_INITIALIZER, 0};
    OC_INIT(&settings);
    CHECK(oc_frame_create(context, NULL, &frame));
    CHECK(oc_frame_set_wake(frame, wake, &news));

    const double x = camera.eye[0] - camera.at[0], y = camera.eye[1] - camera.at[1];
    for (int step = 0; step <= 8; step++) {
        const int rests = step == 8;
        const double angle = 0.05 * step;
        uint32_t drawn = 0;
        camera.eye[0] = camera.at[0] + x * cos(angle) - y * sin(angle);
        camera.eye[1] = camera.at[1] + x * sin(angle) + y * cos(angle);
        /* One pixel of error is invisible while the camera moves. At rest the picture becomes exact. A request
         * replaces the previous one. */
        settings.poe = rests ? 0.0f : 1.0f;
        settings.samples = rests ? 4 : 1;
        CHECK(oc_frame_request(frame, scene, &camera, &settings));
        printf("%s\n", rests ? "the camera rests" : "the camera moves");
        /* While the camera moves, draw only the first picture of each request. At rest, draw each better one. */
        for (int more = 1; more && (rests || !drawn); more = draw(frame, &drawn)) wait_for_news(&news);
    }

    oc_pixels last;
    OC_INIT(&last);
    CHECK(oc_frame_map(frame, OC_BUFFER_COLOUR_SRGB8, &last));
    if (png_write(argv[2], (const unsigned char *)last.data, last.width, last.height, (size_t)last.row_pitch)) {
        perror(argv[2]);
        return 1;
    }
    oc_mapping_release(last.mapping);
    oc_frame_release(frame);
    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return 0;
}
