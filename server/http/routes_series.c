/* SPDX-License-Identifier: Apache-2.0
 *
 * The DICOM series of a folder of the data folder. The importer reads the files, in its sandbox; a
 * thread of its own waits for it, because that takes seconds for a folder of thousands of files.
 */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/work_queue.h"
#include "http/routes.h"
#include "protocol/text.h"
#include "render/data_folder.h"
#include "render/redact.h"
#include "sp/series.h"

enum { LISTINGS_MAX = 16, TIMEOUT_MS = 60000 };

struct series_listing {
    struct srv_work work;
    struct srv_request *request;
    char path[]; /* relative to the data folder */
};

/* Adds a text that JSON can carry; leaves out an empty one. */
static void set_text(proto_json **json, const char *key, const char *text) {
    char clean[80];
    snprintf(clean, sizeof clean, "%s", text);
    proto_text_clean(clean);
    if (clean[0])
        proto_json_set_string(json, key, clean);
}

/* {"source", "images", …}; NULL when out of memory. */
static proto_json *encode(const char *path, const struct sp_series *series) {
    char source[PATH_MAX + 128];
    proto_json *json = proto_json_object();
    snprintf(source, sizeof source, "%s?series=%s", path, series->uid);
    proto_json_set_string(&json, "source", series->uid[0] ? source : path);
    set_text(&json, "uid", series->uid);
    set_text(&json, "description", series->description);
    set_text(&json, "modality", series->modality);
    if (series->has_number)
        proto_json_set_integer(&json, "number", series->number);
    proto_json_set_integer(&json, "images", series->images);
    proto_json_set(&json, "size",
                   proto_json_integers((const uint32_t[]){ series->columns, series->rows }, 2));
    proto_json_set_integer(&json, "bytes", (int64_t)series->bytes);
    return json;
}

static proto_json *encode_all(const char *path, const struct sp_series *list, uint32_t count) {
    proto_json *json = proto_json_object(), *all = proto_json_array();
    for (uint32_t i = 0; i < count; i++)
        proto_json_append(&all, encode(path, &list[i]));
    proto_json_set(&json, "series", all);
    return json;
}

static void run_listing(struct srv_work *work) {
    struct series_listing *listing = (struct series_listing *)work;
    struct srv_request *request = listing->request;
    const char *data = srv_catalog_data(request->app->catalog);
    const struct sp_load_options options = { .root = data, .timeout_ms = TIMEOUT_MS };
    struct sp_series *list = calloc(SP_SERIES_MAX, sizeof *list);
    char real[PATH_MAX];
    struct sp_error err;
    uint32_t count;
    if (!list) {
        srv_reply_problem(&request->reply, 503, NULL, "out of memory for a list");
    } else if (!srv_data_check_relative(listing->path, "/path", &err) ||
               !srv_data_resolve(data, listing->path, "/path", real, &err)) {
        srv_reply_error(&request->reply, &err);
    } else if (!sp_series_list(real, &options, list, &count, &err)) {
        srv_redact_text(data, real, err.text, sizeof err.text);
        srv_reply_problem(&request->reply, srv_status_from(err.code), "/path", "%s", err.text);
    } else {
        srv_reply_json(&request->reply, 200, encode_all(listing->path, list, count));
    }
    free(list);
    free(listing);
    srv_request_complete(request);
}

void srv_get_series(struct srv_request *request, struct srv_reply *reply) {
    const char *path = srv_request_query(request, "path");
    const size_t size = strlen(path ? path : "") + 1;
    if (!srv_catalog_data(request->app->catalog)) {
        srv_reply_problem(reply, 403, NULL,
                          "this daemon has no data folder; start it with --data DIR");
        return;
    }
    struct series_listing *listing = malloc(sizeof *listing + size);
    if (!listing) {
        srv_reply_problem(reply, 503, NULL, "out of memory for a list");
        return;
    }
    *listing = (struct series_listing){ .work = { .run = run_listing }, .request = request };
    memcpy(listing->path, path ? path : "", size);
    if (!srv_request_queue(request, request->app->listing, &listing->work, LISTINGS_MAX,
                           "lists of series"))
        free(listing);
}
