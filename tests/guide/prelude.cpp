// The frame of a C++ snippet of the guide. tests/guide.rs replaces the two marks with the snippet: leading definitions
// go to the first mark, statements to the second.
#include <outcrop.hpp>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

/* DEFINITIONS */

static void snippet(outcrop::context &context, outcrop::model &model, outcrop::scene &scene, outcrop::frame &frame,
                    oc_camera camera) {
    (void)context, (void)model, (void)scene, (void)frame, (void)camera;
    /* STATEMENTS */
}

int main() {
    try {
        outcrop::context context(2);
        outcrop::model model = context.open("pump.oc");
        outcrop::scene scene(context);
        scene.add_instance(model, 1);
        scene.commit();
        auto desc = outcrop::init<oc_frame_desc>();
        desc.width = 160, desc.height = 120;
        desc.buffers = 1u << OC_BUFFER_COLOUR_SRGB8 | 1u << OC_BUFFER_PART | 1u << OC_BUFFER_KIND | 1u << OC_BUFFER_ERROR;
        outcrop::frame frame(context, desc);
        frame.request(scene, model.view(0));
        frame.wait();
        snippet(context, model, scene, frame, model.view(0));
    } catch (const std::exception &e) {
        std::fprintf(stderr, "%s\n", e.what());
        return 1;
    }
    return 0;
}
