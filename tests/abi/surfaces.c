/* The cage of a subdivision surface in both structures: rays meet the same points, and under patch the primitive id is
   the face. Argument: an empty folder. */
#include "check.h"

#include <math.h>
#include <string.h>

#define SIDE 12
#define COUNT (6 * SIDE * SIDE)

/* A cube of two parts. Its faces: -z, +z, -y, +x, +y, -x. */
static const double corners[24] = {-1, -1, -1, 1, -1, -1, 1, 1, -1, -1, 1, -1, -1, -1, 1, 1, -1, 1, 1, 1, 1, -1, 1, 1};
static const uint32_t faces[24] = {0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7};
static const uint64_t parts[6] = {7, 7, 7, 8, 8, 8};
static const int axes[6] = {2, 2, 1, 0, 1, 0}, signs[6] = {-1, 1, -1, 1, 1, -1};

static oc_model *build(oc_context *context, const char *path, oc_structure structure) {
    oc_build *build;
    oc_build_desc desc;
    OC_INIT(&desc);
    desc.structure = structure;
    desc.surface_level = 4;
    desc.crease_angle = -1; /* surfaces keep their normals */
    OK(oc_build_create(context, &desc, &build));
    oc_part part;
    OC_INIT(&part);
    for (part.id = 7; part.id <= 8; part.id++)
        OK(oc_build_add_part(build, &part));
    oc_cage cage;
    OC_INIT(&cage);
    cage.positions = corners, cage.position_count = 8, cage.scalar = OC_SCALAR_F64;
    cage.indices = faces, cage.index_count = 24, cage.face_count = 6, cage.face_parts = parts;
    OK(oc_build_add_cage(build, &cage));
    oc_job *job;
    oc_progress progress;
    oc_build_report report;
    OC_INIT(&progress);
    OC_INIT(&report);
    OK(oc_build_start(build, path, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    OK(oc_job_build_report(job, &report));
    CHECK(report.triangles_kept == 6 * 2 * 256);
    oc_job_release(job);
    oc_build_release(build);
    oc_model *model;
    oc_model_info info;
    OC_INIT(&info);
    OK(oc_model_open(context, path, &model));
    OK(oc_model_get_info(model, &info));
    CHECK(info.triangles_stored == 6 * 2 * 256 && info.parts == 2 && info.has_normals == 1);
    return model;
}

/* Rays towards each face, on a grid that keeps clear of its border. */
static void aim(oc_ray *rays) {
    memset(rays, 0, COUNT * sizeof *rays);
    for (int i = 0; i < COUNT; i++) {
        const int face = i / (SIDE * SIDE), axis = axes[face];
        rays[i].origin[axis] = 3.0 * signs[face];
        rays[i].direction[axis] = (float)-signs[face];
        rays[i].origin[(axis + 1) % 3] = (i % SIDE - 5.3) * 0.08;
        rays[i].origin[(axis + 2) % 3] = (i / SIDE % SIDE - 5.6) * 0.08;
        rays[i].t_max = INFINITY;
        rays[i].mask = UINT32_MAX;
    }
}

/* The parameters in a picture are those of the ray through each pixel. */
static void pixels(oc_context *context, oc_scene *scene) {
    enum { W = 24, H = 16 };
    static float target[H][W][2];
    static oc_ray rays[W * H];
    static oc_hit hits[W * H];
    oc_camera camera;
    OC_INIT(&camera);
    camera.eye[0] = 3, camera.eye[1] = -4, camera.eye[2] = 2, camera.up[2] = 1, camera.fov_y = 20;
    oc_target memory = {target, sizeof target, 0, OC_BUFFER_UV, 0};
    oc_frame_desc desc;
    OC_INIT(&desc);
    desc.width = W, desc.height = H, desc.buffers = 1u << OC_BUFFER_UV, desc.targets = &memory, desc.target_count = 1;
    oc_frame *frame;
    oc_progress progress;
    oc_pixels mapped;
    OC_INIT(&progress);
    OC_INIT(&mapped);
    OK(oc_frame_create(context, &desc, &frame));
    OK(oc_frame_request(frame, scene, &camera, NULL));
    OK(oc_frame_wait(frame, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    OK(oc_frame_map(frame, OC_BUFFER_UV, &mapped));
    CHECK(mapped.format == OC_FORMAT_F32X2 && mapped.row_pitch == 8 * W);
    CHECK(!memcmp(mapped.data, target, sizeof target));
    for (int i = 0; i < W * H; i++) {
        OK(oc_camera_ray(&camera, W, H, i % W + 0.5, i / W + 0.5, &rays[i]));
        rays[i].cone_a = rays[i].cone_b = 0;
    }
    oc_query query;
    OC_INIT(&query);
    query.rays = rays, query.count = W * H;
    OK(oc_scene_closest(scene, &query, hits, 0));
    int met = 0, differ = 0;
    for (int i = 0; i < W * H; i++) {
        const float *uv = target[i / W][i % W];
        differ += fabsf(uv[0] - hits[i].uv[0]) > 1e-3f || fabsf(uv[1] - hits[i].uv[1]) > 1e-3f;
        met += hits[i].kind == OC_HIT_EXACT && uv[0] > 0;
    }
    /* Rays through edges may meet either triangle. */
    CHECK(met > W * H / 8 && differ <= 1);
    oc_mapping_release(mapped.mapping);
    oc_frame_release(frame);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    static oc_ray rays[COUNT];
    static oc_hit hits[2][COUNT];
    static oc_triangle triangles[2][COUNT];
    static oc_surface_point points[2][COUNT];
    static const oc_structure structures[2] = {OC_STRUCTURE_BVH, OC_STRUCTURE_PATCH};
    oc_context *context;
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    aim(rays);
    for (int i = 0; i < 2; i++) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%d.oc", argv[1], i);
        oc_model *model = build(context, path, structures[i]);
        oc_scene *scene;
        OK(oc_scene_create(context, &scene));
        OK(oc_scene_add_instance(scene, model, 1, NULL));
        OK(oc_scene_commit(scene));
        oc_query query;
        OC_INIT(&query);
        query.rays = rays;
        query.count = COUNT;
        query.want = OC_WANT_ALL | OC_WANT_SHADING_NORMAL;
        OK(oc_scene_closest(scene, &query, hits[i], 0));
        OK(oc_scene_triangles(scene, hits[i], COUNT, 0, triangles[i]));
        OK(oc_scene_evaluate(scene, hits[i], COUNT, 0, 0, points[i], 0));
        pixels(context, scene);
        oc_scene_release(scene);
        oc_model_release(model);
    }
    for (int i = 0; i < COUNT; i++) {
        const uint64_t face = (uint64_t)(i / (SIDE * SIDE));
        const oc_hit *flat = &hits[0][i], *patch = &hits[1][i];
        CHECK(flat->kind == OC_HIT_EXACT && patch->kind == OC_HIT_EXACT);
        CHECK(fabs(flat->t - patch->t) < 1e-6);
        CHECK(flat->part == parts[face] && patch->part == parts[face]);
        CHECK(flat->prim / 512 == face && patch->prim == face);
        for (int k = 0; k < 3; k++)
            CHECK(fabsf(flat->shading_normal[k] - patch->shading_normal[k]) < 0.02f);
        /* Of all triangles of the face, the one that was hit. */
        const oc_triangle *a = &triangles[0][i], *b = &triangles[1][i];
        const oc_surface_point *p = &points[0][i], *q = &points[1][i];
        CHECK(p->kind == OC_EVALUATED_TRIANGLE && q->kind != OC_EVALUATED_NOTHING && q->kind <= OC_EVALUATED_TRIANGLE);
        CHECK(p->corner == 0 && q->corner == 0);
        for (int k = 0; k < 3; k++) {
            CHECK(fabs(p->position[k] - flat->position[k]) < 1e-6 && fabs(q->position[k] - patch->position[k]) < 0.01);
            /* Edges of the triangle, whose weights are the parameters. */
            CHECK(fabs(p->du[k] - (a->corners[3 + k] - a->corners[k])) < 1e-6);
            CHECK(fabs(p->dv[k] - (a->corners[6 + k] - a->corners[k])) < 1e-6);
            CHECK(fabs(p->normal[k] - q->normal[k]) < 0.02);
        }
        /* The cube is round: it bends away from its outer normal, in both structures alike. */
        CHECK(p->normal[axes[face]] * signs[face] > 0.5);
        for (int k = 0; k < 2; k++)
            CHECK(q->curvatures[k] < 0.05 && fabs(p->curvatures[k] - q->curvatures[k]) < 0.35);
        CHECK(b->prim == face && b->part == parts[face]);
        for (int corner = 0; corner < 3; corner++) {
            double least = INFINITY;
            for (int other = 0; other < 3; other++) {
                double away = 0;
                for (int k = 0; k < 3; k++)
                    away = fmax(away, fabs(a->corners[3 * corner + k] - b->corners[3 * other + k]));
                least = fmin(least, away);
            }
            CHECK(least < 1e-6);
        }
    }
    oc_context_release(context);
    return 0;
}
