/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses the backend of a renderer from the registry. Nothing here knows a backend by its name.
 */
#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "backend/backend.h"
#include "backend/check.h"
#include "sp/inflight.h"
#include "sp/log.h"
#include "sp/probe.h"

const struct sp_backend_entry *sp_backend_at(unsigned i) {
    const struct sp_backend *backend = sp_registry_at(i);
    return backend ? &backend->entry : NULL;
}

/* Returns the backend that images of a GPU are compared with: the first that "auto" may choose and
 * that needs no GPU. */
static const struct sp_backend *find_reference(void) {
    const struct sp_backend *backend;
    for (unsigned i = 0; (backend = sp_registry_at(i)); i++)
        if (!backend->is_gpu && !backend->by_name_only)
            break;
    return backend;
}

/* The check that a GPU must pass before it is used. */
struct trial {
    const struct sp_backend *backend, *reference;
    const struct sp_backend_options *options;
    bool was_asked;
};

static bool passes(void *user, void *state, struct sp_error *err) {
    struct trial *trial = user;
    trial->was_asked = true;
    return sp_backend_check(trial->backend, state, trial->reference, trial->options, err);
}

/* Returns the options with the check, if there is a reference to compare with. */
static struct sp_backend_options add_trial(struct trial *trial) {
    struct sp_backend_options options = *trial->options;
    trial->reference = trial->backend->is_gpu ? find_reference() : NULL;
    options.passes = trial->reference ? passes : NULL;
    options.user = trial;
    return options;
}

void sp_registry_probe(const struct sp_backend *backend, const struct sp_backend_options *options,
                       sp_device_visit *visit, void *user) {
    struct trial trial = { .backend = backend, .options = options };
    const struct sp_backend_options own = add_trial(&trial);
    if (backend->probe)
        backend->probe(&own, visit, user);
}

static bool start(const struct sp_backend *backend, const struct sp_backend_options *options,
                  void **state, struct sp_error *err) {
    assert(backend->create && backend->destroy && backend->info && backend->render);
    assert(backend->depth != 1 && backend->depth <= SP_IN_FLIGHT_MAX);
    assert(!backend->depth == !backend->begin && !backend->begin == !backend->finish);
    struct sp_error why = { .code = SP_ERR_BACKEND };
    struct trial trial = { .backend = backend, .options = options };
    const struct sp_backend_options own = add_trial(&trial);
    *state = backend->create(&own, &why);
    assert(!*state || trial.was_asked == !!trial.reference);
    if (*state)
        return true;
    sp_log(SP_LOG_WARN, "backend %s does not start: %s", backend->entry.name, why.text);
    if (options->refused)
        options->refused(options->refused_user, backend->entry.name, &why);
    return sp_fail(err, why.code, why.place, "backend %s does not start: %s", backend->entry.name,
                   why.text);
}

/* Starts the first backend that "auto" may choose, from registry entry i on. */
static const struct sp_backend *start_any(unsigned i, const struct sp_backend_options *options,
                                          void **state, struct sp_error *err) {
    sp_fail(err, SP_ERR_BACKEND, "",
            options->require_gpu ? "a GPU is required, but this build has no GPU backend"
                                 : "no backend starts automatically; name one with --backend");
    for (const struct sp_backend *backend; (backend = sp_registry_at(i)); i++)
        if (!backend->by_name_only && (backend->is_gpu || !options->require_gpu) &&
            start(backend, options, state, err))
            return backend;
    return NULL;
}

static const struct sp_backend *fail_unknown(const char *name, struct sp_error *err) {
    char names[256];
    size_t used = (size_t)snprintf(names, sizeof names, "auto");
    for (unsigned i = 0; sp_backend_at(i) && used < sizeof names; i++)
        used += (size_t)snprintf(names + used, sizeof names - used, ", %s", sp_backend_at(i)->name);
    sp_fail(err, SP_ERR_INVALID, "", "unknown backend \"%.64s\"; available: %s", name, names);
    return NULL;
}

const struct sp_backend *sp_registry_start(const char *name,
                                           const struct sp_backend_options *options, void **state,
                                           struct sp_error *err) {
    if (strcmp(name, "auto") == 0)
        return start_any(0, options, state, err);
    const struct sp_backend *backend;
    for (unsigned i = 0; (backend = sp_registry_at(i)); i++)
        if (strcmp(name, backend->entry.name) == 0)
            break;
    if (!backend)
        return fail_unknown(name, err);
    if (options->require_gpu && !backend->is_gpu) {
        sp_fail(err, SP_ERR_INVALID, "", "a GPU is required, but backend %s does not use one",
                name);
        return NULL;
    }
    return start(backend, options, state, err) ? backend : NULL;
}

const struct sp_backend *sp_registry_follow(const struct sp_backend *failed,
                                            const struct sp_backend_options *options, void **state,
                                            struct sp_error *err) {
    unsigned i = 0;
    while (sp_registry_at(i) != failed)
        i++;
    return start_any(i + 1, options, state, err);
}
