/* Lists the parts of a model that clash: one line for each pair, as the search finds them.
 *
 *     09_clashes MODEL.oc [CLEARANCE]
 */
#include <outcrop.h>

#include <stdio.h>
#include <stdlib.h>

/* Prints the reason and exits if a call has failed. */
static void check(oc_status status, const char *call) {
    if (status == OC_STATUS_OK) return;
    fprintf(stderr, "%s: %s: %s\n", call, oc_status_name(status), oc_last_error());
    exit(1);
}
#define CHECK(call) check((call), #call)

static const char *kind(oc_clash_kind kind) {
    switch (kind) {
    case OC_CLASH_CROSSING: return "crosses";
    case OC_CLASH_TOUCHING: return "touches";
    case OC_CLASH_CONTAINED: return "holds or is inside of";
    case OC_CLASH_CLEARANCE: return "is near";
    default: return "clashes with";
    }
}

/* Prints the clashes that were found since the last call; returns their number. */
static uint64_t print_found(const oc_job *job) {
    oc_clash some[64];
    uint64_t count, all = 0;
    do {
        CHECK(oc_job_take_clashes(job, some, 64, &count));
        for (uint64_t i = 0; i < count; i++) {
            const oc_clash *one = &some[i];
            printf("part %llu %s part %llu at (%g, %g, %g)", (unsigned long long)one->part[0], kind(one->kind),
                   (unsigned long long)one->part[1], one->first_point[0], one->first_point[1], one->first_point[2]);
            if (one->kind == OC_CLASH_CLEARANCE) printf(", distance %g", one->distance);
            printf("%s\n", one->open ? " (not closed)" : "");
        }
        all += count;
    } while (count == 64);
    return all;
}

int main(int argc, char **argv) {
    if (argc < 2 || argc > 3) {
        fprintf(stderr, "usage: %s MODEL.oc [CLEARANCE]\n", argv[0]);
        return 2;
    }
    oc_context *context;
    oc_model *model;
    oc_scene *scene;
    oc_job *job;
    oc_clash_desc desc;
    oc_progress progress;
    oc_clash_summary summary;
    OC_INIT(&desc);
    OC_INIT(&progress);
    OC_INIT(&summary);
    CHECK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    CHECK(oc_model_open(context, argv[1], &model));
    CHECK(oc_scene_create(context, &scene));
    CHECK(oc_scene_add_instance(scene, model, 1, NULL));
    CHECK(oc_scene_commit(scene));

    desc.clearance = argc > 2 ? atof(argv[2]) : 0;
    CHECK(oc_scene_clash_start(scene, &desc, &job));
    uint64_t printed = 0;
    do {
        CHECK(oc_job_wait(job, 100, &progress));
        printed += print_found(job);
    } while (progress.state == OC_STATE_RUNNING);
    check(progress.error, "the search");
    CHECK(oc_job_clash_summary(job, &summary));
    printf("%llu pairs of parts\n", (unsigned long long)summary.pairs);

    oc_job_release(job);
    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return printed == summary.clashes ? 0 : 1;
}
