/* SPDX-License-Identifier: Apache-2.0 */
#include "render/catalog.h"

#include <assert.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "common/clock.h"
#include "common/fair_share.h"
#include "render/array_memory.h"
#include "render/catalog_private.h"
#include "render/redact.h"
#include "render/source.h"
#include "sp/log.h"

enum { ENTRIES_MAX = 1024, LOADS_MAX = 8 }; /* LOADS_MAX: of one limited owner */

const char *srv_volume_state_name(enum srv_volume_state state) {
    static const char *const names[] = { "loading", "ready", "failed", "unloaded" };
    return names[state];
}

void srv_catalog_redact(const struct srv_catalog *catalog, const struct srv_volume *v,
                        struct sp_error *err) {
    if (v->file) {
        const char *name = v->public_name + strlen(SRV_SOURCE_UPLOAD);
        struct sp_error whole = *err;
        srv_redact_folder(v->file, name, whole.place, err->place, sizeof err->place);
        srv_redact_folder(v->file, name, whole.text, err->text, sizeof err->text);
        srv_redact_text(NULL, v->file, err->place, sizeof err->place);
        srv_redact_text(NULL, v->file, err->text, sizeof err->text);
        return;
    }
    srv_redact_text(catalog->data, v->source, err->place, sizeof err->place);
    srv_redact_text(catalog->data, v->source, err->text, sizeof err->text);
}

void srv_catalog_entry_free(struct srv_volume *v) {
    while (v->steps) {
        struct srv_volume *step = v->steps;
        v->steps = step->next;
        srv_catalog_entry_free(step);
    }
    sp_volume_unref(&v->volume);
    srv_array_memory_destroy(&v->memory);
    free(v->joint);
    free(v->source);
    free(v->file);
    free(v->public_name);
    free(v);
}

void srv_catalog_close_upload(struct srv_catalog *catalog, const char *source,
                              enum srv_volume_state state) {
    char id[SP_NAME_BYTES];
    if (srv_source_upload_id(source, id))
        catalog->options.upload_close(catalog->options.user, id, state);
}

/* True if an entry other than `own` needs the upload of a source: it shows another field of it.
 * With the mutex held. */
static bool is_upload_shared(const struct srv_catalog *catalog, const struct srv_volume *own,
                             const char *source) {
    char id[SP_NAME_BYTES], other[SP_NAME_BYTES];
    if (!srv_source_upload_id(source, id))
        return false;
    for (const struct srv_volume *v = catalog->entries; v; v = v->next)
        if (v != own && srv_source_upload_id(v->source, other) && strcmp(id, other) == 0)
            return true;
    return false;
}

char *srv_catalog_upload_to_close(const struct srv_catalog *catalog, const struct srv_volume *v) {
    const bool is_own = srv_source_is_upload(v->source) && !is_upload_shared(catalog, v, v->source);
    return is_own ? strdup(v->source) : NULL;
}

/* malloc'ed; NULL with errno set. */
static char *real_folder(const char *path) {
    char *real = realpath(path, NULL);
    struct stat found;
    if (real && (stat(real, &found) != 0 || !S_ISDIR(found.st_mode))) {
        free(real);
        real = NULL;
        errno = ENOTDIR;
    }
    return real;
}

struct srv_catalog *srv_catalog_create(const struct srv_catalog_options *options,
                                       struct sp_error *err) {
    struct srv_catalog *catalog = calloc(1, sizeof *catalog);
    if (!catalog) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the catalog");
        return NULL;
    }
    catalog->options = *options;
    if (options->data && !(catalog->data = real_folder(options->data))) {
        sp_fail(err, SP_ERR_IO, options->data, "cannot use this folder for --data: %s",
                strerror(errno));
        free(catalog);
        return NULL;
    }
    pthread_mutex_init(&catalog->mutex, NULL);
    pthread_mutex_init(&catalog->notify_mutex, NULL);
    pthread_mutex_init(&catalog->joint_mutex, NULL);
    pthread_cond_init(&catalog->changed, NULL);
    catalog->brick_memory = sp_brick_memory_create(options->memory_bytes, err);
    if (!catalog->brick_memory || !srv_catalog_start_loaders(catalog, err)) {
        srv_catalog_destroy(&catalog);
        return NULL;
    }
    return catalog;
}

void srv_catalog_stop(struct srv_catalog *catalog) {
    pthread_mutex_lock(&catalog->mutex);
    catalog->stop = true;
    pthread_cond_broadcast(&catalog->changed);
    const unsigned running = catalog->running;
    catalog->running = 0;
    pthread_mutex_unlock(&catalog->mutex);
    for (unsigned i = 0; i < running; i++)
        pthread_join(catalog->loaders[i].thread, NULL);
}

void srv_catalog_destroy(struct srv_catalog **catalog_pointer) {
    struct srv_catalog *catalog = *catalog_pointer;
    *catalog_pointer = NULL;
    if (!catalog)
        return;
    srv_catalog_stop(catalog);
    while (catalog->entries) {
        struct srv_volume *v = catalog->entries;
        catalog->entries = v->next;
        assert(v->uses == 0);
        srv_catalog_entry_free(v);
    }
    sp_brick_memory_unref(&catalog->brick_memory);
    pthread_cond_destroy(&catalog->changed);
    pthread_mutex_destroy(&catalog->mutex);
    pthread_mutex_destroy(&catalog->notify_mutex);
    pthread_mutex_destroy(&catalog->joint_mutex);
    free(catalog->data);
    free(catalog);
}

static void unique_id(struct srv_catalog *catalog, char id[SP_NAME_BYTES]) {
    size_t length = strlen(id);
    for (unsigned i = 2; srv_catalog_entry(catalog, id); i++)
        snprintf(id + length, SP_NAME_BYTES - length, "-%u", i);
}

/* What a request names: strings of malloc(), or NULL (struct srv_volume). */
struct resolved {
    char *source, *file, *public_name;
};

static void resolved_finish(struct resolved *resolved) {
    free(resolved->source);
    free(resolved->file);
    free(resolved->public_name);
}

/* Finds the file of an upload, which stays until upload_close(). */
static bool resolve_upload(struct srv_catalog *catalog, const struct srv_volume_request *request,
                           struct resolved *resolved, struct sp_error *err) {
    char path[PATH_MAX], name[NAME_MAX + 1];
    const char *selection = request->source + sp_source_split(request->source).path_bytes;
    char id[SP_NAME_BYTES];
    srv_source_upload_id(request->source, id);
    if (!catalog->options.upload_open)
        return sp_fail(err, SP_ERR_DENIED, request->pointer, "this daemon takes no uploads");
    if (!catalog->options.upload_open(catalog->options.user, id, path, name, err)) {
        if (err && !err->place[0] && request->pointer)
            snprintf(err->place, sizeof err->place, "%s", request->pointer);
        return false;
    }
    resolved->source = strdup(request->source);
    if (asprintf(&resolved->file, "%s%s", path, selection) < 0)
        resolved->file = NULL;
    if (asprintf(&resolved->public_name, SRV_SOURCE_UPLOAD "%s%s", name, selection) < 0)
        resolved->public_name = NULL;
    if (resolved->source && resolved->file && resolved->public_name)
        return true;
    resolved_finish(resolved);
    *resolved = (struct resolved){ .source = NULL };
    return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
}

/* The key of a remote volume is its address. */
static bool resolve_remote(const struct srv_catalog *catalog,
                           const struct srv_volume_request *request, struct resolved *resolved,
                           struct sp_error *err) {
    struct sp_error why;
    if (!sp_source_check_host(request->source, catalog->options.allowed_hosts, &why)) {
        const char *pointer = request->pointer ? request->pointer : "/path";
        return sp_fail(err, why.code, request->confined ? pointer : why.place, "%s", why.text);
    }
    resolved->source = strdup(request->source);
    return resolved->source || sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
}

static bool resolve_memory(const struct srv_volume_request *request, struct resolved *resolved,
                           struct sp_error *err) {
    const char *name = request->name ? request->name : request->id ? request->id : "array";
    resolved->source = strdup(request->source);
    if (asprintf(&resolved->public_name, SRV_SOURCE_MEMORY "%s", name) < 0)
        resolved->public_name = NULL;
    if (resolved->source && resolved->public_name)
        return true;
    resolved_finish(resolved);
    *resolved = (struct resolved){ .source = NULL };
    return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a name");
}

static bool resolve(struct srv_catalog *catalog, const struct srv_volume_request *request,
                    struct resolved *resolved, struct sp_error *err) {
    if (request->memory)
        return resolve_memory(request, resolved, err);
    if (srv_source_is_upload(request->source))
        return resolve_upload(catalog, request, resolved, err);
    if (sp_source_is_remote(request->source))
        return resolve_remote(catalog, request, resolved, err);
    const char *pointer = request->pointer                      ? request->pointer
                          : srv_source_is_demo(request->source) ? "/uri"
                                                                : "/path";
    resolved->source =
        srv_source_resolve(request->source, request->confined ? pointer : NULL, catalog->data, err);
    return resolved->source != NULL;
}

/* Checks the limits of the owner who loads `again`; NULL = a new entry. With the mutex held. */
static bool fits_the_owner(const struct srv_catalog *catalog,
                           const struct srv_volume_request *request, const struct srv_volume *again,
                           struct sp_error *err) {
    unsigned count = 0, loading = 0;
    for (const struct srv_volume *v = catalog->entries; v && request->owner; v = v->next)
        if (v != again && strcmp(v->owner, request->owner) == 0) {
            count++;
            loading += v->state == SRV_VOLUME_LOADING;
        }
    if (request->volumes_max && count >= request->volumes_max)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "%s has %u volumes open and its token allows %u; close some", request->owner,
                       count, request->volumes_max);
    const struct srv_pool pool = { ENTRIES_MAX, catalog->count - (again != NULL), count };
    if (!request->is_restored &&
        srv_fair_left(&pool, request->is_limited && !request->volumes_max) == 0)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "%s has %u of the %u volumes that can exist; the rest is kept for the "
                       "others; close some",
                       request->owner, count, ENTRIES_MAX);
    return !request->is_limited || request->is_restored || loading < LOADS_MAX ||
           sp_fail(err, SP_ERR_QUOTA, NULL,
                   "%u volumes of %s are being loaded, which is the limit; try again later",
                   loading, request->owner);
}

static void set_owner(struct srv_volume *v, const struct srv_volume_request *request) {
    snprintf(v->owner, sizeof v->owner, "%s", request->owner ? request->owner : "");
    v->is_limited = request->is_limited;
}

/* A failed entry is loaded for the owner who asks now. With the mutex held. */
static bool change_owner(struct srv_catalog *catalog, struct srv_volume *v,
                         const struct srv_volume_request *request, struct sp_error *err) {
    if (!fits_the_owner(catalog, request, v, err))
        return false;
    set_owner(v, request);
    v->is_persisted = false; /* under the new owner */
    return true;
}

/* Appends an entry. With the mutex held. Takes over the strings on success. */
static struct srv_volume *add_entry(struct srv_catalog *catalog,
                                    const struct srv_volume_request *request,
                                    const struct resolved *resolved, bool *conflict,
                                    struct sp_error *err) {
    if (request->id && srv_catalog_entry(catalog, request->id)) {
        *conflict = true;
        sp_fail(err, SP_ERR_INVALID, "/id", "the id '%s' belongs to another volume", request->id);
        return NULL;
    }
    if (catalog->count >= ENTRIES_MAX) {
        sp_fail(err, SP_ERR_BUDGET, NULL, "%u volumes exist, which is the limit; unload one",
                catalog->count);
        return NULL;
    }
    if (!fits_the_owner(catalog, request, NULL, err))
        return NULL;
    struct srv_volume *v = calloc(1, sizeof *v);
    if (!v) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a volume");
        return NULL;
    }
    set_owner(v, request);
    const char *named = resolved->public_name ? resolved->public_name + strlen(SRV_SOURCE_UPLOAD)
                                              : resolved->source;
    if (request->id) {
        snprintf(v->id, sizeof v->id, "%s", request->id);
    } else {
        srv_source_default_id(named, v->id);
        unique_id(catalog, v->id);
    }
    if (request->name || request->id)
        snprintf(v->name, sizeof v->name, "%s", request->name ? request->name : request->id);
    else
        srv_source_default_name(named, v->name);
    v->source = resolved->source;
    v->file = resolved->file;
    v->public_name = resolved->public_name;
    struct srv_volume **link = &catalog->entries;
    while (*link)
        link = &(*link)->next;
    *link = v;
    catalog->count++;
    v->is_persisted = v->is_restored = request->is_restored;
    return v;
}

/* With the mutex held. */
static void persist(struct srv_catalog *catalog, struct srv_volume *v) {
    const struct srv_volume_request request = { .source = v->source,
                                                .id = v->id,
                                                .name = v->name,
                                                .owner = v->owner[0] ? v->owner : NULL,
                                                .is_limited = v->is_limited,
                                                .confined = v->confined };
    if (catalog->options.persist && !v->is_persisted && !srv_source_is_memory(v->source))
        v->is_persisted = catalog->options.persist(catalog->options.user, v->id, &request);
}

/* Queues the load; `why` not NULL = the source is lost, and the entry has failed. With the mutex
 * held. */
static void begin_load(struct srv_catalog *catalog, struct srv_volume *v,
                       struct srv_volume_request *request, const struct sp_error *why) {
    srv_array_memory_destroy(&v->memory);
    v->memory = request->memory;
    request->memory = NULL;
    v->confined = request->confined && !srv_source_is_demo(v->source) && !v->file;
    v->state = why ? SRV_VOLUME_FAILED : SRV_VOLUME_LOADING;
    v->error = why ? *why : (struct sp_error){ .code = SP_OK };
    srv_catalog_redact(catalog, v, &v->error);
    v->progress = 0;
    pthread_cond_broadcast(&catalog->changed);
}

static bool add(struct srv_catalog *catalog, struct srv_volume_request *request,
                char id_out[SP_NAME_BYTES], bool *existed, bool *conflict, struct sp_error *err) {
    *conflict = *existed = false;
    if (request->id && !srv_source_is_id(request->id))
        return sp_fail(err, SP_ERR_INVALID, "/id",
                       "must be 1 to %d characters of [A-Za-z0-9._-], and not '.' or '..'",
                       SP_NAME_BYTES - 1);
    struct sp_error why = { .code = SP_OK };
    struct resolved resolved = { .source = NULL };
    bool is_lost = !resolve(catalog, request, &resolved, &why);
    if (is_lost && why.code != SP_ERR_MEMORY && request->is_restored)
        resolved.source = strdup(request->source);
    if (!resolved.source) {
        if (err)
            *err = why;
        return false;
    }
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *found = catalog->entries;
    while (found && strcmp(found->source, resolved.source) != 0)
        found = found->next;
    *existed = found && found->state != SRV_VOLUME_FAILED;
    struct srv_volume *v = !found ? add_entry(catalog, request, &resolved, conflict, err)
                           : *existed || change_owner(catalog, found, request, err) ? found
                                                                                    : NULL;
    if (!v) {
        const bool is_shared = is_upload_shared(catalog, found, resolved.source);
        pthread_mutex_unlock(&catalog->mutex);
        if (!is_shared)
            srv_catalog_close_upload(catalog, resolved.source, SRV_VOLUME_LOADING);
        resolved_finish(&resolved);
        return false;
    }
    if (found)
        resolved_finish(&resolved);
    if (!*existed)
        begin_load(catalog, v, request, is_lost ? &why : NULL);
    persist(catalog, v);
    memcpy(id_out, v->id, sizeof v->id);
    pthread_mutex_unlock(&catalog->mutex);
    return true;
}

bool srv_catalog_add(struct srv_catalog *catalog, const struct srv_volume_request *request,
                     char id_out[SP_NAME_BYTES], bool *existed, bool *conflict,
                     struct sp_error *err) {
    struct srv_volume_request own = *request;
    const bool ok = add(catalog, &own, id_out, existed, conflict, err);
    srv_array_memory_destroy(&own.memory);
    return ok;
}

static void share(struct srv_catalog *catalog) {
    const uint64_t budget = catalog->options.memory_bytes, used = catalog->used_bytes;
    sp_brick_memory_set(catalog->brick_memory, budget > used ? budget - used : 0);
}

uint64_t srv_catalog_free_bytes(struct srv_catalog *catalog) {
    struct sp_brick_usage usage;
    sp_brick_memory_usage(catalog->brick_memory, &usage);
    const uint64_t budget = catalog->options.memory_bytes;
    const uint64_t loads = usage.files ? budget - budget / 8 : budget;
    return loads > catalog->used_bytes ? loads - catalog->used_bytes : 0;
}

void srv_catalog_acquire_bytes(struct srv_catalog *catalog, struct srv_volume *volume,
                               uint64_t bytes) {
    catalog->used_bytes += bytes;
    volume->reserved_bytes += bytes;
    share(catalog);
}

void srv_catalog_release_bytes(struct srv_catalog *catalog, struct srv_volume *volume) {
    catalog->used_bytes -= volume->reserved_bytes;
    volume->reserved_bytes = 0;
    share(catalog);
}

void srv_catalog_free_removed(struct srv_catalog *catalog, struct srv_volume *v) {
    pthread_mutex_lock(&catalog->mutex);
    srv_catalog_release_bytes(catalog, v);
    for (struct srv_volume *step = v->steps; step; step = step->next)
        srv_catalog_release_bytes(catalog, step);
    pthread_mutex_unlock(&catalog->mutex);
    for (const struct srv_volume *step = v->steps; step; step = step->next)
        if (step->volume)
            catalog->options.unloaded(catalog->options.user, sp_volume_ref(step->volume));
    if (v->volume)
        catalog->options.unloaded(catalog->options.user, sp_volume_ref(v->volume));
    srv_catalog_entry_free(v);
}

bool srv_catalog_remove(struct srv_catalog *catalog, const char *id, const char *by,
                        struct sp_error *err) {
    pthread_mutex_lock(&catalog->notify_mutex);
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume **link = &catalog->entries;
    while (*link && strcmp((*link)->id, id) != 0)
        link = &(*link)->next;
    struct srv_volume *v = *link;
    if (!v || (by && strcmp(v->owner, by) != 0)) {
        bool is_there = v != NULL;
        pthread_mutex_unlock(&catalog->mutex);
        pthread_mutex_unlock(&catalog->notify_mutex);
        return is_there ? sp_fail(err, SP_ERR_DENIED, NULL,
                                  "another token or the operator opened the volume '%s'; that "
                                  "token or an admin may close it",
                                  id)
                        : sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no volume '%s'", id);
    }
    bool is_loading = v->is_loading, is_free = !is_loading && v->uses == 0;
    v->is_removed = true;
    *link = v->next;
    if (catalog->options.persist)
        catalog->options.persist(catalog->options.user, v->id, NULL);
    catalog->count--;
    if (is_loading) /* its load is cancelled and reserves no more */
        srv_catalog_release_bytes(catalog, v);
    char *upload = is_loading ? NULL : srv_catalog_upload_to_close(catalog, v);
    unsigned uses = v->uses;
    const bool has_failed_steps = srv_catalog_fail_steps(v);
    pthread_mutex_unlock(&catalog->mutex);
    catalog->options.progress(catalog->options.user, id, SRV_VOLUME_UNLOADED, 0, "");
    pthread_mutex_unlock(&catalog->notify_mutex);
    if (has_failed_steps && catalog->options.step)
        catalog->options.step(catalog->options.user, id);
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "volume", id }), "volume %s unloaded, %u uses left",
                id, uses);
    if (is_free)
        srv_catalog_free_removed(catalog, v);
    if (upload)
        srv_catalog_close_upload(catalog, upload, SRV_VOLUME_UNLOADED);
    free(upload);
    return true;
}
