/* SPDX-License-Identifier: Apache-2.0 */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/launch.h"
#include "data/volume/procedural.h"

static bool is_key(const char *at) {
    static const char *const keys[] = { "level=", "series=", "as=", "unit=", "vectors=", "field=" };
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (strncmp(at, keys[i], strlen(keys[i])) == 0)
            return true;
    return false;
}

/* A value of the query ends at '&' and must not be empty. The description of a series may have a
 * '&' that no key follows. Returns the text after it, or NULL. */
static const char *read_value(const char *at, const char *key, char *value, size_t size) {
    const size_t length = strlen(key);
    const bool is_free = strcmp(key, "series=") == 0;
    if (strncmp(at, key, length) != 0)
        return NULL;
    at += length;
    size_t n = strcspn(at, "&");
    while (is_free && at[n] && !is_key(at + n + 1))
        n += 1 + strcspn(at + n + 1, "&");
    snprintf(value, size, "%.*s", (int)n, at);
    return n > 0 ? at + n + (at[n] == '&') : NULL;
}

/* Reads what chooses the file's part or meaning, before its vectors and field. Returns the text
 * after it, or NULL if a value is wrong, too long, or there twice. */
static const char *read_choices(const char *at, struct sp_source_parts *parts) {
    for (;;) {
        char level[8] = "";
        const struct {
            const char *key;
            char *value;
            size_t size;
        } choices[] = { { "level=", level, sizeof level },
                        { "series=", parts->series, sizeof parts->series },
                        { "as=", parts->as, sizeof parts->as },
                        { "unit=", parts->unit, sizeof parts->unit } };
        size_t i = 0;
        while (i < sizeof choices / sizeof *choices &&
               strncmp(at, choices[i].key, strlen(choices[i].key)) != 0)
            i++;
        if (i == sizeof choices / sizeof *choices)
            return at;
        const bool is_too_long = choices[i].value == parts->unit &&
                                 strcspn(at + strlen(choices[i].key), "&") >= choices[i].size;
        const bool is_repeated = choices[i].value[0] || (i == 0 && parts->level >= 0);
        at = is_repeated || is_too_long
                 ? NULL
                 : read_value(at, choices[i].key, choices[i].value, choices[i].size);
        const size_t digits = strspn(level, "0123456789");
        if (!at || (i == 0 && (digits > 3 || level[digits])))
            return NULL;
        if (i == 0)
            parts->level = atoi(level);
    }
}

/* Reads the query that begins at '?'. False if it is part of a name. */
static bool read_query(const char *query, struct sp_source_parts *parts) {
    struct sp_source_parts found = { .path_bytes = parts->path_bytes, .level = -1 };
    const char *at = read_choices(query + 1, &found);
    if (!at)
        return false;
    const bool has_choices = at > query + 1;
    const char *rest = at;
    if (strncmp(at, "vectors=", 8) == 0) {
        const char *name = at + 8, *end = strstr(name, "&field=");
        const size_t length = end ? (size_t)(end - name) : strlen(name);
        snprintf(found.vectors, sizeof found.vectors, "%.*s", (int)length, name);
        at = name + length + (end != NULL);
    }
    const bool has_field = strncmp(at, "field=", 6) == 0;
    if ((has_field && !at[6]) || (at != rest && !found.vectors[0]))
        return false;
    if (!has_field && (*at || (at == rest && !has_choices)))
        return false;
    found.field = has_field ? at + 6 : at;
    const bool has_names = has_field || at != rest;
    found.file_bytes = parts->file_bytes + (size_t)(rest - query) - (has_names ? 1 : 0);
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
    struct sp_source_parts parts = {
        .path_bytes = length, .file_bytes = length, .level = -1, .field = source + length
    };
    if (sp_source_is_demo(source))
        return parts;
    for (const char *at = strchr(source, '?'); at; at = strchr(at + 1, '?')) {
        struct sp_source_parts found = { .path_bytes = (size_t)(at - source),
                                         .file_bytes = (size_t)(at - source) };
        if (read_query(at, &found))
            parts = found;
    }
    if (parts.path_bytes < length)
        return parts;
    for (const char *at = strstr(source, ":/"); at; at = strstr(at + 1, ":/"))
        if (is_container(source, (size_t)(at - source)))
            return (struct sp_source_parts){ .path_bytes = (size_t)(at - source),
                                             .file_bytes = (size_t)(at - source),
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
