/* SPDX-License-Identifier: Apache-2.0 */
#include "render/source.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/volume.h"

enum { SUFFIX_BYTES = 7 };

static const char demo_prefix[] = "demo:";
enum { DEMO_PREFIX = sizeof demo_prefix - 1 };

bool srv_source_is_demo(const char *source) {
    return strncmp(source, demo_prefix, DEMO_PREFIX) == 0;
}

static char *copy(const char *text, struct sp_error *err) {
    char *text_copy = strdup(text);
    if (!text_copy)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
    return text_copy;
}

static char *resolve_demo(const char *source, bool confined, struct sp_error *err) {
    struct sp_error why;
    if (sp_demo_check(source, &why))
        return copy(source, err);
    if (confined)
        sp_fail(err, why.code, "/uri", "%.100s: %s", source, why.text);
    else if (err)
        *err = why;
    return NULL;
}

static char *resolve_trusted(const char *source, struct sp_error *err) {
    char *real = realpath(source, NULL);
    if (!real)
        sp_fail(err, SP_ERR_NOT_FOUND, source, "cannot open the volume: %s", strerror(errno));
    return real;
}

static bool is_below(const char *path, const char *folder) {
    size_t length = strlen(folder);
    return strncmp(path, folder, length) == 0 && (path[length] == '/' || folder[length - 1] == '/');
}

static char *resolve_confined(const char *source, const char *data, struct sp_error *err) {
    char joined[PATH_MAX];
    if (!data) {
        sp_fail(err, SP_ERR_DENIED, "/path",
                "this daemon loads no files by request; start it with --data DIR");
        return NULL;
    }
    if (source[0] != '/' &&
        snprintf(joined, sizeof joined, "%s/%s", data, source) >= (int)sizeof joined) {
        sp_fail(err, SP_ERR_INVALID, "/path", "the path is longer than %zu bytes",
                sizeof joined - 1);
        return NULL;
    }
    char *real = realpath(source[0] == '/' ? source : joined, NULL);
    if (!real && errno == ENOMEM) {
        sp_fail(err, SP_ERR_MEMORY, "/path", "out of memory for a path");
        return NULL;
    }
    /* The answer for a path outside the folder does not tell whether it exists. */
    if (!real || !is_below(real, data)) {
        sp_fail(err, SP_ERR_NOT_FOUND, "/path", "there is no such file below the data folder");
        free(real);
        return NULL;
    }
    return real;
}

char *srv_source_resolve(const char *source, bool confined, const char *data,
                         struct sp_error *err) {
    return srv_source_is_demo(source) ? resolve_demo(source, confined, err)
           : confined                 ? resolve_confined(source, data, err)
                                      : resolve_trusted(source, err);
}

static bool is_id_char(char c) {
    return isalnum((unsigned char)c) || strchr("._-", c);
}

bool srv_source_is_id(const char *id) {
    size_t length = strlen(id);
    for (size_t i = 0; i < length; i++)
        if (!is_id_char(id[i]))
            return false;
    return length >= 1 && length < SP_NAME_BYTES && strcmp(id, ".") != 0 && strcmp(id, "..") != 0;
}

void srv_source_default_id(const char *source, char id[SP_NAME_BYTES]) {
    const char *start = source;
    size_t length;
    if (srv_source_is_demo(source)) {
        start += DEMO_PREFIX;
        length = strcspn(start, "?");
    } else {
        const char *slash = strrchr(source, '/');
        start = slash ? slash + 1 : source;
        const char *dot = strrchr(start, '.');
        length = dot && dot != start ? (size_t)(dot - start) : strlen(start);
    }
    if (length > SP_NAME_BYTES - 1 - SUFFIX_BYTES)
        length = SP_NAME_BYTES - 1 - SUFFIX_BYTES;
    for (size_t i = 0; i < length; i++)
        id[i] = is_id_char(start[i]) ? start[i] : '-';
    id[length] = 0;
    if (!srv_source_is_id(id))
        strcpy(id, "volume");
}
