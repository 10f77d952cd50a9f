/* Builds a model from memory and lists the parts that clash, and how deep: a pipe through a wall, a bolt that touches its
 * hole, a box near another, and a box in a box. Fails if these are not found, or others are.
 *
 *     09_clashes MODEL.oc
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

enum { WALL, PIPE, PLATE, BOLT, BENCH, NEAR, CRATE, CONTENT, LONELY, PARTS };
static const char *const names[PARTS] = {"wall", "pipe", "plate", "bolt", "bench", "box near it", "crate",
                                         "box inside of it", "lonely box"};

static const double clearance = 0.5, tolerance = 0.001;
static const struct {
    oc_clash_kind kind;
    uint64_t first, second;
    double depth, distance;
} expected[] = {
    {OC_CLASH_PIERCING, WALL, PIPE, 0.5, 0}, /* half of the wall */
    {OC_CLASH_TOUCHING, PLATE, BOLT, 0, 0},
    {OC_CLASH_CLEARANCE, BENCH, NEAR, 0, 0.25},
    {OC_CLASH_CONTAINED, CRATE, CONTENT, 2, 0},
};
enum { EXPECTED = sizeof expected / sizeof *expected };

static const float square[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
/* Four of its corners are in the sides of the square. */
static const float octagon[8][2] = {{1, 0}, {0.75f, 0.75f}, {0, 1}, {-0.75f, 0.75f},
                                    {-1, 0}, {-0.75f, -0.75f}, {0, -1}, {0.75f, -0.75f}};

static void add_part(oc_build *build, uint64_t id, float (*corners)[3], uint32_t corner_count, uint32_t (*faces)[3],
                     uint32_t face_count) {
    oc_part part;
    oc_triangles triangles;
    OC_INIT(&part);
    OC_INIT(&triangles);
    part.id = id;
    part.name = names[id];
    triangles.part = id;
    triangles.positions = corners;
    triangles.position_count = corner_count;
    triangles.indices = faces;
    triangles.index = OC_INDEX_U32;
    triangles.index_count = 3 * (uint64_t)face_count;
    CHECK(oc_build_add_part(build, &part));
    CHECK(oc_build_add_triangles(build, &triangles));
}

static uint32_t add_face(uint32_t (*faces)[3], uint32_t at, uint32_t a, uint32_t b, uint32_t c) {
    faces[at][0] = a, faces[at][1] = b, faces[at][2] = c;
    return at + 1;
}

/* Adds a closed prism around the line x, y = 0, from z = low to z = high. */
static void add_prism(oc_build *build, uint64_t id, const float (*shape)[2], uint32_t n, float radius, float x,
                      float low, float high) {
    float corners[16][3];
    uint32_t faces[28][3], count = 0;
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t j = (i + 1) % n;
        corners[i][0] = corners[n + i][0] = x + radius * shape[i][0];
        corners[i][1] = corners[n + i][1] = radius * shape[i][1];
        corners[i][2] = low, corners[n + i][2] = high;
        count = add_face(faces, count, i, j, n + j);
        count = add_face(faces, count, i, n + j, n + i);
        if (i < 2) continue;
        count = add_face(faces, count, 0, i, i - 1);
        count = add_face(faces, count, n, n + i - 1, n + i);
    }
    add_part(build, id, corners, 2 * n, faces, count);
}

/* Adds a closed square plate with a square hole around the line x, y = 0. */
static void add_plate(oc_build *build, uint64_t id, float radius, float hole, float x, float low, float high) {
    float corners[16][3];
    uint32_t faces[32][3], count = 0;
    for (uint32_t i = 0; i < 16; i++) { /* outer low, outer high, inner low, inner high */
        const float r = i < 8 ? radius : hole;
        corners[i][0] = x + r * square[i % 4][0];
        corners[i][1] = r * square[i % 4][1];
        corners[i][2] = i / 4 % 2 ? high : low;
    }
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t j = (i + 1) % 4;
        const uint32_t quads[4][4] = {
            {i, j, 4 + j, 4 + i}, {8 + j, 8 + i, 12 + i, 12 + j}, {4 + i, 4 + j, 12 + j, 12 + i}, {j, i, 8 + i, 8 + j}};
        for (int k = 0; k < 4; k++) {
            count = add_face(faces, count, quads[k][0], quads[k][1], quads[k][2]);
            count = add_face(faces, count, quads[k][0], quads[k][2], quads[k][3]);
        }
    }
    add_part(build, id, corners, 16, faces, count);
}

static void build_model(oc_context *context, const char *path) {
    oc_build *build;
    oc_job *job;
    oc_progress progress;
    OC_INIT(&progress);
    CHECK(oc_build_create(context, NULL, &build));
    add_prism(build, WALL, square, 4, 3, 0, -0.5f, 0.5f);
    add_prism(build, PIPE, octagon, 8, 0.5f, 0, -4, 4);
    add_plate(build, PLATE, 3, 1, 10, 0, 1);
    add_prism(build, BOLT, octagon, 8, 1, 10, -1, 2);
    add_prism(build, BENCH, square, 4, 3, 20, 0, 1);
    add_prism(build, NEAR, square, 4, 1, 20, 1.25f, 3);
    add_prism(build, CRATE, square, 4, 3, 30, 0, 6);
    add_prism(build, CONTENT, square, 4, 1, 30, 2, 4);
    add_prism(build, LONELY, square, 4, 1, 40, 0, 2);
    CHECK(oc_build_start(build, path, &job));
    CHECK(oc_job_wait(job, OC_FOREVER, &progress));
    check(progress.error, "the build");
    oc_job_release(job);
    oc_build_release(build);
}

static const char *verb(oc_clash_kind kind) {
    switch (kind) {
    case OC_CLASH_HARD: return "reaches into";
    case OC_CLASH_PIERCING: return "goes through, or is pierced by,";
    case OC_CLASH_TOUCHING: return "touches";
    case OC_CLASH_CONTAINED: return "holds, or is inside of,";
    case OC_CLASH_CLEARANCE: return "is near";
    default: return "clashes with";
    }
}

/* Returns the index of a clash in `expected`, or EXPECTED. */
static int index_of(const oc_clash *one) {
    for (int i = 0; i < EXPECTED; i++) {
        const double off = one->distance - expected[i].distance + one->depth - expected[i].depth;
        if (one->part[0] == expected[i].first && one->part[1] == expected[i].second && one->kind == expected[i].kind &&
            off <= one->error + 1e-12 && -off <= one->error + 1e-12 && one->error <= 2 * tolerance && !one->open) {
            return i;
        }
    }
    return EXPECTED;
}

/* Prints the clashes that wait, and counts each; the last count is of those that are not expected. */
static void take(const oc_job *job, int counts[EXPECTED + 1]) {
    oc_clash some[64];
    uint64_t count;
    do {
        CHECK(oc_job_take_clashes(job, some, 64, &count));
        for (uint64_t i = 0; i < count; i++) {
            const oc_clash *one = &some[i];
            const double *at = one->first_point;
            printf("the %s %s the %s at (%g, %g, %g), depth %g, distance %g\n", names[one->part[0]], verb(one->kind),
                   names[one->part[1]], at[0], at[1], at[2], one->depth, one->distance);
            counts[index_of(one)]++;
        }
    } while (count == 64);
}

int main(int argc, char **argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: %s MODEL.oc\n", argv[0]);
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
    build_model(context, argv[1]);
    CHECK(oc_model_open(context, argv[1], &model));
    CHECK(oc_scene_create(context, &scene));
    CHECK(oc_scene_add_instance(scene, model, 1, NULL));
    CHECK(oc_scene_commit(scene));

    desc.clearance = clearance;
    desc.tolerance = tolerance;
    CHECK(oc_scene_clash_start(scene, &desc, &job));
    int counts[EXPECTED + 1] = {0};
    do { /* a program with a window would draw between the calls */
        CHECK(oc_job_wait(job, 20, &progress));
        take(job, counts);
    } while (progress.state == OC_STATE_RUNNING);
    check(progress.error, "the search");
    CHECK(oc_job_clash_summary(job, &summary));
    int is_right = summary.pairs == EXPECTED && counts[EXPECTED] == 0;
    for (int i = 0; i < EXPECTED; i++) is_right &= counts[i] == 1;
    printf("%llu pairs of parts clash%s\n", (unsigned long long)summary.pairs, is_right ? "" : ": not those expected");

    oc_job_release(job);
    oc_scene_release(scene);
    oc_model_release(model);
    oc_context_release(context);
    return is_right ? 0 : 1;
}
