// outcrop for C++11 and later: classes over outcrop.h that release their objects automatically.
//
// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Every object type of outcrop.h has a move-only class of the same name, without the prefix. `get()` returns the C
// handle, for calls of C functions. `put()` receives a new handle from an out parameter:
//
//     outcrop::model model;
//     oc_status status = oc_model_open(context.get(), path, model.put());
//
// If exceptions are enabled, the classes also have members for most of the C functions. They throw outcrop::error on failure.
// Without exceptions, or with OUTCROP_NO_EXCEPTIONS, there are only the handles. outcrop.h documents the functions:
// their arguments, thread safety and blocking.
#ifndef OUTCROP_HPP
#define OUTCROP_HPP

#include "outcrop.h"

#include <utility>

#if !defined(OUTCROP_NO_EXCEPTIONS) && !defined(__cpp_exceptions) && !defined(__EXCEPTIONS) && !defined(_CPPUNWIND)
#define OUTCROP_NO_EXCEPTIONS
#endif

#ifndef OUTCROP_NO_EXCEPTIONS
#include <array>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>
#endif

namespace outcrop {

/// Returns a struct of outcrop.h, zeroed and with its size set.
template <class Struct> Struct init() {
    Struct s;
    OC_INIT(&s);
    return s;
}

/// Owns one reference to an object. Can be moved, not copied. The destructor releases the reference.
template <class Object, void (*Retain)(Object *), void (*Release)(Object *)> class handle {
  public:
    handle() noexcept : object_(nullptr) {}
    /// Takes over a reference that the caller owns.
    explicit handle(Object *owned) noexcept : object_(owned) {}
    handle(handle &&other) noexcept : object_(other.release()) {}
    handle &operator=(handle &&other) noexcept {
        reset(other.release());
        return *this;
    }
    handle(const handle &) = delete;
    handle &operator=(const handle &) = delete;
    ~handle() { Release(object_); }

    Object *get() const noexcept { return object_; }
    explicit operator bool() const noexcept { return object_ != nullptr; }
    /// Releases the object and returns the address of the handle, for an out parameter.
    Object **put() noexcept {
        reset();
        return &object_;
    }
    void reset(Object *owned = nullptr) noexcept {
        Object *old = object_;
        object_ = owned;
        Release(old);
    }
    /// Adds a reference and returns it. The caller owns it, and may construct a handle from it.
    Object *retained() const noexcept {
        Retain(object_);
        return object_;
    }
    /// Returns the reference to the caller. The handle is empty then.
    Object *release() noexcept {
        Object *old = object_;
        object_ = nullptr;
        return old;
    }

  private:
    Object *object_;
};

using context_handle = handle<oc_context, oc_context_retain, oc_context_release>;
using build_handle = handle<oc_build, oc_build_retain, oc_build_release>;
using job_handle = handle<oc_job, oc_job_retain, oc_job_release>;
using model_handle = handle<oc_model, oc_model_retain, oc_model_release>;
using scene_handle = handle<oc_scene, oc_scene_retain, oc_scene_release>;
using frame_handle = handle<oc_frame, oc_frame_retain, oc_frame_release>;
using mapping_handle = handle<oc_mapping, oc_mapping_retain, oc_mapping_release>;
using part_reader_handle = handle<oc_part_reader, oc_part_reader_retain, oc_part_reader_release>;
using part_set_handle = handle<oc_part_set, oc_part_set_retain, oc_part_set_release>;
using cursor_handle = handle<oc_cursor, oc_cursor_retain, oc_cursor_release>;

#ifdef OUTCROP_NO_EXCEPTIONS

using context = context_handle;
using build = build_handle;
using job = job_handle;
using model = model_handle;
using scene = scene_handle;
using frame = frame_handle;
using mapping = mapping_handle;
using part_reader = part_reader_handle;
using cursor = cursor_handle;
using part_set = part_set_handle;

#else

/// Exception for a call that does not return OC_STATUS_OK, and for a job that has failed.
class error : public std::runtime_error {
  public:
    error(oc_status status, const std::string &what) : std::runtime_error(what), status_(status) {}
    oc_status status() const noexcept { return status_; }

  private:
    oc_status status_;
};

inline void check(oc_status status) {
    if (status != OC_STATUS_OK) throw error(status, oc_last_error());
}

/// A buffer of a complete picture. It is mapped as long as this object lives.
class pixels {
  public:
    pixels(oc_pixels info) noexcept : info_(info), mapping_(info.mapping) {}
    std::uint32_t width() const noexcept { return info_.width; }
    std::uint32_t height() const noexcept { return info_.height; }
    oc_format format() const noexcept { return info_.format; }
    std::size_t row_pitch() const noexcept { return static_cast<std::size_t>(info_.row_pitch); }
    const void *data() const noexcept { return info_.data; }
    /// Returns row `y`, e.g. `row<unsigned char>(y)` or `row<float>(y)`.
    template <class Element> const Element *row(std::uint32_t y) const noexcept {
        return reinterpret_cast<const Element *>(static_cast<const unsigned char *>(info_.data) + row_pitch() * y);
    }

  private:
    oc_pixels info_;
    mapping_handle mapping_;
};

/// The triangles of a part, some at a time.
class part_reader : public part_reader_handle {
  public:
    part_reader() = default;
    using part_reader_handle::handle;
    /// The next triangles, at most `most`; none at the end.
    std::vector<oc_triangle> next(std::size_t most = 4096) {
        std::vector<oc_triangle> found(most);
        std::uint64_t count = 0;
        check(oc_part_reader_next(get(), found.data(), most, &count));
        found.resize(static_cast<std::size_t>(count));
        return found;
    }
};

/// A set of parts of a scene, by ids.
class part_set : public part_set_handle {
  public:
    part_set() { check(oc_part_set_create(put())); }
    using part_set_handle::handle;
    part_set &add_instance(std::uint64_t instance) {
        check(oc_part_set_add_instance(get(), instance));
        return *this;
    }
    part_set &add_part(std::uint64_t part, std::uint64_t instance = OC_NO_ID) {
        check(oc_part_set_add_part(get(), instance, part));
        return *this;
    }
};

/// The nodes of a model's trees, one at a time, in any order. For one thread at a time.
class cursor : public cursor_handle {
  public:
    cursor() = default;
    using cursor_handle::handle;
    /// The root of a tree; OC_NO_ID if it has no triangles.
    std::uint64_t root(std::uint32_t tree = 0) const {
        std::uint64_t node = OC_NO_ID;
        check(oc_cursor_root(get(), tree, &node));
        return node;
    }
    /// Where walks of the whole model begin.
    std::vector<oc_tree_place> places() const {
        std::uint64_t count = 0;
        check(oc_cursor_places(get(), nullptr, 0, &count));
        std::vector<oc_tree_place> found(static_cast<std::size_t>(count));
        check(oc_cursor_places(get(), found.data(), count, &count));
        return found;
    }
    oc_node node(std::uint64_t id) const {
        auto s = init<oc_node>();
        check(oc_cursor_node(get(), id, &s));
        return s;
    }
    /// Fills a node that `init` has initialised.
    void node(std::uint64_t id, oc_node &out) const { check(oc_cursor_node(get(), id, &out)); }
    /// Replaces the content of `out` by the triangles of a leaf.
    void triangles(std::uint64_t leaf, std::vector<oc_node_triangle> &out, bool with_prims = true) const {
        std::uint64_t count = 0;
        out.resize(64);
        check(oc_cursor_triangles(get(), leaf, with_prims, out.data(), out.size(), &count));
        out.resize(static_cast<std::size_t>(count));
    }
    /// The ids of all nodes of a block.
    std::vector<std::uint64_t> block_nodes(std::uint32_t block) const {
        std::uint64_t count = 0;
        check(oc_cursor_block_nodes(get(), block, nullptr, 0, &count));
        std::vector<std::uint64_t> found(static_cast<std::size_t>(count));
        check(oc_cursor_block_nodes(get(), block, found.data(), count, &count));
        return found;
    }
};

class model : public model_handle {
  public:
    model() = default;
    using model_handle::handle;
    oc_model_info info() const {
        auto s = init<oc_model_info>();
        check(oc_model_get_info(get(), &s));
        return s;
    }
    oc_part_info part(std::uint32_t index) const {
        auto s = init<oc_part_info>();
        check(oc_model_get_part(get(), index, &s));
        return s;
    }
    std::uint32_t find_part(std::uint64_t id) const {
        std::uint32_t index = 0;
        check(oc_model_find_part(get(), id, &index));
        return index;
    }
    oc_camera view(std::uint32_t number) const {
        auto s = init<oc_camera>();
        check(oc_model_get_view(get(), number, &s));
        return s;
    }
    part_reader read_part(std::uint64_t part) const {
        part_reader reader;
        check(oc_model_read_part(get(), part, reader.put()));
        return reader;
    }
    /// Walks the trees of the model. `bytes`: memory for blocks that it reads, 0: 4 MiB.
    class cursor cursor(oc_cursor_flags flags = 0, std::uint64_t bytes = 0) const {
        class cursor c;
        check(oc_cursor_create(get(), flags, bytes, c.put()));
        return c;
    }
    /// The transform that gives the model this up axis and unit, for `scene::add`.
    std::array<double, 12> placement(oc_up_axis up, double metres_per_unit = 0,
                                     oc_placement_flags *unknown = nullptr) const {
        std::array<double, 12> transform{};
        check(oc_model_get_placement(get(), up, metres_per_unit, transform.data(), unknown));
        return transform;
    }
};

inline oc_ray camera_ray(const oc_camera &camera, std::uint32_t width, std::uint32_t height, double x, double y) {
    oc_ray ray;
    check(oc_camera_ray(&camera, width, height, x, y, &ray));
    return ray;
}
inline std::vector<oc_plane> camera_frustum(const oc_camera &camera, std::uint32_t width, std::uint32_t height,
                                            double x0, double y0, double x1, double y1) {
    std::vector<oc_plane> planes(5);
    check(oc_camera_frustum(&camera, width, height, x0, y0, x1, y1, planes.data()));
    return planes;
}

class job : public job_handle {
  public:
    job() = default;
    using job_handle::handle;
    oc_progress poll() const {
        auto s = init<oc_progress>();
        check(oc_job_poll(get(), &s));
        return s;
    }
    /// Throws if the job has failed or was cancelled.
    oc_progress wait(std::uint32_t timeout_ms = OC_FOREVER) const {
        auto s = init<oc_progress>();
        check(oc_job_wait(get(), timeout_ms, &s));
        if (s.state == OC_STATE_FAILED || s.state == OC_STATE_CANCELLED) throw error(s.error, oc_last_error());
        return s;
    }
    void cancel() const { check(oc_job_cancel(get())); }
    void set_wake(oc_wake_fn wake, void *user) const { check(oc_job_set_wake(get(), wake, user)); }
    oc_build_report report() const {
        auto s = init<oc_build_report>();
        check(oc_job_build_report(get(), &s));
        return s;
    }
    /// A warning about an input. `index` is below `notes` of the report.
    std::string note(std::uint32_t index) const {
        const char *text = nullptr;
        check(oc_job_build_note(get(), index, &text));
        return text;
    }
    /// Takes the clashes that a search has found so far.
    std::vector<oc_clash> clashes() const {
        std::uint64_t count = 0;
        check(oc_job_take_clashes(get(), nullptr, 0, &count));
        std::vector<oc_clash> found(static_cast<std::size_t>(count));
        if (count > 0) check(oc_job_take_clashes(get(), found.data(), count, &count));
        found.resize(static_cast<std::size_t>(count));
        return found;
    }
    /// The numbers of a search for clashes that is done.
    oc_clash_summary clash_summary() const {
        auto s = init<oc_clash_summary>();
        check(oc_job_clash_summary(get(), &s));
        return s;
    }
    class model model() const {
        class model m;
        check(oc_job_model(get(), m.put()));
        return m;
    }
};

class context : public context_handle {
  public:
    context() = default;
    using context_handle::handle;
    explicit context(const oc_context_desc &desc) { check(oc_context_create(OC_HEADER_VERSION, &desc, put())); }
    /// Creates a context with this many threads. OC_ALL_THREADS: one for each core. 0: none.
    explicit context(std::uint32_t threads) {
        auto desc = init<oc_context_desc>();
        desc.threads = threads;
        check(oc_context_create(OC_HEADER_VERSION, &desc, put()));
    }
    bool step() const {
        std::uint32_t did = 0;
        check(oc_context_step(get(), &did));
        return did != 0;
    }
    std::uint64_t property(oc_property id) const {
        std::uint64_t value = 0;
        check(oc_context_property(get(), id, &value));
        return value;
    }
    model open(const std::string &path) const {
        model m;
        check(oc_model_open(get(), path.c_str(), m.put()));
        return m;
    }
    model open(const oc_io &io) const {
        model m;
        check(oc_model_open_io(get(), &io, m.put()));
        return m;
    }
    job load(const std::string &path) const {
        job j;
        check(oc_model_load(get(), path.c_str(), nullptr, j.put()));
        return j;
    }
};

class build : public build_handle {
  public:
    build() = default;
    using build_handle::handle;
    explicit build(const context &c) { check(oc_build_create(c.get(), nullptr, put())); }
    build(const context &c, const oc_build_desc &desc) { check(oc_build_create(c.get(), &desc, put())); }
    void add_file(const std::string &path) { check(oc_build_add_file(get(), path.c_str())); }
    std::uint32_t add_material(const oc_material &material) {
        std::uint32_t number = 0;
        check(oc_build_add_material(get(), &material, &number));
        return number;
    }
    void add_part(const oc_part &part) { check(oc_build_add_part(get(), &part)); }
    void add_part(std::uint64_t id, const std::string &name, std::uint32_t material = 0) {
        auto part = init<oc_part>();
        part.id = id;
        part.name = name.c_str();
        part.material = material;
        add_part(part);
    }
    void add_triangles(const oc_triangles &triangles) { check(oc_build_add_triangles(get(), &triangles)); }
    void add_cage(const oc_cage &cage) { check(oc_build_add_cage(get(), &cage)); }
    void add_nurbs(const oc_nurbs &surface) { check(oc_build_add_nurbs(get(), &surface)); }
    std::uint32_t add_shared_mesh(std::uint32_t parts) {
        std::uint32_t mesh = 0;
        check(oc_build_add_shared_mesh(get(), parts, &mesh));
        return mesh;
    }
    void add_instance(std::uint32_t mesh, std::uint64_t first_part, const double *world_from_mesh) {
        check(oc_build_add_instance(get(), mesh, first_part, world_from_mesh));
    }
    job start(const std::string &path) {
        job j;
        check(oc_build_start(get(), path.c_str(), j.put()));
        return j;
    }
};

class scene : public scene_handle {
  public:
    scene() = default;
    using scene_handle::handle;
    explicit scene(const context &c) { check(oc_scene_create(c.get(), put())); }
    void add_instance(const model &m, std::uint64_t id, const double *world_from_model = nullptr) {
        check(oc_scene_add_instance(get(), m.get(), id, world_from_model));
    }
    /// Adds many instances of one model; `Transform` is oc_place, std::array<double, 12> or std::array<float, 12>.
    template <class Transform>
    void add_instances(const model &m, const std::vector<Transform> &transforms, std::uint64_t first_id) {
        const oc_model *prototype = m.get();
        auto all = instances(transforms, first_id);
        all.prototypes = &prototype, all.prototype_count = 1;
        add_instances(all);
    }
    /// Moves instances of an array with consecutive ids.
    template <class Transform>
    void set_transforms(std::uint64_t first_id, const std::vector<Transform> &transforms) {
        check(oc_scene_set_transforms(get(), first_id, form_of(transforms.data()), transforms.data(), transforms.size(), 0));
    }
    /// Replaces masks of instances of an array with consecutive ids.
    void set_masks(std::uint64_t first_id, const std::vector<std::uint32_t> &masks) {
        check(oc_scene_set_masks(get(), first_id, masks.data(), masks.size(), 0));
    }
    /// Replaces tints of instances of an array with consecutive ids.
    void set_tints(std::uint64_t first_id, const std::vector<std::array<std::uint8_t, 4>> &tints) {
        check(oc_scene_set_tints(get(), first_id, tints.empty() ? nullptr : tints.front().data(), tints.size(), 0));
    }
    /// Adds a scene many times; `Transform` as for models.
    template <class Transform>
    void add_instances(const scene &inner, const std::vector<Transform> &transforms, std::uint64_t first_id) {
        const oc_scene *prototype = inner.get();
        auto all = instances(transforms, first_id);
        all.scenes = &prototype, all.scene_count = 1;
        add_instances(all);
    }
    void add_instances(const oc_instances &all) { check(oc_scene_add_instances(get(), &all)); }
    /// Opens a scene file: see oc_scene_open.
    scene(const context &c, const std::string &path) { check(oc_scene_open(c.get(), path.c_str(), put())); }
    /// Saves what the last commit has in a scene file: see oc_scene_save.
    void save(const std::string &path) const { check(oc_scene_save(get(), path.c_str())); }
    void add_scene(const scene &inner, std::uint64_t id, const double *world_from_inner = nullptr) {
        check(oc_scene_add_scene(get(), inner.get(), id, world_from_inner));
    }
    /// The ids of the instances on the way to what a hit met, the outermost first.
    std::vector<std::uint64_t> path(const oc_hit &hit, double *world_from_model = nullptr) const {
        return path(hit.occurrence, world_from_model);
    }
    /// The same of a value of OC_BUFFER_OCCURRENCE.
    std::vector<std::uint64_t> path(std::uint64_t occurrence, double *world_from_model = nullptr) const {
        std::uint64_t count = 0;
        check(oc_scene_get_path(get(), occurrence, nullptr, 0, &count, world_from_model));
        std::vector<std::uint64_t> ids(static_cast<std::size_t>(count));
        check(oc_scene_get_path(get(), occurrence, ids.data(), count, &count, nullptr));
        return ids;
    }
    void remove_instances(std::uint64_t first_id) { check(oc_scene_remove_instances(get(), first_id)); }
    void remove_instance(std::uint64_t id) { check(oc_scene_remove_instance(get(), id)); }
    void set_transform(std::uint64_t id, const double *world_from_model) {
        check(oc_scene_set_transform(get(), id, world_from_model));
    }
    void set_mask(std::uint64_t id, std::uint32_t mask) { check(oc_scene_set_instance_mask(get(), id, mask)); }
    /// Sets the look of one place of an instance, by its number: see oc_scene_set_occurrence_look.
    void set_occurrence_look(std::uint64_t occurrence, const oc_look &look) {
        check(oc_scene_set_occurrence_look(get(), occurrence, &look));
    }
    void set_look(std::uint64_t id, const oc_look &look) { check(oc_scene_set_instance_look(get(), id, &look)); }
    void set_part_look(std::uint64_t id, std::uint64_t part, const oc_look &look) {
        check(oc_scene_set_part_look(get(), id, part, &look));
    }
    void set_parts_look(std::uint64_t id, const std::vector<std::uint64_t> &parts, const oc_look &look,
                        oc_parts_flags flags = 0) {
        check(oc_scene_set_parts_look(get(), id, parts.data(), parts.size(), flags, &look));
    }
    void isolate(std::uint64_t id, const std::vector<std::uint64_t> &parts, oc_parts_flags flags = 0) {
        check(oc_scene_isolate(get(), id, parts.data(), parts.size(), flags));
    }
    void set_model(std::uint64_t id, const model &m) { check(oc_scene_set_model(get(), id, m.get())); }
    void clear_part_looks(std::uint64_t id) { check(oc_scene_clear_part_looks(get(), id)); }
    void set_lights(const std::vector<oc_light> &lights) {
        check(oc_scene_set_lights(get(), lights.data(), lights.size(), 0));
    }
    void set_background(const oc_background &background) { check(oc_scene_set_background(get(), &background)); }
    void commit() { check(oc_scene_commit(get())); }

    std::vector<oc_hit> closest(const std::vector<oc_ray> &rays, oc_want want = OC_WANT_ALL,
                                oc_query_flags flags = 0) const {
        std::vector<oc_hit> hits(rays.size());
        const oc_query query = batch(rays, want, flags);
        check(oc_scene_closest(get(), &query, hits.data(), 0));
        return hits;
    }
    std::vector<oc_hit_f32> closest(const std::vector<oc_ray_f32> &rays, oc_want want = 0,
                                    oc_query_flags flags = 0) const {
        std::vector<oc_hit_f32> hits(rays.size());
        const oc_query_f32 query = batch(rays, want, flags);
        check(oc_scene_closest_f32(get(), &query, hits.data(), 0));
        return hits;
    }
    std::vector<std::uint8_t> any(const std::vector<oc_ray_f32> &rays, oc_query_flags flags = 0) const {
        std::vector<std::uint8_t> hits(rays.size());
        const oc_query_f32 query = batch(rays, OC_WANT_T, flags);
        check(oc_scene_any_f32(get(), &query, hits.data(), 0));
        return hits;
    }
    std::vector<std::uint8_t> any(const std::vector<oc_ray> &rays, oc_query_flags flags = 0) const {
        std::vector<std::uint8_t> hits(rays.size());
        const oc_query query = batch(rays, OC_WANT_T, flags);
        check(oc_scene_any(get(), &query, hits.data(), 0));
        return hits;
    }
    /** All crossings: those of ray i are from ends[i - 1] (0 for the first ray) to ends[i], without the last. */
    std::vector<oc_crossing> crossings(const std::vector<oc_ray> &rays, std::vector<std::uint64_t> &ends,
                                       oc_query_flags flags = 0) const {
        std::uint64_t count = 0;
        ends.resize(rays.size());
        const oc_query query = batch(rays, OC_WANT_T, flags);
        std::vector<oc_crossing> found(rays.size() * 4);
        oc_status status = oc_scene_crossings(get(), &query, found.data(), found.size(), ends.data(), nullptr, &count);
        if (status == OC_STATUS_BUFFER_TOO_SMALL) {
            found.resize(static_cast<std::size_t>(count));
            status = oc_scene_crossings(get(), &query, found.data(), count, ends.data(), nullptr, &count);
        }
        check(status);
        found.resize(static_cast<std::size_t>(count));
        return found;
    }
    /** The parts of point i are from ends[i - 1] (0 for the first point) to ends[i], without the last. */
    std::vector<oc_part_at> parts_at(const double (*points)[3], std::size_t count,
                                     std::vector<std::uint64_t> &ends) const {
        std::uint64_t found = 0;
        ends.resize(count);
        check(oc_scene_parts_at(get(), points ? points[0] : nullptr, count, 0, nullptr, 0, ends.data(), &found));
        std::vector<oc_part_at> parts(static_cast<std::size_t>(found));
        check(oc_scene_parts_at(get(), points ? points[0] : nullptr, count, 0, parts.data(), found, ends.data(), &found));
        return parts;
    }
    std::vector<double> thickness(const std::vector<oc_hit> &hits) const {
        std::vector<double> found(hits.size());
        check(oc_scene_thickness(get(), hits.data(), hits.size(), 0, found.data(), 0));
        return found;
    }
    std::vector<oc_overlap> overlap_box(const double (&low)[3], const double (&high)[3]) const {
        std::uint64_t count = 0;
        check(oc_scene_overlap_box(get(), low, high, nullptr, 0, &count));
        std::vector<oc_overlap> found(static_cast<std::size_t>(count));
        check(oc_scene_overlap_box(get(), low, high, found.data(), count, &count));
        found.resize(static_cast<std::size_t>(count));
        return found;
    }
    std::vector<oc_triangle> triangles(const std::vector<oc_hit> &hits) const {
        std::vector<oc_triangle> found(hits.size());
        check(oc_scene_triangles(get(), hits.data(), hits.size(), 0, found.data()));
        return found;
    }
    std::vector<oc_surface_point> evaluate(const std::vector<oc_hit> &hits, oc_query_flags flags = 0) const {
        std::vector<oc_surface_point> found(hits.size());
        check(oc_scene_evaluate(get(), hits.data(), hits.size(), 0, flags, found.data(), 0));
        return found;
    }
    std::vector<oc_overlap> overlap_frustum(const std::vector<oc_plane> &planes) const {
        std::uint64_t count = 0;
        check(oc_scene_overlap_frustum(get(), planes.data(), planes.size(), nullptr, 0, &count));
        std::vector<oc_overlap> found(static_cast<std::size_t>(count));
        check(oc_scene_overlap_frustum(get(), planes.data(), planes.size(), found.data(), count, &count));
        found.resize(static_cast<std::size_t>(count));
        return found;
    }
    /** Searches for clashes: wait for the job, and take them with `clashes`. */
    job clash(const oc_clash_desc &desc) const {
        job j;
        check(oc_scene_clash_start(get(), &desc, j.put()));
        return j;
    }
    /** The nearest points of `desc.points`. */
    std::vector<oc_nearest_point> nearest(const oc_nearest_desc &desc) const {
        std::vector<oc_nearest_point> found(static_cast<std::size_t>(desc.count));
        check(oc_scene_nearest(get(), &desc, found.data(), 0));
        return found;
    }
    std::vector<oc_nearest_point> nearest(const double (*points)[3], std::size_t count,
                                          oc_nearest_flags flags = 0) const {
        auto desc = init<oc_nearest_desc>();
        desc.points = points ? points[0] : nullptr;
        desc.count = count;
        desc.flags = flags;
        return nearest(desc);
    }
    /** The distance of two sets of parts. */
    oc_distance distance(const oc_distance_desc &desc) const {
        auto found = init<oc_distance>();
        check(oc_scene_distance(get(), &desc, &found));
        return found;
    }
    oc_camera fit(const oc_fit &desc, const std::vector<oc_part_ref> &parts = {}) const {
        auto camera = init<oc_camera>();
        check(oc_scene_fit(get(), &desc, parts.data(), parts.size(), 0, &camera));
        return camera;
    }
    job prefetch(const double (&low)[3], const double (&high)[3], double cell = 0) const {
        job j;
        check(oc_scene_prefetch_box(get(), low, high, cell, j.put()));
        return j;
    }
    job prefetch(const oc_camera &camera, std::uint32_t width, std::uint32_t height, float poe = 0) const {
        job j;
        check(oc_scene_prefetch_camera(get(), &camera, width, height, poe, j.put()));
        return j;
    }

  private:
    static oc_query_f32 batch(const std::vector<oc_ray_f32> &rays, oc_want want, oc_query_flags flags) {
        auto query = init<oc_query_f32>();
        query.rays = rays.data();
        query.count = rays.size();
        query.want = want;
        query.flags = flags;
        return query;
    }
    static oc_query batch(const std::vector<oc_ray> &rays, oc_want want, oc_query_flags flags) {
        auto query = init<oc_query>();
        query.rays = rays.data();
        query.count = rays.size();
        query.want = want;
        query.flags = flags;
        return query;
    }

  private:
    template <class Transform>
    static oc_instances instances(const std::vector<Transform> &transforms, std::uint64_t first_id) {
        auto all = init<oc_instances>();
        all.form = form_of(transforms.data());
        all.transforms = transforms.data(), all.count = transforms.size(), all.first_id = first_id;
        return all;
    }
    static oc_transform_form form_of(const oc_place *) { return OC_TRANSFORM_PLACE; }
    static oc_transform_form form_of(const std::array<double, 12> *) { return OC_TRANSFORM_AFFINE_F64; }
    static oc_transform_form form_of(const std::array<float, 12> *) { return OC_TRANSFORM_AFFINE_F32; }
};

class frame : public frame_handle {
  public:
    frame() = default;
    using frame_handle::handle;
    frame(const context &c, const oc_frame_desc &desc) { check(oc_frame_create(c.get(), &desc, put())); }
    frame(const context &c, std::uint32_t width, std::uint32_t height) {
        auto desc = init<oc_frame_desc>();
        desc.width = width;
        desc.height = height;
        check(oc_frame_create(c.get(), &desc, put()));
    }
    void request(const scene &s, const oc_camera &camera) { check(oc_frame_request(get(), s.get(), &camera, nullptr)); }
    void request(const scene &s, const oc_camera &camera, const oc_frame_settings &settings) {
        check(oc_frame_request(get(), s.get(), &camera, &settings));
    }
    oc_progress poll() const {
        auto s = init<oc_progress>();
        check(oc_frame_poll(get(), &s));
        return s;
    }
    /// Throws if the request has failed. Does not throw if it was cancelled.
    oc_progress wait(std::uint32_t timeout_ms = OC_FOREVER) const {
        auto s = init<oc_progress>();
        check(oc_frame_wait(get(), timeout_ms, &s));
        if (s.state == OC_STATE_FAILED) throw error(s.error, oc_last_error());
        return s;
    }
    void cancel() { check(oc_frame_cancel(get())); }
    void resize(std::uint32_t width, std::uint32_t height) { check(oc_frame_resize(get(), width, height)); }
    void set_wake(oc_wake_fn wake, void *user) { check(oc_frame_set_wake(get(), wake, user)); }
    oc_frame_accuracy accuracy() const {
        auto s = init<oc_frame_accuracy>();
        check(oc_frame_get_accuracy(get(), &s));
        return s;
    }
    oc_hit pick(std::uint32_t x, std::uint32_t y) const {
        oc_hit hit;
        check(oc_frame_pick(get(), x, y, &hit));
        return hit;
    }
    oc_hit pick_near(std::uint32_t x, std::uint32_t y, double radius) const {
        oc_hit hit;
        check(oc_frame_pick_near(get(), x, y, radius, &hit));
        return hit;
    }
    pixels map(oc_buffer buffer = OC_BUFFER_COLOUR_SRGB8) const {
        auto s = init<oc_pixels>();
        check(oc_frame_map(get(), buffer, &s));
        return pixels(s);
    }
};

#endif // OUTCROP_NO_EXCEPTIONS

} // namespace outcrop

#endif // OUTCROP_HPP
