/* Rays and hits in single precision: the answers are those of oc_scene_closest and oc_scene_any, rounded. */
#include "check.h"

#include <math.h>
#include <string.h>

enum { SIDE = 40, COUNT = SIDE * SIDE };

int main(int argc, char **argv) {
    CHECK(argc == 2);
    char path[4096];
    snprintf(path, sizeof path, "%s/tetra.oc", argv[1]);
    oc_context *context;
    oc_build *build;
    oc_job *job;
    oc_model *model;
    oc_scene *scene;
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    OK(oc_build_create(context, NULL, &build));
    add_tetra(build);
    OK(oc_build_start(build, path, &job));
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    oc_job_release(job);
    oc_build_release(build);
    OK(oc_model_open(context, path, &model));
    OK(oc_scene_create(context, &scene));
    OK(oc_scene_add_instance(scene, model, 0x100000003, NULL));
    OK(oc_scene_commit(scene));

    static oc_ray rays[COUNT];
    static oc_ray_f32 rows[COUNT];
    static float columns[8][COUNT];
    for (int i = 0; i < COUNT; i++) {
        const float x = (float)(i % SIDE) / SIDE * 1.2f - 0.1f, y = (float)(i / SIDE) / SIDE * 1.2f - 0.1f;
        const float values[8] = {x, y, -1, 0.25f, 0.1f, 0.05f, 1, i % 3 == 0 ? 0 : 0.5f + 0.001f * (float)i};
        for (int k = 0; k < 8; k++) columns[k][i] = values[k];
        memcpy(&rows[i], values, sizeof rows[i]);
        memset(&rays[i], 0, sizeof rays[i]);
        for (int k = 0; k < 3; k++) rays[i].origin[k] = values[k], rays[i].direction[k] = values[4 + k];
        rays[i].t_min = values[3], rays[i].t_max = values[7];
    }
    static oc_hit hits[COUNT];
    static uint8_t any[COUNT];
    oc_query query;
    OC_INIT(&query);
    query.rays = rays;
    query.count = COUNT;
    OK(oc_scene_closest(scene, &query, hits, 0));
    OK(oc_scene_any(scene, &query, any, 0));

    oc_rays_soa soa;
    memset(&soa, 0, sizeof soa);
    for (int k = 0; k < 3; k++) soa.origin[k] = columns[k], soa.direction[k] = columns[4 + k];
    soa.t_min = columns[3], soa.t_max = columns[7];
    int met = 0;
    for (int way = 0; way < 2; way++) {
        static oc_hit_f32 narrow[COUNT];
        static uint8_t narrow_any[COUNT];
        oc_query_f32 q;
        OC_INIT(&q);
        q.rays = way == 0 ? rows : NULL;
        q.columns = way == 0 ? NULL : &soa;
        q.count = COUNT;
        q.flags = way == 0 ? 0 : OC_QUERY_COHERENT;
        OK(oc_scene_closest_f32(scene, &q, narrow, 0));
        OK(oc_scene_any_f32(scene, &q, narrow_any, 0));
        for (int i = 0; i < COUNT; i++) {
            const oc_hit *wide = &hits[i];
            const oc_hit_f32 *hit = &narrow[i];
            CHECK(hit->kind == wide->kind && narrow_any[i] == any[i]);
            CHECK(any[i] == (wide->kind != OC_HIT_MISS));
            if (hit->kind == OC_HIT_MISS) {
                CHECK(isinf(hit->t) && hit->part == 0xFFFFFFFF && hit->prim == 0xFFFFFFFF);
                CHECK(hit->instance == 0xFFFFFFFF && hit->normal[0] == 0);
                continue;
            }
            met++;
            CHECK(fabs(hit->t - wide->t) <= 1e-6 * wide->t);
            CHECK(memcmp(hit->normal, wide->normal, sizeof hit->normal) == 0);
            CHECK(fabsf(hit->uv[0] - wide->uv[0]) <= 1e-5f && fabsf(hit->uv[1] - wide->uv[1]) <= 1e-5f);
            CHECK(hit->part == 7 && hit->prim == wide->prim && hit->instance == 3);
        }
        /* No interval is from 0 without end. */
        if (way == 1) {
            soa.t_min = soa.t_max = NULL;
            OK(oc_scene_closest_f32(scene, &q, narrow, 0));
            for (int i = 0; i < COUNT; i++) rays[i].t_min = rays[i].t_max = 0;
            OK(oc_scene_closest(scene, &query, hits, 0));
            for (int i = 0; i < COUNT; i++) CHECK(narrow[i].kind == hits[i].kind);
        }
    }
    CHECK(met > COUNT / 4);

    /* Misuse. */
    oc_query_f32 q;
    OC_INIT(&q);
    static oc_hit_f32 one[1];
    OK(oc_scene_closest_f32(scene, &q, NULL, 0)); /* no rays: pointers do not matter */
    q.count = 1;
    INVALID(oc_scene_closest_f32(scene, &q, one, 0)); /* neither rays nor columns */
    q.rays = rows, q.columns = &soa;
    INVALID(oc_scene_closest_f32(scene, &q, one, 0)); /* both */
    q.columns = NULL;
    OK(oc_scene_closest_f32(scene, &q, one, 0));
    INVALID(oc_scene_closest_f32(NULL, &q, one, 0));
    INVALID(oc_scene_closest_f32(scene, NULL, one, 0));
    INVALID(oc_scene_closest_f32(scene, &q, NULL, 0));
    INVALID(oc_scene_closest_f32(scene, &q, one, sizeof *one - 1));
    INVALID(oc_scene_any_f32(NULL, &q, any, 0));
    INVALID(oc_scene_any_f32(scene, NULL, any, 0));
    INVALID(oc_scene_any_f32(scene, &q, NULL, 0));
    q.want = OC_WANT_POSITION;
    INVALID(oc_scene_closest_f32(scene, &q, one, 0));
    q.want = 0, q.flags = 64;
    INVALID(oc_scene_closest_f32(scene, &q, one, 0));
    q.flags = 0, q.reserved = 1;
    INVALID(oc_scene_closest_f32(scene, &q, one, 0));
    q.reserved = 0, q.stride = sizeof(oc_ray_f32) - 1;
    INVALID(oc_scene_closest_f32(scene, &q, one, 0));
    q.stride = 0, q.rays = NULL, q.columns = &soa;
    soa.direction[2] = NULL;
    INVALID(oc_scene_closest_f32(scene, &q, one, 0));

    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return 0;
}
