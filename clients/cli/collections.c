/* SPDX-License-Identifier: Apache-2.0
 *
 * Presets, saved views, sessions, and the list of camera paths.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/print.h"

/* Reads all pages of a list into one document {"`name`": […]}; NULL with *err set on failure. */
static proto_json *read_pages(struct http *http, const char *name, struct sp_error *err) {
    proto_json *all = proto_json_array(), *whole = proto_json_object();
    char path[512];
    bool ok = all && whole, has_next = true;
    snprintf(path, sizeof path, "/%s", name);
    while (ok && has_next) {
        proto_json *page = http_json(http, "GET", path, NULL, err);
        if (!page)
            break;
        const proto_json *list = proto_json_get(page, name);
        for (size_t i = 0; i < proto_json_size(list); i++)
            proto_json_append(&all, proto_json_ref((proto_json *)proto_json_at(list, i)));
        const char *next = proto_json_string(proto_json_get(page, "next"));
        char *escaped = next ? http_escape(http, next) : NULL;
        has_next = next != NULL;
        ok = all && !next == !escaped;
        if (escaped)
            snprintf(path, sizeof path, "/%s?limit=1000&after=%.400s", name, escaped);
        free(escaped);
        proto_json_free(&page);
    }
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, name, "out of memory");
    proto_json_set(&whole, name, all);
    if (!ok || has_next)
        proto_json_free(&whole);
    return whole;
}

static void add_session(struct table *table, const proto_json *session) {
    int64_t participants = 0;
    double idle_s = 0;
    bool is_hibernated = false;
    proto_json_integer(proto_json_get(session, "participants"), &participants);
    proto_json_number(proto_json_get(session, "idle"), &idle_s);
    proto_json_bool(proto_json_get(session, "hibernated"), &is_hibernated);
    table_add(table, "%s", text_of(session, "id"));
    table_add(table, "%s", text_of(session, "volume"));
    table_add(table, "%s", is_hibernated ? "hibernated" : "active");
    table_add(table, "%" PRId64, participants);
    table_add(table, "%.0f", idle_s);
}

static void add_view(struct table *table, const proto_json *view) {
    int64_t size[2] = { 0 };
    for (size_t i = 0; i < 2; i++)
        proto_json_integer(proto_json_at(proto_json_get(view, "size"), i), &size[i]);
    table_add(table, "%s", text_of(view, "id"));
    table_add(table, "%s", text_of(view, "volume"));
    table_add(table, "%" PRId64 "x%" PRId64, size[0], size[1]);
}

static void add_path(struct table *table, const proto_json *path) {
    int64_t frames = 0, done = 0;
    proto_json_integer(proto_json_get(path, "frames"), &frames);
    proto_json_integer(proto_json_get(path, "done"), &done);
    table_add(table, "%s", text_of(path, "id"));
    table_add(table, "%s", text_of(path, "state"));
    table_add(table, "%s", text_of(path, "format"));
    table_add(table, "%" PRId64, done);
    table_add(table, "%" PRId64, frames);
}

static void add_name(struct table *table, const proto_json *name) {
    table_add(table, "%s", proto_json_string(name) ? proto_json_string(name) : "");
}

/* Prints a list of the daemon; with --json as one document. */
static int list(const struct options *options, const struct listing *listing,
                struct sp_error *err) {
    if (options->argument)
        return usage_error(options->argument,
                           "is an argument too many; the command lists everything");
    struct http *http = connect_to_daemon(options, err);
    proto_json *all = http ? read_pages(http, listing->name, err) : NULL;
    bool ok = all != NULL;
    http_destroy(&http);
    if (ok && options->json)
        ok = print_json(options, all, err);
    else if (ok)
        ok = print_list(listing, proto_json_get(all, listing->name), err);
    proto_json_free(&all);
    return ok ? 0 : 1;
}

int command_presets(const struct options *options, struct sp_error *err) {
    static const struct listing presets = { "presets", { NULL }, 1, 0, add_name };
    return list(options, &presets, err);
}

int command_views(const struct options *options, struct sp_error *err) {
    static const struct listing views = { "views", { "ID", "VOLUME", "SIZE" }, 3, 0, add_view };
    return list(options, &views, err);
}

int command_sessions(const struct options *options, struct sp_error *err) {
    static const struct listing sessions = { "sessions",
                                             { "ID", "VOLUME", "STATE", "PEOPLE", "IDLE, s" },
                                             5,
                                             1 << 3 | 1 << 4,
                                             add_session };
    return list(options, &sessions, err);
}

int command_paths(const struct options *options, struct sp_error *err) {
    static const struct listing paths = {
        "paths", { "ID", "STATE", "FORMAT", "DONE", "FRAMES" }, 5, 1 << 3 | 1 << 4, add_path
    };
    return list(options, &paths, err);
}

/* Reads or deletes one item. Returns the answer, an empty object after a deletion, or NULL. */
static proto_json *get_or_delete(const struct options *options, struct http *http,
                                 const char *collection, struct sp_error *err) {
    char *path = collection_path(http, collection, options->argument, err);
    struct http_response response = { 0 };
    proto_json *json = NULL;
    if (path && options->delete) {
        if (http_request(http, "DELETE", path, "application/json", NULL, &response, err))
            json = proto_json_object();
        http_response_finish(&response);
    } else if (path) {
        json = http_json(http, "GET", path, NULL, err);
    }
    free(path);
    return json;
}

/* Returns {"session", "control", "view"}, the links of a session; NULL when out of memory. */
static proto_json *links_of(struct http *http, const proto_json *session) {
    static const char *const roles[] = { "control", "view" };
    proto_json *links = proto_json_object();
    proto_json_set_string(&links, "session", text_of(session, "id"));
    for (int i = 0; i < 2; i++) {
        char *link = NULL;
        if (asprintf(&link, "%s/#session=%s&token=%s", http_base(http), text_of(session, "id"),
                     text_of(proto_json_get(session, "tokens"), roles[i])) < 0)
            link = NULL;
        proto_json_set(&links, roles[i], link ? proto_json_new_string(link) : NULL);
        free(link);
    }
    return links;
}

static bool print_links(const struct options *options, struct http *http, const proto_json *session,
                        struct sp_error *err) {
    proto_json *links = links_of(http, session);
    bool ok = links || sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    if (ok && options->json)
        ok = print_json(options, links, err);
    else if (ok) {
        printf("session %s\ncontrol %s\nview    %s\n", text_of(links, "session"),
               text_of(links, "control"), text_of(links, "view"));
        ok = end_output(err);
    }
    proto_json_free(&links);
    return ok;
}

static bool print_item(const struct options *options, struct http *http, const proto_json *item,
                       struct sp_error *err) {
    (void)http;
    return print_json(options, item, err);
}

/* Prints or deletes the item that the command line names. */
static int show_or_delete(const struct options *options, const char *collection,
                          bool (*print)(const struct options *options, struct http *http,
                                        const proto_json *item, struct sp_error *err),
                          struct sp_error *err) {
    struct http *http = connect_to_daemon(options, err);
    proto_json *item = http ? get_or_delete(options, http, collection, err) : NULL;
    bool ok = item && (options->delete || print(options, http, item, err));
    proto_json_free(&item);
    http_destroy(&http);
    return ok ? 0 : 1;
}

int command_session(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("session",
                           "give the id of a session; \"splatctl sessions\" lists the ids");
    return show_or_delete(options, "sessions", print_links, err);
}

int command_saved(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("saved", "needs the id of a saved view; \"splatctl views\" lists them");
    return show_or_delete(options, "views", print_item, err);
}

/* Stores the view of the command line as a preset. */
static bool put_preset(const struct options *options, struct http *http, struct sp_error *err) {
    proto_json *view = read_view(options, http, err);
    char *text = view ? proto_json_to_text(view, NULL) : NULL;
    char *path = text ? collection_path(http, "presets", options->argument, err) : NULL;
    struct http_response response = { 0 };
    bool ok = path && http_request(http, "PUT", path, "application/json", text, &response, err);
    if (view && !text)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    http_response_finish(&response);
    free(path);
    free(text);
    proto_json_free(&view);
    return ok;
}

int command_preset(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("preset", "needs a name; \"splatctl presets\" lists them");
    if (options->view && options->delete)
        return usage_error("preset", "takes either --view or --delete");
    if (!options->view)
        return show_or_delete(options, "presets", print_item, err);
    struct http *http = connect_to_daemon(options, err);
    bool ok = http && put_preset(options, http, err);
    http_destroy(&http);
    return ok ? 0 : 1;
}

/* Posts the view of the command line with --volume, if given, or an object with the view as
 * `member`. NULL with *err set on failure. */
static proto_json *post_view(const struct options *options, struct http *http, const char *path,
                             const char *member, struct sp_error *err) {
    proto_json *view = read_view(options, http, err);
    char *volume = view && options->volume
                       ? resolve_volume(http, options, options->volume, false, true, err)
                       : NULL;
    if (!view || (options->volume && !volume)) {
        proto_json_free(&view);
        return NULL;
    }
    if (volume)
        proto_json_set_string(&view, "volume", volume);
    free(volume);
    proto_json *body = member ? proto_json_object() : view;
    if (member)
        proto_json_set(&body, member, view);
    return http_post(http, path, body, NULL, NULL, err);
}

int command_save(const struct options *options, struct sp_error *err) {
    if (options->argument)
        return usage_error(options->argument, "save takes options only; did you mean --volume?");
    struct http *http = connect_to_daemon(options, err);
    proto_json *saved = http ? post_view(options, http, "/views", NULL, err) : NULL;
    return print_id(options, http, saved, err);
}

/* Creates a session from the view of another session or from a saved view. */
static proto_json *fork_session(const char *from, struct http *http, struct sp_error *err) {
    proto_json *body = proto_json_object();
    proto_json_set_string(&body, "from", from);
    return http_post(http, "/sessions", body, NULL, NULL, err);
}

int command_share(const struct options *options, struct sp_error *err) {
    if (options->argument && (options->view || options->volume))
        return usage_error("share", "takes either an id or a view");
    struct http *http = connect_to_daemon(options, err);
    proto_json *session = !http               ? NULL
                          : options->argument ? fork_session(options->argument, http, err)
                                              : post_view(options, http, "/sessions", "view", err);
    bool ok = session && print_links(options, http, session, err);
    proto_json_free(&session);
    http_destroy(&http);
    return ok ? 0 : 1;
}
