/* Checks for the C tests: the first that fails says where, and ends the program. */
#ifndef CHECK_H
#define CHECK_H

#include <outcrop.h>
#include <stdio.h>
#include <stdlib.h>

#define CHECK(condition)                                                                       \
    do {                                                                                       \
        if (!(condition)) {                                                                    \
            fprintf(stderr, "%s:%d: %s\n  last error: %s\n", __FILE__, __LINE__, #condition,   \
                    oc_last_error());                                                          \
            exit(1);                                                                           \
        }                                                                                      \
    } while (0)

/* The call returns this status, and nothing else. */
#define EXPECT(wanted, call)                                                                   \
    do {                                                                                       \
        oc_status status_ = (call);                                                            \
        if (status_ != (wanted)) {                                                             \
            fprintf(stderr, "%s:%d: %s\n  is %s, not %s\n  last error: %s\n", __FILE__,        \
                    __LINE__, #call, oc_status_name(status_), oc_status_name(wanted),          \
                    oc_last_error());                                                          \
            exit(1);                                                                           \
        }                                                                                      \
    } while (0)

#define OK(call) EXPECT(OC_STATUS_OK, call)
#define INVALID(call) EXPECT(OC_STATUS_INVALID_ARGUMENT, call)

/* A tetrahedron, for tests that need any model at all: four triangles of part 7. */
static const float tetra_positions[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
static const uint32_t tetra_indices[12] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};

static inline void add_tetra(oc_build *build) {
    oc_part part;
    OC_INIT(&part);
    part.id = 7;
    part.name = "tetra";
    OK(oc_build_add_part(build, &part));
    oc_triangles t;
    OC_INIT(&t);
    t.part = 7;
    t.positions = tetra_positions;
    t.position_count = 4;
    t.indices = tetra_indices;
    t.index = OC_INDEX_U32;
    t.index_count = 12;
    OK(oc_build_add_triangles(build, &t));
}

/* Builds the tetrahedron at `path`. */
static inline void build_tetra(oc_context *context, const char *path) {
    oc_build *build;
    oc_job *job;
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_build_create(context, NULL, &build));
    add_tetra(build);
    OK(oc_build_start(build, path, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    EXPECT(OC_STATUS_OK, progress.error);
    CHECK(progress.state == OC_STATE_DONE && progress.fraction == 1.0);
    oc_job_release(job);
    oc_build_release(build);
}

/* A scene of one instance, id 1, of the tetrahedron. */
static inline oc_scene *tetra_scene(oc_context *context, const char *path) {
    oc_model *model;
    oc_scene *scene;
    build_tetra(context, path);
    OK(oc_model_open(context, path, &model));
    OK(oc_scene_create(context, &scene));
    OK(oc_scene_add_instance(scene, model, 1, NULL));
    OK(oc_scene_commit(scene));
    oc_model_release(model);
    return scene;
}

#endif
