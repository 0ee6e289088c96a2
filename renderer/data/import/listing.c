/* SPDX-License-Identifier: Apache-2.0
 *
 * The parent's side of a list of series. splat-import reads the files.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "data/import/child.h"
#include "data/import/input.h"
#include "sp/series.h"

enum { TIMEOUT_DEFAULT_MS = 300000 };

struct listing {
    struct sp_import_place place;
    struct sp_import_input input;
    struct sp_import_child child;
    char importer[PATH_MAX];
    int timeout_ms;
    double deadline_ms;
    struct sp_series *list; /* the caller's */
    uint32_t count;
};

static bool check_time(void *user, struct sp_error *err) {
    const struct listing *l = user;
    return sp_clock_ms() < l->deadline_ms ||
           sp_fail(err, SP_ERR_TIMEOUT, l->place.path,
                   "listing the series took longer than the timeout of %d ms; open a folder with "
                   "fewer files",
                   l->timeout_ms);
}

static bool start(struct listing *l, struct sp_error *err) {
    const struct sp_source_parts parts = { .level = -1, .field = "" };
    const struct sp_import_request request = { .path = l->place.path,
                                               .root = l->place.root,
                                               .folder = l->input.folder,
                                               .pattern = "",
                                               .parts = &parts,
                                               .mode = SP_IMPORT_LIST };
    l->child = (struct sp_import_child){ .title = l->place.path, .timeout_ms = l->timeout_ms };
    const bool ok = sp_import_child_start_reader(&l->child, l->importer, &request, NULL,
                                                 l->input.fds, l->input.count, err);
    sp_import_input_hand_over(&l->input);
    return ok;
}

static bool receive(struct listing *l, struct sp_error *err) {
    struct sp_handover message;
    bool ended;
    for (;;) {
        if (!sp_import_child_receive(&l->child, &message, check_time, l, &ended, err))
            return ended ? sp_import_child_fail_ended(&l->child, err) : false;
        if (message.kind == SP_HANDOVER_DONE)
            return true;
        if (message.kind != SP_HANDOVER_SERIES || l->count == SP_SERIES_MAX)
            return sp_import_child_refuse(&l->child, &message, err);
        l->list[l->count++] = message.series;
    }
}

bool sp_series_list(const char *path, const struct sp_load_options *options, struct sp_series *list,
                    uint32_t *count, struct sp_error *err) {
    static const struct sp_load_options none;
    const struct sp_load_options *how = options ? options : &none;
    struct listing *l = calloc(1, sizeof *l);
    *count = 0;
    if (!l)
        return sp_fail(err, SP_ERR_MEMORY, path, "out of memory for a list");
    l->timeout_ms = how->timeout_ms ? how->timeout_ms : TIMEOUT_DEFAULT_MS;
    l->deadline_ms = sp_clock_ms() + l->timeout_ms;
    l->list = list;
    l->input.fds[0] = l->input.fds[1] = l->input.fetch.socket = l->input.fetch.memory = -1;
    l->child.memory = l->child.socket = -1;
    bool ok =
        (size_t)snprintf(l->place.path, sizeof l->place.path, "%s", path) < sizeof l->place.path ||
        sp_fail(err, SP_ERR_INVALID, path, "the path has more than %d bytes, the limit",
                PATH_MAX - 1);
    ok = ok && sp_import_place_resolve(&l->place, how->root, err);
    if (ok && !l->place.is_remote)
        ok = sp_import_find_program("splat-import", how->importer, l->importer, err) &&
             sp_import_input_open(&l->input, &l->place, l->importer, NULL, err) && start(l, err) &&
             receive(l, err);
    *count = ok ? l->count : 0;
    sp_import_child_close(&l->child);
    sp_import_input_close(&l->input);
    free(l);
    return ok;
}
