/* SPDX-License-Identifier: Apache-2.0
 *
 * The catalog for its readers: status of volumes, and counted uses.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/catalog_private.h"
#include "render/redact.h"
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
    if (v->shown)
        snprintf(status->source, sizeof status->source, "%s", v->shown);
    else
        srv_redact_source(catalog->data, v->source, status->source, sizeof status->source);
    status->state = v->state;
    status->progress = v->progress;
    status->error = v->error;
    status->volume = v->volume ? sp_volume_ref(v->volume) : NULL;
    status->cached_bytes = 0;
    status->voxel_bytes = v->reserved_bytes;
    memcpy(status->cached_per_renderer, v->cached_bytes, sizeof status->cached_per_renderer);
    for (int r = 0; r < SRV_RENDERERS; r++)
        status->cached_bytes += v->cached_bytes[r];
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

void srv_catalog_memory(struct srv_catalog *catalog, uint64_t *used, uint64_t *budget) {
    pthread_mutex_lock(&catalog->mutex);
    *used = catalog->used_bytes;
    *budget = catalog->options.memory_bytes;
    pthread_mutex_unlock(&catalog->mutex);
}

void *srv_catalog_acquire(void *user, const char *id, struct sp_error *err) {
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

void *srv_catalog_ref(void *user, void *volume) {
    struct srv_catalog *catalog = user;
    struct srv_volume *v = volume;
    pthread_mutex_lock(&catalog->mutex);
    v->uses++;
    pthread_mutex_unlock(&catalog->mutex);
    return v;
}

void srv_catalog_release(void *user, void *volume) {
    struct srv_catalog *catalog = user;
    struct srv_volume *v = volume;
    pthread_mutex_lock(&catalog->mutex);
    assert(v->uses > 0);
    bool is_last = --v->uses == 0 && v->is_removed;
    pthread_mutex_unlock(&catalog->mutex);
    if (is_last)
        srv_catalog_free_removed(catalog, v);
}

void srv_catalog_default_view(void *user, void *volume, struct sp_view *view) {
    (void)user;
    *view = ((struct srv_volume *)volume)->view;
}

bool srv_catalog_fits(void *user, void *volume, const struct sp_view *view, struct sp_error *err) {
    (void)user;
    return sp_view_fits(view, sp_volume_info(((struct srv_volume *)volume)->volume), err);
}

void srv_catalog_pick(void *user, void *volume, const struct sp_view *view, const uint32_t size[2],
                      const double at[2], struct sp_pick *pick) {
    (void)user;
    struct sp_volume *shown = sp_edit_volume_made(((struct srv_volume *)volume)->volume, view);
    sp_pick_at(shown, view, size, at, pick);
    sp_volume_unref(&shown);
}

/* A part or a path of the volume with the view's edits. */
static bool measure_part(struct sp_volume *volume, const struct sp_view *view,
                         const struct sp_measure *measure, struct proto_measure_value *value,
                         struct sp_error *err) {
    struct sp_volume *shown = sp_edit_volume(volume, view, err);
    const bool ok = shown && sp_measure_compute(shown, measure, &value->result, err);
    value->volume_samples = sp_measure_cost(volume, measure);
    sp_volume_unref(&shown);
    return ok;
}

bool srv_catalog_measure(void *user, void *handle, const struct sp_view *view,
                         const struct sp_measure *measure, double samples,
                         struct proto_measure_value *value, struct sp_error *err) {
    struct sp_volume *volume = ((struct srv_volume *)handle)->volume;
    (void)user;
    if (!sp_measure_check(measure, err))
        return false;
    memcpy(value->world_unit, sp_volume_info(volume)->unit, sizeof value->world_unit);
    value->volume_samples = 0;
    if (sp_measure_has_range(measure->kind))
        return measure_part(volume, view, measure, value, err);
    const double cost = sp_measure_cost(volume, measure);
    if (cost > samples)
        return sp_fail(err, SP_ERR_INVALID, "/points",
                       "the region covers %.0f samples and a session takes up to %.0f; make it "
                       "smaller, or measure it by POST /measure",
                       cost, samples);
    return sp_measure_compute(volume, measure, &value->result, err);
}

struct sp_volume *srv_volume_voxels(const struct srv_volume *volume) {
    return volume->volume;
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
