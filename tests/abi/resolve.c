/* A host that resolves the names of files that mesh files refer to, and limits of builds. Argument: an empty folder. */

#include "check.h"
#include <string.h>

static char folder[4096];
static int calls, freed;

static const char *file(const char *name) {
    static char path[8192];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static void write_file(const char *name, const void *bytes, size_t size) {
    FILE *out = fopen(file(name), "wb");
    CHECK(out && fwrite(bytes, 1, size, out) == size && fclose(out) == 0);
}

static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
static const char gltf[] =
    "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"mesh\":0}],"
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":0}]}],"
    "\"materials\":[{\"pbrMetallicRoughness\":{\"metallicRoughnessTexture\":{\"index\":0}}}],"
    "\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"no.png\"}],"
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"buffers\":[{\"byteLength\":36,\"uri\":\"db://7\"}]}";

/* What the callback answers for the buffer. */
struct answer {
    oc_status status;
    oc_resolution kind;
    const void *bytes;
    uint64_t size;
    const char *path;
};

static void free_answer(void *user) {
    CHECK(user == &freed);
    freed++;
}

static oc_status resolve(void *user, const char *uri, const char *from, oc_resolved *out) {
    const struct answer *answer = user;
    CHECK(strcmp(from, file("a.gltf")) == 0);
    CHECK(out->struct_size == sizeof *out && out->kind == OC_RESOLUTION_DEFAULT && !out->release);
    calls++;
    if (strcmp(uri, "no.png") == 0)
        return OC_STATUS_IO; /* no geometry: a note */
    CHECK(strcmp(uri, "db://7") == 0);
    out->kind = answer->kind;
    out->bytes = answer->bytes;
    out->size = answer->size;
    out->path = answer->path;
    out->release = free_answer;
    out->release_user = &freed;
    return answer->status;
}

/* Builds with this answer and limits; the status of the job. */
static oc_status build(oc_context *c, struct answer answer, uint64_t max_triangles, uint64_t max_bytes) {
    oc_build *b;
    oc_job *job;
    oc_progress progress;
    oc_build_desc desc;
    OC_INIT(&desc);
    OC_INIT(&progress);
    desc.resolve = resolve;
    desc.resolve_user = &answer;
    desc.max_triangles = max_triangles;
    desc.max_bytes = max_bytes;
    OK(oc_build_create(c, &desc, &b));
    OK(oc_build_add_file(b, file("a.gltf")));
    OK(oc_build_start(b, file("a.oc"), &job));
    oc_build_release(b);
    OK(oc_job_wait(job, OC_FOREVER, &progress));
    if (progress.state == OC_STATE_DONE) {
        oc_build_report report;
        const char *note;
        OC_INIT(&report);
        OK(oc_job_build_report(job, &report));
        CHECK(report.triangles_kept == 1 && report.notes == 1);
        OK(oc_job_build_note(job, 0, &note));
        CHECK(strstr(note, "no.png") && strstr(note, "OC_STATUS_IO"));
    }
    oc_job_release(job);
    return progress.error;
}

static void fails(oc_context *c, struct answer answer, oc_status status, const char *words) {
    EXPECT(status, build(c, answer, 0, 0));
    CHECK(strstr(oc_last_error(), words));
    CHECK(!fopen(file("a.oc"), "rb"));
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    snprintf(folder, sizeof folder, "%s", argv[1]);
    write_file("a.gltf", gltf, sizeof gltf - 1);
    write_file("elsewhere.bin", corners, sizeof corners);
    char path[8192];
    snprintf(path, sizeof path, "%s", file("elsewhere.bin"));
    oc_context *c;
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &c));

    struct answer bytes = {OC_STATUS_OK, OC_RESOLUTION_BYTES, corners, sizeof corners, NULL};
    fails(c, (struct answer){OC_STATUS_CORRUPT, OC_RESOLUTION_BYTES, NULL, 9, NULL}, OC_STATUS_IO, "OC_STATUS_CORRUPT");
    fails(c, (struct answer){OC_STATUS_CANCELLED, 0, NULL, 0, NULL}, OC_STATUS_CANCELLED, "cancelled");
    CHECK(freed == 0);
    fails(c, (struct answer){0, OC_RESOLUTION_BYTES, NULL, 36, NULL}, OC_STATUS_INVALID_ARGUMENT, "bytes is NULL");
    fails(c, (struct answer){0, OC_RESOLUTION_BYTES, corners, ~0ull, NULL}, OC_STATUS_INVALID_ARGUMENT, "do not fit");
    fails(c, (struct answer){0, OC_RESOLUTION_BYTES, corners, 35, NULL}, OC_STATUS_PARSE, "has only 35 of the 36 bytes");
    fails(c, (struct answer){0, OC_RESOLUTION_BYTES, NULL, 0, NULL}, OC_STATUS_PARSE, "has only 0 of the 36 bytes");
    fails(c, (struct answer){0, OC_RESOLUTION_PATH, NULL, 0, NULL}, OC_STATUS_INVALID_ARGUMENT, "path is NULL");
    fails(c, (struct answer){0, OC_RESOLUTION_PATH, NULL, 0, "/no/such"}, OC_STATUS_IO, "/no/such");
    fails(c, (struct answer){0, OC_RESOLUTION_REFUSED, NULL, 0, NULL}, OC_STATUS_PARSE, "\"db://7\" was refused");
    fails(c, (struct answer){0, OC_RESOLUTION_DEFAULT, NULL, 0, NULL}, OC_STATUS_PARSE, "\"db://7\" is not a path");
    fails(c, (struct answer){0, 99, NULL, 0, NULL}, OC_STATUS_INVALID_ARGUMENT, "kind 99 is unknown");
    CHECK(freed == 9);

    EXPECT(OC_STATUS_OVER_LIMIT, build(c, bytes, 0, 1000));
    CHECK(strstr(oc_last_error(), "more than 1000, the limit max_bytes"));
    CHECK(strcmp(oc_status_name(OC_STATUS_OVER_LIMIT), "OC_STATUS_OVER_LIMIT") == 0);
    EXPECT(OC_STATUS_OK, build(c, bytes, 1, 1 << 20));
    EXPECT(OC_STATUS_OK, build(c, (struct answer){0, OC_RESOLUTION_PATH, NULL, 0, path}, 0, 0));
    CHECK(freed == 12 && calls == 28); /* each build asks for the texture and the buffer */
    oc_context_release(c);
    return 0;
}
