/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "backend/backend.h"
#include "sp/log.h"

extern const struct sp_backend cpu_backend, null_backend;

/* In the order in which "auto" tries them. */
static const struct sp_backend *const backends[] = { &cpu_backend, &null_backend };
enum { BACKENDS = sizeof backends / sizeof backends[0] };

const struct sp_backend *sp_registry_at(unsigned i) {
    return i < BACKENDS ? backends[i] : NULL;
}

const struct sp_backend_entry *sp_backend_at(unsigned i) {
    return i < BACKENDS ? &backends[i]->entry : NULL;
}

static void list_names(char *text, size_t size) {
    size_t used = (size_t)snprintf(text, size, "auto");
    for (unsigned i = 0; i < BACKENDS && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, ", %s", backends[i]->entry.name);
}

static void *start(const struct sp_backend *backend, const struct sp_backend_options *options,
                   struct sp_error *err) {
    assert(backend->create && backend->destroy && backend->info && backend->render);
    struct sp_error why = { .code = SP_ERR_BACKEND };
    void *state = backend->create(options, &why);
    if (!state) {
        sp_log(SP_LOG_WARN, "backend %s does not start: %s", backend->entry.name, why.text);
        sp_fail(err, why.code, why.place, "backend %s does not start: %s", backend->entry.name,
                why.text);
    }
    return state;
}

const struct sp_backend *sp_registry_start(const char *name,
                                           const struct sp_backend_options *options, void **state,
                                           struct sp_error *err) {
    bool any = strcmp(name, "auto") == 0, known = any;
    if (any)
        sp_fail(err, SP_ERR_BACKEND, "", "no backend starts by itself; name one");
    for (unsigned i = 0; i < BACKENDS; i++) {
        const struct sp_backend *backend = backends[i];
        if (any ? backend->by_name_only : strcmp(name, backend->entry.name) != 0)
            continue;
        known = true;
        *state = start(backend, options, err);
        if (*state)
            return backend;
    }
    if (!known) {
        char names[256];
        list_names(names, sizeof names);
        sp_fail(err, SP_ERR_INVALID, "", "no backend is called \"%.64s\"; there are %s", name,
                names);
    }
    return NULL;
}
