/* SPDX-License-Identifier: Apache-2.0
 *
 * One slice of a volume, as an image or as values. The daemon checks the options.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cli/commands.h"
#include "cli/output.h"

struct query {
    char text[2048];
    size_t size;
};

/* Appends "&name=value"; a NULL value appends nothing. False: it does not fit. */
static bool add(struct query *query, struct http *http, const char *name, const char *value,
                struct sp_error *err) {
    char *escaped = value ? http_escape(http, value) : NULL;
    if (!value)
        return true;
    size_t left = sizeof query->text - query->size;
    int n = escaped ? snprintf(query->text + query->size, left, "&%s=%s", name, escaped) : -1;
    free(escaped);
    if (n < 0 || (size_t)n >= left)
        return sp_fail(err, n < 0 ? SP_ERR_MEMORY : SP_ERR_INVALID, value, "%s",
                       n < 0 ? "out of memory" : "is too long");
    query->size += (size_t)n;
    return true;
}

/* Chooses the middle sample of the axis, "0" to "2". */
static bool add_middle(struct query *query, struct http *http, const char *path, const char *axis,
                       struct sp_error *err) {
    proto_json *volume = http_json(http, "GET", path, NULL, err);
    int64_t count = 0;
    char index[32];
    bool ok = volume != NULL;
    proto_json_integer(proto_json_at(proto_json_get(volume, "dims"), (size_t)(axis[0] - '0')),
                       &count);
    snprintf(index, sizeof index, "%" PRId64, count / 2);
    proto_json_free(&volume);
    return ok && add(query, http, "index", index, err);
}

/* Returns the axis as the daemon names it: x, y and z are the axes of the grid. */
static const char *axis_of(const char *name) {
    static const char *const names[] = { "0x", "1y", "2z" }, *const axes[] = { "0", "1", "2" };
    for (int i = 0; name && i < 3; i++)
        if (strlen(name) == 1 && strchr(names[i], name[0]))
            return axes[i];
    return NULL;
}

static bool make_query(struct query *query, const struct options *options, struct http *http,
                       const char *path, const char *format, struct sp_error *err) {
    const struct slice_options *slice = &options->slice;
    const char *axis = axis_of(slice->axis);
    char size[32], step[16];
    snprintf(step, sizeof step, "%u", options->step);
    snprintf(size, sizeof size, "%u,%u", options->size[0], options->size[1]);
    bool needs_middle = axis && !slice->index;
    return add(query, http, "format", format, err) && add(query, http, "axis", axis, err) &&
           add(query, http, "index", slice->index, err) &&
           add(query, http, "step", options->step != STEP_OF_VIEW ? step : NULL, err) &&
           (!needs_middle || add_middle(query, http, path, axis, err)) &&
           add(query, http, "origin", slice->origin, err) &&
           add(query, http, "normal", slice->normal, err) &&
           add(query, http, "up", slice->up, err) &&
           add(query, http, "spacing", slice->spacing, err) &&
           add(query, http, "window", slice->window, err) &&
           add(query, http, "size", options->size[0] ? size : NULL, err);
}

/* Asks again while the daemon loads the time step. */
static bool get(const struct options *options, struct http *http, const char *path,
                struct http_response *response, struct sp_error *err) {
    enum { CONFLICT = 409, PAUSE_MS = 200 };
    for (unsigned waited_ms = 0;; waited_ms += PAUSE_MS) {
        if (http_request(http, "GET", path, "*/*", NULL, response, err))
            return true;
        if (response->status != CONFLICT || !response->retry_after[0] ||
            waited_ms / 1000 >= options->timeout_s)
            return false;
        http_response_finish(response);
        *response = (struct http_response){ 0 };
        nanosleep(&(struct timespec){ .tv_nsec = PAUSE_MS * 1000000L }, NULL);
    }
}

static bool fetch_slice(const struct options *options, struct http *http, const char *format,
                        struct sp_error *err) {
    struct query query = { .size = 0 };
    struct http_response response = { 0 };
    char *id = resolve_volume(http, options, options->volume, false, true, err), *path = NULL;
    char *volume = id ? collection_path(http, "volumes", id, err) : NULL;
    bool ok = volume && make_query(&query, options, http, volume, format, err);
    if (ok && asprintf(&path, "%s/slice?%s", volume, query.text + 1) < 0) {
        path = NULL;
        ok = sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    }
    ok = ok && get(options, http, path, &response, err) &&
         output_write(options->out, response.body, response.size, err);
    http_response_finish(&response);
    free(path);
    free(volume);
    free(id);
    return ok;
}

/* The format by --format, else by the suffix of --out, else PNG. NULL = unknown. */
static const char *pick_format(const struct options *options) {
    static const char *const known[][2] = {
        { "png", ".png" }, { "jpeg", ".jpg" }, { "jpeg", ".jpeg" }, { "raw", ".raw" }
    };
    const char *name = strrchr(options->out, '/');
    const char *ending = strrchr(name ? name : options->out, '.');
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (options->format ? strcmp(options->format, known[i][0]) == 0
                            : ending && strcmp(ending, known[i][1]) == 0)
            return known[i][0];
    return options->format || ending ? NULL : "png";
}

int command_slice(const struct options *options, struct sp_error *err) {
    const struct slice_options *slice = &options->slice;
    if (options->argument)
        return usage_error(options->argument, "slice takes options only; did you mean --volume?");
    if (!options->volume || !options->out)
        return usage_error("slice",
                           "needs --volume and --out FILE, or --out - for standard output");
    if (slice->axis && !axis_of(slice->axis))
        return usage_error("--axis", "\"%s\" is not x, y or z", slice->axis);
    if (!slice->axis == !(slice->origin && slice->normal))
        return usage_error("slice", "needs either --axis, or --origin and --normal with --size");
    const char *format = pick_format(options);
    if (!format)
        return usage_error(options->format ? options->format : options->out,
                           "is not a format of slices; use png, jpeg or raw (--format)");
    struct http *http = connect_to_daemon(options, err);
    bool ok = http && fetch_slice(options, http, format, err);
    http_destroy(&http);
    return ok ? 0 : 1;
}
