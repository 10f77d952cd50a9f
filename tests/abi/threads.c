/* A context with the host's executor, or with none and no threads, never starts a thread. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <dirent.h>
#include <pthread.h>
#include <string.h>
#include <unistd.h>

/* --- the host: a queue and two threads -------------------------------------------------------- */
#define HOST_THREADS 2
#define QUEUE 1024

static struct {
    pthread_mutex_t lock;
    pthread_cond_t more;
    struct { oc_run_fn run; void *task; } queue[QUEUE];
    unsigned head, tail, ran;
    int stop;
} host = {PTHREAD_MUTEX_INITIALIZER, PTHREAD_COND_INITIALIZER, {{NULL, NULL}}, 0, 0, 0, 0};

static void submit(void *user, oc_run_fn run, void *task) {
    CHECK(user == &host);
    pthread_mutex_lock(&host.lock);
    CHECK(host.tail - host.head < QUEUE);
    host.queue[host.tail % QUEUE].run = run;
    host.queue[host.tail % QUEUE].task = task;
    host.tail++;
    pthread_cond_signal(&host.more);
    pthread_mutex_unlock(&host.lock);
}

static void *serve(void *unused) {
    (void)unused;
    pthread_mutex_lock(&host.lock);
    for (;;) {
        while (host.head == host.tail && !host.stop) pthread_cond_wait(&host.more, &host.lock);
        if (host.head == host.tail) break;
        unsigned at = host.head++ % QUEUE;
        host.ran++;
        oc_run_fn run = host.queue[at].run;
        void *task = host.queue[at].task;
        pthread_mutex_unlock(&host.lock);
        run(task);
        pthread_mutex_lock(&host.lock);
    }
    pthread_mutex_unlock(&host.lock);
    return NULL;
}

/* --- counting --------------------------------------------------------------------------------- */
static int threads_now(void) {
    int n = 0;
    DIR *tasks = opendir("/proc/self/task");
    CHECK(tasks);
    for (struct dirent *e; (e = readdir(tasks));) n += e->d_name[0] != '.';
    closedir(tasks);
    return n;
}

static volatile int watching = 1;
static int most_threads = 0;

static void *watch(void *unused) {
    (void)unused;
    while (watching) {
        int n = threads_now();
        if (n > most_threads) most_threads = n;
        usleep(200);
    }
    return NULL;
}

/* A grid of squares, enough for several blocks, built and opened in both ways. */
static void load(oc_context *context, const char *path) {
    enum { SIDE = 150 };
    static float positions[(SIDE + 1) * (SIDE + 1)][3];
    static uint32_t indices[SIDE * SIDE][6];
    oc_build *build;
    oc_job *job;
    oc_model *model;
    oc_part part;
    oc_triangles t;
    oc_progress progress;
    oc_model_info info;

    for (uint32_t i = 0; i < (SIDE + 1) * (SIDE + 1); i++) {
        positions[i][0] = (float)(i % (SIDE + 1));
        positions[i][1] = (float)(i / (SIDE + 1));
        positions[i][2] = (float)(i * 7919 % 100) * 0.01f;
    }
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        uint32_t a = i / SIDE * (SIDE + 1) + i % SIDE, c = a + SIDE + 1;
        uint32_t square[6] = {a, a + 1, c, c, a + 1, c + 1};
        memcpy(indices[i], square, sizeof square);
    }
    OC_INIT(&part);
    OC_INIT(&t);
    OC_INIT(&progress);
    OC_INIT(&info);
    t.positions = positions;
    t.position_count = (SIDE + 1) * (SIDE + 1);
    t.indices = indices;
    t.index = OC_INDEX_U32;
    t.index_count = SIDE * SIDE * 6;
    OK(oc_build_create(context, NULL, &build));
    OK(oc_build_add_part(build, &part));
    OK(oc_build_add_triangles(build, &t));
    OK(oc_build_start(build, path, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    oc_job_release(job);
    oc_build_release(build);

    OK(oc_model_load(context, path, NULL, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE && progress.bytes > 0 && progress.fraction == 1.0);
    OK(oc_job_model(job, &model));
    OK(oc_model_get_info(model, &info));
    CHECK(info.blocks > 16 && progress.bytes < info.file_bytes);
    oc_job_release(job);
    oc_model_release(model);
    OK(oc_model_open(context, path, &model));
    oc_model_release(model);
}

/* Everything that works in the background: builds, loads, a frame, batches. */
static void work(oc_context *context, const char *path) {
    load(context, path);
    oc_scene *scene = tetra_scene(context, path);

    oc_frame *frame;
    oc_frame_desc desc;
    oc_camera camera;
    oc_progress progress;
    OC_INIT(&desc);
    OC_INIT(&camera);
    OC_INIT(&progress);
    desc.width = 300;
    desc.height = 200;
    camera.eye[0] = 3;
    camera.eye[1] = 2;
    camera.eye[2] = 1;
    OK(oc_frame_create(context, &desc, &frame));
    OK(oc_frame_request(frame, scene, &camera, NULL));
    OK(oc_frame_wait(frame, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);

    enum { RAYS = 5000 };
    static oc_ray rays[RAYS];
    static oc_hit hits[RAYS];
    for (int i = 0; i < RAYS; i++) {
        oc_ray ray = {{0.1, 0.1, -1}, 0, 0, {0, 0, 1}, 0, 0, 0};
        rays[i] = ray;
    }
    oc_query query;
    oc_job *job;
    OC_INIT(&query);
    query.rays = rays;
    query.count = RAYS;
    OK(oc_scene_closest_start(scene, &query, hits, 0, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE && progress.done == RAYS);
    CHECK(hits[RAYS - 1].kind == OC_HIT_EXACT && hits[RAYS - 1].part == 7);
    oc_job_release(job);
    OK(oc_scene_closest(scene, &query, hits, 0));
    oc_frame_release(frame);
    oc_scene_release(scene);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    pthread_t watcher, servers[HOST_THREADS];
    oc_context *context;
    oc_context_desc desc;
    uint64_t value;

    CHECK(pthread_create(&watcher, NULL, watch, NULL) == 0);
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    OK(oc_context_property(context, OC_PROPERTY_THREADS, &value));
    CHECK(value == 0);
    work(context, argv[1]);
    oc_context_release(context);
    CHECK(most_threads == 2); /* main and the watcher */

    for (int i = 0; i < HOST_THREADS; i++) CHECK(pthread_create(&servers[i], NULL, serve, NULL) == 0);
    oc_executor executor;
    OC_INIT(&executor);
    OC_INIT(&desc);
    executor.concurrency = HOST_THREADS;
    executor.user = &host;
    executor.submit = submit;
    desc.executor = &executor;
    desc.threads = OC_ALL_THREADS; /* ignored */
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &context));
    OK(oc_context_property(context, OC_PROPERTY_THREADS, &value));
    CHECK(value == 0);
    OK(oc_context_property(context, OC_PROPERTY_CONCURRENCY, &value));
    CHECK(value == HOST_THREADS);
    work(context, argv[1]);
    oc_context_release(context);
    CHECK(most_threads == 2 + HOST_THREADS);
    CHECK(host.ran > 0);

    pthread_mutex_lock(&host.lock);
    host.stop = 1;
    pthread_cond_broadcast(&host.more);
    pthread_mutex_unlock(&host.lock);
    for (int i = 0; i < HOST_THREADS; i++) pthread_join(servers[i], NULL);
    watching = 0;
    pthread_join(watcher, NULL);
    return 0;
}
