/* SPDX-License-Identifier: Apache-2.0 */
#include "support/gl.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *test_gl(void) {
    const char *name = getenv("SPLATD_TEST_GL");
    return name && *name ? name : "gl-software";
}

bool test_gl_is_software(void) {
    return strcmp(test_gl(), "gl") != 0;
}

const struct sp_backend *test_backend(const char *name) {
    for (unsigned i = 0; sp_registry_at(i); i++)
        if (strcmp(sp_registry_at(i)->entry.name, name) == 0)
            return sp_registry_at(i);
    fprintf(stderr, "this build has no backend \"%s\"\n", name);
    exit(1);
}
