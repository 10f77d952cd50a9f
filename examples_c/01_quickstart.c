/* Converts a mesh file to a model, renders a picture, and picks the part in its centre.
 *
 *     01_quickstart MESH MODEL.oc PICTURE.png [FIRST.png]
 *
 * FIRST.png is the first picture after the model was opened, long before the whole model is read.
 */
#define _POSIX_C_SOURCE 200112L
#include <outcrop.h>

#include "png.h"

#include <math.h>
#include <time.h>
#include <unistd.h>

/* Prints the reason and exits if a call has failed. */
static void check(oc_status status, const char *call) {
    if (status == OC_STATUS_OK) return;
    fprintf(stderr, "%s: %s: %s\n", call, oc_status_name(status), oc_last_error());
    exit(1);
}
#define CHECK(call) check((call), #call)

static void bar(const char *what, const oc_progress *p) {
    char line[31];
    const int filled = (int)(p->fraction * 30);
    if (!isatty(2)) return;
    memset(line, ' ', 30);
    memset(line, '#', (size_t)filled);
    line[30] = 0;
    fprintf(stderr, "\r%-10s [%s] %3.0f %% %s", what, line, p->fraction * 100, p->state == OC_STATE_RUNNING ? "" : "\n");
}

/* Builds a model from a mesh file. The job runs in the background; this function shows its progress. */
static void build_model(oc_context *context, const char *mesh, const char *out) {
    oc_build *build;
    oc_job *job;
    oc_progress progress;
    oc_build_report report;
    OC_INIT(&progress);
    OC_INIT(&report);
    CHECK(oc_build_create(context, NULL, &build));
    CHECK(oc_build_add_file(build, mesh));
    CHECK(oc_build_start(build, out, &job));
    do {
        CHECK(oc_job_wait(job, 100, &progress));
        bar("building", &progress);
    } while (progress.state == OC_STATE_RUNNING);
    check(progress.error, mesh);
    CHECK(oc_job_build_report(job, &report));
    printf("built %s: %llu triangles in %llu parts, %.1f MB, %.1f s\n", out, (unsigned long long)report.triangles_kept,
           (unsigned long long)report.parts, (double)report.file_bytes * 1e-6,
           report.seconds_read + report.seconds_build + report.seconds_write);
    oc_job_release(job);
    oc_build_release(build);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Prints the accuracy of the present picture. */
static void say_how_true(const oc_frame_accuracy *a) {
    const double share = 100 / (double)a->pixels_total;
    printf("  %5.2f s, picture %u: %.0f %% exact, %.0f %% as fine as asked, %.0f %% coarser; error %.2f pixels (worst %.1f), %.1f MB in "
           "memory, %.1f MB wanted",
           a->seconds, (unsigned)a->pictures, share * (double)a->pixels_exact, share * (double)a->pixels_lod,
           share * (double)a->pixels_missing, (double)a->mean_error, (double)a->worst_error, (double)a->bytes_resident * 1e-6,
           (double)a->bytes_wanted * 1e-6);
    if (a->state == OC_STATE_RUNNING && isfinite(a->seconds_to_go)) printf(", about %.1f s to go", a->seconds_to_go);
    if (a->state == OC_STATE_COMPLETE_WITHIN_BUDGET) printf("; all that fits, as at %.2f pixels of error", (double)a->effective_poe);
    printf("\n");
}

static void write_picture(const char *path, const oc_pixels *p) {
    if (png_write(path, (const unsigned char *)p->data, p->width, p->height, (size_t)p->row_pitch)) {
        perror(path);
        exit(1);
    }
}

/* Waits until the request has ended, and prints the accuracy meanwhile. Returns the first picture, mapped. */
static oc_pixels watch(oc_frame *frame) {
    oc_pixels first;
    oc_progress progress;
    oc_frame_accuracy accuracy;
    double said = 0;
    OC_INIT(&first);
    OC_INIT(&progress);
    OC_INIT(&accuracy);
    do {
        CHECK(oc_frame_wait(frame, 2, &progress));
        CHECK(oc_frame_get_accuracy(frame, &accuracy));
        if (!accuracy.pictures) continue;
        /* A window would show it now. It does not change while it is mapped. */
        if (!first.mapping) CHECK(oc_frame_map(frame, OC_BUFFER_COLOUR_SRGB8, &first));
        if (said == 0 || accuracy.seconds > 1.5 * said + 0.1) {
            said = accuracy.seconds;
            say_how_true(&accuracy);
        }
    } while (progress.state == OC_STATE_RUNNING);
    if (progress.state == OC_STATE_FAILED) check(progress.error, "rendering");
    if (progress.error) printf("not all could be read: %s\n", oc_last_error());
    CHECK(oc_frame_get_accuracy(frame, &accuracy));
    say_how_true(&accuracy);
    return first;
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out = a x b, normalised */
static void unit_cross(const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
    const double length = sqrt(dot(out, out));
    for (int i = 0; i < 3; i++) out[i] /= length;
}

/* Moves the camera along its view direction so that the model's bounding box just fits the picture. */
static void fit(oc_camera *camera, const oc_model_info *info, double aspect) {
    const double tall = tan(camera->fov_y * 3.141592653589793 / 360) * 0.95, wide = tall * aspect;
    double view[3], right[3], up[3], distance = 0;
    for (int i = 0; i < 3; i++) view[i] = camera->at[i] - camera->eye[i];
    unit_cross(view, camera->up, right);
    unit_cross(right, view, up);
    unit_cross(up, right, view); /* view is unit now */
    for (int corner = 0; corner < 8; corner++) {
        double p[3];
        for (int i = 0; i < 3; i++) p[i] = (corner >> i & 1 ? info->bounds_max : info->bounds_min)[i] - camera->at[i];
        const double need = fmax(fabs(dot(p, right)) / wide, fabs(dot(p, up)) / tall) - dot(p, view);
        distance = fmax(distance, need);
    }
    for (int i = 0; i < 3; i++) camera->eye[i] = camera->at[i] - distance * view[i];
}

/* Creates a scene with the model and two lights: one over the viewer's left shoulder, one at the eye. */
static oc_scene *make_scene(oc_context *context, const oc_model *model, const oc_camera *camera) {
    oc_scene *scene;
    oc_light lights[2];
    double view[3], right[3];
    memset(lights, 0, sizeof lights);
    for (int i = 0; i < 3; i++) view[i] = camera->at[i] - camera->eye[i];
    unit_cross(view, camera->up, right);
    const double length = sqrt(dot(view, view));
    for (int i = 0; i < 3; i++) lights[0].vector[i] = view[i] + length * (0.6 * right[i] - 0.8 * camera->up[i]);
    lights[0].kind = OC_LIGHT_DIRECTIONAL;
    lights[0].shadows = 1;
    lights[0].intensity = 0.8f;
    lights[1].kind = OC_LIGHT_HEAD;
    lights[1].intensity = 0.25f;

    CHECK(oc_scene_create(context, &scene));
    CHECK(oc_scene_add_instance(scene, model, 1, NULL));
    CHECK(oc_scene_set_lights(scene, lights, 2, 0));
    CHECK(oc_scene_commit(scene));
    return scene;
}

static void say_what_is_at(const oc_frame *frame, const oc_model *model, uint32_t x, uint32_t y) {
    oc_hit hit;
    oc_part_info part;
    uint32_t index;
    OC_INIT(&part);
    CHECK(oc_frame_pick(frame, x, y, &hit));
    if (hit.kind == OC_HIT_MISS) {
        printf("at (%u, %u): nothing\n", (unsigned)x, (unsigned)y);
        return;
    }
    CHECK(oc_model_find_part(model, hit.part, &index));
    CHECK(oc_model_get_part(model, index, &part));
    printf("at (%u, %u): part %llu \"%s\", triangle %llu, at (%g, %g, %g), distance %g, exact to %.2g\n", (unsigned)x,
           (unsigned)y, (unsigned long long)hit.part, part.name, (unsigned long long)hit.prim, hit.position[0],
           hit.position[1], hit.position[2], hit.t, (double)hit.error);
}

int main(int argc, char **argv) {
    if (argc != 4 && argc != 5) {
        fprintf(stderr, "usage: %s MESH MODEL.oc PICTURE.png [FIRST.png]\n", argv[0]);
        return 2;
    }
    oc_context *context;
    oc_context_desc threads;
    OC_INIT(&threads);
    threads.threads = OC_ALL_THREADS;
    CHECK(oc_context_create(OC_HEADER_VERSION, &threads, &context));
    build_model(context, argv[1], argv[2]);

    oc_model *model;
    oc_model_info info;
    oc_camera camera;
    OC_INIT(&info);
    OC_INIT(&camera);
    const double begun = now();
    CHECK(oc_model_open(context, argv[2], &model));
    printf("opened in %.3f s\n", now() - begun);
    CHECK(oc_model_get_info(model, &info));
    CHECK(oc_model_get_view(model, 0, &camera));
    if (info.triangles_placed) fit(&camera, &info, 1280.0 / 800);
    oc_scene *scene = make_scene(context, model, &camera);

    /* A window would make a new request whenever the camera moves, and show each complete picture. */
    oc_frame *frame;
    oc_frame_desc size;
    oc_frame_settings settings;
    OC_INIT(&size);
    OC_INIT(&settings);
    size.width = 1280;
    size.height = 800;
    settings.samples = 9;
    CHECK(oc_frame_create(context, &size, &frame));
    CHECK(oc_frame_request(frame, scene, &camera, &settings));
    oc_pixels first = watch(frame), last;
    OC_INIT(&last);
    CHECK(oc_frame_map(frame, OC_BUFFER_COLOUR_SRGB8, &last));
    write_picture(argv[3], &last);
    if (argc == 5) write_picture(argv[4], &first);
    oc_mapping_release(first.mapping);
    oc_mapping_release(last.mapping);
    say_what_is_at(frame, model, size.width / 2, size.height / 2);

    oc_frame_release(frame);
    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return 0;
}
