/* The frame of a C snippet of the guide. tests/guide.rs replaces the two marks with the snippet: leading definitions
 * go to the first mark, statements to the second. */
#include <outcrop.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void check(oc_status status, const char *call) {
    if (status == OC_STATUS_OK) return;
    fprintf(stderr, "%s: %s: %s\n", call, oc_status_name(status), oc_last_error());
    exit(1);
}
#define CHECK(call) check((call), #call)

/* DEFINITIONS */

static void snippet(oc_context *context, oc_model *model, oc_scene *scene, oc_frame *frame, oc_camera camera) {
    (void)context, (void)model, (void)scene, (void)frame, (void)camera;
    /* STATEMENTS */
}

int main(void) {
    oc_context *context;
    oc_model *model;
    oc_scene *scene;
    oc_frame *frame;
    oc_context_desc threads;
    oc_frame_desc desc;
    oc_camera camera;
    OC_INIT(&threads);
    OC_INIT(&desc);
    OC_INIT(&camera);
    threads.threads = 2;
    CHECK(oc_context_create(OC_HEADER_VERSION, &threads, &context));
    CHECK(oc_model_open(context, "pump.oc", &model));
    CHECK(oc_model_get_view(model, 0, &camera));
    CHECK(oc_scene_create(context, &scene));
    CHECK(oc_scene_add_instance(scene, model, 1, NULL));
    CHECK(oc_scene_commit(scene));
    desc.width = 160;
    desc.height = 120;
    desc.buffers = 1u << OC_BUFFER_COLOUR_SRGB8 | 1u << OC_BUFFER_PART | 1u << OC_BUFFER_KIND | 1u << OC_BUFFER_ERROR;
    CHECK(oc_frame_create(context, &desc, &frame));
    CHECK(oc_frame_request(frame, scene, &camera, NULL));
    CHECK(oc_frame_wait(frame, OC_FOREVER, NULL));

    snippet(context, model, scene, frame, camera);
    /* Snippets leave out most checks: the last error of the thread tells if a call has failed. */
    if (oc_last_error()[0]) {
        fprintf(stderr, "a call of the snippet failed: %s\n", oc_last_error());
        return 1;
    }
    oc_frame_release(frame);
    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return 0;
}
