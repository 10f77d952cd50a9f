/* Prints the installed version. Fails if the header and the library have different versions. */
#include <outcrop.h>
#include <stdio.h>

int main(void) {
    printf("outcrop: header %u, library %u\n", (unsigned)OC_HEADER_VERSION, (unsigned)oc_version());
    return oc_version() == OC_HEADER_VERSION ? 0 : 1;
}
