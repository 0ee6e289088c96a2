/* SPDX-License-Identifier: Apache-2.0 */
#include "import/selection.h"

#include <string.h>

static const char *const names[IMPORT_AS_COUNT] = { "",    "time",     "vectors",
                                                    "rgb", "channels", "labels" };

bool import_as_parse(const char *name, enum import_as *as, const char *shown,
                     struct sp_error *err) {
    for (int i = 0; i < IMPORT_AS_COUNT; i++)
        if (strcmp(name, names[i]) == 0) {
            *as = (enum import_as)i;
            return true;
        }
    return sp_fail(err, SP_ERR_INVALID, shown,
                   "?as=%.40s: unknown; choose time, vectors, rgb, channels or labels", name);
}

const char *import_as_name(enum import_as as) {
    return names[as];
}
