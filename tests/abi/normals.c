/* Vertices of the host, with positions, normals and colours interleaved: a hit has the interpolated normal, and a pixel
   the interpolated colour. */
#include "check.h"

#include <math.h>
#include <string.h>

typedef struct vertex {
    float position[3], normal[3], colour[3], uv[2];
} vertex;

/* A quarter of a cylinder around z, as one flat square: its normals say what it stands for. */
static const float R = 0.70710678f;

int main(int argc, char **argv) {
    CHECK(argc == 2);
    char path[4096];
    snprintf(path, sizeof path, "%s/normals.oc", argv[1]);
    oc_context *context;
    oc_build *build;
    oc_job *job;
    oc_model *model;
    oc_scene *scene;
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    OK(oc_build_create(context, NULL, &build));
    oc_part part;
    OC_INIT(&part);
    part.id = 5;
    OK(oc_build_add_part(build, &part));
    const vertex square[4] = {
        {{-1, 0, -1}, {-R, -R, 0}, {1, 0, 0}, {0, 0}},
        {{1, 0, -1}, {3 * R, -3 * R, 0}, {0, 1, 0}, {0, 0}},
        {{1, 0, 1}, {R, -R, 0}, {0, 1, 0}, {0, 0}},
        {{-1, 0, 1}, {-R, -R, 0}, {1, 0, 0}, {0, 0}},
    };
    const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    oc_triangles triangles;
    OC_INIT(&triangles);
    triangles.part = 5;
    triangles.positions = square[0].position;
    triangles.position_count = 4;
    triangles.position_stride = sizeof(vertex);
    triangles.normals = square[0].normal;
    triangles.normal_stride = sizeof(vertex);
    triangles.position_colours = square[0].colour;
    triangles.position_colour_stride = sizeof(vertex);
    triangles.indices = indices;
    triangles.index = OC_INDEX_U32;
    triangles.index_count = 6;
    OK(oc_build_add_triangles(build, &triangles));
    OK(oc_build_start(build, path, &job));
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    oc_build_report report;
    OC_INIT(&report);
    OK(oc_job_build_report(job, &report));
    CHECK(report.unusable_normals == 0);
    oc_job_release(job);
    oc_build_release(build);

    OK(oc_model_open(context, path, &model));
    oc_model_info info;
    OC_INIT(&info);
    OK(oc_model_get_info(model, &info));
    CHECK(info.has_normals == 1 && info.has_colours == 1);
    OK(oc_scene_create(context, &scene));
    OK(oc_scene_add_instance(scene, model, 1, NULL));
    OK(oc_scene_commit(scene));
    oc_query query;
    OC_INIT(&query);
    oc_ray ray;
    memset(&ray, 0, sizeof ray);
    oc_hit hit;
    for (int side = -1; side <= 1; side += 2) {
        for (int i = -9; i <= 9; i++) {
            ray.origin[0] = 0.1 * i, ray.origin[1] = 2.0 * side, ray.origin[2] = 0.3;
            ray.direction[1] = (float)-side;
            query.want = OC_WANT_ALL | OC_WANT_SHADING_NORMAL;
            query.rays = &ray;
            query.count = 1;
            OK(oc_scene_closest(scene, &query, &hit, 0));
            CHECK(hit.kind == OC_HIT_EXACT && hit.normal[1] == (float)side);
            /* Linear between the corners, then of length 1, on the side of the ray. */
            const float x = 0.1f * (float)i, length = sqrtf(x * x + 1);
            CHECK(fabsf(hit.shading_normal[0] - x / length * (float)-side) < 0.01f);
            CHECK(fabsf(hit.shading_normal[1] - (float)side / length) < 0.01f);
            query.want = 0; /* all but this one */
            OK(oc_scene_closest(scene, &query, &hit, 0));
            CHECK(hit.shading_normal[0] == 0 && hit.shading_normal[1] == 0);
        }
    }

    oc_frame_desc desc;
    OC_INIT(&desc);
    desc.width = desc.height = 32;
    desc.buffers = 1u << OC_BUFFER_SHADING_NORMAL | 1u << OC_BUFFER_NORMAL | 1u << OC_BUFFER_COLOUR_LINEAR;
    oc_frame *frame;
    OK(oc_frame_create(context, &desc, &frame));
    oc_camera camera;
    OC_INIT(&camera);
    camera.kind = OC_CAMERA_ORTHOGRAPHIC;
    camera.eye[1] = -4, camera.up[2] = 1, camera.height = 2;
    oc_frame_settings settings;
    OC_INIT(&settings);
    settings.ambient = 1; /* and no lights, so that nothing shines */
    OK(oc_scene_set_lights(scene, NULL, 0, 0));
    OK(oc_scene_commit(scene));
    OK(oc_frame_request(frame, scene, &camera, &settings));
    OK(oc_frame_wait(frame, OC_FOREVER, NULL));
    oc_pixels shading, flat, colour;
    OC_INIT(&shading);
    OC_INIT(&flat);
    OC_INIT(&colour);
    OK(oc_frame_map(frame, OC_BUFFER_SHADING_NORMAL, &shading));
    OK(oc_frame_map(frame, OC_BUFFER_NORMAL, &flat));
    OK(oc_frame_map(frame, OC_BUFFER_COLOUR_LINEAR, &colour));
    CHECK(shading.format == OC_FORMAT_F32X3);
    for (int i = 0; i < 32; i++) {
        const float x = ((float)i + 0.5f) / 16 - 1, length = sqrtf(x * x + 1);
        const float *own = (const float *)shading.data + 3 * (16 * 32 + i);
        const float *rgba = (const float *)colour.data + 4 * (16 * 32 + i);
        CHECK(fabsf(own[0] - x / length) < 0.02f && fabsf(own[1] + 1 / length) < 0.02f);
        CHECK(((const float *)flat.data)[3 * (16 * 32 + i) + 1] == -1);
        CHECK(fabsf(rgba[0] / (rgba[0] + rgba[1]) - (1 - x) / 2) < 0.05f);
    }
    oc_mapping_release(shading.mapping);
    oc_mapping_release(flat.mapping);
    oc_mapping_release(colour.mapping);
    oc_frame_release(frame);
    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return 0;
}
