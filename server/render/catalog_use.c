/* SPDX-License-Identifier: Apache-2.0
 *
 * The catalog for its readers: status of volumes, and counted uses.
 */
#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/catalog_private.h"
#include "render/redact.h"
#include "render/source.h"
#include "sp/bricks.h"
#include "sp/edit.h"

struct srv_volume *srv_catalog_entry(struct srv_catalog *catalog, const char *id) {
    struct srv_volume *v = catalog->entries;
    while (v && strcmp(v->id, id) != 0)
        v = v->next;
    return v;
}

static void status_of(const struct srv_catalog *catalog, const struct srv_volume *v,
                      struct srv_volume_status *status) {
    memcpy(status->id, v->id, sizeof v->id);
    memcpy(status->name, v->name, sizeof v->name);
    memcpy(status->owner, v->owner, sizeof v->owner);
    if (v->public_name)
        snprintf(status->source, sizeof status->source, "%s", v->public_name);
    else
        srv_redact_source(catalog->data, v->source, status->source, sizeof status->source);
    status->state = v->state;
    status->progress = v->progress;
    status->error = v->error;
    status->volume = v->volume ? sp_volume_ref(v->volume) : NULL;
    status->cached_bytes = 0;
    status->step_bytes = 0;
    memcpy(status->cached_per_renderer, v->cached_bytes, sizeof status->cached_per_renderer);
    for (const struct srv_volume *s = v->steps; s; s = s->next) {
        status->step_bytes += s->reserved_bytes;
        for (int r = 0; r < SRV_RENDERERS; r++)
            status->cached_per_renderer[r] += s->cached_bytes[r];
    }
    status->voxel_bytes = v->reserved_bytes + status->step_bytes;
    for (int r = 0; r < SRV_RENDERERS; r++)
        status->cached_bytes += status->cached_per_renderer[r];
    status->uses = v->uses;
}

bool srv_catalog_at(struct srv_catalog *catalog, unsigned i, struct srv_volume_status *status) {
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = catalog->entries;
    while (v && i-- > 0)
        v = v->next;
    if (v)
        status_of(catalog, v, status);
    pthread_mutex_unlock(&catalog->mutex);
    return v != NULL;
}

bool srv_catalog_find(struct srv_catalog *catalog, const char *id,
                      struct srv_volume_status *status) {
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = srv_catalog_entry(catalog, id);
    if (v)
        status_of(catalog, v, status);
    pthread_mutex_unlock(&catalog->mutex);
    return v != NULL;
}

const char *srv_catalog_data(const struct srv_catalog *catalog) {
    return catalog->data;
}

bool srv_catalog_allows_hosts(const struct srv_catalog *catalog) {
    return catalog->options.allowed_hosts && catalog->options.allowed_hosts[0];
}

void srv_catalog_memory(struct srv_catalog *catalog, uint64_t *used, uint64_t *budget,
                        uint64_t *brick_bytes) {
    struct sp_brick_usage usage;
    sp_brick_memory_usage(catalog->brick_memory, &usage);
    *brick_bytes = usage.bytes;
    pthread_mutex_lock(&catalog->mutex);
    *used = catalog->used_bytes;
    *budget = catalog->options.memory_bytes;
    pthread_mutex_unlock(&catalog->mutex);
}

struct srv_volume *srv_catalog_acquire(void *user, const char *id, struct sp_error *err) {
    struct srv_catalog *catalog = user;
    struct srv_volume *found;
    pthread_mutex_lock(&catalog->mutex);
    if (id && *id) {
        found = srv_catalog_entry(catalog, id);
    } else {
        found = catalog->entries; /* the first entry that is ready, else the first one */
        for (struct srv_volume *v = found; v; v = v->next)
            if (v->state == SRV_VOLUME_READY) {
                found = v;
                break;
            }
    }
    if (!found && id && *id)
        sp_fail(err, SP_ERR_VOLUME_UNKNOWN, "/volume", "there is no volume '%s'", id);
    else if (!found)
        sp_fail(err, SP_ERR_VOLUME_UNKNOWN, "/volume",
                "no volume is loaded; load one with POST /api/v1/volumes");
    else if (found->state == SRV_VOLUME_LOADING)
        sp_fail(err, SP_ERR_NOT_READY, "/volume", "the volume '%s' is still loading (%.0f %%)",
                found->id, found->progress * 100);
    else if (found->state == SRV_VOLUME_FAILED)
        sp_fail(err, SP_ERR_VOLUME_FAILED, "/volume", "the volume '%s' failed to load: %.300s",
                found->id, found->error.text);
    bool ok = found && found->state == SRV_VOLUME_READY;
    if (ok)
        found->uses++;
    pthread_mutex_unlock(&catalog->mutex);
    return ok ? found : NULL;
}

struct srv_volume *srv_catalog_ref(void *user, struct srv_volume *v) {
    struct srv_catalog *catalog = user;
    pthread_mutex_lock(&catalog->mutex);
    v->uses++;
    if (v->parent)
        v->parent->uses++;
    pthread_mutex_unlock(&catalog->mutex);
    return v;
}

bool srv_catalog_let_go(struct srv_volume *v, struct srv_volume **dropped) {
    struct srv_volume *entry = v->parent ? v->parent : v;
    assert(v->uses > 0 && entry->uses > 0);
    *dropped = NULL;
    entry->uses--;
    if (v->parent) {
        v->uses--;
        *dropped = srv_catalog_drop_step(v);
    }
    return entry->uses == 0 && entry->is_removed;
}

void srv_catalog_release(void *user, struct srv_volume *v) {
    struct srv_catalog *catalog = user;
    struct srv_volume *entry = v->parent ? v->parent : v, *dropped;
    pthread_mutex_lock(&catalog->mutex);
    const bool is_last = srv_catalog_let_go(v, &dropped);
    pthread_mutex_unlock(&catalog->mutex);
    srv_catalog_free_steps(catalog, dropped);
    if (is_last)
        srv_catalog_free_removed(catalog, entry);
}

void srv_catalog_default_view(void *user, struct srv_volume *volume, struct sp_view *view) {
    (void)user;
    *view = srv_catalog_entry_of(volume)->view;
}

double srv_catalog_spacing(void *user, struct srv_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume->volume);
    const double *spacing = info->whole.dims[0] ? info->whole.spacing : info->grid.spacing;
    (void)user;
    return fmin(fmin(spacing[0], spacing[1]), spacing[2]);
}

bool srv_catalog_fits(void *user, struct srv_volume *volume, const struct sp_view *view,
                      struct sp_error *err) {
    (void)user;
    return sp_view_fits(view, sp_volume_info(volume->volume), err);
}

bool srv_catalog_pick(void *user, struct srv_volume *volume, const struct sp_view *view,
                      const uint32_t size[2], const double at[2], struct sp_pick *pick,
                      struct sp_error *err) {
    struct sp_volume *edited = sp_edit_volume_made(volume->volume, view);
    struct srv_loaded_search others = { .catalog = user,
                                        .volume = volume,
                                        .step = view->time.step };
    const struct sp_pick_input input = { .volume = edited,
                                         .view = view,
                                         .size = { size[0], size[1] },
                                         .at = { at[0], at[1] },
                                         .find = srv_catalog_find_loaded,
                                         .user = &others };
    const bool ok = sp_pick_at(&input, pick, err);
    sp_volume_unref(&edited);
    return ok;
}

struct sp_volume *srv_measured_samples(struct sp_volume *volume, const struct sp_measure *measure,
                                       unsigned *level, struct sp_error *err) {
    enum { READ_MS = 10000 };
    const double(*p)[3] = measure->points;
    const bool is_ellipse = measure->kind == SP_MEASURE_ELLIPSE;
    double points[4][3];
    *level = 0;
    /* These need no samples, or all of them. */
    if (measure->kind == SP_MEASURE_DISTANCE || measure->kind == SP_MEASURE_ANGLE ||
        sp_measure_has_range(measure->kind)) {
        *level = sp_measure_has_range(measure->kind) ? sp_bricks_base(volume) : 0;
        return sp_volume_ref(volume);
    }
    memcpy(points, p, sizeof measure->points);
    const unsigned count = sp_measure_point_count(measure->kind);
    for (int a = 0; a < 3 && count == 3; a++) {
        const double u = p[1][a] - p[0][a], v = p[2][a] - p[0][a];
        points[3][a] = p[0][a] + u + v;
        if (!is_ellipse)
            continue;
        points[0][a] = p[0][a] - u - v;
        points[1][a] = p[0][a] + u - v;
        points[2][a] = p[0][a] - u + v;
    }
    return sp_bricks_around(volume, (const double(*)[3])points, count == 3 ? 4 : count, READ_MS,
                            level, err);
}

/* A part or a path of the volume with the view's edits. */
static bool measure_part(struct sp_volume *volume, const struct sp_view *view,
                         const struct sp_measure *measure, struct proto_measure_value *value,
                         struct sp_error *err) {
    struct sp_volume *edited = sp_edit_volume(volume, view, err);
    value->level = sp_bricks_base(volume);
    const bool ok = edited && sp_measure_compute(edited, measure, &value->result, err);
    value->volume_samples = sp_measure_cost(volume, measure);
    sp_volume_unref(&edited);
    return ok;
}

bool srv_catalog_measure(void *user, struct srv_volume *handle, const struct sp_view *view,
                         const struct sp_measure *measure, double samples,
                         struct proto_measure_value *value, struct sp_error *err) {
    struct sp_volume *volume = handle->volume;
    (void)user;
    if (!sp_measure_check(measure, err))
        return false;
    proto_measure_set_units(value, sp_volume_info(volume));
    value->volume_samples = 0;
    value->level = 0;
    if (sp_measure_has_range(measure->kind))
        return measure_part(volume, view, measure, value, err);
    struct sp_volume *part = srv_measured_samples(volume, measure, &value->level, err);
    const double cost = part ? sp_measure_cost(part, measure) : 0;
    bool ok = part != NULL;
    if (cost > samples)
        ok = sp_fail(err, SP_ERR_INVALID, "/points",
                     "the region covers %.0f samples and a session takes up to %.0f; make it "
                     "smaller, or measure it by POST /measure",
                     cost, samples);
    ok = ok && sp_measure_compute(part, measure, &value->result, err);
    sp_volume_unref(&part);
    return ok;
}

/* What to choose in the file of an entry, in *parts. A component of vectors that are replaced ends.
 */
static void choose(const struct srv_volume *v, const char *field, const char *vectors,
                   struct sp_source_parts *parts) {
    *parts = sp_source_split(v->source);
    if (field)
        parts->field = field;
    if (!vectors)
        return;
    const char *old = v->volume ? sp_volume_info(v->volume)->vector_name : "";
    const size_t length = strlen(old);
    if (!field && length && strncmp(parts->field, old, length) == 0 && parts->field[length] == ' ')
        parts->field = "";
    snprintf(parts->vectors, sizeof parts->vectors, "%s", vectors);
}

/* Finds the entry that has loaded these fields of the same file; NULL = none has. With the mutex
 * held. */
static const struct srv_volume *find_fields(const struct srv_catalog *catalog,
                                            const struct srv_volume *of,
                                            const struct sp_source_parts *wanted) {
    const size_t length = sp_source_split(of->source).file_bytes;
    for (const struct srv_volume *v = catalog->entries; v; v = v->next) {
        if (v->state != SRV_VOLUME_READY || sp_source_split(v->source).file_bytes != length ||
            memcmp(v->source, of->source, length) != 0)
            continue;
        const struct sp_volume_info *info = sp_volume_info(v->volume);
        const struct sp_source_parts own = sp_source_split(v->source);
        if ((wanted->field[0] ? strcmp(info->value_name, wanted->field) == 0 : !own.field[0]) &&
            (wanted->vectors[0] ? strcmp(info->vector_name, wanted->vectors) == 0
                                : !own.vectors[0]))
            return v;
    }
    return NULL;
}

/* Writes the source with these fields, malloc'ed; NULL without memory. */
static char *source_of(const char *file, size_t length, const struct sp_source_parts *parts) {
    char *source = NULL;
    const char *vectors = parts->vectors, *field = parts->field;
    const char *first = parts->file_bytes == parts->path_bytes ? "?" : "&",
               *second = vectors[0] ? "&" : first;
    const int written = asprintf(&source, "%.*s%s%s%s%s%s%s", (int)length, file,
                                 vectors[0] ? first : "", vectors[0] ? "vectors=" : "", vectors,
                                 field[0] ? second : "", field[0] ? "field=" : "", field);
    return written < 0 ? NULL : source;
}

bool srv_catalog_field(struct srv_catalog *catalog, const char *id, const char *field,
                       const char *vectors, struct srv_volume_request *request, char **source,
                       struct sp_error *err) {
    pthread_mutex_lock(&catalog->mutex);
    const struct srv_volume *v = srv_catalog_entry(catalog, id);
    bool ok = v || sp_fail(err, SP_ERR_NOT_FOUND, "/volume", "there is no volume '%s'", id);
    if (ok && srv_source_is_demo(v->source))
        ok = sp_fail(err, SP_ERR_INVALID, "/volume", "is built in and has one field");
    if (ok && srv_source_is_memory(v->source))
        ok = sp_fail(err, SP_ERR_INVALID, "/volume", "is an array, which has one field");
    if (ok) {
        struct sp_source_parts choice;
        choose(v, field, vectors, &choice);
        const struct srv_volume *known = find_fields(catalog, v, &choice);
        const size_t folder = v->confined ? strlen(catalog->data) : 0;
        const size_t begin = folder > 1 ? folder + 1 : folder; /* "/" ends with its slash */
        request->confined = v->confined;
        *source = known ? strdup(known->source + begin)
                        : source_of(v->source + begin, choice.file_bytes - begin, &choice);
        if (!*source)
            ok = sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
    }
    pthread_mutex_unlock(&catalog->mutex);
    return ok;
}

struct sp_volume *srv_volume_voxels(const struct srv_volume *volume) {
    return volume->volume;
}

struct srv_fingerprint srv_catalog_fingerprint(struct srv_catalog *catalog,
                                               const struct srv_volume *volume,
                                               const struct sp_view *view) {
    struct srv_fingerprint own[2 * SP_LAYERS_MAX + 1] = { volume->fingerprint };
    struct srv_piece pieces[2 * SP_LAYERS_MAX + 1] = { { &own[0], sizeof own[0] } };
    unsigned count = 1;
    pthread_mutex_lock(&catalog->mutex);
    for (uint32_t i = 0; i < 2 * view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i / 2];
        const char *id = i % 2 ? layer->color_by : layer->id;
        const struct srv_volume *v = *id ? srv_catalog_entry(catalog, id) : NULL;
        if (!*id)
            continue;
        if (v && v->state == SRV_VOLUME_READY)
            own[count] = v->fingerprint;
        pieces[count] = (struct srv_piece){ &own[count], sizeof own[count] };
        count++;
    }
    pthread_mutex_unlock(&catalog->mutex);
    return count > 1 ? srv_fingerprint_of(pieces, count) : volume->fingerprint;
}

const struct srv_fingerprint *srv_volume_fingerprint(const struct srv_volume *volume) {
    return &volume->fingerprint;
}

void srv_catalog_set_cached(struct srv_catalog *catalog, struct srv_volume *volume,
                            unsigned renderer, uint64_t bytes) {
    assert(renderer < SRV_RENDERERS);
    pthread_mutex_lock(&catalog->mutex);
    volume->cached_bytes[renderer] = bytes;
    pthread_mutex_unlock(&catalog->mutex);
}

const struct sp_joint_histogram *srv_catalog_joint_histogram(struct srv_catalog *catalog,
                                                             struct srv_volume *volume,
                                                             struct sp_error *err) {
    pthread_mutex_lock(&catalog->joint_mutex);
    if (!volume->joint) {
        struct sp_joint_histogram *joint = malloc(sizeof *joint);
        if (!joint)
            sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the histogram");
        else if (sp_joint_histogram_count(volume->volume, joint, err))
            volume->joint = joint;
        else
            free(joint);
    }
    const struct sp_joint_histogram *joint = volume->joint;
    pthread_mutex_unlock(&catalog->joint_mutex);
    return joint;
}
