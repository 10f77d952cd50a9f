/* The other half. */
#include <outcrop.h>
#include <outcrop.h>

#ifdef __cplusplus
uint32_t version_of_b(void);
#else
extern uint32_t version_of_b(void);
#endif

uint32_t version_of_b(void) {
    return oc_version();
}
