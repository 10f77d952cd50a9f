/* Two static Rust libraries in one program, both of which catch their own panics. */
#include "check.h"

uint32_t second_catches(uint32_t n);
void oc_test_panic_at(uint32_t place);

int main(int argc, char **argv) {
    CHECK(argc == 2);
    oc_context *context;
    uint64_t value;
    OK(oc_context_create(OC_HEADER_VERSION, NULL, &context));
    CHECK(second_catches(3) == 1);
    oc_test_panic_at(1);
    EXPECT(OC_STATUS_INTERNAL, oc_context_property(context, OC_PROPERTY_VERSION, &value));
    CHECK(second_catches(5) == 1);
    OK(oc_context_property(context, OC_PROPERTY_VERSION, &value));
    build_tetra(context, argv[1]);
    oc_context_release(context);
    return 0;
}
