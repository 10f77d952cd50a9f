/* Half of a program that includes the header everywhere, and twice in each file. */
#include <outcrop.h>
#include <outcrop.h>

uint32_t version_of_b(void);

int main(void) {
    oc_ray ray;
    OC_INIT(&ray);
    return oc_version() == version_of_b() && ray.t_min == 0 ? 0 : 1;
}
