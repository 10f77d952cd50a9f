/* In a child of fork the handles of the parent return a status: no call waits, and no release aborts. */
#define _POSIX_C_SOURCE 200809L
#include "check.h"

#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define OF_PARENT(call)                                                                        \
    do {                                                                                       \
        EXPECT(OC_STATUS_INVALID_STATE, call);                                                 \
        CHECK(strstr(oc_last_error(), "parent process"));                                      \
    } while (0)

enum { RAYS = 20000 };
static oc_ray rays[RAYS];
static oc_hit hits[RAYS];

typedef struct {
    oc_context *context;
    oc_model *model;
    oc_scene *scene;
    oc_frame *frame;
    oc_job *batch;
    oc_build *build;
    oc_mapping *mapping;
} objects;

static oc_camera a_camera(void) {
    oc_camera camera;
    OC_INIT(&camera);
    camera.eye[0] = 3, camera.eye[1] = 2, camera.eye[2] = 1;
    return camera;
}

static void render(oc_frame *frame, oc_scene *scene) {
    oc_progress progress;
    oc_camera camera = a_camera();
    OC_INIT(&progress);
    OK(oc_frame_request(frame, scene, &camera, NULL));
    OK(oc_frame_wait(frame, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
}

static objects create(const char *path) {
    objects o;
    oc_context_desc desc;
    oc_frame_desc size;
    oc_pixels pixels;
    OC_INIT(&desc);
    OC_INIT(&size);
    OC_INIT(&pixels);
    desc.threads = 2;
    size.width = 200, size.height = 100;
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &o.context));
    o.scene = tetra_scene(o.context, path);
    OK(oc_model_open(o.context, path, &o.model));
    OK(oc_build_create(o.context, NULL, &o.build));
    OK(oc_frame_create(o.context, &size, &o.frame));
    render(o.frame, o.scene);
    OK(oc_frame_map(o.frame, OC_BUFFER_COLOUR_SRGB8, &pixels));
    o.mapping = pixels.mapping;
    oc_query query;
    OC_INIT(&query);
    query.rays = rays, query.count = RAYS;
    OK(oc_scene_closest_start(o.scene, &query, hits, 0, &o.batch));
    return o;
}

static void release(objects *o) {
    oc_mapping_release(o->mapping);
    oc_job_release(o->batch);
    oc_frame_release(o->frame);
    oc_build_release(o->build);
    oc_model_release(o->model);
    oc_scene_release(o->scene);
    oc_context_release(o->context);
}

static void child(objects *o, const char *path) {
    oc_progress progress;
    oc_model_info info;
    oc_hit hit;
    oc_query query;
    oc_job *job = NULL;
    oc_camera camera = a_camera();
    OC_INIT(&progress);
    OC_INIT(&info);
    OC_INIT(&query);
    query.rays = rays, query.count = RAYS;
    alarm(60); /* a call that waits would never end */
    OF_PARENT(oc_frame_request(o->frame, o->scene, &camera, NULL));
    OF_PARENT(oc_frame_wait(o->frame, OC_FOREVER, &progress));
    OF_PARENT(oc_frame_poll(o->frame, &progress));
    OF_PARENT(oc_frame_cancel(o->frame));
    OF_PARENT(oc_frame_resize(o->frame, 10, 10));
    OF_PARENT(oc_frame_pick(o->frame, 1, 1, &hit));
    OF_PARENT(oc_scene_closest(o->scene, &query, hits, 0));
    OF_PARENT(oc_scene_closest_start(o->scene, &query, hits, 0, &job));
    OF_PARENT(oc_scene_commit(o->scene));
    OF_PARENT(oc_job_wait(o->batch, OC_FOREVER, &progress));
    OF_PARENT(oc_job_cancel(o->batch));
    OF_PARENT(oc_model_get_info(o->model, &info));
    OF_PARENT(oc_model_load(o->context, path, NULL, &job));
    OF_PARENT(oc_build_start(o->build, path, &job));
    OF_PARENT(oc_context_step(o->context, NULL));
    oc_context_retain(o->context);
    oc_context_release(o->context);
    release(o);

    /* The child's own objects work. */
    objects own = create(path);
    OK(oc_job_wait(own.batch, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE && hits[RAYS - 1].kind == OC_HIT_EXACT);
    release(&own);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    oc_context *context;
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    build_tetra(context, argv[1]);
    oc_context_release(context);
    for (int i = 0; i < RAYS; i++) {
        oc_ray ray = {{0.1, 0.1, -1}, 0, 0, {0, 0, 1}, 0, 0, 0};
        rays[i] = ray;
    }
    objects o = create(argv[1]);
    pid_t pid = fork();
    CHECK(pid >= 0);
    if (pid == 0) {
        child(&o, argv[1]);
        exit(0);
    }
    int status = -1;
    CHECK(waitpid(pid, &status, 0) == pid);
    CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    /* The parent did not notice. */
    render(o.frame, o.scene);
    OK(oc_job_wait(o.batch, OC_FOREVER, NULL));
    release(&o);
    return 0;
}
