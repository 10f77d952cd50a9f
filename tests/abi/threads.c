/* A context with the host's executor, or with none and no threads, never starts a thread. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <dirent.h>
#include <pthread.h>
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

/* Everything that works in the background: a build, a frame, batches. */
static void work(oc_context *context, const char *path) {
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
