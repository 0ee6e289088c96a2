/* SPDX-License-Identifier: Apache-2.0
 *
 * The data folder for a browser of files: the disk thread lists a folder (render/data_folder.h),
 * the search thread looks for names in and below one (render/data_search.h).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "common/work_queue.h"
#include "http/paging.h"
#include "http/routes.h"
#include "render/data_folder.h"
#include "render/data_search.h"

/* Limits of a search. */
enum { LISTS_MAX = 1000, SEARCHES_MAX = 16, SEARCH_MS = 2000, SEARCH_NAMES = 100000 };

struct listing {
    struct srv_work work;
    struct srv_request *request;
    struct srv_page page;
    char *find; /* of a search: the text, behind the path; NULL = a list */
    char path[];
};

/* Encodes {"name", "type", …}. NULL when out of memory. */
static proto_json *encode_entry(void *user, const void *item) {
    (void)user;
    const struct srv_data_entry *entry = item;
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "name", srv_data_name(entry));
    proto_json_set_string(&json, "kind", entry->is_folder ? "folder" : "volume");
    if (!entry->is_folder) {
        if (!entry->is_zarr)
            proto_json_set_integer(&json, "bytes", (int64_t)entry->size_bytes);
        proto_json_set_string(&json, "format", entry->format);
    }
    if (entry->dims[0])
        proto_json_set(&json, "dims", proto_json_integers(entry->dims, 3));
    if (entry->type[0])
        proto_json_set_string(&json, "type", entry->type);
    if (entry->kind != SP_KIND_COUNT)
        proto_json_set_string(&json, "contents", sp_kind_name(entry->kind));
    return json;
}

static void reply_failure(struct srv_request *request, const struct sp_error *err) {
    if (err->code == SP_ERR_IO)
        srv_reply_problem(&request->reply, 503, NULL, "%s", err->text);
    else
        srv_reply_error(&request->reply, err);
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
        proto_json_set_integer(&json, "unlisted", unlisted);
        srv_reply_json(&request->reply, 200, json);
    } else {
        free(listing->page.items);
        reply_failure(request, &err);
    }
    free(listing);
    srv_request_complete(request);
}

/* An entry with "folder" and, if it stands for several files, "files". */
static proto_json *encode_hit(const struct srv_data_hit *hit) {
    proto_json *json = encode_entry(NULL, &hit->entry);
    proto_json_set_string(&json, "folder", hit->folder);
    if (hit->files > 1)
        proto_json_set_integer(&json, "files", hit->files);
    return json;
}

static proto_json *encode_search(const struct srv_data_search *search) {
    static const char *const cuts[] = { "", "limit", "time", "names" };
    proto_json *json = proto_json_object(), *entries = proto_json_array();
    for (unsigned i = 0; i < search->count; i++)
        proto_json_append(&entries, encode_hit(&search->hits[i]));
    proto_json_set(&json, "entries", entries);
    proto_json_set_integer(&json, "unlisted", search->unlisted);
    proto_json_set_integer(&json, "unread", search->unread);
    if (search->cut != SRV_DATA_CUT_NONE)
        proto_json_set_string(&json, "cut", cuts[search->cut]);
    return json;
}

static void run_search(struct srv_work *work) {
    struct listing *listing = (struct listing *)work;
    struct srv_request *request = listing->request;
    struct srv_data_search search = {
        .data = srv_catalog_data(request->app->catalog),
        .text = listing->find,
        .hits = listing->page.items,
        .hits_max = listing->page.max - 1, /* a page has capacity for one more */
        .names_max = SEARCH_NAMES,
        .end_ms = srv_clock_ms() + SEARCH_MS,
    };
    struct sp_error err;
    if (srv_data_search(&search, listing->path, &err)) {
        for (unsigned i = 0; i < search.count; i++)
            if (search.hits[i].files == 1)
                srv_data_describe(search.data, search.hits[i].folder, &search.hits[i].entry);
        srv_reply_json(&request->reply, 200, encode_search(&search));
    } else {
        reply_failure(request, &err);
    }
    srv_data_search_finish(&search);
    free(listing->page.items);
    free(listing);
    srv_request_complete(request);
}

/* True if a search with these query parameters may begin. */
static bool check_search(struct srv_request *request, const char *find, struct srv_reply *reply) {
    struct sp_error err;
    if (!srv_data_search_check(find, &err)) {
        srv_reply_problem(reply, 400, NULL, "?find= %s", err.text);
        return false;
    }
    if (srv_request_query(request, "after")) {
        srv_reply_problem(reply, 422, NULL,
                          "?after= cannot be used with ?find=: a search has one page");
        return false;
    }
    return true;
}

void srv_get_files(struct srv_request *request, struct srv_reply *reply) {
    const char *path = srv_request_query(request, "path");
    const char *find = srv_request_query(request, "find");
    const size_t path_size = strlen(path ? path : "") + 1, find_size = strlen(find ? find : "") + 1;
    const size_t item = find ? sizeof(struct srv_data_hit) : sizeof(struct srv_data_entry);
    struct srv_page page;
    if ((find && !check_search(request, find, reply)) ||
        !srv_paging_begin(request, item, &page, reply))
        return;
    if (!srv_catalog_data(request->app->catalog)) {
        srv_reply_problem(reply, 403, NULL,
                          "this daemon has no data folder; start it with --data DIR");
        free(page.items);
        return;
    }
    struct listing *listing = malloc(sizeof *listing + path_size + find_size);
    if (!listing) {
        free(page.items);
        srv_reply_problem(reply, 503, NULL, "out of memory for a list");
        return;
    }
    *listing = (struct listing){ .work = { .run = find ? run_search : run_listing },
                                 .request = request,
                                 .page = page,
                                 .find = find ? listing->path + path_size : NULL };
    memcpy(listing->path, path ? path : "", path_size);
    if (find)
        memcpy(listing->find, find, find_size);
    const bool is_waiting =
        find ? srv_request_queue(request, request->app->searching, &listing->work, SEARCHES_MAX,
                                 "searches")
             : srv_request_queue(request, request->app->disk, &listing->work, LISTS_MAX, "lists");
    if (!is_waiting) {
        free(page.items);
        free(listing);
    }
}
