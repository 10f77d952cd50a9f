/* Every entry point with NULLs, garbage sizes, unknown numbers, objects of the wrong kind and calls in the wrong
 * order: a status each, never a crash. The test runs it under AddressSanitizer, and makes sure that every function of
 * the header occurs here. */
#include "check.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* Struct sizes that no header ever had; the memory behind them is as small as the struct, so that a read or write
 * past its end is noticed. */
static const uint32_t garbage_sizes[] = {0, 1, 3, 4, 7, 12, 1000000, 0x7fffffff, 0xffffffff};
enum { SIZES = sizeof garbage_sizes / sizeof *garbage_sizes };

/* Calls with a struct of each garbage size, alone in its own allocation. */
#define GARBAGE_SIZES(type, call)                                                              \
    do {                                                                                       \
        for (int size_ = 0; size_ < SIZES; size_++) {                                          \
            type *s = (type *)malloc(sizeof(type));                                            \
            OC_INIT(s);                                                                        \
            s->struct_size = garbage_sizes[size_];                                             \
            INVALID(call);                                                                     \
            CHECK(strstr(oc_last_error(), #type ".struct_size"));                              \
            free(s);                                                                           \
        }                                                                                      \
    } while (0)

static const char *dir;
static const char *file(const char *name) {
    static char path[2][4096];
    static int turn;
    turn = !turn;
    snprintf(path[turn], sizeof path[turn], "%s/%s", dir, name);
    return path[turn];
}

static uint32_t read_fails(void *user, uint64_t offset, void *buffer, uint64_t bytes) {
    (void)user, (void)offset, (void)buffer, (void)bytes;
    return 5;
}
static uint32_t read_zeros(void *user, uint64_t offset, void *buffer, uint64_t bytes) {
    (void)user, (void)offset;
    memset(buffer, 0, (size_t)bytes);
    return 0;
}
static void count_close(void *user) {
    ++*(int *)user;
}
static void submit(void *user, oc_run_fn run, void *task) {
    (void)user;
    run(task);
}
static void wake(void *user) {
    ++*(int *)user;
}

/* A job, and when it was released in its own wake function. */
typedef struct { oc_job *job; int released; } own_job;
static void release_own(void *user) {
    own_job *own = (own_job *)user;
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_job_wait(own->job, OC_FOREVER, &progress)); /* it has ended: nothing to wait for */
    CHECK(progress.state == OC_STATE_DONE || progress.state == OC_STATE_CANCELLED);
    oc_job_release(own->job);
    own->released++;
}

static int log_lines[5];
static void count_lines(void *user, oc_log_level level, const char *message) {
    CHECK(user == log_lines && level >= OC_LOG_ERROR && level <= OC_LOG_DEBUG && *message);
    log_lines[level]++;
}

/* Something that is no object of ours. */
static uint64_t junk[64];
#define JUNK(type) ((type *)(void *)junk)

static void versions_and_messages(void) {
    CHECK(oc_version() == OC_HEADER_VERSION);
    CHECK(OC_HEADER_VERSION == OC_VERSION_MAJOR * 10000 + OC_VERSION_MINOR * 100 + OC_VERSION_PATCH);
    CHECK(oc_last_error() && !*oc_last_error());
    CHECK(!strcmp(oc_status_name(OC_STATUS_OK), "OC_STATUS_OK"));
    CHECK(!strcmp(oc_status_name(12345), "unknown status"));
    CHECK(oc_last_error_need() == 0);
    char three[3] = {1, 2, 3};
    oc_init(NULL, 100);
    oc_init(three, 3);
    CHECK(three[0] == 1 && three[2] == 3);
}

static oc_context *contexts(void) {
    oc_context *c = NULL;
    INVALID(oc_context_create(OC_HEADER_VERSION, NULL, NULL));
    EXPECT(OC_STATUS_VERSION_MISMATCH, oc_context_create(OC_HEADER_VERSION + 100, NULL, &c));
    CHECK(strstr(oc_last_error(), "0.2.0"));
    EXPECT(OC_STATUS_VERSION_MISMATCH, oc_context_create(0, NULL, &c));
    EXPECT(OC_STATUS_VERSION_MISMATCH, oc_context_create(0xffffffff, NULL, &c));
    CHECK(c == NULL);
    GARBAGE_SIZES(oc_context_desc, oc_context_create(OC_HEADER_VERSION, s, &c));
    oc_context_desc desc;
    oc_executor executor;
    OC_INIT(&desc);
    OC_INIT(&executor);
    desc.executor = &executor;
    INVALID(oc_context_create(OC_HEADER_VERSION, &desc, &c)); /* no submit */
    desc.executor = NULL, desc.threads = 99999;
    INVALID(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    CHECK(strstr(oc_last_error(), "oc_context_desc.threads is 99999") && strstr(oc_last_error(), "at most"));
    desc.executor = &executor, desc.threads = 0;
    executor.submit = submit;
    INVALID(oc_context_create(OC_HEADER_VERSION, &desc, &c)); /* no concurrency */
    GARBAGE_SIZES(oc_executor, (desc.executor = s, oc_context_create(OC_HEADER_VERSION, &desc, &c)));
    OC_INIT(&desc);
    desc.instruction_set = 4;
    INVALID(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    desc.instruction_set = 0, desc.flags = 4;
    INVALID(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    desc.flags = OC_CONTEXT_NO_READ_AHEAD, desc.memory_budget = UINT64_MAX; /* more than there is */
    INVALID(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    CHECK(strstr(oc_last_error(), "18446744073709551615"));
    CHECK(c == NULL);
    desc.memory_budget = 0, desc.instruction_set = OC_INSTRUCTION_SET_BASELINE;
    uint64_t set = 77;
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    OK(oc_context_property(c, OC_PROPERTY_INSTRUCTION_SET, &set));
    CHECK(set == OC_INSTRUCTION_SET_BASELINE);
    oc_context_release(c);

    OK(oc_context_create(OC_HEADER_VERSION, NULL, &c));
    uint64_t value = 77;
    uint32_t did = 77;
    INVALID(oc_context_property(c, 0, &value));
    INVALID(oc_context_property(c, 0xffffffff, &value));
    INVALID(oc_context_property(c, OC_PROPERTY_VERSION, NULL));
    INVALID(oc_context_property(NULL, OC_PROPERTY_VERSION, &value));
    INVALID(oc_context_property(JUNK(oc_context), OC_PROPERTY_VERSION, &value));
    CHECK(value == 77);
    INVALID(oc_context_step(NULL, &did));
    OK(oc_context_step(c, NULL));
    OK(oc_context_step(c, &did));
    CHECK(did == 0);
    oc_context_retain(NULL);
    oc_context_release(NULL);
    oc_context_retain(JUNK(oc_context));
    oc_context_release(JUNK(oc_context));
    oc_context_retain(c);
    oc_context_release(c);
    return c;
}

/* The log gets what is worth saying, and background failures. */
static void logs(void) {
    oc_context *c;
    oc_context_desc desc;
    oc_job *job;
    OC_INIT(&desc);
    desc.log = count_lines;
    desc.log_user = log_lines;
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    CHECK(log_lines[OC_LOG_INFO] == 1);
    OK(oc_model_load(c, file("missing.oc"), NULL, &job));
    OK(oc_job_wait(job, OC_FOREVER, NULL));
    CHECK(log_lines[OC_LOG_ERROR] == 1);
    oc_job_release(job);
    oc_context_release(c);
}

/* Cages and their arrays. `mesh`: a shared mesh of two parts. */
static void add_cages(oc_build *b, uint32_t mesh) {
    oc_cage cage;
    OC_INIT(&cage);
    GARBAGE_SIZES(oc_cage, oc_build_add_cage(b, s));
    INVALID(oc_build_add_cage(b, NULL));
    INVALID(oc_build_add_cage(NULL, &cage));
    OK(oc_build_add_cage(b, &cage)); /* nothing: NULL pointers with counts of 0 */
    static const double points[] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 2, 0, 0, 2, 1, 0};
    static const uint32_t faces[] = {0, 1, 2, 3, 1, 4, 5, 2}, sizes[] = {4, 4};
    cage.positions = points, cage.position_count = 6, cage.scalar = OC_SCALAR_F64;
    cage.face_count = 2;
    INVALID(oc_build_add_cage(b, &cage)); /* no indices */
    cage.index_count = 8;
    INVALID(oc_build_add_cage(b, &cage)); /* NULL */
    cage.indices = faces;
    OK(oc_build_add_cage(b, &cage));
    cage.face_sizes = sizes;
    OK(oc_build_add_cage(b, &cage));
    cage.index_count = 7;
    INVALID(oc_build_add_cage(b, &cage));
    cage.face_sizes = NULL;
    INVALID(oc_build_add_cage(b, &cage));
    cage.index_count = 8, cage.part = 99;
    INVALID(oc_build_add_cage(b, &cage));
    cage.part = 0;
    static const uint64_t parts[] = {0, 1}, of_mesh[] = {0, 2};
    cage.face_parts = parts;
    OK(oc_build_add_cage(b, &cage));
    cage.mesh = mesh, cage.face_parts = of_mesh;
    INVALID(oc_build_add_cage(b, &cage)); /* part 2 of a mesh of two */
    cage.mesh = 0, cage.face_parts = NULL;
    static const uint32_t edge[] = {1, 2}, none[] = {0, 5};
    float sharpness[] = {2};
    cage.crease_count = 1;
    INVALID(oc_build_add_cage(b, &cage)); /* NULL */
    cage.creases = edge;
    INVALID(oc_build_add_cage(b, &cage));
    cage.crease_sharpness = sharpness;
    OK(oc_build_add_cage(b, &cage));
    cage.creases = none;
    INVALID(oc_build_add_cage(b, &cage));
    CHECK(strstr(oc_last_error(), "crease 0 to 5"));
    cage.creases = edge, sharpness[0] = -1;
    INVALID(oc_build_add_cage(b, &cage));
    sharpness[0] = NAN;
    INVALID(oc_build_add_cage(b, &cage));
    cage.crease_count = 0, cage.corner_count = 1, sharpness[0] = 2;
    INVALID(oc_build_add_cage(b, &cage));
    cage.corners = none, cage.corner_sharpness = sharpness;
    OK(oc_build_add_cage(b, &cage));
    cage.corner_count = 0, cage.hole_count = 1;
    INVALID(oc_build_add_cage(b, &cage));
    cage.holes = edge;
    OK(oc_build_add_cage(b, &cage));
    cage.holes = none + 1; /* 5 of two faces */
    INVALID(oc_build_add_cage(b, &cage));
    cage.hole_count = 0, cage.boundary = 3;
    INVALID(oc_build_add_cage(b, &cage));
    cage.boundary = OC_BOUNDARY_NONE, cage.creasing = 2;
    INVALID(oc_build_add_cage(b, &cage));
    cage.creasing = OC_CREASING_CHAIKIN, cage.triangle_rule = 2;
    INVALID(oc_build_add_cage(b, &cage));
    cage.triangle_rule = OC_TRIANGLE_RULE_SMOOTH;
    OK(oc_build_add_cage(b, &cage));
    cage.scalar = 2;
    INVALID(oc_build_add_cage(b, &cage));
    cage.scalar = OC_SCALAR_F64;
    oc_displacement moved;
    OC_INIT(&moved);
    cage.displacement = &moved;
    GARBAGE_SIZES(oc_displacement, (cage.displacement = s, oc_build_add_cage(b, &cage)));
    cage.displacement = &moved;
    INVALID(oc_build_add_cage(b, &cage)); /* no texels */
    float texels[] = {0, 1, 2, 3, 4, 5, 6, 7}, coordinates[16] = {0};
    moved.width = moved.height = 2, moved.map_count = 2, moved.scale = 0.1;
    INVALID(oc_build_add_cage(b, &cage)); /* NULL */
    moved.texels = texels;
    OK(oc_build_add_cage(b, &cage)); /* a grid for each face */
    moved.coordinates = coordinates;
    INVALID(oc_build_add_cage(b, &cage)); /* two maps */
    moved.map_count = 1;
    OK(oc_build_add_cage(b, &cage));
    coordinates[3] = NAN;
    INVALID(oc_build_add_cage(b, &cage));
    coordinates[3] = 0, texels[2] = INFINITY;
    INVALID(oc_build_add_cage(b, &cage));
    texels[2] = 2, moved.scale = NAN;
    INVALID(oc_build_add_cage(b, &cage));
    moved.scale = 1, moved.wrap_s = 2;
    INVALID(oc_build_add_cage(b, &cage));
    moved.wrap_s = OC_WRAP_CLAMP, moved.wrap_t = 2;
    INVALID(oc_build_add_cage(b, &cage));
    moved.wrap_t = 0, moved.width = moved.height = UINT32_MAX;
    INVALID(oc_build_add_cage(b, &cage));
    cage.displacement = NULL, cage.position_stride = 23;
    INVALID(oc_build_add_cage(b, &cage)); /* below a vertex */
    cage.position_stride = 0, cage.position_count = 5;
    INVALID(oc_build_add_cage(b, &cage));
    CHECK(strstr(oc_last_error(), "vertex 5"));
    cage.position_count = 6, cage.face_count = UINT64_MAX, cage.index_count = UINT64_MAX;
    INVALID(oc_build_add_cage(b, &cage));
}

static void add_nurbs(oc_build *b) {
    oc_nurbs surface;
    OC_INIT(&surface);
    GARBAGE_SIZES(oc_nurbs, oc_build_add_nurbs(b, s));
    INVALID(oc_build_add_nurbs(b, NULL));
    INVALID(oc_build_add_nurbs(NULL, &surface));
    INVALID(oc_build_add_nurbs(b, &surface)); /* degree 0 */
    static const double points[] = {0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 1};
    double knots[] = {0, 0, 1, 1}, weights[] = {1, 1, 1, 1};
    surface.degree_u = surface.degree_v = 1, surface.count_u = surface.count_v = 2;
    INVALID(oc_build_add_nurbs(b, &surface)); /* NULL */
    surface.knots_u = surface.knots_v = knots;
    INVALID(oc_build_add_nurbs(b, &surface));
    surface.points = points;
    OK(oc_build_add_nurbs(b, &surface));
    surface.weights = weights, surface.reversed = 1;
    OK(oc_build_add_nurbs(b, &surface));
    weights[2] = 0;
    INVALID(oc_build_add_nurbs(b, &surface));
    CHECK(strstr(oc_last_error(), "weight"));
    weights[2] = 1, knots[1] = 2;
    INVALID(oc_build_add_nurbs(b, &surface)); /* they decrease */
    CHECK(strstr(oc_last_error(), "knots_u"));
    knots[1] = 0, surface.part = 99;
    INVALID(oc_build_add_nurbs(b, &surface));
    surface.part = 0, surface.reversed = 2;
    INVALID(oc_build_add_nurbs(b, &surface));
    surface.reversed = 0, surface.reserved = 1;
    INVALID(oc_build_add_nurbs(b, &surface));
    surface.reserved = 0, surface.degree_u = 33;
    INVALID(oc_build_add_nurbs(b, &surface));
    surface.degree_u = 1, surface.count_u = surface.count_v = UINT32_MAX;
    INVALID(oc_build_add_nurbs(b, &surface));
}

static void contents_of_builds(oc_context *c) {
    oc_build *b = NULL;
    INVALID(oc_build_create(c, NULL, NULL));
    INVALID(oc_build_create(NULL, NULL, &b));
    GARBAGE_SIZES(oc_build_desc, oc_build_create(c, s, &b));
    oc_build_desc desc;
    OC_INIT(&desc);
    desc.structure = 99;
    INVALID(oc_build_create(c, &desc, &b));
    desc.structure = 0, desc.splits = 3;
    INVALID(oc_build_create(c, &desc, &b));
    desc.splits = 0, desc.up = 4;
    INVALID(oc_build_create(c, &desc, &b));
    desc.up = 0, desc.metres_per_unit = NAN;
    INVALID(oc_build_create(c, &desc, &b));
    desc.metres_per_unit = 0, desc.reserved = 1;
    INVALID(oc_build_create(c, &desc, &b));
    desc.reserved = 0, desc.temp_dir = "";
    INVALID(oc_build_create(c, &desc, &b));
    CHECK(b == NULL);
    desc.temp_dir = NULL, desc.threads = 99999;
    INVALID(oc_build_create(c, &desc, &b));
    CHECK(strstr(oc_last_error(), "oc_build_desc.threads is 99999"));
    desc.threads = 0, desc.trusted_folder = "";
    INVALID(oc_build_create(c, &desc, &b));
    desc.trusted_folder = NULL, desc.trust_paths = 2;
    INVALID(oc_build_create(c, &desc, &b));
    CHECK(strstr(oc_last_error(), "oc_build_desc.trust_paths is 2"));
    desc.trust_paths = 1, desc.reserved_2 = 1;
    INVALID(oc_build_create(c, &desc, &b));
    desc.reserved_2 = 0, desc.stand_ins = 3;
    INVALID(oc_build_create(c, &desc, &b));
    CHECK(strstr(oc_last_error(), "oc_build_desc.stand_ins 3"));
    desc.stand_ins = 0, desc.surface_leaves = 3;
    INVALID(oc_build_create(c, &desc, &b));
    CHECK(strstr(oc_last_error(), "oc_build_desc.surface_leaves 3"));
    desc.surface_leaves = 0, desc.surface_flat = 181.0f;
    INVALID(oc_build_create(c, &desc, &b));
    CHECK(strstr(oc_last_error(), "surface_flat"));
    desc.surface_flat = NAN;
    INVALID(oc_build_create(c, &desc, &b));
    desc.surface_flat = 0;
    desc.stand_ins = OC_STAND_INS_PROXIES, desc.proxy_rays = 1 << 21;
    INVALID(oc_build_create(c, &desc, &b));
    CHECK(strstr(oc_last_error(), "proxy_rays must be at most 1048576"));
    CHECK(b == NULL);
    OK(oc_build_create(c, NULL, &b));

    INVALID(oc_build_add_file(b, NULL));
    INVALID(oc_build_add_file(b, ""));
    INVALID(oc_build_add_file(NULL, "x"));

    uint32_t number = 77;
    oc_material material;
    OC_INIT(&material);
    GARBAGE_SIZES(oc_material, oc_build_add_material(b, s, &number));
    INVALID(oc_build_add_material(b, NULL, &number));
    INVALID(oc_build_add_material(b, &material, NULL));
    INVALID(oc_build_add_material(NULL, &material, &number));
    material.roughness = 2;
    INVALID(oc_build_add_material(b, &material, &number));
    material.roughness = NAN;
    INVALID(oc_build_add_material(b, &material, &number));
    CHECK(number == 77);

    oc_part part;
    OC_INIT(&part);
    GARBAGE_SIZES(oc_part, oc_build_add_part(b, s));
    INVALID(oc_build_add_part(b, NULL));
    INVALID(oc_build_add_part(NULL, &part));
    part.material = 1; /* none was added */
    INVALID(oc_build_add_part(b, &part));
    part.material = 0, part.has_parent = 1, part.parent = 5;
    INVALID(oc_build_add_part(b, &part));
    part.has_parent = 2;
    INVALID(oc_build_add_part(b, &part));
    part.has_parent = 0, part.name = "\xff\xfe";
    INVALID(oc_build_add_part(b, &part));
    part.name = NULL;
    const uint64_t id = part.id;
    part.id = OC_NO_ID;
    INVALID(oc_build_add_part(b, &part));
    part.id = id;
    OK(oc_build_add_part(b, &part));
    INVALID(oc_build_add_part(b, &part)); /* twice */

    uint32_t mesh = 77;
    INVALID(oc_build_add_shared_mesh(b, 0, &mesh));
    INVALID(oc_build_add_shared_mesh(b, 1, NULL));
    INVALID(oc_build_add_shared_mesh(NULL, 1, &mesh));
    CHECK(mesh == 77);
    OK(oc_build_add_shared_mesh(b, 2, &mesh));
    INVALID(oc_build_add_instance(NULL, mesh, 0, NULL));
    INVALID(oc_build_add_instance(b, 0, 0, NULL));
    INVALID(oc_build_add_instance(b, 99, 0, NULL));
    INVALID(oc_build_add_instance(b, mesh, 99, NULL));
    INVALID(oc_build_add_instance(b, mesh, 0, NULL)); /* two parts needed, one there */
    part.id = 1;
    OK(oc_build_add_part(b, &part));
    double singular[12] = {0};
    INVALID(oc_build_add_instance(b, mesh, 0, singular));
    singular[0] = NAN;
    INVALID(oc_build_add_instance(b, mesh, 0, singular));

    oc_triangles t;
    OC_INIT(&t);
    GARBAGE_SIZES(oc_triangles, oc_build_add_triangles(b, s));
    INVALID(oc_build_add_triangles(b, NULL));
    INVALID(oc_build_add_triangles(NULL, &t));
    OK(oc_build_add_triangles(b, &t)); /* nothing: NULL pointers with counts of 0 */
    t.position_count = 3;
    INVALID(oc_build_add_triangles(b, &t)); /* NULL */
    t.positions = tetra_positions;
    t.part = 99;
    INVALID(oc_build_add_triangles(b, &t));
    t.part = 2, t.mesh = mesh;
    INVALID(oc_build_add_triangles(b, &t)); /* of a mesh of two */
    t.part = 0, t.mesh = 99;
    INVALID(oc_build_add_triangles(b, &t));
    t.mesh = 0, t.position_count = 4;
    INVALID(oc_build_add_triangles(b, &t)); /* no whole number of triangles */
    t.position_stride = 11;
    INVALID(oc_build_add_triangles(b, &t)); /* below a corner */
    t.position_stride = 0, t.scalar = 2;
    INVALID(oc_build_add_triangles(b, &t));
    t.scalar = 0, t.indices = tetra_indices, t.index = 3;
    INVALID(oc_build_add_triangles(b, &t));
    t.index = OC_INDEX_NONE; /* but there are indices */
    INVALID(oc_build_add_triangles(b, &t));
    t.indices = NULL, t.index = OC_INDEX_U64;
    OK(oc_build_add_triangles(b, &t)); /* none of them: nothing, whatever the corners */
    t.index_count = 3;
    INVALID(oc_build_add_triangles(b, &t)); /* NULL */
    t.indices = NULL, t.index = OC_INDEX_NONE; /* but they are counted */
    INVALID(oc_build_add_triangles(b, &t));
    t.indices = tetra_indices, t.index = OC_INDEX_U32, t.index_count = 11;
    INVALID(oc_build_add_triangles(b, &t));
    t.index_count = 12, t.position_count = 3;
    INVALID(oc_build_add_triangles(b, &t)); /* index 3 of 3 corners */
    CHECK(strstr(oc_last_error(), "indices[5] is 3"));
    float values[12] = {0};
    t.position_count = 4, t.normals = values, t.normal_stride = 8;
    INVALID(oc_build_add_triangles(b, &t)); /* below a normal */
    t.normal_stride = UINT64_MAX;
    INVALID(oc_build_add_triangles(b, &t));
    t.normal_stride = 0, t.position_colours = values, t.position_colour_stride = 11;
    INVALID(oc_build_add_triangles(b, &t));
    t.position_colour_stride = 0, t.colours = values;
    INVALID(oc_build_add_triangles(b, &t)); /* colours of both kinds */
    CHECK(strstr(oc_last_error(), "position_colours"));
    t.colours = t.position_colours = t.normals = NULL;
    /* Sizes whose product overflows, or that no address space holds. */
    t.indices = NULL, t.index = OC_INDEX_NONE, t.position_count = UINT64_MAX / 3;
    INVALID(oc_build_add_triangles(b, &t));
    t.position_count = 3, t.position_stride = UINT64_MAX;
    INVALID(oc_build_add_triangles(b, &t));
    t.position_count = UINT64_MAX, t.position_stride = UINT64_MAX;
    INVALID(oc_build_add_triangles(b, &t));
    add_cages(b, mesh);
    add_nurbs(b);

    oc_job *job = NULL;
    static char mesh_file[4096];
    strcpy(mesh_file, file("input.obj"));
    FILE *input = fopen(mesh_file, "wb");
    CHECK(input && fputs("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", input) >= 0 && !fclose(input));
    oc_build *own;
    OK(oc_build_create(c, NULL, &own));
    OK(oc_build_add_file(own, mesh_file));
    INVALID(oc_build_start(own, mesh_file, &job)); /* it would destroy its input */
    CHECK(strstr(oc_last_error(), "input.obj"));
    EXPECT(OC_STATUS_IO, oc_build_start(own, "/dev/null", &job));
    OK(oc_build_add_file(own, mesh_file)); /* nothing changed */
    oc_build_release(own);
    INVALID(oc_build_start(b, NULL, &job));
    INVALID(oc_build_start(b, "", &job));
    INVALID(oc_build_start(b, "x", NULL));
    INVALID(oc_build_start(NULL, "x", &job));
    INVALID(oc_build_start(JUNK(oc_build), "x", &job));
    CHECK(job == NULL);
    /* Where no file can be: the job fails, the message names it. */
    OK(oc_build_start(b, file("no/such/folder/m.oc"), &job));
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_FAILED && progress.error == OC_STATUS_IO);
    CHECK(strstr(oc_last_error(), "no/such/folder"));
    oc_job_release(job);
    /* Once started, nothing can be added and it cannot start again. */
    OC_INIT(&material);
    OC_INIT(&t);
    part.id = 2;
    EXPECT(OC_STATUS_INVALID_STATE, oc_build_start(b, file("m.oc"), &job));
    EXPECT(OC_STATUS_INVALID_STATE, oc_build_add_file(b, "x.ply"));
    EXPECT(OC_STATUS_INVALID_STATE, oc_build_add_material(b, &material, &number));
    EXPECT(OC_STATUS_INVALID_STATE, oc_build_add_part(b, &part));
    EXPECT(OC_STATUS_INVALID_STATE, oc_build_add_triangles(b, &t));
    EXPECT(OC_STATUS_INVALID_STATE, oc_build_add_shared_mesh(b, 1, &mesh));
    EXPECT(OC_STATUS_INVALID_STATE, oc_build_add_instance(b, 1, 0, NULL));
    oc_build_retain(NULL);
    oc_build_release(NULL);
    oc_build_retain(b);
    oc_build_release(b);
    oc_build_release(b);
}

static void jobs(oc_context *c) {
    oc_build *b;
    oc_job *job;
    oc_progress progress;
    oc_build_report report;
    oc_model *model = NULL;
    int woken = 0;
    const char *note = NULL;
    OC_INIT(&progress);
    OC_INIT(&report);
    OK(oc_build_create(c, NULL, &b));
    OK(oc_build_add_file(b, file("no-such-file.ply")));
    OK(oc_build_start(b, file("m.oc"), &job));
    oc_build_release(b);

    INVALID(oc_job_poll(NULL, &progress));
    INVALID(oc_job_poll(job, NULL));
    INVALID(oc_job_poll(JUNK(oc_job), &progress));
    INVALID(oc_job_poll((oc_job *)(void *)c, &progress)); /* another kind of object */
    GARBAGE_SIZES(oc_progress, oc_job_poll(job, s));
    GARBAGE_SIZES(oc_progress, oc_job_wait(job, 0, s));
    GARBAGE_SIZES(oc_build_report, oc_job_build_report(job, s));
    INVALID(oc_job_wait(NULL, 0, &progress));
    INVALID(oc_job_cancel(NULL));
    INVALID(oc_job_set_wake(NULL, wake, &woken));
    EXPECT(OC_STATUS_INVALID_STATE, oc_job_build_report(job, &report)); /* not done yet */
    INVALID(oc_job_build_report(NULL, &report));
    INVALID(oc_job_build_report(job, NULL));
    EXPECT(OC_STATUS_INVALID_STATE, oc_job_build_note(job, 0, &note));
    INVALID(oc_job_build_note(NULL, 0, &note));
    INVALID(oc_job_build_note(job, 0, NULL));
    EXPECT(OC_STATUS_INVALID_STATE, oc_job_model(job, &model));
    INVALID(oc_job_model(NULL, &model));
    INVALID(oc_job_model(job, NULL));
    OK(oc_job_set_wake(job, wake, &woken));
    OK(oc_job_poll(job, &progress));
    CHECK(progress.state == OC_STATE_RUNNING && progress.fraction == 0 && woken == 0);
    OK(oc_job_wait(job, OC_FOREVER, NULL));
    OK(oc_job_poll(job, &progress));
    CHECK(progress.state == OC_STATE_FAILED && progress.error == OC_STATUS_IO && woken == 1);
    OK(oc_job_set_wake(job, wake, &woken)); /* it has ended: called at once */
    CHECK(woken == 2);
    OK(oc_job_set_wake(job, NULL, NULL));
    OK(oc_job_cancel(job)); /* too late, and no matter */
    OK(oc_job_poll(job, &progress));
    CHECK(progress.state == OC_STATE_FAILED);
    oc_job_retain(NULL);
    oc_job_release(NULL);
    oc_job_retain(job);
    oc_job_release(job);
    oc_job_release(job);

    /* Cancelled before anybody began it. */
    OK(oc_build_create(c, NULL, &b));
    add_tetra(b);
    OK(oc_build_start(b, file("never.oc"), &job));
    oc_build_release(b);
    OK(oc_job_cancel(job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_CANCELLED && progress.error == OC_STATUS_CANCELLED);
    CHECK(strcmp(oc_last_error(), "cancelled") == 0);
    CHECK(!fopen(file("never.oc"), "rb"));
    oc_job_release(job);

    /* Released before anybody began it; and one that a step does. */
    OK(oc_build_create(c, NULL, &b));
    add_tetra(b);
    OK(oc_build_start(b, file("never.oc"), &job));
    oc_build_release(b);
    oc_job_release(job);
    OK(oc_build_create(c, NULL, &b));
    add_tetra(b);
    OK(oc_build_start(b, file("m.oc"), &job));
    oc_build_release(b);
    uint32_t did = 0;
    OK(oc_context_step(c, &did));
    CHECK(did == 1);
    OK(oc_job_poll(job, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    OK(oc_job_build_report(job, &report));
    CHECK(report.triangles_in == 4 && report.triangles_kept == 4 && report.parts == 1);
    INVALID(oc_job_build_note(job, report.notes, &note));
    INVALID(oc_job_model(job, &model)); /* it has a report, not a model */
    oc_job_release(job);
}

static void models(oc_context *c) {
    oc_model *m = NULL;
    oc_job *job = NULL;
    oc_progress progress;
    oc_io io;
    int closed = 0;
    OC_INIT(&progress);
    OC_INIT(&io);
    INVALID(oc_model_open(NULL, file("m.oc"), &m));
    INVALID(oc_model_open(c, NULL, &m));
    INVALID(oc_model_open(c, "", &m));
    INVALID(oc_model_open(c, file("m.oc"), NULL));
    EXPECT(OC_STATUS_IO, oc_model_open(c, file("missing.oc"), &m));
    EXPECT(OC_STATUS_IO, oc_model_open(c, dir, &m));
    CHECK(strstr(oc_last_error(), dir));
    FILE *f = fopen(file("text.oc"), "wb");
    CHECK(f && fputs("this is not a model, whatever its name says", f) >= 0 && !fclose(f));
    EXPECT(OC_STATUS_CORRUPT, oc_model_open(c, file("text.oc"), &m));
    GARBAGE_SIZES(oc_io, oc_model_open_io(c, s, &m));
    INVALID(oc_model_open_io(c, NULL, &m));
    INVALID(oc_model_open_io(NULL, &io, &m));
    INVALID(oc_model_open_io(c, &io, NULL));
    INVALID(oc_model_open_io(c, &io, &m)); /* no read_at */
    io.size = 100000, io.read_at = read_fails, io.close = count_close, io.user = &closed, io.name = "tape";
    EXPECT(OC_STATUS_IO, oc_model_open_io(c, &io, &m));
    CHECK(strstr(oc_last_error(), "tape") && closed == 1);
    io.read_at = read_zeros;
    EXPECT(OC_STATUS_CORRUPT, oc_model_open_io(c, &io, &m));
    CHECK(closed == 2);
    io.size = 0xffffffffffffffff;
    EXPECT(OC_STATUS_CORRUPT, oc_model_open_io(c, &io, &m));
    CHECK(m == NULL && closed == 3);

    INVALID(oc_model_load(NULL, file("m.oc"), NULL, &job));
    INVALID(oc_model_load(c, NULL, NULL, &job));
    INVALID(oc_model_load(c, file("m.oc"), NULL, NULL));
    GARBAGE_SIZES(oc_io, oc_model_load(c, NULL, s, &job));
    CHECK(job == NULL);
    OK(oc_model_load(c, file("text.oc"), NULL, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_FAILED && progress.error == OC_STATUS_CORRUPT);
    EXPECT(OC_STATUS_INVALID_STATE, oc_job_model(job, &m));
    oc_job_release(job);
    OK(oc_model_load(c, file("m.oc"), NULL, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    OK(oc_job_model(job, &m));
    oc_job_release(job);

    oc_model_info info;
    oc_part_info part;
    oc_camera camera;
    uint32_t index = 77;
    OC_INIT(&info);
    OC_INIT(&part);
    OC_INIT(&camera);
    GARBAGE_SIZES(oc_model_info, oc_model_get_info(m, s));
    GARBAGE_SIZES(oc_part_info, oc_model_get_part(m, 0, s));
    GARBAGE_SIZES(oc_camera, oc_model_get_view(m, 0, s));
    INVALID(oc_model_get_info(NULL, &info));
    INVALID(oc_model_get_info(m, NULL));
    INVALID(oc_model_get_part(NULL, 0, &part));
    INVALID(oc_model_get_part(m, 0, NULL));
    INVALID(oc_model_get_part(m, 1, &part));
    INVALID(oc_model_get_part(m, 0xffffffff, &part));
    INVALID(oc_model_find_part(NULL, 7, &index));
    INVALID(oc_model_find_part(m, 7, NULL));
    INVALID(oc_model_find_part(m, 8, &index));
    INVALID(oc_model_get_view(NULL, 0, &camera));
    INVALID(oc_model_get_view(m, 0, NULL));
    INVALID(oc_model_get_view(m, 4, &camera));
    double placement[12] = {77};
    oc_placement_flags unknown = 77;
    INVALID(oc_model_get_placement(NULL, OC_UP_Z, 1, placement, &unknown));
    INVALID(oc_model_get_placement(m, 4, 1, placement, &unknown));
    INVALID(oc_model_get_placement(m, OC_UP_Z, -1, placement, &unknown));
    INVALID(oc_model_get_placement(m, OC_UP_Z, NAN, placement, &unknown));
    INVALID(oc_model_get_placement(m, OC_UP_Z, 1, NULL, &unknown));
    CHECK(placement[0] == 77 && unknown == 77);
    OK(oc_model_get_placement(m, OC_UP_UNKNOWN, 0, placement, NULL));
    CHECK(placement[0] == 1 && placement[4] == 1 && placement[8] == 1 && placement[1] == 0 && placement[9] == 0);
    OK(oc_model_get_placement(m, OC_UP_Z, 1, placement, &unknown));
    CHECK((unknown & ~(OC_PLACEMENT_UP_UNKNOWN | OC_PLACEMENT_UNIT_UNKNOWN)) == 0);
    CHECK(index == 77);
    OK(oc_model_find_part(m, 7, &index));
    OK(oc_model_get_part(m, index, &part));
    CHECK(!strcmp(part.name, "tetra") && part.id == 7 && part.parent == OC_NO_INDEX);
    oc_model_retain(NULL);
    oc_model_release(NULL);
    oc_model_retain(m);
    oc_model_release(m);
    oc_model_release(m);
}

/* A budget that is too small says what would do, and that does. */
static void budgets(void) {
    oc_context *c;
    oc_context_desc desc;
    oc_model *m = NULL;
    oc_job *job;
    oc_progress progress;
    uint64_t used = 0;
    OC_INIT(&desc);
    OC_INIT(&progress);
    desc.memory_budget = 1;
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    EXPECT(OC_STATUS_OVER_BUDGET, oc_model_open(c, file("m.oc"), &m));
    const uint64_t need = oc_last_error_need();
    char text[32];
    snprintf(text, sizeof text, "%llu", (unsigned long long)need);
    CHECK(m == NULL && need > 1 && strstr(oc_last_error(), text));
    OK(oc_model_load(c, file("m.oc"), NULL, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_FAILED && progress.error == OC_STATUS_OVER_BUDGET && progress.need == need);
    oc_job_release(job);
    oc_context_release(c);

    desc.memory_budget = need - 1;
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    EXPECT(OC_STATUS_OVER_BUDGET, oc_model_open(c, file("m.oc"), &m));
    oc_context_release(c);
    desc.memory_budget = need;
    OK(oc_context_create(OC_HEADER_VERSION, &desc, &c));
    OK(oc_model_open(c, file("m.oc"), &m));
    OK(oc_context_property(c, OC_PROPERTY_MEMORY_USED, &used));
    CHECK(used > 0 && used <= need);
    oc_model_release(m);
    oc_context_release(c);
}

/* A model in memory, and how much of it its owner admits. */
typedef struct {
    unsigned char bytes[1 << 16];
    size_t size;
} bytes_of_model;

static uint32_t read_bytes(void *user, uint64_t offset, void *buffer, uint64_t bytes) {
    const bytes_of_model *model = (const bytes_of_model *)user;
    if (offset > model->size || bytes > model->size - offset) return 1;
    memcpy(buffer, model->bytes + offset, (size_t)bytes);
    return 0;
}

/* A reader of triangles that a source uses while it reads for that reader. */
static oc_part_reader *reader_in_read;
static oc_status status_in_read;

static uint32_t read_in_read(void *user, uint64_t offset, void *buffer, uint64_t bytes) {
    oc_triangle triangle;
    uint64_t count;
    if (reader_in_read) status_in_read = oc_part_reader_next(reader_in_read, &triangle, 1, &count);
    return read_bytes(user, offset, buffer, bytes);
}

/* Sources that are shorter or longer than they say, and one that reads what is being read. */
static void lying_sources(oc_context *c) {
    static bytes_of_model model;
    oc_model *m = NULL;
    oc_io io;
    OC_INIT(&io);
    FILE *f = fopen(file("m.oc"), "rb");
    CHECK(f);
    model.size = fread(model.bytes, 1, sizeof model.bytes, f);
    CHECK(!fclose(f) && model.size > 1000 && model.size < sizeof model.bytes);
    io.read_at = read_bytes, io.user = &model, io.name = "a liar";
    const uint64_t sizes[] = {0, 1, 63, model.size / 2, model.size - 1, model.size + 1, model.size + 4096, 2 * model.size,
                              UINT64_MAX};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        io.size = sizes[i];
        const oc_status status = oc_model_open_io(c, &io, &m);
        CHECK(status == OC_STATUS_CORRUPT || status == OC_STATUS_IO);
        CHECK(m == NULL && strstr(oc_last_error(), "a liar"));
    }
    io.size = model.size;
    OK(oc_model_open_io(c, &io, &m));
    oc_model_release(m);

    io.read_at = read_in_read;
    OK(oc_model_open_io(c, &io, &m));
    oc_part_reader *reader;
    OK(oc_model_read_part(m, 7, &reader));
    oc_triangle triangles[4];
    uint64_t count = 0;
    status_in_read = OC_STATUS_OK;
    reader_in_read = reader;
    OK(oc_part_reader_next(reader, triangles, 4, &count));
    CHECK(count == 4 && status_in_read == OC_STATUS_INVALID_STATE);
    reader_in_read = NULL;
    oc_part_reader_release(reader);
    oc_model_release(m);
}

/* Nodes by numbers that the caller may have from anywhere. */
static void cursors(oc_model *m) {
    oc_cursor *cursor = NULL, *now = NULL;
    INVALID(oc_cursor_create(NULL, 0, 0, &cursor));
    INVALID(oc_cursor_create(m, 0, 0, NULL));
    INVALID(oc_cursor_create(m, 2, 0, &cursor));
    INVALID(oc_cursor_create(m, 0xffffffff, 0, &cursor));
    INVALID(oc_cursor_create(m, 0, 1, &cursor));
    CHECK(strstr(oc_last_error(), "at least"));
    EXPECT(OC_STATUS_OVER_BUDGET, oc_cursor_create(m, 0, UINT64_MAX / 2, &cursor));
    EXPECT(OC_STATUS_OVER_BUDGET, oc_cursor_create(m, 0, UINT64_MAX, &cursor));
    CHECK(!cursor);
    OK(oc_cursor_create(m, 0, 0, &cursor));
    OK(oc_cursor_create(m, OC_CURSOR_NOW, UINT64_MAX, &now));

    uint64_t root = 77, count = 77;
    INVALID(oc_cursor_root(NULL, 0, &root));
    INVALID(oc_cursor_root(cursor, 0, NULL));
    INVALID(oc_cursor_root(cursor, 1, &root));
    INVALID(oc_cursor_root(cursor, 0xffffffff, &root));
    INVALID(oc_cursor_root((oc_cursor *)m, 0, &root));
    CHECK(root == 77);
    OK(oc_cursor_root(cursor, 0, &root));

    oc_tree_place places[2];
    INVALID(oc_cursor_places(NULL, places, 2, &count));
    INVALID(oc_cursor_places(cursor, NULL, 2, &count));
    INVALID(oc_cursor_places(cursor, places, 2, NULL));
    INVALID(oc_cursor_places(cursor, places, UINT64_MAX, &count));
    CHECK(count == 77);
    OK(oc_cursor_places(cursor, NULL, 0, &count));
    CHECK(count == 1);
    OK(oc_cursor_places(now, places, 2, &count));
    CHECK(count == 1 && places[0].root == root && places[0].tree == 0 && places[0].model_from_tree[0] == 1);

    oc_node node;
    OC_INIT(&node);
    INVALID(oc_cursor_node(NULL, root, &node));
    INVALID(oc_cursor_node(cursor, root, NULL));
    GARBAGE_SIZES(oc_node, oc_cursor_node(cursor, root, s));
    double nan = NAN;
    uint64_t foreign[] = {UINT64_MAX, UINT64_MAX - 1, root + 77, root ^ 1ull << 63, root ^ 1ull << 31, root ^ 0x4000,
                          root ^ 0x8000, root ^ 0xc000, root + (1ull << 32), 0};
    memcpy(&foreign[9], &nan, sizeof nan);
    oc_node_triangle triangles[8];
    uint64_t ids[32];
    for (size_t i = 0; i < sizeof foreign / sizeof *foreign; i++) {
        INVALID(oc_cursor_node(cursor, foreign[i], &node));
        INVALID(oc_cursor_triangles(cursor, foreign[i], 1, triangles, 8, &count));
        CHECK(strstr(oc_last_error(), "is not the id of a node"));
    }
    CHECK(node.child_count == 0);
    OK(oc_cursor_node(cursor, root, &node));
    CHECK(node.child_count > 0 && node.child_count <= 8 && node.triangle_count == 0 && node.part == 0);
    CHECK(node.bounds_min[0] <= 0 && node.bounds_min[0] > -0.01 && node.bounds_max[0] >= 1 && node.bounds_max[0] < 1.01);

    uint64_t all = 0;
    for (uint32_t i = 0; i < node.child_count; i++) {
        CHECK(node.leaf_children >> i & 1); /* so small is the model */
        const uint64_t leaf = node.children[i];
        INVALID(oc_cursor_triangles(NULL, leaf, 1, triangles, 8, &count));
        INVALID(oc_cursor_triangles(cursor, leaf, 2, triangles, 8, &count));
        INVALID(oc_cursor_triangles(cursor, leaf, 1, NULL, 8, &count));
        INVALID(oc_cursor_triangles(cursor, leaf, 1, triangles, 8, NULL));
        OK(oc_cursor_triangles(cursor, leaf, 1, NULL, 0, &count));
        CHECK(count > 0 && count <= 4);
        if (count > 1) {
            EXPECT(OC_STATUS_BUFFER_TOO_SMALL, oc_cursor_triangles(cursor, leaf, 1, triangles, count - 1, &count));
        }
        OK(oc_cursor_triangles(cursor, leaf, 1, triangles, 8, &count));
        for (uint64_t k = 0; k < count; k++)
            CHECK(triangles[k].prim < 4 && triangles[k].part == 0 && triangles[k].tree == 0);
        OK(oc_cursor_triangles(now, leaf, 0, triangles, 8, &count));
        CHECK(triangles[0].prim == OC_NO_ID);
        all += count;
    }
    CHECK(all == 4);
    INVALID(oc_cursor_triangles(cursor, root, 0, triangles, 8, &count));
    CHECK(strstr(oc_last_error(), "no such leaf"));

    INVALID(oc_cursor_block_nodes(NULL, 0, ids, 32, &count));
    INVALID(oc_cursor_block_nodes(cursor, 0, NULL, 32, &count));
    INVALID(oc_cursor_block_nodes(cursor, 0, ids, 32, NULL));
    INVALID(oc_cursor_block_nodes(cursor, 1, ids, 32, &count));
    INVALID(oc_cursor_block_nodes(cursor, 0xffffffff, ids, 32, &count));
    EXPECT(OC_STATUS_BUFFER_TOO_SMALL, oc_cursor_block_nodes(cursor, 0, ids, 1, &count));
    OK(oc_cursor_block_nodes(cursor, 0, ids, 32, &count));
    CHECK(count == node.child_count + 1);

    oc_cursor_retain(cursor);
    oc_cursor_release(cursor);
    oc_cursor_release(cursor);
    oc_cursor_release(now);
    oc_cursor_release(NULL);
    oc_cursor_retain(NULL);
}

static void geometry(oc_scene *s0, oc_model *m) {
    oc_part_reader *reader = NULL;
    INVALID(oc_model_read_part(NULL, 7, &reader));
    INVALID(oc_model_read_part(m, 7, NULL));
    INVALID(oc_model_read_part(m, 8, &reader));
    CHECK(strstr(oc_last_error(), "no part with id 8"));
    CHECK(!reader);
    OK(oc_model_read_part(m, 7, &reader));
    oc_triangle triangles[3];
    uint64_t count = 77, all = 0;
    INVALID(oc_part_reader_next(NULL, triangles, 3, &count));
    INVALID(oc_part_reader_next(reader, NULL, 3, &count));
    INVALID(oc_part_reader_next(reader, triangles, 0, &count));
    INVALID(oc_part_reader_next(reader, triangles, 3, NULL));
    CHECK(count == 77);
    do {
        OK(oc_part_reader_next(reader, triangles, 3, &count));
        CHECK(count <= 3);
        for (uint64_t i = 0; i < count; i++)
            CHECK(triangles[i].part == 7 && triangles[i].prim < 4);
        all += count;
    } while (count);
    CHECK(all == 4);
    oc_part_reader_retain(reader);
    oc_part_reader_release(reader);
    oc_part_reader_release(reader);
    oc_part_reader_release(NULL);
    oc_part_reader_retain(NULL);
    cursors(m);

    oc_hit hit;
    memset(&hit, 0, sizeof hit);
    hit.instance = hit.part = hit.prim = OC_NO_ID;
    INVALID(oc_scene_triangles(NULL, &hit, 1, 0, triangles));
    INVALID(oc_scene_triangles(s0, NULL, 1, 0, triangles));
    INVALID(oc_scene_triangles(s0, &hit, 1, 8, triangles));
    INVALID(oc_scene_triangles(s0, &hit, UINT64_MAX, 0, triangles));
    INVALID(oc_scene_triangles(s0, &hit, 1, 0, NULL));
    INVALID(oc_scene_triangles(s0, &hit, 1, 0, triangles)); /* no ids */
    CHECK(strstr(oc_last_error(), "hit 0"));
    OK(oc_scene_triangles(s0, NULL, 0, 0, NULL));

    oc_surface_point points[2];
    oc_hit picked[2] = {hit, hit};
    INVALID(oc_scene_evaluate(NULL, picked, 1, 0, 0, points, 0));
    INVALID(oc_scene_evaluate(s0, NULL, 1, 0, 0, points, 0));
    INVALID(oc_scene_evaluate(s0, picked, 1, 8, 0, points, 0));
    INVALID(oc_scene_evaluate(s0, picked, UINT64_MAX, 0, 0, points, 0));
    INVALID(oc_scene_evaluate(s0, picked, 1, 0, 0, NULL, 0));
    INVALID(oc_scene_evaluate(s0, picked, 1, 0, 0, points, 8));
    INVALID(oc_scene_evaluate(s0, picked, 1, 0, OC_QUERY_COHERENT, points, 0));
    CHECK(strstr(oc_last_error(), "OC_QUERY_NOW"));
    picked[1].kind = OC_HIT_EXACT; /* no ids */
    INVALID(oc_scene_evaluate(s0, picked, 2, 0, OC_QUERY_NOW, points, 0));
    CHECK(strstr(oc_last_error(), "hit 1"));
    picked[1].kind = 99;
    INVALID(oc_scene_evaluate(s0, picked, 2, 0, 0, points, 0));
    CHECK(strstr(oc_last_error(), "hit 1: kind 99"));
    picked[1].kind = OC_HIT_LOD;
    OK(oc_scene_evaluate(s0, picked, 2, 0, 0, points, 0));
    CHECK(points[0].kind == OC_EVALUATED_NOTHING && points[1].kind == OC_EVALUATED_STAND_IN);
    OK(oc_scene_evaluate(s0, NULL, 0, 0, OC_QUERY_NOW, NULL, 0));
}

static oc_scene *scenes(oc_context *c) {
    oc_scene *s0 = NULL;
    oc_model *m;
    oc_context *other;
    oc_look look;
    oc_light light;
    oc_background background;
    OC_INIT(&look);
    OC_INIT(&background);
    memset(&light, 0, sizeof light);
    OK(oc_model_open(c, file("m.oc"), &m));
    INVALID(oc_scene_create(NULL, &s0));
    INVALID(oc_scene_create(c, NULL));
    OK(oc_scene_create(c, &s0));

    double singular[12] = {1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0};
    INVALID(oc_scene_add_instance(NULL, m, 1, NULL));
    INVALID(oc_scene_add_instance(s0, NULL, 1, NULL));
    INVALID(oc_scene_add_instance(s0, (oc_model *)(void *)s0, 1, NULL));
    INVALID(oc_scene_add_instance(s0, m, 1, singular));
    INVALID(oc_scene_add_instance(s0, m, OC_NO_ID, NULL));
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &other));
    oc_scene *foreign;
    OK(oc_scene_create(other, &foreign));
    INVALID(oc_scene_add_instance(foreign, m, 1, NULL)); /* objects of two contexts */
    oc_context_release(other);
    oc_scene_release(foreign);
    OK(oc_scene_add_instance(s0, m, 1, NULL));
    INVALID(oc_scene_add_instance(s0, m, 1, NULL)); /* the id is taken */

    oc_scene *inner, *outer;
    uint64_t path[2], levels, none = OC_NO_ID;
    double placed[12];
    OK(oc_scene_create(c, &inner));
    OK(oc_scene_create(c, &outer));
    OK(oc_scene_add_instance(inner, m, 3, NULL));
    OK(oc_scene_commit(inner));
    INVALID(oc_scene_add_scene(NULL, inner, 1, NULL));
    INVALID(oc_scene_add_scene(outer, NULL, 1, NULL));
    INVALID(oc_scene_add_scene(outer, (oc_scene *)(void *)m, 1, NULL));
    INVALID(oc_scene_add_scene(outer, inner, OC_NO_ID, NULL));
    INVALID(oc_scene_add_scene(outer, inner, 1, singular));
    INVALID(oc_scene_add_scene(outer, outer, 1, NULL));
    OK(oc_scene_add_scene(outer, inner, 1, NULL));
    INVALID(oc_scene_add_scene(outer, inner, 1, NULL)); /* the id is taken */
    INVALID(oc_scene_add_instance(outer, m, 1, NULL));
    INVALID(oc_scene_add_scene(inner, outer, 1, NULL)); /* a cycle */
    INVALID(oc_scene_set_part_look(outer, 1, 7, &look)); /* it has looks in the inner scene */
    INVALID(oc_scene_set_model(outer, 1, m));
    OK(oc_scene_set_instance_look(outer, 1, &look));
    OK(oc_scene_commit(outer));
    INVALID(oc_scene_get_path(NULL, 0, path, 2, &levels, placed));
    INVALID(oc_scene_get_path(outer, none, path, 2, &levels, placed));
    INVALID(oc_scene_get_path(outer, 0, NULL, 2, &levels, placed));
    INVALID(oc_scene_get_path(outer, 0, path, 2, NULL, placed));
    EXPECT(OC_STATUS_BUFFER_TOO_SMALL, oc_scene_get_path(outer, 0, path, 1, &levels, placed));
    CHECK(levels == 2);
    OK(oc_scene_get_path(outer, 0, NULL, 0, &levels, NULL));
    OK(oc_scene_get_path(outer, 0, path, 2, &levels, placed));
    CHECK(levels == 2 && path[0] == 1 && path[1] == 3 && placed[0] == 1);
    oc_scene *again = NULL;
    INVALID(oc_scene_save(NULL, file("s.oc")));
    INVALID(oc_scene_save(outer, NULL));
    INVALID(oc_scene_save(outer, ""));
    INVALID(oc_scene_save((oc_scene *)(void *)m, file("s.oc")));
    INVALID(oc_scene_save(outer, file("m.oc"))); /* its own model */
    EXPECT(OC_STATUS_IO, oc_scene_save(outer, dir));
    EXPECT(OC_STATUS_IO, oc_scene_save(outer, file("missing/s.oc")));
    OK(oc_scene_save(outer, file("s.oc")));
    INVALID(oc_scene_open(NULL, file("s.oc"), &again));
    INVALID(oc_scene_open(c, NULL, &again));
    INVALID(oc_scene_open(c, "", &again));
    INVALID(oc_scene_open(c, file("s.oc"), NULL));
    EXPECT(OC_STATUS_IO, oc_scene_open(c, file("missing.oc"), &again));
    EXPECT(OC_STATUS_IO, oc_scene_open(c, dir, &again));
    EXPECT(OC_STATUS_CORRUPT, oc_scene_open(c, file("text.oc"), &again));
    EXPECT(OC_STATUS_CORRUPT, oc_scene_open(c, file("m.oc"), &again));
    EXPECT(OC_STATUS_CORRUPT, oc_model_open(c, file("s.oc"), (oc_model **)(void *)&again));
    CHECK(again == NULL); /* outputs are written only on success */
    OK(oc_scene_open(c, file("s.oc"), &again));
    OK(oc_scene_get_path(again, 0, path, 2, &levels, placed));
    CHECK(levels == 2 && path[0] == 1 && path[1] == 3 && placed[0] == 1);
    OK(oc_scene_remove_instance(again, 1));
    OK(oc_scene_commit(again));
    INVALID(oc_scene_get_path(again, 0, NULL, 0, &levels, NULL));
    oc_scene_release(again);
    INVALID(oc_scene_set_occurrence_look(NULL, 0, NULL));
    INVALID(oc_scene_set_occurrence_look(outer, 1, NULL));
    INVALID(oc_scene_set_occurrence_look(outer, OC_NO_ID, &look));
    GARBAGE_SIZES(oc_look, oc_scene_set_occurrence_look(outer, 0, s));
    OK(oc_scene_set_occurrence_look(outer, 0, &look));
    oc_look unseen = look;
    unseen.flags = OC_LOOK_HIDDEN;
    OK(oc_scene_set_occurrence_look(outer, 0, &unseen));
    OK(oc_scene_commit(outer));
    EXPECT(OC_STATUS_INVALID_STATE, oc_scene_save(outer, file("s.oc"))); /* a look of one occurrence is not saved */
    CHECK(strstr(oc_last_error(), "1, 3"));
    OK(oc_scene_set_occurrence_look(outer, 0, NULL));
    OK(oc_scene_remove_instance(outer, 1));
    oc_scene_release(inner);
    oc_scene_release(outer);

    oc_instances many;
    const oc_model *prototypes[2] = {m, NULL};
    const double places[2][12] = {{1, 0, 0, 0, 1, 0, 0, 0, 1, 5, 0, 0}, {1, 0, 0, 0, 1, 0, 0, 0, 1, 9, 0, 0}};
    const oc_place place = {{1, 2, 3}, {0, 0, 0, 1}, 1, 0}, no_scale = {{1, 2, 3}, {0, 0, 0, 1}, 0, 0},
                   reserved = {{1, 2, 3}, {0, 0, 0, 1}, 1, 1};
    const uint32_t zero_one[2] = {0, 1};
    const uint8_t four_tints[4 * 4] = {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 128, 1, 2, 3, 4};
    OC_INIT(&many);
    INVALID(oc_scene_add_instances(s0, &many)); /* none */
    many.prototypes = prototypes, many.prototype_count = 1;
    many.transforms = places, many.count = 2, many.first_id = 10;
    INVALID(oc_scene_add_instances(NULL, &many));
    INVALID(oc_scene_add_instances(s0, NULL));
#define WRONG(member, value)                                                                                         \
    do {                                                                                                             \
        oc_instances wrong = many;                                                                                   \
        wrong.member = value;                                                                                        \
        INVALID(oc_scene_add_instances(s0, &wrong));                                                                 \
    } while (0)
    WRONG(struct_size, 3);
    WRONG(form, 3);
    WRONG(prototypes, NULL);
    WRONG(prototype_count, 0);
    WRONG(prototype_count, 2); /* the second is NULL */
    WRONG(prototype_of, zero_one);
    WRONG(transforms, NULL);
    WRONG(stride, 95);
    WRONG(count, 0);
    WRONG(count, UINT64_MAX);
    WRONG(first_id, 1); /* taken */
    WRONG(first_id, OC_NO_ID);
    WRONG(first_id, OC_NO_ID - 1);
    WRONG(reserved, 1);
    WRONG(scene_count, 1); /* models too */
    many.masks = zero_one, many.tints = four_tints;
    WRONG(mask_stride, 3);
    WRONG(mask_stride, UINT64_MAX);
    WRONG(tint_stride, 3);
    WRONG(tint_stride, UINT64_MAX);
#undef WRONG
    {
        const oc_scene *scenes[2] = {s0, NULL};
        oc_instances nested = many;
        nested.prototypes = NULL, nested.prototype_count = 0, nested.first_id = 900;
        INVALID(oc_scene_add_instances(s0, &nested)); /* nothing */
        nested.scene_count = 1;
        INVALID(oc_scene_add_instances(s0, &nested)); /* NULL */
        nested.scenes = scenes;
        INVALID(oc_scene_add_instances(s0, &nested)); /* in itself */
        nested.scene_count = 2;
        INVALID(oc_scene_add_instances(s0, &nested)); /* the second is NULL */
        OK(oc_scene_create(c, &inner));
        scenes[0] = inner, nested.scene_count = 1;
        OK(oc_scene_add_instances(s0, &nested));
        INVALID(oc_scene_clear_part_looks(s0, 900)); /* it is a scene */
        OK(oc_scene_remove_instances(s0, 900));
        oc_scene_release(inner);
    }
    OK(oc_scene_add_instances(s0, &many));
    INVALID(oc_scene_add_instances(s0, &many)); /* the ids are taken */
    INVALID(oc_scene_add_instance(s0, m, 11, NULL));
    INVALID(oc_scene_remove_instance(s0, 11));
    many.count = 1, many.first_id = 20, many.transforms = singular;
    INVALID(oc_scene_add_instances(s0, &many));
    many.form = OC_TRANSFORM_PLACE, many.transforms = &no_scale;
    INVALID(oc_scene_add_instances(s0, &many));
    many.transforms = &reserved;
    INVALID(oc_scene_add_instances(s0, &many));
    many.transforms = &place;
    OK(oc_scene_add_instances(s0, &many));
    INVALID(oc_scene_set_transform(s0, 20, places[0])); /* it has a place */
    OK(oc_scene_set_transform(s0, 11, places[0]));
    OK(oc_scene_set_instance_mask(s0, 11, 2));
    INVALID(oc_scene_set_transforms(NULL, 10, OC_TRANSFORM_AFFINE_F64, places, 2, 0));
    INVALID(oc_scene_set_transforms(s0, 1, OC_TRANSFORM_AFFINE_F64, places, 1, 0)); /* of no array */
    INVALID(oc_scene_set_transforms(s0, 11, OC_TRANSFORM_AFFINE_F64, places, 2, 0)); /* only one from there on */
    INVALID(oc_scene_set_transforms(s0, 10, OC_TRANSFORM_AFFINE_F32, places, 2, 0)); /* another form */
    INVALID(oc_scene_set_transforms(s0, 10, 7, places, 2, 0));
    INVALID(oc_scene_set_transforms(s0, 10, OC_TRANSFORM_AFFINE_F64, NULL, 2, 0));
    INVALID(oc_scene_set_transforms(s0, 10, OC_TRANSFORM_AFFINE_F64, places, UINT64_MAX, 0));
    INVALID(oc_scene_set_transforms(s0, 10, OC_TRANSFORM_AFFINE_F64, places, 2, 95));
    INVALID(oc_scene_set_transforms(s0, 10, OC_TRANSFORM_AFFINE_F64, singular, 1, 0));
    OK(oc_scene_set_transforms(s0, 10, OC_TRANSFORM_AFFINE_F64, places, 2, 0));
    OK(oc_scene_set_transforms(s0, 10, OC_TRANSFORM_AFFINE_F64, NULL, 0, 0));
    OK(oc_scene_set_transforms(s0, 20, OC_TRANSFORM_PLACE, &place, 1, sizeof place));
    INVALID(oc_scene_set_masks(NULL, 10, zero_one, 2, 0));
    INVALID(oc_scene_set_masks(s0, 1, zero_one, 1, 0)); /* of no array */
    INVALID(oc_scene_set_masks(s0, 11, zero_one, 2, 0)); /* only one from there on */
    INVALID(oc_scene_set_masks(s0, 10, NULL, 2, 0));
    INVALID(oc_scene_set_masks(s0, 10, zero_one, UINT64_MAX, 0));
    INVALID(oc_scene_set_masks(s0, 10, zero_one, 2, 3));
    OK(oc_scene_set_masks(s0, 10, zero_one, 2, 0));
    OK(oc_scene_set_masks(s0, 10, NULL, 0, 0));
    INVALID(oc_scene_set_tints(NULL, 10, four_tints, 2, 0));
    INVALID(oc_scene_set_tints(s0, 1, four_tints, 1, 0)); /* of no array */
    INVALID(oc_scene_set_tints(s0, 11, four_tints, 2, 0)); /* only one from there on */
    INVALID(oc_scene_set_tints(s0, 10, NULL, 2, 0));
    INVALID(oc_scene_set_tints(s0, 10, four_tints, UINT64_MAX, 0));
    INVALID(oc_scene_set_tints(s0, 10, four_tints, 2, 3));
    OK(oc_scene_set_tints(s0, 10, four_tints, 2, 8));
    OK(oc_scene_set_tints(s0, 10, NULL, 0, 0));
    INVALID(oc_scene_remove_instances(NULL, 10));
    INVALID(oc_scene_remove_instances(s0, 11));
    OK(oc_scene_remove_instances(s0, 10));
    OK(oc_scene_remove_instances(s0, 20));
    INVALID(oc_scene_remove_instances(s0, 10));

    INVALID(oc_scene_set_transform(NULL, 1, NULL));
    INVALID(oc_scene_set_transform(s0, 2, NULL));
    INVALID(oc_scene_set_transform(s0, 1, singular));
    INVALID(oc_scene_set_instance_mask(NULL, 1, 1));
    INVALID(oc_scene_set_instance_mask(s0, 2, 1));
    INVALID(oc_scene_set_instance_look(NULL, 1, &look));
    INVALID(oc_scene_set_instance_look(s0, 2, &look));
    INVALID(oc_scene_set_part_look(NULL, 1, 7, &look));
    INVALID(oc_scene_set_part_look(s0, 2, 7, &look));
    INVALID(oc_scene_set_part_look(s0, 1, 8, &look));
    const uint64_t own[] = {7}, mixed[] = {7, 8};
    OK(oc_scene_set_parts_look(s0, 1, own, 1, OC_PARTS_BELOW, NULL));
    OK(oc_scene_set_parts_look(s0, 1, NULL, 0, 0, &look));
    INVALID(oc_scene_set_parts_look(NULL, 1, own, 1, 0, &look));
    INVALID(oc_scene_set_parts_look(s0, 2, own, 1, 0, &look));
    INVALID(oc_scene_set_parts_look(s0, 1, mixed, 2, 0, &look)); /* part 8 does not exist */
    INVALID(oc_scene_set_parts_look(s0, 1, NULL, 1, 0, &look));
    INVALID(oc_scene_set_parts_look(s0, 1, own, UINT64_MAX, 0, &look));
    INVALID(oc_scene_set_parts_look(s0, 1, own, 1, 2, &look));
    OK(oc_scene_isolate(s0, 1, own, 1, 0));
    OK(oc_scene_isolate(s0, 1, NULL, 0, 0));
    OK(oc_scene_clear_part_looks(s0, 1));
    INVALID(oc_scene_isolate(NULL, 1, own, 1, 0));
    INVALID(oc_scene_isolate(s0, 2, own, 1, 0));
    INVALID(oc_scene_isolate(s0, 1, mixed, 2, 0));
    INVALID(oc_scene_isolate(s0, 1, NULL, 1, 0));
    INVALID(oc_scene_isolate(s0, 1, own, 1, 2));
    INVALID(oc_scene_set_model(NULL, 1, m));
    INVALID(oc_scene_set_model(s0, 1, NULL));
    INVALID(oc_scene_set_model(s0, 2, m));
    OK(oc_scene_set_model(s0, 1, m));
    look.flags = 8;
    INVALID(oc_scene_set_instance_look(s0, 1, &look));
    look.flags = OC_LOOK_COLOURED, look.colour[0] = NAN;
    INVALID(oc_scene_set_part_look(s0, 1, 7, &look));
    GARBAGE_SIZES(oc_look, oc_scene_set_instance_look(s0, 1, s));
    GARBAGE_SIZES(oc_look, oc_scene_set_part_look(s0, 1, 7, s));
    INVALID(oc_scene_clear_part_looks(NULL, 1));
    INVALID(oc_scene_clear_part_looks(s0, 2));
    INVALID(oc_scene_remove_instance(NULL, 1));
    INVALID(oc_scene_remove_instance(s0, 2));

    geometry(s0, m);
    oc_model_release(m);

    INVALID(oc_scene_set_lights(NULL, &light, 1, 0));
    INVALID(oc_scene_set_lights(s0, NULL, 1, 0));
    INVALID(oc_scene_set_lights(s0, &light, 1, sizeof light - 1));
    INVALID(oc_scene_set_lights(s0, &light, UINT64_MAX, 0));
    INVALID(oc_scene_set_lights(s0, &light, 2, UINT64_MAX));
    OK(oc_scene_set_lights(s0, NULL, 0, 0));
    light.kind = 3;
    INVALID(oc_scene_set_lights(s0, &light, 1, 0));
    light.kind = OC_LIGHT_DIRECTIONAL; /* without a direction */
    INVALID(oc_scene_set_lights(s0, &light, 1, 0));
    light.kind = 0, light.shadows = 2;
    INVALID(oc_scene_set_lights(s0, &light, 1, 0));
    light.shadows = 0, light.intensity = -1;
    INVALID(oc_scene_set_lights(s0, &light, 1, 0));
    light.intensity = 0;
    OK(oc_scene_set_lights(s0, &light, 1, 0));

    GARBAGE_SIZES(oc_background, oc_scene_set_background(s0, s));
    INVALID(oc_scene_set_background(NULL, &background));
    background.top[2] = INFINITY;
    INVALID(oc_scene_set_background(s0, &background));
    background.top[2] = 0, background.reserved = 1;
    INVALID(oc_scene_set_background(s0, &background));
    OK(oc_scene_set_background(s0, NULL));
    INVALID(oc_scene_commit(NULL));
    INVALID(oc_scene_commit(JUNK(oc_scene)));
    OK(oc_scene_commit(s0));
    oc_scene_retain(NULL);
    oc_scene_release(NULL);
    oc_scene_retain(s0);
    oc_scene_release(s0);
    return s0;
}

static void queries(oc_context *c, oc_scene *s0) {
    oc_ray ray = {{0.1, 0.1, -1}, 0, 0, {0, 0, 1}, 0, 0, 0};
    oc_query q;
    oc_hit *hit = (oc_hit *)malloc(sizeof *hit);
    uint8_t any = 77;
    oc_job *job = NULL;
    OC_INIT(&q);
    OK(oc_scene_closest(s0, &q, NULL, 0)); /* no rays: pointers do not matter */
    q.rays = &ray;
    q.count = 1;
    INVALID(oc_scene_closest(NULL, &q, hit, 0));
    INVALID(oc_scene_closest(s0, NULL, hit, 0));
    INVALID(oc_scene_closest(s0, &q, NULL, 0));
    INVALID(oc_scene_closest(s0, &q, hit, sizeof *hit - 1));
    INVALID(oc_scene_any(NULL, &q, &any, 0));
    INVALID(oc_scene_any(s0, NULL, &any, 0));
    INVALID(oc_scene_any(s0, &q, NULL, 0));
    INVALID(oc_scene_closest_start(NULL, &q, hit, 0, &job));
    INVALID(oc_scene_closest_start(s0, NULL, hit, 0, &job));
    INVALID(oc_scene_closest_start(s0, &q, NULL, 0, &job));
    INVALID(oc_scene_closest_start(s0, &q, hit, 0, NULL));
    INVALID(oc_scene_any_start(NULL, &q, &any, 0, &job));
    INVALID(oc_scene_any_start(s0, NULL, &any, 0, &job));
    INVALID(oc_scene_any_start(s0, &q, NULL, 0, &job));
    INVALID(oc_scene_any_start(s0, &q, &any, 0, NULL));
    /* tests/abi/single_precision.c has the rest. */
    oc_query_f32 q32;
    oc_hit_f32 hit32;
    OC_INIT(&q32);
    q32.count = 1;
    INVALID(oc_scene_closest_f32(s0, &q32, &hit32, 0));
    INVALID(oc_scene_any_f32(s0, &q32, &any, 0));
    GARBAGE_SIZES(oc_query_f32, oc_scene_closest_f32(s0, s, &hit32, 0));
    GARBAGE_SIZES(oc_query_f32, oc_scene_any_f32(s0, s, &any, 0));
    GARBAGE_SIZES(oc_query, oc_scene_closest(s0, s, hit, 0));
    GARBAGE_SIZES(oc_query, oc_scene_any(s0, s, &any, 0));
    GARBAGE_SIZES(oc_query, oc_scene_closest_start(s0, s, hit, 0, &job));
    GARBAGE_SIZES(oc_query, oc_scene_any_start(s0, s, &any, 0, &job));
    q.want = 512;
    INVALID(oc_scene_closest(s0, &q, hit, 0));
    q.want = 0, q.flags = 4;
    INVALID(oc_scene_closest(s0, &q, hit, 0));
    q.flags = 0, q.reserved = 1;
    INVALID(oc_scene_closest(s0, &q, hit, 0));
    q.reserved = 0, q.stride = 8;
    INVALID(oc_scene_closest(s0, &q, hit, 0));
    q.stride = 0, q.count = UINT64_MAX / 64;
    INVALID(oc_scene_closest(s0, &q, hit, 0));
    q.count = 2, q.stride = UINT64_MAX - 1;
    INVALID(oc_scene_any(s0, &q, &any, 0));
    q.stride = 0, q.rays = NULL, q.count = 1;
    INVALID(oc_scene_closest(s0, &q, hit, 0));
    CHECK(any == 77 && job == NULL);

    q.rays = &ray;
    OK(oc_scene_closest(s0, &q, hit, 0));
    CHECK(hit->kind == OC_HIT_EXACT && hit->part == 7 && hit->instance == 1 && hit->prim == 0);
    OK(oc_scene_any(s0, &q, &any, 0));
    CHECK(any == 1);
    /* Footprints that are none count as 0. */
    const float widths[4][2] = {{NAN, NAN}, {-1e9f, 0}, {0, -1e9f}, {-INFINITY, NAN}};
    for (int i = 0; i < 4; i++) {
        ray.cone_a = widths[i][0], ray.cone_b = widths[i][1];
        OK(oc_scene_closest(s0, &q, hit, 0));
        CHECK(hit->kind == OC_HIT_EXACT && hit->part == 7 && hit->prim == 0);
    }
    ray.cone_a = ray.cone_b = 0;
    OK(oc_scene_any_start(s0, &q, &any, 0, &job));
    oc_job_release(job); /* waits until nobody touches `any` */
    int woken = 0;
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_scene_closest_start(s0, &q, hit, 0, &job));
    OK(oc_job_set_wake(job, wake, &woken));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(woken == 1 && progress.state == OC_STATE_DONE && progress.done == 1 && progress.total == 1);
    OK(oc_job_set_wake(job, wake, &woken)); /* it has ended: called at once */
    CHECK(woken == 2);
    oc_job_release(job);
    /* Released in its own wake function, from wherever that is called: from set_wake, wait or cancel here, or by a thread of the context. */
    for (int i = 0; i < 300; i++) {
        own_job own = {NULL, 0};
        OK(oc_scene_closest_start(s0, &q, hit, 0, &own.job));
        oc_job *job = own.job;
        oc_job_retain(job);
        OK(oc_job_set_wake(job, release_own, &own));
        if (i % 3 == 1) OK(oc_job_cancel(job));
        OK(oc_job_wait(job, OC_FOREVER, &progress));
        CHECK(own.released == 1);
        oc_job_release(job);
        /* Without a count beside it. */
        own.released = 0;
        OK(oc_scene_any_start(s0, &q, &any, 0, &own.job));
        OK(oc_job_set_wake(own.job, release_own, &own));
        while (!*(volatile int *)&own.released) OK(oc_context_step(c, NULL));
        /* The last count, from within the call that calls back. */
        own.released = 0;
        OK(oc_scene_closest_start(s0, &q, hit, 0, &own.job));
        OK(oc_job_wait(own.job, OC_FOREVER, &progress));
        OK(oc_job_set_wake(own.job, release_own, &own));
        CHECK(own.released == 1);
    }
    /* Rays that cannot hit. */
    const float directions[4][3] = {{0, 0, 0}, {NAN, 0, 1}, {INFINITY, 0, 0}, {0, 0, -1}};
    for (int i = 0; i < 4; i++) {
        memcpy(ray.direction, directions[i], sizeof ray.direction);
        OK(oc_scene_closest(s0, &q, hit, 0));
        CHECK(hit->kind == OC_HIT_MISS && hit->t == INFINITY && hit->part == OC_NO_ID);
    }
    free(hit);
}

enum { COUNT = 100 };

/* However rays lie in memory, and whether ends and masks are said or left at 0, the answers are the same. */
static void ways_to_give(oc_scene *s0, oc_ray *tight) {
    enum { STRIDE = sizeof(oc_ray) + 8 };
    unsigned char *loose = (unsigned char *)calloc(COUNT + 1, STRIDE), *crooked = (unsigned char *)calloc(COUNT + 1, sizeof *tight);
    oc_hit *first = (oc_hit *)calloc(COUNT, sizeof *first), *hits = (oc_hit *)calloc(COUNT, sizeof *hits);
    uint8_t any[COUNT];
    int met = 0;
    oc_query q;
    OC_INIT(&q);
    q.rays = tight, q.count = COUNT;
    OK(oc_scene_closest(s0, &q, first, 0));
    for (int i = 0; i < COUNT; i++) {
        met += first[i].kind == OC_HIT_EXACT;
        memcpy(loose + i * STRIDE, &tight[i], sizeof *tight);
        memcpy(crooked + 4 + i * sizeof *tight, &tight[i], sizeof *tight);
    }
    CHECK(met > 10 && met < COUNT);
    q.rays = (const oc_ray *)loose, q.stride = STRIDE;
    OK(oc_scene_closest(s0, &q, hits, 0));
    CHECK(memcmp(first, hits, COUNT * sizeof *hits) == 0);
    q.rays = (const oc_ray *)(crooked + 4), q.stride = 0;
    OK(oc_scene_closest(s0, &q, hits, 0));
    CHECK(memcmp(first, hits, COUNT * sizeof *hits) == 0);
    /* One by one. */
    q.count = 1;
    for (int i = 0; i < COUNT; i++) {
        q.rays = tight + i;
        OK(oc_scene_closest(s0, &q, hits + i, 0));
    }
    CHECK(memcmp(first, hits, COUNT * sizeof *hits) == 0);
    q.count = COUNT;
    /* Some say their ends, some their masks; of the first packet all say both. */
    for (int i = 0; i < COUNT; i++) {
        tight[i].t_max = i < 32 || i % 2 ? INFINITY : 0;
        tight[i].mask = i < 32 || i % 3 ? 0xFFFFFFFF : 0;
    }
    q.rays = tight;
    OK(oc_scene_closest(s0, &q, hits, 0));
    CHECK(memcmp(first, hits, COUNT * sizeof *hits) == 0);
    OK(oc_scene_any(s0, &q, any, 0));
    for (int i = 0; i < COUNT; i++) CHECK(any[i] == (first[i].kind == OC_HIT_EXACT));
    oc_job *job = NULL;
    memset(hits, 0, COUNT * sizeof *hits);
    OK(oc_scene_closest_start(s0, &q, hits, 0, &job));
    OK(oc_job_wait(job, OC_FOREVER, NULL));
    oc_job_release(job);
    CHECK(memcmp(first, hits, COUNT * sizeof *hits) == 0);
    memcpy(crooked + 8, tight, COUNT * sizeof *tight);
    q.rays = (const oc_ray *)(crooked + 8);
    OK(oc_scene_closest(s0, &q, hits, 0));
    CHECK(memcmp(first, hits, COUNT * sizeof *hits) == 0);
    /* Answers into the rays themselves, where nothing is left to read: into their masks. */
    OK(oc_scene_any(s0, &q, crooked + 8 + sizeof *tight - 4, sizeof *tight));
    for (int i = 0; i < COUNT; i++) CHECK(crooked[8 + (i + 1) * sizeof *tight - 4] == (first[i].kind == OC_HIT_EXACT));
    /* Widths that are none, of all or of some. */
    for (int i = 0; i < COUNT; i++) tight[i].cone_b = i < 40 ? NAN : i % 2 ? -1.0f : -INFINITY;
    q.rays = tight;
    OK(oc_scene_closest(s0, &q, hits, 0));
    CHECK(memcmp(first, hits, COUNT * sizeof *hits) == 0);
    /* What is said counts: a ray may end before anything is there. */
    for (int i = 0; i < COUNT; i++) tight[i].t_max = 0.5;
    OK(oc_scene_closest(s0, &q, hits, 0));
    for (int i = 0; i < COUNT; i++) CHECK(hits[i].kind == OC_HIT_MISS);
    free(loose), free(crooked), free(first), free(hits);
}

/* Rays side by side, and from one point, some of them not of length 1. */
static void ways_to_give_rays(oc_scene *s0) {
    oc_ray *tight = (oc_ray *)calloc(COUNT, sizeof *tight);
    for (int i = 0; i < COUNT; i++) {
        const oc_ray ray = {{0.03 * (i % 10) + 0.02, 0.15 * (i / 10) + 0.02, -1}, 0, 0, {0, 0, 1}, 0, 0, 0};
        tight[i] = ray;
    }
    ways_to_give(s0, tight);
    for (int i = 0; i < COUNT; i++) {
        const float size = i % 3 ? 1 : 1.5f;
        const oc_ray ray = {{0.1, 0.2, -1}, 0, 0, {size * (0.03f * (i % 10) - 0.07f), size * (0.15f * (i / 10) - 0.17f), size}, 0, 0, 0};
        tight[i] = ray;
    }
    ways_to_give(s0, tight);
    free(tight);
}

static void overlaps(oc_scene *s0) {
    double low[3] = {-1, -1, -1}, high[3] = {2, 2, 2};
    oc_plane planes[2] = {{{1, 0, 0}, 1}, {{0, 1, 0}, 1}};
    oc_overlap *found = (oc_overlap *)malloc(sizeof *found);
    uint64_t count = 77;
    INVALID(oc_scene_overlap_box(NULL, low, high, found, 1, &count));
    INVALID(oc_scene_overlap_box(s0, NULL, high, found, 1, &count));
    INVALID(oc_scene_overlap_box(s0, low, NULL, found, 1, &count));
    INVALID(oc_scene_overlap_box(s0, low, high, NULL, 1, &count));
    INVALID(oc_scene_overlap_box(s0, low, high, found, 1, NULL));
    INVALID(oc_scene_overlap_box(s0, low, high, found, UINT64_MAX, &count));
    INVALID(oc_scene_overlap_frustum(NULL, planes, 2, found, 1, &count));
    INVALID(oc_scene_overlap_frustum(s0, NULL, 2, found, 1, &count));
    INVALID(oc_scene_overlap_frustum(s0, planes, UINT64_MAX, found, 1, &count));
    INVALID(oc_scene_overlap_frustum(s0, planes, 2, NULL, 1, &count));
    INVALID(oc_scene_overlap_frustum(s0, planes, 2, found, 1, NULL));
    INVALID(oc_scene_overlap_frustum(s0, NULL, 0, found, 1, &count));
    CHECK(count == 77);
    low[0] = NAN;
    INVALID(oc_scene_overlap_box(s0, low, high, found, 1, &count));
    low[0] = -1;
    OK(oc_scene_overlap_box(s0, low, high, NULL, 0, &count));
    CHECK(count == 1);
    OK(oc_scene_overlap_box(s0, low, high, found, 1, &count));
    CHECK(found->part == 7 && found->instance == 1 && found->kind == OC_OVERLAP_INSIDE);
    OK(oc_scene_overlap_frustum(s0, planes, 2, found, 1, &count));
    CHECK(count == 1 && found->part == 7);
    free(found);
}

/* One part, of which nothing clashes with anything: a search without results, and all ways to ask wrongly. */
static void clashes(oc_scene *s0) {
    oc_part_set *set = NULL, *empty = NULL;
    INVALID(oc_part_set_create(NULL));
    OK(oc_part_set_create(&set));
    OK(oc_part_set_create(&empty));
    INVALID(oc_part_set_add_instance(NULL, 1));
    INVALID(oc_part_set_add_part(NULL, 1, 7));
    INVALID(oc_part_set_add_part((oc_part_set *)s0, 1, 7));
    INVALID(oc_part_set_add_instance(JUNK(oc_part_set), 1));
    oc_part_set_retain(JUNK(oc_part_set));
    oc_part_set_release(JUNK(oc_part_set));
    OK(oc_part_set_add_part(set, OC_NO_ID, 7));
    OK(oc_part_set_add_instance(set, 1));
    oc_part_set_retain(set);
    oc_part_set_release(set);
    oc_part_set_retain(NULL);
    oc_part_set_release(NULL);
    oc_job *job = NULL;
    oc_clash_desc desc;
    OC_INIT(&desc);
    INVALID(oc_scene_clash_start(NULL, &desc, &job));
    INVALID(oc_scene_clash_start(s0, &desc, NULL));
    INVALID(oc_scene_clash_start((oc_scene *)set, &desc, &job));
    GARBAGE_SIZES(oc_clash_desc, oc_scene_clash_start(s0, s, &job));
    const double bad[] = {-1, -INFINITY, NAN, INFINITY};
    for (int i = 0; i < 4; i++) {
        desc.clearance = bad[i];
        INVALID(oc_scene_clash_start(s0, &desc, &job));
        desc.clearance = 0, desc.tolerance = bad[i];
        INVALID(oc_scene_clash_start(s0, &desc, &job));
        desc.tolerance = 0;
    }
    desc.detail = 9;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    desc.detail = OC_CLASH_DETAIL_TRIANGLES;
    desc.skip = 1u << 30;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    desc.skip = OC_CLASH_SKIP_SAME_PARENT;
    desc.reserved = 1;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    desc.reserved = 0;
    desc.skip_count = 1;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    const uint64_t none[2] = {0, 0};
    desc.skip_pairs = none, desc.skip_count = UINT64_MAX;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    desc.skip_pairs = NULL, desc.skip_count = 0;
    desc.second = empty;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    desc.second = NULL;
    desc.first = empty;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    desc.first = (const oc_part_set *)s0;
    INVALID(oc_scene_clash_start(s0, &desc, &job));
    CHECK(job == NULL);
    desc.first = set;
    const uint64_t pair[2] = {7, 7};
    desc.skip_pairs = pair;
    desc.skip_count = 1;
    OK(oc_scene_clash_start(s0, &desc, &job));
    oc_clash *found = (oc_clash *)malloc(2 * sizeof *found);
    uint64_t count = 77;
    OK(oc_job_wait(job, OC_FOREVER, NULL));
    INVALID(oc_job_take_clashes(NULL, found, 2, &count));
    INVALID(oc_job_take_clashes(job, NULL, 2, &count));
    INVALID(oc_job_take_clashes(job, found, UINT64_MAX, &count));
    INVALID(oc_job_take_clashes(job, found, 2, NULL));
    CHECK(count == 77);
    OK(oc_job_take_clashes(job, NULL, 0, &count));
    CHECK(count == 0);
    OK(oc_job_take_clashes(job, found, 2, &count));
    CHECK(count == 0);
    oc_clash_summary summary;
    OC_INIT(&summary);
    INVALID(oc_job_clash_summary(NULL, &summary));
    INVALID(oc_job_clash_summary(job, NULL));
    GARBAGE_SIZES(oc_clash_summary, oc_job_clash_summary(job, s));
    OK(oc_job_clash_summary(job, &summary));
    CHECK(summary.clashes == 0 && summary.pairs == 0 && summary.is_cut == 0);
    oc_job_release(job);
    /* An instance that is not there: the job fails, and says so. */
    OK(oc_part_set_add_instance(empty, 4711));
    desc.first = empty;
    OK(oc_scene_clash_start(s0, &desc, &job));
    oc_progress progress;
    OC_INIT(&progress);
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_FAILED && progress.error == OC_STATUS_INVALID_ARGUMENT);
    CHECK(strstr(oc_last_error(), "4711") != NULL);
    CHECK(oc_job_clash_summary(job, &summary) == OC_STATUS_INVALID_STATE);
    oc_job_release(job);
    /* All parts, and an end before the end. */
    OK(oc_scene_clash_start(s0, NULL, &job));
    OK(oc_job_cancel(job));
    oc_job_release(job);
    /* Another kind of job. */
    const double low[3] = {0, 0, 0}, high[3] = {1, 1, 1};
    OK(oc_scene_prefetch_box(s0, low, high, 0, &job));
    INVALID(oc_job_take_clashes(job, found, 2, &count));
    OK(oc_job_wait(job, OC_FOREVER, NULL));
    CHECK(oc_job_clash_summary(job, &summary) != OC_STATUS_OK);
    oc_job_release(job);
    free(found);
    oc_part_set_release(set);
    oc_part_set_release(empty);
}

/* Two instances of the tetrahedron that cross, in a context without threads, with threads, and with threads of the
 * host: before the end of the job, after it, and without its end. */
static void clashes_of_contexts(void) {
    const double place[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.125, 0.125, 0.0625};
    oc_clash first[16];
    uint64_t firsts = 0;
    for (int way = 0; way < 3; way++) {
        oc_context *c;
        oc_context_desc context;
        oc_executor executor;
        OC_INIT(&context);
        OC_INIT(&executor);
        executor.submit = submit, executor.concurrency = 1;
        context.threads = way == 1 ? 2 : 0;
        if (way == 2) context.executor = &executor;
        OK(oc_context_create(OC_HEADER_VERSION, &context, &c));
        oc_model *m;
        oc_scene *s;
        OK(oc_model_open(c, file("m.oc"), &m));
        OK(oc_scene_create(c, &s));
        OK(oc_scene_add_instance(s, m, 1, NULL));
        OK(oc_scene_add_instance(s, m, 2, place));
        OK(oc_scene_commit(s));
        oc_model_release(m);

        oc_part_set *one, *two;
        OK(oc_part_set_create(&one));
        OK(oc_part_set_create(&two));
        OK(oc_part_set_add_instance(one, 1));
        OK(oc_part_set_add_part(two, 2, 7));
        oc_job *job;
        oc_progress progress;
        oc_clash_desc desc;
        oc_clash_summary summary;
        oc_clash found[16];
        OC_INIT(&progress);
        OC_INIT(&desc);
        OC_INIT(&summary);
        int woken = 0;
        desc.first = one, desc.second = two, desc.detail = OC_CLASH_DETAIL_TRIANGLES;
        OK(oc_scene_clash_start(s, &desc, &job));
        oc_part_set_release(one); /* the job has copies */
        OK(oc_part_set_add_instance(two, 4711));
        oc_part_set_release(two);
        uint64_t count = 0, all = 0, left = 77;
        if (way == 0) { /* it waits for a step */
            summary.pairs = 77;
            EXPECT(OC_STATUS_INVALID_STATE, oc_job_clash_summary(job, &summary));
            CHECK(summary.pairs == 77);
            OK(oc_job_take_clashes(job, found, 16, &count));
            CHECK(count == 0);
            OK(oc_job_set_wake(job, wake, &woken));
        }
        do {
            OK(oc_job_wait(job, 1, &progress));
            do { /* one at a time, also while it runs */
                CHECK(all < 16);
                OK(oc_job_take_clashes(job, found + all, 1, &count));
                all += count;
            } while (count == 1);
        } while (progress.state == OC_STATE_RUNNING);
        CHECK(progress.state == OC_STATE_DONE && progress.fraction == 1 && woken == (way == 0));
        OK(oc_job_take_clashes(job, NULL, 0, &left));
        OK(oc_job_clash_summary(job, &summary));
        CHECK(left == 0 && all > 1 && summary.clashes == all && summary.pairs == 1 && summary.is_cut == 0);
        for (uint64_t i = 0; i < all; i++) {
            const oc_clash *it = &found[i];
            CHECK(it->instance[0] == 1 && it->instance[1] == 2 && it->part[0] == 7 && it->part[1] == 7);
            CHECK(it->prim[0] < 4 && it->prim[1] < 4 && it->distance == 0 && it->count == 1 && it->open == 0);
            CHECK(it->kind >= OC_CLASH_CROSSING && it->kind <= OC_CLASH_TOUCHING);
            for (int k = 0; k < 3; k++) CHECK(it->low[k] <= it->first_point[k] && it->first_point[k] <= it->high[k]);
        }
        if (way == 0) memcpy(first, found, sizeof first), firsts = all;
        CHECK(all == firsts && !memcmp(found, first, (size_t)all * sizeof *found));
        oc_job_release(job);

        /* The waiting ones are counted, and taken in two parts; no more than the limit. */
        OC_INIT(&desc);
        desc.detail = OC_CLASH_DETAIL_TRIANGLES, desc.limit = 1;
        OK(oc_scene_clash_start(s, &desc, &job));
        OK(oc_job_wait(job, OC_FOREVER, &progress));
        OK(oc_job_take_clashes(job, found, 0, &left));
        OK(oc_job_take_clashes(job, found, 16, &count));
        OK(oc_job_clash_summary(job, &summary));
        CHECK(left == 1 && count == 1 && summary.clashes == 1 && summary.pairs == 1 && summary.is_cut == 1);
        oc_job_release(job);

        /* Cancelled, with the state that each way allows; released while it may run; and its scene before it. */
        OK(oc_scene_clash_start(s, NULL, &job));
        OK(oc_job_cancel(job));
        OK(oc_job_wait(job, OC_FOREVER, &progress));
        CHECK(progress.state == OC_STATE_CANCELLED || (way > 0 && progress.state == OC_STATE_DONE));
        if (progress.state == OC_STATE_CANCELLED) {
            EXPECT(OC_STATUS_INVALID_STATE, oc_job_clash_summary(job, &summary));
            OK(oc_job_take_clashes(job, found, 16, &count));
            CHECK(count == 0);
        }
        oc_job_release(job);
        OK(oc_scene_clash_start(s, NULL, &job));
        oc_job_release(job);
        OK(oc_scene_clash_start(s, NULL, &job));
        oc_scene_release(s);
        OK(oc_job_wait(job, OC_FOREVER, &progress));
        OK(oc_job_take_clashes(job, found, 16, &count));
        CHECK(progress.state == OC_STATE_DONE && count == 1 && found[0].prim[0] == OC_NO_ID);
        oc_job_release(job);
        oc_context_release(c);
    }
}

/* Two rays through the tetrahedron, and two bad ones. */
static void crossings(oc_scene *s0) {
    const oc_ray given[4] = {
        {{0.25, 0.25, -1}, 0, 0, {0, 0, 1}, 0, 0, 0},
        {{0.25, 0.25, 2}, 0, 0, {0, 0, -2}, 0, 0, 0},
        {{NAN, 0.25, 2}, 0, 0, {0, 0, -2}, 0, 0, 0},
        {{0.25, 0.25, 2}, 0, 0, {NAN, 0, -2}, 0, 0, 0},
    };
    oc_ray *rays = (oc_ray *)malloc(sizeof given);
    oc_crossing *found = (oc_crossing *)malloc(4 * sizeof *found);
    uint64_t *ends = (uint64_t *)malloc(4 * sizeof *ends), count = 77;
    uint8_t complete[4];
    oc_query q;
    memcpy(rays, given, sizeof given);
    OC_INIT(&q);
    INVALID(oc_scene_crossings(s0, NULL, found, 4, ends, NULL, &count));
    q.rays = rays;
    q.count = 4;
    INVALID(oc_scene_crossings(NULL, &q, found, 4, ends, NULL, &count));
    INVALID(oc_scene_crossings(s0, &q, NULL, 4, ends, NULL, &count));
    INVALID(oc_scene_crossings(s0, &q, found, 4, NULL, NULL, &count));
    INVALID(oc_scene_crossings(s0, &q, found, 4, ends, NULL, NULL));
    INVALID(oc_scene_crossings(s0, &q, found, UINT64_MAX, ends, NULL, &count));
    q.stride = sizeof *rays - 1;
    INVALID(oc_scene_crossings(s0, &q, found, 4, ends, NULL, &count));
    q.stride = 0;
    q.flags = 1u << 31;
    INVALID(oc_scene_crossings(s0, &q, found, 4, ends, NULL, &count));
    q.flags = 0;
    q.want = 1u << 31;
    INVALID(oc_scene_crossings(s0, &q, found, 4, ends, NULL, &count));
    q.want = 0;
    q.count = UINT64_MAX;
    INVALID(oc_scene_crossings(s0, &q, found, 4, ends, NULL, &count));
    q.count = 4;
    CHECK(count == 77);
    OK(oc_scene_crossings(s0, &q, NULL, 0, ends, NULL, &count));
    CHECK(count == 4 && ends[0] == 2 && ends[1] == 4 && ends[2] == 4 && ends[3] == 4);
    count = 77;
    CHECK(oc_scene_crossings(s0, &q, found, 3, ends, NULL, &count) == OC_STATUS_BUFFER_TOO_SMALL);
    CHECK(count == 4 && ends[3] == 4);
    memset(complete, 9, sizeof complete);
    OK(oc_scene_crossings(s0, &q, found, 4, ends, complete, &count));
    CHECK(count == 4 && found[0].t == 1 && found[1].t == 1.5 && found[2].t == 0.75 && found[3].t == 1);
    for (int i = 0; i < 4; i++) CHECK(found[i].part == 7 && found[i].instance == 1 && found[i].kind == OC_HIT_EXACT);
    for (int i = 0; i < 2; i++) CHECK(found[2 * i].side == OC_SIDE_FRONT && found[2 * i + 1].side == OC_SIDE_BACK);
    CHECK(found[0].prim == found[3].prim && found[0].normal[2] == -1 && found[3].normal[2] == 1);
    for (int i = 0; i < 4; i++) CHECK(complete[i] == 1);
    q.flags = OC_QUERY_NOW;
    OK(oc_scene_crossings(s0, &q, found, 4, ends, complete, &count));
    q.count = 0;
    OK(oc_scene_crossings(s0, &q, NULL, 0, NULL, NULL, &count));
    CHECK(count == 0);
    free(rays), free(found), free(ends);
}

/* Points outside and inside of a tetrahedron, and two sets of the one part. */
static void nearest(oc_scene *s0) {
    double points[2][3] = {{-1, 0.25, 0.25}, {0.2, 0.2, 0.125}};
    oc_nearest_point *found = (oc_nearest_point *)malloc(2 * sizeof *found);
    oc_part_set *empty;
    oc_nearest_desc desc;
    OK(oc_part_set_create(&empty));
    OC_INIT(&desc);
    desc.points = points[0];
    desc.count = 2;
    found[0].distance = 77;
    INVALID(oc_scene_nearest(NULL, &desc, found, 0));
    INVALID(oc_scene_nearest((oc_scene *)empty, &desc, found, 0));
    INVALID(oc_scene_nearest(s0, NULL, found, 0));
    INVALID(oc_scene_nearest(s0, &desc, NULL, 0));
    INVALID(oc_scene_nearest(s0, &desc, found, sizeof *found - 1));
    GARBAGE_SIZES(oc_nearest_desc, oc_scene_nearest(s0, s, found, 0));
    const double bad[] = {-1, -INFINITY, NAN};
    for (int i = 0; i < 3; i++) {
        desc.max_distance = bad[i];
        INVALID(oc_scene_nearest(s0, &desc, found, 0));
    }
    desc.max_distance = 0;
    desc.flags = 4;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    desc.flags = OC_NEAREST_INSIDE | OC_NEAREST_NOW;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    desc.flags = OC_NEAREST_INSIDE;
    desc.stride = 23;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    desc.stride = 0;
    desc.count = UINT64_MAX;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    desc.count = 2;
    desc.points = NULL;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    desc.points = points[0];
    desc.parts = empty;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    OK(oc_part_set_add_instance(empty, 4711));
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    CHECK(strstr(oc_last_error(), "4711") != NULL);
    desc.parts = (const oc_part_set *)s0;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    desc.parts = NULL;
    points[1][2] = NAN;
    INVALID(oc_scene_nearest(s0, &desc, found, 0));
    CHECK(strstr(oc_last_error(), "point 1") != NULL && found[0].distance == 77);
    points[1][2] = 0.125;
    OK(oc_scene_nearest(s0, &desc, found, 0));
    CHECK(found[0].kind == OC_HIT_EXACT && fabs(found[0].distance - 1) <= found[0].error && found[0].holds == 0);
    CHECK(fabs(found[0].position[0]) <= found[0].error && found[0].part == 7 && found[0].instance == 1);
    CHECK(fabs(found[1].distance - 0.125) <= found[1].error && found[1].holds == OC_HOLDS_INSIDE);
    desc.max_distance = 0.5;
    OK(oc_scene_nearest(s0, &desc, found, 0));
    CHECK(found[0].kind == OC_HIT_MISS && isinf(found[0].distance) && found[0].part == OC_NO_ID);
    CHECK(found[1].kind == OC_HIT_EXACT);
    desc.flags = OC_NEAREST_NOW;
    OK(oc_scene_nearest(s0, &desc, found, 0));
    CHECK(found[1].distance - found[1].error <= 0.125 && found[1].distance + found[1].error >= 0.125);
    desc.points = NULL;
    desc.count = 0;
    OK(oc_scene_nearest(s0, &desc, NULL, 0));

    oc_distance_desc pair;
    oc_distance apart;
    OC_INIT(&pair);
    OC_INIT(&apart);
    apart.distance = 77;
    INVALID(oc_scene_distance(NULL, &pair, &apart));
    INVALID(oc_scene_distance(s0, &pair, NULL));
    GARBAGE_SIZES(oc_distance_desc, oc_scene_distance(s0, s, &apart));
    GARBAGE_SIZES(oc_distance, oc_scene_distance(s0, &pair, s));
    pair.reserved = 1;
    INVALID(oc_scene_distance(s0, &pair, &apart));
    pair.reserved = 0;
    for (int i = 0; i < 3; i++) {
        pair.max_distance = bad[i];
        INVALID(oc_scene_distance(s0, &pair, &apart));
    }
    pair.max_distance = 0;
    pair.second = empty;
    INVALID(oc_scene_distance(s0, &pair, &apart));
    pair.second = (const oc_part_set *)s0;
    INVALID(oc_scene_distance(s0, &pair, &apart));
    CHECK(apart.distance == 77);
    OK(oc_scene_distance(s0, NULL, &apart));
    CHECK(apart.found == 0 && isinf(apart.distance) && apart.part[0] == OC_NO_ID);
    oc_part_set_release(empty);
    free(found);
}

static void parts_at(oc_scene *s0) {
    double points[3][3] = {{0.2, 0.2, 0.2}, {0.9, 0.9, 0.9}, {NAN, 0, 0}};
    oc_part_at *found = (oc_part_at *)malloc(sizeof *found);
    uint64_t *ends = (uint64_t *)malloc(3 * sizeof *ends), count = 77;
    INVALID(oc_scene_parts_at(NULL, points[0], 3, 0, found, 1, ends, &count));
    INVALID(oc_scene_parts_at(s0, NULL, 3, 0, found, 1, ends, &count));
    INVALID(oc_scene_parts_at(s0, points[0], 3, 23, found, 1, ends, &count));
    INVALID(oc_scene_parts_at(s0, points[0], UINT64_MAX, 0, found, 1, ends, &count));
    INVALID(oc_scene_parts_at(s0, points[0], 3, 0, NULL, 1, ends, &count));
    INVALID(oc_scene_parts_at(s0, points[0], 3, 0, found, UINT64_MAX, ends, &count));
    INVALID(oc_scene_parts_at(s0, points[0], 3, 0, found, 1, NULL, &count));
    INVALID(oc_scene_parts_at(s0, points[0], 3, 0, found, 1, ends, NULL));
    CHECK(count == 77);
    OK(oc_scene_parts_at(s0, points[0], 3, 0, NULL, 0, ends, &count));
    CHECK(count == 1 && ends[0] == 1 && ends[1] == 1 && ends[2] == 1);
    OK(oc_scene_parts_at(s0, points[0], 3, 0, found, 1, ends, &count));
    CHECK(found->part == 7 && found->instance == 1 && found->winding == 1 && found->holds == OC_HOLDS_INSIDE);
    for (int i = 0; i < 3; i++) points[1][i] = 0.1;
    CHECK(oc_scene_parts_at(s0, points[0], 3, 0, found, 1, ends, &count) == OC_STATUS_BUFFER_TOO_SMALL);
    CHECK(count == 2);
    OK(oc_scene_parts_at(s0, NULL, 0, 0, NULL, 0, NULL, &count));
    CHECK(count == 0);
    free(found), free(ends);
}

static void thickness(oc_scene *s0) {
    const oc_ray ray = {{0.25, 0.25, -1}, 0, 0, {0, 0, 1}, 0, 0, 0};
    oc_hit *hits = (oc_hit *)malloc(2 * sizeof *hits);
    double *found = (double *)malloc(2 * sizeof *found);
    oc_query q;
    OC_INIT(&q);
    q.rays = &ray;
    q.count = 1;
    OK(oc_scene_closest(s0, &q, hits, 0));
    hits[1] = hits[0];
    hits[1].kind = OC_HIT_MISS;
    INVALID(oc_scene_thickness(NULL, hits, 2, 0, found, 0));
    INVALID(oc_scene_thickness(s0, NULL, 2, 0, found, 0));
    INVALID(oc_scene_thickness(s0, hits, 2, 0, NULL, 0));
    INVALID(oc_scene_thickness(s0, hits, 2, sizeof *hits - 1, found, 0));
    INVALID(oc_scene_thickness(s0, hits, 2, 0, found, 7));
    INVALID(oc_scene_thickness(s0, hits, UINT64_MAX, 0, found, 0));
    OK(oc_scene_thickness(s0, hits, 2, 0, found, 0));
    CHECK(fabs(found[0] - 0.5) < 1e-12 && isinf(found[1]));
    for (int i = 0; i < 3; i++) hits[0].normal[i] = NAN;
    hits[0].kind = 99;
    OK(oc_scene_thickness(s0, hits, 1, 0, found, 0));
    CHECK(isinf(found[0]));
    OK(oc_scene_thickness(s0, NULL, 0, 0, NULL, 0));
    free(hits), free(found);
}

static void prefetches(oc_scene *s0) {
    double low[3] = {-1, -1, -1}, high[3] = {2, 2, 2};
    oc_camera camera;
    oc_job *job = NULL;
    oc_progress progress;
    oc_model *model = NULL;
    int woken = 0;
    OC_INIT(&camera);
    OC_INIT(&progress);
    camera.eye[0] = 3;
    INVALID(oc_scene_prefetch_box(NULL, low, high, 0, &job));
    INVALID(oc_scene_prefetch_box(s0, NULL, high, 0, &job));
    INVALID(oc_scene_prefetch_box(s0, low, NULL, 0, &job));
    INVALID(oc_scene_prefetch_box(s0, low, high, NAN, &job));
    INVALID(oc_scene_prefetch_box(s0, low, high, -1, &job));
    INVALID(oc_scene_prefetch_box(s0, low, high, 0, NULL));
    low[1] = NAN;
    INVALID(oc_scene_prefetch_box(s0, low, high, 0, &job));
    low[1] = -1;
    INVALID(oc_scene_prefetch_camera(NULL, &camera, 8, 8, 0, &job));
    INVALID(oc_scene_prefetch_camera(s0, NULL, 8, 8, 0, &job));
    INVALID(oc_scene_prefetch_camera(s0, &camera, 0, 8, 0, &job));
    INVALID(oc_scene_prefetch_camera(s0, &camera, 8, 65537, 0, &job));
    INVALID(oc_scene_prefetch_camera(s0, &camera, 8, 8, NAN, &job));
    INVALID(oc_scene_prefetch_camera(s0, &camera, 8, 8, -1, &job));
    INVALID(oc_scene_prefetch_camera(s0, &camera, 8, 8, 0, NULL));
    GARBAGE_SIZES(oc_camera, oc_scene_prefetch_camera(s0, s, 8, 8, 0, &job));
    CHECK(job == NULL);
    OK(oc_scene_prefetch_box(s0, low, high, 0, &job));
    OK(oc_job_set_wake(job, wake, &woken));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE && progress.fraction == 1 && progress.error == OC_STATUS_OK && woken == 1);
    EXPECT(OC_STATUS_INVALID_STATE, oc_job_model(job, &model));
    oc_job_release(job);
    OK(oc_scene_prefetch_camera(s0, &camera, 64, 48, 1, &job));
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    OK(oc_job_cancel(job)); /* too late */
    OK(oc_job_poll(job, &progress));
    CHECK(progress.state == OC_STATE_DONE);
    oc_job_release(job);
    OK(oc_scene_prefetch_camera(s0, &camera, 64, 48, 1, &job));
    oc_job_release(job); /* before anybody began it */
}

/* Rays and frusta of a camera, and cameras that fit a scene. */
static void views(oc_context *c, oc_scene *s0) {
    oc_camera camera, fitted;
    oc_fit fit;
    oc_ray ray;
    oc_hit hit;
    oc_query query;
    oc_plane planes[5];
    oc_scene *empty = NULL;
    uint64_t count = 0;
    OC_INIT(&camera);
    OC_INIT(&fitted);
    OC_INIT(&fit);
    OC_INIT(&query);
    camera.eye[2] = 5;
    INVALID(oc_camera_ray(NULL, 8, 6, 4, 3, &ray));
    INVALID(oc_camera_ray(&camera, 0, 6, 4, 3, &ray));
    INVALID(oc_camera_ray(&camera, 8, 6, NAN, 3, &ray));
    INVALID(oc_camera_ray(&camera, 8, 6, 4, INFINITY, &ray));
    INVALID(oc_camera_ray(&camera, 8, 6, 4, 3, NULL));
    INVALID(oc_camera_ray(&camera, 8, 6, 4, 3, &ray)); /* up, +Z, is parallel to the view */
    GARBAGE_SIZES(oc_camera, oc_camera_ray(s, 8, 6, 4, 3, &ray));
    camera.up[1] = 1;
    OK(oc_camera_ray(&camera, 8, 6, 4, 3, &ray));
    CHECK(ray.origin[2] == 5 && ray.direction[2] == -1 && ray.t_min == 0 && ray.t_max == 0 && ray.mask == 0);
    CHECK(ray.cone_a == 0 && ray.cone_b > 0.13f && ray.cone_b < 0.14f); /* 2 tan(22.5 degrees) / 6 */
    INVALID(oc_camera_frustum(NULL, 8, 6, 0, 0, 8, 6, planes));
    INVALID(oc_camera_frustum(&camera, 8, 0, 0, 0, 8, 6, planes));
    INVALID(oc_camera_frustum(&camera, 8, 6, 0, 0, 8, NAN, planes));
    INVALID(oc_camera_frustum(&camera, 8, 6, 0, 0, 8, 6, NULL));
    GARBAGE_SIZES(oc_camera, oc_camera_frustum(s, 8, 6, 0, 0, 8, 6, planes));

    INVALID(oc_scene_fit(s0, &fit, NULL, 0, 0, &fitted)); /* 0 by 0 */
    fit.width = 8, fit.height = 6;
    INVALID(oc_scene_fit(NULL, &fit, NULL, 0, 0, &fitted));
    INVALID(oc_scene_fit(s0, NULL, NULL, 0, 0, &fitted));
    INVALID(oc_scene_fit(s0, &fit, NULL, 1, 0, &fitted));
    INVALID(oc_scene_fit(s0, &fit, NULL, 0, 0, NULL));
    GARBAGE_SIZES(oc_fit, oc_scene_fit(s0, s, NULL, 0, 0, &fitted));
    GARBAGE_SIZES(oc_camera, oc_scene_fit(s0, &fit, NULL, 0, 0, s));
    oc_fit bad[9];
    for (int i = 0; i < 9; i++) bad[i] = fit;
    bad[0].kind = 2, bad[1].view = 11, bad[2].up_axis = 4, bad[3].view = OC_VIEW_ALONG, bad[4].fov_y = 180;
    bad[5].margin = 0.5, bad[6].flags = 2, bad[7].reserved = 1, bad[8].margin = NAN;
    for (int i = 0; i < 9; i++) INVALID(oc_scene_fit(s0, &bad[i], NULL, 0, 0, &fitted));
    const oc_part_ref unknown[] = {{12345, OC_NO_ID}};
    INVALID(oc_scene_fit(s0, &fit, unknown, 1, 0, &fitted));
    CHECK(strstr(oc_last_error(), "12345"));
    OK(oc_scene_create(c, &empty));
    EXPECT(OC_STATUS_INVALID_STATE, oc_scene_fit(empty, &fit, NULL, 0, 0, &fitted));
    oc_scene_release(empty);
    for (oc_view view = 0; view <= OC_VIEW_ALONG; view++) {
        fit.view = view, fit.direction[2] = -1, fit.kind = view % 2;
        OK(oc_scene_fit(s0, &fit, NULL, 0, 0, &fitted));
        CHECK(fitted.kind == view % 2);
        /* What is selected in the whole picture is all, and fits as all does. */
        oc_overlap found[64];
        oc_camera again;
        OC_INIT(&again);
        OK(oc_camera_frustum(&fitted, 8, 6, 8, 6, 0, 0, planes));
        OK(oc_scene_overlap_frustum(s0, planes, 5, found, 64, &count));
        CHECK(count > 0);
        OK(oc_scene_fit(s0, &fit, (const oc_part_ref *)found, count, sizeof(oc_overlap), &again));
        for (int axis = 0; axis < 3; axis++) CHECK(fabs(again.eye[axis] - fitted.eye[axis]) < 1e-9);
    }
    /* The ray through the middle of the picture hits what the camera fits. */
    OK(oc_camera_ray(&fitted, 8, 6, 4, 3, &ray));
    query.rays = &ray, query.count = 1;
    OK(oc_scene_closest(s0, &query, &hit, 0));
}

static void frames(oc_context *c, oc_scene *s0) {
    oc_frame *f = NULL;
    oc_frame_desc desc;
    oc_camera camera;
    oc_frame_settings settings;
    oc_progress progress;
    oc_frame_accuracy accuracy;
    oc_pixels pixels;
    oc_hit hit;
    oc_target target;
    int woken = 0;
    OC_INIT(&desc);
    OC_INIT(&camera);
    OC_INIT(&settings);
    OC_INIT(&progress);
    OC_INIT(&accuracy);
    OC_INIT(&pixels);
    memset(&target, 0, sizeof target);
    oc_camera camera_of_target;
    OC_INIT(&camera_of_target);
    camera_of_target.eye[0] = 5;
    INVALID(oc_frame_create(NULL, NULL, &f));
    INVALID(oc_frame_create(c, NULL, NULL));
    GARBAGE_SIZES(oc_frame_desc, oc_frame_create(c, s, &f));
    INVALID(oc_frame_create(c, &desc, &f)); /* 0 by 0 */
    CHECK(strstr(oc_last_error(), "0 x 0") && strstr(oc_last_error(), "1 to 65536"));
    desc.width = 65537, desc.height = 1;
    INVALID(oc_frame_create(c, &desc, &f));
    desc.width = 1, desc.height = 0;
    INVALID(oc_frame_create(c, &desc, &f));
    desc.height = 0xffffffff;
    INVALID(oc_frame_create(c, &desc, &f));
    desc.height = 1, desc.buffers = 1u << 31;
    INVALID(oc_frame_create(c, &desc, &f));
    desc.buffers = 0, desc.target_count = 1;
    INVALID(oc_frame_create(c, &desc, &f));
    desc.targets = &target;
    INVALID(oc_frame_create(c, &desc, &f)); /* no memory */
    desc.width = 4, desc.height = 3;
    unsigned char *memory = (unsigned char *)malloc(2 * 20 + 16);
    target.memory = memory, target.size = 2 * 20 + 15, target.row_pitch = 20;
    INVALID(oc_frame_create(c, &desc, &f)); /* a byte too little */
    target.size = UINT64_MAX;
    INVALID(oc_frame_create(c, &desc, &f));
    target.size = 2 * 20 + 16, target.row_pitch = 15;
    INVALID(oc_frame_create(c, &desc, &f));
    target.row_pitch = UINT64_MAX;
    INVALID(oc_frame_create(c, &desc, &f));
    target.row_pitch = 20, target.buffer = 12;
    INVALID(oc_frame_create(c, &desc, &f));
    target.buffer = 0, target.reserved = 1;
    INVALID(oc_frame_create(c, &desc, &f));
    target.reserved = 0, desc.buffers = 0;
    OK(oc_frame_create(c, &desc, &f));
    OK(oc_frame_request(f, s0, &camera_of_target, NULL));
    OK(oc_frame_wait(f, OC_FOREVER, NULL));
    EXPECT(OC_STATUS_INVALID_STATE, oc_frame_map(f, 0, &pixels)); /* it has a target, and is not kept for mapping */
    CHECK(strstr(oc_last_error(), "target") && strstr(oc_last_error(), "buffers"));
    EXPECT(OC_STATUS_INVALID_STATE, oc_frame_map(f, OC_BUFFER_DEPTH, &pixels));
    CHECK(!strstr(oc_last_error(), "target") && strstr(oc_last_error(), "buffers"));
    oc_frame_release(f);
    f = NULL;
    desc.target_count = UINT64_MAX;
    INVALID(oc_frame_create(c, &desc, &f));
    desc.target_count = 1, desc.buffers = 1;
    CHECK(f == NULL);
    OK(oc_frame_create(c, &desc, &f));

    camera.eye[2] = 5;
    camera.up[1] = 1;
    EXPECT(OC_STATUS_INVALID_STATE, oc_frame_map(f, 0, &pixels)); /* nothing rendered yet */
    EXPECT(OC_STATUS_INVALID_STATE, oc_frame_pick(f, 0, 0, &hit));
    EXPECT(OC_STATUS_INVALID_STATE, oc_frame_pick_near(f, 0, 0, 4, &hit));
    OK(oc_frame_poll(f, &progress));
    CHECK(progress.state == OC_STATE_IDLE);
    OK(oc_frame_wait(f, OC_FOREVER, &progress)); /* nothing to wait for */
    OK(oc_frame_cancel(f));
    INVALID(oc_frame_request(NULL, s0, &camera, NULL));
    INVALID(oc_frame_request(f, NULL, &camera, NULL));
    INVALID(oc_frame_request(f, s0, NULL, NULL));
    GARBAGE_SIZES(oc_camera, oc_frame_request(f, s0, s, NULL));
    GARBAGE_SIZES(oc_frame_settings, oc_frame_request(f, s0, &camera, s));
    camera.kind = 2;
    INVALID(oc_frame_request(f, s0, &camera, NULL));
    camera.kind = OC_CAMERA_ORTHOGRAPHIC; /* without a height */
    INVALID(oc_frame_request(f, s0, &camera, NULL));
    camera.kind = 0, camera.fov_y = 180;
    INVALID(oc_frame_request(f, s0, &camera, NULL));
    camera.fov_y = NAN;
    INVALID(oc_frame_request(f, s0, &camera, NULL));
    camera.fov_y = 0, camera.eye[2] = 0; /* eye = at */
    INVALID(oc_frame_request(f, s0, &camera, NULL));
    camera.eye[2] = INFINITY;
    INVALID(oc_frame_request(f, s0, &camera, NULL));
    camera.eye[2] = 5;
    settings.samples = 0xffffffff;
    INVALID(oc_frame_request(f, s0, &camera, &settings));
    settings.samples = 0;
    const float bad_poes[] = {NAN, -1, -1e-30f, INFINITY, -INFINITY};
    for (int i = 0; i < 5; i++) {
        settings.poe = bad_poes[i];
        INVALID(oc_frame_request(f, s0, &camera, &settings));
        CHECK(strstr(oc_last_error(), "poe"));
    }
    settings.poe = 0, settings.ambient = NAN;
    INVALID(oc_frame_request(f, s0, &camera, &settings));
    settings.ambient = 0, settings.flags = 4;
    INVALID(oc_frame_request(f, s0, &camera, &settings));
    oc_context *other;
    oc_scene *foreign;
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &other));
    OK(oc_scene_create(other, &foreign));
    INVALID(oc_frame_request(f, foreign, &camera, NULL));
    oc_scene_release(foreign);
    oc_context_release(other);

    INVALID(oc_frame_set_wake(NULL, wake, &woken));
    OK(oc_frame_set_wake(f, wake, &woken));
    OK(oc_frame_request(f, s0, &camera, NULL));
    INVALID(oc_frame_wait(NULL, 0, &progress));
    GARBAGE_SIZES(oc_progress, oc_frame_wait(f, 0, s));
    OK(oc_frame_wait(f, OC_FOREVER, &progress));
    CHECK(progress.state == OC_STATE_DONE && woken == 1);
    INVALID(oc_frame_poll(NULL, &progress));
    INVALID(oc_frame_poll(f, NULL));
    GARBAGE_SIZES(oc_progress, oc_frame_poll(f, s));
    INVALID(oc_frame_get_accuracy(NULL, &accuracy));
    INVALID(oc_frame_get_accuracy(f, NULL));
    GARBAGE_SIZES(oc_frame_accuracy, oc_frame_get_accuracy(f, s));
    accuracy.pictures = 77, accuracy.state = 78;
    accuracy.struct_size = (uint32_t)offsetof(oc_frame_accuracy, pictures); /* of an older header */
    OK(oc_frame_get_accuracy(f, &accuracy));
    CHECK(accuracy.request == 1 && accuracy.pictures == 77 && accuracy.state == 78);
    OC_INIT(&accuracy);
    OK(oc_frame_get_accuracy(f, &accuracy));
    CHECK(accuracy.pictures == 1 && accuracy.state == OC_STATE_DONE && accuracy.pixels_exact == 12);
    INVALID(oc_frame_cancel(NULL));
    INVALID(oc_frame_pick(NULL, 0, 0, &hit));
    INVALID(oc_frame_pick(f, 0, 0, NULL));
    INVALID(oc_frame_pick(f, 4, 0, &hit));
    INVALID(oc_frame_pick(f, 0, 0xffffffff, &hit));
    OK(oc_frame_pick(f, 3, 2, &hit));
    INVALID(oc_frame_pick_near(NULL, 0, 0, 4, &hit));
    INVALID(oc_frame_pick_near(f, 0, 0, 4, NULL));
    INVALID(oc_frame_pick_near(f, 4, 0, 4, &hit));
    INVALID(oc_frame_pick_near(f, 0, 0, -1, &hit));
    INVALID(oc_frame_pick_near(f, 0, 0, 33, &hit));
    INVALID(oc_frame_pick_near(f, 0, 0, NAN, &hit));
    OK(oc_frame_pick_near(f, 3, 2, 32, &hit));
    INVALID(oc_frame_map(NULL, 0, &pixels));
    INVALID(oc_frame_map(f, 0, NULL));
    INVALID(oc_frame_map(f, 12, &pixels));
    INVALID(oc_frame_map(f, 0xffffffff, &pixels));
    EXPECT(OC_STATUS_INVALID_STATE, oc_frame_map(f, OC_BUFFER_DEPTH, &pixels)); /* not kept */
    GARBAGE_SIZES(oc_pixels, oc_frame_map(f, 0, s));
    OK(oc_frame_map(f, 0, &pixels));
    CHECK(pixels.width == 4 && pixels.height == 3 && pixels.format == OC_FORMAT_U8X4);
    for (uint32_t y = 0; y < 3; y++) { /* the same picture in the caller's memory */
        CHECK(!memcmp(memory + 20 * y, (const char *)pixels.data + pixels.row_pitch * y, 16));
    }

    oc_frame *named;
    oc_pixels places;
    uint32_t met = 0;
    OC_INIT(&places);
    desc.target_count = 0, desc.buffers = 1u << OC_BUFFER_OCCURRENCE;
    OK(oc_frame_create(c, &desc, &named));
    OK(oc_frame_request(named, s0, &camera, NULL));
    OK(oc_frame_wait(named, OC_FOREVER, NULL));
    EXPECT(OC_STATUS_INVALID_STATE, oc_frame_map(named, OC_BUFFER_INSTANCE, &places));
    OK(oc_frame_map(named, OC_BUFFER_OCCURRENCE, &places));
    CHECK(places.format == OC_FORMAT_U64 && places.row_pitch == 32 && places.size == 96);
    for (uint32_t i = 0; i < 12; i++) { /* the place that a pick finds, or none, and its way */
        const uint64_t place = ((const uint64_t *)places.data)[i];
        uint64_t levels;
        OK(oc_frame_pick(named, i % 4, i / 4, &hit));
        CHECK(place == hit.occurrence);
        if (place == OC_NO_ID) INVALID(oc_scene_get_path(s0, place, NULL, 0, &levels, NULL));
        else OK(oc_scene_get_path(s0, place, NULL, 0, &levels, NULL));
        met += place != OC_NO_ID;
    }
    CHECK(met > 0);
    oc_mapping_release(places.mapping);
    oc_frame_release(named);

    INVALID(oc_frame_resize(NULL, 5, 5));
    INVALID(oc_frame_resize(f, 0, 5));
    INVALID(oc_frame_resize(f, 5, 65537));
    OK(oc_frame_resize(f, 64, 48));
    free(memory); /* let go by the resize */
    OK(oc_frame_request(f, s0, &camera, NULL));
    OK(oc_frame_cancel(f));
    OK(oc_frame_request(f, s0, &camera, NULL));
    oc_frame_retain(NULL);
    oc_frame_release(NULL);
    oc_frame_retain(f);
    oc_frame_release(f);
    oc_frame_release(f); /* while it renders */
    CHECK(((const unsigned char *)pixels.data)[3] <= 255); /* outlives the frame */
    oc_mapping_retain(NULL);
    oc_mapping_release(NULL);
    oc_mapping_retain(pixels.mapping);
    oc_mapping_release(pixels.mapping);
    oc_mapping_release(pixels.mapping);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    dir = argv[1];
    versions_and_messages();
    oc_context *c = contexts();
    logs();
    contents_of_builds(c);
    jobs(c);
    models(c);
    budgets();
    lying_sources(c);
    oc_scene *s0 = scenes(c);
    queries(c, s0);
    ways_to_give_rays(s0);
    overlaps(s0);
    clashes(s0);
    clashes_of_contexts();
    crossings(s0);
    parts_at(s0);
    nearest(s0);
    thickness(s0);
    prefetches(s0);
    views(c, s0);
    frames(c, s0);
    oc_context_release(c); /* before what was made from it */
    oc_scene_release(s0);
    return 0;
}
