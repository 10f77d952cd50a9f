/* Prints all surfaces that a ray crosses, the parts that hold its start point, and the thickness at its first hit.
 *
 *     05_crossings MODEL.oc
 *
 * The ray goes through the middle of the model, from left to right.
 */
#include <outcrop.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Prints the reason and exits if a call has failed. */
static void check(oc_status status, const char *call) {
    if (status == OC_STATUS_OK) return;
    fprintf(stderr, "%s: %s: %s\n", call, oc_status_name(status), oc_last_error());
    exit(1);
}
#define CHECK(call) check((call), #call)

/* Prints the crossings of one ray. */
static void say_crossings(const oc_scene *scene, const oc_query *query) {
    oc_crossing few[16], *all = few;
    uint64_t end, count;
    oc_status status = oc_scene_crossings(scene, query, few, 16, &end, NULL, &count);
    if (status == OC_STATUS_BUFFER_TOO_SMALL) {
        all = malloc((size_t)count * sizeof *all);
        if (!all) exit(1);
        status = oc_scene_crossings(scene, query, all, count, &end, NULL, &count);
    }
    check(status, "oc_scene_crossings");
    for (uint64_t i = 0; i < count; i++) {
        printf("at %g: %s part %llu\n", all[i].t, all[i].side == OC_SIDE_FRONT ? "into" : "out of",
               (unsigned long long)all[i].part);
    }
    if (all != few) free(all);
}

/* Prints the parts that hold a point. */
static void say_parts(const oc_scene *scene, const double *point) {
    oc_part_at parts[16];
    uint64_t end, count;
    CHECK(oc_scene_parts_at(scene, point, 1, 0, parts, 16, &end, &count));
    for (uint64_t i = 0; i < count; i++) {
        printf("the point is %s part %llu\n", parts[i].holds == OC_HOLDS_INSIDE ? "in" : "perhaps in",
               (unsigned long long)parts[i].part);
    }
    if (!count) printf("no part holds the point\n");
}

int main(int argc, char **argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: %s MODEL.oc\n", argv[0]);
        return 2;
    }
    oc_context *context;
    oc_model *model;
    oc_scene *scene;
    oc_model_info info;
    OC_INIT(&info);
    CHECK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    CHECK(oc_model_open(context, argv[1], &model));
    CHECK(oc_model_get_info(model, &info));
    CHECK(oc_scene_create(context, &scene));
    CHECK(oc_scene_add_instance(scene, model, 1, NULL));
    CHECK(oc_scene_commit(scene));

    for (uint32_t i = 0; i < info.parts; i++) {
        oc_part_info part;
        OC_INIT(&part);
        CHECK(oc_model_get_part(model, i, &part));
        printf("part %llu is %s\n", (unsigned long long)part.id, part.flags & OC_PART_CLOSED ? "closed" : "not closed");
    }

    oc_ray ray;
    oc_query query;
    oc_hit hit;
    double middle[3], thickness;
    memset(&ray, 0, sizeof ray);
    OC_INIT(&query);
    for (int i = 0; i < 3; i++) middle[i] = ray.origin[i] = (info.bounds_min[i] + info.bounds_max[i]) / 2;
    ray.origin[0] = info.bounds_min[0] - 1;
    ray.direction[0] = 1;
    query.rays = &ray;
    query.count = 1;
    say_crossings(scene, &query);
    say_parts(scene, middle);
    CHECK(oc_scene_closest(scene, &query, &hit, 0));
    CHECK(oc_scene_thickness(scene, &hit, 1, 0, &thickness, 0));
    if (hit.kind != OC_HIT_MISS) printf("thickness at the first hit: %g\n", thickness);

    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return 0;
}
