/* SPDX-License-Identifier: Apache-2.0
 *
 * The data folder for a browser of files (render/data_folder.h). The disk thread reads it.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/work_queue.h"
#include "http/paging.h"
#include "http/routes.h"
#include "render/data_folder.h"

struct listing {
    struct srv_work work;
    struct srv_request *request;
    struct srv_page page;
    char path[];
};

/* Encodes {"name", "type", …}. NULL when out of memory. */
static proto_json *encode_entry(void *user, const void *item) {
    (void)user;
    const struct srv_data_entry *entry = item;
    proto_json *json = proto_json_object();
    bool ok = proto_json_set_string(json, "name", srv_data_name(entry));
    ok = proto_json_set_string(json, "kind", entry->is_folder ? "folder" : "volume") && ok;
    if (!entry->is_folder) {
        ok =
            (entry->is_zarr || proto_json_set_integer(json, "bytes", (int64_t)entry->size_bytes)) &&
            ok;
        ok = proto_json_set_string(json, "format", entry->format) && ok;
    }
    if (entry->dims[0]) {
        proto_json *dims = proto_json_array();
        for (int axis = 0; axis < 3; axis++)
            ok = proto_json_append_integer(dims, entry->dims[axis]) && ok;
        ok = proto_json_set(json, "dims", dims) && ok;
    }
    if (entry->type[0])
        ok = proto_json_set_string(json, "type", entry->type) && ok;
    if (entry->kind != SP_KIND_COUNT)
        ok = proto_json_set_string(json, "contents", sp_kind_name(entry->kind)) && ok;
    if (!ok)
        proto_json_free(&json);
    return json;
}

static void run_listing(struct srv_work *work) {
    struct listing *listing = (struct listing *)work;
    struct srv_request *request = listing->request;
    const char *data = srv_catalog_data(request->app->catalog);
    struct srv_data_entry *entries = listing->page.items;
    struct sp_error err;
    unsigned unlisted;
    if (srv_data_list(data, listing->path, &listing->page, &unlisted, &err)) {
        for (unsigned i = 0; i < listing->page.count; i++)
            srv_data_describe(data, listing->path, &entries[i]);
        proto_json *json = srv_paging_json(&listing->page, "entries", encode_entry, NULL);
        if (!proto_json_set_integer(json, "unlisted", unlisted))
            proto_json_free(&json);
        srv_reply_json(&request->reply, 200, json);
    } else {
        free(listing->page.items);
        if (err.code == SP_ERR_IO)
            srv_reply_problem(&request->reply, 503, NULL, "%s", err.text);
        else
            srv_reply_error(&request->reply, &err);
    }
    free(listing);
    srv_request_complete(request);
}

void srv_get_files(struct srv_request *request, struct srv_reply *reply) {
    const char *path = srv_request_query(request, "path");
    size_t size = strlen(path ? path : "") + 1;
    struct srv_page page;
    if (!srv_paging_begin(request, sizeof(struct srv_data_entry), &page, reply))
        return;
    if (!srv_catalog_data(request->app->catalog)) {
        srv_reply_problem(reply, 403, NULL,
                          "this daemon has no data folder; start it with --data DIR");
        free(page.items);
        return;
    }
    struct listing *listing = malloc(sizeof *listing + size);
    if (!listing) {
        free(page.items);
        srv_reply_problem(reply, 503, NULL, "out of memory for a list");
        return;
    }
    *listing = (struct listing){ .work = { .run = run_listing }, .request = request, .page = page };
    memcpy(listing->path, path ? path : "", size);
    srv_request_suspend(request);
    srv_work_queue_add(request->app->disk, &listing->work);
}
