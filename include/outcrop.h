/* outcrop: ray traces models larger than memory on the CPU.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * This file is generated: change src/capi and run `make header`.
 *
 * Rules that hold everywhere
 *
 * Status.    Every call that can fail returns an oc_status. Outputs are written only when it is
 *            OC_STATUS_OK. oc_last_error() has the reason in words. NULL where a pointer is asked
 *            for, a number out of the range said and a flag that is not known are
 *            OC_STATUS_INVALID_ARGUMENT in all calls.
 * Structs    that you fill begin with `struct_size`: OC_INIT(&s), or oc_init(&s, sizeof s) where
 *            there are no macros, zeroes a struct and sets it. Zero means the default everywhere.
 * Objects    are counted: whoever gets one through an `out_` parameter owns one count, gives it
 *            back with oc_*_release, and may add one with oc_*_retain. Releasing NULL does
 *            nothing. An object keeps alive what it was made from. Objects of two contexts never
 *            mix. An object of another kind than a call wants is refused; one that was released
 *            for the last time is gone: what a call does with it is undefined.
 * const      means that the object does not change; calls that take it const may run at the same
 *            time in any threads. Others say so under `Thread safety`.
 * Pointers   may be NULL only where that is said. A count of 0 ignores its pointer. A stride is in
 *            bytes, 0 means tightly packed; no alignment beyond that of bytes is asked for.
 * Strings    are UTF-8 and end with 0. Paths are the bytes that the system takes.
 * Units      are the model's own; angles say theirs; colours are linear, not sRGB.
 * Matrices   are affine, 12 doubles by column: x axis, y axis, z axis, origin.
 * Blocking.  Calls marked `Cheap` never wait for the disk or for other work. Those marked
 *            `Blocks` do; where the context has no threads, they do the work themselves. Queries,
 *            and opening a model, work too where it has some, in place of one of them.
 */


#ifndef OUTCROP_H
#define OUTCROP_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32) && !defined(OC_STATIC)
#define OC_API __declspec(dllimport)
#elif defined(__GNUC__) && !defined(OC_STATIC)
#define OC_API __attribute__((visibility("default")))
#else
#define OC_API
#endif

/** Zeroes the struct at `pointer` and sets its size: `oc_camera c; OC_INIT(&c);`. */
#define OC_INIT(pointer) oc_init((pointer), sizeof *(pointer))


/** Major version: programs built for another one do not work. */
#define OC_VERSION_MAJOR 0

/** Minor version: while the major version is 0, programs built for another one do not work. */
#define OC_VERSION_MINOR 1

/** Patch version. */
#define OC_VERSION_PATCH 0

/**
 * The version of this header, `major * 10000 + minor * 100 + patch`: pass it to
 * `oc_context_create`.
 */
#define OC_HEADER_VERSION 100

/** A timeout without an end. */
#define OC_FOREVER 4294967295

/** As many threads as the machine has cores. */
#define OC_ALL_THREADS 4294967295

/** The parent of a part that has none. */
#define OC_NO_INDEX 4294967295

/** The id where there is none: of a miss, or not asked for. */
#define OC_NO_ID 18446744073709551615ull

/**
 * A model in the making: meshes are added, then oc_build_start makes the file.
 *
 * Parts are the caller's own 64-bit ids. A triangle's primitive id is its index in the input: those pushed come
 * first, in the order pushed, then those of the files, in the order added.
 */
typedef struct oc_build oc_build;

/**
 * Threads, log and memory budget that all else is made from. There is no other global state: any
 * number of contexts live side by side.
 */
typedef struct oc_context oc_context;

/** One view being rendered in the background, with its buffers. */
typedef struct oc_frame oc_frame;

/**
 * Long work in flight. Releasing its last count cancels it; for a batch of rays that release
 * waits until nobody reads the rays or writes the hits.
 */
typedef struct oc_job oc_job;

/** Keeps a buffer of a complete picture readable. */
typedef struct oc_mapping oc_mapping;

/** A built model, opened read-only; shared by scenes. */
typedef struct oc_model oc_model;

/**
 * What is looked at: instances of models, lights, the looks of parts. Edits collect until
 * oc_scene_commit; frames and batches in flight keep the state that they began with.
 */
typedef struct oc_scene oc_scene;

/**
 * What a call says, or why background work failed. The hundreds say who can act: 1 the caller, 2
 * the file, 3 the installation, 4 the budget, 5 the machine, 6 us. Numbers are never reused.
 */
typedef uint32_t oc_status;

/** The state of long work. */
typedef uint32_t oc_state;

/** What a build or load is doing. */
typedef uint32_t oc_phase;

/** How far long work is: the same for builds, loads, batches of rays, prefetches and frames. */
typedef struct oc_progress {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** An OC_STATE_ number. */
    oc_state state;
    /** From 0 to 1, never going back. */
    double fraction;
    /** What is done: triangles read (builds), rays answered (batches), pixels (frames), blocks read (prefetches). */
    uint64_t done;
    /** Of how many; 0 where that is not known. */
    uint64_t total;
    /** Bytes read and written so far (builds, loads); in memory (frames, prefetches). */
    uint64_t bytes;
    /** The least budget in bytes that would do, if it failed with OC_STATUS_OVER_BUDGET; else 0. */
    uint64_t need;
    /**
     * Why it failed or was cancelled, or of a frame that ended as OC_STATE_COMPLETE_WITHIN_BUDGET, why some of it
     * could not be read. oc_last_error has the reason in words after a poll or wait.
     */
    oc_status error;
    /** An OC_PHASE_ number (builds and loads). */
    oc_phase phase;
} oc_progress;

/**
 * Called when work has ended, well or not, and for frames also when there is a better picture; from any thread, in
 * which it must return soon and must not unwind. It may call what is marked `Cheap`. `user` is what was given with the
 * function.
 */
typedef void (*oc_wake_fn)(void *user);

/** A piece of work for the host's threads: call it once with the `task` that came with it. */
typedef void (*oc_run_fn)(void *task);

/**
 * Takes a piece of work: `run(task)` must be called exactly once, soon, from any thread, also at once from inside this
 * call: then calls that begin work in the background return when that is done. Called from any thread of the host,
 * never under a lock of the library's.
 */
typedef void (*oc_submit_fn)(void *user, oc_run_fn run, void *task);

/** The host's own threads: a context that has them never starts a thread of its own. */
typedef struct oc_executor {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /**
     * How many tasks can run at once, 1 or more; so many are handed in at a time at most (each build and load is
     * one more).
     */
    uint32_t concurrency;
    /** Given to `submit`. */
    void *user;
    /** Takes work. */
    oc_submit_fn submit;
} oc_executor;

/** How much a log line matters. */
typedef uint32_t oc_log_level;

/**
 * Takes a log line: called from any thread, never under a lock of the library's; must not unwind.
 * `message` is valid during the call.
 */
typedef void (*oc_log_fn)(void *user, oc_log_level level, const char *message);

/** Vector instructions. */
typedef uint32_t oc_instruction_set;

/** Flags of oc_context_desc. */
typedef uint32_t oc_context_flags;

/** What a context is made with. All zeros: no threads, three quarters of the machine's memory. */
typedef struct oc_context_desc {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /**
     * Threads that trace, 4096 at most. 0: none; then the caller drives, by oc_context_step or by waiting, and reads
     * and traces by turns: of a model that is being read pictures get better more slowly than with a thread, most of
     * all if by oc_context_step. OC_ALL_THREADS: one for each core. Ignored with an executor.
     */
    uint32_t threads;
    /**
     * Bytes that all models together may hold in memory, with tables and what reading takes; never exceeded. 0: three
     * quarters of the machine's; more than the machine has is refused. A model may be larger, many times: its coarse
     * blocks are read when it is opened, what is used is read then, and what has not been used for longest goes. What
     * has to stay is small: tables, the blocks at the roots, and a few megabytes to read with; if not even those fit,
     * opening fails with OC_STATUS_OVER_BUDGET and oc_last_error_need names the least budget that would do. Where what
     * frames show does not fit they get coarser, evenly; exact queries take longer. Buffers of frames and batches come
     * on top.
     */
    uint64_t memory_budget;
    /** The host's own threads, or NULL. The struct is copied; its `user` must outlive the context. */
    const struct oc_executor *executor;
    /** Takes log lines, or NULL. */
    oc_log_fn log;
    /** Given to `log`; must outlive the context. */
    void *log_user;
    /** An OC_INSTRUCTION_SET_ number. 0: the best that the machine has. All give the same answers. */
    oc_instruction_set instruction_set;
    /** OC_CONTEXT_ flags, joined with `|`. */
    oc_context_flags flags;
} oc_context_desc;

/** What can be asked of a context. */
typedef uint32_t oc_property;

/** The acceleration structure of a model. */
typedef uint32_t oc_structure;

/** Whether triangles may be split between leaves, which pays for long thin ones. */
typedef uint32_t oc_splits;

/** What a build is made with. All zeros: what most models want. */
typedef struct oc_build_desc {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** An OC_STRUCTURE_ number. */
    oc_structure structure;
    /**
     * Bytes of memory that the build may use, 32 MiB at least: what does not fit goes through temporary files. 0: no
     * limit.
     */
    uint64_t memory_budget;
    /**
     * The folder of temporary files; NULL: the system's (`TMPDIR`, where that is set). Not looked at before the first
     * is written.
     */
    const char *temp_dir;
    /** Length unit, in place of what the input says. 0: as the input says. */
    double metres_per_unit;
    /** An OC_UP_ number, in place of what the input says. OC_UP_UNKNOWN: as the input says. */
    uint32_t up;
    /** An OC_SPLITS_ number. */
    oc_splits splits;
    /**
     * Threads, up to 4096; the build starts its own. 0: as many as the context has; OC_ALL_THREADS: one for each core.
     * In a context without threads of its own a build has the one thread that does it. The file does not depend on it.
     */
    uint32_t threads;
    /** Must be 0. */
    uint32_t reserved;
} oc_build_desc;

/** How a part looks. Linear colour. All zeros: grey, opaque, matt. */
typedef struct oc_material {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** Linear RGB, each from 0 to 1. All 0 with opacity 0: grey. */
    float colour[3];
    /** 1 is opaque. 0: 1. */
    float opacity;
    /** From 0 to 1. */
    float metalness;
    /** From 0 to 1. 0: 0.6. */
    float roughness;
    /** Must be 0. */
    uint32_t reserved;
} oc_material;

/** What a user clicks on. */
typedef struct oc_part {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** A number of oc_build_add_material; 0: the default material. */
    uint32_t material;
    /** The caller's own id, new in this build, and not OC_NO_ID; hits and pictures tell it. */
    uint64_t id;
    /** The id of the part above it, added before; used if `has_parent` is 1. */
    uint64_t parent;
    /** UTF-8; NULL: no name. */
    const char *name;
    /** 1: it has a parent; 0: it has none. */
    uint32_t has_parent;
    /** Must be 0. */
    uint32_t reserved;
} oc_part;

/** The type of coordinates. */
typedef uint32_t oc_scalar;

/** The type of indices. */
typedef uint32_t oc_index;

/** Triangles in the caller's memory; read during the call. */
typedef struct oc_triangles {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** 0: placed as they are; else a number of oc_build_add_shared_mesh. */
    uint32_t mesh;
    /** The part: its id, or in a shared mesh its number, from 0. */
    uint64_t part;
    /** Corners: three coordinates each. */
    const void *positions;
    /** How many corners. */
    uint64_t position_count;
    /** Bytes from a corner to the next; 0: tightly packed. */
    uint64_t position_stride;
    /** Three indices of corners for each triangle; `index` says their type. NULL with OC_INDEX_NONE. */
    const void *indices;
    /** How many indices, three times that of triangles. */
    uint64_t index_count;
    /** Three floats, linear RGB, for each triangle; NULL: the part's material. */
    const float *colours;
    /** Bytes from a colour to the next; 0: tightly packed. */
    uint64_t colour_stride;
    /** An OC_SCALAR_ number: the type of coordinates. */
    oc_scalar scalar;
    /** An OC_INDEX_ number: the type of indices. */
    oc_index index;
} oc_triangles;

/** What a build did. */
typedef struct oc_build_report {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** How many notes there are: see oc_job_build_note. */
    uint32_t notes;
    /** Triangles in the input. */
    uint64_t triangles_in;
    /** Triangles in the model. */
    uint64_t triangles_kept;
    /** Left out: a corner is NaN or infinite. */
    uint64_t dropped_non_finite;
    /** Left out: no area. */
    uint64_t dropped_degenerate;
    /** Left out: too far away from the others to be told apart. */
    uint64_t dropped_out_of_range;
    /** Parts. */
    uint64_t parts;
    /** Shared meshes placed. */
    uint64_t instances;
    /** Bytes of geometry in memory, once opened. */
    uint64_t geometry_bytes;
    /** Bytes of the file. */
    uint64_t file_bytes;
    /** Seconds of reading. */
    double seconds_read;
    /** Seconds of building. */
    double seconds_build;
    /** Seconds of writing. */
    double seconds_write;
} oc_build_report;

/**
 * Reads `bytes` bytes at `offset` into `buffer`, all of them, and returns 0; anything else is a failure.
 * Called from any thread, several at once, never under a lock of the library's; must not unwind.
 */
typedef uint32_t (*oc_read_fn)(void *user, uint64_t offset, void *buffer, uint64_t bytes);

/**
 * Called once, when nothing will be read any more; from any thread, and perhaps a moment after the last handle was
 * released, when a thread that was still tracing or reading lets go of the model: `user` must stay valid until then.
 */
typedef void (*oc_close_fn)(void *user);

/** Where a model is read from, if not from a file: a table of the caller's. Read-only. */
typedef struct oc_io {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** Must be 0. */
    uint32_t reserved;
    /** Bytes of the model. */
    uint64_t size;
    /** Reads. */
    oc_read_fn read_at;
    /**
     * Closes; may be NULL. Called exactly once if opening or loading was tried with a valid table,
     * whether it succeeded or not.
     */
    oc_close_fn close;
    /** Given to both. */
    void *user;
    /** What messages call it; may be NULL. */
    const char *name;
} oc_io;

/** Which axis points up. */
typedef uint32_t oc_up_axis;

/** What a model is. */
typedef struct oc_model_info {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** An OC_UP_ number. */
    oc_up_axis up;
    /** Around everything, in model space; `max` is below `min` if there are no triangles. */
    double bounds_min[3];
    /** The other corner. */
    double bounds_max[3];
    /** Length unit; 0 if unknown. */
    double metres_per_unit;
    /** Triangles in the input of the build. */
    uint64_t triangles_in;
    /** Triangles stored, those of shared meshes once. */
    uint64_t triangles_stored;
    /** Triangles to be seen, those of shared meshes once for each instance. */
    uint64_t triangles_placed;
    /** Bytes of the file. */
    uint64_t file_bytes;
    /** Bytes of geometry in memory when all of it is there: nodes and triangles. */
    uint64_t geometry_bytes;
    /** Bytes in memory now. */
    uint64_t resident_bytes;
    /** Number of parts. */
    uint32_t parts;
    /** Instances of shared meshes. */
    uint32_t instances;
    /** Blocks of geometry. */
    uint32_t blocks;
    /** Whether single triangles carry colours. */
    uint32_t has_colours;
} oc_model_info;

/** A part of a model. */
typedef struct oc_part_info {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** Index of the part above it; OC_NO_INDEX if there is none. */
    uint32_t parent;
    /** The id that whoever built the model gave it. */
    uint64_t id;
    /** Its name, UTF-8; may be empty. The model's: valid as long as the model. */
    const char *name;
    /** Triangles of its own, not of the parts below it. */
    uint64_t triangles;
    /** Around them, in model space; `max` is below `min` if there are none. */
    double bounds_min[3];
    /** The other corner. */
    double bounds_max[3];
    /** Its material: linear RGBA, alpha is the opacity. */
    float colour[4];
    /** From 0 to 1. */
    float metalness;
    /** From 0 to 1. */
    float roughness;
} oc_part_info;

/** The kind of a camera. */
typedef uint32_t oc_camera_kind;

/** A camera in world space. */
typedef struct oc_camera {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** An OC_CAMERA_ number. */
    oc_camera_kind kind;
    /** The eye; for orthographic cameras the middle of the picture's plane. */
    double eye[3];
    /** The point looked at; sets the direction only. Must differ from the eye. */
    double at[3];
    /** Upward in the picture; must not be parallel to the view. All 0: +Z. */
    double up[3];
    /** Vertical angle of view in degrees, below 180 (perspective). 0: 45. */
    double fov_y;
    /** Height of the picture in world units, above 0 (orthographic). */
    double height;
} oc_camera;

/** How an instance or a part is shown: flags of oc_look. */
typedef uint32_t oc_look_flags;

/** How an instance or a part is shown. All zeros: as it is. */
typedef struct oc_look {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** OC_LOOK_ flags, joined with `|`. */
    oc_look_flags flags;
    /** Linear RGBA, alpha is the opacity; used with OC_LOOK_COLOURED. */
    float colour[4];
} oc_look;

/** The kind of a light. */
typedef uint32_t oc_light_kind;

/** A light; an element of an array. All zeros: a white headlight. */
typedef struct oc_light {
    /** Where a point light is, or whereto a directional light shines (need not be unit). World space. */
    double vector[3];
    /** Linear RGB, 0 or more. All 0: white. */
    float colour[3];
    /**
     * Factor to the colour. A white matt surface that faces a light (a point light at distance 1) of
     * intensity 1 is white. 0: 1.
     */
    float intensity;
    /** An OC_LIGHT_ number. */
    oc_light_kind kind;
    /** 1: it casts shadows; 0: it does not. A transparent part lets through 1 minus its opacity, as of what is seen. */
    uint32_t shadows;
} oc_light;

/** What is seen where nothing is. All zeros: black and transparent. */
typedef struct oc_background {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** Must be 0. */
    uint32_t reserved;
    /** Linear RGBA of the lowest row. */
    float bottom[4];
    /** Linear RGBA of the highest row. */
    float top[4];
} oc_background;

/** Which members of oc_hit to fill, joined with `|`. What is not asked for is not worked for. */
typedef uint32_t oc_want;

/** Flags of oc_query. */
typedef uint32_t oc_query_flags;

/** A ray; an element of an array. */
typedef struct oc_ray {
    /** Where it starts, world space. */
    double origin[3];
    /**
     * Hits before this distance are ignored; in units of the direction's length. Below 0 it counts as 0. Infinite or
     * NaN: the ray misses.
     */
    double t_min;
    /** Hits beyond this distance are ignored. 0: none are. Before `t_min`, or NaN: the ray misses. */
    double t_max;
    /** Where it goes; need not be unit. Zero, or not finite: the ray misses. */
    float direction[3];
    /**
     * Its footprint: its width at t is cone_a + cone_b * t, in world units (with t as in oc_hit, in units of the
     * direction's length). A stand-in is accepted where the area of its box's projection along the ray is at most the
     * square of the width there. So for p pixels of error: the width of a pixel, times the square root of p. Of a
     * camera with a field of view a pixel is 2 tan(fov_y / 2) / height wide at distance 1: that is cone_b, cone_a is
     * 0; of an orthographic one it is cone_a, and cone_b is 0. 0 and 0: exact. Below 0, or not a number: counts as 0;
     * infinite: as coarse as there is.
     */
    float cone_a;
    /** See `cone_a`. */
    float cone_b;
    /** It sees instances with a common bit in their mask. 0: all. */
    uint32_t mask;
} oc_ray;

/** A batch of rays. */
typedef struct oc_query {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** OC_WANT_ flags; 0: OC_WANT_ALL. */
    oc_want want;
    /** OC_QUERY_ flags. */
    oc_query_flags flags;
    /** Must be 0. */
    uint32_t reserved;
    /** The rays. Nobody may write them until the call has returned, or the job has ended. */
    const struct oc_ray *rays;
    /** How many. */
    uint64_t count;
    /**
     * Bytes from a ray to the next; 0: tightly packed. (Of these, 32 in a row at an address that oc_ray may have are
     * read where they are if each says its t_max, INFINITY for none, and its mask, 0xFFFFFFFF for all; others are
     * copied first.)
     */
    uint64_t stride;
} oc_query;

/** What was hit. */
typedef uint32_t oc_hit_kind;

/** The closest hit of a ray; an element of an array. What was not asked for is as for a miss. */
typedef struct oc_hit {
    /**
     * Distance in units of the direction's length; infinity for a miss. From `t_min` to `t_max`, both included: what
     * lies behind a hit is found from the next number after its `t` on. (Not what is nearer to it than `t` less
     * `t_free`: such surfaces may come in the wrong order. Within single precision of the ray's origin what is behind
     * it may be given at 0, and what is before it may be missed; so may what a ray meets within some 4 degrees of
     * edge-on that near to an end.) In double precision with `OC_WANT_POSITION` or `OC_WANT_ERROR`; without, in single
     * precision, and on long thin triangles near the ray's origin it may be off by more than its last digits.
     */
    double t;
    /** Where, in world space; infinity for a miss. */
    double position[3];
    /**
     * No original surface lies on the ray before this distance. Left out are surfaces that the ray meets within 0.9
     * degrees of edge-on, the one that it starts on, and edges that it grazes. Of an exact hit it is a little less
     * than `t`, by what rounding may have done. Of a miss it is infinity, unless the ray was let through a stand-in:
     * then it is where that, or what else would have been hit, is met; so it is of hits behind one.
     */
    double t_free;
    /** The id of the part, as given when the model was built; OC_NO_ID for a miss. */
    uint64_t part;
    /** The id of the instance, as given to oc_scene_add_instance; OC_NO_ID for a miss. */
    uint64_t instance;
    /** The triangle's index in the input of the build, from 0; OC_NO_ID for a miss. */
    uint64_t prim;
    /** Unit geometric normal in world space, facing the ray's origin; 0 for a miss. */
    float normal[3];
    /** Weights of the triangle's second and third corner. */
    float uv[2];
    /** Some original surface lies within this distance of `position`, in world units. */
    float error;
    /** An OC_HIT_ number. */
    oc_hit_kind kind;
    /** 0. */
    uint32_t reserved;
} oc_hit;

/** How a part meets a volume. */
typedef uint32_t oc_overlap_kind;

/** A part that meets a volume; an element of an array. */
typedef struct oc_overlap {
    /** The id of the instance. */
    uint64_t instance;
    /** The id of the part. */
    uint64_t part;
    /** An OC_OVERLAP_ number. */
    oc_overlap_kind kind;
    /** 0. */
    uint32_t reserved;
} oc_overlap;

/** A half space, the points p with dot(normal, p) + d >= 0; an element of an array. */
typedef struct oc_plane {
    /** Points inward; need not be unit. */
    double normal[3];
    /** In units of the normal's length. */
    double d;
} oc_plane;

/** A buffer of a picture. Rows from the top, pixels from the left. */
typedef uint32_t oc_buffer;

/** The caller's memory for a buffer; an element of an array. */
typedef struct oc_target {
    /**
     * The first pixel of the first row. Written from any thread while a frame renders; whole once the
     * frame is done. Must stay until the frame is released or resized.
     */
    void *memory;
    /** Bytes there. */
    uint64_t size;
    /** Bytes from a row to the next; 0: tightly packed. */
    uint64_t row_pitch;
    /** An OC_BUFFER_ number. */
    oc_buffer buffer;
    /** Must be 0. */
    uint32_t reserved;
} oc_target;

/** What a frame is made with. All zeros: 1024 by 768 pixels of OC_BUFFER_COLOUR_SRGB8. */
typedef struct oc_frame_desc {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** Pixels in a row, up to 65536. 0: 1024. */
    uint32_t width;
    /** Rows, up to 65536. 0: 768. */
    uint32_t height;
    /**
     * The buffers to keep: 1 << OC_BUFFER_ numbers, joined with `|`. 0: OC_BUFFER_COLOUR_SRGB8, or none
     * if there are targets.
     */
    uint32_t buffers;
    /** The caller's memory for some buffers (these or others), or NULL. */
    const struct oc_target *targets;
    /** How many, tightly packed. */
    uint64_t target_count;
} oc_frame_desc;

/** What a request asks. All zeros: exact, one ray a pixel. */
typedef struct oc_frame_settings {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** Rays for a pixel's colour, up to 1024; the other buffers take the pixel's middle. 0: 1. */
    uint32_t samples;
    /** Pixels of error: the area, in pixels, that a stand-in may cover; finite, not below 0. 0: exact. */
    float poe;
    /** Light from everywhere, so that nothing is black. 0: 0.15; below 0: none. */
    float ambient;
} oc_frame_settings;

/** How true the picture is that the last request is making or has made. */
typedef struct oc_frame_accuracy {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /**
     * The pixels of error in force: those asked for, or more where what is seen does not fit the memory budget. (By
     * steps; which one it ends at may depend on what was seen before.) Where that is more than was asked for, no
     * stand-in lets rays through.
     */
    float effective_poe;
    /** Counts the requests of this frame, from 1; 0: none yet. */
    uint64_t request;
    /** Pixels whose answer is exact: triangles and background that no stand-in is before. */
    uint64_t pixels_exact;
    /** Pixels that show a stand-in as fine as `effective_poe` asks for, or through one what is behind it. */
    uint64_t pixels_lod;
    /** Pixels that show a stand-in for missing data. */
    uint64_t pixels_missing;
    /** Pixels of the picture. */
    uint64_t pixels_total;
    /** Bytes in memory of the models that the scene shows. */
    uint64_t bytes_resident;
    /**
     * Bytes that this picture lacks: wanted, and not in memory. Of a request that is complete within the budget: what
     * could not be read, or still did not fit; 0 where all that is needed at `effective_poe` is there.
     */
    uint64_t bytes_wanted;
    /** Seconds since the request, until it ended. */
    double seconds;
    /**
     * Estimated seconds to go, as fast as it has been so far: of the first picture, then until what is wanted now has
     * come; what better pictures will want besides is not known. 0 when nothing runs, infinity if unknown.
     */
    double seconds_to_go;
    /**
     * Largest error in pixels. That of triangles, what rounding does, counts only where OC_BUFFER_DEPTH or
     * OC_BUFFER_ERROR is asked for.
     */
    float worst_error;
    /** Mean error in pixels, over pixels that show something; of triangles as above. */
    float mean_error;
    /**
     * Whole pictures that the request has made so far: the first from what was in memory, each with more of what the
     * last lacked. The very first of a frame waits for that, 80 ms at most. From 1 on there is one to map.
     */
    uint32_t pictures;
    /** An OC_STATE_ number, as oc_frame_poll tells it. */
    oc_state state;
} oc_frame_accuracy;

/** The element of a buffer. */
typedef uint32_t oc_format;

/** A buffer of a complete picture. */
typedef struct oc_pixels {
    /** Set by OC_INIT. */
    uint32_t struct_size;
    /** An OC_FORMAT_ number. */
    oc_format format;
    /** Pixels in a row. */
    uint32_t width;
    /** Rows. */
    uint32_t height;
    /** The first pixel of the first row, aligned for its elements; nobody writes there. */
    const void *data;
    /** Bytes from a row to the next. */
    uint64_t row_pitch;
    /** Bytes in all. */
    uint64_t size;
    /** Keeps `data` alive: release it when done. */
    struct oc_mapping *mapping;
} oc_pixels;

/** All is well. */
#define OC_STATUS_OK 0

/** The caller: an argument is NULL, out of its range, or of another context; nothing changed. */
#define OC_STATUS_INVALID_ARGUMENT 100

/** The caller: not possible in the object's present state; nothing changed. */
#define OC_STATUS_INVALID_STATE 101

/** The caller: the array given is too small; the count it should have was written, nothing else. */
#define OC_STATUS_BUFFER_TOO_SMALL 102

/** The caller: cancelled on request. */
#define OC_STATUS_CANCELLED 103

/** The file: an input of a build cannot be understood. */
#define OC_STATUS_PARSE 200

/** The file: a built model is damaged, or is not one. */
#define OC_STATUS_CORRUPT 201

/** The installation: header and library do not belong together. */
#define OC_STATUS_VERSION_MISMATCH 300

/** The installation: the model was written by a newer library. */
#define OC_STATUS_NEWER_FORMAT 301

/** The budget: too small; `oc_last_error_need` says what would do. */
#define OC_STATUS_OVER_BUDGET 400

/** The machine: reading or writing failed, or a thread could not be started. */
#define OC_STATUS_IO 500

/**
 * The machine: it gave no memory for something large (a picture, the tree of a build); `oc_last_error` says how many
 * bytes for what. Nothing changed, or it is as after any other error. (Where it gives none for something small, or for
 * triangles that are pushed or read without a budget, the process ends, as Rust programs do.)
 */
#define OC_STATUS_OUT_OF_MEMORY 501

/**
 * Us: a defect in the library. The object is poisoned. What it was is in oc_last_error, and for background work in
 * the log; the library has no hook on panics (that would be global state), so Rust's standard library also writes
 * it to standard error.
 */
#define OC_STATUS_INTERNAL 600

/** Us: the object met a defect before; it can only be released. */
#define OC_STATUS_POISONED 601

/** Nothing was asked for yet (frames only). */
#define OC_STATE_IDLE 0

/** Going on, or waiting for a thread. */
#define OC_STATE_RUNNING 1

/** Ended well: what was asked for is there, as exact as asked. */
#define OC_STATE_DONE 2

/** Cancelled. Of what it would have written nothing is to be used. */
#define OC_STATE_CANCELLED 3

/** Failed. Of what it would have written nothing is to be used. */
#define OC_STATE_FAILED 4

/**
 * Ended well, with less than was asked for: all that fits the memory budget, or can be read, is there. Frames, whose
 * picture is then coarser than asked (oc_frame_get_accuracy says by how much), and prefetches.
 */
#define OC_STATE_COMPLETE_WITHIN_BUDGET 5

/** Nothing begun, or neither build nor load. */
#define OC_PHASE_WAITING 0

/** Reading input, or a model. */
#define OC_PHASE_READ 1

/** Building trees. */
#define OC_PHASE_BUILD 2

/** Coding and writing blocks. */
#define OC_PHASE_WRITE 3

/** Making sure that the file is on the disk under its name. */
#define OC_PHASE_SEAL 4

/** Ended. */
#define OC_PHASE_DONE 5

/** Something failed. */
#define OC_LOG_ERROR 1

/** Something is not as it should be; work goes on. */
#define OC_LOG_WARNING 2

/** What a user may want to know. */
#define OC_LOG_INFO 3

/** What a developer may want to know. */
#define OC_LOG_DEBUG 4

/** The best that the machine has. */
#define OC_INSTRUCTION_SET_BEST 0

/** What every machine has. */
#define OC_INSTRUCTION_SET_BASELINE 1

/** AVX2. */
#define OC_INSTRUCTION_SET_AVX2 2

/** AVX-512. */
#define OC_INSTRUCTION_SET_AVX512 3

/**
 * Nothing is read before it is asked for. Without it a model that fits the memory budget is read in the background,
 * all of it, when nothing more urgent is to be read.
 */
#define OC_CONTEXT_NO_READ_AHEAD 1

/** The library's version, as OC_HEADER_VERSION is made. */
#define OC_PROPERTY_VERSION 1

/** Threads of the library's own. */
#define OC_PROPERTY_THREADS 2

/** How many threads, own or the host's, may work at once. */
#define OC_PROPERTY_CONCURRENCY 3

/** The memory budget in bytes. */
#define OC_PROPERTY_MEMORY_BUDGET 4

/** The vector instructions in use: an OC_INSTRUCTION_SET_ number. */
#define OC_PROPERTY_INSTRUCTION_SET 5

/** The largest width and height of a frame. */
#define OC_PROPERTY_MAX_FRAME_SIZE 6

/** The newest format of models that can be opened: major * 65536 + minor. */
#define OC_PROPERTY_FORMAT 7

/** Bytes in use of the memory budget now. */
#define OC_PROPERTY_MEMORY_USED 8

/** Rays leave the eye. */
#define OC_CAMERA_PERSPECTIVE 0

/** Parallel rays from a plane through the eye; nothing behind the plane is seen. */
#define OC_CAMERA_ORTHOGRAPHIC 1

/** The library's choice, at present OC_STRUCTURE_BVH. */
#define OC_STRUCTURE_DEFAULT 0

/** A wide, quantised bounding volume hierarchy. */
#define OC_STRUCTURE_BVH 1

/** Where it pays. */
#define OC_SPLITS_AUTO 0

/** Never. */
#define OC_SPLITS_OFF 1

/** Always. */
#define OC_SPLITS_ON 2

/** float. */
#define OC_SCALAR_F32 0

/** double. */
#define OC_SCALAR_F64 1

/** There are none: the corners come in threes. */
#define OC_INDEX_NONE 0

/** uint32_t. */
#define OC_INDEX_U32 1

/** uint64_t. */
#define OC_INDEX_U64 2

/** Nobody said; views then take +Z. */
#define OC_UP_UNKNOWN 0

/** +X. */
#define OC_UP_X 1

/** +Y (glTF). */
#define OC_UP_Y 2

/** +Z (most CAD). */
#define OC_UP_Z 3

/** Rays do not meet it. */
#define OC_LOOK_HIDDEN 1

/** It is highlighted. */
#define OC_LOOK_SELECTED 2

/** It has the colour of oc_look instead of its own. */
#define OC_LOOK_COLOURED 4

/** At the eye, without falloff and shadows. */
#define OC_LIGHT_HEAD 0

/** A point; its light falls off with the square of the distance. */
#define OC_LIGHT_POINT 1

/** From infinitely far away. */
#define OC_LIGHT_DIRECTIONAL 2

/** Nothing between t_min and t_max, or the ray was let through what stands in there: see `t_free`. */
#define OC_HIT_MISS 0

/** An original triangle. */
#define OC_HIT_EXACT 1

/**
 * A stand-in, as fine as the ray's cone asks for: a cell that holds original surface, near enough to what the ray
 * would meet. `t` is where the ray enters the cell, `normal` is that of what is mostly seen there, `part` the one of
 * which most is seen; `uv` and `prim` are those of a miss. Of cells that hold wires, leaves and the like, as many rays
 * are let through as pass what they hold: see `t_free`.
 */
#define OC_HIT_LOD 2

/**
 * A stand-in, coarser than asked for: what is below it is not in memory (frames and OC_QUERY_NOW only). Otherwise as
 * OC_HIT_LOD. If the ray begins inside of the cell, `t` is where it leaves it, and `t_free` is t_min: nothing of it is
 * known to be free.
 */
#define OC_HIT_MISSING 3

/** Only `t` and `kind`, which are always filled. */
#define OC_WANT_T 1

/** `position`. */
#define OC_WANT_POSITION 2

/** `normal`. */
#define OC_WANT_NORMAL 4

/** `uv`. */
#define OC_WANT_UV 8

/** `part`. */
#define OC_WANT_PART 16

/** `instance`. */
#define OC_WANT_INSTANCE 32

/** `prim`; may have to be read from the disk. */
#define OC_WANT_PRIM 64

/** `error` and `t_free`, and `t` in double precision. */
#define OC_WANT_ERROR 128

/** Everything. */
#define OC_WANT_ALL 255

/**
 * Each 32 rays in a row are near each other and go the same way: they are traced together, faster. The answers are
 * the same. Rays of neighbouring pixels that enter few placed trees are recognised without it.
 */
#define OC_QUERY_COHERENT 1

/**
 * Answer at once, from what is in memory: stand-ins are hit in place of what is not, as OC_HIT_MISSING. Nothing is
 * read, nor asked for (oc_scene_prefetch_box does that). Without it, what is needed is read, and answers do not depend
 * on what was in memory.
 */
#define OC_QUERY_NOW 2

/** Some of it is inside or touches. */
#define OC_OVERLAP_INTERSECTS 1

/** All of it is inside. */
#define OC_OVERLAP_INSIDE 2

/** 4 bytes: sRGB red, green, blue, and linear alpha. */
#define OC_BUFFER_COLOUR_SRGB8 0

/** 4 floats: linear RGB, not clamped, and alpha. */
#define OC_BUFFER_COLOUR_LINEAR 1

/** 1 float: distance from the eye along the view direction, world units; infinity for a miss. */
#define OC_BUFFER_DEPTH 2

/** 3 floats: unit geometric normal in world space, facing the eye; 0 for a miss. */
#define OC_BUFFER_NORMAL 3

/** 1 uint64_t: the part's id; OC_NO_ID for a miss. */
#define OC_BUFFER_PART 4

/** 1 uint64_t: the triangle's index in the input of the build; OC_NO_ID for a miss. */
#define OC_BUFFER_PRIM 5

/** 1 uint64_t: the instance's id; OC_NO_ID for a miss. */
#define OC_BUFFER_INSTANCE 6

/** 1 byte: an OC_HIT_ number. */
#define OC_BUFFER_KIND 7

/**
 * 1 float: some original surface lies within this distance of what is shown; world units. Infinity where a triangle,
 * or nothing, is seen through stand-ins that let the ray pass: there something nearer may be.
 */
#define OC_BUFFER_ERROR 8

/** 4 bytes. */
#define OC_FORMAT_U8X4 1

/** 4 floats. */
#define OC_FORMAT_F32X4 2

/** 1 float. */
#define OC_FORMAT_F32 3

/** 3 floats. */
#define OC_FORMAT_F32X3 4

/** 1 uint64_t. */
#define OC_FORMAT_U64 5

/** 1 byte. */
#define OC_FORMAT_U8 6

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library, to be compared with `OC_HEADER_VERSION`.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API uint32_t oc_version(void);

/**
 * The name of a status, for instance "OC_STATUS_IO"; "unknown status" for other numbers.
 *
 * Returns a constant. Thread safety: any thread. Cheap.
 */
OC_API const char *oc_status_name(oc_status status);

/**
 * Why the last call of this thread that did not return `OC_STATUS_OK` failed; or, after a poll or
 * wait that reported `OC_STATE_FAILED`, why the work failed. Never NULL; empty before any failure.
 *
 * Returns a string of the library's, valid until the next failure in this thread.
 * Thread safety: each thread has its own. Cheap.
 */
OC_API const char *oc_last_error(void);

/**
 * The least budget in bytes that would have done, if the failure that `oc_last_error` tells of was
 * `OC_STATUS_OVER_BUDGET`; else 0.
 *
 * Thread safety: each thread has its own. Cheap.
 */
OC_API uint64_t oc_last_error_need(void);

/**
 * Zeroes `size` bytes at `object`, any struct of this header that begins with `struct_size`, and sets
 * that member: what the macro OC_INIT calls. NULL, or a size below 4, does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
void oc_init(void *object,
             size_t size);

/**
 * How far the job is. After OC_STATE_FAILED oc_last_error of this thread tells why.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_poll(const struct oc_job *job, struct oc_progress *out_progress);

/**
 * Waits until the job has ended and its wake function, if another thread is calling it, has returned; `timeout_ms` at
 * most (OC_FOREVER: no limit). Says how far the job is. A timeout is no failure: the state is then OC_STATE_RUNNING.
 * So once this call says that the job has ended, `user` of the wake function may be freed. `out_progress` may be NULL.
 *
 * Thread safety: any thread. Blocks. In a context without threads and without an executor this call does
 * the work; a build or load is then done to its end, whatever the timeout.
 */
OC_API
oc_status oc_job_wait(const struct oc_job *job,
                      uint32_t timeout_ms,
                      struct oc_progress *out_progress);

/**
 * Asks the job to end; it does so within about 100 ms. A job that has ended stays as it is.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_cancel(const struct oc_job *job);

/**
 * Has `wake` called once, when the job ends; if it has ended already, now, from this call. Replaces an
 * earlier one; NULL: no call.
 *
 * `user` must stay usable until `wake` has returned, or was replaced before it was called. `wake` may release the job;
 * then what the job was for is done, and its arrays are the caller's again. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_job_set_wake(const struct oc_job *job,
                          oc_wake_fn wake,
                          void *user);

/**
 * The model that a job of oc_model_load has opened. OC_STATUS_INVALID_STATE before it is done, or
 * if it failed; of a job of another kind, that or OC_STATUS_INVALID_ARGUMENT.
 *
 * Ownership: the caller owns a count of the model. Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_model(const struct oc_job *job, struct oc_model **out_model);

/** Adds a count. NULL does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_job_retain(struct oc_job *job);

/**
 * Takes a count back; with the last one the job is cancelled. NULL does nothing.
 *
 * Thread safety: any thread, also from the job's own wake function. For a batch of rays it blocks until no thread uses
 * the arrays and the wake function, if another thread is calling it, has returned; for other jobs it is cheap.
 */
OC_API
void oc_job_release(struct oc_job *job);

/**
 * Makes a context. `header_version` is OC_HEADER_VERSION, so that a program and a library that do not
 * belong together say so instead of crashing. `desc` may be NULL: all defaults.
 *
 * OC_STATUS_VERSION_MISMATCH if they do not; OC_STATUS_INVALID_ARGUMENT if the machine lacks the instruction set, or
 * has less memory than the budget; OC_STATUS_IO if a thread cannot be started. Ownership: the caller owns a count.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_context_create(uint32_t header_version,
                            const struct oc_context_desc *desc,
                            struct oc_context **out_context);

/**
 * Does one small piece of waiting work in this thread, if there is any: some tens of microseconds to a few
 * milliseconds of a frame or a batch of rays, or a whole build or load of a context without threads. `out_did`, which
 * may be NULL, gets 1 if there was any, else 0.
 *
 * Thread safety: any thread. Blocks while it works.
 */
OC_API
oc_status oc_context_step(const struct oc_context *context,
                          uint32_t *out_did);

/**
 * Asks for a property. OC_STATUS_INVALID_ARGUMENT for one that this library does not know.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_context_property(const struct oc_context *context,
                              oc_property property,
                              uint64_t *out_value);

/** Adds a count. NULL does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_context_retain(struct oc_context *context);

/**
 * Takes a count back. Objects made from the context keep what they need of it; its threads end with the
 * last of them. NULL does nothing.
 *
 * Thread safety: any thread. Blocks until threads have ended, if nothing else keeps the context any more: a frame or
 * job that was released while it ran keeps it for a moment longer.
 */
OC_API
void oc_context_release(struct oc_context *context);

/**
 * Makes an empty build. `desc` may be NULL: all defaults.
 *
 * Ownership: the caller owns a count. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_create(const struct oc_context *context,
                          const struct oc_build_desc *desc,
                          struct oc_build **out_build);

/**
 * Adds a mesh file: PLY, OBJ, STL, glTF, GLB or raw triangles. It is read when the build runs, so that errors
 * in it are the job's.
 *
 * Thread safety: any thread, but the order of additions is that of the model. Cheap.
 */
OC_API
oc_status oc_build_add_file(struct oc_build *build,
                            const char *path);

/**
 * Begins to make the file at `path`, in the background: in a thread that is started for it, one task of the executor,
 * or, where the context has neither threads nor an executor, inside oc_job_wait or oc_context_step. Nothing can be
 * added any more, also if OC_STATUS_IO says that the thread could not be started.
 *
 * The file appears under its name when the job is done; until then what was there stays. If the job fails or is
 * cancelled no temporary is left.
 * Ownership: the caller owns a count of the job; the build may be released. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_start(struct oc_build *build,
                         const char *path,
                         struct oc_job **out_job);

/** Adds a count. NULL does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_build_retain(struct oc_build *build);

/**
 * Takes a count back; a job that was started goes on. NULL does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API void oc_build_release(struct oc_build *build);

/**
 * Adds a material; `out_material` gets its number, from 1 (0 is the default material).
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_add_material(struct oc_build *build,
                                const struct oc_material *material,
                                uint32_t *out_material);

/**
 * Adds a part.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_build_add_part(struct oc_build *build, const struct oc_part *part);

/**
 * Begins a mesh that instances repeat; its triangles are stored once. It has `parts` parts, numbered from 0.
 * `out_mesh` gets its number, from 1.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_add_shared_mesh(struct oc_build *build,
                                   uint32_t parts,
                                   uint32_t *out_mesh);

/**
 * Places a shared mesh. Its part 0 is here the part `first_part`, its part 1 the one added next after that, and
 * so on. `world_from_mesh`: 12 doubles, invertible; NULL leaves it where it is.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_add_instance(struct oc_build *build,
                                uint32_t mesh,
                                uint64_t first_part,
                                const double *world_from_mesh);

/**
 * Adds triangles of one part from the caller's memory. NaN, infinite and flat ones may be among them: they
 * are counted and left out.
 *
 * OC_STATUS_INVALID_ARGUMENT for an index out of range (nothing was added); OC_STATUS_IO if the temporary that takes
 * what is beyond the build's budget cannot be written: the build can then only be released. Thread safety: any thread.
 * Blocks while it copies.
 */
OC_API
oc_status oc_build_add_triangles(struct oc_build *build,
                                 const struct oc_triangles *triangles);

/**
 * What the build did whose job this is. OC_STATUS_INVALID_STATE before it is done, or if it failed; of a job of
 * another kind, that or OC_STATUS_INVALID_ARGUMENT.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_job_build_report(const struct oc_job *job,
                              struct oc_build_report *out_report);

/**
 * Something that the user should know about an input, though it could be read; `index` below the report's `notes`.
 *
 * `out_text` gets a string of the job's, valid as long as the job. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_job_build_note(const struct oc_job *job,
                            uint32_t index,
                            const char **out_text);

/**
 * Opens the model at `path`: its tables and coarse blocks are read, and all of a small model; the rest when it is
 * used, or in the background where it fits. It may be larger than the context's memory budget: OC_STATUS_OVER_BUDGET
 * means that not even what must stay in memory fits, and oc_last_error_need gives the least budget that would do. No
 * more than 48 MB, or a quarter of the budget, is read here. One of those blocks that is damaged, or cannot be read,
 * fails it; of others that are, stand-ins are shown.
 *
 * Ownership: the caller owns a count. Thread safety: any thread. Blocks: reads the disk; oc_model_load
 * does not.
 */
OC_API
oc_status oc_model_open(const struct oc_context *context,
                        const char *path,
                        struct oc_model **out_model);

/**
 * Opens a model that the caller's own functions read.
 *
 * Ownership: the caller owns a count; the table is copied. Thread safety: any thread. Blocks: calls
 * `read_at`.
 */
OC_API
oc_status oc_model_open_io(const struct oc_context *context,
                           const struct oc_io *io,
                           struct oc_model **out_model);

/**
 * Begins to open the model at `path` (or, if `io` is not NULL, the one that its functions read; `path`
 * is then ignored). When the job is done, oc_job_model gives the model. The job's progress counts the bytes of
 * blocks read.
 *
 * Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_model_load(const struct oc_context *context,
                        const char *path,
                        const struct oc_io *io,
                        struct oc_job **out_job);

/**
 * What the model is.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_model_get_info(const struct oc_model *model, struct oc_model_info *out_info);

/**
 * The part with this index, below `oc_model_info.parts`.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_model_get_part(const struct oc_model *model,
                            uint32_t index,
                            struct oc_part_info *out_part);

/**
 * The index of the first part with this id. OC_STATUS_INVALID_ARGUMENT if there is none.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_model_find_part(const struct oc_model *model, uint64_t id, uint32_t *out_index);

/**
 * A view that fits the model: 0 and 1 show the whole, 2 and 3 the same from a quarter of the distance.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_model_get_view(const struct oc_model *model,
                            uint32_t view,
                            struct oc_camera *out_camera);

/** Adds a count. NULL does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_model_retain(struct oc_model *model);

/**
 * Takes a count back; the handle is gone with the last; scenes that show the model keep its data. NULL does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
void oc_model_release(struct oc_model *model);

/**
 * Makes an empty scene with a headlight.
 *
 * Ownership: the caller owns a count. Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_scene_create(const struct oc_context *context, struct oc_scene **out_scene);

/**
 * Adds a model as an instance with the caller's own `id`, which must be new in the scene, and not OC_NO_ID.
 * `world_from_model`: 12 doubles, invertible; NULL leaves the model where it is.
 *
 * Ownership: the scene keeps the model alive. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_add_instance(struct oc_scene *scene,
                                const struct oc_model *model,
                                uint64_t id,
                                const double *world_from_model);

/**
 * Removes an instance.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_scene_remove_instance(struct oc_scene *scene, uint64_t id);

/**
 * Moves an instance; the matrix as for oc_scene_add_instance.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_transform(struct oc_scene *scene,
                                 uint64_t id,
                                 const double *world_from_model);

/**
 * Sets which rays of batches see an instance: those with a common bit in their mask. At first all do.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_instance_mask(struct oc_scene *scene,
                                     uint64_t id,
                                     uint32_t mask);

/**
 * Sets how an instance is shown. What its parts say for themselves comes first; hidden in either is
 * hidden. `look` may be NULL: as it is.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_instance_look(struct oc_scene *scene,
                                     uint64_t id,
                                     const struct oc_look *look);

/**
 * Sets how the part with id `part` of an instance is shown, without the parts below it. `look` may be
 * NULL: as it is.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_part_look(struct oc_scene *scene,
                                 uint64_t instance,
                                 uint64_t part,
                                 const struct oc_look *look);

/**
 * Shows all parts of an instance as they are.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_scene_clear_part_looks(struct oc_scene *scene, uint64_t instance);

/**
 * Replaces all lights; none at all leaves the ambient light of the frame.
 *
 * `lights`: `count` of them, up to 65536, `stride` bytes apart (0: tightly packed). Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_lights(struct oc_scene *scene,
                              const struct oc_light *lights,
                              uint64_t count,
                              uint64_t stride);

/**
 * Replaces the background; NULL brings back the grey one that a scene begins with.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_background(struct oc_scene *scene,
                                  const struct oc_background *background);

/**
 * Makes all edits since the last commit visible at once to frames and batches that begin from now on.
 *
 * Takes time by the number of instances. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_commit(struct oc_scene *scene);

/** Adds a count. NULL does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_scene_retain(struct oc_scene *scene);

/**
 * Takes a count back; frames and batches in flight keep what they need. NULL does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API void oc_scene_release(struct oc_scene *scene);

/**
 * Finds the closest hit of each ray in the committed scene.
 *
 * `out_hits`: as many as rays, `hit_stride` bytes apart (0: tightly packed). On failure they are not to be
 * used. Thread safety: any thread; frames and other batches may be in flight. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_closest(const struct oc_scene *scene,
                           const struct oc_query *query,
                           struct oc_hit *out_hits,
                           uint64_t hit_stride);

/**
 * Finds whether each ray hits anything: 1 or 0. Faster than the closest hit. `want` changes nothing (but is checked).
 * With OC_QUERY_NOW, 1 also stands for rays of which that is not known. With a footprint, 0 may also be a ray that
 * stand-ins let through.
 *
 * `out_any`: as many bytes as rays, `any_stride` bytes apart (0: tightly packed). On failure they are not
 * to be used. Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_any(const struct oc_scene *scene,
                       const struct oc_query *query,
                       uint8_t *out_any,
                       uint64_t any_stride);

/**
 * Begins oc_scene_closest and returns at once. The arrays must stay as they are until the job has
 * ended; `query` itself need not.
 *
 * Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_closest_start(const struct oc_scene *scene,
                                 const struct oc_query *query,
                                 struct oc_hit *out_hits,
                                 uint64_t hit_stride,
                                 struct oc_job **out_job);

/**
 * Begins oc_scene_any and returns at once. The arrays must stay as they are until the job has
 * ended; `query` itself need not.
 *
 * Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_any_start(const struct oc_scene *scene,
                             const struct oc_query *query,
                             uint8_t *out_any,
                             uint64_t any_stride,
                             struct oc_job **out_job);

/**
 * Finds the visible parts that meet a box, exactly: by triangle. `box_min` and `box_max`: 3 doubles each,
 * world space; the box is closed. An empty one meets nothing; NaN is refused.
 *
 * `out_count` gets how many there are. With `capacity` 0 that is all (`out_parts` is ignored); else they
 * are written if they fit, and OC_STATUS_BUFFER_TOO_SMALL says that they do not. By instance in the order
 * added, then by part in the model's order. Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_overlap_box(const struct oc_scene *scene,
                               const double *box_min,
                               const double *box_max,
                               struct oc_overlap *out_parts,
                               uint64_t capacity,
                               uint64_t *out_count);

/**
 * Finds the visible parts that meet the intersection of half spaces (a frustum has 6; 1 to 4096), exactly: by
 * triangle.
 *
 * The list comes out as that of oc_scene_overlap_box. Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_overlap_frustum(const struct oc_scene *scene,
                                   const struct oc_plane *planes,
                                   uint64_t plane_count,
                                   struct oc_overlap *out_parts,
                                   uint64_t capacity,
                                   uint64_t *out_count);

/**
 * Makes a frame. `desc` may be NULL: all defaults. OC_STATUS_OUT_OF_MEMORY if the system gives none for its buffers.
 * (Most systems promise more memory than they have, and find out when it is written: a picture larger than the
 * machine's memory may end the process later.)
 *
 * Ownership: the caller owns a count. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_create(const struct oc_context *context,
                          const struct oc_frame_desc *desc,
                          struct oc_frame **out_frame);

/**
 * Begins a picture of the committed scene, and returns at once. What the frame was rendering is
 * cancelled and replaced. `settings` may be NULL: all defaults.
 *
 * The first picture is whole, and made from what is in memory: where data is missing it shows stand-ins. It can be
 * mapped as soon as it is there, long before the request ends. Each later picture is more exact, unless what is asked
 * for does not fit the memory budget: then pictures get coarser step by step, everywhere alike, until all that they
 * need does. The request ends as OC_STATE_DONE when the picture is as exact as asked, as
 * OC_STATE_COMPLETE_WITHIN_BUDGET when that does not fit, or some of it cannot be had (then oc_progress.error is
 * OC_STATUS_IO for what cannot be read, OC_STATUS_CORRUPT for what is damaged; the next request asks for it again).
 *
 * OC_STATUS_INVALID_ARGUMENT for a `poe` or `ambient` that is not a number or infinite, a `poe` below 0, more than
 * 1024 samples, or a camera out of its ranges; OC_STATUS_OUT_OF_MEMORY if the system gives none for a picture beside
 * the one that can be mapped; then what the frame was rendering goes on. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_request(struct oc_frame *frame,
                           const struct oc_scene *scene,
                           const struct oc_camera *camera,
                           const struct oc_frame_settings *settings);

/**
 * How far the last request is. After OC_STATE_FAILED oc_last_error of this thread tells why.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_frame_poll(const struct oc_frame *frame, struct oc_progress *out_progress);

/**
 * Waits until the last request has ended and the wake function, if another thread is calling it, has returned;
 * `timeout_ms` at most (OC_FOREVER: no limit). Says how far the request is. A timeout is no failure: the state is then
 * OC_STATE_RUNNING. `out_progress` may be NULL.
 *
 * Thread safety: any thread. Blocks; does the work itself where the context has no threads.
 */
OC_API
oc_status oc_frame_wait(const struct oc_frame *frame,
                        uint32_t timeout_ms,
                        struct oc_progress *out_progress);

/**
 * Asks the frame to stop rendering; it does so within a tile. The last complete picture stays whole.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_cancel(struct oc_frame *frame);

/**
 * Changes the size from the next request on; cancels what is rendering and lets go of the targets. The last complete
 * picture keeps its size until the next is complete. OC_STATUS_OUT_OF_MEMORY as for oc_frame_create; then nothing
 * changes.
 *
 * Thread safety: any thread. Blocks until nobody writes to the targets any more.
 */
OC_API
oc_status oc_frame_resize(struct oc_frame *frame,
                          uint32_t width,
                          uint32_t height);

/**
 * Has `wake` called whenever a better picture can be mapped, and when a request ends; NULL: no call.
 *
 * `user` must stay usable until `wake` was replaced or the frame released.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_set_wake(struct oc_frame *frame,
                            oc_wake_fn wake,
                            void *user);

/**
 * How true the last whole picture of the last request is (before there is one: as far as it has come). Of each pixel a
 * stand-in's error is how far from what is shown the surface may lie, in pixels.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_get_accuracy(const struct oc_frame *frame,
                                struct oc_frame_accuracy *out_accuracy);

/**
 * What is seen at pixel (`x`, `y`), counted from the top left, of the last complete picture (before there is
 * one, of the last request): exact, all members filled.
 *
 * OC_STATUS_INVALID_STATE before the first request. Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_frame_pick(const struct oc_frame *frame,
                        uint32_t x,
                        uint32_t y,
                        struct oc_hit *out_hit);

/** Adds a count. NULL does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_frame_retain(struct oc_frame *frame);

/**
 * Takes a count back; with the last one the frame is cancelled. NULL does nothing.
 *
 * Thread safety: any thread. Blocks until the tiles in flight are done.
 */
OC_API void oc_frame_release(struct oc_frame *frame);

/**
 * Maps a buffer of the last complete picture, without a copy. It stays whole and readable until the mapping
 * is released, whatever the frame does meanwhile, even if the frame is released.
 *
 * OC_STATUS_INVALID_STATE before a picture is complete, or if the frame does not keep this buffer.
 * Ownership: the caller owns a count of `out_pixels->mapping`. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_map(const struct oc_frame *frame,
                       oc_buffer buffer,
                       struct oc_pixels *out_pixels);

/** Adds a count. NULL does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_mapping_retain(struct oc_mapping *mapping);

/**
 * Takes a count back; with the last one the pixels may go. NULL does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API void oc_mapping_release(struct oc_mapping *mapping);

/**
 * Begins to read, in the background, what of the committed scene lies in a box: blocks below cells that meet it and
 * are longer than `cell` (world units; 0: all of them), those below the longest cells first. What frames and queries
 * ask for comes before, and no picture gets coarser for it.
 *
 * The job counts blocks and their bytes in memory. It ends as OC_STATE_DONE when all is in memory, as
 * OC_STATE_COMPLETE_WITHIN_BUDGET when no more fits beside what frames use, as OC_STATE_FAILED when some of it cannot
 * be read (the rest then is, as far as it fits). What was read stays until room is needed and nothing else has been
 * used less lately. Releasing the job ends the reading.
 *
 * `low`, `high`: three doubles each, world space. OC_STATUS_INVALID_ARGUMENT for NaN, or a `cell` below 0.
 * Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_prefetch_box(const struct oc_scene *scene,
                                const double *low,
                                const double *high,
                                double cell,
                                struct oc_job **out_job);

/**
 * Begins to read, in the background, what a picture of `width` by `height` pixels of the committed scene would need at
 * `poe` pixels of error (0: exact), the most visible first, as far as a ray in every fourth pixel of every fourth row
 * finds it; without shadows and what is behind transparent surfaces. For the view that comes next, for instance. As
 * oc_scene_prefetch_box otherwise.
 *
 * OC_STATUS_INVALID_ARGUMENT for a bad camera or size, or a `poe` that is not finite or below 0.
 * Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_prefetch_camera(const struct oc_scene *scene,
                                   const struct oc_camera *camera,
                                   uint32_t width,
                                   uint32_t height,
                                   float poe,
                                   struct oc_job **out_job);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* OUTCROP_H */
