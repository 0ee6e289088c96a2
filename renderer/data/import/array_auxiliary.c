/* SPDX-License-Identifier: Apache-2.0
 *
 * Auxiliary coordinates (CF): an array of coordinates with another name than its dimension.
 */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "data/import/array_reader.h"

/* True if the list "a b c" has the word. */
static bool has_word(const char *list, const char *word) {
    const size_t length = strlen(word);
    for (const char *at = length > 0 ? strstr(list, word) : NULL; at; at = strstr(at + 1, word))
        if ((at == list || at[-1] == ' ') && (at[length] == ' ' || !at[length]))
            return true;
    return false;
}

/* Calls `visit` with each array that the attribute "coordinates" names, until it returns true. */
static void visit_named(const struct arrays *a,
                        bool (*visit)(void *user, unsigned n, const struct array_info *info,
                                      const char *name),
                        void *user) {
    struct array_info info;
    char text[512];
    a->call->text(a->handle, a->chosen, "coordinates", text, sizeof text);
    for (unsigned n = 0; *text && a->call->describe(a->handle, n, &info); n++) {
        const char *slash = strrchr(info.name, '/'), *own = slash ? slash + 1 : info.name;
        if (info.is_number && has_word(text, own) && visit(user, n, &info, own))
            return;
    }
}

/* The arrays along one dimension. */
struct along {
    const struct arrays *arrays;
    unsigned dimension;
    int found[ARRAYS_ROLE_CHANNEL + 1]; /* the array of each role; −1 = none */
    unsigned count;
    char names[2][40];
};

static bool is_along(const struct arrays *a, unsigned d, const struct array_info *info) {
    return info->rank == 1 && info->shape[0] == a->info.shape[d] && *a->info.dims[d] &&
           strcmp(info->dims[0], a->info.dims[d]) == 0;
}

static bool note_along(void *user, unsigned n, const struct array_info *info, const char *name) {
    struct along *l = user;
    if (!is_along(l->arrays, l->dimension, info))
        return false;
    const enum arrays_role role = arrays_role_of(l->arrays, (int)n, name);
    if (role != ARRAYS_ROLE_NONE && l->found[role] < 0) {
        l->found[role] = (int)n;
        if (l->count < 2)
            snprintf(l->names[l->count], sizeof l->names[0], "%.39s", name);
        l->count++;
    }
    return false;
}

static void list_along(const struct arrays *a, unsigned d, struct along *l) {
    *l = (struct along){ .arrays = a, .dimension = d };
    for (int role = 0; role <= ARRAYS_ROLE_CHANNEL; role++)
        l->found[role] = -1;
    visit_named(a, note_along, l);
}

int arrays_find_auxiliary(const struct arrays *a, unsigned d) {
    struct array_info info;
    struct along l;
    char unit[64];
    list_along(a, d, &l);
    for (int role = 0; l.count == 1 && role <= ARRAYS_ROLE_CHANNEL; role++)
        if (l.found[role] >= 0)
            return l.found[role];
    for (unsigned n = 0; l.count == 0 && a->call->describe(a->handle, n, &info); n++) {
        if (n == a->chosen || !info.is_number || !is_along(a, d, &info))
            continue;
        a->call->text(a->handle, n, "units", unit, sizeof unit);
        if (strstr(unit, " since "))
            return (int)n;
    }
    return -1;
}

bool arrays_check_cells(const struct arrays *a, struct sp_error *err) {
    char grid[32], mesh[64], location[16];
    a->call->text(a->handle, a->chosen, "CDI_grid_type", grid, sizeof grid);
    a->call->text(a->handle, a->chosen, "mesh", mesh, sizeof mesh);
    a->call->text(a->handle, a->chosen, "location", location, sizeof location);
    return (strcasecmp(grid, "unstructured") != 0 && !(*mesh && *location)) ||
           arrays_fail(a, err, SP_ERR_UNSUPPORTED,
                       "the samples lie on the cells of an unstructured grid, which is not "
                       "supported; interpolate them to a regular grid, for example with "
                       "cdo remapbil");
}

/* Two coordinates along one dimension: each entry has a place of its own. */
static bool warn_of_points(const struct arrays *a) {
    struct along l;
    for (unsigned d = 0; d < a->info.rank; d++) {
        list_along(a, d, &l);
        if (a->info.shape[d] > 1 && l.found[ARRAYS_ROLE_X] >= 0 && l.found[ARRAYS_ROLE_Y] >= 0) {
            import_warn(a->file->warnings,
                        "The coordinates %s and %s place each entry of the dimension %.60s on its "
                        "own, as points or a track; the entries are shown in a row.",
                        l.names[0], l.names[1], a->info.dims[d]);
            return true;
        }
    }
    return false;
}

static bool warn_of_curves(void *user, unsigned n, const struct array_info *info,
                           const char *name) {
    const struct arrays *a = user;
    (void)n;
    if (info->rank < 2)
        return false;
    import_warn(a->file->warnings,
                "The coordinates %.40s have %u dimensions: the array is shown on an even grid of "
                "its indices.",
                name, info->rank);
    return true;
}

/* Times and other coordinates of a dimension that are text. */
static void warn_of_text(const struct arrays *a) {
    struct array_info info;
    const int d = a->axes.time;
    for (unsigned n = 0; d >= 0 && !a->times && a->call->describe(a->handle, n, &info); n++) {
        const char *slash = strrchr(info.name, '/'), *own = slash ? slash + 1 : info.name;
        if (info.rank == 0 && !info.is_alias && a->info.shape[d] > 1 &&
            (strcasecmp(own, a->info.dims[d]) == 0 || strcmp(own, "Times") == 0)) {
            import_warn(a->file->warnings,
                        "The times in %.60s were left out: %.80s; the steps are numbered.", own,
                        info.problem);
            return;
        }
    }
}

void arrays_warn_of_auxiliary(const struct arrays *a) {
    const bool is_placed = a->is_placed[0] && (a->is_placed[1] || a->axes.space[1] < 0);
    if (!warn_of_points(a) && !is_placed)
        visit_named(a, warn_of_curves, (void *)(uintptr_t)a);
    warn_of_text(a);
}
