// The C++ handles compile with and without exceptions, and move but do not copy.
#include <outcrop.hpp>
#include <outcrop.hpp>

#include <type_traits>

static_assert(!std::is_copy_constructible<outcrop::scene>::value, "move-only");
static_assert(!std::is_copy_assignable<outcrop::frame>::value, "move-only");
static_assert(std::is_nothrow_move_constructible<outcrop::context>::value, "moves");
static_assert(std::is_nothrow_move_assignable<outcrop::model>::value, "moves");
static_assert(sizeof(outcrop::job) == sizeof(void *), "nothing but the handle");
static_assert(sizeof(outcrop::build) == sizeof(void *), "each object type has a class, with and without exceptions");
static_assert(sizeof(outcrop::mapping_handle) == sizeof(void *), "likewise");
static_assert(sizeof(outcrop::part_reader) == sizeof(void *), "likewise");
static_assert(sizeof(outcrop::part_set) == sizeof(void *), "likewise");
static_assert(sizeof(outcrop::cursor) == sizeof(void *), "likewise");

#ifndef OUTCROP_NO_EXCEPTIONS
// A scene is saved, and opened again.
void saved(outcrop::context &context, outcrop::scene &scene, const std::string &path) {
    scene.save(path);
    scene = outcrop::scene(context, path);
}
#endif

outcrop::model opened(outcrop::context &context, const char *path) {
    outcrop::model model;
    if (oc_model_open(context.get(), path, model.put()) != OC_STATUS_OK) return outcrop::model();
    outcrop::model moved = std::move(model);
    moved = outcrop::model(moved.release());
    return moved;
}
