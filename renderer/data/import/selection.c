/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/selection.h"

#include <string.h>

static const char *const names[IMPORT_AS_COUNT] = { "",         "time",   "vectors", "rgb",
                                                    "channels", "labels", "slice" };

bool import_as_parse(const char *name, enum import_as *as, const char *title,
                     struct sp_error *err) {
    for (int i = 0; i < IMPORT_AS_COUNT; i++)
        if (strcmp(name, names[i]) == 0) {
            *as = (enum import_as)i;
            return true;
        }
    return sp_fail(err, SP_ERR_INVALID, title,
                   "?as=%.40s: unknown; choose time, vectors, rgb, channels, labels or slice",
                   name);
}

bool import_unit_check(const char *unit, const char *title, struct sp_error *err) {
    for (const char *c = unit; *c; c++)
        if ((unsigned char)*c <= ' ')
            return sp_fail(err, SP_ERR_INVALID, title,
                           "?unit=%s: a unit is one word without spaces, such as mm or um", unit);
    return true;
}

const char *import_as_name(enum import_as as) {
    return names[as];
}

bool import_as_is_axis(enum import_as as) {
    return as >= IMPORT_AS_TIME && as <= IMPORT_AS_CHANNELS;
}
