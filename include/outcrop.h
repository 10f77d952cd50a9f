/* outcrop: ray traces models larger than memory on the CPU.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * This file is generated: change src/capi and run `make header`.
 *
 * Terms
 *   - Part: a named group of triangles that a user selects, hides or colours.
 *   - Instance: a model that is placed in a scene.
 *   - Original surface: the triangles in the input of the build.
 *   - Block: the unit in which the data of a model is read from the file.
 *   - Stand-in: a box, clipped by four planes, that is shown in place of the triangles in it if
 *     these are small enough in the picture, or not in memory. It stops or transmits each ray.
 *   - Pixels of error: a stand-in may replace triangles if its projection covers at most this many
 *     square pixels. 0 means exact.
 *
 * Conventions
 *
 * Status
 *   - Every function that can fail returns an oc_status. oc_last_error() returns the reason in
 *     words.
 *   - Outputs are written only if the status is OC_STATUS_OK. The exceptions are documented.
 *   - Every function returns OC_STATUS_INVALID_ARGUMENT for a NULL pointer that is not
 *     documented as optional, a number out of its range, and an unknown flag.
 *   - Every function that returns a status may return OC_STATUS_INTERNAL (a defect in the
 *     library) or OC_STATUS_POISONED (a defect occurred in the object before).
 *
 * Structs
 *   - A struct that begins with `struct_size` must be initialised: OC_INIT(&s), or
 *     oc_init(&s, sizeof s) where macros are not available. Both zero the struct and set its size.
 *   - A member that is 0 has its documented default.
 *
 * Objects
 *   - Objects are reference counted. A function that returns an object through an `out_`
 *     parameter gives the caller one reference. oc_..._retain adds a reference, oc_..._release
 *     gives one back. The release of NULL does nothing.
 *   - An object keeps the objects alive that it was made from.
 *   - Objects of two contexts cannot be combined.
 *   - An object of the wrong kind is refused with OC_STATUS_INVALID_ARGUMENT.
 *   - The use of an object after its last release is undefined behaviour.
 *
 * Threads
 *   - `const` object: the function does not change the object. Any number of threads may call
 *     such functions at the same time.
 *   - Other functions document their `Thread safety`.
 *   - A call takes at most 64 KB of the stack of its thread. A build that runs in a thread of the
 *     host takes up to 1 MiB. Threads that the library starts have stacks of 2 MiB.
 *
 * Pointers and arrays
 *   - A pointer may be NULL only if its documentation says so.
 *   - If the count of an array is 0, its pointer is ignored.
 *   - A stride is in bytes. 0 means tightly packed.
 *   - Arrays, vectors and matrices may have any alignment.
 *
 * Values
 *   - Strings are UTF-8 and end with 0. Paths are any bytes on Unix, UTF-8 elsewhere.
 *   - Lengths are in units of the model. Angles state their unit. Colours are linear RGB, not sRGB.
 *   - Matrices are affine: 12 doubles by column (x axis, y axis, z axis, origin).
 *
 * Blocking
 *   - `Cheap`: the function never waits for the disk or for other work. Exceptions are documented.
 *   - `Blocks`: the function may wait. In a context without threads it does the work itself.
 *   - Queries and oc_model_open also work in the calling thread if the context has threads.
 *     They then take the place of one of them.
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

/** Zeroes the struct at `pointer` and sets its `struct_size`. Example: `oc_camera c; OC_INIT(&c);` */
#define OC_INIT(pointer) oc_init((pointer), sizeof *(pointer))


/** Major version. Programs compiled for another major version do not work. */
#define OC_VERSION_MAJOR 0

/** Minor version. While the major version is 0, programs compiled for another minor version do not work. */
#define OC_VERSION_MINOR 1

/** Patch version. */
#define OC_VERSION_PATCH 0

/** Version of this header: `major * 10000 + minor * 100 + patch`. Pass it to oc_context_create. */
#define OC_HEADER_VERSION 100

/** Timeout: wait without a limit. */
#define OC_FOREVER 4294967295

/** Number of threads: one for each core of the machine. */
#define OC_ALL_THREADS 4294967295

/** Index of the parent of a part that has none. */
#define OC_NO_INDEX 4294967295

/** The value of ids that are not set: of a miss, or not requested. */
#define OC_NO_ID 18446744073709551615ull

/**
 * A model under construction. Add meshes, then call oc_build_start to write the model file.
 *
 * A part is identified by the caller's own 64-bit id. The primitive id of a triangle is its index in the input: first
 * the pushed triangles in the order pushed, then those of the files in the order added. With OC_STRUCTURE_PATCH that
 * of a surface is its face.
 */
typedef struct oc_build oc_build;

/**
 * Threads, log and memory budget. All other objects are created from a context. The library has no other global state:
 * a program may use any number of contexts at the same time.
 *
 * Objects belong to the process that created them. In a child of `fork`, calls on them return OC_STATUS_INVALID_STATE,
 * and releases do nothing, because threads do not survive a fork. A child may create a context of its own.
 */
typedef struct oc_context oc_context;

/**
 * Reads the nodes of a model's trees, one at a time, in any order.
 *
 * A node has a number of 64 bits, its id, which holds for the model file as long as the file is not built anew. The
 * upper 32 bits are the block of the node, below `blocks` of oc_model_info. The lower 32 bits have no meaning outside.
 */
typedef struct oc_cursor oc_cursor;

/** One view that is rendered in the background, with its buffers. */
typedef struct oc_frame oc_frame;

/**
 * Work in flight: a build, a load, a batch of rays or a prefetch.
 *
 * The release of the last reference cancels the work. For a batch of rays that release waits until no thread reads the
 * rays or writes the hits.
 */
typedef struct oc_job oc_job;

/** Keeps a buffer of a complete picture readable. */
typedef struct oc_mapping oc_mapping;

/** A built model, opened read-only. Scenes share it. */
typedef struct oc_model oc_model;

/** The triangles of a part of a model, read some at a time. */
typedef struct oc_part_reader oc_part_reader;

/** A set of parts of a scene, by ids. It may be used with any scene. */
typedef struct oc_part_set oc_part_set;

/**
 * A scene: instances of models, lights, and the looks of parts.
 *
 * Edits take effect together at oc_scene_commit. Frames and batches in flight keep the state that they began with.
 */
typedef struct oc_scene oc_scene;

/**
 * Result of a call, or the reason why background work failed. Numbers are never reused. The hundreds name the cause:
 * - 1: the calling program
 * - 2: the file
 * - 3: the installation
 * - 4: the memory budget, or another limit
 * - 5: the machine
 * - 6: the library itself
 */
typedef uint32_t oc_status;

/** State of long work. */
typedef uint32_t oc_state;

/** Phase of a build or load. */
typedef uint32_t oc_phase;

/** Progress of long work: builds, loads, batches of rays, prefetches and frames. */
typedef struct oc_progress {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** One of the OC_STATE_ constants. */
    oc_state state;
    /** Share of the work that is done, 0 to 1. Never decreases. */
    double fraction;
    /** Units done. Builds: triangles read. Batches: rays answered. Frames: pixels. Prefetches: blocks read. */
    uint64_t done;
    /** Units in total. 0: unknown. */
    uint64_t total;
    /** Builds and loads: bytes read and written so far. Frames and prefetches: bytes in memory. */
    uint64_t bytes;
    /** The least budget in bytes that suffices, if `error` is OC_STATUS_OVER_BUDGET. Otherwise 0. */
    uint64_t need;
    /**
     * Reason why the work failed or was cancelled. For a frame in OC_STATE_COMPLETE_WITHIN_BUDGET: the reason why some
     * data could not be read, else OC_STATUS_OK. After a poll or wait, oc_last_error returns the reason in words.
     */
    oc_status error;
    /** Builds and loads: one of the OC_PHASE_ constants. */
    oc_phase phase;
} oc_progress;

/**
 * Callback: work has ended in any way, or a frame has a better picture.
 *
 * - `user`: the pointer that was registered with the function.
 *
 * Rules:
 * - Any thread may call it. This includes a thread inside a function of the library that ends the work, e.g.
 *   oc_job_cancel or oc_frame_cancel.
 * - It must return soon and must not unwind.
 * - It may call functions that are marked `Cheap`.
 */
typedef void (*oc_wake_fn)(void *user);

/**
 * Runs a task of the library on a thread of the host. oc_submit_fn receives it. Call it once, with the `task` that was
 * passed with it.
 */
typedef void (*oc_run_fn)(void *task);

/**
 * Callback: receives a task for the host's threads.
 *
 * - `user`: `user` of oc_executor.
 * - `run`, `task`: the host must call `run(task)` exactly once, soon, from any thread. It may call it inside this
 *   callback. Then library functions that begin background work return after that work is done.
 *
 * Any thread of the host may call it, but never while the library holds a lock.
 */
typedef void (*oc_submit_fn)(void *user, oc_run_fn run, void *task);

/** The host's own threads. A context with an executor never starts a thread. */
typedef struct oc_executor {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /**
     * Number of tasks that can run at once, 1 or more. The library submits at most as many at a time, plus one for
     * each build and load.
     */
    uint32_t concurrency;
    /** Passed to `submit`. */
    void *user;
    /** Receives the tasks. */
    oc_submit_fn submit;
} oc_executor;

/** Severity of a log line. */
typedef uint32_t oc_log_level;

/**
 * Callback: receives a log line.
 *
 * - `user`: `log_user` of oc_context_desc.
 * - `level`: one of the OC_LOG_ constants.
 * - `message`: valid during the call.
 *
 * Any thread may call it, but never while the library holds a lock. It must not unwind.
 */
typedef void (*oc_log_fn)(void *user, oc_log_level level, const char *message);

/** Set of vector instructions. */
typedef uint32_t oc_instruction_set;

/** Flags of oc_context_desc. */
typedef uint32_t oc_context_flags;

/** Options of a context. All zeros: no threads, three quarters of the machine's memory. */
typedef struct oc_context_desc {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /**
     * Number of worker threads, at most four for each core, or 64 if that is more. OC_ALL_THREADS: one for each core.
     * Ignored with an executor.
     *
     * 0: no worker threads. Your thread alternates reading and tracing inside `oc_context_step` or waits; refinement
     * of a model that is being read is slower, slowest with `oc_context_step`.
     */
    uint32_t threads;
    /**
     * Limit in bytes of the memory that the blocks of all models take, including tables (parts and their names too)
     * and buffers for reading, and that the instances, placed meshes and looks of scenes take. Never exceeded. 0:
     * three quarters of the machine's memory. A value above the machine's memory is refused.
     *
     * Not included:
     * - Batches: 24 MiB for the rays of all batches that wait for data, and 2 MiB for each thread that traces.
     * - oc_scene_overlap_box, oc_scene_overlap_frustum: 1 MiB for each call, and 96 bytes for each part found.
     * - Frames: three times the bytes of the buffers (once more for each picture that is still mapped), and 16 bytes
     *   for each pixel.
     * - Scenes: 80 KiB for each, and while parts are chosen 13 bytes for each id in the list.
     * - Reading: three blocks (192 KiB) for each thread that reads, and the rest of huge pages (at most a sixteenth).
     *
     * A model may be many times larger than the budget:
     * - Opening a model reads its coarse blocks. Other blocks are read when they are used. The least recently used
     *   blocks are evicted.
     * - Tables, root blocks and 2 to 12 MiB for reading must stay in memory. If they do not fit, opening fails
     *   with OC_STATUS_OVER_BUDGET, and oc_last_error_need returns the least budget that suffices.
     * - If the data of a view does not fit, its picture is coarser at first and then completed part by part, see
     *   oc_frame_request. Exact queries take longer.
     */
    uint64_t memory_budget;
    /** The host's own threads, or NULL. The struct is copied. Its `user` must stay valid longer than the context. */
    const struct oc_executor *executor;
    /** Receives log lines, or NULL. */
    oc_log_fn log;
    /** Passed to `log`. Must stay valid longer than the context. */
    void *log_user;
    /** One of the OC_INSTRUCTION_SET_ constants. 0: the best set that the machine has. All sets give the same answers. */
    oc_instruction_set instruction_set;
    /** OC_CONTEXT_ flags, combined with `|`. */
    oc_context_flags flags;
} oc_context_desc;

/** Property of a context. */
typedef uint32_t oc_property;

/** Kind of a camera. */
typedef uint32_t oc_camera_kind;

/** A camera in world space. All numbers must be finite. */
typedef struct oc_camera {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** One of the OC_CAMERA_ constants. */
    oc_camera_kind kind;
    /** Position of the eye. Orthographic: the centre of the picture's plane. */
    double eye[3];
    /** Target point. Only the direction from the eye to it matters. Must differ from the eye. */
    double at[3];
    /** Direction that is up in the picture. Need not be unit. Must not be parallel to the view. All 0: +Z. */
    double up[3];
    /** Perspective: vertical field of view in degrees, above 0 and below 180. 0: 45. Orthographic: ignored. */
    double fov_y;
    /** Orthographic: height of the picture in world units, above 0. Perspective: ignored. */
    double height;
} oc_camera;

/** A ray. Element of an array. Distances `t` along a ray are in units of the length of `direction`. */
typedef struct oc_ray {
    /** Start point, world space. Not finite: the ray misses. */
    double origin[3];
    /**
     * Start of the interval: hits with a smaller `t` are ignored. Below 0: counts as 0. Infinite or NaN: the ray
     * misses.
     */
    double t_min;
    /** End of the interval: hits with a greater `t` are ignored. 0: no end. Below `t_min` or NaN: the ray misses. */
    double t_max;
    /** Direction; need not be unit. Zero or not finite: the ray misses. Components below 1.2e-38 count as zero. */
    float direction[3];
    /**
     * Footprint of the ray: its width at `t` is `cone_a + cone_b * t`, in world units. A stand-in may replace
     * triangles if the area of its box, projected along the ray, is at most the square of the width there.
     *
     * - Exact answers: `cone_a` = 0, `cone_b` = 0.
     * - p pixels of error, perspective camera, direction of length 1 along the view axis: `cone_a` = 0,
     *   `cone_b` = sqrt(p) * 2 tan(fov_y / 2) / (height of the picture in pixels). For a unit direction at the angle a
     *   to that axis, times cos(a).
     * - p pixels of error, orthographic camera: `cone_b` = 0,
     *   `cone_a` = sqrt(p) * (height of the picture in world units) / (height of the picture in pixels).
     *
     * Below 0 or NaN: counts as 0. Infinite: the coarsest stand-ins.
     */
    float cone_a;
    /** See `cone_a`. */
    float cone_b;
    /** The ray can hit an instance only if the masks of both have a common bit. 0: all instances. */
    uint32_t mask;
} oc_ray;

/** A half space: the points p with dot(normal, p) + d >= 0, in world space. Element of an array. */
typedef struct oc_plane {
    /** Normal of the plane. Points inward. Must be finite and not zero; need not be unit. */
    double normal[3];
    /** Offset of the plane, in units of the normal's length. Must be finite. */
    double d;
} oc_plane;

/** Acceleration structure of a model. */
typedef uint32_t oc_structure;

/** Spatial splits: a triangle may be referenced by several leaves. This speeds up models with long thin triangles. */
typedef uint32_t oc_splits;

/** Answer of oc_resolve_fn. */
typedef uint32_t oc_resolution;

/** Frees the memory that an answer of oc_resolve_fn refers to. */
typedef void (*oc_release_fn)(void *release_user);

/** Receives the answer of oc_resolve_fn. All members but `struct_size` are 0 or NULL before the call. */
typedef struct oc_resolved {
    /** Size of this struct in bytes, set by the library. */
    uint32_t struct_size;
    /** One of the OC_RESOLUTION_ constants. */
    oc_resolution kind;
    /** OC_RESOLUTION_BYTES: the content of the file. It must stay as it is until `release` is called. */
    const void *bytes;
    /** Size of `bytes`. 0: `bytes` is ignored. */
    uint64_t size;
    /** OC_RESOLUTION_PATH: path of the file. */
    const char *path;
    /**
     * Called once, by the thread of the job, when `bytes` and `path` are needed no more: at the latest when the job
     * ends. Also called if the answer is invalid. Not called if the callback fails. NULL: nothing is to be freed.
     */
    oc_release_fn release;
    /** Passed to `release`. */
    void *release_user;
} oc_resolved;

/**
 * Callback: resolves the name of a file that a mesh file or a material library refers to.
 *
 * - `user`: `resolve_user` of oc_build_desc.
 * - `uri`: the URI of a glTF file as it is written, or the name in an OBJ file or material library without quotes and
 *   comment. Valid during the call. URIs with data (`data:`) are not passed. A line of several words in an OBJ file is
 *   passed as one name first; if that is refused or not found, each word is.
 * - `file`: path of the file that names it, or the name of a library that came as OC_RESOLUTION_BYTES. Valid during
 *   the call.
 * - `out`: receives the answer.
 *
 * Returns OC_STATUS_OK, or a status that says why there is no answer. OC_STATUS_CANCELLED ends the job. Any other
 * status counts as a file that cannot be read. If the geometry needs the file, the job fails with OC_STATUS_IO, and
 * oc_last_error names the URI and the status; otherwise a note does. An invalid answer counts likewise, with
 * OC_STATUS_INVALID_ARGUMENT, and a refusal with OC_STATUS_PARSE.
 *
 * The thread of the build job calls it, never while the library holds a lock. It must not unwind. It may be called
 * several times for the same name.
 */
typedef oc_status (*oc_resolve_fn)(void *user,
                                   const char *uri,
                                   const char *file,
                                   struct oc_resolved *out);

/** The look of stand-ins: what a picture shows for geometry that is small or not in memory. */
typedef uint32_t oc_stand_ins;

/** The leaves of surfaces with OC_STRUCTURE_PATCH: how rays that stand-ins do not serve find their triangles. */
typedef uint32_t oc_surface_leaves;

/** Options of a build. All zeros: suitable for most models. */
typedef struct oc_build_desc {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** One of the OC_STRUCTURE_ constants. */
    oc_structure structure;
    /**
     * Limit in bytes of the memory that the build takes, at least 32 MiB. Data that does not fit goes to temporary
     * files. Names, parts, instances and one texture may take 64 MiB more. If names, parts and instances do not fit,
     * the job fails with OC_STATUS_OVER_BUDGET and names a budget that suffices for them; a texture that does not fit
     * is left out with a note. Not included: vertices of OBJ files, colours of PLY vertices, buffers of glTF files,
     * cages and maps of heights. 0: no limit.
     */
    uint64_t memory_budget;
    /**
     * Folder for temporary files. NULL: the system's (`TMPDIR`, if it is set). The folder is not accessed before the
     * first temporary file is written.
     */
    const char *temp_dir;
    /** Length of a unit in metres, finite and above 0. Overrides the unit of the input. 0: the unit of the input. */
    double metres_per_unit;
    /** One of the OC_UP_ constants. Overrides the up axis of the input. OC_UP_UNKNOWN: the up axis of the input. */
    uint32_t up;
    /** One of the OC_SPLITS_ constants. */
    oc_splits splits;
    /**
     * Number of threads, at most four for each core, or 64 if that is more. The build starts its own. 0: as many as
     * the context has. OC_ALL_THREADS: one for each core. In a context without threads of its own, a build uses only
     * the thread that runs it. The model file does not depend on this number.
     */
    uint32_t threads;
    /** Must be 0. */
    uint32_t reserved;
    /** Resolves the names of files that mesh files refer to, or NULL. */
    oc_resolve_fn resolve;
    /** Passed to `resolve`. Must stay valid until the build is released and its job has ended. */
    void *resolve_user;
    /**
     * A folder of files that mesh files may refer to, with all folders below it. NULL: none.
     *
     * By default a mesh file may refer only to files in its own folder and below it: names with `..`, absolute names
     * and symbolic links that lead out of it are refused. If the geometry needs the file (a buffer of glTF), the job
     * fails with OC_STATUS_PARSE; otherwise (material libraries, textures) the file is left out with a note.
     */
    const char *trusted_folder;
    /**
     * Greatest number of triangles in the input; those of a shared mesh count once. More: OC_STATUS_OVER_LIMIT. 0: no
     * limit.
     */
    uint64_t max_triangles;
    /**
     * Greatest number of bytes that the model file and all temporary files take on the disk at any time. More:
     * OC_STATUS_OVER_LIMIT. 0: no limit.
     */
    uint64_t max_bytes;
    /**
     * 1: mesh files may refer to any file that the process may read. Only for mesh files from a trusted source. 0: the
     * rule of `trusted_folder`.
     */
    uint32_t trust_paths;
    /** Must be 0. */
    uint32_t reserved_2;
    /**
     * Angle in degrees, at most 180, up to which an edge between two triangles appears smooth, if the input has no
     * normals there. 0: 40 degrees, with which chamfers of 45 degrees stay edges. Below 0: no normals are made, and
     * surfaces without normals show their facets.
     */
    float crease_angle;
    /** One of the OC_STAND_INS_ constants. */
    oc_stand_ins stand_ins;
    /** Number of rays that sample each look of OC_STAND_INS_PROXIES, at most 1,048,576. 0: 512. */
    uint32_t proxy_rays;
    /**
     * Least number of triangles that such a look stands for. 0: so many that all looks take about 0.3 bytes of memory
     * for each triangle.
     */
    uint32_t proxy_triangles;
    /**
     * Greatest distance between a smooth surface and the triangles into which it is diced, as sampled, in units of the
     * surface; finite. 0: 1/2048 of the surface's greatest extent. Not used with `surface_level`.
     */
    double surface_tolerance;
    /**
     * Number of times that each side of a face of a smooth surface is halved, from 1 to 12: of each Bézier patch of a
     * NURBS surface, or of each half if one closed patch is the whole surface. 0: `surface_tolerance` decides.
     */
    uint32_t surface_level;
    /**
     * 1: faces of OBJ files are the cages of subdivision surfaces, with the tags of OpenSubdiv's tools. 0: they are
     * polygons.
     */
    uint32_t subdivide;
    /**
     * A picture of heights by which these surfaces are moved along their normals, through the texture coordinates: PNG
     * with 8 or 16 bits, or EXR. Its last row is at t = 0. NULL: none.
     */
    const char *displacement_map;
    /** Height of a value of 1 (white) of `displacement_map`, in units of the surface, finite. */
    double displacement_scale;
    /** One of the OC_SURFACE_LEAVES_ constants. */
    oc_surface_leaves surface_leaves;
    /**
     * With OC_STRUCTURE_PATCH, squares of surfaces with more than 128 triangles are divided while the normals of one
     * are not within a cone of this opening, in degrees up to 180. Smaller angles give tighter boxes, which take more
     * memory. 0: 30 degrees.
     */
    float surface_flat;
} oc_build_desc;

/** Material of a part. Colours are linear. All zeros: grey, opaque, matt. */
typedef struct oc_material {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Linear RGB, each 0 to 1. All 0 with opacity 0: grey (0.6). */
    float colour[3];
    /** Opacity, 0 to 1; 1 is opaque. 0: 1. */
    float opacity;
    /** Metalness, 0 to 1. */
    float metalness;
    /** Roughness, 0 to 1. 0: 0.6. */
    float roughness;
    /** Must be 0. */
    uint32_t reserved;
} oc_material;

/** A part: the unit that a user selects, hides or colours. */
typedef struct oc_part {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Number of a material from oc_build_add_material. 0: the default material. */
    uint32_t material;
    /** The caller's own id. Must be unique in the build and not OC_NO_ID. Hits and pictures contain it. */
    uint64_t id;
    /** Id of the parent part, which must have been added before. Ignored if `has_parent` is 0. */
    uint64_t parent;
    /** Name in UTF-8. The string is copied. NULL: no name. */
    const char *name;
    /** 1: the part has a parent. 0: it has none. */
    uint32_t has_parent;
    /** Must be 0. */
    uint32_t reserved;
} oc_part;

/** Type of coordinates. */
typedef uint32_t oc_scalar;

/** Type of indices. */
typedef uint32_t oc_index;

/** Triangles in the caller's memory. The arrays are read during the call. They may have any alignment. */
typedef struct oc_triangles {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** 0: the triangles are placed directly. Otherwise: number of a shared mesh from oc_build_add_shared_mesh. */
    uint32_t mesh;
    /**
     * The part that the triangles belong to. Directly placed: the id of the part. Shared mesh: the number of the part,
     * from 0.
     */
    uint64_t part;
    /** Array of corners, three coordinates each. `scalar` is their type. */
    const void *positions;
    /** Number of corners. Without indices it must be a multiple of 3. */
    uint64_t position_count;
    /** Bytes from one corner to the next. 0: tightly packed. */
    uint64_t position_stride;
    /**
     * Array of indices of corners, three for each triangle, tightly packed. `index` is their type. Must be NULL with
     * OC_INDEX_NONE.
     */
    const void *indices;
    /** Number of indices: three times the number of triangles. Must be 0 with OC_INDEX_NONE. */
    uint64_t index_count;
    /** Array of colours, one for each triangle: three floats, linear RGB. NULL: the colour of the part's material. */
    const float *colours;
    /** Bytes from one colour to the next. 0: tightly packed. */
    uint64_t colour_stride;
    /** One of the OC_SCALAR_ constants: the type of coordinates. */
    oc_scalar scalar;
    /** One of the OC_INDEX_ constants: the type of indices. */
    oc_index index;
    /**
     * Array of normals, one for each entry of `positions`: three floats, of any length. They make the surface appear
     * smooth. The normal of a triangle replaces one that is zero, NaN or infinite. NULL: normals are made from the
     * triangles, see oc_build_desc.crease_angle.
     */
    const float *normals;
    /** Bytes from one normal to the next. 0: tightly packed. */
    uint64_t normal_stride;
    /**
     * Array of colours, one for each entry of `positions`: three floats, linear RGB, which are interpolated. NULL:
     * none. With `colours` it must be NULL.
     */
    const float *position_colours;
    /** Bytes from one of these colours to the next. 0: tightly packed. */
    uint64_t position_colour_stride;
} oc_triangles;

/** Where a subdivision surface ends. */
typedef uint32_t oc_boundary;

/** Sharpness of creases after a subdivision. */
typedef uint32_t oc_creasing;

/** Rule for triangles in a cage. */
typedef uint32_t oc_triangle_rule;

/** Texels beyond the border of a map. */
typedef uint32_t oc_wrap;

/**
 * Heights by which a surface is moved along its normal: a biquadratic B-spline with a control value in the middle of
 * each texel, so that the surface stays smooth. Where faces meet, the surface moves by the mean of their heights.
 */
typedef struct oc_displacement {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Texels in a row. */
    uint32_t width;
    /** Rows. */
    uint32_t height;
    /** Number of maps: 1, or the number of faces if there are no coordinates. */
    uint32_t map_count;
    /** Array of heights, tightly packed, finite: map by map, row by row, the first row at t = 0. */
    const float *texels;
    /**
     * Array of the coordinates s, t in the map at each corner of each face, in the order of oc_cage.indices. The map
     * covers 0 to 1. NULL: each face has a map of its own along its sides, and must have four corners.
     */
    const float *coordinates;
    /** Factor of all heights, finite. */
    double scale;
    /** One of the OC_WRAP_ constants, for s. */
    oc_wrap wrap_s;
    /** One of the OC_WRAP_ constants, for t. */
    oc_wrap wrap_t;
} oc_displacement;

/** A Catmull-Clark subdivision surface, as its cage. The arrays are read during the call. They may have any alignment. */
typedef struct oc_cage {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** 0: the surface is placed directly. Otherwise: number of a shared mesh from oc_build_add_shared_mesh. */
    uint32_t mesh;
    /**
     * The part that the surface belongs to. Placed directly: the id of the part. Shared mesh: the number of the part,
     * from 0.
     */
    uint64_t part;
    /**
     * Array of parts, one for each face, which replace `part`. NULL: all faces belong to `part`. Faces of different
     * parts are joined smoothly.
     */
    const uint64_t *face_parts;
    /** Array of vertices, three coordinates each. `scalar` is their type. */
    const void *positions;
    /** Number of vertices. */
    uint64_t position_count;
    /** Bytes from one vertex to the next. 0: tightly packed. */
    uint64_t position_stride;
    /** Array of the number of corners of each face, at least 3. NULL: all faces have four. */
    const uint32_t *face_sizes;
    /** Number of faces. */
    uint64_t face_count;
    /** Array of indices of vertices: the corners of each face, counter-clockwise from outside, face by face. */
    const uint32_t *indices;
    /** Number of indices: the sum of the numbers of corners. */
    uint64_t index_count;
    /** Array of edges that are creases, two indices of vertices each. */
    const uint32_t *creases;
    /**
     * Array of sharpness, one for each crease: 0 is smooth, 10 or more stays sharp for ever, and between these the
     * edge is sharp for so many subdivisions.
     */
    const float *crease_sharpness;
    /** Number of creases. */
    uint64_t crease_count;
    /** Array of indices of vertices that are corners. */
    const uint32_t *corners;
    /** Array of sharpness, one for each corner, as that of creases. */
    const float *corner_sharpness;
    /** Number of corners. */
    uint64_t corner_count;
    /** Array of indices of faces that are holes: they shape their neighbours, and are no surface. */
    const uint32_t *holes;
    /** Number of holes. */
    uint64_t hole_count;
    /** One of the OC_SCALAR_ constants: the type of coordinates. */
    oc_scalar scalar;
    /** One of the OC_BOUNDARY_ constants. */
    oc_boundary boundary;
    /** One of the OC_CREASING_ constants. */
    oc_creasing creasing;
    /** One of the OC_TRIANGLE_RULE_ constants. */
    oc_triangle_rule triangle_rule;
    /** Heights by which the surface is moved along its normal, or NULL. */
    const struct oc_displacement *displacement;
} oc_cage;

/**
 * A NURBS surface without trims, rational or not. The arrays are read during the call, and are tightly packed. They
 * may have any alignment.
 *
 * The surface covers the parameters from `knots_u[degree_u]` to `knots_u[count_u]`, and likewise in v. A periodic
 * surface repeats its first control points at the end.
 */
typedef struct oc_nurbs {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** 0: the surface is placed directly. Otherwise: number of a shared mesh from oc_build_add_shared_mesh. */
    uint32_t mesh;
    /**
     * The part that the surface belongs to. Placed directly: the id of the part. Shared mesh: the number of the part,
     * from 0.
     */
    uint64_t part;
    /** Degree along u, from 1 to 32. */
    uint32_t degree_u;
    /** Degree along v, from 1 to 32. */
    uint32_t degree_v;
    /** Number of control points along u, above `degree_u`. */
    uint32_t count_u;
    /** Number of control points along v, above `degree_v`. */
    uint32_t count_v;
    /** Array of `count_u + degree_u + 1` knots, which do not decrease. At most `degree_u + 1` of them are equal. */
    const double *knots_u;
    /** Array of `count_v + degree_v + 1` knots, likewise. */
    const double *knots_v;
    /**
     * Array of `count_u * count_v` control points, three coordinates each, those along v one after the other. They are
     * not multiplied by their weights.
     */
    const double *points;
    /** Array of the weights of all control points, above 0. NULL: all are 1. */
    const double *weights;
    /** 1: the outside is against du × dv. 0: along it. */
    uint32_t reversed;
    /** Must be 0. */
    uint32_t reserved;
} oc_nurbs;

/** Statistics of a build. */
typedef struct oc_build_report {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Number of notes; oc_job_build_note returns them. */
    uint32_t notes;
    /** Triangles in the input. */
    uint64_t triangles_in;
    /** Triangles in the model. */
    uint64_t triangles_kept;
    /** Triangles dropped because a corner is NaN or infinite. */
    uint64_t dropped_non_finite;
    /** Triangles dropped because they have no area. */
    uint64_t dropped_degenerate;
    /** Triangles dropped because a corner is more than 1e15 units from the origin of its mesh. */
    uint64_t dropped_out_of_range;
    /** Number of parts. */
    uint64_t parts;
    /** Number of placed instances of shared meshes. */
    uint64_t instances;
    /** Bytes that the geometry takes in memory when all of it is loaded. */
    uint64_t geometry_bytes;
    /** Size of the model file in bytes. */
    uint64_t file_bytes;
    /** Seconds spent on reading input. */
    double seconds_read;
    /** Seconds spent on building. */
    double seconds_build;
    /** Seconds spent on writing. */
    double seconds_write;
    /** Greatest distance between a corner of the input and the stored corner, in units of the model. */
    double position_error;
    /** Normals of the input that are zero, NaN or infinite. The normals of their triangles replace them. */
    uint64_t unusable_normals;
} oc_build_report;

/**
 * Callback: reads `bytes` bytes at `offset` of the model into `buffer`.
 *
 * Returns 0 if it has read all bytes, any other number on failure.
 * Any thread may call it, several at once, but never while the library holds a lock. It must not unwind.
 * It must not call functions that read models or wait: queries, oc_model_open, oc_job_wait, oc_frame_wait. These
 * return OC_STATUS_INVALID_STATE there. It must not wait for another thread that calls them either.
 */
typedef uint32_t (*oc_read_fn)(void *user, uint64_t offset, void *buffer, uint64_t bytes);

/**
 * Callback: the library will not read from `user` any more. It is called once.
 *
 * Any thread may call it. It may come a moment after the release of the last handle, when another thread stops tracing
 * or reading the model: `user` must stay valid until then.
 */
typedef void (*oc_close_fn)(void *user);

/** The caller's own functions that read a model, in place of a file. */
typedef struct oc_io {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Must be 0. */
    uint32_t reserved;
    /** Size of the model in bytes. */
    uint64_t size;
    /** Reads a range of bytes. Must not be NULL. */
    oc_read_fn read_at;
    /** Called exactly once after opening or loading was tried with a valid table, even if it failed. May be NULL. */
    oc_close_fn close;
    /** Passed to both functions. */
    void *user;
    /** Name of the model in messages, UTF-8. May be NULL. */
    const char *name;
} oc_io;

/** Axis that points up. */
typedef uint32_t oc_up_axis;

/** Properties of a model. */
typedef struct oc_model_info {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** One of the OC_UP_ constants. */
    oc_up_axis up;
    /** Least corner of the bounds of all triangles, in model space. Greater than `bounds_max` if there are none. */
    double bounds_min[3];
    /** Greatest corner of the bounds. */
    double bounds_max[3];
    /** Length of a unit in metres. 0: unknown. */
    double metres_per_unit;
    /** Number of triangles in the input of the build. */
    uint64_t triangles_in;
    /** Number of triangles stored. Triangles of shared meshes count once. */
    uint64_t triangles_stored;
    /** Number of triangles visible in the model. Triangles of shared meshes count once for each instance. */
    uint64_t triangles_placed;
    /** Size of the file in bytes. */
    uint64_t file_bytes;
    /** Bytes that all nodes and triangles take in memory. */
    uint64_t geometry_bytes;
    /** Bytes in memory now, including tables. */
    uint64_t resident_bytes;
    /** Number of parts. */
    uint32_t parts;
    /** Number of instances of shared meshes. */
    uint32_t instances;
    /** Number of blocks of geometry. */
    uint32_t blocks;
    /** 1: triangles may have colours of their own. 0: they have the colours of their parts. */
    uint32_t has_colours;
    /** 1: triangles may have normals at their corners that make them appear smooth. 0: each has only its own. */
    uint32_t has_normals;
    /** Always 0. */
    uint32_t reserved;
    /** Bytes of the form for exact rays, in addition to `resident_bytes`. 0: there is none now. See OC_CONTEXT_COMPACT. */
    uint64_t fast_form_bytes;
    /** Number of looks from eighteen directions, see OC_STAND_INS_PROXIES. */
    uint64_t proxies;
    /** Bytes of memory that these take, which `resident_bytes` includes. */
    uint64_t proxy_bytes;
} oc_model_info;

/** Flags of a part. */
typedef uint32_t oc_part_flags;

/** Properties of a part of a model. */
typedef struct oc_part_info {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Index of the parent part. OC_NO_INDEX: it has none. */
    uint32_t parent;
    /** Id of the part, as passed when the model was built. */
    uint64_t id;
    /** Name in UTF-8; may be empty. The model owns the string: it is valid as long as the model. */
    const char *name;
    /** Number of the part's own triangles, without those of its child parts. */
    uint64_t triangles;
    /** Least corner of the bounds of these triangles, in model space. Greater than `bounds_max` if there are none. */
    double bounds_min[3];
    /** Greatest corner of the bounds. */
    double bounds_max[3];
    /** Material: linear RGBA. Alpha is the opacity. */
    float colour[4];
    /** Material: metalness, 0 to 1. */
    float metalness;
    /** Material: roughness, 0 to 1. */
    float roughness;
    /** OC_PART_ flags, combined with `|`. */
    oc_part_flags flags;
    /** Always 0. */
    uint32_t reserved;
} oc_part_info;

/** Flags of oc_model_get_placement. */
typedef uint32_t oc_placement_flags;

/** Kind of a light. */
typedef uint32_t oc_light_kind;

/** A light. Element of an array. All zeros: a white headlight. */
typedef struct oc_light {
    /**
     * World space, finite. Point light: position. Directional light: direction in which the light travels; must not be
     * zero, need not be unit. Headlight: ignored.
     */
    double vector[3];
    /** Linear RGB, finite and 0 or more. All 0: white. */
    float colour[3];
    /**
     * Factor of the colour, finite and 0 or more. A white matt surface that faces a light of intensity 1 is white
     * (point light: at distance 1). 0: 1.
     */
    float intensity;
    /** One of the OC_LIGHT_ constants. */
    oc_light_kind kind;
    /**
     * 1: the light casts shadows. 0: it does not. A transparent part transmits the share 1 - opacity of the light,
     * as it does of the surfaces seen through it.
     */
    uint32_t shadows;
} oc_light;

/**
 * Background of a picture: a vertical gradient. All numbers must be finite and 0 or more. All zeros: black and
 * transparent.
 */
typedef struct oc_background {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Must be 0. */
    uint32_t reserved;
    /** Linear RGBA at the bottom of the picture. */
    float bottom[4];
    /** Linear RGBA at the top of the picture. */
    float top[4];
} oc_background;

/** Form of the transforms of an array, from the space of a model or a scene to world space. */
typedef uint32_t oc_transform_form;

/**
 * Many instances of a few models, or of a few scenes. OC_INIT and the prototypes or the scenes, the transforms and
 * their count are the least.
 */
typedef struct oc_instances {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Form of `transforms`. */
    oc_transform_form form;
    /** The models, all of the scene's context. NULL if there are scenes. */
    const struct oc_model *const *prototypes;
    /** Number of models, at least 1; 0 if there are scenes. */
    uint64_t prototype_count;
    /** Index among the models or the scenes of each instance's own, tightly packed. NULL: all are of the first. */
    const uint32_t *prototype_of;
    /** The transform of each instance, finite and invertible. */
    const void *transforms;
    /** Bytes from one transform to the next. 0: tightly packed. */
    uint64_t stride;
    /** Number of instances, from 1 to below 2^31. */
    uint64_t count;
    /**
     * Id of the first instance; each further one has the next higher id. None may be of another instance of the scene,
     * nor OC_NO_ID.
     */
    uint64_t first_id;
    /** A ray of a batch can hit the instances only if its mask has a common bit with this one. 0: all bits. */
    uint32_t mask;
    /** Must be 0. */
    uint32_t reserved;
    /** Scenes as instances, as oc_scene_add_scene describes. NULL if there are models. */
    const struct oc_scene *const *scenes;
    /** Number of scenes, at least 1; 0 if there are models. */
    uint64_t scene_count;
    /**
     * The mask of each instance: a ray can hit it only if its mask has a bit in common with both this one and `mask`.
     * 0: no ray. NULL: all bits.
     */
    const uint32_t *masks;
    /** Bytes from one mask to the next. 0: tightly packed. */
    uint64_t mask_stride;
    /**
     * The tint of each instance, 4 bytes: factors to linear red, green and blue and to the opacity of all that it
     * shows, where 255 stands for 1. With an opacity below 255 it is see-through. Colours of looks replace those that
     * a tint changes, and have no tint. Those of scenes in scenes are multiplied. NULL: no instance has a tint.
     */
    const uint8_t *tints;
    /** Bytes from one tint to the next. 0: tightly packed. */
    uint64_t tint_stride;
} oc_instances;

/** Flags of oc_look: how an instance or a part is shown. */
typedef uint32_t oc_look_flags;

/** Appearance of an instance or a part. All zeros: unchanged. */
typedef struct oc_look {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** OC_LOOK_ flags, combined with `|`. */
    oc_look_flags flags;
    /** Linear RGBA, finite and 0 or more. Alpha is the opacity, at most 1. Ignored without OC_LOOK_COLOURED. */
    float colour[4];
} oc_look;

/** Flags of a choice of parts. */
typedef uint32_t oc_parts_flags;

/** Flags: members of oc_hit to compute, combined with `|`. Fewer members take less time. */
typedef uint32_t oc_want;

/** Flags of oc_query. */
typedef uint32_t oc_query_flags;

/** A batch of rays. */
typedef struct oc_query {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** OC_WANT_ flags, combined with `|`. 0: OC_WANT_ALL. */
    oc_want want;
    /** OC_QUERY_ flags, combined with `|`. */
    oc_query_flags flags;
    /** Must be 0. */
    uint32_t reserved;
    /** The rays. Nothing may write to them until the call has returned or the job has ended. */
    const struct oc_ray *rays;
    /** Number of rays. */
    uint64_t count;
    /**
     * Bytes from one ray to the next. 0: tightly packed.
     *
     * Performance: the library reads 32 successive rays without a copy if they are tightly packed and aligned as
     * oc_ray, and none has a `t_max` or `mask` of 0. Use INFINITY and 0xFFFFFFFF instead.
     */
    uint64_t stride;
} oc_query;

/** Kind of a hit. */
typedef uint32_t oc_hit_kind;

/** Closest hit of a ray. Element of an array. Members that were not requested have the values of a miss. */
typedef struct oc_hit {
    /**
     * Distance from the origin, in units of the direction's length. Miss: infinity.
     *
     * The interval includes both ends. oc_scene_crossings finds all surfaces along a ray. (Tracing the ray again from
     * behind each hit does not: of coincident surfaces it finds one, and at `t` = 0 it may return the same surface for
     * ever.) Exceptions:
     * - Two surfaces closer to each other than `t - t_free` may be returned in either order.
     * - Within the single-precision rounding error of the origin, a surface behind the origin may be returned at 0,
     *   and one in front of it may be missed.
     * - Within the same error of an end of the interval, a surface that the ray meets within about 4 degrees of
     *   edge-on may be missed.
     *
     * Precision: double with `OC_WANT_POSITION` or `OC_WANT_ERROR`, otherwise single. In single precision, the error
     * on long thin triangles near the origin can exceed the last digits.
     */
    double t;
    /** Position in world space. Miss: infinity. */
    double position[3];
    /**
     * No original surface lies on the ray before this distance. Exceptions: surfaces that the ray meets within 0.9
     * degrees of edge-on, the surface that the ray starts on, and edges that it grazes.
     *
     * - Exact hit: `t` less the possible rounding error.
     * - Miss: infinity.
     * - Stand-in, and a hit or a miss of a ray that entered stand-ins before: the distance at which the ray first
     *   entered one, less the possible rounding error. (A stand-in may transmit the ray.)
     */
    double t_free;
    /** Id of the part, as passed when the model was built. Miss: OC_NO_ID. */
    uint64_t part;
    /** Id of the instance, as passed to oc_scene_add_instance. Miss: OC_NO_ID. */
    uint64_t instance;
    /**
     * Index of the triangle in the input of the build, from 0. On a surface with OC_STRUCTURE_PATCH that of the face,
     * among the faces of all surfaces in the order in which they were added: the faces of a cage, or the rectangles
     * between the knots of a NURBS surface. Miss: OC_NO_ID.
     */
    uint64_t prim;
    /** Unit geometric normal in world space, on the side of the ray's origin. Miss: 0. */
    float normal[3];
    /**
     * Barycentric weights of the triangle's second and third corner. On a surface with OC_STRUCTURE_PATCH the
     * parameters u and v in the face, from 0 to 1, also of a stand-in of one face: those of its middle. u runs along
     * the first edge of a face of four corners; other faces consist of a quad at each corner, in which the parameters
     * are (`oc_surface_point.corner` says in which). A stand-in of several faces: 0. Miss: 0.
     */
    float uv[2];
    /** An original surface lies within this distance of `position`, in world units. Miss: 0. */
    float error;
    /** One of the OC_HIT_ constants. */
    oc_hit_kind kind;
    /**
     * Unit normal in world space with which the surface is shaded, on the side of `normal`: interpolated between the
     * corners of the triangle, so that coarse facets appear smooth. Where a model has no such normals, and for
     * stand-ins, it is `normal`. Miss: 0.
     */
    float shading_normal[3];
    /**
     * Number of the place at which the mesh was hit, with OC_WANT_INSTANCE: it tells the places of one mesh in an
     * instance apart, and the instances of scenes in scenes (oc_scene_get_path). It holds for the commit. Miss:
     * OC_NO_ID.
     */
    uint64_t occurrence;
} oc_hit;

/** A ray in single precision, in world space. */
typedef struct oc_ray_f32 {
    /** Start point. Not finite: the ray misses. Far from zero single precision has few digits: use oc_ray there. */
    float origin[3];
    /** Start of the interval, as in oc_ray. */
    float t_min;
    /** Direction, as in oc_ray. */
    float direction[3];
    /** End of the interval, as in oc_ray. 0: no end. */
    float t_max;
} oc_ray_f32;

/** Rays in single precision as a structure of arrays: one array for each number, without gaps. */
typedef struct oc_rays_soa {
    /** x, y and z of the start points. */
    const float *origin[3];
    /** x, y and z of the directions. */
    const float *direction[3];
    /** Starts of the intervals. NULL: 0 for all rays. */
    const float *t_min;
    /** Ends of the intervals. NULL: no end for all rays. */
    const float *t_max;
} oc_rays_soa;

/** A batch of rays in single precision. The rays are exact: they have no footprint. */
typedef struct oc_query_f32 {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /**
     * OC_WANT_T, OC_WANT_NORMAL, OC_WANT_UV, OC_WANT_PART, OC_WANT_INSTANCE, OC_WANT_PRIM, combined with `|`. 0: all
     * of these.
     */
    oc_want want;
    /** OC_QUERY_ flags, combined with `|`. */
    oc_query_flags flags;
    /** Must be 0. */
    uint32_t reserved;
    /** The rays, or NULL. Nothing may write to them until the call has returned. */
    const struct oc_ray_f32 *rays;
    /** The rays as a structure of arrays, or NULL. One of both must be given. */
    const struct oc_rays_soa *columns;
    /** Number of rays. */
    uint64_t count;
    /** Bytes from one of `rays` to the next. 0: tightly packed. */
    uint64_t stride;
} oc_query_f32;

/** A hit in single precision. Members that are not in `oc_query_f32.want` are as for a miss. */
typedef struct oc_hit_f32 {
    /** Distance from the origin, in units of the direction's length. Miss: infinity. */
    float t;
    /** Unit geometric normal in world space, on the side of the ray's origin. Miss: 0. */
    float normal[3];
    /** Barycentric weights of the triangle's second and third corner. Miss: 0. */
    float uv[2];
    /** The lowest 32 bits of the part's id. Miss: 0xFFFFFFFF. */
    uint32_t part;
    /** The lowest 32 bits of the instance's id. Miss: 0xFFFFFFFF. */
    uint32_t instance;
    /** As oc_hit.prim. Miss: 0xFFFFFFFF. */
    uint32_t prim;
    /** One of the OC_HIT_ constants. */
    oc_hit_kind kind;
} oc_hit_f32;

/** A triangle with all that is stored of it. Element of an array. */
typedef struct oc_triangle {
    /**
     * x, y, z of the first corner, of the second, of the third: in model space from oc_part_reader_next, in world
     * space from oc_scene_triangles. The stored positions are exact in double precision, unless a transform places
     * them.
     */
    double corners[9];
    /** Id of the part, as passed when the model was built. */
    uint64_t part;
    /** As oc_hit.prim. */
    uint64_t prim;
    /**
     * Unit normals at the corners with which the surface is shaded, in the order of `corners`, on the side from which
     * the corners appear counter-clockwise. Those of the triangle itself where the model has no others.
     */
    float normals[9];
    /** Always 0. */
    uint32_t reserved;
} oc_triangle;

/** Where the members of oc_surface_point come from. */
typedef uint32_t oc_evaluated;

/** A point of a surface, in world space. Element of an array. */
typedef struct oc_surface_point {
    /**
     * The point of the surface, off `oc_hit.position` by up to the tolerance of dicing; or of the triangle, off by its
     * rounding error.
     */
    double position[3];
    /**
     * First derivative by the first of `oc_hit.uv`. These parameters are u and v in the face on a surface with
     * OC_STRUCTURE_PATCH, otherwise the weights of the triangle's second and third corner: `du` is then the edge from
     * the first to the second corner, `dv` that to the third.
     */
    double du[3];
    /** First derivative by the second of `oc_hit.uv`. */
    double dv[3];
    /**
     * Unit normal with which the surface is shaded, interpolated on triangles. It does not depend on the ray: it is on
     * the outer side of a mesh whose corners appear counter-clockwise from outside, also where an instance is
     * mirrored. Turn it to the eye by its sign with `oc_hit.normal`. 0 for a triangle without an area.
     */
    double normal[3];
    /**
     * Principal curvatures in units of 1 / length, the larger one first: positive where the surface bends towards
     * `normal`, so both are -1 / r on the outside of a sphere of radius r. On triangles they are those of a surface
     * with the interpolated normals, which approach the true ones as triangles become finer, and 0 where the model
     * has no normals.
     */
    double curvatures[2];
    /** One of the OC_EVALUATED_ constants. */
    oc_evaluated kind;
    /**
     * A face with other than four corners consists, with OC_STRUCTURE_PATCH, of a quad at each: the number of the
     * corner, from 0, in whose quad the hit's parameters are. Otherwise 0.
     */
    uint32_t corner;
} oc_surface_point;

/** The side of a triangle. */
typedef uint32_t oc_side;

/** A point where a ray goes through an original triangle. Element of an array. */
typedef struct oc_crossing {
    /** Distance from the origin, in units of the direction's length, in double precision. */
    double t;
    /** Id of the part, as passed when the model was built. */
    uint64_t part;
    /** Id of the instance, as passed to oc_scene_add_instance. */
    uint64_t instance;
    /** As oc_hit.prim. OC_NO_ID if `kind` is OC_HIT_MISSING. */
    uint64_t prim;
    /** Unit geometric normal in world space, on the side of the ray's origin. */
    float normal[3];
    /** Barycentric weights of the triangle's second and third corner. */
    float uv[2];
    /** An original surface lies within this distance of the point at `t`, in world units. */
    float error;
    /** The side on which the ray arrives: one of the OC_SIDE_ constants. */
    oc_side side;
    /** OC_HIT_EXACT. With OC_QUERY_NOW also OC_HIT_MISSING: the primitive id is not in memory. */
    oc_hit_kind kind;
} oc_crossing;

/** Flags of oc_cursor_create. */
typedef uint32_t oc_cursor_flags;

/**
 * A place of a tree in its model. Element of an array.
 *
 * Tree 0 holds the triangles that are placed directly; each other tree holds a shared mesh, or some of a large one,
 * and has a place for each of its instances.
 */
typedef struct oc_tree_place {
    /** Transform from the coordinates of the tree to the model, by column: x axis, y axis, z axis, origin. */
    double model_from_tree[12];
    /** Id of the root of the tree. */
    uint64_t root;
    /** Index of the tree. */
    uint32_t tree;
    /**
     * Index, for oc_model_get_part, of part 0 of the tree in this place: part p of a node or a triangle has index
     * `first_part` + p.
     */
    uint32_t first_part;
} oc_tree_place;

/**
 * A node of a tree: a leaf, which has triangles, or a node with children.
 *
 * Boxes are in double precision, rounded outward, in the coordinates of the tree, see oc_tree_place. The box of a
 * child holds all triangles below; of triangles that the build divided (see `splits` of oc_build_desc) the pieces that
 * are below. `bounds_min` and `bounds_max` are around the boxes of the children, or around all corners of a leaf.
 */
typedef struct oc_node {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Index of the tree. */
    uint32_t tree;
    /** Number of children, at most 8. 0: the node is a leaf. */
    uint32_t child_count;
    /** Number of triangles of a leaf, at most 64. 0: the node has children. */
    uint32_t triangle_count;
    /** Bit i: child i is a leaf. */
    uint32_t leaf_children;
    /**
     * Number, in the tree, of the part that all triangles below belong to. OC_NO_INDEX: they belong to several, or the
     * model does not say. See oc_tree_place.
     */
    uint32_t part;
    /** Least corner of the box. */
    double bounds_min[3];
    /** Greatest corner of the box. */
    double bounds_max[3];
    /** Ids of the children. OC_NO_ID behind the last. */
    uint64_t children[8];
    /** Boxes of the children, 6 numbers each: least x, y, z, greatest x, y, z. 0 behind the last. */
    double child_bounds[48];
} oc_node;

/** A triangle of a leaf. Element of an array. */
typedef struct oc_node_triangle {
    /**
     * x, y, z of the first corner, of the second, of the third, in the coordinates of the tree, see oc_tree_place. The
     * stored positions are exact in double precision.
     */
    double corners[9];
    /** As oc_hit.prim. OC_NO_ID if it was not asked for. */
    uint64_t prim;
    /** Number of the part in the tree, see oc_tree_place. */
    uint32_t part;
    /** Index of the tree. */
    uint32_t tree;
} oc_node_triangle;

/** The relation of a part to a point. */
typedef uint32_t oc_holds;

/** A part at a point. Element of an array. */
typedef struct oc_part_at {
    /** Id of the instance, as passed to oc_scene_add_instance. */
    uint64_t instance;
    /** Id of the part, as passed when the model was built. */
    uint64_t part;
    /**
     * How many times the surface surrounds the point: 1 in a solid whose triangles face outward, -1 if they face
     * inward. Without OC_PART_ORIENTED: 1. OC_HOLDS_UNDECIDED: 0.
     */
    int32_t winding;
    /** One of the OC_HOLDS_ constants. */
    oc_holds holds;
} oc_part_at;

/** How a part intersects a volume. */
typedef uint32_t oc_overlap_kind;

/** A part that intersects a volume. Element of an array. */
typedef struct oc_overlap {
    /** Id of the instance, as passed to oc_scene_add_instance. */
    uint64_t instance;
    /** Id of the part, as passed when the model was built. */
    uint64_t part;
    /** One of the OC_OVERLAP_ constants. */
    oc_overlap_kind kind;
    /** Always 0. */
    uint32_t reserved;
} oc_overlap;

/** Results of a search for clashes. */
typedef uint32_t oc_clash_detail;

/** Flags: pairs of parts that are not compared. */
typedef uint32_t oc_clash_skip_flags;

/** A search for clashes. All zeros: all parts against each other, without a clearance. */
typedef struct oc_clash_desc {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** One of the OC_CLASH_DETAIL_ constants. */
    oc_clash_detail detail;
    /** Parts of which a clash has one. NULL: all parts. */
    const struct oc_part_set *first;
    /** Parts of which a clash has the other. NULL: those of `first`. */
    const struct oc_part_set *second;
    /** Distance in world units up to which parts that are apart clash; 0 or more. */
    double clearance;
    /**
     * Depth in world units up to which closed parts that reach into each other touch, and greatest error of the depths
     * of others; 0 or more. 0: depths are not sought.
     */
    double tolerance;
    /** Greatest number of pairs of triangles with OC_CLASH_DETAIL_TRIANGLES. 0: 1048576. */
    uint64_t limit;
    /**
     * Pairs of part ids that are not compared, in any instances and either order: 2 * `skip_count` ids. May be NULL if
     * `skip_count` is 0.
     */
    const uint64_t *skip_pairs;
    /** Number of pairs in `skip_pairs`. */
    uint64_t skip_count;
    /** OC_CLASH_SKIP_ flags, combined with `|`. */
    oc_clash_skip_flags skip;
    /** Must be 0. */
    uint32_t reserved;
} oc_clash_desc;

/** The way in which two parts clash. */
typedef uint32_t oc_clash_kind;

/** Flags: parts of a clash that are not closed. */
typedef uint32_t oc_clash_open_flags;

/**
 * A clash of two parts, or of a triangle of each. Element of an array. The first part is in the first set of the
 * search and the second in the second set. If each part is in both, the part of the instance that was added first
 * comes first, or the one that is first in the model.
 */
typedef struct oc_clash {
    /**
     * Depends on the ids of instances, parts and triangles alone, not on which part is the first: the same clash of
     * two searches has the same id.
     */
    uint64_t id;
    /** Ids of the instances. */
    uint64_t instance[2];
    /** Ids of the parts. */
    uint64_t part[2];
    /** Indices of the triangles in the inputs of the builds, from 0. OC_NO_ID: a clash of parts. */
    uint64_t prim[2];
    /**
     * World space. If there is a depth: the deepest point of the first part in the second, or if that reaches deeper
     * into the first, the point of the first part's surface nearest to its deepest point. Clearance: the point of the
     * first part that is nearest to the second. Otherwise an end of the common segment of two triangles, or a corner
     * of the part inside.
     */
    double first_point[3];
    /** World space. As `first_point`, of the second part; otherwise the other end of the segment, or the same corner. */
    double second_point[3];
    /**
     * The direction in which the second part moves away from the first, of length 1: along both points if there is a
     * depth or a distance, otherwise along the normal of a triangle there. Zero: none is known.
     */
    double normal[3];
    /** Least corner of the box around all common points of the parts (around both points if there are none). */
    double low[3];
    /** Greatest corner of that box. */
    double high[3];
    /**
     * The greatest distance, in world units, from a point of a part's surface that is inside of the other part to the
     * other's surface; of both parts if this is a clash of two triangles. 0: it is not known, or they only touch.
     */
    double depth;
    /** Distance of the parts in world units. 0: they have common points, or one is inside of the other. */
    double distance;
    /**
     * Bound of the error of `depth` or `distance`. That of a depth is at most the tolerance and rounding, unless the
     * search ended early after many tries.
     */
    double error;
    /**
     * Number of pairs of triangles that meet. Some are counted several times in a clash of parts of a model that was
     * built with spatial splits.
     */
    uint64_t count;
    /** One of the OC_CLASH_ constants. */
    oc_clash_kind kind;
    /** OC_CLASH_OPEN_ flags, combined with `|`. */
    oc_clash_open_flags open;
} oc_clash;

/** The end of a search for clashes. */
typedef struct oc_clash_summary {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** 1: pairs of triangles were left out, because there are more than the limit. Otherwise 0. */
    uint32_t is_cut;
    /** Number of clashes, taken or not. */
    uint64_t clashes;
    /** Number of pairs of parts that clash. */
    uint64_t pairs;
} oc_clash_summary;

/** Flags of oc_nearest_desc. */
typedef uint32_t oc_nearest_flags;

/** A batch of points whose nearest points are searched. All zeros: no points, of all parts, without a limit. */
typedef struct oc_nearest_desc {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** OC_NEAREST_ flags, combined with `|`. */
    oc_nearest_flags flags;
    /** The points, 3 doubles each, world space. Must be finite. May be NULL if `count` is 0. */
    const double *points;
    /** Number of points. */
    uint64_t count;
    /** Bytes from one point to the next. 0: tightly packed. */
    uint64_t stride;
    /** The parts that are searched. NULL: all parts. */
    const struct oc_part_set *parts;
    /** Distance in world units beyond which nothing is found. 0: no limit. */
    double max_distance;
} oc_nearest_desc;

/** The nearest point of the surfaces of parts. Element of an array. */
typedef struct oc_nearest_point {
    /**
     * Distance from the point that was asked for to the nearest triangle, in world units, also from inside of a part.
     * Miss: infinity.
     */
    double distance;
    /**
     * The exact distance differs from `distance` by no more than this, in world units: rounding and stored positions,
     * and with OC_HIT_MISSING what is not in memory. Infinity: the exact distance is `distance` or more, and may be
     * beyond the limit. Miss: 0.
     */
    double error;
    /**
     * The nearest point, world space. OC_HIT_MISSING without a part: the middle of a box that holds surface, or
     * infinity. Miss: infinity.
     */
    double position[3];
    /** Id of the instance, as passed to oc_scene_add_instance. OC_NO_ID: unknown, or a miss. */
    uint64_t instance;
    /** Id of the part, as passed when the model was built. OC_NO_ID: unknown, or a miss. */
    uint64_t part;
    /** As oc_hit.prim. OC_NO_ID: unknown, or a miss. */
    uint64_t prim;
    /**
     * OC_HIT_EXACT. OC_HIT_MISS: no triangle is within the limit. OC_HIT_MISSING, only with OC_NEAREST_NOW: data is
     * not in memory, so that the distance or the id of the triangle is not exact.
     */
    oc_hit_kind kind;
    /**
     * With OC_NEAREST_INSIDE one of the OC_HOLDS_ constants if a part of the set holds the point that was asked for.
     * Otherwise 0.
     */
    oc_holds holds;
} oc_nearest_point;

/** A search for the distance of two sets of parts. All zeros: of all parts, the nearest two. */
typedef struct oc_distance_desc {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Must be 0. */
    uint32_t reserved;
    /** The first set. NULL: all parts. */
    const struct oc_part_set *first;
    /** The second set. NULL: the other parts of `first`. */
    const struct oc_part_set *second;
    /** Distance in world units beyond which nothing is found: the search then ends early. 0: no limit. */
    double max_distance;
} oc_distance_desc;

/**
 * The distance of two sets of parts, and two points that have it. The first of two is of the first set; of one set,
 * that of the instance that was added first, or of the part that is first in the model.
 */
typedef struct oc_distance {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /**
     * 1: found. 0: the distance is greater than the limit, or there are no two parts. Other members are then not set,
     * and `distance` is infinity.
     */
    uint32_t found;
    /** Distance in world units. 0: triangles have a common point. */
    double distance;
    /** Bound of the error of `distance`, in world units: of rounding and of stored positions. 0 if `distance` is 0. */
    double error;
    /** The point of the first set, world space. */
    double first_point[3];
    /** The point of the second set, world space. */
    double second_point[3];
    /** Ids of the instances. */
    uint64_t instance[2];
    /** Ids of the parts. */
    uint64_t part[2];
    /** Indices of the triangles in the inputs of the builds, from 0. */
    uint64_t prim[2];
} oc_distance;

/**
 * Direction of a view, relative to an up axis. Front is the side towards -Y if Z is up, +Z if Y is up, +Y if X is up.
 * Left and right are as seen from the front.
 */
typedef uint32_t oc_view;

/** The picture for which oc_scene_fit finds a camera. `width` and `height` must be set. */
typedef struct oc_fit {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Kind of the camera: one of the OC_CAMERA_ constants. */
    oc_camera_kind kind;
    /** Width of the picture in pixels, 1 to 65536. */
    uint32_t width;
    /** Height of the picture in pixels, 1 to 65536. */
    uint32_t height;
    /** One of the OC_VIEW_ constants. */
    oc_view view;
    /** Up axis that `view` refers to: one of the OC_UP_ constants. OC_UP_UNKNOWN: +Z. */
    oc_up_axis up_axis;
    /** OC_VIEW_ALONG: direction of the view, from the eye; finite and not zero, need not be unit. Otherwise ignored. */
    double direction[3];
    /**
     * OC_VIEW_ALONG: direction that is up in the picture, not parallel to `direction`. All 0: that of `up_axis`, or of
     * OC_VIEW_TOP or OC_VIEW_BOTTOM if that is parallel to `direction`. Otherwise ignored.
     */
    double up[3];
    /** OC_CAMERA_PERSPECTIVE: vertical field of view in degrees, above 0 and below 180. 0: 45. Otherwise ignored. */
    double fov_y;
    /** Share of the width and of the height that stays free on each side, below 0.5. 0: 0.05. Below 0: none. */
    double margin;
    /** OC_PARTS_ flags for the chosen parts, combined with `|`, or 0. */
    oc_parts_flags flags;
    /** Must be 0. */
    uint32_t reserved;
} oc_fit;

/** A part of an instance. Element of an array. */
typedef struct oc_part_ref {
    /** Id of the instance, as passed to oc_scene_add_instance. */
    uint64_t instance;
    /**
     * Id of the part, as passed when the model was built. If several parts of the model have it, the first is meant.
     * OC_NO_ID: all parts of the instance.
     */
    uint64_t part;
} oc_part_ref;

/** Buffer of a picture. The first row is the top one, the first pixel of a row the left one. */
typedef uint32_t oc_buffer;

/** The caller's memory for a buffer. Element of an array. */
typedef struct oc_target {
    /**
     * First pixel of the first row. The library writes to it from any thread while the frame renders. It holds a
     * complete picture after a request has ended as OC_STATE_DONE or OC_STATE_COMPLETE_WITHIN_BUDGET; a request that
     * is cancelled or replaced may leave it incomplete. The memory must stay valid until the frame is released or
     * resized.
     */
    void *memory;
    /** Size of the memory in bytes. */
    uint64_t size;
    /** Bytes from one row to the next. 0: tightly packed. */
    uint64_t row_pitch;
    /** One of the OC_BUFFER_ constants. */
    oc_buffer buffer;
    /** Must be 0. */
    uint32_t reserved;
} oc_target;

/** Options of a frame. `width` and `height` must be set. */
typedef struct oc_frame_desc {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Width in pixels, 1 to 65536. */
    uint32_t width;
    /** Height in pixels, 1 to 65536. A frame has at most 2^30 pixels. */
    uint32_t height;
    /**
     * Buffers to keep for oc_frame_map: bits `1 << OC_BUFFER_...`, combined with `|`. 0: OC_BUFFER_COLOUR_SRGB8, or
     * none if there are targets.
     */
    uint32_t buffers;
    /**
     * The caller's memory for some buffers, at most one target for each buffer. Independent of `buffers`. Tightly
     * packed. NULL if `target_count` is 0.
     */
    const struct oc_target *targets;
    /** Number of targets. */
    uint64_t target_count;
} oc_frame_desc;

/** Flags of oc_frame_settings. */
typedef uint32_t oc_frame_flags;

/** Options of a request. All zeros: exact, one ray for each pixel. */
typedef struct oc_frame_settings {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** Rays for the colour of a pixel, at most 1024. 0: 1. The other buffers take the ray through the pixel's centre. */
    uint32_t samples;
    /**
     * Pixels of error, finite and 0 or more. A stand-in may replace triangles if its projection covers at most `poe`
     * square pixels. 0 means exact.
     */
    float poe;
    /** Intensity of the ambient light, which reaches all surfaces; finite. 0: 0.15. Below 0: none. */
    float ambient;
    /** OC_FRAME_ flags, combined with `|`. */
    oc_frame_flags flags;
    /**
     * Factor to the light of surfaces in OC_BUFFER_COLOUR_SRGB8, finite and 0 or more. 0: 1. Backgrounds keep their
     * colours, and so does OC_BUFFER_COLOUR_LINEAR.
     */
    float exposure;
} oc_frame_settings;

/** Accuracy of the picture of the last request. */
typedef struct oc_frame_accuracy {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /**
     * The greatest threshold of a pixel, in pixels of error: `poe` of the request, or more as long as the picture has
     * pixels with a raised threshold, because its data does not fit the memory budget at once. In pictures with a
     * raised threshold stand-ins transmit no rays.
     */
    float effective_poe;
    /** Number of the request in this frame, from 1. 0: nothing was requested yet. */
    uint64_t request;
    /** Pixels with an exact answer: triangles or background, without a stand-in in front. */
    uint64_t pixels_exact;
    /** Pixels that show a stand-in as fine as `effective_poe` requires, or a surface through such a stand-in. */
    uint64_t pixels_lod;
    /** Pixels that show a stand-in for missing data. */
    uint64_t pixels_missing;
    /** Pixels of the picture in total. */
    uint64_t pixels_total;
    /** Bytes in memory of the models in the scene. */
    uint64_t bytes_resident;
    /**
     * Bytes that the picture, or the present pane of it, needs and that are not in memory; 0 at the end of a picture
     * that was completed pane by pane. After OC_STATE_COMPLETE_WITHIN_BUDGET without panes: the data that could not be
     * read or did not fit; 0 if all data for `effective_poe` is in memory.
     */
    uint64_t bytes_wanted;
    /** Seconds from the request until now, or until its end. */
    double seconds;
    /**
     * Estimated remaining seconds at the present speed. Before the first picture: until that is ready. Later: until
     * the missing data known now has arrived; data that better pictures will need is unknown. 0: nothing runs.
     * Infinity: unknown.
     */
    double seconds_to_go;
    /**
     * Largest error in pixels. The rounding error of triangles counts only if the frame has OC_BUFFER_DEPTH or
     * OC_BUFFER_ERROR.
     */
    float worst_error;
    /** Mean error in pixels, over the pixels that show a surface. Rounding errors as for `worst_error`. */
    float mean_error;
    /**
     * Number of complete pictures that the request has made so far. At 1 or more, one can be mapped. The first is made
     * from the data in memory, each later one from more data. The very first picture of a frame waits up to 80 ms for
     * missing data.
     */
    uint32_t pictures;
    /** State of the request: one of the OC_STATE_ constants. */
    oc_state state;
} oc_frame_accuracy;

/** Type of the elements of a buffer. */
typedef uint32_t oc_format;

/** A mapped buffer of a complete picture. */
typedef struct oc_pixels {
    /** Size of this struct in bytes; OC_INIT sets it. */
    uint32_t struct_size;
    /** One of the OC_FORMAT_ constants. */
    oc_format format;
    /** Pixels in a row. */
    uint32_t width;
    /** Number of rows. */
    uint32_t height;
    /** First pixel of the first row, aligned for its type. The content does not change while it is mapped. */
    const void *data;
    /** Bytes from one row to the next. */
    uint64_t row_pitch;
    /** Size of the buffer in bytes. */
    uint64_t size;
    /** Keeps `data` valid. Release it with oc_mapping_release. */
    struct oc_mapping *mapping;
} oc_pixels;

/** A position with a rotation and a scale. Element of an array. */
typedef struct oc_place {
    /** Place of the origin of the model or scene in world space. Finite. */
    double position[3];
    /** Quaternion x, y, z, w of the rotation, applied after the scale. Finite and not zero; need not be unit. */
    float rotation[4];
    /** Scale along all axes. Finite and not 0. Below 0 it mirrors at this origin. */
    float scale;
    /** Must be 0. */
    uint32_t reserved;
} oc_place;

/** Success. */
#define OC_STATUS_OK 0

/** The calling program: an argument is NULL, is out of its range, or belongs to another context. Nothing changed. */
#define OC_STATUS_INVALID_ARGUMENT 100

/**
 * The calling program: the object's present state does not allow the call, or the object belongs to the parent
 * process: after `fork` a child can only release it. Nothing changed.
 */
#define OC_STATUS_INVALID_STATE 101

/** The calling program: the array is too small. The required count was written, nothing else. */
#define OC_STATUS_BUFFER_TOO_SMALL 102

/** The calling program: the work was cancelled on request. */
#define OC_STATUS_CANCELLED 103

/**
 * The calling program: the block of a node is not in memory, and a cursor with OC_CURSOR_NOW does not read it. Nothing
 * changed.
 */
#define OC_STATUS_MISSING 104

/** The file: an input file of a build cannot be parsed. */
#define OC_STATUS_PARSE 200

/** The file: the model file is damaged, is not a model, or has an older format. */
#define OC_STATUS_CORRUPT 201

/** The installation: the program was compiled with the header of another version. */
#define OC_STATUS_VERSION_MISMATCH 300

/** The installation: a newer version of the library wrote the model. */
#define OC_STATUS_NEWER_FORMAT 301

/** The budget: the memory budget is too small. oc_last_error_need returns the least budget that suffices. */
#define OC_STATUS_OVER_BUDGET 400

/** The limit: a build exceeds a limit of oc_build_desc. oc_last_error names the limit and what exceeds it. */
#define OC_STATUS_OVER_LIMIT 401

/** The machine: reading or writing failed, or a thread could not be started. */
#define OC_STATUS_IO 500

/**
 * The machine: the system refused memory. oc_last_error names its purpose and size. Nothing changed, or the state is
 * that after any other error.
 *
 * Allocations of up to 4 MiB that the system refuses come from a reserve of 32 MiB in the library. The reserve takes
 * memory only while it is used. While more than half of it is taken and the system still refuses memory, builds,
 * loads, queries and frames end with this status, and return what they took. Larger allocations fail by themselves.
 * Exceptions, in which the process ends: many threads take the rest of the reserve between two steps of their work;
 * the lists of parts, names and vertices of mesh files grow beyond 4 MiB.
 */
#define OC_STATUS_OUT_OF_MEMORY 501

/**
 * The library: a defect. The object is poisoned: further calls return OC_STATUS_POISONED. oc_last_error describes the
 * defect; for background work the log does too. Rust's standard library also writes the description to standard error,
 * because outcrop installs no panic hook (a hook would be global state).
 */
#define OC_STATUS_INTERNAL 600

/** The library: a defect occurred in this object before. The only valid call is the release. */
#define OC_STATUS_POISONED 601

/** Frames only: nothing was requested yet. */
#define OC_STATE_IDLE 0

/** The work runs or waits for a thread. */
#define OC_STATE_RUNNING 1

/** The work has ended with the complete result, as exact as requested. */
#define OC_STATE_DONE 2

/** The work was cancelled. Do not use its outputs. */
#define OC_STATE_CANCELLED 3

/** The work has failed. Do not use its outputs. */
#define OC_STATE_FAILED 4

/**
 * The work has ended with a part of the result: all that fits the memory budget or can be read. Only frames and
 * prefetches end so. The picture of such a frame is coarser than requested; oc_frame_get_accuracy returns by how much.
 */
#define OC_STATE_COMPLETE_WITHIN_BUDGET 5

/** The work has not begun, or it is neither a build nor a load. */
#define OC_PHASE_WAITING 0

/** Reading the input, or the model. */
#define OC_PHASE_READ 1

/** Building trees. */
#define OC_PHASE_BUILD 2

/** Encoding and writing blocks. */
#define OC_PHASE_WRITE 3

/** Flushing the file to the disk and giving it its name. */
#define OC_PHASE_SEAL 4

/** The work has ended. */
#define OC_PHASE_DONE 5

/** An operation failed. */
#define OC_LOG_ERROR 1

/** Something is wrong, but the operation continues. */
#define OC_LOG_WARNING 2

/** Information for users. */
#define OC_LOG_INFO 3

/** Information for developers. */
#define OC_LOG_DEBUG 4

/** The best set that the machine has. */
#define OC_INSTRUCTION_SET_BEST 0

/** The set that every machine of this architecture has. */
#define OC_INSTRUCTION_SET_BASELINE 1

/** AVX2. */
#define OC_INSTRUCTION_SET_AVX2 2

/** AVX-512. */
#define OC_INSTRUCTION_SET_AVX512 3

/**
 * The library reads only the data that frames and queries need. Without this flag it also reads the geometry and
 * colours of a model that fits the memory budget, in the background, while nothing more urgent waits to be read.
 * Primitive ids are read only on request.
 */
#define OC_CONTEXT_NO_READ_AHEAD 1

/**
 * Models only have their compact form in memory. Without this flag a model that is in memory as a whole also gets a
 * form in which exact rays are traced faster, made in the background. It takes some 50 to 70 bytes for each triangle,
 * as far as `memory_budget` has room, and is given back when other data needs the room. Answers and pictures are the
 * same.
 */
#define OC_CONTEXT_COMPACT 2

/** Version of the library, in the format of OC_HEADER_VERSION. */
#define OC_PROPERTY_VERSION 1

/** Number of the library's own threads. */
#define OC_PROPERTY_THREADS 2

/** Number of threads, the library's or the host's, that may work at once. */
#define OC_PROPERTY_CONCURRENCY 3

/** Memory budget in bytes. */
#define OC_PROPERTY_MEMORY_BUDGET 4

/** Vector instructions in use: one of the OC_INSTRUCTION_SET_ constants. */
#define OC_PROPERTY_INSTRUCTION_SET 5

/** Largest width and height of a frame, in pixels. */
#define OC_PROPERTY_MAX_FRAME_SIZE 6

/** Newest format of model files that the library reads: major * 65536 + minor. */
#define OC_PROPERTY_FORMAT 7

/** Bytes of the memory budget that are in use now. */
#define OC_PROPERTY_MEMORY_USED 8

/** All rays start at the eye. */
#define OC_CAMERA_PERSPECTIVE 0

/** Parallel rays start on a plane through the eye. Nothing behind the plane is visible. */
#define OC_CAMERA_ORTHOGRAPHIC 1

/** The library looks for the file, by the rule of `trusted_folder` in oc_build_desc. */
#define OC_RESOLUTION_DEFAULT 0

/** The content of the file is at `bytes`. */
#define OC_RESOLUTION_BYTES 1

/** The file at `path` is read, wherever it is. */
#define OC_RESOLUTION_PATH 2

/** The file must not be read. */
#define OC_RESOLUTION_REFUSED 3

/** The library chooses. At present OC_STRUCTURE_BVH. */
#define OC_STRUCTURE_DEFAULT 0

/** A wide, quantised bounding volume hierarchy. Surfaces are diced into triangles. */
#define OC_STRUCTURE_BVH 1

/**
 * Surfaces as grids under quadtrees of quantised boxes, about a byte of memory for each triangle that they are diced
 * into, if each face has some ten thousand; some ten if a face has hundreds (see `surface_leaves`). Triangles as with
 * OC_STRUCTURE_BVH.
 *
 * oc_hit.prim of a hit on a surface is the face, in the order in which the faces of all surfaces were added. The error
 * of exact hits includes `surface_tolerance`. Surfaces keep their own normals if `crease_angle` is below 0 too. Rays
 * are traced one by one, also those of pictures.
 */
#define OC_STRUCTURE_PATCH 4

/** Split if it speeds up the model. */
#define OC_SPLITS_AUTO 0

/** Never split. */
#define OC_SPLITS_OFF 1

/** Always split. */
#define OC_SPLITS_ON 2

/** The library chooses. At present OC_STAND_INS_VOXELS. */
#define OC_STAND_INS_AUTO 0

/** Each cell has a look of its own, from the sides of its box. */
#define OC_STAND_INS_VOXELS 1

/**
 * Subtrees of some hundred triangles have a look from eighteen directions, which all cells in them show. These looks
 * are always in memory and count in the budget: about 0.3 bytes for each triangle.
 */
#define OC_STAND_INS_PROXIES 2

/** The library chooses. At present OC_SURFACE_LEAVES_BOXES. */
#define OC_SURFACE_LEAVES_AUTO 0

/**
 * Boxes alone are stored: the triangles are computed from the control points where a ray comes to them, at about a
 * byte of memory for each triangle. Displaced surfaces, surfaces of degrees above 3, and small squares at vertices
 * where the surface is no polynomial have facets.
 */
#define OC_SURFACE_LEAVES_BOXES 1

/** The vertices of all triangles are stored, about seven bytes for each triangle: rays find them sooner. */
#define OC_SURFACE_LEAVES_FACETS 2

/** float. */
#define OC_SCALAR_F32 0

/** double. */
#define OC_SCALAR_F64 1

/** No indices: each three successive corners are a triangle. */
#define OC_INDEX_NONE 0

/** uint32_t. */
#define OC_INDEX_U32 1

/** uint64_t. */
#define OC_INDEX_U64 2

/** Its boundary is a smooth curve along the boundary edges of the cage. */
#define OC_BOUNDARY_EDGES 0

/** Likewise, and the curve passes through boundary vertices that are in one face only. */
#define OC_BOUNDARY_EDGES_AND_CORNERS 1

/** Faces at the boundary of the cage are no surface: they only shape their neighbours. */
#define OC_BOUNDARY_NONE 2

/** One less than before. */
#define OC_CREASING_UNIFORM 0

/** Chaikin's rule: one less than a mean over the edges of the crease that follow each other. */
#define OC_CREASING_CHAIKIN 1

/** That of all faces. */
#define OC_TRIANGLE_RULE_CATMULL_CLARK 0

/** Weights with which regular triangles become smoother surfaces. */
#define OC_TRIANGLE_RULE_SMOOTH 1

/** The map repeats. */
#define OC_WRAP_REPEAT 0

/** The border continues. */
#define OC_WRAP_CLAMP 1

/** Unknown. The views of oc_model_get_view and oc_scene_fit then take +Z. */
#define OC_UP_UNKNOWN 0

/** +X. */
#define OC_UP_X 1

/** +Y (glTF). */
#define OC_UP_Y 2

/** +Z (most CAD). */
#define OC_UP_Z 3

/**
 * The part's own triangles form a closed surface: each edge belongs to an even number of them. Rays cross the part an
 * even number of times. The stored positions decide, and triangles without area count.
 */
#define OC_PART_CLOSED 1

/**
 * The surface is closed, and its triangles face one way: each edge is passed as often in one direction as in the
 * other. Rays leave the part as often as they enter it. A part that is closed without this flag has triangles that
 * face the wrong way, or has no inside.
 */
#define OC_PART_ORIENTED 2

/** The model does not say which axis is up: it was not turned. */
#define OC_PLACEMENT_UP_UNKNOWN 1

/** The model does not say how long its unit is: it was not scaled. */
#define OC_PLACEMENT_UNIT_UNKNOWN 2

/** At the eye. No falloff, no shadows. */
#define OC_LIGHT_HEAD 0

/** At a point. Its light falls off with the square of the distance. */
#define OC_LIGHT_POINT 1

/** Infinitely far away. */
#define OC_LIGHT_DIRECTIONAL 2

/** 12 doubles by column: the images of the three axes, then the translation. As for oc_scene_add_instance. */
#define OC_TRANSFORM_AFFINE_F64 0

/** The same in 12 floats, for models near zero. */
#define OC_TRANSFORM_AFFINE_F32 1

/** An oc_place. */
#define OC_TRANSFORM_PLACE 2

/**
 * Hidden: no ray hits it. A part of opacity 0 looks the same, but rays hit it: hide the parts that picks and queries
 * must not return.
 */
#define OC_LOOK_HIDDEN 1

/** Highlighted. */
#define OC_LOOK_SELECTED 2

/** Shown in the colour of oc_look instead of its own. */
#define OC_LOOK_COLOURED 4

/** The parts below the given parts are meant too: all parts whose chain of parents leads to one of them. */
#define OC_PARTS_BELOW 1

/** No hit between t_min and t_max, or stand-ins in the interval transmitted the ray (see `t_free`). */
#define OC_HIT_MISS 0

/** Hit on an original triangle, of any opacity (also 0), unless its part or instance is hidden. */
#define OC_HIT_EXACT 1

/**
 * Hit on a stand-in as fine as the ray's cone requires: a cell that contains original surface.
 * - `t`: where the ray enters the cell.
 * - `normal`: mean normal of the surface visible there.
 * - `part`: the part with the largest visible area, over all directions.
 * - `uv`, `prim`: as for a miss.
 *
 * A cell may hold several instances: `part`, `instance` and `occurrence` are then those of the one with the largest
 * visible area. A cell with wires, leaves or the like is a partly open stand-in: it transmits the same share of rays
 * as its content does (see `t_free`).
 */
#define OC_HIT_LOD 2

/**
 * Hit on a stand-in that is coarser than required, because the data below it is not in memory. Only frames and
 * OC_QUERY_NOW return it. Members as for OC_HIT_LOD.
 *
 * An exact hit whose primitive id was requested (OC_WANT_PRIM, part of the default) but is not in memory has this kind
 * too. Its other members are those of the exact hit; `prim` is OC_NO_ID.
 *
 * Exception: if the ray starts inside of the cell, `t` is where it leaves the cell and `t_free` is t_min: the cell may
 * contain surface anywhere.
 */
#define OC_HIT_MISSING 3

/** Only `t` and `kind`, which are always set. */
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

/** `prim`. May have to read the disk. */
#define OC_WANT_PRIM 64

/** `error` and `t_free`; `t` in double precision. */
#define OC_WANT_ERROR 128

/** All members but `shading_normal`. */
#define OC_WANT_ALL 255

/** `shading_normal`. May have to read the disk. */
#define OC_WANT_SHADING_NORMAL 256

/**
 * Hint: each 32 successive rays start near each other and have similar directions. They are traced as one packet,
 * which is faster. The answers do not change. Without the flag, the library recognises rays of neighbouring pixels if
 * they enter few placed meshes.
 */
#define OC_QUERY_COHERENT 1

/**
 * Answer at once from the data in memory. Stand-ins replace missing data; their hits are OC_HIT_MISSING. The call
 * neither reads nor requests data (oc_scene_prefetch_box does). Without the flag, the call reads all data that it
 * needs, and the answers do not depend on the data in memory.
 */
#define OC_QUERY_NOW 2

/** The hit is a miss: `position` is infinite, all other members are 0. */
#define OC_EVALUATED_NOTHING 0

/** The surface, evaluated at the parameters of the hit. */
#define OC_EVALUATED_SURFACE 1

/** A triangle, and the normals at its corners. */
#define OC_EVALUATED_TRIANGLE 2

/** The hit is OC_HIT_LOD: `position` and `normal` are those of the hit, all other members are 0. */
#define OC_EVALUATED_STAND_IN 3

/**
 * The hit is OC_HIT_MISSING, or with OC_QUERY_NOW the data of its triangle is not in memory. Members as for
 * OC_EVALUATED_STAND_IN.
 */
#define OC_EVALUATED_MISSING 4

/** The side from which the corners appear counter-clockwise. There a ray enters a solid whose triangles face outward. */
#define OC_SIDE_FRONT 1

/** The other side, where a ray leaves such a solid. */
#define OC_SIDE_BACK 2

/** The cursor never reads. A call that needs a block which is not in memory returns OC_STATUS_MISSING. */
#define OC_CURSOR_NOW 1

/** The part is closed (OC_PART_CLOSED), and the point is inside. */
#define OC_HOLDS_INSIDE 1

/** The part is not closed, and the point is within its bounds: nothing says whether it is inside. */
#define OC_HOLDS_UNDECIDED 2

/** Some of the part is inside the volume or touches it. */
#define OC_OVERLAP_INTERSECTS 1

/** All of the part is inside the volume. */
#define OC_OVERLAP_INSIDE 2

/** One clash for each pair of parts. The default. */
#define OC_CLASH_DETAIL_PARTS 0

/** One clash for each pair of triangles that meet, and one for each pair of parts without such. */
#define OC_CLASH_DETAIL_TRIANGLES 1

/** Pairs in instances of one model. */
#define OC_CLASH_SKIP_SAME_MODEL 1

/** Pairs in one instance. */
#define OC_CLASH_SKIP_SAME_INSTANCE 2

/** Pairs in one instance whose parts have the same parent part, or both have none. */
#define OC_CLASH_SKIP_SAME_PARENT 4

/** Pairs of one model whose parts have equal materials. */
#define OC_CLASH_SKIP_SAME_MATERIAL 8

/**
 * Their surfaces cross. How deep is not known: the tolerance is 0, a part is not closed, or the triangles of both
 * parts do not fit the budget.
 */
#define OC_CLASH_CROSSING 1

/**
 * Their surfaces overlap in a plane, and do not cross. The parts may lie against each other or in one another: that is
 * not known, for the same reasons.
 */
#define OC_CLASH_COPLANAR 2

/**
 * Their surfaces have common points, and do not cross or overlap. With a tolerance: neither closed part reaches deeper
 * into the other than that.
 */
#define OC_CLASH_TOUCHING 3

/** They are apart, and their distance is at most the clearance, within `oc_clash.error`. */
#define OC_CLASH_CLEARANCE 4

/** Both are closed, and one reaches deeper into the other than the tolerance. */
#define OC_CLASH_HARD 5

/**
 * As OC_CLASH_HARD, and one goes through the other, like a rod through a plate: its surface outside of the other is in
 * several pieces. Decided by edges of triangles and their ends.
 */
#define OC_CLASH_PIERCING 6

/**
 * One part is inside of the other, which is closed. With tolerance 0, their surfaces have no point in common. With a
 * tolerance, it is deeper inside than that, and its surface is nowhere farther outside than about that.
 */
#define OC_CLASH_CONTAINED 7

/** With a tolerance: both are closed, and each surface is nowhere farther from the other than about that. */
#define OC_CLASH_DUPLICATE 8

/** The first part is not closed: nothing is known of its inside. */
#define OC_CLASH_OPEN_FIRST 1

/** The second part is not closed. */
#define OC_CLASH_OPEN_SECOND 2

/** Fill `oc_nearest_point.holds`: whether a part of the set holds the point. Not together with OC_NEAREST_NOW. */
#define OC_NEAREST_INSIDE 1

/**
 * Answer at once from the data in memory. The exact distance is within `oc_nearest_point.error` of each answer. The
 * call neither reads nor requests data (oc_scene_prefetch_box does). Without the flag, the call reads all data that it
 * needs, and the answers do not depend on the data in memory.
 */
#define OC_NEAREST_NOW 2

/** From the front, the right and above, all three at the same angle. */
#define OC_VIEW_ISO_FRONT_RIGHT 0

/** From the front, the left and above. */
#define OC_VIEW_ISO_FRONT_LEFT 1

/** From the back, the right and above. */
#define OC_VIEW_ISO_BACK_RIGHT 2

/** From the back, the left and above. */
#define OC_VIEW_ISO_BACK_LEFT 3

/** From the front. */
#define OC_VIEW_FRONT 4

/** From the back. */
#define OC_VIEW_BACK 5

/** From the left. */
#define OC_VIEW_LEFT 6

/** From the right. */
#define OC_VIEW_RIGHT 7

/** From above. The back is up in the picture. */
#define OC_VIEW_TOP 8

/** From below. The front is up in the picture. */
#define OC_VIEW_BOTTOM 9

/** Along `direction` of oc_fit. */
#define OC_VIEW_ALONG 10

/**
 * If the data of the picture does not fit the memory budget at once, the request ends with the picture that does, as
 * OC_STATE_COMPLETE_WITHIN_BUDGET. That picture has one threshold, `effective_poe`, and may be coarser in places than
 * those before. The threshold may depend on earlier views. Without this flag the request goes on until the picture is
 * as requested, whatever was seen before.
 */
#define OC_FRAME_AT_ONCE 1

/**
 * Each value in OC_BUFFER_COLOUR_SRGB8 is the level nearest to that in OC_BUFFER_COLOUR_LINEAR times `exposure`.
 * Without this flag:
 * - Linear values of surfaces above 0.8 are compressed so that they stay below white, and bright parts keep their
 *   shading. Values up to 0.8 and backgrounds stay as they are.
 * - Gradients are dithered, so that they have no bands: a value between two levels becomes one or the other, by an
 *   ordered pattern that depends only on the place of the pixel. A colour that is a level stays that level everywhere.
 */
#define OC_FRAME_EXACT_COLOURS 2

/** 4 bytes: red, green and blue in sRGB, and linear alpha. */
#define OC_BUFFER_COLOUR_SRGB8 0

/** 4 floats: linear RGB, not clamped, and alpha. */
#define OC_BUFFER_COLOUR_LINEAR 1

/** 1 float: distance from the eye along the view direction, in world units. Miss: infinity. */
#define OC_BUFFER_DEPTH 2

/** 3 floats: unit geometric normal in world space, on the side of the eye. Miss: 0. */
#define OC_BUFFER_NORMAL 3

/** 1 uint64_t: id of the part. Miss: OC_NO_ID. */
#define OC_BUFFER_PART 4

/**
 * 1 uint64_t: as oc_hit.prim. OC_NO_ID for a miss, for a stand-in, and in early pictures for a triangle whose id is
 * not read yet.
 */
#define OC_BUFFER_PRIM 5

/** 1 uint64_t: id of the instance. Miss: OC_NO_ID. */
#define OC_BUFFER_INSTANCE 6

/** 1 byte: one of the OC_HIT_ constants. */
#define OC_BUFFER_KIND 7

/**
 * 1 float: an original surface lies within this distance of the surface shown, in world units. Infinity if stand-ins
 * have transmitted the ray to a triangle or to the background: an original surface may lie anywhere before it.
 */
#define OC_BUFFER_ERROR 8

/** 3 floats: unit normal in world space with which the surface is shaded, see `oc_hit.shading_normal`. Miss: 0. */
#define OC_BUFFER_SHADING_NORMAL 9

/**
 * 1 uint64_t: number of the place where the mesh of an instance was met, by a triangle or a stand-in, below 2^63; see
 * `oc_hit.occurrence`. oc_scene_get_path returns the ids on the way there. It holds for the commit that the picture
 * shows: after a later commit of the scene it may stand for another place, or for none. Miss: OC_NO_ID.
 */
#define OC_BUFFER_OCCURRENCE 10

/** 2 floats: as oc_hit.uv of the ray through the pixel's centre. Miss: 0. */
#define OC_BUFFER_UV 11

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

/** 2 floats. */
#define OC_FORMAT_F32X2 7

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Returns the version of the library, in the format of OC_HEADER_VERSION.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API uint32_t oc_version(void);

/**
 * Returns the name of a status, e.g. "OC_STATUS_IO", or "unknown status" for an unknown number.
 *
 * The string is a constant. Never NULL.
 * Thread safety: any thread. Cheap.
 */
OC_API const char *oc_status_name(oc_status status);

/**
 * Returns the reason of the calling thread's last failure, in words. A failure is:
 * - a call in this thread that did not return OC_STATUS_OK, or
 * - a poll or wait in this thread that reported work as failed or cancelled, or as OC_STATE_COMPLETE_WITHIN_BUDGET
 *   with an error. The text is then the reason of that work.
 *
 * Never NULL. Empty before the first failure.
 * Ownership: the library owns the string. It is valid until the next failure in this thread.
 * Thread safety: each thread has its own. Cheap.
 */
OC_API
const char *oc_last_error(void);

/**
 * Returns the least budget in bytes that suffices, if the failure that oc_last_error describes is
 * OC_STATUS_OVER_BUDGET. Otherwise returns 0.
 *
 * Thread safety: each thread has its own. Cheap.
 */
OC_API uint64_t oc_last_error_need(void);

/**
 * Zeroes a struct that begins with `struct_size`, and sets that member to `size`. The macro OC_INIT calls it.
 *
 * - `object`: a struct of this header. NULL: the call does nothing.
 * - `size`: its size in bytes. Below 4: the call does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
void oc_init(void *object,
             size_t size);

/**
 * Returns the progress of a job.
 *
 * - `out_progress`: receives the progress. Initialise it with OC_INIT.
 *
 * If the job has failed or was cancelled, oc_last_error of this thread returns the reason.
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_poll(const struct oc_job *job, struct oc_progress *out_progress);

/**
 * Waits until a job has ended, and until its wake function has returned if another thread is calling it. Then the
 * `user` of the wake function may be freed.
 *
 * - `timeout_ms`: longest time to wait, in milliseconds. OC_FOREVER: no limit. A timeout is not a failure: the state
 *   is then OC_STATE_RUNNING.
 * - `out_progress`: receives the progress as oc_job_poll does. May be NULL.
 *
 * Thread safety: any thread. Blocks. In a context without threads and without an executor this call does the work. It
 * then completes a build or load even if the timeout is shorter.
 */
OC_API
oc_status oc_job_wait(const struct oc_job *job,
                      uint32_t timeout_ms,
                      struct oc_progress *out_progress);

/**
 * Asks a job to end. It ends within about 100 ms. A job that has ended does not change.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_cancel(const struct oc_job *job);

/**
 * Registers a function that is called once, when the job ends. If the job has ended already, this call itself calls
 * the function. An earlier function is replaced.
 *
 * - `wake`: the function. NULL: none.
 * - `user`: passed to `wake`. It must stay valid until `wake` has returned, or until `wake` is replaced before it was
 *   called.
 *
 * `wake` may release the job. The job has ended then, and its arrays belong to the caller again.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_job_set_wake(const struct oc_job *job,
                          oc_wake_fn wake,
                          void *user);

/**
 * Returns the model that a job of oc_model_load has opened.
 *
 * - `out_model`: receives the model.
 *
 * Errors:
 * - OC_STATUS_INVALID_STATE: the load is not done, or failed.
 * - OC_STATUS_INVALID_STATE or OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
 *
 * Ownership: the caller receives one reference to the model.
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_model(const struct oc_job *job, struct oc_model **out_model);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_job_retain(struct oc_job *job);

/**
 * Releases one reference. The last release cancels the job. NULL: does nothing.
 *
 * Thread safety: any thread, including the job's own wake function.
 * Batches of rays: blocks until no thread uses the arrays, and until the wake function has returned if another thread
 * is calling it. Other jobs: cheap.
 */
OC_API
void oc_job_release(struct oc_job *job);

/**
 * Creates a context.
 *
 * - `header_version`: OC_HEADER_VERSION. A program and a library of different versions then report an error instead of
 *   crashing.
 * - `desc`: options. NULL: all defaults.
 * - `out_context`: receives the context.
 *
 * Errors:
 * - OC_STATUS_VERSION_MISMATCH: header and library have different versions.
 * - OC_STATUS_INVALID_ARGUMENT: too many threads, or the machine lacks the instruction set, or has less memory than
 *   the budget.
 * - OC_STATUS_IO: a thread cannot be started.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_context_create(uint32_t header_version,
                            const struct oc_context_desc *desc,
                            struct oc_context **out_context);

/**
 * Does one small piece of waiting work in the calling thread, if there is any. A piece of a frame, a prefetch or a
 * batch of rays takes some tens of microseconds to a few milliseconds. In a context without threads a build or a load
 * is one piece.
 *
 * - `out_did`: receives 1 if there was work, else 0. May be NULL.
 *
 * Errors: OC_STATUS_INVALID_STATE inside a read function of a model.
 *
 * Thread safety: any thread. Blocks while it works.
 */
OC_API
oc_status oc_context_step(const struct oc_context *context,
                          uint32_t *out_did);

/**
 * Returns a property.
 *
 * - `property`: one of the OC_PROPERTY_ constants.
 * - `out_value`: receives the value.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if this library does not know the property.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_context_property(const struct oc_context *context,
                              oc_property property,
                              uint64_t *out_value);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_context_retain(struct oc_context *context);

/**
 * Releases one reference. Objects created from the context keep the parts of it that they need; its threads end with
 * the last of these objects. NULL: does nothing.
 *
 * Thread safety: any thread. Blocks until the threads have ended, if nothing else uses the context. A frame or job
 * that was released while it ran uses it for a moment longer.
 */
OC_API
void oc_context_release(struct oc_context *context);

/**
 * Returns the ray through a point of a picture, as frames trace it.
 *
 * - `camera`: initialised with OC_INIT.
 * - `width`, `height`: size of the picture in pixels, above 0.
 * - `x`, `y`: the point in pixels from the top left corner; fractions are allowed, and points outside of the picture.
 *   Must be finite. The centre of pixel (i, j) is (i + 0.5, j + 0.5).
 * - `out_ray`: receives the ray: no limits, all instances, a direction of length 1, and the footprint for 1 pixel of
 *   error. For p pixels multiply `cone_a` and `cone_b` by sqrt(p); for exact answers set them to 0.
 *
 * Single precision limits the direction: if a pixel is narrower than 1/16000 of its distance, as through long lenses,
 * frames use more digits than the ray has.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_camera_ray(const struct oc_camera *camera,
                        uint32_t width,
                        uint32_t height,
                        double x,
                        double y,
                        struct oc_ray *out_ray);

/**
 * Returns the half spaces that contain all that a camera sees within a rectangle of the picture, for
 * oc_scene_overlap_frustum: to select the parts in a rectangle that a user draws, also those behind others.
 *
 * - `camera`: initialised with OC_INIT.
 * - `width`, `height`: size of the picture in pixels, above 0.
 * - `x0`, `y0`, `x1`, `y1`: two opposite corners in pixels from the top left corner of the picture, as for
 *   oc_camera_ray. Must be finite.
 * - `out_planes`: receives 5 half spaces: four sides, and the plane through the eye. There is no far plane.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_camera_frustum(const struct oc_camera *camera,
                            uint32_t width,
                            uint32_t height,
                            double x0,
                            double y0,
                            double x1,
                            double y1,
                            struct oc_plane *out_planes);

/**
 * Creates an empty build.
 *
 * - `desc`: options. NULL: all defaults.
 * - `out_build`: receives the build.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: an option is out of range.
 * - OC_STATUS_OVER_BUDGET: the memory budget of the build is below 32 MiB.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_create(const struct oc_context *context,
                          const struct oc_build_desc *desc,
                          struct oc_build **out_build);

/**
 * Adds a mesh file: PLY, OBJ, STL, glTF, GLB or raw triangles, or one of surfaces: BPT or NURBS faces
 * (`.trimmed_nurbs.json`). The build job reads it and reports its errors, not this call.
 *
 * - `path`: path of the file. The string is copied.
 *
 * Errors: OC_STATUS_INVALID_STATE after oc_build_start.
 *
 * Thread safety: any thread. The order of the calls is the order in the model. Cheap.
 */
OC_API
oc_status oc_build_add_file(struct oc_build *build,
                            const char *path);

/**
 * Begins to build the model and to write it to `path`, in the background.
 *
 * - `path`: path of the model file: a regular file that may be written, or no file yet. The file appears under this
 *   name when the job is done; until then an existing file stays. A job that fails or is cancelled leaves no temporary
 *   file. The new file has the permissions, the group and the owner of the existing one, as far as the process may set
 *   them. If `path` is a symbolic link, the file that it names is replaced, and the link stays.
 * - `out_job`: receives the job. oc_job_build_report returns its statistics.
 *
 * After this call nothing can be added to the build, even if the thread cannot be started.
 *
 * The job runs on a thread that is started for it. With an executor it runs as one task of the executor. In a context
 * with neither threads nor an executor it runs inside oc_job_wait or oc_context_step.
 *
 * Errors:
 * - OC_STATUS_INVALID_STATE: the build was started before.
 * - OC_STATUS_INVALID_ARGUMENT: `path` is one of the input files of the build, by any name or link. Nothing changed.
 *   If it is a file that an input refers to (a material library, a buffer, a texture), the job fails so, and the file
 *   stays as it is.
 * - OC_STATUS_IO: `path` is a folder, a device, a pipe, a socket, a read-only file, or a link that leads to no file
 *   (nothing changed); or the thread cannot be started.
 *
 * Ownership: the caller receives one reference to the job. The build may be released.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_start(struct oc_build *build,
                         const char *path,
                         struct oc_job **out_job);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_build_retain(struct oc_build *build);

/**
 * Releases one reference. A job that was started continues. NULL: does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API void oc_build_release(struct oc_build *build);

/**
 * Adds a material.
 *
 * - `material`: copied.
 * - `out_material`: receives the number of the material: 1, 2, 3, ... (0 is the default material).
 *
 * Errors: OC_STATUS_INVALID_STATE after oc_build_start.
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
 * - `part`: copied.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: the id is taken; the parent or the material was not added.
 * - OC_STATUS_INVALID_STATE: after oc_build_start.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_build_add_part(struct oc_build *build, const struct oc_part *part);

/**
 * Begins a shared mesh. Its triangles are stored once, and instances place it any number of times.
 *
 * - `parts`: number of parts of the mesh, 1 to 2^32 - 2. They are numbered from 0.
 * - `out_mesh`: receives the number of the mesh: 1, 2, 3, ...
 *
 * Errors: OC_STATUS_INVALID_STATE after oc_build_start.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_add_shared_mesh(struct oc_build *build,
                                   uint32_t parts,
                                   uint32_t *out_mesh);

/**
 * Places a shared mesh.
 *
 * - `mesh`: number of the mesh.
 * - `first_part`: id of the part that part 0 of the mesh becomes here. Part 1 becomes the part that was added next
 *   after it, and so on.
 * - `world_from_mesh`: transform of 12 doubles, invertible. NULL: the identity.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: there is no such mesh or part; fewer parts than the mesh has were added from
 *   `first_part` on; the transform is not finite or not invertible.
 * - OC_STATUS_INVALID_STATE: after oc_build_start.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_build_add_instance(struct oc_build *build,
                                uint32_t mesh,
                                uint64_t first_part,
                                const double *world_from_mesh);

/**
 * Adds triangles of one part from the caller's memory. Triangles with NaN or infinite coordinates, and triangles
 * without area, are allowed: the build drops and counts them.
 *
 * - `triangles`: the arrays are copied.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: an index is out of range, the part or mesh was not added, or a count or stride is
 *   wrong. Nothing was added.
 * - OC_STATUS_INVALID_ARGUMENT: the model would hold 2^32 - 1 triangles or more. The first of them may have been
 *   added.
 * - OC_STATUS_INVALID_STATE: after oc_build_start.
 * - OC_STATUS_IO: the temporary file for data above the build's budget cannot be written. The build can then only be
 *   released.
 *
 * Thread safety: any thread. Blocks while it copies.
 */
OC_API
oc_status oc_build_add_triangles(struct oc_build *build,
                                 const struct oc_triangles *triangles);

/**
 * Adds a Catmull-Clark subdivision surface from the caller's memory: the limit surface of its cage, with semi-sharp
 * creases and corners, by the rules of OpenSubdiv 3.5. Edges of more than two faces are allowed, and are sharp.
 *
 * The surface is diced into triangles, without cracks, as finely as oc_build_desc.surface_tolerance or surface_level
 * asks for. Each triangle counts in the ids of primitives. They have the normals of the surface.
 *
 * - `cage`: the arrays are copied.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a face has fewer than three corners, or more than 4096; a vertex has more than 4096
 *   faces or edges; an index is out of range; a crease is on no edge; a sharpness is negative or NaN; a vertex is not
 *   finite, or beyond 1e30; the part or mesh was not added; a count or stride is wrong; a height or coordinate of the
 *   displacement is not finite. The message names the face, edge or vertex, counted from 0. Nothing was added.
 * - OC_STATUS_INVALID_ARGUMENT, OC_STATUS_OVER_LIMIT: the model would hold 2^32 - 1 triangles or more, or more than
 *   oc_build_desc.max_triangles. The first of them may have been added.
 * - OC_STATUS_INVALID_STATE: after oc_build_start.
 * - OC_STATUS_IO: as for oc_build_add_triangles.
 *
 * Memory: the cage, its patches and the map are not in the budget of the build: some hundred bytes for each face, more
 * at faces with irregular vertices or creases.
 * Thread safety: any thread. Blocks while it dices.
 */
OC_API
oc_status oc_build_add_cage(struct oc_build *build,
                            const struct oc_cage *cage);

/**
 * Adds a NURBS surface from the caller's memory.
 *
 * The surface is diced into triangles, without cracks within it, as finely as oc_build_desc.surface_tolerance or
 * surface_level asks for: of each of its Bézier patches. It is closed where its first and last control points are the
 * same. Each triangle counts in the ids of primitives. They have the normals of the surface, at poles their limits.
 *
 * - `surface`: the arrays are copied.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a degree, a knot, a weight, a point or a count is out of its range; the part or mesh
 *   was not added. The message names the argument. Nothing was added.
 * - OC_STATUS_INVALID_ARGUMENT, OC_STATUS_OVER_LIMIT, OC_STATUS_INVALID_STATE, OC_STATUS_IO: as for oc_build_add_cage.
 *
 * Thread safety: any thread. Blocks while it dices.
 */
OC_API
oc_status oc_build_add_nurbs(struct oc_build *build,
                             const struct oc_nurbs *surface);

/**
 * Returns the statistics of a finished build.
 *
 * - `job`: a job of oc_build_start.
 * - `out_report`: receives the statistics. Initialise it with OC_INIT.
 *
 * Errors:
 * - OC_STATUS_INVALID_STATE: the build is not done, or failed.
 * - OC_STATUS_INVALID_STATE or OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_build_report(const struct oc_job *job, struct oc_build_report *out_report);

/**
 * Returns a note of a finished build: a warning about an input that could be read nevertheless.
 *
 * - `job`: a job of oc_build_start.
 * - `index`: number of the note, below `notes` of oc_build_report.
 * - `out_text`: receives the text.
 *
 * Errors: as for oc_job_build_report. OC_STATUS_INVALID_ARGUMENT also if `index` is out of range.
 *
 * Ownership: the job owns the string. It is valid as long as the job.
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_job_build_note(const struct oc_job *job, uint32_t index, const char **out_text);

/**
 * Opens a model file.
 *
 * This call reads the tables, the root blocks and the coarse blocks, and all blocks of a small model: 48 MiB or a
 * quarter of the memory budget at most, whichever is less. Root blocks are read in any case. Other blocks are read
 * when they are used, or in the background if they fit. The model may be larger than the memory budget of the context.
 *
 * - `path`: path of the model file.
 * - `out_model`: receives the model.
 *
 * Errors:
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: the file, or a block that this call reads, is unreadable or damaged. For other
 *   blocks that are, frames show stand-ins.
 * - OC_STATUS_NEWER_FORMAT: a newer version of the library wrote the model.
 * - OC_STATUS_OVER_BUDGET: the data that must stay in memory does not fit the budget. oc_last_error_need returns the
 *   least budget that suffices.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Blocks: reads the disk. oc_model_load does the same in the background.
 */
OC_API
oc_status oc_model_open(const struct oc_context *context,
                        const char *path,
                        struct oc_model **out_model);

/**
 * Opens a model that the caller's own functions read. Otherwise as oc_model_open.
 *
 * - `io`: the functions. The table is copied.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Blocks: calls `read_at`.
 */
OC_API
oc_status oc_model_open_io(const struct oc_context *context,
                           const struct oc_io *io,
                           struct oc_model **out_model);

/**
 * Begins to open a model in the background. When the job is done, oc_job_model returns the model.
 *
 * - `path`: path of the model file. Ignored if `io` is not NULL.
 * - `io`: the caller's own functions that read the model, or NULL. The table is copied.
 * - `out_job`: receives the job. Its progress counts the bytes of blocks read. Its errors are those of oc_model_open.
 *
 * Errors: OC_STATUS_IO if a thread cannot be started.
 *
 * Ownership: the caller receives one reference to the job.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_model_load(const struct oc_context *context,
                        const char *path,
                        const struct oc_io *io,
                        struct oc_job **out_job);

/**
 * Returns the properties of a model.
 *
 * - `out_info`: receives the properties. Initialise it with OC_INIT.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_model_get_info(const struct oc_model *model, struct oc_model_info *out_info);

/**
 * Returns the properties of a part.
 *
 * - `index`: index of the part, below `parts` of oc_model_info.
 * - `out_part`: receives the properties. Initialise it with OC_INIT.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if `index` is out of range.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_model_get_part(const struct oc_model *model,
                            uint32_t index,
                            struct oc_part_info *out_part);

/**
 * Finds a part by its id. If several parts have the id, returns the first.
 *
 * - `id`: id of the part, as passed when the model was built.
 * - `out_index`: receives the index of the part.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if no part has the id.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_model_find_part(const struct oc_model *model, uint64_t id, uint32_t *out_index);

/**
 * Returns a perspective camera that fits the model. oc_scene_fit has more choices.
 *
 * - `view`: 0 and 1 show the whole model from two sides, as large as a square picture allows; wider pictures show it
 *   too. 2 and 3 are closer views from the same sides.
 * - `out_camera`: receives the camera. Initialise it with OC_INIT.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if `view` is above 3.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_model_get_view(const struct oc_model *model,
                            uint32_t view,
                            struct oc_camera *out_camera);

/**
 * Returns the transform that gives the model an up axis and a unit of length, for oc_scene_add_instance. With the same
 * arguments for each model of a scene, all stand upright and have the same scale.
 *
 * - `up`: the up axis of the world: one of the OC_UP_ constants. OC_UP_UNKNOWN: the model is not turned.
 * - `metres_per_unit`: length of a unit of the world in metres, e.g. 0.001 for millimetres; finite and above 0. 0: the
 *   model is not scaled.
 * - `out_world_from_model`: receives 12 doubles. It turns about the model's origin, such that front and right agree
 *   too (see oc_view), and scales.
 * - `out_flags`: receives OC_PLACEMENT_ flags, combined with `|`: what was asked, but the model does not say. May be
 *   NULL.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_model_get_placement(const struct oc_model *model,
                                 oc_up_axis up,
                                 double metres_per_unit,
                                 double *out_world_from_model,
                                 oc_placement_flags *out_flags);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_model_retain(struct oc_model *model);

/**
 * Releases one reference. The last release invalidates the handle; scenes that show the model keep its data. NULL:
 * does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
void oc_model_release(struct oc_model *model);

/**
 * Creates an empty scene with a headlight.
 *
 * - `out_scene`: receives the scene.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_scene_create(const struct oc_context *context, struct oc_scene **out_scene);

/**
 * Adds a model to the scene as an instance. Takes effect at oc_scene_commit.
 *
 * - `model`: a model of the same context.
 * - `id`: the caller's own id. Must be unique in the scene and not OC_NO_ID.
 * - `world_from_model`: transform of 12 doubles, finite and invertible. NULL: the identity.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented; OC_STATUS_OVER_BUDGET if the budget has no
 * room for another instance.
 *
 * Ownership: the scene keeps the model alive.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_add_instance(struct oc_scene *scene,
                                const struct oc_model *model,
                                uint64_t id,
                                const double *world_from_model);

/**
 * Removes an instance. Takes effect at oc_scene_commit.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_scene_remove_instance(struct oc_scene *scene, uint64_t id);

/**
 * Replaces the transform of an instance. Takes effect at oc_scene_commit.
 *
 * - `id`: id of the instance.
 * - `world_from_model`: as for oc_scene_add_instance.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`, or the transform is not invertible.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_transform(struct oc_scene *scene,
                                 uint64_t id,
                                 const double *world_from_model);

/**
 * Sets the mask of an instance. Takes effect at oc_scene_commit.
 *
 * - `id`: id of the instance.
 * - `mask`: a ray of a batch can hit the instance only if its mask has a common bit with this one. Initially all bits
 *   are set.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_instance_mask(struct oc_scene *scene,
                                     uint64_t id,
                                     uint32_t mask);

/**
 * Replaces all lights. Takes effect at oc_scene_commit. Without lights only the ambient light of the frame remains.
 *
 * - `lights`: array of lights. Ignored if `count` is 0.
 * - `count`: number of lights, at most 65536.
 * - `stride`: bytes from one light to the next. 0: tightly packed.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if a light is not as documented. No light is replaced.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_lights(struct oc_scene *scene,
                              const struct oc_light *lights,
                              uint64_t count,
                              uint64_t stride);

/**
 * Replaces the background. Takes effect at oc_scene_commit.
 *
 * - `background`: the new background. NULL: the initial grey one.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if a number is not as documented.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_background(struct oc_scene *scene,
                                  const struct oc_background *background);

/**
 * Makes all edits since the last commit take effect at once, for frames, batches and other queries that begin later.
 *
 * Placed meshes, instances and looks of parts count against the budget, but for 80 KiB of each scene.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if the scene would hold 2^31 or more placed meshes or instances of its own, or
 * 2^63 with those in scenes in it, scenes in scenes at more than 64 levels, or transforms that are singular or nearly
 * so together; OC_STATUS_OVER_BUDGET if the budget has no room for them beside the data that must stay. Later jobs
 * then see the scene as it was before.
 *
 * Thread safety: any thread. Cheap. Takes time in proportion to the number of instances, or of those that have moved:
 * see oc_scene_set_transforms.
 */
OC_API
oc_status oc_scene_commit(struct oc_scene *scene);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_scene_retain(struct oc_scene *scene);

/**
 * Releases one reference. Frames and batches in flight keep the data that they need. NULL: does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
void oc_scene_release(struct oc_scene *scene);

/**
 * Adds many instances of a few models or scenes at once. Takes effect at oc_scene_commit.
 *
 * The arrays are copied: 96 bytes for an affine transform in doubles, 48 for the other forms, 4 for an index of a
 * prototype, and 4 for a mask or a tint, unless 512 in a row have all bits or no tint. A commit adds some 60 to 77
 * bytes for each mesh that is placed, or for each member that is a scene, for the tree over all of them, 16 more if a
 * transform stretches or scenes differ in the number of meshes in them, and 250 while it runs. The members of the
 * array are instances like those of oc_scene_add_instance, but none can be removed alone or given another model, and
 * one with an oc_place takes another place (oc_scene_set_transforms), but no matrix. A mask or a look that is set for
 * one of them takes memory for that one.
 *
 * - `instances`: models or scenes, transforms and ids.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if a member is not as documented: the message names the first instance that is
 * wrong; OC_STATUS_OVER_BUDGET if the budget has no room for the array. Nothing is then added.
 *
 * Ownership: the scene keeps the models and scenes alive; the arrays are not used after the call.
 * Thread safety: any thread. Takes time in proportion to the number of instances.
 */
OC_API
oc_status oc_scene_add_instances(struct oc_scene *scene,
                                 const struct oc_instances *instances);

/**
 * Moves instances of an array. Takes effect at oc_scene_commit.
 *
 * - `first_id`: id of the first; each further one has the next higher id. All are of one array.
 * - `form`: that of the array's transforms.
 * - `transforms`: the new transforms, as in oc_instances.
 * - `count`: number of transforms.
 * - `stride`: bytes from one transform to the next. 0: tightly packed.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented: the message names the first transform that
 * is wrong; OC_STATUS_OVER_BUDGET if the budget has no room for copies of the parts of the array that change, because
 * jobs in flight and the last commit need them as they are. Nothing has then moved.
 *
 * Thread safety: any thread. Takes time in proportion to `count`. So does the commit, if nothing else was moved, added
 * or removed, and no more than an eighth of the meshes have moved since a commit placed all.
 */
OC_API
oc_status oc_scene_set_transforms(struct oc_scene *scene,
                                  uint64_t first_id,
                                  oc_transform_form form,
                                  const void *transforms,
                                  uint64_t count,
                                  uint64_t stride);

/**
 * Replaces the masks of instances of an array. Takes effect at oc_scene_commit.
 *
 * - `first_id`: id of the first; each further one has the next higher id. All are of one array.
 * - `masks`: the new masks, as in oc_instances. They replace those of oc_scene_set_instance_mask too, and that call
 *   replaces the mask of the array with that of the instance.
 * - `count`: number of masks.
 * - `stride`: bytes from one mask to the next. 0: tightly packed.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented; OC_STATUS_OVER_BUDGET if the budget has no
 * room for copies of the parts of the array that change. No mask has then changed.
 *
 * Thread safety: any thread. Takes time in proportion to `count`; the commit as after oc_scene_set_transforms, where
 * instances with new masks count as moved.
 */
OC_API
oc_status oc_scene_set_masks(struct oc_scene *scene,
                             uint64_t first_id,
                             const uint32_t *masks,
                             uint64_t count,
                             uint64_t stride);

/**
 * Replaces the tints of instances of an array. Takes effect at oc_scene_commit.
 *
 * - `first_id`: id of the first; each further one has the next higher id. All are of one array.
 * - `tints`: the new tints, 4 bytes each, as in oc_instances.
 * - `count`: number of tints.
 * - `stride`: bytes from one tint to the next. 0: tightly packed.
 *
 * Errors: as oc_scene_set_masks.
 *
 * Thread safety: any thread. Takes time as oc_scene_set_masks does.
 */
OC_API
oc_status oc_scene_set_tints(struct oc_scene *scene,
                             uint64_t first_id,
                             const uint8_t *tints,
                             uint64_t count,
                             uint64_t stride);

/**
 * Removes all instances that one call of oc_scene_add_instances added. Takes effect at oc_scene_commit.
 *
 * - `first_id`: id of the first of them.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if no call added instances from that id on.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_remove_instances(struct oc_scene *scene,
                                    uint64_t first_id);

/**
 * Adds a scene to a scene as an instance. Takes effect at oc_scene_commit.
 *
 * Each commit of `scene` takes `inner` as it was committed last. Its lights and its background are left out. Scenes
 * may be in scenes, up to 64 levels, and one scene any number of times: it takes some 700 bytes each time, however
 * much is in it, and less in arrays (oc_scene_add_instances). The mask and the look of the instance apply to all in
 * it: colours that `inner` sets have precedence. Its parts have looks in `inner` only.
 *
 * - `inner`: another scene of the same context.
 * - `id`: the caller's own id. Must be unique in the scene and not OC_NO_ID. Hits return it as their instance.
 * - `world_from_inner`: transform of 12 doubles, finite and invertible. NULL: the identity.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if an argument is not as documented, or `inner` is or holds `scene`.
 *
 * Ownership: `scene` keeps `inner` alive.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_add_scene(struct oc_scene *scene,
                             const struct oc_scene *inner,
                             uint64_t id,
                             const double *world_from_inner);

/**
 * Sets the look of one occurrence of an instance: of the instance in one place of the scene that it is in, such as one
 * tree of a part of a forest that is there many times. Takes effect at oc_scene_commit.
 *
 * The look applies to all parts of the instance in that place, and to no other place of it. Its colour has precedence
 * over those of the instance and of the scenes around it, but not over those of parts. What one of these hides or
 * highlights stays so. The ids on the way to the instance (oc_scene_get_path) are remembered: later commits keep the
 * look as long as they lead to an instance. For an instance that is in no other scene it is that of
 * oc_scene_set_instance_look.
 *
 * - `occurrence`: `oc_hit.occurrence` of a hit since the last commit, or a value of OC_BUFFER_OCCURRENCE in a picture
 *   that was requested since then.
 * - `look`: the look. NULL, or one that changes nothing, removes it.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if the scene has no such occurrence, or a flag or colour is not as documented;
 * OC_STATUS_OVER_BUDGET if the budget has no room for another look, some 300 bytes.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_occurrence_look(struct oc_scene *scene,
                                       uint64_t occurrence,
                                       const struct oc_look *look);

/**
 * Returns the way to what a hit met: the ids of the instances from the outermost to the innermost. An instance that is
 * in no other scene has one.
 *
 * - `occurrence`: `oc_hit.occurrence` of a hit since the last commit, or a value of OC_BUFFER_OCCURRENCE in a picture
 *   that was requested since then.
 * - `out_ids`: receives the ids. NULL if `capacity` is 0.
 * - `capacity`: number of ids that `out_ids` has room for.
 * - `out_count`: receives the number of ids, also with OC_STATUS_BUFFER_TOO_SMALL.
 * - `out_world_from_model`: receives 12 doubles, the transform of the innermost instance to the world. NULL: ignored.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if the scene has no such occurrence; OC_STATUS_BUFFER_TOO_SMALL if
 * `capacity` is not 0 and below the number of ids.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_get_path(const struct oc_scene *scene,
                            uint64_t occurrence,
                            uint64_t *out_ids,
                            uint64_t capacity,
                            uint64_t *out_count,
                            double *out_world_from_model);

/**
 * Saves what the last commit has in a scene file, which oc_scene_open opens.
 *
 * The file holds the instances, arrays and scenes in scenes with their ids, transforms, masks and looks, and the
 * lights and the background of the scene. A single instance takes 112 bytes; a member of an array 96, 48 or 44 for the
 * forms OC_TRANSFORM_AFFINE_F64, OC_TRANSFORM_AFFINE_F32 and OC_TRANSFORM_PLACE, and 4 for an index of a prototype. A
 * scene that is in several places takes its bytes once. Models stay in their own files, which the scene file names by
 * their paths, relative to its own folder.
 *
 * - `path`: path of the scene file. A file of this name is replaced once the new one is complete.
 *
 * Errors:
 * - OC_STATUS_INVALID_STATE: something cannot be saved; the message names it. This is a model that was not opened from
 *   a path or whose file was replaced since then, a path that is no text in UTF-8, a look of parts, or a look of one
 *   occurrence.
 * - OC_STATUS_INVALID_ARGUMENT: `path` is the file of a model of the scene.
 * - OC_STATUS_IO: the file cannot be written.
 *
 * No file is then written, and an older one stays.
 *
 * Thread safety: any thread. Blocks: writes the disk.
 */
OC_API
oc_status oc_scene_save(const struct oc_scene *scene,
                        const char *path);

/**
 * Opens a scene file, and the models that it names.
 *
 * The scene is committed, and can be edited like any other. Scenes in it stay as they were saved: there are no handles
 * of them. The memory budget of the context counts the scene and its models as if they had been made by other calls,
 * and some kilobytes for each scene in it, which other calls do not count.
 *
 * - `path`: path of the scene file.
 * - `out_scene`: receives the scene.
 *
 * Errors:
 * - OC_STATUS_CORRUPT: the file is damaged or is no scene file, or a model is not the file that the scene was saved
 *   with; the message names the file and the place in it.
 * - OC_STATUS_NEWER_FORMAT: a newer version of the library wrote the file.
 * - OC_STATUS_IO: the file or a model cannot be read.
 * - OC_STATUS_OVER_BUDGET: the budget has no room for the scene or a model. oc_last_error_need returns the least
 *   budget that suffices for what failed.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Blocks: reads the disk, as oc_model_open does for each model.
 */
OC_API
oc_status oc_scene_open(const struct oc_context *context,
                        const char *path,
                        struct oc_scene **out_scene);

/**
 * Sets the look of an instance. Takes effect at oc_scene_commit.
 *
 * - `id`: id of the instance.
 * - `look`: the new look. NULL: unchanged appearance.
 *
 * A part is hidden or highlighted if its own look or that of its instance says so. The colour of its own look
 * overrides that of its instance.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no instance `id`, or a flag or colour is not as documented.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_set_instance_look(struct oc_scene *scene,
                                     uint64_t id,
                                     const struct oc_look *look);

/**
 * Sets the look of a part of an instance. Its child parts do not change. Takes effect at oc_scene_commit.
 *
 * - `instance`: id of the instance.
 * - `part`: id of the part. If several parts of the model have this id, the first is meant.
 * - `look`: the new look. NULL: unchanged appearance.
 *
 * The call is oc_scene_set_parts_look for one part.
 *
 * Errors: as oc_scene_set_parts_look.
 *
 * Thread safety: any thread. Blocks as oc_scene_set_parts_look does.
 */
OC_API
oc_status oc_scene_set_part_look(struct oc_scene *scene,
                                 uint64_t instance,
                                 uint64_t part,
                                 const struct oc_look *look);

/**
 * Sets the look of many parts of an instance. Takes effect at oc_scene_commit.
 *
 * - `instance`: id of the instance.
 * - `parts`: array of ids of parts. If several parts of the model have an id, the first is meant. Ignored if `count`
 *   is 0.
 * - `flags`: OC_PARTS_ flags, combined with `|`, or 0.
 * - `look`: the new look. NULL: unchanged appearance.
 *
 * What hides parts does not make a frame read more: blocks of hidden parts alone are not read, and a stand-in never
 * shows a hidden part, nor a part in another colour than its look's. The first call that hides a part of a model reads
 * the list of parts of each block from the file, some bytes for each block and part in it. These lists then stay in
 * memory and count against the budget.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no such instance or part, or a flag or colour is not as documented;
 * OC_STATUS_OVER_BUDGET, OC_STATUS_IO, OC_STATUS_CORRUPT and OC_STATUS_OUT_OF_MEMORY for the lists of parts. After an
 * error no look has changed.
 *
 * Thread safety: any thread. Blocks while it reads; otherwise cheap.
 */
OC_API
oc_status oc_scene_set_parts_look(struct oc_scene *scene,
                                  uint64_t instance,
                                  const uint64_t *parts,
                                  uint64_t count,
                                  oc_parts_flags flags,
                                  const struct oc_look *look);

/**
 * Hides all parts of an instance but the given ones, and shows these. Colours and highlights do not change. Takes
 * effect at oc_scene_commit. oc_scene_clear_part_looks shows all parts again.
 *
 * - `instance`: id of the instance.
 * - `parts`: array of ids of parts. If several parts of the model have an id, the first is meant. Ignored if `count`
 *   is 0: all parts are then hidden.
 * - `flags`: OC_PARTS_ flags, combined with `|`, or 0.
 *
 * Errors: as oc_scene_set_parts_look.
 *
 * Thread safety: any thread. Blocks as oc_scene_set_parts_look does.
 */
OC_API
oc_status oc_scene_isolate(struct oc_scene *scene,
                           uint64_t instance,
                           const uint64_t *parts,
                           uint64_t count,
                           oc_parts_flags flags);

/**
 * Exchanges the model of an instance, for example after the model was built anew and opened. Takes effect at
 * oc_scene_commit.
 *
 * - `instance`: id of the instance. It keeps its transform, mask and look.
 * - `model`: the new model, of the same context. The scene keeps it alive, and releases the old one once no frame or
 *   batch uses it.
 *
 * Each part keeps the look of the part with the same id in the old model. Looks of parts that the new model lacks are
 * lost.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no such instance or the model belongs to another context;
 * OC_STATUS_INVALID_STATE if another thread edits the looks of the instance at the same time; those of
 * oc_scene_set_parts_look if parts are hidden. After an error nothing has changed.
 *
 * Thread safety: any thread. Blocks as oc_scene_set_parts_look does.
 */
OC_API
oc_status oc_scene_set_model(struct oc_scene *scene,
                             uint64_t instance,
                             const struct oc_model *model);

/**
 * Removes the looks of all parts of an instance. Takes effect at oc_scene_commit.
 *
 * - `instance`: id of the instance.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no such instance.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_scene_clear_part_looks(struct oc_scene *scene, uint64_t instance);

/**
 * Finds the closest hit of each ray in the committed scene.
 *
 * - `query`: the rays and options. Initialise it with OC_INIT.
 * - `out_hits`: receives one hit for each ray. Do not use it if the call fails.
 * - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
 *
 * Errors: OC_STATUS_IO, OC_STATUS_CORRUPT if a block of the model cannot be read.
 *
 * Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_closest(const struct oc_scene *scene,
                           const struct oc_query *query,
                           struct oc_hit *out_hits,
                           uint64_t hit_stride);

/**
 * Tests whether each ray hits anything in the committed scene. Faster than oc_scene_closest.
 *
 * - `query`: the rays and options. `want` has no effect, but must be valid.
 * - `out_any`: receives one byte for each ray: 1 for a hit, 0 for none. Do not use it if the call fails.
 * - `any_stride`: bytes from one answer to the next. 0: tightly packed.
 *
 * With OC_QUERY_NOW, 1 also means that the missing data may contain a hit. With a footprint, 0 also means that
 * stand-ins transmitted the ray.
 *
 * On a long thin triangle that the ray meets edge-on, the distance may have an error that is greater than its last
 * digits in single precision. Such a hit may count here, while oc_scene_closest, which computes positions and errors
 * in double precision, finds it outside of the interval.
 *
 * Errors: as for oc_scene_closest.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_any(const struct oc_scene *scene,
                       const struct oc_query *query,
                       uint8_t *out_any,
                       uint64_t any_stride);

/**
 * Begins oc_scene_closest in the background.
 *
 * - `query`, `out_hits`, `hit_stride`: as for oc_scene_closest. The arrays of rays and hits must stay valid and
 *   unchanged until the job has ended. The struct `query` is copied.
 * - `out_job`: receives the job. Use the hits only after OC_STATE_DONE.
 *
 * Ownership: the caller receives one reference to the job.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_closest_start(const struct oc_scene *scene,
                                 const struct oc_query *query,
                                 struct oc_hit *out_hits,
                                 uint64_t hit_stride,
                                 struct oc_job **out_job);

/**
 * Begins oc_scene_any in the background.
 *
 * - `query`, `out_any`, `any_stride`: as for oc_scene_any. The arrays of rays and answers must stay valid and
 *   unchanged until the job has ended. The struct `query` is copied.
 * - `out_job`: receives the job. Use the answers only after OC_STATE_DONE.
 *
 * Ownership: the caller receives one reference to the job.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_any_start(const struct oc_scene *scene,
                             const struct oc_query *query,
                             uint8_t *out_any,
                             uint64_t any_stride,
                             struct oc_job **out_job);

/**
 * Finds the closest hit of each ray in the committed scene, as oc_scene_closest does, for rays in single precision.
 * The hits are those of oc_scene_closest, rounded. A ray takes 32 bytes instead of 64, a hit 40 instead of 104.
 *
 * - `query`: the rays and options. Initialise it with OC_INIT.
 * - `out_hits`: receives one hit for each ray. Must not overlap the rays. Do not use it if the call fails.
 * - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
 *
 * Errors: as for oc_scene_closest.
 *
 * Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_closest_f32(const struct oc_scene *scene,
                               const struct oc_query_f32 *query,
                               struct oc_hit_f32 *out_hits,
                               uint64_t hit_stride);

/**
 * Tests whether each ray hits anything in the committed scene, as oc_scene_any does, for rays in single precision.
 *
 * - `query`: the rays and options. `want` has no effect, but must be valid.
 * - `out_any`, `any_stride`: as for oc_scene_any. Must not overlap the rays.
 *
 * Errors: as for oc_scene_closest.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_any_f32(const struct oc_scene *scene,
                           const struct oc_query_f32 *query,
                           uint8_t *out_any,
                           uint64_t any_stride);

/**
 * Begins to read the triangles of a part, for example to export it, or to snap to its corners.
 *
 * Triangles of parts below it are not included. Each triangle comes once, also if several leaves refer to it, in an
 * order that depends on nothing but the file. If the part is in a shared mesh, its triangles are placed as they are in
 * the model.
 *
 * - `part`: the id of the part, as passed when the model was built.
 * - `out_reader`: receives the reader. It keeps the model alive.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: the model has no such part.
 * - OC_STATUS_OVER_BUDGET: the lists of parts do not fit the budget, nor, in a model whose triangles several leaves
 *   may refer to, one bit for each triangle of its input.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: the lists of parts cannot be read.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_model_read_part(const struct oc_model *model,
                             uint64_t part,
                             struct oc_part_reader **out_reader);

/**
 * Reads the next triangles of a part.
 *
 * - `out_triangles`: receives the triangles, tightly packed.
 * - `capacity`: greatest number of triangles to read, above 0.
 * - `out_count`: receives the number of triangles. 0: there are no more.
 *
 * Memory: one block of the model at a time, some 600 KB at most, whatever the size of the part.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: `capacity` is 0.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: a block cannot be read. The next call tries it again.
 *
 * Thread safety: any thread, one at a time. Blocks; may read the disk.
 */
OC_API
oc_status oc_part_reader_next(struct oc_part_reader *reader,
                              struct oc_triangle *out_triangles,
                              uint64_t capacity,
                              uint64_t *out_count);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_part_reader_retain(struct oc_part_reader *reader);

/** Releases one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_part_reader_release(struct oc_part_reader *reader);

/**
 * Returns the triangles of hits, in world space: to snap to corners and edges, or to highlight what was picked.
 *
 * - `hits`: hits of oc_scene_closest or oc_frame_pick in this scene, exact ones with `position`, `part`, `instance`
 *   and `prim`.
 * - `count`: number of hits.
 * - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
 * - `out_triangles`: receives one triangle for each hit, tightly packed. Do not use it if the call fails.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a hit has not all of these members, or no triangle of the committed scene has its ids
 *   at its position. The message names its number.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: a block cannot be read.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_triangles(const struct oc_scene *scene,
                             const struct oc_hit *hits,
                             uint64_t count,
                             uint64_t hit_stride,
                             struct oc_triangle *out_triangles);

/**
 * Evaluates the surfaces at hits, in world space: for deferred shading, for texture footprints, or to show how a
 * surface bends under the cursor.
 *
 * - `hits`: hits of oc_scene_closest or oc_frame_pick in this scene. Those of kind OC_HIT_EXACT need `position`,
 *   `part`, `instance` and `prim`; with `occurrence` they are found sooner, and on the right one of coincident
 *   meshes. Stand-ins and misses may be among them.
 * - `count`: number of hits.
 * - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
 * - `flags`: 0, or OC_QUERY_NOW: the call answers from the data in memory; it neither waits nor reads.
 * - `out_points`: receives one point for each hit. Do not use it if the call fails.
 * - `point_stride`: bytes from one point to the next. 0: tightly packed.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: an exact hit has not all of these members, or no triangle of the committed scene has
 *   its ids at its position, for instance after a commit that moved it. A hit has an unknown kind; a flag is unknown.
 *   The message names the hit's number.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: a block cannot be read.
 *
 * Performance: what is in memory is evaluated by all threads of the context. Hits whose data must be read are
 * evaluated one by one.
 *
 * Thread safety: any thread. Blocks; may read the disk without OC_QUERY_NOW.
 */
OC_API
oc_status oc_scene_evaluate(const struct oc_scene *scene,
                            const struct oc_hit *hits,
                            uint64_t count,
                            uint64_t hit_stride,
                            oc_query_flags flags,
                            struct oc_surface_point *out_points,
                            uint64_t point_stride);

/**
 * Finds all surfaces that rays cross, in order: nearest first, and at equal `t` by part, instance and `prim`.
 *
 * Coincident surfaces are all found. An edge or a corner that triangles of a closed surface share counts once, decided
 * without any tolerance: the ray goes as often into the surface as out of it if it begins and ends outside. At a
 * silhouette that the ray touches, it crosses the surface twice or not at all. Triangles parallel to the ray are not
 * crossed.
 *
 * - `query`: the rays and options. Initialise it with OC_INIT. `want` has no effect, but must be valid. Hidden parts,
 *   masks and bad rays are treated as by oc_scene_closest. Footprints are ignored: crossings are those of original
 *   triangles.
 * - `out_crossings`: receives the crossings of the first ray, then those of the second, and so on.
 * - `capacity`: number of elements that `out_crossings` has room for. 0: only `out_ends`, `out_complete` and
 *   `out_count` are written, `out_crossings` is ignored.
 * - `out_ends`: receives, for each ray, the number of crossings of all rays up to and including this one. The
 *   crossings of ray i are those from `out_ends[i - 1]` (0 for the first ray) to `out_ends[i]`, without the last.
 * - `out_complete`: receives one byte for each ray: 1 if its crossings are all, 0 if data was missing, which happens
 *   only with OC_QUERY_NOW. May be NULL.
 * - `out_count`: receives the number of all crossings.
 *
 * Errors:
 * - OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of crossings. `out_ends`, `out_complete` and
 *   `out_count` are written all the same; do not use `out_crossings`.
 * - OC_STATUS_OVER_BUDGET: the crossings of a single ray take more than a quarter of the context's budget.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
 *
 * Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_crossings(const struct oc_scene *scene,
                             const struct oc_query *query,
                             struct oc_crossing *out_crossings,
                             uint64_t capacity,
                             uint64_t *out_ends,
                             uint8_t *out_complete,
                             uint64_t *out_count);

/**
 * Makes a cursor over a model.
 *
 * Blocks in memory are used where they are, without a lock; the cursor does not keep them there. Other blocks are read
 * by the calling thread into memory of the cursor's own, which drops those that were not used for longest. They are
 * neither those of frames and queries, nor of other cursors. For fast walks call oc_model_load or oc_scene_prefetch
 * first.
 *
 * - `flags`: OC_CURSOR_ flags, combined with `|`.
 * - `bytes`: size of that memory, of the budget of the context. 0: 4 MiB. Not used with OC_CURSOR_NOW.
 * - `out_cursor`: receives the cursor. It keeps the model alive.
 *
 * Memory: `bytes`, and 272 KiB, of the budget.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: `flags` are unknown, or `bytes` are not 0 and too few to read a block. The message
 *   names the least number.
 * - OC_STATUS_OVER_BUDGET: the budget of the context has less. oc_last_error_need returns the least budget that
 *   suffices.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Makes room in the budget, for which it may wait until frames give up what they use.
 */
OC_API
oc_status oc_cursor_create(const struct oc_model *model,
                           oc_cursor_flags flags,
                           uint64_t bytes,
                           struct oc_cursor **out_cursor);

/**
 * Returns the root of a tree. For a model without instances of its own, tree 0 is all of it.
 *
 * - `tree`: index of the tree.
 * - `out_node`: receives the id of the root. OC_NO_ID: the tree has no triangles.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if there is no such tree.
 *
 * Thread safety: any thread, one at a time. Cheap.
 */
OC_API oc_status oc_cursor_root(struct oc_cursor *cursor, uint32_t tree, uint64_t *out_node);

/**
 * Returns the places of all trees with triangles in the model: where walks of the whole model begin.
 *
 * - `out_places`: receives the places, tightly packed.
 * - `capacity`: number of elements that `out_places` has room for. 0: only the count is written, `out_places` is
 *   ignored.
 * - `out_count`: receives the number of places, also with OC_STATUS_BUFFER_TOO_SMALL.
 *
 * Errors: OC_STATUS_BUFFER_TOO_SMALL if `capacity` is not 0 and below the number of places.
 *
 * Thread safety: any thread, one at a time. Cheap: reads nothing.
 */
OC_API
oc_status oc_cursor_places(struct oc_cursor *cursor,
                           struct oc_tree_place *out_places,
                           uint64_t capacity,
                           uint64_t *out_count);

/**
 * Returns a node, with the ids and boxes of its children.
 *
 * - `node`: id of the node. Any number may be passed.
 * - `out_node`: receives the node. Initialise it with OC_INIT.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: no node of the model has the id.
 * - OC_STATUS_MISSING: with OC_CURSOR_NOW, the block is not in memory.
 * - OC_STATUS_INVALID_STATE: another thread uses the cursor now.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: the block cannot be read.
 *
 * Thread safety: any thread, one at a time. Cheap if the block is in memory, or with OC_CURSOR_NOW; otherwise reads
 * the disk.
 */
OC_API
oc_status oc_cursor_node(struct oc_cursor *cursor,
                         uint64_t node,
                         struct oc_node *out_node);

/**
 * Returns the triangles of a leaf.
 *
 * - `node`: id of a leaf. Any number may be passed.
 * - `with_prims`: 1: `prim` of the triangles is filled. It is in a block of its own. 0: it is OC_NO_ID.
 * - `out_triangles`: receives the triangles, tightly packed.
 * - `capacity`: number of elements that `out_triangles` has room for; 64 always suffices. 0: only the count is
 *   written, `out_triangles` is ignored.
 * - `out_count`: receives the number of triangles, also with OC_STATUS_BUFFER_TOO_SMALL.
 *
 * A triangle may be in several leaves, see `splits` of oc_build_desc.
 *
 * Errors: as for oc_cursor_node. OC_STATUS_INVALID_ARGUMENT also if the node has children, or `with_prims` is above 1.
 * OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of triangles.
 *
 * Thread safety: as for oc_cursor_node.
 */
OC_API
oc_status oc_cursor_triangles(struct oc_cursor *cursor,
                              uint64_t node,
                              uint32_t with_prims,
                              struct oc_node_triangle *out_triangles,
                              uint64_t capacity,
                              uint64_t *out_count);

/**
 * Returns the ids of all nodes of a block, leaves included. All blocks together have each node of the model once.
 *
 * - `block`: number of the block, below `blocks` of oc_model_info.
 * - `out_nodes`: receives the ids, tightly packed.
 * - `capacity`: number of elements that `out_nodes` has room for; 16384 always suffices. 0: only the count is written,
 *   `out_nodes` is ignored.
 * - `out_count`: receives the number of nodes, also with OC_STATUS_BUFFER_TOO_SMALL.
 *
 * Errors: as for oc_cursor_node. OC_STATUS_INVALID_ARGUMENT if there is no such block. OC_STATUS_BUFFER_TOO_SMALL:
 * `capacity` is not 0 and below the number of nodes.
 *
 * Thread safety: as for oc_cursor_node.
 */
OC_API
oc_status oc_cursor_block_nodes(struct oc_cursor *cursor,
                                uint32_t block,
                                uint64_t *out_nodes,
                                uint64_t capacity,
                                uint64_t *out_count);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_cursor_retain(struct oc_cursor *cursor);

/** Releases one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_cursor_release(struct oc_cursor *cursor);

/**
 * Finds the visible parts that hold points.
 *
 * A ray from the point decides. A part with OC_PART_ORIENTED holds the point if the ray leaves the part more often or
 * less often than it enters it. A part with OC_PART_CLOSED alone holds the point if the ray crosses it an odd number
 * of times. A part without these flags is reported as OC_HOLDS_UNDECIDED if the point is within its bounds. A point
 * nearer to a surface than rounding may be counted on either side. No part holds a point that is not finite.
 *
 * - `points`: 3 doubles each, world space.
 * - `count`: number of points.
 * - `stride`: bytes from one point to the next. 0: tightly packed.
 * - `out_parts`: receives the parts of the first point, then those of the second, and so on. The parts of a point are
 *   ordered by instance (in the order added), then by part (in the model's order).
 * - `capacity`: number of elements that `out_parts` has room for. 0: only `out_ends` and `out_count` are written,
 *   `out_parts` is ignored.
 * - `out_ends`: receives, for each point, the number of parts of all points up to and including this one.
 * - `out_count`: receives the number of parts of all points.
 *
 * Errors:
 * - OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of parts. `out_ends` and `out_count` are
 *   written all the same; do not use `out_parts`.
 * - Otherwise as for oc_scene_crossings.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_parts_at(const struct oc_scene *scene,
                            const double *points,
                            uint64_t count,
                            uint64_t stride,
                            struct oc_part_at *out_parts,
                            uint64_t capacity,
                            uint64_t *out_ends,
                            uint64_t *out_count);

/**
 * Measures how thick parts are at hits: the distance from each hit straight into the part, against the normal, to the
 * opposite side of the same part and instance.
 *
 * The opposite side is the first triangle behind the hit that faces the other way than the one that was hit. For a
 * part that is not closed it may lie beyond a hole.
 *
 * - `hits`: hits of oc_scene_closest or of a pick. Their `kind`, `position`, `normal`, `part` and `instance` must be
 *   set; `prim` and `error` help at edges.
 * - `count`: number of hits.
 * - `hit_stride`: bytes from one hit to the next. 0: tightly packed.
 * - `out_thickness`: receives the distances, in world units: infinity if there is no opposite side, or if the hit is a
 *   miss. Do not use it if the call fails.
 * - `stride`: bytes from one distance to the next. 0: tightly packed.
 *
 * Errors: as for oc_scene_crossings.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_thickness(const struct oc_scene *scene,
                             const struct oc_hit *hits,
                             uint64_t count,
                             uint64_t hit_stride,
                             double *out_thickness,
                             uint64_t stride);

/**
 * Finds the visible parts that intersect a box. The test is exact: it tests triangles, not bounds.
 *
 * - `scene`: the committed state is searched.
 * - `box_min`, `box_max`: 3 doubles each, world space. The box is closed (its surface belongs to it). An empty box
 *   intersects nothing.
 * - `out_parts`: receives the parts, ordered by instance (in the order added), then by part (in the model's order).
 * - `capacity`: number of elements that `out_parts` has room for. 0: only the count is written, `out_parts` is
 *   ignored.
 * - `out_count`: receives the number of parts found, also with OC_STATUS_BUFFER_TOO_SMALL.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a coordinate is NaN.
 * - OC_STATUS_BUFFER_TOO_SMALL: `capacity` is not 0 and below the number of parts.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_overlap_box(const struct oc_scene *scene,
                               const double *box_min,
                               const double *box_max,
                               struct oc_overlap *out_parts,
                               uint64_t capacity,
                               uint64_t *out_count);

/**
 * Finds the visible parts that intersect the common part of half spaces, e.g. a frustum. The test is exact: it tests
 * triangles, not bounds.
 *
 * - `planes`: `plane_count` half spaces, tightly packed, world space.
 * - `plane_count`: 1 to 4096. A frustum has 6.
 * - `scene`, `out_parts`, `capacity`, `out_count`: as for oc_scene_overlap_box.
 *
 * Errors: as for oc_scene_overlap_box. OC_STATUS_INVALID_ARGUMENT also if a plane is not finite or its normal is zero.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_overlap_frustum(const struct oc_scene *scene,
                                   const struct oc_plane *planes,
                                   uint64_t plane_count,
                                   struct oc_overlap *out_parts,
                                   uint64_t capacity,
                                   uint64_t *out_count);

/**
 * Creates an empty set of parts.
 *
 * - `out_set`: receives the set.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_part_set_create(struct oc_part_set **out_set);

/**
 * Adds all parts of an instance.
 *
 * - `instance`: id of the instance. OC_NO_ID: all instances.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_part_set_add_instance(struct oc_part_set *set, uint64_t instance);

/**
 * Adds a part and all parts below it.
 *
 * - `instance`: id of the instance. OC_NO_ID: all instances of models that have the part.
 * - `part`: id of the part.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_part_set_add_part(struct oc_part_set *set, uint64_t instance, uint64_t part);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_part_set_retain(struct oc_part_set *set);

/** Releases one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_part_set_release(struct oc_part_set *set);

/**
 * Begins to search, in the background, for pairs of visible parts of the committed scene that cross, touch, hold one
 * another, or are nearer to each other than a clearance.
 *
 * Parts of one instance are compared too, and each instance of a shared mesh counts. Triangles decide, in exact
 * arithmetic on their corners: these are placed once, in double precision, in a frame near the pair. The result does
 * not depend on the number of threads, on the order of the sets or on the blocks in memory. Parts that have a corner,
 * an edge or an area in common touch or cross: the clearance does not remove them. With a tolerance, the search also
 * finds how deep closed parts reach into each other: it reads all triangles of such parts, into memory that counts
 * against the budget.
 *
 * - `desc`: the search. It is copied, the sets too. Initialise it with OC_INIT. NULL: all zeros.
 * - `out_job`: receives the job. oc_job_take_clashes returns what it finds, oc_job_clash_summary the numbers.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: the clearance or the tolerance is negative or not finite, a set is empty, or `detail`
 *   or a flag is unknown.
 * - The job fails with OC_STATUS_INVALID_ARGUMENT if a set names an instance or part that the scene lacks, and with
 *   the error of a disk read.
 *
 * Ownership: the caller receives one reference to the job.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_clash_start(const struct oc_scene *scene,
                               const struct oc_clash_desc *desc,
                               struct oc_job **out_job);

/**
 * Takes clashes that a job has found, in order. Each is returned once.
 *
 * Their order is that of the whole result: instances in the order added, then parts in the order of the model, then
 * triangles. So none is there before all pairs were compared, and a job that is cancelled before that has none.
 *
 * - `out_clashes`: receives at most `capacity` clashes. May be NULL if `capacity` is 0.
 * - `out_count`: receives the number of clashes written; if `capacity` is 0, the number of those that wait.
 *
 * A job that runs may find more. After the end of the job, a count below `capacity` says that there are no more.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_job_take_clashes(const struct oc_job *job,
                              struct oc_clash *out_clashes,
                              uint64_t capacity,
                              uint64_t *out_count);

/**
 * Returns the numbers of a search for clashes that is done.
 *
 * - `out_summary`: receives the numbers. Initialise it with OC_INIT.
 *
 * Errors: OC_STATUS_INVALID_STATE: the job is not done, or failed. OC_STATUS_INVALID_STATE or
 * OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_job_clash_summary(const struct oc_job *job,
                               struct oc_clash_summary *out_summary);

/**
 * Finds, for each point, the nearest point of the visible parts of the committed scene.
 *
 * Distances are exact within `oc_nearest_point.error`. Of triangles at the same distance, that of the instance added
 * first counts, of one instance that of the part that comes first in the model, and then that with the least index.
 *
 * - `desc`: the points and options. Initialise it with OC_INIT.
 * - `out_points`: receives one answer for each point. Do not use it if the call fails.
 * - `out_stride`: bytes from one answer to the next. 0: tightly packed.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a point is not finite, the limit is negative or NaN, the set is empty or names an
 *   instance or part that the scene lacks, a flag is unknown, or both flags are set.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
 *
 * Thread safety: any thread. Frames and other batches may be in flight. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_nearest(const struct oc_scene *scene,
                           const struct oc_nearest_desc *desc,
                           struct oc_nearest_point *out_points,
                           uint64_t out_stride);

/**
 * Finds the distance between the visible parts of two sets in the committed scene, and the two nearest points.
 *
 * The distance is that of surfaces: a part inside of another one has a distance from it. Whether it is 0 is decided
 * in exact arithmetic on corners that are placed once in double precision. A part is not compared with itself, even
 * if it is in both sets; parts of one instance are compared with each other. Of several pairs of points at the same
 * distance one is returned, the same in each call: it does not depend on the number of threads, on the order of the
 * sets or on the blocks in memory.
 *
 * - `desc`: the sets and the limit. Initialise it with OC_INIT. NULL: all zeros.
 * - `out_distance`: receives the distance. Initialise it with OC_INIT.
 *
 * Errors: as for oc_scene_nearest.
 *
 * Thread safety: any thread. Frames and batches may be in flight. Blocks; may read the disk.
 */
OC_API
oc_status oc_scene_distance(const struct oc_scene *scene,
                            const struct oc_distance_desc *desc,
                            struct oc_distance *out_distance);

/**
 * Returns the camera that shows the visible parts of the scene, or chosen ones, as large as the picture allows: their
 * boxes touch the margin on two opposite sides, and lie within it on the others.
 *
 * - `scene`: the committed state. Hidden parts and instances do not count.
 * - `fit`: the picture and the view. Initialise it with OC_INIT.
 * - `parts`: array of parts that are to be shown. Ignored if `count` is 0: all are.
 * - `count`: number of parts.
 * - `stride`: bytes from one part to the next. 0: tightly packed. With the size of an oc_overlap, the array may be the
 *   result of oc_scene_overlap_box or oc_scene_overlap_frustum.
 * - `out_camera`: receives the camera. Initialise it with OC_INIT.
 *
 * The box of a part is that of its own triangles in the model, placed with the instance. A part with no triangles of
 * its own, such as an assembly, has none: OC_PARTS_BELOW adds the parts below it. Parts without a size, such as a
 * point, are shown from a distance of 1.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a member of `fit` is out of range, or there is no such instance or part.
 * - OC_STATUS_INVALID_STATE: none of the parts is visible and has triangles.
 *
 * Thread safety: any thread. Cheap. Takes time in proportion to the number of parts and instances.
 */
OC_API
oc_status oc_scene_fit(const struct oc_scene *scene,
                       const struct oc_fit *fit,
                       const struct oc_part_ref *parts,
                       uint64_t count,
                       uint64_t stride,
                       struct oc_camera *out_camera);

/**
 * Creates a frame.
 *
 * - `desc`: options. NULL: 1024 by 768 pixels of OC_BUFFER_COLOUR_SRGB8.
 * - `out_frame`: receives the frame.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a size, a buffer or a target is out of range.
 * - OC_STATUS_OUT_OF_MEMORY: the system refuses memory for the buffers. Most systems grant more memory than they have:
 *   a picture larger than the machine's memory may end the process later, when it is written.
 *
 * Ownership: the caller receives one reference.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_create(const struct oc_context *context,
                          const struct oc_frame_desc *desc,
                          struct oc_frame **out_frame);

/**
 * Begins to render a picture of the committed scene in the background. The previous request of this frame is cancelled
 * and replaced.
 *
 * - `scene`: a scene of the same context. Its committed state is rendered.
 * - `camera`: initialised with OC_INIT.
 * - `settings`: options. NULL: all defaults.
 *
 * Course of a request:
 * - The first picture is complete, and is made from the data in memory: stand-ins replace missing data. It can be
 *   mapped as soon as it is ready, long before the request ends.
 * - Each later picture is more exact: a pixel gives way only to one of smaller error.
 * - If the required data does not fit the memory budget, the threshold first rises step by step until all data of the
 *   picture fits. Then the picture is completed pane by pane, with the requested threshold: the data of one pane at a
 *   time is in memory. This takes longer, because data is read several times; oc_frame_cancel ends it, and leaves the
 *   best picture. If several frames of a context need panes, they take turns. With OC_FRAME_AT_ONCE the request ends
 *   before the panes.
 * - The request ends as OC_STATE_DONE when the picture is as exact as requested.
 * - The request ends as OC_STATE_COMPLETE_WITHIN_BUDGET before the panes with OC_FRAME_AT_ONCE, or when the budget
 *   does not even hold the data of one pixel, or some data cannot be read. In the last case `error` of oc_progress is
 *   OC_STATUS_IO (unreadable) or OC_STATUS_CORRUPT (damaged); the next request tries to read it again.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: a setting or the camera is out of range.
 * - OC_STATUS_OUT_OF_MEMORY: the system refuses memory for a picture in addition to the one that can be mapped.
 *   The previous request then continues.
 *
 * Thread safety: any thread. Cheap. Exception: a frame with targets waits until earlier requests no longer write to
 * them, i.e. for their tiles in flight.
 */
OC_API
oc_status oc_frame_request(struct oc_frame *frame,
                           const struct oc_scene *scene,
                           const struct oc_camera *camera,
                           const struct oc_frame_settings *settings);

/**
 * Returns the progress of the last request.
 *
 * - `out_progress`: receives the progress. Initialise it with OC_INIT.
 *
 * If the request has failed or was cancelled, oc_last_error of this thread returns the reason.
 * Thread safety: any thread. Cheap.
 */
OC_API oc_status oc_frame_poll(const struct oc_frame *frame, struct oc_progress *out_progress);

/**
 * Waits until the last request has ended, and until the wake function has returned if another thread is calling it.
 *
 * - `timeout_ms`: longest time to wait, in milliseconds. OC_FOREVER: no limit. A timeout is not a failure: the state
 *   is then OC_STATE_RUNNING.
 * - `out_progress`: receives the progress as oc_frame_poll does. May be NULL.
 *
 * Thread safety: any thread. Blocks. In a context without threads this call does the work.
 */
OC_API
oc_status oc_frame_wait(const struct oc_frame *frame,
                        uint32_t timeout_ms,
                        struct oc_progress *out_progress);

/**
 * Cancels the last request. Rendering stops within a tile. The last complete picture stays unchanged.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_cancel(struct oc_frame *frame);

/**
 * Changes the size of the pictures of later requests. The running request is cancelled, and the targets are removed
 * from the frame. The last complete picture keeps its size until the next one is complete.
 *
 * - `width`, `height`: size in pixels, 1 to 65536.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: the size is out of range. Nothing changes.
 * - OC_STATUS_OUT_OF_MEMORY: as for oc_frame_create. Nothing changes.
 *
 * Thread safety: any thread. Blocks until no thread writes to the targets any more.
 */
OC_API
oc_status oc_frame_resize(struct oc_frame *frame,
                          uint32_t width,
                          uint32_t height);

/**
 * Registers a function that is called each time a better picture can be mapped, and each time a request ends.
 *
 * - `wake`: the function. It replaces an earlier one. NULL: none.
 * - `user`: passed to `wake`. It must stay valid until the frame is released, or until `wake` is replaced and a call
 *   in progress has returned (oc_frame_wait waits for it).
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_set_wake(struct oc_frame *frame,
                            oc_wake_fn wake,
                            void *user);

/**
 * Returns the accuracy of the last complete picture of the last request. Before that is ready: of the pixels rendered
 * so far. The error of a pixel that shows a stand-in is the distance, in pixels, within which the original surface
 * lies.
 *
 * - `out_accuracy`: receives the accuracy. Initialise it with OC_INIT.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_get_accuracy(const struct oc_frame *frame,
                                struct oc_frame_accuracy *out_accuracy);

/**
 * Returns the exact hit at a pixel of the last complete picture; before there is one, of the last request. All members
 * are set. Surfaces of any opacity are hit, also of opacity 0; OC_LOOK_HIDDEN takes parts out of all hits. As in the
 * picture, a surface that the eye is on is not hit.
 *
 * - `x`, `y`: the pixel, counted from the top left corner.
 * - `out_hit`: receives the hit.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: the pixel is outside of the picture.
 * - OC_STATUS_INVALID_STATE: nothing was requested yet.
 * - OC_STATUS_IO, OC_STATUS_CORRUPT: a block of the model cannot be read.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_frame_pick(const struct oc_frame *frame,
                        uint32_t x,
                        uint32_t y,
                        struct oc_hit *out_hit);

/**
 * Returns a hit near a pixel, with a preference for thin parts, such as wires of less than a pixel.
 *
 * Rays go through the centre and six other points of each pixel within `radius` pixels of the pixel's centre. A part
 * is thin if it covers less than a fifth of the picture within `radius` pixels of its nearest point. The result is:
 * - the nearest hit of a thin part, and at equal distances that of the smaller depth; or else
 * - the hit at the pixel itself, as of oc_frame_pick; or, if that is a miss,
 * - the nearest hit, or a miss if there is none.
 *
 * - `x`, `y`: the pixel, counted from the top left corner.
 * - `radius`: distance in pixels, 0 to 32. 0: the call is oc_frame_pick. Usual: 3 to 5.
 * - `out_hit`: receives the hit. It is exact, with all members, as of oc_frame_pick.
 *
 * Errors: as oc_frame_pick. OC_STATUS_INVALID_ARGUMENT also if the radius is out of range.
 *
 * Thread safety: any thread. Blocks; may read the disk.
 */
OC_API
oc_status oc_frame_pick_near(const struct oc_frame *frame,
                             uint32_t x,
                             uint32_t y,
                             double radius,
                             struct oc_hit *out_hit);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_frame_retain(struct oc_frame *frame);

/**
 * Releases one reference. The last release cancels the frame. NULL: does nothing.
 *
 * Thread safety: any thread. The last release blocks until the tiles in flight are done, and until the wake function
 * has returned if another thread is calling it.
 */
OC_API
void oc_frame_release(struct oc_frame *frame);

/**
 * Maps a buffer of the last complete picture, without a copy. The content stays valid and unchanged until the mapping
 * is released, even if the frame renders other pictures or is released.
 *
 * - `buffer`: one of the OC_BUFFER_ constants.
 * - `out_pixels`: receives the buffer. Initialise it with OC_INIT.
 *
 * Errors:
 * - OC_STATUS_INVALID_ARGUMENT: there is no such buffer.
 * - OC_STATUS_INVALID_STATE: no picture is complete yet, or `buffers` of oc_frame_desc does not name this buffer. A
 *   target alone does not suffice.
 *
 * Ownership: the caller receives one reference to `out_pixels->mapping`.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_frame_map(const struct oc_frame *frame,
                       oc_buffer buffer,
                       struct oc_pixels *out_pixels);

/** Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap. */
OC_API void oc_mapping_retain(struct oc_mapping *mapping);

/**
 * Releases one reference. After the last release the pixels must not be read any more. NULL: does nothing.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API
void oc_mapping_release(struct oc_mapping *mapping);

/**
 * Begins to read, in the background, the part of the committed scene that lies in a box.
 *
 * The job reads the blocks below all cells that intersect the box and are longer than `cell`. Blocks below the longest
 * cells come first. Hidden parts are included. Reads for frames and queries have priority, and no picture becomes
 * coarser because of a prefetch.
 *
 * - `low`, `high`: corners of the box, three doubles each, world space.
 * - `cell`: length in world units, 0 or more. 0: all blocks of geometry (not primitive ids and colours).
 * - `out_job`: receives the job. Its progress counts blocks (`done`) and their bytes in memory (`bytes`).
 *
 * The job ends as
 * - OC_STATE_DONE: all blocks are in memory.
 * - OC_STATE_COMPLETE_WITHIN_BUDGET: no more blocks fit next to those that frames use.
 * - OC_STATE_FAILED: a block cannot be read. The others were read as far as they fit.
 *
 * The blocks stay in memory until the library needs room and they are the least recently used. Releasing the job ends
 * the reading.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if a coordinate or `cell` is NaN, or `cell` is below 0.
 *
 * Ownership: the caller receives one reference to the job.
 * Thread safety: any thread. Cheap.
 */
OC_API
oc_status oc_scene_prefetch_box(const struct oc_scene *scene,
                                const double *low,
                                const double *high,
                                double cell,
                                struct oc_job **out_job);

/**
 * Begins to read, in the background, the blocks that a picture of the committed scene would need, e.g. for the next
 * view. The most visible blocks come first.
 *
 * The job traces a ray through every fourth pixel of every fourth row to find the blocks. It ignores shadows and
 * everything behind transparent surfaces. Priority, progress and end of the job: as for oc_scene_prefetch_box.
 *
 * - `camera`: initialised with OC_INIT.
 * - `width`, `height`: size of the picture in pixels, 1 to 65536.
 * - `poe`: pixels of error of the picture (see oc_frame_settings). 0: exact.
 * - `out_job`: receives the job.
 *
 * Errors: OC_STATUS_INVALID_ARGUMENT if the camera or the size is out of range, or `poe` is not finite or below 0.
 *
 * Ownership: the caller receives one reference to the job.
 * Thread safety: any thread. Cheap.
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
