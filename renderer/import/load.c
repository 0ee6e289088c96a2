/* SPDX-License-Identifier: Apache-2.0 */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "import/launch.h"
#include "volume/procedural.h"

/* Reads "?field=NAME", "?vectors=NAME" or "?level=N", or several of them in the order level,
 * vectors, field, joined by '&'. */
static bool read_query(const char *at, struct sp_source_parts *parts) {
    struct sp_source_parts found = { .path_bytes = parts->path_bytes, .level = -1 };
    at++;
    if (strncmp(at, "level=", 6) == 0 && isdigit((unsigned char)at[6])) {
        const size_t digits = strspn(at + 6, "0123456789");
        if (digits > 3 || (at[6 + digits] && at[6 + digits] != '&'))
            return false;
        found.level = atoi(at + 6);
        at += 6 + digits + (at[6 + digits] == '&');
    }
    const bool has_vectors = strncmp(at, "vectors=", 8) == 0;
    if (has_vectors) {
        const char *name = at + 8, *end = strstr(name, "&field=");
        const size_t length = end ? (size_t)(end - name) : strlen(name);
        snprintf(found.vectors, sizeof found.vectors, "%.*s", (int)length, name);
        at = name + length + (end != NULL);
    }
    const bool has_field = strncmp(at, "field=", 6) == 0;
    if (!has_field && ((found.level < 0 && !has_vectors) || *at))
        return false;
    found.field = has_field ? at + 6 : at;
    *parts = found;
    return true;
}

/* True if a path that names something inside of a file may end here. */
static bool is_container(const char *source, size_t length) {
    static const char *const endings[] = { ".h5",  ".hdf5", ".hdf", ".he5", ".nc",
                                           ".nc4", ".cdf",  ".nxs", ".mat", ".ims" };
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++) {
        const size_t n = strlen(endings[i]);
        if (length > n && strncasecmp(source + length - n, endings[i], n) == 0)
            return true;
    }
    return false;
}

struct sp_source_parts sp_source_split(const char *source) {
    const size_t length = strlen(source);
    struct sp_source_parts parts = { .path_bytes = length, .level = -1, .field = source + length };
    if (sp_source_is_demo(source))
        return parts;
    for (const char *at = strchr(source, '?'); at; at = strchr(at + 1, '?'))
        if (read_query(at, &parts))
            parts.path_bytes = (size_t)(at - source);
    if (parts.path_bytes < length)
        return parts;
    for (const char *at = strstr(source, ":/"); at; at = strstr(at + 1, ":/"))
        if (is_container(source, (size_t)(at - source)))
            return (struct sp_source_parts){ .path_bytes = (size_t)(at - source),
                                             .level = -1,
                                             .field = at + 1 };
    return parts;
}

struct sp_volume *sp_volume_load(const char *source, const struct sp_load_options *options,
                                 struct sp_error *err) {
    if (sp_source_is_demo(source))
        return sp_demo_load(source, options, err);
    return sp_import(source, options, err);
}
