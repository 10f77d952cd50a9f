/* A panic anywhere comes back as a status, and the object that met it is poisoned. Needs a library with debug
 * assertions, which has a hook that is not in the header. */
#include "check.h"

#include <string.h>

void oc_test_panic_at(uint32_t place);
enum { AT_ENTRY = 1, IN_OBJECT = 2, IN_WORK = 3 };

static void wake(void *user) {
    ++*(int *)user;
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    oc_context *context;
    oc_context_desc desc;
    uint64_t value;
    OC_INIT(&desc);
    desc.threads = 2;
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &context));
    oc_scene *scene = tetra_scene(context, argv[1]);

    /* Before any object is known: only the call fails. */
    oc_test_panic_at(AT_ENTRY);
    EXPECT(OC_STATUS_INTERNAL, oc_scene_commit(scene));
    CHECK(strstr(oc_last_error(), "requested by a test"));
    OK(oc_scene_commit(scene));

    /* In a build's background work: the job fails, nothing else does. */
    oc_build *build;
    oc_job *job;
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_build_create(context, NULL, &build));
    add_tetra(build);
    oc_test_panic_at(IN_WORK);
    OK(oc_build_start(build, argv[1], &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_FAILED && progress.error == OC_STATUS_INTERNAL);
    CHECK(strstr(oc_last_error(), "requested by a test"));
    oc_build_report report;
    OC_INIT(&report);
    EXPECT(OC_STATUS_INVALID_STATE, oc_job_build_report(job, &report));
    oc_job_release(job);
    oc_build_release(build);

    /* In a worker thread, while it calls a wake function: the worker lives on. */
    oc_frame *frame;
    oc_camera camera;
    int woken = 0;
    OC_INIT(&camera);
    camera.eye[0] = 3;
    OK(oc_frame_create(context, NULL, &frame));
    OK(oc_frame_set_wake(frame, wake, &woken));
    oc_test_panic_at(IN_WORK);
    OK(oc_frame_request(frame, scene, &camera, NULL));
    OK(oc_frame_wait(frame, OC_FOREVER, &progress));
    OK(oc_frame_set_wake(frame, NULL, NULL));
    OK(oc_frame_request(frame, scene, &camera, NULL));
    OK(oc_frame_wait(frame, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    oc_frame_release(frame);

    /* In an object: it answers "poisoned" from then on, and can be released. */
    oc_test_panic_at(IN_OBJECT);
    EXPECT(OC_STATUS_INTERNAL, oc_scene_commit(scene));
    EXPECT(OC_STATUS_POISONED, oc_scene_commit(scene));
    EXPECT(OC_STATUS_POISONED, oc_scene_remove_instance(scene, 1));
    CHECK(strstr(oc_last_error(), "oc_scene"));
    oc_scene_release(scene);

    /* Others do not care. */
    OK(oc_context_property(context, OC_PROPERTY_VERSION, &value));
    CHECK(value == OC_HEADER_VERSION);
    oc_context_release(context);
    return 0;
}
